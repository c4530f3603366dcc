"""What the reference's equations need of a model, once for all times."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import laws
from ..errors import InputError
from ..model import Model
from .equations import connectivity, levers, mass_matrix
from .motors import Motors, motors_of
from .moved import Moved, moved_nodes


@dataclass(frozen=True)
class Structure:
    """A model's constant matrices, in the article's notation.

    C (n, S + B): [C_s^T C_b^T]; M_inv (n, n): of the free nodes, see above; J (B,), arms (B, n): see `levers`;
    C_b_M_inv (B, n): C_b M^-1; fixed (n,): 1 at fixed nodes; weight (3, n): gravity at the nodes, N; drag (n,): N s/m, other
    than 0 at the nodes `dragged`; in_plane (3, 1): 1 on the axes that the scene uses;
    laws: of the strings that are no springs, with memory as stretched from slack; slack: of those with memory, their slack
    branches; dampers: (string, Damping) of those that are not linear;
    breakpoints: per string the ends of its pieces, m; none of a string with memory.
    """

    model: Model
    C: np.ndarray
    C_s: np.ndarray
    C_b: np.ndarray
    M: np.ndarray
    M_inv: np.ndarray
    C_b_M_inv: np.ndarray
    J: np.ndarray
    arms: np.ndarray
    fixed: np.ndarray
    moved: Moved
    motors: Motors
    weight: np.ndarray
    drag: np.ndarray
    dragged: np.ndarray
    in_plane: np.ndarray
    laws: dict
    slack: dict
    dampers: tuple
    breakpoints: tuple


def structure(model: Model) -> Structure:
    """Work out the constant matrices.  Raises InputError for a model that is not class 1 or not well posed."""
    n = len(model.nodes)
    _require_class_1(model)
    C_s, C_b = connectivity(model.strings, n), connectivity(model.bars, n)
    C_r = 0.5 * np.abs(C_b)
    m_p, drag = np.zeros(n), np.zeros(n)
    for where, table in ((m_p, model.point_mass), (drag, model.drag)):
        for node, value in table:
            where[node] = value
    M = mass_matrix(C_b, C_r, model.bar_mass / 12.0, model.bar_mass, m_p)
    free = np.ix_(model.free_nodes, model.free_nodes)
    M_inv = np.zeros((n, n))
    M_inv[free] = np.linalg.inv(M[free])
    J, arms = levers(C_b, model.fixed, model.bar_mass, m_p)

    in_plane = np.zeros((3, 1))
    in_plane[list(model.axes)] = 1.0
    weight = model.g[:, None] * (model.bar_mass.dot(C_r) + m_p)
    curved = laws.curved_laws(model)
    dampers = tuple((j, laws.damping(damper)) for j, damper in enumerate(model.damper) if damper is not None)
    ends = dict.fromkeys(range(len(model.strings)), (0.0,)) | {j: law.breakpoints for j, law in curved.items()}
    return Structure(
        model,
        np.concatenate((C_s, C_b)).T.copy(),
        C_s,
        C_b,
        M,
        M_inv,
        C_b.dot(M_inv),
        J,
        arms,
        model.fixed.astype(float),
        moved_nodes(model, M),
        motors_of(model),
        weight,
        drag,
        np.flatnonzero(drag),
        in_plane,
        curved,
        laws.slack_branches(model),
        dampers,
        tuple(ends.values()),
    )


def _require_class_1(model: Model) -> None:
    """Raises InputError unless the equations apply."""
    bar_of = np.full(len(model.nodes), -1)
    for i, ends in enumerate(model.bars):
        for node in ends:
            if bar_of[node] >= 0:
                raise InputError(f"node {model.node_names[node]!r} belongs to two bars; a class-1 structure allows one")
            bar_of[node] = i
        if model.fixed[ends].all():
            raise InputError(f"bar {model.bar_names[i]!r} has both ends fixed; free one of them")
    massed = {node for node, mass in model.point_mass if mass > 0.0}
    for node in model.free_nodes:
        if bar_of[node] < 0 and node not in massed:
            raise InputError(
                f"free node {model.node_names[node]!r} belongs to no bar and so has no mass; fix it, or give it a point mass"
            )
    for node in model.moving:
        if not model.fixed[node]:
            raise InputError(f"moving names the free node {model.node_names[node]!r}; fix it, or let it move by itself")
    for node, _ in model.drag:
        if model.fixed[node]:
            raise InputError(f"drag names the fixed node {model.node_names[node]!r}; leave it out")
    if model.damping_law not in ("literal", "tension_only"):
        raise InputError(f"damping_law = {model.damping_law!r}: use 'literal' or 'tension_only'")
