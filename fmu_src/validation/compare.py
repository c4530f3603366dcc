"""Compares an FMU's run with the reference's, sample by sample and transition by transition.

The bound of an output is what a start error would make of it in this scenario (see `sensitivity`): an FMU that passes at a
size of 1e-9 m is as good as an exact solution whose start is about 2e-9 m and m/s off, in every output and at every sample,
however stiff, slow or sensitive the scene is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tensegrity_core.fields import COMPARED, FIELDS, outputs, size
from tensegrity_core.model import Model, Result, Transition
from tensegrity_core.model.components import present, spread

from ..variables.interface import Variable
from ..variables.states import LEFT_OUT
from .sensitivity import JUMPING, OUTPUTS, Spread, away, match, near_transitions

#: The bound in terms of the spread, which a few directions of the start error may miss by so much.
MARGIN = 2.0
#: What is added to the bounds in terms of the size and of an output's own range: 1e-10 of it at a size of 1e-9 m; ten times
#: that for energies, of the energy that has passed, since they are integrals; of 1 s for times of transitions.
FLOOR, FLOOR_ENERGY = 0.1, 1.0
#: Gap in the energy ledger, relative to the energy that has passed, or 1 J.
LEDGER_BOUND = 1e-8
#: The same where a host integrates the ledger beside the motion, with the errors of its own steps in each.
HOSTED_LEDGER_BOUND = 1e-7
#: Where a start error has grown to this part of the longest bar, the motion is another: the comparison stops before.
SENSITIVE = 1e-3

#: Outputs by the class in which they are compared, with its unit: what a table shows.
KINDS = {
    kind: (tuple(field.name for field in outputs(FIELDS) if field.compared == kind), unit)
    for kind, unit in COMPARED.items()
    if unit
}
#: Outputs that are counted.
COUNTED = tuple(field.name for field in outputs() if field.compared == "count")


@dataclass(frozen=True)
class Deviation:
    """Of an output: the largest error; error and bound where the error is the largest part of its bound, and when, s."""

    error: float
    worst: float
    bound: float
    time: float

    @property
    def part(self) -> float:
        """The largest part of its bound that an error is; NaN where the FMU gives one."""
        return self.worst / self.bound if self.bound > 0.0 else (0.0 if self.worst == 0.0 else np.inf)


@dataclass(frozen=True)
class Comparison:
    """tolerance: of the FMU, None: its own; size: of the start error that the bounds stand for, m and m/s; deviations: by
    output; snapped: samples that differ; ledger: of the FMU, relative; transitions: numbers in reference and FMU; unmatched:
    those without partner, but for those that come and go with the start error; transition_time: largest difference of
    partners, s; late: what passed its bound there, in words; growth: of a start error, at most; until: how long the runs were
    compared, s; left_out: samples near transitions.
    """

    tolerance: float | None
    size: float
    deviations: dict[str, Deviation]
    snapped: int
    ledger: float
    transitions: tuple[int, int]
    unmatched: int
    transition_time: float
    late: tuple[str, ...]
    growth: float
    until: float
    left_out: int
    ledger_bound: float = LEDGER_BOUND

    def largest(self, kind: str) -> float:
        """Largest error of the outputs of a kind, a key of KINDS."""
        return max((self.deviations[name].error for name in KINDS[kind][0] if name in self.deviations), default=0.0)

    @property
    def position(self) -> float:
        """Largest position error, m."""
        return self.largest("position")

    @property
    def force(self) -> float:
        """Largest force error, N, over all kinds of forces."""
        return self.largest("force")

    @property
    def part(self) -> float:
        """The largest part of its bound that any error is."""
        return max(one.part for one in self.deviations.values())

    @property
    def failures(self) -> list[str]:
        """What passed its bound, in words; NaN fails."""
        found = []
        for names, unit in KINDS.values():
            for name in names:
                one = self.deviations.get(name)
                if one is not None and not one.part <= 1.0:
                    words = name.replace("_", " ")
                    found.append(f"{words} error {one.worst:.2g} > {one.bound:.2g} {unit} at {one.time:g} s")
        if not self.ledger <= self.ledger_bound:
            found.append(f"energy ledger {self.ledger:.2g} > {self.ledger_bound:.2g} relative")
        if self.snapped:
            found.append(f"samples with a wrong number of snapped beams: {self.snapped}")
        if self.unmatched:
            found.append(f"transitions without partner: {self.unmatched}")
        return found + list(self.late)


def series(model: Model, table: tuple[Variable, ...], names: list[str], outputs_of_run: np.ndarray) -> dict[str, np.ndarray]:
    """An FMU's outputs (K+1, n) by field, in the shapes of `Result` (planar scenes: y of positions is the scene's); without
    those that model exchange has not."""
    column = {name: i for i, name in enumerate(names)}
    found = {}
    for field in outputs():
        if field.name in LEFT_OUT and not any(row.name in column for row in table if row.field == field.name):
            continue
        at = [column[row.name] for row in table if row.field == field.name]
        flat = np.zeros((len(outputs_of_run), size(field, model.counts)))
        flat[:, present(field, model)] = outputs_of_run[:, at]
        found[field.name] = spread(field, model, flat)
    return found


def compare(
    reference: Result,
    fmu: dict[str, np.ndarray],
    events: list[Transition],
    allowed: Spread,
    length: float,
    tolerance: float | None = None,
    ledger_bound: float = LEDGER_BOUND,
) -> Comparison:
    """fmu: from `series`; events: the FMU's transitions; allowed: what start errors become; length: of the longest bar, m;
    tolerance: of the FMU, None: its own; ledger_bound: of the gap in the energy ledger, relative."""
    times = reference.times
    calm = allowed.largest["position"] <= SENSITIVE * length
    rows = len(times) if calm.all() else max(1, int(np.argmin(calm)))
    until = float(times[rows - 1])
    ours = [t for t in reference.transitions if t.time <= until and t.string not in allowed.idle]
    theirs = [t for t in events if t.time <= until and t.string not in allowed.idle]
    clear = away(near_transitions(ours, theirs), times[:rows])
    through = float(reference.throughput[rows - 1])
    deviations = {name: _deviation(name, reference, fmu, allowed, rows, clear, through) for name in OUTPUTS}
    found = match(ours, theirs)
    wrong = np.any([np.any(reference.outputs[name][:rows] != fmu[name][:rows], axis=1) for name in COUNTED], axis=0)
    return Comparison(
        tolerance=tolerance,
        size=allowed.size,
        deviations=deviations,
        snapped=int(np.sum(wrong[clear])),
        ledger=_ledger(fmu, rows, through),
        transitions=(len(ours), len(theirs)),
        unmatched=sum(not allowed.is_loose(t) for t in (*found.ours, *found.theirs)),
        transition_time=max((abs(a.time - b.time) for a, b in found.pairs), default=0.0),
        late=tuple(_late(found.pairs, allowed)),
        growth=float(np.max(allowed.largest["position"])) / allowed.size,
        until=until,
        left_out=int(rows - np.sum(clear)),
        ledger_bound=ledger_bound,
    )


def _deviation(name: str, reference: Result, fmu, allowed: Spread, rows: int, clear, through: float) -> Deviation:
    right = reference.outputs[name][:rows].reshape(rows, -1)
    error = np.max(np.abs(right - fmu[name][:rows].reshape(rows, -1)), axis=1, initial=0.0)
    floor = FLOOR * allowed.size * float(np.max(np.abs(right), initial=0.0))
    if name in KINDS["energy"][0]:
        floor = FLOOR_ENERGY * allowed.size * max(float(np.max(np.abs(right))), through)
    bound = floor + MARGIN * allowed.largest[name][:rows]
    if name in JUMPING:
        error, bound, times = error[clear], bound[clear], reference.times[:rows][clear]
    else:
        times = reference.times[:rows]
    if not len(error):
        return Deviation(0.0, 0.0, floor, float(reference.times[0]))
    part = np.divide(error, bound, out=np.where(error > 0.0, np.inf, 0.0), where=bound > 0.0)
    at = int(np.argmax(np.where(np.isnan(part), np.inf, part)))
    return Deviation(float(np.max(error)), float(error[at]), float(bound[at]), float(times[at]))


def _late(pairs: list[tuple[Transition, Transition]], allowed: Spread):
    """Partners that are farther apart than start errors move them, in words, the worst first."""
    found = []
    for ours, theirs in pairs:
        apart, bound = abs(ours.time - theirs.time), FLOOR * allowed.size + MARGIN * allowed.shift(ours)
        if not apart <= bound and not allowed.is_loose(ours):
            found.append((apart - bound, f"transition time error {apart:.2g} > {bound:.2g} s at {ours.time:g} s"))
    return [words for _, words in sorted(found, reverse=True)[:1]]


def _ledger(fmu: dict[str, np.ndarray], rows: int, through: float) -> float:
    """Largest gap in the FMU's energy ledger, relative to the integral of the sum of |power|, its own or else `through`, at
    least 1 J."""
    scale = float(fmu["throughput"][rows - 1]) if "throughput" in fmu else through
    balance = fmu["kinetic"] + fmu["potential"] + fmu["elastic"] + fmu["dissipated"] - fmu["input_work"]
    return float(np.max(np.abs(balance - balance[0])[:rows]) / max(1.0, scale))
