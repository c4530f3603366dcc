/* The life cycle of an instance: from its resources to its end. */
#include "calls.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define STATES_IN_BLOCK 2 /* states that are outputs: the integrals of the energy ledger */

static void to_instantiated(instance *fmu)
{
    fmu->mode = MODE_INSTANTIATED;
    fmu->stale = fmu->tolerance_set = fmu->stop_defined = fmu->discarded = fmu->derivatives_ready = fmu->viewed = 0;
    fmu->start = fmu->time = fmu->stop = 0.0;
}

/* Are the integers one by one, and is the table that of this simulation? */
static int table_fits(instance *fmu, const ts_sim *sim)
{
    const variable_table *t = &fmu->table;
    int32_t reals = ts_real_count(sim), states = ts_continuous_count(sim);
    fmu->counted = reals + ts_integer_count(sim);
    fmu->state_count = t->count > fmu->counted ? states : 0;
    fmu->indicator_count = fmu->state_count ? ts_indicator_count(sim) : 0;
    int32_t viewed = fmu->state_count ? 2 * states - STATES_IN_BLOCK : 0;
    if (reals != t->reals || fmu->counted + viewed != t->count) return 0;
    for (int32_t i = reals; i < fmu->counted; i++)
        if (t->span[i] > 1) return 0;
    return 1;
}

static ts_sim *load(instance *fmu, const char *location, const char *token, char *why, size_t capacity)
{
    size_t size;
    char *bytes = fmu_resource(location, "variables.bin", &size, why, capacity);
    if (!bytes) return NULL;
    if (!variables_read(&fmu->table, bytes, size)) {
        snprintf(why, capacity, "resources/variables.bin is damaged, cut or of another version; unzip the FMU anew");
        return NULL;
    }
    if (strcmp(token, fmu->table.guid)) {
        snprintf(why, capacity, "the %s %s is not that of this FMU, %s", fmu->standard->token, token, fmu->table.guid);
        return NULL;
    }
    if (!(bytes = fmu_resource(location, "model.bin", &size, why, capacity))) return NULL;
    ts_sim *sim = NULL;
    if (fmu_checksum(FMU_CHECKSUM, bytes, size) == fmu->table.model) sim = ts_create(bytes, size, why, capacity);
    else snprintf(why, capacity, "resources/model.bin is damaged, cut or that of another FMU; unzip this one anew");
    free(bytes);
    if (!sim || table_fits(fmu, sim)) return sim;
    snprintf(why, capacity, "the library in binaries/ is of another version than resources/; unzip the FMU anew");
    ts_free(sim);
    return NULL;
}

void fmu_release(instance *fmu)
{
    if (!fmu) return;
    ts_free(fmu->sim);
    variables_free(&fmu->table);
    free(fmu->derivatives);
    free(fmu->states);
    free(fmu->known);
    free(fmu->name);
    free(fmu);
}

/* What an instance of this kind needs beside its simulation.  0: there is no instance, and why. */
static int allocate(instance *fmu, char *why, size_t capacity)
{
    if (!fmu->sim) return 0;
    if (fmu->kind == FMU_OTHER_KIND || (fmu->kind == FMU_MODEL_EXCHANGE && !fmu->state_count)) {
        const char *kinds = fmu->state_count ? "co-simulation and for model exchange, nothing else" : "co-simulation only";
        const char *remedy = fmu->kind == FMU_MODEL_EXCHANGE ? "; build it anew with --kind me or both" : "";
        snprintf(why, capacity, "this FMU is for %s%s", kinds, remedy);
        return 0;
    }
    if (fmu->kind == FMU_CO_SIMULATION) ts_want(fmu->sim, 0); /* outputs are computed when somebody reads them, values.c */
    fmu->first_output = ts_output_first(fmu->sim);
    fmu->derivatives = (double *)malloc(sizeof(double) * (size_t)(fmu->table.reals - fmu->first_output));
    fmu->states = (double *)malloc(sizeof(double) * (size_t)(2 * fmu->state_count + fmu->indicator_count + 1));
    const int partials = fmu->kind == FMU_MODEL_EXCHANGE || fmu->standard->number > 2;
    if (fmu->derivatives && fmu->states && (!partials || fmu_prepare_partials(fmu))) {
        fmu->indicators = fmu->states + 2 * fmu->state_count;
        return 1;
    }
    snprintf(why, capacity, "out of memory");
    return 0;
}

instance *fmu_instantiate(const fmu_request *request)
{
    char why[512] = "";
    instance *fmu = (instance *)calloc(1, sizeof *fmu);
    const fmu_standard *standard = request->standard;
    if (!fmu) return NULL;
    fmu->standard = standard;
    fmu->environment = request->environment;
    fmu->logger = request->logger;
    fmu->kind = request->kind;
    for (int k = 0; k < LOG_CATEGORIES; k++) fmu->log[k] = fmu_always_said(fmu, k) || request->logging;
    const char *name = request->name, *title = name && name[strspn(name, " \t\r\n")] ? name : "(no name)";
    if ((fmu->name = (char *)malloc(strlen(title) + 1))) strcpy(fmu->name, title);
    if (!fmu->name) snprintf(why, sizeof why, "out of memory");
    else if (title != name) snprintf(why, sizeof why, "the instance needs a name");
    else if (!request->token || !request->location)
        snprintf(why, sizeof why, "%s and %s are needed", standard->token, standard->location);
    else fmu->sim = load(fmu, request->location, request->token, why, sizeof why);
    if (!allocate(fmu, why, sizeof why)) {
        if (fmu->name) fmu_log(fmu, LOG_ERROR, FMU_ERROR, "%s: %s", request->what, why);
        fmu_release(fmu);
        return NULL;
    }
    fmu->values = ts_values(fmu->sim);
    fmu->integers = ts_integers(fmu->sim);
    fmu->tolerance = fmu->values[fmu->table.tolerance];
    fmu->identity = fmu_checksum(FMU_CHECKSUM, fmu->table.guid, strlen(fmu->table.guid));
    to_instantiated(fmu);
    return fmu;
}

/* A host's tolerance may tighten the FMU's own and not loosen it: hosts that pass a default of theirs, often 1e-4, would lose the
 * promised accuracy unasked.  FMU_OK with a message, since some hosts take a warning here for a failure. */
static void take_tolerance(instance *fmu, const char *what, double tolerance)
{
    int32_t place = fmu->table.tolerance;
    char given[32], own[32];
    if (!fmu->table.span[place]) return; /* this FMU has no solver of its own */
    fmu_number(tolerance, given);
    if (!(fmu->table.low[place] <= tolerance && tolerance <= fmu->table.high[place])) {
        fmu_log(fmu, LOG_WARNING, FMU_WARNING, "%s: the tolerance %s is out of range: ignored", what, given);
        return;
    }
    fmu->values[place] = tolerance < fmu->tolerance ? tolerance : fmu->tolerance;
    if (tolerance <= fmu->tolerance) return;
    const char *form =
        "%s: the tolerance %s is looser than %s, which the promised accuracy needs and which is used; to loosen it, "
        "set solver.tolerance";
    fmu_log(fmu, LOG_WARNING, FMU_WARNING, form, what, given, fmu_number(fmu->tolerance, own));
}

fmu_status fmu_set_experiment(instance *fmu, const char *what, int tolerance_defined, double tolerance, double start,
                              int stop_defined, double stop)
{
    if (!isfinite(start)) return fmu_refuse(fmu, what, "the start time is not a finite number");
    if (stop_defined && !(stop >= start)) return fmu_refuse(fmu, what, "the stop time lies before the start time");
    fmu->start = fmu->time = start;
    fmu->stop = stop;
    fmu->stop_defined = stop_defined != 0;
    if (tolerance_defined && !fmu->tolerance_set) take_tolerance(fmu, what, tolerance);
    return FMU_OK;
}

fmu_status fmu_enter_initialization(instance *fmu)
{
    fmu->mode = MODE_INITIALIZATION;
    fmu->stale = 1;
    return FMU_OK;
}

fmu_status fmu_exit_initialization(instance *fmu, const char *what)
{
    if (!fmu_refresh(fmu, what)) return fmu_refuse(fmu, what, "the start values above must be mended");
    fmu->mode = fmu->kind == FMU_MODEL_EXCHANGE || fmu->event_mode ? MODE_EVENT : MODE_STEPPING;
    fmu->viewed = 0;
    return FMU_OK;
}

static void log_solver(const instance *fmu)
{
    int64_t s[TS_STATS];
    if (!fmu->log[LOG_SOLVER]) return;
    ts_stats(fmu->sim, s);
    const char *form = "since the start: %lld steps (%lld implicit), %lld rejected, %lld right-hand sides, %lld Jacobians, "
                       "%lld transitions";
    fmu_log(fmu, LOG_SOLVER, FMU_OK, form, (long long)s[TS_STEPS], (long long)s[TS_IMPLICIT_STEPS], (long long)s[TS_REJECTED],
            (long long)s[TS_RHS], (long long)s[TS_JACOBIANS], (long long)s[TS_TRANSITIONS]);
}

fmu_status fmu_terminate(instance *fmu)
{
    log_solver(fmu);
    fmu->mode = MODE_TERMINATED;
    return FMU_OK;
}

fmu_status fmu_reset(instance *fmu, const char *what)
{
    if (ts_reset(fmu->sim) != TS_OK) return fmu_error(fmu, what, ts_message(fmu->sim));
    to_instantiated(fmu);
    return FMU_OK;
}
