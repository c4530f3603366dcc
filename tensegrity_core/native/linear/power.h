/* Powers that are alike on every platform: pow() and cbrt() differ in their last bits from one C library to the next, and a step
 * size that differs there makes another trajectory, within the tolerance.  Here only operations that IEEE 754 fixes are used. */
#ifndef TENSEGRITY_POWER_H
#define TENSEGRITY_POWER_H

#include "linear/pairs.h"

#include <math.h>

/* base^exponent for a finite base from 0 up (NaN gives NaN), to about 1e-15 times (1 + |exponent log2 base|). */
ALWAYS_INLINE double ts_real_power(double base, double exponent)
{
    static const double LN2 = 0.69314718055994530942, SQRT_HALF = 0.70710678118654752440;
    static const double artanh[] = {1.0,        1.0 / 3.0,  1.0 / 5.0,  1.0 / 7.0,  1.0 / 9.0, 1.0 / 11.0,
                                    1.0 / 13.0, 1.0 / 15.0, 1.0 / 17.0, 1.0 / 19.0, 1.0 / 21.0}; /* over s, in s^2 */
    static const double inverse_factorial[] = {1.0,
                                               1.0,
                                               1.0 / 2.0,
                                               1.0 / 6.0,
                                               1.0 / 24.0,
                                               1.0 / 120.0,
                                               1.0 / 720.0,
                                               1.0 / 5040.0,
                                               1.0 / 40320.0,
                                               1.0 / 362880.0,
                                               1.0 / 3628800.0,
                                               1.0 / 39916800.0,
                                               1.0 / 479001600.0,
                                               1.0 / 6227020800.0,
                                               1.0 / 87178291200.0};
    if (base != base) return base;
    if (base <= 0.0) return exponent > 0.0 ? 0.0 : exponent < 0.0 ? INFINITY : 1.0;
    int e;
    double m = frexp(base, &e);
    if (m < SQRT_HALF) m *= 2.0, e--;
    /* ln m = 2 artanh s, its series: s^2 is at most 0.03 */
    double s = (m - 1.0) / (m + 1.0), s2 = s * s, sum = 0.0;
    for (int k = 10; k >= 0; k--) sum = sum * s2 + artanh[k];
    double y = exponent * (e + 2.0 * s * sum / LN2);
    if (!(fabs(y) < 2000.0)) return y < 0.0 ? 0.0 : INFINITY;
    double whole = floor(y + 0.5), x = (y - whole) * LN2, result = 0.0;
    for (int k = 14; k >= 0; k--) result = result * x + inverse_factorial[k]; /* exp x: x is at most 0.35 */
    return ldexp(result, (int)whole);
}

#endif
