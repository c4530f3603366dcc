/* The kernel's public interface: one tensegrity simulation behind an opaque handle.
 *
 * Every real variable (inputs, parameters, outputs) lives in one block of doubles in the order of fields.h, every integer
 * one in a block of int32.  The caller writes inputs and parameters into the blocks and reads outputs from them; a call
 * that fails leaves the simulation as it was and says why in ts_message(); only ts_initialize() with TS_NOT_FINITE leaves one that
 * has to be initialized again, and ts_restore() of a forged state one that has been reset.  No globals, no allocation after ts_create(). */
#ifndef TENSEGRITY_H
#define TENSEGRITY_H

#include "fields.h"

#include <stddef.h>
#include <stdint.h>

#if !defined(TS_EXPORTED) /* defined where the kernel is a library of its own, else nothing of it is exported */
#define TS_API
#elif defined(_WIN32)
#define TS_API __declspec(dllexport)
#elif defined(__GNUC__)
#define TS_API __attribute__((visibility("default")))
#else
#define TS_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

typedef struct ts_sim ts_sim;

typedef enum {
#define TS_ERROR(name, text) TS_##name,
#include "errors.def"
#undef TS_ERROR
    TS_STATUS_COUNT
} ts_status;

typedef struct {
    double time;    /* s */
    double loss;    /* J, dissipated by a snap of a string with memory */
    int32_t string; /* index; -1: none, but a contact with the ground */
    int32_t before; /* 0: slack; else the piece of the force curve, of a string with memory 1 + its snapped parts; of a contact
                       0: apart, 1: sticking, 2: slipping, 3: clipped */
    int32_t after;
    int32_t contact; /* index, -1: none */
} ts_transition;

/* Make a simulation from a packed model (kernel/packing.py, to_bytes).  NULL on failure, with the reason in message. */
TS_API ts_sim *ts_create(const void *model, size_t size, char *message, size_t capacity);
TS_API void ts_free(ts_sim *sim);

TS_API void ts_counts(const ts_sim *sim, int32_t counts[TS_COUNTS]);
TS_API double *ts_values(ts_sim *sim);
TS_API int32_t *ts_integers(ts_sim *sim);
TS_API int32_t ts_real_count(const ts_sim *sim); /* of the blocks */
TS_API int32_t ts_integer_count(const ts_sim *sim);

/* First and then second derivatives by time of the inputs, in the order of the block of doubles; zero unless they are set, and
 * then kept like the inputs themselves.  Over a step an input is its value + slope t + bend t^2/2, t from the step's start; a
 * rest length is the integral of its rate.  A derivative of a rest length that is not zero takes the place of the rate or of the
 * rate's first derivative. */
TS_API int32_t ts_input_count(const ts_sim *sim);
TS_API double *ts_slopes(ts_sim *sim);
TS_API double ts_time(const ts_sim *sim); /* s */
TS_API const char *ts_message(const ts_sim *sim);

/* After TS_BAD_INPUT: the place of the value that was refused, as ts_check() counts it, and ts_message() goes on from its name.
 * Or -1: the message stands alone. */
TS_API int32_t ts_concerned(const ts_sim *sim);
TS_API const char *ts_status_name(int status);

/* Inputs, parameters and state as ts_create() left them. */
TS_API int ts_reset(ts_sim *sim);

/* Look through inputs and parameters.  On TS_BAD_INPUT, *index is the offender's place in the block of doubles, or
 * n_real + its place in the block of integers. */
TS_API int ts_check(ts_sim *sim, int32_t *index);

/* Return to the start of the scene at this time (s), under the present inputs and parameters, and fill the outputs. */
TS_API int ts_initialize(ts_sim *sim, double time);

/* Advance by h > 0 (s) under the present inputs and tunable parameters, and fill the outputs. */
TS_API int ts_step(ts_sim *sim, double h);

/* Outputs on demand.  They are computed in four groups: positions and velocities of nodes and motors; forces and lengths; energies;
 * what the ledger integrates.  ts_want() says of which groups ts_step() fills outputs, at first of all; the others stay in the
 * block as they are until ts_fill(), or ts_fill_at() of places in the block (integers follow), brings them to the end of the last step.  Whoever
 * asks late gets the same numbers, whatever inputs have been written meanwhile.  TS_NOT_FINITE: they are no finite numbers. */
enum { TS_OF_MOTION = 1, TS_OF_FORCES = 2, TS_OF_ENERGIES = 4, TS_OF_WORK = 8, TS_OF_ALL = 15 };
TS_API void ts_want(ts_sim *sim, int groups);
TS_API int ts_fill(ts_sim *sim, int groups);
TS_API int ts_fill_at(ts_sim *sim, const uint32_t *places, size_t count);

/* The same, watched: the watcher is called where an internal step has ended before the call's end, and where transitions have been
 * carried out there.  There ts_time() is the time reached, ts_transitions() are those so far, ts_look() brings the outputs into
 * the block, and ts_output_derivatives() differentiates them; every other call that changes the simulation is refused, and
 * inputs and parameters must stay.  TS_END_HERE makes what has been reached the end of the step; *done: how far it went (s), h or
 * less.  Inputs that move do so from the start of the step that follows, like those of any step.  TS_GIVE_UP: the call fails.
 * Transitions of inputs that jump at the step's start are none of the watcher's. */
typedef enum { TS_AT_STEP = 1, TS_AT_TRANSITION = 2 } ts_moment;
enum { TS_GO_ON = 0, TS_END_HERE = 1, TS_GIVE_UP = 2 };
typedef int (*ts_watcher)(void *context, ts_sim *sim, ts_moment moment);
TS_API int ts_step_watched(ts_sim *sim, double h, ts_watcher watcher, void *context, double *done);
TS_API int ts_look(ts_sim *sim);

/* A rest length or a moved node that has not been set since the last step gets the value to which that step has brought it; not
 * where inputs have derivatives (ts_slopes()). */
TS_API void ts_carry_inputs(ts_sim *sim);

/* Take inputs and tunable parameters that differ from the last step's at once, as a step that begins now would, and fill the
 * outputs: what jumps is booked here, and not again by that step.  Inputs that move are carried first. */
TS_API int ts_take_inputs(ts_sim *sim);

/* First derivatives by time of all real outputs at the end of the last step, on the present branches of all strings, in the
 * order of the block of doubles.  TS_BAD_STEP before ts_initialize(). */
TS_API int32_t ts_output_first(const ts_sim *sim); /* where the outputs begin in the block */
TS_API int ts_output_derivatives(ts_sim *sim, double *out);

/* Transitions of the last ts_step(): how many, and the first of them up to a fixed capacity. */
TS_API int64_t ts_transition_count(const ts_sim *sim);
TS_API int32_t ts_transition_stored(const ts_sim *sim);
TS_API const ts_transition *ts_transitions(const ts_sim *sim);
TS_API int32_t ts_snapped(const ts_sim *sim, int32_t string,
                          int32_t piece); /* beams past their force maximum on a piece as transitions have it */
TS_API void ts_stats(const ts_sim *sim, int64_t stats[TS_STATS]); /* since ts_initialize() */

/* Complete state as bytes: versioned, bound to the model, with a checksum. */
TS_API size_t ts_state_size(const ts_sim *sim);
TS_API int ts_save(const ts_sim *sim, void *bytes, size_t size);
TS_API int ts_restore(ts_sim *sim, const void *bytes, size_t size);

/* The continuous-time view, for a host that integrates with a solver of its own, from ts_initialize() on and instead of ts_step().
 * It sets time (s), states and inputs, all of the same instant, and asks for derivatives, for the outputs, which come into the
 * block, and for event indicators: one that becomes negative asks for an event, as ts_completed_step() does (1) where the bars'
 * lengths have drifted.  An event begins with ts_enter_event(); inputs that jump and tunable parameters change then, as they
 * may at a ts_step(), and ts_update_discrete() takes them, puts strings on the pieces that follow and bars on their lengths, and
 * says by TS_..._CHANGED what it did.  Its transitions are those of ts_transitions().  A state is a coordinate (m), its rate
 * (m/s), or the energy dissipated or put in (J), in the order of interface/continuous.c. */
enum { TS_STATES_CHANGED = 1, TS_DISCRETE_CHANGED = 2 };
TS_API int32_t ts_continuous_count(const ts_sim *sim);
TS_API int32_t ts_integral_first(const ts_sim *sim); /* where in the block the last two states begin, which are outputs */
TS_API int32_t ts_indicator_count(const ts_sim *sim);
TS_API void ts_continuous_nominals(const ts_sim *sim, double *x);
TS_API int ts_continuous_states(const ts_sim *sim, double *x);
TS_API int ts_set_continuous_states(ts_sim *sim, const double *x);
TS_API int ts_set_time(ts_sim *sim, double time);
TS_API int ts_continuous_derivatives(ts_sim *sim, double *dx); /* unit/s */
TS_API int ts_step_derivatives(ts_sim *sim, double *dx);       /* the same at the end of a ts_step() */
TS_API int ts_step_indicators(ts_sim *sim, double *z);         /* event indicators there */
TS_API int ts_continuous_outputs(ts_sim *sim);
TS_API int ts_event_indicators(ts_sim *sim, double *z);
TS_API int ts_completed_step(ts_sim *sim);
TS_API int ts_enter_event(ts_sim *sim);
TS_API int ts_update_discrete(ts_sim *sim, int32_t *changed);

/* First derivatives of the continuous-time view at the present time, states and inputs, the strings staying on their pieces; or,
 * with start, of what ts_initialize() has just computed, by start values and fixed parameters, too (states are then no arguments).
 * Analytic, exact to round-off.  Knowns: the states, then inputs and parameters in the order of the block; unknowns: the states,
 * their derivatives, the real outputs, the event indicators.
 *
 * The caller's memory, aligned as malloc() does it, is shared out once.  ts_differentiate() looks, fills the outputs, and leaves
 * there what products are taken of, each at about the cost of an evaluation: ts_directional() of the unknowns along a vector of
 * the knowns, ts_adjoint() of weighted unknowns by each of the knowns. */
TS_API int32_t ts_known_count(const ts_sim *sim);
TS_API int32_t ts_unknown_count(const ts_sim *sim);
TS_API int ts_differentiable(const ts_sim *sim,
                             int32_t known); /* 0: no rows are written for it, or a force curve is compiled from it */
TS_API int ts_differentiated(const ts_sim *sim, int32_t unknown); /* 0: no rows are written for it */
TS_API size_t ts_derivatives_size(const ts_sim *sim);             /* bytes */
TS_API int ts_share_derivatives(ts_sim *sim, void *work, size_t size);
TS_API int ts_differentiate(ts_sim *sim, int start, void *work);
TS_API int ts_directional(ts_sim *sim, void *work, const double *known, double *unknown);
TS_API int ts_adjoint(ts_sim *sim, void *work, const double *unknown, double *known);

TS_API size_t ts_memory_size(const ts_sim *sim); /* bytes of a simulation, without its force curves */

/* For tests and analysis; -1 where the parameters allow no force curve.  Generalised state y = [q, qdot, ledger], see motion.c. */
TS_API void ts_locate(ts_sim *sim, int on); /* 0: transitions are not located, every evaluation takes the law as one formula */
TS_API int32_t ts_state_length(const ts_sim *sim);
TS_API void ts_get_state(const ts_sim *sim, double *y);
TS_API void ts_derivative(ts_sim *sim, double tau, const double *y, double *dy);
TS_API void ts_jacobian(ts_sim *sim, double tau, const double *y, double *Jq, double *Jv, double *ft);
TS_API int ts_string_law(const ts_sim *sim, int32_t string, double elongation, double out[3]); /* N, N/m, J; the piece */
TS_API int ts_piece_law(const ts_sim *sim, int32_t string, int32_t piece, double elongation, double out[3]);
TS_API int ts_breakpoints(const ts_sim *sim, int32_t string, double *out, int32_t capacity); /* how many there are */

/* A string's force curve as a graph: pieces in the elongation, which piece follows where one is left, and what a snap there
 * dissipates.  A law that is a function of the elongation is a chain; one with memory has several pieces at one elongation, and
 * ts_string_law() and ts_breakpoints() are those of a first loading. */
typedef struct {
    double lo, hi;             /* m */
    double loss_up, loss_down; /* J */
    int32_t up, down;          /* pieces beyond hi and lo; -1: none */
    int32_t snapped, slack;    /* beams past their force maximum; 1: no tension */
} ts_curve_piece_info;

/* How many pieces there are; the first of them up to the capacity. */
TS_API int ts_curve_pieces(const ts_sim *sim, int32_t string, ts_curve_piece_info *out, int32_t capacity);

#ifdef __cplusplus
}
#endif
#endif
