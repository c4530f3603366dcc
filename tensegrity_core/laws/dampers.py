"""Damping laws: force over the rate of elongation."""

from __future__ import annotations

import math
from bisect import bisect_left
from functools import lru_cache

import numpy as np

from ..errors import InputError
from ..model import Model
from ..model.elements import Damper, Polynomial
from ..quantities import number
from .curves import PolynomialCurve
from .pieces import monotone
from .tables import check_coefficients, table_curves


class Damping:
    """A damper's force over the rate of elongation, eq. 10; odd.  kinks: m/s, rates > 0 at which the slope jumps."""

    def __init__(self, curves: list[tuple[PolynomialCurve, float, float]], smooth: bool):
        self._curves = [curve for curve, _, _ in curves]
        self._ends = [end for _, _, end in curves[:-1]]
        self.kinks = () if smooth else tuple(end for end in self._ends if end < math.inf)

    def force(self, rate: float) -> float:
        """N at a rate (m/s)."""
        rate = number("rate", rate)
        return math.copysign(self._at(rate)[0], rate) if rate else 0.0

    def slope(self, rate: float) -> float:
        """df/drate, N s/m."""
        return self._at(number("rate", rate))[1]

    def _at(self, rate: float) -> tuple[float, float, float]:
        size = abs(rate)
        return self._curves[bisect_left(self._ends, size)].value(size)


def slopes_at_rest(model: Model) -> np.ndarray:
    """(S,) N s/m: slopes of the strings' damping laws at rest."""
    return np.array([d if law is None else damping(law).slope(0.0) for d, law in zip(model.damping.tolist(), model.damper)])


@lru_cache(maxsize=256)
def damping(damper: Damper) -> Damping:
    """The law of a damper.  Raises InputError where a parameter is out of range or the damper would push energy in."""
    if isinstance(damper, Polynomial):
        check_coefficients("damper", damper.coefficients)
        curve = PolynomialCurve(0.0, (0.0, *damper.coefficients), 0.0)
        curves, pieces = [(curve, 0.0, math.inf)], monotone(curve, 0.0, math.inf)
        lowest = [(one.first, one.start) if one.sign >= 0 else (one.last, one.end) for one in pieces]
    else:
        curves = table_curves(damper)
        falls = curves[-1][0].value(damper.x[-1])[1] < 0.0
        lowest = [*zip(damper.f, damper.x), (-math.inf if falls else 0.0, math.inf)]
    for low, at in lowest:
        if low < 0.0:
            raise InputError(
                f"damper: the force falls to {low!r} N at a rate of {at!r} m/s, where it would drive the string; "
                "keep it at 0 or above for rates > 0"
            )
    return Damping(curves, isinstance(damper, Polynomial) or damper.interpolation == "cubic")
