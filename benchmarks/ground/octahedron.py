"""The expandable octahedron: six bars in three parallel pairs half a bar apart, and 24 cables.  Its nodes are those
of B. Jessen, Orthogonal icosahedra, Nordisk Matematisk Tidskrift 15 (1967) 90."""

from __future__ import annotations

from itertools import combinations

import numpy as np

LENGTH = 1.0  # m, of a bar
#: Nodes, m, a bar's two one after the other, in the position that a cube has.
NODES = np.array(
    [
        np.roll([along * LENGTH / 2.0, beside * LENGTH / 4.0, 0.0], turn)
        for turn in range(3)
        for beside in (1.0, -1.0)
        for along in (1.0, -1.0)
    ]
)
BARS = tuple((2 * i, 2 * i + 1) for i in range(6))
#: Pairs of nodes that a cable joins.
CABLES = tuple(
    pair
    for pair in combinations(range(12), 2)
    if abs(np.linalg.norm(NODES[pair[0]] - NODES[pair[1]]) - np.sqrt(0.375) * LENGTH) < 1e-9
)
#: Three nodes that cables join in a triangle: what it stands on.
FACE = next(three for three in combinations(range(12), 3) if all(pair in CABLES for pair in combinations(three, 2)))


def standing() -> np.ndarray:
    """(12, 3) m: FACE on z = 0."""
    corners = NODES[list(FACE)]
    down = corners.mean(axis=0) / np.linalg.norm(corners.mean(axis=0))
    across = (corners[1] - corners[0]) / np.linalg.norm(corners[1] - corners[0])
    placed = NODES @ np.array([across, np.cross(-down, across), -down]).T
    return placed - [0.0, 0.0, placed[:, 2].min()]


def table(
    height: float,
    ground: dict,
    stiffness: float,
    damping: float,
    tension: float,
    mass: float,
    honeycomb: dict | None = None,
) -> dict:
    """A scene as nested dicts: held over the ground by nothing, at rest.

    height: of its lowest nodes, m; stiffness, damping, tension: of every cable, N/m, N s/m, N; mass: of a bar, kg; honeycomb:
    in every cable, None: none.
    """
    cable = {"stiffness": stiffness, "damping": damping} | ({"nsh": "honeycomb"} if honeycomb else {})
    names = [f"s{i}" for i in range(1, 25)]
    return {
        "name": "octahedron",
        "start": "released",
        "nodes": {f"n{i}": tuple(place) for i, place in enumerate((standing() + [0.0, 0.0, height]).tolist(), 1)},
        "bars": {f"b{i}": {"nodes": (f"n{a + 1}", f"n{b + 1}"), "mass": mass} for i, (a, b) in enumerate(BARS, 1)},
        "strings": {name: {"nodes": (f"n{a + 1}", f"n{b + 1}")} | cable for name, (a, b) in zip(names, CABLES)},
        "nsh": {"honeycomb": honeycomb} if honeycomb else {},
        "prestress": {"tension": dict.fromkeys(names, tension)},
        "ground": ground,
    }
