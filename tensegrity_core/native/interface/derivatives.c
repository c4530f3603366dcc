/* First derivatives for a host: how states' derivatives, outputs and event indicators change with states, inputs and parameters, as
 * products of their Jacobian or of its transpose with a vector. */
#include "interface/continuous.h"
#include "interface/message.h"
#include "laws/curves.h"
#include "linear/chain.h"
#include "model/data.h"
#include "motion/differentials.h"
#include "motion/motion.h"
#include "motion/output_differentials.h"
#include "motion/outputs.h"
#include "tensegrity.h"

#include <string.h>

/* What the caller's memory holds, before the numbers, the weights and the indices of the chain. */
typedef struct {
    ts_differentials d;
    double *z; /* (d.at.size) */
    int32_t ready;
} workspace;

static void write_rows(ts_differentials *d, int weights)
{
    ts_chain_begin(&d->chain, weights);
    ts_differentiate_motion(d);
    ts_differentiate_outputs(d);
    ts_chain_end(&d->chain);
}

/* Of the larger of the two, that of the start: its places, and how many rows and terms it has. */
static ts_differentials largest(const ts_sim *sim)
{
    ts_differentials d;
    memset(&d, 0, sizeof d);
    d.sim = sim;
    d.Q = sim->linear.work;
    d.start = 1;
    ts_place_differentials(&d);
    write_rows(&d, 0);
    return d;
}

static size_t bytes_of(const ts_differentials *d)
{
    const size_t rows = (size_t)d->chain.rows, terms = (size_t)d->chain.terms;
    return sizeof(workspace) + sizeof(double) * ((size_t)d->at.size + terms) + sizeof(int32_t) * (terms + 2 * rows + 1);
}

int32_t ts_known_count(const ts_sim *sim) { return ts_continuous_count(sim) + sim->m.n_applied; }

int32_t ts_unknown_count(const ts_sim *sim)
{
    return 2 * ts_continuous_count(sim) + sim->m.n_real - sim->m.n_applied + ts_indicator_count(sim);
}

size_t ts_derivatives_size(const ts_sim *sim)
{
    if (sim->m.joint.nodes) return sizeof(workspace);
    const ts_differentials d = largest(sim);
    return bytes_of(&d);
}

/* What rows are written for, or nothing changes.  A field that is new is not differentiated, nor by it, until it has its own. */
static const int32_t with_rows[] = {
    TS_FORCE,
    TS_REST_LENGTH,
    TS_REST_LENGTH_RATE,
    TS_CURRENT,
    TS_DRUM_LOAD,
    TS_NODE_POSITION,
    TS_NODE_VELOCITY,
    TS_NODE_ACCELERATION,
    TS_STIFFNESS,
    TS_DAMPING,
    TS_GRAVITY,
    TS_DRAG,
    TS_BAR_MASS,
    TS_POINT_MASS,
    TS_STRING_MASS,
    TS_MOTOR_INERTIA,
    TS_MOTOR_DAMPING,
    TS_TORQUE_CONSTANT,
    TS_DRUM_RADIUS,
    TS_TOLERANCE,
    TS_MAX_STEP,
    TS_POSITION,
    TS_VELOCITY,
    TS_STRING_FORCE,
    TS_ELASTIC_FORCE,
    TS_STRING_LENGTH,
    TS_WOUND_REST_LENGTH,
    TS_WOUND_REST_LENGTH_RATE,
    TS_MOTOR_SPEED,
    TS_BAR_FORCE,
    TS_REACTION,
    TS_KINETIC,
    TS_POTENTIAL,
    TS_ELASTIC,
    TS_DISSIPATED,
    TS_INPUT_WORK,
    TS_THROUGHPUT,
    TS_BENDING_STIFFNESS,
    TS_STRENGTH,
    TS_BAR_UTILISATION,
    TS_STRING_UTILISATION,
};

static int has_rows(const ts_model *m, int32_t i)
{
    for (size_t k = 0; k < sizeof with_rows / sizeof *with_rows; k++) {
        const int32_t next = with_rows[k] + 1, end = next < TS_FIELD_COUNT ? m->at[next] : m->n_real;
        if (i >= m->at[with_rows[k]] && i < end) return 1;
    }
    return 0;
}

int ts_differentiable(const ts_sim *sim, int32_t known)
{
    const ts_model *m = &sim->m;
    const int32_t i = known - ts_continuous_count(sim), stiffness = m->at[TS_STIFFNESS];
    if (i < 0) return 1;
    if (i >= stiffness && i < m->at[TS_STIFFNESS + 1]) return !ts_has_memory(m, i - stiffness);
    for (int s = 0; s < m->count[TS_S]; s++) /* beams in series without memory have rows, at the start */
        for (int field = TS_NSH_Q; field <= TS_NSH_H; field++) {
            const int32_t first = m->at[field] + m->string.beam_first[s];
            if (i >= first && i < first + m->packed.beams[s]) return m->packed.beam_law[s] == 0;
        }
    return has_rows(m, i);
}

int ts_differentiated(const ts_sim *sim, int32_t unknown)
{
    const int32_t i = unknown - 2 * ts_continuous_count(sim), outputs = sim->m.n_real - sim->m.n_applied;
    return i < 0 || i >= outputs || has_rows(&sim->m, i + sim->m.n_applied);
}

/* The state is as ts_initialize() has just left it. */
static int look_at_start(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    const size_t applied = sizeof(double) * (size_t)m->n_applied, slopes = 2 * sizeof(double) * (size_t)m->n_inputs;
    if (!sim->memory.started || memcmp(sim->io.values, sim->io.applied, applied) ||
        memcmp(sim->io.slopes, sim->io.applied_slopes, slopes))
        return ts_say(sim, TS_BAD_STEP, "initialize first, with the present inputs and parameters");
    const ts_memory memory = sim->memory;
    ts_rhs(sim, 0.0, sim->state.y, sim->start.f);
    sim->memory = memory; /* looking is not counted */
    return TS_OK;
}

int ts_share_derivatives(ts_sim *sim, void *work, size_t size)
{
    workspace *w = (workspace *)work;
    if (sim->m.joint.nodes && work && size >= sizeof *w) {
        w->ready = 0;
        return TS_OK;
    }
    const ts_differentials most = largest(sim);
    if (!work || size < bytes_of(&most)) return ts_say(sim, TS_BAD_STEP, "the memory is too small for derivatives");
    w->d = most;
    w->ready = 0;
    w->z = (double *)(void *)(w + 1);
    w->d.chain.weight = w->z + most.at.size;
    w->d.chain.from = (int32_t *)(void *)(w->d.chain.weight + most.chain.terms);
    w->d.chain.to = w->d.chain.from + most.chain.terms;
    w->d.chain.first = w->d.chain.to + most.chain.rows;
    write_rows(&w->d, 0);
    return TS_OK;
}

int ts_differentiate(ts_sim *sim, int start, void *work)
{
    workspace *w = (workspace *)work;
    w->ready = 0;
    if (sim->m.count[TS_K]) return ts_say(sim, TS_BAD_STEP, "derivatives of what touches the ground are not known yet");
    if (sim->m.joint.nodes)
        return ts_say(sim, TS_BAD_STEP, "bars are joined, whose derivatives are not known in this form; take differences");
    if (w->d.start != (start != 0)) {
        w->d.start = start != 0;
        write_rows(&w->d, 0);
    }
    int status = start ? look_at_start(sim) : ts_continuous_derivatives(sim, w->z);
    if (status != TS_OK) return status;
    ts_forces(sim, 0.0, sim->state.y, sim->linear.work);
    ts_outputs(sim, 0.0, TS_OF_ALL);
    write_rows(&w->d, 1);
    if (!ts_all_finite(w->d.chain.weight, w->d.chain.terms))
        return ts_say(sim, TS_NOT_FINITE, "a derivative is not a finite number; lower the loads");
    w->ready = 1;
    return TS_OK;
}

/* Numbers of the chain for a product: 0, but those that are given. */
static double *cleared(workspace *w)
{
    memset(w->z, 0, sizeof(double) * (size_t)w->d.at.size);
    return w->z;
}

static int require_finite(ts_sim *sim, const double *x, int32_t count)
{
    if (ts_all_finite(x, count)) return TS_OK;
    return ts_say(sim, TS_NOT_FINITE, "a product with the derivatives is not a finite number");
}

int ts_directional(ts_sim *sim, void *work, const double *known, double *unknown)
{
    workspace *w = (workspace *)work;
    const ts_model *m = &sim->m;
    const int32_t states = ts_continuous_count(sim), outputs = m->n_real - m->n_applied;
    if (!w->ready) return ts_say(sim, TS_BAD_STEP, "differentiate first");
    double *z = cleared(w);
    ts_put_states(m, known, z + w->d.at.y);
    memcpy(z + w->d.at.values, known + states, sizeof(double) * (size_t)m->n_applied);
    ts_chain_forward(&w->d.chain, z);
    ts_pick_states(m, z + w->d.at.y, unknown);
    ts_pick_states(m, z + w->d.at.dy, unknown + states);
    memcpy(unknown + 2 * states, z + w->d.at.outputs, sizeof(double) * (size_t)outputs);
    memcpy(unknown + 2 * states + outputs, z + w->d.at.indicators, sizeof(double) * (size_t)ts_indicator_count(sim));
    return require_finite(sim, unknown, ts_unknown_count(sim));
}

int ts_adjoint(ts_sim *sim, void *work, const double *unknown, double *known)
{
    workspace *w = (workspace *)work;
    const ts_model *m = &sim->m;
    const int32_t states = ts_continuous_count(sim), outputs = m->n_real - m->n_applied;
    if (!w->ready) return ts_say(sim, TS_BAD_STEP, "differentiate first");
    double *z = cleared(w);
    ts_put_states(m, unknown, z + w->d.at.y);
    ts_put_states(m, unknown + states, z + w->d.at.dy);
    memcpy(z + w->d.at.outputs, unknown + 2 * states, sizeof(double) * (size_t)outputs);
    memcpy(z + w->d.at.indicators, unknown + 2 * states + outputs, sizeof(double) * (size_t)ts_indicator_count(sim));
    ts_chain_backward(&w->d.chain, z);
    ts_pick_states(m, z + w->d.at.y, known);
    memcpy(known + states, z + w->d.at.values, sizeof(double) * (size_t)m->n_applied);
    return require_finite(sim, known, ts_known_count(sim));
}
