/* FMI 2.0 for co-simulation: order of calls, values, steps, states.
 *
 * Status: fmi2Discard where something is refused and the instance stays as it was; fmi2Error where the standard wants it, or
 * where host and FMU have parted, so that going on would give wrong results (then only a reset, a saved state or
 * fmi2FreeInstance help); never fmi2Fatal.  docs/fmu.md has the table. */
#include "instance.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAX_EVENTS 1000 /* logged per step */
#define AFTER_START (FMU_INITIALIZATION | FMU_STEPPING | FMU_TERMINATED | FMU_ERROR)

/* ------------------------------------------------------------------------------------------------------------ helpers */

static fmi2Status error(instance *fmu, const char *what, const char *why)
{
    fmu->mode = FMU_ERROR;
    fmu_log(fmu, LOG_ERROR, fmi2Error, "%s: %s", what, why);
    return fmi2Error;
}

static fmi2Status refuse(const instance *fmu, const char *what, const char *why)
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
    case FMU_TERMINATED: return "after fmi2Terminate";
    default: return "after an error; reset the instance or put a saved state back";
    }
}

/* fmi2OK where the call is allowed now; else `otherwise`: fmi2Error for what moves the instance on, fmi2Discard for what only
 * sets, reads or saves. */
static fmi2Status in_order(instance *fmu, int modes, fmi2Status otherwise, const char *what)
{
    if (!fmu) return fmi2Error;
    if (fmu->mode & modes) return fmi2OK;
    char why[128];
    snprintf(why, sizeof why, "must not be called %s", mode_name(fmu->mode));
    return otherwise == fmi2Error || fmu->mode == FMU_ERROR ? error(fmu, what, why) : refuse(fmu, what, why);
}

#define REQUIRE(component, modes, otherwise)                             \
    instance *fmu = (instance *)component;                               \
    fmi2Status order_status = in_order(fmu, modes, otherwise, __func__); \
    if (order_status != fmi2OK) return order_status

#define REQUIRE_POINTER(pointer) \
    if (!(pointer)) return refuse(fmu, __func__, "a null pointer was passed")

/* The kernel's message with the name of the value that it refuses. */
static const char *refused_value(const instance *fmu, char *text, size_t capacity)
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

/* Initialization Mode: outputs follow inputs and parameters at once, computed when somebody looks. */
static int refresh(instance *fmu, const char *what)
{
    if (!fmu->stale) return 1;
    int32_t index = -1;
    char why[320];
    if (ts_check(fmu->sim, &index) != TS_OK) {
        fmu_log(fmu, LOG_DISCARD, fmi2Discard, "%s: %s", what, refused_value(fmu, why, sizeof why));
        return 0;
    }
    if (ts_initialize(fmu->sim, fmu->start) != TS_OK) {
        fmu_log(fmu, LOG_DISCARD, fmi2Discard, "%s: no start can be computed: %s", what, ts_message(fmu->sim));
        return 0;
    }
    fmu->stale = fmu->derivatives_ready = 0;
    return 1;
}

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
    fmu->stale = fmu->tolerance_set = fmu->stop_defined = fmu->discarded = fmu->derivatives_ready = 0;
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
    int32_t reals = ts_real_count(sim), integers = ts_integer_count(sim);
    if (reals == fmu->table.reals && reals + integers == fmu->table.count) return sim;
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
    free(fmu->name);
    free(fmu);
}

FMI2_Export void fmi2FreeInstance(fmi2Component c) { release((instance *)c); }

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
    else if (type != fmi2CoSimulation) snprintf(why, sizeof why, "this FMU is for co-simulation only");
    else if (!guid || !location) snprintf(why, sizeof why, "GUID and resource location are needed");
    else fmu->sim = load(fmu, location, guid, why, sizeof why);
    if (fmu->sim) {
        fmu->first_output = ts_output_first(fmu->sim);
        fmu->derivatives = (double *)malloc(sizeof(double) * (size_t)(fmu->table.reals - fmu->first_output));
        if (!fmu->derivatives) snprintf(why, sizeof why, "out of memory");
    }
    if (!fmu->sim || !fmu->derivatives) {
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
    if (!isfinite(start)) return refuse(fmu, __func__, "the start time is not a finite number");
    if (stop_defined && !(stop >= start)) return refuse(fmu, __func__, "the stop time lies before the start time");
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
    if (!refresh(fmu, __func__)) return refuse(fmu, __func__, "the start values above must be mended");
    fmu->mode = FMU_STEPPING;
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
    REQUIRE(c, FMU_STEPPING, fmi2Error);
    log_solver(fmu);
    fmu->mode = FMU_TERMINATED;
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2Reset(fmi2Component c)
{
    REQUIRE(c, FMU_ANY, fmi2Error);
    if (ts_reset(fmu->sim) != TS_OK) return error(fmu, __func__, ts_message(fmu->sim));
    to_instantiated(fmu);
    return fmi2OK;
}

/* -------------------------------------------------------------------------------------------------------------- values */

/* fmi2OK where values and the variables of these references are there, all of first..end-1; type: what these are. */
static fmi2Status look_up(const instance *fmu, const char *what, const fmi2ValueReference vr[], size_t n, const void *values,
                          int32_t first, int32_t end, const char *type)
{
    char why[96];
    if (n && (!vr || !values)) return refuse(fmu, what, "a null pointer was passed");
    for (size_t i = 0; i < n; i++) {
        if (vr[i] >= (uint32_t)first && vr[i] < (uint32_t)end && (!fmu->table.gaps || *fmu->table.name[vr[i]])) continue;
        snprintf(why, sizeof why, "no %s variable has the value reference %u", type, vr[i]);
        return refuse(fmu, what, why);
    }
    return fmi2OK;
}

#define REQUIRE_KNOWN(values, first, end, type)                                        \
    fmi2Status found_status = look_up(fmu, __func__, vr, n, values, first, end, type); \
    if (found_status != fmi2OK) return found_status

/* Some importers read every output as a Real; references are unique over the types, so that an integer is clear. */
FMI2_Export fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    REQUIRE(c, AFTER_START, fmi2Discard);
    REQUIRE_KNOWN(value, 0, fmu->table.count, "Real");
    if (n && fmu->mode == FMU_INITIALIZATION && !refresh(fmu, __func__)) return fmi2Discard;
    const uint32_t reals = (uint32_t)fmu->table.reals;
    for (size_t i = 0; i < n; i++) value[i] = vr[i] < reals ? fmu->values[vr[i]] : fmu->integers[vr[i] - reals];
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    REQUIRE(c, AFTER_START, fmi2Discard);
    REQUIRE_KNOWN(value, fmu->table.reals, fmu->table.count, "Integer");
    if (n && fmu->mode == FMU_INITIALIZATION && !refresh(fmu, __func__)) return fmi2Discard;
    for (size_t i = 0; i < n; i++) value[i] = fmu->integers[vr[i] - (uint32_t)fmu->table.reals];
    return fmi2OK;
}

/* May the variable take the value now?  fmi2OK, or the status that says why not. */
static fmi2Status judge(const instance *fmu, const char *what, fmi2ValueReference vr, double value, double present)
{
    const variable_table *t = &fmu->table;
    char a[32], b[32], d[32], e[32];
    if (!(t->settable[vr] & fmu->mode)) {
        if (value == present) return fmi2OK;
        const char *why = t->settable[vr] ? "a fixed parameter cannot change after initialization" : "it is an output";
        char text[256];
        snprintf(text, sizeof text, "%.100s = %s: %s", t->name[vr], fmu_number(value, a), why);
        return refuse(fmu, what, text);
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
    if (fmu->mode == FMU_STEPPING) return;
    fmu->stale = fmu->mode == FMU_INITIALIZATION;
    for (size_t i = 0; i < n; i++) fmu->tolerance_set |= (int32_t)vr[i] == fmu->table.tolerance;
}

FMI2_Export fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    REQUIRE(c, FMU_INSTANTIATED | FMU_INITIALIZATION | FMU_STEPPING, fmi2Discard);
    REQUIRE_KNOWN(value, 0, fmu->table.reals, "Real");
    const variable_table *t = &fmu->table;
    for (size_t i = 0; i < n; i++) {
        if ((t->settable[vr[i]] & fmu->mode) && accepts(t, (int32_t)vr[i], value[i])) continue;
        fmi2Status status = judge(fmu, __func__, vr[i], value[i], fmu->values[vr[i]]);
        if (status != fmi2OK) return status;
    }
    for (size_t i = 0; i < n; i++) fmu->values[vr[i]] = value[i];
    note_early(fmu, vr, n);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    REQUIRE(c, FMU_INSTANTIATED | FMU_INITIALIZATION | FMU_STEPPING, fmi2Discard);
    REQUIRE_KNOWN(value, fmu->table.reals, fmu->table.count, "Integer");
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
    fmi2Status status = in_order(fmu, modes, fmi2Discard, what);
    return status == fmi2OK ? look_up(fmu, what, vr, n, vr, 0, 0, type) : status;
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
    return none(c, FMU_INSTANTIATED | FMU_INITIALIZATION | FMU_STEPPING, vr, n, __func__, "Boolean");
}

FMI2_Export fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    (void)value;
    return none(c, FMU_INSTANTIATED | FMU_INITIALIZATION | FMU_STEPPING, vr, n, __func__, "String");
}

/* --------------------------------------------------------------------------------------------------------------- steps */

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

static void log_events(const instance *fmu)
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
    if (wrong_time(fmu, point, h, why, sizeof why)) return error(fmu, __func__, why);
    int status = ts_step(fmu->sim, h);
    int names_one = status == TS_BAD_INPUT && ts_concerned(fmu->sim) >= 0;
    if (status != TS_OK) return discard(fmu, point, names_one ? refused_value(fmu, why, sizeof why) : ts_message(fmu->sim));
    fmu->discarded = fmu->derivatives_ready = 0;
    fmu->time = point + h;
    if (fmu->log[LOG_EVENTS] && ts_transition_count(fmu->sim)) log_events(fmu);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2CancelStep(fmi2Component c)
{
    REQUIRE(c, FMU_ANY, fmi2Discard);
    return refuse(fmu, __func__, "no step is under way: fmi2DoStep returns when it is done, never fmi2Pending");
}

static fmi2Status not_pending(const instance *fmu, const char *what)
{
    return refuse(fmu, what, "no step is ever pending here");
}

/* What could be asked only while a step is pending. */
static fmi2Status never(fmi2Component c, const char *what)
{
    instance *fmu = (instance *)c;
    fmi2Status status = in_order(fmu, FMU_STEPPING | FMU_TERMINATED, fmi2Discard, what);
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
    int32_t inputs = ts_input_count(fmu->sim);
    double *slopes = ts_slopes(fmu->sim);
    REQUIRE_KNOWN(order ? value : NULL, 0, inputs, "input");
    for (size_t i = 0; i < n; i++) {
        if (order[i] != 1 && order[i] != 2) return refuse(fmu, __func__, "only derivatives of order 1 and 2 are used");
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
    REQUIRE_KNOWN(order ? value : NULL, fmu->first_output, fmu->table.reals, "Real output");
    for (size_t i = 0; i < n; i++)
        if (order[i] != 1) return refuse(fmu, __func__, "only derivatives of order 1 are given");
    if (!fmu->derivatives_ready && ts_output_derivatives(fmu->sim, fmu->derivatives) != TS_OK)
        return refuse(fmu, __func__, ts_message(fmu->sim));
    fmu->derivatives_ready = 1;
    for (size_t i = 0; i < n; i++) value[i] = fmu->derivatives[vr[i] - (uint32_t)fmu->first_output];
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                                    const fmi2ValueReference known[], size_t knowns, const fmi2Real change[],
                                                    fmi2Real response[])
{
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)change, (void)response;
    REQUIRE(c, AFTER_START, fmi2Discard);
    return refuse(fmu, __func__, "directional derivatives are not provided: no output depends directly on an input");
}

/* -------------------------------------------------------------------------------------------------------------- states */

#define REQUIRE_STATE(bytes, size)                         \
    const char *why = fmu_state_refusal(fmu, bytes, size); \
    if (why) return refuse(fmu, __func__, why)

FMI2_Export fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    REQUIRE(c, FMU_ANY, fmi2Discard);
    REQUIRE_POINTER(state);
    if (!*state && !(*state = malloc(fmu_state_size(fmu)))) return error(fmu, __func__, "out of memory");
    fmu_state_save(fmu, (char *)*state);
    return fmi2OK;
}

FMI2_Export fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    REQUIRE(c, FMU_ANY, fmi2Discard);
    REQUIRE_POINTER(state);
    REQUIRE_STATE((const char *)state, fmu_state_size(fmu));
    fmu->derivatives_ready = 0;
    return fmu_state_restore(fmu, (const char *)state) == TS_OK ? fmi2OK : error(fmu, __func__, ts_message(fmu->sim));
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
    if (size < fmu_state_size(fmu)) return refuse(fmu, __func__, "the vector is too short; ask fmi2SerializedFMUstateSize");
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
    if (!copy) return error(fmu, __func__, "out of memory");
    memcpy(copy, bytes, size);
    *state = copy;
    return fmi2OK;
}
