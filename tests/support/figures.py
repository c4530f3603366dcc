"""What a reader could not see in a figure of Matplotlib's."""

from __future__ import annotations

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import PathCollection
from matplotlib.figure import Figure
from matplotlib.legend import Legend


def covered(figure: Figure) -> list[str]:
    """Legends of a figure with what lies under them: lines and marks."""
    canvas = figure.canvas if hasattr(figure.canvas, "get_renderer") else FigureCanvasAgg(figure)
    canvas.draw()
    found = []
    for legend in figure.findobj(Legend):
        box = legend.get_window_extent()
        for axes in figure.axes:
            if not axes.get_visible():
                continue
            for line in axes.lines:
                points = np.column_stack([np.asarray(values, dtype=float) for values in line.get_data(orig=False)])
                drawn = line.get_linestyle() not in ("None", "", " ")
                if _within(box, line.get_transform().transform(points), drawn, axes.bbox):
                    found.append(f"{axes.get_title(loc='left') or axes.get_title()}: {line.get_label()}")
            for marks in axes.collections:
                if isinstance(marks, PathCollection):
                    points = marks.get_offset_transform().transform(np.asarray(marks.get_offsets(), dtype=float))
                    if _within(box, points, False, axes.bbox):
                        found.append(f"{axes.get_title(loc='left') or axes.get_title()}: {marks.get_label()}")
    return found


def _within(box, points: np.ndarray, joined: bool, seen) -> bool:
    """Whether points, or the lines between them, lie in a box, as far as they are seen; pixels."""
    points = points[np.all(np.isfinite(points), axis=1)]
    if joined and len(points) > 1:
        steps = np.hypot(*np.diff(points, axis=0).T)
        parts = np.minimum(np.ceil(steps).astype(int), 3000) + 1
        pieces = [np.linspace(one, other, n) for one, other, n in zip(points, points[1:], parts)]
        points = np.concatenate(pieces)
    low = np.maximum([box.x0, box.y0], [seen.x0, seen.y0])
    high = np.minimum([box.x1, box.y1], [seen.x1, seen.y1])
    return bool(np.any(np.all((points > low) & (points < high), axis=1)))


def told_by_colour_alone(figure: Figure) -> list[str]:
    """Pairs of curves on the same axes that differ in nothing but colour: same dashes, width and marks."""
    found = []
    for axes in figure.axes:
        looks: dict[tuple, str] = {}
        for line in axes.lines:
            label = line.get_label()
            if label.startswith("_") or not axes.get_visible() or not len(line.get_xdata()):
                continue
            look = (str(line._dash_pattern), line.get_linestyle(), line.get_linewidth(), str(line.get_marker()))
            look += (line.get_fillstyle(), line.get_markerfacecolor() == "none")
            if look in looks and looks[look] != label:
                found.append(f"{axes.get_title(loc='left') or axes.get_title()}: {looks[look]}, {label}")
            looks[look] = label
    return found


def require_told(monkeypatch, harness) -> None:
    """From now on the harness of the benchmarks saves no figure that tells curves apart by colour alone."""
    save = harness.save

    def checked(figure: Figure, *rest, **options) -> None:
        assert told_by_colour_alone(figure) == []
        save(figure, *rest, **options)

    monkeypatch.setattr(harness, "save", checked)
