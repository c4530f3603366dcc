"""The same structure, integrated by the kernel and by importers: ``python -m benchmarks.exchange.run`` writes
docs/model_exchange.json, the page docs/model-exchange.md and its figures.

Problems are those of work_precision; every contender solves them through the calls of FMI, at a ladder of tolerances or steps.
Times are processor times of the integration alone; a library that stands before the FMU's counts the calls (Linux on x86-64).
Needs a C compiler, and the network (PyPI) where PathSim and CasADi are not in build/importers yet.  About 10 minutes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import problems
from benchmarks.harness.page import COLOURS, Page, all_shown, lettered, new_figure, plain, rendered, span
from benchmarks.harness.timing import recorded
from benchmarks.importers import environments
from fmu_src.validation.exchange import TOLERANCE
from tensegrity_core import kernel
from tensegrity_core.files import scratch
from tensegrity_core.model import grid, held

from . import contenders, events, promise
from .contenders import CONTENDERS, Contender

PROBLEMS = (
    "two_bar_nsh/500",
    "three_bar_nsh/50",
    "three_bar_nsh/500",
    "three_bar_nsh/5000",
    "six_bar_nsh/500",
    "three_bar/500",
)
#: Where events are looked at.
LATE_PROBLEMS = ("three_bar_nsh/50", "three_bar_nsh/500", "six_bar_nsh/500")
#: Errors at which contenders are compared, m.
TARGETS = (1e-4, 1e-6, 1e-8)

LOOKS = {
    one.name: {"color": colour, "marker": mark, "markersize": 3.5, "label": one.label}
    for one, colour, mark in zip(CONTENDERS, (*COLOURS, "#000000", "#999999"), "os^xDv+*")
}

# --- measuring ---------------------------------------------------------------------------------------------------


@recorded
def collect() -> dict:
    found: dict = {"problems": {}, "rows": [], "late": {}, "steps": {}}
    with scratch() as folder:
        for name in PROBLEMS:
            problem = problems.problem(name)
            exact, count = reference(problem)
            found["problems"][name] = {"title": f"{name.split('/')[0]}, d = {name.split('/')[1]}", "transitions": count}
            for one in CONTENDERS:
                if one.problems is None or name in one.problems:
                    found["rows"] += ladder(problem, one, exact, folder)
            if name in LATE_PROBLEMS:
                found["late"][name] = events.curve(problem, exact, events.located, events.LATE, folder)
                found["steps"][name] = events.curve(problem, exact, events.stepped, events.STEPS, folder)
        found |= promise.collect(folder)
    return plain(found, 4)


def reference(problem: problems.Problem) -> tuple[np.ndarray, int]:
    """(instants, n) m: the judged nodes by radau9 at 1e-13; and how many transitions there are."""
    inputs = held(problem.model, grid(problem.duration, problem.duration / problems.INSTANTS), force=lambda t: problem.force)
    right = kernel.simulate(problem.model, inputs, method="radau9", tolerance=1e-13)
    positions = right.position[1:, problem.judged][:, :, list(problem.model.axes)]
    return positions.reshape(problems.INSTANTS, -1), len(right.transitions)


def ladder(problem: problems.Problem, one: Contender, exact: np.ndarray, folder: Path) -> list[dict]:
    """A row per setting; prints them."""
    fmu, rows = contenders.counted(contenders.packed(problem, one.kind, folder), folder), []
    told = contenders.job(problem, fmu, one)
    for settings in [(setting,) for setting in one.settings] if one.alone else [one.settings]:
        try:
            runs, lines = contenders.run(one, told, settings)
        except environments.Missing as missing:
            return [{"problem": problem.name, "contender": one.name, "failure": str(missing)}]
        totals = [summed(lines)] if one.alone else lines if len(lines) == len(settings) else [{}] * len(settings)
        for setting, run, total in zip(settings, runs, totals):
            row = {"problem": problem.name, "contender": one.name, "setting": setting, "failure": run["failure"]}
            row["error"] = contenders.error(run, exact)
            row["ms_per_s"] = 1e3 * run["seconds"] / problem.duration if run["seconds"] else None
            rows.append(row | calls(total, one))
            print(f"{problem.name:<20}{one.name:<12}{setting:<9g}{row['error']} m, {row['ms_per_s']} ms", flush=True)
    return rows


def summed(lines: list[dict]) -> dict:
    return {name: sum(line.get(name, 0) for line in lines) for name in {name for line in lines for name in line}}


def calls(total: dict, one: Contender) -> dict:
    """Calls of all functions, evaluations of the equations of motion, events and transitions, as the counting library tells."""
    if not total:
        return {}
    own = total["rhs"] if one.kind == "cs" else total.get("GetDerivatives") or total.get("GetReal", 0)
    return {
        "calls": sum(number for name, number in total.items() if name not in ("rhs", "transitions")),
        "rhs": own,
        "directional": total.get("GetDirectionalDerivative", 0),
        "indicators": total.get("GetEventIndicators", 0),
        "events": total.get("EnterEventMode", 0),
        "transitions": total["transitions"],
    }


# --- showing -----------------------------------------------------------------------------------------------------


def of(data: dict, problem: str, contender: str) -> list[dict]:
    """Rows with an error."""
    rows = (row for row in data["rows"] if (row["problem"], row["contender"]) == (problem, contender))
    return [row for row in rows if row.get("error")]


def cheapest(data: dict, problem: str, contender: str, error: float, quantity: str = "ms_per_s") -> float | None:
    """The least of a quantity among the settings that reach an error."""
    return min((row[quantity] for row in of(data, problem, contender) if row["error"] <= error and row[quantity]), default=None)


def draw_work(data: dict) -> Figure:
    """Error over time and over evaluations, three problems."""
    figure = new_figure(9.0, 5.6)
    chosen = ("three_bar_nsh/50", "three_bar_nsh/500", "six_bar_nsh/500")
    axes = figure.subplots(2, 3, sharey=True)
    for column, problem in zip(axes.T, chosen):
        for ax, quantity, label in zip(column, ("ms_per_s", "rhs"), ("ms per simulated second", "evaluations")):
            for one in CONTENDERS:
                rows = [row for row in of(data, problem, one.name) if row.get(quantity)]
                ax.loglog([row[quantity] for row in rows], [row["error"] for row in rows], **LOOKS[one.name])
            ax.set(xlabel=label, title=data["problems"][problem]["title"], ylim=(1e-12, 3.0))
    for ax in axes[:, 0]:
        ax.set_ylabel("error, m")
    figure.legend(*axes[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    lettered(axes)
    return figure


def draw_events(data: dict) -> Figure:
    """Error over how late an event is seen, and over the step of a host that sees it at its end."""
    figure = new_figure(9.0, 3.2)
    left, right = axes = figure.subplots(1, 2, sharey=True)
    for ax, part in ((left, "late"), (right, "steps")):
        for (name, found), colour in zip(data[part].items(), COLOURS):
            kept = [(x, y) for x, y in zip(found["settings"], found["errors"]) if y]
            ax.loglog(*zip(*kept), "o-", color=colour, markersize=3, label=data["problems"][name]["title"])
    left.set(xlabel="tolerance of events, s", ylabel="error, m", title="events located to a tolerance")
    right.set(xlabel="step, s", title="Runge-Kutta steps, events seen at their ends")
    left.legend(loc="upper left")
    lettered(axes)
    return figure


def cell(data: dict, problem: str, contender: str, error: float) -> str:
    """Least time and evaluations."""
    milliseconds = cheapest(data, problem, contender, error)
    if milliseconds is None:
        return "–"
    return f"{milliseconds:.3g} ({cheapest(data, problem, contender, error, 'rhs')})"


def seen(data: dict, problem: str, contender: str) -> str:
    """Transitions, over the settings."""
    counts = [row["transitions"] for row in of(data, problem, contender) if "transitions" in row]
    return span(counts) if len(set(counts)) > 1 else str(counts[0]) if counts else "–"


def failures(data: dict) -> list[str]:
    """One line a contender and problem."""
    found: dict = {}
    for row in data["rows"]:
        if row.get("failure"):
            found.setdefault((row["contender"], row["problem"], row["failure"]), []).append(row.get("setting"))
    labels = {one.name: one.label for one in CONTENDERS}
    last = {words: words.rpartition(": ")[2] for _, _, words in found}
    return [
        f"{labels[name]}, {data['problems'][problem]['title']}, at {all_shown(settings, 'g')}: “{last[words]}”"
        for (name, problem, words), settings in found.items()
    ]


def report(data: dict) -> str:
    """docs/model-exchange.md."""
    slopes = [
        e / late for found in data["late"].values() for late, e in zip(found["settings"], found["errors"]) if late == 1e-6
    ]
    pairs = [[cheapest(data, name, one, 1e-6) for one in ("simulated", "kernel")] for name in data["problems"]]
    ratios = [slow / fast for slow, fast in pairs if slow and fast]
    return rendered(
        "exchange/page",
        **data,
        contenders=CONTENDERS,
        targets=TARGETS,
        cell=cell,
        seen=seen,
        all=data,
        slope=1e-6 * max(slopes),
        tolerance=TOLERANCE,
        least=min(ratios),
        most=max(ratios),
        failures=failures(data),
    )


PAGE = Page(
    __doc__, "model_exchange", collect, report, {"model_exchange_work": draw_work, "model_exchange_events": draw_events}
)

if __name__ == "__main__":
    PAGE.main()
