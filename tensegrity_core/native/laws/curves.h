/* Force curves and damping laws of a simulation's strings. */
#ifndef TENSEGRITY_CURVES_H
#define TENSEGRITY_CURVES_H

#include "model/data.h"
#include "model/model.h"

int ts_has_memory(const ts_model *m, int string);
const char *ts_curves_build(ts_laws *laws, const ts_model *m, const double *values);
void ts_curves_free(ts_laws *laws, int strings);
const char *ts_dampers_build(ts_laws *laws, const ts_model *m);
void ts_dampers_free(ts_laws *laws, int strings);
double ts_damping_law(const ts_laws *laws, int string, double rate, double *slope);

#endif
