"""What an NSH costs `auto`: runs of three_bar for 1 s with NSH and without, under the same parts of the push.

Each run is the fastest that comes within TARGET.  A transition-free second is a run under so small a part that no string
changes its piece; a transition costs what a run under a large part takes longer than that, over its transitions.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np

from benchmarks.harness.problems import DAMPINGS, pushed
from benchmarks.peers.ladder import tolerances
from benchmarks.peers.native import Bench
from benchmarks.peers.toolchain import Tools

from .data import TARGET

PLAIN, NSH = "three_bar", "three_bar_nsh"
SMALL = (-0.1, -0.075, -0.05, -0.035, -0.02, -0.01, 0.01, 0.02)  # parts of the push without transitions, and with
LARGE = (0.5, 0.75, 1.0, 1.25, 1.5, 2.0)
TOLERANCES = tolerances(1e-4, 1e-11, 2)
TRIALS, REPETITIONS = 3, 10


@dataclass
class Case:
    """One run; seconds: all its times."""

    bench: Bench
    push: float
    tolerance: float
    transitions: int
    seconds: list[float] = field(default_factory=list)


def problems_needed() -> list[str]:
    """Names of the problems that these runs vary."""
    return [f"{scene}/{d:g}" for scene in (PLAIN, NSH) for d in DAMPINGS]


def fastest_case(bench: Bench, push: float) -> Case | None:
    """At the tolerance with the least time among those that reach TARGET; None where none does."""
    exact, found = bench.kernel("radau9", 1e-13, 1), []
    for tolerance in TOLERANCES:
        run = bench.kernel("auto", tolerance, TRIALS)
        if run.failure is None and np.abs(run.position - exact.position)[:, bench.problem.judged].max() <= TARGET:
            found.append((min(run.seconds), tolerance, run.counts["transitions"]))
    return Case(bench, push, *min(found)[1:]) if found else None


def measure(tools: Tools, folder: Path, rounds: int) -> list[dict]:
    """A row per scene, damping and push: the least time, ms."""
    rows = []
    for damping in DAMPINGS:
        cases = []
        for scene in (PLAIN, NSH):
            problem = pushed(scene, damping)
            for push in (*SMALL, *LARGE):
                bench = Bench(replace(problem, force=push * problem.force), tools, folder / f"nsh_{scene}_{damping:g}_{push:g}")
                if case := fastest_case(bench, push):
                    cases.append((scene, case))
        for _ in range(rounds + 1):  # all take turns
            for _, case in cases:
                case.seconds += case.bench.kernel("auto", case.tolerance, REPETITIONS).seconds
        rows += [_row(scene, damping, case) for scene, case in cases]
    return rows


def _row(scene: str, damping: float, case: Case) -> dict:
    found = {"scene": scene, "damping": damping, "push": case.push, "tolerance": case.tolerance}
    return found | {"transitions": case.transitions, "ms": float(f"{1e3 * min(case.seconds):.4g}")}


class Cost(NamedTuple):
    """Medians over the pushes without NSH and with, ms or µs; ratios: with over without, push by push, and their median."""

    plain: float
    nsh: float
    ratios: tuple[float, ...]
    ratio: float


def _cost(pairs: list[tuple[float, float]]) -> Cost | None:
    """Of values without NSH and with."""
    if not pairs:
        return None
    plain, nsh = zip(*pairs)
    ratios = tuple(b / a for a, b in pairs)
    return Cost(median(plain), median(nsh), ratios, median(ratios))


def costs(runs: list[dict], damping: float) -> tuple[Cost | None, Cost | None]:
    """Of a transition-free second, ms, and of a transition, µs; None where no push tells it."""
    known = {(run["scene"], run["push"]): run for run in runs if run["damping"] == damping}
    pairs = [(run, known[NSH, push]) for (scene, push), run in known.items() if scene == PLAIN and (NSH, push) in known]
    calm = [(a["ms"], b["ms"]) for a, b in pairs if not a["transitions"] and not b["transitions"]]
    second = _cost(calm)
    if second is None:
        return None, None
    busy = [
        (1e3 * (a["ms"] - second.plain) / a["transitions"], 1e3 * (b["ms"] - second.nsh) / b["transitions"])
        for a, b in pairs
        if a["transitions"] and b["transitions"] and abs(a["push"]) >= min(LARGE)
    ]
    return second, _cost([(a, b) for a, b in busy if a > 0.0 and b > 0.0])
