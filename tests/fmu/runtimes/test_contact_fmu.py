"""FMUs of scenes on the ground, from outside: variables, results, messages, saved states; what does not know it refuses."""

import math

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu

from fmu_src.builds.options import Options
from fmu_src.builds.packs import pack
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu
from fmu_src.validation.scenarios import Scenario
from fmu_src.validation.validate import run_outside
from tensegrity_core.errors import InputError
from tensegrity_core.kernel import Kernel, simulate
from tensegrity_core.kernel.continuous import ContinuousView
from tensegrity_core.model import grid, held
from tensegrity_core.scene import parse_scene
from tensegrity_core.statics import build_model
from tests.support import same_outputs

PACKERS = {"python": pack_python_fmu, "native": pack_native_fmu}

#: A bar that spins and falls on a ground that moves, tied to a peg.
TIED = {
    "name": "tied",
    "start": "released",
    "fixed": ["n3"],
    "nodes": {"n1": [0.0, 0.0, 0.1], "n2": [1.0, 0.0, 0.15], "n3": [0.0, 1.0, 0.5]},
    "bars": {"b1": {"nodes": ["n1", "n2"], "mass": 1.0}},
    "strings": {"s1": {"nodes": ["n3", "n1"], "stiffness": 200.0, "damping": 2.0}},
    "prestress": {"rest_length": {"s1": 1.0}},
    "velocities": {"n1": [0.3, -1.0, 0.0], "n2": [0.3, 1.0, 0.0]},
    "ground": {"stiffness": 2e4, "damping": 0.2, "friction": 0.4, "moving": True},
}


@pytest.fixture(scope="module")
def model():
    return build_model(parse_scene(TIED))


@pytest.fixture(scope="module", params=PACKERS)
def fmu(request, model, tmp_path_factory):
    return PACKERS[request.param](model, tmp_path_factory.mktemp(request.param) / "tied.fmu")


def test_variables_of_the_ground(fmu):
    assert validate_fmu(str(fmu)) == []
    found = {v.name: v for v in read_model_description(str(fmu)).modelVariables}
    assert {"ground.height", "ground.velocity", "ground.acceleration"} <= {
        n for n, v in found.items() if v.causality == "input"
    }
    assert found["n1.contact.normal"].unit == found["n2.contact.friction.y"].unit == "N"
    assert (found["n2.contact.sticking"].type, found["n2.contact.sticking"].variability) == ("Integer", "discrete")
    assert {f"n1.contact.{x}" for x in ("stiffness", "damping", "tangential_stiffness", "friction_coefficient")} <= {
        n for n, v in found.items() if v.variability == "fixed"
    }
    assert "n3.contact.normal" not in found


def test_fmu_gives_what_the_kernel_gives(fmu, model):
    wave = held(model, grid(0.8, 0.01), ground=lambda t: (0.02 * math.sin(9.0 * t), 0.18 * math.cos(9.0 * t)))
    [(outputs, events, _)] = run_outside(fmu, model, runs=[Scenario("wave", "the ground moves", model, wave)])
    expected = simulate(model, wave)
    same_outputs(outputs, expected)
    assert [(t.contact, t.string, t.before, t.after) for t in events] == [
        (t.contact, t.string, t.before, t.after) for t in expected.transitions
    ]
    assert {t.kind for t in events} >= {"touch_down", "slip", "stick", "lift_off"}


def test_saved_state_has_the_bristles(fmu, tmp_path):
    """Restored while it slips and sticks, it goes on to the same numbers, and says by node what happened."""
    description, said = read_model_description(str(fmu)), []
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=extract(str(fmu), unzipdir=tmp_path / "tied"),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="tied",
    )
    slave.instantiate(loggingOn=True, callbacks=None)
    del said
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.exitInitializationMode()
    outputs = [v.valueReference for v in description.modelVariables if v.causality == "output" and v.type == "Real"]
    modes = [v.valueReference for v in description.modelVariables if v.name.endswith("contact.sticking")]
    seen, time = set(), 0.0
    for n in range(60):
        state = slave.getFMUState() if n % 6 == 0 else None
        slave.doStep(time, 0.01)
        once = slave.getReal(outputs), slave.getInteger(modes)
        if state is not None:
            slave.setFMUState(state)
            slave.freeFMUState(state)
            slave.doStep(time, 0.01)
            assert (slave.getReal(outputs), slave.getInteger(modes)) == once
        seen |= set(once[1])
        time = (n + 1) * 0.01
    slave.terminate()
    slave.freeInstance()
    assert seen == {0, 1} and np.isfinite(once[0]).all()


def test_model_exchange_refuses_the_ground_by_name(model, tmp_path):
    for kind in ("me", "both"):
        options = Options(scenes=("tied",), runtimes=("native",), kind=kind, output=tmp_path)
        with pytest.raises(
            InputError, match="tied: it stands on the ground, which model exchange does not know yet.*--kind cs"
        ):
            pack(model, "native", options)
    assert not list(tmp_path.rglob("*.fmu"))
    with pytest.raises(InputError, match="a host's own solver .* does not know the ground yet"):
        ContinuousView(Kernel(model))
