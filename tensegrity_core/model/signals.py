"""Inputs by the names that they have in an FMU: `n4.force.z`, `s1.rest_length`, `s1.current` ..., as signals over time."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ..errors import InputError, nearest
from ..quantities import number
from .components import flattened, named, names, spread
from .inputs import INPUTS, RATES, Inputs, held, starts
from .model import Model

#: A number, a function of t, or times (K,) with values (K,): straight lines join them, and two rows of one time are a jump.
Signal = Any
#: The inputs that signals give; rates and accelerations follow from them.
_GIVEN = [name for name in INPUTS if name not in RATES.values()]
#: Of a motion both are given: position -> its rate, the argument of `held`, and what moves.
_MOTIONS = {
    "node_position": ("node_velocity", "motion", "a moved node needs its position and its velocity"),
    "ground_height": ("ground_velocity", "ground", "a ground that moves needs its height and its velocity"),
}
_FOLLOWED = [rate for rate, _, _ in _MOTIONS.values()]


def places(model: Model) -> dict[str, tuple[str, int]]:
    """Name -> field, and place among the field's flat values, of all inputs that a signal may give."""
    return {name: (field, i) for field in [*_GIVEN, *_FOLLOWED] for name, i in named(INPUTS[field], model).items()}


def driven(model: Model, times: np.ndarray, signals: Mapping[str, Signal]) -> Inputs:
    """Held inputs out of signals by name; what none is given for stays as the model starts.

    times: (K+1,) s.  A force is sampled just after each of them and held; a rest length moves in straight lines between them,
    with the rate that belongs to it; a moved node needs its position and its velocity.  Raises InputError.
    """
    require_known(model, signals)
    known: dict[str, tuple[str, int]] = places(model)
    given: dict[str, list] = {}
    for name, signal in signals.items():
        given.setdefault(known[name][0], []).append((known[name][1], name, sampler(name, signal)))
    for field, (rate, _, needs) in _MOTIONS.items():
        if (field in given) != (rate in given):
            first = next(name for name in signals if known[name][0] in (field, rate))
            raise InputError(f"{first}: {needs} over time; give both")
    start = {field: flattened(INPUTS[field], model, value[None])[0] for field, value in starts(model).items()}

    def signal_of(field: str) -> Callable[[float], np.ndarray] | None:
        return None if field not in given else lambda t: _full(model, field, start[field], given[field], t)

    arguments: dict[str, Any] = {field: signal_of(field) for field in _GIVEN if field not in _MOTIONS}
    for field, (rate, argument, _) in _MOTIONS.items():
        if field in given:
            arguments[argument] = _both(signal_of(field), signal_of(rate))
    return held(model, times, **arguments)


def _both(position: Any, velocity: Any) -> Callable[[float], tuple]:
    return lambda t: (position(t), velocity(t))


def _full(model: Model, field: str, start: np.ndarray, signals: list, t: float) -> np.ndarray:
    """The field's values at t in the shape of `held`'s signals."""
    flat = start.copy()
    for place, name, sample in signals:
        flat[place] = number(name, _value(name, sample, t))
    return spread(INPUTS[field], model, flat[None])[0]


def _value(name: str, sample: Callable[[float], Any], t: float) -> Any:
    """What a function gives at t.  Raises InputError where it raises."""
    try:
        return sample(t)
    except Exception as failure:
        what = f"{type(failure).__name__}: {failure}" if str(failure) else type(failure).__name__
        raise InputError(f"{name}: its function fails at t = {t:g} s ({what}); give one that has a value there") from failure


def sampler(name: str, signal: Signal) -> Callable[[float], float]:
    """A signal as a function of t.  Raises InputError."""
    if callable(signal):
        return signal
    if "time" in getattr(signal, "coords", ()):  # an xarray.DataArray
        signal = signal["time"].values, signal.values
    elif hasattr(signal, "index") and hasattr(signal, "values"):  # a pandas.Series
        signal = signal.index.to_numpy(), signal.to_numpy()
    if isinstance(signal, str) or (not isinstance(signal, Sequence) and np.ndim(signal) == 0):
        value = number(name, signal)
        return lambda t: value
    try:
        times, values = (np.array(part, dtype=float) for part in signal)
    except (TypeError, ValueError):
        raise InputError(f"{name}: give a number, a function of t, or times and values of one length") from None
    if times.ndim != 1 or times.shape != values.shape or not len(times):
        raise InputError(f"{name}: times of shape {times.shape} and values of shape {values.shape}; give one value a time")
    if not (np.isfinite(times).all() and np.isfinite(values).all()):
        raise InputError(f"{name}: times and values must be finite numbers; leave rows without a number out")
    if (np.diff(times) < 0.0).any():
        late = int(np.argmax(np.diff(times) < 0.0)) + 1
        raise InputError(f"{name}: time {times[late]:g} s stands after {times[late - 1]:g} s; sort the rows by time")

    def sample(t: float) -> float:
        after = int(np.searchsorted(times, t, side="right"))  # at a jump: what comes after it
        if after in (0, len(times)):
            return float(values[min(after, len(times) - 1)])
        part = (t - times[after - 1]) / (times[after] - times[after - 1])
        return float(values[after - 1] + part * (values[after] - values[after - 1]))

    return sample


def require_known(model: Model, names_given: Iterable[str], where: str = "") -> None:
    """Raises InputError for a name that is no input, with those that are close.  where: what the name stands in."""
    known = places(model)
    for name in map(str, names_given):
        if name not in known:
            raise InputError(f"{where}{': ' if where else ''}{_unknown(model, name, known)}")


def _unknown(model: Model, name: str, known: Mapping[str, object]) -> str:
    rates = {rate: field for field, rate in RATES.items()}
    for rate, field in rates.items():
        if (place := named(INPUTS[rate], model).get(name)) is not None:
            whole = names(INPUTS[field], model)[place]
            return f"{name} follows from {whole}; give that over time, and leave {name} out"
    return f"{name} is no input of {model.name}; {nearest(name, known, 'inputs')}"
