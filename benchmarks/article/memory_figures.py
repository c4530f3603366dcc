"""The figures of docs/memory.md, from its numbers (memory.json) and series (memory_*.csv)."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness.page import COLOURS, new_figure
from tensegrity_core.article.experiments import DAMPINGS

from .claims import SYSTEMS
from .memory_loops import CLOSED, REACH, STIFFNESS, single_valued

INK, RED, TEAL, YELLOW, GREY, VIOLET = COLOURS
#: Law -> label and colour.
LAWS = {"series": ("single-valued, k in series", RED), "memory": ("with memory", INK)}
DASHES = {"series": "--", "memory": "-"}


def kernel_points(axes, series: dict, every: int = 40) -> None:
    axes.plot(1e2 * series["elongation"][::every], series["kernel"][::every], ".", color=TEAL, ms=4, label="kernel, slow pull")


def cells(data: dict) -> Figure:
    """Test 1, and its closed form."""
    figure = new_figure(6.4, 3.4)
    axes, loop = figure.subplots(), data["cells"]
    axes.plot(1e2 * np.array(loop["x"]), loop["force"], color=INK, label="exact law")
    kernel_points(axes, data["columns"]["cells"])
    before, after = CLOSED["force"]
    axes.plot(1e2 * np.array(CLOSED["there"]), [before] * 3, "v", color=RED, ms=6, label="closed form: snaps")
    axes.plot(1e2 * np.array(CLOSED["there"]), [after] * 3, "v", mfc="none", color=RED, ms=6)
    axes.plot(1e2 * np.array(CLOSED["back"]), [0.4] * 3, "^", color=YELLOW, ms=6, label="closed form: returns")
    axes.plot(1e2 * np.array(CLOSED["back"]), [1.4 - after] * 3, "^", mfc="none", color=YELLOW, ms=6)
    axes.set(title="three trilinear cells; filled before, open after a snap", xlabel="elongation in cm", ylabel="force in N")
    axes.legend()
    return figure


def honeycomb(data: dict) -> Figure:
    """Test 2: the whole loop beside the single-valued curve; partial loops."""
    figure = new_figure(8.6, 3.6)
    whole, partial = figure.subplots(1, 2, sharey=True)
    loop, x = data["honeycomb"], np.linspace(0.0, REACH, 1500)
    whole.plot(1e2 * x, single_valued(x), "--", color=RED, lw=0.9, label=LAWS["series"][0])
    whole.plot(1e2 * np.array(loop["x"]), loop["force"], color=INK, label="with memory, exact law")
    kernel_points(whole, data["columns"]["honeycomb"])
    whole.set(title=f"the article's NSH, k = {STIFFNESS:g} N/m", xlabel="elongation in cm", ylabel="force in N")
    whole.legend()
    partial.plot(1e2 * np.array(loop["x"]), loop["force"], color=COLOURS[4], lw=0.7)
    for one, colour, dashes in zip(data["partial"], (TEAL, RED, VIOLET), ("-", "--", ":")):
        label = " \u2192 ".join(f"{1e2 * turn:.1f}" for turn in one["turns"]) + " cm"
        partial.plot(1e2 * np.array(one["x"]), one["force"], dashes, color=colour, label=label)
    partial.set(title="partial loops", xlabel="elongation in cm")
    partial.legend()
    return figure


def stiffness(data: dict) -> Figure:
    """Loss per cycle against the string's own stiffness."""
    figure = new_figure(6.4, 3.4)
    axes, scan = figure.subplots(), data["columns"]["stiffness"]
    axes.plot(scan["stiffness"], 1e3 * scan["loss"], "-o", color=INK, label="all four in series")
    axes.axhline(1e3 * data["stiffness"]["rigid"], color=INK, ls=":", label="all four, rigid string")
    looks = zip((TEAL, YELLOW, RED, VIOLET), ("-", "--", "-.", (0, (1, 1))))
    for i, (limit, (colour, dashes)) in enumerate(zip(data["stiffness"]["beams"], looks), 1):
        axes.plot(scan["stiffness"], 1e3 * scan[f"beam_{i}.loss"], linestyle=dashes, color=colour, label=f"beam {i} alone")
        axes.plot(limit, 0.0, "|", color=colour, ms=14, mew=2)
    axes.set(xscale="log", xlabel="own stiffness in N/m", ylabel="mJ per cycle", title="energy lost in snaps in a full cycle")
    axes.legend(ncols=2)
    return figure


def heights(data: dict) -> Figure:
    """Experiment I: a slow lift up and back, and the sudden lifts."""
    figure = new_figure(8.6, 3.5)
    slow, sudden = data["columns"]["ramp"], data["columns"]["I"]
    for axes, (name, title) in zip(figure.subplots(1, 3), SYSTEMS.items()):
        for law, (label, colour) in LAWS.items():
            axes.plot(
                slow["lift"], slow[f"{name}.{law}.z"], DASHES[law], color=colour, lw=1.0, label=f"{label}: slow, up and back"
            )
        axes.plot(sudden["lift"], sudden[f"{name}.memory.z"], ".", color=TEAL, ms=4, label="with memory: sudden lifts")
        axes.set(title=title, xlabel="lift of each top node in N")
    figure.axes[0].set_ylabel("mean height of the top nodes in m")
    figure.legend(*figure.axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    return figure


def waves(data: dict) -> Figure:
    """Experiment II: n5's displacement and the force of n1-n4 at three dampings."""
    figure, found = new_figure(8.6, 6.0), data["columns"]["II"]
    rows = figure.subplots(len(DAMPINGS), 2, sharex=True)
    for (moved, force), d in zip(rows, sorted(DAMPINGS)):
        for law, (label, colour) in LAWS.items():
            prefix = f"{law}.d{d:g}"
            way = np.linalg.norm([found[f"{prefix}.n5.d{axis}"] for axis in "xyz"], axis=0)
            moved.plot(found["time"], way, DASHES[law], color=colour, lw=0.9, label=label)
            force.plot(found["time"], found[f"{prefix}.s1.elastic_force"], DASHES[law], color=colour, lw=0.9)
        moved.set(title=f"distance of n5 from its start, d = {d:g} N s/m", ylabel="m")
        force.set(title=f"elastic force of n1-n4, d = {d:g} N s/m", ylabel="N")
    for axes in rows[-1]:
        axes.set_xlabel("time in s")
    figure.legend(*rows[0][0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    return figure


FIGURES = {
    f"memory_{n}": f
    for n, f in {"cells": cells, "honeycomb": honeycomb, "stiffness": stiffness, "I": heights, "II": waves}.items()
}
