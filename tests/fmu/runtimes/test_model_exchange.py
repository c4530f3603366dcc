"""The native FMU for model exchange: fmpy's CVODE against the reference, the order of calls, what is refused, states.

More random calls than in the test: ``python -m tests.fmu.runtimes.test_model_exchange FOLDER_OF_AN_EXTRACTED_FMU 100000``.
"""

import math
import subprocess
import sys
import zipfile
from ctypes import byref, c_double, c_int
from pathlib import Path

import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu

from fmu_src.build import main
from fmu_src.builds import Options
from fmu_src.builds.judgement import files_of, hosted
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.validation import exchange, outside
from fmu_src.validation.compare import HOSTED_LEDGER_BOUND, compare
from fmu_src.validation.scenarios import scenarios
from fmu_src.validation.trials import trials
from fmu_src.validation.validate import reference_run, run_outside
from tensegrity_core import kernel, reference
from tensegrity_core.errors import InputError
from tensegrity_core.model import grid, held
from tensegrity_core.scene import builtin_scenes
from tests.conftest import once
from tests.support import push, scene
from tests.support.native_calls import DISCARD, ERROR, FATAL, MODEL_EXCHANGE, OK, Calls
from tests.support.words import words

CALLS = 3000


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The extracted FMU of both kinds of three_bar_nsh."""

    def make(folder):
        fmu = pack_native_fmu(scene("three_bar_nsh"), folder.with_suffix(".fmu"), kind="both")
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(folder)

    return once(tmp_path_factory, "exchange", make)


@pytest.fixture
def calls(folder):
    """calls(mode): an instance for model exchange."""
    made = []

    def make(mode="continuous", **arguments):
        made.append(Exchange(folder, **{"kind": MODEL_EXCHANGE} | arguments))
        made[-1].bring_to(mode)
        return made[-1]

    yield make
    for one in made:
        one.free()


MODES = ("instantiated", "initialization", "event", "continuous", "terminated", "error")


class Exchange(Calls):
    """An instance that a host integrates."""

    @property
    def size(self):
        return self.description.numberOfContinuousStates

    def bring_to(self, mode):
        if mode in ("event", "continuous"):
            assert self.start() == OK
            assert self.discrete()[0] == OK
            if mode == "continuous":
                assert self.do("EnterContinuousTimeMode") == OK
            self.messages.clear()
        else:
            super().bring_to(mode)

    def vector(self, function, size=None):
        """Status and numbers of a getter."""
        found = (c_double * (self.size if size is None else size))()
        return self.do(function, found, len(found)), np.array(found)

    def states(self):
        return self.vector("GetContinuousStates")[1]

    def put(self, x):
        return self.do("SetContinuousStates", (c_double * len(x))(*x), len(x))

    def discrete(self):
        """Status and whether states changed."""
        info = (c_double * 8)()
        status = self.do("NewDiscreteStates", info)
        return status, np.frombuffer(info, dtype=np.int32)[3]


# Against the reference


@pytest.mark.parametrize("name", builtin_scenes())
def test_fmpys_cvode_reaches_the_reference(name, tmp_path):
    """fmpy's own loop and solver, inputs that do not change."""
    model = scene(name)
    force = push(model)
    fmu = pack_native_fmu(model, tmp_path / "exchange.fmu", kind="me")
    start = {
        f"{model.node_names[node]}.force.{'xyz'[axis]}": force[node, axis] for node in model.free_nodes for axis in model.axes
    }
    times = grid(0.5, 0.025)  # fmpy's solver takes 500 steps between outputs at most
    found = simulate_fmu(
        str(fmu),
        fmi_type="ModelExchange",
        solver="CVode",
        relative_tolerance=1e-10,
        stop_time=0.5,
        output_interval=0.025,
        record_events=False,
        start_values=start,
    )
    right = reference.simulate(model, held(model, times, force=lambda t: force))
    for node, label in enumerate(model.node_names):
        for axis in model.axes:
            error = np.abs(found[f"{label}.{'xyz'[axis]}"] - right.position[:, node, axis])
            assert error.max() < 1e-7, (label, axis)


def test_a_host_that_gives_inputs_at_every_evaluation_reaches_all_outputs_of_the_reference(tmp_path):
    """Every input moves, strings go slack and snap: all outputs within the bounds of the validation, at the FMU's tolerance."""
    model = scene("three_bar_nsh")
    fmu = pack_native_fmu(model, tmp_path / "exchange.fmu", kind="me")
    drive = trials(model)[0]
    ((outputs, events, _),) = run_outside(fmu, model, runs=[drive], kind="me")
    right = reference_run(drive, None)
    longest = float(model.bar_length.max())
    judged = compare(right.result, outputs, events, right.spreads[1], longest, ledger_bound=HOSTED_LEDGER_BOUND)
    assert judged.failures == [] and judged.position < 1e-7
    assert judged.transitions[0] == judged.transitions[1] > 20
    lengths = np.linalg.norm(outputs["position"][:, model.bars[:, 1]] - outputs["position"][:, model.bars[:, 0]], axis=2)
    assert np.abs(lengths / model.bar_length - 1.0).max() < 1e-9


def test_impulses_of_dampers_at_slack_strings_stay_within_the_promise(tmp_path):
    """All strings of two_bar_nsh go slack under moving rest lengths: errors of the speeds there are what grows most."""
    model = scene("two_bar_nsh")
    moving = next(run for run in scenarios(model, 2.6) if run.name == "rest_lengths_1d")
    fmu = pack_native_fmu(model, tmp_path / "exchange.fmu", kind="me")
    ((outputs, events, _),) = run_outside(fmu, model, runs=[moving], kind="me")
    right = kernel.simulate(model, moving.inputs, tolerance=1e-12)
    assert np.abs(outputs["position"] - right.position).max() < 1e-7
    assert [(t.string, t.after) for t in events] == [(t.string, t.after) for t in right.transitions]


def test_a_structure_at_rest_takes_cvode_few_evaluations(tmp_path):
    """By the differences that CVODE itself takes they were 250 000 a second; and no event interrupts it."""
    model = scene("six_bar_nsh")
    fmu, folder = pack_native_fmu(model, tmp_path / "exchange.fmu", kind="me"), tmp_path / "extracted"
    one = exchange.Instance(read_model_description(str(fmu)), extract(str(fmu), str(folder)))
    inputs = outside.Inputs(one, [], np.array([0.0, 1.0]), np.zeros((1, 0)))
    one.start()
    exchange.event(one.fmu, inputs, 0.0)
    before = one.fmu.getReal([one.by_name["n10.z"].valueReference])
    solver = exchange.cvode(one, inputs, 0.0)
    assert solver.step(0.0, 1.0)[::2] == (False, 1.0)
    assert not one.fmu.completedIntegratorStep()[0]
    assert solver.evaluations < 300
    assert abs(one.fmu.getReal([one.by_name["n10.z"].valueReference])[0] - before[0]) < 1e-10
    one.close()


# How they are built


@pytest.mark.parametrize("kind", ["me", "both"])
def test_the_command_builds_a_kind_beside_co_simulation(kind, tmp_path):
    assert main(["two_bar", "--kind", kind, "--no-validate", "--no-page", "--output", str(tmp_path)]) == 0
    described = read_model_description(str(tmp_path / kind / "two_bar.fmu"))
    assert described.modelExchange is not None and (described.coSimulation is not None) == (kind == "both")
    assert described.numberOfContinuousStates == 10 and described.numberOfEventIndicators == 6


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"kind": "fmi3"}, "use cs, me, both"),
        ({"kind": "me", "runtimes": ("native", "python")}, "Python runtime has co-simulation only"),
        ({"kind": "both", "runtimes": ("native",), "simple": True, "validate": False}, "--simple-types"),
        ({"kind": "me", "runtimes": ("native",), "apart": True}, "--detach-actuators"),
    ],
)
def test_what_does_not_go_with_a_kind_is_named(options, word):
    with pytest.raises(InputError, match=word):
        Options(("two_bar",), **options)


def test_an_fmu_of_both_kinds_is_run_by_both_hosts():
    built = {("two_bar", "native"): Path("both/two_bar.fmu")}
    for fmi, more in (("2.0", ""), ("3.0", ", FMI 3.0")):
        rows = hosted(built, Options(("two_bar",), ("native",), fmi, "both"))
        told = [(name, row, kind) for name, row, kind, _ in rows]
        assert told == [("two_bar", f"both: cs{more}", "cs"), ("two_bar", f"both: me{more}", "me")]
        assert {files_of(one)[1].name for one in rows} == {"two_bar.html", "two_bar_me.html"}


# Order of calls

_E, _C, _I = ("event",), ("continuous",), ("initialization",)
LOOKING = (*_I, *_E, *_C, "terminated", "error")
#: Function -> modes in which it may be called, and what it answers elsewhere (but after an error: fmi2Error).
ORDER = {
    "EnterEventMode": ((*_E, *_C), ERROR),
    "NewDiscreteStates": (_E, ERROR),
    "EnterContinuousTimeMode": (_E, ERROR),
    "CompletedIntegratorStep": (_C, ERROR),
    "SetTime": ((*_E, *_C), DISCARD),
    "SetContinuousStates": (_C, DISCARD),
    "GetContinuousStates": (LOOKING, DISCARD),
    "GetDerivatives": (LOOKING, DISCARD),
    "GetEventIndicators": (LOOKING, DISCARD),
    "GetNominalsOfContinuousStates": (("instantiated", *LOOKING), DISCARD),
}


def arguments(one, function):
    x = (c_double * one.size)(*one.states()) if function == "SetContinuousStates" else (c_double * one.size)()
    indicators = one.description.numberOfEventIndicators
    return {
        "NewDiscreteStates": ((c_double * 8)(),),
        "CompletedIntegratorStep": (1, byref(c_int()), byref(c_int())),
        "SetTime": (0.0,),
        "GetEventIndicators": ((c_double * indicators)(), indicators),
    }.get(function, () if function.startswith("Enter") else (x, one.size))


@pytest.mark.parametrize("function", ORDER)
@pytest.mark.parametrize("mode", MODES)
def test_calls_in_and_out_of_order(calls, mode, function):
    modes, otherwise = ORDER[function]
    one = calls(mode)
    given = arguments(one, function)
    expected = OK if mode in modes else ERROR if mode == "error" else otherwise
    assert one.do(function, *given) == expected, one.messages
    if expected != OK:
        assert one.said(function)


@pytest.mark.parametrize("function", ["GetContinuousStates", "GetDerivatives", "GetEventIndicators"])
def test_co_simulation_has_no_calls_of_model_exchange(calls, function):
    one = calls("initialization", kind=1)
    assert one.do(function, *arguments(one, function)) == DISCARD and one.said("for co-simulation")
    one.do("ExitInitializationMode")
    assert one.step(0.0, 0.01) == OK
    assert one.do("EnterEventMode") == ERROR


def test_model_exchange_takes_no_steps(calls):
    one = calls("initialization")
    assert one.slopes({"n4.force.z": 1.0}) == DISCARD and one.said("for model exchange")
    one = calls("event")
    assert one.step(0.0, 0.01) == ERROR


# Values


def test_what_is_refused_changes_nothing(calls):
    one = calls("continuous")
    x, dx = one.states(), one.vector("GetDerivatives")[1]
    for wrong in (math.nan, math.inf):
        bad = x.copy()
        bad[2] = wrong
        assert one.put(bad) == DISCARD and one.do("SetTime", wrong) == DISCARD
    assert one.put(x[:-1]) == DISCARD and one.said("there are 20 of them, not 19")
    for function in ("GetContinuousStates", "GetDerivatives", "GetNominalsOfContinuousStates", "SetContinuousStates"):
        assert one.do(function, None, one.size) == DISCARD
        assert one.do(function, (c_double * 3)(), 3) == DISCARD
    assert one.do("GetEventIndicators", (c_double * 3)(), 3) == DISCARD
    assert one.do("CompletedIntegratorStep", 1, None, None) == DISCARD
    assert one.set({"s1.damping": 20.0}) == DISCARD and one.said("changes in Event Mode")
    assert one.set({"b1.mass": 2.0}) == DISCARD and one.said("fixed parameter")
    assert one.set({"der(b1.vector.x)": 2.0}) == DISCARD
    assert np.array_equal(one.states(), x) and np.array_equal(one.vector("GetDerivatives")[1], dx)
    assert one.set({"n4.force.z": 10.0}) == OK
    assert not np.array_equal(one.vector("GetDerivatives")[1], dx)
    assert one.do("EnterEventMode") == OK
    assert one.do("NewDiscreteStates", None) == DISCARD
    assert one.set({"s1.damping": 20.0, "gravity": 5.0}) == OK and one.discrete()[0] == OK


def test_outputs_states_and_derivatives_are_those_of_now(calls):
    one = calls("continuous")
    names = [v.name for v in one.description.modelVariables if v.causality == "local"]
    count = len(names)
    assert count == 2 * one.size - 2
    x = one.states() + 1e-3 * np.arange(one.size)
    assert one.do("SetTime", 0.5) == OK and one.put(x) == OK
    values = one.get(*names)
    assert np.array_equal(values[: one.size - 2], x[:-2])
    assert np.array_equal(values[one.size - 2 :], one.vector("GetDerivatives")[1])
    assert one.get("energy.dissipated", "energy.input_work") == list(x[-2:])
    before = one.get("n4.z")
    x[: (one.size - 2) // 2] += 0.01
    assert one.put(x) == OK and one.get("n4.z") != before


def test_states_are_set_by_reference_too(calls):
    """CasADi does so, with inputs in the same call, in FMI's order of variables; only while a host integrates."""
    one, other = calls("continuous"), calls("continuous")
    x = one.states() + 1e-3 * np.arange(one.size)
    names = [rate.variable.derivative.name for rate in one.description.derivatives]
    by_name = dict(zip(names, x)) | {"n4.force.z": 3.0}
    given = dict(sorted(by_name.items()))
    assert other.put(x) == OK and other.set({"n4.force.z": 3.0}) == OK
    assert one.set(given) == OK and np.array_equal(one.states(), x)
    assert np.array_equal(one.vector("GetDerivatives")[1], other.vector("GetDerivatives")[1])
    assert one.set(given | {names[3]: math.nan}) == DISCARD and one.said(names[3], "finite")
    assert one.set({"b1.vector.x": 1.0, "energy.kinetic": 5.0}) == DISCARD and one.said("energy.kinetic", "output")
    assert np.array_equal(one.states(), x)
    one.do("EnterEventMode")
    assert one.set({"b1.vector.x": 1.0}) == DISCARD and one.set({"energy.dissipated": 1.0}) == DISCARD


def test_states_before_the_first_event_are_the_start(calls):
    one = calls("initialization")
    assert one.get("b1.vector.x") == one.states()[0] and one.vector("GetEventIndicators", 12)[1].min() > 0.0
    assert one.set({"n4.force.z": 1e3}) == OK
    assert one.vector("GetDerivatives")[1].max() > 100.0


def test_a_rest_length_that_jumps_snaps_in_event_mode(calls):
    one = calls("event")
    before = one.get("energy.elastic"), one.get("energy.input_work")
    assert one.do("EnterEventMode") == OK
    assert one.set({"s1.rest_length": one.get("s1.length") - 0.06}) == OK
    assert one.do("EnterEventMode") == OK  # allowed there, and no reason to forget the jump
    assert one.discrete() == (OK, 1)
    assert one.integer("s1.snapped") > 0
    work = one.get("energy.input_work") - before[1]
    assert work == pytest.approx(one.get("energy.elastic") - before[0], rel=1e-12) and work > 0.1
    assert one.discrete() == (OK, 0)


def test_saved_states_hold_mode_time_and_pieces(calls, folder):
    one = calls("event")
    one.set({"s1.rest_length": one.get("s1.length") - 0.06})
    one.discrete()
    one.do("EnterContinuousTimeMode")
    one.do("SetTime", 0.7)
    saved, x, dx = one.serialised(), one.states(), one.vector("GetDerivatives")[1]
    one.put(x * 1.01)
    one.do("EnterEventMode")
    one.set({"s1.rest_length": 1.2})
    one.discrete()
    other = calls("instantiated")
    for two in (one, other):
        assert two.restore(saved) == OK
        assert np.array_equal(two.states(), x) and np.array_equal(two.vector("GetDerivatives")[1], dx)
        assert two.do("CompletedIntegratorStep", 1, byref(c_int()), byref(c_int())) == OK
        assert two.serialised() != b"" and two.put(x) == OK
    stepping = Calls(folder)
    stepping.start()
    assert stepping.restore(saved) == DISCARD and stepping.said("the other kind")
    assert one.restore(stepping.serialised()) == DISCARD
    stepping.free()


def test_both_kinds_in_one_step_as_co_simulation_alone(native, folder):
    """To the last bit, also where somebody reads states and derivatives between steps."""
    alone, one = native("three_bar_nsh"), Calls(folder)
    locals_ = one.names("local")
    shared = [name for name in alone.names("output") if name != "energy.throughput"]
    assert alone.start() == one.start() == OK
    for k in range(60):
        force = {"n4.force.z": 300.0 if k % 20 < 10 else -300.0}
        assert alone.set(force) == one.set(force) == OK
        assert alone.step(0.01 * k, 0.01) == one.step(0.01 * k, 0.01) == OK
        values = dict(zip(locals_, one.get(*locals_)))
        assert alone.get(*shared) == one.get(*shared)
        assert values["b1.vector.x"] == pytest.approx(one.get("n5.x") - one.get("n1.x"), abs=1e-12)
        status, rates = one.output_derivatives(["energy.kinetic", "energy.dissipated", "energy.input_work"])
        assert status == OK
        assert values["der(energy.dissipated)"] == pytest.approx(rates[1], rel=1e-5, abs=1e-6)
        assert values["der(energy.input_work)"] == pytest.approx(rates[2], rel=1e-9, abs=1e-9)
    one.free()


# Random calls


def random_calls(folder, count: int) -> dict[int, int]:
    """Calls in any order with values of any kind.  How often each status came; asserts that none was fmi2Fatal."""
    random, found = np.random.default_rng(5), dict.fromkeys(range(6), 0)
    wild = [0.0, 1.0, -1.0, 1e-300, 1e300, math.nan, math.inf, -math.inf]
    one = Exchange(folder, kind=MODEL_EXCHANGE, logger=False)
    inputs = one.names("input") + one.names("parameter")
    everything = [v.name for v in one.description.modelVariables if v.type == "Real"]
    saved = []

    def call():
        function = random.choice([*ORDER, "SetReal", "GetReal", "Save", "Restore", "Life"])
        if function == "Life":
            life = random.choice(["Reset", "Terminate", "EnterInitializationMode", "ExitInitializationMode", "Setup"])
            return one.do("SetupExperiment", 0, 0.0, 0.0, 0, 0.0) if life == "Setup" else one.do(life)
        if function == "SetReal":
            return one.set({str(random.choice(inputs)): float(random.choice([random.normal(), *wild]))})
        if function == "GetReal":
            value = c_double()
            return one.do("GetReal", one.references([str(random.choice(everything))]), 1, byref(value))
        if function == "Save":
            saved.append(one.serialised())
            return OK
        if function == "Restore":
            return one.restore(saved[random.integers(len(saved))]) if saved else OK
        if function == "SetTime":
            return one.do("SetTime", float(random.choice([random.random(), *wild])))
        if function == "SetContinuousStates":
            x = one.states() + random.normal(size=one.size) * random.choice([1e-6, 0.05, 1.0, 1e200])
            return one.put(x)
        return one.do(function, *arguments(one, function))

    for n in range(count):
        if n % 12 == 0:
            one.do("Reset")
            one.bring_to(str(random.choice(MODES[:4])))
        if len(saved) > 20:
            del saved[:10]
        found[call()] += 1
    one.free()
    assert found[FATAL] == 0
    return found


def test_random_calls(folder):
    """In a process of their own, so that a crash is a failure and not the end of pytest."""
    command = [sys.executable, "-m", "tests.fmu.runtimes.test_model_exchange", str(folder), str(CALLS)]
    root = Path(__file__).resolve().parents[3]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(int(word) > 100 for word in done.stdout.split()[:3])  # allowed, refused and wrong calls were among them


if __name__ == "__main__":
    folder_of_fmu, count = words(__doc__, Path, int)
    told = random_calls(folder_of_fmu.resolve(), count)
    print(told[OK], told[DISCARD], told[ERROR])
