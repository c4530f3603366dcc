"""Contenders in C: our kernel and SUNDIALS, each job a run of the compiled program (main.c)."""

from __future__ import annotations

import json
import signal
import subprocess
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.harness.problems import INSTANTS, Problem
from tensegrity_core.fields import METHODS
from tensegrity_core.files import write_bytes
from tensegrity_core.kernel import to_bytes

from .ladder import Ladder, Run, fixed_steps, tolerances, too_long
from .toolchain import Tools

#: Methods of the kernel whose step is its `max_step`; every other one has a tolerance.
FIXED_STEP = {"rk4", "ros2"}
#: Processor time that a job may take besides its repetitions, s; and how many times as long it may take by the wall clock.
BESIDES, PATIENCE = 1.0, 10.0
#: How transitions are treated; see peer.h.
NO_EVENTS, DIRECTED, PLAIN = 0, 1, 2
CVODE = ("cvode_bdf", "cvode_adams")
ARKODE = (
    "erk_ARKODE_CASH_KARP_6_4_5",
    "erk_ARKODE_DORMAND_PRINCE_7_4_5",
    "erk_ARKODE_VERNER_8_5_6",
    "erk_ARKODE_FEHLBERG_13_7_8",
    "dirk_ARKODE_ESDIRK436L2SA_6_3_4",
    "dirk_ARKODE_ESDIRK547L2SA2_7_4_5",
    "dirk_ARKODE_KVAERNO_7_4_5",
)
#: Without tuning: ARKODE's own choice of table for an order.
UNTUNED = (*CVODE, "erk_4", "erk_5", "dirk_4", "dirk_5")
#: Of interest without root finding.
ACROSS = (*CVODE, "erk_ARKODE_CASH_KARP_6_4_5", "dirk_ARKODE_ESDIRK547L2SA2_7_4_5")


class Bench:
    """Runs jobs of one problem; the folder holds its packed models and forces."""

    def __init__(self, problem: Problem, tools: Tools, folder: Path):
        self.problem, self.tools, self.folder = problem, tools, folder
        folder.mkdir(parents=True, exist_ok=True)
        self.force = folder / "force.bin"
        write_bytes(self.force, problem.kernel_force.astype("<f8").tobytes())
        self.model = self._packed("model.bin")

    def _packed(self, name: str, **defaults) -> Path:
        path = self.folder / name
        if not path.is_file():
            write_bytes(path, to_bytes(self.problem.model, **defaults))
        return path

    def run(self, method: str, model: Path, events: int, tolerance: float, repetitions: int, limit: float) -> Run:
        """One job; its first run is not timed and comes on top of the repetitions, unless it is a long one (main.c).  limit:
        processor time of a run, s."""
        command = [str(self.tools.program), str(model), str(self.force), method, repr(float(tolerance)), str(events)]
        command += [repr(float(self.problem.duration)), str(INSTANTS), str(repetitions)]
        most = repetitions * limit + BESIDES
        command.append(repr(most))
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE * most)
        except subprocess.TimeoutExpired:
            return Run([], failure=too_long(limit))
        if done.returncode == -signal.SIGXCPU:
            return Run([], failure=too_long(limit))
        if done.returncode:
            raise SystemExit(f"command failed: {' '.join(command)}\n{done.stderr}")
        result = json.loads(done.stdout)
        if max(result["seconds"], default=0.0) > limit:
            return Run(result["seconds"], failure=too_long(limit))
        if result["status"]:
            return Run(result["seconds"], failure=f"{result['reason']} ({result['status']})")
        axes = len(self.problem.model.axes)
        position = np.array([row["position"] for row in result["rows"]], dtype=float).reshape(INSTANTS + 1, -1, axes)
        energy = np.array([row["energy"] for row in result["rows"]], dtype=float)
        return Run(result["seconds"], position, energy, result["counts"])

    def kernel(self, method: str, setting: float, repetitions: int, limit: float = 60.0) -> Run:
        """Our kernel; setting: the step of a method of fixed step, s, else the tolerance."""
        tolerance, step = (1e-10, setting) if method in FIXED_STEP else (setting, 0.0)
        name = f"{method}_{tolerance:g}_{step:g}.bin"
        model = self._packed(name, method=method, tolerance=tolerance, max_step=step)
        return self.run("kernel", model, DIRECTED, tolerance, repetitions, limit)

    def rhs_seconds(self, repetitions: int = 20) -> float:
        """Least processor time of a right-hand side at the start, s."""
        run = self.run("rhs", self.model, DIRECTED, 1.0, repetitions, 10.0)
        return min(run.seconds) / run.counts["rhs"]


def kernel_ladders(bench: Bench) -> list[Ladder]:
    """Every method of the kernel."""
    found = []
    for method in METHODS:
        fixed = method in FIXED_STEP
        kind, settings = ("step", fixed_steps()) if fixed else ("tolerance", tolerances(1e-3, 1e-12, 2))
        found.append(Ladder("kernel", method, True, kind, settings, partial(bench.kernel, method)))
    return found


def _sundials(bench: Bench, family: str, method: str, events: int, per_decade: int) -> Ladder:
    measure = partial(bench.run, method, bench.model, events)
    return Ladder(family, method, events != NO_EVENTS, "tolerance", tolerances(1e-3, 1e-12, per_decade), measure)


def sundials_ladders(bench: Bench) -> list[Ladder]:
    """CVODE and ARKODE, with root finding and without, and without tuning; none where SUNDIALS is missing.  All methods go
    without root finding where there is nothing to find."""
    if bench.tools.sundials is None:
        return []
    families = {method: "cvode" if method in CVODE else "arkode" for method in (*CVODE, *ARKODE)}
    if bench.problem.smooth:
        return [_sundials(bench, family, method, NO_EVENTS, 2) for method, family in families.items()]
    found = [_sundials(bench, family, method, DIRECTED, 2) for method, family in families.items()]
    found += [_sundials(bench, families[method], method, NO_EVENTS, 1) for method in ACROSS]
    return found + [_sundials(bench, "plain", method, PLAIN, 2) for method in UNTUNED]
