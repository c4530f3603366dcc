"""The system linearised about its start, run by the same masters: at which communication step the coupling goes unstable.

Each unit is x' = A x + B u, y = C x + D u, stepped exactly under inputs u + u' t + u'' t^2 / 2.  One communication step is then
a linear map of all states, and of the inputs that outputs remember; its spectral radius says how fast a small error grows.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from tensegrity_core import statics
from tensegrity_core.equilibria.modes import matrices

from . import system
from .master import Master, Scheme, run
from .system import PAIRS, Loop, Plan, plan, structure


class Blocks(NamedTuple):
    """A (n, n), B (n, m), C (p, n), D (p, m); inputs and outputs: names."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    inputs: list[str]
    outputs: list[str]


class LinearUnit:
    """See `master.Unit`; rates as there: an input that is the rate of another is that one's first derivative."""

    def __init__(self, blocks: Blocks, rates: dict[str, str]):
        self.blocks, self.rates = blocks, rates
        self.x, self.u = np.zeros(len(blocks.A)), np.zeros((3, len(blocks.inputs)))
        self.maps: dict[float, np.ndarray] = {}

    def put(self, names, values, slopes) -> None:
        for i, name in enumerate(names):
            row = self.blocks.inputs.index(name)
            self.u[:, row] = values[i], 0.0 if slopes is None else slopes[i], 0.0
        for rate, of in self.rates.items():
            i, j = self.blocks.inputs.index(of), self.blocks.inputs.index(rate)
            if slopes is None:
                self.u[1, i] = self.u[0, j]
            else:
                self.u[0, j] = self.u[1, i]
            self.u[2, i] = self.u[1, j]

    def get(self, names) -> np.ndarray:
        return self._of(names, self.blocks.C @ self.x + self.blocks.D @ self.u[0])

    def slopes(self, names) -> np.ndarray:
        b = self.blocks
        return self._of(names, b.C @ (b.A @ self.x + b.B @ self.u[0]) + b.D @ self.u[1])

    def _of(self, names, values) -> np.ndarray:
        return np.array([values[self.blocks.outputs.index(name)] for name in names])

    def step(self, time: float, h: float) -> None:
        n = len(self.x)
        moved = self._map(h) @ np.concatenate((self.x, self.u.ravel()))
        self.x, self.u = moved[:n], moved[n:].reshape(3, -1)

    def _map(self, h: float) -> np.ndarray:
        if h not in self.maps:
            n, m = self.blocks.B.shape
            whole = np.zeros((n + 3 * m, n + 3 * m))
            whole[:n, : n + m] = np.hstack((self.blocks.A, self.blocks.B))
            whole[n : n + 2 * m, n + m :] = np.eye(2 * m)
            self.maps[h] = expm(whole * h)
        return self.maps[h]

    def save(self):
        return self.x.copy(), self.u.copy()

    def restore(self, saved) -> None:
        self.x, self.u = saved[0].copy(), saved[1].copy()


@cache
def linear_structure() -> Blocks:
    """M q'' + C q' + K q = growth^T (k xi0 + d xi0'), of deviations from the start."""
    model = structure()
    found = matrices(model)
    r = len(found.mass)
    growth = -statics.equilibrium_matrix(model)[:, : len(model.strings)].T @ found.basis  # of lengths, per q
    chosen = [model.string_names.index(string) for string in PAIRS.values()]
    pull = np.hstack((growth.T * model.stiffness, growth.T * model.damping))
    pull = pull[:, [*chosen, *(len(model.strings) + i for i in chosen)]]
    inverse = np.linalg.inv(found.mass)
    A = np.block([[np.zeros((r, r)), np.eye(r)], [-inverse @ found.stiffness, -inverse @ found.damping]])
    rows = [3 * list(model.free_nodes).index(model.node_names.index(node)) + 2 for node in PAIRS]
    C = np.hstack((found.basis[rows], np.zeros((3, r))))
    names = [f"{string}.rest_length{tail}" for tail in ("", "_rate") for string in PAIRS.values()]
    B = np.vstack((np.zeros((r, 6)), inverse @ pull))
    return Blocks(A, B, C, np.zeros((3, 6)), names, [f"{node}.z" for node in PAIRS])


def linear_winch(loop: Loop) -> Blocks:
    """Within its rate limit."""
    fast = 1.0 / loop.time_constant
    C, D = np.array([[1.0], [-fast]]), np.array([[0.0], [fast]])
    return Blocks(np.array([[-fast]]), np.array([[fast]]), C, D, ["command"], ["rest_length", "rest_length_rate"])


def linear_controller(loop: Loop) -> Blocks:
    one, none = np.eye(3), np.zeros((3, 3))
    A = np.block([[-one / loop.filter_time, none], [-one, none]])
    B, C = np.vstack((one / loop.filter_time, none)), np.hstack((loop.gain * one, -loop.integral_gain * one))
    names = [[f"{name}[{i}]" for i in (1, 2, 3)] for name in ("height", "command")]
    return Blocks(A, B, C, none, *names)


def units(loop: Loop, of: Plan) -> dict[str, LinearUnit]:
    rates = {f"{string}.rest_length_rate": f"{string}.rest_length" for string in PAIRS.values()}
    found = {"structure": LinearUnit(linear_structure(), rates), "controller": LinearUnit(linear_controller(loop), {})}
    return {name: found.get(name) or LinearUnit(linear_winch(loop), {}) for name in of.units}


class Fresh(Master):
    """A master that hands the winches their commands before it asks for their rates, as FMI allows for outputs that depend on
    inputs directly."""

    def look(self) -> tuple[dict, dict]:
        for name in self.units:
            for feed in self.feeds[name] if "command" in self.units[name].blocks.inputs else []:
                self.units[name].put(feed.inputs, self.units[feed.source].get(feed.outputs), None)
        return super().look()


class Coupling:
    """The linear system under one scheme."""

    def __init__(self, loop: Loop, scheme: Scheme, kind: type[Master] = Master):
        self.plan = plan(loop)
        self.units = units(loop, self.plan)
        self.master = kind(self.plan, self.units, scheme)

    def step_map(self, h: float) -> np.ndarray:
        """Of all states and connected inputs, one communication step."""
        connected = self._connected()
        columns = []
        for start in np.eye(len(connected))[connected]:
            self._set(start)
            self.master.advance(0.0, h)
            columns.append(np.concatenate([np.concatenate((u.x, u.u.ravel())) for u in self.units.values()]))
        return np.array(columns).T[connected]

    def _connected(self) -> np.ndarray:
        """Which of all values those are; an input that nothing feeds keeps its value, which is no growth."""
        found: list[bool] = []
        for name, unit in self.units.items():
            fed = {input for feed in self.master.feeds[name] for input in feed.inputs}
            found += [True] * unit.x.size + [input in fed for input in unit.blocks.inputs] * len(unit.u)
        return np.array(found)

    def _set(self, values) -> None:
        for unit in self.units.values():
            n, m = unit.x.size, unit.u.size
            unit.x, unit.u, values = values[:n], values[n : n + m].reshape(3, -1), values[n + m :]

    def multiplier(self, h: float) -> complex:
        """The largest eigenvalue of a step, with an imaginary part >= 0: what a small error is multiplied by."""
        found = np.linalg.eigvals(self.step_map(h))
        largest = found[np.argmax(np.abs(found))]
        return complex(largest.real, abs(largest.imag))

    def growth(self, h: float) -> float:
        """Its size."""
        return abs(self.multiplier(h))

    def contraction(self, h: float) -> float:
        """The factor by which the ends of a step change from sweep to sweep: repeating a step settles while it is below 1."""
        places = [(name, output) for name, outputs in self.master.outputs.items() for output in outputs]
        still = {name: dict.fromkeys(outputs, 0.0) for name, outputs in self.master.outputs.items()}
        columns = []
        for place in places:
            known = {name: {output: float((name, output) == place) for output in outputs} for name, outputs in still.items()}
            self._set(np.zeros(sum(unit.x.size + unit.u.size for unit in self.units.values())))
            ends = self.master.sweep(0.0, h, (still, still), known)
            columns.append([ends[name][output] for name, output in places])
        return float(np.abs(np.linalg.eigvals(np.array(columns))).max())


def largest_step(coupling: Coupling, steps: np.ndarray) -> float | None:
    """The communication step, s, at which the growth first passes 1, found between these; None where it does not."""
    before = None
    for h in steps:
        if coupling.growth(h) > 1.0:
            return float(brentq(lambda x: coupling.growth(x) - 1.0, before, h, xtol=1e-6 * h)) if before else None
        before = h
    return None


#: Of the small motion by which growth is seen: how far the targets lie off, m, and the size at which it counts as large.
NUDGE, LARGE = 1e-7, 1e-4
#: Communication steps over which it is seen, those that the first motion takes to die out, and the fewest that say something.
WATCHED, FIRST, FEWEST = 60, 20, 8


def seen_growth(fmus: dict[str, Path], scheme: Scheme, h: float) -> float:
    """What `growth` foretells, seen in FMUs: the factor per step by which the heights part from targets next to the start; nan
    where they have done so within a few steps.

    A straight line is laid through the logarithms of the deviations, of which each is the largest of several steps.
    """
    small = plan(system.LOOP._replace(load=(0.0, 0.0, 0.0), raised=NUDGE))
    heights, _ = run(small, fmus, scheme._replace(settled=1e-15), h, WATCHED)
    size = np.abs(heights - heights[0] - NUDGE).max(axis=1)
    within = size[: np.argmax(size > LARGE) or None]
    if len(within) < FEWEST:
        return float("nan")
    first, several = (FIRST, 10) if len(within) > FIRST + 20 else (len(within) // 4, len(within) // 4)
    crests = np.array([within[k : k + several].max() for k in range(first, len(within) - several + 1)])
    return float(np.exp(np.polyfit(np.arange(len(crests)), np.log(crests), 1)[0]))


class Margin(NamedTuple):
    """delay: the least that, in all measurements, makes the continuous loop oscillate, s; frequency: how, rad/s; phase: what is
    left there without it, degrees."""

    delay: float
    frequency: float
    phase: float


def effect(loop: Loop, s: complex) -> complex:
    """What the coupling multiplies the open loop by, where exp(s t) is a motion of the coupled system: exp(-s tau) for a delay
    tau."""
    factors = -1.0 / np.linalg.eigvals(open_loop(loop, s))
    return complex(factors[np.argmin(np.abs(np.log(factors)))])


def delay_in_steps(coupling: Coupling, loop: Loop, h: float) -> float:
    """The delay in all measurements, in steps h, that would shift the loop's slowest motion as the coupling does."""
    found = np.linalg.eigvals(coupling.step_map(h))
    rates = np.log(found[np.abs(found) > 1e-9]) / h
    s = complex(rates[np.argmin(np.abs(rates))])
    return float((-np.log(effect(loop, s)) / s).real / h)


def delay_margin(loop: Loop) -> Margin:
    """Of the loop without any coupling error: where an eigenvalue of its open-loop matrix has size 1."""
    frequencies = np.geomspace(0.1, 1e3, 4000)
    loci = np.array([np.sort_complex(np.linalg.eigvals(open_loop(loop, 1j * w))) for w in frequencies])
    found = []
    for locus in loci.T:
        for i in np.flatnonzero((np.abs(locus[:-1]) >= 1.0) & (np.abs(locus[1:]) < 1.0)):
            left = (np.pi + np.angle(locus[i])) % (2.0 * np.pi)
            found.append(Margin(left / frequencies[i], frequencies[i], np.degrees(left)))
    return min(found)


def open_loop(loop: Loop, s: complex) -> np.ndarray:
    """(3, 3): from heights around to heights, without the minus of the feedback."""
    plant, controller = _transfer(linear_structure(), s), linear_controller(loop)
    by_rest = plant[:, :3] + s * plant[:, 3:]
    return -by_rest / (loop.time_constant * s + 1.0) @ _transfer(controller, s)


def _transfer(b: Blocks, s: complex) -> np.ndarray:
    return b.C @ np.linalg.solve(s * np.eye(len(b.A)) - b.A, b.B) + b.D
