"""Charts of a result's series, and how figures are made and written.  Nothing opens a window."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from ..files import replacing
from ..model import Model, Result
from .export import require_writable


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
        panel.plot(result.times, result.position[:, model.free_nodes, axis], label=names)
        panel.set_ylabel(f"{'xyz'[axis]} in m")
    panels[-1].plot(result.times, result.string_force, label=list(model.string_names))
    panels[-1].set_ylabel("string force in N")
    panels[-1].set_xlabel("time in s")
    for panel in (panels[0], panels[-1]):
        panel.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7, ncols=1 + len(panel.lines) // 13)
    for panel in panels:
        panel.grid(color="0.9")
        panel.margins(x=0.0)
    panels[0].set_title(model.name)
    figure.tight_layout()
    return figure


def few_colours(figure: Figure, dpi: float) -> Image.Image:
    """A figure as a picture of 256 colours, half the bytes; maximum coverage: a colour that is rare stays."""
    png = io.BytesIO()
    figure.savefig(png, dpi=dpi)
    return Image.open(png).convert("RGB").quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)


#: Settings under which a figure is saved: texts stay texts in an SVG, and equal figures give equal bytes.
SAVING: dict[Any, Any] = {"svg.fonttype": "none", "svg.hashsalt": "tensegrity"}


def write_figure(figure: Figure, path: Path) -> None:
    """Write a figure as .png or .svg, whole or not at all, without dates.  Raises InputError, see export.require_writable."""
    path = require_writable(path, (".png", ".svg"))
    kind = path.suffix.lower()[1:]
    metadata = {"Date": None, "Creator": None} if kind == "svg" else {"Software": None}
    with rc_context(SAVING), replacing(path) as file:
        figure.savefig(file, format=kind, metadata=metadata)
