/* Outputs on demand. */
#ifndef TENSEGRITY_DEMAND_H
#define TENSEGRITY_DEMAND_H

#include "tensegrity.h"

void ts_group_outputs(ts_sim *sim);
int ts_fill_after_step(ts_sim *sim, int inputs_jumped);
int ts_fill_within_step(ts_sim *sim);

#endif
