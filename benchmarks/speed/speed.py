"""Speed of the kernel and of the pythonfmu FMU: ``python -m benchmarks.speed.speed`` writes docs/speed.json and docs/speed.md,
in about a minute.

Every row has an error beside its time: largest deviation of the nodes from a run by radau9 at tolerance 1e-13.  Runs of the
kernel are interleaved, and a time is the least processor time of the rounds; the FMU's steps are timed by the wall clock.
"""

from __future__ import annotations

import sys

import numpy as np

from benchmarks.harness import problems
from benchmarks.harness.page import Page, rendered
from benchmarks.harness.timing import follow, in_turns, recorded
from fmu_src import build as build_fmu
from fmu_src.validation import speed as fmu_speed
from tensegrity_core.files import scratch
from tensegrity_core.kernel import Kernel
from tensegrity_core.native import build

SCENES, TOLERANCES = ("three_bar", "three_bar_nsh"), (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-10)
METHODS, ERRORS = ("auto", "dop853", "rodas5p", "radau9"), (1e-6, 1e-8)


def kernel_rows(rounds: int) -> list[dict]:
    """Every scene, damping, method and tolerance."""
    return [row for scene in SCENES for damping in problems.DAMPINGS for row in problem_rows(scene, damping, rounds)]


def problem_rows(scene: str, damping: float, rounds: int) -> list[dict]:
    problem = problems.pushed(scene, damping)
    task = problem.kernel_force, problem.duration
    exact = follow(Kernel(problem.model, method="radau9", tolerance=1e-13), *task)[1]
    kernels = {(m, tol): Kernel(problem.model, method=m, tolerance=tol) for m in METHODS for tol in TOLERANCES}
    errors = {key: float(np.abs(follow(kernel, *task)[1] - exact).max()) for key, kernel in kernels.items()}
    rows = []
    for key, seconds in least_seconds(kernels, problem, rounds).items():
        row = {"scene": scene, "damping": damping, **dict(zip(("method", "tolerance"), key)), "error": errors[key]}
        each = seconds / problem.duration
        rows.append(row | {"ms_per_s": 1e3 * each, "real_time_factor": 1.0 / each, **kernels[key].stats})
    return rows


def least_seconds(kernels: dict, problem: problems.Problem, rounds: int) -> dict:
    """By the keys of the kernels, which take turns."""
    runs = {key: lambda k=kernel: follow(k, problem.kernel_force, problem.duration)[0] for key, kernel in kernels.items()}
    return {key: min(seconds) for key, seconds in in_turns(runs, rounds).items()}


def processor_rows(rounds: int) -> dict:
    """What it costs to compile for any x86-64 instead of this very processor: one ratio, interleaved."""
    problem = problems.pushed("three_bar_nsh", 500.0)
    with scratch() as folder:
        libraries = {}
        for name, extra in {"shipped": [], "march_native": ["-march=native"]}.items():
            target = folder / name
            target.mkdir()
            compiler = build.system_compiler() or [sys.executable, "-m", "ziglang", "cc"]
            libraries[name] = build.compile_library(target, [*compiler, *extra])
        kernels = {n: Kernel(problem.model, library=path, method="dop853", tolerance=1e-8) for n, path in libraries.items()}
        least = least_seconds(kernels, problem, 10 * rounds)
    return {"shipped_over_march_native": least["shipped"] / least["march_native"]}


def fmu_row(scene: str, step: float = 1e-3) -> dict:
    """The pythonfmu FMU of a scene through fmpy's low-level calls."""
    with scratch() as folder:
        if build_fmu.main([scene, "--no-validate", "--output", str(folder)]):
            raise SystemExit(f"building the FMU of {scene} failed")
        measured = fmu_speed.measure(folder / "python" / f"{scene}.fmu", h=step)
    counts = Kernel(problems.built_in(scene)).counts
    inputs = counts["F"] * counts["D"] + 2 * counts["S"]
    speed = {"time_per_step": measured.step, "real_time_factor": measured.factor}
    return {"scene": scene, "step_size": step, **speed, "inputs": inputs}


def best(rows: list[dict], scene: str, damping: float, error: float) -> dict:
    """The fastest row that reaches an error."""
    fitting = [r for r in rows if r["scene"] == scene and r["damping"] == damping and r["error"] <= error]
    return min(fitting, key=lambda r: r["ms_per_s"])


def report(result: dict) -> str:
    """docs/speed.md."""
    rows = result["kernel"]
    cases = dict.fromkeys((r["scene"], r["damping"]) for r in rows)
    found = [(error, best(rows, *case, error)) for case in cases for error in result["conditions"]["errors"]]
    return rendered("speed/speed", **result, best=found)


@recorded
def collect(rounds: int) -> dict:
    """docs/speed.json."""
    conditions = {"up": problems.PUSH_UP, "aside": problems.PUSH_ASIDE, "errors": list(ERRORS), "rounds": rounds}
    found = {"conditions": conditions, "kernel": kernel_rows(rounds), "processor": processor_rows(rounds)}
    return found | {"fmu": fmu_row("three_bar_nsh")}


PAGE = Page(__doc__, "speed", collect, report, options={"rounds": 15})

if __name__ == "__main__":
    PAGE.main()
