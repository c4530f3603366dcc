"""On which inputs and parameters each output depends at the start, where positions and velocities are the scene's.

At the start the lengths of the strings are given, so that an elastic force depends on its own string only; a bar pinned
at one end swings under everything at its tip, a free bar's axial force is half the difference of its two end forces.
"""

from __future__ import annotations

import numpy as np

from tensegrity_core.fields import INTEGER_FIELDS, layout
from tensegrity_core.model import Model


def initial_dependencies(model: Model) -> dict[int, set[int]]:
    """Value reference of an output -> value references of inputs and parameters; outputs that depend on none are left
    out (positions, velocities, lengths: the scene's; energies that count from the start: zero).
    """
    table = _Table(model)
    out: dict[int, set[int]] = {}
    for s in range(len(model.strings)):
        out[table.at("elastic_force", s)] = table.elastic(s)
        out[table.at("string_force", s)] = table.tension(s)
    for i, s in enumerate(model.nsh_strings):
        out[table.at("snapped", i)] = table.curve(s) | {table.at("rest_length", s)}
    for b in range(len(model.bars)):
        out[table.at("bar_force", b)] = table.bar_force(b)
    axes = len(model.axes)
    for g, node in enumerate(model.fixed_nodes):
        for axis in range(axes):
            out[table.at("reaction", g * axes + axis)] = table.reaction(int(node), axis)
    everything = [table.elastic(s) for s in range(len(model.strings))]
    out[table.at("elastic", 0)] = set().union(*everything)
    out[table.at("potential", 0)] = {table.at("gravity", 0)} | {table.at("bar_mass", b) for b in range(len(model.bars))}
    return out


class _Table:
    """Sets of value references that belong together in one model."""

    def __init__(self, model: Model):
        self.model = model
        self.places = layout(model.counts)
        reals = max(place.stop for place in self.places.values())
        for name, place in layout(model.counts, INTEGER_FIELDS).items():
            self.places[name] = slice(reals + place.start, reals + place.stop)
        self.first_beam, beams = {}, 0
        for s in model.nsh_strings:
            self.first_beam[s] = beams
            beams += len(model.nsh[s].Q)

    def at(self, field: str, index: int) -> int:
        return self.places[field].start + index

    def curve(self, s: int) -> set[int]:
        """The shape of a string's NSH."""
        if self.model.nsh[s] is None:
            return set()
        beams = range(self.first_beam[s], self.first_beam[s] + len(self.model.nsh[s].Q))
        return {self.at(name, i) for name in ("nsh_Q", "nsh_zeta", "nsh_h") for i in beams}

    def elastic(self, s: int) -> set[int]:
        return {self.at("rest_length", s), self.at("stiffness", s)} | self.curve(s)

    def tension(self, s: int) -> set[int]:
        return self.elastic(s) | {self.at("rest_length_rate", s), self.at("damping", s)}

    def node(self, node: int) -> set[int]:
        """The force on a node by its strings and, where it is free, by the input."""
        touching = np.flatnonzero((self.model.strings == node).any(axis=1))
        known = set().union(*(self.tension(int(s)) for s in touching))
        free = np.flatnonzero(self.model.free_nodes == node)
        axes = len(self.model.axes)
        return known | {self.at("force", int(f) * axes + axis) for f in free for axis in range(axes)}

    def bar_force(self, b: int) -> set[int]:
        ends = [int(node) for node in self.model.bars[b]]
        free = [node for node in ends if not self.model.fixed[node]]
        known = set().union(*(self.node(node) for node in free))
        return known if len(free) == 2 else known | self.weight(b)

    def reaction(self, node: int, axis: int) -> set[int]:
        bars = np.flatnonzero((self.model.bars == node).any(axis=1))
        known = self.node(node)
        for b in bars:
            known |= self.weight(int(b)).union(*(self.node(int(end)) for end in self.model.bars[b]))
        return known

    def weight(self, b: int) -> set[int]:
        return {self.at("gravity", 0), self.at("bar_mass", b)}
