"""Extreme parameters on every method: the run finishes, with its error, or stops with a named error.

python -m benchmarks.stability.extremes [--redraw]
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from benchmarks.harness import page as common
from benchmarks.harness.problems import PUSH_ASIDE, PUSH_UP, built_in
from tensegrity_core.fields import METHODS
from tensegrity_core.model import Model

from .pushed_run import Run, deviation, run
from .spectrum import retuned

DURATION, POINTS = 1.0, 20
#: The tolerance of the methods with an error test; the step of the others, s.
TOLERANCE, STEP = 1e-8, 1e-3
FIXED = ("rk4", "ros2")
#: The reference and the run that says how well it is known: method and tolerance.
REFERENCES = (("auto", 1e-12), ("rodas5p", 1e-11))


class Extreme(NamedTuple):
    """label; model: () -> Model; at_rest_length: strings that begin exactly at their rest length."""

    label: str
    model: Callable[[], Model]
    at_rest_length: tuple = ()


def _stiffer(scene: str) -> Model:
    model = built_in(scene)
    return retuned(model, stiffness=1e3 * float(model.stiffness[0]))


def _masses(scene: str, low: float, high: float) -> Model:
    model = built_in(scene)
    return replace(model, bar_mass=np.geomspace(low, high, len(model.bars)))


EXTREMES = {
    "as it is": Extreme("three_bar as it is", lambda: built_in("three_bar")),
    "d = 0": Extreme("d = 0", lambda: retuned(built_in("three_bar"), damping=0.0)),
    "d = 1e5": Extreme("d = 1e5", lambda: retuned(built_in("three_bar"), damping=1e5)),
    "k x 1000": Extreme("k × 1000, tensions kept", lambda: _stiffer("three_bar")),
    "k x 1000, rest": Extreme(
        "k × 1000, rest lengths kept", lambda: replace(built_in("three_bar"), stiffness=1e3 * built_in("three_bar").stiffness)
    ),
    "light bars": Extreme("bars of 1e-4, 1e-2, 1 kg", lambda: _masses("three_bar", 1e-4, 1.0)),
    "heavy bars": Extreme("bars of 1, 1e2, 1e4 kg", lambda: _masses("three_bar", 1.0, 1e4)),
    "six light bars": Extreme("six_bar, bars of 1e-4 … 1 kg", lambda: _masses("six_bar", 1e-4, 1.0)),
    "one at rest length": Extreme("one string at its rest length", lambda: built_in("three_bar"), (0,)),
    "all at rest length": Extreme("all strings at their rest lengths", lambda: built_in("three_bar"), tuple(range(6))),
}


# ----------------------------------------------------------------------------------------------------- what is measured


def trial(extreme: Extreme, method: str, tolerance: float = TOLERANCE, duration: float = DURATION, step: float = STEP) -> Run:
    """One method on one case; step: s, of a fixed-step method."""
    settings = {"max_step": step} if method in FIXED else {"tolerance": tolerance}
    points = max(1, round(POINTS * duration / DURATION))
    return run(extreme.model(), method, duration, points, extreme.at_rest_length, **settings)


def outcomes(name: str, methods=METHODS, duration: float = DURATION) -> dict:
    """Every method on a case.  known: m, how well the exact motion is known; nan where a reference stopped."""
    extreme = EXTREMES[name]
    tight, other = (trial(extreme, method, tolerance, duration) for method, tolerance in REFERENCES)
    rows = []
    for method in methods:
        found = trial(extreme, method, duration=duration)
        gain, stats = float((found.energy - found.energy[0]).max()), found.stats
        row = {"method": method, "status": found.status, "time": found.time, "error": deviation(found, tight)}
        row |= {"ledger": found.ledger, "gain": gain}
        rows.append(row | {key: stats[key] for key in ("transitions", "steps", "rejected")})
    case = {"case": name, "label": extreme.label, "known": deviation(tight, other)}
    reference = {"reference": [tight.status, other.status], "transitions": tight.stats["transitions"]}
    return case | reference | {"rows": rows}


def measure() -> dict:
    cases = [outcomes(name) for name in EXTREMES]
    halved = trial(EXTREMES["as it is"], "rk4", step=0.5 * STEP)
    settings = {"tolerance": TOLERANCE, "step": STEP, "duration": DURATION}
    return {"cases": cases, **settings, "ledger_at_half_step": halved.ledger}


# ------------------------------------------------------------------------------------------------------------- figures


def draw(data: dict) -> Figure:
    figure = common.new_figure(9.0, 4.6)
    ax, cases = figure.subplots(), data["cases"]
    names = [row["method"] for row in cases[0]["rows"]]
    error = np.array([common.numbers([row["error"] for row in case["rows"]]) for case in cases])
    drawn = ax.pcolormesh(np.clip(error, 1e-12, 1.0), norm=LogNorm(1e-12, 1.0), cmap="viridis", edgecolors="white", lw=1.0)
    for i, case in enumerate(cases):
        for j, row in enumerate(case["rows"]):
            text = row["status"] if row["error"] is None else f"{row['error']:.0e}"
            dark = row["error"] is not None and row["error"] < 1e-3
            ax.text(j + 0.5, i + 0.5, text, ha="center", va="center", color="white" if dark else "black", fontsize=7.5)
    labels = [case["label"] + _doubt(case) for case in cases]
    ax.set_xticks(np.arange(len(names)) + 0.5, names)
    ax.set_yticks(np.arange(len(cases)) + 0.5, labels)
    ax.grid(False)
    ax.tick_params(length=0)
    ax.invert_yaxis()
    settings = f"tolerance {data['tolerance']:g}, rk4 and ros2 at {1e3 * data['step']:g} ms"
    ax.set_title(f"Largest error within {data['duration']:g} s, m; {settings}")
    figure.colorbar(drawn, ax=ax, label="m")
    return figure


def _doubt(case: dict) -> str:
    """A mark where the exact motion is known to no better than a tenth of some finished run's error."""
    errors = [row["error"] for row in case["rows"] if row["error"] is not None]
    return " *" if errors and (case["known"] is None or case["known"] > 0.1 * min(errors)) else ""


def words(data: dict) -> dict:
    """What the page says of these data."""
    runs = [row for case in data["cases"] for row in case["rows"]]
    return {
        "runs": runs,
        "stopped": [row for row in runs if row["status"] != "finished"],
        "doubtful": [case["label"] for case in data["cases"] if _doubt(case)],
        "rk4": next(row for row in runs if row["method"] == "rk4"),
        "references": REFERENCES,
        "push": (PUSH_UP, PUSH_ASIDE),
    }


STUDY = common.Study(__doc__, "extremes", measure, draw, words)

if __name__ == "__main__":
    STUDY.main()
