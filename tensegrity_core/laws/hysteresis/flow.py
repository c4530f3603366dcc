"""The overdamped flow to the next stable state, where a state has lost its stability."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import scipy

from ...errors import TensegrityError
from ..beam import EPS

if TYPE_CHECKING:
    from .memory import Memory

#: The flow starts this far from the state that lost its stability, as a part of the leading part's piece.
NUDGE = 1e-3
#: Tolerances of the flow's integration; the limit itself is solved for exactly.
FLOW_RTOL, FLOW_ATOL = 1e-8, 1e-12
#: The flow has arrived where a Newton step from a stable state is shorter than this part of the pieces.
ARRIVED = 1e-7
#: Eigenvalues below this part of the parts' largest slope are not those of a stable state.
NEUTRAL = 1e-8
#: Steps after which a flow counts as endless.
MAX_STEPS = 3000


class NoStableState(TensegrityError):
    """No stable state of a series with memory was found after one that is none."""


class Flow:
    """The overdamped flow u' = T - f(u) at a held elongation x (m), with stops at 0 and at the parts' ends."""

    def __init__(self, m: Memory, x: float):
        self.m, self.x = m, x
        self.end = np.array([part.end for part in m.parts])

    def tension(self, u: np.ndarray) -> float:
        return max(self.m.k * (self.x - math.fsum(u)), 0.0)

    def rate(self, u: np.ndarray) -> np.ndarray:
        return self.tension(u) - np.array([self.m.force(i, v)[0] for i, v in enumerate(u)])

    def hessian(self, u: np.ndarray) -> np.ndarray:
        slopes = [self.m.force(i, v)[1] for i, v in enumerate(u)]
        return np.diag(slopes) + (self.m.k if self.tension(u) > 0.0 else 0.0)

    def limit(self, u: np.ndarray, origin: np.ndarray) -> np.ndarray:
        """(n,) m: where the flow from u ends, to within ARRIVED.  origin: the state that it leaves.

        Where that is so nearly neutral that round-off is all that moves the flow, it is pushed further.
        """
        u, steps, push = np.clip(u, 0.0, self.end), 0, NUDGE * self.m.width
        while True:
            free = ~self._held(u)
            moved = u.copy()
            solver = self._solver(u, free, moved)
            while (free == ~self._held(u)).all():
                if self._arrived(u, free):
                    return u
                if np.abs(self.rate(u)[free]).max() <= 64.0 * EPS * self.m.k * self.x:
                    push *= 10.0
                    u = self._pushed(u, free, push, u - origin)
                    break
                before, steps = solver.t, steps + 1
                solver.step()
                if solver.status == "failed" or steps > MAX_STEPS:
                    raise NoStableState(f"a snap at x = {self.x!r} m finds no end")
                u = u.copy()
                u[free] = self._stopped(solver, before, free)
                if not np.array_equal(u[free], solver.y):
                    break

    def _pushed(self, u: np.ndarray, free: np.ndarray, push: float, onward: np.ndarray) -> np.ndarray:
        """u moved by `push` (m) along the lowest eigenvector, to the side of `onward`."""
        vector = np.linalg.eigh(self.hessian(u)[np.ix_(free, free)])[1][:, 0]
        u = u.copy()
        u[free] += push * math.copysign(1.0, vector @ onward[free]) * vector
        return np.clip(u, 0.0, self.end)

    def _held(self, u: np.ndarray) -> np.ndarray:
        """Whether each part is at a stop and pressed against it."""
        rate = self.rate(u)
        return (u >= self.end) & (rate >= 0.0) | (u <= 0.0) & (rate <= 0.0)

    def _solver(self, u: np.ndarray, free: np.ndarray, whole: np.ndarray) -> scipy.integrate.Radau:
        def rate(_, v):
            whole[free] = v
            return self.rate(whole)[free]

        def jacobian(_, v):
            whole[free] = v
            return -self.hessian(whole)[np.ix_(free, free)]

        return scipy.integrate.Radau(rate, 0.0, u[free], math.inf, rtol=FLOW_RTOL, atol=FLOW_ATOL * self.m.width, jac=jacobian)

    def _stopped(self, solver: scipy.integrate.Radau, before: float, free: np.ndarray) -> np.ndarray:
        """The free parts after a step that began at the time `before`; it ends where the first of them meets a stop."""
        end = self.end[free]
        if ((solver.y >= 0.0) & (solver.y <= end)).all():
            return solver.y
        dense = solver.dense_output()

        def room(t):
            v = dense(t)
            return float(min((end - v).min(), v.min()))

        t = scipy.optimize.brentq(room, before, solver.t) if room(before) > 0.0 > room(solver.t) else solver.t
        v = dense(t)
        near = FLOW_RTOL * self.m.width
        return np.where(v >= end - near, end, np.where(v <= near, 0.0, v)) if t < solver.t else np.clip(v, 0.0, end)

    def _arrived(self, u: np.ndarray, free: np.ndarray) -> bool:
        if not free.any():
            return True
        hessian = self.hessian(u)[np.ix_(free, free)]
        largest = max(abs(self.m.force(i, v)[1]) for i, v in enumerate(u))
        if not np.linalg.eigvalsh(hessian)[0] > NEUTRAL * largest:
            return False
        return bool(np.abs(np.linalg.solve(hessian, self.rate(u)[free])).max() <= ARRIVED * self.m.width)
