"""modelDescription.xml against the variable table, the standard, and the kernel."""

import re
from dataclasses import replace

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.validation import validate_fmu

from fmu_src.packing.pack import pack_python_fmu
from fmu_src.variables.interface import variables
from tensegrity_core.fields import METHODS
from tensegrity_core.kernel import Kernel
from tensegrity_core.model.components import flat
from tensegrity_core.scene import builtin_scenes
from tests.support import scene
from tests.support.driven_scenes import LABORATORY, built

SCENES = builtin_scenes()


@pytest.mark.parametrize("name", SCENES)
def test_fmpy_finds_no_problems(name, fmus):
    assert validate_fmu(str(fmus[name])) == []


@pytest.mark.parametrize("name", SCENES)
def test_description_says_what_the_table_says(name, fmus):
    described = read_model_description(str(fmus[name])).modelVariables
    table = variables(scene(name))
    assert len(described) == len(table)
    for row, variable in zip(table, described):
        assert (variable.name, variable.valueReference, variable.type) == (row.name, row.reference, row.kind)
        assert (variable.causality, variable.variability) == (row.causality, row.variability)
        assert variable.unit == row.unit and variable.description == row.description
        assert (None if variable.start is None else float(variable.start)) == row.start
        for bound in ("min", "max", "nominal"):
            told = getattr(variable, bound)
            assert (None if told is None else float(told)) == getattr(row, bound)


#: The table of the design, counted for three_bar_nsh: 6 nodes (3 free), 3 bars, 6 strings, 3 NSH of 4 beams.
INTERFACE = r"""
    n[456]\.force\.[xyz]                                                 input     N      9
    s\d\.rest_length                                                     input     m      6
    s\d\.rest_length_rate                                                input     m/s    6
    n\d\.[xyz]                                                           output    m     18
    n[456]\.velocity\.[xyz]                                              output    m/s    9
    s\d\.force                                                           output    N      6
    s\d\.elastic_force                                                   output    N      6
    s\d\.length                                                          output    m      6
    b\d\.force                                                           output    N      3
    n[123]\.reaction\.[xyz]                                              output    N      9
    energy\.(kinetic|potential|elastic|dissipated|input_work|throughput) output    J      6
    s[123]\.snapped                                                      output    -      3
    s\d\.stiffness                                                       parameter N/m    6
    s\d\.damping                                                         parameter N.s/m  6
    gravity                                                              parameter m/s2   1
    b\d\.mass                                                            parameter kg     3
    s[123]\.nsh\.Q\[[1234]\]                                             parameter N     12
    s[123]\.nsh\.zeta\[[1234]\]                                          parameter 1     12
    s[123]\.nsh\.h\[[1234]\]                                             parameter m     12
    solver\.method                                                       parameter -      1
    solver\.tolerance                                                    parameter 1      1
    solver\.step                                                         parameter s      1
"""


def test_interface_of_a_structure():
    table = {row.name: row for row in variables(scene("three_bar_nsh"))}
    groups = [line.split() for line in INTERFACE.strip().splitlines()]
    for pattern, causality, unit, count in groups:
        found = [row for name, row in table.items() if re.fullmatch(pattern, name)]
        assert len(found) == int(count), pattern
        assert {(row.causality, row.unit or "-") for row in found} == {(causality, unit)}, pattern
    assert len(table) == sum(int(count) for *_, count in groups)
    tunable = {name for name, row in table.items() if row.variability == "tunable"}
    assert tunable == {f"s{i}.{what}" for i in range(1, 7) for what in ("stiffness", "damping")} | {"gravity"}


def test_start_values_and_places_are_the_kernels():
    model = scene("three_bar_nsh")
    kernel = Kernel(model)
    block = np.concatenate((kernel.values, kernel.integers))
    for row in variables(model):
        if row.causality != "output":
            assert block[row.reference] == row.start, row.name
    table = {row.name: row for row in variables(model)}
    assert table["s2.rest_length"].start == model.rest_length[1]
    assert table["s3.nsh.h[3]"].start == model.nsh[2].h[2] == 0.015
    kernel.initialize()
    assert kernel.values[table["n5.y"].reference] == pytest.approx(model.nodes[4, 1], abs=1e-15)
    assert kernel.values[table["s4.force"].reference] == kernel["string_force"][3]


def test_planar_scenes_have_two_axes():
    names = [row.name for row in variables(scene("two_bar"))]
    assert "n3.force.x" in names and "n3.force.z" in names and "n1.reaction.z" in names
    assert not [name for name in names if name.endswith(".y")]


def test_simple_strings_have_nothing_of_an_nsh():
    assert not [row.name for row in variables(scene("three_bar")) if "nsh" in row.name or "snapped" in row.name]
    with_nsh = {row.name.split(".")[0] for row in variables(scene("six_bar_nsh")) if "snapped" in row.name}
    model = scene("six_bar_nsh")
    assert with_nsh == {model.string_names[i] for i in model.nsh_strings}


def test_methods_are_an_enumeration(fmus):
    description = read_model_description(str(fmus["three_bar"]))
    method = next(v for v in description.modelVariables if v.name == "solver.method")
    assert method.type == "Enumeration" and method.variability == "fixed"
    assert [(item.name, int(item.value)) for item in method.declaredType.items] == [(name, i) for i, name in enumerate(METHODS)]


def test_flat_names(tmp_path):
    model = scene("two_bar_nsh")
    fmu = pack_python_fmu(model, tmp_path / "flat.fmu", naming="flat")
    assert validate_fmu(str(fmu)) == []
    description = read_model_description(str(fmu))
    assert description.variableNamingConvention == "flat"
    names = [v.name for v in description.modelVariables]
    assert {"n4_force_x", "s1_nsh_Q_1", "energy_kinetic", "solver_step"} <= set(names)
    assert all(re.fullmatch(r"\w+", name) for name in names)
    assert flat("s1.nsh.zeta[12]") == "s1_nsh_zeta_12"


def test_names_that_would_meet_are_refused():
    model = replace(scene("two_bar"), string_names=("n1", "s2", "s3"), bar_names=("s2", "b2"))
    with pytest.raises(ValueError, match="'s2.force'"):
        variables(model)


def test_capabilities(fmus):
    description = read_model_description(str(fmus["six_bar_nsh"]))
    slave = description.coSimulation
    assert not slave.needsExecutionTool and not slave.canBeInstantiatedOnlyOncePerProcess
    assert slave.canHandleVariableCommunicationStepSize and slave.canGetAndSetFMUstate and slave.canSerializeFMUstate
    assert slave.canInterpolateInputs and description.modelExchange is None
    assert description.generationDateAndTime is None
    assert description.defaultExperiment.stepSize is not None


def test_steps_give_outputs_without_direct_dependencies(fmus):
    for unknown in read_model_description(str(fmus["three_bar_nsh"])).outputs:
        assert unknown.dependencies == []


@pytest.mark.parametrize("name", ["two_bar_nsh", "three_bar_nsh", "six_bar"])
def test_dependencies_at_the_start_are_those_of_the_kernel(name, fmus):
    """Each known is perturbed at random starts: what moves is declared, and what is declared moves."""
    _require_true_dependencies(scene(name), fmus[name])


def test_dependencies_at_the_start_of_a_driven_scene(tmp_path):
    model = built(LABORATORY)
    fmu = pack_python_fmu(model, tmp_path / "laboratory.fmu")
    assert validate_fmu(str(fmu)) == []
    _require_true_dependencies(model, fmu)


def _require_true_dependencies(model, fmu):
    table = variables(model)
    described = read_model_description(str(fmu)).initialUnknowns
    declared = {u.variable.valueReference: {v.valueReference for v in u.dependencies} for u in described}
    assert len(declared) == sum(row.causality == "output" for row in table)
    observed = {reference: set() for reference in declared}
    for bottomed_out in (False, True):
        _observe(model, bottomed_out, observed)
    names = {row.reference: row.name for row in table}
    for row in table:
        if row.causality != "output":
            continue
        seen, told = observed[row.reference], declared[row.reference]
        # A count of snapped beams changes at the snaps only, which a small change need not reach.
        wrong = seen - told if row.kind == "Integer" else seen ^ told
        assert not wrong, f"{row.name}: {[names[reference] for reference in wrong]}"


def _observe(model, bottomed_out, observed):
    """Add to `observed` which knowns move which outputs at a random start with every string taut."""
    table, rng = variables(model), np.random.default_rng(bottomed_out)
    kernel = Kernel(model)
    for i, nsh in enumerate(model.nsh):
        kernel["rest_length"][i] -= 2.1 * sum(nsh.h) if nsh and bottomed_out else rng.uniform(0.005, 0.03)
    kernel["force"][:] = rng.normal(size=len(kernel["force"]))
    kernel["rest_length_rate"][:] = -rng.random(len(model.strings))
    for name in ("node_velocity", "node_acceleration"):
        kernel[name][:] = 0.1 * rng.normal(size=len(kernel[name]))
    of_the_method = ("tolerance", "max_step", "method")
    knowns = [row for row in table if row.causality != "output" and row.field not in of_the_method]
    base = _outputs(kernel)
    for row in knowns:
        before = kernel.values[row.reference]
        kernel.values[row.reference] = before + (1e-3 if abs(before) < 1.0 else 1e-3 * abs(before))
        moved = np.abs(_outputs(kernel) - base) > 1e-11 * np.maximum(1.0, np.abs(base))  # more than round-off
        for reference in np.flatnonzero(moved):
            if reference in observed:
                observed[reference].add(row.reference)
        kernel.values[row.reference] = before


def _outputs(kernel):
    kernel.initialize()
    return np.concatenate((kernel.values, kernel.integers)).copy()
