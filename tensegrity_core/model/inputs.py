"""Held inputs: what a simulation receives at each communication point.

Over step k, from times[k] to times[k+1], an input is held, but for one that has its rate among the inputs, which moves with it
(`carried`): xi0(t) = rest_length[k] + rest_length_rate[k] * (t - times[k]); a moved node goes with a constant acceleration:
x(t) = node_position[k] + node_velocity[k] * (t - times[k]) + node_acceleration[k] * (t - times[k])^2 / 2.
The reference, the kernel and the FMUs all get the same.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import make_dataclass, replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..fields import FIELDS, Field, size
from ..quantities import number
from .components import full_shape
from .model import Model

#: The inputs of the list of fields, by name.
INPUTS = {field.name: field for field in FIELDS if field.role == "input"}
#: An input that moves during a step -> its rate.
RATES = {field.rate_of: name for name, field in INPUTS.items() if field.rate_of}

#: Communication points of a run; the smallest scenes' series take 8 GB then.
MOST_SAMPLES = 10_000_000

_Arrays: Any = make_dataclass(
    "_Arrays", ["times", *((name, np.ndarray | None, None) for name in INPUTS)], frozen=True, eq=False
)


class Inputs(_Arrays):
    """times: (K+1,) s, increasing; and an array for each input of fields.py:"""

    def resolved(self, model: Model) -> Inputs:
        """The same with every array there, and with the model's rest lengths where an actuator winds."""
        steps, given = len(self.times) - 1, {name for name in INPUTS if getattr(self, name) is not None}
        elapsed = np.asarray(self.times, dtype=float)[:-1] - self.times[0]
        start = {name: np.tile(value, (steps, *[1] * value.ndim)) for name, value in starts(model).items()}
        filled = {name: value for name, value in carried(start, elapsed).items() if name not in given}
        if model.actuated:
            wound = list(model.actuated)
            for name in ("rest_length", "rest_length_rate"):
                filled[name] = np.array(getattr(self, name) if name in given else filled[name], dtype=float)
                filled[name][:, wound] = start[name][:, wound]
        return replace(self, **filled)


def _line(field: Field) -> str:
    """An input in one line of the docstring: name, shape, unit, meaning."""
    letters = ["3" if letter == "D" else "N" if letter == "F" and "D" in field.shape else letter for letter in field.shape]
    return f"    {field.name}: ({', '.join(['K', *letters])}{'' if letters else ','}) {field.unit}; {field.meaning}"


Inputs.__doc__ = (
    str(Inputs.__doc__).rstrip()
    + "\n\n"
    + "\n".join(map(_line, INPUTS.values()))
    + """

    None means: as the model starts, see `starts`; moved nodes go on.  The rest lengths of strings with an actuator are ignored.
    """
)


def starts(model: Model) -> dict[str, np.ndarray]:
    """Each input where nothing is said, in its shape at one step.  Raises ValueError for an input without a start."""
    moving = list(model.moving)
    known = {
        "rest_length": model.rest_length,
        "current": model.current,
        "drum_load": model.drum_load,
        "node_position": model.nodes[moving],
        "node_velocity": model.velocity[moving],
    }
    for name, field in INPUTS.items():
        if name not in known and field.start is None:
            raise ValueError(
                f"fields.py: the input {name!r} has no start, and model.inputs.starts knows none; give its row one"
            )
    return {
        name: np.asarray(known[name], dtype=float) if name in known else np.full(full_shape(field, model), field.start)
        for name, field in INPUTS.items()
    }


def carried(values: Mapping[str, np.ndarray], tau) -> dict[str, np.ndarray]:
    """All inputs at tau after the instant at which they had these values, s: one for all, or (rows,), one for each row."""

    def at(name: str, order: int) -> np.ndarray:
        value = values[name]
        if name not in RATES:
            return value
        since = np.expand_dims(tau, tuple(range(1, value.ndim))) if np.ndim(tau) else tau
        return value + at(RATES[name], order + 1) * since / order

    return {name: at(name, 1) for name in INPUTS}


def grid(duration: float, step: float, start: float = 0.0) -> np.ndarray:
    """(K+1,) communication points, s: steps are counted and the time derived, so no error accumulates."""
    duration, step, start = number("duration", duration), number("step", step), number("start", start)
    if not (math.isfinite(duration) and duration > 0.0 and step > 0.0 and math.isfinite(start)):
        raise InputError(
            f"duration = {duration!r} s, step = {step!r} s, start = {start!r} s: give finite numbers, the first two > 0"
        )
    if duration / step > MOST_SAMPLES:
        raise InputError(
            f"duration = {duration!r} s at step = {step!r} s takes {duration / step:.3g} samples, more than {MOST_SAMPLES}; "
            "shorten it, or space them wider"
        )
    count = max(1, round(duration / step)) if step < math.inf else 1
    return start + np.arange(count + 1) * duration / count


def require_room(model: Model, samples: int) -> None:
    """Raises InputError where a run's series are more than this machine's memory takes, as far as it says what it has."""
    wanted = 2 * 8 * samples * sum(size(field, model.counts) for field in FIELDS)  # as the kernel gives them, and in a table
    if wanted > _memory():
        raise InputError(
            f"the series of {model.name} at {samples} samples take {wanted / 1e9:.3g} GB, this machine has "
            f"{_memory() / 1e9:.3g} GB of memory; give a shorter duration, or space the samples wider"
        )


def _memory() -> float:
    """Bytes of this machine, infinite where that is not known."""
    try:
        return float(os.sysconf("SC_PAGE_SIZE")) * float(os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):  # Windows
        return math.inf


def just_after(times: np.ndarray) -> np.ndarray:
    """(K,) s: where inputs that are held over a step are sampled, so that a jump at its start counts."""
    middle = 0.5 * (times[1:] + times[:-1])
    return times[:-1] + 1e-6 * (middle - times[:-1])


def held(
    model: Model,
    times: np.ndarray,
    force=None,
    rest_length=None,
    current=None,
    motion=None,
    drum_load=None,
    ground=None,
    **others,
) -> Inputs:
    """Sample signals into held inputs; None, or no signal: as the model starts.

    force: function of t -> (N, 3) N, sampled just after each communication point; current: likewise, (A,) A; drum_load:
    likewise, N; others: likewise, by the names of the inputs in fields.py.
    rest_length: function of t -> (S,) m, sampled at the communication points and joined by straight lines
    (rate = difference / step).
    motion: function of t -> positions (E, 3), m, and velocities (E, 3), m/s, of the moved nodes, sampled at the
    communication points (acceleration = difference of velocities / step).
    ground: likewise, function of t -> height, m, and its rate, m/s, of a ground that moves.
    Raises InputError for a signal of what is no such input.
    """
    times = np.asarray(times, dtype=float)
    steps = len(times) - 1
    inside = just_after(times)
    found: dict[str, np.ndarray] = {}
    for name, signal in {"force": force, "current": current, "drum_load": drum_load, **others}.items():
        if name not in INPUTS or name in RATES or name in RATES.values():
            known = ", ".join(other for other in INPUTS if other not in RATES and other not in RATES.values())
            raise InputError(f"{name} is no input that is held over a step; those are {known}")
        if signal is not None:
            found[name] = _sampled(INPUTS[name], model, [signal(t) for t in inside])
    if rest_length is not None:
        lengths = np.repeat(model.rest_length[None], steps + 1, axis=0)
        lengths[:] = [rest_length(t) for t in times]
        found |= {"rest_length": lengths[:-1], "rest_length_rate": np.diff(lengths, axis=0) / np.diff(times)[:, None]}
    if motion is not None:
        position, velocity = (np.array(part, dtype=float) for part in zip(*(motion(t) for t in times)))
        acceleration = np.diff(velocity, axis=0) / np.diff(times)[:, None, None]
        found |= {"node_position": position[:-1], "node_velocity": velocity[:-1], "node_acceleration": acceleration}
    if ground is not None:
        height, rate = (np.array(part, dtype=float).reshape(steps + 1, -1) for part in zip(*(ground(t) for t in times)))
        acceleration = np.diff(rate, axis=0) / np.diff(times)[:, None]
        found |= {"ground_height": height[:-1], "ground_velocity": rate[:-1], "ground_acceleration": acceleration}
    return Inputs(times, **found).resolved(model)


def _sampled(field: Field, model: Model, values: list) -> np.ndarray:
    """The values in the shape of `Inputs`."""
    shape = full_shape(field, model)
    if len(shape) == 1:
        return np.array(values, dtype=float).reshape(len(values), -1)
    found = np.zeros((len(values), *shape))
    found[:] = values
    return found
