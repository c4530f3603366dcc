/* FMI 2.0: its functions know the order of calls and the types of that version; what they do is that of calls.h. */
#ifndef TENSEGRITY_VERSION2_H
#define TENSEGRITY_VERSION2_H

#include "fmi2Functions.h"

#include "calls.h"

typedef fmi2Status fmi_status;

#endif
