"""Strings that run over more than two nodes, and strings with mass: paths, segments, shares of mass.

A *routed* string passes its inner nodes without friction, so that one tension acts along its whole path; its length is the sum
of its segments'.  It is endless where it ends at the node at which it begins.  A string's mass is lumped at its nodes: each
segment has a part of it in proportion to its nominal length, half of that at each end.  With a *consistent* mass matrix a
segment moves like a thin bar of its part of the mass, m/6 [2 1; 1 2] per axis, which ties the motions of its nodes together.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import InputError

if TYPE_CHECKING:
    from .model import Model


class Segments(NamedTuple):
    """Straight parts of strings, string by string and along each: string (G,), whose it is; ends (G, 2), its nodes."""

    string: np.ndarray
    ends: np.ndarray


def checked(routes, strings: np.ndarray) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """Routes of plain integers.  Raises InputError where one is not that of its string, or comes out of turn."""
    found = tuple((int(string), tuple(int(node) for node in nodes)) for string, nodes in routes)
    last = -1
    for string, nodes in found:
        if not last < string < len(strings):
            raise InputError(f"routes: string {string} is out of turn; list strings that there are, each once, rising")
        if len(nodes) < 3 or nodes[:2] != tuple(strings[string].tolist()):
            raise InputError(f"routes: that of string {string}, {nodes}, has to begin with its two nodes and go on from there")
        if any(one == other for one, other in pairwise(nodes)):
            raise InputError(f"routes: string {string} goes from a node to itself; name another node between")
        last = string
    return found


def paths(model: Model) -> tuple[tuple[int, ...], ...]:
    """All nodes of every string, in order."""
    found = [tuple(ends) for ends in model.strings.tolist()]
    for string, nodes in model.routes:
        found[string] = nodes
    return tuple(found)


def segments(paths: tuple[tuple[int, ...], ...]) -> Segments:
    """The segments of paths."""
    pairs = [(string, ends) for string, nodes in enumerate(paths) for ends in pairwise(nodes)]
    string = np.array([string for string, _ in pairs], dtype=int)
    return Segments(string, np.array([ends for _, ends in pairs], dtype=int).reshape(-1, 2))


def lengths(model: Model, nodes: np.ndarray) -> np.ndarray:
    """(S,) m, of the strings' whole paths between nodes (N, 3)."""
    found = _distances(nodes, model.strings)
    for string, path in model.routes:
        found[string] = _distances(nodes, np.column_stack((path[:-1], path[1:]))).sum()
    return found


def longest_segment(model: Model, string: int) -> tuple[int, float]:
    """The number of a string's longest segment at the start, from 0, and its length, m."""
    path = model.paths[string]
    found = _distances(model.nodes, np.column_stack((path[:-1], path[1:])))
    return int(np.argmax(found)), float(found.max())


def _distances(nodes: np.ndarray, ends: np.ndarray) -> np.ndarray:
    return np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1)


def mass_parts(model: Model) -> tuple[tuple[int, int, int, float], ...]:
    """(string, node, node, part) of the segments of the strings with mass, along each; the parts of a string add up to 1."""
    found = []
    for string in model.massive_strings:
        path = model.paths[string]
        length = _distances(model.nominal, np.column_stack((path[:-1], path[1:])))
        parts = [1.0] if len(path) == 2 else (length / length.sum()).tolist()
        found += [(string, first, second, part) for part, (first, second) in zip(parts, pairwise(path))]
    return tuple(found)


def mass_shares(model: Model) -> tuple[tuple[int, int, float], ...]:
    """(string, node, share) of the strings with mass, node by node along each; the shares of a string add up to 1."""
    found: dict[tuple[int, int], float] = {}
    for string, first, second, part in mass_parts(model):
        for node in (first, second):
            found[string, node] = found.get((string, node), 0.0) + 0.5 * part
    return tuple((string, node, share) for (string, node), share in found.items())
