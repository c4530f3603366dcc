"""What a scene is, and whether it stands: the text of `tensegrity check`, and the same as data."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

from .. import statics
from ..model import Model
from ..model.strength import bar_utilisation, buckling_load, by_name, slenderness, string_utilisation


def summary(model: Model, start: str) -> str:
    """What `tensegrity check` prints: counts, statics, and the start."""
    axes = "".join("xyz"[axis] for axis in model.axes)
    lines = [
        f"{model.name}: {model.description}" if model.description else model.name,
        f"  nodes: {len(model.nodes)} ({len(model.fixed_nodes)} fixed), axes {axes}",
        f"  bars: {len(model.bars)}, strings: {len(model.strings)} ({len(model.nsh_strings)} with an NSH)",
        *_strings(model),
        *_joints(model),
        *_analysis(model),
        f"  start: {start}, {_balance(model)}",
        *_moves(model),
        *_forces(model),
        *_ground(model),
        *_utilisation(model),
    ]
    return "\n".join(lines)


def _balance(model: Model) -> str:
    """Whether the start is an equilibrium, and then whether it is stable."""
    force, node, equilibrium = statics.unbalanced(model)
    if not equilibrium:
        return f"not an equilibrium: up to {force:.3g} N stay unbalanced, at {model.node_names[node]}"
    try:
        stable, lowest = statics.stability(model)
    except statics.TooLarge as failure:
        return f"largest unbalanced force {force:.1e} N; not known whether it is stable: {failure}"
    least = f" (lowest stiffness {lowest:z.4g} N/m)" if np.isfinite(lowest) else " (nothing has a stiffness)"
    return f"largest unbalanced force {force:.1e} N, {'stable' if stable else 'unstable'}{least}"


def _analysis(model: Model) -> list[str]:
    """Rank, self-stress and mechanisms, or why there are none."""
    try:
        found = statics.analyse(model)
    except statics.TooLarge as failure:
        return [f"  no self-stress states and mechanisms: {failure}"]
    return [
        f"  equilibrium matrix: {found.equations} x {found.members}, rank {found.rank}",
        f"  self-stress states: {found.self_stress.shape[1]}, mechanisms: {len(found.mechanisms)}, "
        f"rigid-body motions: {found.rigid_body_motions}",
    ]


def _strings(model: Model) -> list[str]:
    """What strings have beside two ends: a way over several nodes, mass, a law that pushes."""
    lines = [
        f"  {model.string_names[string]} runs over {', '.join(model.node_names[node] for node in path)}"
        for string, path in model.routes
    ]
    if len(lines) > MOST_ROUTES:
        lines = [f"  over several nodes: {len(lines)} strings"]
    if model.massive_strings:
        mass, how = model.string_mass.sum(), model.string_mass_matrix
        lines.append(f"  strings with mass: {len(model.massive_strings)}, {mass:.6g} kg in all ({how})")
    pushing = [name for name, one in zip(model.string_names, model.two_way) if one]
    if pushing:
        lines.append(f"  springs that also push: {', '.join(pushing) if len(pushing) <= MOST_ROUTES else len(pushing)}")
    return lines


def _joints(model: Model) -> list[str]:
    """What is beyond class 1: partly fixed nodes, welds, bars whose forces the lengths leave open."""
    lines = []
    if model.partly_fixed:
        axes = [f"{model.node_names[node]}.{'xyz'[axis]}" for node, along in model.partly_fixed for axis in along]
        lines.append(f"  fixed along single axes: {', '.join(axes)}")
    lines += [f"  one rigid body: {', '.join(model.bar_names[i] for i in body.bars)}" for body in model.bodies]
    redundant = [name for name, one in zip(model.bar_names, model.redundant) if one]
    if redundant:
        lines.append(f"  redundant bars: {', '.join(redundant)}; their forces are the least that balance")
    return lines


MOST_ROUTES = 20  # strings over several nodes that are listed
LISTED = 500  # nodes or members; of more than these, only the range is shown


def _moves(model: Model) -> list[str]:
    """How far each node is from its given coordinates."""
    way = np.linalg.norm(model.nodes - model.nominal, axis=1)
    if not way.any():
        return ["  all nodes at the given coordinates"]
    if len(way) > LISTED:
        return [f"  moved from the given coordinates: up to {1e3 * way.max():.3f} mm"]
    rows = [f"    {name}: {1e3 * d:.3f} mm" for name, d in zip(model.node_names, way) if d > 0.0]
    return ["  moved from the given coordinates:", *rows]


def _forces(model: Model) -> list[str]:
    """Force of each member at the start, and each string's rest length."""
    force, count = statics.member_forces(model), len(model.strings)
    if len(force) > LISTED:
        kinds = [("strings", force[:count]), ("bars", force[count:])]
        rows = [f"    {kind}: {f.min():z.6g} to {f.max():z.6g} N" for kind, f in kinds if len(f)]
        return ["  member forces (tension positive):", *rows]
    strings = zip(model.string_names, force, model.rest_length)
    bars = zip(model.bar_names, force[count:])
    return [
        "  member forces (tension positive):",
        *(f"    {name}: {f:z.6g} N, rest length {xi:.6g} m" for name, f, xi in strings),
        *(f"    {name}: {f:z.6g} N{' (redundant)' * int(one)}" for (name, f), one in zip(bars, model.redundant)),
    ]


def _ground(model: Model) -> list[str]:
    """What the ground bears at the start, the nodes that press most first."""
    if model.ground is None:
        return []
    pressed = sorted(_pressed(model).items(), key=lambda one: -one[1])
    total = sum(pressure for _, pressure in pressed)
    rows = [f"    {name}: {pressure:.6g} N" for name, pressure in pressed[:LISTED]]
    return [f"  ground: {len(pressed)} of {len(model.contacts)} nodes stand on it and press with {total:.6g} N", *rows]


def _pressed(model: Model) -> dict[str, float]:
    """N, of the nodes that touch the ground at the start."""
    pressed = zip(model.contacts, statics.pressures(model, model.nodes).tolist())
    return {model.node_names[contact.node]: pressure for contact, pressure in pressed if pressure > 0.0}


def _utilisation(model: Model) -> list[str]:
    """How much of what they bear the members with a section or a strength use at the start, the most used ones first."""
    used = sorted(_used(model).items(), key=lambda one: -one[1])
    if not used:
        return []
    loads = dict(zip((model.bar_names[bar] for bar, _ in model.sections), zip(buckling_load(model), slenderness(model))))
    strengths = {model.string_names[string]: value for string, value in model.strength}
    rows = []
    for name, part in used[:LISTED]:
        if name in strengths:
            limit = f"strength {strengths[name]:.6g} N"
        else:
            load, slender = loads[name]
            limit = f"buckling load {load:.6g} N" + (f", slenderness {slender:.4g}" if np.isfinite(slender) else "")
        rows.append(f"    {name}: {100.0 * part:.4g} % of its {limit}")
    over = sum(part >= 1.0 for _, part in used)
    return [f"  utilisation{f'; {over} bear less than they have to' if over else ''}:", *rows]


def _used(model: Model) -> dict[str, float]:
    """Utilisation at the start by name."""
    force, count = statics.member_forces(model), len(model.strings)
    bars = bar_utilisation(model, force[count : count + len(model.bars)])
    return by_name(model, bars, string_utilisation(model, force[:count]))


def data(model: Model, start: str) -> dict[str, Any]:
    """The same, as JSON takes it: m, N, N/m; what does not apply is null."""
    off, node, equilibrium = statics.unbalanced(model)
    stable, lowest = None, np.nan
    with contextlib.suppress(statics.TooLarge):
        stable, lowest = statics.stability(model) if equilibrium else (None, np.nan)
    try:
        found = statics.analyse(model)
    except statics.TooLarge:
        structure = None
    else:
        structure = {
            "equations": found.equations,
            "members": found.members,
            "rank": found.rank,
            "self_stress_states": found.self_stress.shape[1],
            "mechanisms": len(found.mechanisms),
            "rigid_body_motions": found.rigid_body_motions,
        }
    force = statics.member_forces(model).tolist()
    return {
        "scene": model.name,
        "description": model.description,
        "axes": [*("xyz"[axis] for axis in model.axes)],
        "nodes": dict(zip(model.node_names, model.nodes[:, list(model.axes)].tolist())),
        "fixed": [model.node_names[i] for i in model.fixed_nodes],
        "start": start,
        "equilibrium": bool(equilibrium),
        "unbalanced_force": float(off),
        "at": model.node_names[node],
        "stable": None if stable is None else bool(stable),
        "lowest_stiffness": float(lowest) if np.isfinite(lowest) else None,
        "structure": structure,
        "forces": dict(zip((*model.string_names, *model.bar_names), force)),
        "rest_lengths": dict(zip(model.string_names, model.rest_length.tolist())),
        "partly_fixed": {model.node_names[node]: ["xyz"[axis] for axis in axes] for node, axes in model.partly_fixed},
        "rigid_bodies": [[model.bar_names[i] for i in body.bars] for body in model.bodies],
        "redundant_bars": [name for name, one in zip(model.bar_names, model.redundant) if one],
        "ground": _pressed(model),
        "utilisation": _used(model),
        "ways": {model.string_names[string]: [model.node_names[node] for node in path] for string, path in model.routes},
        "string_mass": {model.string_names[i]: model.string_mass.item(i) for i in model.massive_strings},
        "two_way": [name for name, one in zip(model.string_names, model.two_way) if one],
        "honeycombs": [model.string_names[i] for i in model.nsh_strings],
    }
