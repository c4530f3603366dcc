/* The mutable data of a simulation and its workspace.  One simulation owns one model and one of these; nothing else is
 * shared. */
#ifndef TENSEGRITY_DATA_H
#define TENSEGRITY_DATA_H

#include "fields.h"
#include "linear/pattern.h"
#include "model/force_curve.h"
#include "model/model.h"
#include "tensegrity.h"

#include <stddef.h>
#include <stdint.h>

#define TS_MAX_TRANSITIONS 4096 /* stored per call; the count goes on */
#define TS_CHOICES 3            /* methods that `auto` chooses from */
#define TS_TRIALS 3             /* kinds of trials that it makes */

/* The step at hand.  While inputs stay, the last step of a call may end past its communication point: outputs there, and the
 * calls that follow, then come from its dense output until its end, or its first transition, is reached. */
typedef struct {
    double start;   /* s after the last communication point, not positive once the step has been left open */
    double h;       /* s; 0: no step is open */
    double reach;   /* part of it that holds: 1, or where the transition is */
    double clipped; /* energy of clipped strings at its start, J */
    int32_t which;  /* watch that crosses there, see events.c; -1: none */
    int32_t method;
} ts_span;

/* What `auto` knows, see auto.c.  Work is counted in explicit steps; a phase is a time of implicit steps. */
typedef struct {
    double work;                   /* done so far */
    double natural[TS_CHOICES];    /* s, step that each method took or proposed last; 0: not yet used */
    double effort[TS_CHOICES];     /* that its steps took, failed attempts included, over the usual one: a running mean */
    double taken, failed;          /* effort of the last attempt, of failed attempts at the present step */
    double interval[TS_TRIALS];    /* work between trials of each kind, in steps of the method to try */
    double since[TS_TRIALS];       /* work at the last one */
    double phase_time, phase_work; /* s; of the present phase */
    double trial_time, trial_work; /* s; since the method in use came into use */
    double h_lambda;               /* step times fastest rate, in the last explicit step */
    int32_t phase_steps, steps;    /* likewise */
    int32_t losing;                /* implicit steps in a row that were not worth their cost */
    int32_t incumbent;             /* method to go back to if the one on trial within a phase loses; -1: none is on trial */
    int32_t preferred;             /* implicit method to begin with; 0: not yet known */
    int32_t unused;
} ts_choice;

/* What a saved state holds besides the two blocks: everything that the next step depends on. */
typedef struct {
    double time;     /* s, at the last communication point */
    double time_low; /* s, what rounding took from it so far */
    double h_next;   /* s, step that the controller proposes; 0: none, start afresh */
    ts_choice choice;
    ts_span span;
    double joined;    /* s, length of the step that ended where the present one starts, its dense output at hand; or 0 */
    double err_last;  /* of the last accepted step, in units of the tolerance */
    double last_step; /* s, of the last call: the outputs are those at its end */
    int32_t rejected; /* attempts in a row that were */
    int32_t sloped;   /* some input had a derivative then */
    int32_t active;   /* method in use */
    int32_t stiff;    /* signs of stiffness, or of its absence, in the steps just taken */
    int32_t patience; /* how many of them make `auto` leave the explicit method before its interval is over */
    int32_t started;  /* ts_initialize() has been called */
    int32_t method;   /* as it was then */
    int32_t unused;
    int64_t stats[TS_STATS];
} ts_memory;

struct ts_sim {
    ts_model m;
    ts_curve *curve;      /* (S); derived from the parameters, see curves.c; equal ones share their table */
    int32_t *curve_owner; /* (S) 1: the table is this string's */
    int32_t curves_ready;
    double *curve_key; /* (2, 3 Z + S) parameters the curves were built from, and room for others */
    ts_curve *damping; /* (S) damping laws as functions of |rate| */

    /* saved */
    ts_memory memory;
    double *values;         /* (n_real) */
    double *applied;        /* (n_applied) inputs and parameters as the last step saw them */
    double *slopes;         /* (2, n_inputs) first and second derivatives of the inputs, see ts_slopes() */
    double *applied_slopes; /* (2, n_inputs) as the last step saw them */
    double *y;              /* (ny) */
    int32_t *integers;      /* (n_int) */
    int32_t *piece;         /* (S) */
    int32_t *clipped;       /* (S) tension_only: the damper outweighs the spring, no tension */
    int32_t n_applied, n_inputs;

    /* of the present step */
    double *Qf;         /* (nq) generalised external force, N */
    double *Qg;         /* (nq) the same with gravity, N */
    double *inv;        /* (blocks) inverse inertia, 1/kg */
    double *laden;      /* (blocks) mass that gravity acts on there, kg; zero at vectors of free bars */
    double *extra_mass; /* (N) point masses, kg */
    double g[3];        /* acceleration by gravity, m/s2 */
    double *base;       /* (E, 5, D) position of a moved node and its first four derivatives at the step's start */
    double *base_now;   /* (E, 3, D) position, velocity, acceleration at the evaluation at hand */
    double *lo, *hi;    /* (S) ends of the present piece, m */
    int32_t *taut;      /* (S) the present piece is none of the slack ones */
    double *guard;      /* (S) elongation beyond an end that counts as crossed, m */
    double *rest, *rest_rate, *rest_bend, *rest_jerk; /* (lanes) m, m/s, m/s2, m/s3, at the step's start */
    double *rest_now, *rest_rate_now;                 /* (lanes) at the evaluation at hand, where rest lengths bend */
    double *Qf_rate, *Qf_bend;                        /* (nq) first and second derivative of Qf, N/s, N/s2 */
    double *k_on, *d_on; /* (lanes) N/m, N s/m on the present piece; k_on: of straight force curves */
    int32_t rest_moves;  /* some rest_rate, rest_bend or rest_jerk is not zero */
    int32_t rest_bends;  /* some rest_bend or rest_jerk is not zero */
    int32_t forces_move; /* some force has a derivative, or moves with a node */
    int32_t unlocated;   /* analysis: pieces follow the elongation at every evaluation, transitions are not located */

    /* of the last right-hand side: what it found about the strings */
    double *x;                                /* (N, 2, D) node positions and velocities, m, m/s */
    double *s, *sd;                           /* (D, lanes) string vectors and, behind them, their rates, m, m/s */
    double *per_length;                       /* (lanes) 1/length, 1/m */
    double *elongation, *elongation_rate;     /* (lanes) elongation and its rate, m, m/s */
    double *fs, *fd;                          /* (lanes) elastic and damping tension, N */
    double *node_force;                       /* (N, D) N */
    double *elongation_low, *elongation_high; /* (lanes) extremes of the elongation since the attempt began, m */
    int32_t *sign_changed;                    /* (S) tension_only: a stage saw the tension with the other sign */
    double *margin_low, *margin_high; /* (S) tension_only: extremes of the tension at the stages, minus it where clipped, N */

    /* workspace */
    double *elongation0, *rate0; /* (S) at the start of a step */
    double *f0, *ytmp, *err;     /* (stride) */
    double *k;                   /* (16, stride) stages */
    double *ahead;               /* what an open step needs, in one piece: */
    double *cont;                /*   (8, stride) dense output; row 0: the state at the step's start */
    double *y1, *f1;             /*   (stride) its end, and the derivative there */
    double *elongation1, *rate1; /*   (lanes) */
    double *ahead_backup;
    size_t ahead_size;      /* numbers */
    ts_pattern pattern;     /* of the Jacobian's blocks */
    double *Jq, *Jv;        /* (pattern.blocks, D, D) */
    double *factor;         /* of a^2 I - a Jv - Jq */
    double *pair_factor[2]; /* of the same with the two complex values of a that Radau IIA needs */
    double *ft, *lin;       /* (nq), (6 nq) */
    double *backup;         /* (n_real + n_applied + 2 n_inputs + ny), see simulation.c */
    int32_t *backup_ints;   /* (n_int + 2 S) */
    double most;            /* s, largest step that the parameters allow */
    double call;            /* s, length of the present call */
    int32_t may_run_ahead;  /* inputs stay */
    double shrink, growth;  /* what an attempt advises: factor of the step if it failed, largest factor if it did not */
    int32_t force_jumps;    /* the last transition made a force jump */
    int32_t dense_ready;    /* densify() has been called for the step at hand */
    int32_t jacobian_ready; /* the Jacobian at hand is that of the step's start */
    ts_transition *transitions;
    int64_t transition_count;
    int64_t looks; /* at one string on the dense output, since ts_create() */
    char message[256];
    size_t bytes;     /* of the allocations below; the pattern and the force curves come on top */
    double *matrices; /* allocation behind Jq, Jv, factor */
    void *arena;      /* allocation behind everything else */
    void *blob;
};

#endif
