/* One job from the command line, its result as JSON on stdout.
 *
 *   peers MODEL FORCE METHOD TOLERANCE EVENTS DURATION INSTANTS REPETITIONS LIMIT
 *
 * MODEL: packed model (tensegrity_core.kernel.to_bytes); FORCE: the force on the free nodes as doubles, N; METHOD: kernel
 * (TOLERANCE is then the packed model's), rhs (evaluates it and nothing else), cvode_bdf, cvode_adams, erk_X or dirk_X, X
 * being one of ARKODE's Butcher tables or an order; EVENTS: 0 none, 1 directed, 2 plain (peer.h); LIMIT: s of processor
 * time, after which SIGXCPU ends the program.
 * Each repetition is timed by itself, in processor time, from the start of the motion to its end.  A run before them warms
 * up, unless it takes so long that it can count itself. */
#define _XOPEN_SOURCE 600
#include "peer.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#define WARM 0.05 /* s, of a run that needs no warming up */

static const peer_solver *const solvers[] = {
    &peer_kernel,
    &peer_alone,
#ifdef WITH_SUNDIALS
    &peer_sundials,
#endif
};

static double now(void)
{
    struct timespec t;
    /* Other work of the machine does not count.  There is one thread; Linux lets the clock of a process whose time is limited
     * advance by whole ticks. */
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void print_number(double x, const char *after)
{
    if (isfinite(x)) printf("%.17g%s", x, after);
    else printf("null%s", after);
}

static void print_state(peer *p, const double *x, const char *after)
{
    int32_t sizes[3];
    peer_sizes(p, sizes);
    double *position = calloc((size_t)sizes[2], sizeof(double));
    printf("{\"energy\": ");
    print_number(peer_outputs(p, x, position), ", \"position\": [");
    for (int i = 0; i < sizes[2]; i++) print_number(position[i], i + 1 < sizes[2] ? ", " : "]}");
    printf("%s", after);
    free(position);
}

static void print_result(peer *p, int status, const char *reason, const double *seconds, int repetitions, const double *rows)
{
    const peer_counts *c = &p->counts;
    printf("{\"status\": %d, \"reason\": \"%s\", \"seconds\": [", status, reason);
    for (int r = 0; r < repetitions; r++) print_number(seconds[r], r + 1 < repetitions ? ", " : "");
    printf("],\n\"counts\": {\"steps\": %lld, \"rejected\": %lld, \"rhs\": %lld, ", (long long)c->steps, (long long)c->rejected,
           (long long)c->rhs);
    printf("\"jacobians\": %lld, \"transitions\": %lld},\n", (long long)c->jacobians, (long long)c->transitions);
    printf("\"rows\": [");
    if (status == 0) print_state(p, p->start, p->instants ? ",\n" : "");
    for (int k = 0; k < p->instants && status == 0; k++) print_state(p, rows + k * p->n, k + 1 < p->instants ? ",\n" : "");
    printf("]}\n");
}

static void measure(peer *p, const peer_solver *solver, void *self, int repetitions)
{
    double *rows = calloc((size_t)(p->instants * p->n), sizeof(double));
    double *seconds = calloc((size_t)repetitions, sizeof(double));
    int status = 0, done = 0;
    for (int first = 1; done < repetitions && status == 0; first = 0) {
        status = solver->begin(self);
        double start = now();
        if (status == 0) status = solver->run(self, rows);
        double spent = now() - start;
        if (!first || spent > WARM) seconds[done++] = spent;
    }
    print_result(p, status, solver == &peer_kernel ? ts_status_name(status) : "error code of SUNDIALS", seconds, done, rows);
    free(rows);
    free(seconds);
}

static const peer_solver *find_solver(const char *method)
{
    for (size_t i = 0; i < sizeof solvers / sizeof *solvers; i++)
        if (!strncmp(method, solvers[i]->name, strlen(solvers[i]->name))) return solvers[i];
    return NULL;
}

int main(int argc, char **argv)
{
    peer p;
    if (argc != 10) {
        fprintf(stderr, "usage: peers MODEL FORCE METHOD TOLERANCE EVENTS DURATION INSTANTS REPETITIONS LIMIT\n");
        return 2;
    }
    rlim_t limit = (rlim_t)ceil(atof(argv[9]));
    setrlimit(RLIMIT_CPU, &(struct rlimit){limit, limit + 1});
    const char *method = argv[3];
    const peer_solver *solver = find_solver(method);
    if (!peer_open(&p, argv[1], argv[2], atoi(argv[5]), atof(argv[6]), atoi(argv[7]))) return 2;
    void *self = solver ? solver->make(&p, method, atof(argv[4])) : NULL;
    if (!self) return fprintf(stderr, "method %s: unknown to this build\n", method), 2;
    measure(&p, solver, self, atoi(argv[8]));
    solver->release(self);
    peer_close(&p);
    return 0;
}
