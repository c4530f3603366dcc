/* What an instance of the FMU is made of, whatever the standard.  The kernel computes (tensegrity.h); this runtime knows what
 * FMI's functions share, the variables' names and limits, and nothing of forces.  No globals: instances share nothing. */
#ifndef TENSEGRITY_INSTANCE_H
#define TENSEGRITY_INSTANCE_H

#include "resources.h"
#include "tensegrity.h"

#include <stddef.h>
#include <stdint.h>

/* What a function of FMI returns, with the numbers of all versions of the standard. */
typedef enum { FMU_OK, FMU_WARNING, FMU_DISCARD, FMU_ERROR } fmu_status;

typedef enum { FMU_CO_SIMULATION, FMU_MODEL_EXCHANGE, FMU_OTHER_KIND } fmu_kind;

/* Modes of the life cycle, as bits, so that a function can list those in which it may be called. */
enum {
    MODE_INSTANTIATED = 1,
    MODE_INITIALIZATION = 2,
    MODE_STEPPING = 4,
    MODE_TERMINATED = 8,
    MODE_ERROR = 16, /* until the instance is reset, freed or put back into a saved state */
    MODE_EVENT = 32, /* model exchange, and co-simulation of a host that asked for it */
    MODE_CONTINUOUS = 64,
    MODE_ANY = 127,
    MODE_INTERMEDIATE = 128 /* within a step, while the host looks at what has been reached; never saved */
};

/* Log categories, in the order of LOG_CATEGORIES in model_description.py. */
enum { LOG_WARNING, LOG_DISCARD, LOG_ERROR, LOG_EVENTS, LOG_SOLVER, LOG_CATEGORIES };

/* The variable table, packed by variables_bin in packing/: variables in the order of their value references, reals first. */
typedef struct {
    char *bytes; /* owned; the rest points into it */
    const char *guid;
    int32_t reals, count, strings, contacts;
    int32_t tolerance;        /* reference of solver.tolerance */
    uint64_t model;           /* checksum of model.bin */
    const double *low, *high; /* (count) values that are accepted */
    const int32_t *settable;  /* (count) modes in which a value may be set, as bits */
    const int32_t *span;      /* (count) how many values the variable has that starts here; 0: none does */
    const char **name; /* (count + strings + contacts) owned: of variables, element by element, of strings, of nodes that may
                                  touch the ground */
} variable_table;

struct instance;

/* What the version of the standard changes in what all share. */
typedef struct {
    int number;                 /* of its functions' prefix, fmi2 or fmi3 */
    const char *token;          /* its name of what binds an instance to its description */
    const char *real, *integer; /* its names of types */
    const char *location;       /* what it calls the place of the resources */
    void (*pass_on)(const struct instance *fmu, fmu_status status, const char *category, const char *message);
} fmu_standard;

typedef struct instance {
    const fmu_standard *standard;
    void *environment;    /* the host's */
    void (*logger)(void); /* the host's, of the standard's type; NULL: none */
    char *name;           /* of the instance, owned */
    variable_table table;
    ts_sim *sim;
    double *values;    /* (reals) the kernel's */
    int32_t *integers; /* (counted - reals) the kernel's */
    int32_t first_output;
    double *derivatives; /* (reals - first_output) of the outputs at the end of the last step, once asked for; owned */
    int32_t derivatives_ready;
    int log[LOG_CATEGORIES];
    uint64_t identity; /* of the FMU, from its GUID: saved states are bound to it */
    fmu_kind kind;
    int32_t event_mode;         /* co-simulation: the host has asked for Event Mode */
    int32_t early_return;       /* co-simulation: a step may end before its time */
    void (*intermediate)(void); /* co-simulation: the host's, of the standard's type; NULL: it does not look into steps */
    int32_t counted;            /* references of the kernel's blocks; behind them those of states and derivatives, see
                              * variables/states.py */
    int32_t state_count;        /* continuous states; 0: the FMU has no variables for them, and is no model exchange FMU */
    int32_t indicator_count;    /* event indicators; 0 where there are no states */
    double *states;             /* (2, state_count) states and derivatives, as far as `viewed`; owned */
    double *indicators;         /* (indicator_count) as far as `viewed`; behind `states` */
    int32_t viewed;             /* what has been computed at the present time, states and inputs: bits VIEW_... of calls.h */
    double *known, *unknown;    /* vectors of the kernel's products with derivatives; owned, NULL: this instance has none */
    void *differentiated;       /* what it takes them of, as far as `viewed`; behind them */
    double tolerance;           /* the FMU's own, which keeps its promise; a host's may be tighter */

    /* saved with the FMU state */
    int32_t mode;
    int32_t stale;         /* Initialization Mode: outputs are older than the inputs */
    int32_t tolerance_set; /* by the host: the experiment's tolerance does not change it then */
    int32_t stop_defined;
    double start, time, stop; /* s */
    int32_t discarded;        /* not saved: the last step was */
} instance;

/* messages.c */
#define FMU_LONGEST_MESSAGE 1024
void fmu_log(const instance *fmu, int category, fmu_status status, const char *format, ...);
int fmu_always_said(const instance *fmu, int category); /* also where the host has not asked for messages */
void fmu_escape(const char *text, const char *characters, char *escaped);
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
