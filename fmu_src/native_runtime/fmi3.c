/* FMI 3.0, what both kinds have: life cycle, events, states, and what an FMU of this project has nothing of.
 *
 * Status: as in FMI 2.0, see fmi2.c.  docs/fmu.md has the table. */
#include "version3.h"

/* ----------------------------------------------------------------------------------------------------------- inquiries */

FMI3_Export const char *fmi3GetVersion(void) { return fmi3Version; }

FMI3_Export fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    REQUIRE(c, MODE_ANY | MODE_INTERMEDIATE, FMU_DISCARD);
    return (fmi3Status)fmu_set_logging(fmu, __func__, on, n, categories);
}

/* The dependencies are those of the description, for whole variables; the library does not carry them. */
static fmi3Status no_dependencies(fmi3Instance c, const char *what)
{
    instance *fmu = (instance *)c;
    fmu_status status = fmu_in_order(fmu, MODE_ANY | MODE_INTERMEDIATE, FMU_DISCARD, what);
    if (status == FMU_OK) status = fmu_refuse(fmu, what, "dependencies by element are not provided; see modelDescription.xml");
    return (fmi3Status)status;
}

FMI3_Export fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference vr, size_t *n)
{
    (void)vr, (void)n;
    return no_dependencies(c, __func__);
}

FMI3_Export fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent, size_t of_dependent[],
                                                   fmi3ValueReference independents[], size_t of_independents[],
                                                   fmi3DependencyKind kinds[], size_t n)
{
    (void)dependent, (void)of_dependent, (void)independents, (void)of_independents, (void)kinds, (void)n;
    return no_dependencies(c, __func__);
}

/* ---------------------------------------------------------------------------------------------------------- life cycle */

/* # is the mark of a variable. */
static void pass_on(const instance *fmu, fmu_status status, const char *category, const char *message)
{
    char escaped[2 * FMU_LONGEST_MESSAGE];
    fmu_escape(message, "#", escaped);
    ((fmi3LogMessageCallback)fmu->logger)(fmu->environment, (fmi3Status)status, category, escaped);
}

const fmu_standard fmu_version3 = {3, "instantiation token", "Float64", "Int32", "resource path", pass_on};

FMI3_Export fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String path, fmi3Boolean visible,
                                                      fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                                      fmi3LogMessageCallback log)
{
    const fmu_request request = {__func__, &fmu_version3, environment, (void (*)(void))log, FMU_MODEL_EXCHANGE, name,
                                 token,    path,          logging};
    (void)visible;
    return fmu_instantiate(&request);
}

FMI3_Export fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String path,
                                                           fmi3Boolean visible, fmi3Boolean logging,
                                                           fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                                           fmi3ClockUpdateCallback clock, fmi3LockPreemptionCallback lock,
                                                           fmi3UnlockPreemptionCallback unlock)
{
    const fmu_request request = {__func__, &fmu_version3, environment, (void (*)(void))log, FMU_OTHER_KIND, name,
                                 token,    path,          logging};
    (void)visible, (void)clock, (void)lock, (void)unlock;
    return fmu_instantiate(&request);
}

/* Not by a host that looks into a step: there would be nothing to come back to. */
FMI3_Export void fmi3FreeInstance(fmi3Instance c)
{
    instance *fmu = (instance *)c;
    if (fmu && fmu->mode == MODE_INTERMEDIATE) fmu_error(fmu, __func__, "must not be called while a step is under way");
    else fmu_release(fmu);
}

FMI3_Export fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                                   fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop)
{
    REQUIRE(c, MODE_INSTANTIATED, FMU_ERROR);
    fmu_status status = fmu_set_experiment(fmu, __func__, tolerance_defined, tolerance, start, stop_defined, stop);
    return (fmi3Status)(status == FMU_OK ? fmu_enter_initialization(fmu) : status);
}

FMI3_Export fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    REQUIRE(c, MODE_INITIALIZATION, FMU_ERROR);
    return (fmi3Status)fmu_exit_initialization(fmu, __func__);
}

FMI3_Export fmi3Status fmi3Terminate(fmi3Instance c)
{
    REQUIRE(c, MODE_STEPPING | MODE_EVENT | MODE_CONTINUOUS, FMU_ERROR);
    return (fmi3Status)fmu_terminate(fmu);
}

FMI3_Export fmi3Status fmi3Reset(fmi3Instance c)
{
    REQUIRE(c, MODE_ANY, FMU_ERROR);
    return (fmi3Status)fmu_reset(fmu, __func__);
}

/* There are no structural parameters. */
FMI3_Export fmi3Status fmi3EnterConfigurationMode(fmi3Instance c)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi3Status)fmu_refuse(fmu, __func__, "there are no structural parameters to configure");
}

FMI3_Export fmi3Status fmi3ExitConfigurationMode(fmi3Instance c)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi3Status)fmu_refuse(fmu, __func__, "there is no Configuration Mode to leave");
}

/* -------------------------------------------------------------------------------------------------------------- events */

FMI3_Export fmi3Status fmi3EnterEventMode(fmi3Instance c)
{
    REQUIRE(c, MODE_STEPPING | MODE_EVENT | MODE_CONTINUOUS, FMU_ERROR);
    if (fmu->kind == FMU_CO_SIMULATION && !fmu->event_mode)
        return (fmi3Status)fmu_error(fmu, __func__, "the instance was made for a host without Event Mode");
    return (fmi3Status)fmu_enter_event(fmu, __func__);
}

FMI3_Export fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *needs_update, fmi3Boolean *terminate,
                                                fmi3Boolean *nominals_changed, fmi3Boolean *values_changed,
                                                fmi3Boolean *next_event_defined, fmi3Float64 *next_event)
{
    int states_changed = 0;
    REQUIRE(c, MODE_EVENT, FMU_ERROR);
    REQUIRE_POINTER(needs_update && terminate && nominals_changed && values_changed && next_event_defined && next_event);
    *needs_update = *terminate = *nominals_changed = *next_event_defined = fmi3False;
    *next_event = 0.0;
    fmu_status status = fmu_update_discrete(fmu, __func__, &states_changed);
    *values_changed = states_changed != 0;
    return (fmi3Status)status;
}

FMI3_Export fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c)
{
    REQUIRE(c, MODE_EVENT, FMU_DISCARD);
    return (fmi3Status)fmu_refuse(fmu, __func__, "discrete states are evaluated by fmi3UpdateDiscreteStates only");
}

/* -------------------------------------------------------------------------------------------------------------- states */

FMI3_Export fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi3Status)fmu_get_state(fmu, __func__, state);
}

FMI3_Export fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi3Status)fmu_set_state(fmu, __func__, state);
}

FMI3_Export fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    REQUIRE(c, MODE_ANY | MODE_INTERMEDIATE, FMU_DISCARD);
    return (fmi3Status)fmu_free_state(state);
}

FMI3_Export fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi3Status)fmu_serialized_size(fmu, __func__, state, size);
}

FMI3_Export fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi3Status)fmu_serialize(fmu, __func__, state, bytes, size);
}

FMI3_Export fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    return (fmi3Status)fmu_deserialize(fmu, __func__, bytes, size, state);
}
