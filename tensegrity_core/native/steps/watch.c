/* Who watches a step is told where it has come to, and may end it there. */
#include "steps/watch.h"
#include "model/data.h"
#include "tensegrity.h"

/* Time at tau from the last communication point (s), as transitions have it. */
double ts_time_at(const ts_memory *memory, double tau) { return memory->time + (tau + memory->time_low); }

/* A step stands at tau, its state there complete.  Tell the watcher where time went on, or transitions were; does the step end
 * there?  What a host's clock does not show apart from the step's start or end is
 * not told: every step must get on. */
int ts_ends_here(ts_sim *sim, double tau)
{
    ts_call *call = &sim->call;
    const double start = ts_time_at(&sim->memory, 0.0), now = ts_time_at(&sim->memory, tau);
    int crossed = sim->told.count > call->seen;
    call->seen = sim->told.count;
    if (!(tau > call->reached || crossed) || !(now > start && now < ts_time_at(&sim->memory, call->length))) return 0;
    call->reached = tau;
    call->watching = 1;
    call->answer = call->watcher(call->context, sim, crossed ? TS_AT_TRANSITION : TS_AT_STEP);
    call->watching = 0;
    return call->answer != TS_GO_ON;
}
