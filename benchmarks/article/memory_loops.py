"""Single strings with memory for docs/memory.md: loops of force over elongation, by the exact law and by the kernel.

The kernel pulls a string in a testing machine: between a wall and a node that is moved at a constant speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.optimize import minimize_scalar

from tensegrity_core import laws
from tensegrity_core.article import experiments
from tensegrity_core.errors import TensegrityError
from tensegrity_core.kernel import Kernel, simulate
from tensegrity_core.laws import hysteresis
from tensegrity_core.laws.beam import beam_displacement, beam_extrema, beam_force, beam_stiffness
from tensegrity_core.model import Model, Result, held
from tensegrity_core.model.elements import Beam, Series, Spring, Table

#: Test 1: a cell of 100 N/m up to 1 N at .01 m, down to .4 N at .02 m, then 100 N/m again; three of them, k_s in N/m.
CELL, CELL_STIFFNESS, CELL_REACH = Table((0.0, 0.01, 0.02, 0.03), (0.0, 1.0, 0.4, 1.4)), 200.0, 0.08
#: Its closed form: elongations of the snaps there and back (m), forces before and after one (N), J per snap and per cycle.
CLOSED = {
    "there": (0.035, 0.051, 0.067),
    "back": (0.062, 0.046, 0.030),
    "force": (1.0, 0.4 + 1.0 / 7.0),
    "loss": 8e-3 / 7.0,
    "cycle": 48e-3 / 7.0,
}
#: Test 2: the string's own stiffness, N/m; how far it is pulled, m; steps of a sweep, m; turning points of partial loops, m.
STIFFNESS, REACH, SWEEP_STEP = 5000.0, 0.10, 25e-6
PARTIAL = ((0.045, 0.0), (0.070, 0.0), (0.100, 0.052, 0.100, 0.0))
#: Own stiffnesses of the scan, N/m, and one that stands for a rigid string.
SCAN, RIGID = tuple(np.logspace(2.0, 6.0, 41).tolist()), 1e9
#: Testing machine: speed in m/s, damping in N s/m, samples of a cycle (a prime number on a leg, so that no sample meets a
#: snap), and which of them are kept.
SPEED, MACHINE_DAMPING, SAMPLES, KEPT = 0.01, 1.0, 2 * 1999, 4


def cells() -> Series:
    return Series((CELL,) * 3, "hysteretic")


def beams() -> tuple[Beam, ...]:
    """The article's."""
    return experiments.article_nsh().element.parts


# --- loops of the exact law --------------------------------------------------------------------------------------


def way(element: Series, k: float, turns: Sequence[float]) -> list[tuple[hysteresis.Branch, float, float, float]]:
    """(branch, from, to, energy lost at its end) of each part of a way from slack through the turning points (m)."""
    branch, x, found = hysteresis.start(element, k), 0.0, []
    for turn in turns:
        after, events = hysteresis.follow(branch, turn)
        for event in events:
            found.append((event.before, x, event.x, event.loss))
            x = event.x
        found.append((after, x, turn, 0.0))
        branch, x = after, turn
    return found


def area(parts) -> float:
    """J: the integral of the force over the elongation.  The substitution takes the square roots at folds away."""
    s, w = leggauss(64)
    s, w = 0.5 * (s + 1.0), 0.5 * w
    place, slope = s * s * (3.0 - 2.0 * s), 6.0 * s * (1.0 - s)
    return sum((b - a) * float(w * slope @ [branch.force(a + (b - a) * p) for p in place]) for branch, a, b, _ in parts)


def snaps(parts) -> list[dict]:
    """x: m; way: 1 there, -1 back; before, after: N; loss: J; snapped: beams, and at: the stretches of all parts, before and
    after; of each snap."""
    found = []
    for (branch, a, b, loss), (following, *_) in pairwise(parts):
        if loss > 0.0:
            forces = {"before": branch.force(b), "after": following.force(b)}
            states = {name: [getattr(one, name) for one in (branch, following)] for name in ("snapped", "at")}
            found.append({"x": b, "way": int(np.sign(b - a)), **forces, "loss": loss, **states})
    return found


def drawn(parts, points: int = 30) -> tuple[np.ndarray, np.ndarray]:
    """Elongations (m) and forces (N) for a line; denser towards the ends, where it may fall steeply."""
    s = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, points)))
    x = [a + (b - a) * s for _, a, b, _ in parts if a != b]
    f = [[branch.force(v) for v in at] for (branch, a, b, _), at in zip([p for p in parts if p[1] != p[2]], x)]
    return np.concatenate(x), np.concatenate(f)


def loop(element: Series, k: float, turns: Sequence[float]) -> dict:
    """A closed way: its snaps, the energy that they lose and the loop's area, J, and a line to draw."""
    parts = way(element, k, turns)
    x, force = drawn(parts)
    return {"snaps": snaps(parts), "loss": sum(p[3] for p in parts), "area": area(parts), "x": x, "force": force}


# --- the kernel: a testing machine -------------------------------------------------------------------------------


def machine(element: Series, k: float, damping: float = MACHINE_DAMPING) -> Model:
    """A string of this element between a wall and a node that is moved, and a pendulum, since a scene needs a bar."""
    nodes = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.5]])
    return Model(
        name="machine",
        description="a string is pulled",
        axes=(0, 2),
        node_names=("wall", "grip", "pivot", "bob"),
        bar_names=("pendulum",),
        string_names=("sample",),
        nodes=nodes,
        fixed=np.array([True, True, True, False]),
        bars=[[2, 3]],
        bar_mass=[1.0],
        strings=[[0, 1]],
        stiffness=[k],
        damping=[damping],
        rest_length=[1.0],
        nsh=(None,),
        element=(element,),
        damping_law="literal",
        gravity=9.81,
        nominal=nodes,
        moving=(1,),
    )


def pulled(model: Model, reach: float, samples: int) -> tuple[np.ndarray, Result]:
    """Elongations (m), and the run there and back at SPEED."""
    x = reach * (1.0 - np.abs(np.linspace(-1.0, 1.0, samples + 1)))
    times = np.linspace(0.0, 2.0 * reach / SPEED, samples + 1)
    inputs = held(model, times)
    position, velocity = np.tile(model.nodes[[1]], (samples, 1, 1)), np.zeros((samples, 1, 3))
    position[:, 0, 0] += x[:-1]
    velocity[:, 0, 0] = np.where(np.arange(samples) < samples // 2, SPEED, -SPEED)
    inputs = replace(inputs, node_position=position, node_velocity=velocity, node_acceleration=np.zeros_like(position))
    return x, simulate(model, inputs)


def exact_forces(element: Series, k: float, x: np.ndarray) -> np.ndarray:
    """N, along a way through these elongations (m)."""
    branch, found = hysteresis.start(element, k), []
    for value in x:
        branch, _ = hysteresis.follow(branch, float(value))
        found.append(branch.force(float(value)))
    return np.array(found)


def tested(element: Series, k: float, reach: float, samples: int = SAMPLES) -> tuple[dict, dict]:
    """The kernel's run beside the exact law: numbers, and series by name.

    snaps: elongation, m, and loss, J; work: J, what the machine put in; off: N, largest distance of the forces; dampers: J.
    """
    model = machine(element, k)
    x, run = pulled(model, reach, samples)
    exact = exact_forces(element, k, x)
    found = [t for t in run.transitions if t.loss > 0.0]
    taut = float((x > 0.0)[1:-1].sum() + 1) / samples
    numbers = {
        "snaps": [{"x": reach - abs(reach - SPEED * t.time), "loss": t.loss} for t in found],
        "loss": sum(t.loss for t in found),
        "dissipated": float(run.dissipated[-1]),
        "dampers": MACHINE_DAMPING * SPEED**2 * float(run.times[-1]) * taut,
        "work": float(run.input_work[-1]),
        "throughput": float(run.throughput[-1]),
        "off": float(np.abs(run.elastic_force[:, 0] - exact).max()),
        "speed": SPEED,
    }
    series = {"time": run.times, "elongation": x, "exact": exact, "kernel": run.elastic_force[:, 0]}
    return numbers, {name: values[::KEPT] for name, values in series.items()}


def walked(model: Model, turns: Sequence[float]) -> list[tuple[float, float]]:
    """(elongation in m, loss in J) of each snap on a way through the kernel's own pieces."""
    pieces, at, found = Kernel(model).pieces(0), 0, []
    for turn in turns:
        while turn > pieces[at].hi or turn < pieces[at].lo:
            piece, up = pieces[at], turn > pieces[at].hi
            end, loss, at = (piece.hi, piece.loss_up, piece.up) if up else (piece.lo, piece.loss_down, piece.down)
            if loss > 0.0:
                found.append((end, loss))
    return found


# --- the string's own stiffness ----------------------------------------------------------------------------------


def smooth_beam(beam: Beam) -> float:
    """N/m: from this own stiffness on a beam alone passes region II without a snap: its steepest fall, at x = h."""
    return beam.Q * (beam.zeta - 2.0) / beam.h


def smooth_first(parts: Sequence[Beam]) -> float:
    """N/m: own stiffness beyond which the first beam to turn passes II smoothly on a first loading; inf where none is.

    While it falls from f_max to f_min along its cubic, the others, still on I, are springs in series: the elongation grows
    throughout if 1/k + sum 1/f'_j < 1/|f'_first|.
    """
    first, *others = sorted(parts, key=lambda b: beam_extrema(*shape(b)).f_max)
    ends = beam_extrema(*shape(first))

    def room(u: float) -> float:
        force, fall = beam_force(*shape(first), u), beam_stiffness(*shape(first), u)
        places = [beam_displacement(*shape(b), force, "I") for b in others]
        return -1.0 / fall - sum(1.0 / beam_stiffness(*shape(b), at) for b, at in zip(others, places))

    inside = 1e-6 * (ends.u_min - ends.u_max)
    bounds = ends.u_max + inside, ends.u_min - inside
    least = minimize_scalar(room, bounds=bounds, method="bounded", options={"xatol": 1e-13}).fun
    return float(1.0 / least) if least > 0.0 else float("inf")


def shape(beam: Beam) -> tuple[float, float, float]:
    """What the functions of `laws.beam` take."""
    return beam.Q, beam.zeta, beam.h


def cycle(parts: Sequence[Beam], k: float) -> list[tuple[int, float]]:
    """(way, loss in J) of each snap on the way from slack past the stops and back."""
    far = 1.1 * sum(2.0 * b.h for b in parts) + 5.0 * max(b.Q for b in parts) / k
    return [(s["way"], s["loss"]) for s in snaps(way(Series(tuple(parts), "hysteretic"), k, (far, -1.0)))]


def scan(stiffnesses: Sequence[float] = SCAN) -> tuple[dict, dict]:
    """Loss per cycle of the article's NSH and of each of its beams against the own stiffness; numbers, and series by name."""
    whole, found = beams(), [cycle(beams(), k) for k in stiffnesses]
    columns = {"stiffness": np.array(stiffnesses), "loss": np.array([sum(loss for _, loss in one) for one in found])}
    for name, sign in (("snaps_there", 1), ("snaps_back", -1)):
        columns[name] = np.array([sum(way == sign for way, _ in one) for one in found])
    for i, beam in enumerate(whole, 1):
        columns[f"beam_{i}.loss"] = np.array([sum(loss for _, loss in cycle((beam,), k)) for k in stiffnesses])
    numbers = {
        "rigid": sum(loss for _, loss in cycle(whole, RIGID)),
        "beams": [smooth_beam(beam) for beam in whole],
        "first": smooth_first(whole),
        "kernel": kernel_scan(stiffnesses, columns["loss"]),
    }
    return numbers, columns


def kernel_scan(stiffnesses: Sequence[float], losses: np.ndarray) -> dict:
    """off: largest relative distance of the kernel's loss per cycle from the exact law's; refused: N/m, where it has none."""
    element, off, refused = Series(beams(), "hysteretic"), [0.0], []
    for k, exact in zip(stiffnesses, losses):
        try:
            steps = walked(machine(element, k), (0.1 + 60.0 / k, -1.0))
            off.append(abs(sum(loss for _, loss in steps) - exact) / exact)
        except TensegrityError:
            refused.append(k)
    return {"off": max(off), "refused": refused}


def swept(element: Series, found: list[dict]) -> list[float]:
    """N: the force at the last of a sweep's steps before each snap of the loading."""
    ends = [s["x"] for s in found if s["way"] > 0]
    branches = [p[0] for p in way(element, STIFFNESS, (REACH,)) if p[3] > 0.0]
    return [branch.force(np.floor(x / SWEEP_STEP) * SWEEP_STEP) for branch, x in zip(branches, ends)]


def single_valued(x: np.ndarray) -> np.ndarray:
    """N: the article's NSH by Algorithm 1 with the string's own stiffness in series, at elongations (m)."""
    made = laws.law(Series((Spring(STIFFNESS), *beams())))
    return np.array([made.force(float(v)) for v in x])
