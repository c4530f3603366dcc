/* Outputs from the state at the end of a step.  As in motion.c, what is called at every communication point is compiled for
 * D = 2 and D = 3. */
#include "motion/outputs.h"
#include "laws/curve.h"
#include "linear/pairs.h"
#include "model/data.h"
#include "motion/contact.h"
#include "motion/drives.h"
#include "motion/joints.h"
#include "motion/kinematics.h"
#include "motion/motion.h"

#include <math.h>
#include <string.h>

/* Where a fixed node is, moved ones as the last evaluation had them. */
static const double *fixed_at(const ts_model *m, const ts_bases *bases, int node)
{
    int mover = m->drive.mover[node], D = m->count[TS_D];
    return mover < 0 ? m->node.anchor + node * D : bases->now + 3 * mover * D;
}

/* The axes along which gravity acts: first and end. */
typedef struct {
    int first, end;
} axes;

static axes of_gravity(const ts_model *m)
{
    if (m->count[TS_V] > 1) return MAKE(axes){0, m->count[TS_D]};
    return m->z_axis < 0 ? MAKE(axes){0, 0} : MAKE(axes){m->z_axis, m->z_axis + 1};
}

/* Gravitational energy (J): of bars with their point masses, each as one mass, and of the fixed nodes'. */
static double potential(const ts_sim *sim)
{
    const ts_model *m = &sim->m;
    const axes falls = of_gravity(m);
    int D = m->count[TS_D];
    double energy = 0.0;
    for (int d = falls.first; d < falls.end; d++) {
        double sum = 0.0;
        for (int b = 0; b < m->blocks; b++) sum += sim->inertia.laden[b] * sim->state.y[b * D + d];
        for (int i = 0; i < m->bar.pinned_count; i++) {
            int bar = m->block.bar[m->bar.pinned[i].block];
            double mass = sim->io.values[m->at[TS_BAR_MASS] + bar] + sim->inertia.extra[m->bar.pinned[i].second];
            sum += mass * fixed_at(m, &sim->bases, m->bar.pinned[i].first)[d];
        }
        for (int i = 0; i < m->node.massed_count; i++)
            if (m->packed.fixed[m->node.massed[i]])
                sum += sim->inertia.extra[m->node.massed[i]] * fixed_at(m, &sim->bases, m->node.massed[i])[d];
        if (m->joint.nodes) sum += ts_joint_weight(sim, d);
        energy -= sim->inertia.gravity[d] * sum;
    }
    return energy;
}

static double energy_of_string(const ts_sim *sim, int i, double elongation)
{
    return ts_curve_energy(sim->laws.curve + i, sim->state.piece[i], elongation, sim->io.values[sim->m.at[TS_STIFFNESS] + i]);
}

/* Energy stored in clipped strings and in bristles that slip (J): what becomes of it is booked by differences. */
double ts_clipped_energy(const ts_sim *sim, double tau)
{
    const ts_model *m = &sim->m;
    double sum = 0.0, elongation, rate;
    for (int i = 0; m->damping_law == TS_TENSION_ONLY && i < m->count[TS_S]; i++) {
        if (!sim->state.clipped[i]) continue;
        ts_string_state(sim, tau, sim->state.y, i, &elongation, &rate);
        sum += energy_of_string(sim, i, elongation);
    }
    return m->count[TS_K] ? sum + ts_contact_energy(sim, tau, 1) : sum;
}

/* Potential and elastic energy at the present state, under inputs and parameters that may be new (J). */
double ts_stored_energy(const ts_sim *sim, double tau)
{
    double sum = potential(sim), elongation, rate;
    for (int i = 0; i < sim->m.count[TS_S]; i++) {
        ts_string_state(sim, tau, sim->state.y, i, &elongation, &rate);
        sum += energy_of_string(sim, i, elongation);
    }
    return sim->m.count[TS_K] ? sum + ts_contact_energy(sim, tau, 0) : sum;
}

/* What moved nodes add to the kinetic energy: their own masses, and what the bars pinned there have of their velocity. */
static double carried_energy(const ts_sim *sim)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D];
    double sum = 0.0;
    for (int e = 0; e < m->count[TS_E]; e++) {
        const double *v = sim->bases.now + (3 * e + 1) * D;
        if (!m->packed.fixed[m->packed.moved[e]]) continue;
        double mass = sim->inertia.extra[m->packed.moved[e]], along = 0.0, square = 0.0;
        int bar = m->drive.mover_bar[e];
        for (int d = 0; d < D; d++) square += v[d] * v[d];
        if (bar >= 0) {
            int block = m->bar.block[bar],
                tip = m->packed.bars[2 * bar] == m->packed.moved[e] ? m->packed.bars[2 * bar + 1] : m->packed.bars[2 * bar];
            for (int d = 0; d < D; d++) along += v[d] * sim->state.y[m->nq + block * D + d];
            mass += sim->io.values[m->at[TS_BAR_MASS] + bar] + sim->inertia.extra[tip];
            sum += sim->inertia.laden[block] * along;
        }
        sum += 0.5 * mass * square;
    }
    return sum;
}

ALWAYS_INLINE double kinetic(const ts_sim *sim, const int D)
{
    const ts_model *m = &sim->m;
    const double *v = sim->state.y + m->nq;
    double sum = 0.0;
    const int motors = m->blocks - m->count[TS_A];
    for (int b = 0; b < m->joint.first; b++)
        sum += dot(v + b * D, v + b * D, D) / sim->inertia.inverse[b]; /* 1/inv: inertia of the block */
    for (int b = motors; b < m->blocks; b++) sum += dot(v + b * D, v + b * D, D) / sim->inertia.inverse[b];
    if (m->joint.nodes) sum += 2.0 * ts_joint_energy(sim, v);
    return 0.5 * sum + (m->count[TS_E] ? carried_energy(sim) : 0.0);
}

double ts_kinetic_energy(const ts_sim *sim) { return sim->m.count[TS_D] == 2 ? kinetic(sim, 2) : kinetic(sim, 3); }

ALWAYS_INLINE void nodes(const ts_model *m, const double *x, double *values, const int D)
{
    double *position = values + m->at[TS_POSITION], *velocity = values + m->at[TS_VELOCITY];
    for (int n = 0; n < m->count[TS_N]; n++, x += 2 * D) {
        int free = m->node.free_index[n];
        for (int d = 0; d < D; d++) position[n * D + d] = x[d];
        for (int d = 0; d < D && free >= 0; d++) velocity[free * D + d] = x[D + d];
    }
}

static void strings(ts_sim *sim, double tau)
{
    const ts_model *m = &sim->m;
    double *force = sim->io.values + m->at[TS_STRING_FORCE], *elastic = sim->io.values + m->at[TS_ELASTIC_FORCE];
    double *length = sim->io.values + m->at[TS_STRING_LENGTH];
    for (int i = 0; i < m->count[TS_S]; i++) {
        double fs = sim->strings.fs[i];
        if (sim->state.clipped[i])
            ts_tension(sim, i, sim->strings.elongation[i], sim->strings.rate[i], &fs); /* the spring pulls all the same */
        force[i] = sim->strings.fs[i] + sim->strings.fd[i];
        elastic[i] = fs;
        length[i] =
            sim->strings.elongation[i] + (m->drive.winder[i] < 0 ? ts_rest_length(&sim->rest, i, tau) : sim->rest.now[i]);
    }
}

/* Acceleration of a node along axis d, the bases' included. */
static double acceleration(const ts_sim *sim, int node, int d)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D];
    const double *a = sim->start.f + m->nq;
    double sum = m->drive.mover[node] < 0 ? 0.0 : sim->bases.now[(3 * m->drive.mover[node] + 2) * D + d];
    if (m->node.centre[node] >= 0) sum += a[m->node.centre[node] * D + d];
    if (m->node.block[node] >= 0) sum += m->node.coef[node] * a[m->node.block[node] * D + d];
    return sum;
}

/* Loads on the nodes in addition to the strings' forces: inputs, gravity, and what point masses need (d'Alembert). */
ALWAYS_INLINE void loads(ts_sim *sim, double tau, const int D)
{
    const ts_model *m = &sim->m;
    const axes falls = of_gravity(m);
    const double *mass = sim->io.values + m->at[TS_BAR_MASS];
    const double *slopes = sim->io.slopes, *bends = slopes + sim->m.n_inputs;
    sim->strings.evaluations++;
    for (int n = 0; n < m->count[TS_N]; n++) {
        int f = m->node.free_index[n];
        if (f < 0) continue;
        double *force = sim->strings.node_force + n * D;
        for (int d = 0; d < D; d++) force[d] += external_force(m, sim->io.values, f, d);
        for (int d = 0; d < D && sim->loads.move; d++)
            force[d] += (external_force(m, slopes, f, d) + 0.5 * external_force(m, bends, f, d) * tau) * tau;
    }
    for (int i = 0; i < 2 * m->count[TS_B]; i++)
        for (int d = falls.first; d < falls.end; d++)
            sim->strings.node_force[m->packed.bars[i] * D + d] += 0.5 * mass[i / 2] * sim->inertia.gravity[d];
    for (int i = 0; i < m->node.massed_count; i++)
        for (int d = 0, n = m->node.massed[i]; d < D; d++)
            sim->strings.node_force[n * D + d] += sim->inertia.extra[n] * (sim->inertia.gravity[d] - acceleration(sim, n, d));
}

/* Force of the ground at anchors; bars() overwrites it where a bar is pinned. */
ALWAYS_INLINE void reactions(const ts_model *m, const double *node_force, double *values, const int D)
{
    for (int n = 0; n < m->count[TS_N]; n++)
        for (int d = 0; d < D && m->packed.fixed[n]; d++)
            values[m->at[TS_REACTION] + (-1 - m->node.free_index[n]) * D + d] = -node_force[n * D + d];
}

/* Euler's, of a hinged bar (N). */
double ts_buckling_load(const ts_sim *sim, int column)
{
    const ts_model *m = &sim->m;
    const double over = 3.14159265358979323846 / m->bar.length[m->packed.braced[column]];
    return over * over * sim->io.values[m->at[TS_BENDING_STIFFNESS] + column];
}

/* Reactions of pinned bars, m c''/2 + m a_base - f_base - f_tip; then with them the axial forces (eq. 1):
 * -lambda l = J |b'|^2/l + b.(f2 - f1)/(2 l). */
ALWAYS_INLINE void bars(ts_sim *sim, const int D)
{
    static const double at_rest[3] = {0.0, 0.0, 0.0};
    const ts_model *m = &sim->m;
    const double *mass = sim->io.values + m->at[TS_BAR_MASS], *x = sim->io.values + m->at[TS_POSITION];
    for (int i = 0; i < m->count[TS_B]; i++) {
        int first = m->packed.bars[2 * i], second = m->packed.bars[2 * i + 1], base = m->bar.base[i],
            moves = base >= 0 && m->drive.mover[base] >= 0;
        if (m->bar.block[i] < 0) continue;
        double axial = 0.0, speed = 0.0, *f1 = sim->strings.node_force + first * D, *f2 = sim->strings.node_force + second * D;
        const double *v = sim->start.f + m->bar.block[i] * D, *a = v + m->nq;
        const double *a_base = moves ? sim->bases.now + (3 * m->drive.mover[base] + 2) * D : at_rest;
        double *R = base < 0 ? NULL : sim->io.values + m->at[TS_REACTION] + (-1 - m->node.free_index[base]) * D;
        for (int d = 0; d < D; d++) {
            if (R) {
                R[d] = mass[i] * (0.5 * a[d] + a_base[d]) - f1[d] - f2[d];
                sim->strings.node_force[base * D + d] += R[d];
            }
            axial += (x[second * D + d] - x[first * D + d]) * (f2[d] - f1[d]);
            speed += v[d] * v[d];
        }
        sim->io.values[m->at[TS_BAR_FORCE] + i] = (mass[i] / 12.0 * speed + 0.5 * axial) / m->bar.length[i];
    }
}

/* Compression over pi^2 E I/l^2, tension over strength; the forces are among the outputs. */
static void utilisation(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    double *values = sim->io.values;
    for (int i = 0; i < m->count[TS_C]; i++)
        values[m->at[TS_BAR_UTILISATION] + i] =
            fmax(-values[m->at[TS_BAR_FORCE] + m->packed.braced[i]], 0.0) / ts_buckling_load(sim, i);
    for (int i = 0; i < m->count[TS_T]; i++)
        values[m->at[TS_STRING_UTILISATION] + i] =
            fmax(values[m->at[TS_STRING_FORCE] + m->packed.rated[i]], 0.0) / values[m->at[TS_STRENGTH] + i];
}

static void drives(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    for (int a = 0; a < m->count[TS_A]; a++) {
        double rate = ts_wound(m, sim->state.y + m->nq, m->packed.wound[a]);
        sim->io.values[m->at[TS_WOUND_REST_LENGTH] + a] =
            sim->rest.length[m->packed.wound[a]] - ts_wound(m, sim->state.y, m->packed.wound[a]);
        sim->io.values[m->at[TS_WOUND_REST_LENGTH_RATE] + a] = -rate;
        sim->io.values[m->at[TS_MOTOR_SPEED] + a] = rate / sim->io.values[m->at[TS_DRUM_RADIUS] + a];
    }
}

ALWAYS_INLINE void mechanics(ts_sim *sim, double tau, const int D)
{
    loads(sim, tau, D);
    reactions(&sim->m, sim->strings.node_force, sim->io.values, D);
    bars(sim, D);
    if (sim->m.joint.nodes) ts_joint_outputs(sim);
}

ALWAYS_INLINE void motions(ts_sim *sim, const int D) { nodes(&sim->m, sim->strings.x, sim->io.values, D); }

static void energies(ts_sim *sim, double tau)
{
    const ts_model *m = &sim->m;
    double *out = sim->io.values;
    out[m->at[TS_KINETIC]] = ts_kinetic_energy(sim);
    out[m->at[TS_POTENTIAL]] = potential(sim);
    out[m->at[TS_ELASTIC]] = 0.0;
    for (int i = 0; i < m->count[TS_S]; i++) out[m->at[TS_ELASTIC]] += energy_of_string(sim, i, sim->strings.elongation[i]);
    if (m->count[TS_K]) out[m->at[TS_ELASTIC]] += ts_contact_energy(sim, tau, 0);
}

/* Fill outputs of these groups, see ts_want(), from what ts_rhs() has just found at the present state; start.f is the derivative
 * there.  Motion and work need ts_move_nodes() only; forces need the motion's outputs. */
void ts_outputs(ts_sim *sim, double tau, int groups)
{
    const ts_model *m = &sim->m;
    double *out = sim->io.values;
    if (groups & TS_OF_MOTION) {
        DISPATCH(m, motions, sim);
        drives(sim);
    }
    if (groups & TS_OF_FORCES) {
        strings(sim, tau);
        DISPATCH(m, mechanics, sim, tau);
        utilisation(sim);
    }
    if (groups & TS_OF_ENERGIES) energies(sim, tau);
    if (m->count[TS_K]) ts_contact_outputs(sim, groups);
    if (groups & TS_OF_WORK) memcpy(out + m->at[TS_DISSIPATED], sim->state.y + 2 * m->nq, TS_LEDGER * sizeof *out);
    for (int i = 0, n = 0; i < m->count[TS_S] && groups & TS_OF_MOTION; i++)
        if (m->packed.beams[i])
            sim->io.integers[m->int_at[TS_INT_SNAPPED] + n++] = sim->laws.curve[i].piece[sim->state.piece[i]].snapped;
}

/* Derivatives of positions and velocities, from f = [q', q'']. */
static void node_rates(const ts_sim *sim, const double *f, double *out)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D], position = m->at[TS_POSITION] - sim->m.n_applied, velocity = m->at[TS_VELOCITY] - sim->m.n_applied;
    for (int n = 0; n < m->count[TS_N]; n++)
        for (int d = 0; d < D; d++) {
            double v = 0.0, a = 0.0;
            const double *base = sim->bases.now + (3 * m->drive.mover[n] + 1) * D;
            if (m->drive.mover[n] >= 0) v += base[d], a += base[D + d];
            int b = m->node.block[n] * D + d, r = m->node.centre[n] * D + d, free = m->node.free_index[n];
            if (m->node.centre[n] >= 0) v += f[r], a += f[m->nq + r];
            if (m->node.block[n] >= 0) v += m->node.coef[n] * f[b], a += m->node.coef[n] * f[m->nq + b];
            out[position + n * D + d] = v;
            if (free >= 0) out[velocity + free * D + d] = a;
        }
}

/* Outputs at y + shift f, that is on the tangent of the motion, into sim->io.values. */
static void outputs_beside(ts_sim *sim, double tau, const double *y, const double *f, double shift)
{
    for (int i = 0; i < sim->m.ny; i++) sim->state.y[i] = y[i] + shift * f[i];
    ts_rhs(sim, tau + shift, sim->state.y, sim->start.f);
    ts_outputs(sim, tau + shift, TS_OF_ALL);
}

/* What the ledger gets from differences instead of integrals (integrate.c) is not in f: the power of external forces that stay, and
 * what the dampers of clipped strings take of their springs. */
static void add_differences(const ts_sim *sim, double clipped_rate, double *out)
{
    const ts_model *m = &sim->m;
    double *work = out + m->at[TS_INPUT_WORK] - sim->m.n_applied, *throughput = out + m->at[TS_THROUGHPUT] - sim->m.n_applied;
    for (int i = 0; i < m->nq && !sim->loads.move; i++) {
        double power = sim->loads.Q[i] * sim->state.y[m->nq + i];
        *work += power;
        *throughput += fabs(power);
    }
    out[m->at[TS_DISSIPATED] - sim->m.n_applied] -= clipped_rate;
    *throughput += fabs(clipped_rate);
}

/* First derivatives of all real outputs at tau: central differences along the tangent, the strings staying on their pieces;
 * positions and velocities are exact.  The state stays as it is, the outputs do not. */
void ts_tangent_outputs(ts_sim *sim, double tau, double *out)
{
    const double shift = 1e-7; /* s */
    int first = sim->m.n_applied, count = sim->m.n_real - first, ny = sim->m.ny;
    double *y = sim->attempt.k, *f = sim->attempt.k + sim->m.stride;
    memcpy(y, sim->state.y, sizeof(double) * (size_t)ny);
    ts_rhs(sim, tau, y, f);
    outputs_beside(sim, tau, y, f, shift);
    memcpy(out, sim->io.values + first, sizeof(double) * (size_t)count);
    double clipped = ts_clipped_energy(sim, tau + shift);
    outputs_beside(sim, tau, y, f, -shift);
    clipped = (clipped - ts_clipped_energy(sim, tau - shift)) / (2.0 * shift);
    for (int i = 0; i < count; i++) out[i] = (out[i] - sim->io.values[first + i]) / (2.0 * shift);
    memcpy(sim->state.y, y, sizeof(double) * (size_t)ny);
    memcpy(sim->start.f, f, sizeof(double) * (size_t)ny);
    node_rates(sim, f, out);
    add_differences(sim, clipped, out);
}
