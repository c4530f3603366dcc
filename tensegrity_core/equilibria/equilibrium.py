"""Equilibrium under a load that moves with one parameter: the equations that `paths` follows.

Unknowns are the n coordinates of the free nodes, on the surface where every bar keeps its length, and the parameter p.  As
in `statics`, forces and tangent stiffness are taken along r orthonormal directions that keep the bars' lengths; but each
string's law is that of a given piece of its force curve, smooth also beyond the piece's ends.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .. import statics
from ..errors import InputError
from ..laws.string_laws import string_laws
from ..model import Model
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
    """Equilibrium of a model under a loading, in the n coordinates of its free nodes; dense matrices throughout.

    balance: gives forces and tangent stiffness; laws: of the strings; stiffest: N/m, the largest of their stiffnesses.
    """

    def __init__(self, loading: Loading):
        self.loading, self.model = loading, loading.model
        model = self.model
        statics.require_small(model, "following an equilibrium path")
        if model.ground is not None:
            raise InputError(
                f"{model.name}: it stands on the ground, which paths of equilibria do not know yet; leave [ground] out"
            )
        _require_regular(model)
        self.laws = string_laws(model)
        self.balance = balance = statics.balance_of(model)
        self.stiffest = float(model.stiffness.max(initial=0.0))
        self.size, self.place, self.bar_length = balance.size, balance.place, balance.bar_length
        self.free, self.nodes, self.moved = balance.free, balance.nodes, balance.moved
        dead = statics.loads(model, loading.force)
        self._dead, self._live = balance.free(dead), balance.free(loading.force_direction)

    def load(self, parameter: float) -> np.ndarray:
        """(n,) N."""
        return self._dead + parameter * self._live

    def push(self, growth: np.ndarray, stiffness: np.ndarray) -> np.ndarray:
        """(n,) N, derivative of the unbalanced force by p; growth: (S, n), see `Tangent`; stiffness: (S,) N/m."""
        wound = self.loading.rest_length_direction
        return self._live + (stiffness * wound) @ growth if self.loading.winds else self._live

    def elongation(self, free: np.ndarray, parameter: float) -> np.ndarray:
        """(S,) m."""
        return self.balance.lengths(free) - self.loading.rest_lengths(parameter)

    def at(self, free: np.ndarray, parameter: float, piece: np.ndarray) -> Tangent:
        """The equations with the strings on these pieces (S,)."""
        found = self.balance.at(free, self.loading.rest_lengths(parameter), self.load(parameter), self.laws.on(piece))
        growth = self.balance.rows(found.shape)[: len(piece)] / found.shape.length[:, None]
        push = found.basis.T @ self.push(growth, found.stiffness)
        return Tangent(found.basis, found.pull, found.tangent, push, growth, found.elongation, found.tension)

    def energy(self, free: np.ndarray, parameter: float, elongation: np.ndarray | None = None) -> float:
        """J: strings less the work of the loads, from the start on.  elongation: (S,) m, where it is known."""
        elongation = self.elongation(free, parameter) if elongation is None else elongation
        stored = self.laws.energy(elongation, self.laws.piece_of(elongation))
        return self.balance.energy(stored, self.load(parameter), free)


def _require_regular(model: Model) -> None:
    """Raises InputError where the bars' lengths alone do not tell their forces, on which paths are built."""
    redundant = [name for name, one in zip(model.bar_names, model.redundant) if one]
    if redundant:
        raise InputError(
            f"{model.name}: no path is followed of redundant bars such as {redundant[0]}, whose forces are open; leave one out"
        )
    for body in model.bodies:
        if body.followers:
            names = ", ".join(model.bar_names[i] for i in body.bars)
            raise InputError(
                f"{model.name}: no path is followed of welded bars in a line or plane ({names}) yet; settle it instead"
            )
