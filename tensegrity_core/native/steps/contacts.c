/* Transitions of contacts with the ground: touch-down, lift-off, clipping and its end, slip, stick.
 *
 * Each contact has TS_WATCHES watches, see ts_touch_margins().  A watch has crossed once its margin is less than minus its guard,
 * which is round-off.  At a transition all contacts that stand at an end and move out of their mode go together (symmetry), so that
 * none is left to follow at once. */
#include "steps/contacts.h"
#include "linear/pairs.h"
#include "motion/contact.h"
#include "motion/kinematics.h"
#include "motion/motion.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define EXPLICIT_BEARS 1.4 /* step times rate that an explicit method of fixed step bears with room */

static double size_of(const ts_sim *sim, const double *x) { return sqrt(dot(x, x, sim->m.count[TS_D])); }

/* A contact with its margins, their guards, the second derivative of its penetration and how it gains speed along the plane, m/s2. */
typedef struct {
    ts_touch touch;
    double bend, pull, margin[TS_WATCHES], guard[TS_WATCHES];
} view;

/* At a state; f: the derivative there, or NULL: without the part of the damper in the rate of slip. */
static view look(const ts_sim *sim, double tau, int k, const double *y, const double *f)
{
    view v;
    const ts_touch *t = &v.touch;
    const double kn = ts_contact_parameter(sim, TS_CONTACT_STIFFNESS, k), c = ts_contact_parameter(sim, TS_CONTACT_DAMPING, k);
    const double per_N = ts_has_friction(sim, k) ? ts_reach_per_force(sim, k) : 0.0;
    v.touch = ts_touch_at(sim, tau, k, y);
    v.bend = f ? ts_penetration_bend(sim, tau, k, f + sim->m.nq) : 0.0;
    v.pull = f ? ts_tangential_acceleration(sim, k, f + sim->m.nq) : 0.0;
    double speed = 1.0 + fabs(t->rate) + size_of(sim, t->vt);
    ts_touch_margins(sim, k, t, v.bend, v.margin);
    v.guard[0] = 2.0 * DBL_EPSILON * t->size;
    v.guard[1] = 1e-14 * speed;
    if (sim->state.mode[k] == TS_SLIPPING)
        v.guard[2] = 1e-14 * (speed + per_N * (fabs(t->by_delta * t->rate) + fabs(t->by_rate * v.bend)));
    else v.guard[2] = 4.0 * DBL_EPSILON * t->size * (1.0 + per_N * kn * (1.0 + c * fabs(t->rate)));
    return v;
}

/* --- changing the mode -------------------------------------------------------------------------------------------------- */

static void note(ts_sim *sim, double tau, int k, int before)
{
    ts_memory *memory = &sim->memory;
    const int after = sim->state.mode[k];
    if (before == after) return;
    if (sim->told.count < TS_MAX_TRANSITIONS)
        sim->told.transitions[sim->told.count] =
            MAKE(ts_transition){memory->time + (tau + memory->time_low), 0.0, -1, before, after, k};
    sim->told.count++;
    memory->stats[TS_TRANSITIONS]++;
}

/* To a mode, without bristle and direction. */
static void go(ts_sim *sim, int k, int mode)
{
    const int D = sim->m.count[TS_D], block = sim->m.contact.block[k];
    sim->state.mode[k] = mode;
    for (int d = 0; d < D; d++) {
        sim->state.bristle[k * D + d] = 0.0;
        if (block >= 0) sim->state.y[block * D + d] = sim->state.y[sim->m.nq + block * D + d] = 0.0;
    }
}

/* Sticking, the bristle deflected by `reach` along t. */
static void stick(ts_sim *sim, double tau, int k, double reach, const double *t)
{
    const int D = sim->m.count[TS_D];
    go(sim, k, TS_STICKING);
    const ts_touch from_origin = ts_touch_at(sim, tau, k, sim->state.y); /* its place in the plane */
    for (int d = 0; d < D; d++) sim->state.bristle[k * D + d] = from_origin.u[d] - reach * t[d];
}

/* Slipping along t, of any length; where that is 0, nowhere. */
static void slip(ts_sim *sim, int k, const double *t)
{
    const int D = sim->m.count[TS_D], block = sim->m.contact.block[k];
    double size = size_of(sim, t), *w = block < 0 ? sim->state.bristle + k * D : sim->state.y + sim->m.nq + block * D;
    go(sim, k, TS_SLIPPING);
    for (int d = 0; d < D && size > 0.0 && ts_has_friction(sim, k); d++) w[d] = TS_DIRECTION * t[d] / size;
}

/* Where the ground begins to press: the bristle is at rest, and sticks if it grows no faster than what friction can bear.  Where
 * nothing moves yet, accelerations decide. */
static void begin(ts_sim *sim, double tau, int k, const view *v, double growth)
{
    const ts_touch *t = &v->touch;
    double speed = size_of(sim, t->vt);
    if (speed == 0.0 && growth == 0.0) {
        speed = v->pull;
        growth = ts_reach_per_force(sim, k) * ts_contact_parameter(sim, TS_CONTACT_STIFFNESS, k) * v->bend;
    }
    if (ts_has_friction(sim, k) && speed <= growth) stick(sim, tau, k, 0.0, t->vt);
    else slip(sim, k, t->vt);
}

static double growth_at_touch_down(const ts_sim *sim, int k, const ts_touch *t)
{
    const double kn = ts_contact_parameter(sim, TS_CONTACT_STIFFNESS, k), c = ts_contact_parameter(sim, TS_CONTACT_DAMPING, k);
    return ts_has_friction(sim, k) ? ts_reach_per_force(sim, k) * kn * t->rate * (1.0 + c * t->rate) : 0.0;
}

static void along(const ts_sim *sim, const ts_touch *t, double out[3])
{
    double deflection = size_of(sim, t->u);
    for (int d = 0; d < 3; d++) out[d] = deflection > 0.0 ? t->u[d] / deflection : 0.0;
}

/* A sticking bristle's position says that friction bears no more: does it slip by its rate, too?  Positions and velocities on the
 * dense output agree within the tolerance only; if not, it stays at the end of what is borne. */
static void give_way(ts_sim *sim, double tau, int k, const view *v)
{
    double t[3];
    along(sim, &v->touch, t);
    if (!(v->touch.normal > 0.0)) go(sim, k, v->touch.delta > 0.0 ? TS_CLIPPED_CONTACT : TS_APART); /* at rest until then */
    else if (!(size_of(sim, t) > 0.0)) slip(sim, k, v->touch.vt);
    else if (ts_slip_rate(sim, k, &v->touch, t, v->bend) > 0.0) slip(sim, k, t);
    else stick(sim, tau, k, fmax(v->touch.reach, 0.0), t);
}

/* --- placing ------------------------------------------------------------------------------------------------------------ */

/* Does a contact that stands apart at the ground's surface move into it? */
static int moves_in(const view *v)
{
    return v->touch.delta >= -v->guard[0] && (v->touch.rate > 0.0 || (v->touch.rate == 0.0 && v->bend > 0.0));
}

/* The mode of a contact by its state as it stands, where that jumped or was not watched.  f: the derivative there under the present
 * modes, or NULL; may_stick: where slipping would end by it. */
static void place_anew(ts_sim *sim, double tau, int k, const double *f, int may_stick)
{
    const int before = sim->state.mode[k];
    const view v = look(sim, tau, k, sim->state.y, f);
    const ts_touch *t = &v.touch;
    const double c = ts_contact_parameter(sim, TS_CONTACT_DAMPING, k);
    if (before == TS_APART ? t->delta <= v.guard[0] && !moves_in(&v) : t->delta <= -v.guard[0]) {
        go(sim, k, TS_APART);
    } else if (1.0 + c * t->rate < 0.0 && !ts_ground_pulls(&sim->m)) {
        go(sim, k, TS_CLIPPED_CONTACT);
    } else if (before == TS_APART || before == TS_CLIPPED_CONTACT) {
        begin(sim, tau, k, &v, t->delta > 4.0 * v.guard[0] ? INFINITY : growth_at_touch_down(sim, k, t));
    } else if (before == TS_STICKING && v.margin[2] < -v.guard[2]) {
        slip(sim, k, t->u);
    } else if (before == TS_SLIPPING && may_stick && v.margin[2] < -v.guard[2]) {
        stick(sim, tau, k, fmax(t->reach, 0.0), t->u);
    }
    note(sim, tau, k, before);
}

/* Is a contact apart, but at the ground's surface, and not on its way out? */
static int rests_above(const ts_sim *sim, int k)
{
    const view v = look(sim, 0.0, k, sim->state.y, NULL);
    return sim->state.mode[k] == TS_APART && fabs(v.touch.delta) <= 4.0 * v.guard[0] && v.touch.rate >= 0.0;
}

/* Modes of all contacts at the start of a step whose inputs jumped.  What bristles lose that give way at once counts with the jump
 * of stored energy as the work of inputs. */
void ts_place_contacts(ts_sim *sim)
{
    int by_acceleration = 0;
    for (int k = 0; k < sim->m.count[TS_K]; k++) by_acceleration |= rests_above(sim, k);
    if (by_acceleration) ts_rhs(sim, 0.0, sim->state.y, sim->start.f);
    for (int k = 0; k < sim->m.count[TS_K]; k++) place_anew(sim, 0.0, k, by_acceleration ? sim->start.f : NULL, 0);
}

/* Book what a change of modes took of the stored energy; where transitions are located that is round-off. */
static void book_loss(ts_sim *sim, double loss)
{
    sim->state.y[2 * sim->m.nq] += loss;
    sim->state.y[2 * sim->m.nq + 2] += fabs(loss);
}

/* Modes by the state, where transitions were not located. */
void ts_catch_up_contacts(ts_sim *sim, double tau)
{
    double before = ts_contact_energy(sim, tau, 0);
    ts_rhs(sim, tau, sim->state.y, sim->start.f);
    for (int k = 0; k < sim->m.count[TS_K]; k++) place_anew(sim, tau, k, sim->start.f, 1);
    book_loss(sim, before - ts_contact_energy(sim, tau, 0));
}

/* --- locating ----------------------------------------------------------------------------------------------------------- */

/* A step is tried: the margins at its start are the first ones. */
void ts_contacts_begin(ts_sim *sim, double tau, double h, int explicit_fixed)
{
    ts_ground *g = &sim->ground;
    g->least_time = explicit_fixed ? h / EXPLICIT_BEARS : 0.0;
    for (int k = 0; k < sim->m.count[TS_K]; k++) {
        const view v = look(sim, tau, k, sim->state.y, sim->start.f);
        memcpy(g->low + TS_WATCHES * k, v.margin, sizeof v.margin);
        memcpy(g->high + TS_WATCHES * k, v.margin, sizeof v.margin);
    }
}

/* May a watch have crossed in the step, whose end's margins are in ground.end?  It did at its end or at a stage, or came closer to
 * it than it varied among them. */
int ts_contact_is_suspect(const ts_sim *sim, int k, int watch, int *crossed)
{
    const int w = TS_WATCHES * k + watch;
    const ts_ground *g = &sim->ground;
    *crossed = g->end[w] < 0.0;
    return *crossed || g->low[w] < 0.0 || g->low[w] < g->high[w] - g->low[w];
}

/* Does this watch need accelerations? */
int ts_contact_needs_derivative(const ts_sim *sim, int k, int watch)
{
    return watch == 2 && sim->state.mode[k] == TS_SLIPPING && ts_contact_parameter(sim, TS_CONTACT_DAMPING, k) > 0.0;
}

/* How far a watch has crossed at a state, beyond its guard; rate: by time, of the normal end, else 0. */
double ts_contact_excess(const ts_sim *sim, double tau, int k, int watch, const double *y, const double *f, double *rate)
{
    const view v = look(sim, tau, k, y, f);
    *rate = watch ? 0.0 : sim->state.mode[k] == TS_APART ? v.touch.rate : -v.touch.rate;
    return -v.margin[watch] - v.guard[watch];
}

/* --- switching ---------------------------------------------------------------------------------------------------------- */

/* Carry out one end of a contact's mode. */
static void leave(ts_sim *sim, double tau, int k, int watch, const view *v)
{
    const int mode = sim->state.mode[k];
    const ts_touch *t = &v->touch;
    if (watch == 0 && mode == TS_APART) {
        begin(sim, tau, k, v, growth_at_touch_down(sim, k, t));
    } else if (watch == 0) {
        go(sim, k, TS_APART);
    } else if (watch == 1 && mode == TS_CLIPPED_CONTACT) { /* N grows by its damper */
        double stiffness = ts_contact_parameter(sim, TS_CONTACT_STIFFNESS, k),
               c = ts_contact_parameter(sim, TS_CONTACT_DAMPING, k);
        begin(sim, tau, k, v, ts_reach_per_force(sim, k) * stiffness * t->delta * c * v->bend);
    } else if (watch == 1) {
        go(sim, k, TS_CLIPPED_CONTACT);
    } else if (mode == TS_SLIPPING) {
        stick(sim, tau, k, fmax(t->reach, 0.0), t->u);
    } else {
        give_way(sim, tau, k, v);
    }
}

/* The end at which a contact stands and moves out of its mode, or -1. */
static int end_left(const ts_sim *sim, int k, const view *v)
{
    const int mode = sim->state.mode[k];
    double t[3];
    if (v->margin[0] <= 2.0 * v->guard[0] && (mode == TS_APART ? v->touch.rate > 0.0 : v->touch.rate < 0.0)) return 0;
    if (mode == TS_APART) return -1;
    if (v->margin[1] < -v->guard[1]) return 1;
    if (mode == TS_SLIPPING && v->margin[2] < -v->guard[2]) return 2;
    if (mode != TS_STICKING || v->margin[2] > 2.0 * v->guard[2]) return -1;
    along(sim, &v->touch, t);
    return size_of(sim, t) > 0.0 && ts_slip_rate(sim, k, &v->touch, t, v->bend) > v->guard[1] ? 2 : -1;
}

/* Carry out the transition that was located at the present state, of watch `which` among the contacts' or -1: another's, and those
 * of contacts that stand at an end, too. */
void ts_switch_contacts(ts_sim *sim, double tau, int which)
{
    double before = ts_contact_energy(sim, tau, 0);
    ts_rhs(sim, tau, sim->state.y, sim->start.f);
    for (int k = 0; k < sim->m.count[TS_K]; k++) {
        const int mode = sim->state.mode[k];
        const view v = look(sim, tau, k, sim->state.y, sim->start.f);
        int end = end_left(sim, k, &v);
        if (which >= 0 && which / TS_WATCHES == k && end != 0) end = which % TS_WATCHES;
        if (end >= 0) leave(sim, tau, k, end, &v);
        note(sim, tau, k, mode);
    }
    book_loss(sim, before - ts_contact_energy(sim, tau, 0));
}
