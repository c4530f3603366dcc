/* Rows of polynomials for laws that only an equation defines: through Chebyshev points of the exact force, as many and as
 * far apart as the wanted error allows.
 *
 * The force of a series is smooth within a piece, but often nearly singular just beyond its ends, where the next part comes
 * to a maximum: there rows get shorter, by halves. */
#include "laws/fit.h"
#include "laws/curve.h"
#include "laws/polynomial.h"

#include <math.h>
#include <string.h>

#define MOST_OCTAVES 40
#define MOST_EACH 64
#define MOST_EVEN 256 /* equal rows of a piece: more are slow to fit, and seldom in the processor's cache */

/* Coefficients in t = 0..1 of the polynomial through the Chebyshev points of [a, a + w] (Newton's divided differences). */
static void fit_row(double (*force)(void *, double), void *law, double a, double w, double *coef)
{
    static const double t[TS_DEGREE + 1] = {/* (1 - cos((2 i + 1) pi/16))/2; written out: libraries differ in cos */
                                            0.009607359798384785, 0.08426519384872738, 0.22221488349019886, 0.40245483899193585,
                                            0.5975451610080641,   0.777785116509801,   0.9157348061512727,  0.9903926402016152};
    double d[TS_DEGREE + 1];
    for (int i = 0; i <= TS_DEGREE; i++) d[i] = force(law, a + w * t[i]);
    for (int k = 1; k <= TS_DEGREE; k++)
        for (int i = TS_DEGREE; i >= k; i--) d[i] = (d[i] - d[i - 1]) / (t[i] - t[i - k]);
    for (int i = 0; i <= TS_DEGREE; i++) coef[i] = 0.0;
    for (int k = TS_DEGREE; k >= 0; k--) { /* Horner on the Newton form */
        for (int i = TS_DEGREE; i >= 1; i--) coef[i] = coef[i - 1] - t[k] * coef[i];
        coef[0] = d[k] - t[k] * coef[0];
    }
}

/* Fit one row over [a, a + w]; its largest error at the ends and between, N. */
double ts_fit_row(double (*force)(void *, double), void *law, double a, double w, double *row)
{
    double worst = 0.0;
    fit_row(force, law, a, w, row + 1);
    for (int k = 0; k <= 4; k++) {
        double t = 0.25 * k, error = fabs(ts_polynomial(row + 1, t) - force(law, a + t * w));
        if (error > worst) worst = error;
    }
    return worst;
}

/* A straight piece that begins with `force`; of one without end the subinterval is a power of two, which changes no digits. */
const char *ts_fit_line(ts_piece *p, double **table, int32_t *rows, double force, double k)
{
    double *row = ts_rows_behind(table, *rows, 1), w = p->hi < INFINITY ? p->hi - p->lo : 1024.0;
    if (!row) return "out of memory";
    memset(row, 0, sizeof(double) * TS_ROW);
    row[1] = force;
    row[2] = k * w;
    p->kind = TS_ROWS;
    p->rows = 1;
    p->first = (*rows)++;
    p->origin = p->lo;
    p->scale = 1.0 / w;
    return NULL;
}

/* As many equal rows in s as a piece with a fold takes. */
static const char *fit_fold(ts_piece *p, double **table, int32_t *rows, double (*force)(void *, double), void *at, double error)
{
    double last = INFINITY, range = sqrt(p->hi - p->lo);
    for (p->rows = 1;; p->rows *= 2) {
        double worst = 0.0, w = range / p->rows;
        double *row = ts_rows_behind(table, *rows, p->rows);
        if (!row) return "out of memory";
        for (int i = 0; i < p->rows; i++) worst = fmax(worst, ts_fit_row(force, at, i * w, w, row + TS_ROW * i));
        int no_more_digits = worst <= 50.0 * error && worst > 0.25 * last;
        if (worst <= error || p->rows >= TS_MAX_ROWS || no_more_digits) {
            p->first = *rows;
            p->scale = p->rows / range;
            *rows += p->rows;
            return NULL;
        }
        last = worst;
    }
}

/* How many octaves from one end of a graded piece it takes with `each` rows in an octave; 0: more rows are needed. */
static int octaves(ts_piece *p, int upper, double (*force)(void *, double), void *at, double error)
{
    double row[TS_ROW], begin;
    for (int count = 1; count <= MOST_OCTAVES; count++) {
        int fits = 1;
        p->octaves[upper] = count + 1;
        for (int i = 0; i < p->each && count > 1 && fits; i++) { /* the last but one is complete now */
            int octave = upper ? p->octaves[0] + count - 2 : 2;
            double w = ts_row_width(p, octave * p->each + i, &begin);
            fits = ts_fit_row(force, at, begin, w, row) <= error;
        }
        if (!fits) return 0;
        p->octaves[upper] = count;
        for (int i = 0; i < p->each && fits; i++) {
            double w = ts_row_width(p, (upper ? p->octaves[0] + count - 1 : 0) * p->each + i, &begin);
            fits = ts_fit_row(force, at, begin, w, row) <= error;
        }
        if (fits) return count;
    }
    return MOST_OCTAVES;
}

static const char *fit_graded(ts_piece *p, double **table, int32_t *rows, double (*force)(void *, double), void *at,
                              double error)
{
    double begin;
    p->origin = p->lo;
    p->scale = 1.0 / (p->hi - p->lo);
    for (p->each = 1; p->each <= MOST_EACH; p->each *= 2) {
        p->octaves[0] = octaves(p, 0, force, at, error);
        if (!p->octaves[0]) continue;
        p->octaves[1] = octaves(p, 1, force, at, error);
        if (p->octaves[1]) break;
    }
    if (p->each > MOST_EACH) p->each = MOST_EACH, p->octaves[0] = p->octaves[1] = 20; /* as good as it gets */
    p->rows = p->each * (p->octaves[0] + p->octaves[1]);
    double *row = ts_rows_behind(table, *rows, p->rows);
    if (!row) return "out of memory";
    p->first = *rows;
    *rows += p->rows;
    for (int i = 0; i < p->rows; i++) {
        double w = ts_row_width(p, i, &begin);
        ts_fit_row(force, at, begin, w, row + TS_ROW * i);
    }
    return NULL;
}

/* Equal rows, which are quickest to look up, if a piece takes no more than MOST_EVEN of them; else it stays graded.  The shortest
 * rows are needed at its ends, so these come first: one that does not do is found soon. */
static const char *fit_even(ts_piece *p, double **table, int32_t *rows, double (*force)(void *, double), void *at, double error)
{
    for (p->rows = 1; p->rows <= MOST_EVEN; p->rows *= 2) {
        double w = (p->hi - p->lo) / p->rows;
        double *row = ts_rows_behind(table, *rows, p->rows);
        int done = 0;
        if (!row) return "out of memory";
        for (; done < p->rows; done++) {
            int i = done == 0 ? p->rows - 1 : done - 1;
            if (ts_fit_row(force, at, p->lo + i * w, w, row + TS_ROW * i) > error) break;
        }
        if (done < p->rows) continue;
        p->kind = TS_ROWS;
        p->first = *rows;
        p->origin = p->lo;
        p->scale = p->rows / (p->hi - p->lo);
        *rows += p->rows;
        break;
    }
    return NULL;
}

/* Fit rows to a piece whose kind, graded or with a fold, and ends are set. */
const char *ts_fit_piece(ts_piece *p, double **table, int32_t *rows, double (*force)(void *, double), void *at, double error)
{
    if (p->kind == TS_GRADED) {
        const char *reason = fit_even(p, table, rows, force, at, error);
        if (reason || p->kind == TS_ROWS) return reason;
    }
    return (p->kind == TS_GRADED ? fit_graded : fit_fold)(p, table, rows, force, at, error);
}

/* Rows of a piece without end: octaves of 1 + (x - lo)/w, fitted relative to the force in each row or `size`, N. */
const char *ts_fit_open(ts_piece *p, double **table, int32_t *rows, double (*force)(void *, double), void *at, double w,
                        double size)
{
    p->kind = TS_OPEN;
    p->origin = p->lo;
    p->first = *rows;
    p->scale = 1.0 / w;
    for (p->each = 1;; p->each *= 2) {
        double worst = 0.0, begin;
        p->rows = p->each * TS_OCTAVES;
        double *row = ts_rows_behind(table, *rows, p->rows);
        if (!row) return "out of memory";
        for (int i = 0; i < p->rows; i++, row += TS_ROW) {
            double width = ts_row_width(p, i, &begin);
            double error = ts_fit_row(force, at, begin, width, row);
            worst = fmax(worst, error / fmax(size, ts_polynomial(row + 1, 1.0)));
        }
        if (worst > TS_FIT_ERROR && p->rows < TS_MAX_ROWS) continue;
        *rows += p->rows;
        return NULL;
    }
}
