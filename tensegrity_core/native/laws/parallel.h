/* Parts in parallel: forces add up. */
#ifndef TENSEGRITY_PARALLEL_H
#define TENSEGRITY_PARALLEL_H

#include "laws/law.h"

void ts_parallel(ts_law *law, const ts_law *part, int n);

#endif
