"""Pictures of modes: each shape on the structure, with its frequency and damping.

The structure at rest is pale; before it stands the structure moved along the shape.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..equilibria.modes import Mode
from ..model import Model
from .plots import BAR, NSH, STRING, frame, new_axes, new_figure

SWING = 0.12  # of the structure's size: the largest move that is drawn


def modes_figure(model: Model, found: list[Mode], most: int = 6) -> Figure:
    """The first modes, up to `most`, in rows of three."""
    found = found[:most]
    columns, rows = min(3, max(1, len(found))), max(1, -(-len(found) // 3))
    figure = new_figure(300 * columns, 330 * rows)
    for i, mode in enumerate(found):
        left, bottom = i % columns / columns, 1.0 - (i // columns + 1) / rows
        axes = new_axes(figure, model, (left, bottom, 1.0 / columns, 0.86 / rows))
        draw_mode(axes, model, mode)
        figure.text(left + 0.5 / columns, bottom + 0.97 / rows, f"{i + 1}: {label(mode)}", ha="center", va="top", fontsize=9)
    return figure


def label(mode: Mode) -> str:
    """Frequency and damping ratio, or the rate at which the mode decays or grows."""
    if mode.oscillates:
        return f"{mode.frequency:.4g} Hz, damping ratio {mode.damping_ratio:z.3g}"
    if mode.neutral:
        return f"{mode.neutral}, nothing resists"
    return f"{'decays' if mode.decay_rate > 0.0 else 'grows'} at {abs(mode.decay_rate):.4g} /s"


def draw_mode(axes: Axes, model: Model, mode: Mode) -> None:
    """One mode's shape on axes of plots.new_axes."""
    reach = SWING * float(np.ptp(model.nodes, axis=0).max())
    way = mode.shape.real
    way = reach * way / max(float(np.linalg.norm(way, axis=1).max()), 1e-300)
    states = [(model.nodes, 0.25), (model.nodes + way, 1.0)]
    for nodes, alpha in states:
        for ends, law in zip(model.strings, model.nsh):
            _line(axes, model, nodes[ends], NSH if law else STRING, 1.0, alpha)
        for ends in model.bars:
            _line(axes, model, nodes[ends], BAR, 3.0, alpha)
    frame(axes, model, np.concatenate([nodes for nodes, _ in states]))


def _line(axes: Axes, model: Model, points: np.ndarray, colour: str, width: float, alpha: float) -> None:
    places = points[:, list(model.axes)].T
    axes.plot(*places, color=colour, linewidth=width, alpha=alpha, solid_capstyle="round")
