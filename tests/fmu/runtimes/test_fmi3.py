"""The native FMU of FMI 3.0: order of calls, arrays, Event Mode, looks into steps and early return, states, model exchange.

More random calls than in test_random_calls.py: see there.
"""

import ctypes
import math
import re
import shutil
import subprocess
import zipfile
from ctypes import byref, c_bool, c_double, c_int8, c_int32, c_int64, c_size_t, c_uint32, c_void_p
from pathlib import Path

import numpy as np
import pytest

from fmu_src.packing.native_fmu import pack_native_fmu
from tensegrity_core.native import build
from tests.conftest import once
from tests.support import scene
from tests.support.fmi3_calls import ARGUMENTS, INSTANTIATE, TYPES, Calls3, library_of
from tests.support.native_calls import DISCARD, ERROR, OK, WARNING, Calls

FORCE = "n4.force"
UP = [0.0, 0.0, 300.0]


def extracted(tmp_path_factory, name: str, **contents) -> Path:
    def make(folder):
        fmu = pack_native_fmu(scene(name), folder.with_suffix(".fmu"), **contents)
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(folder)

    return once(tmp_path_factory, "-".join((name, *contents.values())).replace(".", ""), make)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The extracted FMU of both kinds of three_bar_nsh."""
    return extracted(tmp_path_factory, "three_bar_nsh", standard="3.0", kind="both")


@pytest.fixture(scope="module")
def planar(tmp_path_factory) -> Path:
    return extracted(tmp_path_factory, "two_bar_nsh", standard="3.0")


@pytest.fixture
def calls(folder):
    """calls(mode, **arguments): an instance."""
    made = []

    def make(mode="stepping", where=folder, **arguments):
        made.append(Calls3(where, **arguments))
        assert made[-1].component, made[-1].messages
        made[-1].bring_to(mode)
        return made[-1]

    yield make
    for one in made:
        one.free()


# The list of functions


def test_every_function_of_the_standard_is_there_and_nothing_else(folder):
    header = (build.fmi_headers() / "fmi3Functions.h").read_text(encoding="utf-8")
    declared = set(re.findall(r"^FMI3_Export \w+\s+(fmi3\w+);", header, re.MULTILINE))
    fixed = {"fmi3GetVersion", "fmi3FreeInstance", *(f"fmi3Instantiate{kind}" for kind in INSTANTIATE)}
    assert declared == fixed | {f"fmi3{name}" for name in ARGUMENTS}
    if shutil.which("nm") and library_of(folder).suffix == ".so":
        command = ["nm", "-D", "--defined-only", str(library_of(folder))]
        listed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
        found = {line.split()[-1] for line in listed.splitlines()}
        assert {name for name in found if name.startswith("fmi3")} == declared
        assert all(name.startswith(("fmi2", "fmi3")) for name in found)
    assert Calls3(folder).library.fmi3GetVersion() == b"3.0"


# Life cycle

WHERE = ("instantiated", "initialization", "event", "stepping", "continuous", "terminated", "error")
#: Kinds, and the mode that each has not.
OTHERS = (("CoSimulation", "continuous"), ("ModelExchange", "stepping"))
LATER = ("initialization", "event", "stepping", "continuous", "terminated", "error")
RUNNING = ("event", "stepping", "continuous")
#: Function -> modes of co-simulation with Event Mode in which it works, of model exchange, and the status elsewhere.
ORDER = {
    "EnterInitializationMode": (("instantiated",), ("instantiated",), ERROR),
    "ExitInitializationMode": (("initialization",), ("initialization",), ERROR),
    "Terminate": (RUNNING, RUNNING, ERROR),
    "Reset": (WHERE, WHERE, ERROR),
    "EnterEventMode": (("event", "stepping"), ("event", "continuous"), ERROR),
    "UpdateDiscreteStates": (("event",), ("event",), ERROR),
    "EnterStepMode": (("event",), (), ERROR),
    "DoStep": (("stepping",), (), ERROR),
    "EnterContinuousTimeMode": ((), ("event",), ERROR),
    "CompletedIntegratorStep": ((), ("continuous",), ERROR),
    "SetTime": ((), ("event", "continuous"), DISCARD),
    "SetContinuousStates": ((), ("continuous",), DISCARD),
    "GetContinuousStates": ((), ("initialization", *RUNNING, "terminated", "error"), DISCARD),
    "GetContinuousStateDerivatives": ((), ("initialization", *RUNNING, "terminated", "error"), DISCARD),
    "GetEventIndicators": ((), ("initialization", *RUNNING, "terminated", "error"), DISCARD),
    "GetNominalsOfContinuousStates": ((), WHERE, DISCARD),
    "GetNumberOfContinuousStates": ((), WHERE, DISCARD),
    "GetNumberOfEventIndicators": ((), WHERE, DISCARD),
    "GetOutputDerivatives": (("stepping", "terminated", "error"), (), DISCARD),
    "GetFloat64": (LATER, LATER, DISCARD),
    "SetFloat64": (("instantiated", "initialization", *RUNNING), ("instantiated", "initialization", *RUNNING), DISCARD),
}
#: What an instance of a kind cannot do and says with this status where the mode would allow it.
REFUSED = {("CoSimulation", "EnterContinuousTimeMode", "event"), ("ModelExchange", "EnterStepMode", "event")}


def arguments(one: Calls3, function: str) -> tuple:
    """Right ones for each function, for the modes in which it works."""
    states = one.states_count if one.kind == "ModelExchange" else 20
    x, count = (c_double * states)(), c_size_t()
    if one.kind == "ModelExchange":
        one.do("GetContinuousStates", x, states)
    flags, number = [c_bool() for _ in range(5)], c_double()
    output, given = one.references(["n4.position"]), one.references([FORCE])
    return {
        "EnterInitializationMode": (False, 0.0, 0.0, False, 0.0),
        "UpdateDiscreteStates": (*map(byref, flags), byref(number)),
        "DoStep": (0.0, 0.01, True, *map(byref, flags[:3]), byref(number)),
        "CompletedIntegratorStep": (True, byref(flags[0]), byref(flags[1])),
        "SetTime": (0.0,),
        "GetEventIndicators": ((c_double * 12)(), 12),
        "GetNumberOfContinuousStates": (byref(count),),
        "GetNumberOfEventIndicators": (byref(count),),
        "GetOutputDerivatives": (output, 1, (c_int32 * 1)(1), (c_double * 3)(), 3),
        "GetFloat64": (output, 1, (c_double * 3)(), 3),
        "SetFloat64": (given, 1, (c_double * 3)(), 3),
    }.get(function, (x, states) if "States" in function or "Derivatives" in function else ())


@pytest.mark.parametrize("function", ORDER)
@pytest.mark.parametrize("kind, mode", [(kind, mode) for kind, other in OTHERS for mode in WHERE if mode != other])
def test_calls_in_and_out_of_order(calls, kind, mode, function):
    exchange = kind == "ModelExchange"
    one = calls(mode, kind=kind, event_mode=not exchange)
    given = arguments(one, function)
    modes, otherwise = ORDER[function][exchange], ORDER[function][2]
    expected = OK if mode in modes else ERROR if mode == "error" and not modes_of_both(function, mode) else otherwise
    if (kind, function, mode) in REFUSED:
        expected = DISCARD
    one.messages.clear()
    status = one.do(function, *given)
    assert status == expected, one.messages
    if expected != OK:
        assert one.said(f"fmi3{function}")


def modes_of_both(function: str, mode: str) -> bool:
    """Does the mode alone allow the call, so that it is the kind that refuses?"""
    return any(mode in modes for modes in ORDER[function][:2])


def test_an_error_stays_until_a_reset_or_a_saved_state(calls):
    one = calls("stepping")
    saved = one.serialised()
    assert one.step(0.3, 0.01) == ERROR and one.said("the communication point is 0.3 s, but the FMU stands at 0 s")
    assert one.step(0.0, 0.01) == ERROR and one.set({FORCE: UP}) == ERROR
    assert one.restore(saved) == OK and one.step(0.0, 0.01) == OK
    assert one.do("EnterInitializationMode", False, 0.0, 0.0, False, 0.0) == ERROR
    assert one.do("Reset") == OK and one.start() == OK and one.step(0.0, 0.01) == OK


def test_the_experiment_comes_with_initialization(calls):
    one = calls("instantiated")
    assert one.do("EnterInitializationMode", False, 0.0, math.nan, False, 0.0) == DISCARD
    assert one.do("EnterInitializationMode", False, 0.0, 2.0, True, 1.0) == DISCARD and one.said("before the start time")
    assert one.do("EnterInitializationMode", True, 1e-4, 2.0, True, 2.02) == OK and one.said("looser than")
    assert one.get("time") == 2.0 and one.do("ExitInitializationMode") == OK
    assert one.get("solver.tolerance") < 1e-4
    assert one.step(2.0, 0.01) == OK and one.get("time") == one.reached == 2.01
    assert one.step(2.01, 0.02) == ERROR and one.said("would pass the stop time 2.02 s")


@pytest.mark.parametrize(
    "wrong, words",
    [
        ({"name": b""}, "the instance needs a name"),
        ({"name": b" \t"}, "the instance needs a name"),
        ({"name": None}, "the instance needs a name"),
        ({"token": b"{0}"}, "the instantiation token {0} is not that of this FMU"),
        ({"token": b""}, "instantiation token and resource path are needed"),
        ({"path": b""}, "instantiation token and resource path are needed"),
        ({"path": b"/nowhere/"}, "/nowhere/variables.bin cannot be read"),
        ({"kind": "ScheduledExecution"}, "co-simulation and for model exchange, nothing else"),
        ({"required": (10**6,)}, "no variable has the value reference 1000000"),
    ],
)
@pytest.mark.parametrize("logging", [True, False])
def test_instances_that_cannot_be(folder, wrong, words, logging):
    one = Calls3(folder, logging=logging, **wrong)
    assert one.component is None and one.said(words), one.messages
    assert Calls3(folder, logger=False, **wrong).component is None


def test_resources_are_found_by_path_and_not_by_uri(folder, tmp_path):
    odd = shutil.copytree(folder, tmp_path / "ü %41#1")
    for end in (b"/", b""):
        one = Calls3(odd, path=str(odd / "resources").encode() + end)
        assert one.component and one.start() == OK
        one.free()


def test_co_simulation_alone_has_no_model_exchange(planar):
    one = Calls3(planar, kind="ModelExchange")
    assert one.component is None and one.said("--kind me or both")


def test_functions_of_what_there_is_nothing_of_refuse(calls):
    one = calls("stepping")
    reference, value = (c_uint32 * 1)(0), (c_int8 * 64)()
    for kind in (*TYPES, "Binary", "Clock"):
        if kind in ("Float64", "Int32", "Int64"):
            continue
        for verb in ("Get", "Set"):
            rest = {"Binary": (None, value, 1), "Clock": (ctypes.cast(value, ctypes.POINTER(c_bool)),)}.get(kind, (value, 1))
            assert one.do(f"{verb}{kind}", reference, 1, *rest) == DISCARD
            assert one.said(f"fmi3{verb}{kind}", f"no {kind} variable")
            assert one.do(f"{verb}{kind}", None, 0, *[0 if isinstance(a, int) else None for a in rest]) == OK
    for name in ("IntervalDecimal", "IntervalFraction", "ShiftDecimal", "ShiftFraction"):
        for verb in ("Get", "Set"):
            rest = [None] * (len(ARGUMENTS[f"{verb}{name}"]) - 2)
            assert one.do(f"{verb}{name}", reference, 1, *rest) == DISCARD and one.said(name, "no Clock variable")
    size = c_size_t()
    for function, given in {
        "GetNumberOfVariableDependencies": (0, byref(size)),
        "GetVariableDependencies": (0, None, None, None, None, 0),
        "EnterConfigurationMode": (),
        "ExitConfigurationMode": (),
        "EvaluateDiscreteStates": (),
        "ActivateModelPartition": (0, 0.0),
    }.items():
        assert one.do(function, *given) == DISCARD and one.said(f"fmi3{function}")
    assert one.step(0.0, 0.01) == OK


def test_messages_come_where_they_are_asked_for(calls):
    quiet = calls("stepping", logging=False)
    assert quiet.set({"s1.damping": -1.0}) == DISCARD and not quiet.messages
    assert quiet.step(1.0, 0.01) == ERROR and [status for status, _, _ in quiet.messages] == [ERROR]
    quiet.do("Reset")
    names = (ctypes.c_char_p * 2)(b"logStatusDiscard", b"none #1")
    assert quiet.do("SetDebugLogging", True, 2, names) == OK + WARNING
    quiet.messages.clear()
    assert quiet.set({"s1.damping": -1.0}) == DISCARD and quiet.messages[0][:2] == (DISCARD, "logStatusDiscard")
    assert quiet.do("SetDebugLogging", True, 0, None) == OK
    assert quiet.do("SetDebugLogging", True, 1, (ctypes.c_char_p * 1)(b"none #1")) == WARNING and quiet.said("none ##1")
    assert quiet.do("SetDebugLogging", False, 0, None) == OK
    quiet.messages.clear()
    assert quiet.set({"s1.damping": -1.0}) == DISCARD and not quiet.messages
    assert quiet.do("SetDebugLogging", True, 1, None) == DISCARD


# Values


def test_arrays_are_set_and_read_whole(calls):
    one = calls("initialization")
    assert one.size(FORCE) == 3 and one.size("s1.nsh.Q") == 4 and one.size("gravity") == 1
    assert one.set({FORCE: [1.0, 2.0, 3.0], "s1.damping": 7.0, "s2.nsh.Q": [1.0, 2.0, 3.0, 4.0]}) == OK
    assert one.get("s2.nsh.Q", FORCE, "s1.damping").tolist() == [1.0, 2.0, 3.0, 4.0, 1.0, 2.0, 3.0, 7.0]
    given, reference = (c_double * 4)(5.0, 5.0, 5.0, 5.0), one.references([FORCE])
    for count in (0, 1, 2, 4):
        assert one.do("SetFloat64", reference, 1, given, count) == DISCARD
        assert one.said("fmi3SetFloat64", f"have 3 values, not {count}")
        assert one.do("GetFloat64", reference, 1, given, count) == DISCARD
    inner = (c_uint32 * 1)(reference[0] + 1)
    assert one.do("GetFloat64", inner, 1, given, 1) == DISCARD and one.said(
        f"no Float64 variable has the value reference {inner[0]}"
    )
    assert one.do("SetFloat64", inner, 1, given, 1) == DISCARD
    assert one.do("SetFloat64", reference, 1, None, 3) == one.do("GetFloat64", None, 1, given, 3) == DISCARD
    assert one.set({FORCE: [5.0, math.nan, 5.0]}) == DISCARD and one.said("n4.force[2] = nan refused, 2 kept")
    assert one.get(FORCE).tolist() == [1.0, 2.0, 3.0]
    assert one.set({"s2.nsh.Q": [1.0, 2.0, 3.0, -4.0]}) == DISCARD and one.said("s2.nsh.Q[4]")


def test_a_planar_scene_has_two_axes(planar, calls):
    one = calls("stepping", where=planar)
    assert one.size("n3.force") == one.size("n3.position") == 2
    before = one.get("n3.position")
    assert one.set({"n3.force": [0.0, 40.0]}) == OK and one.step(0.0, 0.05) == OK
    assert one.get("n3.position")[1] > before[1]


def test_types_are_told_apart(calls):
    one = calls("initialization")
    method, snapped = "solver.method", "s1.snapped"
    assert one.integer(method, "GetInt64") == one.integer(method) == 0
    assert one.integer(snapped, "GetInt64") == one.integer(snapped) == 0
    assert one.set({method: 2}) == OK and one.integer(method) == 2
    for value in (99, 2**40, -(2**63)):
        assert one.set({method: value}) == DISCARD and one.said(method)
    reference, number = one.references([method]), c_double()
    assert one.do("GetFloat64", reference, 1, byref(number), 1) == DISCARD and one.said("no Float64 variable")
    assert one.do("GetInt32", one.references(["n4.position"]), 1, byref(c_int32()), 1) == DISCARD
    assert one.do("SetInt64", one.references([snapped]), 1, byref(c_int64(1)), 1) == DISCARD and one.said("it is an output")
    assert one.integer(method, "GetInt64") == 2


def test_start_values_can_be_read_before_initialization(calls):
    one = calls("instantiated")
    length = one.get("s1.rest_length")[0]
    assert length > 0.0 and one.set({"s1.rest_length": 1.1 * length}) == OK
    assert one.get("s1.rest_length", "time").tolist() == [1.1 * length, 0.0]
    for name in ("n4.position", "der(b1.vector)", "s1.event_indicators"):
        values = (c_double * one.size(name))()
        assert one.do("GetFloat64", one.references([name]), 1, values, one.size(name)) == DISCARD


@pytest.mark.parametrize("name", ["three_bar_nsh", "two_bar"])
def test_the_same_calls_give_the_same_bits_as_in_fmi_2(name, tmp_path_factory, native_folders):
    new = Calls3(extracted(tmp_path_factory, name, standard="3.0"))
    old = Calls(native_folders[name])
    node = "n4" if name == "three_bar_nsh" else "n3"
    assert new.start(tolerance=1e-9) == old.start(tolerance=1e-9) == OK
    random = np.random.default_rng(3)
    for k in range(60):
        force, rate = random.normal(scale=60.0, size=new.size(f"{node}.force")), random.normal(scale=0.1)
        old_names = [n for n in old.names("input") if n.startswith(f"{node}.force")]
        rest = old.get("s1.length") * (1.0 if k % 7 else 0.98)
        assert old.set({**dict(zip(old_names, force)), "s1.rest_length": rest, "s1.rest_length_rate": rate}) == OK
        assert new.set({f"{node}.force": force, "s1.rest_length": rest, "s1.rest_length_rate": rate}) == OK
        assert new.step(0.01 * k, 0.01) == old.step(0.01 * k, 0.01) == OK and not new.early
        assert np.array_equal(new.outputs(), old.outputs())
    rates = old.output_derivatives(old.names("output"))[1]
    assert np.array_equal(new.output_derivatives(*new.names("output"))[1], rates)
    new.free(), old.free()


def test_functions_of_fmi_2_keep_their_hands_off_arrays(folder, calls):
    """A host that takes the wrong functions of the library is refused, not given what does not fit."""
    described = Calls3(folder)
    token = described.description.instantiationToken.encode()
    other = Calls.__new__(Calls)
    from tests.support import native_calls

    other.library, other.messages = native_calls.load(library_of(folder)), []
    other._logger = native_calls.LOGGER(lambda *given: other.messages.append((given[2], given[3].decode(), given[4].decode())))
    other._callbacks = native_calls.Callbacks(logger=other._logger)
    place = (folder / "resources").as_uri().encode()
    other.component = other.library.fmi2Instantiate(b"it", 1, token, place, byref(other._callbacks), 0, 1)
    assert other.component and other.do("EnterInitializationMode") == OK
    reference, value = described.references([FORCE]), (c_double * 1)()
    assert other.do("SetReal", reference, 1, value) == DISCARD and other.said("have 3 values, not 1")
    assert other.do("GetReal", reference, 1, value) == DISCARD
    assert other.do("ExitInitializationMode") == OK
    one = calls("stepping")
    assert one.restore(other.serialised()) == DISCARD and one.said("another FMI version")
    assert other.restore(one.serialised()) == DISCARD
    other.free(), described.free()


# Event Mode in co-simulation


def test_event_mode_is_there_for_hosts_that_ask(calls):
    one = calls("stepping")
    assert one.do("EnterEventMode") == ERROR and one.said("a host without Event Mode")
    one = calls("event", event_mode=True)
    assert one.step(0.0, 0.01) == ERROR and one.said("in Event Mode")


def test_inputs_that_jump_in_event_mode_are_there_at_once(calls, folder):
    """Outputs follow, the energy is booked once, and the run is that of a host without events."""
    one, plain = calls("event", event_mode=True), calls("stepping")
    assert one.do("EnterStepMode") == OK
    for k in range(40):
        assert one.step(0.01 * k, 0.01) == plain.step(0.01 * k, 0.01) == OK
        if k not in (4, 20, 27):
            continue
        rest = float(one.get("s1.length")[0]) - (0.06 if k == 20 else -0.02)
        given = {FORCE: UP, "s1.rest_length": rest, "s2.damping": 30.0 + k}
        before = one.get("energy.elastic", "energy.potential", "energy.input_work", "energy.dissipated")
        assert one.do("EnterEventMode") == OK and one.set(given) == plain.set(given) == OK
        assert np.array_equal(one.get("energy.elastic", "energy.potential")[:2], before[:2])
        assert one.update() == (OK, False)
        after = one.get("energy.elastic", "energy.potential", "energy.input_work", "energy.dissipated")
        assert after[0] != before[0]
        booked = after[0] - before[0] + after[3] - before[3]
        assert after[2] - before[2] == pytest.approx(booked, rel=1e-9) and abs(booked) > 1e-3
        assert one.update() == (OK, False) and one.do("EnterStepMode") == OK
        assert np.array_equal(one.get("energy.elastic", "energy.input_work"), after[[0, 2]])
        if k == 20:
            assert one.integer("s1.snapped") != plain.integer("s1.snapped")
        np.testing.assert_allclose(one.get("time"), 0.01 * (k + 1))
    np.testing.assert_allclose(one.outputs(), plain.outputs(), rtol=0.0, atol=1e-12)
    assert one.integer("s1.snapped") == plain.integer("s1.snapped")


def test_an_event_without_changes_changes_nothing(calls):
    one, plain = calls("event", event_mode=True), calls("stepping")
    assert one.update() == (OK, False) and one.do("EnterStepMode") == OK
    given = {FORCE: UP, "s1.rest_length_rate": -0.05}
    assert one.set(given) == plain.set(given) == OK
    for k in range(20):
        assert one.step(0.01 * k, 0.01) == plain.step(0.01 * k, 0.01) == OK
        one.do("EnterEventMode")
        assert one.update() == (OK, False) and one.do("EnterStepMode") == OK
        assert np.array_equal(one.outputs(), plain.outputs())


def test_an_event_leaves_a_moving_rest_length_where_it_is(calls):
    """Its value says where it was at the step's start; an event of something else must not take it back there."""
    one = calls("event", event_mode=True)
    one.do("EnterStepMode")
    start = one.get("s4.rest_length")[0]
    assert one.set({"s4.rest_length_rate": -0.5}) == OK and one.step(0.0, 0.02) == OK
    one.do("EnterEventMode")
    assert one.set({FORCE: UP}) == OK
    force = one.get("s4.elastic_force")
    assert one.update() == (OK, False)
    assert one.get("s4.elastic_force") == pytest.approx(force, rel=1e-12)
    assert one.get("s4.rest_length")[0] == pytest.approx(start - 0.01, rel=1e-14)
    assert one.update() == (OK, False) and one.get("s4.elastic_force") == pytest.approx(force, rel=1e-12)


def test_what_an_event_refuses_leaves_all_as_it_was(calls):
    one = calls("event", event_mode=True)
    one.do("EnterStepMode")
    assert one.step(0.0, 0.01) == OK
    one.do("EnterEventMode")
    before = one.outputs()
    assert one.set({"b1.mass": 3.0}) == DISCARD and one.set({"s1.damping": -1.0}) == DISCARD
    assert one.set({"gravity": 1.7e308, "s1.stiffness": 1e3}) == OK
    assert one.update()[0] == DISCARD and one.said("fmi3UpdateDiscreteStates")
    assert np.array_equal(one.outputs(), before)
    assert one.set({"gravity": 9.81, "s1.stiffness": 5000.0}) == OK
    assert one.update()[0] == OK and one.do("EnterStepMode") == OK and one.step(0.01, 0.01) == OK


def test_states_are_saved_in_event_mode(calls):
    one = calls("event", event_mode=True)
    assert one.set({FORCE: UP}) == OK
    saved, other = one.serialised(), calls("instantiated", event_mode=True)
    found = []
    for two in (one, other):
        assert two.restore(saved) == OK and two.update() == (OK, False) and two.do("EnterStepMode") == OK
        assert two.step(0.0, 0.1) == OK
        found.append(two.outputs())
    assert np.array_equal(*found)
    without = calls("instantiated")
    assert without.restore(saved) == DISCARD and without.said("Event Mode")
    assert without.restore(one.serialised()) == OK and np.array_equal(without.outputs(), found[0])


# Within steps


def driven(one: Calls3, end: float, h: float) -> tuple[np.ndarray, list[tuple[float, bool]]]:
    """Outputs at the end of a run under a force that makes strings go slack, and when steps ended, early or not."""
    time, times = 0.0, []
    assert one.set({FORCE: [0.0, 0.0, 400.0]}) == OK
    while time < end - 1e-9:
        assert one.step(time, min(h, end - time)) == OK, one.messages
        assert one.early == (one.reached < time + min(h, end - time) - 1e-12)
        assert one.reached > time
        time = one.reached
        times.append((time, one.early))
    return one.outputs(), times


def test_steps_end_early_at_transitions(calls):
    plain, early = calls("stepping"), calls("stepping", early_return=True)
    early.do("SetDebugLogging", True, 0, None)
    whole, times = driven(plain, 0.5, 0.1)
    found, earlier = driven(early, 0.5, 0.1)
    assert len(times) == 5 and len(earlier) > 20
    located = [float(re.search(r"at t = (\S+) s", text)[1]) for _, kind, text in early.messages if kind == "logEvents"]
    inner = [time for time, early in earlier if early]
    assert len(inner) > 20 and set(inner) <= set(located)
    np.testing.assert_allclose(found, whole, rtol=1e-6, atol=2e-7)


def test_what_moves_goes_on_after_an_early_return(calls):
    """A host that sets inputs at its own points in time only."""
    plain, early = calls("stepping"), calls("stepping", early_return=True)
    start, parts = plain.get("s4.rest_length")[0], 0
    for one in (plain, early):
        assert one.set({FORCE: [0.0, 0.0, 400.0], "s4.rest_length_rate": -0.4}) == OK
    for k in range(4):
        for one in (plain, early):
            assert one.set({"s4.rest_length": start - 0.04 * k}) == OK
            time = 0.1 * k
            while time < 0.1 * (k + 1) - 1e-9:
                assert one.step(time, 0.1 * (k + 1) - time) == OK
                time = one.reached
                parts += one.early
                if one.early:
                    assert one.get("s4.rest_length")[0] == pytest.approx(start - 0.4 * time, abs=1e-12)
        np.testing.assert_allclose(early.outputs(), plain.outputs(), rtol=1e-6, atol=2e-7)
    assert parts > 10


def test_a_host_looks_into_steps_and_changes_nothing(calls):
    seen, one = [], None

    def look(time, may_end):
        position, clock = one.get("n4.position"), one.get("time")[0]
        status, rates = one.output_derivatives("n4.position")
        assert status == OK and clock == time and not may_end
        seen.append((time, *position, *rates, *one.get("n4.velocity")))
        return True  # which the FMU need not heed

    plain, one = calls("stepping"), calls("stepping", look=look)
    outputs, times = driven(plain, 0.5, 0.1)
    found, same = driven(one, 0.5, 0.1)
    assert np.array_equal(found, outputs) and same == times
    seen = np.array(seen)
    assert len(seen) > 5 and np.all(np.diff(seen[:, 0]) >= 0.0) and seen[0, 0] > 0.0 and seen[-1, 0] < 0.5
    np.testing.assert_allclose(seen[:, 4:7], seen[:, 7:10], rtol=1e-9, atol=1e-9)


def test_every_output_can_be_read_within_a_step(calls, planar, folder):
    """Counts, too; in an FMU that has no states and in one that has."""
    for where in (planar, folder):
        seen, one = [], None

        def look(time, may_end):
            seen.append(one.outputs())  # noqa: B023
            return False

        one = calls("stepping", where=where, look=look)
        force = "n3.force" if where is planar else FORCE
        assert one.set({force: [0.0] * (one.size(force) - 1) + [400.0]}) == OK and one.step(0.0, 0.1) == OK
        rows = np.array([*seen, one.outputs()])
        assert len(seen) > 5 and np.all(np.isfinite(rows))
        snapped = rows[:, -len(one.names("output", "Int32")) :]
        assert snapped.max() > 0 and np.all(snapped[-1] >= snapped[0])


def test_a_host_ends_steps_where_it_likes(calls):
    whole, _ = driven(calls("stepping"), 0.5, 0.1)
    found, times = driven(calls("stepping", early_return=True, look=lambda time, may_end: may_end), 0.5, 0.1)
    assert len(times) > 8
    np.testing.assert_allclose(found, whole, rtol=1e-6, atol=2e-7)


def test_a_step_under_way_is_not_disturbed(calls):
    """Whatever else a host calls while it looks is refused; what must not be called at all ends the step with an error."""
    one, answers = None, []

    def look(time, may_end):
        answers.append(one.set({FORCE: UP}))
        answers.append(one.do("GetFMUState", byref(c_void_p())))
        answers.append(one.do("SetContinuousStates", (c_double * 20)(), 20))
        return False

    whole, _ = driven(calls("stepping"), 0.2, 0.1)
    one = calls("stepping", look=look)
    assert np.array_equal(driven(one, 0.2, 0.1)[0], whole)
    assert answers and set(answers) == {DISCARD} and one.said("while a step is under way")

    for wrong in ("DoStep", "Reset", "Terminate", "EnterInitializationMode"):
        one = None

        def disturb(time, may_end):
            assert one.do(wrong, *arguments(one, wrong)) == ERROR  # noqa: B023
            return False

        one = calls("stepping", look=disturb)
        saved = one.serialised()
        assert one.set({FORCE: [0.0, 0.0, 400.0]}) == OK and one.step(0.0, 0.2) == ERROR
        assert one.restore(saved) == OK and one.get("time") == 0.0
        one.look = lambda time, may_end: False
        assert np.array_equal(driven(one, 0.2, 0.1)[0], whole)

    one = None

    def free(time, may_end):
        one.library.fmi3FreeInstance(one.component)
        return False

    one = calls("stepping", look=free)
    assert one.set({FORCE: [0.0, 0.0, 400.0]}) == OK and one.step(0.0, 0.2) == ERROR and one.said("fmi3FreeInstance")


def test_null_pointers_of_a_step_are_refused_before_it(calls):
    one = calls("stepping")
    flags, time = [byref(c_bool()) for _ in range(3)], byref(c_double())
    for place in range(4):
        given = [*flags, time]
        given[place] = None
        assert one.do("DoStep", 0.0, 0.01, True, *given) == DISCARD
    assert one.step(0.0, 0.01) == OK


@pytest.mark.parametrize("h", [0.0, -0.01, math.nan, math.inf])
def test_steps_of_no_size_are_discarded(calls, h):
    one = calls("stepping")
    assert one.step(0.0, h) == DISCARD and one.reached == 0.0 and not one.early
    assert one.step(0.0, 0.01) == OK


# States


def test_a_run_goes_on_from_a_saved_state_to_the_last_bit(calls):
    one, other = calls("stepping"), calls("stepping")
    driven(one, 0.2, 0.01)
    saved = one.serialised()
    ends = []
    for two in (one, other):
        assert two.restore(saved) == OK and two.get("time")[0] == pytest.approx(0.2)
        for k in range(20, 40):
            assert two.step(0.01 * k, 0.01) == OK
        ends.append(two.outputs())
    assert np.array_equal(*ends)
    for wrong in (saved[:-1], saved + b"\0", b"", bytes([saved[0] ^ 1]) + saved[1:], saved[:-9] + b"\1" + saved[-8:]):
        assert one.restore(wrong) == DISCARD
    assert one.do("FreeFMUState", None) == OK
    exchange = calls("event", kind="ModelExchange")
    assert exchange.restore(saved) == DISCARD and exchange.said("the other kind")


def test_two_instances_share_nothing(calls, folder):
    one, two = calls("stepping"), calls("event", event_mode=True)
    alone = calls("stepping")
    two.do("EnterStepMode")
    assert one.set({FORCE: UP}) == alone.set({FORCE: UP}) == OK
    for k in range(30):
        assert alone.step(0.01 * k, 0.01) == OK
    alone = alone.outputs()
    for k in range(30):
        assert two.set({FORCE: [k, 0.0, -100.0]}) == OK
        assert one.step(0.01 * k, 0.01) == two.step(0.01 * k, 0.01) == OK
    assert np.array_equal(one.outputs(), alone) and not np.array_equal(two.outputs(), alone)


# Model exchange


def test_states_rates_and_indicators_are_variables(calls):
    one = calls("event", kind="ModelExchange")
    assert one.update() == (OK, False) and one.do("EnterContinuousTimeMode") == OK
    size = one.states_count
    status, x = one.vector("GetContinuousStates", size)
    assert status == OK and one.put(x + 1e-4 * np.arange(size)) == OK and one.do("SetTime", 0.25) == OK
    x, rates = one.vector("GetContinuousStates", size)[1], one.vector("GetContinuousStateDerivatives", size)[1]
    indicators = one.vector("GetEventIndicators", 12)[1]
    variables = {v.valueReference: v for v in one.description.modelVariables}
    derivatives = [variables[u.variable.valueReference] for u in one.description.derivatives]
    assert np.array_equal(one.get(*(v.name for v in derivatives)), rates)
    assert np.array_equal(one.get(*(v.derivative.name for v in derivatives)), x)
    assert np.array_equal(one.get(*(u.variable.name for u in one.description.eventIndicators)), indicators)
    assert len(indicators) == 12 and one.get("time") == 0.25
    assert one.vector("GetEventIndicators", 11)[0] == one.vector("GetContinuousStates", size - 1)[0] == DISCARD


@pytest.mark.parametrize("product", ["GetDirectionalDerivative", "GetAdjointDerivative"])
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_what_is_behind_the_table_is_named_where_it_is_refused(calls, kind, product):
    one = calls("initialization", kind=kind)
    seed, found, output = (c_double * 3)(), (c_double * 3)(), one.references(["n4.position"])
    for name, words in (
        ("s3.event_indicators", "no Float64 variable has the value reference"),
        ("n4.velocity", "by n4.velocity[1]"),
    ):
        known, count = one.references([name]), one.size(name)
        sizes = (count, 3) if "Directional" in product else (3, count)
        assert one.do(product, output, 1, known, 1, seed, sizes[0], found, sizes[1]) == DISCARD and one.said(words)


def test_single_states_can_be_set_while_the_host_integrates(calls):
    one = calls("continuous", kind="ModelExchange")
    x = one.vector("GetContinuousStates", one.states_count)[1]
    name = next(v.name for v in one.description.modelVariables if v.causality == "local" and one.size(v.name) == 3)
    moved = one.get(name) + [0.01, 0.0, 0.02]
    assert one.set({name: moved, FORCE: UP}) == OK
    now = one.vector("GetContinuousStates", one.states_count)[1]
    assert np.array_equal(one.get(name), moved) and np.sum(now != x) == 2
    assert one.set({name: [0.0, math.inf, 0.0], FORCE: [1.0, 1.0, 1.0]}) == DISCARD and one.get(FORCE).tolist() == UP
    assert one.set({"s1.damping": 3.0}) == DISCARD and one.said("changes in Event Mode")
    rate = next(v.name for v in one.description.modelVariables if v.name.startswith("der("))
    assert one.set({rate: np.zeros(one.size(rate))}) == DISCARD
    one.do("EnterEventMode")
    assert one.set({name: moved}) == DISCARD


def test_a_rest_length_that_jumps_snaps_in_event_mode(calls):
    one = calls("event", kind="ModelExchange")
    assert one.do("EnterContinuousTimeMode") == OK and one.do("EnterEventMode") == OK
    before = one.get("energy.elastic", "energy.input_work")
    assert one.set({"s1.rest_length": one.get("s1.length")[0] - 0.06}) == OK
    assert one.do("EnterEventMode") == OK  # no reason to forget the jump
    assert one.update() == (OK, True) and one.integer("s1.snapped") > 0
    work, stored = one.get("energy.input_work")[0] - before[1], one.get("energy.elastic")[0] - before[0]
    assert work == pytest.approx(stored, rel=1e-12) and work > 0.1
    assert one.update() == (OK, False)


def test_both_kinds_in_one_step_as_before_whoever_looks_at_states(calls, folder):
    """Looking at states, their derivatives and event indicators changes no bit, in Initialization Mode either."""
    one, plain = calls("initialization"), calls("initialization")
    locals_ = one.names("local")
    for k in range(30):
        if k == 0:
            one.get(*locals_)
            assert one.do("ExitInitializationMode") == plain.do("ExitInitializationMode") == OK
        given = {FORCE: [0.0, 0.0, 300.0 if k % 20 < 10 else -300.0], "s4.rest_length_rate": -0.01}
        assert one.set(given) == plain.set(given) == OK
        assert one.step(0.01 * k, 0.01) == plain.step(0.01 * k, 0.01) == OK
        values = one.get(*locals_)
        assert np.all(np.isfinite(values)) and np.array_equal(one.outputs(), plain.outputs())
    margins = one.get("s1.event_indicators")
    assert len(margins) == 2 and np.all(margins > -1e-9)
