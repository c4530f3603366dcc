"""Validates an FMU: fmpy runs it from outside, the reference gets the same held inputs, the two are compared.

The FMU runs in a fresh isolated interpreter, in a temporary folder, where this project's packages are barred (see
outside.py), under every scenario at its own tolerance, which tells what its users get, and at tight ones, which leave of its
errors those of its equations (see compare.py for the bounds).  Reference runs are spread over processes and may
come from a cache (see reference_cache.py).
"""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import time
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from tensegrity_core import kernel, processes, reference
from tensegrity_core.errors import TensegrityError
from tensegrity_core.fields import layout
from tensegrity_core.files import replacing, scratch, write_bytes, write_text
from tensegrity_core.model import Model, Result, Transition

from ..places import kept
from ..variables.arrays import element_names, wholes
from ..variables.interface import Variable, variables
from .compare import HOSTED_LEDGER_BOUND, LEDGER_BOUND, Comparison, compare, series
from .outside import WITH_PARENT
from .reference_cache import cached, reference_key
from .scenarios import Scenario
from .sensitivity import Spread, spreads
from .trials import trials

HERE = Path(__file__).parent
CACHE = kept() / "reference-cache"

#: Scenes that are known not to be sensitive: a comparison cut short is a failure.
NOT_SENSITIVE = ("three_bar", "three_bar_nsh")
#: Processes for reference runs, see processes.Workers.
workers = processes.Workers
#: Wall time after which a run from outside is given up, s.
TIMEOUT = 900.0
#: The FMU's tolerances in further runs, of which the best counts: what is wrong with its equations stays, while an accident of
#: the error control (a step that meets the square root at the fold of a string with memory) does not.
TIGHT = (1e-12, 2e-13)
#: What a host of FMI 3.0 makes use of then; at the FMU's own tolerance it steps as one of FMI 2.0 does.
HOSTS = (("events",), ("events", "early"))
#: The start error, m and m/s, that the FMU may be worth then; at its own tolerance LARGER times as much.
START_ERROR = 1e-9
#: Settings of the reference: keyword arguments of reference.simulate; and those of another run where a comparison fails.
SETTINGS: dict[str, Any] = {"rtol": 1e-12, "atol": 1e-13}
TIGHTER: dict[str, Any] = {"rtol": 1e-13, "atol": 1e-14}


class ValidationError(TensegrityError):
    """A validation that could not be carried out."""


@dataclass(frozen=True, eq=False)
class Reference:
    """What a worker finds out about a scenario.  cached: whether the run came from the cache; spreads: see `sensitivity`, for
    START_ERROR and LARGER times that; notes: what the user should know; seconds: processor time.
    """

    result: Result
    cached: bool
    spreads: tuple[Spread, Spread]
    notes: tuple[str, ...]
    seconds: float


@dataclass(frozen=True, eq=False)
class Run:
    """One scenario of an FMU.  fmu: its outputs by field at its own tolerance, see compare.series; comparison: of these;
    tight: of those at a tight tolerance, the better one, or of model exchange the same; seconds: per communication step; again:
    the reference ran once more, see `judge_again`.
    """

    scenario: Scenario
    reference: Result
    fmu: dict[str, np.ndarray]
    comparison: Comparison
    tight: Comparison
    seconds: float
    from_cache: bool
    again: bool = False

    @property
    def failures(self) -> list[str]:
        """What passed its bound, in words."""
        if self.tight is self.comparison:
            return self.comparison.failures
        tight = [f"{failure} (at a tolerance of {self.tight.tolerance:g})" for failure in self.tight.failures]
        return self.comparison.failures + tight

    @property
    def until(self) -> float:
        """How long the runs were compared at the tight tolerance, s."""
        return self.tight.until


@dataclass(frozen=True, eq=False)
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
        steps = [np.mean(np.diff(run.scenario.inputs.times)) for run in self.runs]
        return float(np.mean(steps)) / self.seconds

    @property
    def cut(self) -> list[Run]:
        """Runs that were compared for a part of their time only, because more would be too sensitive."""
        return [run for run in self.runs if run.until < run.scenario.inputs.times[-1]]

    @property
    def failures(self) -> list[str]:
        """What passed its bound, in words, with the scenario's title."""
        found = [f"{run.scenario.title}: {failure}" for run in self.runs for failure in run.failures]
        robust = self.model.name in NOT_SENSITIVE
        short = [run for run in self.cut if robust or run.until <= run.scenario.inputs.times[0]]
        return found + [f"{run.scenario.title}: could be compared until {run.until:g} s only" for run in short]


def run_outside(
    fmu: Path,
    model: Model,
    naming: str = "structured",
    runs: list[Scenario] | None = None,
    python: str = sys.executable,
    kind: str = "cs",
    fmi: str = "2.0",
) -> list[tuple[dict[str, np.ndarray], list[Transition], float]]:
    """Run an FMU in a fresh isolated interpreter.  Returns per scenario its outputs, transitions, and seconds per step.

    The scenarios' names must differ.
    python: the interpreter; it needs numpy and fmpy only; kind: 'cs', or 'me': integrated by CVODE, see exchange.py; fmi: the
    FMU's version of FMI.  Raises ValidationError with the interpreter's last words.
    """
    table = variables(model, naming)
    runs = trials(model) if runs is None else runs
    own = element_names(table) if fmi == "3.0" else {row.reference: row.name for row in table}
    given = [row for row in table if row.causality == "input"]
    names = [whole.name for whole in wholes(given)] if fmi == "3.0" else [row.name for row in given]
    with scratch() as here:
        for name in ("outside.py", "outside3.py", "exchange.py"):
            write_bytes(here / name, (HERE / name).read_bytes())
        script = here / ("outside.py" if kind == "cs" else "exchange.py")
        job: dict[str, Any] = {"fmu": str(fmu.absolute()), "runs": []}
        for i, run in enumerate(runs):
            with replacing(here / f"{i}.npz") as file:
                np.savez(file, times=run.inputs.times, values=input_values(table, run))
            parameters = {row.name: value for row, value in _changed(table, model, run)}
            item = {"name": run.name, "arrays": str(here / f"{i}.npz"), "inputs": names, "parameters": parameters}
            item |= {"host": run.host}
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
            common = {own[row.reference]: row.name for row in table}
            outputs = [common[name] for name in stored["output_names"].tolist()]
            return [_outcome(stored, run, table, outputs) for run in runs]


def _who(model: Model, name: str) -> tuple[int, int]:
    """(string, contact) of a name, one of them -1."""
    if name in model.string_names:
        return model.string_names.index(name), -1
    return -1, [model.node_names[contact.node] for contact in model.contacts].index(name)


def _outcome(stored, run: Scenario, table: tuple[Variable, ...], names: list[str]):
    who = [_who(run.model, name) for name in stored["strings"].tolist()]
    rows = stored[f"{run.name}/events"].tolist()
    events = [Transition(t, who[int(s)][0], int(a), int(b), contact=who[int(s)][1]) for t, s, a, b in rows]
    outputs = series(run.model, table, names, stored[f"{run.name}/outputs"])
    return outputs, events, float(stored[f"{run.name}/seconds"]) / (len(run.inputs.times) - 1)


def input_values(table: tuple[Variable, ...], run: Scenario) -> np.ndarray:
    """(K, inputs) in the order of the variable table."""
    return kernel.input_rows(run.model, run.inputs)[:, [row.reference for row in table if row.causality == "input"]]


def _changed(table: tuple[Variable, ...], model: Model, run: Scenario):
    """Parameters in which a scenario differs from the FMU's own values: tunable ones of its model, and the tolerance."""
    places = layout(model.counts)
    for row in table:
        if row.field in ("stiffness", "damping"):
            string = row.reference - places[row.field].start
            old, new = (float(getattr(m, row.field)[string]) for m in (model, run.model))
            if old != new:
                yield row, new
        if row.field == "tolerance" and run.tolerance is not None:
            yield row, run.tolerance


def repeated(runs: list[Scenario]) -> list[Scenario]:
    """The scenarios at the FMU's own tolerance, then at the tight ones."""
    tight = enumerate(zip(TIGHT, HOSTS, strict=True))
    return runs + [
        replace(run, name=f"{run.name}_tight{i}", tolerance=tolerance, host=host)
        for i, (tolerance, host) in tight
        for run in runs
    ]


def reference_settings(run: Scenario, again: bool = False) -> dict:
    """Keyword arguments of reference.simulate under a scenario; again: for the tighter run."""
    return {**(TIGHTER if again else SETTINGS), "method": run.method}


def reference_run(run: Scenario, cache: Path | None, again: bool = False, place: int = 0) -> Reference:
    """In a worker: the reference under a scenario, and the scenario's spreads, in which the FMU under test has no part.

    place: where it tells how far it has come, see processes.tell.
    """
    began = time.process_time()
    notes: list[str] = []
    settings = reference_settings(run, again)
    key = reference_key(run.model, run.inputs, settings)
    told = partial(processes.tell, place)
    result, found = cached(cache, key, lambda: reference.simulate(run.model, run.inputs, **settings, told=told), notes.append)
    return Reference(result, found, spreads(run.model, run.inputs, START_ERROR), tuple(notes), time.process_time() - began)


def submit(executor: Executor, runs: list[Scenario], cache: Path | None, first: int = 0) -> list[Future]:
    """Start the reference runs of some scenarios, the long ones first.  first: the first of their places, see reference_run."""
    order = sorted(range(len(runs)), key=lambda i: -float(np.max(runs[i].model.damping, initial=0.0)))
    started = {i: executor.submit(reference_run, runs[i], cache, place=first + i) for i in order}
    return [started[i] for i in range(len(runs))]


def finish(
    model: Model,
    runtime: str,
    runs: list[Scenario],
    outside: list,
    references: list[Future],
    executor: Executor,
    cache: Path | None,
    say=lambda text: None,
    waits=lambda future: None,
) -> Validation:
    """Wait for the reference runs and compare; where that fails, once more with a tighter reference.

    outside: what run_outside returned for `repeated` runs, of model exchange for the runs alone; executor, cache: as for
    `submit`; say: gets a line of progress per scenario; waits: called with each future before its result is asked for.  Raises
    ValidationError where the reference cannot go on.
    """
    done, found = [], [outside[i :: len(runs)] for i in range(len(runs))]
    for run, one, future in zip(runs, found, references, strict=True):
        waits(future)
        try:
            done.append(judged(run, one, future))
        except TensegrityError as error:
            raise ValidationError(f"{model.name}, {run.title}: {error}") from error
        say(progress(model, runtime, run, done[-1], future.result(), f"{len(done)} of {len(runs)}"))
    return Validation(model, runtime, tuple(judge_again(done, found, executor, cache, waits)))


def progress(model: Model, runtime: str, run: Scenario, judged: Run, found: Reference, counted: str) -> str:
    """A line for somebody who waits."""
    took = "reference from the cache" if found.cached else f"reference in {found.seconds:.1f} s"
    part = 100.0 * max(judged.comparison.part, judged.tight.part)
    simulated = f"{run.inputs.times[-1] - run.inputs.times[0]:g} s"
    return f"  {model.name}, {runtime}: {run.short or run.title}, {simulated}: {part:.2g} % of the bounds; {took} ({counted})"


def judged(run: Scenario, found: list, future: Future, again: bool = False) -> Run:
    """The runs from outside, compared with the reference.  found: what run_outside returned for this scenario, at the FMU's own
    tolerance and at the tight ones; future: of reference_run."""
    right = future.result()
    longest = float(np.max(run.model.bar_length, initial=0.0))
    small, large = right.spreads
    (fmu, events, seconds), *others = found
    ledger = LEDGER_BOUND if others else HOSTED_LEDGER_BOUND
    own = compare(right.result, fmu, events, large, longest, ledger_bound=ledger)
    if not others:  # integrated by a host, whose tolerance is no affair of the FMU's
        return Run(run, right.result, fmu, own, own, seconds, right.cached, again)
    tight = [
        compare(right.result, one[0], one[1], small, longest, tolerance) for one, tolerance in zip(others, TIGHT, strict=True)
    ]
    best = min(tight, key=lambda one: (len(one.failures), one.part))
    return Run(run, right.result, fmu, own, best, seconds, right.cached, again)


def judge_again(done: list[Run], found: list, executor: Executor, cache: Path | None, waits) -> list[Run]:
    """The same runs, where they failed compared with a tighter reference, whose own error cannot be what passed a bound.

    A tighter reference that cannot go on clears nobody: then the failed comparison stays.
    """
    failed = [i for i, run in enumerate(done) if run.failures]
    again = {i: executor.submit(reference_run, done[i].scenario, cache, True) for i in failed}
    for i, future in again.items():
        waits(future)
        with contextlib.suppress(TensegrityError):
            done[i] = judged(done[i].scenario, found[i], future, again=True)
    return done
