/* Linear systems of the linearly implicit methods.
 *
 * With y = (q, v), f = (v, a): a stage (a I - J)(u, w) = (p, s) reduces to one system of half the size,
 *     [a^2 I - a Jv - Jq] u = s + (a I - Jv) p,    w = a u - p. */
#include "methods/systems.h"
#include "linear/blocks.h"
#include "linear/complex_blocks.h"
#include "linear/pairs.h"
#include "methods/joined.h"
#include "model/data.h"

#include <string.h>

/* Factorise for this a (1/s) with the Jacobian at hand; 0 where that fails. */
int ts_stage_factorise(ts_sim *sim, double a)
{
    sim->memory.stats[TS_FACTORISATIONS]++;
    if (sim->m.joint.nodes) return ts_joined_factorise(sim, a);
    return ts_blocks_factorise(&sim->linear.pattern, a, sim->linear.Jq, sim->linear.Jv, sim->linear.factor);
}

/* The stage's right-hand side (p, s) stands in U; leaves (u, w) there. */
void ts_stage_solve(ts_sim *sim, double a, double *U)
{
    int nq = sim->m.nq;
    if (sim->m.joint.nodes) {
        ts_joined_solve(sim, a, U);
        return;
    }
    double *RESTRICT p = sim->linear.work, *RESTRICT u = U, *RESTRICT s = U + nq, *RESTRICT Jvp = sim->linear.work + nq;
    memcpy(p, u, sizeof(double) * (size_t)nq);
    ts_blocks_multiply(&sim->linear.pattern, sim->linear.Jv, p, Jvp);
    for (int i = 0; i < nq; i++) u[i] = s[i] + (a * p[i] - Jvp[i]);
    ts_blocks_solve(&sim->linear.pattern, sim->linear.factor, u);
    for (int i = 0; i < nq; i++) s[i] = a * u[i] - p[i];
}

/* The same for a complex a + i b, of which a pair of real rows (Ur, Ui) holds the two parts. */
int ts_pair_factorise(ts_sim *sim, int which, double a, double b)
{
    sim->memory.stats[TS_FACTORISATIONS]++;
    if (sim->m.joint.nodes) return ts_joined_pair_factorise(sim, which, a, b);
    return ts_complex_factorise(&sim->linear.pattern, a, b, sim->linear.Jq, sim->linear.Jv, sim->linear.pair_factor[which]);
}

void ts_pair_solve(ts_sim *sim, int which, double a, double b, double *Ur, double *Ui)
{
    int nq = sim->m.nq;
    if (sim->m.joint.nodes) {
        ts_joined_pair_solve(sim, which, a, b, Ur, Ui);
        return;
    }
    double *RESTRICT pr = sim->linear.work, *RESTRICT pi = pr + nq, *RESTRICT Jr = pi + nq, *RESTRICT Ji = Jr + nq,
                     *RESTRICT u = Ji + nq;
    double *RESTRICT sr = Ur + nq, *RESTRICT si = Ui + nq;
    memcpy(pr, Ur, sizeof(double) * (size_t)nq);
    memcpy(pi, Ui, sizeof(double) * (size_t)nq);
    ts_blocks_multiply(&sim->linear.pattern, sim->linear.Jv, pr, Jr);
    ts_blocks_multiply(&sim->linear.pattern, sim->linear.Jv, pi, Ji);
    for (int i = 0; i < nq; i++) {
        u[2 * i] = sr[i] + (a * pr[i] - b * pi[i]) - Jr[i];
        u[2 * i + 1] = si[i] + (a * pi[i] + b * pr[i]) - Ji[i];
    }
    ts_complex_solve(&sim->linear.pattern, sim->linear.pair_factor[which], u);
    for (int i = 0; i < nq; i++) {
        Ur[i] = u[2 * i];
        Ui[i] = u[2 * i + 1];
        sr[i] = a * u[2 * i] - b * u[2 * i + 1] - pr[i];
        si[i] = a * u[2 * i + 1] + b * u[2 * i] - pi[i];
    }
}
