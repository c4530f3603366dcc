"""Measures an FMU's speed through fmpy's low-level calls: all inputs set and all outputs read at every step."""

from __future__ import annotations

import time
from pathlib import Path
from typing import NamedTuple

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

    steps = round(duration / h)
    with scratch() as folder:
        description = read_model_description(extract(str(fmu), unzipdir=str(folder)))
        wall = min(_run(description, str(folder), h, steps, push) for _ in range(repeats))
    return Speed(wall / steps, duration / wall)


def _run(description, folder, h, steps, push) -> float:
    instance = Instance(description, folder)
    inputs = [v.name for v in description.modelVariables if v.causality == "input"]
    ports = Ports(instance, inputs)
    ports.inputs[:] = [float(instance.by_name[name].start) for name in inputs]
    forces = [i for i, name in enumerate(inputs) if "force" in name]
    instance.start()
    ports.inputs[forces[-2:]] = push, -0.3 * push
    begin = time.perf_counter()
    for k in range(steps):
        if k * h >= 0.5:
            ports.inputs[forces[-2:]] = 0.0
        ports.set()
        ports.step(k * h, h)
        ports.get()
    wall = time.perf_counter() - begin
    instance.close()
    return wall
