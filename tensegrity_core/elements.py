"""Force laws of strings as trees of elements, eq. 9 and 10: what a string is made of, not how it is computed.

An element's force is a function of its elongation x >= 0 with f(0) = 0, a damper's one of the rate of elongation with f(0) = 0.
The exact evaluation stands in `laws`, that with memory in `hysteresis`, the kernel's in native/.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Union


@dataclass(frozen=True)
class Spring:
    """f = k x.  k: N/m, > 0."""

    k: float


@dataclass(frozen=True)
class Beam:
    """A snap-through beam, eq. 11, stopped at x = 2 h.  Q: N; zeta: 1; h: m; all > 0."""

    Q: float
    zeta: float
    h: float


@dataclass(frozen=True)
class Polynomial:
    """f = sum of coefficients[i] x^(i+1).  coefficients: N/m, N/m2 ...; 1 to 7 of them.

    As a damper: of the rate, N s/m, N s2/m2 ..., and odd: f(-x) = -f(x).
    """

    coefficients: tuple[float, ...]


@dataclass(frozen=True)
class Table:
    """f through points.  x: m (of a damper: m/s), increasing, from 0; f: N, f[0] = 0; at least two points.

    interpolation: 'linear', or 'cubic': the monotone piecewise cubic of Fritsch and Butland as in SciPy's PchipInterpolator.
    Beyond the last point the law goes on along its last slope.  As a damper it is odd: f(-x) = -f(x).
    """

    x: tuple[float, ...]
    f: tuple[float, ...]
    interpolation: str = "linear"


@dataclass(frozen=True)
class Parallel:
    """Equal elongations, forces add up."""

    parts: tuple["Element", ...]


@dataclass(frozen=True)
class Series:
    """Equal forces, elongations add up.

    law: 'single_valued' (Algorithm 1: a part snaps through its falling stretch while the others are held) or 'hysteretic'
    (the parts' elongations are internal variables that follow a stable minimum of the energy, with the string's own
    stiffness in series; only as the outermost element of a string, and of parts without memory).
    """

    parts: tuple["Element", ...]
    law: str = "single_valued"


Element = Union[Spring, Beam, Polynomial, Table, Parallel, Series]
Damper = Union[Polynomial, Table]
