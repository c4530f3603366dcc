/* FMI 3.0 for co-simulation: steps that a host may look into and end early, with Event Mode between them where it asks for that. */
#include "version3.h"

#include <stdio.h>

/* The variables that the host wants to look at within steps must be there.  0: the reason has been logged. */
static int can_be_looked_at(const instance *fmu, const char *what, const fmi3ValueReference vr[], size_t n)
{
    for (size_t i = 0; i < n; i++) {
        if (vr && fmu_span(fmu, vr[i])) continue;
        fmu_log(fmu, LOG_ERROR, FMU_ERROR, "%s: no variable has the value reference %u, to be looked at within steps", what,
                vr ? vr[i] : 0u);
        return 0;
    }
    return 1;
}

FMI3_Export fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                                     fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                                     const fmi3ValueReference required[], size_t n_required,
                                                     fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                                     fmi3IntermediateUpdateCallback intermediate)
{
    const fmu_request request = {__func__, &fmu_version3, environment, (void (*)(void))log, FMU_CO_SIMULATION, name,
                                 token,    path,          logging};
    instance *fmu = fmu_instantiate(&request);
    (void)visible;
    if (!fmu) return NULL;
    if (!can_be_looked_at(fmu, __func__, required, n_required)) {
        fmu_release(fmu);
        return NULL;
    }
    fmu->event_mode = event_mode;
    fmu->early_return = early_return;
    fmu->intermediate = (void (*)(void))intermediate;
    return fmu;
}

/* At an internal step or a transition.  Inputs are not asked for; a host that cannot wait for its time of return gets the step's
 * end at once.  Where steps may end early they do so after a transition. */
static int look(instance *fmu, int at_transition)
{
    fmi3Boolean requested = fmi3False;
    fmi3Float64 time = fmu->time;
    const fmi3Boolean may_end = fmu->early_return != 0;
    if (fmu->intermediate)
        ((fmi3IntermediateUpdateCallback)fmu->intermediate)(fmu->environment, time, fmi3False, fmi3True, fmi3True, may_end,
                                                            &requested, &time);
    return may_end && (requested || at_transition);
}

FMI3_Export fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 point, fmi3Float64 h, fmi3Boolean no_set_state_prior,
                                  fmi3Boolean *event_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                                  fmi3Float64 *last_time)
{
    if (event_needed) *event_needed = fmi3False;
    if (terminate) *terminate = fmi3False;
    if (early_return) *early_return = fmi3False;
    if (last_time && c) *last_time = ((instance *)c)->time;
    REQUIRE(c, MODE_STEPPING, FMU_ERROR);
    REQUIRE_POINTER(event_needed && terminate && early_return && last_time);
    (void)no_set_state_prior;
    fmu_status status = fmu_step(fmu, __func__, point, h, fmu->intermediate || fmu->early_return ? look : NULL);
    *early_return = status == FMU_OK && fmu->time < point + h;
    *last_time = fmu->time;
    return (fmi3Status)status;
}

FMI3_Export fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    REQUIRE(c, MODE_EVENT, FMU_ERROR);
    REQUIRE_KIND(FMU_CO_SIMULATION);
    fmu->mode = MODE_STEPPING;
    return fmi3OK;
}

FMI3_Export fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                                const fmi3Int32 orders[], fmi3Float64 values[], size_t n_values)
{
    REQUIRE(c, MODE_STEPPING | MODE_INTERMEDIATE | MODE_TERMINATED | MODE_ERROR, FMU_DISCARD);
    REQUIRE_KIND(FMU_CO_SIMULATION);
    return (fmi3Status)fmu_get_output_derivatives(fmu, __func__, vr, n, orders, values, n_values);
}
