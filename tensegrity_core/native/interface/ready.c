/* May a call be made now?  A status; where it is not TS_OK the message says why. */
#include "interface/ready.h"
#include "interface/message.h"
#include "model/data.h"
#include "steps/integrate.h"
#include "tensegrity.h"

/* TS_OK unless the simulation's own watcher calls. */
int ts_free_of_steps(ts_sim *sim)
{
    return sim->call.watching ? ts_say(sim, TS_BAD_STEP, "a step is under way, and its watcher may only look") : TS_OK;
}

/* TS_OK where a step can start. */
int ts_started(ts_sim *sim)
{
    if (!sim->memory.started) return ts_say(sim, TS_BAD_STEP, "initialize first");
    return ts_free_of_steps(sim);
}

/* The same where a call needs the state, which is there then. */
int ts_ready(ts_sim *sim)
{
    int status = ts_started(sim);
    if (status == TS_OK) ts_bring_state(sim);
    return status;
}
