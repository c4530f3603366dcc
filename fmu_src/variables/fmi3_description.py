"""Renders modelDescription.xml of FMI 3.0 from the variable table."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from xml.etree import ElementTree as XML

from tensegrity_core.fields import METHOD_MEANINGS
from tensegrity_core.model import Model

from .arrays import Whole, owners, wholes
from .described import LOG_CATEGORIES, Experiment, Runtime, add_experiment, add_units, differentiable, text
from .interface import Variable
from .units import UNITS

#: What every FMU can do.
_ALWAYS = {
    "needsExecutionTool": False,
    "canBeInstantiatedOnlyOncePerProcess": False,
    "canGetAndSetFMUState": True,
    "canSerializeFMUState": True,
    "providesDirectionalDerivatives": True,
    "providesAdjointDerivatives": True,
}

#: What every FMU for model exchange can do.
EXCHANGE_CAPABILITIES = _ALWAYS | {"needsCompletedIntegratorStep": True}

#: What every FMU for co-simulation can do.
CAPABILITIES = _ALWAYS | {
    "canHandleVariableCommunicationStepSize": True,
    "maxOutputDerivativeOrder": 1,
    "hasEventMode": True,
    "providesIntermediateUpdate": True,
    "mightReturnEarlyFromDoStep": True,
    "canReturnEarlyAfterIntermediateUpdate": True,
}

#: Types of FMI 3.0 by those of the table.
TYPES = {"Real": "Float64", "Integer": "Int32", "Enumeration": "Enumeration"}


def model_description(
    model: Model,
    table: tuple[Variable, ...],
    runtime: Runtime,
    identifier: str,
    token: str,
    version: str,
    naming: str,
    experiment: Experiment,
) -> bytes:
    """The XML document.  table: with `time` and the event indicators; token: the instantiation token, see
    described.content_guid; the others as in model_description.py."""
    root = XML.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=model.name,
        instantiationToken=token,
        description=model.description,
        version=version,
        generationTool=runtime.tool,
        variableNamingConvention=naming,
    )
    partials = dict.fromkeys(("providesDirectionalDerivatives", "providesAdjointDerivatives"), differentiable(model))
    if runtime.kind != "cs":
        _add_kind(root, "ModelExchange", identifier, EXCHANGE_CAPABILITIES | partials)
    if runtime.kind != "me":
        _add_kind(root, "CoSimulation", identifier, CAPABILITIES | partials)
    add_units(root, {row.unit for row in table if row.unit})
    if any(row.kind == "Enumeration" for row in table):
        _add_method_type(root)
    categories = XML.SubElement(root, "LogCategories")
    for name, meaning in LOG_CATEGORIES.items():
        XML.SubElement(categories, "Category", name=name, description=meaning.replace("fmi2", "fmi3"))
    add_experiment(root, experiment)
    _add_variables(root, table, runtime.kind)
    _add_structure(root, table)
    XML.indent(root)
    return XML.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def _add_kind(root: XML.Element, tag: str, identifier: str, capabilities: Mapping[str, bool | int]) -> None:
    known = {name: text(value) for name, value in capabilities.items()}
    XML.SubElement(root, tag, {"modelIdentifier": identifier} | known)


def _add_method_type(root: XML.Element) -> None:
    types = XML.SubElement(root, "TypeDefinitions")
    enumeration = XML.SubElement(types, "EnumerationType", name="solver.Method", description="integration method")
    for value, (name, meaning) in enumerate(METHOD_MEANINGS.items()):
        XML.SubElement(enumeration, "Item", name=name, value=str(value), description=meaning)


def _add_variables(root: XML.Element, table: tuple[Variable, ...], kind: str) -> None:
    variables, owner = XML.SubElement(root, "ModelVariables"), owners(table)
    integrated = {row.derivative_of for row in table if row.causality == "local"}
    for whole in wholes(table):
        row, attributes = whole.first, _attributes(whole)
        if row.derivative_of is not None:
            attributes["derivative"] = str(owner[row.derivative_of])
        if row.reference in integrated:
            attributes["reinit"] = "true"
        if kind != "me" and row.variability == "continuous" and row.causality == "output":
            attributes["intermediateUpdate"] = "true"
        element = XML.SubElement(variables, TYPES[row.kind], attributes)
        if whole.is_array:
            XML.SubElement(element, "Dimension", start=str(len(whole.rows)))


def _attributes(whole: Whole) -> dict[str, str]:
    """Of a variable's element, as far as they follow from its rows alone."""
    row = whole.first
    found: dict[str, str | float | None] = {
        "name": whole.name,
        "valueReference": row.reference,
        "description": whole.description,
        "causality": row.causality,
        "variability": row.variability,
        "initial": row.initial,
        "declaredType": "solver.Method" if row.kind == "Enumeration" else None,
        "unit": row.unit,
        "min": whole.least("min"),
        "max": whole.largest("max"),
        "nominal": whole.largest("nominal"),
        "start": None if row.start is None else " ".join(text(one.start) for one in whole.rows if one.start is not None),
    }
    unit = UNITS[row.unit or "1"]
    found["quantity"] = unit.quantity
    found["displayUnit"] = next(iter(unit.shown)) if unit.by_default and row.causality != "independent" else None
    return {name: text(value) for name, value in found.items() if value is not None}


def _add_structure(root: XML.Element, table: tuple[Variable, ...]) -> None:
    structure, owner, all_of_them = XML.SubElement(root, "ModelStructure"), owners(table), wholes(table)
    outputs = [whole for whole in all_of_them if whole.first.causality == "output"]
    local = [whole for whole in all_of_them if whole.first.causality == "local"]
    rates = [whole for whole in local if whole.first.derivative_of is not None]
    states = {owner[whole.first.derivative_of] for whole in rates if whole.first.derivative_of is not None}

    def add(tag: str, whole: Whole, references: Iterable[int], constant: bool = False) -> None:
        """references: of elements; those of the same variable become one, which is what FMI 3.0 has."""
        listed = sorted({owner[reference] for reference in references})
        kinds = {"dependenciesKind": " ".join(["constant"] * len(listed))} if constant else {}
        attributes = {"valueReference": str(whole.reference), "dependencies": " ".join(map(str, listed))}
        XML.SubElement(structure, tag, attributes | kinds)

    def depends(whole: Whole) -> set[int]:
        return set().union(*((row.depends or frozenset()) | row.tuned for row in whole.rows))

    for whole in outputs:
        add("Output", whole, depends(whole))
    for whole in rates:
        add("ContinuousStateDerivative", whole, depends(whole), whole.first.constant)
    for whole in (*outputs, *(one for one in local if one in rates or one.reference in states)):
        add("InitialUnknown", whole, set().union(*(row.known for row in whole.rows)))
    for whole in local:
        if whole not in rates and whole.reference not in states:
            add("EventIndicator", whole, depends(whole))
