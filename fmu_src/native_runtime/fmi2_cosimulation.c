/* FMI 2.0 for co-simulation: steps, and what may be asked and given about them. */
#include "calls.h"

#include <float.h>
#include <math.h>
#include <stdio.h>

/* --------------------------------------------------------------------------------------------------------------- steps */

/* Round-off that a communication point may have: the host counts its own time. */
static double slack(double time, double h) { return 1e-6 * h + 4.0 * DBL_EPSILON * fabs(time); }

/* That the last step may have: a host that adds up its time has rounded it at each step, which is much at large times; but less
 * than half a step, or it is a step too many. */
static double slack_at_stop(const instance *fmu, double h)
{
    double steps = (fmu->time - fmu->start) / h;
    return fmax(slack(fmu->stop, h), fmin(0.5 * h, steps * DBL_EPSILON * fabs(fmu->stop)));
}

/* Where the host's time and the FMU's have parted, or the stop time would be passed: why, or NULL. */
static const char *wrong_time(const instance *fmu, double point, double h, char *text, size_t capacity)
{
    const char *form = NULL;
    double one = point, other = fmu->time;
    char a[32], b[32];
    if (!(fabs(point - fmu->time) <= slack(fmu->time, h))) {
        form = "the communication point is %s s, but the FMU stands at %s s";
    } else if (fmu->stop_defined && point + h > fmu->stop + slack_at_stop(fmu, h)) {
        form = "the step from %s s would pass the stop time %s s";
        other = fmu->stop;
    }
    if (form) snprintf(text, capacity, form, fmu_number(one, a), fmu_number(other, b));
    return form ? text : NULL;
}

static fmi2Status discard(instance *fmu, double point, const char *why)
{
    char time[32];
    fmu->discarded = 1;
    fmu_number(point, time);
    fmu_log(fmu, LOG_DISCARD, fmi2Discard, "the step from t = %s s is discarded: %s", time, why);
    return fmi2Discard;
}

static fmi2Status wrong_size(instance *fmu, double point, double h)
{
    char why[96], size[32];
    snprintf(why, sizeof why, "the step size %s s is not positive and finite", fmu_number(h, size));
    return discard(fmu, point, why);
}

FMI2_Export fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real h, fmi2Boolean no_set_state_prior)
{
    char why[320];
    REQUIRE(c, FMU_STEPPING, fmi2Error);
    (void)no_set_state_prior;
    if (!(h > 0.0) || !isfinite(h)) return wrong_size(fmu, point, h);
    if (wrong_time(fmu, point, h, why, sizeof why)) return fmu_error(fmu, __func__, why);
    int status = ts_step(fmu->sim, h);
    int names_one = status == TS_BAD_INPUT && ts_concerned(fmu->sim) >= 0;
    if (status != TS_OK) return discard(fmu, point, names_one ? fmu_refused_value(fmu, why, sizeof why) : ts_message(fmu->sim));
    fmu->discarded = fmu->derivatives_ready = fmu->viewed = 0;
    fmu->time = point + h;
    if (fmu->log[LOG_EVENTS] && ts_transition_count(fmu->sim)) fmu_log_events(fmu);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2CancelStep(fmi2Component c)
{
    REQUIRE(c, FMU_ANY, fmi2Discard);
    return fmu_refuse(fmu, __func__, "no step is under way: fmi2DoStep returns when it is done, never fmi2Pending");
}

static fmi2Status not_pending(const instance *fmu, const char *what)
{
    return fmu_refuse(fmu, what, "no step is ever pending here");
}

/* What could be asked only while a step is pending. */
static fmi2Status never(fmi2Component c, const char *what)
{
    instance *fmu = (instance *)c;
    fmi2Status status = fmu_in_order(fmu, FMU_STEPPING | FMU_TERMINATED, fmi2Discard, what);
    return status == fmi2OK ? not_pending(fmu, what) : status;
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
    REQUIRE(c, FMU_STEPPING | FMU_TERMINATED, fmi2Discard);
    REQUIRE_POINTER(value);
    if (kind != fmi2LastSuccessfulTime) return not_pending(fmu, __func__);
    *value = fmu->time;
    return fmi2OK;
}

/* After a discarded step an importer asks whether to end the run.  The same step again would be discarded again, and some ask for
 * it for ever; so the answer is yes until a step succeeds. */
FMI2_Export fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    REQUIRE(c, FMU_STEPPING | FMU_TERMINATED, fmi2Discard);
    REQUIRE_POINTER(value);
    if (kind != fmi2Terminated) return not_pending(fmu, __func__);
    *value = fmu->discarded ? fmi2True : fmi2False;
    return fmi2OK;
}

/* ---------------------------------------------------------------------------------------------------------- derivatives */

/* Derivatives hold until they are set again, like the inputs themselves. */
FMI2_Export fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                   const fmi2Integer order[], const fmi2Real value[])
{
    char text[32];
    REQUIRE(c, FMU_INSTANTIATED | FMU_INITIALIZATION | FMU_STEPPING, fmi2Discard);
    REQUIRE_KIND(fmi2CoSimulation);
    int32_t inputs = ts_input_count(fmu->sim);
    double *slopes = ts_slopes(fmu->sim);
    if (n) REQUIRE_POINTER(order);
    REQUIRE_KNOWN(value, 0, inputs, "input");
    for (size_t i = 0; i < n; i++) {
        if (order[i] != 1 && order[i] != 2) return fmu_refuse(fmu, __func__, "only derivatives of order 1 and 2 are used");
        if (isfinite(value[i])) continue;
        fmu_log(fmu, LOG_DISCARD, fmi2Discard, "%s: derivative %d of %s = %s refused: it must be finite", __func__, order[i],
                fmu->table.name[vr[i]], fmu_number(value[i], text));
        return fmi2Discard;
    }
    for (size_t i = 0; i < n; i++) slopes[(order[i] - 1) * inputs + (int32_t)vr[i]] = value[i];
    fmu->stale |= fmu->mode == FMU_INITIALIZATION;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                                    const fmi2Integer order[], fmi2Real value[])
{
    REQUIRE(c, FMU_STEPPING | FMU_TERMINATED | FMU_ERROR, fmi2Discard);
    REQUIRE_KIND(fmi2CoSimulation);
    if (n) REQUIRE_POINTER(order);
    REQUIRE_KNOWN(value, fmu->first_output, fmu->table.reals, "Real output");
    for (size_t i = 0; i < n; i++)
        if (order[i] != 1) return fmu_refuse(fmu, __func__, "only derivatives of order 1 are given");
    if (!fmu->derivatives_ready && ts_output_derivatives(fmu->sim, fmu->derivatives) != TS_OK)
        return fmu_refuse(fmu, __func__, ts_message(fmu->sim));
    fmu->derivatives_ready = 1;
    for (size_t i = 0; i < n; i++) value[i] = fmu->derivatives[vr[i] - (uint32_t)fmu->first_output];
    return fmi2OK;
}
