"""What scenes pay for parts that they do not have: ``python -m benchmarks.speed.unused_parts`` writes docs/unused_parts.json
and docs/unused-parts.md, in about two minutes.

The kernel as it is and the kernel of the commit before actuators, moved nodes, point masses, drag, general force laws and
memory are compiled by the same compiler and called in turns, each through its own Python package, on the six scenes, which have
none of these.  A ratio is that of the least processor times of the rounds; the positions that both reach are compared.
"""

from __future__ import annotations

import importlib
import io
import subprocess
import sys
import tarfile
import time
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np

from benchmarks.harness import machine
from benchmarks.harness.page import Page, paragraphs, table
from tensegrity_core.files import scratch
from tensegrity_core.native import build
from tensegrity_core.scene import builtin_scenes

ROOT = Path(__file__).resolve().parent.parent.parent
#: The last commit before these parts, and what it is imported as.
BEFORE, PACKAGE = "8bcbf09", "tensegrity_before"
ROUNDS, PUSH = 60, 100.0


class Task(NamedTuple):
    """step: communication step, s; count: steps of a run; changing: the force is another one at every step."""

    title: str
    step: float
    count: int
    changing: bool
    tolerance: float


TASKS = (
    Task("1 ms, force changes", 1e-3, 500, True, 1e-6),
    Task("1 ms, force stays", 1e-3, 1000, False, 1e-6),
    Task("50 ms, force changes", 0.05, 40, True, 1e-10),
    Task("2 s", 2.0, 1, False, 1e-10),
)


def before(folder: Path) -> ModuleType:
    """The package of the commit before, compiled in a folder of its own."""
    archive = subprocess.run(["git", "archive", BEFORE, "tensegrity_core"], cwd=ROOT, capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as files:
        files.extractall(folder, filter="data")
    (folder / "tensegrity_core").rename(folder / PACKAGE)
    sys.path.insert(0, str(folder))
    importlib.import_module(f"{PACKAGE}.native.build").compile_library(folder / PACKAGE / "native")
    return importlib.import_module(PACKAGE)


def kernel_of(package: str, scene: str, task: Task, library: Path | None = None):
    """A kernel of a package, with the scene as that package reads it."""
    parts = [importlib.import_module(f"{package}.{name}") for name in ("kernel", "scene", "statics")]
    model = parts[2].build_model(parts[1].load_scene(scene))
    return parts[0].Kernel(model, library=library, tolerance=task.tolerance)


def run(kernel, task: Task) -> float:
    """Processor seconds of a task: a push on the second free node, with a changing sign where it changes."""
    force = kernel["force"]
    force[:] = 0.0
    kernel.initialize()
    at, step = 2 * kernel.counts["D"] - 1, kernel.step
    began = time.process_time()
    for i in range(task.count):
        if task.changing or i == 0:
            force[at] = PUSH * (-1.0) ** (10 * i // task.count) + 1e-3 * i
        step(task.step)
    return time.process_time() - began


def row(scene: str, task: Task, library: Path, rounds: int) -> dict:
    kernels = {"before": kernel_of(PACKAGE, scene, task), "now": kernel_of("tensegrity_core", scene, task, library)}
    seconds: dict[str, list[float]] = {name: [] for name in kernels}
    for n in range(rounds):
        for name in sorted(kernels, reverse=bool(n % 2)):
            seconds[name].append(run(kernels[name], task))
    least = {name: min(values) for name, values in seconds.items()}
    apart = float(np.abs(kernels["now"]["position"] - kernels["before"]["position"]).max())
    return {
        "scene": scene,
        "task": task.title,
        "us_per_step": 1e6 * least["now"] / task.count,
        "apart": apart,
        "ratio": least["now"] / least["before"],
    }


def collect(rounds: int) -> dict:
    """docs/unused_parts.json."""
    began, where = time.perf_counter(), machine.describe()
    with scratch() as folder:
        before(folder)
        present = folder / "now"
        present.mkdir()
        library = build.compile_library(present)
        rows = [row(scene, task, library, rounds) for scene in builtin_scenes() for task in TASKS]
    return {"machine": where, "before": BEFORE, "rounds": rounds, "rows": rows, "seconds": round(time.perf_counter() - began)}


def mean(values) -> float:
    """Geometric mean."""
    return float(np.exp(np.mean(np.log(list(values)))))


def report(result: dict) -> str:
    """docs/unused-parts.md."""
    where, rows = result["machine"], result["rows"]
    titles = [task.title for task in TASKS]
    found = {(r["scene"], r["task"]): r for r in rows}
    scenes = list(dict.fromkeys(r["scene"] for r in rows))
    body = [[s, *(f"{found[s, t]['ratio']:.3f} ({found[s, t]['us_per_step']:.3g} us)" for t in titles)] for s in scenes]
    means = [mean(found[s, t]["ratio"] for s in scenes) for t in titles]
    body.append(["geometric mean", *(f"{value:.3f}" for value in means)])
    over = sum(r["ratio"] > 1.02 for r in rows)
    return paragraphs(
        "# What unused parts cost",
        "Written by `python -m benchmarks.speed.unused_parts`; the figures stand in [unused_parts.json](unused_parts.json), "
        f"and `--redraw` writes this page from them. {where['processor']}, {where['system']}, Python {where['python']}, one "
        f"thread, commit {where['commit']}, {where['date']}, in {result['seconds']} s.",
        f"Processor time of the kernel over that of the kernel at commit {result['before']}, which knew neither "
        "actuators, moved nodes, point masses, drag and gravity vectors, nor general force laws and memory; in "
        "brackets the time of a communication step, called from Python. The six scenes have none of these parts. "
        f"Both kernels are compiled alike and called in turns, {result['rounds']} rounds, the least counts. "
        f"Positions at the end differ by at most {max(r['apart'] for r in rows):.0e} m.",
        table(["scene", *titles], body),
        f"Over all: {mean(r['ratio'] for r in rows):.3f}. {over} of {len(rows)} ratios exceed 1.02.",
    )


PAGE = Page(__doc__, "unused_parts", collect, report, options={"rounds": ROUNDS})

if __name__ == "__main__":
    PAGE.main()
