"""A branch: a family of stable states, over the elongation."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...errors import InputError
from ...quantities import number
from ..chains import RiseCurve
from ..law import bearable
from .transitions import MAX_EVENTS, beyond, follow

if TYPE_CHECKING:
    from .memory import Memory


class Branch:
    """A stable branch; frozen.  Branches of equal elements and stiffnesses are equal where they are the same family of states.

    at: the piece of each part (one past the last: at its stop); lead: the part that does not rise, or None;
    folds: whether the lower and the upper end are folds; low, high: `reach`, N, forces between which the parts' pieces overlap;
    loosens: whether T falls to 0 on it; lower, upper: elongations at its ends, m; taut: False if slack.
    """

    def __init__(self, memory: Memory, at, number=0, lead=None, chains=(), folds=None, loosens=False, reach=(0, 0)):
        self.memory, self.at, self.number = memory, at, number
        self.lead: int | None = lead
        self.taut, self.folds, self.loosens, (self.low, self.high) = bool(chains), folds or (False, False), loosens, reach
        self._next: dict[int, tuple[Branch, float]] = {}  # by way
        if self.taut:
            self.curve = RiseCurve(chains)
            self.lower, self.upper = self.curve.lower, self.curve.upper
        else:
            self._rest = [part.monotone[n].inverse(0.0) for part, n in zip(memory.parts, at)]
            self.lower, self.upper = -math.inf, math.fsum(self._rest)

    def __eq__(self, other) -> bool:
        return self is other or (isinstance(other, Branch) and self._key == other._key)

    def __hash__(self) -> int:
        return hash(self._key[:3])

    @property
    def _key(self) -> tuple:
        return self.at, self.number, self.taut, self.memory.k, self.memory.element

    def __repr__(self) -> str:
        state = "taut" if self.taut else "slack"
        return f"<Branch {state} {self.at} #{self.number} {self.lower:.6g}..{self.upper:.6g} m>"

    def force(self, x: float) -> float:
        """T at the elongation x (m), N; past a fold constant, past another end a second order Taylor polynomial."""
        return self._value(number("x", x))[0]

    def stiffness(self, x: float) -> float:
        """dT/dx, N/m; without bound towards a fold."""
        return self._value(number("x", x))[1]

    def energy(self, x: float) -> float:
        """Pi, J, at an elongation on the branch (m)."""
        if not self.taut:
            return math.fsum(part.monotone[n].curve.energy(u) for part, n, u in zip(self.memory.parts, self.at, self._rest))
        return self.curve.energy(min(max(number("x", x), self.lower), self.upper))

    def displacements(self, x: float) -> np.ndarray:
        """(n,) m: u of each part at an elongation on the branch (m)."""
        if not self.taut:
            return np.array(self._rest)
        moving = iter(self.curve.displacements(min(max(number("x", x), self.lower), self.upper)))
        return np.array([part.end if n == len(part.monotone) else next(moving) for part, n in zip(self.memory.parts, self.at)])

    @cached_property
    def snapped(self) -> int:
        """Beams, polynomials and tables past their force maximum."""
        pieces = [part.monotone for part in self.memory.parts]
        return sum(s[min(n, len(s) - 1)].snapped for s, n in zip(pieces, self.at))

    def follow(self, x: float) -> Branch:
        """The branch after a continuous way to the elongation x (m); see `follow`."""
        return follow(self, x)[0]

    def elongation(self, force: float) -> float:
        """Smallest elongation at which the element, stretched from this branch on, bears the force (N), m.

        Raises InputError for a negative force and for one that the element never bears.
        """
        force, branch, passed = bearable(force), self, 0
        while force > 0.0:
            branch, passed = branch.above()[0], passed + 1
            if branch.lead is None and branch.low <= force <= branch.high:
                return branch.inverse(force)
            if branch.upper == math.inf or passed > MAX_EVENTS:
                raise InputError(f"force = {force!r} N: the element never bears it; use a smaller force")
        return 0.0

    def on_piece(self, piece: int) -> Callable[[float], float]:
        """`force`: a branch is one piece."""
        return self.force

    def snapped_on_piece(self, piece: int) -> int:
        """`snapped`: a branch is one piece."""
        return self.snapped

    breakpoints, uses_stiffness = (), True

    @property
    def stiffest(self) -> float:
        """N/m: the string's own stiffness, in series with all parts."""
        return self.memory.k

    @property
    def narrow(self) -> float:
        """m, the shortest piece on which a part's force falls; inf: there is none."""
        return min(part.narrow for part in self.memory.parts)

    def inverse(self, force: float) -> float:
        """Where a branch on which every part rises bears a force between `low` and `high` (N), m."""
        pieces, held = self.curve.chains[0].pieces, self.curve.chains[0].held
        return math.fsum((held, *(one.inverse(force) for one in pieces)))

    def above(self) -> tuple[Branch, float]:
        """The branch that follows the upper end while x increases, and the energy lost in changing to it, J."""
        return self._beyond(1)

    def below(self) -> tuple[Branch, float]:
        """The branch that follows the lower end while x decreases, and the energy lost in changing to it, J."""
        return self._beyond(-1)

    def _beyond(self, way: int) -> tuple[Branch, float]:
        if way not in self._next:
            self._next[way] = beyond(self, way)
        return self._next[way]

    def _value(self, x: float) -> tuple[float, float, float]:
        if not self.taut:
            return 0.0, 0.0, 0.0
        chains = self.curve.chains
        if self.folds[0] and x <= self.lower:
            return chains[0].value(chains[0].start)[0], 0.0, 0.0
        if self.folds[1] and x >= self.upper:
            return chains[-1].value(chains[-1].end)[0], 0.0, 0.0
        return self.curve.value(x)
