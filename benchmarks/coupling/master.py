"""Masters that run a plan's units, FMUs by fmpy or linear ones, in communication steps.

A step hands each input its value, and, where the master extrapolates or interpolates, a slope.  Every unit then steps.
"""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

from .system import Plan


class Unit(Protocol):
    """One part of a system.  rates: input -> the input whose rate it is."""

    rates: dict[str, str]

    def put(self, names: list[str], values, slopes) -> None:
        """Inputs of the next step; slopes, 1/s."""

    def get(self, names: list[str]) -> np.ndarray:
        """Outputs at the end of the last step."""

    def slopes(self, names: list[str]) -> np.ndarray:
        """Rates of outputs at the end of the last step, 1/s."""

    def step(self, time: float, h: float) -> None: ...

    def save(self) -> object: ...

    def restore(self, saved) -> None: ...


class Scheme(NamedTuple):
    """How a master couples.

    sequential: each unit steps with what those before it have reached (Gauss-Seidel), not all at once (Jacobi);
    derivatives: inputs are extrapolated by the rates of the outputs, or interpolated where their source has already stepped,
    instead of held; sweeps: a step is taken back and repeated, each input interpolated between the step's ends, until the ends
    change by less than `settled` m, at most so many times; wired_rates: whether the rest lengths' rates are connected.
    """

    sequential: bool = False
    derivatives: bool = False
    sweeps: int = 1
    wired_rates: bool = True
    settled: float = 1e-12


SCHEMES = {
    "jacobi_no_rate": Scheme(wired_rates=False),
    "jacobi": Scheme(),
    "gauss_seidel": Scheme(sequential=True),
    "jacobi_derivatives": Scheme(derivatives=True),
    "gauss_seidel_derivatives": Scheme(sequential=True, derivatives=True),
    "iterated": Scheme(sequential=True, derivatives=True, sweeps=30),
}


class FMUnit:
    """An FMU, initialised by `System`."""

    def __init__(self, path: Path, name: str):
        description = read_model_description(str(path))
        self.folder = extract(str(path))
        variables = description.modelVariables
        self.references = {variable.name: variable.valueReference for variable in variables}
        self.rates = {v.name: v.derivative.name for v in variables if v.causality == "input" and v.derivative}
        identifier = description.coSimulation.modelIdentifier
        self.fmu = FMU2Slave(guid=description.guid, unzipDirectory=self.folder, modelIdentifier=identifier, instanceName=name)
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0)

    def begin(self, start: dict[str, float]) -> None:
        self.fmu.setReal([self.references[name] for name in start], list(start.values()))
        self.fmu.enterInitializationMode()

    def put(self, names, values, slopes) -> None:
        references = [self.references[name] for name in names]
        self.fmu.setReal(references, list(values))
        if slopes is not None:
            self.fmu.setRealInputDerivatives(references, [1] * len(references), list(slopes))

    def get(self, names) -> np.ndarray:
        return np.array(self.fmu.getReal([self.references[name] for name in names]))

    def slopes(self, names) -> np.ndarray:
        return np.array(self.fmu.getRealOutputDerivatives([self.references[name] for name in names], [1] * len(names)))

    def step(self, time: float, h: float) -> None:
        self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=h)

    def save(self):
        return self.fmu.getFMUState()

    def restore(self, saved) -> None:
        self.fmu.setFMUState(saved)

    def forget(self, saved) -> None:
        self.fmu.freeFMUState(saved)

    def close(self) -> None:
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder, ignore_errors=True)


class _Feed(NamedTuple):
    """What a unit gets from another: outputs and inputs by name; own: whether the input has a slope of its own, which a rest
    length's rate has not while its rest length is interpolated."""

    source: str
    outputs: list[str]
    inputs: list[str]
    own: np.ndarray


class Master:
    """Units under one scheme; `values` and `slopes` by unit hold the outputs at the last communication point."""

    def __init__(self, plan: Plan, units: dict[str, Unit], scheme: Scheme):
        self.units, self.scheme = units, scheme
        self.sweeps_taken = self.steps_taken = 0
        wires = [w for w in plan.wires if scheme.wired_rates or not w.output.endswith("_rate")]
        self.outputs = {name: list(dict.fromkeys(w.output for w in wires if w.source == name)) for name in units}
        self.feeds: dict[str, list[_Feed]] = {name: [] for name in units}
        for name, unit in units.items():
            into = [w for w in wires if w.target == name]
            for source in dict.fromkeys(w.source for w in into):
                pairs = [w for w in into if w.source == source]
                names = [w.input for w in pairs]
                own = np.array([unit.rates.get(input) not in names for input in names])
                self.feeds[name].append(_Feed(source, [w.output for w in pairs], names, own))

    def initialise(self) -> None:
        """Hand the outputs at the start to the inputs."""
        for name, unit in self.units.items():
            for feed in self.feeds[name]:
                unit.put(feed.inputs, self.units[feed.source].get(feed.outputs), None)

    def look(self) -> tuple[dict, dict]:
        """Outputs, and their rates where the scheme asks for them: unit -> output -> value."""
        values = {name: dict(zip(names, self.units[name].get(names))) for name, names in self.outputs.items()}
        slopes = {}
        if self.scheme.derivatives:
            slopes = {name: dict(zip(names, self.units[name].slopes(names))) for name, names in self.outputs.items()}
        return values, slopes

    def advance(self, time: float, h: float) -> None:
        """One communication step, repeated until it has settled."""
        begin = self.look()
        saved = {name: unit.save() for name, unit in self.units.items()} if self.scheme.sweeps > 1 else {}
        ends: dict[str, dict] = {}
        for sweep in range(self.scheme.sweeps):
            if sweep:
                for name, unit in self.units.items():
                    unit.restore(saved[name])
            before, ends = ends, self.sweep(time, h, begin, ends)
            self.sweeps_taken += 1
            if before and _change(before, ends) <= self.scheme.settled:
                break
        for name, state in saved.items():
            if isinstance(unit := self.units[name], FMUnit):
                unit.forget(state)
        self.steps_taken += 1

    def sweep(self, time: float, h: float, begin, known: dict[str, dict]) -> dict[str, dict]:
        """All units over one step; known: ends of the step that an earlier sweep reached.  Returns the ends."""
        reached: dict[str, dict] = {}
        for name, unit in self.units.items():
            for feed in self.feeds[name]:
                unit.put(feed.inputs, *self._fed(feed, begin, {**known, **(reached if self.scheme.sequential else {})}, h))
            if self.scheme.sequential:
                unit.step(time, h)
                reached[name] = dict(zip(self.outputs[name], unit.get(self.outputs[name])))
        if not self.scheme.sequential:
            for name, unit in self.units.items():
                unit.step(time, h)
                reached[name] = dict(zip(self.outputs[name], unit.get(self.outputs[name])))
        return reached

    def _fed(self, feed: _Feed, begin, ends: dict[str, dict], h: float):
        """Values and slopes of a feed's inputs."""
        values, slopes = begin
        now = np.array([values[feed.source][output] for output in feed.outputs])
        end = ends.get(feed.source)
        then = None if end is None else np.array([end[output] for output in feed.outputs])
        if not self.scheme.derivatives:
            return (now if then is None else then), None
        if then is None:
            return now, np.array([slopes[feed.source][output] for output in feed.outputs])
        return now, np.where(feed.own, (then - now) / h, 0.0)


def _change(before: dict[str, dict], ends: dict[str, dict]) -> float:
    return max(abs(value - before[name][output]) for name, found in ends.items() for output, value in found.items())


def run(plan: Plan, fmus: dict[str, Path], scheme: Scheme, h: float, steps: int) -> tuple[np.ndarray, Master]:
    """Heights (K+1, 3) m at all communication points, by fmpy; fmus: unit -> file."""
    units = {name: FMUnit(fmus[name], name) for name in plan.units}
    try:
        for name, unit in units.items():
            unit.begin(plan.start[name])
        master = Master(plan, units, scheme)
        master.initialise()
        for unit in units.values():
            unit.fmu.exitInitializationMode()
        rows = [_heights(plan, units)]
        for k in range(steps):
            master.advance(k * h, h)
            rows.append(_heights(plan, units))
        return np.array(rows), master
    finally:
        for unit in units.values():
            unit.close()


def _heights(plan: Plan, units) -> np.ndarray:
    (unit,) = {name for name, _ in plan.heights}
    return units[unit].get([output for _, output in plan.heights])
