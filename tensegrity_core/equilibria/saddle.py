"""Equilibrium with the bars' forces as unknowns: what Newton's method needs of it, in one symmetric system.

Unknowns z are the n coordinates of the free nodes and the B bars' force densities; every bar's length is an equation.
Linearised, equilibrium under the parameter p reads

    [K  A^T] dz = [F] + dp [g]
    [A   0 ]      [c]      [0]

with the tangent stiffness K, the bars' directions A, the unbalanced force F, the missing half squares of the bars' lengths c,
and the loads' growth g (see Nocedal and Wright, "Numerical optimization", 2006, section 16.1).  It is factored by Bunch and
Kaufman's method, which tells the signs of its eigenvalues: the tangent stiffness along the directions that keep the bars'
lengths is positive definite where exactly B of them are negative (Sylvester's law of inertia; theorem 16.3 there).

Bordered by one string's direction, as if a force in that string's line held its elongation, the system stays regular
where the tangent stiffness is singular.  Then

    [K  A^T  u] [dz]   [F]      [g]
    [A   0   0] [nu] = [c] + dp [0],
    [u^T 0   0]        [de]     [0]

so nu = 0 gives dp for a wanted change de of the elongation, and -nu per unit de is the string's *reserve*: how much stiffness
it can lose until the tangent stiffness is singular.  Nothing but the reserve depends on the string's own stiffness.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from ..laws.string_laws import OnPieces
from .equilibrium import Equations


class Bordered(NamedTuple):
    """Solutions of the bordered system for F and c, for g, and for de = 1: (n+B,) each, and their nu."""

    way: tuple[np.ndarray, float]
    push: tuple[np.ndarray, float]
    pull: tuple[np.ndarray, float]


class Saddle:
    """The system at one configuration after the other, in arrays that stay where they are.

    size: n+B.  After `at`: laws; elongation (S,) m, tension (S,) N, stiffness (S,) N/m and bend (C,) N/m2 of the strings.
    """

    def __init__(self, equations: Equations):
        self.equations, self.balance = equations, equations.balance
        self.n, self.strings = equations.size, len(equations.model.strings)
        self.size = self.n + len(equations.bar_length)
        self._matrix = np.zeros((self.size + 1, self.size + 1))
        self._wide = np.zeros((self.strings + len(equations.bar_length), self.balance.wide))
        self._tangent = self._matrix[: self.n, : self.n]
        self._diagonal = self._tangent.reshape(-1)[:0] if not self.n else np.einsum("ii->i", self._tangent)
        self._half_square = 0.5 * equations.bar_length**2
        self._work = {size: int(scipy.linalg.lapack.dsysv_lwork(size)[0]) for size in (self.size, self.size + 1)}

    def start(self, free: np.ndarray, parameter: float) -> np.ndarray:
        """(n+B,) z, the bars' force densities those that balance best at these free coordinates."""
        e, shape = self.equations, self.balance.shape(free)
        elongation = shape.length - e.loading.rest_lengths(parameter)
        tension, _, _ = e.laws.on(e.laws.piece_of(elongation))(elongation)
        force = self.balance.unbalanced(shape, e.load(parameter), tension / shape.length)
        return np.concatenate([free, self.balance.bar_density(shape, force)])

    def at(self, z: np.ndarray, parameter: float, laws: OnPieces | None = None) -> None:
        """Set the system up for these unknowns (n+B,), strings on these pieces, or on those that hold their elongations."""
        n, count, balance = self.n, self.strings, self.balance
        shape = balance.shape(z[:n])
        self.length = shape.length
        self.elongation = shape.length - self.equations.loading.rest_lengths(parameter)
        if laws is None:
            known = self.equations.laws
            laws = known.on(known.piece_of(self.elongation))
        self.laws = laws
        self.tension, self.stiffness, self.bend = laws(self.elongation)
        density = np.concatenate((self.tension / shape.length, z[n:]))
        self._rows = balance.rows(shape, self._wide)
        self.force = self.equations.load(parameter) - density @ self._rows
        self.missing = self._half_square - 0.5 * shape.squared[count:]
        self._tangent[:] = balance.stiffness(shape, self.stiffness, density)
        self._matrix[:n, n:-1] = self._rows[count:].T

    def solve(self) -> tuple[np.ndarray, np.ndarray] | None:
        """(n+B,), (n+B,): dz for F and c, and for g; None where the system is singular."""
        right = np.zeros((2, self.size))
        right[0, : self.n], right[0, self.n :], right[1, : self.n] = self.force, self.missing, self._push()
        found = self._solved(right)
        return None if found is None else (found[0], found[1])

    def _push(self) -> np.ndarray:
        """(n,) N: g."""
        return self.equations.push(self._rows[: self.strings], self.stiffness / self.length)

    def directions(self, strings: np.ndarray) -> np.ndarray:
        """(C, n) u, the derivatives of strings' lengths by the free coordinates."""
        return self._rows[strings] / self.length[strings][:, None]

    def direction(self, string: int) -> np.ndarray:
        """(n,) u, the derivative of a string's length by the free coordinates."""
        return self._rows[string] / self.length[string]

    def bordered(self, direction: np.ndarray) -> Bordered | None:
        """Solutions of the system bordered by a direction (n,), such as a string's; None where it is singular."""
        n = self.n
        self._matrix[:n, -1] = direction
        right = np.zeros((3, self.size + 1))
        right[0, :n], right[0, n:-1], right[1, :n], right[2, -1] = self.force, self.missing, self._push(), 1.0
        found = self._solved(right)
        return None if found is None else Bordered(*((row[:-1], float(row[-1])) for row in found))

    def again(self, force: np.ndarray) -> tuple[np.ndarray, float]:
        """dz and nu for another force (n,) and nothing missing, of the bordered system that was solved last."""
        right = np.zeros(self.size + 1)
        right[: self.n] = force
        found, _ = scipy.linalg.lapack.dsytrs(*self._factor, right, lower=1)
        return found[:-1], float(found[-1])

    def curvature(self, direction: np.ndarray) -> float:
        """N/m, of the potential energy along a direction (n,): its Rayleigh quotient."""
        return float(direction @ (self._tangent @ direction) / (direction @ direction))

    def flow(self, slowness: float) -> np.ndarray | None:
        """(n+B,) an implicit Euler step of the overdamped flow over the time 1/slowness (1/slowness in m/N)."""
        right = np.empty((1, self.size))
        right[0, : self.n], right[0, self.n :] = self.force, self.missing
        self._diagonal += slowness
        found = self._solved(right)
        self._diagonal -= slowness
        return None if found is None else found[0]

    def negative(self) -> int:
        """Number of negative eigenvalues of the matrix that was solved last."""
        factor, pivot = self._factor
        diagonal = factor.diagonal()
        return int(np.count_nonzero((diagonal < 0.0) & (pivot > 0)) + np.count_nonzero(pivot < 0) // 2)

    def definite(self) -> bool:
        """Whether the tangent stiffness that was solved last is positive definite along what keeps the bars' lengths (and,
        bordered, the string's)."""
        return self.negative() == len(self._factor[1]) - self.n

    def _solved(self, right: np.ndarray) -> np.ndarray | None:
        size = right.shape[1]
        matrix = self._matrix[:size, :size].T  # of its lower triangle: the upper one of ours
        factor, pivot, found, info = scipy.linalg.lapack.dsysv(matrix, right.T, lwork=self._work[size], lower=1, overwrite_b=1)
        self._factor = factor, pivot
        return found.T if info == 0 else None
