"""Tables of nodes and members: nodes.csv, members.csv beside it and, where the defaults of a scene will not do, scene.csv.

A column is a key of a scene file; an empty cell leaves it out.  nodes.csv: name, x, y, z (m; two of them in a planar scene),
fixed (empty, `yes`, or the axes, as in `xz`), mass (kg, of the node itself), vx, vy, vz (m/s), drag (N s/m).  members.csv:
name, kind (`bar` or `string`), nodes (names with spaces between), and the keys below; bars with the same word in `weld` are one
rigid body.  scene.csv: key, value.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..errors import InputError
from .imported import Imported, content

NODE = ("name", "x", "y", "z", "fixed", "mass", "vx", "vy", "vz", "drag")
BAR = ("mass", "E", "diameter", "wall", "area", "second_moment")
STRING = ("mass", "stiffness", "damping", "tension", "rest_length", "force_density", "strength", "two_way")
MEMBER = ("name", "kind", "nodes", *dict.fromkeys((*BAR, *STRING)), "weld")
SCENE = ("name", "description", "source", "plane", "gravity", "damping_law", "string_mass_matrix", "start")
KNOWN = ("tension", "rest_length", "force_density")  # of strings, in [prestress]
YES, NO = ("yes", "true", "1", "x y z", "xyz"), ("", "no", "false", "0")


class Row:
    """A row of a table; errors name file, row and column."""

    def __init__(self, path: Path, number: int, cells: dict[str, str]):
        self.path, self.number, self.cells = path, number, cells

    def error(self, column: str, problem: str, remedy: str) -> InputError:
        return InputError(f"{self.path}, row {self.number}, {column} = {self.cells.get(column, '')!r}: {problem}; {remedy}")

    def text(self, column: str) -> str:
        return self.cells.get(column, "")

    def name(self) -> str:
        if not self.text("name"):
            raise self.error("name", "is missing", "give each row a name")
        return self.text("name")

    def number_of(self, column: str) -> float:
        try:
            return float(self.text(column))
        except ValueError:
            raise self.error(column, "is not a number", "write one, with a point for decimals") from None

    def numbers(self, columns: Iterable[str]) -> dict[str, Any]:
        """Those of these columns that are filled."""
        return {column: self.number_of(column) for column in columns if self.text(column)}

    def flag(self, column: str) -> bool:
        word = self.text(column).lower()
        if word not in (*YES, *NO):
            raise self.error(column, "is neither yes nor no", "write yes, or leave it empty")
        return word in YES


def beside(path: Path, what: str) -> Path:
    """The table of `what` beside that of nodes: bridge_members.csv of bridge_nodes.csv."""
    stem, found, rest = path.stem.rpartition("nodes")
    if not found:
        raise InputError(f"{path}: the table of nodes has `nodes` in its name, as nodes.csv or bridge_nodes.csv; rename it")
    return path.with_name(f"{stem}{what}{rest}{path.suffix}")


def _rows(path: Path, known: tuple[str, ...]) -> list[Row]:
    rows = list(csv.reader(io.StringIO(content(path)), skipinitialspace=True))
    filled = [(at, [cell.strip() for cell in row]) for at, row in enumerate(rows, 1) if any(map(str.strip, row))]
    header = filled[0][1] if filled else []
    if len(header) == 1 and ";" in header[0]:
        raise InputError(f"{path}: its columns are separated by semicolons; separate them with commas")
    for column in header:
        if column not in known or header.count(column) > 1:
            problem = "stands twice" if column in known else "is no column of this table"
            raise InputError(f"{path}: the column {column!r} {problem}; columns are {', '.join(known)}")
    for at, row in filled[1:]:
        if len(row) != len(header):
            raise InputError(f"{path}, row {at} has {len(row)} cells, the header {len(header)}; give one for each column")
    return [Row(path, at, dict(zip(header, row))) for at, row in filled[1:]]


def read(path: Path, unit: float | None) -> Imported:
    """The scene of nodes.csv and what stands beside it; see `imported.import_scene`."""
    if unit is not None:
        raise InputError(f"unit = {unit!r}: tables are in SI units; leave it out")
    top = _top(beside(path, "scene")) if beside(path, "scene").exists() else {}
    tables: dict[str, Any] = {"name": path.parent.resolve().name if path.stem == "nodes" else path.stem.rpartition("_nodes")[0]}
    if not tables["name"].isidentifier() or not tables["name"].isascii():
        tables["name"] = "imported"
    tables |= {"start": "equilibrium"} | top
    tables["fixed"] = []
    axes = tables.get("plane", "xyz")
    tables |= {"nodes": {}, "bars": {}, "weld": [], "strings": {}, "point_masses": {}, "drag": {}, "velocities": {}}
    tables["prestress"] = {key: {} for key in KNOWN}
    for row in _rows(path, NODE):
        _node(tables, row, axes)
    welds: dict[str, list[str]] = {}
    for row in _rows(beside(path, "members"), MEMBER):
        _member(tables, row, welds)
    tables["weld"] = list(welds.values())
    tables["prestress"] = {key: table for key, table in tables["prestress"].items() if table}
    return Imported(path, {key: value for key, value in tables.items() if value not in ({}, [])})


def _top(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for row in _rows(path, ("key", "value")):
        key, value = row.text("key"), row.text("value")
        if key not in SCENE:
            raise row.error("key", "is no key of this table", f"keys are {', '.join(SCENE)}")
        found[key] = value
        if key == "gravity":
            try:
                numbers = [float(word) for word in value.split()]
            except ValueError:
                numbers = []
            if len(numbers) not in (1, 3):
                raise row.error("value", "is neither a number nor three", "write 9.81, or as in 0 0 -9.81")
            found[key] = numbers if len(numbers) == 3 else numbers[0]
    return found


def _node(tables: dict[str, Any], row: Row, axes: str) -> None:
    name = row.name()
    if name in tables["nodes"]:
        raise row.error("name", "stands twice", "rename one of the two")
    tables["nodes"][name] = [row.number_of(axis) for axis in axes]
    fixed = row.text("fixed").lower()
    if fixed in YES:
        tables["fixed"].append(name)
    elif fixed not in NO:
        if not set(fixed.replace(" ", "")) <= set(axes):
            raise row.error("fixed", "is neither yes nor axes", f"write yes, or some of {axes}, or leave it empty")
        along = [axis for axis in axes if axis in fixed]
        tables["fixed"] += [name] if len(along) == len(axes) else [f"{name}.{axis}" for axis in along]
    if row.text("mass"):
        tables["point_masses"][name] = row.number_of("mass")
    if row.text("drag"):
        tables["drag"][name] = row.number_of("drag")
    if any(row.text(f"v{axis}") for axis in axes):
        tables["velocities"][name] = [row.number_of(f"v{axis}") if row.text(f"v{axis}") else 0.0 for axis in axes]


def _member(tables: dict[str, Any], row: Row, welds: dict[str, list[str]]) -> None:
    name, kind = row.name(), row.text("kind").lower()
    if kind not in ("bar", "string"):
        raise row.error("kind", "is no kind of a member", "write bar or string")
    if name in tables["bars"] or name in tables["strings"]:
        raise row.error("name", "stands twice", "rename one of the two")
    own, others = (BAR, STRING) if kind == "bar" else (STRING, BAR)
    for column in (*others, *(() if kind == "bar" else ("weld",))):
        if row.text(column) and column not in own:
            raise row.error(column, f"does not belong to a {kind}", "leave it empty")
    member: dict[str, Any] = {"nodes": row.text("nodes").split()}
    member |= row.numbers(column for column in own if column not in (*KNOWN, "two_way"))
    if kind == "string":
        if row.flag("two_way"):
            member["two_way"] = True
        for key, value in row.numbers(KNOWN).items():
            tables["prestress"][key][name] = value
    elif row.text("weld"):
        welds.setdefault(row.text("weld"), []).append(name)
    tables[f"{kind}s"][name] = member
