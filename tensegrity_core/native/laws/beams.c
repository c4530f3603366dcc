/* Beams in series without memory, eq. 11 and Algorithm 1 of the article, by their parameters Q, zeta, h at a given elongation.
 *
 * With x = u/h a beam bears f = Q (zeta x^3 - 3 zeta x^2 + 2 (1 + zeta) x) and stores U, its integral.  All stand at one force F: the
 * tension T, or while one of them snaps, which goes its own way with f = T, that one's maximum.  So F sets each displacement, with
 *     du/dp = - (df/dp)/f'  (at its stop 2h: du/dh = 2),
 * their sum is the elongation, and the string's energy is the sum of U: parts that stand still while another snaps do no work. */
#include "laws/beams.h"

#include <math.h>

/* A beam at a displacement. */
typedef struct {
    double x, f, slope;         /* 1, N, N/m */
    double by[3], stored_by[3]; /* of f and U by Q, zeta, h, u staying */
    int stopped;                /* at 2h, under a force that may be larger */
} beam;

static double force_at(const ts_beams *b, int j, double x)
{
    return b->Q[j] * x * (2.0 * (1.0 + b->zeta[j]) + b->zeta[j] * x * (x - 3.0));
}

static beam beam_at(const ts_beams *b, int j, double x)
{
    const double Q = b->Q[j], zeta = b->zeta[j], h = b->h[j], shape = x * (x * (x - 3.0) + 2.0);
    const double form = x * x * (1.0 + zeta + zeta * x * (0.25 * x - 1.0));
    beam found;
    found.x = x;
    found.f = force_at(b, j, x);
    found.slope = Q / h * (2.0 * (1.0 + zeta) + 3.0 * zeta * x * (x - 2.0));
    found.by[0] = found.f / Q;
    found.by[1] = Q * shape;
    found.by[2] = -found.slope * x;
    found.stored_by[0] = h * form;
    found.stored_by[1] = Q * h * x * x * (1.0 + x * (0.25 * x - 1.0));
    found.stored_by[2] = Q * form - found.f * x;
    found.stopped = 0;
    return found;
}

/* Where the force has its maximum, and by symmetry about 1 its minimum. */
static double summit(const ts_beams *b, int j) { return 1.0 - sqrt((b->zeta[j] - 2.0) / (3.0 * b->zeta[j])); }

static double largest(const ts_beams *b, int j) { return force_at(b, j, summit(b, j)); }

/* How many beams snap before this one. */
static int before(const ts_beams *b, int j)
{
    const double own = largest(b, j);
    int count = 0;
    for (int i = 0; i < b->n; i++) {
        const double other = largest(b, i);
        count += other < own || (other == own && i < j);
    }
    return count;
}

/* A beam that stands at a force, on the rise before its maximum or on that behind its minimum. */
static beam standing(const ts_beams *b, int j, double force)
{
    const int past = before(b, j) < b->snapped;
    double low = past ? 2.0 - summit(b, j) : 0.0, high = past ? 2.0 : summit(b, j);
    if (past && force >= 4.0 * b->Q[j]) {
        beam at_stop = beam_at(b, j, 2.0);
        at_stop.stopped = 1;
        return at_stop;
    }
    for (int n = 0; n < 200 && high - low > 1e-16 * high; n++) {
        const double middle = 0.5 * (low + high);
        if (force_at(b, j, middle) < force) low = middle;
        else high = middle;
    }
    return beam_at(b, j, 0.5 * (low + high));
}

/* du/dp at a force that stays; 0: Q, 1: zeta, 2: h. */
static double moved(const beam *at, int p)
{
    if (at->stopped) return p == 2 ? 2.0 : 0.0;
    return -at->by[p] / at->slope;
}

/* Where everything stands at an elongation, m. */
void ts_beams_prepare(ts_beams *b, double elongation)
{
    double others = 0.0;
    b->snapping = -1;
    b->force = b->tension;
    b->slope = b->compliance = 0.0;
    for (int j = 0; j < b->n && b->snapped > 0; j++)
        if (before(b, j) == b->snapped - 1 && b->tension < largest(b, j)) b->snapping = j, b->force = largest(b, j);
    for (int j = 0; j < b->n && b->beyond < 0.0; j++) {
        if (j == b->snapping) continue;
        const beam at = standing(b, j, b->force);
        b->compliance += at.stopped ? 0.0 : 1.0 / at.slope;
        others += at.x * b->h[j];
    }
    b->displaced = elongation - others;
    if (b->snapping >= 0) b->slope = beam_at(b, b->snapping, b->displaced / b->h[b->snapping]).slope;
}

/* Bottomed out: the strongest beam's 4 Q and the string's own stiffness beyond. */
static void bottomed(const ts_beams *b, int j, double force[3], double energy[3])
{
    int strongest = 1;
    for (int i = 0; i < b->n; i++) strongest = strongest && (b->Q[i] < b->Q[j] || i >= j) && b->Q[i] <= b->Q[j];
    force[0] = strongest ? 4.0 : 0.0;
    force[1] = 0.0;
    force[2] = -2.0 * b->stiffness;
    energy[0] = 4.0 * b->h[j] + (strongest ? 4.0 * b->beyond : 0.0);
    energy[1] = 0.0;
    energy[2] = 4.0 * b->Q[j] - 2.0 * b->tension;
}

/* Derivatives of the tension and of the stored energy by one beam's Q, zeta, h. */
void ts_beams_differentiate(const ts_beams *b, int j, double force[3], double energy[3])
{
    if (b->beyond >= 0.0) {
        bottomed(b, j, force, energy);
        return;
    }
    if (j == b->snapping) {
        const beam at = beam_at(b, j, b->displaced / b->h[j]), top = beam_at(b, j, summit(b, j));
        for (int p = 0; p < 3; p++) {
            const double raised = p == 2 ? 0.0 : top.by[p]; /* of the maximum */
            force[p] = at.by[p] - b->slope * b->compliance * raised;
            energy[p] = at.stored_by[p] + (b->force - b->tension) * b->compliance * raised;
        }
        return;
    }
    const beam at = standing(b, j, b->force);
    for (int p = 0; p < 3; p++) {
        force[p] = -moved(&at, p) * (b->snapping >= 0 ? b->slope : 1.0 / b->compliance);
        energy[p] = at.stored_by[p] + (at.f - b->tension) * moved(&at, p);
    }
}
