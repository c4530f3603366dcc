"""What a model made by hand says of arrays that do not fit it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tensegrity_core.errors import InputError
from tests.support import scene


@pytest.mark.parametrize(
    "field, value, says",
    [
        ("nodes", np.zeros((4, 2)), r"nodes has the shape \(4, 2\); give one of shape \(4, 3\)"),
        ("velocity", np.zeros((3, 3)), r"velocity has the shape \(3, 3\); give one of shape \(4, 3\)"),
        ("fixed", [True, False], r"fixed has the shape \(2,\); give one of shape \(4,\)"),
        ("bar_mass", [1.0], r"bar_mass has the shape \(1,\); give one of shape \(2,\)"),
        ("stiffness", ["a", "b", "c"], r"stiffness = \['a', 'b', 'c'\] is not an array of shape \(3,\); give real numbers"),
        ("current", [1.0], r"current has the shape \(1,\); give one of shape \(0,\)"),
        ("bars", [["n1", "n3"]], r"bars = \[\['n1', 'n3'\]\] is not a list of pairs of nodes; give real numbers"),
    ],
)
def test_arrays_that_do_not_fit_are_named(field, value, says):
    with pytest.raises(InputError, match=says):
        dataclasses.replace(scene("two_bar"), **{field: value})


def test_arrays_are_copies_that_nobody_changes():
    given = np.array([1.0, 2.0])
    model = dataclasses.replace(scene("two_bar"), bar_mass=given)
    given[0] = 5.0
    assert model.bar_mass.tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="read-only"):
        model.bar_mass[0] = 3.0
