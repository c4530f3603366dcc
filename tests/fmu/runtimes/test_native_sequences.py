"""Sequences of legal and illegal calls of both kinds of FMU: each answer is the one that the rules of docs/fmu.md foretell,
nothing crashes or hangs, and after a reset the run is that of a fresh instance, to the last bit.

The sequences run in a process of their own, so that a crash is a failure and not the end of pytest.  More of them:
``python -m tests.fmu.runtimes.test_native_sequences FOLDER_OF_AN_EXTRACTED_FMU 2000``.
Random calls with more hostile arguments, also
under sanitizers, are those of native_host.c.
"""

import ctypes
import math
import subprocess
import sys
from copy import copy
from ctypes import byref, c_double, c_size_t, c_uint, c_void_p
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule, run_state_machine_as_test

from tests.support.native_calls import DISCARD, ERROR, FATAL, LAST_SUCCESSFUL_TIME, OK, WARNING, Calls
from tests.support.words import words

EXAMPLES, CALLS = 60, 60
LARGEST = sys.float_info.max

#: Calls that change the mode: from, to.
TRANSITIONS = {
    "EnterInitializationMode": ("instantiated", "initialization"),
    "ExitInitializationMode": ("initialization", "stepping"),
    "Terminate": ("stepping", "terminated"),
}
SETTING, READING = ("instantiated", "initialization", "stepping"), ("initialization", "stepping", "terminated", "error")
VALUES = st.sampled_from(
    [0.0, -0.0, 1.0, -1.0, 0.01, 30.0, -70.0, 1e-300, 5e-324, 1e300, -LARGEST, math.nan, math.inf, -math.inf]
)
#: Ends of the names of the variables that are set.
PARTS = (".z", "rest_length", "rest_length_rate", "damping", "gravity", "mass", "tolerance")
#: Values that every input and parameter can take without driving the structure out of its senses.
TAME = 1e3


@dataclass
class Expected:
    """What an instance should be, saved and restored with its states.

    values: of what has been set, by name; hostile: a value or derivative that may make starts and steps fail.
    """

    mode: str = "instantiated"
    time: float = 0.0
    stop: float = math.inf
    tolerance_set: bool = False
    values: dict[str, float] = field(default_factory=dict)
    hostile: bool = False

    def saved(self) -> "Expected":
        other = copy(self)
        other.values = dict(self.values)
        return other


class Sequences(RuleBasedStateMachine):
    """Calls in any order; `expected` foretells statuses and values."""

    folder: Path
    run_of_a_fresh_instance: np.ndarray

    def __init__(self):
        super().__init__()
        self.one = Calls(self.folder, logging=True)
        self.expected, self.states = Expected(), []
        settable = [v.name for v in self.one.description.modelVariables if v.causality in ("input", "parameter")]
        self.names = [name for name in settable if name.endswith(PARTS)]
        self.output = next(n for n in self.one.by_name if n.count(".") == 1 and n.endswith(".z"))

    def answered(self, status, *wanted):
        """The status is one of those wanted; fmi2Error changes the mode; whatever is refused is said."""
        assert status in wanted and status < FATAL, (status, wanted, self.expected, self.one.messages[-2:])
        if status == ERROR:
            self.expected.mode = "error"
        if status in (WARNING, DISCARD, ERROR):
            assert self.one.messages and self.one.messages[-1][0] == status
        self.one.messages.clear()
        return status

    def refused(self):
        """Status of a call out of order that moves nothing on."""
        return ERROR if self.expected.mode == "error" else DISCARD

    # Life cycle

    @rule(
        tolerance=st.none() | VALUES,
        start=st.sampled_from([0.0, 2.5, -1.0, math.nan, math.inf]),
        stop=st.none() | st.sampled_from([0.05, 3.0, -7.0, math.nan, math.inf]),
    )
    def setup_experiment(self, tolerance, start, stop):
        e, given = self.expected, [0.0 if value is None else value for value in (tolerance, stop)]
        status = self.one.do("SetupExperiment", tolerance is not None, given[0], start, stop is not None, given[1])
        if e.mode != "instantiated":
            self.answered(status, ERROR)
            return
        if not math.isfinite(start) or (stop is not None and not stop >= start):
            self.answered(status, DISCARD)
            return
        odd = tolerance is not None and not e.tolerance_set and not 1e-14 <= tolerance <= 0.1
        self.answered(status, OK)
        e.time, e.stop = start, math.inf if stop is None else stop
        if tolerance is not None and not odd and not e.tolerance_set:
            e.values["solver.tolerance"] = min(tolerance, float(self.one.by_name["solver.tolerance"].start))

    @rule(function=st.sampled_from([*TRANSITIONS, "CancelStep"]), really=st.integers(0, 3))
    def change_mode_somehow(self, function, really):
        if really == 0 or self.expected.mode in ("instantiated", "initialization"):
            self.change_mode(function)

    def change_mode(self, function):
        e, status = self.expected, self.one.do(function)
        if function == "CancelStep":
            self.answered(status, DISCARD)
            return
        source, target = TRANSITIONS[function]
        if e.mode != source:
            self.answered(status, ERROR)
        elif self.answered(status, *([OK, DISCARD] if e.hostile and target == "stepping" else [OK])) == OK:
            e.mode = target

    @precondition(lambda self: self.expected.mode in ("error", "terminated"))
    @rule()
    def reset(self):
        self.answered(self.one.do("Reset"), OK)
        self.expected = Expected()

    # Legal calls, so that sequences go far

    @precondition(lambda self: self.expected.mode in ("error", "instantiated") and not self.expected.hostile)
    @rule(start=st.sampled_from([0.0, 7.25]))
    def go(self, start):
        if self.expected.mode == "error":
            self.reset()
        self.setup_experiment(None, start, None)
        self.change_mode("EnterInitializationMode")
        self.change_mode("ExitInitializationMode")

    @precondition(lambda self: self.expected.mode == "stepping")
    @rule(h=st.sampled_from([1e-3, 1e-4, 0.02]), count=st.integers(1, 5))
    def steps(self, h, count):
        for _ in range(count):
            if self.expected.mode == "stepping":
                self.step(0.0, h)

    @precondition(lambda self: self.expected.mode in SETTING)
    @rule(force=st.floats(-50.0, 50.0), damping=st.floats(10.0, 900.0))
    def set_well(self, force, damping):
        name = next(name for name in self.names if name.endswith("force.z"))
        values = {name: force, "s1.damping": damping}
        self.answered(self.one.set(values), OK)
        self.expected.values |= values

    @precondition(lambda self: self.expected.mode == "stepping")
    @rule(really=st.integers(0, 5))
    def terminate(self, really):
        if really == 0:
            self.change_mode("Terminate")

    # Values

    def low_high(self, name):
        variable = self.one.by_name[name]
        low, high = (limit and float(limit) for limit in (variable.min, variable.max))
        return (-LARGEST if low is None else low), (LARGEST if high is None else high)

    def judge(self, name, value):
        """Status of setting a value that is not the present one."""
        e = self.expected
        if e.mode not in SETTING:
            return self.refused()
        if e.mode == "stepping" and self.one.by_name[name].variability == "fixed":
            return OK if value == self.value(name) else DISCARD
        low, high = self.low_high(name)
        return OK if low <= value <= high else DISCARD

    def value(self, name):
        return self.expected.values.get(name, float(self.one.by_name[name].start))

    @rule(data=st.data())
    def set_values(self, data):
        names = data.draw(st.lists(st.sampled_from(self.names), min_size=1, max_size=3, unique=True))
        values = [data.draw(VALUES) for _ in names]
        verdicts = [self.judge(name, value) for name, value in zip(names, values)]
        status = self.one.do("SetReal", self.one.references(names), len(names), (c_double * len(names))(*values))
        worst = next((verdict for verdict in verdicts if verdict), OK)  # the first refusal ends it
        if self.answered(status, worst) == OK:
            self.expected.values |= dict(zip(names, values))
            self.expected.tolerance_set |= "solver.tolerance" in names and self.expected.mode != "stepping"
            small = any("mass" in name and value < 1e-3 for name, value in zip(names, values))
            self.expected.hostile |= small or any(abs(value) > TAME for value in values)

    @rule(
        data=st.data(), function=st.sampled_from(["GetReal", "SetReal", "GetInteger", "SetInteger", "GetBoolean", "SetString"])
    )
    def wrong_references_and_null_pointers(self, data, function):
        n = data.draw(st.integers(0, 5))
        if n == 0 or (self.expected.mode == "stepping" and n < 5):
            return
        references = (c_uint * n)(*data.draw(st.lists(st.integers(10**4, 2**32 - 1), min_size=n, max_size=n)))
        kind = getattr(self.one.library, f"fmi2{function}").argtypes[3]
        value = ctypes.cast((c_double * n)(), kind)
        vr, place = data.draw(st.sampled_from([(None, value), (references, value), (references, None), (None, None)]))
        modes = READING if function.startswith("Get") else SETTING
        self.answered(self.one.do(function, vr, n, place), DISCARD if self.expected.mode in modes else self.refused())

    @rule()
    def nothing_is_set_and_read(self):
        for function, modes in (("GetReal", READING), ("SetInteger", SETTING), ("GetString", READING), ("SetBoolean", SETTING)):
            self.answered(self.one.do(function, None, 0, None), OK if self.expected.mode in modes else self.refused())

    @rule(data=st.data())
    def input_derivatives(self, data):
        name = data.draw(st.sampled_from([n for n in self.names if self.one.by_name[n].causality == "input"]))
        value, order = data.draw(VALUES), data.draw(st.sampled_from([1, 1, 2, 2, 0, 3, -5]))
        mode, status = self.expected.mode, self.one.slopes({name: value}, order)
        legal = mode in SETTING and order in (1, 2) and math.isfinite(value)
        if self.answered(status, OK if legal else self.refused()) == OK:
            self.expected.hostile |= abs(value) > TAME or (value != 0.0 and "rest_length" in name)

    @rule()
    def output_derivatives(self):
        status, _found = self.one.output_derivatives([self.output])
        # after an error there may be no start to differentiate yet
        possible = {"stepping": [OK], "terminated": [OK], "error": [OK, DISCARD]}
        wanted = possible.get(self.expected.mode, [DISCARD])
        if self.expected.hostile and status == DISCARD and DISCARD not in wanted:  # what is not finite is never OK
            assert self.one.said("a derivative of an output is not a finite number"), self.one.messages[-1]
            wanted = [DISCARD]
        self.answered(status, *wanted)

    # Steps

    @rule(
        off=st.sampled_from([0.0] * 9 + [1e-5, -1.0, math.nan, math.inf]),
        h=st.sampled_from([1e-3] * 9 + [0.01, 1e-6, 1e-300, 0.0, -1e-3, math.nan, math.inf]),
    )
    def step_somehow(self, off, h):
        self.step(off, h)

    def step(self, off, h):
        """At the FMU's time and a bit off, s."""
        e, point = self.expected, self.expected.time + off
        status = self.one.step(point, h)
        room = 1e-6 * h + 1e-15 * (1.0 + abs(e.time))
        if e.mode == "stepping" and not 0.0 < h < math.inf:
            self.answered(status, DISCARD)
            return
        if e.mode != "stepping" or not abs(off) <= room or point + h > e.stop + room:
            self.answered(status, ERROR)
            return
        moving = any(value and name.endswith("rest_length_rate") for name, value in e.values.items())
        wild = e.hostile or moving or self.value("solver.tolerance") < 1e-13 or h < 1e-200
        if self.answered(status, *([OK, DISCARD] if wild else [OK])) == OK:
            e.time = point + h

    # States

    @rule()
    def save(self):
        self.states.append((self.one.save(), self.expected.saved()))

    @precondition(lambda self: self.states)
    @rule(data=st.data())
    def restore(self, data):
        state, expected = data.draw(st.sampled_from(self.states))
        self.answered(self.one.do("SetFMUstate", state), OK)
        self.expected = expected.saved()

    @precondition(lambda self: self.states)
    @rule(data=st.data(), through=st.sampled_from(["whole", "cut", "flipped"]))
    def through_bytes(self, data, through):
        state, expected = data.draw(st.sampled_from(self.states))
        size, copied = c_size_t(), c_void_p()
        self.answered(self.one.do("SerializedFMUstateSize", state, byref(size)), OK)
        raw = ctypes.create_string_buffer(size.value)
        self.answered(self.one.do("SerializeFMUstate", state, raw, size), OK)
        sent = bytearray(raw.raw)
        if through == "cut":
            del sent[data.draw(st.integers(0, size.value - 1)) :]
        elif through == "flipped":
            sent[data.draw(st.integers(0, size.value - 1))] ^= data.draw(st.integers(1, 255))
        status = self.one.do("DeSerializeFMUstate", bytes(sent), len(sent), byref(copied))
        if self.answered(status, OK if through == "whole" else DISCARD) == OK:
            self.answered(self.one.do("SetFMUstate", copied), OK)
            self.one.drop(copied)
            self.expected = expected.saved()

    # Always

    @invariant()
    def answers_right(self):
        e = self.expected
        if e.mode in ("stepping", "terminated"):
            value = c_double()
            assert self.one.do("GetRealStatus", LAST_SUCCESSFUL_TIME, byref(value)) == OK and value.value == e.time
        if e.mode not in READING or (e.mode == "initialization" and e.hostile):
            return
        found = self.one.get(*e.values) if len(e.values) > 1 else [self.one.get(name) for name in e.values]
        assert found == [*e.values.values()]
        if e.mode in ("initialization", "stepping", "terminated"):
            assert all(map(math.isfinite, self.one.outputs()))

    def teardown(self):
        one = self.one
        assert one.do("Reset") == OK and one.do("SetDebugLogging", 1, 0, None) == OK and one.start() == OK
        np.testing.assert_array_equal(reference_run(one), self.run_of_a_fresh_instance)
        for state, _ in self.states:
            one.drop(state)
        one.free()


def reference_run(one) -> np.ndarray:
    """Outputs along 60 ms under a push and moving rest lengths; the instance is started."""
    force = next(name for name in one.by_name if name.endswith("force.z"))
    assert one.set({force: 45.0, "s1.rest_length_rate": -0.1}) == OK
    return one.walk(30, 2e-3)


def main(folder: str, examples: str) -> None:
    """Run so many sequences on the FMU in a folder; an AssertionError tells the shortest that fails."""
    Sequences.folder = Path(folder)
    fresh = Calls(Sequences.folder)
    assert fresh.start() == OK
    Sequences.run_of_a_fresh_instance = reference_run(fresh)
    fresh.free()
    run_state_machine_as_test(
        Sequences,
        settings=settings(
            max_examples=int(examples),
            stateful_step_count=CALLS,
            derandomize=True,
            deadline=None,
            database=None,
            suppress_health_check=list(HealthCheck),
        ),
    )


@pytest.mark.parametrize("runtime", ["native", "python"])
@pytest.mark.parametrize("name", ["two_bar", "three_bar"])
def test_every_answer_is_the_one_foretold(name, runtime, native_folders, python_folders):
    folder = {"native": native_folders, "python": python_folders}[runtime][name]
    examples = EXAMPLES if runtime == "native" else EXAMPLES // 3
    line = [sys.executable, "-X", "faulthandler", "-m", __name__, str(folder), str(examples)]
    done = subprocess.run(line, capture_output=True, text=True, timeout=300, cwd=Path(__file__).resolve().parents[3])
    assert done.returncode == 0, f"exit code {done.returncode}\n{done.stderr[-4000:]}"


def test_a_crash_would_be_seen():
    """The runner of the test above reports a process that dies by a signal."""
    program = "import ctypes; ctypes.string_at(0)"
    assert subprocess.run([sys.executable, "-c", program], capture_output=True).returncode != 0


if __name__ == "__main__":
    main(*words(__doc__, str, int))
