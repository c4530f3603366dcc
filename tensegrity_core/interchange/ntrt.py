"""NTRT's YAML models (NASA Tensegrity Robotics Toolkit) as scenes.

What they mean here: rods are thin bars of density pi r^2 per length; rods that meet are one rigid body, which NTRT makes of
them, so they are welded; rods without density do not move; a pretension is the string's tension at the given coordinates.  y
points up there and z here.  NTRT counts lengths in decimetres (its builder's gravity is 98.1), so forces in tenths of a newton;
stiffness in kg/s2 and damping in kg/s are the same in all units of length.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from .imported import Imported, Names, several
from .ntrt_tree import Builder, Node, Pair, Reader

DECIMETRE = 0.1
#: Classes of builders with their parameters and what these are where nothing is said; None: of controllers, motors, contact.
_CONTACT = {"friction": None, "roll_friction": None, "restitution": None}
_CABLE: dict[str, float | None] = {"stiffness": 1000.0, "damping": 10.0, "pretension": 0.0}
_CABLE |= dict.fromkeys(("history", "max_tension", "target_velocity", "min_actual_length", "min_rest_length", "rotation"))
_EDGES = dict.fromkeys(("moveCablePointAToEdge", "moveCablePointBToEdge"))
_MOTOR = dict.fromkeys(("radius", "motor_friction", "motor_inertia", "back_drivable"))
CLASSES: dict[str, dict[str, float | None]] = {
    "tgRodInfo": {"radius": 0.5, "density": 1.0} | _CONTACT,
    "tgBoxInfo": {"width": 1.0, "height": 1.0, "density": 1.0} | _CONTACT,
    "tgSphereInfo": {"radius": 0.5, "density": 1.0} | _CONTACT,
    "tgBasicActuatorInfo": _CABLE | _EDGES,
    "tgBasicContactCableInfo": _CABLE | _EDGES,
    "tgKinematicActuatorInfo": _CABLE | _MOTOR,
    "tgKinematicContactCableInfo": _CABLE | _MOTOR,
}
RIGID = ("tgRodInfo", "tgBoxInfo")
#: Builders that are there without being named.
USUAL = {"rod": "tgRodInfo", "string": "tgBasicActuatorInfo", "box": "tgBoxInfo", "sphere": "tgSphereInfo"}
#: Nodes closer than this part of the structure's extent are one, as rods that meet there are in NTRT.
SAME = 1e-9


def read(path: Path, unit: float | None) -> Imported:
    """The scene of a NTRT model; see `imported.import_scene`."""
    reader = Reader()
    root = reader.structure(path, (), "")
    for tag, builder in reader.builders.items():
        _require_known(tag, builder)
    return _Scene(path, DECIMETRE if unit is None else unit, reader.builders).made(root)


def _require_known(tag: str, builder: Builder) -> None:
    if builder.kind not in CLASSES:
        known = ", ".join(CLASSES)
        raise InputError(f"{builder.file}: builders.{tag}.class = {builder.kind!r} is not known; classes are {known}")
    for key, value in builder.parameters.items():
        if key not in CLASSES[builder.kind]:
            known = ", ".join(CLASSES[builder.kind])
            raise InputError(f"{builder.file}: builders.{tag}.parameters.{key} is none of {builder.kind}; these are {known}")
        if value < 0.0:
            raise InputError(f"{builder.file}: builders.{tag}.parameters.{key} = {value:g} is less than 0; give 0 or more")


class _Scene:
    """The tables of a scene as they grow.  unit: metres per length of 1; said: builders that the files name, by their tags."""

    def __init__(self, path: Path, unit: float, said: dict[str, Builder]):
        self.path, self.unit, self.said = path, unit, said
        self.builders = {tag: Builder(kind, {}, path) for tag, kind in USUAL.items()} | said
        self.names = Names()
        self.named: dict[int, str] = {}
        self.bars: list[tuple[int, int, float]] = []
        self.strings: list[tuple[int, int, Builder]] = []
        self.masses: dict[int, float] = {}
        self.left_out: dict[str, int] = {}

    def made(self, root: Any) -> Imported:
        self.nodes, self.place = _merged(root.nodes())
        for pair in (pair for one in root.all() for pair in one.pairs):
            self._pair(pair)
        for node in root.nodes():
            self._ball(node)
        bodies = self._bodies()
        fixed = sorted({node for body in bodies if not self._mass(body) for bar in body for node in self.bars[bar][:2]})
        used = sorted({node for one in (*self.bars, *self.strings) for node in one[:2]} | set(self.masses))
        self.named = {node: self.names.take(self.nodes[node].name, "node") for node in used}
        kept = {bar: self.names.take(f"b{bar + 1}", "bar") for body in bodies if self._mass(body) for bar in sorted(body)}
        tables: dict[str, Any] = {"name": _identifier(self.path), "description": f"Imported from {self.path.name} of NTRT"}
        tables |= {"start": "released", "damping_law": "tension_only", "fixed": [self.named[node] for node in fixed]}
        tables["nodes"] = {self.named[node]: self._position(node) for node in used}
        tables["bars"] = {kept[bar]: self._bar(bar) for bar in sorted(kept)}
        tables["weld"] = [[kept[bar] for bar in sorted(body)] for body in bodies if len(body) > 1 and set(body) <= set(kept)]
        tables |= self._string_tables()
        tables["point_masses"] = {self.named[node]: mass for node, mass in sorted(self.masses.items())}
        return Imported(self.path, {key: one for key, one in tables.items() if one not in ({}, [])}, self._notes(len(used)))

    # --- what stands in the file ----------------------------------------------------------------------------------------

    def _match(self, tags: frozenset[str], kinds: tuple[str, ...], where: str) -> Builder | None:
        """The builder whose tags are all among these, the most particular one."""
        found = [
            (len(tag.split()), tag) for tag, one in self.builders.items() if set(tag.split()) <= tags and one.kind in kinds
        ]
        best = [tag for count, tag in found if count == max(found)[0]]
        own = [tag for tag in best if tag in self.said] or best
        if len(own) > 1:
            raise InputError(f"{self.path}: {where} is built by {' and by '.join(sorted(own))}; give it one of these tags")
        return self.builders[own[0]] if own else None

    def _pair(self, pair: Pair) -> None:
        where = f"the pair {pair.first.name}, {pair.second.name} ({' '.join(sorted(pair.tags))})"
        builder = self._match(pair.tags, tuple(kind for kind in CLASSES if kind != "tgSphereInfo"), where)
        if builder is None:
            tags = " ".join(sorted(pair.tags))
            self.left_out[tags] = self.left_out.get(tags, 0) + 1
            return
        ends = self.place[pair.first], self.place[pair.second]
        if ends[0] == ends[1]:
            raise InputError(f"{pair.file}: {where} starts and ends at the same place; join two different nodes")
        if builder.kind not in RIGID:
            self.strings.append((*ends, builder))
            return
        width = [self._value(builder, key) for key in ("width", "height")] if builder.kind == "tgBoxInfo" else []
        area = width[0] * width[1] if width else math.pi * self._value(builder, "radius") ** 2
        length = float(np.linalg.norm(pair.second.at - pair.first.at))
        self.bars.append((*ends, self._value(builder, "density") * area * length))

    def _ball(self, node: Node) -> None:
        builder = self._match(frozenset(node.own.split()), ("tgSphereInfo",), f"the node {node.name}")
        if builder:
            mass = 4.0 / 3.0 * math.pi * self._value(builder, "radius") ** 3 * self._value(builder, "density")
            self.masses[self.place[node]] = self.masses.get(self.place[node], 0.0) + mass

    def _value(self, builder: Builder, key: str) -> float:
        usual = CLASSES[builder.kind][key]
        return builder.parameters.get(key, 0.0 if usual is None else usual)

    # --- what it means here ---------------------------------------------------------------------------------------------

    def _bodies(self) -> list[list[int]]:
        """Bars that share nodes, which NTRT makes one rigid body, body by body."""
        owner: dict[int, list[int]] = {}
        for bar, (first, second, _) in enumerate(self.bars):
            joined = {id(one): one for one in (owner.get(first), owner.get(second)) if one}
            body = sorted([bar, *(other for one in joined.values() for other in one)])
            for node in {end for one in body for end in self.bars[one][:2]}:
                owner[node] = body
        return sorted({id(body): body for body in owner.values()}.values())

    def _mass(self, body: list[int]) -> float:
        return sum(self.bars[bar][2] for bar in body)

    def _position(self, node: int) -> list[float]:
        x, y, z = (self.unit * self.nodes[node].at).tolist()
        return [x, 0.0 - z, y]

    def _bar(self, bar: int) -> dict[str, Any]:
        first, second, mass = self.bars[bar]
        return {"nodes": [self.named[first], self.named[second]], "mass": mass}

    def _string_tables(self) -> dict[str, Any]:
        strings: dict[str, Any] = {}
        tension: dict[str, float] = {}
        for at, (first, second, builder) in enumerate(self.strings, 1):
            name = self.names.take(f"s{at}", "string")
            strings[name] = {"nodes": [self.named[first], self.named[second]]}
            strings[name] |= {key: self._value(builder, key) for key in ("stiffness", "damping")}
            tension[name] = self.unit * self._value(builder, "pretension")
        return {"strings": strings, "prestress": {"tension": tension}} if strings else {}

    def _notes(self, used: int) -> tuple[str, ...]:
        notes = [
            f"Lengths of 1 were read as {self.unit:g} m, y as up (z here).",
            "Rods are thin here: they do not turn about their own axes, and strings end at nodes, not on a rod's surface.",
            "NTRT bounds the force of a string's damper by that of its spring; here it can do no more than unload the string.",
            "The ground and its friction are left out.",
        ]
        if self.masses:
            notes.append("Spheres are point masses at their nodes.")
        if len(self.nodes) > used:
            notes.append(f"{len(self.nodes) - used} nodes that nothing is built on are left out.")
        ignored = {key for one in self.builders.values() for key in one.parameters if CLASSES[one.kind][key] is None}
        if ignored:
            notes.append(f"Parameters of controllers, motors and contact are left out: {', '.join(sorted(ignored))}.")
        notes += [
            f"{count} pairs with the tags '{tags}' are left out: no builder has these." for tags, count in self.left_out.items()
        ]
        return (*notes, *several(self.names.renamed))


def _merged(nodes: list[Node]) -> tuple[list[Node], dict[Node, int]]:
    """Nodes, those at one place once, and each node's place among them."""
    if not nodes:
        return [], {}
    points = np.array([node.at for node in nodes])
    grain = SAME * max(float(np.ptp(points, axis=0).max()), 1e-9)
    kept: list[Node] = []
    at: dict[tuple, int] = {}
    place = {}
    for node, cell in zip(nodes, map(tuple, np.round(points / (1e3 * grain)).astype(np.int64).tolist())):
        if cell not in at:
            at[cell] = len(kept)
            kept.append(node)
        place[node] = at[cell]
    return kept, place


def _identifier(path: Path) -> str:
    return Names().take(path.stem, "scene")
