"""ROS2 at a fixed step on pushed scenes, strings going slack and taut: whether its energy stays bounded, and its error.

python -m benchmarks.stability.fixed_cost [--redraw]

Linear theory knows no bound of its step (see maps.py), transitions are not linear.  Under constant forces the exact motion
never raises kinetic + potential + elastic energy less the forces' work, so what a run gains there is the method's doing.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from benchmarks.harness import page as common
from benchmarks.harness.problems import PUSH_ASIDE, PUSH_UP, built_in

from .pushed_run import Run, deviation, run
from .spectrum import retuned

SCENES = ("three_bar", "two_bar", "six_bar")
#: The step on the maps, s; damping (N s/m) and stiffness (N/m) there; the duration (s) and its communication points.
STEP = 1e-3
DAMPING, STIFFNESS = (0.0, 1.0, 5.0, 50.0, 500.0, 5e3, 1e5), tuple(10.0 ** np.arange(2.0, 7.1, 0.5))
DURATION, POINTS = 5.0, 500
#: The steps of the search for the largest bounded one, s.
BOUND_STEPS = tuple(1e-3 * 0.5 ** np.arange(-2, 6))
#: A run is bounded if it finishes and gains no more energy than this times the largest kinetic energy of the exact motion.
ALLOWED = 1.0
#: The case whose energy is drawn over time: scene, damping, stiffness; its steps, s.
HISTORY, HISTORY_STEPS = ("six_bar", 50.0, 1e7), (1e-3, 5e-4, 2e-4)
#: Errors: the scene, duration (s), communication points, steps (s) and damping of the chart over the step.
ERROR_SCENE, ERROR_TIME, ERROR_POINTS = "three_bar", 1.0, 20
ERROR_STEPS, ERROR_DAMPING = tuple(2e-2 * 0.5 ** np.arange(12)), (50.0, 500.0, 5000.0)
#: The reference: its tolerance, and the other one whose difference from it says how well it is known.
TIGHT, LESS_TIGHT = 1e-12, 1e-11


# ----------------------------------------------------------------------------------------------------- what is measured


def energies(scene: str, damping: float, stiffness: float, step: float = STEP, duration: float = DURATION) -> dict:
    """One run of ROS2: how it ended, its largest gain of energy, and the exact motion's largest kinetic energy (J)."""
    model, points = retuned(built_in(scene), damping, stiffness), round(POINTS * duration / DURATION)
    found = run(model, "ros2", duration, points, max_step=step)
    exact = run(model, "auto", duration, points, tolerance=1e-8)
    if exact.status != "finished":
        raise RuntimeError(f"{scene}, d = {damping:g}, k = {stiffness:g}: the exact motion stopped with {exact.status}")
    gain, most = float((found.energy - found.energy[0]).max()), exact.kinetic.max()
    bounded = bool(found.status == "finished" and gain <= ALLOWED * most)
    case = {"damping": damping, "stiffness": stiffness, "step": step, "status": found.status, "gain": gain, "exact": most}
    return case | {"transitions": found.stats["transitions"], "bounded": bounded}


def largest_bounded_step(scene: str, damping: float, stiffness: float, steps=BOUND_STEPS) -> float:
    """s: largest of the steps at which, and at all smaller ones, the run is bounded; nan if there is none."""
    good = float("nan")
    for step in sorted(steps):
        if not energies(scene, damping, stiffness, step)["bounded"]:
            break
        good = step
    return good


def histories(duration: float = 0.3) -> list[dict]:
    """The energy that HISTORY's case gains over time at HISTORY_STEPS."""
    scene, damping, stiffness = HISTORY
    model, rows = retuned(built_in(scene), damping, stiffness), []
    exact = float(run(model, "auto", duration, 300, tolerance=1e-8).kinetic.max())
    for step in HISTORY_STEPS:
        found = run(model, "ros2", duration, 300, max_step=step)
        kept = {"times": (duration / 300 * np.arange(len(found.energy)))[::3], "gain": (found.energy - found.energy[0])[::3]}
        rows.append({"step": step, "status": found.status, **kept, "exact": exact})
    return rows


def references(damping: float, stiffness: float) -> tuple[Run, float]:
    """The exact motion, and how well (m) it is known."""
    model = retuned(built_in(ERROR_SCENE), damping, stiffness)
    tight, other = (run(model, "auto", ERROR_TIME, ERROR_POINTS, tolerance=t) for t in (TIGHT, LESS_TIGHT))
    return tight, deviation(tight, other)


def error(reference: Run, damping: float, stiffness: float, step: float) -> float:
    """m: largest deviation of a coordinate of ROS2's run from the reference's."""
    model = retuned(built_in(ERROR_SCENE), damping, stiffness)
    return deviation(run(model, "ros2", ERROR_TIME, ERROR_POINTS, max_step=step), reference)


def error_map() -> list[dict]:
    rows = []
    for damping, stiffness in product((0.0, *np.geomspace(1.0, 1e5, 11)), STIFFNESS):
        reference, known = references(damping, stiffness)
        case = {"damping": damping, "stiffness": stiffness, "known": known}
        rows.append(case | {"error": error(reference, damping, stiffness, STEP)})
    return rows


def error_over_step() -> list[dict]:
    k, rows = float(built_in(ERROR_SCENE).stiffness[0]), []
    for damping in ERROR_DAMPING:
        reference, known = references(damping, k)
        errors = [error(reference, damping, k, step) for step in ERROR_STEPS]
        case = {"damping": damping, "stiffness": k, "known": known, "transitions": reference.stats["transitions"]}
        rows.append(case | {"steps": ERROR_STEPS, "errors": errors, "order": order(ERROR_STEPS, errors)})
    return rows


def order(steps, errors, largest: float = 1e-3) -> float:
    """Slope of ln error over ln step at the steps up to `largest` (s)."""
    h, e = np.array(steps), np.array(errors)
    return float(np.polyfit(np.log(h[h <= largest]), np.log(e[h <= largest]), 1)[0])


def measure() -> dict:
    maps = [{"scene": s, "rows": [energies(s, d, k) for d in DAMPING for k in STIFFNESS]} for s in SCENES]
    lost = [(one["scene"], row["damping"], row["stiffness"]) for one in maps for row in one["rows"] if not row["bounded"]]
    names = ("scene", "damping", "stiffness")
    return {
        "maps": maps,
        "lost": [{**dict(zip(names, case)), "step": largest_bounded_step(*case)} for case in lost],
        "errors": error_map(),
        "over_step": error_over_step(),
        "histories": histories(),
        "step": STEP,
        "duration": DURATION,
        "allowed": ALLOWED,
    }


# ------------------------------------------------------------------------------------------------------------- figures

#: Relative gains below this are drawn in one colour.
SMALLEST = 1e-6


def draw(data: dict) -> Figure:
    figure = common.new_figure(12.5, 7.4)
    axes = figure.subplots(2, 3).ravel()
    for ax, one in zip(axes, data["maps"]):
        drawn = _draw_gains(ax, one, data["allowed"])
    figure.colorbar(drawn, ax=axes[0], label="a to c: energy gained / largest kinetic energy", extend="min")
    _draw_errors(figure, axes[3], data["errors"], data["step"])
    _draw_over_step(axes[4], data["over_step"])
    _draw_histories(axes[5], data)
    common.lettered(axes)
    return figure


def _damping_axis(ax) -> None:
    ax.set_xscale("symlog", linthresh=1.0, linscale=0.5)
    ax.set(yscale="log", xlabel="d, N s/m", ylabel="k, N/m")
    ax.set_xticks([0.0, *10.0 ** np.arange(6)], ["0", *(f"$10^{i}$" for i in range(6))])


def _draw_gains(ax, one: dict, allowed: float):
    """The gain of every run as a colour; runs that are lost as crosses."""
    kept, lost = ([row for row in one["rows"] if row["bounded"] == bounded] for bounded in (True, False))
    ratio = [max(row["gain"] / row["exact"], SMALLEST) for row in kept]
    drawn = _coloured(ax, *_columns(kept), ratio, LogNorm(SMALLEST, allowed))
    if lost:
        ax.plot(*_columns(lost), "x", ms=6, color=common.COLOURS[1], label="lost")
        ax.legend(loc="upper left")
    _damping_axis(ax)
    ax.set(title=f"{one['scene']}, pushed: energy gained", ylim=(50.0, 2e7))
    return drawn


def _columns(rows, keys=("damping", "stiffness")) -> list[np.ndarray]:
    return [common.numbers([row[key] for row in rows]) for key in keys]


def _coloured(ax, damping, stiffness, values, norm: LogNorm):
    return ax.scatter(damping, stiffness, c=values, s=75, marker="s", norm=norm, cmap="viridis")


def _draw_errors(figure, ax, rows, step: float) -> None:
    d, k, e, known = _columns(rows, ("damping", "stiffness", "error", "known"))
    trusted = known <= 0.1 * e
    drawn = _coloured(ax, d[trusted], k[trusted], e[trusted], LogNorm(1e-11, 1.0))
    ax.plot(d[~trusted], k[~trusted], "x", color=common.COLOURS[1])
    figure.colorbar(drawn, ax=ax, label="m")
    _damping_axis(ax)
    ax.set(title=f"{ERROR_SCENE}, pushed: error at {1e3 * step:g} ms (×: not known)", ylim=(50.0, 2e7))


def _draw_over_step(ax, rows) -> None:
    for row, colour, mark in zip(rows, common.COLOURS, common.MARKS):
        h, e = common.numbers(row["steps"]), common.numbers(row["errors"])
        ax.plot(h, e, mark, color=colour, label=f"d = {row['damping']:g}, order {row['order']:.2f} up to 1 ms")
        ax.plot(h, e[-1] * (h / h[-1]) ** 2, color=colour, lw=0.9)
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="step, s",
        ylabel="largest error within 1 s, m",
        title=f"{ERROR_SCENE}, pushed; lines: order 2",
    )
    ax.legend()


def _draw_histories(ax, data: dict) -> None:
    damping, stiffness = HISTORY[1:]
    for row, colour, mark in zip(data["histories"], common.COLOURS[1:], common.MARKS):
        label = f"{1e3 * row['step']:g} ms"
        ax.plot(row["times"], common.numbers(row["gain"]), f"{mark}-", lw=0.7, ms=2.5, color=colour, label=label)
    ax.axhline(data["histories"][0]["exact"], color=common.COLOURS[0], ls=":", label="largest kinetic energy, exact motion")
    ax.set(
        xlabel="time, s",
        ylabel="energy gained, J (exact motion: never above 0)",
        title=f"{HISTORY[0]}, d = {damping:g} N s/m, k = {stiffness:.0e} N/m",
    )
    ax.legend(loc="upper right", bbox_to_anchor=(1.0, 0.9))


def words(data: dict) -> dict:
    """What the page says of these data."""
    rows = [row | {"scene": one["scene"], "part": row["gain"] / row["exact"]} for one in data["maps"] for row in one["rows"]]
    bounded = [row for row in rows if row["bounded"]]
    known = [row for row in data["errors"] if row["error"] is not None and row["known"] is not None]
    trusted = [row["error"] for row in known if row["known"] <= 0.1 * row["error"]]
    constants = {"bound_steps": BOUND_STEPS, "smallest": SMALLEST, "history": HISTORY, "push": (PUSH_UP, PUSH_ASIDE)}
    return constants | {
        "total": len(rows),
        "gaining": sum(row["part"] > SMALLEST for row in bounded),
        "most": max(bounded, key=lambda row: row["part"]),
        "trusted": trusted,
        "unknown": len(data["errors"]) - len(trusted),
        "tight": (TIGHT, LESS_TIGHT),
    }


STUDY = common.Study(__doc__, "fixed_cost", measure, draw, words)

if __name__ == "__main__":
    STUDY.main()
