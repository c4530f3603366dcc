"""What statics knows of routed strings: one tension along several segments.

With the segments' unit vectors u and lengths l the length of a string is L = sum of l; its derivative by the coordinates of a
segment's ends is u at the second and -u at the first, so that with the tension T and the stiffness k

    pull = -T dL/dx,   tangent stiffness = k dL/dx dL/dx^T + sum of T/l [1 - u u^T] over the segments:

the first term couples all nodes on the way.  Places are those of `Members`: the free coordinates, then the fixed nodes'.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..model import Model
from ..model.routes import segments
from .matrices import Dense, Matrix, Sparse

#: Added to squared lengths, m2: keeps 0/0 out where a segment's ends meet, and is lost in any other.
TINY = 1e-300


class Ways(NamedTuple):
    """Routed strings at one configuration.  units: (D, X) of the segments; parts: (X,) m, their lengths; lengths: (R,) m, of
    the strings."""

    units: np.ndarray
    parts: np.ndarray
    lengths: np.ndarray


class Routed:
    """The routed strings of a model.  strings: (R,) their indices; among: (N, D) places of the nodes' coordinates."""

    def __init__(self, model: Model, among: np.ndarray):
        self.strings = np.array([string for string, _ in model.routes], dtype=int)
        found = segments(tuple(path for _, path in model.routes))
        self._of = found.string  # (X,) whose a segment is, among the routed
        self._ends = np.ascontiguousarray(among[found.ends].transpose(1, 2, 0))  # (2, D, X)
        self._first, self._second = self._ends
        members = [np.flatnonzero(self._of == string) for string in range(len(self.strings))]
        self._one = np.concatenate([np.repeat(own, len(own)) for own in members])  # pairs of segments of one string
        self._other = np.concatenate([np.tile(own, len(own)) for own in members])
        self._same = np.flatnonzero(self._one == self._other)

    def ways(self, coordinates: np.ndarray) -> Ways:
        """From the coordinates at all places."""
        ends = coordinates.take(self._ends)
        vectors = ends[1] - ends[0]
        parts = np.sqrt(np.add.reduce(vectors * vectors) + TINY)
        return Ways(vectors / parts, parts, np.bincount(self._of, parts, len(self.strings)))

    def pull(self, ways: Ways, tension: np.ndarray, size: int) -> np.ndarray:
        """(size,) N at the places, from tensions (R,)."""
        force = (tension[self._of] * ways.units).ravel()
        at = np.concatenate((self._first.ravel(), self._second.ravel()))
        return np.bincount(at, np.concatenate((force, -force)), size)

    def fill(self, rows: np.ndarray, ways: Ways) -> None:
        """Write the derivatives of half the strings' squared lengths, m, into their rows (S+B, places)."""
        rows[self.strings] = 0.0
        slope = ways.lengths[self._of] * ways.units
        owner = np.broadcast_to(self.strings[self._of], slope.shape)
        np.add.at(rows, (owner, self._second), slope)
        np.subtract.at(rows, (owner, self._first), slope)

    def entries(self, matrix: type[Dense | Sparse], size: int) -> Dense | Sparse:
        """Where the tangent stiffness has values."""
        ends = self._ends
        rows = np.stack([ends[i][:, self._one][:, None] for i in (0, 0, 1, 1)])  # (4, D, 1, pairs)
        columns = np.stack([ends[j][:, self._other][None] for j in (0, 1, 0, 1)])
        return matrix(rows, columns, (size, size))

    def stiffness(self, entries: Dense | Sparse, ways: Ways, stiffness: np.ndarray, tension: np.ndarray) -> Matrix:
        """N/m, from stiffnesses (R,), N/m, and tensions (R,), N."""
        units, of = ways.units, self._of
        blocks = stiffness[of[self._one]] * units[:, None, self._one] * units[None, :, self._other]  # (D, D, pairs)
        across = np.eye(len(units))[:, :, None] - units[:, None] * units[None]
        blocks[:, :, self._same] += tension[of] / ways.parts * across
        return entries(np.stack([blocks, -blocks, -blocks, blocks]))
