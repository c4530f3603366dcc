/* What a step takes from inputs and parameters, from the present ones or from those of the last step. */
#ifndef TENSEGRITY_APPLIED_H
#define TENSEGRITY_APPLIED_H

#include "tensegrity.h"

int ts_build_curves(ts_sim *sim);
void ts_set_reach(ts_sim *sim);
void ts_set_pieces(ts_sim *sim);
void ts_derive(ts_sim *sim);
void ts_swap_applied(ts_sim *sim);
void ts_swap_back(ts_sim *sim);
void ts_swap_inputs_back(ts_sim *sim);
void ts_keep_curves(ts_sim *sim);

#endif
