"""Both FMUs: the same results as each other and the kernel, call order, values, steps, messages, states, derivatives of inputs
and outputs, folders.  What `both` makes is tested with either runtime: they have one table of statuses.

Through native_calls.py, so that statuses are seen and null pointers can be passed; against each other through fmpy.
"""

import ctypes
import math
import os
import shutil
import subprocess
import sys
from ctypes import byref, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from hypothesis import given, settings
from hypothesis import strategies as st

from fmu_src.validation import outside, validate
from fmu_src.validation.scenarios import scenarios
from fmu_src.variables.interface import variables
from tensegrity_core.fields import METHODS
from tensegrity_core.kernel import Kernel
from tensegrity_core.scene import builtin_scenes
from tests.support import scene
from tests.support.native_calls import (
    ARGUMENTS,
    DISCARD,
    DO_STEP_STATUS,
    ERROR,
    LAST_SUCCESSFUL_TIME,
    MODEL_EXCHANGE,
    MODES,
    OK,
    PENDING_STATUS,
    TERMINATED,
    WARNING,
    library_of,
)

HERE = Path(__file__).parent
#: fmi2Discard and worse leave an instance as it was: compared to the last bit everywhere below.
same = np.testing.assert_array_equal


def kernel_outputs(kernel):
    """In the order of Calls.outputs."""
    return np.concatenate((kernel.values[kernel.layout["position"].start :], kernel["snapped"]))


# Both runtimes


@pytest.fixture
def pair(fmus, native_fmus, extracted):
    """pair(scene): fmpy's instances of the Python FMU and of the native one, not started yet."""
    made = []

    def make(name):
        two = [outside.Instance(*extracted(fmu[name]), logging=True) for fmu in (fmus, native_fmus)]
        made.extend(two)
        return two

    yield make
    for one in made:
        one.fmu.freeInstance()


def assert_alike(rows, others):
    """Equal to 1e-12, relative; what is 0 or the difference of large energies, to 1e-12 of its column's largest value."""
    largest = np.max(np.abs(others - rows) / np.maximum(np.max(np.abs(rows), axis=0), np.finfo(float).tiny))
    assert np.all(np.isfinite(rows)) and largest <= 1e-12, f"{largest:g}; are both libraries built from the same sources?"


def transitions(instance):
    """(time in s, string, before, after) of every transition that was logged."""
    names = []
    return [(row[0], names[int(row[1])], *row[2:]) for row in outside.events(instance.messages, names).tolist()]


@pytest.mark.parametrize("name", builtin_scenes())
def test_both_runtimes_give_the_same(name, pair):
    """5 s under a constant push, the square wave of 400 N at three dampings, moving rest lengths, an asymmetric push."""
    model, count = scene(name), 0
    table, two = variables(model), pair(name)
    for run in scenarios(model):
        (rows, events), (others, found) = (scenario(one, run, table) for one in two)
        assert_alike(rows, others)
        assert found == events
        count += len(events)
    assert count > 0


def scenario(one, run, table):
    """Outputs and transitions of a run from a fresh start."""
    parameters = {f"{s}.damping": float(d) for s, d in zip(run.model.string_names, run.model.damping)}
    inputs = [row.name for row in table if row.causality == "input"]
    rows, _, _ = outside.run(one, run.inputs.times, validate.input_values(table, run), inputs, parameters)
    found = transitions(one)
    one.messages.clear()
    one.fmu.reset()
    return rows, found


def adventurous(one, model):
    """Outputs along a run with a parameter change, a force ramp, moving rest lengths, a rollback and steps of other sizes."""
    one.start({"gravity": 9.0, "b1.mass": 1.1, "solver.tolerance": 1e-9}, start_time=2.0)
    force = next(v.name for v in one.description.modelVariables if v.name.endswith(".force.z") and v.causality == "input")
    string, steps, time, rows, saved = model.string_names[0], [0.01] * 30 + [0.0025, 0.05, 0.2, 0.001] * 8, 2.0, [], None
    ports = outside.Ports(one, [])
    for k, h in enumerate(steps):
        if k == 12:
            saved = one.fmu.getFMUstate(), time
            one.set({f"{string}.stiffness": 50.0, "gravity": 30.0, force: -80.0})
        if k == 17:
            one.fmu.setFMUstate(saved[0])
            time = saved[1]
            one.fmu.freeFMUstate(saved[0])
        if k == 22:
            one.set({f"{string}.stiffness": 1.5 * model.stiffness[0], f"{string}.damping": 20.0})
        one.set({force: 10.0 * (k % 7), f"{string}.rest_length_rate": -0.05 if k % 5 == 0 else 0.0})
        one.fmu.doStep(time, h)
        time += h
        ports.get()
        rows.append(ports.row())
    return np.array(rows), transitions(one)


@pytest.mark.parametrize("name", builtin_scenes())
def test_both_runtimes_agree_on_changes_and_rollback(name, pair):
    (rows, events), (others, found) = (adventurous(one, scene(name)) for one in pair(name))
    assert_alike(rows, others)
    assert found == events


@pytest.mark.parametrize("name", ["two_bar", "three_bar_nsh"])
def test_strangers_get_the_kernels_results(name, native_fmus, outside_python):
    """In an environment with numpy and fmpy only: what the Python FMU gives there (test_fmu_validate.py), to 1e-12."""
    model = scene(name)
    (run,) = [run for run in scenarios(model, duration=0.5) if run.name == "square_wave_1d"]
    ((fmu, events, _),) = validate.run_outside(native_fmus[name], model, runs=[run], python=str(outside_python))
    here = validate.kernel.simulate(run.model, run.inputs)
    for field in ("position", "velocity", "string_force", "reaction", "dissipated", "input_work", "snapped"):
        np.testing.assert_allclose(fmu[field], getattr(here, field), rtol=1e-12, atol=1e-12, err_msg=field)
    assert events == here.transitions


def test_follows_the_kernel(both):
    one, kernel = both("three_bar_nsh", "stepping"), Kernel(scene("three_bar_nsh"))
    kernel.initialize()
    one.set({"n4.force.z": 45.0, "n4.force.x": -3.0})
    kernel["force"][0], kernel["force"][2] = -3.0, 45.0
    rows = one.walk(40)
    for row in rows:
        kernel.step(0.01)
        np.testing.assert_allclose(row, kernel_outputs(kernel), rtol=1e-12, atol=1e-15)
    assert kernel["snapped"][0] >= 1


@pytest.mark.parametrize("name", builtin_scenes())
def test_an_fmu_of_one_platform_is_small(name, native_fmus):
    assert native_fmus[name].stat().st_size <= 450_000  # one library serves both versions of FMI


# Call order.  For each function of the standard: a harmless call, and the modes in which it may be made (FMI 2.0.4,
# section 4.2.4; "stepping" stands for stepComplete and, as nothing is changed then, stepFailed).

ANY, READ, WRITE = MODES, MODES[1:], MODES[:3]


def one_reference(one, name="n4.z"):
    name = name if name in one.by_name else "n3.z"
    return one.references([name]), 1


def state_call(function):
    """A call with a state of the instance itself."""

    def call(one):
        state, size = one.save(), c_size_t()
        one.do("SerializedFMUstateSize", state, byref(size))
        data, other = ctypes.create_string_buffer(size.value), c_void_p()
        one.do("SerializeFMUstate", state, data, size)
        calls = {
            "SetFMUstate": lambda: one.do("SetFMUstate", state),
            "FreeFMUstate": lambda: one.do("FreeFMUstate", byref(one.save())),
            "SerializedFMUstateSize": lambda: one.do("SerializedFMUstateSize", state, byref(size)),
            "SerializeFMUstate": lambda: one.do("SerializeFMUstate", state, data, size),
            "DeSerializeFMUstate": lambda: one.do("DeSerializeFMUstate", data.raw, size, byref(other)),
        }
        found = calls[function]()
        one.drop(state)
        one.drop(other)
        return found

    return call


def get_state(one):
    state = c_void_p()
    found = one.do("GetFMUstate", byref(state))
    one.drop(state)
    return found


def nothing(function):
    return lambda one: one.do(function, None, 0, None)


CALLS = {
    "SetDebugLogging": (ANY, lambda one: one.do("SetDebugLogging", 1, 0, None)),
    "SetupExperiment": (MODES[:1], lambda one: one.do("SetupExperiment", 0, 0.0, 0.0, 0, 0.0)),
    "EnterInitializationMode": (MODES[:1], lambda one: one.do("EnterInitializationMode")),
    "ExitInitializationMode": (MODES[1:2], lambda one: one.do("ExitInitializationMode")),
    "Terminate": (MODES[2:3], lambda one: one.do("Terminate")),
    "Reset": (ANY, lambda one: one.do("Reset")),
    "GetReal": (READ, lambda one: one.do("GetReal", *one_reference(one), byref(c_double()))),
    "GetInteger": (READ, lambda one: one.do("GetInteger", *one_reference(one, "solver.method"), byref(c_int()))),
    "GetBoolean": (READ, nothing("GetBoolean")),
    "GetString": (READ, nothing("GetString")),
    "SetReal": (WRITE, lambda one: one.set({"gravity": 9.0})),
    "SetInteger": (WRITE, lambda one: one.set({"solver.method": 0})),
    "SetBoolean": (WRITE, nothing("SetBoolean")),
    "SetString": (WRITE, nothing("SetString")),
    "GetFMUstate": (ANY, get_state),
    "SetFMUstate": (ANY, state_call("SetFMUstate")),
    "FreeFMUstate": (ANY, state_call("FreeFMUstate")),
    "SerializedFMUstateSize": (ANY, state_call("SerializedFMUstateSize")),
    "SerializeFMUstate": (ANY, state_call("SerializeFMUstate")),
    "DeSerializeFMUstate": (ANY, state_call("DeSerializeFMUstate")),
    "GetDirectionalDerivative": ((), lambda one: one.do("GetDirectionalDerivative", None, 0, None, 0, None, None)),
    "SetRealInputDerivatives": (WRITE, lambda one: one.slopes({"n4.force.z": 1.0})),
    "GetRealOutputDerivatives": (MODES[2:], lambda one: one.output_derivatives(["n4.z"])[0]),
    "DoStep": (MODES[2:3], lambda one: one.step(0.0, 0.01)),
    "CancelStep": ((), lambda one: one.do("CancelStep")),
    "GetRealStatus": (MODES[2:4], lambda one: one.do("GetRealStatus", LAST_SUCCESSFUL_TIME, byref(c_double()))),
    "GetBooleanStatus": (MODES[2:4], lambda one: one.do("GetBooleanStatus", TERMINATED, byref(c_int()))),
}

#: What moves an instance on: out of order they are errors.  Everything else is refused then, and nothing is lost.
MOVING = {"SetupExperiment", "EnterInitializationMode", "ExitInitializationMode", "Terminate", "DoStep"}

#: Refused in every mode.
NEVER = {"CancelStep", "GetDirectionalDerivative"}


def out_of_order(function, mode):
    """Status of a function in a mode in which it must not be called."""
    return ERROR if function in MOVING or (mode == "error" and function not in NEVER) else DISCARD


#: Allowed, but there is nothing to say: fmi2Discard.
DISCARDED = {
    "GetStatus": lambda one: one.do("GetStatus", DO_STEP_STATUS, byref(c_int())),
    "GetIntegerStatus": lambda one: one.do("GetIntegerStatus", DO_STEP_STATUS, byref(c_int())),
    "GetStringStatus": lambda one: one.do("GetStringStatus", PENDING_STATUS, byref(c_char_p())),
}


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("function", CALLS)
def test_every_function_in_every_mode(function, mode, both):
    one = both("three_bar", mode)
    (modes, call), before = CALLS[function], one.serialised()
    wanted = OK if mode in modes else out_of_order(function, mode)
    assert call(one) == wanted, one.messages
    if wanted:
        category = "logStatusError" if wanted == ERROR else "logStatusDiscard"
        assert one.said(f"fmi2{function}") and {m[:2] for m in one.messages} == {(wanted, category)}
    if wanted == DISCARD:
        assert one.serialised() == before
    elif wanted == ERROR:
        assert one.do("SetReal", *one_reference(one, "gravity"), byref(c_double(9.0))) == ERROR  # the error stays
    assert one.do("Reset") == OK and one.start() == OK and one.step(0.0, 0.01) == OK


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("function", DISCARDED)
def test_status_of_steps_that_are_never_pending(function, mode, both):
    one = both("three_bar", mode)
    assert DISCARDED[function](one) == (ERROR if mode == "error" else DISCARD)
    assert one.said(f"fmi2{function}")


def test_every_function_is_exported_and_listed(both):
    one = both("two_bar")
    assert one.library.fmi2GetVersion() == b"2.0" and one.library.fmi2GetTypesPlatform() == b"default"
    assert {*CALLS, *DISCARDED} == set(ARGUMENTS)


def test_other_kinds_of_status_have_no_value(both):
    one = both("three_bar", "stepping")
    for kind in (DO_STEP_STATUS, PENDING_STATUS, TERMINATED, 99, -1):
        assert one.do("GetRealStatus", kind, byref(c_double())) == DISCARD
    for kind in (DO_STEP_STATUS, PENDING_STATUS, LAST_SUCCESSFUL_TIME, 99):
        assert one.do("GetBooleanStatus", kind, byref(c_int())) == DISCARD
    value = c_int(7)
    assert one.do("GetBooleanStatus", TERMINATED, byref(value)) == OK and value.value == 0
    assert one.last_time() == 0.0 and one.step(0.0, 0.01) == OK and one.last_time() == 0.01


def test_after_an_error_only_reset_a_state_or_reading_helps(both):
    one, other = both("three_bar_nsh", "stepping"), both("three_bar_nsh", "stepping")
    for two in (one, other):
        two.set({"n4.force.z": 60.0})
        two.walk(5)
    data, before = one.serialised(), one.outputs()
    assert one.do("CancelStep") == DISCARD and one.said("fmi2CancelStep", "never fmi2Pending")
    assert one.do("EnterInitializationMode") == ERROR
    same(one.outputs(), before)
    for function, (modes, call) in CALLS.items():
        if "error" not in modes:
            assert call(one) == out_of_order(function, "error"), function
    assert one.said("fmi2DoStep", "after an error", "reset") and one.said("fmi2SetReal", "after an error")
    assert one.restore(data) == OK
    same(one.walk(5, start=5), other.walk(5, start=5))
    assert one.step(0.0, 0.01) == ERROR and one.do("Reset") == OK and one.start() == OK
    one.set({"n4.force.z": 60.0})
    same(one.walk(5)[-1], before)


def test_a_state_saved_after_an_error_is_one_of_error(both):
    one = both("two_bar", "error")
    data = one.serialised()
    assert one.do("Reset") == OK and one.start() == OK and one.restore(data) == OK
    assert one.step(0.0, 0.01) == ERROR


def test_null_components_are_errors(both):
    one = both("two_bar")
    with_null = [getattr(one.library, f"fmi2{name}") for name in (*CALLS, *DISCARDED)]
    for call in with_null:
        assert call(None, *[0 if kind in (c_int, c_uint, c_size_t, c_double) else None for kind in call.argtypes[1:]]) == ERROR
    one.library.fmi2FreeInstance(None)


def null_calls(one):
    """(function, arguments) with one null pointer each, where the standard wants an array or a place for the answer."""
    ref, n = one_reference(one)
    force = one.references(["n4.force.z"])
    whole, state, size = one.references(["solver.method"]), one.save(), c_size_t()
    real, order, text = c_double(), c_int(1), c_char_p()
    yield from (("GetReal", (None, 1, byref(real))), ("GetReal", (ref, n, None)), ("SetReal", (None, 1, byref(real))))
    yield from (("SetReal", (force, 1, None)), ("GetInteger", (None, 1, byref(order))), ("GetInteger", (whole, 1, None)))
    yield from (("SetInteger", (None, 1, byref(order))), ("SetInteger", (whole, 1, None)))
    for function in ("GetBoolean", "GetString", "SetBoolean", "SetString"):
        yield function, (None, 1, byref(text if "String" in function else order))
    yield from (("SetDebugLogging", (1, 2, None)), ("GetFMUstate", (None,)), ("SetFMUstate", (None,)))
    yield from (("SerializedFMUstateSize", (None, byref(size))), ("SerializedFMUstateSize", (state, None)))
    yield from (("SerializeFMUstate", (None, b"", 0)), ("SerializeFMUstate", (state, None, 10**6)))
    yield from (("DeSerializeFMUstate", (None, 9, byref(c_void_p()))), ("DeSerializeFMUstate", (b"123", 3, None)))
    yield from (("GetRealStatus", (LAST_SUCCESSFUL_TIME, None)), ("GetBooleanStatus", (TERMINATED, None)))
    yield from (
        ("SetRealInputDerivatives", (None, 1, byref(order), byref(real))),
        ("SetRealInputDerivatives", (force, 1, None, byref(real))),
        ("SetRealInputDerivatives", (force, 1, byref(order), None)),
        ("GetRealOutputDerivatives", (None, 1, byref(order), byref(real))),
        ("GetRealOutputDerivatives", (ref, 1, None, byref(real))),
        ("GetRealOutputDerivatives", (ref, 1, byref(order), None)),
    )
    one.drop(state)


def test_null_pointers_are_refused(both):
    one = both("three_bar", "stepping")
    good = one.serialised()
    for function, arguments in null_calls(one):
        one.messages.clear()
        assert one.do(function, *arguments) == DISCARD, function
        assert one.said(f"fmi2{function}", "null pointer"), one.messages
        assert one.serialised() == good
    for function in ("GetReal", "SetReal", "GetInteger", "SetInteger", "GetString", "SetBoolean"):
        assert one.do(function, None, 0, None) == OK
    assert one.do("FreeFMUstate", None) == OK and one.do("FreeFMUstate", byref(c_void_p())) == OK
    assert one.step(0.0, 0.01) == OK


# Values


BAD = [
    ("n4.force.z", math.nan, "must be finite"),
    ("n4.force.z", math.inf, "must be finite"),
    ("s2.rest_length", -0.1, "at least 0"),
    ("s2.rest_length", -math.inf, "at least 0"),
    ("s1.rest_length_rate", math.nan, "must be finite"),
    ("s3.stiffness", -1.0, "at least 0"),
    ("s3.damping", math.nan, "at least 0"),
    ("gravity", math.inf, "must be finite"),
]


@pytest.mark.parametrize(("name", "bad", "rule"), BAD)
def test_bad_values_are_discarded_and_change_nothing(name, bad, rule, both):
    one, other = both("three_bar_nsh", "stepping"), both("three_bar_nsh", "stepping")
    same(one.walk(3), other.walk(3))
    good, data = one.get(name), one.serialised()
    assert one.set({name: bad}) == DISCARD
    assert one.messages[-1][:2] == (DISCARD, "logStatusDiscard")
    assert one.said("fmi2SetReal", f"{name} = {bad:g}", f"{good!r}".removesuffix(".0"), "kept", rule)
    assert one.get(name) == good and one.serialised() == data
    same(one.walk(5, start=3), other.walk(5, start=3))


@pytest.mark.parametrize("mode", ["instantiated", "initialization"])
def test_bad_start_values_are_discarded(mode, both):
    one = both("three_bar_nsh", mode)
    bad = {
        "s2.nsh.zeta[3]": (9.0, "at most 7.999999999999999"),
        "b1.mass": (0.0, "at least 2.2250738585072014e-308"),
        "s1.nsh.Q[1]": (-3.0, "at least"),
        "solver.tolerance": (1.0, "at most 0.1"),
        "solver.step": (-1.0, "at least 0"),
        "solver.method": (len(METHODS), f"at most {len(METHODS) - 1}"),
    }
    for name, (value, rule) in bad.items():
        assert one.set({name: value}) == DISCARD and one.said(f"{name} = {value:g}", rule), name
    if mode == "instantiated":
        assert one.start() == OK
    else:
        assert one.do("ExitInitializationMode") == OK
    assert one.get("b1.mass") == 1.0 and one.get("s2.nsh.zeta[3]") == 5.0 and one.integer("solver.method") == 0
    same(one.walk(3), both("three_bar_nsh", "stepping").walk(3))


def test_vectors_are_set_whole_or_not_at_all(both):
    one = both("three_bar", "stepping")
    names = ["n4.force.x", "n4.force.y", "n4.force.z"]
    assert one.set(dict(zip(names, (1.0, 2.0, 3.0)))) == OK
    data = one.serialised()
    for bad in ((7.0, math.nan, 9.0), (7.0, 8.0, math.inf), (-math.inf, 8.0, 9.0)):
        assert one.set(dict(zip(names, bad))) == DISCARD and one.get(*names) == [1.0, 2.0, 3.0]
    references = (c_uint * 3)(one.by_name[names[0]].valueReference, 10**6, one.by_name[names[1]].valueReference)
    assert one.do("SetReal", references, 3, (c_double * 3)(7.0, 8.0, 9.0)) == DISCARD
    assert one.get(*names) == [1.0, 2.0, 3.0]
    assert one.set({"n4.force.x": 5.0, "b1.mass": 2.0}) == DISCARD
    assert one.get("n4.force.x", "b1.mass") == [1.0, 1.0] and one.serialised() == data


@pytest.mark.parametrize("reference", [10**6, 2**31, 2**32 - 1])
@pytest.mark.parametrize(
    "function", [f"{verb}{kind}" for verb in ("Get", "Set") for kind in ("Real", "Integer", "Boolean", "String")]
)
def test_unknown_value_references_are_refused(function, reference, both):
    one = both("two_bar", "stepping")
    place = c_char_p() if "String" in function else c_double(7.0) if "Real" in function else c_int(7)
    assert one.do(function, (c_uint * 1)(reference), 1, byref(place)) == DISCARD
    assert one.said(f"fmi2{function}", str(reference), "value reference") and place.value in (7, None)
    assert one.step(0.0, 0.01) == OK


def test_the_types_of_value_references_are_kept_apart(both):
    one = both("two_bar_nsh", "stepping")
    real, whole = one.references(["gravity"]), one.references(["solver.method"])
    found = c_double(-1.0)
    assert one.do("GetReal", whole, 1, byref(found)) == OK and found.value == 0.0  # some importers read all outputs so
    assert one.do("SetReal", whole, 1, byref(c_double(1.0))) == DISCARD and one.said("no Real variable")
    assert one.do("GetInteger", real, 1, byref(c_int())) == DISCARD and one.said("no Integer variable")


def test_fixed_parameters_are_refused_after_initialization(both):
    one = both("three_bar_nsh", "stepping")
    good = one.serialised()
    late = {"b1.mass": 2.0, "s1.nsh.Q[2]": 9.0, "solver.tolerance": 1e-6, "solver.step": 0.1, "solver.method": 2}
    for name, value in late.items():
        whole = name == "solver.method"
        old = one.integer(name) if whole else one.get(name)
        assert one.set({name: value}) == DISCARD and one.said(name, "fixed parameter", "after initialization"), name
        assert (one.integer(name) if whole else one.get(name)) == old and one.serialised() == good
        assert one.set({name: old}) == OK  # what it is already
    assert one.step(0.0, 0.01) == OK


@pytest.mark.parametrize("mode", MODES[:3])
def test_outputs_cannot_be_set(mode, both):
    one = both("three_bar_nsh", mode)
    assert one.set({"n4.x": 0.123}) == DISCARD and one.said("n4.x", "it is an output")
    assert one.set({"s1.snapped": 2}) == DISCARD and one.said("s1.snapped", "it is an output")


def test_a_value_set_twice_in_one_call_is_the_last(both):
    one = both("three_bar", "stepping")
    assert one.do("SetReal", one.references(["gravity", "gravity"]), 2, (c_double * 2)(1.0, 2.0)) == OK
    assert one.get("gravity") == 2.0


def test_tolerance_of_the_host_and_of_the_parameter(both):
    def tolerance(early=None, **setup):
        one = both("two_bar")
        one.set({} if early is None else {"solver.tolerance": early})
        one.worst = one.start(**setup)
        return one.get("solver.tolerance"), one

    default, _ = tolerance()
    assert default == 1e-10
    found, one = tolerance(tolerance=1e-12)
    assert found == 1e-12 and not one.messages
    assert tolerance(tolerance=1e-6, parameters={"solver.tolerance": 1e-8})[0] == 1e-8
    found, one = tolerance(1e-5, tolerance=1e-12)
    assert found == 1e-5 and not one.messages
    for odd in (-3.0, math.nan, 1.0, 0.0, 1e-15):
        found, one = tolerance(tolerance=odd)
        assert found == default and one.worst == OK and one.said("tolerance", f"{odd:g}", "ignored")
        assert one.step(0.0, 0.01) == OK
    assert one.do("Reset") == OK and one.start(tolerance=1e-13) == OK and one.get("solver.tolerance") == 1e-13
    assert one.do("Reset") == OK and one.start() == OK and one.get("solver.tolerance") == default


@pytest.mark.parametrize("loose", [1e-4, 1e-9, 1.0000001e-10, 0.1])
def test_a_host_may_not_loosen_the_tolerance_unasked(loose, both):
    """OMSimulator passes 1e-4 where nobody chose one, and ends the run at fmi2Warning: fmi2OK, and a message."""
    one, other = both("two_bar_nsh", logging=False), both("two_bar_nsh", "stepping")
    assert one.do("SetupExperiment", 1, 1e-12, 0.0, 0, 0.0) == OK  # also where it was tighter before
    assert one.start(tolerance=loose) == OK
    ((status, category, text),) = one.messages
    assert (status, category) == (WARNING, "logStatusWarning")
    assert "looser than 1e-10" in text and f"{loose!r}".replace("e-0", "e-") in text.replace("e-0", "e-")
    assert "set solver.tolerance" in text and one.get("solver.tolerance") == 1e-10
    same(one.walk(20), other.walk(20))


def test_outputs_follow_at_once_in_initialization_mode_only(both):
    one = both("three_bar", "initialization")
    before, length = one.get("s1.force", "n1.reaction.z"), one.get("s1.rest_length")
    one.set({"s1.rest_length": length - 0.01})
    during = one.get("s1.force", "n1.reaction.z")
    assert during[0] == pytest.approx(before[0] + 50.0, rel=1e-9) and during[1] < before[1]
    assert one.do("ExitInitializationMode") == OK
    one.set({"s1.rest_length": length})
    assert one.get("s1.force", "n1.reaction.z") == during
    assert one.step(0.0, 1e-4) == OK and one.get("s1.force") < during[0]


def test_a_start_that_cannot_be_computed(both):
    """Accepted values one by one, but no finite accelerations: reading says so, and other values mend it."""
    one = both("three_bar", "initialization")
    assert one.set({"s1.stiffness": 1e300, "s1.rest_length": 0.0, "n4.force.z": 1e308, "b1.mass": 1e-300}) == OK
    assert one.do("GetReal", *one_reference(one), byref(c_double())) == DISCARD and one.said("no start can be computed")
    assert one.set({"s1.stiffness": 1000.0, "s1.rest_length": 0.5, "n4.force.z": 0.0, "b1.mass": 1.0}) == OK
    assert one.do("ExitInitializationMode") == OK and one.step(0.0, 0.01) == OK
    assert one.do("Reset") == OK and one.start({"n4.force.z": 1e308, "b1.mass": 1e-300}) == DISCARD
    assert one.said("fmi2ExitInitializationMode", "mended")
    assert one.set({"n4.force.z": 0.0, "b1.mass": 1.0}) == OK  # still in Initialization Mode
    assert one.do("ExitInitializationMode") == OK and one.step(0.0, 0.01) == OK


# Steps


def test_wrong_times_and_steps(both):
    one, other = both("three_bar", "stepping"), both("three_bar", "stepping")
    for two in (one, other):
        two.set({"n4.force.z": 20.0})
        two.walk(1)
    before, data, nan, inf = one.outputs(), one.serialised(), math.nan, math.inf
    points = ((0.02, 0.01), (0.0, 0.01), (0.01 + 1e-7, 0.01), (nan, 0.01), (inf, 0.01), (-0.01, 0.01))
    for time, h in (*points, (0.01, -0.01), (0.01, 0.0), (0.01, -0.0), (0.01, nan), (0.01, inf), (0.01, -inf)):
        one.messages.clear()
        assert one.step(time, h) == (ERROR if time != 0.01 else DISCARD), (time, h)
        same(one.outputs(), before)
        assert one.said("stands at 0.01 s" if time != 0.01 else "step size", f"{h:g}" if time == 0.01 else f"{time!r}"[:9])
        assert one.restore(data) == OK
    same(one.walk(2, start=1), other.walk(2, start=1))


def test_stop_time_is_kept_with_room_for_round_off(both):
    one = both("two_bar")
    one.start(stop_time=0.3)
    for k in range(3):
        assert one.step(k * 0.1, 0.1) == OK
    assert 3 * 0.1 > 0.3 and one.step(0.3, 1e-9) == ERROR and one.said("stop time 0.3 s")
    adding, time = both("two_bar"), 0.0
    adding.start(stop_time=1.0)
    for _ in range(1000):
        assert adding.step(time, 1e-3) == OK
        time += 1e-3
    assert time > 1.0 and adding.step(time, 1e-3) == ERROR


def test_a_step_across_the_stop_time_is_an_error(both):
    one = both("two_bar")
    one.start(stop_time=0.05)
    assert one.step(0.0, 0.06) == ERROR and one.said("from 0 s", "stop time 0.05 s")


def test_setup_of_the_experiment_is_checked(both):
    for start, stop in ((math.nan, 1.0), (math.inf, 1.0), (2.0, 1.0), (0.0, math.nan)):
        one = both("two_bar")
        assert one.do("SetupExperiment", 0, 0.0, start, 1, stop) == DISCARD and one.said("time"), (start, stop)
        assert one.start() == OK and one.step(0.0, 0.01) == OK
    assert both("two_bar").start(start_time=-5.0, stop_time=math.inf) == OK


def test_hosts_that_add_up_and_hosts_that_multiply(both):
    """20 000 steps of 1 ms by i h, and by a time that is added up and is 6e-12 s off in the end."""
    adding, counting, time, h = both("two_bar", "stepping"), both("two_bar", "stepping"), 0.0, 1e-3
    for k in range(20_000):
        assert adding.step(time, h) == OK and counting.step(k * h, h) == OK
        time += h
    assert time != 20.0 and adding.last_time() == time and counting.last_time() == 19_999 * h + h
    same(adding.outputs(), counting.outputs())


def test_start_time_does_not_change_the_motion(both):
    early, late = both("three_bar_nsh", "stepping"), both("three_bar_nsh")
    assert late.start(start_time=12.5) == OK and late.last_time() == 12.5
    for k in range(50):
        for one, start in ((early, 0.0), (late, 12.5)):
            one.set({"n5.force.z": 60.0})
            assert one.step(start + k / 64, 1 / 64) == OK
    same(early.outputs(), late.outputs())
    assert late.said("string", "at t = 12.") and late.last_time() == 12.5 + 50 / 64


@pytest.mark.parametrize("start", [1e3, 1e6, 1e8, 1.7e9, 1e12, -1.7e9])
@pytest.mark.parametrize("adding", [False, True])
def test_large_start_times_do_not_change_the_motion(start, adding, both):
    """Unix time, say, where a double resolves 2.4e-7 s: to the last bit, up to the stop time, whether the host counts its steps
    or adds them up."""
    h, count = 1e-3, 200
    early, late = both("three_bar_nsh", "stepping"), both("three_bar_nsh")
    assert late.start(start_time=start, stop_time=start + count * h) == OK
    early.set({"n4.force.z": 45.0})
    late.set({"n4.force.z": 45.0})
    time = start
    for k in range(count):
        assert early.step(k * h, h) == OK and late.step(time, h) == OK, late.messages
        time = time + h if adding else start + (k + 1) * h
    same(early.outputs(), late.outputs())
    assert late.last_time() == pytest.approx(time, abs=1.5 * math.ulp(time))
    if not adding:
        assert late.step(time, h) == ERROR and late.said("stop time")


@pytest.mark.parametrize("start", [0.0, 1e6, 1.7e9])
def test_a_step_too_many_is_seen_at_any_start_time(start, both):
    one, h, time = both("two_bar"), 1e-3, start
    one.start(start_time=start, stop_time=start + 0.1)
    while one.step(time, h) == OK:
        time += h
    assert time == pytest.approx(start + 0.1, abs=0.5 * h) and one.said("stop time")


@pytest.mark.parametrize("force", [1e300, -1e308])
def test_a_step_that_fails_is_discarded_and_changes_nothing(force, both):
    one, other = both("three_bar_nsh", "stepping"), both("three_bar_nsh", "stepping")
    same(one.walk(2), other.walk(2))
    before = one.outputs()
    one.set({"n4.force.z": force})
    assert one.step(0.02, 1.0) == DISCARD and one.said("from t = 0.02 s is discarded")
    assert one.last_time() == 0.02
    same(one.outputs(), before)
    assert one.get("n4.force.z") == force
    one.set({"n4.force.z": 0.0})
    same(one.walk(3, start=2), other.walk(3, start=2))


def test_a_rest_length_that_would_turn_negative_is_discarded(both):
    one = both("three_bar", "stepping")
    one.set({"s5.rest_length": 0.001, "s5.rest_length_rate": -1.0})
    assert one.step(0.0, 0.01) == DISCARD and one.said("discarded", "negative") and one.last_time() == 0.0
    one.set({"s5.rest_length_rate": 0.0})
    assert one.step(0.0, 0.01) == OK


def test_terminate_and_reset_is_a_new_beginning(both):
    one, fresh = both("three_bar_nsh"), both("three_bar_nsh", "stepping")
    one.start({"s1.damping": 50.0, "s2.nsh.Q[1]": 20.0}, start_time=3.0, stop_time=4.0, tolerance=1e-5)
    one.set({"n4.force.z": 70.0})
    one.slopes({"n4.force.x": 5.0})
    assert one.step(3.0, 0.01) == OK and one.do("Terminate") == OK
    last = one.outputs()
    same(one.outputs(), last)
    assert one.step(3.01, 0.01) == ERROR and one.said("fmi2DoStep", "after fmi2Terminate")
    assert one.do("Reset") == OK and one.start() == OK
    assert one.get("s1.damping", "n4.force.z") == [500.0, 0.0]
    same(one.walk(150), fresh.walk(150))


# Messages


def events(one):
    return [text for _, category, text in one.messages if category == "logEvents"]


def swing(one):
    one.set({"n4.force.z": 45.0})
    one.walk(30)
    return events(one)


def test_transitions_are_logged_where_wanted(both):
    on, off = both("three_bar_nsh", "stepping"), both("three_bar_nsh", "stepping", logging=False)
    found = swing(on)
    assert found[0].startswith("string s2: piece 1 -> 0 at t = 0.0165")
    assert swing(off) == [] and not off.messages
    assert off.set({"n4.force.z": math.nan}) == DISCARD and off.said("n4.force.z")  # what goes wrong is always said
    some = both("three_bar_nsh", "stepping", logging=False)
    assert some.do("SetDebugLogging", 1, 1, (c_char_p * 1)(b"logEvents")) == OK
    assert swing(some) == found
    some.do("Terminate")
    assert {category for _, category, _ in some.messages} == {"logEvents"}
    assert on.do("SetDebugLogging", 0, 0, None) == OK
    on.messages.clear()
    on.set({"n4.force.z": -45.0})
    on.walk(20, start=30)
    assert not on.messages


def test_the_solvers_work_is_logged(both):
    one = both("three_bar_nsh", "stepping")
    one.walk(3)
    assert one.do("Terminate") == OK
    assert next(text for _, category, text in one.messages if category == "logSolver").startswith("since the start: ")


def test_categories_are_those_of_the_description(both):
    one = both("two_bar")
    text = (one.folder / "modelDescription.xml").read_text(encoding="utf-8")
    for category in ("logStatusWarning", "logStatusDiscard", "logStatusError", "logEvents", "logSolver"):
        assert f'<Category name="{category}"' in text
        assert one.do("SetDebugLogging", 1, 1, (c_char_p * 1)(category.encode())) == OK


def test_messages_are_safe_as_formats(both):
    """The host hands a message to printf, and takes # for the mark of a variable: both are doubled."""
    one = both("two_bar")
    assert one.do("SetDebugLogging", 1, 2, (c_char_p * 2)(b"50 %s%n #r7#", None)) == WARNING
    assert one.said("50 %%s%%n ##r7##") and one.said("(null)")
    bad = both("two_bar", guid=b"%s#%n")
    assert bad.component is None and bad.said("%%s##%%n")
    long = both("two_bar", guid=b"%" * 100_000)
    assert long.component is None and len(long.messages[0][2]) < 3000


# Instantiation


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"guid": b"{0}"}, ("GUID {0}",)),
        ({"guid": b""}, ("GUID and resource location",)),
        ({"kind": MODEL_EXCHANGE}, ("co-simulation only",)),
        ({"kind": 77}, ("co-simulation only",)),
        ({"name": b""}, ("needs a name",)),
        ({"name": b"  "}, ("needs a name",)),
        ({"name": None}, ("needs a name",)),
        ({"location": b""}, ("resource location",)),
        ({"location": b"file:///no/where"}, ("/no/where/", "unzip")),
        ({"location": b"http://example.org/resources"}, ("cannot be read",)),
        ({"location": b"file:"}, ("cannot be read",)),
        ({"location": b"%"}, ("cannot be read",)),
    ],
)
def test_instantiation_that_must_fail(wrong, words, both):
    one = both("two_bar", **wrong)
    assert one.component is None and one.said("fmi2Instantiate", *words), one.messages
    assert {message[:2] for message in one.messages} == {(ERROR, "logStatusError")}
    assert both("two_bar", logger=False, **wrong).component is None


def test_no_callbacks_are_needed(both):
    one = both("two_bar", logger=False)
    assert one.start() == OK and one.step(0.0, 0.01) == OK and one.step(0.0, 0.01) == ERROR


@pytest.mark.parametrize("folder", ["größe #1", "with space", "100%", "a+b;c", "日本"])
def test_runs_from_any_folder_by_any_uri(folder, both, tmp_path):
    """Percent-encoded URIs of every form, and a plain path, with and without a slash at the end."""
    copy = tmp_path / folder
    shutil.copytree(both.folders["two_bar"], copy)
    uri = (copy / "resources").as_uri().removeprefix("file://")
    expected = both("two_bar", "stepping").walk(3)
    for form in (f"file://{uri}", f"file:{uri}", f"file://localhost{uri}", str(copy / "resources")):
        for slash in ("", "/"):
            one = both(copy, location=(form + slash).encode())
            assert one.component, (form, one.messages)
            one.start()
            same(one.walk(3), expected)
    lower = f"file://{uri}".replace("%C3%B6", "%c3%b6")  # digits of percent codes may be small letters
    assert both(copy, location=lower.encode()).component


# States


@pytest.mark.parametrize("name", ["three_bar_nsh", "six_bar"])
def test_rollback_repeats_to_the_last_bit(name, both):
    one = both(name, "stepping")
    one.set({"n4.force.z": 60.0, "s4.rest_length_rate": -0.05})
    one.walk(17)
    one.slopes({"n5.force.x": 200.0})
    one.slopes({"n5.force.x": -3000.0}, order=2)
    one.walk(3, start=17)
    state, early = one.save(), one.outputs()
    first = one.walk(20, start=20)
    one.set({"gravity": 3.0, "s1.stiffness": 100.0})
    one.slopes({"n5.force.x": 0.0})
    one.walk(5, start=40)
    assert one.do("SetFMUstate", state) == OK
    assert one.get("gravity") == 9.81 and one.last_time() == pytest.approx(0.2)
    same(one.outputs(), early)
    same(one.walk(20, start=20), first)
    one.drop(state)


@pytest.mark.parametrize("method", range(6))
def test_rollback_within_an_open_step(method, both):
    """Communication steps so short that the integrator's own step spans many of them: a state between is one to go back to."""
    one, h = both("three_bar_nsh"), 1e-4
    one.start({"solver.method": method})
    one.set({"n4.force.z": 45.0})
    one.walk(40, h)
    states, rows = [], []
    for k in range(40, 60):
        states.append(one.save())
        rows.append(one.walk(1, h, k)[0])
    for k in (59, 41, 40, 50):
        assert one.do("SetFMUstate", states[k - 40]) == OK
        same(one.walk(60 - k, h, k), rows[k - 40 :])
    for state in states:
        one.drop(state)


def test_states_of_every_mode_come_back(both):
    for mode in MODES:
        one = both("two_bar", mode)
        data = one.serialised()
        assert one.do("Reset") == OK and one.start({"gravity": 5.0}) == OK
        assert one.restore(data) == OK and one.serialised() == data
        assert one.do("Terminate") == (OK if mode == "stepping" else ERROR)


def test_a_state_in_initialization_mode_keeps_what_is_not_computed_yet(both):
    one = both("three_bar", "initialization")
    one.set({"s1.rest_length": 0.3})
    state = one.save()
    expected = one.outputs()
    one.set({"s1.rest_length": 0.4})
    assert one.do("SetFMUstate", state) == OK
    same(one.outputs(), expected)
    one.drop(state)


def test_a_state_of_a_run_without_an_end_comes_back(both):
    """A host may define the stop time as infinite."""
    one = both("two_bar")
    assert one.do("SetupExperiment", 0, 0.0, 0.0, 1, math.inf) == OK
    state = one.save()
    assert one.do("SetFMUstate", state) == OK
    assert one.do("FreeFMUstate", byref(state)) == OK
    assert one.restore(one.serialised()) == OK


def test_a_state_pointer_is_used_again(both):
    one = both("two_bar", "stepping")
    state = one.save()
    address = state.value
    one.walk(3)
    assert one.do("GetFMUstate", byref(state)) == OK and state.value == address
    row = one.walk(1, start=3)
    assert one.do("SetFMUstate", state) == OK
    same(one.walk(1, start=3), row)
    one.drop(state)


def test_serialised_states_go_from_instance_to_instance(both):
    one, other = both("six_bar_nsh", "stepping"), both("six_bar_nsh")
    one.set({"n4.force.z": 200.0})
    one.slopes({"n4.force.z": -50.0})
    one.walk(12)
    data = one.serialised()
    assert one.serialised() == data
    first = one.walk(10, start=12)
    assert other.restore(data) == OK
    same(other.walk(10, start=12), first)


def test_serialised_states_go_from_process_to_process(both, tmp_path):
    one = both("three_bar_nsh", "stepping")
    one.set({"n4.force.z": 45.0})
    one.walk(25, 1e-3)
    (tmp_path / "state").write_bytes(one.serialised())
    program = (
        "import sys, numpy; sys.path[:0] = sys.argv[4:]; from tests.support.native_calls import Calls\n"
        "one = Calls(sys.argv[1]); assert one.restore(open(sys.argv[2], 'rb').read()) == 0\n"
        "numpy.save(sys.argv[3], one.walk(40, 1e-3, 25)); one.free()\n"
    )
    paths = [both.folders["three_bar_nsh"], tmp_path / "state", tmp_path / "rows.npy", HERE.parents[2]]
    done = subprocess.run([sys.executable, "-c", program, *map(str, paths)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    same(np.load(tmp_path / "rows.npy"), one.walk(40, 1e-3, 25))


@pytest.fixture(scope="module", params=["both", "python"])
def sample(request, native_folders, python_folders):
    """An instance in the middle of a run, and its serialised state."""
    from tests.support.native_calls import Calls

    one = Calls({"both": native_folders, "python": python_folders}[request.param]["two_bar_nsh"])
    one.start()
    one.set({"n4.force.z" if "n4.force.z" in one.by_name else "n3.force.z": 20.0})
    one.walk(7)
    one.head = {"both": 72, "python": 70}[request.param]  # bytes before the kernel's
    yield one, one.serialised()
    one.free()


def assert_refused(one, good, bad, *words):
    """The bytes are refused, and nothing changes."""
    before, state = one.outputs(), one.serialised()
    one.messages.clear()
    assert one.restore(bad) == DISCARD and one.said("fmi2DeSerializeFMUstate", *words)
    same(one.outputs(), before)
    assert one.serialised() == state and one.restore(good) == OK


DERANDOMIZED = settings(derandomize=True, deadline=None, max_examples=150)


@DERANDOMIZED
@given(st.data())
def test_damaged_states_are_refused(sample, data):
    """Bits flipped anywhere, also several."""
    one, good = sample
    bad = bytearray(good)
    for place in data.draw(st.lists(st.integers(0, 8 * len(good) - 1), min_size=1, max_size=4, unique=True)):
        bad[place // 8] ^= 1 << place % 8
    assert_refused(one, good, bytes(bad))


@DERANDOMIZED
@given(st.data())
def test_states_of_another_length_are_refused(sample, data):
    one, good = sample
    cut = good[: data.draw(st.integers(0, len(good) - 1))]
    longer = good + data.draw(st.binary(min_size=1, max_size=40))
    assert_refused(one, good, cut, "too short" if len(cut) < one.head else "cut or lengthened")
    assert_refused(one, good, good[: one.head - 1], "too short")
    assert_refused(one, good, good[: one.head], "cut or lengthened")
    assert_refused(one, good, longer, "cut or lengthened")


def test_a_flip_of_every_byte_is_refused(sample):
    one, good = sample
    for place in range(len(good)):
        bad = bytearray(good)
        bad[place] ^= 1 << place % 8
        assert one.restore(bytes(bad)) == DISCARD, place
    assert one.restore(good) == OK


def test_states_of_another_scene_are_refused(both):
    """Also where the other state is the smaller one: nothing beyond it is read (valgrind would tell, test_native_host.py)."""
    small, large = both("two_bar", "stepping"), both("six_bar_nsh", "stepping")
    for one, other in ((small, large), (large, small)):
        good, strange, size = one.serialised(), other.save(), c_size_t()
        assert_refused(one, good, other.serialised(), "another FMU")
        room = ctypes.create_string_buffer(10**6)
        for function, arguments in (
            ("SetFMUstate", (strange,)),
            ("SerializedFMUstateSize", (strange, byref(size))),
            ("SerializeFMUstate", (strange, room, 10**6)),
        ):
            assert one.do(function, *arguments) == DISCARD and one.said(f"fmi2{function}", "another FMU"), function
            assert one.serialised() == good
        other.drop(strange)
        one.walk(2)


def test_states_of_a_changed_scene_are_refused(both, tmp_path):
    """The same shape, but another mass: another GUID, so another FMU."""
    heavier = replace(scene("two_bar"), bar_mass=2.0 * scene("two_bar").bar_mass)
    with ZipFile(both.pack(heavier, tmp_path / "heavier.fmu")) as archive:
        archive.extractall(tmp_path / "heavier")
    other, one = both(tmp_path / "heavier", "stepping"), both("two_bar", "stepping")
    assert_refused(one, one.serialised(), other.serialised(), "another FMU")


def test_a_vector_too_short_for_a_state_is_refused(both):
    one = both("two_bar", "stepping")
    state, size = one.save(), c_size_t()
    one.do("SerializedFMUstateSize", state, byref(size))
    data = ctypes.create_string_buffer(size.value)
    assert one.do("SerializeFMUstate", state, data, size.value - 1) == DISCARD and one.said("too short")
    assert data.raw == bytes(size.value)
    one.drop(state)


# Derivatives of inputs and outputs


@pytest.mark.parametrize("name", ["three_bar_nsh", "two_bar"])
def test_input_derivatives_are_the_kernels_slopes(name, both):
    one, kernel = both(name, "stepping"), Kernel(scene(name))
    kernel.initialize()
    rng = np.random.default_rng(5)
    inputs = one.names("input")
    scale = np.array([100.0 if "force" in name else 0.02 for name in inputs])
    for k in range(25):
        if k % 4 == 0:
            values = rng.normal(size=(2, len(inputs))) * scale * (k < 20)
            for order in (1, 2):
                assert one.slopes(dict(zip(inputs, values[order - 1].tolist())), order) == OK
                kernel.slopes[order - 1] = values[order - 1]
        assert one.step(k * 0.01, 0.01) == OK
        kernel.step(0.01)
        np.testing.assert_allclose(one.outputs(), kernel_outputs(kernel), rtol=1e-12, atol=1e-14)


def test_both_orders_in_one_call_and_a_rest_length_without_its_rate(both):
    """A rest length that moves by its derivative is one that moves by the rate input, to the last bit."""
    by_rate, by_slope, both = (both("three_bar", "stepping") for _ in range(3))
    by_rate.set({"s1.rest_length_rate": -0.05})
    by_slope.slopes({"s1.rest_length": -0.05})
    same(by_slope.walk(10), by_rate.walk(10))
    references, orders = both.references(["n4.force.z", "n4.force.z", "s1.rest_length"]), (c_int * 3)(2, 1, 1)
    assert both.do("SetRealInputDerivatives", references, 3, orders, (c_double * 3)(-9.0, 4.0, -0.05)) == OK
    kernel = Kernel(scene("three_bar"))
    kernel.initialize()
    kernel.slopes[:, 2] = 4.0, -9.0
    kernel.slopes[0, kernel.layout["rest_length"].start] = -0.05
    both.walk(5)
    for _ in range(5):
        kernel.step(0.01)
    np.testing.assert_allclose(both.outputs(), kernel_outputs(kernel), rtol=1e-12, atol=1e-14)


def test_wrong_input_derivatives(both):
    one, other = both("three_bar", "stepping"), both("three_bar", "stepping")
    good = one.serialised()
    for bad in (math.nan, math.inf, -math.inf):
        assert one.slopes({"n4.force.x": 7.0, "n4.force.z": bad}) == DISCARD
        assert one.said("derivative 1 of n4.force.z", f"{bad:g}", "finite")
    for order in (0, 3, -1, 2**31 - 1):
        assert one.slopes({"n4.force.x": 7.0}, order) == DISCARD and one.said("order 1 and 2")
    for name in ("gravity", "n4.z", "s1.stiffness"):
        assert one.slopes({name: 1.0}) == DISCARD and one.said("no input variable")
    assert one.serialised() == good
    same(one.walk(3), other.walk(3))


@pytest.mark.parametrize("name", ["three_bar_nsh", "six_bar"])
def test_output_derivatives_are_the_kernels(name, both):
    one, kernel = both(name, "stepping"), Kernel(scene(name))
    kernel.initialize()
    outputs = one.names("output")
    one.set({"n4.force.z": 45.0})
    kernel["force"][one.by_name["n4.force.z"].valueReference] = 45.0
    for k in range(10):
        assert one.step(k * 0.01, 0.01) == OK
        kernel.step(0.01)
        status, found = one.output_derivatives(outputs)
        assert status == OK
        np.testing.assert_allclose(found, np.concatenate([*kernel.output_derivatives().values()]), rtol=1e-12, atol=1e-14)
    shown = dict(zip(outputs, found))
    assert shown["n4.z"] == pytest.approx(one.get("n4.velocity.z"), rel=1e-9)


def test_output_derivatives_do_not_disturb_the_run(both):
    one, other = both("three_bar_nsh", "stepping"), both("three_bar_nsh", "stepping")
    for k in range(200):
        for two in (one, other):
            two.set({"n4.force.z": 45.0 if k < 100 else 10.0})
            assert two.step(k * 1e-3, 1e-3) == OK
        assert one.output_derivatives(one.names("output"))[0] == OK
        same(one.outputs(), other.outputs())
    one.set({"n4.force.z": -99.0, "gravity": 1.0})
    before = other.output_derivatives(["n4.velocity.z"])[1]
    same(one.output_derivatives(["n4.velocity.z"])[1], before)  # of the last step, whatever is set since


def test_output_derivatives_follow_restored_states(both):
    one = both("three_bar_nsh", "stepping")
    one.set({"n4.force.z": 45.0})
    one.walk(5)
    first, data = one.output_derivatives(["n4.velocity.z"])[1], one.serialised()
    one.walk(5, start=5)
    assert one.output_derivatives(["n4.velocity.z"])[1] != first
    assert one.restore(data) == OK
    same(one.output_derivatives(["n4.velocity.z"])[1], first)


def test_wrong_output_derivatives(both):
    one = both("three_bar_nsh", "stepping")
    good = one.serialised()
    for order in (0, 2, -1):
        found = one.do("GetRealOutputDerivatives", one.references(["n4.z"]), 1, byref(c_int(order)), byref(c_double()))
        assert found == DISCARD and one.said("order 1")
    for name in ("gravity", "n4.force.z", "s1.snapped"):
        assert one.output_derivatives([name])[0] == DISCARD and one.said("no Real output")
    assert one.serialised() == good


# Several in one process


def test_instances_and_fmus_do_not_touch_each_other(both):
    alone = {}
    for name in ("three_bar_nsh", "two_bar"):
        one = both(name, "stepping")
        one.set({"n4.force.z" if name == "three_bar_nsh" else one.names("input")[0]: 30.0})
        alone[name] = one.walk(20)
    pushed, still, planar = (
        both("three_bar_nsh", "stepping"),
        both("three_bar_nsh", "stepping"),
        both("two_bar", "stepping"),
    )
    pushed.set({"n4.force.z": 30.0})
    planar.set({planar.names("input")[0]: 30.0})
    for k in range(20):
        same(pushed.walk(1, start=k)[0], alone["three_bar_nsh"][k])
        still.walk(1, start=k)
        same(planar.walk(1, start=k)[0], alone["two_bar"][k])
    assert still.get("n4.z") == pytest.approx(scene("three_bar_nsh").nodes[3, 2], abs=1e-9)


def test_the_library_may_be_loaded_globally_beside_the_python_fmu(both, native_folders, pair):
    """RTLD_GLOBAL makes the FMI functions visible to all: each FMU must go on with its own."""
    ctypes.CDLL(str(library_of(native_folders["six_bar"])), mode=ctypes.RTLD_GLOBAL)
    python, _ = pair("two_bar")
    python.start()
    one = both("two_bar", "stepping")
    one.walk(3)
    for k in range(3):
        python.fmu.doStep(k * 0.01, 0.01)
    assert python.get("n3.z") == one.get("n3.z")


def test_the_resources_may_vanish_after_instantiation(both, tmp_path):
    copy = tmp_path / "gone"
    shutil.copytree(both.folders["two_bar_nsh"], copy)
    one = both(copy, "stepping")
    shutil.rmtree(copy / "resources")
    same(one.walk(5), both("two_bar_nsh", "stepping").walk(5))
    assert one.do("Reset") == OK and one.start() == OK


@pytest.mark.skipif(os.name == "nt", reason="paths of POSIX")
def test_fmpy_runs_it_from_a_folder_with_odd_characters(native_fmus, tmp_path):
    from fmpy import simulate_fmu

    odd = tmp_path / "größe #1"
    odd.mkdir()
    copy = shutil.copy(native_fmus["two_bar"], odd / "x.fmu")
    found = simulate_fmu(str(copy), stop_time=0.05, output_interval=0.01, output=["n3.z"])
    assert len(found) == 6


# What fmpy does with discarded steps


@pytest.mark.parametrize("runtime", ["both", "python"])
@pytest.mark.parametrize(
    "settings",
    [
        {"start_values": {"solver.method": 4, "solver.step": 0.01}},  # rk4 with a step far too long
        {"input": np.array([(0.0, -300.0)], dtype=[("time", float), ("s1.rest_length_rate", float)])},
    ],
)
def test_simulate_fmu_ends_at_a_step_that_cannot_be_completed(runtime, settings, fmus, native_fmus):
    """It asks whether the run is to end, and would try the same step for ever if told that it is not."""
    from fmpy import simulate_fmu

    fmu = (native_fmus if runtime == "both" else fmus)["three_bar_nsh"]
    result = simulate_fmu(str(fmu), stop_time=5.0, output_interval=0.01, output=["n4.z"], timeout=60.0, **settings)
    assert result["time"][-1] < 1.0 and len(result) < 200 and np.all(np.isfinite(result["n4.z"]))


def test_a_discarded_step_asks_to_end_the_run_until_one_succeeds(both):
    one, ended = both("three_bar", "stepping"), c_int(7)

    def asks():
        assert one.do("GetBooleanStatus", TERMINATED, byref(ended)) == OK
        return bool(ended.value)

    assert not asks()
    assert one.set({"s1.rest_length_rate": -300.0}) == OK
    assert one.step(0.0, 0.01) == DISCARD and asks()
    assert one.set({"s1.rest_length_rate": 0.0}) == OK
    assert one.step(0.0, 0.01) == OK and not asks()


def test_events_say_what_they_mean_and_both_runtimes_say_it_alike(pair):
    """A lift that snaps beams: slack, taut and snaps by name, the same lines in the same order."""
    lines = []
    for one in pair("three_bar_nsh"):
        one.start()
        one.set({"n4.force.z": 60.0, "n5.force.z": 60.0, "n6.force.z": 60.0})
        for k in range(100):
            one.fmu.doStep(k * 0.01, 0.01)
        one.set({"n4.force.z": -300.0})
        for k in range(100, 150):
            one.fmu.doStep(k * 0.01, 0.01)
        lines.append([text for _, category, text in one.messages if category == "logEvents"])
    both, python = lines[1], lines[0]
    assert both == python and len(both) > 20
    for ending in (", slack", ", taut", ", 1 snapped", ", 3 snapped"):
        assert any(line.endswith(ending) for line in both), ending


def test_both_runtimes_name_the_value_that_a_step_refuses(pair):
    lines = []
    for one in pair("three_bar"):
        one.start()
        one.set({"s2.rest_length": 0.25, "s2.rest_length_rate": -50.0})
        with pytest.raises(FMICallException):
            one.fmu.doStep(0.0, 0.01)
        lines.append(one.messages[-1][2])
    assert lines[0] == lines[1]
    assert "s2.rest_length = 0.25 would become negative within the step" in lines[0]


def test_nothing_is_read_where_no_start_can_be_computed(both):
    one = both("three_bar", "initialization")
    one.set({"n4.force.z": -1.7976931348623157e308})
    assert one.do("GetReal", None, 0, None) == one.do("GetInteger", None, 0, None) == OK
    with pytest.raises(AssertionError):
        one.get("n4.z")


@pytest.mark.parametrize("shortest", [1e-300, 1e-30])
def test_a_step_that_is_next_to_nothing_leaves_the_next_one_alone(both, shortest):
    """Its own length tells the step control nothing."""
    one = both("two_bar", "stepping")
    one.set({"s1.damping": 10.0})
    assert one.do("DoStep", 0.0, shortest, 1) == OK
    assert one.do("DoStep", shortest, 1e-3, 1) == OK
    other = both("two_bar", "stepping")
    other.set({"s1.damping": 10.0})
    assert other.do("DoStep", 0.0, 1e-3, 1) == OK
    np.testing.assert_allclose(one.outputs(), other.outputs(), rtol=1e-9, atol=1e-9)
