"""Work and memory against size: ``python benchmarks/growth.py`` writes docs/growth.json, docs/growth.md and the figure.

Towers of n stages (3 n bars) stand still and are pushed at the top: 45 N down on each of the last three nodes, 20 N aside
on the first of them, for 0.1 s, which no wave needs to run down a tall tower.  A light prestress lets strings go slack (there
are transitions), a high one keeps all of them taut.  For the explicit and the L-stable method:

* time per accepted step: of the taut run;
* time per transition: what the slack run takes longer than the taut one, over its transitions;
* time per right-hand side: the explicit method's taut run over its right-hand sides, so with the vector work of a stage;
* linear algebra (L-stable method): the taut run less its right-hand sides, over its factorisations, so Jacobian,
  factorisation and solves together;
* memory: the kernel's own figure where it gives one, else what a fresh process grows by (below 1 MB mostly chance).

Runs are interleaved, in rounds; a time is the median of all runs.  Exponents are fitted from FIT_FROM stages on.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from ctypes import c_size_t, c_void_p
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

import machine  # noqa: E402

from tensegrity_core.kernel import Kernel, load_library  # noqa: E402
from tensegrity_core.model import Model, to_bytes  # noqa: E402
from tensegrity_core.statics import build_model  # noqa: E402
from tensegrity_core.towers import tower  # noqa: E402

STAGES = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
METHODS = {"dop853": "explicit (DOP853)", "rodas5p": "L-stable (Rodas5P)"}
TOLERANCE, DURATION, INSTANTS = 1e-6, 0.1, 4
DOWN, ASIDE = -45.0, 20.0  # N
LIGHT, HIGH = 40.0, 400.0  # N, of the saddle strings
ROUND = 0.02  # s
FIT_FROM = 10
LIMIT = 1.2

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


def resident() -> int | None:
    """Bytes of memory that this process holds; None where the system does not say."""
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return None


def memory_of(packed: bytes) -> dict:
    """{bytes, source} of a kernel that has made one run; called in a process of its own."""
    library = load_library()
    before = resident()
    kernel = Kernel(packed)
    if hasattr(library, "ts_memory_size"):
        size = library.ts_memory_size
        size.restype, size.argtypes = c_size_t, (c_void_p,)
        return {"bytes": size(kernel._sim), "source": "kernel"}
    kernel.initialize()
    kernel.step(1e-3)
    return {"bytes": None if before is None else resident() - before, "source": "process"}


def memory(model: Model, method: str) -> dict:
    """The same in a fresh process, in which nothing else has left memory to reuse."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.bin"
        path.write_bytes(to_bytes(model, method=method, tolerance=TOLERANCE))
        command = [sys.executable, str(Path(__file__).resolve()), "--memory-of", str(path)]
        return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


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
            used = memory(models[n, LIGHT], method)
            rows.append(row(n, method, cases[n, method, HIGH], cases[n, method, LIGHT], rhs, used))
            print(f"{n:5d} stages, {method}: {1e6 * rows[-1]['step']:.1f} us per step", file=sys.stderr)
    return rows


def row(stages: int, method: str, taut: Case, slack: Case, rhs: float, used: dict) -> dict:
    """What the runs of one tower by one method say; times in s."""
    smooth, broken = taut.kernel.stats, slack.kernel.stats
    comparable = stages > 1 and smooth["transitions"] == 0 and broken["transitions"] > 0
    algebra = (taut.time - smooth["rhs"] * rhs) / smooth["factorisations"] if smooth["factorisations"] else None
    return {
        "stages": stages,
        "bars": 3 * stages,
        "strings": taut.kernel.counts["S"],
        "method": method,
        "step": taut.time / smooth["steps"],
        "transition": (slack.time - taut.time) / broken["transitions"] if comparable else None,
        "rhs": rhs,
        "algebra": algebra,
        "memory": used["bytes"],
        "memory_source": used["source"],
        "taut": {"seconds": taut.time, **smooth},
        "slack": {"seconds": slack.time, **broken},
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
    wanted["rodas5p"].append("algebra")
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
    charts.append([("rhs", "dop853", "right-hand side"), ("algebra", "rodas5p", "Jacobian, factorisation, solves")])
    charts.append([("memory", method, label) for method, label in METHODS.items()])
    titles = [("per accepted step", 1e6, "\u00b5s"), ("per transition", 1e6, "\u00b5s")]
    titles += [("parts of a step", 1e6, "\u00b5s"), ("memory", 1e-6, "MB")]
    for axes, curves, (title, scale, unit) in zip(figure.subplots(2, 2).flat, charts, titles):
        for (quantity, method, label), colour, marker in zip(curves, ("#1f5fa8", "#c2571a"), "os"):
            curve(axes, *series(rows, method, quantity), scale, found[method][quantity], label, colour, marker)
        axes.set(xscale="log", yscale="log", xlabel="bars", ylabel=unit, title=title)
        axes.minorticks_off()
        axes.grid(color="#dddddd", linewidth=0.6)
        if axes.lines:
            axes.legend(frameon=False, fontsize=8, loc="upper left")
            axes.set_ylim(top=8.0 * axes.get_ylim()[1])  # room for the legend
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

    def power(quantity):
        texts = ["not fitted" if found[m][quantity] is None else f"n^{found[m][quantity]:.2f}" for m in METHODS]
        return " and ".join(texts)

    steps = " and ".join(f"{1e6 * last[m]['step']:.0f}" for m in METHODS)
    memories = [last[m]["memory"] for m in METHODS]
    held = "not known here" if None in memories else " and ".join(f"{1e-6 * used:.0f}" for used in memories) + " MB"
    lines = [
        "# Growth",
        "",
        "![Time and memory against the number of bars](figures/growth.png)",
        "",
        "A tower of n stages has 3 n bars that meet only through strings, so by theory a step, a transition and the memory "
        f"cost a constant times n; from {3 * FIT_FROM} to {largest} bars the explicit and the L-stable method grow with "
        f"{power('step')} per accepted step, {power('transition')} per transition and {power('memory')} in memory, where "
        f"n^{LIMIT:g} is the limit that we set.  With {largest} bars a step takes {steps} \u00b5s and the kernel holds {held} "
        f"(one thread, {where['processor']}, commit {where['commit']}, {where['date']}; the figures stand in [growth.json](growth.json)).",
        "",
        "Drawn by `python benchmarks/growth.py`, which also says what was measured and how.",
        "",
    ]
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stages", type=int, nargs="+", default=STAGES)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--output", type=Path, default=ROOT / "docs")
    parser.add_argument("--memory-of", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.memory_of:
        print(json.dumps(memory_of(options.memory_of.read_bytes())))
        return
    rows = measure(tuple(options.stages), options.rounds)
    result = {
        "machine": machine.describe(),
        "push": {"down": -DOWN, "aside": ASIDE, "duration": DURATION, "tension": [LIGHT, HIGH], "tolerance": TOLERANCE},
        "exponents": exponents(rows),
        "fitted_from_stages": FIT_FROM,
        "rows": rows,
    }
    options.output.mkdir(parents=True, exist_ok=True)
    (options.output / "growth.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    draw(result, options.output / "figures" / "growth")
    text = report(result)
    (options.output / "growth.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
