"""On which tunable parameters outputs, derivatives of states and event indicators of model exchange depend, see states.py for
states and inputs.  FMI 3.0 lists these, too; FMI 2.0 does not.

Gravity moves centres of mass and turns pinned bars; it says nothing to a free bar's axial force, since both ends fall alike.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .states import Graph


class Tunables:
    """Sets of value references, by the graph's blocks and references."""

    def __init__(self, graph: Graph):
        self.graph, self.model, self.places = graph, graph.model, graph.places
        self.strings = range(len(self.model.strings))

    # --- what changes what ------------------------------------------------------------------------------------------------

    def elastic(self, s: int) -> set[int]:
        return {self.places.at("stiffness", s)}

    def tension(self, s: int) -> set[int]:
        return self.elastic(s) | {self.places.at("damping", s)}

    def gravity(self, axis: int | None = None) -> set[int]:
        """Along an axis, or all of it."""
        if axis is None:
            return self.places.all("gravity")
        if self.model.counts["V"] > 1:
            return {self.places.at("gravity", axis)}
        return self.places.all("gravity") if self.model.axes[axis] == 2 else set()

    def on_node(self, node: int) -> set[int]:
        """The force on a node by strings and drag."""
        found = {self.places.at("drag", r) for r, (at, _) in enumerate(self.model.drag) if at == node}
        return found.union(*(self.tension(s) for s, path in enumerate(self.model.paths) if node in path))

    def on_bar(self, b: int) -> set[int]:
        """The forces that turn it: at both ends of a free bar, at the tip of a pinned one with gravity; of one that moves
        others those of its group."""
        if b in self.places.group_of:
            nodes = self.places.group_of[b].nodes
            return self.gravity().union(*(self.on_node(node) for node in nodes if not self.model.fixed[node]))
        free = [int(node) for node in self.model.bars[b] if not self.model.fixed[node]]
        found = set().union(*(self.on_node(node) for node in free))
        return found if len(free) == 2 else found | self.gravity()

    # --- what is asked ----------------------------------------------------------------------------------------------------

    def derivative(self, state: int) -> frozenset[int]:
        """The derivative of a state."""
        graph = self.graph
        if state < graph.half:
            return frozenset()
        if state >= 2 * graph.half:
            return frozenset(self._power(state - 2 * graph.half))
        block, axis = graph.place(state - graph.half)
        for s, motor in graph.motor.items():
            if motor == block:
                return frozenset(self.tension(s))
        for b, own in enumerate(graph.of_bar):
            if block in own[-1:]:
                return frozenset(self.on_bar(b))
            if block in own:
                return frozenset(self.on_bar(b) | self.gravity(axis))
        node = next(node for node, own in graph.of_node.items() if own == [block])
        group = self.places.joined.get(node)
        return frozenset(self.on_node(node) | self.gravity(axis) if group is None else self.on_bar(group.bars[0]))

    def _power(self, which: int) -> set[int]:
        """Of the dissipated energy (0), of the input work (1)."""
        if which == 0:
            springs = "stiffness" if self.model.damping_law == "tension_only" else "damping"  # of clipped strings
            return self.places.all(springs) | self.places.all("damping") | self.places.all("drag")
        found = set().union(*(self.tension(s) for s in self.strings if s not in self.graph.motor))
        return found.union(*(self._reaction(node, axis) for node in self.model.moving for axis in range(self.graph.axes)))

    def output(self, reference: int) -> frozenset[int]:
        """An output."""
        field, place = self.places.field_of(reference)
        method = getattr(self, f"output_{field}", None)
        return frozenset(method(place)) if method else frozenset()

    def output_string_force(self, s: int) -> set[int]:
        return self.tension(s)

    def output_elastic_force(self, s: int) -> set[int]:
        return self.elastic(s)

    def output_bar_force(self, b: int) -> set[int]:
        return self.on_bar(b)

    def output_bar_utilisation(self, i: int) -> set[int]:
        return self.output_bar_force(self.model.sections[i][0])

    def output_string_utilisation(self, i: int) -> set[int]:
        return self.tension(self.model.strength[i][0])

    def output_reaction(self, i: int) -> set[int]:
        return self._reaction(int(self.model.grounded_nodes[i // self.graph.axes]), i % self.graph.axes)

    def _reaction(self, node: int, axis: int) -> set[int]:
        bars = [b for b, ends in enumerate(self.model.bars.tolist()) if node in ends]
        weighs = self.places.point_masses(node)
        return self.on_node(node).union(self.gravity(axis) if weighs else set(), *(self.on_bar(b) for b in bars))

    def output_potential(self, _: int) -> set[int]:
        return self.gravity()

    def output_elastic(self, _: int) -> set[int]:
        return self.places.all("stiffness")

    def indicator(self, s: int, i: int) -> frozenset[int]:
        """A string's event indicator: only that of being clipped knows forces."""
        return frozenset(self.tension(s) if i == 2 else ())
