"""Pictures of a structure.  Nothing opens a window.

Bars are thick and dark, strings thin, dashed where slack, along all nodes that they pass.  An NSH is a zigzag in its string, on
the longest segment, with one bead per beam that fills when the beam has snapped.  Triangles are nodes fixed to the ground;
arrows are external forces.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from mpl_toolkits.mplot3d import proj3d
from mpl_toolkits.mplot3d.art3d import Poly3DCollection

from ..model import Model, Result
from ..model.routes import longest_segment
from .names import Names

BAR, STRING, NSH, SUPPORT, LOAD, FLOOR = "#22252e", "#1b9aaa", "#d1495b", "#6b705c", "#edae49", "#f1f0ec"

#: View on a structure in space: elevation and azimuth, degrees.
ELEVATION, AZIMUTH = 16.0, -50.0
#: Free at the edges of a picture without names and with them, points: half of a mark, and a name.
ROOM, NAMED_ROOM = 9.0, 24.0
#: Bars of a structure that is drawn with lines of usual width.
USUAL = 12
BAR_WIDTH = 5.5  # points
#: How often a fit in space is made better, and how near the eye may come.
LOOKS, MOST_ZOOM = 8, 4.0


# Axes are Matplotlib's Axes or, of a structure in space, Axes3D: of `Any` type, as one has methods that the other has not.


def new_axes(figure: Figure, model: Model, place: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)) -> Any:
    """Axes for a structure, plane or in space, without frame and ticks.  place: left, bottom, width, height, 0 to 1."""
    axes: Any = figure.add_axes(place, projection=None if len(model.axes) == 2 else "3d")
    axes.set_axis_off()
    axes.patch.set_alpha(0.0)
    if len(model.axes) == 3:
        axes.view_init(elev=ELEVATION, azim=AZIMUTH)
        axes.computed_zorder = False  # it leaves lines out; Drawing orders them by depth
    return axes


def frame(axes: Any, model: Model, positions: np.ndarray, room: float = ROOM) -> None:
    """Fit the axes around positions (..., 3) m, with the same scale along all of them.

    room: what is left free at every edge for lines, marks and names, points.
    """
    points = np.asarray(positions, dtype=float).reshape(-1, 3)
    place = axes.get_position(original=True).transformed(axes.figure.transFigure)
    size = np.maximum([place.width, place.height], 1.0)
    inner = np.maximum(size - 2.0 * room * axes.figure.dpi / 72.0, 0.2 * size)
    if len(model.axes) == 2:
        _fit_plane(axes, points[:, list(model.axes)], size, inner)
    else:
        _fit_space(axes, points, 0.5 * (place.p0 + place.p1), inner)


def _fit_plane(axes: Any, points: np.ndarray, size: np.ndarray, inner: np.ndarray) -> None:
    """size: of the axes, inner: of the room for the points, pixels."""
    low, high = points.min(axis=0), points.max(axis=0)
    per_pixel = float(np.max((high - low) / inner)) or 1.0 / inner.min()
    middle, half = 0.5 * (low + high), 0.5 * per_pixel * size
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.set_aspect("equal", adjustable="datalim")


def _fit_space(axes: Any, points: np.ndarray, middle: np.ndarray, inner: np.ndarray) -> None:
    """middle: of the axes, inner: size of the room for the points, pixels.

    What is near looks larger, so what fits is found by looking: each look is scaled and moved by what it misses, which leaves a
    part in a hundred of the miss or less.
    """
    centre, zoom = 0.5 * (points.min(axis=0) + points.max(axis=0)), 1.0
    reach = 0.5 * float(np.max(np.ptp(points, axis=0))) or 1.0
    across, up = _across(axes), np.cross(_eye(axes), _across(axes))
    for _ in range(LOOKS):
        for limit, value in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), centre):
            limit(value - reach, value + reach)
        axes.set_box_aspect((1.0, 1.0, 1.0), zoom=zoom)
        axes.apply_aspect()
        seen = project(axes, np.vstack((points, centre, centre + reach * across)))
        per_metre = float(np.hypot(*(seen[-1] - seen[-2]))) / reach
        low, high = seen[:-2].min(axis=0), seen[:-2].max(axis=0)
        away = (0.5 * (low + high) - middle) / per_metre
        centre = centre + away[0] * across + away[1] * up
        zoom *= float(np.min(inner / np.maximum(high - low, 1e-9 * inner + 1e-300)))
        zoom = min(zoom, MOST_ZOOM)


def project(axes: Any, points: np.ndarray) -> np.ndarray:
    """Places (n, 3) m, or in a plane (n, 2) m, of axes that are framed, as (n, 2) pixels of the figure."""
    if not hasattr(axes, "get_proj"):
        return axes.transData.transform(points)
    across, up, _ = proj3d.proj_transform(*points.T, axes.get_proj())
    return axes.transData.transform(np.column_stack((across, up)))


def _eye(axes: Any) -> np.ndarray:
    """Unit vector towards the eye of axes in space."""
    up, around = np.radians(axes.elev), np.radians(axes.azim)
    return np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])


def _across(axes: Any) -> np.ndarray:
    """Unit vector to the right in the picture of axes in space."""
    around = np.radians(axes.azim)
    return np.array([-np.sin(around), np.cos(around), 0.0])


class Drawing:
    """A structure on axes; `move` draws it in another state."""

    def __init__(self, axes: Any, model: Model, width: float | None = None, alpha: float = 1.0, floor: bool = True):
        """Draws the model's start.

        width: factor of all line widths and marks, by default less than 1 for more than USUAL bars; alpha: how opaque lines
        and marks are; floor: there is one, where the structure stands on one.
        """
        width = min(1.0, float(np.sqrt(USUAL / max(len(model.bars), 1)))) if width is None else width
        self.axes, self.model, self.width, self._alpha = axes, model, width, alpha
        self._names: Names | None = None
        self.floor = np.empty((0, 3))
        self._size = float(np.max(np.ptp(model.nodes, axis=0)))
        if floor:
            self._draw_floor()
        halo = [Stroke(linewidth=8.0 * width, foreground="white"), Normal()]
        self._strings = [self._line(color=NSH if nsh else STRING, linewidth=(1.8 if nsh else 1.4) * width) for nsh in model.nsh]
        self._bars = [
            self._line(color=BAR, linewidth=BAR_WIDTH * width, solid_capstyle="round", path_effects=halo) for _ in model.bars
        ]
        bead = {"linestyle": "", "marker": "o", "markersize": 4.5 * width, "markeredgecolor": NSH}
        self._beads = [
            (self._line(**bead, markerfacecolor="white"), self._line(**bead, markerfacecolor=NSH)) for _ in model.nsh_strings
        ]
        self._masses = [self._line(linestyle="", marker="o", markersize=8.0 * width, color=BAR) for _ in model.lone_nodes]
        self._loads = [self._line(color=LOAD, linewidth=2.5 * width) for _ in model.nodes]
        for node in model.nodes[model.fixed]:
            support = self._line(linestyle="", marker="^", markersize=9.0 * width, color=SUPPORT)
            self._set(support, node, nearer=0.5)
        self.move(model.nodes)

    def move(self, nodes: np.ndarray, slack=None, snapped=None, force=None, metres_per_newton: float = 0.0) -> None:
        """Draw another state.

        nodes: (N, 3) m; slack: (S,) bool, by default strings that are no longer than the model's rest lengths; snapped:
        (H,) beams of each NSH past their force maximum; force: (N, 3) N, drawn as arrows of metres_per_newton.
        """
        model = self.model
        slack = (model.string_lengths(nodes) <= model.rest_length) & ~model.two_way if slack is None else slack
        snapped = np.zeros(len(model.nsh_strings), dtype=int) if snapped is None else snapped
        for line, ends in zip(self._bars, model.bars):
            self._set(line, nodes[ends])
        for line, node in zip(self._masses, model.lone_nodes):
            self._set(line, nodes[node], nearer=0.01)
        for line, path, loose in zip(self._strings, model.paths, slack):
            self._set(line, nodes[list(path)])
            line.set_linestyle((0, (3, 2)) if loose else "-")
        for s, (open_beads, full_beads), count in zip(model.nsh_strings, self._beads, snapped):
            points, beads = self._zigzag(s, nodes[list(model.paths[s])])
            self._set(self._strings[s], points)
            self._set(open_beads, beads[count:], nearer=0.01)
            self._set(full_beads, beads[:count], nearer=0.01)
        for line, node, push in zip(self._loads, nodes, np.zeros_like(nodes) if force is None else force):
            self._set(line, self._arrow(node, metres_per_newton * push))
        if self._names:
            self._names.move(self._flat(nodes))

    def name(self, nodes: np.ndarray, members: bool = True) -> None:
        """Write names beside nodes, strings and bars, once the axes are framed.

        nodes: (N, 3) m, where there must be room; members: not of nodes only.
        """
        seen = self._flat(nodes)
        self._names = Names(self.axes, self.model, lambda at: project(self.axes, at), seen, BAR_WIDTH * self.width, members)

    def _flat(self, nodes: np.ndarray) -> np.ndarray:
        """(N, 3) m; in a plane (N, 2), as its axes take them."""
        return nodes if len(self.model.axes) == 3 else nodes[:, list(self.model.axes)]

    def _draw_floor(self) -> None:
        """A floor under the structure, where its fixed nodes lie at one height and nothing is below.  It sets `floor`, places
        (n, 3) m at its edge."""
        model = self.model
        height = model.nodes[model.fixed, 2]
        if 2 not in model.axes or not height.size or np.ptp(height) > 0.0 or height[0] > np.min(model.nodes[:, 2]):
            return
        if len(model.axes) == 2:
            across = model.axes[0]
            low, high = np.min(model.nodes[:, across]), np.max(model.nodes[:, across])
            beyond = 0.1 * (high - low) or 0.3 * self._size
            self.floor = np.zeros((2, 3))
            self.floor[:, 2], self.floor[:, across] = height[0], (low - beyond, high + beyond)
            self.axes.plot(*self.floor[:, list(model.axes)].T, color=FLOOR, linewidth=4.0, zorder=0)
            return
        points = model.nodes[:, :2]
        centre = 0.5 * (np.min(points, axis=0) + np.max(points, axis=0))
        radius = 1.1 * float(np.max(np.linalg.norm(points - centre, axis=1)))
        turn = np.linspace(0.0, 2.0 * np.pi, 73)[:-1, None]
        disc = centre + radius * np.hstack((np.cos(turn), np.sin(turn)))
        self.floor = np.column_stack((disc, np.full(len(disc), height[0])))
        self.axes.add_collection3d(Poly3DCollection([self.floor], color=FLOOR, zorder=0, clip_on=False))

    def _line(self, **style):
        return self.axes.plot(*([[]] * len(self.model.axes)), alpha=self._alpha, clip_on=False, **style)[0]

    def _set(self, line, points: np.ndarray, nearer: float = 0.0) -> None:
        points = np.asarray(points, dtype=float).reshape(-1, 3)
        if len(self.model.axes) == 2:
            line.set_data(*points[:, list(self.model.axes)].T)
            return
        line.set_data_3d(*points.T)
        if len(points):  # what is nearer to the eye covers what is farther away
            line.set_zorder(100.0 + nearer + float(np.mean(points, axis=0) @ self._eye()) / self._size)

    def _eye(self) -> np.ndarray:
        """Unit vector towards the eye."""
        if len(self.model.axes) == 2:
            return np.array([float(axis not in self.model.axes) for axis in range(3)])
        return _eye(self.axes)

    def _sideways(self, direction: np.ndarray) -> np.ndarray:
        """Unit vector across `direction`, in the plane of the picture."""
        across = np.cross(direction, self._eye())
        size = np.linalg.norm(across)
        return across / size if size > 1e-12 else np.zeros(3)

    def _zigzag(self, s: int, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points of an NSH string that passes nodes at these points (k, 3), m, and of its beads.  The zigzag takes up all
        of the elongation since the start."""
        model, beams = self.model, len(self.model.honeycombs[s].Q)
        segment, start = longest_segment(model, s)
        ends = points[segment : segment + 2]
        length = float(np.linalg.norm(ends[1] - ends[0]))
        if length == 0.0:
            return points, np.repeat(ends[:1], beams, axis=0)
        along = (ends[1] - ends[0]) / length
        longer = length - start if len(points) == 2 else self._longer(points, model.nodes[list(model.paths[s])])
        span = max(0.25 * start, 0.14 * self._size) + longer
        span = float(np.clip(span, 0.1 * length, 0.9 * length))
        teeth = 2 * beams
        places = 0.5 * (length - span) + span * np.arange(teeth + 1) / teeth
        height = 0.016 * self._size * np.where(np.arange(teeth + 1) % 2, 1.0, -1.0)
        height[[0, -1]] = 0.0
        bends = ends[0] + np.outer(places, along) + np.outer(height, self._sideways(along))
        return np.vstack((points[: segment + 1], bends, points[segment + 1 :])), bends[1::2]

    @staticmethod
    def _longer(points: np.ndarray, before: np.ndarray) -> float:
        """m by which a way over points (k, 3) is longer than one over the points before."""
        now, then = (np.linalg.norm(np.diff(way, axis=0), axis=1).sum() for way in (points, before))
        return float(now - then)

    def _arrow(self, node: np.ndarray, push: np.ndarray) -> np.ndarray:
        size = float(np.linalg.norm(push))
        if size < 1e-3 * self._size:
            return np.empty((0, 3))
        head = min(0.3 * size, 0.045 * self._size)
        tip, back, aside = node + push, push / size * head, self._sideways(push) * 0.6 * head
        return np.array([node, tip, tip - back + aside, tip, tip - back - aside])


def draw(axes: Any, model: Model, nodes: np.ndarray | None = None, names: bool = False) -> Drawing:
    """Draw a model at its start or at given nodes (N, 3) m, and fit the axes around it.  names: write them, where there is
    room."""
    drawing = Drawing(axes, model)
    nodes = model.nodes if nodes is None else nodes
    drawing.move(nodes)
    frame(axes, model, np.vstack((nodes, drawing.floor)), NAMED_ROOM if names else ROOM)
    if names:
        drawing.name(nodes)
    return drawing


def slack_strings(result: Result, model: Model) -> np.ndarray:
    """(K+1, S) bool: a string without elastic tension is slack, unless it also pushes."""
    return (result.elastic_force <= 0.0) & ~model.two_way


def arrow_scale(model: Model, force: np.ndarray) -> float:
    """Length of an arrow per force, m/N: the largest force gets a quarter of the structure's size."""
    largest = float(np.max(np.linalg.norm(force, axis=-1), initial=0.0))
    return 0.25 * float(np.max(np.ptp(model.nodes, axis=0))) / largest if largest else 0.0
