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

/* Largest growth times loss, see elimination.def: rounding of 1e-16 then leaves about three digits. */
#define WORST 1e13

/* D numbers in a row are a pair and, for D = 3, a single one.  They are loaded in the parts in which they were stored: only
 * then processors hand them on without waiting for the memory. */
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

typedef double scalar;
typedef pair multiplier;
typedef struct {
    const double *F;
} pivot_block;

ALWAYS_INLINE pivot_block pivot_of(const double *F, const int D)
{
    (void)D;
    return MAKE(pivot_block){F};
}

ALWAYS_INLINE void clear(double *A, const int D)
{
    const triple zero = {pair_both(0.0), 0.0};
    for (int d = 0; d < D; d++) store(A + d * D, zero, D);
}

/* First number of block i of an array of blocks, or of block row i of a vector. */
#define BLOCK(array, i) ((array) + (size_t)(i) * (size_t)(D * D))
#define PART(vector, i) ((vector) + (size_t)(i) * (size_t)D)

/* C -= A B, where a holds the numbers of A twice each.  Pairs first and single numbers last: that takes fewer registers. */
ALWAYS_INLINE void subtract_product(const multiplier *a, const double *B, double *C, const int D)
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

#define EXCHANGE(type, r0, r1, r2, P)    \
    do {                                 \
        if ((P) & 1) SWAP(type, r0, r1); \
        if ((P) & 2) SWAP(type, r0, r2); \
        if ((P) & 4) SWAP(type, r1, r2); \
    } while (0)

/* F and P of S; E^-1 is not finite where S is singular. */
ALWAYS_INLINE int factorise2(const double *S, double *F)
{
    double s00 = S[0], s01 = S[1], s10 = S[2], s11 = S[3];
    int P = 0;
    if (fabs(s10) > fabs(s00)) {
        P = 1;
        SWAP(double, s00, s10);
        SWAP(double, s01, s11);
    }
    double e0 = 1.0 / s00, g10 = s10 * e0, h01 = s01 * e0, e1 = 1.0 / (s11 - g10 * s01);
    pair_store(F, pair_of(e0, h01));
    pair_store(F + 2, pair_of(g10, e1));
    return P;
}

ALWAYS_INLINE int factorise3(const double *S, double *F)
{
    double s00 = S[0], s01 = S[1], s02 = S[2], s10 = S[3], s11 = S[4], s12 = S[5], s20 = S[6], s21 = S[7], s22 = S[8];
    int P = 0;
    if (fabs(s10) > fabs(s00) && fabs(s10) >= fabs(s20)) {
        P = 1;
        SWAP(double, s00, s10);
        SWAP(double, s01, s11);
        SWAP(double, s02, s12);
    } else if (fabs(s20) > fabs(s00)) {
        P = 2;
        SWAP(double, s00, s20);
        SWAP(double, s01, s21);
        SWAP(double, s02, s22);
    }
    double e0 = 1.0 / s00, g10 = s10 * e0, g20 = s20 * e0, h01 = s01 * e0, h02 = s02 * e0;
    s11 -= g10 * s01, s12 -= g10 * s02, s21 -= g20 * s01, s22 -= g20 * s02;
    if (fabs(s21) > fabs(s11)) {
        P += 4;
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
ALWAYS_INLINE void divide_right(const double *A, const double *F, double *L, multiplier *twice, const int D)
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
ALWAYS_INLINE void divide_left(const double *A, const pivot_block *G, int P, double *B, const int D)
{
    const double *F = G->F;
    triple r0 = load(A, D), r1 = load(A + D, D), r2 = D == 3 ? load(A + 6, D) : r1;
    if (P) EXCHANGE(triple, r0, r1, r2, P);
    r1 = minus_scaled(r1, F[D], r0);
    store(B, scaled(F[0], r0), D);
    store(B + D, scaled(F[D + 1], r1), D);
    if (D == 2) return;
    r2 = minus_scaled(minus_scaled(r2, F[6], r0), F[7], r1);
    store(B + 6, scaled(F[8], r2), D);
}

/* W = a^2 I - a Jv - Jq: row i, scattered into the work space. */
ALWAYS_INLINE void scatter(const ts_pattern *p, int32_t i, double a, const double *Jq, const double *Jv, double *work,
                           const int D)
{
    const int32_t *const column = p->column;
    const pair minus_a = pair_both(-a);
    for (int32_t m = p->row[i], last = p->row[i + 1]; m < last; m++) {
        double *W = BLOCK(work, column[m]);
        for (int d = 0; d < D; d++) {
            triple w = load(BLOCK(Jq, m) + d * D, D), v = load(BLOCK(Jv, m) + d * D, D);
            w.p = pair_subtract(pair_multiply(minus_a, v.p), w.p);
            w.t = -a * v.t - w.t;
            store(W + d * D, w, D);
        }
    }
    double *own = BLOCK(work, i);
    pair_store(own, pair_add(pair_load(own), pair_of(a * a, 0.0)));
    pair_store(own + D, pair_add(pair_load(own + D), pair_of(0.0, a * a)));
    if (D == 3) own[8] += a * a;
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

/* s -= A v */
ALWAYS_INLINE void subtract(sums *s, const double *A, const double *x, const int D)
{
    const triple v = load(x, D);
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

/* s = E^-1 G^-1 P v */
ALWAYS_INLINE void start_lower(sums *s, const double *F, int P, const double *x, const int D)
{
    triple v = load(x, D);
    double v0 = pair_first(v.p), v1 = pair_second(v.p), v2 = v.t;
    if (P) EXCHANGE(double, v0, v1, v2, P);
    v1 -= F[D] * v0;
    v.p = pair_multiply(pair_of(v0, v1), pair_of(F[0], F[D + 1]));
    if (D == 3) v.t = (v2 - F[6] * v0 - F[7] * v1) * F[8];
    *s = sums_of(v, D);
}

ALWAYS_INLINE void start_upper(sums *s, const double *x, const int D) { *s = sums_of(load(x, D), D); }
ALWAYS_INLINE void put(const sums *s, double *x, const int D) { store(x, sums_total(s, D), D); }

/* x = H^-1 s */
ALWAYS_INLINE void finish_upper(const sums *s, const double *F, double *x, const int D)
{
    triple v = sums_total(s, D);
    double v0 = pair_first(v.p), v1 = pair_second(v.p);
    if (D == 3) {
        v0 -= F[2] * v.t;
        v1 -= F[5] * v.t;
    }
    v.p = pair_of(v0 - F[1] * v1, v1);
    store(x, v, D);
}

#include "linear/elimination.def"

int ts_blocks_factorise(const ts_pattern *p, double a, const double *Jq, const double *Jv, double *factor)
{
    return p->D == 2 ? factorise(p, a, Jq, Jv, factor, 2) : factorise(p, a, Jq, Jv, factor, 3);
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
