"""Pieces of force laws: a curve between two displacements, on which the force rises, falls or is flat, and its inverse."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # whose packages load when first named: they take longer than all else at a command's start
from numpy.polynomial import polynomial

from .beam import EPS, root
from .curves import BeamCurve, Curve, PolynomialCurve

#: Forces that differ by no more than this part are equal, as of parts that end together: more than the round-off of a force
#: maximum, less than anyone means.  Without it a law would depend on the last bits of its parameters much more than they are
#: worth: a beam whose maximum is higher by 1e-16 stands 1e-8 of its height before it while another one snaps.
TIE = 32.0 * EPS
#: A Newton step shorter than this part is the last: the next one would be below round-off.
LAST_STEP = 1e-12


@dataclass(frozen=True, eq=False)
class Piece:
    """A curve from `start` to `end` (m; end may be inf), where the force goes from `first` to `last` (N), monotone.

    snapped: beams, polynomials and tables past their force maximum here; joined: the curve is that of the piece before.
    """

    curve: Curve
    start: float
    end: float
    first: float
    last: float
    snapped: int = 0
    joined: bool = False

    @classmethod
    def of(cls, curve, start: float, end: float, snapped: int = 0, joined: bool = False) -> Piece:
        """A piece with its forces worked out."""
        first, slope, _ = curve.value(start)
        if end < math.inf:
            last = curve.value(end)[0]
        else:
            slope = curve.value(start + 1.0)[0] - first
            last = math.copysign(math.inf, slope) if slope else first
        return cls(curve, start, end, first, last, snapped, joined)

    @cached_property
    def sign(self) -> int:
        """1 rising, 0 flat, -1 falling."""
        return (self.last > self.first) - (self.last < self.first)

    @cached_property
    def tie(self) -> float:
        """A force this near that of an end is one with it, N: TIE of the largest force on the piece, since a minimum that is
        small beside it has the round-off of the whole."""
        return TIE * max(abs(self.first), abs(self.last) if abs(self.last) < math.inf else 0.0)

    def inverse(self, force: float, tied: bool = False) -> float:
        """u at which the force stands, m; the nearer end where the piece does not reach it.  Of a flat one: its start.

        tied: whether an end whose force ties is where it stands; nearly there, where the force turns, u has half its digits.
        """
        sign = self.sign
        if tied and self.sign:
            for at, limit in ((self.end, self.last), (self.start, self.first)):
                if abs(force - limit) <= self.tie:
                    return at
        if sign * (force - self.first) <= 0.0:
            return self.start
        if sign * (self.last - force) <= 0.0:
            return self.end
        if type(self.curve) is BeamCurve and self.curve.zeta > 2.0:
            region = "I" if self.end <= self.curve.h else "III" if self.start >= self.curve.h else "II"
            u = self.curve.h * root(force / self.curve.Q, self.curve.zeta, region)
            return min(max(u, self.start), self.end)
        if type(self.curve) is PolynomialCurve and len(self.curve.coefficients) == 2:
            constant, slope = self.curve.coefficients
            return min(max(self.curve.at + (force - constant) / slope, self.start), self.end)
        return self._solved(force)

    def _solved(self, force: float) -> float:
        """u at a force between those of the ends, m, of any curve."""
        sign, end = self.sign, self.end
        if end == math.inf:
            width = 1.0
            while sign * (self.curve.value(self.start + width)[0] - force) < 0.0:
                width *= 2.0
            end = self.start + width

        def excess(u: float) -> tuple[float, float]:
            value, slope, _ = self.curve.value(u)
            return sign * (value - force), sign * slope

        return bracketed_newton(excess, self.start, end, 0.5 * (self.start + end), 2.0 * EPS * abs(force))


def bracketed_newton(excess, low: float, high: float, start: float, negligible: float) -> float:
    """Root of a rising function between low and high, by Newton steps that are halved where they leave the bracket.

    excess(x): value and slope; start: the first x; negligible: a value that is 0 but for round-off.  SciPy's `brentq` reaches
    the same digits with 4.5 to 5 times as many values (series of 4 and of 20 beams), each of which may stand for a series.
    """
    x, ends = start, (low, high)
    for _ in range(200):
        value, slope = excess(x)
        if abs(value) <= negligible or high - low <= EPS * abs(high):
            break
        if value > 0.0:
            high = x
        else:
            low = x
        newton = x - value / slope if slope and math.isfinite(slope) else math.inf
        if abs(newton - x) <= LAST_STEP * abs(x):
            return min(max(newton, ends[0]), ends[1])
        x = newton if low <= newton <= high else 0.5 * (low + high)
    return x


def turning_points(curve, start: float, end: float) -> list[float]:
    """Where the slope changes its sign inside (start, end), m, in order."""
    local = curve.local(start) if hasattr(curve, "local") else None
    width = end - start
    if local is None:
        grid = np.linspace(start, end, 65) if end < math.inf else start + np.append(0.0, np.ldexp(1.0, np.arange(-32, 32)))
        slopes = [curve.value(u)[1] for u in grid]
        turns = [i for i in range(64) if slopes[i] * slopes[i + 1] < 0.0]
        return [_zero(lambda u: curve.value(u)[1], grid[i], grid[i + 1]) for i in turns]
    derivative = np.trim_zeros(polynomial.polyder(local), "b")
    roots = polynomial.polyroots(derivative) if len(derivative) > 1 else np.array([])
    near = np.abs(roots.imag) <= 1e-7 * np.abs(roots)
    places = sorted({float(r) for r in roots[near].real if 0.0 < r < width})
    ends = [0.0, *places, width if width < math.inf else 2.0 * max(places, default=0.5)]
    middle = [curve.value(start + 0.5 * (a + b))[1] for a, b in itertools.pairwise(ends)]
    found = []
    for at, before, after, low, high in zip(places, middle, middle[1:], ends, ends[2:]):
        if before * after < 0.0:
            found.append(_zero(lambda u: curve.value(u)[1], start + 0.5 * (low + at), start + 0.5 * (at + high)))
    return found


def _zero(function: Callable, low: float, high: float) -> float:
    """Root of a function that changes its sign between low and high."""
    return float(scipy.optimize.brentq(function, low, high, xtol=1e-300, rtol=4.0 * EPS, maxiter=500))


def monotone(curve, start: float, end: float, snapped: int = 0, joined: bool = False) -> list[Piece]:
    """A curve cut into pieces at its turning points."""
    ends = [start, *turning_points(curve, start, end), end]
    return [Piece.of(curve, a, b, snapped, joined or a > start) for a, b in itertools.pairwise(ends)]
