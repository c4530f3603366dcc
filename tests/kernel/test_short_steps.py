"""Communication steps of 1 ms with other inputs at each, as a controller sends them: what a step costs, counted, its error."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tensegrity_core.kernel import Kernel
from tests.support import scene

STEP, STEPS = 1e-3, 300
AMPLITUDES = {"force": 20.0, "rest_length": 0.002}  # N, m


@cache
def signals(name: str) -> np.ndarray:
    """(STEPS, inputs): forces and rest lengths, with the rates of these."""
    kernel = Kernel(scene(name))
    rows = np.tile(kernel.values[: kernel.slopes.shape[1]], (STEPS, 1))
    t = STEP * np.arange(STEPS)[:, None]
    at = {field: kernel.layout[field] for field in ("force", "rest_length", "rest_length_rate")}
    rows[:, at["force"]] += AMPLITUDES["force"] * np.sin(12.5 * t + np.arange(rows[:, at["force"]].shape[1]))
    omega = 2.0 * np.pi * (1.0 + 0.1 * np.arange(rows[:, at["rest_length"]].shape[1]))
    rows[:, at["rest_length"]] += AMPLITUDES["rest_length"] * np.sin(omega * t)
    rows[:, at["rest_length_rate"]] = AMPLITUDES["rest_length"] * omega * np.cos(omega * t)
    return rows


def driven(name: str, method: str, tolerance: float, saved: bool = False) -> tuple[np.ndarray, Kernel]:
    """Positions after each step; saved: every state is saved, left by a step, and restored."""
    kernel = Kernel(scene(name), method=method, tolerance=tolerance)
    kernel.initialize()
    found = []
    for row in signals(name):
        kernel.values[: len(row)] = row
        if saved:
            state = kernel.save()
            kernel.step(STEP)
            kernel.restore(state)
        kernel.step(STEP)
        found.append(kernel["position"].copy())
    return np.array(found), kernel


def per_step(kernel: Kernel, what: str) -> float:
    return kernel.stats[what] / STEPS


@cache
def exact(name: str) -> np.ndarray:
    return driven(name, "radau9", 1e-12)[0]


@pytest.mark.parametrize("name", ["three_bar_nsh", "six_bar_nsh"])
@pytest.mark.parametrize("method, tolerance, error", [("auto", 1e-3, 1e-6), ("auto", 1e-5, 3e-7), ("dopri5", 1e-4, 3e-7)])
def test_loose_tolerances_keep_positions_within_a_micrometre(name, method, tolerance, error):
    assert np.abs(driven(name, method, tolerance)[0] - exact(name)).max() < error


@pytest.mark.parametrize("method, evaluations", [("dop853", 13), ("dopri5", 7), ("rk4", 5), ("ros2", 3)])
def test_a_step_evaluates_each_point_once(method, evaluations):
    """One step per call, its end evaluated once for the step; what outputs need beside it is not counted."""
    _positions, kernel = driven("two_bar", method, 1e-3)
    ends = kernel.stats["restarts"] + kernel.stats["steps"] + kernel.stats["rejected"] - STEPS
    assert kernel.stats["rhs"] <= STEPS * evaluations + ends * 16 and kernel.stats["rhs"] >= STEPS * evaluations
    assert ends < 0.1 * STEPS


@pytest.mark.parametrize("method, tolerance, attempts", [("dop853", 1e-6, 3.4), ("dop853", 1e-8, 5.0), ("dopri5", 1e-5, 4.2)])
def test_the_first_step_under_new_inputs_is_not_tried_in_vain(method, tolerance, attempts):
    """Within a call steps grow as the transient dies; the next call begins as the last one did."""
    _positions, kernel = driven("six_bar_nsh", method, tolerance)
    assert per_step(kernel, "rejected") < 0.15
    assert per_step(kernel, "rejected") + per_step(kernel, "steps") < attempts


@pytest.mark.parametrize("name, tolerance", [("three_bar_nsh", 1e-4), ("three_bar_nsh", 1e-10), ("six_bar_nsh", 1e-6)])
def test_auto_takes_the_cheaper_explicit_method(name, tolerance):
    spent = {method: driven(name, method, tolerance)[1].stats["rhs"] for method in ("auto", "dop853", "dopri5")}
    assert spent["auto"] < 1.15 * min(spent["dop853"], spent["dopri5"]), spent


def test_auto_goes_back_to_long_steps_when_inputs_stay():
    kernel = driven("three_bar_nsh", "auto", 1e-4)[1]
    kernel["rest_length_rate"][:] = 0.0
    kernel.step(STEP)
    before = kernel.stats["steps"]
    for _ in range(2000):
        kernel.step(2e-4)
    assert kernel.stats["steps"] - before < 500


def test_a_trial_of_short_steps_ends_where_inputs_stay():
    """Whenever the inputs cease to change, in a trial or not, steps pass communication points at once."""
    for count in range(1, 60):
        kernel = Kernel(scene("three_bar_nsh"), method="auto", tolerance=1e-4)
        kernel.initialize()
        for row in signals("three_bar_nsh")[:count]:
            kernel.values[: len(row)] = row
            kernel.step(STEP)
        kernel["rest_length_rate"][:] = 0.0
        kernel.step(STEP)
        before = kernel.stats["steps"]
        for _ in range(100):
            kernel.step(1e-4)
        assert kernel.stats["steps"] - before < 40, count


@pytest.mark.parametrize("name, tolerance", [("three_bar_nsh", 1e-4), ("three_bar_nsh", 1e-8), ("six_bar_nsh", 1e-5)])
def test_saved_states_repeat_the_choice_to_the_last_bit(name, tolerance):
    straight, kernel = driven(name, "auto", tolerance)
    again, other = driven(name, "auto", tolerance, saved=True)
    np.testing.assert_array_equal(again, straight)
    assert kernel.save() == other.save()
