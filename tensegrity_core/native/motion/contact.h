/* Contact of nodes with the ground: forces, powers, energy, Jacobian, margins of its transitions. */
#ifndef TENSEGRITY_CONTACT_H
#define TENSEGRITY_CONTACT_H

#include "model/data.h"
#include "model/model.h"
#include "tensegrity.h"

/* m, length of the vectors that hold directions of slip: as errors of places, those of a deflection of this length count. */
#define TS_DIRECTION 1e-2

double ts_contact_parameter(const ts_sim *sim, int field, int contact);
int ts_ground_pulls(const ts_model *m);
int ts_has_friction(const ts_sim *sim, int contact);
double ts_reach_per_force(const ts_sim *sim, int contact);
ts_touch ts_touch_at(const ts_sim *sim, double tau, int contact, const double *y);
void ts_press(ts_sim *sim, double tau, const double *y, double *force);
void ts_friction(const ts_sim *sim, int contact, const ts_touch *touch, double *force);
void ts_contact_rates(const ts_sim *sim, double *p);
void ts_slip_rates(ts_sim *sim, double tau, double *a);
double ts_slip_rate(const ts_sim *sim, int contact, const ts_touch *touch, const double *direction, double bend);
double ts_tangential_acceleration(const ts_sim *sim, int contact, const double *a);
double ts_penetration_bend(const ts_sim *sim, double tau, int contact, const double *a);
void ts_touch_margins(const ts_sim *sim, int contact, const ts_touch *touch, double bend, double margin[TS_WATCHES]);
double ts_contact_energy(const ts_sim *sim, double tau, int slipping_only);
void ts_contact_jacobian(ts_sim *sim, double tau, int exact);
void ts_project_directions(const ts_model *m, double *y);
void ts_contact_outputs(ts_sim *sim, int groups);

#endif
