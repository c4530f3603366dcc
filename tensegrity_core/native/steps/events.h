/* Transitions: finding the first in a step, carrying it out, pieces after inputs jumped. */
#ifndef TENSEGRITY_EVENTS_H
#define TENSEGRITY_EVENTS_H

#include "methods/method.h"
#include "tensegrity.h"

double ts_place_all(ts_sim *sim);
double ts_first_transition(ts_sim *sim, const ts_method *method, double tau, double h, int *which, int *doubtful);
void ts_switch(ts_sim *sim, double tau, int which);
void ts_catch_up(ts_sim *sim, double tau);
void ts_margins(const ts_sim *sim, double tau, double guard, double *z);
int ts_leave_passed(ts_sim *sim, double guard);

#endif
