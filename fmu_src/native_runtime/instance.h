/* What an instance of the FMU is made of.  The kernel computes (tensegrity.h); this runtime knows FMI's order of calls, the
 * variables' names and limits, and nothing of forces.  No globals: instances share nothing. */
#ifndef TENSEGRITY_INSTANCE_H
#define TENSEGRITY_INSTANCE_H

#include "fmi2Functions.h"
#include "resources.h"
#include "tensegrity.h"

#include <stddef.h>
#include <stdint.h>

/* Modes of the life cycle, as bits, so that a function can list those in which it may be called. */
enum {
    FMU_INSTANTIATED = 1,
    FMU_INITIALIZATION = 2,
    FMU_STEPPING = 4,
    FMU_TERMINATED = 8,
    FMU_ERROR = 16, /* until the instance is reset, freed or put back into a saved state */
    FMU_EVENT = 32, /* model exchange */
    FMU_CONTINUOUS = 64,
    FMU_ANY = 127
};

/* Log categories, in the order of LOG_CATEGORIES in model_description.py. */
enum { LOG_WARNING, LOG_DISCARD, LOG_ERROR, LOG_EVENTS, LOG_SOLVER, LOG_CATEGORIES };

/* The variable table, packed by pack.py (variables_bin): variables in the order of their value references, reals first. */
typedef struct {
    char *bytes; /* owned; the rest points into it */
    const char *guid;
    int32_t reals, count, strings;
    int32_t tolerance;        /* reference of solver.tolerance */
    int32_t gaps;             /* at some references no variable starts */
    uint64_t model;           /* checksum of model.bin */
    const double *low, *high; /* (count) values that are accepted */
    const int32_t *settable;  /* (count) modes in which a value may be set, as bits */
    const int32_t *span;      /* (count) how many values the variable has that starts here; 0: none does */
    const char **name;        /* (count + strings) owned: of variables, then of strings */
} variable_table;

typedef struct {
    fmi2CallbackFunctions host;
    char *name; /* of the instance, owned */
    variable_table table;
    ts_sim *sim;
    double *values;    /* (reals) the kernel's */
    int32_t *integers; /* (count - reals) the kernel's */
    int32_t first_output;
    double *derivatives; /* (reals - first_output) of the outputs at the end of the last step, once asked for; owned */
    int32_t derivatives_ready;
    int log[LOG_CATEGORIES];
    uint64_t identity; /* of the FMU, from its GUID: saved states are bound to it */
    fmi2Type kind;
    int32_t counted;     /* references of the kernel's blocks; behind them those of states and derivatives, see
                          * variables/states.py */
    int32_t state_count; /* continuous states; 0: the FMU has no variables for them, and is no model exchange FMU */
    double *states;      /* (2, state_count) states and derivatives, as far as `viewed`; owned */
    int32_t viewed;      /* what has been computed at the present time, states and inputs: bits VIEW_... of calls.h */
    double tolerance;    /* the FMU's own, which keeps its promise; a host's may be tighter */

    /* saved with the FMU state */
    int32_t mode;
    int32_t stale;         /* Initialization Mode: outputs are older than the inputs */
    int32_t tolerance_set; /* by the host: fmi2SetupExperiment does not change it then */
    int32_t stop_defined;
    double start, time, stop; /* s */
    int32_t discarded;        /* not saved: the last fmi2DoStep was */
} instance;

/* messages.c */
void fmu_log(const instance *fmu, int category, fmi2Status status, const char *format, ...);
const char *fmu_number(double x, char text[32]);
extern const char *const fmu_categories[LOG_CATEGORIES];

/* variables.c: 0 where the bytes are damaged, cut or of another version. */
int variables_read(variable_table *table, char *bytes, size_t size);
void variables_free(variable_table *table);

/* state.c */
size_t fmu_state_size(const instance *fmu);
void fmu_state_save(const instance *fmu, char *bytes);
const char *fmu_state_refusal(const instance *fmu, const char *bytes, size_t size); /* NULL: it is one of this FMU */
int fmu_state_restore(instance *fmu, const char *bytes);

#endif
