/* Parts in series: rises, and the single-valued law that strings them together. */
#ifndef TENSEGRITY_SERIES_H
#define TENSEGRITY_SERIES_H

#include "laws/law.h"

#include <stdint.h>

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

double ts_rise_elongation(ts_rise *r, double u, double *force, double *slope);
double ts_rise_force(void *rise, double x);
double ts_rise_off_fold(void *rise, double s);
double ts_rise_straight(const ts_rise *r);
const char *ts_series(ts_law *law, const ts_law *part, int n);

#endif
