/* Single-valued force curve of an NSH of few beams, on equal rows. */
#ifndef TENSEGRITY_NSH_H
#define TENSEGRITY_NSH_H

#include "model/force_curve.h"

int ts_nsh_curve(ts_curve *c, int n, const double *Q, const double *zeta, const double *h);

#endif
