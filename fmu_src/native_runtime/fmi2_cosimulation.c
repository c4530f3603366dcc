/* FMI 2.0 for co-simulation: steps, and what may be asked and given about them. */
#include "version2.h"

FMI2_Export fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real h, fmi2Boolean no_set_state_prior)
{
    REQUIRE(c, MODE_STEPPING, FMU_ERROR);
    (void)no_set_state_prior;
    return (fmi2Status)fmu_step(fmu, __func__, point, h, NULL);
}

FMI2_Export fmi2Status fmi2CancelStep(fmi2Component c)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    const char *why = "no step is under way: fmi2DoStep returns when it is done, never fmi2Pending";
    return (fmi2Status)fmu_refuse(fmu, __func__, why);
}

static fmi2Status not_pending(const instance *fmu, const char *what)
{
    return (fmi2Status)fmu_refuse(fmu, what, "no step is ever pending here");
}

/* What could be asked only while a step is pending. */
static fmi2Status never(fmi2Component c, const char *what)
{
    instance *fmu = (instance *)c;
    fmu_status status = fmu_in_order(fmu, MODE_STEPPING | MODE_TERMINATED, FMU_DISCARD, what);
    return status == FMU_OK ? not_pending(fmu, what) : (fmi2Status)status;
}

FMI2_Export fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind, (void)value;
    return never(c, __func__);
}

FMI2_Export fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)kind, (void)value;
    return never(c, __func__);
}

FMI2_Export fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)kind, (void)value;
    return never(c, __func__);
}

FMI2_Export fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    REQUIRE(c, MODE_STEPPING | MODE_TERMINATED, FMU_DISCARD);
    REQUIRE_POINTER(value);
    if (kind != fmi2LastSuccessfulTime) return not_pending(fmu, __func__);
    *value = fmu->time;
    return fmi2OK;
}

/* After a discarded step an importer asks whether to end the run.  The same step again would be discarded again, and some ask for
 * it for ever; so the answer is yes until a step succeeds. */
FMI2_Export fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    REQUIRE(c, MODE_STEPPING | MODE_TERMINATED, FMU_DISCARD);
    REQUIRE_POINTER(value);
    if (kind != fmi2Terminated) return not_pending(fmu, __func__);
    *value = fmu->discarded ? fmi2True : fmi2False;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                   const fmi2Integer order[], const fmi2Real value[])
{
    REQUIRE(c, MODE_INSTANTIATED | MODE_INITIALIZATION | MODE_STEPPING, FMU_DISCARD);
    REQUIRE_KIND(FMU_CO_SIMULATION);
    return (fmi2Status)fmu_set_input_derivatives(fmu, __func__, vr, n, order, value);
}

FMI2_Export fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                    const fmi2Integer order[], fmi2Real value[])
{
    REQUIRE(c, MODE_STEPPING | MODE_TERMINATED | MODE_ERROR, FMU_DISCARD);
    REQUIRE_KIND(FMU_CO_SIMULATION);
    return (fmi2Status)fmu_get_output_derivatives(fmu, __func__, vr, n, order, value, n);
}
