"""The reference with point masses, drag, gravity vectors, moved nodes and actuators, against closed forms and other codes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk
from test_reference import build, mixed_structure, taut_mode

from tensegrity_core import equations, reference
from tensegrity_core.errors import InputError, SimulationError
from tensegrity_core.inputs import grid, held
from tensegrity_core.model import Actuator

TIGHT = {"rtol": 1e-12, "atol": 1e-13}
OBLIQUE = (2.0, -3.0, -6.0)    # of length 7


def turned(vectors, angle=0.7):
    """Vectors (..., 3) of the x-z plane, turned about z, so that nothing is special about the axes."""
    c, s = math.cos(angle), math.sin(angle)
    return np.asarray(vectors, dtype=float) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def run(model, times, *, ledger=1e-8, **signals):
    """The tight reference under held signals; its ledger must close."""
    result = reference.simulate(model, held(model, times, **signals), **TIGHT)
    assert result.ledger_error() < ledger
    return result


# --- the equations at random states ------------------------------------------------------------------------------


def loaded_structure():
    """The mixed structure with every kind of load: point masses at free, pinned and anchored nodes, drag, moved nodes."""
    masses = tuple(zip(range(7), (0.4, 0.9, 0.0, 1.3, 0.7, 0.2, 2.0)))
    return replace(mixed_structure(), gravity=OBLIQUE, point_mass=masses, drag=((1, 3.0), (4, 0.5), (5, 2.0)), moving=(0, 3, 6))


def end_forces(model, N, V):
    """(n, 3) N: weight of bars' halves and point masses, drag, and taut strings at their rest lengths held."""
    force = model.node_mass[:, None] * np.array(OBLIQUE)
    for node, c in model.drag:
        force[node] -= c * V[node]
    for (first, second), k, d, rest in zip(model.strings, model.stiffness, model.damping, model.rest_length):
        s, sdot = N[second] - N[first], V[second] - V[first]
        xi = np.linalg.norm(s)
        pull = (k * (xi - rest) + d * (s @ sdot) / xi) * s / xi
        force[first] += pull
        force[second] -= pull
    return force


def saddle_point(model, N, V, force, base):
    """Accelerations (n, 3) and ground forces (n, 3) by Lagrange's equations of the first kind: all coordinates, the bars'
    lengths and the fixed nodes' accelerations `base` as constraints, in one dense linear system."""
    n = len(N)
    masses = dict(model.point_mass)
    M, rows, right = np.zeros((3 * n, 3 * n)), [], []
    for node in range(n):
        M[3 * node : 3 * node + 3, 3 * node : 3 * node + 3] += masses.get(node, 0.0) * np.eye(3)
    for (first, second), m in zip(model.bars, model.bar_mass):
        for one, other in ((first, second), (second, first)):
            M[3 * one : 3 * one + 3, 3 * one : 3 * one + 3] += m / 3.0 * np.eye(3)
            M[3 * one : 3 * one + 3, 3 * other : 3 * other + 3] += m / 6.0 * np.eye(3)
        b, bdot, row = N[second] - N[first], V[second] - V[first], np.zeros(3 * n)
        row[3 * second : 3 * second + 3], row[3 * first : 3 * first + 3] = b, -b
        rows.append(row)
        right.append(-bdot @ bdot)
    for node in model.fixed_nodes:
        for axis in range(3):
            rows.append(np.eye(3 * n)[3 * node + axis])
            right.append(base[node, axis])
    G = np.array(rows)
    system = np.block([[M, G.T], [G, np.zeros((len(G), len(G)))]])
    found = np.linalg.solve(system, np.concatenate((force.ravel(), right)))
    held_by = -(G[len(model.bars) :].T @ found[3 * n + len(model.bars) :]).reshape(n, 3)
    return found[: 3 * n].reshape(n, 3), held_by


@pytest.mark.parametrize("seed", range(5))
def test_matrix_equations_against_lagrange(seed):
    """Free and pinned bars with point masses, drag, oblique gravity, moved pins and a moved anchor, at random states."""
    random = np.random.default_rng(seed)
    model = loaded_structure()
    base = np.zeros((7, 3))
    base[list(model.moving)] = random.normal(size=(3, 3)) * 5.0
    N = model.nodes + random.normal(size=(7, 3)) * 0.1
    V = random.normal(size=(7, 3))
    model = replace(model, rest_length=0.5 * np.linalg.norm(N[model.strings[:, 1]] - N[model.strings[:, 0]], axis=1))
    s = equations.structure(model)
    load = equations.Load(0.0, np.zeros((3, 7)), model.rest_length, np.zeros(7), acceleration=base[list(model.moving)].T)
    mode = taut_mode(s, np.ones(7))
    motion = equations.motion_at(s, load, mode, 0.0, N.T, V.T)
    acceleration, ground = saddle_point(model, N, V, end_forces(model, N, V), base)
    scale = np.abs(ground).max()
    np.testing.assert_allclose(motion.Xdot[:, 7:].T, acceleration, rtol=0.0, atol=1e-12 * np.abs(acceleration).max())
    np.testing.assert_allclose(motion.ground.T, ground, rtol=0.0, atol=1e-12 * scale)
    assert not motion.ground[:, ~model.fixed].any()


def test_the_projection_on_the_constraints_is_orthogonal_in_the_mass_metric():
    model = loaded_structure()
    s = equations.structure(model)
    random = np.random.default_rng(3)
    N, Ndot = model.nodes.T + 0.01 * random.normal(size=(3, 7)), random.normal(size=(3, 7))
    N[:, model.fixed], Ndot[:, model.fixed] = model.nodes[model.fixed].T, 0.0
    onto, onto_dot = equations.on_constraints(s, N, Ndot)
    assert equations.drift(s, onto, onto_dot) < 1e-15
    b = onto @ s.C_b.T
    for _ in range(5):    # any other admissible velocity is farther away
        other = equations.on_constraints(s, onto, random.normal(size=(3, 7)) * ~model.fixed)[1]
        along = (Ndot - onto_dot) @ s.M @ (other - onto_dot).T
        assert abs(np.trace(along)) < 1e-13
    first_moment = (N @ s.M)[:, 4:6].sum(axis=1)    # of the free bar: its centre of mass stays
    np.testing.assert_allclose((onto @ s.M)[:, 4:6].sum(axis=1), first_moment, rtol=1e-15, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(b, axis=0), model.bar_length, rtol=1e-15)


# --- point masses and gravity ------------------------------------------------------------------------------------


def test_free_fall_under_a_gravity_vector():
    v = np.tile([1.0, 2.0, 3.0], (2, 1))
    model = build([(0, 0, 0), (0.6, 0, 0.8)], [], [(0, 1)], [], gravity=OBLIQUE, velocity=v)
    for masses in ((), ((0, 0.5),), ((0, 0.5), (1, 2.0))):
        falling = replace(model, point_mass=masses)
        result = run(falling, grid(2.0, 0.25))
        t = result.times[:, None, None]
        expected = model.nodes + v * t + 0.5 * np.array(OBLIQUE) * t**2
        np.testing.assert_allclose(result.position, expected, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(result.bar_force, 0.0, atol=1e-12)
        fallen = -falling.node_mass @ (expected[-1] - model.nodes) @ np.array(OBLIQUE)
        assert result.potential[-1] - result.potential[0] == pytest.approx(fallen, rel=1e-12)


def test_free_bar_with_end_masses_turns_about_its_centre_of_mass():
    """Torque-free: the centre of mass goes straight, the bar turns evenly; angular momentum, and tension by rotation."""
    m, first, second, length, omega = 1.5, 0.5, 2.0, 1.2, 3.0
    total = m + first + second
    x = (0.5 * m + second) / total    # the centre's place along the bar
    drift, start = np.array([0.3, -0.2, 0.1]), np.array([1.0, 0.0, 0.0])
    across = np.array([0.0, 0.6, 0.8])
    nodes = np.array([-x * length * start, (1.0 - x) * length * start])
    velocity = drift + omega * np.array([-x * length * across, (1.0 - x) * length * across])
    model = replace(build(nodes, [], [(0, 1)], [], mass=m, gravity=0.0, velocity=velocity),
                    point_mass=((0, first), (1, second)))
    result = run(model, grid(4.0, 0.25))
    t = result.times[:, None]
    along = np.cos(omega * t) * start + np.sin(omega * t) * across
    expected = np.stack([drift * t - x * length * along, drift * t + (1.0 - x) * length * along], axis=1)
    np.testing.assert_allclose(result.position, expected, rtol=0.0, atol=1e-10)

    inertia = m * length**2 / 12.0 + m * (0.5 - x) ** 2 * length**2
    inertia += first * (x * length) ** 2 + second * ((1.0 - x) * length) ** 2
    expected = 0.5 * total * drift @ drift + 0.5 * inertia * omega**2
    np.testing.assert_allclose(result.kinetic, expected, rtol=1e-11)
    r, v = result.position, result.velocity
    mean, mean_v, half, half_v = r.mean(axis=1), v.mean(axis=1), 0.5 * (r[:, 1] - r[:, 0]), 0.5 * (v[:, 1] - v[:, 0])
    angular = m * np.cross(mean, mean_v) + m / 3.0 * np.cross(half, half_v)
    angular += first * np.cross(r[:, 0], v[:, 0]) + second * np.cross(r[:, 1], v[:, 1])
    np.testing.assert_allclose(angular, np.tile(inertia * omega * np.cross(start, across), (17, 1)), rtol=0.0, atol=1e-9)

    # the rod's tension at s from the first node carries what turns beyond it; its mean over the rod
    s = np.linspace(0.0, length, 2001)
    tension = omega**2 * (first * x * length + m / length * (x * length * s - 0.5 * s**2))
    np.testing.assert_allclose(result.bar_force, np.trapezoid(tension, s) / length, rtol=1e-6)


def pendulum_angle(t, swing, frequency):
    """theta(t) of theta'' = -frequency^2 sin(theta), released at the angle `swing`."""
    k = math.sin(0.5 * swing)
    sn = ellipj(ellipk(k * k) - frequency * t, k * k)[0]
    return 2.0 * np.arcsin(k * sn)


@pytest.mark.parametrize("free_first", [False, True])
def test_pendulum_with_a_tip_mass(free_first):
    """Large swings against the elliptic integral, in a tilted gravity; a mass at the pivot only adds weight to the reaction."""
    m, tip, pivot, length, swing, g = 0.8, 0.6, 5.0, 1.3, 2.0, 7.0
    down = np.array(OBLIQUE) / g
    aside = np.cross(down, [1.0, 0.0, 0.0])
    aside /= np.linalg.norm(aside)
    nodes = [np.array([0.2, -0.1, 0.4])] * 2
    nodes[1] = nodes[0] + length * (math.cos(swing) * down + math.sin(swing) * aside)
    model = build(nodes, [0], [(1, 0) if free_first else (0, 1)], [], mass=m, gravity=OBLIQUE)
    model = replace(model, point_mass=((0, pivot), (1, tip)))
    result = run(model, grid(5.0, 0.25))
    frequency = math.sqrt((0.5 * m + tip) * g / ((m / 3.0 + tip) * length))
    theta = pendulum_angle(result.times, swing, frequency)[:, None]
    expected = nodes[0] + length * (np.cos(theta) * down + np.sin(theta) * aside)
    np.testing.assert_allclose(result.position[:, 1], expected, rtol=0.0, atol=1e-9)

    # Newton for all that moves: reaction = sum of m a - m g; the energy gives the speed
    turn2 = 2.0 * frequency**2 * (np.cos(theta) - math.cos(swing))
    radial, tangent = np.cos(theta) * down + np.sin(theta) * aside, -np.sin(theta) * down + np.cos(theta) * aside
    acceleration = -length * turn2 * radial - length * frequency**2 * np.sin(theta) * tangent
    reaction = (0.5 * m + tip) * acceleration - (m + tip + pivot) * np.array(OBLIQUE)
    np.testing.assert_allclose(result.reaction[:, 0], reaction, rtol=0.0, atol=1e-7)


# --- drag --------------------------------------------------------------------------------------------------------


def test_projectile_with_drag():
    """A free bar with equal drag at its ends, about its centre of mass: v = v_end + (v_0 - v_end) exp(-2 c t / m)."""
    c, start = 0.7, np.array([4.0, 1.0, 6.0])
    model = build([(0, 0, 0), (0.6, 0, 0.8)], [], [(0, 1)], [], mass=1.5, gravity=OBLIQUE, velocity=np.tile(start, (2, 1)))
    model = replace(model, point_mass=((0, 0.25), (1, 0.25)), drag=((0, c), (1, c)))
    result = run(model, grid(3.0, 0.25))
    rate = 2.0 * c / 2.0
    t, end = result.times[:, None, None], np.array(OBLIQUE) / rate
    fade = -np.expm1(-rate * t) / rate
    np.testing.assert_allclose(result.position, model.nodes + end * t + (start - end) * fade, rtol=0.0, atol=1e-10)
    v = end + (start - end) * np.exp(-rate * t)
    np.testing.assert_allclose(result.velocity, np.broadcast_to(v, result.velocity.shape), rtol=0.0, atol=1e-10)
    fading, once, twice = start - end, -math.expm1(-rate * 3.0) / rate, -math.expm1(-2.0 * rate * 3.0) / (2.0 * rate)
    lost = 2.0 * c * (3.0 * end @ end + 2.0 * once * end @ fading + twice * fading @ fading)
    assert result.dissipated[-1] == pytest.approx(lost, rel=1e-10)


def test_drag_at_the_tip_damps_a_pendulum():
    """Small swings: theta'' + c l^2/I theta' + (m/2 + m_p) g l/I theta = 0."""
    m, tip, c, length, swing = 0.8, 0.6, 1.1, 1.3, 1e-4
    model = build([(0, 0, 0), length * turned([math.sin(swing), 0, -math.cos(swing)])], [0], [(0, 1)], [], mass=m)
    model = replace(model, point_mass=((1, tip),), drag=((1, c),))
    result = run(model, grid(5.0, 0.25))
    inertia = m / 3.0 + tip
    decay, stiff = 0.5 * c / inertia, (0.5 * m + tip) * 9.81 / (inertia * length)
    omega = math.sqrt(stiff - decay**2)
    t = result.times
    theta = swing * np.exp(-decay * t) * (np.cos(omega * t) + decay / omega * np.sin(omega * t))
    np.testing.assert_allclose(result.position[:, 1] @ turned([1, 0, 0]), length * theta, rtol=0.0, atol=2e-12)


# --- bad models --------------------------------------------------------------------------------------------------


def test_models_outside_the_equations_are_refused():
    model = mixed_structure()
    with pytest.raises(InputError, match="moving names the free node 'n2'"):
        equations.structure(replace(model, moving=(0, 1)))
    with pytest.raises(InputError, match="drag names the fixed node 'n1'"):
        equations.structure(replace(model, drag=((0, 1.0), (1, 1.0))))
