/* Steps that somebody watches, and may end early. */
#include "interface/watched.h"
#include "interface/checks.h"
#include "interface/message.h"
#include "interface/ready.h"
#include "model/data.h"
#include "motion/motion.h"
#include "motion/outputs.h"
#include "tensegrity.h"

#include <string.h>

typedef struct {
    ts_watcher watcher;
    void *context;
    int changed; /* inputs or parameters, which must not */
} watch;

/* Inputs and parameters while the watcher looks: set down, or as they were again.  Did they change? */
static void set_down(ts_sim *sim)
{
    memcpy(sim->undo.watched, sim->io.values, sizeof(double) * (size_t)sim->m.n_applied);
    memcpy(sim->undo.watched + sim->m.n_real, sim->io.slopes, 2 * sizeof(double) * (size_t)sim->m.n_inputs);
}

static int put_back(ts_sim *sim)
{
    const double *values = sim->undo.watched, *slopes = values + sim->m.n_real;
    size_t size = sizeof(double) * (size_t)sim->m.n_applied, sloped = 2 * sizeof(double) * (size_t)sim->m.n_inputs;
    int32_t *method = sim->io.integers + sim->m.int_at[TS_INT_METHOD];
    int changed =
        *method != sim->memory.method || memcmp(sim->io.values, values, size) || memcmp(sim->io.slopes, slopes, sloped);
    *method = sim->memory.method;
    memcpy(sim->io.values, values, size);
    memcpy(sim->io.slopes, slopes, sloped);
    return changed;
}

static int call_watcher(void *context, ts_sim *sim, ts_moment moment)
{
    watch *w = (watch *)context;
    int answer = w->watcher(w->context, sim, moment);
    w->changed = put_back(sim);
    return w->changed ? TS_GIVE_UP : answer;
}

int ts_step_watched(ts_sim *sim, double h, ts_watcher watcher, void *context, double *done)
{
    watch w = {watcher, context, 0};
    *done = 0.0;
    if (ts_ready(sim) != TS_OK) return TS_BAD_STEP;
    set_down(sim);
    sim->call.watcher = call_watcher;
    sim->call.context = &w;
    int status = ts_step(sim, h);
    sim->call.watcher = NULL;
    sim->call.context = NULL;
    if (w.changed) return ts_say(sim, TS_BAD_STEP, "inputs and parameters must not change while a step is under way");
    if (status != TS_OK) return status;
    *done = sim->memory.last_step;
    if (*done == h) return TS_OK;
    sim->memory.time = ts_time(sim); /* what the host's clock shows is where the next step begins */
    sim->memory.time_low = 0.0;
    return TS_OK;
}

/* Outputs at the moment at hand; start.f is the derivative there.  Looking changes nothing, not even a count. */
int ts_look(ts_sim *sim)
{
    if (!sim->call.watching) return ts_say(sim, TS_BAD_STEP, "only the watcher of a step may look");
    const int64_t evaluations = sim->memory.stats[TS_RHS];
    ts_rhs(sim, sim->call.reached, sim->state.y, sim->start.f);
    ts_outputs(sim, sim->call.reached, TS_OF_ALL);
    sim->memory.stats[TS_RHS] = evaluations;
    sim->call.looked = 1;
    return ts_check_outputs(sim, TS_OF_ALL, "within the step");
}

/* Derivatives of the outputs there, which stay as they are. */
int ts_look_derivatives(ts_sim *sim, double *out)
{
    const int64_t evaluations = sim->memory.stats[TS_RHS];
    const size_t first = (size_t)sim->m.n_applied, size = sizeof(double) * ((size_t)sim->m.n_real - first);
    memcpy(sim->undo.watched + first, sim->io.values + first, size);
    ts_tangent_outputs(sim, sim->call.reached, out);
    memcpy(sim->io.values + first, sim->undo.watched + first, size);
    sim->memory.stats[TS_RHS] = evaluations;
    return ts_check_rates(sim, out);
}
