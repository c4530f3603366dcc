"""The overdamped flow after a snap, in large steps.

`statics.descend` follows x' = -grad V in small steps, each with all eigenvectors.  Here a step is one of implicit Euler,

    (K + 1/t) dx + A^T dq = F,  A dx = c   (`saddle`),

over the longest time t in which what is unstable grows by no more than GROWTH, and the step stays small beside the bars and the
beams.  What is stiff comes to rest in it at once.  Where nothing is unstable and the way is short, t is infinite: the steps
are Newton's.

It is first order, and only where it comes to rest counts.  Where the flow passes close by a saddle, on whose other side
another minimum lies, its error may decide; docs/equilibrium-paths.md says how rarely that happens.
"""

from __future__ import annotations

import numpy as np

from ..statics import shortest_bar
from .saddle import Saddle

MOST = 150  # steps
PART_OF_BAR = 0.03  # longest step of a node
FALLING, RISING = 0.375, 0.18  # longest step of what snaps, as part of its shortest fall, while the energy is concave and after
GROWTH = 3.0  # of what is unstable, in one step
SHORTER, LONGER = 4.0, 4.0  # by how much the time changes that is tried next
SLOWEST = 1e-4  # N/m per N/m of the stiffest string: the 1/t of the longest time that is not infinite
SHORTEST = 1e9  # the same of the shortest
KINKS = 2  # how often a step is tried again on the pieces to which it led
NEAR = 1e-3  # the flow is at its end where a step of Newton's is so short, beside the longest


def settled(saddle: Saddle, free: np.ndarray, direction: np.ndarray, parameter: float) -> np.ndarray | None:
    """(n,) where the flow from free coordinates (n,) is so near to a strictly stable equilibrium that Newton's method takes it
    there, None where it comes to none in so many steps.  direction: (n,), in which it sets out."""
    return _Flow(saddle, parameter).settled(saddle.start(free, parameter), direction)


class _Flow:
    """A flow at one parameter.  size: how long the last step was, 1 being the longest; slowness: its 1/t."""

    def __init__(self, saddle: Saddle, parameter: float):
        self.saddle, self.parameter = saddle, parameter
        equations = saddle.equations
        self._longest = PART_OF_BAR * shortest_bar(equations.model)
        self._beams = np.flatnonzero(np.isfinite(equations.laws.narrow))
        self._narrow = equations.laws.narrow[self._beams]
        self._stiffest = equations.stiffest
        self.slowness = self.size = 0.0

    def settled(self, z: np.ndarray, direction: np.ndarray) -> np.ndarray | None:
        saddle, n = self.saddle, self.saddle.n
        pace, work, highest, tried, watched, laws, before = 0.0, np.inf, np.inf, 0, None, None, z
        for _ in range(MOST):
            saddle.at(z, self.parameter)
            back = None
            if watched is not None:  # this step should have mended the one before
                back, watched = watched if self._energy(z) > highest else None, None
                before = z
            elif saddle.force @ direction < -work:  # thrown back
                if saddle.laws is not laws and tried < KINKS:  # by a kink: do the pieces beyond lead there, too?
                    z, pace, tried = before, self.slowness, tried + 1
                    saddle.at(z, self.parameter, saddle.laws)
                elif tried:
                    back = before, self.slowness, direction
                else:  # by a stiff string that the step has stretched
                    watched, highest, pace = (before, self.slowness, direction), self._energy(before), self.slowness
            else:
                before, tried = z, 0
            if back is not None:
                (before, slowness, direction), tried = back, 0
                z = before
                saddle.at(z, self.parameter)
                pace = SHORTER * slowness + (SHORTER - 1.0) * max(saddle.curvature(direction), 0.0)
            laws = saddle.laws
            step = self._step(direction, pace, watched is not None)
            if step is None:
                return None
            direction, z = step[:n], z + step
            work = float(saddle.force @ direction)
            pace = 0.0 if self.size < 0.5 else self.slowness / LONGER
            if self.slowness == 0.0 and self.size <= NEAR:
                return z[:n]
        return None

    def _energy(self, z: np.ndarray) -> float:
        return self.saddle.equations.energy(z[: self.saddle.n], self.parameter)

    def _step(self, direction: np.ndarray, pace: float, mends: bool) -> np.ndarray | None:
        """(n+B,) the step over the longest time, None if there is none; direction: of the step before; pace: the least 1/t;
        mends: whether it goes back, and as far as it likes."""
        saddle, n, least = self.saddle, self.saddle.n, SLOWEST * self._stiffest
        stiffness = saddle.curvature(direction)
        slowness = max(pace, -GROWTH / (GROWTH - 1.0) * stiffness)
        narrow = self._narrow * (FALLING if stiffness < 0.0 else RISING)
        elongation = saddle.elongation[self._beams]
        before = np.maximum(elongation, 0.0)
        while slowness < SHORTEST * self._stiffest:
            step = saddle.flow(slowness)
            if step is None or not saddle.definite():
                slowness = max(SHORTER * slowness, least)
                continue
            size = float(np.maximum.reduce(np.abs(step[:n]))) / self._longest
            if len(narrow):
                after = np.maximum(elongation + saddle.directions(self._beams) @ step[:n], 0.0)  # slack, it may go far
                size = max(size, float(np.maximum.reduce(np.abs(after - before) / narrow)))
            if size <= 1.0 or mends:
                self.slowness, self.size = slowness, size
                return step
            stiffness = saddle.curvature(step[:n])  # steps are about as F / (stiffness + slowness)
            slowness = max(1.2 * size * (stiffness + slowness) - stiffness, 1.5 * slowness)
        return None
