"""The model that starts where a scene says, in equilibrium."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import laws
from ..errors import InputError
from ..laws import hysteresis
from ..model import NSH, Actuator, Contact, Ground, Model
from ..model.elements import remembers
from . import simulable
from .matrices import TooLarge
from .prestress import prestress, require_balance, rest_lengths, two_parts
from .settling import NoEquilibrium, settle
from .strings import string_tension
from .velocities import start_velocities

if TYPE_CHECKING:
    from ..scene import Scene


def build_model(scene: Scene) -> Model:
    """The scene's structure at its start, with the rest lengths that its prestress asks for.

    Raises SceneError where the prestress is undetermined, a string would have to push, a rest length would be
    negative, no equilibrium exists, or the model cannot be simulated (see `simulable`).
    """
    _require_laws(scene)
    model = _at_given_coordinates(scene)
    tension = prestress(scene, model)
    model = replace(model, rest_length=rest_lengths(scene, model, tension))
    if scene.start == "equilibrium":
        require_balance(scene, model)
    if scene.start == "settled":
        try:
            model = settle(model)
        except (NoEquilibrium, TooLarge, hysteresis.NoStableState) as failure:
            remedy = 'Change the prestress or the coordinates, or write start = "released".'
            raise scene.error("start", str(failure), remedy, scene.start) from None
    if scene.velocities:
        model = replace(model, velocity=start_velocities(scene, model))
    model = replace(model, current=_holding_currents(model))
    simulable.require(scene, model)
    return model


def _holding_currents(model: Model) -> np.ndarray:
    """(A,) A: the currents that hold the start tensions, i = r T / k_a."""
    tension = string_tension(model, model.string_lengths(model.nodes))
    return np.array([motor.radius * tension[i] / motor.torque_constant for i, motor in model.motors.items()])


def _require_laws(scene: Scene) -> None:
    """Work out every element, of a string or not, and every damper; raise SceneError for one that has no force law."""
    for name in scene.elements:
        try:
            element = scene.element(name)
            laws.element_law(element, 1.0) if remembers(element) else laws.part_law(element)
        except InputError as failure:
            raise scene.error(f"elements.{name}", *two_parts(failure)) from None
    for name in scene.dampers:
        try:
            laws.damping(scene.damper(name))
        except InputError as failure:
            raise scene.error(f"dampers.{name}", *two_parts(failure)) from None
    for name, string in scene.strings.items():
        try:
            if string.element is not None:
                laws.element_law(scene.element(string.element), 1.0)
        except InputError as failure:
            raise scene.error(f"strings.{name}.element", *two_parts(failure)) from None


def _stiffness(scene: Scene, string: str) -> float:
    """k of a string, N/m; where nothing uses one, that of its element as it begins to stretch."""
    given = scene.stiffness(string)
    if given is not None:
        return given
    return laws.law(scene.element(scene.strings[string].given("element"))).stiffness(1e-300) or 1.0


def _at_given_coordinates(scene: Scene) -> Model:
    index = {name: i for i, name in enumerate(scene.nodes)}
    nodes = np.array([scene.position(name) for name in scene.nodes])
    fixed = set(scene.fixed)
    honeycombs = {name: NSH(entry.Q, entry.zeta, entry.h, entry.law) for name, entry in scene.nsh.items()}
    elements = {name: scene.element(name) for name in scene.elements}
    dampers = {name: scene.damper(name) for name in scene.dampers}
    bars = list(scene.bars)
    actuators = {name: Actuator(**entry.model_dump()) for name, entry in scene.actuators.items()}
    return Model(
        name=scene.name,
        description=scene.description,
        axes=scene.axes,
        node_names=tuple(scene.nodes),
        bar_names=tuple(scene.bars),
        string_names=tuple(scene.strings),
        nodes=nodes,
        fixed=np.array([name in fixed for name in scene.nodes]),
        bars=np.array([[index[node] for node in bar.nodes] for bar in scene.bars.values()], dtype=int),
        bar_mass=np.array([bar.mass for bar in scene.bars.values()]),
        strings=np.array([[index[node] for node in string.nodes[:2]] for string in scene.strings.values()], dtype=int),
        stiffness=np.array([_stiffness(scene, name) for name in scene.strings]),
        damping=np.array([scene.damping(name) for name in scene.strings]),
        rest_length=np.zeros(len(scene.strings)),
        nsh=tuple(honeycombs.get(string.nsh or "") for string in scene.strings.values()),
        element=tuple(elements.get(string.element or "") for string in scene.strings.values()),
        damper=tuple(dampers.get(string.damper or "") for string in scene.strings.values()),
        damping_law=scene.damping_law,
        gravity=scene.gravity,
        nominal=nodes,
        actuator=tuple(actuators.get(string.actuator or "") for string in scene.strings.values()),
        point_mass=_in_node_order(scene.point_masses, index),
        drag=_in_node_order(scene.drag, index),
        moving=tuple(sorted(index[node] for node in scene.moved)),
        partly_fixed=_single_axes(scene, scene.held, index),
        moving_axes=_single_axes(scene, scene.moved, index),
        welds=tuple(tuple(sorted(bars.index(name) for name in weld)) for weld in scene.weld),
        ground=_ground(scene),
        contacts=tuple(Contact(index[name], **scene.contact(name)) for name in scene.touching),
        routes=tuple(
            (i, tuple(index[node] for node in string.nodes))
            for i, string in enumerate(scene.strings.values())
            if len(string.nodes) > 2
        ),
        string_mass=np.array([string.mass for string in scene.strings.values()]),
        string_mass_matrix=scene.string_mass_matrix,
        two_way=np.array([string.two_way for string in scene.strings.values()]),
        sections=_known(bar.section() for bar in scene.bars.values()),
        strength=_known(map(scene.strength, scene.strings)),
    )


def _ground(scene: Scene) -> Ground | None:
    if scene.ground is None:
        return None
    point = scene.vector(scene.ground.point or (0.0,) * len(scene.axes))
    return Ground(point, scene.upward(), scene.ground.moving, scene.ground.law)


def _single_axes(scene: Scene, along: dict[str, tuple[int, ...]], index: dict[str, int]) -> tuple:
    """(node, axes) of the nodes that are named with some of the scene's axes, in node order."""
    return tuple(sorted((index[node], axes) for node, axes in along.items() if axes != scene.axes))


def _known(values: Iterable[Any]) -> tuple[tuple[int, Any], ...]:
    """(place, value) of those that are not None."""
    return tuple((place, value) for place, value in enumerate(values) if value is not None)


def _in_node_order(table: dict[str, float], index: dict[str, int]) -> tuple[tuple[int, float], ...]:
    return tuple(sorted((index[node], value) for node, value in table.items()))
