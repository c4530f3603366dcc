"""Modes about an equilibrium: closed forms of one bar, the kernel's Jacobian, free vibration, the article's structures."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tensegrity_core import statics
from tensegrity_core.cli import main
from tensegrity_core.equilibria import modes
from tensegrity_core.kernel import Kernel, simulate
from tensegrity_core.model import grid, held
from tensegrity_core.model.elements import Polynomial
from tensegrity_core.scene import parse_scene
from tensegrity_core.statics import build_model
from tests.equilibria.test_paths import one_bar
from tests.statics.test_statics import prism
from tests.support import changed, push, scene
from tests.support.driven_scenes import LABORATORY, PENDULUM, built
from tests.support.element_scenes import STRINGS, mast

G, MASS = 9.81, 1.0
SCENES = ("two_bar", "three_bar", "six_bar", "two_bar_nsh", "three_bar_nsh", "six_bar_nsh")


@pytest.mark.parametrize("length", [0.5, 1.3])
def test_pendulum(length):
    """A hanging bar swings at sqrt(3 g / 2 l) / 2 pi; its string is slack."""
    model = one_bar([0.0, 0.0, -length], [[-2.0, 0.0, 0.0]], [5.0], gravity=G)
    (mode,) = modes.modes(model)
    assert mode.frequency == pytest.approx(np.sqrt(1.5 * G / length) / (2.0 * np.pi), rel=1e-13)
    assert mode.damping_ratio == 0.0 and mode.oscillates
    np.testing.assert_allclose(mode.shape[1], [1.0, 0.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("damping, kind", [(0.0, "free"), (20.0, "light"), (400.0, "heavy")])
def test_upright_bar_between_two_guys(damping, kind):
    """m/3 x'' + 2 d x' + (2 k - N/l) x = 0 of the tip: N = 0, as the guys are level."""
    k, pull, reach = 900.0, 60.0, 0.8
    model = one_bar([0, 0, 1.0], [[-reach, 0, 1.0], [reach, 0, 1.0]], np.full(2, reach - pull / k), damping=damping)
    found = modes.modes(model)
    expected = np.roots([MASS / 3.0, 2.0 * damping, 2.0 * k])
    if kind == "heavy":
        assert sorted(m.decay_rate for m in found) == pytest.approx(sorted(-expected.real), rel=1e-12)
        assert not any(m.oscillates for m in found) and [m.damping_ratio for m in found] == [1.0, 1.0]
    else:
        (mode,) = found
        assert mode.frequency == pytest.approx(abs(expected[0].imag) / (2.0 * np.pi), rel=1e-12)
        assert mode.decay_rate == pytest.approx(-expected[0].real, abs=1e-12)
        natural = np.sqrt(6.0 * k / MASS)
        assert mode.natural_frequency == pytest.approx(natural / (2.0 * np.pi), rel=1e-12)
        assert mode.damping_ratio == pytest.approx(3.0 * damping / MASS / natural, rel=1e-12)
        (free,) = modes.modes(model, damped=False)
        assert free.frequency == pytest.approx(natural / (2.0 * np.pi), rel=1e-12)


def test_an_unstable_equilibrium_grows():
    """The bar on its tip: exp(+-t sqrt(3 g / 2 l))."""
    model = one_bar([0.0, 0.0, 1.0], [[-2.0, 0.0, 0.0]], [5.0], gravity=G)
    rates = sorted(mode.decay_rate for mode in modes.modes(model))
    assert rates == pytest.approx([-np.sqrt(1.5 * G), np.sqrt(1.5 * G)], rel=1e-13)


@pytest.mark.parametrize("payload", [0.0, 0.7])
def test_pendulum_with_a_payload_and_drag(payload):
    """(m/3 + M) l2 a'' + c l2 a' + (m/2 + M) g l a = 0."""
    bar, drag = 2.0, 1.3  # kg, N s/m
    given = {"nodes": {"n1": [0.0, 0.0], "n2": [0.0, -1.0]}, "point_masses": {"n2": payload}, "drag": {"n2": drag}}
    model = built(PENDULUM, gravity=[0.0, 0.0, -G], **given)
    (mode,) = modes.modes(model)
    mass, stiffness = bar / 3.0 + payload, (bar / 2.0 + payload) * G
    assert mode.natural_frequency == pytest.approx(np.sqrt(stiffness / mass) / (2.0 * np.pi), rel=1e-13)
    assert mode.damping_ratio == pytest.approx(drag / (2.0 * np.sqrt(mass * stiffness)), rel=1e-13)
    (free,) = modes.modes(model, damped=False)
    assert free.damping_ratio == 0.0 and free.frequency == pytest.approx(mode.natural_frequency, rel=1e-13)


def test_a_pendulum_hangs_along_a_gravity_vector():
    model = built(PENDULUM, gravity=[3.0, 0.0, -4.0], nodes={"n1": [0.0, 0.0], "n2": [0.6, -0.8]})
    (mode,) = modes.modes(model)
    assert mode.frequency == pytest.approx(np.sqrt(1.5 * 5.0) / (2.0 * np.pi), rel=1e-13)
    np.testing.assert_allclose(mode.shape[1] / mode.shape[1, 0], [1.0, 0.0, 0.75], atol=1e-14)


def test_a_dampers_slope_at_rest_counts():
    guys = {"tip": [0.0, 0.0, 1.0], "anchors": [[-0.8, 0.0, 1.0], [0.8, 0.0, 1.0]], "rest_length": np.full(2, 0.7)}
    law = Polynomial((35.0, 400.0))
    found = modes.modes(changed(one_bar(**guys), damper=(law, law)))
    assert [m.eigenvalue for m in found] == pytest.approx([m.eigenvalue for m in modes.modes(one_bar(**guys, damping=35.0))])


def kernel_eigenvalues(model, force):
    """Of the kernel's own Jacobian, along the directions that keep the bars' lengths: it leads out of these nowhere."""
    kernel = Kernel(model)
    kernel["force"][:] = force[model.free_nodes][:, list(model.axes)].ravel()
    kernel.initialize()
    Jq, Jv, _ = kernel.jacobian(kernel.state)
    basis = bars_coordinates(model) @ modes.matrices(model, force).basis
    inward = np.linalg.pinv(basis)
    stiffness, damping = inward @ Jq @ basis, inward @ Jv @ basis
    assert np.abs(Jq @ basis - basis @ stiffness).max() < 1e-9 * np.abs(Jq).max()
    assert np.abs(Jv @ basis - basis @ damping).max() <= 1e-9 * np.abs(Jv).max()
    zero, one = np.zeros_like(stiffness), np.eye(len(stiffness))
    return np.linalg.eigvals(np.block([[zero, one], [stiffness, damping]]))


def bars_coordinates(model):
    """(n, n): the kernel's coordinates (of a free bar its centre and its vector, of a pinned one its vector) by the nodes'."""
    places, count = statics.places(model), len(model.free_nodes) * len(model.axes)
    unit = np.vstack([np.eye(count), np.zeros((1, count))])  # a fixed node's place is -1: the zeros
    rows = []
    for ends in model.bars:
        base, tip = unit[places[ends[0]]], unit[places[ends[1]]]
        free = not model.fixed[ends].any()
        rows += [0.5 * (base + tip), tip - base] if free else [base - tip if model.fixed[ends[1]] else tip - base]
    return np.vstack(rows)


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("load, damping", [(0.0, 500.0), (11.0, 500.0), (11.0, 50.0)])
def test_eigenvalues_are_those_of_the_kernels_jacobian(name, load, damping):
    force = push(scene(name), load, 0.0)
    model = statics.settle(changed(scene(name), damping=damping), force=force, steps=4 if load else 1)
    assert len(kernel_eigenvalues(model, force)) == 2 * (len(model.free_nodes) * len(model.axes) - len(model.bars))
    require_the_kernels(model, force)


def require_the_kernels(model, force, exact_zeros=0):
    """exact_zeros: how many of the kernel's stand for directions that nothing resists."""
    found = np.array([mode.eigenvalue for mode in modes.modes(model, force) if not mode.neutral])
    found = np.concatenate([found, found[found.imag > 0.0].conj(), np.zeros(exact_zeros)])
    expected = kernel_eigenvalues(model, force)
    assert len(found) == len(expected)
    for value in expected:
        nearest = np.argmin(np.abs(found - value))
        small = 1e-5 + 1e-9 * np.abs(expected).max()  # zeros that come in pairs have half the digits
        assert abs(found[nearest] - value) < 1e-9 * abs(value) or max(abs(found[nearest]), abs(value)) < small
        found = np.delete(found, nearest)


@pytest.mark.parametrize("name", [name for name in STRINGS if name != "cells"])  # it has a state that the kernel refuses
def test_eigenvalues_with_every_kind_of_string(name):
    model, force = mast(name), np.zeros((4, 3))
    force[1, 0] = 4.0
    require_the_kernels(statics.settle(model, force=force, steps=4), force)


def test_eigenvalues_with_payloads_drag_and_slanting_gravity():
    """Actuators hold the rest lengths: with them, modes are those of the same strings without."""
    model = statics.settle(built(LABORATORY), steps=1)
    loose = statics.string_tension(model, model.string_lengths(model.nodes)) < 1e-9
    model = changed(model, rest_length=model.rest_length + 0.01 * loose)  # one stands at the very end of being slack
    none = np.zeros_like(model.nodes)
    held = changed(model, actuator=(None,) * len(model.strings), current=np.zeros(0), drum_load=np.zeros(0))
    assert named(modes.modes(held)) == ["mechanism without stiffness"]  # b4, hung from one point, turns about the vertical
    require_the_kernels(held, none, exact_zeros=1)
    assert [m.eigenvalue for m in modes.modes(model)] == [m.eigenvalue for m in modes.modes(held)]


@pytest.mark.parametrize("damping, rate", [(50.0, -98.5), (500.0, -1960.0), (5000.0, -19700.0)])
def test_fastest_mode_of_the_three_bar_structure(damping, rate):
    found = min(mode.eigenvalue.real for mode in modes.modes(changed(scene("three_bar"), damping=damping)))
    assert found == pytest.approx(rate, rel=1e-3)


def test_free_vibration_follows_the_mode():
    """The upright pair of the two-bar scene, let go from a small swing in its slowest oscillating shape."""
    model = changed(scene("two_bar"), damping=5.0)
    mode = next(m for m in modes.modes(model) if m.oscillates)
    size, span = 1e-6, 1.5 / mode.frequency
    shape = mode.shape  # x(t) = size Re(shape exp(lambda t))
    start = changed(model, nodes=model.nodes + size * shape.real, velocity=size * (mode.eigenvalue * shape).real)
    times = grid(span, span / 60)
    run = simulate(start, held(start, times), tolerance=1e-13)
    motion = size * (shape * np.exp(mode.eigenvalue * times)[:, None, None]).real
    np.testing.assert_allclose(run.position - model.nodes, motion, rtol=0, atol=3e-5 * size)


def test_shapes_keep_the_bars_lengths_and_the_fixed_nodes():
    model = scene("six_bar")
    bars = model.nodes[model.bars[:, 1]] - model.nodes[model.bars[:, 0]]
    for mode in modes.modes(model):
        along = np.einsum("bd,bd->b", bars, mode.shape[model.bars[:, 1]] - mode.shape[model.bars[:, 0]])
        assert np.abs(along).max() < 1e-13 and not mode.shape[model.fixed].any()
        assert np.abs(mode.shape).max() == pytest.approx(1.0)


def test_the_undamped_limit_is_reached():
    model = scene("three_bar")
    free = [mode.natural_frequency for mode in modes.modes(model, damped=False)]
    light = [mode.natural_frequency for mode in modes.modes(changed(model, damping=1e-6))]
    assert light == pytest.approx(free, rel=1e-9)


# --- directions that nothing resists ---------------------------------------------------------------------------------


def named(found):
    return [mode.neutral for mode in found if mode.neutral]


def afloat(**fields):
    """A prism of three bars that touches nothing, in equilibrium without gravity."""
    data = prism(3, (0.8, 0.6), 1.2, 30.0, 4000.0) | {"start": "settled", "fixed": [], "gravity": 0.0} | fields
    return build_model(parse_scene(data))


ALL = [f"{kind} {axis}" for kind in ("translation along", "rotation about") for axis in "xyz"]


def toml(value) -> str:
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{json.dumps(key)} = {toml(item)}" for key, item in value.items()) + " }"
    return "[" + ", ".join(map(toml, value)) + "]" if isinstance(value, (list, tuple)) else json.dumps(value)


@pytest.mark.parametrize("tip, turns", [([0.0, 0.0, 1.0], "xy"), ([0.6, 0.0, 0.8], "xy"), ([1.0, 0.0, 0.0], "yz")])
def test_a_free_bar_has_five_motions_and_no_mode(tip, turns):
    data = {"name": "bar", "start": "released", "gravity": 0.0, "nodes": {"a": [0.0, 0.0, 0.0], "b": tip}}
    model = build_model(parse_scene(data | {"bars": {"b1": {"nodes": ["a", "b"], "mass": 1.0}}, "strings": {}}))
    found = modes.modes(model)
    assert named(found) == [*ALL[:3], *(f"rotation about {axis}" for axis in turns)] and len(found) == 5
    assert all(mode.eigenvalue == 0.0 and not mode.oscillates and mode.decay_rate == 0.0 for mode in found)


@pytest.mark.parametrize("damping", [0.0, 30.0, 3000.0])
def test_a_structure_afloat_has_six_motions_and_the_modes_of_its_shape(damping):
    """The others are those of the kernel's Jacobian that are not within 1e-5 /s of 0: two for each direction."""
    model = changed(afloat(), damping=damping)
    found = modes.modes(model)
    assert named(found) == ALL and all(mode.eigenvalue == 0.0 for mode in found[:6])
    rest = np.array([mode.eigenvalue for mode in found[6:]])
    assert np.abs(rest).min() > 1.0 and len(rest) + (rest.imag > 0.0).sum() == 2 * (15 - 6)
    assert -rest.real.max() > (1e-7 if damping else -1e-15)
    require_the_kernels(model, np.zeros_like(model.nodes), exact_zeros=12)


def test_drag_stops_rigid_motions_and_the_place_stays_free():
    """With equal drag c at all nodes: six lambda = 0, and translations die out at sum c/sum m."""
    data = afloat().node_names
    model = afloat(drag=dict.fromkeys(data, 0.4))
    found = modes.modes(model)
    assert named(found) == ALL and all(mode.eigenvalue == 0.0 for mode in found[:6])
    rates = sorted(mode.decay_rate for mode in found[6:] if not mode.oscillates)
    expected = 6 * 0.4 / model.bar_mass.sum()
    assert np.sum(np.isclose(rates, expected, rtol=1e-9)) == 3 and len(rates) == 6
    require_the_kernels(model, np.zeros_like(model.nodes), exact_zeros=6)


def test_a_payload_afloat_and_undamped():
    model = afloat(point_masses={"n0_0": 0.7}, drag={"n1_1": 0.3})
    free, dragged = modes.modes(model, damped=False), modes.modes(model)
    assert named(free) == named(dragged) == ALL and len(free) == 15
    assert all(mode.eigenvalue.real == 0.0 and mode.oscillates for mode in free[6:])
    require_the_kernels(model, np.zeros_like(model.nodes), exact_zeros=9)  # three combinations of motions move n1_1


def test_planar_motions_and_a_pivot():
    bar = {"bars": {"b1": {"nodes": ["a", "b"], "mass": 1.0}}, "strings": {}, "start": "released"}
    plane = {"name": "bar", "plane": "xz", "nodes": {"a": [0.0, 0.0], "b": [0.6, 0.8]}} | bar
    found = modes.modes(build_model(parse_scene(plane | {"gravity": 0.0})))
    assert named(found) == ["translation along x", "translation along z", "rotation about y"] and len(found) == 3
    found = modes.modes(build_model(parse_scene(plane | {"gravity": 0.0, "fixed": ["a"]})))
    assert named(found) == ["rotation about y"] and len(found) == 1
    hanging = plane | {"nodes": {"a": [0.0, 0.0], "b": [0.0, -1.0]}, "fixed": ["a"]}
    (mode,) = modes.modes(build_model(parse_scene(hanging)))  # gravity turns it back: no rigid-body motion
    assert not mode.neutral and mode.frequency == pytest.approx(np.sqrt(1.5 * G) / (2.0 * np.pi), rel=1e-13)


def test_bars_that_nothing_joins_have_mechanisms_too():
    nodes = {"a": [0, 0, 0], "b": [0, 0, 1], "c": [1, 0, 0], "d": [1.3, 0.4, 1]}
    bars = {"b1": {"nodes": ["a", "b"], "mass": 1.0}, "b2": {"nodes": ["c", "d"], "mass": 2.0}}
    data = {"name": "two", "start": "released", "gravity": 0.0, "nodes": nodes, "bars": bars, "strings": {}}
    found = modes.modes(build_model(parse_scene(data)))
    assert named(found) == [*ALL, *["mechanism without stiffness"] * 4] and len(found) == 10


def test_the_command_names_what_nothing_resists(tmp_path, capsys):
    path, table, figure = tmp_path / "prism.toml", tmp_path / "modes.csv", tmp_path / "modes.svg"
    data = prism(3, (0.8, 0.6), 1.2, 30.0, 4000.0) | {"fixed": [], "gravity": 0.0, "start": "settled"}
    path.write_text("\n".join(f"{key} = {toml(value)}" for key, value in data.items()), encoding="utf-8")
    assert main(["modes", str(path), "--output", str(table), "--figure", str(figure)]) == 0
    shown = capsys.readouterr().out
    assert "15 degrees of freedom" in shown and f"nothing resists 6 of them: {', '.join(ALL)}" in shown
    assert "9 modes that oscillate; the longest-lived first" in shown and "e-0" not in shown.split("moves most")[1]
    assert "not an equilibrium" not in shown and "nothing resists" not in figure.read_text(encoding="utf-8")
    rows = table.read_text(encoding="utf-8").splitlines()
    column = rows[0].split(",").index("neutral")
    assert [row.split(",")[column] for row in rows[1:]] == ["1.0"] * 6 + ["0.0"] * 9
    assert main(["check", str(path)]) == 0
    shown = capsys.readouterr().out
    lowest = statics.tangent_stiffness(afloat())[6]
    assert "rigid-body motions: 6" in shown and f"stable (lowest stiffness {lowest:.4g} N/m)" in shown
