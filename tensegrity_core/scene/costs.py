"""About how long it takes to work out a force law, in Python and in the kernel: what a scene may ask for is bounded by it.

Measured on one core of a few years' age; right to within a factor of about 5.
"""

from __future__ import annotations

from itertools import pairwise

from ..model.elements import Beam, Element, Parallel, Polynomial, Series, Spring, Table

#: Values of its parts that one value of a series takes, by Newton's method.
STEPS = 8
#: s per value.
VALUE = 2e-5


def seconds(element: Element) -> float:
    """s: pieces of the law times the values of leaves that one of its values takes; of a series with memory its branches,
    too."""
    branches = 1.3e-4 * snapping(element) ** 4 if isinstance(element, Series) and element.law == "hysteretic" else 0.0
    return VALUE * _pieces(element) * _values(element) + branches


def honeycomb(beams: int, law: str) -> float:
    """s, of so many beams in series."""
    if law == "hysteretic":
        return 1.3e-4 * beams**4
    return 5e-3 * beams**2 if beams <= 8 else 1.4e-5 * beams**3 + 5e-5 * beams**2


def snapping(element: Element) -> int:
    """Parts that may snap: beams with a maximum, polynomials and tables that fall."""
    if isinstance(element, (Series, Parallel)):
        return sum(snapping(part) for part in element.parts)
    if isinstance(element, Beam):
        return int(element.zeta > 2.0)
    if isinstance(element, Polynomial):
        return int(min(element.coefficients, default=0.0) < 0.0)
    if isinstance(element, Table):
        slopes = [b - a for a, b in zip(element.f, element.f[1:])]
        return sum(before >= 0.0 > after for before, after in pairwise(slopes))
    return 0


def _values(element: Element) -> float:
    if isinstance(element, (Series, Parallel)):
        return (STEPS if isinstance(element, Series) else 1) * sum(_values(part) for part in element.parts)
    return 1.0


def _pieces(element: Element) -> float:
    if isinstance(element, (Series, Parallel)):
        each = 1.5 if isinstance(element, Series) else 1.0
        return 1.0 + each * sum(_pieces(part) - 1.0 for part in element.parts)
    if isinstance(element, Table):
        return 1.0 + 0.1 * len(element.x) + 2.0 * snapping(element)
    return 1.0 if isinstance(element, Spring) else 3.0
