/* SUNDIALS CVODE (Hindmarsh et al., "SUNDIALS: Suite of Nonlinear and Differential/Algebraic Equation Solvers", ACM TOMS 31,
 * 2005, DOI 10.1145/1089014.1089020): BDF with Newton, dense LU and the analytic Jacobian; Adams with fixed-point iteration.
 *
 * After a transition it starts anew at order one with its own estimate of the step; a share of the last step instead made no
 * difference.  Steps go past an output instant and are interpolated back to it, which costs nothing. */
#include "peer.h"
#include "sundials_functions.h"

#include <cvode/cvode.h>
#include <stdlib.h>
#include <string.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

typedef struct {
    peer *p;
    SUNContext context;
    void *memory;
    N_Vector x;
    SUNMatrix matrix;
    SUNLinearSolver linear;
    SUNNonlinearSolver nonlinear;
    int *found;
} solver;

static void set_up_newton(solver *s)
{
    s->matrix = SUNDenseMatrix(s->p->n, s->p->n, s->context);
    s->linear = SUNLinSol_Dense(s->x, s->matrix, s->context);
    CVodeSetLinearSolver(s->memory, s->linear, s->matrix);
    CVodeSetJacFn(s->memory, sundials_jacobian);
}

static void set_up_fixed_point(solver *s)
{
    s->nonlinear = SUNNonlinSol_FixedPoint(s->x, 0, s->context);
    CVodeSetNonlinearSolver(s->memory, s->nonlinear);
}

static void set_up_roots(solver *s)
{
    s->found = calloc((size_t)s->p->roots, sizeof(int));
    CVodeRootInit(s->memory, s->p->roots, sundials_distances);
    CVodeSetNoInactiveRootWarn(s->memory);
    if (s->p->events == PEER_PLAIN) return;
    int *outward = sundials_outward(s->p->roots);
    CVodeSetRootDirection(s->memory, outward);
    free(outward);
}

static void set_start(solver *s) { memcpy(N_VGetArrayPointer(s->x), s->p->start, sizeof(double) * (size_t)s->p->n); }

static void *make(peer *p, const char *method, double tolerance)
{
    int bdf = !strcmp(method, "cvode_bdf"), adams = !strcmp(method, "cvode_adams");
    if (!bdf && !adams) return NULL;
    solver *s = calloc(1, sizeof *s);
    s->p = p;
    SUNContext_Create(NULL, &s->context);
    s->x = N_VNew_Serial(p->n, s->context);
    N_VEnableFusedOps_Serial(s->x, p->events != PEER_PLAIN);
    set_start(s);
    s->memory = CVodeCreate(bdf ? CV_BDF : CV_ADAMS, s->context);
    CVodeInit(s->memory, sundials_rhs, 0.0, s->x);
    CVodeSStolerances(s->memory, tolerance, tolerance);
    CVodeSetUserData(s->memory, p);
    CVodeSetMaxNumSteps(s->memory, SUNDIALS_MAX_STEPS);
    if (bdf) set_up_newton(s);
    else set_up_fixed_point(s);
    if (p->events) set_up_roots(s);
    return s;
}

static int begin(void *self)
{
    solver *s = self;
    peer_begin(s->p);
    set_start(s);
    return CVodeReInit(s->memory, 0.0, s->x);
}

/* CVodeReInit() clears the counters: add them up before. */
static void add_counts(solver *s)
{
    long steps = 0, failed = 0;
    CVodeGetNumSteps(s->memory, &steps);
    CVodeGetNumErrTestFails(s->memory, &failed);
    s->p->counts.steps += steps;
    s->p->counts.rejected += failed;
}

static int run(void *self, double *rows)
{
    solver *s = self;
    peer *p = s->p;
    realtype t = 0.0;
    for (int k = 1; k <= p->instants; k++) {
        double end = k * p->duration / p->instants;
        while (end - t > PEER_TOGETHER * p->duration) {
            int status = CVode(s->memory, end, s->x, &t, CV_NORMAL);
            if (status < 0) return status;
            if (status != CV_ROOT_RETURN) break;
            add_counts(s);
            CVodeGetRootInfo(s->memory, s->found);
            peer_switch(p, N_VGetArrayPointer(s->x), s->found);
            CVodeReInit(s->memory, t, s->x);
        }
        memcpy(rows + (k - 1) * p->n, N_VGetArrayPointer(s->x), sizeof(double) * (size_t)p->n);
    }
    add_counts(s);
    return 0;
}

static void release(void *self)
{
    solver *s = self;
    CVodeFree(&s->memory);
    if (s->linear) SUNLinSolFree(s->linear);
    if (s->matrix) SUNMatDestroy(s->matrix);
    if (s->nonlinear) SUNNonlinSolFree(s->nonlinear);
    N_VDestroy(s->x);
    SUNContext_Free(&s->context);
    free(s->found);
    free(s);
}

const peer_solver peer_cvode = {"cvode_", make, begin, run, release};
