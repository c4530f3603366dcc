/* Continuous states as a host has them, and as they stand in a state y. */
#ifndef TENSEGRITY_CONTINUOUS_H
#define TENSEGRITY_CONTINUOUS_H

#include "model/model.h"

void ts_pick_states(const ts_model *m, const double *y, double *x);
void ts_put_states(const ts_model *m, const double *x, double *y);

#endif
