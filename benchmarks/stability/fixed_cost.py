"""ROS2 at a fixed step on pushed scenes, strings going slack and taut: whether its energy stays bounded, and its error.

python -m benchmarks.stability.fixed_cost [--redraw]

Linear theory knows no bound of its step (see maps.py), transitions are not linear.  Under constant forces the exact motion
never raises kinetic + potential + elastic energy less the forces' work, so what a run gains there is the method's doing.
"""

from __future__ import annotations

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from benchmarks.harness import page as common
from benchmarks.harness.problems import PUSH_ASIDE, PUSH_UP

from .maps import base
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
    model, points = retuned(base(scene), damping, stiffness), round(POINTS * duration / DURATION)
    found = run(model, "ros2", duration, points, max_step=step)
    exact = run(model, "auto", duration, points, tolerance=1e-8)
    if exact.status != "finished":
        raise RuntimeError(f"{scene}, d = {damping:g}, k = {stiffness:g}: the exact motion stopped with {exact.status}")
    gain = float((found.energy - found.energy[0]).max())
    bounded = found.status == "finished" and gain <= ALLOWED * exact.kinetic.max()
    return {
        "damping": damping,
        "stiffness": stiffness,
        "step": step,
        "status": found.status,
        "gain": gain,
        "exact": exact.kinetic.max(),
        "transitions": found.stats["transitions"],
        "bounded": bool(bounded),
    }


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
    model, rows = retuned(base(scene), damping, stiffness), []
    exact = float(run(model, "auto", duration, 300, tolerance=1e-8).kinetic.max())
    for step in HISTORY_STEPS:
        found = run(model, "ros2", duration, 300, max_step=step)
        times = duration / 300 * np.arange(len(found.energy))
        rows.append(
            {
                "step": step,
                "status": found.status,
                "times": times[::3],
                "gain": (found.energy - found.energy[0])[::3],
                "exact": exact,
            }
        )
    return rows


def references(damping: float, stiffness: float) -> tuple[Run, float]:
    """The exact motion, and how well (m) it is known."""
    model = retuned(base(ERROR_SCENE), damping, stiffness)
    tight, other = (run(model, "auto", ERROR_TIME, ERROR_POINTS, tolerance=t) for t in (TIGHT, LESS_TIGHT))
    return tight, deviation(tight, other)


def error(reference: Run, damping: float, stiffness: float, step: float) -> float:
    """m: largest deviation of a coordinate of ROS2's run from the reference's."""
    model = retuned(base(ERROR_SCENE), damping, stiffness)
    return deviation(run(model, "ros2", ERROR_TIME, ERROR_POINTS, max_step=step), reference)


def error_map() -> list[dict]:
    rows = []
    for damping in (0.0, *np.geomspace(1.0, 1e5, 11)):
        for stiffness in STIFFNESS:
            reference, known = references(damping, stiffness)
            rows.append(
                {
                    "damping": damping,
                    "stiffness": stiffness,
                    "known": known,
                    "error": error(reference, damping, stiffness, STEP),
                }
            )
    return rows


def error_over_step() -> list[dict]:
    k, rows = float(base(ERROR_SCENE).stiffness[0]), []
    for damping in ERROR_DAMPING:
        reference, known = references(damping, k)
        errors = [error(reference, damping, k, step) for step in ERROR_STEPS]
        rows.append(
            {
                "damping": damping,
                "stiffness": k,
                "known": known,
                "steps": ERROR_STEPS,
                "errors": errors,
                "order": order(ERROR_STEPS, errors),
                "transitions": reference.stats["transitions"],
            }
        )
    return rows


def order(steps, errors, largest: float = 1e-3) -> float:
    """Slope of ln error over ln step at the steps up to `largest` (s)."""
    h, e = np.array(steps), np.array(errors)
    return float(np.polyfit(np.log(h[h <= largest]), np.log(e[h <= largest]), 1)[0])


def measure() -> dict:
    maps = [{"scene": s, "rows": [energies(s, d, k) for d in DAMPING for k in STIFFNESS]} for s in SCENES]
    lost = [
        {
            "scene": one["scene"],
            **{key: row[key] for key in ("damping", "stiffness")},
            "step": largest_bounded_step(one["scene"], row["damping"], row["stiffness"]),
        }
        for one in maps
        for row in one["rows"]
        if not row["bounded"]
    ]
    return {
        "maps": maps,
        "lost": lost,
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
    for ax, letter in zip(axes, "abcdef"):
        ax.set_title(f"{letter}  {ax.get_title(loc='left')}")
        ax.minorticks_off()
    return figure


def _damping_axis(ax) -> None:
    ax.set_xscale("symlog", linthresh=1.0, linscale=0.5)
    ax.set(yscale="log", xlabel="d, N s/m", ylabel="k, N/m")
    ax.set_xticks([0.0, *10.0 ** np.arange(6)], ["0", *(f"$10^{i}$" for i in range(6))])


def _draw_gains(ax, one: dict, allowed: float):
    """The gain of every run as a colour; runs that are lost as crosses."""
    kept, lost = ([row for row in one["rows"] if row["bounded"] == bounded] for bounded in (True, False))
    ratio = [max(row["gain"] / row["exact"], SMALLEST) for row in kept]
    drawn = ax.scatter(
        [r["damping"] for r in kept],
        [r["stiffness"] for r in kept],
        c=ratio,
        s=75,
        marker="s",
        norm=LogNorm(SMALLEST, allowed),
        cmap="viridis",
    )
    if lost:
        ax.plot([r["damping"] for r in lost], [r["stiffness"] for r in lost], "x", ms=6, color=common.COLOURS[1], label="lost")
        ax.legend(loc="upper left")
    _damping_axis(ax)
    ax.set(title=f"{one['scene']}, pushed: energy gained", ylim=(50.0, 2e7))
    return drawn


def _draw_errors(figure, ax, rows, step: float) -> None:
    d, k, e, known = (
        np.array([np.nan if r[key] is None else r[key] for r in rows]) for key in ("damping", "stiffness", "error", "known")
    )
    trusted = known <= 0.1 * e
    drawn = ax.scatter(d[trusted], k[trusted], c=e[trusted], s=75, marker="s", norm=LogNorm(1e-11, 1.0), cmap="viridis")
    ax.plot(d[~trusted], k[~trusted], "x", color=common.COLOURS[1])
    figure.colorbar(drawn, ax=ax, label="m")
    _damping_axis(ax)
    ax.set(title=f"{ERROR_SCENE}, pushed: error at {1e3 * step:g} ms (×: not known)", ylim=(50.0, 2e7))


def _draw_over_step(ax, rows) -> None:
    for row, colour in zip(rows, common.COLOURS):
        h, e = common.numbers(row["steps"]), common.numbers(row["errors"])
        ax.plot(h, e, "o", color=colour, label=f"d = {row['damping']:g}, order {row['order']:.2f} up to 1 ms")
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
    for row, colour in zip(data["histories"], common.COLOURS[1:]):
        ax.plot(row["times"], common.numbers(row["gain"]), ".-", lw=0.7, ms=3, color=colour, label=f"{1e3 * row['step']:g} ms")
    ax.axhline(data["histories"][0]["exact"], color=common.COLOURS[0], ls=":", label="largest kinetic energy, exact motion")
    ax.set(
        xlabel="time, s",
        ylabel="energy gained, J (exact motion: never above 0)",
        title=f"{HISTORY[0]}, d = {damping:g} N s/m, k = {stiffness:.0e} N/m",
    )
    ax.legend(loc="upper right", bbox_to_anchor=(1.0, 0.9))


# ---------------------------------------------------------------------------------------------------------------- page


def _gains(data: dict) -> str:
    """How many bounded runs gain something, and which gains most."""
    rows = [(row["gain"] / row["exact"], one["scene"], row) for one in data["maps"] for row in one["rows"] if row["bounded"]]
    gaining = sum(part > SMALLEST for part, _, _ in rows)
    part, scene, row = max(rows, key=lambda item: item[0])
    return (
        f"{gaining} of them gain more than {SMALLEST:.0e} of the largest kinetic energy of the exact motion, the most "
        f"{part:.2g} of it ({scene}, d = {row['damping']:g}, k = {row['stiffness']:.2g})"
    )


def _lost(data: dict) -> tuple[str, str]:
    """The verdict, and what the page says of runs that are lost, if any are."""
    total, lost = sum(len(one["rows"]) for one in data["maps"]), data["lost"]
    if not lost:
        return f"all {total} runs are bounded", ""
    places = ", ".join(sorted({row["scene"] for row in lost}))
    verdict = (
        f"it is **not** bounded everywhere: {len(lost)} of {total} runs are lost, all in {places} at "
        f"k ≥ {min(row['stiffness'] for row in lost):.2g} N/m"
    )
    rows = [
        [
            row["scene"],
            f"{row['damping']:g}",
            f"{row['stiffness']:.2g}",
            "–" if row["step"] is None else f"{1e3 * row['step']:g}",
        ]
        for row in lost
    ]
    header = ["scene", "d, N s/m", "k, N/m", "largest bounded step, ms"]
    meaning = (
        f"The step in the table is the largest of {1e3 * min(BOUND_STEPS):.2g} … {1e3 * max(BOUND_STEPS):g} ms, halved "
        "each time, up to which all are bounded."
    )
    return verdict, f"{common.table(header, rows)}\n\n{meaning}"


def section(data: dict) -> str:
    verdict, lost = _lost(data)
    known = [row for row in data["errors"] if row["error"] is not None and row["known"] is not None]
    trusted = [row["error"] for row in known if row["known"] <= 0.1 * row["error"]]
    unknown = len(data["errors"]) - len(trusted)
    crosses = f", but for {unknown} crosses, where neighbouring motions part too fast for that" if unknown else ""
    orders = ", ".join(
        f"{row['order']:.2f} at d = {row['damping']:g} ({row['transitions']} transitions)" for row in data["over_step"]
    )
    scene, damping, stiffness = HISTORY
    return common.wrapped(f"""
## ROS2 at 1 ms where strings go slack and taut

![ROS2's energy and error at a fixed step](figures/stability_fixed_cost.png)

Linear theory bounds no step of ROS2, but a pushed scene whose strings go slack and taut is not linear, and there, at 1 ms
for {data["duration"]:g} s, {verdict} (a to c). Its error over three_bar's map runs from {min(trusted):.0e} m to
{max(trusted):.1g} m (d) and falls with the step at the order {orders} (e).

{lost}

Kinetic + potential + elastic energy less the forces' work never rises in an exact motion. A run is bounded if it finishes
and gains at most {data["allowed"]:g} times the largest kinetic energy of the exact motion; {_gains(data)}. One of the runs,
{scene} at d = {damping:g} N s/m and k = {stiffness:.0e} N/m, is drawn over time, at three steps (f). Lines in e are order 2
through the point of the smallest step. Pushed: {PUSH_UP:g} N up on the top nodes, {PUSH_ASIDE:g} N aside on one; tensions
are the equilibrium's at every k, rest lengths follow. The exact motion is the kernel's `auto` at {TIGHT:g}, known to a tenth of
ROS2's error by a run at {LESS_TIGHT:g}{crosses}.

{common.footer("fixed_cost", data)}
""")


STUDY = common.Study(__doc__, "fixed_cost", measure, draw, section)

if __name__ == "__main__":
    STUDY.main()
