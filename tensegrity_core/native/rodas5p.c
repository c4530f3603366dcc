/* L-stable Rosenbrock method of order 5 with the analytic Jacobian.  Sources: rodas5p_tableau.h.
 *
 * With y = (q, v), f = (v, a): a stage (I/(g h) - J) (u, w) = (p, s) reduces to one system of half the size,
 *     [1/(g h)^2 - Jv/(g h) - Jq] u = s + (1/(g h) - Jv) p,    w = u/(g h) - p. */
#include "internal.h"

#include <math.h>
#include <string.h>

#include "rodas5p_tableau.h"

#define STAGES 8

static int factorise(ts_sim *sim, double inv)
{
    int nq = sim->m.nq;
    for (int i = 0; i < nq * nq; i++) sim->W[i] = -inv * sim->Jv[i] - sim->Jq[i];
    for (int i = 0; i < nq; i++) sim->W[i * nq + i] += inv * inv;
    sim->memory.stats[TS_FACTORISATIONS]++;
    return ts_lu(nq, sim->W, sim->pivot);
}

/* The stage's right-hand side (p, s) stands in U; leaves (u, w) there. */
static void solve(ts_sim *sim, double inv, double *U)
{
    int nq = sim->m.nq;
    double *p = sim->lin, *u = U, *s = U + nq;
    memcpy(p, U, sizeof(double) * (size_t)nq);
    for (int i = 0; i < nq; i++) {
        double sum = s[i] + inv * p[i];
        for (int j = 0; j < nq; j++) sum -= sim->Jv[i * nq + j] * p[j];
        u[i] = sum;
    }
    ts_lu_solve(nq, sim->W, sim->pivot, u);
    for (int i = 0; i < nq; i++) s[i] = inv * u[i] - p[i];
}

static double attempt(ts_sim *sim, double tau, double h)
{
    int nq = sim->m.nq, n = 2 * nq, ny = sim->m.ny;
    double inv = 1.0 / (GAMMA * h);
    if (!sim->jacobian_ready) {
        ts_rhs_jacobian(sim, tau, sim->y);
        sim->jacobian_ready = 1;
    }
    if (!factorise(sim, inv)) return NAN;
    memcpy(sim->y1, sim->y, sizeof(double) * (size_t)ny);
    for (int s = 0; s < STAGES; s++) {
        double *U = sim->k + s * ny, *Y = s < 6 ? sim->ytmp : sim->y1;
        const double *f = sim->f0;
        if (s > 0) {
            if (s < 6) {
                memcpy(Y, sim->y, sizeof(double) * (size_t)n);
                for (int j = 0; j < s; j++)
                    for (int i = 0; i < n; i++) Y[i] += A[s][j] * sim->k[j * ny + i];
                if (s == 5) memcpy(sim->y1, Y, sizeof(double) * (size_t)n);
            } else { /* rows 7 and 8 are row 6 and the stages since */
                for (int i = 0; i < n; i++) Y[i] += sim->k[(s - 1) * ny + i];
            }
            ts_rhs(sim, tau + ALPHA[s] * h, Y, sim->f1);
            f = sim->f1;
        }
        memcpy(U, f, sizeof(double) * (size_t)n);
        for (int j = 0; j < s; j++) {
            double c = C[s][j] / h;
            for (int i = 0; i < n; i++) U[i] += c * sim->k[j * ny + i];
        }
        for (int i = 0; i < nq; i++) U[nq + i] += h * D[s] * sim->ft[i];
        solve(sim, inv, U);
    }
    const double *last = sim->k + 7 * ny;
    for (int i = 0; i < n; i++) sim->y1[i] += last[i];
    return ts_error_norm(sim, last, sim->y, sim->y1);
}

static void accept(ts_sim *sim, double tau, double h)
{
    (void)h;
    ts_rhs(sim, tau + h, sim->y1, sim->f1);
}

static void densify(ts_sim *sim, double tau, double h)
{
    int n = 2 * sim->m.nq, ny = sim->m.ny;
    (void)tau;
    (void)h;
    for (int r = 0; r < 3; r++)
        for (int i = 0; i < n; i++) {
            double sum = 0.0;
            for (int j = 0; j < STAGES; j++) sum += H[r][j] * sim->k[j * ny + i];
            sim->cont[r * ny + i] = sum;
        }
}

static void interpolate(const ts_sim *sim, double theta, int first, int count, double *out)
{
    int ny = sim->m.ny;
    double rest = 1.0 - theta;
    for (int n = first; n < first + count; n++) {
        const double *c = sim->cont + n;
        out[n - first] = rest * sim->y[n] +
                         theta * (sim->y1[n] + rest * (c[0] + theta * (c[ny] + theta * c[2 * ny])));
    }
}

const ts_method ts_rodas5p = {"rodas5p", 1.0 / 5.0, 6.0, 1, attempt, accept, densify, interpolate, 0};
