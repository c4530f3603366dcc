"""The law of a string, whatever it is made of: the one place that looks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from ..model import Model
from ..model.elements import Element, Spring, remembers
from . import hysteresis
from .elements import law
from .two_way import TwoWay


class StringLaw(Protocol):
    """What every string's law can say.  Pieces are numbered: 0 is slack, the last one may lie beyond a stop.

    breakpoints: m, the ends of its pieces; none of a law with memory, whose branches have their own;
    uses_stiffness: whether the string's own stiffness k counts, beyond a stop or in series with parts;
    stiffest: N/m, about the largest stiffness; narrow: m, what a step must be small beside, inf where nothing falls.
    """

    @property
    def breakpoints(self) -> tuple[float, ...]: ...
    @property
    def uses_stiffness(self) -> bool: ...
    @property
    def stiffest(self) -> float: ...
    @property
    def narrow(self) -> float: ...

    def follow(self, x: float) -> StringLaw:
        """The law after a continuous way to the elongation x (m): another one, if it has memory."""

    def force(self, x: float) -> float:
        """Elastic tension at an elongation (m), N."""

    def stiffness(self, x: float) -> float:
        """Its derivative, N/m; at a breakpoint that of the piece that ends there."""

    def energy(self, x: float) -> float:
        """Energy stored, J."""

    def elongation(self, force: float) -> float:
        """The inverse: the smallest elongation at which it bears a force (N) on the way from slack, m."""

    def on_piece(self, piece: int) -> Callable[[float], float]:
        """Force over elongation of one piece's own formula, smooth at every x (m): what an integrator needs past an end."""

    def snapped_on_piece(self, piece: int) -> int:
        """Beams, polynomials and tables past their force maximum on a piece."""


def string_law(model: Model, i: int) -> StringLaw:
    """The law of string i; of one with memory as stretched from slack.  Raises InputError where a parameter is out of range."""
    k = model.stiffness.item(i)
    if model.two_way[i]:
        return TwoWay(k)
    return element_law(model.elements.get(i) or Spring(k), k)


def element_law(element: Element, k: float) -> StringLaw:
    """The law of a string that is made of an element; k: N/m, its own stiffness."""
    return hysteresis.start(element, k) if remembers(element) else law(element, k)


def slack_branches(model: Model) -> dict[int, hysteresis.Branch]:
    """The laws of the strings with memory, as stretched from slack."""
    return {i: hysteresis.start(element, model.stiffness.item(i)) for i, element in model.memories.items()}


def curved_laws(model: Model) -> dict[int, StringLaw]:
    """The laws of the strings that are no springs; springs, two_way ones too, are straight lines, done all at once."""
    return {i: string_law(model, i) for i in model.elements}
