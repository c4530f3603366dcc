/* Parts in parallel: elongations are equal, forces add up; exactly where all parts are polynomials, else fitted. */
#include "laws/parallel.h"
#include "laws/curve.h"
#include "laws/fit.h"
#include "laws/polynomial.h"
#include "linear/pairs.h"

#include <math.h>
#include <stdlib.h>

#define SAMPLES 64 /* of the slope of a fitted sum, to find its extrema */

typedef struct {
    const ts_law *part;
    int32_t *at; /* (n) */
    int n;
} sum;

static double sum_of(const sum *s, double u, double *slope)
{
    double f = 0.0, d;
    *slope = 0.0;
    for (int j = 0; j < s->n; j++) {
        f += ts_law_force(s->part + j, s->at[j], u, &d);
        *slope += d;
    }
    return f;
}

static double sum_force(void *at, double u)
{
    double slope;
    return sum_of((const sum *)at, u, &slope);
}

/* Where the sum's slope changes its sign in (lo, hi), from lo, in order: between samples, by bisection. */
static int turns_of(const sum *s, double lo, double hi, double *turns)
{
    int n = 0;
    double width = hi - lo, before, slope, d;
    sum_of(s, lo + TS_SAME * width, &before);
    for (int i = 1; i <= SAMPLES; i++, before = slope) {
        double a = lo + width * fmax((i - 1.0) / SAMPLES, TS_SAME), b = lo + width * fmin((double)i / SAMPLES, 1.0 - TS_SAME);
        sum_of(s, b, &slope);
        if (!(before * slope < 0.0)) continue;
        for (double m = 0.5 * (a + b); m > a && m < b; m = 0.5 * (a + b)) {
            sum_of(s, m, &d);
            if (d * before > 0.0) a = m;
            else b = m;
        }
        turns[n++] = b - lo;
    }
    return ts_drop_ends(turns, n, width);
}

/* Append the sum on [lo, hi], which no polynomial gives: fitted, cut at its extrema. */
static void append_sum(ts_law *law, sum *s, double lo, double hi, int snapped, double size)
{
    double turns[SAMPLES + 1], from = lo, slope;
    int n = turns_of(s, lo, hi, turns);
    for (int i = 0; i <= n && !law->reason; i++) {
        double to = i < n ? lo + turns[i] : hi, start = law->n ? law->piece[law->n - 1].force[1] : 0.0,
               end = sum_of(s, to, &slope);
        ts_piece p = ts_piece_of(TS_GRADED, from, to, snapped);
        law->reason = ts_fit_piece(&p, &law->table, &law->rows, sum_force, s, TS_FIT_ERROR * size);
        ts_law_append(law, MAKE(ts_law_piece){p, {start, end}, ts_sign(end - start), 0});
        from = to;
    }
}

/* Append the sum from lo on, monotone and without end. */
static void append_open_sum(ts_law *law, sum *s, double lo, int snapped, double size)
{
    double slope, force = law->n ? law->piece[law->n - 1].force[1] : 0.0, beyond;
    sum_of(s, lo, &slope);
    ts_piece p = ts_piece_of(TS_OPEN, lo, INFINITY, snapped);
    sum_of(s, 2.0 * lo + 1e-3, &beyond);
    if (slope * beyond < 0.0) law->reason = "parts in parallel have an extremum where one of them is a series without end";
    else law->reason = ts_fit_open(&p, &law->table, &law->rows, sum_force, s, fmax(lo, 1e-3), size);
    ts_law_append(law, MAKE(ts_law_piece){p, {force, beyond * INFINITY}, ts_sign(beyond), 0});
}

/* Is the law one polynomial on each of the pieces? */
static int exact(const sum *s)
{
    for (int j = 0; j < s->n; j++)
        if (s->part[j].piece[s->at[j]].p.rows != 1 || s->part[j].piece[s->at[j]].p.kind != TS_ROWS) return 0;
    return 1;
}

static void append_exact_sum(ts_law *law, const sum *s, double lo, double hi, int snapped, int smooth)
{
    double total[TS_DEGREE + 1] = {0.0};
    for (int j = 0; j < s->n; j++) {
        const ts_piece *p = &s->part[j].piece[s->at[j]].p;
        double c[TS_DEGREE + 1], here[TS_DEGREE + 1], power = 1.0;
        for (int k = 0; k <= TS_DEGREE; k++, power *= p->scale) c[k] = s->part[j].table[TS_ROW * p->first + 1 + k] * power;
        ts_shift_polynomial(c, lo - p->lo, here);
        for (int k = 0; k <= TS_DEGREE; k++) total[k] += here[k];
    }
    ts_law_append_cut(law, lo, hi, total, law->n ? law->piece[law->n - 1].force[1] : 0.0, snapped, smooth);
}

/* Parts in parallel: on the united pieces, up to the first stop. */
void ts_parallel(ts_law *law, const ts_law *part, int n)
{
    int32_t *at = (int32_t *)calloc((size_t)n, sizeof *at);
    sum s = {part, at, n};
    double lo = 0.0, size = 0.0;
    int smooth = 0;
    for (int j = 0; j < n; j++) size = fmax(size, ts_law_largest(part + j));
    if (!at) law->reason = "out of memory";
    while (!law->reason) {
        double hi = INFINITY;
        int snapped = 0, joins = 1, over = 0;
        for (int j = 0; j < n; j++) {
            hi = fmin(hi, part[j].piece[at[j]].p.hi);
            snapped += part[j].piece[at[j]].p.snapped;
        }
        if (exact(&s)) append_exact_sum(law, &s, lo, hi, snapped, smooth);
        else if (hi < INFINITY) append_sum(law, &s, lo, hi, snapped, size);
        else append_open_sum(law, &s, lo, snapped, size);
        if (!(hi < INFINITY)) break;
        for (int j = 0; j < n; j++) {
            if (part[j].piece[at[j]].p.hi > hi) continue;
            if (++at[j] == part[j].n) over = 1;
            else joins = joins && part[j].piece[at[j]].smooth;
        }
        if (over) break;
        lo = hi;
        smooth = joins;
    }
    free(at);
}
