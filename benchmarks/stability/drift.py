"""Drift of the bars' lengths under the article's formulation, beside the exact projector and projection.

python -m benchmarks.stability.drift [--redraw]
"""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import DOP853, RK45
from scipy.interpolate import CubicSpline

from benchmarks.harness import page as common
from benchmarks.harness.problems import PUSH_ASIDE, PUSH_UP, built_in, posed, push
from tensegrity_core.model import Model
from tensegrity_core.statics import member_forces

from .formulations import FACTOR, Motion, growth_rate, problem

#: e / l^2 at which a run counts as inaccurate, and as failed: its integration ends there.
LIMITS = (1e-3, 1e-1)
#: e / l^2 between which a growth rate is fitted.
FIT = (1e-9, 1e-5)
#: What a bar's e / l^2 shows of a length that is right to round-off.
ROUND_OFF = 1e-17
#: Points per history that are kept for the figure.
SHOWN = 100
#: Tensions of the mast, N, and relative errors of |b|^2 at the start, of the sweeps over them.
TENSIONS = tuple(np.geomspace(4.0, 500.0, 10))
START_ERRORS = tuple(10.0 ** np.arange(-16, -7))


class Integrator(NamedTuple):
    """A SciPy solver with its settings.  tight: what the equations do; ode45: what the article's solver does to them
    (MATLAB's ode45 is the same pair of Dormand and Prince; its default tolerances, and the article's step)."""

    solver: type
    rtol: float
    atol: float
    max_step: float


INTEGRATORS = {"tight": Integrator(DOP853, 1e-13, 1e-14, np.inf), "ode45": Integrator(RK45, 1e-3, 1e-6, 1e-3)}


class History(NamedTuple):
    """times (K,) s; error (K, B): e / l^2; theory: form -> (K, B), or empty."""

    times: np.ndarray
    error: np.ndarray
    theory: dict

    @property
    def worst(self) -> np.ndarray:
        """(K,) largest |e| / l^2 of all bars."""
        return np.abs(self.error).max(axis=1)

    def thinned(self, count: int = SHOWN) -> dict:
        """What is kept for the figure."""
        return dict(zip(("times", "error"), common.thinned(self.times, self.worst, count)))

    def times_to(self) -> list[float]:
        return [time_to(self, limit) for limit in LIMITS]


def integrate(motion: Motion, y0, duration: float, integrator: str, project: bool = False) -> History:
    """Integrate until the duration (s) or until some bar has failed.  project: put every accepted step back on the bars."""
    how = INTEGRATORS[integrator]

    def solver_at(t, y, first_step):
        first_step = min(first_step, how.max_step, duration - t)
        return how.solver(motion, t, y, duration, max_step=how.max_step, rtol=how.rtol, atol=how.atol, first_step=first_step)

    solver, times, states = solver_at(0.0, y0, 1e-4), [0.0], [y0]
    while solver.status == "running":
        solver.step()
        if solver.status == "failed":
            break
        y = motion.projected(solver.y) if project else solver.y
        times.append(solver.t)
        states.append(y)
        if not np.abs(motion.error(y)).max() < LIMITS[-1]:
            break
        if project and solver.status == "running":
            solver = solver_at(solver.t, y, solver.h_abs)
    error = np.array([motion.error(y) for y in states])
    expected = [motion.theory(y) for y in states] if motion.with_theory else []
    theory = {form: np.array([row[form] for row in expected]) for form in (expected[0] if expected else ())}
    return History(np.array(times), error, theory)


def measured_rate(history: History) -> float:
    """1/s: slope of ln max |e| where it lies within FIT; nan where fewer than 5 steps do."""
    worst = history.worst
    first = int(np.argmax(worst >= FIT[1])) if (worst >= FIT[1]).any() else len(worst)
    inside = np.flatnonzero(worst[:first] < FIT[0])
    chosen = slice(inside[-1] + 1 if len(inside) else 0, first)
    if len(worst[chosen]) < 5:
        return float("nan")
    return float(np.polyfit(history.times[chosen], np.log(worst[chosen]), 1)[0])


def time_to(history: History, limit: float) -> float:
    """s: when max |e| / l^2 first exceeds the limit (log-linear between steps); nan if it does not."""
    worst = np.maximum(history.worst, ROUND_OFF)
    beyond = np.flatnonzero(worst > limit)
    if not len(beyond):
        return float("nan")
    k = beyond[0]
    if k == 0:
        return float(history.times[0])
    part = np.log(limit / worst[k - 1]) / np.log(worst[k] / worst[k - 1])
    return float(history.times[k - 1] + part * (history.times[k] - history.times[k - 1]))


def expected_time(limit: float, error: float, rate):
    """s until e = error cosh(rate t) reaches the limit: a start that is off in length, not in rate."""
    return np.arccosh(limit / error) / rate


# ------------------------------------------------------------------------------------------------------ the structures


def mast(tension: float) -> Model:
    """A leaning mast held by two guys, of which one carries this tension (N)."""
    cable = {"stiffness": 5000.0, "damping": 50.0}
    return posed(
        name="mast",
        plane="xz",
        fixed=["foot", "left", "right"],
        nodes={"foot": [0.0, 0.0], "tip": [0.3, 1.1], "left": [-1.0, 0.1], "right": [1.3, -0.2]},
        bars={"mast": {"nodes": ["foot", "tip"], "mass": 1.0}},
        strings={"guy1": {"nodes": ["left", "tip"], **cable}, "guy2": {"nodes": ["right", "tip"], **cable}},
        prestress={"tension": {"guy1": tension}},
    )


def pendulum() -> Model:
    """A bar that hangs from its pin."""
    bars = {"bar": {"nodes": ["pin", "tip"], "mass": 1.0}}
    return posed(name="pendulum", plane="xz", fixed=["pin"], nodes={"pin": [0.0, 0.0], "tip": [0.0, -1.0]}, bars=bars)


def compression(model: Model, force=None) -> np.ndarray:
    """(B,) N: mean compression of every bar at the model's start, from statics."""
    return -member_forces(model, force)[len(model.strings) :]


def rate_of(model: Model, form: str, force=None) -> complex:
    """1/s: fastest growth rate of e at the model's start."""
    rates = growth_rate(form, compression(model, force), model.bar_mass, model.bar_length)
    return complex(rates[np.argmax(rates.real)])


# ----------------------------------------------------------------------------------------------------- what is measured

#: name -> (label, form, exact, integrator, project)
VARIANTS = {
    "matrix": ("printed form, DOP853", "matrix", False, "tight", False),
    "matrix_ode45": ("printed form, ode45", "matrix", False, "ode45", False),
    "pinned": ("per pinned bar, nominal l, DOP853", "pinned", False, "tight", False),
    "exact": ("printed form with |b|², DOP853", "matrix", True, "tight", False),
    "exact_ode45": ("printed form with |b|², ode45", "matrix", True, "ode45", False),
    "projected": ("printed form, projected, ode45", "matrix", False, "ode45", True),
}


def run_variant(model: Model, name: str, duration: float, force=None, error: float = 0.0) -> tuple[dict, History]:
    label, form, exact, integrator, project = VARIANTS[name]
    motion = Motion(problem(model, force), form, exact)
    history = integrate(motion, motion.start(error), duration, integrator, project)
    times, worst = history.times, history.worst
    ends = {"end_time": times[-1], "end_error": worst[-1], "largest": worst.max(), "steps": len(worst) - 1}
    fits = {"rate": measured_rate(history), "time_to": history.times_to()}
    return {"variant": name, "label": label, **history.thinned(), **ends, **fits}, history


def settled(duration: float = 50.0) -> dict:
    """three_bar at rest: nothing moves but what round-off starts."""
    model, rows = built_in("three_bar"), []
    for name, (_, form, exact, _, project) in VARIANTS.items():
        row, _ = run_variant(model, name, duration)
        row["theory_rate"] = None if exact or project else rate_of(model, form).real
        rows.append(row)
    return {"compression": compression(model), "duration": duration, "rows": rows}


def linear_drift(duration: float = 50.0, error: float = 1e-9, error_rate: float = 1e-8) -> dict:
    """three_bar at rest but for a length and a rate that are off, under the exact projector: e = e0 + e0' t."""
    motion = Motion(problem(built_in("three_bar")), "matrix", True)
    history = integrate(motion, motion.start(error, error_rate), duration, "tight")
    expected = error + error_rate * history.times
    deviation = float(np.abs(history.error - expected[:, None]).max())
    return {"start": [error, error_rate], **history.thinned(60), "deviation": deviation}


def pushed_runs(duration: float = 6.0, error: float = 1e-10, survivors: float = 50.0) -> dict:
    """three_bar under the push; both nominal forms from a start error, so that the theory along the motion applies."""
    model = built_in("three_bar")
    force = push(model)
    along = Motion(problem(model, force), "matrix", True, with_theory=True)
    history = integrate(along, along.start(error), duration, "tight", project=True)
    theory = {}
    for form, e in history.theory.items():
        times, shown = common.thinned(history.times, np.abs(e).max(axis=1), SHOWN)
        keep = shown < 10.0
        theory[form] = {"times": times[keep], "error": shown[keep]}
    rows = []
    for name in VARIANTS:
        begun = error if name in theory else 0.0
        row, _run = run_variant(model, name, duration if name in theory else survivors, force, begun)
        if name in theory:
            expected = History(history.times, history.theory[name], {})
            row["theory_time_to"] = expected.times_to()
        rows.append(row)
    return {"force_up": PUSH_UP, "force_aside": PUSH_ASIDE, "start": error, "theory": theory, "rows": rows}


def tension(load: float = 20.0, error: float = 1e-8, periods: float = 3.0) -> list[dict]:
    """A hanging bar with a load at its tip: e oscillates."""
    model, rows = pendulum(), []
    force = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -load]])
    pull = compression(model, force)
    for form in FACTOR:
        theory = float(growth_rate(form, pull, model.bar_mass, model.bar_length)[0].imag)
        motion = Motion(problem(model, force), form, False)
        history = integrate(motion, motion.start(error), periods * 2.0 * np.pi / theory, "tight")
        times, dense = common.thinned(history.times, history.error[:, 0])
        crossings = CubicSpline(history.times, history.error[:, 0]).roots(extrapolate=False)
        omega = float(np.pi / np.mean(np.diff(crossings)))
        row = {"form": form, "tension": -pull[0], "start": error, "omega": omega, "theory_omega": theory}
        rows.append(row | {"times": times, "error": dense / error})
    return rows


def failure(model: Model, form: str, error: float, duration: float | None = None) -> dict:
    """Growth rate and times to failure from a start error, beside the theory's; duration: s, by default what theory expects."""
    theory = rate_of(model, form).real
    motion = Motion(problem(model), form, False)
    history = integrate(motion, motion.start(error), duration or 1.5 * float(expected_time(1.0, error, theory)), "tight")
    expected = [expected_time(limit, error, theory) for limit in LIMITS]
    found = {"form": form, "start": error, "rate": measured_rate(history), "theory_rate": theory}
    return found | {"time_to": history.times_to(), "theory_time_to": expected}


def against_compression(tensions=TENSIONS, error: float = 1e-10) -> list[dict]:
    """Of the mast over the compression of its bar."""
    rows = []
    for model, form in product([mast(float(pull)) for pull in tensions], FACTOR):
        bar = {"compression": compression(model)[0], "mass": model.bar_mass[0], "length": model.bar_length[0]}
        rows.append(bar | failure(model, form, error))
    return rows


def against_start_error(errors=START_ERRORS) -> list[dict]:
    """Of three_bar at rest over the relative error of |b|^2 at the start."""
    return [failure(built_in("three_bar"), form, error, 20.0) for form, error in product(FACTOR, errors)]


def measure() -> dict:
    return {
        "limits": LIMITS,
        "settled": settled(),
        "linear": linear_drift(),
        "pushed": pushed_runs(),
        "tension": tension(),
        "compression": against_compression(),
        "start_error": against_start_error(),
    }


# ------------------------------------------------------------------------------------------------------------- figures

MARK = {"matrix": "o", "pinned": "s"}
NAME = {"matrix": "printed form", "pinned": "per pinned bar"}


def draw(data: dict) -> Figure:
    figure = common.new_figure(12.5, 7.4)
    axes = figure.subplots(2, 3).ravel()
    _draw_settled(axes[0], data)
    _draw_pushed(axes[1], data["pushed"])
    _draw_tension(axes[2], data["tension"])
    _draw_rates(axes[3], data["compression"])
    _draw_times(axes[4], data["compression"], "compression", "compression P, N")
    _draw_times(axes[5], data["start_error"], "start", "start error, e(0)/l²")
    axes[4].set_title("Time to failure, leaning mast")
    axes[5].set_title("Time to failure, three_bar at rest")
    common.lettered(axes)
    return figure


def _draw_histories(ax, rows) -> None:
    for row, colour, mark in zip(rows, common.COLOURS, common.MARKS):
        error = np.maximum(common.numbers(row["error"]), ROUND_OFF)
        ax.plot(row["times"], error, mark, ms=2.2, mew=0.6, color=colour, label=row["label"])
    ax.set(yscale="log", ylim=(5e-18, 1.0), xlabel="time, s", ylabel="largest |e| / l²")


def _draw_settled(ax, data) -> None:
    rows = data["settled"]["rows"]
    _draw_histories(ax, rows)
    for row, colour in zip(rows, common.COLOURS):
        if row["theory_rate"]:
            error, times = common.numbers(row["error"]), common.numbers(row["times"])
            anchor = int(np.argmin(np.abs(np.log(np.maximum(error, ROUND_OFF) / 1e-8))))
            t = np.linspace(times[anchor] - np.log(1e8) / row["theory_rate"], row["end_time"], 2)
            ax.plot(t, error[anchor] * np.exp(row["theory_rate"] * (t - times[anchor])), color=colour, lw=0.9)
    linear = data["linear"]
    e0, rate = linear["start"]
    t = np.linspace(0.0, 6.0, 60)
    shown = common.numbers(linear["times"]) <= 6.0
    label = f"|b|², started with e' = {rate:.0e} l²/s"
    times, error = common.numbers(linear["times"])[shown], common.numbers(linear["error"])[shown]
    ax.plot(times, error, "+", ms=4, color="#8d99ae", label=label)
    ax.plot(t, e0 + rate * t, color="#8d99ae", lw=0.9)
    ax.set(xlim=(0.0, 6.0), title="three_bar at rest; slopes √(24P/ml), √(6P/ml)")
    ax.legend(handles=ax.lines[-2:-1], loc="lower right")


def _draw_pushed(ax, data) -> None:
    _draw_histories(ax, data["rows"])
    for form, theory in data["theory"].items():
        ax.plot(theory["times"], theory["error"], color=common.COLOURS[0 if form == "matrix" else 2], lw=0.9)
    ax.set(xlim=(0.0, 9.0), title="three_bar, pushed; lines: e'' = rate(t)² e")
    ax.legend(loc="center right", bbox_to_anchor=(1.0, 0.52), title="a and b", title_fontsize=7)


def _draw_tension(ax, rows) -> None:
    for row, colour in zip(rows, common.COLOURS):
        times = common.numbers(row["times"])
        t = np.linspace(0.0, times[-1], 400)
        ax.plot(times, row["error"], MARK[row["form"]], ms=3, color=colour, label=f"{NAME[row['form']]}, measured")
        ax.plot(t, np.cos(row["theory_omega"] * t), color=colour, lw=0.9)
    ax.set(xlabel="time, s", ylabel="e(t) / e(0)", title="Tension T; lines: cos √(24T/ml)t, cos √(6T/ml)t")
    ax.set_ylim(-1.15, 1.5)
    ax.legend(loc="upper right", ncols=2)


def _draw_rates(ax, rows) -> None:
    for form, colour in zip(MARK, common.COLOURS):
        chosen = [row for row in rows if row["form"] == form]
        P = common.numbers([row["compression"] for row in chosen])
        span = np.geomspace(P.min() / 1.3, P.max() * 1.3, 50)
        ax.plot(P, [row["rate"] for row in chosen], MARK[form], color=colour, label=f"{NAME[form]}, measured")
        ax.plot(span, growth_rate(form, span, chosen[0]["mass"], chosen[0]["length"]).real, color=colour)
    ax.set(xscale="log", yscale="log", xlabel="compression P, N", ylabel="growth rate, 1/s", title="Growth rate, leaning mast")
    ax.legend()


def _draw_times(ax, rows, key: str, label: str) -> None:
    fills = ("full", "none")
    for form, colour in zip(MARK, common.COLOURS):
        chosen = [row for row in rows if row["form"] == form]
        x = common.numbers([row[key] for row in chosen])
        for i, (limit, fill) in enumerate(zip(LIMITS, fills)):
            times = common.numbers([row["time_to"][i] for row in chosen])
            expected = common.numbers([row["theory_time_to"][i] for row in chosen])
            ax.plot(x, times, MARK[form], fillstyle=fill, color=colour, label=f"{NAME[form]}, |e| > {limit:g} l²")
            ax.plot(x, expected, color=colour, ls="-" if i == 0 else "--", lw=0.9)
    ax.set(xscale="log", yscale="log" if key == "compression" else "linear", xlabel=label, ylabel="time, s")
    if key == "compression":
        ax.set_yticks([0.2, 0.5, 1.0, 2.0, 3.0], ["0.2", "0.5", "1", "2", "3"])
    ax.legend()


def words(data: dict) -> dict:
    """What the page says besides its tables: rows by variant, and how far the rates are from theory, %."""
    at_rest, when_pushed = ({row["variant"]: row for row in data[key]["rows"]} for key in ("settled", "pushed"))
    off = 100.0 * common.worst(data["compression"], "rate", "theory_rate")
    return {"at_rest": at_rest, "when_pushed": when_pushed, "off": off}


STUDY = common.Study(__doc__, "drift", measure, draw, words)

if __name__ == "__main__":
    STUDY.main()
