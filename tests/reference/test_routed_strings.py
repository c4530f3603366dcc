"""Routed strings, strings with mass and springs that push, in the reference: closed forms, and forces from the energy alone."""

from __future__ import annotations

import dataclasses
from itertools import pairwise

import numpy as np
import pytest

from tensegrity_core import reference
from tensegrity_core.equilibria.modes import mass_matrix, modes
from tensegrity_core.errors import InputError
from tensegrity_core.model import NSH, Actuator, Inputs, Model, grid, held
from tensegrity_core.model.elements import Beam, Polynomial, Series
from tensegrity_core.reference import instant
from tensegrity_core.reference.structure import Structure
from tests.kernel.test_random_scenes import random_inputs, random_model
from tests.support import by_hand
from tests.support.driven_scenes import LABORATORY, built
from tests.support.jointed_scenes import random_forces, random_joints
from tests.support.routed_scenes import routed

TIGHT = {"rtol": 1e-12, "atol": 1e-14}
GRAVITY = 9.81


def run(model, duration, step, **signals):
    return reference.simulate(model, held(model, grid(duration, step), **signals), **TIGHT)


@pytest.mark.parametrize("pulleys", [[[0.0, 0.0, 0.0]], [[-0.2, 0.0, 0.1], [0.3, 0.0, 0.3], [0.5, 0.0, 0.0]]])
@pytest.mark.parametrize("d", [0.0, 3.0])
def test_atwood(pulleys, d):
    """Two masses on a string over fixed pulleys, straight down from the first and the last of them: the elongation x is a
    damped oscillator, m x'' = 2 m g - (k x + d x') with 1/m = 1/m1 + 1/m2, and m1 a - m2 b falls freely."""
    m1, m2, k, hang = 1.3, 0.8, 600.0, (0.9, 1.4)
    count = len(pulleys)
    nodes = [np.add(pulleys[0], [0, 0, -hang[0]]), *np.array(pulleys), np.add(pulleys[-1], [0, 0, -hang[1]])]
    path = tuple(range(count + 2))
    between = np.linalg.norm(np.diff(np.array(pulleys), axis=0), axis=1).sum()
    rest = sum(hang) + between - 0.01
    masses = [(0, m1), (count + 1, m2)]
    fields = {"stiffness": k, "damping": d, "rest_length": rest, "gravity": GRAVITY, "axes": (0, 2), "point_mass": masses}
    model = by_hand(nodes, range(1, count + 1), [], [path], **fields)
    result = run(model, 0.6, 0.02)
    t, m = result.times, 1.0 / (1.0 / m1 + 1.0 / m2)
    rate = complex(-d / (2.0 * m), np.sqrt(k / m - (d / (2.0 * m)) ** 2))
    level = 2.0 * m * GRAVITY / k
    start = 0.01 - level
    x = level + (start * (1.0 + 1j * rate.real / rate.imag) * np.exp(rate * t)).real
    difference = m1 * hang[0] - m2 * hang[1] + 0.5 * (m1 - m2) * GRAVITY * t**2
    total = rest + x - between
    first = (difference + m2 * total) / (m1 + m2)
    np.testing.assert_allclose(result.position[:, 0, 2], pulleys[0][2] - first, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(result.position[:, -1, 2], pulleys[-1][2] - (total - first), rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(result.string_length[:, 0], rest + x, rtol=0.0, atol=1e-10)
    assert (x > 0.0).all() and result.ledger_error() < 1e-10
    # the pulleys bear the tension's pull on both sides
    T = result.string_force[:, 0]
    np.testing.assert_allclose(result.reaction[:, 1:-1, 2].sum(axis=1), 2.0 * T, rtol=1e-12)
    np.testing.assert_allclose(result.reaction[:, 1:-1, 0].sum(axis=1), 0.0, atol=1e-9)


@pytest.mark.parametrize("corners", [3, 5])
def test_endless_loop(corners):
    """Masses at the corners of a regular polygon, an endless string around them: with the radius r each is pulled inwards with
    2 T sin(pi/n), and the length is 2 n r sin(pi/n); so r is an oscillator with w^2 = 4 n sin^2(pi/n) k / m."""
    m, k, r = 0.7, 300.0, 0.5
    angle = 2.0 * np.pi * np.arange(corners) / corners + 0.2
    nodes = r * np.array([np.cos(angle), np.sin(angle), 0.0 * angle]).T
    half = np.sin(np.pi / corners)
    rest = 2.0 * corners * half * 0.46
    loop = (*range(corners), 0)
    model = by_hand(nodes, [], [], [loop], stiffness=k, rest_length=rest, point_mass=[(i, m) for i in range(corners)])
    result = run(model, 0.02, 0.001)
    w = np.sqrt(4.0 * corners * half**2 * k / m)
    radius = 0.46 + (r - 0.46) * np.cos(w * result.times)
    assert (result.string_force > 0.0).all()
    expected = radius[:, None, None] / r * nodes
    np.testing.assert_allclose(result.position, expected, rtol=0.0, atol=1e-11)


SNAPPING = {"nsh": (NSH((6.0, 8.0), (3.0, 5.0), (0.01, 0.012)),)}
MEMORY = {"element": (Series((Beam(8.0, 5.0, 0.01), Beam(10.0, 6.0, 0.012)), "hysteretic"),)}


@pytest.mark.parametrize(
    "law",
    [{}, SNAPPING, MEMORY, {"damper": (Polynomial((2.0, 0.0, 30.0)),)}, {"two_way": [True]}, {"damping_law": "tension_only"}],
    ids=["spring", "nsh", "memory", "damper", "two_way", "clipped"],
)
@pytest.mark.parametrize("wound", [False, True], ids=["", "wound"])
def test_over_pulleys_in_line_it_is_a_plain_string(law, wound):
    """Fixed nodes on the straight line of a string change nothing, whatever the string is made of."""
    motor = Actuator(0.02, 0.1, 0.5, 0.03)
    fields = {"stiffness": 900.0, "damping": 0.0 if "damper" in law else 4.0, "rest_length": 1.99, "point_mass": [(1, 0.6)]}
    fields |= {"actuator": (motor,), "current": [0.1]} if wound else {}
    nodes = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.4, 0.0, 0.0], [1.1, 0.0, 0.0]]
    plain, routed_one = (by_hand(nodes, [0, 2, 3], [], [path], **fields | law) for path in ((0, 1), (0, 2, 3, 1)))
    force = np.zeros((6, 4, 3))
    force[:, 1, 0] = [30.0, -20.0, 25.0, -40.0, 35.0, 0.0]
    ours, theirs = (
        reference.simulate(one, Inputs(grid(0.12, 0.02), force).resolved(one), **TIGHT) for one in (routed_one, plain)
    )
    assert len(theirs.transitions) > (0 if "two_way" not in law else -1)
    assert [(one.string, one.before, one.after) for one in ours.transitions] == [
        (one.string, one.before, one.after) for one in theirs.transitions
    ]
    for name in ("position", "string_length", "string_force", "elastic", "dissipated", "input_work"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize("law", ["literal", "tension_only"])
def test_two_way_spring_swings_through_its_rest_length(law):
    """A mass on a spring that also pushes: a damped oscillator, and no transition."""
    m, k, d, amplitude = 0.8, 200.0, 2.0, 0.1
    nodes = [[0.0, 0.0, 0.0], [1.0 + amplitude, 0.0, 0.0]]
    fields = {"stiffness": k, "damping": d, "rest_length": 1.0, "two_way": [True], "damping_law": law}
    result = run(by_hand(nodes, [0], [], [(0, 1)], point_mass=[(1, m)], **fields), 2.0, 0.05)
    decay = d / (2.0 * m)
    w = np.sqrt(k / m - decay**2)
    x = amplitude * np.exp(-decay * result.times) * (np.cos(w * result.times) + decay / w * np.sin(w * result.times))
    np.testing.assert_allclose(result.position[:, 1, 0], 1.0 + x, rtol=0.0, atol=1e-10)
    assert x.min() < -0.05 and result.transitions == [] and result.ledger_error() < 1e-10
    np.testing.assert_allclose(result.elastic_force[:, 0], k * x, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(result.elastic, 0.5 * k * x**2, rtol=0.0, atol=1e-9)


def test_string_mass_is_point_masses():
    """Shares of the mass at the nodes act like point masses of their size: inertia, weight and reactions."""
    nodes = [[0.0, 0.0, 0.0], [0.5, 0.1, -0.3], [1.2, 0.0, -0.1], [0.6, 0.2, -1.0]]
    fields = {"stiffness": 400.0, "damping": 1.0, "rest_length": [1.2, 0.9], "gravity": GRAVITY}
    strings = [(0, 1, 2), (1, 3)]
    heavy = by_hand(nodes, [0, 2], [], strings, string_mass=[0.3, 0.5], **fields)
    masses = sorted(heavy.payload.items())
    assert [node for node, _ in masses] == [0, 1, 2, 3] and sum(mass for _, mass in masses) == pytest.approx(0.8)
    assert masses[3][1] == 0.25 and heavy.lone_nodes.tolist() == [1, 3]
    light = by_hand(nodes, [0, 2], [], strings, point_mass=masses, **fields)
    ours, theirs = run(heavy, 0.3, 0.1), run(light, 0.3, 0.1)
    for name in ("position", "reaction", "kinetic", "potential"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-10, atol=1e-10, err_msg=name)


@pytest.mark.parametrize("matrix, part", [("lumped", 1 / 2), ("consistent", 1 / 3)])
def test_mass_of_a_spring_in_its_frequency(matrix, part):
    """A third of a spring's mass swings with its moving end where segments move like thin bars, half of it if lumped."""
    M, m, k = 0.9, 0.6, 150.0
    model = by_hand(
        [[0.0, 0.0, 0.0], [1.1, 0.0, 0.0]],
        [0],
        [],
        [(0, 1)],
        stiffness=k,
        rest_length=1.0,
        point_mass=[(1, M)],
        two_way=[True],
        string_mass=[m],
        string_mass_matrix=matrix,
        axes=(0, 2),
    )
    w = np.sqrt(k / (M + part * m))
    result = run(model, 1.0, 0.05)
    np.testing.assert_allclose(result.position[:, 1, 0], 1.0 + 0.1 * np.cos(w * result.times), rtol=0.0, atol=1e-11)
    slow = [mode.frequency for mode in modes(dataclasses.replace(model, nodes=[[0, 0, 0], [1, 0, 0]])) if mode.oscillates]
    assert slow == pytest.approx([w / (2.0 * np.pi)], rel=1e-12)
    assert model.node_mass.tolist() == pytest.approx([0.5 * m, M + 0.5 * m])
    assert bool(model.joint) == (matrix == "consistent")


def test_consistent_mass_of_a_routed_string_is_that_of_thin_bars():
    """Over two segments of 0.3 and 0.7 of its length: against the mass matrix written down."""
    nodes = [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.3, 0.7, 0.0]]
    fields = {"stiffness": 100.0, "rest_length": 1.0, "string_mass": [2.0], "string_mass_matrix": "consistent"}
    model = by_hand(nodes, [], [], [(0, 1, 2)], **fields)
    first, second = 0.3 * 2.0 / 6.0, 0.7 * 2.0 / 6.0
    M = np.array([[2 * first, first, 0.0], [first, 2 * (first + second), second], [0.0, second, 2 * second]])
    np.testing.assert_allclose(Structure(model).M, M, rtol=1e-14)
    np.testing.assert_allclose(mass_matrix(model), np.kron(M, np.eye(3)), rtol=1e-14)
    np.testing.assert_allclose(model.node_mass, [0.3, 1.0, 0.7], rtol=1e-14)


def test_massless_node_of_a_string_is_refused():
    with pytest.raises(InputError, match="free node 'n2' belongs to no bar and so has no mass"):
        run(by_hand([[0, 0, 0], [1, 0, 0]], [0], [], [(0, 1)], stiffness=1.0, rest_length=1.0), 0.1, 0.1)


# --- forces from the energy -----------------------------------------------------------------------------------------


def energy(model: Model, x: np.ndarray) -> complex:
    """J stored in springs at coordinates x (N, 3), which may be complex: differentiated by the complex step."""
    total = 0.0
    for string, path in enumerate(model.paths):
        ends = x[list(path)]
        length = sum(np.sqrt(np.sum((b - a) ** 2)) for a, b in pairwise(ends))
        stretch = length - model.rest_length[string]
        if model.two_way[string] or stretch.real > 0.0:
            total += 0.5 * model.stiffness[string] * stretch**2
    return total


@pytest.mark.parametrize("seed", range(30))
def test_forces_are_the_slope_of_the_energy(seed):
    """Of springs at rest; with joints or without, all forces but the bars'."""
    model = routed(random_joints(seed) if seed % 2 else dataclasses.replace(random_model(seed), nsh=()), seed)
    model = dataclasses.replace(model, drag=(), velocity=None, gravity=0.0)
    s = Structure(model)
    inputs = held(model, grid(0.1, 0.1))
    piece = ((model.string_lengths(model.nodes) > model.rest_length) & ~model.two_way).astype(int)
    motion = instant.motion_at(
        s, instant.load_of(s, inputs, 0), instant.mode_of(s, piece, piece < 0), 0.0, model.nodes.T, model.velocity.T
    )
    expected = np.zeros_like(model.nodes)
    for place in np.ndindex(*model.nodes.shape):
        x = model.nodes.astype(complex)
        x[place] += 1e-30j
        expected[place] = -np.imag(energy(model, x)) / 1e-30
    np.testing.assert_allclose(motion.F.T, expected, rtol=0.0, atol=1e-12 * (1.0 + np.abs(expected).max()))


@pytest.mark.parametrize("seed", range(0, 80, 5))
def test_ledger_of_random_structures(seed):
    """With honeycombs and moving rest lengths; of every other one bars share nodes, of two in four strings move like bars."""
    base = random_joints(seed) if seed % 2 else random_model(seed)
    model = dataclasses.replace(routed(base, seed), string_mass_matrix=("lumped", "consistent")[seed // 10 % 2])
    inputs = random_forces(model, seed) if seed % 2 else random_inputs(model, seed)
    assert reference.simulate(model, inputs).ledger_error() < 1e-8


def test_ledger_of_the_laboratory():
    """A scene with actuators, dampers that are not linear, drag, moved nodes: with routed strings, too."""
    model = routed(built(LABORATORY), 3)
    assert model.routes and model.actuated and model.string_mass.any()
    force = np.random.default_rng(1).normal(scale=5.0, size=(6, len(model.nodes), 3))
    result = reference.simulate(model, Inputs(grid(0.3, 0.05), force=force).resolved(model))
    assert result.ledger_error() < 1e-8
