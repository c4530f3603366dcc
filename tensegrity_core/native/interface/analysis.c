/* For tests and analysis: derivatives, Jacobian, force laws. */
#include "interface/applied.h"
#include "interface/checks.h"
#include "interface/ready.h"
#include "interface/watched.h"
#include "laws/curve.h"
#include "linear/pairs.h"
#include "model/data.h"
#include "motion/jacobian.h"
#include "motion/joints.h"
#include "motion/motion.h"
#include "motion/outputs.h"
#include "motion/pieces.h"
#include "steps/integrate.h"
#include "tensegrity.h"

#include <math.h>
#include <string.h>

int ts_output_derivatives(ts_sim *sim, double *out)
{
    if (sim->call.watching) return ts_look_derivatives(sim, out);
    if (ts_ready(sim) != TS_OK) return TS_BAD_STEP;
    ts_memory memory = sim->memory;
    ts_swap_applied(sim);
    ts_derive(sim);
    ts_tangent_outputs(sim, sim->memory.last_step, out);
    ts_swap_back(sim);
    sim->memory = memory; /* looking changes nothing, not even the count of right-hand sides */
    return ts_check_rates(sim, out);
}

void ts_locate(ts_sim *sim, int on) { sim->call.unlocated = !on; }
int32_t ts_state_length(const ts_sim *sim) { return sim->m.ny; }
void ts_get_state(const ts_sim *sim, double *y)
{
    ts_bring_state((ts_sim *)sim);
    memcpy(y, sim->state.y, sizeof(double) * (size_t)sim->m.ny);
}

/* Analysis takes inputs and parameters as they stand. */
static void take_values(ts_sim *sim)
{
    ts_prepare(sim);
    for (int i = 0; i < sim->m.count[TS_S]; i++) ts_bear(sim, i);
}

void ts_derivative(ts_sim *sim, double tau, const double *y, double *dy)
{
    take_values(sim);
    ts_rhs(sim, tau, y, dy);
}

void ts_jacobian(ts_sim *sim, double tau, const double *y, double *Jq, double *Jv, double *ft)
{
    const ts_pattern *p = &sim->linear.pattern;
    size_t nq = (size_t)sim->m.nq, D = (size_t)sim->m.count[TS_D];
    take_values(sim);
    sim->linear.ready = 0;
    ts_rhs_jacobian(sim, tau, y);
    sim->linear.ready = 0;
    memset(Jq, 0, sizeof(double) * nq * nq);
    memset(Jv, 0, sizeof(double) * nq * nq);
    for (size_t i = 0; i < (size_t)sim->m.blocks; i++)
        for (size_t n = (size_t)p->row[i]; n < (size_t)p->row[i + 1]; n++)
            for (size_t r = 0; r < D && p->column[n] < sim->m.blocks; r++)
                for (size_t c = 0; c < D; c++) {
                    size_t at = (i * D + r) * nq + (size_t)p->column[n] * D + c;
                    Jq[at] = sim->linear.Jq[(n * D + r) * D + c];
                    Jv[at] = sim->linear.Jv[(n * D + r) * D + c];
                }
    if (sim->m.joint.nodes) ts_eliminate_multipliers(sim, Jq, Jv);
    memcpy(ft, sim->linear.ft, sizeof(double) * nq);
}

int ts_string_law(const ts_sim *sim, int32_t string, double elongation, double out[3])
{
    if (!sim->laws.ready) return -1;
    return ts_piece_law(sim, string, ts_curve_piece(sim->laws.curve + string, elongation), elongation, out);
}

int ts_piece_law(const ts_sim *sim, int32_t string, int32_t piece, double elongation, double out[3])
{
    if (!sim->laws.ready || piece < 0 || piece >= sim->laws.curve[string].pieces) return -1;
    const ts_curve *c = sim->laws.curve + string;
    double k = sim->io.values[sim->m.at[TS_STIFFNESS] + string];
    out[0] = ts_curve_force(c, piece, elongation, k, out + 1);
    out[2] = ts_curve_energy(c, piece, elongation, k);
    return piece;
}

int ts_breakpoints(const ts_sim *sim, int32_t string, double *out, int32_t capacity)
{
    if (!sim->laws.ready) return -1;
    const ts_curve *c = sim->laws.curve + string;
    int count = 0;
    for (int p = 0; p >= 0 && c->piece[p].hi < INFINITY && count <= c->pieces; p = c->piece[p].up, count++)
        if (count < capacity) out[count] = c->piece[p].hi;
    return count;
}

int ts_curve_pieces(const ts_sim *sim, int32_t string, ts_curve_piece_info *out, int32_t capacity)
{
    if (!sim->laws.ready) return -1;
    const ts_curve *c = sim->laws.curve + string;
    for (int i = 0; i < c->pieces && i < capacity; i++) {
        const ts_piece *p = c->piece + i;
        const double lo = sim->m.string.two_way[string] ? -INFINITY : p->lo;
        out[i] =
            MAKE(ts_curve_piece_info){lo, p->hi, p->loss_up, p->loss_down, p->up, p->down, p->snapped, p->kind == TS_SLACK};
    }
    return c->pieces;
}
