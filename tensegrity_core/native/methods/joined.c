/* The linear systems of systems.c where bars are joined.
 *
 * With the matrix E of mass and constraints (motion/joints.c), which is the identity elsewhere, and multipliers m the accelerations
 * are those of E (v', m) = (Q, c), and Jq, Jv hold derivatives of (Q, c), at constant multipliers in the one and accelerations in the
 * other.  A stage is then the system, as sparse as the structure,
 *     [mu^2 E - mu Jv - Jq] (u, m) = E (s + mu p) - Jv p,    w = mu u - p,
 * which has multipliers in units of their own.  Since mu^2 = 2 Re(mu) mu - |mu|^2 it has the form that linear/ factorises, with
 *     Jq' = Jq - |mu|^2 (I - E),    Jv' = Jv + 2 Re(mu) (I - E). */
#include "methods/joined.h"
#include "linear/blocks.h"
#include "linear/complex_blocks.h"
#include "model/data.h"

#include <string.h>

static size_t matrix_size(const ts_sim *sim)
{
    const ts_pattern *p = &sim->linear.pattern;
    return (size_t)p->count * (size_t)(p->D * p->D);
}

static void combine(ts_sim *sim, double square, double twice)
{
    const size_t size = matrix_size(sim);
    const double *I_E = sim->joined.whole;
    for (size_t i = 0; i < size; i++) {
        sim->joined.Jq[i] = sim->linear.Jq[i] - square * I_E[i];
        sim->joined.Jv[i] = sim->linear.Jv[i] + twice * I_E[i];
    }
}

int ts_joined_factorise(ts_sim *sim, double a)
{
    combine(sim, a * a, 2.0 * a);
    return ts_blocks_factorise(&sim->linear.pattern, a, sim->joined.Jq, sim->joined.Jv, sim->linear.factor);
}

int ts_joined_pair_factorise(ts_sim *sim, int which, double a, double b)
{
    combine(sim, a * a + b * b, 2.0 * a);
    return ts_complex_factorise(&sim->linear.pattern, a, b, sim->joined.Jq, sim->joined.Jv, sim->linear.pair_factor[which]);
}

/* out = E z - Jv p; z and p without multipliers, out with them; t: room for another. */
static void right_hand_side(const ts_sim *sim, const double *z, const double *p, double *out, double *t)
{
    const int n = sim->linear.pattern.n * sim->linear.pattern.D;
    ts_blocks_multiply(&sim->linear.pattern, sim->joined.whole, z, out);
    ts_blocks_multiply(&sim->linear.pattern, sim->linear.Jv, p, t);
    for (int i = 0; i < n; i++) out[i] = z[i] - out[i] - t[i];
}

void ts_joined_solve(ts_sim *sim, double a, double *U)
{
    const int nq = sim->m.nq, n = sim->linear.pattern.n * sim->linear.pattern.D;
    double *z = sim->joined.work, *p = z + n, *u = p + n, *t = u + n;
    memset(z, 0, 2 * sizeof(double) * (size_t)n);
    for (int i = 0; i < nq; i++) p[i] = U[i], z[i] = U[nq + i] + a * U[i];
    right_hand_side(sim, z, p, u, t);
    ts_blocks_solve(&sim->linear.pattern, sim->linear.factor, u);
    for (int i = 0; i < nq; i++) U[i] = u[i], U[nq + i] = a * u[i] - p[i];
}

void ts_joined_pair_solve(ts_sim *sim, int which, double a, double b, double *Ur, double *Ui)
{
    const int nq = sim->m.nq, n = sim->linear.pattern.n * sim->linear.pattern.D;
    double *z = sim->joined.work, *p = z + n, *out = p + n, *t = out + n, *u = t + n;
    double *parts[2] = {Ur, Ui};
    memset(z, 0, 2 * sizeof(double) * (size_t)n);
    for (int part = 0; part < 2; part++) {
        for (int i = 0; i < nq; i++) {
            p[i] = parts[part][i];
            z[i] = part ? Ui[nq + i] + a * Ui[i] + b * Ur[i] : Ur[nq + i] + a * Ur[i] - b * Ui[i];
        }
        right_hand_side(sim, z, p, out, t);
        for (int i = 0; i < n; i++) u[2 * i + part] = out[i];
    }
    ts_complex_solve(&sim->linear.pattern, sim->linear.pair_factor[which], u);
    for (int i = 0; i < nq; i++) {
        const double pr = Ur[i], pi = Ui[i];
        Ur[i] = u[2 * i];
        Ui[i] = u[2 * i + 1];
        Ur[nq + i] = a * Ur[i] - b * Ui[i] - pr;
        Ui[nq + i] = a * Ui[i] + b * Ur[i] - pi;
    }
}
