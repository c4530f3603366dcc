"""Exact force laws of elements without memory, eq. 9: any tree of `elements` as force over elongation.

A law is a chain of smooth pieces: piece 0 is slack (x <= 0), piece p of 1..P has breakpoints[p-1] < x <= breakpoints[p]; a law
that ends at a stop has a piece P+1 in which the string's own stiffness k takes over, continuous in force.

* Spring, Polynomial, Table: as `elements` says; a piece of a polynomial ends where the force falls for the first time, of a
  table at its points, but for the last point of a linear one.
* Beam: two pieces, one up to the force maximum (one at all, if zeta <= 2), then a stop.
* Parallel: forces add up; a stop of one part stops all.
* Series: Algorithm 1 of the article for parts of any kind.  All parts bear one force on rising pieces; the one whose piece
  ends lowest (ties: lowest index) snaps along its own curve until it bears that force again, the others held.

For a honeycomb, beams in series, that is a chain of *rises*, on which beams that have snapped are on region III (at 2h beyond
4 Q) and the others on I, and of *snaps*, one for each beam, in the order of their f_max.
"""

from __future__ import annotations

import itertools
import math
from functools import lru_cache

from ..errors import InputError
from ..model.elements import BEAM_RANGES, KINDS, Beam, Element, Parallel, Polynomial, Series, Spring, Table
from ..quantities import number
from .beam import beam_extrema
from .curves import BeamCurve, PolynomialCurve, SumCurve
from .law import Law, require_tension
from .pieces import Piece, monotone
from .series import Snaps
from .tables import check_coefficients, table_curves


def law(element: Element, k: float | None = None) -> Law:
    """The law of an element without memory.  k: N/m, the string's own stiffness, which takes over beyond a stop.

    Raises InputError where a parameter is out of range, where the force would fall below 0, or for a series in which a part
    that snaps never bears the force again.
    """
    return _string_law(element, k if k is None else number("k", k))


@lru_cache(maxsize=1024)
def _string_law(element: Element, k: float | None) -> Law:
    made = part_law(element)
    require_tension(made, type(element).__name__.lower())
    return made.beyond(k)


@lru_cache(maxsize=256)
def part_law(element: Element) -> Law:
    """The law of a part: the same, but its force may fall below 0 (a bistable beam), which others may make up for."""
    if isinstance(element, Series) and element.law != "single_valued":
        raise InputError(
            f"law = {element.law!r}: a series with memory is the outermost element of a string, not a part; use 'single_valued'"
        )
    return _MAKERS[type(element)](element)


def _positive(kind: str, **values: float) -> None:
    for name, value in values.items():
        if not (math.isfinite(value) and value > 0.0):
            raise InputError(f"{kind}.{name} = {value!r}: must be positive and finite")


def _leaf(pieces: list[Piece]) -> Law:
    """A law that counts as snapped from its first falling piece on."""
    falls = next((i for i, one in enumerate(pieces) if one.sign < 0), None)
    if falls is None:
        return Law(pieces, pieces)
    counted = [Piece(s.curve, s.start, s.end, s.first, s.last, int(i >= falls), s.joined) for i, s in enumerate(pieces)]
    return Law(counted, counted)


def _spring(spring: Spring) -> Law:
    _positive("spring", k=spring.k)
    return _leaf([Piece.of(PolynomialCurve(0.0, (0.0, spring.k), 0.0), 0.0, math.inf)])


def _beam(beam: Beam) -> Law:
    for name, (low, high) in BEAM_RANGES.items():
        if not low <= getattr(beam, name) <= high:
            raise InputError(f"beam.{name} = {getattr(beam, name)!r}: must be positive and finite, from {low:g} to {high:g}")
    curve, ends = BeamCurve(beam.Q, beam.zeta, beam.h), [0.0, 2.0 * beam.h]
    if beam.zeta > 2.0:
        extrema = beam_extrema(*curve)
        # beyond zeta = 14 the minimum still lies below 2h: s < 1/sqrt(3)
        ends[1:1] = [extrema.u_max, extrema.u_min]
    return _leaf([Piece.of(curve, a, b, joined=a > 0.0) for a, b in itertools.pairwise(ends)])


def _polynomial(element: Polynomial) -> Law:
    check_coefficients("polynomial", element.coefficients)
    curve = PolynomialCurve(0.0, (0.0, *element.coefficients), 0.0)
    made = _leaf(monotone(curve, 0.0, math.inf))
    if made.monotone[0].sign < 0 or made.monotone[-1].sign < 0:
        where = "at first" if made.monotone[0].sign < 0 else "in the end"
        raise InputError(
            f"polynomial.coefficients = {element.coefficients!r}: the force falls {where}; "
            "let the first and the last coefficient that is not 0 be positive"
        )
    return made


def _table(table: Table) -> Law:
    made = _leaf([Piece.of(curve, a, b) for curve, a, b in table_curves(table)])
    if made.monotone[0].sign < 0 or made.monotone[-1].sign < 0:
        where = "at first" if made.monotone[0].sign < 0 else "beyond the last point, along the last slope"
        raise InputError(f"table.f = {table.f!r}: the force falls {where}; add points between which it rises")
    return made


def _parallel(element: Parallel) -> Law:
    parts = _parts("parallel", element.parts)
    end = min(part.end for part in parts)
    ends = sorted({e for part in parts for e in (0.0, end, *part.breakpoints) if e <= end})
    if end == math.inf and ends[-1] < math.inf:
        ends.append(end)
    pieces, turned, before = [], [], None
    for a, b in itertools.pairwise(ends):
        inside = [part.pieces[part.piece_of(0.5 * (a + b) if b < math.inf else a + 1.0) - 1] for part in parts]
        curve, snapped = SumCurve(tuple(one.curve for one in inside)), sum(one.snapped for one in inside)
        pieces.append(Piece.of(curve, a, b, snapped, curve == before))
        turned += monotone(curve, a, b, snapped, curve == before)
        before = curve
    return Law(pieces, turned)


def _parts(kind: str, parts: tuple[Element, ...]) -> list[Law]:
    if not parts:
        raise InputError(f"{kind}.parts is empty; give at least one part")
    return [part_law(part) for part in parts]


def _series(element: Series) -> Law:
    parts = _parts("series", element.parts)
    for part, made in zip(element.parts, parts):
        require_tension(made, f"a part ({type(part).__name__.lower()}) of a series without memory")
    return Snaps(parts).law()


_MAKERS: dict = {Spring: _spring, Beam: _beam, Polynomial: _polynomial, Table: _table, Parallel: _parallel, Series: _series}
if set(_MAKERS) != set(KINDS.values()):
    raise ValueError(f"laws/elements.py makes other laws than those of the kinds {', '.join(KINDS)} of model/elements.py")
