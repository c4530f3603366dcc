"""The text of the work-precision benchmark, docs/work-precision.md, from its data."""

from __future__ import annotations

from pathlib import Path

import work_precision_figures as figures
from work_precision_data import ADAPTIVE, AUTO, OWN, PLAIN, SCIPY, SUNDIALS, TARGET, fastest, ratios

COMMAND = "python benchmarks/work_precision.py --redraw"


def _span(values: list[float], unit: str = "") -> str:
    """'1.2 to 3.4 ms'; 'not measured' where there is nothing."""
    if not values:
        return "(not measured)"
    low, high = (f"{x:.2g}" if x < 100 else f"{x:.0f}" for x in (min(values), max(values)))
    return f"{low}{unit}" if low == high else f"{low} to {high}{unit}"


def _smallest(rows: list[dict]) -> list[float]:
    """The smallest error, as a list for `_span`."""
    return [min(row["error"] for row in rows if row["error"])] if any(row["error"] for row in rows) else []


def _table(head: list[str], lines: list[list[str]]) -> list[str]:
    return ["| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *lines)] if lines else []


# -------------------------------------------------------------------------------------------------------- each figure

def scene_text(result: dict, scene: str) -> str:
    """Two sentences from the data."""
    rows, names = result["rows"], [name for name, about in result["problems"].items() if about["figure"] == scene]
    own = [best["ms_per_s"] for name in names if (best := fastest(rows, name, **AUTO))]
    across = SUNDIALS | {"events": False}
    reached = sum(fastest(rows, name, **across) is not None for name in names)
    article = [row for row in rows if row["problem"] in names and row["family"] == "article"]
    return (
        f"To come within {TARGET:g} m, `auto` needs {_span(own, ' ms')} per simulated second; the fastest run of SUNDIALS takes "
        f"{_span(ratios(rows, names, SUNDIALS, AUTO))} times as long, the fastest of SciPy over the same compiled right-hand side "
        f"{_span(ratios(rows, names, SCIPY, AUTO))} times.\n"
        f"Integrated across the transitions (dotted), SUNDIALS gets there in {reached} of {len(names)} panels and then takes "
        f"{_span(ratios(rows, names, across, SUNDIALS | {'events': True}))} times as long as with root finding; the article's "
        f"equations under ode45's method or DOP853 come to {_span(_smallest(article), ' m')} at best, at "
        f"{_span(ratios(rows, names, {'family': 'article'}, AUTO, 1e-6))} times the work of `auto` for 1e-6 m."
    )


def flight_text(result: dict, name: str) -> str:
    rows = [row for row in result["rows"] if row["problem"] == name]
    duration = result["problems"][name]["duration"]
    own = fastest(rows, name, 1e-7, **OWN)
    drift = [row["energy_error"] for row in rows if row["family"] == "kernel" and row.get("energy_error")]
    best = f"`{own['method']}` needs {own['ms_per_s']:.2g} ms per simulated second" if own else "no method of ours was fast enough"
    return (
        f"After {duration:g} s of spinning, breathing and drifting without dampers, {best} for 1e-7 m; the fastest run of SUNDIALS "
        f"takes {_span(ratios(rows, [name], SUNDIALS, OWN, 1e-7))} times as long, the fastest of SciPy "
        f"{_span(ratios(rows, [name], SCIPY, OWN, 1e-7))} times.\n"
        f"Without dampers the energy is constant: our methods keep it to {_span([min(drift)] if drift else [])} of its amount at best."
    )


def mujoco_text(result: dict, name: str) -> str:
    rows = [row for row in result["rows"] if row["problem"] == name]
    mujoco = {"family": "mujoco"}
    return (
        f"On a problem that MuJoCo can state (no dampers, so nothing jumps at the {result['problems'][name]['transitions']} "
        f"transitions), its fastest integrator takes {_span(ratios(rows, [name], mujoco, AUTO, 1e-4))} times as long as `auto` for "
        f"1e-4 m and {_span(ratios(rows, [name], mujoco, AUTO, 1e-6))} times for 1e-6 m.\n"
        f"Its Euler and implicit integrators are of first order; RK4 steps across the kinks, and the best error of any of its runs is "
        f"{_span(_smallest([row for row in rows if row['family'] == 'mujoco']), ' m')}."
    )


def figure_text(result: dict, figure: str) -> str:
    if figure == "free_flight":
        return flight_text(result, "free_flight")
    return mujoco_text(result, "mujoco_prism") if figure == "mujoco" else scene_text(result, figure)


# ------------------------------------------------------------------------------------------------------------- tables

def _time(row: dict | None) -> str:
    return f"{row['ms_per_s']:.3g} ({figures.label(row['family'], row['method']).removeprefix('tensegrity kernel: ')})" if row else "-"


def _over(slow: dict | None, fast: dict | None) -> str:
    return f"**{slow['ms_per_s'] / fast['ms_per_s']:.3g}**" if slow and fast else "-"


def ratio_table(result: dict) -> list[str]:
    """three_bar without NSH, a row per damping."""
    rows, lines = result["rows"], []
    for name in (name for name in result["problems"] if name.startswith("three_bar/")):
        auto, own = fastest(rows, name, **AUTO), fastest(rows, name, **ADAPTIVE)
        careful, plain, scipy = (fastest(rows, name, **kind) for kind in (SUNDIALS, PLAIN, SCIPY))
        cells = [name.partition("/")[2], f"{auto['ms_per_s']:.3g}" if auto else "-", _time(own), _over(auto, own)]
        for peer in (careful, plain, scipy):
            cells += [_time(peer), _over(peer, auto)]
        lines.append(cells)
    head = ["d, N s/m", "`auto`, ms", "our best other, ms", "`auto` / it", "best SUNDIALS, all set-ups, ms", "/ `auto`",
            "best SUNDIALS, plain set-up, ms", "/ `auto`", "best SciPy, ms", "/ `auto`"]  # fmt: skip
    return _table(head, lines)


def transition_table(result: dict) -> list[str]:
    """three_bar without NSH: transitions that each kind of contender found at tolerances from 1e-4 to 1e-12."""
    lines = []
    kinds = {"tensegrity kernel": OWN, "SUNDIALS, all set-ups": SUNDIALS, "SciPy": SCIPY}
    for label, kind in kinds.items():
        cells = [label]
        families = kind["family"] if isinstance(kind["family"], tuple) else (kind["family"],)
        for name in (name for name in result["problems"] if name.startswith("three_bar/")):
            taken = [row for row in result["rows"] if row["problem"] == name and row["family"] in families and row["events"]]
            taken = [row for row in taken if row["kind"] == "tolerance" and row["setting"] <= 1.001e-4 and row["error"] is not None]
            counts = sorted({row["transitions"] for row in taken})
            right = sum(row["transitions"] == result["problems"][name]["transitions"] for row in taken)
            cells.append(f"{', '.join(map(str, counts))} ({right} of {len(taken)} runs right)" if taken else "-")
        lines.append(cells)
    head = ["", *(f"d = {name.partition('/')[2]}" for name in result["problems"] if name.startswith("three_bar/"))]
    return _table(head, lines) if len(head) > 1 else []


def nsh_table(result: dict) -> list[str]:
    """three_bar with NSH against without: the fit's two coefficients, and their ratios."""
    costs = {(row["scene"], row["damping"]): row for row in result.get("nsh", [])}
    lines = []
    for (scene, damping), with_nsh in costs.items():
        if not scene.endswith("_nsh"):
            continue
        plain, cells = costs[scene.removesuffix("_nsh"), damping], [f"{damping:g}"]
        for name in ("three_bar", "three_bar_nsh"):
            best = fastest(result["rows"], f"{name}/{damping:g}", **AUTO)
            cells += [str(best["transitions"]), f"{best['ms_per_s']:.3g}"] if best else ["-", "-"]
        for quantity in ("us_per_transition", "ms_per_second"):
            cells += [f"{row[quantity]:.3g}" for row in (plain, with_nsh)]
            cells.append(f"**{with_nsh[quantity] / plain[quantity]:.3g}**" if plain[quantity] else "-")
        cells.append(f"{100 * plain['relative_residual']:.0f} %, {100 * with_nsh['relative_residual']:.0f} %")
        lines.append(cells)
    head = ["d, N s/m", "transitions in 1 s", "ms", "with NSH: transitions", "ms", "µs per transition", "with NSH", "ratio",
            "ms per transition-free s", "with NSH", "ratio", "residuals"]  # fmt: skip
    return _table(head, lines)


# --------------------------------------------------------------------------------------------------------------- the page

def introduction(result: dict) -> list[str]:
    where, settings = result["machine"], result["settings"]
    apart = {}
    for about in result["problems"].values():
        for method, difference in about["reference_difference"].items():
            apart[method] = max(apart.get(method, 0.0), difference)
    differences = " and ".join(f"{difference:.1e} m ({method})" for method, difference in apart.items())
    how = "a quick run (every fourth setting)" if settings["quick"] else "a full run"
    return [
        "# Work and precision", "",
        "Written by `python benchmarks/work_precision.py`; the numbers stand in [work_precision.json](work_precision.json). "
        f"{where['processor']}, {where['system']}, Python {where['python']}, SciPy {where['scipy']}, SUNDIALS {where['sundials']}, "
        f"MuJoCo {where['mujoco']}, one thread, commit {where['commit']}, {where['date']}; {how} of {result['seconds']} s, load average "
        f"{where['load']}.", "",
        "SUNDIALS is only needed here: `apt-get install libsundials-dev` (version 6); MuJoCo comes by `pip install mujoco`. What is "
        "missing is named, and its rows are left out.", "",
        "Error and time come from the same run. The error is the largest deviation of the top nodes (free flight: of all nodes) at 21 "
        f"instants from our `dop853` at tolerance 1e-13, from which our other methods differ there by at most {differences}. Our kernel "
        "and SUNDIALS are timed in C, SciPy and MuJoCo around their calls from Python. SUNDIALS and SciPy integrate the kernel's own "
        "right-hand side, SUNDIALS with its analytic Jacobian. With events, they find where a string leaves its piece of the force "
        "curve and restart there; without, they integrate the law with its jumps. Runs of all contenders alternate; times are "
        f"processor times, medians of {settings['rounds'] + 1} turns. A run of more than {settings['limit']:g} s is noted as such in the data and left out.", "",
        "SUNDIALS is set up in two ways. *Plain*: what one writes from its manual, CVODE BDF and Adams, ARKODE's own explicit and "
        "implicit tables of order 4 and 5, roots in both directions, `CVodeReInit`, `ERKStepReInit` or `ARKStepReInit` at each root. "
        "*All set-ups* adds what made it faster here: root directions, fused vector operations, `ERKStepReset` and `ARKStepReset`, "
        "which keep the step size, and seven tables chosen by trial, the implicit ones with the predictor that served them best, two "
        "explicit ones mended (benchmarks/peers/arkode.c says how). What counts is the fastest run of any method at each damping.", "",
    ]  # fmt: skip


def page(result: dict) -> str:
    """docs/work-precision.md."""
    lines = introduction(result)
    for name, what in (("sundials", "SUNDIALS (libsundials-dev)"), ("mujoco", "MuJoCo")):
        if result["machine"][name] == "missing":
            lines += [f"**{what} was not installed: its runs are missing.**", ""]
    if table := ratio_table(result):
        lines += [f"## three_bar without NSH: ms per simulated second to come within {TARGET:g} m", "", *table, ""]
        lines += ["Transitions found at tolerances from 1e-4 to 1e-12:", "", *transition_table(result), ""]
    if table := nsh_table(result):
        lines += ["## What an NSH costs", "", *table, "",
                  f"three_bar by `auto` at {TARGET:g} m. Runs under -1 to 2 times the push, of 0.5, 1 and 2 s, of which some have no "
                  "transition, each at the loosest tolerance from which on the error stays within that, are fitted as "
                  "time = a + b duration + c transitions by least squares of the relative residuals (their root mean square in the last "
                  "column): c is the time per transition, a + b that of the first second after a push under which there is none.", ""]  # fmt: skip
    for name in figures.names(result):
        lines += [f"## {name}", "", f"![time against error, {name}](figures/work_precision_{name}.png)", "", figure_text(result, name), ""]
        lines += [f"Redraw: `{COMMAND}` ([SVG](figures/work_precision_{name}.svg))", ""]
    return "\n".join(lines)


def write(result: dict, folder: Path) -> None:
    (folder / "work-precision.md").write_text(page(result), encoding="utf-8")
