"""Formulas of forces.

A *curve* is a formula: `value(u)` gives force, slope and curvature (N, N/m, N/m2), `energy(u)` the integral of the force from
u = 0 (J), `local(at)` the coefficients of the force in powers of u - at where it is a polynomial.  A formula goes on smoothly
past the ends of the piece that it stands for, since an integrator looks there.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial import polynomial

from .beam import beam_energy


class Curve(Protocol):
    """A force over one displacement: force (N), slope (N/m) and curvature (N/m2) at u (m), and the energy (J) from 0 to u."""

    def value(self, u: float) -> tuple[float, float, float]: ...

    def energy(self, u: float) -> float: ...


class BeamCurve(NamedTuple):
    """Eq. 11."""

    Q: float
    zeta: float
    h: float

    def value(self, u: float) -> tuple[float, float, float]:
        Q, zeta, h = self
        x, a = u / h, 2.0 * (1.0 + zeta)
        force, slope = Q * x * (a + zeta * x * (x - 3.0)), Q / h * (a + 3.0 * zeta * x * (x - 2.0))
        return force, slope, 6.0 * Q * zeta / h**2 * (x - 1.0)

    def energy(self, u: float) -> float:
        return beam_energy(*self, u)

    def local(self, at: float) -> np.ndarray:
        """Coefficients of f in powers of u - at."""
        force, slope, curvature = self.value(at)
        return np.array([force, slope, 0.5 * curvature, self.Q * self.zeta / self.h**3])


class PolynomialCurve(NamedTuple):
    """f = sum of coefficients[i] (u - at)^i.  base: energy at u = at, J."""

    at: float
    coefficients: tuple[float, ...]
    base: float

    def value(self, u: float) -> tuple[float, float, float]:
        s, force, slope, half = u - self.at, 0.0, 0.0, 0.0
        for c in reversed(self.coefficients):
            half = half * s + slope
            slope = slope * s + force
            force = force * s + c
        return force, slope, 2.0 * half

    def energy(self, u: float) -> float:
        s, total = u - self.at, 0.0
        for power in range(len(self.coefficients), 0, -1):
            total = (total + self.coefficients[power - 1] / power) * s
        return self.base + total

    def local(self, at: float) -> np.ndarray:
        """Coefficients of f in powers of u - at."""
        shifted = polynomial.Polynomial(self.coefficients)(polynomial.Polynomial([at - self.at, 1.0]))
        return shifted.coef


class SumCurve(NamedTuple):
    """Curves in parallel."""

    parts: tuple

    def value(self, u: float) -> tuple[float, float, float]:
        force, slope, curvature = zip(*(part.value(u) for part in self.parts))
        return sum(force), sum(slope), sum(curvature)

    def energy(self, u: float) -> float:
        return sum(part.energy(u) for part in self.parts)

    def local(self, at: float) -> np.ndarray | None:
        """Coefficients of f in powers of u - at; None where a part is no polynomial."""
        parts = [part.local(at) if hasattr(part, "local") else None for part in self.parts]
        known = [part for part in parts if part is not None]
        if len(known) < len(parts):
            return None
        return sum((polynomial.Polynomial(part) for part in known), polynomial.Polynomial([0.0])).coef


class HeldCurve(NamedTuple):
    """A part that moves along its own curve while the others of its series are held.

    held: sum of their displacements, m; base: their energy, J.
    """

    part: Curve
    held: float
    base: float

    def value(self, u: float) -> tuple[float, float, float]:
        return self.part.value(u - self.held)

    def energy(self, u: float) -> float:
        return self.base + self.part.energy(u - self.held)
