"""Held inputs: what a simulation receives at each communication point.

Over step k, from times[k] to times[k+1], forces and currents are held and the rest length moves with its rate:
xi0(t) = rest_length[k] + rest_length_rate[k] * (t - times[k]); a moved node goes with a constant acceleration:
x(t) = node_position[k] + node_velocity[k] * (t - times[k]) + node_acceleration[k] * (t - times[k])^2 / 2.
The reference, the kernel and the FMUs all get the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..quantities import number
from .model import Model


@dataclass(frozen=True)
class Inputs:
    """times: (K+1,) s, increasing; force: (K, N, 3) N; rest_length: (K, S) m; rest_length_rate: (K, S) m/s;
    current: (K, A) A; drum_load: (K, A) N, pull on the actuators' drums beside their strings'; node_position, node_velocity,
    node_acceleration: (K, E, 3) m, m/s, m/s2, of the moved nodes.

    None means: as the model starts, see `resolved`.  The rest lengths of strings with an actuator are ignored.
    """

    times: np.ndarray
    force: np.ndarray
    rest_length: np.ndarray
    rest_length_rate: np.ndarray
    current: np.ndarray | None = None
    drum_load: np.ndarray | None = None
    node_position: np.ndarray | None = None
    node_velocity: np.ndarray | None = None
    node_acceleration: np.ndarray | None = None

    def resolved(self, model: Model) -> Inputs:
        """The same with every array there: start currents, moved nodes that go on as the model starts, and the model's
        rest lengths where an actuator winds."""
        steps, moving = len(self.times) - 1, list(model.moving)
        elapsed = (np.asarray(self.times, dtype=float)[:-1] - self.times[0])[:, None, None]
        start = {
            "current": np.tile(model.current, (steps, 1)),
            "drum_load": np.tile(model.drum_load, (steps, 1)),
            "node_position": model.nodes[moving] + model.velocity[moving] * elapsed,
            "node_velocity": np.tile(model.velocity[moving], (steps, 1, 1)),
            "node_acceleration": np.zeros((steps, len(moving), 3)),
        }
        filled = {name: value for name, value in start.items() if getattr(self, name) is None}
        if model.actuated:
            wound = list(model.actuated)
            for name, value in (("rest_length", model.rest_length[wound]), ("rest_length_rate", 0.0)):
                filled[name] = np.array(getattr(self, name), dtype=float)
                filled[name][:, wound] = value
        return replace(self, **filled)


def grid(duration: float, step: float, start: float = 0.0) -> np.ndarray:
    """(K+1,) communication points, s: steps are counted and the time derived, so no error accumulates."""
    duration, step, start = number("duration", duration), number("step", step), number("start", start)
    if not (math.isfinite(duration) and duration > 0.0 and step > 0.0 and math.isfinite(start)):
        raise InputError(
            f"duration = {duration!r} s, step = {step!r} s, start = {start!r} s: give finite numbers, the first two > 0"
        )
    count = max(1, round(duration / step)) if step < math.inf else 1
    return start + np.arange(count + 1) * duration / count


def held(model: Model, times: np.ndarray, force=None, rest_length=None, current=None, motion=None, drum_load=None) -> Inputs:
    """Sample signals into held inputs.

    force: function of t -> (N, 3) N, sampled just after each communication point; None: no force.
    rest_length: function of t -> (S,) m, sampled at the communication points and joined by straight lines
    (rate = difference / step); None: the model's rest lengths.
    current: function of t -> (A,) A, sampled as the force is; None: the model's start currents; drum_load: likewise, N.
    motion: function of t -> positions (E, 3), m, and velocities (E, 3), m/s, of the moved nodes, sampled at the
    communication points (acceleration = difference of velocities / step); None: they stay.
    """
    times = np.asarray(times, dtype=float)
    steps = len(times) - 1
    middle = 0.5 * (times[1:] + times[:-1])
    inside = times[:-1] + 1e-6 * (middle - times[:-1])
    forces = np.zeros((steps, len(model.nodes), 3))
    if force is not None:
        forces[:] = [force(t) for t in inside]
    lengths = np.repeat(model.rest_length[None], steps + 1, axis=0)
    if rest_length is not None:
        lengths[:] = [rest_length(t) for t in times]
    rates = np.diff(lengths, axis=0) / np.diff(times)[:, None]
    more = {}
    for name, signal in (("current", current), ("drum_load", drum_load)):
        if signal is not None:
            more[name] = np.array([signal(t) for t in inside], dtype=float).reshape(steps, -1)
    if motion is not None:
        position, velocity = (np.array(part, dtype=float) for part in zip(*(motion(t) for t in times)))
        acceleration = np.diff(velocity, axis=0) / np.diff(times)[:, None, None]
        more |= {"node_position": position[:-1], "node_velocity": velocity[:-1], "node_acceleration": acceleration}
    return Inputs(times, forces, lengths[:-1], rates, **more).resolved(model)
