"""What descriptions share in all versions of FMI: what made the FMU, log categories, units, default experiment, GUID."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from xml.etree import ElementTree as XML

from tensegrity_core.model import Model

from .interface import Variable
from .units import UNITS

#: Versions of FMI that FMUs are written in.
STANDARDS = ("2.0", "3.0")

#: Kinds of FMUs: co-simulation, model exchange, both in one.
KINDS = ("cs", "me", "both")

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
    sources/; kind: one of KINDS; indicators: event indicators, of model exchange; standard: one of STANDARDS."""

    name: str
    tool: str
    sources: tuple[str, ...] = ()
    kind: str = "cs"
    indicators: int = 0
    standard: str = "2.0"


@dataclass(frozen=True)
class Experiment:
    """The default experiment; s, and the relative tolerance."""

    start: float = 0.0
    stop: float = 5.0
    step: float = 0.01
    tolerance: float | None = None


def plain(table: tuple[Variable, ...]) -> tuple[Variable, ...]:
    """The table for tools that know no enumerations and read every output as a Real: the enumeration becomes an Integer, and
    the Integer outputs, which come last, are left out."""
    kept = [row for row in table if row.kind != "Integer" or row.causality != "output"]
    if kept != list(table[: len(kept)]):
        raise ValueError("an Integer output stands between other variables, whose indices would change")
    return tuple(replace(row, kind="Integer") if row.kind == "Enumeration" else row for row in kept)


def differentiable(model: Model) -> bool:
    """Whether FMUs give directional and adjoint derivatives: not where bars share nodes, or nodes touch the ground."""
    return not model.joint and model.ground is None


def content_guid(description_without_guid: bytes, files: dict[str, bytes]) -> str:
    """A GUID that is a hash of everything that can change what the FMU does: the same content has the same GUID."""
    digest = hashlib.sha256(description_without_guid)
    for name in sorted(files):
        digest.update(f"\0{name}\0{len(files[name])}\0".encode())
        digest.update(files[name])
    h = digest.hexdigest()
    return f"{{{h[:8]}-{h[8:12]}-{h[12:16]}-{h[16:20]}-{h[20:32]}}}"


def text(value: bool | float | str) -> str:
    """As XML writes it; of a number all digits."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


def add_files(parent: XML.Element, tag: str, names: tuple[str, ...]) -> None:
    for name in names:
        XML.SubElement(parent, tag, name=name)


def add_units(root: XML.Element, used: set[str]) -> None:
    units = XML.SubElement(root, "UnitDefinitions")
    for name in sorted(used):
        unit = XML.SubElement(units, "Unit", name=name)
        XML.SubElement(unit, "BaseUnit", {base: str(power) for base, power in UNITS[name].base.items()})
        for shown, factor in UNITS[name].shown.items():
            XML.SubElement(unit, "DisplayUnit", name=shown, factor=repr(factor))


def add_experiment(root: XML.Element, experiment: Experiment) -> None:
    attributes = {"startTime": experiment.start, "stopTime": experiment.stop, "stepSize": experiment.step}
    if experiment.tolerance is not None:
        attributes["tolerance"] = experiment.tolerance
    XML.SubElement(root, "DefaultExperiment", {name: repr(value) for name, value in attributes.items()})
