/* What a step takes from inputs and parameters, from the present ones or from those of the last step. */
#include "interface/applied.h"
#include "interface/message.h"
#include "laws/curves.h"
#include "model/data.h"
#include "motion/motion.h"
#include "motion/pieces.h"
#include "steps/integrate.h"
#include "tensegrity.h"

#include <math.h>
#include <string.h>

/* Curves by the present parameters: TS_OK, or what is wrong. */
int ts_build_curves(ts_sim *sim)
{
    const char *reason = ts_curves_build(&sim->laws, &sim->m, sim->io.values);
    if (!reason) return TS_OK;
    return ts_say(sim, strcmp(reason, "out of memory") ? TS_BAD_INPUT : TS_BAD_MODEL, reason);
}

/* Steps under error control see the formula of a piece go on smoothly past its ends.  A fixed step that is far too long would see a
 * polynomial of high degree explode there. */
void ts_set_reach(ts_sim *sim)
{
    double reach = ts_fixed_step(sim->memory.method) ? 1.0 : INFINITY;
    for (int i = 0; i < sim->m.count[TS_S]; i++) sim->laws.curve[i].reach = reach;
}

void ts_set_pieces(ts_sim *sim)
{
    for (int i = 0; i < sim->m.count[TS_S]; i++) ts_place(sim, i, sim->state.piece[i]);
}

/* The inputs and parameters of the last step in place of the present ones, which the caller may have changed since. */
void ts_swap_applied(ts_sim *sim)
{
    size_t reals = (size_t)sim->m.n_real, slopes = 2 * (size_t)sim->m.n_inputs;
    memcpy(sim->undo.reals, sim->io.values, sizeof(double) * reals);
    memcpy(sim->undo.reals + reals, sim->io.slopes, sizeof(double) * slopes);
    memcpy(sim->io.values, sim->io.applied, sizeof(double) * (size_t)sim->m.n_applied);
    memcpy(sim->io.slopes, sim->io.applied_slopes, sizeof(double) * slopes);
}

/* The present ones and the outputs again. */
void ts_swap_back(ts_sim *sim)
{
    size_t reals = (size_t)sim->m.n_real, slopes = 2 * (size_t)sim->m.n_inputs;
    memcpy(sim->io.values, sim->undo.reals, sizeof(double) * reals);
    memcpy(sim->io.slopes, sim->undo.reals + reals, sizeof(double) * slopes);
}

/* The present ones again, the outputs as they are. */
void ts_swap_inputs_back(ts_sim *sim)
{
    memcpy(sim->io.values, sim->undo.reals, sizeof(double) * (size_t)sim->m.n_applied);
    memcpy(sim->io.slopes, sim->undo.reals + sim->m.n_real, 2 * sizeof(double) * (size_t)sim->m.n_inputs);
}

/* What a step derives from inputs and parameters. */
void ts_derive(ts_sim *sim)
{
    ts_set_reach(sim);
    ts_prepare(sim);
    ts_set_pieces(sim);
}

/* The curves of the run under way, after new ones could not be built. */
void ts_keep_curves(ts_sim *sim)
{
    if (!sim->memory.started) return;
    ts_swap_applied(sim);
    if (ts_curves_build(&sim->laws, &sim->m, sim->io.values)) sim->memory.started = 0;
    else ts_derive(sim);
    ts_swap_back(sim);
}
