"""Validation case 3: motions known in closed form, from outside this project.

A physical pendulum against its elliptic-integral solution, a torque-free free bar, and a bar on a spring.
"""

import math

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from tensegrity_core import reference
from tensegrity_core.model import Model, grid, held
from tests.support import by_hand

TIGHT = {"rtol": 1e-12, "atol": 1e-13}
GRAVITY = 9.81


def one_bar(nodes, fixed, strings=(), k=(), rest=(), gravity=GRAVITY, velocity=None, mass=1.0, axes=(0, 1, 2)) -> Model:
    """Bar n1-n2 of the given mass; further nodes are anchors; undamped strings."""
    options = {"bar_mass": mass, "stiffness": k, "rest_length": rest, "gravity": gravity, "velocity": velocity, "axes": axes}
    return by_hand(nodes, np.flatnonzero(fixed), [(0, 1)], strings, **options)


@pytest.mark.parametrize("axes", [(0, 1, 2), (0, 2)])
def test_pendulum(axes):
    """A rod of length l pinned at one end, released at 45 degrees: sin(theta/2) = k sn(K - w t, k), w^2 = 3 g/(2 l).

    (H. Goldstein, Classical Mechanics; elliptic functions by SciPy.)
    """
    length, start = 1.3, math.radians(45.0)
    tip = (length * math.sin(start), 0, -length * math.cos(start))
    model = one_bar([(0, 0, 0), tip], [True, False], mass=2.5, axes=axes)
    result = reference.simulate(model, held(model, grid(10.0, 0.05)), **TIGHT)
    w, k2 = math.sqrt(1.5 * GRAVITY / length), math.sin(start / 2.0) ** 2
    sn, cn, _, _ = ellipj(ellipk(k2) - w * result.times, k2)
    theta = 2.0 * np.arcsin(math.sqrt(k2) * sn)
    rate = -2.0 * w * math.sqrt(k2) * cn
    tip, velocity = result.position[:, 1], result.velocity[:, 1]
    np.testing.assert_allclose(tip[:, 0], length * np.sin(theta), rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(tip[:, 2], -length * np.cos(theta), rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(velocity[:, 0], length * rate * np.cos(theta), rtol=0.0, atol=1e-9)
    # Newton's second law for the centre of mass gives the pin's force.
    up = 2.5 * (GRAVITY + 0.5 * length * (rate**2 * np.cos(theta) - w**2 * np.sin(theta) ** 2))
    np.testing.assert_allclose(result.reaction[:, 0, 2], up, rtol=0.0, atol=1e-7)
    assert result.ledger_error() < 1e-9


@pytest.mark.parametrize("gravity", [0.0, GRAVITY])
def test_torque_free_bar(gravity):
    """A free bar turns uniformly in a fixed plane while its centre flies on a parabola."""
    length, omega = 0.8, 7.0
    e1, axis = np.array([1.0, 2.0, 2.0]) / 3.0, np.array([2.0, 1.0, -2.0]) / 3.0
    e2 = np.cross(axis, e1)
    flight, centre = np.array([0.3, -0.2, 1.5]), np.array([0.1, 0.4, 2.0])
    half = 0.5 * length
    velocity = np.array([flight - half * omega * e2, flight + half * omega * e2])
    ends = [centre - half * e1, centre + half * e1]
    model = one_bar(ends, [False, False], gravity=gravity, velocity=velocity, mass=3.0)
    result = reference.simulate(model, held(model, grid(5.0, 0.05)), **TIGHT)
    t = result.times[:, None]
    arm = half * (np.cos(omega * t) * e1 + np.sin(omega * t) * e2)
    path = centre + flight * t - 0.5 * gravity * t**2 * np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(result.position[:, 0], path - arm, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(result.position[:, 1], path + arm, rtol=0.0, atol=1e-10)
    # Tension in a spinning rod: a parabola from m l omega^2 / 8 at its middle to 0, with the mean m l omega^2 / 12.
    np.testing.assert_allclose(result.bar_force[:, 0], 3.0 * length * omega**2 / 12.0, rtol=1e-9)
    kinetic = 0.5 * 3.0 * np.sum((flight - gravity * t * np.array([0.0, 0.0, 1.0])) ** 2, axis=1)
    np.testing.assert_allclose(result.kinetic, kinetic + 0.5 * 3.0 * length**2 / 12.0 * omega**2, rtol=1e-8)


def test_bar_on_a_spring():
    """A bar that hangs upright from a spring moves straight up and down: x = A cos(sqrt(k/m) t) about m g/k."""
    k, mass, rest, amplitude = 350.0, 1.7, 0.6, 0.03
    still = rest + mass * GRAVITY / k
    top = -(still + amplitude)
    model = one_bar([(0, 0, top), (0, 0, top - 0.9), (0, 0, 0)], [False, False, True], [(2, 0)], [k], [rest], mass=mass)
    result = reference.simulate(model, held(model, grid(5.0, 0.05)), **TIGHT)
    swing = amplitude * np.cos(math.sqrt(k / mass) * result.times)
    np.testing.assert_allclose(result.string_length[:, 0], still + swing, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(result.string_force[:, 0], mass * GRAVITY + k * swing, rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(-result.reaction[:, 2, 2], -result.string_force[:, 0], rtol=1e-13)
    assert result.ledger_error() < 1e-10 and not result.transitions


def test_bar_turned_by_a_spring():
    """A pinned bar between two springs along x swings, for small angles, at w^2 = 6 k/m (no gravity).

    At its tip the springs pull back with 2 k per displacement, and the bar's mass as felt there is m/3.  The tip sinks,
    and the springs turn, in second order only; an amplitude of 1e-6 m keeps those terms below 1e-11 of the motion.
    """
    k, mass, length, far, amplitude = 40.0, 1.2, 1.1, 3.0, 1e-6
    height = math.sqrt(length**2 - amplitude**2)
    model = one_bar(
        [(0, 0, 0), (amplitude, 0, height), (-far, 0, length), (far, 0, length)],
        [True, False, True, True],
        [(2, 1), (1, 3)],
        [k, k],
        [far - 0.2, far - 0.2],
        gravity=0.0,
        mass=mass,
    )
    result = reference.simulate(model, held(model, grid(3.0, 0.05)), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(
        result.position[:, 1, 0], amplitude * np.cos(math.sqrt(6.0 * k / mass) * result.times), rtol=0.0, atol=1e-12
    )
