/* Steps that somebody watches. */
#ifndef TENSEGRITY_WATCHED_H
#define TENSEGRITY_WATCHED_H

#include "tensegrity.h"

int ts_look_derivatives(ts_sim *sim, double *out);

#endif
