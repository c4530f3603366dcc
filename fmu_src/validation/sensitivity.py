"""How far a small error carries a scenario: what a solution that is good to that error may differ by.

Every integration errs; a scene decides what becomes of it.  Runs of the kernel whose starts are `size` m and m/s off, across
the bars, and whose free nodes get KICKS of `size` m/s on the way (an error early on may have died out where the motion is at
its most sensitive), in a few directions there and back, show it for every output, from sample to sample, and for every
transition.  The FMU under test has no part in it.

An integrator that is out of order cannot make room for itself here: its noise does not grow with the errors, so of two sizes
the smaller growth counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tensegrity_core import kernel, statics
from tensegrity_core.fields import COMPARED, FIELDS, outputs
from tensegrity_core.model import Inputs, Model, Result, Transition

#: Tolerance of the runs, and the directions of the start errors, each there and back.
TOLERANCE, DIRECTIONS = 1e-11, 2
#: Parts of a run after which the nodes are kicked.
KICKS = (0.2, 0.4, 0.6, 0.8)
#: The second size in terms of the first.
LARGER = 500.0
#: Transitions of the same kind within this time are partners, s.
REACH = 1e-3
#: Forces jump at transitions: samples this close to one are left out, s.
WINDOW = 1e-6
#: Outputs that jump at transitions.
JUMPING = tuple(field.name for field in outputs(FIELDS) if field.jumps)

OUTPUTS = tuple(field.name for field in outputs(FIELDS) if COMPARED[field.compared])


@dataclass(frozen=True, eq=False)
class Spread:
    """What start errors of `size` m and m/s become in one scenario.

    largest: output -> (K+1,) largest difference so far; shifts: transition of the undisturbed run -> how far it moves, s;
    loose: (string and contact, time) of transitions that come and go with the start error; idle: strings that stay as close to
    their rest lengths as that, such as those laid along a bar, whose transitions all do.
    """

    size: float
    largest: dict[str, np.ndarray]
    shifts: tuple[tuple[Transition, float], ...]
    loose: tuple[tuple[tuple[int, int], float], ...]
    idle: frozenset[int] = frozenset()

    def shift(self, t: Transition) -> float:
        """How far a transition of this kind at about this time moves, s."""
        near = [(abs(one.time - t.time), shift) for one, shift in self.shifts if kind(one) == kind(t)]
        return min(near)[1] if near and min(near)[0] <= REACH else 0.0

    def is_loose(self, t: Transition) -> bool:
        """Whether a transition comes and goes with the start error."""
        return any(owner == (t.string, t.contact) and abs(time - t.time) <= REACH for owner, time in self.loose)


def kind(t: Transition) -> tuple[int, int, int, int]:
    """What has to be equal in partners."""
    return t.string, t.contact, t.before, t.after


def spreads(model: Model, inputs: Inputs, size: float) -> tuple[Spread, Spread]:
    """The spreads of a scenario, of start errors of `size` m and m/s and of LARGER times that.

    Raises SimulationError where the kernel cannot go on.
    """
    base = kernel.simulate(model, inputs, tolerance=TOLERANCE)
    near = [kernel.simulate(*one, tolerance=TOLERANCE) for one in disturbed(model, inputs, size)]
    far = [kernel.simulate(*one, tolerance=TOLERANCE) for one in disturbed(model, inputs, LARGER * size)]
    largest, wide = _largest(base, near), _largest(base, far)
    calm = {name: np.minimum(largest[name], wide[name] / LARGER) for name in largest}
    idle = idle_strings(base, inputs, size)
    return Spread(size, calm, *_moved(base, near), idle), Spread(LARGER * size, wide, *_moved(base, far), idle)


def idle_strings(result: Result, inputs: Inputs, size: float) -> frozenset[int]:
    """Strings whose lengths differ by no more than size, m, from their rest lengths at all communication points."""
    after = inputs.rest_length + inputs.rest_length_rate * np.diff(inputs.times)[:, None]
    off = np.maximum(np.abs(result.string_length[:-1] - inputs.rest_length), np.abs(result.string_length[1:] - after))
    return frozenset(np.flatnonzero(off.max(axis=0, initial=0.0) <= size).tolist())


def _moved(base: Result, runs: list[Result]) -> tuple[tuple, tuple]:
    """`shifts` and `loose` of a Spread."""
    shifts = dict.fromkeys(base.transitions, 0.0)
    loose = []
    for run in runs:
        found = match(base.transitions, run.transitions)
        for ours, theirs in found.pairs:
            shifts[ours] = max(shifts[ours], abs(ours.time - theirs.time))
        loose += [((t.string, t.contact), t.time) for t in (*found.ours, *found.theirs)]
    return tuple(shifts.items()), tuple(loose)


def _largest(base: Result, runs: list[Result]) -> dict[str, np.ndarray]:
    found = {}
    masks = [away(near_transitions(base.transitions, run.transitions), base.times) for run in runs]
    for name in OUTPUTS:
        rows = np.zeros(len(base.times))
        for run, clear in zip(runs, masks):
            difference = np.abs(run.outputs[name] - base.outputs[name]).reshape(len(rows), -1).max(axis=1, initial=0.0)
            rows = np.maximum(rows, np.where(clear, difference, 0.0) if name in JUMPING else difference)
        found[name] = np.maximum.accumulate(rows)
    return found


def disturbed(model: Model, inputs: Inputs, size: float) -> list[tuple[Model, Inputs]]:
    """Model and inputs with errors of up to `size` m and m/s at the start and m/s at the kicks, there and back in each
    direction."""
    random, found, steps = np.random.default_rng(0), [], np.diff(inputs.times)
    for _ in range(DIRECTIONS):
        place, speed = (_across(model, random.normal(size=model.nodes.shape)) for _ in range(2))
        impulse = np.zeros_like(inputs.force)
        for part in KICKS:
            k = int(part * len(steps))
            kick = _across(model, random.normal(size=model.nodes.shape))
            impulse[k] = model.node_mass[:, None] * kick / steps[k]
        for sign in (size, -size):
            start = replace(model, nodes=model.nodes + sign * place, velocity=model.velocity + sign * speed)
            found.append((start, replace(inputs, force=inputs.force + sign * impulse)))
    return found


def _across(model: Model, shift: np.ndarray) -> np.ndarray:
    """Shifts of the free nodes (N, 3) across their bars, in the axes in use, the largest of them 1."""
    axes = list(model.axes)
    found = np.zeros_like(model.nodes)
    found[:, axes] = shift[:, axes]
    if model.joint:
        balance = statics.balance_of(model)
        basis = balance.basis(balance.shape(statics.free_rows(model, model.nodes)))
        found = statics.in_space(model, basis @ (basis.T @ statics.free_rows(model, found)))
        return _scaled(found)
    found[model.fixed] = 0.0
    for (start, end), length in zip(model.bars, model.bar_length):
        along = (model.nodes[end] - model.nodes[start]) / length
        for node in (start, end):
            found[node] -= along * (along @ found[node])
    return _scaled(found)


def _scaled(found: np.ndarray) -> np.ndarray:
    """The same with a largest component of 1, where there is one."""
    largest = np.max(np.abs(found), initial=0.0)
    return found / largest if largest > 0.0 else found


@dataclass(frozen=True)
class Match:
    """Transitions of two runs: pairs of partners, and those without, in either."""

    pairs: list[tuple[Transition, Transition]]
    ours: list[Transition]
    theirs: list[Transition]


def match(ours: list[Transition], theirs: list[Transition], reach: float = REACH) -> Match:
    """Pairs transitions of the same kind within `reach` (s), in order of time."""
    kinds: dict[tuple, tuple[list[Transition], list[Transition]]] = {}
    for side, found in enumerate((ours, theirs)):
        for t in found:
            kinds.setdefault(kind(t), ([], []))[side].append(t)
    result = Match([], [], [])
    for first, second in kinds.values():
        first, second = (sorted(some, key=lambda t: t.time) for some in (first, second))
        i = j = 0
        while i < len(first) and j < len(second):
            if abs(first[i].time - second[j].time) <= reach:
                result.pairs.append((first[i], second[j]))
                i, j = i + 1, j + 1
            elif first[i].time < second[j].time:
                result.ours.append(first[i])
                i += 1
            else:
                result.theirs.append(second[j])
                j += 1
        result.ours.extend(first[i:])
        result.theirs.extend(second[j:])
    return result


def near_transitions(ours: list[Transition], theirs: list[Transition]) -> list[tuple[float, float]]:
    """(time, s on either side) within which two runs cannot be compared where outputs jump: partners that are apart, and
    transitions without one."""
    found = match(ours, theirs)
    windows = [(0.5 * (a.time + b.time), max(WINDOW, abs(a.time - b.time))) for a, b in found.pairs]
    return windows + [(t.time, REACH) for t in (*found.ours, *found.theirs)]


def away(windows: list[tuple[float, float]], times: np.ndarray) -> np.ndarray:
    """(K+1,) bool: in no window."""
    clear = np.ones(len(times), dtype=bool)
    for at, reach in windows:
        low, high = np.searchsorted(times, (at - reach, at + reach))
        clear[max(low, 0) : high + 1] &= np.abs(times[max(low, 0) : high + 1] - at) > reach
    return clear
