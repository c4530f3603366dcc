"""The potential energy over the freedoms of a structure: slope, curvature, and the stability of an equilibrium."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy

from ..laws import curved_laws
from ..model import Model
from .analysis import rigid_body_motions
from .balance import Balance
from .forces import BALANCED, EPS, coordinate_force, loads
from .ground import ground_energy, ground_loads, ground_stiffness
from .jointed import balance_of
from .matrices import Dense, Matrix, Sparse, free_rows, freedoms, require_small, shortest_bar
from .strings import Laws, string_branches, string_energy, string_tension, string_values

SMALL = 300  # degrees of freedom up to which settling works with dense matrices and all eigenvectors
NEUTRAL = 1e-10  # eigenvalues below this part of the largest are round-off


class Modes:
    """A tangent stiffness by its eigenvalues (r,), N/m, and eigenvectors (r, r): the linearised flow is solved exactly."""

    assembled: type[Dense] = Dense

    def __init__(self, tangent: np.ndarray):
        self.values, self.vectors = np.linalg.eigh(0.5 * (tangent + tangent.T))
        self.stiffest = float(np.abs(self.values).max(initial=0.0)) or 1.0

    def stable(self) -> bool:
        return is_stable(self.values)

    def lowest(self) -> tuple[float, np.ndarray]:
        """The lowest eigenvalue, N/m, and its eigenvector (r,)."""
        return float(self.values[0]), self.vectors[:, 0]

    def times(self, directions: np.ndarray) -> np.ndarray:
        """The stiffness times directions (r, m)."""
        return self.vectors @ (self.values[:, None] * (self.vectors.T @ directions))

    def lowest_beside(self, neutral: np.ndarray) -> float:
        """The lowest eigenvalue, N/m, across the orthonormal directions (r, k), which have none; inf: there is none."""
        if not neutral.size:
            return float(self.values.min(initial=np.inf))
        rest = np.linalg.qr(neutral, mode="complete")[0][:, neutral.shape[1] :]
        return float(np.linalg.eigvalsh(rest.T @ self.times(rest)).min(initial=np.inf))

    def way(self, pull: np.ndarray, time: float, negligible: float) -> np.ndarray | None:
        """(r,) where the flow goes in a time under a pull (r,), N; None: without end, or too far to say.

        A neutral direction with no more pull than `negligible`, such as a rigid-body motion, is left alone.
        """
        pull = self.vectors.T @ pull
        values = np.where(np.abs(self.values) < NEUTRAL * self.stiffest, 0.0, self.values)
        pull[(values == 0.0) & (np.abs(pull) <= negligible)] = 0.0
        if np.isinf(time) and not np.all((values > 0.0) | (pull == 0.0)):
            return None
        return self.vectors @ (_flow(values, time) * pull)


class _Factors:
    """A large tangent stiffness (r, r), N/m, by sparse factors: the linearised flow is solved by implicit Euler steps."""

    assembled: type[Sparse] = Sparse

    def __init__(self, tangent: scipy.sparse.csc_array):
        self.tangent = (0.5 * (tangent + tangent.T)).tocsc()
        self.stiffest = float(abs(self.tangent).sum(axis=0).max(initial=0.0)) or 1.0  # a bound

    def factors(self, shift: float):
        """The factors of K + shift 1, None unless it is positive definite."""
        shifted = self.tangent + shift * scipy.sparse.eye_array(self.tangent.shape[0], format="csc")
        symmetric = {"SymmetricMode": True}
        try:
            found = scipy.sparse.linalg.splu(shifted, "MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=symmetric)
        except RuntimeError:  # singular
            return None
        # without row exchanges the pivots have the signs of the eigenvalues (Sylvester's law of inertia)
        definite = np.array_equal(found.perm_r, found.perm_c) and found.U.diagonal().min(initial=1.0) > 0.0
        return found if definite else None

    def stable(self) -> bool:
        return self.factors(NEUTRAL * self.stiffest) is not None

    def lowest(self) -> tuple[float, np.ndarray]:
        """The lowest eigenvalue, N/m, and its eigenvector (r,)."""
        values, vectors = self._lowest(1)
        return float(values[0]), vectors[:, 0]

    def times(self, directions: np.ndarray) -> np.ndarray:
        """The stiffness times directions (r, m)."""
        return self.tangent @ directions

    def lowest_beside(self, neutral: np.ndarray) -> float:
        """The lowest eigenvalue, N/m, across the orthonormal directions (r, k), which have none."""
        values, vectors = self._lowest(1 + neutral.shape[1])
        return float(values[np.linalg.norm(neutral.T @ vectors, axis=0) < 0.5].min(initial=np.inf))

    def _lowest(self, count: int) -> tuple[np.ndarray, np.ndarray]:
        shift = 0.0 if count == 1 else 1e-4 * self.stiffest  # beside zeros others lose the digits that an inverse has of these
        while (factors := self.factors(shift)) is None:
            shift = max(4.0 * shift, NEUTRAL * self.stiffest)
        inverse = scipy.sparse.linalg.LinearOperator(self.tangent.shape, factors.solve, dtype=float)
        start = np.random.default_rng(0).standard_normal(len(factors.perm_r))
        return scipy.sparse.linalg.eigsh(self.tangent, count, sigma=-shift, OPinv=inverse, v0=start)

    def way(self, pull: np.ndarray, time: float, negligible: float) -> np.ndarray | None:
        """As of Modes; a pull along a neutral direction is not left alone, but no step of infinite time follows it."""
        factors = self.factors(1.0 / time)
        return None if factors is None else factors.solve(pull)


class SurfacePoint(NamedTuple):
    """The structure at one configuration, along the directions that keep the bars' lengths.

    energy: V, J; basis: (n, r) orthonormal directions; pull: (r,) N, -grad V; tangent: the tangent stiffness there.
    """

    energy: float
    basis: Matrix
    pull: np.ndarray
    tangent: Any  # what Surface was given: Modes, _Factors or another with their `assembled`

    @property
    def values(self) -> np.ndarray:
        """Rising eigenvalues (r,) of the tangent stiffness, N/m; of a small structure."""
        return self.tangent.values


class Surface:
    """A model under constant loads, as a potential energy over the free coordinates (n,) that keep the bars' lengths.

    laws: of the strings, those with memory where they stand; `keep` moves them along, and without it they stay.
    balance: of the model, where it is made already; it does not depend on rest lengths.
    """

    def __init__(self, model: Model, force=None, decomposition=None, laws: Laws | None = None, balance: Balance | None = None):
        self.model, self.load = model, loads(model, force)
        self.decomposition = decomposition or (Modes if freedoms(model) <= SMALL or model.joint else _Factors)
        if model.joint:
            require_small(model, "settling bars that share nodes")
        self.balance = balance or balance_of(model, self.decomposition.assembled)
        self.size, self.start = self.balance.size, self.balance.start
        length = model.string_lengths(model.nodes)
        self.laws = string_branches(model, length) if laws is None else laws
        tension = string_tension(model, length, self.laws)
        largest_force = float(np.max(tension, initial=0.0) + np.abs(self.load).max())
        self.balanced = max(0.5 * BALANCED, 16.0 * EPS * (coordinate_force(model) + largest_force))
        span = float(np.ptp(model.nodes, axis=0).max())
        self.reach = step_limit(model)
        self.nearly_balanced = max(self.balanced, 1e-6 * largest_force)
        self.energy_round_off = 16.0 * EPS * float(np.sum(tension * length) + np.abs(self.load).sum() * span)
        self._felt = free_rows(model, self.load)

    def keep(self, free: np.ndarray) -> None:
        """Strings with memory follow to these coordinates for good."""
        if self.model.memories:
            self.laws = string_branches(self.model, self.balance.lengths(free), self.laws)

    def energy(self, free: np.ndarray) -> float:
        stored = string_energy(self.model, self.balance.lengths(free), self.laws)
        found = self.balance.energy(stored, self._felt, free)
        return found + ground_energy(self.model, self.balance.nodes(free)) if self.model.contacts else found

    def at(self, free: np.ndarray) -> SurfacePoint:
        """Energy, force and tangent stiffness along the directions that keep the bars' lengths."""
        if self.model.contacts:
            return self._on_ground(free)
        found = self.balance.at(free, self.model.rest_length, self._felt, self._strings)
        return SurfacePoint(self.energy(free), found.basis, found.pull, self.decomposition(found.tangent))

    def _on_ground(self, free: np.ndarray) -> SurfacePoint:
        """The same where nodes may touch the ground."""
        nodes = self.balance.nodes(free)
        pressed = self._felt + free_rows(self.model, ground_loads(self.model, nodes))
        found = self.balance.at(free, self.model.rest_length, pressed, self._strings)
        ground = ground_stiffness(self.model, nodes, self.balance.place)
        tangent = found.tangent + found.basis.T @ (ground @ found.basis)
        return SurfacePoint(self.energy(free), found.basis, found.pull, self.decomposition(tangent))

    def _strings(self, elongation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tension (S,), N, and stiffness (S,), N/m, at elongations (S,), m."""
        force = string_values(self.model, "force", elongation, self.laws)
        return force, string_values(self.model, "stiffness", elongation, self.laws)

    def moved(self, free: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Free coordinates after a step (n,), with the bars at their lengths."""
        return self.balance.moved(free, step)

    def gone(self, free: np.ndarray) -> float:
        """m, the longest way of a coordinate from the model's start."""
        return float(np.abs(free - self.start).max(initial=0.0))

    def near(self, free: np.ndarray, step: np.ndarray) -> bool:
        """Whether a step (n,) from free coordinates is small beside the structure."""
        return bool(np.abs(step).max(initial=0.0) <= self.reach)


def tangent_stiffness(model: Model, force=None) -> np.ndarray:
    """Rising eigenvalues, N/m, of the tangent stiffness at the model's start, in the directions that keep the bars'
    lengths; negative: unstable; zero: neutral, as a rigid-body motion is.

    Raises TooLarge: time grows with the third power of the structure; see `stability`.
    """
    require_small(model, "computing every eigenvalue of the tangent stiffness")
    return Surface(model, force, Modes).at(free_rows(model, model.nodes)).values


class Stability(NamedTuple):
    """stable: no eigenvalue of the tangent stiffness is negative beyond round-off; lowest: the lowest of them, N/m, those of
    rigid-body motions that nothing resists left out (inf: there is no other)."""

    stable: bool
    lowest: float


def stability(model: Model, force=None) -> Stability:
    """Stability of the model's start, of small and large structures."""
    point = Surface(model, force).at(free_rows(model, model.nodes))
    return Stability(point.tangent.stable(), point.tangent.lowest_beside(_neutral(point, rigid_body_motions(model))))


def _neutral(point: SurfacePoint, motions: np.ndarray) -> np.ndarray:
    """(r, k) orthonormal: what of motions (F*D, m) the tangent stiffness does not resist, along the point's directions."""
    along = point.basis.T @ motions
    _, sizes, combinations = np.linalg.svd(point.tangent.times(along), full_matrices=along.shape[0] < along.shape[1])
    free = np.ones(along.shape[1], dtype=bool)
    free[: len(sizes)] = sizes <= 10.0 * NEUTRAL * point.tangent.stiffest
    return np.linalg.qr(along @ combinations[free].T)[0]


def is_stable(values: np.ndarray) -> bool:
    """Whether no eigenvalue (r,), N/m, of a tangent stiffness is negative beyond round-off."""
    return bool(values.min(initial=0.0) >= -NEUTRAL * np.abs(values).max(initial=0.0))


def step_limit(model: Model) -> float:
    """m: longest way of a node in one step: small beside the structure and beside the falling pieces of force laws; longer
    where bars share nodes, since chains swing far."""
    narrow = min((law.narrow for law in curved_laws(model).values()), default=np.inf)
    return min((5e-2 if model.joint else 5e-3) * shortest_bar(model), 0.2 * narrow)


def _flow(values: np.ndarray, time: float) -> np.ndarray:
    """(1 - exp(-w t))/w for each eigenvalue w: the way that a unit force goes in the time t."""
    if np.isinf(time):
        return np.divide(1.0, values, out=np.zeros_like(values), where=values > 0.0)
    way = np.full_like(values, time)
    growth = np.clip(-values * time, None, 600.0)  # no overflow: such a step is too long anyway
    return np.divide(-np.expm1(growth), values, out=way, where=values != 0.0)
