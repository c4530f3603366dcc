"""The scene file: its syntax, its checks, and the message for each mistake.

A scene is a TOML file in SI units (docs of every key: the descriptions below, published as scenes/scene.schema.json).
What can be judged without mechanics is judged here; what needs the equilibrium (prestress) is judged by `statics`.
"""

from __future__ import annotations

import difflib
import json
import math
from itertools import islice
from pathlib import Path
from typing import Annotated, Any, Iterator, Literal

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
    ValidationError,
)
from pydantic_core import PydanticCustomError

from . import costs, elements, scene_files
from .errors import SceneError
from .fields import owned_words
from .scene_files import BUILTIN_SCENES, EXTENDS_MEANING, IDENTIFIER, SCENE_FOLDER, lookup, place_of

#: Axes that a scene uses -> their places among x, y, z.
PLANES = {None: (0, 1, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}

#: Names that are not a component's: they stand at the top of the simulation's variables, or mean the time.
RESERVED_NAMES = ("energy", "solver", "gravity", "time")

#: Names that Windows keeps for devices, with any ending; a scene's name becomes the names of files.
DEVICES = ("con", "prn", "aux", "nul", *(f"{port}{i}" for port in ("com", "lpt") for i in range(1, 10)))

#: First words of the variables that a component owns (`n4.force.x`, `s1.rest_length`, ...).
VARIABLE_WORDS = owned_words()

SHORTEST = 1e-9  # m: below this a member has no usable direction
LONGEST_NAME = 128  # letters
MOST_LEVELS = 20  # of elements in each other
MOST_PARTS = 1000  # elements that one string may be made of
MOST_MEMORY = 12  # beams and other parts that snap in one series with memory
MOST_BEAMS = 60  # of an NSH without memory
MOST_POINTS = 50_000  # of all tables of a scene
MOST_COST = 4.0  # s, about what working out all force laws may take; see `costs`

Name = Annotated[str, StringConstraints(pattern=IDENTIFIER, max_length=LONGEST_NAME)]
#: One line of what XML 1.0 can hold, since a scene's texts go into an FMU's model description.
Text = Annotated[str, StringConstraints(pattern=r"^[^\x00-\x08\x0A-\x1F\uFFFE\uFFFF]*$", max_length=10_000)]


def _between(low: float, high: float, *more):
    return Annotated[float, Field(ge=low, le=high, allow_inf_nan=False), *more]


def _not_tiny(least: float) -> AfterValidator:
    """Sizes below this are refused but for 0: nothing would be left of their squares and cubes."""

    def check(value: float) -> float:
        if 0.0 < abs(value) < least:
            raise PydanticCustomError("tiny", "is closer to 0 than {least} without being 0", {"least": least})
        return value

    return AfterValidator(check)


# What no structure has is refused here, so that squares, cubes and ratios of what is left are numbers.  SI units.
Coordinate = _between(-1e6, 1e6)
Positive = _between(1e-15, 1e15)
NotNegative = _between(0.0, 1e15, _not_tiny(1e-15))
Component = _between(-1e9, 1e9)
ForceScale = _between(*elements.BEAM_RANGES["Q"])
Shape = _between(*elements.BEAM_RANGES["zeta"])
Length = _between(*elements.BEAM_RANGES["h"])
RestLength = _between(0.0, 1e7)
Point = Annotated[tuple[Coordinate, ...], Strict(False), Field(min_length=2, max_length=3)]
Ends = Annotated[tuple[str, str], Strict(False)]
Scales = Annotated[tuple[ForceScale, ...], Strict(False), Field(min_length=1, max_length=MOST_BEAMS)]
Zetas = Annotated[tuple[Shape, ...], Strict(False), Field(min_length=1, max_length=MOST_BEAMS)]
Heights = Annotated[tuple[Length, ...], Strict(False), Field(min_length=1, max_length=MOST_BEAMS)]
#: A number or a vector; the tags tell pydantic which of the two to check, and stand in the places of its findings.
Gravity = Annotated[
    Annotated[_between(0.0, 1e9), Tag("[number]")]
    | Annotated[tuple[Component, Component, Component], Strict(False), Tag("[vector]")],
    Discriminator(lambda value: "[vector]" if isinstance(value, (list, tuple)) else "[number]"),
]
Coefficients = Annotated[tuple[_between(-1e15, 1e15, _not_tiny(1e-15)), ...], Strict(False), Field(min_length=1, max_length=7)]
Abscissas = Annotated[tuple[_between(0.0, 1e6, _not_tiny(1e-12)), ...], Strict(False), Field(min_length=2)]
Forces = Annotated[tuple[_between(-1e12, 1e12, _not_tiny(1e-15)), ...], Strict(False), Field(min_length=2)]
Names = Annotated[tuple[str, ...], Strict(False), Field(min_length=1)]
SeriesLaw = Literal["single_valued", "hysteretic"]
Shapes = Literal["metastable", "any"]
Interpolation = Literal["linear", "cubic"]


class Entry(BaseModel):
    """A table of the scene file: no unknown keys, no silent conversions."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, title=None)


class Material(Entry):
    """What strings are made of."""

    stiffness: Positive = Field(description="stiffness k in N/m, a number greater than 0")
    damping: NotNegative = Field(0.0, description="damping d in N s/m, 0 or more")


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


class Element(Entry):
    """A force law of strings, and what it is made of; which keys belong to it depends on its kind."""

    kind: Literal["spring", "beam", "polynomial", "table", "series", "parallel"] = Field(
        description='"spring", "beam", "polynomial", "table", "series" or "parallel"'
    )
    stiffness: Positive | None = Field(None, description="of a spring: its stiffness in N/m, greater than 0")
    Q: ForceScale | None = Field(None, description="of a beam: its force scale in N, greater than 0")
    zeta: Shape | None = Field(None, description="of a beam: its shape parameter, between 2 and 8 (metastable)")
    h: Length | None = Field(None, description="of a beam: its arch height in m, greater than 0")
    beams: Shapes | None = Field(None, description='of a beam: "metastable" (2 < zeta < 8, the default) or "any"')
    coefficients: Coefficients | None = Field(
        None, description="of a polynomial: 1 to 7 coefficients of x, x^2, ... in N/m, N/m2, ..."
    )
    elongation: Abscissas | None = Field(None, description="of a table: elongations in m, increasing from 0, at least two")
    force: Forces | None = Field(None, description="of a table: the force in N at each elongation, the first 0")
    interpolation: Interpolation | None = Field(
        None, description='of a table: "linear" (the default) or "cubic" (smooth, and monotone between the points)'
    )
    parts: Names | None = Field(None, description="of a series or parallel: names of its parts, at least one; names may repeat")
    law: SeriesLaw | None = Field(
        None, description='of a series: "single_valued" (the default) or "hysteretic" (with memory; not as a part of another)'
    )


class Damper(Entry):
    """A damper whose force is not proportional to the rate of elongation: by coefficients, or by points."""

    coefficients: Coefficients | None = Field(
        None, description="1 to 7 coefficients of v, v^2, ... in N s/m, N s2/m2, ..., v the size of the rate of elongation"
    )
    rate: Abscissas | None = Field(None, description="rates of elongation in m/s, increasing from 0, at least two")
    force: Forces | None = Field(None, description="the force in N at each rate, the first 0")
    interpolation: Interpolation | None = Field(
        None, description='between points: "linear" (the default) or "cubic" (smooth, and monotone between the points)'
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
    mass: Positive = Field(description="mass in kg, a number greater than 0")


class String(Entry):
    """A massless string, tension only."""

    nodes: Ends = Field(description='nodes at the two ends, as in ["n1", "n4"]')
    material: str | None = Field(None, description="name of one of the [materials]")
    stiffness: Positive | None = Field(
        None, description="stiffness k in N/m, greater than 0, instead of the material's"
    )
    damping: NotNegative | None = Field(None, description="damping d in N s/m, 0 or more, instead of the material's")
    nsh: str | None = Field(
        None,
        description="name of one of the [nsh]: its force curve replaces the stiffness, "
        "which acts once it has bottomed out",
    )
    actuator: str | None = Field(None, description="name of one of the [actuators]: it winds the string in")
    element: str | None = Field(None, description="name of one of the [elements]: the string's force law, instead of an nsh")
    damper: str | None = Field(None, description="name of one of the [dampers], instead of a damping")


class Prestress(Entry):
    """What is known of the strings at the given coordinates; the equilibrium gives the rest."""

    tension: dict[str, NotNegative] = Field(
        default_factory=dict, description="string name = tension in N at the given coordinates, 0 or more"
    )
    rest_length: dict[str, RestLength] = Field(
        default_factory=dict, description="string name = rest length in m, 0 or more"
    )


class Scene(Entry):
    """A checked scene.  Fields are the keys of the file; treat it and what it holds as read-only.

    Make one with `load_scene` or `parse_scene`: they run the checks that need more than one key.
    """

    name: Name = Field(description="name of the scene, an identifier; without it the file's name")
    description: Text = Field("", description="one line for humans, without control characters")
    source: Text = Field("", description="where the numbers come from, one line without control characters")
    gravity: Gravity = Field(9.81, description="gravity in m/s2: a number, 0 or more, towards -z, or a vector [x, y, z]")
    plane: Literal["xz", "yz", "xy"] | None = Field(
        None, description='"xz", "yz" or "xy" for a planar scene, whose nodes have two coordinates'
    )
    damping_law: Literal["literal", "tension_only"] = Field(
        "literal", description='"literal" (the damper may push while a string shortens) or "tension_only"'
    )
    start: Literal["equilibrium", "settled", "released"] = Field(
        "equilibrium",
        description='"equilibrium" (the given coordinates must balance), "settled" (the stable equilibrium near them) '
        'or "released" (at rest there, balanced or not)',
    )
    fixed: Annotated[tuple[str, ...], Strict(False)] = Field((), description="names of the nodes fixed to the ground")
    moving: Annotated[tuple[str, ...], Strict(False)] = Field(
        (), description="names of the fixed nodes whose motion is an input"
    )
    nodes: dict[Name, Point] = Field(description="node name = [x, y, z] in m (two coordinates in a planar scene)")
    materials: dict[Name, Material] = Field(default_factory=dict, description="materials of strings by name")
    nsh: dict[Name, Honeycomb] = Field(default_factory=dict, description="NSHs by name")
    actuators: dict[Name, Actuator] = Field(default_factory=dict, description="actuators of strings by name")
    elements: dict[Name, Element] = Field(default_factory=dict, description="force laws of strings, and their parts, by name")
    dampers: dict[Name, Damper] = Field(default_factory=dict, description="dampers that are not linear, by name")
    bars: dict[Name, Bar] = Field(min_length=1, description="bars by name, at least one")
    strings: dict[Name, String] = Field(default_factory=dict, description="strings by name")
    point_masses: dict[str, NotNegative] = Field(
        default_factory=dict, description="node name = mass in kg that the node carries beside its bar's, 0 or more; greater than 0 for a free node on no bar"
    )
    drag: dict[str, NotNegative] = Field(
        default_factory=dict, description="free node's name = drag coefficient in N s/m, force per velocity, 0 or more"
    )
    prestress: Prestress = Field(
        default_factory=Prestress, description="what is known of the strings at the given coordinates"
    )

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

    def position(self, node: str) -> tuple[float, float, float]:
        """Given coordinates (x, y, z) of a node, m."""
        point = [0.0, 0.0, 0.0]
        for axis, value in zip(self.axes, self.nodes[node]):
            point[axis] = value
        return tuple(point)

    def distance(self, ends: tuple[str, str]) -> float:
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

    def element(self, name: str) -> elements.Element:
        """The force law of this name, with its parts in place of their names."""
        entry = self.elements[name]
        if entry.kind == "spring":
            return elements.Spring(entry.stiffness)
        if entry.kind == "beam":
            return elements.Beam(entry.Q, entry.zeta, entry.h)
        if entry.kind == "polynomial":
            return elements.Polynomial(entry.coefficients)
        if entry.kind == "table":
            return elements.Table(entry.elongation, entry.force, entry.interpolation or "linear")
        parts = tuple(self.element(part) for part in entry.parts)
        grouped = elements.Parallel(parts) if entry.kind == "parallel" else elements.Series(parts, entry.law or "single_valued")
        return elements.simplified(grouped)

    def damper(self, name: str) -> elements.Damper:
        """The damper of this name."""
        entry = self.dampers[name]
        if entry.coefficients is not None:
            return elements.Polynomial(entry.coefficients)
        return elements.Table(entry.rate, entry.force, entry.interpolation or "linear")

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
        return entry.kind == "beam"

    def _material(self, string: str) -> Material:
        return self.materials[self.strings[string].material]

    def error(self, key: str, problem: str, remedy: str, value: Any = None) -> SceneError:
        """The error for a key of this scene: fills in the file that holds the key, and its value."""
        place = place_of(key)
        shown = lookup(self._raw, place) if value is None else value
        return scene_files.error(self._file, self._origin, place, shown, problem, remedy)


# --- loading -----------------------------------------------------------------------------------------------------


def builtin_scenes() -> tuple[str, ...]:
    """Names of the scenes that come with the package."""
    return BUILTIN_SCENES


def load_scene(name_or_path: str | Path) -> Scene:
    """Load a built-in scene by its name, or any scene by its path (which ends in .toml).

    Raises SceneError for a scene that cannot become a model.
    """
    path = _find(name_or_path)
    raw, origin = scene_files.read(path)
    return _checked({"name": path.stem} | raw, origin, str(path))


def parse_scene(data: dict[str, Any], file: str = "<data>") -> Scene:
    """Check a scene given as nested dicts, the form that the TOML file has; `file` is what error messages call it."""
    if not isinstance(data, dict):
        raise SceneError(file, "(scene)", data, "is not a table", "Give a dict with the keys of a scene file.")
    raw, origin = scene_files.extended(data, Path(file))
    return _checked(raw, origin, file)


def _checked(raw: dict, origin: scene_files.Origin, file: str) -> Scene:
    try:
        scene = Scene.model_validate(raw)
    except ValidationError as failure:
        raise _translated(failure, raw, origin, file) from None
    scene._file, scene._raw, scene._origin = file, raw, origin
    for check in CHECKS:
        for error in check(scene):
            raise error
    return scene


def _find(name_or_path: str | Path) -> Path:
    text = str(name_or_path)
    if text in BUILTIN_SCENES:
        return SCENE_FOLDER / f"{text}.toml"
    if not text.endswith(".toml"):
        close = _close(text, BUILTIN_SCENES)
        remedy = f"Did you mean {close[0]}? " if close else ""
        remedy += f"Give a path that ends in .toml, or one of {', '.join(BUILTIN_SCENES)}."
        raise SceneError(text, "(scene)", text, "is neither a built-in scene nor a .toml file", remedy)
    return Path(text)


# --- messages ----------------------------------------------------------------------------------------------------


def _translated(failure: ValidationError, raw: dict, origin: dict, file: str) -> SceneError:
    """The first of pydantic's findings in our own words; unknown keys come first, since a misspelt key is missing, too."""
    findings = failure.errors(include_url=False)
    finding = next((one for one in findings if one["type"] == "extra_forbidden"), findings[0])
    place, kind = tuple(part for part in finding["loc"] if part != "[key]"), finding["type"]
    if place[0] == "gravity":
        place = tuple(part for part in place if part not in ("[number]", "[vector]"))
    is_key = finding["loc"][-1] == "[key]"
    owner, field = _described(place)
    value = place[-1] if is_key else lookup(raw, place)
    if is_key and kind == "string_too_long":
        problem, remedy = _problem(kind, finding, value), "Choose a shorter name."
    elif is_key:
        problem, remedy = "is not an identifier", "Start with an ASCII letter; go on with letters, digits and _."
    elif kind == "extra_forbidden":
        problem = "is not a key of a scene file"
        close = _close(str(place[-1]), owner.model_fields)
        hint = f"Did you mean {close[0]}? " if close else ""
        remedy = f"{hint}Keys here: {', '.join(owner.model_fields)}."
    else:
        problem = _problem(kind, finding, value)
        remedy = f"Give {field.description}."
    if kind == "missing" and isinstance(place[-1], int):  # a pair with one end
        place = place[:-1]
        value, problem = lookup(raw, place), "has too few entries"
    return scene_files.error(file, origin, place, value, problem, remedy)


def _problem(kind: str, finding: dict, value: Any) -> str:
    context = finding.get("ctx", {})
    if kind == "greater_than_equal" and context["ge"] > 0.0 >= value:
        return "is not greater than 0"
    known = {
        "missing": "is missing",
        "finite_number": "is not a finite number",
        "float_type": "is not a number",
        "string_type": "is not a text",
        "tuple_type": "is not a list",
        "dict_type": "is not a table",
        "model_type": "is not a table",
        "greater_than": "is not greater than {gt}",
        "greater_than_equal": "is less than {ge}",
        "less_than_equal": "is greater than {le}",
        "too_short": "has too few entries",
        "too_long": "has too many entries",
        "literal_error": "is not one of {expected}",
        "string_too_long": "has more than {max_length} letters",
        "string_pattern_mismatch": "has a form that is not allowed",
    }
    return known[kind].format(**context) if kind in known else finding["msg"]


def _described(place: tuple) -> tuple[type[Entry], Any]:
    """The table that holds a place, and the field whose description says what belongs there."""
    owner, field = Scene, None
    tables = {"materials": Material, "nsh": Honeycomb, "elements": Element, "dampers": Damper, "actuators": Actuator}
    tables |= {"bars": Bar, "strings": String}
    for depth, part in enumerate(place):
        if isinstance(part, str) and part in owner.model_fields:
            field = owner.model_fields[part]
        if depth == 0 and part == "prestress":
            owner = Prestress if len(place) > 1 else owner
        elif depth == 1 and place[0] in tables:
            owner = tables[place[0]] if len(place) > 2 else owner
    return owner, field


# --- checks that need more than one key --------------------------------------------------------------------------


def _check_names(scene: Scene) -> Iterator[SceneError]:
    if scene.name.lower() in DEVICES:
        yield scene.error("name", "is a device's name on Windows, where no file can have it", "Give the scene another name.")
    kinds = {"nodes": scene.nodes, "bars": scene.bars, "strings": scene.strings}
    seen: dict[str, str] = {}
    for kind, table in kinds.items():
        for name in table:
            if name in RESERVED_NAMES:
                yield scene.error(f"{kind}.{name}", f"{name} is a reserved name", "Rename it.")
            if name in seen:
                yield scene.error(f"{kind}.{name}", f"{seen[name]} has the same name", "Rename one of the two.")
            seen[name] = f"{kind}.{name}"
    for name, key in seen.items():
        for at, letter in enumerate(name):
            # n4.force.x and a node n4_force would both flatten to n4_force_x
            head, tail = name[:at], name[at + 1 :]
            if letter == "_" and (head in seen or head in RESERVED_NAMES) and _is_variable(head, tail):
                problem = f"reads like a variable of {seen.get(head, head)} once dots become underscores"
                yield scene.error(key, problem, f"Rename it so that it does not start with {head}_.")


def _is_variable(head: str, tail: str) -> bool:
    return head in RESERVED_NAMES or tail.split("_")[0] in VARIABLE_WORDS


def _check_coordinates(scene: Scene) -> Iterator[SceneError]:
    letters = scene.plane or "xyz"
    if isinstance(scene.gravity, tuple):
        for at, (axis, value) in enumerate(zip("xyz", scene.gravity), 1):
            if axis not in letters and value != 0.0:
                problem = f"gravity acts along {axis}, across the plane {letters}"
                yield scene.error(f"gravity[{at}]", problem, f"Write 0 for {axis}, or choose another plane.", value)
    elif scene.plane == "xy" and scene.gravity != 0.0:
        problem = "gravity acts along -z, across the plane xy"
        remedy = "Write gravity = 0, give a vector [x, y, 0], or choose the plane xz or yz."
        yield scene.error("gravity", problem, remedy, scene.gravity)
    for name, point in scene.nodes.items():
        if len(point) != len(letters):
            kind = f"planar scene ({scene.plane})" if scene.plane else "3D scene"
            problem = f"has {len(point)} coordinates in a {kind}"
            yield scene.error(f"nodes.{name}", problem, f"Give {len(letters)}: [{', '.join(letters)}].")


def _check_references(scene: Scene) -> Iterator[SceneError]:
    for at, name in enumerate(scene.fixed, 1):
        if name not in scene.nodes:
            yield scene.error(f"fixed[{at}]", "is no node", _choose(name, scene.nodes))
    yield from _twice(scene, "fixed", scene.fixed)
    for kind, members in (("bars", scene.bars), ("strings", scene.strings)):
        for name, member in members.items():
            for at, node in enumerate(member.nodes, 1):
                if node not in scene.nodes:
                    yield scene.error(f"{kind}.{name}.nodes[{at}]", "is no node", _choose(node, scene.nodes))
    for name, string in scene.strings.items():
        tables = {"material": "materials", "nsh": "nsh", "element": "elements", "damper": "dampers", "actuator": "actuators"}
        for key, table in tables.items():
            wanted, held = getattr(string, key), getattr(scene, table)
            if wanted is not None and wanted not in held:
                yield scene.error(f"strings.{name}.{key}", f"is not in [{table}]", _choose(wanted, held))
        for one, other in (("element", "nsh"), ("damper", "damping")):
            if getattr(string, one) is not None and getattr(string, other) is not None:
                yield scene.error(f"strings.{name}.{one}", f"the string has {other} too", "Keep one of the two.")
        if scene.stiffness(name) is None and scene.needs_stiffness(name):
            remedy = "Give material (a name in [materials]) or stiffness."
            yield scene.error(f"strings.{name}", "has no stiffness", remedy)
    for key in ("tension", "rest_length"):
        for name in getattr(scene.prestress, key):
            if name not in scene.strings:
                yield scene.error(f"prestress.{key}.{name}", "is no string", _choose(name, scene.strings))
            if name in scene.prestress.tension and name in scene.prestress.rest_length:
                problem = "the string has both a tension and a rest length"
                yield scene.error(f"prestress.{key}.{name}", problem, "Keep one of the two.")


def _twice(scene: Scene, key: str, names: tuple[str, ...]) -> Iterator[SceneError]:
    seen: set[str] = set()
    for at, name in enumerate(names, 1):
        if name in seen:
            yield scene.error(f"{key}[{at}]", "is listed twice", "Remove one of the two.")
        seen.add(name)


def _choose(wanted: str, names) -> str:
    close = _close(wanted, names)
    if close:
        return f"Did you mean {close[0]}?"
    listed = list(islice(names, 13))
    shown = ", ".join(listed[:12]) + (", ..." if len(listed) > 12 else "")
    return f"Choose from: {shown}." if listed else "There is none yet: add it."


def _close(wanted: str, names) -> list[str]:
    """The name that is most like a wanted one, if any is; not looked for where that would take long."""
    if len(wanted) > LONGEST_NAME or len(names) > 5000:
        return []
    return difflib.get_close_matches(wanted, list(names), 1)


def _check_members(scene: Scene) -> Iterator[SceneError]:
    owner: dict[str, str] = {}
    fixed = set(scene.fixed)
    for kind, members in (("bars", scene.bars), ("strings", scene.strings)):
        for name, member in members.items():
            key = f"{kind}.{name}.nodes"
            if member.nodes[0] == member.nodes[1]:
                yield scene.error(key, "starts and ends at the same node", "Join two different nodes.")
            if scene.distance(member.nodes) < SHORTEST:
                problem = f"has zero length: both nodes are at {scene.nodes[member.nodes[0]]}"
                yield scene.error(key, problem, "Move one of the nodes.")
    for name, bar in scene.bars.items():
        for node in bar.nodes:
            if node in owner:
                problem = f"{node} is on bar {owner[node]} already"
                remedy = "Only one bar may meet a node (class 1): join bars by strings between their own nodes."
                yield scene.error(f"bars.{name}.nodes", problem, remedy)
            owner[node] = name
        if all(node in fixed for node in bar.nodes):
            problem = "both ends are fixed, so the bar cannot move"
            yield scene.error(f"bars.{name}.nodes", problem, "Free one end, or leave the bar out.")
    for node in scene.nodes:
        if node not in owner and node not in fixed and not scene.point_masses.get(node):
            problem = "is neither fixed nor on a bar, so it has no mass"
            yield scene.error(f"nodes.{node}", problem, "Put it on a bar, give it a point mass, or list it in fixed.")


def _check_honeycombs(scene: Scene) -> Iterator[SceneError]:
    total = 0.0
    for name, nsh in scene.nsh.items():
        if nsh.law == "hysteretic" and len(nsh.Q) > MOST_MEMORY:
            yield scene.error(f"nsh.{name}.Q", f"has {len(nsh.Q)} beams", f"Use at most {MOST_MEMORY} in an NSH with memory.")
        for key in ("zeta", "h"):
            if len(getattr(nsh, key)) != len(nsh.Q):
                problem = f"has {len(getattr(nsh, key))} beams where Q has {len(nsh.Q)}"
                yield scene.error(f"nsh.{name}.{key}", problem, "Give one value per beam in each of Q, zeta and h.")
        for at, zeta in enumerate(nsh.zeta, 1):
            key = f"nsh.{name}.zeta[{at}]"
            yield from _beam_errors(scene, key, zeta, nsh.beams)
            if zeta >= 8.0 and nsh.law == "single_valued":
                problem = "makes the beam bistable, which means nothing without memory: its force falls below 0"
                yield scene.error(key, problem, 'Write law = "hysteretic", or choose zeta < 8.')
            if zeta <= 2.0 and nsh.law == "single_valued":
                problem = "makes the beam monotone, which an NSH without memory does not know"
                yield scene.error(key, problem, 'Write law = "hysteretic", or a series of such beams in [elements].')
        users = {scene.stiffness(string) for string, one in scene.strings.items() if one.nsh == name}
        total += costs.honeycomb(len(nsh.Q), nsh.law) * (len(users) if nsh.law == "hysteretic" else bool(users))
        if total > MOST_COST:
            problem = "takes too long to work out, here or with those before it"
            yield scene.error(f"nsh.{name}.Q", problem, "Use fewer beams, or fewer different ones.")


def _check_loads(scene: Scene) -> Iterator[SceneError]:
    """Point masses, drag and moved nodes."""
    fixed = set(scene.fixed)
    for key in ("point_masses", "drag"):
        for name in getattr(scene, key):
            if name not in scene.nodes:
                yield scene.error(f"{key}.{name}", "is no node", _choose(name, scene.nodes))
            if key == "drag" and name in fixed:
                yield scene.error(f"drag.{name}", "the node is fixed, so it has no drag", "Name a free node, or leave it out.")
    for at, name in enumerate(scene.moving, 1):
        if name not in scene.nodes:
            yield scene.error(f"moving[{at}]", "is no node", _choose(name, scene.fixed))
        if name not in fixed:
            problem = "is a free node, which moves by itself"
            yield scene.error(f"moving[{at}]", problem, "List it in fixed, too, or leave it out.")
    yield from _twice(scene, "moving", scene.moving)


def _beam_errors(scene: Scene, key: str, zeta: float, beams: str | None) -> Iterator[SceneError]:
    if beams != "any" and not 2.0 < zeta < 8.0:
        kind = "monotone (it never snaps)" if zeta <= 2.0 else "bistable (it does not return)"
        remedy = 'Choose 2 < zeta < 8 (metastable), or write beams = "any".'
        yield scene.error(key, f"makes the beam {kind}", remedy)


#: Kind of element -> the keys that it must have, and those that it may have.
ELEMENT_KEYS = {
    "spring": (("stiffness",), ()),
    "beam": (("Q", "zeta", "h"), ("beams",)),
    "polynomial": (("coefficients",), ()),
    "table": (("elongation", "force"), ("interpolation",)),
    "series": (("parts",), ("law",)),
    "parallel": (("parts",), ()),
}


def _check_elements(scene: Scene) -> Iterator[SceneError]:
    for name, entry in scene.elements.items():
        must, may = ELEMENT_KEYS[entry.kind]
        yield from _key_errors(scene, f"elements.{name}", entry, f"a {entry.kind}", ("kind", *must), may)
        if entry.kind == "beam":
            yield from _beam_errors(scene, f"elements.{name}.zeta", entry.zeta, entry.beams)
        if entry.kind == "table":
            yield from _point_errors(scene, f"elements.{name}", "elongation", entry.elongation, entry.force)
        for at, part in enumerate(entry.parts or (), 1):
            key = f"elements.{name}.parts[{at}]"
            if part not in scene.elements:
                yield scene.error(key, "is not in [elements]", _choose(part, scene.elements))
            if scene.elements[part].law == "hysteretic":
                problem = "has memory, which only the outermost element of a string may have"
                yield scene.error(key, problem, f'Write law = "single_valued" in [elements.{part}].')
    size: dict[str, int] = {}
    for name in scene.elements:
        yield from _tree_errors(scene, name, (), size)
        if sum(size.values()) > 100 * MOST_PARTS:
            problem = f"makes more than {100 * MOST_PARTS} parts with the elements before it"
            yield scene.error(f"elements.{name}", problem, "Leave out elements that nothing uses.")


def _tree_errors(scene: Scene, name: str, above: tuple[str, ...], size: dict[str, int]) -> Iterator[SceneError]:
    """Circles, and trees that are too large; size: the parts of the elements that have been looked at."""
    size[name] = 1
    for at, part in enumerate(scene.elements[name].parts or (), 1):
        if part in (*above, name):
            problem = f"closes a circle: {' -> '.join((*above, name, part))}"
            yield scene.error(f"elements.{name}.parts[{at}]", problem, "Name an element outside it.")
        if len(above) >= MOST_LEVELS:
            problem = f"is more than {MOST_LEVELS} elements deep in {above[0]}"
            yield scene.error(f"elements.{name}.parts[{at}]", problem, "Put the parts of a series or parallel into the outer one.")
        if part not in size:
            yield from _tree_errors(scene, part, (*above, name), size)
        size[name] += size[part]
    if size[name] > MOST_PARTS:
        yield scene.error(f"elements.{name}.parts", f"makes {size[name]} parts", f"Use at most {MOST_PARTS}.")


def _check_costs(scene: Scene) -> Iterator[SceneError]:
    """Laws that would take too long to work out: each once, with memory once per stiffness."""
    total = 0.0
    for name, entry in scene.elements.items():
        element = scene.element(name)
        remedy = "Use fewer parts, or put the parts of a series or parallel into the outer one."
        if entry.law == "hysteretic" and costs.snapping(element) > MOST_MEMORY:
            problem = f"has {costs.snapping(element)} beams and other parts that may snap"
            yield scene.error(f"elements.{name}.parts", problem, f"Use at most {MOST_MEMORY} in a series with memory.")
        stiffnesses = {scene.stiffness(string) for string, one in scene.strings.items() if one.element == name}
        total += costs.seconds(element) * (max(1, len(stiffnesses)) if entry.law == "hysteretic" else 1)
        if total > MOST_COST:
            problem = "takes too long to work out, here or with the elements before it"
            yield scene.error(f"elements.{name}", problem, remedy)


def _check_dampers(scene: Scene) -> Iterator[SceneError]:
    for name, entry in scene.dampers.items():
        if entry.coefficients is not None:
            yield from _key_errors(scene, f"dampers.{name}", entry, "a damper with coefficients", ("coefficients",), ())
        elif entry.rate is None and entry.force is None:
            yield scene.error(f"dampers.{name}", "has no law", "Give coefficients, or rate and force.")
        else:
            keys = ("rate", "force"), ("interpolation",)
            yield from _key_errors(scene, f"dampers.{name}", entry, "a damper with points", *keys)
            yield from _point_errors(scene, f"dampers.{name}", "rate", entry.rate, entry.force)


def _check_points(scene: Scene) -> Iterator[SceneError]:
    """Tables that are too long to be worked out soon."""
    lists = [(f"elements.{name}.elongation", entry.elongation) for name, entry in scene.elements.items()]
    total = 0
    for key, points in lists + [(f"dampers.{name}.rate", entry.rate) for name, entry in scene.dampers.items()]:
        total += len(points or ())
        if total > MOST_POINTS:
            problem = f"makes {total} points of tables in this scene, more than {MOST_POINTS}"
            yield scene.error(key, problem, 'Leave out points; interpolation = "cubic" needs fewer for a smooth curve.')


def _key_errors(scene: Scene, key: str, entry: Entry, what: str, must: tuple, may: tuple) -> Iterator[SceneError]:
    """Keys that are missing in a table, or that belong to another kind."""
    for field, about in type(entry).model_fields.items():
        given = getattr(entry, field) is not None
        if field in must and not given:
            yield scene.error(f"{key}.{field}", f"is missing in {what}", f"Give {about.description}.")
        if given and field not in must and field not in may:
            yield scene.error(f"{key}.{field}", f"does not belong to {what}", f"Keys here: {', '.join((*must, *may))}.")


def _point_errors(scene: Scene, key: str, along: str, x: tuple, f: tuple) -> Iterator[SceneError]:
    if len(x) != len(f):
        problem = f"has {len(f)} values where {along} has {len(x)}"
        yield scene.error(f"{key}.force", problem, f"Give one force per {along}.")
    for field, first in ((along, x[0]), ("force", f[0])):
        if first != 0.0:
            yield scene.error(f"{key}.{field}[1]", "is not 0", "Let both lists start with 0.")
    for at, (before, after) in enumerate(zip(x, x[1:]), 2):
        if not after > before:
            yield scene.error(f"{key}.{along}[{at}]", f"does not exceed the value before it, {before!r}", "Sort the points.")
        if after - before < 1e-12:
            problem = f"exceeds the value before it, {before!r}, by less than 1e-12"
            yield scene.error(f"{key}.{along}[{at}]", problem, "Leave out one of the two points.")


CHECKS = (_check_names, _check_coordinates, _check_points, _check_elements, _check_dampers, _check_references, _check_members,
          _check_honeycombs, _check_loads, _check_costs)


# --- the schema --------------------------------------------------------------------------------------------------


def scene_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of the scene file, for editors.

    A file with `extends` may leave out any key, so "required" holds only without it.
    """
    schema = _tidied(Scene.model_json_schema())
    definitions = schema.pop("$defs")
    complete = _requirements(schema, definitions)
    complete["required"] = [key for key in complete["required"] if key != "name"]  # the file's name serves
    for table in (schema, *definitions.values()):
        table.pop("required", None)
    schema["properties"] = {
        "extends": {
            "anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}, "minItems": 1}],
            "description": EXTENDS_MEANING,
        },
        **schema["properties"],
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **schema,
        "title": "Tensegrity scene",
        "description": "A tensegrity structure in SI units.",
        "if": {"not": {"required": ["extends"]}},
        "then": complete,
        "$defs": definitions,
    }


def _tidied(schema: Any) -> Any:
    """The same without generated titles and nulls (TOML has none), and with names that fit no pattern refused."""
    if isinstance(schema, list):
        return [_tidied(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    tidy = {key: _tidied(part) for key, part in schema.items() if not (key == "title" and isinstance(part, str))}
    choices = [choice for choice in tidy.get("anyOf", ()) if choice != {"type": "null"}]
    if len(choices) == 1:
        del tidy["anyOf"]
        tidy = choices[0] | tidy
    if tidy.get("default", ...) is None:
        del tidy["default"]
    if "patternProperties" in tidy:
        tidy["additionalProperties"] = False
    return tidy


def _requirements(schema: dict, definitions: dict) -> dict:
    """Only the "required" parts of a schema, references followed."""
    if "$ref" in schema:
        schema = definitions[schema["$ref"].rsplit("/", 1)[1]]
    found: dict[str, Any] = {"required": schema["required"]} if "required" in schema else {}
    inner = {key: _requirements(part, definitions) for key, part in schema.get("properties", {}).items()}
    if any(inner.values()):
        found["properties"] = {key: part for key, part in inner.items() if part}
    for key in ("additionalProperties", "patternProperties"):
        if isinstance(schema.get(key), dict):
            part = schema[key]
            nested = (
                {pattern: _requirements(value, definitions) for pattern, value in part.items()}
                if key == "patternProperties"
                else _requirements(part, definitions)
            )
            if any(nested.values()):
                found[key] = nested
    return found


def schema_text() -> str:
    """The schema as it stands in scenes/scene.schema.json."""
    return json.dumps(scene_schema(), indent=2, sort_keys=False) + "\n"
