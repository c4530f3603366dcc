/* A string's force curve as data: pieces in the elongation and their tables; laws/curve.c evaluates them. */
#ifndef TENSEGRITY_FORCE_CURVE_H
#define TENSEGRITY_FORCE_CURVE_H

#include <stdint.h>

#define TS_DEGREE 7            /* of the polynomials of force curves */
#define TS_ROW (TS_DEGREE + 2) /* energy at the left end, then the coefficients of the force */
#define TS_OCTAVES 16          /* of an open piece */

/* Kinds of pieces. */
enum {
    TS_SLACK,      /* no force; the energy is constant */
    TS_STRAIGHT,   /* force + k (x - lo), k the string's stiffness */
    TS_ROWS,       /* polynomials on equal subintervals of x */
    TS_GRADED,     /* on subintervals that halve towards both ends: `each` of them in every octave of the distance */
    TS_OPEN,       /* to infinity, on subintervals that double: `each` in every one of TS_OCTAVES octaves */
    TS_FOLD_ABOVE, /* a fold at hi: polynomials on equal subintervals of s = sqrt(hi - x) */
    TS_FOLD_BELOW, /* a fold at lo, s = sqrt(x - lo) */
};

typedef struct {
    int32_t kind, rows, first; /* rows of the table, and the first of them */
    int32_t up, down;          /* pieces that follow where hi and lo are passed, or -1 */
    int32_t snapped;           /* beams past their force maximum */
    int32_t each, octaves[2];  /* rows of an octave, octaves from the lower and from the upper end */
    double lo, hi;             /* m, ends */
    double origin, scale;      /* m, 1/m: where the first row begins, and rows per length (of folds: of s); of a graded
                                * piece the inverse of its length, of an open one that of its first octave's */
    double force, energy;      /* N, J: at lo of a straight piece; the energy of a slack one */
    double loss_up, loss_down; /* J, what a snap there dissipates */
} ts_piece;

typedef struct {
    int32_t pieces;   /* the first is slack */
    int32_t branches; /* 1: there may be several pieces at one elongation, the string has memory */
    ts_piece *piece;  /* (pieces) */
    double *table;    /* rows of TS_ROW: J, then N */
    double reach;     /* rows past a piece's ends where its formula becomes a straight line */
} ts_curve;

#endif
