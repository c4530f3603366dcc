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

from dataclasses import dataclass, replace

import numpy as np

from .paths import LONGEST, SETTLED, TOUCH, TURN, Local, Path, Point
from .saddle import Bordered, Saddle
from .string_laws import OnPieces

NEWTON = 5  # iterations: the predictions are good, or it is better to give up
NEARLY, CONVERGED = 1e-7, 1e-12  # m: a step that small is the last if, by quadratic convergence, the next would be that small
ROOT = 12  # iterations for a limit point
FIRST = 3  # strings that are tried as the first to leave its piece
SOFTER = 0.05  # a string that loses more of its stiffness from one state to the next is watched
HALVINGS = 2  # of a step that turns too much


@dataclass
class State:
    """A stable equilibrium, or a limit point: unknowns z and their derivative by p, (n+B,); stretch: (S,) m.

    string: by whose elongation e the path is known, -1: none; reserve: N/m, of that string; rate: dz/de; lever: dp/de is
    the reserve over it; push: by how much dz/de grows with dp/de; stiffness, bend: N/m, N/m2, of the string.
    """

    z: np.ndarray
    parameter: float
    laws: OnPieces
    tangent: np.ndarray
    stretch: np.ndarray
    curvature: np.ndarray | float = 0.0
    string: int = -1
    reserve: float = 0.0
    rate: np.ndarray | None = None
    lever: float = 1.0
    push: np.ndarray | None = None
    stiffness: float = 0.0
    bend: float = 0.0

    @property
    def load_rate(self) -> float:
        """dp/de."""
        return self.reserve / self.lever

    def softens(self, way: float) -> bool:
        """Whether its string loses stiffness as p changes this way."""
        return self.string >= 0 and self.bend * self.load_rate * way < 0.0

    def moved(self, p: float) -> tuple[np.ndarray, float]:
        """z and p predicted for a change of p."""
        return self.z + p * (self.tangent + (0.5 * p) * self.curvature), self.parameter + p

    def stretched(self, e: float) -> tuple[np.ndarray, float]:
        """z and p predicted for a change of e, the other strings' laws taken as straight."""
        gain = 0.5 * self.bend / self.lever * e * e
        return self.z + e * self.rate + gain * self.push, self.parameter + self.load_rate * e + gain

    def towards(self, other: State, parameter: float) -> np.ndarray:
        """z predicted at a p between this state and another: quadratic between them, over e or p."""
        change = other.z - self.z
        if self.string < 0 or other.string != self.string:
            part = (parameter - self.parameter) / (other.parameter - self.parameter)
            first = (other.parameter - self.parameter) * self.tangent
        else:
            e = float(other.stretch[self.string] - self.stretch[self.string])
            a, b = self.load_rate * e, other.parameter - self.parameter
            p = parameter - self.parameter  # a t + (b - a) t^2
            part = 2.0 * p / (a + np.copysign(np.sqrt(max(a * a + 4.0 * (b - a) * p, 0.0)), a))
            first = e * self.rate
        return self.z + part * (first + part * (change - first))

    def elongation(self, p: float) -> float | None:
        """The change of e predicted for a change of p; None where p does not get there."""
        rest = self.load_rate**2 + 2.0 * self.bend / self.lever * p
        return 2.0 * p / (self.load_rate + np.copysign(np.sqrt(rest), self.load_rate)) if rest > 0.0 else None


class LoadSteps:
    """Follows stable paths of one system of equations."""

    def __init__(self, equations, scale: float):
        self.equations, self.scale, self.saddle = equations, scale, Saddle(equations)
        self.longest = LONGEST * float(equations.model.bar_length.min())
        self._n, self._wound = equations.size, equations.loading.rest_length_direction
        self._here: State | None = None
        self._point: Point | None = None
        self._limit: State | None = None

    def advance(self, path: Path, goal: float) -> str:
        """Add points to a path from its last one, stable and on its way to p = goal: 'to' if it gets there, 'limit' if it ends
        at a limit point before, '' if `paths` has to go on."""
        if path.points[-1] is not self._point:
            self._here, self._limit = self._state(path.points[-1]), None
        while self._here is not None and self._here.parameter != goal:
            found = self._next(goal)
            if found is None:
                self._here = self._point = None
                return ""
            self._add(path, *found)
            if found[1] == "limit":
                return "limit"
        return "" if self._here is None else "to"

    def _state(self, point: Point) -> State | None:
        """A path's point as a state."""
        laws = self.equations.laws.on(point.piece)
        return self._to_load(self.saddle.start(point.free, point.parameter), point.parameter, laws)

    def _add(self, path: Path, state: State, kind: str) -> None:
        """Make a state the path's next point."""
        before, n = self._here, self._n
        way = state.z[:n] - before.z[:n]
        arc = float(np.sqrt(way @ way + (self.scale * (state.parameter - before.parameter)) ** 2))
        if kind == "limit":
            sign = np.copysign(1.0, state.stretch[state.string] - before.stretch[state.string])
            direction = np.append(sign * state.rate[:n], 0.0)
        else:
            sign = np.copysign(1.0, state.parameter - before.parameter)
            direction = np.append(sign * state.tangent[:n], sign * self.scale)
        direction /= np.sqrt(direction @ direction)
        equations, free, parameter, piece = self.equations, state.z[:n], state.parameter, state.laws.piece
        if state.laws is not before.laws:
            self._limit = None
        local = Local(equations, lambda: equations.at(free, parameter, piece), kind != "limit")
        self._here, self._point = state, Point(parameter, free, piece, direction, local, path.points[-1].arc + arc, kind)
        path.points.append(self._point)

    # --- which point is next

    def _next(self, goal: float) -> tuple[State, str] | None:
        """The next state and its kind on the way to p = goal; None where it is not found."""
        found = self._stepped(goal)
        if found is None and len(self._here.laws.curved) and not self._here.softens(goal - self._here.parameter):
            here = self._watched(self._here, goal - self._here.parameter)
            if here is not None:
                self._here = here
                found = self._stepped(goal)
        return found

    def _watched(self, state: State, way: float) -> State | None:
        """The same state, known by the elongation of the string that loses most stiffness on the way on."""
        saddle, curved = self.saddle, state.laws.curved
        saddle.at(state.z, state.parameter, state.laws)
        rates = (saddle.directions(curved) @ state.tangent[: self._n] - self._wound[curved]) * way
        string = int(curved[np.argmin(saddle.bend * rates)])
        found = saddle.bordered(saddle.direction(string))
        if found is None or not (saddle.definite() and found.pull[1] < 0.0):
            return None
        return self._bordered_state(state.z, state.parameter, state.laws, state.stretch, string, found)

    def _stepped(self, goal: float) -> tuple[State, str] | None:
        """The next state after a step that is short enough."""
        here, n = self._here, self._n
        fastest = self.longest / np.sqrt(here.tangent[:n] @ here.tangent[:n] + self.scale**2)
        for halving in range(HALVINGS + 1):
            way = goal - here.parameter
            if abs(way) > fastest * 0.5**halving:
                way = np.copysign(fastest * 0.5**halving, way)
            found = self._within(way, goal if way == goal - here.parameter else here.parameter + way)
            if found is not None:
                return found
        return None

    def _within(self, way: float, goal: float) -> tuple[State, str] | None:
        """The next state if it lies within a change of p, with p = goal at its end."""
        here, predict, size, limit = self._here, self._here.moved, way, None
        if here.softens(way):
            predict, size = here.stretched, here.elongation(way)
            if size is None:
                size = -here.reserve / here.bend
                z, parameter = predict(size)
                stretch = self.equations.stretch(z[: self._n], parameter)
                if self._gone(stretch).any():
                    return self._first_end(predict, size, stretch, way, goal)
                limit = self._limit = self._limit or self._limit_point(way)
                if limit is None:
                    return None
                size = float(limit.stretch[here.string] - here.stretch[here.string])
        if limit is not None and (limit.parameter - goal) * way <= 0.0:
            found, kind = limit, "limit"
        else:
            z = predict(size)[0] if limit is None else here.towards(limit, goal)
            stretch = self.equations.stretch(z[: self._n], goal)
            if self._gone(stretch).any():
                return self._first_end(predict, size, stretch, way, goal)
            found, kind = self._load_beside(z, goal), ""
            if found is None:
                return None
        if self._gone(found.stretch).any():
            return self._first_end(predict, size, found.stretch, way, goal)
        return found, kind

    def _load_beside(self, guess: np.ndarray, goal: float) -> State | None:
        found = self._to_load(guess, goal, self._here.laws)
        return found if found is not None and self._near(found, guess) else None

    def _gone(self, stretch: np.ndarray) -> np.ndarray:
        """(S,) bool: strings past the ends of their pieces."""
        laws = self._here.laws
        return (stretch < laws.lower - TOUCH) | (stretch > laws.upper + TOUCH)

    def _near(self, found: State, guess: np.ndarray) -> bool:
        """Whether a state is near its prediction, and the path has turned little."""
        here, n, scale = self._here, self._n, self.scale
        way, off = found.z[:n] - here.z[:n], found.z[:n] - guess[:n]
        length = way @ way + (scale * (found.parameter - here.parameter)) ** 2
        if off @ off > TURN**2 * length + 1e6 * SETTLED**2:
            return False
        a, b = here.tangent[:n], found.tangent[:n]
        along = a @ b + scale**2
        return along > 0.0 and along**2 > np.cos(3.0 * TURN) ** 2 * (a @ a + scale**2) * (b @ b + scale**2)

    def _first_end(self, predict, size: float, stretch: np.ndarray, way: float, goal: float) -> tuple[State, str] | None:
        """The kink where the first string leaves its piece, on the way to these elongations."""
        here, laws = self._here, self._here.laws
        tried: list[int] = []
        gone = self._gone(stretch)
        for _ in range(FIRST):
            end = np.where(stretch > laws.upper, laws.upper, laws.lower)
            with np.errstate(divide="ignore", invalid="ignore"):
                part = np.where(gone, (end - here.stretch) / (stretch - here.stretch), np.inf)
            part[tried] = np.inf
            first = int(np.argmin(part))
            if not np.isfinite(part[first]):
                return None
            guess = predict(min(max(float(part[first]), 0.0), 1.0) * size)
            found = self._to_end(*guess, laws, first, float(end[first]))
            if found is None or (found.parameter - here.parameter) * way < 0.0:
                return None
            gone = self._gone(found.stretch)
            if not gone.any() and (found.parameter - goal) * way > 0.0:
                found = self._load_beside(here.towards(found, goal), goal)
                return None if found is None or self._gone(found.stretch).any() else (found, "")
            if not gone.any():
                return (flipped, "kink") if (flipped := self._flipped(found, way)) is not None else None
            tried.append(first)
            stretch = found.stretch
        return None

    # --- Newton's method

    def _done(self, size: float, last: float) -> bool:
        return size <= SETTLED or size <= NEARLY and size * (size / last) ** 2 <= CONVERGED

    def _to_load(self, z: np.ndarray, parameter: float, laws: OnPieces) -> State | None:
        """The stable equilibrium at p on these pieces; None where Newton's method does not converge at once."""
        saddle, n, last = self.saddle, self._n, np.inf
        for _ in range(NEWTON):
            saddle.at(z, parameter, laws)
            string = self._softest(laws)
            if string < 0:
                found = saddle.solve()
                step = None if found is None else found[0]
            else:
                found = saddle.bordered(saddle.direction(string))
                step = None if found is None else found.way[0] - found.way[1] / found.pull[1] * found.pull[0]
            if step is None:
                return None
            size = float(np.sqrt(step[:n] @ step[:n]))
            if not size < 0.5 * last:
                return None
            z = z + step
            if self._done(size, last):
                break
            last = size
        else:
            return None
        if not saddle.definite() or string >= 0 and not found.pull[1] < 0.0:
            return None
        stretch = self.equations.stretch(z[:n], parameter)
        if string < 0:
            state = State(z, parameter, laws, found[1], stretch)
        else:
            state = self._bordered_state(z, parameter, laws, stretch, string, found)
        here = self._here
        if here is not None and here.laws is laws and here.parameter != parameter:
            state.curvature = (state.tangent - here.tangent) / (parameter - here.parameter)
        return state

    def _softest(self, laws: OnPieces) -> int:
        """The string that has lost most of its stiffness since the last state, -1 if none has lost much."""
        saddle, here, curved = self.saddle, self._here, laws.curved
        if here is None or here.laws is not laws or not len(curved):
            return -1
        change = saddle.bend * (saddle.stretch[curved] - here.stretch[curved])
        worst = int(np.argmin(change))
        string = int(curved[worst])
        return string if change[worst] < -SOFTER * abs(saddle.stiffness[string]) else -1

    def _bordered_state(self, z, parameter, laws, stretch, string: int, found: Bordered) -> State:
        """A state known by a string's elongation."""
        saddle, wound = self.saddle, self._wound[string]
        (pull, nu), reserve = found.pull, -found.pull[1]
        lever = found.push[1] + wound * nu
        push = found.push[0] + wound * pull
        rate = reserve / lever * push + pull
        at = np.flatnonzero(laws.curved == string)
        bend = float(saddle.bend[at[0]]) if len(at) else 0.0
        tangent = rate * (lever / reserve)
        return State(z, parameter, laws, tangent, stretch, 0.0, string, reserve, rate, lever, push,
                     float(saddle.stiffness[string]), bend)  # fmt: skip

    def _towards(self, found: Bordered, string: int, gap: float) -> tuple[np.ndarray, float]:
        """dz and dp to equilibrium with a string longer by the gap (m)."""
        wound = self._wound[string]
        (way, nu), (push, nu_push), (pull, nu_pull) = found
        p = -(nu + gap * nu_pull) / (nu_push + wound * nu_pull)
        return way + p * push + (gap + wound * p) * pull, p

    def _to_end(self, z, parameter: float, laws: OnPieces, string: int, end: float) -> State | None:
        """The stable equilibrium at which a string has an elongation."""
        saddle, n, last = self.saddle, self._n, np.inf
        for _ in range(NEWTON):
            saddle.at(z, parameter, laws)
            found = saddle.bordered(saddle.direction(string))
            if found is None:
                return None
            step, p = self._towards(found, string, end - float(saddle.stretch[string]))
            size = float(np.sqrt(step[:n] @ step[:n] + (self.scale * p) ** 2))
            if not size < 0.5 * last:
                return None
            z, parameter = z + step, parameter + p
            if self._done(size, last):
                break
            last = size
        else:
            return None
        if not (saddle.definite() and found.pull[1] < 0.0):
            return None
        return self._bordered_state(z, parameter, laws, self.equations.stretch(z[:n], parameter), string, found)

    # --- kinks

    def _flipped(self, kink: State, way: float) -> State | None:
        """The state at a kink on the pieces of the way on; None where these are in doubt."""
        laws, stretch, string = kink.laws, kink.stretch, kink.string
        low, high = np.abs(stretch - laws.lower) <= TOUCH, np.abs(stretch - laws.upper) <= TOUCH
        low[string] |= not high[string]
        touching = np.flatnonzero(low | high)
        piece = laws.piece.copy()
        piece[high] += 1
        piece[low] -= 1
        new = self.equations.laws.on(piece)
        if len(touching) > 1:
            return self._anew(kink, new, touching, high, way)
        outward = 1.0 if high[string] else -1.0
        _, stiffness, bend = self.equations.laws.one(string, int(piece[string]), float(stretch[string]))
        reserve = kink.reserve + stiffness - kink.stiffness
        if not (kink.load_rate * way * outward > 0.0 and reserve > 0.0):
            return None
        rate = kink.rate + (reserve - kink.reserve) / kink.lever * kink.push
        return replace(kink, laws=new, reserve=reserve, rate=rate, tangent=rate * (kink.lever / reserve), stiffness=stiffness,
                       bend=bend)  # fmt: skip

    def _anew(self, kink: State, laws: OnPieces, touching: np.ndarray, high: np.ndarray, way: float) -> State | None:
        """The same where several strings arrive together: the system is solved anew on these pieces.

        If every string gets stiffer, or every one softer, the tangent stiffness is positive definite on all mixtures of
        the pieces, too, so there is no other way on.
        """
        saddle = self.saddle
        before = saddle.stiffness[touching]
        saddle.at(kink.z, kink.parameter, laws)
        found = saddle.bordered(saddle.direction(kink.string))
        if found is None or not (saddle.definite() and found.pull[1] < 0.0):
            return None
        state = self._bordered_state(kink.z, kink.parameter, laws, kink.stretch, kink.string, found)
        change = saddle.stiffness[touching] - before
        rates = saddle.directions(touching) @ state.tangent[: self._n] - self._wound[touching]
        outward = np.where(high[touching], 1.0, -1.0) * way * rates
        return state if (outward > 0.0).all() and ((change >= 0.0).all() or (change <= 0.0).all()) else None

    # --- limit points

    def _limit_point(self, way: float) -> State | None:
        """The limit point that the string on its falling piece leads to: the root of its reserve over its elongation."""
        here, saddle, n = self._here, self.saddle, self._n
        string, laws = here.string, here.laws
        if here.bend == 0.0:
            return None
        e = -here.reserve / here.bend
        (z, parameter), before = here.stretched(e), None
        for _ in range(ROOT):
            saddle.at(z, parameter, laws)
            found = saddle.bordered(saddle.direction(string))
            if found is None:
                return None
            state = self._bordered_state(z, parameter, laws, saddle.stretch, string, found)
            at = float(saddle.stretch[string])
            change = None if before is None else at - before[0]
            slope = state.bend if not change else (state.reserve - before[1]) / change
            if slope == 0.0:
                return None
            before = at, state.reserve
            gap = -state.reserve / slope
            step, p = self._towards(found, string, gap)
            size = float(np.sqrt(step[:n] @ step[:n] + (self.scale * p) ** 2))
            if not size <= self.longest:
                return None
            z, parameter = z + step, parameter + p
            if size <= NEARLY:
                break
        else:
            return None
        if not saddle.definite() or (parameter - here.parameter) * way < 0.0:
            return None
        return replace(state, z=z, parameter=parameter, stretch=self.equations.stretch(z[:n], parameter))
