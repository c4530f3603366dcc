/* Branches of the states of a law with memory. */
#ifndef TENSEGRITY_BRANCHES_H
#define TENSEGRITY_BRANCHES_H

#include "laws/memory/graph.h"
#include "laws/rise.h"

#include <stdint.h>

ts_rise ts_branch_rise(ts_graph *g, const ts_branch *b);
void ts_branch_end(ts_graph *g, ts_branch *b, int side);
ts_branch ts_branch_of(int32_t state, int32_t kind); /* all else 0 */
int ts_branch_add(ts_graph *g, ts_branch b);
int32_t ts_branch_find(ts_graph *g, const int32_t *at, double x, const double *u, int way);
double ts_parts_total(const ts_graph *g, const double *u);
double ts_parts_energy(const ts_graph *g, double x, const double *u);

#endif
