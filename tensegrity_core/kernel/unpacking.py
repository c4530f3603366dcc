"""A model out of the bytes that `packing.to_bytes` made of it, as they stand in FMUs."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

import numpy as np

from ..errors import InputError
from ..fields import COUNTS, DAMPING_LAWS, ELEMENTS, FIELDS, size
from ..model.elements import KINDS, Element, Parallel, Series
from ..model.ground import Contact, Ground
from ..model.model import NSH, Actuator, Model
from ..model.strength import Section
from .joints import unpacked_joints, unpacked_links
from .packing import GROUND_LAWS, MAGIC, SERIES_LAWS, fnv1a

#: Integers before the arrays: counts, damping law, method, local z axis, sizes of the programs, of routes, of shares, of
#: strings that push, and of the joints.
_HEADER = len(COUNTS) + 11


def counts_of(packed: bytes) -> dict[str, int]:
    """The counts of a packed model, by the letters of fields.COUNTS.  Raises InputError where these are not its bytes."""
    if len(packed) < 16 + 4 * _HEADER or packed[:8] != MAGIC or fnv1a(packed[:-8]) != int.from_bytes(packed[-8:], "little"):
        raise InputError("the packed model is damaged or of another version; build it anew")
    return dict(zip(COUNTS, np.frombuffer(packed, "<i4", len(COUNTS), 8).tolist()))


def from_bytes(
    packed: bytes,
    nodes: Sequence[str],
    bars: Sequence[str],
    strings: Sequence[str],
    axes: Sequence[int],
    name: str = "model",
    description: str = "",
) -> Model:
    """The model whose packed bytes these are.

    What is not packed is given: names of components, and the coordinate axes, 0 to 2, that the scene uses; coordinates along
    another axis are zero.  Raises InputError for other bytes.
    """
    counts, head = counts_of(packed), np.frombuffer(packed, "<i4", _HEADER, 8).tolist()
    given = {"N": len(nodes), "B": len(bars), "S": len(strings), "D": len(axes)}
    if any(counts[letter] != count for letter, count in given.items()):
        raise InputError(f"the packed model has {', '.join(f'{counts[k]} {k}' for k in given)}, not the names that are given")
    ints = _Ints(packed, 8 + 4 * _HEADER)
    N, B, S, D = (counts[letter] for letter in "NBSD")
    fixed, ends, held = ints.take(N).astype(bool), ints.take(2 * B).reshape(-1, 2), ints.take(2 * S).reshape(-1, 2)
    beams, laws = ints.take(S).tolist(), ints.take(S).tolist()
    elements, dampers = ints.take(2 * S).reshape(-1, 2).tolist(), ints.take(2 * S).reshape(-1, 2).tolist()
    massive, slowed, moving, wound, columns, ropes, heavy = (ints.take(counts[letter]).tolist() for letter in "PREACTM")
    sizes = dict(zip(("ints", "doubles", "routes", "route_ints", "shares", "two_way", "joints", "places"), head[-8:]))
    program = ints.take(sizes["ints"]).tolist()
    routes = _routes(ints.take(sizes["route_ints"]).tolist())
    sharing, pushing = ints.take(2 * sizes["shares"]).reshape(-1, 2), ints.take(sizes["two_way"])
    touching = ints.take(counts["K"] + (counts["K"] > 0)).tolist()
    joined = ints.take(sizes["joints"]).tolist()
    joints = unpacked_joints(joined, moving, tuple(axes))
    ints.at += -(ints.at - 8) % 8
    doubles = np.frombuffer(packed, "<f8", (len(packed) - 8 - ints.at) // 8, ints.at)
    parts = iter(doubles.tolist())
    coordinates, velocity = (np.zeros((N, 3)) for _ in range(2))
    for array in (coordinates, velocity):
        array[:, list(axes)] = _take(parts, N * D).reshape(N, D)
    numbers = _take(parts, sizes["doubles"]).tolist()
    start = {field.name: _take(parts, size(field, counts)) for field in FIELDS if field.role != "output"}
    shares = [(heavy[n], node, share) for (n, node), share in zip(sharing.tolist(), _take(parts, sizes["shares"]).tolist())]
    plane = _take(parts, 2 * D if touching else 0).reshape(-1, D)
    string_mass, two_way = np.zeros(S), np.isin(np.arange(S), pushing)
    string_mass[heavy] = start["string_mass"]
    springs = {"Q": iter(start["nsh_Q"].tolist()), "zeta": iter(start["nsh_zeta"].tolist()), "h": iter(start["nsh_h"].tolist())}
    nsh = [
        NSH(**{key: tuple(islice(values, count)) for key, values in springs.items()}, law=SERIES_LAWS[law]) if count else None
        for count, law in zip(beams, laws)
    ]
    motors = zip(*(start[key].tolist() for key in ("motor_inertia", "motor_damping", "torque_constant", "drum_radius")))
    actuators = dict(zip(wound, (Actuator(*motor) for motor in motors)))
    gravity = start["gravity"].tolist()
    vector = np.zeros(3)
    vector[list(axes)] = gravity if len(gravity) > 1 else 0.0
    found = Model(
        name=name,
        description=description,
        axes=tuple(axes),
        node_names=tuple(nodes),
        bar_names=tuple(bars),
        string_names=tuple(strings),
        nodes=coordinates,
        fixed=fixed,
        bars=ends,
        bar_mass=start["bar_mass"],
        strings=held,
        stiffness=start["stiffness"],
        damping=start["damping"],
        rest_length=start["rest_length"],
        nsh=tuple(nsh),
        damping_law=DAMPING_LAWS[head[len(COUNTS)]],
        gravity=gravity[0] if len(gravity) == 1 else (vector[0], vector[1], vector[2]),
        nominal=coordinates,
        velocity=velocity,
        element=tuple(_law(program, numbers, *place) for place in elements),
        damper=tuple(_law(program, numbers, *place) for place in dampers),
        actuator=tuple(actuators.get(string) for string in range(S)),
        current=start["current"],
        drum_load=start["drum_load"],
        point_mass=tuple(zip(massive, start["point_mass"].tolist())),
        drag=tuple(zip(slowed, start["drag"].tolist())),
        moving=tuple(moving),
        sections=tuple((bar, Section(bending)) for bar, bending in zip(columns, start["bending_stiffness"].tolist())),
        strength=tuple(zip(ropes, start["strength"].tolist())),
        routes=routes,
        string_mass=string_mass,
        two_way=two_way,
        ground=_ground(plane, tuple(axes), counts, touching),
        contacts=_contacts(touching[:-1], start),
        **joints._asdict(),
    )
    links = unpacked_links(joined, doubles[len(doubles) - sizes["places"] :].tolist(), heavy)
    if links:
        vars(found)["string_mass_links"] = links
    vars(found)["string_mass_shares"] = tuple(shares)  # by the scene's coordinates, which are not packed
    return found


def _ground(plane: np.ndarray, axes: tuple[int, ...], counts: dict[str, int], touching: list[int]) -> Ground | None:
    """plane: (2, D) point and normal, or nothing; touching: nodes, and at the end the law's place."""
    if not touching:
        return None
    point, normal = np.zeros((2, 3))
    point[list(axes)], normal[list(axes)] = plane
    return Ground(tuple(point.tolist()), tuple(normal.tolist()), counts["W"] > 0, GROUND_LAWS[touching[-1]])


def _contacts(nodes: list[int], start: dict[str, np.ndarray]) -> tuple[Contact, ...]:
    numbers = ("stiffness", "damping", "tangential_stiffness", "friction")
    rows = zip(*(start[f"contact_{name}"].tolist() for name in numbers))
    return tuple(Contact(node, *row) for node, row in zip(nodes, rows))


def _routes(ints: list[int]) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """(string, its nodes) of each routed string."""
    found, numbers = [], iter(ints)
    for string in numbers:
        count = next(numbers)
        found.append((string, tuple(islice(numbers, count))))
    return tuple(found)


class _Ints:
    """Reads int32 in turn; at: offset in bytes."""

    def __init__(self, packed: bytes, at: int):
        self.packed, self.at = packed, at

    def take(self, count: int) -> np.ndarray:
        found = np.frombuffer(self.packed, "<i4", count, self.at)
        self.at += 4 * count
        return found


def _take(values: Iterator[float], count: int) -> np.ndarray:
    return np.array(list(islice(values, count)), dtype=float)


def _law(ints: list[int], doubles: list[float], first: int, number: int) -> Any:
    """The law whose program begins there; see `packing._Programs`."""
    if first < 0:
        return None
    return _part(iter(ints[first:]), iter(doubles[number:]))


def _part(ints: Iterator[int], doubles: Iterator[float]) -> Element:
    kind = KINDS[ELEMENTS[next(ints)]]
    if kind in (Parallel, Series):
        count = next(ints)
        options = {"law": SERIES_LAWS[next(ints)]} if kind is Series else {}
        return kind(tuple(_part(ints, doubles) for _ in range(count)), **options)
    fields = dataclasses.fields(kind)
    lists = [field for field in fields if field.type == "tuple[float, ...]"]
    length = next(ints) if lists else 0
    values = {field.name: field.metadata["choices"][next(ints)] for field in fields if "choices" in field.metadata}
    for field in fields:
        if field.name not in values:
            values[field.name] = tuple(islice(doubles, length)) if field in lists else next(doubles)
    return kind(**values)
