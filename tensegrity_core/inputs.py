"""Held inputs: what a simulation receives at each communication point.

Over step k, from times[k] to times[k+1], the force is held and the rest length moves with its rate:
xi0(t) = rest_length[k] + rest_length_rate[k] * (t - times[k]).  The reference, the kernel and the FMUs all get the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .model import Model


@dataclass(frozen=True)
class Inputs:
    """times: (K+1,) s, increasing; force: (K, N, 3) N; rest_length: (K, S) m; rest_length_rate: (K, S) m/s."""

    times: np.ndarray
    force: np.ndarray
    rest_length: np.ndarray
    rest_length_rate: np.ndarray


def grid(duration: float, step: float, start: float = 0.0) -> np.ndarray:
    """(K+1,) communication points, s: steps are counted and the time derived, so no error accumulates."""
    count = round(duration / step)
    return start + np.arange(count + 1) * duration / count


def held(model: Model, times: np.ndarray, force=None, rest_length=None) -> Inputs:
    """Sample signals into held inputs.

    force: function of t -> (N, 3) N, sampled just after each communication point; None: no force.
    rest_length: function of t -> (S,) m, sampled at the communication points and joined by straight lines
    (rate = difference / step); None: the model's rest lengths.
    """
    times = np.asarray(times, dtype=float)
    steps = len(times) - 1
    forces = np.zeros((steps, len(model.nodes), 3))
    if force is not None:
        middle = 0.5 * (times[1:] + times[:-1])
        inside = times[:-1] + 1e-6 * (middle - times[:-1])
        forces[:] = [force(t) for t in inside]
    lengths = np.tile(model.rest_length, (steps + 1, 1))
    if rest_length is not None:
        lengths[:] = [rest_length(t) for t in times]
    rates = np.diff(lengths, axis=0) / np.diff(times)[:, None]
    return Inputs(times, forces, lengths[:-1], rates)
