/* One job from the command line, its result as JSON on stdout.
 *
 *   peers MODEL FORCE METHOD TOLERANCE EVENTS DURATION INSTANTS REPETITIONS
 *
 * MODEL: packed model (tensegrity_core.model.to_bytes); FORCE: the force on the free nodes as doubles, N; METHOD: kernel
 * (TOLERANCE is then the packed model's), cvode_bdf, cvode_adams, erk_X or dirk_X, X being one of ARKODE's Butcher tables or
 * an order; EVENTS: 0 none, 1 directed, 2 plain (peer.h).
 * Each repetition is timed by itself, in processor time, from the start of the motion to its end; one run before them warms up. */
#define _POSIX_C_SOURCE 199309L
#include "peer.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

static const peer_solver *const solvers[] = {
    &peer_kernel,
#ifdef WITH_SUNDIALS
    &peer_cvode, &peer_erk, &peer_dirk,
#endif
};

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t); /* other work of the machine does not count */
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
    printf("],\n\"counts\": {\"steps\": %lld, \"rejected\": %lld, \"rhs\": %lld, \"jacobians\": %lld, \"transitions\": %lld},\n",
           (long long)c->steps, (long long)c->rejected, (long long)c->rhs, (long long)c->jacobians, (long long)c->transitions);
    printf("\"rows\": [");
    if (status == 0) print_state(p, p->start, p->instants ? ",\n" : "");
    for (int k = 0; k < p->instants && status == 0; k++) print_state(p, rows + k * p->n, k + 1 < p->instants ? ",\n" : "");
    printf("]}\n");
}

static void measure(peer *p, const peer_solver *solver, void *self, int repetitions)
{
    double *rows = calloc((size_t)(p->instants * p->n), sizeof(double)), *seconds = calloc((size_t)repetitions, sizeof(double));
    int status = 0, done = 0;
    for (int r = -1; r < repetitions && status == 0; r++) {
        status = solver->begin(self);
        double start = now();
        if (status == 0) status = solver->run(self, rows);
        if (r >= 0) seconds[done++] = now() - start;
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
    if (argc != 9) return fprintf(stderr, "usage: peers MODEL FORCE METHOD TOLERANCE EVENTS DURATION INSTANTS REPETITIONS\n"), 2;
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
