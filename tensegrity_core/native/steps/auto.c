/* `auto` chooses by what simulated time costs: the work of a step over its length, as each of its methods was last seen to
 * do it in this run. Methods that are not in use are tried again, at intervals that grow while they lose.
 *
 * While the explicit method is in use, an implicit one is tried when an interval of work is over, or after some steps that
 * stability limits. A phase of implicit steps ends when they are not worth their cost, when the explicit method proves
 * better in a trial of its own, or at a transition that makes a damper's force jump: through the transient explicit steps
 * are cheaper. What the phase did for its work, against what explicit steps would have done, decides how soon the next one
 * may begin. */
#include "steps/auto.h"
#include "linear/power.h"
#include "model/data.h"
#include "motion/motion.h"

#include <math.h>

#define BOLD 4.0      /* first implicit step over the last explicit one */
#define TRIAL 4       /* steps that are a trial */
#define LENIENT 2.0   /* times the other's cost that a method may take meanwhile: its steps grow */
#define LOSSES 2      /* implicit steps in a row not worth their cost that end a phase */
#define WHOLE_CALLS 2 /* that a trial between the explicit methods lasts */
#define RARELY 50.0   /* times its work until the next one, at most */
#define AGAIN 5.0     /* the same after one that was won */
#define SHORTER 2.0   /* dopri5's step over dop853's, at a tolerance of 1, at best */
#define STEADY 1.5    /* steps that grow by more are not compared yet */
#define CALM 0.3      /* h lambda below which stability is far away; implicit methods then hardly ever win */
#define CALMER 8.0    /* factor of their intervals there */
#define CUT 2.0       /* factor of their intervals where steps end at transitions */
#define HOPE 3.0      /* explicit steps may be so much longer than when last seen */
#define PATIENCE 3    /* signs of stiffness that make `auto` leave the explicit method */
#define MOST_PATIENCE 96
#define FADE 0.2   /* weight of the last step in means */
#define TIGHT 1e-8 /* tolerance from which on radau9 is the first to be tried */
#define FINE 16.0  /* explicit steps in a communication step that is a short one */

/* Intervals between trials, in steps of the method to try: the first, after a phase that paid or none; between methods of
 * which both do well; the longest, so that trials take a few hundredths of the work; growth of an interval when the trial
 * was lost, and when a phase was: motion that dies away is soon worth implicit steps, and slow growth finds that out. */
#define SOON 6.0
#define LATER 15.0
#define RAREST 50.0
#define RARER 2.0
#define RARER_PHASE 1.5

enum { LONG, ROSENBROCK, RADAU, SHORT };                       /* places of the methods; the explicit ones by their steps */
enum { OF_IMPLICIT, OF_OTHER_IMPLICIT, OF_EXPLICIT, OF_BASE }; /* trials */

/* The methods, by their places.  An attempt of usual effort costs so many steps of dop853: `steps`, and `solves` for each
 * number in the blocks of the factor over the strings, which are the work of the right-hand side; measured on scenes of two to
 * thirty bars.  `reach`: h times the fastest rate that an explicit one bears. */
static const struct {
    int32_t method;
    double steps, solves, reach;
} choices[TS_CHOICES] = {
    {TS_METHOD_DOP853, 1.0, 0.0, 6.0},
    {TS_METHOD_RODAS5P, 1.2, 0.045, 0.0},
    {TS_METHOD_RADAU9, 1.6, 0.155, 0.0},
    {TS_METHOD_DOPRI5, 0.55, 0.0, 3.3},
};

static int is_explicit(int place) { return place == LONG || place == SHORT; }

/* The place of the method in use; TS_CHOICES: it is none of these. */
static int place_in_use(const ts_memory *memory)
{
    int place = 0;
    while (place < TS_CHOICES && choices[place].method != memory->active) place++;
    return place;
}

static int other_implicit(int place) { return ROSENBROCK + RADAU - place; }

static double cost_of(const ts_sim *sim, int place)
{
    int D = sim->m.count[TS_D], S = sim->m.count[TS_S];
    double blocks = (double)(D * D) * sim->linear.pattern.entries / (S > 0 ? S : 1);
    return choices[place].steps + choices[place].solves * blocks;
}

/* The longest step that a method may take in the present call, s: those of rodas5p and dopri5 end at communication points. */
static double longest(const ts_sim *sim, int place)
{
    return place == ROSENBROCK || place == SHORT || !sim->call.may_run_ahead ? fmin(sim->call.most, sim->call.length)
                                                                             : sim->call.most;
}

/* Work per simulated second with steps of length h, failed attempts included; where a call ends at its communication
 * point, whole steps count. */
static double price(const ts_sim *sim, int place, double h)
{
    double most = longest(sim, place), work = cost_of(sim, place) * sim->memory.choice.effort[place];
    return work * (most < INFINITY ? ceil(most / h * (1.0 - 1e-9)) / most : 1.0 / h);
}

static double known_price(const ts_sim *sim, int place) { return price(sim, place, sim->memory.choice.natural[place]); }
static double best_price(const ts_sim *sim, int place) { return price(sim, place, longest(sim, place)); }

static void use(ts_memory *memory, int place, double h)
{
    ts_choice *c = &memory->choice;
    memory->active = choices[place].method;
    memory->h_next = h;
    memory->h_kick = 0.0;
    memory->stiff = 0;
    if (!is_explicit(place)) c->effort[place] = 1.0; /* what it was belongs to another time */
    c->losing = c->steps = 0;
    c->trial_time = c->trial_work = c->failed = 0.0;
}

static void plan_trial(ts_choice *c, int trial, double interval)
{
    c->interval[trial] = fmin(interval, RAREST);
    c->since[trial] = c->work;
}

/* Is it time for a trial of a method of this cost? */
static int due(const ts_choice *c, int trial, double cost) { return c->work - c->since[trial] >= c->interval[trial] * cost; }

/* At the start of a run. */
void ts_start_choice(ts_memory *memory)
{
    ts_choice *c = &memory->choice;
    memory->patience = PATIENCE;
    c->incumbent = c->rival = -1;
    c->base = LONG;
    for (int place = 0; place < TS_CHOICES; place++) c->effort[place] = 1.0;
    plan_trial(c, OF_IMPLICIT, SOON);
    plan_trial(c, OF_OTHER_IMPLICIT, LATER);
    plan_trial(c, OF_EXPLICIT, LATER);
    plan_trial(c, OF_BASE, SOON);
}

/* Of a restored state: are the methods that it names there? */
int ts_choice_is_possible(const ts_memory *memory)
{
    const ts_choice *c = &memory->choice;
    int chosen = memory->method != TS_METHOD_AUTO || place_in_use(memory) < TS_CHOICES;
    chosen = chosen && is_explicit(c->base) && (c->rival == -1 || is_explicit(c->rival));
    return chosen && c->incumbent >= -1 && c->incumbent < TS_CHOICES && c->preferred >= 0 && c->preferred < SHORT;
}

/* Could steps of a method be cheaper than explicit ones of length h at all? */
static int promising(const ts_sim *sim, int place, double h)
{
    return best_price(sim, place) < price(sim, sim->memory.choice.base, h);
}

/* Which implicit method: the one that did well last, or the one that did not fail last; before that, radau9 where its
 * order pays, or where communication points, which its steps pass, are not far apart against an explicit step h. */
static int choose_implicit(const ts_sim *sim, double h)
{
    int fine = sim->call.may_run_ahead && sim->call.length < FINE * h, place = sim->memory.choice.preferred;
    if (!place) place = fine || sim->io.values[sim->m.at[TS_TOLERANCE]] < TIGHT ? RADAU : ROSENBROCK;
    return promising(sim, place, h) ? place : other_implicit(place);
}

static void begin_phase(ts_memory *memory, int place, double h)
{
    ts_choice *c = &memory->choice;
    c->phase_time = c->phase_work = 0.0;
    c->phase_steps = 0;
    use(memory, place, BOLD * h);
}

/* The other explicit method takes over, for a trial, or for good. */
static void change_base(ts_memory *memory, int place, double h, int trial)
{
    memory->choice.rival = trial ? memory->choice.base : -1;
    memory->choice.base = place;
    use(memory, place, h);
}

/* An explicit method on trial against the other took a step.  Steps differ within a call, so whole calls are compared. */
static void judge_base(ts_sim *sim)
{
    ts_choice *c = &sim->memory.choice;
    double span = fmax(c->trial_time, WHOLE_CALLS * sim->call.length);
    int ended = c->steps >= TRIAL && c->trial_time >= span,
        lost = c->trial_work > span * c->rival_price * (ended ? 1.0 : LENIENT);
    if (!ended && !lost) return;
    c->interval[OF_BASE] = lost ? fmin(RARER * c->interval[OF_BASE], RARELY * c->trial_work) : AGAIN * c->trial_work;
    c->since[OF_BASE] = c->work;
    if (lost) change_base(&sim->memory, c->rival, c->natural[c->rival], 0);
    c->rival = -1;
    c->trial_time = c->trial_work = 0.0;
}

/* The step that dopri5 may be hoped to take, from that of dop853: of the same error, by their orders. */
static double hoped_short(const ts_sim *sim, double h)
{
    double tolerance = sim->io.values[sim->m.at[TS_TOLERANCE]];
    return SHORTER * ts_real_power(tolerance, 1.0 / 5.0 - 1.0 / 8.0) * fmax(h, sim->memory.h_next);
}

/* Two explicit methods: dopri5 where steps have to be short, as communication points with other inputs lie close together, if
 * that is cheaper.  Returns whether the choice between the two is under way, or has just been made. */
static int review_base(ts_sim *sim, double h)
{
    ts_choice *c = &sim->memory.choice;
    int other = LONG + SHORT - c->base, ahead = sim->call.may_run_ahead;
    if (ahead && c->base == SHORT) {
        change_base(&sim->memory, LONG, fmax(c->natural[LONG], h), 0);
        return 1;
    }
    if (c->rival >= 0) {
        judge_base(sim);
        return 1;
    }
    if (ahead || !due(c, OF_BASE, 1.0) || !(c->trial_time >= WHOLE_CALLS * sim->call.length)) return 0;
    double here = c->trial_work / c->trial_time, natural = c->natural[other];
    double hoped = other == LONG ? price(sim, LONG, HOPE * natural) : price(sim, SHORT, hoped_short(sim, h));
    if (!(hoped < here)) {
        c->since[OF_BASE] = c->work;
        c->trial_time = c->trial_work = 0.0;
        return 0;
    }
    c->rival_price = here;
    change_base(&sim->memory, other, other == LONG ? natural : h, 1);
    return 1;
}

/* The explicit method took a step of length h. */
static void review_explicit(ts_sim *sim, double h)
{
    ts_choice *c = &sim->memory.choice;
    if (review_base(sim, h)) return;
    int place = choose_implicit(sim, h);
    double cost = cost_of(sim, place) * (c->h_lambda < CALM ? CALMER : 1.0);
    int steady = sim->memory.h_next <= STEADY * h;
    if (sim->memory.stiff < sim->memory.patience && !(steady && due(c, OF_IMPLICIT, cost))) return;
    if (promising(sim, place, h)) begin_phase(&sim->memory, place, h);
}

/* The explicit method's step ended at a transition.  Where hardly any step ends otherwise (a damper that sets in and out while
 * stability limits the steps), what the steps came to on average since the last phase counts. */
static void review_cut(ts_sim *sim)
{
    ts_choice *c = &sim->memory.choice;
    double mean = c->trial_work > 0.0 ? cost_of(sim, c->base) * c->effort[c->base] * c->trial_time / c->trial_work : 0.0;
    if (!(mean > 0.0)) return;
    int place = choose_implicit(sim, mean);
    if (!due(c, OF_IMPLICIT, CUT * cost_of(sim, place)) || !promising(sim, place, mean)) return;
    c->natural[c->base] = mean;
    begin_phase(&sim->memory, place, mean);
}

/* The explicit method goes on with a step of length h; `place` was the implicit method in use. */
static void end_phase(ts_sim *sim, int place, double h)
{
    ts_choice *c = &sim->memory.choice;
    int paid = c->phase_work <= c->phase_time * known_price(sim, c->base), more = 3 * sim->memory.patience;
    c->preferred = paid ? place : other_implicit(place);
    c->incumbent = -1;
    sim->memory.patience = paid ? PATIENCE : more < MOST_PATIENCE ? more : MOST_PATIENCE;
    plan_trial(c, OF_IMPLICIT, paid ? SOON : RARER_PHASE * c->interval[OF_IMPLICIT]);
    use(&sim->memory, c->base, h);
}

/* A trial between methods within a phase ends. */
static void end_trial(ts_memory *memory, int trial, int lost)
{
    ts_choice *c = &memory->choice;
    int back = c->incumbent;
    plan_trial(c, trial, RARER * c->interval[trial]);
    c->incumbent = -1;
    if (lost) use(memory, back, c->natural[back]);
}

/* The explicit method is on trial within a phase. */
static void judge_explicit(ts_sim *sim)
{
    ts_choice *c = &sim->memory.choice;
    if (c->steps < TRIAL) return;
    if (known_price(sim, c->base) < known_price(sim, c->incumbent)) end_phase(sim, c->incumbent, sim->memory.h_next);
    else end_trial(&sim->memory, OF_EXPLICIT, 1);
}

/* An implicit method took a step of length h. */
static void review_implicit(ts_sim *sim, int place, double h)
{
    ts_choice *c = &sim->memory.choice;
    int other = other_implicit(place), young = c->phase_steps < TRIAL;
    double here = known_price(sim, place), explicit_price = known_price(sim, c->base);
    double next = fmin(sim->memory.h_next, longest(sim, place));
    c->losing = here > explicit_price * (young ? LENIENT : 1.0) ? c->losing + 1 : 0;
    if (c->losing >= LOSSES) {
        end_phase(sim, place, fmin(sim->memory.h_next, c->natural[c->base]));
    } else if (c->incumbent >= 0) {
        double rival = known_price(sim, c->incumbent);
        if (c->steps < TRIAL && here <= LENIENT * rival) return;
        end_trial(&sim->memory, OF_OTHER_IMPLICIT, c->trial_work > c->trial_time * rival);
    } else if (young || next > STEADY * h) {
        return;
    } else if (due(c, OF_OTHER_IMPLICIT, cost_of(sim, other)) && best_price(sim, other) < here) {
        c->incumbent = place;
        use(&sim->memory, other, next);
    } else if (due(c, OF_EXPLICIT, cost_of(sim, place)) && price(sim, c->base, HOPE * c->natural[c->base]) < here) {
        c->incumbent = place;
        use(&sim->memory, c->base, c->natural[c->base]);
    }
}

/* An attempt was made, and advanced by h; 0: it failed. */
static void count(ts_sim *sim, int place, double h)
{
    ts_choice *c = &sim->memory.choice;
    double work = cost_of(sim, place) * c->taken;
    c->work += work;
    c->phase_work += work;
    c->trial_work += work;
    c->phase_time += h;
    c->trial_time += h;
    c->failed = h > 0.0 ? 0.0 : c->failed + c->taken;
}

/* A step of length h was taken without a transition. */
void ts_review_step(ts_sim *sim, double h)
{
    ts_choice *c = &sim->memory.choice;
    if (sim->memory.method != TS_METHOD_AUTO) return;
    int place = place_in_use(&sim->memory);
    c->effort[place] += FADE * (c->taken + c->failed - c->effort[place]);
    c->natural[place] = is_explicit(place) ? h : sim->memory.h_next;
    c->steps += c->steps < INT32_MAX;
    c->phase_steps += c->phase_steps < INT32_MAX;
    count(sim, place, h);
    if (!is_explicit(place)) review_implicit(sim, place, h);
    else if (c->incumbent >= 0) judge_explicit(sim);
    else review_explicit(sim, h);
}

/* An attempt failed; the next one is to be h_next long. */
void ts_review_rejection(ts_sim *sim)
{
    ts_choice *c = &sim->memory.choice;
    if (sim->memory.method != TS_METHOD_AUTO) return;
    int place = place_in_use(&sim->memory);
    double h = sim->memory.h_next;
    count(sim, place, 0.0);
    if (is_explicit(place)) return;
    if (c->incumbent >= 0) {
        if (price(sim, place, h) > LENIENT * known_price(sim, c->incumbent)) end_trial(&sim->memory, OF_OTHER_IMPLICIT, 1);
    } else if (price(sim, place, h) > known_price(sim, c->base)) {
        end_phase(sim, place, fmin(h, c->natural[c->base]));
    }
}

/* An explicit step for the transient after a jump of forces: half of what stability allows at the rate of the derivative's own
 * change. */
static double transient_step(ts_sim *sim, double tau)
{
    int ny = sim->m.ny;
    double tolerance = sim->io.values[sim->m.at[TS_TOLERANCE]], next = sim->memory.h_next;
    double speed = ts_error_norm(sim, sim->start.f, sim->state.y, sim->state.y) * tolerance, h = 1e-4 / speed;
    if (!(h > 0.0 && h < next)) return next;
    for (int i = 0; i < ny; i++) sim->ahead.y[i] = sim->state.y[i] + h * sim->start.f[i];
    ts_rhs(sim, tau + h, sim->ahead.y, sim->ahead.f);
    for (int i = 0; i < ny; i++) sim->attempt.error[i] = sim->ahead.f[i] - sim->start.f[i];
    double rate = ts_error_norm(sim, sim->attempt.error, sim->state.y, sim->state.y) * tolerance / (h * speed);
    return fmin(next, 0.5 * choices[sim->memory.choice.base].reach / rate);
}

/* A transition was carried out after a length h of the step; f0 is the derivative after it. */
void ts_review_restart(ts_sim *sim, double tau, double h)
{
    ts_choice *c = &sim->memory.choice;
    if (sim->memory.method != TS_METHOD_AUTO) return;
    int place = place_in_use(&sim->memory);
    count(sim, place, h);
    if (is_explicit(place) && c->incumbent < 0) {
        if (c->rival < 0) review_cut(sim);
    } else if (!sim->call.force_jumps) return;
    else if (!is_explicit(place)) end_phase(sim, place, transient_step(sim, tau));
    else end_phase(sim, c->incumbent, sim->memory.h_next);
}
