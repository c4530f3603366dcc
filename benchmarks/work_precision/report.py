"""The text of the work-precision benchmark, docs/work-precision.md, from its data."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.harness.page import rendered

from . import figures, nsh, targets
from .data import TARGET, fastest, grouped, metres, of_kind, ratio, ratios

#: Errors, m, at which free flight and MuJoCo's problem are compared.
FLIGHT, MUJOCO = 1e-7, (1e-4, 1e-6)
TABLES = {
    "ARKODE_CASH_KARP_6_4_5": "Cash-Karp 5(4)",
    "ARKODE_DORMAND_PRINCE_7_4_5": "Dormand-Prince 5(4)",
    "ARKODE_VERNER_8_5_6": "Verner 6(5)",
    "ARKODE_FEHLBERG_13_7_8": "Fehlberg 8(7)",
    "ARKODE_ESDIRK436L2SA_6_3_4": "ESDIRK 4(3)",
    "ARKODE_ESDIRK547L2SA2_7_4_5": "ESDIRK 5(4)",
    "ARKODE_KVAERNO_7_4_5": "Kvaerno 5(4)",
}


def label(row: dict) -> str:
    """How a run's method is called."""
    family, method = row["family"], row["method"]
    if family == "kernel":
        return f"`{method}`"
    if family in ("scipy", "mujoco"):
        return f"{'SciPy' if family == 'scipy' else 'MuJoCo'} {method}"
    if method.startswith("cvode"):
        name = "CVODE BDF" if method == "cvode_bdf" else "CVODE Adams"
    else:
        kind, _, of = method.partition("_")
        names = {"erk": "explicit", "dirk": "implicit"}
        name = "ARKODE " + (TABLES.get(of) or f"{names[kind]}, order {of}")
    return name + (", plain" if family == "plain" else "")


def number(x: float) -> str:
    return f"{x:.2g}" if x < 100 else f"{x:.0f}"


def span(values: list[float], unit: str = "") -> str:
    """'1.2 to 3.4 ms'."""
    low, high = number(min(values)), number(max(values))
    return f"{low}{unit}" if low == high else f"{low} to {high}{unit}"


def sentence(*clauses: str) -> str:
    """Of the clauses that have something to say; '' where none has."""
    said = "; ".join(clause for clause in clauses if clause)
    return f"{said[0].upper()}{said[1:]}." if said else ""


def times(values: list[float], text: str) -> str:
    """The text, with the span in the place of {}; '' where nothing was measured."""
    return text.format(span(values)) if values else ""


def closest(rows: list[dict], who: str) -> str:
    """The smallest error of a contender; of a ladder that the time limit cut, it is only the last one reached."""
    known = [row for row in rows if row["error"]]
    if not known:
        return f"{who} solve nothing within the time limit" if rows else ""
    best = min(known, key=lambda row: row["error"])
    how = "within the time limit" if best["cut"] else "at best"
    return f"{who} come to {best['error']:.2g} m {how}"


def order(rows: list[dict]) -> float | None:
    """Measured: the slope of log error over log step, by least squares of the runs with errors below 1 cm."""
    points = [(row["setting"], row["error"]) for row in rows if row["error"] and row["error"] < 1e-2]
    if len(points) < 3:
        return None
    step, error = np.log(np.array(points)).T
    return float(np.polyfit(step, error, 1)[0])


def orders(mujoco: list[dict]) -> list[str]:
    """Of MuJoCo's integrators that have one."""
    found = {method: order(rows) for method, rows in grouped(mujoco, lambda row: row["method"]).items()}
    return [f"{method} {p:.1f}" for method, p in found.items() if p is not None]


def transitions(result: dict, name: str, kind: str) -> list[int]:
    """How many a kind of contenders found in a problem, by each run with root finding and a tolerance of 1e-4 to 1e-12."""
    runs = [row for row in of_kind(result["rows"], [name], kind) if row["events"] and row["kind"] == "tolerance"]
    return [row["transitions"] for row in runs if row["setting"] <= 1.001e-4 and row["error"] is not None]


def witnesses(result: dict) -> dict:
    """How far others are from the reference, m: ours, by method, at most; SUNDIALS's nearest runs, by problem."""
    apart: dict[str, float] = {}
    for about in result["problems"].values():
        for method, difference in about["reference_difference"].items():
            apart[method] = max(apart.get(method, 0.0), difference)
    nearest = {name: [row["error"] for row in of_kind(result["rows"], [name], "sundials")] for name in result["problems"]}
    return {"apart": apart, "nearest": {name: min(filter(None, es)) for name, es in nearest.items() if any(es)}}


def page(result: dict) -> str:
    """docs/work-precision.md."""
    rows, problems, runs = result["rows"], result["problems"], result.get("nsh", [])
    mujoco, drift = (of_kind(rows, [name], kind) for name, kind in (("mujoco_prism", "mujoco"), ("free_flight", "own")))
    by_problem = targets.over_own(result)
    shortfalls = [targets.shortfall(result, damping) for damping in targets.OVER_SUNDIALS]
    longer = {error: ratios(rows, ["mujoco_prism"], "mujoco", "auto", error) for error in MUJOCO}
    constants = {"target": TARGET, "flight": FLIGHT, "errors": targets.ERRORS, "over_own": targets.OVER_OWN}
    functions = {"label": label, "metres": metres, "ratio": ratio, "sentence": sentence, "times": times, "closest": closest}
    return rendered(
        "work_precision/report",
        **result | {"nsh": runs} | constants | functions | witnesses(result),
        limits=sorted({about["limit"] for about in problems.values()}),
        targets=targets.listed(result),
        shortfalls=[found for found in shortfalls if found],
        scipy=targets.scipy_shortfall(result),
        behind=targets.behind(result),
        three_bar=[name for name in problems if name.startswith("three_bar/")],
        by_problem=by_problem,
        own_ratios=targets.known(value for line in by_problem.values() for value in line),
        nsh_costs={damping: nsh.costs(runs, damping) for damping in dict.fromkeys(run["damping"] for run in runs)},
        unstable=figures.UNSTABLE,
        figures=figures.names(result),
        kept=min((row for row in drift if row.get("energy_error")), key=lambda row: row["energy_error"], default=None),
        mujoco=mujoco,
        mujoco_longer={error: values for error, values in longer.items() if values},
        orders=orders(mujoco),
        problems_of=lambda figure: [name for name, about in problems.items() if about["figure"] == figure],
        best=partial(fastest, rows),
        over_auto=partial(ratios, rows),
        rows_of=partial(of_kind, rows),
        transitions=partial(transitions, result),
        milliseconds=lambda names: [run["ms_least"] for name in names if (run := fastest(rows, name, "auto"))],
        names_with=lambda names, family: [n for n in names if any(r["family"] == family for r in rows if r["problem"] == n)],
        reached=lambda names, kind: sum(fastest(rows, name, kind) is not None for name in names),
    )
