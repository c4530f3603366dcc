"""Free nodes on no bar: point masses that hang on strings only, against closed forms and independent integrations."""

import dataclasses
import math

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from scipy.integrate import solve_ivp

from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu
from tensegrity_core import reference, statics
from tensegrity_core.equilibria import equilibrium, paths
from tensegrity_core.equilibria.loading import Loading
from tensegrity_core.equilibria.modes import modes
from tensegrity_core.errors import InputError, SceneError, TensegrityError
from tensegrity_core.kernel import Kernel, simulate
from tensegrity_core.model import grid, held
from tensegrity_core.output.drawing import draw, new_axes
from tensegrity_core.output.plots import new_figure
from tensegrity_core.scene import load_scene, parse_scene
from tensegrity_core.statics import build_model
from tests.scene.test_scene import write

#: A bar that swings by itself far away: a scene has one at least.
APART = {
    "fixed": ["base"],
    "nodes": {"base": [50.0, 0.0], "tip": [50.0, -1.0]},
    "bars": {"rod": {"nodes": ["base", "tip"], "mass": 1.0}},
}

#: A mass of 2 kg on a spring of 800 N/m, let go where the spring is at rest.
HANGING = APART | {
    "name": "hanging",
    "plane": "xz",
    "gravity": 10.0,
    "start": "released",
    "fixed": ["base", "top"],
    "nodes": APART["nodes"] | {"top": [0.0, 0.0], "load": [0.0, -1.0]},
    "strings": {"rope": {"nodes": ["top", "load"], "stiffness": 800.0}},
    "point_masses": {"load": 2.0},
    "prestress": {"rest_length": {"rope": 1.0}},
}

#: A net of three payloads between a mast and two anchors, in space.
NET = {
    "name": "net",
    "start": "settled",
    "fixed": ["foot", "a1", "a2", "a3"],
    "nodes": {
        "foot": [0.0, 0.0, 0.0],
        "head": [0.1, 0.0, 2.0],
        "a1": [3.0, 0.0, 1.5],
        "a2": [-1.5, 2.6, 1.5],
        "a3": [-1.5, -2.6, 1.5],
        "p1": [1.5, 0.0, 1.2],
        "p2": [-0.7, 1.3, 1.2],
        "p3": [-0.7, -1.3, 1.2],
    },
    "materials": {"cord": {"stiffness": 3000.0, "damping": 30.0}},
    "bars": {"mast": {"nodes": ["foot", "head"], "mass": 3.0}},
    "strings": {
        f"{kind}{i}": {"nodes": ends, "material": "cord"}
        for i in (1, 2, 3)
        for kind, ends in (("in", ["head", f"p{i}"]), ("out", [f"p{i}", f"a{i}"]), ("round", [f"p{i}", f"p{i % 3 + 1}"]))
    },
    "point_masses": {"p1": 0.5, "p2": 0.8, "p3": 0.5},
    "drag": {"p2": 0.4},
    "prestress": {"tension": {f"{kind}{i}": 20.0 for i in (1, 2, 3) for kind in ("in", "out", "round")}},
}

METHODS = ("auto", "dop853", "rodas5p", "radau9")


def both(model, inputs, **settings):
    return simulate(model, inputs, tolerance=1e-11, **settings), reference.simulate(model, inputs)


@pytest.mark.parametrize("method", METHODS)
def test_a_mass_on_a_spring(method):
    model = build_model(parse_scene(HANGING))
    times = grid(2.0, 0.02)
    found, other = both(model, held(model, times), method=method)
    rate, fall = math.sqrt(800.0 / 2.0), 2.0 * 10.0 / 800.0
    load = model.node_names.index("load")
    exact = -1.0 - fall * (1.0 - np.cos(rate * times))
    for run in (found, other):
        np.testing.assert_allclose(run.position[:, load, 2], exact, rtol=0.0, atol=2e-9)
        np.testing.assert_allclose(run.velocity[:, load, 2], -fall * rate * np.sin(rate * times), rtol=0.0, atol=5e-8)
        np.testing.assert_allclose(run.string_force[:, 0], 800.0 * (-1.0 - exact), rtol=0.0, atol=2e-6)
        assert run.ledger_error() < 1e-7  # 2e-9 m at 800 N/m and 50 mm
    top = model.node_names.index("top")
    np.testing.assert_allclose(found.reaction[:, top, 2], 800.0 * (-1.0 - exact), rtol=0.0, atol=2e-6)


def test_a_mass_between_two_strings():
    """Along the strings both are springs; the frequencies are sqrt(2 k/m) there and sqrt(2 T/(l m)) across."""
    scene = HANGING | {
        "name": "between",
        "gravity": 0.0,
        "start": "equilibrium",
        "fixed": ["base", "left", "right"],
        "nodes": APART["nodes"] | {"left": [-1.0, 0.0], "load": [0.0, 0.0], "right": [1.0, 0.0]},
        "strings": {f"to_{name}": {"nodes": [name, "load"], "stiffness": 800.0} for name in ("left", "right")},
        "prestress": {"tension": {"to_left": 40.0, "to_right": 40.0}},
    }
    model = build_model(parse_scene(scene))
    rates = sorted(mode.natural_frequency * 2.0 * math.pi for mode in modes(model))
    np.testing.assert_allclose(rates[-2:], [math.sqrt(2.0 * 40.0 / (1.0 * 2.0)), math.sqrt(2.0 * 800.0 / 2.0)], rtol=1e-9)
    load = model.node_names.index("load")
    velocity = np.zeros_like(model.nodes)
    velocity[load, 0] = 0.5
    model, times = dataclasses.replace(model, velocity=velocity), grid(1.0, 0.01)
    rate = math.sqrt(800.0)
    for run in both(model, held(model, times)):
        np.testing.assert_allclose(run.position[:, load, 0], 0.5 / rate * np.sin(rate * times), rtol=0.0, atol=2e-9)


def test_a_mass_on_a_string_whose_end_is_moved():
    """In the frame of a pivot that accelerates upwards the mass weighs m (g + a)."""
    model = build_model(parse_scene(HANGING | {"moving": ["top"]}))
    times, speed = grid(0.5, 0.01), 3.0

    def motion(t):
        return [[0.0, 0.0, 0.5 * speed * t * t]], [[0.0, 0.0, speed * t]]

    rate, fall = 20.0, 2.0 * (10.0 + speed) / 800.0
    exact = 0.5 * speed * times**2 - 1.0 - fall * (1.0 - np.cos(rate * times))
    for run in both(model, held(model, times, motion=motion)):
        np.testing.assert_allclose(run.position[:, model.node_names.index("load"), 2], exact, rtol=0.0, atol=2e-9)
        assert run.ledger_error() < 1e-7


def newton(model, force):
    """y' of the payloads alone, from Newton's second law of each, while all other nodes of the strings stay."""
    mass = dict(model.point_mass)
    drag = dict(model.drag)
    free = model.lone_nodes

    def rate(t, y):
        x, v = model.nodes.copy(), np.zeros_like(model.nodes)
        x[free], v[free] = y.reshape(2, -1, 3)
        pull = force(t) + model.node_mass[:, None] * model.g
        for (a, b), k, d, rest in zip(model.strings, model.stiffness, model.damping, model.rest_length):
            s, sd = x[b] - x[a], v[b] - v[a]
            xi = math.sqrt(s @ s)
            if xi > rest:
                tension = k * (xi - rest) + d * (s @ sd) / xi
                pull[a] += tension * s / xi
                pull[b] -= tension * s / xi
        a = [(pull[node] - drag.get(node, 0.0) * v[node]) / mass[node] for node in free]
        return np.concatenate((v[free].ravel(), np.ravel(a)))

    return rate


def held_head():
    """The net with the mast's head fixed by itself: all that moves are payloads, but for the bar apart."""
    raw = NET | {
        "fixed": [*NET["fixed"], "head", "base"],
        "bars": {"rod": {"nodes": ["base", "tip"], "mass": 1.0}},
        "start": "settled",
    }
    raw["prestress"] = {"tension": dict.fromkeys(NET["prestress"]["tension"], 80.0)}
    raw["nodes"] = NET["nodes"] | {"base": [50.0, 0.0, 0.0], "tip": [50.0, 0.0, -1.0]}
    return build_model(parse_scene(raw))


@pytest.mark.parametrize("method", METHODS)
def test_a_net_against_newtons_law(method):
    """Three payloads, damped strings, drag and forces that jump; taut all the way."""
    model = held_head()
    push = np.zeros_like(model.nodes)
    push[model.node_names.index("p1")] = [3.0, -1.0, 6.0]
    push[model.node_names.index("p3")] = [0.0, 4.0, -2.0]
    times = grid(1.0, 0.05)
    run = simulate(model, held(model, times, force=lambda t: push), method, tolerance=1e-11)
    assert not run.transitions
    start = np.concatenate((model.nodes[model.lone_nodes].ravel(), np.zeros(9)))
    exact = solve_ivp(newton(model, lambda t: push.copy()), (0.0, 1.0), start, "DOP853", times, rtol=1e-12, atol=1e-12).y
    np.testing.assert_allclose(run.position[:, model.lone_nodes].reshape(21, 9), exact[:9].T, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(run.velocity[:, model.lone_nodes].reshape(21, 9), exact[9:].T, rtol=0.0, atol=1e-6)


def test_a_mast_with_a_net_in_both_solutions():
    """Pushed until strings go slack: positions, forces and transitions of kernel and reference agree."""
    model = build_model(parse_scene(NET))
    push = np.zeros_like(model.nodes)
    push[model.node_names.index("p1")] = [-30.0, 10.0, 40.0]
    ours, theirs = both(model, held(model, grid(1.0, 0.02), force=lambda t: push if t < 0.5 else -push))
    assert len(ours.transitions) == len(theirs.transitions) > 4
    np.testing.assert_allclose(ours.position, theirs.position, rtol=0.0, atol=1e-7)
    np.testing.assert_allclose(ours.reaction, theirs.reaction, rtol=0.0, atol=1e-3 + 1e-6 * np.abs(theirs.reaction).max())
    for before, after in zip(ours.transitions, theirs.transitions):
        assert (before.string, before.before, before.after) == (after.string, after.before, after.after)
        assert abs(before.time - after.time) < 1e-6
    for run in (ours, theirs):
        assert run.ledger_error() < 1e-8


def test_jacobian_is_the_derivative():
    model = build_model(parse_scene(NET))
    kernel = Kernel(model)
    kernel.initialize()
    y, n = kernel.state, (len(kernel.state) - 3) // 2
    rng = np.random.default_rng(0)
    y[:n] += 1e-3 * rng.normal(size=n)
    y[n : 2 * n] += 0.1 * rng.normal(size=n)
    Jq, Jv, _ = kernel.jacobian(y)
    for at, J in ((0, Jq), (n, Jv)):
        for i in range(n):
            step = np.zeros_like(y)
            step[at + i] = 1e-6
            slope = (kernel.derivative(y + step) - kernel.derivative(y - step))[n : 2 * n] / 2e-6
            np.testing.assert_allclose(J[:, i], slope, rtol=0.0, atol=1e-4 * np.abs(J).max())


def test_statics_with_payloads():
    model = build_model(parse_scene(NET))
    assert model.node_names[model.lone_nodes[0]] == "p1" and len(model.lone_nodes) == 3
    assert np.abs(statics.residual(model)).max() < 1e-9
    assert statics.stability(model).stable
    still = simulate(model, held(model, grid(1.0, 0.1)), tolerance=1e-12)
    assert np.abs(still.position - model.nodes).max() < 1e-9
    up = np.zeros_like(model.nodes)
    up[model.node_names.index("p1"), 2] = 1.0
    end = paths.follow(Loading(model, up), 0.0, 5.0).points[-1]
    settled = statics.settle(model, 5.0 * up)
    np.testing.assert_allclose(equilibrium.Equations(Loading(model, up)).nodes(end.free), settled.nodes, rtol=0.0, atol=1e-8)


def test_equilibrium_finds_the_tensions_of_a_payload():
    """A load of 2 kg between two ropes at 45 degrees: each bears m g / sqrt(2)."""
    scene = HANGING | {
        "start": "equilibrium",
        "fixed": ["base", "left", "right"],
        "nodes": APART["nodes"] | {"left": [-1.0, 1.0], "load": [0.0, 0.0], "right": [1.0, 1.0]},
        "strings": {f"to_{name}": {"nodes": [name, "load"], "stiffness": 800.0} for name in ("left", "right")},
        "prestress": {},
    }
    model = build_model(parse_scene(scene))
    tension = statics.string_tension(model, np.full(2, math.sqrt(2.0)))
    np.testing.assert_allclose(tension, 20.0 / math.sqrt(2.0), rtol=1e-12)


def test_payloads_are_drawn_where_they_are():
    model = build_model(parse_scene(NET))
    drawing = draw(new_axes(new_figure(200, 200), model), model)
    assert len(drawing._masses) == 3
    moved = model.nodes + 0.25
    drawing.move(moved)
    for line, node in zip(drawing._masses, model.lone_nodes):
        np.testing.assert_allclose(np.ravel(line.get_data_3d()), moved[node], atol=0.1)  # drawn a little nearer to the eye


def test_both_fmus_have_the_payloads_variables(tmp_path):
    model = build_model(parse_scene(NET))
    pack_native_fmu(model, tmp_path / "native.fmu")
    pack_python_fmu(model, tmp_path / "python.fmu")
    for kind in ("native", "python"):
        names = {variable.name for variable in read_model_description(str(tmp_path / f"{kind}.fmu")).modelVariables}
        assert {f"p1.{what}" for what in ("force.x", "x", "y", "z", "velocity.z", "mass")} <= names
    pushed = np.array([(0.0, 4.0)], dtype=[("time", float), ("p1.force.z", float)])
    found = simulate_fmu(
        str(tmp_path / "native.fmu"), stop_time=0.5, output_interval=0.05, input=pushed, output=["p1.z", "out1.force"]
    )
    push = np.zeros_like(model.nodes)
    push[model.node_names.index("p1"), 2] = 4.0
    exact = reference.simulate(model, held(model, grid(0.5, 0.05), force=lambda t: push))
    np.testing.assert_allclose(found["p1.z"], exact.position[:, model.node_names.index("p1"), 2], rtol=0.0, atol=1e-7)
    at = model.string_names.index("out1")
    np.testing.assert_allclose(found["out1.force"], exact.string_force[:, at], rtol=0.0, atol=1e-3)


# --- what is refused ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("masses", [{}, {"load": 0.0}])
def test_a_node_without_any_mass_is_refused(masses):
    with pytest.raises(SceneError, match="has no mass. Put it on a bar, give it a point mass") as caught:
        parse_scene(HANGING | {"point_masses": masses})
    assert caught.value.key == "nodes.load"


def test_models_without_mass_are_refused_by_both_solutions():
    model = dataclasses.replace(build_model(parse_scene(HANGING)), point_mass=())
    with pytest.raises(TensegrityError, match="a free node has neither a bar nor a point mass"):
        Kernel(model)
    with pytest.raises(InputError, match="belongs to no bar and so has no mass"):
        reference.simulate(model, held(model, grid(0.1, 0.1)))


def test_a_mass_cannot_be_taken_away():
    kernel = Kernel(build_model(parse_scene(HANGING)))
    kernel["point_mass"][0] = 0.0
    with pytest.raises(InputError, match=r"point_mass\[0\] = 0.0 must be positive"):
        kernel.initialize()
    kernel["point_mass"][0] = 1.0
    kernel.initialize()


def test_states_are_saved_to_the_last_bit():
    kernel = Kernel(build_model(parse_scene(NET)))
    kernel["force"][:] = 3.0
    kernel.initialize()
    kernel.step(0.05)
    state = kernel.save()
    kernel.step(0.05)
    after = kernel.values.copy()
    kernel.restore(state)
    kernel.step(0.05)
    assert (kernel.values == after).all()


def test_a_scene_file_with_a_payload(tmp_path):
    text = """
    extends = "three_bar"
    start = "settled"
    nodes.load = [0.0, 0.0, 0.5]
    point_masses.load = 0.3
    [strings]
    h1 = { nodes = ["n4", "load"], material = "cable" }
    h2 = { nodes = ["n5", "load"], material = "cable" }
    h3 = { nodes = ["n6", "load"], material = "cable" }
    [prestress.tension]
    h1 = 5.0
    h2 = 5.0
    h3 = 5.0
    s1 = 5.0
    s2 = 5.0
    s3 = 5.0
    s4 = 15.0
    s5 = 15.0
    s6 = 15.0
    """
    model = build_model(load_scene(write(tmp_path, text)))
    assert model.node_mass[model.node_names.index("load")] == 0.3
    assert np.abs(statics.residual(model)).max() < 1e-9
