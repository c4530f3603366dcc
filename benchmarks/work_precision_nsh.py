"""What an NSH costs: time per transition and per transition-free second, with NSH and without.

The two are told apart by runs of the same scene that differ in their force and duration, and so in their number of
transitions; some have none.  Each run takes the loosest tolerance from which on every error is at most TARGET; the times
are then fitted as

    time = start + rate * duration + per_transition * transitions,

by least squares of the relative residuals, no coefficient negative.  A transition-free second is start + rate: the first
second after a push, under which no string changes its piece.
"""

from __future__ import annotations

import statistics
from dataclasses import replace
from pathlib import Path

import numpy as np
from problems import DAMPINGS, Problem, pushed
from scipy.optimize import nnls
from work_precision_data import TARGET

from peers.ladder import tolerances
from peers.native import Bench
from peers.toolchain import Tools

SCENES = ("three_bar", "three_bar_nsh")
FORCES = (-1.0, -0.5, -0.25, 0.02, 0.05, 0.1, 0.25, 0.5, 1.0, 1.5, 2.0)  # of the push
DURATIONS = (0.5, 1.0, 2.0)  # s
REPETITIONS = 6


def problems_needed() -> list[str]:
    """Names of the problems that these runs vary."""
    return [f"{scene}/{d:g}" for scene in SCENES for d in DAMPINGS]


def variants(problem: Problem) -> list[Problem]:
    """The problem under every force and duration."""
    return [replace(problem, force=f * problem.force, duration=t) for f in FORCES for t in DURATIONS]


def loosest(bench: Bench) -> tuple[float, int]:
    """Tolerance of `auto` from which on every error is within TARGET, and its number of transitions; NaN where there is none."""
    exact = bench.kernel("dop853", 1e-13, 0.0, 1)
    chosen, count = float("nan"), 0
    for tolerance in reversed(tolerances(1e-4, 1e-11, 2)):
        run = bench.kernel("auto", tolerance, 0.0, 1)
        if run.failure or np.abs(run.position - exact.position)[:, bench.problem.judged].max() > TARGET:
            break
        chosen, count = tolerance, run.counts["transitions"]
    return chosen, count


def fit(duration: np.ndarray, transitions: np.ndarray, seconds: np.ndarray) -> tuple[float, float, float]:
    """Seconds per transition-free second and per transition, and the root mean square of the relative residuals."""
    A = np.column_stack((np.ones(len(seconds)), duration, transitions)) / seconds[:, None]
    (start, rate, per_transition), residual = nnls(A, np.ones(len(seconds)))
    return float(start + rate), float(per_transition), float(residual / np.sqrt(len(seconds)))


def measure(tools: Tools, folder: Path, rounds: int) -> list[dict]:
    """A row per scene and damping: the runs, and what the fit gives; times in ms."""
    rows = []
    for damping in DAMPINGS:
        benches = {}
        for scene in SCENES:
            for n, variant in enumerate(variants(pushed(scene, damping))):
                bench = Bench(variant, tools, folder / f"cost_{scene}_{damping:g}_{n}")
                tolerance, transitions = loosest(bench)
                if np.isfinite(tolerance):
                    benches[scene, n] = bench, tolerance, transitions, []
        for _ in range(rounds + 1):  # scenes and variants take turns
            for bench, tolerance, _, seconds in benches.values():
                seconds += bench.kernel("auto", tolerance, 0.0, REPETITIONS).seconds
        for scene in SCENES:
            taken = [value for (name, _), value in benches.items() if name == scene]
            rows.append(_row(scene, damping, taken))
    return rows


def _row(scene: str, damping: float, taken: list[tuple[Bench, float, int, list[float]]]) -> dict:
    duration = np.array([bench.problem.duration for bench, *_ in taken])
    transitions = np.array([count for _, _, count, _ in taken], dtype=float)
    seconds = np.array([statistics.median(times) for *_, times in taken])
    per_second, per_transition, residual = fit(duration, transitions, seconds)
    return {
        "scene": scene, "damping": damping, "duration": duration.tolist(), "transitions": transitions.astype(int).tolist(),
        "ms": [float(f"{1e3 * x:.4g}") for x in seconds], "tolerance": [tolerance for _, tolerance, _, _ in taken],
        "ms_per_second": float(f"{1e3 * per_second:.4g}"), "us_per_transition": float(f"{1e6 * per_transition:.4g}"),
        "relative_residual": float(f"{residual:.3g}"),
    }  # fmt: skip
