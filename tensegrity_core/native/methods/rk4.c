/* Explicit, order 4, fixed step; dense output by the cubic through both ends and their derivatives.  Sources:
 * rk4_tableau.h. */
#include "methods/method.h"
#include "methods/stages.h"
#include "model/data.h"

#include <stddef.h>

#include "methods/rk4_tableau.h"

static double attempt(ts_sim *sim, double tau, double h)
{
    int stride = sim->m.stride, n = padded(2 * sim->m.nq);
    for (int i = 0; i < stride; i++) sim->attempt.k[i] = sim->start.f[i];
    EXPLICIT_STAGE(1);
    EXPLICIT_STAGE(2);
    EXPLICIT_STAGE(3);
    add_stages(sim->state.y, A[4], 4, sim->attempt.k, stride, h, stride, sim->ahead.y);
    return 0.0;
}

static void densify(ts_sim *sim, double tau, double h)
{
    (void)tau;
    hermite(sim->state.y, sim->start.f, sim->ahead.y, sim->ahead.f, h, sim->m.stride, sim->ahead.dense);
}

static void interpolate(const ts_step_ahead *ahead, double theta, int first, int count, double *out)
{
    int stride = ahead->stride;
    double rest = 1.0 - theta;
    const double *c = ahead->dense + first;
    for (int i = 0; i < count; i++)
        out[i] = c[i] + theta * (c[stride + i] + rest * (c[2 * stride + i] + theta * c[3 * stride + i]));
}

const ts_method ts_rk4 = {1.0, 1.0, 0.0, TS_FIXED_STEP | TS_LEDGER_IN_STAGES, 0, 4, attempt, densify, interpolate, NULL};
