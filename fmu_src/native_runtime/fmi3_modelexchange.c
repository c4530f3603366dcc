/* FMI 3.0 for model exchange: the host integrates. */
#include "version3.h"

#define LOOKING (MODE_INITIALIZATION | MODE_EVENT | MODE_CONTINUOUS | MODE_TERMINATED | MODE_ERROR)

FMI3_Export fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c)
{
    REQUIRE(c, MODE_EVENT, FMU_ERROR);
    REQUIRE_KIND(FMU_MODEL_EXCHANGE);
    fmu->mode = MODE_CONTINUOUS;
    return fmi3OK;
}

/* Redundant coordinates drift: the bars' lengths are put back in Event Mode, where states may change. */
FMI3_Export fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean no_set_state_prior, fmi3Boolean *enter,
                                                   fmi3Boolean *terminate)
{
    REQUIRE(c, MODE_CONTINUOUS, FMU_ERROR);
    REQUIRE_POINTER(enter && terminate);
    (void)no_set_state_prior;
    *enter = ts_completed_step(fmu->sim) != 0;
    *terminate = fmi3False;
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time)
{
    REQUIRE(c, MODE_EVENT | MODE_CONTINUOUS, FMU_DISCARD);
    REQUIRE_KIND(FMU_MODEL_EXCHANGE);
    return (fmi3Status)fmu_set_time(fmu, __func__, time);
}

FMI3_Export fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n)
{
    REQUIRE(c, MODE_CONTINUOUS, FMU_DISCARD);
    return (fmi3Status)fmu_set_states(fmu, __func__, x, n);
}

FMI3_Export fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n)
{
    REQUIRE(c, LOOKING, FMU_DISCARD);
    REQUIRE_KIND(FMU_MODEL_EXCHANGE);
    return (fmi3Status)fmu_get_states(fmu, __func__, x, n);
}

FMI3_Export fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 derivatives[], size_t n)
{
    REQUIRE(c, LOOKING, FMU_DISCARD);
    REQUIRE_KIND(FMU_MODEL_EXCHANGE);
    return (fmi3Status)fmu_get_derivatives(fmu, __func__, derivatives, n);
}

FMI3_Export fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominals[], size_t n)
{
    REQUIRE(c, MODE_INSTANTIATED | LOOKING, FMU_DISCARD);
    REQUIRE_KIND(FMU_MODEL_EXCHANGE);
    return (fmi3Status)fmu_get_nominals(fmu, __func__, nominals, n);
}

FMI3_Export fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 indicators[], size_t n)
{
    REQUIRE(c, LOOKING, FMU_DISCARD);
    REQUIRE_KIND(FMU_MODEL_EXCHANGE);
    return (fmi3Status)fmu_get_indicators(fmu, __func__, indicators, n);
}

FMI3_Export fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    REQUIRE_KIND(FMU_MODEL_EXCHANGE);
    REQUIRE_POINTER(n);
    *n = (size_t)fmu->state_count;
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    REQUIRE_KIND(FMU_MODEL_EXCHANGE);
    REQUIRE_POINTER(n);
    *n = (size_t)fmu->indicator_count;
    return fmi3OK;
}
