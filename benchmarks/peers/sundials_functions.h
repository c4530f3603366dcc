/* What CVODE and ARKODE have alike: the problem's functions in the form that they call, and the loop over output instants. */
#ifndef PEER_SUNDIALS_H
#define PEER_SUNDIALS_H

#include "peer.h"

#include <nvector/nvector_serial.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>

#define SUNDIALS_MAX_STEPS 5000000 /* between two output instants */

/* First in the struct of a solver. */
typedef struct {
    peer *p;
    SUNContext context;
    void *memory;
    N_Vector x;
    SUNMatrix matrix;
    SUNLinearSolver linear;
    int *found; /* (roots) */
} sundials;

void sundials_open(sundials *s, peer *p);
void sundials_start(sundials *s); /* x as at the start */
void sundials_dense(sundials *s); /* a dense matrix and its LU */
void sundials_close(sundials *s); /* but for the memory, which comes first; frees the struct too */

/* advance: integrates towards an instant; 1 where a root stopped it, with `found`, negative: failed.  go_on: beyond the root. */
int sundials_run(sundials *s, double *rows, int (*advance)(void *solver, double end, realtype *t),
                 void (*go_on)(void *solver, double t));

int sundials_rhs(realtype t, N_Vector x, N_Vector dx, void *user);
int sundials_jacobian(realtype t, N_Vector x, N_Vector dx, SUNMatrix J, void *user, N_Vector a, N_Vector b, N_Vector c);
int sundials_distances(realtype t, N_Vector x, realtype *g, void *user);
int *sundials_outward(int roots); /* (roots) directions: only out of the piece, from plus to minus; copied by the solvers */

#endif
