"""What a model made by hand says of arrays that do not fit it."""

from __future__ import annotations

import dataclasses
import importlib
import pkgutil

import numpy as np
import pytest

import fmu_src
import tensegrity_core
from tensegrity_core.errors import InputError
from tensegrity_core.model import Model
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


def test_models_are_equal_where_all_of_them_is():
    model, again = (tensegrity_core.load("three_bar_nsh") for _ in range(2))
    assert model is not again and model == again and hash(model) == hash(again) and len({model, again}) == 1
    for change in ({"gravity": 1.0}, {"bar_mass": 2.0 * model.bar_mass}, {"nsh": (None, *model.nsh[1:])}, {"name": "other"}):
        assert dataclasses.replace(model, **change) != model
    assert model != "three_bar_nsh" and tensegrity_core.load("three_bar") != model


def test_what_holds_arrays_is_compared_as_a_whole_or_by_identity():
    """What dataclasses compare by themselves ends in an error of NumPy's."""
    found = set()
    for package in (tensegrity_core, fmu_src):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if module.name.rpartition(".")[2] == "__main__" or ".python_runtime." in module.name:
                continue
            for one in vars(importlib.import_module(module.name)).values():
                if isinstance(one, type) and dataclasses.is_dataclass(one) and one.__module__ == module.name:
                    texts = " ".join(str(field.type) for field in dataclasses.fields(one))
                    if any(word in texts for word in ("ndarray", "Dataset", "Result", "Inputs")):
                        found.add(one)
    assert len(found) > 15 and Model in found
    assert {one.__name__ for one in found if one.__dataclass_params__.eq} == set()
