"""The variable table of an FMU: one row per variable, generated from `fields.FIELDS` and a model.

A variable's value reference is its index in the kernel's block of reals; the integers follow, so that references are
unique over all types.  Both FMU runtimes, their description and their documentation read this table.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from tensegrity_core.fields import FIELDS, INTEGER_FIELDS, METHODS, POSITIVE, Field
from tensegrity_core.kernel import Kernel
from tensegrity_core.laws import string_law
from tensegrity_core.model import Model
from tensegrity_core.model.components import AXES, components, flat, present

from .dependencies import initial_dependencies

#: Bounds of the shape parameter of an NSH without memory: the nearest numbers within 2 and 8.
METASTABLE = (math.nextafter(2.0, 8.0), math.nextafter(8.0, 2.0))

#: Fields that are the time derivative of another of the same component.
RATES = {field.name: field.rate_of for field in FIELDS if field.rate_of}

#: Names of arrays that do not follow from their elements' names, see `_array`: n4.x is an element of n4.position, and of a
#: moved node n1.position.x is one of n1.motion.position, because n1.position is an output like any other node's.
ARRAYS = {
    "position": "{N}.position",
    "node_position": "{E}.motion.position",
    "node_velocity": "{E}.motion.velocity",
    "node_acceleration": "{E}.motion.acceleration",
}

#: Causality, variability and initial of FMI by the role of a field.
ROLES = {
    "input": ("input", "continuous", None),
    "tunable": ("parameter", "tunable", "exact"),
    "fixed": ("parameter", "fixed", "exact"),
    "output": ("output", "continuous", "calculated"),
}


class Array(NamedTuple):
    """What a variable is an element of in FMI 3.0: a vector, or a parameter of all beams of an NSH."""

    name: str
    description: str


@dataclass(frozen=True)
class Variable:
    """One row.  Attributes are those of FMI; `field` names the row of `fields.FIELDS`; `known` are the value references on
    which an output, a state or a derivative depends in Initialization Mode; `derivative_of` is the reference of the variable
    whose time derivative it is; `depends`, in model exchange, those of states and inputs on which an output or a derivative
    depends, `tuned` the tunable parameters, `constant`: with constant factors; `array`: what it is an element of in FMI 3.0,
    None: a variable of its own; a bound that does not exist is None.
    """

    name: str
    reference: int
    kind: str
    causality: str
    variability: str
    initial: str | None
    unit: str | None
    start: float | int | None
    min: float | int | None
    max: float | int | None
    nominal: float | None
    description: str
    field: str
    known: tuple[int, ...]
    derivative_of: int | None = None
    depends: frozenset[int] | None = None
    tuned: frozenset[int] = frozenset()
    array: Array | None = None
    constant: bool = False


def variables(model: Model, naming: str = "structured") -> tuple[Variable, ...]:
    """All variables in order of their value references.  naming: 'structured' (n4.force.x) or 'flat' (n4_force_x).

    A model may have an attribute `shown`: field -> name and role of the only variables.

    Raises ValueError where two variables would get the same name.
    """
    start = Kernel(model)
    known, shown = initial_dependencies(model), getattr(model, "shown", None)
    rows, places, reference = [], {}, 0
    for fields, starts in ((FIELDS, start.values), (INTEGER_FIELDS, start.integers)):
        offset = reference
        for field in fields:
            for component, has in zip(components(field, model), present(field, model).tolist(), strict=True):
                value = starts[reference - offset].item() if field.role != "output" else None
                name, role = (field.variable, field.role) if shown is None else shown.get(field.name, ("", ""))
                if name and has and (shown is not None or not _hidden(field, component, model)):
                    rows.append(_variable(field, name, role, component, reference, value, model, known, naming))
                    if shown is None:
                        rows[-1] = replace(rows[-1], array=_array(field, component, model, naming))
                    places[field.name, *map(str, component.values())] = rows[-1]
                reference += 1
    require_unique(rows)
    visible = {row.reference for row in rows}
    rates = _derivatives(places)
    return tuple(
        replace(row, known=tuple(sorted(visible.intersection(row.known))), derivative_of=rates.get(row.reference))
        for row in rows
    )


def _derivatives(places: dict[tuple[str, ...], Variable]) -> dict[int, int]:
    """References of derivatives -> of what they are derivatives of.  places: (field, its component) -> row."""
    found = {}
    for (field, *component), row in places.items():
        whole = places.get((RATES.get(field, ""), *component))
        if whole is not None and row.variability == whole.variability == "continuous":
            found[row.reference] = whole.reference
    return found


def _hidden(field: Field, component: dict, model: Model) -> bool:
    """The input of a rest length that is an output, because an actuator winds the string; a stiffness that no force law
    uses."""
    if field.name not in ("rest_length", "rest_length_rate", "stiffness"):
        return False
    string = model.string_names.index(component["S"])
    if field.name == "stiffness":
        return string in model.elements and not string_law(model, string).uses_stiffness
    return model.actuator[string] is not None


def _variable(field, name, role, component, reference, start, model, known, naming) -> Variable:
    name = name.format(**component)
    causality, variability, initial = ROLES[role]
    low, high = _limits(field, component, model)
    if field.name == "stiffness" and model.string_names.index(component["S"]) in model.memories:
        variability = "fixed"  # it shapes the force curve
    kind = "Real"
    if field in INTEGER_FIELDS:
        kind = "Enumeration" if field.name == "method" else "Integer"
        variability = "discrete" if role == "output" else variability
    return Variable(
        name=flat(name) if naming == "flat" else name,
        reference=reference,
        kind=kind,
        causality=causality,
        variability=variability,
        initial=initial,
        unit=field.unit if kind == "Real" else None,
        start=start,
        min=low,
        max=high,
        nominal=_nominal(field, start, model) if kind == "Real" else None,
        description=_description(field, component) + _told(field, component, model),
        field=field.name,
        known=tuple(known.get(reference, ())),
    )


def _array(field: Field, component: dict, model: Model, naming: str) -> Array | None:
    """What this component's value is an element of; a node that is fixed or moved along single axes has no vectors."""
    if not ("D" in component or "beam" in component or component.get("V")) or _single(field, component, model):
        return None
    pattern = field.variable.replace(".{D}", "").replace("[{beam}]", "").replace("{V}", "")
    name = ARRAYS.get(field.name, pattern).format(**component)
    along = ", one for each beam" if "beam" in component else f"; {', '.join(AXES[i] for i in model.axes)}"
    whole = {letter: one for letter, one in component.items() if letter not in ("D", "beam")}
    return Array(flat(name) if naming == "flat" else name, _description(field, whole) + along)


def _single(field: Field, component: dict, model: Model) -> bool:
    """Whether it belongs to a node that has some components of its vectors only."""
    letter = field.shape[0] if field.shape and field.shape[0] in "NFGE" else ""
    single = {node for node, _ in (*model.partly_fixed, *model.moving_axes)}
    return bool(letter and single) and model.node_names.index(component[letter]) in single


def by_reference(table: tuple[Variable, ...]) -> tuple[Variable, ...]:
    """A row for every value reference from 0 on, for the runtimes: where there is no variable, one without name that nobody
    can set."""
    known = {row.reference: row for row in table}
    empty = Variable("", 0, "Real", "output", "continuous", None, None, None, None, None, None, "", "", ())
    return tuple(known.get(i, replace(empty, reference=i)) for i in range(max(known) + 1))


def _limits(field: Field, component: dict, model: Model) -> tuple[float | int | None, float | int | None]:
    if field.name == "nsh_zeta" and model.honeycombs[model.string_names.index(component["Z"])].metastable:
        return METASTABLE
    if field.name == "snapped":
        return 0, component["beams"]
    if field.name == "method":
        return 0, len(METHODS) - 1
    if field.name == "point_mass" and _bears_all(model, model.node_names.index(component["P"])):
        return POSITIVE, field.high
    return field.low, field.high


def _bears_all(model: Model, node: int) -> bool:
    """Whether a node that can move is on bars without mass only."""
    bars = (model.bars == node).any(axis=1)
    return bool(bars.any() and not model.bar_mass[bars].any() and not model.fixed[node])


def _nominal(field: Field, start: float | None, model: Model) -> float:
    """A typical magnitude: a parameter's own start, else the scale that the structure gives to the unit."""
    return abs(start) if field.role != "input" and start else float(f"{scale_of(field.unit, model):.3g}")


def scale_of(unit: str, model: Model) -> float:
    """A typical magnitude of what has this unit, by the structure's longest bar and its weight; 1 where these say nothing."""
    length = float(np.max(model.bar_length, initial=1e-3))
    gravity = float(np.linalg.norm(model.g)) or 9.81
    weight = float(np.sum(model.bar_mass)) * gravity or 1.0
    scale = {
        "m": length,
        "m/s": (gravity * length) ** 0.5,
        "N": weight,
        "J": weight * length,
        "s": (length / gravity) ** 0.5,
        "N/m": weight / length,
        "N.s/m": weight / (gravity * length) ** 0.5,
        "m/s2": gravity,
    }
    return scale.get(unit, 1.0)


def _description(field: Field, component: dict) -> str:
    where = [f"{kind} {component[letter]}" for letter, kind in _KINDS.items() if letter in component]
    if "beam" in component:
        where.append(f"beam {component['beam']}")
    if "D" in component:
        where.append(f"along {component['D']}")
    return f"{', '.join(where)}: {field.meaning}" if where else field.meaning


def _told(field: Field, component: dict, model: Model) -> str:
    """What is said of one component alone."""
    if field.name == "bar_force" and model.redundant[model.bar_names.index(component["B"])]:
        return "; redundant: of the forces that keep the lengths, those of least norm"
    return ""


_KINDS = {"N": "node", "F": "node", "G": "node", "B": "bar", "S": "string", "H": "string", "Z": "string"}
_KINDS |= {"P": "node", "R": "node", "E": "node", "A": "string", "C": "bar", "T": "string"}


def require_unique(rows) -> None:
    """rows: have name and reference.  Raises ValueError where two have the same name."""
    seen: dict[str, int] = {}
    for row in rows:
        if row.name in seen:
            raise ValueError(f"two variables are called {row.name!r}: rename a component of the scene")
        seen[row.name] = row.reference
