"""Scene files with actuators, point masses, drag, moved nodes and a gravity vector: what they say, what is refused."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from tensegrity_core.cli import main
from tensegrity_core.errors import SceneError
from tensegrity_core.model import Actuator
from tensegrity_core.scene import load_scene, parse_scene
from tensegrity_core.statics import build_model, residual
from tests.scene.test_scene import schema_errors, write

GOOD = """\
name = "crane"
start = "settled"
gravity = [0.5, -0.25, -9.5]
fixed = ["foot", "east", "north", "west"]
moving = ["west", "foot"]

[nodes]
foot = [0.0, 0.0, 0.0]
tip = [0.1, 0.2, 2.0]
east = [1.5, -1.0, 0.0]
north = [0.0, 1.8, 0.0]
west = [-1.5, -1.0, 0.0]

[actuators.winch]
inertia = 0.002
damping = 0.05
torque_constant = 0.4
radius = 0.02

[bars]
mast = { nodes = ["foot", "tip"], mass = 2.5 }

[strings]
guy1 = { nodes = ["east", "tip"], stiffness = 4000.0 }
guy2 = { nodes = ["north", "tip"], stiffness = 4000.0, actuator = "winch" }
guy3 = { nodes = ["west", "tip"], stiffness = 2500.0, damping = 40.0, actuator = "winch" }

[point_masses]
tip = 0.75
foot = 3

[drag]
tip = 2.0

[prestress]
tension = { guy1 = 12.0, guy2 = 8.0, guy3 = 9.0 }
"""


def test_the_good_scene_is_good(tmp_path):
    path = write(tmp_path, GOOD)
    model = build_model(load_scene(path))
    assert main(["check", str(path)]) == 0
    assert model.gravity == (0.5, -0.25, -9.5)
    assert model.moving == (0, 4)
    assert model.point_mass == ((0, 3.0), (1, 0.75))
    assert model.drag == ((1, 2.0),)
    winch = Actuator(0.002, 0.05, 0.4, 0.02)
    assert model.actuator == (None, winch, winch)
    assert not schema_errors(tomllib.loads(GOOD))


def changed(**tables) -> dict:
    """GOOD with tables replaced."""
    return tomllib.loads(GOOD) | tables


def test_a_free_node_on_no_bar_needs_a_point_mass():
    raw = changed()
    raw["nodes"]["lone"] = [1.0, 1.0, 1.0]
    raw["point_masses"]["lone"] = 1.0
    assert parse_scene(raw).point_masses["lone"] == 1.0
    for masses in ({}, {"lone": 0.0}):
        with pytest.raises(SceneError, match=r"nodes\.lone .*neither fixed nor on a bar, so it has no mass"):
            parse_scene(raw | {"point_masses": masses})


@pytest.mark.parametrize("name", ["tip_drag", "west_position_x", "west_acceleration_x", "guy2_actuator_speed", "gravity_x"])
def test_names_of_the_new_variables_are_kept_free(name):
    raw = changed()
    raw["strings"][name] = raw["strings"].pop("guy1")
    raw["prestress"]["tension"][name] = raw["prestress"]["tension"].pop("guy1")
    with pytest.raises(SceneError, match="reads like a variable"):
        parse_scene(raw)


@pytest.mark.parametrize("plane, across", [("xy", 2), ("xz", 1), ("yz", 0)])
def test_gravity_across_the_plane_of_a_planar_scene(plane, across):
    raw = {"name": "bar", "plane": plane, "start": "released", "nodes": {"a": [0.0, 0.0], "b": [1.0, 0.0]}}
    raw |= {"fixed": ["a"], "bars": {"bar": {"nodes": ["a", "b"], "mass": 1.0}}}
    gravity = [1, 2, 3]
    with pytest.raises(SceneError, match=rf"gravity\[{across + 1}\] = {gravity[across]}.*across the plane {plane}"):
        parse_scene(raw | {"gravity": gravity})
    gravity[across] = 0
    model = build_model(parse_scene(raw | {"gravity": gravity}))
    assert model.gravity == tuple(gravity)
    assert model.counts["V"] == 2


def test_extending_replaces_gravity_and_joins_the_tables(tmp_path):
    write(tmp_path, GOOD, "base.toml")
    scene = load_scene(write(tmp_path, 'extends = "base.toml"\ngravity = 1.5\n[point_masses]\neast = 1.0\n', "more.toml"))
    assert scene.gravity == 1.5
    assert scene.point_masses == {"tip": 0.75, "foot": 3.0, "east": 1.0}
    bad = write(tmp_path, 'extends = "base.toml"\ngravity = [0.0, 0.0, nan]\n', "bad.toml")
    with pytest.raises(SceneError) as caught:
        load_scene(bad)
    assert (caught.value.file, caught.value.key) == (str(bad), "gravity[3]")


# --- statics -----------------------------------------------------------------------------------------------------


def test_start_currents_hold_the_start_tensions():
    """In the settled state, under half the bar's weight and the point mass's at the tip."""
    model = build_model(parse_scene(changed()))
    assert np.abs(residual(model)).max() < 1e-9
    along = model.nodes[model.strings[:, 1]] - model.nodes[model.strings[:, 0]]
    length = np.linalg.norm(along, axis=1)
    tension = model.stiffness * (length - model.rest_length)
    assert tension.min() > 1.0
    np.testing.assert_allclose(model.current, 0.02 * tension[1:] / 0.4, rtol=1e-14)

    pull = -(along / length[:, None]).T @ tension
    load = pull + (0.5 * 2.5 + 0.75) * np.array([0.5, -0.25, -9.5])
    rod = model.nodes[1] - model.nodes[0]
    np.testing.assert_allclose(np.cross(rod, load), 0.0, atol=1e-9)  # about the foot


def test_a_mass_that_hangs_sets_its_string_tension():
    """A free bar that hangs straight on one string: T = (m + m_p) g, whichever end carries the mass, along any gravity."""
    down = np.array([3.0, 4.0, -12.0]) / 13.0
    raw = {"name": "hanging", "gravity": (9.0 * down).tolist(), "fixed": ["hook"], "point_masses": {"low": 0.5, "hook": 7.0}}
    raw["nodes"] = {name: (r * down).tolist() for name, r in (("hook", 0.0), ("high", 1.0), ("low", 3.0))}
    raw["bars"] = {"rod": {"nodes": ["high", "low"], "mass": 2.0}}
    raw["strings"] = {"rope": {"nodes": ["hook", "high"], "stiffness": 1000.0}}
    model = build_model(parse_scene(raw))
    assert 1000.0 * (1.0 - model.rest_length[0]) == pytest.approx(2.5 * 9.0, rel=1e-12)
    raw["start"] = "settled"
    raw["prestress"] = {"rest_length": {"rope": 0.9}}
    model = build_model(parse_scene(raw))
    np.testing.assert_allclose(model.nodes[1], (0.9 + 22.5 / 1000.0) * down, atol=1e-11)


def test_out_of_balance_by_a_point_mass():
    raw = {"name": "upright", "fixed": ["foot", "wall"], "nodes": {"foot": [0, 0, 0], "tip": [0, 0, 1], "wall": [1, 0, 1]}}
    raw["bars"] = {"mast": {"nodes": ["foot", "tip"], "mass": 1.0}}
    raw["strings"] = {"tie": {"nodes": ["wall", "tip"], "stiffness": 100.0}}
    raw["prestress"] = {"tension": {"tie": 0.0}}
    build_model(parse_scene(raw | {"point_masses": {"tip": 2.0}}))
    with pytest.raises(SceneError, match="2 N stay unbalanced at tip"):
        build_model(parse_scene(raw | {"point_masses": {"tip": 1.5}, "gravity": [1.0, 0.0, -9.81]}))


def test_afloat_under_a_gravity_vector():
    raw = {"name": "afloat", "nodes": {"a": [0, 0, 0], "b": [0, 0, 1]}, "gravity": [1.0, 0.0, 0.0]}
    raw["bars"] = {"bar": {"nodes": ["a", "b"], "mass": 1.0}}
    with pytest.raises(SceneError, match="No node is fixed"):
        build_model(parse_scene(raw))
    with pytest.raises(SceneError, match="no node is fixed"):
        build_model(parse_scene(raw | {"start": "settled"}))
