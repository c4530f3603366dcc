"""The validation report: one self-contained HTML file beside each FMU."""

from __future__ import annotations

import base64
import os
import platform
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

import tensegrity_core
from tensegrity_core.files import write_text
from tensegrity_core.model import Model
from tensegrity_core.model.strength import by_name
from tensegrity_core.output.plots import draw_series, legend_beside, small_png

from ..places import clone
from ..variables.documentation import environment
from . import compare, worst
from .sensitivity import WINDOW
from .validate import TIGHT, Run, Validation, reference_settings

#: How many values of the reference are marked, at how many instants, and how.
CIRCLES, FEWEST, MOST = 120, 5, 21
CIRCLE: dict[str, Any] = {"color": "black", "marker": "o", "markersize": 3.0, "markerfacecolor": "none", "markeredgewidth": 0.7}

#: Errors below this are round-off: their scale is linear there.
SMALL = 1e-12


def write_report(validation: Validation, path: Path, live: Path | None = None) -> None:
    """The verdict, the scene in motion, the scenario that comes nearest to a bound, then each scenario with plots of positions
    and string forces (FMU over reference, and their difference), all errors, and the versions.

    live: the page in which the scene moves; the report shows it and leads there.
    """
    nearest = worst.worst(validation)
    page = (
        environment()
        .get_template("report.html")
        .render(
            title=f"Validation of {validation.model.name}, {validation.runtime} FMU",
            model=validation.model,
            live=_address(os.path.relpath(live, path.parent)) if live else None,
            runs=[_told(run) for run in validation.runs],
            failures=validation.failures,
            worst=worst.sentences(nearest),
            instant=nearest.deviation.time,
            shape=_inline(worst.picture(nearest)),
            position=validation.position,
            force=validation.force,
            tight=" and ".join(f"{tolerance:g}" for tolerance in TIGHT),
            bounds={
                "margin": f"{compare.MARGIN:g}",
                "floor": f"{compare.FLOOR:g}",
                "floor_energy": f"{compare.FLOOR_ENERGY:g}",
                "ledger": compare.LEDGER_BOUND,
                "sensitive": compare.SENSITIVE,
                "window": WINDOW,
            },
            kinds=_kinds(validation.model),
            seconds=validation.seconds,
            factor=validation.factor,
            versions=versions(),
        )
    )
    write_text(path, page)


def _kinds(model: Model) -> dict[str, tuple]:
    """The classes of outputs that are compared; utilisation where the scene says what members bear."""
    rated = model.sections or model.strength
    return {kind: of for kind, of in compare.KINDS.items() if rated or kind != "utilisation"}


def _told(run: Run) -> dict[str, Any]:
    """What the page tells of a scenario."""
    times = run.scenario.inputs.times
    both = (run.comparison, run.tight)
    return {
        "title": run.scenario.title,
        "duration": times[-1],
        "step": times[1] - times[0],
        "part": worst.percent(max(one.part for one in both)),
        "failures": run.failures,
        "comparison": run.comparison,
        "tight": run.tight,
        "until": run.until,
        "used": _most_used(run),
        "settings": _shown(reference_settings(run.scenario, run.again)) + (", from the cache" if run.from_cache else ""),
        "pictures": [(what, _inline(png)) for what, png in pictures(run).items()],
    }


def _most_used(run: Run) -> str:
    """The member that came closest to what it bears, in words; '' where nothing is known of that."""
    model, found = run.scenario.model, run.reference
    used = by_name(model, found.bar_utilisation.max(axis=0), found.string_utilisation.max(axis=0))
    name = max(used, key=lambda one: used[one], default="")
    limit = "buckling load" if name in model.bar_names else "strength"
    return f"{name} used most of what it bears: {100.0 * used[name]:.3g} % of its {limit}" if name else ""


def _address(path: str) -> str:
    """A relative path as a page writes it."""
    return quote(Path(path).as_posix())


def _inline(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode()}"


def _shown(settings: dict) -> str:
    return f"{settings['method']}, rtol {settings['rtol']:g}, atol {settings['atol']:g} m"


def pictures(run: Run) -> dict[str, bytes]:
    """PNGs by what they show: heights of the free nodes, and tensions of the strings; FMU minus reference below."""
    model, times = run.scenario.model, run.reference.times
    free = model.free_nodes
    ours, theirs = ((position - model.nodes)[:, free, 2] for position in (run.fmu["position"], run.reference.position))
    gap = np.abs(run.fmu["position"] - run.reference.position)[:, free].max(axis=2)
    names = [model.node_names[i] for i in free]
    tensions = run.fmu["string_force"], run.reference.string_force
    apart = np.abs(tensions[0] - tensions[1])
    return {
        "vertical displacement of the free nodes": _picture(times, ours, theirs, gap, names, "displacement, m", "error, m"),
        "tension of the strings": _picture(times, *tensions, apart, model.string_names, "tension, N", "error, N"),
    }


def _picture(times, ours, reference, gap, names, label, error_label) -> bytes:
    figure = Figure(figsize=(6.2, 4.6), dpi=80, layout="constrained")
    FigureCanvasAgg(figure)
    _draw(figure.subplots(2, 1, sharex=True, height_ratios=(2, 1)), times, ours, reference, gap, names, label, error_label)
    circle = Line2D([], [], linestyle="", label="circles: the reference; lines: the FMU", **CIRCLE)
    figure.legend(handles=[circle], loc="outside lower center", fontsize=8, frameon=False)
    return small_png(figure)


def _draw(axes, times, ours, reference, gap, names, label, error_label):
    above, below = axes
    draw_series(above, times, ours, names)
    count = max(FEWEST, min(MOST, CIRCLES // max(1, len(names))))
    points = np.unique(np.linspace(0, len(times) - 1, count).astype(int))
    above.plot(times[points], reference[points], linestyle="", **CIRCLE)
    draw_series(below, times, gap, names)
    above.set_ylabel(label)
    legend_beside(above)
    below.set_yscale("symlog", linthresh=SMALL)
    below.set_ylim(0.0, 3.0 * max(10.0 * SMALL, float(np.nanmax(gap, initial=0.0))))
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
