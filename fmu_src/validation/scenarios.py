"""What an FMU is validated under: held inputs for any scene, at the scene's damping and at weaker and stronger ones.

For the article's scenes these are its experiments: an upward force on each top node (I), the square wave of 400 N on n4
(II), the top strings' rest lengths moving as a sine (III), and an asymmetric push besides; where nodes are moved or actuators
wind strings, they do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tensegrity_core.article.experiments import top_nodes
from tensegrity_core.equilibria.jointed import movable
from tensegrity_core.model import Inputs, Model, grid, held

#: Simulated time and communication step, s.
DURATION, STEP = 5.0, 0.01
#: Dampings as multiples of the scene's, and how they are written: d = 50, 500 and 5000 N s/m in the article's scenes.
DAMPINGS = {0.1: "d/10", 1.0: "d", 10.0: "10 d"}
#: Lift on each top node and half height of the square wave, N.  Every built-in scene bears them, measured: over 5 s a
#: start that is 1e-12 m off stays within 1e-9 m, and no string gets shorter than 6 cm.
LIFT, WAVE = 42.0, 400.0


@dataclass(frozen=True, eq=False)
class Scenario:
    """name: an identifier; title: for humans; model: with the damping of this scenario; inputs: held; short: a title that
    fits into a line of a table; tolerance: of the FMU, None: its own; method: of the reference; host: what an FMI 3.0 host
    makes use of, see outside3.py."""

    name: str
    title: str
    model: Model
    inputs: Inputs
    short: str = ""
    tolerance: float | None = None
    method: str = "auto"
    host: tuple[str, ...] = ()


def scenarios(model: Model, duration: float = DURATION, step: float = STEP, thorough: bool = False) -> list[Scenario]:
    """Every input at the scene's damping, and the square wave (experiment II), the hardest of them, at every damping;
    thorough: every input at every damping.
    """
    times = grid(duration, step)
    found = []
    for name, title, inputs in _inputs(model, times):
        everywhere = np.any(model.damping) and (thorough or name == "square_wave")
        for factor in DAMPINGS if everywhere else (1.0,):
            damped = replace(model, damping=factor * model.damping)
            identifier = f"{name}_{factor:g}d".replace(".", "_")
            short = f"{name.replace('_', ' ')} at {DAMPINGS[factor]}"
            found.append(Scenario(identifier, f"{title}, {shown_damping(damped)}", damped, inputs, short))
    return found


def shown_damping(model: Model) -> str:
    if not len(model.strings):
        return "no strings"
    low, high = np.min(model.damping), np.max(model.damping)
    return f"d = {low:g} N s/m" if low == high else f"d = {low:g} to {high:g} N s/m"


def _inputs(model: Model, times: np.ndarray):
    top = top_nodes(model)
    up = np.zeros((len(model.nodes), 3))
    up[top] = LIFT * _upward(model)[top]
    yield "constant", f"{LIFT:g} N upward on each top node", held(model, times, lambda t: up)

    node = pushed_node(model)
    wave = np.zeros((len(model.nodes), 3))
    wave[node] = WAVE * _upward(model)[node]
    name = model.node_names[node]
    yield (
        "square_wave",
        f"square wave of {WAVE:g} N, period 1 s, vertically on {name}",
        held(model, times, lambda t: wave if t % 1.0 < 0.5 else -wave),
    )

    if len(model.strings) > len(model.actuated):
        moving, amplitude = moving_strings(model)
        names = ", ".join(model.string_names[i] for i in moving)
        yield (
            "rest_lengths",
            f"rest lengths of {names}: sine of {amplitude:.3g} m, 2.5 s, from 2 s",
            held(model, times, rest_length=lambda t: model.rest_length + amplitude * moving_mask(model) * _sine(t)),
        )

    if model.moving or model.actuated:
        inputs = held(model, times, current=_currents(model), motion=_shaking(model))
        yield "drives", "moved nodes shaken, currents swinging", inputs

    push = np.zeros((len(model.nodes), 3))
    push[node, list(model.axes)] = np.array([100.0, 50.0, -30.0])[list(model.axes)]
    push[model.held] = 0.0
    yield (
        "push",
        f"asymmetric push of {np.linalg.norm(push):.0f} N on {name} for 0.5 s",
        held(model, times, lambda t: push if t < 0.5 else 0.0 * push),
    )


def _upward(model: Model) -> np.ndarray:
    """(N, 3) unit vectors of the free nodes: along z, or where a node is fixed along that, along its last free axis."""
    found = np.zeros((len(model.nodes), 3))
    for node in model.free_nodes.tolist():
        axes = [axis for axis in model.axes if not model.held[node, axis]]
        found[node, 2 if 2 in axes or not model.held[node].any() else axes[-1]] = 1.0
    return found


def _sine(t: float) -> float:
    return float(np.sin(2.0 * np.pi * (t - 2.0) / 2.5)) if 2.0 <= t <= 10.0 else 0.0


#: Amplitude of moved nodes as part of the longest bar, and of currents as part of the start currents; their frequencies, 1/s.
SHAKING, SWINGING, SHAKES, SWINGS = 0.02, 0.3, 9.0, 4.0


def _shaking(model: Model):
    """t -> positions and velocities (E, 3) of the moved nodes: a sine along each axis in use."""
    rest, size = model.nodes[list(model.moving)], SHAKING * float(np.max(model.bar_length)) * movable(model)
    rates = np.zeros(3)
    rates[list(model.axes)] = SHAKES * np.array([1.0, 1.3, 0.7])[: len(model.axes)]

    def motion(t):
        return rest + size * np.sin(rates * t), size * rates * np.cos(rates * t)

    return motion


def _currents(model: Model):
    """t -> (A,) currents that swing about those of the start."""
    return lambda t: model.current * (1.0 + SWINGING * np.sin(SWINGS * t))


def pushed_node(model: Model) -> int:
    """n4, as in the article; in scenes without it, or where it is fixed, the last free node."""
    named = [i for i in model.free_nodes if model.node_names[i] == "n4"]
    return int(named[0] if named else model.free_nodes[-1])


def moving_strings(model: Model) -> tuple[list[int], float]:
    """Strings whose rest lengths move, and how far, m: those between top nodes (all where there are none), by the
    article's 0.15 m or a fifth of the shortest rest length.
    """
    top = set(top_nodes(model).tolist())
    chosen = [i for i, path in enumerate(model.paths) if set(path) <= top]
    unwound = [i for i, actuator in enumerate(model.actuator) if actuator is None]
    chosen = [i for i in chosen if i in unwound] or unwound
    return chosen, min(0.15, 0.2 * float(np.min(model.rest_length[chosen])))


def moving_mask(model: Model) -> np.ndarray:
    """(S,) 1 where the rest length moves, else 0."""
    mask = np.zeros(len(model.strings))
    mask[moving_strings(model)[0]] = 1.0
    return mask
