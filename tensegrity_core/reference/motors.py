"""Actuators, eq. 8: motors with drums that wind strings in, as plain equations.

With delta the angle by which the drum has wound the string in: J_a delta'' + d_a delta' = k_a i - r T, and the string's
rest length is xi0(0) - r delta.  The article's eq. 8 has the tension with the other sign, under which delta pays out; with
delta shortening the string that would create energy.
Energy: J_a delta'^2 / 2 is stored, k_a i delta' put in, d_a delta'^2 lost; r T delta' goes to the string.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..model import Model


class Motors(NamedTuple):
    """Constants of A actuators, (A,) each: J_a kg m2, d_a N m s, k_a N m/A, r m; strings: (A,) int, those that they wind."""

    inertia: np.ndarray
    damping: np.ndarray
    torque_constant: np.ndarray
    radius: np.ndarray
    strings: np.ndarray


def motors_of(model: Model) -> Motors:
    """The constants of a model's actuators, in string order."""
    found = model.motors.values()
    names = ("inertia", "damping", "torque_constant", "radius")
    constants = {name: np.array([getattr(motor, name) for motor in found], dtype=float) for name in names}
    return Motors(**constants, strings=np.array(model.actuated, dtype=int))


def acceleration(motors: Motors, current, tension, speed):
    """delta'' (A,) rad/s2 of eq. 8.  current: i, A; tension: T, N; speed: delta', rad/s."""
    torque = motors.torque_constant * current - motors.damping * speed - motors.radius * tension
    return torque / motors.inertia


def input_power(motors: Motors, current, speed):
    """k_a i delta' (A,), W."""
    return motors.torque_constant * current * speed


def lost_power(motors: Motors, speed):
    """d_a delta'^2 (A,), W."""
    return motors.damping * speed * speed


def kinetic_energy(motors: Motors, speed) -> float:
    """Sum of J_a delta'^2 / 2, J."""
    return 0.5 * float(np.sum(motors.inertia * speed * speed))
