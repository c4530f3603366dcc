"""Stretches of force laws: where a force is smooth and monotone, and how several of them move at equal force.

A *curve* is a formula: `value(u)` gives force, slope and curvature (N, N/m, N/m2), `energy(u)` the integral of the force from
u = 0 (J).  A formula goes on smoothly past the ends of its stretch, since an integrator looks there.  A `Stretch` is a curve
between two displacements on which the force rises, falls or is flat; it can be inverted.  A `Chain` is a series of stretches
that carry one force, as a function of the sum of their displacements.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np
import scipy  # whose packages load when first named: they take longer than all else at a command's start
from numpy.polynomial import polynomial

from . import nsh

EPS = math.ulp(1.0)
#: Forces that differ by no more than this part are equal: parts that end together.  See `Stretch.tie`.
TIE = nsh.TIE
#: A Newton step shorter than this part is the last: the next one would be below round-off.
LAST_STEP = 1e-12


class BeamCurve(NamedTuple):
    """Eq. 11."""

    Q: float
    zeta: float
    h: float

    def value(self, u: float) -> tuple[float, float, float]:
        curvature = 6.0 * self.Q * self.zeta / self.h**2 * (u / self.h - 1.0)
        return nsh.beam_force(*self, u), nsh.beam_stiffness(*self, u), curvature

    def energy(self, u: float) -> float:
        return nsh.beam_energy(*self, u)

    def local(self, at: float) -> np.ndarray:
        """Coefficients of f in powers of u - at."""
        force, slope, curvature = self.value(at)
        return np.array([force, slope, 0.5 * curvature, self.Q * self.zeta / self.h**3])


class PolynomialCurve(NamedTuple):
    """f = sum of coefficients[i] (u - at)^i.  base: energy at u = at, J."""

    at: float
    coefficients: tuple[float, ...]
    base: float

    def value(self, u: float) -> tuple[float, float, float]:
        s, force, slope, half = u - self.at, 0.0, 0.0, 0.0
        for c in reversed(self.coefficients):
            half = half * s + slope
            slope = slope * s + force
            force = force * s + c
        return force, slope, 2.0 * half

    def energy(self, u: float) -> float:
        s, total = u - self.at, 0.0
        for power in range(len(self.coefficients), 0, -1):
            total = (total + self.coefficients[power - 1] / power) * s
        return self.base + total

    def local(self, at: float) -> np.ndarray:
        """Coefficients of f in powers of u - at."""
        shifted = polynomial.Polynomial(self.coefficients)(polynomial.Polynomial([at - self.at, 1.0]))
        return shifted.coef


class SumCurve(NamedTuple):
    """Curves in parallel."""

    parts: tuple

    def value(self, u: float) -> tuple[float, float, float]:
        force, slope, curvature = zip(*(part.value(u) for part in self.parts))
        return sum(force), sum(slope), sum(curvature)

    def energy(self, u: float) -> float:
        return sum(part.energy(u) for part in self.parts)

    def local(self, at: float) -> np.ndarray | None:
        """Coefficients of f in powers of u - at; None where a part is no polynomial."""
        parts = [part.local(at) if hasattr(part, "local") else None for part in self.parts]
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):
            return None
        return sum((polynomial.Polynomial(part) for part in known), polynomial.Polynomial([0.0])).coef


class Curve(Protocol):
    """A force over one displacement: force (N), slope (N/m) and curvature (N/m2) at u (m), and the energy (J) from 0 to u."""

    def value(self, u: float) -> tuple[float, float, float]: ...

    def energy(self, u: float) -> float: ...


class HeldCurve(NamedTuple):
    """A part that moves along its own curve while the others of its series are held.

    held: sum of their displacements, m; base: their energy, J.
    """

    part: Curve
    held: float
    base: float

    def value(self, u: float) -> tuple[float, float, float]:
        return self.part.value(u - self.held)

    def energy(self, u: float) -> float:
        return self.base + self.part.energy(u - self.held)


@dataclass(frozen=True, eq=False)
class Stretch:
    """A curve from `start` to `end` (m; end may be inf), where the force goes from `first` to `last` (N), monotone.

    snapped: beams, polynomials and tables past their force maximum here; joined: the curve is that of the stretch before.
    """

    curve: Curve
    start: float
    end: float
    first: float
    last: float
    snapped: int = 0
    joined: bool = False

    @cached_property
    def sign(self) -> int:
        """1 rising, 0 flat, -1 falling."""
        return (self.last > self.first) - (self.last < self.first)

    @cached_property
    def tie(self) -> float:
        """A force this near that of an end is one with it, N: TIE of the largest force on the stretch, since a minimum that is
        small beside it has the round-off of the whole."""
        return TIE * max(abs(self.first), abs(self.last) if abs(self.last) < math.inf else 0.0)

    def inverse(self, force: float, tied: bool = False) -> float:
        """u at which the force stands, m; the nearer end where the stretch does not reach it.  Of a flat one: its start.

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
            u = self.curve.h * nsh.root(force / self.curve.Q, self.curve.zeta, region)
            return min(max(u, self.start), self.end)
        if type(self.curve) is PolynomialCurve and len(self.curve.coefficients) == 2:
            constant, slope = self.curve.coefficients
            return min(max(self.curve.at + (force - constant) / slope, self.start), self.end)
        return _inverted(self.curve, force, sign, self.start, self.end)


def _inverted(curve, force: float, sign: int, low: float, high: float) -> float:
    """u with curve = force by Newton steps inside a bracket [low, high], halved where they leave it."""
    if high == math.inf:
        width = 1.0
        while sign * (curve.value(low + width)[0] - force) < 0.0:
            width *= 2.0
        high = low + width
    u = 0.5 * (low + high)
    for _ in range(200):
        value, slope, _ = curve.value(u)
        gap = value - force
        if abs(gap) <= 2.0 * EPS * abs(force) or high - low <= EPS * high:
            break
        if sign * gap > 0.0:
            high = u
        else:
            low = u
        newton = u - gap / slope if slope else math.inf
        if abs(newton - u) <= LAST_STEP * abs(u):
            return min(max(newton, low), high)
        u = newton if low <= newton <= high else 0.5 * (low + high)
    return u


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
    middle = [curve.value(start + 0.5 * (a + b))[1] for a, b in pairwise(ends)]
    found = []
    for at, before, after, low, high in zip(places, middle, middle[1:], ends, ends[2:]):
        if before * after < 0.0:
            found.append(_zero(lambda u: curve.value(u)[1], start + 0.5 * (low + at), start + 0.5 * (at + high)))
    return found


def _zero(function: Callable, low: float, high: float) -> float:
    """Root of a function that changes its sign between low and high."""
    return float(scipy.optimize.brentq(function, low, high, xtol=1e-300, rtol=4.0 * EPS, maxiter=500))


def monotone(curve, start: float, end: float, snapped: int = 0, joined: bool = False) -> list[Stretch]:
    """A curve cut into stretches at its turning points."""
    ends = [start, *turning_points(curve, start, end), end]
    return [stretch(curve, a, b, snapped, joined or a > start) for a, b in pairwise(ends)]


def stretch(curve, start: float, end: float, snapped: int = 0, joined: bool = False) -> Stretch:
    """A stretch with its forces worked out."""
    first, slope, _ = curve.value(start)
    if end < math.inf:
        last = curve.value(end)[0]
    else:
        slope = curve.value(start + 1.0)[0] - first
        last = math.copysign(math.inf, slope) if slope else first
    return Stretch(curve, start, end, first, last, snapped, joined)


class Chain:
    """Stretches in series that carry one force, in order of the leading one's displacement p = start..end.

    lead: index of the leading stretch: all others, which rise, carry its force.  held: m, sum of what does not move;
    base: J, its energy.  The sum of displacements x(p) must increase.
    """

    def __init__(self, stretches: list[Stretch], lead: int, start: float, end: float, held: float, base: float):
        self.stretches, self.lead, self.start, self.end = tuple(stretches), lead, start, end
        self.held, self.base = held, base
        ahead = self.stretches[lead]
        self._curve = ahead.curve
        self._others = [
            (i, s, s.curve == ahead.curve and s.start == ahead.start) for i, s in enumerate(self.stretches) if i != lead
        ]
        self.lower, self.upper = self.total(start), self.total(end) if end < math.inf else math.inf

    def displacements(self, p: float) -> list[float]:
        """u of every stretch, m.  At the chain's ends parts whose ends tie with the force are at these."""
        u = [p] * len(self.stretches)
        force, tied = self._curve.value(p)[0], p == self.start or p == self.end
        for i, other, alike in self._others:
            if not alike:  # a part of the same kind moves alike, which keeps all digits where both turn together
                u[i] = other.inverse(force, tied)
        return u

    def tied(self, p: float) -> bool:
        """Whether another stretch than the leading one begins or ends, to within TIE, with the force at p (m)."""
        force = self._curve.value(p)[0]
        return any(abs(force - end) <= other.tie for _, other, _ in self._others for end in (other.first, other.last))

    def total(self, p: float) -> float:
        """x: sum of all displacements, m."""
        return math.fsum((self.held, *self.displacements(p)))

    def ratios(self, u: list[float]) -> list[float]:
        """du_i/dp: the slopes' inverse ratio; where both turn together, its limit."""
        _, slope, curvature = self._curve.value(u[self.lead])
        found = [1.0] * len(u)
        for i, other, alike in self._others:
            if alike:
                continue
            _, slope_i, curvature_i = other.curve.value(u[i])
            if slope_i > 0.0:
                found[i] = slope / slope_i
            elif slope == 0.0:
                found[i] = math.copysign(abs(curvature / curvature_i) ** 0.5, curvature * curvature_i) if curvature_i else 0.0
            else:
                found[i] = math.copysign(math.inf, slope)
        return found

    def growth(self, p: float) -> float:
        """dx/dp."""
        return sum(self.ratios(self.displacements(p)))

    def solve(self, x: float) -> float:
        """p at the sum x (m), clipped to the chain: Newton steps inside a bracket, halved where they leave it."""
        if not self.lower < x < self.upper:
            return self.start if x <= self.lower else self.end
        low, high, part = self.start, self.end, 0.5
        if high < math.inf:
            part = (x - self.lower) / (self.upper - self.lower)
        else:
            high = (low + (x - self.lower)) * (1.0 + TIE)  # p grows no faster than the sum
        p = low + (high - low) * part
        for _ in range(200):
            u = self.displacements(p)
            gap = math.fsum((self.held, *u, -x))
            if abs(gap) <= 2.0 * EPS * abs(x) or high - low <= EPS * abs(high):
                break
            if gap > 0.0:
                high = p
            else:
                low = p
            growth = sum(self.ratios(u))
            newton = p - gap / growth if growth and math.isfinite(growth) else math.inf
            if abs(newton - p) <= LAST_STEP * abs(p):
                return min(max(newton, self.start), self.end)
            p = newton if low <= newton <= high else 0.5 * (low + high)
        return p

    def value(self, p: float) -> tuple[float, float, float]:
        """Force and its first two derivatives by x: w f' of the leading stretch and sum w_i^3 f''_i, w_i = du_i/dx."""
        u = self.displacements(p)
        force, slope, _ = self._curve.value(p)
        ratios = self.ratios(u)
        growth = sum(ratios)
        if not math.isfinite(growth) or growth == 0.0:
            return force, 0.0 if growth else math.copysign(math.inf, slope), 0.0
        curvature = math.fsum((r / growth) ** 3 * s.curve.value(v)[2] for r, s, v in zip(ratios, self.stretches, u))
        return force, slope / growth, curvature

    def energy(self, u: list[float]) -> float:
        """Energy of the displacements u, J."""
        return self.base + math.fsum(s.curve.energy(v) for s, v in zip(self.stretches, u))


def rise(stretches: list[Stretch], low: float, high: float, held: float, base: float) -> list[Chain]:
    """Rising stretches that carry one force from `low` to `high` (N; high may be inf), as chains in order.

    Near an end where a stretch turns its own displacement is the good parameter, so the ends may need two chains.
    """
    count = range(len(stretches))
    ahead = min(count, key=lambda i: stretches[i].last)
    behind = max(count, key=lambda i: stretches[i].first)
    turns = stretches[behind].first >= low - stretches[behind].tie and _turns(stretches[behind])
    end = stretches[ahead].inverse(high) if high < math.inf else math.inf
    if not turns or behind == ahead:
        return [Chain(stretches, ahead, stretches[ahead].inverse(low), end, held, base)]
    middle = 0.5 * (low + high) if high < math.inf else 2.0 * low if low > 0.0 else 1.0
    first = Chain(stretches, behind, stretches[behind].inverse(low), stretches[behind].inverse(middle), held, base)
    return [first, Chain(stretches, ahead, stretches[ahead].inverse(middle), end, held, base)]


def _turns(one: Stretch) -> bool:
    """Whether a rising stretch starts without a slope."""
    width = one.end - one.start if one.end < math.inf else max(one.start, 1e-3)
    return one.curve.value(one.start)[1] < 0.1 * one.curve.value(one.start + 1e-3 * width)[1]


class RiseCurve:
    """Chains one after the other as one curve of the sum x; past its ends a second order Taylor polynomial."""

    def __init__(self, chains: list[Chain]):
        self.chains = tuple(chains)
        self.lower, self.upper = chains[0].lower, chains[-1].upper

    def place(self, x: float) -> tuple[Chain, float]:
        """The chain that holds x, and p there."""
        chain = next((c for c in self.chains if x <= c.upper), self.chains[-1])
        return chain, chain.solve(x)

    def value(self, x: float) -> tuple[float, float, float]:
        chain, p = self.place(x)
        force, slope, curvature = chain.value(p)
        past = x - min(max(x, self.lower), self.upper)
        return force + past * (slope + 0.5 * past * curvature), slope + past * curvature, curvature

    def displacements(self, x: float) -> list[float]:
        """u of every stretch, m."""
        chain, p = self.place(x)
        return chain.displacements(p)

    def energy(self, x: float) -> float:
        chain, p = self.place(x)
        past = x - min(max(x, self.lower), self.upper)
        force, slope, _ = chain.value(p) if past else (0.0, 0.0, 0.0)
        return chain.energy(chain.displacements(p)) + past * (force + 0.5 * past * slope)
