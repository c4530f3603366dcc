"""Exact force laws of elements without memory, eq. 9: any tree of `elements` as force over elongation.

A law is a chain of smooth pieces: piece 0 is slack (x <= 0), piece p of 1..P has breakpoints[p-1] < x <= breakpoints[p]; a law
that ends at a stop has a piece P+1 in which the string's own stiffness k takes over, continuous in force.

* Spring, Polynomial, Table: as `elements` says; a piece of a polynomial ends where the force falls for the first time, of a
  table at its points, but for the last point of a linear one.
* Beam: two pieces, one up to the force maximum (one at all, if zeta <= 2), then a stop.
* Parallel: forces add up; a stop of one part stops all.
* Series: Algorithm 1 of the article for parts of any kind.  All parts bear one force on rising stretches; the one whose stretch
  ends lowest (ties: lowest index) snaps along its own curve until it bears that force again, the others held.

`nsh` has the same law for beams in series, faster and for metastable beams only.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import lru_cache

import numpy as np
import scipy

from . import nsh as honeycomb
from .curves import TIE, BeamCurve, HeldCurve, PolynomialCurve, RiseCurve, Stretch, SumCurve, monotone, rise, stretch
from .elements import BEAM_RANGES, Beam, Damper, Element, Parallel, Polynomial, Series, Spring, Table
from .errors import InputError
from .quantities import number

#: A force this far below 0, as part of the largest force nearby, is round-off.
ROUND_OFF = 1e-12


class Law:
    """The law of an element.  Make one with `law`.

    pieces: smooth, in order, each as far as one curve and one number of snapped parts go; stretches: cut where the force turns;
    breakpoints: (P+1,) m, ends of the pieces;
    end: elongation at which a stop ends it, m, or inf; end_force: N there.
    """

    def __init__(self, pieces: list[Stretch], stretches: list[Stretch]):
        self.pieces, self.stretches = _merged(pieces), tuple(stretches)
        self.breakpoints = (0.0, *(piece.end for piece in self.pieces if piece.end < math.inf))
        self.end, self.end_force = pieces[-1].end, pieces[-1].last

    def piece_of(self, x: float) -> int:
        """Number of the piece that holds the elongation x (m)."""
        return bisect_left(self.breakpoints, x)

    def force(self, x: float, k: float = 0.0) -> float:
        """Force at elongation x (m), N.  k: stiffness beyond the end, N/m."""
        x = number("x", x)
        return self._value(self.piece_of(x), x, number("k", k))[0]

    def force_on_piece(self, piece: int, x: float, k: float = 0.0) -> float:
        """Force of one piece's own formula, N, smooth at every x (m): inside the piece it equals `force`."""
        return self._value(piece, float(x), float(k))[0]

    def stiffness(self, x: float, k: float = 0.0) -> float:
        """df/dx at elongation x (m), N/m; at a breakpoint that of the piece that ends there."""
        x = number("x", x)
        return self._value(self.piece_of(x), x, number("k", k))[1]

    def energy(self, x: float, k: float = 0.0) -> float:
        """Energy stored at elongation x (m), J."""
        x, k = number("x", x), number("k", k)
        piece = self.piece_of(x)
        if piece == 0:
            return 0.0
        if piece <= len(self.pieces):
            return self.pieces[piece - 1].curve.energy(x)
        past = x - self.end
        return self.pieces[-1].curve.energy(self.end) + past * (self.end_force + 0.5 * k * past)

    def snapped_on_piece(self, piece: int) -> int:
        """Beams, polynomials and tables past their force maximum on a piece."""
        return self.pieces[min(piece, len(self.pieces)) - 1].snapped if piece else 0

    def elongation(self, force: float, k: float | None = None) -> float:
        """Smallest elongation at which the law bears the force (N), m.

        Raises InputError for a negative force, and for one that the law never bears; beyond a stop k (N/m) is needed.
        """
        force = number("force", force)
        if not (math.isfinite(force) and force >= 0.0):
            raise InputError(f"force = {force!r} N: a string bears no such force; use a finite force >= 0")
        if force == 0.0:
            return 0.0
        for one in self.stretches:
            if one.sign > 0 and one.first <= force <= one.last:
                return one.inverse(force)
        if self.end == math.inf:
            largest = max(one.last for one in self.stretches)
            raise InputError(f"force = {force!r} N: the law bears no more than {largest!r} N; use a smaller force")
        if force <= self.end_force:    # missed above by round-off
            return self.end
        if k is None:
            raise InputError(f"force = {force!r} N: the law ends at {self.end_force!r} N; "
                             "use a smaller force, or give the stiffness k beyond")
        return self.end + (force - self.end_force) / k

    def _value(self, piece: int, x: float, k: float) -> tuple[float, float, float]:
        if piece == 0:
            return 0.0, 0.0, 0.0
        if piece > len(self.pieces):
            return self.end_force + k * (x - self.end), k, 0.0
        return self.pieces[piece - 1].curve.value(x)


def _merged(pieces: list[Stretch]) -> tuple[Stretch, ...]:
    """Pieces of one curve as one piece."""
    found: list[Stretch] = []
    for one in pieces:
        if found and one.joined and one.snapped == found[-1].snapped:
            before = found.pop()
            one = Stretch(one.curve, before.start, one.end, before.first, one.last, one.snapped, before.joined)
        found.append(one)
    return tuple(found)


@lru_cache(maxsize=256)
def law(element: Element) -> Law:
    """The law of an element without memory.

    Raises InputError where a parameter is out of range, where the force would fall below 0, or for a series in which a part
    that snaps never bears the force again.
    """
    made = part_law(element)
    _require_tension(made, type(element).__name__.lower())
    return made


@lru_cache(maxsize=256)
def part_law(element: Element) -> Law:
    """The law of a part: the same, but its force may fall below 0 (a bistable beam), which others may make up for."""
    if isinstance(element, Series) and element.law != "single_valued":
        raise InputError(f"law = {element.law!r}: a series with memory is the outermost element of a string, not a part; "
                         "use 'single_valued'")
    return _MAKERS[type(element)](element)


def _require_tension(made: Law, name: str) -> None:
    largest = max((one.last for one in made.stretches if one.last < math.inf), default=1.0)
    for one in made.stretches:
        low, at = (one.last, one.end) if one.sign < 0 else (one.first, one.start)
        if low < -ROUND_OFF * max(largest, 0.0):
            raise InputError(f"{name}: the force falls to {low!r} N at an elongation of {at!r} m, but a string bears no "
                             "compression; keep the force at 0 or above, or use a series with memory (law = 'hysteretic')")


def _positive(kind: str, **values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{kind}.{name} = {value!r}: must be positive and finite")


def _leaf(stretches: list[Stretch], pieces: list[Stretch] | None = None) -> Law:
    """A law that counts as snapped from its first falling stretch on."""
    falls = next((i for i, one in enumerate(stretches) if one.sign < 0), None)
    if falls is None:
        return Law(stretches, stretches)
    counted = [Stretch(s.curve, s.start, s.end, s.first, s.last, int(i >= falls), s.joined) for i, s in enumerate(stretches)]
    return Law(counted, counted)


def _spring(spring: Spring) -> Law:
    _positive("spring", k=spring.k)
    return _leaf([stretch(PolynomialCurve(0.0, (0.0, spring.k), 0.0), 0.0, math.inf)])


def _beam(beam: Beam) -> Law:
    for name, (low, high) in BEAM_RANGES.items():
        if not low <= getattr(beam, name) <= high:
            raise InputError(f"beam.{name} = {getattr(beam, name)!r}: must be positive and finite, from {low:g} to {high:g}")
    curve, ends = BeamCurve(beam.Q, beam.zeta, beam.h), [0.0, 2.0 * beam.h]
    if beam.zeta > 2.0:
        extrema = honeycomb.beam_extrema(*curve)
        # beyond zeta = 14 the minimum still lies below 2h: s < 1/sqrt(3)
        ends[1:1] = [extrema.u_max, extrema.u_min]
    return _leaf([stretch(curve, a, b, joined=a > 0.0) for a, b in zip(ends, ends[1:])])


def _polynomial(element: Polynomial) -> Law:
    _check_coefficients("polynomial", element.coefficients)
    curve = PolynomialCurve(0.0, (0.0, *element.coefficients), 0.0)
    made = _leaf(monotone(curve, 0.0, math.inf))
    if made.stretches[0].sign < 0 or made.stretches[-1].sign < 0:
        where = "at first" if made.stretches[0].sign < 0 else "in the end"
        raise InputError(f"polynomial.coefficients = {element.coefficients!r}: the force falls {where}; "
                         "let the first and the last coefficient that is not 0 be positive")
    return made


def _check_coefficients(kind: str, coefficients: tuple[float, ...]) -> None:
    if not 1 <= len(coefficients) <= 7:
        raise InputError(f"{kind}.coefficients has {len(coefficients)} values; give 1 to 7")
    for i, value in enumerate(coefficients, 1):
        if not math.isfinite(value):
            raise InputError(f"{kind}.coefficients[{i}] = {value!r}: must be finite")
    if not any(coefficients):
        raise InputError(f"{kind}.coefficients = {coefficients!r}: are all 0; make one of them positive")


def _table(table: Table) -> Law:
    made = _leaf([stretch(curve, a, b) for curve, a, b in _table_curves(table)])
    if made.stretches[0].sign < 0 or made.stretches[-1].sign < 0:
        where = "at first" if made.stretches[0].sign < 0 else "beyond the last point, along the last slope"
        raise InputError(f"table.f = {table.f!r}: the force falls {where}; add points between which it rises")
    return made


def _table_curves(table: Table) -> list[tuple[PolynomialCurve, float, float]]:
    """(curve, start, end) of each interval and of what follows the last point."""
    x, f = table.x, table.f
    if len(x) != len(f) or len(x) < 2:
        raise InputError(f"table: x has {len(x)} points and f {len(f)}; give as many of both, at least two")
    if not (np.isfinite(x).all() and np.isfinite(f).all()):
        raise InputError(f"table: x = {x!r}, f = {f!r}: must be finite")
    if x[0] != 0.0 or f[0] != 0.0 or not (np.diff(x) > 0.0).all():
        raise InputError(f"table: x = {x!r}, f[0] = {f[0]!r}: let x increase from 0, with f[0] = 0")
    if table.interpolation == "cubic":
        rows = scipy.interpolate.PchipInterpolator(x, f).c[::-1].T
    elif table.interpolation == "linear":
        rows = np.column_stack([f[:-1], np.diff(f) / np.diff(x)])
    else:
        raise InputError(f"table.interpolation = {table.interpolation!r}: use 'linear' or 'cubic'")
    found, base = [], 0.0
    for (_, *slopes), a, b, value in zip(rows.tolist(), x, x[1:], f):
        curve = PolynomialCurve(a, (value, *slopes), base)
        found.append((curve, a, b))
        base = curve.energy(b)
    curve, a, b = found[-1]
    if len(rows[0]) == 2 or len(x) == 2:    # straight already
        return [*found[:-1], (curve, a, math.inf)]
    return [*found, (PolynomialCurve(b, (f[-1], curve.value(b)[1]), base), b, math.inf)]


def _parallel(element: Parallel) -> Law:
    parts = _parts("parallel", element.parts)
    end = min(part.end for part in parts)
    ends = sorted({e for part in parts for e in (0.0, end, *part.breakpoints) if e <= end})
    if end == math.inf and ends[-1] < math.inf:
        ends.append(end)
    pieces, stretches, before = [], [], None
    for a, b in zip(ends, ends[1:]):
        inside = [part.pieces[part.piece_of(0.5 * (a + b) if b < math.inf else a + 1.0) - 1] for part in parts]
        curve, snapped = SumCurve(tuple(one.curve for one in inside)), sum(one.snapped for one in inside)
        pieces.append(stretch(curve, a, b, snapped, curve == before))
        stretches += monotone(curve, a, b, snapped, curve == before)
        before = curve
    return Law(pieces, stretches)


def _parts(kind: str, parts: tuple[Element, ...]) -> list[Law]:
    if not parts:
        raise InputError(f"{kind}.parts is empty; give at least one part")
    return [part_law(part) for part in parts]


def _series(element: Series) -> Law:
    parts = _parts("series", element.parts)
    for part, made in zip(element.parts, parts):
        _require_tension(made, f"a part ({type(part).__name__.lower()}) of a series without memory")
    return _Snaps(parts).law()


class _Snaps:
    """Algorithm 1: builds a series piece by piece.  u: m, of every part; at: the stretch that it is on; force: N."""

    def __init__(self, parts: list[Law]):
        self.parts = parts
        self.u = [0.0] * len(parts)
        self.at = [0] * len(parts)
        self.force = 0.0
        self.x = 0.0
        self.pieces: list[Stretch] = []
        self.stretches: list[Stretch] = []

    def law(self) -> Law:
        for i, part in enumerate(self.parts):
            if part.stretches[0].sign <= 0:
                self._snap(i)
        while moving := [i for i in range(len(self.parts)) if self.at[i] < len(self.parts[i].stretches)]:
            force = min(self._stretch(i).last for i in moving)
            if force > self.force * (1.0 + TIE) or self.force == 0.0:    # else a tie: the next part is at its end already
                self._rise(moving, force)
            if force == math.inf:
                break
            ending = [i for i in moving if self._stretch(i).last <= self.force * (1.0 + TIE)]
            due = [i for i in ending if self._moves_on(i)]
            if due:    # one at a time: it may come to another maximum that ties, and has the lowest index again
                self._snap(due[0])
        return Law(self.pieces, self.stretches)

    def _stretch(self, i: int) -> Stretch:
        return self.parts[i].stretches[self.at[i]]

    def _moves_on(self, i: int) -> bool:
        """Part i, at the end of its stretch, goes on to the next one or to its stop unless it has to snap; whether it has."""
        stretches, after = self.parts[i].stretches, self.at[i] + 1
        if after < len(stretches) and stretches[after].sign <= 0:
            return True
        self.at[i] = after
        return False

    def _rise(self, moving: list[int], force: float) -> None:
        held = [i for i in range(len(self.parts)) if i not in moving]
        chains = rise([self._stretch(i) for i in moving], self.force, force, math.fsum(self.u[i] for i in held),
                      math.fsum(self._energy(i) for i in held))
        curve = RiseCurve(chains)
        snapped = sum(self._snapped(i) for i in range(len(self.parts)))
        self._add([Stretch(curve, self.x, curve.upper, self.force, force, snapped)])
        if force < math.inf:
            for i, u in zip(moving, curve.displacements(curve.upper)):
                self.u[i] = u
        self.force = force

    def _snap(self, i: int) -> None:
        """Part i goes along its own curve until it bears the force again on a rising stretch."""
        part, first = self.parts[i], self.at[i] + (self._stretch(i).sign > 0)
        others = [j for j in range(len(self.parts)) if j != i]
        held, base = math.fsum(self.u[j] for j in others), math.fsum(self._energy(j) for j in others)
        counted = sum(self._snapped(j) for j in others)
        last = next((n for n in range(first, len(part.stretches))
                     if part.stretches[n].sign > 0 and part.stretches[n].last >= self.force * (1.0 - TIE)), None)
        if last is None:
            raise InputError(f"series: part {i + 1} never bears its force maximum of {self.force!r} N again, so that no single "
                             "force belongs to an elongation; use law = 'hysteretic', or let its force rise that far")
        way = []
        for n in range(first, last + 1):
            one = part.stretches[n]
            start = self.u[i] if n == first else one.start
            end, force = (one.inverse(self.force, True), self.force) if n == last else (one.end, one.last)
            joined = one.joined and n > first
            curve = way[-1].curve if joined else HeldCurve(one.curve, held, base)
            way.append(Stretch(curve, held + start, held + end, one.first, force, counted + one.snapped, joined))
        self.at[i], self.u[i] = last, way[-1].end - held
        self._add([one for one in way if one.end > one.start])
        self.u[i] = part.stretches[last].inverse(self.force, True)

    def _add(self, way: list[Stretch]) -> None:
        """Add stretches, and as pieces those of one curve together."""
        if not way or way[-1].end <= self.x:
            return
        self.stretches += way
        for one in way:
            if one.joined and self.pieces and self.pieces[-1].curve is one.curve:
                before = self.pieces.pop()
                one = Stretch(one.curve, before.start, one.end, before.first, one.last, one.snapped, before.joined)
            self.pieces.append(one)
        self.x = way[-1].end

    def _energy(self, i: int) -> float:
        on = self.parts[i].stretches[min(self.at[i], len(self.parts[i].stretches) - 1)]
        return on.curve.energy(self.u[i])

    def _snapped(self, i: int) -> int:
        return self.parts[i].stretches[min(self.at[i], len(self.parts[i].stretches) - 1)].snapped


_MAKERS = {Spring: _spring, Beam: _beam, Polynomial: _polynomial, Table: _table, Parallel: _parallel, Series: _series}


# ------------------------------------------------------------------------------------------------------------- dampers

class Damping:
    """A damper's force over the rate of elongation, eq. 10; odd.  kinks: m/s, rates > 0 at which the slope jumps."""

    def __init__(self, curves: list[tuple[PolynomialCurve, float, float]], smooth: bool):
        self._curves = [curve for curve, _, _ in curves]
        self._ends = [end for _, _, end in curves[:-1]]
        self.kinks = () if smooth else tuple(end for end in self._ends if end < math.inf)

    def force(self, rate: float) -> float:
        """N at a rate (m/s)."""
        rate = number("rate", rate)
        return math.copysign(self._at(rate)[0], rate) if rate else 0.0

    def slope(self, rate: float) -> float:
        """df/drate, N s/m."""
        return self._at(number("rate", rate))[1]

    def _at(self, rate: float) -> tuple[float, float, float]:
        size = abs(rate)
        return self._curves[bisect_left(self._ends, size)].value(size)


@lru_cache(maxsize=256)
def damping(damper: Damper) -> Damping:
    """The law of a damper.  Raises InputError where a parameter is out of range or the damper would push energy in."""
    if isinstance(damper, Polynomial):
        _check_coefficients("damper", damper.coefficients)
        curve = PolynomialCurve(0.0, (0.0, *damper.coefficients), 0.0)
        curves, stretches = [(curve, 0.0, math.inf)], monotone(curve, 0.0, math.inf)
        lowest = [(one.first, one.start) if one.sign >= 0 else (one.last, one.end) for one in stretches]
    else:
        curves = _table_curves(damper)
        falls = curves[-1][0].value(damper.x[-1])[1] < 0.0
        lowest = [*zip(damper.f, damper.x), (-math.inf if falls else 0.0, math.inf)]
    for low, at in lowest:
        if low < 0.0:
            raise InputError(f"damper: the force falls to {low!r} N at a rate of {at!r} m/s, where it would drive the string; "
                             "keep it at 0 or above for rates > 0")
    return Damping(curves, isinstance(damper, Polynomial) or damper.interpolation == "cubic")
