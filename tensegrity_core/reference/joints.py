"""The reference's equations of bars that share nodes (section 8 of the theory), dense.

In the coordinates of its nodes a thin bar has a constant mass matrix, m/6 [2 1; 1 2] per axis, which M of eq. 1 is.  With one
constraint per bar, g = (|b|^2 - l^2) / 2 = 0, and its derivative G by the coordinates,

    M x'' = f + G^T lambda,   G x'' = -|b'|^2,   so that   (G M^-1 G^T) lambda = -|b'|^2 - G M^-1 f;

the force of a bar is -lambda l, tension positive.  Coordinates of fixed and moved nodes are known: M^-1 is the inverse of the
part of M that belongs to the free coordinates of an axis, with zeros elsewhere, and what is missing there is the force of the
ground.  Welded bars add constraints of the same form: distances, and nodes that keep their place across the line or plane of a
frame (see `model.welds`), g = nu . sum of a x, with nu across it and constant a that add up to 0; nu' drops out of these, since
the sum is zero.

All constraints are written C (m, n), their constant coefficients of the nodes, and V (3, m), their directions: the derivative
of constraint c by coordinate a of node i is V[a, c] C[c, i].  Where constraints depend on each other lambda is the one of least
norm.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from ..errors import InputError
from ..model import Inputs, Model
from ..model.welds import distances, followers
from .equations import connectivity, diagonal

#: Eigenvalues of G M^-1 G^T, rows and columns scaled to a diagonal of 1, below which constraints depend on each other at the
#: start, and below which those that did not do so later.
DEPENDENT = 1e-10
SINGULAR = 1e-8
#: Part of its length by which moved nodes may seem to stretch a bar between them: inputs are given in so many digits.
STRETCHED = 1e-6
#: Newton steps back onto the constraints.
MOST_STEPS = 20


class Singular(ArithmeticError):
    """Constraints that were independent have come to depend on each other.  parts: (m,) how much each has to do with it."""

    def __init__(self, parts: np.ndarray):
        self.parts = parts
        super().__init__("bars have come into a position in which no finite force keeps their lengths")


class Solved(NamedTuple):
    """lam: (m,) multipliers; acceleration: (3, n) m/s2; forces: (3, n) N, of the constraints on the nodes."""

    lam: np.ndarray
    acceleration: np.ndarray
    forces: np.ndarray


class Joints:
    """The constraints of a model with joints.

    M_inv (3, n, n): per axis, see the module; held (3, n): 1 where a coordinate is fixed or moved; C (m, n): the bars' rows,
    those of further distances, those of followers; size (m,): of a distance its half square, m2, of a follower the square of
    its frame's extent; rank: of the constraints at the start; dependent (m,): those that are not independent then.
    """

    def __init__(self, model: Model, M: np.ndarray, C_b: np.ndarray):
        self.model, self.M = model, M
        self.held = model.held.T.astype(float)
        self.M_inv = np.array([_inverse(M, held > 0.0) for held in self.held])
        pairs, places = distances(model), followers(model, model.nodes)
        self.C = np.vstack((C_b, connectivity(pairs, M.shape[0]), places.coefficients))
        self._distances, self._of_body = len(C_b) + len(pairs), places.body
        N = model.nodes.T
        ends = N.dot(self.C[: self._distances].T)
        self._square = diagonal(ends, ends)
        self.size = np.concatenate((0.5 * self._square, np.sum(places.directions**2, axis=1)))
        felt, scaled, _ = self._scaled(self.compliance(self.rows(N)))
        self._felt = np.zeros(len(self.C), dtype=bool)
        self._felt[felt] = True
        values, vectors = np.linalg.eigh(scaled)
        none = values <= DEPENDENT * values.max(initial=0.0)
        self.rank = int(len(values) - none.sum())
        parts = np.zeros(len(self.C))
        parts[felt] = np.abs(vectors[:, none]).max(axis=1, initial=0.0)
        self.dependent = parts > 1e-8

    def rows(self, N) -> np.ndarray:
        """G (3, m, n) at node coordinates N (3, n)."""
        return self.directions(N)[:, :, None] * self.C

    def directions(self, N) -> np.ndarray:
        """V (3, m), m; of followers times the frame's extent."""
        V = N.dot(self.C.T)
        if len(self._of_body):
            V[:, self._distances :] = followers(self.model, N.T).directions.T
        return V

    def compliance(self, G) -> np.ndarray:
        """G M^-1 G^T (m, m)."""
        return np.add.reduce(np.matmul(np.matmul(G, self.M_inv), G.transpose(0, 2, 1)))

    def values(self, N) -> np.ndarray:
        """g (m,) at node coordinates N (3, n)."""
        ends = N.dot(self.C.T)
        return np.concatenate(
            (
                0.5 * (diagonal(ends, ends)[: self._distances] - self._square),
                diagonal(self.directions(N), ends)[self._distances :],
            )
        )

    def solve(self, W, right) -> np.ndarray:
        """lambda (m,) of least norm with W lambda = right; not finite where W is not, as in a stage of a step that is far
        too long.  Raises Singular."""
        if not np.isfinite(W).all():
            return np.full(len(right), np.nan)
        found = np.zeros(len(right))
        felt, scaled, scale = self._scaled(W)
        if not self.rank:
            return found
        if self.rank == len(scaled) and (factor := _factor(scaled)) is not None:
            found[felt] = scale * scipy.linalg.cho_solve(factor, scale * right[felt], check_finite=False)
            return found
        values, vectors = np.linalg.eigh(scaled)
        none = len(values) - self.rank
        if values[none] <= SINGULAR * values[-1]:
            found[felt] = np.abs(vectors[:, none])
            raise Singular(found)
        kept = vectors[:, none:]
        lam = scale * (kept @ ((kept.T @ (scale * right[felt])) / values[none:]))
        free, _ = np.linalg.qr(scale[:, None] * vectors[:, :none])  # forces that balance by themselves
        found[felt] = lam - free @ (free.T @ lam)
        return found

    @staticmethod
    def _scaled(W):
        """Rows that a free coordinate feels, W there with a diagonal of 1, and the scale of its rows and columns."""
        size = np.diagonal(W)
        felt = np.flatnonzero(size > 0.0)
        scale = 1.0 / np.sqrt(size[felt])
        return felt, scale[:, None] * W[np.ix_(felt, felt)] * scale, scale

    def motion(self, N, Ndot, F, given) -> Solved:
        """The accelerations under forces F (3, n), N, on the nodes; given: (3, n) those of moved coordinates."""
        rates = Ndot.dot(self.C.T)
        right = -diagonal(rates, rates)
        right[self._distances :] = 0.0
        free = np.matmul(self.M_inv, (F - given.dot(self.M))[:, :, None])[:, :, 0] + given
        V = self.directions(N)
        G = V[:, :, None] * self.C
        lam = self.solve(self.compliance(G), right - diagonal(V, free.dot(self.C.T)))
        forces = (V * lam).dot(self.C)
        return Solved(lam, free + self._moved_by(forces), forces)

    def _moved_by(self, forces) -> np.ndarray:
        """M^-1 forces (3, n)."""
        return np.matmul(self.M_inv, forces[:, :, None])[:, :, 0]

    def back(self, N, Ndot) -> tuple[np.ndarray, np.ndarray]:
        """N, Ndot on the constraints: positions, then velocities, along M^-1 G^T.  Raises Singular."""
        best = np.inf
        for _ in range(MOST_STEPS):
            g = self.values(N)
            off = float(np.abs(g / self.size)[self._felt].max(initial=0.0))
            if not off < 0.5 * best:
                break
            best, G = off, self.rows(N)
            N = N - self._moved_by(np.einsum("c,acn->an", self.solve(self.compliance(G), g), G))
        return N, self.without_rates(N, Ndot)

    def without_rates(self, N, Ndot) -> np.ndarray:
        """Ndot with G Ndot = 0, changed along M^-1 G^T: twice, since the first leaves the round-off of a large change."""
        G = self.rows(N)
        W = self.compliance(G)
        for _ in range(2):
            Ndot = Ndot - self._moved_by(np.einsum("c,acn->an", self.solve(W, np.einsum("acn,an->c", G, Ndot)), G))
        return Ndot

    def drift(self, N, Ndot) -> float:
        """Largest relative deviation of the constraints; of their rates, in 1/s, or relative to velocities above 1 m/s.  Bars
        between held nodes are left out: their lengths are checked beforehand."""
        return float(self.off(N, Ndot).max(initial=0.0))

    def off(self, N, Ndot) -> np.ndarray:
        """(m,) the same, one by one; 0 of what is left out."""
        speed = max(1.0, float(np.abs(Ndot).max()))
        rates = diagonal(self.directions(N), Ndot.dot(self.C.T)) / (2.0 * self.size * speed)
        return np.where(self._felt, np.maximum(np.abs(self.values(N) / (2.0 * self.size)), np.abs(rates)), 0.0)

    def jumped(self, N, Ndot, shift, dv) -> tuple[np.ndarray, np.ndarray]:
        """N, Ndot (3, n) after moved coordinates jumped by shift and their velocities by dv (3, n).

        Positions: a bar that is a group of class 1 is carried along with its pin; the others go the least way, in the metric of
        M, that keeps the lengths.  Velocities: the impulse of the constraints and of M between moved and free coordinates.
        """
        if shift.any():
            for group in self.model.groups:
                if group.class_1:
                    base = [node for node in group.nodes if shift[:, node].any()]
                    for tip in group.nodes:
                        if base and tip not in base:
                            shift = shift.copy()
                            shift[:, tip] += shift[:, base[0]]
            N, _ = self.back(N + shift, Ndot)
        if dv.any():
            Ndot = Ndot + dv - self._moved_by(dv.dot(self.M))
            Ndot = self.without_rates(N, Ndot)
        return N, Ndot

    def named(self, parts: np.ndarray) -> str:
        """The bars that have most to do with parts (m,) of the constraints."""
        of_body = [i for i, body in enumerate(self.model.bodies) for _ in body.distances] + self._of_body.tolist()
        owners = [*self.model.bar_names, *(self.model.bar_names[self.model.bodies[i].bars[0]] for i in of_body)]
        found = [name for name, part in zip(owners, parts) if part > 0.1 * parts.max(initial=0.0)]
        return ", ".join(dict.fromkeys(found))


def _inverse(M: np.ndarray, held: np.ndarray) -> np.ndarray:
    """M^-1 (n, n) of the nodes that are not held along an axis, zeros elsewhere."""
    free, found = np.flatnonzero(~held), np.zeros_like(M)
    part = np.ix_(free, free)
    found[part] = np.linalg.inv(M[part])
    return found


def _factor(W):
    """The Cholesky factor of a matrix with a diagonal of 1, None where it has none to speak of."""
    try:
        factor = scipy.linalg.cho_factor(W, check_finite=False)
    except np.linalg.LinAlgError:
        return None
    return factor if float(np.diagonal(factor[0]).min()) ** 2 > 10.0 * SINGULAR else None  # else the eigenvalues are asked


def require_cranks(model: Model, inputs: Inputs) -> None:
    """Raises InputError where moved nodes do not keep the length of a bar whose ends they hold, at a communication point."""
    held = np.asarray(model.held[:, model.axes].all(axis=1))
    cranks = np.flatnonzero(held[model.bars].all(axis=1))
    if not len(cranks):
        return
    moving = list(model.moving)
    place = np.tile(model.nodes, (len(inputs.times) - 1, 1, 1))
    place[:, moving] = np.where(model.moved[moving], inputs.resolved(model).node_position, place[:, moving])
    ends = model.bars[cranks]
    off = np.linalg.norm(place[:, ends[:, 1]] - place[:, ends[:, 0]], axis=2) / model.bar_length[cranks] - 1.0
    wrong = np.argwhere(np.abs(off) > STRETCHED)
    if len(wrong):
        k, i = wrong[0]
        raise InputError(
            f"node_position stretches bar {model.bar_names[cranks[i]]!r}, both of whose ends are held, by {off[k, i]:.3g} "
            f"of its length at t = {float(inputs.times[k])!r} s; let its ends keep their distance"
        )
