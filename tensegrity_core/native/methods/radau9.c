/* Radau IIA with five stages: for stiff pieces, where methods of low stage order lose theirs.  Sources: radau9_tableau.h.
 *
 * The increments Z_i of the stages solve (A^-1/h x I) Z = F(y + Z), by simplified Newton iterations.  In the variables
 * W = TI Z these fall apart into one real and two complex systems, each reduced to half its size as in systems.c. */
#include "linear/pairs.h"
#include "linear/power.h"
#include "methods/method.h"
#include "methods/stages.h"
#include "methods/systems.h"
#include "model/data.h"
#include "motion/jacobian.h"
#include "motion/motion.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "methods/radau9_tableau.h"

#define STAGES 5
#define PAIRS 2
#define MOST_ITERATIONS 8
#define FIXED_EFFORT 0.3 /* of a step of ITERATIONS, the usual number, what does not go with their number */
#define ITERATIONS 2.7

/* out_s = sum_j M[s][j] in_j over the stages */
ALWAYS_INLINE void transform(const double M[STAGES][STAGES], const double *in, int stride, int n, double *out)
{
    sum_stages(M[0], STAGES, in, stride, 1.0, n, out);
    sum_stages(M[1], STAGES, in, stride, 1.0, n, out + stride);
    sum_stages(M[2], STAGES, in, stride, 1.0, n, out + 2 * stride);
    sum_stages(M[3], STAGES, in, stride, 1.0, n, out + 3 * stride);
    sum_stages(M[4], STAGES, in, stride, 1.0, n, out + 4 * stride);
}

/* theta > 1 continues the step beyond its end */
static void interpolate(const ts_step_ahead *ahead, double theta, int first, int count, double *out)
{
    int stride = ahead->stride;
    const double *c = ahead->dense + first;
    for (int i = 0; i < count; i++)
        out[i] =
            c[i] + theta * (c[stride + i] +
                            theta * (c[2 * stride + i] +
                                     theta * (c[3 * stride + i] + theta * (c[4 * stride + i] + theta * c[5 * stride + i]))));
}

/* First guess of the increments: the last step's polynomial where one joins on, else the velocity alone. */
static void guess(ts_sim *sim, double h, double *Z)
{
    int nq = sim->m.nq, stride = sim->m.stride;
    memset(Z, 0, sizeof(double) * (size_t)(STAGES * stride));
    for (int s = 0; s < STAGES; s++, Z += stride)
        if (sim->memory.joined > 0.0) {
            interpolate(&sim->ahead, 1.0 + C[s] * h / sim->memory.joined, 0, 2 * nq, Z);
            for (int i = 0; i < 2 * nq; i++) Z[i] -= sim->state.y[i];
        } else {
            for (int i = 0; i < nq; i++) Z[i] = C[s] * h * sim->state.y[nq + i];
        }
}

/* Residual of the stages in the transformed variables, R = TI F(y + Z) - L W/h; F takes the place of Z. */
static void residual(ts_sim *sim, double tau, double h, double *Z, const double *W, double *R)
{
    int stride = sim->m.stride, n = padded(2 * sim->m.nq);
    for (int s = 0; s < STAGES; s++) {
        double *z = Z + s * stride;
        for (int i = 0; i < n; i++) sim->attempt.y[i] = sim->state.y[i] + z[i];
        ts_rhs(sim, tau + C[s] * h, sim->attempt.y, sim->ahead.f);
        memcpy(z, sim->ahead.f, sizeof(double) * (size_t)n);
    }
    transform(TI, Z, stride, n, R);
    for (int i = 0; i < n; i++) R[i] -= GAMMA / h * W[i];
    for (int k = 0; k < PAIRS; k++) {
        const double a = MU[k][0] / h, b = MU[k][1] / h, *w1 = W + (1 + 2 * k) * stride, *w2 = w1 + stride;
        double *r1 = R + (1 + 2 * k) * stride, *r2 = r1 + stride;
        for (int i = 0; i < n; i++) {
            r1[i] -= a * w1[i] + b * w2[i];
            r2[i] -= a * w2[i] - b * w1[i];
        }
    }
}

static double size_of(const ts_sim *sim, const double *R)
{
    int stride = sim->m.stride;
    double a, b, c, d, e = ts_error_norm(sim, R + 4 * stride, sim->state.y, sim->state.y);
    ts_error_norms(sim, R, R + stride, sim->state.y, sim->state.y, &a, &b);
    ts_error_norms(sim, R + 2 * stride, R + 3 * stride, sim->state.y, sim->state.y, &c, &d);
    double sum = a + b + c + d + e;
    return sum == sum ? fmax(fmax(fmax(a, b), fmax(c, d)), e) : NAN;
}

/* Newton iterations; the increments stand in Z.  Returns their number, or minus it where they do not converge. */
static int iterate(ts_sim *sim, double tau, double h, double *Z, double *W, double *R)
{
    int stride = sim->m.stride, n = padded(2 * sim->m.nq);
    double tolerance = sim->io.values[sim->m.at[TS_TOLERANCE]], last = 0.0;
    double enough = fmax(10.0 * DBL_EPSILON / tolerance, fmin(0.03, sqrt(tolerance)));
    for (int it = 1; it <= MOST_ITERATIONS; it++) {
        residual(sim, tau, h, Z, W, R);
        ts_stage_solve(sim, GAMMA / h, R);
        for (int k = 0; k < PAIRS; k++)
            ts_pair_solve(sim, k, MU[k][0] / h, -MU[k][1] / h, R + (1 + 2 * k) * stride, R + (2 + 2 * k) * stride);
        for (int i = 0; i < STAGES * stride; i++) W[i] += R[i];
        transform(T, W, stride, n, Z);
        double size = size_of(sim, R), rate = it > 1 ? size / last : 0.0;
        if (!(size < INFINITY)) return -it;
        if (it == 1 ? size <= 1e-3 * enough : rate / (1.0 - rate) * size <= enough && rate < 1.0) return it;
        if (it > 1 && (rate >= 1.0 || ts_real_power(rate, MOST_ITERATIONS - it) / (1.0 - rate) * size > enough)) return -it;
        last = size;
    }
    return -MOST_ITERATIONS;
}

/* Order 5: the difference to a formula that also uses f0, filtered so that it stays bounded however stiff (Hairer, Wanner,
 * Solving Ordinary Differential Equations II, section IV.8). */
static double estimate(ts_sim *sim, double h, const double *Z, const double *f)
{
    int stride = sim->m.stride, n = padded(2 * sim->m.nq);
    add_stages(f, E, STAGES, Z, stride, GAMMA / h, n, sim->attempt.error);
    ts_stage_solve(sim, GAMMA / h, sim->attempt.error);
    return ts_error_norm(sim, sim->attempt.error, sim->state.y, sim->ahead.y);
}

static double attempt(ts_sim *sim, double tau, double h)
{
    int nq = sim->m.nq, stride = sim->m.stride, n = padded(2 * nq);
    double *Z = sim->attempt.k, *W = Z + STAGES * stride, *R = W + STAGES * stride;
    ts_rhs_jacobian(sim, tau, sim->state.y);
    int done = ts_stage_factorise(sim, GAMMA / h);
    for (int k = 0; k < PAIRS && done; k++) done = ts_pair_factorise(sim, k, MU[k][0] / h, -MU[k][1] / h);
    if (!done) return NAN;
    guess(sim, h, Z);
    transform(TI, Z, stride, n, W);
    int iterations = iterate(sim, tau, h, Z, W, R);
    sim->memory.choice.taken = FIXED_EFFORT + (1.0 - FIXED_EFFORT) * abs(iterations) / ITERATIONS;
    if (iterations < 0) {
        sim->attempt.shrink = 0.5;
        return NAN;
    }
    sim->attempt.growth = iterations <= 3 ? 8.0 : iterations == 4 ? 2.0 : 1.0; /* larger steps converge more slowly */
    const double *last = Z + (STAGES - 1) * stride;
    for (int i = 0; i < 2 * nq; i++) sim->ahead.y[i] = sim->state.y[i] + last[i];
    double err = estimate(sim, h, Z, sim->start.f);
    if (err > 1.0 && !(sim->memory.joined > 0.0)) { /* a transient begins: filter once more */
        for (int i = 0; i < 2 * nq; i++) sim->attempt.y[i] = sim->state.y[i] + sim->attempt.error[i];
        ts_rhs(sim, tau, sim->attempt.y, sim->ahead.f);
        err = estimate(sim, h, Z, sim->ahead.f);
    }
    return err;
}

static void densify(ts_sim *sim, double tau, double h)
{
    int n = padded(2 * sim->m.nq), stride = sim->m.stride;
    (void)tau;
    transform(DENSE, sim->attempt.k, stride, n, sim->ahead.dense + stride);
    sim->memory.joined = h;
}

const ts_method ts_radau9 = {1.0 / 6.0, 8.0, 0.0, TS_IMPLICIT | TS_ALWAYS_DENSE, 0, 6, attempt, densify, interpolate, NULL};
