/* Parts in series with memory: the curve of a string whose parts' elongations u follow a stable minimum of
 *     Pi(u; x) = sum U_j(u_j) + k/2 (x - sum u)^2,  T = k (x - sum u) = f_j(u_j),
 * k the string's own stiffness, x its elongation.
 *
 * At the end of a branch (branches.c) the adjacent one, if it goes on in the direction of motion, joins; else the parts snap
 * (flow.c), ties to the lowest index, and what Pi loses is dissipated.  A slack string has T = 0.  All branches that can be
 * reached from the slack one are found by a search, breadth first. */
#include "laws/memory/hysteresis.h"
#include "laws/curve.h"
#include "invariants.h"
#include "laws/fit.h"
#include "laws/memory/branches.h"
#include "laws/memory/flow.h"
#include "laws/memory/graph.h"
#include "laws/rise.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PUSH 1e-3  /* first displacement from an unstable point, of a piece */
#define DRIVE 1e-8 /* what must drive it on from there, of the largest force */

/* --- snaps --------------------------------------------------------------------------------------------------------- */

/* Elongation at which a part that bears nothing comes to rest, on the way from u. */
static double relaxed(const ts_law *part, int piece, double u, int way)
{
    const ts_law_piece *s = part->piece + piece;
    if (piece == 0 && s->way > 0 && s->force[0] >= 0.0) return 0.0;
    if (s->way > 0 && s->force[1] < 0.0 && u >= s->p.hi) return s->p.hi;
    if (s->way > 0 && s->force[0] <= 0.0 && s->force[1] >= 0.0) return ts_law_inverse(part, piece, 0.0, u);
    if (way > 0) {
        for (int i = piece + 1; i < part->n; i++)
            if (part->piece[i].way > 0 && part->piece[i].force[1] >= 0.0) return ts_law_inverse(part, i, 0.0, u);
        return ts_law_stop(part);
    }
    for (int i = piece - 1; i > 0; i--)
        if (part->piece[i].way > 0 && part->piece[i].force[0] <= 0.0) return ts_law_inverse(part, i, 0.0, u);
    return 0.0;
}

/* The slack branch of the parts at g->v, which relax. */
static int32_t slack_branch(ts_graph *g, int way)
{
    for (int j = 0; j < g->n; j++) g->v[j] = relaxed(g->part + j, ts_law_at(g->part + j, g->v[j]), g->v[j], way);
    for (int32_t i = 0; i < g->branch_count; i++) {
        double apart = 0.0;
        if (g->branches[i].state >= 0) continue;
        for (int j = 0; j < g->n; j++) apart = fmax(apart, fabs(g->branches[i].slack[j] - g->v[j]));
        if (apart <= TS_NEAR * g->length) return i;
    }
    double *own = (double *)malloc(sizeof *own * (size_t)g->n);
    if (!own) {
        g->reason = "out of memory";
        return -1;
    }
    memcpy(own, g->v, sizeof *own * (size_t)g->n);
    ts_branch b = ts_branch_of(-1, TS_SLACK);
    b.cause[0] = TS_ENDLESS;
    b.cause[1] = TS_BOUND;
    b.slack = own;
    b.x[0] = -INFINITY;
    b.x[1] = ts_parts_total(g, own);
    int32_t index = ts_branch_add(g, b);
    if (index < 0) free(own);
    return index;
}

/* Stretches on which part j may be counted at g->v[j]: one, or two where it stands at an end. */
static int places(const ts_graph *g, int j, int32_t out[2])
{
    const ts_law *part = g->part + j;
    double u = g->v[j], near = 1e-6 * g->length, stop = ts_law_stop(part);
    int i = ts_law_at(part, u), count = 0;
    if (u >= stop) {
        out[count++] = part->n;
        return count;
    }
    out[count++] = i;
    if (i > 0 && u - part->piece[i].p.lo < near) out[count++] = i - 1;
    else if (part->piece[i].p.hi - u < near) out[count++] = i + 1;
    return count;
}

/* Branch of the stable state g->v at the elongation x; -1: none. */
static int32_t land(ts_graph *g, double x, int way)
{
    if (g->k * (x - ts_parts_total(g, g->v)) <= 1e-7 * g->size) return slack_branch(g, way);
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
        int32_t found = ts_branch_find(g, g->next, x, g->v, 0);
        if (found >= 0 || g->reason) return found;
        if (carry) break;
    }
    g->reason = "a snap of a hysteretic string ends in a state that is not stable";
    return -1;
}

/* Elongation where a part bears T on a rising piece or on those that it joins. */
static double risen(const ts_law *part, int on, double T, double guess)
{
    while (on > 0 && T < part->piece[on].force[0] && part->piece[on - 1].way > 0) on--;
    while (on < part->n - 1 && T > part->piece[on].force[1] && part->piece[on + 1].way > 0) on++;
    return ts_law_inverse(part, on, T, guess);
}

/* Others than parts j and k come to equilibrium with these held in g->v, on their pieces `at`; falling ones and those at
 * their stops stay.  Returns T. */
static double hold(ts_graph *g, double x, const int32_t *at, int j, int k)
{
    double low = 0.0, high = g->k * x;
    for (int n = 0; n < 100 && high > low; n++) {
        double T = 0.5 * (low + high), sum = T / g->k;
        if (!(T > low && T < high)) break;
        for (int i = 0; i < g->n; i++) {
            const ts_law *part = g->part + i;
            if (i != j && i != k)
                g->v[i] = at[i] < part->n && part->piece[at[i]].way > 0 ? risen(part, at[i], T, g->v[i]) : g->u[i];
            sum += g->v[i];
        }
        if (sum > x) high = T;
        else low = T;
    }
    return low;
}

/* Displace part j from g->u. */
static void push(ts_graph *g, int j, double distance)
{
    g->v[j] = fmin(fmax(g->u[j] + distance, 0.0), ts_law_stop(g->part + j));
}

/* What drives part j on in g->v if the tension is T, N. */
static double drive(const ts_graph *g, int j, double T)
{
    double slope;
    return T - ts_law_force(g->part + j, ts_law_at(g->part + j, g->v[j]), g->v[j], &slope);
}

/* The state g->u at x gives way: part j is pushed (1: on, -1: back), another one, where it falls too, the other way (-1:
 * none).  The branch where that ends. */
static int32_t snap(ts_graph *g, double x, const int32_t *at, int j, int other, int way)
{
    const ts_law *part = g->part + j;
    int on = ts_law_at(part, g->u[j]);
    double distance = PUSH * g->length;
    for (int i = on > 0 ? on - 1 : 0; i < part->n && i <= on + 1; i++) /* little enough for the shortest piece beside it */
        distance = fmin(distance, PUSH * (part->piece[i].p.hi - part->piece[i].p.lo));
    memcpy(g->v, g->u, sizeof(double) * (size_t)g->n);
    for (int n = 0;; n++, distance *= 2.0) {
        push(g, j, way * distance);
        if (other >= 0) push(g, other, -way * distance);
        double T = hold(g, x, at, j, other);
        if (way * (drive(g, j, T) - (other >= 0 ? drive(g, other, T) : 0.0)) > DRIVE * g->size) break;
        if (n < 16) continue;
        g->reason = "a hysteretic string has no stable state next to one of its ends";
        return -1;
    }
    ts_flow(g, x, way);
    g->snapped = 1;
    return g->reason ? -1 : land(g, x, way);
}

/* --- the search ---------------------------------------------------------------------------------------------------- */

static int falls(const ts_graph *g, const int32_t *at, int j)
{
    return at[j] < g->part[j].n && g->part[j].piece[at[j]].way <= 0;
}

/* Stretch on which part j goes on from an end of a branch where the force is T, going up (1) or down (-1). */
static int32_t moved(const ts_graph *g, const ts_state *s, int j, double T, int way)
{
    const ts_law *part = g->part + j;
    int on = s->at[j], falling = s->leader >= 0 && falls(g, s->at, s->leader), up = falling ? -way : way;
    double near = TS_ENDED * g->length, slope;
    if (falling && j == s->leader) { /* it goes with the elongation */
        double end = way > 0 ? part->piece[on].p.hi : part->piece[on].p.lo;
        return fabs(g->u[j] - end) <= near ? on + way : on;
    }
    if (on >= part->n) {
        double stop = ts_law_force(part, part->n - 1, ts_law_stop(part), &slope);
        return up < 0 && T <= stop * (1.0 + TS_TIE) + slope * near ? part->n - 1 : on;
    }
    const ts_law_piece *here = part->piece + on;
    double tie = ts_law_tie(here);
    if (up > 0) return T >= here->force[1] - tie || g->u[j] >= here->p.hi - near ? on + 1 : on;
    return on > 0 && (T <= here->force[0] + tie || g->u[j] <= here->p.lo + near) ? on - 1 : on;
}

/* The branch that joins on where one of the parts that come to maxima together falls, the others going back; -1: there is none.
 * A stable state is followed, whichever it is. */
static int32_t joining_fall(ts_graph *g, const ts_state *s, double x, double T, int way)
{
    int32_t *at = g->next + g->n, found = -1, state = (int32_t)(s - g->states);
    for (int j = 0; j < g->n && found < 0 && !g->reason; j++) {
        const ts_state *here = g->states + state; /* the list may have moved */
        memcpy(at, here->at, sizeof *at * (size_t)g->n);
        if (falls(g, at, j)) continue;
        at[j] = moved(g, here, j, T, way);
        if (at[j] != here->at[j] && falls(g, at, j)) found = ts_branch_find(g, at, x, g->u, way);
    }
    return found;
}

/* What follows where parts come to the ends of their pieces. */
static int32_t beyond_bound(ts_graph *g, const ts_branch *b, double x, double T, int way)
{
    const ts_state *s = g->states + b->state;
    int32_t *at = g->next + 2 * g->n, found = -1;
    int first = -1, entering = -1, leader = s->leader, others = leader >= 0 && falls(g, s->at, leader);
    memcpy(at, s->at, sizeof *at * (size_t)g->n); /* the list of states may move */
    int32_t on_lead = others ? moved(g, s, leader, T, way) : 0;
    /* where the leader comes to a rise, the force turns: the others stay */
    int turns = others && (on_lead >= g->part[leader].n || g->part[leader].piece[on_lead].way > 0);
    for (int j = 0; j < g->n; j++) {
        g->next[j] = turns && j != leader ? at[j] : moved(g, s, j, T, way);
        if (g->next[j] == at[j]) continue;
        if (first < 0) first = j;
        if (j == leader) others = 0;
        if (!falls(g, g->next, j)) continue;
        if (entering < 0) entering = j;
        else g->next[j] = at[j]; /* the lowest index first */
    }
    if (entering >= 0 && !others && !falls(g, at, entering)) { /* from a rise to a fall the force turns, too */
        for (int j = 0; j < g->n; j++)
            if (j != entering) g->next[j] = at[j];
        found = joining_fall(g, s, x, T, way);
        if (found >= 0 || g->reason) return found;
    }
    if (first < 0) {
        g->reason = "a branch of a hysteretic string ends for no reason";
        return -1;
    }
    int pushed = entering >= 0 ? entering : others ? leader : first;
    int on = entering < 0 && others ? way : g->next[pushed] > at[pushed] ? 1 : -1;
    memcpy(at, g->next, sizeof *at * (size_t)g->n);
    if (others && entering >= 0) return snap(g, x, at, pushed, leader, on); /* two falling ones are never stable */
    found = ts_branch_find(g, at, x, g->u, way);
    return found >= 0 || g->reason ? found : snap(g, x, at, pushed, -1, on);
}

/* The taut branch that a slack one leads to. */
static int32_t beyond_slack(ts_graph *g, double x)
{
    for (int j = 0; j < g->n; j++) {
        const ts_law *part = g->part + j;
        int i = ts_law_at(part, g->u[j]);
        if (g->u[j] >= ts_law_stop(part)) i = part->n;
        else if (g->u[j] > 0.0 && g->u[j] >= part->piece[i].p.hi) i++;
        g->next[j] = i;
    }
    int32_t found = ts_branch_find(g, g->next, x, g->u, 1);
    if (found < 0 && !g->reason) g->reason = "the force of a part of a hysteretic series does not rise from 0";
    return found;
}

/* The branch that follows branch i at an end, going up (1) or down (-1); and what that dissipates, J. */
static int32_t follow(ts_graph *g, int32_t i, int way, double *loss)
{
    ts_branch b = g->branches[i];
    int side = way > 0;
    int32_t found;
    *loss = 0.0;
    g->snapped = 0;
    if (b.cause[side] == TS_ENDLESS) return -1;
    if (b.cause[side] == TS_JOINT) return i + way;
    ts_branch_end(g, &b, side);
    double x = b.x[side], before = ts_parts_energy(g, x, g->u);
    if (b.state < 0) return beyond_slack(g, x);
    memcpy(g->v, g->u, sizeof(double) * (size_t)g->n);
    if (b.cause[side] == TS_ZERO) {
        found = slack_branch(g, way);
        g->snapped = 1;
    } else if (b.cause[side] == TS_FOLD) {
        int32_t *at = g->next + 2 * g->n;
        memcpy(at, g->states[b.state].at, sizeof *at * (size_t)g->n); /* the list of states may move */
        found = snap(g, x, at, g->states[b.state].leader, -1, way);
    } else {
        found = beyond_bound(g, &b, x, b.T[side], way);
    }
    if (found >= 0 && g->snapped) *loss = fmax(0.0, before - ts_parts_energy(g, x, g->v));
    return found;
}

/* Number of a branch's piece; the first time it is asked for it joins the queue. */
static int32_t piece_of(ts_graph *g, int32_t i)
{
    if (i < 0 || g->reason) return -1;
    if (g->branches[i].piece >= 0) return g->branches[i].piece;
    if (g->c->pieces == TS_MOST_PIECES) {
        g->reason = "a hysteretic string has more than 4096 pieces; give it fewer parts or the single_valued law";
        return -1;
    }
    TS_ASSERT(i < g->branch_count);
    g->reached[g->c->pieces] = i;
    return g->branches[i].piece = g->c->pieces++;
}

static int32_t snapped_on(const ts_graph *g, const ts_branch *b)
{
    int32_t count = 0;
    for (int j = 0; j < g->n; j++)
        count += ts_law_snapped(g->part + j, b->state < 0 ? ts_law_at(g->part + j, b->slack[j]) : g->states[b->state].at[j]);
    return count;
}

/* The piece of a branch, with its rows. */
static void make_piece(ts_graph *g, ts_piece *p, ts_branch *b)
{
    int side = b->state < 0;
    ts_branch_end(g, b, side);
    double force = b->T[side], start = ts_parts_energy(g, b->x[side], g->u);
    *p = ts_piece_of(b->kind, b->x[0], b->x[1], snapped_on(g, b));
    p->force = force;
    p->energy = start;
    if (b->kind == TS_SLACK || b->kind == TS_STRAIGHT) return;
    ts_rise r = ts_branch_rise(g, b);
    r.mover = g->mover;
    ts_rise_gather(&r);
    int fold = b->kind == TS_FOLD_ABOVE ? 1 : b->kind == TS_FOLD_BELOW ? -1 : 0;
    double compliance = ts_rise_straight(&r), width = fmax(b->x[0], 1e-3);
    const char *reason;
    if (compliance > 0.0 && !fold) reason = ts_fit_line(p, &g->c->table, &g->rows, force, 1.0 / compliance);
    else if (b->kind == TS_OPEN) reason = ts_fit_open(p, &g->c->table, &g->rows, ts_rise_force, &r, width, g->size);
    else reason = ts_fit_piece(p, &g->c->table, &g->rows, fold ? ts_rise_off_fold : ts_rise_force, &r, TS_FIT_ERROR * g->size);
    if (reason) g->reason = reason;
    else ts_piece_integrate(p, g->c->table, start);
}

static void search(ts_graph *g)
{
    memset(g->v, 0, sizeof(double) * (size_t)g->n);
    piece_of(g, slack_branch(g, -1));
    for (int32_t i = 0; i < g->c->pieces && !g->reason; i++) {
        double loss[2] = {0.0, 0.0};
        int32_t up = follow(g, g->reached[i], 1, loss + 1), down = g->reason ? -1 : follow(g, g->reached[i], -1, loss);
        up = piece_of(g, up);
        down = piece_of(g, down);
        ts_piece *more = (ts_piece *)realloc(g->c->piece, sizeof *more * (size_t)(g->c->pieces + 1));
        if (!more) {
            g->reason = "out of memory";
            return;
        }
        g->c->piece = more;
        if (!g->reason) make_piece(g, more + i, g->branches + g->reached[i]);
        TS_ASSERT(up < g->c->pieces && down < g->c->pieces && !(loss[0] < 0.0) && !(loss[1] < 0.0));
        more[i].up = up;
        more[i].down = down;
        more[i].loss_up = loss[1];
        more[i].loss_down = loss[0];
    }
}

static void free_graph(ts_graph *g)
{
    for (int32_t i = 0; i < g->state_count; i++) free(g->states[i].at);
    for (int32_t i = 0; i < g->branch_count; i++) free(g->branches[i].slack);
    free(g->states);
    free(g->branches);
    free(g->reached);
    free(g->work);
    free(g->next);
    free(g->mover);
}

/* The curve of n parts in series with memory; a reason why there is none, or NULL. */
const char *ts_hysteresis(ts_curve *c, const ts_law *part, int n, double stiffness)
{
    ts_graph g;
    memset(&g, 0, sizeof g);
    g.c = c;
    g.part = part;
    g.n = n;
    g.k = stiffness;
    memset(c, 0, sizeof *c);
    c->branches = 1;
    g.reached = (int32_t *)malloc(sizeof *g.reached * TS_MOST_PIECES);
    g.work = (double *)calloc(11 * (size_t)n, sizeof *g.work);
    g.next = (int32_t *)calloc(3 * (size_t)n, sizeof *g.next);
    g.mover = (ts_mover *)calloc((size_t)n, sizeof *g.mover);
    if (!g.reached || !g.work || !g.next || !g.mover) g.reason = "out of memory";
    else g.u = g.work + 8 * n, g.v = g.u + n, g.on_rise = g.v + n;
    if (!(stiffness > 0.0)) g.reason = "the stiffness of a hysteretic string must be positive";
    for (int j = 0; j < n; j++) {
        double last = part[j].piece[part[j].n - 1].p.hi;
        if (part[j].piece[0].way <= 0) g.reason = "the force of a part of a hysteretic series does not rise from 0";
        g.size = fmax(g.size, ts_law_largest(part + j));
        g.length += last < INFINITY ? last : part[j].piece[part[j].n - 1].p.lo;
    }
    if (g.size == 0.0) g.size = 1.0; /* springs only */
    g.length += g.size / stiffness;
    if (!g.reason) search(&g);
    free_graph(&g);
    if (g.reason) ts_curve_free(c);
    return g.reason;
}
