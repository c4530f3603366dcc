/* Explicit, order 8, adaptive, dense output of order 7.  Sources: dop853_tableau.h. */
#include "internal.h"

#include <math.h>

#include "dop853_tableau.h"

/* y + h sum_j A[stage][j] k_j over the first `count` stages */
static void combine(const ts_sim *sim, const double *a, int count, double h, double *out)
{
    int ny = sim->m.ny;
    for (int i = 0; i < ny; i++) out[i] = 0.0;
    for (int j = 0; j < count; j++) {
        const double *k = sim->k + j * ny, w = a[j];
        if (w != 0.0)
            for (int i = 0; i < ny; i++) out[i] += w * k[i];
    }
    for (int i = 0; i < ny; i++) out[i] = sim->y[i] + h * out[i];
}

/* Norm of an error estimate.  The ledger counts too, relative to 1 J and the throughput (which has kinks itself and does
 * not matter). */
static double estimate(ts_sim *sim, const double *e)
{
    int ny = sim->m.ny, n = ny - 1;
    for (int i = 0; i < n; i++) sim->err[i] = 0.0;
    for (int j = 0; j < 12; j++) {
        const double *k = sim->k + j * ny, w = e[j];
        if (w != 0.0)
            for (int i = 0; i < n; i++) sim->err[i] += w * k[i];
    }
    double ledger = fmax(fabs(sim->err[n - 2]), fabs(sim->err[n - 1])) / (1.0 + fabs(sim->y[n]));
    double norm = ts_error_norm(sim, sim->err, sim->y, sim->y1), energy = ledger / sim->values[sim->m.at[TS_TOLERANCE]];
    return energy > norm ? energy : norm;
}

/* h lambda as seen between the last two stages, both at the step's end (Hairer, Norsett, Wanner, section IV.2). */
static double stiffness(ts_sim *sim, double h)
{
    int nq = sim->m.nq, ny = sim->m.ny;
    const double *last = sim->k + 11 * ny;
    double force = 0.0, state = 0.0;
    combine(sim, A[11], 11, h, sim->err);
    for (int i = 0; i < 2 * nq; i++) {
        force += (sim->f1[i] - last[i]) * (sim->f1[i] - last[i]);
        state += (sim->y1[i] - sim->err[i]) * (sim->y1[i] - sim->err[i]);
    }
    return state > 0.0 ? h * sqrt(force / state) : 0.0;
}

static double attempt(ts_sim *sim, double tau, double h)
{
    int ny = sim->m.ny;
    for (int i = 0; i < ny; i++) sim->k[i] = sim->f0[i];
    for (int s = 1; s < 12; s++) {
        combine(sim, A[s], s, h, sim->ytmp);
        ts_rhs(sim, tau + C[s] * h, sim->ytmp, sim->k + s * ny);
    }
    combine(sim, A[12], 12, h, sim->y1);
    double e5 = estimate(sim, E5), e3 = estimate(sim, E3);
    if (e5 == 0.0) return 0.0;
    double ratio = e3 / e5; /* divided before squaring: a wild step must not overflow into acceptance */
    return h * e5 / sqrt(1.0 + 0.01 * ratio * ratio);
}

static void accept(ts_sim *sim, double tau, double h)
{
    ts_rhs(sim, tau + h, sim->y1, sim->f1);
    double *last = sim->k + 12 * sim->m.ny;
    for (int i = 0; i < sim->m.ny; i++) last[i] = sim->f1[i];
    if (stiffness(sim, h) > 6.0) sim->memory.stiff += sim->memory.stiff < 1000;
    else if (sim->memory.stiff > 0) sim->memory.stiff--;
}

static void densify(ts_sim *sim, double tau, double h)
{
    int ny = sim->m.ny;
    for (int s = 13; s < 16; s++) {
        combine(sim, A[s], s, h, sim->ytmp);
        ts_rhs(sim, tau + C[s] * h, sim->ytmp, sim->k + s * ny);
    }
    for (int i = 0; i < ny; i++) {
        double dy = sim->y1[i] - sim->y[i];
        sim->cont[i] = dy;
        sim->cont[ny + i] = h * sim->f0[i] - dy;
        sim->cont[2 * ny + i] = 2.0 * dy - h * (sim->f1[i] + sim->f0[i]);
    }
    for (int r = 0; r < 4; r++)
        for (int i = 0; i < ny; i++) {
            double sum = 0.0;
            for (int j = 0; j < 16; j++) sum += DENSE[r][j] * sim->k[j * ny + i];
            sim->cont[(3 + r) * ny + i] = h * sum;
        }
}

static void interpolate(const ts_sim *sim, double theta, int first, int count, double *out)
{
    int ny = sim->m.ny;
    double rest = 1.0 - theta;
    for (int n = 0; n < count; n++) {
        const double *c = sim->cont + first + n;
        out[n] = sim->y[first + n] +
                 theta * (c[0] + rest * (c[ny] + theta * (c[2 * ny] + rest * (c[3 * ny] + theta * (c[4 * ny] +
                 rest * (c[5 * ny] + theta * c[6 * ny]))))));
    }
}

const ts_method ts_dop853 = {"dop853", 1.0 / 8.0, 6.0, 0, attempt, accept, densify, interpolate, 1};
