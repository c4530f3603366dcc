"""The ground in scene files: what the keys mean.  What mistakes in them are answered with stands in mistakes.toml."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tensegrity_core import load
from tensegrity_core.errors import InputError, SceneError
from tensegrity_core.model import Contact, Ground, grid
from tensegrity_core.model.signals import driven
from tensegrity_core.scene.schema import scene_schema
from tests.scene.test_scene import write

#: A stick over an incline, tied to a post.
GOOD = """
name = "stick"
gravity = 9.81
start = "released"
fixed = ["n3"]

[nodes]
n1 = [0.0, 0.0, 0.2]
n2 = [1.0, 0.0, 0.6]
n3 = [0.0, 0.0, 1.0]

[bars]
b1 = { nodes = ["n1", "n2"], mass = 1.0 }

[strings]
s1 = { nodes = ["n3", "n2"], stiffness = 100.0, damping = 1.0 }

[prestress.rest_length]
s1 = 1.0

[ground]
point = [0.0, 0.0, 0.1]
normal = [-3.0, 0.0, 4.0]
stiffness = 2e4
damping = 0.2
friction = 0.5
moving = true

[ground.at.n2]
friction = 0.1
stiffness = 1e4
"""


def stick(tmp_path, *changes):
    text = GOOD
    for old, new in changes:
        assert old in text
        text = text.replace(old, new, 1)
    return load(write(tmp_path, text))


def test_what_the_keys_mean(tmp_path):
    model = stick(tmp_path)
    assert model.ground == Ground((0.0, 0.0, 0.1), (-0.6, 0.0, 0.8), True)
    assert model.contacts == (Contact(0, 2e4, 0.2, 2e4, 0.5), Contact(1, 1e4, 0.2, 1e4, 0.1))
    assert model.counts["K"] == 2 and model.counts["W"] == 1


def test_defaults(tmp_path):
    text = GOOD[: GOOD.index("[ground]")] + "[ground]\nstiffness = 10.0\n"
    model = load(write(tmp_path, text))
    assert model.ground == Ground((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), False)
    assert model.contacts == (Contact(0, 10.0, 0.0, 10.0, 0.0), Contact(1, 10.0, 0.0, 10.0, 0.0))
    assert model.counts["W"] == 0
    assert load(write(tmp_path, text + 'nodes = ["n2"]\ntangential_stiffness = 5.0\n')).contacts == (
        Contact(1, 10.0, 0.0, 5.0, 0.0),
    )


@pytest.mark.parametrize("normal", ["[0.0, 0.0, 1e-200]", "[0.0, 0.0, 1e6]", "[0, 0, 3]"])
def test_normals_of_any_length(normal, tmp_path):
    assert stick(tmp_path, ("[-3.0, 0.0, 4.0]", normal)).ground.normal == (0.0, 0.0, 1.0)


def test_a_scene_without_ground_has_no_trace_of_it(tmp_path):
    model = load(write(tmp_path, GOOD[: GOOD.index("[ground]")]))
    assert model.ground is None and model.contacts == () and model.counts["K"] == model.counts["W"] == 0


def test_names_are_reserved_where_there_is_a_ground_only(tmp_path):
    text = GOOD.replace("n3", "ground").replace("s1", "n1_contact_normal")
    assert load(write(tmp_path, text[: text.index("[ground]")])).node_names[2] == "ground"


def test_the_height_of_the_ground_is_a_signal(tmp_path):
    model, times = stick(tmp_path), grid(1.0, 0.5)
    given = driven(model, times, {"ground.height": lambda t: 0.1 * t**2, "ground.velocity": lambda t: 0.2 * t})
    assert given.ground_height.tolist() == [[0.0], [0.025]] and given.ground_velocity.tolist() == [[0.0], [0.1]]
    np.testing.assert_allclose(given.ground_acceleration, [[0.2], [0.2]])
    assert not driven(model, times, {}).ground_height.any()
    with pytest.raises(InputError, match="ground.height: a ground that moves needs its height and its velocity over time"):
        driven(model, times, {"ground.height": 0.1})
    with pytest.raises(InputError, match="ground.acceleration follows from ground.velocity"):
        driven(model, times, {"ground.acceleration": 0.1})


def test_schema_knows_the_ground():
    described = json.dumps(scene_schema())
    for key in ("stiffness k_n in N/m", "its height along the normal", "a vector out of the ground", "at.n4"):
        assert key in described


def test_a_plane_without_z_needs_a_normal(tmp_path):
    flat = GOOD.replace("gravity = 9.81", 'gravity = 0.0\nplane = "xy"').replace(", 0.0, ", ", ")
    model = load(write(tmp_path, flat))
    assert model.ground.normal == (-0.6, 0.8, 0.0) and model.ground.point == (0.0, 0.1, 0.0)
    with pytest.raises(SceneError, match="ground = .* has no normal, and the scene no z axis .* Give normal = "):
        load(write(tmp_path, flat.replace("normal = [-3.0, 4.0]\n", "")))
