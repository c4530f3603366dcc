"""Pictures of equilibrium paths: load over a coordinate.

Stable states are solid, unstable ones dashed; the line of a growing load is wide and blue, that of a falling one thin and
red.  Dots are limit points, diamonds branch points, squares kinks and loose ends; dotted arrows show where the structure moves
on by itself.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ..equilibria.loading import Loading
from ..equilibria.paths import Path
from ..equilibria.steady_states import Jump, Sweep
from .path_table import Quantity
from .plots import new_figure

UP, DOWN, BEHIND = "#1f5fa8", "#d1495b", "#6b705c"
WIDTHS = {UP: 3.0, DOWN: 1.2}  # so that both are seen where they are one, without colour, too
FINE = 12  # parts into which a path's step is drawn


def curve(path: Path, quantity: Quantity, fine: int = FINE) -> tuple[np.ndarray, np.ndarray]:
    """Parameter and coordinate (m) along a path: cubics through its points with its tangents, `fine` parts for each step."""
    here = np.array([(p.parameter, quantity.of(path, p)) for p in path.points])
    if len(here) == 1:
        return here[:, 0], here[:, 1]
    slope = np.array([(p.direction[-1] / path.scale, quantity.rate(path, p)) for p in path.points])
    part, pieces = np.arange(fine)[:, None] / fine, []
    for i, (start, end) in enumerate(zip(path.points, path.points[1:])):
        length, chord = end.arc - start.arc, here[i + 1] - here[i]
        first = length * slope[i]
        # the tangent at a kink is that of the way on: a parabola leads there
        last = 2.0 * chord - first if end.kind in ("kink", "loose") else length * slope[i + 1]
        bend = (1.0 - part) * (first - chord) + part * (chord - last)
        pieces.append(here[i] + part * chord + part * (1.0 - part) * bend)
    points = np.vstack([*pieces, here[-1:]])
    return points[:, 0], points[:, 1]


def draw_sweep(axes: Axes, sweep: Sweep, quantity: Quantity, colour: str, label: str) -> None:
    """The stable paths of a slow load, and its jumps.  colour: UP or DOWN."""
    for i, path in enumerate(sweep.paths):
        parameter, value = curve(path, quantity)
        axes.plot(value, parameter, "-", color=colour, linewidth=WIDTHS[colour], label=label if i == 0 else None)
    for jump in sweep.jumps:
        _draw_jump(axes, sweep, jump, quantity, colour)


def _draw_jump(axes: Axes, sweep: Sweep, jump: Jump, quantity: Quantity, colour: str) -> None:
    path = sweep.paths[0]
    start, end = (quantity.of(path, point) for point in (jump.before, jump.after))
    style = {"arrowstyle": "->", "color": colour, "linewidth": 0.8, "linestyle": ":", "shrinkA": 0.0, "shrinkB": 0.0}
    axes.annotate("", (end, jump.after.parameter), (start, jump.parameter), arrowprops=style)
    marker = "o" if jump.kind == "limit" else "D" if jump.kind == "branch" else "s"
    axes.plot([start], [jump.parameter], marker, color=colour, markersize=4.0)


def draw_behind(axes: Axes, paths: list[Path], quantity: Quantity) -> None:
    """What lies behind limit and branch points: dashed where unstable, a thin line where stable."""
    named = set()
    for path in paths:
        for stable, part in by_stability(path):
            parameter, value = curve(part, quantity)
            name = "other stable states" if stable else "unstable states"
            label = None if name in named else name
            axes.plot(value, parameter, "-" if stable else "--", color=BEHIND, linewidth=0.9, label=label, zorder=1.5)
            named.add(name)


def by_stability(path: Path) -> list[tuple[bool, Path]]:
    """The path in parts that are stable or unstable throughout.  At a kink a point's stability is that of the way on."""
    points = path.points
    steps = [a.stable and (b.stable or b.kind == "kink") for a, b in pairwise(points)]
    ends = [i for i in range(1, len(steps)) if steps[i] != steps[i - 1]]
    spans = zip([0, *ends], [*ends, len(steps)])
    return [(steps[i], Path(path.equations, path.scale, points[i : j + 1])) for i, j in spans if j > i]


def path_figure(name: str, sweeps: dict[str, Sweep], behind: list[Path], quantity: Quantity, load: str) -> Figure:
    """One picture of a structure's steady states.

    sweeps: label -> sweep, a growing load first; behind: see steady_states.detours; load: what the parameter is.
    """
    figure = new_figure(720, 580)
    figure.set_layout_engine("constrained")
    axes = figure.add_subplot()
    for (label, sweep), colour in zip(sweeps.items(), (UP, DOWN)):
        draw_sweep(axes, sweep, quantity, colour, label)
    draw_behind(axes, behind, quantity)
    axes.set(xlabel=f"{quantity.name} in m", ylabel=load, title=name)
    axes.grid(color="0.9")
    figure.legend(frameon=False, ncols=2, loc="outside lower center")
    return figure


def way(name: str, sweep: Sweep) -> str:
    """The label of a leg, "there" or "back"."""
    first, last = sweep.parameters[[0, -1]]
    return f"p from {first:g} to {last:g}" if name == "there" else f"back to {last:g}"


def load_label(loading: Loading) -> str:
    return "p" if loading.rest_length_direction.any() else "p, load factor"
