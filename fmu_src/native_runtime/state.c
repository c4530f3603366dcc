/* An instance's state as bytes: complete, versioned, bound to its FMU, with a checksum.  A saved FMU state and a serialised
 * one are the same bytes. */
#include "instance.h"

#include <math.h>
#include <string.h>

#define MAGIC 0x3155464d45545354u /* "TSTEMFU1" */

typedef struct {
    uint64_t magic, identity;
    int32_t mode, stale, tolerance_set, stop_defined, exchange, spare;
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
    h.exchange = fmu->kind == fmi2ModelExchange;
    h.start = fmu->start;
    h.time = fmu->time;
    h.stop = fmu->stop_defined ? fmu->stop : 0.0;
    ts_save(fmu->sim, bytes + sizeof h, size);
    h.checksum = checksum(h, bytes + sizeof h, size);
    memcpy(bytes, &h, sizeof h);
}

static int is_possible(const head *h)
{
    int one_mode = h->mode > 0 && !(h->mode & ~FMU_ANY) && !(h->mode & (h->mode - 1));
    int others = h->exchange ? FMU_STEPPING : FMU_EVENT | FMU_CONTINUOUS; /* modes of the other kind */
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
    if (h.exchange != (fmu->kind == fmi2ModelExchange)) return "it belongs to an instance of the other kind";
    return is_possible(&h) ? NULL : "it is none that an instance comes to";
}

int fmu_state_restore(instance *fmu, const char *bytes)
{
    head h;
    memcpy(&h, bytes, sizeof h);
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
