"""Force laws of strings as trees of elements, eq. 9 and 10: what a string is made of, not how it is computed.

An element's force is a function of its elongation x >= 0 with f(0) = 0, a damper's one of the rate of elongation with f(0) = 0.
The exact evaluation stands in `laws`, that with memory in `hysteresis`, the kernel's in native/.

A class says what a kind's numbers are, and with `key` their keys in scene files; how they are packed for the kernel follows
(see `kernel.packing`).

Numbers may be Python's or NumPy's, lists of them any sequence or array; they are kept as floats and tuples.
"""

from __future__ import annotations

from dataclasses import Field, dataclass, field, fields
from typing import Any, ClassVar, TypeGuard, get_args

from ..fields import ELEMENTS
from ..quantities import floats, number

#: Ranges of a beam's parameters; beyond them squares, cubes and ratios are no longer numbers.  Q: N; zeta: 1; h: m.
BEAM_RANGES = {"Q": (1e-9, 1e12), "zeta": (1e-6, 1e6), "h": (1e-9, 1e6)}


def key(description: str, low: float = -1e15, high: float = 1e15) -> Any:
    """A number, or numbers, of an element as a key of scene files of the same name.  description: what it is, with its unit;
    low, high: its bounds, included."""
    return field(metadata={"description": description, "low": low, "high": high})


def key_of(one: Field) -> str:
    """The key in scene files of a field of an element."""
    return one.metadata.get("key", one.name)


class _Numbers:
    """Turns the numbers of a frozen dataclass into floats, once they are given.  stops: whether the law ends at a stop."""

    stops: ClassVar[bool] = False

    def __post_init__(self):
        for one in fields(self):  # type: ignore[arg-type]  # of the dataclass that it is mixed into
            if one.type in ("float", "tuple[float, ...]"):
                convert = number if one.type == "float" else floats
                name = f"{type(self).__name__.lower()}.{one.name}"
                object.__setattr__(self, one.name, convert(name, getattr(self, one.name)))


class _Parts:
    """Keeps parts as a tuple, so that an element can be looked up."""

    parts: tuple[Element, ...]

    def __post_init__(self):
        object.__setattr__(self, "parts", tuple(self.parts))


@dataclass(frozen=True)
class Spring(_Numbers):
    """f = k x.  k: N/m, > 0."""

    k: float = field(metadata={"key": "stiffness"})


@dataclass(frozen=True)
class Beam(_Numbers):
    """A snap-through beam, eq. 11, stopped at x = 2 h.  Q: N; zeta: 1; h: m; all > 0."""

    stops: ClassVar[bool] = True
    Q: float
    zeta: float
    h: float


@dataclass(frozen=True)
class Polynomial(_Numbers):
    """f = sum of coefficients[i] x^(i+1).  coefficients: N/m, N/m2 ...; 1 to 7 of them.

    As a damper: of the rate, N s/m, N s2/m2 ..., and odd: f(-x) = -f(x).
    """

    coefficients: tuple[float, ...]


@dataclass(frozen=True)
class Table(_Numbers):
    """f through points.  x: m (of a damper: m/s), increasing, from 0; f: N, f[0] = 0; at least two points.

    interpolation: 'linear', or 'cubic': the monotone piecewise cubic of Fritsch and Butland as in SciPy's PchipInterpolator.
    Beyond the last point the law goes on along its last slope.  As a damper it is odd: f(-x) = -f(x).
    """

    x: tuple[float, ...] = field(metadata={"key": "elongation"})
    f: tuple[float, ...] = field(metadata={"key": "force"})
    interpolation: str = field(default="linear", metadata={"choices": ("linear", "cubic")})


@dataclass(frozen=True)
class Parallel(_Parts):
    """Equal elongations, forces add up."""

    parts: tuple[Element, ...]


@dataclass(frozen=True)
class Series(_Parts):
    """Equal forces, elongations add up.

    law: 'single_valued' (Algorithm 1: a part snaps through its falling stretch while the others are held) or 'hysteretic'
    (the parts' elongations are internal variables that follow a stable minimum of the energy, with the string's own
    stiffness in series; only as the outermost element of a string, and of parts without memory).
    """

    parts: tuple[Element, ...]
    law: str = "single_valued"


Element = Spring | Beam | Polynomial | Table | Parallel | Series
Damper = Polynomial | Table

#: Class by kind, as scene files and `fields.ELEMENTS` call it.
KINDS = {one.__name__.lower(): one for one in get_args(Element)}
if set(KINDS) != set(ELEMENTS):
    raise ValueError(f"fields.ELEMENTS has the kinds {', '.join(ELEMENTS)}, model/elements.py the classes {', '.join(KINDS)}")


def remembers(element: Element) -> TypeGuard[Series]:
    """Whether an element has memory."""
    return isinstance(element, Series) and element.law == "hysteretic"


def simplified(element: Element) -> Element:
    """The same law with series in series and parallels in parallels opened, and with parts that are alone in the place of their
    groups: the deeper a law is nested, the longer each of its values takes.  A series with memory keeps its parts apart."""
    if not isinstance(element, (Series, Parallel)):
        return element
    parts = tuple(simplified(part) for part in element.parts)
    if isinstance(element, Series) and element.law != "single_valued":
        return Series(parts, element.law)
    kind = type(element)
    opened = [
        inner
        for part in parts
        for inner in (part.parts if isinstance(part, (Series, Parallel)) and _opens(kind, part) else (part,))
    ]
    return opened[0] if len(opened) == 1 else kind(tuple(opened))


def _opens(kind: type, part: Element) -> bool:
    return type(part) is kind and getattr(part, "law", "single_valued") == "single_valued"
