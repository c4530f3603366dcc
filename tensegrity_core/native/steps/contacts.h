/* Transitions of contacts with the ground. */
#ifndef TENSEGRITY_CONTACTS_H
#define TENSEGRITY_CONTACTS_H

#include "model/data.h"
#include "tensegrity.h"

void ts_place_contacts(ts_sim *sim);
void ts_contacts_begin(ts_sim *sim, double tau, double h, int explicit_fixed);
int ts_contact_is_suspect(const ts_sim *sim, int contact, int watch, int *crossed);
double ts_contact_excess(const ts_sim *sim, double tau, int contact, int watch, const double *y, const double *f, double *rate);
int ts_contact_needs_derivative(const ts_sim *sim, int contact, int watch);
void ts_switch_contacts(ts_sim *sim, double tau, int which);
void ts_catch_up_contacts(ts_sim *sim, double tau);

#endif
