"""A stand-alone actuator as an FMU: current and tension in, rest length and its rate out, for a structure in another FMU.

Its model is an actuator that winds a string which bears nothing; the tension is the load on its drum.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from tensegrity_core.model import Actuator, Model

#: The only variables of the FMU: field -> name, and role where it differs from the field's own.
SHOWN = {
    "rest_length": ("start_rest_length", "fixed"),
    "current": ("current", "input"),
    "drum_load": ("tension", "input"),
    "motor_inertia": ("inertia", "fixed"),
    "motor_damping": ("damping", "fixed"),
    "torque_constant": ("torque_constant", "fixed"),
    "drum_radius": ("radius", "fixed"),
    "tolerance": ("solver.tolerance", "fixed"),
    "max_step": ("solver.step", "fixed"),
    "wound_rest_length": ("rest_length", "output"),
    "wound_rest_length_rate": ("rest_length_rate", "output"),
    "motor_speed": ("speed", "output"),
    "kinetic": ("energy.kinetic", "output"),
    "dissipated": ("energy.dissipated", "output"),
    "input_work": ("energy.input_work", "output"),
    "throughput": ("energy.throughput", "output"),
    "method": ("solver.method", "fixed"),
}


@dataclass(frozen=True, eq=False)
class ActuatorModel(Model):
    """The model of a stand-alone actuator; see `detached`."""

    shown: ClassVar[dict[str, tuple[str, str]]] = SHOWN


def detached(model: Model) -> tuple[Model, dict[str, ActuatorModel]]:
    """The model without its actuators, and these by the name of the string that each of them winds.

    Connect `S.force` of the structure to `tension` of the actuator, `rest_length` and `rest_length_rate` of the actuator to
    `S.rest_length` and `S.rest_length_rate` of the structure.
    """
    bare = replace(model, actuator=(None,) * len(model.strings), current=np.zeros(0), drum_load=np.zeros(0))
    return bare, {model.string_names[i]: _alone(model, a, i, motor) for a, (i, motor) in enumerate(model.motors.items())}


def _alone(model: Model, a: int, i: int, motor: Actuator) -> ActuatorModel:
    """The actuator number a, which winds string i, between two anchors of its own; a load holds its start current."""
    name = model.string_names[i]
    rest, current = float(model.rest_length[i]), float(model.current[a])
    nodes = np.array([[0.0, 0.0, 0.0], [rest, 0.0, 0.0]])
    return ActuatorModel(
        name=f"{model.name}_{name}_actuator",
        description=f"Actuator of string {name} of {model.name}",
        axes=(0, 2),
        node_names=("drum", "end"),
        bar_names=(),
        string_names=(name,),
        nodes=nodes,
        fixed=np.array([True, True]),
        bars=np.zeros((0, 2), dtype=int),
        bar_mass=np.zeros(0),
        strings=np.array([[0, 1]]),
        stiffness=np.zeros(1),
        damping=np.zeros(1),
        rest_length=np.array([rest]),
        nsh=(None,),
        damping_law="literal",
        gravity=0.0,
        nominal=nodes,
        actuator=(motor,),
        current=np.array([current]),
        drum_load=np.array([motor.torque_constant * current / motor.radius]),
    )
