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
import time
from dataclasses import dataclass, field

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import machine, problems
from benchmarks.harness.page import Page, listed, new_figure, table, wrapped
from tensegrity_core.kernel import Kernel
from tensegrity_core.model import Model
from tensegrity_core.scene.towers import tower
from tensegrity_core.statics import build_model

STAGES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
METHODS = {"dop853": "explicit (DOP853)", "rodas5p": "L-stable (Rodas5P)", "radau9": "L-stable (Radau IIA)"}
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

    def run(self) -> None:
        """One run; short ones again and again, for ROUND seconds."""
        spent = 0.0
        while spent < ROUND:
            self.kernel["force"][:] = self.force
            self.kernel.initialize()
            start = time.process_time()
            for _ in range(INSTANTS):
                self.kernel.step(DURATION / INSTANTS)
            self.seconds.append(time.process_time() - start)
            spent += self.seconds[-1]

    @property
    def time(self) -> float:
        return min(self.seconds)


def measure(stages: tuple[int, ...], rounds: int) -> list[dict]:
    """One row per tower and method."""
    cases: dict[tuple, Case] = {}
    models = {(n, tension): model_of(n, tension) for n in stages for tension in (LIGHT, HIGH)}
    for (n, tension), model in models.items():
        for method in METHODS:
            cases[n, method, tension] = Case.make(model, method)
    for _ in range(rounds):
        for case in cases.values():
            case.run()
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


def collect(stages: tuple[int, ...], rounds: int) -> dict:
    """All measurements and what they say, with machine and conditions: growth.json."""
    began, where = time.perf_counter(), machine.describe()
    rows = measure(stages, rounds)
    return {
        "machine": where,
        "push": {"down": -DOWN, "aside": ASIDE, "duration": DURATION, "tension": [LIGHT, HIGH], "tolerance": TOLERANCE},
        "exponents": exponents(rows),
        "fitted_from_stages": FIT_FROM,
        "limit": LIMIT,
        "seconds": round(time.perf_counter() - began),
        "rows": rows,
    }


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
    wanted = {method: ["step", "transition", "memory", "rhs"] for method in METHODS}
    for method in IMPLICIT:
        wanted[method].append("algebra")
    found: dict = {method: {} for method in METHODS}
    for method, names in wanted.items():
        for name in names:
            points = series(rows, method, name)
            found[method][name] = {"fit": exponent(*points), "last": last_exponent(*points)}
    return found


# --- showing -----------------------------------------------------------------------------------------------------


def figure_of(result: dict) -> Figure:
    """Four charts over the number of bars, each with n^1 and n^1.2 through the first fitted point."""
    figure = new_figure(9.0, 6.6)
    rows, found = result["rows"], result["exponents"]
    charts = [[("step", method, label) for method, label in METHODS.items()]]
    charts.append([("transition", method, label) for method, label in METHODS.items()])
    charts.append([("rhs", "dop853", "right-hand side")])
    charts[-1] += [("algebra", method, f"linear algebra of {METHODS[method].split('(')[1][:-1]}") for method in IMPLICIT]
    charts.append([("memory", "dop853", "a simulation, whatever its method")])
    titles = [("per accepted step", 1e6, "\u00b5s"), ("per transition", 1e6, "\u00b5s")]
    titles += [("parts of a step", 1e6, "\u00b5s"), ("memory", 1e-6, "MB")]
    for axes, curves, (title, scale, unit) in zip(figure.subplots(2, 2).flat, charts, titles):
        for quantity, method, label in curves:
            colour, marker = MARKS[method]
            curve(axes, *series(rows, method, quantity), scale, found[method][quantity]["fit"], label, colour, marker)
        axes.set(xscale="log", yscale="log", xlabel="bars", ylabel=unit, title=title)
        axes.minorticks_off()
        axes.grid(color="#dddddd", linewidth=0.6)
        if axes.lines:
            axes.legend(frameon=False, fontsize=8, loc="upper left")
            axes.set_ylim(top=30.0 * axes.get_ylim()[1])  # room for the legend
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


def short(method: str) -> str:
    return METHODS[method].split("(")[1].rstrip(")")


def exponent_rows(found: dict) -> str:
    """Fitted, and at the end."""
    names = {
        "step": "accepted step",
        "transition": "transition",
        "rhs": "right-hand side",
        "algebra": "linear algebra",
        "memory": "memory",
    }
    body = []
    for quantity, label in names.items():
        cells = [found[method].get(quantity) for method in METHODS]
        shown = ["–" if c is None or c["fit"] is None else f"{c['fit']:.2f}; {_or_dash(c['last'])}" for c in cells]
        body.append([label, *shown])
    return table(["exponent of n: fitted; at the end", *(short(method) for method in METHODS)], body)


def _or_dash(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def above_limit(result: dict, quantity: str) -> list[str]:
    """Methods whose exponent at the end exceeds the limit, with it."""
    ends = {method: result["exponents"][method].get(quantity, {}).get("last") for method in METHODS}
    return [f"{short(method)} (n^{end:.2f})" for method, end in ends.items() if end is not None and end > result["limit"]]


def end_text(result: dict) -> str:
    """What the exponents at the end say of the limit."""
    limit, texts = f"n^{result['limit']:g}", []
    steps, transitions, algebra = (above_limit(result, name) for name in ("step", "transition", "algebra"))
    if not steps:
        texts.append(f"At the end, too, an accepted step stays within {limit} by every method.")
    else:
        texts.append(f"At the end an accepted step exceeds {limit} by {listed(steps)}.")
    if transitions:
        texts.append(f"A transition, a difference of two runs and so the least certain, exceeds it by {listed(transitions)}.")
    if algebra:
        texts.append(
            f"So does the linear algebra of {listed(algebra)}: its operations grow with n, but its matrices outgrow the "
            "processor's caches between these sizes, and beyond counts what memory delivers, which the fit takes for growth; "
            "[scene-costs.md](scene-costs.md) measures both levels."
        )
    return " ".join(texts)


def report(result: dict) -> str:
    """docs/growth.md: the figure in two sentences, and how to draw it again."""
    rows, found, where = result["rows"], result["exponents"], result["machine"]
    largest = max(r["bars"] for r in rows)
    last = {r["method"]: r for r in rows if r["bars"] == largest}
    steps = listed([f"{1e6 * last[m]['step']:.0f}" for m in METHODS])
    blocks = [
        "# Growth",
        "![Time and memory against the number of bars](figures/growth.png)",
        "A tower of n stages has 3 n bars that meet only through strings, so by theory a step, a transition and the memory "
        f"cost a constant times n. With {largest} bars {listed([short(m) for m in METHODS])} need {steps} \u00b5s per "
        f"accepted step, and a simulation holds {1e-6 * last['dop853']['memory']:.0f} MB.",
        f"Exponents, fitted from {3 * result['fitted_from_stages']} to {largest} bars, and between the largest tower and one "
        f"of half its size; n^{result['limit']:g} is the limit that we set:",
        exponent_rows(found),
        end_text(result),
        f"Processor time, one thread, {where['processor']}, commit {where['commit']}, {where['date']}, in {result['seconds']} "
        "s; the figures stand in [growth.json](growth.json). Drawn by `python -m benchmarks.speed.growth`, which also says "
        "what was measured and how; `--redraw` draws it again from that file.",
    ]
    return wrapped("\n\n".join(block for block in blocks if block)) + "\n"


PAGE = Page(__doc__, "growth", collect, report, {"growth": figure_of}, {"stages": STAGES, "rounds": 7})

if __name__ == "__main__":
    PAGE.main()
