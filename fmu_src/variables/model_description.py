"""Renders modelDescription.xml of FMI 2.0 from the variable table; both runtimes use it."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree as XML

from tensegrity_core.fields import METHOD_MEANINGS
from tensegrity_core.model import Model

from .described import LOG_CATEGORIES, Experiment, Runtime, add_experiment, add_files, add_units, differentiable, text
from .interface import Variable
from .units import UNITS

#: What every FMU for model exchange can do.
EXCHANGE_CAPABILITIES = {
    "needsExecutionTool": False,
    "completedIntegratorStepNotNeeded": False,
    "canBeInstantiatedOnlyOncePerProcess": False,
    "canNotUseMemoryManagementFunctions": True,
    "canGetAndSetFMUstate": True,
    "canSerializeFMUstate": True,
    "providesDirectionalDerivative": True,
}

#: What every FMU for co-simulation can do.
CAPABILITIES = {
    "needsExecutionTool": False,
    "canHandleVariableCommunicationStepSize": True,
    "canInterpolateInputs": True,
    "maxOutputDerivativeOrder": 1,
    "canBeInstantiatedOnlyOncePerProcess": False,
    "canNotUseMemoryManagementFunctions": True,
    "canGetAndSetFMUstate": True,
    "canSerializeFMUstate": True,
}


def model_description(
    model: Model,
    table: tuple[Variable, ...],
    runtime: Runtime,
    identifier: str,
    guid: str,
    version: str,
    naming: str,
    experiment: Experiment,
) -> bytes:
    """The XML document.  identifier: file name of the binary; guid: see `content_guid`; version: of this project."""
    root = XML.Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName=model.name,
        guid=guid,
        description=model.description,
        version=version,
        generationTool=runtime.tool,
        variableNamingConvention=naming,
    )
    if runtime.kind != "cs":
        root.set("numberOfEventIndicators", str(runtime.indicators))
        known = EXCHANGE_CAPABILITIES | {"providesDirectionalDerivative": differentiable(model)}
        _add_kind(root, "ModelExchange", identifier, known, runtime.sources)
    if runtime.kind != "me":
        _add_kind(root, "CoSimulation", identifier, CAPABILITIES, runtime.sources)
    add_units(root, {row.unit for row in table if row.unit})
    if any(row.kind == "Enumeration" for row in table):
        _add_method_type(root)
    categories = XML.SubElement(root, "LogCategories")
    for name, meaning in LOG_CATEGORIES.items():
        XML.SubElement(categories, "Category", name=name, description=meaning)
    add_experiment(root, experiment)
    scalars = XML.SubElement(root, "ModelVariables")
    index = indices(table)
    states = {row.derivative_of for row in table if row.causality == "local"}
    for row in table:
        _add_variable(scalars, row, index, reinit=row.reference in states)
    _add_structure(root, table)
    XML.indent(root)
    return XML.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _add_kind(
    root: XML.Element, tag: str, identifier: str, capabilities: Mapping[str, bool | int], sources: tuple[str, ...]
) -> None:
    kind = XML.SubElement(root, tag, modelIdentifier=identifier)
    for name, value in capabilities.items():
        kind.set(name, text(value))
    if sources:
        add_files(XML.SubElement(kind, "SourceFiles"), "File", sources)


def _add_method_type(root: XML.Element) -> None:
    types = XML.SubElement(root, "TypeDefinitions")
    simple = XML.SubElement(types, "SimpleType", name="solver.Method", description="integration method")
    enumeration = XML.SubElement(simple, "Enumeration")
    for value, (name, meaning) in enumerate(METHOD_MEANINGS.items()):
        XML.SubElement(enumeration, "Item", name=name, value=str(value), description=meaning)


def _add_variable(scalars: XML.Element, row: Variable, index: dict[int, str], reinit: bool) -> None:
    """reinit: it is a state, which events may change."""
    attributes = {
        "name": row.name,
        "valueReference": str(row.reference),
        "description": row.description,
        "causality": row.causality,
        "variability": row.variability,
    }
    if row.initial:
        attributes["initial"] = row.initial
    scalar = XML.SubElement(scalars, "ScalarVariable", attributes)
    kind = XML.SubElement(scalar, row.kind)
    if row.kind == "Enumeration":
        kind.set("declaredType", "solver.Method")
    for name in ("unit", "min", "max", "nominal", "start"):
        value = getattr(row, name)
        if value is not None:
            kind.set(name, text(value))
    unit = UNITS[row.unit or "1"]
    if unit.quantity:
        kind.set("quantity", unit.quantity)
    if unit.by_default:
        kind.set("displayUnit", next(iter(unit.shown)))
    if row.derivative_of is not None:
        kind.set("derivative", index[row.derivative_of])
    if reinit:
        kind.set("reinit", "true")


def indices(table: tuple[Variable, ...]) -> dict[int, str]:
    """Value reference -> place in the list of variables, counted from 1, by which a description refers to variables."""
    return {row.reference: str(place) for place, row in enumerate(table, 1)}


def _add_structure(root: XML.Element, table: tuple[Variable, ...]) -> None:
    structure = XML.SubElement(root, "ModelStructure")
    index = indices(table)
    outputs = [row for row in table if row.causality == "output"]
    rates = [row for row in table if row.causality == "local" and row.derivative_of is not None]

    def listed(references) -> str:
        return " ".join(sorted((index[reference] for reference in references), key=int))

    for tag, rows in (("Outputs", outputs), ("Derivatives", rates)):
        if rows or tag == "Outputs":
            element = XML.SubElement(structure, tag)
            for row in rows:
                XML.SubElement(element, "Unknown", index=index[row.reference], dependencies=listed(row.depends or ()))
    unknowns = XML.SubElement(structure, "InitialUnknowns")
    for row in (*outputs, *(row for row in table if row.causality == "local")):
        known = " ".join(index[reference] for reference in row.known)
        XML.SubElement(unknowns, "Unknown", index=index[row.reference], dependencies=known)
