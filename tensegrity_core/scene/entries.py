"""The tables of a scene file: their keys, and what each value may be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    PrivateAttr,
    Strict,
    StringConstraints,
    Tag,
    create_model,
)
from pydantic_core import PydanticCustomError

from ..errors import SceneError
from ..model import elements
from ..model.elements import Damper as DamperLaw
from ..model.elements import Element as ElementLaw
from ..model.strength import Section
from . import files as scene_files
from .files import IDENTIFIER, lookup, place_of

#: Axes that a scene uses -> their places among x, y, z.
PLANES = {None: (0, 1, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
LONGEST_NAME = 128  # letters
MOST_BEAMS = 60  # of an NSH without memory

Name = Annotated[str, StringConstraints(pattern=IDENTIFIER, max_length=LONGEST_NAME)]
#: One line of what XML 1.0 can hold, since a scene's texts go into an FMU's model description.
Text = Annotated[str, StringConstraints(pattern=r"^[^\x00-\x08\x0A-\x1F\uFFFE\uFFFF]*$", max_length=10_000)]


def _between(low: float, high: float) -> Any:
    return Field(ge=low, le=high, allow_inf_nan=False)


def _optional(description: str) -> Any:
    """A key that may be left out."""
    return Field(None, description=description)


def _not_tiny(least: float) -> AfterValidator:
    """Sizes below this are refused but for 0: nothing would be left of their squares and cubes."""

    def check(value: float) -> float:
        if 0.0 < abs(value) < least:
            raise PydanticCustomError("tiny", "is closer to 0 than {least} without being 0", {"least": least})
        return value

    return AfterValidator(check)


# What no structure has is refused here, so that squares, cubes and ratios of what is left are numbers.  SI units.
Coordinate = Annotated[float, _between(-1e6, 1e6)]
Positive = Annotated[float, _between(1e-15, 1e15)]
NotNegative = Annotated[float, _between(0.0, 1e15), _not_tiny(1e-15)]
Tension = Annotated[float, _between(-1e15, 1e15), _not_tiny(1e-15)]
Component = Annotated[float, _between(-1e9, 1e9)]
ForceScale = Annotated[float, _between(*elements.BEAM_RANGES["Q"])]
Shape = Annotated[float, _between(*elements.BEAM_RANGES["zeta"])]
Length = Annotated[float, _between(*elements.BEAM_RANGES["h"])]
RestLength = Annotated[float, _between(0.0, 1e7)]
Point = Annotated[tuple[Coordinate, ...], Strict(False), Field(min_length=2, max_length=3)]
SecondMoment = Annotated[float, _between(1e-60, 1e15)]
Speed = Annotated[float, _between(-1e5, 1e5)]
Velocity = Annotated[tuple[Speed, ...], Strict(False), Field(min_length=2, max_length=3)]
Ends = Annotated[tuple[str, str], Strict(False)]
Route = Annotated[tuple[str, ...], Strict(False), Field(min_length=2)]
Weld = Annotated[tuple[str, ...], Strict(False), Field(min_length=2)]
Scales = Annotated[tuple[ForceScale, ...], Strict(False), Field(min_length=1, max_length=MOST_BEAMS)]
Zetas = Annotated[tuple[Shape, ...], Strict(False), Field(min_length=1, max_length=MOST_BEAMS)]
Heights = Annotated[tuple[Length, ...], Strict(False), Field(min_length=1, max_length=MOST_BEAMS)]
#: A number or a vector; the tags tell pydantic which of the two to check, and stand in the places of its findings.
Gravity = Annotated[
    Annotated[float, _between(0.0, 1e9), Tag("[number]")]
    | Annotated[tuple[Component, Component, Component], Strict(False), Tag("[vector]")],
    Discriminator(lambda value: "[vector]" if isinstance(value, (list, tuple)) else "[number]"),
]
Coefficient = Annotated[float, _between(-1e15, 1e15), _not_tiny(1e-15)]
Abscissa = Annotated[float, _between(0.0, 1e6), _not_tiny(1e-12)]
Force = Annotated[float, _between(-1e12, 1e12), _not_tiny(1e-15)]
Coefficients = Annotated[tuple[Coefficient, ...], Strict(False), Field(min_length=1, max_length=7)]
Abscissas = Annotated[tuple[Abscissa, ...], Strict(False), Field(min_length=2)]
Forces = Annotated[tuple[Force, ...], Strict(False), Field(min_length=2)]
Names = Annotated[tuple[str, ...], Strict(False), Field(min_length=1)]
SeriesLaw = Literal["single_valued", "hysteretic"]
Shapes = Literal["metastable", "any"]
Interpolation = Literal["linear", "cubic"]


class Entry(BaseModel):
    """A table of the scene file: no unknown keys, no silent conversions."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, title=None)

    def given(self, key: str) -> Any:
        """The value of a key that an entry of its kind must have, which `checks` sees to."""
        return getattr(self, key)


class Material(Entry):
    """What strings are made of."""

    stiffness: Positive = Field(description="stiffness k in N/m, a number greater than 0")
    damping: NotNegative = Field(0.0, description="damping d in N s/m, 0 or more")
    strength: Positive | None = _optional("tension that its strings bear in N, greater than 0")


class Honeycomb(Entry):
    """A negative stiffness honeycomb (NSH): curved beams in series, eq. 11; one value per beam in each list."""

    Q: Scales = Field(description="force scale of each beam in N, a list of numbers greater than 0")
    zeta: Zetas = Field(description="shape parameter of each beam, a list of numbers between 2 and 8 (metastable)")
    h: Heights = Field(description="arch height of each beam in m, a list of numbers greater than 0")
    law: SeriesLaw = Field(
        "single_valued",
        description='"single_valued" (one force per elongation, Algorithm 1) or "hysteretic" (beams with memory: they snap '
        "where they lose stability, and each snap loses energy)",
    )
    beams: Shapes = Field(
        "metastable",
        description='"metastable" (2 < zeta < 8) or "any" (monotone beams too; bistable ones where the law is "hysteretic")',
    )


if TYPE_CHECKING:
    Kind = str
else:
    Kind = Literal[tuple(elements.KINDS)]


class _Element(Entry):
    """A force law of strings, and what it is made of; which keys belong to it depends on its kind."""

    kind: Kind = Field(description=", ".join(f'"{kind}"' for kind in elements.KINDS))
    stiffness: Positive | None = _optional("of a spring: its stiffness in N/m, greater than 0")
    Q: ForceScale | None = _optional("of a beam: its force scale in N, greater than 0")
    zeta: Shape | None = _optional("of a beam: its shape parameter, between 2 and 8 (metastable)")
    h: Length | None = _optional("of a beam: its arch height in m, greater than 0")
    beams: Shapes | None = _optional('of a beam: "metastable" (2 < zeta < 8, the default) or "any"')
    coefficients: Coefficients | None = _optional("of a polynomial: 1 to 7 coefficients of x, x^2, ... in N/m, N/m2, ...")
    elongation: Abscissas | None = _optional("of a table: elongations in m, increasing from 0, at least two")
    force: Forces | None = _optional("of a table: the force in N at each elongation, the first 0")
    interpolation: Interpolation | None = _optional(
        'of a table: "linear" (the default) or "cubic" (smooth, and monotone between the points)'
    )
    parts: Names | None = _optional("of a series or parallel: names of its parts, at least one; names may repeat")
    law: SeriesLaw | None = _optional(
        'of a series: "single_valued" (the default) or "hysteretic" (with memory; not as a part of another)'
    )


def _own_keys() -> dict[str, Any]:
    """Keys of the kinds of elements whose classes say them: name -> type and description."""
    found: dict[str, Any] = {}
    for kind, made in elements.KINDS.items():
        for own in (own for own in fields(made) if "description" in own.metadata):
            if own.name in found or own.name in _Element.model_fields:
                raise ValueError(
                    f"model/elements.py: {kind}.{own.name}: another kind of elements has this key; choose another name"
                )
            each: Any = Annotated[float, _between(own.metadata["low"], own.metadata["high"])]
            many: Any = Annotated[tuple[each, ...], Strict(False), Field(min_length=1)]
            about = f"of a {kind}: {own.metadata['description']}"
            found[own.name] = ((each if own.type == "float" else many) | None, _optional(about))
    return found


Element: Any = create_model("Element", __base__=_Element, __doc__=_Element.__doc__, **_own_keys())


class Damper(Entry):
    """A damper whose force is not proportional to the rate of elongation: by coefficients, or by points."""

    coefficients: Coefficients | None = _optional(
        "1 to 7 coefficients of v, v^2, ... in N s/m, N s2/m2, ..., v the size of the rate of elongation"
    )
    rate: Abscissas | None = _optional("rates of elongation in m/s, increasing from 0, at least two")
    force: Forces | None = _optional("the force in N at each rate, the first 0")
    interpolation: Interpolation | None = _optional(
        'between points: "linear" (the default) or "cubic" (smooth, and monotone between the points)'
    )


class Actuator(Entry):
    """A motor with a drum that winds a string in, eq. 8."""

    inertia: Positive = Field(description="moment of inertia J_a of motor and drum in kg m2, greater than 0")
    damping: NotNegative = Field(0.0, description="damping d_a of the motor in N m s, 0 or more")
    torque_constant: Positive = Field(description="torque per current k_a in N m/A, greater than 0")
    radius: Length = Field(description="radius r of the drum in m, greater than 0 (1 for a linear motor)")


class Bar(Entry):
    """A rigid thin bar."""

    nodes: Ends = Field(description='nodes at the two ends, as in ["n1", "n5"]')
    mass: NotNegative = Field(description="mass in kg, a number greater than 0, or 0 between nodes that have another mass")
    E: Positive | None = _optional("modulus of elasticity in Pa, greater than 0: with a section, how far it is from buckling")
    diameter: Positive | None = _optional("outer diameter of a round section in m, greater than 0")
    wall: Positive | None = _optional("thickness of a tube's wall in m, less than half its diameter; solid without it")
    area: Positive | None = _optional("area of another section in m2, greater than 0")
    second_moment: SecondMoment | None = _optional(
        "second moment of area of another section in m4, greater than 0, about the axis that resists least"
    )

    def section(self) -> Section | None:
        """What resists buckling; None: not known."""
        if self.E is None:
            return None
        if self.diameter is None:
            area, moment = self.given("area"), self.given("second_moment")
        else:
            inner = self.diameter - 2.0 * self.wall if self.wall else 0.0
            area = math.pi / 4.0 * (self.diameter**2 - inner**2)
            moment = math.pi / 64.0 * (self.diameter**4 - inner**4)
        return Section(self.E * moment, math.sqrt(moment / area))


class String(Entry):
    """A string, tension only unless it is a `two_way` spring, without mass unless it has some."""

    nodes: Route = Field(
        description='nodes at the two ends, as in ["n1", "n4"], or all nodes that it passes without friction, in order: two at '
        "least; an endless one ends at its first node"
    )
    material: str | None = _optional("name of one of the [materials]")
    stiffness: Positive | None = _optional("stiffness k in N/m, greater than 0, instead of the material's")
    damping: NotNegative | None = _optional("damping d in N s/m, 0 or more, instead of the material's")
    nsh: str | None = _optional(
        "name of one of the [nsh]: its force curve replaces the stiffness, which acts once it has bottomed out"
    )
    actuator: str | None = _optional("name of one of the [actuators]: it winds the string in")
    element: str | None = _optional("name of one of the [elements]: the string's force law, instead of an nsh")
    damper: str | None = _optional("name of one of the [dampers], instead of a damping")
    mass: NotNegative = Field(
        0.0, description="mass in kg, 0 or more; lumped at its nodes unless string_mass_matrix says otherwise"
    )
    two_way: bool = Field(False, description="true of a spring that pushes, too, where it is shorter than its rest length")
    strength: Positive | None = _optional("tension that it bears in N, greater than 0, instead of the material's")


class Contact(Entry):
    """What of the ground is other than its own under one node."""

    stiffness: Positive | None = _optional("stiffness k_n under this node in N/m, greater than 0")
    damping: NotNegative | None = _optional("damping c under this node in s/m, 0 or more")
    friction: NotNegative | None = _optional("coefficient mu of friction of this node, 0 or more")
    tangential_stiffness: Positive | None = _optional("stiffness k_t of friction of this node in N/m, greater than 0")


class Ground(Entry):
    """A plane that nodes cannot pass, but for a small elastic penetration."""

    point: Point | None = _optional("a point of the plane in m (two numbers in a planar scene), the origin without it")
    normal: Point | None = _optional(
        "a vector out of the ground, of any length but 0 (two numbers in a planar scene); z without it"
    )
    stiffness: Positive = Field(description="stiffness k_n in N/m, a number greater than 0")
    damping: NotNegative = Field(0.0, description="damping c in s/m, 0 or more: N = k_n delta (1 + c delta')")
    friction: NotNegative = Field(0.0, description="coefficient mu of friction, 0 or more")
    tangential_stiffness: Positive | None = _optional(
        "stiffness k_t of friction before it slips in N/m, greater than 0; the stiffness k_n without it"
    )
    law: Literal["clipped", "literal"] = Field(
        "clipped",
        description='"clipped" (the ground never pulls) or "literal" (N as the formula says, which pulls at nodes that leave '
        "fast; without friction)",
    )
    nodes: Names | None = _optional("names of the nodes that may touch it, at least one; all that can move without it")
    moving: bool = Field(False, description="true: its height along the normal is an input, false: it stands")
    at: dict[str, Contact] = Field(
        default_factory=dict, description="node name = what is other under this node, as in at.n4 = { friction = 0.2 }"
    )


class Prestress(Entry):
    """What is known of the strings at the given coordinates; the equilibrium gives the rest."""

    tension: dict[str, Tension] = Field(
        default_factory=dict,
        description="string name = tension in N at the given coordinates, 0 or more, below 0 only of a two_way spring",
    )
    rest_length: dict[str, RestLength] = Field(default_factory=dict, description="string name = rest length in m, 0 or more")
    force_density: dict[str, Tension] = Field(
        default_factory=dict,
        description="string name = force density in N/m at the given coordinates, tension over length; like tension, 0 or more",
    )

    @property
    def known(self) -> dict[str, dict[str, float]]:
        """Its tables by name: what they say of a string, of which one is enough."""
        return {key: getattr(self, key) for key in type(self).model_fields}


class Scene(Entry):
    """A checked scene.  Fields are the keys of the file; treat it and what it holds as read-only.

    Make one with `load_scene` or `parse_scene`: they run the checks that need more than one key.
    """

    name: Name = Field(
        description="name of the scene, an identifier: a letter, then letters, digits and _; without it the file's name is "
        "taken, so give one or rename the file"
    )
    description: Text = Field("", description="one line for humans, without control characters")
    source: Text = Field("", description="where the numbers come from, one line without control characters")
    gravity: Gravity = Field(9.81, description="gravity in m/s2: a number, 0 or more, towards -z, or a vector [x, y, z]")
    plane: Literal["xz", "yz", "xy"] | None = _optional(
        '"xz", "yz" or "xy" for a planar scene, whose nodes have two coordinates'
    )
    damping_law: Literal["literal", "tension_only"] = Field(
        "literal", description='"literal" (the damper may push while a string shortens) or "tension_only"'
    )
    string_mass_matrix: Literal["lumped", "consistent"] = Field(
        "lumped",
        description='where strings have mass: "lumped" (at their nodes) or "consistent" (each segment moves like a thin bar)',
    )
    start: Literal["equilibrium", "settled", "released"] = Field(
        "equilibrium",
        description='"equilibrium" (the given coordinates must balance), "settled" (the stable equilibrium near them) '
        'or "released" (at rest there, balanced or not)',
    )
    fixed: Annotated[tuple[str, ...], Strict(False)] = Field(
        (), description='names of the nodes fixed to the ground; "n2.z": fixed along this axis only'
    )
    moving: Annotated[tuple[str, ...], Strict(False)] = Field(
        (), description='names of the fixed nodes whose motion is an input; "n2.z": along this axis only'
    )
    nodes: dict[Name, Point] = Field(description="node name = [x, y, z] in m (two coordinates in a planar scene)")
    materials: dict[Name, Material] = Field(default_factory=dict, description="materials of strings by name")
    nsh: dict[Name, Honeycomb] = Field(default_factory=dict, description="NSHs by name")
    actuators: dict[Name, Actuator] = Field(default_factory=dict, description="actuators of strings by name")
    elements: dict[Name, Element] = Field(default_factory=dict, description="force laws of strings, and their parts, by name")
    dampers: dict[Name, Damper] = Field(default_factory=dict, description="dampers that are not linear, by name")
    bars: dict[Name, Bar] = Field(min_length=1, description="bars by name, at least one")
    weld: Annotated[tuple[Weld, ...], Strict(False)] = Field(
        (), description='bars that are one rigid body, as in [["b1", "b2"], ["b3", "b4", "b5"]]'
    )
    strings: dict[Name, String] = Field(default_factory=dict, description="strings by name")
    point_masses: dict[str, NotNegative] = Field(
        default_factory=dict,
        description="node name = mass in kg that the node carries beside its bar's, 0 or more; greater than 0 for a free node "
        "on no bar",
    )
    drag: dict[str, NotNegative] = Field(
        default_factory=dict, description="free node's name = drag coefficient in N s/m, force per velocity, 0 or more"
    )
    velocities: dict[str, Velocity] = Field(
        default_factory=dict, description="node name = its start velocity [x, y, z] in m/s (two components in a planar scene)"
    )
    ground: Ground | None = _optional("a plane that nodes cannot pass")
    prestress: Prestress = Field(default_factory=Prestress, description="what is known of the strings at the given coordinates")

    _file: str = PrivateAttr("")
    _raw: dict = PrivateAttr(default_factory=dict)
    _origin: dict = PrivateAttr(default_factory=dict)

    @property
    def file(self) -> str:
        """Path of the file that was loaded."""
        return self._file

    @property
    def axes(self) -> tuple[int, ...]:
        """Coordinate axes in use: (0, 1, 2), or two of them in a planar scene."""
        return PLANES[self.plane]

    @property
    def held(self) -> dict[str, tuple[int, ...]]:
        """Node -> the axes along which `fixed` names it, rising: all that the scene uses, or some."""
        return self._along(self.fixed)

    @property
    def moved(self) -> dict[str, tuple[int, ...]]:
        """Node -> the axes along which `moving` names it, rising: all that the scene uses, or some."""
        return self._along(self.moving)

    def _along(self, named: tuple[str, ...]) -> dict[str, tuple[int, ...]]:
        found: dict[str, set[int]] = {}
        for name in named:
            node, _, axis = name.partition(".")
            found.setdefault(node, set()).update([i for i in self.axes if "xyz"[i] == axis] if axis else self.axes)
        return {node: tuple(sorted(axes)) for node, axes in found.items()}

    def vector(self, values: tuple[float, ...]) -> tuple[float, float, float]:
        """Components along the scene's axes as a vector in space."""
        found = [0.0, 0.0, 0.0]
        for axis, value in zip(self.axes, values):
            found[axis] = value
        return found[0], found[1], found[2]

    def position(self, node: str) -> tuple[float, float, float]:
        """Given coordinates (x, y, z) of a node, m."""
        return self.vector(self.nodes[node])

    def distance(self, ends: Sequence[str]) -> float:
        """Distance of two nodes at the given coordinates, m."""
        return math.dist(self.position(ends[0]), self.position(ends[1]))

    def stiffness(self, string: str) -> float | None:
        """k of a string, its own or its material's, N/m; None: neither is given."""
        own = self.strings[string].stiffness
        return own if own is not None or not self.strings[string].material else self._material(string).stiffness

    def damping(self, string: str) -> float:
        """d of a string, its own or its material's, N s/m; 0 where it has a damper."""
        if self.strings[string].damper is not None:
            return 0.0
        own = self.strings[string].damping
        if own is not None:
            return own
        return self._material(string).damping if self.strings[string].material else 0.0

    def strength(self, string: str) -> float | None:
        """Of a string, its own or its material's, N; None: not known."""
        own = self.strings[string].strength
        return own if own is not None or not self.strings[string].material else self._material(string).strength

    def element(self, name: str) -> ElementLaw:
        """The force law of this name, with its parts in place of their names."""
        entry = self.elements[name]
        made = elements.KINDS[entry.kind]
        given = {own.name: getattr(entry, elements.key_of(own)) for own in fields(made)}
        if "parts" in given:
            given["parts"] = tuple(self.element(part) for part in given["parts"])
        return elements.simplified(made(**{name: value for name, value in given.items() if value is not None}))

    def damper(self, name: str) -> DamperLaw:
        """The damper of this name."""
        entry = self.dampers[name]
        if entry.coefficients is not None:
            return elements.Polynomial(entry.coefficients)
        return elements.Table(entry.given("rate"), entry.given("force"), entry.interpolation or "linear")

    @property
    def touching(self) -> tuple[str, ...]:
        """Names of the nodes that may touch the ground, in the order of the nodes; none without a ground."""
        if self.ground is None:
            return ()
        named, held = self.ground.nodes, self.held
        return tuple(name for name in self.nodes if (name in named if named else held.get(name) != self.axes))

    def contact(self, node: str) -> dict[str, float]:
        """The numbers of the ground under a node, by the keys of [ground]."""
        ground: Any = self.ground
        own = ground.at.get(node)
        found = {}
        for key in Contact.model_fields:
            value = getattr(own, key, None)
            found[key] = getattr(ground, key) if value is None else value
        if found["tangential_stiffness"] is None:
            found["tangential_stiffness"] = found["stiffness"]
        return found

    def upward(self) -> tuple[float, float, float]:
        """The unit vector out of the ground."""
        given = self.vector(self.ground.normal) if self.ground and self.ground.normal else (0.0, 0.0, 1.0)
        largest = max(map(abs, given))  # so that no square overflows, or vanishes
        size = math.hypot(*(value / largest for value in given))
        return given[0] / largest / size, given[1] / largest / size, given[2] / largest / size

    def needs_stiffness(self, string: str) -> bool:
        """Whether the string's own stiffness acts: not where an element without end or memory replaces it."""
        name = self.strings[string].element
        return name is None or self.elements[name].law == "hysteretic" or self._ends(name)

    def _ends(self, name: str) -> bool:
        """Whether an element has a stop: a beam, a parallel of which one part has, a series of which all parts have."""
        entry = self.elements[name]
        if entry.kind in ("series", "parallel"):
            ends = [self._ends(part) for part in entry.parts]
            return all(ends) if entry.kind == "series" else any(ends)
        return elements.KINDS[entry.kind].stops

    def _material(self, string: str) -> Material:
        return self.materials[self.strings[string].given("material")]

    def error(self, key: str, problem: str, remedy: str, value: Any = None) -> SceneError:
        """The error for a key of this scene: fills in the file that holds the key, and its value."""
        place = place_of(key)
        shown = lookup(self._raw, place) if value is None else value
        return scene_files.error(self._file, self._origin, place, shown, problem, remedy)
