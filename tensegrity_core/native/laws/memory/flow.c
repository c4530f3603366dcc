/* A snap of parts in series: c du_j/dt = T - f_j(u_j), T = k (x - sum u) or 0, with the string's elongation x held, stopped
 * at 0 and at the parts' stops.  Only where it ends matters. */
#include "laws/memory/flow.h"
#include "laws/law.h"
#include "laws/memory/branches.h"
#include "linear/power.h"

#include <math.h>
#include <string.h>

#define BIAS 1e-11      /* force that breaks ties, of the largest */
#define FLOW_ERROR 1e-7 /* of a step, of the length */
#define FLOW_STEPS 200000

/* Rates of the flow at u, times c; slopes f'_j, infinite where a part is stopped.  Returns T. */
static double flow_rates(const ts_graph *g, double x, const double *u, double bias, double *rate, double *slope)
{
    double T = fmax(0.0, g->k * (x - ts_parts_total(g, u)));
    for (int j = 0; j < g->n; j++) {
        const ts_law *part = g->part + j;
        rate[j] = T - ts_law_force(part, ts_law_at(part, u[j]), u[j], slope + j) + bias * (g->n - j) / g->n;
        if ((u[j] <= 0.0 && rate[j] < 0.0) || (u[j] >= ts_law_stop(part) && rate[j] > 0.0)) {
            rate[j] = 0.0;
            slope[j] = INFINITY;
        }
    }
    return T;
}

/* Is the equilibrium with these slopes a minimum of Pi? */
static int stable(const ts_graph *g, const double *slope, double k)
{
    double sum = 0.0;
    int falling = 0;
    for (int j = 0; j < g->n; j++) {
        falling += slope[j] < 0.0;
        sum += 1.0 / slope[j];
    }
    return falling == 0 || (falling == 1 && k > 0.0 && 1.0 / k + sum < 0.0);
}

/* Is 1 + h (diag(slope) + k 1 1') positive definite? */
static int solvable(const ts_graph *g, const double *slope, double k, double h)
{
    double sum = 0.0;
    int negative = 0;
    for (int j = 0; j < g->n; j++) {
        double d = 1.0 + h * slope[j];
        negative += d <= 0.0;
        sum += 1.0 / d;
    }
    return negative == 0 || (negative == 1 && 1.0 + h * k * sum < 0.0);
}

/* r = (1 + h (diag(slope) + k 1 1'))^-1 r */
static void flow_solve(const ts_graph *g, const double *slope, double k, double h, double *r)
{
    double sum = 0.0, weight = 0.0;
    for (int j = 0; j < g->n; j++) {
        double w = 1.0 / (1.0 + h * slope[j]);
        r[j] *= w;
        sum += r[j];
        weight += w;
    }
    double shift = h * k * sum / (1.0 + h * k * weight);
    for (int j = 0; j < g->n; j++) r[j] -= shift / (1.0 + h * slope[j]);
}

/* One step of the flow (Shampine, Reichelt, The MATLAB ODE suite, SIAM Journal on Scientific Computing 18, 1997,
 * doi:10.1137/S1064827594276424: ode23s), from rates f0; its end in `end`.  Returns the error, m. */
static double flow_step(const ts_graph *g, double x, const double *u, double bias, const double *f0, const double *slope,
                        double k, double h, double *end)
{
    const double d = 0.2928932188134524, e32 = 7.414213562373095; /* 1/(2 + sqrt 2), 6 + sqrt 2 */
    int n = g->n;
    double *k1 = g->work + 2 * n, *k2 = k1 + n, *k3 = k2 + n, *f = k3 + n, *unused = f + n, error = 0.0;
    for (int j = 0; j < n; j++) k1[j] = f0[j];
    flow_solve(g, slope, k, h * d, k1);
    for (int j = 0; j < n; j++) end[j] = u[j] + 0.5 * h * k1[j];
    flow_rates(g, x, end, bias, f, unused);
    for (int j = 0; j < n; j++) k2[j] = f[j] - k1[j];
    flow_solve(g, slope, k, h * d, k2);
    for (int j = 0; j < n; j++) k2[j] += k1[j];
    for (int j = 0; j < n; j++) end[j] = u[j] + h * k2[j];
    for (int j = 0; j < n; j++) k3[j] = -e32 * (k2[j] - f[j]) - 2.0 * (k1[j] - f0[j]);
    flow_rates(g, x, end, bias, f, unused);
    for (int j = 0; j < n; j++) k3[j] += f[j];
    flow_solve(g, slope, k, h * d, k3);
    for (int j = 0; j < n; j++) {
        error = fmax(error, h / 6.0 * fabs(k1[j] - 2.0 * k2[j] + k3[j]));
        end[j] = fmin(fmax(slope[j] < INFINITY ? end[j] : u[j], 0.0), ts_law_stop(g->part + j));
    }
    return error;
}

/* Follow the flow from g->v to its end.  way: of the snap. */
void ts_flow(ts_graph *g, double x, int way)
{
    double *rate = g->work, *slope = rate + g->n, *end = rate + 7 * g->n, h = 0.0, bias = way * BIAS * g->size;
    for (int step = 0; step < FLOW_STEPS; step++) {
        double T = flow_rates(g, x, g->v, bias, rate, slope), k = T > 0.0 ? g->k : 0.0, fastest = 0.0;
        for (int j = 0; j < g->n; j++) fastest = fmax(fastest, fabs(rate[j]));
        if (fastest <= 1e-9 * g->size && stable(g, slope, k)) return;
        if (h == 0.0) h = 0.01 * g->length / (g->size + g->k * g->length);
        while (!solvable(g, slope, k, h)) h *= 0.5;
        double error = flow_step(g, x, g->v, bias, rate, slope, k, h, end) / (FLOW_ERROR * g->length);
        if (error <= 1.0) memcpy(g->v, end, sizeof(double) * (size_t)g->n);
        h *= fmin(4.0, fmax(0.2, 0.8 * ts_real_power(fmax(error, 1e-3), -1.0 / 3.0)));
    }
    g->reason = "the snap of a hysteretic string finds no end";
}
