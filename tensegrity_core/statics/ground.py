"""The ground in statics: it presses on a node that is delta deep with k_n delta, and bristles are at zero, so without friction.

Its potential energy is the sum of k_n delta^2 / 2 over the nodes that touch it, delta > 0; that has a continuous slope, so that
settling finds which nodes bear by itself.
"""

from __future__ import annotations

import numpy as np
import scipy

from ..model import Model


def depths(model: Model, nodes: np.ndarray) -> np.ndarray:
    """(K,) m: how deep the nodes (N, 3) of the contacts are in the ground, negative above it."""
    touching = [contact.node for contact in model.contacts]
    if model.ground is None or not touching:
        return np.zeros(0)
    return -(nodes[touching] - np.array(model.ground.point)) @ np.array(model.ground.normal)


def pressures(model: Model, nodes: np.ndarray) -> np.ndarray:
    """(K,) N >= 0."""
    return stiffnesses(model) * np.maximum(depths(model, nodes), 0.0)


def stiffnesses(model: Model) -> np.ndarray:
    """(K,) N/m."""
    return np.array([contact.stiffness for contact in model.contacts])


def ground_loads(model: Model, nodes: np.ndarray) -> np.ndarray:
    """(N, 3) N: what the ground presses with."""
    found = np.zeros((len(model.nodes), 3))
    if model.ground is not None:
        for contact, pressure in zip(model.contacts, pressures(model, nodes)):
            found[contact.node] = pressure * np.array(model.ground.normal)
    return found


def ground_energy(model: Model, nodes: np.ndarray) -> float:
    """J."""
    return float(0.5 * np.sum(stiffnesses(model) * np.maximum(depths(model, nodes), 0.0) ** 2))


def ground_stiffness(model: Model, nodes: np.ndarray, place: np.ndarray) -> scipy.sparse.csc_array:
    """(n, n) N/m: k_n n n^T at each node that touches.  place: (N, D), of the free coordinates, -1 where there is none."""
    normal = np.array(model.ground.normal if model.ground else (0.0, 0.0, 0.0))[list(model.axes)]
    rows, columns, values, size = [], [], [], len(model.free_coordinates)
    for contact, depth in zip(model.contacts, depths(model, nodes)):
        own = place[contact.node]
        for i, row in enumerate(own):
            for j, column in enumerate(own):
                if depth > 0.0 and row >= 0 and column >= 0:
                    rows.append(row)
                    columns.append(column)
                    values.append(contact.stiffness * normal[i] * normal[j])
    return scipy.sparse.coo_array((values, (rows, columns)), (size, size)).tocsc()
