/* One initial value problem as foreign solvers see it: x = [q, q'], x' = f(x), with or without events.
 *
 * With events every string keeps the formula of its piece of the force curve, and the solver is to find where an
 * elongation leaves its piece.  Without, the pieces follow the elongations at every evaluation: the full law, with its
 * jumps and kinks.  Inputs are constant and the damping law is the literal one.
 *
 * Events come in two forms.  PEER_DIRECTED: one or two roots per string, the distances to the ends of its present piece,
 * which a transition can only bring from plus to minus.  PEER_PLAIN: one root per end in the whole force curve, the
 * elongation beyond it, whose sign change either way is a transition.  With PEER_PLAIN the solvers are set up as their
 * manuals' examples do, too: untuned, started anew after each transition. */
#ifndef PEER_H
#define PEER_H

#include "tensegrity.h"

enum { PEER_NO_EVENTS, PEER_DIRECTED, PEER_PLAIN };

#define PEER_TOGETHER 1e-13  /* of the duration: two instants that are one */
#define PEER_RHS_CALLS 10000 /* of the method `rhs`, which does nothing else */

typedef struct {
    int64_t steps, rejected, rhs, jacobians, transitions;
} peer_counts;

typedef struct {
    ts_sim *sim;
    int n, nq, strings; /* n = 2 nq */
    int events;
    double duration; /* s */
    int instants;    /* output after duration/instants, 2 duration/instants, ... */
    int roots;
    int *root_string;   /* (roots) */
    int *root_end;      /* (roots) directed: -1 lower end of the piece, 1 upper end, 0 the one end of a plain string's piece;
                             plain: which end of the force curve, from 0 */
    double *root_at;    /* (roots) plain: elongation there, m */
    double *start, *dy; /* (m.stride) */
    peer_counts counts;
} peer;

/* A solver's side: made once per job, begun (not timed) and run (timed) once per repetition. */
typedef struct {
    const char *name;                                             /* how the names of its methods begin; "": any */
    void *(*make)(peer *p, const char *method, double tolerance); /* NULL: no such method */
    int (*begin)(void *self);
    int (*run)(void *self, double *rows); /* rows (instants, n); 0: done, else the solver's own code */
    void (*release)(void *self);
} peer_solver;

extern const peer_solver peer_kernel, peer_alone, peer_sundials;

int peer_open(peer *p, const char *model, const char *force, int events, double duration, int instants);
void peer_close(peer *p);

/* For a host in another language. */
TS_API peer *peer_new(const char *model, const char *force, int events); /* NULL on failure */
TS_API void peer_delete(peer *p);
TS_API void peer_sizes(const peer *p, int32_t sizes[3]); /* n, roots, coordinates of all nodes */
TS_API const double *peer_start(const peer *p);

TS_API void peer_begin(peer *p);
TS_API void peer_rhs(peer *p, const double *x, double *dx);
TS_API void peer_jacobian(peer *p, const double *x, double *J);  /* (n, n) by columns */
TS_API void peer_distances(peer *p, const double *x, double *g); /* (roots) m */
TS_API void peer_switch(peer *p, double *x, const int *found);   /* found (roots): 1 rising root, -1 falling one, 0 none */
TS_API double peer_outputs(peer *p, const double *x, double *position); /* node positions, m; returns the energy, J */

#endif
