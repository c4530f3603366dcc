"""The overdamped flow after a snap, in large steps.

`statics.descend` follows x' = -grad V in small steps, each with all eigenvectors.  Here a step is one of implicit Euler,

    (K + 1/t) dx + A^T dq = F,  A dx = c   (`saddle`),

over a time t after which what is unstable has grown by no more than GROWTH, shortened where it is longer than is small beside
the bars and the beams.  What is stable comes to rest at once in it, and where nothing is unstable t is infinite: the steps are
Newton's.
"""

from __future__ import annotations

import numpy as np

from .saddle import Saddle

MOST = 150  # steps
PART_OF_BAR, PART_OF_BEAM = 0.03, 0.4  # longest step, of a node and of the elongation of what snaps
GROWTH = 4.0  # of what is unstable, in one step
STIFFER = 4.0  # the next shorter time that is tried
NEAR = 1e-3  # the flow is at its end where a step of Newton's is so short, beside the longest
KINKS = 2  # how often a step is tried again on the pieces to which it led
SLOWEST = 1e-4  # the longest time that is not infinite, as a part of the stiffest string's 1/k, is the inverse of this


def settled(saddle: Saddle, free: np.ndarray, direction: np.ndarray, parameter: float) -> np.ndarray | None:
    """(n,) where the flow from free coordinates (n,) is so near to a strictly stable equilibrium that Newton's method takes it
    there, None where it comes to none in so many steps.  direction: (n,), in which it sets out."""
    equations, laws, n = saddle.equations, saddle.equations.laws, saddle.n
    longest = PART_OF_BAR * float(equations.model.bar_length.min())
    beams = np.flatnonzero(np.isfinite(laws.narrow))
    narrow = PART_OF_BEAM * laws.narrow[beams]
    z, pace, work, tried, watched, on = saddle.start(free, parameter), 0.0, np.inf, 0, None, None
    for _ in range(MOST):
        stretch = equations.stretch(z[:n], parameter)
        piece = laws.piece_of(stretch)
        saddle.at(z, parameter, laws.on(piece))
        back = False
        if watched is not None:  # this step should have mended the one before
            back = equations.energy(z[:n], parameter, stretch) > highest
            before, watched = watched if back else z, None
        elif saddle.force @ direction < -work:  # thrown back
            if not np.array_equal(piece, on) and tried < KINKS:  # by a kink: do the pieces beyond lead there, too?
                z, pace, tried = before, slowness, tried + 1
                saddle.at(z, parameter, laws.on(piece))
            elif tried:
                back = True
            else:  # by a stiff string that the step has stretched
                watched, highest, pace = before, equations.energy(before[:n], parameter), slowness
        else:
            before, tried = z, 0
        if back:
            z, tried, pace, work = before, 0, STIFFER * max(slowness, SLOWEST * equations.stiffest), np.inf
            piece = laws.piece_of(equations.stretch(z[:n], parameter))
            saddle.at(z, parameter, laws.on(piece))
        on = piece
        slowness = max(pace, -GROWTH / (GROWTH - 1.0) * saddle.curvature(direction))
        while True:
            step = saddle.flow(slowness)
            if step is None or not saddle.definite():
                slowness = max(STIFFER * slowness, SLOWEST * equations.stiffest)
            else:
                direction = step[:n]
                excess = float(np.abs(direction).max()) / longest
                if len(narrow):
                    excess = max(excess, float((np.abs(saddle.directions(beams) @ direction) / narrow).max()))
                if excess <= 1.0:
                    break
                stiffness = saddle.curvature(direction)  # steps are about as F / (stiffness + slowness)
                slowness = max(1.2 * excess * (stiffness + slowness) - stiffness, 1.5 * slowness)
            if not slowness < 1e9 * equations.stiffest:
                return None
        work = float(saddle.force @ direction)
        z = z + step
        pace = 0.0 if excess < 0.5 else slowness / STIFFER
        if slowness == 0.0 and excess <= NEAR:
            return z[:n]
    return None
