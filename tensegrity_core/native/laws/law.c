/* A law's pieces: how they come about, force, energy and inverse on them, and the curve that they make.
 *
 * Springs, beams, polynomials, tables and sums of these are exact up to round-off.  What only an equation defines, parts in
 * series (series.c), holds polynomials through its exact values, as far apart as TS_FIT_ERROR allows. */
#include "laws/law.h"
#include "invariants.h"
#include "laws/curve.h"
#include "laws/polynomial.h"
#include "linear/pairs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define WIDE 1024.0 /* m, subinterval of exact pieces without end: a power of two changes no digits */

void ts_law_free(ts_law *law)
{
    free(law->piece);
    free(law->table);
    memset(law, 0, sizeof *law);
}

/* Parts and the array that holds them. */
void ts_laws_free(ts_law *part, int n)
{
    for (int j = 0; part && j < n; j++) ts_law_free(part + j);
    free(part);
}

/* Append a piece; its rows are those at the table's end. */
void ts_law_append(ts_law *law, ts_law_piece piece)
{
    ts_law_piece *s = (ts_law_piece *)realloc(law->piece, sizeof *s * ((size_t)law->n + 1));
    if (!s) {
        law->reason = "out of memory";
        return;
    }
    law->piece = s;
    TS_ASSERT(piece.p.lo == (law->n ? s[law->n - 1].p.hi : 0.0) && piece.p.hi > piece.p.lo);
    s[law->n++] = piece;
}

/* Append a piece whose force is sum c_k (u - lo)^k, k = 0..TS_DEGREE; it is monotone there. */
void ts_law_append_polynomial(ts_law *law, double lo, double hi, const double *c, double end_force, int way, int snapped,
                              int smooth)
{
    double *row = ts_rows_behind(&law->table, law->rows, 1), w = hi < INFINITY ? hi - lo : WIDE, power = 1.0;
    if (!row) {
        law->reason = "out of memory";
        return;
    }
    for (int k = 0; k <= TS_DEGREE; k++, power *= w) row[1 + k] = c[k] * power;
    ts_piece p = ts_piece_of(TS_ROWS, lo, hi, snapped);
    p.rows = 1;
    p.first = law->rows++;
    p.origin = lo;
    p.scale = 1.0 / w;
    ts_law_append(law, MAKE(ts_law_piece){p, {c[0], way ? end_force : c[0]}, way, smooth});
}

/* Append sum c_k (u - lo)^k on [lo, hi], cut at its extrema.  start: the force at lo; smooth: of the first piece. */
void ts_law_append_cut(ts_law *law, double lo, double hi, const double *c, double start, int snapped, int smooth)
{
    double slope[TS_DEGREE + 1], turns[TS_DEGREE + 2], here[TS_DEGREE + 1], next[TS_DEGREE + 1], at = 0.0;
    ts_derive_polynomial(c, slope);
    int n = ts_sign_changes(slope, 0.0, hi < INFINITY ? hi - lo : ts_last_zero(c), turns);
    if (hi < INFINITY) n = ts_drop_ends(turns, n, hi - lo);
    memcpy(here, c, sizeof here);
    here[0] = start;
    turns[n] = hi - lo;
    for (int i = 0; i <= n; i++) {
        double middle = i < n || hi < INFINITY ? 0.5 * (at + turns[i]) : 2.0 * at + 1.0;
        if (i < n) {
            ts_shift_polynomial(c, turns[i], next);
            next[1] = 0.0;
        }
        double end = i < n ? next[0] : hi < INFINITY ? ts_polynomial(c, hi - lo) : ts_limit(c);
        int way = ts_sign(ts_polynomial(slope, middle));
        ts_law_append_polynomial(law, lo + at, i < n ? lo + turns[i] : hi, here, end, way, snapped, i ? 1 : smooth);
        at = turns[i];
        memcpy(here, next, sizeof here);
    }
}

double ts_law_stop(const ts_law *law) { return law->piece[law->n - 1].p.hi; }

/* Largest force at the ends of its pieces, N. */
double ts_law_largest(const ts_law *law)
{
    double most = 0.0;
    for (int i = 0; i < law->n; i++)
        for (int end = 0; end < 2; end++)
            if (fabs(law->piece[i].force[end]) < INFINITY) most = fmax(most, fabs(law->piece[i].force[end]));
    return most;
}

/* Stretch that holds an elongation; the lower one at an end. */
int ts_law_at(const ts_law *law, double u)
{
    int i = 0;
    while (i < law->n - 1 && u > law->piece[i].p.hi) i++;
    return i;
}

int ts_law_snapped(const ts_law *law, int piece) { return law->piece[piece < law->n ? piece : law->n - 1].p.snapped; }

double ts_law_force(const ts_law *law, int piece, double u, double *slope)
{
    TS_ASSERT(piece >= 0 && piece < law->n);
    return ts_piece_force(&law->piece[piece].p, law->table, INFINITY, u, 0.0, slope);
}

double ts_law_energy(const ts_law *law, int piece, double u)
{
    return ts_piece_energy(&law->piece[piece < law->n ? piece : law->n - 1].p, law->table, INFINITY, u, 0.0);
}

/* A force this near that of an end is one with it, N: TS_TIE of the largest force on the piece, since a minimum that is small
 * beside it has the round-off of the whole. */
double ts_law_tie(const ts_law_piece *s)
{
    return TS_TIE * fmax(fabs(s->force[0]), s->force[1] < INFINITY ? fabs(s->force[1]) : 0.0);
}

/* Elongation on a piece where it bears f: Newton inside a shrinking bracket. */
double ts_law_inverse(const ts_law *law, int piece, double f, double guess)
{
    const ts_law_piece *s = law->piece + piece;
    double a = s->p.lo, b = s->p.hi, way = s->way, slope;
    if (way * (f - s->force[0]) <= 0.0) return a; /* extrema are met exactly */
    if (f == s->force[1] || way * (f - s->force[1]) >= 0.0) return b;
    if (!(b < INFINITY)) {
        double w = 1.0 / s->p.scale;
        if (s->p.kind == TS_ROWS) w = 1e-3;
        for (b = a + w; way * (ts_law_force(law, piece, b, &slope) - f) < 0.0; w *= 2.0) b = a + 2.0 * w;
    }
    double u = guess > a && guess < b ? guess : 0.5 * (a + b);
    for (int n = 0; n < 200; n++) {
        double r = way * (ts_law_force(law, piece, u, &slope) - f);
        if (r == 0.0) return u;
        if (r > 0.0) b = u;
        else a = u;
        double next = u - r / (way * slope);
        if (!(next > a && next < b)) next = 0.5 * (a + b);
        if (fabs(next - u) <= 4e-16 * fabs(u)) return next;
        u = next;
    }
    return u;
}

/* Put a piece's only polynomial on the subinterval that the piece covers. */
static void rescale(ts_piece *p, double *table)
{
    double ratio = p->scale * (p->hi - p->lo), power = 1.0;
    if (p->kind != TS_ROWS || p->rows != 1 || !(p->hi < INFINITY)) return;
    for (int k = 0; k <= TS_DEGREE; k++, power *= ratio) table[TS_ROW * p->first + 1 + k] *= power;
    p->scale = 1.0 / (p->hi - p->lo);
}

/* The curve of a law: pieces that go on with the same polynomial make one of the curve's.  A reason why not, or NULL. */
const char *ts_law_curve(ts_curve *c, const ts_law *law)
{
    size_t bytes = sizeof(double) * TS_ROW * (size_t)law->rows;
    memset(c, 0, sizeof *c);
    c->piece = (ts_piece *)calloc((size_t)law->n + 2, sizeof *c->piece);
    c->table = (double *)malloc(bytes + 1);
    if (!c->piece || !c->table) {
        ts_curve_free(c);
        return "out of memory";
    }
    memcpy(c->table, law->table, bytes);
    c->piece[c->pieces++] = ts_piece_of(TS_SLACK, -INFINITY, 0.0, 0);
    for (int i = 0; i < law->n; i++) {
        const ts_law_piece *s = law->piece + i;
        ts_piece *last = c->piece + c->pieces - 1;
        if (i && s->smooth && s->p.snapped == last->snapped) last->hi = s->p.hi;
        else c->piece[c->pieces++] = s->p;
    }
    double energy = 0.0, slope;
    for (int i = 1; i < c->pieces; i++) {
        ts_piece *p = c->piece + i;
        rescale(p, c->table);
        ts_piece_integrate(p, c->table, energy);
        if (p->hi < INFINITY) energy = ts_piece_energy(p, c->table, INFINITY, p->hi, 0.0);
    }
    const ts_piece *last = c->piece + c->pieces - 1;
    double stop = last->hi;
    if (stop < INFINITY) {
        double force = ts_piece_force(last, c->table, INFINITY, stop, 0.0, &slope);
        ts_piece end = ts_piece_of(TS_STRAIGHT, stop, INFINITY, last->snapped);
        end.force = force;
        end.energy = energy;
        c->piece[c->pieces++] = end;
    }
    ts_curve_chain(c);
    return NULL;
}
