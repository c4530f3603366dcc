"""Modes about an equilibrium: closed forms of one bar, the kernel's Jacobian, free vibration, the article's structures."""

from __future__ import annotations

import numpy as np
import pytest
from driven_scenes import LABORATORY, PENDULUM, built
from element_scenes import STRINGS, mast
from support import changed, push, scene
from test_paths import one_bar

from tensegrity_core import modes, statics
from tensegrity_core.elements import Polynomial
from tensegrity_core.inputs import grid, held
from tensegrity_core.kernel import Kernel, simulate

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
    """Of the kernel's own Jacobian, without the bars' stretching, which adds pairs of zeros."""
    kernel = Kernel(model)
    kernel["force"][:] = force[model.free_nodes][:, list(model.axes)].ravel()
    kernel.initialize()
    Jq, Jv, _ = kernel.jacobian(kernel.state)
    n = len(Jq)
    found = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [Jq, Jv]]))
    return found[np.argsort(np.abs(found))][2 * len(model.bars) :]


@pytest.mark.parametrize("name", SCENES)
@pytest.mark.parametrize("load, damping", [(0.0, 500.0), (11.0, 500.0), (11.0, 50.0)])
def test_eigenvalues_are_those_of_the_kernels_jacobian(name, load, damping):
    force = push(scene(name), load, 0.0)
    model = statics.settle(changed(scene(name), damping=damping), force=force, steps=4 if load else 1)
    assert len(kernel_eigenvalues(model, force)) == 2 * (len(model.free_nodes) * len(model.axes) - len(model.bars))
    require_the_kernels(model, force)


def require_the_kernels(model, force):
    found = np.array([mode.eigenvalue for mode in modes.modes(model, force)])
    found = np.concatenate([found, found[found.imag > 0.0].conj()])
    expected = kernel_eigenvalues(model, force)
    assert len(found) == len(expected)
    for value in expected:
        nearest = np.argmin(np.abs(found - value))
        assert abs(found[nearest] - value) < 1e-9 * abs(value) or max(abs(found[nearest]), abs(value)) < 1e-5
        found = np.delete(found, nearest)


@pytest.mark.parametrize("name", [name for name in STRINGS if name != "cells"])  # it has a state that the kernel refuses
def test_eigenvalues_with_every_kind_of_string(name):
    model, force = mast(name), np.zeros((4, 3))
    force[1, 0] = 4.0
    require_the_kernels(statics.settle(model, force=force, steps=4), force)


def test_eigenvalues_with_payloads_drag_and_slanting_gravity():
    """Actuators hold the rest lengths: with them, modes are those of the same strings without."""
    model = statics.settle(built(LABORATORY), steps=1)
    none = np.zeros_like(model.nodes)
    held = changed(model, actuator=(None,) * len(model.strings), current=np.zeros(0), drum_load=np.zeros(0))
    require_the_kernels(held, none)
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
