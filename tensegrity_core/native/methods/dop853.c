/* Explicit, order 8, adaptive, dense output of order 7.  Sources: dop853_tableau.h. */
#include "linear/pairs.h"
#include "methods/method.h"
#include "methods/stages.h"
#include "model/data.h"
#include "motion/motion.h"

#include <math.h>

#include "methods/dop853_tableau.h"

#define STIFF 2.0 /* h lambda from which an implicit step may be the longer one; the method bears about 6 */

/* Stage s of an attempt: its argument in ytmp, its derivative in row s of k. */
#define STAGE(s)                                                                         \
    do {                                                                                 \
        add_stages(sim->state.y, A[s], s, sim->attempt.k, stride, h, n, sim->attempt.y); \
        ts_rhs(sim, tau + C[s] * h, sim->attempt.y, sim->attempt.k + (s) * stride);      \
    } while (0)

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
    STAGE(1);
    STAGE(2);
    STAGE(3);
    STAGE(4);
    STAGE(5);
    STAGE(6);
    STAGE(7);
    STAGE(8);
    STAGE(9);
    STAGE(10);
    STAGE(11);
    add_stages(sim->state.y, A[12], 12, sim->attempt.k, stride, h, stride, sim->ahead.y);
    /* h lambda as seen between the two stages at the step's end (Hairer, Norsett, Wanner, section IV.2) needs the last
     * argument: accept() finds it in ytmp. */
    return combined_error(sim, h);
}

/* Does stability rather than accuracy limit the step? */
static void watch_stiffness(ts_sim *sim, double h)
{
    const double *last = sim->attempt.k + 11 * sim->m.stride;
    double force = 0.0, state = 0.0;
    for (int i = 0; i < 2 * sim->m.nq; i++) {
        double f = sim->ahead.f[i] - last[i], y = sim->ahead.y[i] - sim->attempt.y[i];
        force += f * f;
        state += y * y;
    }
    double h_lambda = state > 0.0 ? h * sqrt(force / state) : 0.0;
    sim->memory.choice.h_lambda = h_lambda;
    if (h_lambda > STIFF) sim->memory.stiff += sim->memory.stiff < 1000;
    else if (sim->memory.stiff > 0 && !sim->memory.rejected) sim->memory.stiff--;
}

static void accept(ts_sim *sim, double tau, double h)
{
    int stride = sim->m.stride;
    double *last = sim->attempt.k + 12 * stride;
    ts_rhs(sim, tau + h, sim->ahead.y, sim->ahead.f);
    for (int i = 0; i < stride; i++) last[i] = sim->ahead.f[i];
    watch_stiffness(sim, h);
}

static void densify(ts_sim *sim, double tau, double h)
{
    int stride = sim->m.stride, n = padded(2 * sim->m.nq);
    double *RESTRICT c = sim->ahead.dense;
    const double *RESTRICT y = sim->state.y, *RESTRICT y1 = sim->ahead.y, *RESTRICT f0 = sim->start.f,
                           *RESTRICT f1 = sim->ahead.f;
    STAGE(13);
    STAGE(14);
    STAGE(15);
    for (int i = 0; i < stride; i++) {
        double dy = y1[i] - y[i];
        c[stride + i] = dy;
        c[2 * stride + i] = h * f0[i] - dy;
        c[3 * stride + i] = 2.0 * dy - h * (f1[i] + f0[i]);
    }
    sum_stages(DENSE[0], 16, sim->attempt.k, stride, h, stride, c + 4 * stride);
    sum_stages(DENSE[1], 16, sim->attempt.k, stride, h, stride, c + 5 * stride);
    sum_stages(DENSE[2], 16, sim->attempt.k, stride, h, stride, c + 6 * stride);
    sum_stages(DENSE[3], 16, sim->attempt.k, stride, h, stride, c + 7 * stride);
}

static void interpolate(const ts_sim *sim, double theta, int first, int count, double *out)
{
    int stride = sim->m.stride;
    double rest = 1.0 - theta;
    const double *c = sim->ahead.dense + first;
    for (int i = 0; i < count; i++) {
        double inner = c[4 * stride + i] + theta * (c[5 * stride + i] + rest * (c[6 * stride + i] + theta * c[7 * stride + i]));
        out[i] = c[i] + theta * (c[stride + i] + rest * (c[2 * stride + i] + theta * (c[3 * stride + i] + rest * inner)));
    }
}

const ts_method ts_dop853 = {"dop853", 1.0 / 8.0, 6.0, 0.04, TS_LEDGER_IN_STAGES, 0, 8, attempt, accept, densify, interpolate};
