/* Read a packed model, as written by to_bytes() in kernel/packing.py, and lay out the simulation's memory.
 *
 * Little-endian: 8 bytes of magic; int32: counts (TS_COUNTS), damping law, method, local z axis, sizes of the programs (int32,
 * doubles); fixed (N), bars (B, 2), strings (S, 2), beams (S), law of the beams (S), places of elements (S, 2) and dampers (S, 2)
 * in the programs, nodes with a point mass (P), with drag (R), moved nodes (E), strings with an actuator (A), programs, one 0 where
 * the number of int32 is odd; doubles: nodes (N, D), velocities (N, D), programs, start values of all inputs and parameters;
 * uint64: FNV-1a hash of everything before it.  Programs: force laws as trees in prefix order, see kernel/packing.py. */
#include "model/packed.h"
#include "invariants.h"
#include "linear/complex_blocks.h"
#include "linear/pairs.h"
#include "linear/pattern.h"
#include "model/data.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAGIC "TSMODEL2"
#define HEADER_INTS (TS_COUNTS + 5)

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

static void lay_out_arena(ts_sim *sim, arena *a)
{
    ts_model *m = &sim->m;
    int N = m->count[TS_N], B = m->count[TS_B], S = m->count[TS_S], D = m->count[TS_D], nq = m->nq, ny = m->ny;
    size_t stride = (size_t)m->stride, lanes = (size_t)m->lanes;
    TAKE(m->beam_first, S), TAKE(m->free_index, N);
    TAKE(m->bar_block, B), TAKE(m->bar_centre, B), TAKE(m->bar_base, B);
    TAKE(m->block_bar, m->blocks), TAKE(m->block_turns, m->blocks);
    TAKE(m->node_block, N), TAKE(m->node_centre, N), TAKE(m->node_coef, N), TAKE(m->anchor, N * D);
    TAKE(m->mover, N), TAKE(m->mover_bar, m->count[TS_E]), TAKE(m->winder, S), TAKE(sim->laden, m->blocks),
        TAKE(sim->extra_mass, N);
    TAKE(sim->base, 5 * m->count[TS_E] * D), TAKE(sim->base_now, 3 * m->count[TS_E] * D);
    TAKE(m->bar_length, B), TAKE(m->term_count, S), TAKE(m->term, 4 * S), TAKE(m->term_place, 16 * S), TAKE(m->s0, S * D);
    TAKE(m->curved, S), TAKE(m->damped, S), TAKE(m->law, S);
    TAKE(m->y_start, m->stride), TAKE(m->block_length, m->blocks), TAKE(m->own_place, m->blocks);
    TAKE(m->ends, 2 * lanes), TAKE(m->pinned, m->pinned_count), TAKE(m->floating, m->floating_count);
    TAKE(m->lone, m->lone_count);
    TAKE(sim->curve, S), TAKE(sim->curve_owner, S), TAKE(sim->damping, S);
    TAKE(sim->curve_key, 2 * (3 * m->count[TS_Z] + S));
    TAKE(sim->values, m->n_real), TAKE(sim->applied, sim->n_applied), TAKE(sim->y, stride);
    TAKE(sim->slopes, 2 * sim->n_inputs), TAKE(sim->applied_slopes, 2 * sim->n_inputs);
    TAKE(sim->integers, m->n_int), TAKE(sim->piece, S), TAKE(sim->clipped, S), TAKE(sim->taut, S);
    TAKE(sim->Qf, nq), TAKE(sim->Qf_rate, nq), TAKE(sim->Qf_bend, nq), TAKE(sim->Qg, nq), TAKE(sim->inv, m->blocks);
    TAKE(sim->lo, S), TAKE(sim->hi, S), TAKE(sim->guard, S), TAKE(sim->sign_changed, S);
    TAKE(sim->margin_low, S), TAKE(sim->margin_high, S);
    TAKE(sim->rest, lanes), TAKE(sim->rest_rate, lanes), TAKE(sim->rest_bend, lanes), TAKE(sim->rest_jerk, lanes);
    TAKE(sim->rest_now, lanes), TAKE(sim->rest_rate_now, lanes), TAKE(sim->k_on, lanes), TAKE(sim->d_on, lanes);
    TAKE(sim->x, 2 * N * D), TAKE(sim->s, 2 * (size_t)D * lanes), TAKE(sim->per_length, lanes);
    TAKE(sim->elongation, lanes), TAKE(sim->elongation_rate, lanes), TAKE(sim->fs, lanes), TAKE(sim->fd, lanes);
    TAKE(sim->elongation_low, lanes), TAKE(sim->elongation_high, lanes), TAKE(sim->node_force, N * D);
    TAKE(sim->elongation0, lanes), TAKE(sim->rate0, lanes), TAKE(sim->f0, stride), TAKE(sim->ytmp, stride),
        TAKE(sim->err, stride);
    TAKE(sim->k, 16 * stride), TAKE(sim->ahead, sim->ahead_size), TAKE(sim->ahead_backup, sim->ahead_size);
    TAKE(sim->ft, nq), TAKE(sim->lin, 6 * nq);
    TAKE(sim->backup, m->n_real + sim->n_applied + 2 * sim->n_inputs + ny), TAKE(sim->backup_ints, m->n_int + 2 * S);
    TAKE(sim->transitions, TS_MAX_TRANSITIONS);
}

static void share_ahead(ts_sim *sim)
{
    size_t stride = (size_t)sim->m.stride;
    sim->sd = sim->s + sim->m.count[TS_D] * sim->m.lanes;
    sim->cont = sim->ahead;
    sim->y1 = sim->cont + 8 * stride;
    sim->f1 = sim->y1 + stride;
    sim->elongation1 = sim->f1 + stride;
    sim->rate1 = sim->elongation1 + sim->m.lanes;
}

/* Check counts and indices, so that a damaged file cannot lead outside the arrays.  A reason, or NULL. */
static const char *check(const ts_model *m)
{
    int N = m->count[TS_N], B = m->count[TS_B], S = m->count[TS_S], fixed = 0, beams = 0, with = 0;
    for (int n = 0; n < N; n++) fixed += m->fixed[n] != 0;
    for (int i = 0; i < 2 * B; i++)
        if (m->bars[i] < 0 || m->bars[i] >= N) return "a bar names an unknown node";
    for (int i = 0; i < 2 * S; i++)
        if (m->strings[i] < 0 || m->strings[i] >= N) return "a string names an unknown node";
    for (int i = 0; i < S; i++) {
        if (m->beams[i] < 0 || m->beams[i] > m->count[TS_Z]) return "a string has a wrong number of beams";
        if (m->beam_law[i] < 0 || m->beam_law[i] > 1) return "a string's beams have an unknown law";
        for (int k = 0; k < 2; k++) {
            const int32_t *place = (k ? m->damper : m->element) + 2 * i;
            int none = place[0] == -1 && place[1] == -1;
            if (!none && (place[0] < 0 || place[0] >= m->program_ints || place[1] < 0 || place[1] > m->program_doubles))
                return "a force law is not among the programs";
        }
        if (m->beams[i] && m->element[2 * i] >= 0) return "a string has both beams and another force law";
        beams += m->beams[i];
        with += m->beams[i] > 0;
    }
    for (int i = 0; i < m->count[TS_P] + m->count[TS_R] + m->count[TS_E]; i++) /* one behind the other */
        if (m->massed[i] < 0 || m->massed[i] >= N) return "a mass, drag or motion names an unknown node";
    for (int i = 0; i < m->count[TS_E]; i++)
        if (!m->fixed[m->moved[i]]) return "a moved node is not fixed";
    for (int i = 0; i < m->count[TS_A]; i++)
        if (m->wound[i] < 0 || m->wound[i] >= S) return "an actuator names an unknown string";
    if (fixed != m->count[TS_G] || N - fixed != m->count[TS_F]) return "the fixed nodes do not add up";
    if (beams != m->count[TS_Z] || with != m->count[TS_H]) return "the beams do not add up";
    return NULL;
}

/* Bars by kind, for loops without a question in them. */
static void list_bars(ts_model *m)
{
    int pinned = 0, floating = 0;
    for (int i = 0; i < m->count[TS_B]; i++) {
        int first = m->bars[2 * i], second = m->bars[2 * i + 1], base = m->bar_base[i];
        if (base < 0) m->floating[floating++] = MAKE(ts_place_of_bar){m->bar_centre[i], first, second, 0.5, 0.5};
        else m->pinned[pinned++] = MAKE(ts_place_of_bar){m->bar_block[i], base, base == first ? second : first, 0.0, 1.0};
        m->block_length[m->bar_block[i]] = m->bar_length[i];
    }
}

/* Free nodes on no bar, each with a block of its own behind those of the bars; a reason why one cannot move, or NULL. */
static const char *lay_out_lone(ts_model *m, const double *nodes)
{
    int D = m->count[TS_D], block = m->pinned_count + 2 * m->floating_count, found = 0;
    for (int i = 0; i < m->count[TS_P]; i++)
        if (m->node_block[m->massed[i]] < 0 && !m->fixed[m->massed[i]]) m->node_coef[m->massed[i]] = 1.0;
    for (int n = 0; n < m->count[TS_N]; n++) {
        if (m->fixed[n] || m->node_block[n] >= 0) continue;
        if (m->node_coef[n] != 1.0) return "a free node has neither a bar nor a point mass";
        m->lone[found] = n;
        m->block_bar[block] = -1;
        m->block_turns[block] = 0;
        m->node_block[n] = block;
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
        m->free_index[n] = m->fixed[n] ? -1 - g++ : f++;
        m->node_block[n] = m->node_centre[n] = -1;
        m->node_coef[n] = 0.0;
        for (int d = 0; d < D; d++) m->anchor[n * D + d] = m->fixed[n] ? nodes[n * D + d] : 0.0;
    }
    for (int i = 0; i < m->count[TS_B]; i++) {
        int first = m->bars[2 * i], second = m->bars[2 * i + 1], base = -1, tip = second;
        double length = 0.0;
        for (int d = 0; d < D; d++) length += pow(nodes[second * D + d] - nodes[first * D + d], 2);
        m->bar_length[i] = sqrt(length);
        if (!(length > 0.0 && length < INFINITY)) return "a bar has no length";
        if (m->fixed[first] && m->fixed[second]) return "a bar has both ends fixed";
        if (m->node_block[first] >= 0 || m->node_block[second] >= 0) return "a node belongs to two bars";
        if (m->fixed[first]) base = first;
        if (m->fixed[second]) base = second, tip = first;
        m->bar_base[i] = base;
        m->bar_centre[i] = base < 0 ? block++ : -1;
        m->bar_block[i] = block++;
        if (base < 0) m->block_bar[block - 2] = i, m->block_turns[block - 2] = 0;
        m->block_bar[block - 1] = i, m->block_turns[block - 1] = 1;
        m->node_block[tip] = m->bar_block[i];
        m->node_coef[tip] = base < 0 ? 0.5 : 1.0;
        if (base >= 0) {
            for (int d = 0; d < D; d++) m->anchor[tip * D + d] = nodes[base * D + d];
        } else {
            m->node_block[first] = m->bar_block[i];
            m->node_coef[first] = -0.5;
            m->node_centre[first] = m->node_centre[second] = m->bar_centre[i];
        }
        for (int d = 0; d < D; d++) { /* start */
            double a = nodes[first * D + d], b = nodes[second * D + d];
            if (base < 0) m->y_start[m->bar_centre[i] * D + d] = 0.5 * (a + b);
            m->y_start[m->bar_block[i] * D + d] = base < 0 ? b - a : nodes[tip * D + d] - nodes[base * D + d];
        }
    }
    list_bars(m);
    return lay_out_lone(m, nodes);
}

/* Who moves with a moved node, who winds which string. */
static const char *lay_out_drives(ts_model *m)
{
    for (int n = 0; n < m->count[TS_N]; n++) m->mover[n] = -1;
    for (int i = 0; i < m->count[TS_S]; i++) m->winder[i] = -1;
    for (int e = 0; e < m->count[TS_E]; e++) {
        m->mover[m->moved[e]] = e;
        m->mover_bar[e] = -1;
        for (int i = 0; i < m->count[TS_B]; i++) {
            if (m->bar_base[i] != m->moved[e]) continue;
            m->mover_bar[e] = i;
            m->mover[m->bars[2 * i] == m->moved[e] ? m->bars[2 * i + 1] : m->bars[2 * i]] = e;
        }
    }
    for (int a = 0; a < m->count[TS_A]; a++) {
        if (m->winder[m->wound[a]] >= 0) return "two actuators wind one string";
        m->winder[m->wound[a]] = a;
    }
    for (int r = 0; r < m->count[TS_R]; r++)
        if (m->fixed[m->dragged[r]]) return "a node with drag is fixed";
    m->driven = m->count[TS_P] + m->count[TS_R] + m->count[TS_E] + m->count[TS_A] > 0;
    return NULL;
}

static void add_node(ts_model *m, int string, int node, double sign)
{
    int D = m->count[TS_D];
    ts_term *t = m->term + 4 * string + m->term_count[string];
    for (int d = 0; d < D && m->mover[node] < 0; d++) m->s0[string * D + d] += sign * m->anchor[node * D + d];
    if (m->node_block[node] < 0) return;
    if (m->node_centre[node] >= 0) {
        *t++ = MAKE(ts_term){m->node_centre[node] * D, m->node_centre[node], sign};
        m->term_count[string]++;
    }
    *t = MAKE(ts_term){m->node_block[node] * D, m->node_block[node], sign * m->node_coef[node]};
    m->term_count[string]++;
}

static void lay_out_strings(ts_model *m)
{
    m->curved_count = m->damped_count = 0;
    for (int i = 0, beam = 0; i < m->count[TS_S]; i++) {
        m->law[i] = m->beams[i] > 0 || m->element[2 * i] >= 0;
        if (m->law[i]) m->curved[m->curved_count++] = i;
        if (m->damper[2 * i] >= 0) m->damped[m->damped_count++] = i;
        for (int end = 0; end < 2; end++) m->ends[2 * i + end] = 2 * m->count[TS_D] * m->strings[2 * i + end];
        add_node(m, i, m->strings[2 * i], -1.0);
        add_node(m, i, m->strings[2 * i + 1], 1.0);
        m->beam_first[i] = beam;
        beam += m->beams[i];
    }
}

/* Start velocities of the blocks, from the nodes'. */
static void lay_out_velocity(ts_model *m, const double *velocity)
{
    int D = m->count[TS_D];
    for (int i = 0; i < m->count[TS_B]; i++)
        for (int d = 0; d < D; d++) {
            double a = velocity[m->bars[2 * i] * D + d], b = velocity[m->bars[2 * i + 1] * D + d];
            int flipped = m->bar_base[i] == m->bars[2 * i + 1];
            if (m->bar_centre[i] >= 0) m->y_start[m->nq + m->bar_centre[i] * D + d] = 0.5 * (a + b);
            m->y_start[m->nq + m->bar_block[i] * D + d] = flipped ? a - b : b - a;
        }
    for (int i = 0; i < m->lone_count; i++)
        for (int d = 0; d < D; d++) m->y_start[m->nq + m->node_block[m->lone[i]] * D + d] = velocity[m->lone[i] * D + d];
}

static size_t int_count(const ts_model *m)
{
    const int32_t *count = m->count;
    size_t n = HEADER_INTS + (size_t)count[TS_N] + 2 * (size_t)count[TS_B] + 8 * (size_t)count[TS_S];
    n += (size_t)count[TS_P] + (size_t)count[TS_R] + (size_t)count[TS_E] + (size_t)count[TS_A] + (size_t)m->program_ints;
    return n + n % 2;
}

static const char *read_header(ts_sim *sim, const char *bytes, size_t size)
{
    ts_model *m = &sim->m;
    int32_t head[HEADER_INTS];
    uint64_t stored;
    if (size < 8 + sizeof head + 8 || memcmp(bytes, MAGIC, 8)) return "not a model of this version";
    memcpy(head, bytes + 8, sizeof head);
    memcpy(&stored, bytes + size - 8, 8);
    m->hash = ts_fnv(bytes, size - 8);
    if (stored != m->hash) return "the checksum is wrong";
    for (int i = 0; i < TS_COUNTS; i++)
        if (head[i] < 0 || head[i] > 1000000) return "a count is out of range";
    memcpy(m->count, head, sizeof m->count);
    m->damping_law = head[TS_COUNTS];
    m->method_start = head[TS_COUNTS + 1];
    m->z_axis = head[TS_COUNTS + 2];
    m->program_ints = head[TS_COUNTS + 3];
    m->program_doubles = head[TS_COUNTS + 4];
    if (m->program_ints < 0 || m->program_ints > 10000000 || m->program_doubles < 0 || m->program_doubles > 10000000)
        return "a program's size is out of range";
    if (m->count[TS_V] != 1 && m->count[TS_V] != m->count[TS_D])
        return "gravity has neither one component nor one for each axis";
    if (m->count[TS_D] != 2 && m->count[TS_D] != 3) return "neither planar nor 3D";
    if (m->z_axis >= m->count[TS_D]) return "no such axis";
    lay_out(m);
    sim->n_applied = m->at[TS_POSITION];
    sim->n_inputs = m->at[TS_STIFFNESS];
    size_t doubles = 2 * (size_t)m->count[TS_N] * (size_t)m->count[TS_D] + (size_t)m->at[TS_POSITION];
    doubles += (size_t)m->program_doubles;
    if (size != 8 + 4 * int_count(m) + 8 * doubles + 8) return "the length is wrong";
    return NULL;
}

static int round_up(int n) { return (n + TS_LANES - 1) / TS_LANES * TS_LANES; }

/* Free nodes on no bar; -1: out of memory. */
static int count_lone(const ts_model *m)
{
    int N = m->count[TS_N], count = 0;
    char *on_bar = (char *)calloc((size_t)N + 1, 1);
    if (!on_bar) return -1;
    for (int i = 0; i < 2 * m->count[TS_B]; i++) on_bar[m->bars[i]] = 1;
    for (int n = 0; n < N; n++) count += !m->fixed[n] && !on_bar[n];
    free(on_bar);
    return count;
}

static void count_blocks(ts_sim *sim)
{
    ts_model *m = &sim->m;
    m->pinned_count = 0;
    for (int i = 0; i < m->count[TS_B]; i++) m->pinned_count += m->fixed[m->bars[2 * i]] || m->fixed[m->bars[2 * i + 1]];
    m->floating_count = m->count[TS_B] - m->pinned_count;
    m->blocks = m->pinned_count + 2 * m->floating_count + m->lone_count +
                m->count[TS_A]; /* of an actuator's only the first number is used */
    m->nq = m->blocks * m->count[TS_D];
    m->ny = 2 * m->nq + TS_LEDGER;
    m->stride = round_up(m->ny);
    m->lanes = round_up(m->count[TS_S]);
    sim->ahead_size = 10 * (size_t)m->stride + 2 * (size_t)m->lanes;
}

static void couple(int32_t *couples, size_t *count, int32_t a, int32_t b)
{
    couples[2 * *count] = a;
    couples[2 * *count + 1] = b;
    ++*count;
}

/* The Jacobian's pattern: blocks that hang on one string are coupled, an actuator's with them, and those of a free bar by drag. */
static const char *lay_out_matrices(ts_sim *sim)
{
    ts_model *m = &sim->m;
    size_t D = (size_t)m->count[TS_D], count = 0;
    int32_t *couples = (int32_t *)malloc(2 * sizeof *couples * (10 * (size_t)m->count[TS_S] + (size_t)m->count[TS_R] + 1));
    if (!couples) return "out of memory";
    for (int i = 0; i < m->count[TS_S]; i++)
        for (int a = 0; a < m->term_count[i]; a++) {
            for (int b = 0; b < a; b++) couple(couples, &count, m->term[4 * i + a].block, m->term[4 * i + b].block);
            if (m->winder[i] >= 0) couple(couples, &count, m->term[4 * i + a].block, m->blocks - m->count[TS_A] + m->winder[i]);
        }
    for (int r = 0; r < m->count[TS_R]; r++)
        if (m->node_centre[m->dragged[r]] >= 0)
            couple(couples, &count, m->node_centre[m->dragged[r]], m->node_block[m->dragged[r]]);
    int made = ts_pattern_make(&sim->pattern, m->blocks, (int32_t)D, couples, count);
    free(couples);
    if (!made) return "out of memory";
    size_t size = (size_t)sim->pattern.count * D * D;
    size_t real = ts_pattern_factor_size(&sim->pattern), complex = ts_complex_factor_size(&sim->pattern);
    sim->matrices = (double *)calloc(2 * size + real + 2 * complex + 1, sizeof(double));
    if (!sim->matrices) return "out of memory";
    sim->bytes += sizeof(double) * (2 * size + real + 2 * complex);
    sim->Jq = sim->matrices;
    sim->Jv = sim->Jq + size;
    sim->factor = sim->Jv + size;
    sim->pair_factor[0] = sim->factor + real;
    sim->pair_factor[1] = sim->pair_factor[0] + complex;
    for (int i = 0; i < m->count[TS_S]; i++)
        for (int a = 0; a < m->term_count[i]; a++)
            for (int b = 0; b < m->term_count[i]; b++)
                m->term_place[16 * i + 4 * a + b] =
                    (int32_t)D * (int32_t)D *
                    ts_pattern_find(&sim->pattern, m->term[4 * i + a].block, m->term[4 * i + b].block);
    for (int b = 0; b < m->blocks; b++) {
        m->own_place[b] = (int32_t)(D * D) * ts_pattern_find(&sim->pattern, b, b);
        TS_ASSERT(m->own_place[b] >= 0);
    }
    return NULL;
}

void ts_model_free(ts_sim *sim)
{
    ts_pattern_free(&sim->pattern);
    free(sim->matrices);
    free(sim->arena);
    free(sim->blob);
}

int ts_model_read(ts_sim *sim, const void *bytes, size_t size, char *message, size_t capacity)
{
    ts_model *m = &sim->m;
    const char *reason = read_header(sim, (const char *)bytes, size);
    if (!reason && !(sim->blob = malloc(size))) reason = "out of memory";
    if (!reason) {
        memcpy(sim->blob, bytes, size);
        const int32_t *ints = (const int32_t *)((char *)sim->blob + 8) + HEADER_INTS;
        const double *nodes = (const double *)(const void *)((char *)sim->blob + 8 + 4 * int_count(m));
        int N = m->count[TS_N], D = m->count[TS_D];
        m->fixed = ints;
        m->bars = m->fixed + N;
        m->strings = m->bars + 2 * m->count[TS_B];
        m->beams = m->strings + 2 * m->count[TS_S];
        m->beam_law = m->beams + m->count[TS_S];
        m->element = m->beam_law + m->count[TS_S];
        m->damper = m->element + 2 * m->count[TS_S];
        m->massed = m->damper + 2 * m->count[TS_S];
        m->dragged = m->massed + m->count[TS_P];
        m->moved = m->dragged + m->count[TS_R];
        m->wound = m->moved + m->count[TS_E];
        m->program = m->wound + m->count[TS_A];
        m->program_values = nodes + 2 * N * D;
        m->start = m->program_values + m->program_doubles;
        reason = check(m);
        if (!reason && (m->lone_count = count_lone(m)) < 0) reason = "out of memory";
        if (!reason) {
            count_blocks(sim);
            arena a = {NULL, 0};
            lay_out_arena(sim, &a);
            sim->bytes = size + a.used;
            sim->arena = a.base = (char *)calloc(a.used + 16, 1);
            const size_t needed = a.used;
            a.used = 0;
            if (!a.base) reason = "out of memory";
            else {
                lay_out_arena(sim, &a);
                TS_ASSERT(a.used == needed);
                share_ahead(sim);
                TS_ASSERT(sim->rate1 + m->lanes <= sim->ahead + sim->ahead_size);
            }
        }
        if (!reason) reason = lay_out_bars(m, nodes);
        if (!reason) reason = lay_out_drives(m);
        if (!reason) {
            m->velocity = nodes + N * D;
            lay_out_strings(m);
            for (int i = 0; i < N * D; i++) sim->x[i / D * 2 * D + i % D] = m->anchor[i]; /* fixed nodes stay there */
            lay_out_velocity(m, nodes + N * D);
            reason = lay_out_matrices(sim);
        }
    }
    if (!reason) return 1;
    ts_model_free(sim);
    snprintf(message, capacity, "%s", reason);
    return 0;
}
