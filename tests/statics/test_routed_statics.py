"""Statics of routed strings, strings with mass and springs that push: matrices against differences, equilibria against closed
forms, paths, modes and linear systems against each other."""

from __future__ import annotations

import dataclasses
import tomllib

import numpy as np
import pytest
import scipy

from tensegrity_core import statics
from tensegrity_core.equilibria.linearization import at_rest, linearize
from tensegrity_core.equilibria.loading import Loading
from tensegrity_core.equilibria.modes import modes
from tensegrity_core.equilibria.steady_states import load_sweep
from tensegrity_core.model import grid, held
from tensegrity_core.reference import simulate
from tensegrity_core.scene import parse_scene
from tests.kernel.test_random_scenes import random_model
from tests.support import by_hand
from tests.support.jointed_scenes import random_joints
from tests.support.routed_scenes import routed

SEEDS = range(24)


def random_one(seed: int):
    """With joints where the seed is odd."""
    return routed(random_joints(seed) if seed % 2 else random_model(seed), seed)


def differences(function, x: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """(values, n): derivatives by central differences."""
    return np.array([(function(x + d) - function(x - d)) / (2.0 * step) for d in step * np.eye(len(x))]).T


@pytest.mark.parametrize("seed", SEEDS)
def test_equilibrium_matrix_is_that_of_the_lengths(seed):
    """A column per string, whatever its way: minus the slope of its length."""
    model = random_one(seed)
    balance = statics.balance_of(model)
    count = len(model.strings)
    lengths = differences(lambda x: model.string_lengths(balance.nodes(x)), balance.start)
    matrix = statics.equilibrium_matrix(model)
    assert matrix.shape == (balance.size, count + len(model.bars))
    np.testing.assert_allclose(matrix[:, :count], -lengths.T, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("seed", SEEDS)
def test_tangent_stiffness_is_the_slope_of_the_force(seed):
    """With the strings' stiffnesses and all force densities given, dense and sparse alike."""
    model, random = random_one(seed), np.random.default_rng(seed)
    balance = statics.balance_of(model)
    count, k = len(model.strings), random.uniform(100.0, 900.0, len(model.strings))
    rest = random.uniform(0.3, 1.2, count)
    bars = random.normal(scale=40.0, size=len(balance.shape(balance.start).lengths) - count)

    def force(x):
        shape = balance.shape(x)
        density = np.concatenate((k * (shape.length - rest) / shape.length, bars))
        return balance.unbalanced(shape, np.zeros(balance.size), density)

    shape = balance.shape(balance.start)
    density = np.concatenate((k * (shape.length - rest) / shape.length, bars))
    tangent = balance.stiffness(shape, k, density)
    scale = np.abs(tangent).max()
    np.testing.assert_allclose(tangent, -differences(force, balance.start), rtol=0.0, atol=2e-8 * scale)
    np.testing.assert_allclose(tangent, tangent.T, rtol=0.0, atol=1e-13 * scale)
    sparse = type(balance)(model, statics.matrices.Sparse)
    np.testing.assert_allclose(sparse.stiffness(shape, k, density).toarray(), tangent, rtol=0.0, atol=1e-13 * scale)


RING = """
name = "ring"
plane = "xz"
fixed = ["a", "b"]
start = "{start}"
[nodes]
a = [0.0, 0.0]
b = [1.2, 0.5]
r = [0.7, -0.9]
free = [-0.3, 0.4]
[bars]
rod = {{ nodes = ["a", "free"], mass = 0.1 }}
[strings]
line = {{ nodes = ["a", "r", "b"], stiffness = 800.0{more} }}
stay = {{ nodes = ["free", "b"], stiffness = 50.0 }}
[point_masses]
r = 0.9
[prestress]
rest_length = {{ line = 2.4, stay = 0.2 }}
"""


def ring(start: str = "settled", more: str = ""):
    return statics.build_model(parse_scene(tomllib.loads(RING.format(start=start, more=more))))


def angle_of(load: float, k: float = 800.0, rest: float = 2.4) -> tuple[float, float]:
    """sin of the angle to the vertical of both segments, and the tension: a ring on a string between two points slides to where
    both angles are the same; d = L sin, L = rest + T/k, 2 T cos = load."""

    def gap(s):
        return (rest + load / (2.0 * k * np.sqrt(1.0 - s * s))) * s - 1.2

    s = scipy.optimize.brentq(gap, 1e-3, 0.999, xtol=1e-15)
    return s, load / (2.0 * np.sqrt(1.0 - s * s))


@pytest.mark.parametrize("more, mass", [("", 0.9), (", mass = 0.4", None)])
def test_ring_on_a_string_settles_between_equal_angles(more, mass):
    model = ring(more=more)
    weight = 9.81 * (model.node_mass[2] if mass is None else mass)
    s, tension = angle_of(weight)
    (a, b, r), force = model.nodes[[0, 1, 2]][:, [0, 2]], statics.member_forces(model)
    for anchor in (a, b):
        assert abs(r - anchor)[0] / np.linalg.norm(r - anchor) == pytest.approx(s, rel=1e-9)
    assert force[0] == pytest.approx(tension, rel=1e-9)
    assert np.abs(statics.residual(model)).max() < 1e-10
    assert statics.stability(model).stable


def test_ring_under_a_load_that_grows():
    """The path is that of the closed form, and of settling under the whole load."""
    model = ring()
    force = np.zeros((len(model.nodes), 3))
    force[2, 2] = -40.0
    sweep = load_sweep(Loading(model, force), [0.0, 0.3, 1.0])
    for part, nodes in zip((0.0, 0.3, 1.0), sweep.nodes):
        s, _ = angle_of(0.9 * 9.81 + 40.0 * part)
        along = nodes[2, [0, 2]] - nodes[0, [0, 2]]
        assert along[0] / np.linalg.norm(along) == pytest.approx(s, rel=1e-9)
    np.testing.assert_allclose(statics.settle(model, force).nodes, sweep.nodes[-1], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("two_way", [False, True])
@pytest.mark.parametrize("matrix", ["lumped", "consistent"])
def test_modes_and_linear_system_of_the_ring(two_way, matrix):
    """Both have the same eigenvalues, and small swings in the reference have them, too."""
    model = dataclasses.replace(ring(more=", damping = 3.0, mass = 0.4"), two_way=[two_way, False], string_mass_matrix=matrix)
    found = modes(model)
    values = np.array([mode.eigenvalue for mode in found])
    system = linearize(model, at_rest(model))
    eigenvalues = np.linalg.eigvals(system.A)
    for value in values:
        assert np.abs(eigenvalues - value).min() < 1e-6 * abs(value)
    assert np.abs(system.drift).max() < 1e-9
    for mode in (found[0], found[-1]):
        lam, shape, size = mode.eigenvalue, mode.shape, 1e-6
        start = dataclasses.replace(
            model,
            nodes=model.nodes + size * shape.real,
            velocity=size * np.where(model.fixed[:, None], 0.0, (lam * shape).real),
        )
        result = simulate(start, held(start, grid(0.2, 0.02)), rtol=1e-12, atol=1e-15)
        expected = size * (shape[None] * np.exp(lam * result.times)[:, None, None]).real
        np.testing.assert_allclose(result.position - model.nodes, expected, rtol=0.0, atol=1e-4 * size)


def test_pushed_spring_in_equilibrium():
    """A bar on a spring that also pushes, pressed down by its weight; and with its tension, below 0, as prestress."""
    raw = {
        "name": "post",
        "plane": "xz",
        "fixed": ["foot", "hinge"],
        "start": "equilibrium",
        "nodes": {"hinge": [0.0, 0.0], "tip": [1.0, 0.0], "foot": [1.0, -0.5]},
        "bars": {"beam": {"nodes": ["hinge", "tip"], "mass": 2.0}},
        "strings": {"strut": {"nodes": ["foot", "tip"], "stiffness": 3000.0, "two_way": True}},
    }
    model = statics.build_model(parse_scene(raw))
    assert statics.member_forces(model)[0] == pytest.approx(-9.81)
    assert model.rest_length[0] == pytest.approx(0.5 + 9.81 / 3000.0, rel=1e-14)
    for prestress in ({"tension": {"strut": -9.81}}, {"force_density": {"strut": -2.0 * 9.81}}):
        again = statics.build_model(parse_scene(raw | {"prestress": prestress}))
        np.testing.assert_allclose(again.rest_length, model.rest_length, rtol=1e-15)
    heavy = dataclasses.replace(model, gravity=19.62)
    settled = statics.settle(heavy)
    assert settled.nodes[1, 2] < -3e-3 and statics.member_forces(settled)[0] < -19.0
    assert np.abs(statics.residual(settled)).max() < 1e-10


def test_force_density_is_tension_over_the_whole_way():
    """Of a plain and of a routed string."""
    raw = {
        "name": "net",
        "fixed": ["a", "b", "c"],
        "start": "released",
        "gravity": 0.0,
        "nodes": {"a": [0.0, 0.0, 0.0], "b": [3.0, 0.0, 0.0], "c": [3.0, 4.0, 0.0], "m": [1.0, 1.0, 1.0], "t": [2.0, 2.0, 2.0]},
        "bars": {"bar": {"nodes": ["m", "t"], "mass": 1.0}},
        "strings": {
            "plain": {"nodes": ["a", "m"], "stiffness": 500.0},
            "way": {"nodes": ["a", "b", "c", "t"], "stiffness": 1000.0},
        },
        "prestress": {"force_density": {"plain": 12.0, "way": 7.0}},
    }
    model = statics.build_model(parse_scene(raw))
    length = np.array([np.sqrt(3.0), 3.0 + 4.0 + 3.0])
    np.testing.assert_allclose(model.string_lengths(model.nodes), length, rtol=1e-15)
    force = statics.member_forces(model)[:2]
    np.testing.assert_allclose(force, [12.0 * length[0], 7.0 * length[1]], rtol=1e-12)
    np.testing.assert_allclose(model.rest_length, length - force / [500.0, 1000.0], rtol=1e-14)


def test_one_string_round_a_prism_is_one_member():
    """A loop through three points in the plane has one self-stress with three struts where three strings have it with one more
    freedom to choose: rank, self-stress and mechanisms count the string once."""
    corner = np.array([[np.cos(a), np.sin(a), 0.0] for a in 2.0 * np.pi * np.arange(3) / 3])
    nodes = np.vstack((corner, [[0.0, 0.0, 0.0]]))
    masses = [(node, 1.0) for node in range(3)]
    struts, loop = [(3, i) for i in range(3)], [(0, 1, 2, 0)]
    fields = {"stiffness": 100.0, "rest_length": 1.0, "axes": (0, 1), "point_mass": masses}
    single = statics.analyse(by_hand(nodes, [3], struts, loop, **fields))
    triple = statics.analyse(by_hand(nodes, [3], struts, [(0, 1), (1, 2), (2, 0)], **fields))
    assert (single.equations, single.members, single.rank) == (6, 4, 3)
    assert single.self_stress.shape[1] == 1 and triple.self_stress.shape[1] == 1
    assert single.mechanisms.shape[0] == 2 and triple.mechanisms.shape[0] == 0
    state = single.self_stress[:, 0] / single.self_stress[0, 0]
    np.testing.assert_allclose(state, [1.0, *[-np.sqrt(3.0)] * 3], rtol=1e-12)  # 2 T cos 30 deg inwards at each corner
