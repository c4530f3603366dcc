/* Force, stiffness and energy on the pieces of a force curve, and ways along its graph. */
#ifndef TENSEGRITY_CURVE_H
#define TENSEGRITY_CURVE_H

#include "model/force_curve.h"

#include <stdint.h>

ts_piece ts_piece_of(int kind, double lo, double hi, int snapped);
double ts_piece_force(const ts_piece *p, const double *table, double reach, double x, double k, double *stiffness);
double ts_piece_energy(const ts_piece *p, const double *table, double reach, double x, double k);
double ts_piece_integrate(const ts_piece *p, double *table, double energy);
double ts_row_width(const ts_piece *p, int row, double *begin);
double *ts_rows_behind(double **table, int32_t rows, int32_t more);
void ts_curve_chain(ts_curve *c);
const char *ts_curve_plain(ts_curve *c);
const char *ts_curve_two_way(ts_curve *c);
double ts_curve_force(const ts_curve *c, int piece, double x, double k, double *stiffness);
double ts_curve_energy(const ts_curve *c, int piece, double x, double k);
void ts_curve_free(ts_curve *c);
int ts_curve_piece(const ts_curve *c, double x);
int ts_curve_walk(const ts_curve *c, int piece, double x, double guard, double *loss);

#endif
