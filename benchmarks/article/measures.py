"""What docs/claims.md judges the article's claims by: numbers of experiments I to IV under a variant (variants.py).

`measure_...` turns one variant into plain numbers; `measure` does so for all of them.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
from scipy.signal import find_peaks

from tensegrity_core import kernel, laws
from tensegrity_core.article import experiments
from tensegrity_core.errors import TensegrityError
from tensegrity_core.laws.beam import beam_extrema
from tensegrity_core.model import Model, Result

from .variants import BASE, VARIANTS, Variant

PLAIN, NSH = "plain", "nsh"
SUFFIX = {PLAIN: "", NSH: "_nsh"}
#: II is run for longer than it is drawn, so that its last two periods can stand for the steady response.
WAVE_SECONDS, DRAWN_SECONDS = 10.0, experiments.WAVE_DURATION
#: II is run for so long to see after how many periods of the wave the motion comes back, of up to so many.
REPEATED_SECONDS, MOST_REPEATS = 60.0, 6
#: Snap loads are bisected to this width, N.
SNAP_WIDTH = 0.01
#: Dampings at which II is swept, N s/m.
SWEEP = (50, 100, 200, 300, 500, 700, 1000, 1500, 2000, 3000, 5000, 7000, 10000)
#: A turn of a series counts from this share of its swing on.
PROMINENCE = 0.01

# --- I -----------------------------------------------------------------------------------------------------------


def measure_1(variant: Variant) -> dict:
    """Scene -> heights and snaps under the article's lifts."""
    names = [name + suffix for name in experiments.SYSTEMS for suffix in SUFFIX.values()]
    return {name: heights(variant.model(name)) for name in names}


def heights(model: Model) -> dict:
    """One system's; m, N, m/s.  bend: largest distance from the straight line through (lift, z), over the range of z."""
    run = lifted(model, experiments.LIFTS)
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
        "least_snapped": run.snapped[[0, -1]].min(axis=1, initial=4 if honeycombs(model) else 0).tolist(),
        "snaps": [snaps_of(run, column) for column in kinds(model)],
        "apart": int(np.ptp(run.snapped, axis=1).max()) if honeycombs(model) else 0,
    }


def lifted(model: Model, forces) -> experiments.SteadyHeights:
    """The steady heights, with the snapped beams of every honeycomb."""
    run = experiments.steady_heights(model, forces)
    return replace(run, snapped=snapped(model, run.snapped, run.string_length))


def honeycombs(model: Model) -> list[int]:
    """Strings with an NSH, also those that are an element of beams and a spring."""
    return sorted({*model.nsh_strings, *model.elements} - {i for i in model.memories if model.nsh[i] is None})


def snapped(model: Model, counted: np.ndarray, string_length: np.ndarray) -> np.ndarray:
    """(K, number of honeycombs): beams past their force maximum; of strings with an NSH those that the kernel counts (K, H), of
    elements without memory by the strings' lengths (K, S), m."""
    found = dict(zip(model.nsh_strings, counted.T))
    for i in set(honeycombs(model)) - {*model.nsh_strings}:
        law = laws.string_law(model, i)
        found[i] = [law.snapped_on_piece(law.piece_of(x)) for x in string_length[:, i] - model.rest_length[i]]
    return np.array([found[i] for i in sorted(found)], dtype=int).reshape(len(found), len(string_length)).T


def kinds(model: Model) -> list[list[int]]:
    """NSH strings that are each other's images, as columns of `snapped`: the six-bar system has two kinds of them."""
    count = len(honeycombs(model))
    return [list(range(i, i + 3)) for i in (0, 3)] if count == 6 else [list(range(count))] if count else []


def snaps_of(run: experiments.SteadyHeights, columns: list[int]) -> list[list[float]]:
    """[last lift before, first lift after, beams] of each increase in the string of the kind where most beams have snapped."""
    most = run.snapped[:, columns].max(axis=1)
    increases = np.flatnonzero(np.diff(most) > 0)
    return [[float(run.force[i]), float(run.force[i + 1]), int(most[i + 1] - most[i])] for i in increases]


def located_snaps(model: Model) -> list[dict]:
    """A model's snaps, per kind of NSH string and beam; lifts from 0 N on, so that those below 10 N are found, too.

    lift: N, the least at which the beam is found past its maximum, by bisection; tension: N, the largest in the kind's strings
    just below it; gap_lift: N, where the height jumps most near it; gap: m, that jump between lifts SNAP_WIDTH apart.
    """
    forces = np.arange(0.0, experiments.LIFTS[-1] + 1.0, 2.0)
    run = lifted(model, forces)
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
        run = lifted(model, [middle])
        low, high = (low, middle) if run.snapped[0, columns].max() >= beams else (middle, high)
    below = experiments.steady_heights(model, [low])
    return {"lift": high, "tension": float(below.elastic_force[0, [honeycombs(model)[i] for i in columns]].max())}


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
    """Of n5: way: m, its largest distance from its start in the time drawn; swing: m, by axis, over the last two periods, and
    its norm; away: by period, its path's largest distance from that of the last period, over the norm of the swing.

    In the time drawn: force_peak, force_mean: N, elastic, between n1 and n4; bar_mean: N, of all bars' forces; snaps: of beams
    of s1.  dissipated: J, in the whole run.
    """
    model = experiments.system("three_bar" + SUFFIX[kind])
    model = variant.change(experiments.damped(model, variant.damping * damping))
    inputs = experiments.wave_inputs(model, duration=WAVE_SECONDS, phase=variant.phase)
    result = kernel.simulate(model, inputs)
    moved = experiments.displacement(result, model.node_names.index("n5"))
    drawn = result.times <= DRAWN_SECONDS + 1e-9
    last = 2.0 * experiments.PERIOD
    peaks = experiments.wave_peaks(model, inputs, "n5", joining(model, "n1", "n4"), DRAWN_SECONDS, last)
    swing = float(np.linalg.norm(peaks.swing))
    force = between(model, result, "n1", "n4")[drawn]
    beams = snapped(model, result.snapped, result.string_length)[drawn, 0] if kind == NSH else np.zeros(1, dtype=int)
    return {
        "way": peaks.way,
        "swing": [*peaks.swing.tolist(), swing],
        "away": away(moved, swing),
        "force_peak": peaks.force,
        "force_mean": float(force.mean()),
        "bar_mean": float(np.abs(result.bar_force[drawn]).mean()),
        "snaps": int(np.maximum(np.diff(beams), 0).sum()),
        "dissipated": float(result.dissipated[-1]),
    }


def between(model: Model, result: Result, first: str, second: str) -> np.ndarray:
    """(K+1,) N: elastic force of all strings between two nodes."""
    joined = [model.string_names.index(name) for name in joining(model, first, second)]
    return result.elastic_force[:, joined].sum(axis=1)


def joining(model: Model, first: str, second: str) -> list[str]:
    """Names of the strings between two nodes."""
    ends = sorted(model.node_names.index(name) for name in (first, second))
    return [name for name, pair in zip(model.string_names, model.strings.tolist()) if sorted(pair) == ends]


def repeats(dampings=experiments.DAMPINGS) -> dict:
    """'plain/500' and so on, of the base model: after how many periods of the wave the motion of n5 comes back, to within 1 %
    of its swing, once REPEATED_SECONDS have passed, and how far it is off after 1, 2 ... MOST_REPEATS periods, of the swing."""
    found = {}
    for damping in dampings:
        for kind in (PLAIN, NSH):
            model = experiments.damped(experiments.system("three_bar" + SUFFIX[kind]), damping)
            result = experiments.square_wave(model, duration=REPEATED_SECONDS)
            moved = experiments.displacement(result, model.node_names.index("n5"))
            rows = MOST_REPEATS * round(experiments.PERIOD / experiments.STEP)
            off = away(moved, float(np.linalg.norm(np.ptp(moved[-rows:], axis=0))))[: -MOST_REPEATS - 1 : -1]
            periods = next((i for i, x in enumerate(off, 1) if x <= 0.01), None)
            found[f"{kind}/{damping:g}"] = {"periods": periods, "off": off}
    return found


def away(moved: np.ndarray, swing: float) -> list[float]:
    """Per period but the last: the path's largest distance from that of the last one, over the swing."""
    rows = round(experiments.PERIOD / experiments.STEP)
    periods = moved[: len(moved) // rows * rows].reshape(-1, rows, 3)
    return (np.linalg.norm(periods[:-1] - periods[-1], axis=2).max(axis=1) / swing).tolist()


# --- III ---------------------------------------------------------------------------------------------------------


def measure_3(variant: Variant) -> dict:
    """Scene -> numbers of the last node's motion; apart: m, the largest distance of the paths with and without NSH."""
    found, paths = {}, {}
    for system in experiments.SYSTEMS:
        for suffix in SUFFIX.values():
            name = system + suffix
            model = variant.model(name)
            data = experiments.Actuation({name: (model, experiments.actuated(model))}, {})
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
    """'plain' and 'nsh' -> absorbed: J, in the whole run, and periods: in each of its periods; power: W, the largest; x: m, the
    largest; end: m, where the mass stands at the end, and stored: J, what it and its spring hold there."""
    data = experiments.experiment_4(**variant.oscillator)
    return {
        name: {
            "absorbed": float(run.absorbed[-1]),
            "periods": data.per_period(name),
            "power": run.largest_power,
            "x": run.largest_position,
            "end": float(run.position[-1]),
            "stored": data.stored(name),
        }
        for name, run in data.runs.items()
    }


def measure_statics() -> dict:
    """Bars, coordinates and the honeycomb."""
    honeycomb = experiments.article_nsh()
    curve = experiments.honeycomb_curve()
    beams = [beam_extrema(*beam) for beam in zip(honeycomb.Q, honeycomb.zeta, honeycomb.h)]
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
    made = laws.law(honeycomb.element)
    last = max(beam_extrema(*beam).f_max for beam in zip(honeycomb.Q, honeycomb.zeta, honeycomb.h))
    return float(max(x for x in made.breakpoints if abs(made.force(x) - last) < 1e-9 * last))


MEASURES = {"I": measure_1, "II": measure_2, "III": measure_3, "IV": measure_4}


def measure() -> dict:
    """Everything: 'statics', 'rise' and 'snaps' of the base model, and per experiment variant -> numbers, or what went wrong;
    'sweep': damping -> numbers of II."""
    found: dict = {"statics": measure_statics(), "rise": rise(), "repeats": repeats()}
    found["snaps"] = {name: located_snaps(BASE.model(f"{name}_nsh")) for name in experiments.SYSTEMS}
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
