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
from tests.support import driven_scenes, element_scenes, jointed_scenes, scene
from tests.support.words import words

SCHEMAS = {
    "2.0": "fmi2/fmi2ModelDescription.xsd",
    "3.0": "fmi3/fmi3ModelDescription.xsd",
    "terminalsAndIcons/terminalsAndIcons.xml": "fmi3/fmi3TerminalsAndIcons.xsd",
    "sources/buildDescription.xml": "fmi3/fmi3BuildDescription.xsd",
}

DRIVEN = {name: getattr(driven_scenes, name) for name in ("PENDULUM", "AFLOAT", "MAST", "LABORATORY")}

#: What an FMU may be asked to be: runtime, naming, simple types, sources, kind, version of FMI.
KINDS = [
    *(
        (runtime, naming, simple, False)
        for runtime in ("native", "python")
        for naming in ("structured", "flat")
        for simple in (False, True)
    ),
    ("native", "structured", False, True),
    *(("native", naming, False, True, kind) for naming in ("structured", "flat") for kind in ("me", "both")),
    *(("native", naming, False, True, kind, "3.0") for naming in ("structured", "flat") for kind in ("cs", "me", "both")),
    ("native", "structured", True, False, "cs", "3.0"),
]


@cache
def schema(name: str) -> etree.XMLSchema:
    return etree.XMLSchema(etree.parse(str(Path(fmpy.__file__).parent / "schema" / SCHEMAS[name])))


def models() -> Iterator[Model]:
    """The built-in scenes, scenes with drives, with every element, with joints, and detached actuators with what they leave
    behind."""
    yield from map(scene, builtin_scenes())
    for found in map(driven_scenes.built, DRIVEN.values()):
        yield found
        bare, actuators = detached(found)
        yield from ([bare, *actuators.values()] if actuators else [])
    yield from map(element_scenes.mast, element_scenes.STRINGS)
    yield driven_scenes.built(jointed_scenes.SLIDER)
    yield from map(jointed_scenes.random_joints, (3, 9))


def files_of(
    model: Model, runtime: str, naming: str, simple: bool, sources: bool, kind: str = "cs", standard: str = "2.0"
) -> dict[str, bytes]:
    if runtime == "python":
        kernel = {here(): CORE / "native" / LIBRARY}
        return python_fmu_files(model, naming, {here(): host_library("python")}, kernel, simple)
    contents = Contents(naming, sources=sources, simple=simple, kind=kind, standard=standard)
    return native_fmu_files(model, contents, {here(): host_library()})


def problems(files: dict[str, bytes]) -> list[str]:
    """What is wrong with an FMU's XML files; path inside the archive -> content."""
    found = []
    for name in files:
        if not name.endswith(".xml"):
            continue
        document = etree.fromstring(files[name])
        version = document.get("fmiVersion")
        known = version if name == "modelDescription.xml" else name
        if known not in SCHEMAS:
            found.append(f"{name}: no schema is known for it")
        elif not schema(known).validate(document):
            found += [f"{name}: {error}" for error in schema(known).error_log]
        elif name == "modelDescription.xml":
            found += [f"{name}: {rule}" for rule in (broken_rules if version == "2.0" else broken_rules_of_3)(document)]
        elif name == "terminalsAndIcons/terminalsAndIcons.xml":
            found += [f"{name}: {rule}" for rule in broken_terminals(document, files)]
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


def broken_rules_of_3(root) -> list[str]:
    """The same of FMI 3.0, sections 2.4.7 and 2.4.8: what refers to what, shapes, and the order of the model structure."""
    rows = list(root.find("ModelVariables"))
    known, shapes = {row.get("valueReference"): row for row in rows}, {}
    found, names = [], {unit.get("name"): [u.get("name") for u in unit.findall("DisplayUnit")] for unit in root.iter("Unit")}
    for row in rows:
        name, whole = row.get("name"), known.get(row.get("derivative"))
        shapes[row.get("valueReference")] = [int(one.get("start")) for one in row.findall("Dimension")]
        size = int(np.prod(shapes[row.get("valueReference")]))
        if row.get("start") is not None and len(row.get("start").split()) != size:
            found.append(f"{name} has not as many starts as elements")
        if row.get("displayUnit") is not None and row.get("displayUnit") not in names[row.get("unit")]:
            found.append(f"{name} is shown in an unknown unit")
        if row.get("derivative") is not None and (whole is row or {row.tag, whole.tag} != {"Float64"}):
            found.append(f"{name} cannot be the derivative of {whole.get('name')}")
    if [row.get("name") for row in rows if row.get("causality") == "independent"] != ["time"]:
        found.append("the independent variable is not `time` alone")
    found += [f"{row.get('name')} and its derivative differ in shape" for row in rows if row.get("derivative") is not None
              and shapes[row.get("derivative")] != shapes[row.get("valueReference")]]  # fmt: skip
    listed = {tag: [one.get("valueReference") for one in root.findall(f"ModelStructure/{tag}")] for tag in STRUCTURE}
    for unknown in root.find("ModelStructure"):
        if missing := [one for one in unknown.get("dependencies").split() if one not in known]:
            found.append(f"{unknown.tag} depends on {missing}, which do not exist")
    outputs, local = ([row.get("valueReference") for row in rows if row.get("causality") == one] for one in ("output", "local"))
    rates = [one for one in local if known[one].get("derivative") is not None and not known[one].get("reinit")]
    integrated = {known[one].get("derivative") for one in listed["ContinuousStateDerivative"]}
    states = [one for one in local if one in integrated]
    if integrated != {row.get("valueReference") for row in rows if row.get("reinit") == "true"}:
        found.append("the states that events may change are not the states")
    expected = dict(zip(STRUCTURE, (outputs, rates, [*outputs, *states, *rates], [])))
    expected["EventIndicator"] = [one for one in local if one not in (*states, *rates)]
    return found + [f"the list of {tag} is not what it should be" for tag in STRUCTURE if listed[tag] != expected[tag]]


#: Lists of a model structure of FMI 3.0.
STRUCTURE = ("Output", "ContinuousStateDerivative", "InitialUnknown", "EventIndicator")


def broken_terminals(root, files: dict[str, bytes]) -> list[str]:
    """Members that are no variables, and an icon that is missing."""
    document = etree.fromstring(files["modelDescription.xml"])
    names = {row.get("name") for row in document.find("ModelVariables")}
    members = [one.get("variableName") for one in root.iter("TerminalMemberVariable")]
    found = [f"{name} is no variable" for name in members if name not in names]
    if (root.find("GraphicalRepresentation/Icon") is not None) != ("terminalsAndIcons/icon.png" in files):
        found.append("the icon is named and missing, or there and not named")
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


def test_detached_actuators_keep_the_schemas_of_fmi_3():
    """In FMI 3.0 the same file says where the icon is."""
    bare, actuators = detached(driven_scenes.built(driven_scenes.MAST))
    for one in (bare, actuators["s2"]):
        files = files_of(one, "native", "structured", False, False, standard="3.0")
        assert problems(files) == [] and files["terminalsAndIcons/icon.png"].startswith(b"\x89PNG")


@pytest.mark.parametrize("name", builtin_scenes())
def test_every_scene_keeps_the_schemas_of_fmi_3(name):
    assert problems(files_of(scene(name), "native", "structured", False, False, "both", "3.0")) == []


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
        for kind in KINDS if not hasattr(model, "shown") else [one for one in KINDS if "me" not in one and "both" not in one]:
            files = files_of(model, *kind)
            found = problems(files)
            count, xml = count + 1, xml + sum(name.endswith(".xml") for name in files)
            assert not found, (model.name, kind, found[:5])
    print(f"{count} FMUs, {xml} XML files: no problem")


if __name__ == "__main__":
    words(__doc__)
    main()
