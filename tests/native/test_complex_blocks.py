"""The complex block-sparse solver of the kernel against dense linear algebra, on the systems of an implicit Radau step.

Patterns come from the library of test_blocks.py; the complex functions, which the kernel keeps to itself too, are compiled
here once more and work on the same patterns.
"""

import ctypes
from itertools import combinations, permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.native import test_blocks
from tests.native.test_blocks import DIMENSIONS, EACH_GRAPH, EPS, NOT_FINITE, PIVOTS, SOME_GRAPH, Pattern, path, tower

library = test_blocks.library

#: mu h of the two pairs of conjugate eigenvalues of Radau IIA with five stages, inverse coefficient matrix.
MU_H = (3.6556943 + 6.5437369j, 5.7009533 + 3.2102656j)

SHIM = """
#include "linear/complex_blocks.h"
#if defined(_WIN32)
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

API size_t factor_size(const ts_pattern *p) { return ts_pattern_factor_size(p, 2); }
API int factorise(const ts_pattern *p, double re, double im, const double *Jq, const double *Jv, double *factor)
{
    return ts_complex_factorise(p, re, im, Jq, Jv, factor);
}
API void solve(const ts_pattern *p, const double *factor, double *b) { ts_complex_solve(p, factor, b); }
"""


@pytest.fixture(scope="session")
def complex_library(tmp_path_factory):
    lib = test_blocks.compiled(tmp_path_factory.mktemp("complex_blocks"), SHIM, ("pattern.c", "complex_blocks.c"))
    pattern, number = ctypes.c_void_p, ctypes.c_double
    reals = np.ctypeslib.ndpointer(np.float64, flags="C_CONTIGUOUS")
    for name, result, arguments in [
        ("factor_size", ctypes.c_size_t, [pattern]),
        ("factorise", ctypes.c_int, [pattern, number, number, reals, reals, reals]),
        ("solve", None, [pattern, reals, reals]),
    ]:
        getattr(lib, name).restype, getattr(lib, name).argtypes = result, arguments
    return lib


@pytest.fixture(scope="session")
def libraries(library, complex_library):
    return library, complex_library


class Complex(Pattern):
    """A pattern and the complex solver on it; systems are given as (mu, Jq, Jv) with real blocks (count, D, D)."""

    def __init__(self, libraries, n, D, couples):
        super().__init__(libraries[0], n, D, couples)
        self.complex = libraries[1]

    def factorise(self, mu, Jq, Jv):
        """The factor, None where it is refused.  Nothing that was in its place before may matter."""
        size = self.complex.factor_size(self.handle)
        factor = self.guarded(np.full(size, np.nan))
        done = self.complex.factorise(self.handle, mu.real, mu.imag, Jq, Jv, factor)
        return self.unguarded(factor, size) if done else None

    def solve(self, factor, b):
        x = self.guarded(np.ascontiguousarray(b, complex).view(float))
        self.complex.solve(self.handle, factor, x)
        return self.unguarded(x, 2 * np.size(b)).view(complex)

    def matrix(self, mu, Jq, Jv):
        """(n D, n D) W."""
        return mu**2 * np.eye(self.n * self.D) - mu * self.dense(Jv) - self.dense(Jq)

    def system(self, mu, W):
        """(mu, Jq, Jv) for given complex blocks W: one complex equation for two real unknowns."""
        W = np.asarray(W)
        Jv = (self.identity((mu**2).imag) - W.imag) / mu.imag
        return mu, self.identity((mu**2).real) - mu.real * Jv - W.real, Jv

    def vector(self, rng):
        return rng.standard_normal(self.n * self.D) + 1j * rng.standard_normal(self.n * self.D)

    def oscillators(self, rng, stiffness, damping):
        """Jq (1/s^2) and Jv (1/s) of masses on soft springs of their own, coupled by damped strings under some tension."""
        index = {block: k for k, block in enumerate(zip(self.rows, self.column, strict=True))}
        K, C = self.identity(rng.uniform(0.0, 10.0, self.n)), self.identity(rng.uniform(0.0, 0.1, self.n))
        for i, j in index:
            if i >= j:
                continue
            direction = rng.standard_normal(self.D)
            along = np.outer(direction, direction) / (direction @ direction)
            k = along + rng.uniform(0.0, 0.01) * (np.eye(self.D) - along)
            k *= stiffness * 10.0 ** rng.uniform(-1.0, 1.0)
            for block, sign in (((i, i), 1), ((j, j), 1), ((i, j), -1), ((j, i), -1)):
                K[index[block]] += sign * k
                C[index[block]] += sign * damping * along
        per_mass = 1.0 / rng.uniform(0.1, 5.0, self.n)[self.rows, None, None]
        return -per_mass * K, -per_mass * C


def check(p, factor, W, rng, bound=10.0):
    """Small backward error, so that the error of x is no larger than rounding W alone would make it."""
    assert factor is not None
    b = p.vector(rng)
    x = p.solve(factor, b)
    assert np.linalg.norm(W @ x - b) <= bound * EPS * np.linalg.norm(W) * np.linalg.norm(x)
    return b, x


@EACH_GRAPH
@DIMENSIONS
@pytest.mark.parametrize("mu_h", MU_H)
def test_radau_systems(libraries, graph, D, mu_h):
    p, rng = Complex(libraries, graph[0], D, graph[1]), np.random.default_rng(5)
    for stiffness, damping in ((1e2, 0.1), (1e5, 30.0), (1e9, 1e4)):
        Jq, Jv = p.oscillators(rng, stiffness, damping)
        for h in 10.0 ** np.arange(-7.0, 1.0):
            W = p.matrix(mu_h / h, Jq, Jv)
            b, x = check(p, p.factorise(mu_h / h, Jq, Jv), W, rng)
        inverse = np.linalg.inv(W)  # of the longest step, whose condition is the worst
        error = np.linalg.norm(x - inverse @ b)
        assert error <= 20.0 * EPS * np.linalg.norm(inverse) * np.linalg.norm(W) * np.linalg.norm(x)


@settings(max_examples=100, deadline=None)
@given(drawn=SOME_GRAPH, mu_h=st.sampled_from(MU_H), h=st.floats(-7.0, 0.0), stiffness=st.floats(0.0, 10.0))
def test_random_radau_systems_are_never_refused(libraries, drawn, mu_h, h, stiffness):
    n, density, D, seed = drawn
    rng = np.random.default_rng(seed)
    p, mu = Complex(libraries, n, D, rng.integers(0, n, (int(density * n), 2))), mu_h / 10.0**h
    Jq, Jv = p.oscillators(rng, 10.0**stiffness, 10.0 ** (stiffness / 2.0 - 2.0))
    check(p, p.factorise(mu, Jq, Jv), p.matrix(mu, Jq, Jv), rng)


@DIMENSIONS
def test_a_factor_serves_any_number_of_right_hand_sides(libraries, D):
    p, rng = Complex(libraries, 45, D, tower(5, 9)), np.random.default_rng(1)
    Jq, Jv = p.oscillators(rng, 1e4, 3.0)
    W, factor = p.matrix(MU_H[0] / 1e-2, Jq, Jv), p.factorise(MU_H[0] / 1e-2, Jq, Jv)
    kept = factor.copy()
    first, x = check(p, factor, W, rng)
    check(p, factor, W, rng)
    np.testing.assert_array_equal(p.solve(factor, first), x)
    np.testing.assert_array_equal(factor, kept)


@EACH_GRAPH
@DIMENSIONS
def test_real_mu_gives_what_the_real_solver_gives(libraries, graph, D):
    p, real = Complex(libraries, graph[0], D, graph[1]), Pattern(libraries[0], graph[0], D, graph[1])
    rng = np.random.default_rng(2)
    Jq, Jv = p.oscillators(rng, 1e3, 1.0)
    b = p.vector(rng)
    x, factor = p.solve(p.factorise(50.0 + 0.0j, Jq, Jv), b), real.factorise((50.0, Jq, Jv))
    expected = real.solve(factor, b.real) + 1j * real.solve(factor, b.imag)
    np.testing.assert_allclose(x, expected, rtol=0.0, atol=1e-13 * np.abs(expected).max())


@EACH_GRAPH
def test_conjugate_mu_gives_the_conjugate_solution(libraries, graph):
    p, rng = Complex(libraries, graph[0], 3, graph[1]), np.random.default_rng(3)
    (Jq, Jv), b = p.oscillators(rng, 1e3, 1.0), p.vector(rng)
    x = p.solve(p.factorise(MU_H[1], Jq, Jv), b)
    np.testing.assert_array_equal(p.solve(p.factorise(MU_H[1].conjugate(), Jq, Jv), b.conj()), x.conj())


@DIMENSIONS
@pytest.mark.parametrize(("main", "rest"), [(1.0, 1.0j), (1.0j, 1.0)])
def test_rows_are_exchanged_inside_a_block(libraries, D, main, rest):
    """Every order of pivots: diagonal blocks that are turned identities but for a little, which is real where the identity
    is imaginary and the other way round.  One row of each pair is eliminated before anything is subtracted from it."""
    turns = np.repeat([np.eye(D)[list(turn)] for turn in permutations(range(D))], 2, axis=0)
    n, rng = len(turns), np.random.default_rng(4)
    p = Complex(libraries, n, D, [(i, i + 1) for i in range(0, n, 2)])
    W = 0.1 * (p.random(rng) + 1j * p.random(rng))
    W[p.rows == p.column] = main * turns + 1e-9 * rest * rng.standard_normal((n, D, D))
    system = p.system(1.0j, W)
    check(p, p.factorise(*system), p.matrix(*system), rng)


@DIMENSIONS
@pytest.mark.parametrize("stiffness", [1e4, 1e8, 1e12])
def test_stiff_direction_costs_its_condition_and_not_the_square_of_it(libraries, D, stiffness):
    """A string between two masses that is far stiffer than the step is short."""
    p, rng = Complex(libraries, 2, D, [(0, 1)]), np.random.default_rng(6)
    for _ in range(20):
        direction = rng.standard_normal(D)
        spring = stiffness * np.outer(direction, direction)
        Jq = np.array([-spring, spring, spring, -spring])
        Jv = 1e-3 / np.sqrt(stiffness) * Jq
        check(p, p.factorise(MU_H[0], Jq, Jv), p.matrix(MU_H[0], Jq, Jv), rng, bound=4.0)


@DIMENSIONS
@pytest.mark.parametrize("mu", MU_H)
def test_stiff_systems_are_accepted_up_to_a_condition_of_1e13(libraries, D, mu):
    """A string along every kind of direction and else nothing but inertia: W / mu^2 has eigenvalues of 1 and about 9e12."""
    p, rng = Complex(libraries, 2, D, [(0, 1)]), np.random.default_rng(9)
    for _ in range(200):
        direction = rng.standard_normal(D)
        spring = 9e12 / 2.0 * abs(mu) ** 2 * np.outer(direction, direction) / (direction @ direction)
        Jq = np.array([-spring, spring, spring, -spring])
        W = p.matrix(mu, Jq, 0.0 * Jq)
        check(p, p.factorise(mu, Jq, 0.0 * Jq), W, rng, bound=4.0)


@settings(max_examples=200, deadline=None)
@given(drawn=SOME_GRAPH, row=st.integers(0, 24), distance=st.floats(0.0, 18.0))
def test_a_factor_is_accurate_or_refused(libraries, drawn, row, distance):
    """Systems of no special kind, one diagonal block of which is singular but for 10^-distance."""
    n, density, D, seed = drawn
    rng = np.random.default_rng(seed)
    p = Complex(libraries, n, D, rng.integers(0, n, (int(density * n), 2)))
    W = p.random(rng) + 1j * p.random(rng)
    left, right = (np.linalg.qr(rng.standard_normal((D, D)) + 1j * rng.standard_normal((D, D)))[0] for _ in range(2))
    block = p.lib.find(p.handle, row % n, row % n)
    W[block] = left @ np.diag([10.0**-distance] + [1.0] * (D - 1)) @ right
    system = p.system(MU_H[1], W)
    factor = p.factorise(*system)
    if factor is None:
        assert distance > 2.0
    else:
        check(p, factor, p.matrix(*system), rng, bound=1e12)


@DIMENSIONS
@PIVOTS
def test_growth_is_refused(libraries, D, small, accepted):
    """i [[small, 1], [1, 1]] is well conditioned, but eliminating its first row wipes out the second."""
    p = Complex(libraries, 2, D, [(0, 1)])
    system = p.system(1j, 1j * np.array([small, 1.0, 1.0, 1.0])[:, None, None] * np.eye(D))
    factor = p.factorise(*system)
    assert (factor is not None) == accepted
    if accepted:
        check(p, factor, p.matrix(*system), np.random.default_rng(0), bound=1e4)


@EACH_GRAPH
@DIMENSIONS
def test_singular_systems_are_refused(libraries, graph, D):
    p = Complex(libraries, graph[0], D, graph[1])
    laplace = p.laplace()
    zero = np.zeros_like(laplace)
    assert p.factorise(0j, laplace, zero) is None
    assert p.factorise(0j, zero, zero) is None
    assert p.factorise(3.0 + 4.0j, -25.0 * p.identity(), 6.0 * p.identity()) is None  # mu is an eigenvalue
    assert p.factorise(3.0 + 4.0j, -25.0 * p.identity(), 7.0 * p.identity()) is not None


@NOT_FINITE
@DIMENSIONS
def test_numbers_that_are_not_finite_are_refused_wherever_they_stand(libraries, D, number):
    p = Complex(libraries, 5, D, [*path(5), (0, 3)])
    assert p.factorise(7.0 + 3.0j, p.full(), p.identity()) is not None
    for A in p.spoilt(number):
        assert p.factorise(7.0 + 3.0j, A, p.identity()) is None
        assert p.factorise(7.0 + 3.0j, p.identity(), A) is None
    for mu in (complex(number, 1.0), complex(1.0, number)):
        assert p.factorise(mu, p.identity(), p.identity()) is None


@DIMENSIONS
@pytest.mark.parametrize("exponent", [-300, -160, -135, -50, 50, 135, 160, 300])
def test_numbers_near_the_ends_of_their_range_are_solved_or_refused(libraries, D, exponent):
    p, rng = Complex(libraries, 3, D, list(combinations(range(3), 2))), np.random.default_rng(7)
    scale = 10.0**exponent
    Jq, zero = p.oscillators(rng, 10.0, 0.0)
    factor = p.factorise(0j, scale * Jq, np.zeros_like(zero))
    assert factor is not None or abs(exponent) > 135
    if factor is not None:
        b = p.vector(rng)
        x = p.solve(factor, scale * b)
        assert np.linalg.norm(p.dense(-Jq) @ x - b) <= 10.0 * EPS * np.linalg.norm(p.dense(Jq)) * np.linalg.norm(x)


def test_arrays_need_no_alignment(libraries):
    """Arrays that start 8 bytes beside what pairs of numbers would like."""
    p, rng = Complex(libraries, 3, 3, list(combinations(range(3), 2))), np.random.default_rng(8)
    (Jq, Jv), b = p.oscillators(rng, 1e4, 3.0), p.vector(rng)
    expected = p.solve(p.factorise(MU_H[0], Jq, Jv), b)
    at = [beside(part) for part in (Jq, Jv, np.zeros(p.complex.factor_size(p.handle)), b.view(float))]
    assert p.complex.factorise(p.handle, MU_H[0].real, MU_H[0].imag, *at[:3]) == 1
    p.complex.solve(p.handle, *at[2:])
    np.testing.assert_array_equal(at[3].view(complex), expected)


def beside(array):
    """A copy whose address is no multiple of 16."""
    room = np.empty(array.size + 2)
    start = 0 if room.ctypes.data % 16 == 8 else 1
    room[start : start + array.size] = array.ravel()
    copy = room[start : start + array.size].reshape(array.shape)
    assert copy.ctypes.data % 16 == 8
    return copy
