/* SUNDIALS CVODE (Hindmarsh et al., "SUNDIALS: Suite of Nonlinear and Differential/Algebraic Equation Solvers", ACM TOMS 31,
 * 2005, DOI 10.1145/1089014.1089020): BDF with Newton, dense LU and the analytic Jacobian; Adams with fixed-point iteration.
 *
 * After a transition it starts anew at order one with its own estimate of the step; a share of the last step instead made no
 * difference.  Steps go past an output instant and are interpolated back to it, which costs nothing. */
#include "sundials_functions.h"

#include <cvode/cvode.h>
#include <stdlib.h>
#include <string.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

typedef struct {
    sundials s;
    SUNNonlinearSolver nonlinear;
} solver;

static void set_up_newton(sundials *s)
{
    sundials_dense(s);
    CVodeSetLinearSolver(s->memory, s->linear, s->matrix);
    CVodeSetJacFn(s->memory, sundials_jacobian);
}

static void set_up_fixed_point(solver *s)
{
    s->nonlinear = SUNNonlinSol_FixedPoint(s->s.x, 0, s->s.context);
    CVodeSetNonlinearSolver(s->s.memory, s->nonlinear);
}

static void set_up_roots(sundials *s)
{
    s->found = calloc((size_t)s->p->roots, sizeof(int));
    CVodeRootInit(s->memory, s->p->roots, sundials_distances);
    CVodeSetNoInactiveRootWarn(s->memory);
    if (s->p->events == PEER_PLAIN) return;
    int *outward = sundials_outward(s->p->roots);
    CVodeSetRootDirection(s->memory, outward);
    free(outward);
}

static void *make(peer *p, const char *method, double tolerance)
{
    int bdf = !strcmp(method, "cvode_bdf"), adams = !strcmp(method, "cvode_adams");
    if (!bdf && !adams) return NULL;
    solver *made = calloc(1, sizeof *made);
    sundials *s = &made->s;
    sundials_open(s, p);
    s->memory = CVodeCreate(bdf ? CV_BDF : CV_ADAMS, s->context);
    CVodeInit(s->memory, sundials_rhs, 0.0, s->x);
    CVodeSStolerances(s->memory, tolerance, tolerance);
    CVodeSetUserData(s->memory, p);
    CVodeSetMaxNumSteps(s->memory, SUNDIALS_MAX_STEPS);
    if (bdf) set_up_newton(s);
    else set_up_fixed_point(made);
    if (p->events) set_up_roots(s);
    return made;
}

static int begin(void *self)
{
    sundials *s = self;
    peer_begin(s->p);
    sundials_start(s);
    return CVodeReInit(s->memory, 0.0, s->x);
}

/* CVodeReInit() clears the counters: add them up before. */
static void add_counts(sundials *s)
{
    long steps = 0, failed = 0;
    CVodeGetNumSteps(s->memory, &steps);
    CVodeGetNumErrTestFails(s->memory, &failed);
    s->p->counts.steps += steps;
    s->p->counts.rejected += failed;
}

static int advance(void *self, double end, realtype *t)
{
    sundials *s = self;
    int status = CVode(s->memory, end, s->x, t, CV_NORMAL);
    if (status == CV_ROOT_RETURN) CVodeGetRootInfo(s->memory, s->found);
    return status < 0 ? status : status == CV_ROOT_RETURN;
}

static void go_on(void *self, double t)
{
    sundials *s = self;
    add_counts(s);
    CVodeReInit(s->memory, t, s->x);
}

static int run(void *self, double *rows)
{
    int status = sundials_run(self, rows, advance, go_on);
    if (status == 0) add_counts(self);
    return status;
}

static void release(void *self)
{
    solver *s = self;
    CVodeFree(&s->s.memory);
    if (s->nonlinear) SUNNonlinSolFree(s->nonlinear);
    sundials_close(&s->s);
}

const peer_solver peer_cvode = {"cvode_", make, begin, run, release};
