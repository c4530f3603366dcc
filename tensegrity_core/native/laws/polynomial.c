/* Polynomials of degree TS_DEGREE: values, and where they change their sign. */
#include "laws/polynomial.h"
#include "model/force_curve.h"

#include <math.h>
#include <string.h>

double ts_polynomial(const double *c, double t)
{
    double f = c[TS_DEGREE];
    for (int i = TS_DEGREE - 1; i >= 0; i--) f = f * t + c[i];
    return f;
}

/* Coefficients about y of a polynomial about 0. */
void ts_shift_polynomial(const double *c, double y, double *out)
{
    memcpy(out, c, sizeof(double) * (TS_DEGREE + 1));
    for (int i = 0; i < TS_DEGREE; i++)
        for (int k = TS_DEGREE - 1; k >= i; k--) out[k] += y * out[k + 1];
}

void ts_derive_polynomial(const double *c, double *out)
{
    for (int k = 0; k < TS_DEGREE; k++) out[k] = (k + 1) * c[k + 1];
    out[TS_DEGREE] = 0.0;
}

/* Places in (lo, hi) where a polynomial changes its sign, in order: between those of its derivative there is one at most. */
int ts_sign_changes(const double *c, double lo, double hi, double *out)
{
    double d[TS_DEGREE + 1], ends[TS_DEGREE + 2];
    int count = 0, degree = TS_DEGREE;
    while (degree > 0 && c[degree] == 0.0) degree--;
    if (degree == 0) return 0;
    ts_derive_polynomial(c, d);
    int n = ts_sign_changes(d, lo, hi, ends + 1);
    ends[0] = lo;
    ends[++n] = hi;
    for (int i = 0; i < n; i++) {
        double a = ends[i], b = ends[i + 1], fa = ts_polynomial(c, a), fb = ts_polynomial(c, b);
        if (fa == 0.0 && i > 0 && ts_polynomial(c, ends[i - 1]) * fb < 0.0)
            out[count++] = a; /* the derivative's zero is one, too */
        if (!(fa * fb < 0.0)) continue;
        for (double m = 0.5 * (a + b); m > a && m < b; m = 0.5 * (a + b)) {
            if ((ts_polynomial(c, m) > 0.0) == (fa > 0.0)) a = m;
            else b = m;
        }
        out[count++] = b;
    }
    return count;
}

/* Beyond this the polynomial's derivative has no zero (Cauchy's bound). */
double ts_last_zero(const double *c)
{
    int n = TS_DEGREE;
    double most = 0.0;
    while (n > 1 && c[n] == 0.0) n--;
    for (int k = 1; k < n; k++) most = fmax(most, fabs(k * c[k] / (n * c[n])));
    return 1.0 + most;
}

double ts_limit(const double *c)
{
    for (int k = TS_DEGREE; k > 0; k--)
        if (c[k] != 0.0) return c[k] > 0.0 ? INFINITY : -INFINITY;
    return c[0];
}

/* Extrema that are none: a polynomial whose slope vanishes at its end may find it again beside it. */
int ts_drop_ends(double *turns, int n, double width)
{
    int kept = 0;
    for (int i = 0; i < n; i++)
        if (turns[i] > TS_SAME * width && turns[i] < (1.0 - TS_SAME) * width) turns[kept++] = turns[i];
    return kept;
}
