/* Runs a kernel over a table of held inputs and measures the processor time of its steps alone.  Compiled into a library that
 * benchmarks/speed/method_choice.py calls; the kernel comes as functions, so that several of them can be compared in one process. */
#include "../harness/clock.h"

#include <stdint.h>
#include <string.h>

typedef struct ts_sim ts_sim;

typedef struct {
    int (*initialize)(ts_sim *sim, double time);
    int (*step)(ts_sim *sim, double h);
    double *(*values)(ts_sim *sim);
} kernel;

/* One run: `count` calls of lengths h (s), the first `width` values of the block set to a row before each (rows: how many there
 * are; the last one stays).  Returns the processor time of all calls, s, or -1 - status of the call that failed; most: seconds
 * after which the run is given up, with -1000. */
double run(const kernel *k, ts_sim *sim, int64_t count, const double *h, int64_t rows, int64_t width, const double *table,
           double most)
{
    double *block = k->values(sim);
    memcpy(block, table, sizeof(double) * (size_t)width);
    int status = k->initialize(sim, 0.0);
    if (status) return -1.0 - status;
    double start = now();
    for (int64_t n = 0; n < count; n++) {
        if (n < rows) memcpy(block, table + n * width, sizeof(double) * (size_t)width);
        status = k->step(sim, h[n]);
        if (status) return -1.0 - status;
        if (n % 64 == 63 && now() - start > most) return -1000.0;
    }
    return now() - start;
}
