"""The FMU behind fmpy's low-level calls: life cycle, values, states, refusals, several FMUs in one process."""

import ctypes
import importlib
import math
import subprocess
import sys

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from support import scene

from fmu_src.outside import Ports
from fmu_src.pack import pack_python_fmu
from tensegrity_core.kernel import Kernel

DISCARD = 2


def status(call, *arguments):
    """Status of a call that fmpy turns into an exception where it is worse than a warning."""
    try:
        call(*arguments)
    except FMICallException as error:
        return error.status
    return 0


def ports(instance):
    made = Ports(instance, [v.name for v in instance.description.modelVariables if v.causality == "input"])
    made.inputs[:] = [instance.get(v.name) for v in instance.description.modelVariables if v.causality == "input"]
    return made


def outputs(instance):
    made = ports(instance)
    made.get()
    return made.row()


def walk(instance, steps, h=0.01, start=0):
    """Steps of size h; returns the outputs after each."""
    made, rows = ports(instance), []
    for k in range(start, start + steps):
        instance.fmu.doStep(k * h, h)
        made.get()
        rows.append(made.row())
    return np.array(rows)


def said(instance, *words):
    """Whether a message holds all these words."""
    return any(all(word in text for word in words) for _, _, text in instance.messages)


# Life cycle


def test_follows_the_kernel_to_the_last_bit(instance):
    one, kernel = instance("three_bar_nsh"), Kernel(scene("three_bar_nsh"))
    kernel.initialize()
    one.set({"n4.force.z": 45.0, "n4.force.x": -3.0})
    kernel["force"][0], kernel["force"][2] = -3.0, 45.0
    for k in range(40):
        one.fmu.doStep(0.01 * k, 0.01)
        kernel.step(0.01)
    np.testing.assert_array_equal(outputs(one), np.concatenate((kernel.values[-63:], kernel["snapped"])))
    assert kernel["snapped"][0] >= 1


def test_outputs_follow_at_once_in_initialization_mode_only(instance):
    one = instance("three_bar", started=False)
    one.fmu.setupExperiment(startTime=0.0)
    one.fmu.enterInitializationMode()
    before = one.get("s1.force", "n1.reaction.z")
    one.set({"s1.rest_length": one.get("s1.rest_length") - 0.01})
    during = one.get("s1.force", "n1.reaction.z")
    assert during[0] == pytest.approx(before[0] + 50.0, rel=1e-9) and during[1] < before[1]
    one.fmu.exitInitializationMode()
    one.set({"s1.rest_length": one.get("s1.rest_length") + 0.01})
    assert one.get("s1.force", "n1.reaction.z") == during
    one.fmu.doStep(0.0, 1e-4)
    assert one.get("s1.force") < during[0]


def test_start_values_set_before_initialization_are_used(instance):
    one = instance("three_bar", parameters={"gravity": 0.0, "b2.mass": 2.0, "n4.force.z": 9.0})
    kernel = Kernel(scene("three_bar"))
    kernel["gravity"][0], kernel["bar_mass"][1], kernel["force"][2] = 0.0, 2.0, 9.0
    kernel.initialize()
    kernel.step(0.02)
    one.fmu.doStep(0.0, 0.02)
    np.testing.assert_array_equal(outputs(one), kernel.values[-len(outputs(one)) :])


def test_start_time_does_not_change_the_motion(instance):
    early, late = instance("three_bar_nsh"), instance("three_bar_nsh", start_time=12.5)
    for one in (early, late):
        one.set({"n5.force.z": 60.0})
    for k in range(50):
        early.fmu.doStep(k / 64, 1 / 64)
        late.fmu.doStep(12.5 + k / 64, 1 / 64)
    np.testing.assert_array_equal(outputs(early), outputs(late))


def test_wrong_times_and_steps_are_discarded(instance):
    one = instance("three_bar")
    one.set({"n4.force.z": 20.0})
    one.fmu.doStep(0.0, 0.01)
    before = outputs(one)
    nan, inf = math.nan, math.inf
    for time, h in ((0.02, 0.01), (0.0, 0.01), (0.01, -0.01), (0.01, 0.0), (0.01, nan), (nan, 0.01), (0.01, inf)):
        assert status(one.fmu.doStep, time, h) == DISCARD, (time, h)
        np.testing.assert_array_equal(outputs(one), before)
    assert said(one, "stands at t = 0.01 s") and said(one, "step size -0.01")
    one.fmu.doStep(0.01, 0.01)
    assert one.get("n4.z") > before[11]


def test_hosts_that_add_up_and_hosts_that_multiply(instance):
    adding, counting = instance("two_bar"), instance("two_bar")
    time = 0.0
    for k in range(1000):
        adding.fmu.doStep(time, 1e-3)
        counting.fmu.doStep(k * 1e-3, 1e-3)
        time += 1e-3
    assert time != 1.0
    np.testing.assert_allclose(outputs(adding), outputs(counting), atol=1e-12)


def test_stop_time_is_kept(instance):
    one = instance("two_bar", stopTime=0.03)
    for k in range(3):
        one.fmu.doStep(k * 0.01, 0.01)
    assert status(one.fmu.doStep, 0.03, 0.01) == DISCARD and said(one, "stop time 0.03")


def test_variable_steps_reach_the_same_place(instance):
    """The same held inputs over 0.3 s, in 30, 7 and 3 steps."""
    ends = []
    for steps in ((0.01,) * 30, (0.005, 0.1, 0.001, 0.05, 0.0441, 0.0499, 0.05), (0.2, 0.05, 0.05)):
        one = instance("three_bar_nsh", parameters={"solver.tolerance": 1e-12})
        one.set({"n4.force.z": 45.0, "n4.force.x": 10.0})
        time = 0.0
        for h in steps:
            one.fmu.doStep(time, h)
            time += h
        ends.append(np.array(one.get("n4.x", "n4.y", "n4.z", "n5.z", "n6.z")))
    np.testing.assert_allclose(ends[1:], [ends[0], ends[0]], atol=1e-10)


def test_reset_is_a_new_beginning(instance):
    one = instance("three_bar_nsh", parameters={"s1.damping": 50.0})
    one.set({"n4.force.z": 70.0})
    one.set({"n5.force.z": math.nan})
    first = outputs(one)
    assert status(one.fmu.doStep, 0.0, 0.01) == DISCARD
    one.fmu.reset()
    assert one.get("s1.damping") == 500.0 and one.get("n4.force.z") == 0.0
    one.start()
    one.fmu.doStep(0.0, 0.01)
    assert abs(one.get("n4.z") - scene("three_bar_nsh").nodes[3, 2]) < 1e-9
    assert one.get("b1.mass") == 1.0 and len(first) == len(outputs(one))


def test_after_terminate_only_reset_or_a_state_helps(instance):
    one = instance("two_bar")
    one.fmu.doStep(0.0, 0.01)
    saved = one.fmu.getFMUstate()
    one.fmu.terminate()
    assert status(one.fmu.doStep, 0.01, 0.01) == DISCARD and said(one, "fmi2Terminate")
    one.set({"n3.force.x": 4.0})
    assert one.get("n3.force.x") == 0.0 and said(one, "n3.force.x", "terminated")
    one.fmu.setFMUstate(saved)
    one.fmu.doStep(0.01, 0.01)
    one.fmu.freeFMUstate(saved)
    one.fmu.terminate()
    one.fmu.reset()
    one.start()
    one.fmu.doStep(0.0, 0.01)


# Values


@pytest.mark.parametrize(
    ("name", "bad"),
    [
        ("n4.force.z", math.nan),
        ("n4.force.z", math.inf),
        ("s2.rest_length", -0.1),
        ("s2.rest_length", -math.inf),
        ("s1.rest_length_rate", math.nan),
        ("s3.stiffness", -1.0),
        ("s3.damping", math.nan),
        ("gravity", math.inf),
    ],
)
def test_bad_values_are_refused_named_and_can_be_mended(name, bad, instance):
    one, other = instance("three_bar_nsh"), instance("three_bar_nsh")
    for k in range(3):
        one.fmu.doStep(k * 0.01, 0.01)
        other.fmu.doStep(k * 0.01, 0.01)
    good = one.get(name)
    assert status(one.set, {name: bad}) == 0  # pythonfmu cannot say more here; the step does
    assert said(one, name, repr(bad), "refused")
    assert one.get(name) == good
    before = outputs(one)
    for _ in range(2):
        assert status(one.fmu.doStep, 0.03, 0.01) == DISCARD
    assert said(one, "discarded", name)
    np.testing.assert_array_equal(outputs(one), before)
    one.set({name: good})
    np.testing.assert_array_equal(walk(one, 5, start=3), walk(other, 5, start=3))


def test_a_bad_value_among_good_ones(instance):
    one = instance("three_bar")
    names = ["n4.force.x", "n4.force.y", "n4.force.z"]
    one.fmu.setReal([one.by_name[name].valueReference for name in names], [1.0, math.nan, 3.0])
    assert one.get(*names) == [1.0, 0.0, 3.0]
    assert status(one.fmu.doStep, 0.0, 0.01) == DISCARD
    one.set({"n4.force.y": 2.0})
    one.fmu.doStep(0.0, 0.01)


def test_bad_start_values_can_be_mended(instance):
    one = instance("three_bar_nsh", started=False)
    one.fmu.setupExperiment(startTime=0.0)
    one.set({"s1.rest_length": math.nan, "s2.nsh.zeta[3]": 9.0, "b1.mass": 0.0, "solver.method": 7})
    one.fmu.enterInitializationMode()
    for name in ("s1.rest_length", "s2.nsh.zeta[3]", "b1.mass", "solver.method"):
        assert said(one, name, "refused"), name
    one.set({"s2.nsh.zeta[3]": 5.0, "b1.mass": 1.0, "solver.method": 0})
    one.fmu.exitInitializationMode()
    assert status(one.fmu.doStep, 0.0, 0.01) == DISCARD
    one.set({"s1.rest_length": scene("three_bar_nsh").rest_length[0]})
    one.fmu.doStep(0.0, 0.01)
    assert one.get("n4.z") == pytest.approx(scene("three_bar_nsh").nodes[3, 2], abs=1e-9)


def test_a_fixed_parameter_refused_before_the_start_is_mended_by_the_value_that_was_kept(instance):
    one = instance("three_bar", started=False)
    one.fmu.setupExperiment(startTime=0.0)
    one.fmu.enterInitializationMode()
    one.set({"b1.mass": -1.0})
    one.fmu.exitInitializationMode()
    assert status(one.fmu.doStep, 0.0, 0.01) == DISCARD
    one.set({"b1.mass": 1.0})
    one.fmu.doStep(0.0, 0.01)


def test_a_rest_length_that_would_turn_negative_names_the_string(instance):
    one = instance("three_bar")
    one.set({"s5.rest_length": 0.001, "s5.rest_length_rate": -1.0})
    assert status(one.fmu.doStep, 0.0, 0.01) == DISCARD
    assert said(one, "s5.rest_length", "negative")
    one.set({"s5.rest_length_rate": 0.0})
    one.fmu.doStep(0.0, 0.01)


def test_fixed_parameters_are_refused_after_initialization(instance):
    one = instance("three_bar_nsh")
    late = {"b1.mass": 2.0, "s1.nsh.Q[2]": 9.0, "solver.tolerance": 1e-6, "solver.method": 2, "n4.x": 0.0}
    for name, value in late.items():
        old = one.get(name)
        one.set({name: value})
        assert one.get(name) == old and said(one, name, "refused"), name
        assert status(one.fmu.doStep, 0.0, 0.01) == DISCARD
    one.set({"b1.mass": 1.0})  # what it is already
    one.fmu.doStep(0.0, 0.01)


@pytest.mark.parametrize("reference", [100_000, 2**32 - 1, 2**31])
def test_value_references_that_do_not_exist(reference, instance):
    one = instance("two_bar")
    assert math.isnan(one.fmu.getReal([reference])[0]) and said(one, "no Real variable")
    assert status(one.fmu.doStep, 0.0, 0.01) == DISCARD
    one.fmu.setReal([reference], [1.0])
    one.fmu.getInteger([reference])
    one.fmu.setBoolean([reference], [True])
    one.fmu.getString([reference])
    assert said(one, "no Integer variable") and said(one, "no Boolean") and said(one, "no String")
    assert status(one.fmu.doStep, 0.0, 0.01) == DISCARD
    one.fmu.doStep(0.0, 0.01)


def test_tunable_parameters_act_at_the_next_step(instance):
    one, kernel = instance("three_bar"), Kernel(scene("three_bar"))
    kernel.initialize()
    walk(one, 3)
    for _ in range(3):
        kernel.step(0.01)
    before = one.get("s4.force", "energy.elastic", "n4.z")
    one.set({"s4.stiffness": 9000.0, "gravity": 5.0, "s4.damping": 20.0})
    assert one.get("s4.force", "energy.elastic", "n4.z") == before
    kernel["stiffness"][3], kernel["gravity"][0], kernel["damping"][3] = 9000.0, 5.0, 20.0
    kernel.step(0.01)
    np.testing.assert_array_equal(walk(one, 1, start=3)[0], kernel.values[-63:])
    assert abs(one.get("s4.force") - before[0]) > 0.1


def test_tolerance_of_the_host_and_of_the_parameter(instance):
    default = instance("two_bar").get("solver.tolerance")
    assert instance("two_bar", tolerance=1e-12).get("solver.tolerance") == 1e-12
    loose = instance("two_bar", tolerance=1e-4)  # what hosts pass that nobody told a tolerance
    assert loose.get("solver.tolerance") == default == 1e-10
    assert said(loose, "tolerance 0.0001 is looser than 1e-10", "set solver.tolerance")
    assert instance("two_bar", tolerance=1e-6, parameters={"solver.tolerance": 1e-8}).get("solver.tolerance") == 1e-8
    early = instance("two_bar", started=False)
    early.set({"solver.tolerance": 1e-9})
    early.start(tolerance=1e-6)
    assert early.get("solver.tolerance") == 1e-9
    odd = instance("two_bar", tolerance=-3.0)
    assert odd.get("solver.tolerance") == default and said(odd, "tolerance -3.0", "ignored")
    odd.fmu.doStep(0.0, 0.01)


def test_transitions_are_logged(instance):
    one = instance("three_bar_nsh")
    one.set({"n4.force.z": 45.0})
    walk(one, 30)
    events = [text for _, category, text in one.messages if category == "logEvents"]
    assert events and events[0].startswith("string s2: piece 1 -> 0 at t = 0.0165")


# FMU states


def test_rollback_repeats_to_the_last_bit(instance):
    one = instance("three_bar_nsh")
    one.set({"n4.force.z": 60.0, "n5.force.x": 20.0, "s4.rest_length_rate": -0.05})
    walk(one, 17)
    one.set({"n6.force.z": math.nan})
    state = one.fmu.getFMUstate()
    one.set({"n6.force.z": 1.0})
    first = walk(one, 20, start=17)
    one.set({"gravity": 3.0, "s1.stiffness": 100.0})
    walk(one, 5, start=37)
    one.fmu.setFMUstate(state)
    assert one.get("gravity") == 9.81 and one.get("n6.force.z") == 0.0
    assert status(one.fmu.doStep, 0.17, 0.01) == DISCARD  # the refused value is part of the state
    one.set({"n6.force.z": 1.0})
    np.testing.assert_array_equal(walk(one, 20, start=17), first)
    one.fmu.freeFMUstate(state)


def test_serialised_states_go_from_instance_to_instance(instance):
    one, other = instance("six_bar_nsh"), instance("six_bar_nsh", started=False)
    one.set({"n4.force.z": 200.0})
    walk(one, 12)
    state = one.fmu.getFMUstate()
    data = one.fmu.serializeFMUstate(state)
    first = walk(one, 10, start=12)
    copy = other.fmu.deSerializeFMUstate(data)
    other.fmu.setFMUstate(copy)
    np.testing.assert_array_equal(walk(other, 10, start=12), first)
    one.fmu.freeFMUstate(state)
    other.fmu.freeFMUstate(copy)


def test_states_of_another_fmu_or_damaged_are_refused(instance):
    one, foreign = instance("three_bar_nsh"), instance("three_bar")
    walk(one, 3)
    state, strange = one.fmu.getFMUstate(), foreign.fmu.getFMUstate()
    data = one.fmu.serializeFMUstate(state)
    before = outputs(one)
    damaged = bytearray(data)
    damaged[len(data) // 2] ^= 1
    for bytes_, reason in (
        (foreign.fmu.serializeFMUstate(strange), "another FMU"),
        (bytes(damaged), "damaged"),
        (data[:20], "too short"),
        (b"x" * len(data), "no state"),
    ):
        bad = one.fmu.deSerializeFMUstate(bytes_)
        one.fmu.setFMUstate(bad)
        assert said(one, "state was refused", reason), reason
        assert status(one.fmu.doStep, 0.03, 0.01) == DISCARD
        np.testing.assert_array_equal(outputs(one), before)
        one.fmu.freeFMUstate(bad)
    one.fmu.doStep(0.03, 0.01)
    one.fmu.freeFMUstate(state)
    foreign.fmu.freeFMUstate(strange)


# Never fatal


def test_no_sequence_of_calls_is_worse_than_discard(instance):
    """Random calls, most of them out of order or with wrong values, then a reset and a clean run."""
    one = instance("two_bar_nsh", started=False)
    rng = np.random.default_rng(3)
    references = [v.valueReference for v in one.description.modelVariables] + [10**6]
    values = [0.0, 1.0, -1.0, math.nan, math.inf, 1e300, -1e-300, 3]
    states = []

    def save():
        states.append(one.fmu.getFMUstate())

    def pick(*choices):
        return float(rng.choice(choices))

    calls = [
        lambda: one.fmu.setReal([int(rng.choice(references))], [float(rng.choice(values))]),
        lambda: one.fmu.setInteger([int(rng.choice(references))], [int(rng.integers(-9, 9))]),
        lambda: one.fmu.getReal([int(i) for i in rng.choice(references, 3)]),
        lambda: one.fmu.getInteger([int(i) for i in rng.choice(references, 2)]),
        lambda: one.fmu.doStep(pick(0.0, 0.01, math.nan), pick(0.01, -1.0, math.inf, 1e-9)),
        one.fmu.enterInitializationMode,
        one.fmu.exitInitializationMode,
        one.fmu.terminate,
        lambda: one.fmu.setupExperiment(startTime=pick(0.0, math.nan), tolerance=pick(*values)),
        save,
        lambda: states and one.fmu.setFMUstate(states[int(rng.integers(len(states)))]),
    ]
    seen = set()
    for _ in range(1500):
        seen.add(status(calls[int(rng.integers(len(calls)))]))
    assert seen == {0, DISCARD}
    for state in states:
        one.fmu.freeFMUstate(state)
    one.fmu.reset()
    one.start()
    other = instance("two_bar_nsh")
    np.testing.assert_array_equal(walk(one, 5), walk(other, 5))


def test_steps_that_cannot_be_completed_leave_everything_as_it_was(instance):
    """A force that drives the structure to speeds at which no step can be taken is named, and can be taken back."""
    one = instance("three_bar_nsh")
    walk(one, 2)
    before, state = outputs(one), one.fmu.getFMUstate()
    one.set({"n4.force.z": 1e300})
    assert status(one.fmu.doStep, 0.02, 1.0) == DISCARD
    assert said(one, "discarded")
    np.testing.assert_array_equal(outputs(one), before)
    one.set({"n4.force.z": 0.0})
    first = walk(one, 3, start=2)
    one.fmu.setFMUstate(state)
    np.testing.assert_array_equal(walk(one, 3, start=2), first)
    one.fmu.freeFMUstate(state)


def test_messages_are_safe_as_formats(fmus, extracted):
    """The host hands a message to printf: a percent sign must be doubled."""
    _, folder = extracted(fmus["two_bar"])
    resources = f"{folder}/resources"
    sys.path.insert(0, resources)
    try:
        module = importlib.import_module(open(f"{resources}/slavemodule.txt").read())
    finally:
        if resources in sys.path:
            sys.path.remove(resources)
    slave = module.TensegritySlave(instance_name="one", resources=resources)
    slave._refuse("100 % of \udcff")
    assert [message.msg for message in slave._get_log_queue()] == ["100 %% of ?"]


# Several in one process


def test_two_instances_and_two_fmus_do_not_touch_each_other(instance):
    alone = {}
    for name in ("three_bar_nsh", "two_bar"):
        one = instance(name)
        one.set({"n4.force.z": 30.0})
        alone[name] = walk(one, 20)
    pushed, still, planar = instance("three_bar_nsh"), instance("three_bar_nsh"), instance("two_bar")
    pushed.set({"n4.force.z": 30.0})
    planar.set({"n4.force.z": 30.0})
    rows = {"pushed": [], "planar": []}
    for k in range(20):
        rows["pushed"].append(walk(pushed, 1, start=k)[0])
        walk(still, 1, start=k)
        rows["planar"].append(walk(planar, 1, start=k)[0])
    np.testing.assert_array_equal(rows["pushed"], alone["three_bar_nsh"])
    np.testing.assert_array_equal(rows["planar"], alone["two_bar"])
    assert still.get("n4.z") == pytest.approx(scene("three_bar_nsh").nodes[3, 2], abs=1e-9)


def other_version(monkeypatch, destination):
    """An FMU of two_bar as another version of this project would pack it: its gravity reads 1000 higher."""
    from fmu_src import pack

    original = pack._core_files

    def changed(library):
        files = original(library)
        files["python_runtime/slave.py"] += (
            b"\n\n_inner = TensegritySlave.get_real\n"
            b"TensegritySlave.get_real = lambda self, references: [v + 1000.0 for v in _inner(self, references)]\n"
        )
        return files

    monkeypatch.setattr(pack, "_core_files", changed)
    return pack_python_fmu(scene("two_bar"), destination)


@pytest.mark.parametrize("newer_first", [False, True])
def test_two_versions_in_one_process(newer_first, fmus, tmp_path, monkeypatch, instance):
    newer = other_version(monkeypatch, tmp_path / "newer.fmu")
    made = {fmu: instance(fmu) for fmu in ((newer, "two_bar") if newer_first else ("two_bar", newer))}
    for k in range(5):
        for one in made.values():
            one.fmu.doStep(k * 0.01, 0.01)
    old, new = made["two_bar"], made[newer]
    assert new.description.guid != old.description.guid
    assert old.get("gravity") == 9.81 and new.get("gravity") == 1009.81
    assert new.get("n3.z") - 1000.0 == pytest.approx(old.get("n3.z"), abs=1e-12)


def test_the_first_extraction_may_vanish(fmus, extracted, instance):
    """fmpy deletes an instance's files while another one, whose modules came from there, lives on."""
    import shutil

    from fmu_src.outside import Instance

    description, folder = extracted(fmus["two_bar_nsh"])
    first = Instance(description, folder)
    first.start()
    second = instance("two_bar_nsh")
    first.fmu.freeInstance()
    shutil.rmtree(folder)
    walk(second, 3)
    third = instance("two_bar_nsh")
    walk(third, 3)
    np.testing.assert_array_equal(outputs(second), outputs(third))


def test_process_ends_cleanly_after_many_instances(fmus):
    """pythonfmu's binary releases the slave module's namespace once too often per instance; see pack._MAIN."""
    program = (
        "import sys\n"
        "sys.path.insert(0, sys.argv[2])\n"
        "from fmpy import extract, read_model_description\n"
        "from fmu_src.outside import Instance\n"
        "description, folder = read_model_description(sys.argv[1]), extract(sys.argv[1])\n"
        "for i in range(40):\n"
        "    one = Instance(description, folder)\n"
        "    one.start()\n"
        "    one.fmu.doStep(0.0, 0.01)\n"
        "    one.fmu.reset()\n"
        "    one.fmu.freeInstance()\n"
        "print('done', one.fmu is not None, len([p for p in sys.path if 'resources' in p]))\n"
    )
    root = str(importlib.import_module("fmu_src").__path__[0]) + "/.."
    done = subprocess.run([sys.executable, "-c", program, str(fmus["two_bar"]), root], capture_output=True, text=True)
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, "done True 0", "")


def test_size_of_a_serialised_state(instance):
    """The size of a serialised state is what its bytes take, asked through the C interface."""
    one = instance("two_bar")
    state = one.fmu.getFMUstate()
    size = ctypes.c_size_t()
    one.fmu.fmi2SerializedFMUstateSize(one.fmu.component, state, ctypes.byref(size))
    assert size.value == len(one.fmu.serializeFMUstate(state)) > Kernel(scene("two_bar")).state_size
    one.fmu.freeFMUstate(state)


def test_integers_can_be_read_as_reals(instance):
    """Some importers read every output so."""
    one = instance("three_bar_nsh")
    references = [one.by_name[name].valueReference for name in ("n4.z", "s1.snapped", "solver.method")]
    assert one.fmu.getReal(references) == [one.get("n4.z"), 0.0, 0.0]
