"""Order collapse at transitions: each method's error against its step, with the transitions located and stepped across.

python -m benchmarks.stability.order [--redraw]
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.harness import page as common
from benchmarks.harness import problems
from tensegrity_core.errors import SimulationError
from tensegrity_core.kernel import Kernel

SCENE, INSTANTS = "three_bar", 20
#: Error, m, at which the work is compared.
TARGET = 1e-8
#: Order of each method's step, and of its state at a transition, which comes from the dense output: that of Radau IIA with five
#: stages is the collocation polynomial, wrong by h^6; those of the others are as good as their steps.
ORDERS = {"rk4": 4, "ros2": 2, "dop853": 8, "rodas5p": 5, "radau9": 9}
LOCATED = ORDERS | {"radau9": 6}
#: Methods whose step is held at max_step, and those whose tolerance is varied.
STEPPED = tuple(ORDERS)
SWEPT = ("dop853", "rodas5p", "radau9", "auto")
#: A tolerance that leaves max_step in charge, and the tightest one.
LOOSE, TIGHTEST = 0.1, 1e-12
TOLERANCES = tuple(10.0 ** np.arange(-2.0, -12.1, -0.5))
#: Steps per interval between two instants.
DIVISIONS = tuple(int(n) for n in np.unique(np.round(np.geomspace(3, 512, 25))))
#: Transitions reach order 1 where the force jumps (d > 0) and 2 where only its slope does (d = 0).
CASES = ({"damping": 50.0, "duration": 1.0, "limit": 1}, {"damping": 0.0, "duration": 0.3, "limit": 2})


class Outcome(NamedTuple):
    """error: largest deviation of the free nodes at the instants, m, nan where the run failed; counts of the run."""

    error: float
    steps: int
    rhs: int
    rejected: int
    transitions: int


def positions(kernel: Kernel, force: np.ndarray, duration: float, located: bool = True) -> np.ndarray:
    """(INSTANTS, N * D) m: node positions after equal parts of the duration under a constant force."""
    kernel["force"][:] = force
    kernel.locate_transitions(located)
    kernel.initialize()
    rows = []
    for _ in range(INSTANTS):
        kernel.step(duration / INSTANTS)
        rows.append(kernel["position"].copy())
    return np.array(rows)


class Case:
    """The pushed scene at one damping, with a reference of the two methods of highest order at the tightest tolerance."""

    def __init__(self, damping: float, duration: float):
        self.duration = duration
        problem = problems.pushed(SCENE, damping)
        self.model, self.force = problem.model, problem.kernel_force
        runs = {m: Kernel(self.model, method=m, tolerance=1e-13) for m in ("dop853", "radau9")}
        paths = {m: positions(kernel, self.force, duration) for m, kernel in runs.items()}
        self.exact = paths["dop853"]
        self.doubt = float(np.abs(paths["radau9"] - self.exact).max())
        self.transitions = runs["dop853"].stats["transitions"]

    def run(self, method: str, located: bool, tolerance: float = LOOSE, max_step: float = 0.0) -> Outcome:
        kernel = Kernel(self.model, method=method, tolerance=tolerance, max_step=max_step)
        try:
            error = float(np.abs(positions(kernel, self.force, self.duration, located) - self.exact).max())
        except SimulationError:
            error = float("nan")
        stats = kernel.stats
        return Outcome(error, stats["steps"], stats["rhs"], stats["rejected"], stats["transitions"])


def holding_tolerance(method: str, n: int, located: bool) -> float:
    """A tolerance that leaves max_step in charge at n steps per interval.

    It also ends the Newton iteration of radau9, so there it falls as that method's error estimate does, with the sixth power of
    the step: the iteration's error then falls faster than the method's.  Across transitions theirs is the larger."""
    if method == "radau9" and located:
        return max(LOOSE * (DIVISIONS[0] / n) ** 6, TIGHTEST)
    return LOOSE


def stepped(case: Case, method: str, located: bool, divisions=DIVISIONS) -> dict:
    """Error against the step of a method held at max_step."""
    steps = [case.duration / INSTANTS / n for n in divisions]
    rows = [case.run(method, located, holding_tolerance(method, n, located), h) for n, h in zip(divisions, steps)]
    return {"method": method, "located": located, "by": "step", "step": steps, **columns(rows)}


def swept(case: Case, method: str, located: bool, tolerances=TOLERANCES) -> dict:
    """Error against tolerance, and against the mean step that it leads to."""
    rows = [case.run(method, located, tolerance=tolerance) for tolerance in tolerances]
    steps = [case.duration / row.steps if row.steps else float("nan") for row in rows]
    return {"method": method, "located": located, "by": "tolerance", "tolerance": tolerances, "step": steps, **columns(rows)}


def columns(rows: list[Outcome]) -> dict:
    return {name: [getattr(row, name) for row in rows] for name in Outcome._fields}


def slope(steps, errors, floor: float, roof: float = 3e-3) -> float:
    """Least squares slope of log error on log step, where the error lies between floor and roof; nan below 3 points."""
    h, e = common.numbers(steps), common.numbers(errors)
    with np.errstate(invalid="ignore"):
        chosen = (e > floor) & (e < roof)
    if chosen.sum() < 3:
        return float("nan")
    return float(np.polyfit(np.log(h[chosen]), np.log(e[chosen]), 1)[0])


def measure() -> dict:
    cases = []
    for setting in CASES:
        case = Case(setting["damping"], setting["duration"])
        curves = []
        for located in (True, False):
            curves += [stepped(case, method, located) for method in STEPPED]
            curves += [swept(case, method, located) for method in SWEPT]
        # below the floor it is the reference that is seen, and round-off
        floor = max(30.0 * case.doubt, 1e-12)
        for curve in curves:
            # across transitions the errors scatter: a low roof would cut the upper half off and flatten the line
            curve["slope"] = slope(curve["step"], curve["error"], floor, roof=3e-3 if curve["located"] else 0.3)
        cases.append({**setting, "doubt": case.doubt, "transitions": case.transitions, "curves": curves})
    return {"scene": SCENE, "cases": cases}


# ------------------------------------------------------------------------------------------------------------- figure

COLOUR = dict(zip((*ORDERS, "auto"), common.COLOURS))
MARKER = dict(zip((*ORDERS, "auto"), "osD^vx"))


def chosen(case: dict, located: bool, by: str) -> list[dict]:
    return [curve for curve in case["curves"] if curve["located"] == located and curve["by"] == by]


def reference_line(axes, steps, errors, order: float, colour: str) -> None:
    """h^order through the median of the errors that lie between 1e-10 and 1e-3 m (their geometric middle)."""
    h, e = common.numbers(steps), common.numbers(errors)
    with np.errstate(invalid="ignore"):
        inside = (e > 1e-10) & (e < 1e-3)
    if not inside.any():
        return
    factor = np.exp(np.median(np.log(e[inside]) - order * np.log(h[inside])))
    ends = np.array([h[inside].min() * 0.7, h[inside].max() * 1.4])
    axes.plot(ends, factor * ends**order, color=colour, lw=1.0)


def draw_steps(axes, case: dict, located: bool) -> None:
    everything = chosen(case, located, "step")
    for curve in everything:
        name = curve["method"]
        axes.plot(curve["step"], common.numbers(curve["error"]), MARKER[name], color=COLOUR[name], ms=3, mfc="none", mew=0.8)
        if located:
            reference_line(axes, curve["step"], curve["error"], LOCATED[name], COLOUR[name])
    if not located:
        steps = np.concatenate([common.numbers(c["step"]) for c in everything])
        errors = np.concatenate([common.numbers(c["error"]) for c in everything])
        reference_line(axes, steps, errors, case["limit"], common.COLOURS[0])
    axes.set(xscale="log", yscale="log", ylim=(1e-14, 1.0), xlabel="step, s")


def draw_work(axes, case: dict) -> None:
    for curve in (*chosen(case, True, "tolerance"), *chosen(case, False, "tolerance")):
        name = curve["method"]
        style = {"color": COLOUR[name], "ms": 3, "mfc": COLOUR[name] if curve["located"] else "none", "mew": 0.8}
        axes.plot(curve["rhs"], common.numbers(curve["error"]), MARKER[name], **style)
    axes.set(xscale="log", yscale="log", ylim=(1e-14, 1.0), xlabel="right-hand sides, over tolerances of 1e-2 … 1e-12")


def draw(data: dict) -> Figure:
    figure = common.new_figure(10.0, 6.8)
    panels = figure.subplots(2, 3, sharey=True)
    for row, case in zip(panels, data["cases"]):
        d, limit = case["damping"], case["limit"]
        head = f"d = {d:g} N s/m, {case['transitions']} transitions in {case['duration']:g} s"
        draw_steps(row[0], case, True)
        draw_steps(row[1], case, False)
        draw_work(row[2], case)
        row[0].set(title=f"{head}: located", ylabel="largest error of the nodes, m")
        row[1].set_title(f"stepped across; line: order {limit}")
        row[2].set_title("filled: located; open: stepped across")
    marks = [
        Line2D([], [], color=COLOUR[m], marker=MARKER[m], ls="-", mfc="none", label=f"{m} (line, left: order {p})")
        for m, p in LOCATED.items()
    ]
    marks.append(Line2D([], [], color=COLOUR["auto"], marker=MARKER["auto"], ls="", label="auto"))
    figure.legend(handles=marks, loc="outside lower center", ncols=len(marks))
    return figure


def best(case: dict, located: bool) -> float:
    """The smallest error of any run with a held step, m."""
    return float(np.nanmin([np.nanmin(common.numbers(c["error"])) for c in chosen(case, located, "step")]))


def work(case: dict, located: bool, error: float) -> dict[str, float]:
    """Fewest right-hand sides of each method under step size control that reach an error (m); inf where none does."""
    found = {}
    for curve in chosen(case, located, "tolerance"):
        enough = common.numbers(curve["error"]) <= error
        found[curve["method"]] = float(np.min(common.numbers(curve["rhs"])[enough], initial=np.inf))
    return found


def with_slopes(case: dict) -> dict:
    """The case with each method's slopes, located and across, and all that are known of those across."""
    located, across = ({c["method"]: c["slope"] for c in chosen(case, kind, "step")} for kind in (True, False))
    both = {method: (located[method], across[method]) for method in ORDERS}
    return case | {"slopes": both, "across": [value for value in across.values() if value is not None]}


def words(data: dict) -> dict:
    """What the page says of these data."""
    jump, kink = map(with_slopes, data["cases"])
    here, there = (work(jump, located, TARGET) for located in (True, False))
    found = [n == jump["transitions"] for curve in chosen(jump, True, "tolerance") for n in curve["transitions"]]
    known = [(ORDERS[m], case["slopes"][m][0]) for case in (jump, kink) for m in ORDERS if m != "radau9"]
    return {
        "jump": jump,
        "kink": kink,
        "orders": ORDERS,
        "shortfall": max(abs(slope - order) for order, slope in known if slope is not None),
        "cost": [there[m] / here[m] for m in SWEPT],
        "found": sum(found),
        "runs": len(found),
        "best_located": best(jump, True),
        "best_across": best(jump, False),
        "target": TARGET,
        "loose": LOOSE,
    }


STUDY = common.Study(__doc__, "order", measure, draw, words)

if __name__ == "__main__":
    STUDY.main()
