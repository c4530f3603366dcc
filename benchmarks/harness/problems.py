"""The initial value problems of the benchmarks, as data.

A problem is a model with its start, a constant external force, a duration, and the nodes whose positions are judged at
`INSTANTS` + 1 equally spaced instants.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tensegrity_core.model import Model
from tensegrity_core.scene import load_scene, parse_scene
from tensegrity_core.statics import build_model

#: Output instants after the start.
INSTANTS = 20
SCENES = ("two_bar", "three_bar", "six_bar")
DAMPINGS = (50.0, 500.0, 5000.0)
#: Force up on each top node, and aside (x) on the first of them, N.
PUSH_UP, PUSH_ASIDE = 45.0, 20.0


def built_in(scene: str) -> Model:
    """The model of a built-in scene."""
    return build_model(load_scene(scene))


def posed(**entries) -> Model:
    """The model of a scene with these entries."""
    return build_model(parse_scene(entries))


@dataclass(frozen=True)
class Problem:
    """name: unique; figure: the figure it belongs to; title: of its panel; force: (N, 3) N on the nodes, constant;
    duration: s; judged: indices of the nodes whose positions count; conservative: nothing enters or leaves the energy;
    smooth: no string leaves its piece of the force curve."""

    name: str
    figure: str
    title: str
    model: Model
    force: np.ndarray
    duration: float
    judged: np.ndarray
    conservative: bool = False
    smooth: bool = False

    @property
    def kernel_force(self) -> np.ndarray:
        """(F * D,) N: the kernel's input `force`."""
        return kernel_force(self.model, self.force)


def kernel_force(model: Model, force: np.ndarray) -> np.ndarray:
    """(F * D,) N: of a force (N, 3) on all nodes, what acts on the free ones, on the axes that the scene uses."""
    return force[np.ix_(model.free_nodes, model.axes)].ravel()


def top_nodes(model: Model) -> np.ndarray:
    """Indices of the highest nodes."""
    height = model.nodes[:, 2]
    return np.flatnonzero(height > height.max() - 0.01)


def push(model: Model, up: float = PUSH_UP, aside: float = PUSH_ASIDE) -> np.ndarray:
    """(N, 3) N: `up` on each top node, `aside` in x on the first of them."""
    top, force = top_nodes(model), np.zeros((len(model.nodes), 3))
    force[top, 2] = up
    force[top[0], 0] = aside
    return force


def pushed(scene: str, damping: float) -> Problem:
    """A scene of the article under an asymmetric push that starts at once, 1 s; damping: of every string, N s/m."""
    model = built_in(scene)
    model = replace(model, damping=np.full(len(model.strings), damping))
    title = f"{'NSH' if model.nsh_strings else 'plain'}, d = {damping:g} N s/m"
    name, figure = f"{scene}/{damping:g}", scene.removesuffix("_nsh")
    return Problem(name, figure, title, model, push(model), 1.0, top_nodes(model))


def prism(prestress: float, spin: np.ndarray, drift: np.ndarray, breathing: float) -> Model:
    """A free three-bar prism without damping or gravity: twist 150 degrees, bars of 0.695 m and 1 kg, strings of 1000 N/m.

    prestress: tension of the verticals, N, the force densities being triangle : vertical = 1/sqrt(3) : 1 (the self-stress
    of this prism, Tibert and Pellegrino, "Review of Form-Finding Methods for Tensegrity Structures", 2003, DOI
    10.1260/026635103322987940); spin: (3, 3) 1/s, how each bar turns about its centre; drift: (3, 3) m/s, of each bar's
    centre; breathing: rate at which the radius widens, 1/s, as far as the bars' lengths allow.
    """
    length, radius, stiffness, twist = 0.695, 0.25, 1000.0, np.radians(150.0)
    height = np.sqrt(length**2 - (2.0 * radius * np.sin(twist / 2.0)) ** 2)
    low = np.arange(3) * 2.0 * np.pi / 3.0
    bottom = np.column_stack([radius * np.cos(low), radius * np.sin(low), np.zeros(3)])
    top = np.column_stack([radius * np.cos(low + twist), radius * np.sin(low + twist), np.full(3, height)])
    nodes = np.vstack([bottom, top])
    bars = np.array([(i, 3 + i) for i in range(3)])
    strings = np.array([(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3)] + [(i, 3 + (i - 1) % 3) for i in range(3)])
    strung = np.linalg.norm(nodes[strings[:, 1]] - nodes[strings[:, 0]], axis=1)
    density = np.where(np.arange(9) < 6, 1.0 / np.sqrt(3.0), 1.0) * prestress / strung[6]
    return Model(
        name="prism",
        description="a free three-bar prism",
        axes=(0, 1, 2),
        node_names=tuple(f"n{i}" for i in range(1, 7)),
        bar_names=("b1", "b2", "b3"),
        string_names=tuple(f"s{i}" for i in range(1, 10)),
        nodes=nodes,
        fixed=np.zeros(6, bool),
        bars=bars,
        bar_mass=np.ones(3),
        strings=strings,
        stiffness=np.full(9, stiffness),
        damping=np.zeros(9),
        rest_length=strung * (1.0 - density / stiffness),
        nsh=(None,) * 9,
        damping_law="literal",
        gravity=0.0,
        nominal=nodes,
        velocity=_bar_velocities(nodes, bars, spin, drift, breathing),
    )


def _bar_velocities(nodes, bars, spin, drift, breathing) -> np.ndarray:
    """(N, 3) m/s that keep the bars' lengths."""
    velocity = breathing * nodes * np.array([1.0, 1.0, 0.0])
    for (i, j), turn, move in zip(bars, spin, drift):
        b = nodes[j] - nodes[i]
        apart = velocity[j] - velocity[i]
        along = 0.5 * b * (apart @ b) / (b @ b)
        across = 0.5 * np.cross(turn, b)
        velocity[i] += along - across + move
        velocity[j] += -along + across + move
    return velocity


def free_flight() -> Problem:
    """A taut prism that spins, breathes and drifts for 100 s: nothing dissipates, and no string goes slack."""
    model = prism(20.0, np.tile([0.3, 0.2, 2.0], (3, 1)), np.tile([0.1, 0.2, -0.1], (3, 1)), 0.1)
    return Problem("free_flight", "free_flight", "d = 0, 100 s", model, np.zeros((6, 3)), 100.0, np.arange(6), True, True)


def tumbling() -> Problem:
    """A loose prism whose bars tumble for 1 s: strings go slack and taut, but without dampers nothing jumps.

    MuJoCo's tendons can state it: their dampers act while slack too, which rules out the article's law for d > 0.
    """
    n = np.arange(3.0)
    spin = np.column_stack([2.6 - 2.0 * n, -1.4 + 2.0 * n, np.full(3, 1.8)])
    drift = np.column_stack([0.1 * n, np.full(3, 0.2), np.full(3, -0.1)])
    model = prism(2.0, spin, drift, 0.0)
    return Problem("mujoco_prism", "mujoco", "free prism, d = 0", model, np.zeros((6, 3)), 1.0, np.arange(6), True)


def names() -> list[str]:
    """Of all problems, in the order of the figures."""
    plain_and_nsh = (scene + tail for scene in SCENES for tail in ("", "_nsh"))
    return [f"{scene}/{d:g}" for scene in plain_and_nsh for d in DAMPINGS] + ["free_flight", "mujoco_prism"]


def problem(name: str) -> Problem:
    """A problem by its name."""
    if name == "free_flight":
        return free_flight()
    if name == "mujoco_prism":
        return tumbling()
    scene, _, damping = name.partition("/")
    if name not in names():
        raise SystemExit(f"problem {name!r}: use one of {', '.join(names())}")
    return pushed(scene, float(damping))
