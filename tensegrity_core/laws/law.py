"""An exact force law without memory: force, stiffness and energy over elongation, and the inverse."""

from __future__ import annotations

import copy
import math
from bisect import bisect_left
from collections.abc import Callable
from functools import cached_property, partial

from ..errors import InputError
from ..quantities import number
from .chains import RiseCurve
from .panels import Panel, panel, panels_of
from .pieces import Piece

#: A force this far below 0, as part of the largest force nearby, is round-off.
ROUND_OFF = 1e-12


class Law:
    """The law of an element.  Make one with `law`.

    pieces: smooth, in order, each as far as one curve and one number of snapped parts go; monotone: the same, cut where the
    force turns; breakpoints: (P+1,) m, ends of the pieces; end: elongation at which a stop ends it, m, or inf; end_force: N
    there; k: N/m, the string's own stiffness, which takes over beyond a stop; None: not known, the force stays there.
    """

    def __init__(self, pieces: list[Piece], monotone: list[Piece], k: float | None = None):
        self.pieces, self.monotone, self.k = _merged(pieces), tuple(monotone), k
        self.breakpoints = (0.0, *(piece.end for piece in self.pieces if piece.end < math.inf))
        self.end, self.end_force = pieces[-1].end, pieces[-1].last
        self._panels: dict[int, tuple[Panel, ...]] = {}

    def beyond(self, k: float | None) -> Law:
        """The same law with the string's own stiffness k (N/m) beyond its stop."""
        other = copy.copy(self)
        other.k = k
        return other

    def follow(self, x: float) -> Law:
        """The law after a continuous way to the elongation x (m): itself, as it has no memory."""
        return self

    def piece_of(self, x: float) -> int:
        """Number of the piece that holds the elongation x (m)."""
        return bisect_left(self.breakpoints, x)

    def force(self, x: float) -> float:
        """Force at elongation x (m), N."""
        x = number("x", x)
        return self.value(self.piece_of(x), x)[0] if x == x else x

    def force_on_piece(self, piece: int, x: float) -> float:
        """Force of one piece's own formula, N, smooth at every x (m): inside the piece it equals `force`."""
        return self.value(piece, float(x))[0]

    def on_piece(self, piece: int) -> Callable[[float], float]:
        """`force_on_piece` of one piece, for many elongations: rises of parts in series are read from `panels`."""
        exact = partial(self.force_on_piece, piece)
        if not 0 < piece <= len(self.pieces) or not isinstance(self.pieces[piece - 1].curve, RiseCurve):
            return exact
        start, end = self.pieces[piece - 1].start, self.pieces[piece - 1].end
        if end == math.inf:
            return exact
        rows = [one.force[::-1].tolist() for one in self.panels(piece)]
        last, scale = len(rows) - 1, len(rows) / (end - start)

        def force(x: float) -> float:
            if not start <= x <= end:
                return exact(x)
            place = (x - start) * scale
            row = min(int(place), last)
            t, found = 2.0 * (place - row) - 1.0, 0.0
            for coefficient in rows[row]:
                found = found * t + coefficient
            return found

        return force

    def panels(self, piece: int) -> tuple[Panel, ...]:
        """Polynomials that make up a piece.  Raises NoPanels for one that goes on for ever and is no polynomial."""
        if piece == 0:
            return (panel(0.0, 1.0, math.inf, [0.0], [0.0], 0.0),)
        if piece > len(self.pieces):
            k = self.k or 0.0
            return (panel(self.end, 1.0, math.inf, [self.end_force, k], [k], self.energy(self.end)),)
        if piece not in self._panels:  # whatever the stiffness beyond
            largest, one = max((abs(s.last) for s in self.monotone if s.last < math.inf), default=1.0), self.pieces[piece - 1]
            self._panels[piece] = panels_of(one.curve, one.start, one.end, self.energy(one.start), self.energy, largest)
        return self._panels[piece]

    def stiffness(self, x: float) -> float:
        """df/dx at elongation x (m), N/m; at a breakpoint that of the piece that ends there."""
        x = number("x", x)
        return self.value(self.piece_of(x), x)[1]

    def energy(self, x: float) -> float:
        """Energy stored at elongation x (m), J."""
        x = number("x", x)
        piece = self.piece_of(x)
        if piece == 0:
            return 0.0
        if piece <= len(self.pieces):
            return self.pieces[piece - 1].curve.energy(x)
        past = x - self.end
        return self.pieces[-1].curve.energy(self.end) + past * (self.end_force + 0.5 * (self.k or 0.0) * past)

    def snapped_on_piece(self, piece: int) -> int:
        """Beams, polynomials and tables past their force maximum on a piece."""
        return self.pieces[min(piece, len(self.pieces)) - 1].snapped if piece else 0

    def elongation(self, force: float) -> float:
        """Smallest elongation at which the law bears the force (N), m.

        Raises InputError for a negative force, and for one that the law never bears; beyond a stop k is needed.
        """
        force = bearable(force)
        if force == 0.0:
            return 0.0
        for one in self.monotone:
            if one.sign > 0 and one.first <= force <= one.last:
                return one.inverse(force)
        if self.end == math.inf:
            largest = max(one.last for one in self.monotone)
            raise InputError(f"force = {force!r} N: the law bears no more than {largest!r} N; use a smaller force")
        if force <= self.end_force:  # missed above by round-off
            return self.end
        if self.k is None:
            raise InputError(
                f"force = {force!r} N: the law ends at {self.end_force!r} N; "
                "use a smaller force, or give the stiffness k beyond"
            )
        return self.end + (force - self.end_force) / self.k

    @property
    def uses_stiffness(self) -> bool:
        """Whether k counts: whether there is a stop."""
        return self.end < math.inf

    @cached_property
    def stiffest(self) -> float:
        """N/m, about the largest stiffness."""
        ends = [end for one in self.monotone for end in (one.start, one.end) if end < math.inf]
        return max(abs(self.stiffness(end or 1e-12)) for end in ends)

    @cached_property
    def narrow(self) -> float:
        """m, the shortest piece on which the force falls: what a step must be small beside; inf: there is none."""
        return min((one.end - one.start for one in self.monotone if one.sign < 0), default=math.inf)

    def value(self, piece: int, x: float) -> tuple[float, float, float]:
        """N, N/m, N/m2: force, stiffness and its slope of one piece's own formula at an elongation (m)."""
        if piece == 0:
            return 0.0, 0.0, 0.0
        if piece > len(self.pieces):
            k = self.k or 0.0
            return self.end_force + k * (x - self.end), k, 0.0
        return self.pieces[piece - 1].curve.value(x)


def bearable(force: float) -> float:
    """A force, N.  Raises InputError for one that no string bears."""
    force = number("force", force)
    if not (math.isfinite(force) and force >= 0.0):
        raise InputError(f"force = {force!r} N: a string bears no such force; use a finite force >= 0")
    return force


def _merged(pieces: list[Piece]) -> tuple[Piece, ...]:
    """Pieces of one curve as one piece."""
    found: list[Piece] = []
    for one in pieces:
        if found and one.joined and one.snapped == found[-1].snapped:
            before = found.pop()
            one = Piece(one.curve, before.start, one.end, before.first, one.last, one.snapped, before.joined)
        found.append(one)
    return tuple(found)


def require_tension(made: Law, name: str) -> None:
    largest = max((one.last for one in made.monotone if one.last < math.inf), default=1.0)
    for one in made.monotone:
        low, at = (one.last, one.end) if one.sign < 0 else (one.first, one.start)
        if low < -ROUND_OFF * max(largest, 0.0):
            raise InputError(
                f"{name}: the force falls to {low!r} N at an elongation of {at!r} m, but a string bears no "
                "compression; keep the force at 0 or above, or use a series with memory (law = 'hysteretic')"
            )
