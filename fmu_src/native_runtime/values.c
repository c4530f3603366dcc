/* Values by reference: which may be looked at and set now, and what they must be. */
#include "calls.h"

#include <float.h>
#include <math.h>
#include <stdio.h>

#define STATES_IN_BLOCK 2 /* states that are outputs: the integrals of the energy ledger */

/* Are all of these scalars among the kernel's reals, as most are?  Then there is nothing to look up. */
static int plain(const instance *fmu, const uint32_t vr[], size_t n, const void *values, size_t n_values)
{
    const uint32_t reals = (uint32_t)fmu->table.reals;
    const int32_t *span = fmu->table.span;
    if (n != n_values || !n || !vr || !values) return 0;
    for (size_t i = 0; i < n; i++)
        if (vr[i] >= reals || span[vr[i]] != 1) return 0;
    return 1;
}

/* ------------------------------------------------------------------------------------------------------------- reading */

/* What of the view these references need, see fmu_view(). */
static int needed(const instance *fmu, const uint32_t vr[], size_t n)
{
    int what = 0;
    const uint32_t outputs = (uint32_t)fmu->first_output, reals = (uint32_t)fmu->table.reals, end = (uint32_t)fmu->counted;
    const uint32_t time = (uint32_t)fmu->table.count;
    const uint32_t rates = fmu->state_count ? end + (uint32_t)(fmu->state_count - STATES_IN_BLOCK) : time;
    for (size_t i = 0; i < n; i++)
        what |= vr[i] > time                         ? VIEW_INDICATORS
                : vr[i] == time                      ? 0
                : vr[i] >= rates                     ? VIEW_DERIVATIVES
                : vr[i] >= end                       ? VIEW_STATES
                : vr[i] >= outputs || vr[i] >= reals ? VIEW_OUTPUTS
                                                     : 0;
    return what;
}

/* FMI 3.0: before initialization the start values of inputs and parameters can be looked at, and nothing else is there. */
static fmu_status only_start_values(const instance *fmu, const char *what, const uint32_t vr[], size_t n)
{
    char why[160];
    for (size_t i = 0; i < n; i++) {
        const uint32_t time = (uint32_t)fmu->table.count;
        if (vr[i] == time || (vr[i] < time && fmu->table.settable[vr[i]])) continue;
        snprintf(why, sizeof why, "%.100s has no value before Initialization Mode", fmu_name(fmu, vr[i]));
        return fmu_refuse(fmu, what, why);
    }
    return FMU_OK;
}

/* Are the values behind these references those of now?  FMU_DISCARD: there are none. */
static fmu_status look(instance *fmu, const uint32_t vr[], size_t n, const char *what)
{
    if (fmu->mode == MODE_INSTANTIATED) return only_start_values(fmu, what, vr, n);
    if (fmu->mode == MODE_INTERMEDIATE) return fmu_look_within(fmu, needed(fmu, vr, n), what) ? FMU_OK : FMU_DISCARD;
    if (fmu->mode == MODE_INITIALIZATION && n && !fmu_refresh(fmu, what)) return FMU_DISCARD;
    if (ts_fill_at(fmu->sim, vr, n) != TS_OK) return fmu_refuse(fmu, what, ts_message(fmu->sim));
    return !fmu->state_count || fmu_view(fmu, needed(fmu, vr, n), what) ? FMU_OK : FMU_DISCARD;
}

static double number_at(const instance *fmu, uint32_t vr)
{
    const uint32_t reals = (uint32_t)fmu->table.reals, end = (uint32_t)fmu->counted, time = (uint32_t)fmu->table.count;
    const uint32_t named = (uint32_t)(fmu->state_count - STATES_IN_BLOCK);
    if (vr < reals) return fmu->values[vr];
    if (vr < end) return fmu->integers[vr - reals];
    if (vr < time) return fmu->states[vr - end < named ? vr - end : vr - end + STATES_IN_BLOCK];
    return vr == time ? fmu->time : fmu->indicators[vr - time - 1];
}

/* FMI 2.0: some importers read every output as a Real; references are unique over the types, so that an integer is clear.
 * FMI 3.0: time and event indicators are variables, too. */
static fmu_range readable(const instance *fmu)
{
    const variable_table *t = &fmu->table;
    fmu_range range = {fmu->standard->real, 0, t->count, 0, 0};
    if (fmu->standard->number == 2) return range;
    range.end += 1 + fmu->indicator_count;
    range.other = t->reals;
    range.other_end = fmu->counted;
    return range;
}

fmu_status fmu_get_reals(instance *fmu, const char *what, const uint32_t vr[], size_t n, double value[], size_t n_values)
{
    const int scalars = plain(fmu, vr, n, value, n_values);
    fmu_status status = scalars ? FMU_OK : fmu_look_up(fmu, what, vr, n, value, n_values, readable(fmu));
    if (status == FMU_OK) status = look(fmu, vr, n, what);
    if (status != FMU_OK) return status;
    for (size_t i = 0; i < n && scalars; i++) value[i] = fmu->values[vr[i]];
    for (size_t i = 0; i < n && !scalars; i++)
        for (uint32_t k = 0, span = (uint32_t)fmu_span(fmu, vr[i]); k < span; k++) *value++ = number_at(fmu, vr[i] + k);
    return FMU_OK;
}

static fmu_range integers(const instance *fmu, int bytes)
{
    fmu_range range = {bytes == 8 ? "Int64" : fmu->standard->integer, fmu->table.reals, fmu->counted, 0, 0};
    return range;
}

fmu_status fmu_get_integers(instance *fmu, const char *what, const uint32_t vr[], size_t n, void *value, size_t n_values,
                            int bytes)
{
    fmu_status status = fmu_look_up(fmu, what, vr, n, value, n_values, integers(fmu, bytes));
    if (status == FMU_OK) status = look(fmu, vr, n, what);
    if (status != FMU_OK) return status;
    for (size_t i = 0; i < n; i++) {
        int32_t found = fmu->integers[vr[i] - (uint32_t)fmu->table.reals];
        if (bytes == 8) ((int64_t *)value)[i] = found;
        else ((int32_t *)value)[i] = found;
    }
    return FMU_OK;
}

/* ------------------------------------------------------------------------------------------------------------- setting */

static int accepts(const variable_table *t, uint32_t reference, double value)
{
    return t->low[reference] <= value && value <= t->high[reference]; /* false for NaN */
}

/* May a variable be set now?  While a host integrates, only inputs. */
static int may_be_set(const instance *fmu, uint32_t vr)
{
    int settable = fmu->table.settable[vr];
    if (fmu->mode == MODE_EVENT) return settable & MODE_STEPPING;
    if (fmu->mode == MODE_CONTINUOUS) return settable & MODE_STEPPING && vr < (uint32_t)ts_input_count(fmu->sim);
    return settable & fmu->mode;
}

/* May the variable take the value now?  FMU_OK, or the status that says why not. */
static fmu_status judge(const instance *fmu, const char *what, uint32_t vr, double value, double present)
{
    const variable_table *t = &fmu->table;
    char a[32], b[32], d[32], e[32];
    if (!may_be_set(fmu, vr)) {
        if (value == present) return FMU_OK;
        const char *why = !t->settable[vr]                  ? "it is an output"
                          : t->settable[vr] & MODE_STEPPING ? "a tunable parameter changes in Event Mode"
                                                            : "a fixed parameter cannot change after initialization";
        char text[256];
        snprintf(text, sizeof text, "%.100s = %s: %s", t->name[vr], fmu_number(value, a), why);
        return fmu_refuse(fmu, what, text);
    }
    if (accepts(t, vr, value)) return FMU_OK;
    fmu_log(fmu, LOG_DISCARD, FMU_DISCARD, "%s: %s = %s refused, %s kept: it must be finite%s%s%s%s", what, t->name[vr],
            fmu_number(value, a), fmu_number(present, b), t->low[vr] > -DBL_MAX ? ", at least " : "",
            t->low[vr] > -DBL_MAX ? fmu_number(t->low[vr], d) : "", t->high[vr] < DBL_MAX ? ", at most " : "",
            t->high[vr] < DBL_MAX ? fmu_number(t->high[vr], e) : "");
    return FMU_DISCARD;
}

/* Values before the first step change the start. */
static void note_early(instance *fmu, const uint32_t vr[], size_t n)
{
    fmu->viewed = 0;
    if (!(fmu->mode & (MODE_INSTANTIATED | MODE_INITIALIZATION))) return;
    fmu->stale = fmu->mode == MODE_INITIALIZATION;
    for (size_t i = 0; i < n; i++) fmu->tolerance_set |= (int32_t)vr[i] == fmu->table.tolerance;
}

/* What may be set; while a host integrates, also single states: CasADi sets no others, in FMI 2.0 too. */
static fmu_range writable(const instance *fmu)
{
    fmu_range range = {fmu->standard->real, 0, fmu->table.reals, 0, 0};
    if (fmu->mode != MODE_CONTINUOUS) return range;
    range.other = fmu->table.reals;
    range.other_end = fmu->counted;
    range.end = fmu->counted + fmu->state_count - STATES_IN_BLOCK;
    return range;
}

/* The place of a variable among the continuous states that can be set now; -1: it is none. */
static int32_t state_at(const instance *fmu, uint32_t vr)
{
    const int32_t at = (int32_t)vr, named = fmu->state_count - STATES_IN_BLOCK, integral = at - ts_integral_first(fmu->sim);
    if (fmu->mode != MODE_CONTINUOUS) return -1;
    if (at >= fmu->counted) return at - fmu->counted;
    return integral >= 0 && integral < STATES_IN_BLOCK ? named + integral : -1;
}

static fmu_status judge_real(const instance *fmu, const char *what, uint32_t vr, double value)
{
    if (state_at(fmu, vr) < 0) {
        if (may_be_set(fmu, vr) && accepts(&fmu->table, vr, value)) return FMU_OK;
        ts_fill_at(fmu->sim, &vr, 1); /* what an output is may be set */
        return judge(fmu, what, vr, value, fmu->values[vr]);
    }
    if (isfinite(value)) return FMU_OK;
    fmu_log(fmu, LOG_DISCARD, FMU_DISCARD, "%s: %s refused: it must be finite", what, fmu->table.name[vr]);
    return FMU_DISCARD;
}

/* Where a host does not integrate: may scalars that are plain() all take their values? */
static int all_can_be_set(const instance *fmu, const uint32_t vr[], size_t n, const double value[])
{
    const variable_table *t = &fmu->table;
    const int modes = fmu->mode == MODE_EVENT ? MODE_STEPPING : fmu->mode;
    for (size_t i = 0; i < n; i++)
        if (!(t->settable[vr[i]] & modes) || !accepts(t, vr[i], value[i])) return 0;
    return 1;
}

fmu_status fmu_set_reals(instance *fmu, const char *what, const uint32_t vr[], size_t n, const double value[], size_t n_values)
{
    const double *given = value;
    int states = 0;
    if (fmu->mode != MODE_CONTINUOUS && plain(fmu, vr, n, value, n_values) && all_can_be_set(fmu, vr, n, value)) {
        for (size_t i = 0; i < n; i++) fmu->values[vr[i]] = value[i];
        note_early(fmu, vr, n);
        return FMU_OK;
    }
    fmu_status status = fmu_look_up(fmu, what, vr, n, value, n_values, writable(fmu));
    for (size_t i = 0; status == FMU_OK && i < n; i++) {
        states |= state_at(fmu, vr[i]) >= 0;
        for (uint32_t at = vr[i], end = at + (uint32_t)fmu_span(fmu, at); at < end && status == FMU_OK; at++)
            status = judge_real(fmu, what, at, *given++);
    }
    if (status != FMU_OK) return status;
    if (states && !fmu_view(fmu, VIEW_STATES, what)) return FMU_DISCARD;
    for (size_t i = 0; i < n; i++)
        for (uint32_t at = vr[i], end = at + (uint32_t)fmu_span(fmu, at); at < end; at++) {
            const int32_t state = state_at(fmu, at);
            *(state < 0 ? fmu->values + at : fmu->states + state) = *value++;
        }
    note_early(fmu, vr, n);
    return states ? fmu_set_states(fmu, what, fmu->states, (size_t)fmu->state_count) : FMU_OK;
}

static double whole(const void *value, int bytes, size_t i)
{
    return bytes == 8 ? (double)((const int64_t *)value)[i] : (double)((const int32_t *)value)[i];
}

fmu_status fmu_set_integers(instance *fmu, const char *what, const uint32_t vr[], size_t n, const void *value, size_t n_values,
                            int bytes)
{
    const uint32_t reals = (uint32_t)fmu->table.reals;
    fmu_status status = fmu_look_up(fmu, what, vr, n, value, n_values, integers(fmu, bytes));
    for (size_t i = 0; i < n && status == FMU_OK; i++)
        status = judge(fmu, what, vr[i], whole(value, bytes, i), fmu->integers[vr[i] - reals]);
    if (status != FMU_OK) return status;
    for (size_t i = 0; i < n; i++) fmu->integers[vr[i] - reals] = (int32_t)whole(value, bytes, i);
    note_early(fmu, vr, n);
    return FMU_OK;
}
