"""A packed model is read back as the model that it was."""

from __future__ import annotations

import numpy as np
import pytest

from tensegrity_core.errors import InputError
from tensegrity_core.kernel import to_bytes
from tensegrity_core.kernel.unpacking import from_bytes
from tensegrity_core.scene import builtin_scenes
from tests.support import element_scenes, scene
from tests.support.driven_scenes import AFLOAT, LABORATORY, MAST, PENDULUM, RATED, built
from tests.support.rigged_scenes import RIGGED
from tests.support.touching import lying, moving, thrown

SCENES = {"pendulum": PENDULUM, "afloat": AFLOAT, "mast": MAST, "laboratory": LABORATORY, "rated": RATED, "rigged": RIGGED}


def again(model):
    names = model.node_names, model.bar_names, model.string_names
    return from_bytes(to_bytes(model), *names, model.axes, model.name, model.description)


def models():
    yield from map(scene, builtin_scenes())
    yield from map(built, SCENES.values())
    yield from map(element_scenes.mast, element_scenes.STRINGS)
    yield from (moving(thrown()), lying(0.3, 0.3, planar=True))


def test_models_come_back_and_pack_to_the_same_bytes():
    seen = 0
    for model in models():
        back = again(model)
        assert to_bytes(back) == to_bytes(model), model.name
        for name in (
            "axes",
            "node_names",
            "string_names",
            "nsh",
            "element",
            "damper",
            "actuator",
            "gravity",
            "moving",
            "drag",
            "strength",
            "ground",
            "contacts",
        ):
            assert getattr(back, name) == getattr(model, name), (model.name, name)
        np.testing.assert_array_equal(back.nodes[:, list(model.axes)], model.nodes[:, list(model.axes)])
        np.testing.assert_array_equal(back.fixed, model.fixed)
        seen += 1
    assert seen > 20


def test_other_bytes_are_refused():
    model = scene("three_bar_nsh")
    packed, names = to_bytes(model), (model.node_names, model.bar_names, model.string_names)
    for bad in (b"", packed[:-1], packed[:100] + bytes([packed[100] ^ 1]) + packed[101:], b"TSMODEL1" + packed[8:]):
        with pytest.raises(InputError, match="damaged or of another version"):
            from_bytes(bad, *names, model.axes)
    with pytest.raises(InputError, match="6 N, 3 B, 6 S, 3 D"):
        from_bytes(packed, model.node_names[1:], model.bar_names, model.string_names, model.axes)
