/* Analytic Jacobian of the accelerations, Jq = da/dq and Jv = da/dq', as the blocks of the structure's graph.
 *
 * ts_rhs_jacobian() is exact.  ts_damping_jacobian() keeps of it what cannot make a linearly implicit step singular: springs
 * and tensions that pull back, dampers, the projector on both sides.  With the inertias as weights its blocks are symmetric
 * and not positive, so that a^2 I - a Jv - Jq has an inverse at every a. */
#include "motion/jacobian.h"
#include "invariants.h"
#include "laws/curve.h"
#include "laws/curves.h"
#include "linear/pattern.h"
#include "linear/pairs.h"
#include "model/data.h"
#include "motion/contact.h"
#include "motion/drives.h"
#include "motion/joints.h"
#include "motion/kinematics.h"
#include "motion/motion.h"

#include <string.h>

/* Derivatives of a string's tension by its length and by the length's rate. */
ALWAYS_INLINE double tension_slopes(const ts_sim *sim, int i, const int exact, double *by_rate)
{
    double slope = sim->on.k[i], k = sim->io.values[sim->m.at[TS_STIFFNESS] + i];
    *by_rate = sim->on.d[i];
    if (sim->m.string.curved[i])
        ts_curve_force(sim->laws.curve + i, sim->state.piece[i], sim->strings.elongation[i], k, &slope);
    if (sim->m.string.damped_count) {
        double of_law;
        ts_damping_law(&sim->laws, i, sim->strings.rate[i], &of_law);
        *by_rate += exact || of_law > 0.0 ? of_law : 0.0;
    }
    return slope;
}

/* Derivatives of the string force T s/xi by s (Kq) and by s' (Kv), and its explicit time derivative (ft), from what the last
 * ts_forces() left; returns the stiffness along the string. */
ALWAYS_INLINE double string_stiffness(const ts_sim *sim, double tau, int i, const int exact, double *Kq, double *Kv, double *ft,
                                      const int D)
{
    int lanes = sim->m.lanes;
    double over = sim->strings.per_length[i], damping, slope = tension_slopes(sim, i, exact, &damping), u[3], ud[3];
    double rest_rate = ts_rest_rate(&sim->rest, i, tau), rest_bend = sim->rest.bend[i] + sim->rest.jerk[i] * tau;
    double rate = sim->strings.rate[i] + (sim->m.drive.winder[i] >= 0 ? sim->rest.rate_now[i] : rest_rate);
    double density = (sim->strings.fs[i] + sim->strings.fd[i]) * over;
    for (int d = 0; d < D; d++) {
        u[d] = sim->strings.s[d * lanes + i] * over;
        ud[d] = damping * over * (sim->strings.sd[d * lanes + i] - rate * u[d]);
        ft[d] = -(slope * rest_rate + damping * rest_bend) * u[d];
    }
    if (!exact) {
        density = density > 0.0 ? density : 0.0;
        slope = slope > 0.0 ? slope : 0.0;
    }
    for (int r = 0; r < D; r++)
        for (int c = 0; c < D; c++) {
            Kq[r * D + c] = density * ((r == c) - u[r] * u[c]) + u[r] * (slope * u[c] + (exact ? ud[c] : 0.0));
            Kv[r * D + c] = damping * u[r] * u[c];
        }
    return slope;
}

/* Explicit time derivative of a line's force through moved nodes that it hangs on. */
ALWAYS_INLINE void moved_ends(const ts_model *m, const ts_bases *bases, int i, const double *Kq, const double *Kv, double *ft,
                              const int D)
{
    for (int end = 0; end < 2; end++) {
        int mover = m->drive.mover[m->string.node[2 * i + end]];
        if (mover < 0) continue;
        const double *v = bases->now + (3 * mover + 1) * D, *a = v + D;
        double sign = end ? 1.0 : -1.0;
        for (int r = 0; r < D; r++) ft[r] += sign * (dot(Kq + r * D, v, D) + dot(Kv + r * D, a, D));
    }
}

/* A string with an actuator: the tension depends on the length w that is wound in as on the string's own, and pulls w back. */
static void wind(ts_sim *sim, int i, double slope, const double *Kq, const double *Kv, const double *ft)
{
    const ts_model *m = &sim->m;
    const ts_term *t = m->string.term + 4 * i;
    int D = m->count[TS_D], lanes = m->lanes, motor = m->blocks - m->count[TS_A] + m->drive.winder[i];
    double u[3], inv = sim->inertia.inverse[motor], damping = 0.0;
    for (int d = 0; d < D; d++) u[d] = sim->strings.s[d * lanes + i] * sim->strings.per_length[i];
    for (int r = 0; r < D; r++) {
        sim->linear.ft[motor * D] -= inv * u[r] * ft[r];
        for (int c = 0; c < D; c++) damping += u[r] * Kv[r * D + c] * u[c];
    }
    sim->linear.Jq[m->block.own_place[motor]] -= inv * slope;
    sim->linear.Jv[m->block.own_place[motor]] -= inv * damping;
    for (int k = 0; k < m->string.term_count[i]; k++) {
        int row = ts_pattern_place(&sim->linear.pattern, motor, t[k].block),
            column = ts_pattern_place(&sim->linear.pattern, t[k].block, motor);
        TS_ASSERT(row >= 0 && column >= 0);
        double w = -t[k].kappa * inv, back = -t[k].kappa * sim->inertia.inverse[t[k].block];
        for (int d = 0; d < D; d++) {
            double alongq = 0.0, alongv = 0.0;
            for (int r = 0; r < D; r++) alongq += u[r] * Kq[r * D + d], alongv += u[r] * Kv[r * D + d];
            sim->linear.Jq[row + d] += w * alongq;
            sim->linear.Jv[row + d] += w * alongv;
            sim->linear.Jq[column + d * D] += back * slope * u[d];
            sim->linear.Jv[column + d * D] += back * damping * u[d];
        }
    }
}

/* A line's force on the blocks that it hangs on. */
ALWAYS_INLINE void add_line(ts_sim *sim, int i, const double *Kq, const double *Kv, const double *ft, const int D)
{
    const ts_model *m = &sim->m;
    const ts_term *t = m->string.term + 4 * i;
    const int32_t *place = m->string.term_place + 16 * i;
    for (int a = 0; a < m->string.term_count[i]; a++) {
        double wa = -t[a].kappa * sim->inertia.inverse[t[a].block];
        for (int d = 0; d < D; d++) sim->linear.ft[t[a].offset + d] += wa * ft[d];
        for (int b = 0; b < m->string.term_count[i]; b++) {
            double w = wa * t[b].kappa, *Aq = sim->linear.Jq + place[4 * a + b], *Av = sim->linear.Jv + place[4 * a + b];
            for (int e = 0; e < D * D; e++) {
                Aq[e] += w * Kq[e];
                Av[e] += w * Kv[e];
            }
        }
    }
}

/* --- routed strings ------------------------------------------------------------------------------------------------------
 *
 * The force on block a is -T g_a, g_a = d xi/d q_a the sum of kappa s/xi over the segments that hang on it, so that
 *     -d(T g_a)/d q_b = -g_a (T' g_b + d h_b) - (sum over segments of kappa_a kappa_b T (I - u u')/xi),   h_b = d xi'/d q_b. */

/* What a routed string's length is made of. */
typedef struct {
    double *g, *h;     /* (blocks, D) derivatives of its length by the blocks that it hangs on, and of the length's rate */
    double rate, bend; /* of its length through moved nodes alone: first derivative, and that of the rate */
} route_slopes;

/* One segment's part of g and h, and how it turns: T (I - u u')/xi is its Kq. */
ALWAYS_INLINE void add_segment(ts_sim *sim, int line, double tension, const int exact, route_slopes *sum, const int D)
{
    const ts_model *m = &sim->m;
    const int lanes = m->lanes;
    const double over = sim->strings.per_length[line], density = exact || tension > 0.0 ? tension * over : 0.0;
    double u[3], ud[3], Kq[9], Kv[9] = {0.0}, ft[3] = {0.0};
    for (int d = 0; d < D; d++) {
        u[d] = sim->strings.s[d * lanes + line] * over;
        ud[d] = over * (sim->strings.sd[d * lanes + line] - sim->strings.rate[line] * u[d]);
    }
    for (int r = 0; r < D; r++)
        for (int c = 0; c < D; c++) Kq[r * D + c] = density * ((r == c) - u[r] * u[c]);
    for (int end = 0; end < 2; end++) {
        const int mover = m->drive.mover[m->string.node[2 * line + end]];
        const double *v = sim->bases.now + (3 * mover + 1) * D, sign = end ? 1.0 : -1.0;
        if (mover < 0) continue;
        sum->rate += sign * dot(u, v, D);
        sum->bend += sign * (dot(ud, v, D) + dot(u, v + D, D));
    }
    if (m->count[TS_E]) moved_ends(m, &sim->bases, line, Kq, Kv, ft, D);
    add_line(sim, line, Kq, Kv, ft, D);
    for (int k = 4 * line; k < 4 * line + m->string.term_count[line]; k++)
        for (int d = 0; d < D; d++) {
            sum->g[m->string.term_block[k] * D + d] += m->string.term[k].kappa * u[d];
            sum->h[m->string.term_block[k] * D + d] += m->string.term[k].kappa * ud[d];
        }
}

/* An actuator that winds a routed string, as wind(). */
ALWAYS_INLINE void wind_route(ts_sim *sim, const ts_route *route, double slope, double damping, double by_time,
                              const route_slopes *sum, const int exact, const int D)
{
    const ts_model *m = &sim->m;
    const int motor = m->blocks - m->count[TS_A] + m->drive.winder[route->string];
    const double inverse = sim->inertia.inverse[motor];
    sim->linear.ft[motor * D] -= inverse * by_time;
    sim->linear.Jq[m->block.own_place[motor]] -= inverse * slope;
    sim->linear.Jv[m->block.own_place[motor]] -= inverse * damping;
    for (int a = 0; a < route->blocks; a++) {
        const int row = ts_pattern_place(&sim->linear.pattern, motor, route->block[a]),
                  column = ts_pattern_place(&sim->linear.pattern, route->block[a], motor);
        const double back = -sim->inertia.inverse[route->block[a]], *g = sum->g + a * D, *h = sum->h + a * D;
        TS_ASSERT(row >= 0 && column >= 0);
        for (int d = 0; d < D; d++) {
            sim->linear.Jq[row + d] -= inverse * (slope * g[d] + (exact ? damping * h[d] : 0.0));
            sim->linear.Jv[row + d] -= inverse * damping * g[d];
            sim->linear.Jq[column + d * D] += back * slope * g[d];
            sim->linear.Jv[column + d * D] += back * damping * g[d];
        }
    }
}

ALWAYS_INLINE void add_route(ts_sim *sim, double tau, const ts_route *route, const int exact, const int D)
{
    const ts_model *m = &sim->m;
    const int i = route->string, n = route->blocks;
    if (!sim->on.taut[i] || sim->state.clipped[i]) return;
    route_slopes sum = {sim->linear.slopes, sim->linear.slopes + n * D, 0.0, 0.0};
    double damping, slope = tension_slopes(sim, i, exact, &damping);
    memset(sum.g, 0, 2 * sizeof(double) * (size_t)(n * D));
    for (int k = route->first; k < route->first + route->count; k++)
        add_segment(sim, k, sim->strings.fs[i] + sim->strings.fd[i], exact, &sum, D);
    if (!exact) slope = slope > 0.0 ? slope : 0.0;
    const double bend = sim->rest.bend[i] + sim->rest.jerk[i] * tau;
    const double by_time = slope * (sum.rate - ts_rest_rate(&sim->rest, i, tau)) + damping * (sum.bend - bend);
    if (m->drive.winder[i] >= 0) wind_route(sim, route, slope, damping, by_time, &sum, exact, D);
    for (int a = 0; a < n; a++) {
        const double *ga = sum.g + a * D, w = -sim->inertia.inverse[route->block[a]];
        for (int d = 0; d < D; d++) sim->linear.ft[route->block[a] * D + d] += w * by_time * ga[d];
        for (int b = 0; b < n; b++) {
            const double *gb = sum.g + b * D, *hb = sum.h + b * D;
            double *Aq = sim->linear.Jq + route->place[a * n + b], *Av = sim->linear.Jv + route->place[a * n + b];
            for (int r = 0; r < D; r++)
                for (int c = 0; c < D; c++) {
                    Aq[r * D + c] += w * ga[r] * (slope * gb[c] + (exact ? damping * hb[c] : 0.0));
                    Av[r * D + c] += w * ga[r] * damping * gb[c];
                }
        }
    }
}

/* --- all strings --------------------------------------------------------------------------------------------------------- */

/* A routed string has no terms of its own: nothing is added for it here. */
ALWAYS_INLINE void add_strings(ts_sim *sim, double tau, const int exact, const int D)
{
    const ts_model *m = &sim->m;
    for (int i = 0; i < m->count[TS_S]; i++) {
        if (!sim->on.taut[i] || sim->state.clipped[i]) continue;
        double Kq[9], Kv[9], ft[3];
        double slope = string_stiffness(sim, tau, i, exact, Kq, Kv, ft, D);
        if (m->count[TS_E]) moved_ends(m, &sim->bases, i, Kq, Kv, ft, D);
        if (m->drive.winder[i] >= 0 && m->string.routed[i] < 0) wind(sim, i, slope, Kq, Kv, ft);
        add_line(sim, i, Kq, Kv, ft, D);
    }
    for (int r = 0; r < m->string.route_count; r++) add_route(sim, tau, m->string.route + r, exact, D);
}

/* A -= c (c' A)/|c|^2: P from the left. */
ALWAYS_INLINE void project_rows(double *A, const double *c, double over, const int D)
{
    for (int k = 0; k < D; k++) {
        double along = 0.0;
        for (int d = 0; d < D; d++) along += c[d] * A[d * D + k];
        for (int d = 0; d < D; d++) A[d * D + k] -= along * over * c[d];
    }
}

/* A -= (A c) c'/|c|^2: P from the right. */
ALWAYS_INLINE void project_columns(double *A, const double *c, double over, const int D)
{
    for (int d = 0; d < D; d++) {
        double along = over * dot(A + d * D, c, D);
        for (int k = 0; k < D; k++) A[d * D + k] -= along * c[k];
    }
}

/* Rows of a bar vector: P from the left, then the derivatives of P and of the centripetal term. */
ALWAYS_INLINE void turn_rows(ts_sim *sim, const double *c, const double *cd, const double *Q, int b, const int exact,
                             const int D)
{
    const ts_pattern *p = &sim->linear.pattern;
    double over = 1.0 / dot(c, c, D), w = sim->inertia.inverse[b], cQ = w * dot(c, Q, D), speed = dot(cd, cd, D),
           *ft = sim->linear.ft + b * D;
    for (int n = p->row[b]; n < p->row[b + 1]; n++) {
        project_rows(sim->linear.Jq + n * D * D, c, over, D);
        project_rows(sim->linear.Jv + n * D * D, c, over, D);
    }
    double along = dot(c, ft, D) * over;
    for (int d = 0; d < D; d++) ft[d] -= along * c[d];
    double *Aq = sim->linear.Jq + sim->m.block.own_place[b], *Av = sim->linear.Jv + sim->m.block.own_place[b];
    for (int r = 0; r < D && exact; r++)
        for (int k = 0; k < D; k++) {
            Aq[r * D + k] += over * (2.0 * (cQ + speed) * over * c[r] * c[k] - w * c[r] * Q[k] - (r == k) * (cQ + speed));
            Av[r * D + k] -= 2.0 * over * c[r] * cd[k];
        }
    for (int r = 0; r < D && !exact; r++) Aq[r * D + r] -= over * speed;
}

ALWAYS_INLINE void turn_columns(const ts_model *m, ts_linear *linear, const double *q, const int D)
{
    const ts_pattern *p = &linear->pattern;
    for (int i = 0; i < p->n; i++)
        for (int n = p->row[i]; n < p->row[i + 1]; n++) {
            int j = p->column[n];
            if (!m->block.turns[j]) continue;
            double over = 1.0 / dot(q + j * D, q + j * D, D);
            project_columns(linear->Jq + n * D * D, q + j * D, over, D);
            project_columns(linear->Jv + n * D * D, q + j * D, over, D);
        }
}

ALWAYS_INLINE void jacobian(ts_sim *sim, double tau, const double *y, const int exact, const int D)
{
    const ts_model *m = &sim->m;
    size_t size = sizeof(double) * (size_t)sim->linear.pattern.count * (size_t)(D * D);
    const double *q = y, *v = y + m->nq;
    ts_forces(sim, tau, y, sim->linear.work);
    memset(sim->linear.Jq, 0, size);
    memset(sim->linear.Jv, 0, size);
    memset(sim->linear.ft, 0, sizeof(double) * (size_t)m->nq);
    for (int i = 0; sim->loads.move && i < m->nq; i++)
        sim->linear.ft[i] = sim->inertia.inverse[i / D] * (sim->loads.rate[i] + tau * sim->loads.bend[i]);
    add_strings(sim, tau, exact, D);
    if (m->drive.any) ts_drive_jacobian(sim, tau);
    if (m->count[TS_K]) ts_contact_jacobian(sim, tau, exact);
    if (m->joint.nodes) ts_joint_jacobian(sim, tau, y, exact);
    for (int b = 0; b < m->blocks; b++)
        if (m->block.turns[b]) turn_rows(sim, q + b * D, v + b * D, sim->linear.work + b * D, b, exact, D);
    if (!exact) turn_columns(m, &sim->linear, q, D);
}

/* Jq, Jv and ft = da/dt, where they are not at hand. */
void ts_rhs_jacobian(ts_sim *sim, double tau, const double *y)
{
    if (sim->linear.ready) return;
    sim->linear.ready = 1;
    sim->memory.stats[TS_JACOBIANS]++;
    DISPATCH(&sim->m, jacobian, sim, tau, y, 1);
}

/* The part that damps. */
void ts_damping_jacobian(ts_sim *sim, double tau, const double *y)
{
    sim->memory.stats[TS_JACOBIANS]++;
    DISPATCH(&sim->m, jacobian, sim, tau, y, 0);
}
