/* FMI 3.0: values by reference, of arrays whole.  There are variables of three types only. */
#include "version3.h"

#define READING (MODE_INSTANTIATED | AFTER_START | MODE_INTERMEDIATE)

FMI3_Export fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[],
                                      size_t n_values)
{
    REQUIRE(c, READING, FMU_DISCARD);
    return (fmi3Status)fmu_get_reals(fmu, __func__, vr, n, values, n_values);
}

FMI3_Export fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[],
                                      size_t n_values)
{
    REQUIRE(c, SETTING, FMU_DISCARD);
    return (fmi3Status)fmu_set_reals(fmu, __func__, vr, n, values, n_values);
}

FMI3_Export fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int32 values[],
                                    size_t n_values)
{
    REQUIRE(c, READING, FMU_DISCARD);
    return (fmi3Status)fmu_get_integers(fmu, __func__, vr, n, values, n_values, sizeof *values);
}

FMI3_Export fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int32 values[],
                                    size_t n_values)
{
    REQUIRE(c, SETTING, FMU_DISCARD);
    return (fmi3Status)fmu_set_integers(fmu, __func__, vr, n, values, n_values, sizeof *values);
}

/* Of enumerations, and of integers for hosts that have but one type of them. */
FMI3_Export fmi3Status fmi3GetInt64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Int64 values[],
                                    size_t n_values)
{
    REQUIRE(c, READING, FMU_DISCARD);
    return (fmi3Status)fmu_get_integers(fmu, __func__, vr, n, values, n_values, sizeof *values);
}

FMI3_Export fmi3Status fmi3SetInt64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int64 values[],
                                    size_t n_values)
{
    REQUIRE(c, SETTING, FMU_DISCARD);
    return (fmi3Status)fmu_set_integers(fmu, __func__, vr, n, values, n_values, sizeof *values);
}

/* ---------------------------------------------------------------------------------- types of which there are no variables */

/* Only an empty list is right. */
static fmi3Status none(fmi3Instance c, int modes, const fmi3ValueReference vr[], size_t n, const char *what, const char *type)
{
    instance *fmu = (instance *)c;
    const fmu_range range = {type, 0, 0, 0, 0};
    fmu_status status = fmu_in_order(fmu, modes, FMU_DISCARD, what);
    return (fmi3Status)(status == FMU_OK ? fmu_look_up(fmu, what, vr, n, vr, 0, range) : status);
}

#define NONE_OF(type)                                                                                                        \
    FMI3_Export fmi3Status fmi3Get##type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##type values[],       \
                                         size_t n_values)                                                                    \
    {                                                                                                                        \
        (void)values, (void)n_values;                                                                                        \
        return none(c, READING, vr, n, __func__, #type);                                                                     \
    }                                                                                                                        \
    FMI3_Export fmi3Status fmi3Set##type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##type values[], \
                                         size_t n_values)                                                                    \
    {                                                                                                                        \
        (void)values, (void)n_values;                                                                                        \
        return none(c, SETTING, vr, n, __func__, #type);                                                                     \
    }

NONE_OF(Float32)
NONE_OF(Int8)
NONE_OF(UInt8)
NONE_OF(Int16)
NONE_OF(UInt16)
NONE_OF(UInt32)
NONE_OF(UInt64)
NONE_OF(Boolean)
NONE_OF(String)

FMI3_Export fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[],
                                     fmi3Binary values[], size_t n_values)
{
    (void)sizes, (void)values, (void)n_values;
    return none(c, READING, vr, n, __func__, "Binary");
}

FMI3_Export fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
                                     const fmi3Binary values[], size_t n_values)
{
    (void)sizes, (void)values, (void)n_values;
    return none(c, SETTING, vr, n, __func__, "Binary");
}

/* -------------------------------------------------------------------------------------------------------------- clocks */

#define CLOCKED (MODE_INSTANTIATED | MODE_INITIALIZATION | MODE_EVENT | MODE_STEPPING)

FMI3_Export fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Clock values[])
{
    (void)values;
    return none(c, READING, vr, n, __func__, "Clock");
}

FMI3_Export fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Clock values[])
{
    (void)values;
    return none(c, SETTING, vr, n, __func__, "Clock");
}

FMI3_Export fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 intervals[],
                                              fmi3IntervalQualifier qualifiers[])
{
    (void)intervals, (void)qualifiers;
    return none(c, CLOCKED, vr, n, __func__, "Clock");
}

FMI3_Export fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
                                               fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
{
    (void)counters, (void)resolutions, (void)qualifiers;
    return none(c, CLOCKED, vr, n, __func__, "Clock");
}

FMI3_Export fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 shifts[])
{
    (void)shifts;
    return none(c, CLOCKED, vr, n, __func__, "Clock");
}

FMI3_Export fmi3Status fmi3GetShiftFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
                                            fmi3UInt64 resolutions[])
{
    (void)counters, (void)resolutions;
    return none(c, CLOCKED, vr, n, __func__, "Clock");
}

FMI3_Export fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                              const fmi3Float64 intervals[])
{
    (void)intervals;
    return none(c, CLOCKED, vr, n, __func__, "Clock");
}

FMI3_Export fmi3Status fmi3SetIntervalFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                               const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    (void)counters, (void)resolutions;
    return none(c, CLOCKED, vr, n, __func__, "Clock");
}

FMI3_Export fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 shifts[])
{
    (void)shifts;
    return none(c, CLOCKED, vr, n, __func__, "Clock");
}

FMI3_Export fmi3Status fmi3SetShiftFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                                            const fmi3UInt64 counters[], const fmi3UInt64 resolutions[])
{
    (void)counters, (void)resolutions;
    return none(c, CLOCKED, vr, n, __func__, "Clock");
}

FMI3_Export fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
{
    REQUIRE(c, MODE_ANY, FMU_DISCARD);
    (void)clock, (void)time;
    return (fmi3Status)fmu_refuse(fmu, __func__, "there are no model partitions");
}

/* --------------------------------------------------------------------------------------------------- partial derivatives */

FMI3_Export fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                                    const fmi3ValueReference knowns[], size_t n_knowns,
                                                    const fmi3Float64 seed[], size_t n_seed, fmi3Float64 sensitivity[],
                                                    size_t n_sensitivity)
{
    REQUIRE(c, AFTER_START, FMU_DISCARD);
    const fmu_product product = {__func__, unknowns, knowns, n_unknowns, n_knowns, seed, sensitivity, n_seed, n_sensitivity};
    return (fmi3Status)fmu_get_partials(fmu, &product, 0);
}

FMI3_Export fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                                const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                                size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    REQUIRE(c, AFTER_START, FMU_DISCARD);
    const fmu_product product = {__func__, unknowns, knowns, n_unknowns, n_knowns, seed, sensitivity, n_seed, n_sensitivity};
    return (fmi3Status)fmu_get_partials(fmu, &product, 1);
}
