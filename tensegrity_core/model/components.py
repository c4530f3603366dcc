"""What the letters of a field's shape stand for in a model: the components of its values, their variables' names, and the shape
that the values have in a result.

A field is flat where it is a block of variables, (rows, values) in row-major order of its shape.  In a result a vector of some
nodes is spread over all of them, (rows, N, 3), and a single value is (rows,).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import product

import numpy as np

from ..fields import Field, size
from .model import Model

AXES = "xyz"


def components(field: Field, model: Model) -> Iterator[dict[str, object]]:
    """What stands for each letter of the field's shape, value by value."""
    letters = {
        "D": [{"D": AXES[i]} for i in model.axes],
        "N": [{"N": name} for name in model.node_names],
        "F": [{"F": model.node_names[i]} for i in model.free_nodes],
        "G": [{"G": model.node_names[i]} for i in model.grounded_nodes],
        "B": [{"B": name} for name in model.bar_names],
        "S": [{"S": name} for name in model.string_names],
        "H": [{"H": model.string_names[i], "beams": len(nsh.Q)} for i, nsh in model.honeycombs.items()],
        "Z": [
            {"Z": model.string_names[i], "beam": beam + 1} for i, nsh in model.honeycombs.items() for beam in range(len(nsh.Q))
        ],
        "V": [{"V": ""}] if model.counts["V"] == 1 else [{"V": f".{AXES[i]}"} for i in model.axes],
        "P": [{"P": model.node_names[node]} for node, _ in model.point_mass],
        "R": [{"R": model.node_names[node]} for node, _ in model.drag],
        "E": [{"E": model.node_names[node]} for node in model.moving],
        "A": [{"A": model.string_names[i]} for i in model.actuated],
        "K": [{"K": model.node_names[contact.node]} for contact in model.contacts],
        "W": [{"W": ""}] * model.counts["W"],
        "M": [{"M": model.string_names[i]} for i in model.massive_strings],
        "C": [{"C": model.bar_names[bar]} for bar, _ in model.sections],
        "T": [{"T": model.string_names[string]} for string, _ in model.strength],
    }
    for parts in product(*(letters[letter] for letter in field.shape)):
        yield {key: value for part in parts for key, value in part.items()}


def names(field: Field, model: Model) -> list[str]:
    """The names of a field's flat values, structured."""
    return [field.variable.format(**component) for component in components(field, model)]


def named(field: Field, model: Model) -> dict[str, int]:
    """The names of a field's variables, structured -> place among its flat values, of those that the model has."""
    return {name: i for i, (name, own) in enumerate(zip(names(field, model), present(field, model).tolist())) if own}


def present(field: Field, model: Model) -> np.ndarray:
    """(n,) bool: the flat values that are variables.

    A node that is fixed along single axes has no force and no velocity along these, and no reaction along the others; one that
    is moved along single axes no motion along the others.  Bars without mass have no mass that could be changed.
    """
    if field.name == "bar_mass":
        return model.bar_mass > 0.0
    along = {"F": (model.free_nodes, ~model.held), "G": (model.grounded_nodes, model.held), "E": (model.moving, model.moved)}
    if field.shape[-1:] != ("D",) or field.shape[0] not in along:
        return np.ones(size(field, model.counts), dtype=bool)
    nodes, has = along[field.shape[0]]
    return has[np.array(nodes, dtype=int)][:, model.axes].ravel()


def flat(name: str) -> str:
    """n4.force.x -> n4_force_x, s1.nsh.Q[1] -> s1_nsh_Q_1; scenes have no two names that become one."""
    return re.sub(r"[.\[]", "_", name.replace("]", ""))


def own_names(given: Iterable[str], known: Iterable[str]) -> dict[str, str]:
    """Each name as a known one, structured or flat, whichever of the two was given: n4.force.z and n4_force_z are one."""
    exact = dict.fromkeys(known)
    own = {flat(name): name for name in exact}
    return {name: name if name in exact else own.get(flat(name), name) for name in given}


def full_shape(field: Field, model: Model) -> tuple[int, ...]:
    """Shape of the field's values at one instant in a result, or in `Inputs`: vectors have three axes, of all nodes or of those
    that are moved."""
    n = len(model.nodes)
    whole = {"D": 3, "N": n, "F": n, "G": n} if "D" in field.shape else {}
    return tuple(whole.get(letter, model.counts[letter]) for letter in field.shape)


def _places(field: Field, model: Model) -> tuple:
    """Where the field's values stand in a full shape; all of them where it has no vectors."""
    if "D" not in field.shape:
        return (slice(None),)
    named = {"D": model.axes, "N": range(len(model.nodes)), "F": model.free_nodes, "G": model.grounded_nodes}
    listed = (named.get(letter, range(model.counts[letter])) for letter in field.shape)
    return (slice(None), *np.ix_(*(np.array(some, dtype=int) for some in listed)))


def spread(field: Field, model: Model, flat: np.ndarray) -> np.ndarray:
    """Flat values (rows, n) in a result's shape; vectors are zero at the other nodes and where an output is no variable, and
    positions keep the scene's coordinate along an axis that it does not use."""
    if "D" not in field.shape:
        return flat if field.shape else flat[:, 0]
    full, places = np.zeros((len(flat), *full_shape(field, model))), _places(field, model)
    if field.compared == "position":
        full[:] = model.nodes
    if field.role == "output" and not (has := present(field, model)).all():
        flat = np.where(has, flat, 0.0)
    full[places] = flat.reshape(full[places].shape)
    return full


def flattened(field: Field, model: Model, values: np.ndarray) -> np.ndarray:
    """(rows, n) values out of the shape of a result, or of `Inputs`."""
    return values[_places(field, model)].reshape(len(values), -1)
