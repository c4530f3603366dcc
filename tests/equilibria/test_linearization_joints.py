"""Linear systems of structures with joints: those of class 1 by other coordinates, modes, closed forms, and the differences of
the reference."""

from __future__ import annotations

import numpy as np
import pytest

import tensegrity_core as tc
from tensegrity_core import statics
from tensegrity_core.equilibria import jointed, linearization, modes
from tensegrity_core.errors import InputError
from tensegrity_core.fields import size
from tensegrity_core.model import Inputs
from tensegrity_core.model.components import flattened, named, spread
from tensegrity_core.model.inputs import INPUTS
from tensegrity_core.output.state_space import StateSpace
from tensegrity_core.reference import instant
from tensegrity_core.reference.structure import Structure
from tests.equilibria.test_linearization import about_rest, require_same
from tests.support import changed, scene
from tests.support.driven_scenes import AFLOAT, LABORATORY, MAST, PENDULUM, built
from tests.support.jointed_scenes import SLIDER, random_joints

STRUCTURES = ("motes_double_pendulum", "stedy_ball", "stedy_dbar", "tsg_dbar3d")
CLASS_1 = {"two_bar": None, "three_bar": None, "laboratory": LABORATORY, "pendulum": PENDULUM, "winch": MAST, "afloat": AFLOAT}


@pytest.mark.parametrize("name", CLASS_1)
def test_coordinates_of_nodes_tell_the_same_of_class_1(name):
    """Transfer functions of all inputs and outputs, moved nodes and actuators too."""
    model = statics.settle(built(CLASS_1[name]) if CLASS_1[name] else scene(name))
    state = linearization.at_rest(model)
    strings = linearization._Strings(model, state, "longer")
    kinds = linearization.System, jointed.JointedSystem
    ours, theirs = (StateSpace.of(name, kind(model, state, strings).linear()).with_motions() for kind in kinds)
    assert [q.name for q in ours.inputs] == [q.name for q in theirs.inputs]
    for s in (0.7, 2.0 + 15.0j):
        expected = ours.response(s)
        assert np.abs(theirs.response(s) - expected).max() <= 1e-12 * np.abs(expected).max()
    assert np.allclose([q.value for q in theirs.outputs], [q.value for q in ours.outputs], rtol=0, atol=1e-11)


def test_a_double_pendulum_swings_as_its_closed_form():
    """det(K - w2 M) = 0 of two thin rods, M = m l2 [4/3 1/2; 1/2 1/3], K = m g l diag(3/2, 1/2); its states are coordinates."""
    mass, length, g = 1.3, 0.7, 9.81
    data = {
        "name": "double",
        "start": "released",
        "gravity": g,
        "fixed": ["n1"],
        "nodes": {"n1": [0.0, 0.0, 0.0], "n2": [0.0, 0.0, -length], "n3": [0.0, 0.0, -2.0 * length]},
        "bars": {"b1": {"nodes": ["n1", "n2"], "mass": mass}, "b2": {"nodes": ["n2", "n3"], "mass": mass}},
        "strings": {},
    }
    found = about_rest(built(data))
    M = mass * length**2 * np.array([[4 / 3, 1 / 2], [1 / 2, 1 / 3]])
    squares = np.linalg.eigvals(np.linalg.solve(M, mass * g * length * np.diag([1.5, 0.5])))
    require_same(found.poles, np.repeat([*(1j * np.sqrt(squares)), *(-1j * np.sqrt(squares))], 2), 1e-6)  # along x and y
    assert [q.name for q in found.states[:4]] == ["n2.x", "n2.y", "n3.x", "n3.y"]
    weight = next(q.value for q in found.outputs if q.name == "n1.reaction.z")
    assert weight == pytest.approx(2.0 * mass * g, rel=1e-12)


@pytest.mark.parametrize("name", STRUCTURES[1:])
def test_poles_of_published_structures_are_those_of_their_modes(name):
    rest = tc.equilibrium(f"tests/structures/{name}.toml")
    found = about_rest(rest.model, side="longer").poles
    known = np.array([mode.eigenvalue for mode in modes.modes(rest.model)])
    known = np.concatenate([known, known[known.imag > 0.0].conj()])
    known = known[np.abs(known) > 1e-4 * np.abs(known).max()]  # neutral ones are zero twice, to the root of round-off
    require_same(known, [value for value in found if np.abs(value) > 1e-6 * np.abs(found).max()], 1e-6)


class Chart:
    """Nodes and velocities by the coordinates that a system names, by Newton's method on the reference's constraints."""

    def __init__(self, model, found):
        self.model, self.joints = model, Structure(model).joints
        n = len(found.A) // 2
        self.places = [self.place(q.name) for q in found.states[:n]]
        self.held = model.held.T & np.isin(np.arange(3), model.axes)[:, None]
        self.free = ~model.held.T & np.isin(np.arange(3), model.axes)[:, None]
        for axis, node in self.places:
            self.free[axis, node] = False

    def place(self, name):
        node, axis = name.rsplit(".", 1)
        return "xyz".index(axis), self.model.node_names.index(node)

    def moving(self, y, w, shift, velocity):
        """N, Ndot (3, n): shift: of moved nodes' coordinates, velocity: theirs, (3, n)."""
        N, Ndot = self.model.nodes.T + shift, np.array(velocity)
        for (axis, node), value, rate in zip(self.places, y, w):
            N[axis, node] += value
            Ndot[axis, node] = rate
        for _ in range(8):
            G = self.joints.rows(N)[:, :, :].transpose(1, 0, 2)[:, self.free]
            N[self.free] -= np.linalg.lstsq(G, self.joints.values(N), rcond=1e-9)[0]
        rows = self.joints.rows(N).transpose(1, 0, 2)
        G = rows[:, self.free]
        Ndot[self.free] = -np.linalg.lstsq(G, np.einsum("can,an->c", rows, Ndot), rcond=1e-9)[0]
        return N, Ndot


def of_the_reference(model, chart, N, Ndot, inputs):
    """Second derivatives of the coordinates, and outputs."""
    model = changed(model, nodes=N.T, velocity=Ndot.T, rest_length=inputs["rest_length"])
    structure = Structure(model)
    structure.joints.rank = chart.joints.rank
    held = Inputs(np.array([0.0, 1.0]), **{name: np.asarray(value)[None] for name, value in inputs.items()}).resolved(model)
    load = instant.load_of(structure, held, 0)
    taut = model.string_lengths(N.T) > inputs["rest_length"]
    mode = instant.mode_of(structure, taut.astype(int), np.zeros(len(taut), dtype=bool))
    strings = instant.strings_at(structure, load, mode, 0.0, N, Ndot)
    if model.damping_law == "tension_only":
        mode = instant.mode_of(structure, taut.astype(int), taut & (strings.unclipped < 0.0))
    motion = instant.motion_at(structure, load, mode, 0.0, N, Ndot)
    rows = {
        "position": N.T,
        "velocity": np.where(model.held.T, 0.0, Ndot).T,
        "string_force": motion.strings.tension,
        "elastic_force": motion.strings.elastic,
        "string_length": motion.strings.xi,
        "bar_force": -motion.lam[: len(model.bars)] * chart.model.bar_length,
        "reaction": motion.ground.T,
    }
    found = [motion.Nddot[place] for place in chart.places]
    for field in linearization.OUTPUTS:
        if field.name in rows:
            flat = flattened(field, model, np.asarray(rows[field.name])[None])[0]
            found += flat[list(named(field, model).values())].tolist()
        else:
            assert size(field, model.counts) == 0
    return np.array(found)


def require_the_references_differences(model, state, w):
    found = linearization.linearize(model, state)
    chart, n = Chart(model, found), len(found.A) // 2
    moved = list(model.moving)

    def at(z):
        inputs, u = {name: np.array(values, dtype=float) for name, values in state.inputs.items()}, z[2 * n :]
        for name, field in INPUTS.items():
            flat = flattened(field, model, inputs[name][None])[0].copy()
            kept = list(named(field, model).values())
            flat[kept] += u[: len(kept)]
            u, inputs[name] = u[len(kept) :], spread(field, model, flat[None])[0]
        assert len(u) == 0
        shift, velocity = np.zeros((2, *model.nodes.T.shape))
        if moved:
            shift[:, moved] = (inputs["node_position"] - state.inputs["node_position"]).T
            velocity[:, moved] = np.where(model.moved[moved], inputs["node_velocity"], 0.0).T
        return of_the_reference(model, chart, *chart.moving(z[:n], w + z[n : 2 * n], shift, velocity), inputs)

    whole = np.block([[found.A[n:], found.B[n:]], [found.C, found.D]])
    start, step = at(np.zeros(whole.shape[1])), 2e-6
    np.testing.assert_allclose(start, [*found.drift[n:], *(q.value for q in found.outputs)], rtol=1e-7, atol=1e-7)
    for column in range(whole.shape[1]):
        z = step * (np.arange(whole.shape[1]) == column)
        difference = (at(z) - at(-z)) / (2.0 * step)
        scale = max(1.0, np.abs(whole[:, column]).max(), np.abs(start).max())
        assert np.abs(difference - whole[:, column]).max() <= 2e-6 * scale, column


def in_motion(model, seed):
    """A state with random rates of the coordinates and of what moves."""
    random = np.random.default_rng(seed)
    state = linearization.at_rest(model)
    inputs = state.inputs | {"rest_length_rate": 0.1 * random.standard_normal(len(model.strings))}
    for name in ("node_velocity", "node_acceleration"):
        inputs[name] = 0.3 * random.standard_normal(inputs[name].shape)
    found = linearization.linearize(model, state)
    w = random.standard_normal(len(found.A) // 2)
    velocity, moved = np.zeros_like(model.nodes.T), list(model.moving)
    velocity[:, moved] = np.where(model.moved[moved], inputs["node_velocity"], 0.0).T
    Ndot = Chart(model, found).moving(0.0 * w, w, 0.0 * velocity, velocity)[1]
    return state._replace(velocity=Ndot.T, inputs=inputs), w


@pytest.mark.parametrize("seed", range(8))
def test_the_references_differences_of_random_joints(seed):
    """Redundant bars, bars without mass, welds, single axes, drag, slack strings, both damping laws; off balance, in motion."""
    model = changed(random_joints(seed), velocity=np.zeros_like(random_joints(seed).nodes))
    if not model.joint:
        pytest.skip("of class 1")
    require_the_references_differences(model, *in_motion(model, seed))


def test_the_references_differences_with_moved_axes():
    model = built(SLIDER)
    assert model.redundant.any() == False and len(model.moving) == 2  # noqa: E712
    require_the_references_differences(model, *in_motion(model, 3))


def test_no_linear_system_where_lengths_allow_the_first_order_only():
    data = {
        "name": "straight",
        "start": "released",
        "fixed": ["n1", "n3"],
        "nodes": {"n1": [0.0, 0.0, 0.0], "n2": [1.0, 0.0, 0.0], "n3": [2.0, 0.0, 0.0]},
        "bars": {"b1": {"nodes": ["n1", "n2"], "mass": 1.0}, "b2": {"nodes": ["n2", "n3"], "mass": 1.0}},
        "strings": {},
    }
    with pytest.raises(InputError, match="b[12].*first order"):
        about_rest(built(data))
