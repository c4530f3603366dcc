"""Small motions about an equilibrium: frequencies, damping, decay rates and shapes.

Along r orthonormal directions y that keep the bars' lengths, small motions obey

    M y'' + C y' + K y = 0,

M from the bars (a thin rigid bar of mass m gives m/3 to each end and m/6 to the pair), point masses and strings' masses,
C = sum d u u^T over the taut strings, u the slope of a string's length (plus or minus its direction, at its ends), d a damper's
slope at rest, and the nodes' drag, K the tangent stiffness with its geometric part.  Actuators hold their strings' rest
lengths: their drums stand still, as in statics.  Solutions y = phi exp(lambda t) are eigenvectors of

    [0 1; -M^-1 K -M^-1 C]   (Tisseur and Meerbergen, "The quadratic eigenvalue problem", 2001, section 3.4).

A complex pair lambda = -zeta w +- i w sqrt(1 - zeta^2) oscillates; its shape is complex where dampers are not proportional
to mass and stiffness: parts of the structure move out of phase.  A real lambda decays without oscillation (or grows, where the
equilibrium is unstable); an overdamped direction has two of them.

Neutral directions, which K does not resist (rigid-body motions, mechanisms of slack strings), are found first, by the rank of
K: their lambda = 0 is exact, and the rest is solved without them.  With N their basis and y = N a + Z b they obey a'' = 0 where
dampers leave them alone too; else, with drag, b' = Z^T v and v' = -K Z b - C v (unit masses) has the other eigenvalues: those
of the rates at which the drag stops them among these.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .. import statics
from ..errors import InputError
from ..laws.dampers import slopes_at_rest
from ..model import Model
from ..statics import NEUTRAL

SPLIT = 1e-9  # of an eigenvalue: imaginary parts below are round-off


class Mode(NamedTuple):
    """eigenvalue: lambda, 1/s, with an imaginary part >= 0; shape: (N, 3) complex, its largest component 1; neutral: what a
    direction is that nothing resists, such as 'rotation about z' of a structure afloat, else ''."""

    eigenvalue: complex
    shape: np.ndarray
    neutral: str = ""

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
    statics.require_small(model, "finding its modes")
    if model.ground is not None:
        raise InputError(f"{model.name}: it stands on the ground, which modes do not know yet; leave [ground] out")
    point = statics.Surface(model, force, _Plain).at(statics.free_rows(model, model.nodes))
    taut = (model.string_lengths(model.nodes) > model.rest_length) | model.two_way
    growth = -statics.equilibrium_matrix(model)[:, : len(taut)].T @ point.basis
    damping = (growth.T * np.where(taut, slopes_at_rest(model), 0.0)) @ growth
    drag = _at_nodes(model, dict(model.drag))
    damping += (point.basis.T * drag) @ point.basis
    mass = point.basis.T @ mass_matrix(model) @ point.basis
    stiffness = point.tangent.matrix
    return Matrices(mass, damping, 0.5 * (stiffness + stiffness.T), point.basis)


class _Plain:
    """A tangent stiffness as it is."""

    assembled: type[statics.Dense] = statics.Dense

    def __init__(self, matrix: np.ndarray):
        self.matrix = matrix


def _at_nodes(model: Model, values: dict[int, float]) -> np.ndarray:
    """(n,): what some nodes have, at the free coordinates."""
    field = np.zeros(len(model.nodes))
    field[list(values)] = list(values.values())
    return statics.free_rows(model, np.repeat(field[:, None], 3, axis=1))


def mass_matrix(model: Model) -> np.ndarray:
    """(n, n) kg, of the free coordinates: consistent mass of thin rigid bars and, where asked for, of strings' segments, point
    masses, and what strings have at their nodes; fixed nodes left out."""
    place, links = statics.places(model), model.string_mass_links
    thin = np.vstack((model.bars, np.array([ends for _, *ends, _ in links], dtype=int).reshape(-1, 2)))
    mass = np.append(model.bar_mass, [part * model.string_mass[string] for string, _, _, part in links])
    first, second = np.moveaxis(place[thin], 1, 0)  # (B, D) each
    rows, columns = np.stack([first, first, second, second]), np.stack([first, second, first, second])
    share = (mass / np.array([[3.0], [6.0], [6.0], [3.0]]))[:, :, None]
    n = statics.freedoms(model)
    full = statics.Dense(rows, columns, (n, n))(np.broadcast_to(share, rows.shape))
    return full + np.diag(_at_nodes(model, model.payload))


def modes(model: Model, force=None, damped: bool = True) -> list[Mode]:
    """Modes about the model's start under external forces (N, 3), N; complex pairs once.  Neutral directions, rigid-body
    motions first, come before all others, with lambda = 0 and their name; then what grows, or lives longest (rising decay rate,
    then rising |lambda|).

    The start is meant to be an equilibrium under these forces (statics.settle makes it one).  damped: False leaves out the
    dampers.  Raises TooLarge.
    """
    found = matrices(model, force)
    if not len(found.mass):
        return []
    lower = np.linalg.cholesky(found.mass)
    inverse = np.linalg.inv(lower)
    stiffness = inverse @ found.stiffness @ inverse.T
    damping = inverse @ found.damping @ inverse.T * float(damped)
    neutral = statics.null_space(found.stiffness, NEUTRAL)
    loose = neutral @ statics.null_space(found.damping @ neutral * float(damped), NEUTRAL, np.abs(found.damping).max())
    values, vectors = _eigenpairs(stiffness, damping, lower.T @ neutral, lower.T @ loose)
    shapes = found.basis @ inverse.T @ vectors
    order = np.lexsort((np.abs(values), -values.real))
    named = [Mode(0j, _shape(model, field), name) for name, field in _named(model, found.basis @ neutral)]
    return named + [Mode(complex(values[i]), _shape(model, shapes[:, i])) for i in order]


def free_motions(model: Model) -> int:
    """How many independent motions keep the bars' lengths and what is fixed."""
    if not model.joint:
        return statics.freedoms(model) - len(model.bars)
    balance = statics.balance_of(model)
    return balance.basis(balance.shape(statics.free_rows(model, model.nodes))).shape[1]


def seconds(model: Model, damped: bool = True) -> float:
    """How long `modes` takes, about."""
    freedom = max(0, statics.freedoms(model) - len(model.bars))
    return (4e-9 if damped else 4e-10) * freedom**3


def _complement(directions: np.ndarray) -> np.ndarray:
    """(r, r - k): orthonormal, across the independent directions (r, k)."""
    return np.linalg.qr(directions, mode="complete")[0][:, directions.shape[1] :]


def _eigenpairs(stiffness, damping, neutral, loose) -> tuple[np.ndarray, np.ndarray]:
    """lambda with imaginary part >= 0, and phi (r, modes), of unit masses; without the zeros of neutral directions (r, k),
    which the stiffness leaves alone, and of loose ones (r, l) among them, which the damping leaves alone too."""
    rest = _complement(loose)
    stiffness, damping, neutral = rest.T @ stiffness @ rest, rest.T @ damping @ rest, rest.T @ neutral
    dragged = np.linalg.svd(neutral, full_matrices=False)[0][:, : neutral.shape[1] - loose.shape[1]]
    if not damping.any():  # symmetric: exact pairs
        squares, vectors = np.linalg.eigh(stiffness)
        oscillating = np.where(squares >= 0.0, 1j * np.sqrt(np.abs(squares)), np.sqrt(np.abs(squares)))
        growing = squares < 0.0
        vectors = rest @ np.hstack([vectors, vectors[:, growing]]).astype(complex)
        return np.append(oscillating, -oscillating[growing]), vectors
    resisted = _complement(dragged)
    k = resisted.shape[1]
    values, vectors = np.linalg.eig(np.block([[np.zeros((k, k)), resisted.T], [-stiffness @ resisted, -damping]]))
    values, vectors = _real_where_equal(values.astype(complex), vectors[k:].astype(complex))
    kept = values.imag >= 0.0
    return values[kept], rest @ vectors[:, kept]


def _real_where_equal(values: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Equal real eigenvalues, which round-off parts into a pair with hardly an imaginary part, as the real ones they are."""
    values, vectors = values.copy(), vectors.copy()
    hardly = (values.imag != 0.0) & (np.abs(values.imag) <= SPLIT * np.abs(values))
    for i in np.flatnonzero(hardly):  # of a pair, with vectors a + i b and a - i b: a and b
        one = vectors[:, i].real if values[i].imag > 0.0 else vectors[:, i].imag
        vectors[:, i] = one if np.linalg.norm(one) > SPLIT * np.linalg.norm(vectors[:, i]) else vectors[:, i].real
        values[i] = values[i].real
    return values, vectors


def _named(model: Model, neutral: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Names and free coordinates of neutral directions (n, k): the rigid-body motions among them, then the others."""
    if not neutral.shape[1]:
        return []
    fields = {name: statics.free_rows(model, field) for name, field in statics.rigid_fields(model).items()}
    rigid = neutral @ _aligned(neutral, statics.rigid_body_motions(model))
    found: list[tuple[str, np.ndarray]] = []
    known = np.zeros((len(neutral), 0))

    def add(name: str, field: np.ndarray) -> None:
        nonlocal known
        beyond = field - known @ (known.T @ field)
        if np.linalg.norm(beyond) > 1e-6 * max(float(np.linalg.norm(field)), 1e-6):
            known = np.column_stack([known, beyond / np.linalg.norm(beyond)])
            found.append((name, field))

    for name, field in fields.items():
        if np.linalg.norm(field - rigid @ (rigid.T @ field)) <= 1e-6 * np.linalg.norm(field):
            add(name, field)
    for field in rigid.T:
        add("rigid-body motion", field)
    for field in neutral.T:
        if len(found) < neutral.shape[1]:
            add("mechanism without stiffness", field)
    return found


def _aligned(neutral: np.ndarray, motions: np.ndarray) -> np.ndarray:
    """(k, m): combinations of orthonormal directions (n, k) that are combinations of orthonormal motions, too."""
    left, cosines, _ = np.linalg.svd(neutral.T @ motions, full_matrices=False)
    return left[:, cosines > 1.0 - 1e-6]


def _shape(model: Model, free: np.ndarray) -> np.ndarray:
    """(N, 3): free coordinates' motion, its largest component made 1."""
    return statics.in_space(model, free / free[np.argmax(np.abs(free))])
