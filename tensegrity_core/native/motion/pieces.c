/* The piece of its force curve that a string is on, and what it bears there. */
#include "motion/pieces.h"
#include "invariants.h"
#include "linear/pairs.h"
#include "model/data.h"

#include <float.h>
#include <math.h>

/* What a string bears on its piece: coefficients of its tension, zero where it bears nothing. */
void ts_bear(ts_sim *sim, int i)
{
    const ts_model *m = &sim->m;
    int taut = sim->on.taut[i];
    double k = sim->io.values[m->at[TS_STIFFNESS] + i];
    sim->on.k[i] = taut && !m->string.curved[i] ? k : 0.0;
    sim->on.d[i] = taut ? sim->io.values[m->at[TS_DAMPING] + i] : 0.0;
}

/* Put a string on a piece. */
ALWAYS_INLINE void place(ts_sim *sim, int i, int piece)
{
    const ts_model *m = &sim->m;
    const ts_curve *c = sim->laws.curve + i;
    int D = m->count[TS_D];
    double size = sim->io.values[m->at[TS_REST_LENGTH] + i];
    TS_ASSERT(sim->laws.ready && piece >= 0 && piece < c->pieces);
    sim->state.piece[i] = piece;
    sim->on.taut[i] = c->piece[piece].kind != TS_SLACK;
    sim->on.lo[i] = c->piece[piece].lo;
    sim->on.hi[i] = c->piece[piece].hi;
    for (int d = 0; d < D; d++) {
        size += fabs(m->string.s0[i * D + d]);
        for (int k = 0; k < m->string.term_count[i]; k++) size += fabs(sim->state.y[m->string.term[4 * i + k].offset + d]);
    }
    sim->on.guard[i] = 2.0 * DBL_EPSILON * size;
    if (!sim->on.taut[i] || m->damping_law != TS_TENSION_ONLY) sim->state.clipped[i] = 0;
    ts_bear(sim, i);
}

/* Round-off of a routed string, by its segments; and a spring that also pushes has no end. */
APART static void place_otherwise(ts_sim *sim, int i, int piece)
{
    const ts_lines *lines = &sim->m.string;
    const int D = sim->m.count[TS_D];
    place(sim, i, piece);
    if (lines->two_way[i]) {
        sim->on.taut[i] = TS_PUSHES;
        sim->on.lo[i] = -INFINITY;
        sim->state.clipped[i] = 0;
    }
    if (lines->routed[i] < 0) return;
    const ts_route *route = lines->route + lines->routed[i];
    double size = 0.0;
    for (int k = route->first * D; k < (route->first + route->count) * D; k++) size += fabs(lines->s0[k]);
    for (int k = 4 * route->first; k < 4 * (route->first + route->count); k++)
        for (int d = 0; d < D && k % 4 < lines->term_count[k / 4]; d++) size += fabs(sim->state.y[lines->term[k].offset + d]);
    sim->on.guard[i] += 2.0 * DBL_EPSILON * size;
}

void ts_place(ts_sim *sim, int i, int piece)
{
    if (sim->m.string.otherwise) place_otherwise(sim, i, piece);
    else place(sim, i, piece);
}
