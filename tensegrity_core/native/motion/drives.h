/* What moves a structure, loads it or slows it down beside strings, gravity and external forces. */
#ifndef TENSEGRITY_DRIVES_H
#define TENSEGRITY_DRIVES_H

#include "model/data.h"
#include "model/model.h"
#include "tensegrity.h"

void ts_drive(ts_sim *sim);
void ts_weigh(ts_sim *sim);
void ts_jump_bases(ts_sim *sim, const double *values, const double *slopes, double tau);
void ts_wind(const ts_model *m, const double *y, ts_rest *rest);
double ts_wound(const ts_model *m, const double *y, int string);
void ts_drag(ts_sim *sim, double *force);
void ts_carry(const ts_model *m, const ts_inertia *inertia, const ts_bases *bases, double *Q);
void ts_motors(const ts_sim *sim, double tau, const double *v, double *Q);
void ts_drive_rates(const ts_sim *sim, double tau, const double *v, const double *a, double *p);
void ts_drive_jacobian(ts_sim *sim, double tau);
int ts_inputs_move(const ts_model *m, const ts_io *io);
int ts_wound_up(const ts_sim *sim);

#endif
