/* Contact of nodes with the ground, a plane that may move along its normal n.
 *
 * With the penetration delta = h - n.(x - p) and its rate, the ground presses with N = k_n delta (1 + c delta').  Friction is
 * elastic and perfectly plastic: a bristle deflected by u in the plane pulls with -k_t u, |k_t u| <= mu N.
 * Sticking, u' = v_t: the bristle is the node's way from the place a where it is at rest, u = P (x - a), P = I - n n'.  So nothing
 * is integrated, and what rests does not creep.
 * Slipping, |u| = rho = mu N/k_t: the force is -mu N t, t = u/|u|.  From u' = v_t - g t follow
 *     t' = (v_t - (t.v_t) t)/rho,    g = t.v_t - rho'.
 * In a planar scene t is a sign; in space it is integrated.  It stands where the rates of the contact's block are, its integral,
 * which nothing needs, where the coordinates are, so that methods know nothing of it.  Where rho vanishes, t follows v_t without
 * delay: no faster, though, than LEAST_REACH allows, nor than an explicit method of fixed step can resolve (least_time).
 * Each contact keeps the formula of its mode over a step, continued past its ends; steps/contacts.c locates these. */
#include "motion/contact.h"
#include "linear/pattern.h"
#include "motion/bases.h"
#include "motion/kinematics.h"

#include <math.h>
#include <string.h>

#define LEAST_REACH 1e-8 /* m: below it a bristle's force, and what its direction does within that time, is nothing */

double ts_contact_parameter(const ts_sim *sim, int field, int k) { return sim->io.values[sim->m.at[field] + k]; }

/* May N be negative, as the formula says it? */
int ts_ground_pulls(const ts_model *m) { return m->packed.touching[m->count[TS_K]] != 0; }

int ts_has_friction(const ts_sim *sim, int k)
{
    return ts_contact_parameter(sim, TS_CONTACT_FRICTION, k) > 0.0 &&
           ts_contact_parameter(sim, TS_CONTACT_TANGENTIAL_STIFFNESS, k) > 0.0;
}

/* Deflection at which the bristle slips, per normal force (m/N). */
double ts_reach_per_force(const ts_sim *sim, int k)
{
    return ts_contact_parameter(sim, TS_CONTACT_FRICTION, k) / ts_contact_parameter(sim, TS_CONTACT_TANGENTIAL_STIFFNESS, k);
}

/* --- the ground's motion ------------------------------------------------------------------------------------------------ */

/* Height, rate and acceleration at tau from the step's start. */
static void height_at(const double *start, double tau, double now[3])
{
    now[2] = start[2] + tau * (start[3] + tau / 2.0 * start[4]);
    now[1] = start[1] + tau * (start[2] + tau / 2.0 * (start[3] + tau / 3.0 * start[4]));
    now[0] = start[0] + tau * (start[1] + tau / 2.0 * (start[2] + tau / 3.0 * (start[3] + tau / 4.0 * start[4])));
}

/* --- a node and the ground ---------------------------------------------------------------------------------------------- */

/* Unit direction of slip, or 0 where there is none. */
static void direction(const ts_sim *sim, int k, const double *y, double *t)
{
    const int D = sim->m.count[TS_D], block = sim->m.contact.block[k];
    const double *w = block < 0 ? sim->state.bristle + k * D : y + sim->m.nq + block * D;
    double square = 0.0;
    for (int d = 0; d < D; d++) square += w[d] * w[d];
    for (int d = 0; d < D; d++) t[d] = square > 0.0 ? w[d] / sqrt(square) : 0.0;
}

static ts_touch measure(const ts_sim *sim, int k, const double *x, const double *v, const double *y, const double now[3])
{
    const int D = sim->m.count[TS_D], mode = sim->state.mode[k];
    const double *p = sim->m.packed.ground, *n = p + D, *a = sim->state.bristle + k * D;
    const double kn = ts_contact_parameter(sim, TS_CONTACT_STIFFNESS, k), c = ts_contact_parameter(sim, TS_CONTACT_DAMPING, k);
    double above = 0.0, climb = 0.0, off = 0.0;
    ts_touch t;
    memset(&t, 0, sizeof t);
    t.size = fabs(now[0]);
    for (int d = 0; d < D; d++) {
        above += n[d] * (x[d] - p[d]);
        climb += n[d] * v[d];
        t.size += fabs(x[d]) + fabs(p[d]);
    }
    t.delta = now[0] - above;
    t.rate = now[1] - climb;
    for (int d = 0; d < D; d++) t.vt[d] = v[d] - climb * n[d];
    if (mode != TS_STICKING && mode != TS_SLIPPING) return t;
    t.by_delta = kn * (1.0 + c * t.rate);
    t.by_rate = kn * t.delta * c;
    t.normal = t.by_delta * t.delta;
    if (!ts_has_friction(sim, k)) return t;
    t.reach = ts_reach_per_force(sim, k) * t.normal;
    if (mode == TS_SLIPPING) {
        direction(sim, k, y, t.u);
        return t;
    }
    for (int d = 0; d < D; d++) off += n[d] * (x[d] - a[d]);
    for (int d = 0; d < D; d++) t.u[d] = x[d] - a[d] - off * n[d];
    return t;
}

/* Position and velocity of a node at any state (D). */
static void node_at(const ts_sim *sim, double tau, const double *y, int node, double *x, double *v)
{
    const ts_model *m = &sim->m;
    const int D = m->count[TS_D], centre = m->node.centre[node] * D, block = m->node.block[node] * D;
    if (m->drive.mover[node] >= 0) ts_base_at(&sim->bases, D, tau, m->drive.mover[node], x, v);
    for (int d = 0; d < D; d++) {
        if (m->drive.mover[node] < 0) x[d] = m->node.anchor[node * D + d], v[d] = 0.0;
        if (centre >= 0) x[d] += y[centre + d], v[d] += y[m->nq + centre + d];
        if (block >= 0) x[d] += m->node.coef[node] * y[block + d], v[d] += m->node.coef[node] * y[m->nq + block + d];
    }
}

/* A contact at any state. */
ts_touch ts_touch_at(const ts_sim *sim, double tau, int k, const double *y)
{
    double x[3], v[3], now[3];
    node_at(sim, tau, y, sim->m.packed.touching[k], x, v);
    height_at(sim->ground.start, tau, now);
    return measure(sim, k, x, v, y, now);
}

/* Force in the plane on the node (D). */
void ts_friction(const ts_sim *sim, int k, const ts_touch *t, double *force)
{
    const int mode = sim->state.mode[k];
    double w = 0.0;
    if (mode == TS_STICKING) w = -ts_contact_parameter(sim, TS_CONTACT_TANGENTIAL_STIFFNESS, k);
    if (mode == TS_SLIPPING) w = -ts_contact_parameter(sim, TS_CONTACT_FRICTION, k) * t->normal;
    for (int d = 0; d < sim->m.count[TS_D]; d++) force[d] = w * t->u[d];
}

/* Analysis only: the law as one formula, without located transitions. */
static void place_by_state(ts_sim *sim, int k, const double *x, const double *v)
{
    const int D = sim->m.count[TS_D];
    const double *now = sim->ground.now;
    double *a = sim->state.bristle + k * D;
    ts_touch t = measure(sim, k, x, v, sim->state.y, now);
    int pressed =
        t.delta > 0.0 && (ts_ground_pulls(&sim->m) || 1.0 + ts_contact_parameter(sim, TS_CONTACT_DAMPING, k) * t.rate > 0.0);
    if (pressed && sim->state.mode[k] != TS_STICKING) memcpy(a, x, sizeof(double) * (size_t)D);
    sim->state.mode[k] = pressed ? TS_STICKING : TS_APART;
    t = measure(sim, k, x, v, sim->state.y, now);
    double deflection = sqrt(dot(t.u, t.u, D));
    for (int d = 0; d < D && pressed && deflection > t.reach; d++) a[d] += (1.0 - t.reach / deflection) * t.u[d];
}

/* Forces of the ground on the nodes, whose positions and velocities are at hand. */
void ts_press(ts_sim *sim, double tau, const double *y, double *force)
{
    const ts_model *m = &sim->m;
    const int D = m->count[TS_D];
    const double *n = m->packed.ground + D;
    height_at(sim->ground.start, tau, sim->ground.now);
    for (int k = 0; k < m->count[TS_K]; k++) {
        const int node = m->packed.touching[k];
        const double *x = sim->strings.x + 2 * D * node;
        double friction[3];
        if (sim->call.unlocated) place_by_state(sim, k, x, x + D);
        ts_touch *t = sim->ground.touch + k;
        *t = measure(sim, k, x, x + D, y, sim->ground.now);
        ts_friction(sim, k, t, friction);
        for (int d = 0; d < D; d++) force[node * D + d] += t->normal * n[d] + friction[d];
    }
}

/* Rate at which a bristle deflected along t slips, g = t.v_t - rho' (m/s); bend: the second derivative of delta. */
double ts_slip_rate(const ts_sim *sim, int k, const ts_touch *touch, const double *t, double bend)
{
    double rise = touch->by_delta * touch->rate + touch->by_rate * bend;
    return dot(t, touch->vt, sim->m.count[TS_D]) - ts_reach_per_force(sim, k) * rise;
}

/* How fast a node gains speed along the plane (m/s2); a: accelerations of the blocks. */
double ts_tangential_acceleration(const ts_sim *sim, int k, const double *a)
{
    const ts_model *m = &sim->m;
    const int D = m->count[TS_D], node = m->packed.touching[k], mover = m->drive.mover[node];
    const double *n = m->packed.ground + D;
    double at[3], along = 0.0, square = 0.0;
    for (int d = 0; d < D; d++) {
        at[d] = node_acceleration(m, a, node, d) + (mover < 0 ? 0.0 : sim->bases.now[(3 * mover + 2) * D + d]);
        along += n[d] * at[d];
    }
    for (int d = 0; d < D; d++) square += (at[d] - along * n[d]) * (at[d] - along * n[d]);
    return sqrt(square);
}

/* Second derivative of delta; a: accelerations of the blocks. */
double ts_penetration_bend(const ts_sim *sim, double tau, int k, const double *a)
{
    const ts_model *m = &sim->m;
    const int D = m->count[TS_D], node = m->packed.touching[k], mover = m->drive.mover[node];
    double now[3], bend;
    height_at(sim->ground.start, tau, now);
    bend = now[2];
    for (int d = 0; d < D; d++) {
        double base = mover < 0 ? 0.0 : sim->bases.now[(3 * mover + 2) * D + d];
        bend -= m->packed.ground[D + d] * (base + node_acceleration(m, a, node, d));
    }
    return bend;
}

/* How far a contact is from the ends of its mode; negative: past one.  Its normal end, m: touch-down or lift-off.  Its clipping,
 * m/s.  Its friction: sticking, m, until it slips; slipping, m/s, until it sticks.  An end that there is not is 1 away. */
void ts_touch_margins(const ts_sim *sim, int k, const ts_touch *t, double bend, double margin[TS_WATCHES])
{
    const int mode = sim->state.mode[k];
    const double per_c = 1.0 / ts_contact_parameter(sim, TS_CONTACT_DAMPING, k);
    margin[0] = mode == TS_APART ? -t->delta : t->delta;
    margin[1] = margin[2] = 1.0;
    if (mode == TS_APART) return;
    if (per_c < INFINITY && !ts_ground_pulls(&sim->m))
        margin[1] = mode == TS_CLIPPED_CONTACT ? -(per_c + t->rate) : per_c + t->rate;
    if (mode == TS_CLIPPED_CONTACT || !ts_has_friction(sim, k)) return;
    if (mode == TS_STICKING) margin[2] = t->reach - sqrt(dot(t->u, t->u, sim->m.count[TS_D]));
    else margin[2] = ts_slip_rate(sim, k, t, t->u, bend);
}

/* At the end of a right-hand side, whose accelerations of the blocks are a: how directions of slip turn, and the margins. */
void ts_slip_rates(ts_sim *sim, double tau, double *a)
{
    const ts_model *m = &sim->m;
    ts_ground *g = &sim->ground;
    const int D = m->count[TS_D];
    for (int k = 0; k < m->count[TS_K]; k++) {
        const ts_touch *t = g->touch + k;
        const int block = m->contact.block[k];
        double along = dot(t->u, t->vt, D), least = sqrt(dot(t->vt, t->vt, D)) * g->least_time;
        double reach = fmax(t->reach, fmax(LEAST_REACH, least));
        int turns = sim->state.mode[k] == TS_SLIPPING && dot(t->u, t->u, D) > 0.0;
        for (int d = 0; d < D && block >= 0; d++)
            a[block * D + d] = turns ? TS_DIRECTION * (t->vt[d] - along * t->u[d]) / reach : 0.0;
        double *margin = g->margin + TS_WATCHES * k, *low = g->low + TS_WATCHES * k, *high = g->high + TS_WATCHES * k;
        ts_touch_margins(sim, k, t, ts_penetration_bend(sim, tau, k, a), margin);
        for (int w = 0; w < TS_WATCHES; w++) {
            if (margin[w] < low[w]) low[w] = margin[w];
            if (margin[w] > high[w]) high[w] = margin[w];
        }
    }
}

/* --- energy ------------------------------------------------------------------------------------------------------------- */

/* Part of contacts in the rates of the ledger's integrals (W): what c takes, clipped all that the ground's spring gives; friction
 * where it slips, of which the bristle keeps what ts_contact_energy() says; the work of a ground that moves. */
void ts_contact_rates(const ts_sim *sim, double *p)
{
    for (int k = 0; k < sim->m.count[TS_K]; k++) {
        const ts_touch *t = sim->ground.touch + k;
        const int mode = sim->state.mode[k];
        if (mode == TS_APART) continue;
        double lost = (t->normal - ts_contact_parameter(sim, TS_CONTACT_STIFFNESS, k) * t->delta) * t->rate, slip = 0.0;
        if (mode == TS_SLIPPING)
            slip = ts_contact_parameter(sim, TS_CONTACT_FRICTION, k) * t->normal * dot(t->u, t->vt, sim->m.count[TS_D]);
        p[0] += lost + slip;
        p[2] += fabs(lost) + fabs(slip);
        if (sim->m.count[TS_W]) book(p, t->normal * sim->ground.now[1]);
    }
}

/* Energy stored in the ground and in bristles (J), or only in those that slip: what these take is booked by differences. */
double ts_contact_energy(const ts_sim *sim, double tau, int slipping_only)
{
    double sum = 0.0;
    for (int k = 0; k < sim->m.count[TS_K]; k++) {
        const int mode = sim->state.mode[k];
        if (mode == TS_APART || (slipping_only && mode != TS_SLIPPING)) continue;
        const ts_touch t = ts_touch_at(sim, tau, k, sim->state.y);
        double square = mode == TS_SLIPPING ? t.reach * t.reach : dot(t.u, t.u, sim->m.count[TS_D]);
        if (!slipping_only) sum += 0.5 * ts_contact_parameter(sim, TS_CONTACT_STIFFNESS, k) * t.delta * t.delta;
        sum += 0.5 * ts_contact_parameter(sim, TS_CONTACT_TANGENTIAL_STIFFNESS, k) * square;
    }
    return sum;
}

/* --- Jacobian ----------------------------------------------------------------------------------------------------------- */

/* Derivatives of a contact's force on its node by the node's place and velocity, by the direction of slip, and by time; the same
 * of the rate at which that direction turns.  D x D each, or D. */
typedef struct {
    double by_x[9], by_v[9], by_w[9], by_t[3];
    double turn_x[9], turn_v[9], turn_w[9], turn_t[3];
} slopes;

static void force_slopes(const ts_sim *sim, int k, const double now[3], const int exact, const int D, slopes *s)
{
    const ts_touch *t = sim->ground.touch + k;
    const double *n = sim->m.packed.ground + D, kt = ts_contact_parameter(sim, TS_CONTACT_TANGENTIAL_STIFFNESS, k),
                 mu = ts_contact_parameter(sim, TS_CONTACT_FRICTION, k);
    const int slips = sim->state.mode[k] == TS_SLIPPING;
    double by_delta = exact ? t->by_delta : fmax(t->by_delta, 0.0), by_rate = exact ? t->by_rate : fmax(t->by_rate, 0.0);
    for (int r = 0; r < D; r++) {
        double along = n[r] - (slips && exact ? mu * t->u[r] : 0.0);
        s->by_t[r] = along * (t->by_delta * now[1] + t->by_rate * now[2]);
        for (int c = 0; c < D; c++) {
            double P = (r == c) - n[r] * n[c];
            s->by_x[r * D + c] = -along * by_delta * n[c] - (slips ? 0.0 : kt * P);
            s->by_v[r * D + c] = -along * by_rate * n[c];
            s->by_w[r * D + c] = slips && exact ? -mu * t->normal * (P - t->u[r] * t->u[c]) / TS_DIRECTION : 0.0;
        }
    }
}

static void turn_slopes(const ts_sim *sim, int k, const double now[3], const int exact, const int D, slopes *s)
{
    const ts_touch *t = sim->ground.touch + k;
    const double *n = sim->m.packed.ground + D, along = dot(t->u, t->vt, D), reach = fmax(t->reach, LEAST_REACH);
    const double per_N = t->reach > LEAST_REACH ? ts_reach_per_force(sim, k) / reach : 0.0;
    for (int r = 0; r < D; r++) {
        double rate = TS_DIRECTION * (t->vt[r] - along * t->u[r]) / reach;
        s->turn_t[r] = -rate * per_N * (t->by_delta * now[1] + t->by_rate * now[2]);
        for (int c = 0; c < D; c++) {
            double P = (r == c) - n[r] * n[c] - t->u[r] * t->u[c];
            s->turn_x[r * D + c] = exact ? rate * per_N * t->by_delta * n[c] : 0.0;
            s->turn_v[r * D + c] = exact ? TS_DIRECTION * P / reach + rate * per_N * t->by_rate * n[c] : 0.0;
            s->turn_w[r * D + c] = -(exact ? along : fmax(along, 0.0)) * P / reach;
            if (exact) s->turn_w[r * D + c] -= t->u[r] * (t->vt[c] - along * t->u[c]) / reach;
        }
    }
}

/* The base of the node's bar moves. */
static void add_base(const double *base, const double *by_x, const double *by_v, double *by_t, const int D)
{
    for (int r = 0; r < D; r++) by_t[r] += dot(by_x + r * D, base + D, D) + dot(by_v + r * D, base + 2 * D, D);
}

static void add_block(double *into, int at, double weight, const double *A, const int D)
{
    for (int e = 0; e < D * D; e++) into[at + e] += weight * A[e];
}

static void add_contact(ts_sim *sim, int k, const double now[3], const int exact, const int D)
{
    const ts_model *m = &sim->m;
    ts_linear *lin = &sim->linear;
    const ts_touch *t = sim->ground.touch + k;
    const int node = m->packed.touching[k], own = m->contact.block[k], mover = m->drive.mover[node];
    const int turns = own >= 0 && sim->state.mode[k] == TS_SLIPPING && dot(t->u, t->u, D) > 0.0;
    const double *base = sim->bases.now + 3 * mover * D;
    slopes s;
    int block[2], count = 0;
    double coef[2];
    if (m->node.centre[node] >= 0) block[count] = m->node.centre[node], coef[count++] = 1.0;
    block[count] = m->node.block[node], coef[count++] = m->node.coef[node];
    force_slopes(sim, k, now, exact, D, &s);
    if (turns) turn_slopes(sim, k, now, exact, D, &s);
    if (mover >= 0) add_base(base, s.by_x, s.by_v, s.by_t, D);
    if (mover >= 0 && turns) add_base(base, s.turn_x, s.turn_v, s.turn_t, D);
    for (int i = 0; i < count; i++) {
        double w = coef[i] * sim->inertia.inverse[block[i]];
        for (int d = 0; d < D; d++) lin->ft[block[i] * D + d] += w * s.by_t[d];
        for (int j = 0; j < count; j++) {
            int at = ts_pattern_place(&lin->pattern, block[i], block[j]);
            add_block(lin->Jq, at, w * coef[j], s.by_x, D);
            add_block(lin->Jv, at, w * coef[j], s.by_v, D);
        }
        if (!turns) continue;
        int row = ts_pattern_place(&lin->pattern, own, block[i]);
        add_block(lin->Jv, ts_pattern_place(&lin->pattern, block[i], own), w, s.by_w, D);
        add_block(lin->Jq, row, coef[i], s.turn_x, D);
        add_block(lin->Jv, row, coef[i], s.turn_v, D);
    }
    if (!turns) return;
    add_block(lin->Jv, m->block.own_place[own], 1.0, s.turn_w, D);
    for (int d = 0; d < D; d++) lin->ft[own * D + d] += s.turn_t[d];
}

/* Part of contacts in Jq, Jv and ft, from what the last ts_forces() left; exact: else only what damps, see jacobian.c. */
void ts_contact_jacobian(ts_sim *sim, double tau, int exact)
{
    double now[3];
    height_at(sim->ground.start, tau, now);
    for (int k = 0; k < sim->m.count[TS_K]; k++)
        if (sim->state.mode[k] == TS_STICKING || sim->state.mode[k] == TS_SLIPPING)
            add_contact(sim, k, now, exact, sim->m.count[TS_D]);
}

/* --- around steps ------------------------------------------------------------------------------------------------------- */

/* Directions of slip are vectors of one length in the plane. */
void ts_project_directions(const ts_model *m, double *y)
{
    const double *n = m->packed.ground + 3;
    for (int k = 0; k < m->contact.directed; k++) {
        double *w = y + m->nq + 3 * m->contact.block[k], off = dot(w, n, 3), square = 0.0;
        if (w[0] == 0.0 && w[1] == 0.0 && w[2] == 0.0) continue;
        for (int d = 0; d < 3; d++) w[d] -= off * n[d], square += w[d] * w[d];
        for (int d = 0; d < 3; d++) w[d] *= TS_DIRECTION / sqrt(square);
    }
}

void ts_contact_outputs(ts_sim *sim, int groups)
{
    const ts_model *m = &sim->m;
    for (int k = 0; k < m->count[TS_K]; k++) {
        if (groups & TS_OF_FORCES) {
            double normal = sim->ground.touch[k].normal;
            sim->io.values[m->at[TS_CONTACT_NORMAL] + k] = ts_ground_pulls(m) ? normal : fmax(normal, 0.0);
            ts_friction(sim, k, sim->ground.touch + k, sim->io.values + m->at[TS_CONTACT_FORCE] + k * m->count[TS_D]);
        }
        if (groups & TS_OF_MOTION) sim->io.integers[m->int_at[TS_INT_CONTACT_STICKING] + k] = sim->state.mode[k] == TS_STICKING;
    }
}
