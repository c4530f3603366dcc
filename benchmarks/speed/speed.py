"""Speed of the kernel and of the pythonfmu FMU: ``python -m benchmarks.speed.speed`` writes docs/speed.json and docs/speed.md,
in about a minute.

Every row has an error beside its time: largest deviation of the nodes from a run by radau9 at tolerance 1e-13.  Runs of the
kernel are interleaved, and a time is the least processor time of the rounds; the FMU's steps are timed by the wall clock.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from benchmarks.harness import machine, problems
from benchmarks.harness.page import Page, paragraphs, table
from fmu_src import build as build_fmu
from fmu_src.validation import speed as fmu_speed
from tensegrity_core.files import scratch
from tensegrity_core.kernel import Kernel
from tensegrity_core.native import build
from tensegrity_core.scene import load_scene
from tensegrity_core.statics import build_model

SCENES, TOLERANCES = ("three_bar", "three_bar_nsh"), (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-10)
METHODS, ERRORS = ("auto", "dop853", "rodas5p", "radau9"), (1e-6, 1e-8)


def run(kernel: Kernel, problem: problems.Problem) -> tuple[float, np.ndarray]:
    """Seconds for the problem's duration, and the positions, (20, N D) m, at the ends of its communication steps."""
    kernel["force"][:] = problem.kernel_force
    kernel.initialize()
    rows = np.empty((problems.INSTANTS, kernel.layout["position"].stop - kernel.layout["position"].start))
    start = time.process_time()
    for n in range(problems.INSTANTS):
        kernel.step(problem.duration / problems.INSTANTS)
        rows[n] = kernel["position"]
    return time.process_time() - start, rows


def kernel_rows(rounds: int) -> list[dict]:
    """Every scene, damping, method and tolerance."""
    return [row for scene in SCENES for damping in problems.DAMPINGS for row in problem_rows(scene, damping, rounds)]


def problem_rows(scene: str, damping: float, rounds: int) -> list[dict]:
    problem = problems.pushed(scene, damping)
    exact = run(Kernel(problem.model, method="radau9", tolerance=1e-13), problem)[1]
    kernels = {(m, tol): Kernel(problem.model, method=m, tolerance=tol) for m in METHODS for tol in TOLERANCES}
    errors = {key: float(np.abs(run(kernel, problem)[1] - exact).max()) for key, kernel in kernels.items()}
    seconds = least_seconds(kernels, problem, rounds)
    rows = []
    for (method, tol), kernel in kernels.items():
        time_per_second = seconds[method, tol] / problem.duration
        rows.append(
            {
                "scene": scene,
                "damping": damping,
                "method": method,
                "tolerance": tol,
                "error": errors[method, tol],
                "ms_per_s": 1e3 * time_per_second,
                "real_time_factor": 1.0 / time_per_second,
                **kernel.stats,
            }
        )
    return rows


def least_seconds(kernels: dict, problem: problems.Problem, rounds: int) -> dict:
    """By the keys of the kernels, which take turns."""
    times: dict = {key: [] for key in kernels}
    for _ in range(rounds):
        for key, kernel in kernels.items():
            times[key].append(run(kernel, problem)[0])
    return {key: min(values) for key, values in times.items()}


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
    counts = Kernel(build_model(load_scene(scene))).counts
    return {
        "scene": scene,
        "step_size": step,
        "time_per_step": measured.step,
        "real_time_factor": measured.factor,
        "inputs": counts["F"] * counts["D"] + 2 * counts["S"],
    }


def best(rows: list[dict], scene: str, damping: float, error: float) -> dict:
    """The fastest row that reaches an error."""
    fitting = [r for r in rows if r["scene"] == scene and r["damping"] == damping and r["error"] <= error]
    return min(fitting, key=lambda r: r["ms_per_s"])


def best_rows(result: dict) -> str:
    """The fastest rows at each error."""
    body = []
    for scene, damping in dict.fromkeys((r["scene"], r["damping"]) for r in result["kernel"]):
        for error in result["conditions"]["errors"]:
            r = best(result["kernel"], scene, damping, error)
            body.append(
                f"{scene} | {damping:g} | {error:g} | {r['error']:.1e} | `{r['method']}` | {r['tolerance']:g} | "
                f"{r['ms_per_s']:.2f} | {r['real_time_factor']:.0f} | {r['transitions']}"
            )
    head = "scene | d, N s/m | error <=, m | reached, m | method | tolerance | ms per second | x real time | transitions"
    return table(head, body)


def report(result: dict) -> str:
    """docs/speed.md."""
    where, conditions, fmu = result["machine"], result["conditions"], result["fmu"]
    return paragraphs(
        "# Speed",
        "Written by `python -m benchmarks.speed.speed`; the figures stand in [speed.json](speed.json), and "
        f"`--redraw` writes this page from them. {where['processor']}, {where['system']}, Python "
        f"{where['python']}, one thread, commit {where['commit']}, {where['date']}, in {result['seconds']} s.",
        f"Kernel, called from Python, one simulated second of the asymmetric push ({conditions['up']:g} N up on "
        f"the top nodes, {conditions['aside']:g} N aside on the first), fastest setting that reaches the error; "
        f"least processor time of {conditions['rounds']} runs:",
        best_rows(result),
        f"pythonfmu FMU of {fmu['scene']} through fmpy's low-level calls, communication step {fmu['step_size']:g} "
        f"s, all {fmu['inputs']} inputs set and all outputs read at every step: "
        f"{fmu['time_per_step'] * 1e6:.0f} us per step, {fmu['real_time_factor']:.0f} x real time.",
        "The library is compiled for any processor of its platform; the same sources with `-march=native` take "
        f"{1.0 / result['processor']['shipped_over_march_native']:.2f} of its time on this machine.",
    )


def collect(rounds: int) -> dict:
    """docs/speed.json."""
    began, where = time.perf_counter(), machine.describe()
    conditions = {"up": problems.PUSH_UP, "aside": problems.PUSH_ASIDE, "errors": list(ERRORS), "rounds": rounds}
    result = {"machine": where, "conditions": conditions, "kernel": kernel_rows(rounds), "processor": processor_rows(rounds)}
    return result | {"fmu": fmu_row("three_bar_nsh"), "seconds": round(time.perf_counter() - began)}


PAGE = Page(__doc__, "speed", collect, report, options={"rounds": 15})

if __name__ == "__main__":
    PAGE.main()
