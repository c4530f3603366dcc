"""A scene at its start as tables of nodes and members, see `csv_tables`."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from ..files import replacing_text
from ..model import Model
from ..scene import Scene
from .csv_tables import BAR, MEMBER, NODE, beside
from .refusals import require_springs


def write(path: Path, scene: Scene, model: Model) -> list[str]:
    """Write the three tables; returns notes on what they do not say.  Raises InputError for what they cannot."""
    require_springs(model, "tables of nodes and members")
    if model.ground is not None:
        require_springs(model, "tables of nodes and members", "its ground")
    texts = {path: _nodes(model), beside(path, "members"): _members(scene, model), beside(path, "scene"): _scene(scene)}
    with ExitStack() as stack:
        files = [(stack.enter_context(replacing_text(one)), text) for one, text in texts.items()]
        for file, text in files:
            file.write(text)
    notes = [f"The actuator of {name} is left out: its rest length stays." for name in _wound(model)]
    return notes + [f"{model.node_names[node]} is fixed there: its motion is no input." for node in model.moving]


def _wound(model: Model) -> list[str]:
    return [model.string_names[i] for i in model.actuated]


def _table(header: tuple[str, ...], rows: Iterable[dict[str, Any]]) -> str:
    """Only columns that some row fills."""
    rows = list(rows)
    used = [name for name in header if any(row.get(name, "") != "" for row in rows)]
    text = io.StringIO()
    writer = csv.DictWriter(text, used, restval="", extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _nodes(model: Model) -> str:
    letters = ["xyz"[axis] for axis in model.axes]
    mass, drag = dict(model.point_mass), dict(model.drag)
    rows = []
    for node, name in enumerate(model.node_names):
        held = [axis for axis in letters if model.held[node, "xyz".index(axis)]]
        row: dict[str, Any] = {"name": name, "fixed": "yes" if len(held) == len(letters) else "".join(held)}
        row |= {axis: float(model.nodes[node, "xyz".index(axis)]) for axis in letters}
        if model.velocity[node].any():
            row |= {f"v{axis}": float(model.velocity[node, "xyz".index(axis)]) for axis in letters}
        rows.append(row | {key: table[node] for key, table in (("mass", mass), ("drag", drag)) if node in table})
    return _table(NODE, rows)


def _members(scene: Scene, model: Model) -> str:
    weld = {bar: at for at, body in enumerate(model.bodies, 1) for bar in body.bars}
    rows = []
    for i, (name, bar) in enumerate(scene.bars.items()):
        given = {key: getattr(bar, key) for key in BAR if getattr(bar, key) is not None}
        rows.append({"name": name, "kind": "bar", "nodes": " ".join(bar.nodes), "weld": weld.get(i, "")} | given)
    for i, (name, string) in enumerate(scene.strings.items()):
        row = {"name": name, "kind": "string", "nodes": " ".join(string.nodes), "rest_length": float(model.rest_length[i])}
        row |= {"stiffness": float(model.stiffness[i]), "damping": float(model.damping[i])}
        row |= {"mass": string.mass} if string.mass else {}
        row |= {"two_way": "yes"} if string.two_way else {}
        rows.append(row | ({"strength": scene.strength(name)} if scene.strength(name) is not None else {}))
    return _table(MEMBER, rows)


def _scene(scene: Scene) -> str:
    gravity = scene.gravity if isinstance(scene.gravity, tuple) else (scene.gravity,)
    start = "released" if scene.start == "released" else "equilibrium"
    found = {"name": scene.name, "description": scene.description, "source": scene.source, "plane": scene.plane}
    found |= {"gravity": " ".join(map(repr, gravity)), "damping_law": scene.damping_law, "start": start}
    if scene.string_mass_matrix != "lumped":
        found |= {"string_mass_matrix": scene.string_mass_matrix}
    return _table(("key", "value"), ({"key": key, "value": value} for key, value in found.items() if value))
