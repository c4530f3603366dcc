/* Products of a chain with a vector, and of its transpose. */
#include "linear/chain.h"
#include "invariants.h"

#include <stddef.h>

/* The rows are written anew: their weights alone, or which number comes from which. */
void ts_chain_begin(ts_chain *c, int weights)
{
    c->next = weights ? c->weight : NULL;
    if (!weights) c->rows = c->terms = 0;
}

void ts_chain_note_row(ts_chain *c, int32_t to)
{
    if (c->from) {
        c->to[c->rows] = to;
        c->first[c->rows] = c->terms;
    }
    c->rows++;
}

void ts_chain_note(ts_chain *c, int32_t from)
{
    if (c->from) c->from[c->terms] = from;
    c->terms++;
}

/* All rows have been written. */
void ts_chain_end(ts_chain *c)
{
    TS_ASSERT(!c->next || c->next == c->weight + c->terms);
    if (c->from && !c->next) c->first[c->rows] = c->terms;
}

/* z: the map's arguments, 0 elsewhere; then the numbers of all rows. */
void ts_chain_forward(const ts_chain *c, double *z)
{
    for (int32_t row = 0; row < c->rows; row++) {
        double sum = z[c->to[row]];
        for (int32_t i = c->first[row]; i < c->first[row + 1]; i++) sum += c->weight[i] * z[c->from[i]];
        z[c->to[row]] = sum;
    }
}

/* z: weights of the map's results, 0 elsewhere; then with them those of what the results come from. */
void ts_chain_backward(const ts_chain *c, double *z)
{
    for (int32_t row = c->rows - 1; row >= 0; row--) {
        const double weight = z[c->to[row]];
        for (int32_t i = c->first[row]; i < c->first[row + 1]; i++) z[c->from[i]] += c->weight[i] * weight;
    }
}
