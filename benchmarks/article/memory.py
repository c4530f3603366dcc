"""Measures the NSH with memory (law "hysteretic") and writes docs/memory.md, its figures and data.

Files: docs/memory.json (the numbers, and what they were measured on), docs/memory.md, docs/data/memory_NAME.csv (series) and
docs/figures/memory_NAME.png.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from benchmarks.harness import machine
from benchmarks.harness.page import Columns, Page, plain, rendered
from tensegrity_core.article.experiments import DAMPINGS, LIFTS
from tensegrity_core.laws.beam import beam_extrema
from tensegrity_core.model.elements import Series

from . import memory_loops as loops
from . import memory_runs as runs
from .claims import NO, NUMBERED, PARTLY, SYSTEMS, YES
from .memory_figures import FIGURES

#: Digits of the numbers in the files: enough for the energy accounts.
DIGITS = 12
NAMES = {"base": "the article's NSH", "series": "single-valued, k in series", "memory": "with memory"}

# --- measuring ---------------------------------------------------------------------------------------------------


def measure() -> tuple[dict, dict]:
    """Everything: numbers, and series by the name of their file."""
    numbers, series = {}, {}

    def say(what: str) -> None:
        print(what, file=sys.stderr, flush=True)

    say("loops")
    honeycomb, k = Series(loops.beams(), "hysteretic"), loops.STIFFNESS
    for name, sample in (("cells", (loops.cells(), loops.CELL_STIFFNESS)), ("honeycomb", (honeycomb, k))):
        reach = loops.CELL_REACH if name == "cells" else loops.REACH
        numbers[name] = loops.loop(*sample, (reach, 0.0))
        numbers[name]["machine"], series[name] = loops.tested(*sample, reach)
    numbers["honeycomb"]["swept"] = loops.swept(honeycomb, numbers["honeycomb"]["snaps"])
    numbers["partial"] = [{"turns": list(turns), **loops.loop(honeycomb, k, turns)} for turns in loops.PARTIAL]
    say("own stiffness")
    numbers["stiffness"], series["stiffness"] = loops.scan()
    say("energy")
    numbers["ledger"] = runs.ledger()
    say("experiment I")
    numbers["I"], series["I"], series["ramp"] = runs.first_experiment()
    say("experiment II")
    numbers["II"], series["II"] = runs.second_experiment()
    say("claims")
    numbers["claims"] = runs.judged()
    return numbers, series


def collect() -> dict:
    """The numbers of the page and the columns of each series."""
    began, where = time.perf_counter(), machine.describe()
    numbers, series = measure()
    data = {"machine": where, "series": list(series), **numbers, "seconds": time.perf_counter() - began}
    return plain(data, DIGITS) | {"columns": series}


# --- page --------------------------------------------------------------------------------------------------------


def report(data: dict) -> str:
    """docs/memory.md."""
    scan, found = data["columns"]["stiffness"], [data["I"][name] for name in SYSTEMS]
    differ, midway = ([(name, i) for name in SYSTEMS for i in data["I"][name][key]] for key in ("differ", "midway"))
    rank = {
        int(number): {law: (NO, PARTLY, YES).index(one["verdict"]) for law, one in laws.items()}
        for number, laws in data["claims"].items()
    }
    return rendered(
        "article/memory",
        **data,
        scan=scan,
        risen=scan["stiffness"][1:][np.diff(scan["loss"]) > 0.0].tolist(),
        middle=int(np.argmin(np.abs(np.log(scan["stiffness"] / loops.STIFFNESS)))),
        f_min=[beam_extrema(b.Q, b.zeta, b.h).f_min for b in loops.beams()],
        same=all(one["series"]["snaps"] == one["memory"]["snaps"] for one in found),
        differ=len(differ),
        midway=len({*differ} & {*midway}),
        others=len({*midway} - {*differ}),
        changed=[n for n, of in rank.items() if of["series"] != of["memory"]],
        gained=[n for n, of in rank.items() if of["series"] < of["memory"]],
        softer=[n for n, of in rank.items() if of["base"] != of["series"]],
        lifts=LIFTS,
        dampings=[f"{d:g}" for d in sorted(DAMPINGS)],
        systems=SYSTEMS,
        names=NAMES,
        numbered=NUMBERED,
        loops=loops,
        runs=runs,
    )


COLUMNS = Columns("memory", DIGITS)
PAGE = Page(__doc__, "memory", collect, report, FIGURES, keep=COLUMNS.keep, read=COLUMNS.read)

if __name__ == "__main__":
    PAGE.main()
