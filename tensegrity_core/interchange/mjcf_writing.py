"""A scene at its start as a MuJoCo model (MJCF).

A rigid body is a bar, or bars that are welded; where it meets another, or the ground, stands a ball joint, in a planar scene a
hinge.  A ring of bars, and what hangs on several fixed nodes, is closed by `connect` constraints, which are soft there.  Bodies
have exactly the mass, centre and inertia that thin bars and point masses have here; strings are spatial tendons that pull
beyond their springlength.  All frames are parallel to the world's at the start, so that no pose has to be said.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ..errors import InputError
from ..files import write_bytes
from ..model import Model
from ..model.ground import Ground
from ..scene import Scene
from .refusals import require_springs

#: Least moment of inertia of a body, as part of its largest: thin bars have none about their own axes, and MuJoCo wants one.
AXIAL = 1e-5
#: Bodies in each other; a longer chain of bars would not be read.
MOST_DEEP = 200
#: Radius of what is drawn of a bar, and of a node that may touch the ground, as part of the longest bar.
THICK, TOUCHING = 0.01, 1e-3
STEP = 1e-3  # s


@dataclass(eq=False)
class Body:
    """bars; nodes: that it carries; at: node of its joint, -1: it floats; slides: axes along which that moves; parent: None:
    the world."""

    name: str
    bars: tuple[int, ...]
    nodes: list[int] = field(default_factory=list)
    at: int = -1
    slides: tuple[int, ...] = ()
    parent: Body | None = None
    deep: int = 1
    origin: np.ndarray = field(default_factory=lambda: np.zeros(3))
    element: ElementTree.Element = field(default_factory=lambda: ElementTree.Element("body"))


def write(path: Path, scene: Scene, model: Model) -> list[str]:
    """Write the model; returns notes on what it says otherwise.  Raises InputError for what it cannot say."""
    root, notes = document(model)
    ElementTree.indent(root)
    write_bytes(path, ElementTree.tostring(root, "utf-8", xml_declaration=True))
    return notes


def document(model: Model, step: float = STEP, integrator: str = "implicit") -> tuple[ElementTree.Element, list[str]]:
    """MJCF, and notes.  step: s.  Raises InputError for what it cannot say."""
    model = _in_its_plane(model)
    bodies, closing, sliding = _bodies(model)
    found = [
        f"{model.node_names[node]}, which is fixed along some axes only, on a body that is held elsewhere" for node in sliding
    ]
    found += [f"the drag of {', '.join(model.node_names[node] for node, _ in model.drag)}"] if model.drag else []
    if model.string_mass_matrix != "lumped" and model.massive_strings:
        found.append(f"the consistent mass of {', '.join(model.string_names[i] for i in model.massive_strings)}")
    require_springs(model, "MJCF", *found)
    root = ElementTree.Element("mujoco", model=model.name)
    _element(root, "compiler", autolimits="true", inertiafromgeom="false")
    option = _element(root, "option", integrator=integrator, timestep=repr(step), gravity=_words(model.g))
    if model.ground is None:
        _element(option, "flag", contact="disable")
    world = _element(root, "worldbody")
    for node in model.fixed_nodes.tolist():
        _element(world, "site", name=model.node_names[node], pos=_words(model.nodes[node]))
    masses = _masses(model)
    for body in bodies:
        _write_body(model, body, world, masses)
    for node in model.lone_nodes.tolist():
        _write_point(model, node, world, masses[node])
    _write_tendons(model, root)
    if closing:
        _write_closing(model, root, closing, step)
    if model.ground is not None:
        _write_ground(model, model.ground, world)
    if model.velocity.any():
        key = _element(_element(root, "keyframe"), "key", name="start")
        key.set("qvel", _words(v for body in bodies for v in _speeds(model, body)) + _lone_speeds(model))
    return root, _notes(model, closing)


def _in_its_plane(model: Model) -> Model:
    """The model as a planar one where all nodes are fixed along an axis."""
    axes = tuple(axis for axis in model.axes if not model.held[:, axis].all())
    if len(model.axes) == 2 or len(axes) != 2:
        return model
    held = model.held[:, axes]
    single = ((node, tuple(a for a, one in zip(axes, row) if one)) for node, row in enumerate(held.tolist()) if sum(row) == 1)
    return replace(model, axes=axes, fixed=np.asarray(held.all(axis=1)), partly_fixed=tuple(single), moving=(), moving_axes=())


def _element(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _words(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


# --- bodies ----------------------------------------------------------------------------------------------------------


def _bodies(model: Model) -> tuple[list[Body], list[tuple[Body, Body | None, int]], list[int]]:
    """Rigid bodies, each behind its parent, depth first; where two of them, or one and the world, have to be joined, too:
    (body, other, node); and nodes fixed along some axes that no joint of theirs holds."""
    welded = {bar: body.bars for body in model.bodies for bar in body.bars}
    units = list(dict.fromkeys(welded.get(bar, (bar,)) for bar in range(len(model.bars))))
    at: dict[int, list[int]] = {}
    for i, bars in enumerate(units):
        for node in np.unique(model.bars[list(bars)]).tolist():
            at.setdefault(node, []).append(i)
    closing: list[tuple[Body, Body | None, int]] = []
    placed: dict[int, Body] = {}
    owner: dict[int, Body] = {}
    pinned = [i for i, bars in enumerate(units) if model.fixed[model.bars[list(bars)]].any()]
    on_rails = [i for i, bars in enumerate(units) if any(_partly(model, n) for n in model.bars[list(bars)].ravel().tolist())]
    for first in dict.fromkeys((*pinned, *on_rails, *range(len(units)))):
        waiting: deque[tuple[int, int, Body | None]] = deque([(first, -1, None)])
        while waiting:
            i, node, parent = waiting.popleft()
            if i not in placed:
                _take(model, units[i], node, parent, (placed, owner, closing), i)
                waiting += [(other, n, placed[i]) for n in placed[i].nodes if owner.get(n) is placed[i] for other in at[n]]
    children: dict[int, list[Body]] = {}
    for body in placed.values():
        children.setdefault(id(body.parent), []).append(body)
    ordered, left = [], list(reversed(children.get(id(None), [])))
    while left:
        ordered.append(left.pop())
        left += reversed(children.get(id(ordered[-1]), []))
    held = {body.at for body in ordered if body.slides} | {*model.lone_nodes.tolist()}
    return ordered, closing, [node for node, _ in model.partly_fixed if node not in held]


def _partly(model: Model, node: int) -> bool:
    return any(node == one for one, _ in model.partly_fixed)


def _take(model: Model, bars: tuple[int, ...], node: int, parent: Body | None, known: tuple, i: int) -> None:
    """Place a rigid body, at a node of its parent, at a fixed node, or afloat."""
    placed, owner, closing = known
    nodes = np.unique(model.bars[list(bars)]).tolist()
    fixed = [one for one in nodes if model.fixed[one]]
    body = Body("_".join(model.bar_names[bar] for bar in bars[:3]), bars, at=node, parent=parent)
    body.deep = parent.deep + 1 if parent else 1
    if body.deep > MOST_DEEP:
        raise InputError(
            f"{model.name}: MJCF cannot say more than {MOST_DEEP} bars in a chain, as to {body.name}; export a shorter one"
        )
    rails = [one for one in nodes if _partly(model, one)]
    if node < 0 and fixed:
        body.at = fixed[0]
    elif node < 0 and rails:
        body.at, body.slides = rails[0], _free_axes(model, rails[0])
    elif node < 0:
        body.slides = model.axes
    for one in nodes:
        if one == body.at and parent:
            continue
        if model.fixed[one]:
            closing += [(body, None, one)] if one != body.at else []
        elif one in owner:
            closing.append((body, owner[one], one))
        else:
            owner[one] = body
            body.nodes.append(one)
    placed[i] = body


def _free_axes(model: Model, node: int) -> tuple[int, ...]:
    return tuple(axis for axis in model.axes if not model.held[node, axis])


def _masses(model: Model) -> np.ndarray:
    """(N,) kg at the nodes, beside the bars'."""
    found = np.zeros(len(model.nodes))
    for node, mass in model.point_mass:
        found[node] += mass
    for string, node, share in model.string_mass_shares:
        found[node] += share * model.string_mass[string]
    return found


def _inertia(model: Model, body: Body, masses: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, kg, centre, m, and inertia about it, kg m2, of thin bars and point masses; the latter a little more than that,
    see AXIAL.  Raises InputError where there is no mass."""
    at = [model.nodes[node] for node in body.nodes]
    weights = [float(masses[node]) for node in body.nodes]
    spread = np.zeros((3, 3))
    for bar in body.bars:
        a, b = model.nodes[model.bars[bar]]
        at.append(0.5 * (a + b))
        weights.append(float(model.bar_mass[bar]))
        spread += model.bar_mass[bar] / 12.0 * np.outer(b - a, b - a)
    mass = sum(weights)
    if not mass > 0.0:
        raise InputError(f"{model.name}: MJCF cannot say {body.name}, a bar without mass between other bodies; give it a mass")
    centre = np.average(at, axis=0, weights=weights)
    away = np.array(at) - centre
    spread += np.einsum("i,ij,ik->jk", weights, away, away)
    found = np.trace(spread) * np.eye(3) - spread
    sizes, axes = np.linalg.eigh(found)
    return mass, centre, (axes * np.maximum(sizes, AXIAL * sizes[-1])) @ axes.T


def _write_body(model: Model, body: Body, world: ElementTree.Element, masses: np.ndarray) -> None:
    mass, centre, inertia = _inertia(model, body, masses)
    body.origin = model.nodes[body.at] if body.at >= 0 else centre
    above = np.zeros(3) if body.parent is None else body.parent.origin
    parent = world if body.parent is None else body.parent.element
    element = body.element = _element(parent, "body", name=body.name, pos=_words(body.origin - above))
    for kind, axis in _joints(model, body):
        _element(element, "joint" if kind != "free" else "freejoint", **({} if kind == "free" else {"type": kind}), **axis)
    full = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    place = _words(centre - body.origin)
    _element(element, "inertial", pos=place, mass=repr(float(mass)), fullinertia=_words(full))
    thick = repr(THICK * float(model.bar_length.max()))
    for bar in body.bars:
        ends = _words((model.nodes[model.bars[bar]] - body.origin).ravel())
        shape = {"name": model.bar_names[bar], "type": "capsule", "fromto": ends, "size": thick}
        _element(element, "geom", **shape, contype="0", conaffinity="0")
    for node in body.nodes:
        place = _words(model.nodes[node] - body.origin)
        _element(element, "site", name=model.node_names[node], pos=place)
        _write_touching(model, element, node, place)


def _joints(model: Model, body: Body) -> list[tuple[str, dict[str, str]]]:
    """Kind and axis of a body's joints."""
    if len(model.axes) == 3:
        return [("free", {})] if body.at < 0 else [*_slides(body.slides), ("ball", {})]
    across = _words(np.eye(3)[next(i for i in range(3) if i not in model.axes)])
    return [*_slides(body.slides), ("hinge", {"axis": across})]


def _slides(axes: Iterable[int]) -> list[tuple[str, dict[str, str]]]:
    return [("slide", {"axis": _words(np.eye(3)[axis])}) for axis in axes]


def _write_point(model: Model, node: int, world: ElementTree.Element, mass: float) -> None:
    """A point mass by itself, which does not turn."""
    name = model.node_names[node]
    element = _element(world, "body", name=f"{name}_body", pos=_words(model.nodes[node]))
    for kind, axis in _slides(_free_axes(model, node)):
        _element(element, "joint", type=kind, **axis)
    small = _words([AXIAL * mass] * 3)
    _element(element, "inertial", pos="0 0 0", mass=repr(float(mass)), diaginertia=small)
    _element(element, "site", name=name, pos="0 0 0")
    _write_touching(model, element, node, "0 0 0")


# --- what acts on them -----------------------------------------------------------------------------------------------


def _write_tendons(model: Model, root: ElementTree.Element) -> None:
    tendons = _element(root, "tendon")
    for i, (name, nodes) in enumerate(zip(model.string_names, model.paths)):
        rest = float(model.rest_length[i])
        spring = _words([rest] if model.two_way[i] else [0.0, rest])
        numbers = {"stiffness": repr(float(model.stiffness[i])), "damping": repr(float(model.damping[i]))}
        tendon = _element(tendons, "spatial", name=name, springlength=spring, **numbers)
        for node in nodes:
            _element(tendon, "site", site=model.node_names[node])


def _write_closing(model: Model, root: ElementTree.Element, closing: list, step: float) -> None:
    """As stiff as MuJoCo lets constraints be at this step."""
    hard = {"solref": f"{2.0 * step!r} 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}
    equality = _element(root, "equality")
    for body, other, node in closing:
        second = {} if other is None else {"body2": other.name}
        _element(equality, "connect", body1=body.name, **second, anchor=_words(model.nodes[node] - body.origin), **hard)


def _write_ground(model: Model, ground: Ground, world: ElementTree.Element) -> None:
    """The plane, as far below as the nodes' spheres are thick."""
    normal = np.array(ground.normal)
    point = np.array(ground.point) - TOUCHING * float(model.bar_length.max(initial=1.0)) * normal
    shape = {"name": "ground", "type": "plane", "size": "0 0 1", "pos": _words(point), "zaxis": _words(normal)}
    _element(world, "geom", **shape, contype="1", conaffinity="2")


def _write_touching(model: Model, element: ElementTree.Element, node: int, place: str) -> None:
    """A small sphere at a node that may touch the ground, with its friction."""
    for contact in model.contacts:
        if contact.node == node:
            size, friction = repr(TOUCHING * float(model.bar_length.max(initial=1.0))), _words([contact.friction, 0.0, 0.0])
            shape = {"name": f"{model.node_names[node]}_touching", "type": "sphere", "size": size, "pos": place}
            _element(element, "geom", **shape, friction=friction, contype="2", conaffinity="1")


# --- start velocities ------------------------------------------------------------------------------------------------


def _turning(model: Model, body: Body | None) -> np.ndarray:
    """(3,) rad/s, of a body; a bar does not turn about its own axis."""
    if body is None:
        return np.zeros(3)
    nodes = np.unique(model.bars[list(body.bars)])
    x, v = model.nodes[nodes] - model.nodes[nodes[0]], model.velocity[nodes] - model.velocity[nodes[0]]
    rows = np.concatenate([np.cross(np.eye(3), one).T for one in x])  # w x r is this times w
    return np.linalg.lstsq(rows, v.ravel(), rcond=None)[0]


def _speeds(model: Model, body: Body) -> list[float]:
    """Speeds of a body's joints."""
    turning = _turning(model, body)
    node = int(model.bars[body.bars[0], 0])
    speed = model.velocity[node] + np.cross(turning, body.origin - model.nodes[node])
    relative = turning - _turning(model, body.parent)
    linear = speed[list(body.slides)].tolist()
    if len(model.axes) == 3:
        return linear + relative.tolist()
    return linear + [float(relative[next(i for i in range(3) if i not in model.axes)])]


def _lone_speeds(model: Model) -> str:
    return "".join(" " + _words(model.velocity[node, list(_free_axes(model, node))]) for node in model.lone_nodes.tolist())


# --- notes -----------------------------------------------------------------------------------------------------------


def _notes(model: Model, closing: list) -> list[str]:
    notes = [
        f"Bodies have {AXIAL:g} of their largest moment of inertia about the axis of a thin bar, about which it has none here."
    ]
    if model.damping.any():
        law = "may push" if model.damping_law == "literal" else "only unloads a string"
        notes.append(
            f"A tendon's damper acts while the tendon is slack, too; here it is idle then, and {law} while it is taut."
        )
    if closing:
        names = ", ".join(dict.fromkeys(model.node_names[node] for _, _, node in closing))
        notes.append(f"Bars are joined by soft constraints at {names}; here no joint gives way.")
    if model.string_mass_links:
        notes.append("Masses of strings are lumped at their nodes; here their segments move like thin bars.")
    if model.ground is not None:
        notes.append(
            "The ground is a plane that spheres of 1 mm for each metre touch by MuJoCo's own contact, stiffness and damping."
        )
    notes += [f"The actuator of {model.string_names[i]} is left out: its rest length stays." for i in model.actuated]
    notes += [f"{model.node_names[node]} is fixed there: its motion is no input." for node in model.moving]
    if model.velocity.any():
        notes.append("Start velocities stand in the keyframe `start`.")
    return notes
