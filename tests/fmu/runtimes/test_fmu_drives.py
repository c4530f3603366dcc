"""FMUs of scenes with moved nodes, actuators, point masses, drag and a gravity vector, from outside."""

from ctypes import c_double, c_uint

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.validation import validate_fmu

from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu
from fmu_src.validation.scenarios import Scenario, scenarios
from fmu_src.validation.validate import run_outside
from fmu_src.variables.interface import variables
from tensegrity_core.kernel import simulate
from tensegrity_core.output.export import columns
from tests.kernel.test_kernel_drives import drive
from tests.support import same_outputs
from tests.support.driven_scenes import LABORATORY, MAST, built
from tests.support.native_calls import DISCARD

PACKERS = {"python": pack_python_fmu, "native": pack_native_fmu}


@pytest.fixture(scope="module", params=PACKERS)
def laboratory(request, tmp_path_factory):
    return PACKERS[request.param](built(LABORATORY), tmp_path_factory.mktemp(request.param) / "laboratory.fmu")


def test_variables_of_drives(laboratory):
    assert validate_fmu(str(laboratory)) == []
    found = {v.name: v for v in read_model_description(str(laboratory)).modelVariables}
    inputs = {"s4.current", "s4.actuator.load", "n1.position.x", "n7.velocity.z", "n1.acceleration.y"}
    assert inputs <= {n for n, v in found.items() if v.causality == "input"}
    assert found["s4.rest_length"].causality == found["s4.rest_length_rate"].causality == "output"
    assert found["s1.rest_length"].causality == "input"
    assert found["s4.actuator.speed"].unit == "rad/s" and found["s4.current"].unit == "A"
    assert {"gravity.x", "gravity.y", "gravity.z", "n5.drag"} <= {n for n, v in found.items() if v.variability == "tunable"}
    fixed = {"n4.mass", "s9.actuator.inertia", "s9.actuator.damping", "s9.actuator.torque_constant", "s9.actuator.radius"}
    assert fixed <= {n for n, v in found.items() if v.variability == "fixed"}
    assert float(found["s4.current"].start) == built(LABORATORY).current[0]


def test_fmu_gives_what_the_kernel_gives(laboratory):
    model = built(LABORATORY)
    scenario = Scenario("drive", "everything moves", model, drive(model))
    [(outputs, events, _)] = run_outside(laboratory, model, runs=[scenario])
    expected = simulate(model, scenario.inputs)
    same_outputs(outputs, expected)
    assert [(t.string, t.before, t.after) for t in events] == [(t.string, t.before, t.after) for t in expected.transitions]


def test_references_without_a_variable_cannot_be_set(native, tmp_path):
    """A string with an actuator has no input of its rest length; its place in the block of values stays reserved."""
    from zipfile import ZipFile

    model = built(MAST)
    with ZipFile(pack_native_fmu(model, tmp_path / "mast.fmu")) as archive:
        archive.extractall(tmp_path / "mast")
    table = variables(model)
    missing = sorted(set(range(len(table))) - {row.reference for row in table})
    assert missing
    for reference in missing:
        for function in ("GetReal", "SetReal"):
            fmu = native(tmp_path / "mast", "stepping")
            value = (c_double * 1)(3.0)
            assert fmu.do(function, (c_uint * 1)(reference), 1, value) == DISCARD
            assert fmu.said("no Real variable", str(reference))


def test_scenarios_drive_what_can_be_driven():
    model = built(LABORATORY)
    found = {run.name: run for run in scenarios(model, duration=1.0)}
    inputs = found["drives_1d"].inputs
    assert np.ptp(inputs.current, axis=0).min() > 0.0 and np.ptp(inputs.node_position, axis=0).min() > 0.0
    wound = list(model.actuated)
    assert np.ptp(found["rest_lengths_1d"].inputs.rest_length[:, wound], axis=0).max() == 0.0


def test_columns_of_a_file_are_the_fmus_outputs():
    model = built(LABORATORY)
    names = list(columns(model, simulate(model, drive(model, 0.04))))
    assert names[1:] == [row.name for row in variables(model) if row.causality == "output"]
