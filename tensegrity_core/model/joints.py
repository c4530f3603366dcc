"""Joints: bars that share nodes, nodes that are fixed along single axes, welded bars; what a model says about them.

A *group* is a set of bars that move each other's nodes: bars that share a node which is not fixed in all axes, and welded ones.
Bars that meet only in a fixed node are groups of their own.  Strings with a consistent mass matrix move the nodes at their
segments' ends together, too.  A group of class 1 is one bar with mass whose ends are free or
fixed altogether: section 1 of the theory, with a mass matrix of its own.

The forces of bars are *redundant* where they can hold each other without load: the lengths leave the motion unique, and these
forces not.

FMUs carry this module and have no SciPy, whose graph routines would serve otherwise.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from .model import Model

#: Singular values below this part of the largest count as zero.
RANK_TOLERANCE = 1e-9
#: Parts of a redundant bar in states of self-stress of the bars alone; below it is round-off.
ROUND_OFF = 1e-8


class Group(NamedTuple):
    """bars: their indices, rising; nodes: those at their ends, rising, fixed ones too; class_1: see the module."""

    bars: tuple[int, ...]
    nodes: tuple[int, ...]
    class_1: bool


def groups(model: Model) -> tuple[Group, ...]:
    """Every bar's group, in the order of their first bars."""
    count, fixed = len(model.bars), np.asarray(model.held.all(axis=1))
    bar, end = np.nonzero(~fixed[model.bars])  # an end that moves joins the bar to its node
    first, second = [bar], [count + model.bars[bar, end]]
    for weld in model.welds:
        first.append(np.full(len(weld) - 1, weld[0]))
        second.append(np.array(weld[1:]))
    tied = [ends for _, *ends, _ in model.string_mass_links if not (fixed[ends[0]] or fixed[ends[1]])]
    first.append(count + np.array([one for one, _ in tied], dtype=int))
    second.append(count + np.array([other for _, other in tied], dtype=int))
    labels = _components(count + len(model.nodes), np.concatenate(first), np.concatenate(second))
    members: dict[int, list[int]] = {}
    for i, label in enumerate(labels[:count]):
        members.setdefault(label, []).append(i)
    return tuple(_group(model, bars) for bars in members.values())


def _components(size: int, first: np.ndarray, second: np.ndarray) -> list[int]:
    """Of each vertex of a graph with edges first[i] - second[i] a vertex that stands for its component (union-find)."""
    above = list(range(size))

    def top(i: int) -> int:
        while above[i] != i:
            above[i] = above[above[i]]
            i = above[i]
        return i

    for i, j in zip(first.tolist(), second.tolist()):
        above[top(i)] = top(j)
    return [top(i) for i in range(size)]


def _group(model: Model, bars: list[int]) -> Group:
    ends = model.bars[bars]
    whole = np.asarray(model.held.all(axis=1) | ~model.held.any(axis=1))
    tied = any(node in ends for _, *links, _ in model.string_mass_links for node in links)
    alone = len(bars) == 1 and model.bar_mass[bars[0]] > 0.0 and not model.fixed[ends].all() and not tied
    return Group(tuple(bars), tuple(np.unique(ends).tolist()), bool(alone and whole[ends].all()))


def first_joint(model: Model) -> str:
    """What of a model is beyond class 1, the first of it in words; '' where nothing is."""
    owner: dict[int, str] = {}
    for name, ends, mass in zip(model.bar_names, model.bars.tolist(), model.bar_mass.tolist()):
        for node in ends:
            if node in owner:
                return f"bars {owner[node]} and {name} share the node {model.node_names[node]}"
            owner[node] = name
        if mass == 0.0:
            return f"bar {name} has no mass"
        if model.fixed[ends].all():
            return f"bar {name} joins two fixed nodes"
    for node, axes in model.partly_fixed:
        return f"node {model.node_names[node]} is fixed along {' and '.join('xyz'[axis] for axis in axes)} only"
    for node, axes in model.moving_axes:
        return f"node {model.node_names[node]} is moved along {' and '.join('xyz'[axis] for axis in axes)} only"
    for string, *_ in model.string_mass_links:
        return f"string {model.string_names[string]} has a consistent mass matrix"
    for weld in model.welds:
        return f"bars {' and '.join(model.bar_names[i] for i in weld)} are welded"
    return ""


def redundant_bars(model: Model) -> np.ndarray:
    """(B,) bool: bars whose forces the lengths leave open, at the model's start.

    Bars at a node whose directions, along its free axes, are linearly independent bear nothing unless it is loaded; they are
    taken away, node by node, and what is left is searched for states of self-stress.  So a chain or a tree costs a time in
    proportion to its bars.
    """
    left = _core(model)
    found = np.zeros(len(model.bars), dtype=bool)
    labels = np.array(_components(len(model.nodes), *model.bars[left].T))
    for label in np.unique(labels[model.bars[left, 0]]):
        bars = left[labels[model.bars[left, 0]] == label]
        _, values, states = np.linalg.svd(length_rows(model, bars).T)
        null = states[int(np.sum(values > RANK_TOLERANCE * values.max(initial=1e-300))) :]
        found[bars] = np.abs(null).max(axis=0, initial=0.0) > ROUND_OFF
    return found


def _core(model: Model) -> np.ndarray:
    """Indices of the bars that no node by itself keeps from bearing a force without load."""
    left = np.ones(len(model.bars), dtype=bool)
    at: list[list[int]] = [[] for _ in model.nodes]
    for i, ends in enumerate(model.bars.tolist()):
        for node in ends:
            at[node].append(i)
    vectors = model.nodes[model.bars[:, 1]] - model.nodes[model.bars[:, 0]]
    vectors = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    axes = np.isin(np.arange(3), model.axes)
    waiting = [node for node in range(len(at)) if at[node]]
    while waiting:
        node = waiting.pop()
        bars = [i for i in at[node] if left[i]]
        directions = vectors[bars][:, axes & ~model.held[node]]
        if not bars or len(bars) > directions.shape[1]:
            continue
        if np.linalg.svd(directions, compute_uv=False)[-1] > RANK_TOLERANCE:
            left[bars] = False
            waiting += [end for i in bars for end in model.bars[i].tolist() if end != node]
    return np.flatnonzero(left)


def length_rows(model: Model, bars: np.ndarray) -> np.ndarray:
    """(bars, coordinates) derivatives of these bars' lengths, of their nodes' free coordinates only."""
    nodes, place = np.unique(model.bars[bars], return_inverse=True)
    place = place.reshape(-1, 2)
    vectors = model.nodes[model.bars[bars, 1]] - model.nodes[model.bars[bars, 0]]
    vectors = vectors / np.linalg.norm(vectors, axis=1)[:, None]
    rows = np.zeros((len(bars), len(nodes), 3))
    each = np.arange(len(bars))
    rows[each, place[:, 0]], rows[each, place[:, 1]] = -vectors, vectors
    free = ~model.held[nodes] & np.isin(np.arange(3), model.axes)
    return rows[:, free]
