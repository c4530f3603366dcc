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
from zipfile import ZipFile

import numpy as np
from fmpy import extract, read_model_description

from benchmarks.harness.page import Page, rendered
from benchmarks.harness.problems import built_in
from benchmarks.harness.timing import in_turns, recorded, summary
from benchmarks.peers import toolchain
from fmu_src.packing.libraries import here
from fmu_src.packing.native_fmu import pack_native_fmu, variables_bin
from fmu_src.packing.pack import pack_python_fmu
from fmu_src.validation.outside import Instance
from fmu_src.validation.speed import stepped
from fmu_src.variables.interface import variables
from tensegrity_core.files import scratch, write_bytes
from tensegrity_core.kernel import Kernel, to_bytes
from tensegrity_core.model import Model
from tensegrity_core.native import build

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
    extra = [f"-I{build.fmi_headers()}", "-ldl"]
    return toolchain.compile_program([str(Path(__file__).with_suffix(".c"))], folder / "fmu_speed", extra)


def arguments(model: Model, folder: Path) -> list[str]:
    """What fmu_speed.c must know of an extracted FMU."""
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


def through_fmpy(native: Path, python: Path, rounds: int) -> dict:
    """ns per step of both runtimes, which take turns: other forces at each step, all inputs set and all outputs read."""
    fmus = {"native": native, "python": python}
    with scratch() as folder:
        found = {n: (read_model_description(str(fmu)), extract(str(fmu), str(folder / n))) for n, fmu in fmus.items()}
        seconds = in_turns({name: lambda f=fmu: fmpy_run(Instance(*f)) for name, fmu in found.items()}, rounds)
    return {name: summary([1e9 * spent / FMPY_STEPS for spent in values]) for name, values in seconds.items()}


def fmpy_run(instance: Instance) -> float:
    """Processor time of FMPY_STEPS steps, s."""
    forces = sum(v.causality == "input" and ".force." in v.name for v in instance.description.modelVariables)
    pushes = WAVE * np.sin(0.0125 * np.arange(FMPY_STEPS)[:, None] + np.arange(forces))

    def push(inputs: np.ndarray, k: int) -> None:
        inputs[:forces] = pushes[k]

    return stepped(instance, push, FMPY_STEPS, STEP, time.process_time)


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
    guid, rows = read_model_description(str(folder)).guid, []
    for method, tolerance in SOLVERS:
        packed = to_bytes(model, method=method, tolerance=tolerance)
        write_bytes(folder / "resources" / "model.bin", packed)
        write_bytes(folder / "resources" / "variables.bin", variables_bin(model, variables(model), guid, packed))
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
            model = built_in(name)
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


def report(result: dict) -> str:
    """docs/fmu-speed.md."""
    functions = {"overhead": overhead, "factor": factor, "ratio": ratio}
    constants = {"step": STEP, "judged": JUDGED, "span": C_STEPS * STEP}
    return rendered("speed/fmu_speed", **result, **functions, **constants, targets=targets(result["rows"]))


@recorded
def collect(rounds: int) -> dict:
    """docs/fmu_speed.json."""
    rows, solvers = measure(rounds)
    return {"rows": rows, "solvers": solvers}


PAGE = Page(__doc__, "fmu_speed", collect, report, options={"rounds": 25})

if __name__ == "__main__":
    PAGE.main()
