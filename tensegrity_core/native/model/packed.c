/* Read a packed model, as written by to_bytes() in kernel/packing.py, and lay out the simulation's memory.
 *
 * Little-endian: 8 bytes of magic; int32: counts (TS_COUNTS), damping law, method, local z axis, sizes of the programs (int32,
 * doubles), routed strings, their size (int32), shares, strings that push, size of the joints (int32, doubles); fixed (N), bars (B, 2), strings (S, 2), beams (S), law
 * of the beams (S), places of elements (S, 2) and dampers (S, 2) in the programs, nodes with a point mass (P), with drag (R), moved
 * nodes (E), strings with an actuator (A), bars with a section (C), strings with a strength (T), with mass (M), programs, routed
 * strings (of each itself, the number of its nodes, the nodes), shares in strings' masses (of each the number of its string among
 * the M, the node), strings that push, nodes that may touch the ground (K), where K is not 0 whether it may pull, joints
 * (model/groups.c), one 0 where the number of int32 is odd; doubles: nodes
 * (N, D), velocities (N, D), programs, start values of all inputs and parameters, the shares, where K is not 0 the ground's point
 * (D) and unit normal (D), joints; uint64: FNV-1a hash of everything before it.  Programs: force laws as trees in prefix order, see
 * kernel/packing.py. */
#include "model/packed.h"
#include "invariants.h"
#include "linear/pairs.h"
#include "linear/pattern.h"
#include "model/data.h"
#include "model/groups.h"
#include "model/routes.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAGIC "TSMODEL3"
#define HEADER_INTS (TS_COUNTS + 11)

uint64_t ts_fnv(const void *bytes, size_t size)
{
    const unsigned char *p = (const unsigned char *)bytes;
    uint64_t hash = 14695981039346656037u;
    for (size_t i = 0; i < size; i++) hash = (hash ^ p[i]) * 1099511628211u;
    return hash;
}

static const struct {
    int first, second;
} field_table[] = {
#define ROW(name, role, first, second, low, high) {first, second},
    TS_FIELDS(ROW) TS_INT_FIELDS(ROW)
#undef ROW
};

static int field_size(const int32_t *count, int field)
{
    int n = 1;
    if (field_table[field].first >= 0) n *= count[field_table[field].first];
    if (field_table[field].second >= 0) n *= count[field_table[field].second];
    return n;
}

static void lay_out(ts_model *m)
{
    m->n_real = m->n_int = 0;
    for (int f = 0; f < TS_FIELD_COUNT; f++) {
        m->at[f] = m->n_real;
        m->n_real += field_size(m->count, f);
    }
    for (int f = 0; f < TS_INT_FIELD_COUNT; f++) {
        m->int_at[f] = m->n_int;
        m->n_int += field_size(m->count, TS_FIELD_COUNT + f);
    }
}

/* Hands out aligned pieces of one allocation; with base NULL it only counts. */
typedef struct {
    char *base;
    size_t used;
} arena;

static void take(arena *a, size_t count, size_t size, void *pointer)
{
    size_t at = a->used;
    void *piece = a->base ? a->base + at : NULL;
    a->used = (at + count * size + 15) & ~(size_t)15;
    memcpy(pointer, &piece, sizeof piece); /* a pointer of whatever type */
}

#define TAKE(pointer, n) take(a, (size_t)(n), sizeof *(pointer), &(pointer))

static void take_model(ts_model *m, arena *a)
{
    const int N = m->count[TS_N], B = m->count[TS_B], S = m->count[TS_S], D = m->count[TS_D], blocks = m->blocks;
    const int L = m->string.count;
    TAKE(m->bar.block, B), TAKE(m->bar.centre, B), TAKE(m->bar.base, B), TAKE(m->bar.length, B);
    TAKE(m->bar.pinned, m->bar.pinned_count), TAKE(m->bar.floating, m->bar.floating_count);
    TAKE(m->block.bar, blocks), TAKE(m->block.turns, blocks + m->joint.rows), TAKE(m->block.length, blocks),
        TAKE(m->block.own_place, blocks);
    TAKE(m->node.free_index, N), TAKE(m->node.block, N), TAKE(m->node.centre, N), TAKE(m->node.coef, N);
    TAKE(m->node.anchor, N * D), TAKE(m->node.lone, m->node.lone_count);
    TAKE(m->node.massed, m->count[TS_P] + m->packed.shares);
    TAKE(m->string.node, 2 * L), TAKE(m->string.ends, 2 * m->lanes), TAKE(m->string.s0, L * D);
    TAKE(m->string.term_count, L), TAKE(m->string.term, 4 * L), TAKE(m->string.term_place, 16 * L);
    TAKE(m->string.term_block, L > S ? 4 * L : 0), TAKE(m->string.routed, S), TAKE(m->string.route, m->packed.routes);
    TAKE(m->string.route_blocks, ts_route_blocks(m)), TAKE(m->string.route_places, ts_route_places(m));
    TAKE(m->string.two_way, S), TAKE(m->string.beam_first, S), TAKE(m->string.curved, S);
    TAKE(m->string.with_curve, S), TAKE(m->string.with_damper, S);
    TAKE(m->drive.mover, N), TAKE(m->drive.mover_bar, m->count[TS_E]), TAKE(m->drive.axes, m->count[TS_E]),
        TAKE(m->drive.winder, S), TAKE(m->y_start, m->stride);
    TAKE(m->contact.block, m->count[TS_K]);
    ts_joints *j = &m->joint;
    TAKE(j->node, j->nodes), TAKE(j->held, j->nodes), TAKE(j->pushed, j->nodes), TAKE(j->mover, j->nodes);
    TAKE(j->spot, N), TAKE(j->ground, N), TAKE(j->bears, N), TAKE(j->tie, j->count + j->links);
    TAKE(j->own[0], j->nodes + j->rows), TAKE(j->own[1], j->nodes + j->rows);
}

/* What the caller sees, and the state. */
static void take_state(ts_sim *sim, arena *a)
{
    const ts_model *m = &sim->m;
    const int S = m->count[TS_S];
    ts_io *io = &sim->io;
    TAKE(sim->laws.curve, S), TAKE(sim->laws.owner, S), TAKE(sim->laws.damping, S);
    TAKE(sim->laws.key, 2 * (3 * m->count[TS_Z] + S));
    TAKE(io->values, m->n_real), TAKE(io->applied, m->n_applied), TAKE(io->integers, m->n_int);
    TAKE(io->slopes, 2 * m->n_inputs), TAKE(io->applied_slopes, 2 * m->n_inputs);
    TAKE(sim->state.y, m->stride), TAKE(sim->state.piece, S), TAKE(sim->state.clipped, S);
    TAKE(sim->state.mode, m->count[TS_K]), TAKE(sim->state.bristle, m->count[TS_K] * m->count[TS_D]);
    TAKE(sim->told.transitions, TS_MAX_TRANSITIONS);
    TAKE(sim->undo.reals, m->n_real + m->n_applied + 2 * m->n_inputs + m->ny + m->count[TS_K] * m->count[TS_D]);
    TAKE(sim->undo.integers, m->n_int + 2 * S + m->count[TS_K]);
    TAKE(sim->undo.watched, m->n_real + 2 * m->n_inputs), TAKE(sim->demand.group, m->n_real + m->n_int);
}

/* What a step prepares, and what a right-hand side finds. */
static void take_forces(ts_sim *sim, arena *a)
{
    const ts_model *m = &sim->m;
    const int N = m->count[TS_N], S = m->count[TS_S], D = m->count[TS_D], E = m->count[TS_E], nq = m->nq, lanes = m->lanes;
    ts_strings *found = &sim->strings;
    ts_bearing *on = &sim->on;
    ts_rest *rest = &sim->rest;
    TAKE(sim->inertia.inverse, m->blocks), TAKE(sim->inertia.laden, m->blocks), TAKE(sim->inertia.extra, N);
    TAKE(sim->loads.Q, nq), TAKE(sim->loads.with_gravity, nq), TAKE(sim->loads.rate, nq), TAKE(sim->loads.bend, nq);
    TAKE(rest->length, lanes), TAKE(rest->rate, lanes), TAKE(rest->bend, lanes), TAKE(rest->jerk, lanes);
    TAKE(rest->now, lanes), TAKE(rest->rate_now, lanes);
    TAKE(sim->bases.start, 5 * E * D), TAKE(sim->bases.now, 3 * E * D);
    TAKE(on->lo, S), TAKE(on->hi, S), TAKE(on->guard, S), TAKE(on->k, lanes), TAKE(on->d, lanes), TAKE(on->taut, S);
    TAKE(found->x, 2 * N * D), TAKE(found->s, 2 * D * lanes), TAKE(found->per_length, lanes);
    TAKE(found->elongation, lanes), TAKE(found->rate, lanes), TAKE(found->fs, lanes), TAKE(found->fd, lanes);
    TAKE(found->node_force, N * D), TAKE(found->lowest, lanes), TAKE(found->highest, lanes);
    TAKE(found->sign_changed, S), TAKE(found->margin_low, S), TAKE(found->margin_high, S);
    TAKE(found->route_extremes, 2 * m->packed.routes);
    const int K = m->count[TS_K], watches = TS_WATCHES * K;
    TAKE(sim->ground.touch, K), TAKE(sim->ground.margin, watches), TAKE(sim->ground.low, watches);
    TAKE(sim->ground.high, watches), TAKE(sim->ground.end, watches);
}

/* What a step works with. */
static void take_step(ts_sim *sim, arena *a)
{
    const ts_model *m = &sim->m;
    const int stride = m->stride, lanes = m->lanes;
    ts_step_ahead *ahead = &sim->ahead;
    TAKE(sim->start.elongation, lanes), TAKE(sim->start.rate, lanes), TAKE(sim->start.f, stride);
    TAKE(sim->attempt.k, 16 * stride), TAKE(sim->attempt.y, stride), TAKE(sim->attempt.error, stride);
    TAKE(sim->linear.ft, m->nq), TAKE(sim->linear.work, 6 * m->nq);
    TAKE(sim->linear.slopes, 2 * ts_route_blocks(m) * (size_t)m->count[TS_D]);
    TAKE(ahead->all, ahead->size), TAKE(ahead->backup, ahead->size);
}

/* Parts of what was taken in one piece. */
static void share(ts_sim *sim)
{
    const int stride = sim->m.stride, lanes = sim->m.lanes;
    ts_step_ahead *ahead = &sim->ahead;
    sim->strings.sd = sim->strings.s + sim->m.count[TS_D] * lanes;
    ahead->stride = stride;
    ahead->dense = ahead->all;
    ahead->y = ahead->dense + 8 * stride;
    ahead->f = ahead->y + stride;
    ahead->elongation = ahead->f + stride;
    ahead->rate = ahead->elongation + lanes;
}

static void take_all(ts_sim *sim, arena *a)
{
    take_model(&sim->m, a);
    take_state(sim, a);
    take_forces(sim, a);
    take_step(sim, a);
}

/* Check counts and indices, so that a damaged file cannot lead outside the arrays.  A reason, or NULL. */
static const char *check(const ts_model *m)
{
    const char *reason;
    int N = m->count[TS_N], B = m->count[TS_B], S = m->count[TS_S], fixed = 0, beams = 0, with = 0;
    for (int n = 0; n < N; n++) fixed += m->packed.fixed[n] != 0;
    for (int i = 0; i < 2 * B; i++)
        if (m->packed.bars[i] < 0 || m->packed.bars[i] >= N) return "a bar names an unknown node";
    for (int i = 0; i < 2 * S; i++)
        if (m->packed.strings[i] < 0 || m->packed.strings[i] >= N) return "a string names an unknown node";
    if ((reason = ts_check_joints(m))) return reason;
    for (int i = 0; i < S; i++) {
        if (m->packed.beams[i] < 0 || m->packed.beams[i] > m->count[TS_Z]) return "a string has a wrong number of beams";
        if (m->packed.beam_law[i] < 0 || m->packed.beam_law[i] > 1) return "a string's beams have an unknown law";
        for (int k = 0; k < 2; k++) {
            const int32_t *place = (k ? m->packed.damper : m->packed.element) + 2 * i;
            int none = place[0] == -1 && place[1] == -1;
            if (!none &&
                (place[0] < 0 || place[0] >= m->packed.program_ints || place[1] < 0 || place[1] > m->packed.program_doubles))
                return "a force law is not among the programs";
        }
        if (m->packed.beams[i] && m->packed.element[2 * i] >= 0) return "a string has both beams and another force law";
        beams += m->packed.beams[i];
        with += m->packed.beams[i] > 0;
    }
    for (int i = 0; i < m->count[TS_P] + m->count[TS_R] + m->count[TS_E]; i++) /* one behind the other */
        if (m->packed.massed[i] < 0 || m->packed.massed[i] >= N) return "a mass, drag or motion names an unknown node";
    for (int i = 0; i < m->count[TS_C]; i++)
        if (m->packed.braced[i] < 0 || m->packed.braced[i] >= B) return "a section is of an unknown bar";
    for (int i = 0; i < m->count[TS_T]; i++)
        if (m->packed.rated[i] < 0 || m->packed.rated[i] >= S) return "a strength is of an unknown string";
    for (int i = 0; i < m->count[TS_E]; i++)
        if (!ts_may_move(m, i)) return "a moved node is not fixed";
    for (int i = 0; i < m->count[TS_A]; i++)
        if (m->packed.wound[i] < 0 || m->packed.wound[i] >= S) return "an actuator names an unknown string";
    for (int i = 0; i < m->count[TS_M]; i++)
        if (m->packed.heavy[i] < 0 || m->packed.heavy[i] >= S) return "a mass names an unknown string";
    for (int k = 0; k < m->count[TS_K]; k++) {
        if (m->packed.touching[k] < 0 || m->packed.touching[k] >= N) return "a contact names an unknown node";
        if (m->packed.fixed[m->packed.touching[k]]) return "a node that touches the ground is fixed";
    }
    if (m->count[TS_W] > 1 || (m->count[TS_W] && !m->count[TS_K])) return "a moving ground has no contacts, or several heights";
    if (fixed + ts_partly_fixed(m) != m->count[TS_G] || N - fixed != m->count[TS_F]) return "the fixed nodes do not add up";
    if (beams != m->count[TS_Z] || with != m->count[TS_H]) return "the beams do not add up";
    return ts_check_routes(m);
}

/* Bars by kind, for loops without a question in them. */
static void list_bars(ts_model *m)
{
    int pinned = 0, floating = 0;
    for (int i = 0; i < m->count[TS_B]; i++) {
        int first = m->packed.bars[2 * i], second = m->packed.bars[2 * i + 1], base = m->bar.base[i];
        if (m->bar.block[i] < 0) continue;
        if (base < 0) m->bar.floating[floating++] = MAKE(ts_place_of_bar){m->bar.centre[i], first, second, 0.5, 0.5};
        else m->bar.pinned[pinned++] = MAKE(ts_place_of_bar){m->bar.block[i], base, base == first ? second : first, 0.0, 1.0};
        m->block.length[m->bar.block[i]] = m->bar.length[i];
    }
}

/* Free nodes on no bar that moves by itself, each with a block of its own behind those of the bars, joined ones last; a reason why
 * one cannot move, or NULL. */
static const char *lay_out_lone(ts_model *m, const double *nodes)
{
    int D = m->count[TS_D], block = m->bar.pinned_count + 2 * m->bar.floating_count, found = 0;
    for (int i = 0; i < m->node.massed_count; i++)
        if (m->node.block[m->node.massed[i]] < 0 && !m->packed.fixed[m->node.massed[i]]) m->node.coef[m->node.massed[i]] = 1.0;
    m->joint.first = block + m->node.lone_count - m->joint.nodes;
    for (int i = 0; i < m->joint.nodes; i++) m->node.coef[m->joint.node[i]] = 1.0;
    for (int i = 0; i < m->count[TS_N] + m->joint.nodes; i++) {
        const int n = i < m->count[TS_N] ? i : m->joint.node[i - m->count[TS_N]];
        if (m->packed.fixed[n] || m->node.block[n] >= 0 || (i == n && m->joint.spot[n] >= 0)) continue;
        if (m->node.coef[n] != 1.0) return "a free node has neither a bar nor a point mass";
        m->node.lone[found] = n;
        m->block.bar[block] = -1;
        m->block.turns[block] = 0;
        m->node.block[n] = block;
        for (int d = 0; d < D; d++) m->y_start[block * D + d] = nodes[n * D + d];
        found++, block++;
    }
    return NULL;
}

/* Blocks of the generalised coordinates, and each node's place in them. */
static const char *lay_out_bars(ts_model *m, const double *nodes)
{
    int D = m->count[TS_D], N = m->count[TS_N], block = 0;
    for (int n = 0, f = 0, g = 0; n < N; n++) {
        m->node.free_index[n] = m->packed.fixed[n] ? -1 - g++ : f++;
        if (!m->packed.fixed[n] && m->joint.ground[n] >= 0) g++;
        m->node.block[n] = m->node.centre[n] = -1;
        m->node.coef[n] = 0.0;
        for (int d = 0; d < D; d++) m->node.anchor[n * D + d] = m->packed.fixed[n] ? nodes[n * D + d] : 0.0;
    }
    for (int i = 0; i < m->count[TS_B]; i++) {
        int first = m->packed.bars[2 * i], second = m->packed.bars[2 * i + 1], base = -1, tip = second;
        double length = 0.0;
        for (int d = 0; d < D; d++) {
            double along = nodes[second * D + d] - nodes[first * D + d];
            length += along * along;
        }
        m->bar.length[i] = sqrt(length);
        if (!(length > 0.0 && length < INFINITY)) return "a bar has no length";
        m->bar.base[i] = m->bar.centre[i] = m->bar.block[i] = -1;
        if (ts_is_joined(m, i)) continue;
        if (m->packed.fixed[first] && m->packed.fixed[second]) return "a bar has both ends fixed";
        if (m->node.block[first] >= 0 || m->node.block[second] >= 0) return "a node belongs to two bars";
        if (m->packed.fixed[first]) base = first;
        if (m->packed.fixed[second]) base = second, tip = first;
        m->bar.base[i] = base;
        m->bar.centre[i] = base < 0 ? block++ : -1;
        m->bar.block[i] = block++;
        if (base < 0) m->block.bar[block - 2] = i, m->block.turns[block - 2] = 0;
        m->block.bar[block - 1] = i, m->block.turns[block - 1] = 1;
        m->node.block[tip] = m->bar.block[i];
        m->node.coef[tip] = base < 0 ? 0.5 : 1.0;
        if (base >= 0) {
            for (int d = 0; d < D; d++) m->node.anchor[tip * D + d] = nodes[base * D + d];
        } else {
            m->node.block[first] = m->bar.block[i];
            m->node.coef[first] = -0.5;
            m->node.centre[first] = m->node.centre[second] = m->bar.centre[i];
        }
        for (int d = 0; d < D; d++) { /* start */
            double a = nodes[first * D + d], b = nodes[second * D + d];
            if (base < 0) m->y_start[m->bar.centre[i] * D + d] = 0.5 * (a + b);
            m->y_start[m->bar.block[i] * D + d] = base < 0 ? b - a : nodes[tip * D + d] - nodes[base * D + d];
        }
    }
    list_bars(m);
    return lay_out_lone(m, nodes);
}

/* Who moves with a moved node, who winds which string. */
static const char *lay_out_drives(ts_model *m)
{
    for (int n = 0; n < m->count[TS_N]; n++) m->drive.mover[n] = -1;
    for (int i = 0; i < m->count[TS_S]; i++) m->drive.winder[i] = -1;
    for (int e = 0; e < m->count[TS_E]; e++) {
        m->drive.mover_bar[e] = -1;
        m->drive.axes[e] = ts_moved_axes(m, e);
        if (!m->packed.fixed[m->packed.moved[e]]) continue;
        m->drive.mover[m->packed.moved[e]] = e;
        for (int i = 0; i < m->count[TS_B]; i++) {
            if (m->bar.base[i] != m->packed.moved[e]) continue;
            m->drive.mover_bar[e] = i;
            m->drive.mover[m->packed.bars[2 * i] == m->packed.moved[e] ? m->packed.bars[2 * i + 1] : m->packed.bars[2 * i]] = e;
        }
    }
    for (int a = 0; a < m->count[TS_A]; a++) {
        if (m->drive.winder[m->packed.wound[a]] >= 0) return "two actuators wind one string";
        m->drive.winder[m->packed.wound[a]] = a;
    }
    for (int r = 0; r < m->count[TS_R]; r++)
        if (m->packed.fixed[m->packed.dragged[r]]) return "a node with drag is fixed";
    m->drive.any = m->node.massed_count + m->count[TS_R] + m->count[TS_E] + m->count[TS_A] > 0;
    m->drive.any |= m->string.route_count + m->count[TS_K] + m->joint.nodes > 0;
    return NULL;
}

/* Blocks of contacts, behind those of bars and masses. */
static void lay_out_contacts(ts_model *m)
{
    int block = m->blocks - m->count[TS_A] - m->contact.directed;
    for (int k = 0; k < m->count[TS_K]; k++) {
        m->contact.block[k] = m->contact.directed ? block : -1;
        if (!m->contact.directed) continue;
        m->block.bar[block] = -1;
        m->block.turns[block++] = 0;
    }
}

static void add_node(ts_model *m, int line, int node, double sign)
{
    int D = m->count[TS_D];
    ts_term *t = m->string.term + 4 * line + m->string.term_count[line];
    for (int d = 0; d < D && m->drive.mover[node] < 0; d++) m->string.s0[line * D + d] += sign * m->node.anchor[node * D + d];
    if (m->node.block[node] < 0) return;
    if (m->node.centre[node] >= 0) {
        *t++ = MAKE(ts_term){m->node.centre[node] * D, m->node.centre[node], sign};
        m->string.term_count[line]++;
    }
    *t = MAKE(ts_term){m->node.block[node] * D, m->node.block[node], sign * m->node.coef[node]};
    m->string.term_count[line]++;
}

static void lay_out_strings(ts_model *m)
{
    m->string.curved_count = m->string.damped_count = 0;
    for (int i = 0, beam = 0; i < m->count[TS_S]; i++) {
        m->string.curved[i] = m->packed.beams[i] > 0 || m->packed.element[2 * i] >= 0;
        if (m->string.curved[i]) m->string.with_curve[m->string.curved_count++] = i;
        if (m->packed.damper[2 * i] >= 0) m->string.with_damper[m->string.damped_count++] = i;
        for (int end = 0; end < 2; end++) m->string.node[2 * i + end] = m->packed.strings[2 * i + end];
        m->string.beam_first[i] = beam;
        beam += m->packed.beams[i];
    }
    ts_lay_out_routes(m);
    for (int i = 0; i < m->string.count; i++) {
        const int32_t *node = m->string.node + 2 * i;
        for (int end = 0; end < 2; end++) m->string.ends[2 * i + end] = 2 * m->count[TS_D] * node[end];
        if (i < m->count[TS_S] && m->string.routed[i] >= 0) continue;
        add_node(m, i, node[0], -1.0);
        add_node(m, i, node[1], 1.0);
    }
    ts_list_route_blocks(m);
}

/* Start velocities of the blocks, from the nodes'. */
static void lay_out_velocity(ts_model *m, const double *velocity)
{
    int D = m->count[TS_D];
    for (int i = 0; i < m->count[TS_B]; i++)
        for (int d = 0; d < D; d++) {
            if (m->bar.block[i] < 0) continue;
            double a = velocity[m->packed.bars[2 * i] * D + d], b = velocity[m->packed.bars[2 * i + 1] * D + d];
            int flipped = m->bar.base[i] == m->packed.bars[2 * i + 1];
            if (m->bar.centre[i] >= 0) m->y_start[m->nq + m->bar.centre[i] * D + d] = 0.5 * (a + b);
            m->y_start[m->nq + m->bar.block[i] * D + d] = flipped ? a - b : b - a;
        }
    for (int i = 0; i < m->node.lone_count; i++)
        for (int d = 0; d < D; d++)
            m->y_start[m->nq + m->node.block[m->node.lone[i]] * D + d] = velocity[m->node.lone[i] * D + d];
}

static size_t int_count(const ts_model *m)
{
    const int32_t *count = m->count;
    size_t n = HEADER_INTS + (size_t)count[TS_N] + 2 * (size_t)count[TS_B] + 8 * (size_t)count[TS_S];
    n += (size_t)count[TS_P] + (size_t)count[TS_R] + (size_t)count[TS_E] + (size_t)count[TS_A];
    n += (size_t)count[TS_C] + (size_t)count[TS_T] + (size_t)count[TS_M] + (size_t)m->packed.program_ints;
    n += (size_t)m->packed.route_ints + 2 * (size_t)m->packed.shares + (size_t)m->packed.two_way_count + (size_t)count[TS_K] +
         (count[TS_K] > 0) + (size_t)m->packed.joint_ints;
    return n + n % 2;
}

static const char *read_header(ts_model *m, const char *bytes, size_t size)
{
    int32_t head[HEADER_INTS];
    uint64_t stored;
    if (size < 8 + sizeof head + 8 || memcmp(bytes, MAGIC, 8)) return "not a model of this version";
    memcpy(head, bytes + 8, sizeof head);
    memcpy(&stored, bytes + size - 8, 8);
    m->packed.hash = ts_fnv(bytes, size - 8);
    if (stored != m->packed.hash) return "the checksum is wrong";
    for (int i = 0; i < TS_COUNTS; i++)
        if (head[i] < 0 || head[i] > 1000000) return "a count is out of range";
    memcpy(m->count, head, sizeof m->count);
    m->damping_law = head[TS_COUNTS];
    m->packed.method = head[TS_COUNTS + 1];
    m->z_axis = head[TS_COUNTS + 2];
    m->packed.program_ints = head[TS_COUNTS + 3];
    m->packed.program_doubles = head[TS_COUNTS + 4];
    m->packed.routes = head[TS_COUNTS + 5];
    m->packed.route_ints = head[TS_COUNTS + 6];
    m->packed.shares = head[TS_COUNTS + 7];
    m->packed.two_way_count = head[TS_COUNTS + 8];
    m->packed.joint_ints = head[TS_COUNTS + 9];
    m->packed.joint_doubles = head[TS_COUNTS + 10];
    for (int i = TS_COUNTS + 5; i < HEADER_INTS; i++)
        if (head[i] < 0 || head[i] > 10000000) return "a count of routed strings, shares or joints is out of range";
    if (m->packed.program_ints < 0 || m->packed.program_ints > 10000000 || m->packed.program_doubles < 0 ||
        m->packed.program_doubles > 10000000)
        return "a program's size is out of range";
    if (m->count[TS_V] != 1 && m->count[TS_V] != m->count[TS_D])
        return "gravity has neither one component nor one for each axis";
    if (m->count[TS_D] != 2 && m->count[TS_D] != 3) return "neither planar nor 3D";
    if (m->z_axis >= m->count[TS_D]) return "no such axis";
    lay_out(m);
    m->n_applied = m->at[TS_POSITION];
    m->n_inputs = m->at[TS_STIFFNESS];
    size_t doubles = 2 * (size_t)m->count[TS_N] * (size_t)m->count[TS_D] + (size_t)m->at[TS_POSITION];
    doubles += (size_t)m->packed.program_doubles + (size_t)m->packed.shares;
    doubles += (m->count[TS_K] ? 2 * (size_t)m->count[TS_D] : 0) + (size_t)m->packed.joint_doubles;
    if (size != 8 + 4 * int_count(m) + 8 * doubles + 8) return "the length is wrong";
    return NULL;
}

static int round_up(int n) { return (n + TS_LANES - 1) / TS_LANES * TS_LANES; }

/* Free nodes on no bar that moves by itself; -1: out of memory. */
static int count_lone(const ts_model *m)
{
    int N = m->count[TS_N], count = 0;
    char *on_bar = (char *)calloc((size_t)N + 1, 1);
    if (!on_bar) return -1;
    for (int i = 0; i < 2 * m->count[TS_B]; i++) on_bar[m->packed.bars[i]] |= !ts_is_joined(m, i / 2);
    for (int n = 0; n < N; n++) count += !m->packed.fixed[n] && !on_bar[n];
    free(on_bar);
    return count;
}

static void count_blocks(ts_sim *sim)
{
    ts_model *m = &sim->m;
    ts_count_joints(m);
    m->bar.pinned_count = 0;
    for (int i = 0; i < m->count[TS_B]; i++)
        m->bar.pinned_count +=
            (m->packed.fixed[m->packed.bars[2 * i]] || m->packed.fixed[m->packed.bars[2 * i + 1]]) && !ts_is_joined(m, i);
    m->bar.floating_count = m->count[TS_B] - m->joint.bars - m->bar.pinned_count;
    m->contact.directed = m->count[TS_D] == 3 ? m->count[TS_K] : 0;
    m->blocks = m->bar.pinned_count + 2 * m->bar.floating_count + m->node.lone_count + m->contact.directed +
                m->count[TS_A]; /* of an actuator's only the first number is used */
    m->nq = m->blocks * m->count[TS_D];
    m->ny = 2 * m->nq + TS_LEDGER;
    m->stride = round_up(m->ny);
    m->string.route_count = m->packed.routes;
    m->string.count = m->count[TS_S] + ts_segment_count(m);
    m->lanes = round_up(m->string.count);
    sim->ahead.size = 10 * (size_t)m->stride + 2 * (size_t)m->lanes;
}

static void couple(int32_t *couples, size_t *count, int32_t a, int32_t b)
{
    couples[2 * *count] = a;
    couples[2 * *count + 1] = b;
    ++*count;
}

/* The Jacobian's pattern: blocks that hang on one string are coupled, an actuator's with them, and those of a free bar by drag or
 * by contact with the ground, a direction of slip with them. */
static const char *lay_out_matrices(ts_sim *sim)
{
    ts_model *m = &sim->m;
    size_t D = (size_t)m->count[TS_D], count = 0;
    const size_t lines = (size_t)m->string.count, routed = ts_route_places(m) + ts_route_blocks(m);
    const size_t most =
        10 * lines + routed + (size_t)m->count[TS_R] + 3 * (size_t)m->count[TS_K] + ts_joint_couples(m, 0, 0, NULL) + 1;
    int32_t *couples = (int32_t *)malloc(2 * sizeof *couples * most);
    if (!couples) return "out of memory";
    for (int i = 0; i < m->string.count; i++)
        for (int a = 0; a < m->string.term_count[i]; a++) {
            for (int b = 0; b < a; b++)
                couple(couples, &count, m->string.term[4 * i + a].block, m->string.term[4 * i + b].block);
            if (i < m->count[TS_S] && m->drive.winder[i] >= 0)
                couple(couples, &count, m->string.term[4 * i + a].block, m->blocks - m->count[TS_A] + m->drive.winder[i]);
        }
    for (int r = 0; r < m->string.route_count; r++) {
        const ts_route *route = m->string.route + r;
        for (int a = 0; a < route->blocks; a++) {
            for (int b = 0; b < a; b++) couple(couples, &count, route->block[a], route->block[b]);
            if (m->drive.winder[route->string] >= 0)
                couple(couples, &count, route->block[a], m->blocks - m->count[TS_A] + m->drive.winder[route->string]);
        }
    }
    for (int r = 0; r < m->count[TS_R]; r++)
        if (m->node.centre[m->packed.dragged[r]] >= 0)
            couple(couples, &count, m->node.centre[m->packed.dragged[r]], m->node.block[m->packed.dragged[r]]);
    for (int k = 0; k < m->count[TS_K]; k++) {
        int centre = m->node.centre[m->packed.touching[k]], block = m->node.block[m->packed.touching[k]];
        if (centre >= 0) couple(couples, &count, centre, block);
        if (m->contact.block[k] < 0) continue;
        couple(couples, &count, block, m->contact.block[k]);
        if (centre >= 0) couple(couples, &count, centre, m->contact.block[k]);
    }
    count += ts_joint_couples(m, m->joint.first, m->blocks, couples + 2 * count);
    int made = ts_pattern_make_saddle(&sim->linear.pattern, m->blocks + m->joint.rows, m->blocks, (int32_t)D, couples, count);
    free(couples);
    if (!made) return "out of memory";
    size_t size = (size_t)sim->linear.pattern.count * D * D;
    size_t real = ts_pattern_factor_size(&sim->linear.pattern, 1), complex = ts_pattern_factor_size(&sim->linear.pattern, 2);
    sim->owned.matrices = (double *)calloc(2 * size + real + 2 * complex + 1, sizeof(double));
    if (!sim->owned.matrices) return "out of memory";
    sim->owned.bytes += sizeof(double) * (2 * size + real + 2 * complex);
    sim->linear.Jq = sim->owned.matrices;
    sim->linear.Jv = sim->linear.Jq + size;
    sim->linear.factor = sim->linear.Jv + size;
    sim->linear.pair_factor[0] = sim->linear.factor + real;
    sim->linear.pair_factor[1] = sim->linear.pair_factor[0] + complex;
    for (int i = 0; i < m->string.count; i++)
        for (int a = 0; a < m->string.term_count[i]; a++)
            for (int b = 0; b < m->string.term_count[i]; b++)
                m->string.term_place[16 * i + 4 * a + b] =
                    ts_pattern_place(&sim->linear.pattern, m->string.term[4 * i + a].block, m->string.term[4 * i + b].block);
    ts_place_routes(m, &sim->linear.pattern);
    for (int b = 0; b < m->blocks; b++) {
        m->block.own_place[b] = ts_pattern_place(&sim->linear.pattern, b, b);
        TS_ASSERT(m->block.own_place[b] >= 0);
    }
    return ts_lay_out_joint_matrices(sim);
}

void ts_model_free(ts_sim *sim)
{
    ts_joints_free(sim);
    ts_pattern_free(&sim->linear.pattern);
    free(sim->owned.matrices);
    free(sim->owned.arena);
    free(sim->owned.blob);
}

/* Where the parts of a packed model are. */
static void find_parts(ts_model *m, const char *blob)
{
    const int N = m->count[TS_N], S = m->count[TS_S];
    ts_packed *p = &m->packed;
    p->fixed = (const int32_t *)(const void *)(blob + 8) + HEADER_INTS;
    p->bars = p->fixed + N;
    p->strings = p->bars + 2 * m->count[TS_B];
    p->beams = p->strings + 2 * S;
    p->beam_law = p->beams + S;
    p->element = p->beam_law + S;
    p->damper = p->element + 2 * S;
    p->massed = p->damper + 2 * S;
    p->dragged = p->massed + m->count[TS_P];
    p->moved = p->dragged + m->count[TS_R];
    p->wound = p->moved + m->count[TS_E];
    p->braced = p->wound + m->count[TS_A];
    p->rated = p->braced + m->count[TS_C];
    p->heavy = p->rated + m->count[TS_T];
    p->program = p->heavy + m->count[TS_M];
    p->route = p->program + p->program_ints;
    p->sharing = p->route + p->route_ints;
    p->two_way = p->sharing + 2 * p->shares;
    p->touching = p->two_way + p->two_way_count;
    p->joint = p->touching + m->count[TS_K] + (m->count[TS_K] > 0);
    p->node = (const double *)(const void *)(blob + 8 + 4 * int_count(m));
    p->velocity = p->node + N * m->count[TS_D];
    p->program_values = p->velocity + N * m->count[TS_D];
    p->start = p->program_values + p->program_doubles;
    p->share = p->start + m->n_applied;
    p->ground = p->share + p->shares;
    p->joint_values = p->ground + (m->count[TS_K] ? 2 * m->count[TS_D] : 0);
}

/* All arrays but the pattern's and the laws'; 0: out of memory. */
static int allocate(ts_sim *sim, size_t size)
{
    arena a = {NULL, 0};
    take_all(sim, &a);
    sim->owned.bytes = size + a.used;
    sim->owned.arena = a.base = (char *)calloc(a.used + 16, 1);
    const size_t needed = a.used;
    a.used = 0;
    if (!a.base) return 0;
    take_all(sim, &a);
    TS_ASSERT(a.used == needed);
    share(sim);
    TS_ASSERT(sim->ahead.rate + sim->m.lanes <= sim->ahead.all + sim->ahead.size);
    return 1;
}

/* A reason why it cannot be read, or NULL. */
static const char *read_model(ts_sim *sim, const void *bytes, size_t size)
{
    ts_model *m = &sim->m;
    const char *reason = read_header(m, (const char *)bytes, size);
    if (reason) return reason;
    if (!(sim->owned.blob = malloc(size))) return "out of memory";
    memcpy(sim->owned.blob, bytes, size);
    find_parts(m, (const char *)sim->owned.blob);
    if ((reason = check(m))) return reason;
    if ((m->node.lone_count = count_lone(m)) < 0) return "out of memory";
    count_blocks(sim);
    if (!allocate(sim, size)) return "out of memory";
    ts_lay_out_masses(m, m->node.block);
    if ((reason = ts_lay_out_joints(m))) return reason;
    if ((reason = lay_out_bars(m, m->packed.node)) || (reason = lay_out_drives(m))) return reason;
    lay_out_strings(m);
    lay_out_contacts(m);
    for (int i = 0, D = m->count[TS_D]; i < m->count[TS_N] * D; i++)
        sim->strings.x[i / D * 2 * D + i % D] = m->node.anchor[i]; /* fixed nodes stay there */
    lay_out_velocity(m, m->packed.velocity);
    return lay_out_matrices(sim);
}

int ts_model_read(ts_sim *sim, const void *bytes, size_t size, char *message, size_t capacity)
{
    const char *reason = read_model(sim, bytes, size);
    if (!reason) return 1;
    ts_model_free(sim);
    snprintf(message, capacity, "%s", reason);
    return 0;
}
