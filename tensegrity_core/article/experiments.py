"""The article's experiments (sections III and IV): what is done to which system, and what is read off.

Each `experiment_...` returns its data; their `columns` are the CSV file's, their `summary` the command's table.  The scene
NAME has plain strings, NAME_nsh the article's NSH.  What the article leaves open and is chosen here stands with each function.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..kernel import simulate
from ..kernel.peaks import largest
from ..laws import law
from ..laws.beam import beam_extrema, beam_force
from ..model import NSH, Inputs, Model, Result, grid, held
from ..progress import Told, each, nobody
from ..scene import load_scene
from ..statics import build_model
from . import one_dimensional

SYSTEMS = ("two_bar", "three_bar", "six_bar")
KINDS = {"": "without NSH", "_nsh": "with NSH"}
STEP = 0.01  # s, between communication points: the article's outer step

#: I: lifts, N, and how long each is held, s.
LIFTS, LIFT_DURATION = tuple(range(10, 73, 2)), 50.0
#: II: half height of the wave, N; its period, s; dampings, N s/m; simulated time, s (the figures' is not given).
WAVE, PERIOD, DAMPINGS, WAVE_DURATION = 400.0, 1.0, (500.0, 50.0, 5000.0), 5.0
#: III: amplitude, m; period, start and end of the sine, s.
SINE, SINE_PERIOD, SINE_START, SINE_DURATION = 0.15, 2.5, 2.0, 10.0
#: IV: step of the force, N; kg, N/m and N s/m, see experiment_4; simulated time and time between samples, s.
PULSE, MASS, STIFFNESS, DAMPING, PULSE_DURATION, PULSE_STEP = 100.0, 1.0, 5000.0, 500.0, 4.0, 2.5e-3
#: Figure 3's beam, and points on the curves of figures 3 and 5.
BEAM, CURVE_POINTS = NSH((6.0,), (5.0,), (0.015,)), 1001


def system(name: str) -> Model:
    """The model of a built-in scene."""
    return build_model(load_scene(name))


def top_nodes(model: Model) -> np.ndarray:
    """Indices of the free nodes at the largest height, within 1 % of the structure's height."""
    height = model.nominal[:, 2]
    reach = 0.01 * float(np.ptp(height)) + 1e-9
    free = model.free_nodes
    return free[height[free] >= np.max(height[free]) - reach]


def top_strings(model: Model) -> np.ndarray:
    """(S,) bool: strings that join two top nodes."""
    return np.asarray(np.isin(model.strings, top_nodes(model)).all(axis=1))


def damped(model: Model, damping: float) -> Model:
    """With this damping of every string, N s/m."""
    return replace(model, damping=np.full(len(model.strings), float(damping)))


def upward(model: Model, nodes: int | np.ndarray, force: float = 1.0) -> np.ndarray:
    """(N, 3) N: a force up on each of these nodes."""
    push = np.zeros((len(model.nodes), 3))
    push[nodes, 2] = force
    return push


# --- I: steady heights -------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class SteadyHeights:
    """Where a system rests under each of F lifts.

    force: (F,) N on each top node; nodes: names of the T top nodes; height: (F, T) m, their z; elastic_force: (F, S) N;
    string_length: (F, S) m; snapped: (F, H) beams of each NSH past their force maximum; speed: (F,) m/s, the fastest node at
    the end of the run.
    """

    model: Model
    force: np.ndarray
    nodes: tuple[str, ...]
    height: np.ndarray
    elastic_force: np.ndarray
    string_length: np.ndarray
    snapped: np.ndarray
    speed: np.ndarray

    @property
    def start(self) -> np.ndarray:
        """(T,) m: heights at the start, without lift."""
        return self.model.nodes[top_nodes(self.model), 2]

    def snaps(self) -> list[tuple[float, float, int]]:
        """(last lift before, first lift after, beams that snapped between them in the NSH where most did), in order."""
        most = self.snapped.max(axis=1, initial=0)
        return [(self.force[i], self.force[i + 1], int(most[i + 1] - most[i])) for i in np.flatnonzero(np.diff(most))]


def steady_heights(
    model: Model,
    forces: Sequence[float],
    duration: float = LIFT_DURATION,
    tolerance: float = 1e-10,
    told: Told = nobody,
) -> SteadyHeights:
    """Heights of the top nodes after `duration` (s) under an upward force on each of them, for each of `forces` (N); told: the
    part that is done, 0 to 1.

    Every lift is a run of its own, from the model's start, as in the article: so several beams may snap on the way, and the
    motion may carry a system past an equilibrium.  Raises SimulationError where the kernel cannot go on.
    """
    top, force = top_nodes(model), np.asarray(forces, dtype=float)
    ends = [_lifted(model, top, f, duration, tolerance) for f, _ in each(force.tolist(), told)]
    return SteadyHeights(
        model=model,
        force=force,
        nodes=tuple(model.node_names[i] for i in top),
        height=np.array([end.position[-1, top, 2] for end in ends]),
        elastic_force=np.array([end.elastic_force[-1] for end in ends]),
        string_length=np.array([end.string_length[-1] for end in ends]),
        snapped=np.array([end.snapped[-1] for end in ends], dtype=int),
        speed=np.array([np.linalg.norm(end.velocity[-1], axis=1).max() for end in ends]),
    )


def _lifted(model: Model, top: np.ndarray, force: float, duration: float, tolerance: float) -> Result:
    push = upward(model, top, force)
    return simulate(model, held(model, np.array([0.0, duration]), lambda t: push), tolerance=tolerance)


@dataclass(frozen=True)
class Steady:
    """Experiment I: scene -> its heights."""

    runs: dict[str, SteadyHeights]

    def columns(self) -> dict[str, np.ndarray]:
        """Lift (N); per scene heights (m), elastic forces (N) and snapped beams of strings, and the speed at the end (m/s)."""
        found = {"force": next(iter(self.runs.values())).force}
        for name, run in self.runs.items():
            found |= {f"{name}.{node}.z": z for node, z in zip(run.nodes, run.height.T)}
            names = run.model.string_names
            found |= {f"{name}.{s}.elastic_force": f for s, f in zip(names, run.elastic_force.T)}
            found |= {f"{name}.{names[i]}.snapped": n for i, n in zip(run.model.nsh_strings, run.snapped.T)}
            found[f"{name}.speed"] = run.speed
        return found

    def records(self) -> list[dict[str, Any]]:
        """The same by scene, m, N and m/s; snaps: (last lift before, first lift after, beams)."""
        return [
            {
                "scene": name,
                "lift": run.force.tolist(),
                "height": run.height.mean(axis=1).tolist(),
                "snaps": [(float(a), float(b), n) for a, b, n in run.snaps()],
                "fastest_at_the_end": float(run.speed.max()),
            }
            for name, run in self.runs.items()
        ]

    def summary(self) -> str:
        rows = [["scene", "z of the top nodes", "range", "snaps between", "fastest at the end"]]
        for name, run in self.runs.items():
            z = run.height.mean(axis=1)
            snaps = ", ".join(f"{a:g}-{b:g} N" for a, b, _ in run.snaps()) or "none"
            shown = f"{z[0]:.4f} m at {run.force[0]:g} N, {z[-1]:.4f} m at {run.force[-1]:g} N"
            rows.append([name, shown, f"{1e3 * np.ptp(z):.1f} mm", snaps, f"{run.speed.max():.1e} m/s"])
        return _table(rows)


def experiment_1(
    systems: Sequence[str] = SYSTEMS,
    duration: float = LIFT_DURATION,
    forces: Sequence[float] = LIFTS,
    told: Told = nobody,
) -> Steady:
    """I: every top node is lifted by a constant force; the height at which the system comes to rest."""
    names = [name + kind for name in systems for kind in KINDS]
    return Steady({name: steady_heights(system(name), forces, duration, told=one) for name, one in each(names, told)})


# --- II: square wave ---------------------------------------------------------------------------------------------


def square_wave(model: Model, **options) -> Result:
    """The motion under a square wave; options: see wave_inputs."""
    return simulate(model, wave_inputs(model, **options))


def wave_inputs(
    model: Model, node: str = "n4", duration: float = WAVE_DURATION, amplitude: float = WAVE, phase: float = 0.0
) -> Inputs:
    """The forces of `wave_force`, held from one communication point to the next."""
    return held(model, grid(duration, STEP), wave_force(model, node, amplitude, phase))


def wave_force(model: Model, node: str = "n4", amplitude: float = WAVE, phase: float = 0.0) -> Callable[[float], np.ndarray]:
    """A vertical square wave on a node: +amplitude (N) for half a period first; phase: periods that the wave has run before.

    That it starts upwards is chosen here; phase = 0.5 starts it downwards.  t in s -> (N, 3) N.
    """
    push = upward(model, model.node_names.index(node), amplitude)
    return lambda t: push if (t / PERIOD + phase) % 1.0 < 0.5 else -push


def displacement(result: Result, node: int) -> np.ndarray:
    """(K+1, 3) m: of a node from its place at the start."""
    return result.position[:, node] - result.position[0, node]


@dataclass(frozen=True, eq=False)
class WavePeaks:
    """What is largest in a run, also between its communication points.  way: m, of a node from its start; force: N, elastic, of
    some strings together; swing: (3,) m, how far each coordinate swings at the end."""

    way: float
    force: float
    swing: np.ndarray


@dataclass(frozen=True, eq=False)
class Wave:
    """Experiment II: (scene, damping in N s/m) -> its motion, and what is largest in it; node: the one that is watched; string:
    likewise."""

    runs: dict[tuple[str, float], Result]
    peaks: dict[tuple[str, float], WavePeaks]
    model: Model
    node: str = "n5"
    string: str = "s1"

    def displacement(self, name: str, damping: float) -> np.ndarray:
        """(K+1, 3) m: of the watched node."""
        return displacement(self.runs[name, damping], self.model.node_names.index(self.node))

    def string_force(self, name: str, damping: float) -> np.ndarray:
        """(K+1,) N: elastic force of the watched string."""
        return self.runs[name, damping].elastic_force[:, self.model.string_names.index(self.string)]

    @property
    def times(self) -> np.ndarray:
        return next(iter(self.runs.values())).times

    def columns(self) -> dict[str, np.ndarray]:
        """Time (s); per scene and damping the displacement of n5 (m) and the elastic force of n1-n4 (N)."""
        found = {"time": self.times}
        for name, damping in self.runs:
            prefix = f"{name}.d{damping:g}"
            moved = self.displacement(name, damping)
            found |= {f"{prefix}.{self.node}.d{axis}": moved[:, i] for i, axis in enumerate("xyz")}
            found[f"{prefix}.{self.string}.elastic_force"] = self.string_force(name, damping)
        return found

    def records(self) -> list[dict[str, Any]]:
        """The same by run, N s/m, m and N."""
        return [
            {
                "scene": name,
                "damping": damping,
                "node": self.node,
                "largest_way": found.way,
                "swing": found.swing.tolist(),
                "string": self.string,
                "largest_force": found.force,
            }
            for (name, damping), found in self.peaks.items()
        ]

    def summary(self) -> str:
        node, string = self.node, self.string
        rows = [["scene", "d", f"largest way of {node}", "swing in x, y, z, last period", f"largest force of {string}"]]
        for name, damping in self.runs:
            found = self.peaks[name, damping]
            swing = ", ".join(f"{x:.3f}" for x in found.swing)
            rows.append([name, f"{damping:g} N s/m", f"{found.way:.3f} m", f"{swing} m", f"{found.force:.1f} N"])
        return _table(rows)


def experiment_2(duration: float = WAVE_DURATION, dampings: Sequence[float] = DAMPINGS, told: Told = nobody) -> Wave:
    """II: the three-bar system under a square wave on n4, at three dampings of all strings, without and with NSH."""
    runs, peaks = {}, {}
    for (damping, kind), one in each(list(itertools.product(dampings, KINDS)), told):
        model = damped(system("three_bar" + kind), damping)
        inputs = wave_inputs(model, duration=duration)
        runs[model.name, damping] = simulate(model, inputs)
        peaks[model.name, damping] = wave_peaks(model, inputs, Wave.node, [Wave.string], told=one)
    return Wave(runs, peaks, model)


def wave_peaks(
    model: Model,
    inputs: Inputs,
    node: str,
    strings: Sequence[str],
    drawn: float = np.inf,
    last: float = PERIOD,
    told: Told = nobody,
) -> WavePeaks:
    """Of a run; drawn: s, until which way and force are taken; last: s, over which the swing is."""
    place, chosen = model.node_names.index(node), [model.string_names.index(name) for name in strings]

    def watched(result: Result) -> np.ndarray:
        moved, times = displacement(result, place), result.times
        force = result.elastic_force[:, chosen].sum(axis=1)
        until, since = times <= drawn + 1e-9, times >= times[-1] - last - 1e-9
        early = np.column_stack((np.linalg.norm(moved, axis=1), force))
        late = np.hstack((moved, -moved))
        return np.hstack([np.where(at[:, None], x, x[at].min(axis=0)) for at, x in ((until, early), (since, late))])

    way, force, *ends = largest(model, inputs, watched, told)
    return WavePeaks(float(way), float(force), np.add(ends[:3], ends[3:]))


# --- III: actuated top strings -----------------------------------------------------------------------------------


def actuated(model: Model, duration: float = SINE_DURATION) -> Result:
    """The motion under these rest lengths, see sine_inputs."""
    return simulate(model, sine_inputs(model, duration))


def sine_inputs(model: Model, duration: float = SINE_DURATION) -> Inputs:
    """Rest lengths of the top strings as xi0(0) + 0.15 m sin(2 pi (t - 2 s) / 2.5 s) from t = 2 s on."""
    moving = top_strings(model)

    def rest_length(t: float) -> np.ndarray:
        return model.rest_length + moving * (SINE * np.sin(2.0 * np.pi * max(t - SINE_START, 0.0) / SINE_PERIOD))

    return held(model, grid(duration, STEP), rest_length=rest_length)


def sine_peaks(model: Model, inputs: Inputs, told: Told = nobody) -> tuple[float, np.ndarray]:
    """m, of the last node from 2 s on, also between the communication points: its largest way, and by axis (axes,) its
    swing."""

    def watched(result: Result) -> np.ndarray:
        moved = displacement(result, len(model.nodes) - 1)[:, list(model.axes)]
        found = np.hstack((np.linalg.norm(moved, axis=1)[:, None], moved, -moved))
        since = result.times >= SINE_START - 1e-9
        return np.where(since[:, None], found, found[since].min(axis=0))

    way, *ends = largest(model, inputs, watched, told)
    return float(way), np.add(ends[: len(model.axes)], ends[len(model.axes) :])


@dataclass(frozen=True, eq=False)
class Actuation:
    """Experiment III: scene -> its model and motion, and what is largest in it, see sine_peaks."""

    runs: dict[str, tuple[Model, Result]]
    peaks: dict[str, tuple[float, np.ndarray]]

    def rows(self) -> np.ndarray:
        """Rows of the results from 2 s on."""
        _, result = next(iter(self.runs.values()))
        return np.flatnonzero(result.times >= SINE_START - 1e-9)

    def displacement(self, name: str) -> np.ndarray:
        """(rows, axes) m: of the last node, from 2 s on, from its place at the start."""
        model, result = self.runs[name]
        return displacement(result, len(model.nodes) - 1)[self.rows()][:, list(model.axes)]

    @property
    def times(self) -> np.ndarray:
        return next(iter(self.runs.values()))[1].times[self.rows()]

    def columns(self) -> dict[str, np.ndarray]:
        """Time (s); per scene the displacement of the last node (m)."""
        found = {"time": self.times}
        for name, (model, _) in self.runs.items():
            axes = ["xyz"[axis] for axis in model.axes]
            found |= {f"{name}.{model.node_names[-1]}.d{a}": x for a, x in zip(axes, self.displacement(name).T)}
        return found

    def records(self) -> list[dict[str, Any]]:
        """The same by scene, m."""
        found = []
        for name, (model, _) in self.runs.items():
            way, swings = self.peaks[name]
            swing = {"xyz"[axis]: float(swing) for axis, swing in zip(model.axes, swings)}
            found.append({"scene": name, "node": model.node_names[-1], "largest_way": way, "swing": swing})
        return found

    def summary(self) -> str:
        rows = [["scene", "node", "largest way", "swing by axis"]]
        for name, (model, _) in self.runs.items():
            way, swings = self.peaks[name]
            swing = ", ".join(f"{'xyz'[a]} {1e3 * s:.1f}" for a, s in zip(model.axes, swings))
            rows.append([name, model.node_names[-1], f"{1e3 * way:.1f} mm", f"{swing} mm"])
        return _table(rows)


def experiment_3(systems: Sequence[str] = SYSTEMS, duration: float = SINE_DURATION, told: Told = nobody) -> Actuation:
    """III: the rest lengths of the top strings move as a sine from 2 s on."""
    if not duration > SINE_START:
        raise InputError(f"duration = {duration!r} s: the strings move from {SINE_START:g} s on; simulate for longer")
    runs, peaks = {}, {}
    for name, one in each([name + kind for name in systems for kind in KINDS], told):
        model = system(name)
        inputs = sine_inputs(model, duration)
        runs[model.name] = model, simulate(model, inputs)
        peaks[model.name] = sine_peaks(model, inputs, one)
    return Actuation(runs, peaks)


# --- IV: one dimension -------------------------------------------------------------------------------------------


def article_nsh() -> NSH:
    """The honeycomb of the article's systems."""
    model = system("two_bar_nsh")
    return next(iter(model.honeycombs.values()))


@dataclass(frozen=True)
class Absorption:
    """Experiment IV: 'plain' and 'nsh' -> the motion, and what moves."""

    runs: dict[str, one_dimensional.Motion]
    systems: dict[str, one_dimensional.Oscillator]

    def stored(self, name: str) -> float:
        """J: what mass and spring hold at the end."""
        run = self.runs[name]
        return float(self.systems[name].stored(run.position[-1], run.velocity[-1]))

    def per_period(self, name: str) -> list[float]:
        """J: absorbed in each whole period."""
        return np.diff(self.runs[name].absorbed[:: round(PERIOD / PULSE_STEP)]).tolist()

    def columns(self) -> dict[str, np.ndarray]:
        """Time (s), the force (N) of the step that led there; per system x (m), x' (m/s), power (W), absorbed energy (J)."""
        first = next(iter(self.runs.values()))
        found = {"time": first.times, "force": np.concatenate((first.force[:1], first.force))}
        for name, run in self.runs.items():
            values = {"x": run.position, "velocity": run.velocity, "power": run.power, "absorbed": run.absorbed}
            found |= {f"{name}.{key}": value for key, value in values.items()}
        return found

    def records(self) -> list[dict[str, Any]]:
        """The same by system, m, W and J."""
        return [
            {
                "system": name,
                "largest_x": float(run.largest_position),
                "largest_power": float(run.largest_power),
                "absorbed": float(run.absorbed[-1]),
                "absorbed_by_period": self.per_period(name),
                "x_at_the_end": float(run.position[-1]),
                "stored_at_the_end": self.stored(name),
            }
            for name, run in self.runs.items()
        ]

    def summary(self) -> str:
        rows = [["system", "largest x", "largest power", "absorbed energy", "by period", "at the end"]]
        for name, run in self.runs.items():
            x, power = 1e3 * run.largest_position, run.largest_power
            absorbed = f"{run.absorbed[-1]:.3f} J in {run.times[-1]:g} s"
            periods = ", ".join(f"{energy:.2f}" for energy in self.per_period(name)) or "-"
            end = f"{1e3 * run.position[-1]:.1f} mm, {self.stored(name):.2f} J stored"
            rows.append([name, f"{x:.1f} mm", f"{power:.2f} W", absorbed, f"{periods} J", end])
        return _table(rows)


def experiment_4(
    duration: float = PULSE_DURATION,
    damping: float = DAMPING,
    stiffness: float = STIFFNESS,
    high: float = PULSE,
    low: float = 0.0,
    mass: float = MASS,
) -> Absorption:
    """IV: a mass on one spring and damper under a force of `high` (N) in the first half of each period and `low` in the second.

    The article gives no mass, stiffness and damping: 1 kg, 5000 N/m and 500 N s/m are those of a bar and a string of its 3D
    systems.  The stiffness is that of the plain spring, and of the NSH beyond its end.
    """
    times = grid(duration, PULSE_STEP)
    middle = 0.5 * (times[1:] + times[:-1])
    force = np.where(middle / PERIOD % 1.0 < 0.5, high, low)
    plain = one_dimensional.Oscillator(mass, stiffness, damping)
    systems = {"plain": plain, "nsh": replace(plain, element=article_nsh().element)}
    return Absorption({name: one_dimensional.simulate(each, times, force) for name, each in systems.items()}, systems)


# --- figures 3 and 5: force curves -------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Curve:
    """A force curve of an NSH over its elongation; marks: name -> (elongation in m, force in N)."""

    elongation: np.ndarray
    force: np.ndarray
    marks: dict[str, tuple[float, float]]

    def columns(self) -> dict[str, np.ndarray]:
        """Elongation (m) and force (N)."""
        return {"elongation": self.elongation, "force": self.force}

    def records(self) -> list[dict[str, Any]]:
        """The marks, m and N."""
        return [{"point": name, "elongation": float(x), "force": float(f)} for name, (x, f) in self.marks.items()]

    def summary(self) -> str:
        rows = [["point", "elongation", "force"]]
        return _table(rows + [[name, f"{1e2 * x:.4f} cm", f"{f:.4f} N"] for name, (x, f) in self.marks.items()])


def beam_curve() -> Curve:
    """Figure 3: a single beam from 0 to 2 h, with the extrema of eq. 14."""
    Q, zeta, h = (values[0] for values in (BEAM.Q, BEAM.zeta, BEAM.h))
    u = np.linspace(0.0, 2.0 * h, CURVE_POINTS)
    e = beam_extrema(Q, zeta, h)
    marks = {"f_max": (e.u_max, e.f_max), "f_min": (e.u_min, e.f_min), "f_end": (2.0 * h, beam_force(Q, zeta, h, 2.0 * h))}
    return Curve(u, beam_force(Q, zeta, h, u), marks)


def honeycomb_curve() -> Curve:
    """Figure 5: the article's NSH by Algorithm 1, from 0 to the sum of 2 h, with each beam's snap and the end."""
    made = law(article_nsh().element)
    ends = made.breakpoints
    xi = np.unique(np.concatenate((np.linspace(0.0, ends[-1], CURVE_POINTS), ends)))
    return Curve(xi, np.array([made.force(x) for x in xi.tolist()]), honeycomb_marks())


def honeycomb_marks() -> dict[str, tuple[float, float]]:
    """Name -> (elongation in m, force in N): the honeycomb's snaps and its end."""
    nsh = article_nsh()
    made = law(nsh.element)
    f_max = sorted(beam_extrema(*beam).f_max for beam in zip(nsh.Q, nsh.zeta, nsh.h))
    return {f"snap {i}": (made.elongation(f), f) for i, f in enumerate(f_max, 1)} | {"end": (made.end, made.end_force)}


# --- all of them -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Experiment:
    """about: one line; run(systems, duration, told) -> its data, telling the part that is done, 0 to 1; duration: s, by
    default, or None where nothing moves in time; many: whether systems can be chosen.
    """

    about: str
    run: Callable
    duration: float | None
    many: bool


EXPERIMENTS = {
    "I": Experiment(
        "steady heights under constant lifts (figure 6)",
        lambda systems, duration, told=nobody: experiment_1(systems, duration, told=told),
        LIFT_DURATION,
        True,
    ),
    "II": Experiment(
        "square wave on the three-bar system (figures 7 and 8)",
        lambda systems, duration, told=nobody: experiment_2(duration, told=told),
        WAVE_DURATION,
        False,
    ),
    "III": Experiment("actuated top strings (figure 9)", experiment_3, SINE_DURATION, True),
    "IV": Experiment(
        "power of a mass on a spring (figure 10)",
        lambda systems, duration, told=nobody: experiment_4(duration),
        PULSE_DURATION,
        False,
    ),
    "beam": Experiment("force curve of a beam (figure 3)", lambda *unused: beam_curve(), None, False),
    "nsh": Experiment("force curve of the honeycomb (figure 5)", lambda *unused: honeycomb_curve(), None, False),
}


def _table(rows: list[list[str]]) -> str:
    """Rows of text, the first one their heads, as aligned columns."""
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return "\n".join("  " + "  ".join(cell.ljust(w) for cell, w in zip(row, widths)).rstrip() for row in rows)
