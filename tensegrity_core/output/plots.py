"""Pictures of a structure, of its motion, and of a result's series.  Nothing opens a window.

Bars are thick and dark, strings thin, dashed where slack.  An NSH is a zigzag in its string, with one bead per beam
that fills when the beam has snapped.  Triangles are nodes fixed to the ground; arrows are external forces.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

from ..errors import InputError
from ..files import replacing
from ..model import Model, Result
from .export import require_writable

BAR, STRING, NSH, SUPPORT, LOAD, FLOOR = "#22252e", "#1b9aaa", "#d1495b", "#6b705c", "#edae49", "#f1f0ec"

#: View on a structure in space: elevation and azimuth, degrees.
ELEVATION, AZIMUTH = 16.0, -50.0


# Axes are Matplotlib's Axes or, of a structure in space, Axes3D: of `Any` type, as one has methods that the other has not.


def new_figure(width: float, height: float, dpi: float = 100.0) -> Figure:
    """A figure with its own canvas; width, height: pixels."""
    figure = Figure(figsize=(width / dpi, height / dpi), dpi=dpi)
    FigureCanvasAgg(figure)
    return figure


def new_axes(figure: Figure, model: Model, place: tuple[float, float, float, float] = (0.0, 0.0, 1.0, 1.0)) -> Any:
    """Axes for a structure, plane or in space, without frame and ticks.  place: left, bottom, width, height, 0 to 1."""
    axes: Any = figure.add_axes(place, projection=None if len(model.axes) == 2 else "3d")
    axes.set_axis_off()
    axes.patch.set_alpha(0.0)
    if len(model.axes) == 3:
        axes.view_init(elev=ELEVATION, azim=AZIMUTH)
        axes.computed_zorder = False  # it leaves lines out; Drawing orders them by depth
    return axes


def frame(axes: Any, model: Model, positions: np.ndarray, margin: float = 0.06, zoom: float = 1.4) -> None:
    """Fit the axes around positions (..., 3) m, with the same scale along all of them.

    margin: share of the structure's size left free all around; zoom: of axes in space, which leave much room.
    """
    points = np.asarray(positions)[..., list(model.axes)].reshape(-1, len(model.axes))
    low, high = points.min(axis=0), points.max(axis=0)
    room = margin * float(np.max(high - low)) + 1e-9
    low, high = low - room, high + room
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    if len(model.axes) == 2:
        axes.set_aspect("equal")
        return
    axes.set_zlim(low[2], high[2])
    axes.set_box_aspect(high - low, zoom=zoom)


class Drawing:
    """A structure on axes; `move` draws it in another state."""

    def __init__(self, axes: Any, model: Model, width: float = 1.0):
        """Draws the model's start.  width: factor of all line widths and markers."""
        self.axes, self.model = axes, model
        self._size = float(np.max(np.ptp(model.nodes, axis=0)))
        self._draw_floor()
        halo = [Stroke(linewidth=8.0 * width, foreground="white"), Normal()]
        self._strings = [self._line(color=NSH if nsh else STRING, linewidth=(1.8 if nsh else 1.4) * width) for nsh in model.nsh]
        self._bars = [
            self._line(color=BAR, linewidth=5.5 * width, solid_capstyle="round", path_effects=halo) for _ in model.bars
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
        length = np.linalg.norm(nodes[model.strings[:, 1]] - nodes[model.strings[:, 0]], axis=1)
        slack = length <= model.rest_length if slack is None else slack
        snapped = np.zeros(len(model.nsh_strings), dtype=int) if snapped is None else snapped
        for line, ends in zip(self._bars, model.bars):
            self._set(line, nodes[ends])
        for line, node in zip(self._masses, model.lone_nodes):
            self._set(line, nodes[node], nearer=0.01)
        for line, ends, loose in zip(self._strings, model.strings, slack):
            self._set(line, nodes[ends])
            line.set_linestyle((0, (3, 2)) if loose else "-")
        for s, (open_beads, full_beads), count in zip(model.nsh_strings, self._beads, snapped):
            path, beads = self._zigzag(s, nodes[model.strings[s]])
            self._set(self._strings[s], path)
            self._set(open_beads, beads[count:], nearer=0.01)
            self._set(full_beads, beads[:count], nearer=0.01)
        for line, node, push in zip(self._loads, nodes, np.zeros_like(nodes) if force is None else force):
            self._set(line, self._arrow(node, metres_per_newton * push))

    def _draw_floor(self) -> None:
        """A floor under the structure, where its fixed nodes lie at one height and nothing is below."""
        model = self.model
        height = model.nodes[model.fixed, 2]
        if 2 not in model.axes or not height.size or np.ptp(height) > 0.0 or height[0] > np.min(model.nodes[:, 2]):
            return
        if len(model.axes) == 2:
            self.axes.axhline(height[0], color=FLOOR, linewidth=4.0, zorder=0)
            return
        points = model.nodes[:, :2]
        centre = 0.5 * (np.min(points, axis=0) + np.max(points, axis=0))
        radius = 1.1 * float(np.max(np.linalg.norm(points - centre, axis=1)))
        turn = np.linspace(0.0, 2.0 * np.pi, 73)[:-1, None]
        disc = centre + radius * np.hstack((np.cos(turn), np.sin(turn)))
        corners = np.column_stack((disc, np.full(len(disc), height[0])))
        self.axes.add_collection3d(Poly3DCollection([corners], color=FLOOR, zorder=0, clip_on=False))

    def _line(self, **style):
        return self.axes.plot(*([[]] * len(self.model.axes)), **style)[0]

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
        up, around = np.radians(self.axes.elev), np.radians(self.axes.azim)
        return np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])

    def _sideways(self, direction: np.ndarray) -> np.ndarray:
        """Unit vector across `direction`, in the plane of the picture."""
        across = np.cross(direction, self._eye())
        size = np.linalg.norm(across)
        return across / size if size > 1e-12 else np.zeros(3)

    def _zigzag(self, s: int, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points of an NSH string, and of its beads.  The zigzag takes up all of the elongation since the start."""
        model, beams = self.model, len(self.model.honeycombs[s].Q)
        start = float(np.linalg.norm(np.diff(model.nodes[model.strings[s]], axis=0)))
        length = float(np.linalg.norm(ends[1] - ends[0]))
        if length == 0.0:
            return ends, np.repeat(ends[:1], beams, axis=0)
        along = (ends[1] - ends[0]) / length
        span = max(0.25 * start, 0.14 * self._size) + length - start
        span = float(np.clip(span, 0.1 * length, 0.9 * length))
        teeth = 2 * beams
        places = 0.5 * (length - span) + span * np.arange(teeth + 1) / teeth
        height = 0.016 * self._size * np.where(np.arange(teeth + 1) % 2, 1.0, -1.0)
        height[[0, -1]] = 0.0
        bends = ends[0] + np.outer(places, along) + np.outer(height, self._sideways(along))
        return np.vstack((ends[:1], bends, ends[1:])), bends[1::2]

    def _arrow(self, node: np.ndarray, push: np.ndarray) -> np.ndarray:
        size = float(np.linalg.norm(push))
        if size < 1e-3 * self._size:
            return np.empty((0, 3))
        head = min(0.3 * size, 0.045 * self._size)
        tip, back, aside = node + push, push / size * head, self._sideways(push) * 0.6 * head
        return np.array([node, tip, tip - back + aside, tip, tip - back - aside])


def draw(axes: Any, model: Model, nodes: np.ndarray | None = None, width: float = 1.0) -> Drawing:
    """Draw a model at its start or at given nodes (N, 3) m, and fit the axes around it."""
    drawing = Drawing(axes, model, width)
    if nodes is not None:
        drawing.move(nodes)
    frame(axes, model, model.nodes if nodes is None else nodes)
    return drawing


def slack_strings(result: Result) -> np.ndarray:
    """(K+1, S) bool: a string without elastic tension is slack."""
    return result.elastic_force <= 0.0


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


def write_frames(figure: Figure, path: Path, count: int, show, frames_per_second: int) -> None:
    """Write a looping GIF of `count` frames; show(i) draws frame i on the figure.

    The file appears whole or not at all.  All frames share one palette, so that Pillow stores only what changes from
    frame to frame; Matplotlib's PillowWriter gives each frame a palette of its own, which makes larger files.
    """
    pictures = []
    for i in range(count):
        show(i)
        canvas: Any = figure.canvas  # of Agg, see new_figure
        canvas.draw()
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    palette = _palette(pictures)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    with replacing(path) as file:
        frames[0].save(file, "GIF", save_all=True, append_images=frames[1:], duration=round(1000 / frames_per_second), loop=0)


def _palette(pictures: list[Image.Image], samples: int = 8, colours: int = 64) -> Image.Image:
    """A palette for a series of pictures, from some of them side by side."""
    chosen = pictures[:: max(1, len(pictures) // samples)]
    sheet = Image.new("RGB", (chosen[0].width, chosen[0].height * len(chosen)))
    for i, picture in enumerate(chosen):
        sheet.paste(picture, (0, i * picture.height))
    palette = sheet.quantize(colours)
    entries = np.array(palette.getpalette()).reshape(-1, 3)
    entries[entries.min(axis=1) > 244] = 255  # Pillow takes any of them for white
    palette.putpalette(entries.ravel().tolist())
    return palette


def animate(model: Model, result: Result, path: Path, frames_per_second: int = 20, force=None, pixels: int = 480) -> None:
    """Write the motion of a result as a GIF, one frame per communication point.

    force: (K+1, N, 3) N, drawn as arrows; None: none.  Raises InputError where `path` does not end in .gif.
    """
    path = Path(path)
    if path.suffix.lower() != ".gif":
        raise InputError(f"output = {str(path)!r} does not end in .gif; name a GIF file")
    figure = new_figure(pixels, pixels)
    axes = new_axes(figure, model)
    drawing, slack = Drawing(axes, model), slack_strings(result)
    scale = 0.0 if force is None else arrow_scale(model, force)
    tips = result.position if force is None else result.position + scale * force
    frame(axes, model, np.concatenate((result.position, tips)))
    clock = figure.text(0.03, 0.03, "", family="monospace")

    def show(k):
        push = None if force is None else force[k]
        drawing.move(result.position[k], slack[k], result.snapped[k], push, scale)
        clock.set_text(f"{model.name}  t = {result.times[k]:.2f} s")

    write_frames(figure, path, len(result.times), show, frames_per_second)


def arrow_scale(model: Model, force: np.ndarray) -> float:
    """Length of an arrow per force, m/N: the largest force gets a quarter of the structure's size."""
    largest = float(np.max(np.linalg.norm(force, axis=-1), initial=0.0))
    return 0.25 * float(np.max(np.ptp(model.nodes, axis=0))) / largest if largest else 0.0


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
