/* Processor time of the one thread that there is, s.  Include it first: what it asks of the system must stand above headers of
 * the system's. */
#ifndef BENCHMARKS_CLOCK_H
#define BENCHMARKS_CLOCK_H
#ifndef _POSIX_C_SOURCE
#define _POSIX_C_SOURCE 200809L
#endif
#include <time.h>

static inline double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

#endif
