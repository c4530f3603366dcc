"""Scene files before they mean anything: TOML tables, joined with those that they extend, and where each key stands.

A file may be anything, so what reading costs is bounded here: bytes, depth of tables, number of scenes joined.  A place is a
tuple of keys and of numbers of list entries, from 0, that leads to a value.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import SceneError

SCENE_FOLDER = Path(__file__).parent.parent / "scenes"
BUILTIN_SCENES = ("two_bar", "two_bar_nsh", "three_bar", "three_bar_nsh", "six_bar", "six_bar_nsh")

IDENTIFIER = r"^[A-Za-z][A-Za-z0-9_]*$"

MOST_BYTES = 4_000_000  # of a scene's files together; a tower of 3000 bars has 1.6 million
MOST_ENTRIES = 300_000  # of these files: marks that begin or end a key, a value or a list; such a tower has 160 000
MOST_VALUES = 200_000  # of data from Python, lists counted as one; such a tower has 75 000
MOST_DEPTH = 20  # of tables and lists in each other; a scene has four
MOST_SCENES = 200  # that a scene extends, itself or by others
MOST_BELOW = 50  # scenes of which each extends the next

EXTENDS_MEANING = (
    "the scene that this one changes: a path that ends in .toml (relative to this file), or a built-in scene's name; "
    "or a list of them, where later ones change earlier ones"
)

#: More dots in one key than tables may be deep.  Python's parser takes a time that grows with their square.
DEEP_KEY = re.compile(
    r"""(?<![A-Za-z0-9_-])(?:(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+)"""
    rf"{{{2 * MOST_DEPTH}}}"
)

#: For each place of what is no table the file that it stands in.
Origin = dict[tuple, str]


def read(path: Path) -> tuple[dict, Origin]:
    """The tables of a file, joined with those that it extends.  Raises SceneError."""
    return Reading().read(path, ())


def extended(data: dict, path: Path) -> tuple[dict, Origin]:
    """The same of tables that are there already; `path` is the file that they are taken to stand in."""
    return Reading().extended(plain(data, path), path, ())


class Reading:
    """One scene with all that it extends: every file is read once, and all of them are bounded together."""

    def __init__(self):
        self.bytes, self.entries, self.scenes = 0, 0, 0
        self.known: dict[Path, tuple[dict, Origin]] = {}

    def read(self, path: Path, below: tuple[Path, ...]) -> tuple[dict, Origin]:
        """below: the files that led here, each of which extends the next."""
        found = _resolved(path)
        if found not in self.known:
            self.known[found] = self.extended(_parsed(path, self.text(path)), path, below)
        return self.known[found]

    def text(self, path: Path) -> str:
        try:
            with path.open("rb") as file:
                data = file.read(MOST_BYTES + 1 - self.bytes)
        except FileNotFoundError:
            remedy = f"Check the path; built-in scenes are {', '.join(BUILTIN_SCENES)}."
            raise _refused(path, "does not exist", remedy) from None
        except (OSError, ValueError) as failure:  # ValueError: a null character in the path
            reason = getattr(failure, "strerror", None) or str(failure)
            raise _refused(path, f"cannot be read: {reason}", "Name a readable file.") from None
        self.bytes += len(data)
        if self.bytes > MOST_BYTES:
            problem = f"is too large: a scene's files may have {MOST_BYTES} bytes together"
            raise _refused(path, problem, "Leave out what the scene does not need.")
        self.entries += sum(data.count(mark) for mark in b",=[")
        if self.entries > MOST_ENTRIES:
            problem = f"has about {self.entries} keys and values with what it extends, more than {MOST_ENTRIES}"
            raise _refused(path, problem, "Leave out what the scene does not need, or points of tables.")
        try:
            return data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
        except UnicodeDecodeError as failure:
            problem = f"is not UTF-8 text (byte {failure.start})"
            raise _refused(path, problem, "Save the file as UTF-8.") from None

    def extended(self, raw: dict, path: Path, below: tuple[Path, ...]) -> tuple[dict, Origin]:
        """Join a scene with those that its key `extends` names: tables join, anything else replaces."""
        origin = {place: str(path) for place in _places(raw)}
        if len(origin) > MOST_VALUES:
            problem = f"has {len(origin)} values, more than {MOST_VALUES}"
            raise _refused(path, problem, "Leave out what the scene does not need.")
        if "extends" not in raw:
            return raw, origin
        raw = dict(raw)
        bases = raw.pop("extends")
        bases = [bases] if isinstance(bases, str) else bases
        if not (isinstance(bases, list) and bases and all(isinstance(base, str) for base in bases)):
            raise SceneError(str(path), "extends", bases, "names no scene", f"Give {EXTENDS_MEANING}.")
        self.scenes += len(bases)
        if len(below) >= MOST_BELOW:
            problem = f"goes on after {MOST_BELOW} scenes of which each extends the next"
            raise SceneError(str(path), "extends", bases, problem, "Join some of them in one file.")
        if self.scenes > MOST_SCENES:
            problem = f"makes {self.scenes} scenes to be joined"
            raise SceneError(str(path), "extends", bases, problem, f"Name at most {MOST_SCENES} in all files together.")
        whole: dict = {}
        origins: Origin = {}
        for base in bases:
            base_raw, base_origin = self.read(_base_path(path, base, below), (*below, _resolved(path)))
            whole = _joined(whole, {key: value for key, value in base_raw.items() if key != "name"})
            origins |= base_origin
        return _joined(whole, raw), origins | origin


def _refused(path: Path, problem: str, remedy: str) -> SceneError:
    """The error of a file as a whole."""
    return SceneError(str(path), "(file)", str(path), problem, remedy)


def _parsed(path: Path, text: str) -> dict:
    deep = DEEP_KEY.search(text)
    if deep:
        number = text.count("\n", 0, deep.start()) + 1
        raise _too_deep(path, f"line {number}", text.splitlines()[number - 1])
    try:
        return plain(tomllib.loads(text), path)
    except RecursionError:
        raise _too_deep(path, "(file)", str(path)) from None
    except ValueError as failure:  # also of integers of more than 4300 digits
        raise _syntax_error(path, text, failure) from None


def _too_deep(path: Path, key: str, value: Any) -> SceneError:
    return SceneError(
        str(path), key, value, f"has tables or lists more than {MOST_DEPTH} deep", "No key of a scene needs that."
    )


def _syntax_error(path: Path, text: str, failure: ValueError) -> SceneError:
    place = re.search(r"line (\d+)", str(failure))
    number = int(place.group(1)) if place else None
    lines = text.split("\n")
    value = lines[number - 1].strip() if number and number <= len(lines) else ""
    problem = f"is not TOML: {failure}"
    where = f"line {number}" if number else "(end of file)"
    if not isinstance(failure, tomllib.TOMLDecodeError):
        found = re.search(r"\d{4000}", text.replace("_", ""))
        where, value = "(file)", found.group()[:40] + "..." if found else str(path)
        problem, remedy = "has a number with too many digits", "Write the number in fewer digits, as in 1.5e3."
    elif "overwrite" in str(failure) or "twice" in str(failure):
        problem, remedy = f"a name is used twice: {failure}", "Rename or remove one of the two."
    else:
        remedy = "Correct the line; the form is described at https://toml.io."
    return SceneError(str(path), where, value, problem, remedy)


def plain(data: Any, path: Path, depth: int = 0) -> Any:
    """Data as TOML would hold it: lists for tuples and arrays, Python's numbers for NumPy's; tables are copied."""
    if isinstance(data, (np.ndarray, np.generic)) and np.asarray(data).dtype.kind in "biufU":
        data = data.tolist()
    if not isinstance(data, (dict, list, tuple)):
        return math.inf if type(data) is int and abs(data) > 10**400 else data  # a number that cannot even be written
    if depth >= MOST_DEPTH:
        raise _too_deep(path, "(file)", str(path))
    if isinstance(data, dict):
        return {key: plain(value, path, depth + 1) for key, value in data.items()}
    return [plain(value, path, depth + 1) for value in data]


def _base_path(path: Path, base: str, below: tuple[Path, ...]) -> Path:
    """Where the scene stands that `path` extends; `below`: the files that led to `path`."""
    found = path.parent / base if base.endswith(".toml") else SCENE_FOLDER / f"{base}.toml"
    if (not re.fullmatch(IDENTIFIER, base) and not base.endswith(".toml")) or not is_file(found):
        raise SceneError(str(path), "extends", base, f"{found} does not exist", f"Give {EXTENDS_MEANING}.")
    if _resolved(found) in (*below, _resolved(path)):
        raise SceneError(str(path), "extends", base, "closes a circle of scenes", "Extend a scene outside it.")
    return found


def is_file(path: Path) -> bool:
    """Whether there is such a file; not where the file system can have none of this name."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name that is too long for the file system, or with a null character
        return False


def _resolved(path: Path) -> Path:
    try:
        return path.resolve()
    except (OSError, RuntimeError, ValueError):  # a circle of links, a null character: reading will say so
        return path


def _joined(base: Any, change: Any) -> Any:
    if not (isinstance(base, dict) and isinstance(change, dict)):
        return change
    joined = dict(base)
    for key, value in change.items():
        joined[key] = _joined(base[key], value) if key in base else value
    return joined


def _places(table: dict, above: tuple = ()) -> Iterator[tuple]:
    """Places of all that is not a table."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _places(value, (*above, key))
        else:
            yield (*above, key)


def place_of(key: str) -> tuple:
    """The place of a dotted key as in `nsh.article.zeta[2]`, all of whose names are identifiers."""
    parts = re.findall(r"[^.\[\]]+|\[[0-9]+\]", key)
    return tuple(int(part[1:-1]) - 1 if part.startswith("[") else part for part in parts)


def key_of(place: tuple) -> str:
    """Dotted key; entries of a list count from 1."""
    key = ""
    for part in place:
        key += f"[{part + 1}]" if isinstance(part, int) else f".{part}" if key else str(part)
    return key


def lookup(raw: Any, place: tuple) -> Any:
    """What stands at a place, or None."""
    for part in place:
        if isinstance(raw, dict):
            raw = raw.get(part)
        elif isinstance(raw, (list, tuple)) and isinstance(part, int):
            raw = raw[part] if part < len(raw) else None
        else:
            return None
    return raw


def error(file: str, origin: Origin, place: tuple, value: Any, problem: str, remedy: str) -> SceneError:
    """`file` is the one that was loaded; the key may stand in one that it extends."""
    for n in range(len(place), 0, -1):
        if place[:n] in origin:
            return SceneError(origin[place[:n]], key_of(place), value, problem, remedy)
    return SceneError(file, key_of(place), value, problem, remedy)
