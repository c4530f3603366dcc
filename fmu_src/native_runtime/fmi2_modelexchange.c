/* FMI 2.0 for model exchange: the host integrates. */
#include "version2.h"

#include <string.h>

#define LOOKING (MODE_INITIALIZATION | MODE_EVENT | MODE_CONTINUOUS | MODE_TERMINATED | MODE_ERROR)

FMI2_Export fmi2Status fmi2EnterEventMode(fmi2Component c)
{
    REQUIRE(c, MODE_EVENT | MODE_CONTINUOUS, FMU_ERROR);
    return (fmi2Status)fmu_enter_event(fmu, __func__);
}

FMI2_Export fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    int states_changed = 0;
    REQUIRE(c, MODE_EVENT, FMU_ERROR);
    REQUIRE_POINTER(info);
    memset(info, 0, sizeof *info);
    fmu_status status = fmu_update_discrete(fmu, __func__, &states_changed);
    info->valuesOfContinuousStatesChanged = states_changed ? fmi2True : fmi2False;
    return (fmi2Status)status;
}

FMI2_Export fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    REQUIRE(c, MODE_EVENT, FMU_ERROR);
    fmu->mode = MODE_CONTINUOUS;
    return fmi2OK;
}

/* Redundant coordinates drift: the bars' lengths are put back in Event Mode, where states may change. */
FMI2_Export fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set_state_prior, fmi2Boolean *enter,
                                                   fmi2Boolean *terminate)
{
    REQUIRE(c, MODE_CONTINUOUS, FMU_ERROR);
    REQUIRE_POINTER(enter);
    REQUIRE_POINTER(terminate);
    (void)no_set_state_prior;
    *enter = ts_completed_step(fmu->sim) ? fmi2True : fmi2False;
    *terminate = fmi2False;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    REQUIRE(c, MODE_EVENT | MODE_CONTINUOUS, FMU_DISCARD);
    return (fmi2Status)fmu_set_time(fmu, __func__, time);
}

FMI2_Export fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n)
{
    REQUIRE(c, MODE_CONTINUOUS, FMU_DISCARD);
    return (fmi2Status)fmu_set_states(fmu, __func__, x, n);
}

FMI2_Export fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n)
{
    REQUIRE(c, LOOKING, FMU_DISCARD);
    REQUIRE_KIND(FMU_MODEL_EXCHANGE);
    return (fmi2Status)fmu_get_states(fmu, __func__, x, n);
}

FMI2_Export fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivatives[], size_t n)
{
    REQUIRE(c, LOOKING, FMU_DISCARD);
    REQUIRE_KIND(FMU_MODEL_EXCHANGE);
    return (fmi2Status)fmu_get_derivatives(fmu, __func__, derivatives, n);
}

FMI2_Export fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t n)
{
    REQUIRE(c, MODE_INSTANTIATED | LOOKING, FMU_DISCARD);
    REQUIRE_KIND(FMU_MODEL_EXCHANGE);
    return (fmi2Status)fmu_get_nominals(fmu, __func__, nominals, n);
}

FMI2_Export fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t n)
{
    REQUIRE(c, LOOKING, FMU_DISCARD);
    REQUIRE_KIND(FMU_MODEL_EXCHANGE);
    return (fmi2Status)fmu_get_indicators(fmu, __func__, indicators, n);
}
