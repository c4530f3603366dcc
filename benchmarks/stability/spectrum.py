"""The linearised motion about a taut equilibrium: eigenvalues from the kernel's Jacobian, along the bars' constraints.

About an equilibrium with all strings taut, dq'' = Jq dq + Jv dq' for the kernel's coordinates q (bar vectors and centres).
Along a bar the exact projector leaves e'' = 0, a double eigenvalue 0 that no method moves; what remains is the motion in the
tangent of the constraints, and that space is invariant.  q depends linearly on the node positions, so its tangent is taken
from the nodes' and does not depend on how the kernel orders q.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tensegrity_core.errors import InputError
from tensegrity_core.kernel import Kernel
from tensegrity_core.model import Model
from tensegrity_core.statics import member_forces


def retuned(model: Model, damping: float | None = None, stiffness: float | None = None) -> Model:
    """The model at one damping (N s/m) and stiffness (N/m) of all strings, at the same equilibrium: tensions stay, rest
    lengths follow.  Raises InputError where a string has an NSH or is slack, or a rest length would not be positive."""
    if model.nsh_strings:
        raise InputError(f"string {model.string_names[model.nsh_strings[0]]!r} has an NSH; use a scene with plain strings")
    tension = member_forces(model)[: len(model.strings)]
    ends = model.nodes[model.strings]
    length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    k = model.stiffness if stiffness is None else np.full(len(tension), float(stiffness))
    d = model.damping if damping is None else np.full(len(tension), float(damping))
    rest = length - tension / k
    if not (tension.min() > 0.0 and rest.min() > 0.0):
        raise InputError(f"stiffness = {stiffness!r} N/m: a string is slack or has no length left; use a larger one")
    return replace(model, stiffness=k, damping=d, rest_length=rest)


def node_tangent(model: Model) -> np.ndarray:
    """(n, N, 3) orthonormal displacements of the free nodes, along the scene's axes, that keep the bars' lengths."""
    gradient = np.zeros((len(model.bars), len(model.nodes), 3))
    for row, (first, second) in zip(gradient, model.bars):
        row[second] = model.nodes[second] - model.nodes[first]
        row[first] = -row[second]
    place = np.ix_(range(len(model.bars)), model.free_nodes, model.axes)
    normals = gradient[place].reshape(len(model.bars), -1)
    free = np.linalg.svd(normals)[2][len(model.bars) :]
    fields = np.zeros((len(free), len(model.nodes), 3))
    fields[np.ix_(range(len(free)), model.free_nodes, model.axes)] = free.reshape(len(free), -1, len(model.axes))
    return fields


def kernel_at(model: Model, **defaults) -> Kernel:
    """A kernel at the model's start."""
    kernel = Kernel(model, **defaults)
    kernel.initialize()
    return kernel


def coordinates(y: np.ndarray) -> int:
    """Number of coordinates q in a state [q, q', three integrals]."""
    return (len(y) - 3) // 2


def tangent(model: Model) -> tuple[Kernel, np.ndarray, np.ndarray]:
    """A kernel at the model's start; how its coordinates q move along `node_tangent`, (n, Q); an orthonormal basis (Q, n)."""
    kernel = kernel_at(model)
    q = kernel.state[: coordinates(kernel.state)]
    states = [kernel_at(replace(model, nodes=model.nodes + field)).state for field in node_tangent(model)]
    moved = np.array([state[: len(q)] - q for state in states])
    return kernel, moved, np.linalg.qr(moved.T)[0]


def eigenvalues(model: Model) -> np.ndarray:
    """(2n,) 1/s: of the motion about the model's start, which must be an equilibrium, n directions keeping the bars."""
    kernel, _, T = tangent(model)
    Jq, Jv, _ = kernel.jacobian(kernel.state)
    zero, one = np.zeros((T.shape[1],) * 2), np.eye(T.shape[1])
    return np.linalg.eigvals(np.block([[zero, one], [T.T @ Jq @ T, T.T @ Jv @ T]]))
