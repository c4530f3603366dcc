/* States of parts in series with memory, and their branches.
 *
 * On given pieces of the parts (a state) T is smooth in the string's elongation x.  Where all of them rise, every
 * equilibrium is stable; where one falls, the one that leads, it is as long as dx/du of the leader is positive; where two
 * fall, none is.  So a state has branches in x, which end where a part comes to the end of its piece, where T vanishes, or
 * at a fold, dx/du = 0. */
#include "laws/memory/branches.h"
#include "laws/law.h"
#include "linear/pairs.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SCAN 96      /* samples of dx/du on a falling piece */
#define NARROW 1e-10 /* branches that are none, of the length: less than TS_ENDED, so that beyond such a one is the next */

ts_rise ts_branch_rise(ts_graph *g, const ts_branch *b)
{
    const ts_state *s = g->states + b->state;
    int fold = b->kind == TS_FOLD_ABOVE ? 1 : -1;
    ts_rise r = ts_rise_of(g->part, g->n, s->at, s->leader, g->on_rise);
    r.lo = b->u[0];
    r.hi = b->u[1];
    r.compliance = 1.0 / g->k;
    r.fold = fold;
    return r;
}

double ts_parts_total(const ts_graph *g, const double *u)
{
    double sum = 0.0;
    for (int j = 0; j < g->n; j++) sum += u[j];
    return sum;
}

/* Pi, J. */
double ts_parts_energy(const ts_graph *g, double x, const double *u)
{
    double own = fmax(0.0, x - ts_parts_total(g, u)), sum = 0.5 * g->k * own * own;
    for (int j = 0; j < g->n; j++) sum += ts_law_energy(g->part + j, ts_law_at(g->part + j, u[j]), u[j]);
    return sum;
}

/* Where a part stands on a piece at an end of a branch under T: at the piece's own end where the forces tie, since near an
 * extremum T tells only half the digits. */
static double at_end(const ts_law *part, int piece, double T, double guess)
{
    const ts_law_piece *s = part->piece + piece;
    for (int end = 0; end < 2; end++)
        if (fabs(T - s->force[end]) <= ts_law_tie(s)) return end ? s->p.hi : s->p.lo;
    return ts_law_inverse(part, piece, T, guess);
}

/* Elongation where the parts of a state bear T, theirs in g->on_rise; u: the leader's where it is level. */
static double bearing(ts_graph *g, const ts_state *s, double T, double u)
{
    for (int j = 0; j < g->n; j++) {
        const ts_law *part = g->part + j;
        if (s->at[j] >= part->n) g->on_rise[j] = ts_law_stop(part);
        else if (part->piece[s->at[j]].way == 0) g->on_rise[j] = u;
        else g->on_rise[j] = at_end(part, s->at[j], T, g->on_rise[j]);
    }
    return T / g->k + ts_parts_total(g, g->on_rise);
}

/* Ends of a branch are where its force is known, which finds parts at their extrema exactly, or folds. */
static void set_end(ts_graph *g, ts_branch *b, int side)
{
    double slope;
    if (b->cause[side] == TS_BOUND || b->cause[side] == TS_ZERO) {
        b->x[side] = bearing(g, g->states + b->state, b->T[side], b->u[side]);
    } else if (b->cause[side] == TS_ENDLESS) {
        b->x[side] = INFINITY;
    } else {
        ts_rise r = ts_branch_rise(g, b);
        b->x[side] = ts_rise_elongation(&r, b->u[side], b->T + side, &slope);
    }
}

/* The parts' elongations at an end of a branch into g->u. */
void ts_branch_end(ts_graph *g, ts_branch *b, int side)
{
    if (b->state < 0) {
        memcpy(g->u, b->slack, sizeof(double) * (size_t)g->n);
    } else {
        set_end(g, b, side);
        memcpy(g->u, g->on_rise, sizeof(double) * (size_t)g->n);
    }
}

ts_branch ts_branch_of(int32_t state, int32_t kind)
{
    ts_branch b;
    memset(&b, 0, sizeof b);
    b.state = state;
    b.kind = kind;
    return b;
}

int ts_branch_add(ts_graph *g, ts_branch b)
{
    ts_branch *more = (ts_branch *)realloc(g->branches, sizeof *more * ((size_t)g->branch_count + 1));
    if (!more) {
        g->reason = "out of memory";
        return -1;
    }
    g->branches = more;
    b.piece = -1;
    more[g->branch_count] = b;
    return g->branch_count++;
}

/* Forces that the parts other than the leader can bear on their pieces: from least to most, N. */
static void bounds(const ts_graph *g, const ts_state *s, double *least, double *most)
{
    *least = 0.0;
    *most = INFINITY;
    for (int j = 0; j < g->n; j++) {
        const ts_law *part = g->part + j;
        if (s->at[j] >= part->n) {
            *least = fmax(*least, part->piece[part->n - 1].force[1]);
        } else if (part->piece[s->at[j]].way > 0) {
            *least = fmax(*least, part->piece[s->at[j]].force[0]);
            *most = fmin(*most, part->piece[s->at[j]].force[1]);
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

/* A stable part of a falling piece makes a branch, or two where both its ends are folds. */
static void add_falling(ts_graph *g, ts_branch b, double u0, int cause0, double u1, int cause1)
{
    b.u[0] = u0;
    b.u[1] = u1;
    b.cause[0] = cause0;
    b.cause[1] = cause1;
    set_end(g, &b, 0);
    set_end(g, &b, 1);
    if (b.x[1] - b.x[0] <= NARROW * g->length) return;
    if (cause0 == TS_FOLD && cause1 == TS_FOLD) {
        ts_branch low = b, high = b;
        low.cause[1] = high.cause[0] = TS_JOINT;
        low.u[1] = high.u[0] = 0.5 * (u0 + u1);
        set_end(g, &low, 1);
        set_end(g, &high, 0);
        low.kind = TS_FOLD_BELOW;
        high.kind = TS_FOLD_ABOVE;
        ts_branch_add(g, low);
        ts_branch_add(g, high);
        return;
    }
    if (cause0 == TS_FOLD) b.kind = TS_FOLD_BELOW;
    if (cause1 == TS_FOLD) b.kind = TS_FOLD_ABOVE;
    if (cause1 == TS_ENDLESS) b.kind = TS_OPEN;
    ts_branch_add(g, b);
}

/* Branches where one part, the leader, falls: the pieces of it with dx/du > 0. */
static void explore_falling(ts_graph *g, int32_t index)
{
    const ts_state *s = g->states + index;
    const ts_law *lead = g->part + s->leader;
    const ts_law_piece *on = lead->piece + s->at[s->leader];
    double least, most, a = on->p.lo, b = on->p.hi, from = 0.0, last = 0.0, before = 0.0;
    bounds(g, s, &least, &most);
    if (on->force[1] > most || on->force[0] < least) return;
    int cause0 = TS_BOUND, cause1 = TS_BOUND, open = 0;
    ts_branch all = ts_branch_of(index, TS_GRADED);
    all.T[0] = fmin(most, on->force[0]);
    all.T[1] = fmax(least, on->force[1]);
    if (most < on->force[0]) a = ts_law_inverse(lead, s->at[s->leader], most, a);
    if (least > on->force[1]) {
        b = ts_law_inverse(lead, s->at[s->leader], least, a);
        if (least == 0.0) cause1 = TS_ZERO;
    }
    if (!(b > a)) return;
    if (!(b < INFINITY)) { /* a level piece without end: dx/du = 1 */
        add_falling(g, all, a, TS_BOUND, b, TS_ENDLESS);
        return;
    }
    all.u[0] = a;
    all.u[1] = b;
    ts_rise r = ts_branch_rise(g, &all);
    for (int i = 0; i <= SCAN; i++) {
        double t = fmin(fmax((double)i / SCAN, 0.003), 0.997), u = a + (b - a) * t * t * (3.0 - 2.0 * t);
        double now = stability(&r, u);
        if (i == 0) {
            open = now > 0.0;
            from = a;
        } else if ((now > 0.0) != (before > 0.0)) {
            double fold = fold_between(&r, last, u);
            if (open) add_falling(g, all, from, cause0, fold, TS_FOLD);
            else from = fold, cause0 = TS_FOLD;
            open = !open;
        } else if (open && i > 1 && i < SCAN) { /* may it dip below 0 between samples? */
            double t2 = fmin((i + 1.0) / SCAN, 0.997), beyond = a + (b - a) * t2 * t2 * (3.0 - 2.0 * t2), where;
            if (now < before && stability(&r, beyond) > now && least_between(&r, last, beyond, &where) < 0.0) {
                add_falling(g, all, from, cause0, fold_between(&r, last, where), TS_FOLD);
                from = fold_between(&r, where, beyond), cause0 = TS_FOLD;
                u = beyond, now = stability(&r, u), i++;
            }
        }
        last = u;
        before = now;
    }
    if (open) add_falling(g, all, from, cause0, b, cause1);
}

static void explore_rising(ts_graph *g, int32_t index)
{
    ts_state *s = g->states + index;
    double least, most;
    bounds(g, s, &least, &most);
    ts_branch b = ts_branch_of(index, TS_GRADED);
    b.T[0] = least;
    b.T[1] = most;
    b.cause[0] = least == 0.0 ? TS_ZERO : TS_BOUND;
    b.cause[1] = most < INFINITY ? TS_BOUND : TS_ENDLESS;
    if (!(most < INFINITY)) b.kind = s->leader < 0 ? TS_STRAIGHT : TS_OPEN; /* straight: all are at their stops */
    if (!(most > least * (1.0 + TS_TIE))) return;
    for (int j = 0; j < g->n; j++)
        if (s->at[j] < g->part[j].n && g->part[j].piece[s->at[j]].force[1] == most) {
            s->leader = j;
            break;
        }
    for (int side = 0; side < 2 && s->leader >= 0; side++)
        b.u[side] = ts_law_inverse(g->part + s->leader, s->at[s->leader], b.T[side], 0.0);
    set_end(g, &b, 0);
    set_end(g, &b, 1);
    if (b.x[1] - b.x[0] > NARROW * g->length) ts_branch_add(g, b);
}

/* The state of these pieces, with its branches; -1: out of memory. */
static int32_t find_state(ts_graph *g, const int32_t *at)
{
    size_t bytes = sizeof *at * (size_t)g->n;
    for (int32_t i = 0; i < g->state_count; i++)
        if (!memcmp(g->states[i].at, at, bytes)) return i;
    ts_state *more = (ts_state *)realloc(g->states, sizeof *more * ((size_t)g->state_count + 1));
    int32_t *own = (int32_t *)malloc(bytes);
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
        int falls = g->part[j].piece[at[j]].way <= 0;
        if (leader < 0 || (falls && !falling)) leader = j;
        falling += falls;
    }
    more[g->state_count] = MAKE(ts_state){own, leader, g->branch_count, 0};
    int32_t index = g->state_count++;
    if (falling == 1) explore_falling(g, index);
    else if (falling == 0) explore_rising(g, index);
    g->states[index].count = g->branch_count - g->states[index].first;
    return index;
}

/* The branch of a state that holds the elongation x with the parts at u; with a way (1 up, -1 down) one that begins there
 * and goes that way.  -1: there is none. */
int32_t ts_branch_find(ts_graph *g, const int32_t *at, double x, const double *u, int way)
{
    int32_t index = find_state(g, at);
    if (index < 0) return -1;
    const ts_state *s = g->states + index;
    for (int32_t i = s->first; i < s->first + s->count; i++) {
        const ts_branch *b = g->branches + i;
        double near = TS_NEAR * g->length, own = s->leader < 0 ? 0.0 : u[s->leader], far = 100.0 * near;
        if (x < b->x[0] - near || x > b->x[1] + near) continue;
        if (s->leader >= 0 && (own < b->u[0] - far || own > b->u[1] + far)) continue;
        if (way > 0 && !(x <= b->x[0] + near)) continue;
        if (way < 0 && !(x >= b->x[1] - near)) continue;
        return i;
    }
    return -1;
}
