"""A plan and its FMUs as an SSP archive (System Structure and Parameterization, Modelica Association, versions 1.0 and 2.0).

The parts that it uses are the same in both versions, and so is all but the version number.  Start values stand in the
description itself, component by component, because not every tool reads them from files of their own.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree

from fmpy import read_model_description

from fmu_src.packing.pack import write_zip
from fmu_src.variables.units import UNITS

from .system import Plan

VERSIONS = ("2.0", "1.0")
NAMESPACE = "http://ssp-standard.org/SSP1/SystemStructure"
PREFIXES = {"ssd": "Description", "ssc": "Common", "ssv": "ParameterValues"}
#: Name of all parameter sets: ecos takes those of one name.
PARAMETERS = "start"
#: Units of SSP that are no unit of the structure's FMU.
RATES = {"1/s": {"s": -1}}


def write(destination: Path, name: str, plan: Plan, fmus: dict[str, Path], stop: float, version: str = "2.0") -> Path:
    """Write the archive; fmus: unit -> file, packed once each; stop: of the default experiment, s."""
    files = {f"resources/{path.name}": path.read_bytes() for path in fmus.values()}
    files["SystemStructure.ssd"] = description(name, plan, fmus, stop, version)
    write_zip(destination, files)
    return destination


def description(name: str, plan: Plan, fmus: dict[str, Path], stop: float, version: str) -> bytes:
    """SystemStructure.ssd."""
    for prefix, tail in PREFIXES.items():
        ElementTree.register_namespace(prefix, NAMESPACE + tail)
    root = ElementTree.Element(_of("ssd", "SystemStructureDescription"), version=version, name=name)
    system = _inside(root, "ssd:System", name=name)
    elements, used = _inside(system, "ssd:Elements"), set()
    for unit in plan.units:
        used |= _component(elements, plan, unit, fmus[unit], version)
    connections = _inside(system, "ssd:Connections")
    for wire in plan.wires:
        ends = {
            "startElement": wire.source,
            "startConnector": wire.output,
            "endElement": wire.target,
            "endConnector": wire.input,
        }
        _inside(connections, "ssd:Connection", **ends)
    units = _inside(root, "ssd:Units")
    known = RATES | {symbol: unit.base for symbol, unit in UNITS.items()}
    for symbol in sorted(used):
        powers = {base: str(power) for base, power in known[symbol].items()}
        _inside(_inside(units, "ssc:Unit", name=symbol), "ssc:BaseUnit", **powers)
    _inside(root, "ssd:DefaultExperiment", startTime="0.0", stopTime=repr(stop))
    ElementTree.indent(root)
    return ElementTree.tostring(root, "utf-8", xml_declaration=True)


def _component(elements, plan: Plan, name: str, fmu: Path, version: str) -> set[str]:
    """An FMU with its connectors and start values; returns the units that they have."""
    variables = {variable.name: variable for variable in read_model_description(str(fmu)).modelVariables}
    component = _inside(
        elements, "ssd:Component", name=name, type="application/x-fmu-sharedlibrary", source=f"resources/{fmu.name}"
    )
    kinds = dict.fromkeys((w.output for w in plan.wires if w.source == name), "output")
    kinds |= dict.fromkeys((w.input for w in plan.wires if w.target == name), "input")
    kinds |= {start: variables[start].causality for start in plan.start[name]}
    connectors = _inside(component, "ssd:Connectors")
    for connector, kind in kinds.items():
        _inside(_inside(connectors, "ssd:Connector", name=connector, kind=kind), "ssc:Real", unit=variables[connector].unit)
    values = _inside(_inside(_inside(component, "ssd:ParameterBindings"), "ssd:ParameterBinding"), "ssd:ParameterValues")
    parameters = _inside(_inside(values, "ssv:ParameterSet", version=version, name=PARAMETERS), "ssv:Parameters")
    for start, value in plan.start[name].items():
        real = {"value": repr(value), "unit": variables[start].unit}
        _inside(_inside(parameters, "ssv:Parameter", name=start), "ssv:Real", **real)
    return {variables[connector].unit for connector in kinds}


def _inside(parent, element: str, /, **attributes: str):
    """A new element in another; element: with a key of PREFIXES."""
    prefix, _, tag = element.partition(":")
    return ElementTree.SubElement(parent, _of(prefix, tag), attributes)


def _of(prefix: str, tag: str) -> str:
    return f"{{{NAMESPACE}{PREFIXES[prefix]}}}{tag}"
