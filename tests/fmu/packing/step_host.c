/* Steps a native FMU on any platform: loads the library, holds a square wave on one input, prints outputs to the last bit.
 * host LIBRARY RESOURCES_URI GUID STEPS H INPUT HEIGHT FIRST COUNT: value references of the input and of the first output. */
#include "fmi2FunctionTypes.h"

#include <stdio.h>
#include <stdlib.h>

#if defined(_WIN32)
#include <windows.h>
#define OPEN(path) ((void *)LoadLibraryA(path))
#define FIND(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW | RTLD_LOCAL)
#define FIND(library, name) dlsym(library, name)
#endif

static void say(fmi2ComponentEnvironment e, fmi2String name, fmi2Status status, fmi2String category, fmi2String message, ...)
{
    (void)e;
    fprintf(stderr, "%s %d %s %s\n", name, (int)status, category, message);
}

static void *library;

static void *must(const char *name)
{
    void *found = FIND(library, name);
    if (!found) {
        fprintf(stderr, "%s is not exported\n", name);
        exit(3);
    }
    return found;
}

static void good(int step, fmi2Status status)
{
    if (status == fmi2OK) return;
    fprintf(stderr, "call %d: status %d\n", step, (int)status);
    exit(4);
}

int main(int argc, char **argv)
{
    fmi2CallbackFunctions host = {say, calloc, free, NULL, NULL};
    double out[64];
    fmi2ValueReference refs[64];
    if (argc != 10 || !(library = OPEN(argv[1]))) {
        fprintf(stderr, "%s cannot be loaded\n", argc > 1 ? argv[1] : "nothing");
        return 2;
    }
    int steps = atoi(argv[4]), count = atoi(argv[9]);
    double h = atof(argv[5]), height = atof(argv[7]);
    fmi2ValueReference input = (fmi2ValueReference)atoi(argv[6]);
    for (int i = 0; i < count && i < 64; i++) refs[i] = (fmi2ValueReference)(atoi(argv[8]) + i);
    fmi2SetRealTYPE *set = (fmi2SetRealTYPE *)must("fmi2SetReal");
    fmi2GetRealTYPE *get = (fmi2GetRealTYPE *)must("fmi2GetReal");
    fmi2DoStepTYPE *step = (fmi2DoStepTYPE *)must("fmi2DoStep");
    fmi2Component c = ((fmi2InstantiateTYPE *)must("fmi2Instantiate"))("host", fmi2CoSimulation, argv[3], argv[2], &host, 0, 0);
    if (!c) return 5;
    good(-1, ((fmi2SetupExperimentTYPE *)must("fmi2SetupExperiment"))(c, 0, 0.0, 0.0, 0, 0.0));
    good(-2, ((fmi2EnterInitializationModeTYPE *)must("fmi2EnterInitializationMode"))(c));
    good(-3, ((fmi2ExitInitializationModeTYPE *)must("fmi2ExitInitializationMode"))(c));
    for (int k = 0; k < steps; k++) {
        double force = k / 50 % 2 ? -height : height;
        good(k, set(c, &input, 1, &force));
        good(k, step(c, k * h, h, 1));
        good(k, get(c, refs, (size_t)count, out));
        for (int i = 0; i < count; i++) printf("%.17g%c", out[i], i + 1 < count ? ' ' : '\n');
    }
    good(steps, ((fmi2TerminateTYPE *)must("fmi2Terminate"))(c));
    ((fmi2FreeInstanceTYPE *)must("fmi2FreeInstance"))(c);
    return 0;
}
