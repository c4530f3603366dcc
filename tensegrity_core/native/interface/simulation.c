/* The public interface: life cycle, and steps that leave no trace when they fail. */
#include "interface/applied.h"
#include "invariants.h"
#include "interface/checks.h"
#include "interface/demand.h"
#include "interface/message.h"
#include "interface/ready.h"
#include "laws/curves.h"
#include "model/data.h"
#include "model/packed.h"
#include "motion/drives.h"
#include "motion/joints.h"
#include "motion/motion.h"
#include "motion/outputs.h"
#include "steps/auto.h"
#include "steps/events.h"
#include "steps/integrate.h"
#include "steps/watch.h"
#include "tensegrity.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

ts_sim *ts_create(const void *model, size_t size, char *message, size_t capacity)
{
    ts_sim *sim = (ts_sim *)calloc(1, sizeof *sim);
    if (!sim) {
        snprintf(message, capacity, "out of memory");
        return NULL;
    }
    if (!ts_model_read(sim, model, size, message, capacity)) {
        free(sim);
        return NULL;
    }
    ts_group_outputs(sim);
    const char *reason = ts_dampers_build(&sim->laws, &sim->m);
    if (reason || ts_reset(sim) != TS_OK) {
        snprintf(message, capacity, "%s", reason ? reason : sim->told.message);
        ts_free(sim);
        return NULL;
    }
    return sim;
}

int ts_reset(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    int32_t index;
    if (ts_free_of_steps(sim) != TS_OK) return TS_BAD_STEP;
    memset(sim->io.values, 0, sizeof(double) * (size_t)m->n_real);
    memset(sim->io.integers, 0, sizeof(int32_t) * (size_t)m->n_int);
    memset(&sim->memory, 0, sizeof sim->memory);
    memcpy(sim->io.values, m->packed.start, sizeof(double) * (size_t)sim->m.n_applied);
    memset(sim->io.slopes, 0, 2 * sizeof(double) * (size_t)sim->m.n_inputs);
    sim->io.integers[m->int_at[TS_INT_METHOD]] = m->packed.method;
    sim->told.count = 0;
    sim->demand.stale = sim->demand.motion_ahead = sim->demand.ledger_ahead = 0;
    int status =
        ts_check(sim, &index) == TS_OK ? ts_build_curves(sim) : TS_OK; /* else ts_initialize() will say what is wrong */
    return status == TS_OK ? ts_say(sim, TS_OK, "") : status;
}

void ts_free(ts_sim *sim)
{
    if (!sim) return;
    ts_curves_free(&sim->laws, sim->m.count[TS_S]);
    ts_dampers_free(&sim->laws, sim->m.count[TS_S]);
    ts_model_free(sim);
    free(sim);
}

void ts_counts(const ts_sim *sim, int32_t counts[TS_COUNTS]) { memcpy(counts, sim->m.count, sizeof sim->m.count); }
double *ts_values(ts_sim *sim) { return sim->io.values; }
int32_t ts_real_count(const ts_sim *sim) { return sim->m.n_real; }
int32_t ts_integer_count(const ts_sim *sim) { return sim->m.n_int; }
double *ts_slopes(ts_sim *sim) { return sim->io.slopes; }
int32_t ts_input_count(const ts_sim *sim) { return sim->m.n_inputs; }
int32_t ts_output_first(const ts_sim *sim) { return sim->m.n_applied; }
int32_t *ts_integers(ts_sim *sim) { return sim->io.integers; }
double ts_time(const ts_sim *sim) { return ts_time_at(&sim->memory, sim->call.watching ? sim->call.reached : 0.0); }
size_t ts_memory_size(const ts_sim *sim) { return sizeof *sim + sim->owned.bytes; }
int64_t ts_transition_count(const ts_sim *sim) { return sim->told.count; }
int32_t ts_transition_stored(const ts_sim *sim)
{
    return sim->told.count < TS_MAX_TRANSITIONS ? (int32_t)sim->told.count : TS_MAX_TRANSITIONS;
}
const ts_transition *ts_transitions(const ts_sim *sim) { return sim->told.transitions; }
int32_t ts_snapped(const ts_sim *sim, int32_t string, int32_t piece)
{
    if (!sim->laws.ready || piece <= 0 || string < 0) return 0;
    const ts_curve *c = sim->laws.curve + string;
    return c->branches ? piece - 1 : piece < c->pieces ? c->piece[piece].snapped : 0;
}
void ts_stats(const ts_sim *sim, int64_t stats[TS_STATS]) { memcpy(stats, sim->memory.stats, sizeof sim->memory.stats); }

/* The start has free bars' midpoints in the place of their centres of mass. */
static void move_to_centres(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D];
    for (int i = 0; i < m->bar.floating_count; i++)
        for (int d = 0; d < D; d++)
            for (int at = m->bar.floating[i].block * D + d; at < 2 * m->nq; at += m->nq)
                sim->state.y[at] += (m->bar.floating[i].lower - 0.5) * sim->state.y[at + D];
}

/* From now on these inputs and parameters are the last step's. */
static void apply(const ts_model *m, ts_io *io)
{
    memcpy(io->applied, io->values, sizeof(double) * (size_t)m->n_applied);
    memcpy(io->applied_slopes, io->slopes, 2 * sizeof(double) * (size_t)m->n_inputs);
}

/* Where a step's backup has the bristles. */
static double *bristles(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    return sim->undo.reals + m->n_real + m->n_applied + 2 * m->n_inputs + m->ny;
}

static size_t bristle_size(const ts_sim *sim) { return sizeof(double) * (size_t)(sim->m.count[TS_K] * sim->m.count[TS_D]); }

int ts_initialize(ts_sim *sim, double time)
{
    const ts_model *m = &sim->m;
    int32_t index;
    if (ts_free_of_steps(sim) != TS_OK) return TS_BAD_STEP;
    int status = ts_check(sim, &index);
    if (status != TS_OK) return status;
    if (!isfinite(time)) return ts_say(sim, TS_BAD_STEP, "the start time is not a finite number");
    status = ts_build_curves(sim);
    if (status != TS_OK) {
        ts_keep_curves(sim);
        return status;
    }
    int method = sim->io.integers[m->int_at[TS_INT_METHOD]];
    memset(&sim->memory, 0, sizeof sim->memory);
    sim->memory.time = time;
    sim->memory.active = method == TS_METHOD_AUTO ? TS_METHOD_DOP853 : method;
    ts_start_choice(&sim->memory);
    sim->memory.method = method;
    sim->memory.started = 1;
    sim->demand.stale = sim->demand.motion_ahead = sim->demand.ledger_ahead = 0;
    ts_set_reach(sim);
    sim->told.count = 0;
    memcpy(sim->state.y, m->y_start, sizeof(double) * (size_t)m->ny);
    apply(&sim->m, &sim->io);
    ts_prepare(sim);
    move_to_centres(sim);
    ts_project(&sim->m, sim->state.y);
    if (m->joint.nodes) ts_put_back(sim, 0.0, sim->state.y);
    ts_jump_bases(sim, NULL, NULL, 0.0);
    /* strings with memory come from slack; what that dissipated was before the start */
    memset(sim->state.piece, 0, sizeof(int32_t) * (size_t)m->count[TS_S]);
    memset(sim->state.mode, 0, sizeof(int32_t) * (size_t)m->count[TS_K]);
    memset(sim->state.bristle, 0, bristle_size(sim));
    ts_place_all(sim);
    sim->told.count = sim->memory.stats[TS_TRANSITIONS] = 0;
    ts_rhs(sim, 0.0, sim->state.y, sim->start.f);
    for (int i = sim->m.n_applied; i < m->n_real; i++)
        sim->io.values[i] = NAN; /* an output that nothing fills is found below */
    ts_outputs(sim, 0.0, TS_OF_ALL);
    status = ts_check_outputs(sim, TS_OF_ALL, "at the start");
    if (!ts_all_finite(sim->start.f, 2 * m->nq))
        status = ts_say(sim, TS_NOT_FINITE,
                        "the accelerations at the start are not finite numbers; give smaller inputs, or the bars more mass");
    if (status != TS_OK) sim->memory.started = 0;
    return status;
}

/* Everything that a step changes, but the outputs. */
static void backup(ts_sim *sim, ts_memory *memory)
{
    size_t S = (size_t)sim->m.count[TS_S];
    *memory = sim->memory;
    memcpy(sim->undo.reals, sim->state.y, sizeof(double) * (size_t)sim->m.ny);
    memcpy(sim->undo.integers, sim->state.piece, sizeof(int32_t) * S);
    memcpy(sim->undo.integers + S, sim->state.clipped, sizeof(int32_t) * S);
    memcpy(sim->undo.integers + 2 * S, sim->state.mode, sizeof(int32_t) * (size_t)sim->m.count[TS_K]);
    memcpy(bristles(sim), sim->state.bristle, bristle_size(sim));
    if (memory->span.h > 0.0) memcpy(sim->ahead.backup, sim->ahead.all, sizeof(double) * sim->ahead.size);
}

static void undo(ts_sim *sim, const ts_memory *memory, const ts_demand *demand)
{
    size_t S = (size_t)sim->m.count[TS_S];
    sim->memory = *memory;
    sim->demand = *demand;
    sim->told.count = 0;
    memcpy(sim->state.y, sim->undo.reals, sizeof(double) * (size_t)sim->m.ny);
    memcpy(sim->state.piece, sim->undo.integers, sizeof(int32_t) * S);
    memcpy(sim->state.clipped, sim->undo.integers + S, sizeof(int32_t) * S);
    memcpy(sim->state.mode, sim->undo.integers + 2 * S, sizeof(int32_t) * (size_t)sim->m.count[TS_K]);
    memcpy(sim->state.bristle, bristles(sim), bristle_size(sim));
    if (memory->span.h > 0.0) memcpy(sim->ahead.all, sim->ahead.backup, sizeof(double) * sim->ahead.size);
    ts_swap_applied(sim);
    ts_derive(sim);
    ts_swap_back(sim);
}

/* Do inputs move on that say where something is at the step's start? */
static int inputs_move(const ts_sim *sim)
{
    const double *rate = sim->io.applied + sim->m.at[TS_REST_LENGTH_RATE];
    for (int i = 0; i < sim->m.count[TS_S]; i++)
        if (rate[i] != 0.0) return 1;
    return ts_inputs_move(&sim->m, &sim->io);
}

static int wound_up(ts_sim *sim)
{
    const char *why = "an actuator has wound its string up completely: lower its current, or give the string more rest length";
    return ts_wound_up(sim) ? ts_say(sim, TS_WOUND_UP, why) : TS_OK;
}

/* Take over new inputs: pieces anew; the jump of the stored energy and what snaps dissipate go into the input work. */
static void take_inputs(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    double before = sim->io.values[m->at[TS_POTENTIAL]] + sim->io.values[m->at[TS_ELASTIC]], moved = 0.0;
    if (m->count[TS_E]) {
        ts_jump_bases(sim, sim->io.applied, sim->io.applied_slopes, sim->memory.last_step);
        moved = ts_kinetic_energy(sim) - sim->io.values[m->at[TS_KINETIC]];
    }
    double lost = ts_place_all(sim);
    sim->demand.evaluation = -1; /* the last one was under other inputs */
    sim->state.y[2 * m->nq] += lost;
    sim->state.y[2 * m->nq + 1] += ts_stored_energy(sim, 0.0) - before + moved + lost;
    sim->state.y[2 * m->nq + 2] += lost;
    ts_close_span(sim);
}

static void add_time(ts_memory *memory, double h)
{
    double step = h + memory->time_low, sum = memory->time + step;
    memory->time_low = fabs(memory->time) >= fabs(step) ? (memory->time - sum) + step : (step - sum) + memory->time;
    memory->time = sum;
}

/* The end of a call: its time. */
static void settle(ts_memory *memory, double h, int sloped)
{
    const double before = memory->time;
    add_time(memory, h);
    TS_ASSERT(memory->time >= before && ts_choice_is_possible(memory));
    memory->last_step = h;
    memory->sloped = sloped;
}

/* The outputs at the end of the last step once more, from the state there. */
static void recall_outputs(ts_sim *sim)
{
    sim->demand.stale = TS_OF_ALL;
    ts_fill(sim, TS_OF_ALL);
}

/* A whole call within the step that the last one left open.  Only the state at its end and the time change. */
static int step_within(ts_sim *sim, double h)
{
    const ts_memory memory = sim->memory;
    const ts_demand demand = sim->demand;
    sim->told.count = 0;
    ts_serve_span(sim, h);
    if (sim->m.count[TS_A]) ts_bring_motion(sim);
    int status = wound_up(sim), told = status == TS_OK;
    if (told) {
        settle(&sim->memory, h, 0);
        status = ts_fill_within_step(sim);
    }
    if (status == TS_OK) return TS_OK;
    sim->memory = memory;
    sim->demand = demand;
    sim->demand.motion_ahead = sim->demand.ledger_ahead = 1;
    if (told) recall_outputs(sim);
    return status;
}

/* Of the state at the communication point: coordinates, since the strings' guards follow from them; where inputs jump the ledger,
 * too, and the energies. */
static int bring(ts_sim *sim, int inputs_jump)
{
    ts_bring_motion(sim);
    if (!inputs_jump) return TS_OK;
    ts_bring_state(sim);
    return ts_fill(sim, TS_OF_ENERGIES);
}

int ts_step(ts_sim *sim, double h)
{
    size_t bytes = sizeof(double) * (size_t)sim->m.n_applied;
    ts_memory memory;
    if (ts_started(sim) != TS_OK) return TS_BAD_STEP;
    if (!(h > 0.0) || !isfinite(h)) return ts_say(sim, TS_BAD_STEP, "the step must be positive and finite");
    int sloped = ts_sloped(&sim->m, &sim->io);
    int changed = sloped || sim->memory.sloped || memcmp(sim->io.values, sim->io.applied, bytes) || inputs_move(sim) ||
                  sim->io.integers[sim->m.int_at[TS_INT_METHOD]] != sim->memory.method;
    if (!changed && ts_span_serves(&sim->memory.span, h)) return step_within(sim, h);
    int status = bring(sim, changed);
    if (status != TS_OK) return status;
    const ts_demand demand = sim->demand;
    backup(sim, &memory);
    sim->call.reached = 0.0;
    sim->call.looked = sim->call.answer = TS_GO_ON;
    ts_prepare(sim);
    if (changed) status = ts_check_change(sim, h);
    if (status == TS_OK) {
        sim->told.count = 0;
        if (changed) take_inputs(sim);
        else ts_set_pieces(sim);
        status = ts_integrate(sim, h, !changed);
    }
    if (sim->call.answer == TS_END_HERE) h = sim->call.reached;
    if (sim->call.answer == TS_GIVE_UP) status = ts_say(sim, TS_BAD_STEP, "the step's watcher gave it up");
    if (status == TS_OK && sim->m.count[TS_A]) ts_bring_motion(sim);
    if (status == TS_OK) status = wound_up(sim);
    int told = status == TS_OK;
    if (told) {
        settle(&sim->memory, h, sloped);
        status = ts_fill_after_step(sim, changed);
    }
    if (status != TS_OK) {
        undo(sim, &memory, &demand);
        if (told || sim->call.looked) recall_outputs(sim);
        return status;
    }
    apply(&sim->m, &sim->io);
    return TS_OK;
}

void ts_carry_inputs(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    double *v = sim->io.values, h = sim->memory.last_step;
    if (!sim->memory.started || ts_sloped(m, &sim->io)) return;
    const double *was = sim->io.applied;
    const int length = m->at[TS_REST_LENGTH], rate = m->at[TS_REST_LENGTH_RATE], place = m->at[TS_NODE_POSITION];
    const int velocity = m->at[TS_NODE_VELOCITY], acceleration = m->at[TS_NODE_ACCELERATION];
    for (int i = 0; i < m->count[TS_S]; i++)
        if (v[length + i] == was[length + i] && v[rate + i] == was[rate + i]) v[length + i] += h * v[rate + i];
    for (int i = 0; i < m->count[TS_E] * m->count[TS_D]; i++) {
        double speed = v[velocity + i], bend = v[acceleration + i];
        if (v[place + i] != was[place + i] || speed != was[velocity + i] || bend != was[acceleration + i]) continue;
        v[place + i] += (speed + 0.5 * bend * h) * h;
        v[velocity + i] += bend * h;
    }
    const int height = m->at[TS_GROUND_HEIGHT], rise = m->at[TS_GROUND_VELOCITY], bent = m->at[TS_GROUND_ACCELERATION];
    if (!m->count[TS_W] || v[height] != was[height] || v[rise] != was[rise] || v[bent] != was[bent]) return;
    v[height] += (v[rise] + 0.5 * v[bent] * h) * h;
    v[rise] += v[bent] * h;
}

static int take_now(ts_sim *sim)
{
    ts_memory memory;
    const ts_demand demand = sim->demand;
    backup(sim, &memory);
    ts_prepare(sim);
    int status = ts_check_change(sim, 0.0), told = status == TS_OK;
    sim->told.count = 0;
    if (told) {
        take_inputs(sim);
        settle(&sim->memory, 0.0, 1); /* so the next step takes its inputs as new ones, too */
        status = ts_fill_after_step(sim, 1);
    }
    if (status == TS_OK) {
        apply(&sim->m, &sim->io);
        return TS_OK;
    }
    undo(sim, &memory, &demand);
    if (told) recall_outputs(sim);
    return status;
}

int ts_take_inputs(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    size_t bytes = sizeof(double) * (size_t)m->n_applied;
    double *held = sim->undo.reals + m->n_real + 2 * m->n_inputs + m->ny;
    if (ts_ready(sim) != TS_OK) return TS_BAD_STEP;
    if (!memcmp(sim->io.values, sim->io.applied, bytes) && !ts_sloped(m, &sim->io)) {
        sim->told.count = 0;
        return TS_OK;
    }
    int status = bring(sim, 1);
    if (status != TS_OK) return status;
    memcpy(held, sim->io.values, bytes);
    ts_carry_inputs(sim);
    status = take_now(sim);
    if (status != TS_OK) memcpy(sim->io.values, held, bytes);
    return status;
}
