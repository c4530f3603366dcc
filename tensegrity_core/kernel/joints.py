"""What the kernel is told of joints: which bars are joined, which nodes they move, what holds welded bodies, which
constraints follow from the others."""

from __future__ import annotations

from itertools import islice
from typing import NamedTuple

import numpy as np

from ..model.model import Model
from ..model.welds import distances

#: Of a constraint's gradient: what is less beside all others adds nothing to them.
DEPENDENT = 1e-9


class Joints(NamedTuple):
    """As integers and numbers; both are empty where a model has no joints.  Their layout stands in native/model/groups.c."""

    ints: list[int]
    doubles: list[float]


def packed_joints(model: Model) -> Joints:
    """What of a model is beyond bars that move by themselves."""
    bars = _joined_bars(model)
    links = [link for link in model.string_mass_links if not model.fixed[list(link[1:3])].all()]
    loose = {node for node, _ in model.partly_fixed} | {node for link in links for node in link[1:3] if not model.fixed[node]}
    nodes = sorted({int(node) for node in np.unique(model.bars[bars]) if not model.fixed[node]} | loose)
    if not nodes and not model.moving_axes:
        return Joints([], [])
    pairs = distances(model)
    ends = np.vstack((model.bars[bars], pairs)).astype(int)
    carried = [(weld, node, places) for weld in model.bodies for node, places in zip(weld.followers, weld.places)]
    dropped = _dependent(model, ends, len(bars), carried)
    bars = bars if nodes else []
    welds = [number for weld in model.welds for number in (len(weld), *weld)]
    moved = [_mask(model, model.moved[node]) for node in model.moving]
    ints = [len(bars), len(nodes), len(pairs), len(dropped), len(carried), len(moved), len(welds), len(links), *bars]
    for node in nodes:
        ints += [node, _mask(model, model.held[node])]
    ints += [*pairs.ravel().tolist(), *dropped]
    for weld, node, _ in carried:
        ints += [node, len(weld.frame), *weld.frame]
    heavy = {string: place for place, string in enumerate(model.massive_strings)}
    for string, first, second, _ in links:
        ints += [heavy[string], first, second]
    doubles = [float(value) for _, _, places in carried for value in places] + [part for *_, part in links]
    return Joints(ints + moved + welds, doubles)


class Unpacked(NamedTuple):
    """Of a model: its fields of these names."""

    partly_fixed: tuple[tuple[int, tuple[int, ...]], ...] = ()
    moving_axes: tuple[tuple[int, tuple[int, ...]], ...] = ()
    welds: tuple[tuple[int, ...], ...] = ()
    string_mass_matrix: str = "lumped"


def unpacked_links(ints: list[int], doubles: list[float], heavy: list[int]) -> tuple[tuple[int, int, int, float], ...]:
    """(string, node, node, part) of strings whose mass moves like a bar's; heavy: the strings with mass."""
    if not ints or not ints[7]:
        return ()
    end = len(ints) - ints[5] - ints[6]
    rows = np.reshape(ints[end - 3 * ints[7] : end], (-1, 3)).tolist()
    return tuple((heavy[place], *ends, part) for (place, *ends), part in zip(rows, doubles[len(doubles) - len(rows) :]))


def unpacked_joints(ints: list[int], moving: list[int], axes: tuple[int, ...]) -> Unpacked:
    """What `packed_joints` made these integers of, with the model's moved nodes and axes."""
    if not ints:
        return Unpacked()
    bars, nodes, _, _, _, moved, weld_ints, links = ints[:8]
    held = [(node, _axes(mask, axes)) for node, mask in zip(*(iter(ints[8 + bars : 8 + bars + 2 * nodes]),) * 2)]
    masks = ints[len(ints) - weld_ints - moved : len(ints) - weld_ints]
    numbers, welds = iter(ints[len(ints) - weld_ints :]), []
    welds += [tuple(islice(numbers, count)) for count in numbers]
    single = tuple((node, _axes(mask, axes)) for node, mask in zip(moving, masks) if len(_axes(mask, axes)) < len(axes))
    matrix = "consistent" if links else "lumped"
    return Unpacked(tuple((node, along) for node, along in held if along), single, tuple(welds), matrix)


def _axes(mask: int, axes: tuple[int, ...]) -> tuple[int, ...]:
    return tuple(axis for place, axis in enumerate(axes) if mask >> place & 1)


def _mask(model: Model, flags: np.ndarray) -> int:
    """A bit for each of the axes that the scene uses."""
    return sum(1 << place for place, axis in enumerate(model.axes) if flags[axis])


def _joined_bars(model: Model) -> list[int]:
    """Bars that are no group by themselves, and those that are pinned to a node where another bar is, too."""
    shared = np.bincount(model.bars.ravel(), minlength=len(model.nodes)) > 1
    found = {bar for group in model.groups if not group.class_1 for bar in group.bars}
    return sorted(found | set(np.flatnonzero(shared[model.bars].any(axis=1)).tolist()))


def _dependent(model: Model, ends: np.ndarray, bars: int, carried: list) -> list[int]:
    """Places in `ends` of the distances, the first `bars` of which are bars', that follow from all others at the start."""
    rows = _gradients(model, ends, carried)
    left = _core(len(model.nodes), rows)
    places = {node: i for i, node in enumerate(sorted({node for i in left for node in rows[i]}))}
    dense = np.zeros((len(left), 3 * len(places)))
    for row, i in enumerate(left):
        for node, gradient in rows[i].items():
            dense[row, 3 * places[node] : 3 * places[node] + 3] = gradient
    dense /= np.maximum(np.linalg.norm(dense, axis=1), 1e-300)[:, None]
    welds_first = [[row for row, i in enumerate(left) if i >= bars], [row for row, i in enumerate(left) if i < bars]]
    kept: list[int] = []
    for rows_here in welds_first:
        kept += _independent(dense, rows_here)
    return sorted(left[row] for row in set(range(len(left))) - set(kept) if left[row] < len(ends))


def _independent(dense: np.ndarray, candidates: list[int]) -> list[int]:
    """Of these rows in turn the one that depends least on those taken before; what is taken leaves all rows, in place."""
    kept, open_rows = [], list(candidates)
    while open_rows:
        sizes = np.linalg.norm(dense[open_rows], axis=1)
        best = int(np.argmax(sizes))
        if sizes[best] <= DEPENDENT:
            break
        row = open_rows.pop(best)
        unit = dense[row] / sizes[best]
        dense -= np.outer(dense @ unit, unit)
        kept.append(row)
    return kept


def _gradients(model: Model, ends: np.ndarray, carried: list) -> list[dict[int, np.ndarray]]:
    """Of each constraint its gradient by its nodes, along their free axes; those of followers last."""
    free = ~model.held & np.isin(np.arange(3), model.axes)
    rows = []
    for first, second in ends.tolist():
        along = model.nodes[second] - model.nodes[first]
        rows.append({first: -along * free[first], second: along * free[second]})
    for weld, node, places in carried:
        for direction in weld.across(model.nodes, model.axes):
            row = {frame: -c * direction * free[frame] for frame, c in zip(weld.frame, places)}
            rows.append(row | {node: direction * free[node]})
    return [{node: gradient for node, gradient in row.items() if gradient.any()} for row in rows]


def _core(nodes: int, rows: list[dict[int, np.ndarray]]) -> list[int]:
    """The constraints that no node by itself shows to be independent of the others."""
    at: list[set[int]] = [set() for _ in range(nodes)]
    for i, row in enumerate(rows):
        for node in row:
            at[node].add(i)
    waiting = list(range(nodes))
    while waiting:
        node = waiting.pop()
        here = sorted(at[node])
        if not 0 < len(here) <= 3:
            continue
        sides = np.array([rows[i][node] / np.linalg.norm(rows[i][node]) for i in here])
        if np.linalg.svd(sides, compute_uv=False)[-1] <= DEPENDENT:
            continue
        for i in here:
            for other in rows[i]:
                at[other].discard(i)
                waiting.append(other)
    return sorted({i for here in at for i in here} | {i for i, row in enumerate(rows) if not row})
