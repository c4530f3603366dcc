"""Force curves as panels of polynomials, fitted to the exact laws."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev, polynomial

from ..model import NSH
from ..model.elements import Element
from . import elements
from . import nsh as nsh_law
from .curves import HeldCurve

DEGREE = 11
ACCURACY = 2e-15  # largest error of a rise's force, relative to the end force
MAX_PANELS = 256
POWERS = np.arange(DEGREE + 1)


class Panel(NamedTuple):
    """centre, half: m, of the elongations that t = -1..1 stands for; reach: |t| beyond which Taylor's polynomial takes over;
    force, stiffness: coefficients of t^0, t^1 …, N and N/m; energy: J, the same, integrated from no elongation."""

    centre: float
    half: float
    reach: float
    force: np.ndarray
    stiffness: np.ndarray
    energy: np.ndarray


def _panel(centre: float, half: float, reach: float, force, stiffness, stored: float) -> Panel:
    """stored: J at the panel's start t = -1, or at t = 0 of a panel without ends."""
    energy = half * polynomial.polyint(force)
    energy[0] += stored - (polynomial.polyval(-1.0, energy) if np.isfinite(reach) else energy[0])
    return Panel(centre, half, reach, np.asarray(force), np.asarray(stiffness), energy)


@lru_cache(maxsize=64)
def _nsh_panels(nsh: NSH) -> tuple[tuple[Panel, ...], ...]:
    """Panels of the pieces 1..P."""
    found = []
    for number, piece in enumerate(nsh_law.curve(nsh).pieces, 1):
        stored = float(nsh_law.energy(nsh, piece.xi_start, 0.0))
        found.append((_snap(nsh, piece, stored),) if piece.snap else _rise(nsh, number, piece))
    return tuple(found)


def _snap(nsh: NSH, piece, stored: float) -> Panel:
    """The leading beam's cubic (eq. 11) about its u = 0, the other beams held."""
    Q, zeta, h = (getattr(nsh, name)[piece.lead] for name in ("Q", "zeta", "h"))
    force = Q * np.array([0.0, 2.0 * (1.0 + zeta), -3.0 * zeta, zeta])
    panel = _panel(piece.held, h, np.inf, force, polynomial.polyder(force) / h, 0.0)
    panel.energy[0] += stored - polynomial.polyval((piece.xi_start - piece.held) / h, panel.energy)
    return panel


def _rise(nsh: NSH, number: int, piece) -> tuple[Panel, ...]:
    def values(x, which):
        if which:
            return np.asarray(nsh_law.stiffness(nsh, np.clip(x, piece.xi_start, piece.xi_end), 0.0))
        return np.array([nsh_law.force_on_piece(nsh, number, e, 0.0) for e in x])

    def energy(x):
        return float(nsh_law.energy(nsh, x, 0.0))

    return _interpolated(piece.xi_start, piece.xi_end, values, energy, ACCURACY * nsh_law.curve(nsh).end_force)


def _interpolated(start: float, end: float, values, energy, error: float) -> tuple[Panel, ...]:
    """Chebyshev interpolants on equal panels from start to end (m), as many as the error (N) asks for.

    values: (x, 0) gives force, (x, 1) stiffness at several elongations; energy: J at one.
    """
    best, best_error = (), np.inf
    count = 4
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

        def scaled(t, which, centre=centre):
            return values(centre + half * t, which)

        fits = [chebyshev.cheb2poly(chebyshev.chebinterpolate(scaled, DEGREE, (which,))) for which in (0, 1)]
        exact = values(centre + half * between, 0)
        error = max(error, float(np.abs(polynomial.polyval(between, fits[0]) - exact).max()))
        panels.append(_panel(centre, half, 1.0, *fits, energy(centre - half)))
    return tuple(panels), error


class NoPanels(Exception):
    """A piece that no panels cover; string: its number; start: m, where the piece begins."""

    def __init__(self, start: float):
        super().__init__(start)
        self.start, self.string = start, -1


def _pieces(kind: NSH | Element | None, k: float) -> list[tuple[Panel, ...]]:
    """Panels of a string's pieces from 0 on; k: N/m."""
    slack = _panel(0.0, 1.0, np.inf, [0.0], [0.0], 0.0)
    if kind is None:
        return [(slack,), (_panel(0.0, 1.0, np.inf, [0.0, k], [k], 0.0),)]
    if isinstance(kind, NSH):
        c = nsh_law.curve(kind)
        end, end_force, stored = c.breakpoints[-1], c.end_force, float(nsh_law.energy(kind, c.breakpoints[-1], k))
        return [(slack,), *_nsh_panels(kind), (_panel(end, 1.0, np.inf, [end_force, k], [k], stored),)]
    law = elements.law(kind)
    found = [(slack,), *_element_panels(kind)]
    if law.end < math.inf:
        found.append((_panel(law.end, 1.0, np.inf, [law.end_force, k], [k], law.energy(law.end)),))
    return found


@lru_cache(maxsize=64)
def _element_panels(element: Element) -> tuple[tuple[Panel, ...], ...]:
    """Panels of an element's pieces 1..P: a polynomial's own where it is one, else interpolants.  Raises NoPanels."""
    law = elements.law(element)
    largest = max(abs(one.last) for one in law.stretches if one.last < math.inf) if law.stretches[0].last < math.inf else 1.0
    found = []
    for number, piece in enumerate(law.pieces, 1):
        stored, local = law.energy(piece.start), _local(piece.curve, piece.start, piece.end)
        if local is not None:
            found.append((_panel(piece.start, 1.0, np.inf, local, polynomial.polyder(local), stored),))
        elif piece.end == math.inf:
            raise NoPanels(piece.start)
        else:

            def values(x, which, number=number):
                return np.array([law._value(number, float(e), 0.0)[which] for e in x])

            found.append(_interpolated(piece.start, piece.end, values, law.energy, ACCURACY * largest))
    return tuple(found)


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


def _table(rows: list[np.ndarray], count: int = DEGREE + 1) -> np.ndarray:
    """(R, count): coefficient lists padded with zeros."""
    table = np.zeros((len(rows), count))
    for i, row in enumerate(rows):
        table[i, : len(row)] = row
    return table
