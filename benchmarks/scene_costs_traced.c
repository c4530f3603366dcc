/* The kernel's stepping loop with a clock around what a transition costs; compiled in the place of integrate.c.
 *
 * From the call that finds a transition on the dense output, by way of the state there, the switch of the string and the new
 * derivative, to the last thing that the loop does before it steps on. */
#define _POSIX_C_SOURCE 199309L
#include "internal.h"

#include <time.h>

int tracing;    /* the clock runs */
double traced;  /* s, sum over all transitions */
static double began;

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double first_transition(ts_sim *sim, const ts_method *method, double tau, double h, int *which)
{
    if (!tracing) return ts_first_transition(sim, method, tau, h, which);
    double start = now(), theta = ts_first_transition(sim, method, tau, h, which);
    if (theta >= 0.0) began = start;
    return theta;
}

static void review_restart(ts_sim *sim, double tau)
{
    ts_review_restart(sim, tau);
    if (tracing) traced += now() - began;
}

#define ts_first_transition first_transition
#define ts_review_restart review_restart
#include "integrate.c"
