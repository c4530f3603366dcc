/* What FMI's functions begin with and share, whatever the kind of the instance. */
#ifndef TENSEGRITY_CALLS_H
#define TENSEGRITY_CALLS_H

#include "instance.h"

#define AFTER_START (FMU_INITIALIZATION | FMU_STEPPING | FMU_EVENT | FMU_CONTINUOUS | FMU_TERMINATED | FMU_ERROR)
#define SETTING (FMU_INSTANTIATED | FMU_INITIALIZATION | FMU_STEPPING | FMU_EVENT | FMU_CONTINUOUS)

/* Log it, and change the mode or leave the instance as it was. */
fmi2Status fmu_error(instance *fmu, const char *what, const char *why);
fmi2Status fmu_refuse(const instance *fmu, const char *what, const char *why);

/* fmi2OK where the call is allowed now; else `otherwise`: fmi2Error for what moves the instance on, fmi2Discard for what only
 * sets, reads or saves. */
fmi2Status fmu_in_order(instance *fmu, int modes, fmi2Status otherwise, const char *what);

/* fmi2OK where the instance is of this kind. */
fmi2Status fmu_of_kind(const instance *fmu, fmi2Type kind, const char *what);

/* fmi2OK where values and the variables of these references are there, all of first..end-1; type: what these are. */
fmi2Status fmu_look_up(const instance *fmu, const char *what, const fmi2ValueReference vr[], size_t n, const void *values,
                       int32_t first, int32_t end, const char *type);

/* The kernel's message with the name of the value that it refuses, ts_concerned(). */
const char *fmu_refused_value(const instance *fmu, char *text, size_t capacity);

/* Initialization Mode: outputs follow inputs and parameters at once, computed when somebody looks.  0: there is no start. */
int fmu_refresh(instance *fmu, const char *what);

void fmu_log_events(const instance *fmu); /* of the last step or event */

/* fmi2_modelexchange.c: outputs, states and their derivatives as they follow from time, states and inputs; once for all that
 * ask.  0: there are none. */
enum { VIEW_OUTPUTS = 1, VIEW_STATES = 2, VIEW_DERIVATIVES = 4 };
int fmu_view(instance *fmu, int what, const char *caller);

#define REQUIRE(component, modes, otherwise)                                 \
    instance *fmu = (instance *)component;                                   \
    fmi2Status order_status = fmu_in_order(fmu, modes, otherwise, __func__); \
    if (order_status != fmi2OK) return order_status

#define REQUIRE_POINTER(pointer) \
    if (!(pointer)) return fmu_refuse(fmu, __func__, "a null pointer was passed")

#define REQUIRE_KIND(kind)                                     \
    fmi2Status kind_status = fmu_of_kind(fmu, kind, __func__); \
    if (kind_status != fmi2OK) return kind_status

#define REQUIRE_KNOWN(values, first, end, type)                                            \
    fmi2Status found_status = fmu_look_up(fmu, __func__, vr, n, values, first, end, type); \
    if (found_status != fmi2OK) return found_status

#endif
