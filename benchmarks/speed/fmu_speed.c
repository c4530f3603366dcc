/* What a plain C host pays for the native FMU, as lines of text on stdout; see fmu_speed.py.
 *
 *   fmu_speed KERNEL LIBRARY GUID RESOURCES MODEL INPUTS FORCES SETTABLE FIRST_OUTPUT REALS PUSHED ROUNDS
 *
 * KERNEL: the kernel's library; LIBRARY, GUID, RESOURCES: of the FMU; MODEL: its packed model; INPUTS, FORCES, SETTABLE, REALS:
 * value references below which inputs, forces, what can be set between steps, and all reals end; FIRST_OUTPUT; PUSHED: the force
 * that moves the structure; ROUNDS: how often everything is measured, in turns.
 *
 * Lines "NAME ns" are one round each, per step or per call.  `step`: the bare ts_step and fmi2DoStep of 1 ms, inputs as they
 * were; `dense`: the same with steps of 10 us, most of which lie within one step of the integrator; `driven`: 1 ms, other forces
 * at each step, the FMU with all inputs set and all outputs read; `still`: the same with the same values at each step; `set`,
 * `get`: 100 variables.  "allocations n" counts malloc, calloc and realloc in all the FMU's steps, settings and readings.  Times
 * are processor times. */
#define _GNU_SOURCE
#include "../harness/clock.h"

#include "fmi2Functions.h"
#include "tensegrity.h"

#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define STEPS 2000 /* of a run */
#define CALLS 2000 /* of fmi2SetReal and fmi2GetReal */
#define HUNDRED 100
#define MOST 1024
#define PUSH 45.0 /* N */

static long taken; /* calls that took memory */

#if defined(__GLIBC__) /* in place of the C library's, which the FMU calls, too */
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t n, size_t size);
extern void *__libc_realloc(void *p, size_t size);
void *malloc(size_t size) { return taken++, __libc_malloc(size); }
void *calloc(size_t n, size_t size) { return taken++, __libc_calloc(n, size); }
void *realloc(void *p, size_t size) { return taken++, __libc_realloc(p, size); }
#define COUNTED 1
#else
#define COUNTED 0
#endif

/* clang-format off */ /* names in rows */
#define KERNEL(X) X(ts_create) X(ts_free) X(ts_values) X(ts_initialize) X(ts_want) X(ts_step)
#define FMU(X) X(fmi2Instantiate) X(fmi2FreeInstance) X(fmi2SetupExperiment) X(fmi2EnterInitializationMode) \
    X(fmi2ExitInitializationMode) X(fmi2Reset) X(fmi2SetReal) X(fmi2GetReal) X(fmi2DoStep)
/* clang-format on */

static struct {
#define FIELD(name) __typeof__(&name) name;
    KERNEL(FIELD) FMU(FIELD)
#undef FIELD
} f;

static ts_sim *sim;
static double *values; /* of the kernel */
static fmi2Component fmu;
static unsigned inputs, forces, settable, first_output, reals, pushed;
static fmi2ValueReference in[MOST], out[MOST], hundred[HUNDRED];
static double start[MOST], row[MOST], *signal_of; /* signal_of: (STEPS, inputs) of the driven runs */

static void give_up(const char *what, const char *why)
{
    fprintf(stderr, "fmu_speed: %s: %s\n", what, why);
    exit(1);
}

static void require(int holds, const char *what)
{
    if (!holds) give_up(what, "failed");
}

static void report(const char *name, double seconds, double count) { printf("%s %.6g\n", name, 1e9 * seconds / count); }

static void *open_library(const char *path)
{
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) give_up(path, dlerror());
    return library;
}

static void load(const char *kernel, const char *library)
{
    void *from = open_library(kernel);
#define FIND(name) \
    if (!(*(void **)&f.name = dlsym(from, #name))) give_up(#name, "is not exported");
    KERNEL(FIND)
    from = open_library(library);
    FMU(FIND)
#undef FIND
}

static void make(const char *guid, const char *resources, const char *model)
{
    static const fmi2CallbackFunctions callbacks;
    static char bytes[1 << 20], message[256];
    FILE *file = fopen(model, "rb");
    if (!file) give_up(model, "cannot be read");
    size_t size = fread(bytes, 1, sizeof bytes, file);
    fclose(file);
    if (!(sim = f.ts_create(bytes, size, message, sizeof message))) give_up(model, message);
    values = f.ts_values(sim);
    fmu = f.fmi2Instantiate("fmu", fmi2CoSimulation, guid, resources, &callbacks, fmi2False, fmi2False);
    require(fmu != NULL, "fmi2Instantiate");
}

/* Both at the start, under the scene's inputs and a push. */
static void restart(void)
{
    start[pushed] = PUSH;
    memcpy(values, start, sizeof(double) * inputs);
    require(f.ts_initialize(sim, 0.0) == TS_OK, "ts_initialize");
    f.ts_want(sim, 0); /* as in the FMU: outputs when somebody reads them */
    require(f.fmi2Reset(fmu) == fmi2OK && f.fmi2SetupExperiment(fmu, 0, 0.0, 0.0, 0, 0.0) == fmi2OK, "fmi2SetupExperiment");
    require(f.fmi2SetReal(fmu, in, inputs, start) == fmi2OK, "fmi2SetReal");
    require(f.fmi2EnterInitializationMode(fmu) == fmi2OK && f.fmi2ExitInitializationMode(fmu) == fmi2OK, "initialization");
}

static void prepare(void)
{
    require(inputs <= MOST && reals - first_output <= MOST && settable > 0, "places");
    for (unsigned i = 0; i < inputs; i++) in[i] = i;
    for (unsigned i = first_output; i < reals; i++) out[i - first_output] = i;
    for (unsigned i = 0; i < HUNDRED; i++) hundred[i] = i % settable;
    memcpy(start, values, sizeof(double) * inputs);
    signal_of = malloc(sizeof(double) * STEPS * inputs);
    require(signal_of != NULL, "memory");
    for (unsigned k = 0; k < STEPS; k++)
        for (unsigned i = 0; i < inputs; i++)
            signal_of[k * inputs + i] = start[i] + (i < forces ? 20.0 * sin(0.0125 * k + i) : 0.0);
}

/* ---- What is measured ---- */

static double kernel_steps(double h, const double *signal)
{
    double begin = now();
    for (unsigned k = 0; k < STEPS; k++) {
        if (signal) memcpy(values, signal + k * inputs, sizeof(double) * forces);
        require(f.ts_step(sim, h) == TS_OK, "ts_step");
    }
    return now() - begin;
}

static double fmu_steps(double h)
{
    double begin = now();
    for (unsigned k = 0; k < STEPS; k++) require(f.fmi2DoStep(fmu, k * h, h, fmi2True) == fmi2OK, "fmi2DoStep");
    return now() - begin;
}

/* All inputs set and all outputs read; stride 0: the same values at each step. */
static double fmu_exchanges(double h, const double *signal, unsigned stride)
{
    double begin = now();
    for (unsigned k = 0; k < STEPS; k++) {
        require(f.fmi2SetReal(fmu, in, inputs, signal + k * stride) == fmi2OK, "fmi2SetReal");
        require(f.fmi2DoStep(fmu, k * h, h, fmi2True) == fmi2OK, "fmi2DoStep");
        require(f.fmi2GetReal(fmu, out, reals - first_output, row) == fmi2OK, "fmi2GetReal");
    }
    return now() - begin;
}

static double hundred_calls(int set)
{
    require(f.fmi2GetReal(fmu, hundred, HUNDRED, row) == fmi2OK, "fmi2GetReal");
    double begin = now();
    for (unsigned k = 0; k < CALLS; k++)
        require((set ? f.fmi2SetReal(fmu, hundred, HUNDRED, row) : f.fmi2GetReal(fmu, hundred, HUNDRED, row)) == fmi2OK,
                "values");
    return now() - begin;
}

static void one_round(void)
{
    restart();
    report("kernel_step", kernel_steps(1e-3, NULL), STEPS);
    report("fmu_step", fmu_steps(1e-3), STEPS);
    restart();
    report("kernel_dense", kernel_steps(1e-5, NULL), STEPS);
    report("fmu_dense", fmu_steps(1e-5), STEPS);
    restart();
    report("kernel_driven", kernel_steps(1e-3, signal_of), STEPS);
    report("fmu_driven", fmu_exchanges(1e-3, signal_of, inputs), STEPS);
    restart();
    report("fmu_still", fmu_exchanges(1e-3, start, 0), STEPS);
    report("set", hundred_calls(1), CALLS);
    report("get", hundred_calls(0), CALLS);
}

static long allocations(void)
{
    restart();
    long before = taken;
    fmu_exchanges(1e-3, signal_of, inputs);
    return taken - before;
}

int main(int argc, char **argv)
{
    if (argc != 13) give_up("arguments", "see the head of fmu_speed.c");
    unsigned *numbers[] = {&inputs, &forces, &settable, &first_output, &reals, &pushed};
    for (int i = 0; i < 6; i++) *numbers[i] = (unsigned)atoi(argv[6 + i]);
    load(argv[1], argv[2]);
    make(argv[3], argv[4], argv[5]);
    prepare();
    for (int r = atoi(argv[12]); r > 0; r--) one_round();
    if (COUNTED) printf("allocations %ld\n", allocations());
    f.fmi2FreeInstance(fmu);
    f.ts_free(sim);
    free(signal_of);
    return 0;
}
