"""What is refused leaves no trace: a state's bytes are those without it, whatever was refused, by whichever method.  And what
is not finite is refused.

The sequences are seeded: `python -m tests.kernel.test_refused_calls COUNT` runs COUNT of them for each scene and method.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tensegrity_core.errors import InputError, SimulationError, TensegrityError
from tensegrity_core.fields import FIELDS, METHODS
from tensegrity_core.kernel import Kernel, simulate
from tensegrity_core.model import held
from tests.support import changed, push, scene
from tests.support.driven_scenes import LABORATORY, built
from tests.support.element_scenes import mast
from tests.support.words import words

NOT_FINITE = (np.nan, np.inf, -np.inf)
HUGE = (1e30, 1e100, 1e150, 1e155, 1e200, 1e300, 1.7e308)
STEPS = (1e-300, 1e-18, 1e-9, 1e-5, 1e-3, 1e-3, 0.01, 0.01, 0.02, 0.05)
INPUTS = tuple(field.name for field in FIELDS if field.role == "input")

MODELS = {
    "two_bar": lambda: scene("two_bar"),
    "three_bar_nsh": lambda: changed(scene("three_bar_nsh"), damping=500.0),
    "tension_only": lambda: changed(scene("three_bar"), damping=500.0, damping_law="tension_only"),
    "memory": lambda: mast("memory"),
    "laboratory": lambda: built(LABORATORY),
}


class Pair:
    """A kernel, and a twin that sees only what the kernel accepted."""

    def __init__(self, model, method, seed):
        settings = {"tolerance": 1e-6} if method not in ("rk4", "ros2") else {"max_step": 2e-3}
        self.one, self.twin = (Kernel(model, method=method, **settings) for _ in range(2))
        self.random = np.random.default_rng(seed)
        self.refused = self.accepted = 0
        self.saved = []
        for kernel in (self.one, self.twin):
            kernel.initialize(0.5)

    def both(self, call):
        """Make a call; where it is refused nothing may have changed, else the twin makes it, too."""
        before, values = self.one.save(), self.one.values.copy()
        try:
            call(self.one)
        except (InputError, SimulationError):
            self.refused += 1
            assert self.one.save() == before
            np.testing.assert_array_equal(self.one.values, values)
            return
        self.accepted += 1
        call(self.twin)
        assert np.isfinite(self.one.values).all()
        assert self.one.save() == self.twin.save()

    def with_input(self, name, place, value, h):
        """A step under an input that does not stay."""
        kept = self.one[name][place]

        def step(kernel):
            kernel[name][place] = value
            try:
                kernel.step(h)
            finally:
                kernel[name][place] = kept

        self.both(step)

    def act(self):
        """One random call."""
        random, name = self.random, self.random.choice([name for name in INPUTS if len(self.one[name])])
        place, h = random.integers(len(self.one[name])), random.choice(STEPS)
        what = random.integers(9)
        if what == 0:
            self.with_input(name, place, random.choice(NOT_FINITE), h)
        elif what == 1:
            self.with_input(name, place, random.choice(HUGE) * random.choice([-1, 1]), min(h, 1e-3))
        elif what == 2:
            self.both(lambda kernel: kernel.step(random.choice([0.0, -h, np.nan, np.inf])))
        elif what == 3:
            self.saved.append((self.one.save(), self.one.values.copy()))
            self.both(Kernel.output_derivatives)
            assert self.one.save() == self.saved[-1][0]
        elif what == 4 and self.saved:
            state, values = self.saved[random.integers(len(self.saved))]
            for kernel in (self.one, self.twin):
                kernel.restore(state)
                assert kernel.save() == state
            np.testing.assert_array_equal(self.one.values, values)
        elif what == 5:
            force = random.normal(scale=20.0, size=len(self.one["force"]))
            for kernel in (self.one, self.twin):
                kernel["force"][:] = force
            self.both(lambda kernel: kernel.step(h))
        else:
            for _ in range(random.integers(1, 4)):
                self.both(lambda kernel: kernel.step(h))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", MODELS)
def test_refused_calls_leave_no_trace_in_a_states_bytes(name, method, count=2):
    for seed in range(count):
        pair = Pair(MODELS[name](), method, seed)
        for _ in range(40):
            pair.act()
        assert pair.refused > 3 and pair.accepted > 3


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", MODELS)
def test_what_is_not_finite_is_never_ok(name, method):
    model = MODELS[name]()
    for size in HUGE:
        # What is huge and finite costs all the work that a step may do, seconds each: that is for the first scene.
        for h in (1e-300, 1e-9, 1e-5) if size > 1e30 or name == "two_bar" else (1e-300, 1e-12):
            kernel = Kernel(model, method=method, tolerance=1e-6)
            kernel.initialize()
            kernel["force"][-1] = size
            for _ in range(3):
                before, values = kernel.save(), kernel.values.copy()
                try:
                    kernel.step(h)
                except SimulationError as error:
                    assert error.status in ("not_finite", "step_too_small", "unstable", "work_limit", "chattering", "wound_up")
                    assert kernel.save() == before
                    np.testing.assert_array_equal(kernel.values, values)
                    break
                assert np.isfinite(kernel.values).all()
                try:
                    found = kernel.output_derivatives()
                except SimulationError as error:
                    assert "derivative" in str(error)
                else:
                    assert all(np.isfinite(values).all() for values in found.values())


def test_outputs_count_not_the_state_alone():
    """The case: 1e150 N give velocities whose square is no number."""
    kernel = Kernel(scene("two_bar"), method="ros2")
    kernel.initialize()
    kernel.step(0.01)
    before = kernel.values.copy()
    kernel["force"][-1] = 1e150
    with pytest.raises(SimulationError, match="not a finite number"):
        kernel.step(1e-3)
    kernel["force"][-1] = before[kernel.layout["force"]][-1]
    np.testing.assert_array_equal(kernel.values, before)
    kernel.step(0.01)


def test_a_start_whose_outputs_are_not_finite_is_refused():
    kernel = Kernel(scene("two_bar"))
    kernel["force"][-1] = 1e300
    kernel["bar_mass"][:] = 1e-9
    with pytest.raises(SimulationError, match="not finite|not a finite"):
        kernel.initialize()
    kernel["force"][-1] = 0.0
    kernel.initialize()


def test_a_start_that_cannot_be_built_leaves_the_run_as_it_was():
    """Curves of strings with memory depend on parameters; those of the run under way stay."""
    kernel, twin = Kernel(mast("memory")), Kernel(mast("memory"))
    for one in (kernel, twin):
        one.initialize()
        one.step(0.1)
    stiffness = kernel["stiffness"][0]
    kernel["stiffness"][0] = 0.0
    with pytest.raises(TensegrityError):
        kernel.initialize()
    kernel["stiffness"][0] = stiffness
    for one in (kernel, twin):
        one["force"][0] = 5.0
        one.step(0.1)
    assert kernel.save() == twin.save()


def test_the_native_fmu_keeps_its_bytes(native):
    one = native("two_bar")
    assert one.start({"solver.method": 5, "solver.step": 1e-3}) == 0
    assert one.step(0.0, 0.01) == 0
    force = one.names("input")[0]
    before, outputs = one.serialised(), one.outputs()
    for value in (np.nan, np.inf, 1e150, 1e200):
        one.set({force: value})
        if np.isfinite(value):
            assert one.step(0.01, 1e-3) == 2 and one.said("discarded", "finite" if value == 1e150 else "")
            np.testing.assert_array_equal(one.outputs(), outputs)
        assert one.set({force: 0.0}) == 0
        assert one.serialised() == before
    assert one.output_derivatives(one.names("output"))[0] == 0
    assert one.serialised() == before
    assert one.restore(before) == 0 and one.serialised() == before
    assert one.step(0.01, 0.01) == 0


def test_the_python_fmu_keeps_its_bytes(instance):
    from fmpy.fmi1 import FMICallException

    one = instance("two_bar", parameters={"solver.method": 5, "solver.step": 1e-3})
    one.fmu.doStep(0.0, 0.01)
    force = next(name for name, variable in one.by_name.items() if variable.causality == "input")

    def serialised():
        state = one.fmu.getFMUstate()
        data = bytes(one.fmu.serializeFMUstate(state))
        one.fmu.freeFMUstate(state)
        return data

    before = serialised()
    for value in (1e150, 1e200):
        one.set({force: value})
        with pytest.raises(FMICallException):
            one.fmu.doStep(0.01, 1e-3)
        one.set({force: 0.0})
        assert serialised() == before
    one.fmu.doStep(0.01, 0.01)


# --- work ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name, method, h", [("two_bar", "dop853", 0.05), ("three_bar_nsh", "auto", 0.05), ("two_bar", "rodas5p", 1.0)]
)
def test_a_call_gives_up_after_a_bounded_amount_of_work(name, method, h):
    """Bars of 1e-15 kg: oscillations of 1e-8 s.  What limits the call is no clock, so that all machines give up alike."""
    model = scene(name)
    kernel = Kernel(changed(model, bar_mass=np.full(len(model.bars), 1e-15)), method=method)
    kernel.initialize()
    before = kernel.save()
    with pytest.raises(SimulationError, match="work_limit.*shorter step.*looser tolerance.*mass"):
        kernel.step(h)
    assert kernel.save() == before
    kernel.step(1e-12)


def test_ten_thousand_seconds_are_one_call():
    model = scene("two_bar_nsh")
    run = simulate(model, held(model, np.array([0.0, 1e4]), force=lambda t: push(model)))
    assert run.stats["steps"] > 100 and np.isfinite(run.position).all()


def test_simulate_divides_what_is_too_much_for_one_call(monkeypatch):
    """Rest lengths and moved nodes go on where the part before left them."""
    model = built(LABORATORY)
    whole = step_inputs(model)
    expected = simulate(model, whole, tolerance=1e-9)
    calls, step = [], Kernel.step

    def refusing(kernel, h):
        calls.append(h)
        if h > 0.5:
            raise SimulationError("work_limit", "too much", 0.0)
        step(kernel, h)

    monkeypatch.setattr(Kernel, "step", refusing)
    divided = simulate(model, whole, tolerance=1e-9)
    assert len(calls) == 1 + 50
    np.testing.assert_allclose(divided.position, expected.position, rtol=0, atol=1e-7)
    assert [t.string for t in divided.transitions] == [t.string for t in expected.transitions]


def step_inputs(model):
    """One step of 1 s in which rest lengths and nodes move."""
    moved = np.zeros((1, len(model.moving), 3))
    moved[:, 0, 0] = 0.2
    rate = np.full((1, len(model.strings)), -0.01)
    start = held(model, np.array([0.0, 1.0]))
    return dataclasses.replace(start, rest_length_rate=rate, node_velocity=moved, node_acceleration=-moved)


def main(count: int) -> None:
    for name in MODELS:
        for method in METHODS:
            test_refused_calls_leave_no_trace_in_a_states_bytes(name, method, count)
            print(f"{name}, {method}: {count} sequences of 40 calls", flush=True)


if __name__ == "__main__":
    main(*words(__doc__, int))
