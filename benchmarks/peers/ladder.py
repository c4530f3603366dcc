"""What every contender gives: runs of one method at a ladder of settings."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

T = TypeVar("T")


class Clock:
    """Ends a run that takes longer than its limit (s of processor time): call it now and then, it raises TimeoutError."""

    def __init__(self, limit: float):
        self.limit = limit
        self.deadline = time.process_time() + limit

    def __call__(self) -> None:
        if time.process_time() > self.deadline:
            raise TimeoutError(too_long(self.limit))


def too_long(limit: float) -> str:
    """What is noted of a run that was ended."""
    return f"took longer than {limit:g} s"


@dataclass
class Run:
    """seconds: processor time of every repetition; position: (21, N, D) m at the output instants, the start first; energy:
    (21,) J, or None; counts: what the solver counted; failure: why there is no result."""

    seconds: list[float]
    position: np.ndarray | None = None
    energy: np.ndarray | None = None
    counts: dict[str, int] = field(default_factory=dict)
    failure: str | None = None


def timed(repetitions: int, begin: Callable[[], object], run: Callable[[], T]) -> tuple[Run, T | None]:
    """The seconds of each run, or why one failed, and what the last run gave; begin, before each, is not timed."""
    seconds, result = [], None
    for _ in range(repetitions):
        begin()
        start = time.process_time()
        try:
            with np.errstate(all="ignore"):  # a trial step may overflow; what is not finite shows in the result
                result = run()
        except (TimeoutError, RuntimeError, ValueError) as failure:
            return Run([time.process_time() - start], failure=str(failure)), None
        seconds.append(time.process_time() - start)
    return Run(seconds), result


@dataclass(frozen=True)
class Ladder:
    """One method on one problem.

    family: who made it ('kernel', 'cvode', 'arkode', 'plain', 'scipy', 'article', 'mujoco'; plain: CVODE and ARKODE as set
    up without tuning); events: transitions are located; kind: what the settings are, 'tolerance' or 'step' (s), loose ones
    first; measure(setting, repetitions, limit) -> Run, which fails where one repetition takes longer than the limit (s).
    """

    family: str
    method: str
    events: bool
    kind: str
    settings: tuple[float, ...]
    measure: Callable[[float, int, float], Run]


#: Steps of the methods of fixed step, per second: they divide the time between two output instants of a problem of 1 s.
STEPS_PER_SECOND = (100, 200, 400, 1000, 2000, 4000, 10000, 20000, 40000, 100000)


def fixed_steps() -> tuple[float, ...]:
    """Steps, s, the longest first."""
    return tuple(1.0 / n for n in STEPS_PER_SECOND)


def tolerances(loosest: float, tightest: float, per_decade: int = 1) -> tuple[float, ...]:
    """Equally spaced on a logarithmic scale, both ends included."""
    steps = round(per_decade * np.log10(loosest / tightest))
    return tuple(float(f"{x:.3g}") for x in np.geomspace(loosest, tightest, steps + 1))
