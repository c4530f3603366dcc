/* An FMU with three outputs: 0, a square wave: +HEIGHT for half of PERIOD, -HEIGHT for the other half; 1 and 2, LIFT.
 * Tools that couple FMUs get the forces from it.  Only what a host calls of it is here; FMI headers from fmpy. */
#include "fmi2Functions.h"

#include <math.h>
#include <stdlib.h>

typedef struct {
    double time;
} wave;

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name, (void)type, (void)guid, (void)location, (void)functions, (void)visible, (void)logging;
    return calloc(1, sizeof(wave));
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean td, fmi2Real t, fmi2Real start, fmi2Boolean sd, fmi2Real stop)
{
    (void)td, (void)t, (void)sd, (void)stop;
    ((wave *)c)->time = start;
    return fmi2OK;
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
fmi2Status fmi2Terminate(fmi2Component c) { return c ? fmi2OK : fmi2Error; }

fmi2Status fmi2Reset(fmi2Component c)
{
    ((wave *)c)->time = 0.0;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    if (!c) return fmi2Error;
    double half = floor(((wave *)c)->time / (0.5 * PERIOD) + 1e-6); /* halves counted; room for the host's round-off */
    double height = fmod(half, 2.0) == 0.0 ? HEIGHT : -HEIGHT;
    for (size_t i = 0; i < n; i++) value[i] = vr[i] == 0 ? height : LIFT;
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real h, fmi2Boolean no_set)
{
    (void)no_set;
    ((wave *)c)->time = point + h;
    return fmi2OK;
}

/* The rest is there to be found by name; there is nothing to set and no state. */
#define EMPTY(NAME, ...) \
    fmi2Status NAME(fmi2Component c, __VA_ARGS__) { return c ? fmi2OK : fmi2Error; }
#define VALUES const fmi2ValueReference vr[], size_t n
EMPTY(fmi2SetReal, VALUES, const fmi2Real v[])
EMPTY(fmi2SetInteger, VALUES, const fmi2Integer v[])
EMPTY(fmi2SetBoolean, VALUES, const fmi2Boolean v[])
EMPTY(fmi2SetString, VALUES, const fmi2String v[])
EMPTY(fmi2GetInteger, VALUES, fmi2Integer v[])
EMPTY(fmi2GetBoolean, VALUES, fmi2Boolean v[])
EMPTY(fmi2GetString, VALUES, fmi2String v[])
EMPTY(fmi2SetRealInputDerivatives, VALUES, const fmi2Integer o[], const fmi2Real v[])
EMPTY(fmi2GetRealOutputDerivatives, VALUES, const fmi2Integer o[], fmi2Real v[])
EMPTY(fmi2GetDirectionalDerivative, VALUES, const fmi2ValueReference k[], size_t m, const fmi2Real d[], fmi2Real v[])
EMPTY(fmi2GetFMUstate, fmi2FMUstate *s)
EMPTY(fmi2SetFMUstate, fmi2FMUstate s)
EMPTY(fmi2FreeFMUstate, fmi2FMUstate *s)
EMPTY(fmi2SerializedFMUstateSize, fmi2FMUstate s, size_t *n)
EMPTY(fmi2SerializeFMUstate, fmi2FMUstate s, fmi2Byte b[], size_t n)
EMPTY(fmi2DeSerializeFMUstate, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
EMPTY(fmi2GetStatus, const fmi2StatusKind k, fmi2Status *v)
EMPTY(fmi2GetRealStatus, const fmi2StatusKind k, fmi2Real *v)
EMPTY(fmi2GetIntegerStatus, const fmi2StatusKind k, fmi2Integer *v)
EMPTY(fmi2GetBooleanStatus, const fmi2StatusKind k, fmi2Boolean *v)
EMPTY(fmi2GetStringStatus, const fmi2StatusKind k, fmi2String *v)
fmi2Status fmi2CancelStep(fmi2Component c) { return c ? fmi2OK : fmi2Error; }
