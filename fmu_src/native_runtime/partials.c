/* Partial derivatives: of outputs and of states' derivatives, by states, inputs and parameters.
 *
 * In model exchange they are those of the present time, states and inputs, in Initialization Mode those of the start by start
 * values.  In co-simulation outputs hold from one communication point to the next, whatever is set there: they depend on nothing but
 * in Initialization Mode. */
#include "calls.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define STATES_IN_BLOCK 2 /* states that are outputs: the integrals of the energy ledger */

int fmu_prepare_partials(instance *fmu)
{
    const size_t work = ts_derivatives_size(fmu->sim), doubles = (work + sizeof(double) - 1) / sizeof(double);
    const size_t knowns = (size_t)ts_known_count(fmu->sim), unknowns = (size_t)ts_unknown_count(fmu->sim);
    fmu->known = (double *)malloc(sizeof(double) * (knowns + unknowns + doubles));
    if (!fmu->known) return 0;
    fmu->unknown = fmu->known + knowns;
    fmu->differentiated = fmu->unknown + unknowns;
    return ts_share_derivatives(fmu->sim, fmu->differentiated, sizeof(double) * doubles) == TS_OK;
}

/* Which state a reference means: those of the block come last.  -1: none. */
static int32_t state_of(const instance *fmu, uint32_t vr, int32_t shift)
{
    const int32_t named = fmu->state_count - STATES_IN_BLOCK, at = (int32_t)vr - fmu->counted - shift;
    return at >= 0 && at < named + (shift ? STATES_IN_BLOCK : 0) ? at : -1;
}

/* An integral of the ledger as a state: dissipated, then input work, before the last of the reals.  -1: none. */
static int32_t integral_of(const instance *fmu, uint32_t vr)
{
    const int32_t at = (int32_t)vr - (fmu->table.reals - STATES_IN_BLOCK - 1);
    return fmu->state_count && at >= 0 && at < STATES_IN_BLOCK ? fmu->state_count - STATES_IN_BLOCK + at : -1;
}

static fmu_status not_known(const instance *fmu, const char *what, uint32_t vr, const char *why)
{
    char text[256];
    snprintf(text, sizeof text, "nothing can be differentiated by %.100s: %s", fmu_name(fmu, vr), why);
    return fmu_refuse(fmu, what, text);
}

/* Place among the kernel's knowns; or -1 by what nothing changes, or -2: refused. */
static int32_t known_at(const instance *fmu, const char *what, uint32_t vr)
{
    const int start = fmu->mode == MODE_INITIALIZATION, steps = fmu->kind == FMU_CO_SIMULATION && !start;
    const int32_t states = ts_continuous_count(fmu->sim), state = state_of(fmu, vr, 0), integral = integral_of(fmu, vr);
    if (vr == (uint32_t)fmu->table.count) return -1; /* the equations are the same at any time */
    if (vr < (uint32_t)fmu->first_output) {
        const int settable = fmu->table.settable[vr] & (start ? MODE_INITIALIZATION : MODE_STEPPING);
        if (!settable) not_known(fmu, what, vr, "it is fixed after initialization");
        else if (!ts_differentiable(fmu->sim, states + (int32_t)vr))
            not_known(fmu, what, vr, "derivatives by it are not provided");
        else return steps ? -1 : states + (int32_t)vr;
        return -2;
    }
    if (state < 0 && integral < 0) not_known(fmu, what, vr, "it is computed, and no state");
    else if (start) not_known(fmu, what, vr, "it follows from start values in Initialization Mode");
    else if (steps) not_known(fmu, what, vr, "states are the FMU's own in co-simulation");
    else return state >= 0 ? state : integral;
    return -2;
}

/* Place among the kernel's unknowns; or -1: it is a whole number, which importers that take every output for a real one ask for, and
 * stays; or -2: refused. */
static int32_t unknown_at(const instance *fmu, const char *what, uint32_t vr)
{
    const int32_t states = ts_continuous_count(fmu->sim), state = state_of(fmu, vr, 0);
    const int32_t rate = state_of(fmu, vr, fmu->state_count - STATES_IN_BLOCK);
    char text[256];
    if (vr >= (uint32_t)fmu->table.reals && vr < (uint32_t)fmu->counted && !fmu->table.settable[vr]) return -1;
    if (vr >= (uint32_t)fmu->first_output && vr < (uint32_t)fmu->table.reals) {
        const int32_t output = 2 * states + (int32_t)vr - fmu->first_output;
        if (ts_differentiated(fmu->sim, output)) return output;
        snprintf(text, sizeof text, "%.100s is not differentiated", fmu->table.name[vr]);
        fmu_refuse(fmu, what, text);
        return -2;
    }
    if (state >= 0) return state;
    if (rate >= 0) return states + rate;
    if (vr > (uint32_t)fmu->table.count) snprintf(text, sizeof text, "event indicators are not differentiated");
    else if (vr == (uint32_t)fmu->table.count) snprintf(text, sizeof text, "time is not computed");
    else snprintf(text, sizeof text, "%.100s is not computed", fmu->table.name[vr]);
    fmu_refuse(fmu, what, text);
    return -2;
}

typedef int32_t (*finder)(const instance *fmu, const char *what, uint32_t vr);

/* Are all of them among what `find` knows? */
static fmu_status check(const instance *fmu, const char *what, const uint32_t vr[], size_t n, finder find)
{
    for (size_t i = 0; i < n; i++)
        for (uint32_t k = 0, span = (uint32_t)fmu_span(fmu, vr[i]); k < span; k++)
            if (find(fmu, what, vr[i] + k) == -2) return FMU_DISCARD;
    return FMU_OK;
}

/* Differentiate once for all products at an instant. */
static fmu_status look(instance *fmu, const char *what)
{
    const int start = fmu->mode == MODE_INITIALIZATION;
    if (start && !fmu_refresh(fmu, what)) return FMU_DISCARD;
    if (fmu->viewed & VIEW_PARTIALS) return FMU_OK;
    if (ts_differentiate(fmu->sim, start, fmu->differentiated) != TS_OK) return fmu_refuse(fmu, what, ts_message(fmu->sim));
    fmu->viewed |= VIEW_PARTIALS;
    return FMU_OK;
}

/* One product: seeds of some numbers in, sensitivities of others out. */
static fmu_status multiply(instance *fmu, const fmu_product *p, int adjoint)
{
    const uint32_t *from = adjoint ? p->unknown : p->known, *to = adjoint ? p->known : p->unknown;
    const size_t n_from = adjoint ? p->unknowns : p->knowns, n_to = adjoint ? p->knowns : p->unknowns;
    const finder find_from = adjoint ? unknown_at : known_at, find_to = adjoint ? known_at : unknown_at;
    const int32_t count = adjoint ? ts_unknown_count(fmu->sim) : ts_known_count(fmu->sim);
    double *in = adjoint ? fmu->unknown : fmu->known, *out = adjoint ? fmu->known : fmu->unknown;
    const double *seed = p->seed;
    double *sensitivity = p->sensitivity;
    memset(in, 0, sizeof *in * (size_t)count);
    for (size_t i = 0; i < n_from; i++)
        for (uint32_t k = 0, span = (uint32_t)fmu_span(fmu, from[i]); k < span; k++, seed++) {
            const int32_t at = find_from(fmu, p->what, from[i] + k);
            if (at >= 0) in[at] += *seed;
        }
    const int status =
        adjoint ? ts_adjoint(fmu->sim, fmu->differentiated, in, out) : ts_directional(fmu->sim, fmu->differentiated, in, out);
    if (status != TS_OK) return fmu_refuse(fmu, p->what, ts_message(fmu->sim));
    for (size_t i = 0; i < n_to; i++)
        for (uint32_t k = 0, span = (uint32_t)fmu_span(fmu, to[i]); k < span; k++) {
            const int32_t at = find_to(fmu, p->what, to[i] + k);
            *sensitivity++ = at >= 0 ? out[at] : 0.0;
        }
    return FMU_OK;
}

fmu_status fmu_get_partials(instance *fmu, const fmu_product *p, int adjoint)
{
    const variable_table *t = &fmu->table;
    const int more = fmu->standard->number > 2 ? 1 : 0; /* time is a variable, behind it event indicators */
    const fmu_range knowns = {fmu->standard->real, 0, t->count + more, t->reals, fmu->counted};
    const fmu_range unknowns = {fmu->standard->real, 0, t->count + more * (1 + fmu->indicator_count), 0, 0};
    const size_t n_known = adjoint ? p->n_sensitivity : p->n_seed, n_unknown = adjoint ? p->n_seed : p->n_sensitivity;
    const void *of_known = adjoint ? (const void *)p->sensitivity : p->seed;
    const void *of_unknown = adjoint ? (const void *)p->seed : p->sensitivity;
    fmu_status status = fmu_look_up(fmu, p->what, p->known, p->knowns, of_known, n_known, knowns);
    if (status == FMU_OK) status = fmu_look_up(fmu, p->what, p->unknown, p->unknowns, of_unknown, n_unknown, unknowns);
    if (status == FMU_OK) status = check(fmu, p->what, p->known, p->knowns, known_at);
    if (status == FMU_OK) status = check(fmu, p->what, p->unknown, p->unknowns, unknown_at);
    if (status != FMU_OK) return status;
    if (fmu->kind == FMU_CO_SIMULATION && fmu->mode != MODE_INITIALIZATION) {
        if (p->n_sensitivity) memset(p->sensitivity, 0, sizeof(double) * p->n_sensitivity);
        return FMU_OK;
    }
    status = look(fmu, p->what);
    return status == FMU_OK ? multiply(fmu, p, adjoint) : status;
}
