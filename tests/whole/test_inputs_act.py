"""Every input of the list acts, in the kernel and in the reference, and the validation's drive moves it: one whose effect was
forgotten on both sides would agree with itself."""

import dataclasses

import numpy as np
import pytest

from fmu_src.validation.trials import trials
from tensegrity_core import kernel, reference
from tensegrity_core.errors import InputError
from tensegrity_core.model import grid, held
from tensegrity_core.model.inputs import INPUTS
from tests.support.driven_scenes import LABORATORY, built
from tests.support.ground_scenes import random_ground

#: Less than a string's rest length, and enough for every input to show.
CHANGE = 1e-3


@pytest.fixture(scope="module")
def model():
    found = built(LABORATORY)
    assert found.moving and found.actuated and len(found.actuated) < len(found.strings)
    return found


@pytest.fixture(scope="module")
def grounded():
    """A structure that touches a ground that moves."""
    found = random_ground(7)
    assert found.ground.moving
    inside = found.nodes[[contact.node for contact in found.contacts]].mean(axis=0)
    return dataclasses.replace(found, ground=dataclasses.replace(found.ground, point=tuple(inside)))


@pytest.mark.parametrize("name", INPUTS)
def test_an_input_changes_what_comes_out(name, model, grounded):
    model = grounded if name.startswith("ground") else model
    inputs = held(model, grid(0.01, 0.005))
    other = dataclasses.replace(inputs, **{name: getattr(inputs, name) + CHANGE})
    for simulate in (kernel.simulate, reference.simulate):
        before, after = simulate(model, inputs).outputs, simulate(model, other).outputs
        assert max(np.abs(after[output] - before[output]).max(initial=0.0) for output in before) > 1e-9, simulate.__module__


def test_the_drive_moves_every_input(model, grounded):
    driven = [trials(one)[0].inputs for one in (model, grounded)]
    assert [name for name in INPUTS if not any(np.ptp(getattr(inputs, name), axis=0).any() for inputs in driven)] == []


def test_a_signal_of_what_is_no_input_is_refused(model):
    for name in ("heat", "rest_length_rate", "string_force"):
        with pytest.raises(InputError, match=f"{name} is no input that is held.*current"):
            held(model, grid(0.01, 0.005), **{name: lambda t: 0.0})
