"""A stable equilibrium path from load to load, by Newton's method alone.

Where the load grows along a stable path there is no need of short steps along the arc: from a point, tangent and curvature
predict the next one wanted, and Newton's method solves for it (`saddle`).  Wanted is whichever comes first:

* the load asked for, or as far as the longest step of `paths` reaches;
* the load at which a string arrives at the end of its piece: its elongation is given instead of p;
* the limit point: a string on a falling piece has lost its reserve of stiffness.

After each step the prediction must have been near, the path must have turned little, every string must be on its piece and
the tangent stiffness positive definite.  Where any of this fails, and for whatever else may happen to a path, `advance`
gives up, and `paths.follow_from` goes on from the last point.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..laws.string_laws import TOUCH, OnPieces
from ..statics import shortest_bar
from .paths import LONGEST, TURN, Path
from .points import SETTLED, Local, Point
from .saddle import Bordered, Saddle

NEWTON = 5  # iterations: predictions are good, or it is better to give up
NEARLY, CONVERGED = 1e-7, 1e-13  # m: a step that small is the last if, by quadratic convergence, the next would be that small
ROOT = 12  # iterations for a limit point
SHARP = 5e-9  # m: the last step towards a limit point, whose p is then right to its square
FLAT, RESOLVED = 1e-5, 1e-12  # where two folds coincide, a limit point's place (m) is not told better, but p and reserve are
FIRST = 3  # strings that are tried as the first to leave its piece
SOFTER = 0.05  # a string that loses more of its stiffness from one state to the next is watched
NEARER = (0.5, 0.2, 0.08)  # parts of the way to a limit point that are tried where it is not found at once
HALVINGS = 2  # of a step that turns too much
LEAST = math.cos(3.0 * TURN) ** 2  # of the squared cosine between the tangents before a step and after it


class Doubt(Exception):
    """The way on cannot be told from here."""


@dataclass(eq=False)
class State:
    """A stable equilibrium, or a limit point: unknowns z and their derivatives by p, (n+B,); elongation: (S,) m.

    string: by whose elongation e the path is known, -1: none; reserve: N/m, of that string; rate, bow: dz/de and d2z/de2;
    lever: dp/de is the reserve over it; load_bow: d2p/de2; push: by how much dz/de grows with dp/de; bends: (S,) N/m2, slopes
    of the strings' stiffnesses; stiffness: N/m, of the string.
    """

    z: np.ndarray
    parameter: float
    laws: OnPieces
    tangent: np.ndarray
    elongation: np.ndarray
    curvature: np.ndarray | float = 0.0
    string: int = -1
    reserve: float = 0.0
    lever: float = 1.0
    rate: np.ndarray = None  # type: ignore[assignment]  # known with the string
    push: np.ndarray = None  # type: ignore[assignment]
    bends: np.ndarray = None  # type: ignore[assignment]
    stiffness: float = 0.0
    bow: np.ndarray | float = 0.0
    load_bow: float = 0.0

    @property
    def load_rate(self) -> float:
        """dp/de."""
        return self.reserve / self.lever

    def softens(self, way: float) -> bool:
        """Whether p changes ever less per elongation as it goes this way."""
        return self.string >= 0 and self.load_bow * way < 0.0

    def moved(self, p: float) -> tuple[np.ndarray, float]:
        """z and p predicted for a change of p."""
        return self.z + p * (self.tangent + (0.5 * p) * self.curvature), self.parameter + p

    def lengthened(self, e: float) -> tuple[np.ndarray, float]:
        """z and p predicted for a change of e."""
        half = 0.5 * e
        return self.z + e * (self.rate + half * self.bow), self.parameter + e * (self.load_rate + half * self.load_bow)

    def lengthening(self, p: float) -> float | None:
        """The change of e predicted for a change of p; None where p does not get there."""
        rest = self.load_rate**2 + 2.0 * self.load_bow * p
        return 2.0 * p / (self.load_rate + math.copysign(math.sqrt(rest), self.load_rate)) if rest > 0.0 else None

    def towards(self, other: State, parameter: float) -> np.ndarray:
        """z predicted at a p between this state and another: quadratic between them, over e or p."""
        change, p = other.z - self.z, parameter - self.parameter
        span = other.parameter - self.parameter
        if self.string < 0 or other.string != self.string:
            part, first = p / span, span * self.tangent
        else:
            e = float(other.elongation[self.string] - self.elongation[self.string])
            slope = self.load_rate * e  # p is slope t + (span - slope) t^2
            rest = math.sqrt(max(slope * slope + 4.0 * (span - slope) * p, 0.0))
            part, first = 2.0 * p / (slope + math.copysign(rest, slope)), e * self.rate
        return self.z + part * (first + part * (change - first))


def _crossing(start: np.ndarray, middle: np.ndarray, last: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(C,) 0..1: where quadratics through three elongations each (C,), at 0, 1/2 and 1, first leave for an end (C,), m.  One
    that starts at its end leaves it on the other side first, and comes back."""
    slope, bow = 4.0 * middle - last - 3.0 * start, 2.0 * (last + start) - 4.0 * middle
    gap = end - start
    rest = np.sqrt(np.maximum(slope * slope + 4.0 * bow * gap, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        far = -0.5 * (slope + np.copysign(rest, slope)) / bow  # the two roots of slope t + bow t^2 = gap
        near = gap / (-bow * far)
        roots = np.stack([near, far])
        roots[~((roots > 0.0) & (roots <= 1.0))] = np.inf
        roots[0, np.abs(gap) <= TOUCH] = np.inf
        part = roots.min(axis=0)
        straight = np.clip(gap / (last - start), 0.0, 1.0)
    return np.where(np.isfinite(part), part, np.nan_to_num(straight))


def _arrow(along: np.ndarray, scale: float, side: float) -> np.ndarray:
    """(n+1,) a direction with this (n,) and that part, or against it where `side` is negative."""
    return math.copysign(1.0, side) * np.concatenate((along, (scale,)))


class LoadSteps:
    """Follows stable paths of one system of equations."""

    def __init__(self, equations, scale: float):
        self.equations, self.scale, self.saddle = equations, scale, Saddle(equations)
        self.longest = LONGEST * shortest_bar(equations.model)
        self._n, self._wound = equations.size, equations.loading.rest_length_direction
        self._last: State | None = None
        self._point: Point | None = None
        self._limit: State | None = None

    @property
    def _here(self) -> State:
        """The state at the path's last point.  Raises Doubt where it is not known."""
        if self._last is None:
            raise Doubt
        return self._last

    def advance(self, path: Path, goal: float, seen: Callable[[float], object]) -> str:
        """Add points to a path from its last one, stable and on its way to p = goal: 'to' if it gets there, 'limit' if it ends
        at a limit point before, '' if `paths` has to go on.  seen: gets the p of each point."""
        if path.points[-1] is not self._point:
            self._last = self._limit = None
        try:
            if self._last is None:
                self._last = self._state(path.points[-1], goal - path.points[-1].parameter)
            while self._here.parameter != goal:
                state, kind = self._next(goal)
                self._add(path, state, kind)
                seen(state.parameter)
                if kind == "limit":
                    return kind
        except Doubt:
            self._last = self._point = None
            return ""
        return "to"

    def arrived(self, free: np.ndarray, parameter: float, side: float) -> Point | None:
        """The stable equilibrium beside free coordinates (n,), as the first point of a path on which p grows (side > 0) or
        falls; None if there is none on the pieces that the strings have there."""
        laws = self.equations.laws
        self._last = self._limit = self._point = None
        on = laws.on(laws.piece_of(self.equations.elongation(free, parameter) + TOUCH))  # at an end: the piece beyond
        state = self._to_load(self.saddle.start(free, parameter), parameter, on)
        if state is None or on.left(state.elongation).any():
            return None
        try:
            self._last = self._watched(state, side) if len(on.curved) else state
        except Doubt:
            return None
        direction = _arrow(state.tangent[: self._n], self.scale, side)
        self._point = self._point_of(state, direction, 0.0, "")
        return self._point

    def _point_of(self, state: State, direction: np.ndarray, arc: float, kind: str) -> Point:
        equations, free, parameter, piece = self.equations, state.z[: self._n], state.parameter, state.laws.piece
        local = Local(equations, lambda: equations.at(free, parameter, piece), kind != "limit")
        return Point(float(parameter), free, piece, direction / math.sqrt(direction @ direction), local, arc, kind)

    def _state(self, point: Point, way: float) -> State:
        """A path's stable point as a state.  Raises Doubt."""
        saddle, laws, p = self.saddle, self.equations.laws.on(point.piece), point.parameter
        z = saddle.start(point.free, p)
        saddle.at(z, p, laws)
        found = saddle.solve()
        if found is None or not saddle.definite():
            raise Doubt
        state = State(z, p, laws, found[1], saddle.elongation)
        return self._watched(state, way) if len(laws.curved) else state

    def _add(self, path: Path, state: State, kind: str) -> None:
        """Make a state the path's next point."""
        before, n = self._here, self._n
        way = state.z[:n] - before.z[:n]
        arc = math.sqrt(way @ way + (self.scale * (state.parameter - before.parameter)) ** 2)
        if kind == "limit":
            direction = _arrow(state.rate[:n], 0.0, state.rate[:n] @ way)
        else:
            direction = _arrow(state.tangent[:n], self.scale, state.parameter - before.parameter)
        if state.laws is not before.laws:
            self._limit = None
        self._last, self._point = state, self._point_of(state, direction, path.points[-1].arc + arc, kind)
        path.points.append(self._point)

    # --- which point is next

    def _next(self, goal: float) -> tuple[State, str]:
        """The next state and its kind on the way to p = goal.  Raises Doubt."""
        found = self._stepped(goal)
        if found is None and len(self._here.laws.curved) and not self._here.softens(goal - self._here.parameter):
            self.saddle.at(self._here.z, self._here.parameter, self._here.laws)
            self._last = self._watched(self._here, goal - self._here.parameter)
            found = self._stepped(goal)
        if found is None:
            raise Doubt
        return found

    def _watched(self, state: State, way: float) -> State:
        """A state for which the system is set up, known by the elongation of the string that loses most stiffness on the way.
        Raises Doubt."""
        saddle, curved = self.saddle, state.laws.curved
        rates = (saddle.directions(curved) @ state.tangent[: self._n] - self._wound[curved]) * way
        string = int(curved[np.argmin(saddle.bend * rates)])
        found = saddle.bordered(saddle.direction(string))
        if found is None or not (saddle.definite() and found.pull[1] < 0.0):
            raise Doubt
        return self._bent(self._known_by(string, found, state.z, state.parameter, state.laws, state.elongation))

    def _stepped(self, goal: float) -> tuple[State, str] | None:
        """The next state after a step that is short enough."""
        here, n = self._here, self._n
        fastest = self.longest / math.sqrt(here.tangent[:n] @ here.tangent[:n] + self.scale**2)
        whole = goal - here.parameter
        for halving in range(HALVINGS + 1):
            way = math.copysign(min(abs(whole), fastest) * 0.5**halving, whole)
            found = self._within(way, goal if way == whole else here.parameter + way)
            if found is not None:
                return found
        return None

    def _within(self, way: float, goal: float) -> tuple[State, str] | None:
        """The next state if it lies within a change of p, with p = goal at its end."""
        here, size = self._here, way
        predict: Callable[[float], tuple[np.ndarray, float]] = here.moved
        limit: State | None = None
        if here.softens(way):
            predict, reached = here.lengthened, here.lengthening(way)
            size = 0.0 if reached is None else reached
            if reached is None:
                size = -here.load_rate / here.load_bow
                z, parameter = predict(size)
                elongation = self.equations.elongation(z[: self._n], parameter)
                if np.count_nonzero(self._here.laws.left(elongation)):
                    ended = self._first_end(predict, size, elongation, way, goal)
                    if ended is not None:
                        return ended
                limit = self._limit = self._limit or self._limit_point(way)
                if limit is None:
                    return self._nearer(size, way, goal)
                size = float(limit.elongation[here.string] - here.elongation[here.string])
        found: State | None
        if limit is not None and (limit.parameter - goal) * way <= 0.0:
            found, kind = limit, "limit"
        else:
            z = predict(size)[0] if limit is None else here.towards(limit, goal)
            elongation = self.equations.elongation(z[: self._n], goal)
            if np.count_nonzero(self._here.laws.left(elongation)):
                return self._first_end(predict, size, elongation, way, goal)
            found, kind = self._load_beside(z, goal), ""
            if found is None:
                return self._own_end(way, goal) if limit is None and here.softens(way) else None
        if np.count_nonzero(self._here.laws.left(found.elongation)):
            return self._first_end(predict, size, found.elongation, way, goal)
        return found, kind

    def _own_end(self, way: float, goal: float) -> tuple[State, str] | None:
        """The kink where the softening string leaves its piece, or the load just before."""
        here, string = self._here, self._here.string
        elongation = here.elongation.copy()
        longer = here.load_rate * way > 0.0
        end = float((here.laws.upper if longer else here.laws.lower)[string])
        if not math.isfinite(end):
            return None
        elongation[string] = end + math.copysign(2.0 * TOUCH, end - elongation[string])
        return self._first_end(here.lengthened, end - float(here.elongation[string]), elongation, way, goal)

    def _load_beside(self, guess: np.ndarray, goal: float) -> State | None:
        found = self._to_load(guess, goal, self._here.laws)
        return found if found is not None and self._near(found, guess) else None

    def _nearer(self, e: float, way: float, goal: float) -> tuple[State, str]:
        """A state on the way to a limit point that is thought to lie at a change of e.  Raises Doubt."""
        here, n = self._here, self._n
        direction = here.rate[:n] / math.sqrt(here.rate[:n] @ here.rate[:n])
        for part in NEARER:
            z, parameter = here.lengthened(part * e)
            found = self._at_distance(z, parameter, here.laws, direction, float(direction @ z[:n]))
            if found is None or not found.tangent[:n] @ here.tangent[:n] > 0.0:
                continue
            inside = (found.parameter - here.parameter) * way > 0.0 and (found.parameter - goal) * way < 0.0
            if inside and not np.count_nonzero(self._here.laws.left(found.elongation)):
                return self._watched(found, way), ""
        raise Doubt

    def _near(self, found: State, guess: np.ndarray) -> bool:
        """Whether a state is near its prediction, and the path has turned little."""
        here, n, scale = self._here, self._n, self.scale
        way, off = found.z[:n] - here.z[:n], found.z[:n] - guess[:n]
        length = way @ way + (scale * (found.parameter - here.parameter)) ** 2
        if off @ off > TURN**2 * length + 1e6 * SETTLED**2:
            return False
        a, b = here.tangent[:n], found.tangent[:n]
        along = a @ b + scale**2
        return along > 0.0 and along**2 > LEAST * (a @ a + scale**2) * (b @ b + scale**2)

    def _first_end(self, predict, size: float, elongation: np.ndarray, way: float, goal: float) -> tuple[State, str] | None:
        """The kink where the first string leaves its piece, on the way to these elongations."""
        here, laws, parameter = self._here, self._here.laws, self._here.parameter
        tried: list[int] = []
        gone = self._here.laws.left(elongation)
        z, p = predict(0.5 * size)
        middle = self.equations.elongation(z[: self._n], p)
        for _ in range(FIRST):
            strings = np.flatnonzero(gone)
            strings = strings[~np.isin(strings, tried)]
            if not len(strings):
                return None
            end = np.where(elongation > laws.upper, laws.upper, laws.lower)[strings]
            part = _crossing(here.elongation[strings], middle[strings], elongation[strings], end)
            first = int(np.argmin(part))
            string = int(strings[first])
            z, near = predict(float(part[first]) * size)
            found = self._to_end(z, near, laws, string, float(end[first]))
            if found is None or (found.parameter - parameter) * way < 0.0:
                return None
            gone = self._here.laws.left(found.elongation)
            if not gone.any():
                if (found.parameter - goal) * way <= 0.0:
                    return self._flipped(found, way), "kink"
                found = self._load_beside(here.towards(found, goal), goal)
                return None if found is None or np.count_nonzero(self._here.laws.left(found.elongation)) else (found, "")
            tried.append(string)
            elongation = np.where(gone, found.elongation, elongation)
        return None

    # --- Newton's method

    def _done(self, size: float, last: float) -> bool:
        return size <= SETTLED or (size <= NEARLY and size * (size / last) ** 2 <= CONVERGED)

    def _to_load(self, z: np.ndarray, parameter: float, laws: OnPieces) -> State | None:
        """The stable equilibrium at p on these pieces; None where Newton's method does not converge at once."""
        saddle, n, last = self.saddle, self._n, np.inf
        for _ in range(NEWTON):
            saddle.at(z, parameter, laws)
            string = self._softest(laws)
            found: Any  # of the system as it is, or bordered
            if string < 0:
                found = saddle.solve()
                step = None if found is None else found[0]
            else:
                found = saddle.bordered(saddle.direction(string))
                step = None if found is None else found.way[0] - found.way[1] / found.pull[1] * found.pull[0]
            if step is None:
                return None
            size = math.sqrt(step[:n] @ step[:n])
            if not size < 0.5 * last:
                return None
            z = z + step
            if self._done(size, last):
                break
            last = size
        else:
            return None
        if not saddle.definite() or (string >= 0 and not found.pull[1] < 0.0):
            return None
        elongation = self.equations.elongation(z[:n], parameter)
        if string < 0:
            state = State(z, parameter, laws, found[1], elongation)
        else:
            state = self._bent(self._known_by(string, found, z, parameter, laws, elongation))
        here = self._last
        if string < 0 and here is not None and here.laws is laws and here.parameter != parameter:
            state.curvature = (state.tangent - here.tangent) / (parameter - here.parameter)
        return state

    def _softest(self, laws: OnPieces) -> int:
        """The string that has lost most of its stiffness since the last state, -1 if none has lost much."""
        saddle, here, curved = self.saddle, self._last, laws.curved
        if here is None or here.laws is not laws or not len(curved):
            return -1
        change = saddle.bend * (saddle.elongation[curved] - here.elongation[curved])
        worst = int(np.argmin(change))
        string = int(curved[worst])
        return string if change[worst] < -SOFTER * abs(saddle.stiffness[string]) else -1

    def _known_by(self, string: int, found: Bordered, z, parameter: float, laws: OnPieces, elongation) -> State:
        """A state known by a string's elongation, from the system bordered by it."""
        saddle, wound = self.saddle, self._wound[string]
        (pull, nu), reserve = found.pull, -found.pull[1]
        lever, push = found.push[1] + wound * nu, found.push[0] + wound * pull
        rate = reserve / lever * push + pull
        bends, tangent, stiffness = np.zeros(len(elongation)), rate * (lever / reserve), float(saddle.stiffness[string])
        bends[laws.curved] = saddle.bend
        known = elongation, 0.0, string, reserve, lever, rate, push, bends, stiffness
        return State(z, parameter, laws, tangent, *known)

    def _bent(self, state: State) -> State:
        """A state with its second derivatives, as the strings' laws make them; the system is still that of the state."""
        saddle, curved = self.saddle, state.laws.curved
        if len(curved):
            directions = saddle.directions(curved)
            rates = directions @ state.rate[: self._n] - self._wound[curved] * state.load_rate
            bow, nu = saddle.again(-(state.bends[curved] * rates * rates) @ directions)
            state.load_bow = -nu / state.lever
            state.bow = bow + state.load_bow * state.push
            state.curvature = (state.bow - state.load_bow * state.tangent) / state.load_rate**2
        return state

    def _towards(self, found: Bordered, wound: float, gap: float) -> tuple[np.ndarray, float]:
        """dz and dp to equilibrium at a distance (m) along the direction that borders the system; wound: m per p, by how much
        more as p grows."""
        (way, nu), (push, nu_push), (pull, nu_pull) = found
        p = -(nu + gap * nu_pull) / (nu_push + wound * nu_pull)
        return way + p * push + (gap + wound * p) * pull, p

    def _at_distance(self, z, parameter: float, laws: OnPieces, direction: np.ndarray, goal: float) -> State | None:
        """The stable equilibrium with a given direction . x (m)."""
        n = self._n
        reached = self._solved(z, parameter, laws, lambda z: (direction, 0.0, goal - float(direction @ z[:n])))
        if reached is None:
            return None
        z, parameter, found = reached
        tangent = found.push[0] - found.push[1] / found.pull[1] * found.pull[0]
        return State(z, parameter, laws, tangent, self.equations.elongation(z[:n], parameter))

    def _to_end(self, z, parameter: float, laws: OnPieces, string: int, end: float) -> State | None:
        """The stable equilibrium at which a string has an elongation."""
        saddle = self.saddle
        reached = self._solved(
            z,
            parameter,
            laws,
            lambda z: (saddle.direction(string), self._wound[string], end - float(saddle.elongation[string])),
        )
        if reached is None:
            return None
        z, parameter, found = reached
        return self._known_by(string, found, z, parameter, laws, self.equations.elongation(z[: self._n], parameter))

    def _solved(self, z, parameter: float, laws: OnPieces, condition):
        """Newton's method for a stable equilibrium under a condition on x and the parameter: (z, parameter, bordered solution),
        or None.  condition(z), asked once the saddle stands at z: its direction, how it changes with the parameter, its gap."""
        saddle, n, last = self.saddle, self._n, np.inf
        for _ in range(NEWTON):
            saddle.at(z, parameter, laws)
            direction, wound, gap = condition(z)
            found = saddle.bordered(direction)
            if found is None:
                return None
            step, p = self._towards(found, wound, gap)
            size = math.sqrt(step[:n] @ step[:n] + (self.scale * p) ** 2)
            if not size < 0.5 * last:
                return None
            z, parameter = z + step, parameter + p
            if self._done(size, last):
                return (z, parameter, found) if saddle.definite() and found.pull[1] < 0.0 else None
            last = size
        return None

    # --- kinks

    def _flipped(self, kink: State, way: float) -> State:
        """The state at a kink on the pieces of the way on.  Raises Doubt."""
        laws, elongation, string = kink.laws, kink.elongation, kink.string
        low, high = np.abs(elongation - laws.lower) <= TOUCH, np.abs(elongation - laws.upper) <= TOUCH
        low[string] |= not high[string]
        touching = np.flatnonzero(low | high)
        piece = laws.piece.copy()
        piece[high] += 1
        piece[low] -= 1
        new = self.equations.laws.on(piece)
        if len(touching) > 1:
            return self._anew(kink, new, touching, high, way)
        outward = 1.0 if high[string] else -1.0
        _, stiffnesses, bend = new(elongation)
        stiffness = float(stiffnesses[string])
        reserve = kink.reserve + stiffness - kink.stiffness
        if not (kink.load_rate * way * outward > 0.0 and reserve > 0.0):
            raise Doubt
        rate = kink.rate + (reserve - kink.reserve) / kink.lever * kink.push
        kink.bends[:] = 0.0
        kink.bends[new.curved] = bend
        return self._bent(
            replace(kink, laws=new, reserve=reserve, rate=rate, tangent=rate * (kink.lever / reserve), stiffness=stiffness)
        )

    def _anew(self, kink: State, laws: OnPieces, touching: np.ndarray, high: np.ndarray, way: float) -> State:
        """The same where several strings arrive together: the system is solved anew on these pieces.  Raises Doubt.

        If every string gets stiffer, or every one softer, the tangent stiffness is positive definite on all mixtures of
        the pieces, too, so there is no other way on.
        """
        saddle = self.saddle
        before = saddle.stiffness[touching]
        saddle.at(kink.z, kink.parameter, laws)
        found = saddle.bordered(saddle.direction(kink.string))
        if found is None or not (saddle.definite() and found.pull[1] < 0.0):
            raise Doubt
        state = self._known_by(kink.string, found, kink.z, kink.parameter, laws, kink.elongation)
        change = saddle.stiffness[touching] - before
        rates = saddle.directions(touching) @ state.tangent[: self._n] - self._wound[touching]
        outward = np.where(high[touching], 1.0, -1.0) * way * rates
        if not ((outward > 0.0).all() and ((change >= 0.0).all() or (change <= 0.0).all())):
            raise Doubt
        return self._bent(state)

    # --- limit points

    def _limit_point(self, way: float) -> State | None:
        """The limit point to which a softening state leads: the root of dp/da over the distance a along the state's tangent."""
        here, saddle, n = self._here, self.saddle, self._n
        laws, e = here.laws, -here.load_rate / here.load_bow
        length = math.sqrt(here.rate[:n] @ here.rate[:n])
        direction = here.rate[:n] / length
        z, parameter = here.lengthened(e)
        before = 0.0, here.load_rate / length
        for _ in range(ROOT):
            saddle.at(z, parameter, laws)
            found = saddle.bordered(direction)
            if found is None:
                return None
            reserve, lever = -found.pull[1], found.push[1]
            at, slope = float(direction @ (z[:n] - here.z[:n])), reserve / lever
            change = at - before[0]
            if not change or slope == before[1] or abs(slope) > 0.5 * abs(before[1]):
                return None
            gap, before = -slope * change / (slope - before[1]), (at, slope)
            step, p = self._towards(found, 0.0, gap)
            size = math.sqrt(step[:n] @ step[:n] + (self.scale * p) ** 2)
            if not size <= self.longest:
                return None
            z, parameter = z + step, parameter + p
            flat = abs(p) <= RESOLVED * abs(parameter) and abs(reserve) <= RESOLVED * self.equations.stiffest
            if size <= SHARP or (flat and size <= FLAT):
                break
        else:
            return None
        if not saddle.definite() or (parameter - here.parameter) * way < 0.0:
            return None
        rate, elongation = slope * found.push[0] + found.pull[0], self.equations.elongation(z[:n], parameter)
        return State(z, parameter, laws, rate, elongation, string=here.string, rate=rate)
