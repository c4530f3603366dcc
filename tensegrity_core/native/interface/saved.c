/* Saved states: all that the next steps depend on, as bytes. */
#include "interface/applied.h"
#include "invariants.h"
#include "interface/message.h"
#include "interface/ready.h"
#include "model/data.h"
#include "model/packed.h"
#include "motion/motion.h"
#include "steps/auto.h"
#include "steps/integrate.h"
#include "tensegrity.h"

#include <stddef.h>
#include <string.h>

#define STATE_MAGIC 0x3254415453534e54u /* "TNSSTAT2" */
#define MOST_COUNTED 1000000000000000   /* of anything in ts_stats(); twice as much can still be counted by ones in a double */

/* A saved state: header, memory, values, slopes and both as applied, y, integers, pieces, clipping, modes and
 * bristles of contacts, open step, hash. */
typedef struct {
    uint64_t magic, model;
} state_header;

enum copy { MEASURE, OUT, IN };

/* Copy the parts of the state to or from `at`, or only add up their sizes. */
static size_t copy_state(ts_sim *sim, char *at, enum copy direction)
{
    const ts_model *m = &sim->m;
    size_t S = (size_t)m->count[TS_S] * sizeof(int32_t), total = 0;
    struct {
        void *data;
        size_t size;
    } parts[] = {
        {&sim->memory, sizeof sim->memory},
        {sim->io.values, sizeof(double) * (size_t)m->n_real},
        {sim->io.slopes, 2 * sizeof(double) * (size_t)sim->m.n_inputs},
        {sim->io.applied_slopes, 2 * sizeof(double) * (size_t)sim->m.n_inputs},
        {sim->io.applied, sizeof(double) * (size_t)sim->m.n_applied},
        {sim->state.y, sizeof(double) * (size_t)m->ny},
        {sim->io.integers, sizeof(int32_t) * (size_t)m->n_int},
        {sim->state.piece, S},
        {sim->state.clipped, S},
        {sim->state.mode, (size_t)m->count[TS_K] * sizeof(int32_t)},
        {sim->state.bristle, (size_t)(m->count[TS_K] * m->count[TS_D]) * sizeof(double)},
        {sim->ahead.all, sizeof(double) * sim->ahead.size},
    };
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        if (direction == OUT) memcpy(at + total, parts[i].data, parts[i].size);
        if (direction == IN) memcpy(parts[i].data, at + total, parts[i].size);
        total += parts[i].size;
    }
    return total;
}

size_t ts_state_size(const ts_sim *sim)
{
    return sizeof(state_header) + copy_state((ts_sim *)sim, NULL, MEASURE) + sizeof(uint64_t);
}

int ts_save(const ts_sim *sim, void *bytes, size_t size)
{
    state_header header = {STATE_MAGIC, sim->m.packed.hash};
    if (ts_free_of_steps((ts_sim *)sim) != TS_OK) return TS_BAD_STEP;
    int status = ts_fill((ts_sim *)sim, TS_OF_ALL);
    if (status != TS_OK) return status;
    if (size != ts_state_size(sim)) return TS_BAD_STATE;
    memcpy(bytes, &header, sizeof header);
    size_t parts = copy_state((ts_sim *)sim, (char *)bytes + sizeof header, OUT), ahead = sizeof(double) * sim->ahead.size;
    TS_ASSERT(sizeof header + parts + sizeof(uint64_t) == size);
    ts_memory memory = sim->memory;
    ts_clear_scratch(sim, &memory, (char *)bytes + sizeof header + parts - ahead);
    memcpy((char *)bytes + sizeof header, &memory, sizeof memory);
    uint64_t hash = ts_fnv(bytes, size - sizeof hash);
    memcpy((char *)bytes + size - sizeof hash, &hash, sizeof hash);
    return TS_OK;
}

/* Numbers that no simulation comes to: counters that would overflow, or in which the work of a call would be lost. */
static int is_sound(const ts_memory *memory)
{
    const ts_choice *c = &memory->choice;
    const ts_span *span = &memory->span;
    const double reals[] = {memory->time,   memory->time_low, memory->h_next,    memory->h_kick,
                            memory->joined, memory->err_last, memory->last_step, span->start,
                            span->h,        span->reach,      span->clipped};
    const int32_t counters[] = {memory->rejected, memory->stiff, memory->patience, c->losing,
                                c->phase_steps,   c->steps,      memory->completed};
    int sound = ts_all_finite(reals, sizeof reals / sizeof *reals);
    sound = sound && ts_all_finite(&c->work, (int)(offsetof(ts_choice, h_lambda) / sizeof(double)));
    for (size_t i = 0; i < sizeof counters / sizeof *counters; i++) sound = sound && counters[i] >= 0;
    for (int i = 0; i < TS_STATS; i++) sound = sound && memory->stats[i] >= 0 && memory->stats[i] < MOST_COUNTED;
    return sound;
}

/* Does the communication point lie within the step that was left open there? */
static int is_open(const ts_span *span)
{
    double passed = -span->start / span->h;
    return passed >= 0.0 && passed <= 1.0 + 1e-9 && span->reach > 0.0 && span->reach <= 1.0;
}

/* Does a state with a right checksum keep within the arrays? */
static int is_possible(const ts_sim *sim)
{
    const ts_memory *memory = &sim->memory;
    const int S = sim->m.count[TS_S], method = sim->io.integers[sim->m.int_at[TS_INT_METHOD]];
    int possible =
        memory->method >= 0 && memory->method < TS_METHOD_COUNT && memory->active > 0 && memory->active < TS_METHOD_COUNT;
    possible = possible && method >= 0 && method < TS_METHOD_COUNT &&
               memory->span.which < 2 * S + TS_WATCHES * sim->m.count[TS_K] && ts_choice_is_possible(memory);
    possible = possible && memory->span.method >= 0 && memory->span.method < TS_METHOD_COUNT;
    possible = possible && (memory->span.h > 0.0 ? memory->span.method > 0 && is_open(&memory->span) : memory->span.h == 0.0);
    for (int i = 0; i < S; i++)
        possible = possible && sim->state.piece[i] >= 0 && sim->state.piece[i] < sim->laws.curve[i].pieces;
    for (int k = 0; k < sim->m.count[TS_K]; k++)
        possible = possible && sim->state.mode[k] >= 0 && sim->state.mode[k] < TS_CONTACT_MODES;
    return possible && ts_all_finite(sim->state.bristle, sim->m.count[TS_K] * sim->m.count[TS_D]);
}

int ts_restore(ts_sim *sim, const void *bytes, size_t size)
{
    state_header header = {0, 0};
    uint64_t hash = 0;
    if (ts_free_of_steps(sim) != TS_OK) return TS_BAD_STEP;
    if (size == ts_state_size(sim)) {
        memcpy(&header, bytes, sizeof header);
        memcpy(&hash, (const char *)bytes + size - sizeof hash, sizeof hash);
    }
    if (size != ts_state_size(sim) || header.magic != STATE_MAGIC || header.model != sim->m.packed.hash ||
        hash != ts_fnv(bytes, size - sizeof hash))
        return ts_say(sim, TS_BAD_STATE, "the saved state is damaged, of another version or of another model; save one anew");
    copy_state(sim, (char *)bytes + sizeof header, IN);
    sim->demand.stale = sim->demand.motion_ahead = sim->demand.ledger_ahead = sim->demand.moderate = 0;
    sim->demand.evaluation = -1;
    sim->told.count = 0;
    int possible = sim->memory.started || sim->memory.span.h == 0.0;
    if (possible && !sim->memory.started) return TS_OK;
    int32_t index;
    ts_swap_applied(sim);
    possible = possible && is_sound(&sim->memory) && ts_all_finite(sim->state.y, sim->m.ny);
    possible = possible && ts_check(sim, &index) == TS_OK && ts_build_curves(sim) == TS_OK && is_possible(sim);
    if (possible) ts_derive(sim);
    possible = possible && ts_all_finite(sim->io.values + sim->m.n_applied, sim->m.n_real - sim->m.n_applied);
    ts_swap_back(sim);
    if (possible) return TS_OK;
    ts_reset(sim);
    return ts_say(sim, TS_BAD_STATE, "the saved state is none that a simulation comes to; the simulation has been reset");
}
