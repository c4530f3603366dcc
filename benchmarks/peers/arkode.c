/* SUNDIALS ARKODE (Reynolds, Gardner, Woodward, Chinomona, "ARKODE: A Flexible IVP Solver Infrastructure for One-step
 * Methods", ACM TOMS 49, 2023, DOI 10.1145/3594632): explicit Runge-Kutta methods (ERKStep), and diagonally implicit ones
 * (ARKStep) with Newton, dense LU and the analytic Jacobian.
 *
 * After a transition the solver is reset, which keeps its step size: a one-step method needs no cautious start, and the error
 * test mends a step that is too long.  Steps go past an output instant and are interpolated back to it.  Both were faster
 * here than a fresh start and than stops at the instants.  The plain set-up is ARKODE's own table of an order, started anew
 * after each transition. */
#include "sundials_functions.h"

#include <arkode/arkode_arkstep.h>
#include <arkode/arkode_erkstep.h>
#include <stdlib.h>
#include <string.h>

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
    sundials s;
    const family *call;
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
    s->s.memory = ERKStepCreate(sundials_rhs, 0.0, s->s.x, s->s.context);
    if (!table) return ERKStepSetOrder(s->s.memory, name[0] - '0') == 0;
    int status = ERKStepSetTable(s->s.memory, table);
    ARKodeButcherTable_Free(table);
    return status == 0;
}

static int set_up_implicit(solver *s, const char *name)
{
    size_t m = 0, count = sizeof implicit_methods / sizeof *implicit_methods;
    while (m < count && strcmp(name, implicit_methods[m].table)) m++;
    if (m == count && !is_order(name)) return 0;
    s->call = &dirk;
    s->s.memory = ARKStepCreate(NULL, sundials_rhs, 0.0, s->s.x, s->s.context);
    sundials_dense(&s->s);
    ARKStepSetLinearSolver(s->s.memory, s->s.linear, s->s.matrix);
    ARKStepSetJacFn(s->s.memory, sundials_jacobian);
    if (m == count) return ARKStepSetOrder(s->s.memory, name[0] - '0') == 0;
    ARKStepSetPredictorMethod(s->s.memory, implicit_methods[m].predictor);
    return ARKStepSetTableName(s->s.memory, name, "ARKODE_ERK_NONE") == 0;
}

static void set_up_common(solver *s, double tolerance)
{
    s->call->set_tolerances(s->s.memory, tolerance, tolerance);
    s->call->set_user(s->s.memory, s->s.p);
    s->call->set_max_steps(s->s.memory, SUNDIALS_MAX_STEPS);
    if (!s->s.p->events) return;
    s->s.found = calloc((size_t)s->s.p->roots, sizeof(int));
    s->call->set_roots(s->s.memory, s->s.p->roots, sundials_distances);
    s->call->set_no_warning(s->s.memory);
    if (s->s.p->events == PEER_PLAIN) return;
    int *outward = sundials_outward(s->s.p->roots);
    s->call->set_directions(s->s.memory, outward);
    free(outward);
}

static void release(void *self)
{
    solver *s = self;
    if (s->call) s->call->release(&s->s.memory);
    sundials_close(&s->s);
}

/* method: erk_ or dirk_, and the name of ARKODE's Butcher table or an order */
static void *make(peer *p, const char *method, double tolerance)
{
    solver *s = calloc(1, sizeof *s);
    sundials_open(&s->s, p);
    if (strncmp(method, "erk_", 4) ? set_up_implicit(s, method + 5) : set_up_explicit(s, method + 4)) {
        set_up_common(s, tolerance);
        return s;
    }
    release(s);
    return NULL;
}

static int start_anew(solver *s, double t)
{
    if (s->call == &erk) return ERKStepReInit(s->s.memory, sundials_rhs, t, s->s.x);
    return ARKStepReInit(s->s.memory, NULL, sundials_rhs, t, s->s.x);
}

static int begin(void *self)
{
    solver *s = self;
    peer_begin(s->s.p);
    sundials_start(&s->s);
    return start_anew(s, 0.0);
}

/* A fresh start clears the counters, a reset does not. */
static void add_counts(solver *s)
{
    long steps = 0, failed = 0;
    s->call->count_steps(s->s.memory, &steps);
    s->call->count_failed(s->s.memory, &failed);
    s->s.p->counts.steps += steps;
    s->s.p->counts.rejected += failed;
}

static void go_on(void *self, double t)
{
    solver *s = self;
    if (s->s.p->events == PEER_PLAIN) {
        add_counts(s);
        start_anew(s, t);
    } else {
        s->call->reset(s->s.memory, t, s->s.x);
    }
}

static int advance(void *self, double end, realtype *t)
{
    solver *s = self;
    int status = s->call->evolve(s->s.memory, end, s->s.x, t, ARK_NORMAL);
    if (status == ARK_ROOT_RETURN) s->call->root_info(s->s.memory, s->s.found);
    return status < 0 ? status : status == ARK_ROOT_RETURN;
}

static int run(void *self, double *rows)
{
    int status = sundials_run(self, rows, advance, go_on);
    if (status == 0) add_counts(self);
    return status;
}

const peer_solver peer_erk = {"erk_", make, begin, run, release};
const peer_solver peer_dirk = {"dirk_", make, begin, run, release};
