"""Along branches: which one follows where a branch ends, with the snap that may lead to it."""

from __future__ import annotations

import math
from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...quantities import number
from ..pieces import TIE
from .flow import ARRIVED, NUDGE, Flow, NoStableState

if TYPE_CHECKING:
    from .branch import Branch
    from .memory import Memory

#: What breaks ties between equal parts, as a part of that.
TIE_BREAK = 1e-3
#: Elongations that differ by less than this part are equal, where branches join.
SAME = 1e-9
#: And this part of the parts' width: where forces tie the place of an extremum is known to the root of a tie only.
TURNED = 2.0 * math.sqrt(TIE)
#: Events after which a way along branches counts as endless.
MAX_EVENTS = 10_000


class Event(NamedTuple):
    """A change of branch at the elongation x (m), with the energy that is lost in it (J)."""

    x: float
    loss: float
    before: Branch
    after: Branch


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


def beyond(branch: Branch, way: int) -> tuple[Branch, float]:
    """The branch that follows the end to which x moves (way: 1 up, -1 down), and the loss."""
    m, x = branch.memory, branch.upper if way > 0 else branch.lower
    if not branch.taut:
        return m.branches(branch.at)[0], 0.0
    if branch.lead is not None and branch.folds[way > 0]:
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
    force = branch.force(x)
    found: list[set[int]] = []
    ends: tuple[tuple[int, float], ...]
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


def _snap(branch: Branch, x: float, lead: int, way: int, at: tuple[int, ...]) -> tuple[Branch, float]:
    """The branch on which the flow ends that leaves the branch at x with part `lead` moving on, and the loss.

    at: the pieces into which the parts move.
    """
    final = Flow(branch.memory, x).limit(_nudged(branch, x, lead, way, at), branch.displacements(x))
    landed = _branch_at(branch.memory, x, final)
    if landed is None or landed is branch:
        raise NoStableState(f"no stable state follows a snap at x = {x!r} m; u = {final.tolist()!r} m")
    return landed, max(branch.energy(x) - landed.energy(x), 0.0)


def _nudged(branch: Branch, x: float, lead: int, way: int, at: tuple[int, ...]) -> np.ndarray:
    """(n,) m: a state just off the branch's at x, where it is unstable: along the lowest eigenvector of the Hessian.

    The Hessian is that of the pieces `at`, a little inside them: what turns together with `lead` goes back.
    """
    m, u = branch.memory, branch.displacements(x)
    pieces = m.parts[lead].monotone
    falls = pieces[at[lead] if at[lead] < len(pieces) else branch.at[lead]]
    size = NUDGE * min(falls.end - falls.start, m.width)
    direction = np.zeros(len(u))
    direction[lead] = way
    free = [i for i, n in enumerate(at) if m.piece(i, n) is not None]
    if not (branch.loosens and branch.lead is not None and way > 0):  # else it goes slack: the part moves under no force
        slopes = []
        for i in free:
            on, v = m.parts[i].monotone[at[i]], u[i] + way * size if i == lead else u[i]
            slopes.append(on.curve.value(min(max(v, on.start + size), on.end - size))[1])
        vector = np.linalg.eigh(np.diag(slopes) + m.k)[1][:, 0]
        direction[free] = vector * way * np.sign(vector[free.index(lead)])
    first = way * TIE_BREAK * (1.0 - np.arange(len(u)) / len(u))  # of equal parts the lowest index goes first
    return u + size * (direction / np.abs(direction).max() + first)


def _branch_at(m: Memory, x: float, u: np.ndarray) -> Branch | None:
    """The branch whose state at x (m) is nearest to u (n,), m; None where none is near."""
    near, choices = 100.0 * ARRIVED * m.width, []
    for part, v in zip(m.parts, u):
        fits = [n for n, on in enumerate(part.monotone) if on.start - near <= v <= on.end + near]
        choices.append(fits + [len(part.monotone)] * int(v >= part.end - near))
    if math.fsum(u) >= x:
        resting = [
            [n for n in fits if n < len(part.monotone) and part.monotone[n].sign > 0 and part.monotone[n].first <= 0.0]
            for part, fits in zip(m.parts, choices)
        ]
        found = [m.slack(at) for at in product(*resting)]
    else:
        found = [one for at in product(*choices) for one in m.branches(at) if one.lower - near <= x <= one.upper + near]
    distances = [(float(np.abs(one.displacements(x) - u).max()), i) for i, one in enumerate(found)]
    return found[min(distances)[1]] if distances and min(distances)[0] <= 10.0 * near else None
