"""Tensions that balance a structure at its coordinates, and the rest lengths that give them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError, TensegrityError
from ..laws import hysteresis, string_law
from ..model import Model
from .forces import loads, residual, round_off, whole_matrix
from .ground import ground_loads
from .matrices import TooLarge, free_rows, lstsq, null_space, require_small
from .strings import string_tension

if TYPE_CHECKING:
    from ..scene import Scene


def two_parts(failure: TensegrityError) -> tuple[str, str]:
    """Problem and remedy of an error about a law, whose message has them on the two sides of a semicolon."""
    problem, _, remedy = str(failure).rpartition("; ")
    return problem or remedy, f"{remedy[:1].upper()}{remedy[1:]}." if problem else "Change the element or the stiffness."


def prestress(scene: Scene, model: Model) -> np.ndarray:
    """(S,) tensions at the given coordinates, N: those that the scene knows, and those that equilibrium adds."""
    tension = np.full(len(model.strings), np.nan)
    length = model.string_lengths(model.nodes)
    typed = np.array([scene.prestress.rest_length.get(name, xi) for name, xi in zip(model.string_names, length)])
    held = string_tension(replace(model, rest_length=typed), length)
    for i, name in enumerate(model.string_names):
        if name in scene.prestress.tension:
            tension[i] = scene.prestress.tension[name]
        elif name in scene.prestress.force_density:
            tension[i] = scene.prestress.force_density[name] * length[i]
        elif name in scene.prestress.rest_length:
            tension[i] = held[i]
    unknown = np.flatnonzero(np.isnan(tension))
    if not len(unknown):
        return tension
    if scene.start == "released":
        missing = model.string_names[unknown[0]]
        remedy = f"Give prestress.tension.{missing}, its rest_length or its force_density."
        raise scene.error(f"strings.{missing}", "a released scene needs every string's tension", remedy)
    tension[unknown] = _balancing(scene, model, tension, unknown)
    return tension


def _balancing(scene: Scene, model: Model, tension: np.ndarray, unknown: np.ndarray) -> np.ndarray:
    """The unknown strings' tensions that balance the given coordinates (best, in the sense of least squares)."""
    try:
        require_small(model, "finding tensions by equilibrium")
    except TooLarge as failure:
        name = model.string_names[unknown[0]]
        remedy = f"Give every string's tension in prestress.tension: {len(unknown)} are missing, first {name}."
        raise scene.error("prestress", str(failure), remedy, {}) from None
    matrix, count = whole_matrix(model), len(model.strings)
    columns = np.concatenate([unknown, np.arange(count, matrix.shape[1])])
    free = null_space(matrix[:, columns])[: len(unknown)]
    if model.joint:  # bars that hold each other leave no tension open
        directions, sizes, _ = np.linalg.svd(free, full_matrices=False)
        free = directions[:, sizes > 1e-9]
    if free.shape[1]:
        open_strings = [model.string_names[i] for i, row in zip(unknown, free) if np.linalg.norm(row) > 1e-6]
        noun = "tension" if free.shape[1] == 1 else "tensions"
        problem = f"equilibrium leaves {free.shape[1]} {noun} undetermined"
        remedy = f"Give {free.shape[1]} more {noun} in prestress.tension, of: {', '.join(open_strings)}."
        raise scene.error(
            "prestress",
            problem,
            remedy,
            {**scene.prestress.tension, **scene.prestress.force_density, **scene.prestress.rest_length},
        )
    known = np.concatenate([np.nan_to_num(tension), np.zeros(matrix.shape[1] - count)])
    load = free_rows(model, loads(model) + ground_loads(model, model.nodes)) + matrix @ known
    found = -lstsq(matrix[:, columns], load)[: len(unknown)]
    scale = max(1.0, float(np.abs(load).max(initial=0.0)))
    for i, value in zip(unknown, found):
        if value < -1e-9 * scale and not model.two_way[i]:
            name = model.string_names[i]
            problem = f"equilibrium at the given coordinates asks for a tension of {value:.6g} N, which no string has"
            remedy = "Change the prestress or the coordinates."
            raise scene.error(f"strings.{name}", problem, remedy)
    return np.where(model.two_way[unknown], found, np.maximum(found, 0.0))


def rest_lengths(scene: Scene, model: Model, tension: np.ndarray) -> np.ndarray:
    """(S,) m: through k or the NSH's inverse; typed rest lengths stay as they are."""
    length = model.string_lengths(model.nodes)
    rest_length = np.zeros(len(tension))
    for i, name in enumerate(model.string_names):
        if name in scene.prestress.rest_length:
            rest_length[i] = scene.prestress.rest_length[name]
            continue
        pull, key = float(tension[i]), _key(scene, name)
        try:
            elongation = string_law(model, i).elongation(pull)
        except (InputError, hysteresis.NoStableState) as failure:
            raise scene.error(key, *two_parts(failure)) from None
        rest_length[i] = length[i] - elongation
        if rest_length[i] < 0.0:
            problem = f"a tension of {pull:.6g} N stretches the string by {elongation:.6g} m, more than its length"
            raise scene.error(key, problem, "Lower the tension or raise the stiffness.")
    return rest_length


def _key(scene: Scene, name: str) -> str:
    """Where the scene says the tension of a string, or the string, if it follows."""
    given = [key for key, table in scene.prestress.known.items() if name in table]
    return f"prestress.{given[0]}.{name}" if given else f"strings.{name}"


def require_balance(scene: Scene, model: Model) -> None:
    force = np.linalg.norm(residual(model), axis=1)
    if not len(force) or force.max() <= round_off(model):
        return
    node = model.node_names[model.free_nodes[int(np.argmax(force))]]
    problem = f"the given coordinates are not in equilibrium: {force.max():.3g} N stay unbalanced at {node}"
    remedy = 'Correct the coordinates or the prestress, or write start = "settled" (or "released").'
    if model.contacts:
        borne = np.linalg.norm(ground_loads(model, model.nodes).sum(axis=0))
        remedy = f'Write start = "settled" (or "released"): the ground bears {borne:.3g} N, as deep as nodes stand in it.'
    elif not model.held.any() and np.any(model.g):
        remedy = "No node is fixed, so nothing bears the weight: fix a node, or let it float with gravity = 0."
    raise scene.error(f"nodes.{node}", problem, remedy)
