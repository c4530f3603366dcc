"""A structure at rest, formulated once: vectors of its members, unbalanced force, tangent stiffness, energy.

Unknowns are the n coordinates x of the free nodes.  Under loads p (n,) and with the force densities q of all members (a
string's is its tension over its length) the unbalanced force and its derivative are

    F = p - sum over members of q v at the second end and -q v at the first,   v: from the first end to the second,
    K = sum over members of [B -B; -B B],   B = k u u^T + q (1 - u u^T) of a string, q 1 of a bar,

with a string's stiffness k and direction u = v/|v|; for routed strings see `routed`.  Bars keep their lengths: the unknowns
move along r orthonormal directions, the basis, and a step is brought back.  `Surface` asks for this with the strings' laws from
slack or from their branches, `equilibria.equilibrium` with each string on a given piece, under a load that moves with a
parameter, and `equilibria.saddle` with the bars' force densities as further unknowns.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..model import Model
from .matrices import Dense, Matrix, Sparse, lengths_between
from .members import Members, Shape


class Reduced(NamedTuple):
    """A configuration along the r directions that keep the bars' lengths, the bars' forces being those that balance best.

    basis: (n, r); pull: (r,) N, the unbalanced force; tangent: (r, r) N/m; shape; elongation (S,) m, tension (S,) N and
    stiffness (S,) N/m of the strings.
    """

    basis: Matrix
    pull: np.ndarray
    tangent: Matrix
    shape: Shape
    elongation: np.ndarray
    tension: np.ndarray
    stiffness: np.ndarray


class Balance(Members):
    """Forces and tangent stiffness of a model at any free coordinates (n,).  matrix: `Dense` or `Sparse`.

    bar_length: (B,) m, which the bars keep.
    """

    def __init__(self, model: Model, matrix: type[Dense | Sparse] = Dense):
        super().__init__(model)
        self.bar_length = lengths_between(model.nominal, model.bars)
        axes = len(model.axes)
        self._matrix = self._stiffness_entries(matrix)
        self._routes = self.routed.entries(matrix, self.size) if self.routed is not None else None
        self._values = np.empty((4, axes, axes, len(self._first[0])))  # B, -B, -B, B of every member
        self._blocks = self._values[0], self._values[1:3], self._values[3]
        self._along = np.einsum("iim->im", self._values[0])  # B along its diagonal
        self._material = np.zeros(len(self._first[0]))  # k - q of strings, 0 of bars
        self._of_strings = self._material[: self._count]
        self._prepare_bars(matrix)

    def _stiffness_entries(self, matrix: type[Dense | Sparse]) -> Dense | Sparse:
        ends = self._first, self._second
        rows = np.stack([ends[i][:, None] for i in (0, 0, 1, 1)])  # (4, D, 1, S+B)
        columns = np.stack([ends[j][None] for j in (0, 1, 0, 1)])
        return matrix(rows, columns, (self.size, self.size))

    def _prepare_bars(self, matrix: type[Dense | Sparse]) -> None:
        """A bar contributes its turning about each direction across it and, if both ends are free, its translations to the
        basis; a node on no bar its own."""
        model, D = self.model, len(self.model.axes)
        fixed = model.fixed[model.bars].T[:, None]  # (2, 1, B)
        afloat = ~fixed.any(axis=(0, 1))
        self._own = np.where(fixed, 1.0, np.where(afloat, 0.5, 0.0))  # an end moves back to this much of its place,
        self._others = np.where(fixed, 0.0, np.where(afloat, 0.5, 1.0))  # that much of the other's, and so far along the bar
        self._lever = self._others * np.array([[[-1.0]], [[1.0]]])
        self._share = np.where(afloat, math.sqrt(0.5), 1.0)
        first, second = self._ends_of_bars
        turning = np.arange(len(model.bars) * (D - 1)).reshape(-1, D - 1).T[None]  # (1, D-1, B)
        shifts = turning.size + np.arange(int(afloat.sum()) * D).reshape(-1, D).T
        lone = self.place[model.lone_nodes].ravel()
        alone = turning.size + shifts.size + np.arange(len(lone))
        places_of = [np.broadcast_arrays(end[:, None], turning) for end in (first, second)]
        places_of += [(end[:, afloat], shifts) for end in (first, second)] + [(lone, alone)]
        rows, columns = (np.concatenate([pair[i].ravel() for pair in places_of]) for i in (0, 1))
        self._still = np.concatenate([np.full(2 * shifts.size, math.sqrt(0.5)), np.ones(len(lone))])
        self._directions = matrix(rows, columns, (self.size, turning.size + shifts.size + len(lone)))
        self._one = np.eye(D)[:, :-1, None]

    def moved(self, free: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Free coordinates after a step (n,), bars brought back to their lengths: about the fixed end or the centre."""
        among = np.concatenate((free + step, self._held))
        ends = among.take(self._ends_of_bars)  # (2, D, B)
        bar = ends[1] - ends[0]
        bar *= self.bar_length / np.sqrt(np.add.reduce(bar * bar))
        among[self._ends_of_bars] = self._own * ends + self._others * ends[::-1] + self._lever * bar
        return among[: self.size]

    def energy(self, stored: np.ndarray, load: np.ndarray, free: np.ndarray) -> float:
        """J: what the strings have stored (S,), less the work of loads (n,) from the start on."""
        return float(stored.sum() - load @ (free - self.start))

    def stiffness(self, shape: Shape, stiffness: np.ndarray, density: np.ndarray) -> Matrix:
        """(n, n) N/m: K, from the strings' stiffnesses (S,), N/m, and all members' force densities (S+B,), N/m."""
        if self.routed is None or self._routes is None or shape.ways is None:
            return self._straight(shape, stiffness, density)
        strings, density = self.routed.strings, density.copy()
        tension, density[strings] = density[strings] * shape.ways.lengths, 0.0
        routed = self.routed.stiffness(self._routes, shape.ways, stiffness[strings], tension)
        return self._straight(shape, stiffness, density) + routed

    def _straight(self, shape: Shape, stiffness: np.ndarray, density: np.ndarray) -> Matrix:
        """The same of all members that join two nodes."""
        np.subtract(stiffness, density[: self._count], out=self._of_strings)
        unit = shape.vectors / shape.lengths
        block, across, last = self._blocks
        np.multiply((self._material * unit)[:, None], unit, out=block)
        self._along += density
        np.negative(block, out=across)
        last[:] = block
        return self._matrix(self._values)

    def basis(self, shape: Shape) -> Matrix:
        """(n, r) orthonormal: turns of every bar across itself (a Householder reflection), shifts of those afloat and of nodes
        on no bar."""
        mirror = shape.vectors[:, self._count :] / shape.lengths[self._count :]
        mirror[-1] += np.copysign(1.0, mirror[-1])
        scaled = 2.0 * mirror / np.add.reduce(mirror * mirror)
        across = ((self._one - mirror[:, None] * scaled[:-1]) * self._share).ravel()
        return self._directions(np.concatenate((-across, across, self._still)))

    def at(self, free: np.ndarray, rest_length: np.ndarray, load: np.ndarray, laws: Callable) -> Reduced:
        """The structure along the directions that keep the bars' lengths, under rest lengths (S,), m, and loads (n,), N.

        laws: tension (S,) N, stiffness (S,) N/m, ... at elongations (S,), m.
        """
        shape = self.shape(free)
        elongation = shape.length - rest_length
        tension, stiffness = laws(elongation)[:2]
        density = tension / shape.length
        force = self.unbalanced(shape, load, density)
        density = np.concatenate([density, self.bar_density(shape, force)])
        basis = self.basis(shape)
        tangent = basis.T @ self.stiffness(shape, stiffness, density) @ basis
        return Reduced(basis, basis.T @ force, tangent, shape, elongation, tension, stiffness)
