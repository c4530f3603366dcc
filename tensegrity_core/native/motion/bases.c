/* Where moved nodes and the ground are, and how they move, over a step. */
#include "motion/bases.h"
#include "model/data.h"
#include "model/model.h"

#include <string.h>

static double first_nonzero(double a, double b, double c) { return a != 0.0 ? a : b != 0.0 ? b : c; }

/* Position of a moved node and its derivatives at the step's start; a derivative of an input takes the place of the input that
 * is meant to be that. */
void ts_base_polynomial(const ts_model *m, const double *values, const double *slopes, int e, double *out)
{
    int D = m->count[TS_D];
    const double *bends = slopes + m->n_inputs;
    for (int d = 0; d < D; d++) {
        int i = e * D + d, x = m->at[TS_NODE_POSITION] + i, v = m->at[TS_NODE_VELOCITY] + i,
            a = m->at[TS_NODE_ACCELERATION] + i;
        out[d] = values[x];
        out[D + d] = first_nonzero(slopes[x], values[v], 0.0);
        out[2 * D + d] = first_nonzero(bends[x], slopes[v], values[a]);
        out[3 * D + d] = first_nonzero(bends[v], slopes[a], 0.0);
        out[4 * D + d] = bends[a];
        if (m->drive.axes[e] >> d & 1) continue;
        out[d] = m->packed.node[m->packed.moved[e] * D + d]; /* what inputs say of other axes is nothing */
        for (int k = 1; k < TS_BASE_DERIVATIVES; k++) out[k * D + d] = 0.0;
    }
}

/* Derivative number `order` at tau. */
double ts_base_derivative(const double *p, int D, int d, int order, double tau)
{
    double sum = 0.0;
    for (int k = TS_BASE_DERIVATIVES - 1; k >= order; k--) sum = sum * tau / (k + 1 - order) + p[k * D + d];
    return sum;
}

/* Third derivative of its position. */
double ts_base_jerk(const ts_bases *bases, int D, double tau, int e, int d)
{
    return ts_base_derivative(bases->start + TS_BASE_DERIVATIVES * e * D, D, d, 3, tau);
}

/* Position and velocity of a moved node at tau from the step's start (D). */
void ts_base_at(const ts_bases *bases, int D, double tau, int e, double *x, double *v)
{
    const double *p = bases->start + TS_BASE_DERIVATIVES * e * D;
    for (int d = 0; d < D; d++) {
        x[d] = ts_base_derivative(p, D, d, 0, tau);
        v[d] = ts_base_derivative(p, D, d, 1, tau);
    }
}

/* All of them, and into the node positions and velocities x (N, 2, D). */
void ts_move_bases(const ts_model *m, double tau, ts_bases *bases, double *x)
{
    int D = m->count[TS_D];
    for (int e = 0; e < m->count[TS_E]; e++) {
        const double *p = bases->start + TS_BASE_DERIVATIVES * e * D;
        double *now = bases->now + 3 * e * D, *at = x + 2 * D * m->packed.moved[e];
        for (int d = 0; d < D; d++) {
            for (int order = 0; order < 3; order++) now[order * D + d] = ts_base_derivative(p, D, d, order, tau);
            at[d] = now[d];
            at[D + d] = now[D + d];
        }
    }
}

/* Height of the ground and its derivatives at the step's start, likewise. */
void ts_raise_ground(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    const double *values = sim->io.values, *slopes = sim->io.slopes, *bends = slopes + m->n_inputs;
    const int h = m->at[TS_GROUND_HEIGHT], v = m->at[TS_GROUND_VELOCITY], a = m->at[TS_GROUND_ACCELERATION];
    double *start = sim->ground.start;
    memset(start, 0, sizeof sim->ground.start);
    if (!m->count[TS_W]) return;
    start[0] = values[h];
    start[1] = first_nonzero(slopes[h], values[v], 0.0);
    start[2] = first_nonzero(bends[h], slopes[v], values[a]);
    start[3] = first_nonzero(bends[v], slopes[a], 0.0);
    start[4] = bends[a];
}
