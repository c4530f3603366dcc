"""The model inside an FMU of this project: its packed form in the resources, and the names in its description."""

from __future__ import annotations

import zipfile
from pathlib import Path
from xml.etree import ElementTree as XML

from ...errors import InputError
from ...fields import layout
from ...kernel.unpacking import counts_of, from_bytes
from ...model import Model
from ...model.components import AXES

#: Fields that every string, bar and node has, and the end of their variables' names.
NAMED = {"string_length": "length", "bar_force": "force"}


def model_of_fmu(path: Path) -> Model:
    """The model that an FMU simulates, of any kind, version of FMI, and naming of variables.  Raises InputError."""
    shown = f"FMU = {str(path)!r}"
    try:
        with zipfile.ZipFile(path) as archive:
            packed = archive.read("resources/model.bin")
            description = XML.fromstring(archive.read("modelDescription.xml"))
    except KeyError as missing:
        raise InputError(f"{shown} is none of this project's: {missing.args[0]}; build one: tensegrity build SCENE") from None
    except (OSError, zipfile.BadZipFile, XML.ParseError) as failure:
        raise InputError(f"{shown} cannot be read: {failure}; build it anew: tensegrity build SCENE") from None
    names = _names(description)
    counts = counts_of(packed)
    found = {name: [names.get(reference, "") for reference in range(at.start, at.stop)] for name, at in layout(counts).items()}
    if not all(found["position"]):
        raise InputError(f"{shown} is of an actuator alone, which has no structure; name the structure's FMU")
    strings, bars = ([name[: -len(end) - 1] for name in found[field]] for field, end in NAMED.items())
    axes = [AXES.index(name[-1]) for name in found["position"][: counts["D"]]]
    nodes = [name[:-2] for name in found["position"][:: counts["D"]]]
    text = description.get("description", "")
    return from_bytes(packed, nodes, bars, strings, axes, description.get("modelName", path.stem), text)


def _names(description: XML.Element) -> dict[int, str]:
    """Value reference -> name of the variable, of elements of arrays as FMI 2.0 calls them: n4.z of n4.position."""
    found = {}
    for row in description.findall("ModelVariables/*"):
        name, reference = row.get("name", ""), int(row.get("valueReference", -1))
        found[reference] = name
        if row.find("Dimension") is not None and name.endswith("position"):
            axes = row.get("description", "").rpartition("; ")[2].split(", ")
            found |= {reference + i: f"{name[: -len('.position')]}.{axis}" for i, axis in enumerate(axes)}
    return found
