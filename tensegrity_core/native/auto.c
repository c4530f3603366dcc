/* `auto`: the explicit method until stability, not accuracy, limits its step; then an implicit one for as long as its steps
 * are worth their cost.  After a transition the explicit method goes first: it is the cheaper one through the transient that
 * a string leaves which snaps taut, and finds out in a few steps whether the rest is stiff. */
#include "internal.h"

#include <math.h>

#define REACH 6.0      /* h times the fastest rate that dop853 bears */
#define WORTH 4.0      /* an implicit step costs as much as this many explicit ones */
#define BOLD 4.0       /* first implicit step over the last explicit one */
#define CALM_SIGNS 2   /* implicit steps not worth their cost after which the explicit method returns */
#define MAX_PATIENCE 24
#define TIGHT 1e-3     /* tolerance from which on the order of radau9 pays */

/* Bound of the fastest rate of the linearised system from the Jacobian at hand (1/s). */
static double fastest_rate(const ts_sim *sim)
{
    const ts_pattern *p = &sim->pattern;
    int D = sim->m.count[TS_D];
    double velocity = 0.0, position = 0.0;
    for (int i = 0; i < p->n; i++)
        for (int r = 0; r < D; r++) {
            double v = 0.0, q = 0.0;
            for (int n = p->row[i]; n < p->row[i + 1]; n++)
                for (int c = 0; c < D; c++) {
                    v += fabs(sim->Jv[(n * D + r) * D + c]);
                    q += fabs(sim->Jq[(n * D + r) * D + c]);
                }
            velocity = fmax(velocity, v);
            position = fmax(position, q);
        }
    return fmax(velocity, sqrt(position));
}

/* A step was taken without a transition. */
void ts_review_method(ts_sim *sim, double h)
{
    ts_memory *memory = &sim->memory;
    if (memory->method != TS_METHOD_AUTO) return;
    if (memory->active == TS_METHOD_DOP853) {
        if (memory->stiff < memory->patience) return;
        memory->active = sim->values[sim->m.at[TS_TOLERANCE]] <= TIGHT ? TS_METHOD_RADAU9 : TS_METHOD_RODAS5P;
        memory->h_next = fmax(memory->h_next, BOLD * h);
        memory->stiff = 0;
        return;
    }
    double bearable = REACH / fastest_rate(sim);
    memory->stiff = memory->h_next < WORTH * bearable ? memory->stiff + 1 : 0;
    if (memory->stiff < CALM_SIGNS) return;
    memory->active = TS_METHOD_DOP853;
    memory->h_next = fmin(memory->h_next, bearable);
    memory->stiff = 0;
    memory->patience = memory->patience * 2 > MAX_PATIENCE ? MAX_PATIENCE : memory->patience * 2;
}

/* A transition was carried out; f0 is the derivative after it. */
void ts_review_restart(ts_sim *sim, double tau)
{
    ts_memory *memory = &sim->memory;
    int ny = sim->m.ny;
    if (memory->method != TS_METHOD_AUTO || memory->active == TS_METHOD_DOP853) return;
    double tolerance = sim->values[sim->m.at[TS_TOLERANCE]];
    double speed = ts_error_norm(sim, sim->f0, sim->y, sim->y) * tolerance, h = 1e-4 / speed;
    memory->active = TS_METHOD_DOP853;
    memory->stiff = 0;
    if (!(h > 0.0 && h < memory->h_next)) return;
    for (int i = 0; i < ny; i++) sim->y1[i] = sim->y[i] + h * sim->f0[i];
    ts_rhs(sim, tau + h, sim->y1, sim->f1);
    for (int i = 0; i < ny; i++) sim->err[i] = sim->f1[i] - sim->f0[i];
    double rate = ts_error_norm(sim, sim->err, sim->y, sim->y) * tolerance / (h * speed); /* of the transient */
    memory->h_next = fmin(memory->h_next, 0.5 * REACH / rate);
}
