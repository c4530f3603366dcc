/* Explicit, order 8, adaptive, dense output of order 7.  Sources: dop853_tableau.h. */
#include "methods/method.h"
#include "methods/stages.h"
#include "model/data.h"
#include "motion/motion.h"

#include <math.h>
#include <string.h>

#include "methods/dop853_tableau.h"

#define STIFF 2.0 /* h lambda from which an implicit step may be the longer one; the method bears about 6 */

/* Error of the step in units of the tolerance, from the two embedded estimates (Hairer, Norsett, Wanner, section II.10). */
static double combined_error(ts_sim *sim, double h)
{
    int stride = sim->m.stride, n = 2 * sim->m.nq;
    double *e5 = sim->ahead.dense, *e3 = sim->ahead.dense + stride, tolerance = sim->io.values[sim->m.at[TS_TOLERANCE]], norm5,
           norm3;
    sum_stages(E5, 12, sim->attempt.k, stride, 1.0, stride, e5);
    sum_stages(E3, 12, sim->attempt.k, stride, 1.0, stride, e3);
    ts_error_norms(sim, e5, e3, sim->state.y, sim->ahead.y, &norm5, &norm3);
    /* The ledger counts too, relative to 1 J; not the throughput, which has kinks itself and does not matter. */
    double scale = 1.0 / ((1.0 + fabs(sim->state.y[n])) * tolerance);
    double lost5 = fmax(fabs(e5[n]), fabs(e5[n + 1])) * scale, lost3 = fmax(fabs(e3[n]), fabs(e3[n + 1])) * scale;
    if (lost5 > norm5) norm5 = lost5;
    if (lost3 > norm3) norm3 = lost3;
    if (norm5 == 0.0) return 0.0;
    double ratio = norm3 / norm5; /* divided before squaring: a wild step must not overflow into acceptance */
    return h * norm5 / sqrt(1.0 + 0.01 * ratio * ratio);
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
    EXPLICIT_STAGE(6);
    EXPLICIT_STAGE(7);
    EXPLICIT_STAGE(8);
    EXPLICIT_STAGE(9);
    EXPLICIT_STAGE(10);
    EXPLICIT_STAGE(11);
    add_stages(sim->state.y, A[12], 12, sim->attempt.k, stride, h, stride, sim->ahead.y);
    /* h lambda as seen between the two stages at the step's end (Hairer, Norsett, Wanner, section IV.2) needs the last
     * argument: accepted() finds it in ytmp. */
    return combined_error(sim, h);
}

static void accepted(ts_sim *sim, double h)
{
    double *end = sim->attempt.k + 12 * sim->m.stride; /* stage 12, for densify() */
    watch_stiffness(sim, 11, h, STIFF);
    memcpy(end, sim->ahead.f, sizeof(double) * (size_t)sim->m.stride);
}

static void densify(ts_sim *sim, double tau, double h)
{
    int stride = sim->m.stride, n = padded(2 * sim->m.nq);
    double *c = sim->ahead.dense;
    EXPLICIT_STAGE(13);
    EXPLICIT_STAGE(14);
    EXPLICIT_STAGE(15);
    hermite(sim->state.y, sim->start.f, sim->ahead.y, sim->ahead.f, h, stride, c);
    sum_stages(DENSE[0], 16, sim->attempt.k, stride, h, stride, c + 4 * stride);
    sum_stages(DENSE[1], 16, sim->attempt.k, stride, h, stride, c + 5 * stride);
    sum_stages(DENSE[2], 16, sim->attempt.k, stride, h, stride, c + 6 * stride);
    sum_stages(DENSE[3], 16, sim->attempt.k, stride, h, stride, c + 7 * stride);
}

static void interpolate(const ts_step_ahead *ahead, double theta, int first, int count, double *out)
{
    int stride = ahead->stride;
    double rest = 1.0 - theta;
    const double *c = ahead->dense + first;
    for (int i = 0; i < count; i++) {
        double inner = c[4 * stride + i] + theta * (c[5 * stride + i] + rest * (c[6 * stride + i] + theta * c[7 * stride + i]));
        out[i] = c[i] + theta * (c[stride + i] + rest * (c[2 * stride + i] + theta * (c[3 * stride + i] + rest * inner)));
    }
}

const ts_method ts_dop853 = {1.0 / 8.0, 6.0, 0.04, TS_LEDGER_IN_STAGES, 0, 8, attempt, densify, interpolate, accepted};
