"""How benchmarks take time: contenders in turns, so that they see the same state of the machine."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import wraps
from statistics import median
from typing import TypeVar

import numpy as np

from tensegrity_core.kernel import Kernel

from . import machine
from .problems import INSTANTS

K = TypeVar("K")


def recorded(collect: Callable[..., dict]) -> Callable[..., dict]:
    """What the function measures, with the machine, and with the seconds by the wall clock that it took."""

    @wraps(collect)
    def with_machine(*arguments, **options) -> dict:
        began, where = time.perf_counter(), machine.describe()
        found = collect(*arguments, **options)
        return {"machine": where, **found, "seconds": round(time.perf_counter() - began)}

    return with_machine


def in_turns(contenders: Mapping[K, Callable[[], float]], rounds: int) -> dict[K, list[float]]:
    """Seconds of every contender's runs: one a round, in one order and the other."""
    seconds: dict[K, list[float]] = {name: [] for name in contenders}
    for n in range(rounds):
        for name in list(contenders)[:: -1 if n % 2 else 1]:
            seconds[name].append(contenders[name]())
    return seconds


def summary(values: list[float], runs: str = "rounds") -> dict:
    """Least and median, and the number of the runs, under that name."""
    return {"min": min(values), "median": median(values), runs: len(values)}


def follow(kernel: Kernel, force: np.ndarray, duration: float, instants: int = INSTANTS) -> tuple[float, np.ndarray]:
    """Processor seconds, and positions (instants, N D) m after equal parts of a duration, s; force: (F * D,) N, constant."""
    kernel["force"][:] = force
    kernel.initialize()
    rows = np.empty((instants, len(kernel["position"])))
    start = time.process_time()
    for n in range(instants):
        kernel.step(duration / instants)
        rows[n] = kernel["position"]
    return time.process_time() - start, rows
