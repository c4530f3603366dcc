/* FMI 2.0 for model exchange: the host integrates.
 *
 * After initialization an instance is in Event Mode.  Inputs may be set there and in Continuous-Time Mode, tunable parameters in
 * Event Mode only; derivatives, event indicators and outputs are those of the time, the states and the inputs set last.  What
 * cannot be computed there is fmi2Discard: a solver may try elsewhere. */
#include "calls.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define LOOKING (FMU_INITIALIZATION | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED | FMU_ERROR)

static int computed(instance *fmu, int status, const char *caller)
{
    char time[32];
    if (status == TS_OK) return 1;
    fmu_log(fmu, LOG_DISCARD, fmi2Discard, "%s refused at t = %s s: %s", caller, fmu_number(fmu->time, time),
            ts_message(fmu->sim));
    return 0;
}

int fmu_view(instance *fmu, int what, const char *caller)
{
    double *rates = fmu->states + fmu->state_count;
    const int steps = fmu->kind == fmi2CoSimulation && fmu->mode != FMU_INITIALIZATION;
    if (fmu->mode == FMU_INITIALIZATION && !fmu_refresh(fmu, caller)) return 0;
    if (fmu->mode == FMU_INITIALIZATION || steps) what &= ~VIEW_OUTPUTS; /* the start or the step has filled them */
    what &= ~fmu->viewed;
    if ((what & VIEW_OUTPUTS) && !computed(fmu, ts_continuous_outputs(fmu->sim), caller)) return 0;
    if ((what & VIEW_STATES) && !computed(fmu, ts_continuous_states(fmu->sim, fmu->states), caller)) return 0;
    if (what & VIEW_DERIVATIVES) {
        int status = steps ? ts_step_derivatives(fmu->sim, rates) : ts_continuous_derivatives(fmu->sim, rates);
        if (!computed(fmu, status, caller)) return 0;
    }
    fmu->viewed |= what;
    return 1;
}

/* The caller's vector must have as many numbers as there are. */
static fmi2Status expect(const instance *fmu, const char *what, const void *vector, size_t n, int32_t count)
{
    char why[96];
    if (n != (size_t)count) {
        snprintf(why, sizeof why, "there are %d of them, not %zu", (int)count, n);
        return fmu_refuse(fmu, what, why);
    }
    return vector || !n ? fmi2OK : fmu_refuse(fmu, what, "a null pointer was passed");
}

#define REQUIRE_SIZE(vector, n, count)                                           \
    fmi2Status size_status = expect(fmu, __func__, vector, n, (int32_t)(count)); \
    if (size_status != fmi2OK) return size_status

/* -------------------------------------------------------------------------------------------------------------- events */

FMI2_Export fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    REQUIRE(c, FMU_EVENT | FMU_CONTINUOUS, fmi2Error);
    if (ts_enter_event(fmu->sim) != TS_OK) return fmu_refuse(fmu, __func__, ts_message(fmu->sim));
    fmu->mode = FMU_EVENT;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    int32_t changed;
    char why[320];
    REQUIRE(c, FMU_EVENT, fmi2Error);
    REQUIRE_POINTER(info);
    memset(info, 0, sizeof *info);
    int status = ts_update_discrete(fmu->sim, &changed), names_one = status == TS_BAD_INPUT && ts_concerned(fmu->sim) >= 0;
    if (status != TS_OK)
        return fmu_refuse(fmu, __func__, names_one ? fmu_refused_value(fmu, why, sizeof why) : ts_message(fmu->sim));
    fmu->viewed = 0;
    info->valuesOfContinuousStatesChanged = changed & TS_STATES_CHANGED ? fmi2True : fmi2False;
    if (fmu->log[LOG_EVENTS] && ts_transition_count(fmu->sim)) fmu_log_events(fmu);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    REQUIRE(c, FMU_EVENT, fmi2Error);
    fmu->mode = FMU_CONTINUOUS;
    return fmi2OK;
}

/* Redundant coordinates drift: the bars' lengths are put back in Event Mode, where states may change. */
FMI2_Export fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set_state_prior, fmi2Boolean *enter,
                                                   fmi2Boolean *terminate)
{
    REQUIRE(c, FMU_CONTINUOUS, fmi2Error);
    REQUIRE_POINTER(enter);
    REQUIRE_POINTER(terminate);
    (void)no_set_state_prior;
    *enter = ts_completed_step(fmu->sim) ? fmi2True : fmi2False;
    *terminate = fmi2False;
    return fmi2OK;
}

/* ----------------------------------------------------------------------------------------------------- time and states */

FMI2_Export fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    REQUIRE(c, FMU_EVENT | FMU_CONTINUOUS, fmi2Discard);
    if (ts_set_time(fmu->sim, time) != TS_OK) return fmu_refuse(fmu, __func__, ts_message(fmu->sim));
    fmu->viewed = 0;
    fmu->time = time;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    REQUIRE(c, FMU_CONTINUOUS, fmi2Discard);
    REQUIRE_SIZE(x, n, fmu->state_count);
    if (ts_set_continuous_states(fmu->sim, x) != TS_OK) return fmu_refuse(fmu, __func__, ts_message(fmu->sim));
    fmu->viewed = 0;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    REQUIRE(c, LOOKING, fmi2Discard);
    REQUIRE_KIND(fmi2ModelExchange);
    REQUIRE_SIZE(x, n, fmu->state_count);
    if (!fmu_view(fmu, VIEW_STATES, __func__)) return fmi2Discard;
    memcpy(x, fmu->states, n * sizeof *x);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t n)
{
    REQUIRE(c, LOOKING, fmi2Discard);
    REQUIRE_KIND(fmi2ModelExchange);
    REQUIRE_SIZE(derivatives, n, fmu->state_count);
    if (!fmu_view(fmu, VIEW_DERIVATIVES, __func__)) return fmi2Discard;
    memcpy(derivatives, fmu->states + n, n * sizeof *derivatives);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t n)
{
    REQUIRE(c, FMU_INSTANTIATED | LOOKING, fmi2Discard);
    REQUIRE_KIND(fmi2ModelExchange);
    REQUIRE_SIZE(nominals, n, fmu->state_count);
    ts_continuous_nominals(fmu->sim, nominals);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t n)
{
    REQUIRE(c, LOOKING, fmi2Discard);
    REQUIRE_KIND(fmi2ModelExchange);
    REQUIRE_SIZE(indicators, n, ts_indicator_count(fmu->sim));
    if (fmu->mode == FMU_INITIALIZATION && !fmu_refresh(fmu, __func__)) return fmi2Discard;
    return computed(fmu, ts_event_indicators(fmu->sim, indicators), __func__) ? fmi2OK : fmi2Discard;
}
