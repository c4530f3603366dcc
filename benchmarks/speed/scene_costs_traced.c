/* The kernel's stepping loop with a clock around what a transition costs, and a count of the attempts that are lost by it;
 * compiled in the place of integrate.c.
 *
 * Clock: from the search on the dense output that finds a transition, by way of the state there, the switch of the string and
 * the new derivative, to the last thing that the loop does before it steps on; less what reading the clock takes.
 *
 * Attempts lost: the step with the transition goes only part of its way, and those after the new start are short or rejected
 * until one is as long again.  Lost are the attempts of that time, less as many steps of the former length as cover it. */
#include "../harness/clock.h"

#include "model/data.h"
#include "steps/auto.h"
#include "steps/events.h"

#include <math.h>

static int tracing;                          /* clock and count run */
static double traced, lost;                  /* s and attempts, sums over all transitions of a run */
static double began, clock_takes = INFINITY; /* s */
static double start, length, former;         /* s: of the present step, its length, and that before the transition */
static int64_t counted;                      /* attempts so far */
static int recovering;                       /* steps are still shorter than before the transition */

static void trace_anew(void)
{
    traced = lost = 0.0;
    recovering = 0;
    counted = 0;
    for (int i = 0; i < 10; i++) {
        double first = now();
        clock_takes = fmin(clock_takes, now() - first);
    }
}

static double share(double h) { return fmin(h / former, 1.0); }

static void search_begins(const ts_sim *sim, double tau, double h)
{
    int64_t attempts = sim->memory.stats[TS_STEPS] + sim->memory.stats[TS_REJECTED];
    if (!tracing) return;
    if (recovering) lost += (double)(attempts - counted) - share(h);
    if (recovering && h >= former) recovering = 0;
    counted = attempts;
    start = tau;
    length = h;
    began = now();
}

static void restart_ends(double tau)
{
    if (!tracing) return;
    traced += now() - began - clock_takes;
    if (!recovering) former = length;
    lost += share(start + length - tau);
    recovering = 1;
}

#define ts_first_transition(sim, method, tau, h, ...) \
    (search_begins(sim, tau, h), ts_first_transition(sim, method, tau, h, __VA_ARGS__))
#define ts_review_restart(sim, tau, h) (ts_review_restart(sim, tau, h), restart_ends(tau))
#include "steps/integrate.c"

/* Of one call of ts_step(), s, or negative where it fails; trace: sums over its transitions, s and attempts, or NULL for none. */
TS_API double time_step(ts_sim *sim, double h, double trace[2])
{
    trace_anew();
    tracing = trace != NULL;
    double begin = now();
    int status = ts_step(sim, h);
    double spent = now() - begin;
    if (trace) trace[0] = traced, trace[1] = lost;
    return status ? -1.0 : spent;
}
