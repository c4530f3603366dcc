/* Outputs on demand: what nobody reads is not computed.
 *
 * A step that leaves outputs out tells nobody that one of them is not finite.  So it leaves them out only where no number of state,
 * inputs and parameters is so large that an output could overflow; else it fills and checks them all. */
#include "interface/demand.h"
#include "interface/applied.h"
#include "interface/checks.h"
#include "interface/ready.h"
#include "model/data.h"
#include "motion/motion.h"
#include "motion/outputs.h"
#include "steps/integrate.h"
#include "tensegrity.h"

#include <string.h>

#define MODERATE 1e30 /* sum of the sizes: in SI units, far beyond any structure, and its powers are numbers still */

/* The group of every number of the blocks. */
void ts_group_outputs(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    const struct {
        int end, group;
    } parts[] = {{m->n_applied, 0},
                 {m->at[TS_STRING_FORCE], TS_OF_MOTION},
                 {m->at[TS_WOUND_REST_LENGTH], TS_OF_FORCES},
                 {m->at[TS_BAR_FORCE], TS_OF_MOTION},
                 {m->at[TS_KINETIC], TS_OF_FORCES},
                 {m->at[TS_DISSIPATED], TS_OF_ENERGIES},
                 {m->n_real, TS_OF_WORK},
                 {m->n_real + m->int_at[TS_INT_SNAPPED], 0},
                 {m->n_real + m->n_int, TS_OF_MOTION}};
    int i = 0;
    for (size_t p = 0; p < sizeof parts / sizeof *parts; p++)
        for (; i < parts[p].end; i++) sim->demand.group[i] = (uint8_t)parts[p].group;
}

/* Outputs at the last communication point, under the inputs and parameters of the last step, which are at hand; mostly an
 * integrator ended there, and left what they need. */
static void compute(ts_sim *sim, int groups)
{
    ts_demand *demand = &sim->demand;
    const double tau = sim->memory.last_step;
    if (groups & TS_OF_FORCES) groups |= TS_OF_MOTION; /* bar forces need it */
    if (groups & TS_OF_WORK) ts_bring_state(sim);
    else ts_bring_motion(sim);
    int known = demand->evaluation == sim->strings.evaluations && demand->evaluated_at == tau;
    if (!known && groups & (TS_OF_FORCES | TS_OF_ENERGIES)) {
        ts_rhs(sim, tau, sim->state.y, sim->start.f);
        sim->memory.stats[TS_RHS]--; /* not the integrator's: counts are the same, whoever reads */
        demand->evaluation = sim->strings.evaluations;
        demand->evaluated_at = tau;
    } else if (!known) {
        ts_move_nodes(sim, tau, sim->state.y);
    }
    ts_outputs(sim, tau, groups);
    demand->stale &= ~groups;
}

/* Are no numbers here so large that an output could overflow? */
static int is_moderate(const ts_sim *sim)
{
    const ts_model *m = &sim->m;
    const int n = 2 * m->nq;
    double size = ts_size(sim->io.values, m->n_applied) + ts_size(sim->io.slopes, 2 * m->n_inputs);
    size += ts_size(sim->start.f, n);
    if (sim->memory.span.h > 0.0) /* where the open step begins and ends */
        size += ts_size(sim->ahead.dense, m->ny) + ts_size(sim->ahead.y, m->ny) + ts_size(sim->ahead.f, n);
    else size += ts_size(sim->state.y, m->ny);
    return size < MODERATE;
}

static int fill(ts_sim *sim, int groups)
{
    sim->demand.stale = TS_OF_ALL;
    if (!groups) return TS_OK;
    compute(sim, groups);
    return ts_check_outputs(sim, groups, "at the end of the step");
}

/* A step has ended.  Where inputs jumped they will jump again, and that needs the energies before.  Who read everything after the
 * last step will do so again. */
int ts_fill_after_step(ts_sim *sim, int inputs_jumped)
{
    const int left_out = sim->demand.reads_all ? 0 : sim->demand.left_out;
    sim->demand.reads_all = 0;
    sim->demand.moderate = left_out && is_moderate(sim);
    if (!sim->demand.moderate) return fill(sim, TS_OF_ALL);
    return fill(sim, TS_OF_ALL & ~(inputs_jumped ? left_out & ~TS_OF_ENERGIES : left_out));
}

/* A step has ended within one that the integrator left open. */
int ts_fill_within_step(ts_sim *sim)
{
    const int left_out = sim->demand.left_out;
    return fill(sim, left_out && sim->demand.moderate ? TS_OF_ALL & ~left_out : TS_OF_ALL);
}

int ts_fill(ts_sim *sim, int groups)
{
    const size_t values = sizeof(double) * (size_t)sim->m.n_applied, slopes = 2 * sizeof(double) * (size_t)sim->m.n_inputs;
    groups &= sim->demand.stale;
    if (!groups) return TS_OK;
    if (ts_started(sim) != TS_OK) return TS_BAD_STEP;
    int same = !memcmp(sim->io.values, sim->io.applied, values) && !memcmp(sim->io.slopes, sim->io.applied_slopes, slopes);
    ts_bring_motion(sim);
    if (!same) {
        ts_swap_applied(sim);
        ts_derive(sim);
    }
    compute(sim, groups);
    if (!same) ts_swap_inputs_back(sim);
    return ts_check_outputs(sim, groups, "at the end of the step");
}

int ts_fill_at(ts_sim *sim, const uint32_t *places, size_t count)
{
    const int stale = sim->demand.stale;
    int groups = 0;
    sim->demand.reads_all = count >= (size_t)(sim->m.n_real - sim->m.n_applied);
    const uint32_t end = (uint32_t)(sim->m.n_real + sim->m.n_int);
    for (size_t i = 0; i < count && stale & ~groups; i++)
        if (places[i] < end) groups |= sim->demand.group[places[i]];
    return ts_fill(sim, groups);
}

void ts_want(ts_sim *sim, int groups) { sim->demand.left_out = TS_OF_ALL & ~groups; }
