/* The problem's functions in the form that CVODE and ARKODE call alike. */
#ifndef PEER_SUNDIALS_H
#define PEER_SUNDIALS_H

#include <nvector/nvector_serial.h>
#include <sunmatrix/sunmatrix_dense.h>

#define SUNDIALS_MAX_STEPS 5000000 /* between two output instants */

int sundials_rhs(realtype t, N_Vector x, N_Vector dx, void *user);
int sundials_jacobian(realtype t, N_Vector x, N_Vector dx, SUNMatrix J, void *user, N_Vector a, N_Vector b, N_Vector c);
int sundials_distances(realtype t, N_Vector x, realtype *g, void *user);
int *sundials_outward(int roots); /* (roots) directions: only out of the piece, from plus to minus; copied by the solvers */

#endif
