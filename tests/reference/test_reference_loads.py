"""The reference with point masses, drag, gravity vectors, moved nodes and actuators, against closed forms and other codes."""

import math
import tomllib
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipj, ellipk

from tensegrity_core import reference
from tensegrity_core.errors import InputError, SimulationError
from tensegrity_core.model import Actuator, grid, held
from tensegrity_core.reference import instant, structure
from tensegrity_core.reference import motors as actuator
from tensegrity_core.scene import parse_scene
from tensegrity_core.statics import build_model
from tests.reference.test_reference import build, mixed_structure, taut_mode
from tests.scene.test_scene_loads import GOOD as CRANE
from tests.support import scene

TIGHT = {"rtol": 1e-12, "atol": 1e-13}
OBLIQUE = (2.0, -3.0, -6.0)  # of length 7


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
    s = structure.Structure(model)
    load = instant.Load(0.0, np.zeros((3, 7)), model.rest_length, np.zeros(7), node_acceleration=base[list(model.moving)].T)
    mode = taut_mode(s, np.ones(7))
    motion = instant.motion_at(s, load, mode, 0.0, N.T, V.T)
    acceleration, ground = saddle_point(model, N, V, end_forces(model, N, V), base)
    scale = np.abs(ground).max()
    np.testing.assert_allclose(motion.Nddot.T, acceleration, rtol=0.0, atol=1e-12 * np.abs(acceleration).max())
    np.testing.assert_allclose(motion.ground.T, ground, rtol=0.0, atol=1e-12 * scale)
    assert not motion.ground[:, ~model.fixed].any()


def test_the_projection_on_the_constraints_is_orthogonal_in_the_mass_metric():
    model = loaded_structure()
    s = structure.Structure(model)
    random = np.random.default_rng(3)
    N, Ndot = model.nodes.T + 0.01 * random.normal(size=(3, 7)), random.normal(size=(3, 7))
    N[:, model.fixed], Ndot[:, model.fixed] = model.nodes[model.fixed].T, 0.0
    onto, onto_dot = instant.on_constraints(s, N, Ndot)
    assert instant.drift(s, onto, onto_dot) < 1e-15
    b = onto @ s.C_b.T
    for _ in range(5):  # any other admissible velocity is farther away
        other = instant.on_constraints(s, onto, random.normal(size=(3, 7)) * ~model.fixed)[1]
        along = (Ndot - onto_dot) @ s.M @ (other - onto_dot).T
        assert abs(np.trace(along)) < 1e-13
    first_moment = (N @ s.M)[:, 4:6].sum(axis=1)  # of the free bar: its centre of mass stays
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
    x = (0.5 * m + second) / total  # the centre's place along the bar
    drift, start = np.array([0.3, -0.2, 0.1]), np.array([1.0, 0.0, 0.0])
    across = np.array([0.0, 0.6, 0.8])
    nodes = np.array([-x * length * start, (1.0 - x) * length * start])
    velocity = drift + omega * np.array([-x * length * across, (1.0 - x) * length * across])
    model = replace(
        build(nodes, [], [(0, 1)], [], mass=m, gravity=0.0, velocity=velocity), point_mass=((0, first), (1, second))
    )
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
        structure.Structure(replace(model, moving=(0, 1)))
    with pytest.raises(InputError, match="drag names the fixed node 'n1'"):
        structure.Structure(replace(model, drag=((0, 1.0), (1, 1.0))))


# --- moved nodes -------------------------------------------------------------------------------------------------


def pivoted(tip=0.6, m=0.8, length=1.3, angle=0.5, **options):
    """A pendulum whose pivot n1 is moved, in the plane that `turned` makes of x-z."""
    nodes = [(0, 0, 0), length * turned([math.sin(angle), 0.0, -math.cos(angle)])]
    model = build(nodes, [0], [(0, 1)], [], mass=m, **options)
    return replace(model, point_mass=((0, 1.1), (1, tip)), moving=(0,))


def moved_inputs(model, times, x, v, a):
    """Held inputs of one moved node: x, v, a (K, 2) in the plane of the pendulum."""
    arrays = [turned(np.insert(part, 1, 0.0, axis=1))[:, None] for part in (x, v, a)]
    return replace(held(model, times), node_position=arrays[0], node_velocity=arrays[1], node_acceleration=arrays[2])


def stepwise(times, acceleration):
    """Positions and velocities (K, 2) of a node that starts at rest with constant accelerations (K, 2) over each step."""
    x, v = [np.zeros(2)], [np.zeros(2)]
    for tau, a in zip(np.diff(times), acceleration):
        x.append(x[-1] + tau * (v[-1] + 0.5 * tau * a))
        v.append(v[-1] + tau * a)
    return np.array(x[:-1]), np.array(v[:-1])


def driven_pendulum(model, times, acceleration, angle, speed=0.0):
    """theta and theta' (K+1,) by SciPy on theta'' = -(m/2 + m_p)/((m/3 + m_p) l) (a_x cos theta + (g + a_z) sin theta);
    acceleration(t, k): (a_x, a_z) of the pivot at t, within step k."""
    m, tip, length = model.bar_mass[0], dict(model.point_mass)[1], model.bar_length[0]
    factor = (0.5 * m + tip) / ((m / 3.0 + tip) * length)
    found = [np.array([angle, speed])]
    for k, (t, end) in enumerate(pairwise(times)):

        def ydot(t, y, k=k):
            ax, az = acceleration(t, k)
            return y[1], -factor * (ax * math.cos(y[0]) + (9.81 + az) * math.sin(y[0]))

        found.append(solve_ivp(ydot, (t, end), found[-1], method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1])
    return np.array(found).T


def pointing(theta):
    """(K, 3) unit vectors from pivot to tip, and across."""
    zero = 0.0 * theta
    radial = turned(np.stack([np.sin(theta), zero, -np.cos(theta)], axis=1))
    return radial, turned(np.stack([np.cos(theta), zero, np.sin(theta)], axis=1))


def test_pendulum_on_an_oscillating_pivot():
    """Accelerations that change step by step without jumps of position or velocity, against SciPy on the angle's equation."""
    times, model = grid(3.0, 0.1), pivoted()
    a = np.stack([9.0 * np.cos(7.0 * times[:-1]), -12.0 * np.sin(11.0 * times[:-1])], axis=1)
    x, v = stepwise(times, a)
    result = reference.simulate(model, moved_inputs(model, times, x, v, a), **TIGHT)
    theta, turning = driven_pendulum(model, times, lambda t, k: a[k], 0.5)
    assert np.ptp(theta) > 0.8
    radial, across = pointing(theta)
    c = result.position[:, 1] - result.position[:, 0]
    np.testing.assert_allclose(c, 1.3 * radial, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(result.position[:-1, 0], turned(np.insert(x, 1, 0.0, axis=1)), rtol=0.0, atol=1e-13)
    assert not result.velocity[:, 0].any()

    # the mover's force moves the pivot's mass, the bar and the tip's mass; rows belong to the step that led there
    of_row = np.concatenate((a[:1], a))
    turns = -(0.4 + 0.6) / ((0.8 / 3.0 + 0.6) * 1.3) * (of_row[:, 0] * np.cos(theta) + (9.81 + of_row[:, 1]) * np.sin(theta))
    c_dotdot = 1.3 * (turns[:, None] * across - turning[:, None] ** 2 * radial)
    reaction = (0.8 + 0.6 + 1.1) * turned(np.stack([of_row[:, 0], 0.0 * theta, of_row[:, 1] + 9.81], axis=1)) + c_dotdot
    np.testing.assert_allclose(result.reaction[:, 0], reaction, rtol=0.0, atol=1e-7)

    assert result.ledger_error() < 1e-9
    energy = result.kinetic + result.potential
    np.testing.assert_allclose(result.input_work, energy - energy[0], rtol=0.0, atol=1e-8)
    assert np.ptp(result.input_work) > 1.0 and result.throughput[-1] > np.ptp(result.input_work)


def swaying(t):
    """Position and velocity of a pivot that sways smoothly from rest."""
    position = [[0.4 * (1.0 - math.cos(5.0 * t)), 0.0, 0.1 * (1.0 - math.cos(8.0 * t))]]
    return turned(position), turned([[2.0 * math.sin(5.0 * t), 0.0, 0.8 * math.sin(8.0 * t)]])


def swayed_errors(inputs_of):
    """Errors of the tip at 2 s under samples of `swaying` at two step sizes, one half of the other."""
    model = pivoted()
    (theta,), _ = np.split(
        driven_pendulum(model, [0.0, 2.0], lambda t, k: (10.0 * math.cos(5.0 * t), 6.4 * math.cos(8.0 * t)), 0.5), 2
    )
    exact = np.array(swaying(2.0)[0][0]) + 1.3 * pointing(theta)[0][-1]
    runs = [reference.simulate(model, inputs_of(model, grid(2.0, h))) for h in (0.01, 0.005)]
    assert max(run.ledger_error() for run in runs) < 1e-8
    return [np.linalg.norm(run.position[-1, 1] - exact) for run in runs]


def test_sampled_motion_converges_with_the_square_of_the_step():
    coarse, fine = swayed_errors(lambda model, times: held(model, times, motion=swaying))
    assert coarse < 2e-3 and 3.7 < coarse / fine < 4.3


def test_held_velocities_without_acceleration_still_converge():
    """Each communication point gives an impulse; their sum is what the acceleration would have done."""

    def inputs_of(model, times):
        inputs = held(model, times, motion=swaying)
        return replace(inputs, node_acceleration=0.0 * inputs.node_acceleration)

    coarse, fine = swayed_errors(inputs_of)
    assert coarse < 0.1 and 1.8 < coarse / fine < 2.2


@pytest.mark.parametrize("start", [True, False])
@pytest.mark.parametrize("reverse", [True, False])
def test_impulse_of_a_velocity_jump(start, reverse):
    """c' = -kappa P dv, then c turns evenly about the pivot.  At the start the jump is before the ledger's time."""
    m, tip, pivot, length = 0.8, 0.6, 1.1, 1.3
    model = pivoted(gravity=0.0)
    model = replace(model, bars=[(1, 0)]) if reverse else model
    times, dv = grid(1.0, 0.125), np.array([0.9, -0.4])
    jump_at = 0 if start else 3
    v = np.zeros((8, 2))
    v[jump_at:] = dv
    x = np.concatenate((np.zeros((1, 2)), np.cumsum(v * 0.125, axis=0)))[:-1]
    result = reference.simulate(model, moved_inputs(model, times, x, v, 0.0 * v), **TIGHT)

    c, dv = model.nodes[1] - model.nodes[0], turned([dv[0], 0.0, dv[1]])
    c_dot = -(0.5 * m + tip) / (m / 3.0 + tip) * (dv - c * (c @ dv) / (c @ c))
    speed = np.linalg.norm(c_dot)
    turning = speed / length * np.maximum(result.times - times[jump_at], 0.0)[:, None]
    expected = np.cos(turning) * c + np.sin(turning) * length / speed * c_dot
    np.testing.assert_allclose(result.position[:, 1] - result.position[:, 0], expected, rtol=0.0, atol=1e-11)

    v_tip = dv + c_dot
    kinetic = 0.5 * ((m / 3.0 + pivot) * dv @ dv + m / 3.0 * dv @ v_tip + (m / 3.0 + tip) * v_tip @ v_tip)
    after = jump_at + 1
    assert result.kinetic[0] == pytest.approx(kinetic if start else 0.0, rel=1e-12)
    # from there on the mover only keeps the pivot on its way
    along = np.cos(turning) * c_dot * length - np.sin(turning) * speed * c
    force = -(0.5 * m + tip) * (speed / length) ** 2 * expected
    np.testing.assert_allclose(result.reaction[after:, 0], force[after:], rtol=0.0, atol=1e-9)
    swing = (0.5 * m + tip) * (along[after:] / length - c_dot) @ dv
    booked = swing + (0.0 if start else kinetic)
    np.testing.assert_allclose(result.input_work[after:], booked, rtol=0.0, atol=1e-10)
    assert result.ledger_error() < 1e-10


def test_position_jump_carries_the_bar_along_without_impulse():
    """Weights are lifted and a string stretched, which is work; then the motion is that from the new place on."""
    model = build([(0, 0, 0), (0.6, 0, -0.8), (2, 0, 0)], [0, 2], [(0, 1)], [(1, 2)], k=50.0, rest=[0.1])
    model = replace(model, moving=(0,), point_mass=((0, 0.3), (1, 0.5)))
    shift, still = np.array([-0.05, 0.02, 0.3]), held(model, grid(0.3, 0.1))
    alone = reference.simulate(model, still, **TIGHT)
    position = np.array(still.node_position)
    position[1:] += shift
    result = reference.simulate(model, replace(still, node_position=position), **TIGHT)
    np.testing.assert_allclose(result.position[:2], alone.position[:2], rtol=0.0, atol=1e-11)

    moved = replace(model, nodes=alone.position[1] + [shift, shift, 0.0 * shift], velocity=alone.velocity[1], moving=())
    after = reference.simulate(moved, held(moved, grid(0.2, 0.1)), **TIGHT)
    np.testing.assert_allclose(result.position[2:], after.position[1:], rtol=0.0, atol=1e-10)
    elongation = np.linalg.norm(np.diff(np.stack([alone.position[1], moved.nodes])[:, 1:], axis=1), axis=2)[:, 0] - 0.1
    work = 25.0 * (elongation[1] ** 2 - elongation[0] ** 2) + 9.81 * (1.0 + 0.3 + 0.5) * shift[2]
    np.testing.assert_allclose(result.input_work, [0.0, 0.0, work, work], rtol=0.0, atol=1e-10)
    assert result.ledger_error() < 1e-11


def test_moved_anchor_pulls_a_bar():
    """A bar of 1 kg on a string along its line, whose anchor accelerates by a: the elongation z follows z'' = -k z - a."""
    k, a, p = 400.0, -3.0, 0.7
    model = build([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [0], [(1, 2)], [(0, 1)], k=k, gravity=0.0, rest=[0.99])
    model = replace(model, moving=(0,), point_mass=((0, p),))
    times = grid(1.0, 0.125)
    inputs = held(model, times, motion=lambda t: ([[0.5 * a * t * t, 0.0, 0.0]], [[a * t, 0.0, 0.0]]))
    result = reference.simulate(model, inputs, **TIGHT)
    t, omega = times, math.sqrt(k)
    elongation = -a / k + (0.01 + a / k) * np.cos(omega * t)
    assert elongation.min() > 0.0 and not result.transitions
    np.testing.assert_allclose(result.string_length[:, 0], 0.99 + elongation, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(result.reaction[:, 0, 0], p * a - k * elongation, rtol=0.0, atol=1e-8)
    assert result.ledger_error() < 1e-10 and abs(result.input_work[-1]) > 0.1


# --- actuators ---------------------------------------------------------------------------------------------------

MOTOR = Actuator(inertia=0.02, damping=0.05, torque_constant=0.4, radius=0.1)


def winch(rest, motor=MOTOR, current=0.0, k=300.0, d=4.0):
    """A string of 1 m between two anchors, with an actuator; the bar beside it hangs at rest."""
    model = build([(0, 0, 0), (0.6, 0, 0.8), (5, 0, 1), (5, 0, 0)], [0, 1, 2], [(2, 3)], [(0, 1)], k=k, d=d, rest=[rest])
    return replace(model, actuator=(motor,), current=[current])


def underdamped(t, decay, stiff, x, v):
    """x(t) and x'(t) of x'' + 2 decay x' + stiff x = 0 from x, v."""
    omega = np.sqrt(stiff - decay**2)
    fade, c, s = np.exp(-decay * t), np.cos(omega * t), np.sin(omega * t)
    return fade * (x * c + (v + decay * x) / omega * s), fade * (v * c - (decay * v + stiff * x) / omega * s)


def test_motor_on_a_blocked_string():
    """J delta'' + (d_a + r^2 d) delta' + r^2 k delta = k_a i - r T_0 after a step of the current."""
    J, d_a, k_a, r = MOTOR.inertia, MOTOR.damping, MOTOR.torque_constant, MOTOR.radius
    start_tension = 300.0 * 0.05
    model = winch(0.95, current=r * start_tension / k_a)
    at_rest = run(model, grid(0.5, 0.25))
    np.testing.assert_allclose(at_rest.motor_speed, 0.0, atol=1e-11)

    result = run(model, grid(2.0, 0.125), current=lambda t: model.current + (5.0 if t > 0.25 else 0.0))
    t = np.maximum(result.times - 0.25, 0.0)
    end = k_a * 5.0 / (r**2 * 300.0)
    decay = 0.5 * (d_a + r**2 * 4.0) / J
    delta, speed = underdamped(t, decay, r**2 * 300.0 / J, -end, 0.0)
    delta = delta + end
    np.testing.assert_allclose(result.wound_rest_length[:, 0], 0.95 - r * delta, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(result.motor_speed[:, 0], speed, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(result.elastic_force[:, 0], start_tension + 300.0 * r * delta, rtol=0.0, atol=1e-8)
    tension = result.elastic_force[:, 0] + 4.0 * r * speed
    np.testing.assert_allclose(result.string_force[:, 0], tension, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(result.reaction[:, 1, 0], 0.6 * tension, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(result.kinetic, 0.5 * J * speed**2, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(result.input_work, k_a * (model.current[0] + 5.0) * delta, rtol=0.0, atol=1e-9)


def test_motor_on_a_slack_string_until_it_is_taut():
    """The speed approaches k_a i / d_a; where the drum has taken in the slack the string becomes taut and throws it back."""
    J, d_a, k_a, r = MOTOR.inertia, MOTOR.damping, MOTOR.torque_constant, MOTOR.radius
    slack, fast, lag = 0.3, k_a * 0.6 / d_a, J / d_a
    model = winch(1.0 + slack)
    result = run(model, grid(1.6, 0.1), current=lambda t: [0.6])

    def angle(t):
        return fast * (t + lag * np.expm1(-t / lag))

    taut = brentq(lambda t: r * angle(t) - slack, 0.1, 1.6, xtol=1e-15)
    impact, decay, stiff = -fast * math.expm1(-taut / lag), 0.5 * (d_a + r**2 * 4.0) / J, r**2 * 300.0 / J
    end = k_a * 0.6 / (J * stiff)
    back = taut + brentq(lambda t: underdamped(t, decay, stiff, -end, impact)[0] + end, 0.1, 0.4, xtol=1e-15)
    assert [(tr.string, tr.before, tr.after) for tr in result.transitions[:2]] == [(0, 0, 1), (0, 1, 0)]
    np.testing.assert_allclose([tr.time for tr in result.transitions[:2]], [taut, back], rtol=0.0, atol=1e-11)
    free, tied = result.times < taut, (result.times > taut) & (result.times < back)
    assert free.sum() > 5 and tied.sum() > 1
    np.testing.assert_allclose(result.motor_speed[free, 0], -fast * np.expm1(-result.times[free] / lag), rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(result.wound_rest_length[free, 0], 1.3 - r * angle(result.times[free]), rtol=0.0, atol=1e-11)
    delta, speed = underdamped(result.times[tied] - taut, decay, stiff, -end, impact)
    np.testing.assert_allclose(result.wound_rest_length[tied, 0], 1.0 - r * (delta + end), rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(result.motor_speed[tied, 0], speed, rtol=0.0, atol=1e-8)


def test_motor_and_bar_swing_against_each_other():
    """A linear motor (r = 1) without damping pulls a bar of 1 kg along its line: z'' = -(1/m + 1/J) k z + k_a i/J of the
    elongation, and m u + J delta' = k_a i t with the bar's speed u = delta' - z' towards the motor."""
    motor = Actuator(inertia=3.0, damping=0.0, torque_constant=2.0, radius=1.0)
    model = build([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [0], [(1, 2)], [(0, 1)], k=90.0, gravity=0.0, rest=[0.98])
    model = replace(model, actuator=(motor,))
    result = run(model, grid(0.75, 0.125), current=lambda t: [2.7])
    t, omega, mean = result.times, math.sqrt(120.0), 2.0 * 2.7 / 3.0 / 120.0
    z, z_dot = mean + (0.02 - mean) * np.cos(omega * t), -(0.02 - mean) * omega * np.sin(omega * t)
    speed = (2.0 * 2.7 * t + z_dot) / 4.0
    np.testing.assert_allclose(result.elastic_force[:, 0], 90.0 * z, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(result.motor_speed[:, 0], speed, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(result.velocity[:, 1, 0], z_dot - speed, rtol=0.0, atol=1e-10)
    assert not result.transitions


@pytest.mark.parametrize("current, taut", [(0.5, 1), (-0.5, 0)])
def test_string_at_its_rest_length_follows_the_motor(current, taut):
    """Neither stretched nor moving: it is taut at once if the motor winds in, and slack if it pays out."""
    result = run(winch(1.0), grid(0.1, 0.05), current=lambda t: [current])
    assert not result.transitions
    assert (result.string_force[-1, 0] > 0.0) == bool(taut)


@pytest.mark.parametrize("pull", [-1.0, 1.0])
def test_string_at_its_rest_length_follows_the_moved_anchor(pull):
    model = build([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [0], [(1, 2)], [(0, 1)], gravity=0.0, rest=[1.0])
    model = replace(model, moving=(0,))
    inputs = held(model, grid(0.02, 0.01))
    acceleration = np.array(inputs.node_acceleration)
    acceleration[0, 0, 0] = pull
    result = reference.simulate(model, replace(inputs, node_acceleration=acceleration))
    assert not [transition for transition in result.transitions if transition.time < 0.01]
    assert (result.string_force[1, 0] > 0.0) == (pull < 0.0)


@pytest.mark.parametrize("damping", [0.0, 1e-5, 0.019, 50.0])
def test_an_actuator_is_eq_8_and_its_powers_balance(damping):
    """J_a delta'' + d_a delta' = k_a i - r T; what is put in, less what is lost and what the string takes, is stored."""
    motors = actuator.motors_of(winch(1.0, replace(MOTOR, damping=damping)))
    current, tension, speed = np.array([3.0]), np.array([7.0]), np.array([-1.5])
    acceleration = actuator.acceleration(motors, current, tension, speed)
    np.testing.assert_allclose(0.02 * acceleration + damping * speed, 0.4 * current - 0.1 * tension, rtol=1e-14)
    stored = motors.inertia * speed * acceleration  # the derivative of J_a delta'^2 / 2
    put_in, lost = actuator.input_power(motors, current, speed), actuator.lost_power(motors, speed)
    np.testing.assert_allclose(stored, put_in - lost - 0.1 * tension * speed, rtol=1e-13)
    assert actuator.kinetic_energy(motors, speed) == pytest.approx(0.01 * 1.5**2)


def test_a_string_that_is_wound_up_ends_the_run():
    model = winch(0.95, current=100.0)
    with pytest.raises(SimulationError, match="actuator of string 's1' has wound it up completely") as caught:
        reference.simulate(model, held(model, grid(5.0, 0.5)))
    assert caught.value.status == "wound_up" and 0.0 < caught.value.time < 5.0


# --- all at once -------------------------------------------------------------------------------------------------


def everything(law="literal"):
    """The loaded structure with two actuators (one of them on a slack string), at rest, and inputs that jump at random."""
    model = loaded_structure()
    rest = np.array(model.rest_length)
    rest[4] += 0.1
    motors = {1: Actuator(0.05, 0.2, 0.5, 0.05), 4: Actuator(0.8, 1.0, 2.0, 1.0)}
    model = replace(model, actuator=tuple(motors.get(i) for i in range(7)), rest_length=rest, damping_law=law)
    random, times = np.random.default_rng(11), grid(0.5, 0.05)
    shape = (10, 3, 3)
    inputs = replace(
        held(model, times, force=lambda t: random.normal(size=(7, 3)) * 5.0, current=lambda t: random.normal(size=2) * 4.0),
        node_position=model.nodes[[0, 3, 6]] + random.normal(size=shape) * 0.01,
        node_velocity=random.normal(size=shape) * 0.3,
        node_acceleration=random.normal(size=shape) * 5.0,
        rest_length=rest + random.normal(size=(10, 7)) * 0.01,
        rest_length_rate=random.normal(size=(10, 7)) * 0.2,
    )
    return model, inputs


@pytest.mark.parametrize("law", ["literal", "tension_only"])
def test_everything_at_once(law):
    """The ledger closes over jumps of all inputs; bars keep their length; explicit and implicit integration agree."""
    model, inputs = everything(law)
    explicit = reference.simulate(model, inputs, method="DOP853", **TIGHT)
    assert explicit.ledger_error() < 1e-9
    assert explicit.dissipated[-1] > 1.0 and len(explicit.transitions) > 3
    assert {transition.string for transition in explicit.transitions} & {1, 4}
    b = np.diff(explicit.position[:, model.bars], axis=2)[:, :, 0]
    np.testing.assert_allclose(np.linalg.norm(b, axis=2), np.broadcast_to(model.bar_length, b.shape[:2]), rtol=1e-14)
    implicit = reference.simulate(model, inputs, method="Radau", rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(implicit.position, explicit.position, rtol=0.0, atol=2e-9)
    np.testing.assert_allclose(implicit.wound_rest_length, explicit.wound_rest_length, rtol=0.0, atol=2e-9)
    assert [(t.string, t.after) for t in implicit.transitions] == [(t.string, t.after) for t in explicit.transitions]


def test_fastest_rate_is_a_bound():
    """On the decay of velocities and motor speeds, from differences; strings taut, strong dampers between nodes and motors."""
    model, _ = everything()
    motors = {1: Actuator(0.05, 0.2, 0.5, 0.05), 4: Actuator(0.002, 1.0, 2.0, 0.3)}
    model = replace(model, actuator=tuple(motors.get(i) for i in range(7)), damping=np.full(7, 500.0))
    s, free = structure.Structure(model), model.free_nodes
    load = instant.Load(0.0, np.zeros((3, 7)), model.rest_length, np.zeros(7), np.zeros(2), 0.0, *np.zeros((3, 3, 3)))
    mode, count = taut_mode(s, np.ones(7)), 3 * len(free)

    def accelerations(rates):
        Ndot = np.zeros((3, 7))
        Ndot[:, free] = rates[:count].reshape(3, -1)
        motion = instant.motion_at(s, load, mode, 0.0, model.nodes.T, Ndot, np.stack([np.zeros(2), rates[count:]]))
        return np.concatenate((motion.Nddot[:, free].ravel(), motion.winding))

    at_rest = accelerations(np.zeros(count + 2))
    slowing = np.array([accelerations(1e-4 * e) - at_rest for e in np.eye(count + 2)]).T / 1e-4
    fastest = np.abs(np.linalg.eigvals(slowing)).max()
    assert fastest > 2e4 and 1.0 <= instant.fastest_rate(s) / fastest < 2.5


def test_scene_with_actuators_stands_still_under_its_start_currents():
    model = build_model(parse_scene(tomllib.loads(CRANE)))
    result = reference.simulate(model, held(model, grid(0.3, 0.1)), **TIGHT)
    assert np.abs(result.position - model.nodes).max() < 1e-9
    np.testing.assert_allclose(result.wound_rest_length, np.tile(model.rest_length[[1, 2]], (4, 1)), rtol=0.0, atol=1e-9)
    weight = model.node_mass.sum() * np.array(model.gravity)
    np.testing.assert_allclose(result.reaction.sum(axis=1), np.tile(-weight, (4, 1)), rtol=0.0, atol=1e-7)


def test_planar_scene_ignores_inputs_across_its_plane():
    model = replace(scene("two_bar"), moving=(0,), gravity=(1.0, 0.0, -9.0))
    inputs = held(model, grid(0.1, 0.05), motion=lambda t: ([[0.1 * t, 0.3 + t, 0.0]], [[0.1, 1.0, 0.0]]))
    result = reference.simulate(model, inputs)
    assert not result.position[:, :, 1].any() and result.position[-1, 0, 0] == pytest.approx(0.01)
    assert not result.reaction[:, :, 1].any() and result.ledger_error() < 1e-9


def test_bad_inputs_are_named():
    model, inputs = everything()
    for name in ("current", "node_position", "node_velocity", "node_acceleration"):
        good = getattr(inputs, name)
        with pytest.raises(InputError, match=rf"{name} has shape \(9, "):
            reference.simulate(model, replace(inputs, **{name: good[1:]}))
        with pytest.raises(InputError, match=f"{name} holds a value that is not finite"):
            reference.simulate(model, replace(inputs, **{name: np.full_like(good, math.inf)}))
    ignored = np.array(inputs.rest_length)
    ignored[:, [1, 4]] = -1.0  # wound by actuators
    reference.simulate(model, replace(inputs, rest_length=ignored, times=grid(0.01, 0.001)))
