/* Equations of motion: right-hand side, forces and powers, a string's elongation, the constraint, norms of errors. */
#ifndef TENSEGRITY_MOTION_H
#define TENSEGRITY_MOTION_H

#include "model/data.h"
#include "model/model.h"
#include "tensegrity.h"

void ts_prepare(ts_sim *sim);
void ts_rhs(ts_sim *sim, double tau, const double *y, double *dy);
void ts_move_nodes(ts_sim *sim, double tau, const double *y);
void ts_forces(ts_sim *sim, double tau, const double *y, double *Q);
void ts_power(ts_sim *sim, double tau, const double *y, double p[TS_LEDGER]);
void ts_string_state(const ts_sim *sim, double tau, const double *y, int string, double *elongation, double *rate);
double ts_tension(const ts_sim *sim, int string, double elongation, double rate, double *elastic);
double ts_rest_length(const ts_rest *rest, int string, double tau);
double ts_rest_rate(const ts_rest *rest, int string, double tau);
int ts_sloped(const ts_model *m, const ts_io *io);
int ts_all_finite(const double *x, int n);
double ts_size(const double *x, int n);
void ts_project(const ts_model *m, double *y);
void ts_project_block(const ts_model *m, double *y, int block);
void ts_error_norms(const ts_sim *sim, const double *e, const double *e2, const double *y0, const double *y1, double *n,
                    double *n2);
double ts_error_norm(const ts_sim *sim, const double *e, const double *y0, const double *y1);

#endif
