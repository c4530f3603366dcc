/* The problem: right-hand side, Jacobian, events, outputs. */
#include "peer.h"

#include "linear/pattern.h"
#include "model/data.h"
#include "motion/jacobian.h"
#include "motion/motion.h"
#include "motion/outputs.h"
#include "motion/pieces.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void *read_file(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    if (!file) return NULL;
    fseek(file, 0, SEEK_END);
    *size = (size_t)ftell(file);
    rewind(file);
    void *bytes = malloc(*size + 1);
    if (fread(bytes, 1, *size, file) != *size) *size = 0;
    fclose(file);
    return bytes;
}

static int read_force(ts_sim *sim, const char *path)
{
    size_t size = 0;
    int32_t counts[TS_COUNTS];
    ts_counts(sim, counts);
    void *bytes = read_file(path, &size);
    int fits = bytes && size == sizeof(double) * (size_t)(counts[TS_F] * counts[TS_D]);
    if (fits) memcpy(ts_values(sim), bytes, size); /* the force is the first field */
    free(bytes);
    return fits;
}

static void add_root(peer *p, int string, int end, double at)
{
    p->root_string[p->roots] = string;
    p->root_end[p->roots] = end;
    p->root_at[p->roots++] = at;
}

/* A plain string's pieces have one finite end each, those of an NSH's curve have two. */
static void list_roots(peer *p)
{
    double ends[64];
    size_t most = 0;
    for (int i = 0; i < p->strings; i++) most += 2 + (size_t)ts_breakpoints(p->sim, i, NULL, 0);
    p->root_string = calloc(most, sizeof(int));
    p->root_end = calloc(most, sizeof(int));
    p->root_at = calloc(most, sizeof(double));
    p->roots = 0;
    for (int i = 0; i < p->strings; i++) {
        int count = ts_breakpoints(p->sim, i, ends, 64);
        if (p->events == PEER_PLAIN)
            for (int e = 0; e < count && e < 64; e++) add_root(p, i, e, ends[e]);
        else if (count == 1) add_root(p, i, 0, 0.0);
        else
            for (int end = -1; end <= 1; end += 2) add_root(p, i, end, 0.0);
    }
}

/* Read the packed model and the force on the free nodes (F * D doubles, N); 0 on failure, which stderr explains. */
int peer_open(peer *p, const char *model, const char *force, int events, double duration, int instants)
{
    char message[256] = "cannot be read";
    size_t size = 0;
    int32_t counts[TS_COUNTS];
    memset(p, 0, sizeof *p);
    void *bytes = read_file(model, &size);
    p->sim = bytes ? ts_create(bytes, size, message, sizeof message) : NULL;
    free(bytes);
    if (!p->sim) return fprintf(stderr, "model %s: %s\n", model, message), 0;
    if (!read_force(p->sim, force)) return fprintf(stderr, "force %s: missing or of the wrong size\n", force), 0;
    ts_counts(p->sim, counts);
    size_t room = (size_t)p->sim->m.stride;
    p->nq = p->sim->m.nq;
    p->n = 2 * p->nq;
    p->strings = counts[TS_S];
    p->events = events;
    p->duration = duration;
    p->instants = instants;
    p->start = calloc(room, sizeof(double));
    p->dy = calloc(room, sizeof(double));
    ts_locate(p->sim, events != PEER_NO_EVENTS);
    peer_begin(p);
    list_roots(p);
    ts_get_state(p->sim, p->start);
    return 1;
}

void peer_close(peer *p)
{
    ts_free(p->sim);
    free(p->start);
    free(p->dy);
    free(p->root_string);
    free(p->root_end);
    free(p->root_at);
    memset(p, 0, sizeof *p);
}

peer *peer_new(const char *model, const char *force, int events)
{
    peer *p = calloc(1, sizeof *p);
    if (peer_open(p, model, force, events, 1.0, 1)) return p;
    peer_delete(p);
    return NULL;
}

void peer_delete(peer *p)
{
    peer_close(p);
    free(p);
}

void peer_sizes(const peer *p, int32_t sizes[3])
{
    int32_t counts[TS_COUNTS];
    ts_counts(p->sim, counts);
    sizes[0] = p->n;
    sizes[1] = p->roots;
    sizes[2] = counts[TS_N] * counts[TS_D];
}

const double *peer_start(const peer *p) { return p->start; }

/* The start: state, constant forces and pieces as the kernel sets them. */
void peer_begin(peer *p)
{
    if (ts_initialize(p->sim, 0.0) != TS_OK) {
        fprintf(stderr, "initialize: %s\n", ts_message(p->sim));
        exit(2);
    }
    memset(&p->counts, 0, sizeof p->counts);
}

void peer_rhs(peer *p, const double *x, double *dx)
{
    ts_rhs(p->sim, 0.0, x, p->dy);
    p->counts.rhs++;
    memcpy(dx, p->dy, sizeof(double) * (size_t)p->n);
}

/* [0 I; Jq Jv], from the blocks that the kernel stores. */
void peer_jacobian(peer *p, const double *x, double *J)
{
    ts_sim *sim = p->sim;
    const ts_pattern *pattern = &sim->linear.pattern;
    int n = p->n, nq = p->nq, D = pattern->D;
    p->counts.jacobians++;
    sim->linear.ready = 0; /* what is at hand belongs to another state */
    ts_rhs_jacobian(sim, 0.0, x);
    memset(J, 0, sizeof(double) * (size_t)(n * n));
    for (int i = 0; i < nq; i++) J[(nq + i) * n + i] = 1.0;
    for (int i = 0; i < pattern->n; i++)
        for (int e = pattern->row[i]; e < pattern->row[i + 1]; e++)
            for (int r = 0; r < D; r++)
                for (int c = 0; c < D; c++) {
                    int row = nq + i * D + r, column = pattern->column[e] * D + c, entry = (e * D + r) * D + c;
                    J[column * n + row] = sim->linear.Jq[entry];
                    J[(nq + column) * n + row] = sim->linear.Jv[entry];
                }
}

/* The end of its piece that a root watches: -1 the lower, 1 the upper one. */
static int watched_end(const peer *p, int root)
{
    if (p->root_end[root]) return p->root_end[root];
    return p->sim->state.piece[p->root_string[root]] ? -1 : 1;
}

void peer_distances(peer *p, const double *x, double *g)
{
    const ts_sim *sim = p->sim;
    double gap = 0.0, rate;
    for (int r = 0, last = -1; r < p->roots; r++) {
        int i = p->root_string[r];
        if (i != last) ts_string_state(sim, 0.0, x, i, &gap, &rate);
        last = i;
        if (p->events == PEER_PLAIN) {
            g[r] = gap - p->root_at[r];
            continue;
        }
        double inside = watched_end(p, r) < 0 ? gap - sim->on.lo[i] : sim->on.hi[i] - gap;
        g[r] = inside < 1.0 ? inside : 1.0; /* an infinite end is never near */
    }
}

/* Carry out the transitions that a solver found, and put the bars back on their lengths. */
void peer_switch(peer *p, double *x, const int *found)
{
    for (int r = 0; r < p->roots; r++) {
        if (!found[r]) continue;
        int i = p->root_string[r], before = p->sim->state.piece[i];
        int after = p->events == PEER_PLAIN ? p->root_end[r] + (found[r] > 0) : before + watched_end(p, r);
        if (after == before) continue; /* round-off: the same root again, just after a restart */
        ts_place(p->sim, i, after);
        p->counts.transitions++;
    }
    ts_project(&p->sim->m, x);
}

double peer_outputs(peer *p, const double *x, double *position)
{
    const int32_t *at = p->sim->m.at;
    const double *values = ts_values(p->sim);
    memcpy(p->sim->state.y, x, sizeof(double) * (size_t)p->n);
    ts_rhs(p->sim, 0.0, p->sim->state.y, p->sim->start.f); /* whose findings the outputs are */
    ts_outputs(p->sim, 0.0, TS_OF_ALL);
    memcpy(position, values + at[TS_POSITION], sizeof(double) * (size_t)(at[TS_VELOCITY] - at[TS_POSITION]));
    return values[at[TS_KINETIC]] + values[at[TS_POTENTIAL]] + values[at[TS_ELASTIC]];
}
