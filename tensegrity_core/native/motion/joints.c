/* Joined bars: a saddle point on their graph.
 *
 * A thin bar of mass m has the constant mass matrix m/6 [2 1; 1 2] (x) I in its nodes' coordinates.  With e = sum of coef x of a
 * constraint's nodes and the direction n = e/l of a length, or the unit vectors n across a flat body of a follower,
 *     M a - G' lambda = Q,    G a = -|e'|^2/l of a length, 0 of a follower,    G = coef n'.
 * A length's multiplier is then minus the bar's force in N (eq. 1).  Each node's rows are divided by its diagonal mass, each
 * multiplier is counted in units of the smallest of these at its nodes, so that all entries are of order 1: the matrix E.
 * A row of multipliers is a block, too: what its constraint leaves of it is the identity.  Along axes along which a node is held its
 * rows say what its acceleration is.  The block elimination of linear/blocks.h eliminates a multiplier behind its constraint's
 * nodes, where its pivot is -G M^-1 G' of what has been eliminated, and says where it vanishes.
 *
 * Constraints that follow from others have no multiplier; ts_joint_outputs() finds the multipliers of least norm. */
#include "motion/joints.h"
#include "linear/blocks.h"
#include "linear/pattern.h"
#include "model/data.h"
#include "motion/bases.h"

#include <float.h>
#include <math.h>
#include <string.h>

#define PLACE(tie, which, a, b) ((tie)->place[which][(a) * (TS_TIE_NODES + 1) + (b)])
#define DROPPED_DRIFT 1e-6 /* relative, of a length that should follow from others */
#define ITERATIONS 12
#define LOCKED 1e5 /* solutions of E that large say that it is all but singular */

/* Mass of a bar, or of a string's segment that moves like one. */
static double mass_of(const ts_sim *sim, const ts_tie *tie)
{
    if (tie->bar >= 0) return sim->io.values[sim->m.at[TS_BAR_MASS] + tie->bar];
    return tie->heavy < 0 ? 0.0 : tie->part * sim->io.values[sim->m.at[TS_STRING_MASS] + tie->heavy];
}

/* What it has on the diagonal beside what its nodes have already: of a bar m/3, of a string m/3 less the m/2 that are lumped. */
static double own_mass(const ts_sim *sim, const ts_tie *tie) { return mass_of(sim, tie) / (tie->bar >= 0 ? 3.0 : -6.0); }

/* The ties that have a mass: bars' stand first, strings' last. */
static const ts_tie *massive(const ts_joints *j, int i) { return j->tie + (i < j->bars ? i : j->count + i - j->bars); }
static double inverse(const ts_sim *sim, int spot) { return sim->inertia.inverse[sim->m.joint.first + spot]; }

/* Its acceleration where a node does not move by itself: that of a moved node, or 0. */
static double known_acceleration(const ts_sim *sim, int node, int d)
{
    const int e = sim->m.drive.mover[node], D = sim->m.count[TS_D];
    return e < 0 ? 0.0 : sim->bases.now[(3 * e + 2) * D + d];
}

/* The same of a joined node along an axis along which it is held. */
static double pushed_acceleration(const ts_sim *sim, int spot, int d)
{
    const ts_joints *j = &sim->m.joint;
    return j->pushed[spot] >> d & 1 ? sim->bases.now[(3 * j->mover[spot] + 2) * sim->m.count[TS_D] + d] : 0.0;
}

static int is_held(const ts_joints *j, int spot, int d) { return j->held[spot] >> d & 1; }

/* --- masses --------------------------------------------------------------------------------------------------------------- */

/* Inverse masses and weights of the joined nodes' blocks. */
void ts_weigh_joints(ts_sim *sim)
{
    const ts_joints *j = &sim->m.joint;
    ts_joint_work *w = &sim->joined;
    double *own = sim->inertia.inverse + j->first, *laden = sim->inertia.laden + j->first;
    for (int i = 0; i < j->nodes; i++) own[i] = laden[i] = sim->inertia.extra[j->node[i]];
    memset(w->half, 0, sizeof(double) * (size_t)sim->m.count[TS_N]);
    for (int i = 0; i < j->bars + j->links; i++)
        for (int k = 0; k < 2; k++) {
            const ts_tie *tie = massive(j, i);
            const double weight = tie->bar >= 0 ? 0.5 * mass_of(sim, tie) : 0.0;
            w->half[tie->node[k]] += weight;
            if (tie->spot[k] >= 0) own[tie->spot[k]] += own_mass(sim, tie), laden[tie->spot[k]] += weight;
        }
    for (int i = 0; i < j->nodes; i++) own[i] = 1.0 / own[i];
    for (int i = 0; i < j->count; i++) {
        double least = INFINITY;
        for (int k = 0; k < j->tie[i].count; k++)
            if (j->tie[i].spot[k] >= 0) least = fmin(least, 1.0 / own[j->tie[i].spot[k]]);
        if (j->tie[i].row >= 0) w->scale[j->tie[i].row] = least;
    }
}

/* --- constraints ---------------------------------------------------------------------------------------------------------- */

/* e of a tie, from x (N, 2, D): its positions (part 0) or velocities (1). */
static void extent(const ts_tie *tie, const double *x, int part, double *e, int D)
{
    for (int d = 0; d < D; d++) e[d] = 0.0;
    for (int k = 0; k < tie->count; k++)
        for (int d = 0; d < D; d++) e[d] += tie->coef[k] * x[(2 * tie->node[k] + part) * D + d];
}

/* The same from accelerations (N, D). */
static void extent_of(const ts_tie *tie, const double *a, double *e, int D)
{
    for (int d = 0; d < D; d++) e[d] = 0.0;
    for (int k = 0; k < tie->count; k++)
        for (int d = 0; d < D; d++) e[d] += tie->coef[k] * a[tie->node[k] * D + d];
}

static double product(const double *a, const double *b, int D)
{
    double sum = 0.0;
    for (int d = 0; d < D; d++) sum += a[d] * b[d];
    return sum;
}

static void cross(const double *a, const double *b, double *c)
{
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

static void make_unit(double *a, int D)
{
    const double over = 1.0 / sqrt(product(a, a, D));
    for (int d = 0; d < D; d++) a[d] *= over;
}

/* Edges of a follower's frame; returns how many. */
static int frame_edges(const ts_tie *tie, const double *x, double edge[2][3], int D)
{
    const double *origin = x + 2 * tie->node[1] * D;
    for (int k = 2; k < tie->count; k++)
        for (int d = 0; d < D; d++) edge[k - 2][d] = x[2 * tie->node[k] * D + d] - origin[d];
    return tie->count - 2;
}

/* Unit vectors across a follower's frame. */
static void across_frame(const ts_tie *tie, const double *x, double *n, int D)
{
    double edge[2][3], other[3] = {0.0, 0.0, 0.0};
    const int edges = frame_edges(tie, x, edge, D);
    if (D == 2) {
        n[0] = -edge[0][1];
        n[1] = edge[0][0];
    } else if (edges == 2) {
        cross(edge[0], edge[1], n);
    } else {
        int least = fabs(edge[0][0]) <= fabs(edge[0][1]) ? 0 : 1;
        if (fabs(edge[0][2]) < fabs(edge[0][least])) least = 2;
        other[least] = 1.0;
        cross(edge[0], other, n);
        cross(edge[0], n, n + 3);
        make_unit(n + 3, 3);
    }
    make_unit(n, D);
}

/* Directions of all constraints. */
static void point(ts_sim *sim, const double *x)
{
    const ts_joints *j = &sim->m.joint;
    const int D = sim->m.count[TS_D];
    for (int i = 0; i < j->count; i++) {
        double *n = sim->joined.across + 2 * i * D;
        if (j->tie[i].follows) {
            across_frame(j->tie + i, x, n, D);
            continue;
        }
        extent(j->tie + i, x, 0, n, D);
        for (int d = 0; d < D; d++) n[d] /= j->tie[i].length;
    }
}

/* I - E in matrix `which`. */
static void assemble(const ts_sim *sim, int which, double *J)
{
    const ts_joints *j = &sim->m.joint;
    const int D = sim->m.count[TS_D];
    const ts_pattern *p = which ? &sim->linear.pattern : &sim->joined.pattern;
    memset(J, 0, sizeof(double) * (size_t)p->count * (size_t)(D * D));
    for (int i = 0; i < j->count + j->links; i++) {
        const ts_tie *tie = j->tie + i;
        const double mass = mass_of(sim, tie), *n = sim->joined.across + 2 * i * D;
        for (int a = 0; a < 2 && mass > 0.0; a++) {
            if (tie->spot[a] < 0 || tie->spot[1 - a] < 0) continue;
            for (int d = 0; d < D; d++)
                if (!is_held(j, tie->spot[a], d))
                    J[PLACE(tie, which, a, 1 - a) + d * D + d] -= inverse(sim, tie->spot[a]) * mass / 6.0;
        }
        if (tie->row < 0) continue;
        for (int r = 0; r < tie->directions; r++) J[j->own[which][j->nodes + tie->row] + r * D + r] = 1.0;
        for (int k = 0; k < tie->count; k++) {
            if (tie->spot[k] < 0) continue;
            const double back = inverse(sim, tie->spot[k]) * sim->joined.scale[tie->row];
            double *row = J + PLACE(tie, which, tie->count, k), *column = J + PLACE(tie, which, k, tie->count);
            for (int r = 0; r < tie->directions; r++)
                for (int d = 0; d < D; d++) {
                    row[r * D + d] = -tie->coef[k] * n[r * D + d];
                    if (!is_held(j, tie->spot[k], d)) column[d * D + r] = back * tie->coef[k] * n[r * D + d];
                }
        }
    }
}

/* Factorise E at x (N, 2, D); 0 where the constraints lock. */
static int factorise(ts_sim *sim, const double *x)
{
    ts_joint_work *w = &sim->joined;
    point(sim, x);
    assemble(sim, 0, w->J);
    const int done = ts_blocks_factorise(&w->pattern, 1.0, w->J, w->zero, w->factor);
    w->factored = done;
    if (!done) w->failed = 1;
    return done;
}

/* --- accelerations -------------------------------------------------------------------------------------------------------- */

/* From the masses of the bars that the node in place k has with nodes that do not move by themselves. */
static double carried(const ts_sim *sim, const ts_tie *tie, int k, int d)
{
    return tie->spot[1 - k] >= 0 ? 0.0 : mass_of(sim, tie) / 6.0 * known_acceleration(sim, tie->node[1 - k], d);
}

/* All accelerations, from those of the joined nodes (a: of the blocks). */
static void spread(ts_sim *sim, const double *a)
{
    const ts_model *m = &sim->m;
    const int D = m->count[TS_D];
    for (int n = 0; n < m->count[TS_N]; n++) {
        const int spot = m->joint.spot[n];
        for (int d = 0; d < D; d++)
            sim->joined.a[n * D + d] = spot >= 0 ? a[(m->joint.first + spot) * D + d] : known_acceleration(sim, n, d);
    }
}

/* Inertia of the joined bars less the forces of the multipliers, at all nodes. */
static void react(ts_sim *sim)
{
    const ts_joints *j = &sim->m.joint;
    const int D = sim->m.count[TS_D];
    ts_joint_work *w = &sim->joined;
    memset(w->reaction, 0, sizeof(double) * (size_t)(sim->m.count[TS_N] * D));
    for (int i = 0; i < j->bars + j->links; i++) {
        const ts_tie *tie = massive(j, i);
        const double own = own_mass(sim, tie), coupling = mass_of(sim, tie) / 6.0;
        for (int k = 0; k < 2; k++)
            for (int d = 0; d < D; d++)
                w->reaction[tie->node[k] * D + d] +=
                    own * w->a[tie->node[k] * D + d] + coupling * w->a[tie->node[1 - k] * D + d];
    }
    for (int i = 0; i < j->count; i++)
        for (int k = 0; k < j->tie[i].count; k++)
            for (int r = 0; r < j->tie[i].directions; r++)
                for (int d = 0; d < D; d++)
                    w->reaction[j->tie[i].node[k] * D + d] -=
                        j->tie[i].coef[k] * w->lambda[2 * i + r] * w->across[(2 * i + r) * D + d];
}

/* Accelerations of the joined nodes in the place of their forces over their masses, and the multipliers, at the positions and
 * velocities of the last evaluation. */
void ts_join(ts_sim *sim, double tau, const double *y, double *a)
{
    const ts_joints *j = &sim->m.joint;
    ts_joint_work *w = &sim->joined;
    const int D = sim->m.count[TS_D];
    const double *x = sim->strings.x;
    double *own = a + j->first * D, *rows = w->b + j->nodes * D, e[3];
    (void)tau;
    (void)y;
    w->failed = 0;
    if (!factorise(sim, x)) {
        for (int i = 0; i < j->nodes * D; i++) own[i] = NAN;
        return;
    }
    memset(rows, 0, sizeof(double) * (size_t)(j->rows * D));
    for (int i = 0; i < j->nodes * D; i++) w->b[i] = own[i], w->force[i] = own[i] / inverse(sim, i / D);
    for (int i = 0; i < j->bars + j->links; i++) {
        const ts_tie *tie = massive(j, i);
        for (int k = 0; k < 2; k++)
            for (int d = 0; d < D && tie->spot[k] >= 0; d++)
                w->b[tie->spot[k] * D + d] -= inverse(sim, tie->spot[k]) * carried(sim, tie, k, d);
    }
    for (int i = 0; i < j->count; i++) {
        const ts_tie *tie = j->tie + i;
        if (tie->row < 0) continue;
        extent(tie, x, 1, e, D);
        if (!tie->follows) rows[tie->row * D] = -product(e, e, D) / tie->length;
        for (int k = 0; k < tie->count; k++)
            for (int r = 0; r < tie->directions && tie->spot[k] < 0; r++)
                for (int d = 0; d < D; d++)
                    rows[tie->row * D + r] -=
                        tie->coef[k] * w->across[(2 * i + r) * D + d] * known_acceleration(sim, tie->node[k], d);
    }
    for (int i = 0; i < j->nodes; i++)
        for (int d = 0; d < D; d++)
            if (is_held(j, i, d)) w->b[i * D + d] = pushed_acceleration(sim, i, d);
    ts_blocks_solve(&w->pattern, w->factor, w->b);
    memcpy(own, w->b, sizeof(double) * (size_t)(j->nodes * D));
    for (int i = 0; i < j->count; i++)
        for (int r = 0; r < 2; r++) {
            const int row = j->tie[i].row;
            w->lambda[2 * i + r] = row >= 0 && r < j->tie[i].directions ? w->scale[row] * rows[row * D + r] : 0.0;
        }
    spread(sim, a);
    if (sim->m.count[TS_E]) react(sim);
}

/* Force of what moves node e of the moved ones along axis d, where joined bars are (N). */
double ts_pull_on_joint(const ts_sim *sim, int e, int d)
{
    const ts_model *m = &sim->m;
    const int D = m->count[TS_D], node = m->packed.moved[e], spot = m->joint.spot[node];
    const double inertia = sim->inertia.extra[node] * sim->joined.a[node * D + d] + sim->joined.reaction[node * D + d];
    if (spot >= 0) return m->joint.pushed[spot] >> d & 1 ? inertia - sim->joined.force[spot * D + d] : 0.0;
    const double weight = (sim->inertia.extra[node] + sim->joined.half[node]) * sim->inertia.gravity[d];
    return inertia - weight - sim->strings.node_force[node * D + d];
}

/* --- constraints put right -------------------------------------------------------------------------------------------------- */

/* Positions and velocities of the ends of joined bars at tau, from the state; moved axes there are put where they belong. */
static void place_nodes(ts_sim *sim, double tau, double *y)
{
    const ts_model *m = &sim->m;
    const ts_joints *j = &m->joint;
    const int D = m->count[TS_D];
    double at[3], v[3];
    for (int i = 0; i < j->nodes; i++) {
        double *q = y + (j->first + i) * D, *qd = q + m->nq;
        if (j->pushed[i]) ts_base_at(&sim->bases, D, tau, j->mover[i], at, v);
        for (int d = 0; d < D; d++)
            if (j->pushed[i] >> d & 1) q[d] = at[d], qd[d] = v[d];
        memcpy(sim->joined.x + 2 * j->node[i] * D, q, sizeof(double) * (size_t)D);
        memcpy(sim->joined.x + (2 * j->node[i] + 1) * D, qd, sizeof(double) * (size_t)D);
    }
    for (int n = 0; n < m->count[TS_N]; n++) {
        double *x = sim->joined.x + 2 * n * D;
        if (!m->packed.fixed[n]) continue;
        for (int d = 0; d < D; d++) x[d] = m->node.anchor[n * D + d], x[D + d] = 0.0;
        if (m->drive.mover[n] >= 0) ts_base_at(&sim->bases, D, tau, m->drive.mover[n], x, x + D);
    }
}

/* The largest number among the positions (part 0, m) or velocities (1, m/s). */
static double largest(const ts_sim *sim, int part)
{
    const int D = sim->m.count[TS_D];
    double most = 0.0;
    for (int i = 0; i < sim->m.joint.nodes; i++)
        for (int d = 0; d < D; d++) most = fmax(most, fabs(sim->joined.x[(2 * sim->m.joint.node[i] + part) * D + d]));
    return most;
}

/* What positions (part 0, m) or velocities (1, m/s) miss of the constraints, into the rows of b; returns the largest, of positions
 * relative, with the coordinates' round-off in mind.  A length that should follow from others counts only where it does not. */
static double missing(ts_sim *sim, int part)
{
    const ts_joints *j = &sim->m.joint;
    const int D = sim->m.count[TS_D];
    const double size = part ? 0.0 : largest(sim, 0);
    double most = 0.0, e[3], *rows = sim->joined.b + j->nodes * D;
    memset(sim->joined.b, 0, sizeof(double) * (size_t)((j->nodes + j->rows) * D));
    for (int i = 0; i < j->count; i++) {
        const ts_tie *tie = j->tie + i;
        extent(tie, sim->joined.x, part, e, D);
        for (int r = 0; r < tie->directions; r++) {
            double along = product(sim->joined.across + (2 * i + r) * D, e, D);
            if (!part && !tie->follows) along = 0.5 * (product(e, e, D) / tie->length - tie->length);
            if (tie->row < 0 && !part && !(fabs(along) < DROPPED_DRIFT * tie->length)) sim->joined.failed = 1;
            if (tie->row < 0) continue;
            rows[tie->row * D + r] = -along;
            most = fmax(most, part ? fabs(along) : fabs(along) / (tie->length + size));
        }
    }
    return most;
}

/* Add the solution in b to the positions (part 0) or velocities (1). */
static void shift(ts_sim *sim, int part)
{
    const ts_joints *j = &sim->m.joint;
    const int D = sim->m.count[TS_D];
    for (int i = 0; i < j->nodes; i++)
        for (int d = 0; d < D; d++) sim->joined.x[(2 * j->node[i] + part) * D + d] += sim->joined.b[i * D + d];
}

/* Newton's iteration along M^-1 G', with the factor at hand as long as it helps; 0: it does not converge. */
static int correct(ts_sim *sim, int part)
{
    double last = INFINITY;
    for (int it = 0; it < ITERATIONS; it++) {
        point(sim, sim->joined.x);
        const double scale = part ? largest(sim, 1) : 1.0, miss = missing(sim, part);
        if (sim->joined.failed || !(miss < INFINITY)) return 0;
        if (miss <= DBL_EPSILON * scale) return 1;
        if (miss > 0.5 * last && (miss <= 1e-13 * scale || it > 4)) return miss <= 1e-11 * scale;
        if ((!sim->joined.factored || miss > 0.01 * last) && !factorise(sim, sim->joined.x)) return 0;
        last = miss;
        ts_blocks_solve(&sim->joined.pattern, sim->joined.factor, sim->joined.b);
        shift(sim, part);
    }
    return 0;
}

/* Put the joined nodes back on their constraints at tau: positions, then velocities.  Where that cannot be, the state is none. */
void ts_put_back(ts_sim *sim, double tau, double *y)
{
    const ts_model *m = &sim->m;
    const ts_joints *j = &m->joint;
    const int D = m->count[TS_D];
    sim->joined.failed = sim->joined.factored = 0;
    place_nodes(sim, tau, y);
    const int done = correct(sim, 0) && correct(sim, 1);
    for (int i = 0; i < j->nodes; i++)
        for (int d = 0; d < D; d++) {
            y[(j->first + i) * D + d] = done ? sim->joined.x[2 * j->node[i] * D + d] : NAN;
            y[m->nq + (j->first + i) * D + d] = done ? sim->joined.x[(2 * j->node[i] + 1) * D + d] : NAN;
        }
    sim->joined.failed = !done;
}

/* Do constraints fail, or is a motion near for which they need forces without bounds?  Solutions of E are of order 1 elsewhere. */
int ts_joints_lock(ts_sim *sim)
{
    const ts_joints *j = &sim->m.joint;
    const int D = sim->m.count[TS_D];
    double most = 0.0;
    if (sim->joined.failed || !factorise(sim, sim->strings.x)) return 1;
    for (int i = 0; i < (j->nodes + j->rows) * D; i++) sim->joined.b[i] = i % 3 - 1.2;
    ts_blocks_solve(&sim->joined.pattern, sim->joined.factor, sim->joined.b);
    for (int i = 0; i < (j->nodes + j->rows) * D; i++) most = fmax(most, fabs(sim->joined.b[i]));
    return !(most < LOCKED + (double)j->rows * j->rows); /* a long chain is soft at its end */
}

/* Largest deviation of a length, or of what its rate makes of it within `ahead` (s), relative. */
double ts_joint_drift(ts_sim *sim, const double *y, double ahead)
{
    const ts_joints *j = &sim->m.joint;
    const int D = sim->m.count[TS_D];
    double most = 0.0, e[3], ed[3];
    for (int i = 0; i < j->nodes; i++)
        for (int d = 0; d < D; d++) {
            sim->joined.x[2 * j->node[i] * D + d] = y[(j->first + i) * D + d];
            sim->joined.x[(2 * j->node[i] + 1) * D + d] = y[sim->m.nq + (j->first + i) * D + d];
        }
    for (int n = 0; n < sim->m.count[TS_N]; n++)
        if (j->spot[n] < 0) memcpy(sim->joined.x + 2 * n * D, sim->strings.x + 2 * n * D, 2 * sizeof(double) * (size_t)D);
    for (int i = 0; i < j->count; i++) {
        const double length = j->tie[i].length;
        extent(j->tie + i, sim->joined.x, 0, e, D);
        extent(j->tie + i, sim->joined.x, 1, ed, D);
        if (j->tie[i].follows) most = fmax(most, sqrt(product(e, e, D)) / length);
        else most = fmax(most, 0.5 * fabs(product(e, e, D) / (length * length) - 1.0));
        most = fmax(most, ahead * fabs(product(e, ed, D)) / (length * length));
    }
    return most;
}

/* The impulse of moved nodes whose velocities jump; before: their velocities (E, D).  Positions that jump are followed. */
void ts_jump_joints(ts_sim *sim, const double *before)
{
    const ts_model *m = &sim->m;
    const ts_joints *j = &m->joint;
    const int D = m->count[TS_D];
    double *y = sim->state.y, v[3], x[3];
    place_nodes(sim, 0.0, y);
    memset(sim->joined.a, 0, sizeof(double) * (size_t)(m->count[TS_N] * D)); /* jumps of the known velocities */
    for (int e = 0; e < m->count[TS_E]; e++) {
        const int node = m->packed.moved[e], spot = j->spot[node];
        ts_base_at(&sim->bases, D, 0.0, e, x, v);
        for (int d = 0; d < D; d++)
            if (spot < 0 || j->pushed[spot] >> d & 1) sim->joined.a[node * D + d] = v[d] - before[e * D + d];
    }
    if (!factorise(sim, sim->joined.x)) return; /* ts_put_back() will say so */
    missing(sim, 1);
    for (int i = 0; i < j->bars + j->links; i++)
        for (int k = 0; k < 2; k++) {
            const ts_tie *tie = massive(j, i);
            const double share = mass_of(sim, tie) / 6.0;
            const int other = tie->spot[1 - k];
            for (int d = 0; d < D && tie->spot[k] >= 0; d++) {
                const int known = other < 0 || is_held(j, other, d);
                if (known && !is_held(j, tie->spot[k], d))
                    sim->joined.b[tie->spot[k] * D + d] -=
                        inverse(sim, tie->spot[k]) * share * sim->joined.a[tie->node[1 - k] * D + d];
            }
        }
    ts_blocks_solve(&sim->joined.pattern, sim->joined.factor, sim->joined.b);
    shift(sim, 1);
    for (int i = 0; i < j->nodes; i++)
        memcpy(y + m->nq + (j->first + i) * D, sim->joined.x + (2 * j->node[i] + 1) * D, sizeof(double) * (size_t)D);
    ts_put_back(sim, 0.0, y);
}

/* --- energy and outputs ----------------------------------------------------------------------------------------------------- */

/* Kinetic energy of joined bars and nodes; v: rates of the blocks (J). */
double ts_joint_energy(const ts_sim *sim, const double *v)
{
    static const double at_rest[3] = {0.0, 0.0, 0.0};
    const ts_model *m = &sim->m;
    const ts_joints *j = &m->joint;
    const int D = m->count[TS_D];
    double sum = 0.0;
    for (int i = 0; i < j->nodes; i++) {
        const double *at = v + (j->first + i) * D;
        sum += 0.5 * sim->inertia.extra[j->node[i]] * product(at, at, D);
    }
    for (int i = 0; i < j->bars + j->links; i++) {
        const ts_tie *tie = massive(j, i);
        const double *end[2];
        for (int k = 0; k < 2; k++) {
            const int spot = tie->spot[k], e = m->drive.mover[tie->node[k]];
            end[k] = spot >= 0 ? v + (j->first + spot) * D : e >= 0 ? sim->bases.now + (3 * e + 1) * D : at_rest;
        }
        sum += 0.5 * own_mass(sim, tie) * (product(end[0], end[0], D) + product(end[1], end[1], D));
        sum += mass_of(sim, tie) / 6.0 * product(end[0], end[1], D);
    }
    return sum;
}

/* What of the joined bars' masses hangs on fixed nodes, times where these are along axis d (kg m). */
double ts_joint_weight(const ts_sim *sim, int d)
{
    const ts_model *m = &sim->m;
    const int D = m->count[TS_D];
    double sum = 0.0;
    for (int n = 0; n < m->count[TS_N]; n++) {
        const int e = m->drive.mover[n];
        if (m->packed.fixed[n] && m->joint.bears[n])
            sum += sim->joined.half[n] * (e < 0 ? m->node.anchor[n * D + d] : sim->bases.now[3 * e * D + d]);
    }
    return sum;
}

/* Solve the small system A z = b, of which square holds the rows (A, b), into its last column; A is positive definite. */
static void solve_small(double *square, int n)
{
    for (int p = 0; p < n; p++)
        for (int i = 0; i < n; i++) {
            double *row = square + i * (n + 1), *pivot = square + p * (n + 1);
            if (i == p) continue;
            const double f = row[p] / pivot[p];
            for (int k = p; k <= n; k++) row[k] -= f * pivot[k];
        }
    for (int p = 0; p < n; p++) square[p * (n + 1) + n] /= square[p * (n + 1) + p];
}

/* Forces that hold each other: of each tie without a row the one of 1 there. */
static void find_null_forces(ts_sim *sim)
{
    const ts_joints *j = &sim->m.joint;
    const int D = sim->m.count[TS_D];
    ts_joint_work *w = &sim->joined;
    for (int i = 0, at = 0; i < j->count; i++) {
        const ts_tie *tie = j->tie + i;
        if (tie->row >= 0) continue;
        double *null = w->null + 2 * at++ * j->count;
        memset(w->b, 0, sizeof(double) * (size_t)((j->nodes + j->rows) * D));
        for (int k = 0; k < 2; k++)
            for (int d = 0; d < D && tie->spot[k] >= 0; d++)
                if (!is_held(j, tie->spot[k], d))
                    w->b[tie->spot[k] * D + d] = inverse(sim, tie->spot[k]) * tie->coef[k] * w->across[2 * i * D + d];
        ts_blocks_solve(&w->pattern, w->factor, w->b);
        for (int n = 0; n < j->count; n++) { /* as force per length, and of a follower likewise */
            const int row = j->tie[n].row;
            for (int r = 0; r < 2; r++)
                null[2 * n + r] = row < 0 || r >= j->tie[n].directions
                                      ? 0.0
                                      : w->scale[row] * w->b[(j->nodes + row) * D + r] / j->tie[n].length;
        }
        null[2 * i] = 1.0 / tie->length;
    }
}

/* Of all multipliers that make the same motion those of least norm, as forces per length. */
static void least_norm(ts_sim *sim)
{
    const ts_joints *j = &sim->m.joint;
    ts_joint_work *w = &sim->joined;
    const int n = j->dropped, width = 2 * j->count;
    if (!n) return;
    find_null_forces(sim);
    for (int a = 0; a < n; a++) {
        double *row = w->square + a * (n + 1);
        for (int b = 0; b < n; b++) {
            row[b] = 0.0;
            for (int i = 0; i < width; i++) row[b] += w->null[a * width + i] * w->null[b * width + i];
        }
        row[n] = 0.0;
        for (int i = 0; i < width; i++) row[n] += w->null[a * width + i] * w->lambda[i] / j->tie[i / 2].length;
    }
    solve_small(w->square, n);
    for (int a = 0; a < n; a++)
        for (int i = 0; i < width; i++)
            w->lambda[i] -= w->square[a * (n + 1) + n] * w->null[a * width + i] * j->tie[i / 2].length;
}

/* Bars' forces and reactions, with the loads on the nodes at hand, from the last evaluation's multipliers. */
void ts_joint_outputs(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    const ts_joints *j = &m->joint;
    const int D = m->count[TS_D];
    double *values = sim->io.values;
    spread(sim, sim->start.f + m->nq);
    least_norm(sim); /* between fixed nodes it decides on reactions, too */
    react(sim);
    for (int n = 0; n < m->count[TS_N]; n++)
        for (int d = 0; d < D && j->ground[n] >= 0; d++) {
            if (j->spot[n] < 0 && !j->bears[n]) continue;
            const int holds = j->spot[n] < 0 || is_held(j, j->spot[n], d);
            values[m->at[TS_REACTION] + j->ground[n] * D + d] =
                holds ? sim->joined.reaction[n * D + d] - sim->strings.node_force[n * D + d] : 0.0;
        }
    for (int i = 0; i < j->bars; i++) values[m->at[TS_BAR_FORCE] + j->tie[i].bar] = -sim->joined.lambda[2 * i];
}

/* --- Jacobian --------------------------------------------------------------------------------------------------------------- */

/* A block of the Jacobian += w times the identity, but for the axes along which the row's node is held. */
static void add_identity(const ts_joints *j, double *A, int spot, double w, int D)
{
    for (int d = 0; d < D; d++)
        if (!is_held(j, spot, d)) A[d * D + d] += w;
}

/* How a length's force turns with it: lambda e/l. */
static void turn_length(ts_sim *sim, int i, int exact, int D)
{
    const ts_joints *j = &sim->m.joint;
    const ts_tie *tie = j->tie + i;
    const double density = sim->joined.lambda[2 * i] / tie->length;
    if (!exact && density > 0.0) return;
    for (int a = 0; a < 2; a++)
        for (int b = 0; b < 2; b++) {
            const double w = tie->coef[a] * tie->coef[b] * density;
            if (tie->spot[a] < 0) continue;
            if (tie->spot[b] >= 0)
                add_identity(j, sim->linear.Jq + PLACE(tie, 1, a, b), tie->spot[a], inverse(sim, tie->spot[a]) * w, D);
            const int e = tie->spot[b] < 0 ? sim->m.drive.mover[tie->node[b]] : -1;
            for (int d = 0; d < D && e >= 0; d++)
                sim->linear.ft[(j->first + tie->spot[a]) * D + d] +=
                    inverse(sim, tie->spot[a]) * w * sim->bases.now[(3 * e + 1) * D + d];
        }
}

/* How a follower's force f turns with its frame: df = -E (E'E)^-1 dE' f, E the frame's edges. */
static void turn_follower(ts_sim *sim, int i, const double *x, int D)
{
    const ts_joints *j = &sim->m.joint;
    const ts_tie *tie = j->tie + i;
    double edge[2][3], dual[3][3] = {{0.0}}, f[3] = {0.0, 0.0, 0.0};
    const int edges = frame_edges(tie, x, edge, D);
    for (int r = 0; r < tie->directions; r++)
        for (int d = 0; d < D; d++) f[d] += sim->joined.lambda[2 * i + r] * sim->joined.across[(2 * i + r) * D + d];
    const double g00 = product(edge[0], edge[0], D), g01 = edges > 1 ? product(edge[0], edge[1], D) : 0.0;
    const double g11 = edges > 1 ? product(edge[1], edge[1], D) : 1.0, over = 1.0 / (g00 * g11 - g01 * g01);
    for (int d = 0; d < D; d++) {
        dual[1][d] = over * (g11 * edge[0][d] - (edges > 1 ? g01 * edge[1][d] : 0.0));
        dual[2][d] = edges > 1 ? over * (g00 * edge[1][d] - g01 * edge[0][d]) : 0.0;
        dual[0][d] = -dual[1][d] - dual[2][d];
    }
    for (int a = 0; a < tie->count; a++)
        for (int b = 1; b < tie->count && tie->spot[a] >= 0; b++) {
            const double w = -inverse(sim, tie->spot[a]) * tie->coef[a];
            const int e = tie->spot[b] < 0 ? sim->m.drive.mover[tie->node[b]] : -1;
            for (int r = 0; r < D; r++) {
                if (is_held(j, tie->spot[a], r)) continue;
                for (int c = 0; c < D; c++) {
                    if (tie->spot[b] >= 0) sim->linear.Jq[PLACE(tie, 1, a, b) + r * D + c] += w * dual[b - 1][r] * f[c];
                    else if (e >= 0)
                        sim->linear.ft[(j->first + tie->spot[a]) * D + r] +=
                            w * dual[b - 1][r] * f[c] * sim->bases.now[(3 * e + 1) * D + c];
                }
            }
        }
}

/* Along axes along which a joined node is held nothing changes its acceleration but time. */
static void hold_rows(ts_sim *sim, double tau, int D)
{
    const ts_joints *j = &sim->m.joint;
    const ts_pattern *p = &sim->linear.pattern;
    for (int i = 0; i < j->nodes; i++)
        for (int d = 0; d < D; d++) {
            const int block = j->first + i;
            if (!is_held(j, i, d)) continue;
            for (int n = p->row[block]; n < p->row[block + 1]; n++)
                for (int c = 0; c < D; c++) sim->linear.Jq[(n * D + d) * D + c] = sim->linear.Jv[(n * D + d) * D + c] = 0.0;
            sim->linear.ft[block * D + d] = j->pushed[i] >> d & 1 ? ts_base_jerk(&sim->bases, D, tau, j->mover[i], d) : 0.0;
        }
}

/* The constraints' own rows: of a length (e.e'' + |e'|^2)/l. */
static void constrain_rows(ts_sim *sim, const ts_tie *tie, const double *x, int D)
{
    double ed[3], edd[3];
    extent(tie, x, 1, ed, D);
    extent_of(tie, sim->joined.a, edd, D);
    for (int k = 0; k < tie->count; k++)
        for (int d = 0; d < D && tie->spot[k] >= 0; d++) {
            sim->linear.Jq[PLACE(tie, 1, tie->count, k) + d] = -tie->coef[k] * edd[d] / tie->length;
            sim->linear.Jv[PLACE(tie, 1, tie->count, k) + d] = -2.0 * tie->coef[k] * ed[d] / tie->length;
        }
}

/* What moved nodes make of the constraints with time, into the rows of b, and of the masses carried along, into ft. */
static void constrain_by_time(ts_sim *sim, double tau, int i, const double *x, int D)
{
    const ts_joints *j = &sim->m.joint;
    const ts_tie *tie = j->tie + i;
    double ed[3], edd[3];
    extent(tie, x, 1, ed, D);
    extent_of(tie, sim->joined.a, edd, D);
    for (int k = 0; k < tie->count; k++) {
        const int e = tie->spot[k] < 0 ? sim->m.drive.mover[tie->node[k]] : -1;
        if (e < 0) continue;
        const double *v = sim->bases.now + (3 * e + 1) * D, *a = v + D;
        for (int d = 0; d < D; d++) {
            const double jerk = ts_base_jerk(&sim->bases, D, tau, e, d);
            if (k < 2 && mass_of(sim, tie) > 0.0 && tie->spot[1 - k] >= 0)
                sim->linear.ft[(j->first + tie->spot[1 - k]) * D + d] -=
                    inverse(sim, tie->spot[1 - k]) * mass_of(sim, tie) / 6.0 * jerk;
            if (tie->row < 0) continue;
            double *rows = sim->joined.b + (j->nodes + tie->row) * D;
            if (!tie->follows) rows[0] -= tie->coef[k] * (edd[d] * v[d] + 2.0 * ed[d] * a[d]) / tie->length;
            for (int r = 0; r < tie->directions; r++) rows[r] -= tie->coef[k] * sim->joined.across[(2 * i + r) * D + d] * jerk;
        }
    }
}

/* What joints make of the Jacobian, whose rows of joined nodes hold forces over masses so far: a step solves with the mass matrix
 * and the multipliers, methods/joined.c.  ft becomes that of the accelerations. */
void ts_joint_jacobian(ts_sim *sim, double tau, const double *y, int exact)
{
    const ts_joints *j = &sim->m.joint;
    const int D = sim->m.count[TS_D], n = j->nodes * D;
    const double *x = sim->strings.x;
    double *a = sim->joined.work, *ft = sim->linear.ft + j->first * D;
    for (int i = 0; i < n; i++) a[j->first * D + i] = inverse(sim, i / D) * sim->linear.work[j->first * D + i];
    ts_join(sim, tau, y, a);
    assemble(sim, 1, sim->joined.whole);
    memset(sim->joined.b, 0, sizeof(double) * (size_t)(n + j->rows * D));
    for (int i = 0; i < j->count; i++) {
        if (!j->tie[i].follows) turn_length(sim, i, exact, D);
        else if (exact) turn_follower(sim, i, x, D);
        if (exact && j->tie[i].row >= 0 && !j->tie[i].follows) constrain_rows(sim, j->tie + i, x, D);
        if (exact && sim->m.count[TS_E]) constrain_by_time(sim, tau, i, x, D);
    }
    for (int i = j->count; exact && i < j->count + j->links && sim->m.count[TS_E]; i++) constrain_by_time(sim, tau, i, x, D);
    hold_rows(sim, tau, D);
    if (!exact) return;
    for (int i = 0; i < n; i++) sim->joined.b[i] = ft[i];
    ts_blocks_solve(&sim->joined.pattern, sim->joined.factor, sim->joined.b);
    memcpy(ft, sim->joined.b, sizeof(double) * (size_t)n);
}

/* One column of a Jacobian (rows, with those of the multipliers behind them) becomes that of the accelerations. */
static void eliminate(ts_sim *sim, double *column)
{
    const ts_joints *j = &sim->m.joint;
    const int D = sim->m.count[TS_D], n = j->nodes * D;
    memcpy(sim->joined.b, column + j->first * D, sizeof(double) * (size_t)n);
    memcpy(sim->joined.b + n, column + sim->m.nq, sizeof(double) * (size_t)(j->rows * D));
    ts_blocks_solve(&sim->joined.pattern, sim->joined.factor, sim->joined.b);
    memcpy(column + j->first * D, sim->joined.b, sizeof(double) * (size_t)n);
}

/* Jacobians (nq, nq) of the accelerations from the blocks at hand. */
void ts_eliminate_multipliers(ts_sim *sim, double *Jq, double *Jv)
{
    const ts_pattern *p = &sim->linear.pattern;
    const int D = sim->m.count[TS_D], nq = sim->m.nq;
    for (int which = 0; which < 2; which++)
        for (int c = 0; c < nq; c++) {
            const double *J = which ? sim->linear.Jv : sim->linear.Jq;
            double *column = sim->joined.work, *out = which ? Jv : Jq;
            for (int i = 0; i < p->n; i++) {
                const int at = ts_pattern_place(p, i, c / D);
                for (int r = 0; r < D; r++) column[i * D + r] = at < 0 ? 0.0 : J[at + r * D + c % D];
            }
            eliminate(sim, column);
            for (int i = 0; i < nq; i++) out[i * nq + c] = column[i];
        }
}
