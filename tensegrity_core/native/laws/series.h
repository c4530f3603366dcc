/* The single-valued law of parts in series. */
#ifndef TENSEGRITY_SERIES_H
#define TENSEGRITY_SERIES_H

#include "laws/law.h"

const char *ts_series(ts_law *law, const ts_law *part, int n);

#endif
