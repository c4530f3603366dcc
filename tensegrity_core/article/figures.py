"""Figures of the article's experiments, in the article's form: 3, 5 and 6 to 10.  Solid: with NSH; dashed: without.

Each is drawn from the `columns` of an experiment's data, so that it can be drawn from its CSV file, too.
"""

from __future__ import annotations

import fnmatch
import io
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure

from ..files import replacing, write_text
from ..output.plots import few_colours
from .experiments import BEAM, beam_curve, honeycomb_marks

DPI = 100
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "tensegrity",
    "font.size": 8.5,
    "axes.titlesize": 9.0,
    "axes.grid": True,
    "grid.color": "#e6e4de",
    "grid.linewidth": 0.6,
    "axes.axisbelow": True,
    "legend.fontsize": 7.5,
    "lines.linewidth": 1.2,
    "axes.titlelocation": "left",
}
TITLES = {"two_bar": "two-bar", "three_bar": "three-bar", "six_bar": "six-bar"}
AXIS_LINES: dict[str, dict[str, Any]] = {
    "x": {"color": "#22252e", "linestyle": "-"},
    "y": {"color": "#1b9aaa", "linestyle": (0, (5.0, 1.5))},
    "z": {"color": "#d1495b", "linestyle": (0, (1.5, 1.0))},
}
NSH_LINE: dict[str, Any] = {"color": "#22252e", "linestyle": "-"}
PLAIN_LINE: dict[str, Any] = {"color": "#22252e", "linestyle": "--"}
LINES = {True: NSH_LINE, False: PLAIN_LINE}
LABELS = {True: "with NSH", False: "without NSH"}


#: Name -> series.
Columns = Mapping[str, np.ndarray]


def _with_nsh(name: str) -> bool:
    return name.endswith("nsh")


def _systems(columns: Columns) -> list[str]:
    return list(dict.fromkeys(name.partition(".")[0].removesuffix("_nsh") for name in columns if "." in name))


def _figure(width: float, height: float) -> Figure:
    return Figure(figsize=(width, height), layout="constrained")


def figure_3(columns: Columns) -> Figure:
    """Force of a single beam, its extrema, and regions I to III."""
    marks = beam_curve().marks
    figure = _curve(columns, marks, "f in N", "u in cm")
    (axes,) = figure.axes
    low, high = (100.0 * marks[name][0] for name in ("f_max", "f_min"))
    for where, name in ((0.5 * low, "I"), (0.5 * (low + high), "II"), (0.5 * (high + 200.0 * BEAM.h[0]), "III")):
        axes.text(where, 0.05, name, transform=axes.get_xaxis_transform(), ha="center")
    for x in (low, high):
        axes.axvline(x, color="#6b705c", linewidth=0.8, linestyle=":")
    axes.set_title(f"a beam: Q = {BEAM.Q[0]:g} N, \u03b6 = {BEAM.zeta[0]:g}, h = {100.0 * BEAM.h[0]:g} cm")
    return figure


def figure_5(columns: Columns) -> Figure:
    """Force of the honeycomb."""
    figure = _curve(columns, honeycomb_marks(), "f in N", "\u03be in cm")
    figure.axes[0].set_title("the honeycomb: four beams in series")
    return figure


def _curve(columns: Columns, marks: dict[str, tuple[float, float]], force: str, elongation: str) -> Figure:
    figure = _figure(5.2, 3.4)
    axes = figure.subplots()
    axes.plot(100.0 * columns["elongation"], columns["force"], **NSH_LINE)
    last = max(x for x, _ in marks.values())
    for name, (x, f) in marks.items():
        axes.plot(100.0 * x, f, "o", color="#d1495b", markersize=4)
        place: dict[str, Any] = {"xytext": (0, -12 if name == "f_min" else 6), "ha": "right" if x == last else "center"}
        axes.annotate(f"{name} {f:.2f} N", (100.0 * x, f), textcoords="offset points", fontsize=7.5, **place)
    axes.set(xlabel=elongation, ylabel=force, ylim=(0.0, 1.12 * columns["force"].max()))
    return figure


def figure_6(columns: Columns) -> Figure:
    """Height of the top nodes against the lift; a panel per system."""
    systems = _systems(columns)
    figure = _figure(3.1 * len(systems), 3.0)
    for axes, name in zip(np.atleast_1d(figure.subplots(1, len(systems))), systems):
        for scene in (name + "_nsh", name):
            nsh = _with_nsh(scene)
            for i, node in enumerate(fnmatch.filter(columns, f"{scene}.n*.z")):
                label = "_" if i else LABELS[nsh]
                axes.plot(columns["force"], columns[node], **LINES[nsh], marker=".", markersize=3, label=label)
        axes.set(title=TITLES[name], xlabel="f_ext on each top node in N", ylabel="z of the top nodes in m")
    figure.legend(*axes.get_legend_handles_labels(), ncols=2, loc="outside upper right")
    return figure


def figure_7(columns: Columns) -> Figure:
    """Displacement of n5: left with NSH, right without; a row per damping."""
    dampings = list(dict.fromkeys(name.split(".")[1] for name in fnmatch.filter(columns, "three_bar.d*")))
    figure = _figure(8.2, 2.2 * len(dampings))
    panels = figure.subplots(len(dampings), 2, sharex=True, sharey="row", squeeze=False)
    for row, damping in zip(panels, dampings):
        for axes, kind in zip(row, ("_nsh", "")):
            for name in fnmatch.filter(columns, f"three_bar{kind}.{damping}.n*.d[xyz]"):
                axes.plot(columns["time"], columns[name], **AXIS_LINES[name[-1]], label=f"\u0394{name[-1]}")
            axes.set_title(f"{LABELS[bool(kind)]}, d = {damping[1:]} N s/m")
            axes.margins(x=0.0)
        row[0].set_ylabel(f"displacement of {name.split('.')[2]} in m")
    for axes in panels[-1]:
        axes.set_xlabel("t in s")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), ncols=3, loc="outside upper right")
    return figure


def figure_8(columns: Columns, damping: float = 500.0) -> Figure:
    """Elastic force of n1-n4 at one damping."""
    figure = _figure(6.4, 3.0)
    axes = figure.subplots()
    for kind in ("_nsh", ""):
        force = columns[f"three_bar{kind}.d{damping:g}.s1.elastic_force"]
        axes.plot(columns["time"], force, **LINES[bool(kind)], label=LABELS[bool(kind)])
    axes.set(xlabel="t in s", ylabel="elastic force of n1-n4 in N", title=f"d = {damping:g} N s/m")
    axes.margins(x=0.0)
    figure.legend(*axes.get_legend_handles_labels(), ncols=2, loc="outside upper right")
    return figure


def figure_9(columns: Columns) -> Figure:
    """Displacement of each system's last node; a row per system, a column per axis."""
    systems = _systems(columns)
    figure = _figure(9.2, 2.1 * len(systems))
    panels = figure.subplots(len(systems), 3, sharex=True, squeeze=False)
    for row, name in zip(panels, systems):
        for axes in row:
            axes.set_visible(False)
        for scene in (name + "_nsh", name):
            for column in fnmatch.filter(columns, f"{scene}.n*.d[xyz]"):
                _, node, change = column.split(".")
                axis = change[1:]
                axes, nsh = row["xyz".index(axis)], _with_nsh(scene)
                axes.set_visible(True)
                axes.plot(columns["time"], 1e3 * columns[column], **LINES[nsh], label=LABELS[nsh])
                axes.set_title(f"{TITLES[name]}: \u0394{axis} of {node} in mm")
                axes.margins(x=0.0)
    for axes in panels[-1]:
        axes.set_xlabel("t in s")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), ncols=2, loc="outside upper right")
    return figure


def figure_10(columns: Columns) -> Figure:
    """External power over time, and its integral."""
    figure = _figure(6.4, 4.4)
    panels = figure.subplots(2, 1, sharex=True)
    for axes, what in zip(panels, ("power", "absorbed")):
        for name in ("nsh", "plain"):
            nsh = _with_nsh(name)
            axes.plot(columns["time"], columns[f"{name}.{what}"], **LINES[nsh], label=LABELS[nsh])
        axes.margins(x=0.0)
    panels[0].set_ylabel("external power in W")
    figure.legend(*panels[0].get_legend_handles_labels(), ncols=2, loc="outside upper right")
    panels[1].set(xlabel="t in s", ylabel="absorbed energy in J")
    return figure


#: Experiment -> number of the article's figure -> what draws it.
FIGURES: dict[str, dict[int, Callable[[Columns], Figure]]] = {
    "I": {6: figure_6},
    "II": {7: figure_7, 8: figure_8},
    "III": {9: figure_9},
    "IV": {10: figure_10},
    "beam": {3: figure_3},
    "nsh": {5: figure_5},
}


def style():
    """Context in which figures are drawn and saved."""
    return matplotlib.rc_context(STYLE)


def write_figures(name: str, columns: Columns, stem: Path) -> list[Path]:
    """Draw an experiment's figures as stem_figure_N.png and .svg; equal data give equal bytes.  Returns the files."""
    written = []
    with style():
        for number, draw in FIGURES[name].items():
            written += save(draw(columns), stem.with_name(f"{stem.name}_figure_{number}"))
    return written


def save(figure: Figure, stem: Path) -> list[Path]:
    """Write stem.png (256 colours, which halves it) and stem.svg (two decimals), each whole or not at all, without dates."""
    files = [stem.with_name(stem.name + suffix) for suffix in (".png", ".svg")]
    few, svg = few_colours(figure, DPI), io.StringIO()
    figure.savefig(svg, format="svg", metadata={"Date": None, "Creator": None})
    with replacing(files[0]) as file:
        few.save(file, format="PNG", optimize=True)
    text = re.sub(r"(\d\.\d\d)\d+", r"\1", svg.getvalue())
    write_text(files[1], re.sub(r"[ \t]+$|^[ \t]+", "", text, flags=re.MULTILINE))
    return files
