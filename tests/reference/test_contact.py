"""Contact with the ground against closed forms (section 10 of the theory) and against what must be conserved."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy

from tensegrity_core import reference
from tensegrity_core.model import Contact, Ground, grid, held
from tests.support import by_hand
from tests.support.ground_scenes import random_drives, random_ground

TIGHT = {"rtol": 1e-12, "atol": 1e-13}
GRAVITY = 9.81
STIFFNESS = 2e4


def standing(nodes, bars, **fields):
    """Without strings, on a plane that all its nodes may touch."""
    contact = {"stiffness": STIFFNESS, "damping": 0.0, "tangential_stiffness": STIFFNESS, "friction": 0.0}
    contact |= {key: fields.pop(key) for key in list(fields) if key in contact}
    known = {"stiffness": [], "rest_length": [], "damping": [], "gravity": GRAVITY, "ground": Ground()} | fields
    contacts = [Contact(i, **contact) for i in range(len(nodes))]
    return by_hand(nodes, [], bars, [], contacts=contacts, **known)


def dropped(height, mass=2.0, **fields):
    return standing([[0.0, 0.0, height]], [], bar_mass=[], point_mass=[(0, mass)], **fields)


def run(model, duration, step, **signals):
    return reference.simulate(model, held(model, grid(duration, step), **signals), **TIGHT)


def kinds(result):
    return [transition.kind for transition in result.transitions]


def test_dropped_mass():
    """It falls, swings half a period about its weight's penetration and a bit more, and rises as high as before."""
    mass, height = 2.0, 0.5
    result = run(dropped(height, mass), 2.0, 0.05)
    w, v = np.sqrt(STIFFNESS / mass), np.sqrt(2.0 * GRAVITY * height)
    flight, touch = v / GRAVITY, (2.0 * np.pi - 2.0 * np.arctan(v * w / GRAVITY)) / w
    times = [flight, flight + touch, 3.0 * flight + touch, 3.0 * flight + 2.0 * touch]
    assert kinds(result)[:4] == ["touch_down", "lift_off"] * 2
    np.testing.assert_allclose([t.time for t in result.transitions][:4], times, rtol=0.0, atol=1e-11)
    period = 2.0 * flight + touch
    expected = height - 0.5 * GRAVITY * np.minimum(result.times % period, period - result.times % period) ** 2
    flying = expected > 0.0
    np.testing.assert_allclose(result.position[flying, 0, 2], expected[flying], rtol=0.0, atol=1e-10)
    assert result.ledger_error() < 1e-9 and not result.dissipated.any() and not result.contact_force.any()


def test_damping_takes_what_quadrature_says():
    """m v dv / d delta = m g - N; the loss is the integral of k c delta v^2, and what is left leaves the ground."""
    mass, height, c = 2.0, 0.5, 0.3
    result = run(dropped(height, mass, damping=c), 0.55, 0.05)
    v = np.sqrt(2.0 * GRAVITY * height)

    def motion(t, y):
        return [y[1], GRAVITY - STIFFNESS / mass * y[0] * (1.0 + c * y[1]), STIFFNESS * c * y[0] * y[1] ** 2]

    def leaves(t, y):
        return y[0] + (t < 1e-9)

    leaves.terminal, leaves.direction = True, -1.0
    known = scipy.integrate.solve_ivp(motion, (0.0, 0.1), [0.0, v, 0.0], "DOP853", events=leaves, rtol=1e-13, atol=1e-15)
    assert kinds(result) == ["touch_down", "lift_off"]
    assert result.transitions[1].time - result.transitions[0].time == pytest.approx(known.t_events[0][0], abs=1e-11)
    assert result.dissipated[-1] == pytest.approx(known.y_events[0][0][2], abs=1e-9)
    assert result.dissipated[-1] == pytest.approx(0.5 * mass * (v**2 - known.y_events[0][0][1] ** 2), abs=1e-9)


def test_it_is_clipped_where_it_would_pull():
    """A node that is torn out of the ground faster than 1 / c: nothing holds it then, and it touches again as it slows down."""
    model = dropped(-0.02, 1.0, damping=0.5, velocity=np.array([[0.0, 0.0, 2.01]]), gravity=9.81)
    result = run(model, 0.02, 1e-3)
    assert kinds(result) == ["unclip", "clip", "lift_off"] or kinds(result) == ["unclip", "lift_off"]
    assert (result.contact_normal >= 0.0).all() and result.contact_normal[0] == 0.0
    assert result.ledger_error() < 1e-11
    literal = dataclasses.replace(model, ground=Ground(law="literal"))
    assert run(literal, 0.02, 1e-3).contact_normal[0] < 0.0


@pytest.mark.parametrize("axes", [(0, 1, 2), (0, 2)])
def test_bar_slides_to_a_stop_and_stays(axes):
    """On its two ends: after v^2 / (2 mu g), but for the bristles' way, which then swing; friction alone stops it."""
    mu, speed, depth = 0.4, 1.0, 0.5 * 3.0 * GRAVITY / STIFFNESS
    nodes = [[0.0, 0.0, -depth], [1.0, 0.0, -depth]]
    velocity = np.tile([speed, 0.0, 0.0], (2, 1))
    model = standing(nodes, [(0, 1)], bar_mass=3.0, friction=mu, axes=axes, velocity=velocity)
    result = run(model, 1.0, 0.05)
    assert [(t.kind, t.contact) for t in result.transitions] == [("slip", 0), ("slip", 1), ("stick", 0), ("stick", 1)]
    # sticking: x'' = -w^2 x to x = a = mu g / w^2; slipping: x'' = -mu g
    w = np.sqrt(2.0 * STIFFNESS / 3.0)
    a = mu * GRAVITY / w**2
    begins = np.arcsin(a * w / speed) / w
    rest = speed**2 - (a * w) ** 2  # of v^2
    stops = begins + np.sqrt(rest) / (mu * GRAVITY)
    np.testing.assert_allclose([t.time for t in result.transitions], [begins] * 2 + [stops] * 2, rtol=0.0, atol=1e-11)
    way = a + rest / (2.0 * mu * GRAVITY)
    assert way == pytest.approx(speed**2 / (2.0 * mu * GRAVITY), abs=a)
    after = result.times > stops
    swing = way - a + a * np.cos(w * (result.times[after] - stops))
    np.testing.assert_allclose(result.position[after, 0, 0], swing, rtol=0.0, atol=1e-10)
    assert result.contact_sticking[after].all() and result.dissipated[-1] == pytest.approx(mu * 3.0 * GRAVITY * (way - a))
    assert result.ledger_error() < 1e-11
    np.testing.assert_allclose(result.contact_normal, 0.5 * 3.0 * GRAVITY, rtol=1e-12)


@pytest.mark.parametrize("slope", [0.49, 0.51, 0.98, 1.02])
def test_incline_below_and_above_friction(slope):
    """In parts of mu.  Let go with bristles at zero a bar swings along the plane, about where they carry it: below one half it
    never slips; below 1 it slips and stops; above it goes on for good."""
    mu, g = 0.3, GRAVITY
    angle = np.arctan(slope * mu)
    normal, along = np.array([-np.sin(angle), 0.0, np.cos(angle)]), np.array([np.cos(angle), 0.0, np.sin(angle)])
    depth = 0.5 * g * np.cos(angle) / STIFFNESS
    nodes = np.array([-depth * normal, along - depth * normal])
    model = standing(nodes, [(0, 1)], friction=mu, axes=(0, 2), ground=Ground(normal=tuple(normal)))
    result = run(model, 0.3, 0.05)
    down = (nodes[0] - result.position[:, 0]) @ along
    w = np.sqrt(2.0 * STIFFNESS)
    swing, reach = g * np.sin(angle) / w**2, mu * g * np.cos(angle) / w**2
    assert result.ledger_error() < 1e-11
    if slope < 0.5:
        assert not result.transitions and result.contact_sticking.all()
        np.testing.assert_allclose(down, swing * (1.0 - np.cos(w * result.times)), rtol=0.0, atol=1e-11)
        return
    begins = np.arccos(1.0 - reach / swing) / w
    speed, pull = w * np.sqrt(2.0 * swing * reach - reach**2), g * (np.sin(angle) - mu * np.cos(angle))
    assert result.transitions[0].kind == "slip" and result.transitions[0].time == pytest.approx(begins, abs=1e-11)
    if slope > 1.0:
        since = result.times[1:] - begins
        np.testing.assert_allclose(down[1:], reach + speed * since + 0.5 * pull * since**2, rtol=0.0, atol=1e-10)
        assert not result.contact_sticking[-1].any()
    else:
        assert kinds(result) == ["slip"] * 2 + ["stick"] * 2 and result.contact_sticking[-1].all()
        assert result.transitions[-1].time == pytest.approx(begins - speed / pull, abs=1e-11)
        assert result.dissipated[-1] == pytest.approx(-mu * g * np.cos(angle) * 0.5 * speed**2 / pull, rel=1e-8)


def test_rest_is_rest():
    """A bar that lies on its ends as deep as it weighs."""
    mu, mass = 0.5, 1.0
    depth = 0.5 * mass * GRAVITY / STIFFNESS
    model = standing([[0.0, 0.0, -depth], [1.0, 0.0, -depth]], [(0, 1)], friction=mu, axes=(0, 2))
    result = run(model, 100.0, 10.0)
    assert np.abs(result.position - model.nodes).max() < 1e-12 and not result.transitions


def test_thrown_spinning_bar():
    """Its ends touch, stick, slip and leave; what is lost is what friction and damping took.  In free flight its centre of mass
    flies on a parabola and its angular momentum stays."""
    turn, flight = np.array([0.3, -2.0, 1.0]), np.array([1.0, 0.3, -1.0])
    nodes = np.array([[-0.5, 0.0, 0.6], [0.5, 0.1, 0.9]])
    centre = nodes.mean(axis=0)
    model = standing(nodes, [(0, 1)], friction=0.4, damping=0.2, velocity=flight + np.cross(turn, nodes - centre))
    result = run(model, 1.0, 0.02)
    assert {"touch_down", "lift_off", "slip"} <= set(kinds(result))
    assert result.ledger_error() < 1e-10
    lengths = np.linalg.norm(result.position[:, 1] - result.position[:, 0], axis=1)
    np.testing.assert_allclose(lengths, model.bar_length[0], rtol=1e-14)
    size = np.linalg.norm(result.contact_force, axis=2)
    assert (size <= 0.4 * result.contact_normal + 1e-9).all()
    flying = np.flatnonzero(result.times < result.transitions[0].time)
    t = result.times[flying, None]
    expected = centre + flight * t - 0.5 * np.array([0.0, 0.0, GRAVITY]) * t**2
    np.testing.assert_allclose(result.position[flying].mean(axis=1), expected, rtol=0.0, atol=1e-12)


def test_energy_over_many_bounces():
    """A bar that spins and bounces without friction and damping."""
    nodes = np.array([[-0.5, 0.0, 0.05], [0.5, 0.0, 0.08]])
    model = standing(nodes, [(0, 1)], axes=(0, 2))
    result = run(model, 1.5, 0.5)
    assert kinds(result).count("touch_down") > 15
    total = result.kinetic + result.potential + result.elastic
    assert np.abs(total - total[0]).max() < 1e-10 and not result.dissipated.any()


def test_a_ground_that_moves_is_another_frame():
    """A mass on a ground that falls with a constant acceleration feels g less by that."""
    model = dropped(-2.0 * GRAVITY / STIFFNESS, ground=Ground(moving=True))
    fall = 0.25 * GRAVITY
    result = run(model, 0.5, 0.05, ground=lambda t: ([-0.5 * fall * t**2], [-fall * t]))
    w, deep = np.sqrt(STIFFNESS / 2.0), 2.0 * GRAVITY / STIFFNESS
    rest = 0.75 * deep
    depth = rest + (deep - rest) * np.cos(w * result.times)
    expected = -0.5 * fall * result.times**2 - depth
    np.testing.assert_allclose(result.position[:, 0, 2], expected, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(result.contact_normal[:, 0], STIFFNESS * depth, rtol=0.0, atol=1e-6)
    assert result.ledger_error() < 1e-11 and result.input_work[-1] < -4.0


def test_a_jump_of_the_ground_is_work():
    """No impulse: the mass keeps its velocity, and the ground's energy is put in."""
    model = dropped(-2.0 * GRAVITY / STIFFNESS, ground=Ground(moving=True))
    inputs = held(model, grid(0.002, 0.001), ground=lambda t: ([0.0], [0.0]))
    jumped = dataclasses.replace(inputs, ground_height=np.array([[0.0], [0.01]]))
    result = reference.simulate(model, jumped, **TIGHT)
    deep = 2.0 * GRAVITY / STIFFNESS
    assert result.input_work[-1] == pytest.approx(0.5 * STIFFNESS * ((deep + 0.01) ** 2 - deep**2), rel=1e-9)
    assert result.ledger_error() < 1e-11


def test_planes_of_any_direction_are_one():
    """The same fall, turned as a whole."""
    turn = scipy.spatial.transform.Rotation.from_rotvec([0.4, -0.8, 0.3])
    nodes = np.array([[-0.5, 0.0, 0.1], [0.5, 0.1, 0.2]])
    velocity = np.array([[1.0, 0.5, 0.0], [1.0, 0.5, 0.2]])
    along = nodes[1] - nodes[0]
    velocity[1] -= along * (along @ (velocity[1] - velocity[0])) / (along @ along)
    whole = standing(nodes, [(0, 1)], friction=0.3, damping=0.1, velocity=velocity)
    point, down = turn.apply([0.3, -0.2, 0.0]), turn.apply([0.0, 0.0, -GRAVITY])
    turned = dataclasses.replace(
        whole,
        nodes=turn.apply(nodes),
        nominal=turn.apply(nodes),
        velocity=turn.apply(velocity),
        gravity=tuple(down),
        ground=Ground(tuple(point), tuple(turn.apply([0.0, 0.0, 1.0]))),
    )
    one, other = run(whole, 0.25, 0.05), run(turned, 0.25, 0.05)
    assert kinds(one) == kinds(other) and len(kinds(one)) > 2
    np.testing.assert_allclose(turn.apply(one.position[-1]), other.position[-1], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(turn.apply(one.contact_force[-1]), other.contact_force[-1], rtol=0.0, atol=1e-6)


def test_symmetric_ends_change_together():
    model = standing([[-0.5, 0.0, 0.1], [0.5, 0.0, 0.1]], [(0, 1)], friction=0.5, damping=0.1)
    result = run(model, 0.5, 0.1)
    times = [t.time for t in result.transitions]
    assert len(times) > 4 and [t.contact for t in result.transitions] == [0, 1] * (len(times) // 2)
    assert times[::2] == times[1::2]


@pytest.mark.parametrize("joints", [False, True])
@pytest.mark.parametrize("seed", [3, 5, 8])
def test_random_structures(seed, joints):
    """Energies, lengths and the cone of friction."""
    model = random_ground(seed, joints)
    inputs = random_drives(model, seed, steps=4)
    result = reference.simulate(model, inputs)
    assert any(transition.kind == "touch_down" for transition in result.transitions)
    assert result.ledger_error() < 1e-9
    lengths = np.linalg.norm(result.position[:, model.bars[:, 1]] - result.position[:, model.bars[:, 0]], axis=2)
    np.testing.assert_allclose(lengths, np.tile(model.bar_length, (len(lengths), 1)), rtol=1e-12)
    mu = np.array([contact.friction for contact in model.contacts])
    size = np.linalg.norm(result.contact_force, axis=2)
    assert (size <= mu * result.contact_normal + 1e-9).all() and (result.contact_normal >= -1e-12).all()
    assert (result.contact_sticking <= (result.contact_normal > 0.0)).all()
