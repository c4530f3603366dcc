"""Renders modelDescription.xml (FMI 2.0) from the variable table; both runtimes use it."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from xml.etree import ElementTree as XML

from tensegrity_core.fields import METHOD_MEANINGS
from tensegrity_core.model import Model

from .interface import Variable
from .units import UNITS

#: Log categories of every FMU and what they carry.
LOG_CATEGORIES = {
    "logStatusWarning": "things that the host should know and that change nothing",
    "logStatusDiscard": "values and calls that were refused, and steps that could not be completed",
    "logStatusError": "calls that must not be made, and faults inside the FMU",
    "logEvents": "transitions: a string became slack or taut, or reached another piece of its force curve",
    "logSolver": "what the integrator did, at fmi2Terminate",
}


@dataclass(frozen=True)
class Runtime:
    """What differs between the runtimes.  name: 'python' or 'native'; tool: what made the FMU; sources: files to compile, in
    sources/; kind: one of KINDS; indicators: event indicators, of model exchange."""

    name: str
    tool: str
    sources: tuple[str, ...] = ()
    kind: str = "cs"
    indicators: int = 0


#: Kinds of FMUs: co-simulation, model exchange, both in one.
KINDS = ("cs", "me", "both")

#: What every FMU for model exchange can do.
EXCHANGE_CAPABILITIES = {
    "needsExecutionTool": False,
    "completedIntegratorStepNotNeeded": False,
    "canBeInstantiatedOnlyOncePerProcess": False,
    "canNotUseMemoryManagementFunctions": True,
    "canGetAndSetFMUstate": True,
    "canSerializeFMUstate": True,
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


@dataclass(frozen=True)
class Experiment:
    """The default experiment; s, and the relative tolerance."""

    start: float = 0.0
    stop: float = 5.0
    step: float = 0.01
    tolerance: float | None = None


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
        _add_kind(root, "ModelExchange", identifier, EXCHANGE_CAPABILITIES, runtime.sources)
    if runtime.kind != "me":
        _add_kind(root, "CoSimulation", identifier, CAPABILITIES, runtime.sources)
    _add_units(root, {row.unit for row in table if row.unit})
    if any(row.kind == "Enumeration" for row in table):
        _add_method_type(root)
    categories = XML.SubElement(root, "LogCategories")
    for name, meaning in LOG_CATEGORIES.items():
        XML.SubElement(categories, "Category", name=name, description=meaning)
    _add_experiment(root, experiment)
    scalars = XML.SubElement(root, "ModelVariables")
    index = indices(table)
    for row in table:
        _add_variable(scalars, row, index)
    _add_structure(root, table)
    XML.indent(root)
    return XML.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


#: What buildDescription.xml says about compilers.
COMPILERS = (
    "ISO C99, and C++11 at the same time, for any compiler. GCC and Clang use their vectors unless TS_PLAIN_C is defined; "
    "the results are the same to the last bit where products are not fused with sums (GCC: -std=c99 or -ffp-contract=off). "
    "To link several such FMUs into one program, define FMI2_FUNCTION_PREFIX for each."
)


def build_description(identifier: str, sources: tuple[str, ...]) -> bytes:
    """sources/buildDescription.xml: how to compile the FMU from its sources, for tools that know this format of FMI 3.0."""
    root = XML.Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = XML.SubElement(root, "BuildConfiguration", modelIdentifier=identifier, description=COMPILERS)
    _add_files(XML.SubElement(configuration, "SourceFileSet", language="C99"), "SourceFile", sources)
    XML.SubElement(configuration, "Library", name="m", external="true", description="mathematical functions of C, on Unix")
    XML.indent(root)
    return XML.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def plain(table: tuple[Variable, ...]) -> tuple[Variable, ...]:
    """The table for tools that know no enumerations and read every output as a Real: the enumeration becomes an Integer, and
    the Integer outputs, which come last, are left out."""
    kept = [row for row in table if row.kind != "Integer" or row.causality != "output"]
    if kept != list(table[: len(kept)]):
        raise ValueError("an Integer output stands between other variables, whose indices would change")
    return tuple(replace(row, kind="Integer") if row.kind == "Enumeration" else row for row in kept)


def content_guid(description_without_guid: bytes, files: dict[str, bytes]) -> str:
    """A GUID that is a hash of everything that can change what the FMU does: the same content has the same GUID."""
    digest = hashlib.sha256(description_without_guid)
    for name in sorted(files):
        digest.update(f"\0{name}\0{len(files[name])}\0".encode())
        digest.update(files[name])
    h = digest.hexdigest()
    return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"


def _text(value: bool | float | str) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


def _add_files(parent: XML.Element, tag: str, names: tuple[str, ...]) -> None:
    for name in names:
        XML.SubElement(parent, tag, name=name)


def _add_kind(
    root: XML.Element, tag: str, identifier: str, capabilities: Mapping[str, bool | int], sources: tuple[str, ...]
) -> None:
    kind = XML.SubElement(root, tag, modelIdentifier=identifier)
    for name, value in capabilities.items():
        kind.set(name, _text(value))
    if sources:
        _add_files(XML.SubElement(kind, "SourceFiles"), "File", sources)


def _add_units(root: XML.Element, used: set[str]) -> None:
    units = XML.SubElement(root, "UnitDefinitions")
    for name in sorted(used):
        unit = XML.SubElement(units, "Unit", name=name)
        XML.SubElement(unit, "BaseUnit", {base: str(power) for base, power in UNITS[name].base.items()})
        for shown, factor in UNITS[name].shown.items():
            XML.SubElement(unit, "DisplayUnit", name=shown, factor=repr(factor))


def _add_method_type(root: XML.Element) -> None:
    types = XML.SubElement(root, "TypeDefinitions")
    simple = XML.SubElement(types, "SimpleType", name="solver.Method", description="integration method")
    enumeration = XML.SubElement(simple, "Enumeration")
    for value, (name, meaning) in enumerate(METHOD_MEANINGS.items()):
        XML.SubElement(enumeration, "Item", name=name, value=str(value), description=meaning)


def _add_experiment(root: XML.Element, experiment: Experiment) -> None:
    attributes = {"startTime": experiment.start, "stopTime": experiment.stop, "stepSize": experiment.step}
    if experiment.tolerance is not None:
        attributes["tolerance"] = experiment.tolerance
    XML.SubElement(root, "DefaultExperiment", {name: repr(value) for name, value in attributes.items()})


def _add_variable(scalars: XML.Element, row: Variable, index: dict[int, str]) -> None:
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
            kind.set(name, _text(value))
    unit = UNITS[row.unit or "1"]
    if unit.quantity:
        kind.set("quantity", unit.quantity)
    if unit.by_default:
        kind.set("displayUnit", next(iter(unit.shown)))
    if row.derivative_of is not None:
        kind.set("derivative", index[row.derivative_of])


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
    for row in outputs:
        known = " ".join(index[reference] for reference in row.known)
        XML.SubElement(unknowns, "Unknown", index=index[row.reference], dependencies=known)
    for row in table:  # of states and their derivatives nothing is said: they may depend on everything that is known
        if row.causality == "local":
            XML.SubElement(unknowns, "Unknown", index=index[row.reference])
