/* First derivatives of the motion and of the outputs at one instant, as a chain of sums. */
#ifndef TENSEGRITY_DIFFERENTIALS_H
#define TENSEGRITY_DIFFERENTIALS_H

#include "linear/chain.h"
#include "model/data.h"

#include <stdint.h>

/* Where the numbers of the chain begin, in the order in which they follow from each other. */
typedef struct {
    int32_t values;              /* (n_applied) inputs and parameters: arguments */
    int32_t extra, lower;        /* (N) point masses; (floating_count) places of the centres of mass on free bars */
    int32_t inverse, laden;      /* (blocks) */
    int32_t base, gravity;       /* (E, 3, D), (3) */
    int32_t y;                   /* (ny) the state: an argument, or at the start what follows from the others */
    int32_t x;                   /* (N, 2, D) positions and velocities of the nodes */
    int32_t s;                   /* (lines, 2, D) vectors of strings and segments, and their rates */
    int32_t elongation, rate;    /* (S) */
    int32_t elastic, tension;    /* (S) as the spring gives it; as it acts on the nodes */
    int32_t pull, force;         /* (lines, D), (N, D) */
    int32_t Q, dy;               /* (nq), (ny) */
    int32_t load;                /* (N, D) forces with weights and what point masses need */
    int32_t outputs, indicators; /* (n_real - n_applied), see ts_margins() */
    int32_t size;
} ts_places;

typedef struct {
    const ts_sim *sim;
    ts_chain chain;
    ts_places at;
    const double *Q; /* (nq) generalised forces, N */
    int start;       /* the state is that of ts_initialize(), fixed parameters count */
} ts_differentials;

void ts_place_differentials(ts_differentials *d);
void ts_differentiate_motion(ts_differentials *d);

#endif
