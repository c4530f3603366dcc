"""Work and memory against size: ``python benchmarks/growth.py`` writes docs/growth.json, docs/growth.md and the figure.

Towers of n stages (3 n bars) stand still and are pushed at the top: 45 N down on each of the last three nodes, 20 N aside
on the first of them, for 0.1 s, which no wave needs to run down a tall tower.  A light prestress lets strings go slack (there
are transitions), a high one keeps all of them taut.  For the explicit method and the two L-stable ones:

* time per accepted step: of the taut run;
* time per transition: what the slack run takes longer than the taut one, over its transitions;
* time per right-hand side: the explicit method's taut run over its right-hand sides, so with the vector work of a stage;
* linear algebra (L-stable methods): the taut run less its right-hand sides, over its attempts, so Jacobian, factorisations
  and solves of a step together;
* memory: what the simulation occupies, as the kernel counts it.

Runs are interleaved, in rounds; a time is the median of all runs.  Exponents are fitted from FIT_FROM stages on.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

import machine  # noqa: E402

from tensegrity_core.kernel import Kernel  # noqa: E402
from tensegrity_core.model import Model  # noqa: E402
from tensegrity_core.statics import build_model  # noqa: E402
from tensegrity_core.towers import tower  # noqa: E402

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


def push(model: Model) -> np.ndarray:
    """The kernel's input `force`, N."""
    force = np.zeros((len(model.nodes), 3))
    force[-3:, 2] = DOWN
    force[-3, 0] = ASIDE
    return force[np.ix_(model.free_nodes, model.axes)].ravel()


@dataclass
class Case:
    """A pushed tower in one kernel, and the seconds that its runs took."""

    kernel: Kernel
    force: np.ndarray
    seconds: list[float] = field(default_factory=list)

    @classmethod
    def make(cls, model: Model, method: str) -> Case:
        return cls(Kernel(model, method=method, tolerance=TOLERANCE), push(model))

    def run(self) -> None:
        """One run; short ones again and again, for ROUND seconds."""
        spent = 0.0
        while spent < ROUND:
            self.kernel["force"][:] = self.force
            self.kernel.initialize()
            start = time.perf_counter()
            for _ in range(INSTANTS):
                self.kernel.step(DURATION / INSTANTS)
            self.seconds.append(time.perf_counter() - start)
            spent += self.seconds[-1]

    @property
    def time(self) -> float:
        return statistics.median(self.seconds)


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
    rows = measure(stages, rounds)
    return {
        "machine": machine.describe(),
        "push": {"down": -DOWN, "aside": ASIDE, "duration": DURATION, "tension": [LIGHT, HIGH], "tolerance": TOLERANCE},
        "exponents": exponents(rows),
        "fitted_from_stages": FIT_FROM,
        "rows": rows,
    }


# --- judging -----------------------------------------------------------------------------------------------------


def series(rows: list[dict], method: str, quantity: str) -> tuple[np.ndarray, np.ndarray]:
    """Stages and values of a quantity, where it was measured."""
    points = [(r["stages"], r[quantity]) for r in rows if r["method"] == method and r[quantity] and r[quantity] > 0.0]
    return tuple(np.array(points, dtype=float).reshape(-1, 2).T)


def exponent(rows: list[dict], method: str, quantity: str) -> float | None:
    """p of value ~ n^p by least squares in the logarithms, from FIT_FROM stages on; None with fewer than two points."""
    n, value = series(rows, method, quantity)
    fitted = n >= FIT_FROM
    if fitted.sum() < 2:
        return None
    return float(np.polyfit(np.log(n[fitted]), np.log(value[fitted]), 1)[0])


def exponents(rows: list[dict]) -> dict[str, dict[str, float | None]]:
    """By method and quantity."""
    wanted = {method: ["step", "transition", "memory", "rhs"] for method in METHODS}
    for method in IMPLICIT:
        wanted[method].append("algebra")
    return {method: {name: exponent(rows, method, name) for name in names} for method, names in wanted.items()}


# --- showing -----------------------------------------------------------------------------------------------------


def draw(result: dict, path: Path) -> None:
    """Four charts over the number of bars, each with n^1 and n^1.2 through the first fitted point."""
    from matplotlib import rcParams
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rcParams.update({"svg.fonttype": "none", "svg.hashsalt": "growth", "font.size": 9})
    figure = Figure(figsize=(9.0, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
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
            curve(axes, *series(rows, method, quantity), scale, found[method][quantity], label, colour, marker)
        axes.set(xscale="log", yscale="log", xlabel="bars", ylabel=unit, title=title)
        axes.minorticks_off()
        axes.grid(color="#dddddd", linewidth=0.6)
        if axes.lines:
            axes.legend(frameon=False, fontsize=8, loc="upper left")
            axes.set_ylim(top=30.0 * axes.get_ylim()[1])  # room for the legend
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path.with_suffix(".png"), dpi=110, metadata={"Software": None})
    figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})


def curve(axes, n, value, scale, power, label, colour, marker) -> None:
    """Measured points, and the two slopes from the first of those that the fit uses."""
    if not len(n):
        return
    shown = label if power is None else f"{label}, fitted n^{power:.2f}"
    axes.plot(3 * n, scale * value, marker, color=colour, markersize=5, label=shown)
    start = int(np.argmax(n >= FIT_FROM))
    for slope, style in ((1.0, "-"), (LIMIT, ":")):
        line = scale * value[start] * (n[start:] / n[start]) ** slope
        named = f"n^{slope:g}" + (" (limit)" if slope == LIMIT else " (theory)")
        known = named in [old.get_label() for old in axes.lines]
        axes.plot(3 * n[start:], line, style, color="#777777", linewidth=1.0, zorder=1, label="_" if known else named)


def report(result: dict) -> str:
    """docs/growth.md: the figure in two sentences, and how to draw it again."""
    rows, found, where = result["rows"], result["exponents"], result["machine"]
    largest = max(r["bars"] for r in rows)
    last = {r["method"]: r for r in rows if r["bars"] == largest}

    def listed(texts):
        return ", ".join(texts[:-1]) + " and " + texts[-1]

    def power(quantity, methods=METHODS):
        return ["not fitted" if found[m][quantity] is None else f"n^{found[m][quantity]:.2f}" for m in methods]

    steps = listed([f"{1e6 * last[m]['step']:.0f}" for m in METHODS])
    names = listed([label.split("(")[1].rstrip(")") for label in METHODS.values()])
    lines = [
        "# Growth",
        "",
        "![Time and memory against the number of bars](figures/growth.png)",
        "",
        "A tower of n stages has 3 n bars that meet only through strings, so by theory a step, a transition and the memory "
        f"cost a constant times n; from {3 * FIT_FROM} to {largest} bars {names} grow with {listed(power('step'))} per "
        f"accepted step and {listed(power('transition'))} per transition, and the memory with "
        f"{power('memory', ['dop853'])[0]}, where n^{LIMIT:g} is the limit that we set.  "
        f"With {largest} bars a step takes {steps} \u00b5s and a simulation holds "
        f"{1e-6 * last['dop853']['memory']:.0f} MB (one thread, {where['processor']}, commit {where['commit']}, "
        f"{where['date']}; the figures stand in [growth.json](growth.json)).",
        "",
        "Where the matrices of an implicit step outgrow the processor's caches, its time per bar rises once to what memory "
        "delivers, which the fit takes for growth; [scene-costs.md](scene-costs.md) measures both levels.",
        "",
        "Drawn by `python benchmarks/growth.py`, which also says what was measured and how; `--redraw` draws it again from "
        "that file.",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stages", type=int, nargs="+", default=STAGES)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--output", type=Path, default=ROOT / "docs")
    parser.add_argument("--redraw", action="store_true", help="draw growth.json again, without measuring")
    options = parser.parse_args()
    data = options.output / "growth.json"
    if options.redraw:
        result = json.loads(data.read_text(encoding="utf-8"))
    else:
        result = collect(tuple(options.stages), options.rounds)
        options.output.mkdir(parents=True, exist_ok=True)
        data.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    draw(result, options.output / "figures" / "growth")
    text = report(result)
    (options.output / "growth.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
