/* The stepping loop: step size control, transitions, choice of method, steps that end past the communication point. */
#include "steps/integrate.h"
#include "invariants.h"
#include "linear/pairs.h"
#include "linear/power.h"
#include "methods/method.h"
#include "model/data.h"
#include "motion/joints.h"
#include "motion/kinematics.h"
#include "motion/motion.h"
#include "motion/outputs.h"
#include "steps/auto.h"
#include "steps/contacts.h"
#include "steps/events.h"
#include "steps/watch.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define SAFETY 0.9
#define LEAST_ERROR 1e-4 /* that the control remembers */
#define LEAST_STEP 1e-22 /* of a call's length: less would not reach its end */
#define RELAX 1.5        /* growth after the first step under new inputs, where steps were longer before */
#define SHRINK 0.2       /* smallest factor of the step after a rejection */
#define RETAKES 8        /* attempts in a row after which a doubtful transition counts all the same */
#define ROUND_OFF (8.0 * DBL_EPSILON)
#define FIXED_STEP 1e-3 /* s, where none is given */
#define PORTION 2e8     /* work of a short call at most, about 3 s */
#define SPAN 4.0        /* s of simulated time that allow a call as much again */

#define TS_METHOD(NAME, name) &ts_##name,
static const ts_method *const methods[TS_METHOD_COUNT] = {NULL, TS_METHODS(TS_METHOD)}; /* by TS_METHOD_..., `auto` first */
#undef TS_METHOD

int ts_fixed_step(int method) { return method != TS_METHOD_AUTO && (methods[method]->flags & TS_FIXED_STEP); }

static int fail(ts_sim *sim, int status)
{
    static const char *const texts[] = {
#define TS_ERROR(name, text) text,
#include "errors.def"
#undef TS_ERROR
    };
    const char *text = texts[status];
    if (sim->m.joint.nodes && status != TS_UNSTABLE && status != TS_WORK_LIMIT && ts_joints_lock(sim))
        text =
            "the constraints of the bars lock, as of a chain that is pulled straight, or cannot all hold any longer; load or move "
            "the structure less far, or leave a bar or a fixed axis out";
    strncpy(sim->told.message, text, sizeof sim->told.message - 1);
    return status;
}

/* A first step from the size of the derivative and of its change (Hairer, Norsett, Wanner, section II.4). */
static double first_step(ts_sim *sim, const ts_method *method, double tau, double most)
{
    int ny = sim->m.ny;
    double tolerance = sim->io.values[sim->m.at[TS_TOLERANCE]];
    double d1 = ts_error_norm(sim, sim->start.f, sim->state.y, sim->state.y) * tolerance; /* per second, relative to 1 + |y| */
    double h0 = d1 > 1e-5 ? fmin(0.01 / d1, most) : fmin(1e-6, most);
    for (int i = 0; i < ny; i++) sim->ahead.y[i] = sim->state.y[i] + h0 * sim->start.f[i];
    ts_rhs(sim, tau + h0, sim->ahead.y, sim->ahead.f);
    for (int i = 0; i < ny; i++) sim->attempt.error[i] = sim->ahead.f[i] - sim->start.f[i];
    double d2 = ts_error_norm(sim, sim->attempt.error, sim->state.y, sim->state.y) * tolerance / h0, d = fmax(d1, d2);
    double h1 = d <= 1e-15 ? fmax(1e-6, 1e-3 * h0) : ts_real_power(tolerance / d, method->exponent);
    double h = fmin(100.0 * h0, h1);
    return h > 0.0 ? fmin(h, most) : most; /* NaN: the error test will see it */
}

static void make_dense(ts_sim *sim, const ts_method *method, double tau, double h)
{
    if (!sim->ahead.ready) method->densify(sim, tau, h);
    sim->ahead.ready = 1;
}

/* Integrals of the ledger up to theta of a step whose stages did not carry them: Gauss points of dense output. */
static void integrate_ledger(ts_sim *sim, const ts_method *method, const ts_span *span, double theta, double *ledger)
{
    static const double node[3] = {0.1127016653792583, 0.5, 0.8872983346207417};
    static const double weight[3] = {5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};
    int n = 2 * sim->m.nq;
    for (int k = 0; k < TS_LEDGER; k++) ledger[k] = sim->ahead.dense[n + k];
    for (int g = 0; g < 3; g++) {
        double p[TS_LEDGER], at = theta * node[g];
        method->interpolate(&sim->ahead, at, 0, n, sim->attempt.error);
        ts_power(sim, span->start + at * span->h, sim->attempt.error, p);
        for (int k = 0; k < TS_LEDGER; k++) ledger[k] += weight[g] * theta * span->h * p[k];
    }
}

/* What the ledger gets from differences instead of integrals: the work of external forces that are constant over the step, and
 * the energy of clipped strings, whose dampers take all that their springs give, and of bristles that slip. */
static void settle_ledger(ts_sim *sim, const ts_span *span, double theta)
{
    int nq = sim->m.nq;
    double *ledger = sim->state.y + 2 * nq, clipped = span->clipped;
    for (int i = 0; i < nq && !sim->loads.move; i++) book(ledger, sim->loads.Q[i] * (sim->state.y[i] - sim->ahead.dense[i]));
    if (sim->m.damping_law != TS_TENSION_ONLY && !sim->m.count[TS_K]) return;
    clipped -= ts_clipped_energy(sim, span->start + theta * span->h);
    ledger[0] += clipped;
    ledger[2] += fabs(clipped);
}

/* Put coordinates and rates at theta of the open step. */
static void motion_at(ts_sim *sim, const ts_span *span, double theta)
{
    const ts_method *method = methods[span->method];
    int n = 2 * sim->m.nq;
    TS_ASSERT(theta >= 0.0 && theta <= 1.0 + 1e-9);
    make_dense(sim, method, span->start, span->h);
    method->interpolate(&sim->ahead, theta, 0, n, sim->state.y);
    ts_project(&sim->m, sim->state.y);
    if (sim->m.joint.nodes) ts_put_back(sim, span->start + theta * span->h, sim->state.y);
}

/* The ledger there, after the motion. */
static void ledger_at(ts_sim *sim, const ts_span *span, double theta)
{
    const ts_method *method = methods[span->method];
    int n = 2 * sim->m.nq;
    if (method->flags & TS_LEDGER_IN_STAGES) method->interpolate(&sim->ahead, theta, n, TS_LEDGER, sim->state.y + n);
    else integrate_ledger(sim, method, span, theta, sim->state.y + n);
    settle_ledger(sim, span, theta);
}

static void state_at(ts_sim *sim, const ts_span *span, double theta)
{
    motion_at(sim, span, theta);
    ledger_at(sim, span, theta);
}

static void to_the_end(ts_sim *sim, const ts_span *span)
{
    const ts_method *method = methods[span->method];
    if (!(method->flags & TS_LEDGER_IN_STAGES)) {
        make_dense(sim, method, span->start, span->h);
        integrate_ledger(sim, method, span, 1.0, sim->ahead.y + 2 * sim->m.nq);
    }
    memcpy(sim->state.y, sim->ahead.y, sizeof(double) * (size_t)sim->m.ny);
    settle_ledger(sim, span, 1.0);
}

/* What the last evaluation but those that came after `evaluation` found is that of the state, at tau. */
static void know(ts_sim *sim, int64_t evaluation, double tau)
{
    sim->demand.evaluation = evaluation;
    sim->demand.evaluated_at = tau;
}

/* Derivative at (tau, y) under the present pieces. */
static void restart(ts_sim *sim, double tau)
{
    size_t bytes = sizeof(double) * (size_t)sim->m.count[TS_S];
    ts_rhs(sim, tau, sim->state.y, sim->start.f);
    memcpy(sim->start.elongation, sim->strings.elongation, bytes);
    memcpy(sim->start.rate, sim->strings.rate, bytes);
    know(sim, sim->strings.evaluations, tau);
    sim->linear.ready = 0;
    sim->memory.joined = 0.0;
}

/* An attempt succeeded: find its first transition; the step is open then.  Returns whether the transition is a doubtful one,
 * see events.c. */
static int open_span(ts_sim *sim, const ts_method *method, double tau, double h, int locate)
{
    size_t bytes = sizeof(double) * (size_t)sim->m.count[TS_S];
    ts_span *span = &sim->memory.span;
    if (!(method->flags & TS_ENDS_IN_STAGES)) {
        ts_project(&sim->m, sim->ahead.y);
        if (sim->m.joint.nodes) ts_put_back(sim, tau + h, sim->ahead.y);
        ts_rhs(sim, tau + h, sim->ahead.y, sim->ahead.f);
    }
    sim->call.evaluation = sim->strings.evaluations;
    if (sim->m.count[TS_K])
        memcpy(sim->ground.end, sim->ground.margin, sizeof(double) * TS_WATCHES * (size_t)sim->m.count[TS_K]);
    if (method->accepted) method->accepted(sim, h);
    memcpy(sim->ahead.elongation, sim->strings.elongation, bytes);
    memcpy(sim->ahead.rate, sim->strings.rate, bytes);
    memcpy(sim->ahead.dense, sim->state.y, sizeof(double) * (size_t)sim->m.stride);
    sim->ahead.ready = 0;
    sim->memory.joined = 0.0;
    if (method->flags & TS_ALWAYS_DENSE) make_dense(sim, method, tau, h);
    int which = -1, doubtful = 0;
    double theta = locate ? ts_first_transition(sim, method, tau, h, &which, &doubtful) : -1.0;
    *span = MAKE(ts_span){tau, h, theta >= 0.0 ? theta : 1.0, ts_clipped_energy(sim, tau), which, sim->memory.active};
    return doubtful;
}

/* Take the step again, shorter: positions and velocities on its dense output will agree better.  err_last, stiff: the memory of
 * the control as it was before the step. */
static void retake(ts_memory *memory, double h, double err_last, int stiff)
{
    memory->span.h = memory->joined = 0.0;
    memory->err_last = err_last;
    memory->stiff = stiff;
    memory->h_next = SHRINK * h;
    memory->stats[TS_STEPS]--;
    memory->stats[TS_IMPLICIT_STEPS] -= (methods[memory->active]->flags & TS_IMPLICIT) != 0;
    memory->stats[TS_REJECTED]++;
    memory->rejected++;
}

enum { ENDED, SWITCHED, BROKEN };

/* Go to where the open step ends or its first transition is.  Returns whether there was one; BROKEN: the state there is not
 * finite. */
static int close_span(ts_sim *sim, double tau)
{
    size_t bytes = sizeof(double) * (size_t)sim->m.count[TS_S];
    ts_span span = sim->memory.span;
    sim->memory.span.h = 0.0;
    sim->demand.motion_ahead = sim->demand.ledger_ahead = 0;
    sim->linear.ready = 0;
    if (span.which >= 0) {
        state_at(sim, &span, span.reach);
        if (!ts_all_finite(sim->state.y, 2 * sim->m.nq)) return BROKEN;
        sim->memory.stats[TS_RESTARTS]++;
        ts_switch(sim, tau, span.which);
        restart(sim, tau);
        ts_review_restart(sim, tau, span.reach * span.h);
        return SWITCHED;
    }
    to_the_end(sim, &span);
    memcpy(sim->start.f, sim->ahead.f, sizeof(double) * (size_t)sim->m.stride);
    memcpy(sim->start.elongation, sim->ahead.elongation, bytes);
    memcpy(sim->start.rate, sim->ahead.rate, bytes);
    know(sim, sim->call.evaluation, span.start + span.h);
    ts_review_step(sim, span.h);
    return ENDED;
}

static double span_end(const ts_span *span) { return span->start + span->reach * span->h; }

/* Does the step that the last call left open serve a whole call of length h? */
int ts_span_serves(const ts_span *span, double h) { return span->h > 0.0 && span_end(span) > h * (1.0 + ROUND_OFF); }

/* Go on by that call; the state comes from the dense output, see ts_bring_state(). */
void ts_serve_span(ts_sim *sim, double h)
{
    sim->memory.span.start -= h;
    sim->demand.motion_ahead = sim->demand.ledger_ahead = 1;
}

/* The motion at the communication point where it still is to be taken from the open step. */
void ts_bring_motion(ts_sim *sim)
{
    ts_span *span = &sim->memory.span;
    if (!sim->demand.motion_ahead) return;
    sim->demand.motion_ahead = 0;
    sim->demand.evaluation = -1;
    sim->ahead.ready = 1; /* since the step was opened */
    motion_at(sim, span, -span->start / span->h);
}

/* The whole state. */
void ts_bring_state(ts_sim *sim)
{
    ts_span *span = &sim->memory.span;
    ts_bring_motion(sim);
    if (!sim->demand.ledger_ahead) return;
    sim->demand.ledger_ahead = 0;
    ledger_at(sim, span, -span->start / span->h);
}

/* Go to the end of a step that the last call left open.  0: the state there is broken. */
static int finish_open_span(ts_sim *sim, double end, double *tau)
{
    ts_span *span = &sim->memory.span;
    if (!(span->h > 0.0)) {
        restart(sim, 0.0);
        return 1;
    }
    sim->ahead.ready = 1;
    *tau = fmin(span_end(span), end);
    return close_span(sim, *tau) != BROKEN;
}

/* The step to try: what the controller proposes, or the rest of a fixed grid's interval. */
typedef struct {
    double end, longest;
    int may_run_ahead, ahead; /* steps may end past `end`: as far as the inputs are concerned; by the present method, too */
    int64_t grid, n;          /* fixed steps: how many, and the present one; time is derived from them */
    int splits;               /* transitions located in the present one */
} plan;

static double grid_point(const plan *p, int64_t n) { return n >= p->grid ? p->end : p->end * (double)n / (double)p->grid; }

static double next_step(const ts_sim *sim, const ts_method *method, plan *p, double tau, int *last)
{
    if (method->flags & TS_FIXED_STEP) {
        while (p->n < p->grid && grid_point(p, p->n + 1) <= tau * (1.0 + ROUND_OFF)) p->n++, p->splits = 0;
        *last = p->n + 1 >= p->grid;
        return grid_point(p, p->n + 1) - tau;
    }
    double left = p->end - tau, h = fmin(sim->memory.h_next, p->longest);
    *last = !p->ahead && h >= left * (1.0 - 1e-12);
    if (*last) h = left;
    else if (!p->ahead && h > 0.5 * left) h = 0.5 * left; /* two even steps rather than a long and a short one */
    return h;
}

/* `auto` changes the method, and with it how far a step may go. */
static void look_ahead(const ts_method *method, plan *p)
{
    p->ahead = p->may_run_ahead && !(method->flags & (TS_FIXED_STEP | TS_CLIPPED));
}

static plan make_plan(const ts_sim *sim, double end, int may_run_ahead)
{
    const ts_method *method = methods[sim->memory.active];
    double longest = sim->io.values[sim->m.at[TS_MAX_STEP]];
    int fixed = (method->flags & TS_FIXED_STEP) != 0;
    if (!(longest > 0.0)) longest = fixed ? FIXED_STEP : INFINITY;
    plan p = {end, longest, may_run_ahead, 0, 1, 0, 0};
    if (fixed) p.grid = (int64_t)fmin(fmax(ceil(end / longest * (1.0 - 1e-9)), 1.0), 1e15);
    return p;
}

/* Work of a call so far.  Its unit is what a right-hand side takes for one string or bar, some 15 to 30 ns; all else in that unit
 * was counted in instructions, on two to six bars. */
typedef struct {
    double before; /* the simulation's work when the call began */
    double limit;  /* up to which the present portion lasts */
    double from;   /* s, where the call was when it began */
} budget;

/* What a right-hand side takes, in that unit; a contact about as much as four strings. */
static double parts_of(const ts_model *m) { return 1.0 + m->count[TS_S] + m->count[TS_B] + 4.0 * m->count[TS_K]; }

static double work_done(const ts_sim *sim)
{
    const int64_t *done = sim->memory.stats;
    double parts = parts_of(&sim->m), attempts = (double)(done[TS_STEPS] + done[TS_REJECTED]);
    double solved =
        14.0 * parts * (double)done[TS_JACOBIANS] + 8.0 * sim->linear.pattern.entries * (double)done[TS_FACTORISATIONS];
    return parts * ((double)done[TS_RHS] + 4.0 * attempts) + solved + 4.0 * (double)sim->call.looks;
}

/* Portions of work that a call of this length may take. */
static double portions(double length) { return 1.0 + length / SPAN; }

/* May the call go on?  Each portion must bring it on by its share. */
static int affordable(const ts_sim *sim, budget *b, double tau, double end)
{
    if (work_done(sim) - b->before < b->limit) return 1;
    if ((tau - b->from) * portions(end) < end) return 0;
    b->limit += PORTION;
    b->from = tau;
    return 1;
}

/* Factor of the step by the errors of this one and of the one before (Hairer, Wanner, Solving Ordinary Differential Equations
 * II, section IV.2). */
static double controlled(const ts_method *method, double err, double last)
{
    if (method->smoothing == 0.0) return ts_real_power(err, -method->exponent);
    return ts_real_power(err, 0.75 * method->smoothing - method->exponent) *
           ts_real_power(fmax(last, LEAST_ERROR), method->smoothing);
}

/* Try a step; 1 if it may stand.  The controller's next proposal stands in memory.h_next. */
static int try_step(ts_sim *sim, const ts_method *method, double tau, double h, int last)
{
    ts_memory *memory = &sim->memory;
    memset(sim->strings.sign_changed, 0, sizeof(int32_t) * (size_t)sim->m.count[TS_S]);
    for (int i = 0; sim->m.damping_law == TS_TENSION_ONLY && i < sim->m.count[TS_S]; i++)
        sim->strings.margin_low[i] = INFINITY, sim->strings.margin_high[i] = -INFINITY;
    memcpy(sim->strings.lowest, sim->start.elongation, sizeof(double) * (size_t)sim->m.count[TS_S]);
    memcpy(sim->strings.highest, sim->start.elongation, sizeof(double) * (size_t)sim->m.count[TS_S]);
    TS_ASSERT(h > 0.0 && tau >= 0.0);
    if (sim->m.count[TS_K]) ts_contacts_begin(sim, tau, h, (method->flags & (TS_FIXED_STEP | TS_IMPLICIT)) == TS_FIXED_STEP);
    sim->attempt.shrink = 0.1;
    sim->attempt.growth = method->growth;
    sim->memory.choice.taken = 1.0;
    double err = method->attempt(sim, tau, h);
    if (method->flags & TS_FIXED_STEP && !ts_all_finite(sim->ahead.y, 2 * sim->m.nq)) err = NAN;
    if (!(err <= 1.0)) {
        memory->stats[TS_REJECTED]++;
        memory->h_next = h * (err > 1.0 && err < INFINITY ? fmax(SHRINK, SAFETY * ts_real_power(err, -method->exponent))
                                                          : sim->attempt.shrink);
        sim->memory.rejected++;
        ts_review_rejection(sim);
        return 0;
    }
    double grow =
        err > 0.0 ? fmin(sim->attempt.growth, SAFETY * controlled(method, err, memory->err_last)) : sim->attempt.growth;
    memory->err_last = err;
    if (sim->call.kicked && (!last || h * grow > memory->h_kick))
        memory->h_kick = h * grow / SAFETY; /* as long as just passes */
    if (sim->memory.rejected && grow > 1.0) grow = 1.0;
    if (!last || h * grow > memory->h_next) memory->h_next = h * grow; /* a clipped step says nothing of a longer one */
    if (sim->call.kicked && memory->h_next < sim->call.h_before)
        memory->h_next = fmin(sim->call.h_before, fmax(memory->h_next, RELAX * h));
    sim->call.kicked = 0;
    memory->stats[TS_STEPS]++;
    memory->stats[TS_IMPLICIT_STEPS] += (method->flags & TS_IMPLICIT) != 0;
    return 1;
}

/* Advance from tau = 0 to `end` under given inputs, beyond what ts_serve_span() can give.  The pieces are placed, Qf, Qg and inv
 * prepared. */
int ts_integrate(ts_sim *sim, double end, int may_run_ahead)
{
    ts_memory *memory = &sim->memory;
    double tau = 0.0;
    int stuck = 0;
    plan p = make_plan(sim, end, may_run_ahead);
    int fixed = (methods[memory->active]->flags & TS_FIXED_STEP) != 0;
    look_ahead(methods[memory->active], &p);
    sim->call.length = end;
    sim->call.seen = sim->told.count;
    sim->call.may_run_ahead = may_run_ahead;
    sim->call.kicked = !may_run_ahead && !(methods[memory->active]->flags & (TS_IMPLICIT | TS_FIXED_STEP));
    budget b = {work_done(sim), PORTION, 0.0};
    if ((double)p.grid * parts_of(&sim->m) > 0.125 * PORTION * portions(end)) return fail(sim, TS_WORK_LIMIT);
    sim->call.most = p.longest;
    if (!(memory->h_next > LEAST_STEP * end)) memory->h_next = 0.0; /* a call so much shorter says nothing of this one */
    sim->call.h_before = memory->h_next;
    if (sim->call.kicked && memory->h_kick > 0.0) memory->h_next = fmin(memory->h_next, memory->h_kick);
    if (!finish_open_span(sim, end, &tau)) return fail(sim, TS_NOT_FINITE);
    if (!ts_all_finite(sim->start.f, 2 * sim->m.nq))
        return fail(sim, fixed && memory->stats[TS_STEPS] ? TS_UNSTABLE : TS_NOT_FINITE);
    while (tau < end) {
        if (sim->call.watcher && ts_ends_here(sim, tau)) return TS_OK;
        int last, stiff = memory->stiff;
        double err_last = memory->err_last;
        if (!affordable(sim, &b, tau, end)) return fail(sim, TS_WORK_LIMIT);
        const ts_method *method = methods[memory->active];
        look_ahead(method, &p);
        double most = p.ahead ? p.longest : fmin(end - tau, p.longest);
        if (!fixed && !(memory->h_next > 0.0)) memory->h_next = first_step(sim, method, tau, most);
        double h = next_step(sim, method, &p, tau, &last);
        if (!(h > 4.0 * DBL_EPSILON * (tau + h)) || !(h > LEAST_STEP * end)) return fail(sim, TS_STEP_TOO_SMALL);
        if (!try_step(sim, method, tau, h, last)) {
            if (fixed) return fail(sim, TS_UNSTABLE);
            continue;
        }
        int locate = !sim->call.unlocated && (!method->splits || p.splits < method->splits);
        if (open_span(sim, method, tau, h, locate) && !fixed && memory->rejected < RETAKES) {
            retake(memory, h, err_last, stiff);
            continue;
        }
        memory->rejected = 0;
        double reached = last && memory->span.which < 0 ? end : span_end(&memory->span);
        if (ts_span_serves(&memory->span, end)) {
            make_dense(sim, method, tau, h); /* from the state at the step's start */
            ts_serve_span(sim, end);
            return TS_OK;
        }
        if (end - reached <= ROUND_OFF * end) reached = end; /* no step fits between a transition and the end */
        int how = close_span(sim, reached);
        if (how == BROKEN) return fail(sim, fixed ? TS_UNSTABLE : TS_NOT_FINITE);
        if (how == SWITCHED) {
            stuck = reached > tau ? 0 : stuck + 1;
            p.splits++;
            if (stuck > 4 * (sim->m.count[TS_S] + sim->m.count[TS_K]) + 16)
                return fail(sim, fixed ? TS_UNSTABLE : TS_CHATTERING);
        } else {
            stuck = 0;
            if (!locate && !sim->call.unlocated) {
                ts_catch_up(sim, reached);
                restart(sim, reached);
            }
        }
        TS_ASSERT(reached >= tau && reached <= end);
        tau = reached;
    }
    return TS_OK;
}

/* Of a saved state: numbers that no step will read become zero, so that equal states are equal bytes.  Without an open step that
 * is all about it; else rows and components that its method does not use, and padding. */
void ts_clear_scratch(const ts_sim *sim, ts_memory *memory, char *ahead)
{
    const ts_model *m = &sim->m;
    const size_t one = sizeof(double), stride = (size_t)m->stride, lanes = (size_t)m->lanes, S = (size_t)m->count[TS_S];
    if (!(memory->span.h > 0.0)) {
        memset(&memory->span, 0, sizeof memory->span);
        memory->joined = 0.0;
        memset(ahead, 0, one * sim->ahead.size);
        return;
    }
    const ts_method *method = methods[memory->span.method];
    const size_t ny = (size_t)m->ny, used = method->flags & TS_LEDGER_IN_STAGES ? ny : 2 * (size_t)m->nq;
    for (size_t row = 0; row < 10; row++) { /* the state at the start, dense output, the end, the derivative there */
        size_t kept = row == 0 || row == 9 ? ny : row < (size_t)method->rows || row == 8 ? used : 0;
        memset(ahead + one * (row * stride + kept), 0, one * (stride - kept));
    }
    for (size_t k = 0; k < 2; k++) memset(ahead + one * (10 * stride + k * lanes + S), 0, one * (lanes - S));
}

/* Inputs change: the state at the communication point is the one to go on from. */
void ts_close_span(ts_sim *sim) { sim->memory.span.h = 0.0; }
