/* Explicit, order 4, fixed step; dense output by the cubic through both ends and their derivatives.  Sources:
 * rk4_tableau.h. */
#include "methods/method.h"
#include "methods/stages.h"
#include "model/data.h"
#include "motion/motion.h"

#include "methods/rk4_tableau.h"

#define STAGE(s)                                                                         \
    do {                                                                                 \
        add_stages(sim->state.y, A[s], s, sim->attempt.k, stride, h, n, sim->attempt.y); \
        ts_rhs(sim, tau + C[s] * h, sim->attempt.y, sim->attempt.k + (s) * stride);      \
    } while (0)

static double attempt(ts_sim *sim, double tau, double h)
{
    int stride = sim->m.stride, n = padded(2 * sim->m.nq);
    for (int i = 0; i < stride; i++) sim->attempt.k[i] = sim->start.f[i];
    STAGE(1);
    STAGE(2);
    STAGE(3);
    add_stages(sim->state.y, A[4], 4, sim->attempt.k, stride, h, stride, sim->ahead.y);
    return 0.0;
}

static void accept(ts_sim *sim, double tau, double h) { ts_rhs(sim, tau + h, sim->ahead.y, sim->ahead.f); }

static void densify(ts_sim *sim, double tau, double h)
{
    int stride = sim->m.stride;
    double *c = sim->ahead.dense;
    (void)tau;
    for (int i = 0; i < stride; i++) {
        double dy = sim->ahead.y[i] - sim->state.y[i];
        c[stride + i] = dy;
        c[2 * stride + i] = h * sim->start.f[i] - dy;
        c[3 * stride + i] = 2.0 * dy - h * (sim->start.f[i] + sim->ahead.f[i]);
    }
}

static void interpolate(const ts_sim *sim, double theta, int first, int count, double *out)
{
    int stride = sim->m.stride;
    double rest = 1.0 - theta;
    const double *c = sim->ahead.dense + first;
    for (int i = 0; i < count; i++)
        out[i] = c[i] + theta * (c[stride + i] + rest * (c[2 * stride + i] + theta * c[3 * stride + i]));
}

const ts_method ts_rk4 = {"rk4",   1.0,    1.0,     0.0,        TS_FIXED_STEP | TS_LEDGER_IN_STAGES, 0, 4,
                          attempt, accept, densify, interpolate};
