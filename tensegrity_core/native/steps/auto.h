/* `auto`: which method takes the next step. */
#ifndef TENSEGRITY_AUTO_H
#define TENSEGRITY_AUTO_H

#include "model/data.h"
#include "tensegrity.h"

void ts_start_choice(ts_memory *memory);
int ts_choice_is_possible(const ts_memory *memory);
void ts_review_step(ts_sim *sim, double h);
void ts_review_rejection(ts_sim *sim);
void ts_review_restart(ts_sim *sim, double tau, double h);

#endif
