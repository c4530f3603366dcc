"""Missed events: short excursions of one string that event handling at step ends does not see.

python -m benchmarks.stability.missed [--redraw]
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.harness import page as common
from benchmarks.harness import problems
from benchmarks.peers import native, scipy_compiled, toolchain
from tensegrity_core.files import scratch
from tensegrity_core.kernel import Kernel

#: The graze: a push that only just makes one string go slack, once.  DAMPING: N s/m; DURATION: s, the excursion is inside.
SCENE, DAMPING, DURATION = "three_bar", 50.0, 0.15
#: How far the push is beyond the one that touches, relatively.
EXCESS = tuple(np.geomspace(1e-8, 0.1, 43))
TOLERANCES = tuple(10.0 ** -np.arange(3.0, 12.1, 0.5))
#: s, after which a peer's run counts as failed.
LIMIT = 30.0
#: Standard pushes: damping, N s/m, over 1 s.
PUSHED = (50.0, 500.0, 5000.0)
OURS = ("dop853", "rodas5p", "radau9", "auto")
SCIPY = ("RK45", "DOP853", "LSODA")
SUNDIALS = ("cvode_bdf", "cvode_adams", "erk_ARKODE_DORMAND_PRINCE_7_4_5", "erk_ARKODE_FEHLBERG_13_7_8")


class Found(NamedTuple):
    """transitions: how many a run found, -1 where it failed; steps: accepted ones."""

    transitions: int
    steps: int


class Graze(NamedTuple):
    """problem; depth: how far below its rest length the string gets, m; seconds: how long it is slack;
    curvature: of its elongation there, m/s2."""

    problem: problems.Problem
    depth: float
    seconds: float
    curvature: float


# -------------------------------------------------------------------------------------------------------------- problems


def scaled(problem: problems.Problem, factor: float, duration: float) -> problems.Problem:
    return replace(problem, name=f"{problem.name}*{factor:.12g}", force=factor * problem.force, duration=duration)


def touching(problem: problems.Problem) -> float:
    """Factor of the force at which the first string touches its rest length, by bisection."""
    kernel = Kernel(problem.model, method="dop853", tolerance=1e-13)
    low, high = 0.0, 1.0
    while high - low > 4e-16 * high:
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        kernel["force"][:] = middle * problem.kernel_force
        kernel.initialize()
        kernel.step(problem.duration)
        low, high = (low, middle) if kernel.transition_count else (middle, high)
    return high


def graze(problem: problems.Problem, factor: float) -> Graze:
    """The scaled problem.  Raises ValueError unless a string goes slack and taut once and nothing else happens."""
    it = scaled(problem, factor, problem.duration)
    kernel = Kernel(it.model, method="dop853", tolerance=1e-13)
    kernel["force"][:] = it.kernel_force
    kernel.initialize()
    kernel.step(it.duration)
    events = kernel.transitions
    if len(events) != 2 or events[0].string != events[1].string:
        raise ValueError(f"the push times {factor:.9g} is no single graze: {len(events)} transitions")
    out, back = events
    kernel.initialize()
    kernel.step(0.5 * (out.time + back.time))
    nodes = it.model.nodes.copy()
    nodes[:, it.model.axes] = kernel["position"].reshape(len(nodes), -1)
    first, second = it.model.strings[out.string]
    depth = it.model.rest_length[out.string] - float(np.linalg.norm(nodes[second] - nodes[first]))
    seconds = back.time - out.time
    return Graze(it, depth, seconds, 8.0 * depth / seconds**2)


def grazes() -> list[Graze]:
    problem = scaled(problems.pushed(SCENE, DAMPING), 1.0, DURATION)
    factor = touching(problem)
    return [graze(problem, factor * (1.0 + excess)) for excess in EXCESS]


# --------------------------------------------------------------------------------------------------------------- solvers


def run_ours(problem: problems.Problem, method: str, tolerance: float) -> Found:
    kernel = Kernel(problem.model, method=method, tolerance=tolerance)
    kernel["force"][:] = problem.kernel_force
    kernel.initialize()
    kernel.step(problem.duration)  # one call, so that nothing but the tolerance limits the steps
    return Found(kernel.stats["transitions"], kernel.stats["steps"])


def run_scipy(compiled: scipy_compiled.Compiled, method: str, tolerance: float, duration: float) -> Found:
    """solve_ivp with a terminal event per string, started anew after each."""
    compiled.begin(LIMIT)
    try:
        with np.errstate(all="ignore"):  # a trial step may overflow
            _, counts = scipy_compiled.integrate(compiled, method, tolerance, True, duration)
    except (TimeoutError, RuntimeError, ValueError):
        return Found(-1, 0)
    return Found(counts["transitions"], counts["steps"])


def run_sundials(bench: native.Bench, method: str, tolerance: float) -> Found:
    run = bench.run(method, bench.model, native.DIRECTED, tolerance, 1, LIMIT)
    return Found(-1, 0) if run.failure else Found(run.counts["transitions"], run.counts["steps"])


def contenders(problem: problems.Problem, tools: toolchain.Tools, folder: Path) -> dict[str, Callable[[float], Found]]:
    """name -> run at a tolerance; SUNDIALS only where it is installed."""
    bench = native.Bench(problem, tools, folder)
    compiled = scipy_compiled.Compiled(bench, native.DIRECTED)
    found = {f"ours {m}": lambda tol, m=m: run_ours(problem, m, tol) for m in OURS}
    found |= {f"SciPy {m}": lambda tol, m=m: run_scipy(compiled, m, tol, problem.duration) for m in SCIPY}
    if tools.sundials:
        found |= {short(m): lambda tol, m=m: run_sundials(bench, m, tol) for m in SUNDIALS}
    return found


def short(method: str) -> str:
    """'cvode_bdf' -> 'CVODE BDF', 'erk_ARKODE_FEHLBERG_13_7_8' -> 'ARKODE FEHLBERG 13_7_8'."""
    if method.startswith("cvode_"):
        return "CVODE " + method.removeprefix("cvode_").upper().replace("ADAMS", "Adams")
    return "ARKODE " + method.removeprefix("erk_ARKODE_").replace("_", " ", method.count("_") - 4).title()


# --------------------------------------------------------------------------------------------------------------- measure


def measure_grazes(tools: toolchain.Tools, folder: Path) -> dict:
    cases = grazes()
    runs: dict[str, list] = {}
    for number, case in enumerate(cases):
        for name, run in contenders(case.problem, tools, folder / f"graze{number}").items():
            runs.setdefault(name, []).append([run(tolerance) for tolerance in TOLERANCES])
    found, steps = ({name: np.array(rows)[..., i] for name, rows in runs.items()} for i in range(2))  # (graze, tolerance)
    return {
        **{name: [getattr(case, name) for case in cases] for name in ("depth", "seconds", "curvature")},
        "found": found,
        "step": {name: DURATION / np.maximum(np.median(rows, axis=0), 1) for name, rows in steps.items()},
    }


def measure_pushed(tools: toolchain.Tools, folder: Path) -> list[dict]:
    rows = []
    for damping in PUSHED:
        problem = problems.pushed(SCENE, damping)
        truth = {run_ours(problem, m, 1e-12).transitions for m in ("dop853", "radau9")}
        if len(truth) != 1:
            raise RuntimeError(f"d = {damping:g}: the reference runs disagree: {truth}")
        known = contenders(problem, tools, folder / f"pushed{damping:g}").items()
        counts = {name: [run(tolerance).transitions for tolerance in TOLERANCES] for name, run in known}
        rows.append({"damping": damping, "transitions": truth.pop(), "found": counts})
    return rows


def measure() -> dict:
    with scratch() as folder:
        tools = toolchain.build(folder)
        return {
            "scene": SCENE,
            "damping": DAMPING,
            "duration": DURATION,
            "tolerances": TOLERANCES,
            "sundials": tools.sundials,
            "grazes": measure_grazes(tools, folder),
            "pushed": measure_pushed(tools, folder),
        }


# ---------------------------------------------------------------------------------------------------------------- figure

#: What a run is: its mark, the mark's size and colour.
MARKS = {
    "right": ("o", 1.8, common.COLOURS[2]),
    "missed": ("x", 2.4, common.COLOURS[1]),
    "too many": ("^", 3.0, common.COLOURS[5]),
}


def verdicts(data: dict, name: str) -> dict[str, np.ndarray]:
    """(graze, tolerance) bool each: both transitions were found, fewer (or the run failed), more."""
    found = common.numbers(data["grazes"]["found"][name])
    return {"right": found == 2, "missed": found < 2, "too many": found > 2}


def draw_panel(axes, data: dict, name: str) -> None:
    depth, tolerances = common.numbers(data["grazes"]["depth"]), common.numbers(data["tolerances"])
    x, y = np.meshgrid(tolerances, depth)
    for verdict, chosen in verdicts(data, name).items():
        mark, size, colour = MARKS[verdict]
        axes.plot(x[chosen], y[chosen], mark, color=colour, ms=size, mew=0.7 if mark == "x" else 0.0, rasterized=True)
    h, curvature = common.numbers(data["grazes"]["step"][name]), np.median(data["grazes"]["curvature"])
    axes.plot(tolerances, curvature * h**2 / 8.0, color=common.COLOURS[0], lw=1.0)
    axes.plot(tolerances, tolerances, color=common.COLOURS[0], lw=0.8, ls=":")
    axes.set(xscale="log", yscale="log", title=name, xlim=(2e-3, 5e-13), ylim=(0.4 * depth.min(), 2.5 * depth.max()))


def draw(data: dict) -> Figure:
    names = list(data["grazes"]["found"])
    figure = common.new_figure(10.0, 7.2)
    panels = figure.subplots(3, 4, sharex=True, sharey=True)
    for axes, name in zip(panels.flat, names):
        draw_panel(axes, data, name)
    for axes in panels[-1]:
        axes.set_xlabel("tolerance")
    for axes in panels[:, 0]:
        axes.set_ylabel("depth of the excursion, m")
    labels = {"right": "both transitions found", "missed": "fewer than two: missed", "too many": "more than two"}
    marks = [
        Line2D([], [], color=colour, marker=mark, ls="", ms=1.6 * size, label=labels[verdict])
        for verdict, (mark, size, colour) in MARKS.items()
    ]
    marks += [
        Line2D([], [], color=common.COLOURS[0], label="slack for one mean step: a h²/8"),
        Line2D([], [], color=common.COLOURS[0], ls=":", label="depth = tolerance × 1 m"),
    ]
    for axes in panels.flat[len(names) :]:
        axes.set_axis_off()
    (panels.flat[len(names)] if len(names) < panels.size else panels.flat[0]).legend(handles=marks, loc="center")
    return figure


# ------------------------------------------------------------------------------------------------------------------ page


def resolved(data: dict) -> np.ndarray:
    """(graze, tolerance) bool: the excursion is deeper than the tolerance (times 1 m), so that the solution can show it."""
    return common.numbers(data["grazes"]["depth"])[:, None] > common.numbers(data["tolerances"])[None, :]


class Tally(NamedTuple):
    """Of the excursions deeper than the tolerance: missed, with more than two transitions, and all; deepest one missed, m; the
    tightest tolerance at which one is missed that our reference method finds; how many it finds that ours does not.  most:
    the most transitions that any run found, however shallow the excursion."""

    missed: int
    too_many: int
    all: int
    deepest: float
    tightest: float
    ahead: int
    most: int


def tally(data: dict, name: str) -> Tally:
    of, ours, judged = verdicts(data, name), verdicts(data, "ours auto")["right"], resolved(data)
    depth, tolerances = common.numbers(data["grazes"]["depth"]), common.numbers(data["tolerances"])
    lost = of["missed"] & judged
    behind = (lost & ours).any(axis=0)
    deepest = float(depth[lost.any(axis=1)].max()) if lost.any() else float("nan")
    tightest = float(tolerances[behind].min()) if behind.any() else float("nan")
    most = int(np.max(data["grazes"]["found"][name]))
    too_many, ahead = int((of["too many"] & judged).sum()), int((of["right"] & ~ours & judged).sum())
    return Tally(int(lost.sum()), too_many, int(judged.sum()), deepest, tightest, ahead, most)


def from_on(tolerances, counts, truth: int) -> str:
    """The loosest tolerance from which on every tighter one gives the true count."""
    wrong = np.flatnonzero(np.array(counts) != truth)
    first = wrong[-1] + 1 if len(wrong) else 0
    return f"{tolerances[first]:.0e}" if first < len(tolerances) else "never"


def words(data: dict) -> dict:
    """What the page says of these data."""
    tallies = {name: tally(data, name) for name in data["grazes"]["found"]}
    ours = [t for name, t in tallies.items() if name.startswith("ours")]
    others: dict[str, Tally] = {}
    for name, t in tallies.items():
        family = name.split()[0]
        if family != "ours" and (family not in others or t.missed > others[family].missed):
            others[family] = t
    reached = {
        name: [from_on(data["tolerances"], row["found"][name], row["transitions"]) for row in data["pushed"]]
        for name in tallies
    }
    return {"tallies": tallies, "ours": ours, "others": others, "from_on": reached}


STUDY = common.Study(__doc__, "missed", measure, draw, words)

if __name__ == "__main__":
    STUDY.main()
