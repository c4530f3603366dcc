/* Force laws of elements, from their parameters and from programs. */
#ifndef TENSEGRITY_ELEMENTS_H
#define TENSEGRITY_ELEMENTS_H

#include "laws/law.h"
#include "model/model.h"

#include <stdint.h>

void ts_law_beam(ts_law *law, double Q, double zeta, double h);
void ts_law_compile(ts_law *law, const ts_model *m, int32_t first_int, int32_t first_double);
int ts_law_has_memory(const ts_model *m, int32_t first_int);
const char *ts_law_parts(ts_law **part, int *n, const ts_model *m, int32_t first_int, int32_t first_double);

#endif
