"""States of self-stress and mechanisms, from the equilibrium matrix."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..model import Model
from .forces import whole_matrix
from .matrices import RANK_TOLERANCE, in_space, null_space, require_small


@dataclass(frozen=True, eq=False)
class Analysis:
    """What the equilibrium matrix says about a structure.

    equations, members: its size, n (F*D where no node is partly fixed) and S+B; singular_values: of the matrix, falling, the
    constraints of welded bars among its columns; rank: of the matrix;
    self_stress: (S+B, s) orthonormal member forces that balance without load; mechanisms: (m, N, 3) orthonormal
    velocity fields that stretch no member, rigid-body motions taken out; rigid_body_motions: number of rigid-body
    motions that the fixed nodes leave.
    """

    equations: int
    members: int
    singular_values: np.ndarray
    rank: int
    self_stress: np.ndarray
    mechanisms: np.ndarray
    rigid_body_motions: int


def analyse(model: Model, tolerance: float = RANK_TOLERANCE) -> Analysis:
    """Rank, self-stress states and infinitesimal mechanisms at the model's start.

    tolerance: singular values below this part of the largest count as zero.
    Raises TooLarge: time grows with the third power of the structure.
    """
    require_small(model, "rank analysis")
    matrix, members = whole_matrix(model), len(model.strings) + len(model.bars)
    left, values, right = np.linalg.svd(matrix)
    rank = int(np.sum(values > tolerance * values[0])) if values.size else 0
    free = left[:, rank:]
    rigid = rigid_body_motions(model)
    if rigid.shape[1]:
        projected = free - rigid @ (rigid.T @ free)
        directions, sizes, _ = np.linalg.svd(projected, full_matrices=False)
        free = directions[:, sizes > 0.5]  # the sizes are 0 (rigid) or 1 up to round-off
    fields = np.array([in_space(model, field) for field in free.T]).reshape(-1, len(model.nodes), 3)
    return Analysis(matrix.shape[0], members, values, rank, _of_members(right[rank:].T, members), fields, rigid.shape[1])


def _of_members(states: np.ndarray, members: int) -> np.ndarray:
    """(S+B, s) orthonormal: states of self-stress (S+B+w, s) as far as members bear them."""
    if len(states) == members:
        return states
    directions, sizes, _ = np.linalg.svd(states[:members], full_matrices=False)
    return directions[:, sizes > RANK_TOLERANCE]


def rigid_body_motions(model: Model) -> np.ndarray:
    """(F*D, r) orthonormal rigid-body velocities of the free nodes that leave the fixed nodes at rest."""
    fields = np.array(list(rigid_fields(model).values()))[:, :, model.axes]
    flat = fields.reshape(len(fields), -1)
    combinations = null_space(np.delete(flat, model.free_coordinates, axis=1).T)
    moving = flat[:, model.free_coordinates].T @ combinations
    directions, sizes, _ = np.linalg.svd(moving, full_matrices=False)
    return directions[:, sizes > RANK_TOLERANCE * max(1.0, sizes.max(initial=0.0))]


def rigid_fields(model: Model) -> dict[str, np.ndarray]:
    """(N, 3) velocities by name: the structure's translations along its axes and its rotations, about the nodes' mean or, where
    nodes are fixed, about the mean of these; the farthest node turns at 1 m/s."""
    middle = model.nodes[model.fixed_nodes if model.fixed.any() else slice(None)].mean(axis=0)
    arm = model.nodes - middle
    arm = arm / max(1e-300, float(np.abs(arm).max()))
    fields = {f"translation along {'xyz'[axis]}": np.tile(np.eye(3)[axis], (len(arm), 1)) for axis in model.axes}
    for axis in range(3):
        if len(model.axes) == 3 or axis not in model.axes:
            fields[f"rotation about {'xyz'[axis]}"] = np.cross(np.eye(3)[axis], arm)
    return fields
