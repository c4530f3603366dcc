"""Charts of a result's series, and how figures are made and written.  Nothing opens a window."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from ..files import replacing
from ..model import Model, Result
from .export import require_writable

#: Colours after Okabe and Ito, dashes, and marks for each round of the dashes; how many curves of one picture have names.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#b0487f", "#22252e", "#c98a00")
DASHES: tuple[Any, ...] = ("-", (0, (6, 2)), (0, (2, 1.2)), (0, (8, 2, 2, 2)), (0, (1, 1)))
MARKS = ("", "o", "^", "s", "D")
MOST = 24


def new_figure(width: float, height: float, dpi: float = 100.0) -> Figure:
    """A figure with its own canvas; width, height: pixels."""
    figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi)
    FigureCanvasAgg(figure)
    return figure


def plot(model: Model, result: Result) -> Figure:
    """Coordinates of the free nodes (m) and forces of the strings (N) over time (s)."""
    rows = len(model.axes) + 1
    figure = new_figure(900, 220 * rows)
    panels = figure.subplots(rows, 1, sharex=True)
    names = [model.node_names[i] for i in model.free_nodes]
    for panel, axis in zip(panels, model.axes):
        draw_series(panel, result.times, result.position[:, model.free_nodes, axis], names)
        panel.set_ylabel(f"{'xyz'[axis]} in m")
    draw_series(panels[-1], result.times, result.string_force, list(model.string_names))
    panels[-1].set_ylabel("string force in N")
    panels[-1].set_xlabel("time in s")
    for panel in (panels[0], panels[-1]):
        legend_beside(panel)
    for panel in panels:
        panel.grid(color="0.9")
        panel.margins(x=0.0)
    panels[0].set_title(model.name)
    figure.tight_layout()
    return figure


def draw_series(axes: Any, times: np.ndarray, rows: np.ndarray, names: Sequence[str]) -> list[Line2D]:
    """Curves that differ in dashes or marks as well as in colour.  rows: (K+1, n).  Returns all n lines.

    Of more than MOST the first are those with a name; the others are thin and grey.
    """
    lines = []
    for i, name in enumerate(names):
        look = {"color": COLOURS[i % len(COLOURS)], "linestyle": DASHES[i % len(DASHES)], "linewidth": 1.2}
        look |= {"marker": MARKS[i // len(DASHES) % len(MARKS)], "markersize": 3.5, "markevery": (i % 7 / 70.0, 0.1)}
        if len(names) > MOST and i >= MOST - 1:
            look = {"color": "0.75", "linewidth": 0.5, "zorder": 1.5}
            name = f"{len(names) - MOST + 1} more" if i == MOST - 1 else "_"
        lines += axes.plot(times, rows[:, i], label=name, **look)
    return lines


def legend_beside(axes: Any, **style: Any) -> None:
    """A legend to the right of axes, where it covers nothing; none where there are no curves."""
    named = sum(not str(line.get_label()).startswith("_") for line in axes.lines)
    if named:
        columns = 1 + (named - 1) // 12
        axes.legend(
            loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7, handlelength=3.0, ncols=columns, frameon=False, **style
        )


def few_colours(figure: Figure, dpi: float) -> Image.Image:
    """A figure as a picture of 256 colours, half the bytes; maximum coverage: a colour that is rare stays."""
    png = io.BytesIO()
    figure.savefig(png, dpi=dpi)
    return Image.open(png).convert("RGB").quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)


def small_png(figure: Figure) -> bytes:
    """A figure as a PNG of 256 colours, without dates."""
    out = io.BytesIO()
    few_colours(figure, figure.dpi).save(out, "PNG", optimize=True)
    return out.getvalue()


#: Settings under which a figure is saved: texts stay texts in an SVG, and equal figures give equal bytes.
SAVING: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": "tensegrity"}


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as .png or .svg, whole or not at all, without dates.  Raises InputError, see export.require_writable."""
    path = require_writable(path, (".png", ".svg"))
    kind = path.suffix.lower()[1:]
    metadata = {"Date": None, "Creator": None} if kind == "svg" else {"Software": None}
    with rc_context(SAVING), replacing(path) as file:
        figure.savefig(file, format=kind, metadata=metadata)
