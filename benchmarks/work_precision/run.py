"""Work against precision: ``python -m benchmarks.work_precision.run`` writes docs/work_precision.json, the figures
docs/figures/work_precision_*.png and docs/work-precision.md.

Every contender solves every problem (problems.py) at a ladder of tolerances or steps; error and time come from the same
run.  The error is the largest deviation of the judged nodes from a run of our radau9 at tolerance 1e-13, at 21 instants.
Contenders take turns in each round, on one core; of the processor times of all repetitions the median and the least are kept.
Where a run takes longer than --limit, or all first runs of a contender together do, its tighter settings are left out, and the
data say so (`cut`).

A full run takes about 30 minutes of one idle core.

SUNDIALS needs its library and headers (Debian: apt-get install libsundials-dev), MuJoCo its wheel (pip install mujoco);
what is missing is said, and its rows are left out.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

import numpy as np

from benchmarks.harness import machine, problems
from benchmarks.harness.page import Page, command
from benchmarks.peers import article, mujoco_engine, native, scipy_compiled, toolchain
from benchmarks.peers.ladder import Ladder, Run, too_long
from tensegrity_core.files import scratch

from . import data, figures, nsh, report

PEERS = ("cvode", "arkode", "plain", "scipy", "article", "mujoco")
#: Time of one turn of a fast contender, s: it repeats its run as often as fits.
TURN = 0.008
MOST_REPETITIONS = 20
#: So many loose settings may exceed the limit before one is solved: bars that stretch can cost more than accuracy does.
LEADING = 3
#: Longer problems (s) may take LONG times the limit.
LONG_DURATION, LONG = 10.0, 2.5


@dataclass
class Entry:
    """A ladder's rung: its first run, the seconds of all its runs, and whether the time limit cut the ladder."""

    ladder: Ladder
    setting: float
    run: Run
    seconds: list[float]
    cut: bool = False


def reference(bench: native.Bench) -> tuple[Run, dict[str, float]]:
    """Our kernel at tolerance 1e-13 by radau9, and how far other methods are from it there, m."""
    runs = {method: bench.kernel(method, 1e-13, 1) for method in ("radau9", "dop853", "rodas5p")}
    for run in runs.values():
        if run.failure:
            raise SystemExit(f"the reference solution of {bench.problem.name} failed: {run.failure}")
    exact = runs.pop("radau9")
    return exact, {method: deviation(run, exact, bench.problem) for method, run in runs.items()}


def deviation(run: Run, exact: Run, problem: problems.Problem) -> float:
    """Largest difference of a coordinate of the judged nodes over the instants, m."""
    return float(np.abs(run.position - exact.position)[:, problem.judged].max())


def ladders(bench: native.Bench, peers: set[str]) -> list[Ladder]:
    """Everyone who takes part in a problem."""
    problem = bench.problem
    found = native.kernel_ladders(bench)
    if problem.figure == "mujoco":
        return found + (mujoco_engine.ladders(problem) if "mujoco" in peers else [])
    found += [ladder for ladder in native.sundials_ladders(bench) if ladder.family in peers]
    if "scipy" in peers:
        found += scipy_compiled.ladders(bench)
    if "article" in peers:
        found += article.ladders(problem)
    return found


def climb(ladder: Ladder, limit: float, stride: int) -> list[Entry]:
    """Every rung once, every `stride`-th in a quick run; until a run after a solved one, or all of them together, took longer
    than the limit (s)."""
    entries, spent, solved, settings = [], 0.0, False, ladder.settings[::stride]
    for setting in settings:
        run = ladder.measure(setting, 1, limit)
        entries.append(Entry(ladder, setting, run, list(run.seconds)))
        late = run.failure == too_long(limit)
        spent += 0.0 if late else sum(run.seconds)
        solved = solved or run.failure is None
        if spent > limit or (late and (solved or len(entries) == LEADING)):
            break
    for entry in entries:
        entry.cut = late or len(entries) < len(settings)
    return entries


def measure(
    problem: problems.Problem, tools: toolchain.Tools, folder: Path, options: argparse.Namespace
) -> tuple[list[dict], dict]:
    """Rows of one problem, and what is said of it."""
    bench = native.Bench(problem, tools, folder / problem.name.replace("/", "_"))
    exact, apart = reference(bench)
    stride, limit = 4 if options.quick else 1, options.limit * (LONG if problem.duration > LONG_DURATION else 1.0)
    entries = [entry for ladder in ladders(bench, options.peers) for entry in climb(ladder, limit, stride)]
    for _ in range(options.rounds):
        for entry in entries:
            if entry.run.failure or sum(entry.seconds) > options.budget:
                continue
            repetitions = int(np.clip(TURN / entry.seconds[0], 1, MOST_REPETITIONS))
            entry.seconds += entry.ladder.measure(entry.setting, repetitions, limit).seconds
    about = {
        "figure": problem.figure,
        "title": problem.title,
        "duration": problem.duration,
        "limit": limit,
        "smooth": problem.smooth,
        "reference_difference": apart,
        "transitions": exact.counts["transitions"],
        "rhs_ns": float(f"{1e9 * bench.rhs_seconds():.4g}"),
    }
    return [row(problem, entry, exact) for entry in entries], about


def row(problem: problems.Problem, entry: Entry, exact: Run) -> dict:
    """One rung as data."""
    run, ladder = entry.run, entry.ladder
    found = {
        "problem": problem.name,
        "family": ladder.family,
        "method": ladder.method,
        "events": ladder.events,
        "kind": ladder.kind,
        "cut": entry.cut,
        "setting": entry.setting,
    }
    error = None
    if run.failure is None:
        difference = deviation(run, exact, problem)
        error = float(f"{difference:.4g}") if np.isfinite(difference) else None
    found["error"] = error
    if problem.conservative:
        known = run.failure is None and run.energy is not None
        drift = np.abs(run.energy - exact.energy[0]).max() / abs(exact.energy[0]) if known else np.nan
        found["energy_error"] = float(f"{drift:.4g}") if np.isfinite(drift) else None
    for name, chosen in (("ms_per_s", statistics.median), ("ms_least", min)):
        found[name] = float(f"{1e3 * chosen(entry.seconds) / problem.duration:.4g}") if entry.seconds else None
    found["runs"] = len(entry.seconds)
    return found | {"failure": run.failure} | run.counts


def parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = command(__doc__)
    parser.add_argument("--problems", default="*", help="names or patterns, with commas between them: three_bar/*,free_flight")
    parser.add_argument("--peers", default=",".join(PEERS), help="families, with commas between them; none: our kernel alone")
    parser.add_argument("--rounds", type=int, default=3, help="turns of every contender after its first run")
    parser.add_argument("--budget", type=float, default=0.2, help="s after which a rung takes no further turn")
    parser.add_argument("--limit", type=float, default=3.0, help="s that a run may take, and all first runs of a contender")
    parser.add_argument("--quick", action="store_true", help="two rounds, every fourth setting, runs of 0.3 s at most")
    options = parser.parse_args(arguments)
    patterns = options.problems.split(",")
    options.problems = [name for name in problems.names() if any(fnmatch(name, p) for p in patterns)]
    if not options.problems:
        parser.error(f"--problems: no name fits; there are {', '.join(problems.names())}")
    options.peers = set(options.peers.split(",")) - {"none", ""}
    if unknown := options.peers - set(PEERS):
        parser.error(f"--peers: {', '.join(sorted(unknown))} unknown; use some of {', '.join(PEERS)}, or none")
    if options.quick:
        options.rounds, options.limit = min(options.rounds, 2), min(options.limit, 0.3)
    return options


def measure_all(options: argparse.Namespace) -> dict:
    """All problems, on one core."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    began = time.perf_counter()
    result: dict = {"machine": machine.describe(), "problems": {}, "rows": []}
    with scratch() as folder:
        tools = toolchain.build(folder)
        result["machine"]["sundials"] = tools.sundials or "missing"
        for name in options.problems:
            start = time.perf_counter()
            rows, result["problems"][name] = measure(problems.problem(name), tools, folder, options)
            result["rows"] += rows
            print(f"{name}: {len(rows)} settings, {time.perf_counter() - start:.0f} s", flush=True)
        if set(nsh.problems_needed()) <= set(options.problems):
            result["nsh"] = nsh.measure(tools, folder, options.rounds)
    load = round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None
    result["machine"] |= {"mujoco": _version("mujoco"), "load": load}
    result["settings"] = {"rounds": options.rounds, "limit": options.limit, "quick": options.quick}
    result["seconds"] = round(time.perf_counter() - began)
    return result


def _version(module: str) -> str:
    """Of an optional module."""
    try:
        return __import__(module).__version__
    except ImportError:
        return "missing"


PAGE = Page(__doc__, "work_precision", measure_all, report.page, figures.FIGURES, keep=data.save, read=data.load)


def main(arguments: list[str] | None = None) -> None:
    options = parse(arguments)
    PAGE.write(options.docs, options.redraw, options=options)


if __name__ == "__main__":
    main()
