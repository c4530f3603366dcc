/* The packed form of a model: reading it, laying out a simulation's memory. */
#ifndef TENSEGRITY_PACKED_H
#define TENSEGRITY_PACKED_H

#include "tensegrity.h"

#include <stddef.h>
#include <stdint.h>

uint64_t ts_fnv(const void *bytes, size_t size);
int ts_model_read(ts_sim *sim, const void *bytes, size_t size, char *message, size_t capacity);
void ts_model_free(ts_sim *sim);

#endif
