"""Who integrates, by which driver, at which settings; the kernel by co-simulation is one of them."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import fmpy
import numpy as np
from fmpy import extract, read_model_description

from benchmarks.harness.problems import INSTANTS, Problem
from benchmarks.importers import environments
from benchmarks.importers.tools import Tool
from benchmarks.peers.toolchain import compiler
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import write_zip
from tensegrity_core.files import scratch, write_text

HERE = Path(__file__).resolve().parent
BASE = HERE.parent.parent / "build" / "importers"
#: Wall time of a process, s: all rounds of a ladder.
LIMIT = 900.0


def decades(first: int, last: int) -> tuple[float, ...]:
    return tuple(float(f"1e-{n}") for n in range(first, last + 1))


class Contender(NamedTuple):
    """name: unique; label: for humans; kind: of the FMU, 'cs' or 'me'; driver: a script in drivers/; settings: tolerances, or
    steps, s; tool: whose environment it runs in, None: this one; problems: only those, None: all; program: a file that the
    driver is given; alone: each setting in a process of its own, since the tool makes several instances."""

    name: str
    label: str
    kind: str
    driver: str
    settings: tuple[float, ...]
    tool: Tool | None = None
    problems: tuple[str, ...] | None = None
    program: str = ""
    alone: bool = False


VALIDATION = str(HERE.parent.parent / "fmu_src" / "validation" / "exchange.py")
CASADI = Tool("CasADi, DaeBuilder", ("casadi==3.8.2", "numpy"), "casadi_cvodes")
PATHSIM = Tool("PathSim (pathsim-fmi)", ("pathsim-fmi==0.1.1",), "pathsim_block")
SOME = ("three_bar_nsh/50", "three_bar_nsh/500")
CONTENDERS = (
    Contender("kernel", "co-simulation (the kernel)", "cs", "steps", decades(3, 12)),
    Contender("simulated", "fmpy's simulate_fmu, CVODE", "me", "simulated", decades(3, 10)),
    Contender("careful", "CVODE, given the FMU's derivatives", "me", "careful", decades(3, 11), program=VALIDATION),
    Contender("euler", "fmpy's simulate_fmu, Euler", "me", "euler", (1e-3, 5e-4, 2.5e-4, 1e-4, 5e-5)),
    Contender("pathsim", "PathSim, RKDP87", "me", "pathsim_block", (1e-3, 1e-5, 1e-7), PATHSIM, SOME),
    Contender("casadi", "CasADi, CVODES", "me", "casadi_cvodes", (1e-5, 1e-7, 1e-9), CASADI, SOME, alone=True),
)


def packed(problem: Problem, kind: str, folder: Path) -> Path:
    """The native FMU of a problem's model."""
    fmu = folder / f"{problem.name.replace('/', '_')}_{kind}.fmu"
    if not fmu.is_file():
        pack_native_fmu(problem.model, fmu, kind=kind)
    return fmu


def counted(fmu: Path, folder: Path) -> Path:
    """The FMU behind a library that counts the calls, see counting.c."""
    target = folder / f"{fmu.stem}_counted.fmu"
    if target.is_file():
        return target
    unpacked = Path(extract(str(fmu), str(folder / target.stem)))
    libraries = unpacked / "binaries" / "linux64"
    (library,) = libraries.iterdir()
    library.rename(libraries / "behind.so")
    headers = Path(fmpy.__file__).parent / "c-code"
    command = [*compiler(), "-O1", "-shared", "-fPIC", f"-I{headers}", str(HERE / "counting.c"), "-o", str(library), "-ldl"]
    subprocess.run(command, check=True)
    files = {path.relative_to(unpacked).as_posix(): path.read_bytes() for path in unpacked.rglob("*") if path.is_file()}
    write_zip(target, files)
    shutil.rmtree(unpacked)
    return target


def job(problem: Problem, fmu: Path, contender: Contender) -> dict:
    """See drivers/job.py."""
    model, forces = problem.model, {}
    for node in model.free_nodes:
        for axis in model.axes:
            if problem.force[node, axis]:
                forces[f"{model.node_names[node]}.force.{'xyz'[axis]}"] = float(problem.force[node, axis])
    described = read_model_description(str(fmu))
    return {
        "fmu": str(fmu),
        "forces": forces,
        "duration": problem.duration,
        "instants": INSTANTS,
        "outputs": [f"{model.node_names[node]}.{'xyz'[axis]}" for node in problem.judged for axis in model.axes],
        "references": {variable.name: variable.valueReference for variable in described.modelVariables},
        "program": contender.program,
    }


def run(contender: Contender, told: dict, settings: tuple[float, ...]) -> tuple[list[dict], list[dict]]:
    """What the driver found, see drivers/job.py, and the lines of the counting library.  Raises environments.Missing where the
    tool cannot be had."""
    python = environments.python_of(contender.tool, BASE) if contender.tool else sys.executable
    with scratch() as folder:
        write_text(folder / "job.json", json.dumps(told | {"settings": settings, "folder": str(folder)}))
        extract(told["fmu"], str(folder / "fmu"))  # for tools that take no archive
        counts, result = folder / "counts.json", folder / "result.json"
        command = [str(python), str(HERE / "drivers" / f"{contender.driver}.py"), str(folder / "job.json"), str(result)]
        surroundings = os.environ | {"TENSEGRITY_COUNTS": str(counts)}
        try:
            done = subprocess.run(command, cwd=folder, env=surroundings, capture_output=True, text=True, timeout=LIMIT)
            failure = environments.last_words(done.stdout + done.stderr)
        except subprocess.TimeoutExpired:
            failure = f"did not end within {LIMIT:g} s"
        if not result.is_file():
            return [{"seconds": None, "rows": None, "failure": failure} for _ in settings], []
        lines = counts.read_text(encoding="utf-8").splitlines() if counts.is_file() else []
        return json.loads(result.read_text(encoding="utf-8")), [json.loads(line) for line in lines]


def error(one: dict, exact: np.ndarray) -> float | None:
    """Largest deviation of the judged nodes, m; None where there is no complete run."""
    rows = None if one["rows"] is None else np.array(one["rows"], dtype=float)
    if rows is None or rows.shape != exact.shape or not np.all(np.isfinite(rows)):
        return None
    return float(np.abs(rows - exact).max())
