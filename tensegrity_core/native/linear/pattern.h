/* Sparse systems of D x D blocks (D = 2 or 3) on a symmetric pattern that is known beforehand.
 *
 * The pattern is analysed once: order of elimination, fill, places.  Nothing is allocated after that; factorisations and
 * solutions only run over arrays.  A matrix is the sequence of its blocks as the pattern lists them: row after row, columns
 * ascending, the diagonal block always present; each block is D rows of D numbers. */
#ifndef TENSEGRITY_PATTERN_H
#define TENSEGRITY_PATTERN_H

#include <stddef.h>
#include <stdint.h>

typedef struct {
    int32_t n, D;              /* rows of blocks; rows of a block */
    int32_t count;             /* blocks of the matrix */
    int32_t entries;           /* blocks of the factor, fill included */
    const int32_t *row;        /* (n+1) first block of each row of the matrix */
    const int32_t *column;     /* (count) */
    const int32_t *order;      /* (n) the row that is eliminated first, second, ... */
    const int32_t *diagonal;   /* (n) place in the factor of each row's diagonal block: its part of L ends there, */
    const int32_t *end;        /* (n) and its part of U stands behind, up to here */
    const int32_t *entry;      /* (entries) column of each block of the factor; rows stand in order of elimination */
    const int32_t *fill_first; /* (n+1) first fill of the row that is eliminated first, second, ... */
    const int32_t *fill;       /* (entries - count) columns where the factor has a block and the matrix none */
    void *memory;              /* one allocation behind all of the above */
} ts_pattern;

/* Analyse the pattern of n rows in which rows couples[2c] and couples[2c+1], c < couple_count, are coupled; order and
 * repetition do not matter.  0 where an argument is out of range or memory runs out; the pattern is then empty. */
int ts_pattern_make(ts_pattern *p, int32_t n, int32_t D, const int32_t *couples, size_t couple_count);

/* The same of a saddle point: rows from `late` on, of constraints, are eliminated behind all earlier rows that they are coupled
 * with, so that their pivots are not zero. */
int ts_pattern_make_saddle(ts_pattern *p, int32_t n, int32_t late, int32_t D, const int32_t *couples, size_t couple_count);
void ts_pattern_free(ts_pattern *p);

/* Index of block (i, j) in the matrix; -1 where it has none. */
int32_t ts_pattern_find(const ts_pattern *p, int32_t i, int32_t j);

/* Its first number in an array of the matrix's blocks; negative where it has none. */
int32_t ts_pattern_place(const ts_pattern *p, int32_t i, int32_t j);

/* Doubles in a factor whose numbers are of so many doubles, its work space included. */
size_t ts_pattern_factor_size(const ts_pattern *p, int32_t doubles);

#endif
