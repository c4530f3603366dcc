/* What moves a structure, loads it or slows it down beside strings, gravity and external forces.
 *
 * Point masses.  A mass m_p at a bar's end adds to its inertia; r is then the bar's centre of mass, its ends at r - lower b and
 * r + upper b with lower = (m/2 + m_2)/(m + m_1 + m_2), so that r and b stay decoupled:
 *     (m + m_1 + m_2) r'' = F,    I b'' = P (upper f2 - lower f1) - I (|b'|^2/|b|^2) b,
 *     I = m/12 + m (lower - 1/2)^2 + m_1 lower^2 + m_2 upper^2;    pinned: I = m/3 + m_p.
 * Drag.  A force -c v on a node.
 * Moved nodes.  Over a step x = x_0 + v t + a t^2/2.  A bar pinned there feels -(m/2 + m_p) a like a weight.  A jump of v by dv
 * is an impulse: c' changes by -kappa P dv, kappa = (m/2 + m_p)/(m/3 + m_p).  A jump of x carries the bar along without one.
 * Actuators, eq. 8 with the sign of winding in: J_a delta'' + d_a delta' = k_a i - r T, xi0 = xi0(0) - r delta.  The coordinate
 * is w = r delta, in m, with the inertia J_a/r^2: (J_a/r^2) w'' = (k_a/r) i - T - (d_a/r^2) w'; a load on the drum adds to T.
 * Each actuator has a block of its own, behind those of the bars, of which it uses the first number. */
#include "motion/drives.h"
#include "linear/pairs.h"
#include "linear/pattern.h"
#include "model/data.h"
#include "motion/bases.h"
#include "motion/joints.h"
#include "motion/kinematics.h"

#include <math.h>

static int motor_at(const ts_model *m, int actuator) { return (m->blocks - m->count[TS_A] + actuator) * m->count[TS_D]; }

static double value(const ts_sim *sim, int field, int i) { return sim->io.values[sim->m.at[field] + i]; }

/* --- point masses and gravity ------------------------------------------------------------------------------------------- */

/* Coefficients of a free bar's ends, and with them those of the strings that hang on it. */
static void place_ends(ts_model *m, ts_place_of_bar *p, double lower)
{
    p->lower = lower;
    p->upper = 1.0 - lower;
    m->node.coef[p->first] = -p->lower;
    m->node.coef[p->second] = p->upper;
}

static void hang(ts_model *m, int line)
{
    ts_term *t = m->string.term + 4 * line; /* there is room for four, whether or not it has terms */
    for (int end = 0; end < 2; end++) {
        int node = m->string.node[2 * line + end];
        if (m->node.block[node] < 0) continue;
        if (m->node.centre[node] >= 0) t++;
        t->kappa = (end ? 1.0 : -1.0) * m->node.coef[node];
        t++;
    }
}

/* Shares in strings' masses, beside the nodes' point masses. */
static void share_masses(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    const ts_packed *p = &m->packed;
    double *extra = sim->inertia.extra;
    for (int i = m->count[TS_P]; i < m->node.massed_count; i++) extra[m->node.massed[i]] = 0.0;
    for (int i = 0; i < p->shares; i++)
        extra[p->sharing[2 * i + 1]] += p->share[i] * value(sim, TS_STRING_MASS, p->sharing[2 * i]);
}

/* Inertias and weights of the blocks, gravity's vector. */
void ts_weigh(ts_sim *sim)
{
    ts_model *m = &sim->m;
    const double *mass = sim->io.values + m->at[TS_BAR_MASS], *gravity = sim->io.values + m->at[TS_GRAVITY];
    double *extra = sim->inertia.extra;
    for (int d = 0; d < m->count[TS_D]; d++)
        sim->inertia.gravity[d] = m->count[TS_V] > 1 ? gravity[d] : d == m->z_axis ? -gravity[0] : 0.0;
    for (int i = 0; i < m->count[TS_P]; i++) extra[m->packed.massed[i]] = value(sim, TS_POINT_MASS, i);
    if (m->packed.shares) share_masses(sim);
    for (int i = 0; i < m->bar.pinned_count; i++) {
        int b = m->bar.pinned[i].block;
        double bar = mass[m->block.bar[b]], tip = extra[m->bar.pinned[i].second];
        sim->inertia.inverse[b] = 3.0 / (bar + 3.0 * tip);
        sim->inertia.laden[b] = 0.5 * bar + tip;
    }
    for (int i = 0; i < m->bar.floating_count; i++) {
        ts_place_of_bar *p = m->bar.floating + i;
        double bar = mass[m->block.bar[p->block]], m1 = extra[p->first], m2 = extra[p->second], all = bar + m1 + m2;
        if (m->node.massed_count) place_ends(m, p, (0.5 * bar + m2) / all);
        double off = p->lower - 0.5, inertia = bar * off * off + m1 * p->lower * p->lower + m2 * p->upper * p->upper;
        sim->inertia.inverse[p->block] = 1.0 / all;
        sim->inertia.laden[p->block] = all;
        sim->inertia.inverse[p->block + 1] = 12.0 / (bar + 12.0 * inertia);
    }
    for (int i = 0; i < m->node.lone_count; i++) {
        int b = m->node.block[m->node.lone[i]];
        sim->inertia.inverse[b] = 1.0 / extra[m->node.lone[i]];
        sim->inertia.laden[b] = extra[m->node.lone[i]];
    }
    for (int i = 0; m->node.massed_count && i < m->string.count; i++) hang(m, i);
    for (int k = 0; k < m->contact.directed; k++) sim->inertia.inverse[m->contact.block[k]] = 1.0;
    if (m->joint.nodes) ts_weigh_joints(sim);
}

/* --- moved nodes -------------------------------------------------------------------------------------------------------- */

/* The impulse of velocities that differ from those that other inputs left at tau after their step's start; NULL: from those of
 * the model's start. */
void ts_jump_bases(ts_sim *sim, const double *values, const double *slopes, double tau)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D];
    double *all = m->joint.nodes ? sim->joined.work : NULL; /* velocities before */
    for (int e = 0; e < m->count[TS_E]; e++) {
        double before[3 * TS_BASE_DERIVATIVES], jump[3], along = 0.0;
        if (all && values) ts_base_polynomial(m, values, slopes, e, before);
        for (int d = 0; d < D && all; d++)
            all[e * D + d] = values ? ts_base_derivative(before, D, d, 1, tau) : m->packed.velocity[m->packed.moved[e] * D + d];
        if (m->drive.mover_bar[e] < 0) continue;
        int block = m->bar.block[m->drive.mover_bar[e]];
        const double *c = sim->state.y + block * D, *now = sim->bases.start + (TS_BASE_DERIVATIVES * e + 1) * D;
        const double *start = m->packed.velocity + m->packed.moved[e] * D;
        if (values) ts_base_polynomial(m, values, slopes, e, before);
        for (int d = 0; d < D; d++) jump[d] = now[d] - (values ? ts_base_derivative(before, D, d, 1, tau) : start[d]);
        for (int d = 0; d < D; d++) along += c[d] * jump[d] / (m->block.length[block] * m->block.length[block]);
        double kappa = sim->inertia.laden[block] * sim->inertia.inverse[block];
        for (int d = 0; d < D; d++) sim->state.y[m->nq + block * D + d] -= kappa * (jump[d] - along * c[d]);
    }
    if (all) ts_jump_joints(sim, all);
}

/* Do moved nodes or the ground move on under the inputs of the last step, while the inputs say where they are at its start? */
int ts_inputs_move(const ts_model *m, const ts_io *io)
{
    for (int i = m->at[TS_NODE_VELOCITY]; i < m->at[TS_NODE_ACCELERATION + 1]; i++)
        if (io->applied[i] != 0.0) return 1;
    for (int i = m->at[TS_GROUND_VELOCITY]; i < m->at[TS_GROUND_ACCELERATION + 1]; i++)
        if (io->applied[i] != 0.0) return 1;
    return 0;
}

/* A bar's share in the inertia force, on its block. */
void ts_carry(const ts_model *m, const ts_inertia *inertia, const ts_bases *bases, double *Q)
{
    int D = m->count[TS_D];
    for (int e = 0; e < m->count[TS_E]; e++) {
        if (m->drive.mover_bar[e] < 0) continue;
        int block = m->bar.block[m->drive.mover_bar[e]];
        for (int d = 0; d < D; d++) Q[block * D + d] -= inertia->laden[block] * bases->now[(3 * e + 2) * D + d];
    }
}

/* Force of the mover on the structure along axis d; a: accelerations of the blocks. */
static double pull_of_mover(const ts_sim *sim, double tau, const double *a, int e, int d)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D], node = m->packed.moved[e], bar = m->drive.mover_bar[e];
    if (m->joint.nodes && (m->joint.spot[node] >= 0 || m->joint.bears[node])) return ts_pull_on_joint(sim, e, d);
    double at_base = sim->bases.now[(3 * e + 2) * D + d] - sim->inertia.gravity[d]; /* what a mass there needs */
    double force = sim->inertia.extra[node] * at_base - sim->strings.node_force[node * D + d];
    if (bar < 0) return force;
    int block = m->bar.block[bar], i = block * D + d,
        tip = m->packed.bars[2 * bar] == node ? m->packed.bars[2 * bar + 1] : m->packed.bars[2 * bar];
    double on_tip = load_at(&sim->loads, i, tau) + sim->strings.node_force[tip * D + d];
    double mass = value(sim, TS_BAR_MASS, bar) + sim->inertia.extra[tip];
    return force + mass * at_base + sim->inertia.laden[block] * a[i] - on_tip;
}

/* --- drag --------------------------------------------------------------------------------------------------------------- */

void ts_drag(ts_sim *sim, double *force)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D];
    for (int r = 0; r < m->count[TS_R]; r++) {
        int node = m->packed.dragged[r];
        double c = value(sim, TS_DRAG, r);
        for (int d = 0; d < D; d++) force[node * D + d] -= c * sim->strings.x[(2 * node + 1) * D + d];
    }
}

/* --- actuators ---------------------------------------------------------------------------------------------------------- */

/* Length that has been wound in (m), or with y behind the positions its rate (m/s). */
double ts_wound(const ts_model *m, const double *y, int string) { return y[motor_at(m, m->drive.winder[string])]; }

/* Rest lengths and rates of strings that are wound, in now and rate_now. */
void ts_wind(const ts_model *m, const double *y, ts_rest *rest)
{
    for (int a = 0; a < m->count[TS_A]; a++) {
        int i = m->packed.wound[a];
        rest->now[i] -= ts_wound(m, y, i);
        rest->rate_now[i] -= ts_wound(m, y + m->nq, i);
    }
}

/* No rest length is left (within round-off). */
int ts_wound_up(const ts_sim *sim)
{
    for (int a = 0; a < sim->m.count[TS_A]; a++) {
        int i = sim->m.packed.wound[a];
        if (sim->rest.length[i] - ts_wound(&sim->m, sim->state.y, i) < -1e-12 * sim->rest.length[i]) return 1;
    }
    return 0;
}

typedef struct {
    double push, loss; /* (k_a/r) i less the load on the drum, N; d_a/r^2, N s/m */
} motor;

/* An input with its derivatives, and its rate. */
static double held(const ts_sim *sim, int at, double tau, double *rate)
{
    double bend = sim->io.slopes[sim->m.n_inputs + at];
    *rate = sim->io.slopes[at] + bend * tau;
    return sim->io.values[at] + (sim->io.slopes[at] + 0.5 * bend * tau) * tau;
}

static motor motor_of(const ts_sim *sim, double tau, int a, double *push_rate)
{
    double r = value(sim, TS_DRUM_RADIUS, a), per_current = value(sim, TS_TORQUE_CONSTANT, a) / r, current_rate, load_rate;
    double current = held(sim, sim->m.at[TS_CURRENT] + a, tau, &current_rate);
    double load = held(sim, sim->m.at[TS_DRUM_LOAD] + a, tau, &load_rate);
    *push_rate = per_current * current_rate - load_rate;
    return MAKE(motor){per_current * current - load, value(sim, TS_MOTOR_DAMPING, a) / (r * r)};
}

/* Forces on the actuators' blocks. */
void ts_motors(const ts_sim *sim, double tau, const double *v, double *Q)
{
    const ts_model *m = &sim->m;
    for (int a = 0; a < m->count[TS_A]; a++) {
        int at = motor_at(m, a), i = m->packed.wound[a];
        double rate;
        motor drive = motor_of(sim, tau, a, &rate);
        for (int d = 0; d < m->count[TS_D]; d++) Q[at + d] = 0.0;
        Q[at] = drive.push - (sim->strings.fs[i] + sim->strings.fd[i]) - drive.loss * v[at];
    }
}

/* --- all of them -------------------------------------------------------------------------------------------------------- */

/* What inputs and parameters make of actuators and moved nodes at the step's start. */
void ts_drive(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    for (int e = 0; e < m->count[TS_E]; e++)
        ts_base_polynomial(m, sim->io.values, sim->io.slopes, e, sim->bases.start + TS_BASE_DERIVATIVES * e * m->count[TS_D]);
    ts_move_bases(m, 0.0, &sim->bases, sim->strings.x);
    for (int a = 0; a < m->count[TS_A]; a++) {
        double r = value(sim, TS_DRUM_RADIUS, a);
        sim->inertia.inverse[m->blocks - m->count[TS_A] + a] = r * r / value(sim, TS_MOTOR_INERTIA, a);
    }
}

/* Their part in the rates of the ledger's integrals (W); a: accelerations of the blocks. */
void ts_drive_rates(const ts_sim *sim, double tau, const double *v, const double *a, double *p)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D];
    for (int r = 0; r < m->count[TS_R]; r++) {
        const double *speed = sim->strings.x + (2 * m->packed.dragged[r] + 1) * D;
        double power = value(sim, TS_DRAG, r) * dot(speed, speed, D);
        p[0] += power;
        p[2] += power;
    }
    for (int e = 0; e < m->count[TS_E]; e++) {
        double power = 0.0;
        for (int d = 0; d < D; d++) power += pull_of_mover(sim, tau, a, e, d) * sim->bases.now[(3 * e + 1) * D + d];
        book(p, power);
    }
    for (int k = 0; k < m->count[TS_A]; k++) {
        int i = m->packed.wound[k];
        double rate, speed = v[motor_at(m, k)], taken = -(sim->strings.fs[i] + sim->strings.fd[i]) * sim->rest.rate_now[i];
        motor drive = motor_of(sim, tau, k, &rate);
        book(p, drive.push * speed);
        p[0] += drive.loss * speed * speed;
        p[2] += drive.loss * speed * speed;
        if (!sim->rest.moves) continue; /* else the strings' loop has booked what the motor gives the string */
        p[1] -= taken;
        p[2] -= fabs(taken);
    }
}

static void drag_jacobian(ts_sim *sim, int r)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D], node = m->packed.dragged[r], mover = m->drive.mover[node], count = 0;
    double c = value(sim, TS_DRAG, r), coef[2];
    int block[2];
    if (m->node.centre[node] >= 0) block[count] = m->node.centre[node], coef[count++] = 1.0;
    block[count] = m->node.block[node], coef[count++] = m->node.coef[node];
    for (int i = 0; i < count; i++) {
        double w = -c * coef[i] * sim->inertia.inverse[block[i]];
        for (int d = 0; d < D && mover >= 0; d++)
            sim->linear.ft[block[i] * D + d] += w * sim->bases.now[(3 * mover + 2) * D + d];
        for (int j = 0; j < count; j++) {
            double *A = sim->linear.Jv + ts_pattern_place(&sim->linear.pattern, block[i], block[j]);
            for (int d = 0; d < D; d++) A[d * D + d] += w * coef[j];
        }
    }
}

/* Their part in Jv and ft, but for what strings pass on; in jacobian.c that stands with the strings. */
void ts_drive_jacobian(ts_sim *sim, double tau)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D];
    for (int r = 0; r < m->count[TS_R]; r++) drag_jacobian(sim, r);
    for (int e = 0; e < m->count[TS_E]; e++) {
        if (m->drive.mover_bar[e] < 0) continue;
        int block = m->bar.block[m->drive.mover_bar[e]];
        double w = -sim->inertia.laden[block] * sim->inertia.inverse[block];
        for (int d = 0; d < D; d++) sim->linear.ft[block * D + d] += w * ts_base_jerk(&sim->bases, D, tau, e, d);
    }
    for (int a = 0; a < m->count[TS_A]; a++) {
        int at = motor_at(m, a), block = at / D;
        double rate, loss = motor_of(sim, tau, a, &rate).loss;
        sim->linear.Jv[m->block.own_place[block]] -= sim->inertia.inverse[block] * loss;
        sim->linear.ft[at] += sim->inertia.inverse[block] * rate;
    }
}
