/* Two numbers that are worked on together, and what else compilers differ in.
 *
 * With GCC and Clang a pair is a vector of the processor.  With other compilers, in C++ and where TS_PLAIN_C is defined it is a
 * structure, and all sources are ISO C99 that is C++11, too.  Either way each of the two numbers is rounded as the standard has
 * it, so that results are the same to the last bit. */
#ifndef TENSEGRITY_PAIRS_H
#define TENSEGRITY_PAIRS_H

#include <math.h>
#include <stdint.h>
#include <string.h>

/* A product is rounded before it is added to something.  GCC has no pragma for that: -std=c99 or -ffp-contract=off. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif

#if defined(__INTEL_COMPILER) || defined(__TINYC__) || defined(__SUNPRO_C) || defined(__PGI)
#define TS_NOT_GCC /* though some of them say so */
#endif

#if (defined(__GNUC__) || defined(__clang__)) && !defined(TS_NOT_GCC) && !defined(__cplusplus) && !defined(TS_PLAIN_C)
#define TS_VECTORS
#define ALWAYS_INLINE static inline __attribute__((always_inline))
#define APART __attribute__((noinline)) /* what is rare stays out of the way of what is not */
#define UNROLL _Pragma("GCC unroll 16")
#else
#if defined(_MSC_VER)
#define ALWAYS_INLINE static __forceinline
#else
#define ALWAYS_INLINE static inline
#endif
#define APART
#define UNROLL
#endif

#if defined(__cplusplus) || defined(_MSC_VER)
#define RESTRICT __restrict
#else
#define RESTRICT restrict
#endif

/* A structure from its members, in both languages: MAKE(ts_term){offset, block, kappa}. */
#if defined(__cplusplus)
#define MAKE(type) type
#else
#define MAKE(type) (type)
#endif

#if defined(TS_VECTORS)

typedef double pair __attribute__((vector_size(16)));
typedef long long pair_bits __attribute__((vector_size(16)));

ALWAYS_INLINE pair pair_of(double a, double b) { return (pair){a, b}; }
ALWAYS_INLINE double pair_first(pair a) { return a[0]; }
ALWAYS_INLINE double pair_second(pair a) { return a[1]; }
ALWAYS_INLINE pair pair_swap(pair a) { return (pair){a[1], a[0]}; }
ALWAYS_INLINE pair pair_add(pair a, pair b) { return a + b; }
ALWAYS_INLINE pair pair_subtract(pair a, pair b) { return a - b; }
ALWAYS_INLINE pair pair_multiply(pair a, pair b) { return a * b; }
ALWAYS_INLINE pair pair_divide(pair a, pair b) { return a / b; }
ALWAYS_INLINE pair pair_choose(pair_bits first, pair a, pair b)
{
    return (pair)((first & (pair_bits)a) | (~first & (pair_bits)b));
}
ALWAYS_INLINE pair pair_larger(pair a, pair b) { return pair_choose(a > b, a, b); }
ALWAYS_INLINE pair pair_smaller(pair a, pair b) { return pair_choose(a < b, a, b); }
ALWAYS_INLINE pair pair_absolute(pair a) { return (pair)((pair_bits)a & (pair_bits){INT64_MAX, INT64_MAX}); }
ALWAYS_INLINE pair pair_conjugate(pair a) { return (pair)((pair_bits)a ^ (pair_bits){0, INT64_MIN}); } /* (a0, -a1) */

#else

typedef struct {
    double a, b;
} pair;

ALWAYS_INLINE pair pair_of(double a, double b)
{
    pair p = {a, b};
    return p;
}

ALWAYS_INLINE double pair_first(pair p) { return p.a; }
ALWAYS_INLINE double pair_second(pair p) { return p.b; }
ALWAYS_INLINE pair pair_swap(pair p) { return pair_of(p.b, p.a); }
ALWAYS_INLINE pair pair_add(pair p, pair q) { return pair_of(p.a + q.a, p.b + q.b); }
ALWAYS_INLINE pair pair_subtract(pair p, pair q) { return pair_of(p.a - q.a, p.b - q.b); }
ALWAYS_INLINE pair pair_multiply(pair p, pair q) { return pair_of(p.a * q.a, p.b * q.b); }
ALWAYS_INLINE pair pair_divide(pair p, pair q) { return pair_of(p.a / q.a, p.b / q.b); }
ALWAYS_INLINE pair pair_larger(pair p, pair q) { return pair_of(p.a > q.a ? p.a : q.a, p.b > q.b ? p.b : q.b); }
ALWAYS_INLINE pair pair_smaller(pair p, pair q) { return pair_of(p.a < q.a ? p.a : q.a, p.b < q.b ? p.b : q.b); }
ALWAYS_INLINE pair pair_absolute(pair p) { return pair_of(fabs(p.a), fabs(p.b)); }
ALWAYS_INLINE pair pair_conjugate(pair p) { return pair_of(p.a, -p.b); }

#endif

ALWAYS_INLINE pair pair_both(double x) { return pair_of(x, x); }
ALWAYS_INLINE pair pair_add_product(pair sum, pair a, pair b) { return pair_add(sum, pair_multiply(a, b)); }
ALWAYS_INLINE pair pair_subtract_product(pair sum, pair a, pair b) { return pair_subtract(sum, pair_multiply(a, b)); }

ALWAYS_INLINE pair pair_load(const double *x)
{
    pair p;
    memcpy(&p, x, sizeof p);
    return p;
}

ALWAYS_INLINE void pair_store(double *x, pair p) { memcpy(x, &p, sizeof p); }

#endif
