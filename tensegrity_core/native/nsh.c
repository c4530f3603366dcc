/* Negative stiffness honeycombs: the single-valued series curve as a table that is evaluated in constant time.
 *
 * Snaps are cubics and stored exactly.  On a rise the elongation is a closed function of the force but not the other way
 * round; there the table holds polynomials of degree TS_DEGREE through Chebyshev points of the exact curve, on as many
 * equal subintervals as it takes to reach TS_FIT_ERROR. */
#include "internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define TS_FIT_ERROR 2e-13 /* of the largest force */
#define TS_MAX_ROWS 1024   /* subintervals of one piece */

typedef struct {
    double Q, zeta, h, s, f_max;
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
        if (r > 0.0) hi = x; else lo = x;
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

static double rise_force(const rise *r, double xi, double x_lo, double x_hi)
{
    double x = 0.5 * (x_lo + x_hi);
    for (int i = 0; i < 100; i++) {
        double slope, g = rise_elongation(r, x, &slope) - xi;
        if (g > 0.0) x_hi = x; else x_lo = x;
        double next = x - g / slope;
        if (!(next > x_lo && next < x_hi)) next = 0.5 * (x_lo + x_hi);
        double moved = fabs(next - x);
        x = next;
        if (moved <= 1e-15) break;
    }
    return beam_force(&r->b[r->leader], x);
}

/* Coefficients in t = 0..1 of the polynomial through the Chebyshev points of [a, a + w] (Newton's divided differences). */
static void fit_row(const rise *r, double a, double w, double x_lo, double x_hi, double *coef)
{
    static const double t[TS_DEGREE + 1] = { /* (1 - cos((2 i + 1) pi/16))/2; written out: libraries differ in cos */
        0.009607359798384785, 0.08426519384872738, 0.22221488349019886, 0.40245483899193585,
        0.5975451610080641, 0.777785116509801, 0.9157348061512727, 0.9903926402016152};
    double d[TS_DEGREE + 1];
    for (int i = 0; i <= TS_DEGREE; i++) d[i] = rise_force(r, a + w * t[i], x_lo, x_hi);
    for (int k = 1; k <= TS_DEGREE; k++)
        for (int i = TS_DEGREE; i >= k; i--) d[i] = (d[i] - d[i - 1]) / (t[i] - t[i - k]);
    for (int i = 0; i <= TS_DEGREE; i++) coef[i] = 0.0;
    for (int k = TS_DEGREE; k >= 0; k--) { /* Horner on the Newton form */
        for (int i = TS_DEGREE; i >= 1; i--) coef[i] = coef[i - 1] - t[k] * coef[i];
        coef[0] = d[k] - t[k] * coef[0];
    }
}

static double polynomial(const double *c, double t)
{
    double f = c[TS_DEGREE];
    for (int i = TS_DEGREE - 1; i >= 0; i--) f = f * t + c[i];
    return f;
}

/* Append a piece with `rows` empty rows; 0 when out of memory. */
static int add_piece(ts_curve *c, double start, double end, int rows)
{
    int p = c->pieces, first = p ? c->first[p - 1] + c->rows[p - 1] : 0;
    double *table = realloc(c->table, sizeof(double) * TS_ROW * (size_t)(first + rows));
    if (!table) return 0;
    c->table = table;
    memset(table + TS_ROW * first, 0, sizeof(double) * TS_ROW * (size_t)rows);
    c->rows[p] = rows;
    c->first[p] = first;
    c->end[p] = start;
    c->end[p + 1] = end;
    c->scale[p] = rows / (end - start);
    c->pieces++;
    return 1;
}

static int add_rise(ts_curve *c, const rise *r, double start, double end, double x_lo, double x_hi, int snapped, double size)
{
    for (int rows = 1;; rows *= 2) {
        double worst = 0.0, w = (end - start) / rows;
        if (!add_piece(c, start, end, rows)) return 0;
        double *row = c->table + TS_ROW * c->first[c->pieces - 1];
        for (int i = 0; i < rows; i++, row += TS_ROW) {
            fit_row(r, start + i * w, w, x_lo, x_hi, row + 1);
            for (int k = 0; k <= 4; k++) {
                double t = 0.25 * k, error = fabs(polynomial(row + 1, t) - rise_force(r, start + (i + t) * w, x_lo, x_hi));
                if (error > worst) worst = error;
            }
        }
        if (worst <= TS_FIT_ERROR * size || rows >= TS_MAX_ROWS) break;
        c->pieces--;
    }
    c->snapped[c->pieces] = snapped;
    return 1;
}

/* Beam b follows its cubic from x = 1 - s to 1 + 2 s, where its force is f_max again. */
static int add_snap(ts_curve *c, const beam *b, double start, int snapped)
{
    double x0 = 1.0 - b->s, w = 3.0 * b->s, z = b->Q * b->zeta;
    if (!add_piece(c, start, start + b->h * w, 1)) return 0;
    double *coef = c->table + TS_ROW * c->first[c->pieces - 1] + 1;
    coef[0] = b->f_max;
    coef[1] = 0.0; /* the slope at the extremum */
    coef[2] = z * (3.0 * x0 - 3.0) * w * w;
    coef[3] = z * w * w * w;
    c->snapped[c->pieces] = snapped;
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
            if (4.0 * r->b[j].Q <= from) r->stopped[j] = 1;
            else if (4.0 * r->b[j].Q < next) {
                next = 4.0 * r->b[j].Q;
                stop = j;
            }
        }
        int on_three = r->snapped[r->leader];
        double slope, x_lo = beam_inverse(lead, on_three, from), x_hi = beam_inverse(lead, on_three, next);
        double a = rise_elongation(r, x_lo, &slope), b = rise_elongation(r, x_hi, &slope);
        if (c->pieces) a = c->end[c->pieces];
        if (b > a + 1e-12 * b && !add_rise(c, r, a, b, x_lo, x_hi, snapped, size)) return 0;
        if (stop < 0) return 1;
        r->stopped[stop] = 1;
        from = next;
    }
}

static void integrate_rows(ts_curve *c)
{
    double energy = 0.0;
    for (int p = 0; p < c->pieces; p++)
        for (int i = 0; i < c->rows[p]; i++) {
            double *row = c->table + TS_ROW * (c->first[p] + i), sum = 0.0;
            for (int k = TS_DEGREE; k >= 0; k--) sum += row[1 + k] / (k + 1);
            row[0] = energy;
            energy += sum / c->scale[p];
        }
    c->energy_end = energy;
}

void ts_curve_free(ts_curve *c)
{
    free(c->table);
    free(c->rows);
    free(c->end);
    memset(c, 0, sizeof *c);
}

static void sort_beams(beam *b, int n, const double *Q, const double *zeta, const double *h)
{
    for (int i = 0; i < n; i++) { /* by f_max, ties by index */
        double s = sqrt((zeta[i] - 2.0) / (3.0 * zeta[i])); /* eq. 14 */
        beam next = {Q[i], zeta[i], h[i], s, 0.0};
        next.f_max = beam_force(&next, 1.0 - s); /* to the last bit what the leader of a rise carries at its end */
        int j = i;
        for (; j > 0 && b[j - 1].f_max > next.f_max; j--) b[j] = b[j - 1];
        b[j] = next;
    }
}

static int add_all(ts_curve *c, rise *r)
{
    const beam *b = r->b;
    double f = 0.0;
    for (int i = 0; i < r->n; i++)
        if (4.0 * b[i].Q > c->force_end) c->force_end = 4.0 * b[i].Q;
    for (int i = 0; i < r->n; i++) {
        r->leader = i;
        if (!add_rises(c, r, f, b[i].f_max, i, c->force_end)) return 0;
        if (!add_snap(c, &b[i], c->end[c->pieces], i + 1)) return 0;
        r->snapped[i] = 1;
        f = b[i].f_max;
    }
    for (int i = 0; i < r->n; i++)
        if (4.0 * b[i].Q == c->force_end) r->leader = i;
    return add_rises(c, r, f, c->force_end, r->n, c->force_end);
}

/* Curve of n beams in series (0: a plain string).  0 when out of memory. */
int ts_curve_build(ts_curve *c, int n, const double *Q, const double *zeta, const double *h)
{
    size_t most = 4 * (size_t)n + 2; /* pieces: a snap and a rise for each beam, a further rise for each stop */
    memset(c, 0, sizeof *c);
    c->rows = calloc(3 * most + 2, sizeof(int32_t));
    c->end = calloc(2 * most + 1, sizeof(double));
    beam *b = malloc(((size_t)n + 1) * (sizeof(beam) + 2));
    int done = c->rows && c->end && b;
    if (done) {
        c->first = c->rows + most;
        c->snapped = c->first + most;
        c->scale = c->end + most + 1;
        if (n) {
            rise r = {b, n, 0, (char *)(b + n), (char *)(b + n) + n};
            memset(r.snapped, 0, 2 * (size_t)n);
            sort_beams(b, n, Q, zeta, h);
            done = add_all(c, &r);
        }
    }
    free(b);
    if (!done) {
        ts_curve_free(c);
        return 0;
    }
    c->snapped[c->pieces + 1] = n;
    integrate_rows(c);
    return 1;
}

/* Piece that holds the elongation x: 0 slack, 1..P, P + 1 beyond the curve's end. */
int ts_curve_piece(const ts_curve *c, double x)
{
    if (!(x > 0.0)) return 0;
    int p = 1;
    while (p <= c->pieces && x > c->end[p]) p++;
    return p;
}

static const double *curve_row(const ts_curve *c, int piece, double x, double *t)
{
    int p = piece - 1, i;
    double place = (x - c->end[p]) * c->scale[p];
    i = place > 0.0 ? (place < c->rows[p] ? (int)place : c->rows[p] - 1) : 0;
    *t = place - i;
    return c->table + TS_ROW * (c->first[p] + i);
}

/* `reach` rows past a piece's ends its formula goes on as a straight line.  Takes from t what lies beyond. */
static double beyond(const ts_curve *c, double *t)
{
    double excess = *t < -c->reach ? *t + c->reach : *t > 1.0 + c->reach ? *t - 1.0 - c->reach : 0.0;
    *t -= excess;
    return excess;
}

/* Elastic tension (N) on a piece, continued past its ends, and its derivative (N/m). */
double ts_curve_force(const ts_curve *c, int piece, double x, double k, double *stiffness)
{
    if (piece == 0) {
        *stiffness = 0.0;
        return 0.0;
    }
    if (piece > c->pieces) {
        *stiffness = k;
        return c->force_end + k * (x - c->end[c->pieces]);
    }
    double t;
    const double *row = curve_row(c, piece, x, &t) + 1;
    double f = row[TS_DEGREE], d = 0.0, straight = beyond(c, &t);
    for (int i = TS_DEGREE - 1; i >= 0; i--) {
        d = d * t + f;
        f = f * t + row[i];
    }
    *stiffness = d * c->scale[piece - 1];
    return f + d * straight;
}

/* Stored energy (J): the integral of ts_curve_force. */
double ts_curve_energy(const ts_curve *c, int piece, double x, double k)
{
    if (piece == 0) return 0.0;
    if (piece > c->pieces) {
        double y = x - c->end[c->pieces];
        return c->energy_end + y * (c->force_end + 0.5 * k * y);
    }
    double t, sum = 0.0, slope;
    const double *row = curve_row(c, piece, x, &t);
    double straight = beyond(c, &t), scale = c->scale[piece - 1], past = 0.0;
    for (int i = TS_DEGREE; i >= 0; i--) sum = sum * t + row[1 + i] / (i + 1);
    if (straight != 0.0) {
        double force = ts_curve_force(c, piece, x, k, &slope);
        past = straight * (force - 0.5 * slope * straight / scale);
    }
    return row[0] + (sum * t + past) / scale;
}
