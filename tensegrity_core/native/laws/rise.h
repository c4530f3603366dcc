/* A rise: parts in series, each on a monotone piece of its law or at its stop. */
#ifndef TENSEGRITY_RISE_H
#define TENSEGRITY_RISE_H

#include "laws/law.h"

#include <stdint.h>

/* Equal parts on the same piece, which move alike. */
typedef struct {
    const ts_law *part;
    int32_t first, count, piece; /* the first of them; how many there are */
    int32_t degree;              /* of the only polynomial on the piece; -1: there are several */
    double force, slope;         /* N, N/m, as last found */
} ts_mover;

/* Parts in series, each on a piece of its law or, where at[j] is their number, at its stop.  One part, the leader, moves
 * one way as the elongation grows, and all else follows from its own elongation. */
typedef struct {
    const ts_law *part;
    const int32_t *at;
    double *u;         /* (n) elongations as last found, m */
    ts_mover *mover;   /* (n) room for those of ts_rise_gather() */
    double lo, hi;     /* the leader's range, m */
    double compliance; /* of a spring in series, m/N */
    double stopped;    /* elongation of the parts at their stops, m; as gathered */
    int32_t fold;      /* 1: there is a fold at the leader's hi, -1: at its lo */
    int32_t n, leader;
    int32_t movers; /* the leader's comes first; 0: they are not gathered */
} ts_rise;

ts_rise ts_rise_of(const ts_law *part, int n, const int32_t *at, int leader, double *u);
void ts_rise_gather(ts_rise *r);
double ts_rise_elongation(ts_rise *r, double u, double *force, double *slope);
double ts_rise_force(void *rise, double x);
double ts_rise_off_fold(void *rise, double s);
double ts_rise_straight(const ts_rise *r);

#endif
