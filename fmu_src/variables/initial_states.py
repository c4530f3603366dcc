"""On which inputs and parameters states and their derivatives depend at the start, see dependencies.py for outputs.

Positions and velocities are the scene's there, but for those of moved nodes and of the bars that are pinned to them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from .dependencies import Places

if TYPE_CHECKING:
    from .states import Graph


class Start:
    """Sets of value references, by the blocks of a graph."""

    def __init__(self, graph: Graph):
        self.graph, self.model, self.places = graph, graph.model, Places(graph.model)
        self.axes = len(self.model.axes)
        self.bar_of = {block: b for b, own in enumerate(graph.of_bar) for block in own}
        self.string_of = {block: s for s, block in graph.motor.items()}
        self.node_of = {own[0]: node for node, own in graph.of_node.items() if own and own[0] not in self.bar_of}

    def state(self, state: int) -> set[int]:
        """Of a state in the kernel's order."""
        half = self.graph.half
        if state >= 2 * half:
            return set()
        block, axis = self.graph.place(state % half)
        return self._rate(block) if state >= half else self._coordinate(block, axis)

    def derivative(self, state: int) -> set[int]:
        """Of its derivative."""
        half = self.graph.half
        if state < half:
            return self.state(half + state)
        if state >= 2 * half:
            return self._dissipated() if state == 2 * half else self._input_work()
        block, axis = self.graph.place(state - half)
        if block in self.string_of:
            return self._winding(self.string_of[block])
        if block in self.node_of:
            node = self.node_of[block]
            if node in self.places.joined:
                return self.places.group_force(self.places.joined[node].bars[0])
            return self._forces(node, axis) | self.places.point_masses(node) | self._gravity(axis)
        return self._bar(self.bar_of[block], axis, turns=block == self.graph.of_bar[self.bar_of[block]][-1])

    def _ends(self, b: int) -> tuple[list[int], list[int]]:
        """Nodes of a bar, and the free ones among them."""
        ends = [int(node) for node in self.model.bars[b]]
        return ends, [node for node in ends if not self.model.fixed[node]]

    def _centre(self, b: int) -> set[int]:
        """Where the centre of mass of a free bar is, that bears point masses."""
        ends, _ = self._ends(b)
        payload = self.places.point_masses(*ends)
        return payload | {self.places.at("bar_mass", b)} if payload else set()

    def _coordinate(self, block: int, axis: int) -> set[int]:
        if self.node_of.get(block) in self.places.joined:
            return self.places.place(self.node_of[block], axis)
        b = self.bar_of.get(block)
        return set() if b is None or block == self.graph.of_bar[b][-1] else self._centre(b)

    def _rate(self, block: int) -> set[int]:
        if self.node_of.get(block) in self.places.joined:
            return self.places.velocity(self.node_of[block])
        b = self.bar_of.get(block)
        if b is None:
            return set()
        ends, free = self._ends(b)
        if len(free) < 2:
            return set().union(*(self.places.velocity(node) | self.places.of_node("node_velocity", node) for node in ends))
        return self._centre(b) if block != self.graph.of_bar[b][-1] and np.any(self.model.velocity[ends]) else set()

    def _gravity(self, axis: int) -> set[int]:
        if self.model.counts["V"] > 1:
            return {self.places.at("gravity", axis)}
        return self.places.all("gravity") if self.model.axes[axis] == 2 else set()

    def _forces(self, node: int, axis: int) -> set[int]:
        """What acts on a free node along an axis."""
        first = int(np.flatnonzero(self.model.free_nodes == node)[0]) * self.axes
        others = {self.places.at("force", first + other) for other in range(self.axes) if other != axis}
        return self.places.node(node) - others

    def _bar(self, b: int, axis: int, turns: bool) -> set[int]:
        ends, free = self._ends(b)
        own = {self.places.at("bar_mass", b)} | self.places.point_masses(*free)
        if not turns:
            return own.union(self._gravity(axis), *(self._forces(node, axis) for node in free))
        own = own.union(*(self.places.node(node) for node in free))
        if len(free) == 2:
            return own
        motion = (self.places.of_node(field, ends[0]) for field in ("node_velocity", "node_acceleration"))
        return own.union(self.places.all("gravity"), *motion)

    def _winding(self, s: int) -> set[int]:
        a = list(self.graph.motor).index(s)
        own = ("current", "drum_load", "motor_inertia", "torque_constant", "drum_radius")
        return self.places.tension(s) | {self.places.at(field, a) for field in own}

    def _stretching(self, s: int) -> set[int]:
        """What a string's length changes by."""
        known = set().union(*(self.places.velocity(node) for node in self.model.paths[s]))
        return known if self.model.actuator[s] else known | {self.places.at("rest_length_rate", s)}

    def _dissipated(self) -> set[int]:
        found: set[int] = set()
        for s in range(len(self.model.strings)):
            rates = self._stretching(s)
            if rates or np.any(self.model.velocity[list(self.model.paths[s])]):
                spring = self.places.elastic(s) if self.model.damping_law == "tension_only" else self.places.ends(s)
                found |= rates | spring | {self.places.at("damping", s)}
        for i, (node, _) in enumerate(self.model.drag):
            known = self.places.velocity(node)
            if known or np.any(self.model.velocity[node]):
                found |= known | {self.places.at("drag", i)}
        return found

    def _input_work(self) -> set[int]:
        found: set[int] = set()
        for s in range(len(self.model.strings)):
            if not self.model.actuator[s]:
                found |= self.places.tension(s) | {self.places.at("rest_length_rate", s)}
        for node in self.model.moving:
            found |= self.places.of_node("node_velocity", node)
            found = found.union(*(self.places.reaction(node, axis) for axis in range(self.axes)))
        # What a force does at the far end of a bar that a moved node sets moving, the ground takes back at the near one.
        found -= self.places.all("force")
        axes, fast = self.axes, np.flatnonzero(np.any(self.model.velocity[self.model.free_nodes] != 0.0, axis=1))
        return found | {self.places.at("force", int(f) * axes + axis) for f in fast for axis in range(axes)}
