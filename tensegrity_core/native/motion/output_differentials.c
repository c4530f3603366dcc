/* First derivatives of the outputs: outputs.c and the ledger line by line, behind the rows of ts_differentiate_motion(); what strings
 * put out stands there. */
#include "motion/output_differentials.h"
#include "linear/chain.h"
#include "model/data.h"
#include "motion/kinematics.h"
#include "motion/outputs.h"

static int32_t value_at(const ts_differentials *o, int field, int i) { return o->at.values + o->sim->m.at[field] + i; }

static double value(const ts_differentials *o, int field, int i) { return o->sim->io.values[o->sim->m.at[field] + i]; }

static int32_t output_at(const ts_differentials *o, int field, int i)
{
    return o->at.outputs + o->sim->m.at[field] - o->sim->m.n_applied + i;
}

static int32_t reaction_at(const ts_differentials *o, int node, int d)
{
    return output_at(o, TS_REACTION, (-1 - o->sim->m.node.free_index[node]) * o->sim->m.count[TS_D] + d);
}

static void nodes(ts_differentials *o)
{
    const ts_model *m = &o->sim->m;
    const int D = m->count[TS_D];
    for (int n = 0; n < m->count[TS_N]; n++)
        for (int d = 0; d < D; d++) {
            chain_row(&o->chain, output_at(o, TS_POSITION, n * D + d));
            chain_add(&o->chain, o->at.x + 2 * n * D + d, 1.0);
            if (m->node.free_index[n] < 0) continue;
            chain_row(&o->chain, output_at(o, TS_VELOCITY, m->node.free_index[n] * D + d));
            chain_add(&o->chain, o->at.x + (2 * n + 1) * D + d, 1.0);
        }
}

static void motors(ts_differentials *o)
{
    const ts_model *m = &o->sim->m;
    ts_chain *c = &o->chain;
    for (int a = 0; a < m->count[TS_A]; a++) {
        const int at = (m->blocks - m->count[TS_A] + a) * m->count[TS_D];
        const double r = value(o, TS_DRUM_RADIUS, a);
        chain_row(c, output_at(o, TS_WOUND_REST_LENGTH, a));
        chain_add(c, value_at(o, TS_REST_LENGTH, m->packed.wound[a]), 1.0);
        chain_add(c, o->at.y + at, -1.0);
        chain_row(c, output_at(o, TS_WOUND_REST_LENGTH_RATE, a));
        chain_add(c, o->at.y + m->nq + at, -1.0);
        chain_row(c, output_at(o, TS_MOTOR_SPEED, a));
        chain_add(c, o->at.y + m->nq + at, 1.0 / r);
        if (o->start) chain_add(c, value_at(o, TS_DRUM_RADIUS, a), -o->sim->state.y[m->nq + at] / (r * r));
    }
}

/* --- forces -------------------------------------------------------------------------------------------------------------- */

/* Acceleration of a node along axis d. */
static double acceleration(const ts_differentials *o, int n, int d)
{
    const ts_model *m = &o->sim->m;
    const int D = m->count[TS_D];
    const double *a = o->sim->start.f + m->nq;
    double sum = m->drive.mover[n] < 0 ? 0.0 : o->sim->bases.now[(3 * m->drive.mover[n] + 2) * D + d];
    if (m->node.centre[n] >= 0) sum += a[m->node.centre[n] * D + d];
    if (m->node.block[n] >= 0) sum += m->node.coef[n] * a[m->node.block[n] * D + d];
    return sum;
}

/* Weight and inertia of a point mass. */
static void carry(ts_differentials *o, int n, int d)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int D = m->count[TS_D], centre = m->node.centre[n], block = m->node.block[n], mover = m->drive.mover[n];
    const double mass = sim->inertia.extra[n];
    chain_row(c, o->at.load + n * D + d);
    chain_add(c, o->at.gravity + d, mass);
    if (mover >= 0) chain_add(c, o->at.base + (3 * mover + 2) * D + d, -mass);
    if (centre >= 0) chain_add(c, o->at.dy + m->nq + centre * D + d, -mass);
    if (block >= 0) chain_add(c, o->at.dy + m->nq + block * D + d, -mass * m->node.coef[n]);
    if (!o->start) return;
    chain_add(c, o->at.extra + n, sim->inertia.gravity[d] - acceleration(o, n, d));
}

/* Both ends of a free bar move against its centre of mass. */
static void carry_off_centre(ts_differentials *o, int i)
{
    const ts_sim *sim = o->sim;
    const int D = sim->m.count[TS_D];
    const ts_place_of_bar *p = sim->m.bar.floating + i;
    for (int end = 0; end < 2; end++)
        for (int d = 0; d < D; d++) {
            const int n = end ? p->second : p->first;
            chain_row(&o->chain, o->at.load + n * D + d);
            chain_add(&o->chain, o->at.lower + i, sim->inertia.extra[n] * sim->start.f[sim->m.nq + (p->block + 1) * D + d]);
        }
}

/* Forces on the nodes with weights and what point masses need. */
static void loads(ts_differentials *o)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int D = m->count[TS_D];
    for (int i = 0; i < m->count[TS_N] * D; i++) {
        chain_row(c, o->at.load + i);
        chain_add(c, o->at.force + i, 1.0);
    }
    for (int i = 0; i < 2 * m->count[TS_B]; i++)
        for (int d = 0; d < D; d++) {
            chain_row(c, o->at.load + m->packed.bars[i] * D + d);
            chain_add(c, o->at.gravity + d, 0.5 * value(o, TS_BAR_MASS, i / 2));
            if (o->start) chain_add(c, value_at(o, TS_BAR_MASS, i / 2), 0.5 * sim->inertia.gravity[d]);
        }
    for (int i = 0; i < m->node.massed_count; i++)
        for (int d = 0; d < D; d++) carry(o, m->node.massed[i], d);
    for (int i = 0; o->start && m->node.massed_count && i < m->bar.floating_count; i++) carry_off_centre(o, i);
}

/* Of the ground on a bar that is pinned there, beside what the node takes. */
static void pin(ts_differentials *o, int bar, int d)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int D = m->count[TS_D], n = m->bar.base[bar], mover = m->drive.mover[n], a = m->nq + m->bar.block[bar] * D + d;
    const int tip = m->packed.bars[2 * bar] == n ? m->packed.bars[2 * bar + 1] : m->packed.bars[2 * bar];
    const double mass = value(o, TS_BAR_MASS, bar), at_base = mover < 0 ? 0.0 : sim->bases.now[(3 * mover + 2) * D + d];
    chain_row(c, reaction_at(o, n, d));
    chain_add(c, o->at.load + tip * D + d, -1.0);
    chain_add(c, o->at.dy + a, 0.5 * mass);
    if (mover >= 0) chain_add(c, o->at.base + (3 * mover + 2) * D + d, mass);
    if (o->start) chain_add(c, value_at(o, TS_BAR_MASS, bar), 0.5 * sim->start.f[a] + at_base);
}

static void reactions(ts_differentials *o)
{
    const ts_model *m = &o->sim->m;
    const int D = m->count[TS_D];
    for (int n = 0; n < m->count[TS_N]; n++)
        for (int d = 0; d < D && m->packed.fixed[n]; d++) {
            chain_row(&o->chain, reaction_at(o, n, d));
            chain_add(&o->chain, o->at.load + n * D + d, -1.0);
        }
    for (int i = 0; i < m->count[TS_B]; i++)
        for (int d = 0; d < D && m->bar.base[i] >= 0; d++) pin(o, i, d);
}

/* (m/12 |b'|^2 + b.(f_2 - f_1)/2)/l, the reaction being one of the forces. */
static void bar_force(ts_differentials *o, int i)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int D = m->count[TS_D], base = m->bar.base[i];
    const double over = 1.0 / m->bar.length[i], mass = value(o, TS_BAR_MASS, i), *force = sim->strings.node_force;
    double speed = 0.0;
    chain_row(c, output_at(o, TS_BAR_FORCE, i));
    for (int d = 0; d < D; d++) {
        const int first = m->packed.bars[2 * i], second = m->packed.bars[2 * i + 1], v = m->nq + m->bar.block[i] * D + d;
        const double b = 0.5 * over * (sim->strings.x[2 * second * D + d] - sim->strings.x[2 * first * D + d]);
        const double f = 0.5 * over * (force[second * D + d] - force[first * D + d]);
        chain_add(c, o->at.x + 2 * second * D + d, f), chain_add(c, o->at.x + 2 * first * D + d, -f);
        chain_add(c, o->at.load + second * D + d, b), chain_add(c, o->at.load + first * D + d, -b);
        chain_add(c, o->at.y + v, mass / 6.0 * sim->state.y[v] * over);
        if (base >= 0) chain_add(c, reaction_at(o, base, d), base == first ? -b : b);
        speed += sim->state.y[v] * sim->state.y[v];
    }
    if (o->start) chain_add(c, value_at(o, TS_BAR_MASS, i), speed * over / 12.0);
}

/* A utilisation: a force times per_force, which falls with the limit; flat where the force leaves the member unloaded. */
static void used(ts_differentials *o, int field, int i, int32_t force, int32_t limit, double per_force)
{
    const double part = value(o, field, i);
    chain_row(&o->chain, output_at(o, field, i));
    chain_add(&o->chain, force, part > 0.0 ? per_force : 0.0);
    if (o->start) chain_add(&o->chain, limit, -part / o->sim->io.values[limit - o->at.values]);
}

static void utilisation(ts_differentials *o)
{
    const ts_model *m = &o->sim->m;
    for (int i = 0; i < m->count[TS_C]; i++)
        used(o, TS_BAR_UTILISATION, i, output_at(o, TS_BAR_FORCE, m->packed.braced[i]), value_at(o, TS_BENDING_STIFFNESS, i),
             -1.0 / ts_buckling_load(o->sim, i));
    for (int i = 0; i < m->count[TS_T]; i++)
        used(o, TS_STRING_UTILISATION, i, output_at(o, TS_STRING_FORCE, m->packed.rated[i]), value_at(o, TS_STRENGTH, i),
             1.0 / value(o, TS_STRENGTH, i));
}

/* --- energies ------------------------------------------------------------------------------------------------------------ */

/* Of what a moved node carries: ts_kinetic_energy(). */
static void carried(ts_differentials *o, int e)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int D = m->count[TS_D], node = m->packed.moved[e], bar = m->drive.mover_bar[e];
    const double *v = sim->bases.now + (3 * e + 1) * D;
    const int block = bar < 0 ? 0 : m->bar.block[bar], first = m->packed.bars[2 * (bar < 0 ? 0 : bar)];
    const int tip = bar < 0 ? node : first == node ? m->packed.bars[2 * bar + 1] : first;
    double mass = sim->inertia.extra[node], square = 0.0, along = 0.0;
    if (bar >= 0) mass += value(o, TS_BAR_MASS, bar) + sim->inertia.extra[tip];
    for (int d = 0; d < D; d++) {
        const double speed = bar < 0 ? 0.0 : sim->state.y[m->nq + block * D + d],
                     laden = bar < 0 ? 0.0 : sim->inertia.laden[block];
        chain_add(c, o->at.base + (3 * e + 1) * D + d, mass * v[d] + laden * speed);
        if (bar >= 0) chain_add(c, o->at.y + m->nq + block * D + d, laden * v[d]);
        square += v[d] * v[d];
        along += v[d] * speed;
    }
    if (!o->start) return;
    chain_add(c, o->at.extra + node, 0.5 * square);
    if (bar < 0) return;
    chain_add(c, value_at(o, TS_BAR_MASS, bar), 0.5 * square);
    chain_add(c, o->at.extra + tip, 0.5 * square);
    chain_add(c, o->at.laden + block, along);
}

static void kinetic(ts_differentials *o)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int D = m->count[TS_D];
    chain_row(c, output_at(o, TS_KINETIC, 0));
    for (int b = 0; b < m->blocks; b++) {
        const double over = 1.0 / sim->inertia.inverse[b];
        double square = 0.0;
        for (int d = 0; d < D; d++) {
            const double v = sim->state.y[m->nq + b * D + d];
            chain_add(c, o->at.y + m->nq + b * D + d, v * over);
            square += v * v;
        }
        if (o->start) chain_add(c, o->at.inverse + b, -0.5 * square * over * over);
    }
    for (int e = 0; e < m->count[TS_E]; e++) carried(o, e);
}

/* A mass at a fixed node, along axis d: of a bar with its tip's, or of a point mass. */
static void grounded(ts_differentials *o, int n, double mass, int32_t one, int32_t other, int d, double *sum)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    const int D = m->count[TS_D], mover = m->drive.mover[n];
    const double g = sim->inertia.gravity[d], x = mover < 0 ? m->node.anchor[n * D + d] : sim->bases.now[3 * mover * D + d];
    if (mover >= 0) chain_add(&o->chain, o->at.base + 3 * mover * D + d, -g * mass);
    if (o->start) chain_add(&o->chain, one, -g * x);
    if (o->start && other >= 0) chain_add(&o->chain, other, -g * x);
    *sum += mass * x;
}

/* - g.(sum of m x). */
static void potential(ts_differentials *o)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int D = m->count[TS_D];
    const double *extra = sim->inertia.extra;
    chain_row(c, output_at(o, TS_POTENTIAL, 0));
    for (int d = 0; d < D; d++) {
        const double g = sim->inertia.gravity[d];
        double sum = 0.0;
        for (int b = 0; b < m->blocks; b++) {
            const double q = sim->state.y[b * D + d];
            chain_add(c, o->at.y + b * D + d, -g * sim->inertia.laden[b]);
            if (o->start) chain_add(c, o->at.laden + b, -g * q);
            sum += sim->inertia.laden[b] * q;
        }
        for (int i = 0; i < m->bar.pinned_count; i++) {
            const ts_place_of_bar *p = m->bar.pinned + i;
            const int bar = m->block.bar[p->block];
            grounded(o, p->first, value(o, TS_BAR_MASS, bar) + extra[p->second], value_at(o, TS_BAR_MASS, bar),
                     o->at.extra + p->second, d, &sum);
        }
        for (int i = 0; i < m->node.massed_count; i++) {
            const int n = m->node.massed[i];
            if (m->packed.fixed[n]) grounded(o, n, extra[n], o->at.extra + n, -1, d, &sum);
        }
        chain_add(c, o->at.gravity + d, -sum);
    }
}

/* --- powers -------------------------------------------------------------------------------------------------------------- */

static void lose(ts_differentials *o)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int D = m->count[TS_D];
    chain_row(c, o->at.dy + 2 * m->nq);
    for (int r = 0; r < m->count[TS_R]; r++) {
        const int at = (2 * m->packed.dragged[r] + 1) * D;
        double square = 0.0;
        for (int d = 0; d < D; d++) {
            chain_add(c, o->at.x + at + d, 2.0 * value(o, TS_DRAG, r) * sim->strings.x[at + d]);
            square += sim->strings.x[at + d] * sim->strings.x[at + d];
        }
        chain_add(c, value_at(o, TS_DRAG, r), square);
    }
    for (int a = 0; a < m->count[TS_A]; a++) {
        const int at = m->nq + (m->blocks - m->count[TS_A] + a) * D;
        const double r = value(o, TS_DRUM_RADIUS, a), loss = value(o, TS_MOTOR_DAMPING, a) / (r * r), speed = sim->state.y[at];
        chain_add(c, o->at.y + at, 2.0 * loss * speed);
        if (!o->start) continue;
        chain_add(c, value_at(o, TS_MOTOR_DAMPING, a), speed * speed / (r * r));
        chain_add(c, value_at(o, TS_DRUM_RADIUS, a), -2.0 * loss * speed * speed / r);
    }
}

/* Motors, k_a i w'/r less what the load takes. */
static void drive(ts_differentials *o, int a)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int at = m->nq + (m->blocks - m->count[TS_A] + a) * m->count[TS_D];
    const double r = value(o, TS_DRUM_RADIUS, a), per_current = value(o, TS_TORQUE_CONSTANT, a) / r;
    const double current = value(o, TS_CURRENT, a), speed = sim->state.y[at];
    chain_add(c, o->at.y + at, per_current * current - value(o, TS_DRUM_LOAD, a));
    chain_add(c, value_at(o, TS_CURRENT, a), per_current * speed);
    chain_add(c, value_at(o, TS_DRUM_LOAD, a), -speed);
    if (!o->start) return;
    chain_add(c, value_at(o, TS_TORQUE_CONSTANT, a), current / r * speed);
    chain_add(c, value_at(o, TS_DRUM_RADIUS, a), -per_current * current * speed / r);
}

/* External forces, motors, and movers, whose force on the structure is the reaction. */
static void put_in(ts_differentials *o)
{
    const ts_sim *sim = o->sim;
    const ts_model *m = &sim->m;
    ts_chain *c = &o->chain;
    const int D = m->count[TS_D];
    chain_row(c, o->at.dy + 2 * m->nq + 1);
    for (int n = 0; n < m->count[TS_N]; n++)
        for (int d = 0, f = m->node.free_index[n]; d < D && f >= 0; d++) {
            const int v = (2 * n + 1) * D + d;
            chain_add(c, value_at(o, TS_FORCE, f * D + d), sim->strings.x[v]);
            chain_add(c, o->at.x + v, external_force(m, sim->io.values, f, d));
        }
    for (int e = 0; e < m->count[TS_E]; e++)
        for (int d = 0; d < D; d++) {
            const int32_t reaction = reaction_at(o, m->packed.moved[e], d), v = (3 * e + 1) * D + d;
            chain_add(c, reaction, sim->bases.now[v]);
            chain_add(c, o->at.base + v, sim->io.values[reaction - o->at.outputs + m->n_applied]);
        }
    for (int a = 0; a < m->count[TS_A]; a++) drive(o, a);
}

/* Everything that is put out, and the rates of the ledger. */
void ts_differentiate_outputs(ts_differentials *o)
{
    const ts_model *m = &o->sim->m;
    nodes(o);
    motors(o);
    loads(o);
    reactions(o);
    for (int i = 0; i < m->count[TS_B]; i++) bar_force(o, i);
    utilisation(o);
    kinetic(o);
    potential(o);
    for (int i = 0; i < 2; i++) {
        chain_row(&o->chain, output_at(o, i ? TS_INPUT_WORK : TS_DISSIPATED, 0));
        chain_add(&o->chain, o->at.y + 2 * m->nq + i, 1.0);
    }
    lose(o);
    put_in(o);
}
