/* The public interface: life cycle, checks, steps that leave no trace when they fail, saved states. */
#include "internal.h"

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define STATE_MAGIC 0x3254415453534e54u /* "TNSSTAT2" */
#define MOST_COUNTED 1000000000000000 /* of anything in ts_stats(); twice as much can still be counted by ones in a double */

static const char *const status_names[] = {
#define TS_ERROR(name, text) #name,
#include "errors.def"
#undef TS_ERROR
};

static void say(ts_sim *sim, const char *text) { snprintf(sim->message, sizeof sim->message, "%s", text); }

/* Curves by the present parameters: TS_OK, or what is wrong. */
static int build_curves(ts_sim *sim)
{
    const char *reason = ts_curves_build(sim);
    if (!reason) return TS_OK;
    say(sim, reason);
    return strcmp(reason, "out of memory") ? TS_BAD_INPUT : TS_BAD_MODEL;
}

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
    const char *reason = ts_dampers_build(sim);
    if (reason || ts_reset(sim) != TS_OK) {
        snprintf(message, capacity, "%s", reason ? reason : sim->message);
        ts_free(sim);
        return NULL;
    }
    return sim;
}

int ts_reset(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    int32_t index;
    memset(sim->values, 0, sizeof(double) * (size_t)m->n_real);
    memset(sim->integers, 0, sizeof(int32_t) * (size_t)m->n_int);
    memset(&sim->memory, 0, sizeof sim->memory);
    memcpy(sim->values, m->start, sizeof(double) * (size_t)sim->n_applied);
    memset(sim->slopes, 0, 2 * sizeof(double) * (size_t)sim->n_inputs);
    sim->integers[m->int_at[TS_INT_METHOD]] = m->method_start;
    sim->transition_count = 0;
    int status = ts_check(sim, &index) == TS_OK ? build_curves(sim) : TS_OK; /* else ts_initialize() will say what is wrong */
    if (status == TS_OK) say(sim, "");
    return status;
}

void ts_free(ts_sim *sim)
{
    if (!sim) return;
    ts_curves_free(sim);
    ts_dampers_free(sim);
    ts_model_free(sim);
    free(sim);
}

void ts_counts(const ts_sim *sim, int32_t counts[TS_COUNTS]) { memcpy(counts, sim->m.count, sizeof sim->m.count); }
double *ts_values(ts_sim *sim) { return sim->values; }
int32_t ts_real_count(const ts_sim *sim) { return sim->m.n_real; }
int32_t ts_integer_count(const ts_sim *sim) { return sim->m.n_int; }
double *ts_slopes(ts_sim *sim) { return sim->slopes; }
int32_t ts_input_count(const ts_sim *sim) { return sim->n_inputs; }
int32_t ts_output_first(const ts_sim *sim) { return sim->n_applied; }
int32_t *ts_integers(ts_sim *sim) { return sim->integers; }
double ts_time(const ts_sim *sim) { return sim->memory.time + sim->memory.time_low; }
const char *ts_message(const ts_sim *sim) { return sim->message; }
const char *ts_status_name(int status) { return status >= 0 && status < TS_STATUS_COUNT ? status_names[status] : "?"; }
int64_t ts_transition_count(const ts_sim *sim) { return sim->transition_count; }
int32_t ts_transition_stored(const ts_sim *sim)
{
    return sim->transition_count < TS_MAX_TRANSITIONS ? (int32_t)sim->transition_count : TS_MAX_TRANSITIONS;
}
const ts_transition *ts_transitions(const ts_sim *sim) { return sim->transitions; }
int32_t ts_snapped(const ts_sim *sim, int32_t string, int32_t piece)
{
    if (!sim->curves_ready || piece <= 0) return 0;
    const ts_curve *c = sim->curve + string;
    return c->branches ? piece - 1 : piece < c->pieces ? c->piece[piece].snapped : 0;
}
void ts_stats(const ts_sim *sim, int64_t stats[TS_STATS]) { memcpy(stats, sim->memory.stats, sizeof sim->memory.stats); }

static const struct {
    double low, high;
} bounds[] = {
#define ROW(name, role, first, second, low, high) {low, high},
    TS_FIELDS(ROW)
#undef ROW
};

/* Is a value of this field acceptable?  If not, say why. */
static int accept(ts_sim *sim, int field, double x)
{
    double low = bounds[field].low, high = bounds[field].high;
    if (isfinite(x) && x >= low && x <= high) return 1;
    if (!isfinite(x)) say(sim, "is not a finite number");
    else if (high < DBL_MAX) snprintf(sim->message, sizeof sim->message, "must lie between %g and %g", low, high);
    else say(sim, low > 0.0 ? "must be positive" : "must not be negative");
    return 0;
}

/* Only a law with memory knows beams that are not metastable.  The first that is not where it must be, or -1. */
static int wrong_beam(const ts_sim *sim)
{
    const ts_model *m = &sim->m;
    const double *zeta = sim->values + m->at[TS_NSH_ZETA];
    for (int i = 0; i < m->count[TS_S]; i++)
        for (int j = m->beam_first[i]; j < m->beam_first[i] + m->beams[i] && !m->beam_law[i]; j++)
            if (!(zeta[j] > 2.0 && zeta[j] < 8.0)) return m->at[TS_NSH_ZETA] + j;
    return -1;
}

/* A node on no bar has no other mass.  The first point mass that is 0 on such a node, or -1. */
static int wrong_mass(const ts_sim *sim)
{
    const ts_model *m = &sim->m;
    for (int i = 0; m->lone_count && i < m->count[TS_P]; i++) {
        int block = m->node_block[m->massed[i]];
        if (block >= 0 && m->block_bar[block] < 0 && !(sim->values[m->at[TS_POINT_MASS] + i] > 0.0)) return m->at[TS_POINT_MASS] + i;
    }
    return -1;
}

/* Look through the fields before this one. */
static int check_fields(ts_sim *sim, int end, int32_t *index)
{
    const ts_model *m = &sim->m;
    for (int f = 0; f < end; f++)
        for (int i = m->at[f]; i < m->at[f + 1]; i++) {
            if (accept(sim, f, sim->values[i])) continue;
            *index = i;
            return TS_BAD_INPUT;
        }
    return TS_OK;
}

int ts_check(ts_sim *sim, int32_t *index)
{
    const ts_model *m = &sim->m;
    int method = sim->integers[m->int_at[TS_INT_METHOD]], status = check_fields(sim, TS_POSITION, index);
    if (status != TS_OK) return status;
    int beam = wrong_beam(sim);
    if (beam >= 0) {
        *index = beam;
        say(sim, "must lie between 2 and 8 (a metastable beam)");
        return TS_BAD_INPUT;
    }
    int mass = wrong_mass(sim);
    if (mass >= 0) {
        *index = mass;
        say(sim, "must be positive: the node is on no bar and has no other mass");
        return TS_BAD_INPUT;
    }
    if (method < 0 || method >= TS_METHOD_COUNT) {
        *index = m->n_real + m->int_at[TS_INT_METHOD];
        say(sim, "is not a method");
        return TS_BAD_INPUT;
    }
    return TS_OK;
}

/* Steps under error control see the formula of a piece go on smoothly past its ends.  A fixed step that is far too long would see a
 * polynomial of high degree explode there. */
static void set_reach(ts_sim *sim)
{
    double reach = ts_fixed_step(sim->memory.method) ? 1.0 : INFINITY;
    for (int i = 0; i < sim->m.count[TS_S]; i++) sim->curve[i].reach = reach;
}

static void set_pieces(ts_sim *sim)
{
    for (int i = 0; i < sim->m.count[TS_S]; i++) ts_place(sim, i, sim->piece[i]);
}

/* The start has free bars' midpoints in the place of their centres of mass. */
static void move_to_centres(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D];
    for (int i = 0; i < m->floating_count; i++)
        for (int d = 0; d < D; d++)
            for (int at = m->floating[i].block * D + d; at < 2 * m->nq; at += m->nq)
                sim->y[at] += (m->floating[i].lower - 0.5) * sim->y[at + D];
}

/* Eight sums that do not wait for each other. */
static int all_finite(const double *x, int n)
{
    double sum[8] = {0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0};
    int i = 0;
    for (; i + 8 <= n; i += 8)
        for (int l = 0; l < 8; l++) sum[l] += 0.0 * x[i + l];
    for (; i < n; i++) sum[0] += 0.0 * x[i];
    return ((sum[0] + sum[1]) + (sum[2] + sum[3])) + ((sum[4] + sum[5]) + (sum[6] + sum[7])) == 0.0;
}

/* Velocities may be finite whose energy is not. */
static int check_outputs(ts_sim *sim, const char *when)
{
    if (all_finite(sim->values + sim->n_applied, sim->m.n_real - sim->n_applied)) return TS_OK;
    snprintf(sim->message, sizeof sim->message, "a force, a velocity or an energy %s is not a finite number; lower the loads", when);
    return TS_NOT_FINITE;
}

/* The inputs and parameters of the last step in place of the present ones, which the caller may have changed since. */
static void swap_applied(ts_sim *sim)
{
    size_t reals = (size_t)sim->m.n_real, slopes = 2 * (size_t)sim->n_inputs;
    memcpy(sim->backup, sim->values, sizeof(double) * reals);
    memcpy(sim->backup + reals, sim->slopes, sizeof(double) * slopes);
    memcpy(sim->values, sim->applied, sizeof(double) * (size_t)sim->n_applied);
    memcpy(sim->slopes, sim->applied_slopes, sizeof(double) * slopes);
}

/* The present ones and the outputs again. */
static void swap_back(ts_sim *sim)
{
    size_t reals = (size_t)sim->m.n_real, slopes = 2 * (size_t)sim->n_inputs;
    memcpy(sim->values, sim->backup, sizeof(double) * reals);
    memcpy(sim->slopes, sim->backup + reals, sizeof(double) * slopes);
}

/* What a step derives from inputs and parameters. */
static void derive(ts_sim *sim)
{
    set_reach(sim);
    ts_prepare(sim);
    set_pieces(sim);
}

/* The curves of the run under way, after new ones could not be built. */
static void keep_curves(ts_sim *sim)
{
    if (!sim->memory.started) return;
    swap_applied(sim);
    if (ts_curves_build(sim)) sim->memory.started = 0;
    else derive(sim);
    swap_back(sim);
}

int ts_initialize(ts_sim *sim, double time)
{
    const ts_model *m = &sim->m;
    int32_t index;
    int status = ts_check(sim, &index);
    if (status != TS_OK) return status;
    if (!isfinite(time)) {
        say(sim, "the start time is not a finite number");
        return TS_BAD_STEP;
    }
    status = build_curves(sim);
    if (status != TS_OK) {
        keep_curves(sim);
        return status;
    }
    int method = sim->integers[m->int_at[TS_INT_METHOD]];
    memset(&sim->memory, 0, sizeof sim->memory);
    sim->memory.time = time;
    sim->memory.active = method == TS_METHOD_AUTO ? TS_METHOD_DOP853 : method;
    ts_start_choice(sim);
    sim->memory.method = method;
    sim->memory.started = 1;
    set_reach(sim);
    sim->transition_count = 0;
    memcpy(sim->y, m->y_start, sizeof(double) * (size_t)m->ny);
    memcpy(sim->applied, sim->values, sizeof(double) * (size_t)sim->n_applied);
    memcpy(sim->applied_slopes, sim->slopes, 2 * sizeof(double) * (size_t)sim->n_inputs);
    ts_prepare(sim);
    move_to_centres(sim);
    ts_project(sim, sim->y);
    ts_jump_bases(sim, NULL, NULL, 0.0);
    /* strings with memory come from slack; what that dissipated was before the start */
    memset(sim->piece, 0, sizeof(int32_t) * (size_t)m->count[TS_S]);
    ts_place_all(sim);
    sim->transition_count = sim->memory.stats[TS_TRANSITIONS] = 0;
    ts_rhs(sim, 0.0, sim->y, sim->f0);
    for (int i = sim->n_applied; i < m->n_real; i++) sim->values[i] = NAN; /* an output that nothing fills is found below */
    ts_outputs(sim, 0.0);
    status = check_outputs(sim, "at the start");
    if (!all_finite(sim->f0, 2 * m->nq)) {
        say(sim, "the accelerations at the start are not finite numbers");
        status = TS_NOT_FINITE;
    }
    if (status != TS_OK) sim->memory.started = 0;
    return status;
}

/* Everything that a step changes, but the outputs. */
static void backup(ts_sim *sim, ts_memory *memory)
{
    size_t S = (size_t)sim->m.count[TS_S];
    *memory = sim->memory;
    memcpy(sim->backup, sim->y, sizeof(double) * (size_t)sim->m.ny);
    memcpy(sim->backup_ints, sim->piece, sizeof(int32_t) * S);
    memcpy(sim->backup_ints + S, sim->clipped, sizeof(int32_t) * S);
    if (memory->span.h > 0.0) memcpy(sim->ahead_backup, sim->ahead, sizeof(double) * sim->ahead_size);
}

static void undo(ts_sim *sim, const ts_memory *memory)
{
    size_t S = (size_t)sim->m.count[TS_S];
    sim->memory = *memory;
    sim->transition_count = 0;
    memcpy(sim->y, sim->backup, sizeof(double) * (size_t)sim->m.ny);
    memcpy(sim->piece, sim->backup_ints, sizeof(int32_t) * S);
    memcpy(sim->clipped, sim->backup_ints + S, sizeof(int32_t) * S);
    if (memory->span.h > 0.0) memcpy(sim->ahead, sim->ahead_backup, sizeof(double) * sim->ahead_size);
    swap_applied(sim);
    derive(sim);
    swap_back(sim);
}

/* Smallest rest length of a string within the step, m: at an end, or where its rate, a quadratic, is zero. */
static double shortest_rest_length(const ts_sim *sim, int i, double h)
{
    double r = sim->rest_rate[i], b = sim->rest_bend[i], j = sim->rest_jerk[i];
    double least = fmin(sim->rest[i], ts_rest_length(sim, i, h));
    double root = b * b - 2.0 * j * r, q = -(b + (b < 0.0 ? -1.0 : 1.0) * sqrt(root)); /* no number where there is no root */
    double turn[2] = {q / j, 2.0 * r / q};
    for (int k = 0; k < 2; k++)
        if (turn[k] > 0.0 && turn[k] < h) least = fmin(least, ts_rest_length(sim, i, turn[k]));
    return least;
}

/* Inputs and parameters that differ from those of the last step: are they acceptable? */
static int check_change(ts_sim *sim, double h)
{
    const ts_model *m = &sim->m;
    int32_t index;
    int status = check_fields(sim, TS_BAR_MASS, &index); /* those behind it must not change */
    if (status != TS_OK) return status;
    int same = sim->integers[m->int_at[TS_INT_METHOD]] == sim->memory.method;
    for (int i = 0; i < 2 * sim->n_inputs; i++)
        if (!isfinite(sim->slopes[i])) {
            say(sim, "the derivative of an input is not a finite number");
            return TS_BAD_INPUT;
        }
    for (int i = m->at[TS_BAR_MASS]; i < sim->n_applied; i++) same = same && sim->values[i] == sim->applied[i];
    if (!same) {
        say(sim, "a fixed parameter was changed after initialization");
        return TS_BAD_INPUT;
    }
    for (int i = 0; m->curved_count && i < m->count[TS_S]; i++)
        if (sim->curve[i].branches && sim->values[m->at[TS_STIFFNESS] + i] != sim->applied[m->at[TS_STIFFNESS] + i]) {
            say(sim, "the stiffness of a string with memory (the hysteretic law) was changed after initialization");
            return TS_BAD_INPUT;
        }
    for (int i = 0; i < m->count[TS_S]; i++)
        if (sim->rest_moves && shortest_rest_length(sim, i, h) < -4.0 * DBL_EPSILON * sim->rest[i]) {
            say(sim, "a rest length would become negative within the step");
            return TS_BAD_INPUT;
        }
    return TS_OK;
}

/* Do inputs move on that say where something is at the step's start? */
static int inputs_move(const ts_sim *sim)
{
    const double *rate = sim->applied + sim->m.at[TS_REST_LENGTH_RATE];
    for (int i = 0; i < sim->m.count[TS_S]; i++)
        if (rate[i] != 0.0) return 1;
    return ts_inputs_move(sim);
}

static int wound_up(ts_sim *sim)
{
    if (!ts_wound_up(sim)) return TS_OK;
    say(sim, "an actuator has wound its string up completely: lower its current, or give the string more rest length");
    return TS_WOUND_UP;
}

/* Take over new inputs: pieces anew; the jump of the stored energy and what snaps dissipate go into the input work. */
static void take_inputs(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    double before = sim->values[m->at[TS_POTENTIAL]] + sim->values[m->at[TS_ELASTIC]], moved = 0.0;
    if (m->count[TS_E]) {
        ts_jump_bases(sim, sim->applied, sim->applied_slopes, sim->memory.last_step);
        moved = ts_kinetic_energy(sim) - sim->values[m->at[TS_KINETIC]];
    }
    double lost = ts_place_all(sim);
    sim->y[2 * m->nq] += lost;
    sim->y[2 * m->nq + 1] += ts_stored_energy(sim, 0.0) - before + moved + lost;
    sim->y[2 * m->nq + 2] += lost;
    ts_close_span(sim);
}

static void add_time(ts_memory *memory, double h)
{
    double step = h + memory->time_low, sum = memory->time + step;
    memory->time_low = fabs(memory->time) >= fabs(step) ? (memory->time - sum) + step : (step - sum) + memory->time;
    memory->time = sum;
}

/* The end of a call: time and outputs. */
static int settle(ts_sim *sim, double h, int sloped)
{
    add_time(&sim->memory, h);
    sim->memory.last_step = h;
    sim->memory.sloped = sloped;
    ts_rhs(sim, h, sim->y, sim->f0);
    ts_outputs(sim, h);
    return check_outputs(sim, "at the end of the step");
}

/* The outputs at the end of the last step once more, from the state there. */
static void recall_outputs(ts_sim *sim)
{
    ts_memory memory = sim->memory;
    swap_applied(sim);
    derive(sim);
    ts_rhs(sim, memory.last_step, sim->y, sim->f0);
    ts_outputs(sim, memory.last_step);
    memcpy(sim->values, sim->backup, sizeof(double) * (size_t)sim->n_applied);
    memcpy(sim->slopes, sim->backup + sim->m.n_real, 2 * sizeof(double) * (size_t)sim->n_inputs);
    sim->memory = memory; /* work is counted once */
}

/* A whole call within the step that the last one left open.  Only the state at its end and the time change. */
static int step_within(ts_sim *sim, double h)
{
    const ts_memory memory = sim->memory;
    sim->transition_count = 0;
    sim->dense_ready = 1; /* since the step was opened */
    ts_serve_span(sim, h);
    int status = wound_up(sim), told = status == TS_OK;
    if (told) status = settle(sim, h, 0);
    if (status == TS_OK) return TS_OK;
    sim->memory = memory;
    ts_recall(sim);
    sim->memory = memory;
    if (told) recall_outputs(sim);
    return status;
}

int ts_step(ts_sim *sim, double h)
{
    size_t bytes = sizeof(double) * (size_t)sim->n_applied;
    ts_memory memory;
    int status = TS_OK;
    if (!sim->memory.started || !(h > 0.0) || !isfinite(h)) {
        say(sim, sim->memory.started ? "the step must be positive and finite" : "initialize first");
        return TS_BAD_STEP;
    }
    int sloped = ts_sloped(sim);
    int changed = sloped || sim->memory.sloped || memcmp(sim->values, sim->applied, bytes) || inputs_move(sim) ||
                  sim->integers[sim->m.int_at[TS_INT_METHOD]] != sim->memory.method;
    if (!changed && ts_span_serves(sim, h)) return step_within(sim, h);
    backup(sim, &memory);
    ts_prepare(sim);
    if (changed) status = check_change(sim, h);
    if (status == TS_OK) {
        sim->transition_count = 0;
        if (changed) take_inputs(sim);
        else set_pieces(sim);
        status = ts_integrate(sim, h, !changed);
    }
    if (status == TS_OK) status = wound_up(sim);
    int told = status == TS_OK;
    if (told) status = settle(sim, h, sloped);
    if (status != TS_OK) {
        undo(sim, &memory);
        if (told) recall_outputs(sim);
        return status;
    }
    memcpy(sim->applied, sim->values, bytes);
    memcpy(sim->applied_slopes, sim->slopes, 2 * sizeof(double) * (size_t)sim->n_inputs);
    return TS_OK;
}

/* A saved state: header, memory, values, slopes and both as applied, y, integers, pieces, clipping, hash. */
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
        {&sim->memory, sizeof sim->memory}, {sim->values, sizeof(double) * (size_t)m->n_real},
        {sim->slopes, 2 * sizeof(double) * (size_t)sim->n_inputs},
        {sim->applied_slopes, 2 * sizeof(double) * (size_t)sim->n_inputs},
        {sim->applied, sizeof(double) * (size_t)sim->n_applied}, {sim->y, sizeof(double) * (size_t)m->ny},
        {sim->integers, sizeof(int32_t) * (size_t)m->n_int}, {sim->piece, S}, {sim->clipped, S},
        {sim->ahead, sizeof(double) * sim->ahead_size},
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
    state_header header = {STATE_MAGIC, sim->m.hash};
    if (size != ts_state_size(sim)) return TS_BAD_STATE;
    memcpy(bytes, &header, sizeof header);
    size_t parts = copy_state((ts_sim *)sim, (char *)bytes + sizeof header, OUT), ahead = sizeof(double) * sim->ahead_size;
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
    const double reals[] = {memory->time, memory->time_low, memory->h_next, memory->joined, memory->err_last, memory->last_step,
                            span->start, span->h, span->reach, span->clipped};
    const int32_t counters[] = {memory->rejected, memory->stiff, memory->patience, c->losing, c->phase_steps, c->steps};
    int sound = all_finite(reals, sizeof reals / sizeof *reals);
    sound = sound && all_finite(&c->work, (int)(offsetof(ts_choice, h_lambda) / sizeof(double)));
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
    const int S = sim->m.count[TS_S], method = sim->integers[sim->m.int_at[TS_INT_METHOD]];
    int possible = memory->method >= 0 && memory->method < TS_METHOD_COUNT && memory->active > 0 && memory->active < TS_METHOD_COUNT;
    possible = possible && method >= 0 && method < TS_METHOD_COUNT && memory->span.which < 2 * S && ts_choice_is_possible(sim);
    possible = possible && memory->span.method >= 0 && memory->span.method < TS_METHOD_COUNT;
    possible = possible && (memory->span.h > 0.0 ? memory->span.method > 0 && is_open(&memory->span) : memory->span.h == 0.0);
    for (int i = 0; i < S; i++) possible = possible && sim->piece[i] >= 0 && sim->piece[i] < sim->curve[i].pieces;
    return possible;
}

int ts_restore(ts_sim *sim, const void *bytes, size_t size)
{
    state_header header;
    uint64_t hash = 0;
    if (size == ts_state_size(sim)) {
        memcpy(&header, bytes, sizeof header);
        memcpy(&hash, (const char *)bytes + size - sizeof hash, sizeof hash);
    }
    if (size != ts_state_size(sim) || header.magic != STATE_MAGIC || header.model != sim->m.hash ||
        hash != ts_fnv(bytes, size - sizeof hash)) {
        say(sim, "the saved state is damaged, of another version or of another model");
        return TS_BAD_STATE;
    }
    copy_state(sim, (char *)bytes + sizeof header, IN);
    sim->transition_count = 0;
    int possible = sim->memory.started || sim->memory.span.h == 0.0;
    if (possible && !sim->memory.started) return TS_OK;
    int32_t index;
    swap_applied(sim);
    possible = possible && is_sound(&sim->memory) && all_finite(sim->y, sim->m.ny);
    possible = possible && ts_check(sim, &index) == TS_OK && build_curves(sim) == TS_OK && is_possible(sim);
    if (possible) derive(sim);
    possible = possible && all_finite(sim->values + sim->n_applied, sim->m.n_real - sim->n_applied);
    swap_back(sim);
    if (possible) return TS_OK;
    ts_reset(sim);
    say(sim, "the saved state is none that a simulation comes to; the simulation has been reset");
    return TS_BAD_STATE;
}

int ts_output_derivatives(ts_sim *sim, double *out)
{
    if (!sim->memory.started) {
        say(sim, "initialize first");
        return TS_BAD_STEP;
    }
    ts_memory memory = sim->memory;
    swap_applied(sim);
    derive(sim);
    ts_tangent_outputs(sim, sim->memory.last_step, out);
    swap_back(sim);
    sim->memory = memory; /* looking changes nothing, not even the count of right-hand sides */
    if (all_finite(out, sim->m.n_real - sim->n_applied)) return TS_OK;
    say(sim, "a derivative of an output is not a finite number");
    return TS_NOT_FINITE;
}

size_t ts_memory_size(const ts_sim *sim) { return sizeof *sim + sim->bytes; }
void ts_locate(ts_sim *sim, int on) { sim->unlocated = !on; }
int32_t ts_state_length(const ts_sim *sim) { return sim->m.ny; }
void ts_get_state(const ts_sim *sim, double *y) { memcpy(y, sim->y, sizeof(double) * (size_t)sim->m.ny); }

/* Analysis takes inputs and parameters as they stand. */
static void take_values(ts_sim *sim)
{
    ts_prepare(sim);
    for (int i = 0; i < sim->m.count[TS_S]; i++) ts_bear(sim, i);
}

void ts_derivative(ts_sim *sim, double tau, const double *y, double *dy)
{
    take_values(sim);
    ts_rhs(sim, tau, y, dy);
}

void ts_jacobian(ts_sim *sim, double tau, const double *y, double *Jq, double *Jv, double *ft)
{
    const ts_pattern *p = &sim->pattern;
    size_t nq = (size_t)sim->m.nq, D = (size_t)sim->m.count[TS_D];
    take_values(sim);
    ts_rhs_jacobian(sim, tau, y);
    sim->jacobian_ready = 0;
    memset(Jq, 0, sizeof(double) * nq * nq);
    memset(Jv, 0, sizeof(double) * nq * nq);
    for (size_t i = 0; i < (size_t)p->n; i++)
        for (size_t n = (size_t)p->row[i]; n < (size_t)p->row[i + 1]; n++)
            for (size_t r = 0; r < D; r++)
                for (size_t c = 0; c < D; c++) {
                    size_t at = (i * D + r) * nq + (size_t)p->column[n] * D + c;
                    Jq[at] = sim->Jq[(n * D + r) * D + c];
                    Jv[at] = sim->Jv[(n * D + r) * D + c];
                }
    memcpy(ft, sim->ft, sizeof(double) * nq);
}

int ts_string_law(const ts_sim *sim, int32_t string, double elongation, double out[3])
{
    if (!sim->curves_ready) return -1;
    return ts_piece_law(sim, string, ts_curve_piece(sim->curve + string, elongation), elongation, out);
}

int ts_piece_law(const ts_sim *sim, int32_t string, int32_t piece, double elongation, double out[3])
{
    if (!sim->curves_ready || piece < 0 || piece >= sim->curve[string].pieces) return -1;
    const ts_curve *c = sim->curve + string;
    double k = sim->values[sim->m.at[TS_STIFFNESS] + string];
    out[0] = ts_curve_force(c, piece, elongation, k, out + 1);
    out[2] = ts_curve_energy(c, piece, elongation, k);
    return piece;
}

int ts_breakpoints(const ts_sim *sim, int32_t string, double *out, int32_t capacity)
{
    if (!sim->curves_ready) return -1;
    const ts_curve *c = sim->curve + string;
    int count = 0;
    for (int p = 0; p >= 0 && c->piece[p].hi < INFINITY && count <= c->pieces; p = c->piece[p].up, count++)
        if (count < capacity) out[count] = c->piece[p].hi;
    return count;
}

int ts_curve_pieces(const ts_sim *sim, int32_t string, ts_curve_piece_info *out, int32_t capacity)
{
    if (!sim->curves_ready) return -1;
    const ts_curve *c = sim->curve + string;
    for (int i = 0; i < c->pieces && i < capacity; i++) {
        const ts_piece *p = c->piece + i;
        out[i] = MAKE(ts_curve_piece_info){p->lo, p->hi, p->loss_up, p->loss_down, p->up, p->down, p->snapped, p->kind == TS_SLACK};
    }
    return c->pieces;
}

