/* Model exchange, where the host integrates, and Event Mode.
 *
 * After initialization an instance is in Event Mode.  Inputs may be set there and in Continuous-Time Mode, tunable parameters in
 * Event Mode only; derivatives, event indicators and outputs are those of the time, the states and the inputs set last.  What
 * cannot be computed there is discarded: a solver may try elsewhere.
 *
 * In co-simulation an event takes the inputs and parameters that have been set since the last step at once, as the next step
 * would at its start. */
#include "calls.h"

#include <string.h>

static int computed(instance *fmu, int status, const char *caller)
{
    char time[32];
    if (status == TS_OK) return 1;
    fmu_log(fmu, LOG_DISCARD, FMU_DISCARD, "%s refused at t = %s s: %s", caller, fmu_number(fmu->time, time),
            ts_message(fmu->sim));
    return 0;
}

int fmu_view(instance *fmu, int what, const char *caller)
{
    double *rates = fmu->states + fmu->state_count;
    const int steps = fmu->kind == FMU_CO_SIMULATION;
    if (fmu->mode == MODE_INITIALIZATION && !fmu_refresh(fmu, caller)) return 0;
    if (fmu->mode == MODE_INITIALIZATION || steps) what &= ~VIEW_OUTPUTS; /* the start or the step has filled them */
    what &= ~fmu->viewed;
    if ((what & VIEW_OUTPUTS) && !computed(fmu, ts_continuous_outputs(fmu->sim), caller)) return 0;
    if ((what & VIEW_STATES) && !computed(fmu, ts_continuous_states(fmu->sim, fmu->states), caller)) return 0;
    if (what & VIEW_DERIVATIVES) {
        int status = steps ? ts_step_derivatives(fmu->sim, rates) : ts_continuous_derivatives(fmu->sim, rates);
        if (!computed(fmu, status, caller)) return 0;
    }
    if (what & VIEW_INDICATORS) {
        int status = steps ? ts_step_indicators(fmu->sim, fmu->indicators) : ts_event_indicators(fmu->sim, fmu->indicators);
        if (!computed(fmu, status, caller)) return 0;
    }
    fmu->viewed |= what;
    return 1;
}

int fmu_look_within(instance *fmu, int what, const char *caller)
{
    what &= ~fmu->viewed;
    if ((what & VIEW_OUTPUTS) && !computed(fmu, ts_look(fmu->sim), caller)) return 0;
    if ((what & VIEW_STATES) && !computed(fmu, ts_continuous_states(fmu->sim, fmu->states), caller)) return 0;
    if (what & (VIEW_DERIVATIVES | VIEW_INDICATORS)) {
        fmu_refuse(fmu, caller, "derivatives of states and event indicators are not computed while a step is under way");
        return 0;
    }
    fmu->viewed |= what;
    return 1;
}

/* -------------------------------------------------------------------------------------------------------------- events */

/* In Event Mode already it changes nothing: a jump of inputs that was set since then is still to be taken. */
fmu_status fmu_enter_event(instance *fmu, const char *what)
{
    if (fmu->mode == MODE_EVENT) return FMU_OK;
    if (fmu->kind == FMU_MODEL_EXCHANGE && ts_enter_event(fmu->sim) != TS_OK)
        return fmu_refuse(fmu, what, ts_message(fmu->sim));
    fmu->mode = MODE_EVENT;
    return FMU_OK;
}

fmu_status fmu_update_discrete(instance *fmu, const char *what, int *states_changed)
{
    int32_t changed = 0;
    char why[320];
    int status = fmu->kind == FMU_MODEL_EXCHANGE ? ts_update_discrete(fmu->sim, &changed) : ts_take_inputs(fmu->sim);
    if (status != TS_OK) return fmu_refuse(fmu, what, fmu_refusal(fmu, status, why, sizeof why));
    fmu->viewed = fmu->derivatives_ready = 0;
    *states_changed = (changed & TS_STATES_CHANGED) != 0;
    fmu_log_events(fmu);
    return FMU_OK;
}

/* ----------------------------------------------------------------------------------------------------- time and states */

fmu_status fmu_set_time(instance *fmu, const char *what, double time)
{
    if (ts_set_time(fmu->sim, time) != TS_OK) return fmu_refuse(fmu, what, ts_message(fmu->sim));
    fmu->viewed = 0;
    fmu->time = time;
    return FMU_OK;
}

fmu_status fmu_set_states(instance *fmu, const char *what, const double x[], size_t n)
{
    fmu_status status = fmu_expect(fmu, what, x, n, fmu->state_count);
    if (status != FMU_OK) return status;
    if (ts_set_continuous_states(fmu->sim, x) != TS_OK) return fmu_refuse(fmu, what, ts_message(fmu->sim));
    fmu->viewed = 0;
    return FMU_OK;
}

fmu_status fmu_get_states(instance *fmu, const char *what, double x[], size_t n)
{
    fmu_status status = fmu_expect(fmu, what, x, n, fmu->state_count);
    if (status != FMU_OK) return status;
    if (!fmu_view(fmu, VIEW_STATES, what)) return FMU_DISCARD;
    memcpy(x, fmu->states, n * sizeof *x);
    return FMU_OK;
}

fmu_status fmu_get_derivatives(instance *fmu, const char *what, double derivatives[], size_t n)
{
    fmu_status status = fmu_expect(fmu, what, derivatives, n, fmu->state_count);
    if (status != FMU_OK) return status;
    if (!fmu_view(fmu, VIEW_DERIVATIVES, what)) return FMU_DISCARD;
    memcpy(derivatives, fmu->states + n, n * sizeof *derivatives);
    return FMU_OK;
}

fmu_status fmu_get_nominals(instance *fmu, const char *what, double nominals[], size_t n)
{
    fmu_status status = fmu_expect(fmu, what, nominals, n, fmu->state_count);
    if (status == FMU_OK) ts_continuous_nominals(fmu->sim, nominals);
    return status;
}

fmu_status fmu_get_indicators(instance *fmu, const char *what, double indicators[], size_t n)
{
    fmu_status status = fmu_expect(fmu, what, indicators, n, fmu->indicator_count);
    if (status != FMU_OK) return status;
    if (!fmu_view(fmu, VIEW_INDICATORS, what)) return FMU_DISCARD;
    if (n) memcpy(indicators, fmu->indicators, n * sizeof *indicators);
    return FMU_OK;
}
