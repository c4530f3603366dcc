"""Welded bars as rigid bodies: the constraints beside the bars' lengths that hold a body's nodes together.

A body of k nodes lies in a line, a plane or the space (d = 1, 2, 3 dimensions).  Distances within it, those of its bars first,
hold it there: d k - d (d+1)/2 of them are independent.  To first order distances say nothing about how a line bends or a
plane warps.  So of a body flatter than its scene d + 1 nodes are its *frame*, and each further node keeps its place across the
line or plane: x = sum over the frame of c x_f, with constant c that add up to 1.

None of these constraints follows from the others.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

if TYPE_CHECKING:
    from .model import Model

#: A bar's name or number.
Bar = TypeVar("Bar", str, int)

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
    return tuple(_body(model, tuple(sorted(bars))) for bars in joined(model.welds))


def joined(welds: Iterable[Iterable[Bar]]) -> list[set[Bar]]:
    """Welds with those that have a bar in common in one."""
    found: list[set[Bar]] = []
    for weld in welds:
        bars = set(weld)
        touched = [one for one in found if one & bars]
        found = [one for one in found if one not in touched] + [bars.union(*touched)]
    return found


def _body(model: Model, bars: tuple[int, ...]) -> Weld:
    nodes = tuple(np.unique(model.bars[list(bars)]).tolist())
    x = model.nodes[list(nodes)][:, list(model.axes)]
    frame = _frame(x)
    followers: list[int] = [] if len(frame) > len(model.axes) else [i for i in range(len(nodes)) if i not in frame]
    corners = np.vstack((x[frame].T, np.ones(len(frame))))
    places = np.linalg.lstsq(corners, np.vstack((x[followers].T, np.ones(len(followers)))), rcond=None)[0].T
    pairs = _distances(x, [(nodes.index(i), nodes.index(j)) for i, j in model.bars[list(bars)].tolist()], frame)
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


def _distances(x: np.ndarray, bars: list[tuple[int, int]], frame: list[int]) -> list[tuple[int, int]]:
    """Pairs of points (k, D) that with the bars hold them in the d dimensions of their frame, as few as will do.

    Of the pairs with a point of the frame, which together hold all, in turn the one that depends least on those before.
    """
    d = len(frame) - 1
    within = np.linalg.svd(x - x.mean(axis=0), full_matrices=False)[2][:d]
    flat = x @ within.T  # (k, d)
    known = {frozenset(pair) for pair in bars}
    others = [(i, j) for i in frame for j in range(len(x)) if (j not in frame or i < j) and frozenset((i, j)) not in known]
    _, sizes, directions = np.linalg.svd(_rows(flat, bars), full_matrices=False)
    held = directions[sizes > FLAT * sizes[0]]
    left, chosen = _rows(flat, others), []
    left = left - (left @ held.T) @ held
    for _ in range(d * len(x) - d * (d + 1) // 2 - len(held)):
        lengths = np.linalg.norm(left, axis=1)
        best = int(np.argmax(lengths))
        chosen.append(others[best])
        unit = left[best] / lengths[best]
        left = left - np.outer(left @ unit, unit)
    return chosen


def _rows(x: np.ndarray, pairs: list[tuple[int, int]]) -> np.ndarray:
    """(pairs, k d) derivatives of the distances of pairs of points (k, d)."""
    ends = np.array(pairs, dtype=int).reshape(-1, 2)
    unit = x[ends[:, 1]] - x[ends[:, 0]]
    unit = unit / np.linalg.norm(unit, axis=1)[:, None]
    rows, each = np.zeros((len(ends), *x.shape)), np.arange(len(ends))
    rows[each, ends[:, 1]], rows[each, ends[:, 0]] = unit, -unit
    return rows.reshape(len(ends), -1)
