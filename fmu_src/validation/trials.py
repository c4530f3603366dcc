"""The short runs under which an FMU is judged, chosen from the scene so that every one of its laws shows.

*drive* moves every input of fields.py at once, each at a frequency of its own: rest lengths so far that strings go slack and
snap, an input that nothing is said about here about its start, by a part of the scale that the structure gives to its unit.
*blows* are constant forces on all free nodes that turn round once, at the scene's damping and at weaker and stronger ones.

How strong and how long follows from the kernel's own runs: of a few strengths the one under which the strings visit the most
pieces of their force curves; as long as the reference can afford, which counts evaluations and not seconds.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from tensegrity_core import kernel
from tensegrity_core.equilibria.jointed import movable
from tensegrity_core.errors import TensegrityError
from tensegrity_core.fields import Field
from tensegrity_core.model import Inputs, Model, grid, held
from tensegrity_core.model.components import full_shape
from tensegrity_core.model.inputs import INPUTS, RATES, starts

from ..variables.interface import scale_of
from .scenarios import DAMPINGS, Scenario, shown_damping

#: Longest simulated time of a run, s, and its number of communication steps.
DURATION, STEPS = 1.0, 100
#: Evaluations of the equations that the reference may spend on a run, about.
AFFORDABLE = 60_000
#: How the reference integrates, whatever the damping: a stiff run is as short as that asks for.
METHOD = "DOP853"
#: What counts them: the kernel's method of that kind.
COUNTING: dict[str, Any] = {"method": "dop853", "tolerance": 1e-11}
#: Strengths of the drive that are tried, and of the blows, in terms of `_force_scale`.
STRENGTHS, BLOW = (2.0, 4.0, 8.0, 16.0), 8.0
#: Largest part of a rest length that a drive takes away or adds, and the part beyond the last piece of a force curve.
LARGEST_PART, BEYOND = 0.4, 0.25
#: Amplitude of moved nodes as part of the longest bar, and of currents as part of the start currents.
SHAKING, SWINGING = 0.02, 0.3
#: Load of drums in terms of `_force_scale`, other inputs in terms of their units' scale, and how much faster than once in a run
#: the fastest signal turns.
LOADING, MOVING, FASTEST = 0.2, 0.5, 1.5
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)


def trials(model: Model) -> list[Scenario]:
    """The runs for a model, deterministic."""
    found = [_strongest(model)]
    for factor, written in DAMPINGS.items() if np.any(model.damping) else ((1.0, "d"),):
        damped = replace(model, damping=factor * model.damping)
        blows = _Blows(damped)
        inputs = blows(_affordable(damped, blows))
        name = f"blows_{factor:g}d".replace(".", "_")
        title = f"constant forces on all free nodes that turn round, {shown_damping(damped)}"
        found.append(Scenario(name, title, damped, inputs, f"blows at {written}", method=METHOD))
    return found


def _strongest(model: Model) -> Scenario:
    """The drive under which the strings visit the most pieces; of equal ones the weakest."""
    inputs = [_Drive(model, strength) for strength in STRENGTHS]
    duration = _affordable(model, inputs[-1])
    visited = [_visited(model, one(duration)) for one in inputs]
    best = inputs[visited.index(max(visited))]
    title = f"all inputs moving at once, {shown_damping(model)}"
    return Scenario("drive_1d", title, model, best(duration), "drive at d", method=METHOD)


def _visited(model: Model, inputs: Inputs) -> int:
    """Pieces of force curves that a run visits; -1: the kernel cannot go on."""
    try:
        run = kernel.simulate(model, inputs)
    except TensegrityError:
        return -1
    return len({(t.string, t.contact, piece) for t in run.transitions for piece in (t.before, t.after)})


def _affordable(model: Model, inputs_for) -> float:
    """The longest duration, s, of which the reference can afford inputs_for(duration): DURATION, a half of it, a quarter …"""
    duration, best = DURATION / 2.0**12, DURATION / 2.0**12
    while True:
        try:
            spent = kernel.simulate(model, inputs_for(duration), **COUNTING).stats["rhs"]
        except TensegrityError:
            return best
        if spent > AFFORDABLE:
            return best
        best = duration
        if duration == DURATION:
            return best
        longer = 2.0 if spent > 0.1 * AFFORDABLE else 8.0
        duration = min(longer * duration, DURATION)


def _force_scale(model: Model) -> float:
    """A force that the structure feels, N: the weight of a bar, and the mean tension at the start."""
    try:
        start = kernel.simulate(model, held(model, np.array([0.0, 1e-9]))).string_force[0]
    except TensegrityError:
        start = np.zeros(1)
    fall = max(float(np.linalg.norm(model.g)), float(np.max(model.bar_length)) if len(model.bars) else 1.0)
    mass = float(np.mean(model.node_mass[model.free_nodes]))
    return mass * fall + float(np.mean(start)) if len(start) else mass * fall


def _phase(i: int) -> float:
    """Spread evenly over 0..1 for i = 0, 1, 2, ..."""
    return (0.5 + GOLDEN * i) % 1.0


def _directions(model: Model) -> np.ndarray:
    """(N, 3) unit vectors at the free nodes, along their free axes among those in use."""
    found = np.zeros((len(model.nodes), 3))
    for i, node in enumerate(model.free_nodes):
        turn = 2.0 * math.pi * _phase(i)
        height = 2.0 * _phase(3 * i + 1) - 1.0
        across = math.sqrt(1.0 - height * height)
        way = np.array([across * math.cos(turn), across * math.sin(turn), height])
        found[node, list(model.axes)] = way[list(model.axes)]
        found[node, model.held[node]] = 0.0
        found[node] /= np.linalg.norm(found[node])
    return found


def _balanced(model: Model, force: np.ndarray) -> np.ndarray:
    """Forces (N, 3) that do not carry a structure off that nothing holds."""
    if model.fixed.any():
        return force
    return force - np.mean(force, axis=0) * ~model.held.any(axis=0)


class _Blows:
    """Held inputs for a duration (s): constant forces on all free nodes that turn round in the middle."""

    def __init__(self, model: Model):
        self.model, self.force = model, _balanced(model, BLOW * _force_scale(model) * _directions(model))

    def __call__(self, duration: float) -> Inputs:
        times = grid(duration, duration / STEPS)
        return held(self.model, times, lambda t: self.force if t < 0.5 * duration else -self.force)


class _Drive:
    """Held inputs for a duration (s) in which everything moves.  strength: of the forces, in terms of `_force_scale`."""

    def __init__(self, model: Model, strength: float):
        self.model, self.scale = model, _force_scale(model)
        self.force = strength * self.scale * _directions(model)
        ends = map(kernel.Kernel(model).breakpoints, range(len(model.strings)))
        travels = [float(at[-1]) if len(at) else 0.0 for at in ends]  # a string that also pushes has none
        k = model.stiffness
        plain = np.divide(strength * self.scale, k, out=np.zeros(len(k)), where=k > 0.0)
        travel = 0.5 * (1.0 + BEYOND) * np.array(travels)
        self.reach = np.minimum(np.maximum(travel, plain), 0.5 * LARGEST_PART * model.rest_length)

    def __call__(self, duration: float) -> Inputs:
        model, turns = self.model, 2.0 * math.pi / duration
        forces, strings, motors = (
            _waves(count, first)
            for count, first in ((len(model.nodes), 0), (len(model.strings), 100), (len(model.actuated), 200))
        )

        def rest_length(t):
            return model.rest_length + self.reach * (strings(turns * t) - strings(0.0))

        def current(t):
            return model.current * (1.0 + SWINGING * motors(turns * t))

        def drum_load(t):
            return model.drum_load + LOADING * self.scale * motors(0.7 * turns * t)

        def force(t):
            return _balanced(model, self.force * forces(turns * t)[:, None])

        times = grid(duration, duration / STEPS)
        known = {"force": force, "rest_length": rest_length, "current": current, "drum_load": drum_load}
        others = {name: _swaying(field, model, turns) for name, field in INPUTS.items() if name not in (*known, *MOTION)}
        return held(model, times, **known, motion=_motion(model, turns), ground=_ground(model, turns), **others)


#: What moves as a motion of nodes or of the ground, or with a signal's slope, and has no signal of its own.
MOTION = (*RATES, *RATES.values())


def _swaying(field: Field, model: Model, turns: float):
    """t -> an input that sways about its start."""
    shape, start, first = full_shape(field, model), starts(model)[field.name], 100 * (3 + list(INPUTS).index(field.name))
    waves, size = _waves(math.prod(shape), first), MOVING * scale_of(field.unit, model)
    return lambda t: start + size * waves(turns * t).reshape(shape)


def _waves(count: int, first: int):
    """angle -> (count,) sines of it, each with a frequency and a phase of its own; first: which of them to begin with."""
    own = [first + i for i in range(count)]
    rates = np.array([1.0 + FASTEST * _phase(7 * i + 2) for i in own])
    phases = np.array([2.0 * math.pi * _phase(5 * i) for i in own])
    return lambda angle: np.sin(rates * angle + phases)


def _motion(model: Model, turns: float):
    """t -> positions and velocities (E, 3) of the moved nodes: sines that start at rest places."""
    rest = model.nodes[list(model.moving)]
    if not len(rest):
        return None
    size, rates = SHAKING * float(np.max(model.bar_length)) * movable(model), np.zeros((len(rest), 3))
    for i in range(len(rest)):
        for axis in model.axes:
            rates[i, axis] = turns * (0.8 + 0.9 * _phase(3 * i + axis))
    return lambda t: (rest + size * np.sin(rates * t), size * rates * np.cos(rates * t))


def _ground(model: Model, turns: float):
    """t -> height and velocity of a ground that moves: a sine that starts where the ground stands."""
    if model.ground is None or not model.ground.moving:
        return None
    size, rate = SHAKING * float(np.max(model.bar_length)), turns * (0.8 + 0.9 * GOLDEN)
    return lambda t: (size * math.sin(rate * t), size * rate * math.cos(rate * t))
