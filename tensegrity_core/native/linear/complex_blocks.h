/* The complex counterpart of blocks.h: W = mu^2 I - mu Jv - Jq with a complex mu and real Jv, Jq, on the same pattern.
 *
 * A complex number is two adjacent doubles, real part first.  Jq and Jv are matrices as blocks.h describes them. */
#ifndef TENSEGRITY_COMPLEX_BLOCKS_H
#define TENSEGRITY_COMPLEX_BLOCKS_H

#include "linear/pattern.h"

/* Factorise W for mu = re + i im.  0 where W is singular or not finite, where elimination without pivoting between blocks loses
 * all but a few digits, or where a pivot is below 1e-145 or above 1e145 in magnitude; the factor is then unusable.  Matrices
 * and factor must not overlap. */
int ts_complex_factorise(const ts_pattern *p, double re, double im, const double *Jq, const double *Jv, double *factor);

/* Replace b, (n, D) complex numbers, by the solution x of W x = b. */
void ts_complex_solve(const ts_pattern *p, const double *factor, double *b);

#endif
