"""Draws a scene at its start: the FMU's icon."""

from __future__ import annotations

import io

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tensegrity_core.model import Model

BAR, STRING, NSH, GROUND = "#30343f", "#3a7ca5", "#d1495b", "#6b705c"


def model_png(model: Model, pixels: int = 480) -> bytes:
    """A square PNG; the same model gives the same bytes under the same version of matplotlib."""
    figure = Figure(figsize=(pixels / 100.0, pixels / 100.0), dpi=100)
    FigureCanvasAgg(figure)
    planar = len(model.axes) == 2
    axes = figure.add_axes((0, 0, 1, 1), projection=None if planar else "3d")
    points = model.nodes[:, list(model.axes)]
    for start, end in model.bars:
        axes.plot(*points[[start, end]].T, color=BAR, linewidth=6, solid_capstyle="round")
    for (start, end), nsh in zip(model.strings, model.nsh):
        axes.plot(*points[[start, end]].T, color=NSH if nsh else STRING, linewidth=2)
    axes.plot(*points[model.fixed].T, linestyle="", marker="^", markersize=12, color=GROUND)
    _frame(axes, points, planar)
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


def _frame(axes, points, planar):
    axes.set_axis_off()
    low, high = points.min(axis=0), points.max(axis=0)
    centre, half = 0.5 * (low + high), 0.58 * float(np.max(high - low))
    axes.set_xlim(centre[0] - half, centre[0] + half)
    axes.set_ylim(centre[1] - half, centre[1] + half)
    if planar:
        axes.set_aspect("equal")
        return
    axes.set_zlim(centre[2] - half, centre[2] + half)
    axes.set_box_aspect((1, 1, 1), zoom=1.3)
    axes.view_init(elev=18, azim=-62)
