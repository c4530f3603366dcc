"""Speed of the kernel and of the pythonfmu FMU: ``python benchmarks/speed.py`` writes docs/speed.json and docs/speed.md.

Every row has an error beside its time: largest deviation of the free nodes from a run of the other method at tolerance
1e-13.  Runs are interleaved; a time is the median of the rounds.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks"), str(ROOT / "tensegrity_core" / "native")]

import build as kernel_build  # noqa: E402  (native/build.py)
import machine  # noqa: E402

import build_fmu  # noqa: E402

from fmu_src import speed as fmu_speed  # noqa: E402
from tensegrity_core.kernel import Kernel  # noqa: E402
from tensegrity_core.model import Model  # noqa: E402
from tensegrity_core.scene import load_scene  # noqa: E402
from tensegrity_core.statics import build_model  # noqa: E402

DURATION, INSTANTS = 1.0, 20
TOLERANCES = (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-10)


def pushed(name: str, damping: float) -> tuple[Model, np.ndarray]:
    """The scene at one damping, and the asymmetric push: 45 N up on the top nodes, 20 N in x on the first of them."""
    model = build_model(load_scene(name))
    model = replace(model, damping=np.full(len(model.strings), damping))
    force = np.zeros((len(model.nodes), 3))
    top = np.flatnonzero(model.nodes[:, 2] > model.nodes[:, 2].max() - 0.01)
    force[top, 2] = 45.0
    force[top[0], 0] = 20.0
    return model, force[np.ix_(model.free_nodes, model.axes)].ravel()


def run(kernel: Kernel, force: np.ndarray) -> tuple[float, np.ndarray]:
    """Seconds for one simulated second in 20 communication steps, and the positions at each."""
    kernel["force"][:] = force
    kernel.initialize()
    rows = np.empty((INSTANTS, kernel.layout["position"].stop - kernel.layout["position"].start))
    start = time.perf_counter()
    for n in range(INSTANTS):
        kernel.step(DURATION / INSTANTS)
        rows[n] = kernel["position"]
    return time.perf_counter() - start, rows


def kernel_rows(rounds: int) -> list[dict]:
    rows = []
    for name in ("three_bar", "three_bar_nsh"):
        for damping in (50.0, 500.0, 5000.0):
            model, force = pushed(name, damping)
            exact = run(Kernel(model, method="radau9" if damping > 1000 else "dop853", tolerance=1e-13), force)[1]
            kernels = {
                (method, tol): Kernel(model, method=method, tolerance=tol)
                for method in ("auto", "dop853", "rodas5p", "radau9")
                for tol in TOLERANCES
            }
            times: dict = {key: [] for key in kernels}
            errors = {key: np.abs(run(k, force)[1] - exact).max() for key, k in kernels.items()}
            for _ in range(rounds):
                for key, kernel in kernels.items():
                    times[key].append(run(kernel, force)[0])
            for (method, tol), kernel in kernels.items():
                seconds = statistics.median(times[method, tol])
                rows.append(
                    {"scene": name, "damping": damping, "method": method, "tolerance": tol, "error": errors[method, tol],
                     "ms_per_s": 1e3 * seconds / DURATION, "real_time_factor": DURATION / seconds, **kernel.stats}
                )  # fmt: skip
    return rows


def processor_rows(rounds: int) -> dict:
    """What it costs to compile for any x86-64 instead of this very processor: one ratio of medians, interleaved."""
    model, force = pushed("three_bar_nsh", 500.0)
    with tempfile.TemporaryDirectory() as folder:
        libraries = {}
        for name, extra in {"shipped": [], "march_native": ["-march=native"]}.items():
            target = Path(folder) / name
            target.mkdir()
            compiler = kernel_build.system_compiler() or [sys.executable, "-m", "ziglang", "cc"]
            libraries[name] = kernel_build.compile_library(target, [*compiler, *extra])
        kernels = {name: Kernel(model, library=path, method="dop853", tolerance=1e-8) for name, path in libraries.items()}
        times: dict = {name: [] for name in kernels}
        for _ in range(10 * rounds):
            for name, kernel in kernels.items():
                times[name].append(run(kernel, force)[0])
    medians = {name: statistics.median(values) for name, values in times.items()}
    return {"shipped_over_march_native": medians["shipped"] / medians["march_native"]}


def fmu_row(scene: str, step: float = 1e-3) -> dict:
    """The pythonfmu FMU of a scene through fmpy's low-level calls."""
    with tempfile.TemporaryDirectory() as folder:
        if build_fmu.main([scene, "--no-validate", "--output", folder]):
            raise SystemExit(f"building the FMU of {scene} failed")
        measured = fmu_speed.measure(Path(folder) / "python" / f"{scene}.fmu", h=step)
    counts = Kernel(build_model(load_scene(scene))).counts
    return {"scene": scene, "step_size": step, "time_per_step": measured.step, "real_time_factor": measured.factor,
            "inputs": counts["F"] * counts["D"] + 2 * counts["S"]}  # fmt: skip


def best(rows: list[dict], scene: str, damping: float, error: float) -> dict:
    """The fastest row that reaches an error."""
    fitting = [r for r in rows if r["scene"] == scene and r["damping"] == damping and r["error"] <= error]
    return min(fitting, key=lambda r: r["ms_per_s"])


def report(result: dict) -> str:
    where = result["machine"]
    lines = [
        "# Speed",
        "",
        "Written by `python benchmarks/speed.py`; the figures stand in [speed.json](speed.json). "
        f"{where['processor']}, {where['system']}, Python {where['python']}, one thread, commit {where['commit']}, "
        f"{where['date']}.",
        "",
        "Kernel, one simulated second of the asymmetric push (45 N up on the top nodes, 20 N aside on the first), fastest "
        "setting that reaches the error:",
        "",
        "| scene | d, N s/m | error <= | reached, m | method | tolerance | ms per second | x real time | transitions |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for scene in ("three_bar", "three_bar_nsh"):
        for damping in (50.0, 500.0, 5000.0):
            for error in (1e-6, 1e-8):
                r = best(result["kernel"], scene, damping, error)
                lines.append(
                    f"| {scene} | {damping:g} | {error:g} | {r['error']:.1e} | {r['method']} | {r['tolerance']:g} | "
                    f"{r['ms_per_s']:.2f} | {r['real_time_factor']:.0f} | {r['transitions']} |"
                )
    fmu = result["fmu"]
    lines += [
        "",
        f"pythonfmu FMU of {fmu['scene']} through fmpy's low-level calls, communication step {fmu['step_size']:g} s, "
        f"all {fmu['inputs']} inputs set and all outputs read at every step: "
        f"{fmu['time_per_step'] * 1e6:.0f} us per step, {fmu['real_time_factor']:.0f} x real time.",
        "",
        "The library is compiled for any x86-64; the same sources with `-march=native` take "
        f"{1.0 / result['processor']['shipped_over_march_native']:.2f} of its time on this machine.",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=15)
    parser.add_argument("--output", type=Path, default=ROOT / "docs")
    options = parser.parse_args()
    result = {"machine": machine.describe(), "kernel": kernel_rows(options.rounds), "processor": processor_rows(options.rounds)}
    result["fmu"] = fmu_row("three_bar_nsh")
    text = report(result)
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / "speed.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (options.output / "speed.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
