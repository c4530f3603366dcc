"""Checks of a scene as a whole, which no key of it can make alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

from ..fields import owned_words, shared_words
from ..model.elements import KINDS, key_of
from ..model.welds import joined
from . import costs
from .entries import Entry, Scene
from .ground import check_ground
from .messages import require_known, twice

#: Names that are not a component's: they stand at the top of the simulation's variables, or mean the time.
RESERVED_NAMES = shared_words() | {"time"}

#: Names that Windows keeps for devices, with any ending; a scene's name becomes the names of files.
DEVICES = ("con", "prn", "aux", "nul", *(f"{port}{i}" for port in ("com", "lpt") for i in range(1, 10)))

#: First words of the variables that a component owns (`n4.force.x`, `s1.rest_length`, ...).
VARIABLE_WORDS = owned_words()

#: Keys of a string that name something -> the tables in which it stands.
STRING_TABLES = {"material": "materials", "nsh": "nsh", "element": "elements", "damper": "dampers", "actuator": "actuators"}

#: Keys of a bar that say what it bears.
SECTION_KEYS = ("E", "diameter", "wall", "area", "second_moment")

SHORTEST = 1e-9  # m: below this a member has no usable direction
MOST_LEVELS = 20  # of elements in each other
MOST_PARTS = 1000  # elements that one string may be made of
MOST_MEMORY = 12  # beams and other parts that snap in one series with memory
MOST_PASSED = 300  # nodes that a string passes: its stiffness ties each to each
MOST_WELDED = 100  # bars of one rigid body
MOST_POINTS = 50_000  # of all tables of a scene
MOST_COST = 4.0  # s, about what working out all force laws may take; see `costs`


def _check_names(scene: Scene) -> None:
    if scene.name.lower() in DEVICES:
        raise scene.error("name", "is a device's name on Windows, where no file can have it", "Give the scene another name.")
    kinds: dict[str, dict[str, Any]] = {"nodes": scene.nodes, "bars": scene.bars, "strings": scene.strings}
    seen: dict[str, str] = {}
    words = VARIABLE_WORDS if scene.ground is not None else VARIABLE_WORDS - {"contact"}
    reserved = RESERVED_NAMES if scene.ground is not None else RESERVED_NAMES - {"ground"}
    for kind, table in kinds.items():
        for name in table:
            if name in reserved:
                raise scene.error(f"{kind}.{name}", f"{name} is a reserved name", "Rename it.")
            if name in seen:
                raise scene.error(f"{kind}.{name}", f"{seen[name]} has the same name", "Rename one of the two.")
            seen[name] = f"{kind}.{name}"
    for name, key in seen.items():
        for at, letter in enumerate(name):
            # n4.force.x and a node n4_force would both flatten to n4_force_x
            head, tail = name[:at], name[at + 1 :]
            if letter == "_" and (head in reserved or (head in seen and tail.split("_")[0] in words)):
                problem = f"reads like a variable of {seen.get(head, head)} once dots become underscores"
                raise scene.error(key, problem, f"Rename it so that it does not start with {head}_.")


def _check_coordinates(scene: Scene) -> None:
    letters = scene.plane or "xyz"
    if isinstance(scene.gravity, tuple):
        for at, (axis, value) in enumerate(zip("xyz", scene.gravity), 1):
            if axis not in letters and value != 0.0:
                problem = f"gravity acts along {axis}, across the plane {letters}"
                raise scene.error(f"gravity[{at}]", problem, f"Write 0 for {axis}, or choose another plane.", value)
    elif scene.plane == "xy" and scene.gravity != 0.0:
        problem = "gravity acts along -z, across the plane xy"
        remedy = "Write gravity = 0, give a vector [x, y, 0], or choose the plane xz or yz."
        raise scene.error("gravity", problem, remedy, scene.gravity)
    for name, point in scene.nodes.items():
        if len(point) != len(letters):
            kind = f"planar scene ({scene.plane})" if scene.plane else "3D scene"
            problem = f"has {len(point)} coordinates in a {kind}"
            raise scene.error(f"nodes.{name}", problem, f"Give {len(letters)}: [{', '.join(letters)}].")


def _check_references(scene: Scene) -> None:
    _require_nodes_or_axes(scene, "fixed", scene.fixed)
    for kind, members in (("bars", scene.bars), ("strings", scene.strings)):
        for name, member in members.items():
            for at, node in enumerate(member.nodes, 1):
                require_known(scene, f"{kind}.{name}.nodes[{at}]", node, scene.nodes)
    for name, string in scene.strings.items():
        for key, table in STRING_TABLES.items():
            wanted = getattr(string, key)
            if wanted is not None:
                require_known(scene, f"strings.{name}.{key}", wanted, getattr(scene, table), f"is not in [{table}]")
        for one, other in (("element", "nsh"), ("damper", "damping")):
            if getattr(string, one) is not None and getattr(string, other) is not None:
                raise scene.error(f"strings.{name}.{one}", f"the string has {other} too", "Keep one of the two.")
        if scene.stiffness(name) is None and scene.needs_stiffness(name):
            remedy = "Give material (a name in [materials]) or stiffness."
            raise scene.error(f"strings.{name}", "has no stiffness", remedy)
        if string.two_way and (string.nsh is not None or string.element is not None):
            key = "nsh" if string.nsh is not None else "element"
            problem = f"the string has an {key}, which pushes no string"
            raise scene.error(f"strings.{name}.two_way", problem, f"Keep one of the two: two_way, or {key}.")
    _check_prestress(scene)


def _check_prestress(scene: Scene) -> None:
    for key, table in scene.prestress.known.items():
        for name, value in table.items():
            require_known(scene, f"prestress.{key}.{name}", name, scene.strings, "is no string")
            others = [other for other, named in scene.prestress.known.items() if other != key and name in named]
            if others:
                problem = f"the string has both a {key.replace('_', ' ')} and a {others[0].replace('_', ' ')}"
                raise scene.error(f"prestress.{key}.{name}", problem, "Keep one of the two.")
            if value < 0.0 and not scene.strings[name].two_way:
                unit = {"tension": "N", "force_density": "N/m"}[key]
                remedy = f"Give a {key.replace('_', ' ')} in {unit}, 0 or more, or write two_way = true in strings.{name}."
                raise scene.error(f"prestress.{key}.{name}", "is less than 0, and a string cannot push", remedy)


def _require_nodes_or_axes(scene: Scene, key: str, names: tuple[str, ...]) -> None:
    """Names of nodes, or of single axes of nodes, as in n2.z."""
    letters, seen = scene.plane or "xyz", set()
    for at, name in enumerate(names, 1):
        node, dot, axis = name.partition(".")
        require_known(scene, f"{key}[{at}]", node, scene.nodes)
        if dot and (axis not in letters or len(axis) != 1):
            choices = " or ".join(f"{node}.{letter}" for letter in letters)
            raise scene.error(f"{key}[{at}]", f"names no axis of {node}", f"Write {node} for all axes, or {choices}.")
        if dot and node in seen:
            raise scene.error(f"{key}[{at}]", f"{node} is listed with all its axes already", "Remove one of the two.")
        seen.add(name)
        if node in names and dot:
            raise scene.error(f"{key}[{at}]", f"{node} is listed with all its axes, too", "Remove one of the two.")
        if dot and all(f"{node}.{letter}" in seen for letter in letters):
            raise scene.error(f"{key}[{at}]", f"is the last of all axes of {node}", f"Write {node} in place of its axes.")
    twice(scene, key, names)


def _check_path(scene: Scene, key: str, path: tuple[str, ...]) -> None:
    """Nodes of a member, one after the other: a bar's ends, or all that a string passes."""
    for at, ends in enumerate(pairwise(path), 2):
        if ends[0] == ends[1] and len(path) == 2:
            raise scene.error(key, "starts and ends at the same node", "Join two different nodes.")
        if ends[0] == ends[1]:
            raise scene.error(f"{key}[{at}]", "is the node before it, too", "Name a node once where a string passes it.")
        if scene.distance(ends) < SHORTEST:
            where = "both nodes are" if len(path) == 2 else f"{ends[0]} and {ends[1]} are both"
            problem = (
                f"has {'zero length' if len(path) == 2 else 'a segment of zero length'}: {where} at {scene.nodes[ends[0]]}"
            )
            raise scene.error(key, problem, "Move one of the nodes.")
    if len(path) > MOST_PASSED:
        raise scene.error(key, f"passes {len(path)} nodes, more than {MOST_PASSED}", "Divide the string, or leave out nodes.")
    if path[0] == path[-1] and len(set(path)) < 3:
        problem = "ends where it starts, and passes only one other node"
        raise scene.error(key, problem, "Let an endless string pass three different nodes or more, or leave the last out.")


def _check_members(scene: Scene) -> None:
    owner: dict[str, str] = {}
    fixed, moved = set(scene.fixed), scene.moved
    for kind, members in (("bars", scene.bars), ("strings", scene.strings)):
        for name, member in members.items():
            _check_path(scene, f"{kind}.{name}.nodes", member.nodes)
    for name, bar in scene.bars.items():
        for node in bar.nodes:
            owner[node] = name
        if all(node in fixed for node in bar.nodes) and not any(node in moved for node in bar.nodes):
            problem = "both ends are fixed, so the bar cannot move"
            raise scene.error(f"bars.{name}.nodes", problem, "Free one end, or leave the bar out.")
    massed = {node for bar in scene.bars.values() if bar.mass > 0.0 for node in bar.nodes}
    massed |= {node for string in scene.strings.values() if string.mass > 0.0 for node in string.nodes}
    for node in scene.nodes:
        if node in massed or node in fixed or scene.point_masses.get(node):
            continue
        if node in owner:
            problem = f"is 0, and its node {node} has no other mass"
            remedy = f"Give mass in kg, a number greater than 0, or put a point mass at {node}."
            raise scene.error(f"bars.{owner[node]}.mass", problem, remedy)
        problem = "is neither fixed nor on a bar, so it has no mass"
        raise scene.error(f"nodes.{node}", problem, "Put it on a bar, give it a point mass, or list it in fixed.")


def _check_sections(scene: Scene) -> None:
    """Of bars: a modulus of elasticity, and a section that is round or another."""
    for name, bar in scene.bars.items():
        given = [key for key in SECTION_KEYS if getattr(bar, key) is not None]
        if not given:
            continue
        if given == ["E"]:
            remedy = "Give diameter (and wall of a tube), or area and second_moment."
            raise scene.error(f"bars.{name}.E", "stands without a section", remedy)
        round_one = bar.diameter is not None or bar.wall is not None
        must = ["E", "diameter"] if round_one else ["E", "area", "second_moment"]
        what = "a bar with a round section" if round_one else "a bar with a section that is not round"
        for key in (*must, *given):
            if key not in given:
                raise scene.error(f"bars.{name}.{key}", f"is missing in {what}", f"Give {_meaning(bar, key)}.")
            if key not in (*must, "wall"):
                raise scene.error(f"bars.{name}.{key}", f"does not belong to {what}", "Keep one of the two sections.")
        if bar.wall is not None and bar.diameter is not None and bar.wall >= 0.5 * bar.diameter:
            problem = f"leaves no hole in a tube of the diameter {bar.diameter!r}"
            raise scene.error(f"bars.{name}.wall", problem, f"Give less than {0.5 * bar.diameter!r}, or leave it out: solid.")


def _meaning(entry: Entry, key: str) -> str:
    return str(type(entry).model_fields[key].description)


def _check_welds(scene: Scene) -> None:
    for at, bars in enumerate(scene.weld, 1):
        for place, name in enumerate(bars, 1):
            require_known(scene, f"weld[{at}][{place}]", name, scene.bars, "is no bar")
        twice(scene, f"weld[{at}]", bars)
    for body in joined(scene.weld):
        if len(body) > MOST_WELDED:
            problem = f"makes a rigid body of {len(body)} bars, more than {MOST_WELDED}"
            at = next(at for at, bars in enumerate(scene.weld, 1) if bars[0] in body)
            raise scene.error(f"weld[{at}]", problem, "Use longer bars, or fewer.")


def _check_velocities(scene: Scene) -> None:
    letters, held, moved = scene.plane or "xyz", scene.held, scene.moved
    for name, velocity in scene.velocities.items():
        key = f"velocities.{name}"
        require_known(scene, key, name, scene.nodes)
        if len(velocity) != len(letters):
            kind = f"planar scene ({scene.plane})" if scene.plane else "3D scene"
            remedy = f"Give {len(letters)}: [{', '.join(letters)}]."
            raise scene.error(key, f"has {len(velocity)} components in a {kind}", remedy)
        for at, (axis, value) in enumerate(zip(scene.axes, velocity), 1):
            if value != 0.0 and axis in held.get(name, ()) and axis not in moved.get(name, ()):
                problem = f"{name} is fixed along {'xyz'[axis]}, and not moved"
                raise scene.error(f"{key}[{at}]", problem, f"Write 0, or list {name}.{'xyz'[axis]} in moving, too.", value)


def _check_honeycombs(scene: Scene) -> None:
    total = 0.0
    for name, nsh in scene.nsh.items():
        if nsh.law == "hysteretic" and len(nsh.Q) > MOST_MEMORY:
            raise scene.error(f"nsh.{name}.Q", f"has {len(nsh.Q)} beams", f"Use at most {MOST_MEMORY} in an NSH with memory.")
        for key in ("zeta", "h"):
            if len(getattr(nsh, key)) != len(nsh.Q):
                problem = f"has {len(getattr(nsh, key))} beams where Q has {len(nsh.Q)}"
                raise scene.error(f"nsh.{name}.{key}", problem, "Give one value per beam in each of Q, zeta and h.")
        for at, zeta in enumerate(nsh.zeta, 1):
            key = f"nsh.{name}.zeta[{at}]"
            _require_beam(scene, key, zeta, nsh.beams)
            if zeta >= 8.0 and nsh.law == "single_valued":
                problem = "makes the beam bistable, which means nothing without memory: its force falls below 0"
                raise scene.error(key, problem, 'Write law = "hysteretic", or choose zeta < 8.')
            if zeta <= 2.0 and nsh.law == "single_valued":
                problem = "makes the beam monotone, which an NSH without memory does not know"
                raise scene.error(key, problem, 'Write law = "hysteretic", or a series of such beams in [elements].')
        users = {scene.stiffness(string) for string, one in scene.strings.items() if one.nsh == name}
        total += costs.honeycomb(len(nsh.Q), nsh.law) * (len(users) if nsh.law == "hysteretic" else bool(users))
        if total > MOST_COST:
            problem = "takes too long to work out, here or with those before it"
            raise scene.error(f"nsh.{name}.Q", problem, "Use fewer beams, or fewer different ones.")


def _check_loads(scene: Scene) -> None:
    """Point masses, drag and moved nodes."""
    fixed, along = set(scene.fixed), scene.held
    for key in ("point_masses", "drag"):
        for name in getattr(scene, key):
            require_known(scene, f"{key}.{name}", name, scene.nodes)
            if key == "drag" and name in fixed:
                raise scene.error(f"drag.{name}", "the node is fixed, so it has no drag", "Name a free node, or leave it out.")
    for at, name in enumerate(scene.moving, 1):
        node, _, axis = name.partition(".")
        if node not in scene.nodes:
            require_known(scene, f"moving[{at}]", name, scene.fixed)
        held = along.get(node, ())
        if not held:
            problem = "is a free node, which moves by itself"
            raise scene.error(f"moving[{at}]", problem, "List it in fixed, too, or leave it out.")
        wanted = scene.axes if not axis else tuple(i for i in scene.axes if "xyz"[i] == axis)
        if not set(wanted) <= set(held):
            named = [f"{node}.{'xyz'[i]}" for i in held]
            problem = f"is fixed as {' and '.join(named)} only, and free otherwise"
            raise scene.error(f"moving[{at}]", problem, f"Write {' or '.join(named)}, or fix more of its axes.")
    _require_nodes_or_axes(scene, "moving", scene.moving)


def _require_beam(scene: Scene, key: str, zeta: float | None, beams: str | None) -> None:
    if zeta is not None and beams != "any" and not 2.0 < zeta < 8.0:
        kind = "monotone (it never snaps)" if zeta <= 2.0 else "bistable (it does not return)"
        remedy = 'Choose 2 < zeta < 8 (metastable), or write beams = "any".'
        raise scene.error(key, f"makes the beam {kind}", remedy)


def element_keys(kind: str) -> tuple[list[str], list[str]]:
    """The keys that an element of a kind must have, and those that it may have."""
    own = dataclasses.fields(KINDS[kind])
    must = [key_of(one) for one in own if one.default is dataclasses.MISSING]
    return ["kind", *must], [key_of(one) for one in own if key_of(one) not in must] + ["beams"] * (kind == "beam")


def _check_elements(scene: Scene) -> None:
    for name, entry in scene.elements.items():
        _require_keys(scene, f"elements.{name}", entry, f"a {entry.kind}", *element_keys(entry.kind))
        if entry.kind == "beam":
            _require_beam(scene, f"elements.{name}.zeta", entry.zeta, entry.beams)
        if entry.kind == "table":
            _require_points(scene, f"elements.{name}", "elongation", entry.elongation, entry.force)
        for at, part in enumerate(entry.parts or (), 1):
            key = f"elements.{name}.parts[{at}]"
            require_known(scene, key, part, scene.elements, "is not in [elements]")
            if scene.elements[part].law == "hysteretic":
                problem = "has memory, which only the outermost element of a string may have"
                raise scene.error(key, problem, f'Write law = "single_valued" in [elements.{part}].')
    size: dict[str, int] = {}
    for name in scene.elements:
        _require_tree(scene, name, (), size)
        if sum(size.values()) > 100 * MOST_PARTS:
            problem = f"makes more than {100 * MOST_PARTS} parts with the elements before it"
            raise scene.error(f"elements.{name}", problem, "Leave out elements that nothing uses.")


def _require_tree(scene: Scene, name: str, above: tuple[str, ...], size: dict[str, int]) -> None:
    """Circles, and trees that are too large; size: the parts of the elements that have been looked at."""
    size[name] = 1
    for at, part in enumerate(scene.elements[name].parts or (), 1):
        if part in (*above, name):
            problem = f"closes a circle: {' -> '.join((*above, name, part))}"
            raise scene.error(f"elements.{name}.parts[{at}]", problem, "Name an element outside it.")
        if len(above) >= MOST_LEVELS:
            problem = f"is more than {MOST_LEVELS} elements deep in {above[0]}"
            raise scene.error(
                f"elements.{name}.parts[{at}]", problem, "Put the parts of a series or parallel into the outer one."
            )
        if part not in size:
            _require_tree(scene, part, (*above, name), size)
        size[name] += size[part]
    if size[name] > MOST_PARTS:
        raise scene.error(f"elements.{name}.parts", f"makes {size[name]} parts", f"Use at most {MOST_PARTS}.")


def _check_costs(scene: Scene) -> None:
    """Laws that would take too long to work out: each once, with memory once per stiffness."""
    total = 0.0
    for name, entry in scene.elements.items():
        element = scene.element(name)
        if entry.law == "hysteretic" and costs.snapping(element) > MOST_MEMORY:
            problem = f"has {costs.snapping(element)} beams and other parts that may snap"
            raise scene.error(f"elements.{name}.parts", problem, f"Use at most {MOST_MEMORY} in a series with memory.")
        stiffnesses = {scene.stiffness(string) for string, one in scene.strings.items() if one.element == name}
        total += costs.seconds(element) * (max(1, len(stiffnesses)) if entry.law == "hysteretic" else 1)
        if total > MOST_COST:
            problem = "takes too long to work out, here or with the elements before it"
            remedy = "Use fewer parts, or put the parts of a series or parallel into the outer one."
            raise scene.error(f"elements.{name}", problem, remedy)


def _check_dampers(scene: Scene) -> None:
    for name, entry in scene.dampers.items():
        if entry.coefficients is not None:
            _require_keys(scene, f"dampers.{name}", entry, "a damper with coefficients", ["coefficients"], [])
        elif entry.rate is None and entry.force is None:
            raise scene.error(f"dampers.{name}", "has no law", "Give coefficients, or rate and force.")
        else:
            _require_keys(scene, f"dampers.{name}", entry, "a damper with points", ["rate", "force"], ["interpolation"])
            _require_points(scene, f"dampers.{name}", "rate", entry.rate, entry.force)


def _check_points(scene: Scene) -> None:
    """Tables that are too long to be worked out soon."""
    lists = [(f"elements.{name}.elongation", entry.elongation) for name, entry in scene.elements.items()]
    total = 0
    for key, points in lists + [(f"dampers.{name}.rate", entry.rate) for name, entry in scene.dampers.items()]:
        total += len(points or ())
        if total > MOST_POINTS:
            problem = f"makes {total} points of tables in this scene, more than {MOST_POINTS}"
            raise scene.error(key, problem, 'Leave out points; interpolation = "cubic" needs fewer for a smooth curve.')


def _require_keys(scene: Scene, key: str, entry: Entry, what: str, must: Sequence[str], may: Sequence[str]) -> None:
    """Keys that are missing in a table, or that belong to another kind."""
    for field, about in type(entry).model_fields.items():
        given = getattr(entry, field) is not None
        if field in must and not given:
            raise scene.error(f"{key}.{field}", f"is missing in {what}", f"Give {about.description}.")
        if given and field not in must and field not in may:
            raise scene.error(f"{key}.{field}", f"does not belong to {what}", f"Keys here: {', '.join((*must, *may))}.")


def _require_points(scene: Scene, key: str, along: str, x: tuple[float, ...] | None, f: tuple[float, ...] | None) -> None:
    if x is None or f is None:
        return  # which `_require_keys` says
    if len(x) != len(f):
        problem = f"has {len(f)} values where {along} has {len(x)}"
        raise scene.error(f"{key}.force", problem, f"Give one force per {along}.")
    for field, first in ((along, x[0]), ("force", f[0])):
        if first != 0.0:
            raise scene.error(f"{key}.{field}[1]", "is not 0", "Let both lists start with 0.")
    for at, (before, after) in enumerate(pairwise(x), 2):
        if not after > before:
            raise scene.error(f"{key}.{along}[{at}]", f"does not exceed the value before it, {before!r}", "Sort the points.")
        if after - before < 1e-12:
            problem = f"exceeds the value before it, {before!r}, by less than 1e-12"
            raise scene.error(f"{key}.{along}[{at}]", problem, "Leave out one of the two points.")


CHECKS = (
    _check_names,
    _check_coordinates,
    _check_points,
    _check_elements,
    _check_dampers,
    _check_references,
    _check_members,
    _check_honeycombs,
    _check_loads,
    check_ground,
    _check_welds,
    _check_sections,
    _check_velocities,
    _check_costs,
)
