"""The complex block-sparse solver of the kernel against dense NumPy, on the systems that an implicit Radau step has."""

from __future__ import annotations

import ctypes
import subprocess
import sys
from ctypes import POINTER, c_double, c_int, c_int32, c_size_t, c_void_p
from pathlib import Path

import numpy as np
import pytest

NATIVE = Path(__file__).resolve().parents[1] / "tensegrity_core" / "native"
#: mu h of the two conjugate pairs of Radau IIA of order 9.
MU_H = (3.655694325463572 + 6.543736899360077j, 5.700953298671789 + 3.210265600308550j)
GUARD = 1.2345678e-77  # stands behind arrays, where the solver must not write


class Pattern(ctypes.Structure):
    """ts_pattern of blocks.h."""

    _fields_ = [(name, c_int32) for name in ("n", "D", "count", "entries")] + [
        (name, POINTER(c_int32)) for name in ("row", "column", "order", "diagonal", "end", "entry", "fill_first", "fill")
    ] + [("memory", c_void_p)]


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """Both solvers in a library that shows their functions; the kernel's own hides them."""
    sys.path.insert(0, str(NATIVE))
    try:
        import build
    finally:
        sys.path.remove(str(NATIVE))
    target = tmp_path_factory.mktemp("complex_blocks") / build.LIBRARY
    command = build.system_compiler() or [sys.executable, "-m", "ziglang", "cc"]
    flags = [flag for flag in build.FLAGS if not flag.startswith("-fvisibility")] + ["-Wall", "-Wextra", "-pedantic", "-Werror"]
    sources = [str(NATIVE / name) for name in ("blocks.c", "complex_blocks.c")]
    extra = [] if sys.platform == "win32" else ["-fPIC", "-lm"]
    done = subprocess.run([*command, *flags, *sources, *extra, "-o", str(target)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    lib = ctypes.CDLL(str(target))
    numbers, pattern = POINTER(c_double), POINTER(Pattern)
    for name, result, arguments in (
        ("ts_pattern_make", c_int, [pattern, c_int32, c_int32, POINTER(c_int32), c_size_t]),
        ("ts_pattern_free", None, [pattern]),
        ("ts_pattern_factor_size", c_size_t, [pattern]),
        ("ts_blocks_factorise", c_int, [pattern, c_double, numbers, numbers, numbers]),
        ("ts_blocks_solve", None, [pattern, numbers, numbers]),
        ("ts_complex_factor_size", c_size_t, [pattern]),
        ("ts_complex_factorise", c_int, [pattern, c_double, c_double, numbers, numbers, numbers]),
        ("ts_complex_solve", None, [pattern, numbers, numbers]),
    ):
        function = getattr(lib, name)
        function.restype, function.argtypes = result, arguments
    return lib


def address(array: np.ndarray):
    return array.ctypes.data_as(POINTER(c_double))


class System:
    """Block patterns and their solver; matrices go in dense, (n D, n D), and must fit the pattern."""

    def __init__(self, library, n: int, D: int, couples):
        self.library, self.n, self.D, self.pattern = library, n, D, Pattern()
        self.couples = np.ascontiguousarray(couples, dtype=np.int32).reshape(-1, 2)
        made = library.ts_pattern_make(
            self.pattern, n, D, self.couples.ctypes.data_as(POINTER(c_int32)), len(self.couples)
        )
        assert made == 1

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.library.ts_pattern_free(self.pattern)

    def blocks(self, dense: np.ndarray) -> np.ndarray:
        """(count, D, D) blocks in the pattern's order; all that is outside them must be zero."""
        p, D, rest = self.pattern, self.D, dense.copy()
        found = np.empty((p.count, D, D))
        for i in range(self.n):
            for m in range(p.row[i], p.row[i + 1]):
                place = np.s_[i * D : (i + 1) * D, p.column[m] * D : (p.column[m] + 1) * D]
                found[m] = dense[place]
                rest[place] = 0.0
        assert not rest.any()
        return found

    def factorise(self, mu: complex, Jq: np.ndarray, Jv: np.ndarray) -> np.ndarray | None:
        """The factor; None where the solver refuses."""
        size = self.library.ts_complex_factor_size(self.pattern)
        factor = np.full(size + 2, np.nan)  # work space must not be read before it is written
        factor[size:] = GUARD
        done = self.library.ts_complex_factorise(
            self.pattern, mu.real, mu.imag, address(self.blocks(Jq)), address(self.blocks(Jv)), address(factor)
        )
        assert (factor[size:] == GUARD).all()
        return factor if done else None

    def solve(self, factor: np.ndarray, b: np.ndarray) -> np.ndarray:
        x = np.append(b, [GUARD + 1j * GUARD])
        self.library.ts_complex_solve(self.pattern, address(factor), address(x))
        assert x[-1] == GUARD + 1j * GUARD
        return x[:-1]


def path(n):
    return [(i, i + 1) for i in range(n - 1)]


def tower(n, per_stage=3):
    """Each block is coupled with all of its stage and of the next one."""
    return [(i, j) for i in range(n) for j in range(i) if i // per_stage - j // per_stage <= 1]


def dense(n):
    return [(i, j) for i in range(n) for j in range(i)]


def scattered(n):
    rng = np.random.default_rng(n)
    return rng.integers(0, n, (2 * n, 2))


def two_parts(n):
    """Two rings without a connection, and one block on its own."""
    half = n // 2
    return [(i, (i + 1) % half) for i in range(half)] + [(i, i + 1) for i in range(half, n - 2)]


PATTERNS = {
    "one": (1, dense), "pair": (2, dense), "three": (3, dense), "nine": (9, dense), "path": (40, path),
    "tower": (45, tower), "scattered": (30, scattered), "two parts": (13, two_parts), "star": (20, lambda n: [(0, i) for i in range(n)]),
    "unconnected": (5, lambda n: []),
}  # fmt: skip


def oscillators(rng, n: int, D: int, couples, stiffness=1e4, damping=3.0):
    """Jq, Jv (1/s^2, 1/s) of masses on damped springs, some of them under tension, and each on a spring of its own."""
    K, C = np.zeros((2, n * D, n * D))
    ends = [(i, None) for i in range(n)] + [(int(i), int(j)) for i, j in couples if i != j]
    for i, j in ends:
        direction = rng.normal(size=D)
        along = np.outer(direction, direction) / (direction @ direction)
        k = stiffness * 10.0 ** rng.uniform(-1, 1) * (along + rng.uniform(0.0, 0.2) * (np.eye(D) - along))
        c = damping * rng.uniform(0.1, 2.0) * along
        parts = [(i, 1.0)] + ([] if j is None else [(j, -1.0)])
        for a, sign_a in parts:
            for b, sign_b in parts:
                K[a * D : (a + 1) * D, b * D : (b + 1) * D] += sign_a * sign_b * k
                C[a * D : (a + 1) * D, b * D : (b + 1) * D] += sign_a * sign_b * c
    inverse_mass = np.repeat(1.0 / rng.uniform(0.1, 5.0, n), D)[:, None]
    return -inverse_mass * K, -inverse_mass * C


def dense_matrix(mu, Jq, Jv):
    return mu**2 * np.eye(len(Jq)) - mu * Jv - Jq


def complex_vector(rng, size):
    return rng.normal(size=size) + 1j * rng.normal(size=size)


def backward_error(W, x, b):
    """Residual of each row against the largest that rounding of its terms could leave at 1 unit."""
    return np.max(np.abs(W @ x - b) / (np.abs(W) @ np.abs(x) + np.abs(b)))


@pytest.mark.parametrize("D", [2, 3])
@pytest.mark.parametrize("name", PATTERNS)
def test_radau_systems(library, name, D):
    n, couples = PATTERNS[name][0], PATTERNS[name][1](PATTERNS[name][0])
    rng = np.random.default_rng(n + D)
    with System(library, n, D, couples) as system:
        for stiffness, damping in ((1e2, 0.1), (1e5, 30.0), (1e8, 1e4)):
            Jq, Jv = oscillators(rng, n, D, couples, stiffness, damping)
            for h in 10.0 ** np.arange(-7, 1):
                for mu_h in MU_H:
                    W, b = dense_matrix(mu_h / h, Jq, Jv), complex_vector(rng, n * D)
                    factor = system.factorise(mu_h / h, Jq, Jv)
                    assert factor is not None
                    x = system.solve(factor, b)
                    assert backward_error(W, x, b) < 1e-13
                    exact = np.linalg.solve(W, b)
                    bound = 1e-14 * np.linalg.cond(W)
                    assert np.linalg.norm(x - exact) <= bound * np.linalg.norm(exact)
                    again = system.solve(factor, W @ exact)  # a factor serves any number of right-hand sides
                    assert np.linalg.norm(again - exact) <= bound * np.linalg.norm(exact)


@pytest.mark.parametrize("D", [2, 3])
def test_real_shift_equals_real_solver(library, D):
    n, couples = 12, tower(12)
    rng = np.random.default_rng(D)
    Jq, Jv = oscillators(rng, n, D, couples)
    with System(library, n, D, couples) as system:
        b = complex_vector(rng, n * D)
        x = system.solve(system.factorise(150.0 + 0.0j, Jq, Jv), b)
        real = np.empty(library.ts_pattern_factor_size(system.pattern))
        matrices = address(system.blocks(Jq)), address(system.blocks(Jv))
        assert library.ts_blocks_factorise(system.pattern, 150.0, *matrices, address(real)) == 1
        for ours, part in ((x.real, b.real.copy()), (x.imag, b.imag.copy())):
            library.ts_blocks_solve(system.pattern, address(real), address(part))
            np.testing.assert_allclose(ours, part, rtol=0, atol=1e-13 * np.abs(part).max())


@pytest.mark.parametrize("D", [2, 3])
@pytest.mark.parametrize("row", [0, 1, 2])
def test_pivots_inside_a_block(library, D, row):
    """A diagonal block whose first column is zero but for one row, which elimination without pivoting cannot start from."""
    if row >= D:
        pytest.skip("the block has no such row")
    rng = np.random.default_rng(row)
    mu = MU_H[0]
    A = complex_vector(rng, (D, D))
    A[np.arange(D) != row, 0] = 0.0
    # Real Jq and Jv for which W is this A: two unknown real matrices, one complex equation.
    Jv = np.imag(mu**2 * np.eye(D) - A) / mu.imag
    Jq = np.real(mu**2 * np.eye(D) - mu * Jv - A)
    W, b = dense_matrix(mu, Jq, Jv), complex_vector(rng, D)
    with System(library, 1, D, []) as system:
        x = system.solve(system.factorise(mu, Jq, Jv), b)
    np.testing.assert_allclose(x, np.linalg.solve(A, b), rtol=0, atol=1e-13 * np.linalg.cond(A) * np.abs(x).max())
    assert backward_error(W, x, b) < 1e-13


@pytest.mark.parametrize("D", [2, 3])
def test_stiff_direction_keeps_digits(library, D):
    """One direction 1e10 times stiffer than the others, at an angle: what the soft ones need must survive."""
    rng = np.random.default_rng(7)
    for _ in range(50):
        axis = rng.normal(size=D)
        Jq = -1e10 * np.outer(axis, axis) / (axis @ axis) - np.diag(rng.uniform(0.5, 2.0, D))
        W, b = dense_matrix(MU_H[1], Jq, np.zeros((D, D))), complex_vector(rng, D)
        with System(library, 1, D, []) as system:
            x = system.solve(system.factorise(MU_H[1], Jq, np.zeros((D, D))), b)
        exact = np.linalg.solve(W, b)
        assert np.linalg.norm(x - exact) < 1e-15 * np.linalg.cond(W) * np.linalg.norm(exact)


@pytest.mark.parametrize("D", [2, 3])
def test_refuses(library, D):
    n, couples = 3, dense(3)
    rng = np.random.default_rng(D)
    Jq, Jv = oscillators(rng, n, D, couples)
    zero = np.zeros_like(Jq)
    mu = MU_H[0]
    with System(library, n, D, couples) as system:
        assert system.factorise(mu, Jq, Jv) is not None
        assert system.factorise(0j, zero, zero) is None
        for bad in (np.nan, np.inf, -np.inf):
            for matrix in (Jq, Jv):
                for place in ((0, 0), (n * D - 1, n * D - 1), (0, n * D - 1), (n * D - 1, 0)):
                    kept = matrix[place]
                    matrix[place] = bad
                    assert system.factorise(mu, Jq, Jv) is None, (bad, place)
                    matrix[place] = kept
            assert system.factorise(complex(bad, 1.0), Jq, Jv) is None
            assert system.factorise(complex(1.0, bad), Jq, Jv) is None
        for scale in (1e100, 1e160, 1e200, 1e-120, 1e-180):  # finite, but products leave the range of numbers
            solved = system.factorise(0j, scale * Jq, zero)
            if solved is not None:
                b = complex_vector(rng, n * D)
                assert backward_error(-scale * Jq, system.solve(solved, b), b) < 1e-13
        singular = Jq.copy()
        singular[:D], singular[:, :D] = 0.0, 0.0
        assert system.factorise(0j, singular, zero) is None


@pytest.mark.parametrize("D", [2, 3])
def test_refuses_a_pivot_block_that_loses_all_digits(library, D):
    """W is regular, but its first pivot block nearly singular: elimination without pivoting between blocks is useless."""
    tiny = 1e-15
    mu = MU_H[0]
    Jv = np.zeros((2 * D, 2 * D))
    Jq = mu.real * 0.0 + np.kron([[tiny, 1.0], [1.0, tiny]], np.eye(D))
    with System(library, 2, D, [(0, 1)]) as system:
        assert np.linalg.cond(Jq) < 1.1
        assert system.factorise(0j, Jq, Jv) is None
        Jq = np.kron([[1e-3, 1.0], [1.0, 1e-3]], np.eye(D))  # some digits less, but usable
        factor = system.factorise(0j, Jq, Jv)
        b = complex_vector(np.random.default_rng(0), 2 * D)
        np.testing.assert_allclose(system.solve(factor, b), np.linalg.solve(-Jq, b), rtol=0, atol=1e-9)


def test_arrays_need_no_alignment(library):
    """Arrays that start 8 bytes beside what pairs would like."""
    rng = np.random.default_rng(3)
    Jq, Jv = oscillators(rng, 3, 3, dense(3))
    mu, b = MU_H[0] / 1e-3, complex_vector(rng, 9)
    with System(library, 3, 3, dense(3)) as system:
        aligned = system.solve(system.factorise(mu, Jq, Jv), b)
        q, v, x = (np.append(0.0, a)[1:] for a in (system.blocks(Jq), system.blocks(Jv), b.view(float)))
        factor = np.empty(library.ts_complex_factor_size(system.pattern) + 1)[1:]
        assert {a.ctypes.data % 16 for a in (q, v, x, factor)} == {8}
        assert library.ts_complex_factorise(system.pattern, mu.real, mu.imag, address(q), address(v), address(factor)) == 1
        library.ts_complex_solve(system.pattern, address(factor), address(x))
        assert (x == aligned.view(float)).all()
