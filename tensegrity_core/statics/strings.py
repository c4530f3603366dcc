"""Tension, stiffness and stored energy of all strings of a model, and the branches of those that have a memory."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..laws import curved_laws, slack_branches, string_law
from ..laws.hysteresis import Branch
from ..model import Model

#: Per string with memory the branch that it is on.
Branches = dict[int, Branch]


def string_tension(model: Model, length: np.ndarray, branches: Branches | None = None) -> np.ndarray:
    """(S,) N: elastic tension of every string at these lengths (S,), m; a slack string carries nothing.

    branches: where strings with memory come from, on a continuous way; without, they are stretched from slack.
    """
    return _tension(model, length - model.rest_length, branches)


def string_energy(model: Model, length: np.ndarray, branches: Branches | None = None) -> np.ndarray:
    """(S,) J: energy stored in every string at these lengths (S,), m."""
    elongation = np.maximum(length - model.rest_length, 0.0)
    return _with_laws(model, 0.5 * model.stiffness * elongation**2, "energy", elongation, branches)


def strings_from(model: Model, branches: Branches | None) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Tension (S,), N, and stiffness (S,), N/m, of all strings at elongations (S,), m; for `branches` see `string_tension`."""

    def laws(elongation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return _tension(model, elongation, branches), _stiffness(model, elongation, branches)

    return laws


def string_branches(model: Model, length: np.ndarray, branches: Branches | None = None) -> Branches:
    """The branches of the strings with memory at these lengths (S,), m; for `branches` see `string_tension`."""
    before = slack_branches(model) if branches is None else branches
    return {i: branch.follow(float(length[i] - model.rest_length[i])) for i, branch in before.items()}


def string_elongation(model: Model, i: int, force: float) -> float:
    """Smallest elongation at which string i bears the force (N), m, stretched from slack."""
    return string_law(model, i).elongation(force)


def _tension(model: Model, elongation: np.ndarray, branches: Branches | None) -> np.ndarray:
    elongation = np.maximum(elongation, 0.0)
    return _with_laws(model, model.stiffness * elongation, "force", elongation, branches)


def _stiffness(model: Model, elongation: np.ndarray, branches: Branches | None) -> np.ndarray:
    elongation = np.maximum(elongation, 0.0)
    return _with_laws(model, np.where(elongation > 0.0, model.stiffness, 0.0), "stiffness", elongation, branches)


def _with_laws(model: Model, linear: np.ndarray, what: str, elongation: np.ndarray, branches: Branches | None) -> np.ndarray:
    """The springs' values, with `what` (force, stiffness or energy) of all other strings put in."""
    for i, law in (curved_laws(model) | (branches or {})).items():
        x = elongation.item(i)
        linear[i] = getattr(law.follow(x), what)(x)
    return linear
