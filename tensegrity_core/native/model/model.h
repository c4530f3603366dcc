/* The const model: what a packed model says of a structure, and what follows from it alone.
 *
 * Generalised coordinates.  The state is a list of blocks of D numbers: a free bar has two blocks, its centre r and its
 * vector b; a pinned bar has one, c = tip - base; a point mass on no bar has one, its position.  A node's position is (r or its
 * anchor) + coef * block.  Blocks of bars carry the projector that keeps their length.  Behind them stand the blocks of contacts,
 * in space, and of actuators. */
#ifndef TENSEGRITY_MODEL_H
#define TENSEGRITY_MODEL_H

#include "fields.h"

#include <stdint.h>

#define TS_LANES 4  /* arrays that are worked on in one go are padded to a multiple of it */
#define TS_LEDGER 3 /* dissipated, input_work, throughput */

typedef struct {
    int32_t offset; /* of the block in q */
    int32_t block;
    double kappa; /* s = s0 + sum kappa * block; the generalised force of tension T on the block is -kappa T s/xi */
} ts_term;

/* Where a bar's coordinates are: the block of a pinned bar's vector, or of a free bar's centre, its vector the next. */
typedef struct {
    int32_t block, first, second; /* block; nodes, the second being the tip of a pinned bar */
    double lower, upper;          /* of a free bar: the ends are at r - lower b and r + upper b, r being the centre of mass */
} ts_place_of_bar;

/* What the packed model holds, as it stands there: ts_model_read(). */
typedef struct {
    const int32_t *bars, *strings;   /* (B, 2), (S, 2) nodes */
    const int32_t *fixed;            /* (N) */
    const int32_t *beams;            /* (S) beams of the string's NSH, 0: none */
    const int32_t *beam_law;         /* (S) 0 single_valued, 1 hysteretic */
    const int32_t *element, *damper; /* (S, 2) places of the string's force law and damper in the programs, -1: none */
    const int32_t *massed, *dragged; /* (P), (R) nodes with a point mass, with drag */
    const int32_t *moved, *wound;    /* (E) nodes that are moved, (A) strings with an actuator */
    const int32_t *braced, *rated;   /* (C) bars with a section, (T) strings with a strength */
    const int32_t *heavy;            /* (M) strings with mass */
    const int32_t *route;            /* (route_ints) per routed string: itself, how many nodes, the nodes in order */
    const int32_t *sharing;          /* (shares, 2) of a string's mass: its number among the M, node */
    const int32_t *two_way;          /* (two_way_count) strings that also push */
    const int32_t *touching; /* (K) nodes that may touch the ground; behind them, where there are any, whether it may pull */
    const int32_t *program;  /* (program_ints) force laws, see kernel/packing.py */
    const double *program_values;          /* (program_doubles) */
    const double *node, *velocity;         /* (N, D) positions, m, and velocities, m/s, at the start */
    const double *start;                   /* (n_applied) defaults of inputs and parameters */
    const double *share;                   /* (shares) parts of the strings' masses */
    const double *ground;                  /* (2, D) where there are such nodes: a point of the ground, m; its unit normal */
    int32_t program_ints, program_doubles; /* sizes */
    int32_t routes, route_ints, shares, two_way_count;
    int32_t method;             /* TS_METHOD_... */
    const int32_t *joint;       /* (joint_ints) see model/groups.c */
    const double *joint_values; /* (joint_doubles) */
    int32_t joint_ints, joint_doubles;
    uint64_t hash;
} ts_packed;

/* Bars: lay_out_bars(). */
typedef struct {
    int32_t *block;            /* (B) block of b or c */
    int32_t *centre;           /* (B) block of r, or -1 where pinned */
    int32_t *base;             /* (B) fixed node of a pinned bar, or -1 */
    double *length;            /* (B) m */
    ts_place_of_bar *pinned;   /* (pinned_count) */
    ts_place_of_bar *floating; /* (floating_count) */
    int32_t pinned_count, floating_count;
} ts_bars;

/* Blocks of the generalised coordinates: lay_out_bars(), lay_out_matrices(). */
typedef struct {
    int32_t *bar;       /* (blocks) bar; -1: none */
    int32_t *turns;     /* (blocks) 1: a bar vector of constant length, 0: a centre */
    double *length;     /* (blocks) length of a bar vector, m */
    int32_t *own_place; /* (blocks) first entry of the Jacobian's diagonal block */
} ts_blocks;

/* Nodes: lay_out_bars(); coef: ts_weigh(), too. */
typedef struct {
    int32_t *free_index; /* (N) place among the free nodes; -1 - place among the fixed ones */
    int32_t *block;      /* (N) block of the bar vector, or -1 */
    int32_t *centre;     /* (N) block of the centre, or -1 */
    double *coef;        /* (N) 1: tip; -lower, upper: ends of a free bar */
    double *anchor;      /* (N, D) what the node's position adds to, m */
    int32_t *lone;       /* (lone_count) free nodes on no bar: point masses; `block` has theirs, which are their positions */
    int32_t *massed;     /* (massed_count) nodes with a mass beside their bar's: point masses, then shares of strings' masses */
    int32_t lone_count, massed_count;
} ts_nodes;

/* A string over more than two nodes. */
typedef struct {
    int32_t string;
    int32_t first, count; /* the lines that are its segments, in order */
    int32_t *block;       /* (blocks) those that it hangs on, each once */
    int32_t *place;       /* (blocks, blocks) first entry of the Jacobian's block for each pair of them */
    int32_t blocks;
} ts_route;

/* Strings, and behind them as lines of their own the segments of those that run over more than two nodes, which themselves have
 * neither ends nor terms then: lay_out_strings(), ts_lay_out_routes(), lay_out_matrices(). */
typedef struct {
    int32_t count;       /* lines: strings and segments */
    int32_t *node;       /* (count, 2) nodes at a line's ends */
    int32_t *ends;       /* (lanes, 2) their first numbers in arrays (N, 2, D); both the same where a line has no ends */
    double *s0;          /* (count, D) constant part of the line's vector, m */
    int32_t *term_count; /* (count) */
    ts_term *term;       /* (count, 4) */
    int32_t *term_place; /* (count, 4, 4) first entry of the Jacobian's block for each pair of terms */
    int32_t *term_block; /* (count, 4) of segments: place of a term's block among its route's */
    int32_t *routed;     /* (S) the string's route, -1: it runs straight from node to node */
    ts_route *route;     /* (route_count) */
    int32_t route_count;
    int32_t otherwise;                    /* there is a routed string, or one that pushes */
    int32_t most_blocks;                  /* that a route hangs on */
    int32_t *route_blocks, *route_places; /* of all routes */
    int32_t *two_way;                     /* (S) 1: a spring that also pushes */
    int32_t *beam_first;                  /* (S) first of the string's beams among the Z */
    int32_t *curved;                      /* (S) 1: its force curve is not that of a spring of its stiffness */
    int32_t *with_curve,
        *with_damper; /* (curved_count), (damped_count) strings that are curved, that have a damping law beside d */
    int32_t curved_count, damped_count;
} ts_lines;

/* Moved nodes and actuators: lay_out_drives(). */
typedef struct {
    int32_t *mover;     /* (N) moved node that carries this one: itself, or its bar is pinned there; -1: none */
    int32_t *mover_bar; /* (E) bar that is pinned there, -1: none */
    int32_t *axes;      /* (E) a bit for each axis along which it is moved */
    int32_t *winder;    /* (S) actuator that winds the string, or -1 */
    int32_t any;        /* there is a point mass, drag, a moved node, an actuator, a routed string or a ground: drives.c, ... */
} ts_drives;

/* Nodes that may touch the ground: lay_out_contacts(). */
typedef struct {
    int32_t *block;   /* (K) block of the direction in which it slips, -1: none, in a planar scene */
    int32_t directed; /* how many have one */
} ts_contacts;

enum { TS_TIE_NODES = 4 }; /* that one constraint concerns, at most */

/* A constraint on nodes of joined bars, with e = sum of coef x: a bar's length or that of a weld's diagonal, |e| = length, or that
 * a node of a flat body stays in its frame's line or plane, e = 0 across it. */
typedef struct {
    int32_t count, bar;         /* nodes; the bar, -1: another constraint */
    int32_t node[TS_TIE_NODES]; /* a follower's: itself, then its frame */
    int32_t spot[TS_TIE_NODES]; /* places among the joined nodes, -1: fixed */
    int32_t row;                /* of the multipliers, -1: it follows from the others */
    int32_t directions;         /* one, or of followers as many as are across */
    int32_t follows;            /* 1: a follower's */
    int32_t heavy;              /* the string whose mass couples the two nodes, among the M; -1: none */
    double part;                /* of its mass */
    double coef[TS_TIE_NODES];  /* */
    double length;              /* m; of a follower: of its frame's first edge */
    int32_t place[2]
                 [(TS_TIE_NODES + 1) * (TS_TIE_NODES + 1)]; /* first entries of the blocks for each pair of its nodes, its row
                                                                  last: among the joined nodes' blocks, in the Jacobian */
} ts_tie;

/* Joined bars: nodes that belong to several bars, or are fixed along some axes only, have blocks of their own, which are their
 * positions; constraints hold the bars' lengths: ts_lay_out_joints(). */
typedef struct {
    int32_t nodes, first;   /* joined nodes; the block of the first, the others behind it */
    int32_t bars, count;    /* ties that are bars', which stand first; ties */
    int32_t rows, dropped;  /* ties that have one; that have none */
    int32_t links;          /* strings' masses that couple nodes: ties behind the others, without a constraint */
    int32_t *node;          /* (nodes) */
    int32_t *held, *pushed; /* (nodes) a bit for each axis along which it is fixed, and of these is moved */
    int32_t *mover;         /* (nodes) moved node, -1: none */
    int32_t *spot;          /* (N) place among the joined nodes; -1: none */
    int32_t *ground;        /* (N) place among the nodes that are fixed along some axis; -1: none */
    int32_t *bears;         /* (N) 1: an end of a joined bar */
    ts_tie *tie;            /* (count) */
    int32_t *own[2];        /* (nodes) first entry of the diagonal block, in both matrices; (rows) behind them of the rows' */
} ts_joints;

typedef struct {
    /* sizes */
    int32_t count[TS_COUNTS];
    int32_t n_real, n_int;
    int32_t n_inputs, n_applied; /* the first reals: inputs, then with parameters */
    int32_t at[TS_FIELD_COUNT];  /* first index of each field in the block of doubles */
    int32_t int_at[TS_INT_FIELD_COUNT];
    int32_t blocks, nq, ny; /* blocks; nq = blocks * D; ny = 2 nq + TS_LEDGER */
    int32_t lanes, stride;  /* lines and ny, padded to a multiple of TS_LANES */
    /* options */
    int32_t z_axis;      /* local axis that is z, or -1 */
    int32_t damping_law; /* TS_LITERAL, TS_TENSION_ONLY */

    ts_packed packed;
    ts_bars bar;
    ts_blocks block;
    ts_nodes node;
    ts_lines string;
    ts_drives drive;
    ts_joints joint;
    ts_contacts contact;
    double *y_start; /* (stride) the state at the start, m, m/s, J */
} ts_model;

#endif
