/* Outputs at the end of a step, their derivatives by time, energies. */
#ifndef TENSEGRITY_OUTPUTS_H
#define TENSEGRITY_OUTPUTS_H

#include "tensegrity.h"

void ts_outputs(ts_sim *sim, double tau, int groups);
void ts_tangent_outputs(ts_sim *sim, double tau, double *out);
double ts_stored_energy(const ts_sim *sim, double tau);
double ts_kinetic_energy(const ts_sim *sim);
double ts_buckling_load(const ts_sim *sim, int column);
double ts_clipped_energy(const ts_sim *sim, double tau);

#endif
