/* Sums over stages, shared by the methods.  With constant coefficients and count the compiler unrolls the sum, drops zeros
 * and works on several components at once.  Arrays are padded with zeros to a multiple of TS_LANES. */
#ifndef TENSEGRITY_STAGES_H
#define TENSEGRITY_STAGES_H

#include "linear/pairs.h"
#include "model/data.h"
#include "model/model.h"
#include "motion/motion.h"

#include <math.h>

/* Components of a vector of n, with padding. */
ALWAYS_INLINE int padded(int n) { return (n + TS_LANES - 1) & ~(TS_LANES - 1); }

/* out = scale * sum over count rows of a_j k_j */
ALWAYS_INLINE void sum_stages(const double *a, const int count, const double *RESTRICT k, int stride, double scale, int n,
                              double *RESTRICT out)
{
    for (int i = 0; i < n; i++) {
        double sum = 0.0;
        UNROLL
        for (int j = 0; j < count; j++)
            if (a[j] != 0.0) sum += a[j] * k[j * stride + i];
        out[i] = scale * sum;
    }
}

/* out = y + scale * sum over count rows of a_j k_j */
ALWAYS_INLINE void add_stages(const double *RESTRICT y, const double *a, const int count, const double *RESTRICT k, int stride,
                              double scale, int n, double *RESTRICT out)
{
    for (int i = 0; i < n; i++) {
        double sum = 0.0;
        UNROLL
        for (int j = 0; j < count; j++)
            if (a[j] != 0.0) sum += a[j] * k[j * stride + i];
        out[i] = y[i] + scale * sum;
    }
}

/* Stage s of an attempt of an explicit method A, C: its argument in attempt.y, its derivative in row s of attempt.k. */
#define EXPLICIT_STAGE(s)                                                                \
    do {                                                                                 \
        add_stages(sim->state.y, A[s], s, sim->attempt.k, stride, h, n, sim->attempt.y); \
        ts_rhs(sim, tau + C[s] * h, sim->attempt.y, sim->attempt.k + (s) * stride);      \
    } while (0)

/* Rows 1 to 3 of a dense output: the cubic through both ends and their derivatives. */
ALWAYS_INLINE void hermite(const double *RESTRICT y0, const double *RESTRICT f0, const double *RESTRICT y1,
                           const double *RESTRICT f1, double h, int stride, double *RESTRICT dense)
{
    for (int i = 0; i < stride; i++) {
        double dy = y1[i] - y0[i];
        dense[stride + i] = dy;
        dense[2 * stride + i] = h * f0[i] - dy;
        dense[3 * stride + i] = 2.0 * dy - h * (f1[i] + f0[i]);
    }
}

/* Does stability rather than accuracy limit the accepted step?  h lambda as seen between a stage at its end, whose argument is still
 * in attempt.y, and the end itself (Hairer, Wanner, section IV.2); limit: from which an implicit step may be the longer one. */
ALWAYS_INLINE void watch_stiffness(ts_sim *sim, int stage, double h, double limit)
{
    const double *before = sim->attempt.k + stage * sim->m.stride;
    double force = 0.0, state = 0.0;
    for (int i = 0; i < 2 * sim->m.nq; i++) {
        double f = sim->ahead.f[i] - before[i], y = sim->ahead.y[i] - sim->attempt.y[i];
        force += f * f;
        state += y * y;
    }
    double h_lambda = state > 0.0 ? h * sqrt(force / state) : 0.0;
    sim->memory.choice.h_lambda = h_lambda;
    if (h_lambda > limit) sim->memory.stiff += sim->memory.stiff < 1000;
    else if (sim->memory.stiff > 0 && !sim->memory.rejected) sim->memory.stiff--;
}

#endif
