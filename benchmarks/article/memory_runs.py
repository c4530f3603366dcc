"""Structures with memory for docs/memory.md: where the energy goes, the article's experiments I and II, and its claims."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss

from tensegrity_core import laws
from tensegrity_core.article import experiments
from tensegrity_core.kernel import simulate
from tensegrity_core.laws.curves import HeldCurve
from tensegrity_core.model import Inputs, Model, Result, held

from . import measures
from .claims import NUMBERED
from .variants import BASE, HYSTERETIC, SINGLE_VALUED

#: Slow ramp of experiment I: largest lift and steps, N; how long each step is held, s.
RAMP_TOP, RAMP_STEP, RAMP_HOLD = 72.0, 0.5, 4.0
#: Lift (N) and duration (s) of the runs whose energy is accounted for, beside the waves.
LEDGER_LIFT, LEDGER_DURATION = 60.0, 5.0
#: Gauss points on a panel; shortest and longest panel, s.
POINTS, SHORTEST, LONGEST = 12, 1e-6, 5e-3
#: Heights under the two laws that are farther apart count as different, m.
APART = 1e-5
#: The laws that are compared, the string's own stiffness being in series in both.
LAWS = {"series": SINGLE_VALUED, "memory": HYSTERETIC}


# --- energy ------------------------------------------------------------------------------------------------------


def panels(cuts: np.ndarray) -> np.ndarray:
    """Times (s) that cut every interval between two cuts into panels, short near the cuts, where a fast motion dies away."""
    count = 16 + int(0.5 * np.diff(cuts).max() / LONGEST)
    away, ends = np.cumsum(np.minimum(SHORTEST * 2.0 ** np.minimum(np.arange(count), 40), LONGEST)), [cuts[:1]]
    for a, b in pairwise(cuts):
        inside = away[away < 0.5 * (b - a)]
        ends.append(np.concatenate((a + inside, (b - inside)[::-1], [b])))
    return np.concatenate(ends)


def account(model: Model, force, switches: np.ndarray) -> dict:
    """Energy of a run under forces (t -> (N, 3) N) that jump at `switches` only, from the first of them to the last, s.

    dampers: J, the integral of the dampers' power over Gauss points between transitions; snaps: J, what the recorded ones lose;
    gap: |dissipated - dampers - snaps| over the throughput; closure: of the ledger, likewise.
    """
    first = simulate(model, held(model, switches, force=force))
    cuts = np.unique(np.concatenate((switches, [t.time for t in first.transitions])))
    cuts = cuts[np.concatenate(([True], np.diff(cuts) > 1e-12))]
    ends = panels(cuts)
    s, w = leggauss(POINTS)
    half = 0.5 * np.diff(ends)
    nodes = (ends[:-1, None] + half[:, None] * (1.0 + s)).ravel()
    weights = (half[:, None] * w).ravel()
    times = np.union1d(nodes, switches)
    run = simulate(model, held(model, times, force=force))
    power = np.interp(nodes, run.times, damper_power(model, run))
    found = [t for t in run.transitions if t.loss > 0.0]
    numbers = {"dissipated": float(run.dissipated[-1]), "dampers": float(weights @ power), "snaps": sum(t.loss for t in found)}
    left = abs(numbers["dissipated"] - numbers["dampers"] - numbers["snaps"])
    return numbers | {
        "count": len(found),
        "throughput": float(run.throughput[-1]),
        "gap": left / float(run.throughput[-1]),
        "closure": run.ledger_error(),
    }


def damper_power(model: Model, run: Result) -> np.ndarray:
    """(K+1,) W, of all strings."""
    first, second = model.strings.T
    along = run.position[:, second] - run.position[:, first]
    rate = np.einsum("tsi,tsi->ts", along, run.velocity[:, second] - run.velocity[:, first])
    return np.sum((run.string_force - run.elastic_force) * rate / run.string_length, axis=1)


def ledger() -> dict:
    """Case -> its account: sudden lifts of the three systems, and the square wave, under the law with memory."""
    found = {}
    for name in experiments.SYSTEMS:
        model = HYSTERETIC.model(f"{name}_nsh")
        push = experiments.upward(model, experiments.top_nodes(model), LEDGER_LIFT)
        found[f"{name}/lift"] = account(model, lambda t, push=push: push, np.array([0.0, LEDGER_DURATION]))
    for d in sorted(experiments.DAMPINGS):
        model = experiments.damped(HYSTERETIC.model("three_bar_nsh"), d)
        switches = np.arange(0.0, LEDGER_DURATION + 0.1, 0.5 * experiments.PERIOD)
        found[f"three_bar/{d:g}"] = account(model, experiments.wave_force(model), switches)
    return found


# --- experiments I and II ----------------------------------------------------------------------------------------


def ramp_inputs(model: Model, top: float, step: float, hold: float) -> tuple[np.ndarray, Inputs]:
    """Lift of each step (N), up to `top` and back to 0 in steps (N) that are held (s), and the inputs."""
    count = round(top / step)
    lift = step * np.concatenate((np.arange(count + 1), np.arange(count - 1, -1, -1)))
    times = hold * np.arange(len(lift) + 1)
    push = experiments.upward(model, experiments.top_nodes(model))
    return lift, held(model, times, force=lambda t: lift[min(int(t / hold), len(lift) - 1)] * push)


def ramp(model: Model, top: float = RAMP_TOP, step: float = RAMP_STEP, hold: float = RAMP_HOLD) -> tuple[dict, dict]:
    """A slow lift of the top nodes up and back: numbers, and series by name.

    passed: lifts, N, at which a beam passes its force maximum on the way up, and at which it returns below it on the way back;
    apart: m, largest distance of the heights up and back under one lift; snaps, dampers: J lost on the whole way; count: snaps.
    """
    lift, inputs = ramp_inputs(model, top, step, hold)
    run = simulate(model, inputs)
    z = run.position[1:, experiments.top_nodes(model), 2].mean(axis=1)
    beams_passed = measures.snapped(model, run.snapped, run.string_length)[1:].max(axis=1)
    half = len(lift) // 2
    found = [t for t in run.transitions if t.loss > 0.0]
    loss = sum(t.loss for t in found)
    numbers = {
        "up": changes(lift[: half + 1], beams_passed[: half + 1]),
        "back": changes(lift[half:], beams_passed[half:]),
        "apart": float(np.abs(z[: half + 1] - z[half:][::-1]).max()),
        "apart_lift": float(lift[np.abs(z[: half + 1] - z[half:][::-1]).argmax()]),
        "top": float(z[half]),
        "snaps": loss,
        "count": len(found),
        "dampers": float(run.dissipated[-1]) - loss,
    }
    return numbers, {"lift": lift, "z": z, "snapped": beams_passed}


def changes(lift: np.ndarray, count: np.ndarray) -> list[float]:
    """N: the lift after each change of the largest number of passed beams, once per beam."""
    return [float(lift[i + 1]) for i, n in enumerate(np.diff(count)) for _ in range(abs(int(n)))]


def first_experiment(systems: Sequence[str] = experiments.SYSTEMS, **slow) -> tuple[dict, dict, dict]:
    """Numbers by system and law; series of the sudden lifts and of the slow ones, by name.  slow: arguments of `ramp`.

    By system also: apart: m, largest distance of the heights under the two laws; differ: places of the lifts where they are
    farther apart than APART; midway: see there, under the single-valued law.
    """
    numbers, sudden, slowly = {}, {"lift": np.array(experiments.LIFTS, dtype=float)}, {}
    for name in systems:
        numbers[name] = {}
        for law, variant in LAWS.items():
            model = variant.model(f"{name}_nsh")
            run = measures.lifted(model, experiments.LIFTS)
            z = run.height.mean(axis=1)
            if law == "series":
                numbers[name]["midway"] = midway(model, run.string_length)
            found, series = ramp(model, **slow)
            numbers[name][law] = {"ramp": found, "snaps": run.snaps(), "range": float(np.ptp(z))}
            sudden[f"{name}.{law}.z"], sudden[f"{name}.{law}.snapped"] = z, run.snapped.max(axis=1)
            slowly |= {"lift": series["lift"]} | {f"{name}.{law}.{key}": series[key] for key in ("z", "snapped")}
        apart = np.abs(np.subtract(*(sudden[f"{name}.{law}.z"] for law in LAWS)))
        numbers[name] |= {"apart": float(apart.max()), "differ": np.flatnonzero(apart > APART).tolist()}
    return numbers, sudden, slowly


def midway(model: Model, string_length: np.ndarray) -> list[int]:
    """Places of the rows of lengths (K, S), m, where a string without memory stands on the curve of a beam that snaps, the
    others held: it does not bear f_max again."""
    found = set()
    for i in sorted(set(model.elements) - {*model.nsh_strings, *model.memories}):
        made = laws.string_law(model, i)
        pieces = [made.piece_of(float(x)) for x in string_length[:, i] - model.rest_length[i]]
        held_on = {n for n, piece in enumerate(made.pieces, 1) if isinstance(piece.curve, HeldCurve)}
        found |= {k for k, n in enumerate(pieces) if n in held_on}
    return sorted(found)


def second_experiment(duration: float = experiments.WAVE_DURATION) -> tuple[dict, dict]:
    """The three-bar system under the square wave; numbers by law and damping, and series by name.

    per_second: J in snaps and J in dampers in each second; apart: m, largest distance of n5's paths under the two laws.
    """
    numbers, series = {law: {} for law in LAWS}, {}
    for d in experiments.DAMPINGS:
        paths = []
        for law, variant in LAWS.items():
            model = experiments.damped(variant.model("three_bar_nsh"), d)
            inputs = experiments.wave_inputs(model, duration=duration)
            run = simulate(model, inputs)
            peaks = experiments.wave_peaks(model, inputs, "n5", measures.joining(model, "n1", "n4"))
            moved = experiments.displacement(run, model.node_names.index("n5"))
            force = measures.between(model, run, "n1", "n4")
            prefix, seconds = f"{law}.d{d:g}", np.arange(round(duration) + 1)
            series |= {"time": run.times} | {f"{prefix}.n5.d{axis}": moved[:, i] for i, axis in enumerate("xyz")}
            series[f"{prefix}.s1.elastic_force"] = force
            lost = [sum(t.loss for t in run.transitions if a <= t.time < a + 1) for a in seconds[:-1]]
            all_lost = np.diff(np.interp(seconds, run.times, run.dissipated))
            numbers[law][f"{d:g}"] = {
                "way": peaks.way,
                "force_peak": peaks.force,
                "force_mean": float(force.mean()),
                "snaps": sum(t.loss > 0.0 for t in run.transitions),
                "in_snaps": lost,
                "in_dampers": (all_lost - lost).tolist(),
                "dissipated": float(run.dissipated[-1]),
            }
            paths.append(moved)
        numbers["memory"][f"{d:g}"]["apart"] = float(np.linalg.norm(paths[1] - paths[0], axis=1).max())
    return numbers, series


# --- the article's claims ----------------------------------------------------------------------------------------


def judged() -> dict:
    """Number of a claim on experiments I to III -> law ('base', 'series', 'memory') -> verdict and what is found."""
    chosen = {"base": BASE, **LAWS}
    data = {e: {key: measures.MEASURES[e](v) for key, v in chosen.items()} for e in ("I", "II", "III")}
    data["statics"] = measures.measure_statics()
    located = {
        key: {name: measures.located_snaps(v.model(f"{name}_nsh")) for name in experiments.SYSTEMS} for key, v in chosen.items()
    }
    found: dict = {}
    for number, claim in NUMBERED.items():
        if claim.experiment in data and claim.experiment != "statics":
            found[number] = {}
            for key in chosen:
                seen = data | {"snaps": located[key]}
                found[number][key] = {"verdict": claim.verdict(seen, key), "found": claim.found(claim.numbers(seen, key))}
    return found
