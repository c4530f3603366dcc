"""Equations of motion that differ in how they keep the bars' lengths, and what becomes of e = |b|^2 - l^2 under each.

`matrix` is the article's eq. 1 with its two errata mended (see tensegrity_core/reference/equations.py).  As printed, the
nominal l_i^2 stands in lambda; exact: |b_i|^2 of the state does.  `pinned` is the same physics per bar that is fixed at one
end,
    b'' = (3/m) (I - b b^T / l^2) f - (|b'|^2 / l^2) b,   f: all forces at the tip.
With the nominal l both give e'' = rate^2 e, with
    matrix: rate^2 = -(2 |b'|^2 + (12/m) b^T (f2 - f1)) / l^2,  f1, f2 the forces at the ends with the ground's
    pinned: rate^2 = -(2 |b'|^2 + (6/m) b^T f) / l^2
so under a compression P at rest e grows at sqrt(24 P / (m l)) and sqrt(6 P / (m l)), and in tension it oscillates.  With
|b|^2 in place of l^2 both give e'' = 0.

Plain strings only; slack strings carry nothing; nothing is located: a step may cross a transition, as the article's do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tensegrity_core.errors import InputError
from tensegrity_core.model import Model
from tensegrity_core.reference import equations, instant, structure
from tensegrity_core.reference.equations import diagonal


class Problem(NamedTuple):
    """A model under constant forces: its constant matrices, all forces on the nodes but the strings' (3, n) N, the tips
    of its bars (B,) and the sign of C_b there (0 and 0 where a bar is not pinned).

    J (B,), M_inv (n, n): m / 12 and M^-1 of bars that are all free, for the matrix form with forces of the ground.
    """

    s: structure.Structure
    W: np.ndarray
    tip: np.ndarray
    sign: np.ndarray
    J: np.ndarray
    M_inv: np.ndarray


def problem(model: Model, force=None) -> Problem:
    """force: (N, 3) N on the nodes.  Raises InputError for a model with an NSH."""
    if model.nsh_strings:
        raise InputError(f"string {model.string_names[model.nsh_strings[0]]!r} has an NSH; use a scene with plain strings")
    s = structure.Structure(model)
    applied = np.zeros((3, len(model.nodes))) if force is None else np.asarray(force, dtype=float).T * s.in_plane
    pinned = model.fixed[model.bars].any(axis=1)
    free_end = np.where(model.fixed[model.bars[:, 0]], 1, 0)
    tip = np.where(pinned, model.bars[np.arange(len(model.bars)), free_end], 0)
    ends = np.ix_(model.bars.ravel(), model.bars.ravel())
    M_inv = np.zeros_like(s.M)
    M_inv[ends] = np.linalg.inv(s.M[ends])
    return Problem(s, applied + s.weight, tip, np.where(pinned, 2.0 * free_end - 1.0, 0.0), model.bar_mass / 12.0, M_inv)


def string_forces(p: Problem, N, Ndot) -> np.ndarray:
    """(3, n) N: W - S (gamma + eta) C_s, everything on the nodes but the ground's forces."""
    model = p.s.model
    S, xi, rate = equations.string_motion(N, Ndot, p.s.C_s)
    stretch = xi - model.rest_length
    taut = (stretch > 0.0).astype(float)
    elastic = equations.elastic_tension(stretch, taut * model.stiffness)
    density = (elastic + equations.damping_tension(rate, taut * model.damping)) / xi
    return p.W - (S * density) @ p.s.C_s


def _ground(p: Problem, B, lam, F, l2):
    """Forces of the ground (3, n) N that leave the fixed nodes at rest, for any l^2 in lambda.

    lam, F: lambda and nodal forces without the ground's; they leave an acceleration a at a fixed node.  Through W and through
    lambda, a force c there changes it by A c, A = p I - q b b^T / l^2, where b is the node's bar, p = (M^-1)_gg and
    q = (C_b M^-1)_bg C_b,bg / 2; so c = -A^-1 a, A^-1 = (I + q / (p l^2 - q |b|^2) b b^T) / p (Sherman and Morrison's formula).
    """
    M_inv, C_b = p.M_inv, p.s.C_b
    pins = np.flatnonzero(p.s.model.fixed & np.any(C_b, axis=0))
    bars = np.argmax(np.abs(C_b[:, pins]), axis=0)
    a = F @ M_inv[:, pins] + (B * lam) @ (C_b @ M_inv)[:, pins]
    b, l2, p_g = B[:, bars], np.broadcast_to(l2, (len(C_b),))[bars], M_inv[pins, pins]
    q = 0.5 * C_b[bars, pins] * (C_b @ M_inv)[bars, pins]
    ground = -F * (p.s.model.fixed & ~np.any(C_b, axis=0))
    ground[:, pins] -= (a + b * (q * diagonal(b, a) / (p_g * l2 - q * diagonal(b, b)))) / p_g
    return ground


def matrix(p: Problem, N, Ndot, exact: bool):
    """Accelerations (3, n) and the squared rate of e per bar (B,), 1/s2, under the article's matrix form."""
    s, model = p.s, p.s.model
    F = string_forces(p, N, Ndot)
    B, Bdot = N @ s.C_b.T, Ndot @ s.C_b.T
    l2 = diagonal(B, B) if exact else model.bar_length**2
    speed2 = diagonal(Bdot, Bdot)

    def force_density(F):
        return (diagonal(B, F @ s.C_b.T) * -0.5 - p.J * speed2) / l2

    F = F + _ground(p, B, force_density(F), F, l2)
    lam = force_density(F)
    acceleration = (F + (B * lam) @ s.C_b) @ p.M_inv
    return acceleration, -(2.0 * speed2 + diagonal(B, F @ s.C_b.T) / p.J) / model.bar_length**2


def pinned(p: Problem, N, Ndot, exact: bool):
    """Accelerations (3, n) and the squared rate of e per bar (B,), 1/s2, bar by bar.  All bars must be pinned."""
    s, model = p.s, p.s.model
    f = string_forces(p, N, Ndot)[:, p.tip]
    b, bdot = (N @ s.C_b.T) * p.sign, (Ndot @ s.C_b.T) * p.sign
    l2 = diagonal(b, b) if exact else model.bar_length**2
    along, speed2, inverse = diagonal(b, f), diagonal(bdot, bdot), 3.0 / model.bar_mass
    acceleration = np.zeros_like(N)
    acceleration[:, p.tip] = inverse * f - b * ((inverse * along + speed2) / l2)
    return acceleration, -(2.0 * speed2 + 2.0 * inverse * along) / model.bar_length**2


FORMS = {"matrix": matrix, "pinned": pinned}
#: Factor c in rate = sqrt(c P / (m l)).
FACTOR = {"matrix": 24.0, "pinned": 6.0}


def growth_rate(form: str, compression, mass, length):
    """1/s: rate of e at rest under a compression (N); the angular frequency of its oscillation, times 1j, in tension."""
    rate2 = FACTOR[form] * np.asarray(compression, dtype=complex) / (np.asarray(mass) * np.asarray(length))
    return np.sqrt(rate2)


@dataclass
class Motion:
    """First order form of one formulation on one problem: state y = [x, x'] of the free nodes' coordinates.

    with_theory: append e and e' per bar as the theory of `matrix` and `pinned` has them along this very motion.
    """

    p: Problem
    form: str
    exact: bool
    with_theory: bool = False

    def __post_init__(self):
        if self.form == "pinned" and not self.p.sign.all():
            name = self.p.s.model.bar_names[int(np.argmin(np.abs(self.p.sign)))]
            raise InputError(f"bar {name!r} is not fixed at one end; use the form 'matrix'")
        model = self.p.s.model
        self.free, self.size = model.free_nodes, 3 * len(model.free_nodes)
        self.fixed = np.where(model.fixed, model.nodes.T, 0.0)

    def unpack(self, y):
        """N, Ndot (3, n)."""
        N, Ndot = self.fixed.copy(), np.zeros_like(self.fixed)
        N[:, self.free] = y[: self.size].reshape(3, -1)
        Ndot[:, self.free] = y[self.size : 2 * self.size].reshape(3, -1)
        return N, Ndot

    def pack(self, N, Ndot, theory=()):
        return np.concatenate((N[:, self.free].ravel(), Ndot[:, self.free].ravel(), theory))

    def start(self, error: float = 0.0, error_rate: float = 0.0) -> np.ndarray:
        """The model's start with e = error l^2 and e' = error_rate l^2 (1/s) on every bar, nodes moved along the bars."""
        model, s = self.p.s.model, self.p.s
        N = model.nodes.T
        B = N @ s.C_b.T
        stretch = np.sqrt(1.0 + error)
        N = N + (B * (stretch - 1.0)) @ s.arms
        Ndot = model.velocity.T + (B * (0.5 * error_rate / stretch)) @ s.arms
        theory = np.tile([error, error_rate], (2, len(model.bars), 1)).ravel() if self.with_theory else ()
        return self.pack(N, Ndot, theory)

    def __call__(self, t, y):
        N, Ndot = self.unpack(y)
        acceleration, rate2 = FORMS[self.form](self.p, N, Ndot, self.exact)
        theory = ()
        if self.with_theory:
            other = "pinned" if self.form == "matrix" else "matrix"
            rates = {self.form: rate2, other: FORMS[other](self.p, N, Ndot, self.exact)[1]}
            e = y[2 * self.size :].reshape(2, -1, 2)
            theory = np.stack((e[..., 1], [rates["matrix"], rates["pinned"]] * e[..., 0]), axis=-1).ravel()
        return self.pack(Ndot, acceleration, theory)

    def error(self, y) -> np.ndarray:
        """(B,) relative error of the bars' squared lengths, e / l^2."""
        N, _ = self.unpack(y)
        B = N @ self.p.s.C_b.T
        return diagonal(B, B) / self.p.s.model.bar_length**2 - 1.0

    def theory(self, y) -> dict[str, np.ndarray]:
        """Form -> (B,) e / l^2 that the theory expects of it."""
        return dict(zip(("matrix", "pinned"), y[2 * self.size :].reshape(2, -1, 2)[..., 0]))

    def projected(self, y):
        """y with |b| = l and b . b' = 0."""
        return self.pack(*instant.on_constraints(self.p.s, *self.unpack(y)), y[2 * self.size :])
