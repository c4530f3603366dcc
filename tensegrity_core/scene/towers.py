"""Towers of any number of stages, as scenes.

A stage is a prism of three bars with a 170 degree twist, the three-bar structure of the article; stages follow each
other with alternating handedness, each standing a little below the top of the one before (the overlap).  Strings join
them as in the two-stage tower: *saddle* strings between the six nodes of an interface, *vertical* ones within a stage,
*diagonal* ones from bottom to bottom (lower) and from top to top (upper) of neighbouring stages, and *top* ones around
the last triangle.  With n stages there are 3 n bars, 15 n - 9 strings (6 for n = 1) and three fixed nodes.  The name
"saddle, vertical, diagonal" is that of Sultan and Skelton, "Deployment of tensegrity structures", International Journal
of Solids and Structures 40, 2003, 4637-4657.

Coordinates and prestress
    One and two stages are the built-in scenes three_bar and six_bar, to the millimetre and the newton.  From three stages
    on the given coordinates and tensions are close to a self-stress without loads, and settling moves nodes by millimetres:

    In an endless tower of this geometry all nodes are alike, so three equations of equilibrium (along the tangent, the
    radius and the axis) give three force densities as parts of the fourth (`inner_densities`).  At the ends a diagonal is
    missing on the nodes of the first and of the last interface.  The lower diagonals of the first interface and the
    upper ones of the last one make up for it, with twice the force density; the top strings have a third of a
    saddle string's.  Axial balance of the first stage's top then asks for an overlap there that is half as large again
    (`END_OVERLAP`), and that of the last triangle settles the overlap of the others (`INNER_OVERLAP`, the one that
    settled towers have far from their ends): at other overlaps the tension of the diagonals would rise or fall along
    the tower, and the last stages would be far from where they are given.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..quantities import number
from .entries import Scene
from .loading import parse_scene
from .toml_text import toml

MOST_STAGES = 1000
EARTH = 9.81  # m/s2
BORNE_STAGES = 2  # stages that stand under gravity by default, as the built-in scenes do

RADIUS, HEIGHT = 0.95, 0.848  # m, of a stage
TWIST = 170  # degrees from a bar's bottom to its top, backwards in stages 1, 3, ... and forwards in 2, 4, ...
VERTICAL_TWIST, DIAGONAL_TWIST = TWIST - 120, 180 - TWIST
TWO_STAGE_OVERLAP, END_OVERLAP, INNER_OVERLAP = 0.254, 0.209, 0.1406  # m
#: Angles of the nodes at the bottom and at the top of a stage, degrees: stages 1, 3, ... and 2, 4, ...
RINGS = (((30, 150, 270), (340, 220, 100)), ((160, 280, 40), (210, 330, 90)))

SADDLE_TENSION = 40.0  # N
#: Tensions of the two-stage tower as parts of its saddle strings': those of the scene six_bar.
TWO_STAGE_TENSIONS = {"saddle": 1.0, "vertical": 0.25, "lower diagonal": 0.25, "upper diagonal": 0.25, "top": 0.55}


class Member(NamedTuple):
    """kind: 'bar', 'saddle', ...; stage: the one that it belongs to, or the lower of its two, from 0; ends: its nodes."""

    kind: str
    stage: int
    ends: tuple[int, int]


def tower(stages: int, nsh: bool = False, **options: Any) -> Scene:
    """A tower of 1 to 1000 stages, as `load_scene` would return it.

    nsh: the vertical strings above the first stage (those of a single stage) and the upper diagonals carry the
    article's NSH.

    Options, all in SI units:
        gravity: m/s2; by default 9.81 for one or two stages and 0 for more: at the default tension the strings of a third
            stage go slack under its weight.
        tension: N, of the saddle strings between inner stages; default 40; all others go with it.  Without saddle strings
            (one stage) equilibrium under gravity sets the tensions, and it must not be given.
        stiffness: k of all strings, N/m, default 5000; damping: d, N s/m, default 500.
        mass: of each bar, kg, default 1.

    The start is the settled equilibrium near the given coordinates (for one stage: at them).
    Raises InputError or SceneError for what is out of range.
    """
    return parse_scene(_tables(stages, nsh, **options), file=f"tower({stages})")


def tower_text(stages: int, nsh: bool = False, **options: Any) -> str:
    """The same tower as the text of a scene file, whose model is the same to the last bit; arguments as of `tower`."""
    tables = _tables(stages, nsh, **options)
    parse_scene(tables, file=f"tower({stages})")
    heads = {f"s{i}": head for i, head in _headings(members(stages))}
    lines = [f"{key} = {toml(value)}" for key, value in tables.items() if not isinstance(value, dict)]
    lines += _table_lines("nodes", tables["nodes"])
    for name, material in tables["materials"].items():
        lines += _table_lines(f"materials.{name}", material)
    lines += _table_lines("bars", tables["bars"])
    lines += _table_lines("strings", tables["strings"], heads)
    if stages > 1:
        lines += ["", "# Tensions at the coordinates above; they fix the rest lengths."]
        lines += _table_lines("prestress.tension", tables["prestress"]["tension"])[1:]
    return "\n".join(lines) + "\n"


# --- geometry ----------------------------------------------------------------------------------------------------


def overlaps(stages: int) -> list[float]:
    """(stages - 1,) m: how far each stage begins below the top of the one before."""
    if stages <= 2:
        return [TWO_STAGE_OVERLAP] * (stages - 1)
    return [END_OVERLAP, *[INNER_OVERLAP] * (stages - 3), END_OVERLAP]


def coordinates(stages: int) -> np.ndarray:
    """(6 stages, 3) m: bottom and top triangle of each stage in turn."""
    bottom = np.concatenate([[0.0], np.cumsum(HEIGHT - np.array(overlaps(stages)))])
    rows = []
    for stage in range(stages):
        for ring, z in zip(RINGS[stage % 2], (bottom[stage], bottom[stage] + HEIGHT)):
            rows += [(RADIUS * math.cos(math.radians(a)), RADIUS * math.sin(math.radians(a)), z) for a in ring]
    return np.round(rows, 3 if stages <= 2 else 9) + 0.0  # no -0


def members(stages: int) -> list[Member]:
    """Bars and strings of all stages, from the ground up."""
    return [member for stage in range(stages) for member in _stage(stage, stage == stages - 1)]


def _stage(stage: int, last: bool) -> Iterator[Member]:
    """A stage's bars and strings, and the strings to the next one."""
    hand = 1 if stage % 2 else -1
    (bottom, top), (next_bottom, next_top) = RINGS[stage % 2], RINGS[1 - stage % 2]
    low = 6 * stage  # its first node; then follow its top (+3), the next bottom (+6) and top (+9)
    for i, angle in enumerate(bottom):
        yield Member("bar", stage, (low + i, low + 3 + _at(top, angle + hand * TWIST)))
    for i, angle in enumerate(bottom):
        yield Member("vertical", stage, (low + i, low + 3 + _at(top, angle + hand * VERTICAL_TWIST)))
    if last:
        for i in range(3):
            yield Member("top", stage, (low + 3 + i, low + 3 + (i + 1) % 3))
        return
    for i, angle in enumerate(top):
        for side in (60, -60):
            yield Member("saddle", stage, (low + 3 + i, low + 6 + _at(next_bottom, angle + side)))
    for i, angle in enumerate(bottom):
        yield Member("lower diagonal", stage, (low + i, low + 6 + _at(next_bottom, angle - hand * DIAGONAL_TWIST)))
    for i, angle in enumerate(top):
        yield Member("upper diagonal", stage, (low + 3 + i, low + 9 + _at(next_top, angle + hand * DIAGONAL_TWIST)))


def _at(ring: tuple[int, ...], angle: int) -> int:
    return ring.index(angle % 360)


# --- prestress ---------------------------------------------------------------------------------------------------


def inner_densities() -> dict[str, float]:
    """Force densities of an endless tower in self-stress, as parts of a saddle string's; of bars: in compression.

    On a node on top of a stage, from its seven members (bar b, vertical v, two saddle strings, two diagonals u each of
    which meets a like node of a neighbouring stage):
    along the tangent   v sin 50 = (b + 2 u) sin 10
    along the radius    b (1 + cos 10) = v (1 - cos 50) + 1 + 2 u (1 - cos 10)
    along the axis      b H = v H + 2 h, with the height H and the overlap h; the diagonals up and down cancel.
    """
    ten, fifty = math.radians(DIAGONAL_TWIST), math.radians(VERTICAL_TWIST)
    matrix = [
        [-math.sin(ten), math.sin(fifty), -2.0 * math.sin(ten)],
        [1.0 + math.cos(ten), math.cos(fifty) - 1.0, 2.0 * (math.cos(ten) - 1.0)],
        [HEIGHT, -HEIGHT, 0.0],
    ]
    bar, vertical, diagonal = np.linalg.solve(matrix, [0.0, 1.0, 2.0 * INNER_OVERLAP]).tolist()
    return {"bar": bar, "vertical": vertical, "diagonal": diagonal}


def _tensions(stages: int, nodes: np.ndarray, strings: list[Member], saddle: float) -> list[float]:
    """Tensions of the strings, N, where the saddle strings between inner stages have this one."""
    if stages == 2:
        return [TWO_STAGE_TENSIONS[string.kind] * saddle for string in strings]
    inner, unit = inner_densities(), saddle / math.hypot(RADIUS, INNER_OVERLAP)
    ends = np.array([string.ends for string in strings])
    length = np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1)
    return [round(unit * _density(string, stages, inner) * float(x), 6) for string, x in zip(strings, length)]


def _density(string: Member, stages: int, inner: dict[str, float]) -> float:
    """A string's force density as part of a saddle string's."""
    if string.kind in ("lower diagonal", "upper diagonal"):
        end = 0 if string.kind == "lower diagonal" else stages - 2
        return (2.0 if string.stage == end else 1.0) * inner["diagonal"]
    return {"saddle": 1.0, "vertical": inner["vertical"], "top": 1.0 / 3.0}[string.kind]


# --- the scene ---------------------------------------------------------------------------------------------------


def _tables(
    stages: int,
    nsh: bool,
    gravity: float | None = None,
    tension: float | None = None,
    stiffness: float = 5000.0,
    damping: float = 500.0,
    mass: float = 1.0,
) -> dict[str, Any]:
    """The scene as nested dicts, the form that its file has."""
    whole = isinstance(stages, (int, np.integer)) and not isinstance(stages, bool) and np.ndim(stages) == 0
    if not whole or not 1 <= stages <= MOST_STAGES:
        raise InputError(f"stages = {stages!r} is not a whole number from 1 to {MOST_STAGES}; give one")
    if tension is not None and stages == 1:
        raise InputError(f"tension = {tension!r}: one stage has no saddle strings; leave it out, its gravity sets the tensions")
    stages, nsh = int(stages), bool(nsh)
    given = {"gravity": gravity, "tension": tension, "stiffness": stiffness, "damping": damping, "mass": mass}
    gravity, tension = (None if given[key] is None else number(key, given[key]) for key in ("gravity", "tension"))
    stiffness, damping, mass = (number(key, given[key]) for key in ("stiffness", "damping", "mass"))
    nodes, found = coordinates(stages), members(stages)
    bars = [member for member in found if member.kind == "bar"]
    strings = [member for member in found if member.kind != "bar"]
    tables: dict[str, Any] = {"extends": "article_nsh"} if nsh else {}
    tables["name"] = f"tower{stages}" + ("_nsh" if nsh else "")
    count = "one stage" if stages == 1 else f"{stages} stages"
    tables["description"] = f"Tower of {count}, three bars each" + (", with NSH" if nsh else "")
    tables["source"] = "made by tensegrity_core.scene.towers from the three-bar stage of the article on tensegrity with NSH"
    tables["gravity"] = float(gravity if gravity is not None else EARTH if stages <= BORNE_STAGES else 0.0)
    tables["start"] = "equilibrium" if stages == 1 else "settled"
    tables["fixed"] = ["n1", "n2", "n3"]
    tables["nodes"] = {f"n{i}": point for i, point in enumerate(nodes.tolist(), 1)}
    tables["materials"] = {"cable": {"stiffness": float(stiffness), "damping": float(damping)}}
    tables["bars"] = {f"b{i}": {"nodes": _names(bar), "mass": float(mass)} for i, bar in enumerate(bars, 1)}
    tables["strings"] = {f"s{i}": _string(string, stages, nsh) for i, string in enumerate(strings, 1)}
    if stages > 1:
        level = float(SADDLE_TENSION if tension is None else tension)
        tensions = _tensions(stages, nodes, strings, level)
        tables["prestress"] = {"tension": {f"s{i}": pull for i, pull in enumerate(tensions, 1)}}
    return tables


def _string(string: Member, stages: int, nsh: bool) -> dict[str, Any]:
    table = {"nodes": _names(string), "material": "cable"}
    if nsh and (string.kind == "upper diagonal" or (string.kind == "vertical" and (string.stage > 0 or stages == 1))):
        table["nsh"] = "article"
    return table


def _names(member: Member) -> list[str]:
    return [f"n{end + 1}" for end in member.ends]


# --- its text ----------------------------------------------------------------------------------------------------


def _headings(found: list[Member]) -> Iterator[tuple[int, str]]:
    """The number of the first string of each kind in each stage, and a comment that stands above it."""
    before, number = None, 0
    for member in found:
        if member.kind == "bar":
            continue
        number += 1
        if (member.kind, member.stage) != before:
            to = "" if member.kind in ("vertical", "top") else f" to {member.stage + 2}"
            yield number, f"# stage {member.stage + 1}{to}: {member.kind}"
        before = (member.kind, member.stage)


def _table_lines(name: str, table: dict[str, Any], heads: dict[str, str] | None = None) -> list[str]:
    lines = ["", f"[{name}]"]
    for key, value in table.items():
        if heads and key in heads:
            lines.append(heads[key])
        lines.append(f"{key} = {toml(value)}")
    return lines
