/* Transitions: a string crosses an end of its piece of the force curve (slack/taut, kinks of an NSH), or, under
 * `tension_only`, its damper begins or ceases to outweigh its spring.
 *
 * Within a step every string keeps the formula of its piece, continued past its ends, so that the step is smooth.  A
 * crossing is looked for at the step's end, at the stages and, where an elongation turned back, at its extremum; it is
 * located on the dense output and counts once the elongation is `guard` (round-off) beyond the end. */
#include "steps/events.h"
#include "invariants.h"
#include "laws/curve.h"
#include "laws/curves.h"
#include "linear/pairs.h"
#include "model/data.h"
#include "motion/motion.h"
#include "motion/pieces.h"
#include "steps/contacts.h"

#include <float.h>
#include <math.h>

#define SAMPLES 8     /* of the dense output where a crossing is suspected */
#define FEW_SAMPLES 3 /* where the elongation goes one way */

/* Untrimmed tension: positive where spring and damper together pull. */
static double raw_tension(const ts_sim *sim, int i, double elongation, double rate, double *scale)
{
    double slope, fs = ts_curve_force(sim->laws.curve + i, sim->state.piece[i], elongation,
                                      sim->io.values[sim->m.at[TS_STIFFNESS] + i], &slope);
    double fd = sim->io.values[sim->m.at[TS_DAMPING] + i] * rate + ts_damping_law(&sim->laws, i, rate, &slope);
    *scale = fabs(fs) + fabs(fd);
    return fs + fd;
}

static int clips(const ts_sim *sim, int i) { return sim->m.damping_law == TS_TENSION_ONLY && sim->on.taut[i] == TS_TAUT; }

/* The tension that a stretch of `guard` gives (N). */
static double tension_guard(const ts_sim *sim, int i, double guard)
{
    return guard * (1.0 + sim->io.values[sim->m.at[TS_STIFFNESS] + i]);
}

/* How a piece is called in a transition: without memory by its place in order of elongation, with memory by its snapped parts. */
static int called(const ts_curve *c, int piece)
{
    const ts_piece *p = c->piece + piece;
    return !c->branches ? piece : p->kind == TS_SLACK ? 0 : 1 + p->snapped;
}

/* A string came from one piece to the one where it is; parts of one branch, which join smoothly, are no transition. */
static void note(ts_sim *sim, double tau, int i, int piece, double loss)
{
    ts_memory *memory = &sim->memory;
    int before = called(sim->laws.curve + i, piece), after = called(sim->laws.curve + i, sim->state.piece[i]);
    if (before == after && !(loss > 0.0)) return;
    if (sim->told.count < TS_MAX_TRANSITIONS)
        sim->told.transitions[sim->told.count] =
            MAKE(ts_transition){memory->time + (tau + memory->time_low), loss, i, before, after, -1};
    sim->told.count++;
    memory->stats[TS_TRANSITIONS]++;
}

/* Piece of a string from its elongation; with memory it goes there from its present piece.  An elongation on an end belongs to the
 * piece it is moving into; at rest, to the lower one, or where there is memory to the present one.  Returns what snaps on the way
 * dissipate, J. */
static double place_anew(ts_sim *sim, int i)
{
    const ts_curve *c = sim->laws.curve + i;
    double lost = 0.0, elongation, rate, scale;
    ts_string_state(sim, 0.0, sim->state.y, i, &elongation, &rate);
    if (c->branches) ts_place(sim, i, sim->state.piece[i]);
    ts_place(sim, i,
             c->branches ? ts_curve_walk(c, sim->state.piece[i], elongation, sim->on.guard[i], &lost)
                         : ts_curve_piece(c, elongation));
    const ts_piece *p = c->piece + sim->state.piece[i];
    if (elongation - sim->on.lo[i] <= sim->on.guard[i] && (c->branches ? rate < 0.0 : rate <= 0.0) && p->down >= 0) {
        lost += p->loss_down;
        ts_place(sim, i, p->down);
    } else if (sim->on.hi[i] - elongation <= sim->on.guard[i] && rate > 0.0 && p->up >= 0) {
        lost += p->loss_up;
        ts_place(sim, i, p->up);
    }
    if (clips(sim, i)) sim->state.clipped[i] = raw_tension(sim, i, elongation, rate, &scale) < 0.0;
    return lost;
}

/* Pieces of all strings at the start of a step whose inputs jumped.  Returns what snaps on the way dissipate, J. */
double ts_place_all(ts_sim *sim)
{
    double lost = 0.0;
    for (int i = 0; i < sim->m.count[TS_S]; i++) {
        int piece = sim->state.piece[i];
        double loss = place_anew(sim, i);
        note(sim, 0.0, i, piece, loss);
        lost += loss;
    }
    if (sim->m.count[TS_K]) ts_place_contacts(sim);
    return lost;
}

/* How far a string is past what its piece (which < S) or its clipping (which >= S) allows; positive: crossed. */
static double excess(const ts_sim *sim, int which, double elongation, double rate)
{
    int S = sim->m.count[TS_S], i = which % S;
    if (which < S) return fmax(sim->on.lo[i] - elongation, elongation - sim->on.hi[i]) - sim->on.guard[i];
    double scale, T = raw_tension(sim, i, elongation, rate, &scale);
    return (sim->state.clipped[i] ? T : -T) - 1e-14 * (1.0 + scale);
}

typedef struct {
    ts_sim *sim;
    const ts_method *method;
    double tau, h;
} step;

/* Coordinates from `first` on and their rates on the dense output, into attempt.y. */
static void look(const step *s, double theta, int first, int count)
{
    ts_sim *sim = s->sim;
    double *y = sim->attempt.y + first;
    s->method->interpolate(&sim->ahead, theta, first, count, y);
    s->method->interpolate(&sim->ahead, theta, sim->m.nq + first, count, y + sim->m.nq);
}

/* A block on the dense output, put on the constraint. */
static void look_at_block(const step *s, double theta, int block)
{
    ts_sim *sim = s->sim;
    const int D = sim->m.count[TS_D];
    look(s, theta, block * D, D);
    ts_project_block(&sim->m, sim->attempt.y, block);
}

/* Elongation and rate of one string on the dense output, put on the constraint as the state will be: only the blocks it
 * hangs on are interpolated. */
static void at_theta(const step *s, double theta, int i, double *elongation, double *rate)
{
    ts_sim *sim = s->sim;
    const ts_term *t = sim->m.string.term + 4 * i;
    int D = sim->m.count[TS_D];
    sim->call.looks++;
    for (int k = 0; k < sim->m.string.term_count[i]; k++) look_at_block(s, theta, t[k].block);
    if (sim->m.string.routed[i] >= 0) {
        const ts_route *route = sim->m.string.route + sim->m.string.routed[i];
        for (int k = 0; k < route->blocks; k++) look_at_block(s, theta, route->block[k]);
    }
    if (sim->m.drive.winder[i] >= 0) look(s, theta, D * (sim->m.blocks - sim->m.count[TS_A] + sim->m.drive.winder[i]), 1);
    ts_string_state(sim, s->tau + theta * s->h, sim->attempt.y, i, elongation, rate);
}

/* The same of a contact's watch. */
static double contact_excess_at(const step *s, double theta, int which, double *slope)
{
    ts_sim *sim = s->sim;
    const ts_model *m = &sim->m;
    const int D = m->count[TS_D], k = which / TS_WATCHES, watch = which % TS_WATCHES, node = m->packed.touching[k];
    double rate, *f = NULL;
    sim->call.looks++;
    if (ts_contact_needs_derivative(sim, k, watch)) {
        look(s, theta, 0, m->nq);
        ts_project(m, sim->attempt.y);
        f = sim->linear.work;
        ts_rhs(sim, s->tau + theta * s->h, sim->attempt.y, f);
    } else {
        const int blocks[] = {m->node.centre[node], m->node.block[node], m->contact.block[k]};
        for (int i = 0; i < 3; i++) {
            if (blocks[i] < 0) continue;
            look(s, theta, blocks[i] * D, D);
            ts_project_block(m, sim->attempt.y, blocks[i]);
        }
    }
    double past = ts_contact_excess(sim, s->tau + theta * s->h, k, watch, sim->attempt.y, f, &rate);
    *slope = s->h * rate;
    return past;
}

/* The excess and, for a crossing of a piece's end, its derivative by theta (else 0). */
static double excess_at(const step *s, double theta, int which, double *slope)
{
    double elongation, rate;
    int S = s->sim->m.count[TS_S];
    if (which >= 2 * S) return contact_excess_at(s, theta, which - 2 * S, slope);
    at_theta(s, theta, which % S, &elongation, &rate);
    if (which < S) *slope = s->h * (elongation - s->sim->on.hi[which] > s->sim->on.lo[which] - elongation ? rate : -rate);
    else *slope = 0.0;
    return excess(s->sim, which, elongation, rate);
}

/* First theta in (a, b] where the excess is positive, given that it is at b and not at a: Newton steps, else secant
 * (Illinois) ones, inside a shrinking bracket, down to round-off; returns the crossed side. */
static double locate(const step *s, int which, double a, double b)
{
    double da, db, fa = excess_at(s, a, which, &da), fb = excess_at(s, b, which, &db), c = b - fb / db;
    double enough = which < s->sim->m.count[TS_S] ? s->sim->on.guard[which] : 0.0;
    if (fa > 0.0) return a;
    for (int n = 0, side = 0; n < 100 && fb > enough && b - a > DBL_EPSILON * b; n++) {
        double dc, fc;
        if (n % 8 == 7) c = 0.5 * (a + b);
        else if (!(c > a && c < b)) c = b - fb * (b - a) / (fb - fa);
        if (!(c > a && c < b)) c = 0.5 * (a + b);
        fc = excess_at(s, c, which, &dc);
        if (fc > 0.0) {
            b = c, fb = fc;
            if (side == 1) fa *= 0.5;
            side = 1;
        } else {
            a = c, fa = fc;
            if (side == -1) fb *= 0.5;
            side = -1;
        }
        c -= (fc - 0.5 * enough) / dc; /* aims at the crossed side; no number where dc is 0, then the secant takes over */
    }
    return b;
}

/* The excess of clipping watch w has its largest value of the samples at b, between a and c: is it positive anywhere there?  A few
 * parabolas; returns such a place, or 2. */
static double peak(const step *s, int w, double a, double fa, double b, double fb, double c, double fc)
{
    for (int n = 0; n < 6 && fb <= 0.0; n++) {
        double p = (b - a) * (fb - fc), q = (b - c) * (fb - fa), slope;
        double x = b - 0.5 * ((b - a) * p - (b - c) * q) / (p - q);
        if (!(x > a && x < c) || x == b) return 2.0;
        double fx = excess_at(s, x, w, &slope);
        if (fx > fb) {
            if (x < b) c = b, fc = fb;
            else a = b, fa = fb;
            b = x, fb = fx;
        } else if (x < b) a = x, fa = fx;
        else c = x, fc = fx;
    }
    return fb > 0.0 ? b : 2.0;
}

/* First change of sign of a clipping watch in (0, last], or 2. */
static double scan_clipping(const step *s, int w, double last)
{
    double a = 0.0, b = 0.0, fa = -INFINITY, slope, fb = excess_at(s, 0.0, w, &slope);
    for (int n = 1; n <= SAMPLES; n++) {
        double c = last * n / SAMPLES, fc = excess_at(s, c, w, &slope);
        if (fb > fa && fb >= fc && n > 1) {
            double between = peak(s, w, a, fa, b, fb, c, fc);
            if (between < 2.0) return locate(s, w, a, between);
        }
        if (fc > 0.0) return locate(s, w, b, c);
        a = b, fa = fb;
        b = c, fb = fc;
    }
    return 2.0;
}

/* Place in (a, b) where the elongation turns: the root of its rate, by bisection and secant. */
static double turning_point(const step *s, int i, double a, double ra, double b, double rb)
{
    for (int n = 0; n < 40 && b - a > 1e-9; n++) {
        double elongation, rc, c = n % 3 == 2 ? 0.5 * (a + b) : b - rb * (b - a) / (rb - ra);
        if (!(c > a && c < b)) c = 0.5 * (a + b);
        at_theta(s, c, i, &elongation, &rc);
        if ((rc > 0.0) == (ra > 0.0)) a = c, ra = rc;
        else b = c, rb = rc;
    }
    return 0.5 * (a + b);
}

/* First time in (0, last] that a string leaves its piece, or 2. */
static double scan(const step *s, int i, double last, int samples)
{
    ts_sim *sim = s->sim;
    double a = 0.0, ra = sim->start.rate[i];
    for (int n = 1; n <= samples; n++) {
        double b = last * n / samples, elongation, rb;
        at_theta(s, b, i, &elongation, &rb);
        if (excess(sim, i, elongation, rb) > 0.0) return locate(s, i, a, b);
        if (ra * rb < 0.0) {
            double turn = turning_point(s, i, a, ra, b, rb), unused;
            if (excess_at(s, turn, i, &unused) > 0.0) return locate(s, i, a, turn);
        }
        a = b;
        ra = rb;
    }
    return 2.0;
}

/* Does the elongation go one way only?  Of the cubic through both ends and their rates (Fritsch, Carlson, Monotone piecewise
 * cubic interpolation, SIAM Journal on Numerical Analysis 17, 1980, doi:10.1137/0717021). */
static int one_way(const ts_step_start *start, const ts_step_ahead *ahead, int i, double h)
{
    double change = ahead->elongation[i] - start->elongation[i], r0 = h * start->rate[i], r1 = h * ahead->rate[i];
    if (change < 0.0) change = -change, r0 = -r0, r1 = -r1;
    return r0 >= 0.0 && r1 >= 0.0 && r0 <= 3.0 * change && r1 <= 3.0 * change;
}

/* May the elongation have left its piece and come back?  If it turns once, its tangents at the two ends meet beyond what it
 * reached. */
static int may_graze(const ts_sim *sim, int i, double h)
{
    double e0 = sim->start.elongation[i], r0 = sim->start.rate[i], e1 = sim->ahead.elongation[i], r1 = sim->ahead.rate[i];
    if (one_way(&sim->start, &sim->ahead, i, h)) return 0;
    if (!(r0 * r1 < 0.0)) {
        double reach = h * (fabs(r0) + fabs(r1));
        return fmax(e0, e1) + reach > sim->on.hi[i] || fmin(e0, e1) - reach < sim->on.lo[i];
    }
    double meet = e0 + r0 * (e1 - e0 - r1 * h) / (r0 - r1);
    return meet > sim->on.hi[i] || meet < sim->on.lo[i];
}

/* May the tension of a string have changed its sign?  It did at a stage or at the end, or came closer to zero at the stages than
 * it varied among them. */
static int may_clip(const ts_strings *found, int i)
{
    return found->sign_changed[i] || found->margin_low[i] < found->margin_high[i] - found->margin_low[i];
}

/* Of contacts, if one comes before `first`; see ts_first_transition(). */
static double first_of_contacts(const step *s, double first, int *which)
{
    ts_sim *sim = s->sim;
    for (int w = 0; w < TS_WATCHES * sim->m.count[TS_K]; w++) {
        int crossed;
        if (!ts_contact_is_suspect(sim, w / TS_WATCHES, w % TS_WATCHES, &crossed)) continue;
        if (!sim->ahead.ready) {
            s->method->densify(sim, s->tau, s->h);
            sim->ahead.ready = 1;
        }
        double theta = scan_clipping(s, 2 * sim->m.count[TS_S] + w, first > 1.0 ? 1.0 : first);
        if (theta < first) first = theta, *which = 2 * sim->m.count[TS_S] + w;
    }
    return first;
}

/* First transition in the step just accepted from tau to tau + h: theta in [0, 1] and the watch that crossed; -1: none.
 * doubtful: the elongation leaves its piece there while the velocities have it return.  Positions and velocities on the dense
 * output agree within the tolerance only, and a graze can be slower than that: such a crossing would be undone at once. */
double ts_first_transition(ts_sim *sim, const ts_method *method, double tau, double h, int *which, int *doubtful)
{
    int S = sim->m.count[TS_S], watches = sim->m.damping_law == TS_TENSION_ONLY ? 2 * S : S;
    step s = {sim, method, tau, h};
    double first = 2.0, slope;
    *doubtful = 0;
    for (int w = 0; w < watches; w++) {
        int i = w % S;
        if (w >= S && !clips(sim, i)) continue;
        int crossed = excess(sim, w, sim->ahead.elongation[i], sim->ahead.rate[i]) > 0.0;
        int left = sim->strings.lowest[i] < sim->on.lo[i] || sim->strings.highest[i] > sim->on.hi[i]; /* at some stage */
        if (!crossed && !(w < S ? left || may_graze(sim, i, h) : may_clip(&sim->strings, i))) continue;
        if (!sim->ahead.ready) {
            method->densify(sim, tau, h);
            sim->ahead.ready = 1;
        }
        double last = first > 1.0 ? 1.0 : first;
        double theta = w < S ? scan(&s, i, last, one_way(&sim->start, &sim->ahead, i, h) ? FEW_SAMPLES : SAMPLES)
                             : scan_clipping(&s, w, last);
        if (theta > 1.0 && crossed && first > 1.0) theta = 1.0; /* dense output and end differ by round-off */
        if (theta < first) {
            first = theta;
            *which = w;
        }
    }
    if (sim->m.count[TS_K]) first = first_of_contacts(&s, first, which);
    if (first > 1.0) return -1.0;
    TS_ASSERT(first >= 0.0 && *which >= 0 && *which < 2 * S + TS_WATCHES * sim->m.count[TS_K]);
    excess_at(&s, first, *which, &slope);
    *doubtful = slope < 0.0;
    return first;
}

static void change_piece(ts_sim *sim, double tau, int i, int piece, double loss)
{
    int taut = sim->on.taut[i], before = sim->state.piece[i];
    if (piece < 0) return; /* there is none */
    ts_place(sim, i, piece);
    note(sim, tau, i, before, loss);
    sim->state.y[2 * sim->m.nq] += loss;
    sim->state.y[2 * sim->m.nq + 2] += loss;
    sim->call.force_jumps |= taut != sim->on.taut[i] || loss > 0.0; /* by its damper, by a snap with memory; else pieces join */
}

/* A string leaves its piece at an end. */
static void leave_piece(ts_sim *sim, double tau, int i, int up)
{
    const ts_piece *p = sim->laws.curve[i].piece + sim->state.piece[i];
    change_piece(sim, tau, i, up ? p->up : p->down, up ? p->loss_up : p->loss_down);
}

/* Is a taut string's tension one that it cannot bear, now that it is on another piece? */
static void review_clipping(ts_sim *sim, int i, double elongation, double rate)
{
    double scale;
    if (clips(sim, i) && (sim->laws.curve[i].branches || (sim->state.piece[i] == 1 && !sim->state.clipped[i])))
        sim->state.clipped[i] = raw_tension(sim, i, elongation, rate, &scale) < 0.0;
}

/* Carry out the transition that was located at the present state, and those of strings that stand at an end too and move
 * out of their piece (symmetry). */
void ts_switch(ts_sim *sim, double tau, int which)
{
    int S = sim->m.count[TS_S];
    TS_ASSERT(which >= 0 && which < 2 * S + TS_WATCHES * sim->m.count[TS_K]);
    sim->call.force_jumps = 0;
    if (sim->m.count[TS_K]) ts_switch_contacts(sim, tau, which < 2 * S ? -1 : which - 2 * S);
    for (int i = 0; i < S; i++) {
        double elongation, rate;
        int before = sim->state.piece[i];
        ts_string_state(sim, tau, sim->state.y, i, &elongation, &rate);
        if (i == which) leave_piece(sim, tau, i, elongation - sim->on.hi[i] > sim->on.lo[i] - elongation);
        else if (elongation - sim->on.hi[i] >= -2.0 * sim->on.guard[i] && rate > 0.0) leave_piece(sim, tau, i, 1);
        else if (sim->on.lo[i] - elongation >= -2.0 * sim->on.guard[i] && rate < 0.0) leave_piece(sim, tau, i, 0);
        else if (i + S != which) continue;
        if (i + S == which && sim->state.piece[i] == before)
            sim->state.clipped[i] = !sim->state.clipped[i]; /* where the tension is 0: no jump */
        else review_clipping(sim, i, elongation, rate);
    }
}

/* Pieces by the elongations as they stand, where transitions are no longer located. */
void ts_catch_up(ts_sim *sim, double tau)
{
    if (sim->m.count[TS_K]) ts_catch_up_contacts(sim, tau);
    for (int i = 0; i < sim->m.count[TS_S]; i++) {
        const ts_curve *c = sim->laws.curve + i;
        double elongation, rate, scale, lost = 0.0;
        ts_string_state(sim, tau, sim->state.y, i, &elongation, &rate);
        if (excess(sim, i, elongation, rate) > 0.0) {
            int piece =
                c->branches ? ts_curve_walk(c, sim->state.piece[i], elongation, 0.0, &lost) : ts_curve_piece(c, elongation);
            change_piece(sim, tau, i, piece, lost);
        }
        if (clips(sim, i)) sim->state.clipped[i] = raw_tension(sim, i, elongation, rate, &scale) < 0.0;
    }
}

/* --- for a host that locates transitions by itself -------------------------------------------------------------------- */

/* How far each string is from leaving its piece at its lower and at its upper end (m), `guard` beyond it, and under
 * `tension_only` from being clipped or released (N): negative where it has left.  A piece without such an end, and a slack string
 * of its clipping, give 1. */
void ts_margins(const ts_sim *sim, double tau, double guard, double *z)
{
    const ts_model *m = &sim->m;
    for (int i = 0; i < m->count[TS_S]; i++) {
        double elongation, rate, scale, T;
        ts_string_state(sim, tau, sim->state.y, i, &elongation, &rate);
        *z++ = sim->on.lo[i] > -INFINITY ? elongation - sim->on.lo[i] + guard : 1.0;
        *z++ = sim->on.hi[i] < INFINITY ? sim->on.hi[i] - elongation + guard : 1.0;
        if (m->damping_law != TS_TENSION_ONLY) continue;
        T = clips(sim, i) ? raw_tension(sim, i, elongation, rate, &scale) : 1.0;
        *z++ = clips(sim, i) ? (sim->state.clipped[i] ? -T : T) + tension_guard(sim, i, guard) : 1.0;
    }
}

/* Is a string, at an end of its piece, to leave it?  Half the guard that ts_margins() has, so that a host may stop a little before
 * and is not called back at once; moving outwards, a little before the end, so that symmetric strings go together. */
static int leaves(double past, double outwards, double guard)
{
    return past >= 0.5 * guard || (past >= -0.5 * guard && outwards > 0.0);
}

/* One string goes on by at most one piece.  Returns whether something changed. */
static int leave_one(ts_sim *sim, int i, double guard)
{
    const ts_piece *p = sim->laws.curve[i].piece + sim->state.piece[i];
    double elongation, rate, scale;
    int piece = sim->state.piece[i], clipped = sim->state.clipped[i];
    ts_string_state(sim, 0.0, sim->state.y, i, &elongation, &rate);
    if (p->up >= 0 && leaves(elongation - p->hi, rate, guard)) leave_piece(sim, 0.0, i, 1);
    else if (p->down >= 0 && leaves(p->lo - elongation, -rate, guard)) leave_piece(sim, 0.0, i, 0);
    if (sim->state.piece[i] != piece) {
        review_clipping(sim, i, elongation, rate);
        return 1;
    }
    if (!clips(sim, i)) return 0;
    double T = raw_tension(sim, i, elongation, rate, &scale);
    if ((clipped ? -T : T) < -0.5 * tension_guard(sim, i, guard)) sim->state.clipped[i] = !clipped;
    return sim->state.clipped[i] != clipped;
}

/* Put all strings that have left their pieces on those that follow, until none has.  0: there is no end to it. */
int ts_leave_passed(ts_sim *sim, double guard)
{
    int most = 16;
    for (int i = 0; i < sim->m.count[TS_S]; i++) most += 2 * sim->laws.curve[i].pieces + 2;
    for (int n = 0, changed = 1; changed; n++) {
        changed = 0;
        if (n > most) return 0;
        for (int i = 0; i < sim->m.count[TS_S]; i++) changed |= leave_one(sim, i, guard);
    }
    return 1;
}
