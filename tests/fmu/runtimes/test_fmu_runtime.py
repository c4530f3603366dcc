"""The Python FMU behind fmpy's low-level calls: runs, values, several FMUs and versions in one process.  What both runtimes
have in common is tested in test_native_fmu.py."""

import ctypes
import importlib
import subprocess
import sys

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from fmu_src.packing.pack import pack_python_fmu
from fmu_src.validation.outside import Ports
from tensegrity_core.kernel import Kernel
from tests.support import scene

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


def test_start_values_set_before_initialization_are_used(instance):
    one = instance("three_bar", parameters={"gravity": 0.0, "b2.mass": 2.0, "n4.force.z": 9.0})
    kernel = Kernel(scene("three_bar"))
    kernel["gravity"][0], kernel["bar_mass"][1], kernel["force"][2] = 0.0, 2.0, 9.0
    kernel.initialize()
    kernel.step(0.02)
    one.fmu.doStep(0.0, 0.02)
    np.testing.assert_array_equal(outputs(one), kernel.values[-len(outputs(one)) :])


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


# Values


def test_a_rest_length_that_would_turn_negative_names_the_string(instance):
    one = instance("three_bar")
    one.set({"s5.rest_length": 0.001, "s5.rest_length_rate": -1.0})
    assert status(one.fmu.doStep, 0.0, 0.01) == DISCARD
    assert said(one, "s5.rest_length", "negative")
    one.set({"s5.rest_length_rate": 0.0})
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


def test_transitions_are_logged(instance):
    one = instance("three_bar_nsh")
    one.set({"n4.force.z": 45.0})
    walk(one, 30)
    events = [text for _, category, text in one.messages if category == "logEvents"]
    assert events and events[0].startswith("string s2: piece 1 -> 0 at t = 0.0165")


# FMU states


# Never fatal


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
    from fmu_src.packing import pack

    original = pack.core_files

    def changed(library):
        files = original(library)
        files["python_runtime/slave.py"] += (
            b"\n\n_inner = TensegritySlave.get_real\n"
            b"TensegritySlave.get_real = lambda self, references: [v + 1000.0 for v in _inner(self, references)]\n"
        )
        return files

    monkeypatch.setattr(pack, "core_files", changed)
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

    from fmu_src.validation.outside import Instance

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
    """Nothing is left on sys.path, nothing is freed once too often."""
    program = (
        "import sys\n"
        "sys.path.insert(0, sys.argv[2])\n"
        "from fmpy import extract, read_model_description\n"
        "from fmu_src.validation.outside import Instance\n"
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
