"""What docs/claims.md judges the article's claims by: numbers of experiments I to IV, under what the article leaves open.

A *variant* settles one open choice another way; it maps a system's model to the model that is run (of II also how the wave
starts, of IV the numbers of the oscillator).  `measure_...` turns one variant into plain numbers.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.signal import find_peaks

ROOT = Path(__file__).resolve().parent.parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "benchmarks")]

from tensegrity_core import experiments, nsh  # noqa: E402
from tensegrity_core.errors import TensegrityError  # noqa: E402
from tensegrity_core.inputs import held  # noqa: E402
from tensegrity_core.kernel import simulate  # noqa: E402
from tensegrity_core.model import Model  # noqa: E402
from tensegrity_core.result import Result  # noqa: E402
from tensegrity_core.scene import load_scene  # noqa: E402
from tensegrity_core.statics import build_model  # noqa: E402

PLAIN, NSH = "plain", "nsh"
SUFFIX = {PLAIN: "", NSH: "_nsh"}
#: II is run for longer than it is drawn, so that its last two periods can stand for the steady response.
WAVE_SECONDS, DRAWN_SECONDS = 10.0, experiments.WAVE_DURATION
#: Snap loads are bisected to this width, N.
SNAP_WIDTH = 0.01
#: How long a changed structure settles, s, before a wave.
SETTLING = 30.0
#: Dampings at which II is swept, N s/m.
SWEEP = (50, 100, 200, 300, 500, 700, 1000, 1500, 2000, 3000, 5000, 7000, 10000)
#: A turn of a series counts from this share of its swing on.
PROMINENCE = 0.01

# --- variants ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Variant:
    """key: an identifier; about: what is chosen otherwise; change(model) -> model; scale(tensions of the scene) -> tensions;
    phase: of the wave, periods; damping: factor of every d in II; oscillator: arguments of experiments.experiment_4."""

    key: str
    about: str
    change: Callable[[Model], Model] = lambda model: model
    scale: Callable[[dict], dict] | None = None
    phase: float = 0.0
    damping: float = 1.0
    oscillator: dict = field(default_factory=dict)

    def model(self, name: str) -> Model:
        """A built-in scene's model under this choice."""
        scene = load_scene(name)
        if self.scale:
            prestress = scene.prestress.model_copy(update={"tension": self.scale(scene.prestress.tension)})
            scene = scene.model_copy(update={"prestress": prestress})
        return self.change(build_model(scene))


def at_nsh_strings(name: str, factor: float | None = None, value: float | None = None) -> Callable[[Model], Model]:
    """Changes a field of the NSH strings: by a factor, or to a value."""

    def change(model: Model) -> Model:
        values = getattr(model, name).copy()
        chosen = list(model.nsh_strings)
        values[chosen] = values[chosen] * factor if value is None else value
        return replace(model, **{name: values})

    return change


def end_stiffness(model: Model) -> Model:
    """Beyond its end the NSH goes on with the slope that it has there: a table extrapolated by its last pair."""
    changed = model
    for i in model.nsh_strings:
        end = nsh.breakpoints(model.nsh[i])[-1]
        stiffness = changed.stiffness.copy()
        stiffness[i] = nsh.stiffness(model.nsh[i], end, 0.0)
        changed = replace(changed, stiffness=stiffness)
    return changed


def lengths(model: Model) -> np.ndarray:
    """(S,) m, at the start."""
    return np.linalg.norm(model.nodes[model.strings[:, 1]] - model.nodes[model.strings[:, 0]], axis=1)


def weightless(model: Model) -> Model:
    """No gravity and no tension at the start: the one equilibrium that the coordinates allow then."""
    return replace(model, gravity=0.0, rest_length=lengths(model))


def printed_inertia(model: Model) -> Model:
    """J_i = m_i l_i^2/12 in M, as the article prints it, for bars that are pinned at an end.

    Such a bar's M about its pin is m/4 + J instead of m/4 + m/12, so the motion is that of a bar of 3 (1/4 + l^2/12) times
    the mass under the same weight.
    """
    pinned = model.fixed[model.bars].any(axis=1)
    if not pinned.all() or np.ptp(model.bar_length) > 1e-3:
        raise ValueError(f"{model.name}: the bars are not all pinned and of one length")
    factor = 3.0 * (0.25 + float(np.mean(model.bar_length)) ** 2 / 12.0)
    return replace(model, bar_mass=factor * model.bar_mass, gravity=model.gravity / factor)


def beside(model: Model) -> Model:
    """The NSH in parallel with the plain string, which carries nothing at the start."""
    chosen = list(model.nsh_strings)
    plain = float(np.delete(model.stiffness, chosen)[0]) if chosen else 0.0
    added = {"stiffness": np.full(len(chosen), plain), "damping": np.zeros(len(chosen)), "rest_length": lengths(model)[chosen]}
    return replace(
        model,
        strings=np.concatenate((model.strings, model.strings[chosen])),
        string_names=(*model.string_names, *(f"{model.string_names[i]}_beside" for i in chosen)),
        nsh=(*model.nsh, *(None for _ in chosen)),
        **{name: np.concatenate((getattr(model, name), values)) for name, values in added.items()},
    )


def shortened(metres: float, top: bool) -> Callable[[Model], Model]:
    """Rest lengths of the top or of the other strings shortened, and the structure let settle before the run."""

    def change(model: Model) -> Model:
        chosen = experiments.top_strings(model) == top
        tight = replace(model, rest_length=model.rest_length - metres * chosen)
        rest = simulate(tight, held(tight, np.array([0.0, SETTLING])))
        return replace(tight, nodes=rest.position[-1])

    return change


def all_of(*changes: Callable[[Model], Model]) -> Callable[[Model], Model]:
    def change(model: Model) -> Model:
        for each in changes:
            model = each(model)
        return model

    return change


def tension_only(model: Model) -> Model:
    return replace(model, damping_law="tension_only")


def top_tension(value: float) -> Callable[[dict], dict]:
    """Of the two-bar system's top string, N; other scenes as they are."""
    return lambda tension: {"s3": value} if set(tension) == {"s3"} else tension


def level(factor: float) -> Callable[[dict], dict]:
    """Of the six-bar system's tensions; other scenes as they are."""
    return lambda tension: {k: factor * v for k, v in tension.items()} if len(tension) == 21 else tension


BASE = Variant("base", "this model")
LAW = Variant("tension_only", "dampers never push (`tension_only`)", tension_only)
BEYOND = (
    Variant("hold", "beyond 9 cm the force stays at 48 N", at_nsh_strings("stiffness", value=0.0)),
    Variant("end_slope", "beyond 9 cm the curve goes on with its last slope, 16.8 kN/m", end_stiffness),
    Variant("ten_k", "beyond 9 cm ten times the stiffness k", at_nsh_strings("stiffness", factor=10.0)),
)
DAMPERS = (
    Variant("tenth", "NSH strings with a tenth of the damping", at_nsh_strings("damping", factor=0.1)),
    Variant("undamped", "NSH strings without damper", at_nsh_strings("damping", value=0.0)),
)
PRESTRESS = (
    *(Variant(f"top_{t:g}", f"two-bar: {t:g} N in the top string", scale=top_tension(t)) for t in (6.0, 15.0, 20.0, 30.0, 40.0)),
    *(Variant(f"level_{f:g}".replace(".", "_"), f"six-bar: {f:g} times the prestress", scale=level(f))
      for f in (0.1, 0.25, 0.5, 1.5, 2.0, 3.0)),
)  # fmt: skip
PHASES = (
    Variant("down", "the wave starts with -400 N", phase=0.5),
    Variant("quarter", "the wave starts in the middle of its +400 N", phase=0.25),
    Variant("three_quarters", "the wave starts in the middle of its -400 N", phase=0.75),
)
GRAVITY = (
    Variant("no_gravity", "no gravity, rest lengths as they are", lambda model: replace(model, gravity=0.0)),
    Variant("weightless", "no gravity, no tension at the start", weightless),
)
OTHER = (
    Variant("beside", "NSH in parallel with the string, not in its place", beside),
    Variant("inertia", "J = m l²/12 in M, as printed", printed_inertia),
    Variant("hold_tension_only", "48 N beyond 9 cm, and dampers never push", all_of(at_nsh_strings("stiffness", value=0.0), tension_only)),
)  # fmt: skip
TIGHTER = (
    Variant("tight_vertical", "vertical strings 10 cm shorter, settled", shortened(0.1, top=False)),
    Variant("tight_top", "top strings 20 cm shorter, settled", shortened(0.2, top=True)),
)
HEAVIER = tuple(Variant(f"d_times_{f:g}", f"every d {f:g} times as large", damping=f) for f in (2.0, 5.0, 10.0))
STRINGS = (LAW, *BEYOND, *DAMPERS)
OSCILLATORS = (
    Variant("k15", "k = 15 kN/m, as in the 2D system", oscillator={"stiffness": 15000.0}),
    Variant("d50", "d = 50 N s/m", oscillator={"damping": 50.0}),
    Variant("d1000", "d = 1000 N s/m", oscillator={"damping": 1000.0}),
    Variant("d5000", "d = 5000 N s/m", oscillator={"damping": 5000.0}),
    Variant("m10", "m = 10 kg", oscillator={"mass": 10.0}),
    Variant("pm100", "the force is +100 and -100 N", oscillator={"low": -100.0}),
    Variant("pm50", "the force is +50 and -50 N", oscillator={"high": 50.0, "low": -50.0}),
    Variant("pm50_m10", "+50 and -50 N, m = 10 kg", oscillator={"high": 50.0, "low": -50.0, "mass": 10.0}),
)
VARIANTS = {
    "I": (BASE, *PRESTRESS, *STRINGS),
    "II": (BASE, *PHASES, *STRINGS, *HEAVIER, *GRAVITY, *TIGHTER, *OTHER),
    "III": (BASE, *PRESTRESS, *STRINGS),
    "IV": (BASE, *OSCILLATORS),
}

# --- I -----------------------------------------------------------------------------------------------------------


def measure_1(variant: Variant) -> dict:
    """Scene -> heights and snaps under the article's lifts."""
    names = [name + suffix for name in experiments.SYSTEMS for suffix in SUFFIX.values()]
    return {name: heights(variant.model(name)) for name in names}


def heights(model: Model) -> dict:
    """One system's; m, N, m/s.  bend: largest distance from the straight line through (lift, z), over the range of z."""
    run = experiments.steady_heights(model, experiments.LIFTS)
    z = run.height.mean(axis=1)
    line = np.polyval(np.polyfit(run.force, z, 1), run.force)
    return {
        "z": z.tolist(),
        "range": float(np.ptp(z)),
        "rise": float(z[-1] - z[0]),
        "bend": float(np.abs(z - line).max() / np.ptp(z)),
        "spread": float(np.ptp(run.height, axis=1).max()),
        "speed": float(run.speed.max()),
        "most_snapped": run.snapped[[0, -1]].max(axis=1, initial=0).tolist(),
        "least_snapped": run.snapped[[0, -1]].min(axis=1, initial=4 if model.nsh_strings else 0).tolist(),
        "snaps": [snaps_of(run, column) for column in kinds(model)],
        "apart": int(np.ptp(run.snapped, axis=1).max()) if model.nsh_strings else 0,
    }


def kinds(model: Model) -> list[list[int]]:
    """NSH strings that are each other's images, as columns of `snapped`: the six-bar system has two kinds, else there is one."""
    count = len(model.nsh_strings)
    return [list(range(i, i + 3)) for i in (0, 3)] if count == 6 else [list(range(count))] if count else []


def snaps_of(run: experiments.SteadyHeights, columns: list[int]) -> list[list[float]]:
    """[last lift before, first lift after, beams] of each increase in the string of the kind where most beams have snapped."""
    most = run.snapped[:, columns].max(axis=1)
    return [[float(run.force[i]), float(run.force[i + 1]), int(most[i + 1] - most[i])] for i in np.flatnonzero(np.diff(most) > 0)]


def located_snaps(name: str) -> list[dict]:
    """The base model's snaps, per kind of NSH string and beam; lifts from 0 N on, so that those below 10 N are found, too.

    lift: N, the least at which the beam is found past its maximum, by bisection; tension: N, the largest in the kind's strings
    just below it; gap_lift: N, where the height jumps most near it; gap: m, that jump between lifts SNAP_WIDTH apart.
    """
    model = BASE.model(name)
    forces = np.arange(0.0, experiments.LIFTS[-1] + 1.0, 2.0)
    run = experiments.steady_heights(model, forces)
    found = []
    for kind, columns in enumerate(kinds(model)):
        count = run.snapped[:, columns].max(axis=1)
        for beams in range(1, int(count.max()) + 1):
            low, high = forces[int(np.argmax(count >= beams)) + np.array([-1, 0])]
            found.append({"kind": kind, "beam": beams, **_snap(model, columns, beams, low, high), **_gap(model, low, high)})
    return found


def _snap(model: Model, columns: list[int], beams: int, low: float, high: float) -> dict:
    while high - low > SNAP_WIDTH:
        middle = 0.5 * (low + high)
        run = experiments.steady_heights(model, [middle])
        low, high = (low, middle) if run.snapped[0, columns].max() >= beams else (middle, high)
    below = experiments.steady_heights(model, [low])
    return {"lift": high, "tension": float(below.elastic_force[0, [model.nsh_strings[i] for i in columns]].max())}


def _gap(model: Model, low: float, high: float) -> dict:
    """Halves the interval again and again, and keeps the half over which the height rises more."""
    z_low, z_high = _height(model, low), _height(model, high)
    while high - low > SNAP_WIDTH:
        middle = 0.5 * (low + high)
        z = _height(model, middle)
        if z - z_low > z_high - z:
            high, z_high = middle, z
        else:
            low, z_low = middle, z
    return {"gap_lift": high, "gap": z_high - z_low}


def _height(model: Model, lift: float) -> float:
    return float(experiments.steady_heights(model, [lift]).height.mean())


def rise() -> dict:
    """start: m, height of the three-bar system without NSH; lift: N, at which it leaves that shape; gap: m, by how much."""
    model = BASE.model("three_bar")
    found = _gap(model, 0.0, float(experiments.LIFTS[0]))
    return {"start": _height(model, 0.0), "lift": found["gap_lift"], "gap": found["gap"]}


# --- II ----------------------------------------------------------------------------------------------------------


def measure_2(variant: Variant) -> dict:
    """'plain/500' and so on -> numbers of the three-bar system under the wave."""
    return {f"{kind}/{d:g}": wave(variant, kind, d) for d in experiments.DAMPINGS for kind in (PLAIN, NSH)}


def wave(variant: Variant, kind: str, damping: float) -> dict:
    """way: largest distance of n5 from its start in the time drawn; swing: by axis, over the last two periods, and its norm;
    away: by period, largest distance of n5's path from that of the last period, over the norm of the swing; force_peak,
    force_mean: elastic force between n1 and n4, N, in the time drawn; bar_mean: N, of all bars; snaps: beams of s1 that snap in that
    time; dissipated: J, in all."""
    scene = load_scene("three_bar" + SUFFIX[kind])
    model = build_model(scene)
    model = variant.change(replace(model, damping=np.full(len(model.strings), variant.damping * damping)))
    result = experiments.square_wave(model, duration=WAVE_SECONDS, phase=variant.phase)
    moved = experiments.displacement(result, model.node_names.index("n5"))
    drawn = result.times <= DRAWN_SECONDS + 1e-9
    swing = experiments.steady_span(result.times, moved, 2.0 * experiments.PERIOD)
    force = between(model, result, "n1", "n4")[drawn]
    snapped = result.snapped[drawn, 0] if kind == NSH else np.zeros(1, dtype=int)
    return {
        "way": float(np.linalg.norm(moved[drawn], axis=1).max()),
        "swing": [*swing.tolist(), float(np.linalg.norm(swing))],
        "away": away(moved, float(np.linalg.norm(swing))),
        "force_peak": float(force.max()),
        "force_mean": float(force.mean()),
        "bar_mean": float(np.abs(result.bar_force[drawn]).mean()),
        "snaps": int(np.maximum(np.diff(snapped), 0).sum()),
        "dissipated": float(result.dissipated[-1]),
    }


def between(model: Model, result: Result, first: str, second: str) -> np.ndarray:
    """(K+1,) N: elastic force of all strings between two nodes."""
    ends = sorted(model.node_names.index(name) for name in (first, second))
    joined = [i for i, pair in enumerate(model.strings.tolist()) if sorted(pair) == ends]
    return result.elastic_force[:, joined].sum(axis=1)


def away(moved: np.ndarray, swing: float) -> list[float]:
    """Per period but the last: the path's largest distance from that of the last one, over the swing."""
    rows = round(experiments.PERIOD / experiments.STEP)
    periods = moved[: len(moved) // rows * rows].reshape(-1, rows, 3)
    return (np.linalg.norm(periods[:-1] - periods[-1], axis=2).max(axis=1) / swing).tolist()


# --- III ---------------------------------------------------------------------------------------------------------


def measure_3(variant: Variant) -> dict:
    """Scene -> numbers of the last node's motion; system -> how far it differs with NSH."""
    found, paths = {}, {}
    for system in experiments.SYSTEMS:
        for suffix in SUFFIX.values():
            name = system + suffix
            model = variant.model(name)
            data = experiments.Actuation({name: (model, experiments.actuated(model))})
            paths[name] = data.displacement(name)
            found[name] = motion(data.times, paths[name])
        apart = np.linalg.norm(paths[system + "_nsh"] - paths[system], axis=1).max()
        found[system]["apart"] = float(apart)
    return found


def motion(times: np.ndarray, moved: np.ndarray) -> dict:
    """way: m, the largest distance; swing: m, by axis; away: path of the last period but one against the last, over the way;
    harmonics: share of the last two periods' power beyond their first harmonic; turns: per axis, in the last period."""
    rows = round(experiments.SINE_PERIOD / experiments.STEP)
    last, before = moved[-rows:], moved[-2 * rows : -rows]
    power = np.abs(np.fft.rfft(moved[-2 * rows :], axis=0)) ** 2
    way = float(np.linalg.norm(moved, axis=1).max())
    return {
        "way": way,
        "swing": np.ptp(moved, axis=0).tolist(),
        "away": float(np.linalg.norm(last - before, axis=1).max() / way),
        "harmonics": float(power[3:].sum() / power[1:].sum()),
        "turns": [turns(x) for x in last.T],
    }


def turns(series: np.ndarray) -> int:
    """Maxima and minima of a periodic series that stand out by PROMINENCE of its swing."""
    twice = np.tile(series, 2)
    least = PROMINENCE * float(np.ptp(series))
    found = [len(find_peaks(sign * twice, prominence=least)[0]) for sign in (1.0, -1.0)]
    return round(sum(found) / 2)


# --- IV and statics ----------------------------------------------------------------------------------------------


def measure_4(variant: Variant) -> dict:
    """'plain' and 'nsh' -> absorbed: J, in the whole run and in its first period; power: W, the largest; x: m, the largest."""
    data = experiments.experiment_4(**variant.oscillator)
    period = round(experiments.PERIOD / experiments.PULSE_STEP)
    return {
        name: {
            "absorbed": float(run.absorbed[-1]),
            "first": float(run.absorbed[period]),
            "power": float(run.power.max()),
            "x": float(run.position.max()),
        }
        for name, run in data.runs.items()
    }


def measure_statics() -> dict:
    """Bars, coordinates and the honeycomb."""
    honeycomb = experiments.article_nsh()
    curve = experiments.honeycomb_curve()
    beams = [nsh.beam_extrema(*beam) for beam in zip(honeycomb.Q, honeycomb.zeta, honeycomb.h)]
    models = {name: experiments.system(name) for name in experiments.SYSTEMS}
    single = experiments.beam_curve().marks
    return {
        "bar_lengths": {name: [float(m.bar_length.min()), float(m.bar_length.max())] for name, m in models.items()},
        "moved": {name: float(np.linalg.norm(m.nodes - m.nominal, axis=1).max()) for name, m in models.items()},
        "f_max": [e.f_max for e in beams],
        "f_min": [e.f_min for e in beams],
        "figure_3": {name: list(mark) for name, mark in single.items()},
        "marks": {name: list(mark) for name, mark in curve.marks.items()},
        "after_last_snap": after_last_snap(honeycomb),
    }


def after_last_snap(honeycomb) -> float:
    """m: elongation at which the force is that of the last snap again."""
    ends = nsh.breakpoints(honeycomb)
    last = max(nsh.beam_extrema(*beam).f_max for beam in zip(honeycomb.Q, honeycomb.zeta, honeycomb.h))
    return float(max(x for x in ends if abs(nsh.force(honeycomb, x, 0.0) - last) < 1e-9 * last))


MEASURES = {"I": measure_1, "II": measure_2, "III": measure_3, "IV": measure_4}


def measure() -> dict:
    """Everything: 'statics', 'rise' and 'snaps' of the base model, and per experiment variant -> numbers, or what went wrong;
    'sweep': damping -> numbers of II."""
    found: dict = {"statics": measure_statics(), "rise": rise()}
    found["snaps"] = {name: located_snaps(f"{name}_nsh") for name in experiments.SYSTEMS}
    for experiment, variants in VARIANTS.items():
        found[experiment] = {}
        for variant in variants:
            print(f"{experiment}: {variant.about}", file=sys.stderr)
            try:
                found[experiment][variant.key] = MEASURES[experiment](variant)
            except TensegrityError as failure:
                found[experiment][variant.key] = {"failure": str(failure)}
    found["sweep"] = {d: {kind: wave(BASE, kind, d) for kind in (PLAIN, NSH)} for d in SWEEP}
    return found
