"""NTRT's YAML models as a tree of structures: nodes and pairs in its own coordinates and units.

Source: the page "YAML Model Builder" of NTRTsim's documentation, and for what that leaves open the program itself
(src/yamlbuilder/TensegrityModel.cpp): children are turned first, then scaled, offset and moved; names are looked for breadth
first; a `node_edge` bond moves the second structure so that its nodes meet the middles of the first one's edges, and takes the
strings of these edges away.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ..errors import InputError, nearest
from .imported import content

KEYS = ("nodes", "pair_groups", "builders", "substructures", "bond_groups")
ATTRIBUTES = ("path", "rotation", "translation", "scale", "offset")
MOST_DEEP, MOST_STRUCTURES, MOST_NODES = 20, 2000, 50_000


@dataclass(eq=False)
class Node:
    """own: its name in its structure; name: with those of the structures above it; at: (3,) its place, as NTRT has it."""

    own: str
    name: str
    at: np.ndarray


class Pair(NamedTuple):
    """What builders make into a rod or a string.  file: where it stands."""

    tags: frozenset[str]
    first: Node
    second: Node
    file: Path


class Builder(NamedTuple):
    """How pairs, or nodes, with a tag are built.  kind: its class."""

    kind: str
    parameters: dict[str, float]
    file: Path


@dataclass(eq=False)
class Structure:
    """own: nodes by name; pairs: those that are its own; children: by name."""

    own: dict[str, Node] = field(default_factory=dict)
    pairs: list[Pair] = field(default_factory=list)
    children: dict[str, Structure] = field(default_factory=dict)

    def all(self) -> Iterator[Structure]:
        """It and what it consists of, breadth first."""
        level = [self]
        while level:
            yield from level
            level = [child for one in level for child in one.children.values()]

    def nodes(self) -> list[Node]:
        return [node for one in self.all() for node in one.own.values()]

    def inner(self) -> dict[str, Structure]:
        """What it consists of by name, the first of each."""
        return {name: child for one in reversed([*self.all()]) for name, child in one.children.items()}

    def turn(self, about: np.ndarray, rotation: Rotation) -> None:
        for node in self.nodes():
            node.at = about + rotation.apply(node.at - about)

    def move(self, way: np.ndarray) -> None:
        for node in self.nodes():
            node.at = node.at + way

    def centre(self) -> np.ndarray:
        return np.mean([node.at for node in self.nodes()], axis=0)


class Reader:
    """Reads a model with all files that it names.  builders: tag -> how it is built, as the last file that says it."""

    def __init__(self):
        self.builders: dict[str, Builder] = {}
        self.structures, self.nodes = 0, 0
        self.known: dict[Path, Any] = {}

    def structure(self, path: Path, above: tuple[Path, ...], prefix: str) -> Structure:
        """prefix: of its nodes' names.  above: the files that led here.  Raises InputError."""
        place = path.resolve()
        if place in above or len(above) >= MOST_DEEP:
            raise InputError(f"{path}: a structure stands in itself, or more than {MOST_DEEP} deep; name another file")
        self.structures += 1
        if self.structures > MOST_STRUCTURES:
            raise InputError(f"{path}: makes more than {MOST_STRUCTURES} structures with those before it; use fewer")
        if place not in self.known:
            self.known[place] = parsed(path)
        root, found = self.known[place], Structure()
        for key in root:
            if key not in KEYS:
                raise InputError(f"{path}: {key!r} is no key of a NTRT model; keys are {', '.join(KEYS)}")
        children = table(path, "substructures", root.get("substructures"))
        for names, attributes in children.items():
            self._child(found, path, (*above, place), names, attributes, prefix)
        for name in (name for names in children for name in names.split("/")):
            if name not in found.children:
                raise InputError(f"{path}: substructures: {name} has no path; give the structure's .yaml file")
        _place(found, path, children)
        for tag, builder in table(path, "builders", root.get("builders")).items():
            self.builders[tag] = _builder(path, tag, builder)
        for name, at in table(path, "nodes", root.get("nodes")).items():
            found.own[name] = Node(name, prefix + name, vector(path, f"nodes.{name}", at))
        self.nodes += len(found.own)
        if self.nodes > MOST_NODES:
            raise InputError(f"{path}: makes more than {MOST_NODES} nodes with the files before it; use fewer")
        for tags, pairs in table(path, "pair_groups", root.get("pair_groups")).items():
            for at, pair in enumerate(couples(path, f"pair_groups.{tags}", pairs), 1):
                first, second = (_node(path, f"pair_groups.{tags}[{at}]", found, name) for name in pair)
                found.pairs.append(Pair(frozenset(tags.split()), first, second, path))
        for one, inner in table(path, "bond_groups", root.get("bond_groups")).items():
            for other, pairs in table(path, f"bond_groups.{one}", inner).items():
                self._bonds(found, path, one, other, pairs)
        return found

    def _child(self, found: Structure, path: Path, above: tuple, names: str, attributes: Any, prefix: str) -> None:
        place = f"substructures.{names}"
        for key in table(path, place, attributes):
            if key not in ATTRIBUTES:
                raise InputError(
                    f"{path}: {place}.{key} is no attribute of a structure; attributes are {', '.join(ATTRIBUTES)}"
                )
        named = attributes.get("path")
        if named is None:
            return  # attributes of what stands with its path elsewhere
        if not isinstance(named, str) or "\0" in named:
            raise InputError(f"{path}: {place}.path = {named!r} names no file; give the structure's .yaml file")
        for name in names.split("/"):
            if name in found.children:
                raise InputError(f"{path}: {place}: {name} stands twice; rename one of the two")
            found.children[name] = self.structure(path.parent / named, above, f"{prefix}{name}_")

    def _bonds(self, found: Structure, path: Path, one: str, other: str, pairs: Any) -> None:
        """Tag and bond may stand in each other in both ways: the bond has slashes."""
        place = f"bond_groups.{one}.{other}"
        if ("/" in one) == ("/" in other):
            raise InputError(f"{path}: {place} has not one tag and one bond; write a tag above structure/structure/node_node")
        tags, bond = (other, one) if "/" in one else (one, other)
        *names, kind = bond.split("/")
        if kind not in ("node_node", "node_edge") or len(names) < 2:
            raise InputError(
                f"{path}: {place}: a bond is two structures or more and node_node or node_edge, with slashes between"
            )
        inner = found.inner()
        for name in names:
            if name not in inner:
                raise InputError(f"{path}: {place}: there is no {name}; {nearest(name, inner, 'structures')}")
        for first, second in pairwise(names):
            ends = inner[first], inner[second]
            if kind == "node_edge":
                _join(self, found, path, place, tags, ends, couples(path, place, pairs))
                continue
            for pair in couples(path, place, pairs):
                begin, end = (_node(path, place, structure, name) for structure, name in zip(ends, pair))
                found.pairs.append(Pair(frozenset((*tags.split(), first, second)), begin, end, path))


def _place(found: Structure, path: Path, children: dict[str, Any]) -> None:
    """Turn all children, then scale, offset and move them, each about its own middle where no other point is named."""
    every = [
        (f"substructures.{names}", at, found.children[name], of)
        for names, of in children.items()
        for at, name in _counted(names)
    ]
    for place, _, child, of in every:
        rotation = table(path, f"{place}.rotation", of.get("rotation"))
        if rotation.get("axis") is None or rotation.get("angle") is None or not child.nodes():
            continue
        axis, angle = (
            vector(path, f"{place}.rotation.axis", rotation["axis"]),
            number(path, f"{place}.rotation.angle", rotation["angle"]),
        )
        if not axis.any():
            raise InputError(f"{path}: {place}.rotation.axis is zero; give a direction")
        named = rotation.get("reference")
        about = child.centre() if named is None else vector(path, f"{place}.rotation.reference", named)
        child.turn(about, Rotation.from_rotvec(np.radians(angle) * axis / np.linalg.norm(axis)))
    for place, at, child, of in every:
        if of.get("scale") is not None and child.nodes():
            centre, scale = child.centre(), number(path, f"{place}.scale", of["scale"])
            for node in child.nodes():
                node.at = centre + scale * (node.at - centre)
        if of.get("offset") is not None:
            child.move(at * vector(path, f"{place}.offset", of["offset"]))
        if of.get("translation") is not None:
            child.move(vector(path, f"{place}.translation", of["translation"]))


def _counted(names: str) -> Iterator[tuple[int, str]]:
    return enumerate(names.split("/"))


# --- node_edge bonds -------------------------------------------------------------------------------------------------


def _join(reader: Reader, found: Structure, path: Path, place: str, tags: str, ends: tuple, pairs: list) -> None:
    """Nodes of one structure to the middles of strings of the other."""
    if len(pairs) < 3:
        raise InputError(f"{path}: {place} has {len(pairs)} pairs of a node and an edge; give three at least")
    middles: tuple[list, list] = ([], [])
    nodes: list[list[Node]] = []
    edges: list[list[Node]] = []
    for pair in pairs:
        if ("/" in pair[0]) == ("/" in pair[1]):
            raise InputError(f"{path}: {place}: {' and '.join(pair)} are not a node and an edge; write as in [top, left/right]")
        for structure, name, into in zip(ends, pair, middles):
            joined = [_node(path, place, structure, one) for one in name.split("/")]
            into.append(np.mean([node.at for node in joined], axis=0))
            (nodes if len(joined) == 1 else edges).append(joined)
    _bring(path, place, ends[1], np.array(middles[0]), np.array(middles[1]))
    ligands = [node for (node,) in nodes]
    for ligand, (first, second) in zip(ligands, edges):
        _take_away(reader, path, place, ends, {first, second}, edge=True)
        for another in ligands:
            _take_away(reader, path, place, ends, {ligand, another}, edge=False)
        found.pairs.append(Pair(frozenset(tags.split()), first, ligand, path))
        found.pairs.append(Pair(frozenset(tags.split()), ligand, second, path))


def _bring(path: Path, place: str, second: Structure, to: np.ndarray, own: np.ndarray) -> None:
    """Turn and move a structure until its points meet those of the other: planes, middles, first points."""
    planes = [np.cross(points[1] - points[0], points[2] - points[0]) for points in (own, to)]
    if not all(plane.any() for plane in planes):
        raise InputError(f"{path}: {place}: the first three of a structure's points lie on a line; name others")
    centre, goal = own.mean(axis=0), to.mean(axis=0)
    turn = _between(planes[0], planes[1], own[1] - own[0])
    second.turn(centre, turn)
    second.move(goal - centre)
    first = turn.apply(own[0] - centre)
    second.turn(goal, _between(first, to[0] - goal, planes[1]))


def _between(one: np.ndarray, other: np.ndarray, otherwise: np.ndarray) -> Rotation:
    """The shortest turn of one direction into another; half a turn about `otherwise` between opposite ones."""
    one, other = (way / np.linalg.norm(way) for way in (one, other))
    axis, cosine = np.cross(one, other), float(one @ other)
    sine = float(np.linalg.norm(axis))
    if sine > 1e-9:
        return Rotation.from_rotvec(np.arctan2(sine, cosine) * axis / sine)
    return Rotation.from_rotvec((np.pi if cosine < 0.0 else 0.0) * otherwise / np.linalg.norm(otherwise))


def _take_away(reader: Reader, path: Path, place: str, ends: tuple, nodes: set[Node], edge: bool) -> None:
    """Of each of two structures the pair between these nodes, unless it is a rod."""
    for structure in (one for end in ends for one in end.all()):
        for pair in [pair for pair in structure.pairs if {pair.first, pair.second} == nodes]:
            rigid = any(
                set(tag.split()) <= pair.tags and builder.kind in ("tgRodInfo", "tgBoxInfo")
                for tag, builder in reader.builders.items()
            ) or pair.tags & {"rod", "box"}
            if rigid and edge:
                raise InputError(f"{path}: {place}: the edge {pair.first.name}/{pair.second.name} is a rod; name a string")
            if not rigid:
                structure.pairs.remove(pair)


# --- values ------------------------------------------------------------------------------------------------------------


def _node(path: Path, place: str, structure: Structure, name: str) -> Node:
    """By its name, or by the names of structures above it with dots between."""
    *above, last = name.split(".")
    for child in above:
        inner = structure.inner()
        if child not in inner:
            raise InputError(f"{path}: {place} = {name!r}: there is no {child}; {nearest(child, inner, 'structures')}")
        structure = inner[child]
    for one in structure.all():
        if last in one.own:
            return one.own[last]
    known = [known for one in structure.all() for known in one.own]
    raise InputError(f"{path}: {place}: there is no node {last!r}; {nearest(last, known, 'nodes')}")


def _builder(path: Path, tag: str, value: Any) -> Builder:
    found = table(path, f"builders.{tag}", value)
    if not isinstance(found.get("class"), str):
        raise InputError(f"{path}: builders.{tag} has no class; give one such as tgRodInfo")
    given = table(path, f"builders.{tag}.parameters", found.get("parameters"))
    numbers = {key: number(path, f"builders.{tag}.parameters.{key}", one) for key, one in given.items()}
    return Builder(found["class"], numbers, path)


def table(path: Path, place: str, value: Any) -> dict[str, Any]:
    """Nothing is an empty one; names that YAML reads as numbers are texts."""
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise InputError(f"{path}: {place} = {_shown(value)} is not a table; write names with values below it")
    return {str(key): inner for key, inner in value.items()}


def couples(path: Path, place: str, value: Any) -> list[tuple[str, str]]:
    value = [] if value is None else value
    if not (isinstance(value, list) and all(isinstance(one, list) and len(one) == 2 for one in value)):
        raise InputError(f"{path}: {place} = {_shown(value)} is no list of pairs; write as in - [top, bottom]")
    return [(str(one), str(other)) for one, other in value]


def vector(path: Path, place: str, value: Any) -> np.ndarray:
    if not isinstance(value, list) or len(value) != 3:
        raise InputError(f"{path}: {place} = {_shown(value)} are not three numbers; write as in [0, 5, 0]")
    return np.array([number(path, place, one) for one in value])


def number(path: Path, place: str, value: Any) -> float:
    """YAML reads 1e3 as a text; true and false are the numbers that NTRT makes of them."""
    try:
        found = float(value)
    except (TypeError, ValueError, OverflowError):
        found = np.nan
    if not np.isfinite(found) or abs(found) > 1e15:
        raise InputError(f"{path}: {place} = {_shown(value)} is not a finite number; give one")
    return found


def _shown(value: Any) -> str:
    """Not written out: YAML's references make large things of small files."""
    return repr(value)[:80] if isinstance(value, (str, int, float)) else f"a {type(value).__name__}"


def parsed(path: Path) -> dict[str, Any]:
    """A YAML file's table.  Raises InputError, also for a name that stands twice."""
    try:
        import yaml
    except ModuleNotFoundError:
        raise InputError("NTRT models need PyYAML, which is not installed: pip install pyyaml") from None

    class Strict(yaml.SafeLoader):
        """Names stand once."""

    def mapping(loader: Any, node: Any) -> dict:
        seen = set()
        for key, _ in node.value:
            if key.value in seen:
                raise yaml.constructor.ConstructorError(None, None, f"{key.value!r} stands twice", key.start_mark)
            if isinstance(key.value, str):
                seen.add(key.value)
        return yaml.SafeLoader.construct_mapping(loader, node, deep=True)

    Strict.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, mapping)
    text = re.sub(r"(?<=\S)[ \t]*\t[ \t]*", " ", content(path))  # which YAML has no place for, and NTRT takes
    try:
        found = yaml.load(text, Loader=Strict)
    except RecursionError:
        raise InputError(f"{path} has tables too deep in each other; no NTRT model needs that") from None
    except (yaml.YAMLError, ValueError, TypeError) as failure:
        mark = getattr(failure, "problem_mark", None)
        where = f", line {mark.line + 1}" if mark else ""
        problem = getattr(failure, "problem", None) or str(failure).splitlines()[0]
        raise InputError(f"{path}{where} is not YAML: {problem}; correct it") from None
    return table(path, "the file", found)
