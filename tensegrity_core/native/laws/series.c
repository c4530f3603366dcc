/* Parts in series: forces are equal, elongations add up.
 *
 * A rise holds all parts on given stretches; its leader's own elongation parametrises it, smoothly even where the leader's
 * force has its maximum.  The single-valued law (Algorithm 1) strings rises together: between them the part whose maximum is
 * lowest follows its own curve until it bears that force again, the others held. */
#include "laws/series.h"
#include "laws/curve.h"
#include "laws/fit.h"
#include "linear/pairs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NARROW 1e-12 /* a rise shorter than this part of the elongation is none */
#define STILL 4e-16  /* a step of Newton's method shorter than this part of u is none */
#define MET 4e-15    /* elongations that are equal, as a part of them: a sum's round-off */

/* Elongation where the leader stands at u, the force there and the elongation's derivative by u. */
double ts_rise_elongation(ts_rise *r, double u, double *force, double *slope)
{
    double df, d, f = ts_law_force(r->part + r->leader, r->at[r->leader], u, &df);
    double x = u + r->compliance * f, by_force = r->compliance;
    r->u[r->leader] = u;
    for (int j = 0; j < r->n; j++) {
        if (j == r->leader) continue;
        if (r->at[j] >= r->part[j].n) {
            r->u[j] = ts_law_stop(r->part + j);
        } else {
            r->u[j] = ts_law_inverse(r->part + j, r->at[j], f, r->u[j]);
            ts_law_force(r->part + j, r->at[j], r->u[j], &d);
            by_force += 1.0 / d; /* infinite at an extremum of another part */
        }
        x += r->u[j];
    }
    *force = f;
    *slope = df == 0.0 ? 1.0 : 1.0 + df * by_force;
    return x;
}

/* Where to look next in the bracket a..b when the residual at u is `gap`, the one before it was `last`, and Newton's method
 * divides by `slope`; u: that was the last step.  Where other parts stand at maxima that tie with the leader's, the slope is
 * round-off, and may be huge: steps that do not halve the gap, and one of nothing where the gap is not nothing, say nothing. */
static double look_next(double u, double a, double b, double gap, double last, double slope, int met)
{
    double next = u - gap / slope, middle = 0.5 * (a + b);
    if (!(next > a && next < b) || fabs(gap) > 0.5 * fabs(last)) next = middle;
    if (fabs(next - u) > STILL * fabs(u)) return next;
    return met || !(b - a > 2.0 * STILL * fabs(u)) ? u : middle;
}

/* Force of the rise at an elongation: Newton inside a shrinking bracket. */
double ts_rise_force(void *rise, double x)
{
    ts_rise *r = (ts_rise *)rise;
    double a = r->lo, b = r->hi, f, slope, u = r->u[r->leader], last = INFINITY;
    if (!(b < INFINITY))
        for (b = fmax(2.0 * a, a + 1e-3); ts_rise_elongation(r, b, &f, &slope) < x;) b = a + 2.0 * (b - a);
    if (!(u > a && u < b)) u = 0.5 * (a + b);
    for (int n = 0; n < 200; n++) {
        double g = ts_rise_elongation(r, u, &f, &slope) - x;
        if (g == 0.0) return f;
        if (g > 0.0) b = u;
        else a = u;
        double next = look_next(u, a, b, g, last, slope, fabs(g) <= MET * fabs(x));
        if (next == u) break;
        u = next;
        last = g;
    }
    ts_rise_elongation(r, u, &f, &slope);
    return f;
}

/* Distance in elongation from the fold to where the leader stands at u, m.  Close to the fold it is the integral of dx/du
 * (Gauss points), because the difference of two elongations has no digits there. */
static double off_fold(ts_rise *r, double u, double *slope)
{
    static const double node[3] = {0.2386191860831969, 0.6612093864662645, 0.9324695142031521};
    static const double weight[3] = {0.4679139345726910, 0.3607615730481386, 0.1713244923791704};
    double fold = r->fold > 0 ? r->hi : r->lo, half = 0.5 * (fold - u), sum = 0.0, f, d;
    double x = ts_rise_elongation(r, u, &f, slope);
    if (fabs(fold - u) > 0.05 * (r->hi - r->lo)) return fabs(ts_rise_elongation(r, fold, &f, &d) - x);
    for (int k = 0; k < 3; k++)
        for (int side = -1; side <= 1; side += 2) {
            ts_rise_elongation(r, u + half * (1.0 + side * node[k]), &f, &d);
            sum += 0.5 * weight[k] * d;
        }
    return fabs(sum * (fold - u));
}

/* Force of the rise at the distance s^2 from its fold: of s = sqrt(distance) the leader's elongation is a smooth function. */
double ts_rise_off_fold(void *rise, double s)
{
    ts_rise *r = (ts_rise *)rise;
    double fold = r->fold > 0 ? r->hi : r->lo, a = r->lo, b = r->hi, u = r->u[r->leader], f, slope;
    double last = INFINITY;
    if (!(u > a && u < b)) u = 0.5 * (a + b);
    for (int n = 0; n < 200 && s > 0.0; n++) {
        double root = sqrt(off_fold(r, u, &slope)), g = r->fold * (s - root);
        if (g == 0.0) break;
        if (g > 0.0) b = u;
        else a = u;
        double next = look_next(u, a, b, g * 2.0 * root, last, slope, fabs(g) <= MET * s);
        if (next == u) break;
        u = next;
        last = g * 2.0 * root;
    }
    ts_rise_elongation(r, s > 0.0 ? u : fold, &f, &slope);
    return f;
}

/* What Algorithm 1 keeps while it goes up the curve. */
typedef struct {
    ts_law *law;
    const ts_law *part;
    int32_t *at; /* (n) stretch of each part; its number of stretches: at its stop */
    double *u;   /* (n) */
    double x, force, size;
    int n;
} climb;

static int snapped_beams(const climb *c)
{
    int count = 0;
    for (int j = 0; j < c->n; j++) count += ts_law_snapped(c->part + j, c->at[j]);
    return count;
}

static void append(ts_law *law, ts_piece p, double f0, double f1, int way, int smooth)
{
    ts_stretch *s = (ts_stretch *)realloc(law->s, sizeof *s * ((size_t)law->n + 1));
    if (!s) {
        law->reason = "out of memory";
        return;
    }
    law->s = s;
    s[law->n++] = MAKE(ts_stretch){p, {f0, f1}, way, smooth};
}

/* Compliance of a rise (m/N) where all its parts are straight, else 0. */
double ts_rise_straight(const ts_rise *r)
{
    double sum = r->compliance;
    for (int j = 0; j < r->n; j++) {
        if (r->at[j] >= r->part[j].n) continue;
        const ts_piece *p = &r->part[j].s[r->at[j]].p;
        const double *row = r->part[j].table + TS_ROW * p->first;
        if (p->kind != TS_ROWS || p->rows != 1) return 0.0;
        for (int k = 2; k <= TS_DEGREE; k++)
            if (row[1 + k] != 0.0) return 0.0;
        sum += 1.0 / (row[2] * p->scale);
    }
    return sum;
}

/* Append a rise to a force at its end, its rows as its parts have it. */
static void append_rise(climb *c, ts_rise *r, double end, double top)
{
    ts_law *law = c->law;
    ts_piece p = ts_piece_of(TS_GRADED, c->x, end, snapped_beams(c));
    double compliance = ts_rise_straight(r), w = fmax(c->x, 1e-3);
    const char *reason;
    if (compliance > 0.0) reason = ts_fit_line(&p, &law->table, &law->rows, c->force, 1.0 / compliance);
    else if (end < INFINITY) reason = ts_fit_piece(&p, &law->table, &law->rows, ts_rise_force, r, TS_FIT_ERROR * c->size);
    else reason = ts_fit_open(&p, &law->table, &law->rows, ts_rise_force, r, w, c->size);
    if (reason) law->reason = reason;
    else append(law, p, c->force, top, 1, 0);
}

/* Elongation where part j, rising, stands under the force `top` at the end of a rise: at its own end where that ties. */
static double stands(const climb *c, int j, double top)
{
    const ts_law *part = c->part + j;
    if (c->at[j] >= part->n) return ts_law_stop(part);
    const ts_stretch *s = part->s + c->at[j];
    return s->force[1] <= top * (1.0 + TS_TIE) ? s->p.hi : ts_law_inverse(part, c->at[j], top, c->u[j]);
}

/* All parts on their rising stretches up to `top`, the leader's force at its end. */
static void rise_to(climb *c, int leader, double top)
{
    const ts_law *lead = c->part + leader;
    double end = top < INFINITY ? 0.0 : INFINITY;
    ts_rise r = {c->part, c->at, c->u, ts_law_inverse(lead, c->at[leader], c->force, 0.0), 0.0, 0.0, 0, c->n, leader};
    r.hi = ts_law_inverse(lead, c->at[leader], top, 0.0);
    for (int j = 0; j < c->n && top < INFINITY; j++) end += stands(c, j, top);
    int wide = end > c->x * (1.0 + NARROW);
    if (wide) append_rise(c, &r, end, top);
    if (!(top < INFINITY)) return;
    if (wide) c->x = end;
    for (int j = 0; j < c->n; j++) c->u[j] = stands(c, j, top);
    c->force = top;
}

/* Part j follows its own curve from a maximum until it bears that force again. */
static void snap(climb *c, int j)
{
    const ts_law *part = c->part + j;
    double start = part->s[c->at[j]].p.hi;
    for (int i = c->at[j] + 1;; i++) {
        if (i == part->n) {
            c->law->reason = "a part of a series never bears again the force of its maximum";
            return;
        }
        const ts_stretch *s = part->s + i;
        int done = s->way > 0 && s->force[1] >= c->force * (1.0 - TS_TIE);
        ts_piece p = s->p;
        int at_end = !done || s->force[1] <= c->force * (1.0 + TS_TIE); /* of a next maximum that ties */
        double end = at_end ? p.hi : ts_law_inverse(part, i, c->force, 0.0);
        if (s->force[0] < 0.0 || s->force[1] < 0.0) {
            c->law->reason = "a part of a single-valued series pushes after its maximum; its law must be hysteretic";
            return;
        }
        if (!done && !(end < INFINITY)) continue; /* there is no more: the loop says so */
        double *table = (double *)realloc(c->law->table, sizeof *table * TS_ROW * ((size_t)c->law->rows + (size_t)p.rows));
        if (!table) {
            c->law->reason = "out of memory";
            return;
        }
        memcpy(table + TS_ROW * c->law->rows, part->table + TS_ROW * p.first, sizeof *table * TS_ROW * (size_t)p.rows);
        c->law->table = table;
        p.first = c->law->rows;
        c->law->rows += p.rows;
        c->at[j] = i;
        p.snapped = snapped_beams(c);
        p.lo = c->x;
        p.hi = c->x += end - s->p.lo;
        p.origin = p.lo + (s->p.origin - s->p.lo);
        int smooth = s->smooth && s->p.lo > start;
        if (p.hi > p.lo) append(c->law, p, s->force[0], done ? c->force : s->force[1], s->way, smooth);
        c->u[j] = end;
        if (done) return;
    }
}

/* The part that reaches the end of its stretch first; -1: all are at their stops. */
static int first_to_end(const climb *c)
{
    int first = -1;
    for (int j = 0; j < c->n; j++) {
        if (c->at[j] >= c->part[j].n) continue;
        if (first < 0 || c->part[j].s[c->at[j]].force[1] < c->part[first].s[c->at[first]].force[1]) first = j;
    }
    return first;
}

/* Does a part that stands at the end of its stretch go on rising, or stop there? */
static int goes_on(const climb *c, int j)
{
    const ts_law *part = c->part + j;
    int next = c->at[j] + 1;
    return next == part->n || part->s[next].way > 0;
}

/* Single-valued series of parts; a reason why there is none, or NULL. */
const char *ts_series(ts_law *law, const ts_law *part, int n)
{
    climb c = {law, part, (int32_t *)calloc((size_t)n, sizeof(int32_t)), (double *)calloc((size_t)n, sizeof(double)), 0.0, 0.0,
               0.0, n};
    if (!c.at || !c.u) law->reason = "out of memory";
    for (int j = 0; j < n && !law->reason; j++) {
        c.size = fmax(c.size, ts_law_largest(part + j));
        if (part[j].s[0].way <= 0) law->reason = "the force of a part of a series does not rise from 0";
    }
    while (!law->reason) {
        int leader = first_to_end(&c), next = -1;
        if (leader < 0) break;
        double top = part[leader].s[c.at[leader]].force[1];
        if (top > c.force * (1.0 + TS_TIE) || c.x == 0.0) rise_to(&c, leader, top);
        if (law->reason || !(top < INFINITY)) break;
        for (int j = 0; j < n; j++) {
            if (c.at[j] >= part[j].n || part[j].s[c.at[j]].force[1] > c.force * (1.0 + TS_TIE)) continue;
            if (goes_on(&c, j)) c.at[j]++;
            else if (next < 0) next = j;
        }
        if (next >= 0) snap(&c, next);
    }
    free(c.at);
    free(c.u);
    return law->reason;
}
