/* The pattern's analysis: order of elimination, fill, places of the factor's blocks.
 *
 * Order: minimum degree (W. F. Tinney and J. W. Walker, Direct solutions of sparse network equations by optimally ordered
 * triangular factorization, Proc. IEEE 55 (1967) 1801, doi:10.1109/PROC.1967.6011) on the graph of the partly eliminated
 * matrix, in which the neighbours of a pivot are at the same time its row of U. */
#include "linear/pattern.h"
#include "invariants.h"

#include <stdlib.h>
#include <string.h>

/* Rows of blocks and their neighbours: lists in one pool, from which eliminated rows are dropped when they are next read. */
typedef struct {
    int32_t n;
    size_t *at;             /* (n) start of each list */
    int32_t *length, *room; /* (n) numbers in it, and reserved for it */
    int32_t *degree;        /* (n) neighbours that are not eliminated */
    int32_t *gone, *mark;   /* (n) eliminated; scratch */
    int32_t *heap, *where;  /* (n) rows by (key, number), and their places there */
    int32_t *key;           /* (n) degree as the heap knows it */
    int32_t *order;         /* (n) */
    int32_t *waits;         /* (n) rows that must be eliminated before */
    int32_t late;           /* rows from here on have to wait */
    int32_t *pool;
    size_t used, capacity; /* of the pool */
} graph;

static void graph_free(graph *g)
{
    free(g->at);
    free(g->length);
    free(g->pool);
}

/* Lists of the matrix's rows without the diagonal. */
static int graph_make(graph *g, const ts_pattern *p, int32_t late)
{
    size_t n = (size_t)p->n;
    memset(g, 0, sizeof *g);
    g->n = p->n;
    g->capacity = 2 * (size_t)p->count;
    g->at = (size_t *)malloc(n * sizeof *g->at);
    g->length = (int32_t *)calloc(10 * n, sizeof *g->length);
    g->pool = (int32_t *)malloc(g->capacity * sizeof *g->pool);
    if (!g->at || !g->length || !g->pool) return 0;
    g->room = g->length + n;
    g->degree = g->room + n;
    g->gone = g->degree + n;
    g->mark = g->gone + n;
    g->heap = g->mark + n;
    g->where = g->heap + n;
    g->key = g->where + n;
    g->order = g->key + n;
    g->waits = g->order + n;
    g->late = late;
    for (int32_t i = 0; i < p->n; i++) {
        g->at[i] = g->used;
        for (int32_t e = p->row[i]; e < p->row[i + 1]; e++)
            if (p->column[e] != i) g->pool[g->used++] = p->column[e];
        g->length[i] = g->room[i] = g->degree[i] = g->key[i] = p->row[i + 1] - p->row[i] - 1;
        for (int32_t e = p->row[i]; i >= late && e < p->row[i + 1]; e++) g->waits[i] += p->column[e] < late;
        if (g->waits[i]) g->key[i] += p->n;
    }
    return 1;
}

/* Append j to the list of row i, which moves to the pool's end when it is full. */
static int graph_append(graph *g, int32_t i, int32_t j)
{
    if (g->length[i] == g->room[i]) {
        size_t room = 2 * (size_t)g->length[i] + 4;
        if (g->used + room > g->capacity) {
            size_t capacity = 2 * (g->used + room);
            int32_t *pool = (int32_t *)realloc(g->pool, capacity * sizeof *pool);
            if (!pool) return 0;
            g->pool = pool;
            g->capacity = capacity;
        }
        memcpy(g->pool + g->used, g->pool + g->at[i], (size_t)g->length[i] * sizeof *g->pool);
        g->at[i] = g->used;
        g->room[i] = (int32_t)room;
        g->used += room;
    }
    g->pool[g->at[i] + (size_t)g->length[i]++] = j;
    return 1;
}

/* Drop eliminated rows from the list of row i; mark the others. */
static void graph_compact(graph *g, int32_t i, int32_t stamp)
{
    int32_t *list = g->pool + g->at[i], kept = 0;
    for (int32_t k = 0; k < g->length[i]; k++)
        if (!g->gone[list[k]]) {
            g->mark[list[k]] = stamp;
            list[kept++] = list[k];
        }
    g->length[i] = kept;
}

static int heap_before(const graph *g, int32_t i, int32_t j) { return g->key[i] == g->key[j] ? i < j : g->key[i] < g->key[j]; }

static void heap_put(graph *g, int32_t slot, int32_t row)
{
    g->heap[slot] = row;
    g->where[row] = slot;
}

/* Restore the order of the heap of `size` rows after the key of the one in `slot` has changed. */
static void heap_move(graph *g, int32_t size, int32_t slot)
{
    int32_t row = g->heap[slot];
    while (slot > 0 && heap_before(g, row, g->heap[(slot - 1) / 2])) {
        heap_put(g, slot, g->heap[(slot - 1) / 2]);
        slot = (slot - 1) / 2;
    }
    for (;;) {
        int32_t child = 2 * slot + 1;
        if (child >= size) break;
        if (child + 1 < size && heap_before(g, g->heap[child + 1], g->heap[child])) child++;
        if (!heap_before(g, g->heap[child], row)) break;
        heap_put(g, slot, g->heap[child]);
        slot = child;
    }
    heap_put(g, slot, row);
}

/* Connect all neighbours of the eliminated row p with each other.  The neighbour of largest degree goes last, where its
 * list need not be read: a hub with many spokes then costs no more than its spokes. */
static int graph_connect(graph *g, int32_t p, int32_t *stamp)
{
    int32_t count = g->length[p], last = count - 1, largest = last;
    int32_t *list = g->pool + g->at[p];
    for (int32_t k = 0; k < last; k++)
        if (g->degree[list[k]] > g->degree[list[largest]]) largest = k;
    if (count > 0) {
        int32_t hub = list[largest];
        list[largest] = list[last];
        list[last] = hub;
    }
    for (int32_t k = 0; k < last; k++) {
        int32_t i = g->pool[g->at[p] + (size_t)k];
        graph_compact(g, i, ++*stamp);
        for (int32_t l = k + 1; l < count; l++) {
            int32_t j = g->pool[g->at[p] + (size_t)l];
            if (g->mark[j] == *stamp) continue;
            if (!graph_append(g, i, j) || !graph_append(g, j, i)) return 0;
            g->degree[i]++;
            g->degree[j]++;
        }
    }
    return 1;
}

/* Eliminate row after row, always one of smallest degree, of these the first.  Each list is then what the row has in U.
 * Returns the number of blocks in L; -1 where memory runs out or the factor's blocks cannot be counted in 32 bits. */
static int32_t graph_eliminate(graph *g, const ts_pattern *a)
{
    int32_t total = 0, stamp = 0, size = g->n;
    for (int32_t i = 0; i < size; i++) {
        heap_put(g, i, i);
        heap_move(g, i + 1, i);
    }
    for (int32_t r = 0; r < g->n; r++) {
        int32_t p = g->heap[0];
        g->order[r] = p;
        g->gone[p] = 1;
        if (--size > 0) {
            heap_put(g, 0, g->heap[size]);
            heap_move(g, size, 0);
        }
        graph_compact(g, p, ++stamp);
        if (total > (INT32_MAX - g->n) / 2 - g->length[p]) return -1;
        total += g->length[p];
        if (!graph_connect(g, p, &stamp)) return -1;
        for (int32_t e = a->row[p]; p < g->late && e < a->row[p + 1]; e++) g->waits[a->column[e]] -= a->column[e] >= g->late;
        for (int32_t k = 0; k < g->length[p]; k++) {
            int32_t i = g->pool[g->at[p] + (size_t)k];
            g->key[i] = --g->degree[i] + (g->waits[i] > 0 ? g->n : 0);
            heap_move(g, size, g->where[i]);
        }
    }
    return total;
}

/* Rows of the matrix: each couple in both rows, transposed once to sort them, repetitions dropped on the way.  Returns a
 * pointer to free holding row (n+1) and column; NULL where memory runs out. */
static int32_t *matrix_rows(ts_pattern *p, const int32_t *couples, size_t couple_count)
{
    size_t n = (size_t)p->n, most = n + 2 * couple_count;
    int32_t *row = (int32_t *)calloc(3 * n + 2 + 2 * most, sizeof *row);
    if (!row) return NULL;
    int32_t *first = row + n + 1, *next = first + n + 1, *raw = next + n, *column = raw + most;
    for (size_t c = 0; c < 2 * couple_count; c++) first[couples[c] + 1]++;
    for (int32_t i = 0; i < p->n; i++) {
        first[i + 1] += first[i] + 1;
        raw[first[i]] = i;
        next[i] = first[i] + 1;
    }
    for (size_t c = 0; c < 2 * couple_count; c++) raw[next[couples[c]]++] = couples[c ^ 1];
    memcpy(next, first, n * sizeof *next);
    for (int32_t i = 0; i < p->n; i++)
        for (int32_t e = first[i]; e < first[i + 1]; e++) {
            int32_t j = raw[e];
            if (next[j] == first[j] || column[next[j] - 1] != i) column[next[j]++] = i;
        }
    for (int32_t i = 0; i < p->n; i++) {
        row[i + 1] = row[i] + next[i] - first[i];
        memmove(column + row[i], column + first[i], (size_t)(next[i] - first[i]) * sizeof *column);
    }
    p->row = row;
    p->column = column;
    p->count = row[p->n];
    return row;
}

/* Arrays of the finished pattern in one allocation, the matrix's rows copied into it. */
typedef struct {
    int32_t *row, *order, *diagonal, *end, *fill_first, *column, *entry, *fill;
} layout;

static int layout_make(layout *a, ts_pattern *p)
{
    size_t n = (size_t)p->n, count = (size_t)p->count, entries = (size_t)p->entries;
    a->row = (int32_t *)malloc((5 * n + 2 + 2 * entries) * sizeof *a->row);
    if (!a->row) return 0;
    a->order = a->row + n + 1;
    a->diagonal = a->order + n;
    a->end = a->diagonal + n;
    a->fill_first = a->end + n;
    a->column = a->fill_first + n + 1;
    a->entry = a->column + count;
    a->fill = a->entry + entries;
    memcpy(a->row, p->row, (n + 1) * sizeof *a->row);
    memcpy(a->column, p->column, count * sizeof *a->column);
    p->memory = a->row;
    p->row = a->row, p->column = a->column, p->order = a->order, p->diagonal = a->diagonal, p->end = a->end;
    p->entry = a->entry, p->fill_first = a->fill_first, p->fill = a->fill;
    return 1;
}

/* Places of the factor's blocks, from the pivots' rows of U.  Rows of L list pivots first to last; rows of U last to first,
 * so that both substitutions meet the number that was found last at the end of a row. */
static void layout_factor(const layout *a, graph *g)
{
    int32_t n = g->n, *lower = g->where, *next = g->degree, base = 0;
    memset(lower, 0, (size_t)n * sizeof *lower);
    for (int32_t p = 0; p < n; p++)
        for (int32_t k = 0; k < g->length[p]; k++) lower[g->pool[g->at[p] + (size_t)k]]++;
    for (int32_t r = 0; r < n; r++) {
        int32_t i = a->order[r] = g->order[r];
        next[i] = base;
        a->diagonal[i] = base + lower[i];
        a->end[i] = base = a->diagonal[i] + 1 + g->length[i];
        a->entry[a->diagonal[i]] = i;
    }
    for (int32_t r = 0; r < n; r++) {
        int32_t p = g->order[r];
        for (int32_t k = 0; k < g->length[p]; k++) a->entry[next[g->pool[g->at[p] + (size_t)k]]++] = p;
    }
    for (int32_t i = 0; i < n; i++) next[i] = a->diagonal[i] + 1;
    for (int32_t r = n; r-- > 0;) {
        int32_t i = g->order[r];
        for (int32_t e = a->diagonal[i] - lower[i]; e < a->diagonal[i]; e++) a->entry[next[a->entry[e]]++] = i;
    }
}

/* List the blocks of the factor that the matrix does not have. */
static void layout_fill(const layout *a, graph *g)
{
    int32_t used = 0, e = 0;
    for (int32_t i = 0; i < g->n; i++) g->mark[i] = -1;
    for (int32_t r = 0; r < g->n; r++) {
        int32_t i = a->order[r];
        a->fill_first[r] = used;
        for (int32_t f = a->row[i]; f < a->row[i + 1]; f++) g->mark[a->column[f]] = i;
        for (; e < a->end[i]; e++)
            if (g->mark[a->entry[e]] != i) a->fill[used++] = a->entry[e];
    }
    a->fill_first[g->n] = used;
}

static int analyse(ts_pattern *p, int32_t late)
{
    graph g;
    layout a;
    int made = 0;
    if (graph_make(&g, p, late)) {
        int32_t lower = graph_eliminate(&g, p);
        p->entries = p->n + 2 * lower;
        if (lower >= 0 && layout_make(&a, p)) {
            layout_factor(&a, &g);
            layout_fill(&a, &g);
            made = 1;
        }
    }
    graph_free(&g);
    return made;
}

int ts_pattern_make(ts_pattern *p, int32_t n, int32_t D, const int32_t *couples, size_t couple_count)
{
    return ts_pattern_make_saddle(p, n, n, D, couples, couple_count);
}

int ts_pattern_make_saddle(ts_pattern *p, int32_t n, int32_t late, int32_t D, const int32_t *couples, size_t couple_count)
{
    memset(p, 0, sizeof *p);
    if (n < 1 || n >= INT32_MAX / 2 || (D != 2 && D != 3) || couple_count > (size_t)(INT32_MAX - n) / 2) return 0;
    for (size_t c = 0; c < 2 * couple_count; c++)
        if (couples[c] < 0 || couples[c] >= n) return 0;
    p->n = n;
    p->D = D;
    int32_t *rows = matrix_rows(p, couples, couple_count);
    int made = rows && analyse(p, late);
    free(rows);
    TS_ASSERT(!made || (p->entries >= p->count && p->row[n] == p->count));
    if (!made) memset(p, 0, sizeof *p);
    return made;
}

void ts_pattern_free(ts_pattern *p)
{
    free(p->memory);
    memset(p, 0, sizeof *p);
}

int32_t ts_pattern_find(const ts_pattern *p, int32_t i, int32_t j)
{
    int32_t low = p->row[i], high = p->row[i + 1];
    while (low < high) {
        int32_t middle = low + (high - low) / 2;
        if (p->column[middle] < j) low = middle + 1;
        else high = middle;
    }
    return low < p->row[i + 1] && p->column[low] == j ? low : -1;
}

int32_t ts_pattern_place(const ts_pattern *p, int32_t i, int32_t j) { return p->D * p->D * ts_pattern_find(p, i, j); }

size_t ts_pattern_factor_size(const ts_pattern *p, int32_t doubles)
{
    return ((size_t)p->entries + (size_t)p->n) * (size_t)(doubles * p->D * p->D) + (size_t)p->n;
}
