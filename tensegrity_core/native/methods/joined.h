/* The linear systems of systems.c where bars are joined. */
#ifndef TENSEGRITY_JOINED_H
#define TENSEGRITY_JOINED_H

#include "tensegrity.h"

int ts_joined_factorise(ts_sim *sim, double a);
void ts_joined_solve(ts_sim *sim, double a, double *U);
int ts_joined_pair_factorise(ts_sim *sim, int which, double a, double b);
void ts_joined_pair_solve(ts_sim *sim, int which, double a, double b, double *Ur, double *Ui);

#endif
