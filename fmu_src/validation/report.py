"""The validation report: one self-contained HTML file beside each FMU."""

from __future__ import annotations

import base64
import io
import os
import platform
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import tensegrity_core
from tensegrity_core.files import write_text
from tensegrity_core.output.plots import draw_series, legend_beside

from ..places import clone
from ..variables.documentation import environment
from . import compare
from .sensitivity import WINDOW
from .validate import TIGHT, Run, Validation, reference_settings

#: How many instants of the reference are marked, and how.
CIRCLES = 21
CIRCLE: dict[str, Any] = {"color": "black", "marker": "o", "markersize": 3.0, "markerfacecolor": "none", "markeredgewidth": 0.7}


def write_report(validation: Validation, path: Path, live: Path | None = None) -> None:
    """Plots of positions and string forces (FMU over reference, and their difference), the errors, and the versions.

    live: the page in which the scene moves; the report leads there.
    """
    page = (
        environment()
        .get_template("report.html")
        .render(
            title=f"Validation of {validation.model.name}, {validation.runtime} FMU",
            model=validation.model,
            live=os.path.relpath(live, path.parent) if live else None,
            runs=validation.runs,
            failures=validation.failures,
            tight=" and ".join(f"{tolerance:g}" for tolerance in TIGHT),
            bounds={
                "margin": f"{compare.MARGIN:g}",
                "floor": f"{compare.FLOOR:g}",
                "floor_energy": f"{compare.FLOOR_ENERGY:g}",
                "ledger": compare.LEDGER_BOUND,
                "sensitive": compare.SENSITIVE,
                "window": WINDOW,
            },
            kinds=compare.KINDS,
            seconds=validation.seconds,
            factor=validation.factor,
            pictures=[(run, base64.b64encode(picture(run)).decode()) for run in validation.runs],
            settings=[_shown(reference_settings(run.scenario, run.again)) for run in validation.runs],
            versions=versions(),
        )
    )
    write_text(path, page)


def _shown(settings: dict) -> str:
    return f"{settings['method']}, rtol {settings['rtol']:g}, atol {settings['atol']:g} m"


def picture(run: Run) -> bytes:
    """A PNG: heights of the free nodes and tensions of the strings above, FMU minus reference below."""
    figure = Figure(figsize=(12, 5.2), dpi=75, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(2, 2, sharex=True, height_ratios=(2, 1))
    model, times = run.scenario.model, run.reference.times
    free = model.free_nodes
    moved = run.fmu["position"] - model.nodes
    heights = moved[:, free, 2], (run.reference.position - model.nodes)[:, free, 2]
    names = [model.node_names[i] for i in free]
    gap = np.abs(run.fmu["position"] - run.reference.position)[:, free].max(axis=2)
    _draw(axes[:, 0], times, *heights, gap, names, "vertical displacement, m", "position error, m")
    tensions = run.fmu["string_force"], run.reference.string_force
    _draw(axes[:, 1], times, *tensions, np.abs(tensions[0] - tensions[1]), model.string_names, "tension, N", "error, N")
    out = io.BytesIO()
    circle = Line2D([], [], linestyle="", label="circles: the reference; lines: the FMU", **CIRCLE)
    figure.legend(handles=[circle], loc="outside lower center", fontsize=8, frameon=False)
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


def _draw(axes, times, ours, reference, gap, names, label, error_label):
    above, below = axes
    draw_series(above, times, ours, names)
    points = np.unique(np.linspace(0, len(times) - 1, CIRCLES).astype(int))
    above.plot(times[points], reference[points], linestyle="", **CIRCLE)
    draw_series(below, times, gap, names)
    above.set_ylabel(label)
    legend_beside(above)
    below.set_yscale("symlog", linthresh=1e-12)
    below.set_ylabel(error_label)
    below.set_xlabel("time, s")


def versions() -> dict[str, str]:
    """What made the FMU and ran it."""
    found = {"tensegrity": tensegrity_core.__version__, "commit": commit() or "not known"}
    found["Python"] = sys.version.split()[0]
    for name in ("numpy", "scipy", "fmpy", "pythonfmu", "matplotlib"):
        found[name] = metadata.version(name)
    found["machine"] = f"{platform.platform()}, {processor()}, {os.cpu_count()} processors"
    return found


def processor() -> str:
    """The processor's name, as far as the system tells."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def commit() -> str | None:
    """The commit of the sources, with a mark where they differ from it; None where these are not a clone's."""
    folder = clone()
    if folder is None:  # an installed package may stand in somebody else's repository
        return None

    def git(*arguments: str) -> str | None:
        try:
            done = subprocess.run(["git", *arguments], cwd=folder, capture_output=True, encoding="utf-8", timeout=10)
        except (OSError, subprocess.TimeoutExpired):
            return None
        return done.stdout.strip() if done.returncode == 0 else None

    found = git("rev-parse", "HEAD")
    if found is None:
        return None
    return found + (" with changes" if git("status", "--porcelain", "--untracked-files=no") else "")
