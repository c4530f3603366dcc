"""Equilibrium under a load that moves with one parameter: the equations that `paths` follows.

Unknowns are the n coordinates of the free nodes, on the surface where every bar keeps its length, and the parameter p.  As
in `statics`, forces and tangent stiffness are taken along r orthonormal directions that keep the bars' lengths; but each
string's law is that of a given piece of its force curve, smooth also beyond the piece's ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .. import statics
from ..laws.string_laws import string_laws
from .loading import Loading


class Tangent(NamedTuple):
    """The equations at one configuration, along r orthonormal directions that keep the bars' lengths.

    basis: (n, r); pull: (r,) N, the unbalanced force; stiffness: (r, r) N/m; push: (r,) N, derivative of the pull by p;
    growth: (S, n), derivatives of the strings' lengths by the free coordinates; elongation: (S,) m; tension: (S,) N.
    """

    basis: np.ndarray
    pull: np.ndarray
    stiffness: np.ndarray
    push: np.ndarray
    growth: np.ndarray
    elongation: np.ndarray
    tension: np.ndarray


class Equations:
    """Equilibrium of a model under a loading, in the n coordinates of its free nodes; dense matrices throughout."""

    def __init__(self, loading: Loading):
        self.loading, self.model = loading, loading.model
        model = self.model
        statics.require_small(model, "following an equilibrium path")
        self.laws = string_laws(model)
        self._winding = loading.winds
        self.stiffest = float(model.stiffness.max(initial=0.0))
        self.place = statics.places(model)
        self.size = statics.freedoms(model)
        strings = self._incidence(model.strings)  # (S, D, n)
        self._shape = strings.shape
        self._members = np.concatenate([strings, self._incidence(model.bars)]).reshape(-1, self.size)
        self._strings, self._bars = np.split(self._members, [strings[:, :, 0].size])
        held = np.where(model.fixed[:, None], model.nodes, 0.0)[:, model.axes]
        ends = statics.members(model)
        self._offset = (held[ends[:, 1]] - held[ends[:, 0]]).ravel()
        self._string_offset, self._bar_offset = np.split(self._offset, [len(self._strings)])
        self.bar_length = statics.lengths_between(model.nominal, model.bars)
        dead = statics.loads(model, loading.force)
        self.dead, self.live = statics.free_rows(model, dead), statics.free_rows(model, loading.force_direction)
        self._free_ends = 2.0 - model.fixed[model.bars[:, 0]] - model.fixed[model.bars[:, 1]]
        self._prepare_basis()

    def _incidence(self, ends: np.ndarray) -> np.ndarray:
        """(M, D, n): how the vector along each member follows from the free coordinates."""
        matrix = np.zeros((len(ends), len(self.model.axes), self.size + 1))
        member, axis = np.ogrid[: len(ends), : len(self.model.axes)]
        matrix[member, axis, self.place[ends[:, 1]]] += 1.0
        matrix[member, axis, self.place[ends[:, 0]]] -= 1.0
        return matrix[:, :, :-1]

    def _prepare_basis(self) -> None:
        """Which columns a bar's turns and shifts have; see statics._Surface._basis."""
        model, D = self.model, len(self.model.axes)
        first, second = self.place[model.bars[:, 0]], self.place[model.bars[:, 1]]
        afloat = (first[:, 0] >= 0) & (second[:, 0] >= 0)
        turns = len(model.bars) * (D - 1)
        lone = self.place[model.lone_nodes].ravel()
        alone = turns + int(afloat.sum()) * D
        self._rank = alone + len(lone)
        self._still = np.zeros((self.size + 1, self._rank))  # the last row takes what fixed nodes would get
        self._still[lone, alone + np.arange(len(lone))] = 1.0
        shifts = turns + np.arange(alone - turns).reshape(-1, D)
        for end in (first, second):
            self._still[end[afloat], shifts] = np.sqrt(0.5)
        self._one = np.eye(D)
        self._turning = np.arange(turns).reshape(-1, 1, D - 1)
        self._first, self._second = first[:, :, None], second[:, :, None]
        self._share = np.where(afloat, np.sqrt(0.5), 1.0)[:, None, None]
        self._lever_first = np.where(first[:, :1] < 0, 0.0, np.where(second[:, :1] < 0, -1.0, -0.5))
        self._lever_second = np.where(second[:, :1] < 0, 0.0, np.where(first[:, :1] < 0, 1.0, 0.5))

    def free(self, nodes: np.ndarray) -> np.ndarray:
        """(n,) free coordinates of nodes (N, 3)."""
        return nodes[self.model.free_nodes][:, self.model.axes].ravel()

    def nodes(self, free: np.ndarray) -> np.ndarray:
        """(N, 3) m."""
        nodes = self.model.nodes.copy()
        nodes[np.ix_(self.model.free_nodes, self.model.axes)] = free.reshape(-1, len(self.model.axes))
        return nodes

    def moved(self, free: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Free coordinates after a step (n,), bars brought back to their lengths: about the fixed end or the centre."""
        padded = np.zeros(self.size + 1)  # the last place takes what fixed nodes would get
        free = np.add(free, step, out=padded[:-1])
        bar = (self._bars @ free + self._bar_offset).reshape(-1, self._shape[1])
        excess = bar * (self.bar_length / np.sqrt(np.einsum("bd,bd->b", bar, bar)) - 1.0)[:, None]
        padded[self._first[:, :, 0]] += self._lever_first * excess
        padded[self._second[:, :, 0]] += self._lever_second * excess
        return padded[:-1]

    def elongation(self, free: np.ndarray, parameter: float) -> np.ndarray:
        """(S,) m."""
        along = (self._strings @ free + self._string_offset).reshape(-1, self._shape[1])
        return np.sqrt(np.einsum("sd,sd->s", along, along)) - self.loading.rest_lengths(parameter)

    def at(self, free: np.ndarray, parameter: float, piece: np.ndarray) -> Tangent:
        """The equations with the strings on these pieces (S,)."""
        count, axes, size = self._shape
        along = (self._members @ free + self._offset).reshape(-1, axes)
        squared = np.einsum("md,md->m", along, along)
        length, bar = np.sqrt(squared[:count]), along[count:]
        elongation = length - self.loading.rest_lengths(parameter)
        tension, stiffness = self.laws(elongation, piece)
        growth = ((along[:count] / length[:, None]).ravel()[:, None] * self._strings).reshape(count, axes, size).sum(axis=1)
        total = self.dead + parameter * self.live - tension @ growth
        felt = (self._bars @ total).reshape(bar.shape)
        density = np.concatenate([tension / length, np.einsum("bd,bd->b", bar, felt) / (self._free_ends * squared[count:])])
        full = (growth.T * (stiffness - density[:count])) @ growth
        full += (self._members.T * np.repeat(density, axes)) @ self._members
        basis = self._basis(bar, squared[count:])
        push = self.live + (stiffness * self.loading.rest_length_direction) @ growth if self._winding else self.live
        return Tangent(basis, basis.T @ total, basis.T @ full @ basis, basis.T @ push, growth, elongation, tension)

    def _basis(self, bar: np.ndarray, squared: np.ndarray) -> np.ndarray:
        """(n, r) orthonormal: turns of every bar across itself (a Householder reflection), shifts of those afloat and of nodes
        on no bar."""
        mirror = bar / np.sqrt(squared)[:, None]
        mirror[:, -1] += np.copysign(1.0, mirror[:, -1])
        scaled = 2.0 * mirror / np.einsum("bd,bd->b", mirror, mirror)[:, None]
        across = (self._one - mirror[:, :, None] * scaled[:, None, :])[:, :, :-1] * self._share
        basis = self._still.copy()
        basis[self._first, self._turning] = -across
        basis[self._second, self._turning] = across
        return basis[:-1]

    def energy(self, free: np.ndarray, parameter: float, elongation: np.ndarray | None = None) -> float:
        """J: strings less the work of the loads, from the coordinates' origin.  elongation: (S,) m, where it is known."""
        elongation = self.elongation(free, parameter) if elongation is None else elongation
        return float(
            self.laws.energy(elongation, self.laws.piece_of(elongation)).sum() - (self.dead + parameter * self.live) @ free
        )
