/* The stepping loop: step size control, transitions, choice of method. */
#include "internal.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define SAFETY 0.9
#define SHRINK 0.2     /* smallest factor of the step after a rejection */
#define CALM_SIGNS 3   /* steps after which it returns */
#define MAX_PATIENCE 1000

static const ts_method *const methods[] = {NULL, &ts_dop853, &ts_rodas5p}; /* by TS_METHOD_*; auto picks among them */

static int fail(ts_sim *sim, int status)
{
    static const char *const texts[] = {
#define TS_ERROR(name, text) text,
#include "errors.def"
#undef TS_ERROR
    };
    strncpy(sim->message, texts[status], sizeof sim->message - 1);
    return status;
}

/* A first step from the size of the derivative and of its change (Hairer, Norsett, Wanner, section II.4). */
static double first_step(ts_sim *sim, const ts_method *method, double tau, double most)
{
    int ny = sim->m.ny;
    double tolerance = sim->values[sim->m.at[TS_TOLERANCE]];
    double d1 = ts_error_norm(sim, sim->f0, sim->y, sim->y) * tolerance; /* per second, relative to 1 + |y| */
    double h0 = d1 > 1e-5 ? fmin(0.01 / d1, most) : fmin(1e-6, most);
    for (int i = 0; i < ny; i++) sim->ytmp[i] = sim->y[i] + h0 * sim->f0[i];
    memcpy(sim->y1, sim->ytmp, sizeof(double) * (size_t)ny);
    ts_rhs(sim, tau + h0, sim->y1, sim->f1);
    for (int i = 0; i < ny; i++) sim->err[i] = sim->f1[i] - sim->f0[i];
    double d2 = ts_error_norm(sim, sim->err, sim->y, sim->y) * tolerance / h0, d = fmax(d1, d2);
    double h1 = d <= 1e-15 ? fmax(1e-6, 1e-3 * h0) : pow(tolerance / d, method->exponent);
    double h = fmin(100.0 * h0, h1);
    return h > 0.0 ? fmin(h, most) : most; /* NaN: the error test will see it */
}

/* Bound of the fastest rate of the linearised system from the Jacobian at hand (1/s). */
static double fastest_rate(const ts_sim *sim)
{
    int nq = sim->m.nq;
    double velocity = 0.0, position = 0.0;
    for (int i = 0; i < nq; i++) {
        double v = 0.0, q = 0.0;
        for (int j = 0; j < nq; j++) {
            v += fabs(sim->Jv[i * nq + j]);
            q += fabs(sim->Jq[i * nq + j]);
        }
        velocity = fmax(velocity, v);
        position = fmax(position, q);
    }
    return fmax(velocity, sqrt(position));
}

/* `auto`: leave the explicit method when stability limits its step, return when the L-stable one takes no larger steps. */
static void choose_method(ts_sim *sim, double h)
{
    ts_memory *memory = &sim->memory;
    if (sim->integers[sim->m.int_at[TS_INT_METHOD]] != TS_METHOD_AUTO) return;
    if (memory->active == TS_METHOD_DOP853) {
        if (memory->stiff < memory->patience) return;
        memory->active = TS_METHOD_RODAS5P;
        memory->stiff = 0;
    } else {
        memory->stiff = h * fastest_rate(sim) < 8.0 ? memory->stiff + 1 : 0;
        if (memory->stiff < CALM_SIGNS) return;
        memory->active = TS_METHOD_DOP853;
        memory->stiff = 0;
        memory->patience = memory->patience * 2 > MAX_PATIENCE ? MAX_PATIENCE : memory->patience * 2;
    }
}

/* Integrals of the ledger over the accepted part of a step whose stages did not carry them: Gauss points of dense output. */
static void integrate_ledger(ts_sim *sim, const ts_method *method, double tau, double h, double theta, double *ledger)
{
    static const double node[3] = {0.1127016653792583, 0.5, 0.8872983346207417};
    static const double weight[3] = {5.0 / 18.0, 8.0 / 18.0, 5.0 / 18.0};
    int n = 2 * sim->m.nq;
    if (!sim->dense_ready) method->densify(sim, tau, h);
    sim->dense_ready = 1;
    for (int k = 0; k < TS_LEDGER; k++) ledger[k] = sim->y[n + k];
    for (int g = 0; g < 3; g++) {
        double p[TS_LEDGER], at = theta * node[g];
        method->interpolate(sim, at, 0, n, sim->err);
        ts_power(sim, tau + at * h, sim->err, p);
        for (int k = 0; k < TS_LEDGER; k++) ledger[k] += weight[g] * theta * h * p[k];
    }
}

static void remember_gaps(ts_sim *sim)
{
    size_t bytes = sizeof(double) * (size_t)sim->m.count[TS_S];
    memcpy(sim->gap0, sim->gap, bytes);
    memcpy(sim->rate0, sim->gap_rate, bytes);
}

/* Derivative at (tau, y) under the present pieces. */
static void restart(ts_sim *sim, double tau)
{
    ts_rhs(sim, tau, sim->y, sim->f0);
    remember_gaps(sim);
    sim->jacobian_ready = 0;
}

/* Move the state to theta of the accepted step; returns the time passed.  A clipped string bears no tension: its damper
 * takes all that its spring gives, so the energy lost is a difference and needs no quadrature. */
static double move(ts_sim *sim, const ts_method *method, double tau, double h, double theta)
{
    int ny = sim->m.ny, n = 2 * sim->m.nq;
    double ledger[TS_LEDGER], clipped = ts_clipped_energy(sim, tau);
    if (!method->ledger_in_stages) integrate_ledger(sim, method, tau, h, theta, ledger);
    if (theta < 1.0) {
        method->interpolate(sim, theta, 0, method->ledger_in_stages ? ny : n, sim->ytmp);
        ts_project(sim, sim->ytmp);
        memcpy(sim->y, sim->ytmp, sizeof(double) * (size_t)ny);
    } else {
        memcpy(sim->y, sim->y1, sizeof(double) * (size_t)ny);
    }
    if (!method->ledger_in_stages) memcpy(sim->y + n, ledger, sizeof ledger);
    clipped -= ts_clipped_energy(sim, tau + theta * h);
    sim->y[n] += clipped;
    sim->y[n + 2] += fabs(clipped);
    sim->jacobian_ready = 0;
    return theta * h;
}

/* After an accepted step: find its first transition, move there or to its end.  Returns the time passed. */
static double finish_step(ts_sim *sim, const ts_method *method, double tau, double h, int *which)
{
    size_t bytes = sizeof(double) * (size_t)sim->m.count[TS_S];
    ts_project(sim, sim->y1);
    method->accept(sim, tau, h);
    memcpy(sim->gap1, sim->gap, bytes);
    memcpy(sim->rate1, sim->gap_rate, bytes);
    sim->dense_ready = 0;
    *which = -1;
    double theta = ts_first_transition(sim, method, tau, h, which);
    if (theta >= 0.0) return move(sim, method, tau, h, theta);
    move(sim, method, tau, h, 1.0);
    memcpy(sim->f0, sim->f1, sizeof(double) * (size_t)sim->m.ny);
    memcpy(sim->gap0, sim->gap1, bytes);
    memcpy(sim->rate0, sim->rate1, bytes);
    return h;
}

/* Advance from tau = 0 to `end` under fixed inputs.  The pieces are placed, Qf, Qg and inv prepared. */
int ts_integrate(ts_sim *sim, double end)
{
    ts_memory *memory = &sim->memory;
    double tau = 0.0, longest = sim->values[sim->m.at[TS_MAX_STEP]];
    int stuck = 0, fresh = memory->h_next <= 0.0, rejected = 0;
    if (!(longest > 0.0)) longest = INFINITY;
    restart(sim, 0.0);
    for (int i = 0; i < 2 * sim->m.nq; i++)
        if (!isfinite(sim->f0[i])) return fail(sim, TS_NOT_FINITE);
    for (int n = 0; tau < end; n++) {
        if (n >= TS_MAX_STEPS) return fail(sim, TS_WORK_LIMIT);
        const ts_method *method = methods[memory->active];
        double left = end - tau, h, most = fmin(left, longest);
        if (fresh) memory->h_next = first_step(sim, method, tau, memory->h_last > 0.0 ? fmin(most, 4.0 * memory->h_last) : most);
        fresh = 0;
        h = fmin(memory->h_next, longest);
        int last = h >= left * (1.0 - 1e-12);
        if (last) h = left;
        else if (h > 0.5 * left) h = 0.5 * left; /* two even steps rather than a long and a short one */
        if (!(h > 4.0 * DBL_EPSILON * (tau + h)) || !(h > DBL_MIN)) return fail(sim, TS_STEP_TOO_SMALL);
        memset(sim->outside, 0, sizeof(int32_t) * (size_t)sim->m.count[TS_S]);
        double err = method->attempt(sim, tau, h);
        if (!(err <= 1.0)) {
            memory->stats[TS_REJECTED]++;
            memory->h_next = h * (err > 1.0 && err < INFINITY ? fmax(SHRINK, SAFETY * pow(err, -method->exponent)) : 0.1);
            rejected = 1;
            continue;
        }
        double grow = err > 0.0 ? fmin(method->growth, SAFETY * pow(err, -method->exponent)) : method->growth;
        if (rejected && grow > 1.0) grow = 1.0;
        rejected = 0;
        int which;
        double passed = finish_step(sim, method, tau, h, &which);
        memory->stats[TS_STEPS]++;
        memory->stats[TS_IMPLICIT_STEPS] += method->implicit;
        if (which < 0) {
            tau = last ? end : tau + passed;
            if (!last || h * grow > memory->h_next) memory->h_next = h * grow; /* a clipped step says nothing of a longer one */
            choose_method(sim, h);
            stuck = 0;
            continue;
        }
        stuck = tau + passed > tau ? 0 : stuck + 1;
        tau += passed;
        if (end - tau <= 8.0 * DBL_EPSILON * end) tau = end; /* no step fits between the transition and the end */
        if (stuck > 4 * sim->m.count[TS_S] + 16) return fail(sim, TS_CHATTERING);
        memory->stats[TS_RESTARTS]++;
        memory->h_last = h;
        ts_switch(sim, tau, which);
        restart(sim, tau);
        fresh = 1;
    }
    return TS_OK;
}
