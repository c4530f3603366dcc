/* The single-valued law of parts in series (Algorithm 1): between rises (rise.c) the part whose maximum is lowest follows its own
 * curve until it bears that force again, the others held. */
#include "laws/series.h"
#include "invariants.h"
#include "laws/curve.h"
#include "laws/fit.h"
#include "laws/rise.h"
#include "linear/pairs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define NARROW 1e-12 /* a rise shorter than this part of the elongation is none */
/* What Algorithm 1 keeps while it goes up the curve. */
typedef struct {
    ts_law *law;
    const ts_law *part;
    int32_t *at;     /* (n) piece of each part; its number of pieces: at its stop */
    double *u;       /* (n) */
    ts_mover *mover; /* (n) */
    double x, force, size;
    int n;
} climb;

static int snapped_beams(const climb *c)
{
    int count = 0;
    for (int j = 0; j < c->n; j++) count += ts_law_snapped(c->part + j, c->at[j]);
    return count;
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
    else ts_law_append(law, MAKE(ts_law_piece){p, {c->force, top}, 1, 0});
}

/* Elongation where part j, rising, stands under the force `top` at the end of a rise: at its own end where that ties. */
static double stands(const climb *c, int j, double top)
{
    const ts_law *part = c->part + j;
    if (c->at[j] >= part->n) return ts_law_stop(part);
    const ts_law_piece *s = part->piece + c->at[j];
    return s->force[1] <= top * (1.0 + TS_TIE) ? s->p.hi : ts_law_inverse(part, c->at[j], top, c->u[j]);
}

/* All parts on their rising pieces up to `top`, the leader's force at its end. */
static void rise_to(climb *c, int leader, double top)
{
    const ts_law *lead = c->part + leader;
    double end = top < INFINITY ? 0.0 : INFINITY;
    ts_rise r = ts_rise_of(c->part, c->n, c->at, leader, c->u);
    r.mover = c->mover;
    r.lo = ts_law_inverse(lead, c->at[leader], c->force, 0.0);
    r.hi = ts_law_inverse(lead, c->at[leader], top, 0.0);
    ts_rise_gather(&r);
    for (int j = 0; j < c->n && top < INFINITY; j++) end += stands(c, j, top);
    int wide = end > c->x * (1.0 + NARROW);
    TS_ASSERT(top >= c->force && end >= c->x * (1.0 - 1e-9));
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
    double start = part->piece[c->at[j]].p.hi;
    for (int i = c->at[j] + 1;; i++) {
        if (i == part->n) {
            c->law->reason = "a part of a series never bears again the force of its maximum";
            return;
        }
        const ts_law_piece *s = part->piece + i;
        int done = s->way > 0 && s->force[1] >= c->force * (1.0 - TS_TIE);
        ts_piece p = s->p;
        int at_end = !done || s->force[1] <= c->force * (1.0 + TS_TIE); /* of a next maximum that ties */
        double end = at_end ? p.hi : ts_law_inverse(part, i, c->force, 0.0);
        if (s->force[0] < 0.0 || s->force[1] < 0.0) {
            c->law->reason = "a part of a single-valued series pushes after its maximum; its law must be hysteretic";
            return;
        }
        if (!done && !(end < INFINITY)) continue; /* there is no more: the loop says so */
        double *rows = ts_rows_behind(&c->law->table, c->law->rows, p.rows);
        if (!rows) {
            c->law->reason = "out of memory";
            return;
        }
        memcpy(rows, part->table + TS_ROW * p.first, sizeof *rows * TS_ROW * (size_t)p.rows);
        p.first = c->law->rows;
        c->law->rows += p.rows;
        c->at[j] = i;
        p.snapped = snapped_beams(c);
        p.lo = c->x;
        p.hi = c->x += end - s->p.lo;
        p.origin = p.lo + (s->p.origin - s->p.lo);
        int smooth = s->smooth && s->p.lo > start;
        if (p.hi > p.lo)
            ts_law_append(c->law, MAKE(ts_law_piece){p, {s->force[0], done ? c->force : s->force[1]}, s->way, smooth});
        c->u[j] = end;
        if (done) return;
    }
}

/* The part that reaches the end of its piece first; -1: all are at their stops. */
static int first_to_end(const climb *c)
{
    int first = -1;
    for (int j = 0; j < c->n; j++) {
        if (c->at[j] >= c->part[j].n) continue;
        if (first < 0 || c->part[j].piece[c->at[j]].force[1] < c->part[first].piece[c->at[first]].force[1]) first = j;
    }
    return first;
}

/* Does a part that stands at the end of its piece go on rising, or stop there? */
static int goes_on(const climb *c, int j)
{
    const ts_law *part = c->part + j;
    int next = c->at[j] + 1;
    return next == part->n || part->piece[next].way > 0;
}

/* Single-valued series of parts; a reason why there is none, or NULL. */
const char *ts_series(ts_law *law, const ts_law *part, int n)
{
    climb c;
    memset(&c, 0, sizeof c);
    c.law = law;
    c.part = part;
    c.n = n;
    c.at = (int32_t *)calloc((size_t)n, sizeof *c.at);
    c.u = (double *)calloc((size_t)n, sizeof *c.u);
    c.mover = (ts_mover *)calloc((size_t)n, sizeof *c.mover);
    if (!c.at || !c.u || !c.mover) law->reason = "out of memory";
    for (int j = 0; j < n && !law->reason; j++) {
        c.size = fmax(c.size, ts_law_largest(part + j));
        if (part[j].piece[0].way <= 0) law->reason = "the force of a part of a series does not rise from 0";
    }
    while (!law->reason) {
        int leader = first_to_end(&c), next = -1;
        if (leader < 0) break;
        double top = part[leader].piece[c.at[leader]].force[1];
        if (top > c.force * (1.0 + TS_TIE) || c.x == 0.0) rise_to(&c, leader, top);
        if (c.law->reason || !(top < INFINITY)) break;
        for (int j = 0; j < n; j++) {
            if (c.at[j] >= part[j].n || part[j].piece[c.at[j]].force[1] > c.force * (1.0 + TS_TIE)) continue;
            if (goes_on(&c, j)) c.at[j]++;
            else if (next < 0) next = j;
        }
        if (next >= 0) snap(&c, next);
    }
    free(c.at);
    free(c.u);
    free(c.mover);
    return law->reason;
}
