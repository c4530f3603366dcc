/* Where moved nodes and the ground are, and how they move, over a step. */
#ifndef TENSEGRITY_BASES_H
#define TENSEGRITY_BASES_H

#include "model/data.h"
#include "model/model.h"

#define TS_BASE_DERIVATIVES 5 /* of a moved node's position: from the position itself to the fourth */

void ts_base_polynomial(const ts_model *m, const double *values, const double *slopes, int e, double *out);
double ts_base_derivative(const double *p, int D, int d, int order, double tau);
double ts_base_jerk(const ts_bases *bases, int D, double tau, int e, int d);
void ts_base_at(const ts_bases *bases, int D, double tau, int e, double *x, double *v);
void ts_move_bases(const ts_model *m, double tau, ts_bases *bases, double *x);
void ts_raise_ground(ts_sim *sim);

#endif
