"""Held inputs: what a missing array means, and how signals of currents and moved nodes are sampled."""

import math
from dataclasses import fields, replace

import numpy as np

from fmu_src.validation.reference_cache import reference_key
from tensegrity_core.model import Actuator, Inputs, grid, held
from tests.support import scene

WINCH = Actuator(0.1, 0.2, 0.5, 0.03)
PLAIN = scene("three_bar")
MODEL = replace(PLAIN, moving=(0, 2), actuator=(None, WINCH, None, None, WINCH, None), current=[1.0, 2.0])
TIMES = grid(0.4, 0.1)


def test_what_is_left_out_goes_on_as_the_model_starts():
    velocity = np.zeros((6, 3))
    velocity[2] = (1.0, 2.0, 3.0)
    model = replace(MODEL, velocity=velocity)
    found = Inputs(TIMES, np.zeros((4, 6, 3)), np.full((4, 6), 0.5), np.full((4, 6), 0.1)).resolved(model)
    np.testing.assert_array_equal(found.current, [[1.0, 2.0]] * 4)
    np.testing.assert_array_equal(found.node_velocity, [velocity[[0, 2]]] * 4)
    np.testing.assert_array_equal(found.node_acceleration, np.zeros((4, 2, 3)))
    for k, t in enumerate(TIMES[:-1]):
        np.testing.assert_array_equal(found.node_position[k], model.nodes[[0, 2]] + t * velocity[[0, 2]])
    np.testing.assert_array_equal(found.rest_length[:, [1, 4]], [model.rest_length[[1, 4]]] * 4)
    np.testing.assert_array_equal(found.rest_length_rate, [[0.1, 0.0, 0.1, 0.1, 0.0, 0.1]] * 4)
    assert (found.rest_length[:, [0, 2, 3, 5]] == 0.5).all()
    again = found.resolved(model)
    assert all(np.array_equal(getattr(again, item.name), getattr(found, item.name)) for item in fields(Inputs))


def test_nothing_to_fill_leaves_the_arrays_alone():
    rest = np.full((4, 6), 0.5)
    found = Inputs(TIMES, np.zeros((4, 6, 3)), rest, np.zeros((4, 6))).resolved(PLAIN)
    assert found.rest_length is rest
    assert (found.current.shape, found.node_position.shape) == ((4, 0), (4, 0, 3))


def test_signals_are_sampled_where_they_should_be():
    def motion(t):
        swing, speed = math.sin(t), math.cos(t)
        return [[swing, 0.0, 0.0], [0.0, swing, 0.0]], [[speed, 0.0, 0.0], [0.0, speed, 0.0]]

    found = held(
        MODEL, TIMES, current=lambda t: (t, 1.0 if t > 0.2 else 0.0), motion=motion, rest_length=lambda t: PLAIN.rest_length + t
    )
    np.testing.assert_allclose(found.current[:, 0], TIMES[:-1], atol=1e-6)
    np.testing.assert_array_equal(found.current[:, 1], [0.0, 0.0, 1.0, 1.0])  # a jump at 0.2 s counts from there
    np.testing.assert_array_equal(found.node_position[:, 0, 0], np.sin(TIMES[:-1]))
    np.testing.assert_array_equal(found.node_velocity[:, 1, 1], np.cos(TIMES[:-1]))
    np.testing.assert_allclose(found.node_acceleration[:, 1, 1], np.diff(np.cos(TIMES)) / 0.1, rtol=1e-12)
    np.testing.assert_array_equal(found.rest_length_rate[:, [1, 4]], 0.0)
    np.testing.assert_allclose(found.rest_length_rate[:, 0], 1.0, rtol=1e-12)


def test_the_key_of_a_stored_reference_run_covers_every_input():
    bare = Inputs(TIMES, np.zeros((4, 6, 3)), np.zeros((4, 6)), np.zeros((4, 6)))
    full = bare.resolved(MODEL)
    assert reference_key(MODEL, bare, {}) == reference_key(MODEL, bare, {})
    for name in ("current", "node_position", "node_velocity", "node_acceleration"):
        other = replace(full, **{name: getattr(full, name) + 1.0})
        assert reference_key(MODEL, other, {}) != reference_key(MODEL, full, {})
