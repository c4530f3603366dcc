"""An exact force law without memory: force, stiffness and energy over elongation, and the inverse."""

from __future__ import annotations

import math
from bisect import bisect_left

from ..errors import InputError
from ..quantities import number
from .curves import Stretch

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
        if force <= self.end_force:  # missed above by round-off
            return self.end
        if k is None:
            raise InputError(
                f"force = {force!r} N: the law ends at {self.end_force!r} N; "
                "use a smaller force, or give the stiffness k beyond"
            )
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


def require_tension(made: Law, name: str) -> None:
    largest = max((one.last for one in made.stretches if one.last < math.inf), default=1.0)
    for one in made.stretches:
        low, at = (one.last, one.end) if one.sign < 0 else (one.first, one.start)
        if low < -ROUND_OFF * max(largest, 0.0):
            raise InputError(
                f"{name}: the force falls to {low!r} N at an elongation of {at!r} m, but a string bears no "
                "compression; keep the force at 0 or above, or use a series with memory (law = 'hysteretic')"
            )
