"""A model as bytes for the C kernel: a header, arrays of numbers, force laws as programs, a hash."""

from __future__ import annotations

import dataclasses

import numpy as np

from ..fields import COUNTS, DAMPING_LAWS, ELEMENTS, FIELDS, METHODS, size
from ..model.components import flattened
from ..model.elements import Damper, Element, Parallel, Series
from ..model.inputs import INPUTS, starts
from ..model.model import Model
from ..quantities import number
from .joints import packed_joints

#: Begins the bytes of a model, and says their layout.
MAGIC = b"TSMODEL3"
#: Laws of beams in series by name; a law's place is its number in the kernel.
SERIES_LAWS = ("single_valued", "hysteretic")

#: Laws of the ground by name; a law's place is its number in the kernel.
GROUND_LAWS = ("clipped", "literal")


def _parameters(model: Model, tolerance: float, max_step: float) -> dict[str, np.ndarray]:
    """Start values of all inputs and parameters, by field name.  Raises ValueError for one without."""
    beams, motors = list(model.honeycombs.values()), list(model.motors.values())
    known = {
        "stiffness": model.stiffness,
        "damping": model.damping,
        "gravity": np.array([model.gravity] if np.ndim(model.gravity) == 0 else model.g[list(model.axes)], dtype=float),
        "drag": np.array([value for _, value in model.drag]),
        "string_mass": model.string_mass[list(model.massive_strings)],
        "point_mass": np.array([value for _, value in model.point_mass]),
        "motor_inertia": np.array([motor.inertia for motor in motors]),
        "motor_damping": np.array([motor.damping for motor in motors]),
        "torque_constant": np.array([motor.torque_constant for motor in motors]),
        "drum_radius": np.array([motor.radius for motor in motors]),
        "bar_mass": model.bar_mass,
        "contact_stiffness": np.array([contact.stiffness for contact in model.contacts]),
        "contact_damping": np.array([contact.damping for contact in model.contacts]),
        "contact_tangential_stiffness": np.array([contact.tangential_stiffness for contact in model.contacts]),
        "contact_friction": np.array([contact.friction for contact in model.contacts]),
        "bending_stiffness": np.array([section.bending_stiffness for _, section in model.sections]),
        "strength": np.array([value for _, value in model.strength]),
        "nsh_Q": np.array([x for nsh in beams for x in nsh.Q]),
        "nsh_zeta": np.array([x for nsh in beams for x in nsh.zeta]),
        "nsh_h": np.array([x for nsh in beams for x in nsh.h]),
        "tolerance": np.array([number("tolerance", tolerance)]),
        "max_step": np.array([number("max_step", max_step)]),
    }
    known |= {name: flattened(INPUTS[name], model, value[None])[0] for name, value in starts(model).items()}
    for field in FIELDS:
        if field.role != "output" and field.name not in known:
            if field.start is None:
                raise ValueError(f"fields.py: {field.name!r} has no start, and kernel.packing knows none; give its row one")
            known[field.name] = np.full(size(field, model.counts), field.start)
    return known


def fnv1a(data: bytes) -> int:
    """64-bit FNV-1a hash, as the kernel computes it."""
    value = 14695981039346656037
    for byte in data:
        value = ((value ^ byte) * 1099511628211) & 0xFFFFFFFFFFFFFFFF
    return value


class _Programs:
    """Force laws as numbers that the kernel reads: each a tree in prefix order; a string keeps where its own begins, -1: none.

    ints: of an element its kind (the place in `fields.ELEMENTS`) and then, of a sum, how many parts, of a series the law, too;
    else how many numbers its first list has, and the places of its choices.  doubles: its numbers, in the order of its class.
    """

    def __init__(self):
        self.ints: list[int] = []
        self.doubles: list[float] = []
        self._known: dict = {}

    def place(self, law: Element | Damper | None) -> tuple[int, int]:
        """(first int, first double) of a law's program; (-1, -1): none.  Equal laws share theirs."""
        if law is None:
            return -1, -1
        if law not in self._known:
            self._known[law] = len(self.ints), len(self.doubles)
            self._write(law)
        return self._known[law]

    def _write(self, law: Element | Damper) -> None:
        self.ints.append(ELEMENTS.index(type(law).__name__.lower()))
        if isinstance(law, (Parallel, Series)):
            self.ints.append(len(law.parts))
            if isinstance(law, Series):
                self.ints.append(SERIES_LAWS.index(law.law))
            for part in law.parts:
                self._write(part)
            return
        values = {field: getattr(law, field.name) for field in dataclasses.fields(law)}
        lists = [value for value in values.values() if isinstance(value, tuple)]
        self.ints += [len(value) for value in lists[:1]]
        self.ints += [field.metadata["choices"].index(value) for field, value in values.items() if "choices" in field.metadata]
        for value in values.values():
            self.doubles += value if isinstance(value, tuple) else [value] if isinstance(value, float) else []


def to_bytes(model: Model, method: str = "auto", tolerance: float = 1e-10, max_step: float = 0.0) -> bytes:
    """The model as the packed bytes that the kernel reads; the layout stands in native/model/packed.c.

    method, tolerance, max_step: defaults of the fields of these names.
    """
    axes = list(model.axes)
    counts = [model.counts[letter] for letter in COUNTS]
    z_axis = axes.index(2) if 2 in axes else -1
    beams = [len(nsh.Q) if nsh is not None else 0 for nsh in model.nsh]
    laws = [SERIES_LAWS.index(nsh.law) if nsh is not None else 0 for nsh in model.nsh]
    programs = _Programs()
    places = [n for law in (*model.element, *model.damper) for n in programs.place(law)]
    routes = [n for string, nodes in model.routes for n in (string, len(nodes), *nodes)]
    heavy = {string: place for place, string in enumerate(model.massive_strings)}
    shares = [(heavy[string], node, share) for string, node, share in model.string_mass_shares]
    two_way = np.flatnonzero(model.two_way)
    joints = packed_joints(model)
    sizes = [len(programs.ints), len(programs.doubles), len(model.routes), len(routes), len(shares), len(two_way)]
    sizes += [len(joints.ints), len(joints.doubles)]
    header = [*counts, DAMPING_LAWS.index(model.damping_law), METHODS.index(method), z_axis, *sizes]
    ints = [*header, *model.fixed.astype(int), *model.bars.ravel(), *model.strings.ravel(), *beams, *laws, *places]
    ints += [*(node for node, _ in model.point_mass), *(node for node, _ in model.drag), *model.moving, *model.actuated]
    ints += [*(bar for bar, _ in model.sections), *(string for string, _ in model.strength), *heavy]
    ints += [*programs.ints, *routes, *(n for place, node, _ in shares for n in (place, node)), *two_way]
    if model.contacts and model.ground is not None:
        ints += [*(contact.node for contact in model.contacts), GROUND_LAWS.index(model.ground.law)]
    ints += joints.ints
    ints += [0] * (len(ints) % 2)
    start = _parameters(model, tolerance, max_step)
    doubles = [model.nodes[:, axes].ravel(), model.velocity[:, axes].ravel(), np.array(programs.doubles)]
    doubles += [start[field.name] for field in FIELDS if field.role != "output"]
    doubles.append(np.array([share for _, _, share in shares]))
    if model.contacts and model.ground is not None:
        doubles += [np.array(model.ground.point)[axes], np.array(model.ground.normal)[axes]]
    doubles.append(np.array(joints.doubles))
    body = MAGIC + np.array(ints, "<i4").tobytes() + np.concatenate(doubles).astype("<f8").tobytes()
    return body + fnv1a(body).to_bytes(8, "little")
