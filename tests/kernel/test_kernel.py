"""The C kernel: its equations, its transitions, its invariants, and what it does when it is driven too hard."""

import dataclasses
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegrity_core import fields, kernel, reference
from tensegrity_core.errors import InputError, SimulationError, TensegrityError
from tensegrity_core.kernel import Kernel, to_bytes
from tensegrity_core.laws import law
from tensegrity_core.model import NSH, Inputs, components, grid, held
from tensegrity_core.model.inputs import INPUTS, starts
from tests.support import changed, push, scene
from tests.support.driven_scenes import LABORATORY, built

SCENES = ("two_bar", "two_bar_nsh", "three_bar", "three_bar_nsh", "six_bar", "six_bar_nsh")


def constant(model, force, duration, step):
    return held(model, grid(duration, step), force=lambda t: force)


def square_wave(model, duration=5.0, step=0.01, node="n4"):
    at = model.node_names.index(node)
    force = np.zeros((2, len(model.nodes), 3))
    force[:, at, 2] = 400.0, -400.0
    return held(model, grid(duration, step), force=lambda t: force[int(t % 1.0 >= 0.5)])


def test_header_is_up_to_date():
    header = Path(fields.__file__).parent / "native" / "fields.h"
    assert header.read_text(encoding="utf-8") == fields.c_header(), "run python -m tensegrity_core.fields"


# --- the equations -------------------------------------------------------------------------------------------------


def moving(model, seed):
    """The model with random start velocities that keep the bars' lengths, and slackened or tightened strings."""
    random = np.random.default_rng(seed)
    velocity = random.normal(size=model.nodes.shape)
    velocity[:, [a for a in range(3) if a not in model.axes]] = 0.0
    velocity[model.fixed] = 0.0
    for i, j in model.bars:
        b = model.nodes[j] - model.nodes[i]
        stretch = (velocity[j] - velocity[i]) @ b / (b @ b) * b
        share = 0.5 if not (model.fixed[i] or model.fixed[j]) else 1.0
        if not model.fixed[j]:
            velocity[j] -= share * stretch
        if not model.fixed[i]:
            velocity[i] += share * stretch
    rest = model.rest_length * random.uniform(0.9, 1.02, len(model.strings))
    return dataclasses.replace(model, velocity=velocity, rest_length=rest)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("seed", [1, 2])
def test_forces_and_reactions_equal_the_references(name, seed):
    model = moving(scene(name), seed)
    force = np.random.default_rng(seed).normal(size=(len(model.nodes), 3)) * 30.0
    inputs = constant(model, force * ~model.fixed[:, None], 1e-4, 1e-4)
    ours, theirs = kernel.simulate(model, inputs), reference.simulate(model, inputs)
    for field in ("string_force", "elastic_force", "string_length", "bar_force", "reaction", "kinetic", "potential", "elastic"):
        a, b = getattr(ours, field), getattr(theirs, field)
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9 * (1.0 + np.abs(b).max()), err_msg=field)
    np.testing.assert_allclose(ours.position, theirs.position, rtol=0, atol=1e-13)
    np.testing.assert_allclose(ours.velocity, theirs.velocity, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(ours.snapped, theirs.snapped)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("law", fields.DAMPING_LAWS)
def test_jacobian_is_the_derivative_of_the_right_hand_side(name, law):
    model = dataclasses.replace(moving(scene(name), 3), damping_law=law)
    k = Kernel(model)
    k["rest_length_rate"][:] = 0.3
    k["force"][:] = 5.0
    k.initialize()
    y, tau, n = k.state, 0.002, (len(k.state) - 3) // 2
    Jq, Jv, ft = k.jacobian(y, tau)
    J = np.hstack([Jq, Jv])
    for i in range(2 * n):
        step = np.zeros(len(y))
        step[i] = 1e-6
        column = (k.derivative(y + step, tau) - k.derivative(y - step, tau))[n : 2 * n] / 2e-6
        np.testing.assert_allclose(J[:, i], column, rtol=0, atol=1e-7 * np.abs(J).max())
    by_time = (k.derivative(y, tau + 1e-5) - k.derivative(y, tau - 1e-5))[n : 2 * n] / 2e-5
    np.testing.assert_allclose(ft, by_time, rtol=0, atol=1e-6 * (1.0 + np.abs(ft).max()))


# --- negative stiffness honeycombs ---------------------------------------------------------------------------------

beams = st.lists(st.tuples(st.floats(0.5, 50.0), st.floats(2.05, 7.95), st.floats(1e-3, 0.05)), min_size=1, max_size=6)


def curve_errors(honeycomb, samples=400):
    """Largest errors of the kernel's table against the exact curve: force, stiffness (relative), energy (relative)."""
    model = scene("three_bar_nsh")
    model = dataclasses.replace(model, nsh=tuple(honeycomb if n else None for n in model.nsh))
    k, string = Kernel(model), model.nsh_strings[0]
    k.initialize()
    made = law(honeycomb.element, model.stiffness.item(string))
    ends = made.breakpoints
    np.testing.assert_allclose(k.breakpoints(string), ends, rtol=1e-12, atol=1e-13)
    inside = np.concatenate([np.linspace(a, b, max(3, samples // len(ends)))[1:-1] for a, b in pairwise(ends)])
    xi = np.concatenate([[-1e-3], inside, [1.01 * ends[-1]]])
    ours = np.array([k.string_law(string, x)[:3] for x in xi])
    exact = [np.array([value(x) for x in xi]) for value in (made.force, made.stiffness, made.energy)]
    scale = max(4.0 * q for q in honeycomb.Q)
    return (
        np.abs(ours[:, 0] - exact[0]).max(),
        (np.abs(ours[:, 1] - exact[1]) / (np.abs(exact[1]) + scale / ends[-1])).max(),
        (np.abs(ours[:, 2] - exact[2])).max() / (scale * ends[-1]),
    )


def test_table_of_the_articles_honeycomb():
    force, stiffness, energy = curve_errors(scene("three_bar_nsh").nsh[0], samples=4000)
    assert force <= 2e-11 and stiffness <= 1e-8 and energy <= 1e-12


@settings(max_examples=40, deadline=None, derandomize=True)
@given(beams)
def test_table_of_any_honeycomb(rows):
    Q, zeta, h = zip(*rows)
    force, stiffness, energy = curve_errors(NSH(Q, zeta, h))
    assert force <= 1e-9 and stiffness <= 1e-5 and energy <= 1e-10


# --- transitions ---------------------------------------------------------------------------------------------------


ADAPTIVE = ["auto", "dop853", "rodas5p", "radau9", "dopri5"]


@pytest.mark.parametrize("method", ADAPTIVE)
@pytest.mark.parametrize("damping, count", [(50, 26), (500, 8), (5000, 8)])
def test_every_transition_is_found_at_every_tolerance(method, damping, count):
    model = changed(scene("three_bar"), damping)
    inputs = constant(model, push(model), 1.0, 1.0)
    tight = kernel.simulate(model, inputs, method="dop853", tolerance=1e-13).transitions
    assert len(tight) == count
    for tolerance in (1e-4, 1e-6, 1e-8, 1e-10, 1e-12):
        found = kernel.simulate(model, inputs, method=method, tolerance=tolerance).transitions
        key = [(t.string, t.before, t.after) for t in sorted(found, key=lambda t: (round(t.time, 5), t.string))]
        assert key == [(t.string, t.before, t.after) for t in sorted(tight, key=lambda t: (round(t.time, 5), t.string))]
        assert max(abs(a.time - b.time) for a, b in zip(found, tight)) < 50 * tolerance + 1e-9


@pytest.mark.parametrize("law", fields.DAMPING_LAWS)
@pytest.mark.parametrize("name, damping", [("three_bar", 50), ("three_bar_nsh", 500)])
def test_reference_agrees_under_both_damping_laws(name, damping, law):
    model = changed(scene(name), damping, damping_law=law)
    inputs = constant(model, push(model), 0.5, 0.02)
    ours, theirs = kernel.simulate(model, inputs), reference.simulate(model, inputs)
    assert np.abs(ours.position - theirs.position).max() < 1e-9
    assert [(t.string, t.before, t.after) for t in ours.transitions] == [
        (t.string, t.before, t.after) for t in theirs.transitions
    ]
    assert len(ours.transitions) > 3
    assert max(abs(a.time - b.time) for a, b in zip(ours.transitions, theirs.transitions)) < 1e-8


def test_symmetric_strings_change_together():
    """The scene's coordinates are rounded to mm; made exactly threefold, its strings change in threes."""
    model = changed(scene("three_bar"), 50)
    nodes, rest = model.nodes.copy(), model.rest_length.copy()
    third = np.array([[-0.5, -np.sqrt(0.75), 0], [np.sqrt(0.75), -0.5, 0], [0, 0, 1.0]])
    for base, image in ((0, 1), (1, 2), (3, 5), (5, 4)):
        nodes[image] = third @ nodes[base]
    model = dataclasses.replace(model, nodes=nodes, rest_length=np.repeat(rest[[0, 3]], 3))
    result = kernel.simulate(model, constant(model, push(model, -60.0, 0.0), 0.2, 0.2))
    times = np.array([t.time for t in result.transitions])
    assert len(times) >= 6 and len(times) % 3 == 0
    assert np.ptp(times.reshape(-1, 3), axis=1).max() < 1e-10


def test_a_string_at_its_rest_length_becomes_taut_when_pulled():
    model = scene("three_bar")
    length = np.linalg.norm(model.nodes[model.strings[:, 1]] - model.nodes[model.strings[:, 0]], axis=1)
    model = dataclasses.replace(model, rest_length=length, gravity=0.0)
    still = kernel.simulate(model, constant(model, np.zeros((6, 3)), 1.0, 0.1))
    np.testing.assert_allclose(still.position, np.broadcast_to(model.nodes, still.position.shape), atol=1e-14)
    inputs = constant(model, push(model, 10.0, 0.0), 0.5, 0.01)
    ours, theirs = kernel.simulate(model, inputs), reference.simulate(model, inputs)
    assert np.abs(ours.position - theirs.position).max() < 1e-9
    assert (ours.string_force[-1, :3] > 1.0).all()


def test_a_transition_at_a_communication_point_is_taken_once():
    model = changed(scene("three_bar"), 50)
    force = push(model)
    first = kernel.simulate(model, constant(model, force, 1.0, 1.0)).transitions[0]
    times = np.array([0.0, first.time, 0.5, 1.0])
    split = kernel.simulate(model, held(model, times, force=lambda t: force))
    whole = kernel.simulate(model, held(model, [0.0, 0.5, 1.0], force=lambda t: force))
    assert len(split.transitions) == len(whole.transitions) == 26
    np.testing.assert_allclose(split.position[-1], whole.position[-1], rtol=0, atol=1e-9)


# --- accuracy and invariants ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "method, order, steps, slack",
    [
        ("dop853", 8, (3, 6), 0.6),
        ("rodas5p", 5, (8, 16), 0.6),
        ("rk4", 4, (20, 40), 0.6),
        ("ros2", 2, (40, 80), 0.2),
        ("radau9", 9, (1, 2), 1.0),
        ("dopri5", 5, (4, 8), 0.6),
    ],
)
def test_measured_order(method, order, steps, slack):
    """Fixed steps (a loose tolerance, a largest step) on a stretch without transitions.  Radau's Newton iterations stop at
    the tolerance's scale, which costs some of its order."""
    model = changed(scene("three_bar"), 20)
    inputs = constant(model, push(model, 5.0, 3.0), 0.03, 0.03)
    exact = kernel.simulate(model, inputs, tolerance=1e-14)
    assert not exact.transitions

    def error(n):
        run = kernel.simulate(model, inputs, method=method, tolerance=0.1, max_step=0.03 / n)
        assert n <= run.stats["steps"] <= n + 3
        return np.abs(run.position[-1] - exact.position[-1]).max()

    coarse, fine = error(steps[0]), error(steps[1])
    assert fine > 1e-13, "already at round-off: the order is not measured"
    assert order - slack < np.log(coarse / fine) / np.log(steps[1] / steps[0]) < order + 1.6


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("damping", [0, 50, 5000])
def test_energy_ledger_closes(name, damping):
    model = changed(scene(name), damping)
    times = grid(2.0, 0.01)
    sway = 0.02 * np.sin(2 * np.pi * np.arange(len(model.strings)) / 3.0)
    force = push(model, 30.0, 15.0)
    inputs = held(
        model,
        times,
        force=lambda t: force if t < 1.0 else -force,
        rest_length=lambda t: model.rest_length + sway * np.sin(4.0 * t),
    )
    jumped = dataclasses.replace(inputs, rest_length=inputs.rest_length + 0.01 * (inputs.times[:-1, None] >= 1.5))
    for tolerance in (1e-10, 1e-12):
        result = kernel.simulate(model, jumped, tolerance=tolerance)
        assert result.throughput[-1] > 0.01
        assert result.ledger_error() < 1e-8


@pytest.mark.parametrize("name", ["three_bar", "three_bar_nsh", "six_bar"])
@pytest.mark.parametrize("damping", [1, 500, 5000])
def test_bar_lengths_hold_for_50_s(name, damping):
    model = changed(scene(name), damping)
    run = kernel.simulate(model, square_wave(model, duration=50.0, step=0.5), tolerance=1e-8)
    lengths = np.linalg.norm(run.position[:, model.bars[:, 1]] - run.position[:, model.bars[:, 0]], axis=2)
    assert np.abs(lengths / model.bar_length - 1.0).max() < 1e-12
    axial = np.einsum(
        "tbx,tbx->tb",
        run.position[:, model.bars[:, 1]] - run.position[:, model.bars[:, 0]],
        run.velocity[:, model.bars[:, 1]] - run.velocity[:, model.bars[:, 0]],
    )
    assert np.abs(axial).max() < 1e-12 * max(1.0, np.abs(run.velocity).max())


@pytest.mark.parametrize("name", ["three_bar", "three_bar_nsh"])
def test_a_rotated_scene_moves_the_same(name):
    model = changed(scene(name), 50)
    angle = 0.7
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
    rotated = dataclasses.replace(model, nodes=model.nodes @ turn.T, nominal=model.nominal @ turn.T)
    force = push(model)
    a = kernel.simulate(model, constant(model, force, 1.0, 0.1))
    b = kernel.simulate(rotated, constant(rotated, force @ turn.T, 1.0, 0.1))
    np.testing.assert_allclose(a.position @ turn.T, b.position, rtol=0, atol=1e-9)
    assert len(a.transitions) == len(b.transitions)


@pytest.mark.parametrize("name", ["three_bar", "three_bar_nsh"])
def test_relabelled_nodes_move_the_same(name):
    model = changed(scene(name), 50)
    order = np.array([4, 2, 0, 5, 1, 3])  # new place -> old node
    place = np.argsort(order)
    strings = place[model.strings][::-1, ::-1]
    other = dataclasses.replace(
        model,
        node_names=tuple(model.node_names[i] for i in order),
        nodes=model.nodes[order],
        fixed=model.fixed[order],
        nominal=model.nominal[order],
        velocity=model.velocity[order],
        bars=place[model.bars][[2, 0, 1]][:, ::-1],
        strings=strings,
        rest_length=model.rest_length[::-1],
        nsh=model.nsh[::-1],
        stiffness=model.stiffness[::-1],
    )
    force = push(model)
    a = kernel.simulate(model, constant(model, force, 1.0, 0.1))
    b = kernel.simulate(other, constant(other, force[order], 1.0, 0.1))
    np.testing.assert_allclose(a.position[:, order], b.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(a.reaction[:, order], b.reaction, rtol=0, atol=1e-6)


def test_a_free_structure_keeps_its_momentum():
    model = scene("six_bar")
    free = dataclasses.replace(moving(model, 5), fixed=np.zeros(12, bool), gravity=0.0, damping=model.damping * 0.1)
    inputs = constant(free, np.zeros((12, 3)), 5.0, 0.5)
    run = kernel.simulate(free, inputs)
    mass = np.zeros(12)
    np.add.at(mass, free.bars.ravel(), np.repeat(0.5 * free.bar_mass, 2))
    momentum = np.einsum("n,tnx->tx", mass, run.velocity)
    np.testing.assert_allclose(momentum, np.broadcast_to(momentum[0], momentum.shape), atol=1e-11)
    angular = sum(
        m * np.cross(0.5 * (run.position[:, i] + run.position[:, j]), 0.5 * (run.velocity[:, i] + run.velocity[:, j]))
        + m / 12.0 * np.cross(run.position[:, j] - run.position[:, i], run.velocity[:, j] - run.velocity[:, i])
        for (i, j), m in zip(free.bars, free.bar_mass)
    )
    np.testing.assert_allclose(angular, np.broadcast_to(angular[0], angular.shape), atol=1e-8)


@pytest.mark.parametrize("method", ADAPTIVE)
@pytest.mark.parametrize("damping, factor", [(50, 1), (5000, 1), (500, 100), (1e5, 1), (0, 100)])
def test_methods_agree_where_one_of_them_finds_it_stiff(method, damping, factor):
    model = changed(scene("three_bar"), damping, factor)
    inputs = constant(model, push(model), 0.3, 0.1)
    exact = kernel.simulate(model, inputs, method="dop853", tolerance=1e-12)
    run = kernel.simulate(model, inputs, method=method, tolerance=1e-9)
    assert np.abs(run.position - exact.position).max() < 1e-6


# --- state ---------------------------------------------------------------------------------------------------------


def test_a_rollback_repeats_to_the_last_bit():
    model = changed(scene("three_bar_nsh"), 50)
    k = Kernel(model)
    k["force"][:] = push(model)[model.free_nodes].ravel()
    k.initialize()
    for _ in range(20):
        k.step(0.01)
    state = k.save()

    def go_on(kernel):
        rows = []
        for n in range(30):
            kernel["rest_length"][3] = model.rest_length[3] - 0.001 * n
            kernel["damping"][0] = 50.0 + n
            kernel.step(0.003 + 0.001 * (n % 3))
            rows.append(kernel.values.copy())
        return np.array(rows)

    first = go_on(k)
    k.restore(state)
    np.testing.assert_array_equal(go_on(k), first)
    other = Kernel(model)
    other.restore(state)
    np.testing.assert_array_equal(go_on(other), first)


def test_foreign_and_damaged_states_are_refused():
    k, other = Kernel(scene("three_bar")), Kernel(scene("three_bar_nsh"))
    k.initialize()
    other.initialize()
    state = k.save()
    broken = bytearray(state)
    broken[len(state) // 2] ^= 1
    for bytes_ in (other.save(), bytes(broken), state[:-8], b"", state + b"\0" * 8):
        with pytest.raises(InputError, match="saved state"):
            k.restore(bytes_)
    assert k.save() == state
    k.restore(state)


def test_damaged_models_are_refused():
    packed = to_bytes(scene("three_bar"))
    random = np.random.default_rng(7)
    for _ in range(200):
        broken = bytearray(packed)
        broken[random.integers(len(packed))] ^= 1 << random.integers(8)
        with pytest.raises(TensegrityError, match="refused"):
            Kernel(bytes(broken))
    for bytes_ in (b"", packed[:-1], packed + b"\0", packed[: len(packed) // 2]):
        with pytest.raises(TensegrityError, match="refused"):
            Kernel(bytes_)


# --- driven too hard -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "field, value, says",
    [
        ("force", np.nan, "not a finite"),
        ("force", np.inf, "not a finite"),
        ("rest_length", -1e-9, "negative"),
        ("rest_length", np.nan, "not a finite"),
        ("rest_length_rate", -np.inf, "not a finite"),
        ("stiffness", -1.0, "negative"),
        ("damping", -1.0, "negative"),
        ("gravity", np.nan, "not a finite"),
    ],
)
def test_bad_inputs_are_named_and_leave_no_trace(field, value, says):
    k = Kernel(scene("three_bar_nsh"))
    k.initialize()
    k.step(0.01)
    good, before = k[field][-1], k.values.copy()
    k[field][-1] = value
    with pytest.raises(InputError, match=rf"{field}\[\d+\].*{says}"):
        k.step(0.01)
    k[field][-1] = good
    np.testing.assert_array_equal(k.values, before)
    k.step(0.01)
    twin = Kernel(scene("three_bar_nsh"))
    twin.initialize()
    twin.step(0.01)
    twin.step(0.01)
    np.testing.assert_array_equal(k.values, twin.values)


@pytest.mark.parametrize(
    "field, value",
    [
        ("bar_mass", 0.0),
        ("nsh_zeta", 9.0),
        ("nsh_Q", -1.0),
        ("nsh_h", 0.0),
        ("tolerance", 0.0),
        ("max_step", -1.0),
        ("method", 99),
    ],
)
def test_bad_parameters_are_refused_at_the_start(field, value):
    k = Kernel(scene("three_bar_nsh"))
    k.initialize()
    before = k.state
    k[field][0] = value
    with pytest.raises(InputError, match=rf"{field}\[0\]"):
        k.initialize()
    np.testing.assert_array_equal(k.state, before)


@pytest.mark.parametrize("field, value", [("bar_mass", 2.0), ("tolerance", 1e-6), ("method", 2)])
def test_fixed_parameters_are_fixed(field, value):
    k = Kernel(scene("three_bar"))
    k.initialize()
    k[field][0] = value
    with pytest.raises(InputError, match="is fixed, and was changed"):
        k.step(0.01)
    k.initialize()
    k.step(0.01)


def test_analysis_needs_no_start_and_checks_its_arguments():
    k = Kernel(scene("three_bar_nsh"))
    assert k.string_law(0, 0.01)[0] > 0.0 and len(k.breakpoints(0)) == 13
    for call in (lambda: k.string_law(99, 0.01), lambda: k.breakpoints(-1), lambda: k.derivative(np.zeros(3))):
        with pytest.raises(InputError, match="string|shape"):
            call()


def test_views_outlive_their_kernel():
    rest = Kernel(scene("three_bar"))["rest_length"]
    others = [Kernel(scene("three_bar_nsh")) for _ in range(20)]
    np.testing.assert_array_equal(rest, scene("three_bar").rest_length)
    assert len(others) == 20


def test_a_restored_kernel_has_the_derivative_of_its_state():
    model = scene("three_bar_nsh")
    k, other = Kernel(model), Kernel(dataclasses.replace(model))
    k.initialize()
    k.step(0.1)
    other["gravity"][:] = 0.0
    other.initialize()
    other.restore(k.save())
    np.testing.assert_array_equal(other.derivative(k.state), k.derivative(k.state))


@pytest.mark.parametrize("h", [0.0, -1.0, np.nan, np.inf])
def test_bad_steps_are_refused(h):
    k = Kernel(scene("three_bar"))
    k.initialize()
    with pytest.raises(InputError, match="positive and finite"):
        k.step(h)


def test_a_rest_length_that_would_become_negative_is_refused():
    k = Kernel(scene("three_bar"))
    k.initialize()
    k["rest_length_rate"][2] = -2.0
    k.step(0.1)
    with pytest.raises(InputError, match="negative within the step") as failure:
        k.step(10.0)
    assert k.place(failure.value.index) == ("rest_length", 2)
    k["rest_length_rate"][2] = 0.0
    for name, told in {"bar_mass": "is fixed", "method": "is fixed"}.items():
        before = k[name][0].item()
        k[name][0] = before + 1
        with pytest.raises(InputError, match=f"{name}.0. = .* {told}") as failure:
            k.step(0.1)
        assert k.place(failure.value.index) == (name, 0)
        k[name][0] = before
    k.slopes[0, 5] = np.nan
    with pytest.raises(InputError, match="force.5. = 0.0 has a derivative that is not a finite number"):
        k.step(0.1)


@pytest.mark.parametrize("name", ["three_bar", "three_bar_nsh", "two_bar_nsh", "six_bar"])
@pytest.mark.parametrize("size", [1e5, 1e9])
def test_an_absurd_force_is_answered_or_refused(name, size):
    """1e9 N on a 1 kg bar: thousands of turns and many transitions within one step."""
    model = scene(name)
    k = Kernel(model)
    k["force"][2] = size
    k.initialize()
    before = k.state
    try:
        k.step(0.05)
    except SimulationError as error:
        assert error.status in ("work_limit", "step_too_small", "not_finite")
        np.testing.assert_array_equal(k.state, before)
    else:
        position = k["position"].reshape(-1, len(model.axes))
        lengths = np.linalg.norm(position[model.bars[:, 1]] - position[model.bars[:, 0]], axis=1)
        np.testing.assert_allclose(lengths, model.bar_length, rtol=1e-12)


def test_an_infinite_acceleration_is_named():
    model = dataclasses.replace(scene("three_bar"), bar_mass=np.full(3, 1e-300))
    k = Kernel(model)
    k.initialize()
    k["force"][2] = 1e300
    before = k.save()
    with pytest.raises(SimulationError, match="not_finite"):
        k.step(1e-3)
    assert k.save() == before
    with pytest.raises(SimulationError, match="not_finite"):
        k.initialize()


def test_a_transition_a_few_ulp_before_a_communication_point():
    """At 1e6 N elongations change so fast that a transition can leave less than a step's worth of time."""
    model = changed(scene("three_bar"), 0)
    k = Kernel(model)
    k["force"][2] = 1e6
    k.initialize()
    start = k.save()
    k.step(0.05)
    instants = [t.time for t in k.transitions]
    assert len(instants) > 20
    for instant in instants:
        for ulps in range(-20, 21, 2):
            k.restore(start)
            k.step(instant + ulps * np.spacing(instant))
            k.step(1e-4)


def test_a_rest_length_of_zero():
    model = dataclasses.replace(scene("three_bar"), rest_length=np.zeros(6))
    inputs = constant(model, np.zeros((6, 3)), 0.2, 0.02)
    ours, theirs = kernel.simulate(model, inputs), reference.simulate(model, inputs)
    assert np.abs(ours.position - theirs.position).max() < 1e-9


def test_thousands_of_transitions_in_a_step():
    model = changed(scene("three_bar_nsh"), 0)
    inputs = constant(model, push(model, 10.0, 5.0), 100.0, 100.0)
    run = kernel.simulate(model, inputs)
    assert run.stats["transitions"] > 5000
    assert len(run.transitions) == 4096
    assert run.ledger_error() < 1e-7


@pytest.mark.parametrize("damping, amplitude", [(500, 0.0), (5000, 0.15)])
def test_a_step_far_too_long_is_rejected_not_accepted(damping, amplitude):
    """Stages of an unstable step reach 1e140: nothing in the error test may overflow into acceptance."""
    model = changed(scene("six_bar_nsh"), damping)
    inputs = square_wave(model, duration=2.0)
    top = np.zeros(21)
    top[18:] = amplitude
    wave = held(model, inputs.times, rest_length=lambda t: model.rest_length + top * np.sin(2.5 * t))
    both = dataclasses.replace(wave, force=inputs.force)
    exact = kernel.simulate(model, both, method="dop853", tolerance=1e-12)
    for method in ("auto", "dop853", "rodas5p"):
        run = kernel.simulate(model, both, method=method, tolerance=1e-9)
        assert np.abs(run.position - exact.position).max() < 1e-7


def test_one_long_step_equals_many_short_ones():
    model = changed(scene("three_bar_nsh"), 500)
    force = push(model)
    long = kernel.simulate(model, constant(model, force, 3.0, 3.0))
    short = kernel.simulate(model, constant(model, force, 3.0, 0.001))
    np.testing.assert_allclose(long.position[-1], short.position[-1], rtol=0, atol=1e-8)
    assert len(long.transitions) == len(short.transitions)


def test_step_sizes_are_irrelevant_to_moving_rest_lengths():
    """The rate input makes piecewise linear rest lengths exact, whatever the communication step."""
    model = changed(scene("three_bar"), 500)
    rate = np.zeros((1, 6))
    rate[0, 3:] = -0.1
    one = Inputs(np.array([0.0, 1.0]), np.zeros((1, 6, 3)), model.rest_length[None], rate)
    times = grid(1.0, 0.01)
    many = held(model, times, rest_length=lambda t: model.rest_length + rate[0] * t)
    a, b = kernel.simulate(model, one), kernel.simulate(model, many)
    np.testing.assert_allclose(a.position[-1], b.position[-1], rtol=0, atol=1e-9)
    assert a.ledger_error() < 1e-8 and b.ledger_error() < 1e-8


# --- one list of variables -----------------------------------------------------------------------------------------


def test_a_result_has_all_outputs_and_no_other():
    model = scene("two_bar")
    run = kernel.simulate(model, held(model, grid(0.01, 0.01)))
    assert list(run.outputs) == [field.name for field in fields.outputs()] and run.position is run.outputs["position"]
    assert all(name in run.__doc__ for name in run.outputs) and set(run.outputs) <= set(dir(run))
    with pytest.raises(AttributeError, match="no series 'heat'"):
        _ = run.heat
    with pytest.raises(ValueError, match="'snapped' is missing"):
        type(run)(run.times, **{name: series for name, series in run.outputs.items() if name != "snapped"})
    with pytest.raises(ValueError, match="'heat' is none"):
        type(run)(run.times, heat=run.times, **run.outputs)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"compared": ""}, "compared = ''"),
        ({"compared": "colour"}, "compared = 'colour'"),
        ({"role": "outptu"}, "'outptu'"),
        ({"shape": ("X",)}, "'X'"),
        ({"rate_of": "cold"}, "unknown field"),
    ],
)
def test_an_incomplete_row_is_refused(change, words):
    row = fields.outputs()[0]._replace(name="heat", **change)
    with pytest.raises(ValueError, match=words):
        fields.require_complete((*fields.FIELDS, row))


def test_results_are_spread_and_flattened():
    """Over nodes, axes and single values, in a planar scene with fixed nodes."""
    model = scene("two_bar_nsh")
    random = np.random.default_rng(0)
    for field in fields.outputs():
        flat = random.normal(size=(3, fields.size(field, model.counts)))
        full = components.spread(field, model, flat)
        np.testing.assert_array_equal(components.flattened(field, model, full), flat)
        assert len(components.names(field, model)) == flat.shape[1]
        if field.shape[-1:] == ("D",):
            assert full.shape == (3, model.counts["K"] if "K" in field.shape else len(model.nodes), 3)


def test_every_input_has_a_row(monkeypatch):
    """In the order of the kernel's block; one without a start is found at once."""
    model = built(LABORATORY)
    inputs = held(model, grid(0.02, 0.01))
    rows, simulation = kernel.input_rows(model, inputs), Kernel(model)
    assert rows.shape == (2, simulation.slopes.shape[1])
    np.testing.assert_array_equal(rows[0], simulation.values[: rows.shape[1]])
    row = fields.FIELDS[0]._replace(name="heat", start=None)
    monkeypatch.setitem(INPUTS, "heat", row)
    with pytest.raises(ValueError, match="'heat' has no start"):
        starts(model)


def test_every_parameter_has_a_start(monkeypatch):
    row = next(field for field in fields.FIELDS if field.role == "tunable")._replace(name="warmth")
    monkeypatch.setattr("tensegrity_core.kernel.packing.FIELDS", (*fields.FIELDS, row))
    with pytest.raises(ValueError, match="'warmth' has no start"):
        Kernel(scene("two_bar"))
