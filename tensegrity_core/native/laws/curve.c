/* Force curves of strings: pieces of polynomials in the elongation, evaluated in constant time, as a graph that says which
 * piece follows where one is left, and what that costs.
 *
 * A law that is a function of the elongation is a chain of pieces, each joining the next without loss.  A law with memory
 * (hysteresis.c) has several pieces at one elongation, and pieces that end at a fold: there the force depends on the
 * distance s^2 from the fold by powers of s, and so do the polynomials.  Past a fold the force stays as it is there, so that
 * a trial step may look beyond. */
#include "laws/curve.h"
#include "invariants.h"
#include "linear/pairs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define LEAST_ROOT 1e-3 /* of a piece's largest s: slopes are those at least that far from its fold */

/* A piece of which all else is 0. */
ts_piece ts_piece_of(int kind, double lo, double hi, int snapped)
{
    ts_piece p;
    memset(&p, 0, sizeof p);
    p.kind = kind;
    p.lo = lo;
    p.hi = hi;
    p.snapped = snapped;
    return p;
}

/* f(t) of a row and its derivative by t. */
ALWAYS_INLINE double row_force(const double *row, double t, double *slope)
{
    double f = row[1 + TS_DEGREE], d = 0.0;
    for (int i = TS_DEGREE; i >= 1; i--) {
        d = d * t + f;
        f = f * t + row[i];
    }
    *slope = d;
    return f;
}

static const double *piece_row(const ts_piece *p, const double *table, double x, double *t)
{
    double place = (x - p->origin) * p->scale;
    int i = place > 0.0 ? (place < p->rows ? (int)place : p->rows - 1) : 0;
    *t = place - i;
    return table + TS_ROW * (p->first + i);
}

/* Width of a row, m, and where it begins. */
double ts_row_width(const ts_piece *p, int row, double *begin)
{
    int octave = row / p->each, n = row % p->each, lower = p->octaves[0];
    if (p->kind == TS_OPEN) {
        double from = ldexp(1.0, octave), w = from / p->scale / p->each;
        *begin = p->origin + (from - 1.0) / p->scale + n * w;
        return w;
    }
    int upper = octave >= lower, far = upper ? octave - lower : lower - 1 - octave; /* octaves from the middle */
    int last = far == (upper ? p->octaves[1] : lower) - 1;
    double whole = 1.0 / p->scale, reach = ldexp(0.5 * whole, -far), from = last ? 0.0 : 0.5 * reach;
    double w = (reach - from) / p->each;
    *begin = p->origin + (upper ? whole - reach + n * w : from + n * w);
    return w;
}

/* The row at x of a piece whose rows have several widths.  scale: rows per metre there. */
static const double *uneven_row(const ts_piece *p, const double *table, double x, double *t, double *scale)
{
    int octave = 0;
    double begin;
    if (p->kind == TS_OPEN) {
        double place = 1.0 + (x - p->origin) * p->scale;
        if (place >= 2.0) octave = ilogb(place) < TS_OCTAVES ? ilogb(place) : TS_OCTAVES - 1;
    } else {
        double place = 2.0 * (x - p->origin) * p->scale;
        int upper = place > 1.0, count = p->octaves[upper];
        double part = upper ? 2.0 - place : place; /* 1 in the middle */
        int far = part >= 1.0 ? 0 : part > 0.0 && -1 - ilogb(part) < count ? -1 - ilogb(part) : count - 1;
        octave = upper ? p->octaves[0] + far : p->octaves[0] - 1 - far;
    }
    double w = ts_row_width(p, octave * p->each, &begin), place = (x - begin) / w;
    int i = place > 0.0 ? (place < p->each ? (int)place : p->each - 1) : 0;
    *t = place - i;
    *scale = 1.0 / w;
    TS_ASSERT(octave >= 0 && octave * p->each + i < p->rows);
    return table + TS_ROW * (p->first + octave * p->each + i);
}

/* `reach` rows past a piece's ends its formula goes on as a straight line.  Takes from t what lies beyond. */
static double beyond(double reach, double *t)
{
    double excess = *t < -reach ? *t + reach : *t > 1.0 + reach ? *t - 1.0 - reach : 0.0;
    *t -= excess;
    return excess;
}

/* Of a piece with a fold: s = sqrt(distance from it), m^(1/2). */
static double root(const ts_piece *p, double x)
{
    double d = p->kind == TS_FOLD_ABOVE ? p->hi - x : x - p->lo;
    return d > 0.0 ? sqrt(d) : 0.0;
}

static double fold_force(const ts_piece *p, const double *table, double reach, double x, double *stiffness)
{
    double s = root(p, x), t, d, least = LEAST_ROOT * p->rows / p->scale;
    const double *row = piece_row(p, table, s, &t);
    double straight = beyond(reach, &t), f = row_force(row, t, &d);
    *stiffness = s > 0.0 ? (p->kind == TS_FOLD_ABOVE ? -0.5 : 0.5) * d * p->scale / fmax(s, least) : 0.0;
    return f + d * straight;
}

static double other_force(const ts_piece *p, const double *table, double reach, double x, double k, double *stiffness)
{
    if (p->kind == TS_SLACK) return *stiffness = 0.0;
    if (p->kind == TS_STRAIGHT) {
        *stiffness = k;
        return p->force + k * (x - p->lo);
    }
    if (p->kind == TS_FOLD_ABOVE || p->kind == TS_FOLD_BELOW) return fold_force(p, table, reach, x, stiffness);
    double t, d, scale;
    const double *row = uneven_row(p, table, x, &t, &scale);
    double straight = beyond(reach, &t), f = row_force(row, t, &d);
    *stiffness = d * scale;
    return f + d * straight;
}

/* Elastic tension (N) on a piece, continued past its ends, and its derivative (N/m).  k: N/m, of straight pieces. */
double ts_piece_force(const ts_piece *p, const double *table, double reach, double x, double k, double *stiffness)
{
    if (p->kind != TS_ROWS) return other_force(p, table, reach, x, k, stiffness);
    double t, d;
    const double *row = piece_row(p, table, x, &t);
    double straight = beyond(reach, &t), f = row_force(row, t, &d);
    *stiffness = d * p->scale;
    return f + d * straight;
}

double ts_curve_force(const ts_curve *c, int piece, double x, double k, double *stiffness)
{
    return ts_piece_force(c->piece + piece, c->table, c->reach, x, k, stiffness);
}

/* Integral over t of a row's force, times t where first is 1, from 0. */
static double row_integral(const double *row, double t, int first)
{
    double sum = 0.0;
    for (int i = TS_DEGREE; i >= 0; i--) sum = sum * t + row[1 + i] / (i + 1 + first);
    return first ? sum * t * t : sum * t;
}

/* With x = fold -+ s^2 the energy is the integral of -+2 s T ds from the row's start s0. */
static double fold_energy(const ts_piece *p, const double *table, double reach, double x)
{
    double s = root(p, x), t, d, past = p->kind == TS_FOLD_ABOVE ? x - p->hi : x - p->lo, w = 1.0 / p->scale;
    const double *row = piece_row(p, table, s, &t);
    double s0 = s - t * w, straight = beyond(reach, &t), side = p->kind == TS_FOLD_ABOVE ? -1.0 : 1.0;
    if (s == 0.0) return row[0] + row[1] * past;
    double energy = row[0] + side * 2.0 * w * (s0 * row_integral(row, t, 0) + w * row_integral(row, t, 1));
    if (straight != 0.0) { /* (f + d r)(s1 + w r), r = 0..straight */
        double f = row_force(row, t, &d), s1 = s0 + t * w;
        energy += side * 2.0 * w * straight * (f * s1 + 0.5 * straight * (d * s1 + f * w + 2.0 / 3.0 * d * w * straight));
    }
    return energy;
}

/* Stored energy (J): the integral of ts_piece_force. */
double ts_piece_energy(const ts_piece *p, const double *table, double reach, double x, double k)
{
    if (p->kind == TS_SLACK) return p->energy;
    if (p->kind == TS_STRAIGHT) {
        double y = x - p->lo;
        return p->energy + y * (p->force + 0.5 * k * y);
    }
    if (p->kind == TS_FOLD_ABOVE || p->kind == TS_FOLD_BELOW) return fold_energy(p, table, reach, x);
    double t, slope, scale = p->scale, past = 0.0;
    const double *row = p->kind == TS_ROWS ? piece_row(p, table, x, &t) : uneven_row(p, table, x, &t, &scale);
    double straight = beyond(reach, &t), area = row_integral(row, t, 0);
    if (straight != 0.0) {
        double f = row_force(row, t, &slope);
        past = straight * (f + 0.5 * slope * straight);
    }
    return row[0] + (area + past) / scale;
}

double ts_curve_energy(const ts_curve *c, int piece, double x, double k)
{
    return ts_piece_energy(c->piece + piece, c->table, c->reach, x, k);
}

/* Energies at the rows' starts, from the energy at the piece's beginning; returns that at its end. */
double ts_piece_integrate(const ts_piece *p, double *table, double energy)
{
    int even = p->kind == TS_ROWS, fold = p->kind == TS_FOLD_ABOVE || p->kind == TS_FOLD_BELOW;
    double w = 1.0 / p->scale, start = energy, begin;
    for (int i = 0; i < p->rows; i++) {
        double *row = table + TS_ROW * (p->first + i), width = even || fold ? w : ts_row_width(p, i, &begin);
        double side = p->kind == TS_FOLD_ABOVE ? -2.0 : 2.0;
        row[0] = energy;
        energy += fold ? side * w * w * (i * row_integral(row, 1.0, 0) + row_integral(row, 1.0, 1))
                       : row_integral(row, 1.0, 0) * width;
    }
    if (p->kind != TS_FOLD_ABOVE) return energy;
    double whole = start - energy; /* its rows go down from the fold */
    for (int i = 0; i < p->rows; i++) table[TS_ROW * (p->first + i)] += whole;
    return start + whole;
}

void ts_curve_free(ts_curve *c)
{
    free(c->table);
    free(c->piece);
    memset(c, 0, sizeof *c);
}

/* Pieces in the order of the elongation follow each other without loss; the first is slack. */
void ts_curve_chain(ts_curve *c)
{
    for (int i = 0; i < c->pieces; i++) {
        TS_ASSERT(i == 0 || c->piece[i].lo == c->piece[i - 1].hi);
        c->piece[i].down = i - 1;
        c->piece[i].up = i + 1 < c->pieces ? i + 1 : -1;
        c->piece[i].loss_down = c->piece[i].loss_up = 0.0;
    }
    c->branches = 0;
}

/* Room for rows behind those of a table: the first of them; NULL: out of memory. */
double *ts_rows_behind(double **table, int32_t rows, int32_t more)
{
    double *all = (double *)realloc(*table, sizeof *all * TS_ROW * ((size_t)rows + (size_t)more));
    if (all) *table = all;
    return all ? all + TS_ROW * (size_t)rows : NULL;
}

/* A string that is a spring of stiffness k: the straight piece alone. */
const char *ts_curve_plain(ts_curve *c)
{
    memset(c, 0, sizeof *c);
    c->piece = (ts_piece *)calloc(2, sizeof *c->piece);
    if (!c->piece) return "out of memory";
    c->piece[0] = ts_piece_of(TS_SLACK, -INFINITY, 0.0, 0);
    c->piece[1] = ts_piece_of(TS_STRAIGHT, 0.0, INFINITY, 0);
    c->pieces = 2;
    ts_curve_chain(c);
    return NULL;
}

/* A spring that also pushes: the same straight piece, which begins nowhere; lo is where its force is 0. */
const char *ts_curve_two_way(ts_curve *c)
{
    memset(c, 0, sizeof *c);
    c->piece = (ts_piece *)calloc(1, sizeof *c->piece);
    if (!c->piece) return "out of memory";
    c->piece[0] = ts_piece_of(TS_STRAIGHT, 0.0, INFINITY, 0);
    c->pieces = 1;
    ts_curve_chain(c);
    return NULL;
}

/* Piece that holds the elongation x: of a chain; where there is memory, that of a first loading. */
int ts_curve_piece(const ts_curve *c, double x)
{
    double loss = 0.0;
    return ts_curve_walk(c, 0, x, 0.0, &loss);
}

/* Piece where a string ends up whose elongation goes from where `piece` holds it to x, and adds to loss (J) what the snaps
 * on the way dissipate.  guard: m, that an end may be passed. */
int ts_curve_walk(const ts_curve *c, int piece, double x, double guard, double *loss)
{
    for (int n = 0; n <= 2 * c->pieces; n++) {
        const ts_piece *p = c->piece + piece;
        TS_ASSERT(piece >= 0 && piece < c->pieces && n < 2 * c->pieces);
        if (x > p->hi + guard && p->up >= 0) {
            *loss += p->loss_up;
            piece = p->up;
        } else if (x < p->lo - guard && p->down >= 0) {
            *loss += p->loss_down;
            piece = p->down;
        } else {
            break;
        }
    }
    return piece;
}
