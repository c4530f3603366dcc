"""Force curves as panels of polynomials, fitted to the exact laws: what the article, in its Algorithm 1, tabulates."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from .curves import HeldCurve

DEGREE = 11
ACCURACY = 2e-15  # largest error of a rise's force, relative to the end force
MAX_PANELS = 256
NODES = chebyshev.chebpts1(DEGREE + 1)


class Panel(NamedTuple):
    """centre, half: m, of the elongations that t = -1..1 stands for; reach: |t| beyond which Taylor's polynomial takes over;
    force, stiffness: coefficients of t^0, t^1 …, N and N/m; energy: J, the same, integrated from no elongation."""

    centre: float
    half: float
    reach: float
    force: np.ndarray
    stiffness: np.ndarray
    energy: np.ndarray


def panel(centre: float, half: float, reach: float, force, stiffness, stored: float) -> Panel:
    """stored: J at the panel's start t = -1, or at t = 0 of a panel without ends."""
    energy = half * polynomial.polyint(force)
    energy[0] += stored - (polynomial.polyval(-1.0, energy) if np.isfinite(reach) else energy[0])
    return Panel(centre, half, reach, np.asarray(force), np.asarray(stiffness), energy)


class NoPanels(Exception):
    """A piece that no panels cover; string: its number; start: m, where the piece begins."""

    def __init__(self, start: float):
        super().__init__(start)
        self.start, self.string = start, -1


def panels_of(curve, start: float, end: float, stored: float, energy, largest: float) -> tuple[Panel, ...]:
    """Panels of a curve from start to end (m): its own polynomial where it is one, else interpolants.  Raises NoPanels.

    stored: J at the start; energy: J at an elongation; largest: N, what the error is small beside.
    """
    local = _local(curve, start, end)
    if local is not None:
        return (panel(start, 1.0, np.inf, local, polynomial.polyder(local), stored),)
    if end == math.inf:
        raise NoPanels(start)
    return _interpolated(start, end, lambda x: np.array([curve.value(e)[:2] for e in x.tolist()]).T, energy, ACCURACY * largest)


def _interpolated(start: float, end: float, values, energy, error: float) -> tuple[Panel, ...]:
    """Chebyshev interpolants on equal panels from start to end (m), as many as the error (N) asks for.

    values: force and stiffness at several elongations (2, n); energy: J at one.
    """
    best: tuple[Panel, ...] = ()
    best_error, count = np.inf, 4
    while count <= MAX_PANELS:
        panels, largest = _fitted(start, end, values, energy, count)
        if largest < best_error:
            best, best_error = panels, largest
        if largest <= error or (largest > 0.5 * best_error and count > 16):
            break
        count *= 2
    return best


def _fitted(start: float, end: float, values, energy, count: int) -> tuple[tuple[Panel, ...], float]:
    """So many panels, and the largest error of their forces between the nodes, N."""
    half = 0.5 * (end - start) / count
    between = np.array([-0.95, -0.4, 0.13, 0.7])
    panels, error = [], 0.0
    for i in range(count):
        centre = start + (2 * i + 1) * half
        exact = values(centre + half * np.concatenate((NODES, between)))
        force, stiffness = (chebyshev.cheb2poly(_through(row)) for row in exact[:, : len(NODES)])
        error = max(error, float(np.abs(polynomial.polyval(between, force) - exact[0, len(NODES) :]).max()))
        panels.append(panel(centre, half, 1.0, force, stiffness, energy(centre - half)))
    return tuple(panels), error


def _through(values: np.ndarray) -> np.ndarray:
    """Chebyshev coefficients of the polynomial with these values at NODES."""
    return chebyshev.chebinterpolate(lambda _: values, DEGREE)


def _local(curve, start: float, end: float) -> np.ndarray | None:
    """Coefficients of a piece's force in powers of x - start, None where it is no polynomial of up to DEGREE."""
    if isinstance(curve, HeldCurve):
        return _local(curve.part, start - curve.held, end - curve.held)
    if hasattr(curve, "local"):
        found = curve.local(start)
        return found if found is not None and len(found) <= DEGREE else None
    if end == math.inf:  # a series of straight lines, all others at their stops, is a straight line
        force, slope, _ = curve.value(start)
        straight = all(abs(curve.value(start + x)[1] - slope) <= 1e-13 * slope for x in (1e-3, 1.0, 1e3))
        return np.array([force, slope]) if straight else None
    return None


def table(rows: list[np.ndarray], count: int = DEGREE + 1) -> np.ndarray:
    """(R, count): coefficient lists padded with zeros."""
    table = np.zeros((len(rows), count))
    for i, row in enumerate(rows):
        table[i, : len(row)] = row
    return table
