"""The law of a spring that also pushes: f = k x at every elongation, without a slack piece."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..errors import InputError
from .panels import Panel, panel


@dataclass(frozen=True)
class TwoWay:
    """k: N/m.  Piece 0 is all there is; see `strings.StringLaw`."""

    k: float
    breakpoints: ClassVar[tuple[float, ...]] = ()
    uses_stiffness: ClassVar[bool] = True
    narrow: ClassVar[float] = math.inf

    @property
    def stiffest(self) -> float:
        return self.k

    def follow(self, x: float) -> TwoWay:
        return self

    def force(self, x: float) -> float:
        return self.k * x

    def stiffness(self, x: float) -> float:
        return self.k

    def energy(self, x: float) -> float:
        return 0.5 * self.k * x * x

    def elongation(self, force: float) -> float:
        if not math.isfinite(force / self.k):
            raise InputError(f"force = {force!r}: no finite elongation bears it; lower it")
        return force / self.k

    def on_piece(self, piece: int) -> Callable[[float], float]:
        return self.force

    def snapped_on_piece(self, piece: int) -> int:
        return 0

    def panels(self, piece: int) -> tuple[Panel, ...]:
        return (panel(0.0, 1.0, np.inf, np.array([0.0, self.k]), np.array([self.k]), 0.0),)
