"""The largest value of what a simulation returns, also between its communication points.

The run is repeated with more and more points around its maxima, under the same inputs; so a maximum is met to a share of a step
that no frequency of the structure reaches, and at a jump on either side of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..model import Inputs, Model, Result
from ..model.inputs import INPUTS, carried
from .run import simulate

#: Parts of a step: everywhere at first, then around maxima above NEAR of the largest, so often.
EVERYWHERE, CLOSER, NEAR, ROUNDS = 5, 30, 0.9, 2


def refined(inputs: Inputs, times: np.ndarray) -> Inputs:
    """The same inputs, which are resolved, at more communication points; `times` has all of theirs."""
    step = np.clip(np.searchsorted(inputs.times, times[:-1], side="right") - 1, 0, len(inputs.times) - 2)
    since = times[:-1] - inputs.times[step]
    return replace(inputs, times=times, **carried({name: getattr(inputs, name)[step] for name in INPUTS}, since))


def divided(times: np.ndarray, parts: int, steps: np.ndarray) -> np.ndarray:
    """The times with these steps (indices) in so many parts."""
    within = np.arange(1, parts) / parts
    more = times[steps, None] + within * np.diff(times)[steps, None]
    return np.unique(np.concatenate((times, more.ravel())))


def largest(model: Model, inputs: Inputs, quantity: Callable[[Result], np.ndarray], told=None, **options) -> np.ndarray:
    """(n,) largest values of the n quantities, (K+1, n) of a result, over a run; told, options: see kernel.simulate."""
    inputs = inputs.resolved(model)
    times = divided(inputs.times, EVERYWHERE, np.arange(len(inputs.times) - 1))
    values = quantity(simulate(model, refined(inputs, times), told=_part(told, 0), **options))
    for number in range(1, ROUNDS + 1):
        times = divided(times, CLOSER, np.unique(np.concatenate([_beside_maxima(column) for column in values.T])))
        values = quantity(simulate(model, refined(inputs, times), told=_part(told, number), **options))
    return values.max(axis=0)


def _part(told, number: int):
    """What one of the rounds is to tell."""
    return told and (lambda part: told((number + part) / (ROUNDS + 1)))


def _beside_maxima(values: np.ndarray) -> np.ndarray:
    """Steps before and after each sample that no neighbour exceeds and that is near the largest of all."""
    padded = np.concatenate(([-np.inf], values, [-np.inf]))
    least = values.max() - (1.0 - NEAR) * np.ptp(values)
    found = np.flatnonzero((values >= padded[:-2]) & (values >= padded[2:]) & (values >= least))
    return np.intersect1d(np.concatenate((found - 1, found)), np.arange(len(values) - 1))
