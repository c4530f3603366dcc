"""Members and balance of a structure in which bars share nodes: the bars' lengths together, not one after the other.

All constraints are linearised, A dx = 0: a row per bar, per distance that a weld keeps, and per follower of a weld (see
`model.welds`).  Bars bear with the force densities q of least norm that balance best, A^T q = f; motions are the null space of
A; a step is brought back to the lengths by the least displacement, again and again, until round-off ends it.
"""

from __future__ import annotations

import numpy as np
import scipy

from ..model import Model
from ..model.welds import followers
from .balance import Balance
from .matrices import RANK_TOLERANCE, Dense, Sparse, lengths_between, lstsq, null_space, require_small
from .members import Members, Shape, members

#: Newton steps back onto the lengths.
MOST_STEPS = 30
#: Coordinates or bars up to which singular values are taken wherever they serve.
FEW = 300
#: Pivots below this part of the largest leave too few digits; singular values are taken then.
ROOT_TOLERANCE = 1e-5


class Jointed(Balance):
    """A balance of bars that share nodes, are welded, or have ends that are partly fixed."""

    def __init__(self, model: Model, matrix: type[Dense | Sparse] = Dense):
        super().__init__(model, matrix)
        self.bar_length = lengths_between(model.nominal, members(model)[self._count :])
        self._half_square = 0.5 * self.bar_length**2

    def _prepare_bars(self, matrix: type[Dense | Sparse]) -> None:
        """Nothing holds bar by bar."""

    def follower_rows(self, shape: Shape) -> np.ndarray:
        """(f, n) m."""
        found = followers(self.model, self.nodes(shape.free))
        rows = found.coefficients[:, :, None] * found.directions[:, None, list(self.model.axes)]
        return rows.reshape(len(rows), found.coefficients.shape[1] * rows.shape[2])[:, self.model.free_coordinates]

    def _off(self, free: np.ndarray) -> np.ndarray:
        """(c,) m2: how far the half squares of the lengths, and the followers, are from where they belong."""
        nodes, shape = self.nodes(free), self.shape(free)
        found = followers(self.model, nodes)
        places = np.sum(found.directions * (found.coefficients @ nodes), axis=1)
        return np.concatenate((0.5 * shape.squared[self._count :] - self._half_square, places))

    def constraints(self, shape: Shape) -> np.ndarray:
        """A (c, n), m."""
        return np.vstack((self.rows(shape)[self._count :], self.follower_rows(shape)))

    def bar_density(self, shape: Shape, force: np.ndarray) -> np.ndarray:
        return self._borne(shape, force)[0][: len(self.bar_length)]

    def balanced(self, shape: Shape, load: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        borne, left = self._borne(shape, self.unbalanced(shape, load, density))
        return np.concatenate((density, borne[: len(self.bar_length)])), left

    def _borne(self, shape: Shape, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Force densities (c,) of all constraints that balance forces (n,) best, and what stays unbalanced (n,), N."""
        if max(self.size, len(self.bar_length)) > FEW:
            if not self.model.redundant.any():
                return self._borne_by_many(shape, force)
            require_small(self.model, "forces of bars that hold each other")
        A = self.constraints(shape)
        density = lstsq(A.T, force)
        left = force - A.T @ density
        again = lstsq(A.T, left)  # what round-off left of large forces
        return density + again, left - A.T @ again

    def _borne_by_many(self, shape: Shape, force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same in a time that grows with the structure, of bars that are not redundant."""
        vectors = shape.vectors[:, self._count :]
        first, second = self._ends_of_bars
        rows = np.broadcast_to(np.arange(vectors.shape[1]), vectors.shape)
        places = np.concatenate((rows, rows), axis=None), np.concatenate((first, second), axis=None)
        A = scipy.sparse.coo_array((np.concatenate((-vectors, vectors), axis=None), places), (rows.shape[1], self.wide))
        A = scipy.sparse.vstack((A.tocsr()[:, : self.size], scipy.sparse.csr_array(self.follower_rows(shape))))
        factors = scipy.sparse.linalg.splu((A @ A.T).tocsc())
        density, left = np.zeros(A.shape[0]), force
        for _ in range(3):  # normal equations lose half of the digits
            density = density + factors.solve(A @ left)
            left = force - A.T @ density
        return density, left

    def moved(self, free: np.ndarray, step: np.ndarray) -> np.ndarray:
        free, best = free + step, np.inf
        for _ in range(MOST_STEPS):
            off = self._off(free)
            largest = float(np.abs(off).max(initial=0.0))
            if not largest < 0.5 * best:
                break
            best = largest
            free = free - _least(self.constraints(self.shape(free)), off)
        return free

    def basis(self, shape: Shape) -> np.ndarray:
        A = self.constraints(shape)
        A = A / np.linalg.norm(A, axis=1).clip(1e-300)[:, None]
        if not len(A) or len(A) > A.shape[1]:
            return null_space(A, RANK_TOLERANCE)
        q, r = scipy.linalg.qr(A.T, check_finite=False)
        regular = float(np.abs(np.diagonal(r)).min()) > ROOT_TOLERANCE
        return q[:, len(A) :] if regular else null_space(A, RANK_TOLERANCE)


def _least(A: np.ndarray, right: np.ndarray) -> np.ndarray:
    """The shortest x (n,) with A x = right, or next to it."""
    try:
        factor = scipy.linalg.cho_factor(A @ A.T, check_finite=False)
    except np.linalg.LinAlgError:
        return lstsq(A, right)
    pivots = np.abs(np.diagonal(factor[0]))
    regular = len(pivots) == 0 or pivots.min() > ROOT_TOLERANCE * pivots.max()
    return A.T @ scipy.linalg.cho_solve(factor, right, check_finite=False) if regular else lstsq(A, right)


def members_of(model: Model) -> Members:
    """What a model's members are computed with."""
    return Jointed(model) if model.joint else Members(model)


def balance_of(model: Model, matrix: type[Dense | Sparse] = Dense) -> Balance:
    """What a model's balance is computed with; dense where bars share nodes."""
    return Jointed(model) if model.joint else Balance(model, matrix)
