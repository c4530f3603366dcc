"""Rises of several pieces at once: parts in series carry one force, as a function of the sum of their displacements."""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import cached_property

from .beam import EPS
from .pieces import TIE, Piece, bracketed_newton

#: Parts of a chain between which a first guess is interpolated; elongations whose solutions are kept.
GUESSES, KEPT = 32, 4096


class Chain:
    """Pieces in series that carry one force, in order of the leading one's displacement p = start..end.

    lead: index of the leading piece: all others, which rise, carry its force.  held: m, sum of what does not move;
    base: J, its energy.  The sum of displacements x(p) must increase.
    """

    def __init__(self, pieces: list[Piece], lead: int, start: float, end: float, held: float, base: float):
        self.pieces, self.lead, self.start, self.end = tuple(pieces), lead, start, end
        self.held, self.base = held, base
        ahead = self.pieces[lead]
        self._curve = ahead.curve
        self._others = [
            (i, s, s.curve == ahead.curve and s.start == ahead.start) for i, s in enumerate(self.pieces) if i != lead
        ]
        self.lower, self.upper = self.total(start), self.total(end) if end < math.inf else math.inf

    def displacements(self, p: float) -> list[float]:
        """u of every piece, m.  At the chain's ends parts whose ends tie with the force are at these."""
        u = [p] * len(self.pieces)
        force, tied = self._curve.value(p)[0], p == self.start or p == self.end
        for i, other, alike in self._others:
            if not alike:  # a part of the same kind moves alike, which keeps all digits where both turn together
                u[i] = other.inverse(force, tied)
        return u

    def tied(self, p: float) -> bool:
        """Whether another piece than the leading one begins or ends, to within TIE, with the force at p (m)."""
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
        low, high = self.start, self.end
        if high < math.inf:
            first = self._guessed(x)
        else:
            high = (low + (x - self.lower)) * (1.0 + TIE)  # p grows no faster than the sum
            first = low + (high - low) * 0.5

        def excess(p: float) -> tuple[float, float]:
            u = self.displacements(p)
            return math.fsum((self.held, *u, -x)), sum(self.ratios(u))

        return bracketed_newton(excess, low, high, first, 2.0 * EPS * abs(x))

    def _guessed(self, x: float) -> float:
        """About p at the sum x (m), by cubic interpolation: it saves Newton steps and decides nothing."""
        at, p, slope = self._guesses
        i = min(max(bisect_left(at, x), 1), len(at) - 1)
        low, high, width = p[i - 1], p[i], at[i] - at[i - 1]
        s = (x - at[i - 1]) / width if width > 0.0 else 0.0
        a, b = slope[i - 1] * width - (high - low), (high - low) - slope[i] * width
        return min(max(low + s * (high - low) + s * (1.0 - s) * (a * (1.0 - s) + b * s), low), high)

    @cached_property
    def _guesses(self) -> tuple[tuple[float, ...], ...]:
        """x, p and dp/dx at places from end to end."""
        found = []
        for i in range(GUESSES + 1):
            p = self.start + (self.end - self.start) * (i / GUESSES)
            u = self.displacements(p)
            growth = sum(self.ratios(u))
            found.append((math.fsum((self.held, *u)), p, 1.0 / growth if growth > 0.0 else 0.0))
        return tuple(zip(*found))

    def value(self, p: float) -> tuple[float, float, float]:
        """Force and its first two derivatives by x: w f' of the leading piece and sum w_i^3 f''_i, w_i = du_i/dx."""
        u = self.displacements(p)
        force, slope, _ = self._curve.value(p)
        ratios = self.ratios(u)
        growth = sum(ratios)
        if not math.isfinite(growth) or growth == 0.0:
            return force, 0.0 if growth else math.copysign(math.inf, slope), 0.0
        curvature = math.fsum((r / growth) ** 3 * s.curve.value(v)[2] for r, s, v in zip(ratios, self.pieces, u))
        return force, slope / growth, curvature

    def energy(self, u: list[float]) -> float:
        """Energy of the displacements u, J."""
        return self.base + math.fsum(s.curve.energy(v) for s, v in zip(self.pieces, u))


def rise(pieces: list[Piece], low: float, high: float, held: float, base: float) -> list[Chain]:
    """Rising pieces that carry one force from `low` to `high` (N; high may be inf), as chains in order.

    Near an end where a piece turns its own displacement is the good parameter, so the ends may need two chains.
    """
    count = range(len(pieces))
    ahead = min(count, key=lambda i: pieces[i].last)
    behind = max(count, key=lambda i: pieces[i].first)
    turns = pieces[behind].first >= low - pieces[behind].tie and _turns(pieces[behind])
    end = pieces[ahead].inverse(high) if high < math.inf else math.inf
    if not turns or behind == ahead:
        return [Chain(pieces, ahead, pieces[ahead].inverse(low), end, held, base)]
    middle = 0.5 * (low + high) if high < math.inf else 2.0 * low if low > 0.0 else 1.0
    first = Chain(pieces, behind, pieces[behind].inverse(low), pieces[behind].inverse(middle), held, base)
    return [first, Chain(pieces, ahead, pieces[ahead].inverse(middle), end, held, base)]


def _turns(one: Piece) -> bool:
    """Whether a rising piece starts without a slope."""
    width = one.end - one.start if one.end < math.inf else max(one.start, 1e-3)
    return one.curve.value(one.start)[1] < 0.1 * one.curve.value(one.start + 1e-3 * width)[1]


class RiseCurve:
    """Chains one after the other as one curve of the sum x; past its ends a second order Taylor polynomial."""

    def __init__(self, chains: list[Chain]):
        self.chains = tuple(chains)
        self.lower, self.upper = chains[0].lower, chains[-1].upper
        self._kept: dict[float, tuple[Chain, float]] = {}

    def place(self, x: float) -> tuple[Chain, float]:
        """The chain that holds x, and p there."""
        found = self._kept.get(x)  # force, stiffness and energy are asked for in turn
        if found is None:
            chain = next((c for c in self.chains if x <= c.upper), self.chains[-1])
            found = chain, chain.solve(float(x))
            if len(self._kept) >= KEPT:
                self._kept = {}
            self._kept[x] = found
        return found

    def value(self, x: float) -> tuple[float, float, float]:
        chain, p = self.place(x)
        force, slope, curvature = chain.value(p)
        past = x - min(max(x, self.lower), self.upper)
        return force + past * (slope + 0.5 * past * curvature), slope + past * curvature, curvature

    def displacements(self, x: float) -> list[float]:
        """u of every piece, m."""
        chain, p = self.place(x)
        return chain.displacements(p)

    def energy(self, x: float) -> float:
        chain, p = self.place(x)
        past = x - min(max(x, self.lower), self.upper)
        force, slope, _ = chain.value(p) if past else (0.0, 0.0, 0.0)
        return chain.energy(chain.displacements(p)) + past * (force + 0.5 * past * slope)
