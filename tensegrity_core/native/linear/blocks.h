/* Factorisations and products of block matrices on a pattern. */
#ifndef TENSEGRITY_BLOCKS_H
#define TENSEGRITY_BLOCKS_H

#include "linear/pattern.h"

/* Factorise W = a^2 I - a Jv - Jq.  0 where W is singular or not finite, or where elimination without pivoting
 * between blocks loses all but a few digits; the factor is then unusable.  Matrices and factor must not overlap. */
int ts_blocks_factorise(const ts_pattern *p, double a, const double *Jq, const double *Jv, double *factor);

/* Replace b (n, D) by the solution x of W x = b. */
void ts_blocks_solve(const ts_pattern *p, const double *factor, double *b);

/* y = A x; x and y (n, D) must not overlap. */
void ts_blocks_multiply(const ts_pattern *p, const double *A, const double *x, double *y);

#endif
