"""On which inputs and parameters each output depends at the start, where positions and velocities are the scene's, but for
those of moved nodes and of the bars that are pinned to them.

At the start the lengths of the strings are given, so that an elastic force depends on its own string only; a bar pinned
at one end swings under everything at its tip, a free bar's axial force is half the difference of its two end forces.  Bars that
share nodes move each other: all that acts on a group of them counts in each of its bars and reactions.
"""

from __future__ import annotations

import numpy as np

from tensegrity_core.fields import FIELDS, INTEGER_FIELDS, layout, outputs, size
from tensegrity_core.model import Model

#: Inputs and parameters of which it is known here what depends on them; on any other, all outputs do.
KNOWN = frozenset(
    """force rest_length rest_length_rate current drum_load node_position node_velocity node_acceleration stiffness damping
    gravity drag bar_mass point_mass string_mass nsh_Q nsh_zeta nsh_h motor_inertia motor_damping torque_constant
    drum_radius bending_stiffness strength tolerance max_step method
    """.split()
)
#: Outputs that are the scene's at the start, or zero, but where nodes are moved or a start has velocities.  Of any other that
#: nothing is said about below, all that is known counts.
STARTED = ("position", "velocity", "wound_rest_length_rate", "motor_speed", "kinetic", "dissipated", "input_work", "throughput")


def initial_dependencies(model: Model) -> dict[int, set[int]]:
    """Value reference of an output -> value references of inputs and parameters; outputs that depend on none are left
    out (positions, velocities, lengths: the scene's; energies that count from the start: zero).
    """
    table = Places(model)
    everything = table.knowns()
    out = {table.at(f.name, i): everything for f in outputs() if f.name not in STARTED for i in range(size(f, model.counts))}
    for s in range(len(model.strings)):
        out[table.at("elastic_force", s)] = table.elastic(s)
        out[table.at("string_force", s)] = table.tension(s)
        out[table.at("string_length", s)] = table.ends(s)
    for i, s in enumerate(model.nsh_strings):
        out[table.at("snapped", i)] = table.elastic(s) - {table.at("stiffness", s)}
    for b in range(len(model.bars)):
        out[table.at("bar_force", b)] = table.bar_force(b)
    for i, (bar, _) in enumerate(model.sections):
        out[table.at("bar_utilisation", i)] = table.bar_force(bar) | {table.at("bending_stiffness", i)}
    for i, (string, _) in enumerate(model.strength):
        out[table.at("string_utilisation", i)] = table.tension(string) | {table.at("strength", i)}
    axes = len(model.axes)
    for g, node in enumerate(model.grounded_nodes):
        for axis in range(axes):
            out[table.at("reaction", g * axes + axis)] = table.reaction(int(node), axis)
    for a, s in enumerate(model.actuated):
        out[table.at("wound_rest_length", a)] = {table.at("rest_length", s)}
    out[table.at("elastic", 0)] = set().union(*(table.elastic(s) for s in range(len(model.strings))))
    out[table.at("potential", 0)] = table.weights() | table.all("node_position")
    out |= _of_motion(model, table)
    given = (field.name for field in (*FIELDS, *INTEGER_FIELDS) if field.role != "output" and field.name not in KNOWN)
    others = set().union(*map(table.all, given))
    if others:
        places = (table.at(f.name, i) for f in outputs() for i in range(size(f, model.counts)))
        out = {place: out.get(place, set()) | others for place in places}
    return {output: known for output, known in out.items() if known}


def _of_motion(model: Model, table: Places) -> dict[int, set[int]]:
    """Positions, velocities and the kinetic energy of what moved nodes carry."""
    axes = len(model.axes)
    out: dict[int, set[int]] = {}
    for node in table.movers:
        for axis in range(axes):
            out[table.at("position", node * axes + axis)] = table.place(node, axis)
        for f in np.flatnonzero(model.free_nodes == node):
            out |= {table.at("velocity", int(f) * axes + axis): table.velocity(node) for axis in range(axes)}
    fast = [b for b, ends in enumerate(model.bars) if np.any(model.velocity[ends])]
    lone = [node for node in model.lone_nodes.tolist() if np.any(model.velocity[node])]
    if model.moving or fast or lone:
        masses = {table.at("bar_mass", b) for b in fast} | table.point_masses(*lone, *model.bars[fast].ravel().tolist())
        out[table.at("kinetic", 0)] = masses.union(*(table.momentum(node) for node in model.moving))
    return out


def joined_bars(model: Model) -> set[int]:
    """Bars that are no group of class 1, and those that share a node."""
    shared = np.bincount(model.bars.ravel(), minlength=len(model.nodes)) > 1
    beyond = {bar for group in model.groups if not group.class_1 for bar in group.bars}
    return beyond | set(np.flatnonzero(shared[model.bars].any(axis=1)).tolist())


class Places:
    """Sets of value references that belong together in one model.

    end: the first reference behind them;
    movers: node -> places among the moved nodes of those that it moves with: itself, its bar's pinned end, or those of its
    group; group_of: bar -> its group of bars that move each other, of those that the kernel keeps in their nodes' coordinates;
    joined: node -> the same, of nodes that are not fixed along all axes.
    """

    def __init__(self, model: Model):
        self.model = model
        self.places = layout(model.counts)
        reals = max(place.stop for place in self.places.values())
        for name, place in layout(model.counts, INTEGER_FIELDS).items():
            self.places[name] = slice(reals + place.start, reals + place.stop)
        self.end = max(place.stop for place in self.places.values())
        self.first_beam, beams = {}, 0
        for s, nsh in model.honeycombs.items():
            self.first_beam[s] = beams
            beams += len(nsh.Q)
        joined_in_kernel = joined_bars(model)
        joined = [group for group in model.groups if not joined_in_kernel.isdisjoint(group.bars)]
        self.group_of = {b: group for group in joined for b in group.bars}
        self.joined = {node: group for group in joined for node in group.nodes if not model.fixed[node]}
        self.movers = self._movers()

    def _movers(self) -> dict[int, tuple[int, ...]]:
        moving, bars = self.model.moving, self.model.bars.tolist()
        found: dict[int, tuple[int, ...]] = {node: (i,) for i, node in enumerate(moving)}
        for b, (first, second) in enumerate(bars):
            for node, other in ((first, second), (second, first)):
                if node in moving and b not in self.group_of:
                    found[other] = (moving.index(node),)
        for node, group in self.joined.items():
            if those := tuple(i for i, other in enumerate(moving) if other in group.nodes):
                found[node] = those
        return found

    def knowns(self) -> set[int]:
        """All inputs and parameters."""
        given = (field for field in (*FIELDS, *INTEGER_FIELDS) if field.role != "output")
        return set().union(*(self.all(field.name) for field in given))

    def at(self, field: str, index: int) -> int:
        return self.places[field].start + index

    def field_of(self, reference: int) -> tuple[str, int]:
        """The field of a reference, and its place there."""
        return next((name, reference - at.start) for name, at in self.places.items() if at.start <= reference < at.stop)

    def all(self, field: str) -> set[int]:
        return set(range(self.places[field].start, self.places[field].stop))

    def of_node(self, field: str, node: int) -> set[int]:
        """A motion input of the moved nodes that this one moves with."""
        axes = len(self.model.axes)
        return {self.at(field, mover * axes + axis) for mover in self.movers.get(node, ()) for axis in range(axes)}

    def masses(self, node: int) -> set[int]:
        """Of the group of bars that a node belongs to, of those beyond class 1."""
        if node not in self.joined:
            return set()
        group = self.joined[node]
        return {self.at("bar_mass", b) for b in group.bars} | self.point_masses(*group.nodes)

    def place(self, node: int, axis: int | None = None) -> set[int]:
        """Where a node is that moves with a moved one: along an axis, or at all.  A group of bars goes there the least way, in
        the metric of its masses."""
        known = self.of_node("node_position", node)
        if known and node in self.joined:
            return known | self.masses(node)
        axes = len(self.model.axes)
        return known if axis is None else {self.at("node_position", m * axes + axis) for m in self.movers.get(node, ())}

    def point_masses(self, *nodes: int) -> set[int]:
        """The masses at these nodes beside those of bars: point masses, and of strings that have mass."""
        points = {self.at("point_mass", i) for i, (at, _) in enumerate(self.model.point_mass) if at in nodes}
        heavy = self.model.massive_strings
        shared = {self.at("string_mass", heavy.index(string)) for string, at, _ in self.model.string_mass_shares if at in nodes}
        return points | shared

    def velocity(self, node: int) -> set[int]:
        """What the velocity of a node depends on that moves with a moved one.  Of the bar's masses the impulse only knows the
        ratio."""
        known = self.of_node("node_velocity", node)
        if known and node in self.joined:
            return known | self.place(node)
        payload = self.point_masses(node)
        bars = np.flatnonzero((self.model.bars == node).any(axis=1))
        if known and payload and not self.model.fixed[node]:
            known |= payload | {self.at("bar_mass", int(b)) for b in bars}
        return known

    def momentum(self, node: int) -> set[int]:
        """What the kinetic energy of a moved node and of the bar that is pinned there depends on."""
        ends = {node} | {int(end) for bar in self.model.bars if node in bar for end in bar}
        ends |= {other for other, group in self.joined.items() if node in group.nodes}
        known = self.point_masses(*ends).union(*map(self.masses, ends), *map(self.velocity, ends))
        return known | {self.at("bar_mass", b) for b, bar in enumerate(self.model.bars) if node in bar}

    def ends(self, s: int) -> set[int]:
        """Where the string's nodes are."""
        return set().union(*map(self.place, self.model.paths[s]))

    def curve(self, s: int) -> set[int]:
        """The shape of a string's NSH."""
        if s not in self.model.honeycombs:
            return set()
        beams = range(self.first_beam[s], self.first_beam[s] + len(self.model.honeycombs[s].Q))
        return {self.at(name, i) for name in ("nsh_Q", "nsh_zeta", "nsh_h") for i in beams}

    def elastic(self, s: int) -> set[int]:
        known = {self.at("stiffness", s)} | self.curve(s) | self.ends(s)
        return known if self.model.actuator[s] else known | {self.at("rest_length", s)}

    def tension(self, s: int) -> set[int]:
        rates = set().union(*(self.velocity(node) for node in self.model.paths[s]))
        if not self.model.actuator[s]:
            rates |= {self.at("rest_length_rate", s)}
        moves = rates or np.any(self.model.velocity[list(self.model.paths[s])])
        return self.elastic(s) | rates | {self.at("damping", s)} if moves else self.elastic(s)

    def node(self, node: int) -> set[int]:
        """The force on a node by its strings, by drag and, where it is free, by the input."""
        known = set().union(*(self.tension(s) for s, path in enumerate(self.model.paths) if node in path))
        for i, (at, _) in enumerate(self.model.drag):
            if at == node and (self.velocity(node) or np.any(self.model.velocity[node])):
                known |= self.velocity(node) | {self.at("drag", i)}
        free = np.flatnonzero(self.model.free_nodes == node)
        axes = len(self.model.axes)
        return known | {self.at("force", int(f) * axes + axis) for f in free for axis in range(axes)}

    def group_force(self, b: int) -> set[int]:
        """What acts on the group of a bar that moves others."""
        group = self.group_of[b]
        known = {self.at("bar_mass", i) for i in group.bars} | self.point_masses(*group.nodes) | self.all("gravity")
        known = known.union(*(self.node(node) for node in group.nodes if not self.model.fixed[node]))
        moved = ("node_position", "node_velocity", "node_acceleration")
        return known.union(*(self.of_node(field, node) for field in moved for node in group.nodes))

    def bar_force(self, b: int) -> set[int]:
        if b in self.group_of:
            return self.group_force(b)
        ends = [int(node) for node in self.model.bars[b]]
        free = [node for node in ends if not self.model.fixed[node]]
        known = set().union(*(self.node(node) for node in free))
        if len(free) == 2:
            payload = self.point_masses(*ends)
            turns = bool(np.any(self.model.velocity[ends[0]] != self.model.velocity[ends[1]]))
            return known | payload | {self.at("bar_mass", b)} if payload or turns else known
        motion = (self.of_node(field, ends[0]) for field in ("node_velocity", "node_acceleration"))
        return known.union(self.weight(b, free), *motion)

    def reaction(self, node: int, axis: int) -> set[int]:
        bars = np.flatnonzero((self.model.bars == node).any(axis=1))
        if not len(bars):
            return self.node(node) | self.inertia(node, axis)
        known = self.node(node) | self.of_node("node_velocity", node) | self.of_node("node_acceleration", node)
        for b in bars.tolist():
            if b in self.group_of:
                known |= self.group_force(b)
                continue
            ends = [int(end) for end in self.model.bars[b]]
            known |= self.weight(int(b), ends).union(*(self.node(end) for end in ends))
        return known

    def inertia(self, node: int, axis: int) -> set[int]:
        """Of a point mass at an anchor: weight and inertia along an axis."""
        payload, axes = self.point_masses(node), len(self.model.axes)
        if not payload:
            return set()
        if self.model.counts["V"] > 1:
            known = payload | {self.at("gravity", axis)}
        else:
            known = payload | self.all("gravity") if self.model.axes[axis] == 2 else set()
        if node in self.movers:
            known |= payload | {self.at("node_acceleration", m * axes + axis) for m in self.movers[node]}
        return known

    def weight(self, b: int, nodes: list[int]) -> set[int]:
        """Of a bar and of the other masses at these of its nodes."""
        return self.all("gravity") | {self.at("bar_mass", b)} | self.point_masses(*nodes)

    def weights(self) -> set[int]:
        return self.all("gravity") | self.all("bar_mass") | self.all("point_mass") | self.all("string_mass")
