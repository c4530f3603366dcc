"""Starts at rest on the ground."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest
import scipy

from tensegrity_core import equilibrium, load, modes, reference, statics
from tensegrity_core.cli import main
from tensegrity_core.errors import InputError, SceneError
from tensegrity_core.model import Contact, Ground, grid, held
from tests.scene.test_scene import write
from tests.support import by_hand

GRAVITY, STIFFNESS = 9.81, 2e4
#: The expandable octahedron of bars 1 m long, and its cables.
OCTAHEDRON = {
    f"n{4 * i + 2 * (u < 0) + (v < 0) + 1}": np.roll([0.5 * u, 0.0, 0.25 * v], i)
    for i in range(3)
    for v in (1, -1)
    for u in (1, -1)
}


def octahedron(turn, start="settled", height=0.02, **ground):
    """A scene's text: it lies on one of its triangles where turn (rad, about x) is 0, and height (m) over the ground."""
    rotation = scipy.spatial.transform.Rotation.from_euler("x", turn)
    flat = scipy.spatial.transform.Rotation.align_vectors([[0.0, 0.0, 1.0]], [np.ones(3) / np.sqrt(3.0)])[0]
    places = {name: rotation.apply(flat.apply(place)) for name, place in OCTAHEDRON.items()}
    lowest = min(place[2] for place in places.values())
    names = list(places)

    def apart(i, j):
        return np.linalg.norm(OCTAHEDRON[i] - OCTAHEDRON[j])

    pairs = [(i, j) for k, i in enumerate(names) for j in names[k + 1 :]]
    bars = [(i, j) for i, j in pairs if np.count_nonzero(OCTAHEDRON[i] - OCTAHEDRON[j]) == 1 and apart(i, j) == 1.0]
    cables = [pair for pair in pairs if abs(apart(*pair) - np.sqrt(0.375)) < 1e-9]
    lines = ['name = "octahedron"', f'start = "{start}"', "[nodes]"]
    lines += [f"{name} = {(place - [0.0, 0.0, lowest - height]).tolist()}" for name, place in places.items()]
    lines += ["[bars]", *(f"b{k} = {{ nodes = {json.dumps(pair)}, mass = 1.0 }}" for k, pair in enumerate(bars, 1))]
    lines += ["[materials.cable]", "stiffness = 2000.0", "damping = 20.0", "[strings]"]
    lines += [f's{k} = {{ nodes = {json.dumps(pair)}, material = "cable" }}' for k, pair in enumerate(cables, 1)]
    lines += ["[prestress.tension]", *(f"s{k} = 60.0" for k in range(1, len(cables) + 1))]
    lines += ["[ground]", *(f"{key} = {value}" for key, value in ({"stiffness": STIFFNESS} | ground).items())]
    return "\n".join(lines)


@pytest.mark.parametrize("turn, borne", [(0.0, [19.62, 19.62, 19.62]), (1.2, None)])
def test_it_settles_on_a_triangle_and_rests(turn, borne, tmp_path):
    """Above the ground, lying or tilted: it comes down on three nodes, and by the reference stays there."""
    model = load(write(tmp_path, octahedron(turn, friction=0.5, damping=0.2)))
    pressed = statics.pressures(model, model.nodes)
    assert np.count_nonzero(pressed) == 3 and pressed.sum() == pytest.approx(6.0 * GRAVITY, abs=1e-9)
    if borne:
        np.testing.assert_allclose(pressed[pressed > 0.0], borne, rtol=1e-9)
    assert statics.unbalanced(model).equilibrium and statics.stability(model).stable
    assert not model.velocity.any()
    result = reference.simulate(model, held(model, grid(0.5, 0.25)))
    assert np.abs(result.position - model.nodes).max() < 1e-12 and not result.transitions
    assert result.contact_sticking.sum() == 3 * 3
    assert not result.contact_force.any() or np.abs(result.contact_force).max() < 1e-8


def test_one_that_stands_starts_there(tmp_path):
    """The settled coordinates written down are in equilibrium; a little higher they are not, and say what to do."""
    settled = load(write(tmp_path, octahedron(0.0)))
    text = octahedron(0.0, start="equilibrium")
    for name, place in zip(settled.node_names, settled.nodes.tolist()):
        line = next(line for line in text.splitlines() if line.startswith(f"{name} = "))
        text = text.replace(line + "\n", f"{name} = {place}\n")
    lines = [f"s{i + 1} = {length!r}" for i, length in enumerate(settled.rest_length.tolist())]
    begin, end = text.index("[prestress"), text.index("[ground]")
    text = text[:begin] + "\n".join(["[prestress.rest_length]", *lines, ""]) + text[end:]
    model = load(write(tmp_path, text))
    np.testing.assert_array_equal(model.nodes, settled.nodes)
    with pytest.raises(SceneError, match='stay unbalanced at .* Write start = "settled" .or "released".: the ground bears 0 N'):
        load(write(tmp_path, text.replace("stiffness = 20000.0", "stiffness = 20000.0\npoint = [0.0, 0.0, -1.0]")))


def test_bars_alone():
    """A bar on two nodes of unlike ground stands as deep as each is soft; what rolls is neutral."""
    nodes = [[0.0, 0.0, 0.05], [1.0, 0.0, 0.02]]
    contacts = [Contact(0, 1e4, 0.0, 1e4, 0.3), Contact(1, 3e4, 0.0, 1e4, 0.3)]
    fields = {"stiffness": [], "rest_length": [], "damping": [], "gravity": GRAVITY, "ground": Ground(), "contacts": contacts}
    for axes in ((0, 2), (0, 1, 2)):
        model = statics.settle(by_hand(nodes, [], [(0, 1)], [], axes=axes, **fields))
        np.testing.assert_allclose(statics.depths(model, model.nodes), [0.5 * GRAVITY / 1e4, 0.5 * GRAVITY / 3e4], rtol=1e-9)
        assert statics.stability(model).stable
    masses = {"bar_mass": [], "point_mass": [(0, 2.0), (1, 1.0)]}
    model = statics.settle(by_hand(nodes, [], [], [], **(fields | masses)))
    np.testing.assert_allclose(statics.pressures(model, model.nodes), [2.0 * GRAVITY, GRAVITY], rtol=1e-9)


def test_under_a_force():
    """It presses what it stands on, and may lift a node off."""
    nodes = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    contacts = [Contact(i, STIFFNESS, 0.0, STIFFNESS, 0.0) for i in range(2)]
    fields = {"stiffness": [], "rest_length": [], "damping": [], "gravity": GRAVITY, "ground": Ground(), "contacts": contacts}
    model = by_hand(nodes, [], [(0, 1)], [], axes=(0, 2), bar_mass=2.0, **fields)
    down = np.array([[0.0, 0.0, -10.0], [0.0, 0.0, 4.0]])
    found = statics.settle(model, down)
    np.testing.assert_allclose(statics.pressures(model, found.nodes), [GRAVITY + 10.0, GRAVITY - 4.0], rtol=1e-8)


def test_where_there_is_no_rest(tmp_path):
    """Afloat on an incline, without friction; torn off by more than the weight; with a string up the slope it hangs."""
    slope = octahedron(0.0, normal=[0.1, 0.0, 1.0], friction=0.9)
    with pytest.raises(SceneError, match="the ground, here without friction, does not bear 5.8.* N of the loads; .*released"):
        load(write(tmp_path, slope))
    contacts = [Contact(0, STIFFNESS, 0.0, STIFFNESS, 0.0)]
    fields = {"stiffness": [], "rest_length": [], "damping": [], "gravity": GRAVITY, "ground": Ground(), "contacts": contacts}
    mass = by_hand([[0.0, 0.0, 0.0]], [], [], [], bar_mass=[], point_mass=[(0, 1.0)], **fields)
    with pytest.raises(statics.NoEquilibrium, match=r"does not bear 0\.\d+ N of the loads"):
        statics.settle(mass, np.array([[0.0, 0.0, 10.0]]))
    normal = np.array([-0.6, 0.0, 0.8])
    tied = by_hand(
        [[0.0, 0.0, 0.0], [0.8, 0.0, 0.6]],
        [1],
        [],
        [(0, 1)],
        **(fields | {"bar_mass": [], "stiffness": 500.0, "rest_length": 1.0, "damping": 1.0}),
        point_mass=[(0, 1.0)],
    )
    hanging = statics.settle(dataclasses.replace(tied, ground=Ground(normal=tuple(normal))))
    assert statics.pressures(hanging, hanging.nodes)[0] == pytest.approx(0.8 * GRAVITY, rel=1e-2)
    assert statics.member_forces(hanging)[0] == pytest.approx(0.6 * GRAVITY, rel=1e-2)
    assert statics.unbalanced(hanging).equilibrium


def test_check_says_what_the_ground_bears(tmp_path, capsys):
    path = write(tmp_path, octahedron(0.0))
    assert main(["check", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "ground: 3 of 12 nodes stand on it and press with 58.86 N" in printed and "19.62 N" in printed
    assert main(["check", str(path), "--json"]) == 0
    assert sorted(json.loads(capsys.readouterr().out)["ground"].values()) == pytest.approx([19.62] * 3)


def test_what_does_not_know_the_ground_says_so(tmp_path):
    path = write(tmp_path, octahedron(0.0))
    with pytest.raises(InputError, match="octahedron: it stands on the ground, which modes do not know yet"):
        modes(path)
    state = equilibrium(path, {"n1.force.z": -5.0})
    assert statics.pressures(state.model, state.model.nodes).sum() == pytest.approx(6.0 * GRAVITY + 5.0, abs=1e-6)
