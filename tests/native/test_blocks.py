"""The block-sparse factorisation of the kernel against dense linear algebra.

The kernel's library keeps these functions to itself, so they are compiled here once more, with the flags of the kernel.
"""

import ctypes
import subprocess
import sys
import time
from itertools import combinations, pairwise, permutations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tensegrity_core
from tensegrity_core.native import build

NATIVE = Path(tensegrity_core.__file__).parent / "native"
EPS = np.finfo(float).eps
DIMENSIONS = pytest.mark.parametrize("D", [2, 3])
PIVOTS = pytest.mark.parametrize(("small", "accepted"), [(1e-3, True), (1e-15, False), (0.0, False)])
NOT_FINITE = pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])

SHIM = """
#include <stdlib.h>
#include <string.h>
#include "linear/blocks.h"
#if defined(_WIN32)
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

API ts_pattern *make(int32_t n, int32_t D, const int32_t *couples, size_t count)
{
    ts_pattern *p = malloc(sizeof *p);
    if (ts_pattern_make(p, n, D, couples, count)) return p;
    free(p);
    return NULL;
}
API void drop(ts_pattern *p) { ts_pattern_free(p); free(p); }
API int32_t blocks(const ts_pattern *p) { return p->count; }
API int32_t entries(const ts_pattern *p) { return p->entries; }
API void arrays(const ts_pattern *p, int32_t *row, int32_t *column, int32_t *order, int32_t *diagonal, int32_t *end,
                int32_t *entry)
{
    size_t n = (size_t)p->n, size = sizeof(int32_t);
    memcpy(row, p->row, (n + 1) * size);
    memcpy(column, p->column, (size_t)p->count * size);
    memcpy(order, p->order, n * size);
    memcpy(diagonal, p->diagonal, n * size);
    memcpy(end, p->end, n * size);
    memcpy(entry, p->entry, (size_t)p->entries * size);
}
API int32_t find(const ts_pattern *p, int32_t i, int32_t j) { return ts_pattern_find(p, i, j); }
API size_t factor_size(const ts_pattern *p) { return ts_pattern_factor_size(p, 1); }
API int factorise(const ts_pattern *p, double a, const double *Jq, const double *Jv, double *factor)
{
    return ts_blocks_factorise(p, a, Jq, Jv, factor);
}
API void solve(const ts_pattern *p, const double *factor, double *b) { ts_blocks_solve(p, factor, b); }
API void multiply(const ts_pattern *p, const double *A, const double *x, double *y) { ts_blocks_multiply(p, A, x, y); }
"""


def compiled(folder: Path, shim: str, names: tuple[str, ...]) -> ctypes.CDLL:
    """Files of native/linear with a shim that exports what is tested; a warning is an error."""
    (folder / "shim.c").write_text(shim, encoding="utf-8")
    command = build.system_compiler() or build.zig()
    extra = [] if sys.platform == "win32" else ["-fPIC", "-lm"]
    sources = [str(folder / "shim.c"), *(str(NATIVE / "linear" / name) for name in names)]
    target = folder / build.LIBRARY
    flags = ["-shared", *build.FLAGS, "-Wall", "-Wextra", "-pedantic", "-Werror", f"-I{NATIVE}"]
    run = subprocess.run([*command, *flags, *sources, *extra, "-o", str(target)], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return ctypes.CDLL(str(target))


@pytest.fixture(scope="session")
def library(tmp_path_factory):
    lib = compiled(tmp_path_factory.mktemp("blocks"), SHIM, ("pattern.c", "blocks.c"))
    pattern, integer, number = ctypes.c_void_p, ctypes.c_int32, ctypes.c_double
    ints = np.ctypeslib.ndpointer(np.int32, flags="C_CONTIGUOUS")
    reals = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
    for name, result, arguments in [
        ("make", pattern, [integer, integer, ints, ctypes.c_size_t]),
        ("drop", None, [pattern]),
        ("blocks", integer, [pattern]),
        ("entries", integer, [pattern]),
        ("arrays", None, [pattern] + 6 * [ints]),
        ("find", integer, [pattern, integer, integer]),
        ("factor_size", ctypes.c_size_t, [pattern]),
        ("factorise", ctypes.c_int, [pattern, number, reals, reals, reals]),
        ("solve", None, [pattern, reals, reals]),
        ("multiply", None, [pattern, reals, reals, reals]),
    ]:
        getattr(lib, name).restype, getattr(lib, name).argtypes = result, arguments
    return lib


class Pattern:
    """A pattern of the library, its arrays, and what a matrix on it looks like to NumPy."""

    GUARD = 7  # numbers behind an array that nobody may write to

    def __init__(self, lib, n, D, couples):
        flat = np.array(couples, np.int32).reshape(-1)
        self.lib, self.n, self.D = lib, n, D
        self.handle = lib.make(n, D, flat, len(flat) // 2)
        assert self.handle
        self.count, self.entries = lib.blocks(self.handle), lib.entries(self.handle)
        sizes = [n + 1, self.count, n, n, n, self.entries]
        self.row, self.column, self.order, self.diagonal, self.end, self.entry = (np.zeros(s, np.int32) for s in sizes)
        lib.arrays(self.handle, self.row, self.column, self.order, self.diagonal, self.end, self.entry)
        self.rows = np.repeat(np.arange(n), np.diff(self.row))

    def __del__(self):
        if getattr(self, "handle", None):
            self.lib.drop(self.handle)

    def laplace(self):
        """Blocks of a singular matrix: each row adds up to 0."""
        blocks = self.identity(np.diff(self.row) - 1.0)
        blocks[self.rows != self.column] = -np.eye(self.D)
        return blocks

    def full(self):
        """Blocks of which no number is 0 and the diagonal is the largest."""
        return self.identity(5.0) + 1.0 / (1.0 + np.arange(self.count * self.D**2).reshape(-1, self.D, self.D))

    def spoilt(self, number):
        """`full` with this number in each place in turn."""
        for place in np.ndindex(self.count, self.D, self.D):
            blocks = self.full()
            blocks[place] = number
            yield blocks

    def dense(self, A):
        """(n D, n D) of the blocks A (count, D, D)."""
        W = np.zeros((self.n, self.D, self.n, self.D))
        W[self.rows, :, self.column, :] = A
        return W.reshape(self.n * self.D, -1)

    def guarded(self, x):
        return np.concatenate([np.ravel(x), np.full(self.GUARD, np.pi)])

    def unguarded(self, x, size):
        assert np.all(x[size:] == np.pi), "written behind the end of an array"
        return x[:size]

    def factorise(self, W):
        """The factor of the blocks W, or of a^2 I - a Jv - Jq where W is (a, Jq, Jv); None where it is refused."""
        size = self.lib.factor_size(self.handle)
        factor = self.guarded(np.full(size, np.nan))
        given = W if isinstance(W, tuple) else (0.0, -W, np.zeros_like(W))
        done = self.lib.factorise(self.handle, *given, factor)
        return self.unguarded(factor, size) if done else None

    def solve(self, factor, b):
        x = self.guarded(b)
        self.lib.solve(self.handle, factor, x)
        return self.unguarded(x, np.size(b))

    def multiply(self, A, x):
        y = self.guarded(np.zeros(np.size(x)))
        self.lib.multiply(self.handle, A, np.ravel(x), y)
        return self.unguarded(y, np.size(x))

    def random(self, rng):
        return rng.standard_normal((self.count, self.D, self.D))

    def identity(self, scale=1.0):
        """Blocks of scale times the identity; scale is a number, or one per row of blocks."""
        A = np.zeros((self.count, self.D, self.D))
        A[self.rows == self.column] = np.multiply.outer(np.broadcast_to(scale, self.n), np.eye(self.D))
        return A


def path(n):
    return list(pairwise(range(n)))


def grid(w, h):
    along = [(y * w + x, y * w + x + 1) for y in range(h) for x in range(w - 1)]
    return along + [(i, i + w) for i in range(w * (h - 1))]


def tower(stages, width):
    """Stages of coupled blocks, each coupled to part of the next."""
    within = [(s * width + i, s * width + j) for s in range(stages) for i, j in combinations(range(width), 2)]
    between = [(i, i + width + k) for i in range((stages - 1) * width) for k in (0, 1) if i % width + k < width]
    return within + between


GRAPHS = {
    "single": (1, []),
    "pair": (2, [(1, 0)]),
    "no couples": (5, []),
    "dense 3": (3, list(combinations(range(3), 2))),
    "dense 9": (9, list(combinations(range(9), 2))),
    "path": (30, path(30)),
    "ring": (31, [*path(31), (30, 0)]),
    "star": (25, [(24, i) for i in range(24)]),
    "two parts": (14, [*path(7), *((i + 7, j + 7) for i, j in path(7))]),
    "grid": (42, grid(7, 6)),
    "tower": (45, tower(5, 9)),
    "repeated, turned, own": (4, [(0, 1), (1, 0), (0, 1), (2, 2), (3, 1)]),
}
EACH_GRAPH = pytest.mark.parametrize("graph", GRAPHS.values(), ids=GRAPHS.keys())
SOME_GRAPH = st.tuples(st.integers(1, 25), st.floats(0.0, 3.0), st.sampled_from([2, 3]), st.integers(0, 2**32 - 1))


def some_graph(lib, drawn):
    """A random pattern of n rows with about density * n couples, and the generator for its numbers."""
    n, density, D, seed = drawn
    rng = np.random.default_rng(seed)
    return Pattern(lib, n, D, rng.integers(0, n, (int(density * n), 2))), rng


def coupled(n, couples):
    found = np.eye(n, dtype=bool)
    for i, j in couples:
        found[i, j] = found[j, i] = True
    return found


def eliminated(found):
    """Minimum degree by the book: the order, and which blocks the factor has."""
    found, left, order = found.copy(), set(range(len(found))), []
    while left:
        pivot = min(left, key=lambda i: (sum(found[i, j] for j in left), i))
        left.remove(pivot)
        order.append(pivot)
        neighbours = [j for j in left if found[pivot, j]]
        found[np.ix_(neighbours, neighbours)] = True
    return order, found


# --- the pattern -------------------------------------------------------------------------------------------------


@EACH_GRAPH
def test_matrix_has_the_blocks_of_its_couples(library, graph):
    p = Pattern(library, graph[0], 3, graph[1])
    expected = coupled(*graph)
    assert [(i, j) for i, j in zip(p.rows, p.column, strict=True)] == list(zip(*np.nonzero(expected), strict=True))
    for i in range(p.n):
        for j in range(p.n):
            index = library.find(p.handle, i, j)
            assert (index >= 0) == expected[i, j]
            assert index < 0 or (p.rows[index], p.column[index]) == (i, j)


@EACH_GRAPH
def test_order_has_minimum_degree_and_the_factor_its_fill(library, graph):
    check_elimination(Pattern(library, graph[0], 3, graph[1]))


@settings(max_examples=60, deadline=None)
@given(drawn=SOME_GRAPH)
def test_random_order_has_minimum_degree_and_the_factor_its_fill(library, drawn):
    check_elimination(some_graph(library, drawn)[0])


def check_elimination(p):
    matrix = np.zeros((p.n, p.n), bool)
    matrix[p.rows, p.column] = True
    order, filled = eliminated(matrix)
    assert list(p.order) == order
    assert p.entries == filled.sum()
    rank, first = np.argsort(order), 0
    for i in order:
        lower, upper = p.entry[first : p.diagonal[i]], p.entry[p.diagonal[i] + 1 : p.end[i]]
        assert list(rank[lower]) == sorted(r for r in rank[filled[i]] if r < rank[i])
        assert list(rank[upper]) == sorted((r for r in rank[filled[i]] if r > rank[i]), reverse=True)
        assert p.entry[p.diagonal[i]] == i
        first = p.end[i]


def test_factor_grows_with_the_tower(library):
    short, tall = (Pattern(library, 9 * s, 3, tower(s, 9)) for s in (50, 650))
    assert tall.entries / tall.n == pytest.approx(short.entries / short.n, rel=0.02)
    sizes = [library.factor_size(p.handle) for p in (short, tall)]
    assert sizes[1] / sizes[0] == pytest.approx(tall.n / short.n, rel=0.02)


def test_hub_costs_no_more_than_its_spokes(library):
    """Were the hub's list read for every part of the rim, the wheel would take 200 times as long as the rim."""
    n = 100_000
    rim, spokes = np.array(path(n), np.int32), np.array([(0, i) for i in range(1, n)], np.int32)
    spent = []
    for couples in (rim, np.concatenate([rim, spokes])):
        start = time.perf_counter()
        handle = library.make(n, 2, couples.reshape(-1), len(couples))
        spent.append(time.perf_counter() - start)
        assert library.entries(handle) < 6 * n
        library.drop(handle)
    assert spent[1] < 30.0 * spent[0]


@pytest.mark.parametrize(
    ("n", "D", "couples"),
    [(0, 3, []), (-1, 3, []), (3, 1, []), (3, 4, []), (3, 3, [(0, 3)]), (3, 3, [(-1, 2)]), (2**31 - 1, 3, [])],
)
def test_arguments_out_of_range_make_no_pattern(library, n, D, couples):
    assert library.make(n, D, np.array(couples, np.int32).reshape(-1), len(couples)) is None


# --- the numbers -------------------------------------------------------------------------------------------------


@EACH_GRAPH
@DIMENSIONS
def test_solution_of_a_dominated_system(library, graph, D):
    check_stage(Pattern(library, graph[0], D, graph[1]), np.random.default_rng(5))


@settings(max_examples=100, deadline=None)
@given(drawn=SOME_GRAPH)
def test_solution_of_a_random_dominated_system(library, drawn):
    check_stage(*some_graph(library, drawn))


def check_stage(p, rng):
    """Both ways to give W, and products, against dense algebra."""
    Jq, Jv, a, b = p.random(rng), p.random(rng), 12.0 + 4.0 * p.n, rng.standard_normal(p.n * p.D)
    W = a * a * np.eye(p.n * p.D) - a * p.dense(Jv) - p.dense(Jq)
    expected = np.linalg.solve(W, b)
    tolerance = 1e-12 * np.abs(expected).max()
    np.testing.assert_allclose(p.solve(p.factorise((a, Jq, Jv)), b), expected, rtol=0.0, atol=tolerance)
    given_blocks = p.identity(a * a) - a * Jv - Jq
    np.testing.assert_allclose(p.solve(p.factorise(given_blocks), b), expected, rtol=0.0, atol=tolerance)
    np.testing.assert_allclose(p.multiply(Jv, b), p.dense(Jv) @ b, rtol=0.0, atol=1e-13 * p.n * np.abs(b).max())


@DIMENSIONS
def test_rows_are_exchanged_inside_a_block(library, D):
    """On the diagonal every permutation there is."""
    turns = [np.eye(D)[list(turn)] for turn in permutations(range(D))]
    p, rng = Pattern(library, len(turns), D, path(len(turns))), np.random.default_rng(2)
    A = 1e-6 * p.random(rng)
    A[p.rows == p.column] += turns
    x = rng.standard_normal(p.n * D)
    np.testing.assert_allclose(p.solve(p.factorise(A), p.dense(A) @ x), x, rtol=0.0, atol=1e-14)


@EACH_GRAPH
def test_scaled_rows_give_the_same_solution_to_the_last_bit(library, graph):
    """Powers of two, so that nothing is rounded: a mass changes the size of its rows, not how they are eliminated."""
    p, rng = Pattern(library, graph[0], 3, graph[1]), np.random.default_rng(3)
    A, b = p.random(rng) + p.identity(8.0), rng.standard_normal((p.n, 3))
    scale = 2.0 ** rng.integers(-40, 40, p.n)
    scaled = p.solve(p.factorise(A * scale[p.rows, None, None]), b * scale[:, None])
    np.testing.assert_array_equal(scaled, p.solve(p.factorise(A), b))


@settings(max_examples=100, deadline=None)
@given(drawn=SOME_GRAPH, decades=st.floats(0.0, 10.0))
def test_positive_definite_systems_are_never_refused(library, drawn, decades):
    """Springs of very different stiffness between masses of very different size: the error is that of the condition."""
    p, rng = some_graph(library, drawn)
    K = p.identity(1.0)
    index = {block: k for k, block in enumerate(zip(p.rows, p.column, strict=True))}
    for i, j in index:
        if i < j:
            direction, stiffness = rng.standard_normal(p.D), 10.0 ** rng.uniform(0.0, decades)
            spring = stiffness * np.outer(direction, direction)
            for block, sign in (((i, i), 1), ((j, j), 1), ((i, j), -1), ((j, i), -1)):
                K[index[block]] += sign * spring
    condition = np.linalg.cond(p.dense(K))
    W = K / 10.0 ** rng.uniform(-2.0, 2.0, p.n)[p.rows, None, None]
    x = rng.standard_normal(p.n * p.D)
    factor = p.factorise(W)
    assert factor is not None
    error = np.abs(p.solve(factor, p.dense(W) @ x) - x).max()
    assert error <= 10.0 * EPS * condition * np.abs(x).max()


@DIMENSIONS
def test_stiff_direction_costs_its_condition_and_not_the_square_of_it(library, D):
    """A string 1e10 times as stiff as all else; with inverted diagonal blocks the error was 1e4 here."""
    p, rng = Pattern(library, 2, D, [(0, 1)]), np.random.default_rng(4)
    direction = rng.standard_normal(D)
    spring = 1e10 * np.outer(direction, direction)
    A = p.identity(1.0) + np.array([spring, -spring, -spring, spring])
    x = rng.standard_normal(2 * D)
    assert np.abs(p.solve(p.factorise(A), p.dense(A) @ x) - x).max() < 1e-5


@settings(max_examples=200, deadline=None)
@given(drawn=SOME_GRAPH, row=st.integers(0, 24), distance=st.floats(0.0, 18.0))
def test_a_factor_is_accurate_or_refused(library, drawn, row, distance):
    """Indefinite systems, one diagonal block of which is singular but for 10^-distance."""
    p, rng = some_graph(library, drawn)
    A = p.random(rng)
    left, right = (np.linalg.qr(rng.standard_normal((p.D, p.D)))[0] for _ in range(2))
    A[library.find(p.handle, row % p.n, row % p.n)] = left @ np.diag([10.0**-distance] + [1.0] * (p.D - 1)) @ right
    dense, b = p.dense(A), rng.standard_normal(p.n * p.D)
    factor = p.factorise(A)
    if factor is None:
        assert distance > 2.0
        return
    x = p.solve(factor, b)
    assert np.abs(dense @ x - b).max() <= 1e-4 * np.abs(dense).sum(axis=1).max() * np.abs(x).max()


@DIMENSIONS
@PIVOTS
def test_growth_is_refused(library, D, small, accepted):
    """[[small, 1], [1, 1]] is well conditioned, but eliminating its first row wipes out the second."""
    p = Pattern(library, 2, D, [(0, 1)])
    A = np.array([small, 1.0, 1.0, 1.0])[:, None, None] * np.eye(D)
    factor = p.factorise(A)
    assert (factor is not None) == accepted
    if accepted:
        b = np.arange(2.0 * D)
        np.testing.assert_allclose(p.solve(factor, b), np.linalg.solve(p.dense(A), b), rtol=0.0, atol=1e-11)


@EACH_GRAPH
@DIMENSIONS
def test_singular_systems_are_refused(library, graph, D):
    p = Pattern(library, graph[0], D, graph[1])
    laplace = p.laplace()
    assert p.factorise(laplace) is None
    assert p.factorise(np.zeros_like(laplace)) is None
    assert p.factorise((2.0, 4.0 * p.identity(), p.identity(0.0))) is None


@NOT_FINITE
@DIMENSIONS
def test_numbers_that_are_not_finite_are_refused_wherever_they_stand(library, D, number):
    p = Pattern(library, 5, D, [*path(5), (0, 3)])
    for A in p.spoilt(number):
        assert p.factorise(A) is None
        assert p.factorise((9.0, A, p.identity())) is None
        assert p.factorise((9.0, p.identity(), A)) is None
