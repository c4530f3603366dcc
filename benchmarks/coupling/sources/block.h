/* What FMI's functions (block.c) ask of a block (winch.c, controller.c).
 *
 * variables.h is written by blocks.py from the same table as modelDescription.xml: an enum of value references, VARIABLES, and
 * the start values STARTS, the causalities CAUSALITIES ('p' parameter, 'i' input, 'o' output) and the IDENTITY. */
#ifndef BLOCK_H
#define BLOCK_H

#include "variables.h"

#define MAX_STATES 6

typedef struct {
    double value[VARIABLES];  /* by value reference */
    double slope[VARIABLES];  /* of an input during the next step, of an output at the end of the last one, 1/s */
    double state[MAX_STATES]; /* of the block's equations */
} block;

/* States and outputs at the start, from parameters and inputs. */
void block_start(block *b);

/* Over a step h, s, each input being value + slope t: states, outputs and the outputs' slopes at its end, exactly. */
void block_step(block *b, double h);

#endif
