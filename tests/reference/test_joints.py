"""Bars that share nodes, against what is known of them from outside this project: closed forms and equations in angles."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from tensegrity_core import reference
from tensegrity_core.errors import InputError
from tensegrity_core.kernel import to_bytes
from tensegrity_core.model import grid, held
from tests.support import by_hand

TIGHT = {"rtol": 1e-12, "atol": 1e-14}
GRAVITY = 9.81


def hanging(angles, length=1.0, axes=(0, 2), **fields):
    """A chain of rods that hangs from its first node; angles (n,) rad from the vertical."""
    links = length * np.array([np.sin(angles), np.zeros(len(angles)), -np.cos(angles)]).T
    nodes = np.vstack((np.zeros(3), np.cumsum(links, axis=0)))
    bars = [(i, i + 1) for i in range(len(angles))]
    return by_hand(nodes, [0], bars, [], stiffness=[], rest_length=[], gravity=GRAVITY, axes=axes, **fields)


def angles_of(result) -> np.ndarray:
    links = np.diff(result.position, axis=1)
    return np.arctan2(links[:, :, 0], -links[:, :, 2])


def chain_matrices(n: int, m=1.0, length=1.0):
    """M and K of a chain of n thin rods in its angles, about the vertical: with r_i the centre of rod i,
    M = sum of m (dr_i/dq)^T (dr_i/dq) + m l^2/12 on the diagonal, K = m g l (n - i - 1/2) on the diagonal."""
    to_centre = np.tril(np.ones((n, n)), -1) + 0.5 * np.eye(n)
    M = m * length**2 * (to_centre.T @ to_centre + np.eye(n) / 12.0)
    return M, np.diag(m * GRAVITY * length * (n - 0.5 - np.arange(n)))


def test_chain_matrices_of_the_double_pendulum():
    """What the theory says of two rods."""
    M, K = chain_matrices(2, 1.7, 0.8)
    np.testing.assert_allclose(M, 1.7 * 0.8**2 * np.array([[4 / 3, 1 / 2], [1 / 2, 1 / 3]]))
    np.testing.assert_allclose(K, 1.7 * GRAVITY * 0.8 * np.diag([1.5, 0.5]))


@pytest.mark.parametrize("n", [2, 5])
@pytest.mark.parametrize("axes", [(0, 1, 2), (0, 2)])
def test_small_swings_of_a_hanging_chain(n, axes):
    """In each of its modes the chain swings as cos(w t), w^2 from det(K - w^2 M) = 0.  At angles of 1e-5 what the closed form
    leaves out is of third order."""
    squares, modes = scipy.linalg.eigh(chain_matrices(n)[1], chain_matrices(n)[0])
    for w, mode in [(squares[i] ** 0.5, modes[:, i] / abs(modes[:, i]).max()) for i in (0, n - 1)]:
        model = hanging(1e-5 * mode, axes=axes)
        result = reference.simulate(model, held(model, grid(4.0 / w, 0.2 / w)), **TIGHT)
        expected = 1e-5 * mode * np.cos(w * result.times)[:, None]
        np.testing.assert_allclose(angles_of(result), expected, rtol=0.0, atol=2e-13)


def test_large_swings_of_a_double_pendulum():
    """Against Lagrange's equations in the two angles, which know nothing of nodes, bars and constraints."""
    start, mass, length = np.array([1.3, 2.4]), 1.4, 0.9

    def swing(t, y):
        a, b, da, db = y
        c, s = np.cos(a - b), np.sin(a - b)
        M = mass * length**2 * np.array([[4 / 3, c / 2], [c / 2, 1 / 3]])
        inertia = 0.5 * mass * length**2 * s * np.array([db**2, -(da**2)])
        weight = mass * GRAVITY * length * np.array([1.5 * np.sin(a), 0.5 * np.sin(b)])
        return [da, db, *np.linalg.solve(M, -inertia - weight)]

    model = hanging(start, length, bar_mass=mass)
    result = reference.simulate(model, held(model, grid(3.0, 0.1)), **TIGHT)
    known = scipy.integrate.solve_ivp(swing, (0, 3), [*start, 0, 0], "DOP853", result.times, rtol=1e-13, atol=1e-14).y
    apart = np.exp(1j * angles_of(result)) - np.exp(1j * known[:2].T)
    assert np.abs(apart).max() < 1e-10
    assert result.ledger_error() < 1e-10
    lengths = np.linalg.norm(np.diff(result.position, axis=1), axis=2)
    np.testing.assert_allclose(lengths, length, rtol=1e-14)
    # the pin bears the weight of both rods and what their centres are accelerated by
    a, b, da, db = known
    _, _, dda, ddb = np.array([swing(t, y) for t, y in zip(result.times, known.T)]).T
    first, second = (
        length * np.array([np.cos(q) * ddq - np.sin(q) * dq**2, np.sin(q) * ddq + np.cos(q) * dq**2])
        for q, dq, ddq in ((a, da, dda), (b, db, ddb))
    )
    expected = mass * (1.5 * first + 0.5 * second).T + [0.0, 2.0 * mass * GRAVITY]
    np.testing.assert_allclose(result.reaction[:, 0, [0, 2]], expected, rtol=0.0, atol=1e-7)


def test_force_of_a_bar_at_rest():
    """A bar that hangs bears half its own weight, in the mean over its length, and all that hangs below it."""
    model = hanging(np.zeros(3), bar_mass=np.array([1.0, 2.0, 4.0]))
    result = reference.simulate(model, held(model, grid(0.1, 0.1)))
    np.testing.assert_allclose(result.bar_force, GRAVITY * np.array([[6.5, 5.0, 2.0]] * 2), rtol=1e-12)
    np.testing.assert_allclose(result.reaction[:, 0], [[0.0, 0.0, 7.0 * GRAVITY]] * 2, rtol=1e-12)


def test_kernel_refuses():
    """While the kernel knows no joints it computes nothing wrong about them."""
    with pytest.raises(InputError, match="bars b1 and b2 share the node n2, which the kernel.*; use tensegrity_core.reference"):
        to_bytes(hanging([0.1, 0.2]))
