/* The force curves of a simulation's strings, from its parameters and programs; equal ones share their table. */
#include "laws/curves.h"
#include "laws/curve.h"
#include "laws/elements.h"
#include "laws/law.h"
#include "laws/memory/hysteresis.h"
#include "laws/series.h"

#include "model/data.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Does the string's present state depend on its past? */
int ts_has_memory(const ts_model *m, int i)
{
    return m->packed.beams[i] ? m->packed.beam_law[i] == 1 : ts_law_has_memory(m, m->packed.element[2 * i]);
}

void ts_curves_free(ts_sim *sim)
{
    for (int i = 0; i < sim->m.count[TS_S]; i++) {
        if (sim->laws.owner[i]) ts_curve_free(sim->laws.curve + i);
        sim->laws.owner[i] = 0;
    }
    sim->laws.ready = 0;
}

/* The parameters that the curves depend on: those of all beams, and the stiffness of strings with memory. */
static void curve_key(const ts_sim *sim, double *key)
{
    const ts_model *m = &sim->m;
    int beams = 3 * m->count[TS_Z];
    memcpy(key, sim->io.values + m->at[TS_NSH_Q], sizeof(double) * (size_t)beams);
    for (int i = 0; i < m->count[TS_S]; i++)
        key[beams + i] = ts_has_memory(m, i) ? sim->io.values[m->at[TS_STIFFNESS] + i] : 0.0;
}

static int same_curve(const ts_sim *sim, const double *key, int i, int j)
{
    const ts_model *m = &sim->m;
    int n = m->packed.beams[i], stiffness = 3 * m->count[TS_Z];
    if (m->packed.beams[j] != n || m->packed.beam_law[i] != m->packed.beam_law[j] || key[stiffness + i] != key[stiffness + j])
        return 0;
    if (m->packed.element[2 * i] != m->packed.element[2 * j]) return 0;
    for (int f = TS_NSH_Q; f <= TS_NSH_H; f++) {
        const double *p = sim->io.values + m->at[f];
        if (memcmp(p + m->string.beam_first[i], p + m->string.beam_first[j], sizeof(double) * (size_t)n)) return 0;
    }
    return 1;
}

/* Beams in series as parts of any law. */
static const char *series_of_beams(ts_curve *c, int n, const double *Q, const double *zeta, const double *h, int memory,
                                   double stiffness)
{
    ts_law *part = (ts_law *)calloc((size_t)n, sizeof *part), law;
    const char *reason = part ? NULL : "out of memory";
    memset(&law, 0, sizeof law);
    for (int j = 0; j < n && !reason; j++) {
        double energy = 0.0;
        ts_law_beam(part + j, Q[j], zeta[j], h[j]);
        reason = part[j].reason;
        for (int i = 0; i < part[j].n; i++) energy = ts_piece_integrate(&part[j].piece[i].p, part[j].table, energy);
    }
    if (!reason && memory) reason = ts_hysteresis(c, part, n, stiffness);
    if (!reason && !memory) reason = ts_series(&law, part, n);
    if (!reason && !memory) reason = ts_law_curve(c, &law);
    ts_law_free(&law);
    for (int j = 0; part && j < n; j++) ts_law_free(part + j);
    free(part);
    return reason;
}

static const char *element_curve(ts_curve *c, const ts_model *m, int i, double stiffness)
{
    int32_t first = m->packed.element[2 * i], second = m->packed.element[2 * i + 1];
    const char *reason;
    if (ts_law_has_memory(m, first)) {
        ts_law *part = NULL;
        int n = 0;
        reason = ts_law_parts(&part, &n, m, first, second);
        if (!reason) reason = ts_hysteresis(c, part, n, stiffness);
        for (int j = 0; part && j < n; j++) ts_law_free(part + j);
        free(part);
        return reason;
    }
    ts_law law;
    memset(&law, 0, sizeof law);
    ts_law_compile(&law, m, first, second);
    reason = law.reason ? law.reason : ts_law_curve(c, &law);
    ts_law_free(&law);
    return reason;
}

static const char *build(ts_sim *sim, int i)
{
    const ts_model *m = &sim->m;
    ts_curve *c = sim->laws.curve + i;
    double k = sim->io.values[m->at[TS_STIFFNESS] + i];
    const double *beams = sim->io.values + m->string.beam_first[i], *Q = beams + m->at[TS_NSH_Q],
                 *zeta = beams + m->at[TS_NSH_ZETA];
    const double *h = beams + m->at[TS_NSH_H];
    if (m->packed.beams[i]) return series_of_beams(c, m->packed.beams[i], Q, zeta, h, m->packed.beam_law[i], k);
    return m->packed.element[2 * i] >= 0 ? element_curve(c, m, i, k) : ts_curve_plain(c);
}

/* Force curves from the present parameters; a reason why there are none, or NULL. */
const char *ts_curves_build(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    size_t size = 3 * (size_t)m->count[TS_Z] + (size_t)m->count[TS_S];
    double *key = sim->laws.key + size;
    curve_key(sim, key);
    if (sim->laws.ready && !memcmp(sim->laws.key, key, sizeof(double) * size)) return NULL;
    ts_curves_free(sim);
    for (int i = 0; i < m->count[TS_S]; i++) {
        int j = 0;
        while (j < i && !same_curve(sim, key, i, j)) j++;
        if (j < i) {
            sim->laws.curve[i] = sim->laws.curve[j];
            continue;
        }
        sim->laws.owner[i] = 1;
        const char *reason = build(sim, i);
        if (reason) {
            ts_curves_free(sim);
            return reason;
        }
    }
    memcpy(sim->laws.key, key, sizeof(double) * size);
    sim->laws.ready = 1;
    return NULL;
}

/* --- dampers -------------------------------------------------------------------------------------------------------- */

void ts_dampers_free(ts_sim *sim)
{
    for (int i = 0; i < sim->m.count[TS_S]; i++)
        if (sim->laws.damping[i].piece) ts_curve_free(sim->laws.damping + i);
}

/* Damping laws from the programs; a reason why there are none, or NULL. */
const char *ts_dampers_build(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    for (int n = 0; n < m->string.damped_count; n++) {
        int i = m->string.with_damper[n];
        ts_law law;
        memset(&law, 0, sizeof law);
        ts_law_compile(&law, m, m->packed.damper[2 * i], m->packed.damper[2 * i + 1]);
        const char *reason = law.reason ? law.reason : ts_law_curve(sim->laws.damping + i, &law);
        ts_law_free(&law);
        if (reason) return reason;
        sim->laws.damping[i].reach = INFINITY;
    }
    return NULL;
}

/* Force of a string's damping law, odd in the rate (N), and its slope (N s/m); without one both are 0. */
double ts_damping_law(const ts_sim *sim, int i, double rate, double *slope)
{
    const ts_curve *c = sim->laws.damping + i;
    if (!c->piece) return *slope = 0.0;
    double x = fabs(rate);
    int piece = ts_curve_piece(c, x);
    double f = ts_curve_force(c, piece > 0 ? piece : 1, x, 0.0, slope);
    return rate < 0.0 ? -f : f;
}
