/* What a packed model says of joints, and the layout that follows from it.
 *
 * Packed, int32: numbers of joined bars, joined nodes, distances that welds keep, ties that follow from others, followers,
 * masks of moved nodes, integers that say the welds, strings' masses that couple two nodes; bars,
 * rising; nodes, rising, of each the bits of the axes along which it is fixed; distances, of each two nodes; ties without a row of their own, rising, counted over bars and then distances; followers, of each the node, the
 * number of its frame's nodes, these; of each coupling mass its string among the M and the two nodes; of each moved node the bits of the axes along which it is moved; welds, which are the
 * distances' and followers' reason, of each its number of bars, these; doubles: followers' places in their frames,
 * parts of the strings' masses. */
#include "model/groups.h"
#include "invariants.h"
#include "linear/pattern.h"

#include <math.h>
#include <stdlib.h>

enum { BARS, NODES, DISTANCES, DROPPED, FOLLOWERS, MOVED, WELDS, LINKS, HEAD };

static int part(const ts_model *m, int which) { return m->packed.joint_ints ? m->packed.joint[which] : 0; }
static const int32_t *bars_of(const ts_model *m) { return m->packed.joint + HEAD; }
static const int32_t *nodes_of(const ts_model *m) { return bars_of(m) + part(m, BARS); }
static const int32_t *distances_of(const ts_model *m) { return nodes_of(m) + 2 * part(m, NODES); }
static const int32_t *dropped_of(const ts_model *m) { return distances_of(m) + 2 * part(m, DISTANCES); }
static const int32_t *followers_of(const ts_model *m) { return dropped_of(m) + part(m, DROPPED); }

static const int32_t *links_of(const ts_model *m)
{
    return m->packed.joint + m->packed.joint_ints - part(m, WELDS) - part(m, MOVED) - 3 * part(m, LINKS);
}

/* Place of a number in a rising list with this stride, -1: none. */
static int find(const int32_t *list, int count, int stride, int number)
{
    int low = 0, high = count;
    while (low < high) {
        int middle = low + (high - low) / 2;
        if (list[middle * stride] < number) low = middle + 1;
        else high = middle;
    }
    return low < count && list[low * stride] == number ? low : -1;
}

int ts_is_joined(const ts_model *m, int bar) { return part(m, BARS) && find(bars_of(m), part(m, BARS), 1, bar) >= 0; }
int ts_is_joined_node(const ts_model *m, int node) { return part(m, NODES) && find(nodes_of(m), part(m, NODES), 2, node) >= 0; }

/* The axes along which a moved node is moved, a bit for each. */
int ts_moved_axes(const ts_model *m, int e)
{
    const int all = (1 << m->count[TS_D]) - 1;
    if (!part(m, MOVED)) return all;
    return m->packed.joint[m->packed.joint_ints - part(m, WELDS) - part(m, MOVED) + e] & all;
}

/* The axes along which a node is held. */
static int held_axes(const ts_model *m, int node)
{
    const int at = part(m, NODES) ? find(nodes_of(m), part(m, NODES), 2, node) : -1;
    return m->packed.fixed[node] ? (1 << m->count[TS_D]) - 1 : at < 0 ? 0 : nodes_of(m)[2 * at + 1];
}

/* Is a moved node held along all axes along which it is moved, and along some? */
int ts_may_move(const ts_model *m, int e)
{
    const int moved = ts_moved_axes(m, e);
    return moved && !(moved & ~held_axes(m, m->packed.moved[e]));
}

/* Nodes that are fixed along some axes only. */
int ts_partly_fixed(const ts_model *m)
{
    int count = 0;
    for (int i = 0; i < part(m, NODES); i++) count += nodes_of(m)[2 * i + 1] != 0;
    return count;
}

static int rising(const int32_t *list, int count, int stride, int end)
{
    for (int i = 0; i < count; i++)
        if (list[i * stride] < 0 || list[i * stride] >= end || (i && list[i * stride] <= list[(i - 1) * stride])) return 0;
    return 1;
}

static const char *check_followers(const ts_model *m, const int32_t *at, const int32_t *end)
{
    int values = 0;
    for (int i = 0; i < part(m, FOLLOWERS); i++) {
        if (end - at < 2 || at[1] < 2 || at[1] > m->count[TS_D] || end - at < 2 + at[1]) return "a follower is damaged";
        for (int k = 0; k < 1 + at[1]; k++) {
            const int node = at[k ? k + 1 : 0];
            if (node < 0 || node >= m->count[TS_N]) return "a follower names an unknown node";
            if (!m->packed.fixed[node] && !ts_is_joined_node(m, node)) return "a follower's node is not joined";
        }
        values += at[1];
        at += 2 + at[1];
    }
    return at == end && values + part(m, LINKS) == m->packed.joint_doubles ? NULL : "the followers do not add up";
}

/* Check them, so that a damaged file cannot lead outside the arrays.  A reason, or NULL. */
const char *ts_check_joints(const ts_model *m)
{
    const ts_packed *p = &m->packed;
    const int bits = (1 << m->count[TS_D]) - 1;
    if (!p->joint_ints) return p->joint_doubles ? "the joints do not add up" : NULL;
    if (p->joint_ints < HEAD) return "the joints do not add up";
    double needed = HEAD;
    for (int i = 0; i < HEAD; i++)
        if (p->joint[i] < 0 || p->joint[i] > p->joint_ints) return "a count of joints is out of range";
    needed += p->joint[BARS] + p->joint[MOVED] + p->joint[WELDS] + 3.0 * p->joint[LINKS] + 2.0 * p->joint[NODES] +
              2.0 * p->joint[DISTANCES] + p->joint[DROPPED];
    if (needed > p->joint_ints || (p->joint[MOVED] && p->joint[MOVED] != m->count[TS_E])) return "the joints do not add up";
    if (!p->joint[NODES] && (p->joint[BARS] || p->joint[DISTANCES] || p->joint[FOLLOWERS] || p->joint[LINKS]))
        return "the joints do not add up";
    if (!rising(bars_of(m), p->joint[BARS], 1, m->count[TS_B])) return "the joined bars are not in order";
    if (!rising(nodes_of(m), p->joint[NODES], 2, m->count[TS_N])) return "the joined nodes are not in order";
    if (!rising(dropped_of(m), p->joint[DROPPED], 1, p->joint[BARS] + p->joint[DISTANCES])) return "the joints do not add up";
    for (int i = 0; i < p->joint[NODES]; i++) {
        const int32_t *node = nodes_of(m) + 2 * i;
        if (p->fixed[node[0]]) return "a joined node is fixed";
        if (node[1] < 0 || node[1] >= bits) return "a joined node is fixed along all axes";
    }
    for (int i = 0; i < p->joint[BARS] + p->joint[DISTANCES]; i++) {
        const int32_t *ends = i < p->joint[BARS] ? p->bars + 2 * bars_of(m)[i] : distances_of(m) + 2 * (i - p->joint[BARS]);
        for (int k = 0; k < 2; k++) {
            if (ends[k] < 0 || ends[k] >= m->count[TS_N]) return "a distance names an unknown node";
            if (!p->fixed[ends[k]] && !ts_is_joined_node(m, ends[k])) return "a joined bar's node is not joined";
        }
        if (ends[0] == ends[1]) return "a bar runs from a node to itself";
    }
    for (int i = 0; i < m->count[TS_B]; i++)
        for (int k = 0; k < 2; k++)
            if (!ts_is_joined(m, i) && ts_is_joined_node(m, p->bars[2 * i + k])) return "a joined node is on a bar that is not";
    for (int i = 0; i < p->joint[LINKS]; i++) {
        const int32_t *link = links_of(m) + 3 * i;
        if (link[0] < 0 || link[0] >= m->count[TS_M] || link[1] == link[2]) return "a coupling mass is damaged";
        for (int k = 1; k < 3; k++)
            if (link[k] < 0 || link[k] >= m->count[TS_N] || (!p->fixed[link[k]] && !ts_is_joined_node(m, link[k])))
                return "a coupling mass is at a node that is not joined";
    }
    return check_followers(m, followers_of(m), links_of(m));
}

void ts_count_joints(ts_model *m)
{
    ts_joints *j = &m->joint;
    j->nodes = part(m, NODES);
    j->bars = part(m, BARS);
    j->dropped = part(m, DROPPED);
    j->count = j->bars + part(m, DISTANCES) + part(m, FOLLOWERS);
    j->rows = j->count - j->dropped;
    j->links = part(m, LINKS);
}

static void lay_out_tie(const ts_model *m, ts_tie *tie, int32_t *row, int32_t dropped)
{
    for (int k = 0; k < tie->count; k++) tie->spot[k] = m->joint.spot[tie->node[k]];
    tie->row = dropped ? -1 : (*row)++;
}

static double distance(const ts_model *m, int first, int second)
{
    const int D = m->count[TS_D];
    double square = 0.0;
    for (int d = 0; d < D; d++) {
        const double along = m->packed.node[second * D + d] - m->packed.node[first * D + d];
        square += along * along;
    }
    return sqrt(square);
}

static const char *lay_out_distances(ts_model *m, int32_t *row)
{
    ts_joints *j = &m->joint;
    const int32_t *next = dropped_of(m), *last = next + j->dropped;
    for (int i = 0; i < j->bars + part(m, DISTANCES); i++) {
        ts_tie *tie = j->tie + i;
        tie->bar = i < j->bars ? bars_of(m)[i] : -1;
        tie->heavy = -1;
        const int32_t *ends = i < j->bars ? m->packed.bars + 2 * tie->bar : distances_of(m) + 2 * (i - j->bars);
        tie->count = 2;
        tie->directions = 1;
        for (int k = 0; k < 2; k++) tie->node[k] = ends[k], tie->coef[k] = k ? 1.0 : -1.0;
        tie->length = distance(m, ends[0], ends[1]);
        if (!(tie->length > 0.0 && tie->length < INFINITY)) return "a bar or a weld has no length";
        const int drop = next < last && *next == i;
        next += drop;
        lay_out_tie(m, tie, row, drop);
        if (!drop && tie->spot[0] < 0 && tie->spot[1] < 0) return "a bar has both ends fixed";
        for (int k = 0; k < 2 && i < j->bars; k++) j->bears[ends[k]] = 1;
    }
    return NULL;
}

static const char *lay_out_followers(ts_model *m, int32_t *row)
{
    ts_joints *j = &m->joint;
    const int32_t *at = followers_of(m);
    const double *places = m->packed.joint_values;
    for (int i = j->count - part(m, FOLLOWERS); i < j->count; i++, places += at[1], at += 2 + at[1]) {
        ts_tie *tie = j->tie + i;
        int free = 0;
        tie->bar = tie->heavy = -1;
        tie->follows = 1;
        tie->count = 1 + at[1];
        tie->directions = m->count[TS_D] - (at[1] - 1);
        if (tie->directions < 1 || tie->directions > 2) return "a follower's body is not flat";
        tie->node[0] = at[0];
        tie->coef[0] = 1.0;
        for (int k = 1; k < tie->count; k++) tie->node[k] = at[k + 1], tie->coef[k] = -places[k - 1];
        tie->length = distance(m, at[2], at[3]);
        lay_out_tie(m, tie, row, 0);
        for (int k = 0; k < tie->count; k++) free += tie->spot[k] >= 0;
        if (!free || !(tie->length > 0.0)) return "a follower cannot move";
    }
    return NULL;
}

/* A string's mass m that moves like a thin bar's couples its nodes by m/6 [2 1; 1 2], of which the nodes have m/2 each. */
static void lay_out_links(ts_model *m)
{
    ts_joints *j = &m->joint;
    int32_t none = 0;
    for (int i = 0; i < j->links; i++) {
        ts_tie *tie = j->tie + j->count + i;
        const int32_t *link = links_of(m) + 3 * i;
        tie->count = 2;
        tie->bar = -1;
        tie->heavy = link[0];
        tie->part = m->packed.joint_values[m->packed.joint_doubles - j->links + i];
        for (int k = 0; k < 2; k++) tie->node[k] = link[1 + k], j->bears[link[1 + k]] = 1;
        lay_out_tie(m, tie, &none, 1);
    }
}

/* Places of nodes and constraints; a reason why they cannot be, or NULL. */
const char *ts_lay_out_joints(ts_model *m)
{
    ts_joints *j = &m->joint;
    int32_t row = 0;
    const char *reason;
    for (int n = 0, g = 0; n < m->count[TS_N]; n++) {
        const int at = j->nodes ? find(nodes_of(m), j->nodes, 2, n) : -1;
        j->spot[n] = at;
        j->ground[n] = m->packed.fixed[n] || (at >= 0 && nodes_of(m)[2 * at + 1]) ? g++ : -1;
        if (at < 0) continue;
        j->node[at] = n;
        j->held[at] = nodes_of(m)[2 * at + 1];
        j->pushed[at] = 0;
        j->mover[at] = -1;
    }
    if (!j->nodes) return NULL;
    for (int e = 0; e < m->count[TS_E]; e++) {
        const int spot = j->spot[m->packed.moved[e]];
        if (spot >= 0) j->mover[spot] = e, j->pushed[spot] = ts_moved_axes(m, e);
    }
    if ((reason = lay_out_distances(m, &row)) || (reason = lay_out_followers(m, &row))) return reason;
    lay_out_links(m);
    TS_ASSERT(row == j->rows);
    return NULL;
}

/* Couples of the saddle point, with the joined nodes' blocks from `first` on and the rows from `row` on.  Returns how many;
 * couples NULL: at most. */
size_t ts_joint_couples(const ts_model *m, int32_t first, int32_t row, int32_t *couples)
{
    size_t count = 0;
    for (int i = 0; i < m->joint.count + m->joint.links; i++) {
        const ts_tie *tie = m->joint.tie + i;
        if (!couples) {
            count += TS_TIE_NODES * (TS_TIE_NODES + 1) / 2;
            continue;
        }
        for (int a = 0; a < tie->count; a++) {
            if (tie->spot[a] < 0) continue;
            if (tie->row >= 0) couples[2 * count] = first + tie->spot[a], couples[2 * count + 1] = row + tie->row, count++;
            for (int b = 0; b < a; b++)
                if (tie->spot[b] >= 0)
                    couples[2 * count] = first + tie->spot[a], couples[2 * count + 1] = first + tie->spot[b], count++;
        }
    }
    return count;
}

/* Where the blocks are, of matrix `which`. */
static void place_ties(ts_model *m, const ts_pattern *p, int which, int32_t first, int32_t row)
{
    ts_joints *j = &m->joint;
    for (int i = 0; i < j->count + j->links; i++) {
        ts_tie *tie = j->tie + i;
        for (int a = 0; a <= tie->count; a++)
            for (int b = 0; b <= tie->count; b++) {
                const int from = a == tie->count ? row + tie->row : first + tie->spot[a];
                const int to = b == tie->count ? row + tie->row : first + tie->spot[b];
                const int none =
                    (a == tie->count ? tie->row : tie->spot[a]) < 0 || (b == tie->count ? tie->row : tie->spot[b]) < 0;
                tie->place[which][a * (TS_TIE_NODES + 1) + b] = none ? -1 : ts_pattern_place(p, from, to);
            }
    }
    for (int i = 0; i < j->nodes + j->rows; i++) {
        const int at = i < j->nodes ? first + i : row + i - j->nodes;
        j->own[which][i] = ts_pattern_place(p, at, at);
    }
}

/* Hands out pieces of one allocation; with base NULL it only counts. */
static size_t hand_out(ts_sim *sim, double *base)
{
    const ts_model *m = &sim->m;
    ts_joint_work *w = &sim->joined;
    const size_t D = (size_t)m->count[TS_D], N = (size_t)m->count[TS_N], ties = (size_t)m->joint.count;
    const size_t rows = (size_t)m->joint.rows, dropped = (size_t)m->joint.dropped, n = ((size_t)m->joint.nodes + rows) * D;
    const size_t local = (size_t)w->pattern.count * D * D, all = (size_t)sim->linear.pattern.count * D * D;
    const struct {
        double **pointer;
        size_t size;
    } pieces[] = {
        {&w->J, local},
        {&w->zero, local},
        {&w->factor, ts_pattern_factor_size(&w->pattern, 1)},
        {&w->whole, all},
        {&w->Jq, all},
        {&w->Jv, all},
        {&w->b, n},
        {&w->force, n},
        {&w->scale, rows},
        {&w->across, 2 * ties * D},
        {&w->lambda, 2 * ties},
        {&w->x, 2 * N * D},
        {&w->reaction, N * D},
        {&w->half, N},
        {&w->a, N * D},
        {&w->null, 2 * dropped * ties},
        {&w->square, dropped * (dropped + 1)},
        {&w->work, 6 * ((size_t)m->blocks + rows) * D},
    };
    size_t used = 0;
    for (size_t i = 0; i < sizeof pieces / sizeof *pieces; i++) {
        *pieces[i].pointer = base ? base + used : NULL;
        used += pieces[i].size;
    }
    return used;
}

/* Patterns and workspace, behind the Jacobian's pattern. */
const char *ts_lay_out_joint_matrices(ts_sim *sim)
{
    ts_model *m = &sim->m;
    if (!m->joint.nodes) return NULL;
    int32_t *couples = (int32_t *)malloc(2 * sizeof *couples * (ts_joint_couples(m, 0, 0, NULL) + 1));
    if (!couples) return "out of memory";
    const size_t count = ts_joint_couples(m, 0, m->joint.nodes, couples);
    const int32_t n = m->joint.nodes + m->joint.rows;
    const int made = ts_pattern_make_saddle(&sim->joined.pattern, n, m->joint.nodes, m->count[TS_D], couples, count);
    free(couples);
    if (!made) return "out of memory";
    const size_t size = hand_out(sim, NULL);
    if (!(sim->owned.joined = (double *)calloc(size + 1, sizeof(double)))) return "out of memory";
    sim->owned.bytes += size * sizeof(double);
    hand_out(sim, sim->owned.joined);
    place_ties(m, &sim->joined.pattern, 0, 0, m->joint.nodes);
    place_ties(m, &sim->linear.pattern, 1, m->joint.first, m->blocks);
    return NULL;
}

void ts_joints_free(ts_sim *sim)
{
    if (sim->m.joint.nodes) ts_pattern_free(&sim->joined.pattern);
    free(sim->owned.joined);
}
