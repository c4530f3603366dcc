/* Co-simulation: steps, and what may be asked and given about them. */
#include "calls.h"

#include <float.h>
#include <math.h>
#include <stdio.h>

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

static fmu_status discard(instance *fmu, double point, const char *why)
{
    char time[32];
    fmu->discarded = 1;
    fmu_number(point, time);
    fmu_log(fmu, LOG_DISCARD, FMU_DISCARD, "the step from t = %s s is discarded: %s", time, why);
    return FMU_DISCARD;
}

static fmu_status wrong_size(instance *fmu, double point, double h)
{
    char why[96], size[32];
    snprintf(why, sizeof why, "the step size %s s is not positive and finite", fmu_number(h, size));
    return discard(fmu, point, why);
}

/* Somebody looks into a step.  Times are the host's; point: at the step's start, where the kernel's clock shows `start`. */
typedef struct {
    instance *fmu;
    fmu_looker look;
    double point, start, end;
} looking;

static int look_in(void *context, ts_sim *sim, ts_moment moment)
{
    const looking *l = (const looking *)context;
    instance *fmu = l->fmu;
    fmu->time = fmin(l->point + (ts_time(sim) - l->start), l->end);
    fmu->viewed = fmu->derivatives_ready = 0;
    fmu->mode = MODE_INTERMEDIATE;
    int ends = l->look(fmu, moment == TS_AT_TRANSITION);
    if (fmu->mode != MODE_INTERMEDIATE) return TS_GIVE_UP; /* a call that must not be made there */
    fmu->mode = MODE_STEPPING;
    return ends ? TS_END_HERE : TS_GO_ON;
}

fmu_status fmu_step(instance *fmu, const char *what, double point, double h, fmu_looker look)
{
    char why[320];
    const double before = fmu->time, end = point + h;
    double done = h;
    if (!(h > 0.0) || !isfinite(h)) return wrong_size(fmu, point, h);
    if (wrong_time(fmu, point, h, why, sizeof why)) return fmu_error(fmu, what, why);
    looking l = {fmu, look, point, ts_time(fmu->sim), end};
    int status = look ? ts_step_watched(fmu->sim, h, look_in, &l, &done) : ts_step(fmu->sim, h);
    fmu->derivatives_ready = fmu->viewed = 0;
    if (status != TS_OK) fmu->time = before;
    if (fmu->mode == MODE_ERROR) return FMU_ERROR;
    if (status != TS_OK) return discard(fmu, point, fmu_refusal(fmu, status, why, sizeof why));
    fmu->discarded = 0;
    if (done >= h) fmu->time = end;
    else ts_carry_inputs(fmu->sim); /* a host may not know them there: so they go on */
    fmu_log_events(fmu);
    return FMU_OK;
}

/* Derivatives hold until they are set again, like the inputs themselves. */
fmu_status fmu_set_input_derivatives(instance *fmu, const char *what, const uint32_t vr[], size_t n, const int order[],
                                     const double value[])
{
    char text[32];
    int32_t inputs = ts_input_count(fmu->sim);
    double *slopes = ts_slopes(fmu->sim);
    const fmu_range range = {"input", 0, inputs, 0, 0};
    if (n && !order) return fmu_refuse(fmu, what, "a null pointer was passed");
    fmu_status status = fmu_look_up(fmu, what, vr, n, value, n, range);
    if (status != FMU_OK) return status;
    for (size_t i = 0; i < n; i++) {
        if (order[i] != 1 && order[i] != 2) return fmu_refuse(fmu, what, "only derivatives of order 1 and 2 are used");
        if (isfinite(value[i])) continue;
        fmu_log(fmu, LOG_DISCARD, FMU_DISCARD, "%s: derivative %d of %s = %s refused: it must be finite", what, order[i],
                fmu->table.name[vr[i]], fmu_number(value[i], text));
        return FMU_DISCARD;
    }
    for (size_t i = 0; i < n; i++) slopes[(order[i] - 1) * inputs + (int32_t)vr[i]] = value[i];
    fmu->stale |= fmu->mode == MODE_INITIALIZATION;
    return FMU_OK;
}

fmu_status fmu_get_output_derivatives(instance *fmu, const char *what, const uint32_t vr[], size_t n, const int order[],
                                      double value[], size_t n_values)
{
    char type[32];
    const fmu_range range = {type, fmu->first_output, fmu->table.reals, 0, 0};
    snprintf(type, sizeof type, "%s output", fmu->standard->real);
    if (n && !order) return fmu_refuse(fmu, what, "a null pointer was passed");
    fmu_status status = fmu_look_up(fmu, what, vr, n, value, n_values, range);
    if (status != FMU_OK) return status;
    for (size_t i = 0; i < n; i++)
        if (order[i] != 1) return fmu_refuse(fmu, what, "only derivatives of order 1 are given");
    if (!fmu->derivatives_ready && ts_output_derivatives(fmu->sim, fmu->derivatives) != TS_OK)
        return fmu_refuse(fmu, what, ts_message(fmu->sim));
    fmu->derivatives_ready = 1;
    for (size_t i = 0; i < n; i++)
        for (uint32_t at = vr[i], end = at + (uint32_t)fmu_span(fmu, at); at < end; at++)
            *value++ = fmu->derivatives[at - (uint32_t)fmu->first_output];
    return FMU_OK;
}
