/* Parts in series with memory: the curve of a string whose parts' elongations u follow a stable minimum of
 *     Pi(u; x) = sum U_j(u_j) + k/2 (x - sum u)^2,  T = k (x - sum u) = f_j(u_j),
 * k the string's own stiffness, x its elongation.
 *
 * On given stretches of the parts (a state) T is smooth in x.  Where all of them rise, every equilibrium is stable; where one
 * falls, the one that leads, it is as long as dx/du of the leader is positive; where two fall, none is.  So a state has branches
 * in x, which end where a part comes to the end of its stretch, where T vanishes, or at a fold, dx/du = 0.  If the adjacent
 * branch goes on in the direction of motion they join; else the parts snap: they follow c du_j/dt = T - f_j(u_j), equal c, ties
 * to the lowest index, stopped at 0 and at their stops, and what Pi loses is dissipated.  A slack string has T = 0.  All branches
 * that can be reached from the slack one are found by a search, breadth first. */
#include "laws.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MOST_PIECES 4096
#define SCAN 96           /* samples of dx/du on a falling stretch */
#define SAME 1e-12        /* forces that are equal, of the largest */
#define NARROW 1e-8       /* branches that are none, of the length */
#define NEAR 1e-9         /* elongations that are equal, of the length */
#define PUSH 1e-3         /* first displacement from an unstable point, of a stretch */
#define BIAS 1e-11        /* force that breaks ties, of the largest */
#define FLOW_ERROR 1e-7   /* of a step of the flow, of the length */
#define FLOW_STEPS 200000

enum { BOUND, FOLD, ZERO, JOINT, ENDLESS }; /* what ends a branch */

typedef struct {
    int32_t *at;                 /* (n) stretch of each part; its number of stretches: at its stop */
    int32_t leader, first, count; /* -1: all parts are at their stops; its branches */
} state;

typedef struct {
    int32_t state, kind, piece; /* -1: slack; of the piece; its number, -1: not reached */
    int32_t cause[2];
    double x[2], u[2], T[2];    /* at its ends: elongation, the leader's own, m; force, N */
    double *slack;              /* (n) elongations of the parts of a slack branch, m */
} branch;

typedef struct {
    ts_curve *c;
    const ts_law *part;
    int n;
    double k, size, length; /* N/m; N, m: what forces and elongations are measured by */
    state *states;
    branch *branches;
    int32_t state_count, branch_count, rows;
    int32_t *reached;       /* (MOST_PIECES) branches in the order of the pieces */
    double *u, *v;          /* (n) parts' elongations at the end of a branch, on the way of a snap, m */
    double *on_rise, *work; /* (n), (8, n) */
    int32_t *next;          /* (3, n) */
    int snapped;            /* the last branch that was followed ended in a snap, its end in v */
    const char *reason;
} graph;

/* --- states and their branches ------------------------------------------------------------------------------------- */

static ts_rise rise_of(graph *g, const branch *b)
{
    const state *s = g->states + b->state;
    int fold = b->kind == TS_FOLD_ABOVE ? 1 : -1;
    return (ts_rise){g->part, s->at, g->on_rise, b->u[0], b->u[1], 1.0 / g->k, fold, g->n, s->leader};
}

static double total(const graph *g, const double *u)
{
    double sum = 0.0;
    for (int j = 0; j < g->n; j++) sum += u[j];
    return sum;
}

/* Pi, J. */
static double energy(const graph *g, double x, const double *u)
{
    double stretch = fmax(0.0, x - total(g, u)), sum = 0.5 * g->k * stretch * stretch;
    for (int j = 0; j < g->n; j++) sum += ts_law_energy(g->part + j, ts_law_at(g->part + j, u[j]), u[j]);
    return sum;
}

/* Elongation where the parts of a state bear T, theirs in g->on_rise; u: the leader's where it is level. */
static double bearing(graph *g, const state *s, double T, double u)
{
    for (int j = 0; j < g->n; j++) {
        const ts_law *part = g->part + j;
        if (s->at[j] >= part->n) g->on_rise[j] = ts_law_stop(part);
        else if (part->s[s->at[j]].way == 0) g->on_rise[j] = u;
        else g->on_rise[j] = ts_law_inverse(part, s->at[j], T, g->on_rise[j]);
    }
    return T / g->k + total(g, g->on_rise);
}

/* Ends of a branch are where its force is known, which finds parts at their extrema exactly, or folds. */
static void set_end(graph *g, branch *b, int side)
{
    double slope;
    if (b->cause[side] == BOUND || b->cause[side] == ZERO) {
        b->x[side] = bearing(g, g->states + b->state, b->T[side], b->u[side]);
    } else if (b->cause[side] == ENDLESS) {
        b->x[side] = INFINITY;
    } else {
        ts_rise r = rise_of(g, b);
        b->x[side] = ts_rise_elongation(&r, b->u[side], b->T + side, &slope);
    }
}

/* The parts' elongations at an end of a branch into g->u. */
static void end_state(graph *g, branch *b, int side)
{
    if (b->state < 0) {
        memcpy(g->u, b->slack, sizeof(double) * (size_t)g->n);
    } else {
        set_end(g, b, side);
        memcpy(g->u, g->on_rise, sizeof(double) * (size_t)g->n);
    }
}

static int add_branch(graph *g, branch b)
{
    branch *more = realloc(g->branches, sizeof *more * ((size_t)g->branch_count + 1));
    if (!more) {
        g->reason = "out of memory";
        return -1;
    }
    g->branches = more;
    b.piece = -1;
    more[g->branch_count] = b;
    return g->branch_count++;
}

/* Forces that the parts other than the leader can bear on their stretches: from least to most, N. */
static void bounds(const graph *g, const state *s, double *least, double *most)
{
    *least = 0.0;
    *most = INFINITY;
    for (int j = 0; j < g->n; j++) {
        const ts_law *part = g->part + j;
        if (s->at[j] >= part->n) {
            *least = fmax(*least, part->s[part->n - 1].force[1]);
        } else if (part->s[s->at[j]].way > 0) {
            *least = fmax(*least, part->s[s->at[j]].force[0]);
            *most = fmin(*most, part->s[s->at[j]].force[1]);
        }
    }
}

/* dx/du of the leader. */
static double stability(ts_rise *r, double u)
{
    double force, slope;
    ts_rise_elongation(r, u, &force, &slope);
    return slope == slope ? slope : -INFINITY;
}

/* Where dx/du changes its sign between a and b. */
static double fold_between(ts_rise *r, double a, double b)
{
    int positive = stability(r, a) > 0.0;
    for (double m = 0.5 * (a + b); m > a && m < b; m = 0.5 * (a + b)) {
        if ((stability(r, m) > 0.0) == positive) a = m;
        else b = m;
    }
    return positive ? a : b; /* the stable side */
}

/* Least dx/du near a sample that is smaller than its neighbours, and where (golden section). */
static double least_between(ts_rise *r, double a, double b, double *where)
{
    const double g = 0.6180339887498949;
    double c = b - g * (b - a), d = a + g * (b - a), fc = stability(r, c), fd = stability(r, d);
    for (int n = 0; n < 60 && fc > 0.0 && fd > 0.0; n++) {
        if (fc < fd) b = d, d = c, fd = fc, c = b - g * (b - a), fc = stability(r, c);
        else a = c, c = d, fc = fd, d = a + g * (b - a), fd = stability(r, d);
    }
    *where = fc < fd ? c : d;
    return fmin(fc, fd);
}

/* A stable part of a falling stretch makes a branch, or two where both its ends are folds. */
static void add_falling(graph *g, branch b, double u0, int cause0, double u1, int cause1)
{
    b.u[0] = u0;
    b.u[1] = u1;
    b.cause[0] = cause0;
    b.cause[1] = cause1;
    set_end(g, &b, 0);
    set_end(g, &b, 1);
    if (b.x[1] - b.x[0] <= NARROW * g->length) return;
    if (cause0 == FOLD && cause1 == FOLD) {
        branch low = b, high = b;
        low.cause[1] = high.cause[0] = JOINT;
        low.u[1] = high.u[0] = 0.5 * (u0 + u1);
        set_end(g, &low, 1);
        set_end(g, &high, 0);
        low.kind = TS_FOLD_BELOW;
        high.kind = TS_FOLD_ABOVE;
        add_branch(g, low);
        add_branch(g, high);
        return;
    }
    if (cause0 == FOLD) b.kind = TS_FOLD_BELOW;
    if (cause1 == FOLD) b.kind = TS_FOLD_ABOVE;
    if (cause1 == ENDLESS) b.kind = TS_OPEN;
    add_branch(g, b);
}

/* Branches where one part, the leader, falls: the stretches of it with dx/du > 0. */
static void explore_falling(graph *g, int32_t index)
{
    const state *s = g->states + index;
    const ts_law *lead = g->part + s->leader;
    const ts_stretch *on = lead->s + s->at[s->leader];
    double least, most, a = on->p.lo, b = on->p.hi, from = 0.0, last = 0.0, before = 0.0;
    bounds(g, s, &least, &most);
    if (on->force[1] > most || on->force[0] < least) return;
    int cause0 = BOUND, cause1 = BOUND, open = 0;
    branch all = {.state = index, .kind = TS_GRADED, .T = {fmin(most, on->force[0]), fmax(least, on->force[1])}};
    if (most < on->force[0]) a = ts_law_inverse(lead, s->at[s->leader], most, a);
    if (least > on->force[1]) {
        b = ts_law_inverse(lead, s->at[s->leader], least, a);
        if (least == 0.0) cause1 = ZERO;
    }
    if (!(b > a)) return;
    if (!(b < INFINITY)) { /* a level stretch without end: dx/du = 1 */
        add_falling(g, all, a, BOUND, b, ENDLESS);
        return;
    }
    ts_rise r = {g->part, s->at, g->on_rise, a, b, 1.0 / g->k, 0.0, g->n, s->leader};
    for (int i = 0; i <= SCAN; i++) {
        double t = fmin(fmax((double)i / SCAN, 0.003), 0.997), u = a + (b - a) * t * t * (3.0 - 2.0 * t), now = stability(&r, u);
        if (i == 0) {
            open = now > 0.0;
            from = a;
        } else if ((now > 0.0) != (before > 0.0)) {
            double fold = fold_between(&r, last, u);
            if (open) add_falling(g, all, from, cause0, fold, FOLD);
            else from = fold, cause0 = FOLD;
            open = !open;
        } else if (open && i > 1 && i < SCAN) { /* may it dip below 0 between samples? */
            double t2 = fmin((i + 1.0) / SCAN, 0.997), beyond = a + (b - a) * t2 * t2 * (3.0 - 2.0 * t2), where;
            if (now < before && stability(&r, beyond) > now && least_between(&r, last, beyond, &where) < 0.0) {
                add_falling(g, all, from, cause0, fold_between(&r, last, where), FOLD);
                from = fold_between(&r, where, beyond), cause0 = FOLD;
                u = beyond, now = stability(&r, u), i++;
            }
        }
        last = u;
        before = now;
    }
    if (open) add_falling(g, all, from, cause0, b, cause1);
}

static void explore_rising(graph *g, int32_t index)
{
    state *s = g->states + index;
    double least, most;
    bounds(g, s, &least, &most);
    branch b = {.state = index, .kind = TS_GRADED, .cause = {least == 0.0 ? ZERO : BOUND, BOUND}, .T = {least, most}};
    if (!(most < INFINITY)) b.kind = s->leader < 0 ? TS_STRAIGHT : TS_OPEN, b.cause[1] = ENDLESS; /* straight: all at their stops */
    if (most - least <= SAME * g->size) return;
    for (int j = 0; j < g->n; j++)
        if (s->at[j] < g->part[j].n && g->part[j].s[s->at[j]].force[1] == most) {
            s->leader = j;
            break;
        }
    for (int side = 0; side < 2 && s->leader >= 0; side++)
        b.u[side] = ts_law_inverse(g->part + s->leader, s->at[s->leader], b.T[side], 0.0);
    set_end(g, &b, 0);
    set_end(g, &b, 1);
    if (b.x[1] - b.x[0] > NARROW * g->length) add_branch(g, b);
}

/* The state of these stretches, with its branches; -1: out of memory. */
static int32_t find_state(graph *g, const int32_t *at)
{
    size_t bytes = sizeof *at * (size_t)g->n;
    for (int32_t i = 0; i < g->state_count; i++)
        if (!memcmp(g->states[i].at, at, bytes)) return i;
    state *more = realloc(g->states, sizeof *more * ((size_t)g->state_count + 1));
    int32_t *own = malloc(bytes);
    if (more) g->states = more;
    if (!more || !own) {
        free(own);
        g->reason = "out of memory";
        return -1;
    }
    memcpy(own, at, bytes);
    int falling = 0, leader = -1;
    for (int j = 0; j < g->n; j++) {
        if (at[j] >= g->part[j].n) continue;
        int falls = g->part[j].s[at[j]].way <= 0;
        if (leader < 0 || (falls && !falling)) leader = j;
        falling += falls;
    }
    more[g->state_count] = (state){own, leader, g->branch_count, 0};
    int32_t index = g->state_count++;
    if (falling == 1) explore_falling(g, index);
    else if (falling == 0) explore_rising(g, index);
    g->states[index].count = g->branch_count - g->states[index].first;
    return index;
}

/* The branch of a state that holds the elongation x with the parts at u; with a way (1 up, -1 down) one that begins there and goes
 * that way.  -1: there is none. */
static int32_t find_branch(graph *g, const int32_t *at, double x, const double *u, int way)
{
    int32_t index = find_state(g, at);
    if (index < 0) return -1;
    const state *s = g->states + index;
    for (int32_t i = s->first; i < s->first + s->count; i++) {
        const branch *b = g->branches + i;
        double near = NEAR * g->length, own = s->leader < 0 ? 0.0 : u[s->leader], far = 100.0 * near;
        if (x < b->x[0] - near || x > b->x[1] + near) continue;
        if (s->leader >= 0 && (own < b->u[0] - far || own > b->u[1] + far)) continue;
        if (way > 0 && !(x <= b->x[0] + near)) continue;
        if (way < 0 && !(x >= b->x[1] - near)) continue;
        return i;
    }
    return -1;
}

/* --- snaps --------------------------------------------------------------------------------------------------------- */

/* Elongation at which a part that bears nothing comes to rest, on the way from u. */
static double relaxed(const ts_law *part, int stretch, double u, int way)
{
    const ts_stretch *s = part->s + stretch;
    if (stretch == 0 && s->way > 0 && s->force[0] >= 0.0) return 0.0;
    if (s->way > 0 && s->force[1] < 0.0 && u >= s->p.hi) return s->p.hi;
    if (s->way > 0 && s->force[0] <= 0.0 && s->force[1] >= 0.0) return ts_law_inverse(part, stretch, 0.0, u);
    if (way > 0) {
        for (int i = stretch + 1; i < part->n; i++)
            if (part->s[i].way > 0 && part->s[i].force[1] >= 0.0) return ts_law_inverse(part, i, 0.0, u);
        return ts_law_stop(part);
    }
    for (int i = stretch - 1; i > 0; i--)
        if (part->s[i].way > 0 && part->s[i].force[0] <= 0.0) return ts_law_inverse(part, i, 0.0, u);
    return 0.0;
}

/* The slack branch of the parts at g->v, which relax. */
static int32_t slack_branch(graph *g, int way)
{
    for (int j = 0; j < g->n; j++) g->v[j] = relaxed(g->part + j, ts_law_at(g->part + j, g->v[j]), g->v[j], way);
    for (int32_t i = 0; i < g->branch_count; i++) {
        double apart = 0.0;
        if (g->branches[i].state >= 0) continue;
        for (int j = 0; j < g->n; j++) apart = fmax(apart, fabs(g->branches[i].slack[j] - g->v[j]));
        if (apart <= NEAR * g->length) return i;
    }
    double *own = malloc(sizeof *own * (size_t)g->n);
    if (!own) {
        g->reason = "out of memory";
        return -1;
    }
    memcpy(own, g->v, sizeof *own * (size_t)g->n);
    branch b = {.state = -1, .kind = TS_SLACK, .cause = {ENDLESS, BOUND}, .x = {-INFINITY, total(g, own)}, .slack = own};
    int32_t index = add_branch(g, b);
    if (index < 0) free(own);
    return index;
}

/* Rates of the flow at u, times c; slopes f'_j, infinite where a part is stopped.  Returns T. */
static double flow_rates(const graph *g, double x, const double *u, double bias, double *rate, double *slope)
{
    double T = fmax(0.0, g->k * (x - total(g, u)));
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
static int stable(const graph *g, const double *slope, double k)
{
    double sum = 0.0;
    int falling = 0;
    for (int j = 0; j < g->n; j++) {
        falling += slope[j] < 0.0;
        sum += 1.0 / slope[j];
    }
    return falling == 0 || (falling == 1 && k > 0.0 && 1.0 / k + sum < 0.0);
}

/* r = (1 + h (diag(slope) + k 1 1'))^-1 r */
static void flow_solve(const graph *g, const double *slope, double k, double h, double *r)
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
static double flow_step(const graph *g, double x, const double *u, double bias, const double *f0, const double *slope, double k,
                        double h, double *end)
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
static void flow(graph *g, double x, int way)
{
    double *rate = g->work, *slope = rate + g->n, *end = rate + 7 * g->n, h = 0.0, bias = way * BIAS * g->size;
    for (int step = 0; step < FLOW_STEPS; step++) {
        double T = flow_rates(g, x, g->v, bias, rate, slope), k = T > 0.0 ? g->k : 0.0, fastest = 0.0, falls = 0.0;
        for (int j = 0; j < g->n; j++) {
            fastest = fmax(fastest, fabs(rate[j]));
            falls = fmax(falls, -slope[j]);
        }
        if (fastest <= 1e-9 * g->size && stable(g, slope, k)) return;
        if (h == 0.0) h = 0.01 * g->length / (g->size + g->k * g->length);
        if (falls > 0.0) h = fmin(h, 1.0 / falls);
        double error = flow_step(g, x, g->v, bias, rate, slope, k, h, end) / (FLOW_ERROR * g->length);
        if (error <= 1.0) memcpy(g->v, end, sizeof(double) * (size_t)g->n);
        h *= fmin(4.0, fmax(0.2, 0.8 / cbrt(fmax(error, 1e-3))));
    }
    g->reason = "the snap of a hysteretic string finds no end";
}

/* Stretches on which part j may be counted at g->v[j]: one, or two where it stands at an end. */
static int places(const graph *g, int j, int32_t out[2])
{
    const ts_law *part = g->part + j;
    double u = g->v[j], near = 1e-6 * g->length, stop = ts_law_stop(part);
    int i = ts_law_at(part, u), count = 0;
    if (u >= stop) {
        out[count++] = part->n;
        return count;
    }
    out[count++] = i;
    if (i > 0 && u - part->s[i].p.lo < near) out[count++] = i - 1;
    else if (part->s[i].p.hi - u < near) out[count++] = i + 1;
    return count;
}

/* Branch of the stable state g->v at the elongation x; -1: none. */
static int32_t land(graph *g, double x, int way)
{
    if (g->k * (x - total(g, g->v)) <= 1e-7 * g->size) return slack_branch(g, way);
    int32_t *choice = g->next + g->n;
    memset(choice, 0, sizeof *choice * (size_t)g->n);
    for (int tries = 0; tries < 64; tries++) {
        int carry = 1;
        for (int j = 0; j < g->n; j++) {
            int32_t two[2];
            int count = places(g, j, two);
            g->next[j] = two[choice[j]];
            if (carry) { /* the next choice, as if counting */
                choice[j] = (choice[j] + 1) % count;
                carry = choice[j] == 0;
            }
        }
        int32_t found = find_branch(g, g->next, x, g->v, 0);
        if (found >= 0 || g->reason) return found;
        if (carry) break;
    }
    g->reason = "a snap of a hysteretic string ends in a state that is not stable";
    return -1;
}

/* Others than parts j and k come to equilibrium with these held in g->v, on their stretches `at`; falling ones and those at their
 * stops stay.  Returns T. */
static double hold(graph *g, double x, const int32_t *at, int j, int k)
{
    double low = 0.0, high = g->k * x;
    for (int n = 0; n < 100 && high > low; n++) {
        double T = 0.5 * (low + high), sum = T / g->k;
        if (!(T > low && T < high)) break;
        for (int i = 0; i < g->n; i++) {
            const ts_law *part = g->part + i;
            if (i != j && i != k)
                g->v[i] = at[i] < part->n && part->s[at[i]].way > 0 ? ts_law_inverse(part, at[i], T, g->v[i]) : g->u[i];
            sum += g->v[i];
        }
        if (sum > x) high = T; else low = T;
    }
    return low;
}

/* Displace part j from g->u. */
static void push(graph *g, int j, double distance)
{
    g->v[j] = fmin(fmax(g->u[j] + distance, 0.0), ts_law_stop(g->part + j));
}

/* What drives part j on in g->v if the tension is T, N. */
static double drive(const graph *g, int j, double T)
{
    double slope;
    return T - ts_law_force(g->part + j, ts_law_at(g->part + j, g->v[j]), g->v[j], &slope);
}

/* The state g->u at x gives way: part j is pushed (1: on, -1: back), another one, where it falls too, the other way (-1: none).  The
 * branch where that ends. */
static int32_t snap(graph *g, double x, const int32_t *at, int j, int other, int way)
{
    const ts_law *part = g->part + j;
    int on = ts_law_at(part, g->u[j]);
    double distance = PUSH * g->length;
    for (int i = on > 0 ? on - 1 : 0; i < part->n && i <= on + 1; i++) /* little enough for the shortest stretch beside it */
        distance = fmin(distance, PUSH * (part->s[i].p.hi - part->s[i].p.lo));
    memcpy(g->v, g->u, sizeof(double) * (size_t)g->n);
    for (int n = 0;; n++, distance *= 2.0) {
        push(g, j, way * distance);
        if (other >= 0) push(g, other, -way * distance);
        double T = hold(g, x, at, j, other);
        if (way * (drive(g, j, T) - (other >= 0 ? drive(g, other, T) : 0.0)) > 0.0) break;
        if (n < 12) continue;
        g->reason = "a hysteretic string has no stable state next to one of its ends";
        return -1;
    }
    flow(g, x, way);
    g->snapped = 1;
    return g->reason ? -1 : land(g, x, way);
}

/* --- the search ---------------------------------------------------------------------------------------------------- */

static int falls(const graph *g, const int32_t *at, int j) { return at[j] < g->part[j].n && g->part[j].s[at[j]].way <= 0; }

/* Stretch on which part j goes on from an end of a branch where the force is T, going up (1) or down (-1). */
static int32_t moved(const graph *g, const state *s, int j, double T, int way)
{
    const ts_law *part = g->part + j;
    int on = s->at[j], falling = s->leader >= 0 && falls(g, s->at, s->leader), up = falling ? -way : way;
    double same = SAME * g->size;
    if (falling && j == s->leader) { /* it goes with the elongation */
        double end = way > 0 ? part->s[on].p.hi : part->s[on].p.lo;
        return fabs(g->u[j] - end) <= 1e-14 * fabs(end) ? on + way : on;
    }
    if (on >= part->n) return up < 0 && T <= part->s[part->n - 1].force[1] + same ? part->n - 1 : on;
    if (up > 0) return T >= part->s[on].force[1] - same ? on + 1 : on;
    return on > 0 && T <= part->s[on].force[0] + same ? on - 1 : on;
}

/* What follows where parts come to the ends of their stretches. */
static int32_t beyond_bound(graph *g, const branch *b, double x, double T, int way)
{
    const state *s = g->states + b->state;
    int32_t *at = g->next + 2 * g->n, found = -1;
    int first = -1, entering = -1, leader = s->leader, others = leader >= 0 && falls(g, s->at, leader);
    memcpy(at, s->at, sizeof *at * (size_t)g->n); /* the list of states may move */
    int32_t on_lead = others ? moved(g, s, leader, T, way) : 0;
    int turns = others && (on_lead >= g->part[leader].n || g->part[leader].s[on_lead].way > 0); /* so does the force: others stay */
    for (int j = 0; j < g->n; j++) {
        g->next[j] = turns && j != leader ? at[j] : moved(g, s, j, T, way);
        if (g->next[j] == at[j]) continue;
        if (first < 0) first = j;
        if (j == leader) others = 0;
        if (!falls(g, g->next, j)) continue;
        if (entering < 0) entering = j;
        else g->next[j] = at[j]; /* the lowest index first */
    }
    if (first < 0) {
        g->reason = "a branch of a hysteretic string ends for no reason";
        return -1;
    }
    int pushed = entering >= 0 ? entering : others ? leader : first;
    int on = entering < 0 && others ? way : g->next[pushed] > at[pushed] ? 1 : -1;
    memcpy(at, g->next, sizeof *at * (size_t)g->n);
    if (others && entering >= 0) return snap(g, x, at, pushed, leader, on); /* two falling ones are never stable */
    found = find_branch(g, at, x, g->u, way);
    return found >= 0 || g->reason ? found : snap(g, x, at, pushed, -1, on);
}

/* The taut branch that a slack one leads to. */
static int32_t beyond_slack(graph *g, double x)
{
    for (int j = 0; j < g->n; j++) {
        const ts_law *part = g->part + j;
        int i = ts_law_at(part, g->u[j]);
        if (g->u[j] >= ts_law_stop(part)) i = part->n;
        else if (g->u[j] > 0.0 && g->u[j] >= part->s[i].p.hi) i++;
        g->next[j] = i;
    }
    int32_t found = find_branch(g, g->next, x, g->u, 1);
    if (found < 0 && !g->reason) g->reason = "the force of a part of a hysteretic series does not rise from 0";
    return found;
}

/* The branch that follows branch i at an end, going up (1) or down (-1); and what that dissipates, J. */
static int32_t follow(graph *g, int32_t i, int way, double *loss)
{
    branch b = g->branches[i];
    int side = way > 0;
    int32_t found;
    *loss = 0.0;
    g->snapped = 0;
    if (b.cause[side] == ENDLESS) return -1;
    if (b.cause[side] == JOINT) return i + way;
    end_state(g, &b, side);
    double x = b.x[side], before = energy(g, x, g->u);
    if (b.state < 0) return beyond_slack(g, x);
    memcpy(g->v, g->u, sizeof(double) * (size_t)g->n);
    if (b.cause[side] == ZERO) {
        found = slack_branch(g, way);
        g->snapped = 1;
    } else if (b.cause[side] == FOLD) {
        int32_t *at = g->next + 2 * g->n;
        memcpy(at, g->states[b.state].at, sizeof *at * (size_t)g->n); /* the list of states may move */
        found = snap(g, x, at, g->states[b.state].leader, -1, way);
    } else {
        found = beyond_bound(g, &b, x, b.T[side], way);
    }
    if (found >= 0 && g->snapped) *loss = fmax(0.0, before - energy(g, x, g->v));
    return found;
}

/* Number of a branch's piece; the first time it is asked for it joins the queue. */
static int32_t piece_of(graph *g, int32_t i)
{
    if (i < 0 || g->reason) return -1;
    if (g->branches[i].piece >= 0) return g->branches[i].piece;
    if (g->c->pieces == MOST_PIECES) {
        g->reason = "a hysteretic string has more than 4096 pieces; give it fewer parts or the single_valued law";
        return -1;
    }
    g->reached[g->c->pieces] = i;
    return g->branches[i].piece = g->c->pieces++;
}

static int32_t snapped_on(const graph *g, const branch *b)
{
    int32_t count = 0;
    for (int j = 0; j < g->n; j++)
        count += ts_law_snapped(g->part + j, b->state < 0 ? ts_law_at(g->part + j, b->slack[j]) : g->states[b->state].at[j]);
    return count;
}

/* The piece of a branch, with its rows. */
static void make_piece(graph *g, ts_piece *p, branch *b)
{
    int side = b->state < 0;
    end_state(g, b, side);
    double force = b->T[side], start = energy(g, b->x[side], g->u);
    *p = (ts_piece){.kind = b->kind, .snapped = snapped_on(g, b), .lo = b->x[0], .hi = b->x[1], .force = force, .energy = start};
    if (b->kind == TS_SLACK || b->kind == TS_STRAIGHT) return;
    ts_rise r = rise_of(g, b);
    int fold = b->kind == TS_FOLD_ABOVE ? 1 : b->kind == TS_FOLD_BELOW ? -1 : 0;
    double compliance = ts_rise_straight(&r), width = fmax(b->x[0], 1e-3);
    const char *reason;
    if (compliance > 0.0 && !fold) reason = ts_fit_line(p, &g->c->table, &g->rows, force, 1.0 / compliance);
    else if (b->kind == TS_OPEN) reason = ts_fit_open(p, &g->c->table, &g->rows, ts_rise_force, &r, width, g->size);
    else reason = ts_fit_piece(p, &g->c->table, &g->rows, fold ? ts_rise_off_fold : ts_rise_force, &r, TS_FIT_ERROR * g->size);
    if (reason) g->reason = reason;
    else ts_piece_integrate(p, g->c->table, start);
}

static void search(graph *g)
{
    memset(g->v, 0, sizeof(double) * (size_t)g->n);
    piece_of(g, slack_branch(g, -1));
    for (int32_t i = 0; i < g->c->pieces && !g->reason; i++) {
        double loss[2];
        int32_t up = follow(g, g->reached[i], 1, loss + 1), down = g->reason ? -1 : follow(g, g->reached[i], -1, loss);
        up = piece_of(g, up);
        down = piece_of(g, down);
        ts_piece *more = realloc(g->c->piece, sizeof *more * (size_t)(g->c->pieces + 1));
        if (!more) {
            g->reason = "out of memory";
            return;
        }
        g->c->piece = more;
        if (!g->reason) make_piece(g, more + i, g->branches + g->reached[i]);
        more[i].up = up;
        more[i].down = down;
        more[i].loss_up = loss[1];
        more[i].loss_down = loss[0];
    }
}

static void free_graph(graph *g)
{
    for (int32_t i = 0; i < g->state_count; i++) free(g->states[i].at);
    for (int32_t i = 0; i < g->branch_count; i++) free(g->branches[i].slack);
    free(g->states);
    free(g->branches);
    free(g->reached);
    free(g->work);
    free(g->next);
}

/* The curve of n parts in series with memory; a reason why there is none, or NULL. */
const char *ts_hysteresis(ts_curve *c, const ts_law *part, int n, double stiffness)
{
    graph g = {.c = c, .part = part, .n = n, .k = stiffness};
    memset(c, 0, sizeof *c);
    c->branches = 1;
    g.reached = malloc(sizeof *g.reached * MOST_PIECES);
    g.work = calloc(11 * (size_t)n, sizeof *g.work);
    g.next = calloc(3 * (size_t)n, sizeof *g.next);
    if (!g.reached || !g.work || !g.next) g.reason = "out of memory";
    else g.u = g.work + 8 * n, g.v = g.u + n, g.on_rise = g.v + n;
    if (!(stiffness > 0.0)) g.reason = "the stiffness of a hysteretic string must be positive";
    for (int j = 0; j < n; j++) {
        double last = part[j].s[part[j].n - 1].p.hi;
        g.size = fmax(g.size, ts_law_largest(part + j));
        g.length += last < INFINITY ? last : part[j].s[part[j].n - 1].p.lo;
    }
    if (g.size == 0.0) g.size = 1.0; /* springs only */
    g.length += g.size / stiffness;
    if (!g.reason) search(&g);
    free_graph(&g);
    if (g.reason) ts_curve_free(c);
    return g.reason;
}
