"""Welded bars as rigid bodies: the constraints beside the bars' lengths that hold a body's nodes together.

A body of k nodes lies in a line, a plane or the space (d = 1, 2, 3 dimensions).  Distances within it, those of its bars first,
hold it there: d k - d (d+1)/2 of them are independent.  To first order distances say nothing about how a line bends or a
plane warps.  So of a body flatter than its scene d + 1 nodes are its *frame*, and each further node keeps its place across the
line or plane: x = sum over the frame of c x_f, with constant c that add up to 1.

None of these constraints follows from the others.
"""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from .model import Model

#: Of a body's extent: what is flatter counts as flat.
FLAT = 1e-9


class Weld(NamedTuple):
    """One rigid body.

    bars, nodes: rising; frame: d + 1 of its nodes; distances: pairs of nodes whose distance is kept, beside the bars';
    followers: nodes that keep their place across the frame's line or plane; places: (followers, d + 1) their coefficients.
    """

    bars: tuple[int, ...]
    nodes: tuple[int, ...]
    frame: tuple[int, ...]
    distances: tuple[tuple[int, int], ...]
    followers: tuple[int, ...]
    places: np.ndarray

    def across(self, nodes: np.ndarray, axes: tuple[int, ...]) -> np.ndarray:
        """(D - d, 3) m: orthogonal directions across the frame's line or plane, as long as its first edge.  nodes: (N, 3)."""
        edges = (nodes[list(self.frame[1:])] - nodes[self.frame[0]])[:, list(axes)].T  # (D, d)
        found = np.zeros((len(axes) - edges.shape[1], 3))
        found[:, list(axes)] = np.linalg.qr(edges, mode="complete")[0][:, edges.shape[1] :].T * np.linalg.norm(edges[:, 0])
        return found


class Followers(NamedTuple):
    """How followers keep their places, an equation for each direction across: coefficients (f, N) of the nodes, sum 0;
    directions (f, 3) m; g = direction . sum of coefficients x = 0; body: (f,) int."""

    coefficients: np.ndarray
    directions: np.ndarray
    body: np.ndarray


def followers(model: Model, nodes: np.ndarray) -> Followers:
    """The equations of all followers, with the nodes (N, 3) m."""
    rows, directions, body = [], [], []
    for number, weld in enumerate(model.bodies):
        if not weld.followers:
            continue
        across = weld.across(nodes, model.axes)
        for node, places in zip(weld.followers, weld.places):
            row = np.zeros(len(nodes))
            row[node] = 1.0
            row[list(weld.frame)] -= places
            rows += [row] * len(across)
            directions += list(across)
            body += [number] * len(across)
    shape = (-1, len(nodes)), (-1, 3)
    return Followers(np.array(rows).reshape(shape[0]), np.array(directions).reshape(shape[1]), np.array(body, dtype=int))


def distances(model: Model) -> np.ndarray:
    """(w, 2) int: the pairs of nodes whose distances welds keep, beside the bars'."""
    return np.array([pair for weld in model.bodies for pair in weld.distances], dtype=int).reshape(-1, 2)


def rigid_bodies(model: Model) -> tuple[Weld, ...]:
    """The rigid bodies of a model's welds, at its start; welds with a bar in common are one body."""
    joined: list[set[int]] = []
    for weld in model.welds:
        touched = [one for one in joined if one & set(weld)]
        joined = [one for one in joined if one not in touched] + [set(weld).union(*touched)]
    return tuple(_body(model, tuple(sorted(bars))) for bars in joined)


def _body(model: Model, bars: tuple[int, ...]) -> Weld:
    nodes = tuple(np.unique(model.bars[list(bars)]).tolist())
    x = model.nodes[list(nodes)][:, list(model.axes)]
    frame = _frame(x)
    followers: list[int] = [] if len(frame) > len(model.axes) else [i for i in range(len(nodes)) if i not in frame]
    corners = np.vstack((x[frame].T, np.ones(len(frame))))
    places = np.linalg.lstsq(corners, np.vstack((x[followers].T, np.ones(len(followers)))), rcond=None)[0].T
    pairs = _distances(x, [(nodes.index(i), nodes.index(j)) for i, j in model.bars[list(bars)].tolist()], len(frame) - 1)
    named = tuple((nodes[i], nodes[j]) for i, j in pairs)
    return Weld(bars, nodes, tuple(nodes[i] for i in frame), named, tuple(nodes[i] for i in followers), places)


def _frame(x: np.ndarray) -> list[int]:
    """Places of d + 1 points (k, D) that span what all of them span: the first, and in turn that which is farthest away."""
    chosen, rest = [0], x - x[0]
    smallest = FLAT * float(np.linalg.norm(rest, axis=1).max())
    while len(chosen) <= x.shape[1]:
        far = np.linalg.norm(rest, axis=1)
        at = int(np.argmax(far))
        if far[at] <= smallest:
            break
        chosen.append(at)
        unit = rest[at] / far[at]
        rest = rest - np.outer(rest @ unit, unit)
    return chosen


def _distances(x: np.ndarray, bars: list[tuple[int, int]], d: int) -> list[tuple[int, int]]:
    """Pairs of points (k, D) that with the bars hold them in their d dimensions, as few as will do."""
    within = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)[2][:d]
    flat = x @ within.T  # (k, d)
    others = [pair for pair in combinations(range(len(x)), 2) if pair not in bars and pair[::-1] not in bars]
    rows = {pair: _row(flat, pair) for pair in bars + others}
    _, sizes, directions = np.linalg.svd(np.array([rows[pair] for pair in bars]), full_matrices=False)
    held = directions[sizes > FLAT * sizes[0]].T
    chosen: list[tuple[int, int]] = []
    while held.shape[1] < d * len(x) - d * (d + 1) // 2:
        left = {pair: rows[pair] - held @ (held.T @ rows[pair]) for pair in others}
        best = max(left, key=lambda pair: float(np.linalg.norm(left[pair])))
        chosen.append(best)
        held = np.column_stack((held, left[best] / np.linalg.norm(left[best])))
    return chosen


def _row(x: np.ndarray, pair: tuple[int, int]) -> np.ndarray:
    """(k d,) derivative of the distance of two points."""
    row, unit = np.zeros_like(x), x[pair[1]] - x[pair[0]]
    unit = unit / np.linalg.norm(unit)
    row[pair[1]], row[pair[0]] = unit, -unit
    return row.ravel()
