/* Laws with memory while their graph is searched for: states of the parts and their branches (branches.c), the flow of a snap
 * (flow.c), the search (hysteresis.c). */
#ifndef TENSEGRITY_GRAPH_H
#define TENSEGRITY_GRAPH_H

#include "laws/law.h"
#include "laws/rise.h"
#include "model/force_curve.h"

#include <stdint.h>

#define TS_MOST_PIECES 4096
#define TS_NEAR 1e-9   /* elongations that are equal, of the length */
#define TS_ENDED 2e-10 /* a part this near the end of its piece has come to it, of the length */

enum { TS_BOUND, TS_FOLD, TS_ZERO, TS_JOINT, TS_ENDLESS }; /* what ends a branch */

typedef struct {
    int32_t *at;                  /* (n) piece of each part; its number of pieces: at its stop */
    int32_t leader, first, count; /* -1: all parts are at their stops; its branches */
} ts_state;

typedef struct {
    int32_t state, kind, piece; /* -1: slack; of the piece; its number, -1: not reached */
    int32_t cause[2];
    double x[2], u[2], T[2]; /* at its ends: elongation, the leader's own, m; force, N */
    double *slack;           /* (n) elongations of the parts of a slack branch, m */
} ts_branch;

typedef struct {
    ts_curve *c;
    const ts_law *part;
    int n;
    double k, size, length; /* N/m; N, m: what forces and elongations are measured by */
    ts_state *states;
    ts_branch *branches;
    int32_t state_count, branch_count, rows;
    int32_t *reached;       /* (TS_MOST_PIECES) branches in the order of the pieces */
    double *u, *v;          /* (n) parts' elongations at the end of a branch, on the way of a snap, m */
    double *on_rise, *work; /* (n), (8, n) */
    int32_t *next;          /* (3, n) */
    ts_mover *mover;        /* (n) */
    int snapped;            /* the last branch that was followed ended in a snap, its end in v */
    const char *reason;
} ts_graph;

#endif
