/* Force curves and damping laws of a simulation's strings. */
#ifndef TENSEGRITY_CURVES_H
#define TENSEGRITY_CURVES_H

#include "model/model.h"
#include "tensegrity.h"

int ts_has_memory(const ts_model *m, int string);
const char *ts_curves_build(ts_sim *sim);
void ts_curves_free(ts_sim *sim);
const char *ts_dampers_build(ts_sim *sim);
void ts_dampers_free(ts_sim *sim);
double ts_damping_law(const ts_sim *sim, int string, double rate, double *slope);

#endif
