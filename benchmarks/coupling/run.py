"""Height control by coupled FMUs: ``python -m benchmarks.coupling.run`` writes docs/coupling.json, the page and its figures.

Three winches and a controller, FMUs of their own, hold the top nodes of three_bar at heights, in masters over fmpy, libcosim
and ecos, at communication steps from 0.25 ms to 0.1 s, against the same loop in one, integrated by SciPy.  Needs a C compiler,
and the network (PyPI, Debian) where libcosimpy and ecospy are not in build/importers yet.  About 2 minutes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import machine
from benchmarks.harness.page import COLOURS, Page, lettered, new_figure, plain, rendered
from fmu_src.packing import ssp
from tensegrity_core.files import scratch

from . import linear, master, monolithic, system, tools
from .master import SCHEMES

#: Simulated time, s; communication steps, s, each a multiple of the finest.
DURATION = 2.0
STEPS = (0.1, 0.05, 0.04, 0.025, 0.02, 0.0125, 0.01, 0.005, 0.0025, 0.00125, 0.0005, 0.00025)
#: Of the tools, and of those runs whose heights are drawn.
TOOL_STEPS, DRAWN = (0.02, 0.01, 0.005, 0.0025, 0.00125), 0.02
#: Between which the linear system's limits are looked for, and where its growth is drawn, s.
RANGE = np.geomspace(2e-3, 0.5, 60)
#: Steps, over the limit, at which growth is seen in FMUs.
FACTORS = (0.7, 0.85, 0.95, 1.05, 1.15, 1.3)
#: The step at which the coupling's delay is read, s.
SMALL = 1e-3

NAMES = {
    "jacobi_no_rate": "Jacobi, held, rates left out",
    "jacobi": "Jacobi, held",
    "gauss_seidel": "Gauss–Seidel, held",
    "jacobi_derivatives": "Jacobi, input derivatives",
    "gauss_seidel_derivatives": "Gauss–Seidel, input derivatives",
    "iterated": "repeated with rollback",
}
MARKS = dict(zip(NAMES, ("x", "o", "s", "v", "^", "D")))
LOOKS = {name: {"color": colour, "marker": MARKS[name], "markersize": 4.5} for name, colour in zip(NAMES, COLOURS)}

# --- measuring ---------------------------------------------------------------------------------------------------


def collect() -> dict:
    ran_on = machine.describe()
    times = STEPS[-1] * np.arange(round(DURATION / STEPS[-1]) + 1)
    whole = monolithic.heights(system.LOOP, times)
    some = np.arange(0, len(times), 400)
    other = monolithic.heights(system.LOOP, times[some], "Radau", 1e-9, 1e-11)
    with scratch() as folder:
        fmus = system.pack(folder)
        schemes = {name: of_scheme(name, fmus, whole) for name in SCHEMES}
        limits = {name: stability(name, fmus) for name in SCHEMES}
        fresh = linear.Coupling(system.LOOP, SCHEMES["jacobi"], linear.Fresh)
        found = of_tools(folder, fmus, whole)
        drawn = heights(fmus, times, whole)
    margin = linear.delay_margin(system.LOOP)
    return plain(
        {
            "machine": ran_on,
            "duration": DURATION,
            "loop": system.LOOP._asdict(),
            "agreement": np.max(np.abs(other - whole[some])),
            "margin": margin._asdict(),
            "schemes": schemes,
            "limits": limits,
            "fresh": {
                "limit": linear.largest_step(fresh, RANGE),
                "delay": linear.delay_in_steps(fresh, system.LOOP, SMALL),
            },
            "tools": found,
            "drawn": drawn,
        }
    )


def of_scheme(name: str, fmus: dict[str, Path], whole) -> dict:
    """Errors and sweeps at all communication steps."""
    errors, sweeps = [], []
    for h in STEPS:
        found, one = master.run(system.plan(), fmus, SCHEMES[name], h, round(DURATION / h))
        errors.append(error(found, whole, h))
        sweeps.append(one.sweeps_taken / one.steps_taken)
    print(f"{NAMES[name]:<34}{errors[6]:.1e} m at {STEPS[6]:g} s", flush=True)
    return {"steps": STEPS, "errors": errors, "sweeps": sweeps}


def error(found, whole, h: float) -> float:
    """Largest difference of heights, m, at communication points, of which the last is the last of all."""
    every = round(h / STEPS[-1])
    return float(np.max(np.abs(found - whole[::every][-len(found) :])))


def stability(name: str, fmus: dict[str, Path]) -> dict:
    """What the linear system foretells, and what is seen."""
    coupling = linear.Coupling(system.LOOP, SCHEMES[name])
    contraction = [coupling.contraction(h) for h in RANGE] if SCHEMES[name].sweeps > 1 else []
    growth = [coupling.growth(h) for h in RANGE]
    limit = linear.largest_step(coupling, RANGE)
    if limit is None:
        raise ValueError(f"{name} stays stable up to {RANGE[-1]:g} s: look at larger steps")
    at_limit, steps = coupling.multiplier(limit), [factor * limit for factor in FACTORS]
    effect = linear.effect(system.LOOP, np.log(at_limit) / limit)
    return {
        "limit": limit,
        "gain": abs(effect),
        "lag": -np.degrees(np.angle(effect)),
        "contraction_at_limit": coupling.contraction(limit) if contraction else None,
        "frequency": np.angle(at_limit) / limit,
        "points_per_period": 2.0 * np.pi / np.angle(at_limit),
        "delay": linear.delay_in_steps(coupling, system.LOOP, SMALL),
        "steps": RANGE,
        "growth": growth,
        "contraction": contraction,
        "at": steps,
        "foretold": [coupling.growth(h) for h in steps],
        "seen": [linear.seen_growth(fmus, SCHEMES[name], h) for h in steps],
    }


def of_tools(folder: Path, fmus: dict[str, Path], whole) -> list[dict]:
    """A row per tool and version of SSP."""
    plan, rows = system.plan(), []
    same = {h: master.run(plan, fmus, SCHEMES["jacobi"], h, round(DURATION / h))[0] for h in TOOL_STEPS}
    archives = {
        version: ssp.write_ssp(folder / f"{version}.ssp", system.as_ssp(fmus, DURATION), version) for version in ssp.VERSIONS
    }
    for driver, version in [(driver, version) for driver in tools.OF for version in ssp.VERSIONS]:
        row: dict = {"tool": driver, "ssp": version, "steps": TOOL_STEPS, "errors": [], "apart": [], "why": ""}
        try:
            one = tools.tool(driver)
            row["version"] = one.version
            for h in TOOL_STEPS:
                found = tools.run(one, archives[version], plan, fmus["structure"], h, round(DURATION / h))
                row["errors"].append(error(found, whole, h))
                row["apart"].append(float(np.max(np.abs(found - same[h][1:]))))
        except tools.Refused as refused:
            row["why"] = str(refused)
        print(f"{driver}, SSP {version}: {row['why'] or max(row['apart'])}", flush=True)
        rows.append(row)
    return rows


def heights(fmus: dict[str, Path], times, whole) -> dict:
    """What is drawn of n4: the loop in one, and three masters at one communication step, m over s."""
    every = round(0.01 / STEPS[-1])
    drawn = {"whole": {"time": times[::every], "height": whole[::every, 0]}}
    for name in ("jacobi", "jacobi_derivatives", "gauss_seidel_derivatives"):
        found, _ = master.run(system.plan(), fmus, SCHEMES[name], DRAWN, round(DURATION / DRAWN))
        drawn[name] = {"time": DRAWN * np.arange(len(found)), "height": found[:, 0]}
    return {"step": DRAWN, "curves": drawn}


# --- showing -----------------------------------------------------------------------------------------------------


def draw_errors(data: dict) -> Figure:
    """Error over communication step, and heights at one of them."""
    figure = new_figure(9.0, 3.9)
    left, right = axes = figure.subplots(1, 2)
    for name, found in data["schemes"].items():
        left.loglog(found["steps"], found["errors"], label=NAMES[name], **LOOKS[name])
    for row in data["tools"]:
        if row["errors"]:
            label = f"{row['tool']}, SSP {row['ssp']}"
            big = {"libcosim": 11, "ecos": 8}[row["tool"]] + 3 * (row["ssp"] == "1.0")
            left.plot(row["steps"], row["errors"], "o", mfc="none", mec="#777777", mew=0.8, markersize=big, label=label)
    h = np.array([2e-4, 3e-3])
    for order, at in ((1, 0.4), (2, 0.25)):
        left.plot(h, at * h**order, "--", color="#777777", linewidth=0.9, zorder=1)
        left.annotate("h²" if order > 1 else "h", (h[0], at * h[0] ** order), (-3, 0), textcoords="offset points", ha="right")
    left.set(
        xlabel="communication step h, s",
        ylabel="largest error of a height, m",
        title="against the loop in one",
        ylim=(5e-9, None),
    )
    left.legend(loc="lower right", fontsize=6)
    curves = data["drawn"]["curves"]
    for name, curve in curves.items():
        looks = {"color": "#777777", "linewidth": 2.5} if name == "whole" else LOOKS[name] | {"markersize": 3}
        right.plot(curve["time"], curve["height"], label=NAMES.get(name, "the loop in one"), **looks)
    low, high = min(curves["whole"]["height"]), max(curves["whole"]["height"])
    right.set(
        ylim=(low - 0.012, high + 0.02),
        xlabel="time, s",
        ylabel="height of n4, m",
        title=f"h = {1e3 * data['drawn']['step']:g} ms",
    )
    right.legend(loc="upper right")
    lettered(axes)
    return figure


def draw_stability(data: dict) -> Figure:
    """Growth of a small error per step: foretold and seen."""
    figure = new_figure(9.0, 3.9)
    ax = figure.subplots()
    for name, found in data["limits"].items():
        steps, growth = np.array(found["steps"]), np.array(found["growth"])
        shown = growth < 2.0
        ax.semilogx(steps[shown], growth[shown], color=LOOKS[name]["color"])
        ax.plot(found["at"], found["seen"], **LOOKS[name], linestyle="none")
        ax.plot([], [], **LOOKS[name], label=NAMES[name])
    repeated = data["limits"]["iterated"]
    steps, contraction = np.array(repeated["steps"]), np.array(repeated["contraction"])
    shown = contraction < 2.0
    ax.plot(steps[shown], contraction[shown], ":", color=LOOKS["iterated"]["color"], label="its change from sweep to sweep")
    ax.axhline(1.0, color="#777777", linewidth=0.8)
    ax.set(xlim=(2e-3, 0.15), ylim=(0.6, 1.45), xlabel="communication step h, s", ylabel="factor per step")
    ax.set(title="growth of a small error: lines foretold by the linear system, marks seen in the FMUs")
    ax.legend(loc="upper left")
    ax.minorticks_off()
    return figure


def order(found: dict) -> float:
    """Of the errors between 5 ms and 0.5 ms."""
    steps, errors = np.array(found["steps"]), np.array(found["errors"])
    within = (steps <= 5e-3) & (steps >= 5e-4)
    return float(np.polyfit(np.log(steps[within]), np.log(errors[within]), 1)[0])


def report(data: dict) -> str:
    """docs/coupling.md."""
    at = data["schemes"]["jacobi"]["steps"].index(0.005)
    return rendered("coupling/page", **data, names=NAMES, order=order, at=at, watched=linear.WATCHED, parted=parted(data))


def parted(data: dict) -> float:
    """The largest difference of a growth that was seen from the one foretold, of all schemes."""
    pairs = [pair for found in data["limits"].values() for pair in zip(found["foretold"], found["seen"])]
    return max(abs(foretold - seen) for foretold, seen in pairs if seen is not None)


PAGE = Page(__doc__, "coupling", collect, report, {"coupling_errors": draw_errors, "coupling_stability": draw_stability})

if __name__ == "__main__":
    PAGE.main()
