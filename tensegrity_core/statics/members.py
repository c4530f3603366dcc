"""The members of a structure: their vectors at any coordinates, and what they pull on the free nodes.

Arrays of members have the axes first, (D, S+B), strings before bars.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..model import Model
from ..model.welds import distances
from .matrices import free_rows, freedoms
from .routed import TINY, Routed, Ways


def members(model: Model) -> np.ndarray:
    """(S+B, 2) nodes at the ends of all members, strings first; followed, where bars are welded, by the pairs of nodes whose
    distances welds keep, which count as bars here."""
    kept = [distances(model)] if model.welds else []
    return np.vstack([model.strings, model.bars, *kept])


def places(model: Model) -> np.ndarray:
    """(N, D) int: the degree of freedom of each node along each axis, -1 where it is fixed."""
    place = np.full(len(model.nodes) * len(model.axes), -1)
    place[model.free_coordinates] = np.arange(freedoms(model))
    return place.reshape(-1, len(model.axes))


class Shape(NamedTuple):
    """Members at one configuration.  vectors: (D, S+B) m; squared, lengths: (S+B,) m2, m; length: (S,) m, of the strings;
    free: (n,) m, the free coordinates; ways: of routed strings, whose vectors are zero and whose lengths are those of the whole
    way.  None: there are none."""

    vectors: np.ndarray
    squared: np.ndarray
    lengths: np.ndarray
    length: np.ndarray
    free: np.ndarray
    ways: Ways | None = None


class Members:
    """The members of a model at any free coordinates (n,).

    size: n; wide: n and the fixed nodes' coordinates; place: (N, D), see `places`; start: (n,) m; routed: None without routed
    strings.
    """

    def __init__(self, model: Model):
        self.model, self.size, self.place = model, freedoms(model), places(model)
        self.start = free_rows(model, model.nodes)
        self._count = len(model.strings)
        held = self.place < 0
        self._held = model.nodes[:, model.axes][held]
        among = self.place.copy()  # in the free coordinates, followed by those of the fixed nodes
        among[held] = self.size + np.arange(len(self._held))
        self.routed = Routed(model, among) if model.routes else None
        self._ends = np.ascontiguousarray(among[members(model)].transpose(1, 2, 0))  # (2, D, S+B)
        self._first, self._second = self._ends
        self.wide = self.size + len(self._held)
        beginning = self.wide * np.arange(len(self._first[0]))  # of a member's row
        self._row_first, self._row_second = self._first + beginning, self._second + beginning
        self._pulled = {count: self._pulled_by(count) for count in (self._count, len(self._first[0]))}
        split = np.split(self._ends, [self._count], axis=2)
        self._ends_of_strings, self._ends_of_bars = (np.ascontiguousarray(ends) for ends in split)
        self._free_ends = np.maximum(2.0 - model.fixed[model.bars].sum(axis=1), 1e-300)
        self._unfelt = np.zeros(len(self._held))

    def _pulled_by(self, count: int) -> np.ndarray:
        """Places of a load and of what so many members pull on their ends."""
        return np.concatenate([np.arange(self.size), self._first[:, :count].ravel(), self._second[:, :count].ravel()])

    def free(self, nodes: np.ndarray) -> np.ndarray:
        """(n,) free coordinates of nodes (N, 3)."""
        return free_rows(self.model, nodes)

    def nodes(self, free: np.ndarray) -> np.ndarray:
        """(N, 3) m."""
        nodes = self.model.nodes.copy()
        flat = nodes[:, self.model.axes].ravel()
        flat[self.model.free_coordinates] = free
        nodes[:, self.model.axes] = flat.reshape(-1, len(self.model.axes))
        return nodes

    def shape(self, free: np.ndarray) -> Shape:
        """Vectors and lengths of all members."""
        among = np.concatenate((free, self._held))
        ends = among.take(self._ends)
        vectors = ends[1] - ends[0]
        squared = np.add.reduce(vectors * vectors)
        lengths = np.sqrt(squared + TINY)
        if self.routed is None:
            return Shape(vectors, squared, lengths, lengths[: self._count], free)
        ways, strings = self.routed.ways(among), self.routed.strings
        vectors[:, strings], squared[strings], lengths[strings] = 0.0, ways.lengths**2, ways.lengths
        return Shape(vectors, squared, lengths, lengths[: self._count], free, ways)

    def lengths(self, free: np.ndarray) -> np.ndarray:
        """(S,) m, of the strings."""
        among = np.concatenate((free, self._held))
        first, second = among.take(self._ends_of_strings)
        vectors = second - first
        found = np.sqrt(np.add.reduce(vectors * vectors))
        if self.routed is not None:
            found[self.routed.strings] = self.routed.ways(among).lengths
        return found

    def unbalanced(self, shape: Shape, load: np.ndarray, density: np.ndarray) -> np.ndarray:
        """(n,) N: loads (n,) and the pull of the strings, or of all members, with these force densities, N/m."""
        pull = (density * shape.vectors[:, : len(density)]).ravel()
        found = np.bincount(self._pulled[len(density)], np.concatenate((load, pull, -pull)), self.wide)[: self.size]
        if self.routed is None or shape.ways is None:
            return found
        tension = density[self.routed.strings] * shape.ways.lengths
        return found + self.routed.pull(shape.ways, tension, self.wide)[: self.size]

    def bar_density(self, shape: Shape, force: np.ndarray) -> np.ndarray:
        """(B,) N/m: bar force densities that balance forces (n,) best; no two bars share a node."""
        first, second = np.concatenate((force, self._unfelt)).take(self._ends_of_bars)
        along = np.add.reduce(shape.vectors[:, self._count :] * (second - first))
        return along / (self._free_ends * shape.squared[self._count :])

    def balanced(self, shape: Shape, load: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All members' force densities (S+B,), N/m, the bars' those that balance best with the strings' (S,), and what stays
        unbalanced (n,), N."""
        density = np.concatenate((density, self.bar_density(shape, self.unbalanced(shape, load, density))))
        return density, self.unbalanced(shape, load, density)

    def rows(self, shape: Shape, out: np.ndarray | None = None) -> np.ndarray:
        """(S+B, n) m: derivatives of half the members' squared lengths; out: (S+B, `wide`), zeros at first."""
        rows = np.zeros((len(shape.squared), self.wide)) if out is None else out
        flat = rows.reshape(-1)
        flat[self._row_second] = shape.vectors
        flat[self._row_first] = -shape.vectors
        if self.routed is not None and shape.ways is not None:
            self.routed.fill(rows, shape.ways)
        return rows[:, : self.size]
