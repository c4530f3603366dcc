/* Jacobian of the accelerations, whole and the part of it that damps. */
#ifndef TENSEGRITY_JACOBIAN_H
#define TENSEGRITY_JACOBIAN_H

#include "tensegrity.h"

void ts_rhs_jacobian(ts_sim *sim, double tau, const double *y);
void ts_damping_jacobian(ts_sim *sim, double tau, const double *y);

#endif
