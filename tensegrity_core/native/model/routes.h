/* Strings over more than two nodes, and the shares that nodes have in strings' masses. */
#ifndef TENSEGRITY_ROUTES_H
#define TENSEGRITY_ROUTES_H

#include "linear/pattern.h"
#include "model/model.h"

#include <stddef.h>
#include <stdint.h>

const char *ts_check_routes(const ts_model *m);
int ts_segment_count(const ts_model *m);
size_t ts_route_blocks(const ts_model *m);
size_t ts_route_places(const ts_model *m);
void ts_lay_out_routes(ts_model *m);
void ts_list_route_blocks(ts_model *m);
void ts_place_routes(ts_model *m, const ts_pattern *pattern);
void ts_lay_out_masses(ts_model *m, int32_t *known);

#endif
