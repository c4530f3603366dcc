"""General force laws, dampers and honeycombs with memory: the kernel, the reference and both FMUs give the same."""

import numpy as np
import pytest
from fmpy.validation import validate_fmu

from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu
from fmu_src.validation.scenarios import Scenario
from fmu_src.validation.validate import run_outside
from fmu_src.variables.interface import variables
from tensegrity_core import reference
from tensegrity_core.kernel import simulate
from tests.support import same_outputs
from tests.support.element_scenes import STRINGS, mast, swaying

PACKERS = {"python": pack_python_fmu, "native": pack_native_fmu}
MEMORY = [name for name in STRINGS if mast(name).memories]


def kinds(transitions):
    return [(t.string, t.before, t.after) for t in transitions]


@pytest.mark.parametrize("law", ["literal", "tension_only"])
@pytest.mark.parametrize("name", STRINGS)
def test_kernel_agrees_with_the_reference(name, law):
    model = mast(name, damping_law=law)
    inputs = swaying(model)
    expected, found = reference.simulate(model, inputs), simulate(model, inputs)
    np.testing.assert_allclose(found.position, expected.position, atol=1e-9)
    np.testing.assert_allclose(found.velocity, expected.velocity, atol=1e-6)
    np.testing.assert_allclose(found.string_force, expected.string_force, atol=1e-4)
    np.testing.assert_allclose(found.elastic_force, expected.elastic_force, atol=1e-4)
    for energy in ("kinetic", "potential", "elastic", "dissipated", "input_work"):
        np.testing.assert_allclose(getattr(found, energy), getattr(expected, energy), atol=1e-7, err_msg=energy)
    np.testing.assert_array_equal(found.snapped, expected.snapped)
    assert kinds(found.transitions) == kinds(expected.transitions)
    for what in ("time", "loss"):
        pair = [[getattr(t, what) for t in run.transitions] for run in (expected, found)]
        np.testing.assert_allclose(*pair, atol=1e-7, err_msg=what)


@pytest.mark.parametrize("name", STRINGS)
def test_ledger_closes(name):
    """Without memory nothing is lost beside the dampers; with it, what the recorded snaps lose."""
    model = mast(name)
    result = simulate(model, swaying(model), tolerance=1e-11)
    assert result.ledger_error() < 1e-9
    losses = sum(t.loss for t in result.transitions)
    assert (losses > 0.0) == (name in MEMORY)


@pytest.mark.parametrize("name", MEMORY)
def test_without_damper_all_loss_is_that_of_snaps(name):
    model = mast(name, materials={"cable": {"stiffness": 2000.0, "damping": 0.0}})
    inputs = swaying(model)
    result = simulate(model, inputs, tolerance=1e-11)
    through = max(1.0, result.throughput[-1])
    assert abs(result.dissipated[-1] - sum(t.loss for t in result.transitions)) < 1e-8 * through
    assert result.ledger_error() < 1e-8


@pytest.mark.parametrize("name", ["nested", "memory", "valve", "cells"])
@pytest.mark.parametrize("runtime", PACKERS)
def test_fmus_give_what_the_kernel_gives(runtime, name, tmp_path):
    model = mast(name)
    fmu = PACKERS[runtime](model, tmp_path / "mast.fmu")
    assert validate_fmu(str(fmu)) == []
    scenario = Scenario("sway", "swaying", model, swaying(model))
    [(outputs, events, _)] = run_outside(fmu, model, runs=[scenario])
    expected = simulate(model, scenario.inputs)
    same_outputs(outputs, expected)
    assert kinds(events) == kinds(expected.transitions)


def test_stiffness_that_shapes_a_curve_is_a_fixed_parameter():
    rows = {row.name: row for row in variables(mast("memory"))}
    assert rows["s1.stiffness"].variability == "fixed" and rows["s2.stiffness"].variability == "tunable"
    assert rows["s1.nsh.zeta[1]"].max is None
    assert {row.name: row for row in variables(mast("snap"))}["s1.stiffness"].variability == "tunable"


def test_stiffness_that_nothing_uses_is_no_variable():
    names = {row.name for row in variables(mast("hardening"))}
    assert "s1.stiffness" not in names and "s2.stiffness" in names
    assert "s1.stiffness" in {row.name for row in variables(mast("kinked", elements=ENDING))}


ENDING = {"kinked": {"kind": "series", "parts": ["one", "one"]}, "one": {"kind": "beam", "Q": 6.0, "zeta": 5.0, "h": 0.015}}
