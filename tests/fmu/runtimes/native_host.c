/* A plain C host of the native FMU, see test_native_host.py.
 *
 *   native_host LIBRARY GUID RESOURCES INPUTS FIRST_OUTPUT REALS PUSHED COMMAND [ARGUMENTS]
 *
 * LIBRARY: the FMU's; GUID, RESOURCES: for fmi2Instantiate; INPUTS, FIRST_OUTPUT, REALS: value references below which the
 * inputs end, at which the real outputs begin, below which all reals end; PUSHED: the force that moves the structure.
 *
 *   run STEPS FILE       outputs (doubles) after each step of a run that is pushed by a square wave
 *   rollback             saved, serialised and restored in the middle: the rest of the run must repeat to the last bit
 *   threads N            N runs of different pushes, one after the other and then at once in N threads: the same bits
 *   cycles N             instantiate, step and free N times; prints resident kB after each tenth of them
 *   blocks N             the same; prints how many blocks of memory are held after each tenth (compiled with COUNTED)
 *   everything           every function once or more, also called wrongly
 *   walk SEED COUNT      COUNT random calls with hostile values, then a reset, and the run of a fresh instance; prints how
 *                        often each status came, a number that stands for their order, and how many steps succeeded
 *   setters H FIRST STRIDE   each variable, and references that have none, set to each of many hostile values before the start
 *                        and between steps of H s: every STRIDE-th case from FIRST on; prints how often each status came
 *   states SEED COUNT    COUNT states with random pieces replaced, under right checksums; what is taken, steps; prints the same
 *   state WRITE|READ F   writes a serialised state to a file, or reads one (any bytes) and prints the status
 *   messages LOCALE      prints messages with numbers under a locale whose decimal point is a comma
 *   allocations          prints how often fmi2DoStep, fmi2SetReal and fmi2GetReal took memory (compiled with COUNTED)
 *   stack METHOD         prints how many bytes of stack the life of an instance takes, with steps by this method and all messages
 *   two FILE FILE LIBRARY GUID RESOURCES INPUTS FIRST_OUTPUT REALS PUSHED   runs of two FMUs in turns, both loaded RTLD_GLOBAL
 *
 * Exit code 0, or 1 with the reason on stderr.  Compiled with LINKED, the functions are those it is linked with. */
#define _GNU_SOURCE
#include "fmi2Functions.h"

#include <dlfcn.h>
#include <float.h>
#include <locale.h>
#include <math.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define STEP 1e-3 /* s */
#define STEPS 200
#define PUSH 45.0 /* N */
#define MANY 48   /* places in a random call */
#define MOST_THREADS 64
#define MOST_STATES 8

static long taken, given_back; /* calls that took memory, and that freed some, where they are counted */

#if defined(COUNTED) /* in place of the C library's, which the FMU calls, too */
extern void *__libc_malloc(size_t size);
extern void *__libc_calloc(size_t n, size_t size);
extern void *__libc_realloc(void *p, size_t size);
extern void __libc_free(void *p);
void *malloc(size_t size) { return taken++, __libc_malloc(size); }
void *calloc(size_t n, size_t size) { return taken++, __libc_calloc(n, size); }
void free(void *p) { given_back += !!p, __libc_free(p); }
void *realloc(void *p, size_t size)
{
    taken++;
    given_back += !!p; /* the block that it replaces */
    return __libc_realloc(p, size);
}
#endif

/* clang-format off */ /* names in rows */
#define FUNCTIONS(X)                                                                                                         \
    X(fmi2GetTypesPlatform) X(fmi2GetVersion) X(fmi2SetDebugLogging) X(fmi2Instantiate) X(fmi2FreeInstance)                  \
    X(fmi2SetupExperiment) X(fmi2EnterInitializationMode) X(fmi2ExitInitializationMode) X(fmi2Terminate) X(fmi2Reset)        \
    X(fmi2GetReal) X(fmi2GetInteger) X(fmi2GetBoolean) X(fmi2GetString) X(fmi2SetReal) X(fmi2SetInteger) X(fmi2SetBoolean)   \
    X(fmi2SetString) X(fmi2GetFMUstate) X(fmi2SetFMUstate) X(fmi2FreeFMUstate) X(fmi2SerializedFMUstateSize)                 \
    X(fmi2SerializeFMUstate) X(fmi2DeSerializeFMUstate) X(fmi2GetDirectionalDerivative) X(fmi2SetRealInputDerivatives)       \
    X(fmi2GetRealOutputDerivatives) X(fmi2DoStep) X(fmi2CancelStep) X(fmi2GetStatus) X(fmi2GetRealStatus)                    \
    X(fmi2GetIntegerStatus) X(fmi2GetBooleanStatus) X(fmi2GetStringStatus)
/* clang-format on */

typedef struct {
    void *library;
#define FIELD(name) name##TYPE *name;
    FUNCTIONS(FIELD)
#undef FIELD
    const char *guid, *resources;
    fmi2ValueReference inputs, first_output, reals, pushed;
    size_t outputs;
} fmu;

static void give_up(const char *what, const char *why)
{
    fprintf(stderr, "%s: %s\n", what, why);
    exit(1);
}

static void require(int holds, const char *what)
{
    if (!holds) give_up(what, "does not hold");
}

/* ---- Loading ---- */

/* One FMU from seven arguments. */
static fmu load(char **text, int mode)
{
    fmu f;
#if defined(LINKED)
    (void)mode;
    f.library = NULL;
#define LINK(name) f.name = name;
    FUNCTIONS(LINK)
#undef LINK
#else
    f.library = dlopen(text[0], mode);
    if (!f.library) give_up(text[0], dlerror());
#define FIND(name) \
    if (!(*(void **)&f.name = dlsym(f.library, #name))) give_up(#name, "is not exported");
    FUNCTIONS(FIND)
#undef FIND
#endif
    f.guid = text[1];
    f.resources = text[2];
    f.inputs = (fmi2ValueReference)atoi(text[3]);
    f.first_output = (fmi2ValueReference)atoi(text[4]);
    f.reals = (fmi2ValueReference)atoi(text[5]);
    f.pushed = (fmi2ValueReference)atoi(text[6]);
    f.outputs = f.reals - f.first_output;
    return f;
}

static long said; /* messages so far */

/* As a host would: the message is a format. */
static void quiet(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...)
{
    char text[4096];
    va_list arguments;
    (void)e, (void)name, (void)status, (void)category;
    va_start(arguments, message);
    vsnprintf(text, sizeof text, message, arguments);
    va_end(arguments);
    __atomic_add_fetch(&said, 1, __ATOMIC_RELAXED);
}

static void loud(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...)
{
    va_list arguments;
    (void)e, (void)name;
    va_start(arguments, message);
    printf("%d %s ", (int)status, category);
    vprintf(message, arguments);
    putchar('\n');
    va_end(arguments);
}

static const fmi2CallbackFunctions callbacks = {quiet, calloc, free, NULL, NULL}, speaking = {loud, calloc, free, NULL, NULL};

static fmi2Component instantiate(const fmu *f)
{
    fmi2Component c = f->fmi2Instantiate("one", fmi2CoSimulation, f->guid, f->resources, &callbacks, fmi2False, fmi2True);
    require(c != NULL, "fmi2Instantiate");
    return c;
}

static void start(const fmu *f, fmi2Component c)
{
    require(f->fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0) == fmi2OK, "fmi2SetupExperiment");
    require(f->fmi2EnterInitializationMode(c) == fmi2OK, "fmi2EnterInitializationMode");
    require(f->fmi2ExitInitializationMode(c) == fmi2OK, "fmi2ExitInitializationMode");
}

static fmi2Component started(const fmu *f)
{
    fmi2Component c = instantiate(f);
    start(f, c);
    return c;
}

/* ---- Runs ---- */

/* (STEPS at most, outputs) doubles */
static double *rows_for(const fmu *f, int steps)
{
    double *rows = calloc((size_t)steps * f->outputs, sizeof *rows);
    require(rows != NULL, "memory");
    return rows;
}

static void read_outputs(const fmu *f, fmi2Component c, double *row)
{
    fmi2ValueReference vr[1024];
    require(f->outputs <= 1024, "not more outputs than there are places for");
    for (size_t i = 0; i < f->outputs; i++) vr[i] = f->first_output + (fmi2ValueReference)i;
    require(f->fmi2GetReal(c, vr, f->outputs, row) == fmi2OK, "fmi2GetReal");
}

/* Steps first..last-1 under a square wave of the push, N; rows (last - first, outputs) */
static void run(const fmu *f, fmi2Component c, double push, int first, int last, double *rows)
{
    for (int k = first; k < last; k++) {
        double force = k / 50 % 2 ? -push : push;
        require(f->fmi2SetReal(c, &f->pushed, 1, &force) == fmi2OK, "fmi2SetReal");
        require(f->fmi2DoStep(c, k * STEP, STEP, fmi2True) == fmi2OK, "fmi2DoStep");
        read_outputs(f, c, rows + (size_t)(k - first) * f->outputs);
    }
}

static void write_rows(const char *path, const double *rows, size_t count)
{
    FILE *file = fopen(path, "wb");
    if (!file || fwrite(rows, sizeof *rows, count, file) != count || fclose(file)) give_up(path, "cannot be written");
}

static void run_to_file(const fmu *f, int steps, const char *path)
{
    fmi2Component c = started(f);
    double *rows = rows_for(f, steps);
    run(f, c, PUSH, 0, steps, rows);
    write_rows(path, rows, (size_t)steps * f->outputs);
    free(rows);
    f->fmi2FreeInstance(c);
}

static void two(fmu f[2], char **path)
{
    fmi2Component c[2] = {started(f), started(f + 1)};
    double *rows[2] = {rows_for(f, STEPS), rows_for(f + 1, STEPS)};
    for (int k = 0; k < STEPS; k++)
        for (int i = 0; i < 2; i++) run(f + i, c[i], PUSH, k, k + 1, rows[i] + (size_t)k * f[i].outputs);
    for (int i = 0; i < 2; i++) {
        write_rows(path[i], rows[i], STEPS * f[i].outputs);
        free(rows[i]);
        f[i].fmi2FreeInstance(c[i]);
    }
}

/* ---- States ---- */

static char *serialised(const fmu *f, fmi2Component c, size_t *size)
{
    fmi2FMUstate state = NULL;
    require(f->fmi2GetFMUstate(c, &state) == fmi2OK, "fmi2GetFMUstate");
    require(f->fmi2SerializedFMUstateSize(c, state, size) == fmi2OK, "fmi2SerializedFMUstateSize");
    char *bytes = malloc(*size);
    require(f->fmi2SerializeFMUstate(c, state, bytes, *size) == fmi2OK, "fmi2SerializeFMUstate");
    require(f->fmi2FreeFMUstate(c, &state) == fmi2OK && !state, "fmi2FreeFMUstate");
    return bytes;
}

static fmi2Status restore(const fmu *f, fmi2Component c, const char *bytes, size_t size)
{
    fmi2FMUstate state = NULL;
    fmi2Status status = f->fmi2DeSerializeFMUstate(c, bytes, size, &state);
    if (status == fmi2OK) status = f->fmi2SetFMUstate(c, state);
    f->fmi2FreeFMUstate(c, &state);
    return status;
}

static void rollback(const fmu *f)
{
    size_t size, row = f->outputs * sizeof(double);
    int middle = 73;
    fmi2Component c = started(f), other = instantiate(f);
    fmi2FMUstate state = NULL;
    double *first = rows_for(f, STEPS), *again = rows_for(f, STEPS);
    run(f, c, PUSH, 0, middle, first);
    require(f->fmi2GetFMUstate(c, &state) == fmi2OK, "fmi2GetFMUstate");
    char *bytes = serialised(f, c, &size);
    run(f, c, PUSH, middle, STEPS, first);
    require(f->fmi2SetFMUstate(c, state) == fmi2OK, "fmi2SetFMUstate");
    run(f, c, PUSH, middle, STEPS, again);
    require(!memcmp(first, again, (size_t)(STEPS - middle) * row), "rollback to the last bit");
    require(restore(f, other, bytes, size) == fmi2OK, "a serialised state in another instance");
    run(f, other, PUSH, middle, STEPS, again);
    require(!memcmp(first, again, (size_t)(STEPS - middle) * row), "a serialised state to the last bit");
    f->fmi2FreeFMUstate(c, &state);
    f->fmi2FreeInstance(c);
    f->fmi2FreeInstance(other);
    free(bytes);
    free(first);
    free(again);
}

static void state_file(const fmu *f, const char *what, const char *path)
{
    fmi2Component c = started(f);
    size_t size = 0;
    char *bytes, fixed[1 << 16];
    FILE *file = fopen(path, *what == 'W' ? "wb" : "rb");
    if (!file) give_up(path, "cannot be opened");
    if (*what == 'W') {
        double *rows = rows_for(f, STEPS);
        run(f, c, PUSH, 0, STEPS, rows);
        bytes = serialised(f, c, &size);
        fwrite(bytes, 1, size, file);
        free(bytes);
        free(rows);
    } else {
        size = fread(fixed, 1, sizeof fixed, file);
        bytes = malloc(size ? size : 1); /* of the very size, so that valgrind sees what is read beyond it */
        memcpy(bytes, fixed, size);
        printf("%d\n", (int)restore(f, c, bytes, size));
        free(bytes);
    }
    fclose(file);
    f->fmi2FreeInstance(c);
}

/* ---- Threads and cycles ---- */

typedef struct {
    const fmu *f;
    double push, *rows;
} job;

static void *work(void *given)
{
    job *j = given;
    fmi2Component c = started(j->f);
    run(j->f, c, j->push, 0, STEPS, j->rows);
    j->f->fmi2FreeInstance(c);
    return NULL;
}

static void threads(const fmu *f, int n)
{
    job alone[MOST_THREADS], together[MOST_THREADS];
    pthread_t thread[MOST_THREADS];
    require(n > 0 && n <= MOST_THREADS, "number of threads");
    for (int i = 0; i < n; i++) {
        alone[i] = together[i] = (job){f, PUSH * (1 + i % 4), NULL};
        alone[i].rows = rows_for(f, STEPS);
        together[i].rows = rows_for(f, STEPS);
        work(alone + i);
    }
    for (int i = 0; i < n; i++) require(!pthread_create(thread + i, NULL, work, together + i), "pthread_create");
    for (int i = 0; i < n; i++) require(!pthread_join(thread[i], NULL), "pthread_join");
    for (int i = 0; i < n; i++) {
        require(!memcmp(alone[i].rows, together[i].rows, STEPS * f->outputs * sizeof(double)), "threads to the last bit");
        free(alone[i].rows);
        free(together[i].rows);
    }
}

static long resident(void)
{
    long pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (!file || fscanf(file, "%*s %ld", &pages) != 1) give_up("/proc/self/statm", "cannot be read");
    fclose(file);
    return pages * (sysconf(_SC_PAGESIZE) / 1024);
}

static long held(void) { return taken - given_back; }

static void cycles(const fmu *f, long n, long (*measure)(void))
{
    double row[1024];
    require(n >= 10 && n % 10 == 0, "a multiple of ten");
    for (long i = 1; i <= n; i++) {
        fmi2Component c = started(f);
        run(f, c, PUSH, 0, 2, row);
        f->fmi2FreeInstance(c);
        if (i % (n / 10) == 0) printf("%ld ", measure());
    }
    printf("\n");
}

/* ---- Every function ---- */

static void wrong_instances(const fmu *f)
{
    const char *guid = f->guid, *at = f->resources;
    require(!f->fmi2Instantiate("one", fmi2CoSimulation, "%s%n#", at, &callbacks, 0, 1), "a wrong GUID is refused");
    require(!f->fmi2Instantiate("one", fmi2ModelExchange, guid, at, &callbacks, 0, 1), "model exchange is refused");
    require(!f->fmi2Instantiate("", fmi2CoSimulation, guid, at, &callbacks, 0, 1), "an empty name is refused");
    require(!f->fmi2Instantiate(NULL, fmi2CoSimulation, guid, at, NULL, 0, 1), "no name is refused");
    require(!f->fmi2Instantiate("one", fmi2CoSimulation, guid, "file:///no/where", &callbacks, 0, 1), "no resources");
    require(!f->fmi2Instantiate("one", fmi2CoSimulation, NULL, NULL, &callbacks, 0, 1), "null pointers are refused");
    f->fmi2FreeInstance(NULL);
}

static void refused_states(const fmu *f, fmi2Component c)
{
    size_t size;
    char *bytes = serialised(f, c, &size);
    for (size_t n = 0; n < size; n += 1 + n / 3) { /* copies of the very size: what is read beyond them is seen */
        char *cut = malloc(n + 1);
        memcpy(cut, bytes, n);
        require(restore(f, c, cut, n) == fmi2Discard, "a cut state is refused");
        free(cut);
    }
    for (size_t n = 0; n < size; n += 97) {
        bytes[n] ^= 4;
        require(restore(f, c, bytes, size) == fmi2Discard, "a damaged state is refused");
        bytes[n] ^= 4;
    }
    require(restore(f, c, bytes, size) == fmi2OK, "a good state");
    free(bytes);
}

static void derivatives(const fmu *f, fmi2Component c)
{
    fmi2ValueReference in[2] = {f->pushed, f->pushed}, out = f->first_output;
    fmi2Integer order[2] = {1, 2}, one = 1;
    fmi2Real slope[2] = {20.0, -300.0}, rate;
    require(f->fmi2SetRealInputDerivatives(c, in, 2, order, slope) == fmi2OK, "fmi2SetRealInputDerivatives");
    require(f->fmi2GetRealOutputDerivatives(c, &out, 1, &one, &rate) == fmi2OK && isfinite(rate), "output derivatives");
}

static void statuses(const fmu *f, fmi2Component c)
{
    fmi2Status s;
    fmi2Real r;
    fmi2Integer i;
    fmi2Boolean b;
    fmi2String t;
    require(f->fmi2GetStatus(c, fmi2DoStepStatus, &s) == fmi2Discard, "fmi2GetStatus");
    require(f->fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &r) == fmi2OK && isfinite(r), "fmi2GetRealStatus");
    require(f->fmi2GetIntegerStatus(c, fmi2DoStepStatus, &i) == fmi2Discard, "fmi2GetIntegerStatus");
    require(f->fmi2GetBooleanStatus(c, fmi2Terminated, &b) == fmi2OK && !b, "fmi2GetBooleanStatus");
    require(f->fmi2GetStringStatus(c, fmi2PendingStatus, &t) == fmi2Discard, "fmi2GetStringStatus");
}

static void failed_step(const fmu *f, fmi2Component c, double *row)
{
    double huge = 1e300, bad = NAN, zero = 0.0;
    require(f->fmi2SetReal(c, &f->pushed, 1, &bad) == fmi2Discard, "NaN is refused");
    require(f->fmi2SetReal(c, &f->pushed, 1, &huge) == fmi2OK, "a large force");
    require(f->fmi2DoStep(c, STEPS * STEP, STEP, fmi2True) == fmi2Discard, "a step that cannot be completed");
    require(f->fmi2SetReal(c, &f->pushed, 1, &zero) == fmi2OK, "no force");
    run(f, c, PUSH, STEPS, STEPS + 1, row);
}

static void everything(const fmu *f)
{
    double *rows = rows_for(f, STEPS + 1), *again = rows_for(f, STEPS);
    fmi2String names[2] = {"logEvents", "no such %d"};
    require(!strcmp(f->fmi2GetVersion(), "2.0") && !strcmp(f->fmi2GetTypesPlatform(), "default"), "versions");
    wrong_instances(f);
    fmi2Component c = instantiate(f);
    refused_states(f, c); /* also before the start, where little is set */
    require(f->fmi2SetDebugLogging(c, 1, 2, names) == fmi2Warning, "fmi2SetDebugLogging");
    start(f, c);
    run(f, c, PUSH, 0, STEPS, rows);
    derivatives(f, c);
    refused_states(f, c);
    statuses(f, c);
    failed_step(f, c, rows + STEPS * f->outputs);
    require(f->fmi2CancelStep(c) == fmi2Discard && f->fmi2DoStep(c, -1.0, STEP, fmi2True) == fmi2Error,
            "refused, and an error");
    require(f->fmi2Terminate(c) == fmi2Error, "an error stays");
    require(f->fmi2Reset(c) == fmi2OK, "fmi2Reset");
    start(f, c);
    run(f, c, PUSH, 0, STEPS, again);
    require(!memcmp(rows, again, STEPS * f->outputs * sizeof(double)), "the same run after a reset");
    require(f->fmi2Terminate(c) == fmi2OK, "fmi2Terminate");
    require(f->fmi2GetDirectionalDerivative(c, NULL, 0, NULL, 0, NULL, NULL) == fmi2Discard, "fmi2GetDirectionalDerivative");
    f->fmi2FreeInstance(c);
    free(rows);
    free(again);
}

/* ---- Random calls ---- */

static uint64_t chance; /* xorshift */

static uint32_t draw(uint32_t below)
{
    chance ^= chance << 13;
    chance ^= chance >> 7;
    chance ^= chance << 17;
    return (uint32_t)(chance >> 32) % below;
}

/* No force between 1e10 and 1e300 N, say: a step under it may take seconds until the solver's limit of work ends it. */
static double hostile(void)
{
    static const double values[] = {0.0,    -0.0,    1.0,      -1.0, 0.3,      2.5,       50.0, -80.0, 1e-3, 1e-300,
                                    5e-324, DBL_MAX, -DBL_MAX, NAN,  INFINITY, -INFINITY, 3.0,  1e-14, 0.1,  7.9};
    return values[draw(sizeof values / sizeof *values)];
}

typedef struct {
    fmi2ValueReference vr[MANY];
    double real[MANY];
    fmi2Integer whole[MANY];
    fmi2String text[MANY];
    size_t n;
} places;

/* Arrays for n places; most of the references exist. */
static void fill(const fmu *f, places *p)
{
    uint32_t end = draw(4) ? f->inputs : draw(2) ? f->reals : f->reals + 12;
    p->n = draw(9) ? draw(3) : draw(MANY);
    for (size_t i = 0; i < MANY; i++) {
        p->vr[i] = draw(200) ? draw(end) : (uint32_t)chance;
        p->real[i] = draw(6) ? (double)draw(100) * 0.01 : hostile();
        p->whole[i] = draw(9) ? (fmi2Integer)draw(4) : (fmi2Integer)chance;
        p->text[i] = draw(2) ? "logEvents" : NULL;
    }
}

/* A null pointer now and then. */
#define MAYBE(pointer) (draw(100) ? (pointer) : NULL)

/* A force that rises without bound within a step passes through those that take long, see hostile(). */
static void tame(places *p)
{
    for (size_t i = 0; i < MANY; i++)
        if (fabs(p->real[i]) > 1e3) p->real[i] = NAN;
}

typedef struct {
    const fmu *f;
    fmi2Component c;
    fmi2FMUstate state[MOST_STATES];
    double time; /* s, guessed */
    long steps;  /* that succeeded */
} walker;

static fmi2Status random_value_call(walker *w, places *p)
{
    const fmu *f = w->f;
    fmi2Component c = w->c;
    const fmi2ValueReference *vr = MAYBE(p->vr);
    switch (draw(10)) {
    case 0: return f->fmi2GetReal(c, vr, p->n, MAYBE(p->real));
    case 1: return f->fmi2GetInteger(c, vr, p->n, MAYBE(p->whole));
    case 2: return f->fmi2GetBoolean(c, vr, p->n, p->whole);
    case 3: return f->fmi2GetString(c, vr, p->n, p->text);
    case 4: return f->fmi2SetInteger(c, vr, p->n, MAYBE(p->whole));
    case 5: return draw(2) ? f->fmi2SetBoolean(c, vr, p->n, p->whole) : f->fmi2SetString(c, vr, p->n, p->text);
    case 6: tame(p); return f->fmi2SetRealInputDerivatives(c, vr, p->n, MAYBE(p->whole), MAYBE(p->real));
    case 7: return f->fmi2GetRealOutputDerivatives(c, vr, p->n, MAYBE(p->whole), MAYBE(p->real));
    case 8: return f->fmi2GetDirectionalDerivative(c, vr, p->n, p->vr, p->n, p->real, p->real);
    default: return f->fmi2SetReal(c, vr, p->n, MAYBE(p->real));
    }
}

/* Bytes of a state, sometimes damaged. */
static fmi2Status random_bytes(walker *w, fmi2FMUstate *slot)
{
    const fmu *f = w->f;
    size_t size = 0;
    fmi2Status status = f->fmi2SerializedFMUstateSize(w->c, *slot, MAYBE(&size));
    if (status != fmi2OK || !size) return status;
    size_t given = draw(4) ? size : draw((uint32_t)size + 1);
    char *bytes = malloc(given + 1);
    status = f->fmi2SerializeFMUstate(w->c, *slot, bytes, given);
    if (status == fmi2OK && draw(3) == 0) bytes[draw((uint32_t)given)] ^= (char)(1 << draw(8));
    if (status == fmi2OK) {
        fmi2FMUstate copy = NULL;
        status = f->fmi2DeSerializeFMUstate(w->c, bytes, given, &copy);
        if (status == fmi2OK && draw(2)) status = f->fmi2SetFMUstate(w->c, copy);
        f->fmi2FreeFMUstate(w->c, &copy);
    }
    free(bytes);
    return status;
}

static fmi2Status random_state_call(walker *w)
{
    const fmu *f = w->f;
    fmi2FMUstate *slot = w->state + draw(MOST_STATES);
    switch (draw(6)) {
    case 0: return f->fmi2GetFMUstate(w->c, MAYBE(slot));
    case 1: return f->fmi2FreeFMUstate(w->c, MAYBE(slot));
    case 2: return random_bytes(w, slot);
    default: return *slot ? f->fmi2SetFMUstate(w->c, *slot) : f->fmi2GetFMUstate(w->c, slot);
    }
}

/* The FMU's own time, mostly, so that steps succeed. */
static double point(walker *w)
{
    double t = w->time;
    w->f->fmi2GetRealStatus(w->c, fmi2LastSuccessfulTime, &t);
    return w->time = t;
}

static fmi2Status random_step(walker *w)
{
    static const double size[] = {1e-12, 1e-300, 0.0, -1e-3, NAN, INFINITY};
    double h = draw(20) ? (draw(5) ? 1e-3 : 0.01) : size[draw(sizeof size / sizeof *size)];
    double at = draw(20) ? point(w) : hostile();
    fmi2Status status = w->f->fmi2DoStep(w->c, at, h, draw(2) ? fmi2True : fmi2False);
    w->steps += status == fmi2OK;
    return status;
}

static fmi2Status random_mode_call(walker *w, places *p)
{
    const fmu *f = w->f;
    switch (draw(16)) {
    case 0: return f->fmi2SetupExperiment(w->c, draw(2), hostile(), draw(2) ? 0.0 : hostile(), draw(8) == 0, hostile());
    case 1:
    case 2: return f->fmi2EnterInitializationMode(w->c);
    case 3:
    case 4: return f->fmi2ExitInitializationMode(w->c);
    case 5: return draw(4) ? fmi2OK : f->fmi2Terminate(w->c);
    case 6: return f->fmi2Reset(w->c);
    case 7: return draw(6) ? fmi2OK : f->fmi2CancelStep(w->c);
    case 8: return f->fmi2SetDebugLogging(w->c, draw(2), draw(3) ? 0 : p->n, MAYBE(p->text));
    case 9: return f->fmi2GetStatus(w->c, (fmi2StatusKind)draw(5), MAYBE((fmi2Status *)p->whole));
    case 10: return f->fmi2GetRealStatus(w->c, (fmi2StatusKind)draw(5), MAYBE(p->real));
    case 11: return f->fmi2GetBooleanStatus(w->c, (fmi2StatusKind)draw(5), MAYBE(p->whole));
    case 12: return f->fmi2GetIntegerStatus(w->c, (fmi2StatusKind)draw(5), MAYBE(p->whole));
    case 13: return f->fmi2GetStringStatus(w->c, (fmi2StatusKind)draw(5), MAYBE(p->text));
    default: return fmi2OK;
    }
}

/* Out of the state of error, in which little can be tried: back to a run, so that the walk goes far. */
static void recover(walker *w)
{
    require(w->f->fmi2Reset(w->c) == fmi2OK, "fmi2Reset");
    if (draw(5) == 0) return;
    start(w->f, w->c);
    w->time = 0.0;
}

static void walk(const fmu *f, uint64_t seed, long count)
{
    walker w = {f, started(f), {NULL}, 0.0, 0};
    double *rows = rows_for(f, STEPS), *fresh = rows_for(f, STEPS);
    long seen[4] = {0};
    unsigned long order = 5381; /* of all statuses, one after the other */
    places p;
    run(f, w.c, PUSH, 0, STEPS, fresh);
    chance = 0x9e3779b97f4a7c15u ^ (seed * 0xbf58476d1ce4e5b9u);
    for (int i = 0; i < 9; i++) draw(2);
    for (long i = 0; i < count; i++) {
        uint32_t kind = draw(10);
        fill(f, &p);
        fmi2Status status = kind < 4   ? random_step(&w)
                            : kind < 7 ? random_value_call(&w, &p)
                            : kind < 8 ? random_state_call(&w)
                                       : random_mode_call(&w, &p);
        require(status >= fmi2OK && status <= fmi2Error, "no status worse than fmi2Error");
        seen[status]++;
        order = (order * 33 + (unsigned long)status) % 1000000007;
        if (status == fmi2Error && draw(3)) recover(&w);
    }
    require(f->fmi2Reset(w.c) == fmi2OK, "fmi2Reset");
    f->fmi2SetDebugLogging(w.c, fmi2True, 0, NULL);
    start(f, w.c);
    run(f, w.c, PUSH, 0, STEPS, rows);
    require(!memcmp(rows, fresh, STEPS * f->outputs * sizeof(double)), "the run of a fresh instance, to the last bit");
    for (int i = 0; i < MOST_STATES; i++) f->fmi2FreeFMUstate(w.c, w.state + i);
    f->fmi2FreeInstance(w.c);
    free(rows);
    free(fresh);
    printf("%ld %ld %ld %ld %lu %ld\n", seen[0], seen[1], seen[2], seen[3], order, w.steps);
}

/* ---- Every value of every variable, and forged states ---- */

static const double extreme[] = {0.0,       -0.0,  1.0,   -1.0,  5e-324, -5e-324, 1e-300,   1e-12, 1e12,
                                 1e154,     1e155, 1e300, 1e308, -1e308, DBL_MAX, -DBL_MAX, NAN,   INFINITY,
                                 -INFINITY, 1e-3,  0.5,   2.0,   8.0,    1e3,     -1e6};
static const fmi2Integer extreme_whole[] = {0, 1, 2, 3, 4, 5, 6, 7, -1, 100, 65536, INT32_MAX, INT32_MIN};
#define EXTREMES (sizeof extreme / sizeof *extreme)
#define EXTREME_WHOLES (sizeof extreme_whole / sizeof *extreme_whole)

typedef struct {
    const fmu *f;
    double h, *row;
    long seen[4];
} trial;

static int happened(trial *t, fmi2Status status)
{
    require(status >= fmi2OK && status <= fmi2Error, "no status worse than fmi2Error");
    t->seen[status]++;
    return status <= fmi2Warning;
}

/* A step, all that can be read after it, and the state as bytes.  What is fmi2OK is finite. */
static void used(trial *t, fmi2Component c)
{
    const fmu *f = t->f;
    fmi2ValueReference vr[1024];
    fmi2Integer one[1024];
    double at = 0.0;
    size_t size;
    f->fmi2GetRealStatus(c, fmi2LastSuccessfulTime, &at);
    int taken_here = happened(t, f->fmi2DoStep(c, at, t->h, fmi2True));
    for (size_t i = 0; i < f->outputs; i++) vr[i] = f->first_output + (fmi2ValueReference)i, one[i] = 1;
    if (f->fmi2GetReal(c, vr, f->outputs, t->row) == fmi2OK && taken_here)
        for (size_t i = 0; i < f->outputs; i++) require(isfinite(t->row[i]), "outputs after fmi2OK are finite");
    if (f->fmi2GetRealOutputDerivatives(c, vr, f->outputs, one, t->row) == fmi2OK)
        for (size_t i = 0; i < f->outputs; i++) require(isfinite(t->row[i]), "derivatives with fmi2OK are finite");
    free(serialised(f, c, &size));
}

/* Case n of a reference: a value, real or whole, before the start or after it. */
static void set_once(trial *t, fmi2Component c, fmi2FMUstate run_on, fmi2ValueReference vr, size_t n)
{
    const fmu *f = t->f;
    int late = n >= EXTREMES + EXTREME_WHOLES;
    n %= EXTREMES + EXTREME_WHOLES;
    if (late) require(f->fmi2SetFMUstate(c, run_on) == fmi2OK, "fmi2SetFMUstate");
    else require(f->fmi2Reset(c) == fmi2OK, "fmi2Reset");
    fmi2Status status =
        n < EXTREMES ? f->fmi2SetReal(c, &vr, 1, extreme + n) : f->fmi2SetInteger(c, &vr, 1, extreme_whole + (n - EXTREMES));
    if (!happened(t, status)) return;
    if (!late) {
        f->fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0);
        if (f->fmi2EnterInitializationMode(c) != fmi2OK || !happened(t, f->fmi2ExitInitializationMode(c))) return;
    }
    used(t, c);
}

static void print_seen(const trial *t) { printf("%ld %ld %ld %ld\n", t->seen[0], t->seen[1], t->seen[2], t->seen[3]); }

static void setters(const fmu *f, double h, long first, long stride)
{
    trial t = {f, h, rows_for(f, 1), {0}};
    fmi2Component c = started(f);
    fmi2FMUstate run_on = NULL;
    run(f, c, PUSH, 0, 1, t.row);
    require(f->fmi2GetFMUstate(c, &run_on) == fmi2OK, "fmi2GetFMUstate");
    long each = 2 * (long)(EXTREMES + EXTREME_WHOLES), all = (long)(f->reals + 12) * each;
    require(stride > 0 && first >= 0, "the cases");
    for (long k = first; k < all; k += stride) set_once(&t, c, run_on, (fmi2ValueReference)(k / each), (size_t)(k % each));
    require(f->fmi2SetFMUstate(c, run_on) == fmi2OK, "fmi2SetFMUstate");
    used(&t, c);
    f->fmi2FreeFMUstate(c, &run_on);
    f->fmi2FreeInstance(c);
    free(t.row);
    print_seen(&t);
}

/* FNV-1a */
static uint64_t hash(uint64_t sum, const char *bytes, size_t size)
{
    for (size_t i = 0; i < size; i++) sum = (sum ^ (unsigned char)bytes[i]) * 1099511628211u;
    return sum;
}

#define HEAD 72 /* bytes of the runtime's own part, the last 8 of which are its checksum; the kernel's ends with one */

static void sign(char *bytes, size_t size)
{
    uint64_t sum = hash(14695981039346656037u, bytes + HEAD, size - HEAD - sizeof sum);
    memcpy(bytes + size - sizeof sum, &sum, sizeof sum);
    memset(bytes + HEAD - sizeof sum, 0, sizeof sum);
    sum = hash(14695981039346656037u, bytes, size);
    memcpy(bytes + HEAD - sizeof sum, &sum, sizeof sum);
}

/* One to four pieces from another state, of hostile numbers, or of chance. */
static void forge(char *bytes, const char *other, size_t size)
{
    for (uint32_t i = 1 + draw(4); i > 0; i--) {
        size_t at = draw(8) ? 8 * draw((uint32_t)(size / 8)) : draw((uint32_t)size), n = 1 + draw(draw(4) ? 16 : 400);
        uint32_t kind = draw(4);
        if (at + n > size) n = size - at;
        if (kind == 0) memcpy(bytes + at, other + at, n);
        else if (kind == 1 && at + 8 <= size) memcpy(bytes + at, extreme + draw(EXTREMES), 8);
        else if (kind == 2 && at + 4 <= size) memcpy(bytes + at, extreme_whole + draw(EXTREME_WHOLES), 4);
        else
            for (size_t k = 0; k < n; k++) bytes[at + k] = (char)draw(256);
    }
    sign(bytes, size);
}

static void states(const fmu *f, uint64_t seed, long count)
{
    trial t = {f, 1e-6, rows_for(f, STEPS), {0}};
    fmi2Component c = started(f), spare = instantiate(f);
    size_t size;
    char *fresh = serialised(f, spare, &size), *good, *other, *bad = malloc(size);
    run(f, c, PUSH, 0, 20, t.row);
    good = serialised(f, c, &size);
    run(f, c, PUSH, 20, STEPS, t.row);
    other = serialised(f, c, &size);
    memcpy(bad, good, size);
    sign(bad, size);
    require(!memcmp(bad, good, size), "the checksums are those of the FMU");
    chance = 0x9e3779b97f4a7c15u ^ (seed * 0xbf58476d1ce4e5b9u);
    for (int i = 0; i < 9; i++) draw(2);
    for (long i = 0; i < count; i++) {
        memcpy(bad, draw(5) ? good : fresh, size);
        forge(bad, other, size);
        if (happened(&t, restore(f, c, bad, size))) used(&t, c);
    }
    require(restore(f, c, good, size) == fmi2OK, "a good state");
    run(f, c, PUSH, 20, STEPS, t.row);
    char *again = serialised(f, c, &size);
    require(!memcmp(again, other, size), "the run from a good state, to the last bit");
    f->fmi2FreeInstance(c);
    f->fmi2FreeInstance(spare);
    free(fresh), free(good), free(other), free(bad), free(again), free(t.row);
    print_seen(&t);
}

/* ---- Messages and memory ---- */

static void messages(const fmu *f, const char *locale)
{
    double bad = -0.25;
    fmi2ValueReference length = f->inputs - 1; /* the last string's rate; the one before the rates is a rest length */
    require(setlocale(LC_ALL, locale) && *localeconv()->decimal_point == ',', "a locale with a decimal comma");
    fmi2Component c = f->fmi2Instantiate("one", fmi2CoSimulation, f->guid, f->resources, &speaking, fmi2False, fmi2True);
    require(c != NULL, "fmi2Instantiate");
    f->fmi2SetupExperiment(c, fmi2True, 0.75, 0.5, fmi2False, 0.0);
    f->fmi2EnterInitializationMode(c);
    f->fmi2ExitInitializationMode(c);
    for (fmi2ValueReference i = 0; i < f->inputs; i++) f->fmi2SetReal(c, &i, 1, &bad); /* rest lengths must not be negative */
    bad = NAN;
    f->fmi2SetReal(c, &length, 1, &bad);
    for (int k = 0; k < 400; k++) f->fmi2DoStep(c, 0.5 + 0.5 * k * STEP, 0.5 * STEP, fmi2True);
    f->fmi2DoStep(c, 0.125, 0.25, fmi2True);
    f->fmi2FreeInstance(c);
}

/* Steps with transitions and messages, all inputs set and all outputs read. */
static void allocations(const fmu *f)
{
    fmi2Component c = started(f);
    double *rows = rows_for(f, STEPS);
    long before = taken, messages_before = said;
    run(f, c, PUSH, 0, STEPS, rows);
    printf("%ld %ld\n", taken - before, said - messages_before);
    free(rows);
    f->fmi2FreeInstance(c);
}

/* ---- Stack ---- */

#define STACK (256 * 1024)
#define UNTOUCHED 0xa5

typedef struct {
    const fmu *f;
    fmi2Integer method; /* -1: there is no instance, only a thread */
} life;

static void silent(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...)
{
    (void)e, (void)name, (void)status, (void)category, (void)message;
}

/* Outputs are read one by one: the host takes little of the stack itself. */
static void *live(void *given)
{
    static const fmi2CallbackFunctions hears_nothing = {silent, calloc, free, NULL, NULL};
    const life *l = given;
    const fmu *f = l->f;
    const fmi2ValueReference method = f->reals;
    double value;
    if (l->method < 0) return NULL;
    fmi2Component c = f->fmi2Instantiate("one", fmi2CoSimulation, f->guid, f->resources, &hears_nothing, fmi2False, fmi2True);
    require(c && f->fmi2SetInteger(c, &method, 1, &l->method) == fmi2OK, "fmi2SetInteger");
    start(f, c);
    for (int k = 0; k < STEPS; k++) {
        double force = k / 50 % 2 ? -PUSH : PUSH;
        require(f->fmi2SetReal(c, &f->pushed, 1, &force) == fmi2OK, "fmi2SetReal");
        require(f->fmi2DoStep(c, k * STEP, STEP, fmi2True) == fmi2OK, "fmi2DoStep");
        for (fmi2ValueReference vr = f->first_output; vr < f->reals; vr++) f->fmi2GetReal(c, &vr, 1, &value);
    }
    f->fmi2Terminate(c);
    f->fmi2FreeInstance(c);
    return NULL;
}

static long touched(const fmu *f, fmi2Integer method)
{
    void *memory = NULL;
    life l = {f, method};
    pthread_attr_t attributes;
    pthread_t thread;
    require(!posix_memalign(&memory, 4096, STACK), "memory");
    memset(memory, UNTOUCHED, STACK);
    pthread_attr_init(&attributes);
    require(!pthread_attr_setstack(&attributes, memory, STACK), "pthread_attr_setstack");
    require(!pthread_create(&thread, &attributes, live, &l) && !pthread_join(thread, NULL), "a thread");
    long at = 0;
    while (at < STACK && ((const unsigned char *)memory)[at] == UNTOUCHED) at++;
    free(memory);
    return STACK - at;
}

static void stack_used(const fmu *f, fmi2Integer method)
{
    long thread = touched(f, -1);
    printf("%ld\n", touched(f, method) - thread);
}

int main(int argc, char **argv)
{
    if (argc < 9) give_up("native_host", "arguments are missing");
    const char *command = argv[8], *first = argc > 9 ? argv[9] : "", *second = argc > 10 ? argv[10] : "";
    int both = !strcmp(command, "two");
    fmu f[2];
    f[0] = load(argv + 1, both ? RTLD_NOW | RTLD_GLOBAL : RTLD_NOW | RTLD_LOCAL);
    if (both && argc == 18) f[1] = load(argv + 11, RTLD_NOW | RTLD_GLOBAL), two(f, argv + 9);
    else if (!strcmp(command, "run")) run_to_file(f, atoi(first), second);
    else if (!strcmp(command, "rollback")) rollback(f);
    else if (!strcmp(command, "threads")) threads(f, atoi(first));
    else if (!strcmp(command, "cycles")) cycles(f, atol(first), resident);
    else if (!strcmp(command, "blocks")) cycles(f, atol(first), held);
    else if (!strcmp(command, "everything")) everything(f);
    else if (!strcmp(command, "walk")) walk(f, strtoull(first, NULL, 10), atol(second));
    else if (!strcmp(command, "setters")) setters(f, atof(first), atol(second), argc > 11 ? atol(argv[11]) : 1);
    else if (!strcmp(command, "states")) states(f, strtoull(first, NULL, 10), atol(second));
    else if (!strcmp(command, "stack")) stack_used(f, atoi(first));
    else if (!strcmp(command, "state")) state_file(f, first, second);
    else if (!strcmp(command, "messages")) messages(f, first);
    else if (!strcmp(command, "allocations")) allocations(f);
    else give_up(command, "is not a command, or its arguments are wrong");
    for (int i = 0; i <= both; i++)
        if (f[i].library) dlclose(f[i].library);
    return 0;
}
