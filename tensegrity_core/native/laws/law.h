/* A force law while it is compiled into a curve, never while stepping: monotone pieces of polynomials. */
#ifndef TENSEGRITY_LAW_H
#define TENSEGRITY_LAW_H

#include "model/force_curve.h"

#include <float.h>
#include <stdint.h>

#define TS_TIE (32.0 * DBL_EPSILON) /* forces that differ by no more than this part of them are one: round-off is less */

/* A monotone piece of a law's force as a function of its elongation. */
typedef struct {
    ts_piece p;      /* TS_ROWS or TS_OPEN */
    double force[2]; /* N, at its ends; of one without end what the force tends to */
    int32_t way;     /* 1: the force rises, -1: it falls, 0: it stays */
    int32_t smooth;  /* it goes on with the very polynomial of the piece before */
} ts_law_piece;

/* An element's law from elongation 0 to its stop, or without end. */
typedef struct {
    ts_law_piece *piece;
    double *table; /* rows of TS_ROW, see ts_curve */
    int32_t n, rows;
    const char *reason; /* why it cannot be compiled, or NULL */
} ts_law;

void ts_law_free(ts_law *law);
void ts_laws_free(ts_law *part, int n);
void ts_law_append(ts_law *law, ts_law_piece piece);
void ts_law_append_polynomial(ts_law *law, double lo, double hi, const double *c, double end_force, int way, int snapped,
                              int smooth);
void ts_law_append_cut(ts_law *law, double lo, double hi, const double *c, double start, int snapped, int smooth);
double ts_law_stop(const ts_law *law);
double ts_law_largest(const ts_law *law);
int ts_law_at(const ts_law *law, double u);
double ts_law_force(const ts_law *law, int piece, double u, double *slope);
double ts_law_energy(const ts_law *law, int piece, double u);
double ts_law_inverse(const ts_law *law, int piece, double f, double guess);
double ts_law_tie(const ts_law_piece *s);
int ts_law_snapped(const ts_law *law, int piece);
const char *ts_law_curve(ts_curve *c, const ts_law *law);

#endif
