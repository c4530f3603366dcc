"""The scenario in which an FMU comes nearest to a bound, and why, in words and as a picture."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tensegrity_core.output.drawing import draw, new_axes
from tensegrity_core.output.plots import new_figure, small_png

from .compare import KINDS, Comparison, Deviation
from .validate import Run, Validation

#: A transition counts as a cause for so long, s; a growth of a start error is worth a word from here on.
SHORTLY, GROWN = 0.02, 10.0


class Worst(NamedTuple):
    """output: its field; unit: of its deviation."""

    run: Run
    comparison: Comparison
    output: str
    deviation: Deviation
    unit: str


def worst(validation: Validation) -> Worst:
    """What is the largest part of its bound in a validation; a failed scenario comes before one that holds."""
    units = {name: unit for names, unit in KINDS.values() for name in names}
    return max(
        (
            Worst(run, comparison, name, one, units[name])
            for run in validation.runs
            for comparison in (run.comparison, run.tight)
            for name, one in comparison.deviations.items()
            if name in units
        ),
        key=lambda one: (bool(one.comparison.failures), _size(one.deviation.part)),
    )


def _size(part: float) -> float:
    return np.inf if np.isnan(part) else part


def sentences(found: Worst) -> list[str]:
    """Which scenario it is, what comes how near to its bound, and what makes the motion hard to follow there."""
    run, comparison, output, one, unit = found
    tolerance = "its own tolerance" if comparison.tolerance is None else f"a tolerance of {comparison.tolerance:g}"
    said = [
        f"Of all scenarios, \u201c{run.scenario.title}\u201d at {tolerance} comes nearest to a bound: the error of "
        f"{output.replace('_', ' ')} is {percent(one.part)} of what is allowed, {one.worst:.1e} of {one.bound:.1e} {unit} at "
        f"t = {one.time:.3g} s."
    ]
    before = [t for t in run.reference.transitions if one.time - SHORTLY <= t.time <= one.time]
    if before:
        last = before[-1]
        became = "went slack" if last.after == 0 else "became taut" if last.before == 0 else "changed its law's piece"
        who = f"{'String' if last.contact < 0 else 'Node'} {last.name(run.scenario.model)}"
        became = became if last.contact < 0 else f"changed how it touches the ground ({last.kind})"
        said.append(f"{who} {became} {1e3 * (one.time - last.time):.2g} ms before.")
    if comparison.growth > GROWN:
        times = f"{float(f'{comparison.growth:.2g}'):g}"
        said.append(f"A start error grows up to {times} times in this run, so that any integrator errs more there.")
    count = comparison.transitions[0]
    what = "strings and contacts" if run.scenario.model.contacts else "strings"
    said.append(f"Its {what} make {count} transition{'' if count == 1 else 's'} in {run.scenario.inputs.times[-1]:g} s.")
    return said


def percent(part: float) -> str:
    """A part of a bound."""
    return f"{100.0 * part:.2g} %" if np.isfinite(part) else "not finite, more than any part"


def picture(found: Worst, width: int = 640, height: int = 460) -> bytes:
    """A PNG: the structure of the reference at that instant, with names."""
    run = found.run
    model, result = run.scenario.model, run.reference
    row = int(np.argmin(np.abs(result.times - found.deviation.time)))
    figure = new_figure(width, height)
    drawing = draw(new_axes(figure, model), model, result.position[row], names=True)
    drawing.move(result.position[row], result.elastic_force[row] <= 0.0, result.snapped[row])
    return small_png(figure)
