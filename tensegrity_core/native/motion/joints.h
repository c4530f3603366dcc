/* The motion of joined bars: accelerations and multipliers, constraints put right, impulses, energy, reactions, Jacobian. */
#ifndef TENSEGRITY_MOTION_JOINTS_H
#define TENSEGRITY_MOTION_JOINTS_H

#include "tensegrity.h"

void ts_weigh_joints(ts_sim *sim);
void ts_join(ts_sim *sim, double tau, const double *y, double *a);
void ts_put_back(ts_sim *sim, double tau, double *y);
int ts_joints_lock(ts_sim *sim);
double ts_joint_drift(ts_sim *sim, const double *y, double ahead);
void ts_jump_joints(ts_sim *sim, const double *before);
double ts_joint_energy(const ts_sim *sim, const double *v);
double ts_joint_weight(const ts_sim *sim, int d);
double ts_pull_on_joint(const ts_sim *sim, int e, int d);
void ts_joint_outputs(ts_sim *sim);
void ts_joint_jacobian(ts_sim *sim, double tau, const double *y, int exact);
void ts_eliminate_multipliers(ts_sim *sim, double *Jq, double *Jv);

#endif
