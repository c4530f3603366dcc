/* SUNDIALS ARKODE (Reynolds, Gardner, Woodward, Chinomona, "ARKODE: A Flexible IVP Solver Infrastructure for One-step
 * Methods", ACM TOMS 49, 2023, DOI 10.1145/3594632): explicit Runge-Kutta methods (ERKStep), and diagonally implicit ones
 * (ARKStep) with Newton, dense LU and the analytic Jacobian.
 *
 * After a transition the solver is reset, which keeps its step size: a one-step method needs no cautious start, and the error
 * test mends a step that is too long.  Steps go past an output instant and are interpolated back to it.  Both were faster
 * here than a fresh start and than stops at the instants.  The plain set-up is ARKODE's own table of an order, started anew
 * after each transition. */
#include "peer.h"
#include "sundials_functions.h"

#include <arkode/arkode_arkstep.h>
#include <arkode/arkode_erkstep.h>
#include <stdlib.h>
#include <string.h>
#include <sunlinsol/sunlinsol_dense.h>

#define MAX_ORDER 1 /* predictors of the stages: extrapolation of highest order, */
#define BOOTSTRAP 4 /* and from the step's start and its stages */

/* What ERKStep and ARKStep have alike. */
typedef struct {
    int (*evolve)(void *memory, realtype end, N_Vector x, realtype *t, int task);
    int (*reset)(void *memory, realtype t, N_Vector x);
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

#define FAMILY(X)                                                                                                       \
    {X##Evolve,       X##Reset,          X##GetRootInfo, X##GetNumSteps,      X##GetNumErrTestFails,    X##SetUserData, \
     X##SStolerances, X##SetMaxNumSteps, X##RootInit,    X##SetRootDirection, X##SetNoInactiveRootWarn, X##Free}

static const family erk = FAMILY(ERKStep), dirk = FAMILY(ARKStep);

/* Implicit methods, each with the predictor that served it best here. */
static const struct {
    const char *table;
    int predictor;
} implicit_methods[] = {
    {"ARKODE_ESDIRK436L2SA_6_3_4", MAX_ORDER},
    {"ARKODE_ESDIRK547L2SA2_7_4_5", BOOTSTRAP},
    {"ARKODE_KVAERNO_7_4_5", MAX_ORDER},
};

typedef struct {
    peer *p;
    const family *call;
    SUNContext context;
    void *memory;
    N_Vector x;
    SUNMatrix matrix;
    SUNLinearSolver linear;
    int *found;
} solver;

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

static int is_order(const char *name) { return name[0] >= '2' && name[0] <= '9' && !name[1]; }

static int set_up_explicit(solver *s, const char *name)
{
    ARKodeButcherTable table = is_order(name) ? NULL : explicit_table(name);
    if (!table && !is_order(name)) return 0;
    s->call = &erk;
    s->memory = ERKStepCreate(sundials_rhs, 0.0, s->x, s->context);
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
    s->memory = ARKStepCreate(NULL, sundials_rhs, 0.0, s->x, s->context);
    s->matrix = SUNDenseMatrix(s->p->n, s->p->n, s->context);
    s->linear = SUNLinSol_Dense(s->x, s->matrix, s->context);
    ARKStepSetLinearSolver(s->memory, s->linear, s->matrix);
    ARKStepSetJacFn(s->memory, sundials_jacobian);
    if (m == count) return ARKStepSetOrder(s->memory, name[0] - '0') == 0;
    ARKStepSetPredictorMethod(s->memory, implicit_methods[m].predictor);
    return ARKStepSetTableName(s->memory, name, "ARKODE_ERK_NONE") == 0;
}

static void set_up_common(solver *s, double tolerance)
{
    s->call->set_tolerances(s->memory, tolerance, tolerance);
    s->call->set_user(s->memory, s->p);
    s->call->set_max_steps(s->memory, SUNDIALS_MAX_STEPS);
    if (!s->p->events) return;
    s->found = calloc((size_t)s->p->roots, sizeof(int));
    s->call->set_roots(s->memory, s->p->roots, sundials_distances);
    s->call->set_no_warning(s->memory);
    if (s->p->events == PEER_PLAIN) return;
    int *outward = sundials_outward(s->p->roots);
    s->call->set_directions(s->memory, outward);
    free(outward);
}

static void release(void *self)
{
    solver *s = self;
    if (s->call) s->call->release(&s->memory);
    if (s->linear) SUNLinSolFree(s->linear);
    if (s->matrix) SUNMatDestroy(s->matrix);
    N_VDestroy(s->x);
    SUNContext_Free(&s->context);
    free(s->found);
    free(s);
}

static void set_start(solver *s) { memcpy(N_VGetArrayPointer(s->x), s->p->start, sizeof(double) * (size_t)s->p->n); }

/* method: erk_ or dirk_, and the name of ARKODE's Butcher table or an order */
static void *make(peer *p, const char *method, double tolerance)
{
    solver *s = calloc(1, sizeof *s);
    s->p = p;
    SUNContext_Create(NULL, &s->context);
    s->x = N_VNew_Serial(p->n, s->context);
    N_VEnableFusedOps_Serial(s->x, p->events != PEER_PLAIN);
    set_start(s);
    if (strncmp(method, "erk_", 4) ? set_up_implicit(s, method + 5) : set_up_explicit(s, method + 4)) {
        set_up_common(s, tolerance);
        return s;
    }
    release(s);
    return NULL;
}

static int start_anew(solver *s, double t)
{
    if (s->call == &erk) return ERKStepReInit(s->memory, sundials_rhs, t, s->x);
    return ARKStepReInit(s->memory, NULL, sundials_rhs, t, s->x);
}

static int begin(void *self)
{
    solver *s = self;
    peer_begin(s->p);
    set_start(s);
    return start_anew(s, 0.0);
}

/* A fresh start clears the counters, a reset does not. */
static void add_counts(solver *s)
{
    long steps = 0, failed = 0;
    s->call->count_steps(s->memory, &steps);
    s->call->count_failed(s->memory, &failed);
    s->p->counts.steps += steps;
    s->p->counts.rejected += failed;
}

static void go_on(solver *s, double t)
{
    if (s->p->events == PEER_PLAIN) {
        add_counts(s);
        start_anew(s, t);
    } else {
        s->call->reset(s->memory, t, s->x);
    }
}

static int run(void *self, double *rows)
{
    solver *s = self;
    peer *p = s->p;
    realtype t = 0.0;
    for (int k = 1; k <= p->instants; k++) {
        double end = k * p->duration / p->instants;
        while (end - t > PEER_TOGETHER * p->duration) {
            int status = s->call->evolve(s->memory, end, s->x, &t, ARK_NORMAL);
            if (status < 0) return status;
            if (status != ARK_ROOT_RETURN) break;
            s->call->root_info(s->memory, s->found);
            peer_switch(p, N_VGetArrayPointer(s->x), s->found);
            go_on(s, t);
        }
        memcpy(rows + (k - 1) * p->n, N_VGetArrayPointer(s->x), sizeof(double) * (size_t)p->n);
    }
    add_counts(s);
    return 0;
}

const peer_solver peer_erk = {"erk_", make, begin, run, release};
const peer_solver peer_dirk = {"dirk_", make, begin, run, release};
