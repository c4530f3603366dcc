/* Linear systems of the linearly implicit methods. */
#ifndef TENSEGRITY_SYSTEMS_H
#define TENSEGRITY_SYSTEMS_H

#include "tensegrity.h"

int ts_stage_factorise(ts_sim *sim, double a);
void ts_stage_solve(ts_sim *sim, double a, double *U);
int ts_pair_factorise(ts_sim *sim, int which, double a, double b);
void ts_pair_solve(ts_sim *sim, int which, double a, double b, double *Ur, double *Ui);

#endif
