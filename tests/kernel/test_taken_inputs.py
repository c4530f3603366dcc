"""Inputs that the kernel takes at once: what jumps is booked once, and the next step is that of a host that did not ask."""

import numpy as np
import pytest

from tensegrity_core.errors import TensegrityError
from tensegrity_core.kernel import Kernel
from tests.support import scene
from tests.support.driven_scenes import LABORATORY, built
from tests.support.element_scenes import mast

MODELS = {
    "three_bar_nsh": lambda: scene("three_bar_nsh"),
    "laboratory": lambda: built(LABORATORY),
    "memory": lambda: mast("memory"),
}
ENERGIES = ("kinetic", "potential", "elastic", "dissipated")


def started(name: str) -> Kernel:
    kernel = Kernel(MODELS[name]())
    kernel.initialize(0.5)
    return kernel


def balance(kernel: Kernel) -> float:
    return sum(kernel[name][0] for name in ENERGIES) - kernel["input_work"][0]


@pytest.mark.parametrize("name", MODELS)
def test_taking_inputs_and_stepping_is_stepping_with_them(name):
    taken, plain = started(name), started(name)
    random, constant = np.random.default_rng(2), balance(taken)
    lengths, base = taken["rest_length"].copy(), taken["node_position"].copy()
    for step in range(60):
        if step % 3 == 0:
            force = 20.0 * random.normal(size=len(taken["force"]))
            length = lengths * (1.0 + 0.03 * random.normal(size=len(lengths)))
            for kernel in (taken, plain):
                kernel["force"][:] = force
                kernel["rest_length"][:] = length if not kernel.counts["A"] else lengths
                kernel["node_position"][:] = base + (0.01 if step % 2 else 0.0)
            before = taken["input_work"][0] - taken["elastic"][0] - taken["potential"][0] - taken["kinetic"][0]
            lost = taken["dissipated"][0]
            taken.take_inputs()
            after = taken["input_work"][0] - taken["elastic"][0] - taken["potential"][0] - taken["kinetic"][0]
            assert after - before == pytest.approx(taken["dissipated"][0] - lost, abs=1e-11)
            values = taken.values.copy()
            taken.take_inputs()
            assert np.array_equal(taken.values, values) and not taken.transitions
        for kernel in (taken, plain):
            kernel.step(0.01)
        np.testing.assert_allclose(taken.values, plain.values, rtol=1e-12, atol=1e-12)
        assert np.array_equal(taken.integers, plain.integers)
    assert balance(taken) == pytest.approx(constant, abs=1e-6)


def test_what_is_refused_changes_nothing():
    kernel, plain = started("three_bar_nsh"), started("three_bar_nsh")
    for one in (kernel, plain):
        one["force"][:] = 10.0
        one.step(0.02)
    values, saved = kernel.values.copy(), kernel.save()
    for name, wrong in (("bar_mass", 3.0), ("rest_length", -1.0), ("damping", np.nan), ("gravity", 1.7e308)):
        right = kernel[name].copy()
        kernel[name][:] = wrong
        with pytest.raises(TensegrityError):
            kernel.take_inputs()
        kernel[name][:] = right
        assert np.array_equal(kernel.values, values) and kernel.save() == saved
    for one in (kernel, plain):
        one.step(0.02)
    assert np.array_equal(kernel.values, plain.values)


def test_there_must_be_a_start_and_no_step_under_way():
    with pytest.raises(TensegrityError, match="initialize first"):
        Kernel(MODELS["memory"]()).take_inputs()
    kernel, found = started("three_bar_nsh"), []

    def watcher(crossed: bool) -> None:
        with pytest.raises(TensegrityError, match="a step is under way"):
            kernel.take_inputs()
        found.append(crossed)

    kernel["force"][:] = 30.0
    kernel.watched_step(0.1, watcher)
    assert found
