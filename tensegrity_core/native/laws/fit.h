/* Rows of polynomials for laws that only an equation defines. */
#ifndef TENSEGRITY_FIT_H
#define TENSEGRITY_FIT_H

#include "model/force_curve.h"

#include <stdint.h>

#define TS_FIT_ERROR 2e-13 /* of the largest force */
#define TS_MAX_ROWS 1024   /* subintervals of one piece */

double ts_fit_row(double (*force)(void *, double), void *law, double a, double w, double *row);
const char *ts_fit_line(ts_piece *p, double **table, int32_t *rows, double force, double k);
const char *ts_fit_open(ts_piece *p, double **table, int32_t *rows, double (*force)(void *, double), void *at, double w,
                        double size);
const char *ts_fit_piece(ts_piece *p, double **table, int32_t *rows, double (*force)(void *, double), void *at, double error);

#endif
