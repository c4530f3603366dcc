/* The force curve of parts in series with memory. */
#ifndef TENSEGRITY_HYSTERESIS_H
#define TENSEGRITY_HYSTERESIS_H

#include "laws/law.h"
#include "model/force_curve.h"

const char *ts_hysteresis(ts_curve *c, const ts_law *part, int n, double stiffness);

#endif
