/* Inline pieces that motion.c, jacobian.c and outputs.c share. */
#ifndef TENSEGRITY_KINEMATICS_H
#define TENSEGRITY_KINEMATICS_H

#include "fields.h"
#include "linear/pairs.h"
#include "model/data.h"
#include "model/model.h"

#include <math.h>

/* Call body(..., D) with D known to the compiler. */
#define DISPATCH(model, body, ...)                           \
    do {                                                     \
        if ((model)->count[TS_D] == 2) body(__VA_ARGS__, 2); \
        else body(__VA_ARGS__, 3);                           \
    } while (0)

ALWAYS_INLINE double dot(const double *a, const double *b, const int D)
{
    double sum = a[0] * b[0] + a[1] * b[1];
    return D == 3 ? sum + a[2] * b[2] : sum;
}

/* External force along axis d on a free node, counted among the free ones, from the values of the inputs or from their first or
 * second derivatives. */
ALWAYS_INLINE double external_force(const ts_model *m, const double *inputs, int free, int d)
{
    return inputs[m->at[TS_FORCE] + free * m->count[TS_D] + d];
}

/* Generalised external force, number i, at tau from the step's start (N). */
ALWAYS_INLINE double load_at(const ts_loads *loads, int i, double tau)
{
    return loads->Q[i] + (loads->rate[i] + 0.5 * loads->bend[i] * tau) * tau;
}

/* Work or power of an input into the ledger p. */
ALWAYS_INLINE void book(double *p, double done)
{
    p[1] += done;
    p[2] += fabs(done);
}

/* What the blocks have of a node's acceleration along axis d, from theirs; its base may have more. */
ALWAYS_INLINE double node_acceleration(const ts_model *m, const double *a, int node, int d)
{
    const int D = m->count[TS_D], centre = m->node.centre[node], block = m->node.block[node];
    return (centre < 0 ? 0.0 : a[centre * D + d]) + (block < 0 ? 0.0 : m->node.coef[node] * a[block * D + d]);
}

/* Vector of a line, a string or a segment of one, and its rate from the blocks. */
ALWAYS_INLINE void line_vector(const ts_model *m, const double *q, const double *v, int i, double *s, double *sd, const int D)
{
    const ts_term *t = m->string.term + 4 * i;
    for (int d = 0; d < D; d++) s[d] = m->string.s0[i * D + d], sd[d] = 0.0;
    for (int k = 0; k < m->string.term_count[i]; k++)
        for (int d = 0; d < D; d++) {
            s[d] += t[k].kappa * q[t[k].offset + d];
            sd[d] += t[k].kappa * v[t[k].offset + d];
        }
}

#endif
