"""Speed of the native FMU: ``python -m benchmarks.speed.fmu_speed`` writes docs/fmu_speed.json and docs/fmu-speed.md in half a
minute.

Measured from a plain C host (fmu_speed.c, whose head says what each quantity is; a C compiler is needed) and, beside the Python
FMU, through fmpy's low-level calls.  Times are processor times; what is compared takes turns, and shown are the minimum and the
median over the rounds; a ratio or difference is that of two minima.
"""

from __future__ import annotations

import subprocess
import time
from collections import defaultdict
from pathlib import Path
from statistics import median
from zipfile import ZipFile

import numpy as np

from benchmarks.harness import machine
from benchmarks.harness.page import Page, table, wrapped
from fmu_src.packing.libraries import here
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu
from fmu_src.validation.outside import Instance, Ports
from fmu_src.variables.interface import variables
from tensegrity_core.files import scratch, write_bytes
from tensegrity_core.kernel import Kernel, to_bytes
from tensegrity_core.model import Model
from tensegrity_core.native import build
from tensegrity_core.scene import load_scene
from tensegrity_core.statics import build_model

SCENES = ("two_bar", "two_bar_nsh", "three_bar", "three_bar_nsh", "six_bar", "six_bar_nsh")
JUDGED = "three_bar_nsh"  # by which the targets are
STEP = 1e-3  # communication step, s
FMPY_STEPS = 1000
#: Solvers with which the judged scene is measured, too, beside the default: method, tolerance.
SOLVERS = (("auto", 1e-10), ("auto", 1e-8), ("auto", 1e-6), ("auto", 1e-4), ("radau9", 1e-8), ("rodas5p", 1e-6), ("ros2", 1e-8))
C_STEPS, PUSH, WAVE = 2000, 45.0, 20.0  # of fmu_speed.c
QUANTITIES = ("kernel_step", "fmu_step", "kernel_dense", "fmu_dense", "kernel_driven", "fmu_driven", "fmu_still", "set", "get")

# --- measuring ---------------------------------------------------------------------------------------------------


def compile_host(folder: Path) -> Path:
    """fmu_speed.c; it loads the kernel as it loads the FMU."""
    compiler, target = build.system_compiler(), folder / "fmu_speed"
    if compiler is None:
        raise SystemExit("no C compiler found; install one (Debian: apt-get install gcc) or set CC")
    source, includes = str(Path(__file__).with_suffix(".c")), [f"-I{build.fmi_headers()}", f"-I{build.HERE}"]
    run = subprocess.run(
        [*compiler, "-O2", *includes, source, "-ldl", "-lm", "-o", str(target)], capture_output=True, text=True
    )
    if run.returncode:
        raise SystemExit(f"compiling fmu_speed.c failed:\n{run.stderr}")
    return target


def arguments(model: Model, folder: Path) -> list[str]:
    """What fmu_speed.c must know of an extracted FMU."""
    from fmpy import read_model_description

    rows = [row for row in variables(model) if row.kind == "Real"]
    ends = [
        sum(row.field == "force" for row in rows),
        sum(row.variability == "tunable" or row.causality == "input" for row in rows),
    ]
    inputs = sum(row.causality == "input" for row in rows)
    first = next(row.reference for row in rows if row.causality == "output")
    pushed = next(row.reference for row in rows if row.field == "force" and row.name.endswith("z"))
    (library,) = (folder / "binaries" / here()).iterdir()
    kernel, resources = build.HERE / build.LIBRARY, folder / "resources"
    guid = read_model_description(str(folder)).guid
    numbers = (inputs, *ends, first, len(rows), pushed)
    return [str(kernel), str(library), guid, resources.as_uri(), str(resources / "model.bin"), *map(str, numbers)]


def unpacked(fmu: Path) -> Path:
    folder = fmu.with_suffix("")
    with ZipFile(fmu) as archive:
        archive.extractall(folder)
    return folder


def from_c(model: Model, folder: Path, host: Path, rounds: int) -> dict:
    """Summaries of QUANTITIES, ns, and the number of allocations, None where it could not be counted."""
    run = subprocess.run([str(host), *arguments(model, folder), str(rounds)], capture_output=True, text=True)
    if run.returncode:
        raise SystemExit(run.stderr)
    found = defaultdict(list)
    for line in run.stdout.splitlines():
        name, value = line.split()
        found[name].append(float(value))
    counts = found.get("allocations")
    return {name: summary(found[name]) for name in QUANTITIES} | {"allocations": None if counts is None else int(counts[0])}


def summary(values: list[float]) -> dict:
    return {"min": min(values), "median": median(values), "rounds": len(values)}


def through_fmpy(native: Path, python: Path, rounds: int) -> dict:
    """ns per step of both runtimes, which take turns: other forces at each step, all inputs set and all outputs read."""
    from fmpy import extract, read_model_description

    found, fmus = {"native": [], "python": []}, {"native": native, "python": python}
    with scratch() as folder:
        described = {n: (read_model_description(str(fmu)), extract(str(fmu), str(folder / n))) for n, fmu in fmus.items()}
        for _ in range(rounds):
            for name, unpacked_fmu in described.items():
                found[name].append(1e9 * fmpy_run(Instance(*unpacked_fmu)) / FMPY_STEPS)
    return {name: summary(values) for name, values in found.items()}


def fmpy_run(instance: Instance) -> float:
    """Processor time of FMPY_STEPS steps, s."""
    inputs = [v.name for v in instance.description.modelVariables if v.causality == "input"]
    ports = Ports(instance, inputs)
    ports.inputs[:] = [float(instance.by_name[name].start) for name in inputs]
    forces = sum(".force." in name for name in inputs)
    pushes = 20.0 * np.sin(0.0125 * np.arange(FMPY_STEPS)[:, None] + np.arange(forces))
    instance.start()
    begin = time.process_time()
    for k in range(FMPY_STEPS):
        ports.inputs[:forces] = pushes[k]
        ports.set()
        ports.step(k * STEP, STEP)
        ports.get()
    spent = time.process_time() - begin
    instance.close()
    return spent


def signals(kernel: Kernel, pushed: int, driven: bool) -> np.ndarray:
    """(C_STEPS, forces) N: what fmu_speed.c sets at each step."""
    start = kernel["force"].copy()
    start[pushed] = PUSH
    phase = 0.0125 * np.arange(C_STEPS)[:, None] + np.arange(len(start))
    return start + WAVE * np.sin(phase) if driven else np.tile(start, (C_STEPS, 1))


def positions(kernel: Kernel, pushed: int, driven: bool) -> np.ndarray:
    """(C_STEPS, N D) m along the run of fmu_speed.c."""
    kernel["force"][pushed] = PUSH
    kernel.initialize()
    kernel["force"][pushed] = 0.0
    rows = []
    for force in signals(kernel, pushed, driven):
        kernel["force"][:] = force
        kernel.step(STEP)
        rows.append(kernel["position"].copy())
    return np.array(rows)


def solver_rows(model: Model, folder: Path, host: Path, rounds: int) -> list[dict]:
    """The FMU with other start values of its solver; errors, m: largest deviation of a node from radau9 at 1e-13."""
    pushed = next(row.reference for row in variables(model) if row.field == "force" and row.name.endswith("z"))
    exact = {driven: positions(Kernel(model, method="radau9", tolerance=1e-13), pushed, driven) for driven in (True, False)}
    rows = []
    for method, tolerance in SOLVERS:
        write_bytes(folder / "resources" / "model.bin", to_bytes(model, method=method, tolerance=tolerance))
        found = from_c(model, folder, host, rounds)
        row = {"method": method, "tolerance": tolerance, "fmu_driven": found["fmu_driven"], "fmu_still": found["fmu_still"]}
        for driven, name in ((True, "driven_error"), (False, "still_error")):
            run = positions(Kernel(model, method=method, tolerance=tolerance), pushed, driven)
            row[name] = float(np.abs(run - exact[driven]).max())
        rows.append(row)
    return rows


def measure(rounds: int) -> tuple[list[dict], list[dict]]:
    """One row per scene, and one per solver of the judged scene."""
    rows, solvers = [], []
    with scratch() as folder:
        host = compile_host(folder)
        for name in SCENES:
            model = build_model(load_scene(name))
            native = pack_native_fmu(model, folder / f"{name}_native.fmu")
            python = pack_python_fmu(model, folder / f"{name}_python.fmu")
            row = {"scene": name, "size": native.stat().st_size} | from_c(model, unpacked(native), host, rounds)
            rows.append(row | {"fmpy": through_fmpy(native, python, max(rounds // 5, 2))})
            if name == JUDGED:
                solvers = solver_rows(model, unpacked(native), host, rounds)
    return rows, solvers


# --- showing -----------------------------------------------------------------------------------------------------


def least(row: dict, name: str) -> float:
    return row[name]["min"]


def factor(row: dict, name: str) -> float:
    """Simulated time over processor time."""
    return 1e9 * STEP / least(row, name)


def overhead(row: dict) -> float:
    """fmi2DoStep less ts_step, ns, where a step is cheapest."""
    return least(row, "fmu_dense") - least(row, "kernel_dense")


def ratio(row: dict) -> float:
    return row["fmpy"]["python"]["min"] / row["fmpy"]["native"]["min"]


def targets(rows: list[dict]) -> list[tuple[str, str, str, bool]]:
    """What, target, reached, met."""
    judged = next(row for row in rows if row["scene"] == JUDGED)
    worst = max(map(overhead, rows))
    counts = [row["allocations"] for row in rows]
    known = None not in counts
    found = [
        ("overhead of fmi2DoStep over ts_step, largest, µs", "≤ 0.5", f"{1e-3 * worst:.3f}", worst <= 500.0),
        ("100 variables set, largest, µs", "≤ 1", *below([least(row, "set") for row in rows], 1000.0)),
        ("100 variables read, largest, µs", "≤ 1", *below([least(row, "get") for row in rows], 1000.0)),
        (f"{JUDGED}, inputs change, × real time", "≥ 300", *above(factor(judged, "fmu_driven"), 300.0)),
        (f"{JUDGED}, inputs stay, × real time", "≥ 1000", *above(factor(judged, "fmu_still"), 1000.0)),
        (f"{JUDGED} through fmpy, × Python FMU", "≥ 5", *above(ratio(judged), 5.0)),
        ("FMU of one platform, largest, kB", "≤ 300", *below([row["size"] for row in rows], 300e3)),
    ]
    if known:
        found.append(("allocations while stepping", "0", str(sum(counts)), sum(counts) == 0))
    return found


def below(values: list[float], limit: float) -> tuple[str, bool]:
    """Of thousandths: the largest, and whether it is within the limit."""
    return f"{1e-3 * max(values):.3g}", max(values) <= limit


def above(value: float, limit: float) -> tuple[str, bool]:
    return f"{value:.3g}", value >= limit


def number(value: float) -> str:
    """Three digits, without an exponent."""
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{float(f'{value:.3g}'):.0f}"


def cell(values: dict, scale: float = 1e-3) -> str:
    """Minimum and median, µs."""
    return f"{number(scale * values['min'])} ({number(scale * values['median'])})"


def step_rows(rows: list[dict]) -> str:
    head = (
        "scene | `ts_step`, 10 µs | `fmi2DoStep`, 10 µs | overhead | `ts_step`, 1 ms | `fmi2DoStep`, 1 ms | set 100 | get 100"
    )
    names = ("kernel_dense", "fmu_dense", None, "kernel_step", "fmu_step", "set", "get")
    body = [[r["scene"], *(cell(r[n]) if n else number(1e-3 * overhead(r)) for n in names)] for r in rows]
    return table(head, body)


def real_time_rows(rows: list[dict]) -> str:
    head = ["scene", "inputs change, µs per step", "× real time", "inputs stay, µs per step", "× real time"]
    body = [
        [r["scene"], *(text for n in ("fmu_driven", "fmu_still") for text in (cell(r[n]), number(factor(r, n))))] for r in rows
    ]
    return table(head, body)


def solver_table(rows: list[dict]) -> str:
    head = ["method", "tolerance", "inputs change, µs", "× real time", "error, m", "inputs stay, µs", "× real time", "error, m"]
    body = []
    for r in rows:
        cells = [
            [cell(r[n]), number(factor(r, n)), f"{r[e]:.1e}"]
            for n, e in (("fmu_driven", "driven_error"), ("fmu_still", "still_error"))
        ]
        body.append([f"`{r['method']}`", f"{r['tolerance']:g}", *cells[0], *cells[1]])
    return table(head, body)


def fmpy_rows(rows: list[dict]) -> str:
    head = ["scene", "native FMU, µs per step", "Python FMU, µs per step", "ratio", "native FMU, kB"]
    body = [
        [r["scene"], cell(r["fmpy"]["native"]), cell(r["fmpy"]["python"]), number(ratio(r)), number(1e-3 * r["size"])]
        for r in rows
    ]
    return table(head, body)


def report(result: dict) -> str:
    """docs/fmu-speed.md."""
    rows, where = result["rows"], result["machine"]
    blocks = [
        "# Speed of the native FMU",
        "Written by `python -m benchmarks.speed.fmu_speed`; the figures stand in [fmu_speed.json](fmu_speed.json), and "
        f"`--redraw` writes this page from them. Measured in processor time on {where['processor']}, {where['system']}, one "
        f"thread, commit {where['commit']}, {where['date']}, in {result['seconds']} s; minimum (median) of "
        f"{rows[0]['set']['rounds']} rounds from C, of {rows[0]['fmpy']['native']['rounds']} through fmpy. What is compared "
        "takes turns.",
        "## Targets",
        table(["what", "target", "reached", "met"], [[*row, "yes" if met else "**no**"] for *row, met in targets(rows)]),
        "The targets of real time are asked of the default tolerance here, 1e-10, much tighter than what the validation asks "
        "of an FMU; the table of solvers below shows what looser ones cost and how far off they are. Through fmpy, both FMUs "
        "pay the same for the kernel and for fmpy's own calls, which is most of what the native one takes.",
        "## Calls from a C host, µs",
        "Bare kernel and FMU along the same motion. With steps of 10 µs most lie within one step of the integrator, so that "
        "the overhead shows, the difference of the two; with 1 ms they work.",
        step_rows(rows),
        f"## Real time from a C host, communication step {1e3 * STEP:g} ms",
        "All inputs are set and all outputs read at each step. Where the forces change at each step, the integrator starts "
        "anew there; where they stay, its own steps go on across the communication points.",
        real_time_rows(rows),
        f"{JUDGED} with other solvers and tolerances; the first is the default. The error is the largest deviation of a node "
        f"from `radau9` at tolerance 1e-13 over the {C_STEPS * STEP:g} s.",
        solver_table(result["solvers"]),
        "## Through fmpy",
        "Low-level calls with arrays made once, forces that change at each step, all inputs set and all outputs read; a good "
        "part of the native FMU's time is fmpy's own.",
        fmpy_rows(rows),
    ]
    return wrapped("\n\n".join(blocks)) + "\n"


def collect(rounds: int) -> dict:
    """docs/fmu_speed.json."""
    began, where = time.perf_counter(), machine.describe()
    rows, solvers = measure(rounds)
    return {"machine": where, "seconds": round(time.perf_counter() - began), "rows": rows, "solvers": solvers}


PAGE = Page(__doc__, "fmu_speed", collect, report, options={"rounds": 25})

if __name__ == "__main__":
    PAGE.main()
