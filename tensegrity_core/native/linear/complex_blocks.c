/* Block-sparse LU of a complex matrix, row by row as in blocks.c: the diagonal block that is left of a row is factorised as
 * P S = G E H with G and H unit triangular and E diagonal, and the rest of the row divided by P, G and E, so that only H
 * remains to be applied in a solution.
 *
 * A complex number is one pair.  A product a b is (a.re, a.re) b + swap((a.im, -a.im) b); in a sum of products the two parts
 * are summed apart and swapped once.  Each further product then costs two multiplications and two additions of pairs, which
 * is the least there is, and a's two pairs serve a whole row of b. */
#include "linear/complex_blocks.h"
#include "linear/pairs.h"

#include <math.h>

/* Largest growth times loss, see elimination.def.  It is measured with sums of |re| and |im| over a block, which come to up to
 * five times the condition: systems are accepted up to a condition of 1e13, where rounding of 1e-16 leaves three digits. */
#define WORST 5e13

/* Range of the squared magnitudes by which reciprocal() divides. */
#define LEAST 1e-290
#define MOST 1e290

/* A complex number ready to be the first factor of products. */
typedef struct {
    pair re, im; /* (re, re), (im, -im) */
} factor_pair;

ALWAYS_INLINE factor_pair spread(pair a)
{
    const factor_pair f = {pair_both(pair_first(a)), pair_conjugate(pair_both(pair_second(a)))};
    return f;
}

ALWAYS_INLINE pair times(factor_pair a, pair b) { return pair_add(pair_multiply(a.re, b), pair_swap(pair_multiply(a.im, b))); }

/* b - a c */
ALWAYS_INLINE pair minus_times(pair b, factor_pair a, pair c) { return pair_subtract(b, times(a, c)); }

/* |a|^2, twice. */
ALWAYS_INLINE pair squared_magnitude(pair a)
{
    pair squares = pair_multiply(a, a);
    return pair_add(squares, pair_swap(squares));
}

/* First double of block i of an array of blocks, of number i of a block, of block row i of a vector. */
#define BLOCK(array, i) ((array) + (size_t)(i) * (size_t)(2 * D * D))
#define NUMBER(block, i) ((block) + 2 * (i))
#define PART(vector, i) ((vector) + (size_t)(i) * (size_t)(2 * D))

typedef pair scalar;
typedef factor_pair multiplier;
typedef struct {
    factor_pair f[9];
} pivot_block;

ALWAYS_INLINE pivot_block pivot_of(const double *F, const int D)
{
    pivot_block G;
    for (int d = 0; d < D * D; d++) G.f[d] = spread(pair_load(NUMBER(F, d)));
    return G; /* cppcheck-suppress uninitvar -- D is 2 or 3 */
}

ALWAYS_INLINE void clear(double *A, const int D)
{
    for (int d = 0; d < D * D; d++) pair_store(NUMBER(A, d), pair_both(0.0));
}

/* C -= A B, with A spread. */
ALWAYS_INLINE void subtract_product(const multiplier *a, const double *B, double *C, const int D)
{
    pair b[9];
    for (int d = 0; d < D * D; d++) b[d] = pair_load(NUMBER(B, d));
    for (int i = 0; i < D; i++) {
        const multiplier *row = a + i * D;
        for (int j = 0; j < D; j++) {
            double *c = NUMBER(C, i * D + j);
            pair re = pair_add_product(pair_multiply(row[0].re, b[j]), row[1].re, b[D + j]);
            pair im = pair_add_product(pair_multiply(row[0].im, b[j]), row[1].im, b[D + j]);
            if (D == 3) {
                re = pair_add_product(re, row[2].re, b[6 + j]);
                im = pair_add_product(im, row[2].im, b[6 + j]);
            }
            pair_store(c, pair_subtract(pair_load(c), pair_add(re, pair_swap(im))));
        }
    }
}

/* Sum of the magnitudes of all real and imaginary parts of a block. */
ALWAYS_INLINE double magnitude(const double *A, const int D)
{
    pair even = pair_absolute(pair_load(A)), odd = pair_absolute(pair_load(NUMBER(A, 1)));
    for (int d = 2; d + 1 < D * D; d += 2) {
        even = pair_add(even, pair_absolute(pair_load(NUMBER(A, d))));
        odd = pair_add(odd, pair_absolute(pair_load(NUMBER(A, d + 1))));
    }
    if (D == 3) even = pair_add(even, pair_absolute(pair_load(NUMBER(A, 8))));
    even = pair_add(even, odd);
    return pair_first(even) + pair_second(even);
}

/* |re| + |im| */
ALWAYS_INLINE double size_of(const double *x) { return fabs(x[0]) + fabs(x[1]); }

ALWAYS_INLINE double size_of_pair(pair a)
{
    pair sizes = pair_absolute(a);
    return pair_first(sizes) + pair_second(sizes);
}

/* 1 / a; not a number where squares may have overflowed or lost digits. */
ALWAYS_INLINE pair reciprocal(pair a)
{
    pair squared = squared_magnitude(a);
    if (!(pair_first(squared) >= LEAST && pair_first(squared) <= MOST)) squared = pair_both(NAN);
    return pair_divide(pair_conjugate(a), squared);
}

/* A diagonal block S is kept as P S = G E H in one block F: the numbers of G below the diagonal, E^-1 on it, those of H
 * above.  P is a number too: row d of P S is row exchanged[P][d] of S. */
static const int exchanged[6][3] = {{0, 1, 2}, {1, 0, 2}, {2, 1, 0}, {0, 2, 1}, {1, 2, 0}, {2, 0, 1}};

/* F and P of S; E^-1 is not finite where S is singular. */
ALWAYS_INLINE int factorise2(const double *S, double *F)
{
    const int P = size_of(NUMBER(S, 2)) > size_of(S);
    const double *S0 = S + 4 * P, *S1 = S + 4 * (1 - P);
    pair s01 = pair_load(NUMBER(S0, 1)), e0 = reciprocal(pair_load(S0));
    factor_pair e = spread(e0);
    pair g10 = times(e, pair_load(S1));
    pair_store(F, e0);
    pair_store(NUMBER(F, 1), times(e, s01));
    pair_store(NUMBER(F, 2), g10);
    pair_store(NUMBER(F, 3), reciprocal(minus_times(pair_load(NUMBER(S1, 1)), spread(g10), s01)));
    return P;
}

#define SWAP(a, b)      \
    do {                \
        pair other = a; \
        a = b;          \
        b = other;      \
    } while (0)

/* The same where the first pivot is in row `first`. */
ALWAYS_INLINE int factorise3_from(const double *S, double *F, const int first, const int second, const int third)
{
    const double *S0 = NUMBER(S, 3 * first), *S1 = NUMBER(S, 3 * second), *S2 = NUMBER(S, 3 * third);
    int P = first;
    pair s01 = pair_load(NUMBER(S0, 1)), s02 = pair_load(NUMBER(S0, 2)), e0 = reciprocal(pair_load(S0));
    factor_pair e = spread(e0);
    pair g10 = times(e, pair_load(S1)), g20 = times(e, pair_load(S2));
    factor_pair g1 = spread(g10), g2 = spread(g20);
    pair s11 = minus_times(pair_load(NUMBER(S1, 1)), g1, s01), s12 = minus_times(pair_load(NUMBER(S1, 2)), g1, s02);
    pair s21 = minus_times(pair_load(NUMBER(S2, 1)), g2, s01), s22 = minus_times(pair_load(NUMBER(S2, 2)), g2, s02);
    pair_store(F, e0);
    pair_store(NUMBER(F, 1), times(e, s01));
    pair_store(NUMBER(F, 2), times(e, s02));
    if (size_of_pair(s21) > size_of_pair(s11)) {
        P += 3;
        SWAP(s11, s21);
        SWAP(s12, s22);
        SWAP(g10, g20);
    }
    pair e1 = reciprocal(s11);
    e = spread(e1);
    pair g21 = times(e, s21);
    pair_store(NUMBER(F, 3), g10);
    pair_store(NUMBER(F, 4), e1);
    pair_store(NUMBER(F, 5), times(e, s12));
    pair_store(NUMBER(F, 6), g20);
    pair_store(NUMBER(F, 7), g21);
    pair_store(NUMBER(F, 8), reciprocal(minus_times(s22, spread(g21), s12)));
    return P;
}

ALWAYS_INLINE int factorise3(const double *S, double *F)
{
    double size0 = size_of(S), size1 = size_of(NUMBER(S, 3)), size2 = size_of(NUMBER(S, 6));
    if (size1 > size0 && size1 >= size2) return factorise3_from(S, F, 1, 0, 2);
    if (size2 > size0) return factorise3_from(S, F, 2, 1, 0);
    return factorise3_from(S, F, 0, 1, 2);
}

/* Sum of the magnitudes of E^-1. */
ALWAYS_INLINE double inverse_magnitude(const double *F, const int D)
{
    pair sum = pair_add(pair_absolute(pair_load(F)), pair_absolute(pair_load(NUMBER(F, D + 1))));
    if (D == 3) sum = pair_add(sum, pair_absolute(pair_load(NUMBER(F, 8))));
    return pair_first(sum) + pair_second(sum);
}

/* L = A H^-1, and its numbers spread. */
ALWAYS_INLINE void divide_right(const double *A, const double *F, double *L, multiplier *spreaded, const int D)
{
    pair h01 = pair_load(NUMBER(F, 1)), h02 = h01, h12 = h01;
    if (D == 3) h02 = pair_load(NUMBER(F, 2)), h12 = pair_load(NUMBER(F, 5));
    for (int i = 0; i < D; i++, A += 2 * D, L += 2 * D, spreaded += D) {
        pair l0 = pair_load(A);
        factor_pair f0 = spread(l0);
        pair l1 = minus_times(pair_load(NUMBER(A, 1)), f0, h01);
        factor_pair f1 = spread(l1);
        pair_store(L, l0);
        pair_store(NUMBER(L, 1), l1);
        spreaded[0] = f0;
        spreaded[1] = f1;
        if (D == 2) continue;
        pair re = pair_add_product(pair_multiply(f0.re, h02), f1.re, h12),
             im = pair_add_product(pair_multiply(f0.im, h02), f1.im, h12);
        pair l2 = pair_subtract(pair_subtract(pair_load(NUMBER(A, 2)), re), pair_swap(im));
        pair_store(NUMBER(L, 2), l2);
        spreaded[2] = spread(l2);
    }
}

/* B = E^-1 G^-1 P A; B may be A. */
ALWAYS_INLINE void divide_left(const double *A, const pivot_block *G, int P, double *B, const int D)
{
    const factor_pair *f = G->f;
    const double *A0 = A + 2 * D * exchanged[P][0], *A1 = A + 2 * D * exchanged[P][1], *A2 = A + 2 * D * exchanged[P][2];
    for (int j = 0; j < D; j++) {
        pair r0 = pair_load(NUMBER(A0, j)), r1 = pair_load(NUMBER(A1, j)), r2 = D == 3 ? pair_load(NUMBER(A2, j)) : r1;
        r1 = minus_times(r1, f[D], r0);
        pair_store(NUMBER(B, j), times(f[0], r0));
        pair_store(NUMBER(B, D + j), times(f[D + 1], r1));
        if (D == 2) continue;
        pair re = pair_add_product(pair_multiply(f[6].re, r0), f[7].re, r1);
        pair im = pair_add_product(pair_multiply(f[6].im, r0), f[7].im, r1);
        r2 = pair_subtract(r2, pair_add(re, pair_swap(im)));
        pair_store(NUMBER(B, 6 + j), times(f[8], r2));
    }
}

/* Row i of W, scattered into the work space. */
ALWAYS_INLINE void scatter(const ts_pattern *p, int32_t i, pair mu, const double *Jq, const double *Jv, double *work,
                           const int D)
{
    const int32_t *const column = p->column;
    const pair minus_mu = pair_of(-pair_first(mu), -pair_second(mu));
    for (int32_t m = p->row[i], last = p->row[i + 1]; m < last; m++) {
        double *W = BLOCK(work, column[m]);
        const double *q = Jq + (size_t)m * (size_t)(D * D), *v = Jv + (size_t)m * (size_t)(D * D);
        for (int d = 0; d < D * D; d++)
            pair_store(NUMBER(W, d), pair_subtract(pair_multiply(minus_mu, pair_both(v[d])), pair_of(q[d], 0.0)));
    }
    pair square = times(spread(mu), mu);
    double *own = BLOCK(work, i);
    for (int d = 0; d < D; d++) pair_store(NUMBER(own, d * (D + 1)), pair_add(pair_load(NUMBER(own, d * (D + 1))), square));
}

/* Products of a block row with parts of a vector, summed: those with the real parts and those with (im, -im) apart. */
typedef struct {
    pair re[3], im[3];
} sums;

/* s = E^-1 G^-1 P v */
ALWAYS_INLINE void start_lower(sums *s, const double *F, int P, const double *v, const int D)
{
    pair v0 = pair_load(NUMBER(v, exchanged[P][0]));
    pair v1 = minus_times(pair_load(NUMBER(v, exchanged[P][1])), spread(pair_load(NUMBER(F, D))), v0);
    s->re[0] = times(spread(pair_load(F)), v0);
    s->re[1] = times(spread(pair_load(NUMBER(F, D + 1))), v1);
    s->im[0] = s->im[1] = s->im[2] = s->re[2] = pair_both(0.0);
    if (D == 2) return;
    pair v2 = minus_times(pair_load(NUMBER(v, exchanged[P][2])), spread(pair_load(NUMBER(F, 6))), v0);
    s->re[2] = times(spread(pair_load(NUMBER(F, 8))), minus_times(v2, spread(pair_load(NUMBER(F, 7))), v1));
}

/* s = v */
ALWAYS_INLINE void start_upper(sums *s, const double *v, const int D)
{
    for (int d = 0; d < D; d++) {
        s->re[d] = pair_load(NUMBER(v, d));
        s->im[d] = pair_both(0.0);
    }
}

/* s -= A v */
ALWAYS_INLINE void subtract(sums *s, const double *A, const double *v, const int D)
{
    for (int j = 0; j < D; j++) {
        factor_pair x = spread(pair_load(NUMBER(v, j)));
        for (int d = 0; d < D; d++) {
            pair a = pair_load(NUMBER(A, d * D + j));
            s->re[d] = pair_subtract_product(s->re[d], a, x.re);
            s->im[d] = pair_subtract_product(s->im[d], a, x.im);
        }
    }
}

ALWAYS_INLINE pair total(const sums *s, int d) { return pair_add(s->re[d], pair_swap(s->im[d])); }

ALWAYS_INLINE void put(const sums *s, double *v, const int D)
{
    for (int d = 0; d < D; d++) pair_store(NUMBER(v, d), total(s, d));
}

/* v = H^-1 s */
ALWAYS_INLINE void finish_upper(const sums *s, const double *F, double *v, const int D)
{
    pair v0 = total(s, 0), v1 = total(s, 1);
    if (D == 3) {
        pair v2 = total(s, 2);
        v1 = minus_times(v1, spread(pair_load(NUMBER(F, 5))), v2);
        v0 = minus_times(v0, spread(pair_load(NUMBER(F, 2))), v2);
        pair_store(NUMBER(v, 2), v2);
    }
    pair_store(v, minus_times(v0, spread(pair_load(NUMBER(F, 1))), v1));
    pair_store(NUMBER(v, 1), v1);
}

#include "linear/elimination.def"

int ts_complex_factorise(const ts_pattern *p, double re, double im, const double *Jq, const double *Jv, double *factor)
{
    const pair mu = pair_of(re, im);
    return p->D == 2 ? factorise(p, mu, Jq, Jv, factor, 2) : factorise(p, mu, Jq, Jv, factor, 3);
}

void ts_complex_solve(const ts_pattern *p, const double *factor, double *b)
{
    if (p->D == 2) solve(p, factor, b, 2);
    else solve(p, factor, b, 3);
}
