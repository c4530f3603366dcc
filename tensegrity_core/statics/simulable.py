"""Whether a scene's model can be simulated: what the kernel would refuse later, said here with file, key and remedy.

* Rates.  A node of the inertia m under a stiffness k swings at sqrt(k/m), under a damper d it slows down at d/m.  Steps have to
  follow the first and, while forces change, the second; beyond the bounds below a run would take days for a second.  It is
  these ratios that decide, not the masses: a small structure of thin wires may have bars of a microgram.
* Force laws.  The kernel works out the same laws in its own way, and may refuse one that `laws` accepts.
* The start.  Its accelerations must be numbers.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from .. import laws
from ..errors import SceneError, SimulationError, TensegrityError
from ..kernel import Kernel, load_library
from ..laws.dampers import slopes_at_rest
from ..model import Model

if TYPE_CHECKING:
    from ..scene import Scene

FASTEST_SWING = 1e8  # rad/s
FASTEST_DECAY = 1e12  # 1/s


def require(scene: Scene, model: Model) -> None:
    """Raise SceneError where the model cannot be simulated."""
    load_library()  # that it is missing is no fault of the scene
    _require_rates(scene, model)
    if model.joint:  # where bars lock, statics still have a meaning; the kernel says so when it is asked
        return
    failure = _refusal(model)
    if failure is None:
        return
    for i, name in enumerate(model.string_names):
        entry = scene.strings[name]
        key = next((key for key in ("element", "nsh", "damper") if getattr(entry, key) is not None), None)
        if key is not None and _refusal(_alone(model, i)) is not None:
            problem = f"the kernel refuses the string's law: {failure}"
            raise scene.error(f"strings.{name}.{key}", problem, "Change the law's parameters or the string's stiffness.")
    raise SceneError(scene.file, "(scene)", scene.name, f"cannot be simulated: {failure}", "Bring its values nearer together.")


def _refusal(model: Model) -> str | None:
    try:
        Kernel(model).initialize()
    except SimulationError as failure:
        return str(failure).partition(": ")[2]
    except TensegrityError as failure:
        return str(failure).removeprefix("the packed model is refused: ")
    return None


def _alone(model: Model, i: int) -> Model:
    """The model with string i alone, all bars, and the other strings' masses where they are."""

    def only(table: tuple) -> tuple:
        return (table[i],)

    changed: dict[str, Any] = {name: only(getattr(model, name)) for name in ("string_names", "nsh", "element", "damper")}
    changed |= {name: getattr(model, name)[[i]] for name in ("strings", "stiffness", "damping", "rest_length", "two_way")}
    changed["routes"] = tuple((0, nodes) for string, nodes in model.routes if string == i)
    none, masses = np.zeros(0), tuple(sorted(model.payload.items()))
    return replace(model, **changed, actuator=(), current=none, drum_load=none, string_mass=none, point_mass=masses)


# --- rates -------------------------------------------------------------------------------------------------------


def _require_rates(scene: Scene, model: Model) -> None:
    inertia, owner = _inertia(model)
    for what, bound, unit, values in (
        ("stiffness", FASTEST_SWING**2, "N/m", _stiffest(model)),
        ("damping", FASTEST_DECAY, "N s/m", slopes_at_rest(model)),
    ):
        for i, value in enumerate(values):
            for node in model.paths[i]:
                if inertia[node] > 0.0 and value / inertia[node] > bound:
                    _too_fast(scene, model, owner[node], node, f"the {what} of {model.string_names[i]}", value, unit)
            motor = model.actuator[i]
            if motor is not None and value * motor.radius**2 / motor.inertia > bound:
                key = f"actuators.{scene.strings[model.string_names[i]].actuator}.inertia"
                problem = (
                    f"is too small beside the {what} of {model.string_names[i]} ({value:.3g} {unit}), which moves it too fast"
                )
                raise scene.error(key, problem, "Raise the inertia, or lower the other.")
    for contact in model.contacts:
        name, node = model.node_names[contact.node], contact.node
        for what, value in (
            ("the ground's stiffness", contact.stiffness),
            ("friction's stiffness", contact.tangential_stiffness),
        ):
            if inertia[node] > 0.0 and value / inertia[node] > FASTEST_SWING**2:
                _too_fast(scene, model, owner[node], node, f"{what} under {name}", value, "N/m")
    for node, value in model.drag:
        if inertia[node] > 0.0 and value / inertia[node] > FASTEST_DECAY:
            _too_fast(scene, model, owner[node], node, "the drag there", value, "N s/m")
    for motor, winder in {
        (motor, scene.strings[model.string_names[i]].actuator) for i, motor in enumerate(model.actuator) if motor
    }:
        if motor.damping / motor.inertia > FASTEST_DECAY:
            raise scene.error(
                f"actuators.{winder}.inertia",
                f"is too small beside the damping, {motor.damping:.3g} N m s",
                "Raise the inertia, or lower the damping.",
            )


def _too_fast(scene: Scene, model: Model, key: str, node: int, what: str, value: float, unit: str) -> None:
    problem = f"is too small beside {what} ({value:.3g} {unit}), which moves {model.node_names[node]} too fast to be followed"
    raise scene.error(key, problem, "Raise the mass, or lower the other.")


def _inertia(model: Model) -> tuple[np.ndarray, list[str]]:
    """(N,) kg that a force on a node moves at least, 0 at fixed nodes, and the key of the largest mass in it.

    An end of a free bar moves like m/4, the tip of a pinned one like m/3; further bars, strings and a point mass add to it.
    """
    inertia, owner = np.zeros(len(model.nodes)), [""] * len(model.nodes)
    for name, ends, mass in zip(model.bar_names, model.bars, model.bar_mass):
        for node in ends:
            if 0.25 * mass >= inertia[node]:
                owner[node] = f"bars.{name}.mass"
            inertia[node] += 0.25 * mass
    for node, mass in model.point_mass:
        if mass > inertia[node]:
            owner[node] = f"point_masses.{model.node_names[node]}"
        inertia[node] += mass
    for string, node, share in model.string_mass_shares:
        mass = (0.5 if model.string_mass_links else 1.0) * share * model.string_mass.item(string)
        if mass > inertia[node]:
            owner[node] = f"strings.{model.string_names[string]}.mass"
        inertia[node] += mass
    inertia[model.fixed] = 0.0
    return inertia, owner


def _stiffest(model: Model) -> list[float]:
    """N/m, about the largest stiffness of each string."""
    found = model.stiffness.tolist()
    for i, law in laws.curved_laws(model).items():
        found[i] = law.stiffest
    return found
