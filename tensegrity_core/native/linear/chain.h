/* A linear map as a chain of sums of products: to += weight * from, row by row.
 *
 * Rows stand in the order of a computation, each behind those that it reads, so that one way through them gives the map's
 * product with a vector and the way back that of its transpose.  The code that writes them runs three times: to count rows and terms,
 * to note which number comes from which, and from then on for the weights alone, whenever they change. */
#ifndef TENSEGRITY_CHAIN_H
#define TENSEGRITY_CHAIN_H

#include "linear/pairs.h"

#include <stdint.h>

typedef struct {
    double *weight; /* (terms) */
    int32_t *from;  /* (terms) NULL: rows and terms are counted */
    int32_t *to;    /* (rows) */
    int32_t *first; /* (rows + 1) of its terms; last the number of all */
    int32_t rows, terms;
    double *next; /* the next weight; NULL: rows and terms are counted or noted */
} ts_chain;

void ts_chain_note_row(ts_chain *c, int32_t to);
void ts_chain_note(ts_chain *c, int32_t from);

/* Begin the row of a number. */
ALWAYS_INLINE void chain_row(ts_chain *c, int32_t to)
{
    if (!c->next) ts_chain_note_row(c, to);
}

/* A term of the row at hand. */
ALWAYS_INLINE void chain_add(ts_chain *c, int32_t from, double weight)
{
    if (c->next) *c->next++ = weight;
    else ts_chain_note(c, from);
}

void ts_chain_begin(ts_chain *c, int weights);
void ts_chain_end(ts_chain *c);
void ts_chain_forward(const ts_chain *c, double *z);
void ts_chain_backward(const ts_chain *c, double *z);

#endif
