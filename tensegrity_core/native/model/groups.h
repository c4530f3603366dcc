/* Bars that share nodes, nodes that are fixed along single axes, welded bars. */
#ifndef TENSEGRITY_GROUPS_H
#define TENSEGRITY_GROUPS_H

#include "model/data.h"
#include "model/model.h"

#include <stddef.h>
#include <stdint.h>

const char *ts_check_joints(const ts_model *m);
int ts_is_joined(const ts_model *m, int bar);
int ts_is_joined_node(const ts_model *m, int node);
int ts_moved_axes(const ts_model *m, int e);
int ts_may_move(const ts_model *m, int e);
int ts_partly_fixed(const ts_model *m);
void ts_count_joints(ts_model *m);
const char *ts_lay_out_joints(ts_model *m);
size_t ts_joint_couples(const ts_model *m, int32_t first, int32_t row, int32_t *couples);
const char *ts_lay_out_joint_matrices(ts_sim *sim);
void ts_joints_free(ts_sim *sim);

#endif
