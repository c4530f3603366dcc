"""Pictures of modes: each shape on the structure, with its frequency and damping.

The structure at rest is pale; before it stands the structure moved along the shape.
"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..equilibria.modes import Mode
from ..model import Model
from .drawing import NAMED_ROOM, Drawing, frame, new_axes
from .plots import new_figure

SWING = 0.12  # of the structure's size: the largest move that is drawn
FEW_STRINGS = 8  # whose names two states of a structure leave room for
WIDTH = 0.6  # of lines and marks, of those of a picture of a structure alone


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
    """One mode's shape on axes of drawing.new_axes."""
    reach = SWING * float(np.ptp(model.nodes, axis=0).max())
    way = mode.shape.real
    moved = model.nodes + reach * way / max(float(np.linalg.norm(way, axis=1).max()), 1e-300)
    Drawing(axes, model, WIDTH, alpha=0.25, floor=False)
    drawing = Drawing(axes, model, WIDTH, floor=False)
    drawing.move(moved, slack=np.zeros(len(model.strings), dtype=bool))
    frame(axes, model, np.vstack((model.nodes, moved)), NAMED_ROOM)
    drawing.name(moved, members=len(model.strings) <= FEW_STRINGS)
