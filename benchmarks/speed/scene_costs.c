/* What the parts of a step cost: functions of a library that benchmarks/speed/scene_costs.py calls, compiled with the kernel's own
 * sources and flags, and with scene_costs_traced.c in the place of integrate.c.  Times are processor times, s. */
#include "../harness/clock.h"

#include "methods/systems.h"
#include "model/data.h"
#include "motion/jacobian.h"
#include "motion/motion.h"
#include "tensegrity.h"

#include <stdlib.h>
#include <string.h>

#define EVICTED (128 << 20) /* bytes to walk through, more than caches hold */
#define RATE 1e4            /* 1/s, `a` of the matrices that are factorised */

static void rhs(ts_sim *sim) { ts_rhs(sim, 0.0, sim->state.y, sim->start.f); }
static void factorise(ts_sim *sim) { ts_stage_factorise(sim, RATE); }
static void pair_factorise(ts_sim *sim) { ts_pair_factorise(sim, 0, RATE, RATE); }

/* Anew, although the kernel keeps the one that is at hand. */
static void jacobian(ts_sim *sim)
{
    sim->linear.ready = 0;
    ts_rhs_jacobian(sim, 0.0, sim->state.y);
}

/* Solutions replace their right-hand side, which is therefore put back: repeated solutions fade to numbers that are slow. */
static void solve(ts_sim *sim)
{
    memcpy(sim->attempt.k, sim->start.f, sizeof(double) * (size_t)sim->m.stride);
    ts_stage_solve(sim, RATE, sim->attempt.k);
}

static void pair_solve(ts_sim *sim)
{
    double *second = sim->attempt.k + sim->m.stride;
    memcpy(sim->attempt.k, sim->start.f, sizeof(double) * (size_t)sim->m.stride);
    memcpy(second, sim->start.f, sizeof(double) * (size_t)sim->m.stride);
    ts_pair_solve(sim, 0, RATE, RATE, sim->attempt.k, second);
}

/* As the names PARTS in scene_costs.py. */
static void (*const parts[])(ts_sim *) = {rhs, jacobian, factorise, solve, pair_factorise, pair_solve};

/* Whether the matrices of the present state, on which the other parts work, can be factorised. */
TS_API int prepare_parts(ts_sim *sim)
{
    jacobian(sim);
    return ts_stage_factorise(sim, RATE) && ts_pair_factorise(sim, 0, RATE, RATE);
}

/* Of so many calls, one after the other. */
TS_API double time_part(ts_sim *sim, int part, int64_t count)
{
    double start = now();
    for (int64_t i = 0; i < count; i++) parts[part](sim);
    return now() - start;
}

/* Of one call, after the caches were emptied; negative: out of memory. */
TS_API double time_cold_part(ts_sim *sim, int part)
{
    static volatile char *walk;
    if (!walk && !(walk = calloc(EVICTED, 1))) return -1.0;
    for (size_t i = 0; i < EVICTED; i += 64) walk[i]++;
    return time_part(sim, part, 1);
}

TS_API int block_count(const ts_sim *sim) { return sim->linear.pattern.count; }
