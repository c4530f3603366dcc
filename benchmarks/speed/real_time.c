/* What each communication step costs a plain C host of the native FMU, as lines of text on stdout; see real_time.py.
 *
 *   real_time LIBRARY GUID RESOURCES SIGNALS OUTPUTS INPUTS FIRST_OUTPUT REALS METHOD_AT METHOD TOLERANCE_AT TOLERANCE
 *             STEP COUNT RUNS EACH
 *
 * LIBRARY, GUID, RESOURCES: of the FMU; SIGNALS: a file of rows of INPUTS doubles, taken in turn; OUTPUTS: a file to write
 * all outputs to, one row for each of SIGNALS, "-": none; FIRST_OUTPUT, REALS: where outputs begin and reals end; METHOD_AT,
 * METHOD, TOLERANCE_AT, TOLERANCE: references and values of the solver's parameters; STEP: s; COUNT: steps of a run; RUNS:
 * the same again, from the start; EACH: whether steps are timed one by one.
 *
 * A step sets all inputs, calls fmi2DoStep and reads all outputs.  "run s": processor time of a run; "first BIN n" and
 * "least BIN n": how many steps took from 10^(BIN/20) ns on, by the wall clock, in the first run, and each in the run that
 * disturbed it least; "first_worst ns", "least_worst ns"; "allocations n": calls that took memory, during all runs but the
 * first; "stack n": bytes that a run's deepest call took. */
#define _GNU_SOURCE
#include "../harness/clock.h"

#include "fmi2Functions.h"

#include <dlfcn.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define BINS 200
#define PER_DECADE 20.0
#define MOST 1024
#define STACK 65536
#define PAINT 0x5a

static long taken; /* calls that took memory */

#if defined(__GLIBC__) /* in place of the C library's, which the FMU calls, too */
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t n, size_t size);
extern void *__libc_realloc(void *p, size_t size);
void *malloc(size_t size) { return taken++, __libc_malloc(size); }
void *calloc(size_t n, size_t size) { return taken++, __libc_calloc(n, size); }
void *realloc(void *p, size_t size) { return taken++, __libc_realloc(p, size); }
#endif

/* clang-format off */ /* names in rows */
#define FMU(X) X(fmi2Instantiate) X(fmi2FreeInstance) X(fmi2SetupExperiment) X(fmi2EnterInitializationMode) \
    X(fmi2ExitInitializationMode) X(fmi2Reset) X(fmi2SetReal) X(fmi2GetReal) X(fmi2SetInteger) X(fmi2DoStep)
/* clang-format on */

static struct {
#define FIELD(name) __typeof__(&name) name;
    FMU(FIELD)
#undef FIELD
} f;

typedef struct {
    unsigned inputs, first_output, reals, method_at, tolerance_at;
    fmi2Integer method;
    double tolerance, step;
    long count, rows;
    const double *signals; /* (rows, inputs) */
} job;

static fmi2ValueReference in[MOST], out[MOST];
static double row[MOST];

static void require(int holds, const char *what)
{
    if (holds) return;
    fprintf(stderr, "real_time: %s failed\n", what);
    exit(1);
}

static double wall(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void load(const char *path)
{
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    require(library != NULL, path);
#define FIND(name)                             \
    *(void **)&f.name = dlsym(library, #name); \
    require(f.name != NULL, #name);
    FMU(FIND)
#undef FIND
}

static const double *read_signals(const char *path, job *j)
{
    FILE *file = fopen(path, "rb");
    require(file && !fseek(file, 0, SEEK_END), path);
    long size = ftell(file);
    rewind(file);
    double *rows = malloc((size_t)size);
    require(rows && fread(rows, 1, (size_t)size, file) == (size_t)size, path);
    fclose(file);
    j->rows = size / (long)sizeof(double) / j->inputs;
    return rows;
}

static void begin(fmi2Component fmu, const job *j)
{
    require(f.fmi2Reset(fmu) == fmi2OK && f.fmi2SetupExperiment(fmu, 0, 0.0, 0.0, 0, 0.0) == fmi2OK, "fmi2SetupExperiment");
    require(f.fmi2SetInteger(fmu, &j->method_at, 1, &j->method) == fmi2OK, "solver.method");
    require(f.fmi2SetReal(fmu, &j->tolerance_at, 1, &j->tolerance) == fmi2OK, "solver.tolerance");
    require(f.fmi2EnterInitializationMode(fmu) == fmi2OK && f.fmi2ExitInitializationMode(fmu) == fmi2OK, "initialization");
}

static void exchange(fmi2Component fmu, const job *j, long k)
{
    require(f.fmi2SetReal(fmu, in, j->inputs, j->signals + k % j->rows * j->inputs) == fmi2OK, "fmi2SetReal");
    require(f.fmi2DoStep(fmu, (double)k * j->step, j->step, fmi2True) == fmi2OK, "fmi2DoStep");
    require(f.fmi2GetReal(fmu, out, j->reals - j->first_output, row) == fmi2OK, "fmi2GetReal");
}

/* The stack below the caller is painted before a run; how far the paint has been touched tells how deep the run went. */
__attribute__((noinline)) static void paint(void)
{
    volatile unsigned char place[STACK];
    for (int i = 0; i < STACK; i++) place[i] = PAINT;
}

__attribute__((noinline)) static int touched(void)
{
    /* What paint() and the run have left there is what is asked for. */
    volatile unsigned char place[STACK]; /* cppcheck-suppress [constVariable, unassignedVariable] */
    int clean = 0;
    /* cppcheck-suppress [uninitvar, legacyUninitvar] */
    while (clean < STACK && place[clean] == PAINT) clean++;
    return STACK - clean;
}

/* One run; NULL or a place (count) for each step's time by the wall clock, s. */
static void run(fmi2Component fmu, const job *j, double *each, FILE *outputs)
{
    double started, before = 0.0;
    begin(fmu, j);
    started = now();
    for (long k = 0; k < j->count; k++) {
        if (each) before = wall();
        exchange(fmu, j, k);
        if (each) each[k] = wall() - before;
        if (outputs && k < j->rows) fwrite(row, sizeof *row, j->reals - j->first_output, outputs);
    }
    printf("run %.9g\n", now() - started);
}

static void histogram(const char *name, const double *each, long count)
{
    static long found[BINS];
    double worst = 0.0;
    memset(found, 0, sizeof found);
    for (long k = 0; k < count; k++) {
        double bin = floor(PER_DECADE * log10(1e9 * each[k] + 1.0));
        found[bin < BINS ? (int)bin : BINS - 1]++;
        worst = fmax(worst, each[k]);
    }
    for (int b = 0; b < BINS; b++)
        if (found[b]) printf("%s %d %ld\n", name, b, found[b]);
    printf("%s_worst %.6g\n", name, 1e9 * worst);
}

int main(int argc, char **argv)
{
    static const fmi2CallbackFunctions callbacks;
    require(argc == 17, "arguments: see the head of real_time.c");
    job j = {(unsigned)atoi(argv[6]),
             (unsigned)atoi(argv[7]),
             (unsigned)atoi(argv[8]),
             (unsigned)atoi(argv[9]),
             (unsigned)atoi(argv[11]),
             atoi(argv[10]),
             atof(argv[12]),
             atof(argv[13]),
             atol(argv[14]),
             0,
             NULL};
    int runs = atoi(argv[15]);
    load(argv[1]);
    require(j.inputs <= MOST && j.reals - j.first_output <= MOST, "places");
    for (unsigned i = 0; i < j.inputs; i++) in[i] = i;
    for (unsigned i = j.first_output; i < j.reals; i++) out[i - j.first_output] = i;
    j.signals = read_signals(argv[4], &j);
    size_t size = sizeof(double) * (size_t)j.count;
    double *first = atoi(argv[16]) ? malloc(size) : NULL, *least = first ? malloc(size) : NULL,
           *each = first ? malloc(size) : NULL;
    FILE *outputs = strcmp(argv[5], "-") ? fopen(argv[5], "wb") : NULL;
    fmi2Component fmu = f.fmi2Instantiate("fmu", fmi2CoSimulation, argv[2], argv[3], &callbacks, fmi2False, fmi2False);
    require(fmu != NULL, "fmi2Instantiate");
    paint();
    run(fmu, &j, each, outputs);
    printf("stack %d\n", touched());
    if (outputs) fclose(outputs);
    if (each) memcpy(first, each, size), memcpy(least, each, size);
    long before = taken;
    for (int r = 1; r < runs; r++) {
        run(fmu, &j, each, NULL);
        for (long k = 0; each && k < j.count; k++) least[k] = fmin(least[k], each[k]);
    }
    printf("allocations %ld\n", taken - before);
    if (each) histogram("first", first, j.count), histogram("least", least, j.count);
    f.fmi2FreeInstance(fmu);
    free(each), free(least), free(first), free((void *)j.signals);
    return 0;
}
