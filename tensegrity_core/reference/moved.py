"""Moved nodes: fixed nodes whose position, velocity and acceleration are inputs, as plain equations.

Over a step a moved node is at x + v t + a t^2 / 2.  From one step to the next its inputs may jump.  A bar that is pinned
at the node is carried along by a jump of the position.  A jump dv of the velocity gives it the impulse of the pin on a
rigid bar: with c = tip - base, m c'/3 + m v/2 is kept across the bar (m_p of a point mass at the tip: in both terms), so
that c' changes by -kappa P dv, kappa = (m/2 + m_p) / (m/3 + m_p), P = I - c c^T / |c|^2.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..model import Model


class Moved(NamedTuple):
    """nodes (E,): the moved nodes; select (E, n): 1 at each of them; tips (E,): the other end of the node's bar, -1: none;
    kappa (E,): see above, 0 without a bar."""

    nodes: np.ndarray
    select: np.ndarray
    tips: np.ndarray
    kappa: np.ndarray


def moved_nodes(model: Model, M: np.ndarray) -> Moved:
    """A model's moved nodes.  M: its mass matrix, in which kappa = 1 + M_tip,base / M_tip,tip."""
    nodes = np.array(model.moving, dtype=int)
    tips, kappa = np.full(len(nodes), -1), np.zeros(len(nodes))
    for first, second in model.bars:
        for base, tip in ((first, second), (second, first)):
            tips[nodes == base] = tip
            if M[tip, tip] > 0.0:  # else it is fixed, at the end of a bar without mass
                kappa[nodes == base] = 1.0 + M[tip, base] / M[tip, tip]
    return Moved(nodes, np.eye(len(model.nodes))[nodes], tips, kappa)


def path(position, velocity, acceleration, tau):
    """Position and velocity (3, E) at the time tau (s) after the communication point."""
    return position + tau * (velocity + 0.5 * tau * acceleration), velocity + tau * acceleration


def jumped(moved: Moved, N, Ndot, shift, dv) -> tuple[np.ndarray, np.ndarray]:
    """N, Ndot (3, n) after the moved nodes' positions jumped by shift (3, E) and their velocities by dv (3, E)."""
    after, after_dot = N + shift @ moved.select, Ndot + dv @ moved.select
    for e, (base, tip) in enumerate(zip(moved.nodes, moved.tips)):
        if tip >= 0:
            c = N[:, tip] - N[:, base]
            across = dv[:, e] - c * (c @ dv[:, e]) / (c @ c)
            after[:, tip] += shift[:, e]
            after_dot[:, tip] += dv[:, e] - moved.kappa[e] * across
    return after, after_dot
