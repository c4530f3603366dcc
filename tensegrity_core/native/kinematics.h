/* Inline pieces that motion.c and jacobian.c share. */
#ifndef TENSEGRITY_KINEMATICS_H
#define TENSEGRITY_KINEMATICS_H

#include "internal.h"

#include <string.h>

#if defined(__GNUC__)
#define ALWAYS_INLINE static inline __attribute__((always_inline))
#define APART __attribute__((noinline)) /* what is rare stays out of the way of what is not */
#else
#define ALWAYS_INLINE static inline
#define APART
#endif

/* Call body(..., D) with D known to the compiler. */
#define DISPATCH(sim, body, ...)                             \
    do {                                                     \
        if ((sim)->m.count[TS_D] == 2) body(__VA_ARGS__, 2); \
        else body(__VA_ARGS__, 3);                           \
    } while (0)

/* Two numbers that are worked on together, and the bits of a comparison of theirs. */
typedef double pair __attribute__((vector_size(16)));
typedef long long bits __attribute__((vector_size(16)));

ALWAYS_INLINE pair get(const double *x)
{
    pair p;
    memcpy(&p, x, sizeof p);
    return p;
}

ALWAYS_INLINE void put(double *x, pair p) { memcpy(x, &p, sizeof p); }

ALWAYS_INLINE pair choose(bits first, pair a, pair b) { return (pair)((first & (bits)a) | (~first & (bits)b)); }
ALWAYS_INLINE pair larger(pair a, pair b) { return choose(a > b, a, b); }
ALWAYS_INLINE pair smaller(pair a, pair b) { return choose(a < b, a, b); }

ALWAYS_INLINE double dot(const double *a, const double *b, const int D)
{
    double sum = a[0] * b[0] + a[1] * b[1];
    return D == 3 ? sum + a[2] * b[2] : sum;
}

/* String vector and its rate from the blocks. */
ALWAYS_INLINE void string_vector(const ts_model *m, const double *q, const double *v, int i, double *s, double *sd, const int D)
{
    const ts_term *t = m->term + 4 * i;
    for (int d = 0; d < D; d++) s[d] = m->s0[i * D + d], sd[d] = 0.0;
    for (int k = 0; k < m->term_count[i]; k++)
        for (int d = 0; d < D; d++) {
            s[d] += t[k].kappa * q[t[k].offset + d];
            sd[d] += t[k].kappa * v[t[k].offset + d];
        }
}

#endif
