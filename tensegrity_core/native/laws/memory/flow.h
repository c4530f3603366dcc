/* The flow of a snap. */
#ifndef TENSEGRITY_FLOW_H
#define TENSEGRITY_FLOW_H

#include "laws/memory/graph.h"

void ts_flow(ts_graph *g, double x, int way);

#endif
