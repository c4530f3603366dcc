/* Equations of motion, bar by bar.
 *
 * Bars of class-1 structures meet only through strings, so with the generalised force Q of a block
 *     centre of a free bar:   r'' = Q/m
 *     vector of a free bar:   b'' = (12/m) P Q - (|b'|^2/|b|^2) b,   Q = (f2 - f1)/2
 *     pinned bar:             c'' = (3/m) P Q - (|c'|^2/|c|^2) c,    Q = f_tip
 *     point mass on no bar: x'' = Q/m_p
 * with P = I - b b'/|b|^2; gravity acts as m g/2 at each end.  Point masses change the inertias and put r at the centre of
 * mass; they, drag, moved nodes and actuators stand in drives.c, the ground in contact.c.  |b|^2 rather than the nominal l^2 keeps the drift of the bar
 * lengths linear; ts_project() takes it out after every step.
 *
 * The state is y = [q, q', dissipated, input work, throughput].  External forces are mostly constant over a step; their work is
 * then a difference and not integrated (integrate.c).  Functions with a parameter D are compiled for D = 2 and D = 3, so that a
 * planar scene is computed in the plane, and those with a parameter `driven` also without what drives.c adds.  What concerns all
 * strings alike is worked out for two of them at a time. */
#include "motion/motion.h"
#include "invariants.h"
#include "laws/curve.h"
#include "laws/curves.h"
#include "linear/pairs.h"
#include "model/data.h"
#include "motion/bases.h"
#include "motion/contact.h"
#include "motion/drives.h"
#include "motion/joints.h"
#include "motion/kinematics.h"
#include "motion/pieces.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

/* Generalised force of the external forces, from inputs or from their derivatives. */
static void generalise(const ts_model *m, const double *inputs, double *Q)
{
    int D = m->count[TS_D];
    memset(Q, 0, sizeof(double) * (size_t)m->nq);
    for (int n = 0; n < m->count[TS_N]; n++) {
        int f = m->node.free_index[n];
        if (f < 0) continue;
        for (int d = 0; d < D; d++) {
            double force = external_force(m, inputs, f, d);
            if (m->node.centre[n] >= 0) Q[m->node.centre[n] * D + d] += force;
            Q[m->node.block[n] * D + d] += m->node.coef[n] * force;
        }
    }
}

/* Is one of the numbers not 0?  All bits but the signs, several numbers at a time. */
static int any(const double *x, int n)
{
    uint64_t found = 0, bits;
    for (int i = 0; i < n; i++) {
        memcpy(&bits, x + i, sizeof bits);
        found |= bits << 1;
    }
    return found != 0;
}

/* Does an input have a derivative beyond the rate of a rest length? */
int ts_sloped(const ts_model *m, const ts_io *io) { return any(io->slopes, 2 * m->n_inputs); }

static void prepare_forces(const ts_model *m, const ts_io *io, ts_loads *loads)
{
    int carried = 0, sloped = ts_sloped(m, io);
    for (int e = 0; e < m->count[TS_E]; e++) carried |= m->drive.mover_bar[e] >= 0;
    generalise(m, io->values, loads->Q);
    loads->move = 0;
    if (!sloped && !carried) return;
    generalise(m, io->slopes, loads->rate);
    generalise(m, io->slopes + m->n_inputs, loads->bend);
    loads->move = carried || any(loads->rate, m->nq) || any(loads->bend, m->nq);
}

static void prepare_rest_lengths(const ts_model *m, const ts_io *io, ts_rest *rest)
{
    const int length = m->at[TS_REST_LENGTH], rate = m->at[TS_REST_LENGTH_RATE];
    const double *values = io->values, *first = io->slopes, *second = first + m->n_inputs;
    int bends = 0, moves = 0;
    for (int i = 0; i < m->count[TS_S]; i++) {
        int wound = m->drive.winder[i] >= 0; /* the motor moves it */
        double speed = wound ? 0.0 : first[length + i] != 0.0 ? first[length + i] : values[rate + i];
        double bend = wound ? 0.0 : second[length + i] != 0.0 ? second[length + i] : first[rate + i];
        double jerk = wound ? 0.0 : second[rate + i];
        bends |= bend != 0.0 || jerk != 0.0;
        moves |= speed != 0.0;
        rest->length[i] = values[length + i];
        rest->rate[i] = speed;
        rest->bend[i] = bend;
        rest->jerk[i] = jerk;
    }
    rest->bends = bends;
    rest->moves = bends || moves;
}

/* External and gravity forces on the blocks and their inverse inertias at the step's start, and how inputs change. */
void ts_prepare(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D];
    ts_weigh(sim);
    prepare_forces(m, &sim->io, &sim->loads);
    memcpy(sim->loads.with_gravity, sim->loads.Q, sizeof(double) * (size_t)m->nq);
    for (int b = 0; b < m->blocks; b++)
        for (int d = 0; d < D; d++) sim->loads.with_gravity[b * D + d] += sim->inertia.laden[b] * sim->inertia.gravity[d];
    prepare_rest_lengths(m, &sim->io, &sim->rest);
    if (!m->drive.any) return;
    ts_drive(sim);
    ts_raise_ground(sim);
}

/* Rest length of a string at tau from the step's start (m). */
double ts_rest_length(const ts_rest *rest, int i, double tau)
{
    return rest->length[i] + (rest->rate[i] + (0.5 * rest->bend[i] + rest->jerk[i] * tau / 6.0) * tau) * tau;
}

/* Its rate (m/s). */
double ts_rest_rate(const ts_rest *rest, int i, double tau)
{
    return rest->rate[i] + (rest->bend[i] + 0.5 * rest->jerk[i] * tau) * tau;
}

ALWAYS_INLINE double elastic(const ts_sim *sim, int i, double elongation, double *slope)
{
    const ts_curve *c = sim->laws.curve + i;
    double k = sim->io.values[sim->m.at[TS_STIFFNESS] + i];
    return ts_curve_force(c, sim->state.piece[i], elongation, k, slope);
}

/* Tension of a string on its present piece, and its elastic part (N). */
double ts_tension(const ts_sim *sim, int i, double elongation, double rate, double *fs)
{
    double slope;
    *fs = elastic(sim, i, elongation, &slope);
    if (!sim->on.taut[i] || sim->state.clipped[i]) return 0.0;
    return *fs + sim->io.values[sim->m.at[TS_DAMPING] + i] * rate + ts_damping_law(&sim->laws, i, rate, &slope);
}

/* Node positions and velocities from the blocks, side by side. */
ALWAYS_INLINE void spread(const ts_model *m, const double *q, const double *v, double *x, const int driven, const int D)
{
    for (int i = 0; i < m->bar.pinned_count; i++) {
        const ts_place_of_bar *p = m->bar.pinned + i;
        const double *base = driven ? x + 2 * D * p->first : m->node.anchor + p->second * D;
        const double *c = q + p->block * D, *cd = v + p->block * D;
        double *tip = x + 2 * D * p->second;
        for (int d = 0; d < D; d++) {
            tip[d] = base[d] + c[d];
            tip[D + d] = driven ? base[D + d] + cd[d] : cd[d];
        }
    }
    for (int i = 0; i < m->bar.floating_count; i++) {
        const ts_place_of_bar *p = m->bar.floating + i;
        const double *r = q + p->block * D, *b = r + D, *rd = v + p->block * D, *bd = rd + D;
        const double lower = driven ? p->lower : 0.5, upper = driven ? p->upper : 0.5;
        double *first = x + 2 * D * p->first, *second = x + 2 * D * p->second;
        for (int d = 0; d < D; d++) {
            first[d] = r[d] - lower * b[d];
            first[D + d] = rd[d] - lower * bd[d];
            second[d] = r[d] + upper * b[d];
            second[D + d] = rd[d] + upper * bd[d];
        }
    }
    for (int i = 0; driven && i < m->node.lone_count; i++) {
        int n = m->node.lone[i], b = m->node.block[n] * D;
        for (int d = 0; d < D; d++) {
            x[2 * D * n + d] = q[b + d];
            x[2 * D * n + D + d] = v[b + d];
        }
    }
}

/* The same component of two strings' vectors, from their ends. */
ALWAYS_INLINE pair between(const double *a0, const double *b0, const double *a1, const double *b1, int d)
{
    return pair_subtract(pair_of(b0[d], b1[d]), pair_of(a0[d], a1[d]));
}

/* String vectors, elongations, rates, and the tensions where force curves are straight, for two strings at a time: numbers
 * stay in registers until they are complete, which the processor would otherwise wait for. */
ALWAYS_INLINE void elongate(const ts_model *m, const ts_bearing *on, ts_strings *found, double tau, const double *rest,
                            const double *rest_rates, const int D)
{
    const int lanes = m->lanes;
    const int32_t *ends = m->string.ends;
    const double *x = found->x;
    const pair least = pair_both(1e-150);
    for (int i = 0; i < lanes; i += 2) {
        const double *a0 = x + ends[2 * i], *b0 = x + ends[2 * i + 1], *a1 = x + ends[2 * i + 2], *b1 = x + ends[2 * i + 3];
        pair s[3], ss = pair_both(0.0), sv = ss;
        for (int d = 0; d < D; d++) {
            s[d] = between(a0, b0, a1, b1, d);
            pair sd = between(a0, b0, a1, b1, D + d);
            pair_store(found->s + d * lanes + i, s[d]);
            pair_store(found->sd + d * lanes + i, sd);
            ss = d ? pair_add_product(ss, s[d], s[d]) : pair_multiply(s[d], s[d]);
            sv = d ? pair_add_product(sv, s[d], sd) : pair_multiply(s[d], sd);
        }
        pair xi = pair_of(sqrt(pair_first(ss)), sqrt(pair_second(ss))), rest_rate = pair_load(rest_rates + i);
        pair per_length = pair_divide(pair_both(1.0), pair_larger(xi, least)),
             rate = pair_subtract(pair_multiply(sv, per_length), rest_rate);
        pair elongation = pair_subtract(xi, pair_add_product(pair_load(rest + i), rest_rate, pair_both(tau)));
        pair low = pair_load(found->lowest + i), high = pair_load(found->highest + i);
        pair_store(found->per_length + i, per_length);
        pair_store(found->elongation + i, elongation);
        pair_store(found->rate + i, rate);
        pair_store(found->fs + i, pair_multiply(pair_load(on->k + i), elongation));
        pair_store(found->fd + i, pair_multiply(pair_load(on->d + i), rate));
        pair_store(found->lowest + i, pair_smaller(low, elongation));
        pair_store(found->highest + i, pair_larger(high, elongation));
    }
}

/* Elastic tension of the strings whose force curve is not straight. */
static void curve_forces(ts_sim *sim)
{
    for (int n = 0; n < sim->m.string.curved_count; n++) {
        int i = sim->m.string.with_curve[n];
        double slope;
        if (sim->state.piece[i]) sim->strings.fs[i] = elastic(sim, i, sim->strings.elongation[i], &slope);
    }
}

/* Damping tension of the strings that have a law for it. */
static void damper_forces(const ts_model *m, const ts_laws *laws, const ts_bearing *on, ts_strings *found)
{
    for (int n = 0; n < m->string.damped_count; n++) {
        int i = m->string.with_damper[n];
        double slope;
        if (on->taut[i]) found->fd[i] += ts_damping_law(laws, i, found->rate[i], &slope);
    }
}

/* `tension_only`: a string whose damper outweighs its spring bears nothing. */
static void clip(const ts_sim *sim, ts_strings *found)
{
    for (int i = 0; i < sim->m.count[TS_S]; i++) {
        if (sim->on.taut[i] != TS_TAUT) continue;
        int clipped = sim->state.clipped[i];
        double T = found->fs[i] + found->fd[i], margin = clipped ? -T : T;
        if ((T < 0.0) != (clipped != 0)) found->sign_changed[i] = 1;
        if (margin < found->margin_low[i]) found->margin_low[i] = margin;
        if (margin > found->margin_high[i]) found->margin_high[i] = margin;
        if (clipped) found->fs[i] = found->fd[i] = 0.0;
    }
}

/* Analysis only: the law as one formula, without located transitions. */
static void place_by_elongation(ts_sim *sim)
{
    ts_strings *found = &sim->strings;
    for (int i = 0; i < sim->m.count[TS_S]; i++) {
        double lost = 0.0, slope, elongation = found->elongation[i], rate = found->rate[i];
        if (elongation < sim->on.lo[i] || elongation > sim->on.hi[i])
            ts_place(sim, i, ts_curve_walk(sim->laws.curve + i, sim->state.piece[i], elongation, 0.0, &lost));
        found->fs[i] = sim->on.k[i] * elongation;
        found->fd[i] = sim->on.d[i] * rate;
        if (sim->m.damping_law != TS_TENSION_ONLY || sim->on.taut[i] != TS_TAUT) continue;
        double f = elastic(sim, i, elongation, &slope) + ts_damping_law(&sim->laws, i, rate, &slope);
        sim->state.clipped[i] = f + found->fd[i] < 0.0;
    }
}

/* Routed strings bear what the lengths of all their segments give together. */
APART static void add_segments(const ts_sim *sim, ts_strings *found, double tau, const double *rest, const double *rest_rates)
{
    for (int r = 0; r < sim->m.string.route_count; r++) {
        const ts_route *route = sim->m.string.route + r;
        const int i = route->string;
        double length = 0.0, rate = 0.0;
        for (int k = route->first; k < route->first + route->count; k++) {
            length += found->elongation[k];
            rate += found->rate[k];
        }
        found->elongation[i] = length - (rest[i] + rest_rates[i] * tau);
        found->rate[i] = rate - rest_rates[i];
        found->fs[i] = sim->on.k[i] * found->elongation[i];
        found->fd[i] = sim->on.d[i] * found->rate[i];
        found->per_length[i] = 0.0; /* its segments pull, see pull() */
        found->lowest[i] = fmin(found->route_extremes[2 * r], found->elongation[i]);
        found->highest[i] = fmax(found->route_extremes[2 * r + 1], found->elongation[i]);
    }
}

/* What is worked out for all lines alike is nothing to a routed string: its extremes stay. */
APART static void keep_extremes(const ts_lines *lines, ts_strings *found)
{
    for (int r = 0; r < lines->route_count; r++) {
        found->route_extremes[2 * r] = found->lowest[lines->route[r].string];
        found->route_extremes[2 * r + 1] = found->highest[lines->route[r].string];
    }
}

/* Rest lengths and their rates at tau. */
static void bend_rest_lengths(int strings, double tau, ts_rest *rest)
{
    for (int i = 0; i < strings; i++) {
        rest->now[i] = ts_rest_length(rest, i, tau);
        rest->rate_now[i] = ts_rest_rate(rest, i, tau);
    }
}

/* Kinematics and tensions of all strings: s, s', 1/xi, elongation, rate, f_s, f_d. */
ALWAYS_INLINE void strings(ts_sim *sim, double tau, const double *q, const double *v, const int driven, const int D)
{
    const ts_model *m = &sim->m;
    ts_rest *rest = &sim->rest;
    sim->strings.evaluations++;
    if (driven) ts_move_bases(m, tau, &sim->bases, sim->strings.x);
    spread(m, q, v, sim->strings.x, driven, D);
    const int routed = driven && m->string.route_count;
    if (routed) keep_extremes(&m->string, &sim->strings);
    if (rest->bends || (driven && m->count[TS_A])) {
        bend_rest_lengths(m->count[TS_S], tau, rest);
        if (driven) ts_wind(m, q, rest);
        elongate(m, &sim->on, &sim->strings, 0.0, rest->now, rest->rate_now, D);
        if (routed) add_segments(sim, &sim->strings, 0.0, rest->now, rest->rate_now);
    } else {
        elongate(m, &sim->on, &sim->strings, tau, rest->length, rest->rate, D);
        if (routed) add_segments(sim, &sim->strings, tau, rest->length, rest->rate);
    }
    if (sim->call.unlocated) place_by_elongation(sim);
    if (m->string.curved_count) curve_forces(sim);
    if (m->string.damped_count) damper_forces(m, &sim->laws, &sim->on, &sim->strings);
    if (m->damping_law == TS_TENSION_ONLY) clip(sim, &sim->strings);
}

/* A routed string's tension acts along each of its segments. */
ALWAYS_INLINE void pull_along(const ts_model *m, const ts_strings *found, double *RESTRICT force, const int D)
{
    for (int r = 0; r < m->string.route_count; r++) {
        const ts_route *route = m->string.route + r;
        const double tension = found->fs[route->string] + found->fd[route->string];
        for (int k = route->first; k < route->first + route->count; k++) {
            double *a = force + m->string.node[2 * k] * D, *b = force + m->string.node[2 * k + 1] * D;
            for (int d = 0; d < D; d++) {
                double f = tension * found->per_length[k] * found->s[d * m->lanes + k];
                a[d] += f;
                b[d] -= f;
            }
        }
    }
}

/* Forces of the strings on the nodes. */
ALWAYS_INLINE void pull(const ts_model *m, const ts_strings *found, double *RESTRICT force, const int driven, const int D)
{
    const int lanes = m->lanes, count = m->count[TS_S], nodes = m->count[TS_N];
    const int32_t *ends = m->packed.strings;
    const double *fs = found->fs, *fd = found->fd, *over = found->per_length, *s = found->s;
    for (int i = 0; i < nodes * D; i++) force[i] = 0.0;
    for (int i = 0; i < count; i++) {
        const double density = (fs[i] + fd[i]) * over[i];
        double *a = force + ends[2 * i] * D, *b = force + ends[2 * i + 1] * D;
        for (int d = 0; d < D; d++) {
            double f = density * s[d * lanes + i];
            a[d] += f;
            b[d] -= f;
        }
    }
    if (driven) pull_along(m, found, force, D);
}

/* Power of external forces that move; that of constant ones is a difference, see integrate.c. */
static void external_power(const ts_model *m, const ts_loads *loads, const ts_bases *bases, double tau, const double *v,
                           double *p)
{
    int D = m->count[TS_D];
    for (int i = 0; i < m->nq; i++) book(p, load_at(loads, i, tau) * v[i]);
    for (int e = 0; e < m->count[TS_E]; e++) { /* on what a moved node carries along */
        int bar = m->drive.mover_bar[e];
        for (int d = 0; d < D && bar >= 0; d++)
            book(p, load_at(loads, m->bar.block[bar] * D + d, tau) * bases->now[(3 * e + 1) * D + d]);
    }
}

/* Rates of the ledger's integrals (W): dampers, rest lengths that move, external forces that move. */
ALWAYS_INLINE void ledger_rates(const ts_sim *sim, double tau, const double *v, double *p, const int driven)
{
    double lost[TS_LANES] = {0.0}, done[TS_LANES] = {0.0}, moved[TS_LANES] = {0.0};
    const double *fs = sim->strings.fs, *fd = sim->strings.fd, *rate = sim->strings.rate;
    const double *rest_rate = sim->rest.bends || (driven && sim->m.count[TS_A]) ? sim->rest.rate_now : sim->rest.rate;
    for (int i = 0; i < sim->m.lanes; i += TS_LANES)
        for (int l = 0; l < TS_LANES; l++) lost[l] += fd[i + l] * rate[i + l];
    if (sim->rest.moves)
        for (int i = 0; i < sim->m.lanes; i += TS_LANES)
            for (int l = 0; l < TS_LANES; l++) {
                double power = -(fs[i + l] + fd[i + l]) * rest_rate[i + l];
                done[l] += power;
                moved[l] += fabs(power);
            }
    p[0] = (lost[0] + lost[1]) + (lost[2] + lost[3]);
    p[1] = (done[0] + done[1]) + (done[2] + done[3]);
    p[2] = p[0] + ((moved[0] + moved[1]) + (moved[2] + moved[3]));
    if (sim->loads.move) external_power(&sim->m, &sim->loads, &sim->bases, tau, v, p);
}

static void move_forces(const ts_loads *loads, int nq, double tau, double *Q)
{
    for (int i = 0; i < nq; i++) Q[i] += (loads->rate[i] + 0.5 * loads->bend[i] * tau) * tau;
}

/* Generalised forces on the blocks. */
ALWAYS_INLINE void gather(const ts_sim *sim, double tau, const double *force, double *Q, const int driven, const int D)
{
    const ts_model *m = &sim->m;
    for (int i = 0; i < m->bar.pinned_count; i++) {
        const ts_place_of_bar *p = m->bar.pinned + i;
        for (int d = 0; d < D; d++) Q[p->block * D + d] = sim->loads.with_gravity[p->block * D + d] + force[p->second * D + d];
    }
    for (int i = 0; i < m->bar.floating_count; i++) {
        const ts_place_of_bar *p = m->bar.floating + i;
        const double *Qg = sim->loads.with_gravity + p->block * D, *f1 = force + p->first * D, *f2 = force + p->second * D;
        double *Qr = Q + p->block * D, *Qb = Qr + D;
        for (int d = 0; d < D; d++) {
            Qr[d] = Qg[d] + (f1[d] + f2[d]);
            Qb[d] = Qg[D + d] + (driven ? p->upper * f2[d] - p->lower * f1[d] : 0.5 * (f2[d] - f1[d]));
        }
    }
    for (int i = 0; driven && i < m->node.lone_count; i++) {
        int n = m->node.lone[i], b = m->node.block[n] * D;
        for (int d = 0; d < D; d++) Q[b + d] = sim->loads.with_gravity[b + d] + force[n * D + d];
    }
    if (sim->loads.move) move_forces(&sim->loads, m->nq, tau, Q);
    if (driven) ts_carry(m, &sim->inertia, &sim->bases, Q);
}

/* Accelerations of a bar vector c from its generalised force, in place. */
ALWAYS_INLINE void turn(double w, const double *c, const double *cd, double *Q, const int D)
{
    double along = (w * dot(c, Q, D) + dot(cd, cd, D)) / dot(c, c, D);
    for (int d = 0; d < D; d++) Q[d] = w * Q[d] - along * c[d];
}

ALWAYS_INLINE void rhs(ts_sim *sim, double tau, const double *y, double *dy, const int driven, const int D)
{
    const ts_model *m = &sim->m;
    int nq = m->nq;
    const double *q = y, *v = y + nq;
    double *a = dy + nq;
    strings(sim, tau, q, v, driven, D);
    pull(m, &sim->strings, sim->strings.node_force, driven, D);
    if (driven) ts_drag(sim, sim->strings.node_force);
    if (driven && m->count[TS_K]) ts_press(sim, tau, y, sim->strings.node_force);
    ledger_rates(sim, tau, v, dy + 2 * nq, driven);
    gather(sim, tau, sim->strings.node_force, a, driven, D);
    for (int i = 0; i < nq; i++) dy[i] = v[i];
    for (int i = 0; i < m->bar.pinned_count; i++) {
        int b = m->bar.pinned[i].block;
        turn(sim->inertia.inverse[b], q + b * D, v + b * D, a + b * D, D);
    }
    for (int i = 0; i < m->bar.floating_count; i++) {
        int r = m->bar.floating[i].block, b = r + 1;
        for (int d = 0; d < D; d++) a[r * D + d] *= sim->inertia.inverse[r];
        turn(sim->inertia.inverse[b], q + b * D, v + b * D, a + b * D, D);
    }
    if (!driven) return;
    for (int i = 0; i < m->node.lone_count; i++) {
        int b = m->node.block[m->node.lone[i]];
        for (int d = 0; d < D; d++) a[b * D + d] *= sim->inertia.inverse[b];
    }
    if (m->joint.nodes) ts_join(sim, tau, y, a);
    ts_motors(sim, tau, v, a);
    for (int i = m->nq - m->count[TS_A] * D; i < m->nq; i++) a[i] *= sim->inertia.inverse[i / D];
    ts_drive_rates(sim, tau, v, a, dy + 2 * nq);
    if (!m->count[TS_K]) return;
    ts_contact_rates(sim, dy + 2 * nq);
    ts_slip_rates(sim, tau, a);
}

APART static void driven_rhs(ts_sim *sim, double tau, const double *y, double *dy)
{
    DISPATCH(&sim->m, rhs, sim, tau, y, dy, 1);
}

void ts_rhs(ts_sim *sim, double tau, const double *y, double *dy)
{
    TS_ASSERT(sim->laws.ready && y != dy);
    sim->memory.stats[TS_RHS]++;
    if (sim->m.drive.any) {
        driven_rhs(sim, tau, y, dy);
        return;
    }
    DISPATCH(&sim->m, rhs, sim, tau, y, dy, 0);
}

ALWAYS_INLINE void places(ts_sim *sim, double tau, const double *y, const int driven, const int D)
{
    if (driven) ts_move_bases(&sim->m, tau, &sim->bases, sim->strings.x);
    spread(&sim->m, y, y + sim->m.nq, sim->strings.x, driven, D);
}

/* Of a right-hand side only where the nodes are and how fast. */
void ts_move_nodes(ts_sim *sim, double tau, const double *y)
{
    if (sim->m.drive.any) DISPATCH(&sim->m, places, sim, tau, y, 1);
    else DISPATCH(&sim->m, places, sim, tau, y, 0);
}

ALWAYS_INLINE void powers(ts_sim *sim, double tau, const double *y, double *p, const int D)
{
    strings(sim, tau, y, y + sim->m.nq, 0, D);
    ledger_rates(sim, tau, y + sim->m.nq, p, 0);
}

void ts_power(ts_sim *sim, double tau, const double *y, double p[TS_LEDGER])
{
    if (!sim->m.drive.any) {
        DISPATCH(&sim->m, powers, sim, tau, y, p);
        return;
    }
    driven_rhs(sim, tau, y, sim->linear.work); /* a moved node's power needs the accelerations */
    memcpy(p, sim->linear.work + 2 * sim->m.nq, TS_LEDGER * sizeof *p);
}

/* Strings' kinematics and tensions, and the generalised forces Q on the blocks: what the Jacobian starts from. */
ALWAYS_INLINE void forces(ts_sim *sim, double tau, const double *y, double *Q, const int driven, const int D)
{
    strings(sim, tau, y, y + sim->m.nq, driven, D);
    pull(&sim->m, &sim->strings, sim->strings.node_force, driven, D);
    if (driven) ts_drag(sim, sim->strings.node_force);
    if (driven && sim->m.count[TS_K]) ts_press(sim, tau, y, sim->strings.node_force);
    gather(sim, tau, sim->strings.node_force, Q, driven, D);
    if (driven) ts_motors(sim, tau, y + sim->m.nq, Q);
}

void ts_forces(ts_sim *sim, double tau, const double *y, double *Q)
{
    if (sim->m.drive.any) DISPATCH(&sim->m, forces, sim, tau, y, Q, 1);
    else DISPATCH(&sim->m, forces, sim, tau, y, Q, 0);
}

/* Length of a line and its rate. */
ALWAYS_INLINE double line_length(const ts_sim *sim, double tau, const double *y, int i, double *rate, const int driven,
                                 const int D)
{
    const ts_model *m = &sim->m;
    double s[3], sd[3];
    line_vector(m, y, y + m->nq, i, s, sd, D);
    for (int end = 0; driven && end < 2; end++) {
        double x[3], v[3], sign = end ? 1.0 : -1.0;
        int mover = m->drive.mover[m->string.node[2 * i + end]];
        if (mover < 0) continue;
        ts_base_at(&sim->bases, D, tau, mover, x, v);
        for (int d = 0; d < D; d++) s[d] += sign * x[d], sd[d] += sign * v[d];
    }
    double xi = sqrt(dot(s, s, D));
    *rate = xi > 0.0 ? dot(s, sd, D) / xi : 0.0;
    return xi;
}

/* Length of a string over all its segments, and its rate. */
ALWAYS_INLINE double string_length(const ts_sim *sim, double tau, const double *y, int i, double *rate, const int driven,
                                   const int D)
{
    if (!driven || sim->m.string.routed[i] < 0) return line_length(sim, tau, y, i, rate, driven, D);
    const ts_route *route = sim->m.string.route + sim->m.string.routed[i];
    double sum = 0.0, one;
    *rate = 0.0;
    for (int k = route->first; k < route->first + route->count; k++) {
        sum += line_length(sim, tau, y, k, &one, 1, D);
        *rate += one;
    }
    return sum;
}

ALWAYS_INLINE void string_state(const ts_sim *sim, double tau, const double *y, int i, double *elongation, double *rate,
                                const int driven, const int D)
{
    const ts_model *m = &sim->m;
    double speed, xi = string_length(sim, tau, y, i, &speed, driven, D);
    *elongation = xi - ts_rest_length(&sim->rest, i, tau);
    *rate = speed - ts_rest_rate(&sim->rest, i, tau);
    if (driven && m->drive.winder[i] >= 0) {
        *elongation += ts_wound(m, y, i);
        *rate += ts_wound(m, y + m->nq, i);
    }
}

APART static void driven_string_state(const ts_sim *sim, double tau, const double *y, int i, double *elongation, double *rate)
{
    DISPATCH(&sim->m, string_state, sim, tau, y, i, elongation, rate, 1);
}

/* Elongation of one string and its rate. */
void ts_string_state(const ts_sim *sim, double tau, const double *y, int i, double *elongation, double *rate)
{
    if (sim->m.drive.any) {
        driven_string_state(sim, tau, y, i, elongation, rate);
        return;
    }
    DISPATCH(&sim->m, string_state, sim, tau, y, i, elongation, rate, 0);
}

ALWAYS_INLINE void project(const ts_model *m, double *y, int block, const int D)
{
    double *c = y + block * D, *cd = y + m->nq + block * D, over = 1.0 / dot(c, c, D), along = dot(c, cd, D) * over;
    double length = m->block.length[block], factor = length * sqrt(over);
    for (int d = 0; d < D; d++) {
        cd[d] -= along * c[d];
        c[d] *= factor;
    }
    /* a vector whose square overflows becomes 0; its step is refused */
    TS_ASSERT(over == 0.0 || !(fabs(dot(c, c, D) - length * length) > 1e-12 * length * length));
}

ALWAYS_INLINE void project_all(const ts_model *m, double *y, const int D)
{
    for (int i = 0; i < m->bar.pinned_count; i++) project(m, y, m->bar.pinned[i].block, D);
    for (int i = 0; i < m->bar.floating_count; i++) project(m, y, m->bar.floating[i].block + 1, D);
    if (m->contact.directed) ts_project_directions(m, y);
}

/* Put a bar vector back on its length: b along itself, b' normal to b. */
void ts_project_block(const ts_model *m, double *y, int block)
{
    if (m->block.turns[block]) DISPATCH(m, project, m, y, block);
}

void ts_project(const ts_model *m, double *y) { DISPATCH(m, project_all, m, y); }

/* Eight sums that do not wait for each other. */
int ts_all_finite(const double *x, int n)
{
    double sum[8] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    int i = 0;
    for (; i + 8 <= n; i += 8)
        for (int l = 0; l < 8; l++) sum[l] += 0.0 * x[i + l];
    for (; i < n; i++) sum[0] += 0.0 * x[i];
    return ((sum[0] + sum[1]) + (sum[2] + sum[3])) + ((sum[4] + sum[5]) + (sum[6] + sum[7])) == 0.0;
}

/* Sum of the numbers' sizes. */
double ts_size(const double *x, int n)
{
    double sum[4] = {0.0, 0.0, 0.0, 0.0};
    int i = 0;
    for (; i + 4 <= n; i += 4)
        for (int l = 0; l < 4; l++) sum[l] += fabs(x[i + l]);
    for (; i < n; i++) sum[0] += fabs(x[i]);
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

/* Largest error of a block's position or velocity vector, in units of tolerance * (1 + |vector|), for two estimates at
 * once.  Norms of vectors, so that a rotated scene takes the same steps. */
ALWAYS_INLINE void error_norms(const ts_sim *sim, const double *e, const double *e2, const double *y0, const double *y1,
                               double *norm, double *norm2, const int D)
{
    double worst = 0.0, worst2 = 0.0, sum = 0.0;
    for (int b = 0; b < 2 * sim->m.blocks * D; b += D) {
        double n0 = dot(y0 + b, y0 + b, D), n1 = dot(y1 + b, y1 + b, D), scale = 1.0 + sqrt(n0 > n1 ? n0 : n1);
        double over = 1.0 / (scale * scale), ratio = dot(e + b, e + b, D) * over, ratio2 = dot(e2 + b, e2 + b, D) * over;
        sum += ratio + ratio2;
        worst = ratio > worst ? ratio : worst;
        worst2 = ratio2 > worst2 ? ratio2 : worst2;
    }
    double over = 1.0 / sim->io.values[sim->m.at[TS_TOLERANCE]];
    *norm = sum == sum ? sqrt(worst) * over : NAN;
    *norm2 = sum == sum ? sqrt(worst2) * over : NAN;
}

void ts_error_norms(const ts_sim *sim, const double *e, const double *e2, const double *y0, const double *y1, double *n,
                    double *n2)
{
    DISPATCH(&sim->m, error_norms, sim, e, e2, y0, y1, n, n2);
}

double ts_error_norm(const ts_sim *sim, const double *e, const double *y0, const double *y1)
{
    double norm, same;
    ts_error_norms(sim, e, e, y0, y1, &norm, &same);
    return norm;
}
