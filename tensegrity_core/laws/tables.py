"""Curves from tables and polynomials, for elements and dampers."""

from __future__ import annotations

import math

import numpy as np
import scipy

from ..errors import InputError
from ..model.elements import Table
from .curves import PolynomialCurve


def check_coefficients(kind: str, coefficients: tuple[float, ...]) -> None:
    if not 1 <= len(coefficients) <= 7:
        raise InputError(f"{kind}.coefficients has {len(coefficients)} values; give 1 to 7")
    for i, value in enumerate(coefficients, 1):
        if not math.isfinite(value):
            raise InputError(f"{kind}.coefficients[{i}] = {value!r}: must be finite")
    if not any(coefficients):
        raise InputError(f"{kind}.coefficients = {coefficients!r}: are all 0; make one of them positive")


def table_curves(table: Table) -> list[tuple[PolynomialCurve, float, float]]:
    """(curve, start, end) of each interval and of what follows the last point."""
    x, f = table.x, table.f
    if len(x) != len(f) or len(x) < 2:
        raise InputError(f"table: x has {len(x)} points and f {len(f)}; give as many of both, at least two")
    if not (np.isfinite(x).all() and np.isfinite(f).all()):
        raise InputError(f"table: x = {x!r}, f = {f!r}: must be finite")
    if x[0] != 0.0 or f[0] != 0.0 or not (np.diff(x) > 0.0).all():
        raise InputError(f"table: x = {x!r}, f[0] = {f[0]!r}: let x increase from 0, with f[0] = 0")
    if table.interpolation == "cubic":
        rows = scipy.interpolate.PchipInterpolator(x, f).c[::-1].T
    elif table.interpolation == "linear":
        rows = np.column_stack([f[:-1], np.diff(f) / np.diff(x)])
    else:
        raise InputError(f"table.interpolation = {table.interpolation!r}: use 'linear' or 'cubic'")
    found, base = [], 0.0
    for (_, *slopes), a, b, value in zip(rows.tolist(), x, x[1:], f):
        curve = PolynomialCurve(a, (value, *slopes), base)
        found.append((curve, a, b))
        base = curve.energy(b)
    curve, a, b = found[-1]
    if len(rows[0]) == 2 or len(x) == 2:  # straight already
        return [*found[:-1], (curve, a, math.inf)]
    return [*found, (PolynomialCurve(b, (f[-1], curve.value(b)[1]), base), b, math.inf)]
