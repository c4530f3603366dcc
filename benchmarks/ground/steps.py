"""Fixed steps through contact: errors over the ground's stiffness and the step, and the order that is left; see run.py."""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from benchmarks.harness.page import COLOURS, MARKS, new_figure, numbers
from tensegrity_core import api
from tensegrity_core.errors import SimulationError
from tensegrity_core.model import Model
from tensegrity_core.scene import parse_scene
from tensegrity_core.statics import build_model

from .octahedron import table

METHODS = ("rk4", "ros2")
CABLES = {"stiffness": 5000.0, "damping": 50.0, "tension": 60.0, "mass": 1.0}
HEIGHT, DURATION, ROW = 0.3, 1.0, 0.05  # m, s
EXACT = ("radau9", 1e-12)
STIFFNESSES = tuple(10.0**k for k in range(3, 8))  # N/m
STEPS = tuple(10.0 ** (-k / 2.0) for k in range(4, 11))  # s
ORDERED, HALVED = 1e4, tuple(1e-3 / 2**k for k in range(6))  # N/m, s
FRICTIONS = (0.0, 0.5)
#: The nodes lift off for the first time after so many rows.
ON_GROUND = 6
#: Step times frequency up to which rk4 is stable.
LIMIT = 2.0 * np.sqrt(2.0)


def dropped(stiffness: float, friction: float) -> Model:
    """An octahedron with plain cables, HEIGHT over a ground of this stiffness, N/m."""
    return build_model(parse_scene(table(HEIGHT, {"stiffness": stiffness, "damping": 0.2, "friction": friction}, **CABLES)))


def positions(model: Model, method: str, **options: float) -> np.ndarray:
    return api.simulate(model, duration=DURATION, step=ROW, method=method, **options).result.position


def error(model: Model, exact: np.ndarray, method: str, step: float, rows: int | None = None) -> float | None:
    """The largest of a node, m, in the first rows; None: the kernel says that the step is too long."""
    try:
        return float(np.abs(positions(model, method, max_step=step) - exact)[:rows].max())
    except SimulationError:
        return None


def order(errors: list) -> float:
    """By the straight line through the logarithms."""
    return float(-np.polyfit(np.arange(len(HALVED)), np.log2(numbers(errors)), 1)[0])


def measure() -> dict:
    """Errors over stiffness and step, and, with and without friction, of steps that are halved."""
    models = {stiffness: dropped(stiffness, FRICTIONS[1]) for stiffness in STIFFNESSES}
    exact = {stiffness: positions(model, EXACT[0], tolerance=EXACT[1]) for stiffness, model in models.items()}
    maps = {m: [[error(models[k], exact[k], m, h) for h in STEPS] for k in STIFFNESSES] for m in METHODS}
    orders = []
    for friction in FRICTIONS:
        model = dropped(ORDERED, friction)
        reference = positions(model, EXACT[0], tolerance=EXACT[1])
        for method in METHODS:
            errors, early = ([error(model, reference, method, step, rows) for step in HALVED] for rows in (None, ON_GROUND + 1))
            row = {"method": method, "friction": friction, "errors": errors}
            orders.append(row | {"order": order(errors), "before": order(early)})
    return {"maps": maps, "orders": orders}


def frequency(stiffness: np.ndarray) -> np.ndarray:
    """1/s of a bar's end on the ground, the bar across the normal: its inertia there is a quarter of its mass."""
    return np.sqrt(4.0 * stiffness / CABLES["mass"])


def draw(data: dict) -> Figure:
    figure = new_figure(7.4, 3.2)
    *maps, lines = figure.subplots(1, 3)
    for ax, (method, rows) in zip(maps, data["steps"]["maps"].items()):
        shown = np.ma.masked_invalid(numbers(rows))
        shades = ax.pcolormesh(STEPS, STIFFNESSES, shown, norm=LogNorm(1e-9, 1e-1), cmap="viridis_r", shading="nearest")
        lost = np.argwhere(shown.mask)
        if len(lost):
            ax.plot(np.array(STEPS)[lost[:, 1]], np.array(STIFFNESSES)[lost[:, 0]], "x", color=COLOURS[1])
        k = np.geomspace(STIFFNESSES[0], STIFFNESSES[-1], 20)
        ax.plot(LIMIT / frequency(k), k, color=COLOURS[0], linestyle="--")
        ax.set(xscale="log", yscale="log", xlabel="step, s", title=f"{'ab'[METHODS.index(method)]}  {method}")
        ax.set(xlim=(STEPS[-1] / 1.8, STEPS[0] * 1.8))
        ax.grid(visible=False)
    maps[0].set_ylabel("stiffness of the ground, N/m")
    figure.colorbar(shades, ax=maps, label="error, m", shrink=0.9)
    for row, colour, mark in zip(data["steps"]["orders"], COLOURS[1:], MARKS):
        name = f"{row['method']}, μ = {row['friction']:g}"
        lines.plot(HALVED, numbers(row["errors"]), color=colour, marker=mark, label=name)
    lines.set(xscale="log", yscale="log", xlabel="step, s", ylabel="error, m", title="c  order")
    lines.legend()
    return figure
