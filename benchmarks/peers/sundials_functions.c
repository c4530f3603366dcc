#include "sundials_functions.h"
#include "peer.h"

#include <stdlib.h>

int sundials_rhs(realtype t, N_Vector x, N_Vector dx, void *user)
{
    (void)t;
    peer_rhs(user, N_VGetArrayPointer(x), N_VGetArrayPointer(dx));
    return 0;
}

int sundials_jacobian(realtype t, N_Vector x, N_Vector dx, SUNMatrix J, void *user, N_Vector a, N_Vector b, N_Vector c)
{
    (void)t, (void)dx, (void)a, (void)b, (void)c;
    peer_jacobian(user, N_VGetArrayPointer(x), SUNDenseMatrix_Data(J));
    return 0;
}

int sundials_distances(realtype t, N_Vector x, realtype *g, void *user)
{
    (void)t;
    peer_distances(user, N_VGetArrayPointer(x), g);
    return 0;
}

int *sundials_outward(int roots)
{
    int *direction = calloc((size_t)roots, sizeof(int));
    for (int r = 0; r < roots; r++) direction[r] = -1;
    return direction;
}
