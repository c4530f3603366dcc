"""Runs the article's experiments in full length and writes what docs/experiments.md shows: figures, data, page.

Files: docs/data/experiment_NAME.csv, as `tensegrity experiment NAME` writes it, docs/figures/experiment_NAME_figure_N.png,
docs/experiments.json (the tables, and what they were computed on) and docs/experiments.md.
"""

from __future__ import annotations

import sys
import time
from functools import partial

from matplotlib.figure import Figure

from benchmarks.harness import machine
from benchmarks.harness.page import Columns, Page, plain, rendered
from tensegrity_core.article.experiments import EXPERIMENTS, SYSTEMS
from tensegrity_core.article.figures import FIGURES
from tensegrity_core.article.figures import style as article_style

from .measures import REPEATED_SECONDS, repeats


def collect() -> dict:
    """Runs everything; what the page tells, and the columns of each experiment."""
    began, where, tables, columns = time.perf_counter(), machine.describe(), {}, {}
    for name, experiment in EXPERIMENTS.items():
        print(name, file=sys.stderr)
        data = experiment.run(SYSTEMS, experiment.duration)
        tables[name], columns[name] = data.summary().splitlines(), data.columns()
    seconds = round(time.perf_counter() - began)
    return {"machine": where, "seconds": seconds, "tables": tables, "repeats": plain(repeats(), 6), "columns": columns}


def report(data: dict) -> str:
    """docs/experiments.md."""
    return rendered("article/experiments", **data, figures=FIGURES, repeated_seconds=REPEATED_SECONDS)


def figure_of(data: dict, name: str, number: int) -> Figure:
    """A figure of the article, in the article's style."""
    with article_style():
        return FIGURES[name][number](data["columns"][name])


DRAWN = {
    f"experiment_{name}_figure_{number}": partial(figure_of, name=name, number=number)
    for name, figures in FIGURES.items()
    for number in figures
}
COLUMNS = Columns("experiment")
PAGE = Page(__doc__, "experiments", collect, report, DRAWN, keep=COLUMNS.keep, read=COLUMNS.read)

if __name__ == "__main__":
    PAGE.main()
