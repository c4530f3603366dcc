"""Actuators, eq. 8: motors with drums that wind strings in, as plain equations.

With delta the angle by which the drum has wound the string in: J_a delta'' + d_a delta' = k_a i - r T, and the string's
rest length is xi0(0) - r delta.  The article's eq. 8 has the tension with the other sign, under which delta pays out; with
delta shortening the string that would create energy.
Energy: J_a delta'^2 / 2 is stored, k_a i delta' put in, d_a delta'^2 lost; r T delta' goes to the string.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..model import Actuator, Model


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


def held_step(motor: Actuator, current: float, tension: float, delta: float, speed: float, h: float) -> tuple[float, float]:
    """Angle (rad) and speed (rad/s) of an actuator by itself, after the time h >= 0 (s) under a held current (A) and tension
    (N), from those before: the exact solution of eq. 8, for any damping."""
    z = motor.damping * h / motor.inertia
    push = (motor.torque_constant * current - motor.radius * tension) / motor.inertia
    first, second = _phi(z)
    return delta + h * (first * speed + h * second * push), math.exp(-z) * speed + h * first * push


def _phi(z: float) -> tuple[float, float]:
    """(1 - exp(-z)) / z and (exp(-z) - 1 + z) / z^2 for z >= 0, by their series where the differences would cancel."""
    if z >= 1.0:
        first = -math.expm1(-z) / z
        return first, (1.0 - first) / z
    second = sum((-z) ** n / math.factorial(n + 2) for n in range(18))
    return 1.0 - z * second, second
