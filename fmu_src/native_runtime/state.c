/* An instance's state as bytes: complete, versioned, bound to its FMU, with a checksum.  A saved FMU state and a serialised
 * one are the same bytes. */
#include "calls.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MAGIC 0x3155464d45545354u /* "TSTEMFU1" */

typedef struct {
    uint64_t magic, identity;
    int32_t mode, stale, tolerance_set, stop_defined, exchange, standard;
    double start, time, stop;
    uint64_t checksum; /* of the head with this field 0 and of the kernel's bytes, which follow */
} head;

static uint64_t checksum(head h, const char *kernel, size_t size)
{
    h.checksum = 0;
    return fmu_checksum(fmu_checksum(FMU_CHECKSUM, (const char *)&h, sizeof h), kernel, size);
}

size_t fmu_state_size(const instance *fmu) { return sizeof(head) + ts_state_size(fmu->sim); }

void fmu_state_save(const instance *fmu, char *bytes)
{
    size_t size = ts_state_size(fmu->sim);
    head h;
    memset(&h, 0, sizeof h);
    h.magic = MAGIC;
    h.identity = fmu->identity;
    h.mode = fmu->mode;
    h.stale = fmu->stale;
    h.tolerance_set = fmu->tolerance_set;
    h.stop_defined = fmu->stop_defined;
    h.exchange = fmu->kind == FMU_MODEL_EXCHANGE;
    h.standard = fmu->standard->number;
    h.start = fmu->start;
    h.time = fmu->time;
    h.stop = fmu->stop_defined ? fmu->stop : 0.0;
    ts_save(fmu->sim, bytes + sizeof h, size);
    h.checksum = checksum(h, bytes + sizeof h, size);
    memcpy(bytes, &h, sizeof h);
}

static int is_possible(const instance *fmu, const head *h)
{
    int one_mode = h->mode > 0 && !(h->mode & ~MODE_ANY) && !(h->mode & (h->mode - 1));
    int others = fmu->kind == FMU_MODEL_EXCHANGE ? MODE_STEPPING
                 : fmu->event_mode               ? MODE_CONTINUOUS
                                                 : MODE_EVENT | MODE_CONTINUOUS;
    return one_mode && !(h->mode & others) && isfinite(h->start) && isfinite(h->time) &&
           !isnan(h->stop); /* a host may know no end */
}

const char *fmu_state_refusal(const instance *fmu, const char *bytes, size_t size)
{
    head h;
    if (size < sizeof h) return "it is too short";
    memcpy(&h, bytes, sizeof h);
    if (h.magic != MAGIC) return "it is no state of this version";
    if (h.identity != fmu->identity) return "it belongs to another FMU";
    if (size != fmu_state_size(fmu)) return "it has been cut or lengthened";
    if (h.checksum != checksum(h, bytes + sizeof h, size - sizeof h)) return "it is damaged";
    if (h.standard != fmu->standard->number) return "it belongs to an instance of another FMI version";
    if (h.exchange != (fmu->kind == FMU_MODEL_EXCHANGE)) return "it belongs to an instance of the other kind";
    if (h.mode == MODE_EVENT && !h.exchange && !fmu->event_mode)
        return "it is in Event Mode, for which this instance is not made";
    return is_possible(fmu, &h) ? NULL : "it is none that an instance comes to";
}

int fmu_state_restore(instance *fmu, const char *bytes)
{
    head h;
    memcpy(&h, bytes, sizeof h);
    fmu->derivatives_ready = fmu->viewed = 0;
    int status = ts_restore(fmu->sim, bytes + sizeof h, ts_state_size(fmu->sim));
    if (status != TS_OK) return status;
    fmu->mode = h.mode;
    fmu->stale = h.stale;
    fmu->tolerance_set = h.tolerance_set;
    fmu->stop_defined = h.stop_defined;
    fmu->discarded = 0; /* says something of the last step, which is undone */
    fmu->start = h.start;
    fmu->time = h.time;
    fmu->stop = h.stop;
    return TS_OK;
}

/* --------------------------------------------------------------------------------------- states that the host holds */

static fmu_status one_of_ours(const instance *fmu, const char *what, const void *bytes, size_t size)
{
    const char *why = bytes ? fmu_state_refusal(fmu, (const char *)bytes, size) : "a null pointer was passed";
    return why ? fmu_refuse(fmu, what, why) : FMU_OK;
}

fmu_status fmu_get_state(instance *fmu, const char *what, void **state)
{
    if (!state) return fmu_refuse(fmu, what, "a null pointer was passed");
    if (ts_fill(fmu->sim, TS_OF_ALL) != TS_OK) return fmu_refuse(fmu, what, ts_message(fmu->sim));
    if (!*state && !(*state = malloc(fmu_state_size(fmu)))) return fmu_error(fmu, what, "out of memory");
    fmu_state_save(fmu, (char *)*state);
    return FMU_OK;
}

fmu_status fmu_set_state(instance *fmu, const char *what, void *state)
{
    fmu_status status = one_of_ours(fmu, what, state, fmu_state_size(fmu));
    if (status != FMU_OK) return status;
    return fmu_state_restore(fmu, (const char *)state) == TS_OK ? FMU_OK : fmu_error(fmu, what, ts_message(fmu->sim));
}

fmu_status fmu_free_state(void **state)
{
    if (!state) return FMU_OK;
    free(*state);
    *state = NULL;
    return FMU_OK;
}

fmu_status fmu_serialized_size(instance *fmu, const char *what, const void *state, size_t *size)
{
    if (!size) return fmu_refuse(fmu, what, "a null pointer was passed");
    fmu_status status = one_of_ours(fmu, what, state, fmu_state_size(fmu));
    if (status == FMU_OK) *size = fmu_state_size(fmu);
    return status;
}

fmu_status fmu_serialize(instance *fmu, const char *what, const void *state, void *bytes, size_t size)
{
    char why[96];
    if (!bytes) return fmu_refuse(fmu, what, "a null pointer was passed");
    fmu_status status = one_of_ours(fmu, what, state, fmu_state_size(fmu));
    if (status != FMU_OK) return status;
    snprintf(why, sizeof why, "the vector is too short; ask fmi%dSerialized%sSize", fmu->standard->number,
             fmu->standard->number == 2 ? "FMUstate" : "FMUState");
    if (size < fmu_state_size(fmu)) return fmu_refuse(fmu, what, why);
    memcpy(bytes, state, fmu_state_size(fmu));
    return FMU_OK;
}

fmu_status fmu_deserialize(instance *fmu, const char *what, const void *bytes, size_t size, void **state)
{
    if (!state) return fmu_refuse(fmu, what, "a null pointer was passed");
    fmu_status status = one_of_ours(fmu, what, bytes, size);
    if (status != FMU_OK) return status;
    char *copy = (char *)malloc(size);
    if (!copy) return fmu_error(fmu, what, "out of memory");
    memcpy(copy, bytes, size);
    *state = copy;
    return FMU_OK;
}
