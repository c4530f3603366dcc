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
from scipy.stats import gmean

from benchmarks.harness.machine import ROOT
from benchmarks.harness.page import Page, rendered
from benchmarks.harness.timing import in_turns, recorded
from tensegrity_core.files import scratch
from tensegrity_core.native import build
from tensegrity_core.scene import builtin_scenes

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
    seconds = in_turns({name: lambda k=kernel: run(k, task) for name, kernel in kernels.items()}, rounds)
    now, then = min(seconds["now"]), min(seconds["before"])
    apart = float(np.abs(kernels["now"]["position"] - kernels["before"]["position"]).max())
    return {"scene": scene, "task": task.title, "us_per_step": 1e6 * now / task.count, "apart": apart, "ratio": now / then}


@recorded
def collect(rounds: int) -> dict:
    """docs/unused_parts.json."""
    with scratch() as folder:
        before(folder)
        present = folder / "now"
        present.mkdir()
        library = build.compile_library(present)
        rows = [row(scene, task, library, rounds) for scene in builtin_scenes() for task in TASKS]
    return {"before": BEFORE, "rounds": rounds, "rows": rows}


def report(result: dict) -> str:
    """docs/unused-parts.md."""
    rows, titles = result["rows"], [task.title for task in TASKS]
    means = [gmean([r["ratio"] for r in rows if r["task"] == title]) for title in titles]
    return rendered("speed/unused_parts", **result, titles=titles, means=means, mean=gmean([r["ratio"] for r in rows]))


PAGE = Page(__doc__, "unused_parts", collect, report, options={"rounds": ROUNDS})

if __name__ == "__main__":
    PAGE.main()
