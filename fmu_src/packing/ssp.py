"""A system of FMUs as an SSP archive (System Structure and Parameterization, Modelica Association, versions 1.0 and 2.0).

The parts that it uses are the same in both versions, and so is all but the version number.  Start values stand in the
description itself, component by component, because not every tool reads them from files of their own.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree

from fmpy import read_model_description

from tensegrity_core.model import Model
from tensegrity_core.model.components import flat

from .pack import write_zip

VERSIONS = ("2.0", "1.0")
NAMESPACE = "http://ssp-standard.org/SSP1/SystemStructure"
PREFIXES = {"ssd": "Description", "ssc": "Common", "ssv": "ParameterValues"}
BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
#: Name of all parameter sets: ecos takes those of one name.
PARAMETERS = "start"


class Wire(NamedTuple):
    """From an output of one unit to an input of another."""

    source: str
    output: str
    target: str
    input: str


class System(NamedTuple):
    """name; fmus: unit -> file, in the order of the flow of data; wires; start: unit -> variable -> value, where it is another
    than the FMU's own; stop: of the default experiment, s."""

    name: str
    fmus: Mapping[str, Path]
    wires: tuple[Wire, ...]
    start: Mapping[str, Mapping[str, float]]
    stop: float


def write_ssp(destination: Path, system: System, version: str = VERSIONS[0]) -> Path:
    """Write the archive, with each FMU once.  Raises InputError where it cannot be written."""
    files = {f"resources/{path.name}": path.read_bytes() for path in system.fmus.values()}
    write_zip(destination, files | {"SystemStructure.ssd": description(system, version)})
    return destination


def detached_system(model: Model, actuators: Mapping[str, Model], fmus: Mapping[str, Path], naming: str) -> System:
    """A structure with the actuators that were detached from it (see `actuator.detached`).

    model: of the structure; actuators: string -> model; fmus: name of a model -> file; naming: of variables.
    """
    wires, files = [], {}
    for string, actuator in actuators.items():
        unit, names = f"{string}_actuator", {end: f"{string}.{end}" for end in ("force", "rest_length", "rest_length_rate")}
        if naming == "flat":
            names = {end: flat(name) for end, name in names.items()}
        files[unit] = fmus[actuator.name]
        wires.append(Wire("structure", names.pop("force"), unit, "tension"))
        wires += [Wire(unit, end, "structure", name) for end, name in names.items()]
    return System(model.name, files | {"structure": fmus[model.name]}, tuple(wires), {}, 1.0)


def description(system: System, version: str) -> bytes:
    """SystemStructure.ssd."""
    for prefix, tail in PREFIXES.items():
        ElementTree.register_namespace(prefix, NAMESPACE + tail)
    root = ElementTree.Element(_of("ssd", "SystemStructureDescription"), version=version, name=system.name)
    inside = _inside(root, "ssd:System", name=system.name)
    elements = _inside(inside, "ssd:Elements")
    units: dict[str, dict[str, str]] = {}
    for unit in system.fmus:
        units |= _component(elements, system, unit, version)
    connections = _inside(inside, "ssd:Connections")
    for wire in system.wires:
        ends = {
            "startElement": wire.source,
            "startConnector": wire.output,
            "endElement": wire.target,
            "endConnector": wire.input,
        }
        _inside(connections, "ssd:Connection", **ends)
    known = _inside(root, "ssd:Units")
    for name, powers in sorted(units.items()):
        _inside(_inside(known, "ssc:Unit", name=name), "ssc:BaseUnit", **powers)
    _inside(root, "ssd:DefaultExperiment", startTime="0.0", stopTime=repr(system.stop))
    ElementTree.indent(root)
    return ElementTree.tostring(root, "utf-8", xml_declaration=True)


def _component(elements, system: System, name: str, version: str) -> dict[str, dict[str, str]]:
    """An FMU with its connectors and start values; returns the units that they have, with the powers of base units."""
    fmu, start = system.fmus[name], system.start.get(name, {})
    described = read_model_description(str(fmu))
    variables = {variable.name: variable for variable in described.modelVariables}
    source = f"resources/{fmu.name}"
    component = _inside(elements, "ssd:Component", name=name, type="application/x-fmu-sharedlibrary", source=source)
    kinds = _kinds(system.wires, name) | {variable: variables[variable].causality for variable in start}
    connectors = _inside(component, "ssd:Connectors")
    for connector, kind in kinds.items():
        _inside(_inside(connectors, "ssd:Connector", name=connector, kind=kind), "ssc:Real", unit=variables[connector].unit)
    if start:
        values = _inside(_inside(_inside(component, "ssd:ParameterBindings"), "ssd:ParameterBinding"), "ssd:ParameterValues")
        parameters = _inside(_inside(values, "ssv:ParameterSet", version=version, name=PARAMETERS), "ssv:Parameters")
        for variable, value in start.items():
            real = {"value": repr(value), "unit": variables[variable].unit}
            _inside(_inside(parameters, "ssv:Parameter", name=variable), "ssv:Real", **real)
    used = {variables[connector].unit for connector in kinds}
    return {unit.name: _powers(unit.baseUnit) for unit in described.unitDefinitions if unit.name in used}


def _kinds(wires: Iterable[Wire], unit: str) -> dict[str, str]:
    """Connected variable -> 'output' or 'input'."""
    outputs = dict.fromkeys((wire.output for wire in wires if wire.source == unit), "output")
    return outputs | dict.fromkeys((wire.input for wire in wires if wire.target == unit), "input")


def _powers(base) -> dict[str, str]:
    """Base unit -> its power; FMUs of ours have no factors and offsets in their units."""
    return {name: str(power) for name in BASE_UNITS if (power := getattr(base, name, 0))}


def _inside(parent, element: str, /, **attributes: str):
    """A new element in another; element: with a key of PREFIXES."""
    prefix, _, tag = element.partition(":")
    return ElementTree.SubElement(parent, _of(prefix, tag), attributes)


def _of(prefix: str, tag: str) -> str:
    return f"{{{NAMESPACE}{PREFIXES[prefix]}}}{tag}"
