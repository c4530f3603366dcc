"""Random structures that fall on the ground: bars and strings, point masses, drag, nodes held along an axis; planar and not, on
inclines, with and without friction and damping, on a ground that moves and one that stands."""

from __future__ import annotations

import dataclasses

import numpy as np

from tensegrity_core.model import Contact, Ground, Inputs, Model, grid, held
from tests.support import by_hand


def random_ground(seed: int, joints: bool = False) -> Model:
    """Bars over a plane, tied by strings, thrown at it.  joints: bars may share nodes, and nodes may be fixed along an axis."""
    random = np.random.default_rng(seed)
    planar = random.random() < 0.4
    axes = (0, 2) if planar else (0, 1, 2)
    flat = np.array([1.0, 0.0 if planar else 1.0, 1.0])
    count = int(random.integers(1, 4))
    nodes = random.uniform(-0.6, 0.6, (2 * count + 1, 3)) * flat
    bars = [(2 * i, 2 * i + 1) for i in range(count)]
    if joints and count > 1:
        bars.append((1, 2))
    pairs = [(i, j) for i in range(len(nodes)) for j in range(i) if (j, i) not in bars]
    strings = [pairs[i] for i in random.permutation(len(pairs))[: random.integers(1, 6)]]
    ends = np.array(strings).reshape(-1, 2)
    length = np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1)
    normal = np.array([0.4 * random.normal() if random.random() < 0.5 else 0.0, 0.0, 1.0]) * flat
    normal /= np.linalg.norm(normal)
    lowest = float((nodes @ normal).min())
    ground = Ground(tuple((lowest - 0.05) * normal), tuple(normal), bool(random.random() < 0.4))
    mu, c = random.choice([0.0, 0.2, 0.8]), random.choice([0.0, 0.3])
    touching = [i for i in range(len(nodes)) if random.random() < 0.8] or [0]
    contacts = [
        Contact(i, random.uniform(2e3, 2e4), c, random.uniform(2e3, 2e4), mu * random.uniform(0.5, 1.5)) for i in touching
    ]
    drift = 0.5 * random.normal(size=3) * flat
    return by_hand(
        nodes,
        [],
        bars,
        strings,
        axes=axes,
        bar_mass=random.uniform(0.5, 2.0, len(bars)),
        point_mass=[(len(nodes) - 1, float(random.uniform(0.3, 1.0)))],
        partly_fixed=[(0, (0,))] if joints and random.random() < 0.5 else [],
        velocity=np.zeros((len(nodes), 3)) if joints else np.tile(drift, (len(nodes), 1)),
        drag=[(0, 0.3)] if random.random() < 0.3 else [],
        stiffness=random.uniform(100, 2000, len(strings)),
        damping=random.uniform(0, 10, len(strings)),
        rest_length=length * random.uniform(0.85, 1.05, len(strings)),
        damping_law=("literal", "tension_only")[random.integers(2)],
        gravity=9.81,
        ground=ground,
        contacts=contacts,
    )


def random_drives(model: Model, seed: int, steps: int = 6, step: float = 0.1) -> Inputs:
    """Held forces, and a ground that moves where it can; in one of three its height and velocity jump between steps, too."""
    random = np.random.default_rng(seed + 10**6)
    push = random.normal(scale=3.0, size=(steps, len(model.nodes), 3)) * np.isin(np.arange(3), model.axes)
    times = grid(steps * step, step)
    w, size = random.uniform(5.0, 15.0), random.uniform(0.0, 0.01)

    def lift(t: float) -> tuple[list[float], list[float]]:
        moves = model.counts["W"]
        return [size * np.sin(w * t)] * moves, [size * w * np.cos(w * t)] * moves

    inputs = held(model, times, ground=lift)
    inputs = dataclasses.replace(inputs, force=push * ~model.held)
    if model.counts["W"] and random.random() < 1 / 3:
        jumps = random.normal(scale=1e-3, size=(steps, 1))
        inputs = dataclasses.replace(inputs, ground_height=inputs.ground_height + jumps)
    return inputs
