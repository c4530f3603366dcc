/* `auto`: the explicit method until its steps span a good part of the fastest decay; then an implicit one for as long as its
 * steps are worth their cost.  After a transition that makes a damper's force jump the explicit method goes first: it is the
 * cheaper one through the transient, and finds out in a few steps whether the rest is stiff. */
#include "internal.h"

#include <math.h>

#define REACH 6.0       /* h times the fastest rate that dop853 bears */
#define BOLD 4.0        /* first implicit step over the last explicit one */
#define CALM_SIGNS 2    /* implicit steps not worth their cost after which the explicit method returns */
#define MAX_PATIENCE 96 /* signs of stiffness that it takes after excursions that were not worth it */
#define TIGHT 2e-6      /* tolerance from which on the order of radau9 pays */
#define FINE 4.0        /* explicit steps in a communication step that is a short one */

/* How many explicit steps an implicit one costs: measured on scenes of two to six bars and on towers, and fitted to the
 * blocks of the factor (its solves) over the strings (the right-hand side). */
static double cost_of(const ts_sim *sim, int method)
{
    int D = sim->m.count[TS_D], S = sim->m.count[TS_S];
    double of_radau9 = 1.8 + 0.16 * D * D * sim->pattern.entries / (S > 0 ? S : 1);
    return method == TS_METHOD_RADAU9 ? of_radau9 : 1.2 + 0.2 * of_radau9;
}

/* Steps of length h in what the present call allows: a whole number where it ends at its communication point, else per second. */
static double steps(const ts_sim *sim, double h) { return sim->longest < INFINITY ? ceil(sim->longest / h) : 1.0 / h; }

/* Are implicit steps of length h worth their cost, against explicit ones of the other length? */
static int worth(const ts_sim *sim, int method, double h, double explicit_step)
{
    return steps(sim, h) * cost_of(sim, method) <= steps(sim, explicit_step);
}

static void return_to_explicit(ts_memory *memory, double h)
{
    memory->active = TS_METHOD_DOP853;
    memory->h_next = fmin(memory->h_next, h);
    memory->stiff = 0;
}

/* The order of radau9 pays at tight tolerances; and its steps pass communication points, which those of rodas5p do not: that is
 * worth more where these points are not far apart against an explicit step h. */
static int choose_implicit(const ts_sim *sim, double h)
{
    int fine = sim->may_run_ahead && sim->call < FINE * h;
    return fine || sim->values[sim->m.at[TS_TOLERANCE]] <= TIGHT ? TS_METHOD_RADAU9 : TS_METHOD_RODAS5P;
}

/* A step was taken without a transition. */
void ts_review_method(ts_sim *sim, double h)
{
    ts_memory *memory = &sim->memory;
    if (memory->method != TS_METHOD_AUTO) return;
    if (memory->active == TS_METHOD_DOP853) {
        int implicit = choose_implicit(sim, h);
        if (memory->stiff < memory->patience) return;
        if (!worth(sim, implicit, sim->longest, h)) return;
        memory->active = implicit;
        memory->h_explicit = h;
        memory->h_next = fmax(memory->h_next, BOLD * h);
        memory->stiff = memory->worthwhile = 0;
        return;
    }
    memory->worthwhile |= worth(sim, memory->active, h, memory->h_explicit);
    memory->stiff = worth(sim, memory->active, memory->h_next, memory->h_explicit) ? 0 : memory->stiff + 1;
    if (memory->stiff < CALM_SIGNS) return;
    int longer = 4 * memory->patience < MAX_PATIENCE ? 4 * memory->patience : MAX_PATIENCE;
    memory->patience = memory->worthwhile ? TS_PATIENCE : longer;
    return_to_explicit(memory, memory->h_explicit);
}

/* Several attempts in a row failed: a transient, which small explicit steps resolve at less cost. */
void ts_review_rejection(ts_sim *sim)
{
    ts_memory *memory = &sim->memory;
    if (memory->method != TS_METHOD_AUTO || memory->active == TS_METHOD_DOP853 || sim->memory.rejected < 2) return;
    return_to_explicit(memory, memory->h_explicit);
}

/* A transition was carried out; f0 is the derivative after it. */
void ts_review_restart(ts_sim *sim, double tau)
{
    ts_memory *memory = &sim->memory;
    int ny = sim->m.ny;
    if (memory->method != TS_METHOD_AUTO || memory->active == TS_METHOD_DOP853 || !sim->force_jumps) return;
    double tolerance = sim->values[sim->m.at[TS_TOLERANCE]];
    double speed = ts_error_norm(sim, sim->f0, sim->y, sim->y) * tolerance, h = 1e-4 / speed;
    if (!(h > 0.0 && h < memory->h_next)) {
        return_to_explicit(memory, memory->h_next);
        return;
    }
    for (int i = 0; i < ny; i++) sim->y1[i] = sim->y[i] + h * sim->f0[i];
    ts_rhs(sim, tau + h, sim->y1, sim->f1);
    for (int i = 0; i < ny; i++) sim->err[i] = sim->f1[i] - sim->f0[i];
    double rate = ts_error_norm(sim, sim->err, sim->y, sim->y) * tolerance / (h * speed); /* of the transient */
    return_to_explicit(memory, 0.5 * REACH / rate);
}
