"""Equilibrium paths: steady states under a load that grows, solved instead of waited for.

A `Loading` moves external forces and rest lengths with one parameter p.  Equilibria over p form a path; `follow` traces it
by pseudo-arclength continuation (Keller 1977; Allgower and Georg, "Introduction to numerical continuation methods", 2003,
chapters 2, 6 and 8), so it turns round at limit points and goes on along unstable branches.

Between the ends of the pieces of the strings' force curves (slack and taut, the pieces of an NSH) everything is smooth.
As in the dynamics, each string keeps its piece over a step, its law going on smoothly beyond the end; where a string
passes the end of its piece, the path is solved for the point where it arrives there, the piece changes, and the path goes
on from that point with the tangent of the new pieces.  So no corrector ever straddles a kink.

On the path these points are special:

* kink: a string changes its piece;
* limit: p has an extremum; under growing load a stable path ends there (a snap), the tangent stiffness is singular;
* loose: strings go slack, and what is left has motions that nothing resists; the path ends in a continuum of equilibria;
* branch: an eigenvalue of the tangent stiffness passes zero while p goes on, as at the buckling of a symmetric structure;
  other paths cross there, `branches` follows them.

Limit and branch points are roots along the arc of dp/ds, or of the eigenvalue; they are found to round-off.
A path is measured in metres: ds^2 = |dx|^2 + (c dp)^2 with the free nodes' coordinates x, c = `scale`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .. import statics
from ..laws.string_laws import TOUCH
from ..model import Model
from ..quantities import array_of, number
from .equilibrium import Equations
from .loading import Loading
from .points import SETTLED, SINGULAR, Local, PathError, Point, _direction, _point, bordered, newton

LONGEST = 0.02  # longest step, as part of the shortest bar
WHOLE_WAY = 0.05  # what all of p's way weighs in the arc, as part of the shortest bar
SHORTEST = 1e-12  # shortest step, m
TURN = 0.2  # rad: a step over which the path's direction turns by more is repeated shorter
CRITICAL = 1e4  # eigenvalues below so many times their round-off vanish at a branch point
ASIDE = 1e-3  # how far beside a branch point another path is looked for, as part of the shortest bar
MOST_POINTS = 20_000
LOCATED = ("limit", "branch")  # points from which a step need not look for others
INWARD = 1e-9  # m/m: a string that leaves the end of its piece more slowly does not leave it
MOST_TOUCHING = 8  # strings that arrive at the ends of their pieces together


@dataclass
class Path:
    """Points in the order in which they were met, and why the path ends: 'to' (p reached its goal), 'from' (p came back
    past its start), 'loose' (see the module), 'points' (as many as allowed) or, where it was to end with its stability,
    'limit', 'branch' or 'kink', with its instability 'stable' or 'kink'."""

    equations: Equations
    scale: float
    points: list[Point] = field(default_factory=list)
    end: str = ""

    @property
    def parameters(self) -> np.ndarray:
        return np.array([p.parameter for p in self.points])

    @property
    def nodes(self) -> np.ndarray:
        """(K, N, 3) m."""
        return np.array([self.equations.nodes(p.free) for p in self.points])

    @property
    def stable(self) -> np.ndarray:
        """(K,) bool."""
        return np.array([p.stable for p in self.points])

    def special(self, kind: str) -> list[Point]:
        return [p for p in self.points if p.kind == kind]

    def at(self, parameter: float) -> list[Point]:
        """Every equilibrium of the path at this p, in order of arc, stable or not; solved, not interpolated."""
        found = []
        for before, after in zip(self.points, self.points[1:]):
            low, high = sorted((before.parameter, after.parameter))
            if low <= parameter < high or (parameter == after.parameter and after is self.points[-1]):
                found.append(between(self.equations, self.scale, before, after, parameter))
        return found


def between(equations: Equations, scale: float, before: Point, after: Point, parameter: float) -> Point:
    """The equilibrium at p between two neighbouring points: Newton's method at that p; where this leaves the part
    between the points, as it may beside a limit point, a root along the arc."""
    span = after.parameter - before.parameter
    part = 0.0 if span == 0.0 else (parameter - before.parameter) / span
    guess = equations.moved(before.free, _interpolated(scale, before, after, part))
    hold = np.append(np.zeros(equations.size), 1.0)
    solved = newton(equations, scale, guess, parameter, before.piece, hold, SETTLED)
    way = after.free - before.free
    if solved is None or np.linalg.norm(solved[0] - before.free - 0.5 * way) > 0.6 * np.linalg.norm(way) + 1e3 * SETTLED:
        follower = _Follower(equations, scale, before, np.inf)
        found = follower.root(before, after, lambda p: p.parameter - parameter, "", 1e-14)
        if found is None:
            raise PathError(f"no equilibrium was found at p = {parameter!r} between two points of the path")
        return found._replace(parameter=parameter)
    arc = before.arc + part * (after.arc - before.arc)
    point = _point(equations, scale, *solved, before.piece, before.direction, arc, "")
    if point is None:
        raise PathError(f"the path has no direction at p = {parameter!r}; ask for a load beside it")
    return point


def _interpolated(scale: float, before: Point, after: Point, part: float) -> np.ndarray:
    """(n,) way from a point at a part of the change of p: a cubic with the tangents at both points; a chord where p turns."""
    way, span = after.free - before.free, scale * (after.parameter - before.parameter)
    ends = [p.direction[:-1] * (span / p.direction[-1]) if p.direction[-1] else np.inf * way for p in (before, after)]
    if after.kind == "kink":
        ends[1] = 2.0 * way - ends[0]  # the tangent at a kink is that of the way on
    if not all(np.linalg.norm(end) < 3.0 * np.linalg.norm(way) for end in ends):
        return part * way
    return part * way + part * (1.0 - part) * ((1.0 - part) * (ends[0] - way) + part * (way - ends[1]))


class _Follower:
    """Traces one path from a point on."""

    def __init__(self, equations: Equations, scale: float, start: Point, longest: float):
        self.equations, self.scale, self.longest = equations, scale, longest
        self.path = Path(equations, scale, [start])
        self.step = 0.25 * longest

    @property
    def here(self) -> Point:
        return self.path.points[-1]

    def advance(self) -> list[Point]:
        """The next point, after the limit and branch points on the way to it.  Raises PathError where no step succeeds."""
        while True:
            if self.step < SHORTEST:
                raise PathError(
                    f"the path cannot be followed beyond p = {self.here.parameter!r}: a step of "
                    f"{self.step:.1e} m fails; try other loads, or start from another state"
                )
            trial = self._corrected(self.here, self.step, self._bend())
            turn = np.inf if trial is None else _angle(self.here.direction, trial.direction)
            if trial is None or turn > TURN:
                self.step *= 0.25 if not np.isfinite(turn) or turn > 4.0 * TURN else 0.5
                continue
            trial = self._arrival(self.here, trial)
            special = None if trial is None else [] if self.here.kind in LOCATED else self._special(self.here, trial)
            if trial is None or special is None:
                self.step *= 0.25
                continue
            self.step = min(self.longest, self.step * min(2.0, 0.6 * TURN / max(turn, 1e-9)))
            return [*special, trial]

    def _bend(self) -> np.ndarray | float:
        """(n+1,) 1/m, how the direction has changed over the last step; 0 where it was on other pieces."""
        before, here = self.path.points[-2:] if len(self.path.points) > 1 else self.path.points * 2
        if here.arc <= before.arc or here.kind == "kink" or not np.array_equal(before.piece, here.piece):
            return 0.0
        return (here.direction - before.direction) / (here.arc - before.arc)

    def _corrected(self, base: Point, step: float, bend: np.ndarray | float = 0.0) -> Point | None:
        """The path's point at a distance along the tangent at `base`, on the same pieces; bend: guess of its curvature."""
        way = step * (base.direction + 0.5 * step * bend)
        guess = self.equations.moved(base.free, way[:-1])
        parameter = base.parameter + way[-1] / self.scale
        for least in (False, True):
            solved = newton(self.equations, self.scale, guess, parameter, base.piece, base.direction, SETTLED, None, least)
            if solved and self._apart(solved[0], solved[1], guess, parameter) <= TURN * abs(step) + 1e3 * SETTLED:
                return _point(self.equations, self.scale, *solved, base.piece, base.direction, base.arc + step, "")
        return None

    def _apart(self, free, parameter, other_free, other_parameter) -> float:
        """m between two points."""
        return float(np.hypot(np.linalg.norm(free - other_free), self.scale * (parameter - other_parameter)))

    # --- kinks

    def _arrival(self, base: Point, trial: Point) -> Point | None:
        """The kink at which the first string leaves its piece between the two points, or `trial` where none does; None
        where a string leaves, but its kink is not found."""
        end = self.equations.elongation(trial.free, trial.parameter)
        on = self.equations.laws.on(base.piece)
        gone = on.left(end)
        if not gone.any():
            return trial
        start = self.equations.elongation(base.free, base.parameter)
        tried: set[int] = set()
        while gone.any():
            goal = np.where(end > on.upper, on.upper, on.lower)
            with np.errstate(divide="ignore", invalid="ignore"):
                part = np.where(gone, (goal - start) / (end - start), np.inf)
            part[list(tried)] = np.inf
            first = int(np.argmin(part))
            if not np.isfinite(part[first]):
                return None
            tried.add(first)
            found = self._at_end(base, trial, float(np.clip(part[first], 0.0, 1.0)), first, float(goal[first]))
            if found is None:
                continue
            free, parameter, _ = found
            elongation = self.equations.elongation(free, parameter)
            beyond = on.left(elongation)
            if not beyond.any():
                return self._kink(base, trial, part[first], free, parameter, elongation)
            end, gone = np.where(beyond, elongation, end), beyond
        return trial

    def _at_end(self, base: Point, trial: Point, part: float, string: int, goal: float):
        """Where between the points the string has an elongation."""
        guess = self.equations.moved(base.free, part * (trial.free - base.free))
        parameter = base.parameter + part * (trial.parameter - base.parameter)
        found = newton(self.equations, self.scale, guess, parameter, base.piece, None, SETTLED, (string, goal))
        length = self._apart(base.free, base.parameter, trial.free, trial.parameter)
        if found is None or self._apart(found[0], found[1], guess, parameter) > TURN * length + 1e3 * SETTLED:
            return None
        return found

    def _kink(self, base, trial, part, free, parameter, elongation) -> Point:
        """The point with the pieces, and the tangent, of the way on."""
        on = self.equations.laws.on(base.piece)
        low, high = (np.flatnonzero(np.abs(elongation - end) <= TOUCH) for end in (on.lower, on.upper))
        touching = np.concatenate([low, high])
        below = base.piece.copy()
        below[low] -= 1
        if len(touching) > MOST_TOUCHING:
            raise PathError(
                f"{len(touching)} strings change their pieces together at p = {parameter!r}; "
                f"more than {MOST_TOUCHING} at once cannot be told apart"
            )
        arc = base.arc + float(part) * (trial.arc - base.arc)
        rays = [ray for ray in self._rays(free, parameter, below, touching, base.piece, trial.direction, arc) if _resisted(ray)]
        if not rays:
            local = Local(self.equations, self.equations.at(free, parameter, base.piece))
            return Point(parameter, free, base.piece, trial.direction, local, arc, "loose")
        return max(rays, key=lambda ray: ray.direction @ trial.direction)

    def _rays(self, free, parameter, below, touching, came_on, along, arc) -> list[Point]:
        """All ways on from a kink: other pieces than those on which it was reached (each touching string on the one below or
        above its end) whose tangent moves the strings into these very pieces."""
        found = []
        for up in self._consistent(free, parameter, below, touching, along):
            piece = below.copy()
            piece[touching] += up
            if np.array_equal(piece, came_on):
                continue
            tangent = self.equations.at(free, parameter, piece)
            direction = _direction(tangent, self.scale, along)
            if direction is None:
                continue
            rest = self.equations.loading.rest_length_direction / self.scale
            rate = (tangent.growth @ direction[:-1] - rest * direction[-1])[touching]
            for sign in (1.0, -1.0):
                if (np.where(up, sign, -sign) * rate >= -INWARD).all():
                    local = Local(self.equations, tangent)
                    found.append(Point(parameter, free, piece, sign * direction, local, arc, "kink"))
        return found

    def _consistent(self, free, parameter, below, touching, along) -> np.ndarray:
        """(C, T) 0 or 1: which touching strings are above their ends, of all combinations that may be a way on, and on which
        nothing moves freely.  All are tried at once: they differ in these strings' stiffnesses only."""
        ups = np.array(list(itertools.product((1, 0), repeat=len(touching))), dtype=int).reshape(-1, len(touching))
        if len(touching) < 2:
            return ups
        equations, above = self.equations, below.copy()
        above[touching] += 1
        base = equations.at(free, parameter, below)
        stiffer, softer = (equations.laws.on(piece)(base.elongation)[1] for piece in (above, below))
        gain = ups * (stiffer - softer)[touching]
        wound = equations.loading.rest_length_direction[touching]
        growth = base.growth[touching] @ base.basis
        matrix = np.repeat(bordered(base, self.scale, along)[None], len(ups), axis=0)
        matrix[:, :-1, :-1] += np.einsum("ct,ti,tj->cij", gain, growth, growth)
        matrix[:, :-1, -1] -= (gain * wound) @ growth / self.scale
        values = np.abs(np.linalg.eigvalsh(matrix[:, :-1, :-1]))
        held = values.min(axis=1) > statics.NEUTRAL * np.maximum(values.max(axis=1), equations.stiffest)
        ups, gain, matrix = ups[held], gain[held], matrix[held]
        direction = np.linalg.pinv(matrix, rcond=SINGULAR)[:, :, -1]
        rate = direction[:, :-1] @ growth.T - direction[:, -1:] * wound / self.scale
        still = 2.0 * INWARD * np.sqrt((direction * direction).sum(axis=1, keepdims=True))
        outward = np.where(ups, rate, -rate)
        return ups[(outward >= -still).all(axis=1) | (outward <= still).all(axis=1)]

    # --- limit and branch points

    def _special(self, base: Point, trial: Point) -> list[Point] | None:
        """Limit and branch points between two points of a smooth part, in order of arc; None where one is not found."""
        end = trial if trial.kind != "kink" else self._before(base, trial)
        found: list[Point] = []
        if base.direction[-1] * end.direction[-1] < 0.0:
            point = self.root(base, end, lambda p: p.direction[-1], "limit", 1e-7)
            if point is None:
                return None
            found.append(point)
        low, high = sorted((_negative(base), _negative(end)))
        for i in range(low, high):
            change = abs(end.values[i] - base.values[i])
            if not (found and abs(found[0].values[i]) <= 1e-4 * change):  # else it vanishes at the limit point
                point = self.root(base, end, lambda p, i=i: float(p.values[i]), "branch", 1e-13)
                if point is None:
                    return None
                found.append(point)
        return sorted(found, key=lambda p: p.arc)

    def _before(self, base: Point, kink: Point) -> Point:
        """A kink as the end of the part that leads to it."""
        tangent = self.equations.at(kink.free, kink.parameter, base.piece)
        found = _point(self.equations, self.scale, kink.free, kink.parameter, tangent, base.piece, base.direction, kink.arc, "")
        return found if found is not None else kink

    def root(self, base: Point, end: Point, test, kind: str, part: float) -> Point | None:
        """Where a test function that changes its sign between the points is zero: bracketed secants (Illinois) along the
        tangent at `base`, until it is this part of its values there (at a limit point p is flat, so that less will do)."""
        length = float(
            base.direction[:-1] @ (end.free - base.free) + base.direction[-1] * self.scale * (end.parameter - base.parameter)
        )
        bend = (end.direction - base.direction) / length
        a, fa, b, fb, best = 0.0, test(base), length, test(end), end
        size = max(abs(fa), abs(fb))
        for _ in range(60):
            at = b - fb * (b - a) / (fb - fa) if fb != fa else 0.5 * (a + b)
            at = at if min(a, b) < at < max(a, b) else 0.5 * (a + b)
            point = self._corrected(base, at, bend)
            if point is None:
                return None
            best, value = point, test(point)
            if abs(value) <= part * size or abs(b - a) <= 1e-15 * max(length, 1e-6):
                break
            if value * fb < 0.0:
                a, fa = b, fb
            else:
                fa *= 0.5
            b, fb = at, value
        if abs(test(best)) > 1e-6 * size:
            return None
        return best._replace(kind=kind, arc=base.arc + (end.arc - base.arc) * min(max(b / length, 0.0), 1.0))


def _negative(point: Point) -> int:
    return int((point.values < 0.0).sum())


def _angle(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.arccos(np.clip(a @ b, -1.0, 1.0)))


def scale_of(model: Model, start: float, goal: float) -> float:
    """c, m per unit of p; see WHOLE_WAY."""
    return WHOLE_WAY * statics.shortest_bar(model) / (abs(float(goal - start)) or 1.0)


def point_at(equations: Equations, scale: float, nodes: np.ndarray, parameter: float, towards: float) -> Point:
    """The equilibrium at p next to nodes (N, 3), with its tangent in the direction in which p grows (towards > 0) or falls.

    Raises PathError where Newton's method finds none, and where the structure has motions that nothing resists.
    """
    free = equations.moved(equations.free(nodes), np.zeros(equations.size))
    hold = np.append(np.zeros(equations.size), 1.0)
    piece = equations.laws.piece_of(equations.elongation(free, parameter) + TOUCH)  # at an end: the piece beyond
    for _ in range(20):  # the start may lie on a neighbouring piece
        solved = newton(equations, scale, free, parameter, piece, hold, 1e-12)
        if solved is None:
            break
        point = _point(equations, scale, *solved, piece, np.sign(towards) * hold, 0.0, "")
        if point is not None and inside(equations, point):
            if _resisted(point):
                return point
            break
        piece = equations.laws.piece_of(equations.elongation(solved[0], parameter))
    raise PathError(
        f"{equations.model.name}: no isolated equilibrium at p = {parameter!r} beside the start; "
        "settle the structure first, and fix enough nodes"
    )


def _resisted(point: Point) -> bool:
    return bool((np.abs(point.values) > point.zero).all())


def follow(
    loading: Loading, start: float, goal: float, nodes: np.ndarray | None = None, most_points: int = MOST_POINTS, stop: str = ""
) -> Path:
    """The path from the equilibrium beside `nodes` (N, 3; default the model's start) at p = start, setting out towards
    p = goal, until p reaches the goal or comes back past the start.

    stop: 'unstable' ends the path at the first point beyond which it is unstable, 'stable' at the first stable one
    after unstable ones.
    Raises PathError.
    """
    start, goal = number("start", start), number("goal", goal)
    loading.check(start, goal)
    equations = Equations(loading)
    if nodes is not None:
        nodes = array_of("nodes", nodes, loading.model.nodes.shape)
    scale = scale_of(loading.model, start, goal)
    first = point_at(equations, scale, loading.model.nodes if nodes is None else nodes, start, goal - start)
    return follow_from(equations, scale, first, start, goal, most_points, stop)


def follow_from(
    equations: Equations,
    scale: float,
    first: Point,
    start: float,
    goal: float,
    most_points: int = MOST_POINTS,
    stop: str = "",
    seen: Callable[[float], object] | None = None,
) -> Path:
    """`follow` from a point of a path, in the direction of its tangent.  seen: gets the p of each point."""
    follower = _Follower(equations, scale, first, LONGEST * statics.shortest_bar(equations.model))
    path, (low, high), met_unstable = follower.path, sorted((start, goal)), not first.stable
    while not path.end:
        for point in follower.advance():
            if not low <= point.parameter <= high:
                bound = high if point.parameter > high else low
                if path.points[-1].parameter != bound:
                    path.points.append(between(equations, scale, path.points[-1], point, bound))
                path.end = "to" if bound == goal else "from"
                break
            path.points.append(point)
            if seen:
                seen(point.parameter)
            unstable = point.kind in ("limit", "branch") or not point.stable
            met_unstable = met_unstable or unstable
            if point.kind == "loose" or stop == ("unstable" if unstable else "stable" if met_unstable else None):
                path.end = point.kind or ("branch" if unstable else "stable")
                break
        if not path.end and len(path.points) >= most_points:
            path.end = "points"
    return path


def branches(path: Path, point: Point) -> list[Point]:
    """Points beside a branch point of a path, one on each way that leaves it: `follow_from` traces the paths from there.

    For every eigenvector whose eigenvalue is zero there, both ways along it.  Where several eigenvalues vanish together,
    as in a structure of three-fold symmetry, paths may leave along other combinations, too.
    """
    equations, scale = path.equations, path.scale
    tangent = equations.at(point.free, point.parameter, point.piece)
    values, vectors = np.linalg.eigh(tangent.stiffness)
    critical = np.flatnonzero(np.abs(values) <= CRITICAL * point.zero)
    found = []
    for i, sign in itertools.product(critical, (1.0, -1.0)):
        way = np.append(sign * tangent.basis @ vectors[:, i], 0.0)
        aside = ASIDE * statics.shortest_bar(equations.model)
        while aside > SHORTEST:
            guess = equations.moved(point.free, aside * way[:-1])
            solved = newton(equations, scale, guess, point.parameter, point.piece, way, SETTLED)
            if solved is not None and np.abs(solved[0] - guess).max() < aside:
                beside = _point(equations, scale, *solved, point.piece, way, point.arc, "")
                if beside is not None and inside(equations, beside):
                    found.append(beside)
                    break
            aside *= 0.5
    return found


def inside(equations: Equations, point: Point) -> bool:
    """Whether every string is on the piece that it is said to be on."""
    return not equations.laws.on(point.piece).left(equations.elongation(point.free, point.parameter)).any()
