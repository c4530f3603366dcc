/* A C host of the Python FMU that starts and ends in many ways, see test_python_host.py.
 *
 *   python_host LIBRARY GUID RESOURCES PUSHED READ WAY [LIBPYTHON]
 *
 * LIBRARY: the FMU's; GUID, RESOURCES: for fmi2Instantiate; PUSHED, READ: value references of a force and of an output.
 * Prints the output after STEPS steps, as hexadecimal digits, for each run that the way has.
 *
 *   freed      instantiate, run, free, unload the library
 *   kept       the same without fmi2FreeInstance, ended by exit()
 *   unloaded   not freed, but unloaded
 *   again      loaded, run, freed and unloaded three times
 *   resident   freed, not unloaded
 *   last       freed by a function that exit() calls
 *   handed     instantiated in one thread, run in a second, freed in a third; the first two have ended
 *   side       everything in one thread that ends, while main waits
 *   race       four threads instantiate, run and free at once
 *   racing     the same for two FMUs, each of which has its own library: LIBPYTHON is the second one's LIBRARY
 *   failed     a wrong GUID first, then a run
 *   forked     a child that has been forked after a run and frees the instance, and a run of its parent
 *
 * With LIBPYTHON in the process before:
 *   local      loaded for the host alone, not started
 *   global     loaded for all, not started
 *   embedded   started by the host, which gives Python's lock back
 *   held       started by the host, which holds Python's lock throughout
 *   ended      embedded, and the host ends Python after the run, before it frees the instance
 *   embedded_last   embedded, and the host ends Python after all
 *
 * Exit code 0, or 1 with the reason on stderr. */
#define _GNU_SOURCE
#include "fmi2Functions.h"

#include <dlfcn.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#define STEPS 20
#define STEP 1e-3 /* s */
#define PUSH 45.0 /* N */
#define THREADS 4

/* clang-format off */ /* names in rows */
#define FUNCTIONS(X)                                                                                            \
    X(fmi2Instantiate) X(fmi2FreeInstance) X(fmi2SetupExperiment) X(fmi2EnterInitializationMode)                \
    X(fmi2ExitInitializationMode) X(fmi2SetReal) X(fmi2GetReal) X(fmi2DoStep) X(fmi2Reset)
/* clang-format on */

typedef struct {
    char **text; /* arguments from LIBRARY on */
    void *library;
    fmi2Component c;
    double found;
#define FIELD(name) name##TYPE *name;
    FUNCTIONS(FIELD)
#undef FIELD
} fmu;

static void require(int holds, const char *what)
{
    if (holds) return;
    fprintf(stderr, "%s: does not hold\n", what);
    exit(1);
}

static void say(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...)
{
    va_list arguments;
    (void)e, (void)name, (void)status, (void)category;
    va_start(arguments, message);
    vfprintf(stderr, message, arguments);
    fputc('\n', stderr);
    va_end(arguments);
}

static const fmi2CallbackFunctions callbacks = {say, calloc, free, NULL, NULL};

static fmu load(char **text)
{
    fmu f;
    memset(&f, 0, sizeof f);
    f.text = text;
    f.library = dlopen(text[0], RTLD_NOW | RTLD_LOCAL);
    if (!f.library) fprintf(stderr, "%s\n", dlerror());
    require(f.library != NULL, "dlopen");
#define FIND(name) require((*(void **)&f.name = dlsym(f.library, #name)) != NULL, #name);
    FUNCTIONS(FIND)
#undef FIND
    return f;
}

static void instantiate(fmu *f)
{
    f->c = f->fmi2Instantiate("one", fmi2CoSimulation, f->text[1], f->text[2], &callbacks, fmi2False, fmi2False);
    require(f->c != NULL, "fmi2Instantiate");
}

static void run(fmu *f)
{
    fmi2ValueReference pushed = (fmi2ValueReference)atoi(f->text[3]), read = (fmi2ValueReference)atoi(f->text[4]);
    double push = PUSH;
    require(f->fmi2SetupExperiment(f->c, fmi2False, 0.0, 0.0, fmi2False, 0.0) == fmi2OK, "fmi2SetupExperiment");
    require(f->fmi2EnterInitializationMode(f->c) == fmi2OK, "fmi2EnterInitializationMode");
    require(f->fmi2ExitInitializationMode(f->c) == fmi2OK, "fmi2ExitInitializationMode");
    require(f->fmi2SetReal(f->c, &pushed, 1, &push) == fmi2OK, "fmi2SetReal");
    for (int k = 0; k < STEPS; k++) require(f->fmi2DoStep(f->c, k * STEP, STEP, fmi2True) == fmi2OK, "fmi2DoStep");
    require(f->fmi2GetReal(f->c, &read, 1, &f->found) == fmi2OK, "fmi2GetReal");
}

static void print(const fmu *f) { printf("%a\n", f->found); }

static void finish(fmu *f)
{
    f->fmi2FreeInstance(f->c);
    f->c = NULL;
}

static void *run_thread(void *f) { return run(f), NULL; }
static void *instantiate_thread(void *f) { return instantiate(f), NULL; }
static void *finish_thread(void *f) { return finish(f), NULL; }

static void *whole_thread(void *f)
{
    instantiate(f);
    run(f);
    finish(f);
    return NULL;
}

static void in_thread(void *(*work)(void *), fmu *f)
{
    pthread_t thread;
    require(!pthread_create(&thread, NULL, work, f) && !pthread_join(thread, NULL), "a thread");
}

static void race(fmu *f, int count)
{
    pthread_t thread[2 * THREADS];
    for (int i = 0; i < count; i++) require(!pthread_create(thread + i, NULL, whole_thread, f + i), "pthread_create");
    for (int i = 0; i < count; i++) require(!pthread_join(thread[i], NULL), "pthread_join");
    for (int i = 0; i < count; i++) print(f + i);
}

static fmu kept;

static void finish_kept(void) { finish(&kept); }

/* ---- A host that has Python ---- */

static void *python;

static void *symbol(const char *name)
{
    void *found = dlsym(python, name);
    require(found != NULL, name);
    return found;
}

static void call(const char *name)
{
    void (*function)(void);
    *(void **)&function = symbol(name);
    function();
}

static void start_python(const char *way, const char *path)
{
    python = dlopen(path, RTLD_NOW | (strcmp(way, "local") ? RTLD_GLOBAL : RTLD_LOCAL));
    if (!python) fprintf(stderr, "%s\n", dlerror());
    require(python != NULL, "dlopen of Python");
    if (!strcmp(way, "local") || !strcmp(way, "global")) return;
    call("Py_Initialize");
    if (strcmp(way, "held")) call("PyEval_SaveThread");
}

static void end_python(void)
{
    call("PyGILState_Ensure");
    call("Py_Finalize");
}

static void with_python(fmu *f, const char *way)
{
    instantiate(f);
    run(f);
    print(f);
    if (!strcmp(way, "ended")) {
        end_python();
        require(f->fmi2Reset(f->c) == fmi2Error, "an error after the end of Python");
    }
    finish(f);
    if (!strcmp(way, "embedded_last")) end_python();
}

static void forked(fmu *f)
{
    int status = 1;
    instantiate(f);
    run(f);
    fflush(stdout);
    pid_t child = fork();
    if (child == 0) {
        finish(f);
        exit(0);
    }
    require(waitpid(child, &status, 0) == child && status == 0, "the child's exit code");
    print(f);
    finish(f);
}

int main(int argc, char **argv)
{
    require(argc > 6, "the number of arguments");
    const char *way = argv[6], *other = argc > 7 ? argv[7] : NULL;
    int racing = !strcmp(way, "racing");
    if (other && !racing) start_python(way, other);
    fmu f = load(argv + 1), many[2 * THREADS];
    if (other && !racing) {
        with_python(&f, way);
    } else if (!strcmp(way, "again")) {
        for (int i = 0; i < 3; i++) {
            whole_thread(&f);
            print(&f);
            dlclose(f.library);
            f = load(argv + 1);
        }
    } else if (!strcmp(way, "handed")) {
        in_thread(instantiate_thread, &f);
        in_thread(run_thread, &f);
        in_thread(finish_thread, &f);
        print(&f);
    } else if (!strcmp(way, "side")) {
        in_thread(whole_thread, &f);
        print(&f);
    } else if (!strcmp(way, "race") || racing) {
        char *second[] = {racing ? argv[7] : argv[1], argv[2], argv[3], argv[4], argv[5]};
        for (int i = 0; i < 2 * THREADS; i++) many[i] = load(i % 2 ? second : argv + 1);
        race(many, 2 * THREADS);
    } else if (!strcmp(way, "forked")) {
        forked(&f);
    } else {
        if (!strcmp(way, "failed"))
            require(!f.fmi2Instantiate("one", fmi2CoSimulation, "{0}", argv[3], &callbacks, 0, 0), "a wrong GUID is refused");
        instantiate(&f);
        run(&f);
        print(&f);
        kept = f;
        if (!strcmp(way, "last")) atexit(finish_kept);
        else if (strcmp(way, "kept") && strcmp(way, "unloaded")) finish(&f);
        if (!strcmp(way, "kept") || !strcmp(way, "last")) exit(0);
    }
    if (strcmp(way, "resident")) dlclose(f.library);
    return 0;
}
