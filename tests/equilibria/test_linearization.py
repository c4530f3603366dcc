"""Linear systems about a state: closed forms, the poles of `modes`, the kernel's Jacobian, differences and small motions."""

from __future__ import annotations

import json

import numpy as np
import pytest
import scipy
from scipy import io

import tensegrity_core as tc
from tensegrity_core import statics
from tensegrity_core.cli import main
from tensegrity_core.equilibria import linearization, modes
from tensegrity_core.errors import InputError
from tensegrity_core.kernel import Kernel
from tensegrity_core.model import grid
from tensegrity_core.model.components import flattened, spread
from tensegrity_core.model.inputs import INPUTS
from tensegrity_core.output.state_space import StateSpace
from tests.equilibria.test_modes import SCENES, bars_coordinates
from tests.equilibria.test_paths import one_bar
from tests.kernel.test_random_scenes import random_model
from tests.support import changed, push, scene
from tests.support.driven_scenes import LABORATORY, MAST, PENDULUM, built
from tests.support.element_scenes import STRINGS, mast
from tests.support.rigged_scenes import RIGGED


def about_rest(model, force=None, side=None) -> StateSpace:
    return StateSpace.of(model.name, linearization.linearize(model, linearization.at_rest(model, force), side))


def settled(name, load, damping):
    model, force = changed(scene(name), damping=damping), push(scene(name), load, 0.0)
    return statics.settle(model, force=force, steps=6 if load else 1), force


# --- closed forms ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [0.0, 20.0])
def test_upright_bar_between_two_guys(damping):
    """m/3 x'' + 2 d x' + 2 k x = F + (k dL + d dL') of the guy on the left, against it of the other."""
    k, pull, reach, mass = 900.0, 60.0, 0.8, 1.0
    model = one_bar([0, 0, 1.0], [[-reach, 0, 1.0], [reach, 0, 1.0]], np.full(2, reach - pull / k), damping=damping)
    tip, guys = model.node_names[1], model.string_names
    inputs = [f"{tip}.force.x", *(f"{guy}.{rest}" for rest in ("rest_length", "rest_length_rate") for guy in guys)]
    found = about_rest(model).only(inputs, [f"{tip}.x", f"{guys[0]}.force"])
    for s in (0.0, 3.0, 1.0 + 40.0j):
        x = np.array([1.0, k, -k, damping, -damping]) / (mass / 3.0 * s**2 + 2.0 * damping * s + 2.0 * k)
        force = (k + damping * s) * x - np.array([0.0, k, 0.0, damping, 0.0])
        np.testing.assert_allclose(found.response(s), [x, force], rtol=1e-12, atol=1e-12)
    assert [(q.name, q.unit) for q in found.outputs] == [(f"{tip}.x", "m"), (f"{guys[0]}.force", "N")]
    assert found.outputs[1].value == pytest.approx(pull) and not np.abs(found.drift).max() > 1e-12


def test_a_pendulums_pivot_and_its_own_motion():
    """Hanging, its tip's x follows a pivot at p: (m/3) (x'' - p'') + (m/2) p'' + (m g/2 l) (x - p) = 0."""
    mass, g = 2.0, 9.81
    given = {"nodes": {"n1": [0.0, 0.0], "n2": [0.0, -1.0]}, "moving": ["n1"], "gravity": g}
    found = about_rest(built(PENDULUM, **given)).with_motions().only(["n1.acceleration.x"], ["n2.x", "n1.reaction.x"])
    for s in (0.5, 2.0 + 1.0j):
        k = mass * g / 2.0
        swing = -(mass / 2.0) * s**2 / (mass / 3.0 * s**2 + k)  # x - p per p
        whole = mass * s**2 * (1.0 + swing / 2.0)
        np.testing.assert_allclose(found.response(s)[:, 0] * s**2, [1.0 + swing, whole], rtol=1e-12)


# --- the other truths --------------------------------------------------------------------------------------------------

STATES = [(name, load, damping) for name in SCENES for load in (0.0, 11.0, 25.0) for damping in (50.0, 500.0)]


@pytest.mark.parametrize("name, load, damping", STATES)
def test_poles_are_those_of_modes_and_of_the_kernels_jacobian(name, load, damping):
    """Plain and, under 25 N on each top node, snapped."""
    model, force = settled(name, load, damping)
    state = linearization.at_rest(model, force)
    found = linearization.linearize(model, state)
    known = np.array([mode.eigenvalue for mode in modes.modes(model, force)])
    known = np.concatenate([known, known[known.imag > 0.0].conj()])
    require_same(np.linalg.eigvals(found.A), known, 1e-9)
    if load == 25.0 and name.endswith("nsh"):
        assert any("snapped" in branch for branch in found.strings.values())

    kernel = Kernel(model)
    kernel["force"][:] = force[model.free_nodes][:, list(model.axes)].ravel()
    kernel.initialize()
    Jq, Jv, _ = kernel.jacobian(kernel.state)
    n = len(found.A) // 2
    free = np.repeat(~model.fixed, len(model.axes))
    basis = bars_coordinates(model) @ found.C[: len(free), :n][free]
    expected = np.linalg.pinv(basis) @ np.hstack([Jq @ basis, Jv @ basis])
    np.testing.assert_allclose(found.A[n:], expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def require_same(found, expected, tolerance):
    """The same values, each once, in any order."""
    assert len(found) == len(expected)
    rest = list(expected)
    for value in found:
        nearest = min(rest, key=lambda other: abs(other - value))
        assert abs(nearest - value) <= tolerance * abs(value)
        rest.remove(nearest)


class Chart:
    """Nodes, velocities and accelerations by a system's coordinates, written apart: bars keep their lengths to all orders."""

    def __init__(self, model, nodes, found):
        self.model, self.start, D = model, nodes, len(model.axes)
        self.axes, n = list(model.axes), len(found.A) // 2
        whole = found.C[: model.nodes[:, self.axes].size].reshape(len(nodes), D, -1)
        self.phi = whole[:, :, : n - len(model.actuated)]
        columns = slice(place(found, "position"), place(found, "velocity"))
        self.moved = found.D[: nodes[:, self.axes].size, columns].reshape(len(nodes), D, -1)
        fixed = model.fixed[model.bars]
        self.lever = np.where(fixed.any(1)[:, None], np.where(fixed, 0.0, [[-1.0, 1.0]]), [[-0.5, 0.5]])

    def nodes(self, y, p):
        x = self.start[:, self.axes] + self.phi @ y + self.moved @ p
        for (i, j), (a, c) in zip(self.model.bars, self.lever):
            b0 = self.start[j, self.axes] - self.start[i, self.axes]
            b, base = x[j] - x[i], x[i] - a * (x[j] - x[i])
            b = b * np.sqrt(b0 @ b0) / np.sqrt((b * b).sum())
            x[i], x[j] = base + a * b, base + c * b
        return x

    def moving(self, y, w, p, v):
        """Nodes and velocities, the latter by a complex step."""
        return self.nodes(y, p), self.nodes(y + 1e-30j * w, p + 1e-30j * v).imag * 1e30

    def second(self, x, v, a):
        """y'' out of the nodes' accelerations: with g = l b / (e . b), E^T g is y."""
        along = np.einsum("ndr,nd->r", self.phi, a) / np.einsum("ndr,ndr->r", self.phi, self.phi)
        for i, j in self.model.bars:
            b0 = self.start[j, self.axes] - self.start[i, self.axes]
            length, (b, b1, b2) = np.sqrt(b0 @ b0), (values[j] - values[i] for values in (x, v, a))
            c, c1, c2 = (b0 @ values / length for values in (b, b1, b2))
            g = length * (b2 / c - 2.0 * b1 * c1 / c**2 - b * c2 / c**2 + 2.0 * b * c1**2 / c**3)
            turn = self.phi[j] - self.phi[i]
            turns = np.abs(turn).max(0) > 1e-12
            along[turns] = (turn.T @ g)[turns]
        return along


def place(found, part):
    """Where inputs of a kind begin; at the end of all where there is none."""
    return next((i for i, quantity in enumerate(found.inputs) if f".{part}." in quantity.name), len(found.inputs))


def in_motion(model, seed):
    """A model with random velocities and inputs; its motors stand."""
    rng = np.random.default_rng(seed)
    state = linearization.at_rest(model, 2.0 * rng.standard_normal(model.nodes.shape) * ~model.fixed[:, None])
    inputs, wound = dict(state.inputs), list(model.actuated)
    inputs["rest_length"] = inputs["rest_length"] - 0.003 * rng.uniform(0.1, 1.0, len(model.strings))
    inputs["rest_length_rate"] = 0.1 * rng.standard_normal(len(model.strings))
    inputs["rest_length_rate"][wound] = 0.0
    for name in ("node_velocity", "node_acceleration"):
        inputs[name] = 0.3 * rng.standard_normal(inputs[name].shape)
    state = state._replace(inputs=inputs)
    still = inputs | {"node_velocity": 0.0 * inputs["node_velocity"]}
    chart = Chart(model, model.nodes, linearization.linearize(model, state._replace(inputs=still)))
    zero, w = np.zeros(chart.moved.shape[2]), rng.standard_normal(chart.phi.shape[2])
    velocity = chart.moving(0.0 * w, w, zero, inputs["node_velocity"].ravel())[1]
    return model, state._replace(velocity=velocity), w


def of_the_kernel(model, chart, x, v, inputs):
    """Second derivatives of the coordinates, and outputs, of the kernel at a state, its motors standing."""
    nodes, velocity, axes, free = model.nodes.copy(), np.zeros_like(model.nodes), chart.axes, model.free_nodes
    nodes[:, axes], velocity[:, axes] = x, v
    model = changed(model, nodes=nodes, velocity=velocity, rest_length=inputs["rest_length"])
    kernel = Kernel(model)
    for name, field in INPUTS.items():
        kernel[name][:] = flattened(field, model, np.asarray(inputs[name], dtype=float)[None])[0]
    kernel.initialize()
    rates, acceleration = kernel.output_derivatives(), np.zeros_like(x)
    acceleration[free] = rates["velocity"].reshape(len(free), -1)
    acceleration[list(model.moving)] = inputs["node_acceleration"][:, axes]
    seconds = chart.second(x, v, acceleration), rates["motor_speed"]
    return np.concatenate([*seconds, *(kernel[field.name].copy() for field in linearization.OUTPUTS)])


@pytest.mark.parametrize("seed", range(4))
def test_the_kernels_differences_about_a_moving_state(seed):
    """Payloads, drag, moved nodes, actuators, slanting gravity, a free bar, everything in motion: all columns of A, B, C, D."""
    require_the_kernels_differences(*in_motion(statics.settle(built(LABORATORY), steps=1), seed))


@pytest.mark.parametrize("law", ["literal", "tension_only"])
def test_the_kernels_differences_of_routed_strings(law):
    """And of strings with mass, and of springs that also push."""
    model, state, w = in_motion(built(RIGGED, damping_law=law), 3)
    require_the_kernels_differences(model, state, w)


@pytest.mark.parametrize("seed", range(12))
def test_the_kernels_differences_of_random_structures(seed):
    """Off balance and in motion, in space and in the plane, with honeycombs and slack strings, under both damping laws."""
    model, rng = random_model(seed), np.random.default_rng(seed)
    state = linearization.at_rest(model)
    chart = Chart(model, model.nodes, linearization.linearize(model, state))
    w = rng.standard_normal(chart.phi.shape[2])
    velocity, none = np.zeros_like(model.nodes), np.zeros(0)
    velocity[:, chart.axes] = chart.moving(0.0 * w, w, none, none)[1]
    rate = 0.1 * rng.standard_normal(len(model.strings))
    state = state._replace(velocity=velocity, inputs=state.inputs | {"rest_length_rate": rate})
    require_the_kernels_differences(model, state, w)


def require_the_kernels_differences(model, state, w):
    """The columns of A, B, C and D, but for speeds of motors; w: rates of the coordinates."""
    found = linearization.linearize(model, state)
    chart, n, r = Chart(model, model.nodes, found), len(found.A) // 2, len(w)

    def at(z):
        """z: deviations of all states and inputs."""
        inputs, u = {name: np.array(values) for name, values in state.inputs.items()}, z[2 * n :]
        for name, field in INPUTS.items():
            flat = flattened(field, model, inputs[name][None])[0].copy()
            kept = [i for i in range(len(flat)) if field.shape != ("S",) or i not in model.motors]
            flat[kept] += u[: len(kept)]
            u, inputs[name] = u[len(kept) :], spread(field, model, flat[None])[0]
        for motor, (j, actuator) in enumerate(model.motors.items()):
            inputs["rest_length"][j] -= actuator.radius * z[r + motor]
        p = (inputs["node_position"] - state.inputs["node_position"]).ravel()
        moving = chart.moving(z[:r], w + z[n : n + r], p, inputs["node_velocity"].ravel())
        assert len(u) == 0
        return of_the_kernel(model, chart, *moving, inputs)

    whole = np.block([[found.A[n:], found.B[n:]], [found.C, found.D]])
    start, size = at(np.zeros(whole.shape[1])), 2e-6
    np.testing.assert_allclose(start, [*found.drift[n:], *(q.value for q in found.outputs)], rtol=1e-8, atol=1e-8)
    for column in range(whole.shape[1]):
        if n + r <= column < 2 * n:
            continue  # speeds of motors, which start at rest in the kernel: see the step response below
        step = size * (np.arange(whole.shape[1]) == column)
        difference = (at(step) - at(-step)) / (2.0 * size)
        assert np.abs(difference - whole[:, column]).max() <= 1e-6 * max(1.0, np.abs(whole[:, column]).max()), column
    assert np.abs(found.A[n:]).max() > 0.0


@pytest.mark.parametrize("name, load", [("two_bar", 0.0), ("three_bar", 11.0), ("three_bar_nsh", 25.0), ("six_bar_nsh", 11.0)])
@pytest.mark.parametrize("what", ["force", "rest_length"])
def test_transfer_functions_are_those_of_small_motions_of_the_kernel(name, load, what):
    """Sines of 0.3, 3 and 30 Hz, begun on the steady oscillation, over one period; a rest length moves with its rate."""
    model, force = settled(name, load, 50.0)
    whole = about_rest(model, force)
    column = f"{model.node_names[model.free_nodes[0]]}.force.x" if what == "force" else f"{model.string_names[0]}.rest_length"
    for frequency in (0.3, 3.0, 30.0):
        omega, per_period = 2.0 * np.pi * frequency, 400
        used = (whole.with_motions() if what == "rest_length" else whole).only([column + "_rate" * (what == "rest_length")])
        rate = 1j * omega if what == "rest_length" else 1.0
        steady = np.linalg.solve(1j * omega * np.eye(len(used.A)) - used.A, used.B[:, 0]) * rate
        expected = used.response(1j * omega)[:, 0] * rate
        n = len(whole.A)
        size = 1e-7 / np.abs(whole.C[: model.nodes[:, list(model.axes)].size] @ steady[:n]).max()
        error = swung(model, force, whole, column, size, steady[:n], omega, per_period, expected)
        assert error.max() < 1e-5, (frequency, error)


def swung(model, force, found, column, size, steady, omega, count, expected):
    """Largest differences of positions and elastic tensions over a period, of their amplitudes' largest."""
    axes, free = list(model.axes), model.free_nodes
    nodes, velocity = model.nodes.copy(), np.zeros_like(model.nodes)
    places = nodes[:, axes].size
    start = (found.C @ (size * steady)).imag  # at t = 0, of the motion Im(. exp(i w t))
    nodes[:, axes] += start[:places].reshape(len(nodes), -1)
    fastest = start[places : places + len(free) * len(axes)].reshape(len(free), -1)
    velocity[np.ix_(free, axes)] = fastest
    kernel = Kernel(changed(model, nodes=nodes, velocity=velocity), tolerance=1e-13)
    kernel["force"][:] = force[free][:, axes].ravel()
    index = [q.name for q in found.inputs].index(column)
    at, inputs = kernel_place(kernel, model, column), len(kernel.slopes[0])
    before, values = found.inputs[index].value, []
    rest = column.endswith("rest_length")
    for k in range(count + 1):
        sine, cosine = np.sin(omega * k / count * 2.0 * np.pi / omega), np.cos(omega * k / count * 2.0 * np.pi / omega)
        kernel.values[at] = before + size * sine
        kernel.slopes[:] = 0.0
        if rest:
            rate = kernel.layout["rest_length_rate"].start + at - kernel.layout["rest_length"].start
            kernel.values[rate] = size * omega * cosine
            kernel.slopes[:, rate] = -size * omega**2 * sine, -size * omega**3 * cosine
        else:
            kernel.slopes[:, at] = size * omega * cosine, -size * omega**2 * sine
        assert at < inputs
        if k == 0:
            kernel.initialize()
        values.append(np.concatenate([kernel["position"], kernel["elastic_force"]]))
        kernel.step(2.0 * np.pi / omega / count)
    names = [q.name for q in found.outputs]
    elastic = [i for i, name in enumerate(names) if name.endswith(".elastic_force")]
    chosen = [*range(places), *elastic]
    here = np.array([found.outputs[i].value for i in chosen])
    phase = np.exp(2j * np.pi * np.arange(count + 1) / count)
    linear = here + (size * expected[chosen] * phase[:, None]).imag
    off = np.abs(np.array(values) - linear).max(axis=0)
    groups = slice(0, places), slice(places, None)
    return np.array([off[g].max() / np.abs(size * expected[chosen][g]).max() for g in groups])


def kernel_place(kernel, model, column):
    owner = column.split(".")[0]
    if column.endswith("rest_length"):
        return kernel.layout["rest_length"].start + model.string_names.index(owner)
    node = list(model.free_nodes).index(model.node_names.index(owner))
    return kernel.layout["force"].start + node * len(model.axes)


def test_a_current_steps_up():
    """The response of a mast to a little more current is that of the linear system, motor and all."""
    model = built(MAST)
    found = about_rest(model).only(["s2.current"], ["n2.x", "s2.force", "s2.actuator.speed", "s2.rest_length", "n1.reaction.z"])
    assert np.abs(found.drift).max() < 1e-9
    size, times = 1e-6, grid(0.5, 0.01)
    run = tc.simulate(model, {"s2.current": model.current[0] + size}, duration=0.5, step=0.01, tolerance=1e-13)
    step = np.linalg.inv(found.A) @ found.B[:, 0]
    linear = np.array([found.C @ (scipy.linalg.expm(found.A * t) @ step - step) + found.D[:, 0] for t in times])
    for i, quantity in enumerate(found.outputs):
        change = (run[quantity.name].values - quantity.value) / size
        assert np.abs(change - linear[:, i]).max() < 1e-4 * np.abs(linear[:, i]).max(), quantity.name


@pytest.mark.parametrize("name", [name for name in STRINGS if name != "cells"])
def test_every_kind_of_string(name):
    model, force = mast(name), np.zeros((4, 3))
    force[1, 0] = 4.0
    model = statics.settle(model, force=force, steps=4)
    known = np.array([mode.eigenvalue for mode in modes.modes(model, force)])
    known = np.concatenate([known, known[known.imag > 0.0].conj()])
    require_same(about_rest(model, force).poles, known, 1e-9)


# --- states, motions, files, mistakes ----------------------------------------------------------------------------------


def test_the_last_row_of_a_run():
    inputs = {"n4.force.z": 25.0, "s4.rest_length": lambda t: 1.64 + 0.05 * t}
    run = tc.simulate("three_bar_nsh", inputs, duration=0.13)
    found = tc.linearize(run)
    assert not found.drift.max() < 0.01
    for quantity in found.outputs:
        assert quantity.value == pytest.approx(float(run[quantity.name][-1]), rel=1e-9, abs=1e-8)
    later = tc.simulate("three_bar_nsh", inputs, duration=0.131, step=0.001)
    ahead = scipy.linalg.expm(0.001 * np.block([[found.A, found.drift[:, None]], [np.zeros((1, len(found.A) + 1))]]))[:-1, -1]
    whole = found.C @ ahead + [q.value for q in found.outputs]
    assert abs(whole[[q.name for q in found.outputs].index("n5.z")] - float(later["n5.z"][-1])) < 1e-6
    with pytest.raises(InputError, match="leave them out"):
        tc.linearize(run, {"n4.force.z": 1.0})


def test_any_row_of_a_run():
    """The same as the last row of a run that ends there."""
    inputs = {"n4.force.z": lambda t: 300.0 * t, "s4.rest_length": lambda t: 1.64 + 0.05 * t}
    run = tc.simulate("three_bar_nsh", inputs, duration=0.13)
    for time in (0.07, 0.13):
        found, alone = tc.linearize(run, time=time), tc.linearize(tc.simulate("three_bar_nsh", inputs, duration=time))
        np.testing.assert_allclose(found.A, alone.A, rtol=0.0, atol=1e-9 * np.abs(alone.A).max())
        for quantity in found.outputs:
            assert quantity.value == pytest.approx(
                float(run[quantity.name].sel(time=time, method="nearest")), rel=1e-9, abs=1e-8
            )
    assert {q.name: q.value for q in tc.linearize(run, time=0.0).outputs}["n4.z"] == pytest.approx(float(run["n4.z"][0]))
    with pytest.raises(InputError, match=r"time = 0.074 s is no row .* the next one is at 0.07 s"):
        tc.linearize(run, time=0.074)
    with pytest.raises(InputError, match="is no row"):
        tc.linearize(run, time=np.nan)
    with pytest.raises(InputError, match="a steady state has none"):
        tc.linearize("two_bar", time=1.0)
    with pytest.raises(InputError, match=r"motions = 'n1': give True or False"):
        tc.linearize("two_bar", motions="n1")


@pytest.mark.parametrize("ending", [".nc", ".parquet", ".csv", ".npz"])
def test_a_row_of_a_runs_file(ending, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["--duration", "0.2", "--step", "0.01", "--output", f"run@1{ending}"]
    assert main(["simulate", "three_bar_nsh", "--force", "n4.z=45", *words]) == 0
    expected = tc.linearize(tc.simulate("three_bar_nsh", {"n4.force.z": 45.0}, duration=0.2, step=0.01), time=0.07)
    capsys.readouterr()
    assert main(["linearize", "three_bar_nsh", "--at", f"run@1{ending}@0.07", "--force", "n4.z=45", "--json"]) == 0
    np.testing.assert_allclose(json.loads(capsys.readouterr().out)["A"], expected.A, rtol=1e-9, atol=1e-6)
    assert main(["linearize", "three_bar_nsh", "--at", f"run@1{ending}", "--force", "n4.z=45"]) == 0
    for at, told in (
        (f"run@1{ending}@0.074", "is no row of run@1"),
        ("nowhere.csv@1", "nowhere.csv"),
        (f"run@1{ending}@x", "'x'"),
    ):
        assert main(["linearize", "three_bar_nsh", "--at", at]) == 2
        assert told in capsys.readouterr().err


def test_a_run_with_other_rest_lengths_is_not_taken(tmp_path, capsys):
    run = tc.simulate("two_bar", {"s3.rest_length": lambda t: scene("two_bar").rest_length[2] - 0.1 * t}, duration=0.1)
    assert main(["linearize", "two_bar", "--at", str(run.save(tmp_path / "run.csv"))]) == 2
    assert "s3 pulls with" in capsys.readouterr().err


def test_a_clipped_string_is_named():
    """Under tension_only the damper of a string that shortens quickly would push: its tension is 0 and stays so."""
    model = changed(scene("two_bar"), damping=5000.0, damping_law="tension_only")
    run = tc.simulate(model, {"n4.force.z": -60.0, "n3.force.z": -60.0}, duration=0.05, step=0.001)
    slack = np.flatnonzero((run.result.string_force[-1] == 0.0) & (run.result.elastic_force[-1] > 0.0))
    assert len(slack)
    found = tc.linearize(run)
    clipped = [name for name, branch in found.strings.items() if "clipped" in branch]
    assert clipped == [model.string_names[j] for j in slack]
    force = [q.name for q in found.outputs].index(f"{clipped[0]}.force")
    assert not found.C[force].any() and "clipped" in found.summary()


def test_inputs_that_move_are_states():
    held_still = tc.linearize("two_bar", outputs=["n4.z"])
    moved = held_still.with_motions()
    assert [q.name for q in moved.states[4:]] == [f"s{i}.rest_length" for i in (1, 2, 3)]
    s, names = 2.0 + 3.0j, [q.name for q in held_still.inputs]
    one = held_still.response(s)[0]
    both = one[names.index("s2.rest_length")] / s + one[names.index("s2.rest_length_rate")]
    there = [q.name for q in moved.inputs].index("s2.rest_length_rate")
    assert moved.response(s)[0, there] == pytest.approx(both, rel=1e-12)
    np.testing.assert_allclose(moved.only(["n4.force.z"]).to_scipy().A, moved.A)


def test_files(tmp_path):
    found = tc.linearize("three_bar_nsh", {"n4.force.z": 20.0}, ["n4.force.z", "s1.rest_length"], ["n4.z", "s1.force"])
    text = json.loads(found.save(tmp_path / "ü #1.json").read_text(encoding="utf-8"))
    assert text["inputs"][1]["name"] == "s1.rest_length" and text["strings"] == found.strings
    np.testing.assert_array_equal(text["A"], found.A)
    read = io.loadmat(found.save(tmp_path / "linear.mat"))
    np.testing.assert_array_equal(read["C"], found.C)
    assert [str(cell[0]) for cell in read["OutputName"][:, 0]] == ["n4.z", "s1.force"]
    assert [str(cell[0]) for cell in read["InputUnit"][:, 0]] == ["N", "m"]
    with pytest.raises(InputError, match="does not end in"):
        found.save(tmp_path / "linear.xls")


def test_a_string_at_an_end_of_its_piece_has_two_derivatives():
    """The guy on the right at exactly its rest length: k of the one, or of both."""
    k, reach = 900.0, 0.8
    model = one_bar([0, 0, 1.0], [[-reach, 0, 1.0], [reach, 0, 1.0]], [reach, reach], damping=0.0)
    with pytest.raises(InputError, match="two derivatives .* choose one"):
        about_rest(model)
    for side, factor in (("longer", 2.0), ("shorter", 0.0)):
        found = about_rest(model, side=side)
        np.testing.assert_allclose(found.A[-1, 0], -factor * k * 3.0, rtol=1e-12, atol=1e-12)
    with pytest.raises(InputError, match="use longer or shorter"):
        about_rest(model, side="up")


def test_mistakes_are_named():
    for words, match in [
        ({"inputs": ["n4.force.zz"]}, r"n4.force.zz is no input of two_bar; did you mean n4.force.z"),
        ({"outputs": ["energy.kinetic"]}, "is no output of two_bar"),
        ({"outputs": ["n4.z", "n4.z"]}, "given twice"),
        ({"forces": {"n4.force.q": 1.0}}, "no input"),
    ]:
        with pytest.raises(InputError, match=match):
            tc.linearize("two_bar", **words)
    model = scene("two_bar")
    state = linearization.at_rest(model)
    with pytest.raises(InputError, match="off its length"):
        linearization.linearize(model, state._replace(nodes=model.nodes + 0.1 * ~model.fixed[:, None]))
    velocity = (model.nodes - model.nodes[0]) * ~model.fixed[:, None]
    with pytest.raises(InputError, match="velocities stretch"):
        linearization.linearize(model, state._replace(velocity=velocity))


def test_the_command(tmp_path, capsys):
    path = tmp_path / "linear.mat"
    words = ["--inputs", "n4.force.z", "s1.rest_length_rate", "--outputs", "n4.z", "s1.force"]
    force = ["--force", "n3.z=25", "n4.z=25"]
    assert main(["linearize", "two_bar_nsh", *force, *words, "--output", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "4 states, 2 inputs, 2 outputs" in shown and "snapped" in shown and path.is_file()
    assert main(["linearize", "two_bar_nsh", "--motions", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["states"]) == 7
