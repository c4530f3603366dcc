/* The variable table from its packed bytes; the layout is that of variables_bin in pack.py. */
#include "instance.h"

#include <stdlib.h>
#include <string.h>

#define MAGIC "TSVARS4"

/* Does every variable end where its kind ends, and none reach into the next? */
static int spans_fit(const variable_table *table)
{
    for (int32_t i = 0, free_from = 0; i < table->count; i++) {
        int32_t span = table->span[i], end = i < table->reals ? table->reals : table->count;
        if (span < 0 || span > end - i || (span && i < free_from)) return 0;
        if (span) free_from = i + span;
    }
    return 1;
}

/* magic[8], int32 reals, count, strings, contacts, tolerance, 0, checksum of model.bin (uint64), then low, high (doubles), settable,
 * span (int32), then texts that end with 0: GUID, names of variables, of strings, of nodes that may touch the ground; at the end the
 * checksum of all that (uint64). */
int variables_read(variable_table *table, char *bytes, size_t size)
{
    int32_t head[6];
    uint64_t sum;
    memset(table, 0, sizeof *table);
    table->bytes = bytes;
    if (size < 8 + sizeof head + 2 * sizeof sum) return 0;
    size -= sizeof sum;
    memcpy(&sum, bytes + size, sizeof sum);
    if (memcmp(bytes, MAGIC, 8) || fmu_checksum(FMU_CHECKSUM, bytes, size) != sum || bytes[size - 1]) return 0;
    memcpy(head, bytes + 8, sizeof head);
    memcpy(&table->model, bytes + 8 + sizeof head, sizeof table->model);
    if (head[2] < 0 || head[3] < 0) return 0;
    size_t count = (size_t)head[1], texts = count + (size_t)head[2] + (size_t)head[3],
           at = 8 + sizeof head + sizeof table->model;
    if (head[0] < 0 || head[1] < head[0] || head[4] < 0 || head[4] >= head[0]) return 0;
    if ((size - at) / 24 < count) return 0;
    table->reals = head[0];
    table->count = head[1];
    table->strings = head[2];
    table->contacts = head[3];
    table->tolerance = head[4];
    table->low = (const double *)(const void *)(bytes + at);
    table->high = table->low + count;
    table->settable = (const int32_t *)(const void *)(table->high + count);
    table->span = table->settable + count;
    if (!spans_fit(table)) return 0;
    table->name = (const char **)malloc(sizeof *table->name * (texts + 1));
    if (!table->name) return 0;
    const char *text = (const char *)(table->span + count), *end = bytes + size;
    for (size_t i = 0; i <= texts; i++) {
        if (text >= end) return 0;
        if (i == 0) table->guid = text;
        else table->name[i - 1] = text;
        text += strlen(text) + 1;
    }
    return text == end;
}

void variables_free(variable_table *table)
{
    free(table->name);
    free(table->bytes);
}
