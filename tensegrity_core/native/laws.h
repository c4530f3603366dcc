/* Force laws while they are compiled into curves: never while stepping. */
#ifndef TENSEGRITY_LAWS_H
#define TENSEGRITY_LAWS_H

#include "internal.h"

#include <float.h>

#define TS_FIT_ERROR 2e-13 /* of the largest force */
#define TS_MAX_ROWS 1024   /* subintervals of one piece */
#define TS_TIE (32.0 * DBL_EPSILON) /* forces that differ by no more than this part of them are one: round-off is less */

/* A monotone stretch of a law's force as a function of its elongation. */
typedef struct {
    ts_piece p;      /* TS_ROWS or TS_OPEN */
    double force[2]; /* N, at its ends; of one without end what the force tends to */
    int32_t way;     /* 1: the force rises, -1: it falls, 0: it stays */
    int32_t smooth;  /* it goes on with the very polynomial of the stretch before */
} ts_stretch;

/* An element's law from elongation 0 to its stop, or without end. */
typedef struct {
    ts_stretch *s;
    double *table;      /* rows of TS_ROW, see ts_curve */
    int32_t n, rows;
    const char *reason; /* why it cannot be compiled, or NULL */
} ts_law;

/* Parts in series, each on a stretch of its law or, where at[j] is their number, at its stop.  One part, the leader, moves
 * one way as the elongation grows, and all else follows from its own elongation. */
typedef struct {
    const ts_law *part;
    const int32_t *at;
    double *u;         /* (n) elongations as last found, m */
    double lo, hi;     /* the leader's range, m */
    double compliance; /* of a spring in series, m/N */
    int32_t fold;      /* 1: there is a fold at the leader's hi, -1: at its lo */
    int32_t n, leader;
} ts_rise;

void ts_law_beam(ts_law *law, double Q, double zeta, double h);
void ts_law_compile(ts_law *law, const ts_model *m, int32_t first_int, int32_t first_double);
void ts_law_free(ts_law *law);
double ts_law_stop(const ts_law *law);
double ts_law_largest(const ts_law *law);
int ts_law_at(const ts_law *law, double u);
double ts_law_force(const ts_law *law, int stretch, double u, double *slope);
double ts_law_energy(const ts_law *law, int stretch, double u);
double ts_law_inverse(const ts_law *law, int stretch, double f, double guess);
double ts_stretch_tie(const ts_stretch *s);
int ts_law_snapped(const ts_law *law, int stretch);
const char *ts_law_curve(ts_curve *c, const ts_law *law);

double ts_rise_elongation(ts_rise *r, double u, double *force, double *slope);
double ts_rise_force(void *rise, double x);
double ts_rise_off_fold(void *rise, double s);
double ts_rise_straight(const ts_rise *r);
const char *ts_fit_line(ts_piece *p, double **table, int32_t *rows, double force, double k);
const char *ts_fit_open(ts_piece *p, double **table, int32_t *rows, double (*force)(void *, double), void *at, double w,
                        double size);
const char *ts_series(ts_law *law, const ts_law *part, int n);
const char *ts_fit_piece(ts_piece *p, double **table, int32_t *rows, double (*force)(void *, double), void *at, double error);

int ts_law_has_memory(const ts_model *m, int32_t first_int);
const char *ts_law_parts(ts_law **part, int *n, const ts_model *m, int32_t first_int, int32_t first_double);
const char *ts_hysteresis(ts_curve *c, const ts_law *part, int n, double stiffness);

#endif
