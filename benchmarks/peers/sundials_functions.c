#include "sundials_functions.h"

#include <stdlib.h>
#include <string.h>

void sundials_open(sundials *s, peer *p)
{
    s->p = p;
    SUNContext_Create(NULL, &s->context);
    s->x = N_VNew_Serial(p->n, s->context);
    N_VEnableFusedOps_Serial(s->x, p->events != PEER_PLAIN);
    sundials_start(s);
}

void sundials_start(sundials *s) { memcpy(N_VGetArrayPointer(s->x), s->p->start, sizeof(double) * (size_t)s->p->n); }

void sundials_dense(sundials *s)
{
    s->matrix = SUNDenseMatrix(s->p->n, s->p->n, s->context);
    s->linear = SUNLinSol_Dense(s->x, s->matrix, s->context);
}

void sundials_close(sundials *s)
{
    if (s->linear) SUNLinSolFree(s->linear);
    if (s->matrix) SUNMatDestroy(s->matrix);
    N_VDestroy(s->x);
    SUNContext_Free(&s->context);
    free(s->found);
    free(s);
}

int sundials_run(sundials *s, double *rows, int (*advance)(void *solver, double end, realtype *t),
                 void (*go_on)(void *solver, double t))
{
    peer *p = s->p;
    realtype t = 0.0;
    for (int k = 1; k <= p->instants; k++) {
        double end = k * p->duration / p->instants;
        while (end - t > PEER_TOGETHER * p->duration) {
            int status = advance(s, end, &t);
            if (status < 0) return status;
            if (status == 0) break;
            peer_switch(p, N_VGetArrayPointer(s->x), s->found);
            go_on(s, t);
        }
        memcpy(rows + (k - 1) * p->n, N_VGetArrayPointer(s->x), sizeof(double) * (size_t)p->n);
    }
    return 0;
}

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
