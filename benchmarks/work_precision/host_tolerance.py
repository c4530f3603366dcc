"""What a host's tolerance costs and loses: ``python -m benchmarks.work_precision.host_tolerance`` prints the table of
docs/fmu.md.

Every scenario of the thorough validation (fmu_src/validation/scenarios.py: d / 10, d and 10 d) and random held inputs, for each
built-in scene, at tolerances from 1e-4 to 1e-12, against the kernel at 1e-13 by another method.  Runs that magnify a start
error of 1e-12 m beyond 1e-9 m say nothing about a tolerance and are left out.
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import NamedTuple

import numpy as np

from fmu_src.validation import compare, scenarios
from tensegrity_core.kernel import simulate
from tensegrity_core.model import grid, held
from tensegrity_core.scene import builtin_scenes, load_scene
from tensegrity_core.statics import build_model

TOLERANCES = tuple(10.0**-k for k in range(4, 13))
#: Of the truth: method and tolerance; beside it, a run at a tenth of its effort tells how well it is known.
TRUTH = ("radau9", 1e-13)
#: What counts as good: m; N, and in terms of the largest force of a run.
POSITION_BOUND, FORCE_BOUND, FORCE_RELATIVE = 1e-7, 1e-3, 1e-6


class Cell(NamedTuple):
    """One run.  position: largest error, m; force: largest error by its bound; seconds: processor time."""

    run: str
    tolerance: float
    position: float
    force: float
    seconds: float


def runs():
    """(name, model, inputs) of every run."""
    for name in builtin_scenes():
        model = build_model(load_scene(name))
        for run in scenarios.scenarios(model, thorough=True):
            yield f"{name} {run.name}", run.model, run.inputs
        rng, times = np.random.default_rng(11), grid(scenarios.DURATION, scenarios.STEP)
        force, node = np.zeros((len(model.nodes), 3)), scenarios.pushed_node(model)
        kicks = rng.normal(size=(100, 3)) * 60.0

        def random(t, force=force, node=node, kicks=kicks, axes=model.axes):
            force[node, list(axes)] = kicks[int(t / 0.05 + 1e-9) % len(kicks)][list(axes)]
            return force.copy()

        yield f"{name} random", model, held(model, times, random)


def errors(found, truth) -> tuple[float, float]:
    """Largest errors of positions, m, and of forces as multiples of their bound; samples at transitions are left out."""
    position = np.max(np.abs(found.position - truth.position))
    near = np.array([t.time for t in truth.transitions])
    far = np.array([not np.any(np.abs(near - t) < 1e-4) for t in truth.times])
    worst = 0.0
    for name in compare.KINDS["force"][0]:
        one, other = getattr(found, name), getattr(truth, name)
        bound = max(FORCE_BOUND, FORCE_RELATIVE * np.max(np.abs(other), initial=0.0))
        worst = max(worst, np.max(np.abs(one - other)[far], initial=0.0) / bound)
    return float(position), float(worst)


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    cells, left_out = [], []
    for name, model, inputs in runs():
        truth, beside = simulate(model, inputs, *TRUTH), simulate(model, inputs, "dop853", 1e-12)
        if errors(beside, truth)[0] > 1e-9:
            left_out.append((name, errors(beside, truth)[0]))
            continue
        for tolerance in TOLERANCES:
            start = time.process_time()
            found = simulate(model, inputs, tolerance=tolerance)
            cells.append(Cell(name, tolerance, *errors(found, truth), time.process_time() - start))
        print(name, *(f"{cell.position:.1e}" for cell in cells[-len(TOLERANCES) :]), file=sys.stderr, flush=True)
    table(cells)
    print(f"{len(cells)} runs of {len(cells) // len(TOLERANCES)} cases; left out: {left_out}")


def table(cells: list[Cell]) -> None:
    """A row for each tolerance."""
    print("| tolerance | position error, m: median | largest | within 1e-7 m | forces within their bound | time, 1e-10 = 1 |")
    print("|---|---|---|---|---|---|")
    base = {cell.run: cell.seconds for cell in cells if cell.tolerance == 1e-10}
    for tolerance in TOLERANCES:
        chosen = [cell for cell in cells if cell.tolerance == tolerance]
        position, force = (np.array([getattr(cell, name) for cell in chosen]) for name in ("position", "force"))
        ratio = np.exp(np.mean([np.log(cell.seconds / base[cell.run]) for cell in chosen]))
        print(
            f"| {tolerance:.0e} | {np.median(position):.1e} | {position.max():.1e} |"
            f" {np.mean(position <= POSITION_BOUND):.0%} | {np.mean(force <= 1.0):.0%} | {ratio:.2f} |"
        )


if __name__ == "__main__":
    main()
