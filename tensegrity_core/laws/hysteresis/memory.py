"""The parts of a series with memory, and the stable branches of given pieces of their laws."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
import scipy

from ...errors import InputError
from ...model.elements import Series
from ...quantities import number
from ..beam import EPS
from ..chains import Chain, rise
from ..curves import PolynomialCurve
from ..elements import part_law
from ..law import Law
from ..pieces import Piece
from .branch import Branch

#: A branch shorter than this part is none.
NARROW = 1e-12


class Memory:
    """A series with memory: its parts' laws and the string's own stiffness, N/m.  Make one with `memory`."""

    def __init__(self, element: Series, k: float):
        self.element, self.k = element, k
        self.parts: tuple[Law, ...] = tuple(part_law(part) for part in element.parts)
        self.spring = Piece.of(PolynomialCurve(0.0, (0.0, k), 0.0), 0.0, math.inf)
        self.width = max((part.breakpoints[-1] for part in self.parts), default=0.0)  # m: what lengths are small beside
        self._branches: dict[tuple, tuple[Branch, ...]] = {}
        for i, part in enumerate(self.parts, 1):
            if part.monotone[0].sign <= 0 or (part.end == math.inf and part.monotone[-1].sign <= 0):
                where = "at first" if part.monotone[0].sign <= 0 else "in the end"
                raise InputError(f"series: the force of part {i} does not rise {where}; a part of a series with memory must")

    def piece(self, i: int, at: int) -> Piece | None:
        """Part i's piece of a number; None: its stop."""
        pieces = self.parts[i].monotone
        return pieces[at] if at < len(pieces) else None

    def sign(self, i: int, at: int) -> int:
        """1 rising or at a stop, 0 flat, -1 falling."""
        on = self.piece(i, at)
        return 1 if on is None else on.sign

    def force(self, i: int, u: float) -> tuple[float, float]:
        """Force (N) and slope (N/m) of part i at u (m), its stop aside."""
        law = self.parts[i]
        on = law.pieces[min(max(law.piece_of(u), 1), len(law.pieces)) - 1]
        return on.curve.value(u)[:2]

    def slack(self, at: tuple[int, ...]) -> Branch:
        """The slack branch on which each part rests on a piece."""
        return self._kept(("slack", *at), lambda: (Branch(self, at),))[0]

    def branches(self, at: tuple[int, ...]) -> tuple[Branch, ...]:
        """The stable taut branches of these pieces, in order of the leading part's displacement; none, one or more."""
        return self._kept(at, lambda: _stable(self, at))

    def _kept(self, key, make):
        if key not in self._branches:
            self._branches[key] = make()
        return self._branches[key]


def memory(element: Series, k: float) -> Memory:
    """The memory of a series with law 'hysteretic' and the string's stiffness k (N/m).

    Raises InputError for a part or a stiffness out of range.
    """
    return _memory(element, number("stiffness", k))


@lru_cache(maxsize=1024)
def _memory(element: Series, k: float) -> Memory:
    if not (math.isfinite(k) and k > 0.0):
        raise InputError(f"stiffness = {k!r} N/m: a series with memory needs the string's own stiffness; use one > 0")
    if not element.parts:
        raise InputError("series.parts is empty; give at least one part")
    return Memory(element, k)


def start(element: Series, k: float) -> Branch:
    """The slack branch of an element that has never been stretched.  k: the string's own stiffness, N/m."""
    return memory(element, k).slack((0,) * len(element.parts))


def _stable(m: Memory, at: tuple[int, ...]) -> tuple[Branch, ...]:
    """The stable branches on which every part is on its piece `at`."""
    moving = [part.monotone[n] for part, n in zip(m.parts, at) if n < len(part.monotone)] + [m.spring]
    stopped = [part for part, n in zip(m.parts, at) if n == len(part.monotone)]
    held = math.fsum(part.end for part in stopped)
    base = math.fsum(part.monotone[-1].curve.energy(part.end) for part in stopped)
    leads = [i for i, n in enumerate(at) if m.sign(i, n) <= 0]
    low = max(0.0, *(min(one.first, one.last) for one in moving), *(part.end_force for part in stopped))
    high = min(max(one.first, one.last) for one in moving)
    tie = max(one.tie for one in (*moving, *(part.monotone[-1] for part in stopped)))
    if len(leads) > 1 or low > high + tie or (not leads and low >= high):
        return ()
    if not leads:
        return (Branch(m, at, 0, None, rise(moving, low, high, held, base), None, low == 0.0, (low, high)),)
    lead = leads[0]
    ahead = m.parts[lead].monotone[at[lead]]
    place = moving.index(ahead)
    ends = (ahead.start, ahead.end) if ahead.sign == 0 else (ahead.inverse(high), ahead.inverse(low))
    whole = Chain(moving, place, *ends, held, base)
    return tuple(
        Branch(m, at, number, lead, [Chain(moving, place, a, b, held, base)], folds, low == 0.0 and b == whole.end, (low, high))
        for number, (a, b, folds) in enumerate(_increasing(whole))
    )


def _increasing(chain: Chain) -> list[tuple[float, float, tuple[bool, bool]]]:
    """Intervals of p on which x increases, and whether each end is a fold.

    A fold may lie near an end, where the leading part has turned: dx/dp is looked at with distances from the ends that double
    each time, and evenly between.  Parts that turn at forces that tie turn together: what dx/dp is next to such an end is
    round-off, and is passed over.
    """
    width = chain.end - chain.start
    near = [np.ldexp(width, np.arange(-14 if chain.tied(p) else -20, -1)) for p in (chain.start, chain.end)]
    even = chain.start + width * np.linspace(0.02, 0.98, 97)
    grid = np.unique(np.concatenate((chain.start + near[0], chain.end - near[1], even)))
    grid = grid[(grid > chain.start) & (grid < chain.end)]
    growth = np.array([chain.growth(p) for p in grid])
    found, begin, begin_fold = [], chain.start, False
    for a, b, before, after in zip(grid, grid[1:], growth, growth[1:]):
        if before > 0.0 >= after:
            found.append((begin, scipy.optimize.brentq(chain.growth, a, b, xtol=1e-300, rtol=4.0 * EPS), (begin_fold, True)))
        elif before <= 0.0 < after:
            begin, begin_fold = scipy.optimize.brentq(chain.growth, a, b, xtol=1e-300, rtol=4.0 * EPS), True
    if len(growth) and growth[-1] > 0.0:
        found.append((begin, chain.end, (begin_fold, False)))
    return [(a, b, folds) for a, b, folds in found if chain.total(b) - chain.total(a) > NARROW * abs(chain.total(b))]
