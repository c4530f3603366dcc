"""One run of the kernel on a scene that is pushed until strings go slack: its motion, its energy, how it ended."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchmarks.harness.problems import kernel_force, push
from tensegrity_core.errors import SimulationError
from tensegrity_core.kernel import Kernel
from tensegrity_core.model import Model


class Run(NamedTuple):
    """status: 'finished', or the name of the kernel's error; time: s, reached; positions: (K, N D) m at the communication
    points reached, the start first; energy: (K,) J, kinetic + potential + elastic less the push's work F (x - x(0)), which
    no exact motion raises; kinetic: (K,) J; ledger: largest gap of the energy ledger, relative to max(1 J, throughput);
    stats: the kernel's counters."""

    status: str
    time: float
    positions: np.ndarray
    energy: np.ndarray
    kinetic: np.ndarray
    ledger: float
    stats: dict


def run(model: Model, method: str, duration: float, points: int, at_rest_length=(), **settings) -> Run:
    """The model under the `push` of the benchmarks' problems from its start, with `points` communication steps.

    at_rest_length: strings whose rest length becomes their length at the start, to the last bit as the kernel computes it;
    settings: tolerance, max_step (the step of a fixed-step method), s."""
    kernel = Kernel(model, method=method, **settings)
    force = push(model)
    kernel["force"][:] = kernel_force(model, force)
    kernel.initialize()
    if len(at_rest_length):
        kernel["rest_length"][list(at_rest_length)] = kernel["string_length"][list(at_rest_length)]
        kernel.initialize()
    rows, status = [_row(kernel)], "finished"
    for _ in range(points):
        try:
            kernel.step(duration / points)
        except SimulationError as error:
            status = error.status
            break
        rows.append(_row(kernel))
    positions = np.array([row[0] for row in rows])
    kinetic, stored, balance, throughput = np.array([row[1:] for row in rows]).T
    work = (positions - positions[0]) @ force[:, model.axes].ravel()
    ledger = float(np.max(np.abs(balance - balance[0]) / np.maximum(1.0, throughput)))
    return Run(status, kernel.time, positions, kinetic + stored - work, kinetic, ledger, kernel.stats)


def _row(kernel: Kernel) -> tuple:
    kinetic, potential, elastic, dissipated, put_in, throughput = (
        kernel[name][0] for name in ("kinetic", "potential", "elastic", "dissipated", "input_work", "throughput")
    )
    stored = potential + elastic
    return kernel["position"].copy(), kinetic, stored, kinetic + stored + dissipated - put_in, throughput


def deviation(a: Run, b: Run) -> float:
    """m: largest difference of a coordinate of any node at the communication points; nan unless both finished."""
    if (a.status, b.status) != ("finished", "finished"):
        return float("nan")
    return float(np.abs(a.positions - b.positions).max())
