/* FMI 2.0, what both kinds have: life cycle, values, states.
 *
 * Status: fmi2Discard where something is refused and the instance stays as it was; fmi2Error where the standard wants it, or
 * where host and FMU have parted, so that going on would give wrong results (then only a reset, a saved state or
 * fmi2FreeInstance help); never fmi2Fatal.  docs/fmu.md has the table. */
#include "calls.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define STATES_IN_BLOCK 2 /* states that are outputs: the integrals of the energy ledger */

/* ----------------------------------------------------------------------------------------------------------- inquiries */

FMI2_Export const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
FMI2_Export const char *fmi2GetVersion(void) { return fmi2Version; }

FMI2_Export fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    fmi2Status status = fmi2OK;
    REQUIRE(c, FMU_ANY, fmi2Discard);
    if (n) REQUIRE_POINTER(categories);
    fmu->log[LOG_EVENTS] = fmu->log[LOG_SOLVER] = on && n == 0;
    for (size_t i = 0; i < n; i++) {
        int known = 0;
        for (int k = 0; k < LOG_CATEGORIES && categories[i]; k++)
            if (!strcmp(categories[i], fmu_categories[k])) {
                if (k >= LOG_EVENTS) fmu->log[k] = on;
                known = 1;
            }
        if (known) continue;
        status = fmi2Warning;
        const char *name = categories[i] ? categories[i] : "(null)";
        fmu_log(fmu, LOG_WARNING, status, "%s: there is no log category %s", __func__, name);
    }
    return status;
}

/* ---------------------------------------------------------------------------------------------------------- life cycle */

static void to_instantiated(instance *fmu)
{
    fmu->mode = FMU_INSTANTIATED;
    fmu->stale = fmu->tolerance_set = fmu->stop_defined = fmu->discarded = fmu->derivatives_ready = fmu->viewed = 0;
    fmu->start = fmu->time = fmu->stop = 0.0;
}

static ts_sim *load(instance *fmu, const char *location, const char *guid, char *why, size_t capacity)
{
    size_t size;
    char *bytes = fmu_resource(location, "variables.bin", &size, why, capacity);
    if (!bytes) return NULL;
    if (!variables_read(&fmu->table, bytes, size)) {
        snprintf(why, capacity, "resources/variables.bin is damaged, cut or of another version; unzip the FMU anew");
        return NULL;
    }
    if (strcmp(guid, fmu->table.guid)) {
        snprintf(why, capacity, "the GUID %s is not that of this FMU, %s", guid, fmu->table.guid);
        return NULL;
    }
    if (!(bytes = fmu_resource(location, "model.bin", &size, why, capacity))) return NULL;
    ts_sim *sim = NULL;
    if (fmu_checksum(FMU_CHECKSUM, bytes, size) == fmu->table.model) sim = ts_create(bytes, size, why, capacity);
    else snprintf(why, capacity, "resources/model.bin is damaged, cut or that of another FMU; unzip this one anew");
    free(bytes);
    if (!sim) return NULL;
    int32_t reals = ts_real_count(sim), states = ts_continuous_count(sim);
    fmu->counted = reals + ts_integer_count(sim);
    fmu->state_count = fmu->table.count > fmu->counted ? states : 0;
    int32_t viewed = fmu->state_count ? 2 * states - STATES_IN_BLOCK : 0;
    if (reals == fmu->table.reals && fmu->counted + viewed == fmu->table.count) return sim;
    snprintf(why, capacity, "the library in binaries/ is of another version than resources/; unzip the FMU anew");
    ts_free(sim);
    return NULL;
}

static void release(instance *fmu)
{
    if (!fmu) return;
    ts_free(fmu->sim);
    variables_free(&fmu->table);
    free(fmu->derivatives);
    free(fmu->states);
    free(fmu->name);
    free(fmu);
}

FMI2_Export void fmi2FreeInstance(fmi2Component c) { release((instance *)c); }

/* What an instance of this kind needs beside its simulation.  0: there is no instance, and why. */
static int allocate(instance *fmu, fmi2Type type, char *why, size_t capacity)
{
    if (!fmu->sim) return 0;
    if (type != fmi2CoSimulation && !(type == fmi2ModelExchange && fmu->state_count)) {
        snprintf(why, capacity, "this FMU is for co-simulation only; build it anew with --kind me or both");
        return 0;
    }
    fmu->kind = type;
    fmu->first_output = ts_output_first(fmu->sim);
    fmu->derivatives = (double *)malloc(sizeof(double) * (size_t)(fmu->table.reals - fmu->first_output));
    fmu->states = (double *)malloc(2 * sizeof(double) * (size_t)(fmu->state_count + 1));
    if (fmu->derivatives && fmu->states) return 1;
    snprintf(why, capacity, "out of memory");
    return 0;
}

FMI2_Export fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                                          const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    char why[512] = "";
    instance *fmu = (instance *)calloc(1, sizeof *fmu);
    (void)visible;
    if (!fmu) return NULL;
    if (functions) fmu->host = *functions;
    for (int k = 0; k < LOG_CATEGORIES; k++) fmu->log[k] = k < LOG_EVENTS || logging;
    const char *title = name && *name ? name : "(no name)";
    if ((fmu->name = (char *)malloc(strlen(title) + 1))) strcpy(fmu->name, title);
    if (!fmu->name) snprintf(why, sizeof why, "out of memory");
    else if (!name || !*name) snprintf(why, sizeof why, "the instance needs a name");
    else if (!guid || !location) snprintf(why, sizeof why, "GUID and resource location are needed");
    else fmu->sim = load(fmu, location, guid, why, sizeof why);
    if (!allocate(fmu, type, why, sizeof why)) {
        if (fmu->name) fmu_log(fmu, LOG_ERROR, fmi2Error, "%s: %s", __func__, why);
        release(fmu);
        return NULL;
    }
    fmu->values = ts_values(fmu->sim);
    fmu->integers = ts_integers(fmu->sim);
    fmu->tolerance = fmu->values[fmu->table.tolerance];
    fmu->identity = fmu_checksum(FMU_CHECKSUM, fmu->table.guid, strlen(fmu->table.guid));
    to_instantiated(fmu);
    return fmu;
}

static int accepts(const variable_table *t, int32_t reference, double value)
{
    return t->low[reference] <= value && value <= t->high[reference]; /* false for NaN */
}

/* A host's tolerance may tighten the FMU's own and not loosen it: hosts that pass a default of theirs, often 1e-4, would lose the
 * promised accuracy unasked.  fmi2OK with a message, since some hosts take fmi2Warning here for a failure. */
static void take_tolerance(instance *fmu, const char *what, double tolerance)
{
    int32_t place = fmu->table.tolerance;
    char given[32], own[32];
    fmu_number(tolerance, given);
    if (!accepts(&fmu->table, place, tolerance)) {
        fmu_log(fmu, LOG_WARNING, fmi2Warning, "%s: the tolerance %s is out of range: ignored", what, given);
        return;
    }
    fmu->values[place] = tolerance < fmu->tolerance ? tolerance : fmu->tolerance;
    if (tolerance <= fmu->tolerance) return;
    const char *form =
        "%s: the tolerance %s is looser than %s, which the promised accuracy needs and which is used; to loosen it, "
        "set solver.tolerance";
    fmu_log(fmu, LOG_WARNING, fmi2Warning, form, what, given, fmu_number(fmu->tolerance, own));
}

FMI2_Export fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                                           fmi2Boolean stop_defined, fmi2Real stop)
{
    REQUIRE(c, FMU_INSTANTIATED, fmi2Error);
    if (!isfinite(start)) return fmu_refuse(fmu, __func__, "the start time is not a finite number");
    if (stop_defined && !(stop >= start)) return fmu_refuse(fmu, __func__, "the stop time lies before the start time");
    fmu->start = fmu->time = start;
    fmu->stop = stop;
    fmu->stop_defined = stop_defined != 0;
    if (tolerance_defined && !fmu->tolerance_set) take_tolerance(fmu, __func__, tolerance);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    REQUIRE(c, FMU_INSTANTIATED, fmi2Error);
    fmu->mode = FMU_INITIALIZATION;
    fmu->stale = 1;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    REQUIRE(c, FMU_INITIALIZATION, fmi2Error);
    if (!fmu_refresh(fmu, __func__)) return fmu_refuse(fmu, __func__, "the start values above must be mended");
    fmu->mode = fmu->kind == fmi2ModelExchange ? FMU_EVENT : FMU_STEPPING;
    fmu->viewed = 0;
    return fmi2OK;
}

static void log_solver(const instance *fmu)
{
    int64_t s[TS_STATS];
    if (!fmu->log[LOG_SOLVER]) return;
    ts_stats(fmu->sim, s);
    const char *form = "since the start: %lld steps (%lld implicit), %lld rejected, %lld right-hand sides, %lld Jacobians, "
                       "%lld transitions";
    fmu_log(fmu, LOG_SOLVER, fmi2OK, form, (long long)s[TS_STEPS], (long long)s[TS_IMPLICIT_STEPS], (long long)s[TS_REJECTED],
            (long long)s[TS_RHS], (long long)s[TS_JACOBIANS], (long long)s[TS_TRANSITIONS]);
}

FMI2_Export fmi2Status fmi2Terminate(fmi2Component c)
{
    REQUIRE(c, FMU_STEPPING | FMU_EVENT | FMU_CONTINUOUS, fmi2Error);
    log_solver(fmu);
    fmu->mode = FMU_TERMINATED;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2Reset(fmi2Component c)
{
    REQUIRE(c, FMU_ANY, fmi2Error);
    if (ts_reset(fmu->sim) != TS_OK) return fmu_error(fmu, __func__, ts_message(fmu->sim));
    to_instantiated(fmu);
    return fmi2OK;
}

/* -------------------------------------------------------------------------------------------------------------- values */

/* What of the view these references need, see fmu_view(). */
static int needed(const instance *fmu, const fmi2ValueReference vr[], size_t n)
{
    int what = 0;
    const uint32_t outputs = (uint32_t)fmu->first_output, reals = (uint32_t)fmu->table.reals, end = (uint32_t)fmu->counted;
    const uint32_t rates = end + (uint32_t)(fmu->state_count - STATES_IN_BLOCK);
    for (size_t i = 0; i < n; i++)
        what |= vr[i] >= rates                       ? VIEW_DERIVATIVES
                : vr[i] >= end                       ? VIEW_STATES
                : vr[i] >= outputs || vr[i] >= reals ? VIEW_OUTPUTS
                                                     : 0;
    return what;
}

/* Are the values behind these references those of now?  0: there are none. */
static int look(instance *fmu, const fmi2ValueReference vr[], size_t n, const char *what)
{
    if (fmu->mode == FMU_INITIALIZATION && n && !fmu_refresh(fmu, what)) return 0;
    return !fmu->state_count || fmu_view(fmu, needed(fmu, vr, n), what);
}

static double number_at(const instance *fmu, uint32_t vr)
{
    const uint32_t reals = (uint32_t)fmu->table.reals, end = (uint32_t)fmu->counted;
    const uint32_t named = (uint32_t)(fmu->state_count - STATES_IN_BLOCK);
    if (vr < reals) return fmu->values[vr];
    if (vr < end) return fmu->integers[vr - reals];
    return fmu->states[vr - end < named ? vr - end : vr - end + STATES_IN_BLOCK];
}

/* Some importers read every output as a Real; references are unique over the types, so that an integer is clear. */
FMI2_Export fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    REQUIRE(c, AFTER_START, fmi2Discard);
    REQUIRE_KNOWN(value, 0, fmu->table.count, "Real");
    if (!look(fmu, vr, n, __func__)) return fmi2Discard;
    for (size_t i = 0; i < n; i++) value[i] = number_at(fmu, vr[i]);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    REQUIRE(c, AFTER_START, fmi2Discard);
    REQUIRE_KNOWN(value, fmu->table.reals, fmu->counted, "Integer");
    if (!look(fmu, vr, n, __func__)) return fmi2Discard;
    for (size_t i = 0; i < n; i++) value[i] = fmu->integers[vr[i] - (uint32_t)fmu->table.reals];
    return fmi2OK;
}

/* May a variable be set now?  While a host integrates, only inputs. */
static int may_be_set(const instance *fmu, uint32_t vr)
{
    int settable = fmu->table.settable[vr];
    if (fmu->mode == FMU_EVENT) return settable & FMU_STEPPING;
    if (fmu->mode == FMU_CONTINUOUS) return settable & FMU_STEPPING && vr < (uint32_t)ts_input_count(fmu->sim);
    return settable & fmu->mode;
}

/* May the variable take the value now?  fmi2OK, or the status that says why not. */
static fmi2Status judge(const instance *fmu, const char *what, fmi2ValueReference vr, double value, double present)
{
    const variable_table *t = &fmu->table;
    char a[32], b[32], d[32], e[32];
    if (!may_be_set(fmu, vr)) {
        if (value == present) return fmi2OK;
        const char *why = !t->settable[vr]                 ? "it is an output"
                          : t->settable[vr] & FMU_STEPPING ? "a tunable parameter changes in Event Mode"
                                                           : "a fixed parameter cannot change after initialization";
        char text[256];
        snprintf(text, sizeof text, "%.100s = %s: %s", t->name[vr], fmu_number(value, a), why);
        return fmu_refuse(fmu, what, text);
    }
    if (accepts(t, (int32_t)vr, value)) return fmi2OK;
    fmu_log(fmu, LOG_DISCARD, fmi2Discard, "%s: %s = %s refused, %s kept: it must be finite%s%s%s%s", what, t->name[vr],
            fmu_number(value, a), fmu_number(present, b), t->low[vr] > -DBL_MAX ? ", at least " : "",
            t->low[vr] > -DBL_MAX ? fmu_number(t->low[vr], d) : "", t->high[vr] < DBL_MAX ? ", at most " : "",
            t->high[vr] < DBL_MAX ? fmu_number(t->high[vr], e) : "");
    return fmi2Discard;
}

/* Values before the first step change the start. */
static void note_early(instance *fmu, const fmi2ValueReference vr[], size_t n)
{
    fmu->viewed = 0;
    if (!(fmu->mode & (FMU_INSTANTIATED | FMU_INITIALIZATION))) return;
    fmu->stale = fmu->mode == FMU_INITIALIZATION;
    for (size_t i = 0; i < n; i++) fmu->tolerance_set |= (int32_t)vr[i] == fmu->table.tolerance;
}

FMI2_Export fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    REQUIRE(c, SETTING, fmi2Discard);
    REQUIRE_KNOWN(value, 0, fmu->table.reals, "Real");
    const variable_table *t = &fmu->table;
    for (size_t i = 0; i < n; i++) {
        if (may_be_set(fmu, vr[i]) && accepts(t, (int32_t)vr[i], value[i])) continue;
        fmi2Status status = judge(fmu, __func__, vr[i], value[i], fmu->values[vr[i]]);
        if (status != fmi2OK) return status;
    }
    for (size_t i = 0; i < n; i++) fmu->values[vr[i]] = value[i];
    note_early(fmu, vr, n);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    REQUIRE(c, SETTING, fmi2Discard);
    REQUIRE_KNOWN(value, fmu->table.reals, fmu->counted, "Integer");
    for (size_t i = 0; i < n; i++) {
        fmi2Status status = judge(fmu, __func__, vr[i], value[i], fmu->integers[vr[i] - (uint32_t)fmu->table.reals]);
        if (status != fmi2OK) return status;
    }
    for (size_t i = 0; i < n; i++) fmu->integers[vr[i] - (uint32_t)fmu->table.reals] = value[i];
    note_early(fmu, vr, n);
    return fmi2OK;
}

/* There are no variables of the other types: only an empty list is right. */
static fmi2Status none(fmi2Component c, int modes, const fmi2ValueReference vr[], size_t n, const char *what, const char *type)
{
    instance *fmu = (instance *)c;
    fmi2Status status = fmu_in_order(fmu, modes, fmi2Discard, what);
    return status == fmi2OK ? fmu_look_up(fmu, what, vr, n, vr, 0, 0, type) : status;
}

FMI2_Export fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    (void)value;
    return none(c, AFTER_START, vr, n, __func__, "Boolean");
}

FMI2_Export fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    (void)value;
    return none(c, AFTER_START, vr, n, __func__, "String");
}

FMI2_Export fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    (void)value;
    return none(c, SETTING, vr, n, __func__, "Boolean");
}

FMI2_Export fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    (void)value;
    return none(c, SETTING, vr, n, __func__, "String");
}

FMI2_Export fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                                    const fmi2ValueReference known[], size_t knowns, const fmi2Real change[],
                                                    fmi2Real response[])
{
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)change, (void)response;
    REQUIRE(c, AFTER_START, fmi2Discard);
    return fmu_refuse(fmu, __func__, "directional derivatives are not provided: no output depends directly on an input");
}

/* -------------------------------------------------------------------------------------------------------------- states */

#define REQUIRE_STATE(bytes, size)                         \
    const char *why = fmu_state_refusal(fmu, bytes, size); \
    if (why) return fmu_refuse(fmu, __func__, why)

FMI2_Export fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    REQUIRE(c, FMU_ANY, fmi2Discard);
    REQUIRE_POINTER(state);
    if (!*state && !(*state = malloc(fmu_state_size(fmu)))) return fmu_error(fmu, __func__, "out of memory");
    fmu_state_save(fmu, (char *)*state);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    REQUIRE(c, FMU_ANY, fmi2Discard);
    REQUIRE_POINTER(state);
    REQUIRE_STATE((const char *)state, fmu_state_size(fmu));
    fmu->derivatives_ready = fmu->viewed = 0;
    return fmu_state_restore(fmu, (const char *)state) == TS_OK ? fmi2OK : fmu_error(fmu, __func__, ts_message(fmu->sim));
}

FMI2_Export fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    REQUIRE(c, FMU_ANY, fmi2Discard);
    if (!state) return fmi2OK;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    REQUIRE(c, FMU_ANY, fmi2Discard);
    REQUIRE_POINTER(state);
    REQUIRE_POINTER(size);
    REQUIRE_STATE((const char *)state, fmu_state_size(fmu));
    *size = fmu_state_size(fmu);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    REQUIRE(c, FMU_ANY, fmi2Discard);
    REQUIRE_POINTER(state);
    REQUIRE_POINTER(bytes);
    REQUIRE_STATE((const char *)state, fmu_state_size(fmu));
    if (size < fmu_state_size(fmu)) return fmu_refuse(fmu, __func__, "the vector is too short; ask fmi2SerializedFMUstateSize");
    memcpy(bytes, state, fmu_state_size(fmu));
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    REQUIRE(c, FMU_ANY, fmi2Discard);
    REQUIRE_POINTER(bytes);
    REQUIRE_POINTER(state);
    REQUIRE_STATE(bytes, size);
    char *copy = (char *)malloc(size);
    if (!copy) return fmu_error(fmu, __func__, "out of memory");
    memcpy(copy, bytes, size);
    *state = copy;
    return fmi2OK;
}
