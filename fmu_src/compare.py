"""Compares an FMU's run with the reference's, sample by sample and transition by transition."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tensegrity_core.fields import FIELDS, INTEGER_FIELDS
from tensegrity_core.model import Model
from tensegrity_core.result import Result, Transition

from .interface import Variable

#: Bounds: positions, m; forces, N and relative to the largest force of the run; energy ledger.
POSITION_BOUND, FORCE_BOUND, FORCE_RELATIVE, LEDGER_BOUND = 1e-7, 1e-3, 1e-6, 1e-8
#: Bounds: transition times, s; velocities, m/s and relative to the largest; energies, relative to 1 J and the throughput.
TRANSITION_BOUND, VELOCITY_BOUND, ENERGY_BOUND = 1e-6, 1e-6, 1e-6
#: Forces jump at transitions: samples this close to one are left out, s.
WINDOW = 1e-6
#: Start error whose growth is measured, m, and the growth past which comparing makes no sense, m: there an error of
#: 1e-10 m, such as any integration makes, has grown to POSITION_BOUND.
PERTURBATION, SENSITIVE = 1e-12, 1e-9

FORCES = ("string_force", "elastic_force", "bar_force", "reaction")
ENERGIES = ("kinetic", "potential", "elastic", "dissipated", "input_work")


@dataclass(frozen=True)
class Comparison:
    """Largest differences.  position, length: m; velocity: m/s; force: N, over all kinds of forces; energy: J; force_bound,
    velocity_bound, energy_bound: their bounds; snapped: samples that differ; ledger: of the FMU, relative; transitions:
    numbers in reference and FMU; unmatched: those without partner; transition_time: largest difference of partners, s;
    sensitivity: what became of PERTURBATION, m; until: how long the runs were compared, s; left_out: samples near
    transitions.
    """

    position: float
    length: float
    velocity: float
    force: float
    force_bound: float
    velocity_bound: float
    energy: float
    energy_bound: float
    snapped: int
    ledger: float
    transitions: tuple[int, int]
    unmatched: int
    transition_time: float
    sensitivity: float
    until: float
    left_out: int

    @property
    def failures(self) -> list[str]:
        """What passed its bound, in words; NaN fails."""
        bounds = (
            ("position error", self.position, POSITION_BOUND, "m"),
            ("force error", self.force, self.force_bound, "N"),
            ("energy ledger", self.ledger, LEDGER_BOUND, "relative"),
            ("length error", self.length, 2.0 * POSITION_BOUND, "m"),
            ("velocity error", self.velocity, self.velocity_bound, "m/s"),
            ("energy error", self.energy, self.energy_bound, "J"),
            ("samples with a wrong number of snapped beams:", self.snapped, 0, ""),
            ("transition time error", self.transition_time, TRANSITION_BOUND, "s"),
            ("transitions without partner:", self.unmatched, 0, ""),
        )
        passed = [row for row in bounds if not row[1] <= row[2]]
        return [f"{name} {value:.2g} > {bound:.2g} {unit}".rstrip() for name, value, bound, unit in passed]


def series(model: Model, table: tuple[Variable, ...], names: list[str], outputs: np.ndarray) -> dict[str, np.ndarray]:
    """An FMU's outputs (K+1, n) by field, in the shapes of `Result` (planar scenes: y of positions is the scene's)."""
    column = {name: i for i, name in enumerate(names)}
    found = {}
    for field in (*FIELDS, *INTEGER_FIELDS):
        if field.role != "output":
            continue
        at = [column[row.name] for row in table if row.field == field.name]
        values = outputs[:, at]
        if field.shape[-1:] == ("D",):
            nodes = {"N": np.arange(len(model.nodes)), "F": model.free_nodes, "G": model.fixed_nodes}[field.shape[0]]
            full = np.zeros((len(values), len(model.nodes), 3))
            if field.name == "position":
                full[:] = model.nodes
            full[:, nodes[:, None], list(model.axes)] = values.reshape(len(values), len(nodes), len(model.axes))
            values = full
        found[field.name] = values if field.shape else values[:, 0]
    return found


def compare(reference: Result, fmu: dict[str, np.ndarray], events: list[Transition], growth: np.ndarray) -> Comparison:
    """fmu: from `series`; events: the FMU's transitions; growth (K+1,): what became of PERTURBATION, m."""
    times = reference.times
    steady = np.maximum.accumulate(growth) <= SENSITIVE
    rows = len(times) if steady.all() else max(1, int(np.argmin(steady)))
    until = float(times[rows - 1])
    ours = [t for t in reference.transitions if t.time <= until]
    theirs = [t for t in events if t.time <= until]
    clear = _away_from([t.time for t in ours + theirs], times[:rows])

    def gap(name: str, chosen=slice(None)) -> float:
        difference = np.abs(getattr(reference, name)[:rows] - fmu[name][:rows])[chosen]
        return float(np.max(difference, initial=0.0))

    fastest = float(np.max(np.abs(reference.velocity[:rows])))
    turning = float(np.max(np.abs(reference.motor_speed[:rows]), initial=0.0))
    through = float(reference.throughput[rows - 1])
    largest = max(float(np.max(np.abs(getattr(reference, name)[:rows]), initial=0.0)) for name in FORCES)
    unmatched, shift = match(ours, theirs)
    return Comparison(
        position=gap("position"),
        length=max(gap("string_length"), gap("wound_rest_length")),
        velocity=max(gap("velocity"), gap("motor_speed") / max(1.0, turning)),
        force=max(gap(name, clear) for name in FORCES),
        force_bound=FORCE_BOUND + FORCE_RELATIVE * largest,
        velocity_bound=VELOCITY_BOUND * max(1.0, fastest),
        energy=max(gap(name) for name in ENERGIES),
        energy_bound=ENERGY_BOUND * max(1.0, through),
        snapped=int(np.sum(np.any(reference.snapped[:rows] != fmu["snapped"][:rows], axis=1)[clear])),
        ledger=_ledger(fmu, rows),
        transitions=(len(ours), len(theirs)),
        unmatched=unmatched,
        transition_time=shift,
        sensitivity=float(np.max(growth)),
        until=until,
        left_out=int(rows - np.sum(clear)),
    )


def _away_from(instants: list[float], times: np.ndarray) -> np.ndarray:
    """(K+1,) bool: no instant within WINDOW."""
    if not instants:
        return np.ones(len(times), dtype=bool)
    instants = np.sort(instants)
    right = np.searchsorted(instants, times)
    nearest = np.minimum(
        np.abs(times - instants[np.clip(right, 0, len(instants) - 1)]),
        np.abs(times - instants[np.clip(right - 1, 0, len(instants) - 1)]),
    )
    return nearest > WINDOW


def match(ours: list[Transition], theirs: list[Transition], reach: float = 1e-3) -> tuple[int, float]:
    """Pairs transitions of the same kind in order of time.  Returns how many have no partner within `reach`, s, and the
    largest difference in time of partners, s.
    """
    kinds: dict[tuple, tuple[list[float], list[float]]] = {}
    for side, found in enumerate((ours, theirs)):
        for t in found:
            kinds.setdefault((t.string, t.before, t.after), ([], []))[side].append(t.time)
    unmatched, shift = 0, 0.0
    for first, second in kinds.values():
        first, second = sorted(first), sorted(second)
        i = j = 0
        while i < len(first) and j < len(second):
            if abs(first[i] - second[j]) <= reach:
                shift = max(shift, abs(first[i] - second[j]))
                i, j = i + 1, j + 1
            else:
                unmatched += 1
                i, j = (i + 1, j) if first[i] < second[j] else (i, j + 1)
        unmatched += len(first) - i + len(second) - j
    return unmatched, shift


def _ledger(fmu: dict[str, np.ndarray], rows: int) -> float:
    """Largest gap in the FMU's energy ledger, relative to the integral of the sum of |power|, at least 1 J."""
    balance = fmu["kinetic"] + fmu["potential"] + fmu["elastic"] + fmu["dissipated"] - fmu["input_work"]
    return float(np.max(np.abs(balance - balance[0])[:rows]) / max(1.0, float(fmu["throughput"][rows - 1])))
