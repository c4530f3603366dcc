"""Elements in series without memory: where their snaps are."""

from __future__ import annotations

import math

from ..errors import InputError
from .curves import TIE, HeldCurve, RiseCurve, Stretch, rise
from .exact import Law


class Snaps:
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
            if force > self.force * (1.0 + TIE) or self.force == 0.0:  # else a tie: the next part is at its end already
                self._rise(moving, force)
            if force == math.inf:
                break
            ending = [i for i in moving if self._stretch(i).last <= self.force * (1.0 + TIE)]
            due = [i for i in ending if self._moves_on(i)]
            if due:  # one at a time: it may come to another maximum that ties, and has the lowest index again
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
        chains = rise(
            [self._stretch(i) for i in moving],
            self.force,
            force,
            math.fsum(self.u[i] for i in held),
            math.fsum(self._energy(i) for i in held),
        )
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
        last = next(
            (
                n
                for n in range(first, len(part.stretches))
                if part.stretches[n].sign > 0 and part.stretches[n].last >= self.force * (1.0 - TIE)
            ),
            None,
        )
        if last is None:
            raise InputError(
                f"series: part {i + 1} never bears its force maximum of {self.force!r} N again, so that no single "
                "force belongs to an elongation; use law = 'hysteretic', or let its force rise that far"
            )
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
