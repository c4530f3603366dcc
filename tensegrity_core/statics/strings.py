"""Tension, stiffness and stored energy of all strings of a model; those with memory go on from their branches."""

from __future__ import annotations

import numpy as np

from ..laws import StringLaw, curved_laws
from ..model import Model

#: Of every string that is no spring its law: with memory, the branch that it is on.
Laws = dict[int, StringLaw]


def string_tension(model: Model, length: np.ndarray, laws: Laws | None = None) -> np.ndarray:
    """(S,) N: elastic tension of every string at these lengths (S,), m; a slack string carries nothing.

    laws: where strings with memory come from, on a continuous way; without, they are stretched from slack.
    """
    return string_values(model, "force", length - model.rest_length, laws)


def string_energy(model: Model, length: np.ndarray, laws: Laws | None = None) -> np.ndarray:
    """(S,) J: energy stored in every string at these lengths (S,), m; for `laws` see `string_tension`."""
    return string_values(model, "energy", length - model.rest_length, laws)


def string_branches(model: Model, length: np.ndarray, laws: Laws | None = None) -> Laws:
    """The laws at these lengths (S,), m; for `laws` see `string_tension`."""
    before = curved_laws(model) if laws is None else laws
    return {i: law.follow(float(length[i] - model.rest_length[i])) for i, law in before.items()}


def string_values(model: Model, what: str, elongation: np.ndarray, laws: Laws | None = None) -> np.ndarray:
    """(S,) 'force' (N), 'stiffness' (N/m) or 'energy' (J) at elongations (S,), m; for `laws` see `string_tension`."""
    k, x, acts = model.stiffness, np.maximum(elongation, 0.0), elongation > 0.0
    if model.two_way.any():
        x, acts = np.where(model.two_way, elongation, x), acts | model.two_way
    found = {"force": k * x, "stiffness": np.where(acts, k, 0.0), "energy": 0.5 * k * x**2}[what]
    for i, law in (curved_laws(model) if laws is None else laws).items():
        at = x.item(i)
        found[i] = getattr(law.follow(at), what)(at)
    return found
