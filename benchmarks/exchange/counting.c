/* A library that stands before that of an FMU, and counts.
 *
 * It exports FMI 2.0's functions; each is passed on to the library `behind.so` beside it.  Where the next instance
 * begins, and at the end, it appends a line of JSON to the file that TENSEGRITY_COUNTS names: how often each function was called
 * for one instance, how many transitions the FMU logged, and how often its own integrator evaluated the equations.  For Linux on x86-64: a function is passed on by a jump, whatever its arguments are. */
#define _GNU_SOURCE
#include "fmi2Functions.h"

#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define X(name) N_##name,
enum {
#include "fmi2.def"
    N_Instantiate,
    COUNT
};
#undef X
#define X(name) #name,
static const char *const names[COUNT] = {
#include "fmi2.def"
    "Instantiate"};
#undef X

/* The jumps below name these two. */
__attribute__((used, visibility("hidden"))) long counting_calls[COUNT];
__attribute__((used, visibility("hidden"))) void *counting_behind[COUNT];

static long transitions, rhs;
static fmi2CallbackFunctions host, ours;

#define X(name)                                                                                           \
    __attribute__((naked, visibility("default"))) void passed_##name(void) __asm__("fmi2" #name);         \
    void passed_##name(void)                                                                              \
    {                                                                                                     \
        __asm__("incq counting_calls+8*%c0(%%rip)\n\tjmp *counting_behind+8*%c0(%%rip)" ::"i"(N_##name)); \
    }

#include "fmi2.def"

__attribute__((constructor)) static void load(void)
{
    Dl_info here;
    char path[4096], name[64];
    dladdr((void *)&load, &here);
    snprintf(path, sizeof path, "%s", here.dli_fname);
    char *slash = strrchr(path, '/');
    snprintf(slash ? slash + 1 : path, 16, "behind.so");
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) fprintf(stderr, "%s\n", dlerror()), abort();
    for (int i = 0; i < COUNT; i++) {
        snprintf(name, sizeof name, "fmi2%s", names[i]);
        counting_behind[i] = dlsym(library, name);
    }
}

__attribute__((destructor)) static void tell(void)
{
    const char *path = getenv("TENSEGRITY_COUNTS");
    FILE *file = path ? fopen(path, "a") : NULL;
    if (!file) return;
    fprintf(file, "{\"transitions\":%ld,\"rhs\":%ld", transitions, rhs);
    for (int i = 0; i < COUNT; i++)
        if (counting_calls[i]) fprintf(file, ",\"%s\":%ld", names[i], counting_calls[i]);
    fputs("}\n", file);
    fclose(file);
    memset(counting_calls, 0, sizeof counting_calls);
    transitions = rhs = 0;
}

/* The FMU passes finished text, with a format of "%s" or without arguments. */
static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String form, ...)
{
    const char *text = form, *found;
    __builtin_va_list arguments;
    __builtin_va_start(arguments, form);
    if (!strcmp(form, "%s")) text = __builtin_va_arg(arguments, const char *);
    __builtin_va_end(arguments);
    transitions += !strcmp(category, "logEvents");
    if (!strcmp(category, "logSolver") && (found = strstr(text, "rejected, "))) rhs += atol(found + strlen("rejected, "));
    if (status != fmi2OK && host.logger) host.logger(environment, name, status, category, "%s", text);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type kind, fmi2String guid, fmi2String folder,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging)
{
    fmi2String categories[] = {"logEvents", "logSolver"};
    if (counting_calls[N_Instantiate]) tell();
    counting_calls[N_Instantiate]++;
    host = ours = *callbacks;
    ours.logger = logger;
    fmi2InstantiateTYPE *instantiate = (fmi2InstantiateTYPE *)counting_behind[N_Instantiate];
    fmi2Component c = instantiate(name, kind, guid, folder, &ours, visible, logging);
    if (c) ((fmi2SetDebugLoggingTYPE *)counting_behind[N_SetDebugLogging])(c, fmi2True, 2, categories);
    return c;
}
