/* What FMI's functions of all versions share: what they begin with, and what they do once they are in order.
 *
 * `what` is the name of the function that was called, for messages.  A function that refuses has logged the reason, and left the
 * instance as it was where its status is FMU_DISCARD. */
#ifndef TENSEGRITY_CALLS_H
#define TENSEGRITY_CALLS_H

#include "instance.h"

#define AFTER_START (MODE_INITIALIZATION | MODE_STEPPING | MODE_EVENT | MODE_CONTINUOUS | MODE_TERMINATED | MODE_ERROR)
#define SETTING (MODE_INSTANTIATED | MODE_INITIALIZATION | MODE_STEPPING | MODE_EVENT | MODE_CONTINUOUS)

/* calls.c -------------------------------------------------------------------------------------------------------------- */

/* Log it, and change the mode or leave the instance as it was. */
fmu_status fmu_error(instance *fmu, const char *what, const char *why);
fmu_status fmu_refuse(const instance *fmu, const char *what, const char *why);

/* FMU_OK where the call is allowed now; else `otherwise`: FMU_ERROR for what moves the instance on, FMU_DISCARD for what only
 * sets, reads or saves. */
fmu_status fmu_in_order(instance *fmu, int modes, fmu_status otherwise, const char *what);

/* FMU_OK where the instance is of this kind. */
fmu_status fmu_of_kind(const instance *fmu, fmu_kind kind, const char *what);

/* References from `first` to before `end`, but for those from `other` to before `other_end`; type: what these are. */
typedef struct {
    const char *type;
    int32_t first, end, other, other_end;
} fmu_range;

/* How many values the variable has that starts at this reference; 0: none does.  Behind the table there are time, and each string's
 * event indicators. */
int32_t fmu_span(const instance *fmu, uint32_t vr);
const char *fmu_name(const instance *fmu, uint32_t vr); /* of a value, for messages */

/* FMU_OK where the values are there and belong to variables of these references, all of the range. */
fmu_status fmu_look_up(const instance *fmu, const char *what, const uint32_t vr[], size_t n, const void *values,
                       size_t n_values, fmu_range range);

/* FMU_OK where the caller's vector has as many numbers as there are. */
fmu_status fmu_expect(const instance *fmu, const char *what, const void *vector, size_t n, int32_t count);

/* The kernel's message; where it refuses a value, with the value's name, ts_concerned(). */
const char *fmu_refusal(const instance *fmu, int status, char *text, size_t capacity);

/* Initialization Mode: outputs follow inputs and parameters at once, computed when somebody looks.  0: there is no start. */
int fmu_refresh(instance *fmu, const char *what);

void fmu_log_events(const instance *fmu); /* of the last step or event */

/* messages.c ----------------------------------------------------------------------------------------------------------- */

fmu_status fmu_set_logging(instance *fmu, const char *what, int on, size_t n, const char *const categories[]);

/* life.c --------------------------------------------------------------------------------------------------------------- */

/* What an instance is made from. */
typedef struct {
    const char *what; /* the function that was called */
    const fmu_standard *standard;
    void *environment;
    void (*logger)(void);
    fmu_kind kind;
    const char *name, *token, *location;
    int logging;
} fmu_request;

instance *fmu_instantiate(const fmu_request *request); /* NULL: there is none */
void fmu_release(instance *fmu);
fmu_status fmu_set_experiment(instance *fmu, const char *what, int tolerance_defined, double tolerance, double start,
                              int stop_defined, double stop);
fmu_status fmu_enter_initialization(instance *fmu);
fmu_status fmu_exit_initialization(instance *fmu, const char *what);
fmu_status fmu_terminate(instance *fmu);
fmu_status fmu_reset(instance *fmu, const char *what);

/* values.c: n_values is the sum of the variables' spans. ----------------------------------------------------------------- */

fmu_status fmu_get_reals(instance *fmu, const char *what, const uint32_t vr[], size_t n, double value[], size_t n_values);
fmu_status fmu_set_reals(instance *fmu, const char *what, const uint32_t vr[], size_t n, const double value[], size_t n_values);

/* Integers of 4 or 8 bytes each. */
fmu_status fmu_get_integers(instance *fmu, const char *what, const uint32_t vr[], size_t n, void *value, size_t n_values,
                            int bytes);
fmu_status fmu_set_integers(instance *fmu, const char *what, const uint32_t vr[], size_t n, const void *value, size_t n_values,
                            int bytes);

/* cosimulation.c --------------------------------------------------------------------------------------------------------- */

/* `look`, unless it is NULL, is called at internal steps and transitions, in MODE_INTERMEDIATE and at the instance's time then;
 * the step ends there where it returns 1.  The instance's time says how far the step went. */
typedef int (*fmu_looker)(instance *fmu, int at_transition);
fmu_status fmu_step(instance *fmu, const char *what, double point, double h, fmu_looker look);
fmu_status fmu_set_input_derivatives(instance *fmu, const char *what, const uint32_t vr[], size_t n, const int order[],
                                     const double value[]);
fmu_status fmu_get_output_derivatives(instance *fmu, const char *what, const uint32_t vr[], size_t n, const int order[],
                                      double value[], size_t n_values);

/* exchange.c ------------------------------------------------------------------------------------------------------------- */

/* Outputs, states, their derivatives and event indicators as they follow from time, states and inputs; once for all that ask.
 * 0: there are none. */
enum { VIEW_OUTPUTS = 1, VIEW_STATES = 2, VIEW_DERIVATIVES = 4, VIEW_INDICATORS = 8, VIEW_PARTIALS = 16 /* of partials.c */ };
int fmu_view(instance *fmu, int what, const char *caller);
int fmu_look_within(instance *fmu, int what, const char *caller); /* the same within a step */

fmu_status fmu_enter_event(instance *fmu, const char *what);
fmu_status fmu_update_discrete(instance *fmu, const char *what, int *states_changed);
fmu_status fmu_set_time(instance *fmu, const char *what, double time);
fmu_status fmu_set_states(instance *fmu, const char *what, const double x[], size_t n);
fmu_status fmu_get_states(instance *fmu, const char *what, double x[], size_t n);
fmu_status fmu_get_derivatives(instance *fmu, const char *what, double derivatives[], size_t n);
fmu_status fmu_get_nominals(instance *fmu, const char *what, double nominals[], size_t n);
fmu_status fmu_get_indicators(instance *fmu, const char *what, double indicators[], size_t n);

/* partials.c: partial derivatives times a vector. -------------------------------------------------------------------------- */

/* Numbers of seed and sensitivity are the sums of the variables' spans. */
typedef struct {
    const char *what; /* the function that was called */
    const uint32_t *unknown, *known;
    size_t unknowns, knowns;
    const double *seed;  /* of the knowns; adjoint: weights of the unknowns */
    double *sensitivity; /* of the unknowns; adjoint: by each of the knowns */
    size_t n_seed, n_sensitivity;
} fmu_product;

int fmu_prepare_partials(instance *fmu); /* 0: out of memory */
fmu_status fmu_get_partials(instance *fmu, const fmu_product *p, int adjoint);

/* state.c: saved states, whose pointers the host holds. -------------------------------------------------------------------- */

fmu_status fmu_get_state(instance *fmu, const char *what, void **state);
fmu_status fmu_set_state(instance *fmu, const char *what, void *state);
fmu_status fmu_free_state(void **state);
fmu_status fmu_serialized_size(instance *fmu, const char *what, const void *state, size_t *size);
fmu_status fmu_serialize(instance *fmu, const char *what, const void *state, void *bytes, size_t size);
fmu_status fmu_deserialize(instance *fmu, const char *what, const void *bytes, size_t size, void **state);

/* For the functions of one version of the standard, whose status type is fmi_status. ----------------------------------------- */

#define REQUIRE(component, modes, otherwise)                                 \
    instance *fmu = (instance *)component;                                   \
    fmu_status order_status = fmu_in_order(fmu, modes, otherwise, __func__); \
    if (order_status != FMU_OK) return (fmi_status)order_status

#define REQUIRE_KIND(kind)                                     \
    fmu_status kind_status = fmu_of_kind(fmu, kind, __func__); \
    if (kind_status != FMU_OK) return (fmi_status)kind_status

#define REQUIRE_POINTER(pointer) \
    if (!(pointer)) return (fmi_status)fmu_refuse(fmu, __func__, "a null pointer was passed")

#endif
