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

void ts_curves_free(ts_laws *laws, int strings)
{
    for (int i = 0; i < strings; i++) {
        if (laws->owner[i]) ts_curve_free(laws->curve + i);
        laws->owner[i] = 0;
    }
    laws->ready = 0;
}

/* The parameters that the curves depend on: those of all beams, and the stiffness of strings with memory. */
static void curve_key(const ts_model *m, const double *values, double *key)
{
    int beams = 3 * m->count[TS_Z];
    memcpy(key, values + m->at[TS_NSH_Q], sizeof(double) * (size_t)beams);
    for (int i = 0; i < m->count[TS_S]; i++) key[beams + i] = ts_has_memory(m, i) ? values[m->at[TS_STIFFNESS] + i] : 0.0;
}

static int same_curve(const ts_model *m, const double *key, int i, int j)
{
    const ts_packed *p = &m->packed;
    const double *stiffness = key + 3 * m->count[TS_Z], *one = key + m->string.beam_first[i],
                 *other = key + m->string.beam_first[j];
    if (p->beams[j] != p->beams[i] || p->beam_law[i] != p->beam_law[j] || stiffness[i] != stiffness[j]) return 0;
    if (p->element[2 * i] != p->element[2 * j] || m->string.two_way[i] != m->string.two_way[j]) return 0;
    for (int f = 0; f < 3; f++) /* Q, zeta, h */
        if (memcmp(one + f * m->count[TS_Z], other + f * m->count[TS_Z], sizeof(double) * (size_t)p->beams[i])) return 0;
    return 1;
}

/* The curve of parts in series, which are freed; a reason why there is none, or NULL. */
static const char *curve_of_parts(ts_curve *c, ts_law *part, int n, int memory, double stiffness)
{
    ts_law law;
    const char *reason;
    memset(&law, 0, sizeof law);
    if (memory) reason = ts_hysteresis(c, part, n, stiffness);
    else reason = ts_series(&law, part, n);
    if (!reason && !memory) reason = ts_law_curve(c, &law);
    ts_law_free(&law);
    ts_laws_free(part, n);
    return reason;
}

/* Beams in series as parts of any law. */
static const char *curve_of_beams(ts_curve *c, const ts_model *m, const double *values, int i)
{
    int n = m->packed.beams[i];
    const double *at = values + m->string.beam_first[i];
    const double *Q = at + m->at[TS_NSH_Q], *zeta = at + m->at[TS_NSH_ZETA], *h = at + m->at[TS_NSH_H];
    ts_law *part = (ts_law *)calloc((size_t)n, sizeof *part);
    if (!part) return "out of memory";
    for (int j = 0; j < n; j++) {
        double energy = 0.0;
        ts_law_beam(part + j, Q[j], zeta[j], h[j]);
        if (part[j].reason) {
            const char *reason = part[j].reason;
            ts_laws_free(part, n);
            return reason;
        }
        for (int k = 0; k < part[j].n; k++) energy = ts_piece_integrate(&part[j].piece[k].p, part[j].table, energy);
    }
    return curve_of_parts(c, part, n, m->packed.beam_law[i], values[m->at[TS_STIFFNESS] + i]);
}

/* The curve of a law in the programs; a reason why there is none, or NULL. */
static const char *curve_of_program(ts_curve *c, const ts_model *m, const int32_t place[2])
{
    ts_law law;
    memset(&law, 0, sizeof law);
    ts_law_compile(&law, m, place[0], place[1]);
    const char *reason = law.reason ? law.reason : ts_law_curve(c, &law);
    ts_law_free(&law);
    return reason;
}

static const char *build(ts_curve *c, const ts_model *m, const double *values, int i)
{
    const int32_t *place = m->packed.element + 2 * i;
    if (m->packed.beams[i]) return curve_of_beams(c, m, values, i);
    if (place[0] < 0) return m->string.two_way[i] ? ts_curve_two_way(c) : ts_curve_plain(c);
    if (!ts_law_has_memory(m, place[0])) return curve_of_program(c, m, place);
    ts_law *part = NULL;
    int n = 0;
    const char *reason = ts_law_parts(&part, &n, m, place[0], place[1]);
    return reason ? reason : curve_of_parts(c, part, n, 1, values[m->at[TS_STIFFNESS] + i]);
}

/* Force curves from the present parameters (n_applied); a reason why there are none, or NULL. */
const char *ts_curves_build(ts_laws *laws, const ts_model *m, const double *values)
{
    const int S = m->count[TS_S];
    size_t size = 3 * (size_t)m->count[TS_Z] + (size_t)S;
    double *key = laws->key + size;
    curve_key(m, values, key);
    if (laws->ready && !memcmp(laws->key, key, sizeof(double) * size)) return NULL;
    ts_curves_free(laws, S);
    for (int i = 0; i < S; i++) {
        int j = 0;
        while (j < i && !same_curve(m, key, i, j)) j++;
        if (j < i) {
            laws->curve[i] = laws->curve[j];
            continue;
        }
        laws->owner[i] = 1;
        const char *reason = build(laws->curve + i, m, values, i);
        if (reason) {
            ts_curves_free(laws, S);
            return reason;
        }
    }
    memcpy(laws->key, key, sizeof(double) * size);
    laws->ready = 1;
    return NULL;
}

/* --- dampers -------------------------------------------------------------------------------------------------------- */

void ts_dampers_free(ts_laws *laws, int strings)
{
    for (int i = 0; i < strings; i++)
        if (laws->damping[i].piece) ts_curve_free(laws->damping + i);
}

/* Damping laws from the programs; a reason why there are none, or NULL. */
const char *ts_dampers_build(ts_laws *laws, const ts_model *m)
{
    for (int n = 0; n < m->string.damped_count; n++) {
        int i = m->string.with_damper[n];
        const char *reason = curve_of_program(laws->damping + i, m, m->packed.damper + 2 * i);
        if (reason) return reason;
        laws->damping[i].reach = INFINITY;
    }
    return NULL;
}

/* Force of a string's damping law, odd in the rate (N), and its slope (N s/m); without one both are 0. */
double ts_damping_law(const ts_laws *laws, int i, double rate, double *slope)
{
    const ts_curve *c = laws->damping + i;
    if (!c->piece) return *slope = 0.0;
    double x = fabs(rate);
    int piece = ts_curve_piece(c, x);
    double f = ts_curve_force(c, piece > 0 ? piece : 1, x, 0.0, slope);
    return rate < 0.0 ? -f : f;
}
