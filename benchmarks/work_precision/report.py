"""The text of the work-precision benchmark, docs/work-precision.md, from its data."""

from __future__ import annotations

import numpy as np

from benchmarks.harness.page import table, wrapped

from . import figures, nsh, targets
from .data import ADAPTIVE, AUTO, CVODE, OWN, PLAIN, SCIPY, SUNDIALS, TARGET, fastest, metres, ratio, ratios

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


# -------------------------------------------------------------------------------------------------------- each figure


def scene_text(result: dict, scene: str) -> str:
    rows, names = result["rows"], [name for name, about in result["problems"].items() if about["figure"] == scene]
    own = [best["ms_least"] for name in names if (best := fastest(rows, name, **AUTO))]
    across, located = SUNDIALS | {"events": False}, SUNDIALS | {"events": True}
    tried = [name for name in names if any(r["problem"] == name and r["family"] == "cvode" for r in rows)]
    reached = f"{sum(fastest(rows, name, **across) is not None for name in tried)} of {len(tried)}"
    longer = times(ratios(rows, names, across, located), " and then takes {} times as long as with root finding")
    article = [row for row in rows if row["problem"] in names and row["family"] == "article"]
    return " ".join(
        [
            sentence(
                times(own, f"to come within {metres(TARGET)}, `auto` needs {{}} ms per simulated second"),
                times(ratios(rows, names, SUNDIALS, AUTO), "the fastest run of SUNDIALS takes {} times as long"),
                times(ratios(rows, names, SCIPY, AUTO), "the fastest of SciPy over the same compiled right-hand side {} times"),
            ),
            sentence(
                f"across the transitions (dotted), SUNDIALS gets there in {reached} panels{longer}" if tried else "",
                closest(article, "the article's equations, by ode45's method or DOP853,"),
            ),
            sentence(
                times(
                    ratios(rows, names, {"family": "article"}, AUTO, 1e-6),
                    "where both reach 1e-6 m, the article's equations take {} times as long as `auto`",
                )
            ),
        ]
    )


def flight_text(result: dict, name: str) -> str:
    rows = [row for row in result["rows"] if row["problem"] == name]
    about, own = result["problems"][name], fastest(rows, name, FLIGHT, **OWN)
    drift = [row for row in rows if row["family"] == "kernel" and row.get("energy_error")]
    kept = min(drift, key=lambda row: row["energy_error"], default=None)
    first = f"{about['duration']:g} s of spinning, breathing and drifting without dampers"
    return " ".join(
        [
            sentence(
                f"{first}: for {metres(FLIGHT)} {label(own)} needs {own['ms_least']:.2g} ms per simulated second"
                if own
                else first,
                times(ratios(rows, [name], SUNDIALS, OWN, FLIGHT), "the fastest run of SUNDIALS takes {} times as long"),
                times(ratios(rows, [name], SCIPY, OWN, FLIGHT), "the fastest of SciPy {} times"),
            ),
            sentence(
                f"without dampers the energy is constant: within the time limit of {about['limit']:g} s, {label(kept)} keeps "
                f"it to {kept['energy_error']:.2g} of its amount"
                if kept
                else ""
            ),
            "No string goes slack, so nobody looks for transitions; at loose tolerances the others let the bars stretch, and "
            "some of their runs end there.",
        ]
    )


def order(rows: list[dict]) -> float | None:
    """Measured: the slope of log error over log step, by least squares of the runs with errors below 1 cm."""
    points = [(row["setting"], row["error"]) for row in rows if row["error"] and row["error"] < 1e-2]
    if len(points) < 3:
        return None
    step, error = np.log(np.array(points)).T
    return float(np.polyfit(step, error, 1)[0])


def mujoco_text(result: dict, name: str) -> str:
    rows = [row for row in result["rows"] if row["problem"] == name]
    mujoco = [row for row in rows if row["family"] == "mujoco"]
    slower = [times(ratios(rows, [name], {"family": "mujoco"}, AUTO, e), f"{{}} times as long for {metres(e)}") for e in MUJOCO]
    longer = " and ".join(text for text in slower if text)
    methods = dict.fromkeys(row["method"] for row in mujoco)
    orders = {method: order([row for row in mujoco if row["method"] == method]) for method in methods}
    measured = ", ".join(f"{method} {p:.1f}" for method, p in orders.items() if p is not None)
    return " ".join(
        [
            sentence(
                "on a problem that MuJoCo can state (no dampers, so forces do not jump at the "
                f"{result['problems'][name]['transitions']} transitions)"
                + (f", `auto` is the measure: MuJoCo's fastest integrator takes {longer}" if longer else ""),
            ),
            sentence(
                f"measured orders of its integrators across the kinks: {measured}" if measured else "",
                closest(mujoco, "all its runs together") if mujoco else "",
            ),
        ]
    )


def figure_text(result: dict, figure: str) -> str:
    if figure == "free_flight":
        return flight_text(result, "free_flight")
    return mujoco_text(result, "mujoco_prism") if figure == "mujoco" else scene_text(result, figure)


# ------------------------------------------------------------------------------------------------------------- tables


def _time(row: dict | None) -> str:
    return f"{row['ms_least']:.3g} ({label(row)}; {row['rhs']})" if row else "–"


def _over(slow: dict | None, fast: dict | None) -> str:
    return f"**{ratio(slow, fast):.3g}**" if slow and fast else "–"


def three_bar(result: dict) -> list[str]:
    return [name for name in result["problems"] if name.startswith("three_bar/")]


def target_table(result: dict) -> str:
    lines = [[t.what, t.asked, t.reached, "met" if t.met else "**missed**"] for t in targets.listed(result)]
    return table([f"at {metres(TARGET)} on three_bar", "target", "reached", ""], lines)


def ratio_table(result: dict) -> str:
    """three_bar without NSH, a row per damping."""
    rows, lines = result["rows"], []
    for name in three_bar(result):
        auto, own = fastest(rows, name, **AUTO), fastest(rows, name, **ADAPTIVE)
        first = f"{auto['ms_least']:.3g} ({auto['rhs']})" if auto else "–"
        cells = [name.partition("/")[2], first, _time(own), _over(auto, own)]
        for kind in (SUNDIALS, PLAIN, CVODE, SCIPY):
            peer = fastest(rows, name, **kind)
            cells += [_time(peer), _over(peer, auto)]
        lines.append(cells)
    head = (
        "d, N s/m | `auto` | our best other | `auto` / it | best SUNDIALS, all set-ups | / `auto` | best SUNDIALS, plain "
        "set-up | / `auto` | best CVODE | / `auto` | best SciPy | / `auto`"
    )
    return table(head, lines)


def transition_table(result: dict) -> str:
    """three_bar without NSH: transitions that each kind of contender found at tolerances from 1e-4 to 1e-12."""
    lines = []
    kinds = {"tensegrity kernel": OWN, "SUNDIALS, all set-ups": SUNDIALS, "SciPy": SCIPY}
    for label_, kind in kinds.items():
        families = kind["family"] if isinstance(kind["family"], tuple) else (kind["family"],)
        taken = [row for row in result["rows"] if row["family"] in families and row["events"] and row["kind"] == "tolerance"]
        taken = [row for row in taken if row["setting"] <= 1.001e-4 and row["error"] is not None]
        lines.append([label_, *(_counts(result, name, taken) for name in three_bar(result))])
    return table(["", *(f"d = {name.partition('/')[2]}" for name in three_bar(result))], lines)


def _counts(result: dict, name: str, rows: list[dict]) -> str:
    found = [row["transitions"] for row in rows if row["problem"] == name]
    right = sum(count == result["problems"][name]["transitions"] for count in found)
    return f"{', '.join(map(str, sorted(set(found))))} ({right} of {len(found)} runs right)" if found else "–"


def own_table(result: dict) -> str:
    """`auto` over the best of our other adaptive methods, all problems."""
    lines = []
    for name, values in targets.over_own(result).items():
        cells = ["–" if v is None else f"**{v:.2f}**" if v > targets.OVER_OWN else f"{v:.2f}" for v in values]
        lines.append([name, *cells])
    return table(["problem", *(metres(error) for error in targets.ERRORS)], lines)


def nsh_table(result: dict) -> str:
    """three_bar with NSH against without."""
    runs, lines = result["nsh"], []
    for damping in dict.fromkeys(run["damping"] for run in runs):
        cells = [f"{damping:g}"]
        for cost in nsh.costs(runs, damping):
            if cost is None:
                cells += ["–"] * 4
                continue
            cells += [f"{cost.plain:.3g}", f"{cost.nsh:.3g}", f"**{cost.ratio:.2f}**"]
            cells.append(f"{min(cost.ratios):.2f} to {max(cost.ratios):.2f} ({len(cost.ratios)})")
        lines.append(cells)
    head = ["ms per transition-free s", "with NSH", "ratio", "spread", "µs per transition", "with NSH", "ratio", "spread"]
    return table(["d, N s/m", *head], lines)


# --------------------------------------------------------------------------------------------------------------- the page


def missing(result: dict) -> list[str]:
    tools = {"sundials": "SUNDIALS (libsundials-dev)", "mujoco": "MuJoCo"}
    return [
        f"**{what} was not installed: its runs are missing.**"
        for name, what in tools.items()
        if result["machine"][name] == "missing"
    ]


def witnesses(result: dict) -> str:
    """How far others are from the reference."""
    apart: dict[str, float] = {}
    for about in result["problems"].values():
        for method, difference in about["reference_difference"].items():
            apart[method] = max(apart.get(method, 0.0), difference)
    own = " and ".join(f"`{method}` {difference:.1e} m" for method, difference in apart.items())
    text = f"The largest distances from it at the same tolerance, over all problems, are {own}."
    errors: dict[str, float] = {}
    for row in result["rows"]:
        if row["family"] in SUNDIALS["family"] and row["error"]:
            errors[row["problem"]] = min(errors.get(row["problem"], np.inf), row["error"])
    if errors:
        worst = max(errors, key=errors.get)
        text += (
            f" SUNDIALS's nearest runs come within {min(errors.values()):.1e} m to {errors[worst]:.1e} m ({worst}) of it, so "
            "it is not our own methods alone that vouch for the reference."
        )
    return text


def introduction(result: dict) -> list[str]:
    where, settings = result["machine"], result["settings"]
    how = "a quick run (every fourth setting)" if settings["quick"] else "a full run"
    limits = sorted({about["limit"] for about in result["problems"].values()})
    limit = f"{limits[0]:g} s" + (f" (free flight: {limits[-1]:g} s)" if len(limits) > 1 else "")
    return [
        "# Work and precision",
        "Written by `python -m benchmarks.work_precision.run`; the numbers stand in "
        f"[work_precision.json](work_precision.json). {where['processor']}, {where['system']}, Python {where['python']}, "
        f"SciPy {where['scipy']}, SUNDIALS {where['sundials']}, MuJoCo {where['mujoco']}, one thread, commit "
        f"{where['commit']}, {where['date']}; {how} of {result['seconds']} s, load average {where['load']}.",
        "SUNDIALS is only needed here: `apt-get install libsundials-dev` (version 6); MuJoCo comes by `pip install mujoco`. "
        "What is missing is named, and its rows are left out.",
        "Error and time come from the same run. The error is the largest deviation of the top nodes (free flight: of all "
        f"nodes) at 21 instants from our `radau9` at tolerance 1e-13. {witnesses(result)}",
        "Our kernel and SUNDIALS are timed in C, SciPy and MuJoCo around their calls from Python. SUNDIALS and SciPy integrate "
        "the kernel's own right-hand side, SUNDIALS with its analytic Jacobian. The implicit methods of SUNDIALS factorise a "
        "dense matrix of all states, positions and velocities; the kernel eliminates the positions first and factorises "
        "blocks of half that size. With events, they find where a string leaves its piece of the force curve and restart "
        "there; without, they integrate the law with its jumps. Runs of all contenders alternate, in "
        f"{settings['rounds'] + 1} turns; times are processor times. Figures show the median of a setting's runs; "
        "tables and ratios take the least, because what disturbs a run only makes it longer.",
        f"A run, and all first runs of a contender together, may take {limit}. Where that limit ends a ladder, the figure has "
        "an open triangle, and what lies beyond is not known.",
        "SUNDIALS is set up in two ways. *Plain*: what one writes from its manual, CVODE BDF and Adams, ARKODE's own explicit "
        "and implicit tables of order 4 and 5, roots in both directions, `CVodeReInit`, `ERKStepReInit` or `ARKStepReInit` at "
        "each root. *All set-ups* adds what made it faster here: root directions, fused vector operations, `ERKStepReset` and "
        "`ARKStepReset`, which keep the step size, and seven tables chosen by trial, the implicit ones with the predictor that "
        "served them best, two explicit ones mended (benchmarks/peers/arkode.c says how). What counts is the fastest run of "
        "any method at each damping.",
        *missing(result),
    ]


def target_part(result: dict) -> list[str]:
    if not targets.listed(result):
        return []
    reasons = [targets.shortfall(result, damping, label) for damping in targets.OVER_SUNDIALS]
    reasons += [targets.scipy_shortfall(result, label), targets.own_shortfall(result)]
    return [
        "## Targets",
        "What was asked of the speed at the outset. Milliseconds are asked of the machine of a trial, which is not this "
        "one: the aims are half the trial's times.",
        target_table(result),
        *(reason for reason in reasons if reason),
    ]


def three_bar_part(result: dict) -> list[str]:
    if not three_bar(result):
        return []
    return [
        f"## three_bar without NSH: ms per simulated second to come within {metres(TARGET)}",
        "In parentheses the method, and how many right-hand sides that run evaluated. CVODE, with root finding in either "
        "set-up, has columns of its own because it is what most people would take.",
        ratio_table(result),
        "Transitions found at tolerances from 1e-4 to 1e-12:",
        transition_table(result),
    ]


def own_part(result: dict) -> list[str]:
    values = [value for line in targets.over_own(result).values() for value in line if value is not None]
    if not values:
        return []
    over = sum(value > targets.OVER_OWN for value in values)
    return [
        "## `auto` against our other methods",
        "Time of `auto` over that of the fastest of `dop853`, `rodas5p` and `radau9`, each by its fastest run within the "
        f"error: {over} of {len(values)} exceed {targets.OVER_OWN:g} (bold).",
        own_table(result),
    ]


def nsh_part(result: dict) -> list[str]:
    if not result.get("nsh"):
        return []
    return [
        "## What an NSH costs",
        f"three_bar for 1 s by `auto`, at its fastest tolerance within {metres(TARGET)}, under the same parts of the push "
        "with NSH and without. A transition-free second is a run under so small a part (of either sign, a tenth at most) "
        "that no string changes its piece; a transition is what a run under half the push or more takes beyond that, over "
        "its transitions, so with all steps that it shortens. Times are medians over the parts, the ratio is the median of "
        "the ratios part by part, and the spread is their least and largest, with their number.",
        nsh_table(result),
    ]


def figure_part(result: dict) -> list[str]:
    blocks = [
        "## Figures",
        "Others are drawn as what is best of each family; its single ladders stand faint behind. Shaded: beyond the accuracy "
        f"of the reference itself. Runs of fixed step with an error above {figures.UNSTABLE:g} m are near their stability "
        "limit and not joined to the line.",
    ]
    for name in figures.names(result):
        path = f"figures/work_precision_{name}"
        blocks += [f"### {name}", f"![time against error, {name}]({path}.png)", figure_text(result, name)]
    return blocks


def page(result: dict) -> str:
    """docs/work-precision.md."""
    parts = (introduction, target_part, three_bar_part, own_part, nsh_part, figure_part)
    return wrapped("\n\n".join(block for part in parts for block in part(result))) + "\n"
