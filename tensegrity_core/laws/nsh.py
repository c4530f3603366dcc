"""Negative stiffness beams and honeycombs (NSH): the exact law.

A beam obeys eq. 11 of the article (Q force scale in N, zeta shape parameter, h arch height in m, u displacement in m).
Its force rises on region I up to f_max at u_max, falls on region II to f_min at u_min, rises again on region III and is
stopped at u = 2h.  Beams with 2 < zeta < 8 are metastable: they return when unloaded.

An NSH is a series of beams: equal forces, displacements add up to the elongation xi.  Its law here is `single_valued`
(Algorithm 1 of the article): loading makes the beams snap one after the other, in the order of their f_max (ties:
lowest index first).  The curve f(xi) is a chain of pieces:

* a *rise*: beams that have snapped are on III (at 2h beyond 4Q), the others on I; it ends where the next beam reaches
  its f_max, or where a beam on III reaches 2h;
* a *snap*: one beam follows its own cubic from u_max through II to the point on III where its force is f_max again,
  the other beams held.

Forces within `TIE` of each other are one: beams whose f_max tie come to u_max together, each to its own, and beams whose
stops tie come to rest together.  Without that a law would depend on the last bits of its parameters much more than they are
worth: a beam whose f_max is higher by 1e-16 stands 1e-8 of its height before u_max while another one snaps.

Piece 0 is slack (xi <= 0); piece p of 1..P has breakpoints[p-1] < xi <= breakpoints[p]; in piece P+1 the NSH has
bottomed out (all beams at 2h) and the string's own stiffness k takes over.

Nothing here is tabulated: every value solves the equations to round-off.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import cache, lru_cache, partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from ..errors import InputError
from ..model import NSH
from ..model.elements import BEAM_RANGES

_EPS = math.ulp(1.0)
#: Forces that differ by no more than this part are equal: more than the round-off of f_max, less than anyone means.
TIE = 32.0 * _EPS


# ---------------------------------------------------------------------------------------------------------------- beam


def beam_force(Q, zeta, h, u):
    """Force of a beam, N (eq. 11): f = Q (zeta x^3 - 3 zeta x^2 + 2 (1 + zeta) x), x = u/h.  Floats or arrays."""
    x = u / h
    return Q * x * (2.0 * (1.0 + zeta) + zeta * x * (x - 3.0))


def beam_stiffness(Q, zeta, h, u):
    """Derivative of eq. 11 by u, N/m."""
    x = u / h
    return Q / h * (2.0 * (1.0 + zeta) + 3.0 * zeta * x * (x - 2.0))


def beam_energy(Q, zeta, h, u):
    """Energy stored in a beam, J: the integral of eq. 11 from 0 to u."""
    x = u / h
    return Q * h * x * x * ((1.0 + zeta) + zeta * x * (0.25 * x - 1.0))


class Extrema(NamedTuple):
    """Where a beam's force has its maximum and its minimum (eq. 14); u in m, f in N."""

    u_max: float
    f_max: float
    u_min: float
    f_min: float


def beam_extrema(Q: float, zeta: float, h: float) -> Extrema:
    """Extrema of a beam's force (eq. 14): x = 1 -+ s, f = 2 Q (1 +- (zeta - 2) s / 3).  Needs zeta > 2."""
    Q, zeta, h = float(Q), float(zeta), float(h)
    if not zeta > 2.0:
        raise InputError(f"zeta = {zeta!r}: a beam with zeta <= 2 is monotone and has no extrema; use zeta > 2")
    s = _extremum_distance(zeta)
    swing = (zeta - 2.0) * s / 3.0
    return Extrema(h * (1.0 - s), 2.0 * Q * (1.0 + swing), h * (1.0 + s), 2.0 * Q * (1.0 - swing))


def beam_displacement(Q: float, zeta: float, h: float, f: float, region: str) -> float:
    """Displacement of a beam that carries the force f (N) on region 'I', 'II' or 'III', m (eq. 12-13).  Needs zeta > 2.

    No stop at 2h is applied.  The result satisfies eq. 11 to round-off.
    Raises InputError where that region does not reach the force.
    """
    low, high = {"I": (-math.inf, 1.0), "II": (-1.0, 1.0), "III": (-1.0, math.inf)}[region]
    Q, zeta, h, f = float(Q), float(zeta), float(h), float(f)
    reach = _reach(f / Q, zeta)
    if not low <= reach <= high:
        e = beam_extrema(Q, zeta, h)
        raise InputError(
            f"force {f!r} N is not on region {region} of a beam with f_max = {e.f_max!r} N, "
            f"f_min = {e.f_min!r} N; ask for another region"
        )
    return h * root(f / Q, zeta, region)


def _extremum_distance(zeta: float) -> float:
    """s: the extrema lie at x = 1 - s and 1 + s."""
    return math.sqrt((zeta - 2.0) / (3.0 * zeta))


def _reach(q: float, zeta: float) -> float:
    """How far q = f/Q lies between the extrema: -1 at f_min, 1 at f_max (within 2 ulp counts as on the extremum)."""
    s = _extremum_distance(zeta)
    reach = (q - 2.0) / (2.0 * zeta * s * s * s)
    slack = 8.0 * _EPS * max(q, 2.0) / (2.0 * zeta * s * s * s)
    return math.copysign(1.0, reach) if abs(abs(reach) - 1.0) <= slack else reach


def root(q: float, zeta: float, region: str) -> float:
    """Root x on a region of zeta x^3 - 3 zeta x^2 + 2 (1 + zeta) x = q (eq. 12-13); extremum where there is none.

    With x = 1 + y the cubic has no square term: y^3 - 3 s^2 y = (q - 2)/zeta; y = 2 s cos(t) turns it into
    cos(3 t) = reach, a form without complex numbers; beyond the extrema the cosine becomes hyperbolic.
    """
    s = _extremum_distance(zeta)
    c = (q - 2.0) / (2.0 * zeta * s * s * s)
    if region == "I":
        y = (
            -2.0 * s * math.cosh(math.acosh(-c) / 3.0)
            if c < -1.0
            else 2.0 * s * math.cos((math.acos(min(c, 1.0)) + 2.0 * math.pi) / 3.0)
        )
        return _polish(1.0 + y, q, zeta, -math.inf, 1.0 - s)
    if region == "III":
        y = 2.0 * s * math.cosh(math.acosh(c) / 3.0) if c > 1.0 else 2.0 * s * math.cos(math.acos(max(c, -1.0)) / 3.0)
        return _polish(1.0 + y, q, zeta, 1.0 + s, math.inf)
    y = 2.0 * s * math.cos((math.acos(min(max(c, -1.0), 1.0)) + 4.0 * math.pi) / 3.0)
    return _polish(1.0 + y, q, zeta, 1.0 - s, 1.0 + s)


def _polish(x: float, q: float, zeta: float, low: float, high: float) -> float:
    """Newton steps on the residual of eq. 11 in x, kept in [low, high], while it falls and is not round-off."""
    a = 2.0 * (1.0 + zeta)
    x = low if x < low else high if x > high else x
    residual = x * (a + zeta * x * (x - 3.0)) - q
    for _ in range(4):
        slope = a + 3.0 * zeta * x * (x - 2.0)
        if abs(residual) <= 2.0 * _EPS * q or slope == 0.0:
            break
        trial = x - residual / slope
        trial = low if trial < low else high if trial > high else trial
        remaining = trial * (a + zeta * trial * (trial - 3.0)) - q
        if abs(remaining) >= abs(residual):
            break
        x, residual = trial, remaining
    return x


# --------------------------------------------------------------------------------------------------- pieces of a series


class _Piece(NamedTuple):
    """One piece of f(xi).  The leading beam's x = u/h is its parameter: f = f_lead(x), xi(x) increases.

    lead: index of the leading beam: the one that snaps, the next one to snap, or at last the one that reaches 2h last;
    start, end: x of the leading beam at the ends; xi_start, xi_end: m; snap: whether the leading beam snaps here;
    followers: (beam, region) of the beams that move with the leading beam's force; held: m, sum of the others' u;
    held_u: (beam, u) of those others; snapped: beams past their maximum inside the piece; guess: see `_first_guess`.
    """

    lead: int
    start: float
    end: float
    xi_start: float
    xi_end: float
    snap: bool
    followers: tuple[tuple[int, str], ...]
    held: float
    held_u: tuple[tuple[int, float], ...]
    snapped: int
    guess: tuple = ()


class Curve(NamedTuple):
    """The series law of an NSH, worked out once: its pieces, breakpoints (m) and end force (N)."""

    nsh: NSH
    pieces: tuple[_Piece, ...]
    breakpoints: tuple[float, ...]
    end_force: float


def check(nsh: NSH) -> None:
    """Raise InputError unless the NSH has at least one beam and every beam is metastable (2 < zeta < 8, Q, h > 0)."""
    counts = {name: len(getattr(nsh, name)) for name in ("Q", "zeta", "h")}
    if len(set(counts.values())) != 1 or counts["Q"] < 1:
        raise InputError(
            f"nsh: Q, zeta and h have {counts['Q']}, {counts['zeta']}, {counts['h']} values; "
            "give one value of each per beam, and at least one beam"
        )
    for name in ("Q", "h"):
        for i, value in enumerate(getattr(nsh, name), 1):
            low, high = BEAM_RANGES[name]
            if not low <= value <= high:
                raise InputError(f"nsh.{name}[{i}] = {value!r}: must be positive and finite, from {low:g} to {high:g}")
    for i, zeta in enumerate(nsh.zeta, 1):
        if not 2.0 < zeta < 8.0:
            kind = "bistable" if zeta >= 8.0 else "monotone"
            raise InputError(
                f"nsh.zeta[{i}] = {zeta!r}: the beam is {kind if zeta == zeta else 'undefined'}; "
                "a string needs metastable beams: choose 2 < zeta < 8"
            )


@lru_cache(maxsize=256)
def curve(nsh: NSH) -> Curve:
    """The pieces of the single valued series law.  Raises InputError for an NSH that `check` refuses."""
    check(nsh)
    f_max = [beam_extrema(*beam).f_max for beam in zip(nsh.Q, nsh.zeta, nsh.h)]
    f_stop = [4.0 * Q for Q in nsh.Q]  # force at which a beam on III reaches 2h
    end_force = max(f_stop)

    ends, done, left = _Ends(nsh), [], list(range(len(nsh.Q)))
    while left:
        lead = min(left, key=lambda i: f_max[i])
        tied = [i for i in left if f_max[i] <= f_max[lead] * (1.0 + TIE)]
        ends.rise(lead, "I", f_max[lead], 1.0 - _extremum_distance(nsh.zeta[lead]), done, left, f_stop, tied)
        for beam in tied:  # the lowest index first
            done.append(beam)
            ends.snap(beam, 1.0 + 2.0 * _extremum_distance(nsh.zeta[beam]), len(done))
        left = [i for i in left if i not in tied]
    last = max(done, key=lambda i: f_stop[i])
    ends.rise(last, "III", end_force, 2.0, done, [], f_stop, [])
    pieces = tuple(_with_guess(nsh, piece) for piece in ends.pieces)
    return Curve(nsh, pieces, (0.0, *tuple(p.xi_end for p in pieces)), end_force)


class _Ends:
    """Builds the pieces one after the other; keeps every beam's u (m) and the force (N) at the end reached so far."""

    def __init__(self, nsh: NSH):
        self.nsh = nsh
        self.pieces: list[_Piece] = []
        self.u = [0.0] * len(nsh.Q)
        self.force = 0.0

    def rise(
        self,
        lead: int,
        region: str,
        f_end: float,
        x_end: float,
        done: list[int],
        left: list[int],
        f_stop: list[float],
        tied: list[int],
    ) -> None:
        """Add the rise to f_end, in parts that end where snapped beams (of `done`) reach 2h; `tied` beams end at u_max."""
        kinks, h = [], self.nsh.h
        for f in sorted(f_stop[i] for i in done):
            if (kinks[-1] if kinks else self.force) * (1.0 + TIE) < f and f * (1.0 + TIE) < f_end:
                kinks.append(f)
        for f in [*kinks, f_end]:
            moving = [(i, "III") for i in done if f_stop[i] > self.force * (1.0 + TIE)] + [(i, "I") for i in left]
            u = list(self.u)
            x = x_end if f == f_end else root(f / self.nsh.Q[lead], self.nsh.zeta[lead], region)
            for i, where in moving:
                if where == "III" and f_stop[i] <= f * (1.0 + TIE):
                    u[i] = 2.0 * h[i]
                elif f == f_end and i in tied:
                    u[i] = h[i] * (1.0 - _extremum_distance(self.nsh.zeta[i]))
                else:
                    u[i] = h[i] * self._follow(lead, x, i, where, f, region)
            u[lead] = h[lead] * x
            self._add(lead, x, u, False, [(i, w) for i, w in moving if i != lead], len(done))
            self.force = f

    def snap(self, beam: int, x_end: float, snapped: int) -> None:
        """Add the snap of a beam; its force at both ends is its f_max."""
        u = list(self.u)
        u[beam] = self.nsh.h[beam] * x_end
        self._add(beam, x_end, u, True, [], snapped)

    def _follow(self, lead: int, x: float, i: int, where: str, f: float, region: str) -> float:
        return x if where == region and _alike(self.nsh, i, lead) else root(f / self.nsh.Q[i], self.nsh.zeta[i], where)

    def _add(self, lead: int, x_end: float, u: list[float], snap: bool, followers: list, snapped: int) -> None:
        moving = {lead, *(i for i, _ in followers)}
        held_u = tuple((i, u[i]) for i in range(len(u)) if i not in moving)
        xi_start = self.pieces[-1].xi_end if self.pieces else 0.0
        xi_end = math.fsum(u)
        if xi_end > xi_start:
            x_start = self.u[lead] / self.nsh.h[lead]
            self.pieces.append(
                _Piece(
                    lead,
                    x_start,
                    x_end,
                    xi_start,
                    xi_end,
                    snap,
                    tuple(followers),
                    math.fsum(v for _, v in held_u),
                    held_u,
                    snapped,
                )
            )
        self.u = u


def _alike(nsh: NSH, i: int, j: int) -> bool:
    """Whether two beams stand at one x under one force, in any region, but for round-off."""
    return nsh.zeta[i] == nsh.zeta[j] and abs(nsh.Q[i] - nsh.Q[j]) <= TIE * nsh.Q[j]


def _displacements(nsh: NSH, piece: _Piece, x: float) -> list[float]:
    """Every beam's u, m, where the leading beam of the piece stands at x."""
    Q, zeta, h = nsh.Q, nsh.zeta, nsh.h
    lead = piece.lead
    u = [0.0] * len(Q)
    for i, value in piece.held_u:
        u[i] = value
    q = x * (2.0 * (1.0 + zeta[lead]) + zeta[lead] * x * (x - 3.0))
    for i, region in piece.followers:
        u[i] = h[i] * _follower(nsh, piece, x, q, i, region)
    u[lead] = h[lead] * x
    return u


def _follower(nsh: NSH, piece: _Piece, x: float, q: float, i: int, region: str) -> float:
    """x of beam i that carries the leading beam's force Q_lead q.  A beam of the same kind simply moves alike, which
    keeps all digits where both reach f_max together."""
    lead = piece.lead
    if (region == "I") == (piece.end <= 1.0) and _alike(nsh, i, lead):
        return x
    return min(root(q * nsh.Q[lead] / nsh.Q[i], nsh.zeta[i], region), 2.0)


def _shares(nsh: NSH, piece: _Piece, u: list[float]) -> list[float]:
    """du_i/dxi of every beam: 1 for a snapping beam; in a rise by compliance, written so that f' = 0 is harmless."""
    slope = [beam_stiffness(nsh.Q[i], nsh.zeta[i], nsh.h[i], u[i]) for i in range(len(u))]
    ratio = [0.0] * len(u)
    ratio[piece.lead] = 1.0
    for i, _ in piece.followers:
        # Both slopes vanish together where equal beams reach f_max: they share in proportion to h.
        ratio[i] = slope[piece.lead] / slope[i] if slope[i] > 0.0 else nsh.h[i] / nsh.h[piece.lead]
    total = math.fsum(ratio)
    return [r / total for r in ratio]


def _solve(nsh: NSH, piece: _Piece, xi: float) -> float:
    """x of the leading beam at elongation xi (m) inside the piece: Newton on sum u_i = xi, bracketed by its ends.

    Every step is a Newton step inside the bracket or halves it, so the result does not depend on the first guess.
    """
    lead = piece.lead
    Q, zeta, h = nsh.Q[lead], nsh.zeta[lead], nsh.h[lead]
    if xi >= piece.xi_end:
        return piece.end
    if piece.snap:
        return (xi - piece.held) / h
    low, high = piece.start, piece.end
    if not piece.followers:
        return min(max((xi - piece.held) / h, low), high)
    x = _first_guess(piece, xi)
    for _ in range(200):
        q = x * (2.0 * (1.0 + zeta) + zeta * x * (x - 3.0))
        slope = Q / h * (2.0 * (1.0 + zeta) + 3.0 * zeta * x * (x - 2.0))
        total, growth = piece.held + h * x, 1.0  # sum of u; its derivative by the leading beam's u
        for i, region in piece.followers:
            x_i = _follower(nsh, piece, x, q, i, region)
            total += nsh.h[i] * x_i
            slope_i = nsh.Q[i] / nsh.h[i] * (2.0 * (1.0 + nsh.zeta[i]) + 3.0 * nsh.zeta[i] * x_i * (x_i - 2.0))
            growth += slope / slope_i if slope_i > 0.0 else nsh.h[i] / h
        gap = total - xi
        if gap > 0.0:
            high = x
        else:
            low = x
        step = gap / (growth * h)
        if abs(gap) <= 2.0 * _EPS * xi or high - low <= _EPS * high:
            break
        newton = x - step
        if abs(step) <= 1e-12 * x:  # the next step would be below round-off
            return min(max(newton, piece.start), piece.end)
        x = newton if low < newton < high else 0.5 * (low + high)
    return x


def _first_guess(piece: _Piece, xi: float) -> float:
    """x at elongation xi by cubic interpolation: it saves Newton steps and decides nothing."""
    at, x, slope = piece.guess
    i = min(max(bisect_left(at, xi), 1), len(at) - 1)
    width = at[i] - at[i - 1]
    s = (xi - at[i - 1]) / width if width > 0.0 else 0.0
    rise = x[i] - x[i - 1]
    a, b = slope[i - 1] * width - rise, rise - slope[i] * width
    return min(max(x[i - 1] + s * rise + s * (1.0 - s) * (a * (1.0 - s) + b * s), piece.start), piece.end)


def _with_guess(nsh: NSH, piece: _Piece) -> _Piece:
    """The piece with points (xi, x, dx/dxi) for `_first_guess`, if it needs any."""
    if not piece.followers:
        return piece
    points = []
    for x in np.linspace(piece.start, piece.end, 33).tolist():
        u = _displacements(nsh, piece, x)
        points.append((math.fsum(u), x, _shares(nsh, piece, u)[piece.lead] / nsh.h[piece.lead]))
    return piece._replace(guess=tuple(zip(*points)))


# ------------------------------------------------------------------------------------------------------ series: public


def breakpoints(nsh: NSH) -> np.ndarray:
    """(P+1,) m: elongations at the ends of the pieces, strictly increasing from 0 to the sum of 2h."""
    return np.array(curve(nsh).breakpoints)


def piece_of(nsh: NSH, xi: float) -> int:
    """Number of the piece that holds the elongation xi (m): 0 slack, 1..P, P+1 bottomed out.  xi must be a number."""
    return bisect_left(curve(nsh).breakpoints, xi)


def force(nsh: NSH, xi, k: float):
    """Force at elongation xi (m, float or array), N.  k: stiffness once bottomed out, N/m."""
    k = float(k)

    def value(c, number, x):
        lead = c.pieces[number - 1].lead
        return beam_force(nsh.Q[lead], nsh.zeta[lead], 1.0, x)

    return _evaluate(nsh, xi, lambda c, e: 0.0, value, lambda c, e: c.end_force + k * (e - c.breakpoints[-1]))


def stiffness(nsh: NSH, xi, k: float):
    """df/dxi at elongation xi (m, float or array), N/m; at a breakpoint the derivative of the piece that ends there."""
    k = float(k)

    def value(c, number, x):
        return _derivatives(nsh, c.pieces[number - 1], x)[0]

    return _evaluate(nsh, xi, lambda c, e: 0.0, value, lambda c, e: k)


def energy(nsh: NSH, xi, k: float):
    """Energy stored at elongation xi (m, float or array), J: the sum over the beams, plus the string's own beyond."""
    k = float(k)

    def stored(u):
        return math.fsum(beam_energy(nsh.Q[i], nsh.zeta[i], nsh.h[i], u[i]) for i in range(len(u)))

    def beyond(c, e):
        x = e - c.breakpoints[-1]
        return stored([2.0 * h for h in nsh.h]) + x * (c.end_force + 0.5 * k * x)

    return _evaluate(nsh, xi, lambda c, e: 0.0, lambda c, p, x: stored(_displacements(nsh, c.pieces[p - 1], x)), beyond)


def snapped(nsh: NSH, xi) -> int | np.ndarray:
    """Number of beams past their force maximum at elongation xi (m, float or array)."""
    count = _evaluate(nsh, xi, lambda c, e: 0, lambda c, p, x: c.pieces[p - 1].snapped, lambda c, e: len(nsh.Q))
    return int(count) if np.ndim(xi) == 0 else count.astype(int)


def snapped_on_piece(nsh: NSH, number: int) -> int:
    """Number of beams past their force maximum on a piece (0 slack, 1..P, P+1 bottomed out)."""
    c = curve(nsh)
    if number == 0:
        return 0
    return c.pieces[number - 1].snapped if number <= len(c.pieces) else len(nsh.Q)


def displacements(nsh: NSH, xi: float) -> np.ndarray:
    """(n,) m: every beam's displacement at elongation xi (m)."""
    xi = float(xi)
    c, number = curve(nsh), piece_of(nsh, xi)
    if number == 0:
        return np.zeros(len(nsh.Q))
    if number > len(c.pieces):
        return 2.0 * np.array(nsh.h)
    piece = c.pieces[number - 1]
    return np.array(_displacements(nsh, piece, _solve(nsh, piece, xi)))


def elongation(nsh: NSH, force: float, k: float | None = None) -> float:
    """Smallest elongation at which the NSH carries the force (N), m: on the first rise that reaches it.

    Raises InputError for a negative force, and for one above the end force max(4 Q) unless k (N/m), the stiffness once
    bottomed out, is given.
    """
    c, force = curve(nsh), float(force)
    if not (math.isfinite(force) and force >= 0.0):
        raise InputError(f"force = {force!r} N: an NSH carries no such force; use a finite force >= 0")
    if force > c.end_force:
        if k is None:
            raise InputError(
                f"force = {force!r} N: the NSH has bottomed out at {c.end_force!r} N; "
                "use a smaller force, or give the stiffness k beyond"
            )
        return c.breakpoints[-1] + (force - c.end_force) / float(k)
    for piece in c.pieces:
        Q, zeta = nsh.Q[piece.lead], nsh.zeta[piece.lead]
        if not piece.snap and beam_force(Q, zeta, 1.0, piece.end) >= force:
            x = root(force / Q, zeta, "I" if piece.end <= 1.0 else "III")
            x = min(max(x, piece.start), piece.end)
            return min(max(math.fsum(_displacements(nsh, piece, x)), piece.xi_start), piece.xi_end)
    return c.breakpoints[-1]  # the end force itself, missed above by round-off


def force_on_piece(nsh: NSH, number: int, xi: float, k: float) -> float:
    """Force of one piece's own formula, N, smooth at every xi (m): what an integrator needs that looks past the end.

    Inside the piece (0 slack, 1..P, P+1 bottomed out) it equals `force`.  Outside, a snap goes on along its cubic and a
    rise along its second order Taylor polynomial at the end that was passed.
    """
    c = curve(nsh)
    if number == 0:
        return 0.0
    if number > len(c.pieces):
        return c.end_force + k * (xi - c.breakpoints[-1])
    piece = c.pieces[number - 1]
    Q, zeta = nsh.Q[piece.lead], nsh.zeta[piece.lead]
    if piece.snap or piece.xi_start <= xi <= piece.xi_end:
        x = (xi - piece.held) / nsh.h[piece.lead] if piece.snap else _solve(nsh, piece, xi)
        return beam_force(Q, zeta, 1.0, x)
    x, at = (piece.end, piece.xi_end) if xi > piece.xi_end else (piece.start, piece.xi_start)
    slope, curvature = _derivatives(nsh, piece, x)
    return beam_force(Q, zeta, 1.0, x) + (xi - at) * (slope + 0.5 * curvature * (xi - at))


#: Degree of the polynomials of `piece_force`, their error relative to the end force, and the most panels per piece.
DEGREE, TABLE_ERROR, MAX_PANELS = 9, 1e-13, 512


@lru_cache(maxsize=4096)
def piece_force(nsh: NSH, number: int, k: float):
    """`force_on_piece` of one piece as a function xi (m) -> N, to within TABLE_ERROR of the end force, at a tenth of the cost.

    The article (Algorithm 1) tabulates the curve too.  Here each rise is cut into equal panels, with the Chebyshev
    interpolant of the exact force on each; what needs no table, or lies outside the piece, is exact.
    """
    c = curve(nsh)
    exact = partial(force_on_piece, nsh, number, k=k)
    if number == 0:
        return lambda xi: 0.0
    if number > len(c.pieces):
        return lambda xi: c.end_force + k * (xi - c.breakpoints[-1])
    piece = c.pieces[number - 1]
    Q, zeta, h = nsh.Q[piece.lead], nsh.zeta[piece.lead], nsh.h[piece.lead]
    if piece.snap:
        return lambda xi: beam_force(Q, zeta, h, xi - piece.held)
    start, end, rows = piece.xi_start, piece.xi_end, _panels(nsh, number)
    scale = len(rows) / (end - start)

    def tabulated(xi: float) -> float:
        if not start <= xi <= end:
            return exact(xi)
        place = (xi - start) * scale
        row = min(int(place), len(rows) - 1)
        t, force = 2.0 * (place - row) - 1.0, 0.0
        for coefficient in rows[row]:
            force = force * t + coefficient
        return force

    return tabulated


@cache
def _panels(nsh: NSH, number: int) -> tuple[tuple[float, ...], ...]:
    """Polynomials in t = -1..1, highest power first, on equal panels of a rise: as many as TABLE_ERROR asks for."""
    piece, largest = curve(nsh).pieces[number - 1], curve(nsh).end_force
    count = 4
    while True:
        ends = np.linspace(piece.xi_start, piece.xi_end, count + 1)
        rows, error = [], 0.0
        for start, end in pairwise(ends):

            def exact(t, start=start, end=end):
                return np.array([force_on_piece(nsh, number, x, 0.0) for x in start + 0.5 * (end - start) * (t + 1.0)])

            fit = chebyshev.chebinterpolate(exact, DEGREE)
            between = np.array([-0.9, -0.35, 0.1, 0.6])
            error = max(error, float(np.abs(chebyshev.chebval(between, fit) - exact(between)).max()))
            rows.append(tuple(chebyshev.cheb2poly(fit)[::-1].tolist()))
        if error <= TABLE_ERROR * largest or count >= MAX_PANELS:
            return tuple(rows)
        count *= 2


def _derivatives(nsh: NSH, piece: _Piece, x: float) -> tuple[float, float]:
    """First and second derivative of f by xi in a piece, N/m and N/m2, with w_i = du_i/dxi:
    f' = w_lead f'_lead and f'' = sum w_i^3 f''_i."""
    u = _displacements(nsh, piece, x)
    w = _shares(nsh, piece, u)
    lead = piece.lead
    slope = w[lead] * beam_stiffness(nsh.Q[lead], nsh.zeta[lead], nsh.h[lead], u[lead])
    second = [6.0 * nsh.Q[i] * nsh.zeta[i] / nsh.h[i] ** 2 * (u[i] / nsh.h[i] - 1.0) for i in range(len(u))]
    return slope, math.fsum(w[i] ** 3 * second[i] for i in range(len(u)))


def _evaluate(nsh: NSH, xi, slack, inside, beyond):
    """Apply slack(curve, xi), inside(curve, piece number, x of its leading beam) or beyond(curve, xi), elementwise."""
    c = curve(nsh)

    def one(e: float):
        if e != e:
            return e
        number = bisect_left(c.breakpoints, e)
        if number == 0:
            return slack(c, e)
        if number > len(c.pieces):
            return beyond(c, e)
        return inside(c, number, _solve(nsh, c.pieces[number - 1], e))

    if np.ndim(xi) == 0:
        return one(float(xi))
    xi = np.asarray(xi, dtype=float)
    return np.array([one(e) for e in xi.ravel().tolist()]).reshape(xi.shape)
