/* Force laws of strings, read from their programs (kernel/packing.py) and compiled into monotone stretches of polynomials, then into
 * curves.
 *
 * Springs, beams, polynomials, tables and sums of these are exact up to round-off.  What only an equation defines, parts in
 * series (series.c), holds polynomials through its exact values, as far apart as TS_FIT_ERROR allows. */
#include "laws.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define WIDE 1024.0 /* m, subinterval of exact stretches without end: a power of two changes no digits */
#define SAME 1e-6 /* of an interval: places that are one */
#define SAMPLES 64  /* of the slope of a fitted sum, to find its extrema */


void ts_law_free(ts_law *law)
{
    free(law->s);
    free(law->table);
    memset(law, 0, sizeof *law);
}

/* Append a stretch; its rows are those at the table's end. */
static void append(ts_law *law, ts_stretch stretch)
{
    ts_stretch *s = (ts_stretch *)realloc(law->s, sizeof *s * ((size_t)law->n + 1));
    if (!s) {
        law->reason = "out of memory";
        return;
    }
    law->s = s;
    s[law->n++] = stretch;
}

/* Append a stretch whose force is sum c_k (u - lo)^k, k = 0..TS_DEGREE; it is monotone there. */
static void append_polynomial(ts_law *law, double lo, double hi, const double *c, double end_force, int way, int snapped,
                              int smooth)
{
    double *table = (double *)realloc(law->table, sizeof *table * TS_ROW * ((size_t)law->rows + 1));
    double w = hi < INFINITY ? hi - lo : WIDE;
    if (!table) {
        law->reason = "out of memory";
        return;
    }
    law->table = table;
    double *row = table + TS_ROW * law->rows, power = 1.0;
    for (int k = 0; k <= TS_DEGREE; k++, power *= w) row[1 + k] = c[k] * power;
    ts_piece p = ts_piece_of(TS_ROWS, lo, hi, snapped);
    p.rows = 1;
    p.first = law->rows++;
    p.origin = lo;
    p.scale = 1.0 / w;
    append(law, MAKE(ts_stretch){p, {c[0], way ? end_force : c[0]}, way, smooth});
}

static double value(const double *c, double y)
{
    double f = c[TS_DEGREE];
    for (int k = TS_DEGREE - 1; k >= 0; k--) f = f * y + c[k];
    return f;
}

/* Coefficients about y of a polynomial about 0. */
static void shift(const double *c, double y, double *out)
{
    memcpy(out, c, sizeof(double) * (TS_DEGREE + 1));
    for (int i = 0; i < TS_DEGREE; i++)
        for (int k = TS_DEGREE - 1; k >= i; k--) out[k] += y * out[k + 1];
}

static void derive(const double *c, double *out)
{
    for (int k = 0; k < TS_DEGREE; k++) out[k] = (k + 1) * c[k + 1];
    out[TS_DEGREE] = 0.0;
}

/* Places in (lo, hi) where a polynomial changes its sign, in order: between those of its derivative there is one at most. */
static int sign_changes(const double *c, double lo, double hi, double *out)
{
    double d[TS_DEGREE + 1], ends[TS_DEGREE + 2];
    int count = 0, degree = TS_DEGREE;
    while (degree > 0 && c[degree] == 0.0) degree--;
    if (degree == 0) return 0;
    derive(c, d);
    int n = sign_changes(d, lo, hi, ends + 1);
    ends[0] = lo;
    ends[++n] = hi;
    for (int i = 0; i < n; i++) {
        double a = ends[i], b = ends[i + 1], fa = value(c, a), fb = value(c, b);
        if (fa == 0.0 && i > 0 && value(c, ends[i - 1]) * fb < 0.0) out[count++] = a; /* the derivative's zero is one, too */
        if (!(fa * fb < 0.0)) continue;
        for (double m = 0.5 * (a + b); m > a && m < b; m = 0.5 * (a + b)) {
            if ((value(c, m) > 0.0) == (fa > 0.0)) a = m;
            else b = m;
        }
        out[count++] = b;
    }
    return count;
}

/* Beyond this the polynomial's derivative has no zero (Cauchy's bound). */
static double last_zero(const double *c)
{
    int n = TS_DEGREE;
    double most = 0.0;
    while (n > 1 && c[n] == 0.0) n--;
    for (int k = 1; k < n; k++) most = fmax(most, fabs(k * c[k] / (n * c[n])));
    return 1.0 + most;
}

static int sign(double x) { return (x > 0.0) - (x < 0.0); }

static double limit(const double *c)
{
    for (int k = TS_DEGREE; k > 0; k--)
        if (c[k] != 0.0) return c[k] > 0.0 ? INFINITY : -INFINITY;
    return c[0];
}

/* Extrema that are none: a polynomial whose slope vanishes at its end may find it again beside it. */
static int drop_ends(double *turns, int n, double width)
{
    int kept = 0;
    for (int i = 0; i < n; i++)
        if (turns[i] > SAME * width && turns[i] < (1.0 - SAME) * width) turns[kept++] = turns[i];
    return kept;
}

/* Append sum c_k (u - lo)^k on [lo, hi], cut at its extrema.  start: the force at lo; smooth: of the first stretch. */
static void append_cut(ts_law *law, double lo, double hi, const double *c, double start, int snapped, int smooth)
{
    double slope[TS_DEGREE + 1], turns[TS_DEGREE + 2], here[TS_DEGREE + 1], next[TS_DEGREE + 1], at = 0.0;
    derive(c, slope);
    int n = sign_changes(slope, 0.0, hi < INFINITY ? hi - lo : last_zero(c), turns);
    if (hi < INFINITY) n = drop_ends(turns, n, hi - lo);
    memcpy(here, c, sizeof here);
    here[0] = start;
    turns[n] = hi - lo;
    for (int i = 0; i <= n; i++) {
        double middle = i < n || hi < INFINITY ? 0.5 * (at + turns[i]) : 2.0 * at + 1.0;
        if (i < n) {
            shift(c, turns[i], next);
            next[1] = 0.0;
        }
        double end = i < n ? next[0] : hi < INFINITY ? value(c, hi - lo) : limit(c);
        int way = sign(value(slope, middle));
        append_polynomial(law, lo + at, i < n ? lo + turns[i] : hi, here, end, way, snapped, i ? 1 : smooth);
        at = turns[i];
        memcpy(here, next, sizeof here);
    }
}

/* eq. 11, about x = u/h: three cubics that meet at the extrema x = 1 -+ s, or one where there are none. */
void ts_law_beam(ts_law *law, double Q, double zeta, double h)
{
    double s = zeta > 2.0 ? sqrt((zeta - 2.0) / (3.0 * zeta)) : 0.0, x[4] = {0.0, 1.0 - s, 1.0 + s, 2.0}, f[4];
    for (int i = 0; i < 4; i++) f[i] = Q * x[i] * (zeta * (x[i] * (x[i] - 3.0) + 2.0) + 2.0);
    for (int i = 0; i < 3; i++) {
        double slope = i == 0 ? 2.0 * Q * (1.0 + zeta) : 0.0, to = s > 0.0 ? h * x[i + 1] : 2.0 * h;
        double c[TS_DEGREE + 1] = {f[i], slope / h, 3.0 * Q * zeta * (x[i] - 1.0) / (h * h), Q * zeta / (h * h * h)};
        append_polynomial(law, h * x[i], to, c, s > 0.0 ? f[i + 1] : f[3], i == 1 ? -1 : 1, i > 0, i > 0);
        if (s == 0.0) return;
    }
}

static void compile_polynomial(ts_law *law, const double *coefficients, int count)
{
    double c[TS_DEGREE + 1] = {0.0};
    memcpy(c + 1, coefficients, sizeof(double) * (size_t)count);
    append_cut(law, 0.0, INFINITY, c, 0.0, 0, 0);
}

/* Slope at an end (Moler's formula as in SciPy's PchipInterpolator). */
static double end_slope(double h0, double h1, double m0, double m1)
{
    double d = ((2.0 * h0 + h1) * m0 - h0 * m1) / (h0 + h1);
    if (sign(d) != sign(m0)) return 0.0;
    return sign(m0) != sign(m1) && fabs(d) > 3.0 * fabs(m0) ? 3.0 * m0 : d;
}

/* Slope at point i of n (Fritsch, Butland, A method for constructing local monotone piecewise cubic interpolants, SIAM Journal
 * on Scientific and Statistical Computing 5, 1984, doi:10.1137/0905021). */
static double pchip_slope(const double *x, const double *f, int n, int i)
{
    int a = i > 0 ? i - 1 : 0, b = i < n - 1 ? i : n - 2;
    double h0 = x[a + 1] - x[a], h1 = x[b + 1] - x[b], m0 = (f[a + 1] - f[a]) / h0, m1 = (f[b + 1] - f[b]) / h1;
    if (n == 2) return m0;
    if (i == 0) return end_slope(h0, x[2] - x[1], m0, (f[2] - f[1]) / (x[2] - x[1]));
    if (i == n - 1) return end_slope(h1, x[i - 1] - x[i - 2], m1, (f[i - 1] - f[i - 2]) / (x[i - 1] - x[i - 2]));
    if (sign(m0) != sign(m1) || m0 == 0.0 || m1 == 0.0) return 0.0;
    double w1 = 2.0 * h1 + h0, w2 = h1 + 2.0 * h0;
    return (w1 + w2) / (w1 / m0 + w2 / m1);
}

static void compile_table(ts_law *law, const double *x, const double *f, int n, int cubic)
{
    double slope = 0.0;
    int rising = x[0] == 0.0 && f[0] == 0.0;
    for (int i = 0; i + 1 < n; i++) rising = rising && x[i + 1] > x[i];
    if (!rising) {
        law->reason = "a table does not increase from (0, 0)";
        return;
    }
    for (int i = 0; i + 1 < n; i++) {
        double h = x[i + 1] - x[i], m = (f[i + 1] - f[i]) / h, c[TS_DEGREE + 1] = {f[i], m};
        slope = m;
        if (cubic && n > 2) {
            double d0 = pchip_slope(x, f, n, i), d1 = pchip_slope(x, f, n, i + 1);
            c[1] = slope = d0;
            c[2] = (3.0 * m - 2.0 * d0 - d1) / h;
            c[3] = (d0 + d1 - 2.0 * m) / (h * h);
            slope = d1;
        } else if (i + 2 == n) {
            append_polynomial(law, x[i], INFINITY, c, limit(c), sign(m), 0, 0);
            return;
        }
        append_polynomial(law, x[i], x[i + 1], c, f[i + 1], sign(m), 0, 0);
    }
    double c[TS_DEGREE + 1] = {f[n - 1], slope};
    append_polynomial(law, x[n - 1], INFINITY, c, limit(c), sign(slope), 0, 0);
}

double ts_law_stop(const ts_law *law) { return law->s[law->n - 1].p.hi; }

/* Largest force at the ends of its stretches, N. */
double ts_law_largest(const ts_law *law)
{
    double most = 0.0;
    for (int i = 0; i < law->n; i++)
        for (int end = 0; end < 2; end++)
            if (fabs(law->s[i].force[end]) < INFINITY) most = fmax(most, fabs(law->s[i].force[end]));
    return most;
}

/* Stretch that holds an elongation; the lower one at an end. */
int ts_law_at(const ts_law *law, double u)
{
    int i = 0;
    while (i < law->n - 1 && u > law->s[i].p.hi) i++;
    return i;
}

int ts_law_snapped(const ts_law *law, int stretch) { return law->s[stretch < law->n ? stretch : law->n - 1].p.snapped; }

double ts_law_force(const ts_law *law, int stretch, double u, double *slope)
{
    return ts_piece_force(&law->s[stretch].p, law->table, INFINITY, u, 0.0, slope);
}

double ts_law_energy(const ts_law *law, int stretch, double u)
{
    return ts_piece_energy(&law->s[stretch < law->n ? stretch : law->n - 1].p, law->table, INFINITY, u, 0.0);
}

/* A force this near that of an end is one with it, N: TS_TIE of the largest force on the stretch, since a minimum that is small
 * beside it has the round-off of the whole. */
double ts_stretch_tie(const ts_stretch *s)
{
    return TS_TIE * fmax(fabs(s->force[0]), s->force[1] < INFINITY ? fabs(s->force[1]) : 0.0);
}

/* Elongation on a stretch where it bears f: Newton inside a shrinking bracket. */
double ts_law_inverse(const ts_law *law, int stretch, double f, double guess)
{
    const ts_stretch *s = law->s + stretch;
    double a = s->p.lo, b = s->p.hi, way = s->way, slope;
    if (way * (f - s->force[0]) <= 0.0) return a; /* extrema are met exactly */
    if (f == s->force[1] || way * (f - s->force[1]) >= 0.0) return b;
    if (!(b < INFINITY)) {
        double w = 1.0 / s->p.scale;
        if (s->p.kind == TS_ROWS) w = 1e-3;
        for (b = a + w; way * (ts_law_force(law, stretch, b, &slope) - f) < 0.0; w *= 2.0) b = a + 2.0 * w;
    }
    double u = guess > a && guess < b ? guess : 0.5 * (a + b);
    for (int n = 0; n < 200; n++) {
        double r = way * (ts_law_force(law, stretch, u, &slope) - f);
        if (r == 0.0) return u;
        if (r > 0.0) b = u; else a = u;
        double next = u - r / (way * slope);
        if (!(next > a && next < b)) next = 0.5 * (a + b);
        if (fabs(next - u) <= 4e-16 * fabs(u)) return next;
        u = next;
    }
    return u;
}

/* --- sums ---------------------------------------------------------------------------------------------------------- */

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
    sum_of(s, lo + SAME * width, &before);
    for (int i = 1; i <= SAMPLES; i++, before = slope) {
        double a = lo + width * fmax((i - 1.0) / SAMPLES, SAME), b = lo + width * fmin((double)i / SAMPLES, 1.0 - SAME);
        sum_of(s, b, &slope);
        if (!(before * slope < 0.0)) continue;
        for (double m = 0.5 * (a + b); m > a && m < b; m = 0.5 * (a + b)) {
            sum_of(s, m, &d);
            if (d * before > 0.0) a = m; else b = m;
        }
        turns[n++] = b - lo;
    }
    return drop_ends(turns, n, width);
}

/* Append the sum on [lo, hi], which no polynomial gives: fitted, cut at its extrema. */
static void append_sum(ts_law *law, sum *s, double lo, double hi, int snapped, double size)
{
    double turns[SAMPLES + 1], from = lo, slope;
    int n = turns_of(s, lo, hi, turns);
    for (int i = 0; i <= n && !law->reason; i++) {
        double to = i < n ? lo + turns[i] : hi, start = law->n ? law->s[law->n - 1].force[1] : 0.0, end = sum_of(s, to, &slope);
        ts_piece p = ts_piece_of(TS_GRADED, from, to, snapped);
        law->reason = ts_fit_piece(&p, &law->table, &law->rows, sum_force, s, TS_FIT_ERROR * size);
        append(law, MAKE(ts_stretch){p, {start, end}, sign(end - start), 0});
        from = to;
    }
}

/* Append the sum from lo on, monotone and without end. */
static void append_open_sum(ts_law *law, sum *s, double lo, int snapped, double size)
{
    double slope, force = law->n ? law->s[law->n - 1].force[1] : 0.0, beyond;
    sum_of(s, lo, &slope);
    ts_piece p = ts_piece_of(TS_OPEN, lo, INFINITY, snapped);
    sum_of(s, 2.0 * lo + 1e-3, &beyond);
    if (slope * beyond < 0.0) law->reason = "parts in parallel have an extremum where one of them is a series without end";
    else law->reason = ts_fit_open(&p, &law->table, &law->rows, sum_force, s, fmax(lo, 1e-3), size);
    append(law, MAKE(ts_stretch){p, {force, beyond * INFINITY}, sign(beyond), 0});
}

/* Is the law one polynomial on each of the stretches? */
static int exact(const sum *s)
{
    for (int j = 0; j < s->n; j++)
        if (s->part[j].s[s->at[j]].p.rows != 1 || s->part[j].s[s->at[j]].p.kind != TS_ROWS) return 0;
    return 1;
}

static void append_exact_sum(ts_law *law, const sum *s, double lo, double hi, int snapped, int smooth)
{
    double total[TS_DEGREE + 1] = {0.0};
    for (int j = 0; j < s->n; j++) {
        const ts_piece *p = &s->part[j].s[s->at[j]].p;
        double c[TS_DEGREE + 1], here[TS_DEGREE + 1], power = 1.0;
        for (int k = 0; k <= TS_DEGREE; k++, power *= p->scale) c[k] = s->part[j].table[TS_ROW * p->first + 1 + k] * power;
        shift(c, lo - p->lo, here);
        for (int k = 0; k <= TS_DEGREE; k++) total[k] += here[k];
    }
    append_cut(law, lo, hi, total, law->n ? law->s[law->n - 1].force[1] : 0.0, snapped, smooth);
}

/* Parts in parallel: on the united stretches, up to the first stop. */
static void add_parallel(ts_law *law, const ts_law *part, int n)
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
            hi = fmin(hi, part[j].s[at[j]].p.hi);
            snapped += part[j].s[at[j]].p.snapped;
        }
        if (exact(&s)) append_exact_sum(law, &s, lo, hi, snapped, smooth);
        else if (hi < INFINITY) append_sum(law, &s, lo, hi, snapped, size);
        else append_open_sum(law, &s, lo, snapped, size);
        if (!(hi < INFINITY)) break;
        for (int j = 0; j < n; j++) {
            if (part[j].s[at[j]].p.hi > hi) continue;
            if (++at[j] == part[j].n) over = 1;
            else joins = joins && part[j].s[at[j]].smooth;
        }
        if (over) break;
        lo = hi;
        smooth = joins;
    }
    free(at);
}

/* --- programs ------------------------------------------------------------------------------------------------------ */

typedef struct {
    const int32_t *ints, *ints_end;
    const double *values, *values_end;
} program;

static int next_int(program *p, int least, int most)
{
    if (p->ints >= p->ints_end || *p->ints < least || *p->ints > most) return -1;
    return *p->ints++;
}

/* The next `count` numbers; NULL where there are none, or not finite ones. */
static const double *next_values(program *p, int count)
{
    if (p->values_end - p->values < count) return NULL;
    for (int i = 0; i < count; i++)
        if (!isfinite(p->values[i])) return NULL;
    p->values += count;
    return p->values - count;
}

static void compile(ts_law *law, program *p, int depth);

static void free_parts(ts_law *part, int n)
{
    for (int j = 0; part && j < n; j++) ts_law_free(part + j);
    free(part);
}

/* The n parts of a sum, each compiled; NULL with a reason. */
static ts_law *read_parts(program *p, int n, int depth, const char **reason)
{
    ts_law *part = n > 0 ? (ts_law *)calloc((size_t)n, sizeof *part) : NULL;
    if (!part) *reason = n > 0 ? "out of memory" : "a force law is damaged";
    for (int j = 0; j < n && !*reason; j++) {
        compile(part + j, p, depth + 1);
        *reason = part[j].reason;
    }
    if (!*reason) return part;
    free_parts(part, n);
    return NULL;
}

static void compile_parts(ts_law *law, program *p, int kind, int depth)
{
    int n = next_int(p, 1, 100000), memory = kind == TS_ELEMENT_SERIES ? next_int(p, 0, 1) : 0;
    if (memory) {
        law->reason = memory < 0 ? "a force law is damaged" : "a hysteretic series is not the outermost element of its string";
        return;
    }
    ts_law *part = read_parts(p, n, depth, &law->reason);
    if (!part) return;
    if (kind == TS_ELEMENT_PARALLEL) add_parallel(law, part, n);
    else ts_series(law, part, n);
    free_parts(part, n);
}

/* A polynomial or table counts as snapped from its first falling stretch on. */
static void count_snaps(ts_law *law)
{
    for (int i = 0, falls = 0; i < law->n; i++) law->s[i].p.snapped = falls |= law->s[i].way < 0;
}

static int all_positive(const double *v, int n)
{
    for (int i = 0; i < n; i++)
        if (!(v[i] > 0.0)) return 0;
    return 1;
}

static void compile(ts_law *law, program *p, int depth)
{
    int kind = depth < 64 ? next_int(p, 0, TS_ELEMENTS - 1) : -1, count, cubic;
    const double *v = NULL;
    switch (kind) {
    case TS_ELEMENT_SPRING:
        if ((v = next_values(p, 1)) && all_positive(v, 1)) compile_polynomial(law, v, 1);
        else law->reason = "a spring's stiffness is not positive";
        break;
    case TS_ELEMENT_BEAM:
        if ((v = next_values(p, 3)) && all_positive(v, 3)) ts_law_beam(law, v[0], v[1], v[2]);
        else law->reason = "a beam's parameter is not positive";
        break;
    case TS_ELEMENT_POLYNOMIAL:
        count = next_int(p, 1, TS_DEGREE);
        if (count > 0 && (v = next_values(p, count))) compile_polynomial(law, v, count);
        break;
    case TS_ELEMENT_TABLE:
        count = next_int(p, 2, 1000000);
        cubic = next_int(p, 0, 1);
        if (count > 0 && cubic >= 0 && (v = next_values(p, 2 * count))) compile_table(law, v, v + count, count, cubic);
        break;
    case TS_ELEMENT_PARALLEL:
    case TS_ELEMENT_SERIES:
        compile_parts(law, p, kind, depth);
        v = p->values;
        break;
    }
    if (!v && !law->reason) law->reason = "a force law is damaged";
    if (kind == TS_ELEMENT_POLYNOMIAL || kind == TS_ELEMENT_TABLE) count_snaps(law);
    double energy = 0.0;
    for (int i = 0; i < law->n && !law->reason; i++) {
        const ts_piece *piece = &law->s[i].p;
        ts_piece_integrate(piece, law->table, energy);
        if (i + 1 < law->n) energy = ts_piece_energy(piece, law->table, INFINITY, piece->hi, 0.0);
    }
}

static program program_at(const ts_model *m, int32_t first_int, int32_t first_double)
{
    return MAKE(program){m->program + first_int, m->program + m->program_ints, m->program_values + first_double,
                     m->program_values + m->program_doubles};
}

/* The law at a place of the programs; law->reason says what is wrong. */
void ts_law_compile(ts_law *law, const ts_model *m, int32_t first_int, int32_t first_double)
{
    program p = program_at(m, first_int, first_double);
    compile(law, &p, 0);
}

/* Is the law there a series with memory? */
int ts_law_has_memory(const ts_model *m, int32_t first_int)
{
    if (first_int < 0 || first_int + 2 >= m->program_ints) return 0;
    return m->program[first_int] == TS_ELEMENT_SERIES && m->program[first_int + 2] == 1;
}

/* Its parts; a reason why not, or NULL. */
const char *ts_law_parts(ts_law **part, int *n, const ts_model *m, int32_t first_int, int32_t first_double)
{
    program p = program_at(m, first_int, first_double);
    const char *reason = NULL;
    next_int(&p, 0, TS_ELEMENTS - 1);
    *n = next_int(&p, 1, 100000);
    next_int(&p, 0, 1);
    *part = read_parts(&p, *n, 0, &reason);
    return reason;
}

/* --- curves -------------------------------------------------------------------------------------------------------- */

/* Put a piece's only polynomial on the subinterval that the piece covers. */
static void rescale(ts_piece *p, double *table)
{
    double ratio = p->scale * (p->hi - p->lo), power = 1.0;
    if (p->kind != TS_ROWS || p->rows != 1 || !(p->hi < INFINITY)) return;
    for (int k = 0; k <= TS_DEGREE; k++, power *= ratio) table[TS_ROW * p->first + 1 + k] *= power;
    p->scale = 1.0 / (p->hi - p->lo);
}

/* The curve of a law: stretches that go on with the same polynomial make one piece.  A reason why not, or NULL. */
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
        const ts_stretch *s = law->s + i;
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
