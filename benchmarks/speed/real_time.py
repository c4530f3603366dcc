"""What steps of 1 ms cost: ``python -m benchmarks.speed.real_time`` writes docs/real_time.json and docs/real-time.md.

A C host (real_time.c, whose head says what it prints; it needs a C compiler) steps the native FMU as a controller does:
all inputs are set, to other values at each step, and all outputs read.  Means are processor times; worst cases are by the wall
clock, of --steps steps (a million: some minutes), and belong on a machine left alone.  The kernel itself runs the chart of
tolerances.
"""

from __future__ import annotations

import subprocess
from collections import defaultdict
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from fmpy import read_model_description
from matplotlib.figure import Figure

from benchmarks.harness.page import COLOURS, Page, new_figure, rendered
from benchmarks.harness.problems import built_in
from benchmarks.harness.timing import recorded, summary
from benchmarks.peers import toolchain
from fmu_src.packing.libraries import here
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.variables.interface import variables
from tensegrity_core.fields import METHODS
from tensegrity_core.files import scratch, write_bytes
from tensegrity_core.kernel import Kernel
from tensegrity_core.model import Model
from tensegrity_core.native import build

from .fmu_speed import unpacked
from .method_choice import functions_of, runner

STEP, SPAN = 1e-3, 2.0  # s: a communication step; the signals' period
FORCE, LENGTH = 20.0, 0.002  # N, m: amplitudes of the signals
#: Scene -> times real time that are asked, with positions within ERROR, m.
TARGETS = {"three_bar_nsh": 400.0, "six_bar_nsh": 100.0}
ERROR = 1e-6
#: Solvers whose means are measured: method, tolerance.
SOLVERS = (
    *(("auto", tolerance) for tolerance in (1e-10, 1e-8, 1e-6, 1e-5, 1e-4, 1e-3, 2e-3)),
    *(("dopri5", tolerance) for tolerance in (1e-4, 1e-3, 2e-3)),
    *(("dop853", tolerance) for tolerance in (1e-4, 1e-3)),
    ("ros2", 1e-10),
)
#: Those whose worst cases are.
WORST = (("auto", 1e-4), ("ros2", 1e-10))
#: Of the chart of tolerances.
SCENES = ("two_bar", "two_bar_nsh", "three_bar", "three_bar_nsh", "six_bar", "six_bar_nsh")
DAMPINGS, STEPS, TOLERANCES = (50.0, 500.0, 5000.0), (1e-3, 1e-2), tuple(10.0**-n for n in range(4, 13))
CHART_SPAN, CHART_ROUNDS = 1.0, 3
FORCE_BOUND, FORCE_RELATIVE = 1e-3, 1e-6  # N, and of the largest force: what the validation allows
DEFAULT = 1e-10

# --- measuring ---------------------------------------------------------------------------------------------------


def signals(model: Model, step: float = STEP, span: float = SPAN) -> np.ndarray:
    """(steps, inputs) what the host sets: forces, and rest lengths with their rates, all smooth and of period SPAN."""
    kernel = Kernel(model)
    rows = np.tile(kernel.values[: kernel.slopes.shape[1]], (round(span / step), 1))
    t = step * np.arange(len(rows))[:, None]
    force, length, rate = (kernel.layout[name] for name in ("force", "rest_length", "rest_length_rate"))
    rows[:, force] += FORCE * np.sin(4.0 * np.pi * t + np.arange(force.stop - force.start))
    omega = np.pi * (1.0 + np.arange(length.stop - length.start) % 4)
    rows[:, length] += LENGTH * np.sin(omega * t)
    rows[:, rate] = LENGTH * omega * np.cos(omega * t)
    return rows


def compile_host(folder: Path) -> Path:
    return toolchain.compile_program(
        [str(Path(__file__).with_suffix(".c"))], folder / "real_time", [f"-I{build.fmi_headers()}", "-ldl", "-lm"]
    )


class Host:
    """The C host with one FMU."""

    def __init__(self, model: Model, scene: str, program: Path, folder: Path):
        self.program, self.folder = program, unpacked(pack_native_fmu(model, folder / f"{scene}.fmu"))
        self.rows, self.signals = variables(model), signals(model)
        self.model, self.kernel = model, Kernel(model)
        self.input, self.output = folder / f"{scene}.signals", folder / f"{scene}.outputs"
        write_bytes(self.input, self.signals.tobytes())

    def run(self, method: str, tolerance: float, count: int, runs: int, each: bool = False) -> dict[str, list[list[str]]]:
        """What the program printed, by the lines' first words."""
        reference = {row.name: row.reference for row in self.rows}
        first = next(row.reference for row in self.rows if row.causality == "output" and row.kind == "Real")
        reals = sum(row.kind == "Real" for row in self.rows)
        (library,) = (self.folder / "binaries" / here()).iterdir()
        guid, resources = read_model_description(str(self.folder)).guid, (self.folder / "resources").as_uri()
        files = [library, guid, resources, self.input, "-" if each else self.output]
        solver = [reference["solver.method"], METHODS.index(method), reference["solver.tolerance"], repr(tolerance)]
        numbers = [self.signals.shape[1], first, reals, *solver, repr(STEP), count, runs, int(each)]
        done = subprocess.run([str(self.program), *map(str, files + numbers)], capture_output=True, text=True)
        if done.returncode:
            raise SystemExit(done.stderr)
        found = defaultdict(list)
        for line in done.stdout.splitlines():
            name, *values = line.split()
            found[name].append(values)
        return found

    def outputs(self) -> np.ndarray:
        """(steps, outputs) of the last run."""
        return np.fromfile(self.output).reshape(len(self.signals), -1)

    def part(self, outputs: np.ndarray, field: str) -> np.ndarray:
        first = len(self.kernel.values) - outputs.shape[1]
        place = self.kernel.layout[field]
        return outputs[:, place.start - first : place.stop - first]


def largest(host: Host, found: np.ndarray, exact: np.ndarray, field: str) -> float:
    return float(np.abs(host.part(found, field) - host.part(exact, field)).max())


def means(host: Host, scene: str, rounds: int) -> list[dict]:
    """ns per step, and the largest errors of positions, m, and of strings' forces, N, against radau9 at 1e-13."""
    count = len(host.signals)
    host.run("radau9", 1e-13, count, 1)
    exact, rows = host.outputs(), []
    for method, tolerance in SOLVERS:
        lines = host.run(method, tolerance, count, rounds)
        found = host.outputs()
        row = {"scene": scene, "method": method, "tolerance": tolerance}
        row["step"] = summary([1e9 * float(seconds) / count for (seconds,) in lines["run"]], "rounds")
        row["error"], row["force"] = (largest(host, found, exact, field) for field in ("position", "string_force"))
        row["allocations"], row["stack"] = (int(lines[name][0][0]) for name in ("allocations", "stack"))
        row["work"] = counted(host, method, tolerance)
        rows.append(row)
    return rows


def counted(host: Host, method: str, tolerance: float) -> dict[str, float]:
    """What a step does, on average."""
    kernel = Kernel(host.model, method=method, tolerance=tolerance)
    kernel.initialize()
    for row in host.signals:
        kernel.values[: len(row)] = row
        kernel.step(STEP)
    return {name: kernel.stats[name] / len(host.signals) for name in ("steps", "rejected", "rhs", "factorisations")}


def worst_cases(host: Host, scene: str, steps: int, runs: int) -> list[dict]:
    """Histograms: [[bin, steps], ...], a bin beginning at 10^(bin/20) ns; worst: ns."""
    rows = []
    for method, tolerance in WORST:
        lines = host.run(method, tolerance, steps, runs, each=True)
        row = {"scene": scene, "method": method, "tolerance": tolerance, "steps": steps, "runs": runs}
        for name in ("first", "least"):
            row[name] = [[int(place), int(count)] for place, count in lines[name]]
            row[f"{name}_worst"] = float(lines[f"{name}_worst"][0][0])
        row["allocations"], row["stack"] = (int(lines[name][0][0]) for name in ("allocations", "stack"))
        rows.append(row)
    return rows


def chart(folder: Path) -> list[dict]:
    """Of `auto`: times and errors over tolerances, in cells of scene, damping and communication step."""
    run, rows = runner(folder), []
    for scene, damping, step in product(SCENES, DAMPINGS, STEPS):
        model = built_in(scene)
        model = replace(model, damping=np.full_like(model.damping, damping))
        table = signals(model, step, CHART_SPAN)
        exact = states(model, table, step, "radau9", 1e-13)
        bound = max(FORCE_BOUND, FORCE_RELATIVE * np.abs(exact[1]).max())
        for tolerance in TOLERANCES:
            kernel = Kernel(model, method="auto", tolerance=tolerance)
            lengths = np.full(len(table), step)
            seconds = [
                run(functions_of(kernel), kernel._sim, len(lengths), lengths.ctypes.data, *table.shape, table.ctypes.data, 60.0)
                for _ in range(CHART_ROUNDS)
            ]
            position, force = (np.abs(a - b).max() for a, b in zip(states(model, table, step, "auto", tolerance), exact))
            cell = {"scene": scene, "damping": damping, "step": step, "tolerance": tolerance}
            rows.append(cell | {"seconds": min(seconds) / len(table), "error": float(position), "force": float(force / bound)})
    return rows


def states(model: Model, table: np.ndarray, step: float, method: str, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions, m, and strings' forces, N, after each step."""
    kernel = Kernel(model, method=method, tolerance=tolerance)
    kernel.values[: table.shape[1]] = table[0]
    kernel.initialize()
    position, force = [], []
    for row in table:
        kernel.values[: len(row)] = row
        kernel.step(step)
        position.append(kernel["position"].copy())
        force.append(kernel["string_force"].copy())
    return np.array(position), np.array(force)


@recorded
def collect(rounds: int, steps: int, runs: int) -> dict:
    """docs/real_time.json."""
    found: dict = {"means": [], "worst": [], "chart": []}
    with scratch() as folder:
        program = compile_host(folder)
        for scene in TARGETS:
            host = Host(built_in(scene), scene, program, folder)
            found["means"] += means(host, scene, rounds)
            found["worst"] += worst_cases(host, scene, steps, runs)
        found["chart"] = chart(folder)
    return found


# --- showing -----------------------------------------------------------------------------------------------------


def factor(row: dict) -> float:
    """Simulated time over processor time."""
    return 1e9 * STEP / row["step"]["min"]


def reached(rows: list[dict]) -> list[dict]:
    """Of each scene: the fastest solver within ERROR, and the fastest `auto`."""
    found = []
    for scene, asked in TARGETS.items():
        good = [row for row in rows if row["scene"] == scene and row["error"] <= ERROR and row["method"] != "ros2"]
        best = max(good, key=factor)
        automatic = max((row for row in good if row["method"] == "auto"), key=factor)
        found.append({"scene": scene, "asked": asked, "best": best, "auto": automatic})
    return found


def tolerances(rows: list[dict]) -> list[dict]:
    """Of each tolerance over all cells: time relative to DEFAULT's, errors, the part of cells whose forces keep their bound."""
    base = {cell(row): row["seconds"] for row in rows if row["tolerance"] == DEFAULT}
    found = []
    for tolerance in sorted({row["tolerance"] for row in rows}, reverse=True):
        chosen = [row for row in rows if row["tolerance"] == tolerance]
        errors = np.array([row["error"] for row in chosen])
        ratio = np.array([row["seconds"] / base[cell(row)] for row in chosen])
        held = float(np.mean([row["force"] <= 1.0 for row in chosen]))
        summed = {"median": float(np.median(errors)), "largest": float(errors.max()), "held": held}
        found.append({"tolerance": tolerance, "time": float(np.exp(np.log(ratio).mean())), **summed})
    return found


def cell(row: dict) -> tuple:
    return row["scene"], row["damping"], row["step"]


def quantile(histogram: list[list[int]], part: float) -> float:
    """ns below which that part of the steps is, to a bin's upper end."""
    total, passed = sum(count for _, count in histogram), 0
    for place, count in histogram:
        passed += count
        if passed >= part * total:
            return 10.0 ** ((place + 1) / 20.0)
    raise ValueError("an empty histogram")


def draw_worst(result: dict) -> Figure:
    """Histograms: light, as the clock had them; dark, each step in the run that disturbed it least."""
    figure = new_figure(6.0, 3.2)
    panels = figure.subplots(len(WORST), len(TARGETS), sharex=True, squeeze=False)
    for row in result["worst"]:
        axes = panels[[w[0] for w in WORST].index(row["method"]), list(TARGETS).index(row["scene"])]
        for name, colour in (("first", COLOURS[3]), ("least", COLOURS[2])):
            places, counts = np.array(row[name]).T
            label = "by the clock" if name == "first" else f"least of {row['runs']} runs"
            axes.bar(1e-3 * 10.0 ** (places / 20.0), counts, 1e-3 * 10.0 ** (places / 20.0) * 0.12, align="edge",
                     color=colour, alpha=0.7, label=label)  # fmt: skip
        axes.axvline(1e6 * STEP, color=COLOURS[1], linewidth=1.0)
        axes.set(xscale="log", yscale="log", title=f"{row['scene']}, {row['method']}", xlabel="µs per step", ylabel="steps")
        axes.label_outer()
        axes.minorticks_off()
    panels[0, 0].legend(frameon=False, fontsize=6)
    return figure


def draw_tolerances(result: dict) -> Figure:
    """Errors over the tolerance: for each damping the largest of its cells, and their median."""
    figure = new_figure(3.4, 2.1)
    axes = figure.subplots()
    x = sorted({row["tolerance"] for row in result["chart"]})
    for damping, colour in zip(DAMPINGS, COLOURS[1:]):
        found = [[r["error"] for r in result["chart"] if (r["damping"], r["tolerance"]) == (damping, t)] for t in x]
        axes.plot(x, [max(some) for some in found], color=colour, label=f"d = {damping:g} N s/m, largest")
        axes.plot(x, [np.median(some) for some in found], color=colour, linestyle="--", label="median")
    axes.axhline(1e-7, color=COLOURS[0], linewidth=0.8, linestyle=":")
    axes.set(xscale="log", yscale="log", xlabel="tolerance", ylabel="error of a position, m")
    axes.minorticks_off()
    axes.legend(frameon=False, fontsize=6)
    return figure


def report(result: dict) -> str:
    """docs/real-time.md."""
    functions = {"factor": factor, "quantile": quantile}
    both = [*result["means"], *result["worst"]]
    memory = {"allocations": sum(row["allocations"] for row in both), "stack": max(row["stack"] for row in both)}
    constants = {"period": STEP, "limit": ERROR, "force": FORCE, "length": LENGTH, "default": DEFAULT, "chart_span": CHART_SPAN}
    return rendered(
        "speed/real_time", **result, **functions, **constants,
        **memory, reached=reached(result["means"]), tolerances=tolerances(result["chart"]),
    )  # fmt: skip


PAGE = Page(
    __doc__,
    "real_time",
    collect,
    report,
    {"real_time_worst": draw_worst, "real_time_tolerances": draw_tolerances},
    {"rounds": 15, "steps": 1_000_000, "runs": 3},
)

if __name__ == "__main__":
    PAGE.main()
