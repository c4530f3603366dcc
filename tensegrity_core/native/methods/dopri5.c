/* Explicit, order 5, adaptive, dense output of order 4: half the work of dop853 for a step that is short anyway.  The derivative at
 * the end is the last stage, and the next step's first.  Sources: dopri5_tableau.h. */
#include "methods/method.h"
#include "methods/stages.h"
#include "model/data.h"
#include "motion/joints.h"
#include "motion/motion.h"

#include <math.h>
#include <string.h>

#include "methods/dopri5_tableau.h"

#define STIFF 1.5 /* h lambda from which an implicit step may be the longer one; the method bears about 3.3 */

/* The ledger counts too, relative to 1 J, but for the throughput: as in dop853.c. */
static double error_of(ts_sim *sim, double h)
{
    int stride = sim->m.stride, n = 2 * sim->m.nq;
    double *e = sim->attempt.error, tolerance = sim->io.values[sim->m.at[TS_TOLERANCE]];
    sum_stages(E, 7, sim->attempt.k, stride, h, stride, e);
    double norm = ts_error_norm(sim, e, sim->state.y, sim->ahead.y);
    double lost = fmax(fabs(e[n]), fabs(e[n + 1])) / ((1.0 + fabs(sim->state.y[n])) * tolerance);
    return lost > norm ? lost : norm;
}

static double attempt(ts_sim *sim, double tau, double h)
{
    int stride = sim->m.stride, n = padded(2 * sim->m.nq);
    for (int i = 0; i < stride; i++) sim->attempt.k[i] = sim->start.f[i];
    EXPLICIT_STAGE(1);
    EXPLICIT_STAGE(2);
    EXPLICIT_STAGE(3);
    EXPLICIT_STAGE(4);
    EXPLICIT_STAGE(5);
    add_stages(sim->state.y, A[6], 6, sim->attempt.k, stride, h, stride, sim->ahead.y);
    ts_project(&sim->m, sim->ahead.y);
    if (sim->m.joint.nodes) ts_put_back(sim, tau + h, sim->ahead.y);
    ts_rhs(sim, tau + h, sim->ahead.y, sim->ahead.f);
    memcpy(sim->attempt.k + 6 * stride, sim->ahead.f, sizeof(double) * (size_t)stride);
    return error_of(sim, h);
}

static void accepted(ts_sim *sim, double h) { watch_stiffness(sim, 5, h, STIFF); }

static void densify(ts_sim *sim, double tau, double h)
{
    int stride = sim->m.stride;
    double *c = sim->ahead.dense;
    (void)tau;
    hermite(sim->state.y, sim->start.f, sim->ahead.y, sim->ahead.f, h, stride, c);
    sum_stages(DENSE, 7, sim->attempt.k, stride, h, stride, c + 4 * stride);
}

static void interpolate(const ts_step_ahead *ahead, double theta, int first, int count, double *out)
{
    int stride = ahead->stride;
    double rest = 1.0 - theta;
    const double *c = ahead->dense + first;
    for (int i = 0; i < count; i++)
        out[i] = c[i] +
                 theta * (c[stride + i] + rest * (c[2 * stride + i] + theta * (c[3 * stride + i] + rest * c[4 * stride + i])));
}

const ts_method ts_dopri5 = {
    1.0 / 5.0, 6.0, 0.04, TS_LEDGER_IN_STAGES | TS_CLIPPED | TS_ENDS_IN_STAGES, 0, 5, attempt, densify, interpolate, accepted};
