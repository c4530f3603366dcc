"""Every XML file of every kind of FMU against FMI's schemas and the rules that schemas cannot state.

The schemas are those that fmpy brings; the rules, those by which fmpy's validation and VDMCheck2 judge.  Every kind there is:
``python -m tests.fmu.variables.test_fmu_schemas``.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu
from lxml import etree

from fmu_src.packing.actuator import detached
from fmu_src.packing.libraries import here, host_library
from fmu_src.packing.native_fmu import Contents, native_fmu_files
from fmu_src.packing.pack import CORE, python_fmu_files
from fmu_src.variables.interface import RATES, variables
from fmu_src.variables.states import RATES_OF
from fmu_src.variables.units import UNITS, require_known
from tensegrity_core.fields import FIELDS
from tensegrity_core.kernel import LIBRARY, Kernel
from tensegrity_core.model import Model
from tensegrity_core.scene import builtin_scenes
from tests.support import driven_scenes, element_scenes, scene

SCHEMAS = {
    "modelDescription.xml": "fmi2/fmi2ModelDescription.xsd",
    "terminalsAndIcons/terminalsAndIcons.xml": "fmi3/fmi3TerminalsAndIcons.xsd",
    "sources/buildDescription.xml": "fmi3/fmi3BuildDescription.xsd",
}

DRIVEN = {name: getattr(driven_scenes, name) for name in ("PENDULUM", "AFLOAT", "MAST", "LABORATORY")}

#: What an FMU may be asked to be: runtime, naming, simple types, sources.
KINDS = [
    *(
        (runtime, naming, simple, False)
        for runtime in ("native", "python")
        for naming in ("structured", "flat")
        for simple in (False, True)
    ),
    ("native", "structured", False, True),
    *(("native", naming, False, True, kind) for naming in ("structured", "flat") for kind in ("me", "both")),
]


@cache
def schema(name: str) -> etree.XMLSchema:
    return etree.XMLSchema(etree.parse(str(Path(fmpy.__file__).parent / "schema" / SCHEMAS[name])))


def models() -> Iterator[Model]:
    """The built-in scenes, scenes with drives, with every element, and detached actuators with what they leave behind."""
    yield from map(scene, builtin_scenes())
    for found in map(driven_scenes.built, DRIVEN.values()):
        yield found
        bare, actuators = detached(found)
        yield from ([bare, *actuators.values()] if actuators else [])
    yield from map(element_scenes.mast, element_scenes.STRINGS)


def files_of(model: Model, runtime: str, naming: str, simple: bool, sources: bool, kind: str = "cs") -> dict[str, bytes]:
    if runtime == "python":
        kernel = {here(): CORE / "native" / LIBRARY}
        return python_fmu_files(model, naming, {here(): host_library("python")}, kernel, simple)
    return native_fmu_files(model, Contents(naming, sources=sources, simple=simple, kind=kind), {here(): host_library()})


def problems(files: dict[str, bytes]) -> list[str]:
    """What is wrong with an FMU's XML files; path inside the archive -> content."""
    found = []
    for name in files:
        if not name.endswith(".xml"):
            continue
        if name not in SCHEMAS:
            found.append(f"{name}: no schema is known for it")
        elif not schema(name).validate(document := etree.fromstring(files[name])):
            found += [f"{name}: {error}" for error in schema(name).error_log]
        elif name == "modelDescription.xml":
            found += [f"{name}: {rule}" for rule in broken_rules(document)]
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "modelDescription.xml").write_bytes(files["modelDescription.xml"])
        return found + validate_fmu(folder)


def broken_rules(root) -> list[str]:
    """Rules of FMI 2.0.4, sections 2.2.2, 2.2.7 and 2.2.8, that neither the schema nor fmpy looks at."""
    scalars = root.findall("ModelVariables/ScalarVariable")
    found, names = [], {unit.get("name"): [u.get("name") for u in unit.findall("DisplayUnit")] for unit in root.iter("Unit")}
    found += [f"display units of {unit} occur twice" for unit, shown in names.items() if len({unit, *shown}) != 1 + len(shown)]
    for scalar in scalars:
        (kind,), name = scalar, scalar.get("name")
        if kind.get("displayUnit") is not None and kind.get("displayUnit") not in names[kind.get("unit")]:
            found.append(f"{name} is shown in an unknown unit")
        if (place := kind.get("derivative")) is None:
            continue
        whole = scalars[int(place) - 1]
        continuous = {one.get("variability") for one in (scalar, whole)} == {"continuous"}
        if whole is scalar or whole[0].tag != "Real" or kind.tag != "Real" or not continuous:
            found.append(f"{name} cannot be the derivative of {whole.get('name')}")
    unknowns = [int(unknown.get("index")) for unknown in root.find("ModelStructure/InitialUnknowns")]
    outputs = [place for place, one in enumerate(scalars, 1) if one.get("causality") == "output"]
    states = [place for place, one in enumerate(scalars, 1) if one.get("causality") == "local"]
    rates = [place for place in states if scalars[place - 1][0].get("derivative") is not None]
    if [int(unknown.get("index")) for unknown in root.findall("ModelStructure/Derivatives/Unknown")] != rates:
        found.append("the derivatives of the states are not those that say so, in their order")
    if (
        unknowns != outputs + states
        or [int(unknown.get("index")) for unknown in root.find("ModelStructure/Outputs")] != outputs
    ):
        found.append(
            "outputs and initial unknowns are not the outputs, with states and derivatives behind them, in their order"
        )
    return found


@pytest.mark.parametrize("kind", KINDS, ids=str)
def test_every_kind_keeps_the_schemas(kind):
    assert problems(files_of(driven_scenes.built(driven_scenes.LABORATORY), *kind)) == []


@pytest.mark.parametrize("runtime", ["native", "python"])
@pytest.mark.parametrize("name", builtin_scenes())
def test_every_scene_keeps_the_schemas(name, runtime):
    assert problems(files_of(scene(name), runtime, "structured", False, False)) == []


@pytest.mark.parametrize("runtime", ["native", "python"])
def test_detached_actuators_keep_the_schemas(runtime):
    """An actuator has neither nodes nor strings: nothing to join in terminals, and so no file of them."""
    bare, actuators = detached(driven_scenes.built(driven_scenes.MAST))
    files = files_of(actuators["s2"], runtime, "structured", False, False)
    assert problems(files) == [] and not any(name.startswith("terminals") for name in files)
    assert problems(files_of(bare, runtime, "structured", False, False)) == []


def test_faults_would_be_seen():
    files = files_of(scene("two_bar"), "native", "structured", False, True)
    terminals = b'<fmiTerminalsAndIcons fmiVersion="3.0"><Terminals/></fmiTerminalsAndIcons>'
    changes = [
        ("terminalsAndIcons/terminalsAndIcons.xml", lambda _: terminals, "Terminal"),
        ("sources/buildDescription.xml", lambda text: text.replace(b"modelIdentifier", b"identifier"), "modelIdentifier"),
        ("modelDescription.xml", lambda text: text.replace(b'"mm"', b'"cm"'), "twice"),
        ("modelDescription.xml", lambda text: text.replace(b'displayUnit="mm"', b'displayUnit="km"', 1), "unknown unit"),
        ("modelDescription.xml", lambda text: text.replace(b' derivative="', b' derivative="1', 1), "derivative of"),
        ("other.xml", lambda _: b"<a/>", "no schema"),
    ]
    for name, change, word in changes:
        found = problems(files | {name: change(files.get(name, b""))})
        assert found and any(word in problem for problem in found), (name, found)


# What importers show


def test_every_unit_has_a_quantity_and_its_display_units_are_right():
    """Against the prefixes and the definitions of the units."""
    assert {field.unit for field in FIELDS} | set(RATES_OF.values()) == set(UNITS)
    assert [name for name, unit in UNITS.items() if not unit.quantity] == ["1"]
    prefixes = {"mm": 1e-3, "cm": 1e-2, "ms": 1e-3, "g": 1e-3, "mm/s": 1e-3, "kN": 1e3, "N/mm": 1e3, "kN/m": 1e3, "mJ": 1e-3}
    prefixes |= {"mA": 1e-3, "rpm": 2.0 * np.pi / 60.0, "deg/s": np.pi / 180.0, "kg.cm2": 1e-4, "mN.m.s": 1e-3}
    prefixes |= {"mN.m/A": 1e-3, "mW": 1e-3}
    for unit in UNITS.values():
        for name, factor in unit.shown.items():
            assert factor * prefixes[name] == pytest.approx(1.0, rel=1e-15), name
        assert unit.shown or not unit.by_default


def test_a_field_with_an_unknown_unit_is_named():
    odd = FIELDS[0]._replace(name="pressure", unit="Pa")
    with pytest.raises(ValueError, match=r"'pressure' has the unit 'Pa', which FMUs do not know; give it a row in UNITS"):
        require_known((*FIELDS, odd))


def test_derivatives_name_what_they_are_derivatives_of():
    table = {row.name: row for row in variables(driven_scenes.built(driven_scenes.LABORATORY))}
    by_reference = {row.reference: name for name, row in table.items()}
    told = {name: by_reference[row.derivative_of] for name, row in table.items() if row.derivative_of is not None}
    assert told["n4.velocity.z"] == "n4.z" and told["s1.rest_length_rate"] == "s1.rest_length"
    assert told["n1.velocity.x"] == "n1.position.x" and told["n1.acceleration.x"] == "n1.velocity.x"
    assert told["s4.rest_length_rate"] == "s4.rest_length" and table["s4.rest_length"].causality == "output"
    assert len(told) == sum(row.field in RATES for row in table.values())


def test_derivatives_are_those_of_the_motion():
    """Differences of each output over a tiny step are the variable that is called its derivative."""
    model = driven_scenes.built(driven_scenes.LABORATORY)
    kernel, h = Kernel(model), 1e-6
    kernel["tolerance"][:] = 1e-12
    kernel["force"][2], kernel["current"][:] = 30.0, 1.1 * kernel["current"]
    kernel.initialize()
    for _ in range(20):
        kernel.step(0.01)
    before = kernel.values.copy()
    kernel.step(h)
    pairs = [
        (r.reference, r.derivative_of) for r in variables(model) if r.causality == "output" and r.derivative_of is not None
    ]
    assert len(pairs) > 15
    for rate, whole in pairs:
        mean = 0.5 * (before[rate] + kernel.values[rate])
        assert (kernel.values[whole] - before[whole]) / h == pytest.approx(mean, abs=1e-6)


def main() -> None:
    """Every kind of every model."""
    count = xml = 0
    for model in models():
        for kind in KINDS:
            files = files_of(model, *kind)
            found = problems(files)
            count, xml = count + 1, xml + sum(name.endswith(".xml") for name in files)
            assert not found, (model.name, kind, found[:5])
    print(f"{count} FMUs, {xml} XML files: no problem")


if __name__ == "__main__":
    main()
