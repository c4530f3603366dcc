"""The linear system of small motions where bars share nodes, are welded, or have ends that are fixed along single axes.

Constraints are g(x) = 0: the bars' half squares of lengths, those of the distances that welds keep, and the followers of welds
(see `model.welds`), which are linear.  The r coordinates y are those of nodes, as many and such that the null space of the
constraints is Phi with the unit matrix in their rows; p are the positions of moved nodes.  With G = g_x, T = [Phi P], G T = 0,
and a right inverse L of G with zeros in the rows of y, so that these stay what they are,

    x_zz[., w] = -L H[., w],   x_zzz[., w, w] = -L (2 H[x_zz[., w], w] + H[x_zz[w, w], .]),   z = (y, p),

where H[u, w] of a distance is the product of its ends' differences in T u and T w.  The rest is as in `linearization`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy

from ..errors import InputError
from ..model.components import present
from ..model.inputs import INPUTS
from ..model.welds import distances, followers
from ..statics.matrices import RANK_TOLERANCE, lstsq
from .linearization import HeldBy, System

if TYPE_CHECKING:
    from ..model import Model
    from .linearization import _At, _Rows

#: Of the largest curvature of the constraints: how much of it may be left that nothing makes up for.
CURVED = 1e-6


class Constraints:
    """What keeps the lengths, at one place.

    incidence (c, N): of the differences, -1 and 1 at the ends; edges (c, D) m; free: places of the coordinates that nothing
    holds; rows (c + D f, N D): the derivatives of distances by all coordinates, each over its length, then f followers' along
    every axis.
    """

    def __init__(self, model: Model, x: np.ndarray):
        self.model, self.axes = model, list(model.axes)
        pairs, count = np.vstack((model.bars, distances(model))), len(model.nodes)
        self.incidence = np.zeros((len(pairs), count))
        each = np.arange(len(pairs))
        self.incidence[each, pairs[:, 0]], self.incidence[each, pairs[:, 1]] = -1.0, 1.0
        self.edges = self.incidence @ x.reshape(count, -1)
        self.length = np.linalg.norm(self.edges, axis=1)
        self.free = model.free_coordinates
        apart = self.spread(self.incidence, self.edges / self.length[:, None])
        self.rows = np.vstack((apart, np.kron(self._places(), np.eye(len(self.axes)))))

    def _places(self) -> np.ndarray:
        """(f, N): of each follower its place less that which its frame gives it."""
        found = []
        for weld in self.model.bodies:
            for node, places in zip(weld.followers, weld.places):
                row = np.zeros(len(self.model.nodes))
                row[node] = 1.0
                row[list(weld.frame)] -= places
                found.append(row)
        return np.array(found).reshape(-1, len(self.model.nodes))

    @staticmethod
    def spread(incidence: np.ndarray, vectors: np.ndarray) -> np.ndarray:
        """(c, N D): vectors (c, D) at the nodes, by the signs of incidence (c, N)."""
        return np.einsum("cn,cd->cnd", incidence, vectors).reshape(len(incidence), -1)

    def across(self, columns: np.ndarray) -> np.ndarray:
        """(c, D, k): differences of columns (N D, k) over the distances."""
        return np.einsum("cn,ndk->cdk", self.incidence, columns.reshape(self.incidence.shape[1], -1, columns.shape[1]))

    def curved(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """(c + D f, k): H of one displacement (c, D) and of k (c, D, k); nothing of followers."""
        found = np.zeros((len(self.rows), second.shape[2]))
        found[: len(self.edges)] = np.einsum("cd,cdk->ck", first, second) / self.length[:, None]
        return found


def movable(model: Model) -> np.ndarray:
    """(E, 3) bool: the axes along which each moved node can go a little while the others stand, and all bars keep their
    lengths."""
    found = model.moved[list(model.moving)]
    if not model.joint or not len(found):
        return found
    axes, found = list(model.axes), found.copy()
    rows = Constraints(model, model.nodes[:, axes].ravel()).rows
    free = rows[:, model.free_coordinates]
    for e, node in enumerate(model.moving):
        columns = rows[:, node * len(axes) : (node + 1) * len(axes)]
        left = columns - free @ lstsq(free, columns)
        found[e, axes] &= np.abs(left).max(axis=0, initial=0.0) < CURVED
    return found


class JointedSystem(System):
    """The derivatives of everything over the columns z, for what is beyond class 1."""

    def _coordinates(self) -> None:
        """phi (n, r); moved (n, E D): P; names of y; lift (n, c): L."""
        model, D = self.model, len(self.axes)
        held = self.constraints = Constraints(model, self.x)
        rows, n = held.rows[:, held.free], len(self.x)
        left, sizes, right = np.linalg.svd(rows)
        rank = int(np.sum(sizes > RANK_TOLERANCE * sizes.max(initial=1e-300)))
        basis, inverse = right[rank:].T, (right[:rank].T / sizes[:rank]) @ left[:, :rank].T
        chosen = np.sort(scipy.linalg.qr(basis.T, mode="r", pivoting=True)[1][: basis.shape[1]])
        basis = np.linalg.solve(basis[chosen].T, basis.T).T if len(chosen) else basis
        self.lift, self.phi = np.zeros((n, len(rows))), np.zeros((n, len(chosen)))
        self.lift[held.free] = inverse - basis @ inverse[chosen]
        self.phi[held.free] = basis
        self.names = [f"{model.node_names[i // D]}.{'xyz'[self.axes[i % D]]}" for i in held.free[chosen]]
        given = np.array([node * D + axis for node in model.moving for axis in range(D)], dtype=int)
        here = np.flatnonzero(present(INPUTS["node_position"], model))
        self.moved = np.zeros((n, len(given)))
        self.moved[given[here], here] = 1.0
        self.moved -= self.lift @ held.rows @ self.moved
        self._require_regular(left[:, rank:], rows)
        self.along = held.across(np.hstack((self.phi, self.moved)))  # (c, D, k)

    def _require_regular(self, loose: np.ndarray, rows: np.ndarray) -> None:
        """Raises InputError where constraints that depend on each other, by loose (c + D f, l), part beyond the first order,
        or where a moved node would part them."""
        held, felt = self.constraints, np.abs(rows).max(axis=1, initial=0.0) > 0.0
        off = np.abs(loose[felt].T @ (held.rows @ self.moved)[felt]).max(axis=0, initial=0.0)
        if off.max(initial=0.0) > CURVED:
            node = self.model.node_names[self.model.moving[int(np.argmax(off)) // len(self.axes)]]
            raise InputError(f"bars keep {node} from being moved; leave out some of the axes along which it is moved")
        turns = held.across(self.phi)
        for states in loose.T:
            weights = (states * felt)[: len(held.length)] / held.length
            parts = np.einsum("c,cdi,cdj->ij", weights, turns, turns)
            if np.abs(parts).max(initial=0.0) > CURVED * np.abs(weights).max() * max(1.0, np.abs(turns).max(initial=0.0) ** 2):
                name = self.model.bar_names[int(np.argmax(np.abs(weights[: len(self.model.bars)])))]
                raise InputError(
                    f"bars such as {name} have come into one line or plane, where their lengths allow motions of the first "
                    "order only; there is no linear system there: take another state"
                )

    def _bars(self) -> None:
        self._vectors()

    def _bending(self, order: int) -> np.ndarray:
        field = ("node_position", "node_velocity")[order]
        return np.vstack((super()._bending(order), self._input(field)))

    def _whole(self, of_y: np.ndarray, field: str) -> np.ndarray:
        given = self.state.inputs[field][:, self.axes].ravel() * present(INPUTS[field], self.model)
        return np.concatenate((of_y, given))

    def _bent(self, w: np.ndarray) -> np.ndarray:
        """(n, k): x_zz[., w]."""
        return -self.lift @ self.constraints.curved(self.along @ w, self.along)

    def _twice_bent(self, w: np.ndarray) -> np.ndarray:
        """(n, k): x_zzz[., w, w]."""
        held, bent = self.constraints, self._bent(w)
        twice = 2.0 * held.curved(self.along @ w, held.across(bent))
        return -self.lift @ (twice + held.curved(held.across((bent @ w)[:, None])[:, :, 0], self.along))

    def _tilted(self, at: _At) -> np.ndarray:
        held = self.constraints
        density = (self.lift.T @ at.residual)[: len(held.length)] / held.length
        by = np.einsum("c,cdi,cdk->ik", -density, self.along[:, :, : self.r], self.along)
        return by @ self._bending(0)

    def _held_by(self, at: _At, rows: _Rows, residual: np.ndarray) -> HeldBy:
        """The multipliers of least norm, G^T lambda = M x'' - F at the free coordinates, and the rest of it, which the ground
        gives.  Their derivatives are those of a pseudo-inverse of constant rank (Golub and Pereyra, 1973)."""
        held, model, bars = self.constraints, self.model, len(self.model.bars)
        places = followers(model, self.state.nodes)
        signs = np.vstack((held.incidence, places.coefficients))
        vectors = np.vstack((held.edges, places.directions[:, self.axes]))
        G = held.spread(signs, vectors)
        onto = np.linalg.pinv(G[:, held.free].T, rcond=RANK_TOLERANCE)  # (m, free)
        lam = onto @ at.residual[held.free]
        change = np.concatenate((held.across(rows.x), self._turned_frames(places.body, rows.x, vectors[len(held.edges) :])))
        by_force = np.einsum("cn,c,cdz->ndz", signs, lam, change).reshape(len(self.x), -1)
        by_lam = onto @ (residual - by_force)[held.free]
        weights = np.zeros(len(self.x))
        weights[held.free] = onto.T @ lam
        freely = np.einsum("cd,cdz->cz", signs @ weights.reshape(signs.shape[1], -1), change)
        by_lam += freely - onto @ (G[:, held.free].T @ freely)
        length = held.length[:bars]
        ground, by_ground = at.residual - G.T @ lam, residual - G.T @ by_lam - by_force
        return HeldBy(-lam[:bars] * length, -by_lam[:bars] * length[:, None], ground, by_ground)

    def _turned_frames(self, body: np.ndarray, x: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """(f, D, columns of z): derivatives of the directions across bodies' frames, with those of places (n, columns)."""
        D = len(self.axes)
        found = np.zeros((len(body), D, x.shape[1]))
        for i, (number, direction) in enumerate(zip(body.tolist(), directions)):
            frame = list(self.model.bodies[number].frame)
            nodes, moved = self.x.reshape(-1, D)[frame], x.reshape(-1, D, x.shape[1])[frame]
            edges, turned = (nodes[1:] - nodes[0]).T, moved[1:] - moved[0]  # (D, d), (d, D, columns)
            found[i] = -edges @ np.linalg.solve(edges.T @ edges, np.einsum("edz,d->ez", turned, direction))
        return found
