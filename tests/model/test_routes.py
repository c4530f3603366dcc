"""Strings over more than two nodes, strings with mass and springs that push, as a model holds them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tensegrity_core.errors import InputError
from tests.support import by_hand, scene

CORNERS = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0], [0.0, 4.0, 12.0]])


def woven(strings, **fields):
    masses = [(node, 1.0) for node in (1, 2, 3)]
    return by_hand(CORNERS, [0], [], strings, stiffness=100.0, rest_length=1.0, **{"point_mass": masses} | fields)


def test_paths_and_lengths():
    model = woven([(0, 1), (0, 1, 2, 3), (2, 1, 0, 2)])
    assert model.paths == ((0, 1), (0, 1, 2, 3), (2, 1, 0, 2))
    assert model.strings.tolist() == [[0, 1], [0, 1], [2, 1]]
    assert model.string_lengths(model.nodes).tolist() == [3.0, 3.0 + 4.0 + np.hypot(3.0, 12.0), 12.0]


def test_mass_is_shared_by_segments():
    """Each segment has a part of the mass by its nominal length, half at each end; where a string passes a node twice, both
    count."""
    model = woven([(0, 1), (0, 1, 2), (1, 2, 0, 1), (2, 3)], string_mass=[0.5, 0.7, 1.2, 0.0])
    assert model.counts["M"] == 3 and model.massive_strings == (0, 1, 2)
    shares = {(string, node): share for string, node, share in model.string_mass_shares}
    expected = {(0, 0): 0.5, (0, 1): 0.5, (1, 0): 1.5 / 7, (1, 1): 0.5, (1, 2): 2 / 7}
    expected |= {(2, 1): 3.5 / 12, (2, 2): 4.5 / 12, (2, 0): 4 / 12}
    assert shares == pytest.approx(expected)
    carried = [0.25 + 0.15 + 0.4, 1.0 + 0.25 + 0.35 + 0.35, 1.0 + 0.2 + 0.45, 1.0]
    np.testing.assert_allclose(model.node_mass, carried, rtol=1e-15)
    moved = dataclasses.replace(model, nodes=model.nodes * [1.0, 2.0, 3.0])
    assert moved.string_mass_shares == model.string_mass_shares


@pytest.mark.parametrize(
    "fields, says",
    [
        ({"routes": [(1, (0, 1, 2))]}, "string 1 is out of turn; list strings that there are"),
        ({"routes": [(0, (0, 2, 1))]}, "that of string 0, .0, 2, 1., has to begin with its two nodes"),
        ({"routes": [(0, (0, 1, 1))]}, "goes from a node to itself"),
        ({"string_mass": [1.0, 2.0]}, r"string_mass has the shape \(2,\); give one of shape \(1,\)"),
        ({"two_way": [True, False]}, r"two_way has the shape \(2,\)"),
    ],
)
def test_what_does_not_fit_is_named(fields, says):
    with pytest.raises(InputError, match=says):
        woven([(0, 1)], **fields)


def test_models_differ_by_each_of_them():
    model = woven([(0, 1), (1, 2)])
    for change in ({"routes": [(1, (1, 2, 3))]}, {"string_mass": [0.0, 0.1]}, {"two_way": [False, True]}):
        assert dataclasses.replace(model, **change) != model
    plain = scene("two_bar")
    assert plain.routes == () and not plain.string_mass.any() and not plain.two_way.any() and plain.counts["M"] == 0
