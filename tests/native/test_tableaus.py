"""The coefficients of the integrators satisfy their order conditions, tree by tree."""

import re
from functools import cache
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
import pytest

import tensegrity_core

NATIVE = Path(tensegrity_core.__file__).parent / "native"


def arrays(header: str) -> dict[str, np.ndarray]:
    """The constant arrays of a tableau header, by name."""
    text = re.sub(r"/\*.*?\*/", "", (NATIVE / "methods" / header).read_text(encoding="utf-8"), flags=re.DOTALL)
    found = {}
    for name, dims, body in re.findall(r"static const double (\w+)((?:\[\d+\])*) = (.*?);", text, flags=re.DOTALL):
        shape = [int(n) for n in re.findall(r"\d+", dims)]
        numbers = [float(x) for x in re.findall(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?", body)]
        found[name] = np.array(numbers).reshape(shape) if shape else np.array(numbers[0])
    return found


@cache
def trees(order: int) -> tuple:
    """All rooted trees with `order` nodes, each the sorted tuple of its subtrees."""
    if order == 1:
        return ((),)
    found = set()

    def split(left, largest, chosen):
        if left == 0:
            found.add(tuple(sorted(chosen)))
        for size in range(min(left, largest), 0, -1):
            for count in range(1, left // size + 1):
                for group in combinations_with_replacement(trees(size), count):
                    split(left - size * count, size - 1, chosen + list(group))

    split(order - 1, order - 1, [])
    return tuple(sorted(found))


def size(tree) -> int:
    return 1 + sum(size(t) for t in tree)


def density(tree) -> int:
    product = size(tree)
    for t in tree:
        product *= density(t)
    return product


def stage_weights(tree, alpha, beta):
    """Elementary weights per stage; Rosenbrock methods use beta below a node with one branch, alpha elsewhere."""
    weight = np.ones(len(alpha))
    matrix = beta if len(tree) == 1 else alpha
    for t in tree:
        weight = weight * (matrix @ stage_weights(t, alpha, beta))
    return weight


def worst_condition(b, alpha, beta, order):
    return max(abs(b @ stage_weights(t, alpha, beta) - 1.0 / density(t)) for n in range(1, order + 1) for t in trees(n))


def rodas5p():
    t = arrays("rodas5p_tableau.h")
    gamma = float(t["GAMMA"])
    Gamma = np.linalg.inv(np.eye(8) / gamma - t["C"])
    alpha = t["A"] @ Gamma
    return t, gamma, Gamma, alpha


def test_number_of_trees():
    assert [len(trees(n)) for n in range(1, 9)] == [1, 1, 2, 4, 9, 20, 48, 115]


def test_dop853_has_order_8():
    t = arrays("dop853_tableau.h")
    A, b = t["A"][:12, :12], t["A"][12, :12]
    assert worst_condition(b, A, A, 8) < 1e-13
    assert worst_condition(b, A, A, 9) > 1e-8
    np.testing.assert_allclose(t["A"].sum(axis=1), t["C"], atol=2e-13)


@pytest.mark.parametrize("name, order", [("E5", 5), ("E3", 3)])
def test_dop853_error_estimates_vanish_up_to_their_order(name, order):
    t = arrays("dop853_tableau.h")
    A, e = t["A"][:12, :12], t[name][:12]
    errors = [abs(e @ stage_weights(s, A, A)) for n in range(1, order + 1) for s in trees(n)]
    assert max(errors) < 1e-13
    assert max(abs(e @ stage_weights(s, A, A)) for s in trees(order + 1)) > 1e-6


@pytest.mark.parametrize("theta", [0.1, 0.5, 0.83])
def test_dop853_dense_output_has_order_7(theta):
    t = arrays("dop853_tableau.h")
    A, n = t["A"], 16
    b, first, last = A[12], np.eye(n)[0], np.eye(n)[12]
    F = [b, first - b, 2 * b - (last + first), *t["DENSE"]]
    weights = np.zeros(n)
    for i, row in enumerate(reversed(F)):  # nested as in dop853.c
        weights = (weights + row) * (theta if i % 2 == 0 else 1 - theta)
    errors = [abs(weights @ stage_weights(s, A, A) - theta ** size(s) / density(s)) for k in range(1, 8) for s in trees(k)]
    assert max(errors) < 1e-13


def test_dopri5_has_order_5_and_its_last_stage_is_the_next_steps_first():
    t = arrays("dopri5_tableau.h")
    A = t["A"]
    assert worst_condition(A[6], A, A, 5) < 1e-14
    assert worst_condition(A[6], A, A, 6) > 1e-5
    np.testing.assert_allclose(A.sum(axis=1), t["C"], atol=1e-14)
    assert t["C"][6] == 1.0


def test_dopri5s_error_estimate_vanishes_up_to_order_4():
    t = arrays("dopri5_tableau.h")
    A, e = t["A"], t["E"]
    assert max(abs(e @ stage_weights(s, A, A)) for n in range(1, 5) for s in trees(n)) < 1e-14
    assert max(abs(e @ stage_weights(s, A, A)) for s in trees(5)) > 1e-4


@pytest.mark.parametrize("theta", [0.1, 0.5, 0.83])
def test_dopri5s_dense_output_has_order_4(theta):
    t = arrays("dopri5_tableau.h")
    A, n = t["A"], 7
    b, first, last = A[6], np.eye(n)[0], np.eye(n)[6]
    rest = 1 - theta  # nested as in dopri5.c
    weights = theta * (b + rest * (first - b + theta * (2 * b - last - first + rest * t["DENSE"])))
    errors = [abs(weights @ stage_weights(s, A, A) - theta ** size(s) / density(s)) for k in range(1, 5) for s in trees(k)]
    assert max(errors) < 1e-14


def test_rodas5p_has_order_5_and_its_estimate_order_4():
    t, _gamma, Gamma, alpha = rodas5p()
    beta = alpha + Gamma
    last = np.eye(8)[7]
    m = t["A"][7] + last
    assert worst_condition(m @ Gamma, alpha, beta, 5) < 1e-12
    assert worst_condition(m @ Gamma, alpha, beta, 6) > 1e-6
    assert worst_condition(t["A"][7] @ Gamma, alpha, beta, 4) < 1e-12
    np.testing.assert_allclose(alpha.sum(axis=1), t["ALPHA"], atol=1e-12)
    np.testing.assert_allclose(Gamma.sum(axis=1), t["D"], atol=1e-12)


@pytest.mark.parametrize("theta", [0.1, 0.5, 0.83])
def test_rodas5p_dense_output_has_order_4(theta):
    t, _gamma, Gamma, alpha = rodas5p()
    m = t["A"][7] + np.eye(8)[7]
    h = t["H"]
    weights = theta * (m + (1 - theta) * (h[0] + theta * (h[1] + theta * h[2])))
    b = weights @ Gamma
    errors = [
        abs(b @ stage_weights(s, alpha, alpha + Gamma) - theta ** size(s) / density(s)) for k in range(1, 5) for s in trees(k)
    ]
    assert max(errors) < 1e-12


def test_rodas5p_is_stiffly_accurate_and_l_stable():
    t, _gamma, Gamma, alpha = rodas5p()
    beta, m = alpha + Gamma, t["A"][7] + np.eye(8)[7]
    b = m @ Gamma
    np.testing.assert_allclose(b, beta[7], atol=1e-12)  # stiffly accurate: R(infinity) = 0

    def R(z):
        return 1 + z * (b @ np.linalg.solve(np.eye(8) - z * beta, np.ones(8)))

    assert abs(R(-1e8)) < 1e-6
    y = np.concatenate([np.linspace(0.01, 20, 400), np.logspace(1.3, 6, 200)])
    assert max(abs(R(1j * v)) for v in y) <= 1.0 + 1e-10  # A-stable: bounded on the imaginary axis, poles in the right half


def test_rk4_has_order_4():
    t = arrays("rk4_tableau.h")
    A, b = t["A"][:4], t["A"][4]
    assert worst_condition(b, A, A, 4) < 1e-15
    assert worst_condition(b, A, A, 5) > 1e-3
    np.testing.assert_allclose(t["A"].sum(axis=1), t["C"], atol=1e-15)


def ros2(which):
    t = arrays("ros2_tableau.h")
    lower = np.array([[0.0, 0.0], [1.0, 0.0]])
    Gamma = np.linalg.inv(np.eye(2) / t["GAMMA"][which] - t["C"][which][0] * lower)
    return t, Gamma, t["A"][which][0] * lower @ Gamma, t["M"][which] @ Gamma


@pytest.mark.parametrize("which", [0, 1])
def test_ros2_has_order_2_with_any_matrix_in_the_place_of_the_jacobian(which):
    t, Gamma, alpha, b = ros2(which)
    one = np.ones(2)
    assert worst_condition(b, alpha, alpha + Gamma, 2) < 1e-14
    assert worst_condition(b, alpha, alpha + Gamma, 3) > 1e-3
    assert abs(b @ alpha @ one - 0.5) < 1e-14  # the two parts of the second condition, each for itself
    assert abs(b @ Gamma @ one) < 1e-14
    np.testing.assert_allclose(alpha.sum(axis=1), [0.0, float(t["ALPHA"])], atol=1e-14)


@pytest.mark.parametrize("which", [0, 1])
def test_ros2_is_l_stable(which):
    _t, Gamma, alpha, b = ros2(which)

    def R(z):
        return 1 + z * (b @ np.linalg.solve(np.eye(2) - z * (alpha + Gamma), np.ones(2)))

    assert abs(R(-1e8)) < 1e-6
    y = np.concatenate([np.linspace(0.01, 20, 400), np.logspace(1.3, 6, 200)])
    assert max(abs(R(1j * v)) for v in y) <= 1.0 + 1e-10


def test_ros2s_damping_coefficient_errs_34_times_as_much():
    """The factor that docs/methods.md and the tableau give: of the z^3 that the stability functions miss in exp(z)."""

    def missing(which):
        _, Gamma, alpha, b = ros2(which)
        beta = alpha + Gamma
        return 1.0 / 6.0 - b @ beta @ beta @ np.ones(2)

    assert abs(missing(1) / missing(0)) == pytest.approx(34.0, abs=0.5)


def test_radau9_has_order_9():
    t = arrays("radau9_tableau.h")
    A, c = t["A"], t["C"]
    assert worst_condition(A[4], A, A, 9) < 1e-14
    assert worst_condition(A[4], A, A, 10) > 1e-8
    for k in range(1, 6):  # collocation
        np.testing.assert_allclose(A @ c ** (k - 1), c**k / k, atol=1e-14)


def test_radau9s_arrays_belong_together():
    t = arrays("radau9_tableau.h")
    A, c, T, TI = t["A"], t["C"], t["T"], t["TI"]
    L = np.zeros((5, 5))
    L[0, 0] = t["GAMMA"]
    for k, (a, b) in enumerate(t["MU"]):
        L[1 + 2 * k : 3 + 2 * k, 1 + 2 * k : 3 + 2 * k] = [[a, b], [-b, a]]
    np.testing.assert_allclose(T @ TI, np.eye(5), atol=1e-13)
    np.testing.assert_allclose(A @ T @ L @ TI, np.eye(5), atol=1e-12)
    np.testing.assert_allclose(t["DENSE"] @ (c[:, None] ** np.arange(1, 6)), np.eye(5), atol=1e-12)
    z = 1e7  # stiffly accurate, so L-stable
    assert abs(1 - z * (A[4] @ np.linalg.solve(np.eye(5) + z * A, np.ones(5)))) < 1e-5


def test_radau9s_error_estimate_vanishes_up_to_order_5():
    """f0 + GAMMA/h sum E_i Z_i, the increments being those of y' = t^(k-1): zero for k <= 5."""
    t = arrays("radau9_tableau.h")
    c = t["C"]
    for k in range(1, 7):
        rest = (1.0 if k == 1 else 0.0) + t["GAMMA"] * (t["E"] @ (c**k / k))
        assert (abs(rest) < 1e-12) == (k <= 5), k
