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
#define TS_CHOICES 4            /* methods that `auto` chooses from */
#define TS_TRIALS 4             /* kinds of trials that it makes */
#define TS_WATCHES 3            /* of a contact: its normal end, its clipping, its friction */

/* What a contact does: where the ground presses the node sticks or slips; where it would have to pull, it is clipped. */
enum { TS_APART, TS_STICKING, TS_SLIPPING, TS_CLIPPED_CONTACT, TS_CONTACT_MODES };

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

/* What `auto` knows, see auto.c.  Work is counted in steps of dop853; a phase is a time of implicit steps. */
typedef struct {
    double work;                   /* done so far */
    double natural[TS_CHOICES];    /* s, step that each method took or proposed last; 0: not yet used */
    double effort[TS_CHOICES];     /* that its steps took, failed attempts included, over the usual one: a running mean */
    double taken, failed;          /* effort of the last attempt, of failed attempts at the present step */
    double interval[TS_TRIALS];    /* work between trials of each kind, in steps of the method to try */
    double since[TS_TRIALS];       /* work at the last one */
    double phase_time, phase_work; /* s; of the present phase */
    double trial_time, trial_work; /* s; since the method in use came into use */
    double rival_price;            /* work per s of `rival` before the trial */
    double h_lambda;               /* step times fastest rate, in the last explicit step */
    int32_t phase_steps, steps;    /* likewise */
    int32_t losing;                /* implicit steps in a row that were not worth their cost */
    int32_t incumbent;             /* method to go back to if the one on trial within a phase loses; -1: none is on trial */
    int32_t preferred;             /* implicit method to begin with; 0: not yet known */
    int32_t base;                  /* the explicit method to use where no phase is */
    int32_t rival;                 /* explicit method that `base` is on trial against; -1: none */
    int32_t unused;
} ts_choice;

/* What a saved state holds besides the two blocks: everything that the next step depends on. */
typedef struct {
    double time;     /* s, at the last communication point */
    double time_low; /* s, what rounding took from it so far */
    double h_next;   /* s, step that the controller proposes; 0: none, start afresh */
    double h_kick;   /* s, the same for a first step after inputs have changed; 0: none */
    ts_choice choice;
    ts_span span;
    double joined;     /* s, length of the step that ended where the present one starts, its dense output at hand; or 0 */
    double err_last;   /* of the last accepted step, in units of the tolerance */
    double last_step;  /* s, of the last call: the outputs are those at its end */
    int32_t rejected;  /* attempts in a row that were */
    int32_t sloped;    /* some input had a derivative then */
    int32_t active;    /* method in use */
    int32_t stiff;     /* signs of stiffness, or of its absence, in the steps just taken */
    int32_t patience;  /* how many of them make `auto` leave the explicit method before its interval is over */
    int32_t started;   /* ts_initialize() has been called */
    int32_t method;    /* as it was then */
    int32_t completed; /* steps of a host that integrates by itself, since the bars got their lengths back */
    int64_t stats[TS_STATS];
} ts_memory;

/* What follows is grouped by who fills it.  Counts in brackets are those of fields.h, and of ts_model. */

/* The strings' laws: ts_curves_build(), ts_dampers_build(). */
typedef struct {
    ts_curve *curve;   /* (S); derived from the parameters; equal ones share their table */
    int32_t *owner;    /* (S) 1: the table is this string's */
    double *key;       /* (2, 3 Z + S) parameters the curves were built from, and room for others */
    ts_curve *damping; /* (S) damping laws as functions of |rate| */
    int32_t ready;     /* the curves are those of the key */
} ts_laws;

/* What the caller writes and reads: inputs, parameters, outputs (saved). */
typedef struct {
    double *values;         /* (n_real) in the units of fields.h */
    double *applied;        /* (n_applied) inputs and parameters as the last step saw them */
    double *slopes;         /* (2, n_inputs) first and second derivatives of the inputs by time, see ts_slopes() */
    double *applied_slopes; /* (2, n_inputs) as the last step saw them */
    int32_t *integers;      /* (n_int) */
} ts_io;

/* The state at the last communication point, or while a call lasts where it has come to (saved): ts_integrate(). */
typedef struct {
    double *y;        /* (ny) coordinates, m; their rates, m/s; the ledger, J */
    int32_t *piece;   /* (S) of the force curve */
    int32_t *clipped; /* (S) tension_only: the damper outweighs the spring, no tension */
    int32_t *mode;    /* (K) of a contact, TS_APART ... */
    double
        *bristle; /* (K, D) where it sticks the place at which its bristle is at rest, m; where it slips in a planar scene the
                         direction; else 0 */
} ts_motion_state;

/* Masses and gravity over the present step: ts_weigh(). */
typedef struct {
    double *inverse;   /* (blocks) inverse inertia, 1/kg */
    double *laden;     /* (blocks) mass that gravity acts on there, kg; zero at vectors of free bars */
    double *extra;     /* (N) point masses, kg */
    double gravity[3]; /* m/s2 */
} ts_inertia;

/* External forces over the present step: ts_prepare(). */
typedef struct {
    double *Q;            /* (nq) generalised external force at the step's start, N */
    double *with_gravity; /* (nq) the same with gravity, N */
    double *rate, *bend;  /* (nq) first and second derivative of Q, N/s, N/s2 */
    int32_t move;         /* some force has a derivative, or moves with a node */
} ts_loads;

/* Rest lengths over the present step: ts_prepare(); now, rate_now: every right-hand side, where they bend or are wound. */
typedef struct {
    double *length, *rate, *bend, *jerk; /* (lanes) m, m/s, m/s2, m/s3, at the step's start */
    double *now, *rate_now;              /* (lanes) m, m/s, at the evaluation at hand */
    int32_t moves;                       /* some rate, bend or jerk is not zero */
    int32_t bends;                       /* some bend or jerk is not zero */
} ts_rest;

/* Moved nodes: ts_drive(); now: ts_move_bases() in every right-hand side. */
typedef struct {
    double *start; /* (E, 5, D) position and its first four derivatives at the step's start, m, m/s, ... */
    double *now;   /* (E, 3, D) position, velocity, acceleration, m, m/s, m/s2 */
} ts_bases;

enum { TS_TAUT = 1, TS_PUSHES = 2 }; /* a string that also pushes is never clipped */

/* What strings bear on the pieces that they are on: ts_place(), ts_bear(). */
typedef struct {
    double *lo, *hi; /* (S) ends of the piece, m */
    double *guard;   /* (S) elongation beyond an end that counts as crossed, m */
    double *k, *d;   /* (lanes) N/m, N s/m; k: of straight force curves */
    int32_t *taut;   /* (S) not 0: the piece is none of the slack ones */
} ts_bearing;

/* What the last right-hand side, or ts_forces(), found about the strings. */
typedef struct {
    double *x;                        /* (N, 2, D) node positions and velocities, m, m/s */
    double *s, *sd;                   /* (D, lanes) vectors of the lines and, behind them, their rates, m, m/s */
    double *per_length;               /* (lanes) 1/length, 1/m */
    double *elongation, *rate;        /* (lanes) m, and its rate, m/s */
    double *fs, *fd;                  /* (lanes) elastic and damping tension, N */
    double *node_force;               /* (N, D) N */
    double *lowest, *highest;         /* (lanes) extremes of the elongation since the attempt began, m */
    int32_t *sign_changed;            /* (S) tension_only: a stage saw the tension with the other sign */
    double *margin_low, *margin_high; /* (S) tension_only: extremes of the tension at the stages, minus it where clipped, N */
    double *route_extremes;           /* (routes, 2) lowest, highest of routed strings, while lines are worked out */
    int64_t evaluations;              /* how often all this has been written, node forces also by outputs */
} ts_strings;

/* A node and the ground: contact.c. */
typedef struct {
    double delta, rate;       /* penetration, m, and its rate, m/s */
    double vt[3];             /* velocity in the plane, m/s */
    double u[3];              /* sticking: deflection of the bristle, m; slipping: direction of slip; else 0 */
    double normal;            /* force N along the normal, N; negative past the end of what its mode allows */
    double reach;             /* deflection mu N/k_t at which the bristle slips, m */
    double by_delta, by_rate; /* dN/d(delta), N/m; dN/d(delta'), N s/m */
    double size;              /* of the numbers that delta comes from, m */
} ts_touch;

/* The ground and what it does to nodes: ts_raise_ground() at the step's start, ts_press() in every right-hand side. */
typedef struct {
    double start[5];    /* height along the normal and its first four derivatives at the step's start, m, m/s, ... */
    double now[3];      /* height, rate, acceleration, m, m/s, m/s2 */
    double least_time;  /* s, a direction of slip follows the velocity no faster, see contact.c */
    ts_touch *touch;    /* (K) what the last evaluation found */
    double *margin;     /* (K, TS_WATCHES) how far each watch is from crossing, see steps/contacts.c */
    double *low, *high; /* (K, TS_WATCHES) extremes of the margins since the attempt began */
    double *end;        /* (K, TS_WATCHES) margins at the end of the step at hand */
} ts_ground;

/* Where the present step starts: steps/integrate.c. */
typedef struct {
    double *elongation, *rate; /* (S) m, m/s */
    double *f;                 /* (stride) derivative of the state */
} ts_step_start;

/* What an open step needs, in one piece (saved): a method's attempt(), accept(), densify(). */
typedef struct {
    double *all;               /* (size) of which the others are parts: */
    double *dense;             /*   (8, stride) dense output; row 0: the state at the step's start */
    double *y, *f;             /*   (stride) its end, and the derivative there */
    double *elongation, *rate; /*   (lanes) m, m/s, at its end */
    double *backup;            /* (size) */
    size_t size;               /* numbers */
    int32_t stride;            /* of the rows */
    int32_t ready;             /* densify() has been called for the step at hand */
} ts_step_ahead;

/* A method's workspace and advice: attempt(). */
typedef struct {
    double *k;             /* (16, stride) stages */
    double *y, *error;     /* (stride) argument of a stage; error of the step */
    double shrink, growth; /* factor of the step if it failed, largest factor if it did not */
} ts_attempt;

/* Jacobian and factors: ts_rhs_jacobian(), methods/systems.c. */
typedef struct {
    ts_pattern pattern;     /* of the Jacobian's blocks */
    double *Jq, *Jv;        /* (pattern.count, D, D) derivatives of the accelerations by positions, 1/s2, and velocities, 1/s */
    double *ft;             /* (nq) and by time, m/s3 */
    double *factor;         /* of a^2 I - a Jv - Jq */
    double *pair_factor[2]; /* of the same with the two complex values of a that Radau IIA needs */
    double *work;           /* (6 nq) */
    double *slopes;         /* (2, blocks, D) of a routed string's length by the blocks it hangs on, and of its rate */
    int32_t ready;          /* the Jacobian at hand is that of the step's start */
} ts_linear;

/* Joined bars: motion/joints.c, methods/joined.c; n numbers of an array that stands for joined nodes and rows, w for the whole. */
typedef struct {
    ts_pattern pattern;        /* of the joined nodes' blocks and the rows of multipliers */
    double *J, *zero, *factor; /* I - E on it, E of mass and constraints; zeros; factor of E */
    double *whole;             /* I - E on the Jacobian's pattern */
    double *Jq, *Jv;           /* the matrices of a stage there */
    double *b, *force;         /* (n) a system's right-hand side and solution; (nodes, D) forces on the joined nodes, N */
    double *scale;             /* (rows) of a multiplier, kg */
    double *across;            /* (ties, 2, D) directions of the constraints */
    double *lambda;            /* (ties, 2) multipliers: forces along the directions, N */
    double *x;                 /* (N, 2, D) positions and velocities, where constraints are put right */
    double *reaction, *half; /* (N, D) inertia less multipliers' forces, N; (N) half the masses of the joined bars there, kg */
    double *a;               /* (N, D) accelerations, m/s2 */
    double *null, *square;   /* (dropped, ties, 2) forces that hold each other; (dropped, dropped + 1) */
    double *work;            /* (6, w) */
    int32_t factored;        /* the factor is that of the constraints being put right */
    int32_t failed;          /* the constraints lock, or contradict each other */
} ts_joint_work;

/* The present call: ts_integrate(). */
typedef struct {
    double most;           /* s, largest step that the parameters allow */
    double length;         /* s */
    double h_before;       /* s, step that the controller proposed when it began */
    int64_t evaluation;    /* strings.evaluations at the end of the open step */
    int64_t looks;         /* at one string on the dense output, since ts_create() */
    int32_t may_run_ahead; /* inputs stay */
    int32_t force_jumps;   /* the last transition made a force jump */
    int32_t kicked;        /* the next step is the first under new inputs */
    int32_t unlocated;     /* analysis: pieces follow the elongation at every evaluation, transitions are not located */
    ts_watcher watcher;    /* NULL: nobody watches */
    void *context;         /* of the watcher */
    double reached;        /* s after the call's start, at the last moment that the watcher was told of */
    int64_t seen;          /* transitions that there were then */
    int32_t watching;      /* the watcher has been called and has not returned */
    int32_t looked;        /* the outputs are those of such a moment */
    int32_t answer;        /* the watcher's last */
} ts_call;

/* What is told of the last call: steps/events.c, interface/message.c. */
typedef struct {
    ts_transition *transitions; /* (TS_MAX_TRANSITIONS) */
    int64_t count;              /* of all transitions, stored or not */
    char message[256];
    int32_t concerned; /* index of the value that the message is about, -1: none */
} ts_told;

/* What a call that fails restores: interface/. */
typedef struct {
    double *reals;     /* (n_real + n_applied + 2 n_inputs + ny + K D) */
    int32_t *integers; /* (n_int + 2 S + K) */
    double *watched;   /* (n_real + 2 n_inputs) values and slopes of a watched step */
} ts_undo;

/* Allocations: ts_model_read(). */
typedef struct {
    void *blob;       /* the packed model */
    double *matrices; /* what `linear` points to */
    double *joined;   /* what `joined` points to */
    void *arena;      /* everything else but the pattern and the laws */
    size_t bytes;     /* of all four */
} ts_owned;

/* Outputs on demand: interface/demand.c.  What `wanted` leaves out is computed when somebody asks, and so is the state at a
 * communication point within an open step. */
typedef struct {
    uint8_t *group;       /* (n_real + n_int) the group of each number of the blocks, see ts_want(); 0: no output on demand */
    int32_t left_out;     /* groups that ts_step() does not fill */
    int32_t reads_all;    /* as many outputs as there are were asked for since the last communication point */
    int32_t stale;        /* groups that are older than the last communication point */
    int32_t motion_ahead; /* coordinates and rates there are still to be taken from the open step */
    int32_t ledger_ahead; /* the ledger, too */
    int32_t moderate;     /* no number of the open step is so large that an output could overflow */
    int64_t evaluation;   /* where ts_strings, start.f still are those of the state: what strings.evaluations was then */
    double evaluated_at;  /* s after the last communication point */
} ts_demand;

struct ts_sim {
    ts_model m;
    ts_laws laws;
    ts_memory memory;
    ts_io io;
    ts_motion_state state;
    ts_inertia inertia;
    ts_loads loads;
    ts_rest rest;
    ts_bases bases;
    ts_bearing on;
    ts_strings strings;
    ts_ground ground;
    ts_step_start start;
    ts_step_ahead ahead;
    ts_attempt attempt;
    ts_linear linear;
    ts_joint_work joined;
    ts_call call;
    ts_told told;
    ts_undo undo;
    ts_demand demand;
    ts_owned owned;
};

#endif
