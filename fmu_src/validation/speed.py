"""Measures an FMU's speed through fmpy's low-level calls: all inputs set and all outputs read at every step."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tensegrity_core.files import scratch

from .outside import Instance, Ports


class Speed(NamedTuple):
    """step: seconds of wall time per communication step; factor: simulated time over wall time."""

    step: float
    factor: float


def measure(fmu: Path, h: float = 1e-3, duration: float = 5.0, push: float = 100.0, repeats: int = 3) -> Speed:
    """The fastest of some runs with communication step h, s, under a push (N) on the last free node for 0.5 s.

    `fmu` is of this project; every input is sent and every output read at every step, arrays prepared beforehand.
    """
    from fmpy import extract, read_model_description

    def pushed(inputs: np.ndarray, k: int) -> None:
        inputs[forces[-2:]] = (push, -0.3 * push) if k * h < 0.5 else 0.0

    steps = round(duration / h)
    with scratch() as folder:
        description = read_model_description(extract(str(fmu), unzipdir=str(folder)))
        inputs = [v.name for v in description.modelVariables if v.causality == "input"]
        forces = [i for i, name in enumerate(inputs) if "force" in name]
        wall = min(stepped(Instance(description, str(folder)), pushed, steps, h) for _ in range(repeats))
    return Speed(wall / steps, duration / wall)


def stepped(
    instance: Instance, change: Callable, steps: int, h: float, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Seconds for communication steps of h, s, all inputs set and all outputs read at each; the instance is used up.

    change(inputs, k): puts what is set before step k into the array of inputs, which begins at their start values."""
    inputs = [v.name for v in instance.description.modelVariables if v.causality == "input"]
    ports = Ports(instance, inputs)
    ports.inputs[:] = [float(instance.by_name[name].start) for name in inputs]
    instance.start()
    begin = clock()
    for k in range(steps):
        change(ports.inputs, k)
        ports.set()
        ports.step(k * h, h)
        ports.get()
    spent = clock() - begin
    instance.close()
    return spent
