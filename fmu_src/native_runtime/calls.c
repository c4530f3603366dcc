/* What FMI's functions begin with: is the call in order, are its values there, are the outputs those of the inputs? */
#include "calls.h"

#include <stdio.h>
#include <string.h>

#define MAX_EVENTS 1000 /* logged per step */

fmu_status fmu_error(instance *fmu, const char *what, const char *why)
{
    fmu->mode = MODE_ERROR;
    fmu_log(fmu, LOG_ERROR, FMU_ERROR, "%s: %s", what, why);
    return FMU_ERROR;
}

fmu_status fmu_refuse(const instance *fmu, const char *what, const char *why)
{
    fmu_log(fmu, LOG_DISCARD, FMU_DISCARD, "%s refused: %s", what, why);
    return FMU_DISCARD;
}

/* Where the instance stands, with the functions' prefix in the place of %s. */
static const char *position(int mode)
{
    switch (mode) {
    case MODE_INSTANTIATED: return "before fmi%dEnterInitializationMode";
    case MODE_INITIALIZATION: return "in Initialization Mode";
    case MODE_STEPPING: return "after fmi%dExitInitializationMode";
    case MODE_EVENT: return "in Event Mode";
    case MODE_CONTINUOUS: return "in Continuous-Time Mode";
    case MODE_INTERMEDIATE: return "while a step is under way";
    case MODE_TERMINATED: return "after fmi%dTerminate";
    default: return "after an error; reset the instance or put a saved state back";
    }
}

fmu_status fmu_in_order(instance *fmu, int modes, fmu_status otherwise, const char *what)
{
    if (!fmu) return FMU_ERROR;
    if (fmu->mode & modes) return FMU_OK;
    char where[80], why[128];
    snprintf(where, sizeof where, position(fmu->mode), fmu->standard->number);
    snprintf(why, sizeof why, "must not be called %s", where);
    return otherwise == FMU_ERROR || fmu->mode == MODE_ERROR ? fmu_error(fmu, what, why) : fmu_refuse(fmu, what, why);
}

fmu_status fmu_of_kind(const instance *fmu, fmu_kind kind, const char *what)
{
    if (fmu->kind == kind) return FMU_OK;
    const char *other = kind == FMU_CO_SIMULATION ? "it is for co-simulation, and this instance for model exchange"
                                                  : "it is for model exchange, and this instance for co-simulation";
    return fmu_refuse(fmu, what, other);
}

const char *fmu_refusal(const instance *fmu, int status, char *text, size_t capacity)
{
    int32_t index = status == TS_BAD_INPUT ? ts_concerned(fmu->sim) : -1;
    char number[32];
    if (index < 0) return ts_message(fmu->sim);
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
    int status = ts_check(fmu->sim, &index);
    if (status != TS_OK) {
        fmu_log(fmu, LOG_DISCARD, FMU_DISCARD, "%s: %s", what, fmu_refusal(fmu, status, why, sizeof why));
        return 0;
    }
    if (ts_initialize(fmu->sim, fmu->start) != TS_OK) {
        fmu_log(fmu, LOG_DISCARD, FMU_DISCARD, "%s: no start can be computed: %s", what, ts_message(fmu->sim));
        return 0;
    }
    fmu->stale = fmu->derivatives_ready = fmu->viewed = 0;
    return 1;
}

int32_t fmu_span(const instance *fmu, uint32_t vr)
{
    const uint32_t count = (uint32_t)fmu->table.count;
    if (vr < count) return fmu->table.span[vr];
    if (vr == count) return 1;
    const uint32_t place = vr - count - 1, all = (uint32_t)fmu->indicator_count;
    const uint32_t each = place < all ? all / (uint32_t)fmu->table.strings : 0;
    return each && place % each == 0 ? (int32_t)each : 0;
}

const char *fmu_name(const instance *fmu, uint32_t vr)
{
    const uint32_t count = (uint32_t)fmu->table.count;
    return vr < count ? fmu->table.name[vr] : vr == count ? "time" : "an event indicator";
}

fmu_status fmu_look_up(const instance *fmu, const char *what, const uint32_t vr[], size_t n, const void *values,
                       size_t n_values, fmu_range range)
{
    char why[96];
    size_t found = 0;
    if ((n && !vr) || (n_values && !values)) return fmu_refuse(fmu, what, "a null pointer was passed");
    for (size_t i = 0; i < n; i++) {
        const int outside = vr[i] < (uint32_t)range.first || vr[i] >= (uint32_t)range.end;
        const int other = vr[i] >= (uint32_t)range.other && vr[i] < (uint32_t)range.other_end;
        const int32_t span = outside || other ? 0 : fmu_span(fmu, vr[i]);
        found += (size_t)span;
        if (span) continue;
        snprintf(why, sizeof why, "no %s variable has the value reference %u", range.type, vr[i]);
        return fmu_refuse(fmu, what, why);
    }
    if (found == n_values) return FMU_OK;
    snprintf(why, sizeof why, "these variables have %zu values, not %zu", found, n_values);
    return fmu_refuse(fmu, what, why);
}

fmu_status fmu_expect(const instance *fmu, const char *what, const void *vector, size_t n, int32_t count)
{
    char why[96];
    if (n != (size_t)count) {
        snprintf(why, sizeof why, "there are %d of them, not %zu", (int)count, n);
        return fmu_refuse(fmu, what, why);
    }
    return vector || !n ? FMU_OK : fmu_refuse(fmu, what, "a null pointer was passed");
}

/* Of its string, or of the node that touches the ground. */
static const char *name_of(const instance *fmu, const ts_transition *t)
{
    return fmu->table.name[fmu->table.count + (t->contact < 0 ? t->string : fmu->table.strings + t->contact)];
}

/* What a contact's transition is called, after a comma. */
static const char *called(const ts_transition *t)
{
    if (!t->before) return ", touch_down";
    if (!t->after) return ", lift_off";
    if (t->before == 3 || t->after == 3) return t->after == 3 ? ", clip" : ", unclip";
    return t->after == 2 ? ", slip" : ", stick";
}

/* What a transition means for its string, after commas, or nothing: a kink of the force curve. */
static const char *consequence(const instance *fmu, const ts_transition *t, char text[80])
{
    char number[32], what[32] = "";
    if (t->contact >= 0) return called(t);
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
    if (!fmu->log[LOG_EVENTS]) return;
    for (int64_t i = 0; i < count && i < MAX_EVENTS; i++)
        fmu_log(fmu, LOG_EVENTS, FMU_OK,
                t[i].contact < 0 ? "string %s: piece %d -> %d at t = %s s%s" : "contact %s: %d -> %d at t = %s s%s",
                name_of(fmu, t + i), (int)t[i].before, (int)t[i].after, fmu_number(t[i].time, time),
                consequence(fmu, t + i, meaning));
    long long more = (long long)count - MAX_EVENTS;
    if (more > 0) fmu_log(fmu, LOG_EVENTS, FMU_OK, "%lld more transitions in this step", more);
}
