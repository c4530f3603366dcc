"""What the reference's equations need of a model, once for all times."""

from __future__ import annotations

from typing import Any

import numpy as np

from .. import laws
from ..errors import InputError
from ..model import Model
from ..model.routes import segments
from .contact import Contacts
from .equations import connectivity, levers, mass_matrix
from .joints import Joints
from .motors import motors_of
from .moved import moved_nodes


class Structure:
    """A model's constant matrices, in the article's notation.  Raises InputError for a model that is not well posed.

    C_s (G, n): of the strings' segments, one each but of routed strings; route (S, G): 1 where a segment is a string's, None
    where none is routed; C (n, G + B): [C_s^T C_b^T]; M (n, n); M_inv (n, n): of the free nodes, see `equations`; J (B,), arms
    (B, n): see `levers`; C_b_M_inv (B, n): C_b M^-1; fixed (n,): 1 at fixed nodes; weight (3, n): gravity at the nodes, N;
    drag (n,): N s/m, other than 0 at the nodes `dragged`; in_plane (3, 1): 1 on the axes that the scene uses;
    laws: of the strings that are no springs, with memory as stretched from slack; slack: of those with memory, their slack
    branches; dampers: (string, Damping) of those that are not linear;
    breakpoints: per string the ends of its pieces, m; none of a string with memory, nor of a spring that pushes, too; two_way
    (S,): 1 of the latter; least: per string the smallest elongation that counts in its energy, m;
    joints: what takes the place of M_inv, J, arms and C_b_M_inv in a model beyond class 1, None in others; held (3, n): 1 at
    fixed coordinates; moved_axes (3, E): 1 at the moved coordinates of the moved nodes;
    contacts: with the ground, None where no node may touch one.
    """

    def __init__(self, model: Model):
        _require_well_posed(model)
        n, self.model = len(model.nodes), model
        parts = segments(model.paths)
        self.C_s, self.C_b = connectivity(parts.ends, n), connectivity(model.bars, n)
        self.route = (np.arange(len(model.strings))[:, None] == parts.string).astype(float) if model.routes else None
        self.C = np.concatenate((self.C_s, self.C_b)).T.copy()
        C_r = 0.5 * np.abs(self.C_b)
        m_p, self.drag = np.zeros(n), np.zeros(n)
        for where, table in ((m_p, model.payload), (self.drag, dict(model.drag))):
            for node, value in table.items():
                where[node] = value
        self.dragged = np.flatnonzero(self.drag)
        self.M = mass_matrix(self.C_b, C_r, model.bar_mass / 12.0, model.bar_mass, m_p)
        carried = m_p.copy()
        for string, *ends, part in model.string_mass_links:  # segments that move like thin bars
            m = part * model.string_mass[string]
            self.M[np.ix_(ends, ends)] += m / 6.0 * np.array([[2.0, 1.0], [1.0, 2.0]])
            carried[ends] += 0.5 * m
        free = np.ix_(model.free_nodes, model.free_nodes)
        self.M_inv = np.zeros((n, n))
        self.joints = Joints(model, self.M, self.C_b) if model.joint else None
        if self.joints is None:
            self.M_inv[free] = np.linalg.inv(self.M[free])
            self.C_b_M_inv = self.C_b.dot(self.M_inv)
            self.J, self.arms = levers(self.C_b, model.fixed, model.bar_mass, m_p)
        self.fixed = model.fixed.astype(float)
        self.held = self.fixed if self.joints is None else self.joints.held
        self.moved, self.motors = moved_nodes(model, self.M), motors_of(model)
        self.moved_axes = model.moved[self.moved.nodes].T.astype(float)
        self.contacts: Any = Contacts(model) if model.contacts else None
        self.in_plane = np.zeros((3, 1))
        self.in_plane[list(model.axes)] = 1.0
        self.weight = model.g[:, None] * (model.bar_mass.dot(C_r) + carried)
        self.laws, self.slack = laws.curved_laws(model), laws.slack_branches(model)
        self.dampers = tuple((j, laws.damping(damper)) for j, damper in enumerate(model.damper) if damper is not None)
        breaks: list[tuple[float, ...]] = [() if two_way else (0.0,) for two_way in model.two_way]
        self.breakpoints = [self.laws[j].breakpoints if j in self.laws else one for j, one in enumerate(breaks)]
        self.two_way = model.two_way.astype(float)
        self.least = np.where(model.two_way, -np.inf, 0.0).tolist()


def _require_well_posed(model: Model) -> None:
    """Raises InputError unless the equations apply."""
    for i, ends in enumerate(model.bars):
        if model.fixed[ends].all() and not model.moved[ends].any():
            raise InputError(f"bar {model.bar_names[i]!r} has both ends fixed; free one of them")
    massed = {node for i, ends in enumerate(model.bars.tolist()) if model.bar_mass[i] > 0.0 for node in ends}
    massed |= {node for node, mass in model.payload.items() if mass > 0.0}
    massed |= {node for _, *ends, _ in model.string_mass_links for node in ends}
    for node in model.free_nodes.tolist():
        if node not in massed:
            name, why = model.node_names[node], "is on bars without mass only" if node in model.bars else "belongs to no bar"
            raise InputError(f"free node {name!r} {why} and so has no mass; fix it, or give it a point mass")
    for node in model.moving:
        if not model.held[node][list(model.axes)][model.moved[node][list(model.axes)]].all():
            raise InputError(f"moving names the free node {model.node_names[node]!r}; fix it, or let it move by itself")
    for node, _ in model.drag:
        if model.fixed[node]:
            raise InputError(f"drag names the fixed node {model.node_names[node]!r}; leave it out")
    if model.damping_law not in ("literal", "tension_only"):
        raise InputError(f"damping_law = {model.damping_law!r}: use 'literal' or 'tension_only'")
