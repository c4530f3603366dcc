"""An octahedron of six bars, dropped and rolled: ``python -m benchmarks.ground.run`` writes docs/ground.json,
docs/ground.md and its figures, in about a minute.

Dropped: from 1 m onto a face, cables plain and with honeycombs of rising force.  Rolled: from face to face by rest lengths:
one cable of the present face after the other is tried, shortened and let go again, and that which brings it farthest along x
is kept.  Steps: see steps.py.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
from matplotlib.figure import Figure

from benchmarks.harness import machine
from benchmarks.harness.page import COLOURS, MARKS, Page, new_figure, numbers, plain, processor_seconds, rendered, thinned
from fmu_src.validation.sensitivity import match
from tensegrity_core import api, reference
from tensegrity_core.laws.beam import beam_extrema
from tensegrity_core.model import Model, grid, held
from tensegrity_core.scene import parse_scene
from tensegrity_core.statics import build_model

from . import steps
from .octahedron import BARS, CABLES, table

#: What both have in common: a bar's mass, kg.
MASS = 1.0

DROP, FALL = 1.0, 1.5  # m; s simulated
DROPPED = {"stiffness": 5000.0, "damping": 50.0, "mass": MASS}
LANDING = {"stiffness": 1e5, "damping": 0.2, "friction": 0.5}
#: Two beams in each cable: zeta, their height, m, and the force scales to try, N; 0: no honeycomb.
ZETA, HEIGHT, SCALES = 5.0, 0.02, (0.0, 1.0, 2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 60.0, 80.0, 120.0, 160.0)
#: Prestress of a cable, N: plain, and as part of the force at which its honeycomb begins to give.
TENSION, PART = 60.0, 0.5
SAMPLE, TOLERANCE, TIGHTER = 1e-4, 1e-8, 1e-10  # s
SHOWN = (0.0, 20.0)  # N, of the figure's motions

ROLLED = {"stiffness": 2000.0, "damping": 20.0, "mass": MASS, "tension": 40.0}
FLOOR = {"stiffness": 2e4, "damping": 0.2, "friction": 0.8}
#: Rolling: faces to leave; s to settle, to shorten, to hold, and to let go; what is left of the rest length.
TURNS, SETTLE, SHORTEN, HOLD, SHORT = 5, 1.0, 1.0, 0.5, 0.3
PERIOD, ROW = SETTLE + 2.0 * SHORTEN + HOLD, 0.02  # s


# --- dropped -----------------------------------------------------------------------------------------------------


def dropped(scale: float) -> Model:
    """scale: Q of each beam, N; 0: plain cables."""
    honeycomb = {"Q": (scale, scale), "zeta": (ZETA, ZETA), "h": (HEIGHT, HEIGHT)} if scale else None
    return build_model(parse_scene(table(DROP, LANDING, tension=tension_of(scale), honeycomb=honeycomb, **DROPPED)))


def threshold(scale: float) -> float:
    """N: the tension at which a honeycomb begins to give."""
    return float(beam_extrema(scale, ZETA, HEIGHT)[1])


def tension_of(scale: float) -> float:
    return min(TENSION, PART * threshold(scale)) if scale else TENSION


def landing(scale: float) -> dict:
    """What a landing does at most."""
    run, finer = (api.simulate(dropped(scale), duration=FALL, step=SAMPLE, tolerance=t) for t in (TOLERANCE, TIGHTER))
    acceleration = accelerations(run.result.velocity)
    touched = run.result.contact_normal.max(axis=0) > 0.0
    centre = run.result.position[:, :, 2].mean(axis=1)
    lowest = int(np.argmin(centre))
    return {
        "scale": scale,
        "threshold": threshold(scale) if scale else None,
        "prestress": tension_of(scale),
        "tension": run.result.string_force.max(),
        "touching": acceleration[:, touched].max(),
        "others": acceleration[:, ~touched].max() if not touched.all() else None,
        "touched": int(touched.sum()),
        "ground": run.result.contact_normal.sum(axis=1).max(),
        "lowest": centre[lowest],
        "rebound": centre[lowest:].max(),
        "transitions": len(run.result.transitions),
        "ledger": run.result.ledger_error(),
        "difference": np.abs(run.result.position - finer.result.position).max(),
        "motion": motion(run) if scale in SHOWN else None,
    }


def accelerations(velocity: np.ndarray) -> np.ndarray:
    """(rows - 1, nodes) m/s2: sizes of the means over a sample."""
    return np.linalg.norm(np.diff(velocity, axis=0), axis=2) / SAMPLE


def motion(run) -> dict:
    result = run.result
    rows = np.column_stack((result.position[:, :, 2].mean(axis=1), result.string_force.max(axis=1)))
    times, rows = thinned(result.times, rows, 400)
    return {"time": times, "height": rows[:, 0], "tension": rows[:, 1]}


def agreement(scale: float, duration: float) -> dict:
    """Kernel and reference over the beginning of a landing: the largest differences of a node, m, and of a transition, s."""
    model = dropped(scale)
    inputs = held(model, grid(duration, 0.01))
    ours, theirs = api.simulate(model, duration=duration, step=0.01).result, reference.simulate(model, inputs)
    found = match(ours.transitions, theirs.transitions)
    return {
        "duration": duration,
        "difference": np.abs(ours.position - theirs.position).max(),
        "transitions": len(found.pairs),
        "alone": len(found.ours) + len(found.theirs),
        "moments": max(abs(a.time - b.time) for a, b in found.pairs),
    }


# --- rolled ------------------------------------------------------------------------------------------------------


def shortened(length: float, turns: list[int]):
    """Rest length over time of a cable that is shortened in these turns."""
    moments, values = [0.0], [length]
    for turn in turns:
        start = turn * PERIOD + SETTLE
        moments += [start, start + SHORTEN, start + SHORTEN + HOLD, start + 2.0 * SHORTEN + HOLD]
        values += [length, SHORT * length, SHORT * length, length]
    return np.array([*moments, TURNS * PERIOD + SETTLE]), np.array([*values, length])


def rolled(model: Model, chosen: list[int], turns: int):
    """A run over so many turns; chosen: the cable that is shortened in each."""
    signals = {
        f"s{i + 1}.rest_length": shortened(float(model.rest_length[i]), [k for k, j in enumerate(chosen) if j == i])
        for i in set(chosen)
    }
    return api.simulate(model, signals, duration=turns * PERIOD + SETTLE, step=ROW, tolerance=TOLERANCE)


def rolling(model: Model) -> dict:
    """The run, found turn by turn: of the cables between nodes on the ground that which brings it farthest along x."""
    chosen: list[int] = []
    for turn in range(TURNS):
        down = np.flatnonzero(rolled(model, chosen, turn).result.contact_normal[-1] > 0.0).tolist()
        tries = [[*chosen, CABLES.index(pair)] for pair in combinations(down, 2) if pair in CABLES]
        chosen = max(tries, key=lambda cables: rolled(model, cables, turn + 1).result.position[-1, :, 0].mean())
    result = rolled(model, chosen, TURNS).result
    times, rows = thinned(result.times, np.column_stack((result.position.mean(axis=1), result.contact_normal > 0.0)), 300)
    at = [round((turn * PERIOD + SETTLE) / ROW) for turn in range(TURNS + 1)]
    return {
        "cables": [f"s{i + 1}" for i in chosen],
        "faces": [[f"n{k + 1}" for k in np.flatnonzero(result.contact_normal[row] > 0.0)] for row in at],
        "places": result.position[at],
        "time": times,
        "centre": rows[:, :3],
        "touching": rows[:, 3:].astype(int),
        "tension": result.string_force.max(),
        "slip": sum(one.kind == "slip" for one in result.transitions),
        "transitions": len(result.transitions),
        "ledger": result.ledger_error(),
    }


# --- all of it ---------------------------------------------------------------------------------------------------


def collect() -> dict:
    begun, where = processor_seconds(), machine.describe()
    found = {
        "drops": [landing(scale) for scale in SCALES],
        "agreement": agreement(SHOWN[1], 0.6),
        "steps": steps.measure(),
        "rolling": rolling(build_model(parse_scene(table(0.0, FLOOR, **ROLLED)))),
    }
    return plain({"machine": where, "seconds": processor_seconds() - begun, **found})


def draw_drop(data: dict) -> Figure:
    figure = new_figure(7.4, 5.4)
    above, below = figure.subplots(2, 2)
    with_nsh = data["drops"][1:]
    scale, without = numbers([row["threshold"] for row in with_nsh]), data["drops"][0]
    for ax, parts, label in (
        (above[0], (("tension", "largest tension of a cable"),), "N"),
        (above[1], (("touching", "nodes that touch the ground"), ("others", "other nodes")), "m/s²"),
    ):
        for (key, text), colour, mark in zip(parts, COLOURS[1:], MARKS):
            ax.plot(scale, numbers([row[key] for row in with_nsh]), color=colour, marker=mark, label=f"{text}, with NSH")
            ax.axhline(without[key], color=colour, linestyle="--", label=f"{text}, plain")
        ax.set(xlabel="tension at which the honeycombs give, N", ylabel=label, ylim=(0.0, None))
        ax.legend()
    above[0].set_title("a  cables")
    above[1].set_title("b  nodes' acceleration")
    for row, colour, style in zip((row for row in data["drops"] if row["motion"]), COLOURS[1:], ("--", "-")):
        name = f"NSH, Q = {row['scale']:g} N" if row["scale"] else "plain"
        for ax, key, label in zip(below, ("height", "tension"), ("m", "N")):
            ax.plot(row["motion"]["time"], row["motion"][key], color=colour, linestyle=style, label=name)
            ax.set(xlabel="time, s", ylabel=label)
            ax.legend()
    below[0].set_title("c  height of the nodes' mean")
    below[1].set_title("d  largest tension")
    return figure


def draw_roll(data: dict) -> Figure:
    run = data["rolling"]
    figure = new_figure(7.4, 4.6)
    side, centre = figure.subplots(2, 1, height_ratios=(3, 2))
    for turn, nodes in enumerate(numbers(run["places"])):
        colour = COLOURS[turn % len(COLOURS)]
        for a, b in CABLES:
            side.plot(nodes[[a, b], 0], nodes[[a, b], 2], color=colour, linewidth=0.4)
        for a, b in BARS:
            side.plot(nodes[[a, b], 0], nodes[[a, b], 2], color=colour, linewidth=1.6)
    side.axhline(0.0, color=COLOURS[4], linewidth=1.0)
    side.set(xlabel="x, m", ylabel="z, m", aspect="equal")
    side.set_title("a  from the side, at rest on each face")
    for axis, colour, name in zip(range(3), COLOURS[1:], "xyz"):
        centre.plot(run["time"], numbers(run["centre"])[:, axis], color=colour, label=name)
    centre.set(xlabel="time, s", ylabel="m")
    centre.set_title("b  the nodes' mean")
    centre.legend()
    return figure


def report(data: dict) -> str:
    plain_cables, *with_nsh = data["drops"]
    best = min((row for row in with_nsh if row["others"]), key=lambda row: row["tension"])
    constants = {"drop": DROP, "mass": MASS, "dropped": DROPPED, "landing": LANDING, "zeta": ZETA, "height": HEIGHT}
    constants |= {"sample": SAMPLE, "fall": FALL, "rolled": ROLLED, "floor": FLOOR, "short": SHORT, "turns": TURNS}
    struck = max(abs(row["touching"] / plain_cables["touching"] - 1.0) for row in with_nsh)
    constants |= {"struck": struck, "compared": SHOWN[1], "flat": [row["scale"] for row in with_nsh if not row["others"]]}
    constants |= {"shorten": SHORTEN, "part": PART, "tighter": TIGHTER, "tolerance": TOLERANCE}
    constants |= {"halved": steps.HALVED, "ordered": steps.ORDERED, "exact": steps.EXACT, "over": steps.HEIGHT}
    return rendered("ground/page", **data, plain=plain_cables, best=best, **constants)


FIGURES = {"ground_drop": draw_drop, "ground_roll": draw_roll, "ground_steps": steps.draw}
PAGE = Page(__doc__, "ground", collect, report, figures=FIGURES)

if __name__ == "__main__":
    PAGE.main()
