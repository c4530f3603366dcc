"""FMUs of a scene whose strings run over nodes, have mass or push, from outside: against the kernel and the reference."""

from dataclasses import replace
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.validation import validate_fmu

from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu
from fmu_src.validation.outside import Instance
from fmu_src.validation.scenarios import Scenario
from fmu_src.validation.trials import trials
from fmu_src.validation.validate import run_outside
from fmu_src.variables.terminals import PATH
from tensegrity_core import reference
from tensegrity_core.kernel import simulate
from tensegrity_core.model import grid, held
from tests.kernel.test_rigged import drive
from tests.support import by_hand, same_outputs
from tests.support.driven_scenes import built
from tests.support.rigged_scenes import RIGGED

PACKERS = {"python": pack_python_fmu, "native": pack_native_fmu}


@pytest.fixture(scope="module", params=PACKERS)
def fmu(request, tmp_path_factory):
    return PACKERS[request.param](built(RIGGED), tmp_path_factory.mktemp(request.param) / "rigged.fmu")


def test_variables_and_terminals(fmu):
    """A routed string is one string: one rest length, one length, one terminal; its mass is a fixed parameter."""
    assert validate_fmu(str(fmu)) == []
    found = {v.name: v for v in read_model_description(str(fmu)).modelVariables}
    masses = {name: float(found[name].start) for name in found if name.startswith("s") and name.endswith(".mass")}
    assert masses == {"s3.mass": 0.15, "s11.mass": 0.2, "s15.mass": 0.1}
    assert all(found[name].variability == "fixed" and found[name].unit == "kg" for name in masses)
    assert found["s11.rest_length"].causality == "input" and found["s13.rest_length"].causality == "output"
    assert {"s11.length", "s11.force", "s12.snapped", "s13.current", "s14.force"} <= found.keys()
    with ZipFile(fmu) as archive:
        documents = [archive.read(name) for name in archive.namelist() if name == PATH]
    assert len(documents) == (fmu.parent.name.startswith("native"))  # Python FMUs have none
    for document in documents:
        terminals = ElementTree.fromstring(document).findall("Terminals/Terminal")
        assert sum(terminal.get("name") == "s11" for terminal in terminals) == 1


def test_fmu_gives_what_kernel_and_reference_give(fmu):
    model = built(RIGGED)
    scenario = Scenario("drive", "everything moves", model, drive(model, 0.4))
    [(outputs, events, _)] = run_outside(fmu, model, runs=[scenario])
    expected = simulate(model, scenario.inputs)
    same_outputs(outputs, expected)
    assert [(t.string, t.before, t.after) for t in events] == [(t.string, t.before, t.after) for t in expected.transitions]
    exact = reference.simulate(model, scenario.inputs)
    np.testing.assert_allclose(outputs["position"], exact.position, rtol=0, atol=1e-7)
    scale = 1e-3 + 1e-6 * np.abs(exact.string_force).max()
    np.testing.assert_allclose(outputs["string_force"], exact.string_force, rtol=0, atol=scale)


def test_a_string_s_mass_can_be_set_before_the_start(fmu, tmp_path):
    model, times = built(RIGGED), grid(0.1, 0.02)
    heavy = replace(model, string_mass=np.where(model.string_mass == 0.2, 0.9, model.string_mass))
    light, expected = (simulate(one, held(one, times)).position[-1] for one in (model, heavy))
    instance = Instance(read_model_description(str(fmu)), extract(str(fmu), unzipdir=str(tmp_path)), logging=True)
    instance.start(parameters={"s11.mass": 0.9})
    for k in range(5):
        instance.fmu.doStep(times[k], 0.02)
    found = [instance.get(f"{node}.{axis}") for node in model.node_names for axis in "xyz"]
    instance.close()
    np.testing.assert_array_equal(found, expected.ravel())
    assert np.abs(light - expected).max() > 1e-4


def test_validation_drives_a_spring_that_pushes():
    """It has no slack piece, and no end to be driven past."""
    pushing = by_hand(
        [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        [0],
        [],
        [(0, 1)],
        point_mass=((1, 1.0),),
        stiffness=400.0,
        damping=2.0,
        rest_length=1.0,
        two_way=(True,),
    )
    [driven, *_] = trials(pushing)
    result = simulate(pushing, driven.inputs)
    assert np.ptp(driven.inputs.rest_length) > 0.0 and result.elastic_force.min() < 0.0 < result.elastic_force.max()
