"""Bars that share nodes, against what is known of them from outside this project: closed forms and equations in angles."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from tensegrity_core import reference, statics
from tensegrity_core.errors import InputError, SimulationError
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


def run(model, duration, step, **signals):
    return reference.simulate(model, held(model, grid(duration, step), **signals), **TIGHT)


def framed(nodes, fixed, bars, **fields):
    return by_hand(nodes, fixed, bars, [], stiffness=[], rest_length=[], **{"gravity": GRAVITY} | fields)


def test_parallel_four_bar_linkage():
    """Two equal cranks and a coupler that stays level: a pendulum with (2/3 m + m_c) l^2 q'' = -(m + m_c) g l sin q."""
    length, m, coupler = 0.7, 1.2, 2.5
    down = length * np.array([np.sin(0.9), 0.0, -np.cos(0.9)])
    nodes = [np.zeros(3), down, down + [1.5, 0.0, 0.0], [1.5, 0.0, 0.0]]
    model = framed(nodes, [0, 3], [(0, 1), (1, 2), (2, 3)], bar_mass=[m, coupler, m])
    result = run(model, 3.0, 0.1)
    w = np.sqrt((m + coupler) * GRAVITY / ((2 / 3 * m + coupler) * length))
    k = np.sin(0.45)
    sn, _, _, _ = scipy.special.ellipj(scipy.special.ellipk(k**2) - w * result.times, k**2)
    angle = 2.0 * np.arcsin(k * sn)
    crank = length * np.array([np.sin(angle), 0.0 * angle, -np.cos(angle)]).T
    np.testing.assert_allclose(result.position[:, 1], crank, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(result.position[:, 2], crank + [1.5, 0.0, 0.0], rtol=0.0, atol=1e-10)


def test_rigid_triangle_thrown():
    """Its centre flies on a parabola; its normal goes round the angular momentum L at the rate |L| / I, I that about an axis in
    its plane (the motion of a symmetric top), and it spins about the normal at the constant rate n . L / (2 I)."""
    side, m = 0.8, 1.5
    corners = (
        side / np.sqrt(3.0) * np.array([[np.cos(a), np.sin(a), 0.0] for a in (0.3, 0.3 + 2 * np.pi / 3, 0.3 + 4 * np.pi / 3)])
    )
    turn, flight = np.array([2.0, -1.0, 3.0]), np.array([0.4, -0.2, 2.0])
    model = framed(corners, [], [(0, 1), (1, 2), (2, 0)], bar_mass=m, velocity=np.cross(turn, corners) + flight)
    result = run(model, 2.0, 0.1)
    t = result.times[:, None]
    down = np.array([0.0, 0.0, GRAVITY])
    np.testing.assert_allclose(result.position.mean(axis=1), flight * t - 0.5 * down * t**2, rtol=0.0, atol=1e-11)
    inertia = m * side**2 / 4.0  # about an axis in the plane; twice that about the normal
    momentum = inertia * turn * [1.0, 1.0, 2.0]
    round_momentum = scipy.spatial.transform.Rotation.from_rotvec(momentum / inertia * t)
    # by momentum conservation the rest of the turn is one about the normal, at the rate n . (turn - L / I)
    spin = scipy.spatial.transform.Rotation.from_rotvec(np.array([0.0, 0.0, turn[2] - momentum[2] / inertia]) * t)
    for node in range(3):
        expected = (round_momentum * spin).apply(corners[node])
        np.testing.assert_allclose(result.position[:, node] - result.position.mean(axis=1), expected, rtol=0.0, atol=1e-10)
    assert result.ledger_error() < 1e-10 and np.isfinite(result.bar_force).all()


@pytest.mark.parametrize("axes", [(0, 1, 2), (0, 2)])
def test_welded_bars_in_a_line_are_one_bar(axes):
    """Also where one of them is welded of three, and the forces of two halves have the whole bar's as their mean."""
    d = np.array([0.6, 0.0, -0.8])
    whole = run(framed([0 * d, 2 * d], [0], [(0, 1)], bar_mass=2.0, axes=axes), 2.0, 0.1)
    half = run(framed([0 * d, d, 2 * d], [0], [(0, 1), (1, 2)], axes=axes, welds=[(0, 1)]), 2.0, 0.1)
    parts = [(0, 1), (1, 2), (2, 3)]
    third = framed([0 * d, 0.5 * d, d, 2 * d], [0], parts, bar_mass=[0.5, 0.5, 1.0], axes=axes, welds=[(0, 1, 2)])
    for other in (half, run(third, 2.0, 0.1)):
        np.testing.assert_allclose(other.position[:, -1], whole.position[:, 1], rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(other.reaction[:, 0], whole.reaction[:, 0], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(half.bar_force.mean(axis=1), whole.bar_force[:, 0], rtol=0.0, atol=1e-8)


def test_welded_corner_is_braced_by_a_bar_without_mass():
    corner = [[0, 0, 0], [0, 0, 1], [1, 0, 1]]
    welded = run(framed(corner, [0], [(0, 1), (1, 2)], welds=[(0, 1)]), 2.0, 0.1)
    braced = run(framed(corner, [0], [(0, 1), (1, 2), (0, 2)], bar_mass=[1.0, 1.0, 0.0]), 2.0, 0.1)
    np.testing.assert_allclose(welded.position, braced.position, rtol=0.0, atol=1e-12)


def rigid_body(m, corners, turn, times):
    """Places of points that turn with a free rigid body of point masses, by Euler's equations for a rotation matrix."""
    inertia = sum(mass * (x @ x * np.eye(3) - np.outer(x, x)) for mass, x in zip(m, corners))

    def turning(t, y):
        R = y.reshape(3, 3)
        spin = R @ np.linalg.solve(inertia, R.T @ inertia @ turn)
        return np.cross(spin, R, axisa=0, axisb=0, axisc=0).ravel()

    found = scipy.integrate.solve_ivp(turning, (0, times[-1]), np.eye(3).ravel(), "DOP853", times, rtol=1e-13, atol=1e-13)
    return np.array([corners @ R.reshape(3, 3).T for R in found.y.T])


@pytest.mark.parametrize("height", [0.0, 0.35])
def test_welded_frame_thrown(height):
    """A frame of four bars without mass between point masses, flat (whose planeness no distance keeps) or not, turns as a rigid
    body."""
    corners = np.array([[0, 0, height], [1.1, 0, 0], [1.1, 0.6, height], [0, 0.6, 0]], dtype=float)
    m = np.array([1.0, 2.0, 1.5, 0.7])
    corners -= m @ corners / m.sum()
    turn = np.array([1.0, -2.0, 3.0])
    bars, masses = [(0, 1), (1, 2), (2, 3), (3, 0)], tuple(enumerate(m))
    fields = {"bar_mass": 0.0, "gravity": 0.0, "point_mass": masses, "velocity": np.cross(turn, corners)}
    model = framed(corners, [], bars, welds=[(0, 1), (1, 2, 3)], **fields)
    assert len(model.bodies) == 1 and len(model.bodies[0].followers) == (height == 0.0)
    result = run(model, 2.0, 0.1)
    np.testing.assert_allclose(result.position, rigid_body(m, corners, turn, result.times), rtol=0.0, atol=1e-10)


def test_welded_body_on_a_hinge():
    """Two of its nodes are fixed, so that it swings about their line: I q'' = -m g a sin q, with I and a of its free part."""
    nodes = [[0, 0, 0], [0.5, 1, 0], [0, 2, 0], [0.2, 1, -0.5]]
    model = framed(nodes, [0, 2], [(0, 1), (1, 2), (1, 3)], welds=[(0, 1, 2)])
    result = run(model, 1.5, 0.1)
    # of a thin rod: I = m/3 (p^2 + p q + q^2) over its ends' places about the hinge, here along x and z
    a, b, c = np.zeros(2), np.array([0.5, 0.0]), np.array([0.2, -0.5])
    inertia = sum((p @ p + p @ q + q @ q) / 3.0 for p, q in ((a, b), (b, a), (b, c)))
    centre = (a + b) / 2 + (b + a) / 2 + (b + c) / 2  # times the mass of 1 kg

    def swing(t, y):
        turned = np.array([[np.cos(y[0]), np.sin(y[0])], [-np.sin(y[0]), np.cos(y[0])]]) @ centre
        return [y[1], turned[0] * GRAVITY / inertia]

    known = scipy.integrate.solve_ivp(swing, (0, 1.5), [0.0, 0.0], "DOP853", result.times, rtol=1e-12, atol=1e-13).y[0]
    expected = np.array([0.5 * np.cos(known), 1.0 + 0.0 * known, -0.5 * np.sin(known)]).T
    np.testing.assert_allclose(result.position[:, 1], expected, rtol=0.0, atol=1e-9)
    assert result.ledger_error() < 1e-9


def test_bodies_side_by_side():
    """Two welded bodies with two nodes in common keep each other's distance twice; bars that touch nowhere may be one body."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=float)
    turning = np.cross([1.0, 2.0, -1.0], corners)
    bars, welds = [(0, 1), (1, 2), (0, 3), (3, 1), (2, 4)], [(0, 1), (2, 3)]
    assert run(framed(corners, [], bars, welds=welds, velocity=turning), 1.0, 0.1).ledger_error() < 1e-8
    apart = framed(corners[[0, 1, 2, 4]], [], [(0, 1), (2, 3)], welds=[(0, 1)], velocity=turning[[0, 1, 2, 4]])
    place = run(apart, 1.0, 0.1).position
    assert np.ptp(np.linalg.norm(place[:, 3] - place[:, 0], axis=1)) < 1e-13


def test_rod_on_a_smooth_rail():
    """Nothing pushes a rod sideways whose upper end slides on a rail (fixed along y and z): its centre stays above its place,
    and its fall has the energy 1/2 I q'^2 + 1/2 m (l/2 sin q q')^2 = m g l/2 (cos q - cos q0)."""
    length, start = 1.2, 1.0
    tip = length * np.array([np.sin(start), 0.0, -np.cos(start)])
    model = framed([np.zeros(3), tip], [], [(0, 1)], bar_mass=1.7, partly_fixed=[(0, (1, 2))])
    result = run(model, 2.0, 0.05)
    np.testing.assert_allclose(result.position.mean(axis=1)[:, 0], 0.5 * tip[0], rtol=0.0, atol=1e-12)
    assert np.abs(result.position[:, 0, 1:]).max() == 0.0
    link = result.position[:, 1] - result.position[:, 0]
    q, rate = np.arctan2(link[:, 0], -link[:, 2]), np.zeros(len(link))
    speed = result.velocity[:, 1] - result.velocity[:, 0]
    rate = (speed[:, 0] * np.cos(q) + speed[:, 2] * np.sin(q)) / length
    kinetic = 0.5 * rate**2 * length**2 * (1 / 12 + np.sin(q) ** 2 / 4)
    np.testing.assert_allclose(kinetic, GRAVITY * length / 2 * (np.cos(q) - np.cos(start)), rtol=0.0, atol=1e-9)
    assert np.abs(result.reaction[:, 0, 0]).max() == 0.0 and np.abs(result.reaction[:, 0, 2]).max() > 1.7 * GRAVITY
    assert result.ledger_error() < 1e-10


def test_pendulum_on_a_pivot_that_is_moved_upwards_only():
    """Pivot fixed along x, y, z and moved along z with the acceleration a: a pendulum under g + a.  One that slides along x
    beside it: as on the rail, under g + a."""
    start, up = 0.8, 4.0
    tip = np.array([np.sin(start), 0.0, -np.cos(start)])

    def rises(t):
        return np.array([[7.0, 7.0, 0.5 * up * t**2]]), np.array([[7.0, 7.0, up * t]])

    for held_along, moved_along in ((None, (2,)), ((1, 2), (2,))):
        partly = [] if held_along is None else [(0, held_along)]
        fields = {"partly_fixed": partly, "moving": [0], "moving_axes": [(0, moved_along)]}
        moved = run(framed([np.zeros(3), tip], [] if partly else [0], [(0, 1)], **fields), 1.5, 0.05, motion=rises)
        still = run(
            framed([np.zeros(3), tip], [] if partly else [0], [(0, 1)], gravity=GRAVITY + up, partly_fixed=partly), 1.5, 0.05
        )
        lift = np.zeros((len(still.times), 1, 3))
        lift[:, 0, 2] = 0.5 * up * still.times**2
        np.testing.assert_allclose(moved.position - lift, still.position, rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(moved.reaction[:, 0], still.reaction[:, 0], rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(moved.bar_force, still.bar_force, rtol=0.0, atol=1e-8)
        assert moved.ledger_error() < 1e-10 < np.abs(moved.input_work).max()


def test_jump_of_a_moved_pin():
    """The velocity of the pin of two rods jumps: the impulse acts along the rods, and from the pin; where the second rod has
    next to no mass, as on one rod of class 1 (see `moved`)."""
    tip = np.array([0.6, 0.0, -0.8])

    def jumps(t):
        return np.array([[3.0 * t, 0.0, 0.0]]), np.array([[3.0, 0.0, 0.0]])

    alone = run(framed([np.zeros(3), tip], [0], [(0, 1)], moving=[0]), 0.5, 0.1, motion=jumps)
    masses = [(2, 1e-9)]
    chain = framed([np.zeros(3), tip, 1.5 * tip], [0], [(0, 1), (1, 2)], bar_mass=[1.0, 0.0], moving=[0], point_mass=masses)
    two = run(chain, 0.5, 0.1, motion=jumps)
    np.testing.assert_allclose(two.position[:, 1], alone.position[:, 1], rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(two.kinetic, alone.kinetic, rtol=0.0, atol=1e-6)
    assert two.ledger_error() < 1e-9


PANEL = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2), (1, 3)]


def test_redundant_bars_leave_the_motion_and_share_the_force():
    """A panel braced twice moves as if braced once, if the second brace has no mass; lambda has no part in the one state of
    self-stress, which is what "of least norm" says."""
    corners = np.array([[0, 0, 0], [1, 0, 0.1], [1.2, 0, 0.7], [0.1, 0, 0.6]])
    turn = np.cross([0.0, 2.0, 0.0], corners)
    fields = {"axes": (0, 2), "velocity": turn}
    twice = framed(corners, [], PANEL, bar_mass=[1.0] * 5 + [0.0], **fields)
    once = framed(corners, [], PANEL[:5], bar_mass=[1.0] * 5, **fields)
    assert twice.redundant.all() and not once.redundant.any()
    both, one = run(twice, 1.0, 0.1), run(once, 1.0, 0.1)
    np.testing.assert_allclose(both.position, one.position, rtol=0.0, atol=1e-10)
    stress = scipy.linalg.null_space(statics.equilibrium_matrix(twice)) / twice.bar_length[:, None]  # force densities
    assert stress.shape[1] == 1
    lam = both.bar_force / twice.bar_length
    assert np.abs(lam @ stress).max() < 1e-8 * np.abs(lam).max()
    assert both.ledger_error() < 1e-10


def test_redundant_bars_by_name():
    """Only those that can hold each other; a chain of 2000 bars is looked through soon, since none of it can."""
    corners = [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1], [2, 0, 0.3]]
    model = framed(corners, [], [*PANEL, (1, 4), (4, 2)], axes=(0, 2))
    assert model.redundant.tolist() == [True] * 6 + [False] * 2
    assert not framed(np.random.default_rng(3).normal(size=(5, 3)), [], PANEL).redundant.any()  # no panel is flat by chance
    between_walls = framed([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [0, 2], [(0, 1), (1, 2)])
    assert between_walls.redundant.all()
    assert not hanging(np.linspace(-0.1, 0.1, 2000)).redundant.any()


def test_nodes_without_mass_are_refused():
    model = framed([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [0], [(0, 1), (1, 2)], bar_mass=[1.0, 0.0])
    with pytest.raises(InputError, match="free node 'n3' is on bars without mass only and so has no mass; fix it"):
        run(model, 0.1, 0.1)
    free = framed([[0, 0, 0], [1, 0, 0]], [0], [(0, 1)], moving=[1])
    with pytest.raises(InputError, match="moving names the free node 'n2'"):
        run(free, 0.1, 0.1)
    with pytest.raises(InputError, match="bar 'b1' has both ends fixed"):
        run(framed([[0, 0, 0], [1, 0, 0]], [0, 1], [(0, 1)]), 0.1, 0.1)


def test_groups():
    """Bars that meet in a fixed node only do not move each other; bars of class 1 are marked."""
    nodes = np.random.default_rng(5).normal(size=(9, 3))
    model = framed(nodes, [0], [(0, 1), (0, 2), (3, 4), (4, 5), (6, 7), (7, 8)], welds=[(1, 4)])
    assert [(group.bars, group.class_1) for group in model.groups] == [((0,), True), ((1, 4, 5), False), ((2, 3), False)]
    partly = framed(nodes[:2], [], [(0, 1)], partly_fixed=[(0, (2,))])
    assert [group.class_1 for group in partly.groups] == [False]


def test_chain_pulled_straight_is_an_error_by_name():
    def pulls(t):
        return np.array([[1.2 + t, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])

    model = framed([[0, 0, 0], [0.6, 0, -0.8], [1.2, 0, 0]], [0, 2], [(0, 1), (1, 2)], moving=[2])
    with pytest.raises(SimulationError, match="no finite force keeps the lengths of bars b1, b2") as caught:
        reference.simulate(model, held(model, grid(2.0, 0.1), motion=pulls))
    assert caught.value.status == "singular" and caught.value.time == pytest.approx(0.8, abs=1e-6)


def test_bars_that_cannot_keep_their_lengths_are_an_error_by_name():
    """A straight chain between two walls cannot sag, and a bar between two moved nodes cannot follow them apart."""
    chain = framed([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [0, 2], [(0, 1), (1, 2)])
    with pytest.raises(SimulationError, match="bars b1, b2 cannot all keep their lengths") as caught:
        reference.simulate(chain, held(chain, grid(1.0, 0.1)))
    assert caught.value.status == "contradictory"

    def parts(t):
        return np.array([[1.0 + t, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])

    crank = framed([[0, 0, 0], [1, 0, 0], [1, 0, -1]], [0, 1], [(0, 1), (1, 2)], moving=[1])
    with pytest.raises(InputError, match="node_position stretches bar 'b1', both .* by 0.1 of its length at t = 0.1 s; let"):
        reference.simulate(crank, held(crank, grid(1.0, 0.1), motion=parts))


def test_several_components_move_as_each_alone():
    """A double pendulum, a bar of class 1 and a point mass on a string in one scene, and each of them alone."""
    pendulum = [[0, 0, 0], [0.6, 0, -0.8], [1.2, 0, -1.6]]
    bar = [[3, 0, 0], [3, 0.5, -0.5]]
    mass = [[5, 0, 0], [5.2, 0.1, -1]]
    string = {"stiffness": 50.0, "rest_length": 0.8, "gravity": GRAVITY, "damping": 0.3}
    bars = [(0, 1), (1, 2), (3, 4)]
    whole = by_hand(pendulum + bar + mass, [0, 3, 5], bars, [(5, 6), (5, 6)], point_mass=[(6, 0.7)], **string)
    together = run(whole, 1.0, 0.1)
    alone = [
        run(framed(pendulum, [0], [(0, 1), (1, 2)]), 1.0, 0.1),
        run(framed(bar, [0], [(0, 1)]), 1.0, 0.1),
        run(by_hand(mass, [0], [], [(0, 1), (0, 1)], point_mass=[(1, 0.7)], **string), 1.0, 0.1),
    ]
    parts = np.concatenate([result.position for result in alone], axis=1)
    np.testing.assert_allclose(together.position, parts, rtol=0.0, atol=1e-10)
    assert [group.class_1 for group in whole.groups] == [False, True]


@pytest.mark.parametrize("method", ["DOP853", "Radau"])
def test_damped_square_of_bars_keeps_its_ledger(method):
    """Strings, dampers, drag and transitions between bars that share nodes; both methods."""
    square = [[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]]
    fields = {"stiffness": 300.0, "damping": 40.0, "rest_length": [1.3, 1.5], "gravity": GRAVITY, "drag": [(2, 0.5)]}
    model = by_hand(square, [0], [(0, 1), (1, 2), (2, 3), (3, 0)], [(0, 2), (1, 3)], **fields)
    result = reference.simulate(model, held(model, grid(1.0, 0.1)), method=method)
    assert result.transitions and result.ledger_error() < 1e-8 and result.dissipated[-1] > 1.0
    lengths = np.linalg.norm(result.position[:, model.bars[:, 1]] - result.position[:, model.bars[:, 0]], axis=2)
    np.testing.assert_allclose(lengths, 1.0, rtol=1e-14)
