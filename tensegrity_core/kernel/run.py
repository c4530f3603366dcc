"""Runs of the kernel over held inputs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import InputError, SimulationError
from ..fields import FIELDS, INTEGER_FIELDS, METHODS, outputs
from ..model import Inputs, Model, Result, Transition
from ..model.components import flattened, names, spread
from ..model.inputs import INPUTS, carried
from .binding import Kernel

#: Calls into which `simulate` divides a step that is more work than one call may take.
PARTS = 50


def input_rows(model: Model, inputs: Inputs) -> np.ndarray:
    """(K, inputs) values of all inputs in the order of the kernel's block."""
    inputs = inputs.resolved(model)
    given = ((field, np.asarray(getattr(inputs, name), dtype=float)) for name, field in INPUTS.items())
    return np.hstack([flattened(field, model, values) for field, values in given])


def _step(kernel: Kernel, h: float) -> list[Transition]:
    """A step, in PARTS where it is more work than one call may take; returns its transitions."""
    try:
        kernel.step(h)
    except SimulationError as error:
        if error.status != "work_limit":
            raise
    else:
        return kernel.transitions if kernel.transition_count else []
    found: list[Transition] = []
    given = {name: kernel[name].copy() for name in INPUTS}
    for n in range(PARTS):
        for name, values in carried(given, h * n / PARTS).items():
            kernel[name][:] = values
        kernel.step(h / PARTS)
        found += kernel.transitions
    return found


def _in_users_words(error: InputError, kernel: Kernel, model: Model, time: float) -> InputError:
    """The error with the names that its reader has given: those of an input file and of `simulate`'s arguments."""
    if not hasattr(error, "index"):
        return error
    name, place = kernel.place(error.index)
    field = next(field for field in FIELDS + INTEGER_FIELDS if field.name == name)
    mine = names(field, model)[place] if field.shape else name
    when = f" (at t = {time:g} s)" if name in INPUTS else ""
    return InputError(f"{mine} = {kernel[name][place].item()!r} {error.reason}{when}")


def simulate(
    model: Model,
    inputs: Inputs,
    method: str = "auto",
    tolerance: float = 1e-10,
    max_step: float = 0.0,
    told: Callable[[float], object] | None = None,
) -> Result:
    """Run the kernel over held inputs (inputs.Inputs); the same signature and result as the reference.

    told: gets the part of the time that is done, 0 to 1, after every step.  Raises InputError for bad inputs,
    SimulationError where the kernel cannot go on.
    """
    if method not in METHODS:
        raise InputError(f"method = {method!r} is not one of {', '.join(METHODS)}")
    kernel = Kernel(model, method=method, tolerance=tolerance, max_step=max_step)
    given, steps = input_rows(model, inputs), len(inputs.times) - 1
    block = kernel.values[: given.shape[1]]
    rows = np.empty((steps + 1, len(kernel.values)))
    counts = np.empty((steps + 1, len(kernel.integers)), dtype=int)
    transitions: list[Transition] = []

    block[:] = given[0]
    try:
        kernel.initialize(inputs.times[0])
        rows[0], counts[0] = kernel.values, kernel.integers
        for k, h in enumerate(np.diff(inputs.times).tolist()):
            block[:] = given[k]
            transitions += _step(kernel, h)
            rows[k + 1], counts[k + 1] = kernel.values, kernel.integers
            if told:
                told((k + 1) / steps)
    except InputError as error:
        raise _in_users_words(error, kernel, model, kernel.time) from None
    series = {name: rows[:, at] for name, at in kernel.layout.items()}
    series |= {name: counts[:, at] for name, at in kernel.integer_layout.items()}
    found = {field.name: spread(field, model, series[field.name]) for field in outputs()}
    return Result(np.array(inputs.times), transitions, dict(kernel.stats), **found)
