"""Joints in scene files: what the keys mean.  What mistakes in them are answered with stands in mistakes.toml."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tensegrity_core import load, reference, statics
from tensegrity_core.cli import main
from tensegrity_core.errors import SceneError
from tensegrity_core.model import grid, held
from tensegrity_core.scene import parse_scene
from tensegrity_core.statics import build_model
from tests.scene.test_scene import write

#: A four-bar frame with a slider, a weld and a push.
GOOD = """
name = "frame"
gravity = 9.81
start = "released"
fixed = ["n1", "n2.y", "n3.y", "n4.y", "n4.z", "n5.y"]
moving = ["n4.z"]
weld = [["b1", "b2"]]

[nodes]
n1 = [0.0, 0.0, 0.0]
n2 = [0.0, 0.0, 1.0]
n3 = [1.0, 0.0, 1.0]
n4 = [1.0, 0.0, 0.0]
n5 = [0.5, 0.0, 2.0]

[bars]
b1 = { nodes = ["n1", "n2"], mass = 1.0 }
b2 = { nodes = ["n2", "n3"], mass = 2.0 }
b3 = { nodes = ["n3", "n4"], mass = 0.0 }

[strings]
s1 = { nodes = ["n1", "n3"], stiffness = 100.0, damping = 1.0 }
s2 = { nodes = ["n2", "n5"], stiffness = 100.0 }
s3 = { nodes = ["n2", "n5"], stiffness = 200.0 }

[point_masses]
n4 = 0.5
n5 = 0.2

[velocities]
n2 = [0.4, 0.0, 0.0]
n3 = [0.4, 0.0, -0.4]
n4 = [0.4, 0.0, -0.4]
n5 = [0.0, 0.0, 0.3]

[prestress.rest_length]
s1 = 1.3
s2 = 1.0
s3 = 1.1
"""


def frame(tmp_path, text=GOOD):
    return load(write(tmp_path, text))


def test_what_the_keys_mean(tmp_path):
    model = frame(tmp_path)
    assert model.fixed.tolist() == [True, False, False, False, False]
    assert model.partly_fixed == ((1, (1,)), (2, (1,)), (3, (1, 2)), (4, (1,)))
    assert model.moving == (3,) and model.moving_axes == ((3, (2,)),)
    assert np.argwhere(model.moved).tolist() == [[3, 2]]
    assert model.held.sum() == 3 + 1 + 1 + 2 + 1
    assert model.welds == ((0, 1),) and model.bodies[0].distances == ((0, 2),)
    assert model.velocity[2].tolist() == [0.4, 0.0, -0.4] and not model.velocity[0].any()
    assert model.bar_mass[2] == 0.0 and model.joint


def test_it_can_be_simulated(tmp_path):
    """The moved slider starts with the velocity that the scene gives it, and goes on like that."""
    model = frame(tmp_path)
    result = reference.simulate(model, held(model, grid(0.5, 0.1)))
    np.testing.assert_allclose(result.position[:, 3, 2], -0.4 * result.times, rtol=0.0, atol=1e-14)
    assert np.abs(result.position[:, :, 1]).max() == 0.0 and result.ledger_error() < 1e-8
    corner = np.linalg.norm(result.position[:, 0] - result.position[:, 2], axis=1)
    np.testing.assert_allclose(corner, np.sqrt(2.0), rtol=1e-14)
    free = np.where(model.held, 0.0, model.velocity)  # along other axes motion is an input, and no result
    np.testing.assert_allclose(result.velocity[0], free, rtol=0.0, atol=1e-15)


def test_all_axes_of_a_planar_scene(tmp_path):
    """A node fixed along all axes of the plane but one is partly fixed; what the plane does not have needs no fixing."""
    text = (
        'plane = "xz"\nfixed = ["n1", "n2.z"]\nstart = "settled"\n[nodes]\nn1 = [0.0, 0.0]\nn2 = [1.0, 0.0]\nn3 = [0.4, 0.3]\n'
    )
    text += '[bars]\nb1 = { nodes = ["n1", "n3"], mass = 1.0 }\nb2 = { nodes = ["n3", "n2"], mass = 1.0 }\n'
    model = frame(tmp_path, text)
    assert model.partly_fixed == ((1, (2,)),)
    assert np.abs(statics.residual(model)).max() < 1e-10 and model.nodes[1, 2] == 0.0


def test_bars_and_strings_may_be_few(tmp_path):
    """A scene of one bar without mass between two point masses, without strings, afloat."""
    text = 'gravity = 0.0\n[nodes]\na = [0.0, 0.0, 0.0]\nb = [1.0, 0.0, 0.0]\n[bars]\nr = { nodes = ["a", "b"], mass = 0.0 }\n'
    text += "[point_masses]\na = 1.0\nb = 3.0\n[velocities]\na = [0.0, 3.0, 0.0]\nb = [0.0, -1.0, 0.0]\n"
    model = frame(tmp_path, text)
    result = reference.simulate(model, held(model, grid(2.0, 0.1)))
    angle = -4.0 * result.times  # about the centre of mass, at 0.75
    expected = 0.75 - 0.75 * np.array([np.cos(angle), np.sin(angle)]).T * 1.0
    np.testing.assert_allclose(result.position[:, 0, 0], expected[:, 0], rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(result.position[:, 0, 1], -0.75 * np.sin(angle), rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(result.bar_force, 0.75 * 1.0 * 16.0, rtol=1e-8)


def test_check_and_simulate(tmp_path, capsys):
    path = write(tmp_path, GOOD)
    assert main(["check", str(path)]) == 0
    told = capsys.readouterr().out
    assert "fixed along single axes: n2.y, n3.y, n4.y, n4.z, n5.y" in told and "one rigid body: b1, b2" in told
    assert "redundant" not in told
    braced = GOOD.replace('weld = [["b1", "b2"]]', "").replace("b3 = {", 'b4 = { nodes = ["n1", "n3"], mass = 1.0 }\nb3 = {')
    braced = braced.replace("b3 = {", 'b5 = { nodes = ["n1", "n3"], mass = 1.0 }\nb3 = {')
    assert main(["check", str(write(tmp_path, braced))]) == 0
    told = capsys.readouterr().out
    assert "redundant bars: b4, b5; their forces" in told and told.count("N (redundant)") == 2
    assert main(["simulate", str(path), "--duration", "0.1"]) == 0


SPANNED = """
start = "released"
gravity = 0.0
fixed = ["a", "c"]
[nodes]
a = [0.0, 0.0, 0.0]
b = [1.0, 0.0, 0.0]
c = [2.0, 0.0, 0.0]
[bars]
r = { nodes = ["a", "b"], mass = 1.0 }
s = { nodes = ["b", "c"], mass = 1.0 }
[velocities]
b = [0.0, 0.3, 0.0]
"""


def test_velocities_that_bars_can_follow_for_no_time(tmp_path):
    """Across a straight chain between two walls the lengths stay to first order only; a panel that turns as a whole is free."""
    with pytest.raises(SceneError, match=r"velocities.b = .*moves bars that hold each other, r, s, so that they cannot all"):
        frame(tmp_path, SPANNED)
    corners = {"p": [0.0, 0.0, 0.0], "q": [1.0, 0.0, 0.0], "r": [1.2, 0.0, 0.8], "t": [0.1, 0.0, 0.9]}
    pairs = {f"b{a}{b}": {"nodes": [a, b], "mass": 1.0} for a, b in ("pq", "qr", "rt", "tp", "pr", "qt")}
    turning = {name: np.cross([0.3, 1.0, -0.5], place).tolist() for name, place in corners.items()}
    scene = {"name": "panel", "start": "released", "gravity": 0.0, "nodes": corners, "bars": pairs}
    model = build_model(parse_scene(scene | {"velocities": turning}))
    assert model.redundant.all()
    with pytest.raises(SceneError, match="hold each other"):
        build_model(parse_scene(scene | {"velocities": {"p": [0.0, 0.5, 0.0]}}))


def test_a_weld_of_many_bars(tmp_path):
    """Its size is bounded, of welds that are joined by a bar, too."""
    names = [f"n{i}" for i in range(103)]
    nodes = {name: [float(i), float(i % 3), float(i % 5)] for i, name in enumerate(names)}
    bars = {f"b{i}": {"nodes": names[i : i + 2], "mass": 1.0} for i in range(102)}
    welds = [[f"b{i}" for i in range(60)], [f"b{i}" for i in range(59, 102)]]
    scene = {"name": "long", "start": "released", "gravity": 0.0, "nodes": nodes, "bars": bars, "weld": welds}
    with pytest.raises(SceneError, match=r"weld\[1\] = .*a rigid body of 102 bars, more than 100. Use longer"):
        parse_scene(scene)
    assert len(parse_scene(scene | {"weld": welds[:1]}).weld[0]) == 60


@pytest.mark.parametrize("start", ["equilibrium", "settled"])
def test_velocities_start_from_an_equilibrium(start, tmp_path):
    """Of a settled scene, too, whose nodes are not where the file has them."""
    text = f'start = "{start}"\nfixed = ["n1"]\n[nodes]\nn1 = [0.0, 0.0, 0.0]\nn2 = [0.0, 0.0, -1.0]\nn3 = [0.0, 0.0, -2.0]\n'
    text += '[bars]\nb1 = { nodes = ["n1", "n2"], mass = 1.0 }\nb2 = { nodes = ["n2", "n3"], mass = 1.0 }\n'
    text += "[velocities]\nn2 = [1.0, 0.0, 0.0]\nn3 = [-2.0, 0.5, 0.0]\n"
    model = frame(tmp_path, text)
    assert model.velocity[2].tolist() == [-2.0, 0.5, 0.0]
    rest = dataclasses.replace(model, velocity=0.0 * model.velocity)
    assert statics.unbalanced(rest).equilibrium
