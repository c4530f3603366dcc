/* Equations of motion, bar by bar, and their analytic Jacobian.
 *
 * Bars of class-1 structures meet only through strings, so with the generalised force Q of a block
 *     centre of a free bar:   r'' = Q/m
 *     vector of a free bar:   b'' = (12/m) P Q - (|b'|^2/|b|^2) b,   Q = (f2 - f1)/2
 *     pinned bar:             c'' = (3/m) P Q - (|c'|^2/|c|^2) c,    Q = f_tip
 * with P = I - b b'/|b|^2; gravity acts as m g/2 at each end.  |b|^2 rather than the nominal l^2 keeps the drift of the bar
 * lengths linear; ts_project() takes it out after every step.
 *
 * The state is y = [q, q', dissipated, input work, throughput].  Functions with a parameter D are compiled for D = 2 and
 * D = 3, so that a planar scene is computed in the plane. */
#include "internal.h"

#include <math.h>
#include <string.h>

#if defined(__GNUC__)
#define ALWAYS_INLINE static inline __attribute__((always_inline))
#else
#define ALWAYS_INLINE static inline
#endif

/* Call body(sim, ..., D) with D known to the compiler. */
#define DISPATCH(sim, body, ...)                          \
    do {                                                  \
        if ((sim)->m.count[TS_D] == 2) body(__VA_ARGS__, 2); \
        else body(__VA_ARGS__, 3);                        \
    } while (0)

/* External and gravity forces on the blocks and their inverse inertias: constant over a step. */
void ts_prepare(ts_sim *sim)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D];
    const double *force = sim->values + m->at[TS_FORCE], *mass = sim->values + m->at[TS_BAR_MASS];
    double g = sim->values[m->at[TS_GRAVITY]];
    memset(sim->Qf, 0, sizeof(double) * (size_t)m->nq);
    for (int n = 0; n < m->count[TS_N]; n++) {
        int f = m->free_index[n];
        if (f < 0) continue;
        for (int d = 0; d < D; d++) {
            if (m->node_centre[n] >= 0) sim->Qf[m->node_centre[n] * D + d] += force[f * D + d];
            sim->Qf[m->node_block[n] * D + d] += m->node_coef[n] * force[f * D + d];
        }
    }
    memcpy(sim->Qg, sim->Qf, sizeof(double) * (size_t)m->nq);
    for (int i = 0; i < m->count[TS_B]; i++) {
        int pinned = m->bar_centre[i] < 0, heavy = pinned ? m->bar_block[i] : m->bar_centre[i];
        if (m->z_axis >= 0) sim->Qg[heavy * D + m->z_axis] -= mass[i] * g * (pinned ? 0.5 : 1.0);
        if (!pinned) sim->inv[m->bar_centre[i]] = 1.0 / mass[i];
        sim->inv[m->bar_block[i]] = (pinned ? 3.0 : 12.0) / mass[i];
    }
}

/* String vector and its rate from the blocks. */
ALWAYS_INLINE void string_vector(const ts_model *m, const double *q, const double *v, int i, double *s, double *sd, const int D)
{
    const ts_term *t = m->term + 4 * i;
    for (int d = 0; d < D; d++) s[d] = m->s0[i * D + d], sd[d] = 0.0;
    for (int k = 0; k < m->term_count[i]; k++)
        for (int d = 0; d < D; d++) {
            s[d] += t[k].kappa * q[t[k].offset + d];
            sd[d] += t[k].kappa * v[t[k].offset + d];
        }
}

ALWAYS_INLINE double dot(const double *a, const double *b, const int D)
{
    double sum = a[0] * b[0] + a[1] * b[1];
    return D == 3 ? sum + a[2] * b[2] : sum;
}

ALWAYS_INLINE double elastic(const ts_sim *sim, int i, double gap, double *slope)
{
    const ts_curve *c = sim->curve + i;
    double k = sim->values[sim->m.at[TS_STIFFNESS] + i];
    if (sim->piece[i] == 0) return *slope = 0.0;
    if (c->pieces == 0) {
        *slope = k;
        return k * gap;
    }
    return ts_curve_force(c, sim->piece[i], gap, k, slope);
}

/* Total tension of a string on its present piece, its elastic part, and what the total would be without clipping (N). */
ALWAYS_INLINE double tension(const ts_sim *sim, int i, double gap, double rate, double *fs, double *raw)
{
    double slope;
    *fs = elastic(sim, i, gap, &slope);
    *raw = sim->piece[i] == 0 ? 0.0 : *fs + sim->values[sim->m.at[TS_DAMPING] + i] * rate;
    return sim->clipped[i] ? 0.0 : *raw;
}

double ts_tension(const ts_sim *sim, int i, double gap, double rate, double *fs)
{
    double raw;
    return tension(sim, i, gap, rate, fs, &raw);
}

ALWAYS_INLINE void strings(ts_sim *sim, double tau, const double *q, const double *v, double *Q, double *power, const int D)
{
    const ts_model *m = &sim->m;
    const double *rest = sim->values + m->at[TS_REST_LENGTH], *rest_rate = sim->values + m->at[TS_REST_LENGTH_RATE];
    double dissipated = 0.0, work = 0.0, through = 0.0;
    for (int i = 0; i < m->count[TS_S]; i++) {
        double s[3], sd[3];
        string_vector(m, q, v, i, s, sd, D);
        double xi = sqrt(dot(s, s, D)), over = xi > 0.0 ? 1.0 / xi : 0.0;
        double gap = xi - (rest[i] + rest_rate[i] * tau), rate = dot(s, sd, D) * over - rest_rate[i];
        sim->gap[i] = gap;
        sim->gap_rate[i] = rate;
        if (gap < sim->lo[i] || gap > sim->hi[i]) sim->outside[i] = 1;
        if (sim->piece[i] == 0) continue;
        double fs, raw, T = tension(sim, i, gap, rate, &fs, &raw), density = T * over;
        if (m->damping_law == TS_TENSION_ONLY && (raw < 0.0) != (sim->clipped[i] != 0)) sim->outside[i] = 1;
        const ts_term *t = m->term + 4 * i;
        for (int k = 0; k < m->term_count[i]; k++)
            for (int d = 0; d < D; d++) Q[t[k].offset + d] -= t[k].kappa * density * s[d];
        if (sim->clipped[i]) continue; /* its energy is accounted for in integrate.c */
        double lost = (T - fs) * rate, done = -T * rest_rate[i];
        dissipated += lost;
        work += done;
        through += fabs(lost) + fabs(done);
    }
    power[0] = dissipated;
    power[1] = work;
    power[2] = through;
}

ALWAYS_INLINE void external_power(const ts_sim *sim, const double *v, double *power, const int D)
{
    for (int b = 0; b < sim->m.blocks; b++) {
        double p = dot(sim->Qf + b * D, v + b * D, D);
        power[1] += p;
        power[2] += fabs(p);
    }
}

ALWAYS_INLINE void rhs(ts_sim *sim, double tau, const double *y, double *dy, const int D)
{
    const ts_model *m = &sim->m;
    int nq = m->nq;
    const double *q = y, *v = y + nq;
    double *a = dy + nq;
    memcpy(dy, v, sizeof(double) * (size_t)nq);
    memcpy(a, sim->Qg, sizeof(double) * (size_t)nq);
    strings(sim, tau, q, v, a, dy + 2 * nq, D);
    external_power(sim, v, dy + 2 * nq, D);
    for (int b = 0; b < m->blocks; b++) {
        const double *c = q + b * D, *cd = v + b * D;
        double *Q = a + b * D, w = sim->inv[b];
        if (!m->block_turns[b]) {
            for (int d = 0; d < D; d++) Q[d] *= w;
            continue;
        }
        double along = (w * dot(c, Q, D) + dot(cd, cd, D)) / dot(c, c, D);
        for (int d = 0; d < D; d++) Q[d] = w * Q[d] - along * c[d];
    }
}

void ts_rhs(ts_sim *sim, double tau, const double *y, double *dy)
{
    sim->memory.stats[TS_RHS]++;
    DISPATCH(sim, rhs, sim, tau, y, dy);
}

ALWAYS_INLINE void power(ts_sim *sim, double tau, const double *y, double *p, const int D)
{
    strings(sim, tau, y, y + sim->m.nq, sim->ytmp, p, D);
    external_power(sim, y + sim->m.nq, p, D);
}

/* Rates of the ledger's integrals at a state (W). */
void ts_power(ts_sim *sim, double tau, const double *y, double p[TS_LEDGER]) { DISPATCH(sim, power, sim, tau, y, p); }

ALWAYS_INLINE void string_state(const ts_sim *sim, double tau, const double *y, int i, double *gap, double *rate, const int D)
{
    const ts_model *m = &sim->m;
    double s[3], sd[3], xd = sim->values[m->at[TS_REST_LENGTH_RATE] + i];
    string_vector(m, y, y + m->nq, i, s, sd, D);
    double xi = sqrt(dot(s, s, D));
    *gap = xi - (sim->values[m->at[TS_REST_LENGTH] + i] + xd * tau);
    *rate = (xi > 0.0 ? dot(s, sd, D) / xi : 0.0) - xd;
}

/* Elongation of one string and its rate. */
void ts_string_state(const ts_sim *sim, double tau, const double *y, int i, double *gap, double *rate)
{
    DISPATCH(sim, string_state, sim, tau, y, i, gap, rate);
}

/* Derivatives of the string force T s/xi by s (Kq) and by s' (Kv), and its explicit time derivative (ft). */
ALWAYS_INLINE void string_stiffness(const ts_sim *sim, double tau, const double *q, const double *v, int i, double *Kq, double *Kv,
                                    double *ft, const int D)
{
    const ts_model *m = &sim->m;
    double s[3], sd[3], slope, xd = sim->values[m->at[TS_REST_LENGTH_RATE] + i];
    string_vector(m, q, v, i, s, sd, D);
    double xi = sqrt(dot(s, s, D)), over = xi > 0.0 ? 1.0 / xi : 0.0, rate = dot(s, sd, D) * over;
    double gap = xi - (sim->values[m->at[TS_REST_LENGTH] + i] + xd * tau);
    double fs = elastic(sim, i, gap, &slope), d_ = sim->values[m->at[TS_DAMPING] + i];
    double density = (fs + d_ * (rate - xd)) * over;
    double u[3];
    for (int d = 0; d < D; d++) u[d] = s[d] * over;
    for (int r = 0; r < D; r++) {
        for (int c = 0; c < D; c++) {
            double by_s = slope * u[c] + d_ * over * (sd[c] - rate * u[c]);
            Kq[r * D + c] = density * ((r == c) - u[r] * u[c]) + u[r] * by_s;
            Kv[r * D + c] = d_ * u[r] * u[c];
        }
        ft[r] = -slope * xd * u[r];
    }
}

ALWAYS_INLINE void string_jacobians(ts_sim *sim, double tau, const double *q, const double *v, const int D)
{
    const ts_model *m = &sim->m;
    int nq = m->nq;
    for (int i = 0; i < m->count[TS_S]; i++) {
        if (sim->piece[i] == 0 || sim->clipped[i]) continue;
        double Kq[9], Kv[9], ft[3];
        string_stiffness(sim, tau, q, v, i, Kq, Kv, ft, D);
        const ts_term *t = m->term + 4 * i;
        for (int a = 0; a < m->term_count[i]; a++) {
            double wa = -t[a].kappa * sim->inv[t[a].block];
            for (int d = 0; d < D; d++) sim->ft[t[a].offset + d] += wa * ft[d];
            for (int b = 0; b < m->term_count[i]; b++) {
                double w = wa * t[b].kappa;
                for (int r = 0; r < D; r++)
                    for (int c = 0; c < D; c++) {
                        int at = (t[a].offset + r) * nq + t[b].offset + c;
                        sim->Jq[at] += w * Kq[r * D + c];
                        sim->Jv[at] += w * Kv[r * D + c];
                    }
            }
        }
    }
}

/* Rows of a bar vector: P from the left, then the derivatives of P and of the centripetal term. */
ALWAYS_INLINE void turn_rows(ts_sim *sim, const double *c, const double *cd, const double *Q, int b, const int D)
{
    int nq = sim->m.nq, row = b * D;
    double over = 1.0 / dot(c, c, D), w = sim->inv[b], cQ = w * dot(c, Q, D), speed = dot(cd, cd, D);
    double *matrices[2] = {sim->Jq, sim->Jv};
    for (int k = 0; k < 2; k++)
        for (int col = 0; col < nq; col++) {
            double *A = matrices[k] + row * nq + col, along = 0.0;
            for (int d = 0; d < D; d++) along += c[d] * A[d * nq];
            if (along != 0.0)
                for (int d = 0; d < D; d++) A[d * nq] -= along * over * c[d];
        }
    double along = dot(c, sim->ft + row, D) * over;
    for (int d = 0; d < D; d++) sim->ft[row + d] -= along * c[d];
    for (int r = 0; r < D; r++)
        for (int k = 0; k < D; k++) {
            int at = (row + r) * nq + row + k;
            sim->Jq[at] += over * (2.0 * (cQ + speed) * over * c[r] * c[k] - w * c[r] * Q[k] - (r == k) * (cQ + speed));
            sim->Jv[at] -= 2.0 * over * c[r] * cd[k];
        }
}

ALWAYS_INLINE void jacobian(ts_sim *sim, double tau, const double *y, const int D)
{
    const ts_model *m = &sim->m;
    size_t nq = (size_t)m->nq;
    const double *q = y, *v = y + nq;
    double *Q = sim->lin, p[TS_LEDGER];
    memset(sim->Jq, 0, sizeof(double) * nq * nq);
    memset(sim->Jv, 0, sizeof(double) * nq * nq);
    memset(sim->ft, 0, sizeof(double) * nq);
    memcpy(Q, sim->Qg, sizeof(double) * nq);
    strings(sim, tau, q, v, Q, p, D);
    string_jacobians(sim, tau, q, v, D);
    for (int b = 0; b < m->blocks; b++)
        if (m->block_turns[b]) turn_rows(sim, q + b * D, v + b * D, Q + b * D, b, D);
}

/* Jq = da/dq, Jv = da/dq', ft = da/dt of the accelerations a. */
void ts_rhs_jacobian(ts_sim *sim, double tau, const double *y)
{
    sim->memory.stats[TS_JACOBIANS]++;
    DISPATCH(sim, jacobian, sim, tau, y);
}

/* Put a bar vector back on its length: b along itself, b' normal to b. */
void ts_project_block(const ts_sim *sim, double *y, int block)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D];
    if (!m->block_turns[block]) return;
    double *c = y + block * D, *cd = y + m->nq + block * D, cc = 0.0, ccd = 0.0;
    for (int d = 0; d < D; d++) {
        cc += c[d] * c[d];
        ccd += c[d] * cd[d];
    }
    double factor = m->bar_length[m->block_bar[block]] / sqrt(cc);
    for (int d = 0; d < D; d++) {
        cd[d] -= ccd / cc * c[d];
        c[d] *= factor;
    }
}

void ts_project(const ts_sim *sim, double *y)
{
    for (int b = 0; b < sim->m.blocks; b++) ts_project_block(sim, y, b);
}

/* Largest error of a block's position or velocity vector, in units of tolerance * (1 + |vector|).  Norms of vectors, so
 * that a rotated scene takes the same steps. */
double ts_error_norm(const ts_sim *sim, const double *e, const double *y0, const double *y1)
{
    const ts_model *m = &sim->m;
    int D = m->count[TS_D];
    double worst = 0.0;
    for (int b = 0; b < 2 * m->blocks; b++) {
        double ee = 0.0, n0 = 0.0, n1 = 0.0;
        for (int d = b * D; d < (b + 1) * D; d++) {
            ee += e[d] * e[d];
            n0 += y0[d] * y0[d];
            n1 += y1[d] * y1[d];
        }
        double scale = 1.0 + sqrt(n0 > n1 ? n0 : n1), ratio = ee / (scale * scale);
        if (!(ratio <= worst)) worst = ratio;
        if (ratio != ratio) return NAN;
    }
    return sqrt(worst) / sim->values[m->at[TS_TOLERANCE]];
}
