"""A structure that was read from another program's file, as a scene."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from .. import statics
from ..errors import InputError, TensegrityError
from ..files import write_text
from ..model import Model
from ..scene import parse_scene
from ..scene.checks import RESERVED_NAMES, VARIABLE_WORDS
from ..scene.toml_text import scene_text

#: Of an imported file, and of all that it includes.
MOST_BYTES = 20_000_000
#: Ending -> module that reads it, which has a function `read(path, unit)`.
READERS = {".csv": "csv_tables", ".yaml": "ntrt", ".yml": "ntrt", ".xml": "mjcf_reading", ".mjcf": "mjcf_reading"}


@dataclass(frozen=True)
class Imported:
    """tables: of the scene, as its file has them; notes: what of the other file means something else here, or nothing."""

    path: Path
    tables: dict[str, Any]
    notes: tuple[str, ...] = ()

    def text(self) -> str:
        """The scene file, with the notes as comments."""
        return scene_text(self.tables, self.notes)

    def model(self) -> Model:
        """Raises SceneError where the structure cannot start so."""
        return statics.build_model(parse_scene(self.tables, str(self.path)))

    def save(self, path: str | Path) -> Path:
        """Write the scene file, whole or not at all.  Raises InputError where that cannot be done."""
        write_text(path, self.text())
        return Path(path)


def import_scene(path: str | Path, unit: float | None = None) -> Imported:
    """The structure in a file of another program: a NTRT model (.yaml), a MuJoCo model (.xml), or tables of nodes and members
    (nodes.csv, with members.csv beside it).

    unit: metres that a length of 1 means there, None: as these programs have it (0.1 of NTRT, else 1).  Raises TensegrityError
    for a file that cannot be read, and for what cannot be a scene.
    """
    path = Path(path)
    if path.suffix.lower() not in READERS:
        raise InputError(f"{path} is none of the files that can be imported; name one that ends in {', '.join(READERS)}")
    if unit is not None and not 1e-6 <= unit <= 1e6:
        raise InputError(f"unit = {unit!r}: give the metres that a length of 1 means, from 1e-6 to 1e6")
    found: Imported = importlib.import_module(f"{__package__}.{READERS[path.suffix.lower()]}").read(path, unit)
    scene = parse_scene(found.tables, str(path))
    try:
        statics.build_model(scene)
    except TensegrityError as failure:
        return Imported(path, found.tables, (*found.notes, f"It cannot start as it stands: {failure}"))
    return found


def content(path: Path) -> str:
    """A text file.  Raises InputError where it cannot be read, is too large, or is no text."""
    try:
        with path.open("rb") as file:
            data = file.read(MOST_BYTES + 1)
    except (OSError, ValueError) as failure:
        reason = getattr(failure, "strerror", None) or str(failure)
        raise InputError(f"{path} cannot be read: {reason}; name another file") from None
    if len(data) > MOST_BYTES:
        raise InputError(f"{path} has more than {MOST_BYTES} bytes; leave out what the structure does not need")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as failure:
        raise InputError(f"{path} is not UTF-8 text (byte {failure.start}); save it as UTF-8") from None


class Names:
    """Identifiers for names of another program, each once; what had to be renamed is told."""

    def __init__(self):
        self.taken: set[str] = set()
        self.renamed: list[str] = []

    def take(self, wanted: str, kind: str) -> str:
        """kind: what it names, in one word; the name of what has none begins with its first letter."""
        first, *words = re.sub(r"\W", "_", wanted, flags=re.ASCII).strip("_")[:100].split("_")
        name = first if first[:1].isalpha() else kind[0] + first
        for word in words:  # n4_force would read like a variable of n4
            name += word if word in VARIABLE_WORDS or name in RESERVED_NAMES or not word else f"_{word}"
        name, base, count = name, name, 1
        while name in self.taken or name in RESERVED_NAMES:
            count += 1
            name = f"{base}_{count}"
        self.taken.add(name)
        if name != wanted and wanted:
            self.renamed.append(f"{kind} {wanted!r} is {name} here")
        return name

    def notes(self) -> list[str]:
        return several(self.renamed)


def several(lines: Iterable[str], most: int = 12) -> list[str]:
    """The first of these lines, and how many more there are."""
    found = list(lines)
    return found[:most] + ([f"... and {len(found) - most} more of the same kind"] if len(found) > most else [])
