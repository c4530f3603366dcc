/* Parts in series on given pieces: forces are equal, elongations add up.
 *
 * The leader's own elongation parametrises a rise, smoothly even where the leader's force has its maximum.  The force at an
 * elongation is found for all parts at once, from where they were found last; where that does not settle, which is next to
 * maxima that tie, inside a bracket of the leader's elongation. */
#include "laws/rise.h"
#include "invariants.h"
#include "linear/pairs.h"

#include <math.h>
#include <string.h>

#define STILL 4e-16  /* a step of Newton's method shorter than this part of u is none */
#define MET 4e-15    /* elongations that are equal, as a part of them: a sum's round-off */
#define SETTLED 1e-9 /* last step of a part, of its piece: the force is off by the square of it */
#define MOST_ROUNDS 12

/* --- all parts at once -------------------------------------------------------------------------------------------- */

static int equal_laws(const ts_law *a, const ts_law *b)
{
    if (a->n != b->n || a->rows != b->rows) return 0;
    for (int i = 0; i < a->n; i++) {
        const ts_piece *p = &a->piece[i].p, *q = &b->piece[i].p;
        if (p->kind != q->kind || p->first != q->first || p->lo != q->lo || p->hi != q->hi || p->scale != q->scale) return 0;
    }
    return !memcmp(a->table, b->table, sizeof(double) * TS_ROW * (size_t)a->rows);
}

/* Parts on given pieces; no spring, no fold, the leader's range not yet known. */
ts_rise ts_rise_of(const ts_law *part, int n, const int32_t *at, int leader, double *u)
{
    ts_rise r;
    memset(&r, 0, sizeof r);
    r.part = part;
    r.n = n;
    r.at = at;
    r.leader = leader;
    r.u = u;
    return r;
}

static int32_t degree_of(const ts_law *law, int piece)
{
    const ts_piece *p = &law->piece[piece].p;
    const double *coef = law->table + TS_ROW * p->first + 1;
    int32_t degree = TS_DEGREE;
    if (p->kind != TS_ROWS || p->rows != 1) return -1;
    while (degree > 0 && coef[degree] == 0.0) degree--;
    return degree;
}

static void gather(ts_rise *r, int j)
{
    for (int i = 0; i < r->movers; i++) {
        ts_mover *m = r->mover + i;
        if (m->piece != r->at[j] || !equal_laws(m->part, r->part + j)) continue;
        m->count++;
        return;
    }
    TS_ASSERT(r->movers < r->n);
    r->mover[r->movers++] = MAKE(ts_mover){r->part + j, j, 1, r->at[j], degree_of(r->part + j, r->at[j]), 0.0, 0.0};
}

/* Which parts move, equal ones together: what ts_rise_force() goes by from then on. */
void ts_rise_gather(ts_rise *r)
{
    TS_ASSERT(r->leader >= 0 && r->leader < r->n && r->at[r->leader] < r->part[r->leader].n && r->hi >= r->lo);
    r->stopped = 0.0;
    r->movers = 0;
    gather(r, r->leader);
    for (int j = 0; j < r->n; j++) {
        if (r->at[j] >= r->part[j].n) r->stopped += ts_law_stop(r->part + j);
        else if (j != r->leader) gather(r, j);
    }
}

static double mover_force(const ts_mover *m, double u, double *slope)
{
    if (m->degree < 0) return ts_law_force(m->part, m->piece, u, slope);
    const ts_piece *p = &m->part->piece[m->piece].p;
    const double *coef = m->part->table + TS_ROW * p->first + 1;
    double t = (u - p->origin) * p->scale, f = coef[m->degree], d = 0.0;
    for (int i = m->degree - 1; i >= 0; i--) {
        d = d * t + f;
        f = f * t + coef[i];
    }
    *slope = d * p->scale;
    return f;
}

/* Take a step from u that stays between two ends; sees to it that `settled` is 0 where it is long or no number. */
static double step_within(double u, double step, double lo, double hi, int *settled)
{
    if (!(fabs(step) <= SETTLED * (hi < INFINITY ? hi - lo : u))) *settled = 0;
    return fmin(fmax(u + step, lo), hi);
}

/* The softest part: the others' forces say where they stand, what is left of the elongation where it does. */
static int softest(ts_rise *r)
{
    int soft = 0;
    for (int i = 0; i < r->movers; i++) {
        ts_mover *m = r->mover + i;
        m->force = mover_force(m, r->u[m->first], &m->slope);
        if (fabs(m->slope) < fabs(r->mover[soft].slope)) soft = i;
    }
    return soft;
}

/* A step of Newton's method for f_j(u_j) = f, sum u_j + c f = x; returns f, wrong by the square of what the u were wrong by.  All
 * is divided by the softest part's compliance, which is infinite at a maximum. */
static double newton_step(ts_rise *r, double x, int *settled)
{
    const int soft = softest(r);
    const double stiffness = r->mover[soft].slope;
    double left = x - r->stopped, forces = 0.0, weights = r->compliance * stiffness;
    for (int i = 0; i < r->movers; i++) {
        const ts_mover *m = r->mover + i;
        double weight = m->count * (i == soft ? 1.0 : stiffness / m->slope);
        forces += weight * m->force;
        weights += weight;
        left -= m->count * r->u[m->first];
    }
    double f = (stiffness * left + forces) / weights;
    left -= r->compliance * f;
    for (int n = 1; n <= r->movers; n++) { /* the softest comes last */
        int i = (soft + n) % r->movers;
        const ts_mover *m = r->mover + i;
        const ts_piece *p = &m->part->piece[m->piece].p;
        double u = r->u[m->first], step = i == soft ? left / m->count : (f - m->force) / m->slope;
        r->u[m->first] = i ? step_within(u, step, p->lo, p->hi, settled) : step_within(u, step, r->lo, r->hi, settled);
        left -= m->count * (r->u[m->first] - u);
    }
    return f;
}

/* --- inside a bracket ---------------------------------------------------------------------------------------------- */

/* Elongation where the leader stands at u, the force there and the elongation's derivative by u. */
double ts_rise_elongation(ts_rise *r, double u, double *force, double *slope)
{
    double df, d, f = ts_law_force(r->part + r->leader, r->at[r->leader], u, &df);
    double x = u + r->compliance * f, by_force = r->compliance;
    r->u[r->leader] = u;
    for (int j = 0; j < r->n; j++) {
        if (j == r->leader) continue;
        if (r->at[j] >= r->part[j].n) {
            r->u[j] = ts_law_stop(r->part + j);
        } else {
            r->u[j] = ts_law_inverse(r->part + j, r->at[j], f, r->u[j]);
            ts_law_force(r->part + j, r->at[j], r->u[j], &d);
            by_force += 1.0 / d; /* infinite at an extremum of another part */
        }
        x += r->u[j];
    }
    *force = f;
    *slope = df == 0.0 ? 1.0 : 1.0 + df * by_force;
    return x;
}

/* Where to look next in the bracket a..b when the residual at u is `residual`, the one before it was `last`, and Newton's method
 * divides by `slope`; u: that was the last step.  Where other parts stand at maxima that tie with the leader's, the slope is
 * round-off, and may be huge: steps that do not halve it, and one of nothing where it is not nothing, say nothing. */
static double look_next(double u, double a, double b, double residual, double last, double slope, int met)
{
    double next = u - residual / slope, middle = 0.5 * (a + b);
    if (!(next > a && next < b) || fabs(residual) > 0.5 * fabs(last)) next = middle;
    if (fabs(next - u) > STILL * fabs(u)) return next;
    return met || !(b - a > 2.0 * STILL * fabs(u)) ? u : middle;
}

/* Newton's method for the leader inside a shrinking bracket. */
static double force_in_bracket(ts_rise *r, double x)
{
    double a = r->lo, b = r->hi, f, slope, u = r->u[r->leader], last = INFINITY;
    if (!(b < INFINITY))
        for (b = fmax(2.0 * a, a + 1e-3); ts_rise_elongation(r, b, &f, &slope) < x;) b = a + 2.0 * (b - a);
    if (!(u > a && u < b)) u = 0.5 * (a + b);
    for (int n = 0; n < 200; n++) {
        double g = ts_rise_elongation(r, u, &f, &slope) - x;
        if (g == 0.0) return f;
        if (g > 0.0) b = u;
        else a = u;
        double next = look_next(u, a, b, g, last, slope, fabs(g) <= MET * fabs(x));
        if (next == u) break;
        u = next;
        last = g;
    }
    ts_rise_elongation(r, u, &f, &slope);
    return f;
}

/* Force of the rise at an elongation. */
double ts_rise_force(void *rise, double x)
{
    ts_rise *r = (ts_rise *)rise;
    for (int n = 0; n < MOST_ROUNDS && r->movers; n++) {
        int settled = 1;
        double f = newton_step(r, x, &settled);
        if (settled) return f;
    }
    return force_in_bracket(r, x);
}

/* Distance in elongation from the fold to where the leader stands at u, m.  Close to the fold it is the integral of dx/du
 * (Gauss points), because the difference of two elongations has no digits there. */
static double off_fold(ts_rise *r, double u, double *slope)
{
    static const double node[3] = {0.2386191860831969, 0.6612093864662645, 0.9324695142031521};
    static const double weight[3] = {0.4679139345726910, 0.3607615730481386, 0.1713244923791704};
    double fold = r->fold > 0 ? r->hi : r->lo, half = 0.5 * (fold - u), sum = 0.0, f, d;
    double x = ts_rise_elongation(r, u, &f, slope);
    if (fabs(fold - u) > 0.05 * (r->hi - r->lo)) return fabs(ts_rise_elongation(r, fold, &f, &d) - x);
    for (int k = 0; k < 3; k++)
        for (int side = -1; side <= 1; side += 2) {
            ts_rise_elongation(r, u + half * (1.0 + side * node[k]), &f, &d);
            sum += 0.5 * weight[k] * d;
        }
    return fabs(sum * (fold - u));
}

/* Force of the rise at the distance s^2 from its fold: of s = sqrt(distance) the leader's elongation is a smooth function. */
double ts_rise_off_fold(void *rise, double s)
{
    ts_rise *r = (ts_rise *)rise;
    double fold = r->fold > 0 ? r->hi : r->lo, a = r->lo, b = r->hi, u = r->u[r->leader], f, slope;
    double last = INFINITY;
    if (!(u > a && u < b)) u = 0.5 * (a + b);
    for (int n = 0; n < 200 && s > 0.0; n++) {
        double root = sqrt(off_fold(r, u, &slope)), g = r->fold * (s - root);
        if (g == 0.0) break;
        if (g > 0.0) b = u;
        else a = u;
        double next = look_next(u, a, b, g * 2.0 * root, last, slope, fabs(g) <= MET * s);
        if (next == u) break;
        u = next;
        last = g * 2.0 * root;
    }
    ts_rise_elongation(r, s > 0.0 ? u : fold, &f, &slope);
    return f;
}

/* Compliance of a rise (m/N) where all its parts are straight, else 0. */
double ts_rise_straight(const ts_rise *r)
{
    double sum = r->compliance;
    for (int j = 0; j < r->n; j++) {
        if (r->at[j] >= r->part[j].n) continue;
        const ts_piece *p = &r->part[j].piece[r->at[j]].p;
        const double *row = r->part[j].table + TS_ROW * p->first;
        if (p->kind != TS_ROWS || p->rows != 1) return 0.0;
        for (int k = 2; k <= TS_DEGREE; k++)
            if (row[1 + k] != 0.0) return 0.0;
        sum += 1.0 / (row[2] * p->scale);
    }
    return sum;
}
