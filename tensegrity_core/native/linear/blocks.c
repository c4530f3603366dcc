/* Block-sparse LU on a pattern that is analysed once.  No rows are exchanged but those inside a diagonal block.
 *
 * Numbers: row by row.  A row of blocks stands scattered in the work space while multiples of earlier ones are subtracted.
 * What is left on its diagonal is factorised as P S = G E H with G and H unit triangular and E diagonal, and the rest of the
 * row divided by P, G and E, so that only H remains to be applied in a solution.  That is elimination number by number
 * written in blocks.  Multiplying by inverted diagonal blocks would be quicker still, but its errors grow with the condition
 * of those blocks on top of that of W, and a stiff string makes it large (J. W. Demmel, N. J. Higham and R. S. Schreiber,
 * Stability of block LU factorization, Numer. Linear Algebra Appl. 2 (1995) 173, doi:10.1002/nla.1680020208).
 *
 * All indices are the caller's row numbers, so that right-hand sides need no permutation. */
#include "linear/blocks.h"
#include "linear/pairs.h"

#include <math.h>
#include <stdint.h>

/* Largest growth times loss, see quality: rounding of 1e-16 then leaves about three digits. */
#define WORST 1e13

/* D numbers in a row are a pair and, for D = 3, a single one.  They are loaded in the parts in which they were stored: only
 * then processors hand them on without waiting for the memory.  D is a constant once the functions below are inlined.
 * Arrays of the pattern are taken into local variables because the compiler must assume that a store changes the pattern. */

typedef struct {
    pair p;
    double t;
} triple;

ALWAYS_INLINE triple load(const double *x, const int D)
{
    triple v = {pair_load(x), D == 3 ? x[2] : 0.0};
    return v;
}

ALWAYS_INLINE void store(double *x, triple v, const int D)
{
    pair_store(x, v.p);
    if (D == 3) x[2] = v.t;
}

/* First number of block i of an array of blocks, or of block row i of a vector. */
#define BLOCK(array, i) ((array) + (size_t)(i) * (size_t)(D * D))
#define PART(vector, i) ((vector) + (size_t)(i) * (size_t)D)

/* C -= A B, where a holds the numbers of A twice each.  Pairs first and single numbers last: that takes fewer registers. */
ALWAYS_INLINE void subtract_product(const pair *a, const double *B, double *C, const int D)
{
    pair b0 = pair_load(B), b1 = pair_load(B + D), b2 = D == 3 ? pair_load(B + 6) : b0;
    for (int i = 0; i < D; i++) {
        pair sum = pair_add_product(pair_multiply(a[i * D], b0), a[i * D + 1], b1);
        if (D == 3) sum = pair_add_product(sum, a[i * D + 2], b2);
        pair_store(C + i * D, pair_subtract(pair_load(C + i * D), sum));
    }
    if (D == 2) return;
    double t0 = B[2], t1 = B[5], t2 = B[8];
    for (int i = 0; i < D; i++)
        C[i * D + 2] -= pair_first(a[i * D]) * t0 + pair_first(a[i * D + 1]) * t1 + pair_first(a[i * D + 2]) * t2;
}

/* Sum of the magnitudes of a block's numbers. */
ALWAYS_INLINE double magnitude(const double *A, const int D)
{
    if (D == 2) return (fabs(A[0]) + fabs(A[2])) + (fabs(A[1]) + fabs(A[3]));
    return (fabs(A[0]) + fabs(A[3]) + fabs(A[6])) + (fabs(A[1]) + fabs(A[4]) + fabs(A[7])) +
           (fabs(A[2]) + fabs(A[5]) + fabs(A[8]));
}

/* A diagonal block S is kept as P S = G E H in one block F: the numbers of G below the diagonal, E^-1 on it, those of H
 * above.  P is the sum of 1 where rows 0 and 1 are exchanged, 2 where 0 and 2 are, and 4 where then 1 and 2 are. */

#define SWAP(type, a, b) \
    do {                 \
        type swap = a;   \
        a = b;           \
        b = swap;        \
    } while (0)

#define EXCHANGE(type, r0, r1, r2, P)      \
    do {                                   \
        int which = (int)(P);              \
        if (which & 1) SWAP(type, r0, r1); \
        if (which & 2) SWAP(type, r0, r2); \
        if (which & 4) SWAP(type, r1, r2); \
    } while (0)

/* F and P of S; E^-1 is not finite where S is singular. */
ALWAYS_INLINE double factorise2(const double *S, double *F)
{
    double s00 = S[0], s01 = S[1], s10 = S[2], s11 = S[3], P = 0.0;
    if (fabs(s10) > fabs(s00)) {
        P = 1.0;
        SWAP(double, s00, s10);
        SWAP(double, s01, s11);
    }
    double e0 = 1.0 / s00, g10 = s10 * e0, h01 = s01 * e0, e1 = 1.0 / (s11 - g10 * s01);
    pair_store(F, pair_of(e0, h01));
    pair_store(F + 2, pair_of(g10, e1));
    return P;
}

ALWAYS_INLINE double factorise3(const double *S, double *F)
{
    double s00 = S[0], s01 = S[1], s02 = S[2], s10 = S[3], s11 = S[4], s12 = S[5], s20 = S[6], s21 = S[7], s22 = S[8];
    double P = 0.0;
    if (fabs(s10) > fabs(s00) && fabs(s10) >= fabs(s20)) {
        P = 1.0;
        SWAP(double, s00, s10);
        SWAP(double, s01, s11);
        SWAP(double, s02, s12);
    } else if (fabs(s20) > fabs(s00)) {
        P = 2.0;
        SWAP(double, s00, s20);
        SWAP(double, s01, s21);
        SWAP(double, s02, s22);
    }
    double e0 = 1.0 / s00, g10 = s10 * e0, g20 = s20 * e0, h01 = s01 * e0, h02 = s02 * e0;
    s11 -= g10 * s01, s12 -= g10 * s02, s21 -= g20 * s01, s22 -= g20 * s02;
    if (fabs(s21) > fabs(s11)) {
        P += 4.0;
        SWAP(double, s11, s21);
        SWAP(double, s12, s22);
        SWAP(double, g10, g20);
    }
    double e1 = 1.0 / s11, g21 = s21 * e1, h12 = s12 * e1, e2 = 1.0 / (s22 - g21 * s12);
    pair_store(F, pair_of(e0, h01));
    pair_store(F + 3, pair_of(g10, e1));
    pair_store(F + 6, pair_of(g20, g21));
    F[2] = h02, F[5] = h12, F[8] = e2;
    return P;
}

ALWAYS_INLINE double inverse_magnitude(const double *F, const int D)
{
    return D == 2 ? fabs(F[0]) + fabs(F[3]) : fabs(F[0]) + fabs(F[4]) + fabs(F[8]);
}

/* L = A H^-1, and its numbers twice each for subtract_product(). */
ALWAYS_INLINE void divide_right(const double *A, const double *F, double *L, pair *twice, const int D)
{
    for (int i = 0; i < D; i++) {
        double l0 = A[i * D], l1 = A[i * D + 1] - l0 * F[1];
        pair_store(L + i * D, pair_of(l0, l1));
        twice[i * D] = pair_both(l0);
        twice[i * D + 1] = pair_both(l1);
        if (D == 2) continue;
        double l2 = A[i * D + 2] - l0 * F[2] - l1 * F[5];
        L[i * D + 2] = l2;
        twice[i * D + 2] = pair_both(l2);
    }
}

ALWAYS_INLINE triple scaled(double f, triple v)
{
    v.p = pair_multiply(v.p, pair_both(f));
    v.t *= f;
    return v;
}

ALWAYS_INLINE triple minus_scaled(triple v, double f, triple w)
{
    v.p = pair_subtract_product(v.p, pair_both(f), w.p);
    v.t -= f * w.t;
    return v;
}

/* B = E^-1 G^-1 P A; B may be A. */
ALWAYS_INLINE void divide_left(const double *A, const double *F, double P, double *B, const int D)
{
    triple r0 = load(A, D), r1 = load(A + D, D), r2 = D == 3 ? load(A + 6, D) : r1;
    if (P != 0.0) EXCHANGE(triple, r0, r1, r2, P);
    r1 = minus_scaled(r1, F[D], r0);
    store(B, scaled(F[0], r0), D);
    store(B + D, scaled(F[D + 1], r1), D);
    if (D == 2) return;
    r2 = minus_scaled(minus_scaled(r2, F[6], r0), F[7], r1);
    store(B + 6, scaled(F[8], r2), D);
}

/* E^-1 G^-1 P v */
ALWAYS_INLINE triple solve_lower(const double *F, double P, triple v, const int D)
{
    double v0 = pair_first(v.p), v1 = pair_second(v.p), v2 = v.t;
    if (P != 0.0) EXCHANGE(double, v0, v1, v2, P);
    v1 -= F[D] * v0;
    v.p = pair_multiply(pair_of(v0, v1), pair_of(F[0], F[D + 1]));
    if (D == 3) v.t = (v2 - F[6] * v0 - F[7] * v1) * F[8];
    return v;
}

/* H^-1 v */
ALWAYS_INLINE triple solve_upper(const double *F, triple v, const int D)
{
    double v0 = pair_first(v.p), v1 = pair_second(v.p);
    if (D == 3) {
        v0 -= F[2] * v.t;
        v1 -= F[5] * v.t;
    }
    v.p = pair_of(v0 - F[1] * v1, v1);
    return v;
}

/* W = a^2 I - a Jv - Jq where Jv is given, else W = Jq: row i, scattered into the work space. */
ALWAYS_INLINE void scatter(const ts_pattern *p, int32_t i, double a, const double *Jq, const double *Jv, double *work,
                           const int given, const int D)
{
    const int32_t *const column = p->column;
    const pair minus_a = pair_both(-a);
    for (int32_t m = p->row[i], last = p->row[i + 1]; m < last; m++) {
        double *W = BLOCK(work, column[m]);
        for (int d = 0; d < D; d++) {
            triple w = load(BLOCK(Jq, m) + d * D, D);
            if (!given) {
                triple v = load(BLOCK(Jv, m) + d * D, D);
                w.p = pair_subtract(pair_multiply(minus_a, v.p), w.p);
                w.t = -a * v.t - w.t;
            }
            store(W + d * D, w, D);
        }
    }
    if (given) return;
    double *own = BLOCK(work, i);
    pair_store(own, pair_add(pair_load(own), pair_of(a * a, 0.0)));
    pair_store(own + D, pair_add(pair_load(own + D), pair_of(0.0, a * a)));
    if (D == 3) own[8] += a * a;
}

/* Rounding is 1e-16 of the largest numbers that stand in a place meanwhile.  That is harmful by how much they exceed what the
 * matrix has there (growth), and by how little of them remains for the next pivots (loss).  In a positive definite system
 * nothing grows, and the loss is at most its condition.  Only diagonal blocks are looked at: what grows elsewhere grows there
 * as well when all couplings go both ways. */
typedef struct {
    double growth, loss;
} quality;

/* 0 also where a number is not finite, as comparisons are false then. */
ALWAYS_INLINE int accept_pivot(quality *q, double initial, double largest, double inverse)
{
    double loss = largest * inverse;
    if (!(largest <= q->growth * initial)) q->growth = largest / initial;
    if (!(loss <= q->loss)) q->loss = loss;
    return q->growth * q->loss < WORST;
}

ALWAYS_INLINE int factorise(const ts_pattern *p, double a, const double *Jq, const double *Jv, double *factor, const int given,
                            const int D)
{
    const int32_t n = p->n, *const order = p->order, *const diagonal = p->diagonal, *const end = p->end;
    const int32_t *const entry = p->entry, *const fill_first = p->fill_first, *const fill = p->fill;
    const triple zero = {pair_both(0.0), 0.0};
    double *exchange = BLOCK(factor, p->entries), *work = exchange + n; /* (n) P of each row; (n) blocks */
    quality q = {1.0, 1.0};
    for (int32_t r = 0, first = 0; r < n; r++) {
        const int32_t i = order[r], middle = diagonal[i], last = end[i];
        double *S = BLOCK(work, i), *F = BLOCK(factor, middle);
        for (int32_t f = fill_first[r]; f < fill_first[r + 1]; f++)
            for (int d = 0; d < D; d++) store(BLOCK(work, fill[f]) + d * D, zero, D);
        scatter(p, i, a, Jq, Jv, work, given, D);
        const double initial = magnitude(S, D);
        double largest = initial;
        for (int32_t e = first; e < middle; e++) {
            const int32_t k = entry[e], k_middle = diagonal[k], k_last = end[k];
            pair twice[9];
            divide_right(BLOCK(work, k), BLOCK(factor, k_middle), BLOCK(factor, e), twice, D);
            for (int32_t u = k_middle + 1; u < k_last; u++) subtract_product(twice, BLOCK(factor, u), BLOCK(work, entry[u]), D);
            double now = magnitude(S, D);
            if (now > largest) largest = now;
        }
        const double P = exchange[i] = D == 2 ? factorise2(S, F) : factorise3(S, F);
        if (!accept_pivot(&q, initial, largest, inverse_magnitude(F, D))) return 0;
        for (int32_t e = first; e < middle; e++) divide_left(BLOCK(factor, e), F, P, BLOCK(factor, e), D);
        for (int32_t e = middle + 1; e < last; e++) divide_left(BLOCK(work, entry[e]), F, P, BLOCK(factor, e), D);
        first = last;
    }
    return 1;
}

int ts_blocks_factorise(const ts_pattern *p, double a, const double *Jq, const double *Jv, double *factor)
{
    return p->D == 2 ? factorise(p, a, Jq, Jv, factor, 0, 2) : factorise(p, a, Jq, Jv, factor, 0, 3);
}

int ts_blocks_factorise_matrix(const ts_pattern *p, const double *W, double *factor)
{
    return p->D == 2 ? factorise(p, 0.0, W, NULL, factor, 1, 2) : factorise(p, 0.0, W, NULL, factor, 1, 3);
}

/* Products of a row of blocks with parts of a vector, summed: even and odd columns apart, the third ones for themselves. */
typedef struct {
    pair p[3];
    double t[3];
} sums;

ALWAYS_INLINE sums sums_of(triple v, const int D)
{
    const double v0 = pair_first(v.p), v1 = pair_second(v.p);
    const pair zero = pair_both(0.0);
    sums s = {{zero, zero, zero}, {v0, v1, v.t}};
    if (D == 2) {
        s.p[0] = pair_of(v0, 0.0);
        s.p[1] = pair_of(v1, 0.0);
    }
    return s;
}

ALWAYS_INLINE sums sums_of_product(const double *A, triple v, const int D)
{
    sums s;
    for (int d = 0; d < D; d++) {
        s.p[d] = pair_multiply(pair_load(A + d * D), v.p);
        if (D == 3) s.t[d] = A[d * D + 2] * v.t;
    }
    return s; /* cppcheck-suppress uninitvar -- D is 2 or 3 */
}

ALWAYS_INLINE void sums_add(sums *s, const double *A, triple v, const int D)
{
    for (int d = 0; d < D; d++) {
        s->p[d] = pair_add_product(s->p[d], pair_load(A + d * D), v.p);
        if (D == 3) s->t[d] += A[d * D + 2] * v.t;
    }
}

ALWAYS_INLINE void sums_subtract(sums *s, const double *A, triple v, const int D)
{
    for (int d = 0; d < D; d++) {
        s->p[d] = pair_subtract_product(s->p[d], pair_load(A + d * D), v.p);
        if (D == 3) s->t[d] -= A[d * D + 2] * v.t;
    }
}

ALWAYS_INLINE triple sums_total(const sums *s, const int D)
{
    const pair p = s->p[0], q = s->p[1];
    triple v = {pair_add(pair_of(pair_first(p), pair_first(q)), pair_of(pair_second(p), pair_second(q))), 0.0};
    if (D == 3) {
        v.p = pair_add(v.p, pair_of(s->t[0], s->t[1]));
        v.t = pair_first(s->p[2]) + pair_second(s->p[2]) + s->t[2];
    }
    return v;
}

ALWAYS_INLINE void solve(const ts_pattern *p, const double *factor, double *b, const int D)
{
    const int32_t n = p->n, *const order = p->order, *const diagonal = p->diagonal, *const end = p->end;
    const int32_t *const entry = p->entry;
    const double *exchange = BLOCK(factor, p->entries);
    for (int32_t r = 0, e = 0; r < n; r++) {
        const int32_t i = order[r], middle = diagonal[i];
        sums s = sums_of(solve_lower(BLOCK(factor, middle), exchange[i], load(PART(b, i), D), D), D);
        for (; e < middle; e++) sums_subtract(&s, BLOCK(factor, e), load(PART(b, entry[e]), D), D);
        store(PART(b, i), sums_total(&s, D), D);
        e = end[i];
    }
    for (int32_t r = n; r-- > 0;) {
        const int32_t i = order[r], middle = diagonal[i], last = end[i];
        sums s = sums_of(load(PART(b, i), D), D);
        for (int32_t e = middle + 1; e < last; e++) sums_subtract(&s, BLOCK(factor, e), load(PART(b, entry[e]), D), D);
        store(PART(b, i), solve_upper(BLOCK(factor, middle), sums_total(&s, D), D), D);
    }
}

void ts_blocks_solve(const ts_pattern *p, const double *factor, double *b)
{
    if (p->D == 2) solve(p, factor, b, 2);
    else solve(p, factor, b, 3);
}

ALWAYS_INLINE void multiply(const ts_pattern *p, const double *A, const double *x, double *y, const int D)
{
    const int32_t n = p->n, *const row = p->row, *const column = p->column;
    for (int32_t i = 0, m = 0; i < n; i++) {
        const int32_t last = row[i + 1];
        sums s = sums_of_product(BLOCK(A, m), load(PART(x, column[m]), D), D);
        for (m++; m < last; m++) sums_add(&s, BLOCK(A, m), load(PART(x, column[m]), D), D);
        store(PART(y, i), sums_total(&s, D), D);
    }
}

void ts_blocks_multiply(const ts_pattern *p, const double *A, const double *x, double *y)
{
    if (p->D == 2) multiply(p, A, x, y, 2);
    else multiply(p, A, x, y, 3);
}
