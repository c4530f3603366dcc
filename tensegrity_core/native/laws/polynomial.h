/* Polynomials of degree TS_DEGREE, as their coefficients from the constant one on. */
#ifndef TENSEGRITY_POLYNOMIAL_H
#define TENSEGRITY_POLYNOMIAL_H

#include "linear/pairs.h"

#define TS_SAME 1e-6 /* of an interval: places that are one */

ALWAYS_INLINE int ts_sign(double x) { return (x > 0.0) - (x < 0.0); }

double ts_polynomial(const double *coef, double t);
void ts_shift_polynomial(const double *c, double y, double *out);
void ts_derive_polynomial(const double *c, double *out);
int ts_sign_changes(const double *c, double lo, double hi, double *out);
double ts_last_zero(const double *c);
double ts_limit(const double *c);
int ts_drop_ends(double *turns, int n, double width);

#endif
