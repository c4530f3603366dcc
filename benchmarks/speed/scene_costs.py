"""What a scene costs, and what it does not pay for: ``python -m benchmarks.speed.scene_costs`` writes docs/scene_costs.json and
docs/scene-costs.md, in about 3 minutes.

Everything is measured in C (functions of scene_costs*.c, compiled with the kernel's own sources and flags); a C compiler is
needed.  Times are processor times.  All scenes take part in every round, so that they see the same state of the machine; shown
are the minimum and the median over the rounds.  Definitions:

* parts of a step: calls one after the other at a state of the scene's motion, all strings as at its start;
* step: a run in which no string changes its piece, over its accepted steps, so with the rejected ones and with step size
  control, search for transitions and outputs.  The push is reduced by halves until no method meets a transition;
* transition: from the search that finds one on a step's dense output to the derivative from which the next step starts, so
  location, state, switch and new start; strings that switch together count once.  The push is doubled until every method
  meets transitions;
* attempts lost: the step with the transition goes only part of its way, and those after the new start are short or rejected
  until one is as long again: the attempted steps of that time, less as many of the former length as cover it;
* cold: one call after the caches were emptied.
"""

from __future__ import annotations

import ctypes
from collections import defaultdict
from ctypes import c_double, c_int, c_int64, c_void_p
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.harness import problems
from benchmarks.harness.page import Page, rendered
from benchmarks.harness.timing import recorded, summary
from benchmarks.peers import toolchain
from tensegrity_core.files import scratch
from tensegrity_core.kernel import Kernel
from tensegrity_core.model import Model
from tensegrity_core.scene.towers import tower
from tensegrity_core.statics import build_model

STEPPED = ("dop853", "rodas5p", "radau9", "ros2")
PARTS = {
    "rhs": "right-hand side",
    "jacobian": "Jacobian",
    "factorisation": "factorisation",
    "solve": "solve",
    "complex_factorisation": "complex factorisation",
    "complex_solve": "complex solve",
}
SCENES = ("two_bar", "two_bar_nsh", "three_bar", "three_bar_nsh", "six_bar", "six_bar_nsh")
TOWERS = {10: 0.2, 100: 0.05}  # stages: duration of a run, s
LARGE = (100, 500, 1000)  # stages of the towers that are also measured with empty caches
SPACE, FREED = "two_bar in space", "three_bar without supports"
TOLERANCE, DURATION = 1e-8, 1.0
BATCH = 1e-3  # s
SMALLEST, LARGEST = 2.0**-60, 2.0**8  # parts of the push that are tried
COUNTED = ("steps", "rejected", "rhs", "transitions", "restarts")

# --- scenes ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Subject:
    """A scene to measure; what: r: runs of it, c: parts also with empty caches; duration: of a run, s."""

    name: str
    model: Model
    what: str = ""
    duration: float = DURATION

    @property
    def force(self) -> np.ndarray:
        """(F * D,) N: the kernel's input `force`, the push of the problems."""
        return problems.kernel_force(self.model, problems.push(self.model))


def subjects() -> list[Subject]:
    """All scenes, and the same in other forms to compare with."""
    models = {name: problems.built_in(name) for name in SCENES}
    found = [Subject(name, model, "r") for name, model in models.items()]
    for stages in sorted({*TOWERS, *LARGE}):
        what = "r" * (stages in TOWERS) + "c" * (stages in LARGE)
        found.append(Subject(tower_name(stages), build_model(tower(stages)), what, TOWERS.get(stages, DURATION)))
    found.append(Subject(SPACE, replace(models["two_bar"], axes=(0, 1, 2)), duration=1e-3))
    supports = np.zeros(len(models["three_bar"].nodes), dtype=bool)
    found.append(Subject(FREED, replace(models["three_bar"], fixed=supports, gravity=0.0), duration=1e-3))
    return found


def tower_name(stages: int) -> str:
    return f"tower of {stages}"


# --- measuring ---------------------------------------------------------------------------------------------------


def library(folder: Path) -> Path:
    """scene_costs.c with the kernel, whose stepping loop has its traced twin."""
    sources = [str(Path(__file__).with_suffix(".c")), str(Path(__file__).with_name("scene_costs_traced.c"))]
    extra = ["-shared", "-fPIC"]
    return toolchain.compile_program(sources + toolchain.kernel_sources("integrate.c"), folder / "scene_costs.so", extra)


def functions(path: Path) -> ctypes.CDLL:
    """Of scene_costs.c and its twin."""
    found = ctypes.CDLL(str(path))
    found.prepare_parts.argtypes = found.block_count.argtypes = [c_void_p]
    found.time_part.argtypes, found.time_cold_part.argtypes = [c_void_p, c_int, c_int64], [c_void_p, c_int]
    found.time_step.argtypes = [c_void_p, c_double, c_void_p]
    found.time_part.restype = found.time_cold_part.restype = found.time_step.restype = c_double
    return found


class Bench:
    """A scene in the library, a kernel for each method; times: ns, of every batch; lost: attempts, by method.

    A batch is repeated for BATCH seconds.  Each round takes one of everything."""

    def __init__(self, case: Subject, path: Path):
        self.case, self.functions = case, functions(path)
        self.methods = STEPPED if "r" in case.what else STEPPED[:1]
        self.kernels = {m: Kernel(case.model, library=path, method=m, tolerance=TOLERANCE) for m in self.methods}
        self.times: dict[tuple, list[float]] = defaultdict(list)
        self.counts: dict[tuple, dict] = {}
        self.lost: dict[str, float] = {}
        self.smooth_part = self.full_part = 1.0
        if "r" in case.what:
            self.smooth_part, self.full_part = self.part_of_force(False), self.part_of_force(True)
            if self.smooth_part < 0.0:
                raise SystemExit(f"{case.name}: strings change their pieces without a push")

    def run(self, method: str, part: float, trace=None) -> float:
        """Seconds of a run from the start under this part of the force; trace: see `time_step`."""
        kernel = self.kernels[method]
        kernel["force"][:] = part * self.case.force
        kernel.initialize()
        spent = self.functions.time_step(kernel._sim, self.case.duration, trace)
        if spent < 0.0:
            raise SystemExit(f"{self.case.name}, {method}: {kernel._message()}")
        return spent

    def part_of_force(self, wanted: bool) -> float:
        """A part of the force under which no method meets a transition, or all do; -1: none is found."""
        part = 1.0
        for method in self.methods:
            self.run(method, part)
            while (self.kernels[method].stats["transitions"] > 0) != wanted:
                part *= 2.0 if wanted else 0.5
                if not SMALLEST <= part <= LARGEST:
                    return -1.0
                self.run(method, part)
        return part

    def take(self) -> None:
        """One round."""
        if "r" in self.case.what:
            for method in self.methods:
                self.take_runs(method)
        self.run(self.methods[0], self.smooth_part)  # all strings as at the start, nodes moving
        sim = self.kernels[self.methods[0]]._sim
        if not self.functions.prepare_parts(sim):
            raise SystemExit(f"{self.case.name}: a singular matrix")
        for number, part in enumerate(PARTS):
            spent, count, more = 0.0, 0, 1
            while spent < BATCH:
                spent, count, more = spent + self.functions.time_part(sim, number, more), count + more, count + more
            self.times[part].append(1e9 * spent / count)
        for number, part in enumerate(PARTS if "c" in self.case.what else ()):
            self.times[f"cold_{part}"].append(1e9 * self.functions.time_cold_part(sim, number))

    def take_runs(self, method: str) -> None:
        """A batch of each kind of runs: without transitions, with them, and these again with clock and count on."""
        kinds = {"smooth": self.smooth_part, "full": self.full_part}
        for kind in kinds if self.full_part > 0.0 else ("smooth",):
            seconds = self.batch(method, kinds[kind])
            self.times[kind, method].append(1e9 * float(np.mean(seconds)))
            self.counts[kind, method] = self.kernels[method].stats
        if self.full_part > 0.0:
            sums = np.zeros(2)
            runs = len(self.batch(method, self.full_part, sums))
            traced, lost = sums / (runs * self.counts["full", method]["restarts"])
            self.times["transition", method].append(1e9 * traced)
            self.lost.setdefault(method, float(lost))

    def batch(self, method: str, part: float, sums: np.ndarray | None = None) -> list[float]:
        """Seconds of runs; sums: of what is traced."""
        seconds, trace = [], np.empty(2)
        while sum(seconds) < BATCH:
            seconds.append(self.run(method, part, None if sums is None else trace.ctypes.data))
            if sums is not None:
                sums += trace
        return seconds

    def row(self) -> dict:
        """What docs/scene_costs.json says of a scene; times in ns."""
        kernel, what = self.kernels[self.methods[0]], self.case.what
        result = {"scene": self.case.name, "bars": kernel.counts["B"], "states": len(kernel.state) - 3}
        result |= {"strings": kernel.counts["S"], "blocks": self.functions.block_count(kernel._sim)}
        result |= {"memory": kernel.memory_size} | {part: summary(self.times[part], "batches") for part in PARTS}
        if "c" in what:
            result |= {f"cold_{part}": summary(self.times[f"cold_{part}"], "batches") for part in PARTS}
        if "r" in what:
            result |= {"duration": self.case.duration, "smooth_part": self.smooth_part, "full_part": self.full_part}
            result["methods"] = {method: self.stepping(method) for method in self.methods}
        return result

    def stepping(self, method: str) -> dict:
        """Steps and transitions of one method, after the definitions above; None: no push made strings change their pieces."""
        kinds = [kind for kind in ("smooth", "full") if (kind, method) in self.counts]
        counts = {kind: {name: self.counts[kind, method][name] for name in COUNTED} for kind in kinds}
        runs = {kind: summary(self.times[kind, method], "batches") for kind in kinds}
        result = {"step": {key: runs["smooth"][key] / counts["smooth"]["steps"] for key in ("min", "median")}}
        result |= {"runs": runs, "counts": counts, "transition": None, "attempts_lost": self.lost.get(method)}
        if "full" in kinds:
            result["transition"] = summary(self.times["transition", method], "batches")
        return result


def measure(cases: list[Subject], rounds: int) -> list[dict]:
    """One row per scene: facts, and {min, median, batches} of each time in ns."""
    with scratch() as folder:
        path = library(folder)
        benches = [Bench(case, path) for case in cases]
        for _ in range(rounds):
            for bench in benches:
                bench.take()
        return [bench.row() for bench in benches]


# --- showing -----------------------------------------------------------------------------------------------------


def whole_transition(found: dict) -> float:
    """ns: a transition with the attempts lost by it, each at the mean of the run without transitions (minima)."""
    counts = found["counts"]["smooth"]
    attempt = found["runs"]["smooth"]["min"] / (counts["steps"] + counts["rejected"])
    return found["transition"]["min"] + found["attempts_lost"] * attempt


def large(rows: list[dict]) -> list[dict]:
    """The towers that were measured with empty caches, the smallest first."""
    return sorted((r for r in rows if "cold_rhs" in r), key=lambda r: r["bars"])


def warm(row: dict, part: str) -> float:
    """Time of one call after the other, of that with empty caches, %."""
    return 100.0 * row[part]["min"] / row["cold_" + part]["min"]


def report(result: dict) -> str:
    """docs/scene-costs.md."""
    known = {r["scene"]: r for r in result["rows"]}
    pairs = [("space instead of the plane", SPACE, "two_bar"), ("free bars instead of pinned ones", FREED, "three_bar")]
    pairs += [("NSH", f"{name}_nsh", name) for name in ("two_bar", "three_bar", "six_bar")]
    return rendered(
        "speed/scene_costs",
        **result,
        known=known,
        parts=PARTS,
        stepped=STEPPED,
        others=(SPACE, FREED),
        pairs=[(what, known[more], known[less]) for what, more, less in pairs],
        large=large(result["rows"]),
        whole=whole_transition,
        warm=warm,
    )


@recorded
def collect(rounds: int) -> dict:
    """docs/scene_costs.json."""
    conditions = {"up": problems.PUSH_UP, "aside": problems.PUSH_ASIDE, "tolerance": TOLERANCE, "rounds": rounds}
    return {"conditions": conditions, "rows": measure(subjects(), rounds)}


PAGE = Page(__doc__, "scene_costs", collect, report, options={"rounds": 25})

if __name__ == "__main__":
    PAGE.main()
