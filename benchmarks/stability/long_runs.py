"""Long runs without damping: energy and momentum of a free prism over 1e5 periods of its breathing mode.

python -m benchmarks.stability.long_runs [--redraw]
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from benchmarks.harness import page as common
from benchmarks.harness.problems import prism
from tensegrity_core.errors import SimulationError
from tensegrity_core.kernel import Kernel
from tensegrity_core.model import Model
from tensegrity_core.native import build

from .methods import METHODS
from .spectrum import node_tangent, tangent

PERIODS, INSTANTS = 1e5, 60
NATIVE = build.HERE
#: A tolerance that leaves max_step in charge.
LOOSE = 0.1
#: The largest time that one call advances, in periods.
CALL = 500.0


class Setting(NamedTuple):
    """method; steps: per period, held at max_step, 0 where the tolerance decides; tolerance."""

    method: str
    steps: int = 0
    tolerance: float = LOOSE


#: Held steps on the small breathing, which linear theory describes.
HELD = (
    *(Setting("rk4", n) for n in (20, 40, 80)),
    *(Setting("ros2", n) for n in (25, 50, 100)),
    *(Setting("dop853", n) for n in (6, 8, 12)),
    *(Setting("rodas5p", n) for n in (10, 20, 40)),
)
#: What is run on the motions beyond it.
FREE = (
    *(Setting("dop853", 0, tol) for tol in (1e-6, 1e-8, 1e-10)),
    *(Setting("rodas5p", 0, tol) for tol in (1e-6, 1e-8)),
    *(Setting("radau9", 0, tol) for tol in (1e-6, 1e-8, 1e-10)),
    Setting("rk4", 40),
    Setting("rk4", 160),
    Setting("ros2", 100),
)


# ------------------------------------------------------------------------------------------------------- the structure


def prism_at_rest(prestress: float) -> Model:
    """The free prism of the benchmarks' problems at rest, its centre of mass at the origin; prestress: of the verticals, N."""
    model = prism(prestress, np.zeros((3, 3)), np.zeros((3, 3)), 0.0)
    nodes = model.nodes - model.nodes.mean(axis=0)
    return replace(model, nodes=nodes, nominal=nodes)


def breathing_mode(model: Model) -> tuple[float, np.ndarray]:
    """Frequency, 1/s, and shape (N, 3), largest node 1, of the mode that widens and narrows both triangles.

    Of the linearised motion's modes it is the one with the largest part along the nodes' radii.
    """
    kernel, moved, T = tangent(model)
    fields, stiffness = node_tangent(model), kernel.jacobian(kernel.state)[0]
    squares, vectors = np.linalg.eig(T.T @ stiffness @ T)
    radial = model.nodes * [1.0, 1.0, 0.0]
    weights = np.linalg.lstsq(moved.T, T @ vectors.real, rcond=None)[0]
    shapes = np.tensordot(weights.T, fields, 1)
    match = [abs(np.sum(shape * radial)) / np.linalg.norm(shape) for shape in shapes]
    best = int(np.argmax(match))
    shape = shapes[best] / np.linalg.norm(shapes[best], axis=1).max()
    return float(np.sqrt(-squares[best].real)), shape


class Motion(NamedTuple):
    """model: with its start velocities; omega: breathing frequency, 1/s; linear: small enough for linear theory."""

    model: Model
    omega: float
    linear: bool
    title: str

    @property
    def period(self) -> float:
        return 2.0 * np.pi / self.omega


def motion(name: str) -> Motion:
    """One of `MOTIONS`."""
    prestress, amplitude, spin, title = MOTIONS[name]
    model = prism_at_rest(prestress)
    omega, shape = breathing_mode(model)
    velocity = amplitude * omega * shape
    for bar, turn in zip(model.bars, np.asarray(spin)):
        about = model.nodes[bar].mean(axis=0) if name == "slack" else 0.0
        velocity[bar] += np.cross(turn, model.nodes[bar] - about)
    return Motion(replace(model, velocity=velocity), omega, name == "breathing", title)


#: Prestress, N; amplitude of the breathing, m; how the bars turn, 1/s (about the centre of mass; where strings go slack each
#: about its own centre); title.
MOTIONS = {
    "breathing": (20.0, 2e-4, np.zeros((3, 3)), "small breathing"),
    "spinning": (20.0, 2e-3, np.tile([0.3, 0.2, 2.0], (3, 1)), "spinning and breathing, strings taut"),
    "slack": (2.0, 2e-3, [[2.6, -1.4, 1.8], [0.6, 0.6, 1.8], [-1.4, 2.6, 1.8]], "tumbling bars, strings slack and taut"),
}


# ------------------------------------------------------------------------------------------------------- what is measured


class Integrals(NamedTuple):
    """energy: J; linear: (3,) kg m/s; angular: (3,) kg m2/s about the origin."""

    energy: float
    linear: np.ndarray
    angular: np.ndarray


def integrals(model: Model, kernel: Kernel) -> Integrals:
    """The conserved quantities of the present state; all nodes are free."""
    r, v = kernel["position"].reshape(-1, 3)[model.bars], kernel["velocity"].reshape(-1, 3)[model.bars]
    mass = model.bar_mass[:, None]
    centre, b, centre_rate, b_rate = r.mean(axis=1), r[:, 1] - r[:, 0], v.mean(axis=1), v[:, 1] - v[:, 0]
    angular = np.sum(mass * np.cross(centre, centre_rate) + mass / 12.0 * np.cross(b, b_rate), axis=0)
    energy = sum(float(kernel[name][0]) for name in ("kinetic", "potential", "elastic"))
    return Integrals(energy, np.sum(mass * centre_rate, axis=0), angular)


def run(moving: Motion, setting: Setting, periods: float = PERIODS, instants: int = INSTANTS) -> dict:
    """Errors of the conserved quantities at log-spaced times (in periods), relative to the start's kinetic energy, to the sum
    of the bars' momenta and to the angular momentum (for want of one, to what the bars' momenta would have at the radius)."""
    model = moving.model
    step = moving.period / setting.steps if setting.steps else 0.0
    kernel = Kernel(model, method=setting.method, tolerance=setting.tolerance, max_step=step)
    kernel.initialize()
    start, kinetic = integrals(model, kernel), float(kernel["kinetic"][0])
    speed = np.linalg.norm(model.velocity[model.bars].mean(axis=1), axis=1)
    momentum = float(model.bar_mass @ speed)
    turning = max(float(np.linalg.norm(start.angular)), momentum * float(np.hypot(*model.nodes[0, :2])))
    rows, failed = [], None
    try:
        for until in np.unique(np.round(np.geomspace(1.0, periods, instants))):
            advance(kernel, until * moving.period, CALL * moving.period)
            now = integrals(model, kernel)
            drifts = (np.linalg.norm(now.linear - start.linear), np.linalg.norm(now.angular - start.angular))
            rows.append((until, (now.energy - start.energy) / kinetic, drifts[0] / momentum, drifts[1] / turning))
    except SimulationError as error:
        failed = str(error)
    errors = dict(zip(("periods", "energy", "linear", "angular"), zip(*rows)))
    counts = {"step_count": kernel.stats["steps"], "transitions": kernel.stats["transitions"]}
    return {**setting._asdict(), **errors, "failed": failed, **counts}


def advance(kernel: Kernel, until: float, longest: float) -> None:
    """To a time (s), by calls of at most `longest` (s)."""
    while until - kernel.time > 1e-9 * longest:
        kernel.step(min(longest, until - kernel.time))


# ---------------------------------------------------------------------------------------------------------------- theory


def tableau(method: str) -> dict[str, np.ndarray]:
    """The constant arrays of a method's tableau in the kernel, by name."""
    text = re.sub(r"/\*.*?\*/", "", (NATIVE / "methods" / f"{method}_tableau.h").read_text(encoding="utf-8"), flags=re.DOTALL)
    found = {}
    for name, shape, body in re.findall(r"static const double (\w+)((?:\[\d+\])*) = (.*?);", text, flags=re.DOTALL):
        values = [float(x) for x in re.findall(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?", body)]
        found[name] = np.array(values).reshape([int(n) for n in re.findall(r"\d+", shape)])
    return found


def stability(method: str) -> Callable[[complex], complex]:
    """R: the factor of a step on y' = lambda y with z = h lambda; of ROS2 with the exact Jacobian."""
    if method in METHODS:
        return METHODS[method].stability
    t = tableau(method)
    if method == "dop853":
        A, b = t["A"][:12, :12], t["A"][12, :12]
        return lambda z: 1.0 + z * (b @ np.linalg.solve(np.eye(12) - z * A, np.ones(12)))
    # Rodas5P in transformed variables: U = S (1 + A U) z + S C U with S = 1/(1/GAMMA - z)
    A, C, weights = t["A"], t["C"], np.append(t["A"][7, :7], 1.0)

    def rosenbrock(z):
        U = np.linalg.solve((1.0 / t["GAMMA"] - z) * np.eye(8) - z * A - C, z * np.ones(8))
        return 1.0 + weights @ U

    return rosenbrock


def energy_theory(method: str, steps: int, periods: np.ndarray) -> np.ndarray:
    """Relative energy error of a harmonic motion after that many periods with that many steps each: |R(i omega h)|^2n - 1."""
    growth = 2.0 * np.log(abs(stability(method)(2j * np.pi / steps)))
    with np.errstate(over="ignore"):
        return np.expm1(growth * steps * np.asarray(periods, dtype=float))


def measure() -> dict:
    found = {}
    for name in MOTIONS:
        moving = motion(name)
        runs = [run(moving, setting) for setting in (HELD if moving.linear else FREE)]
        for row in runs:
            if moving.linear:
                row["theory"] = energy_theory(row["method"], row["steps"], row["periods"])
        found[name] = {"title": moving.title, "omega": moving.omega, "period": moving.period, "runs": runs}
    return {"periods": PERIODS, "motions": found}


# ---------------------------------------------------------------------------------------------------------------- figure

COLOUR = dict(zip(("rk4", "ros2", "dop853", "rodas5p", "radau9"), common.COLOURS))
MARK = dict(zip(COLOUR, common.MARKS))
#: Of the marks of a method's first run, its second ...
FILLS = ("full", "none", "left", "bottom")


def label(run: dict) -> str:
    return f"{run['method']}, " + (f"{run['steps']} steps" if run["steps"] else f"tolerance {run['tolerance']:.0e}")


def draw_errors(axes, runs: list[dict], name: str) -> None:
    """Errors as points; theory, where there is any, as lines."""
    seen: dict[str, int] = {}
    for run in runs:
        nth = seen[run["method"]] = seen.get(run["method"], -1) + 1
        colour, errors = COLOUR[run["method"]], np.abs(common.numbers(run[name]))
        mark = {"marker": MARK[run["method"]], "ls": "", "ms": 2.5, "fillstyle": FILLS[nth], "mew": 0.7}
        axes.plot(run["periods"], errors, color=colour, label=label(run), rasterized=True, zorder=3, **mark)
        if name == "energy" and "theory" in run:
            axes.plot(run["periods"], np.abs(common.numbers(run["theory"])), color=colour, lw=0.9, zorder=2.5)
    axes.set(xscale="log", yscale="log")


def reference_growth(axes, periods, level: float) -> None:
    """Growth with the square root of the time, and with the time, from a level at one period."""
    t = common.numbers(periods)
    axes.plot(t, level * np.sqrt(t), color=common.COLOURS[0], lw=0.9, label="√t")
    axes.plot(t, level * t, color=common.COLOURS[0], lw=0.9, ls="--", label="t")


def draw(data: dict) -> Figure:
    figure = common.new_figure(10.0, 9.8)
    panels = figure.subplots(3, 3)
    titles = {"energy": "energy", "angular": "angular momentum", "linear": "linear momentum"}
    for row, (key, name) in zip(panels, titles.items()):
        for axes, moving in zip(row, data["motions"].values()):
            draw_errors(axes, moving["runs"], key)
            if key == "energy":
                axes.set_title(moving["title"])
            if key == "linear":
                reference_growth(axes, moving["runs"][0]["periods"], 1e-15)
                axes.set(ylim=(1e-17, 1e-9), xlabel="time, periods")
        row[0].set_ylabel(f"relative error of the {name}")
    growth = (("-", "grows as √t"), ("--", "grows as t"))
    panels[2, 0].legend(handles=[Line2D([], [], color=common.COLOURS[0], ls=ls, label=text) for ls, text in growth])
    for axes, side, runs in ((panels[0, 0], "left", "left column"), (panels[0, 1], "right", "other columns")):
        figure.legend(*axes.get_legend_handles_labels(), loc=f"outside lower {side}", ncols=3, title=runs, title_fontsize=7)
    return figure


# ------------------------------------------------------------------------------------------------------------------ page


def off_theory(runs: list[dict], method: str) -> float:
    """The largest relative difference from theory, of errors above 1e-6 and below a half."""
    worst = 0.0
    for run in runs:
        if run["method"] == method:
            measured, theory = common.numbers(run["energy"]), common.numbers(run["theory"])
            judged = (np.abs(theory) > 1e-6) & (np.abs(theory) < 0.5)
            worst = max(worst, float(np.max(np.abs(measured / theory - 1.0)[judged], initial=0.0)))
    return worst


def growth_exponent(run: dict, name: str) -> float:
    """Of the error with time, over the last three decades."""
    t, e = common.numbers(run["periods"]), np.abs(common.numbers(run[name]))
    late = (t >= 1e-3 * t[-1]) & (e > 0.0)
    return float(np.polyfit(np.log(t[late]), np.log(e[late]), 1)[0])


def words(data: dict) -> dict:
    """What the page says of these data."""
    motions, linear = data["motions"], data["motions"]["breathing"]["runs"]
    runs = [run for moving in motions.values() for run in moving["runs"]]
    return {
        "off": 100.0 * max(off_theory(linear, method) for method in ("rk4", "dop853", "rodas5p")),
        "off_ros2": 100.0 * off_theory(linear, "ros2"),
        "largest": max(run["linear"][-1] for run in runs),
        "most": max(run["transitions"] for run in motions["slack"]["runs"]),
        "exponents": np.percentile([growth_exponent(run, "linear") for run in runs], [25, 50, 75]),
        "label": label,
        "loose": LOOSE,
    }


STUDY = common.Study(__doc__, "long_runs", measure, draw, words)

if __name__ == "__main__":
    STUDY.main()
