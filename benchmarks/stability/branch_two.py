"""Branch II of a negative stiffness beam under force and displacement control: the snap's time and the step it needs.

python -m benchmarks.stability.branch_two [--redraw]
"""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import product
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from benchmarks.harness import page as common
from tensegrity_core.errors import SimulationError
from tensegrity_core.laws.beam import beam_displacement, beam_extrema
from tensegrity_core.scene import load_scene
from tensegrity_core.statics import build_model

from .methods import METHODS
from .one_beam import (
    EDGE,
    KAPPA,
    LEVER,
    ZETA,
    Case,
    H,
    Path,
    Q,
    case,
    crossing,
    force,
    growth,
    jump_under_winding,
    run,
    snap_time,
    snap_time_overdamped,
    snap_time_undamped,
)

MASSES = (0.3, 3.0, 30.0)
DELTAS = (0.0, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0)
#: Part of f_max by which the dead load exceeds it.
OVERLOAD = 0.05
#: The overloads (F - f_max)/f_max of the sweep over them.
OVERLOADS = tuple(10.0 ** np.arange(-6, 1))
#: Fixed-step methods whose steps are tried on the snap, the damping there, and the steps, in units of 1/r (see `growth`).
STEPPED = ("rk4", "ros2")
STEPPED_DELTAS = (0.0, 1.0, 10.0)
STEPS = tuple(np.geomspace(0.01, 1.2, 12))
#: Relative error of the snap's time at which a step counts as resolving it.
RESOLVED = 0.01


# ----------------------------------------------------------------------------------------------------- what is measured


def slope_of_log(path: Path, low: float, high: float) -> float:
    """1/s: slope of ln |u - h| where it lies between low and high, m; nan for fewer than 5 points."""
    x = np.abs(path.u - H)
    chosen = (x > low) & (x < high)
    if chosen.sum() < 5:
        return float("nan")
    return float(np.polyfit(path.times[chosen], np.log(x[chosen]), 1)[0])


def dead_load_growth(masses=MASSES, deltas=DELTAS) -> list[dict]:
    """Growth rate off the equilibrium on branch II under the dead load f(h) = 2 Q."""
    rows = []
    for mass, delta in product(masses, deltas):
        c, theory = case(mass, delta, load=2.0 * Q), growth(delta)
        path = run(c, H + 1e-8, 12.0 * c.unit / float(theory), 600, tolerance=1e-13)
        rate = slope_of_log(path, 1e-6, 1e-5) * c.unit
        rows.append({"mass": mass, "delta": delta, "damping": c.damping, "rate": rate, "theory": theory})
    return rows


def winding_growth(ratios=(0.1, 0.25, 0.5, 0.75, 0.9, 1.1, 1.25, 1.5, 2.0, 3.0), delta: float = 4.0) -> list[dict]:
    """Growth or decay off the same equilibrium where a string of stiffness k_s = ratio kappa holds it."""
    rows = []
    for ratio in ratios:
        c = case(MASSES[0], delta, series=ratio * KAPPA)
        expected = float(growth(delta, ratio))
        grows = ratio < 1.0
        offset, window = (1e-8, (1e-6, 1e-5)) if grows else (1e-4, (1e-8, 1e-6))
        span = math.log(1e4) + 2.0
        # wound so that the equilibrium is at u = h: f(h) = k_s (held + offset)
        held = 2.0 * Q / c.series - offset
        path = run(c, H + offset, span * c.unit / abs(expected), 800, held=held, tolerance=1e-13)
        rows.append({"ratio": ratio, "delta": delta, "rate": slope_of_log(path, *window) * c.unit, "theory": expected})
    return rows


def time_under(load: float, mass: float, delta: float) -> dict:
    """Time on branch II under a dead load beyond f_max by that part of it."""
    expected, c = snap_time(delta, load), case(mass, delta, load=(1.0 + load) * EDGE.f_max)
    seconds = crossing(run(c, EDGE.u_max, 1.05 * expected * c.unit, 400), EDGE.u_min)
    found = {"mass": mass, "delta": delta, "damping": c.damping, "overload": load}
    return found | {"seconds": seconds, "time": seconds / c.unit, "theory": expected}


def snap_times(masses=MASSES, deltas=DELTAS) -> list[dict]:
    """Over mass and damping, just beyond f_max."""
    return [time_under(OVERLOAD, mass, delta) for delta, mass in product(deltas, masses)]


def overloads(values=OVERLOADS, deltas=(0.0, 1.0, 10.0)) -> list[dict]:
    """Over the overload (F - f_max)/f_max."""
    return [time_under(value, MASSES[0], delta) for delta, value in product(deltas, values)]


def winding(ratio: float, duration: float = 60.0, steps: int = 12000) -> dict:
    """A slow winder in series with k_s = ratio kappa draws the beam from region I to region III."""
    c = case(MASSES[0], 1.0, series=ratio * KAPPA)
    start, end = 0.5 * EDGE.u_max, H + 2.0 * (H - EDGE.u_max)
    way = (end - start) + float(force(end) - force(start)) / c.series
    path = run(c, start, duration, steps, held=float(force(start)) / c.series, wind=way / duration)
    load = path.elastic[:, 1]
    on_curve = np.abs(load - force(path.u))
    static = jump_under_winding(c.series) if ratio < 1.0 else None
    fastest = int(np.argmax(path.rate))
    shown = np.unique(np.r_[np.linspace(0, steps, 60).astype(int), np.arange(max(fastest - 12, 0), min(fastest + 13, steps))])
    return {
        "ratio": ratio,
        "u": path.u[shown],
        "load": load[shown],
        "off_curve": on_curve.max(),
        "fastest": path.rate.max(),
        "winding_rate": way / duration,
        "jump": static,
    }


# ------------------------------------------------------------------------------------------------- the step of the snap


def stepped(c: Case, method: str, h: float, duration: float) -> Path:
    """The snap from rest at u_max with a fixed step (s)."""
    steps = math.ceil(duration / h)
    return run(c, EDGE.u_max, steps * h, steps, method=method, max_step=h)


def damping_part(stiffness: float, damping: float) -> np.ndarray:
    """What the kernel's ROS2 keeps of the Jacobian of u'' = -stiffness u - damping u': no negative stiffness."""
    return np.array([[0.0, 1.0], [-max(stiffness, 0.0), -damping]])


def stepped_growth(method: str, delta: float, step: float) -> float:
    """Growth rate that a method gives the motion about u = h, relative to the true one; step in units of 1/r."""
    A, h = np.array([[0.0, 1.0], [1.0, -delta]]), step / float(growth(delta))
    J = damping_part(-1.0, delta)
    columns = [METHODS[method].step(lambda y: A @ y, lambda y: J, y, h) for y in np.eye(2)]
    factors = np.linalg.eigvals(np.array(columns).T)
    near = factors[np.argmin(np.abs(factors - np.exp(step)))]
    return float(np.log(np.abs(near)) / step)


class Snap(NamedTuple):
    """The snap of one case: seconds on branch II; position: u(t), m, until it lands at `landing`, s."""

    c: Case
    seconds: float
    position: Callable
    landing: float


def snap(delta: float) -> Snap:
    c = case(1.0, delta, load=(1.0 + OVERLOAD) * EDGE.f_max)
    return Snap(c, snap_time(delta, OVERLOAD) * c.unit, *_landing(c))


def step_error(s: Snap, method: str, step: float) -> dict:
    """Relative error of the time on branch II, and largest error of u, m, up to the landing; nan where the run is lost.

    step: in units of 1/r, r the growth rate at u = h."""
    h = step * s.c.unit / float(growth(s.c.delta))
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # an unstable step grows until it overflows
            path = stepped(s.c, method, h, max(s.landing, 1.5 * s.seconds))
    except SimulationError:
        return {"error": math.nan, "landing": math.nan}
    before = path.times <= s.landing
    off = float(np.abs(path.u[before] - s.position(path.times[before])).max())
    if not off < H:
        return {"error": math.nan, "landing": math.nan}
    return {"error": abs(crossing(path, EDGE.u_min) / s.seconds - 1.0), "landing": off}


def step_errors(methods=STEPPED, deltas=STEPPED_DELTAS, steps=STEPS) -> list[dict]:
    """`step_error` over methods, damping and steps."""
    snaps = {delta: snap(delta) for delta in deltas}
    cells = product(deltas, methods, steps)
    return [{"method": m, "delta": d, "step": step, **step_error(snaps[d], m, step)} for d, m, step in cells]


def resolving_step(method: str, delta: float, low: float = 1e-2, high: float = 3.0, factor: float = 1.04) -> float:
    """Step, in 1/r, up to which every step tried has the time on branch II within RESOLVED; nan if `low` has not."""
    s, found = snap(delta), math.nan
    for step in np.geomspace(low, high, 1 + math.ceil(math.log(high / low) / math.log(factor))):
        if not step_error(s, method, float(step))["error"] <= RESOLVED:
            break
        found = float(step)
    return found


def resolving_steps(methods=STEPPED, deltas=STEPPED_DELTAS) -> list[dict]:
    """Per method and damping, with the error of u up to the landing at that step."""
    rows = []
    for method, delta in product(methods, deltas):
        step = resolving_step(method, delta)
        rows.append(
            {"method": method, "delta": delta, "step": step, "landing": step_error(snap(delta), method, step)["landing"]}
        )
    return rows


def _landing(c: Case):
    """u(t) until it lands, where region III first carries the load (or 3 snap times), and that instant, s."""
    at = beam_displacement(Q, ZETA, H, c.load, "III")

    def f(t, y):
        return [y[1], (c.load - float(force(y[0])) - c.damping * y[1]) / c.mass]

    def landed(t, y):
        return y[0] - at

    landed.terminal, landed.direction = True, 1.0
    last = 3.0 * snap_time(c.delta, OVERLOAD) * c.unit
    settings = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-15, "events": landed, "dense_output": True}
    found = solve_ivp(f, (0.0, last), [EDGE.u_max, 0.0], **settings)
    return (lambda t: found.sol(t)[0]), float(found.t[-1])


def beams_of_the_article(dampings=(0.0, 50.0, 500.0, 5000.0)) -> list[dict]:
    """1/r in s at the tip of a pinned bar of three_bar_nsh for every beam of the article's NSH."""
    model = build_model(load_scene("three_bar_nsh"))
    nsh = model.nsh[model.nsh_strings[0]]
    mass = float(model.bar_mass[0]) / 3.0
    rows = []
    for q, zeta, h in zip(nsh.Q, nsh.zeta, nsh.h):
        kappa = q * (zeta - 2.0) / h
        unit = math.sqrt(mass / kappa)
        scales = [unit / float(growth(d / math.sqrt(mass * kappa))) for d in dampings]
        rows.append({"f_max": beam_extrema(q, zeta, h).f_max, "kappa": kappa, "dampings": dampings, "scales": scales})
    return rows


def measure() -> dict:
    return {
        "growth": dead_load_growth(),
        "winding_growth": winding_growth(),
        "snap": snap_times(),
        "overload": overloads(),
        "winding": [winding(2.0), winding(0.5)],
        "errors": step_errors(),
        "resolving": resolving_steps(),
        "beams": beams_of_the_article(),
    }


# ------------------------------------------------------------------------------------------------------------- figures

MASS_MARK = dict(zip(MASSES, "os^"))
DELTA_COLOUR = dict(zip(STEPPED_DELTAS, common.COLOURS))
METHOD_MARK = dict(zip(STEPPED, "os"))


def draw(data: dict) -> Figure:
    figure = common.new_figure(12.5, 7.8)
    axes = figure.subplots(2, 3).ravel()
    _draw_growth(axes[0], data["growth"])
    _draw_snap_times(axes[1], data["snap"])
    _draw_overloads(axes[2], data["overload"])
    _draw_winding_growth(axes[3], data["winding_growth"])
    _draw_winding(axes[4], data["winding"])
    _draw_steps(axes[5], data["errors"])
    common.lettered(axes)
    return figure


def _draw_by_mass(ax, rows, measured: str) -> None:
    for mass, mark in MASS_MARK.items():
        delta, value = zip(*((row["delta"], row[measured]) for row in rows if row["mass"] == mass))
        style = {"color": common.COLOURS[1], "fillstyle": "none", "ms": 4 + 2 * MASSES.index(mass)}
        ax.plot(delta, value, mark, label=f"m = {mass:g} kg", **style)
    ax.set_xscale("symlog", linthresh=0.1, linscale=0.4)


def _draw_growth(ax, rows) -> None:
    delta = np.r_[0.0, np.geomspace(0.05, 200.0, 200)]
    ax.plot(delta, growth(delta), color=common.COLOURS[0], label="theory")
    ax.plot(delta[1:], 1.0 / delta[1:], color=common.COLOURS[4], ls=":", label="κ/d")
    _draw_by_mass(ax, rows, "rate")
    ax.set(
        yscale="log",
        ylim=(4e-3, 2.0),
        xlabel="δ = d/√(mκ)",
        ylabel="growth rate · √(m/κ)",
        title="Dead load f(h): growth off branch II",
    )
    ax.legend()


def _draw_snap_times(ax, rows) -> None:
    delta = np.r_[0.0, np.geomspace(0.05, 200.0, 40)]
    ax.plot(delta, [snap_time(x, OVERLOAD) for x in delta], color=common.COLOURS[0], label="theory")
    ax.axhline(snap_time_undamped(OVERLOAD), color=common.COLOURS[4], ls=":", label="no damping; no mass")
    ax.plot(delta[10:], delta[10:] * snap_time_overdamped(OVERLOAD), color=common.COLOURS[4], ls=":")
    _draw_by_mass(ax, rows, "time")
    ax.set(
        yscale="log", xlabel="δ = d/√(mκ)", ylabel="time / √(m/κ)", title=f"Dead load {1 + OVERLOAD:g} f_max: time on branch II"
    )
    ax.legend()


def _draw_overloads(ax, rows) -> None:
    span = np.geomspace(1e-6, 1.0, 40)
    for delta in dict.fromkeys(row["delta"] for row in rows):
        chosen, colour = [row for row in rows if row["delta"] == delta], DELTA_COLOUR[delta]
        mark = "osD^v"[list(DELTA_COLOUR).index(delta) % 5]
        ax.plot(
            [row["overload"] for row in chosen], [row["time"] for row in chosen], mark, color=colour, label=f"δ = {delta:g}"
        )
        ax.plot(span, [snap_time(delta, x) for x in span], color=colour)
    ax.set(
        xscale="log",
        yscale="log",
        xlabel="overload F/f_max − 1",
        ylabel="time / √(m/κ)",
        title="Time on branch II over the overload",
    )
    ax.legend()


def _draw_winding_growth(ax, rows) -> None:
    ratio = np.linspace(0.0, 3.1, 100)
    delta = rows[0]["delta"]
    ax.axvline(1.0, color=common.COLOURS[4], ls=":")
    ax.axhline(0.0, color=common.COLOURS[4], lw=0.6)
    ax.plot(ratio, growth(delta, ratio), color=common.COLOURS[0], label="theory")
    ax.plot([row["ratio"] for row in rows], [row["rate"] for row in rows], "o", color=common.COLOURS[1], label="measured")
    ax.set(xlabel="k_s/κ", ylabel="growth rate · √(m/κ)", title=f"Winding in: stable above k_s = κ (δ = {delta:g})")
    ax.legend()


def _draw_winding(ax, rows) -> None:
    u = np.linspace(0.0, 2.0 * H, 200)
    ax.plot(1e3 * u, force(u), color=common.COLOURS[0], label="theory: f(u)")
    for row, colour, mark in zip(rows, common.COLOURS[1:], ".x+^v"):
        ax.plot(1e3 * common.numbers(row["u"]), row["load"], mark, color=colour, label=f"k_s = {row['ratio']:g} κ")
        if row["jump"]:
            leaves, load, lands, after = row["jump"]
            ax.plot([1e3 * leaves, 1e3 * lands], [load, after], color=colour, lw=0.9, ls="--", label="theory: slope −k_s")
    ax.set(xlabel="u, mm", ylabel="tension of the winding string, N", title="Winding in: path")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)


def _draw_steps(ax, rows) -> None:
    span = np.geomspace(0.008, 1.5, 60)
    for (method, mark), line in zip(METHOD_MARK.items(), ("-", "--")):
        for delta, colour in DELTA_COLOUR.items():
            theory = np.abs([stepped_growth(method, delta, step) - 1.0 for step in span])
            ax.plot(span, theory, color=colour, ls=line, lw=0.9)
            chosen = [row for row in rows if (row["method"], row["delta"]) == (method, delta)]
            steps, errors = (common.numbers([row[key] for row in chosen]) for key in ("step", "error"))
            ax.plot(steps, errors, mark, color=colour, fillstyle="none")
            ax.plot(steps[np.isnan(errors)], np.full(np.isnan(errors).sum(), 3.0), "x", color=colour)
    for delta, colour in DELTA_COLOUR.items():
        if edge_of_rk4(delta) < span[-1]:
            ax.axvline(edge_of_rk4(delta), color=colour, lw=0.9, ls=":")
    handles = [
        Line2D([], [], ls="", marker=mark, mfc="none", color="black", label=METHODS[name].label)
        for name, mark in METHOD_MARK.items()
    ]
    handles += [Line2D([], [], ls="", marker="o", color=c, label=f"δ = {d:g}") for d, c in DELTA_COLOUR.items()]
    handles += [
        Line2D([], [], color=common.COLOURS[4], label="error of r at u = h"),
        Line2D([], [], color="black", ls=":", label="theory: RK4's edge"),
        Line2D([], [], ls="", marker="x", color="black", label="lost"),
    ]
    ax.set(
        xscale="log",
        yscale="log",
        xlim=(0.007, 1.7),
        ylim=(1e-10, 10.0),
        xlabel="step · r",
        ylabel="relative error of the time on branch II",
        title="The step that the snap needs; lines: scale only",
    )
    ax.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)


def edge_of_rk4(delta: float) -> float:
    """Step, in 1/r, at which RK4 leaves its region of stability by the damped root at u = h: R(z) = 1 at z = -2.785."""
    edge = brentq(lambda z: METHODS["rk4"].stability(z) - 1.0, -3.0, -2.5)
    return edge / (-delta - float(growth(delta))) * float(growth(delta))


def words(data: dict) -> dict:
    """What the page says besides its tables."""
    constants = {"resolved": RESOLVED, "lever": LEVER, "Q": Q, "zeta": ZETA, "h": H}
    return constants | {
        "off_growth": 100.0 * common.worst(data["growth"], "rate"),
        "off_time": 100.0 * common.worst(data["snap"] + data["overload"], "time"),
        "off_winding": 100.0 * common.worst(data["winding_growth"], "rate"),
        "labels": {name: METHODS[name].label for name in STEPPED},
    }


STUDY = common.Study(__doc__, "branch_two", measure, draw, words)

if __name__ == "__main__":
    STUDY.main()
