/* What parts of a step, steps and transitions of scenes cost, as lines of text on stdout.
 *
 *   scene_costs ROUNDS METHODS { MODEL FORCE DURATION WHAT } ...
 *
 * METHODS: numbers of methods, such as 1,2,5; MODEL: a packed model (tensegrity_core.kernel.to_bytes); FORCE: the force on the
 * free nodes as doubles, N, or - for none; DURATION: of a run, s; WHAT: letters, p: parts with all strings' data at hand,
 * c: the same after the caches were emptied, r: runs.
 *
 * Lines "SCENE NAME ns" are one batch each: the mean of so many repetitions that a batch lasts for BATCH.  A round takes one
 * batch of everything from every scene.  Lines "SCENE NAME = number" are facts.  Runs of one ts_step() each: `smooth` under
 * so small a part of the force that no string changes its piece under any method, `full` under so large a multiple that strings
 * do under all of them (halved and doubled from 1, again and again); `transition` and the fact `lost`: clock and count of
 * scene_costs_traced.c.  Times are processor times. */
#define _POSIX_C_SOURCE 199309L
#include "methods/systems.h"
#include "model/data.h"
#include "motion/jacobian.h"
#include "motion/motion.h"
#include "tensegrity.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#define BATCH 1e-3          /* s */
#define EVICTED (128 << 20) /* bytes to walk through, more than caches hold */
#define MOST_METHODS 8
#define MOST_HALVINGS 60
#define MOST_DOUBLINGS 8
#define RATE 1e4 /* 1/s, `a` of the matrices that are factorised */

typedef struct {
    int number;
    ts_sim *sim;
    double *force;
    double duration, smooth_part, full_part;
    const char *what;
} scene;

typedef struct {
    int count, number[MOST_METHODS];
} methods;

extern int tracing;
extern double traced, lost;
void trace_anew(void);

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void give_up(const char *what, const char *why)
{
    fprintf(stderr, "scene_costs: %s: %s\n", what, why);
    exit(1);
}

static void *read_file(const char *path, size_t *size)
{
    FILE *file = fopen(path, "rb");
    if (!file || fseek(file, 0, SEEK_END)) give_up(path, "cannot be read");
    *size = (size_t)ftell(file);
    rewind(file);
    void *bytes = malloc(*size + 1);
    if (!bytes || fread(bytes, 1, *size, file) != *size) give_up(path, "cannot be read");
    fclose(file);
    return bytes;
}

/* ---- Parts of a step ---- */

static void rhs(ts_sim *sim) { ts_rhs(sim, 0.0, sim->state.y, sim->start.f); }
static void jacobian(ts_sim *sim)
{
    sim->linear.ready = 0;
    ts_rhs_jacobian(sim, 0.0, sim->state.y);
}

static void factorise(ts_sim *sim)
{
    if (!ts_stage_factorise(sim, RATE)) give_up("factorisation", "singular");
}

static void pair_factorise(ts_sim *sim)
{
    if (!ts_pair_factorise(sim, 0, RATE, RATE)) give_up("complex factorisation", "singular");
}

/* Solutions replace their right-hand side, which is therefore put back: repeated solutions fade to numbers that are slow. */
static void solve(ts_sim *sim)
{
    memcpy(sim->attempt.k, sim->start.f, sizeof(double) * (size_t)sim->m.stride);
    ts_stage_solve(sim, RATE, sim->attempt.k);
}

static void pair_solve(ts_sim *sim)
{
    double *second = sim->attempt.k + sim->m.stride;
    memcpy(sim->attempt.k, sim->start.f, sizeof(double) * (size_t)sim->m.stride);
    memcpy(second, sim->start.f, sizeof(double) * (size_t)sim->m.stride);
    ts_pair_solve(sim, 0, RATE, RATE, sim->attempt.k, second);
}

static const struct {
    const char *name;
    void (*call)(ts_sim *sim);
} parts[] = {
    {"rhs", rhs},
    {"jacobian", jacobian},
    {"factorisation", factorise},
    {"solve", solve},
    {"complex_factorisation", pair_factorise},
    {"complex_solve", pair_solve},
};

static void time_parts(const scene *s)
{
    for (size_t p = 0; p < sizeof parts / sizeof *parts; p++) {
        double start = now(), spent;
        long n = 0, more = 1;
        do {
            for (long i = 0; i < more; i++) parts[p].call(s->sim);
            n += more;
            more = n;
            spent = now() - start;
        } while (spent < BATCH);
        printf("%d %s %.6g\n", s->number, parts[p].name, 1e9 * spent / (double)n);
    }
}

static void time_cold_parts(const scene *s)
{
    static volatile char *walk;
    if (!walk && !(walk = calloc(EVICTED, 1))) give_up("caches", "out of memory");
    for (size_t p = 0; p < sizeof parts / sizeof *parts; p++) {
        for (size_t i = 0; i < EVICTED; i += 64) walk[i]++;
        double start = now();
        parts[p].call(s->sim);
        printf("%d cold_%s %.6g\n", s->number, parts[p].name, 1e9 * (now() - start));
    }
}

/* ---- Runs ---- */

/* One run from the start under this part of the force; its time in s. */
static double run(const scene *s, int method, double part, int64_t stats[TS_STATS])
{
    ts_sim *sim = s->sim;
    double *force = ts_values(sim) + sim->m.at[TS_FORCE];
    ts_integers(sim)[sim->m.int_at[TS_INT_METHOD]] = method;
    for (int i = 0; i < sim->m.count[TS_F] * sim->m.count[TS_D]; i++) force[i] = s->force ? part * s->force[i] : 0.0;
    if (ts_initialize(sim, 0.0)) give_up("ts_initialize", ts_message(sim));
    trace_anew();
    double start = now();
    int status = ts_step(sim, s->duration);
    double spent = now() - start;
    if (status) give_up("ts_step", ts_message(sim));
    ts_stats(sim, stats);
    return spent;
}

/* A part of the force under which no method meets a transition (wanted 0), or all do (1); -1: none is found. */
static double part_of_force(const scene *s, const methods *m, int wanted)
{
    double part = 1.0;
    int64_t stats[TS_STATS];
    for (int k = 0, changes = 0; k < m->count;) {
        run(s, m->number[k], part, stats);
        if ((stats[TS_TRANSITIONS] > 0) == wanted) k++;
        else if (changes++ == (wanted ? MOST_DOUBLINGS : MOST_HALVINGS)) return -1.0;
        else part *= wanted ? 2.0 : 0.5;
    }
    return part;
}

static void report_counts(int scene, const char *run, int method, const int64_t stats[TS_STATS])
{
    static const struct {
        int at;
        const char *name;
    } kept[] = {
        {TS_STEPS, "steps"},       {TS_REJECTED, "rejected"}, {TS_RHS, "rhs"}, {TS_TRANSITIONS, "transitions"},
        {TS_RESTARTS, "restarts"},
    };
    for (size_t i = 0; i < sizeof kept / sizeof *kept; i++)
        printf("%d %s_%d_%s = %lld\n", scene, run, method, kept[i].name, (long long)stats[kept[i].at]);
}

/* One batch of runs of one kind by one method. */
static void time_run(const scene *s, int method, const char *kind, double part, int report)
{
    int64_t stats[TS_STATS] = {0};
    double spent = 0.0;
    long n = 0;
    traced = lost = 0.0;
    for (; spent < BATCH; n++) spent += run(s, method, part, stats);
    double transitions = (double)(n * stats[TS_RESTARTS]);
    printf("%d %s_%d %.9g\n", s->number, kind, method, 1e9 * (tracing ? traced / transitions : spent / (double)n));
    if (report && tracing) printf("%d lost_%d = %.9g\n", s->number, method, lost / transitions);
    else if (report) report_counts(s->number, kind, method, stats);
}

static void time_runs(const scene *s, const methods *m, int report)
{
    for (int k = 0; k < m->count; k++) {
        time_run(s, m->number[k], "smooth", s->smooth_part, report);
        if (!(s->full_part > 0.0)) continue;
        time_run(s, m->number[k], "full", s->full_part, report);
        tracing = 1;
        time_run(s, m->number[k], "transition", s->full_part, report);
        tracing = 0;
    }
}

/* ---- Scenes ---- */

static scene make(int number, char **words, const methods *m)
{
    size_t size, force_size;
    char message[256];
    void *model = read_file(words[0], &size);
    scene s = {number, ts_create(model, size, message, sizeof message), NULL, atof(words[2]), 1.0, 1.0, words[3]};
    if (!s.sim) give_up(words[0], message);
    free(model);
    if (strcmp(words[1], "-")) {
        s.force = read_file(words[1], &force_size);
        size_t wanted = sizeof(double) * (size_t)(s.sim->m.count[TS_F] * s.sim->m.count[TS_D]);
        if (force_size != wanted) give_up(words[1], "is not the force on the free nodes of the model");
    }
    if (strchr(s.what, 'r')) {
        s.smooth_part = part_of_force(&s, m, 0);
        s.full_part = part_of_force(&s, m, 1);
        if (!(s.smooth_part > 0.0)) give_up(words[0], "strings change their pieces without a push");
    }
    printf("%d states = %d\n%d strings = %d\n", number, 2 * s.sim->m.nq, number, s.sim->m.count[TS_S]);
    printf("%d bars = %d\n%d blocks = %d\n", number, s.sim->m.count[TS_B], number, s.sim->linear.pattern.count);
    printf("%d memory = %zu\n", number, ts_memory_size(s.sim));
    printf("%d smooth_part = %.9g\n%d full_part = %.9g\n", number, s.smooth_part, number, s.full_part);
    return s;
}

static methods read_methods(const char *text)
{
    methods m = {0, {0}};
    for (char *end; *text && m.count < MOST_METHODS; text = *end == ',' ? end + 1 : end) {
        m.number[m.count++] = (int)strtol(text, &end, 10);
        if (end == text) give_up("METHODS", "not numbers with commas between them");
    }
    return m;
}

int main(int argc, char **argv)
{
    if (argc < 7 || (argc - 3) % 4) give_up("arguments", "ROUNDS METHODS { MODEL FORCE DURATION WHAT } ...");
    int rounds = atoi(argv[1]), count = (argc - 3) / 4;
    methods m = read_methods(argv[2]);
    scene *scenes = calloc((size_t)count, sizeof *scenes);
    if (!scenes) give_up("scenes", "out of memory");
    for (int i = 0; i < count; i++) scenes[i] = make(i, argv + 3 + 4 * i, &m);
    for (int r = 0; r < rounds; r++)
        for (int i = 0; i < count; i++) {
            int64_t stats[TS_STATS];
            if (strchr(scenes[i].what, 'r')) time_runs(scenes + i, &m, r == 0);
            run(scenes + i, m.number[0], scenes[i].smooth_part, stats); /* all strings as at the start, nodes moving */
            jacobian(scenes[i].sim);
            factorise(scenes[i].sim);
            pair_factorise(scenes[i].sim);
            if (strchr(scenes[i].what, 'p')) time_parts(scenes + i);
            if (strchr(scenes[i].what, 'c')) time_cold_parts(scenes + i);
        }
    for (int i = 0; i < count; i++) {
        ts_free(scenes[i].sim);
        free(scenes[i].force);
    }
    free(scenes);
    return 0;
}
