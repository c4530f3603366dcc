"""Outputs on demand: whoever asks late gets the numbers that a step would have filled, to the last bit.

The sequences are seeded: `python -m tests.kernel.test_demand COUNT` runs COUNT of them for each scene and method.
"""

from __future__ import annotations

import numpy as np
import pytest

from tensegrity_core.errors import InputError, SimulationError
from tensegrity_core.fields import FIELDS, INTEGER_FIELDS, METHODS
from tensegrity_core.kernel import Kernel
from tensegrity_core.kernel.binding import GROUPS
from tests.kernel.test_refused_calls import MODELS
from tests.kernel.test_watched_steps import FIXED
from tests.support.words import words

#: What each group of outputs holds.
FIELDS_OF = {
    "motion": (
        "position",
        "velocity",
        "wound_rest_length",
        "wound_rest_length_rate",
        "motor_speed",
        "snapped",
        "contact_sticking",
    ),
    "forces": (
        *("string_force", "elastic_force", "string_length", "bar_force", "reaction"),
        *("contact_normal", "contact_force", "bar_utilisation", "string_utilisation"),
    ),
    "energies": ("kinetic", "potential", "elastic"),
    "work": ("dissipated", "input_work", "throughput"),
}


def made(name: str, method: str) -> Kernel:
    settings = {"max_step": 5e-4} if method in FIXED else {"tolerance": 1e-7}
    kernel = Kernel(MODELS[name](), method=method, **settings)
    kernel.initialize(0.25)
    return kernel


class Pair:
    """A kernel that fills everything, and a lazy one."""

    def __init__(self, name: str, method: str, seed: int):
        self.eager, self.lazy = made(name, method), made(name, method)
        self.both = self.eager, self.lazy
        self.random = np.random.default_rng(seed)
        self.saved = [kernel.save() for kernel in self.both]

    def write(self) -> None:
        """New inputs, of which the outputs that are still to come know nothing."""
        force = 20.0 * self.random.normal(size=len(self.eager["force"]))
        rate = 0.01 * self.random.normal(size=len(self.eager["rest_length_rate"])) * (self.random.random() < 0.3)
        slope = self.random.normal(size=self.eager.slopes.shape[1]) * (self.random.random() < 0.1)
        for kernel in self.both:
            kernel["force"][:] = force
            kernel["rest_length_rate"][:] = rate
            kernel.slopes[0, : len(force)] = slope[: len(force)]

    def compare(self, groups: list[str]) -> None:
        for group in groups:
            self.lazy.fill(group)
            for name in FIELDS_OF[group]:
                np.testing.assert_array_equal(self.lazy[name], self.eager[name], err_msg=f"{group}: {name}")

    def act(self) -> None:
        random = self.random
        match random.integers(9):
            case 0:
                self.write()
            case 1:
                self.lazy.want(*(group for group in GROUPS if random.random() < 0.3))
            case 2:
                self.saved = [kernel.save() for kernel in self.both]
                assert self.saved[0] == self.saved[1]
            case 3 if random.random() < 0.3:
                for kernel, state in zip(self.both, self.saved, strict=True):
                    kernel.restore(state)
                np.testing.assert_array_equal(self.lazy.values, self.eager.values)
            case 4:
                np.testing.assert_array_equal(self.lazy.output_rates(), self.eager.output_rates())
            case 5:
                np.testing.assert_array_equal(self.lazy.state, self.eager.state)
            case 6:
                self.refuse()
            case 7:
                self.early()
            case _:
                h = random.choice([1e-4, 1e-3, 1e-3, 0.01])
                for _ in range(random.integers(1, 5)):
                    for kernel in self.both:
                        kernel.step(h)
        if random.random() < 0.5:
            self.compare(random.permutation(GROUPS)[: random.integers(1, 5)].tolist())
        assert self.lazy.time == self.eager.time
        assert self.lazy.stats == self.eager.stats

    def refuse(self) -> None:
        """A step that fails leaves everything as it was, what was left out with it."""
        for kernel in self.both:
            kept = kernel["force"].copy()
            kernel["force"][0] = self.random.choice([1e300])
            with pytest.raises(SimulationError):
                kernel.step(1e-3)
            kernel["force"][:] = kept

    def early(self) -> None:
        ends = int(self.random.integers(1, 4))
        for kernel in self.both:
            left = iter([False] * ends)

            def watcher(crossed, kernel=kernel, left=left):
                kernel.look()
                return next(left, True)

            kernel.watched_step(5e-3, watcher)


def run(name: str, method: str, seed: int, calls: int) -> None:
    pair = Pair(name, method, seed)
    pair.lazy.want()
    for _ in range(calls):
        pair.act()
    pair.compare(list(GROUPS))
    np.testing.assert_array_equal(pair.lazy.values, pair.eager.values)
    np.testing.assert_array_equal(pair.lazy.integers, pair.eager.integers)
    assert pair.lazy.save() == pair.eager.save()


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", MODELS)
def test_whoever_asks_late_gets_the_same_numbers(name, method):
    run(name, method, 1, 60)


def test_every_output_is_in_one_group():
    named = [name for fields in FIELDS_OF.values() for name in fields]
    assert sorted(named) == sorted(field.name for field in FIELDS + INTEGER_FIELDS if field.role == "output")
    assert tuple(FIELDS_OF) == GROUPS


def lazy_pair(name: str = "three_bar_nsh", method: str = "auto") -> tuple[Kernel, Kernel]:
    eager, lazy = made(name, method), made(name, method)
    lazy.want()
    for kernel in (eager, lazy):
        kernel["force"][2] = -20.0
        for _ in range(2):
            kernel.step(1e-3)
    return eager, lazy


@pytest.mark.parametrize("group", GROUPS)
def test_a_group_fills_its_outputs_and_no_others(group):
    """But forces bring the motion that they need."""
    eager, lazy = lazy_pair()
    lazy.values[lazy.first_output :] = np.nan
    lazy.fill(group)
    known = {group, "motion"} if group == "forces" else {group}
    for other, fields in FIELDS_OF.items():
        for name in fields:
            if other in known:
                np.testing.assert_array_equal(lazy[name], eager[name])
            elif name != "snapped":
                assert np.isnan(lazy[name]).all()


def test_what_is_wanted_is_filled_by_every_step():
    eager, lazy = lazy_pair()
    lazy.want("motion", "work")
    for _ in range(20):
        for kernel in (eager, lazy):
            kernel.step(1e-3)
        for name in (*FIELDS_OF["motion"], *FIELDS_OF["work"]):
            np.testing.assert_array_equal(lazy[name], eager[name])


def test_an_unknown_group_is_refused():
    with pytest.raises(InputError, match="group = 'force' is not one of motion, forces, energies, work"):
        made("two_bar", "auto").fill("force")


@pytest.mark.parametrize("size", [1e20, 1e40, 1e60, 1e100, 1e168, 1e171, 1e200, 1e300])
def test_a_step_fails_alike_whoever_reads(size):
    """An output that no number can hold ends a step, although nobody reads it."""
    eager, lazy = lazy_pair("two_bar", "rk4")
    for kernel in (eager, lazy):
        kernel["force"][:] = size
    found = []
    for kernel in (eager, lazy):
        try:
            for _ in range(3):
                kernel.step(1e-15)
            found.append("done")
        except SimulationError as error:
            found.append(error.status)
    assert found[0] == found[1]
    lazy.fill()
    np.testing.assert_array_equal(lazy.values, eager.values)


if __name__ == "__main__":
    (seeds,) = words(__doc__, int)
    for name in MODELS:
        for method in METHODS:
            for seed in range(seeds):
                run(name, method, seed, 200)
    print("all the same")
