"""Measures `auto` against the methods that it chooses from: ``python -m benchmarks.speed.method_choice`` writes
docs/method_choice.json and docs/method-choice.md, in about half an hour.

Every cell is run by `dopri5`, `dop853`, `rodas5p`, `radau9` and `auto` in turns, in one process.  What counts is the least
processor time of the kernel's steps; the ratio of a cell is that of `auto` over the best of the others.
"""

from __future__ import annotations

import ctypes
import subprocess
import time
from collections.abc import Callable, Iterable
from ctypes import POINTER, Structure, c_double, c_int64, c_void_p, cast
from pathlib import Path

import numpy as np
from scipy.stats import gmean

from benchmarks.harness import machine
from benchmarks.harness.page import Page, rendered
from tensegrity_core.files import scratch
from tensegrity_core.kernel import Kernel
from tensegrity_core.native import build

from .method_choice_cells import Cell, anywhere, built, drawn, every, ladders

BASE = ("dopri5", "dop853", "rodas5p", "radau9")
METHODS = (*BASE, "auto")
#: Cells of each kind, and seeds.
DRAWN, ANYWHERE, SEEDS = 360, 240, (2026, 1128)
#: A run that takes longer is given up, and a cell whose best run is shorter is not judged, s.
MOST, LEAST = 1.0, 1e-4
#: Rounds of cells whose runs together take less than this, s; others have two.
SHORT = 0.5
#: The targets: geometric mean, 95 % quantile, largest ratio; and how much more a looser tolerance may cost.
MEAN, MOST_CELLS, WORST, LOOSER = 1.05, 1.3, 2.0, 1.1


class Functions(Structure):
    """Of a kernel, as method_choice.c wants them."""

    _fields_ = [("initialize", c_void_p), ("step", c_void_p), ("values", c_void_p)]


def runner(folder: Path) -> Callable:
    """The function `run` of method_choice.c, compiled in a folder."""
    source, library = Path(__file__).with_suffix(".c"), folder / "method_choice.so"
    compiler = build.system_compiler() or build.zig()
    subprocess.run([*compiler, "-std=c99", "-O2", "-shared", "-fPIC", str(source), "-o", str(library)], check=True)
    run = ctypes.CDLL(str(library)).run
    run.restype = c_double
    run.argtypes = (POINTER(Functions), c_void_p, c_int64, c_void_p, c_int64, c_int64, c_void_p, c_double)
    return run


def functions_of(kernel: Kernel) -> Functions:
    return Functions(*(cast(getattr(kernel._library, f"ts_{name}"), c_void_p) for name, _ in Functions._fields_))


def measure(run: Callable, cell: Cell, rounds: int, most: float = MOST) -> dict:
    """seconds: least processor time of each method that ended, s; stats: what it did; failed: why others did not."""
    model, steps, rows = built(cell)
    seconds: dict[str, list[float]] = {}
    stats, failed, kernels = {}, {}, {}
    for method in METHODS:
        kernel = kernels[method] = Kernel(model, method=method, tolerance=cell.tolerance)
    functions = functions_of(kernel)
    for n in range(rounds):
        for method, kernel in kernels.items():
            if method in failed or (n >= 2 and sum(map(sum, seconds.values())) > SHORT):
                continue
            spent = run(functions, kernel._sim, len(steps), steps.ctypes.data, *rows.shape, rows.ctypes.data, most)
            if spent < 0.0:
                failed[method] = "too long" if spent == -1000.0 else kernel._message()
                continue
            seconds.setdefault(method, []).append(spent)
            stats.setdefault(method, kernel.stats)
    least = {method: min(values) for method, values in seconds.items() if method not in failed}
    return {"name": cell.name, "seconds": least, "stats": stats, "failed": failed}


def judged(rows: Iterable[dict]) -> list[dict]:
    """Rows with `best` (method) and `ratio`; cells that no method ended and very short ones are left out."""
    found = []
    for row in rows:
        base = {m: row["seconds"][m] for m in BASE if m in row["seconds"]}
        if base and min(base.values()) >= LEAST:
            best = min(base, key=base.get)
            found.append({**row, "best": best, "ratio": row["seconds"].get("auto", np.inf) / base[best]})
    return found


def dearer(ladder: list[dict]) -> list[float]:
    """Of each row but the last of a ladder of falling tolerances: its time over the least one at a tighter tolerance, or 0
    where it is too short."""
    times = [row["seconds"].get("auto", np.inf) for row in ladder]
    return [float(t / min(times[n + 1 :])) if t > LEAST else 0.0 for n, t in enumerate(times[:-1])]


def collect(rounds: int) -> dict:
    """docs/method_choice.json."""
    began, where = time.perf_counter(), machine.describe()
    sets = {"drawn": drawn(DRAWN, SEEDS[0]), "anywhere": anywhere(ANYWHERE, SEEDS[1])}
    with scratch() as folder:
        run = runner(folder)
        rows = {name: [slim(measure(run, cell, rounds)) for cell in cells] for name, cells in sets.items()}
        rows["ladders"] = [[slim(measure(run, cell, rounds)) for cell in ladder] for ladder in ladders()]
    minutes = round((time.perf_counter() - began) / 60.0)
    return {"machine": where, "rounds": rounds, "cells": len(every()), **rows, "minutes": minutes}


def slim(row: dict) -> dict:
    """What is kept of a row."""
    seconds = {method: float(f"{value:.4g}") for method, value in row["seconds"].items()}
    return {"name": row["name"], "seconds": seconds, "failed": row["failed"]}


def summary(rows: list[dict]) -> dict:
    """Of the ratios of `auto` to the best: how many were judged, mean, quantile, largest, and how many are above WORST; how
    often each method is best."""
    found = judged(rows)
    ratio = np.array([row["ratio"] for row in found])
    best = {method: sum(row["best"] == method for row in found) for method in BASE}
    numbers = {"mean": gmean(ratio), "quantile": np.quantile(ratio, 0.95), "largest": ratio.max()}
    return {"judged": len(found), **numbers, "above": int((ratio > WORST).sum()), "best": best}


def quantiles(method: str, rows: list[dict]) -> dict:
    """Of the ratios of a method's times to the best: geometric mean and 95 %, over the cells that it ended; how many it did
    not."""
    found = judged(rows)
    ratio = np.array([row["seconds"][method] / row["seconds"][row["best"]] for row in found if method in row["seconds"]])
    return {"mean": gmean(ratio), "quantile": np.quantile(ratio, 0.95), "lost": len(found) - len(ratio)}


def report(result: dict) -> str:
    """docs/method-choice.md."""
    chained = [row for ladder in result["ladders"] for row in ladder]
    sets = {"out of the product": result["drawn"], "anywhere": result["anywhere"], "ladders": chained}
    everything = [row for rows in sets.values() for row in rows]
    constants = {"base": BASE, "aims": (MEAN, MOST_CELLS), "worst": WORST, "looser": LOOSER, "least": LEAST, "most": MOST}
    return rendered(
        "speed/method_choice",
        **result,
        **constants,
        sets={title: summary(rows) for title, rows in (sets | {"all": everything}).items()},
        alone={method: quantiles(method, everything) for method in METHODS},
        dearest=sorted(judged(everything), key=lambda row: -row["ratio"])[:8],
        given_up=sum(not any(m in row["seconds"] for m in BASE) for row in everything),
        loose=[value for ladder in result["ladders"] for value in dearer(ladder)],
    )


PAGE = Page(__doc__, "method_choice", collect, report, options={"rounds": 5})

if __name__ == "__main__":
    PAGE.main()
