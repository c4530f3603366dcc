"""Names of nodes, strings and bars in a picture of a structure, where there is room for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from matplotlib.patheffects import Normal, Stroke
from matplotlib.text import Text

from ..model import Model
from ..model.routes import segments

#: A scene of more nodes, or strings, than MOST has names for FEW nodes, and none for strings and bars: they would cover the
#: picture.
MOST, FEW = 24, 10
#: Size of letters, points.
LETTERS = 8.0
INK, STRING_INK, NSH_INK = "#22252e", "#0d6470", "#a3283b"
#: Where a name may stand: away from its node, in directions off the preferred one, degrees; across its member, at shares of it.
TURNS = (0.0, 40.0, -40.0, 80.0, -80.0, 130.0, -130.0, 180.0)
#: How far from what is named at least, and how much farther else; beside the zigzag of an NSH, points.
NEAR, FARTHER, BESIDE = 3.0, (0.0, 5.0), 6.0
SHARES = (0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74)
#: What a name loses by covering a point of a bar or a node, one of a string, and by standing at a less usual place.
COVERED, CROSSED, LATER = 3.0, 1.0, 0.2


@dataclass(frozen=True, eq=False)
class _Place:
    """share: of the way between the ends of what is named; offset: (2,) from there to the middle of the name, points."""

    share: float
    offset: np.ndarray


class Names:
    """Texts over a structure on axes; they follow what they name."""

    def __init__(
        self,
        axes: Any,
        model: Model,
        project: Callable[[np.ndarray], np.ndarray],
        nodes: np.ndarray,
        width: float,
        members: bool = True,
    ):
        """project: places (n, 3) m -> (n, 2) pixels; nodes: (N, 3) m, where places for the names are sought; width: of a bar's
        line, points; members: strings and bars have names, too."""
        self.figure, self.project, self.point = axes.figure, project, axes.figure.dpi / 72.0
        self.box = axes.get_position(original=True).transformed(axes.figure.transFigure)
        self.near = 0.5 * width + NEAR
        self.shown: list[tuple[Text, np.ndarray, _Place]] = []
        self._taken: list[np.ndarray] = []
        seen = project(nodes)
        self._sample(model, seen)
        for name, ends, beside, style in _named(model, members):
            self._write(name, ends, seen, beside, style)
        self.move(nodes)

    def move(self, nodes: np.ndarray) -> None:
        """nodes: (N, 3) m."""
        seen = self.project(nodes)
        size = np.array([self.figure.bbox.width, self.figure.bbox.height])
        for text, ends, place in self.shown:
            text.set_position(self._middle(seen[ends], place) / size)

    def _middle(self, ends: np.ndarray, place: _Place) -> np.ndarray:
        return (1.0 - place.share) * ends[0] + place.share * ends[-1] + self.point * place.offset

    def _sample(self, model: Model, seen: np.ndarray) -> None:
        """Points that stand for what is drawn, (n, 2) pixels, and what covering one of them costs."""
        points, costs = [seen], [np.full(len(seen), COVERED)]
        for members, cost in ((model.bars, COVERED), (segments(model.paths).ends, CROSSED)):
            for one, other in seen[members]:
                count = 2 + int(np.hypot(*(other - one)) / (3.0 * self.point))
                points.append(np.linspace(one, other, count))
                costs.append(np.full(count, cost))
        self._drawn, self._costs = np.concatenate(points), np.concatenate(costs)
        self._centre = 0.5 * (seen.min(axis=0) + seen.max(axis=0))

    def _write(self, name: str, ends: np.ndarray, seen: np.ndarray, beside: float, style: dict[str, Any]) -> None:
        """At the best place that touches no other name and no edge; nowhere, if there is none.  beside: how much farther away
        than others, points."""
        halo = [Stroke(linewidth=2.4, foreground="white"), Normal()]
        text = self.figure.text(0.0, 0.0, name, ha="center", va="center", path_effects=halo, **style)
        extent = text.get_window_extent(self.figure.canvas.get_renderer())
        half = 0.5 * np.array([extent.width, extent.height]) + self.point
        best, least = None, np.inf
        for order, place in enumerate(self._places(seen[ends], half / self.point, self.near + beside)):
            if least <= LATER * order:  # no later place can be better
                break
            middle = self._middle(seen[ends], place)
            loss = self._loss(middle, half) + LATER * order
            if loss < least:
                best, least, taken = place, loss, np.array([middle, half])
        if best is None:
            text.remove()
            return
        self._taken.append(taken)
        self.shown.append((text, ends, best))

    def _loss(self, middle: np.ndarray, half: np.ndarray) -> float:
        low, high = middle - half, middle + half
        if np.any(low < self.box.min) or np.any(high > self.box.max):
            return np.inf
        if any(np.all(np.abs(middle - other) < half + room) for other, room in self._taken):
            return np.inf
        inside = np.all((self._drawn > low) & (self._drawn < high), axis=1)
        return float(self._costs[inside].sum())

    def _places(self, ends: np.ndarray, half: np.ndarray, near: float) -> Iterator[_Place]:
        """half: (2,) half the name's width and height, near: how close it may come, points."""
        if len(ends) == 1:
            away = ends[0] - self._centre
            first = np.arctan2(away[1], away[0])
            for far, turn in product(FARTHER, np.radians(TURNS)):
                yield _Place(0.0, (near + far + half) * _unit(first + turn))
            return
        along = ends[1] - ends[0]
        across = np.arctan2(along[0], -along[1])
        for far, share, turn in product(FARTHER, SHARES, (0.0, np.pi)):
            way = _unit(across + turn)
            yield _Place(share, (near + far + np.abs(way) @ half) * way)


def _unit(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def _named(model: Model, members: bool) -> Iterator[tuple[str, np.ndarray, float, dict[str, Any]]]:
    """Name, its node or end nodes, what it keeps away from them beside the usual, points, and how it is written; the most
    important ones first."""
    count = len(model.nodes)
    crowded = max(count, len(model.strings)) > MOST
    for node in range(0, count, -(-count // FEW) if crowded else 1):
        yield model.node_names[node], np.array([node]), 0.0, {"fontsize": LETTERS, "fontweight": "bold", "color": INK}
    if crowded or not members:
        return
    for name, ends in zip(model.bar_names, model.bars):
        yield name, ends, 0.0, {"fontsize": LETTERS, "fontstyle": "italic", "color": INK}
    for name, ends, nsh in zip(model.string_names, model.strings, model.nsh):
        yield name, ends, BESIDE if nsh else 0.0, {"fontsize": LETTERS, "color": NSH_INK if nsh else STRING_INK}
