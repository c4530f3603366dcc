/* Const model, mutable data, workspace.  One simulation owns one of each; nothing else is shared.
 *
 * Generalised coordinates.  The state is a list of blocks of D numbers: a free bar has two blocks, its centre r and its
 * vector b; a pinned bar has one, c = tip - base; a point mass on no bar has one, its position.  A node's position is (r or its
 * anchor) + coef * block.  Blocks of bars carry the projector that keeps their length. */
#ifndef TENSEGRITY_INTERNAL_H
#define TENSEGRITY_INTERNAL_H

#include "blocks.h"
#include "complex_blocks.h"
#include "fields.h"
#include "pairs.h"
#include "tensegrity.h"

#define TS_MAX_TRANSITIONS 4096   /* stored per call; the count goes on */
#define TS_LANES 4                /* arrays that are worked on in one go are padded to a multiple of it */
#define TS_CHOICES 3              /* methods that `auto` chooses from */
#define TS_TRIALS 3               /* kinds of trials that it makes */
#define TS_PATIENCE 3             /* signs of stiffness that make `auto` leave the explicit method */
#define TS_LEDGER 3               /* dissipated, input_work, throughput */
#define TS_DEGREE 7               /* of the polynomials of force curves */
#define TS_ROW (TS_DEGREE + 2)    /* energy at the left end, then the coefficients of the force */
#define TS_OCTAVES 16             /* of an open piece */

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

/* A piece of a string's force curve, see curve.c. */
enum {
    TS_SLACK,      /* no force; the energy is constant */
    TS_STRAIGHT,   /* force + k (x - lo), k the string's stiffness */
    TS_ROWS,       /* polynomials on equal subintervals of x */
    TS_GRADED,     /* on subintervals that halve towards both ends: `each` of them in every octave of the distance */
    TS_OPEN,       /* to infinity, on subintervals that double: `each` in every one of TS_OCTAVES octaves */
    TS_FOLD_ABOVE, /* a fold at hi: polynomials on equal subintervals of s = sqrt(hi - x) */
    TS_FOLD_BELOW, /* a fold at lo, s = sqrt(x - lo) */
};

typedef struct {
    int32_t kind, rows, first; /* rows of the table, and the first of them */
    int32_t up, down;          /* pieces that follow where hi and lo are passed, or -1 */
    int32_t snapped;           /* beams past their force maximum */
    int32_t each, octaves[2];  /* rows of an octave, octaves from the lower and from the upper end */
    double lo, hi;             /* m, ends */
    double origin, scale;      /* m, 1/m: where the first row begins, and rows per length (of folds: of s); of a graded
                                * piece the inverse of its length, of an open one that of its first octave's */
    double force, energy;      /* N, J: at lo of a straight piece; the energy of a slack one */
    double loss_up, loss_down; /* J, what a snap there dissipates */
} ts_piece;

typedef struct {
    int32_t pieces;   /* the first is slack */
    int32_t branches; /* 1: there may be several pieces at one elongation, the string has memory */
    ts_piece *piece;  /* (pieces) */
    double *table;    /* rows of TS_ROW: J, then N */
    double reach;     /* rows past a piece's ends where its formula becomes a straight line */
} ts_curve;

typedef struct {
    int32_t count[TS_COUNTS];
    int32_t n_real, n_int;
    int32_t at[TS_FIELD_COUNT];     /* first index of each field in the block of doubles */
    int32_t int_at[TS_INT_FIELD_COUNT];
    int32_t blocks, nq, ny;         /* blocks; nq = blocks * D; ny = 2 nq + TS_LEDGER */
    int32_t lanes, stride;          /* strings and ny, padded to a multiple of TS_LANES */
    int32_t pinned_count, floating_count; /* bars of each kind */
    int32_t lone_count;             /* free nodes on no bar: point masses by themselves */
    int32_t z_axis;                 /* local axis that is z, or -1 */
    int32_t damping_law;            /* 0 literal, 1 tension_only */
    uint64_t hash;                  /* of the packed model */

    const int32_t *bars, *strings;  /* (B, 2), (S, 2) nodes */
    const int32_t *fixed;           /* (N) */
    const int32_t *beams;           /* (S) beams of the string's NSH, 0: none */
    const int32_t *beam_law;        /* (S) 0 single_valued, 1 hysteretic */
    const int32_t *element, *damper; /* (S, 2) places of the string's force law and damper in the programs, -1: none */
    const int32_t *massed, *dragged; /* (P), (R) nodes with a point mass, with drag */
    const int32_t *moved, *wound;   /* (E) nodes that are moved, (A) strings with an actuator */
    const int32_t *program;         /* (program_ints) force laws, see kernel/packing.py */
    const double *program_values;   /* (program_doubles) */
    int32_t program_ints, program_doubles;
    int32_t *beam_first;            /* (S) first of them among the Z */
    int32_t *ends;                  /* (lanes, 2) first numbers of a string's nodes in arrays (N, 2, D) */
    int32_t curved_count, damped_count;
    int32_t *curved;                /* (curved_count) strings whose force curve is not that of a spring of their stiffness */
    int32_t *damped;                /* (damped_count) strings with a damping law beside d */
    int32_t *law;                   /* (S) 1: among the curved */
    ts_place_of_bar *pinned;        /* (pinned_count) */
    ts_place_of_bar *floating;      /* (floating_count) */
    int32_t *lone;                  /* (lone_count) nodes; node_block has their blocks, which are their positions */
    int32_t *free_index;            /* (N) place among the free nodes; -1 - place among the fixed ones */
    int32_t *bar_block;             /* (B) block of b or c */
    int32_t *bar_centre;            /* (B) block of r, or -1 where pinned */
    int32_t *bar_base;              /* (B) fixed node of a pinned bar, or -1 */
    int32_t *block_bar;             /* (blocks) bar; -1: none */
    int32_t *block_turns;           /* (blocks) 1: a bar vector of constant length, 0: a centre */
    double *block_length;           /* (blocks) length of a bar vector, m */
    int32_t *node_block;            /* (N) block of the bar vector, or -1 */
    int32_t *node_centre;           /* (N) block of the centre, or -1 */
    double *node_coef;              /* (N) 1: tip; -lower, upper: ends of a free bar */
    int32_t *mover;                 /* (N) moved node that carries this one: itself, or its bar is pinned there; -1: none */
    int32_t *mover_bar;             /* (E) bar that is pinned there, -1: none */
    int32_t *winder;                /* (S) actuator that winds the string, or -1 */
    int32_t driven;                 /* there is a point mass, drag, a moved node or an actuator, see drives.c */
    const double *velocity;         /* (N, D) start velocities, m/s */
    double *anchor;                 /* (N, D) what the node's position adds to, m */
    double *bar_length;             /* (B) m */
    int32_t *term_count;            /* (S) */
    ts_term *term;                  /* (S, 4) */
    int32_t *own_place;             /* (blocks) first entry of the Jacobian's diagonal block */
    int32_t *term_place;            /* (S, 4, 4) first entry of the Jacobian's block for each pair of terms */
    double *s0;                     /* (S, D) constant part of the string vector, m */
    const double *start;            /* packed defaults of the doubles, inputs and parameters only */
    double *y_start;                /* (ny) */
    int32_t method_start;
} ts_model;

/* The step at hand.  While inputs stay, the last step of a call may end past its communication point: outputs there, and the
 * calls that follow, then come from its dense output until its end, or its first transition, is reached. */
typedef struct {
    double start;    /* s after the last communication point, not positive once the step has been left open */
    double h;        /* s; 0: no step is open */
    double reach;    /* part of it that holds: 1, or where the transition is */
    double clipped;  /* energy of clipped strings at its start, J */
    int32_t which;   /* watch that crosses there, see events.c; -1: none */
    int32_t method;
} ts_span;

/* What `auto` knows, see auto.c.  Work is counted in explicit steps; a phase is a time of implicit steps. */
typedef struct {
    double work;                 /* done so far */
    double natural[TS_CHOICES];  /* s, step that each method took or proposed last; 0: not yet used */
    double effort[TS_CHOICES];   /* that its steps took, failed attempts included, over the usual one: a running mean */
    double taken, failed;        /* effort of the last attempt, of failed attempts at the present step */
    double interval[TS_TRIALS];  /* work between trials of each kind, in steps of the method to try */
    double since[TS_TRIALS];     /* work at the last one */
    double phase_time, phase_work; /* s; of the present phase */
    double trial_time, trial_work; /* s; since the method in use came into use */
    double h_lambda;             /* step times fastest rate, in the last explicit step */
    int32_t phase_steps, steps;  /* likewise */
    int32_t losing;              /* implicit steps in a row that were not worth their cost */
    int32_t incumbent;           /* method to go back to if the one on trial within a phase loses; -1: none is on trial */
    int32_t preferred;           /* implicit method to begin with; 0: not yet known */
    int32_t unused;
} ts_choice;

/* What a saved state holds besides the two blocks: everything that the next step depends on. */
typedef struct {
    double time;     /* s, at the last communication point */
    double time_low; /* s, what rounding took from it so far */
    double h_next;   /* s, step that the controller proposes; 0: none, start afresh */
    ts_choice choice;
    ts_span span;
    double joined;   /* s, length of the step that ended where the present one starts, its dense output at hand; or 0 */
    double err_last; /* of the last accepted step, in units of the tolerance */
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
    ts_curve *curve;     /* (S); derived from the parameters, see curves.c; equal ones share their table */
    int32_t *curve_owner; /* (S) 1: the table is this string's */
    int32_t curves_ready;
    double *curve_key;   /* (2, 3 Z + S) parameters the curves were built from, and room for others */
    ts_curve *damping;   /* (S) damping laws as functions of |rate| */

    /* saved */
    ts_memory memory;
    double *values;  /* (n_real) */
    double *applied; /* (n_applied) inputs and parameters as the last step saw them */
    double *slopes;  /* (2, n_inputs) first and second derivatives of the inputs, see ts_slopes() */
    double *applied_slopes; /* (2, n_inputs) as the last step saw them */
    double *y;       /* (ny) */
    int32_t *integers; /* (n_int) */
    int32_t *piece;  /* (S) */
    int32_t *clipped; /* (S) tension_only: the damper outweighs the spring, no tension */
    int32_t n_applied, n_inputs;

    /* of the present step */
    double *Qf;   /* (nq) generalised external force, N */
    double *Qg;   /* (nq) the same with gravity, N */
    double *inv;  /* (blocks) inverse inertia, 1/kg */
    double *laden; /* (blocks) mass that gravity acts on there, kg; zero at vectors of free bars */
    double *extra_mass; /* (N) point masses, kg */
    double g[3];  /* acceleration by gravity, m/s2 */
    double *base; /* (E, 5, D) position of a moved node and its first four derivatives at the step's start */
    double *base_now; /* (E, 3, D) position, velocity, acceleration at the evaluation at hand */
    double *lo, *hi; /* (S) ends of the present piece, m */
    int32_t *taut;   /* (S) the present piece is none of the slack ones */
    double *guard;   /* (S) elongation beyond an end that counts as crossed, m */
    double *rest, *rest_rate, *rest_bend, *rest_jerk; /* (lanes) m, m/s, m/s2, m/s3, at the step's start */
    double *rest_now, *rest_rate_now;     /* (lanes) at the evaluation at hand, where rest lengths bend */
    double *Qf_rate, *Qf_bend;            /* (nq) first and second derivative of Qf, N/s, N/s2 */
    double *k_on, *d_on; /* (lanes) N/m, N s/m on the present piece; k_on: of straight force curves */
    int32_t rest_moves;  /* some rest_rate, rest_bend or rest_jerk is not zero */
    int32_t rest_bends;  /* some rest_bend or rest_jerk is not zero */
    int32_t forces_move; /* some force has a derivative, or moves with a node */
    int32_t unlocated;   /* analysis: pieces follow the elongation at every evaluation, transitions are not located */

    /* of the last right-hand side: what it found about the strings */
    double *x;               /* (N, 2, D) node positions and velocities, m, m/s */
    double *s, *sd;          /* (D, lanes) string vectors and, behind them, their rates, m, m/s */
    double *over;            /* (lanes) 1/length, 1/m */
    double *gap, *gap_rate;  /* (lanes) elongation and its rate, m, m/s */
    double *fs, *fd;         /* (lanes) elastic and damping tension, N */
    double *node_force;      /* (N, D) N */
    double *gap_low, *gap_high; /* (lanes) extremes of the elongation since the attempt began, m */
    int32_t *sign_changed;      /* (S) tension_only: a stage saw the tension with the other sign */
    double *margin_low, *margin_high; /* (S) tension_only: extremes of the tension at the stages, minus it where clipped, N */

    /* workspace */
    double *gap0, *rate0;        /* (S) at the start of a step */
    double *f0, *ytmp, *err;     /* (stride) */
    double *k;                   /* (16, stride) stages */
    double *ahead;               /* what an open step needs, in one piece: */
    double *cont;                /*   (8, stride) dense output; row 0: the state at the step's start */
    double *y1, *f1;             /*   (stride) its end, and the derivative there */
    double *gap1, *rate1;        /*   (lanes) */
    double *ahead_backup;
    size_t ahead_size;           /* numbers */
    ts_pattern pattern;          /* of the Jacobian's blocks */
    double *Jq, *Jv;             /* (pattern.blocks, D, D) */
    double *factor;              /* of a^2 I - a Jv - Jq */
    double *pair_factor[2];      /* of the same with the two complex values of a that Radau IIA needs */
    double *ft, *lin;            /* (nq), (6 nq) */
    double *backup;       /* (n_real + n_applied + 2 n_inputs + ny), see simulation.c */
    int32_t *backup_ints; /* (n_int + 2 S) */
    double most;            /* s, largest step that the parameters allow */
    double call;            /* s, length of the present call */
    int32_t may_run_ahead;  /* inputs stay */
    double shrink, growth;  /* what an attempt advises: factor of the step if it failed, largest factor if it did not */
    int32_t force_jumps;    /* the last transition made a force jump */
    int32_t dense_ready;    /* densify() has been called for the step at hand */
    int32_t jacobian_ready; /* the Jacobian at hand is that of the step's start */
    ts_transition *transitions;
    int64_t transition_count;
    int64_t looks;          /* at one string on the dense output, since ts_create() */
    char message[256];
    size_t bytes;     /* of the allocations below; the pattern and the force curves come on top */
    double *matrices; /* allocation behind Jq, Jv, factor */
    void *arena;      /* allocation behind everything else */
    void *blob;
};

enum {
    TS_IMPLICIT = 1,         /* linearly implicit: uses the Jacobian */
    TS_FIXED_STEP = 2,       /* takes the step it is given */
    TS_ALWAYS_DENSE = 8,     /* its dense output is used anyway, to start the next step */
    TS_CLIPPED = 16,         /* dense output is weaker than the step: no step passes a communication point */
    TS_LEDGER_IN_STAGES = 4, /* the ledger's integrals are among the stages; else the driver integrates the dense output */
};

/* A method advances y from tau by h under fixed pieces.  Adding one: a file with a table like this, and a line in
 * fields.py. */
typedef struct {
    const char *name;
    double exponent;    /* of the error in the step size control */
    double growth;      /* largest growth of the step */
    double smoothing;   /* exponent of the last step's error there (Gustafsson): fewer rejections */
    int flags;
    int splits;         /* transitions located in one step at most; 0: all */
    int rows;           /* of cont that its dense output uses */
    /* try a step from (tau, y, f0); leave the end in y1; return the error in units of the tolerance (NaN: failed) */
    double (*attempt)(ts_sim *sim, double tau, double h);
    /* after acceptance: y1 has been put on the constraint; leave the derivative there in f1 */
    void (*accept)(ts_sim *sim, double tau, double h);
    /* dense output in rows 1.. of cont, row 0 being the step's start; only called when it is asked for */
    void (*densify)(ts_sim *sim, double tau, double h);
    /* components first..first+count-1 of y at tau + theta h, from cont alone */
    void (*interpolate)(const ts_sim *sim, double theta, int first, int count, double *out);
} ts_method;

#define TS_METHOD(NAME, name) extern const ts_method ts_##name;
TS_METHODS(TS_METHOD)
#undef TS_METHOD

/* curve.c */
ts_piece ts_piece_of(int kind, double lo, double hi, int snapped);
double ts_polynomial(const double *coef, double t);
double ts_piece_force(const ts_piece *p, const double *table, double reach, double x, double k, double *stiffness);
double ts_piece_energy(const ts_piece *p, const double *table, double reach, double x, double k);
double ts_piece_integrate(const ts_piece *p, double *table, double energy);
double ts_row_width(const ts_piece *p, int row, double *begin);
double ts_fit_row(double (*force)(void *, double), void *law, double a, double w, double *row);
void ts_curve_chain(ts_curve *c);
double ts_curve_force(const ts_curve *c, int piece, double x, double k, double *stiffness);
double ts_curve_energy(const ts_curve *c, int piece, double x, double k);
void ts_curve_free(ts_curve *c);
int ts_curve_piece(const ts_curve *c, double x);
int ts_curve_walk(const ts_curve *c, int piece, double x, double guard, double *loss);

/* nsh.c */
int ts_nsh_curve(ts_curve *c, int n, const double *Q, const double *zeta, const double *h);

/* curves.c */
int ts_has_memory(const ts_model *m, int string);
const char *ts_curves_build(ts_sim *sim);
void ts_curves_free(ts_sim *sim);
const char *ts_dampers_build(ts_sim *sim);
void ts_dampers_free(ts_sim *sim);
double ts_damping_law(const ts_sim *sim, int string, double rate, double *slope);

/* model.c */
uint64_t ts_fnv(const void *bytes, size_t size);
int ts_model_read(ts_sim *sim, const void *bytes, size_t size, char *message, size_t capacity);
void ts_model_free(ts_sim *sim);

/* motion.c */
void ts_prepare(ts_sim *sim);
void ts_bear(ts_sim *sim, int string);
void ts_rhs(ts_sim *sim, double tau, const double *y, double *dy);
void ts_forces(ts_sim *sim, double tau, const double *y, double *Q);
void ts_power(ts_sim *sim, double tau, const double *y, double p[TS_LEDGER]);
void ts_string_state(const ts_sim *sim, double tau, const double *y, int string, double *gap, double *rate);
double ts_tension(const ts_sim *sim, int string, double gap, double rate, double *elastic);
double ts_rest_length(const ts_sim *sim, int string, double tau);
double ts_rest_rate(const ts_sim *sim, int string, double tau);
int ts_sloped(const ts_sim *sim);
void ts_project(const ts_sim *sim, double *y);
void ts_project_block(const ts_sim *sim, double *y, int block);
void ts_error_norms(const ts_sim *sim, const double *e, const double *e2, const double *y0, const double *y1, double *n, double *n2);
double ts_error_norm(const ts_sim *sim, const double *e, const double *y0, const double *y1);

/* jacobian.c */
void ts_rhs_jacobian(ts_sim *sim, double tau, const double *y);
void ts_damping_jacobian(ts_sim *sim, double tau, const double *y);

/* linear.c */
int ts_stage_factorise(ts_sim *sim, double a);
void ts_stage_solve(ts_sim *sim, double a, double *U);
int ts_pair_factorise(ts_sim *sim, int which, double a, double b);
void ts_pair_solve(ts_sim *sim, int which, double a, double b, double *Ur, double *Ui);

/* drives.c */
void ts_drive(ts_sim *sim);
void ts_weigh(ts_sim *sim);
void ts_move_bases(ts_sim *sim, double tau);
void ts_base_at(const ts_sim *sim, double tau, int mover, double *x, double *v);
void ts_jump_bases(ts_sim *sim, const double *values, const double *slopes, double tau);
void ts_wind(ts_sim *sim, const double *y);
double ts_wound(const ts_sim *sim, const double *y, int string);
void ts_drag(ts_sim *sim, double *force);
void ts_carry(const ts_sim *sim, double *Q);
void ts_motors(const ts_sim *sim, double tau, const double *v, double *Q);
void ts_drive_rates(const ts_sim *sim, double tau, const double *v, const double *a, double *p);
void ts_drive_jacobian(ts_sim *sim, double tau);
int ts_inputs_move(const ts_sim *sim);
int ts_wound_up(const ts_sim *sim);

/* events.c */
void ts_place(ts_sim *sim, int string, int piece);
double ts_place_all(ts_sim *sim);
double ts_first_transition(ts_sim *sim, const ts_method *method, double tau, double h, int *which, int *doubtful);
void ts_switch(ts_sim *sim, double tau, int which);
void ts_catch_up(ts_sim *sim, double tau);

/* outputs.c */
void ts_outputs(ts_sim *sim, double tau);
void ts_tangent_outputs(ts_sim *sim, double tau, double *out);
double ts_stored_energy(const ts_sim *sim, double tau);
double ts_kinetic_energy(const ts_sim *sim);
double ts_clipped_energy(const ts_sim *sim, double tau);

/* integrate.c */
int ts_integrate(ts_sim *sim, double h, int may_run_ahead);
int ts_span_serves(const ts_sim *sim, double h);
void ts_serve_span(ts_sim *sim, double h);
void ts_close_span(ts_sim *sim);
void ts_recall(ts_sim *sim);
void ts_clear_scratch(const ts_sim *sim, ts_memory *memory, char *ahead);
int ts_fixed_step(int method);

/* auto.c */
void ts_start_choice(ts_sim *sim);
int ts_choice_is_possible(const ts_sim *sim);
void ts_review_step(ts_sim *sim, double h);
void ts_review_rejection(ts_sim *sim);
void ts_review_restart(ts_sim *sim, double tau, double h);

#endif
