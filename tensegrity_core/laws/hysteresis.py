"""Series elements with memory: the law `hysteretic`.

The displacements u of the parts are internal variables.  They follow, continuously, a local minimum of

    Pi(u; x) = sum U_j(u_j) + k_s (x - sum u_j)^2 / 2,      T = k_s (x - sum u_j),

x the element's elongation, k_s the string's own stiffness, in series with the parts.  Where the Hessian diag(f'_j) + k_s 11^T
becomes singular the element snaps: the new state is the limit of the overdamped flow c u'_j = T - f_j(u_j), equal c, with stops
at 0 and at the parts' ends, and Pi before less Pi after is lost.  A slack string (T = 0) keeps u at rest under no force.

A *branch* is a family of such minima: each part is on one of its law's pieces or at its stop, at most one of them on a
piece that does not rise.  All parts and the spring k_s then carry one force, which is a smooth function of x.  A branch ends

* where a part reaches the end of its piece: the next branch joins on, without a loss, if it is stable there;
* at a fold, where dx/dp = 0, p the displacement of the falling part: T has a square root there;
* where the string goes slack.

Ties.  Forces within `Piece.tie` of each other are one.  Parts that come to ends of their pieces at one force come there
together, each to its own end.  Where these are extrema the first part (by index) whose fall goes on stably falls and the others
go back; where none does they snap, and the flow starts with the first of them moving on.  Beyond a tie the part whose end has
the nearer force goes, however little nearer: next to that end may lie a branch as short as the root of the difference, and it
is followed.  So the law does not depend on its parameters continuously: where round-off decides whether forces tie, either of
two stable branches may follow, and both are right.

Parts are elements without memory of any kind; each must rise at first and in the end.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property, lru_cache
from itertools import product
from typing import NamedTuple

import numpy as np
import scipy

from ..errors import InputError, TensegrityError
from ..model.elements import Series
from ..quantities import number
from .beam import EPS
from .chains import Chain, RiseCurve, rise
from .curves import PolynomialCurve
from .elements import part_law
from .law import Law
from .pieces import TIE, Piece

#: The flow starts this far from the state that lost its stability, as a part of the leading part's piece.
NUDGE = 1e-3
#: What breaks ties between equal parts, as a part of that.
TIE_BREAK = 1e-3
#: Tolerances of the flow's integration; the limit itself is solved for exactly.
FLOW_RTOL, FLOW_ATOL = 1e-8, 1e-12
#: The flow has arrived where a Newton step from a stable state is shorter than this part of the pieces.
ARRIVED = 1e-7
#: Eigenvalues below this part of the parts' largest slope are not those of a stable state.
NEUTRAL = 1e-8
#: Elongations that differ by less than this part are equal, where branches join; a branch shorter than this part is none.
SAME, NARROW = 1e-9, 1e-12
#: And this part of the parts' width: where forces tie the place of an extremum is known to the root of a tie only.
TURNED = 2.0 * math.sqrt(TIE)
#: Steps after which a flow, and events after which a way along branches, counts as endless.
MAX_STEPS, MAX_EVENTS = 3000, 10_000


class NoStableState(TensegrityError):
    """No stable state of a series with memory was found after one that is none."""


class Event(NamedTuple):
    """A change of branch at the elongation x (m), with the energy that is lost in it (J)."""

    x: float
    loss: float
    before: Branch
    after: Branch


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
        return self._kept(("slack", *at), lambda: (Branch(self, at, 0, None, (), (), False),))[0]

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


def follow(branch: Branch, x: float) -> tuple[Branch, list[Event]]:
    """The branch after a continuous way to the elongation x (m), and the changes of branch on it."""
    events: list[Event] = []
    x = number("x", x)
    up = x > branch.upper
    while branch.upper < x if up else x < branch.lower:
        at = branch.upper if up else branch.lower
        after, loss = branch.above() if up else branch.below()
        events.append(Event(at, loss, branch, after))
        branch = after
        if len(events) > MAX_EVENTS:
            raise NoStableState(f"{MAX_EVENTS} changes of branch on the way to x = {x!r} m")
    return branch, events


class Branch:
    """A stable branch; frozen.  Branches of equal elements and stiffnesses are equal where they are the same family of states.

    at: the piece of each part (one past the last: at its stop); lead: the part that does not rise, or None;
    folds: whether the lower and the upper end are folds; low, high: N, forces between which the parts' pieces overlap;
    loosens: whether T falls to 0 on it; lower, upper: elongations at its ends, m; taut: False if slack.
    """

    def __init__(
        self,
        memory: Memory,
        at: tuple[int, ...],
        number: int,
        lead: int | None,
        chains,
        folds,
        loosens: bool,
        low: float = 0.0,
        high: float = 0.0,
    ):
        self.low, self.high = low, high
        self.memory, self.at, self.number, self.lead = memory, at, number, lead
        self.taut = bool(chains)
        self.folds, self.loosens = folds or (False, False), loosens
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
        force = number("force", force)
        if not (math.isfinite(force) and force >= 0.0):
            raise InputError(f"force = {force!r} N: a string bears no such force; use a finite force >= 0")
        branch, passed = self, 0
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
        return self._above

    def below(self) -> tuple[Branch, float]:
        """The branch that follows the lower end while x decreases, and the energy lost in changing to it, J."""
        return self._below

    @cached_property
    def _above(self):
        return _next(self, 1)

    @cached_property
    def _below(self):
        return _next(self, -1)

    def _value(self, x: float) -> tuple[float, float, float]:
        if not self.taut:
            return 0.0, 0.0, 0.0
        chains = self.curve.chains
        if self.folds[0] and x <= self.lower:
            return chains[0].value(chains[0].start)[0], 0.0, 0.0
        if self.folds[1] and x >= self.upper:
            return chains[-1].value(chains[-1].end)[0], 0.0, 0.0
        return self.curve.value(x)


# -------------------------------------------------------------------------------------------- branches of given pieces


def _stable(m: Memory, at: tuple[int, ...]) -> tuple[Branch, ...]:
    """The stable branches on which every part is on its piece `at`."""
    on = [m.piece(i, n) for i, n in enumerate(at)]
    moving = [one for one in on if one is not None] + [m.spring]
    stopped = [part for part, one in zip(m.parts, on) if one is None]
    held = math.fsum(part.end for part in stopped)
    base = math.fsum(part.monotone[-1].curve.energy(part.end) for part in stopped)
    leads = [i for i, one in enumerate(on) if one is not None and one.sign <= 0]
    low = max(0.0, *(min(one.first, one.last) for one in moving), *(part.end_force for part in stopped))
    high = min(max(one.first, one.last) for one in moving)
    tie = max(one.tie for one in (*moving, *(part.monotone[-1] for part in stopped)))
    if len(leads) > 1 or low > high + tie or (not leads and low >= high):
        return ()
    if not leads:
        return (Branch(m, at, 0, None, rise(moving, low, high, held, base), (), low == 0.0, low, high),)
    lead = leads[0]
    place, ahead = moving.index(on[lead]), on[lead]
    ends = (ahead.start, ahead.end) if ahead.sign == 0 else (ahead.inverse(high), ahead.inverse(low))
    whole = Chain(moving, place, *ends, held, base)
    return tuple(
        Branch(m, at, number, lead, [Chain(moving, place, a, b, held, base)], folds, low == 0.0 and b == whole.end, low, high)
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


# ---------------------------------------------------------------------------------------------------------- what follows


def _next(branch: Branch, way: int) -> tuple[Branch, float]:
    """The branch that follows the end to which x moves (way: 1 up, -1 down), and the loss."""
    m, x = branch.memory, branch.upper if way > 0 else branch.lower
    if not branch.taut:
        return m.branches(branch.at)[0], 0.0
    if branch.folds[way > 0]:
        return _snap(branch, x, branch.lead, way, branch.at)
    if branch.loosens and branch.lead is None and way < 0:
        return m.slack(branch.at), 0.0
    ending = _ending(branch, x)
    leads = {i for i, ends in enumerate(ending) if ends} | {branch.lead}
    for lead in sorted(leads | {None}, key=lambda i: -1 if i is None else i):
        at = _moved(branch, ending, lead, way)
        joined = _joining(m, at, lead, way, x) if at is not None else None
        if joined is not None:
            return joined, 0.0
    if branch.lead is not None:  # the force goes the other way than x
        shift = [way if i == branch.lead else -way for i in range(len(ending))]
        return _snap(branch, x, branch.lead, way, _shifted(branch.at, ending, shift))
    for lead in range(len(ending)):
        at = _shifted(branch.at, ending, [way * (i == lead) for i in range(len(ending))])
        if m.sign(lead, at[lead]) < 0:
            return _snap(branch, x, lead, way, at)
    raise NoStableState(f"nothing follows the state at x = {x!r} m; look for parts that end together")


def _ending(branch: Branch, x: float) -> list[set[int]]:
    """For each part the ends of its piece (-1, 1) at which it stands."""
    force, found = branch.force(x), []
    pieces = [branch.memory.piece(i, n) for i, n in enumerate(branch.at)]
    largest = max((on.tie for on in pieces if on is not None), default=0.0)  # where a part is at its stop others give the force
    for i, (on, u) in enumerate(zip(pieces, branch.displacements(x))):
        if on is None:
            ends, tie = ((-1, branch.memory.parts[i].end_force),), max(TIE * abs(force), largest)
        elif on.sign == 0:  # the lead on a flat piece
            found.append({end for end, at in ((-1, on.start), (1, on.end)) if u == at})
            continue
        else:
            ends, tie = ((-1, on.first), (1, on.last)), on.tie
        found.append({end for end, at in ends if abs(force - at) <= tie})
    return found


def _shifted(at: tuple[int, ...], ending: list[set[int]], shift: list[int]) -> tuple[int, ...]:
    """The pieces of parts that move in the directions `shift`: the next one for those that stand at that end."""
    return tuple(n + d if d in ends and n + d >= 0 else n for n, ends, d in zip(at, ending, shift))


def _moved(branch: Branch, ending: list[set[int]], lead: int | None, way: int) -> tuple[int, ...] | None:
    """The pieces beyond an event if `lead` (or no part) does not rise there; None: there are none such."""
    m, direction = branch.memory, way  # direction: of the force
    if lead is not None:
        after = _shifted(branch.at, ending, [way * (i == lead) for i in range(len(ending))])[lead]
        direction = m.sign(lead, after) * way
    at = _shifted(branch.at, ending, [way if i == lead else direction for i in range(len(ending))])
    falling = {i for i, n in enumerate(at) if m.sign(i, n) <= 0}
    return at if at != branch.at and falling == ({lead} - {None}) else None


def _joining(m: Memory, at: tuple[int, ...], lead: int | None, way: int, x: float) -> Branch | None:
    """The branch of these pieces that goes on from x, or None."""
    for one in m.branches(at):
        begin = one.lower if way > 0 else one.upper
        if one.lead == lead and not one.folds[way < 0] and abs(begin - x) <= SAME * abs(x) + TURNED * m.width:
            return one
    return None


# -------------------------------------------------------------------------------------------------------------- snapping


def _snap(branch: Branch, x: float, lead: int, way: int, at: tuple[int, ...]) -> tuple[Branch, float]:
    """The branch on which the flow ends that leaves the branch at x with part `lead` moving on, and the loss.

    at: the pieces into which the parts move.
    """
    final = _Flow(branch.memory, x).limit(_nudged(branch, x, lead, way, at), branch.displacements(x))
    landed = _branch_at(branch.memory, x, final)
    if landed is None or landed is branch:
        raise NoStableState(f"no stable state follows a snap at x = {x!r} m; u = {final.tolist()!r} m")
    return landed, max(branch.energy(x) - landed.energy(x), 0.0)


def _nudged(branch: Branch, x: float, lead: int, way: int, at: tuple[int, ...]) -> np.ndarray:
    """(n,) m: a state just off the branch's at x, where it is unstable: along the lowest eigenvector of the Hessian.

    The Hessian is that of the pieces `at`, a little inside them: what turns together with `lead` goes back.
    """
    m, u = branch.memory, branch.displacements(x)
    falls = m.piece(lead, at[lead]) or m.piece(lead, branch.at[lead])
    size = NUDGE * min(falls.end - falls.start, m.width)
    direction = np.zeros(len(u))
    direction[lead] = way
    free = [i for i, n in enumerate(at) if m.piece(i, n) is not None]
    if not (branch.loosens and branch.lead is not None and way > 0):  # else it goes slack: the part moves under no force
        slopes = []
        for i in free:
            on, room = m.piece(i, at[i]), size
            v = u[i] + way * size if i == lead else u[i]
            slopes.append(on.curve.value(min(max(v, on.start + room), on.end - room))[1])
        vector = np.linalg.eigh(np.diag(slopes) + m.k)[1][:, 0]
        direction[free] = vector * way * np.sign(vector[free.index(lead)])
    first = way * TIE_BREAK * (1.0 - np.arange(len(u)) / len(u))  # of equal parts the lowest index goes first
    return u + size * (direction / np.abs(direction).max() + first)


class _Flow:
    """The overdamped flow u' = T - f(u) at a held elongation x (m), with stops at 0 and at the parts' ends."""

    def __init__(self, m: Memory, x: float):
        self.m, self.x = m, x
        self.end = np.array([part.end for part in m.parts])

    def tension(self, u: np.ndarray) -> float:
        return max(self.m.k * (self.x - math.fsum(u)), 0.0)

    def rate(self, u: np.ndarray) -> np.ndarray:
        return self.tension(u) - np.array([self.m.force(i, v)[0] for i, v in enumerate(u)])

    def hessian(self, u: np.ndarray) -> np.ndarray:
        slopes = [self.m.force(i, v)[1] for i, v in enumerate(u)]
        return np.diag(slopes) + (self.m.k if self.tension(u) > 0.0 else 0.0)

    def limit(self, u: np.ndarray, origin: np.ndarray) -> np.ndarray:
        """(n,) m: where the flow from u ends, to within ARRIVED.  origin: the state that it leaves.

        Where that is so nearly neutral that round-off is all that moves the flow, it is pushed further.
        """
        u, steps, push = np.clip(u, 0.0, self.end), 0, NUDGE * self.m.width
        while True:
            free = ~self._held(u)
            moved = u.copy()
            solver = self._solver(u, free, moved)
            while (free == ~self._held(u)).all():
                if self._arrived(u, free):
                    return u
                if np.abs(self.rate(u)[free]).max() <= 64.0 * EPS * self.m.k * self.x:
                    push *= 10.0
                    u = self._pushed(u, free, push, u - origin)
                    break
                before, steps = solver.t, steps + 1
                solver.step()
                if solver.status == "failed" or steps > MAX_STEPS:
                    raise NoStableState(f"a snap at x = {self.x!r} m finds no end")
                u = u.copy()
                u[free] = self._stopped(solver, before, free)
                if not np.array_equal(u[free], solver.y):
                    break

    def _pushed(self, u: np.ndarray, free: np.ndarray, push: float, onward: np.ndarray) -> np.ndarray:
        """u moved by `push` (m) along the lowest eigenvector, to the side of `onward`."""
        vector = np.linalg.eigh(self.hessian(u)[np.ix_(free, free)])[1][:, 0]
        u = u.copy()
        u[free] += push * math.copysign(1.0, vector @ onward[free]) * vector
        return np.clip(u, 0.0, self.end)

    def _held(self, u: np.ndarray) -> np.ndarray:
        """Whether each part is at a stop and pressed against it."""
        rate = self.rate(u)
        return (u >= self.end) & (rate >= 0.0) | (u <= 0.0) & (rate <= 0.0)

    def _solver(self, u: np.ndarray, free: np.ndarray, whole: np.ndarray) -> scipy.integrate.Radau:
        def rate(_, v):
            whole[free] = v
            return self.rate(whole)[free]

        def jacobian(_, v):
            whole[free] = v
            return -self.hessian(whole)[np.ix_(free, free)]

        return scipy.integrate.Radau(rate, 0.0, u[free], math.inf, rtol=FLOW_RTOL, atol=FLOW_ATOL * self.m.width, jac=jacobian)

    def _stopped(self, solver: scipy.integrate.Radau, before: float, free: np.ndarray) -> np.ndarray:
        """The free parts after a step that began at the time `before`; it ends where the first of them meets a stop."""
        end = self.end[free]
        if ((solver.y >= 0.0) & (solver.y <= end)).all():
            return solver.y
        dense = solver.dense_output()

        def room(t):
            v = dense(t)
            return float(min((end - v).min(), v.min()))

        t = scipy.optimize.brentq(room, before, solver.t) if room(before) > 0.0 > room(solver.t) else solver.t
        v = dense(t)
        near = FLOW_RTOL * self.m.width
        return np.where(v >= end - near, end, np.where(v <= near, 0.0, v)) if t < solver.t else np.clip(v, 0.0, end)

    def _arrived(self, u: np.ndarray, free: np.ndarray) -> bool:
        if not free.any():
            return True
        hessian = self.hessian(u)[np.ix_(free, free)]
        largest = max(abs(self.m.force(i, v)[1]) for i, v in enumerate(u))
        if not np.linalg.eigvalsh(hessian)[0] > NEUTRAL * largest:
            return False
        return bool(np.abs(np.linalg.solve(hessian, self.rate(u)[free])).max() <= ARRIVED * self.m.width)


def _branch_at(m: Memory, x: float, u: np.ndarray) -> Branch | None:
    """The branch whose state at x (m) is nearest to u (n,), m; None where none is near."""
    near, choices = 100.0 * ARRIVED * m.width, []
    for part, v in zip(m.parts, u):
        fits = [n for n, on in enumerate(part.monotone) if on.start - near <= v <= on.end + near]
        choices.append(fits + [len(part.monotone)] * int(v >= part.end - near))
    if math.fsum(u) >= x:
        resting = [
            [n for n in fits if m.piece(i, n) is not None and m.sign(i, n) > 0 and m.piece(i, n).first <= 0.0]
            for i, fits in enumerate(choices)
        ]
        found = [m.slack(at) for at in product(*resting)]
    else:
        found = [one for at in product(*choices) for one in m.branches(at) if one.lower - near <= x <= one.upper + near]
    distances = [(float(np.abs(one.displacements(x) - u).max()), i) for i, one in enumerate(found)]
    return found[min(distances)[1]] if distances and min(distances)[0] <= 10.0 * near else None
