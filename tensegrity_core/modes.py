"""Small motions about an equilibrium: frequencies, damping, decay rates and shapes.

Along r orthonormal directions y that keep the bars' lengths, small motions obey

    M y'' + C y' + K y = 0,

M from the bars (a thin rigid bar of mass m gives m/3 to each end and m/6 to the pair), C = sum d u u^T over the taut
strings with direction u, K the tangent stiffness with its geometric part.  Solutions y = phi exp(lambda t) are eigenvectors of

    [0 1; -M^-1 K -M^-1 C]   (Tisseur and Meerbergen, "The quadratic eigenvalue problem", 2001, section 3.4).

A complex pair lambda = -zeta w +- i w sqrt(1 - zeta^2) oscillates; its shape is complex where dampers are not proportional
to mass and stiffness: parts of the structure move out of phase.  A real lambda decays without oscillation (or grows, where the
equilibrium is unstable); an overdamped direction has two of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .equilibrium import Equations, Loading
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
    """M, C and K at the model's start under external forces (N, 3), N.  Raises TooLarge: they are dense."""
    equations = Equations(Loading(model, force=force))
    free = equations.free(model.nodes)
    piece = equations.laws.piece_of(equations.stretch(free, 0.0))
    tangent = equations.at(free, 0.0, piece)
    growth = tangent.growth @ tangent.basis
    damping = (growth.T * np.where(piece > 0, model.damping, 0.0)) @ growth
    mass = tangent.basis.T @ mass_matrix(model, equations) @ tangent.basis
    return Matrices(mass, damping, 0.5 * (tangent.stiffness + tangent.stiffness.T), tangent.basis)


def mass_matrix(model: Model, equations: Equations) -> np.ndarray:
    """(n, n) kg, of the free coordinates: consistent mass of thin rigid bars; fixed nodes left out."""
    full = np.zeros((equations.size + 1, equations.size + 1))  # the last row and column take fixed nodes
    ends = equations.place[model.bars]  # (B, 2, D)
    for i in range(2):
        for j in range(2):
            share = model.bar_mass[:, None] / (3.0 if i == j else 6.0)
            np.add.at(full, (ends[:, i], ends[:, j]), np.broadcast_to(share, ends[:, i].shape))
    return full[:-1, :-1]


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
