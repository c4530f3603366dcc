"""Random structures with joints: bars that share nodes, also redundantly, welded ones, ones without mass, nodes that are fixed
along single axes, strings, point masses, drag; planar and not, afloat and not."""

from __future__ import annotations

import numpy as np

from tensegrity_core.model import Inputs, Model, grid
from tests.support import by_hand

#: Nodes that are fixed and moved along single axes: one slides along x and is shaken along z, another is pulled along x.
SLIDER = {
    "name": "slider",
    "start": "released",
    "fixed": ["n1", "n2.y", "n2.z", "n5"],
    "moving": ["n2.z", "n5.x"],
    "nodes": {"n1": [0, 0, 1.2], "n2": [0.9, 0, 0.1], "n3": [1.6, 0.2, 0.8], "n4": [1.5, 0.9, 0.2], "n5": [2.6, 0, 0.4]},
    "point_masses": {"n4": 0.5},
    "bars": {
        "b1": {"nodes": ["n2", "n3"], "mass": 1.0},
        "b2": {"nodes": ["n3", "n4"], "mass": 0.7},
        "b3": {"nodes": ["n3", "n5"], "mass": 0.4},
    },
    "strings": {
        "s1": {"nodes": ["n1", "n2"], "stiffness": 90.0, "damping": 2.0},
        "s2": {"nodes": ["n4", "n1"], "stiffness": 60.0, "damping": 1.0},
    },
    "prestress": {"rest_length": {"s1": 1.2, "s2": 1.4}},
}


def random_joints(seed: int) -> Model:
    """At rest, or turning as a whole where nothing is fixed."""
    random = np.random.default_rng(seed)
    count, planar, afloat = int(random.integers(3, 8)), random.random() < 0.4, random.random() < 0.4
    axes = (0, 2) if planar else (0, 1, 2)
    nodes = random.uniform(-1.0, 1.0, (count + 1, 3)) * [1.0, 0.0 if planar else 1.0, 1.0]  # the last is an anchor
    bars = [(int(random.integers(0, i)), i) for i in range(1, count) if random.random() < 0.85]
    others = [(i, j) for i in range(count) for j in range(i + 1, count) if (i, j) not in bars]
    bars += [others[i] for i in random.permutation(len(others))[: random.integers(0, 5)]]
    if not bars:
        bars = [(0, 1)]
    fixed = [count] if afloat else [0, count]
    partly = []
    if not afloat and random.random() < 0.5:
        fixed = [count]
        partly = [(0, tuple(random.permutation(axes)[: len(axes) - 1].tolist()))]
    pairs = [(i, j) for i in range(count + 1) for j in range(i) if not (i in fixed and j in fixed)]
    strings = [pairs[i] for i in random.permutation(len(pairs))[: random.integers(0, 5)]]
    ends = np.array(strings, dtype=int).reshape(-1, 2)
    length = np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1)
    bars = [bar for bar in bars if not (bar[0] in fixed and bar[1] in fixed)]
    mass = np.where(random.random(len(bars)) < 0.2, 0.0, random.uniform(0.3, 3.0, len(bars)))
    bare = set(range(count)) - {node for bar, m in zip(bars, mass) if m for node in bar}
    heavy = sorted(bare | {int(node) for node in random.permutation(count)[: random.integers(0, 3)]})
    touching = [(i, j) for i in range(len(bars)) for j in range(i) if set(bars[i]) & set(bars[j])]
    welds = [touching[random.integers(len(touching))]] if touching and random.random() < 0.4 else []
    turn = random.normal(size=3) * (1.0, 1.0, 1.0) if not planar else [0.0, random.normal(), 0.0]
    velocity = np.cross(turn, nodes) if afloat else np.zeros_like(nodes)
    velocity[count] = 0.0
    return by_hand(
        nodes,
        fixed,
        bars,
        strings,
        axes=axes,
        bar_mass=mass,
        point_mass=[(node, float(random.uniform(0.2, 2.0))) for node in heavy],
        partly_fixed=partly,
        welds=[tuple(sorted(weld)) for weld in welds],
        velocity=velocity,
        drag=[(1, 0.4)] if random.random() < 0.3 else [],
        stiffness=random.uniform(100, 2000, len(strings)),
        damping=random.uniform(0, 20, len(strings)),
        rest_length=length * random.uniform(0.85, 1.05, len(strings)),
        damping_law=("literal", "tension_only")[random.integers(2)],
        gravity=9.81 if random.random() < 0.7 else 0.0,
    )


def random_forces(model: Model, seed: int) -> Inputs:
    """Held forces and moving rest lengths."""
    random = np.random.default_rng(seed + 10**6)
    force = random.normal(scale=5.0, size=(5, len(model.nodes), 3)) * ~model.fixed[None, :, None]
    if len(model.axes) == 2:
        force[:, :, 1] = 0.0
    lengths = model.rest_length + random.uniform(-0.01, 0.01, (5, len(model.strings)))
    rates = random.uniform(-0.2, 0.2, (5, len(model.strings)))
    return Inputs(grid(0.25, 0.05), force, lengths, rates).resolved(model)
