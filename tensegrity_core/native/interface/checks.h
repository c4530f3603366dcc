/* Are inputs, parameters and outputs acceptable?  A status; where it is not TS_OK the message says why. */
#ifndef TENSEGRITY_CHECKS_H
#define TENSEGRITY_CHECKS_H

#include "tensegrity.h"

int ts_check_change(ts_sim *sim, double h);
int ts_check_rates(ts_sim *sim, const double *out);
int ts_check_outputs(ts_sim *sim, int groups, const char *when);

#endif
