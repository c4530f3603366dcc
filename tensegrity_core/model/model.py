"""The model: a scene as frozen arrays, ready to simulate.

A `Model` is what the reference, the kernel and the FMU builder all read.  It holds the start (in equilibrium unless the
scene says otherwise) and the rest lengths that `statics` computed; it knows nothing of files.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

from ..errors import InputError
from ..quantities import array_of, floats, number, pairs_of
from . import joints, routes
from .elements import Beam, Damper, Element, Series, remembers
from .ground import Contact, Ground
from .strength import Section
from .welds import Weld, rigid_bodies


@dataclass(frozen=True)
class NSH:
    """A negative stiffness honeycomb: beams in series.

    Q: force scale, N; zeta: shape parameter, 1; h: arch height, m; one value per beam, any number of beams >= 1.
    law: 'single_valued' or 'hysteretic', see `elements.Series`.
    """

    Q: tuple[float, ...]
    zeta: tuple[float, ...]
    h: tuple[float, ...]
    law: str = "single_valued"

    def __post_init__(self):
        for name in ("Q", "zeta", "h"):
            object.__setattr__(self, name, floats(f"nsh.{name}", getattr(self, name)))

    @cached_property
    def element(self) -> Series:
        """The same as an element.  Raises InputError where Q, zeta and h do not have as many values."""
        if not len(self.Q) == len(self.zeta) == len(self.h):
            counts = ", ".join(str(len(values)) for values in (self.Q, self.zeta, self.h))
            raise InputError(f"nsh: Q, zeta and h have {counts} values; give one value of each per beam")
        return Series(tuple(Beam(*beam) for beam in zip(self.Q, self.zeta, self.h)), self.law)

    @property
    def metastable(self) -> bool:
        """Whether it has no memory and beams only that return when unloaded."""
        return self.law == "single_valued" and all(2.0 < zeta < 8.0 for zeta in self.zeta)


@dataclass(frozen=True)
class Actuator:
    """A motor with a drum that winds a string in, eq. 8 with the sign of winding in: J_a delta'' + d_a delta' = k_a i - r T.

    inertia: J_a, kg m2; damping: d_a, N m s; torque_constant: k_a, N m/A; radius: r, m (1 for a linear motor).
    """

    inertia: float
    damping: float
    torque_constant: float
    radius: float

    def __post_init__(self):
        for name in ("inertia", "damping", "torque_constant", "radius"):
            object.__setattr__(self, name, number(f"actuator.{name}", getattr(self, name)))


def _section(given: Section) -> Section:
    return Section(*(number(f"sections.{name}", value) for name, value in zip(Section._fields, given)))


def _none() -> np.ndarray:
    return np.zeros(0)


@dataclass(frozen=True, eq=False)
class Model:
    """A tensegrity.  Index arrays count nodes from 0 in scene order; SI units; coordinates are always 3D (x, y, z).

    Attributes:
        name: scene name, an identifier.
        description: one line for humans.
        axes: coordinate axes that the scene uses: (0, 1, 2), or two of them in a planar scene.
        node_names, bar_names, string_names: component names.
        nodes: (N, 3) start positions, m.
        fixed: (N,) bool, nodes fixed to the ground, along all axes that the scene uses.
        bars: (B, 2) int, nodes at the two ends; b = second - first.
        bar_mass: (B,) kg; 0 of a bar between nodes that have another mass.
        strings: (S, 2) int, nodes at the two ends; s = second - first.
        stiffness: (S,) N/m; of an NSH string: its stiffness once the NSH has bottomed out.
        damping: (S,) N.s/m.
        rest_length: (S,) m.
        nsh: per string its NSH, or None.
        damping_law: 'literal' or 'tension_only'.
        gravity: m/s2, towards -z; or a vector (x, y, z).
        nominal: (N, 3) node coordinates as the scene file gives them, m; the start differs where it was settled.
        velocity: (N, 3) start velocities, m/s (zero in scenes).
        element: per string its force law where it is neither a spring nor an NSH, else None.
        damper: per string its damping law where it is not linear, else None.
        actuator: per string its actuator, or None; current: (A,) A, drum_load: (A,) N, their start values.
        point_mass: (node, kg) of the nodes that carry one, in node order; a free node on no bar has it, or a string's mass.
        drag: (node, N.s/m) of the nodes with viscous drag, in node order.
        moving: nodes whose motion is an input, in node order: fixed ones, and partly fixed ones that `moving_axes` names.
        partly_fixed: (node, axes) of the free nodes that are fixed along some of the scene's axes, in node order.
        moving_axes: (node, axes) of the `moving` nodes that inputs move along these axes only, in node order.
        welds: bars that are one rigid body, weld by weld, rising.
        ground: a plane that the nodes of `contacts` cannot pass, or None.
        contacts: the nodes that may touch the ground, in node order.
        routes: (string, all its nodes) of the strings over more than two nodes; `strings` has their first two nodes.
        string_mass: (S,) kg, lumped at each string's nodes, see `routes`.
        string_mass_matrix: 'lumped', or 'consistent': a string's segments then move like thin bars of their mass, see `routes`.
        two_way: (S,) bool, springs that also push: their tension is k times the elongation, whatever its sign.
        sections: (bar, section) of the bars whose buckling load is known, in bar order.
        strength: (string, N) of the strings whose strength is known, in string order.
    """

    name: str
    description: str
    axes: tuple[int, ...]
    node_names: tuple[str, ...]
    bar_names: tuple[str, ...]
    string_names: tuple[str, ...]
    nodes: np.ndarray
    fixed: np.ndarray
    bars: np.ndarray
    bar_mass: np.ndarray
    strings: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray
    rest_length: np.ndarray
    nsh: tuple[NSH | None, ...]
    damping_law: str
    gravity: float | tuple[float, float, float]
    nominal: np.ndarray
    velocity: np.ndarray = field(default_factory=_none)
    element: tuple[Element | None, ...] = ()
    damper: tuple[Damper | None, ...] = ()
    actuator: tuple[Actuator | None, ...] = ()
    current: np.ndarray = field(default_factory=_none)
    drum_load: np.ndarray = field(default_factory=_none)
    point_mass: tuple[tuple[int, float], ...] = ()
    drag: tuple[tuple[int, float], ...] = ()
    moving: tuple[int, ...] = ()
    partly_fixed: tuple[tuple[int, tuple[int, ...]], ...] = ()
    moving_axes: tuple[tuple[int, tuple[int, ...]], ...] = ()
    welds: tuple[tuple[int, ...], ...] = ()
    ground: Ground | None = None
    contacts: tuple[Contact, ...] = ()
    routes: tuple[tuple[int, tuple[int, ...]], ...] = ()
    string_mass: np.ndarray = field(default_factory=_none)
    two_way: np.ndarray = field(default_factory=_none)
    string_mass_matrix: str = "lumped"
    sections: tuple[tuple[int, Section], ...] = ()
    strength: tuple[tuple[int, float], ...] = ()

    def __post_init__(self):
        if np.size(self.gravity) == 1:
            self._set("gravity", number("gravity", self.gravity))
        else:
            self._set("gravity", tuple(array_of("gravity", self.gravity, (3,)).tolist()))
        for name in ("point_mass", "drag", "strength"):
            self._set(name, tuple((int(index), number(name, value)) for index, value in getattr(self, name)))
        for name in ("axes", "moving"):
            self._set(name, tuple(int(index) for index in getattr(self, name)))
        for name in ("partly_fixed", "moving_axes"):
            self._set(name, tuple((int(node), tuple(int(axis) for axis in axes)) for node, axes in getattr(self, name)))
        self._set("sections", tuple((int(bar), _section(section)) for bar, section in self.sections))
        self._set("welds", tuple(tuple(int(bar) for bar in weld) for weld in self.welds))
        self._set("contacts", tuple(sorted(self.contacts, key=lambda contact: contact.node)))
        for name in ("bars", "strings"):
            self._set(name, pairs_of(name, getattr(self, name)))
        for name in ("nsh", "element", "damper", "actuator"):
            self._set(name, tuple(getattr(self, name)) or (None,) * len(self.strings))
        self._set("routes", routes.checked(self.routes, self.strings))
        nodes, strings, motors = (len(self.nodes), 3), (len(self.strings),), (len(self.motors),)
        for name, shape in {"velocity": nodes, "current": motors, "drum_load": motors}.items():
            if getattr(self, name) is None or not np.size(getattr(self, name)):
                self._set(name, np.zeros(shape))
        for name in ("string_mass", "two_way"):
            if getattr(self, name) is None or not np.any(getattr(self, name)):  # also of a model with fewer strings
                self._set(name, np.zeros(strings))
        for name, shape in {"fixed": nodes[:1], "two_way": strings}.items():
            flags = np.asarray(getattr(self, name))
            self._set(name, array_of(name, flags.astype(int) if flags.dtype == bool else flags, shape) != 0.0)
        if self.string_mass_matrix not in ("lumped", "consistent"):
            raise InputError(f"string_mass_matrix = {self.string_mass_matrix!r}: use 'lumped' or 'consistent'")
        for i in np.flatnonzero(self.two_way):
            if self.nsh[i] is not None or self.element[i] is not None:
                raise InputError(
                    f"two_way: string {self.string_names[i]!r} has another law than a spring; leave one of them out"
                )
        shapes = {"nodes nominal velocity": nodes, "bar_mass": (len(self.bars),), "current drum_load": motors}
        shapes["stiffness damping rest_length string_mass"] = strings
        for names, shape in shapes.items():
            for name in names.split():
                self._set(name, array_of(name, getattr(self, name), shape))

    def __eq__(self, other):
        """Whether all of it is the same, to the last bit."""
        return self._content == other._content if type(other) is type(self) else NotImplemented

    def __hash__(self):
        return hash(self._content)

    @property
    def _content(self) -> tuple:
        """What two equal models have in common, in texts and numbers."""
        values = (getattr(self, field.name) for field in fields(self))
        return tuple((value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value for value in values)

    def _set(self, name: str, value):
        """In place of what was given, an array for good."""
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
        object.__setattr__(self, name, value)

    @cached_property
    def bar_length(self) -> np.ndarray:
        """(B,) m, from the start positions."""
        return np.linalg.norm(self.nodes[self.bars[:, 1]] - self.nodes[self.bars[:, 0]], axis=1)

    @cached_property
    def paths(self) -> tuple[tuple[int, ...], ...]:
        """All nodes of every string, in order: two, or more where it is routed."""
        return routes.paths(self)

    def string_lengths(self, nodes: np.ndarray) -> np.ndarray:
        """(S,) m, of the strings' whole paths between nodes (N, 3)."""
        return routes.lengths(self, nodes)

    @cached_property
    def massive_strings(self) -> tuple[int, ...]:
        """(M,) indices of the strings with mass."""
        return tuple(np.flatnonzero(self.string_mass).tolist())

    @cached_property
    def string_mass_shares(self) -> tuple[tuple[int, int, float], ...]:
        """(string, node, share) of the strings with mass: the part of a string's mass that is lumped at a node."""
        return routes.mass_shares(self)

    @cached_property
    def string_mass_links(self) -> tuple[tuple[int, int, int, float], ...]:
        """(string, node, node, part) of the segments of the strings with mass, where their mass matrix is consistent."""
        return routes.mass_parts(self) if self.string_mass_matrix == "consistent" else ()

    @cached_property
    def payload(self) -> dict[int, float]:
        """Node -> kg that it carries beside its bars' mass: its point mass, and what is lumped there of strings."""
        found = dict(self.point_mass)
        for string, node, share in () if self.string_mass_links else self.string_mass_shares:
            found[node] = found.get(node, 0.0) + share * self.string_mass.item(string)
        return found

    @cached_property
    def free_nodes(self) -> np.ndarray:
        """(F,) indices of the nodes that can move."""
        return np.flatnonzero(~self.fixed)

    @cached_property
    def held(self) -> np.ndarray:
        """(N, 3) bool: the axes along which a node is fixed, whether it is moved there or not."""
        found = np.repeat(self.fixed[:, None], 3, axis=1)
        for node, axes in self.partly_fixed:
            found[node, list(axes)] = True
        return found

    @cached_property
    def free_coordinates(self) -> np.ndarray:
        """(n,) places among the (N*D) coordinates along the axes that the scene uses, node by node, of those that are free."""
        return np.flatnonzero(~self.held[:, self.axes].ravel())

    @cached_property
    def moved(self) -> np.ndarray:
        """(N, 3) bool: the axes along which a node's motion is an input; those that the scene uses only."""
        found = np.zeros((len(self.nodes), 3), dtype=bool)
        found[np.ix_(self.moving, self.axes)] = True
        for node, axes in self.moving_axes:
            found[node] = np.isin(np.arange(3), axes)
        return found

    @cached_property
    def groups(self) -> tuple[joints.Group, ...]:
        """The bars in groups that move each other, see `joints`."""
        return joints.groups(self)

    @cached_property
    def joint(self) -> str:
        """What of it is beyond class 1, the first of it in words; '' where nothing is."""
        return joints.first_joint(self)

    @cached_property
    def redundant(self) -> np.ndarray:
        """(B,) bool: bars whose forces their lengths leave open at the start, see `joints`."""
        return joints.redundant_bars(self) if self.joint else np.zeros(len(self.bars), dtype=bool)

    @cached_property
    def bodies(self) -> tuple[Weld, ...]:
        """The rigid bodies of welded bars, see `welds`."""
        return rigid_bodies(self)

    @cached_property
    def lone_nodes(self) -> np.ndarray:
        """(L,) indices of the nodes that can move and are on no bar: point masses by themselves."""
        return np.setdiff1d(self.free_nodes, self.bars)

    @cached_property
    def fixed_nodes(self) -> np.ndarray:
        """(G,) indices of the nodes fixed to the ground."""
        return np.flatnonzero(self.fixed)

    @cached_property
    def grounded_nodes(self) -> np.ndarray:
        """(G,) indices of the nodes that are fixed along some axis or all: where the ground holds the structure."""
        return np.flatnonzero(self.held.any(axis=1))

    @cached_property
    def nsh_strings(self) -> tuple[int, ...]:
        """(H,) indices of the strings that carry an NSH."""
        return tuple(self.honeycombs)

    @cached_property
    def honeycombs(self) -> dict[int, NSH]:
        """Per string that carries one: its NSH."""
        return {i: nsh for i, nsh in enumerate(self.nsh) if nsh is not None}

    @cached_property
    def elements(self) -> dict[int, Element]:
        """Per string that is no spring: what it is made of, in string order."""
        made = (element if nsh is None else nsh.element for nsh, element in zip(self.nsh, self.element))
        return {i: element for i, element in enumerate(made) if element is not None}

    @cached_property
    def memories(self) -> dict[int, Series]:
        """Per string with memory: its element."""
        return {i: element for i, element in self.elements.items() if remembers(element)}

    @cached_property
    def motors(self) -> dict[int, Actuator]:
        """Per string that an actuator winds: its actuator."""
        return {i: actuator for i, actuator in enumerate(self.actuator) if actuator is not None}

    @cached_property
    def actuated(self) -> tuple[int, ...]:
        """(A,) indices of the strings that an actuator winds."""
        return tuple(self.motors)

    @property
    def g(self) -> np.ndarray:
        """(3,) acceleration by gravity, m/s2."""
        return np.array(self.gravity if isinstance(self.gravity, tuple) else (0.0, 0.0, -self.gravity), dtype=float)

    @cached_property
    def node_mass(self) -> np.ndarray:
        """(N,) kg: half of its bar's mass, its point mass, and its shares of strings' masses; what gravity acts on."""
        mass = np.zeros(len(self.nodes))
        np.add.at(mass, self.bars.ravel(), np.repeat(0.5 * self.bar_mass, 2))
        for node, value in self.payload.items():
            mass[node] += value
        for string, *ends, part in self.string_mass_links:
            mass[ends] += 0.5 * part * self.string_mass[string]
        return mass

    @cached_property
    def counts(self) -> dict[str, int]:
        """The counts that `fields.COUNTS` names."""
        return {
            "D": len(self.axes),
            "N": len(self.nodes),
            "F": len(self.free_nodes),
            "G": len(self.grounded_nodes),
            "B": len(self.bars),
            "S": len(self.strings),
            "H": len(self.nsh_strings),
            "Z": sum(len(nsh.Q) for nsh in self.honeycombs.values()),
            "V": 1 if np.ndim(self.gravity) == 0 else len(self.axes),
            "P": len(self.point_mass),
            "R": len(self.drag),
            "E": len(self.moving),
            "A": len(self.actuated),
            "K": len(self.contacts),
            "W": int(self.ground is not None and self.ground.moving),
            "M": len(self.massive_strings),
            "C": len(self.sections),
            "T": len(self.strength),
        }
