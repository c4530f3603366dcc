/* FMI 2.0 for co-simulation over a block: values, input and output derivatives of order 1, states that can be taken back. */
#include "block.h"

#include "fmi2Functions.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef enum { INSTANTIATED, INITIALIZING, STEPPING, ENDED } stage;

typedef struct {
    block b;
    stage stage;
    double time;
} instance;

#define SELF instance *self = (instance *)c
#define REQUIRE(condition) \
    if (!(condition)) return fmi2Discard

static const double starts[VARIABLES] = STARTS;
static const char causality[VARIABLES + 1] = CAUSALITIES;

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2Reset(fmi2Component c)
{
    SELF;
    memset(self, 0, sizeof *self);
    memcpy(self->b.value, starts, sizeof starts);
    block_start(&self->b);
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)location, (void)functions, (void)visible, (void)logging;
    if (!name || type != fmi2CoSimulation || !guid || strcmp(guid, IDENTITY) != 0) return NULL;
    instance *self = (instance *)malloc(sizeof *self);
    if (self) fmi2Reset(self);
    return self;
}

void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean td, fmi2Real t, fmi2Real start, fmi2Boolean sd, fmi2Real stop)
{
    SELF;
    (void)td, (void)t, (void)sd, (void)stop;
    REQUIRE(self->stage == INSTANTIATED && isfinite(start));
    self->time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    SELF;
    REQUIRE(self->stage == INSTANTIATED);
    self->stage = INITIALIZING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    SELF;
    REQUIRE(self->stage == INITIALIZING);
    self->stage = STEPPING;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    SELF;
    REQUIRE(self->stage == STEPPING);
    self->stage = ENDED;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    SELF;
    for (size_t i = 0; i < n; i++) REQUIRE(vr[i] < VARIABLES);
    for (size_t i = 0; i < n; i++) value[i] = self->b.value[vr[i]];
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    SELF;
    for (size_t i = 0; i < n; i++) {
        REQUIRE(vr[i] < VARIABLES && isfinite(value[i]));
        REQUIRE(causality[vr[i]] == 'i' || (causality[vr[i]] == 'p' && self->stage < STEPPING));
    }
    for (size_t i = 0; i < n; i++) self->b.value[vr[i]] = value[i];
    if (self->stage < STEPPING) block_start(&self->b); /* outputs follow at once in Initialization Mode */
    return fmi2OK;
}

static fmi2Status slopes(const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], char wanted)
{
    for (size_t i = 0; i < n; i++) REQUIRE(vr[i] < VARIABLES && causality[vr[i]] == wanted && order[i] == 1);
    return fmi2OK;
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                       const fmi2Real value[])
{
    SELF;
    REQUIRE(slopes(vr, n, order, 'i') == fmi2OK);
    for (size_t i = 0; i < n; i++) REQUIRE(isfinite(value[i]));
    for (size_t i = 0; i < n; i++) self->b.slope[vr[i]] = value[i];
    return fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[],
                                        fmi2Real value[])
{
    SELF;
    REQUIRE(slopes(vr, n, order, 'o') == fmi2OK);
    for (size_t i = 0; i < n; i++) value[i] = self->b.slope[vr[i]];
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real point, fmi2Real h, fmi2Boolean no_set)
{
    SELF;
    (void)no_set;
    REQUIRE(self->stage == STEPPING && isfinite(point) && h > 0.0 && isfinite(h));
    block_step(&self->b, h);
    self->time = point + h;
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *saved)
{
    if (!*saved) *saved = malloc(sizeof(instance));
    REQUIRE(*saved);
    memcpy(*saved, c, sizeof(instance));
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate saved)
{
    REQUIRE(saved);
    memcpy(c, saved, sizeof(instance));
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *saved)
{
    (void)c;
    free(*saved);
    *saved = NULL;
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    SELF;
    REQUIRE(kind == fmi2LastSuccessfulTime);
    *value = self->time;
    return fmi2OK;
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)c, (void)on, (void)n, (void)categories;
    return fmi2OK; /* there is nothing to log */
}

/* What the description does not claim: other types than Real, serialized states, directional derivatives, pending steps. */
#define REFUSED(NAME, ...) \
    fmi2Status NAME(fmi2Component c, __VA_ARGS__) { return c ? fmi2Discard : fmi2Error; }
#define VALUES const fmi2ValueReference vr[], size_t n
REFUSED(fmi2SetInteger, VALUES, const fmi2Integer v[])
REFUSED(fmi2SetBoolean, VALUES, const fmi2Boolean v[])
REFUSED(fmi2SetString, VALUES, const fmi2String v[])
REFUSED(fmi2GetInteger, VALUES, fmi2Integer v[])
REFUSED(fmi2GetBoolean, VALUES, fmi2Boolean v[])
REFUSED(fmi2GetString, VALUES, fmi2String v[])
REFUSED(fmi2GetDirectionalDerivative, VALUES, const fmi2ValueReference k[], size_t m, const fmi2Real d[], fmi2Real v[])
REFUSED(fmi2SerializedFMUstateSize, fmi2FMUstate s, size_t *n)
REFUSED(fmi2SerializeFMUstate, fmi2FMUstate s, fmi2Byte b[], size_t n)
REFUSED(fmi2DeSerializeFMUstate, const fmi2Byte b[], size_t n, fmi2FMUstate *s)
REFUSED(fmi2GetStatus, const fmi2StatusKind k, fmi2Status *v)
REFUSED(fmi2GetIntegerStatus, const fmi2StatusKind k, fmi2Integer *v)
REFUSED(fmi2GetBooleanStatus, const fmi2StatusKind k, fmi2Boolean *v)
REFUSED(fmi2GetStringStatus, const fmi2StatusKind k, fmi2String *v)
fmi2Status fmi2CancelStep(fmi2Component c) { return c ? fmi2Discard : fmi2Error; }
