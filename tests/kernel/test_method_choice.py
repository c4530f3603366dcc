"""`auto` against the methods that it chooses from, by counted work: times belong to benchmarks/speed/method_choice.py."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.speed import method_choice
from benchmarks.speed import method_choice_cells as cells
from tensegrity_core.files import scratch
from tensegrity_core.kernel import Kernel
from tests.support import scene
from tests.support.driven_scenes import MAST, built

#: Right-hand sides that a factorisation with its solutions costs, on scenes of two and three bars.
FACTORISATION = 4.0


def work(stats: dict) -> float:
    return stats["rhs"] + FACTORISATION * stats["factorisations"] + 2.0 * stats["jacobians"]


def run(cell: cells.Cell, method: str) -> Kernel:
    model, steps, rows = cells.built(cell)
    kernel = Kernel(model, method=method, tolerance=cell.tolerance)
    block = kernel.values[: rows.shape[1]]
    block[:] = rows[0]
    kernel.initialize()
    for n, h in enumerate(steps.tolist()):
        if n < len(rows):
            block[:] = rows[n]
        kernel.step(h)
    return kernel


@cache
def works(cell: cells.Cell) -> dict[str, float]:
    return {method: work(run(cell, method).stats) for method in method_choice.METHODS}


#: Cells in which a choice by the explicit steps' stability alone took 2.4 to 19 times the work of the best method.
LIFTED = [
    ("three_bar", 500.0, 1e-10),
    ("three_bar", 500.0, 1e-12),
    ("three_bar", 5000.0, 1e-12),
    ("two_bar_nsh", 500.0, 1e-12),
    ("three_bar_nsh", 500.0, 1e-10),
    ("three_bar_nsh", 5000.0, 1e-12),
    ("two_bar_nsh", 5000.0, 1e-6),
]


@pytest.mark.parametrize(("name", "damping", "tolerance"), LIFTED)
def test_tight_tolerances_on_stiff_strings(name, damping, tolerance):
    found = works(cells.Cell(name, False, damping, "lift", 5.0, 0.0, tolerance, 0))
    assert found["auto"] < 1.4 * min(found[m] for m in method_choice.BASE), found


def test_a_damper_that_sets_in_and_out_at_every_step():
    """Stability limits explicit steps, and the tension of a string that pulls or does nothing passes 0 in nearly all of
    them."""
    model = replace(built(MAST), damping=np.full(2, 5000.0), damping_law="tension_only")
    spent = {}
    for method in ("radau9", "auto"):
        kernel = Kernel(model, method=method, tolerance=1e-3)
        kernel["force"][0] = -100.0
        kernel.initialize()
        kernel.step(1.0)
        spent[method] = work(kernel.stats)
    assert spent["auto"] < spent["radau9"], spent


def test_drawn_cells_are_close_to_the_best_method():
    """Of small cells anywhere: the mean, most of them and all of them."""
    small = [cell for cell in cells.anywhere(60, 7) if cell.duration < 2.0 and cell.tolerance > 1e-11][:16]
    ratio = np.array([(found := works(cell))["auto"] / min(found[m] for m in method_choice.BASE) for cell in small])
    assert np.exp(np.log(ratio).mean()) < 1.1 and np.quantile(ratio, 0.9) < 1.4 and ratio.max() < 2.5, ratio


def test_steps_are_the_same_in_every_run():
    """What is measured is counted, not timed."""
    cell = cells.Cell("three_bar_nsh", False, 5000.0, "square", 1.0, 0.0, 1e-9, 3)
    first, second = run(cell, "auto"), run(cell, "auto")
    assert first.stats == second.stats and (first.values == second.values).all()
    assert 0 < first.stats["implicit_steps"] < first.stats["steps"]


def test_saved_state_holds_what_auto_has_learnt():
    """In the middle of a run that uses all three methods: going on from it repeats every step."""
    model = replace(scene("three_bar"), damping=np.full(len(scene("three_bar").strings), 5000.0))
    kernel = Kernel(model, tolerance=1e-9)
    kernel["force"][2] = 45.0
    kernel.initialize()
    ends = []
    for _n in range(12):
        kernel.step(0.1)
        state = kernel.save()
        kernel.step(0.25)
        ends.append((kernel.stats, kernel.state))
        kernel.restore(state)
        kernel.step(0.25)
        assert kernel.stats == ends[-1][0] and (kernel.state == ends[-1][1]).all()
        kernel.restore(state)
    assert kernel.stats["implicit_steps"] > 0


def test_a_scene_that_is_not_stiff_stays_explicit():
    """Trials of implicit methods take some hundredths of the work of a long run at most."""
    cell = cells.Cell("three_bar", False, 50.0, "square", 10.0, 0.0, 1e-9, 1)
    found = works(cell)
    assert found["auto"] < 1.08 * found["dop853"]


def test_a_cell_is_measured_by_every_method():
    cell = cells.Cell("two_bar", False, 500.0, "constant", 0.1, 0.01, 1e-6, 0)
    with scratch() as folder:
        row = method_choice.measure(method_choice.runner(folder), cell, 1)
    assert set(row["seconds"]) == set(method_choice.METHODS) and not row["failed"]
    assert row["stats"]["auto"] == run(cell, "auto").stats


def test_every_part_of_the_product_is_there():
    every = cells.every()
    assert len(set(every)) == len(every) > 10_000
    product = {"scene": cells.SCENES, "damping": cells.DAMPINGS, "drive": cells.DRIVES, "call": cells.CALLS}
    product |= {"duration": cells.DURATIONS, "tolerance": cells.TOLERANCES, "memory": (False, True)}
    for field, values in product.items():
        assert {getattr(cell, field) for cell in every} == set(values)


def test_a_looser_tolerance_that_costs_more_is_seen():
    ladder = [{"seconds": {"auto": t}} for t in (2e-3, 3e-3, 2.5e-3)]
    assert method_choice.dearer(ladder) == pytest.approx([0.8, 1.2])
