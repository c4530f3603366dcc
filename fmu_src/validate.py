"""Validates an FMU: fmpy runs it from outside, the reference gets the same held inputs, the two are compared.

The FMU runs in a fresh isolated interpreter, in a temporary folder, where this project's packages are barred (see
outside.py).  Reference runs are spread over processes and may come from a cache (see reference_cache.py).
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tensegrity_core import kernel, processes, reference
from tensegrity_core.errors import TensegrityError
from tensegrity_core.fields import layout
from tensegrity_core.files import replacing, scratch, write_bytes, write_text
from tensegrity_core.model import Model
from tensegrity_core.result import Result, Transition

from .compare import PERTURBATION, Comparison, compare, series
from .interface import Variable, variables
from .outside import WITH_PARENT
from .places import kept
from .reference_cache import cached, reference_key
from .scenarios import Scenario, scenarios

HERE = Path(__file__).parent
CACHE = kept() / "reference-cache"

#: Scenes that are known not to be sensitive: a comparison cut short is a failure.
NOT_SENSITIVE = ("three_bar", "three_bar_nsh")
#: Processes for reference runs, see processes.Workers.
workers = processes.Workers
#: Wall time after which a run from outside is given up, s.
TIMEOUT = 900.0
#: Settings of the reference: keyword arguments of reference.simulate.
NORMAL = {"rtol": 5e-10, "atol": 5e-11}
STIFF = {"rtol": 1e-10, "atol": 1e-11}
FREE = {"rtol": 1e-12, "atol": 1e-13}
#: Rates of damping 4 d/m, 1/s: below the first a scenario keeps its errors for long, above the second it is stiff.
FREE_RATE, STIFF_RATE = 20.0, 8000.0
#: How much tighter the reference runs once more where a comparison fails, and the tightest rtol, above round-off.
TIGHTER, TIGHTEST = 20.0, 1e-13


class ValidationError(TensegrityError):
    """A validation that could not be carried out."""


@dataclass(frozen=True)
class Run:
    """One scenario of an FMU.  fmu: its outputs by field, see compare.series; seconds: per communication step; tight: the
    reference ran once more, see `judge_again`.
    """

    scenario: Scenario
    reference: Result
    fmu: dict[str, np.ndarray]
    comparison: Comparison
    seconds: float
    from_cache: bool
    tight: bool = False


@dataclass(frozen=True)
class Validation:
    """All runs of one FMU.  runtime: 'python' or 'native'."""

    model: Model
    runtime: str
    runs: tuple[Run, ...]

    @property
    def position(self) -> float:
        """Largest position error, m."""
        return max(run.comparison.position for run in self.runs)

    @property
    def force(self) -> float:
        """Largest force error, N."""
        return max(run.comparison.force for run in self.runs)

    @property
    def seconds(self) -> float:
        """Mean wall time of a communication step with all inputs set and all outputs read, s."""
        return float(np.mean([run.seconds for run in self.runs]))

    @property
    def factor(self) -> float:
        """Simulated time over wall time."""
        times = self.runs[0].scenario.inputs.times
        return float(times[1] - times[0]) / self.seconds

    @property
    def cut(self) -> list[Run]:
        """Runs that were compared for a part of their time only, because more would be too sensitive."""
        return [run for run in self.runs if run.comparison.until < run.scenario.inputs.times[-1]]

    @property
    def failures(self) -> list[str]:
        """What passed its bound, in words, with the scenario's title."""
        found = [f"{run.scenario.title}: {failure}" for run in self.runs for failure in run.comparison.failures]
        for run in self.cut:
            until = run.comparison.until
            if until <= run.scenario.inputs.times[0] or self.model.name in NOT_SENSITIVE:
                found.append(f"{run.scenario.title}: could be compared until {until:g} s only")
        return found


def run_outside(
    fmu: Path,
    model: Model,
    naming: str = "structured",
    runs: list[Scenario] | None = None,
    python: str = sys.executable,
) -> list[tuple[dict[str, np.ndarray], list[Transition], float]]:
    """Run an FMU in a fresh isolated interpreter.  Returns per scenario its outputs, transitions, and seconds per step.

    python: the interpreter; it needs numpy and fmpy only.  Raises ValidationError with the interpreter's last words.
    """
    table = variables(model, naming)
    runs = scenarios(model) if runs is None else runs
    names = [row.name for row in table if row.causality == "input"]
    with scratch() as here:
        script = here / "outside.py"
        write_bytes(script, (HERE / "outside.py").read_bytes())
        job = {"fmu": str(fmu.absolute()), "runs": []}
        for i, run in enumerate(runs):
            with replacing(here / f"{i}.npz") as file:
                np.savez(file, times=run.inputs.times, values=input_values(run))
            parameters = {row.name: value for row, value in _changed(table, model, run.model)}
            item = {"name": run.name, "arrays": str(here / f"{i}.npz"), "inputs": names, "parameters": parameters}
            job["runs"].append(item)
        write_text(here / "job.json", json.dumps(job))
        command = [python, "-I", str(script), str(here / "job.json"), str(here / "result.npz"), WITH_PARENT]
        try:
            done = processes.run(command, here, TIMEOUT)
        except subprocess.TimeoutExpired:
            raise ValidationError(f"{fmu}: the run from outside did not end within {TIMEOUT} s") from None
        if done.returncode:
            raise ValidationError(f"{fmu}: the run from outside failed:\n{(done.stdout + done.stderr)[-3000:]}")
        with np.load(here / "result.npz", allow_pickle=False) as stored:
            return [_outcome(stored, run, table) for run in runs]


def _outcome(stored, run: Scenario, table: tuple[Variable, ...]):
    strings = [run.model.string_names.index(name) for name in stored["strings"].tolist()]
    events = [Transition(t, strings[int(s)], int(a), int(b)) for t, s, a, b in stored[f"{run.name}/events"].tolist()]
    outputs = series(run.model, table, stored["output_names"].tolist(), stored[f"{run.name}/outputs"])
    return outputs, events, float(stored[f"{run.name}/seconds"]) / (len(run.inputs.times) - 1)


def input_values(run: Scenario) -> np.ndarray:
    """(K, inputs) in the order of the variable table: all but the rest lengths of strings with an actuator."""
    places = layout(run.model.counts)
    wound = [places[name].start + i for name in ("rest_length", "rest_length_rate") for i in run.model.actuated]
    return np.delete(kernel.input_rows(run.model, run.inputs), wound, axis=1)


def _changed(table: tuple[Variable, ...], model: Model, other: Model):
    """Tunable parameters in which a scenario's model differs from the FMU's."""
    places = layout(model.counts)
    for row in table:
        if row.field in ("stiffness", "damping"):
            string = row.reference - places[row.field].start
            old, new = (float(getattr(m, row.field)[string]) for m in (model, other))
            if old != new:
                yield row, new


def reference_settings(run: Scenario, tight: bool = False) -> dict:
    """What keeps the reference's own error well below the bounds at the least cost; tight: whatever the cost.

    A strong damper turns errors of the rates into errors of the forces, so it needs a tighter tolerance; not so where
    moving rest lengths excite the dampers at every communication point and keep the steps short.
    """
    model = run.model
    rate = 4.0 * float(np.max(model.damping, initial=0.0)) / float(np.min(model.bar_mass, initial=np.inf))
    stiff = rate > STIFF_RATE and not np.any(run.inputs.rest_length_rate)
    settings = FREE if rate < FREE_RATE else STIFF if stiff else NORMAL
    if not tight:
        return settings
    factor = max(1.0 / TIGHTER, TIGHTEST / settings["rtol"])
    return {**settings, "rtol": factor * settings["rtol"], "atol": factor * settings["atol"]}


def reference_run(run: Scenario, cache: Path | None, tight: bool = False) -> tuple[Result, bool, np.ndarray]:
    """In a worker: the reference under a scenario, whether it was cached, and the scenario's sensitivity (K+1,), m: how
    far two runs of the kernel part whose starts are PERTURBATION apart.  The FMU under test has no part in it.
    """
    settings = reference_settings(run, tight)
    key = reference_key(run.model, run.inputs, settings)
    result, found = cached(cache, key, lambda: reference.simulate(run.model, run.inputs, **settings))
    one, other = (kernel.simulate(model, run.inputs).position for model in (run.model, perturbed(run.model)))
    return result, found, np.max(np.abs(other - one), axis=(1, 2))


def perturbed(model: Model) -> Model:
    """The model with its free nodes PERTURBATION off, across their bars."""
    axes = list(model.axes)
    shift = np.zeros_like(model.nodes)
    shift[:, axes] = np.random.default_rng(0).normal(size=(len(model.nodes), len(axes)))
    shift[model.fixed] = 0.0
    for (start, end), length in zip(model.bars, model.bar_length):
        along = (model.nodes[end] - model.nodes[start]) / length
        for node in (start, end):
            shift[node] -= along * (along @ shift[node])
    return replace(model, nodes=model.nodes + shift * (PERTURBATION / np.max(np.abs(shift))))


def submit(executor: Executor, runs: list[Scenario], cache: Path | None) -> list[Future]:
    """Start the reference runs of some scenarios, the long ones first."""
    order = sorted(range(len(runs)), key=lambda i: -float(np.max(runs[i].model.damping, initial=0.0)))
    started = {i: executor.submit(reference_run, runs[i], cache) for i in order}
    return [started[i] for i in range(len(runs))]


def finish(
    model: Model,
    runtime: str,
    runs: list[Scenario],
    outside: list,
    references: list[Future],
    executor: Executor,
    cache: Path | None,
) -> Validation:
    """Wait for the reference runs and compare; where that fails, once more with a tighter reference.

    executor, cache: as for `submit`.  Raises ValidationError where the reference cannot go on.
    """
    done = []
    for run, found, future in zip(runs, outside, references, strict=True):
        try:
            done.append(judged(run, found, future))
        except TensegrityError as error:
            raise ValidationError(f"{model.name}, {run.title}: {error}") from error
    return Validation(model, runtime, tuple(judge_again(done, outside, executor, cache)))


def judged(run: Scenario, found: tuple, future: Future, tight: bool = False) -> Run:
    """The run from outside, compared with the reference.  found: from run_outside; future: of reference_run."""
    fmu, events, seconds = found
    result, from_cache, growth = future.result()
    return Run(run, result, fmu, compare(result, fmu, events, growth), seconds, from_cache, tight)


def judge_again(done: list[Run], outside: list, executor: Executor, cache: Path | None) -> list[Run]:
    """The same runs, where they failed compared with a tighter reference, whose own error cannot be what passed a bound.

    A tighter reference that cannot go on clears nobody: then the failed comparison stays.
    """
    failed = [i for i, run in enumerate(done) if run.comparison.failures]
    again = {i: executor.submit(reference_run, done[i].scenario, cache, True) for i in failed}
    for i, future in again.items():
        with contextlib.suppress(TensegrityError):
            done[i] = judged(done[i].scenario, outside[i], future, tight=True)
    return done
