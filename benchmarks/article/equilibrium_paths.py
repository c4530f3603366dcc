"""Experiment I solved instead of waited for: ``python -m benchmarks.article.equilibrium_paths`` writes
docs/equilibrium_paths.json, docs/equilibrium-paths.md and docs/figures/path_*, in about 3 minutes.

An upward force of 10 to 72 N in steps of 2 N acts on each top node of the six scenes.  Solved: the slow load's sweep up
from no load and back (steady_states.load_sweep), and the state that each load reaches when it comes suddenly
(steady_states.SuddenLoads).  Waited for: the kernel's dynamics, method auto at tolerance 1e-10, 50 s from the start for
each load; where the structure is not at rest by then, the run goes on.

Times are processor time, the least of interleaved rounds: of the sweep up with all 32 states (from the model on), the same
done carefully (load_sweep(..., careful=True)), of the states under sudden loads, of the 32 runs without output on the way, with
outputs every 0.01 s left in the kernel, and through kernel.simulate, which keeps them.  One thread: set
OPENBLAS_NUM_THREADS=1 on a machine that does other work, too.  How often large steps of the flow after a jump lead elsewhere
than small ones is counted under random forces on all nodes.
"""

from __future__ import annotations

import sys
import time
from functools import partial
from itertools import pairwise

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import machine
from benchmarks.harness.page import Page, new_figure, plain, rendered
from tensegrity_core.article import experiments
from tensegrity_core.equilibria import steady_states
from tensegrity_core.equilibria import sudden as sudden_loads
from tensegrity_core.equilibria.loading import Loading
from tensegrity_core.equilibria.modes import modes
from tensegrity_core.equilibria.paths import follow
from tensegrity_core.kernel import Kernel, simulate
from tensegrity_core.laws import string_law
from tensegrity_core.laws.string_laws import string_laws
from tensegrity_core.model import grid, held
from tensegrity_core.output.path_figures import BEHIND, DOWN, UP, Quantity, curve

SCENES = [name + kind for name in experiments.SYSTEMS for kind in experiments.KINDS]
LOADS = np.array(experiments.LIFTS, dtype=float)  # N on each top node
DURATION, ROW, TOLERANCE = experiments.LIFT_DURATION, experiments.STEP, 1e-10
AT_REST, LONGEST = 1e-9, 2000.0  # m/s, s: how slow, and how long, the runs that go on
LANDINGS = 300  # random loadings
PARTS, BEYOND = 4, 60  # parts in which a path's step is drawn, points of an unstable branch
SAME, AIM = 1e-6, 100  # m, of heights; how many times faster than the runs
ELSEWHERE, DYNAMIC = "#edae49", "#22252e"

# --- measuring ---------------------------------------------------------------------------------------------------------


class Case:
    """A scene under experiment I's loads, solved and waited for."""

    def __init__(self, name: str):
        self.model = experiments.system(name)
        self.top = experiments.top_nodes(self.model)
        self.lift = experiments.upward(self.model, self.top)
        self.loading = Loading(self.model, self.lift)
        self.kernel = Kernel(self.model, tolerance=TOLERANCE)
        self.seconds: dict[str, list[float]] = {}

    def timed(self, what: str, work):
        start = time.process_time()
        found = work()
        self.seconds.setdefault(what, []).append(time.process_time() - start)
        return found

    def sweep(self, careful: bool = False) -> steady_states.Sweep:
        return steady_states.load_sweep(self.loading, [0.0, *LOADS], careful=careful)

    def suddenly(self, known: list[list]) -> list[sudden_loads.Sudden]:
        loads = sudden_loads.SuddenLoads(self.up.equations)
        return [loads.state(load, points) for load, points in zip(LOADS.tolist(), known)]

    def released(self, load: float) -> None:
        free = self.model.free_nodes
        self.kernel["force"][:] = load * self.lift[free][:, list(self.model.axes)].ravel()
        self.kernel.initialize()

    def runs(self, count: int) -> None:
        """All loads, each run in so many steps."""
        for load in LOADS:
            self.released(load)
            for _ in range(count):
                self.kernel.step(DURATION / count)

    def api_runs(self) -> None:
        for load in LOADS:
            force = load * self.lift
            simulate(self.model, held(self.model, grid(DURATION, ROW), force=lambda t, force=force: force), tolerance=TOLERANCE)

    def round(self) -> None:
        self.up = self.timed("sweep", self.sweep)
        self.carefully = self.timed("careful", partial(self.sweep, careful=True))
        known = [sudden_loads.states_at(self.up.paths, load) for load in LOADS.tolist()]
        self.sudden = self.timed("sudden", lambda: self.suddenly(known))
        self.timed("runs", lambda: self.runs(1))
        self.timed("rows", lambda: self.runs(round(DURATION / ROW)))
        self.timed("simulate", self.api_runs)


def height(case: Case, nodes: np.ndarray) -> float:
    """m, mean of the top nodes."""
    return float(nodes[case.top, 2].mean())


def waited(case: Case, load: float) -> dict:
    """Where a run is after 50 s, and where once it is at rest."""
    axes, kernel = list(case.model.axes), case.kernel
    case.released(load)
    found = {}
    while kernel.time < LONGEST:
        kernel.step(DURATION)
        nodes = case.model.nodes.copy()
        nodes[:, axes] = kernel["position"].reshape(len(nodes), -1)
        speed = float(np.abs(kernel["velocity"]).max())
        found.setdefault("speed", speed)
        found.setdefault("nodes_50", nodes)
        found |= {"nodes": nodes, "time": kernel.time, "last_speed": speed, "snapped": int(kernel["snapped"].sum())}
        if speed < AT_REST:
            break
    return found


def snapped(case: Case, point) -> int:
    """Beams past their force maximum, of all honeycombs together."""
    return sum(string_law(case.model, s).snapped_on_piece(int(point.piece[s])) for s in case.model.nsh_strings)


def states(case: Case) -> list[dict]:
    """A row per load: solved, waited for, and how they differ."""
    rows = []
    back = steady_states.load_sweep(case.loading, [*LOADS[::-1], 0.0], case.up.nodes[-1])
    case.back = back
    paths = [*case.up.paths, *back.paths]
    slow, fallen = case.up.nodes[1:], back.nodes[:-1][::-1]
    for load, up, down, sudden in zip(LOADS.tolist(), slow, fallen, case.sudden):
        run, nodes = waited(case, load), case.up.equations.nodes(sudden.point.free)
        heights = {"slow": up, "back": down, "sudden": nodes, "50": run["nodes_50"], "rest": run["nodes"]}
        slowest = modes(case.loading.model_at(load, nodes), load * case.lift)[0]
        known = [p for p in sudden_loads.states_at(paths, load) if p.stable]
        rows.append(
            {
                "load": load,
                **{f"height_{when}": height(case, at) for when, at in heights.items()},
                "difference_50": float(np.abs(nodes - run["nodes_50"])[case.top, 2].max()),
                "difference_rest": float(np.abs(nodes - run["nodes"])[case.top, 2].max()),
                "slow_apart": float(np.abs(nodes - up).max()),
                "back_apart": float(np.abs(nodes - down).max()),
                "speed_50": run["speed"],
                "rest_time": run["time"],
                "rest_speed": run["last_speed"],
                "decided": sudden.time,
                "why": sudden.why,
                "stable_known": len(known),
                "snapped_solved": snapped(case, sudden.point),
                "snapped_run": run["snapped"],
                "frequency": slowest.frequency,
                "decay_rate": slowest.decay_rate,
            }
        )
    return rows


def lines(case: Case, rows: list[dict]) -> dict:
    """What the figure draws: top nodes' mean height over load along stable paths and unstable branches."""

    def drawn(paths):
        found = []
        for path in paths:
            curves = [curve(path, Quantity("", int(node), 2), PARTS) for node in case.top]
            found.append([curves[0][0], np.mean([values for _, values in curves], axis=0)])
        return found

    jumps = {
        name: [
            [j.parameter, *(height(case, sweep.equations.nodes(p.free)) for p in (j.before, j.after)), j.kind]
            for j in sweep.jumps
        ]
        for name, sweep in (("up", case.up), ("back", case.back))
    }
    detours = [p for sweep in (case.up, case.back) for p in steady_states.detours(sweep, BEYOND)]
    apart = [i for i, row in enumerate(rows) if min(row["slow_apart"], row["back_apart"]) > SAME]
    elsewhere = [
        follow(case.loading, float(LOADS[i]), goal, case.up.equations.nodes(case.sudden[i].point.free), stop="unstable")
        for i in apart
        for goal in (LOADS[0], LOADS[-1])
    ]
    curves = {"up": case.up.paths, "back": case.back.paths, "unstable": detours, "elsewhere": elsewhere}
    return plain({name: drawn(paths) for name, paths in curves.items()}, 6) | {"jumps": jumps}


def landings(count: int) -> dict:
    """How often large and small steps of the flow lead to different minima: jumps on the way up to, and back from, 30 N of the
    largest of random forces on all free nodes, in turn of the three scenes with honeycombs."""
    random, jumps, unlike = np.random.default_rng(7), 0, 0
    cases = [Case(name) for name in SCENES if name.endswith("_nsh")]
    for i in range(count):
        model = cases[i % len(cases)].model
        force = np.zeros_like(model.nodes)
        force[np.ix_(model.free_nodes, model.axes)] = random.standard_normal((len(model.free_nodes), len(model.axes)))
        loading, loads, nodes = Loading(model, force / np.abs(force).max()), np.linspace(0.0, 30.0, 16), None
        for side in (1.0, -1.0):
            sweep = steady_states.load_sweep(loading, loads[:: int(side)], nodes)
            nodes = sweep.nodes[-1]
            for path, jump in zip(sweep.paths, sweep.jumps):
                small = steady_states.landing(path, jump.after.parameter, side)
                jumps += 1
                unlike += bool(np.abs(small.free - jump.after.free).max() > SAME)
    return {"jumps": jumps, "unlike": unlike}


def collect(rounds: int) -> dict:
    """All measurements: equilibrium_paths.json."""
    began, where = time.perf_counter(), machine.describe()
    cases = {name: Case(name) for name in SCENES}
    first = time.process_time()
    string_laws(cases["two_bar_nsh"].model)  # made once per process; all scenes have the same honeycombs
    first = time.process_time() - first
    for case in cases.values():
        case.sweep()
    for _ in range(rounds):
        for case in cases.values():
            case.round()
    found = {}
    for name, case in cases.items():
        seconds = {what: min(times) for what, times in case.seconds.items()}
        rows = states(case)
        pairs = list(zip(case.up.jumps, case.carefully.jumps, strict=True))
        alike = {
            "nodes": float(np.abs(case.up.nodes - case.carefully.nodes).max()),
            "jumps": max((abs(a.parameter / b.parameter - 1.0) for a, b in pairs), default=0.0),
        }
        found[name] = {"seconds": seconds, "alike": alike, "states": rows, "lines": lines(case, rows)}
        print(f"{name}: sweep {1e3 * seconds['sweep']:.0f} ms, runs {1e3 * seconds['runs']:.0f} ms", file=sys.stderr)
    return plain(
        {
            "machine": where,
            "rounds": rounds,
            "loads": LOADS,
            "duration": DURATION,
            "row": ROW,
            "tolerance": TOLERANCE,
            "seconds": round(time.perf_counter() - began),
            "first_law": first,
            "landings": landings(LANDINGS),
            "scenes": found,
        },
        12,
    )


# --- showing -----------------------------------------------------------------------------------------------------------


def figure_of(result: dict, name: str) -> Figure:
    """Without and with NSH side by side."""
    figure = new_figure(9.0, 4.2)
    for axes, scene in zip(figure.subplots(1, 2), (name, f"{name}_nsh")):
        panel(axes, result["scenes"][scene])
        axes.set(title=scene, xlabel="height of the top nodes, m", ylabel="force on each top node, N", ylim=(-2.0, 75.0))
        axes.legend(loc="upper left")
    return figure


FIGURES = {f"path_{name}": partial(figure_of, name=name) for name in experiments.SYSTEMS}


def panel(axes, scene: dict) -> None:
    found = scene["lines"]
    for i, (load, value) in enumerate(found["unstable"]):
        axes.plot(value, load, "--", color=BEHIND, linewidth=0.7, label="unstable" if i == 0 else None)
    for way, colour, label in (("up", UP, "load grows slowly"), ("back", DOWN, "load falls slowly")):
        for i, (load, value) in enumerate(found[way]):
            width = 1.6 if way == "up" else 1.0
            axes.plot(value, load, "-", color=colour, linewidth=width, label=label if i == 0 else None)
        for load, before, after, kind in found["jumps"][way]:
            axes.plot([before, after], [load, load], ":", color=colour, linewidth=0.8)
            axes.plot([before], [load], "o" if kind == "limit" else "s", color=colour, markersize=3.0)
    for i, (load, value) in enumerate(found["elsewhere"]):
        axes.plot(value, load, "-", color=ELSEWHERE, linewidth=1.2, zorder=1.8, label="other stable paths" if i == 0 else None)
    heights, loads = zip(*((row["height_rest"], row["load"]) for row in scene["states"]))
    axes.plot(heights, loads, "o", markersize=5.0, markerfacecolor="none", color=DYNAMIC, label="dynamics, sudden load")
    margin = 0.12 * (max(heights) - min(heights))
    axes.set_xlim(min(heights) - 4.0 * margin, max(heights) + margin)


def report(result: dict) -> str:
    """docs/equilibrium-paths.md."""
    scenes = result["scenes"]
    states = {name: scene["states"] for name, scene in scenes.items()}
    seconds = {name: scene["seconds"] for name, scene in scenes.items()}
    ratios = {what: {name: s[what] / s["sweep"] for name, s in seconds.items()} for what in ("runs", "rows", "simulate")}
    return rendered(
        "article/equilibrium_paths",
        **result,
        at_rest=AT_REST,
        same=SAME,
        aim=AIM,
        slowest={name: max(rows, key=lambda row: row["speed_50"]) for name, rows in states.items()},
        snaps={
            name: [(a, b) for a, b in pairwise(rows) if a["snapped_run"] != b["snapped_run"]] for name, rows in states.items()
        },
        counted=[row["snapped_solved"] == row["snapped_run"] for rows in states.values() for row in rows],
        per_load=[1e3 * s["sweep"] / len(states[name]) for name, s in seconds.items()],
        ratios=ratios,
        met={what: [f"`{name}`" for name, ratio in found.items() if ratio >= AIM] for what, found in ratios.items()},
        missed=[name for name, ratio in ratios["simulate"].items() if ratio < AIM],
    )


PAGE = Page(__doc__, "equilibrium_paths", collect, report, FIGURES, {"rounds": 3})

if __name__ == "__main__":
    PAGE.main()
