/* First derivatives of what is put out, and of the energies that are put in and dissipated. */
#ifndef TENSEGRITY_OUTPUT_DIFFERENTIALS_H
#define TENSEGRITY_OUTPUT_DIFFERENTIALS_H

#include "motion/differentials.h"

void ts_differentiate_outputs(ts_differentials *d);

#endif
