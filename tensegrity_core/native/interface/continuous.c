/* The continuous-time view of a simulation, for a host that integrates it with a solver of its own.
 *
 * Continuous states: x = [q, q', dissipated, input work], the coordinates block by block without the padding of the actuators'
 * blocks.  The scale of the ledger is none of them: its rate has a kink wherever a power changes its sign, and a host's solver
 * would look for each.  Pieces of force curves and clipped strings are discrete states.  Inputs are those of the present
 * instant: a host that moves a rest length or a node gives its place and its rates then. */
#include "interface/continuous.h"
#include "interface/applied.h"
#include "interface/checks.h"
#include "interface/message.h"
#include "interface/ready.h"
#include "model/data.h"
#include "motion/drives.h"
#include "motion/joints.h"
#include "motion/motion.h"
#include "motion/outputs.h"
#include "motion/pieces.h"
#include "steps/events.h"
#include "steps/integrate.h"
#include "tensegrity.h"

#include <math.h>
#include <string.h>

#define ROUND_OFF_DRIFT 1e-13 /* of bar lengths, relative: not worth a correction */
#define DRIFT 3e-10           /* that a host's steps may leave behind */
#define DRIFT_OF_STEP 1e-8    /* of one step: a solver that makes more asks for less, and gets some steps between restarts: */
#define STEPS 32
#define BOOKED 2   /* integrals among the states */
#define AHEAD 0.03 /* s: a rate counts as what it makes of a length in that time */
#define EARTH 9.81 /* m/s2, for typical values only */

/* Coordinates of q that are none of an actuator's. */
static int plain_count(const ts_model *m) { return m->nq - m->count[TS_A] * m->count[TS_D]; }

int32_t ts_continuous_count(const ts_sim *sim)
{
    const ts_model *m = &sim->m;
    return 2 * (plain_count(m) + m->count[TS_A]) + BOOKED;
}

int32_t ts_integral_first(const ts_sim *sim) { return sim->m.at[TS_DISSIPATED]; }

/* The continuous states x out of what is laid out as the state y. */
void ts_pick_states(const ts_model *m, const double *y, double *x)
{
    int plain = plain_count(m), D = m->count[TS_D];
    for (int half = 0; half < 2; half++, y += m->nq) {
        memcpy(x, y, sizeof(double) * (size_t)plain);
        x += plain;
        for (int a = 0; a < m->count[TS_A]; a++) *x++ = y[plain + a * D];
    }
    memcpy(x, y, BOOKED * sizeof(double));
}

/* And back. */
void ts_put_states(const ts_model *m, const double *x, double *y)
{
    int plain = plain_count(m), D = m->count[TS_D];
    for (int half = 0; half < 2; half++, y += m->nq) {
        memcpy(y, x, sizeof(double) * (size_t)plain);
        x += plain;
        for (int a = 0; a < m->count[TS_A]; a++) y[plain + a * D] = *x++;
    }
    memcpy(y, x, BOOKED * sizeof(double));
}

/* A typical length: of the largest of the structure's extents, its bars included (m). */
static double extent(const ts_model *m)
{
    double most = 0.0;
    for (int i = 0; i < m->count[TS_N] * m->count[TS_D]; i++) most = fmax(most, fabs(m->packed.node[i]));
    for (int i = 0; i < m->count[TS_B]; i++) most = fmax(most, m->bar.length[i]);
    return most > 0.0 ? most : 1.0;
}

/* A typical speed of the strings' oscillations: of one about the sag that a body's weight gives the stiffest string (m/s).  No
 * faster than a fall over the extent, and no slower than a hundredth of it, below which round-off would count. */
static double typical_speed(const ts_model *m, double mass, double length)
{
    double fall = sqrt(EARTH * length), stiffest = 0.0;
    const double *k = m->packed.start + m->at[TS_STIFFNESS];
    for (int i = 0; i < m->count[TS_S]; i++) stiffest = fmax(stiffest, k[i]);
    if (!(stiffest > 0.0)) return fall;
    return fmin(fall, fmax(0.01 * fall, EARTH * sqrt(mass / (m->count[TS_B] + m->node.massed_count) / stiffest)));
}

/* The extent, a speed, and the weight of all masses on Earth times the extent.  Hosts take them for the scale of errors: what an
 * error of a speed does to a damper when its string goes slack is an impulse, so the speed is that of strings and not of falls. */
void ts_continuous_nominals(const ts_sim *sim, double *x)
{
    const ts_model *m = &sim->m;
    const double length = extent(m);
    int half = (ts_continuous_count(sim) - BOOKED) / 2;
    double mass = 0.0;
    for (int i = m->at[TS_BAR_MASS]; i < m->at[TS_BAR_MASS] + m->count[TS_B]; i++) mass += m->packed.start[i];
    for (int i = m->at[TS_POINT_MASS]; i < m->at[TS_POINT_MASS] + m->count[TS_P]; i++) mass += m->packed.start[i];
    for (int i = m->at[TS_STRING_MASS]; i < m->at[TS_STRING_MASS] + m->count[TS_M]; i++) mass += m->packed.start[i];
    const double speed = typical_speed(m, mass, length);
    for (int i = 0; i < 2 * half; i++) x[i] = i < half ? length : speed;
    for (int i = 0; i < BOOKED; i++) x[2 * half + i] = mass * EARTH * length;
}

int ts_continuous_states(const ts_sim *sim, double *x)
{
    if (!sim->memory.started) return TS_BAD_STEP;
    ts_bring_state((ts_sim *)sim);
    ts_pick_states(&sim->m, sim->state.y, x);
    return TS_OK;
}

int ts_set_continuous_states(ts_sim *sim, const double *x)
{
    if (ts_ready(sim) != TS_OK) return TS_BAD_STEP;
    ts_fill(sim, TS_OF_ALL); /* what the last step left out belongs to its end */
    if (!ts_all_finite(x, ts_continuous_count(sim))) return ts_say(sim, TS_BAD_INPUT, "a state is not a finite number");
    ts_put_states(&sim->m, x, sim->state.y);
    return TS_OK;
}

int ts_set_time(ts_sim *sim, double time)
{
    if (ts_ready(sim) != TS_OK) return TS_BAD_STEP;
    ts_fill(sim, TS_OF_ALL); /* what the last step left out belongs to its end */
    if (!isfinite(time)) return ts_say(sim, TS_BAD_STEP, "the time is not a finite number");
    sim->memory.time = time;
    sim->memory.time_low = sim->memory.last_step = 0.0;
    return TS_OK;
}

/* How far a string goes past an end before it counts: more than the round-off of a host's time, m. */
static double guard(const ts_model *m) { return 2e-12 * extent(m); }

/* What follows from the present inputs.  A host's solver may try states far off, where a polynomial past its piece's end explodes:
 * not far past them the formulas go straight on, as under fixed steps. */
static void take_inputs(ts_sim *sim)
{
    ts_prepare(sim);
    for (int i = 0; i < sim->m.count[TS_S]; i++) {
        sim->laws.curve[i].reach = 1.0;
        ts_bear(sim, i); /* a stiffness or a damping coefficient may have been set in an event */
    }
}

/* Right-hand side at the present time, states and inputs, into start.f. */
static int evaluate(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    if (ts_ready(sim) != TS_OK) return TS_BAD_STEP;
    if (m->count[TS_K]) return ts_say(sim, TS_BAD_STEP, "a host's own solver does not know the ground yet");
    take_inputs(sim);
    ts_rhs(sim, 0.0, sim->state.y, sim->start.f);
    if (ts_wound_up(sim)) return ts_say(sim, TS_WOUND_UP, "an actuator has wound its string up completely");
    if (ts_all_finite(sim->start.f, 2 * m->nq + TS_LEDGER)) return TS_OK;
    return ts_say(sim, TS_NOT_FINITE, "an acceleration is not a finite number; lower the loads");
}

/* What steps take from differences and not from integrals: the power of external forces that stay over a step, and what the
 * dampers of clipped strings take of their springs. */
static void add_powers(const ts_sim *sim, double *ledger)
{
    const ts_model *m = &sim->m;
    for (int i = 0; i < m->nq && !sim->loads.move; i++) ledger[1] += sim->loads.Q[i] * sim->state.y[m->nq + i];
    for (int i = 0; m->damping_law == TS_TENSION_ONLY && i < m->count[TS_S]; i++) {
        double fs, rate = sim->strings.rate[i];
        if (!sim->state.clipped[i]) continue;
        ts_tension(sim, i, sim->strings.elongation[i], rate, &fs);
        ledger[0] -= fs * rate;
    }
}

int ts_continuous_derivatives(ts_sim *sim, double *dx)
{
    int status = evaluate(sim);
    if (status != TS_OK) return status;
    ts_pick_states(&sim->m, sim->start.f, dx);
    add_powers(sim, dx + ts_continuous_count(sim) - BOOKED);
    return TS_OK;
}

/* As ts_output_derivatives() looks at the end of a step: under the inputs that it had. */
int ts_step_derivatives(ts_sim *sim, double *dx)
{
    if (ts_ready(sim) != TS_OK) return TS_BAD_STEP;
    ts_memory memory = sim->memory;
    ts_swap_applied(sim);
    ts_derive(sim);
    ts_rhs(sim, memory.last_step, sim->state.y, sim->start.f);
    ts_pick_states(&sim->m, sim->start.f, dx);
    add_powers(sim, dx + ts_continuous_count(sim) - BOOKED);
    ts_swap_back(sim);
    sim->memory = memory;
    if (ts_all_finite(dx, ts_continuous_count(sim))) return TS_OK;
    return ts_say(sim, TS_NOT_FINITE, "an acceleration is not a finite number");
}

int ts_continuous_outputs(ts_sim *sim)
{
    int status = evaluate(sim);
    if (status != TS_OK) return status;
    ts_outputs(sim, 0.0, TS_OF_ALL);
    sim->demand.stale = 0;
    return ts_check_outputs(sim, TS_OF_ALL, "now");
}

int32_t ts_indicator_count(const ts_sim *sim) { return sim->m.count[TS_S] * (sim->m.damping_law == TS_TENSION_ONLY ? 3 : 2); }

static int check_margins(ts_sim *sim, const double *z)
{
    if (ts_all_finite(z, ts_indicator_count(sim))) return TS_OK;
    return ts_say(sim, TS_NOT_FINITE, "a string's elongation or tension is not a finite number");
}

int ts_event_indicators(ts_sim *sim, double *z)
{
    if (ts_ready(sim) != TS_OK) return TS_BAD_STEP;
    take_inputs(sim);
    ts_margins(sim, 0.0, guard(&sim->m), z);
    return check_margins(sim, z);
}

int ts_step_indicators(ts_sim *sim, double *z)
{
    if (ts_ready(sim) != TS_OK) return TS_BAD_STEP;
    ts_swap_applied(sim);
    ts_derive(sim);
    ts_margins(sim, sim->memory.last_step, guard(&sim->m), z);
    ts_swap_back(sim);
    return check_margins(sim, z);
}

/* Largest deviation of a bar's length, or of what its rate soon makes of it, relative. */
static double drift(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    const double *y = sim->state.y;
    int D = m->count[TS_D];
    double most = 0.0;
    for (int b = 0; b < m->blocks; b++) {
        double square = 0.0, along = 0.0, length = m->block.length[b];
        if (!m->block.turns[b]) continue;
        for (int i = b * D; i < (b + 1) * D; i++) square += y[i] * y[i], along += y[i] * y[m->nq + i];
        most = fmax(most, fmax(0.5 * fabs(square / (length * length) - 1.0), AHEAD * fabs(along) / (length * length)));
    }
    if (m->joint.nodes) most = fmax(most, ts_joint_drift(sim, y, AHEAD));
    return most;
}

int ts_completed_step(ts_sim *sim)
{
    if (ts_ready(sim) != TS_OK) return 0;
    if (sim->memory.completed < STEPS) sim->memory.completed++;
    double found = drift(sim);
    return found > DRIFT && (found <= DRIFT_OF_STEP * sim->memory.completed || sim->memory.completed == STEPS);
}

int ts_enter_event(ts_sim *sim)
{
    if (ts_ready(sim) != TS_OK) return TS_BAD_STEP;
    ts_fill(sim, TS_OF_ALL); /* what the last step left out belongs to its end */
    memcpy(sim->io.applied, sim->io.values, sizeof(double) * (size_t)sim->m.n_applied);
    sim->told.count = 0;
    return TS_OK;
}

/* Energy stored under the inputs and parameters as the event found them (J); *kinetic: of motion. */
static double energy_before(ts_sim *sim, double *kinetic)
{
    ts_swap_applied(sim);
    ts_derive(sim);
    double stored = ts_stored_energy(sim, 0.0);
    *kinetic = ts_kinetic_energy(sim);
    ts_swap_back(sim);
    return stored;
}

/* Inputs or parameters jumped: as ts_step() takes them, the jump of energy goes into the input work. */
static int take_jump(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    double kinetic, before = energy_before(sim, &kinetic), *ledger = sim->state.y + 2 * m->nq, lost = ledger[0];
    ts_derive(sim);
    int status = ts_check_change(sim, 0.0);
    if (status != TS_OK) return status;
    if (m->count[TS_E]) ts_jump_bases(sim, sim->io.applied, sim->io.applied_slopes, 0.0);
    double moved = m->count[TS_E] ? ts_kinetic_energy(sim) - kinetic : 0.0;
    if (!ts_leave_passed(sim, guard(m)))
        return ts_say(sim, TS_CHATTERING, "transitions of strings follow each other without end");
    ledger[1] += ts_stored_energy(sim, 0.0) - before + moved + (ledger[0] - lost);
    return TS_OK;
}

static int settle(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    int status = TS_OK;
    take_inputs(sim);
    if (drift(sim) > ROUND_OFF_DRIFT) {
        ts_project(m, sim->state.y);
        if (m->joint.nodes) ts_put_back(sim, 0.0, sim->state.y);
    }
    sim->memory.completed = 0;
    if (memcmp(sim->io.values, sim->io.applied, sizeof(double) * (size_t)m->n_applied)) status = take_jump(sim);
    else if (!ts_leave_passed(sim, guard(m)))
        status = ts_say(sim, TS_CHATTERING, "transitions of strings follow each other without end");
    return status;
}

int ts_update_discrete(ts_sim *sim, int32_t *changed)
{
    const ts_model *m = &sim->m;
    size_t S = (size_t)m->count[TS_S], ny = sizeof(double) * (size_t)m->ny;
    double *y = sim->undo.reals + m->n_real + m->n_applied + 2 * m->n_inputs;
    int32_t *piece = sim->undo.integers + m->n_int, *clipped = piece + S;
    *changed = 0;
    if (ts_ready(sim) != TS_OK) return TS_BAD_STEP;
    memcpy(y, sim->state.y, ny);
    memcpy(piece, sim->state.piece, S * sizeof *piece);
    memcpy(clipped, sim->state.clipped, S * sizeof *clipped);
    int status = settle(sim);
    if (status != TS_OK) {
        memcpy(sim->state.y, y, ny);
        memcpy(sim->state.piece, piece, S * sizeof *piece);
        memcpy(sim->state.clipped, clipped, S * sizeof *clipped);
        sim->told.count = 0;
        ts_derive(sim);
        return status;
    }
    if (memcmp(sim->state.y, y, ny)) *changed |= TS_STATES_CHANGED;
    if (memcmp(sim->state.piece, piece, S * sizeof *piece) || memcmp(sim->state.clipped, clipped, S * sizeof *clipped))
        *changed |= TS_DISCRETE_CHANGED;
    memcpy(sim->io.applied, sim->io.values, sizeof(double) * (size_t)m->n_applied);
    return TS_OK;
}
