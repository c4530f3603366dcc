/* First derivatives of the motion: motion.c and drives.c line by line, each number's differential from those that it comes from.
 *
 * Differentiated on the pieces that the strings are on, at the start of a step, and where the last right-hand side,
 * ts_forces() into linear.work and ts_outputs() have just looked.  A row has a term for each number that it
 * comes from, whether or not its weight is zero now: which there are depends on the model alone. */
#include "motion/differentials.h"
#include "laws/beams.h"
#include "laws/curve.h"
#include "laws/curves.h"
#include "linear/chain.h"
#include "linear/pairs.h"
#include "model/data.h"

#include <math.h>

static int32_t value_at(const ts_differentials *o, int field, int i) { return o->at.values + o->sim->m.at[field] + i; }

static double value(const ts_differentials *o, int field, int i) { return o->sim->io.values[o->sim->m.at[field] + i]; }

/* Where the numbers stand. */
void ts_place_differentials(ts_differentials *o)
{
    const ts_model *m = &o->sim->m;
    const int32_t D = m->count[TS_D], N = m->count[TS_N], S = m->count[TS_S], L = m->string.count;
    ts_places *at = &o->at;
    int32_t n = 0;
#define PLACE(what, count) at->what = n, n += (count)
    PLACE(values, m->n_applied), PLACE(extra, N), PLACE(lower, m->bar.floating_count);
    PLACE(inverse, m->blocks), PLACE(laden, m->blocks);
    PLACE(base, m->count[TS_E] * 3 * D), PLACE(gravity, 3), PLACE(y, m->ny);
    PLACE(x, N * 2 * D), PLACE(s, L * 2 * D), PLACE(elongation, S), PLACE(rate, S), PLACE(elastic, S), PLACE(tension, S);
    PLACE(pull, L * D), PLACE(force, N * D), PLACE(Q, m->nq), PLACE(dy, m->ny), PLACE(load, N * D);
    PLACE(outputs, m->n_real - m->n_applied), PLACE(indicators, 3 * S);
#undef PLACE
    at->size = n;
}

/* --- masses, gravity, moved nodes ---------------------------------------------------------------------------------------- */

/* A free bar's centre of mass and inertias: lower = (m/2 + m_2)/(m + m_1 + m_2), about which the moment of inertia is stationary. */
static void weigh_floating(ts_differentials *o, int i)
{
    const ts_model *m = &o->sim->m;
    ts_chain *c = &o->chain;
    const ts_place_of_bar *p = m->bar.floating + i;
    const int r = p->block, b = r + 1;
    const double *inverse = o->sim->inertia.inverse, over = inverse[r], off = p->lower - 0.5,
                 per_inertia = -inverse[b] * inverse[b] / 12.0;
    const int32_t mass = value_at(o, TS_BAR_MASS, m->block.bar[r]), m1 = o->at.extra + p->first, m2 = o->at.extra + p->second;
    chain_row(c, o->at.lower + i);
    if (m->node.massed_count) {
        chain_add(c, mass, (0.5 - p->lower) * over);
        chain_add(c, m1, -p->lower * over);
        chain_add(c, m2, p->upper * over);
    }
    chain_row(c, o->at.laden + r);
    chain_add(c, mass, 1.0), chain_add(c, m1, 1.0), chain_add(c, m2, 1.0);
    chain_row(c, o->at.inverse + r);
    chain_add(c, o->at.laden + r, -over * over);
    chain_row(c, o->at.inverse + b);
    chain_add(c, mass, per_inertia * (1.0 + 12.0 * off * off));
    chain_add(c, m1, per_inertia * 12.0 * p->lower * p->lower);
    chain_add(c, m2, per_inertia * 12.0 * p->upper * p->upper);
}

/* Inertias and weights of the blocks: ts_weigh(). */
static void weigh(ts_differentials *o)
{
    const ts_model *m = &o->sim->m;
    const double *inverse = o->sim->inertia.inverse;
    ts_chain *c = &o->chain;
    for (int i = 0; i < m->count[TS_P]; i++) {
        chain_row(c, o->at.extra + m->packed.massed[i]);
        chain_add(c, value_at(o, TS_POINT_MASS, i), 1.0);
    }
    for (int i = 0; i < m->packed.shares; i++) {
        chain_row(c, o->at.extra + m->packed.sharing[2 * i + 1]);
        chain_add(c, value_at(o, TS_STRING_MASS, m->packed.sharing[2 * i]), m->packed.share[i]);
    }
    for (int i = 0; i < m->bar.floating_count; i++) weigh_floating(o, i);
    for (int i = 0; i < m->bar.pinned_count; i++) {
        const int b = m->bar.pinned[i].block;
        const int32_t mass = value_at(o, TS_BAR_MASS, m->block.bar[b]), tip = o->at.extra + m->bar.pinned[i].second;
        chain_row(c, o->at.inverse + b);
        chain_add(c, mass, -inverse[b] * inverse[b] / 3.0);
        chain_add(c, tip, -inverse[b] * inverse[b]);
        chain_row(c, o->at.laden + b);
        chain_add(c, mass, 0.5), chain_add(c, tip, 1.0);
    }
    for (int i = 0; i < m->node.lone_count; i++) {
        const int n = m->node.lone[i], b = m->node.block[n];
        chain_row(c, o->at.laden + b);
        chain_add(c, o->at.extra + n, 1.0);
        chain_row(c, o->at.inverse + b);
        chain_add(c, o->at.extra + n, -inverse[b] * inverse[b]);
    }
    for (int a = 0; a < m->count[TS_A]; a++) { /* r^2/J */
        const int b = m->blocks - m->count[TS_A] + a;
        chain_row(c, o->at.inverse + b);
        chain_add(c, value_at(o, TS_DRUM_RADIUS, a), 2.0 * inverse[b] / value(o, TS_DRUM_RADIUS, a));
        chain_add(c, value_at(o, TS_MOTOR_INERTIA, a), -inverse[b] / value(o, TS_MOTOR_INERTIA, a));
    }
}

static void gravity(ts_differentials *o)
{
    const ts_model *m = &o->sim->m;
    for (int d = 0; d < m->count[TS_D]; d++) {
        chain_row(&o->chain, o->at.gravity + d);
        if (m->count[TS_V] > 1) chain_add(&o->chain, value_at(o, TS_GRAVITY, d), 1.0);
        else if (d == m->z_axis) chain_add(&o->chain, value_at(o, TS_GRAVITY, 0), -1.0);
    }
}

/* Position, velocity and acceleration of moved nodes, unless a derivative of an input has taken their place. */
static void move(ts_differentials *o)
{
    const ts_model *m = &o->sim->m;
    const int D = m->count[TS_D], first[3] = {m->at[TS_NODE_POSITION], m->at[TS_NODE_VELOCITY], m->at[TS_NODE_ACCELERATION]};
    const double *slopes = o->sim->io.slopes, *bends = slopes + m->n_inputs;
    for (int i = 0; i < m->count[TS_E] * D; i++) {
        const int rates = slopes[first[0] + i] == 0.0, bent = bends[first[0] + i] != 0.0;
        const double counts[3] = {1.0, (double)rates, (double)(!bent && slopes[first[1] + i] == 0.0)};
        for (int order = 0; order < 3; order++) {
            chain_row(&o->chain, o->at.base + (3 * (i / D) + order) * D + i % D);
            chain_add(&o->chain, o->at.values + first[order] + i, counts[order]);
        }
    }
}

/* --- the start ----------------------------------------------------------------------------------------------------------- */

/* The impulse of a moved node that starts with another velocity than the scene's: ts_jump_bases(). */
static void start_moved(ts_differentials *o, int e)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    const int D = m->count[TS_D], bar = m->drive.mover_bar[e];
    if (bar < 0) return;
    const int b = m->bar.block[bar];
    const double *c = sim->state.y + b * D, *first = m->packed.velocity + m->packed.moved[e] * D,
                 *now = sim->bases.now + (3 * e + 1) * D;
    const double over = 1.0 / (m->block.length[b] * m->block.length[b]), laden = sim->inertia.laden[b],
                 inverse = sim->inertia.inverse[b];
    double along = 0.0;
    for (int d = 0; d < D; d++) along += c[d] * (now[d] - first[d]) * over;
    for (int d = 0; d < D; d++) {
        const double jump = now[d] - first[d] - along * c[d];
        chain_row(&o->chain, o->at.y + m->nq + b * D + d);
        for (int k = 0; k < D; k++)
            chain_add(&o->chain, o->at.base + (3 * e + 1) * D + k, -laden * inverse * ((d == k) - c[d] * c[k] * over));
        chain_add(&o->chain, o->at.laden + b, -inverse * jump);
        chain_add(&o->chain, o->at.inverse + b, -laden * jump);
    }
}

/* ts_initialize() has the nodes where the scene has them: centres of mass move with the masses. */
static void start(ts_differentials *o)
{
    const ts_model *m = &o->sim->m;
    const int D = m->count[TS_D];
    for (int i = 0; i < m->bar.floating_count; i++)
        for (int half = 0; half < 2; half++)
            for (int d = 0; d < D; d++) {
                const int at = half * m->nq + m->bar.floating[i].block * D + d;
                chain_row(&o->chain, o->at.y + at);
                chain_add(&o->chain, o->at.lower + i, m->y_start[at + D]);
            }
    for (int e = 0; e < m->count[TS_E]; e++) start_moved(o, e);
}

/* --- kinematics ---------------------------------------------------------------------------------------------------------- */

/* Position (half 0) or velocity (1) of a node along axis d: base or centre, and the block's coordinate. */
static void place_node(ts_differentials *o, int n, int half, int d)
{
    const ts_model *m = &o->sim->m;
    const int D = m->count[TS_D];
    const int32_t y = o->at.y + half * m->nq;
    chain_row(&o->chain, o->at.x + (2 * n + half) * D + d);
    if (m->drive.mover[n] >= 0) chain_add(&o->chain, o->at.base + (3 * m->drive.mover[n] + half) * D + d, 1.0);
    if (m->node.centre[n] >= 0) chain_add(&o->chain, y + m->node.centre[n] * D + d, 1.0);
    if (m->node.block[n] >= 0) chain_add(&o->chain, y + m->node.block[n] * D + d, m->node.coef[n]);
}

static void place_nodes(ts_differentials *o)
{
    const ts_model *m = &o->sim->m;
    const int D = m->count[TS_D];
    for (int n = 0; n < m->count[TS_N]; n++)
        for (int half = 0; half < 2; half++)
            for (int d = 0; d < D; d++) place_node(o, n, half, d);
    for (int i = 0; o->start && i < m->bar.floating_count; i++) { /* both ends move against the centre of mass */
        const ts_place_of_bar *p = m->bar.floating + i;
        for (int half = 0; half < 2; half++)
            for (int d = 0; d < D; d++) {
                const double b = o->sim->state.y[half * m->nq + (p->block + 1) * D + d];
                chain_row(&o->chain, o->at.x + (2 * p->first + half) * D + d);
                chain_add(&o->chain, o->at.lower + i, -b);
                chain_row(&o->chain, o->at.x + (2 * p->second + half) * D + d);
                chain_add(&o->chain, o->at.lower + i, -b);
            }
    }
}

/* The lines that a string runs along: itself, or its segments. */
typedef struct {
    int first, end;
} lines;

static lines lines_of(const ts_model *m, int i)
{
    if (m->string.routed[i] < 0) return MAKE(lines){i, i + 1};
    const ts_route *route = m->string.route + m->string.routed[i];
    return MAKE(lines){route->first, route->first + route->count};
}

/* Unit vector along a line. */
static void direction(const ts_sim *sim, int line, double u[3])
{
    for (int d = 0; d < sim->m.count[TS_D]; d++) u[d] = sim->strings.s[d * sim->m.lanes + line] * sim->strings.per_length[line];
}

/* The rows of a line's vector and of its rate. */
static void stretch(ts_differentials *o, int line)
{
    const ts_model *m = &o->sim->m;
    const int D = m->count[TS_D];
    const int32_t *ends = m->string.ends + 2 * line;
    for (int d = 0; d < 2 * D; d++) {
        chain_row(&o->chain, o->at.s + 2 * D * line + d);
        chain_add(&o->chain, o->at.x + ends[1] + d, 1.0);
        chain_add(&o->chain, o->at.x + ends[0] + d, -1.0);
    }
}

/* A line's length, in the row at hand. */
static void add_length(ts_differentials *o, int line)
{
    const int D = o->sim->m.count[TS_D];
    double u[3];
    direction(o->sim, line, u);
    for (int d = 0; d < D; d++) chain_add(&o->chain, o->at.s + 2 * D * line + d, u[d]);
}

/* And its rate. */
static void add_speed(ts_differentials *o, int line)
{
    const ts_sim *sim = o->sim;
    const int D = sim->m.count[TS_D], lanes = sim->m.lanes;
    const int32_t s = o->at.s + 2 * D * line;
    double u[3], speed = 0.0;
    direction(sim, line, u);
    for (int d = 0; d < D; d++) speed += u[d] * sim->strings.sd[d * lanes + line];
    for (int d = 0; d < D; d++) {
        chain_add(&o->chain, s + d, (sim->strings.sd[d * lanes + line] - speed * u[d]) * sim->strings.per_length[line]);
        chain_add(&o->chain, s + D + d, u[d]);
    }
}

/* xi = |s|, xi' = s.s'/xi, of a routed string the sums over its segments; less the rest length and its rate, and more by what a
 * motor has wound in. */
static void elongate(ts_differentials *o, int i)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const lines along = lines_of(m, i);
    const int D = m->count[TS_D], winder = m->drive.winder[i];
    const int32_t motor = o->at.y + (m->blocks - m->count[TS_A] + winder) * D;
    for (int k = along.first; k < along.end; k++) stretch(o, k);
    chain_row(c, o->at.elongation + i);
    for (int k = along.first; k < along.end; k++) add_length(o, k);
    chain_add(c, value_at(o, TS_REST_LENGTH, i), -1.0);
    if (winder >= 0) chain_add(c, motor, 1.0);
    chain_row(c, o->at.rate + i);
    for (int k = along.first; k < along.end; k++) add_speed(o, k);
    if (winder >= 0) chain_add(c, motor + m->nq, 1.0);
    else chain_add(c, value_at(o, TS_REST_LENGTH_RATE, i), -(sim->io.slopes[m->at[TS_REST_LENGTH] + i] == 0.0));
}

/* --- strings ------------------------------------------------------------------------------------------------------------- */

/* What a string bears and how that changes: by the elongation, by the stiffness, by the rate. */
typedef struct {
    double fs, slope, by_stiffness, stored_by_stiffness, damping;
    int acts; /* it is taut and not clipped */
} bearing;

static bearing bearing_of(const ts_differentials *o, int i)
{
    const ts_sim *sim = o->sim;
    bearing found = {0.0, 0.0, 0.0, 0.0, 0.0, 0};
    if (!o->chain.next || !sim->on.taut[i]) return found;
    const ts_curve *curve = sim->laws.curve + i;
    const ts_piece *p = curve->piece + sim->state.piece[i];
    const double e = sim->strings.elongation[i];
    found.fs = ts_curve_force(curve, sim->state.piece[i], e, value(o, TS_STIFFNESS, i), &found.slope);
    if (p->kind == TS_STRAIGHT) {
        found.by_stiffness = e - p->lo;
        found.stored_by_stiffness = 0.5 * (e - p->lo) * (e - p->lo);
    }
    ts_damping_law(&sim->laws, i, sim->strings.rate[i], &found.damping);
    found.damping += value(o, TS_DAMPING, i);
    found.acts = !sim->state.clipped[i];
    return found;
}

/* By the parameters of a string's beams, of which its force curve is compiled. */
static void bear_beams(ts_differentials *o, int i)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    const int first = m->string.beam_first[i], n = m->packed.beams[i], fields[3] = {TS_NSH_Q, TS_NSH_ZETA, TS_NSH_H};
    const double *values = sim->io.values;
    double force[3] = {0.0, 0.0, 0.0}, energy[3] = {0.0, 0.0, 0.0};
    const int taut = o->chain.next && sim->on.taut[i];
    const ts_piece *p = taut ? sim->laws.curve[i].piece + sim->state.piece[i] : NULL;
    const double e = sim->strings.elongation[i];
    ts_beams beams = {values + m->at[TS_NSH_Q] + first,
                      values + m->at[TS_NSH_ZETA] + first,
                      values + m->at[TS_NSH_H] + first,
                      n,
                      taut ? p->snapped : 0,
                      0.0,
                      value(o, TS_STIFFNESS, i),
                      taut && p->kind == TS_STRAIGHT ? e - p->lo : -1.0,
                      -1,
                      0.0,
                      0.0,
                      0.0,
                      0.0};
    if (taut) {
        beams.tension = ts_curve_force(sim->laws.curve + i, sim->state.piece[i], e, beams.stiffness, force);
        force[0] = 0.0;
        ts_beams_prepare(&beams, e);
    }
    for (int j = 0; j < n; j++) {
        if (taut) ts_beams_differentiate(&beams, j, force, energy);
        for (int k = 0; k < 3; k++) {
            chain_row(&o->chain, o->at.elastic + i);
            chain_add(&o->chain, value_at(o, fields[k], first + j), force[k]);
            chain_row(&o->chain, o->at.outputs - m->n_applied + m->at[TS_ELASTIC]);
            chain_add(&o->chain, value_at(o, fields[k], first + j), energy[k]);
        }
    }
}

/* The string's force along a line, T u. */
static void pull(ts_differentials *o, int i, int line)
{
    const ts_sim *sim = o->sim;
    const int D = sim->m.count[TS_D];
    const double density = (sim->strings.fs[i] + sim->strings.fd[i]) * sim->strings.per_length[line];
    double u[3];
    direction(sim, line, u);
    for (int d = 0; d < D; d++) {
        chain_row(&o->chain, o->at.pull + D * line + d);
        chain_add(&o->chain, o->at.tension + i, u[d]);
        for (int k = 0; k < D; k++) chain_add(&o->chain, o->at.s + 2 * D * line + k, density * ((d == k) - u[d] * u[k]));
    }
}

static void bear(ts_differentials *o, int i, const bearing *b)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const lines along = lines_of(m, i);
    const int32_t outputs = o->at.outputs - m->n_applied;
    chain_row(c, o->at.elastic + i);
    chain_add(c, o->at.elongation + i, b->slope);
    chain_add(c, value_at(o, TS_STIFFNESS, i), b->by_stiffness);
    if (o->start && m->packed.beams[i] && m->packed.beam_law[i] == 0) bear_beams(o, i);
    chain_row(c, o->at.tension + i);
    chain_add(c, o->at.elastic + i, b->acts);
    chain_add(c, o->at.rate + i, b->acts ? b->damping : 0.0);
    chain_add(c, value_at(o, TS_DAMPING, i), b->acts ? sim->strings.rate[i] : 0.0);
    for (int k = along.first; k < along.end; k++) pull(o, i, k);
    chain_row(c, outputs + m->at[TS_STRING_FORCE] + i);
    chain_add(c, o->at.tension + i, 1.0);
    chain_row(c, outputs + m->at[TS_ELASTIC_FORCE] + i);
    chain_add(c, o->at.elastic + i, 1.0);
    chain_row(c, outputs + m->at[TS_STRING_LENGTH] + i);
    for (int k = along.first; k < along.end; k++) add_length(o, k);
    chain_row(c, outputs + m->at[TS_ELASTIC]);
    chain_add(c, o->at.elongation + i, b->fs);
    chain_add(c, value_at(o, TS_STIFFNESS, i), b->stored_by_stiffness);
}

/* What its damper takes, of a clipped string what its spring gives; and the work of the rest length. */
static void spend(ts_differentials *o, int i, const bearing *b)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const double rate = sim->strings.rate[i];
    const int clipped = sim->state.clipped[i];
    chain_row(c, o->at.dy + 2 * m->nq);
    chain_add(c, o->at.rate + i, clipped ? -b->fs : b->acts ? sim->strings.fd[i] + b->damping * rate : 0.0);
    chain_add(c, value_at(o, TS_DAMPING, i), b->acts ? rate * rate : 0.0);
    if (m->damping_law == TS_TENSION_ONLY) chain_add(c, o->at.elastic + i, clipped ? -rate : 0.0);
    if (m->drive.winder[i] >= 0) return;
    const int given = sim->io.slopes[m->at[TS_REST_LENGTH] + i] == 0.0;
    chain_row(c, o->at.dy + 2 * m->nq + 1);
    chain_add(c, o->at.tension + i, -sim->rest.rate[i]);
    chain_add(c, value_at(o, TS_REST_LENGTH_RATE, i), given ? -(sim->strings.fs[i] + sim->strings.fd[i]) : 0.0);
}

/* To the ends of the piece, which stay where they are, and under `tension_only` to being clipped or released. */
static void watch(ts_differentials *o, int i, const bearing *b)
{
    const ts_sim *sim = o->sim;
    ts_chain *c = &o->chain;
    const int clips = sim->m.damping_law == TS_TENSION_ONLY; /* every string has an indicator for it */
    const int32_t z = o->at.indicators + (clips ? 3 : 2) * i;
    chain_row(c, z);
    chain_add(c, o->at.elongation + i, sim->on.lo[i] > -INFINITY);
    chain_row(c, z + 1);
    chain_add(c, o->at.elongation + i, -(sim->on.hi[i] < INFINITY));
    if (!clips) return;
    const double sign = sim->on.taut[i] != TS_TAUT ? 0.0 : sim->state.clipped[i] ? -1.0 : 1.0;
    chain_row(c, z + 2);
    chain_add(c, o->at.elastic + i, sign);
    chain_add(c, o->at.rate + i, sign * b->damping);
    chain_add(c, value_at(o, TS_DAMPING, i), sign * sim->strings.rate[i]);
}

/* --- forces and accelerations -------------------------------------------------------------------------------------------- */

/* Forces on the nodes: strings, drag, and on free nodes the inputs. */
static void load_nodes(ts_differentials *o)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int D = m->count[TS_D];
    for (int i = 0; i < m->string.count; i++)
        for (int end = 0; end < 2 && (i >= m->count[TS_S] || m->string.routed[i] < 0); end++)
            for (int d = 0; d < D; d++) {
                chain_row(c, o->at.force + m->string.node[2 * i + end] * D + d);
                chain_add(c, o->at.pull + D * i + d, end ? -1.0 : 1.0);
            }
    for (int r = 0; r < m->count[TS_R]; r++)
        for (int d = 0; d < D; d++) {
            const int n = m->packed.dragged[r], v = (2 * n + 1) * D + d;
            chain_row(c, o->at.force + n * D + d);
            chain_add(c, o->at.x + v, -value(o, TS_DRAG, r));
            chain_add(c, value_at(o, TS_DRAG, r), -sim->strings.x[v]);
        }
    for (int n = 0; n < m->count[TS_N]; n++)
        for (int d = 0; d < D && m->node.free_index[n] >= 0; d++) {
            chain_row(c, o->at.force + n * D + d);
            chain_add(c, value_at(o, TS_FORCE, m->node.free_index[n] * D + d), 1.0);
        }
}

/* Weight of a block, less what its base's acceleration takes. */
static void weight(ts_differentials *o, int block, int mover, int d)
{
    const ts_sim *sim = o->sim;
    const int D = sim->m.count[TS_D];
    const int32_t base = o->at.base + (3 * mover + 2) * D + d;
    const double at_base = mover < 0 ? 0.0 : sim->bases.now[(3 * mover + 2) * D + d];
    chain_add(&o->chain, o->at.gravity + d, sim->inertia.laden[block]);
    if (mover >= 0) chain_add(&o->chain, base, -sim->inertia.laden[block]);
    if (o->start) chain_add(&o->chain, o->at.laden + block, sim->inertia.gravity[d] - at_base);
}

/* Generalised forces of the blocks: gather(). */
static void gather(ts_differentials *o)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int D = m->count[TS_D];
    for (int n = 0; n < m->count[TS_N]; n++)
        for (int d = 0; d < D && m->node.block[n] >= 0; d++) {
            const int32_t force = o->at.force + n * D + d;
            chain_row(c, o->at.Q + m->node.block[n] * D + d);
            chain_add(c, force, m->node.coef[n]);
            if (m->node.centre[n] < 0) {
                weight(o, m->node.block[n], m->drive.mover[n], d);
                continue;
            }
            chain_row(c, o->at.Q + m->node.centre[n] * D + d);
            chain_add(c, force, 1.0);
        }
    for (int i = 0; i < m->bar.floating_count; i++) {
        const ts_place_of_bar *p = m->bar.floating + i;
        for (int d = 0; d < D; d++) {
            chain_row(c, o->at.Q + p->block * D + d);
            weight(o, p->block, -1, d);
            if (!o->start) continue;
            chain_row(c, o->at.Q + (p->block + 1) * D + d); /* upper f_2 - lower f_1 */
            chain_add(c, o->at.lower + i, sim->inertia.laden[p->block] * sim->inertia.gravity[d] - o->Q[p->block * D + d]);
        }
    }
}

/* A bar vector: c'' = w Q - c (w c.Q + c'.c')/c.c. */
static void turn(ts_differentials *o, int block)
{
    const ts_sim *sim = o->sim;
    const int D = sim->m.count[TS_D], nq = sim->m.nq;
    ts_chain *chain = &o->chain;
    const double *c = sim->state.y + block * D, *cd = c + nq, *Q = o->Q + block * D, w = sim->inertia.inverse[block];
    const int32_t y = o->at.y + block * D;
    double cc = 0.0, cQ = 0.0, speed = 0.0;
    for (int d = 0; d < D; d++) cc += c[d] * c[d], cQ += c[d] * Q[d], speed += cd[d] * cd[d];
    const double over = 1.0 / cc, along = (w * cQ + speed) * over;
    for (int d = 0; d < D; d++) {
        chain_row(chain, o->at.dy + nq + block * D + d);
        for (int k = 0; k < D; k++) {
            chain_add(chain, o->at.Q + block * D + k, w * ((d == k) - c[d] * c[k] * over));
            chain_add(chain, y + k, -(d == k) * along - c[d] * (w * Q[k] - 2.0 * along * c[k]) * over);
            chain_add(chain, y + nq + k, -2.0 * c[d] * cd[k] * over);
        }
        if (o->start) chain_add(chain, o->at.inverse + block, Q[d] - cQ * over * c[d]);
    }
}

/* (J_a/r^2) w'' = (k_a/r) i - load - T - (d_a/r^2) w'. */
static void wind(ts_differentials *o, int a)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int at = (m->blocks - m->count[TS_A] + a) * m->count[TS_D];
    const double w = sim->inertia.inverse[m->blocks - m->count[TS_A] + a], r = value(o, TS_DRUM_RADIUS, a);
    const double per_current = value(o, TS_TORQUE_CONSTANT, a) / r, loss = value(o, TS_MOTOR_DAMPING, a) / (r * r);
    const double current = value(o, TS_CURRENT, a), speed = sim->state.y[m->nq + at];
    chain_row(c, o->at.Q + at);
    chain_add(c, value_at(o, TS_CURRENT, a), per_current);
    chain_add(c, value_at(o, TS_DRUM_LOAD, a), -1.0);
    chain_add(c, o->at.tension + m->packed.wound[a], -1.0);
    chain_add(c, o->at.y + m->nq + at, -loss);
    if (o->start) {
        chain_add(c, value_at(o, TS_TORQUE_CONSTANT, a), current / r);
        chain_add(c, value_at(o, TS_MOTOR_DAMPING, a), -speed / (r * r));
        chain_add(c, value_at(o, TS_DRUM_RADIUS, a), (2.0 * loss * speed - per_current * current) / r);
    }
    chain_row(c, o->at.dy + m->nq + at);
    chain_add(c, o->at.Q + at, w);
    if (o->start) chain_add(c, o->at.inverse + at / m->count[TS_D], o->Q[at]);
}

static void accelerate(ts_differentials *o)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int D = m->count[TS_D];
    for (int i = 0; i < (m->blocks - m->count[TS_A]) * D; i++) {
        chain_row(c, o->at.dy + i);
        chain_add(c, o->at.y + m->nq + i, 1.0);
        if (m->block.turns[i / D]) continue;
        chain_row(c, o->at.dy + m->nq + i);
        chain_add(c, o->at.Q + i, sim->inertia.inverse[i / D]);
        if (o->start) chain_add(c, o->at.inverse + i / D, o->Q[i]);
    }
    for (int b = 0; b < m->blocks; b++)
        if (m->block.turns[b]) turn(o, b);
    for (int a = 0; a < m->count[TS_A]; a++) {
        const int at = (m->blocks - m->count[TS_A] + a) * D;
        chain_row(c, o->at.dy + at);
        chain_add(c, o->at.y + m->nq + at, 1.0);
        wind(o, a);
    }
}

/* From inputs, parameters and states to forces, accelerations and what strings give and take. */
void ts_differentiate_motion(ts_differentials *o)
{
    const int S = o->sim->m.count[TS_S];
    if (o->start) weigh(o);
    gravity(o);
    move(o);
    if (o->start) start(o);
    place_nodes(o);
    for (int i = 0; i < S; i++) {
        elongate(o, i);
        const bearing b = bearing_of(o, i);
        bear(o, i, &b);
        spend(o, i, &b);
        watch(o, i, &b);
    }
    load_nodes(o);
    gather(o);
    accelerate(o);
}
