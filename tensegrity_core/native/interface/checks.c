/* Are inputs, parameters and outputs acceptable? */
#include "interface/checks.h"
#include "interface/message.h"
#include "model/data.h"
#include "model/groups.h"
#include "motion/motion.h"
#include "tensegrity.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

static const struct {
    double low, high;
} bounds[] = {
#define ROW(name, role, first, second, low, high) {low, high},
    TS_FIELDS(ROW)
#undef ROW
};

/* Is this value of a field acceptable? */
static int accept(ts_sim *sim, int field, int32_t index)
{
    double x = sim->io.values[index], low = bounds[field].low, high = bounds[field].high;
    char between[64];
    if (isfinite(x) && x >= low && x <= high) return TS_OK;
    if (!isfinite(x)) return ts_refuse(sim, index, "is not a finite number");
    snprintf(between, sizeof between, "must lie between %g and %g", low, high);
    return ts_refuse(sim, index, high < DBL_MAX ? between : low > 0.0 ? "must be positive" : "must not be negative");
}

/* Only a law with memory knows beams that are not metastable.  The first that is not where it must be, or -1. */
static int wrong_beam(const ts_sim *sim)
{
    const ts_model *m = &sim->m;
    const double *zeta = sim->io.values + m->at[TS_NSH_ZETA];
    for (int i = 0; i < m->count[TS_S]; i++)
        for (int j = m->string.beam_first[i]; j < m->string.beam_first[i] + m->packed.beams[i] && !m->packed.beam_law[i]; j++)
            if (!(zeta[j] > 2.0 && zeta[j] < 8.0)) return m->at[TS_NSH_ZETA] + j;
    return -1;
}

/* Mass of a node beside its bar's (kg). */
static double mass_at(const ts_sim *sim, int node)
{
    const ts_model *m = &sim->m;
    const ts_packed *p = &m->packed;
    const double *point = sim->io.values + m->at[TS_POINT_MASS], *string = sim->io.values + m->at[TS_STRING_MASS];
    double sum = 0.0;
    for (int i = 0; i < p->shares; i++)
        if (p->sharing[2 * i + 1] == node) sum += p->share[i] * string[p->sharing[2 * i]];
    for (int i = 0; i < m->count[TS_P]; i++)
        if (p->massed[i] == node) sum += point[i];
    return sum;
}

/* A node on no bar has no other mass than this.  The first parameter that leaves such a node without, or -1. */
static int wrong_mass(const ts_sim *sim)
{
    const ts_model *m = &sim->m;
    for (int i = 0; m->node.lone_count && i < m->count[TS_P] + m->packed.shares; i++) {
        const int share = i - m->count[TS_P], node = share < 0 ? m->packed.massed[i] : m->packed.sharing[2 * share + 1];
        const int from = share < 0 ? m->at[TS_POINT_MASS] + i : m->at[TS_STRING_MASS] + m->packed.sharing[2 * share];
        if (m->node.block[node] < 0 || m->block.bar[m->node.block[node]] >= 0 || m->joint.bears[node]) continue;
        if (!(sim->io.values[from] > 0.0) && !(mass_at(sim, node) > 0.0)) return from;
    }
    return -1;
}

/* Are all numbers of a field finite and within its bounds?  Mostly they are, and no message has to be made. */
static int all_within(const double *x, int n, double low, double high)
{
    int within = 1;
    for (int i = 0; i < n; i++) within &= (x[i] - x[i] == 0.0) & (x[i] >= low) & (x[i] <= high);
    return within;
}

/* Is it the mass of a joined bar that never had any? */
static int is_massless(const ts_sim *sim, int i)
{
    const ts_model *m = &sim->m;
    const int bar = i - m->at[TS_BAR_MASS];
    if (bar < 0 || bar >= m->count[TS_B] || !ts_is_joined(m, bar)) return 0;
    return sim->io.values[i] == 0.0 && m->packed.start[i] == 0.0;
}

/* Look through the fields before this one. */
static int check_fields(ts_sim *sim, int end, int32_t *index)
{
    const ts_model *m = &sim->m;
    for (int f = 0; f < end; f++) {
        int i = m->at[f];
        if (all_within(sim->io.values + i, m->at[f + 1] - i, bounds[f].low, bounds[f].high)) continue;
        while (i < m->at[f + 1] && (accept(sim, f, i) == TS_OK || is_massless(sim, i))) i++;
        if (i == m->at[f + 1]) continue;
        *index = i;
        accept(sim, f, i);
        return TS_BAD_INPUT;
    }
    return TS_OK;
}

int ts_check(ts_sim *sim, int32_t *index)
{
    const ts_model *m = &sim->m;
    int method = sim->io.integers[m->int_at[TS_INT_METHOD]], status = check_fields(sim, TS_POSITION, index);
    if (status != TS_OK) return status;
    if ((*index = wrong_beam(sim)) >= 0) return ts_refuse(sim, *index, "must lie between 2 and 8 (a metastable beam)");
    if ((*index = wrong_mass(sim)) >= 0)
        return ts_refuse(sim, *index, "must be positive: the node is on no bar and has no other mass");
    *index = m->n_real + m->int_at[TS_INT_METHOD];
    return method < 0 || method >= TS_METHOD_COUNT ? ts_refuse(sim, *index, "is not a method") : TS_OK;
}

/* Smallest rest length of a string within the step, m: at an end, or where its rate, a quadratic, is zero. */
static double shortest_rest_length(const ts_rest *rest, int i, double h)
{
    double r = rest->rate[i], b = rest->bend[i], j = rest->jerk[i];
    double least = fmin(rest->length[i], ts_rest_length(rest, i, h));
    if (b == 0.0 && j == 0.0) return least;
    double root = b * b - 2.0 * j * r, q = -(b + (b < 0.0 ? -1.0 : 1.0) * sqrt(root)); /* no number where there is no root */
    double turn[2] = {q / j, 2.0 * r / q};
    for (int k = 0; k < 2; k++)
        if (turn[k] > 0.0 && turn[k] < h) least = fmin(least, ts_rest_length(rest, i, turn[k]));
    return least;
}

/* Are inputs or parameters those of the last step, bit by bit?  It found them acceptable. */
static int kept(const ts_sim *sim, int first, int end)
{
    return !memcmp(sim->io.values + first, sim->io.applied + first, sizeof(double) * (size_t)(end - first));
}

/* The first fixed parameter that is no longer what it was at the start, or -1. */
static int32_t changed_parameter(const ts_sim *sim)
{
    const ts_model *m = &sim->m;
    int method = m->int_at[TS_INT_METHOD], looked = kept(sim, m->at[TS_BAR_MASS], m->n_applied);
    for (int i = m->at[TS_BAR_MASS]; !looked && i < m->n_applied; i++)
        if (sim->io.values[i] != sim->io.applied[i]) return i;
    return sim->io.integers[method] == sim->memory.method ? -1 : m->n_real + method;
}

/* Inputs and parameters that differ from those of the last step: are they acceptable? */
int ts_check_change(ts_sim *sim, double h)
{
    const ts_model *m = &sim->m;
    int32_t index;
    const int tuned = !kept(sim, m->at[TS_STIFFNESS], m->at[TS_BAR_MASS]);
    int status = check_fields(sim, tuned ? TS_BAR_MASS : TS_STIFFNESS, &index); /* those behind must not change */
    if (status != TS_OK) return status;
    for (int i = 0; !ts_all_finite(sim->io.slopes, 2 * m->n_inputs); i++)
        if (!isfinite(sim->io.slopes[i]))
            return ts_refuse(sim, i % m->n_inputs, "has a derivative that is not a finite number");
    index = changed_parameter(sim);
    if (index >= 0) return ts_refuse(sim, index, "is fixed, and was changed after initialization");
    for (int i = 0; m->string.curved_count && i < m->count[TS_S]; i++)
        if (sim->laws.curve[i].branches && sim->io.values[m->at[TS_STIFFNESS] + i] != sim->io.applied[m->at[TS_STIFFNESS] + i])
            return ts_refuse(
                sim, m->at[TS_STIFFNESS] + i,
                "was changed after initialization, which a string with memory (the hysteretic law) does not allow");
    for (int i = 0; i < m->count[TS_S]; i++)
        if (sim->rest.moves && shortest_rest_length(&sim->rest, i, h) < -4.0 * DBL_EPSILON * sim->rest.length[i])
            return ts_refuse(sim, m->at[TS_REST_LENGTH] + i, "would become negative within the step; let it shorten less");
    return TS_OK;
}

/* Velocities may be finite whose energy is not. */
int ts_check_outputs(ts_sim *sim, int groups, const char *when)
{
    const ts_model *m = &sim->m;
    const double *values = sim->io.values;
    const int forces = m->at[TS_STRING_FORCE], energies = m->at[TS_KINETIC], work = m->at[TS_DISSIPATED];
    if (groups == TS_OF_ALL) {
        if (ts_all_finite(values + m->n_applied, m->n_real - m->n_applied)) return TS_OK;
    } else if ((!(groups & TS_OF_MOTION) || ts_all_finite(values + m->n_applied, forces - m->n_applied)) &&
               (!(groups & TS_OF_FORCES) || ts_all_finite(values + forces, energies - forces)) &&
               (!(groups & TS_OF_ENERGIES) || ts_all_finite(values + energies, work - energies)) &&
               (!(groups & TS_OF_WORK) || ts_all_finite(values + work, m->n_real - work))) {
        return TS_OK;
    }
    snprintf(sim->told.message, sizeof sim->told.message,
             "a force, a velocity or an energy %s is not a finite number; lower the loads", when);
    return TS_NOT_FINITE;
}

int ts_check_rates(ts_sim *sim, const double *out)
{
    if (ts_all_finite(out, sim->m.n_real - sim->m.n_applied)) return TS_OK;
    return ts_say(sim, TS_NOT_FINITE, "a derivative of an output is not a finite number");
}
