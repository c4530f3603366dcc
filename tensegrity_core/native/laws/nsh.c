/* Negative stiffness honeycombs: the single-valued series curve (Algorithm 1) as a table, see curve.c.
 *
 * Snaps are cubics and stored exactly.  On a rise the elongation is a closed function of the force but not the other way
 * round; there the table holds polynomials of degree TS_DEGREE through Chebyshev points of the exact curve, on as many
 * equal subintervals as it takes to reach TS_FIT_ERROR.
 *
 * Maxima whose forces tie (TS_TIE) are reached together, and those beams snap by index; stops that tie are reached together. */
#include "laws/nsh.h"
#include "laws/curve.h"
#include "laws/fit.h"
#include "laws/law.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    double Q, zeta, h, s, f_max;
    int index;
} beam;

/* A rise: which beams have snapped, which of those are at their stop, and the beam whose x parametrises the rise. */
typedef struct {
    const beam *b;
    int n, leader;
    char *snapped, *stopped; /* (n) */
} rise;

/* eq. 11 */
static double beam_force(const beam *b, double x) { return b->Q * x * (b->zeta * (x * (x - 3.0) + 2.0) + 2.0); }
static double beam_slope(const beam *b, double x) { return b->Q * (b->zeta * (3.0 * x * (x - 2.0) + 2.0) + 2.0); }

/* x on region I or III where the beam carries f: Newton inside a shrinking bracket */
static double beam_inverse(const beam *b, int snapped, double f)
{
    double lo = snapped ? 1.0 + b->s : 0.0, hi = snapped ? 2.0 : 1.0 - b->s;
    if (f >= (snapped ? 4.0 * b->Q : b->f_max)) return hi; /* the fold is met exactly */
    if (f <= beam_force(b, lo)) return lo;
    double x = 0.5 * (lo + hi);
    for (int i = 0; i < 100; i++) {
        double r = beam_force(b, x) - f;
        if (r > 0.0) hi = x;
        else lo = x;
        double next = x - r / beam_slope(b, x);
        if (!(next > lo && next < hi)) next = 0.5 * (lo + hi);
        if (fabs(next - x) <= 1e-15) return next;
        x = next;
    }
    return x;
}

/* Elongation of the rise where its leader stands at x, and its derivative by x. */
static double rise_elongation(const rise *r, double x, double *slope)
{
    const beam *lead = &r->b[r->leader];
    double f = beam_force(lead, x), df = beam_slope(lead, x), xi = lead->h * x, dxi = lead->h;
    for (int j = 0; j < r->n; j++) {
        if (j == r->leader) continue;
        if (r->stopped[j]) {
            xi += 2.0 * r->b[j].h;
            continue;
        }
        double xj = beam_inverse(&r->b[j], r->snapped[j], f), dj = beam_slope(&r->b[j], xj);
        xi += r->b[j].h * xj;
        if (dj > 0.0) dxi += r->b[j].h * df / dj;
    }
    *slope = dxi;
    return xi;
}

/* Elongation of the rise where it ends, at the force f: beams whose maximum or stop ties with f have come to it, which the
 * force alone does not tell to more than half the digits. */
static double rise_end(const rise *r, double f)
{
    double sum = 0.0;
    for (int j = 0; j < r->n; j++) {
        const beam *b = &r->b[j];
        double top = r->snapped[j] ? 4.0 * b->Q : b->f_max;
        sum += b->h * beam_inverse(b, r->snapped[j], top <= f * (1.0 + TS_TIE) ? top : f);
    }
    return sum;
}

static double rise_force(const rise *r, double xi, double x_lo, double x_hi)
{
    double x = 0.5 * (x_lo + x_hi);
    for (int i = 0; i < 100; i++) {
        double slope, g = rise_elongation(r, x, &slope) - xi;
        if (g > 0.0) x_hi = x;
        else x_lo = x;
        double next = x - g / slope;
        if (!(next > x_lo && next < x_hi)) next = 0.5 * (x_lo + x_hi);
        double moved = fabs(next - x);
        x = next;
        if (moved <= 1e-15) break;
    }
    return beam_force(&r->b[r->leader], x);
}

typedef struct {
    const rise *r;
    double x_lo, x_hi; /* of the leader */
} bracketed;

static double force_at(void *at, double xi)
{
    const bracketed *b = (const bracketed *)at;
    return rise_force(b->r, xi, b->x_lo, b->x_hi);
}

static double end_of(const ts_curve *c) { return c->piece[c->pieces - 1].hi; }

/* Append a piece with `rows` empty rows; 0 when out of memory. */
static int add_piece(ts_curve *c, double start, double end, int rows, int snapped)
{
    const ts_piece *last = c->piece + c->pieces - 1;
    int first = last->first + last->rows;
    double *table = (double *)realloc(c->table, sizeof(double) * TS_ROW * (size_t)(first + rows));
    if (!table) return 0;
    c->table = table;
    memset(table + TS_ROW * first, 0, sizeof(double) * TS_ROW * (size_t)rows);
    ts_piece p = ts_piece_of(TS_ROWS, start, end, snapped);
    p.rows = rows;
    p.first = first;
    p.origin = start;
    p.scale = rows / (end - start);
    c->piece[c->pieces++] = p;
    return 1;
}

static int add_rise(ts_curve *c, const rise *r, double start, double end, double x_lo, double x_hi, int snapped, double size)
{
    bracketed b = {r, x_lo, x_hi};
    for (int rows = 1;; rows *= 2) {
        double worst = 0.0, w = (end - start) / rows;
        if (!add_piece(c, start, end, rows, snapped)) return 0;
        double *row = c->table + TS_ROW * c->piece[c->pieces - 1].first;
        for (int i = 0; i < rows; i++, row += TS_ROW) worst = fmax(worst, ts_fit_row(force_at, &b, start + i * w, w, row));
        if (worst <= TS_FIT_ERROR * size || rows >= TS_MAX_ROWS) return 1;
        c->pieces--;
    }
}

/* Beam b follows its cubic from x = 1 - s to 1 + 2 s, where its force is f_max again. */
static int add_snap(ts_curve *c, const beam *b, double start, int snapped)
{
    double x0 = 1.0 - b->s, w = 3.0 * b->s, z = b->Q * b->zeta;
    if (!add_piece(c, start, start + b->h * w, 1, snapped)) return 0;
    double *coef = c->table + TS_ROW * c->piece[c->pieces - 1].first + 1;
    coef[0] = b->f_max;
    coef[1] = 0.0; /* the slope at the extremum */
    coef[2] = z * (3.0 * x0 - 3.0) * w * w;
    coef[3] = z * w * w * w;
    return 1;
}

/* Rises end where a snapped beam reaches its stop (f = 4 Q) and where the leader reaches its own end. */
static int add_rises(ts_curve *c, rise *r, double from, double to, int snapped, double size)
{
    const beam *lead = &r->b[r->leader];
    for (;;) {
        double next = to;
        int stop = -1;
        for (int j = 0; j < r->n; j++) {
            if (j == r->leader || !r->snapped[j] || r->stopped[j]) continue;
            if (4.0 * r->b[j].Q <= from * (1.0 + TS_TIE)) r->stopped[j] = 1;
            else if (4.0 * r->b[j].Q * (1.0 + TS_TIE) < next) {
                next = 4.0 * r->b[j].Q;
                stop = j;
            }
        }
        int on_three = r->snapped[r->leader];
        double slope, x_lo = beam_inverse(lead, on_three, from), x_hi = beam_inverse(lead, on_three, next);
        double a = c->pieces > 1 ? end_of(c) : rise_elongation(r, x_lo, &slope), b = rise_end(r, next);
        if (b > a + 1e-12 * b && !add_rise(c, r, a, b, x_lo, x_hi, snapped, size)) return 0;
        if (stop < 0) return 1;
        r->stopped[stop] = 1;
        from = next;
    }
}

/* By the force of their maximum, those that tie with the lowest of them by index. */
static void sort_beams(beam *b, int n, const double *Q, const double *zeta, const double *h)
{
    for (int i = 0; i < n; i++) {
        double s = sqrt((zeta[i] - 2.0) / (3.0 * zeta[i])); /* eq. 14 */
        beam next = {Q[i], zeta[i], h[i], s, 0.0, i};
        next.f_max = beam_force(&next, 1.0 - s); /* to the last bit what the leader of a rise carries at its end */
        int j = i;
        for (; j > 0 && b[j - 1].f_max > next.f_max; j--) b[j] = b[j - 1];
        b[j] = next;
    }
    for (int first = 0, end = 0; first < n; first = end) {
        double tied = b[first].f_max * (1.0 + TS_TIE);
        for (; end < n && b[end].f_max <= tied; end++) {
            beam next = b[end];
            int j = end;
            for (; j > first && b[j - 1].index > next.index; j--) b[j] = b[j - 1];
            b[j] = next;
        }
    }
}

/* The beam whose maximum is the lowest of those from i on that tie with it. */
static int lowest_of_tie(const rise *r, int i)
{
    int lowest = i;
    for (int j = i + 1; j < r->n && r->b[j].f_max <= r->b[i].f_max * (1.0 + 2.0 * TS_TIE); j++)
        if (r->b[j].f_max < r->b[lowest].f_max) lowest = j;
    return lowest;
}

static int add_all(ts_curve *c, rise *r, double most)
{
    const beam *b = r->b;
    double f = 0.0;
    for (int i = 0; i < r->n; i++) {
        if (b[i].f_max > f * (1.0 + TS_TIE) || i == 0) { /* else it came to its maximum with the one before */
            r->leader = lowest_of_tie(r, i);
            if (!add_rises(c, r, f, b[r->leader].f_max, i, most)) return 0;
            f = b[r->leader].f_max;
        }
        if (!add_snap(c, &b[i], end_of(c), i + 1)) return 0;
        r->snapped[i] = 1;
    }
    for (int i = 0; i < r->n; i++)
        if (4.0 * b[i].Q == most) r->leader = i;
    return add_rises(c, r, f, most, r->n, most);
}

/* Curve of n beams in series, n > 0.  0 when out of memory. */
int ts_nsh_curve(ts_curve *c, int n, const double *Q, const double *zeta, const double *h)
{
    size_t most = 4 * (size_t)n + 4; /* pieces: a snap and a rise for each beam, a further rise for each stop, both ends */
    double force = 0.0, energy = 0.0;
    memset(c, 0, sizeof *c);
    c->piece = (ts_piece *)calloc(most, sizeof *c->piece);
    beam *b = (beam *)malloc((size_t)n * (sizeof(beam) + 2));
    int done = c->piece && b;
    if (done) {
        rise r = {b, n, 0, (char *)(b + n), (char *)(b + n) + n};
        memset(r.snapped, 0, 2 * (size_t)n);
        sort_beams(b, n, Q, zeta, h);
        for (int i = 0; i < n; i++) force = fmax(force, 4.0 * b[i].Q);
        c->piece[c->pieces++] = ts_piece_of(TS_SLACK, -INFINITY, 0.0, 0);
        done = add_all(c, &r, force);
    }
    free(b);
    if (!done) {
        ts_curve_free(c);
        return 0;
    }
    for (int i = 1; i < c->pieces; i++) energy = ts_piece_integrate(c->piece + i, c->table, energy);
    ts_piece end = ts_piece_of(TS_STRAIGHT, end_of(c), INFINITY, n);
    end.force = force;
    end.energy = energy;
    c->piece[c->pieces++] = end;
    ts_curve_chain(c);
    return 1;
}
