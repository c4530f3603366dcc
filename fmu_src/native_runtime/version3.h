/* FMI 3.0: its functions know the order of calls and the types of that version; what they do is that of calls.h. */
#ifndef TENSEGRITY_VERSION3_H
#define TENSEGRITY_VERSION3_H

#include "fmi3Functions.h"

#include "calls.h"

typedef fmi3Status fmi_status;

/* fmi3.c */
extern const fmu_standard fmu_version3;

#endif
