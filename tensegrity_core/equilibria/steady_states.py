"""Steady states under load, solved: which of them a slow load reaches, and which one a load that comes suddenly.

Slow load (`load_sweep`).  The structure follows its stable equilibrium path.  Where the path's stability ends (a limit
point, a branch point, or a kink beyond which it is unstable) the structure moves on by itself: from there the overdamped
flow `statics.descend` leads to the next minimum of the potential energy, and the path goes on from that.  The force
curves of strings are single valued, so all hysteresis is that of the structure: on the way back stability ends elsewhere.

Sudden load (`SuddenLoads`).  Several stable states may exist under one load, and which of them a structure reaches that
is let go from rest at its start depends on its inertia.  Its energy E = kinetic + potential (loads included) only falls,
as the dampers take from it.  A way from the basin of one state to that of another leads over a saddle, so once E is below
the lowest saddle, the state is decided: it is where the flow leads from there.  Until then the kernel's dynamics is run,
with the real dampers, in short spans.  Saddles are the equilibria with one unstable direction on the paths that were
traced, so other states may still hide behind lower ones that no path has met; where no saddle is known, the run goes on
until what is left is a small swing.  Either takes a few seconds of simulated time; the rest is Newton's method.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from .. import statics
from ..errors import InputError
from ..model import Model
from . import quick_flow
from .equilibrium import Equations
from .load_steps import LoadSteps
from .loading import Loading
from .paths import Path, branches, follow_from, point_at, scale_of
from .points import PathError, Point

#: How far beyond a path's end the flow sets out, as part of p's whole way, by why the path ends.
BEYOND = {"limit": 1e-7, "branch": 1e-7, "kink": 1e-7, "loose": 1e-4}
PART_OF_BAR, PART_OF_FALL = 0.02, 0.3  # longest step of the flow: of a node, and of what snaps as part of its shortest fall
FIRST_SPAN, LATER = 0.25, 1.5  # s: of a sudden load, before the first look; each span is so much longer than the one before


class Jump(NamedTuple):
    """The structure left one stable path for another at a parameter: the last point before, the first after, and why
    ('limit', 'branch', 'kink', 'loose').

    parameter: where the path's stability ends, that of `before`; `after` is found a little beyond it (`BEYOND`), and its own
    parameter says where.
    """

    parameter: float
    before: Point
    after: Point
    kind: str


@dataclass(eq=False)
class Sweep:
    """What a slow load does: the steady state at each parameter asked for, the stable paths, the jumps."""

    equations: Equations
    parameters: np.ndarray
    states: list[Point] = field(default_factory=list)
    paths: list[Path] = field(default_factory=list)
    jumps: list[Jump] = field(default_factory=list)

    @property
    def nodes(self) -> np.ndarray:
        """(K, N, 3) m, at the parameters asked for."""
        return np.array([self.equations.nodes(p.free) for p in self.states])


def load_sweep(
    loading: Loading,
    parameters,
    nodes: np.ndarray | None = None,
    careful: bool = False,
    told: Callable[[float], object] | None = None,
) -> Sweep:
    """The steady states that a slow load reaches, one parameter after the other, up, down, or both in turn.

    nodes: (N, 3) m, beside the stable equilibrium at the first parameter; default the model's start.
    careful: follow every path along its arc, and the flow after every jump in small steps, which takes several times as long.
    Otherwise both are done where quicker means are in doubt (`load_steps`, `quick_flow`).
    told: gets the part of the way of p that is done, 0 to 1.
    Raises InputError for bad parameters, PathError where a path cannot be followed, NoEquilibrium where the flow finds no
    minimum.
    """
    parameters = np.asarray(parameters, dtype=float)
    if parameters.ndim != 1 or not parameters.size or not np.isfinite(parameters).all():
        raise InputError(f"parameters = {parameters!r}: give a list of finite numbers, at least one")
    loading.check(float(parameters.min()), float(parameters.max()))
    equations = Equations(loading)
    scale = scale_of(loading.model, parameters.min(), parameters.max())
    sweep = Sweep(equations, parameters)
    steps = None if careful else LoadSteps(equations, scale)
    here = point_at(equations, scale, loading.model.nodes if nodes is None else nodes, float(parameters[0]), 1.0)
    if not here.stable:
        raise PathError(f"the state at p = {float(parameters[0])!r} is not stable; start from one that is")
    sweep.states.append(here)
    turns = np.flatnonzero(np.diff(np.sign(np.diff(parameters)))) + 1
    whole, done = float(np.abs(np.diff(parameters)).sum()), 0.0
    for first, last in zip([0, *turns], [*turns, len(parameters) - 1]):
        start = float(parameters[first])

        def seen(p: float, start: float = start, done: float = done) -> None:
            if told and whole:
                told((done + abs(p - start)) / whole)

        here = _one_way(sweep, scale, here, parameters[first : last + 1].tolist(), steps, seen)
        done += abs(float(parameters[last]) - start)
    return sweep


def reached(model: Model, force: np.ndarray, told: Callable[[float], object] | None = None) -> Model:
    """The model at the steady state that forces (N, 3), N, reach which grow slowly, from where it starts.

    One with memories settles under them: a path would not know where they come from; so does one on the ground.  told: see
    load_sweep.  Raises TensegrityError.
    """
    if model.memories or model.ground is not None:
        return statics.settle(model, force)
    loading = Loading(model, force)
    return loading.model_at(1.0, load_sweep(loading, [0.0, 1.0], told=told).nodes[-1])


def _one_way(
    sweep: Sweep, scale: float, here: Point, goals: list[float], steps: LoadSteps | None, seen: Callable[[float], object]
) -> Point:
    """Parameters that only grow, or only fall; the first is where `here` stands; steps: None to follow carefully; seen: gets
    every p that is reached."""
    equations, side, done = sweep.equations, float(np.sign(goals[-1] - goals[0])), 1
    if side == 0.0:
        sweep.states += [here] * (len(goals) - 1)
        return here
    here = here._replace(direction=here.direction * (side * np.sign(here.direction[-1])), arc=0.0)
    while done < len(goals):
        path = Path(equations, scale, [here])
        sweep.paths.append(path)
        while not path.end and done < len(goals):
            path.end = steps.advance(path, goals[done], seen) if steps else ""
            if not path.end:
                _follow(path, goals[done], side, seen)
            if path.end == "to":
                sweep.states.append(path.points[-1])
                done += 1
                path.end = "to" if done == len(goals) else ""
        if path.end == "to":
            return path.points[-1]
        here = _jumped(sweep, steps, path, side, abs(goals[-1] - goals[0]))
        while done < len(goals) and side * goals[done] <= side * here.parameter:
            sweep.states.append(point_at(equations, scale, equations.nodes(here.free), goals[done], side))
            done += 1
    return here


def _follow(path: Path, goal: float, side: float, seen: Callable[[float], object]) -> None:
    """Follow a path along its arc from its last point to p = goal, or to where its stability ends."""
    further = follow_from(path.equations, path.scale, path.points[-1], -side * np.inf, goal, stop="unstable", seen=seen)
    path.points += further.points[1:]
    path.end = further.end


def _jumped(sweep: Sweep, steps: LoadSteps | None, path: Path, side: float, way: float) -> Point:
    """The stable state that the flow reaches from the end of a path."""
    last = path.points[-1]
    here = landing(path, last.parameter + side * BEYOND[path.end] * way, side, steps)
    sweep.jumps.append(Jump(last.parameter, last, here, path.end))
    return here


def landing(path: Path, parameter: float, side: float, steps: LoadSteps | None = None) -> Point:
    """The stable state at p to which the flow leads from the end of a path on which p grew (side > 0) or fell.

    steps: to take large steps of the flow; None: small ones.  Raises NoEquilibrium, PathError.
    """
    equations, last = path.equations, path.points[-1]
    escape = _escape(path, side)
    start = equations.moved(last.free, 0.15 * statics.step_limit(equations.model) * escape)
    found = quick_flow.settled(steps.saddle, start, escape, parameter) if steps else None
    here = None if steps is None or found is None else steps.arrived(found, parameter, side)
    if here is None:
        surface = FlowSurface(equations, parameter)
        found = statics.descend(surface, start, surface.balanced)
        here = point_at(equations, path.scale, equations.nodes(found), parameter, side)
    if not here.stable:
        raise PathError(f"the flow from p = {parameter!r} ends in a state that is not stable")
    return here


def _escape(path: Path, side: float) -> np.ndarray:
    """(n,) unit vector along which the structure leaves the end of a path."""
    last = path.points[-1]
    if path.end == "limit" or (path.end == "kink" and side * last.direction[-1] < 0.0):  # p turns: on along the path
        beside = path.end == "limit" and len(path.points) > 1  # where two folds coincide, the direction is any of theirs
        return _unit(path.points[-2 if beside else -1].direction[:-1])
    tangent = last.local.tangent
    escape = tangent.basis @ np.linalg.eigh(tangent.stiffness)[1][:, 0]
    return escape * np.sign(escape[np.argmax(np.abs(escape))])


def _unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector)


class FlowSurface(statics.Surface):
    """The potential energy at one parameter, evaluated by `Equations`: what `statics.descend` needs, faster.

    Positions are free coordinates (n,).  The last trial is kept: that it is near, where it leads, and its energy share
    one evaluation of the lengths.
    """

    def __init__(self, equations: Equations, parameter: float):
        loading = equations.loading
        model = loading.model_at(parameter, equations.model.nodes)
        super().__init__(model, loading.forces(parameter), statics.Modes, balance=equations.balance)
        self.equations, self.parameter = equations, parameter
        self._far = PART_OF_BAR * statics.shortest_bar(model)
        self._narrow = PART_OF_FALL * equations.laws.narrow
        self._trial: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None  # a step, where it leads, the elongations there
        self._elongation = np.zeros(len(model.strings))  # where the surface was asked last

    def near(self, free: np.ndarray, step: np.ndarray) -> bool:
        """Whether a step is small beside the bars, and beside the beams in what it does to NSH strings that carry."""
        if np.abs(step).max(initial=0.0) > self._far:
            return False
        trial = self.equations.moved(free, step)
        elongation = self.equations.elongation(trial, self.parameter)
        self._trial = step, trial, elongation
        change = np.maximum(elongation, 0.0) - np.maximum(self._elongation, 0.0)
        return bool((np.abs(change) <= self._narrow).all())

    def moved(self, free: np.ndarray, step: np.ndarray) -> np.ndarray:
        return self._trial[1] if self._trial and step is self._trial[0] else self.equations.moved(free, step)

    def energy(self, free: np.ndarray) -> float:
        known = self._trial[2] if self._trial and free is self._trial[1] else None
        return self.equations.energy(free, self.parameter, known)

    def at(self, free: np.ndarray) -> statics.SurfacePoint:
        self._elongation = self.equations.elongation(free, self.parameter)
        tangent = self.equations.at(free, self.parameter, self.equations.laws.piece_of(self._elongation))
        energy = self.equations.energy(free, self.parameter, self._elongation)
        return statics.SurfacePoint(energy, tangent.basis, tangent.pull, statics.Modes(tangent.stiffness))


def detours(sweep: Sweep, most_points: int = 100, told: Callable[[float], object] | None = None) -> list[Path]:
    """What lies behind the points where the sweep's stable paths end: behind a limit point the unstable branch up to where it
    is stable again, at a branch point every path that leaves it.  Each ends at the sweep's parameters or with so many
    points; one that cannot be followed at all is left out.  told: gets the part that is done, 0 to 1."""
    found = []
    for i, path in enumerate(sweep.paths):
        if told:
            told(i / len(sweep.paths))
        if path.end in ("limit", "branch") and len(path.points) > 1:
            ways = [(path.points[-2]._replace(arc=0.0), "stable" if path.end == "limit" else "")]
            if path.end == "branch":
                ways += [(point._replace(arc=0.0), "") for point in branches(path, path.points[-1])]
            found += [traced for way, stop in ways if (traced := _traced(sweep, path.scale, way, most_points, stop))]
    return found


def _traced(sweep: Sweep, scale: float, way: Point, most_points: int, stop: str) -> Path | None:
    low, high = float(sweep.parameters.min()), float(sweep.parameters.max())
    bounds = (low, high) if way.direction[-1] > 0.0 else (high, low)
    try:
        return follow_from(sweep.equations, scale, way, *bounds, most_points, stop)
    except PathError:
        return None
