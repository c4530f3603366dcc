"""Small motions about an equilibrium: frequencies, damping, decay rates and shapes.

Along r orthonormal directions y that keep the bars' lengths, small motions obey

    M y'' + C y' + K y = 0,

M from the bars (a thin rigid bar of mass m gives m/3 to each end and m/6 to the pair) and point masses, C = sum d u u^T over
the taut strings with direction u, d a damper's slope at rest, and the nodes' drag, K the tangent stiffness with its geometric
part.  Actuators hold their strings' rest lengths: their drums stand still, as in statics.  Solutions y = phi exp(lambda t)
are eigenvectors of

    [0 1; -M^-1 K -M^-1 C]   (Tisseur and Meerbergen, "The quadratic eigenvalue problem", 2001, section 3.4).

A complex pair lambda = -zeta w +- i w sqrt(1 - zeta^2) oscillates; its shape is complex where dampers are not proportional
to mass and stiffness: parts of the structure move out of phase.  A real lambda decays without oscillation (or grows, where the
equilibrium is unstable); an overdamped direction has two of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from . import laws, statics
from .model import Model
from .statics import NEUTRAL


class Mode(NamedTuple):
    """eigenvalue: lambda, 1/s, with an imaginary part >= 0; shape: (N, 3) complex, its largest component 1."""

    eigenvalue: complex
    shape: np.ndarray

    @property
    def oscillates(self) -> bool:
        return self.eigenvalue.imag != 0.0

    @property
    def frequency(self) -> float:
        """Hz, as seen with the damping; 0 where nothing oscillates."""
        return self.eigenvalue.imag / (2.0 * np.pi)

    @property
    def natural_frequency(self) -> float:
        """Hz: |lambda| / 2 pi, which the damping leaves alone where it is proportional."""
        return abs(self.eigenvalue) / (2.0 * np.pi)

    @property
    def decay_rate(self) -> float:
        """1/s: amplitudes fall as exp(-decay_rate t); negative where they grow."""
        return -self.eigenvalue.real

    @property
    def damping_ratio(self) -> float:
        """zeta; 1 and -1 where nothing oscillates."""
        size = abs(self.eigenvalue)
        return self.decay_rate / size if size else 0.0


class Matrices(NamedTuple):
    """mass (kg), damping (N s/m), stiffness (N/m): (r, r) along the columns of basis (n, r), n free coordinates."""

    mass: np.ndarray
    damping: np.ndarray
    stiffness: np.ndarray
    basis: np.ndarray


def matrices(model: Model, force=None) -> Matrices:
    """M, C and K at the model's start under external forces (N, 3), N; strings with memory as stretched from slack.

    Raises TooLarge: they are dense.
    """
    statics._require_small(model, "finding its modes")
    point = statics._Surface(model, force, _Plain).at(model.nodes)
    strings = model.strings
    length = np.linalg.norm(model.nodes[strings[:, 1]] - model.nodes[strings[:, 0]], axis=1)
    growth = -statics.equilibrium_matrix(model)[:, : len(strings)].T @ point.basis
    damping = (growth.T * np.where(length > model.rest_length, _dampers(model), 0.0)) @ growth
    drag = _at_nodes(model, dict(model.drag))
    damping += (point.basis.T * drag) @ point.basis
    mass = point.basis.T @ mass_matrix(model) @ point.basis
    stiffness = point.tangent.matrix
    return Matrices(mass, damping, 0.5 * (stiffness + stiffness.T), point.basis)


class _Plain:
    """A tangent stiffness as it is."""

    assembled = staticmethod(statics._dense)

    def __init__(self, matrix: np.ndarray):
        self.matrix = matrix


def _dampers(model: Model) -> np.ndarray:
    """(S,) N s/m: slopes of the strings' damping tensions at rest."""
    return np.array([d if law is None else laws.damping(law).slope(0.0) for d, law in zip(model.damping, model.damper)])


def _at_nodes(model: Model, values: dict[int, float]) -> np.ndarray:
    """(n,): what some nodes have, at the free coordinates."""
    field = np.zeros(len(model.nodes))
    field[list(values)] = list(values.values())
    return np.repeat(field[model.free_nodes], len(model.axes))


def mass_matrix(model: Model) -> np.ndarray:
    """(n, n) kg, of the free coordinates: consistent mass of thin rigid bars, and point masses; fixed nodes left out."""
    place = statics.places(model)
    ends = place[model.bars]  # (B, 2, D)
    rows, columns, values = [], [], []
    for i in range(2):
        for j in range(2):
            share = model.bar_mass[:, None] / (3.0 if i == j else 6.0)
            rows.append(ends[:, i].ravel())
            columns.append(ends[:, j].ravel())
            values.append(np.broadcast_to(share, ends[:, i].shape).ravel())
    n = len(model.free_nodes) * len(model.axes)
    full = statics._dense(np.concatenate(rows), np.concatenate(columns), np.concatenate(values), (n, n))
    full[np.diag_indices(n)] += _at_nodes(model, dict(model.point_mass))
    return full


def modes(model: Model, force=None, damped: bool = True) -> list[Mode]:
    """Modes about the model's start under external forces (N, 3), N; complex pairs once.  What grows, or lives longest,
    comes first (rising decay rate, then rising |lambda|).

    The start is meant to be an equilibrium under these forces (statics.settle makes it one).  damped: False leaves out the
    dampers.  Directions that nothing resists, such as the rigid-body motions of a structure afloat, have lambda = 0.
    Raises TooLarge.
    """
    found = matrices(model, force)
    if not len(found.mass):
        return []
    lower = np.linalg.cholesky(found.mass)
    inverse = np.linalg.inv(lower)
    stiffness = inverse @ found.stiffness @ inverse.T
    damping = inverse @ found.damping @ inverse.T * float(damped)
    values, vectors = _eigenpairs(stiffness, damping)
    shapes = found.basis @ inverse.T @ vectors
    order = np.lexsort((np.abs(values), -values.real))
    return [Mode(complex(values[i]), _shape(model, shapes[:, i])) for i in order]


def _eigenpairs(stiffness: np.ndarray, damping: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """lambda with imaginary part >= 0, and phi (r, modes), of unit masses."""
    if not damping.any():  # symmetric: exact pairs
        squares, vectors = np.linalg.eigh(stiffness)
        squares = np.where(np.abs(squares) <= NEUTRAL * np.abs(squares).max(), 0.0, squares)
        oscillating = np.where(squares >= 0.0, 1j * np.sqrt(np.abs(squares)), np.sqrt(np.abs(squares)))
        growing = squares < 0.0
        return np.append(oscillating, -oscillating[growing]), np.hstack([vectors, vectors[:, growing]]).astype(complex)
    r = len(stiffness)
    values, vectors = np.linalg.eig(np.block([[np.zeros((r, r)), np.eye(r)], [-stiffness, -damping]]))
    kept = values.imag >= 0.0
    return values[kept].astype(complex), vectors[:r, kept].astype(complex)


def _shape(model: Model, free: np.ndarray) -> np.ndarray:
    """(N, 3): free coordinates' motion, its largest component made 1."""
    shape = np.zeros(model.nodes.shape, dtype=complex)
    shape[np.ix_(model.free_nodes, model.axes)] = (free / free[np.argmax(np.abs(free))]).reshape(-1, len(model.axes))
    return shape
