/* Who watches a step is told where it has come to. */
#ifndef TENSEGRITY_WATCH_H
#define TENSEGRITY_WATCH_H

#include "model/data.h"

double ts_time_at(const ts_memory *memory, double tau);
int ts_ends_here(ts_sim *sim, double tau);

#endif
