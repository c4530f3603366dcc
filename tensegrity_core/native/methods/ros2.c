/* Linearly implicit, order 2, fixed step, fixed cost: two right-hand sides, one factorisation, two solves, no iteration and
 * no rejected step.  Sources: ros2_tableau.h.
 *
 * The method keeps its order with any matrix in the place of the Jacobian, so it takes the part that damps
 * (ts_damping_jacobian): the system that it solves is then never singular, whatever stiffness, damping and step.  Where a
 * string is too stiff for the step to resolve, the more damping of the two coefficients keeps what strings do to each other
 * when they go slack and taut from feeding on itself.  Dense output is the cubic through positions and velocities at both
 * ends, which no fast transient of a force can spoil. */
#include "methods/method.h"
#include "methods/stages.h"
#include "methods/systems.h"
#include "model/data.h"
#include "motion/jacobian.h"
#include "motion/joints.h"
#include "motion/motion.h"

#include <math.h>

#include "methods/ros2_tableau.h"

/* Is a string so stiff that the step spans more than this many radians of its oscillation between its ends? */
#define RESOLVED 3.0

/* Inverse of the mass that a string moves along itself, at most (1/kg): each block by what all lines of the string turn it. */
static double inverse_mass(const ts_sim *sim, int i)
{
    const ts_lines *lines = &sim->m.string;
    const ts_term *t = lines->term + 4 * i;
    double inverse = 0.0;
    for (int k = 0; k < lines->term_count[i]; k++) inverse += t[k].kappa * t[k].kappa * sim->inertia.inverse[t[k].block];
    if (lines->term_count[i] || lines->routed[i] < 0) return inverse;
    const ts_route *route = lines->route + lines->routed[i];
    for (int b = 0; b < route->blocks; b++) {
        double all = 0.0;
        for (int k = 4 * route->first; k < 4 * (route->first + route->count); k++)
            if (k % 4 < lines->term_count[k / 4] && lines->term_block[k] == b) all += fabs(lines->term[k].kappa);
        inverse += all * all * sim->inertia.inverse[route->block[b]];
    }
    return inverse;
}

static int too_stiff(const ts_sim *sim, double h)
{
    const ts_model *m = &sim->m;
    double limit = RESOLVED * RESOLVED / (h * h);
    for (int i = 0; i < m->count[TS_S]; i++) {
        if (sim->laws.curve[i].piece[sim->state.piece[i]].kind > TS_STRAIGHT)
            continue; /* k acts where the law has come to its end */
        if (sim->io.values[m->at[TS_STIFFNESS] + i] * inverse_mass(sim, i) > limit) return 1;
    }
    return 0;
}

static double attempt(ts_sim *sim, double tau, double h)
{
    int n = padded(2 * sim->m.nq), stride = sim->m.stride, robust = too_stiff(sim, h);
    double a = 1.0 / (GAMMA[robust] * h), *U = sim->attempt.k;
    ts_damping_jacobian(sim, tau, sim->state.y);
    if (!ts_stage_factorise(sim, a)) return NAN;
    for (int i = 0; i < n; i++) U[i] = sim->start.f[i];
    ts_stage_solve(sim, a, U);
    add_stages(sim->state.y, A[robust], 1, U, stride, 1.0, n, sim->attempt.y);
    ts_project(&sim->m, sim->attempt.y); /* else it would see strings longer by the square of the step */
    if (sim->m.joint.nodes) ts_put_back(sim, tau + ALPHA * h, sim->attempt.y);
    ts_rhs(sim, tau + ALPHA * h, sim->attempt.y, sim->ahead.f);
    add_stages(sim->ahead.f, C[robust], 1, U, stride, 1.0 / h, n, U + stride);
    ts_stage_solve(sim, a, U + stride);
    add_stages(sim->state.y, M[robust], 2, U, stride, 1.0, n, sim->ahead.y);
    return 0.0;
}

/* Rows: q0, h q0', then what the cubic adds in theta^2 and theta^3. */
static void densify(ts_sim *sim, double tau, double h)
{
    int nq = sim->m.nq, stride = sim->m.stride;
    const double *q0 = sim->state.y, *v0 = q0 + nq, *q1 = sim->ahead.y, *v1 = q1 + nq;
    double *c1 = sim->ahead.dense + stride, *c2 = c1 + stride, *c3 = c2 + stride;
    (void)tau;
    for (int i = 0; i < nq; i++) {
        double dq = q1[i] - q0[i], start = h * v0[i], end = h * v1[i];
        c1[i] = start;
        c2[i] = 3.0 * dq - 2.0 * start - end;
        c3[i] = start + end - 2.0 * dq;
        c1[nq + i] = 2.0 * c2[i] / h; /* the velocity is its derivative */
        c2[nq + i] = 3.0 * c3[i] / h;
        c3[nq + i] = 0.0;
    }
}

static void interpolate(const ts_step_ahead *ahead, double theta, int first, int count, double *out)
{
    int stride = ahead->stride;
    const double *c = ahead->dense + first;
    for (int i = 0; i < count; i++)
        out[i] = c[i] + theta * (c[stride + i] + theta * (c[2 * stride + i] + theta * c[3 * stride + i]));
}

const ts_method ts_ros2 = {1.0, 1.0, 0.0, TS_FIXED_STEP | TS_IMPLICIT, 4, 4, attempt, densify, interpolate, NULL};
