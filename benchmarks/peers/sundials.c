/* SUNDIALS: CVODE (Hindmarsh et al., "SUNDIALS: Suite of Nonlinear and Differential/Algebraic Equation Solvers", ACM TOMS 31,
 * 2005, DOI 10.1145/1089014.1089020), BDF with Newton, dense LU and the analytic Jacobian, or Adams with fixed-point iteration;
 * ARKODE (Reynolds, Gardner, Woodward, Chinomona, "ARKODE: A Flexible IVP Solver Infrastructure for One-step Methods", ACM
 * TOMS 49, 2023, DOI 10.1145/3594632), explicit Runge-Kutta methods (ERKStep), and diagonally implicit ones (ARKStep) with
 * Newton, dense LU and the analytic Jacobian.
 *
 * After a transition CVODE starts anew at order one with its own estimate of the step; a share of the last step instead made
 * no difference.  ARKODE is reset, which keeps its step size: a one-step method needs no cautious start, and the error test
 * mends a step that is too long.  Steps go past an output instant and are interpolated back to it.  These were faster here
 * than fresh starts and than stops at the instants.  The plain set-up of ARKODE is its own table of an order, started anew
 * after each transition. */
#include "peer.h"

#include <arkode/arkode_arkstep.h>
#include <arkode/arkode_erkstep.h>
#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <stdlib.h>
#include <string.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#define MAX_STEPS 5000000 /* between two output instants */
#define MAX_ORDER 1       /* predictors of the stages: extrapolation of highest order, */
#define BOOTSTRAP 4       /* and from the step's start and its stages */

#if CV_ROOT_RETURN != ARK_ROOT_RETURN || CV_NORMAL != ARK_NORMAL
#error "CVODE and ARKODE no longer say the same"
#endif

/* What CVODE, ERKStep and ARKStep have alike. */
typedef struct {
    int (*evolve)(void *memory, realtype end, N_Vector x, realtype *t, int task);
    int (*anew)(void *memory, realtype t, N_Vector x);  /* which clears the counters */
    int (*reset)(void *memory, realtype t, N_Vector x); /* which does not; NULL: not used */
    int (*root_info)(void *memory, int *found);
    int (*count_steps)(void *memory, long *steps);
    int (*count_failed)(void *memory, long *failed);
    int (*set_user)(void *memory, void *user);
    int (*set_tolerances)(void *memory, realtype relative, realtype absolute);
    int (*set_max_steps)(void *memory, long most);
    int (*set_roots)(void *memory, int count, ARKRootFn g);
    int (*set_directions)(void *memory, int *direction);
    int (*set_no_warning)(void *memory);
    void (*release)(void **memory);
} family;

typedef struct {
    peer *p;
    const family *call;
    SUNContext context;
    void *memory;
    N_Vector x;
    SUNMatrix matrix;
    SUNLinearSolver linear;
    SUNNonlinearSolver nonlinear;
    int *found; /* (roots) */
} solver;

/* The problem's functions in the form that SUNDIALS calls. */
static int rhs(realtype t, N_Vector x, N_Vector dx, void *user)
{
    (void)t;
    peer_rhs(user, N_VGetArrayPointer(x), N_VGetArrayPointer(dx));
    return 0;
}

static int jacobian(realtype t, N_Vector x, N_Vector dx, SUNMatrix J, void *user, N_Vector a, N_Vector b, N_Vector c)
{
    (void)t, (void)dx, (void)a, (void)b, (void)c;
    peer_jacobian(user, N_VGetArrayPointer(x), SUNDenseMatrix_Data(J));
    return 0;
}

static int distances(realtype t, N_Vector x, realtype *g, void *user)
{
    (void)t;
    peer_distances(user, N_VGetArrayPointer(x), g);
    return 0;
}

static int erk_anew(void *memory, realtype t, N_Vector x) { return ERKStepReInit(memory, rhs, t, x); }
static int dirk_anew(void *memory, realtype t, N_Vector x) { return ARKStepReInit(memory, NULL, rhs, t, x); }

#define FAMILY(X, EVOLVE, ANEW, RESET) \
    {EVOLVE,                           \
     ANEW,                             \
     RESET,                            \
     X##GetRootInfo,                   \
     X##GetNumSteps,                   \
     X##GetNumErrTestFails,            \
     X##SetUserData,                   \
     X##SStolerances,                  \
     X##SetMaxNumSteps,                \
     X##RootInit,                      \
     X##SetRootDirection,              \
     X##SetNoInactiveRootWarn,         \
     X##Free}

static const family cvode = FAMILY(CVode, CVode, CVodeReInit, NULL);
static const family erk = FAMILY(ERKStep, ERKStepEvolve, erk_anew, ERKStepReset);
static const family dirk = FAMILY(ARKStep, ARKStepEvolve, dirk_anew, ARKStepReset);

/* Implicit methods, each with the predictor that served it best here. */
static const struct {
    const char *table;
    int predictor;
} implicit_methods[] = {
    {"ARKODE_ESDIRK436L2SA_6_3_4", MAX_ORDER},
    {"ARKODE_ESDIRK547L2SA2_7_4_5", BOOTSTRAP},
    {"ARKODE_KVAERNO_7_4_5", MAX_ORDER},
};

/* An explicit table by name.  Where the last stage stands at the end of the step without being its result, ERKStep of
 * SUNDIALS 6.4 takes that stage's derivative for the derivative at the end, and the order is lost.  A further stage that is
 * the result avoids this at no cost: its derivative is the next step's first. */
static ARKodeButcherTable explicit_table(const char *name)
{
    ARKodeButcherTable t = ARKodeButcherTable_LoadERKByName(name);
    if (!t || t->c[t->stages - 1] != 1.0 || !memcmp(t->A[t->stages - 1], t->b, sizeof(double) * (size_t)t->stages)) return t;
    ARKodeButcherTable longer = ARKodeButcherTable_Alloc(t->stages + 1, SUNTRUE);
    longer->q = t->q;
    longer->p = t->p;
    for (int i = 0; i < t->stages; i++) {
        memcpy(longer->A[i], t->A[i], sizeof(double) * (size_t)t->stages);
        longer->A[t->stages][i] = longer->b[i] = t->b[i];
        longer->d[i] = t->d[i];
        longer->c[i] = t->c[i];
    }
    longer->c[t->stages] = 1.0;
    ARKodeButcherTable_Free(t);
    return longer;
}

static void make_dense(solver *s)
{
    s->matrix = SUNDenseMatrix(s->p->n, s->p->n, s->context);
    s->linear = SUNLinSol_Dense(s->x, s->matrix, s->context);
}

static int set_up_cvode(solver *s, const char *name)
{
    int bdf = !strcmp(name, "bdf");
    if (!bdf && strcmp(name, "adams")) return 0;
    s->call = &cvode;
    s->memory = CVodeCreate(bdf ? CV_BDF : CV_ADAMS, s->context);
    CVodeInit(s->memory, rhs, 0.0, s->x);
    if (!bdf) {
        s->nonlinear = SUNNonlinSol_FixedPoint(s->x, 0, s->context);
        return CVodeSetNonlinearSolver(s->memory, s->nonlinear) == 0;
    }
    make_dense(s);
    CVodeSetLinearSolver(s->memory, s->linear, s->matrix);
    return CVodeSetJacFn(s->memory, jacobian) == 0;
}

static int is_order(const char *name) { return name[0] >= '2' && name[0] <= '9' && !name[1]; }

static int set_up_explicit(solver *s, const char *name)
{
    ARKodeButcherTable table = is_order(name) ? NULL : explicit_table(name);
    if (!table && !is_order(name)) return 0;
    s->call = &erk;
    s->memory = ERKStepCreate(rhs, 0.0, s->x, s->context);
    if (!table) return ERKStepSetOrder(s->memory, name[0] - '0') == 0;
    int status = ERKStepSetTable(s->memory, table);
    ARKodeButcherTable_Free(table);
    return status == 0;
}

static int set_up_implicit(solver *s, const char *name)
{
    size_t m = 0, count = sizeof implicit_methods / sizeof *implicit_methods;
    while (m < count && strcmp(name, implicit_methods[m].table)) m++;
    if (m == count && !is_order(name)) return 0;
    s->call = &dirk;
    s->memory = ARKStepCreate(NULL, rhs, 0.0, s->x, s->context);
    make_dense(s);
    ARKStepSetLinearSolver(s->memory, s->linear, s->matrix);
    ARKStepSetJacFn(s->memory, jacobian);
    if (m == count) return ARKStepSetOrder(s->memory, name[0] - '0') == 0;
    ARKStepSetPredictorMethod(s->memory, implicit_methods[m].predictor);
    return ARKStepSetTableName(s->memory, name, "ARKODE_ERK_NONE") == 0;
}

static void set_up_common(solver *s, double tolerance)
{
    const family *call = s->call;
    peer *p = s->p;
    call->set_tolerances(s->memory, tolerance, tolerance);
    call->set_user(s->memory, p);
    call->set_max_steps(s->memory, MAX_STEPS);
    if (!p->events) return;
    s->found = calloc((size_t)p->roots, sizeof(int));
    call->set_roots(s->memory, p->roots, distances);
    call->set_no_warning(s->memory);
    if (p->events == PEER_PLAIN) return;
    int *outward = calloc((size_t)p->roots, sizeof(int)); /* only out of the piece, from plus to minus; it is copied */
    for (int r = 0; r < p->roots; r++) outward[r] = -1;
    call->set_directions(s->memory, outward);
    free(outward);
}

static void release(void *self)
{
    solver *s = self;
    if (s->call) s->call->release(&s->memory);
    if (s->nonlinear) SUNNonlinSolFree(s->nonlinear);
    if (s->linear) SUNLinSolFree(s->linear);
    if (s->matrix) SUNMatDestroy(s->matrix);
    N_VDestroy(s->x);
    SUNContext_Free(&s->context);
    free(s->found);
    free(s);
}

static void set_start(solver *s) { memcpy(N_VGetArrayPointer(s->x), s->p->start, sizeof(double) * (size_t)s->p->n); }

/* method: cvode_bdf or cvode_adams; erk_ or dirk_, and the name of ARKODE's Butcher table or an order */
static void *make(peer *p, const char *method, double tolerance)
{
    static const struct {
        const char *prefix;
        int (*set_up)(solver *s, const char *name);
    } kinds[] = {{"cvode_", set_up_cvode}, {"erk_", set_up_explicit}, {"dirk_", set_up_implicit}};
    solver *s = calloc(1, sizeof *s);
    s->p = p;
    SUNContext_Create(NULL, &s->context);
    s->x = N_VNew_Serial(p->n, s->context);
    N_VEnableFusedOps_Serial(s->x, p->events != PEER_PLAIN);
    set_start(s);
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        size_t length = strlen(kinds[k].prefix);
        if (strncmp(method, kinds[k].prefix, length) || !kinds[k].set_up(s, method + length)) continue;
        set_up_common(s, tolerance);
        return s;
    }
    release(s);
    return NULL;
}

static int begin(void *self)
{
    solver *s = self;
    peer_begin(s->p);
    set_start(s);
    return s->call->anew(s->memory, 0.0, s->x);
}

static void add_counts(solver *s)
{
    long steps = 0, failed = 0;
    s->call->count_steps(s->memory, &steps);
    s->call->count_failed(s->memory, &failed);
    s->p->counts.steps += steps;
    s->p->counts.rejected += failed;
}

static void go_on_after_transition(solver *s, double t)
{
    s->call->root_info(s->memory, s->found);
    peer_switch(s->p, N_VGetArrayPointer(s->x), s->found);
    if (s->call->reset && s->p->events != PEER_PLAIN) {
        s->call->reset(s->memory, t, s->x);
        return;
    }
    add_counts(s);
    s->call->anew(s->memory, t, s->x);
}

static int run(void *self, double *rows)
{
    solver *s = self;
    peer *p = s->p;
    realtype t = 0.0;
    for (int k = 1; k <= p->instants; k++) {
        double end = k * p->duration / p->instants;
        while (end - t > PEER_TOGETHER * p->duration) {
            int status = s->call->evolve(s->memory, end, s->x, &t, CV_NORMAL);
            if (status < 0) return status;
            if (status != CV_ROOT_RETURN) break;
            go_on_after_transition(s, t);
        }
        memcpy(rows + (k - 1) * p->n, N_VGetArrayPointer(s->x), sizeof(double) * (size_t)p->n);
    }
    add_counts(s);
    return 0;
}

const peer_solver peer_sundials = {"", make, begin, run, release};
