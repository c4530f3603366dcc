"""Elements in series without memory: where their snaps are."""

from __future__ import annotations

import math

from ..errors import InputError
from .chains import RiseCurve, rise
from .curves import HeldCurve
from .law import Law
from .pieces import TIE, Piece


class Snaps:
    """Algorithm 1: builds a series piece by piece.  u: m, of every part; at: the piece that it is on; force: N."""

    def __init__(self, parts: list[Law]):
        self.parts = parts
        self.u = [0.0] * len(parts)
        self.at = [0] * len(parts)
        self.force = 0.0
        self.x = 0.0
        self.pieces: list[Piece] = []
        self.monotone: list[Piece] = []

    def law(self) -> Law:
        for i, part in enumerate(self.parts):
            if part.monotone[0].sign <= 0:
                self._snap(i)
        while moving := [i for i in range(len(self.parts)) if self.at[i] < len(self.parts[i].monotone)]:
            force = min(self._piece(i).last for i in moving)
            if force > self.force * (1.0 + TIE) or self.force == 0.0:  # else a tie: the next part is at its end already
                self._rise(moving, force)
            if force == math.inf:
                break
            ending = [i for i in moving if self._piece(i).last <= self.force * (1.0 + TIE)]
            due = [i for i in ending if self._moves_on(i)]
            if due:  # one at a time: it may come to another maximum that ties, and has the lowest index again
                self._snap(due[0])
        return Law(self.pieces, self.monotone)

    def _piece(self, i: int) -> Piece:
        return self.parts[i].monotone[self.at[i]]

    def _moves_on(self, i: int) -> bool:
        """Part i, at the end of its piece, goes on to the next one or to its stop unless it has to snap; whether it has."""
        pieces, after = self.parts[i].monotone, self.at[i] + 1
        if after < len(pieces) and pieces[after].sign <= 0:
            return True
        self.at[i] = after
        return False

    def _rise(self, moving: list[int], force: float) -> None:
        held = [i for i in range(len(self.parts)) if i not in moving]
        still, base, snapped = self._sums(held)
        curve = RiseCurve(rise([self._piece(i) for i in moving], self.force, force, still, base))
        snapped += sum(self._piece(i).snapped for i in moving)
        self._add([Piece(curve, self.x, curve.upper, self.force, force, snapped)])
        if force < math.inf:
            for i, u in zip(moving, curve.displacements(curve.upper)):
                self.u[i] = u
        self.force = force

    def _snap(self, i: int) -> None:
        """Part i goes along its own curve until it bears the force again on a rising piece."""
        part, first = self.parts[i], self.at[i] + (self._piece(i).sign > 0)
        others = [j for j in range(len(self.parts)) if j != i]
        held, base, counted = self._sums(others)
        enough = self.force * (1.0 - TIE)
        bearing = (n for n, one in enumerate(part.monotone) if n >= first and one.sign > 0 and one.last >= enough)
        last = next(bearing, None)
        if last is None:
            raise InputError(
                f"series: part {i + 1} never bears its force maximum of {self.force!r} N again, so that no single "
                "force belongs to an elongation; use law = 'hysteretic', or let its force rise that far"
            )
        way: list[Piece] = []
        for n in range(first, last + 1):
            one = part.monotone[n]
            start = self.u[i] if n == first else one.start
            end, force = (one.inverse(self.force, True), self.force) if n == last else (one.end, one.last)
            joined = one.joined and n > first
            curve = way[-1].curve if joined else HeldCurve(one.curve, held, base)
            way.append(Piece(curve, held + start, held + end, one.first, force, counted + one.snapped, joined))
        self.at[i], self.u[i] = last, way[-1].end - held
        self._add([one for one in way if one.end > one.start])
        self.u[i] = part.monotone[last].inverse(self.force, True)

    def _add(self, way: list[Piece]) -> None:
        """Add pieces, and as pieces those of one curve together."""
        if not way or way[-1].end <= self.x:
            return
        self.monotone += way
        for one in way:
            if one.joined and self.pieces and self.pieces[-1].curve is one.curve:
                before = self.pieces.pop()
                one = Piece(one.curve, before.start, one.end, before.first, one.last, one.snapped, before.joined)
            self.pieces.append(one)
        self.x = way[-1].end

    def _sums(self, held: list[int]) -> tuple[float, float, int]:
        """Displacement (m), energy (J) and snapped parts of parts that are held."""
        on = [self.parts[i].monotone[min(self.at[i], len(self.parts[i].monotone) - 1)] for i in held]
        energy = math.fsum(one.curve.energy(self.u[i]) for one, i in zip(on, held))
        return math.fsum(self.u[i] for i in held), energy, sum(one.snapped for one in on)
