"""Work and memory against size: ``python -m benchmarks.speed.growth`` writes docs/growth.json, docs/growth.md and the figure,
in about 2 minutes.

Towers of n stages (3 n bars) stand still and are pushed at the top: 45 N down on each of the last three nodes, 20 N aside
on the first of them, for 0.1 s, which no wave needs to run down a tall tower.  A light prestress lets strings go slack (there
are transitions), a high one keeps all of them taut.  For the explicit method and the two L-stable ones:

* time per accepted step: of the taut run;
* time per transition: what the slack run takes longer than the taut one, over its transitions;
* time per right-hand side: the explicit method's taut run over its right-hand sides, so with the vector work of a stage;
* linear algebra (L-stable methods): the taut run less its right-hand sides, over its attempts, so Jacobian, factorisations
  and solves of a step together;
* memory: what the simulation occupies, as the kernel counts it.

Runs are interleaved, in rounds; a time is the least processor time of all runs.  Exponents are fitted from FIT_FROM stages
on, and between the largest tower and the largest of at most half its size.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import problems
from benchmarks.harness.page import Page, new_figure, rendered
from benchmarks.harness.timing import follow, in_turns, recorded
from tensegrity_core.kernel import Kernel
from tensegrity_core.model import Model
from tensegrity_core.scene.towers import tower
from tensegrity_core.statics import build_model

STAGES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
METHODS = {"dop853": "explicit (DOP853)", "rodas5p": "L-stable (Rodas5P)", "radau9": "L-stable (Radau IIA)"}
NAMES = {method: label.split("(")[1].rstrip(")") for method, label in METHODS.items()}
QUANTITIES = {
    "step": "accepted step",
    "transition": "transition",
    "rhs": "right-hand side",
    "algebra": "linear algebra",
    "memory": "memory",
}
IMPLICIT = ("rodas5p", "radau9")
TOLERANCE, DURATION, INSTANTS = 1e-6, 0.1, 4
DOWN, ASIDE = -45.0, 20.0  # N
LIGHT, HIGH = 40.0, 400.0  # N, of the saddle strings
ROUND = 0.02  # s
FIT_FROM = 10
LIMIT = 1.2
MARKS = {"dop853": ("#1f5fa8", "o"), "rodas5p": ("#c2571a", "s"), "radau9": ("#3a7d44", "^")}

# --- measuring ---------------------------------------------------------------------------------------------------


def model_of(stages: int, tension: float) -> Model:
    """A tower without gravity at this prestress.  A single stage is held by its weight alone."""
    return build_model(tower(stages) if stages == 1 else tower(stages, gravity=0.0, tension=tension))


@dataclass
class Case:
    """A pushed tower in one kernel, and the seconds that its runs took."""

    kernel: Kernel
    force: np.ndarray
    seconds: list[float] = field(default_factory=list)

    @classmethod
    def make(cls, model: Model, method: str) -> Case:
        force = problems.kernel_force(model, problems.push(model, DOWN, ASIDE))
        return cls(Kernel(model, method=method, tolerance=TOLERANCE), force)

    def run(self) -> float:
        """One run; short ones again and again, for ROUND seconds."""
        spent = 0.0
        while spent < ROUND:
            self.seconds.append(follow(self.kernel, self.force, DURATION, INSTANTS)[0])
            spent += self.seconds[-1]
        return spent

    @property
    def time(self) -> float:
        return min(self.seconds)


def measure(stages: tuple[int, ...], rounds: int) -> list[dict]:
    """One row per tower and method."""
    cases = {(n, m, tension): Case.make(model_of(n, tension), m) for n, m, tension in product(stages, METHODS, (LIGHT, HIGH))}
    in_turns({key: case.run for key, case in cases.items()}, rounds)
    rows = []
    for n in stages:
        explicit = cases[n, "dop853", HIGH]
        rhs = explicit.time / explicit.kernel.stats["rhs"]
        for method in METHODS:
            rows.append(row(n, method, cases[n, method, HIGH], cases[n, method, LIGHT], rhs))
            print(f"{n:5d} stages, {method}: {1e6 * rows[-1]['step']:.1f} us per step", file=sys.stderr)
    return rows


def row(stages: int, method: str, taut: Case, slack: Case, rhs: float) -> dict:
    """What the runs of one tower by one method say; times in s."""
    smooth, broken = taut.kernel.stats, slack.kernel.stats
    comparable = stages > 1 and smooth["transitions"] == 0 and broken["transitions"] > 0
    algebra = (taut.time - smooth["rhs"] * rhs) / (smooth["steps"] + smooth["rejected"]) if method in IMPLICIT else None
    return {
        "stages": stages,
        "bars": 3 * stages,
        "strings": taut.kernel.counts["S"],
        "method": method,
        "step": taut.time / smooth["steps"],
        "transition": (slack.time - taut.time) / broken["transitions"] if comparable else None,
        "rhs": rhs,
        "algebra": algebra,
        "memory": taut.kernel.memory_size,
        "taut": {"seconds": taut.time, **smooth},
        "slack": {"seconds": slack.time, **broken},
    }


@recorded
def collect(stages: tuple[int, ...], rounds: int) -> dict:
    """All measurements and what they say, with conditions: growth.json."""
    rows = measure(stages, rounds)
    push = {"down": -DOWN, "aside": ASIDE, "duration": DURATION, "tension": [LIGHT, HIGH], "tolerance": TOLERANCE}
    return {"push": push, "exponents": exponents(rows), "fitted_from_stages": FIT_FROM, "limit": LIMIT, "rows": rows}


# --- judging -----------------------------------------------------------------------------------------------------


def series(rows: list[dict], method: str, quantity: str) -> tuple[np.ndarray, np.ndarray]:
    """Stages and values of a quantity, where it was measured."""
    points = [(r["stages"], r[quantity]) for r in rows if r["method"] == method and r[quantity] and r[quantity] > 0.0]
    return tuple(np.array(points, dtype=float).reshape(-1, 2).T)


def exponent(n: np.ndarray, value: np.ndarray) -> float | None:
    """p of value ~ n^p by least squares in the logarithms, from FIT_FROM stages on; None with fewer than two points."""
    fitted = n >= FIT_FROM
    if fitted.sum() < 2:
        return None
    return float(np.polyfit(np.log(n[fitted]), np.log(value[fitted]), 1)[0])


def last_exponent(n: np.ndarray, value: np.ndarray) -> float | None:
    """p between the largest tower and the largest of at most half its size; None where there is none."""
    smaller = np.flatnonzero(n <= 0.5 * n[-1]) if len(n) else []
    if not len(smaller):
        return None
    i = smaller[-1]
    return float(np.log(value[-1] / value[i]) / np.log(n[-1] / n[i]))


def exponents(rows: list[dict]) -> dict[str, dict[str, dict[str, float | None]]]:
    """By method and quantity: of the fit, and at the end."""
    found: dict = {method: {} for method in METHODS}
    for method, name in product(METHODS, QUANTITIES):
        if name != "algebra" or method in IMPLICIT:
            points = series(rows, method, name)
            found[method][name] = {"fit": exponent(*points), "last": last_exponent(*points)}
    return found


# --- showing -----------------------------------------------------------------------------------------------------


def figure_of(result: dict) -> Figure:
    """Four charts over the number of bars, each with n^1 and n^1.2 through the first fitted point."""
    figure = new_figure(9.0, 6.6)
    rows, found = result["rows"], result["exponents"]
    linear = [("algebra", method, f"linear algebra of {NAMES[method]}") for method in IMPLICIT]
    charts = {
        ("per accepted step", 1e6, "µs"): [("step", *one) for one in METHODS.items()],
        ("per transition", 1e6, "µs"): [("transition", *one) for one in METHODS.items()],
        ("parts of a step", 1e6, "µs"): [("rhs", "dop853", "right-hand side"), *linear],
        ("memory", 1e-6, "MB"): [("memory", "dop853", "a simulation, whatever its method")],
    }
    for axes, ((title, scale, unit), curves) in zip(figure.subplots(2, 2).flat, charts.items()):
        for quantity, method, label in curves:
            colour, marker = MARKS[method]
            curve(axes, *series(rows, method, quantity), scale, found[method][quantity]["fit"], label, colour, marker)
        axes.set(xscale="log", yscale="log", xlabel="bars", ylabel=unit, title=title)
        axes.minorticks_off()
        axes.grid(color="#dddddd", linewidth=0.6)
        if axes.lines:
            axes.legend(frameon=False, fontsize=8, loc="upper left")
            axes.set_ylim(top=200.0 * axes.get_ylim()[1])  # room for the legend
    return figure


def curve(axes, n, value, scale, power, label, colour, marker) -> None:
    """Measured points, and the two slopes from the first of those that the fit uses."""
    if not len(n):
        return
    shown = label if power is None else f"{label}, fitted n^{power:.2f}"
    axes.plot(3 * n, scale * value, marker, color=colour, markersize=5, label=shown)
    start = int(np.argmax(n >= FIT_FROM))
    for slope, dashes in ((1.0, "-"), (LIMIT, ":")):
        line = scale * value[start] * (n[start:] / n[start]) ** slope
        named = f"n^{slope:g}" + (" (limit)" if slope == LIMIT else " (theory)")
        known = named in [old.get_label() for old in axes.lines]
        axes.plot(3 * n[start:], line, dashes, color="#777777", linewidth=1.0, zorder=1, label="_" if known else named)


def above_limit(result: dict, quantity: str) -> list[str]:
    """Methods whose exponent at the end exceeds the limit, with it."""
    ends = {method: result["exponents"][method].get(quantity, {}).get("last") for method in METHODS}
    return [f"{NAMES[method]} (n^{end:.2f})" for method, end in ends.items() if end is not None and end > result["limit"]]


def report(result: dict) -> str:
    """docs/growth.md: the figure in two sentences, and how to draw it again."""
    largest = max(r["bars"] for r in result["rows"])
    last = {r["method"]: r for r in result["rows"] if r["bars"] == largest}
    return rendered(
        "speed/growth",
        **result,
        methods=NAMES,
        quantities=QUANTITIES,
        largest=largest,
        steps=[f"{1e6 * last[m]['step']:.0f}" for m in METHODS],
        memory=last["dop853"]["memory"],
        above={name: above_limit(result, name) for name in QUANTITIES},
    )


PAGE = Page(__doc__, "growth", collect, report, {"growth": figure_of}, {"stages": STAGES, "rounds": 7})

if __name__ == "__main__":
    PAGE.main()
