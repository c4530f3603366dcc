"""Charts: no legend lies on a curve, and curves differ in more than colour."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fmu_src.validation import report
from tensegrity_core.article import figures
from tensegrity_core.kernel import simulate
from tensegrity_core.model import grid, held
from tensegrity_core.output import plots
from tensegrity_core.scene import builtin_scenes
from tensegrity_core.scene.towers import tower
from tensegrity_core.statics import build_model
from tests.support import push, scene
from tests.support.figures import covered, told_by_colour_alone

DATA = Path(__file__).resolve().parents[2] / "docs" / "data"


def require_readable(figure) -> None:
    assert covered(figure) == [] and told_by_colour_alone(figure) == []


def test_what_is_covered_or_told_by_colour_alone_is_found():
    figure = plots.new_figure(400, 300)
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], [0.0, 1.0], label="a")
    axes.plot([0.0, 1.0], [0.0, 0.9], label="b")
    axes.legend(loc="center")
    assert len(covered(figure)) == 2 and len(told_by_colour_alone(figure)) == 1


@pytest.mark.parametrize("name", [*builtin_scenes(), "tower"])
def test_series(name):
    model = build_model(tower(10)) if name == "tower" else scene(name)
    force = push(model)
    result = simulate(model, held(model, grid(0.2, 0.05), force=lambda t: force), tolerance=1e-6)
    figure = plots.plot(model, result)
    require_readable(figure)
    width, height = figure.bbox.width, figure.bbox.height
    for panel in (figure.axes[0], figure.axes[-1]):
        box = panel.get_legend().get_window_extent()
        assert box.x0 >= 0.0 and box.x1 <= width and box.y0 >= 0.0 and box.y1 <= height
        assert panel.get_position().width > 0.6


@pytest.mark.parametrize("name", figures.FIGURES)
def test_figures_of_the_article(name):
    path = DATA / f"experiment_{name}.csv"
    rows = np.genfromtxt(path, delimiter=",", names=True, deletechars="", replace_space=" ")
    columns = {column: rows[column] for column in rows.dtype.names}
    with figures.style():
        for draw in figures.FIGURES[name].values():
            require_readable(draw(columns))


def test_runs_of_a_report():
    for model in (scene("six_bar_nsh"), build_model(tower(10))):
        times, names = np.linspace(0.0, 1.0, 50), list(model.string_names)
        rows = np.sin(times)[:, None] * np.arange(1.0, len(names) + 1.0)
        figure = plots.new_figure(900, 400)
        report._draw(figure.subplots(2, 1), times, rows, rows, 1e-9 * np.abs(rows), names, "tension, N", "error, N")
        figure.tight_layout()
        require_readable(figure)
