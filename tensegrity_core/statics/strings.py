"""Tension, stiffness and stored energy of all strings of a model, and the branches of those that have a memory."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .. import laws
from ..laws import hysteresis
from ..laws import nsh as nsh_law
from ..model import Model

#: Per string with memory the branch that it is on.
Branches = dict[int, hysteresis.Branch]


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
    return _branches(model, length - model.rest_length, branches)


def _branches(model: Model, elongation: np.ndarray, before: Branches | None) -> Branches:
    if before is None:
        before = {i: hysteresis.start(element, float(model.stiffness[i])) for i, element in model.memories.items()}
    return {i: hysteresis.follow(branch, float(elongation[i]))[0] for i, branch in before.items()}


def string_elongation(model: Model, i: int, force: float) -> float:
    """Smallest elongation at which string i bears the force (N), m, stretched from slack."""
    k = float(model.stiffness[i])
    if i in model.memories:
        return hysteresis.elongation(model.memories[i], k, force)
    if i in model.laws:
        return laws.law(model.laws[i]).elongation(force, k)
    return nsh_law.elongation(model.honeycombs[i], force, k) if i in model.honeycombs else force / k


def _tension(model: Model, elongation: np.ndarray, branches: Branches | None) -> np.ndarray:
    elongation = np.maximum(elongation, 0.0)
    return _with_laws(model, model.stiffness * elongation, "force", elongation, branches)


def _stiffness(model: Model, elongation: np.ndarray, branches: Branches | None) -> np.ndarray:
    elongation = np.maximum(elongation, 0.0)
    return _with_laws(model, np.where(elongation > 0.0, model.stiffness, 0.0), "stiffness", elongation, branches)


def _with_laws(model: Model, linear: np.ndarray, what: str, elongation: np.ndarray, branches: Branches | None) -> np.ndarray:
    """The linear strings' values, with `what` (force, stiffness or energy) of all others put in."""
    for i in model.plain_nsh_strings:
        linear[i] = getattr(nsh_law, what)(model.nsh[i], float(elongation[i]), float(model.stiffness[i]))
    for i, element in model.laws.items():
        linear[i] = getattr(laws.law(element), what)(float(elongation[i]), float(model.stiffness[i]))
    for i, branch in _branches(model, elongation, branches).items():
        linear[i] = getattr(branch, what)(float(elongation[i]))
    return linear
