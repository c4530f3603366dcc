"""A negative stiffness beam, eq. 11 to 14 of the article: Q force scale in N, zeta shape parameter, h arch height in m, u
displacement in m.

The force rises on region I up to f_max at u_max, falls on region II to f_min at u_min, and rises again on region III; a stop
ends it at u = 2h.  Beams with 2 < zeta < 8 are metastable: they return when unloaded.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..errors import InputError

EPS = math.ulp(1.0)


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
    slack = 8.0 * EPS * max(q, 2.0) / (2.0 * zeta * s * s * s)
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
        if abs(residual) <= 2.0 * EPS * q or slope == 0.0:
            break
        trial = x - residual / slope
        trial = low if trial < low else high if trial > high else trial
        remaining = trial * (a + zeta * trial * (trial - 3.0)) - q
        if abs(remaining) >= abs(residual):
            break
        x, residual = trial, remaining
    return x
