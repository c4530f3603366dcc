"""MuJoCo models: scenes come back from them, and move there as they do here where the models agree; what does not is shown."""

from __future__ import annotations

from dataclasses import replace
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

import tensegrity_core as tc
from tensegrity_core import kernel, reference
from tensegrity_core.cli import main
from tensegrity_core.errors import InputError, TensegrityError
from tensegrity_core.interchange.mjcf_writing import document
from tensegrity_core.model import grid, held
from tests.reference.test_structures import FOLDER
from tests.support.driven_scenes import AFLOAT, built

SCENES = (
    "two_bar",
    "three_bar",
    "six_bar",
    "motes_double_pendulum",
    "stedy_ball",
    "stedy_dbar",
    "tnsgrt_bicycle_wheel",
    "tsg_jansen_leg",
)


def where(name):
    return FOLDER / f"{name}.toml" if (FOLDER / f"{name}.toml").exists() else name


def simulated(model, duration):
    run = reference.simulate if model.joint else kernel.simulate
    return run(model, held(model, grid(duration, duration))).position[-1]


def there(model, duration, step, integrator="RK4", **constraints):
    """(N, 3) m: where the nodes are after a time in MuJoCo, on the exported model."""
    root, _ = document(model, step, integrator)
    for one in root.iter("connect"):
        one.attrib.update(constraints)
    engine = mujoco.MjModel.from_xml_string(ElementTree.tostring(root, "unicode"))
    data = mujoco.MjData(engine)
    if engine.nkey:
        mujoco.mj_resetDataKeyframe(engine, data, 0)
    mujoco.mj_step(engine, data, nstep=round(duration / step))
    mujoco.mj_forward(engine, data)
    return np.array([data.site(name).xpos for name in model.node_names])


def off(model, duration, step, **options):
    return np.abs(there(model, duration, step, **options) - simulated(model, duration)).max()


@pytest.mark.parametrize("name", SCENES)
def test_scenes_come_back(name, tmp_path):
    model = tc.load(where(name))
    path, _ = tc.export_scene(where(name), tmp_path / "it.xml")
    back = tc.import_scene(path).model()
    order = [back.node_names.index(node) for node in model.node_names]
    np.testing.assert_allclose(back.nodes[order][:, back.axes], model.nodes[:, back.axes], atol=1e-12)
    assert set(back.string_names) == set(model.string_names) and set(back.bar_names) == set(model.bar_names)
    bars = [back.bar_names.index(bar) for bar in model.bar_names]
    np.testing.assert_allclose(back.bar_mass[bars], model.bar_mass, rtol=1e-9)
    np.testing.assert_allclose(back.node_mass[order], model.node_mass, rtol=1e-9, atol=1e-12)
    assert (back.held[order][:, back.axes] == model.held[:, back.axes]).all()
    assert back.axes == tuple(axis for axis in model.axes if not model.held[:, axis].all())
    assert np.abs((simulated(back, 0.2)[order] - simulated(model, 0.2))[:, back.axes]).max() < 1e-10


# --- the same motion -------------------------------------------------------------------------------------------------


def test_a_jointed_structure_moves_as_in_mujoco():
    """A double pendulum: no spring, no soft constraint; MuJoCo's integrators show their orders."""
    model = tc.load(where("motes_double_pendulum"))
    assert np.ptp(simulated(model, 0.5) - model.nodes) > 0.5
    assert off(model, 0.5, 1e-3) < 1e-10
    coarse, fine = (off(model, 0.5, step, integrator="implicit") for step in (1e-3, 1e-4))
    assert 1e-4 < coarse < 1e-2 and 5.0 < coarse / fine < 20.0, "of the first order"


def test_a_leg_on_rails_moves_as_in_mujoco():
    """Eight bars in a plane with nodes fixed along an axis across it, which MuJoCo has as hinges."""
    model = tc.load(where("tsg_jansen_leg"))
    model = replace(model, damping=0.0 * model.damping, gravity=(0.3, 0.0, -2.0))
    assert np.abs(simulated(model, 0.2) - model.nodes).max() > 1e-3
    assert off(model, 0.2, 1e-4) < 1e-10


def test_a_foot_that_slides_along_an_axis(tmp_path):
    scene = {
        "name": "foot",
        "start": "released",
        "fixed": ["a.z"],
        "nodes": {"a": [0, 0, 0], "b": [0.3, 0, 1], "c": [0.8, 0.2, 1]},
    }
    scene |= {"bars": {"b1": {"nodes": ["a", "b"], "mass": 1.0}, "b2": {"nodes": ["b", "c"], "mass": 0.5}}}
    scene |= {"velocities": dict.fromkeys("abc", (0.2, -0.1, 0.0))}
    for plane in (None, "xz"):
        if plane:
            scene |= {"plane": plane, "velocities": dict.fromkeys("abc", (0.2, 0.0))}
            scene["nodes"] = {"a": [0, 0], "b": [0.3, 1], "c": [0.8, 1]}
        model = built(scene)
        assert off(model, 0.4, 1e-3) < 1e-8
        (tmp_path / "foot.xml").write_text(ElementTree.tostring(document(model)[0], "unicode"), encoding="utf-8")
        back = tc.import_scene(tmp_path / "foot.xml").model()
        assert back.partly_fixed == ((back.node_names.index("a"), (2,)),) and back.axes == model.axes


def test_six_bars_move_as_in_mujoco_where_no_damper_acts():
    """Without dampers MuJoCo's RK4 comes to our motion; what its thin bodies have of a third moment of inertia is left."""
    model = tc.load("six_bar")
    model = replace(model, damping=0.0 * model.damping, gravity=(3.0, 1.0, -6.0))
    moved = np.abs(simulated(model, 0.3) - model.nodes).max()
    coarse, fine = (off(model, 0.3, step) for step in (1e-3, 1e-4))
    assert moved > 0.02 and fine < 1e-6 * moved and coarse > 20.0 * fine


def test_dampers_of_slack_tendons_are_what_differs():
    """A D-bar whose strings go slack: its dampers act there in MuJoCo and not here, by centimetres at any step; its soft
    constraints do by millimetres, unless they are as hard as the exported ones."""
    damped = tc.load(where("stedy_dbar"))
    free = replace(damped, damping=0.0 * damped.damping)
    assert off(damped, 0.5, 1e-4) > 0.01 and off(damped, 0.5, 2e-5) > 0.01
    assert off(free, 0.5, 1e-4, solref="0.02 1", solimp="0.9 0.95 0.001 0.5 2") > 1e-3
    assert off(free, 0.5, 1e-4) < 2e-6


def test_start_velocities_stand_in_a_keyframe(tmp_path):
    spun = built(AFLOAT | {"velocities": {"n1": [0.5, -0.4, 0.1], "n2": [0.1, 0.4, 0.4]}}, gravity=9.81)
    assert np.abs(spun.velocity).max() > 0.1 and off(spun, 0.5, 1e-3) < 1e-9
    flat = AFLOAT | {"plane": "xz", "gravity": 9.81, "nodes": {"n1": [0.0, 0.0], "n2": [0.6, 0.8]}}
    flat |= {"velocities": {"n1": [0.4, 0.2], "n2": [-0.4, 0.8]}}
    assert off(built(flat), 0.5, 1e-3) < 1e-9
    (tmp_path / "flat.xml").write_text(ElementTree.tostring(document(built(flat))[0], "unicode"), encoding="utf-8")
    back = tc.import_scene(tmp_path / "flat.xml").model()
    assert back.axes == (0, 2)
    np.testing.assert_allclose(back.velocity[:, [0, 2]], [[0.4, 0.2], [-0.4, 0.8]], atol=1e-12)


def test_point_masses_routes_and_springs_that_push(tmp_path):
    scene = {
        "name": "mobile",
        "start": "released",
        "fixed": ["hook", "wall"],
        "nodes": {"hook": [0, 0, 2], "wall": [1, 0, 2], "a": [0, 0, 1], "b": [0.8, 0, 1], "load": [0.4, 0.1, 0.5]},
        "bars": {"beam": {"nodes": ["a", "b"], "mass": 0.5}},
        "point_masses": {"a": 0.2, "load": 0.7},
        "strings": {
            "rope": {"nodes": ["hook", "a", "load", "b", "wall"], "stiffness": 300.0, "mass": 0.1},
            "spring": {"nodes": ["hook", "b"], "stiffness": 50.0, "two_way": True},
        },
        "prestress": {"rest_length": {"rope": 2.5, "spring": 1.5}},
    }
    model = built(scene)
    (tmp_path / "mobile.xml").write_text(ElementTree.tostring(document(model)[0], "unicode"), encoding="utf-8")
    found = tc.import_scene(tmp_path / "mobile.xml")
    back = found.model()
    assert found.tables["strings"]["spring"]["two_way"] and len(found.tables["strings"]["rope"]["nodes"]) == 5
    order = [back.node_names.index(node) for node in model.node_names]
    free = ~model.fixed
    np.testing.assert_allclose(back.node_mass[order][free], model.node_mass[free], rtol=1e-9)


# --- models of others ------------------------------------------------------------------------------------------------

FOREIGN = """
<mujoco model="a prism of others">
  <compiler angle="degree"/>
  <option gravity="0 0 -3"/>
  <default>
    <geom type="capsule" size="0.01" density="800"/>
    <default class="cable"><tendon stiffness="400" damping="3"/></default>
  </default>
  <worldbody>
    <site name="hook" pos="0 0 3"/>
    <geom name="floor" type="plane" size="5 5 1"/>
    <body name="mast" pos="0 0 1" euler="0 90 0">
      <freejoint/>
      <geom name="rod" fromto="0 0 -0.5 0 0 0.5"/>
      <site name="left" pos="0 0 -0.5"/><site name="right" pos="0 0 0.5"/>
      <body name="arm" pos="0 0 0.5"><joint type="ball"/>
        <geom name="boom" fromto="0 0 0 0.4 0 0"/><site name="tip" pos="0.4 0 0"/></body>
      <body name="flag" pos="0 0 -0.5"><geom name="pole" fromto="0 0 0 0 0.3 0"/></body>
    </body>
    <body name="ball" pos="1 1 2"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
      <joint type="slide" axis="0 0 1"/><geom type="sphere" size="0.05" mass="0.3"/></body>
  </worldbody>
  <tendon>
    <spatial name="stay" class="cable" springlength="0 1.5"><site site="hook"/><site site="left"/></spatial>
    <spatial name="brace" class="cable" springlength="0.5"><site site="tip"/><site site="left"/></spatial>
  </tendon>
  <actuator><motor tendon="stay"/></actuator>
</mujoco>
"""


def imported(folder, text):
    (folder / "it.xml").write_text(text, encoding="utf-8")
    return tc.import_scene(folder / "it.xml")


def test_a_model_of_others_in_numbers(tmp_path):
    found = imported(tmp_path, FOREIGN)
    model, at = found.model(), found.tables["nodes"]
    assert model.name == "a_prism_of_others" and model.gravity == (0.0, 0.0, -3.0)
    np.testing.assert_allclose([at["left"], at["right"], at["tip"]], [[-0.5, 0, 1], [0.5, 0, 1], [0.5, 0, 0.6]], atol=1e-12)
    assert at["hook"] == [0, 0, 3] and found.tables["fixed"] == ["hook"]
    assert found.tables["weld"] == [["rod", "pole"]] and found.tables["point_masses"]["ball"] == pytest.approx(0.3)
    engine = mujoco.MjModel.from_xml_string(FOREIGN)
    assert model.node_mass.sum() == pytest.approx(engine.body_mass.sum(), rel=1e-9)
    assert found.tables["strings"]["brace"]["two_way"] and found.tables["strings"]["stay"]["stiffness"] == 400.0
    told = "\n".join(found.notes)
    assert "Left out: actuators, planes." in told and "divided among its bars" in told and "slack" in told
    assert np.isfinite(simulated(model, 0.05)).all()
    assert main(["import", str(tmp_path / "it.xml"), "-o", str(tmp_path / "it.toml"), "--unit", "0.5"]) == 0
    np.testing.assert_allclose(tc.load(tmp_path / "it.toml").nodes, 0.5 * model.nodes)


@pytest.mark.parametrize(
    "before, after, says",
    [
        ("</mujoco>", "", "is no model that MuJoCo reads"),
        ('type="ball"', 'type="hinge"', "hinges and free or ball joints"),
        ('type="ball"', 'type="slide"', "the body arm neither floats nor turns about one point"),
        ('springlength="0 1.5"', 'springlength="0.5 1.5"', "the tendon stay has a spring between 0.5 and 1.5"),
        (
            '<site site="tip"/>',
            '<site site="tip"/><pulley divisor="2"/><site site="tip"/>',
            "is no model|runs over geoms, pulleys",
        ),
        ('<joint type="ball"/>', '<joint type="ball" stiffness="3"/>', "joints have stiffness or damping"),
        ("<mujoco model", "<!DOCTYPE x [<!ENTITY a 'b'>]><mujoco model", "DOCTYPE"),
        ('<geom name="boom"', '<inertial pos="0 3 0" mass="1" diaginertia="1 1 1"/><geom name="boom"', "mass elsewhere"),
        ("<actuator>", '<equality><weld body1="arm" body2="ball"/></equality><actuator>', "is no `connect` of two bodies"),
        ("<actuator>", '<equality><connect site1="tip" site2="left"/></equality><actuator>', "is no `connect` of two bodies"),
    ],
)
def test_what_means_nothing_here_is_named(before, after, says, tmp_path):
    assert FOREIGN.count(before) == 1
    with pytest.raises(InputError, match=says):
        imported(tmp_path, FOREIGN.replace(before, after))


@pytest.mark.parametrize(
    "text", ["", "<mujoco/>", "<mujoco", "\0", "<a>" * 100_000, "<mujoco><worldbody><body/></worldbody></mujoco>"]
)
def test_files_that_are_no_models(text, tmp_path):
    with pytest.raises(TensegrityError):
        imported(tmp_path, text)


def test_what_mjcf_cannot_say_is_refused_and_nothing_is_written(tmp_path, capsys):
    for scene, says in (
        ("three_bar_nsh", "cannot say the NSH of s1, s2, s3"),
        (FOLDER / "tsg_dbar3d.toml", "cannot say n2, which is fixed along some axes only, on a body that is held elsewhere"),
    ):
        with pytest.raises(InputError, match=says):
            tc.export_scene(scene, tmp_path / "it.xml")
    heavy = tc.load("three_bar", {"strings.s1.mass": 0.1, "string_mass_matrix": "consistent"})
    with pytest.raises(InputError, match="cannot say the consistent mass of s1"):
        document(heavy)
    assert not list(tmp_path.iterdir())
    assert main(["export", "six_bar", "--to", "mjcf", "--output", str(tmp_path / "it.xml")]) == 0
    assert "A tendon's damper acts while the tendon is slack, too" in capsys.readouterr().out
