/* FMI 2.0, what both kinds have: life cycle, values, states.
 *
 * Status: fmi2Discard where something is refused and the instance stays as it was; fmi2Error where the standard wants it, or
 * where host and FMU have parted, so that going on would give wrong results (then only a reset, a saved state or
 * fmi2FreeInstance help); never fmi2Fatal.  docs/fmu.md has the table. */
#include "version2.h"

/* ----------------------------------------------------------------------------------------------------------- inquiries */

FMI2_Export const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
FMI2_Export const char *fmi2GetVersion(void) { return fmi2Version; }

FMI2_Export fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi2Status)fmu_set_logging(fmu, __func__, on, n, categories);
}

/* ---------------------------------------------------------------------------------------------------------- life cycle */

/* The host takes the message as a format of printf, and # as the mark of a variable. */
static void pass_on(const instance *fmu, fmu_status status, const char *category, const char *message)
{
    char escaped[2 * FMU_LONGEST_MESSAGE];
    fmu_escape(message, "%#", escaped);
    ((fmi2CallbackLogger)fmu->logger)(fmu->environment, fmu->name, (fmi2Status)status, category, escaped);
}

static const fmu_standard version = {2, "GUID", "Real", "Integer", "resource location", pass_on};

FMI2_Export fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String location,
                                          const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    fmu_request request = {__func__, &version, NULL, NULL, FMU_CO_SIMULATION, name, guid, location, logging};
    (void)visible;
    if (functions) {
        request.environment = functions->componentEnvironment;
        request.logger = (void (*)(void))functions->logger;
    }
    if (type != fmi2CoSimulation) request.kind = type == fmi2ModelExchange ? FMU_MODEL_EXCHANGE : FMU_OTHER_KIND;
    return fmu_instantiate(&request);
}

FMI2_Export void fmi2FreeInstance(fmi2Component c) { fmu_release((instance *)c); }

FMI2_Export fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                                           fmi2Boolean stop_defined, fmi2Real stop)
{
    REQUIRE(c, MODE_INSTANTIATED, FMU_ERROR);
    return (fmi2Status)fmu_set_experiment(fmu, __func__, tolerance_defined, tolerance, start, stop_defined, stop);
}

FMI2_Export fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    REQUIRE(c, MODE_INSTANTIATED, FMU_ERROR);
    return (fmi2Status)fmu_enter_initialization(fmu);
}

FMI2_Export fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    REQUIRE(c, MODE_INITIALIZATION, FMU_ERROR);
    return (fmi2Status)fmu_exit_initialization(fmu, __func__);
}

FMI2_Export fmi2Status fmi2Terminate(fmi2Component c)
{
    REQUIRE(c, MODE_STEPPING | MODE_EVENT | MODE_CONTINUOUS, FMU_ERROR);
    return (fmi2Status)fmu_terminate(fmu);
}

FMI2_Export fmi2Status fmi2Reset(fmi2Component c)
{
    REQUIRE(c, MODE_ANY, FMU_ERROR);
    return (fmi2Status)fmu_reset(fmu, __func__);
}

/* -------------------------------------------------------------------------------------------------------------- values */

FMI2_Export fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    REQUIRE(c, AFTER_START, FMU_DISCARD);
    return (fmi2Status)fmu_get_reals(fmu, __func__, vr, n, value, n);
}

FMI2_Export fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    REQUIRE(c, AFTER_START, FMU_DISCARD);
    return (fmi2Status)fmu_get_integers(fmu, __func__, vr, n, value, n, sizeof *value);
}

FMI2_Export fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    REQUIRE(c, SETTING, FMU_DISCARD);
    return (fmi2Status)fmu_set_reals(fmu, __func__, vr, n, value, n);
}

FMI2_Export fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer value[])
{
    REQUIRE(c, SETTING, FMU_DISCARD);
    return (fmi2Status)fmu_set_integers(fmu, __func__, vr, n, value, n, sizeof *value);
}

/* There are no variables of the other types: only an empty list is right. */
static fmi2Status none(fmi2Component c, int modes, const fmi2ValueReference vr[], size_t n, const char *what, const char *type)
{
    instance *fmu = (instance *)c;
    const fmu_range range = {type, 0, 0, 0, 0};
    fmu_status status = fmu_in_order(fmu, modes, FMU_DISCARD, what);
    return (fmi2Status)(status == FMU_OK ? fmu_look_up(fmu, what, vr, n, vr, 0, range) : status);
}

FMI2_Export fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{
    (void)value;
    return none(c, AFTER_START, vr, n, __func__, "Boolean");
}

FMI2_Export fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    (void)value;
    return none(c, AFTER_START, vr, n, __func__, "String");
}

FMI2_Export fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    (void)value;
    return none(c, SETTING, vr, n, __func__, "Boolean");
}

FMI2_Export fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    (void)value;
    return none(c, SETTING, vr, n, __func__, "String");
}

FMI2_Export fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t unknowns,
                                                    const fmi2ValueReference known[], size_t knowns, const fmi2Real change[],
                                                    fmi2Real response[])
{
    REQUIRE(c, AFTER_START, FMU_DISCARD);
    const fmu_product product = {__func__, unknown, known, unknowns, knowns, change, response, knowns, unknowns};
    const char *why = "in co-simulation directional derivatives are not provided: no output depends directly on an input";
    if (fmu->kind == FMU_CO_SIMULATION) return (fmi2Status)fmu_refuse(fmu, __func__, why);
    return (fmi2Status)fmu_get_partials(fmu, &product, 0);
}

/* -------------------------------------------------------------------------------------------------------------- states */

FMI2_Export fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi2Status)fmu_get_state(fmu, __func__, state);
}

FMI2_Export fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi2Status)fmu_set_state(fmu, __func__, state);
}

FMI2_Export fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi2Status)fmu_free_state(state);
}

FMI2_Export fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi2Status)fmu_serialized_size(fmu, __func__, state, size);
}

FMI2_Export fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi2Status)fmu_serialize(fmu, __func__, state, bytes, size);
}

FMI2_Export fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi2Status)fmu_deserialize(fmu, __func__, bytes, size, state);
}
