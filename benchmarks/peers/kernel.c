/* Our own kernel, called as any host would: one ts_step() per output instant.  Method, tolerance and step stand in the
 * packed model. */
#include "peer.h"

#include "model/data.h"
#include "motion/motion.h"

#include <string.h>

static void *make(peer *p, const char *method, double tolerance)
{
    (void)tolerance;
    return strcmp(method, "kernel") ? NULL : p;
}

static int begin(void *self) { return ts_initialize(((peer *)self)->sim, 0.0); }

static int run(void *self, double *rows)
{
    peer *p = self;
    int64_t stats[TS_STATS];
    for (int k = 0; k < p->instants; k++) {
        int status = ts_step(p->sim, p->duration / p->instants);
        if (status != TS_OK) return status;
        ts_get_state(p->sim, p->dy);
        memcpy(rows + k * p->n, p->dy, sizeof(double) * (size_t)p->n);
    }
    ts_stats(p->sim, stats);
    p->counts = (peer_counts){stats[TS_STEPS], stats[TS_REJECTED], stats[TS_RHS], stats[TS_JACOBIANS], stats[TS_TRANSITIONS]};
    return 0;
}

static void release(void *self) { (void)self; }

const peer_solver peer_kernel = {"kernel", make, begin, run, release};

static void *make_alone(peer *p, const char *method, double tolerance)
{
    (void)tolerance;
    return strcmp(method, "rhs") ? NULL : p;
}

/* Right-hand sides one after the other; the rows are the start. */
static int run_alone(void *self, double *rows)
{
    peer *p = self;
    for (int i = 0; i < PEER_RHS_CALLS; i++) ts_rhs(p->sim, 0.0, p->start, p->dy);
    for (int k = 0; k < p->instants; k++) memcpy(rows + k * p->n, p->start, sizeof(double) * (size_t)p->n);
    p->counts.rhs = PEER_RHS_CALLS;
    return 0;
}

const peer_solver peer_alone = {"rhs", make_alone, begin, run_alone, release};
