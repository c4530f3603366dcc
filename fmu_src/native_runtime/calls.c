/* What all of FMI's functions begin with: is the call in order, are its values there, are the outputs those of the inputs? */
#include "calls.h"

#include <stdio.h>
#include <string.h>

#define MAX_EVENTS 1000 /* logged per step */

fmi2Status fmu_error(instance *fmu, const char *what, const char *why)
{
    fmu->mode = FMU_ERROR;
    fmu_log(fmu, LOG_ERROR, fmi2Error, "%s: %s", what, why);
    return fmi2Error;
}

fmi2Status fmu_refuse(const instance *fmu, const char *what, const char *why)
{
    fmu_log(fmu, LOG_DISCARD, fmi2Discard, "%s refused: %s", what, why);
    return fmi2Discard;
}

static const char *mode_name(int mode)
{
    switch (mode) {
    case FMU_INSTANTIATED: return "before fmi2EnterInitializationMode";
    case FMU_INITIALIZATION: return "in Initialization Mode";
    case FMU_STEPPING: return "after fmi2ExitInitializationMode";
    case FMU_EVENT: return "in Event Mode";
    case FMU_CONTINUOUS: return "in Continuous-Time Mode";
    case FMU_TERMINATED: return "after fmi2Terminate";
    default: return "after an error; reset the instance or put a saved state back";
    }
}

fmi2Status fmu_in_order(instance *fmu, int modes, fmi2Status otherwise, const char *what)
{
    if (!fmu) return fmi2Error;
    if (fmu->mode & modes) return fmi2OK;
    char why[128];
    snprintf(why, sizeof why, "must not be called %s", mode_name(fmu->mode));
    return otherwise == fmi2Error || fmu->mode == FMU_ERROR ? fmu_error(fmu, what, why) : fmu_refuse(fmu, what, why);
}

fmi2Status fmu_of_kind(const instance *fmu, fmi2Type kind, const char *what)
{
    if (fmu->kind == kind) return fmi2OK;
    const char *other = kind == fmi2CoSimulation ? "it is for co-simulation, and this instance for model exchange"
                                                 : "it is for model exchange, and this instance for co-simulation";
    return fmu_refuse(fmu, what, other);
}

const char *fmu_refused_value(const instance *fmu, char *text, size_t capacity)
{
    int32_t index = ts_concerned(fmu->sim);
    char number[32];
    if (index >= ts_real_count(fmu->sim)) {
        snprintf(text, capacity, "%s %s", fmu->table.name[index], ts_message(fmu->sim));
    } else {
        fmu_number(ts_values(fmu->sim)[index], number);
        snprintf(text, capacity, "%s = %s %s", fmu->table.name[index], number, ts_message(fmu->sim));
    }
    return text;
}

int fmu_refresh(instance *fmu, const char *what)
{
    if (!fmu->stale) return 1;
    int32_t index = -1;
    char why[320];
    if (ts_check(fmu->sim, &index) != TS_OK) {
        fmu_log(fmu, LOG_DISCARD, fmi2Discard, "%s: %s", what, fmu_refused_value(fmu, why, sizeof why));
        return 0;
    }
    if (ts_initialize(fmu->sim, fmu->start) != TS_OK) {
        fmu_log(fmu, LOG_DISCARD, fmi2Discard, "%s: no start can be computed: %s", what, ts_message(fmu->sim));
        return 0;
    }
    fmu->stale = fmu->derivatives_ready = fmu->viewed = 0;
    return 1;
}

fmi2Status fmu_look_up(const instance *fmu, const char *what, const fmi2ValueReference vr[], size_t n, const void *values,
                       int32_t first, int32_t end, const char *type)
{
    char why[96];
    if (n && (!vr || !values)) return fmu_refuse(fmu, what, "a null pointer was passed");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= (uint32_t)first && vr[i] < (uint32_t)end && (!fmu->table.gaps || fmu->table.span[vr[i]])) continue;
        snprintf(why, sizeof why, "no %s variable has the value reference %u", type, vr[i]);
        return fmu_refuse(fmu, what, why);
    }
    return fmi2OK;
}

static const char *string_name(const instance *fmu, int32_t string) { return fmu->table.name[fmu->table.count + string]; }

/* What a transition means for its string, after commas, or nothing: a kink of the force curve. */
static const char *consequence(const instance *fmu, const ts_transition *t, char text[80])
{
    char number[32], what[32] = "";
    int snapped = (int)ts_snapped(fmu->sim, t->string, t->after);
    if (!t->after != !t->before) snprintf(what, sizeof what, t->after ? ", taut" : ", slack");
    else if (snapped != ts_snapped(fmu->sim, t->string, t->before)) snprintf(what, sizeof what, ", %d snapped", snapped);
    snprintf(text, 80, t->loss > 0.0 ? "%s, %s J lost" : "%s", what, fmu_number(t->loss, number));
    return text;
}

void fmu_log_events(const instance *fmu)
{
    const ts_transition *t = ts_transitions(fmu->sim);
    int64_t count = ts_transition_count(fmu->sim);
    char time[32], meaning[80];
    for (int64_t i = 0; i < count && i < MAX_EVENTS; i++)
        fmu_log(fmu, LOG_EVENTS, fmi2OK, "string %s: piece %d -> %d at t = %s s%s", string_name(fmu, t[i].string),
                (int)t[i].before, (int)t[i].after, fmu_number(t[i].time, time), consequence(fmu, t + i, meaning));
    long long more = (long long)count - MAX_EVENTS;
    if (more > 0) fmu_log(fmu, LOG_EVENTS, fmi2OK, "%lld more transitions in this step", more);
}
