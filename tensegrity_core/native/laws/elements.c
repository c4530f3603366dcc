/* Force laws of elements, read from their programs (kernel/packing.py). */
#include "laws/elements.h"
#include "laws/curve.h"
#include "laws/parallel.h"
#include "laws/polynomial.h"
#include "laws/series.h"
#include "linear/pairs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* eq. 11, about x = u/h: three cubics that meet at the extrema x = 1 -+ s, or one where there are none. */
void ts_law_beam(ts_law *law, double Q, double zeta, double h)
{
    double s = zeta > 2.0 ? sqrt((zeta - 2.0) / (3.0 * zeta)) : 0.0, x[4] = {0.0, 1.0 - s, 1.0 + s, 2.0}, f[4];
    for (int i = 0; i < 4; i++) f[i] = Q * x[i] * (zeta * (x[i] * (x[i] - 3.0) + 2.0) + 2.0);
    for (int i = 0; i < 3; i++) {
        double slope = i == 0 ? 2.0 * Q * (1.0 + zeta) : 0.0, to = s > 0.0 ? h * x[i + 1] : 2.0 * h;
        double c[TS_DEGREE + 1] = {f[i], slope / h, 3.0 * Q * zeta * (x[i] - 1.0) / (h * h), Q * zeta / (h * h * h)};
        ts_law_append_polynomial(law, h * x[i], to, c, s > 0.0 ? f[i + 1] : f[3], i == 1 ? -1 : 1, i > 0, i > 0);
        if (s == 0.0) return;
    }
}

static void compile_polynomial(ts_law *law, const double *coefficients, int count)
{
    double c[TS_DEGREE + 1] = {0.0};
    memcpy(c + 1, coefficients, sizeof(double) * (size_t)count);
    ts_law_append_cut(law, 0.0, INFINITY, c, 0.0, 0, 0);
}

/* Slope at an end (Moler's formula as in SciPy's PchipInterpolator). */
static double end_slope(double h0, double h1, double m0, double m1)
{
    double d = ((2.0 * h0 + h1) * m0 - h0 * m1) / (h0 + h1);
    if (ts_sign(d) != ts_sign(m0)) return 0.0;
    return ts_sign(m0) != ts_sign(m1) && fabs(d) > 3.0 * fabs(m0) ? 3.0 * m0 : d;
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
    if (ts_sign(m0) != ts_sign(m1) || m0 == 0.0 || m1 == 0.0) return 0.0;
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
            ts_law_append_polynomial(law, x[i], INFINITY, c, ts_limit(c), ts_sign(m), 0, 0);
            return;
        }
        ts_law_append_polynomial(law, x[i], x[i + 1], c, f[i + 1], ts_sign(m), 0, 0);
    }
    double c[TS_DEGREE + 1] = {f[n - 1], slope};
    ts_law_append_polynomial(law, x[n - 1], INFINITY, c, ts_limit(c), ts_sign(slope), 0, 0);
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
    ts_laws_free(part, n);
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
    if (kind == TS_ELEMENT_PARALLEL) ts_parallel(law, part, n);
    else ts_series(law, part, n);
    ts_laws_free(part, n);
}

/* A polynomial or table counts as snapped from its first falling piece on. */
static void count_snaps(ts_law *law)
{
    for (int i = 0, falls = 0; i < law->n; i++) law->piece[i].p.snapped = falls |= law->piece[i].way < 0;
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
        const ts_piece *piece = &law->piece[i].p;
        ts_piece_integrate(piece, law->table, energy);
        if (i + 1 < law->n) energy = ts_piece_energy(piece, law->table, INFINITY, piece->hi, 0.0);
    }
}

static program program_at(const ts_model *m, int32_t first_int, int32_t first_double)
{
    return MAKE(program){m->packed.program + first_int, m->packed.program + m->packed.program_ints,
                         m->packed.program_values + first_double, m->packed.program_values + m->packed.program_doubles};
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
    if (first_int < 0 || first_int + 2 >= m->packed.program_ints) return 0;
    return m->packed.program[first_int] == TS_ELEMENT_SERIES && m->packed.program[first_int + 2] == 1;
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
