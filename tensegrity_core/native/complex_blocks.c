/* Block-sparse factorisation W = L D U of a complex matrix, row by row as in blocks.c: both triangles have unit diagonals,
 * pivots are sought inside the diagonal blocks only, a row stands scattered in the work space while earlier ones are
 * subtracted.
 *
 * A complex number is one pair.  A product a b is (a.re, a.re) b + swap((a.im, -a.im) b); in a sum of products the two parts
 * are summed apart and swapped once.  Each further product then costs two multiplications and two additions of pairs, which
 * is the least there is, and a's two pairs serve a whole row of b. */
#include "complex_blocks.h"

#include <math.h>
#include <string.h>

#define ALWAYS_INLINE static inline __attribute__((always_inline))

/* Largest growth times loss, see accept_pivot(): rounding of 1e-16 then still leaves about three digits. */
#define WORST 1e13

/* Range of the squared magnitudes by which reciprocals divide.  Beyond it they may have overflowed or lost digits. */
#define LEAST 1e-290
#define MOST 1e290

typedef double pair __attribute__((vector_size(16)));
typedef int64_t bits __attribute__((vector_size(16)));

/* A complex number ready to be the first factor of products. */
typedef struct {
    pair re, im; /* (re, re), (im, -im) */
} factor_pair;

ALWAYS_INLINE pair load(const double *x)
{
    pair p;
    memcpy(&p, x, sizeof p);
    return p;
}

ALWAYS_INLINE void store(double *x, pair p)
{
    memcpy(x, &p, sizeof p);
}

ALWAYS_INLINE pair swap(pair a)
{
    return (pair){a[1], a[0]};
}

/* (a.re, -a.im) */
ALWAYS_INLINE pair conjugate(pair a)
{
    return (pair)((bits)a ^ (bits){0, INT64_MIN});
}

ALWAYS_INLINE factor_pair spread(pair a)
{
    return (factor_pair){{a[0], a[0]}, conjugate((pair){a[1], a[1]})};
}

/* a b; a b + c d; a b - c d */
ALWAYS_INLINE pair times(factor_pair a, pair b)
{
    return a.re * b + swap(a.im * b);
}

ALWAYS_INLINE pair times_plus(factor_pair a, pair b, factor_pair c, pair d)
{
    return (a.re * b + c.re * d) + swap(a.im * b + c.im * d);
}

ALWAYS_INLINE pair times_minus(factor_pair a, pair b, factor_pair c, pair d)
{
    return (a.re * b - c.re * d) + swap(a.im * b - c.im * d);
}

/* |a|^2, twice. */
ALWAYS_INLINE pair squared_magnitude(pair a)
{
    pair squares = a * a;
    return squares + swap(squares);
}

ALWAYS_INLINE pair absolute(pair a)
{
    return (pair)((bits)a & (bits){INT64_MAX, INT64_MAX});
}

/* First double of block i of an array of blocks, of number i of a block, of block row i of a vector. */
#define BLOCK(array, i) ((array) + (size_t)(i) * (size_t)(2 * D * D))
#define NUMBER(block, i) ((block) + 2 * (i))
#define PART(vector, i) ((vector) + (size_t)(i) * (size_t)(2 * D))

/* The numbers of a block, ready to be first factors. */
ALWAYS_INLINE void spread_block(factor_pair *a, const double *A, const int D)
{
    for (int d = 0; d < D * D; d++) a[d] = spread(load(NUMBER(A, d)));
}

/* C = A B, or C -= A B, with A spread. */
ALWAYS_INLINE void product(const factor_pair *a, const double *B, double *C, const int subtract, const int D)
{
    pair b[9];
    for (int d = 0; d < D * D; d++) b[d] = load(NUMBER(B, d));
    for (int i = 0; i < D; i++) {
        const factor_pair *row = a + i * D;
        for (int j = 0; j < D; j++) {
            double *c = NUMBER(C, i * D + j);
            pair re = row[0].re * b[j] + row[1].re * b[D + j], im = row[0].im * b[j] + row[1].im * b[D + j];
            if (D == 3) {
                re += row[2].re * b[6 + j];
                im += row[2].im * b[6 + j];
            }
            store(c, subtract ? load(c) - (re + swap(im)) : re + swap(im));
        }
    }
}

/* Sum of the magnitudes of all real and imaginary parts of a block. */
ALWAYS_INLINE double magnitude(const double *A, const int D)
{
    pair even = absolute(load(A)), odd = absolute(load(NUMBER(A, 1)));
    for (int d = 2; d + 1 < D * D; d += 2) {
        even += absolute(load(NUMBER(A, d)));
        odd += absolute(load(NUMBER(A, d + 1)));
    }
    if (D == 3) even += absolute(load(NUMBER(A, 8)));
    even += odd;
    return even[0] + even[1];
}

ALWAYS_INLINE int divisible(pair squared)
{
    return squared[0] >= LEAST && squared[0] <= MOST;
}

/* 1 / a, whose squared magnitude is known. */
ALWAYS_INLINE pair reciprocal(pair a, pair squared)
{
    return conjugate(a) / squared;
}

/* X = A^-1 for D = 2; 0 where A is singular or its numbers are out of range. */
ALWAYS_INLINE int invert2(const double *A, double *X)
{
    pair a = load(A), b = load(A + 2), c = load(A + 4), d = load(A + 6);
    pair determinant = times_minus(spread(a), d, spread(b), c);
    pair squared = squared_magnitude(determinant);
    factor_pair r = spread(reciprocal(determinant, squared));
    store(X, times(r, d));
    store(X + 2, -times(r, b));
    store(X + 4, -times(r, c));
    store(X + 6, times(r, a));
    return divisible(squared);
}

/* The same for D = 3: one step of elimination with the pivot in row `first`, then the 2 x 2 formula on what is left. */
ALWAYS_INLINE int invert3_from(const double *A, double *X, const int first, const int second, const int third)
{
    const double *A0 = A + 6 * first, *A1 = A + 6 * second, *A2 = A + 6 * third;
    double *X0 = X + 2 * first, *X1 = X + 2 * second, *X2 = X + 2 * third;
    pair a00 = load(A0), a01 = load(A0 + 2), a02 = load(A0 + 4);
    pair squared = squared_magnitude(a00), r = reciprocal(a00, squared);
    factor_pair by_r = spread(r);
    factor_pair l1 = spread(times(by_r, load(A1))), l2 = spread(times(by_r, load(A2)));
    factor_pair u1 = spread(times(by_r, a01)), u2 = spread(times(by_r, a02));
    pair s11 = load(A1 + 2) - times(l1, a01), s12 = load(A1 + 4) - times(l1, a02);
    pair s21 = load(A2 + 2) - times(l2, a01), s22 = load(A2 + 4) - times(l2, a02);
    pair determinant = times_minus(spread(s11), s22, spread(s12), s21);
    pair squared_determinant = squared_magnitude(determinant);
    factor_pair d = spread(reciprocal(determinant, squared_determinant));
    pair x11 = times(d, s22), y12 = times(d, s12), y21 = times(d, s21), x22 = times(d, s11);
    pair x01 = times_minus(u2, y21, u1, x11), x02 = times_minus(u1, y12, u2, x22);
    store(X0, r - times_plus(l1, x01, l2, x02));
    store(X1, x01);
    store(X2, x02);
    store(X0 + 6, times_minus(l2, y12, l1, x11));
    store(X1 + 6, x11);
    store(X2 + 6, -y12);
    store(X0 + 12, times_minus(l1, y21, l2, x22));
    store(X1 + 12, -y21);
    store(X2 + 12, x22);
    return divisible(squared) && divisible(squared_determinant);
}

/* Partial pivoting: the largest of the first column, by the sum of its parts' magnitudes. */
ALWAYS_INLINE int invert3(const double *A, double *X)
{
    double size0 = fabs(A[0]) + fabs(A[1]), size1 = fabs(A[6]) + fabs(A[7]), size2 = fabs(A[12]) + fabs(A[13]);
    if (size1 > size0 && size1 >= size2) return invert3_from(A, X, 1, 0, 2);
    if (size2 > size0) return invert3_from(A, X, 2, 1, 0);
    return invert3_from(A, X, 0, 1, 2);
}

/* Row i of W, scattered into the work space. */
ALWAYS_INLINE void scatter(const ts_pattern *p, int32_t i, pair mu, const double *Jq, const double *Jv, double *work,
                           const int D)
{
    const int32_t *const column = p->column;
    for (int32_t m = p->row[i], last = p->row[i + 1]; m < last; m++) {
        double *W = BLOCK(work, column[m]);
        const double *q = Jq + (size_t)m * (size_t)(D * D), *v = Jv + (size_t)m * (size_t)(D * D);
        for (int d = 0; d < D * D; d++) store(NUMBER(W, d), -mu * (pair){v[d], v[d]} - (pair){q[d], 0.0});
    }
    pair square = times(spread(mu), mu);
    double *own = BLOCK(work, i);
    for (int d = 0; d < D; d++) store(NUMBER(own, d * (D + 1)), load(NUMBER(own, d * (D + 1))) + square);
}

/* What rounding can spoil, as in blocks.c: by how much numbers in a pivot's place exceed what the matrix has there (growth),
 * and by how much they exceed what remains of them (loss). */
typedef struct {
    double growth, loss;
} quality;

/* 0 also where a number is not finite: the comparisons are false then. */
ALWAYS_INLINE int accept_pivot(quality *q, double initial, double largest, double inverse)
{
    double loss = largest * inverse;
    if (!(largest <= q->growth * initial)) q->growth = largest / initial;
    if (!(loss <= q->loss)) q->loss = loss;
    return q->growth * q->loss < WORST;
}

ALWAYS_INLINE int factorise(const ts_pattern *p, pair mu, const double *Jq, const double *Jv, double *factor, const int D)
{
    const int32_t n = p->n, *const order = p->order, *const diagonal = p->diagonal, *const end = p->end;
    const int32_t *const entry = p->entry, *const fill_first = p->fill_first, *const fill = p->fill;
    double *work = BLOCK(factor, p->entries);
    quality q = {1.0, 1.0};
    factor_pair spreaded[9];
    int32_t e = 0;
    for (int32_t r = 0; r < n; r++) {
        const int32_t i = order[r], middle = diagonal[i], last = end[i];
        double *own = BLOCK(work, i), *X = BLOCK(factor, middle);
        for (int32_t f = fill_first[r]; f < fill_first[r + 1]; f++)
            for (int d = 0; d < D * D; d++) store(NUMBER(BLOCK(work, fill[f]), d), (pair){0.0, 0.0});
        scatter(p, i, mu, Jq, Jv, work, D);
        const double initial = magnitude(own, D);
        double largest = initial;
        for (; e < middle; e++) {
            const int32_t k = entry[e], k_middle = diagonal[k], k_last = end[k];
            spread_block(spreaded, BLOCK(work, k), D);
            product(spreaded, BLOCK(factor, k_middle), BLOCK(factor, e), 0, D);
            for (int32_t u = k_middle + 1; u < k_last; u++) product(spreaded, BLOCK(factor, u), BLOCK(work, entry[u]), 1, D);
            double now = magnitude(own, D);
            if (now > largest) largest = now;
        }
        if (!(D == 2 ? invert2(own, X) : invert3(own, X))) return 0;
        if (!accept_pivot(&q, initial, largest, magnitude(X, D))) return 0;
        spread_block(spreaded, X, D);
        for (e++; e < last; e++) product(spreaded, BLOCK(work, entry[e]), BLOCK(factor, e), 0, D);
    }
    return 1;
}

size_t ts_complex_factor_size(const ts_pattern *p)
{
    return 2 * ts_pattern_factor_size(p);
}

int ts_complex_factorise(const ts_pattern *p, double re, double im, const double *Jq, const double *Jv, double *factor)
{
    const pair mu = {re, im};
    return p->D == 2 ? factorise(p, mu, Jq, Jv, factor, 2) : factorise(p, mu, Jq, Jv, factor, 3);
}

/* Products of a block row with parts of a vector, summed: those with the real parts and those with (im, -im) apart. */
typedef struct {
    pair re[3], im[3];
} sums;

/* s = A v where A is the first block, else s -= A v. */
ALWAYS_INLINE void accumulate(sums *s, const double *A, const double *v, const int first, const int D)
{
    for (int j = 0; j < D; j++) {
        factor_pair x = spread(load(NUMBER(v, j)));
        for (int d = 0; d < D; d++) {
            pair a = load(NUMBER(A, d * D + j));
            if (first) {
                s->re[d] = j == 0 ? a * x.re : s->re[d] + a * x.re;
                s->im[d] = j == 0 ? a * x.im : s->im[d] + a * x.im;
            } else {
                s->re[d] -= a * x.re;
                s->im[d] -= a * x.im;
            }
        }
    }
}

ALWAYS_INLINE void store_total(double *v, const sums *s, const int D)
{
    for (int d = 0; d < D; d++) store(NUMBER(v, d), s->re[d] + swap(s->im[d]));
}

ALWAYS_INLINE void solve(const ts_pattern *p, const double *factor, double *b, const int D)
{
    const int32_t n = p->n, *const order = p->order, *const diagonal = p->diagonal, *const end = p->end, *const entry = p->entry;
    for (int32_t r = 0, e = 0; r < n; r++) {
        const int32_t i = order[r], middle = diagonal[i];
        sums s;
        for (int d = 0; d < D; d++) {
            s.re[d] = load(NUMBER(PART(b, i), d));
            s.im[d] = (pair){0.0, 0.0};
        }
        for (; e < middle; e++) accumulate(&s, BLOCK(factor, e), PART(b, entry[e]), 0, D);
        store_total(PART(b, i), &s, D);
        e = end[i];
    }
    for (int32_t r = n; r-- > 0;) {
        const int32_t i = order[r], middle = diagonal[i], last = end[i];
        sums s;
        accumulate(&s, BLOCK(factor, middle), PART(b, i), 1, D);
        for (int32_t e = middle + 1; e < last; e++) accumulate(&s, BLOCK(factor, e), PART(b, entry[e]), 0, D);
        store_total(PART(b, i), &s, D);
    }
}

void ts_complex_solve(const ts_pattern *p, const double *factor, double *b)
{
    if (p->D == 2) solve(p, factor, b, 2);
    else solve(p, factor, b, 3);
}
