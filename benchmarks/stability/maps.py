"""Largest stable step of the fixed-step methods over damping and stiffness, against the linearised spectrum.

python -m benchmarks.stability.maps [--redraw]

A run of the kernel starts a hair away from a taut equilibrium; its step (max_step) is stable if the hair does not grow.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import product

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.harness import page as common
from benchmarks.harness.problems import built_in
from tensegrity_core.errors import SimulationError
from tensegrity_core.model import Model
from tensegrity_core.reference import instant, structure

from .methods import METHODS, boundary
from .spectrum import eigenvalues, kernel_at, node_tangent, retuned

SCENES = ("three_bar", "two_bar")
#: Methods of `METHODS` that are measured, as the kernel names them.
MEASURED = ("rk4", "ros2")
#: Ranges of the maps: damping, N s/m, at the scene's stiffness; stiffness, N/m, at the damping HELD; step, s.
RANGE = {"damping": (1.0, 1e5), "stiffness": (1e2, 1e7)}
STEPS = (1e-6, 1e-1)
HELD = 500.0
#: m: distance from the equilibrium at the start; 1e-7 m is the smallest stretch of a string on the maps.
HAIR = 1e-12
#: Growth of that distance at which a step counts as unstable; the steps given for it, and the time (s), whichever is longer.
GROWTH, RUN, SPAN = 1e3, 1500, 0.1
#: Steps between two looks at that distance.
CHUNK = 25
#: Factor between the ends of a bracket at which the search for the largest stable step ends.
RESOLUTION = 1.002


def at(model: Model, parameter: str, value: float) -> Model:
    """The model with one damping coefficient, or with one stiffness and the damping HELD."""
    if parameter == "damping":
        return retuned(model, damping=value)
    return retuned(model, damping=HELD, stiffness=value)


def disturbed(model: Model, seed: int = 1) -> Model:
    """The model started HAIR away from its equilibrium, in a random direction that keeps the bars' lengths."""
    tangent = node_tangent(model)
    direction = np.tensordot(np.random.default_rng(seed).normal(size=len(tangent)), tangent, 1)
    nodes = model.nodes + HAIR * direction / np.linalg.norm(direction)
    nodes = instant.on_constraints(structure.Structure(model), nodes.T, np.zeros((3, len(nodes))))[0].T
    return replace(model, nodes=nodes)


def steps_given(h: float) -> int:
    """How many steps of h (s) a run has before it counts as stable."""
    return max(RUN, math.ceil(SPAN / h))


def is_stable(model: Model, method: str, h: float, steps: int | None = None) -> bool:
    """Whether a disturbance of the model's equilibrium does not grow by GROWTH in that many steps of h (s)."""
    kernel = kernel_at(disturbed(model), method=method, max_step=h)
    rest = kernel_at(model)["position"].copy()
    try:
        for _ in range(math.ceil((steps or steps_given(h)) / CHUNK)):
            kernel.step(CHUNK * h)
            if not np.abs(kernel["position"] - rest).max() <= GROWTH * HAIR:
                return False
    except SimulationError:
        return False
    return True


def largest_stable_step(model: Model, method: str, limits=(1e-7, 1.0)) -> float:
    """s: by bisection between `limits`; inf if the upper one is stable, 0 if the lower one is not.

    Supposes one boundary: every step below it is stable, every step above it is not."""
    low, high = limits
    if is_stable(model, method, high):
        return math.inf
    if not is_stable(model, method, low):
        return 0.0
    while high / low > RESOLUTION:
        middle = math.sqrt(low * high)
        low, high = (middle, high) if is_stable(model, method, middle) else (low, middle)
    return math.sqrt(low * high)


# ----------------------------------------------------------------------------------------------------- what is measured


def theory(model: Model, parameter: str, count: int) -> dict:
    """The spectrum and the boundary of every method over the parameter's range."""
    values = np.geomspace(*RANGE[parameter], count)
    spectra = [eigenvalues(at(model, parameter, value)) for value in values]
    spectra = [s[np.lexsort((s.imag, s.real))] for s in spectra]
    steps = {name: [boundary(method.stability, s) for s in spectra] for name, method in METHODS.items()}
    return {"values": values, "real": [s.real for s in spectra], "imag": [s.imag for s in spectra], "steps": steps}


def measured(model: Model, parameter: str, method: str, columns: int, rows: int, points: int) -> dict:
    """A grid of stable and unstable steps, and the largest stable step at some values of the parameter."""
    values, steps = np.geomspace(*RANGE[parameter], columns), np.geomspace(*STEPS, rows)
    stable = [[is_stable(at(model, parameter, value), method, h) for h in steps] for value in values]
    found = []
    for value in np.geomspace(*RANGE[parameter], points):
        here = at(model, parameter, value)
        theory = boundary(METHODS[method].stability, eigenvalues(here))
        found.append({"value": value, "step": largest_stable_step(here, method), "theory": theory})
    return {"values": values, "steps": steps, "stable": stable, "largest": found}


def measure(columns: int = 16, rows: int = 21, points: int = 11, count: int = 81) -> dict:
    maps = []
    for scene, parameter in product(SCENES, RANGE):
        model = built_in(scene)
        held = HELD if parameter == "stiffness" else float(model.stiffness[0])
        runs = {name: measured(model, parameter, name, columns, rows, points) for name in MEASURED}
        found = {"theory": theory(model, parameter, count), "methods": runs, "held": held}
        maps.append({"scene": scene, "parameter": parameter, **found})
    return {"maps": maps, "run": RUN, "span": SPAN, "growth": GROWTH, "hair": HAIR}


# ------------------------------------------------------------------------------------------------------------- figures

SYMBOL = {"damping": ("d", "N s/m"), "stiffness": ("k", "N/m")}
STABLE, UNSTABLE, LINE, OTHER = common.COLOURS[2], common.COLOURS[1], common.COLOURS[0], common.COLOURS[3]


def draw(data: dict) -> Figure:
    figure = common.new_figure(12.5, 8.6)
    axes = figure.subplots(1 + len(MEASURED), len(data["maps"]), sharex="col", sharey="row", squeeze=False)
    for column, one in enumerate(data["maps"]):
        _draw_spectrum(axes[0, column], one)
        for ax, method in zip(axes[1:, column], MEASURED):
            _draw_map(ax, one, method)
        axes[-1, column].set_xlabel("{}, {}".format(*SYMBOL[one["parameter"]]))
    for ax in axes.flat:
        ax.minorticks_off()
    axes[0, 0].set_ylabel("1/s")
    for ax, method in zip(axes[1:, 0], MEASURED):
        ax.set_ylabel(f"step of {METHODS[method].label}, s")
    for ax in axes[1 + MEASURED.index("ros2")]:
        ax.text(0.5, 0.06, "theory: no edge", transform=ax.transAxes, ha="center", bbox={"fc": "white", "ec": "#e6e4de"})
    _legends(axes)
    return figure


def _draw_spectrum(ax, one: dict) -> None:
    values, real, imag = (common.numbers(one["theory"][key]) for key in ("values", "real", "imag"))
    ax.plot(values, np.sort(-real), lw=0.9, color=LINE)
    oscillating = np.sort(imag)[:, -(imag.shape[1] // 2) :]
    ax.plot(values, np.where(oscillating > 0.0, oscillating, np.nan), lw=0.9, color=OTHER)
    other, unit = SYMBOL["damping" if one["parameter"] == "stiffness" else "stiffness"]
    held = f"{other} = {one['held']:g} {unit}"
    ax.set(xscale="log", yscale="log", title=f"{one['scene']}, {held}")


def _draw_map(ax, one: dict, method: str) -> None:
    grid, lines = one["methods"][method], one["theory"]
    x, h = np.meshgrid(grid["values"], grid["steps"], indexing="ij")
    stable = np.array(grid["stable"], dtype=bool)
    ax.plot(x[stable], h[stable], ".", ms=3, color=STABLE)
    ax.plot(x[~stable], h[~stable], "x", ms=3, mew=0.8, color=UNSTABLE)
    largest = [(row["value"], row["step"]) for row in grid["largest"] if row["step"]]
    if largest:
        ax.plot(*zip(*largest), "o", ms=4.5, mfc="white", mec=LINE, mew=0.9)
    ax.plot(lines["values"], common.numbers(lines["steps"][method]), color=LINE)
    if not METHODS[method].implicit:
        ax.plot(lines["values"], common.numbers(lines["steps"]["euler"]), color=OTHER, ls="--")
    ax.set(xscale="log", yscale="log", ylim=(STEPS[0] / 1.3, STEPS[1] * 1.3))


def _legends(axes) -> None:
    spectrum = [Line2D([], [], color=c, label=t) for c, t in ((LINE, "−Re λ"), (OTHER, "Im λ"))]
    figure = axes[0, 0].figure
    figure.legend(handles=spectrum, loc="outside upper right", ncols=2)
    handles = [
        Line2D([], [], ls="", marker=".", color=STABLE, label="measured: stable"),
        Line2D([], [], ls="", marker="x", color=UNSTABLE, label="measured: unstable"),
        Line2D([], [], ls="", marker="o", mfc="white", mec=LINE, label="measured: largest stable step"),
        Line2D([], [], color=LINE, label="theory: max |R(hλ)| = 1"),
        Line2D([], [], color=OTHER, ls="--", label="theory: explicit Euler"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)


def decades(maps: list[dict]) -> list[dict]:
    """RK4's largest stable steps at the decades of each parameter."""
    rows = []
    for one in maps:
        symbol, unit = SYMBOL[one["parameter"]]
        for point in one["methods"]["rk4"]["largest"]:
            decade = math.log10(point["value"])
            if abs(decade - round(decade)) < 1e-6:
                rows.append({"scene": one["scene"], "place": f"{symbol} = 1e{round(decade)} {unit}", **point})
    return rows


def edges(maps: list[dict], method: str) -> int:
    """On how many of the spectra the theory gives a method a largest stable step."""
    return sum(int(np.isfinite(common.numbers(one["theory"]["steps"][method])).sum()) for one in maps)


def words(data: dict) -> dict:
    """What the page says of these data."""
    maps = data["maps"]
    stable = np.array([one["methods"]["ros2"]["stable"] for one in maps], dtype=bool)
    return {
        "off": 100.0 * common.worst((point for one in maps for point in one["methods"]["rk4"]["largest"]), "step"),
        "rk4": decades(maps),
        "total": stable.size,
        "unstable": int((~stable).sum()),
        "spectra": sum(len(one["theory"]["values"]) for one in maps),
        "bounded": max(edges(maps, "ros2"), edges(maps, "ros2_large")),
        "per_step": 100.0 * (data["growth"] ** (1.0 / data["run"]) - 1.0),
        "per_second": math.log(data["growth"]) / data["span"],
        "longest": STEPS[1],
        "held": HELD,
    }


STUDY = common.Study(__doc__, "maps", measure, draw, words)

if __name__ == "__main__":
    STUDY.main()
