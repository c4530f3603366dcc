"""What members bear: Euler's buckling load of bars, the strength of strings, and how much of it a force uses.

A bar is a column with hinged ends, which buckles under P = pi^2 E I / l^2.  Source: S. P. Timoshenko, J. M. Gere, Theory of
Elastic Stability, 2nd ed., 1961, section 2.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from .model import Model


class Section(NamedTuple):
    """Of a bar.  bending_stiffness: E I, N m2, I about the axis that resists least; gyration: sqrt(I/A), m, 0: not known."""

    bending_stiffness: float
    gyration: float = 0.0


def buckling_load(model: Model) -> np.ndarray:
    """(C,) N: the compression under which each bar with a section buckles."""
    bars = [bar for bar, _ in model.sections]
    bending = np.array([section.bending_stiffness for _, section in model.sections])
    return np.pi**2 * bending / model.bar_length[bars] ** 2


def slenderness(model: Model) -> np.ndarray:
    """(C,) length over radius of gyration; infinite where that is not known."""
    bars = [bar for bar, _ in model.sections]
    gyration = np.array([section.gyration for _, section in model.sections])
    return np.divide(model.bar_length[bars], gyration, out=np.full(len(bars), np.inf), where=gyration > 0.0)


def bar_utilisation(model: Model, force: np.ndarray) -> np.ndarray:
    """(..., C): compression over buckling load, 0 in tension.  force: (..., B) N, tension positive."""
    return np.maximum(-force[..., [bar for bar, _ in model.sections]], 0.0) / buckling_load(model)


def string_utilisation(model: Model, tension: np.ndarray) -> np.ndarray:
    """(..., T): tension over strength, 0 where a damper pushes.  tension: (..., S) N."""
    strength = np.array([value for _, value in model.strength])
    return np.maximum(tension[..., [string for string, _ in model.strength]], 0.0) / strength


def by_name(model: Model, bars: np.ndarray, strings: np.ndarray) -> dict[str, float]:
    """Utilisation of each member with a section or a strength, strings first.  bars: (C,); strings: (T,)."""
    names = [model.string_names[string] for string, _ in model.strength] + [model.bar_names[bar] for bar, _ in model.sections]
    return dict(zip(names, np.concatenate((strings, bars)).tolist(), strict=True))
