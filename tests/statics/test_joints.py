"""Statics of bars that share nodes, against closed forms; see also tests/reference/test_structures.py."""

from __future__ import annotations

import numpy as np
import pytest
import scipy

import tensegrity_core as tc
from tensegrity_core import statics
from tensegrity_core.cli import main
from tensegrity_core.equilibria.equilibrium import Equations
from tensegrity_core.equilibria.loading import Loading
from tensegrity_core.equilibria.modes import modes
from tensegrity_core.equilibria.steady_states import load_sweep
from tensegrity_core.errors import InputError, SceneError
from tensegrity_core.scene import parse_scene
from tensegrity_core.statics import build_model
from tests.support import by_hand

GRAVITY = 9.81


def framed(nodes, fixed, bars, **fields):
    return by_hand(nodes, fixed, bars, [], stiffness=[], rest_length=[], **{"gravity": GRAVITY} | fields)


def cross(angle: float) -> dict:
    """A T-bar unit: four bars that meet in the middle, four strings around them; angle: of the strings to the long bars."""
    half = float(np.tan(angle))
    ends = {"m": [0.0, 0.0], "w": [-1.0, 0.0], "e": [1.0, 0.0], "n": [0.0, half], "s": [0.0, -half]}
    strings = {"wn": ["w", "n"], "ne": ["n", "e"], "es": ["e", "s"], "sw": ["s", "w"]}
    return {
        "name": "t_bar",
        "plane": "xz",
        "gravity": 0.0,
        "nodes": ends,
        "bars": {f"b{end}": {"nodes": ["m", end], "mass": 1.0} for end in "wens"},
        "strings": {name: {"nodes": nodes, "stiffness": 1000.0} for name, nodes in strings.items()},
        "prestress": {"tension": {"wn": 10.0}},
    }


#: A D-bar on a pin and a slider, with two strings across it.
SQUEEZED = {
    "name": "squeezed",
    "plane": "xz",
    "start": "settled",
    "fixed": ["w", "e.z"],
    "nodes": {"w": [-0.9, 0.0], "n": [0.0, 0.43], "e": [0.9, 0.0], "s": [0.0, -0.43]},
    "bars": {a + b: {"nodes": [a, b], "mass": 1.0} for a, b in ("wn", "ne", "es", "sw")},
    "strings": {a + b: {"nodes": [a, b], "stiffness": 500.0, "damping": 5.0} for a, b in ("we", "ns")},
    "prestress": {"tension": {"we": 30.0, "ns": 20.0}},
}


def test_t_bar():
    """One state of self-stress: all strings t, long bars -2 t cos, short bars -2 t sin; no mechanism; stable."""
    angle = np.radians(20.0)
    model = build_model(parse_scene(cross(angle)))
    forces = statics.member_forces(model)
    np.testing.assert_allclose(forces[:4], 10.0, rtol=1e-12)
    long, short = -20.0 * np.cos(angle), -20.0 * np.sin(angle)
    np.testing.assert_allclose(forces[4:], [long, long, short, short], rtol=1e-12)
    found = statics.analyse(model)
    assert found.self_stress.shape[1] == 1 and len(found.mechanisms) == 0 and found.rigid_body_motions == 3
    assert statics.stability(model).stable and statics.unbalanced(model).equilibrium and not model.redundant.any()


def test_d_bar():
    """A rhombus of bars with the half angle a: the string across has tan a of the tension t of the string along; the bars have
    t / (2 cos a)."""
    angle = np.radians(25.0)
    c, s = float(np.cos(angle)), float(np.sin(angle))
    scene = {
        "name": "d_bar",
        "plane": "xz",
        "gravity": 0.0,
        "nodes": {"w": [-c, 0.0], "n": [0.0, s], "e": [c, 0.0], "s": [0.0, -s]},
        "bars": {a + b: {"nodes": [a, b], "mass": 1.0} for a, b in ("wn", "ne", "es", "sw")},
        "strings": {a + b: {"nodes": [a, b], "stiffness": 500.0} for a, b in ("we", "ns")},
        "prestress": {"tension": {"we": 30.0}},
    }
    model = build_model(parse_scene(scene))
    forces = statics.member_forces(model)
    np.testing.assert_allclose(forces[:2], [30.0, 30.0 * np.tan(angle)], rtol=1e-12)
    np.testing.assert_allclose(forces[2:], -15.0 / c, rtol=1e-12)
    assert statics.stability(model).stable


def test_prestress_asks_for_what_is_missing():
    scene = cross(0.4)
    scene["prestress"] = {}
    with pytest.raises(SceneError, match="leaves 1 tension undetermined.*Give 1 more tension"):
        build_model(parse_scene(scene))


def test_redundant_bars_leave_no_tension_open():
    """Two bars side by side hold each other; the strings' tensions are determined all the same, and they share the force."""
    scene = cross(0.4)
    scene["bars"]["again"] = {"nodes": ["m", "e"], "mass": 1.0}
    model = build_model(parse_scene(scene))
    forces = dict(zip((*model.string_names, *model.bar_names), statics.member_forces(model)))
    np.testing.assert_allclose(forces["ne"], 10.0, rtol=1e-9)
    np.testing.assert_allclose([forces["be"], forces["again"]], -10.0 * np.cos(0.4), rtol=1e-9)
    assert dict(zip(model.bar_names, model.redundant)) == {"bw": False, "be": True, "bn": False, "bs": False, "again": True}


@pytest.mark.parametrize("axes", [(0, 2), (0, 1, 2)])
def test_chain_between_two_walls(axes):
    """Rods of weight w that hang between two walls: the horizontal force H is the same in all, and the slope of rod i is
    w (i - (n-1)/2) / H; H follows from the span."""
    n, span, w = 7, 5.2, GRAVITY
    step = np.arange(n) - (n - 1) / 2

    def reach(H):
        return np.sum(1.0 / np.sqrt(1.0 + (w * step / H) ** 2)) - span

    H = scipy.optimize.brentq(reach, 1e-3, 1e3, xtol=1e-14)
    slope = np.arctan(w * step / H)
    turn = scipy.optimize.brentq(lambda k: np.sum(np.cos(k * step)) - span, 0.01, 0.8)  # from an arc of equal chords
    links = np.array([np.cos(turn * step), 0.0 * step, np.sin(turn * step)]).T
    nodes = np.vstack((np.zeros(3), np.cumsum(links, axis=0)))
    model = statics.settle(framed(nodes, [0, n], [(i, i + 1) for i in range(n)], axes=axes))
    found = np.diff(model.nodes, axis=0)
    np.testing.assert_allclose(np.arctan2(found[:, 2], found[:, 0]), slope, rtol=0.0, atol=1e-9)
    # in the mean over a rod, H / cos of its slope
    np.testing.assert_allclose(statics.member_forces(model), H / np.cos(slope), rtol=1e-9)
    assert statics.stability(model).stable


def test_chain_hangs_down():
    """From anywhere, upside down nearly."""
    angles = np.array([2.9, -2.0, 1.0, 0.4])
    links = np.array([np.sin(angles), 0.0 * angles, -np.cos(angles)]).T
    nodes = np.vstack((np.zeros(3), np.cumsum(links, axis=0)))
    model = statics.settle(framed(nodes, [0], [(i, i + 1) for i in range(4)]))
    np.testing.assert_allclose(model.nodes[:, 2], -np.arange(5.0), rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(statics.member_forces(model), GRAVITY * np.array([3.5, 2.5, 1.5, 0.5]), rtol=1e-9)


def test_modes_of_a_double_pendulum():
    """det(K - w^2 M) = 0 of the theory; in space each twice."""
    M, K = np.array([[4 / 3, 1 / 2], [1 / 2, 1 / 3]]), GRAVITY * np.diag([1.5, 0.5])
    expected = np.sqrt(scipy.linalg.eigh(K, M, eigvals_only=True))
    nodes = [[0, 0, 0], [0, 0, -1], [0, 0, -2]]
    for axes in ((0, 2), (0, 1, 2)):
        found = sorted(abs(mode.eigenvalue) for mode in modes(framed(nodes, [0], [(0, 1), (1, 2)], axes=axes)))
        np.testing.assert_allclose(found, np.repeat(expected, len(axes) - 1), rtol=1e-9)


@pytest.mark.parametrize("axes", [(0, 2), (0, 1, 2)])
def test_welded_corner_hangs_by_its_end(axes):
    """Its centre of mass below the pin: tan of the angle is 1/3 for a corner of two equal rods."""
    model = framed([[0, 0, 0], [0, 0, -1], [1, 0, -1]], [0], [(0, 1), (1, 2)], axes=axes, welds=[(0, 1)])
    settled = statics.settle(model)
    np.testing.assert_allclose(
        settled.nodes[1], [-np.sin(np.arctan(1 / 3)), 0.0, -np.cos(np.arctan(1 / 3))], rtol=0.0, atol=1e-9
    )
    assert statics.unbalanced(settled).equilibrium and statics.stability(settled).stable
    assert np.linalg.norm(settled.nodes[2] - settled.nodes[0]) == pytest.approx(np.sqrt(2.0), rel=1e-14)


def test_welded_beam_on_two_supports():
    """Bars in a line, on a pin and a slider, bear a string that pulls at their middle if they are welded: by bending."""
    nodes = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 0, -2]]
    fields = {"axes": (0, 2), "partly_fixed": [(2, (2,))], "stiffness": 100.0, "rest_length": 1.9, "gravity": GRAVITY}
    hinged = by_hand(nodes, [0, 3], [(0, 1), (1, 2)], [(1, 3)], **fields)
    welded = by_hand(nodes, [0, 3], [(0, 1), (1, 2)], [(1, 3)], **fields, welds=[(0, 1)])
    assert not statics.unbalanced(hinged).equilibrium and statics.analyse(hinged).self_stress.shape[1] == 0
    assert statics.unbalanced(welded).equilibrium and len(statics.analyse(welded).mechanisms) == 0
    np.testing.assert_allclose(statics.member_forces(welded), [10.0, 0.0, 0.0], rtol=0.0, atol=1e-9)
    assert statics.analyse(welded).self_stress.shape[1] == 1  # string and bending
    np.testing.assert_allclose(statics.settle(welded).nodes, nodes, rtol=0.0, atol=1e-9)


def test_forces_of_a_long_chain_take_little():
    """3000 rods that hang: a time in proportion to them, not to their square or cube."""
    nodes = np.zeros((3001, 3))
    nodes[:, 2] = -np.arange(3001)
    model = framed(nodes, [0], [(i, i + 1) for i in range(3000)])
    np.testing.assert_allclose(statics.member_forces(model), GRAVITY * (2999.5 - np.arange(3000)), rtol=1e-9)
    assert statics.unbalanced(model).equilibrium
    with pytest.raises(statics.TooLarge):
        statics.analyse(model)


def test_path_of_a_d_bar():
    """Followed by either means, through a snap, to where settling from the start leads as well."""
    model = build_model(parse_scene(SQUEEZED))
    direction = np.zeros((4, 3))
    direction[1, 2], direction[2, 0] = -1.0, 0.3
    loads = [0.0, 30.0, 60.0]
    for careful in (False, True):
        sweep = load_sweep(Loading(model, force_direction=direction), loads, careful=careful)
        for p, nodes in zip(loads, sweep.nodes):
            np.testing.assert_allclose(nodes, statics.settle(model, force=p * direction).nodes, rtol=0.0, atol=1e-9)
        assert len(sweep.jumps) == 1 and sweep.nodes[2, 1, 2] < 0.0


def test_what_is_not_followed_is_said():
    scene = cross(0.4)
    scene["bars"]["again"] = {"nodes": ["m", "e"], "mass": 1.0}
    with pytest.raises(InputError, match="no path is followed of redundant bars such as be"):
        Equations(Loading(build_model(parse_scene(scene))))
    scene = cross(0.4) | {"weld": [["bw", "be"]], "prestress": {"tension": {"wn": 10.0, "es": 10.0}}}
    with pytest.raises(InputError, match=r"welded bars in a line or plane \(bw, be\) yet; settle"):
        Equations(Loading(build_model(parse_scene(scene))))


def test_equilibrium_and_modes_of_the_api():
    """A steady state under a force, by name, and the motions about it."""
    model = build_model(parse_scene(SQUEEZED))
    state = tc.equilibrium(model, {"n.force.z": -10.0})
    force = np.zeros((4, 3))
    force[1, 2] = -10.0
    assert state["n.z"].item() == pytest.approx(statics.settle(model, force=force).nodes[1, 2], abs=1e-9)
    assert state["we.force"].item() > 0.0
    assert [mode.eigenvalue for mode in tc.modes(model)] == pytest.approx([mode.eigenvalue for mode in modes(model)])


@pytest.mark.filterwarnings("error")
def test_a_frame_that_folds_flat():
    """A weight that no string holds folds the D-bar until its string along has two bars' lengths, and the ends of the slack one
    meet: nothing is divided by its length."""
    scene = SQUEEZED | {"bars": SQUEEZED["bars"] | {"wn": {"nodes": ["w", "n"], "mass": 1e9}}}
    model = build_model(parse_scene(scene))
    apart = np.linalg.norm(model.nodes[1] - model.nodes[3])
    assert apart < 1e-6 and statics.unbalanced(model).equilibrium and np.isfinite(statics.member_forces(model)).all()


def test_check_of_a_long_chain(tmp_path, capsys):
    """What takes too long is left out, and said; forces there are."""
    nodes = "\n".join(f"n{i} = [0.0, {-float(i)}]" for i in range(1101))
    bars = "\n".join(f'b{i} = {{ nodes = ["n{i}", "n{i + 1}"], mass = 1.0 }}' for i in range(1100))
    path = tmp_path / "chain.toml"
    path.write_text(f'plane = "xz"\nfixed = ["n0"]\n[nodes]\n{nodes}\n[bars]\n{bars}\n', encoding="utf-8")
    assert main(["check", str(path)]) == 0
    told = capsys.readouterr().out
    assert "not known whether it is stable" in told and "bars: 4.905 to 10786.1 N" in told
    path.write_text(path.read_text(encoding="utf-8").replace("fixed", 'start = "settled"\nfixed'), encoding="utf-8")
    assert main(["check", str(path)]) == 2
    assert "start = 'settled': chain: settling bars that share nodes is for structures of up to 2000" in capsys.readouterr().err
