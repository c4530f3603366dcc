"""One point of an equilibrium path, and Newton's method that finds it."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from .. import statics
from ..errors import TensegrityError
from .equilibrium import Equations, Tangent

NEWTON = 8  # corrector steps after which a step is repeated shorter
SETTLED = 1e-9  # m: a Newton step below this is the last one
SINGULAR = 1e-9  # singular values of a bordered system below this part of the largest count as zero
FAR = 4.0  # a tangent found that long (squared) turns by more than 60 degrees, or has picked up another path's


class PathError(TensegrityError):
    """A path that cannot be followed."""


class Local:
    """The equations at a point, and what follows from them, worked out when it is first asked for.

    tangent: them, or what gives them; definite: whether the tangent stiffness is known to be positive definite.
    """

    def __init__(self, equations: Equations, tangent: Tangent | Callable[[], Tangent], definite: bool = False):
        self._equations, self._tangent, self.definite = equations, tangent, definite

    @cached_property
    def tangent(self) -> Tangent:
        return self._tangent() if callable(self._tangent) else self._tangent

    @cached_property
    def values(self) -> np.ndarray:
        """(r,) N/m, rising eigenvalues of the tangent stiffness."""
        return np.linalg.eigvalsh(self.tangent.stiffness)

    @cached_property
    def zero(self) -> float:
        """N/m, what counts as round-off of them."""
        return statics.NEUTRAL * max(float(np.abs(self.values).max(initial=0.0)), self._equations.stiffest)


class Point(NamedTuple):
    """An equilibrium on a path.

    parameter: p; free: (n,) m; piece: (S,) of each string (after the point, at a kink); direction: (n+1,) unit tangent,
    the last entry that of c p; local: the equations there; arc: m, from the path's start; kind: '', 'kink', 'limit',
    'branch', 'loose'.
    """

    parameter: float
    free: np.ndarray
    piece: np.ndarray
    direction: np.ndarray
    local: Local
    arc: float
    kind: str

    @property
    def values(self) -> np.ndarray:
        return self.local.values

    @property
    def zero(self) -> float:
        return self.local.zero

    @property
    def tension(self) -> np.ndarray:
        """(S,) N."""
        return self.local.tangent.tension

    @property
    def unstable(self) -> int:
        """Number of directions in which the potential energy falls."""
        return 0 if self.local.definite else int((self.values < -self.zero).sum())

    @property
    def stable(self) -> bool:
        return self.unstable == 0


def bordered(tangent: Tangent, scale: float, row: np.ndarray) -> np.ndarray:
    """(r+1, r+1): [K, -g/c; row], in the unknowns (y, c p); row: (n+1,)."""
    r = len(tangent.pull)
    matrix = np.empty((r + 1, r + 1))
    matrix[:r, :r], matrix[:r, r] = tangent.stiffness, tangent.push / -scale
    matrix[r, :r], matrix[r, r] = row[:-1] @ tangent.basis, row[-1]
    return matrix


def _solved(matrix: np.ndarray, right: np.ndarray, least: bool = False) -> np.ndarray | None:
    """Solution of a bordered system, None where there is none; least: the one of least size, which at a branch point, where the
    system is singular, stays on the path."""
    try:
        return np.linalg.lstsq(matrix, right, rcond=SINGULAR)[0] if least else np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:
        return None


def newton(
    equations: Equations, scale: float, free, parameter: float, piece, row, settled: float, event=None, least: bool = False
) -> tuple[np.ndarray, float, Tangent] | None:
    """Solve equilibrium and row . (x, c p) = its value at the guess, or, with event = (string, elongation), that the
    string has this elongation.  Returns free, parameter, the tangent at the last iterate; None where it does not converge."""
    last = np.inf
    for _ in range(NEWTON):
        tangent = equations.at(free, parameter, piece)
        right = np.concatenate((tangent.pull, (0.0,)))
        if event is not None:
            string, goal = event
            row = np.concatenate((tangent.growth[string], (-equations.loading.rest_length_direction[string] / scale,)))
            right[-1] = goal - tangent.elongation[string]
        step = _solved(bordered(tangent, scale, row), right, least)
        if step is None:
            return None
        size = math.sqrt(step @ step)
        if not size < 0.5 * last or not math.isfinite(size):
            return None if not last <= 1e3 * settled else (free, parameter, tangent)
        free = equations.moved(free, tangent.basis @ step[:-1])
        parameter = float(parameter + step[-1] / scale)
        if size <= settled:
            return free, parameter, tangent
        last = size
    return None


def _direction(tangent: Tangent, scale: float, along: np.ndarray) -> np.ndarray | None:
    """(n+1,) unit tangent of the path, on the side of `along` (n+1,)."""
    right = np.zeros(len(tangent.pull) + 1)
    right[-1] = 1.0
    matrix = bordered(tangent, scale, along)
    found = _solved(matrix, right)
    if found is None or not found @ found <= FAR:
        found = _solved(matrix, right, least=True)
    if found is None:
        return None
    direction = np.concatenate((tangent.basis @ found[:-1], found[-1:]))
    size = math.sqrt(direction @ direction)
    return direction / size if math.isfinite(size) and size > 0.0 else None


def _point(equations, scale, free, parameter, tangent, piece, along, arc, kind) -> Point | None:
    """The point at an equilibrium whose tangent is known up to a step of round-off."""
    direction = _direction(tangent, scale, along)
    if direction is None:
        return None
    return Point(float(parameter), free, piece, direction, Local(equations, tangent), arc, kind)
