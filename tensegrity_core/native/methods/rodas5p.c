/* L-stable Rosenbrock method of order 5 with the analytic Jacobian.  Sources: rodas5p_tableau.h. */
#include "methods/method.h"
#include "methods/stages.h"
#include "methods/systems.h"
#include "model/data.h"
#include "motion/jacobian.h"
#include "motion/motion.h"

#include <math.h>

#include "methods/rodas5p_tableau.h"

/* Stage s: from the derivative f at its argument to its increment in row s of k. */
#define SOLVE(s, f)                                                                 \
    do {                                                                            \
        double *U = sim->attempt.k + (s) * stride;                                  \
        add_stages(f, C[s], s, sim->attempt.k, stride, 1.0 / h, n, U);              \
        if (D[s] != 0.0)                                                            \
            for (int i = 0; i < nq; i++) U[nq + i] += h * D[s] * sim->linear.ft[i]; \
        ts_stage_solve(sim, a, U);                                                  \
    } while (0)

#define STAGE(s)                                                                           \
    do {                                                                                   \
        add_stages(sim->state.y, A[s], s, sim->attempt.k, stride, 1.0, n, sim->attempt.y); \
        ts_rhs(sim, tau + ALPHA[s] * h, sim->attempt.y, sim->ahead.f);                     \
        SOLVE(s, sim->ahead.f);                                                            \
    } while (0)

static double attempt(ts_sim *sim, double tau, double h)
{
    int nq = sim->m.nq, n = padded(2 * nq), stride = sim->m.stride;
    double a = 1.0 / (GAMMA * h);
    ts_rhs_jacobian(sim, tau, sim->state.y);
    if (!ts_stage_factorise(sim, a)) return NAN;
    SOLVE(0, sim->start.f);
    STAGE(1);
    STAGE(2);
    STAGE(3);
    STAGE(4);
    STAGE(5);
    STAGE(6);
    STAGE(7);
    const double *last = sim->attempt.k + 7 * stride; /* the error, too */
    for (int i = 0; i < 2 * nq; i++) sim->ahead.y[i] = sim->attempt.y[i] + last[i];
    return ts_error_norm(sim, last, sim->state.y, sim->ahead.y);
}

static void densify(ts_sim *sim, double tau, double h)
{
    int n = padded(2 * sim->m.nq), stride = sim->m.stride;
    (void)tau;
    (void)h;
    for (int i = 0; i < n; i++) sim->ahead.dense[stride + i] = sim->ahead.y[i];
    sum_stages(H[0], 8, sim->attempt.k, stride, 1.0, n, sim->ahead.dense + 2 * stride);
    sum_stages(H[1], 8, sim->attempt.k, stride, 1.0, n, sim->ahead.dense + 3 * stride);
    sum_stages(H[2], 8, sim->attempt.k, stride, 1.0, n, sim->ahead.dense + 4 * stride);
}

static void interpolate(const ts_step_ahead *ahead, double theta, int first, int count, double *out)
{
    int stride = ahead->stride;
    double rest = 1.0 - theta;
    const double *c = ahead->dense + first;
    for (int i = 0; i < count; i++)
        out[i] = rest * c[i] +
                 theta * (c[stride + i] + rest * (c[2 * stride + i] + theta * (c[3 * stride + i] + theta * c[4 * stride + i])));
}

const ts_method ts_rodas5p = {1.0 / 5.0, 6.0, 0.0, TS_IMPLICIT | TS_CLIPPED, 0, 5, attempt, densify, interpolate, NULL};
