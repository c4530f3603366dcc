"""Statics: prestress, equilibrium, its stability, and the model that starts there.

Members are numbered strings first, then bars.  A member's force is positive in tension.  Gravity acts as m g/2 at each
bar node, and on point masses.  Degrees of freedom are the free nodes' coordinates along the axes that the scene uses,
node by node.  Actuators hold their strings' rest lengths.

Equilibria are minima of the potential energy V(x) = strings + gravity - external forces over the positions that keep
every bar's length.  `descend` follows the overdamped gradient flow x' = -grad V on that surface, so it ends in the
minimum whose basin holds the start.

Forces, equilibrium and settling cost time and memory in proportion to the structure: matrices are sparse beyond SMALL.
What needs all singular values or eigenvalues is for structures up to WHOLE.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..model import Model
from .ground import ground_loads, stiffnesses
from .jointed import Jointed, members_of
from .matrices import free_rows, in_space, require_small
from .members import Shape
from .strings import string_tension

BALANCED = 1e-10  # N: a start counts as balanced below this
EPS = float(np.finfo(float).eps)


def loads(model: Model, force=None) -> np.ndarray:
    """(N, 3) N: gravity on bars and point masses, at the nodes, plus external forces (N, 3)."""
    load = np.zeros((len(model.nodes), 3)) if force is None else np.array(force, dtype=float)
    return load + model.node_mass[:, None] * model.g


def equilibrium_matrix(model: Model) -> np.ndarray:
    """(n, S+B): forces on the free coordinates from a unit tension in each member, at the model's start.

    With member forces t and loads p (at the same rows) equilibrium reads A t + p = 0.  Pellegrino and Calladine,
    "Matrix analysis of statically and kinematically indeterminate frameworks", 1986.
    Raises TooLarge: the matrix is dense.
    """
    return whole_matrix(model)[:, : len(model.strings) + len(model.bars)]


def whole_matrix(model: Model) -> np.ndarray:
    """The same, followed by a column for each constraint of welded bars, (n, S+B+w)."""
    require_small(model, "the equilibrium matrix")
    at = members_of(model)
    shape = at.shape(at.start)
    found = 0.0 - (at.rows(shape) / shape.lengths[:, None]).T
    return np.column_stack((found, -at.follower_rows(shape).T)) if isinstance(at, Jointed) else found


def member_forces(model: Model, force=None) -> np.ndarray:
    """(S+B,) N at the model's start: the strings' elastic tensions, then the bar forces that balance best."""
    shape, density, _ = _at_start(model, force)
    return (density * shape.lengths)[: len(model.strings) + len(model.bars)]


def residual(model: Model, force=None) -> np.ndarray:
    """(F, D) N: unbalanced force on each free node at the model's start, bar forces chosen to balance best; 0 along an axis
    along which it is fixed."""
    return in_space(model, _at_start(model, force)[2])[model.free_nodes][:, model.axes]


def _at_start(model: Model, force) -> tuple[Shape, np.ndarray, np.ndarray]:
    """Members at the model's start, their force densities (S+B,), N/m, and what stays unbalanced (n,), N."""
    at, load = members_of(model), free_rows(model, loads(model, force) + ground_loads(model, model.nodes))
    shape = at.shape(at.start)
    density, left = at.balanced(shape, load, string_tension(model, shape.length) / shape.length)
    return shape, density, left


class Unbalanced(NamedTuple):
    """force: N, the largest unbalanced force on a free node at the start; node: its number, -1 where no node is free;
    equilibrium: whether it is round-off."""

    force: float
    node: int
    equilibrium: bool


def unbalanced(model: Model, force=None) -> Unbalanced:
    """Whether the model's start is an equilibrium under external forces (N, 3), N, and how far it is from one."""
    size = np.linalg.norm(residual(model, force), axis=1)
    if not len(size):
        return Unbalanced(0.0, -1, True)
    worst, largest = int(np.argmax(size)), np.abs(member_forces(model, force)).max(initial=0.0)
    small = max(10.0 * round_off(model), 1e-9 * float(largest))
    return Unbalanced(float(size[worst]), int(model.free_nodes[worst]), bool(size[worst] <= small))


def round_off(model: Model) -> float:
    """N: what round-off in the coordinates can leave unbalanced; BALANCED unless members are very stiff or loaded."""
    forces = np.abs(member_forces(model))
    return max(BALANCED, 16.0 * EPS * (coordinate_force(model) + float(np.max(forces, initial=0.0))))


def coordinate_force(model: Model) -> float:
    """N: the largest of stiffness times length, or times coordinate; a round-off in coordinates makes EPS of it."""
    away = float(np.abs(model.nodes).max())
    reach = np.maximum(model.string_lengths(model.nodes), away)
    pressed = float(np.max(stiffnesses(model), initial=0.0)) * away
    return max(float(np.max(model.stiffness * reach, initial=0.0)), pressed)
