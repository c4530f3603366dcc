"""Towers: their topology, prestress and stability, their files, and what large ones cost."""

from __future__ import annotations

import time
import tracemalloc
from collections import Counter

import numpy as np
import pytest

from tensegrity_core.errors import InputError, SceneError
from tensegrity_core.kernel import simulate
from tensegrity_core.model import grid, held
from tensegrity_core.scene import load_scene
from tensegrity_core.scene.towers import (
    END_OVERLAP,
    HEIGHT,
    INNER_OVERLAP,
    coordinates,
    inner_densities,
    members,
    overlaps,
    tower,
    tower_text,
)
from tensegrity_core.statics import analyse, build_model, member_forces, residual, stability, tangent_stiffness


def ends(model, table, extra=None) -> Counter:
    """Members as unordered pairs of given node positions, with something that belongs to each."""
    extra = [None] * len(table) if extra is None else extra
    return Counter((frozenset(map(tuple, model.nominal[pair])), more) for pair, more in zip(table, extra))


# --- topology and geometry ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("suffix", ["", "_nsh"])
@pytest.mark.parametrize("stages, name", [(1, "three_bar"), (2, "six_bar")])
def test_one_and_two_stages_are_the_built_in_scenes(stages, name, suffix):
    ours, theirs = build_model(tower(stages, nsh=bool(suffix))), build_model(load_scene(name + suffix))
    np.testing.assert_array_equal(ours.nominal, theirs.nominal)
    np.testing.assert_array_equal(ours.fixed, theirs.fixed)
    assert ends(ours, ours.bars, ours.bar_mass) == ends(theirs, theirs.bars, theirs.bar_mass)
    properties = [[*zip(m.nsh, m.stiffness, m.damping)] for m in (ours, theirs)]
    assert ends(ours, ours.strings, properties[0]) == ends(theirs, theirs.strings, properties[1])
    np.testing.assert_allclose(ours.nodes, theirs.nodes, atol=1e-9)
    assert ours.gravity == theirs.gravity and ours.damping_law == theirs.damping_law


@pytest.mark.parametrize("stages", [1, 2, 3, 8])
def test_members(stages):
    found, nodes = members(stages), coordinates(stages)
    counts = Counter(member.kind for member in found)
    faces = 3 * (stages - 1)
    assert +counts == +Counter(
        {"bar": 3 * stages, "vertical": 3 * stages, "top": 3}
        | {"saddle": 2 * faces, "lower diagonal": faces, "upper diagonal": faces}
    )
    assert len({frozenset(member.ends) for member in found}) == len(found)
    bar_ends = [end for member in found if member.kind == "bar" for end in member.ends]
    assert sorted(bar_ends) == list(range(6 * stages))
    # members of one kind differ in length only where the overlaps do, or where a coordinate is rounded to 1 mm
    alike = {}
    for member in found:
        at_an_end = member.kind not in ("bar", "vertical") and member.stage in (0, stages - 2)
        a, b = member.ends
        alike.setdefault((member.kind, at_an_end), []).append(np.linalg.norm(nodes[a] - nodes[b]))
    assert all(np.ptp(length) < 2e-3 for length in alike.values())


def test_handedness_alternates():
    model = build_model(tower(6))
    along = model.nominal[model.bars[:, 1]] - model.nominal[model.bars[:, 0]]
    foot = model.nominal[model.bars[:, 0]]
    moment = np.cross(foot, along)[:, 2].reshape(6, 3)
    assert (np.sign(moment) == np.array([-1, 1, -1, 1, -1, 1])[:, None]).all()


def test_overlaps():
    assert overlaps(1) == []
    assert overlaps(3) == [END_OVERLAP, END_OVERLAP]
    assert overlaps(5) == [END_OVERLAP, INNER_OVERLAP, INNER_OVERLAP, END_OVERLAP]
    top = coordinates(5)[:, 2].max()
    assert top == pytest.approx(5 * HEIGHT - 2 * END_OVERLAP - 2 * INNER_OVERLAP)


# --- prestress ---------------------------------------------------------------------------------------------------


def test_inner_nodes_balance_as_given():
    """Bars aside, the strings' pulls on a node of an inner stage add up to a force along its bar."""
    scene, stages = tower(7, tension=55.0), 7
    nodes, strings = coordinates(stages), [m for m in members(stages) if m.kind != "bar"]
    tension = np.array(list(scene.prestress.tension.values()))
    pull = np.zeros_like(nodes)
    for (a, b), force in zip((m.ends for m in strings), tension):
        unit = (nodes[b] - nodes[a]) / np.linalg.norm(nodes[b] - nodes[a])
        pull[a] += force * unit
        pull[b] -= force * unit
    inner = [m for m in members(stages) if m.kind == "bar" and m.stage in (2, 3, 4)]
    for a, b in (m.ends for m in inner):
        bar = (nodes[b] - nodes[a]) / np.linalg.norm(nodes[b] - nodes[a])
        np.testing.assert_allclose(pull[a], bar * (pull[a] @ bar), atol=1e-5)
        np.testing.assert_allclose(pull[b], bar * (pull[b] @ bar), atol=1e-5)
        assert pull[a] @ bar > 50.0  # the strings press the bar
    saddles = [t for m, t in zip(strings, tension) if m.kind == "saddle" and 0 < m.stage < stages - 2]
    np.testing.assert_allclose(saddles, 55.0, atol=1e-5)


def test_inner_densities_are_positive():
    assert all(0.0 < value < 1.0 for value in inner_densities().values())


@pytest.mark.parametrize("stages, nsh", [(3, False), (3, True), (5, False), (10, True), (30, False), (60, True), (200, False)])
def test_settled_towers_are_taut_and_stable(stages, nsh):
    """Both sides of the size at which settling turns to sparse matrices."""
    model = build_model(tower(stages, nsh=nsh))
    assert (len(model.bars), len(model.strings)) == (3 * stages, 15 * stages - 9)
    force = member_forces(model)
    string_force, bar_force = np.split(force, [len(model.strings)])
    assert np.abs(residual(model)).max() <= 1e-10 * string_force.max()
    assert string_force.min() > 5.0 and 40.0 < string_force.max() < 42.0
    assert bar_force.max() < -40.0
    found = stability(model)
    assert found.stable and found.lowest > 0.0
    # given coordinates and tensions are close: nothing accumulates with height
    assert np.linalg.norm(model.nodes - model.nominal, axis=1).max() < 2.5e-3
    given = np.array(list(tower(stages, nsh=nsh).prestress.tension.values()))
    np.testing.assert_allclose(string_force, given, atol=1.5)
    length = np.linalg.norm(model.nodes[model.bars[:, 1]] - model.nodes[model.bars[:, 0]], axis=1)
    nominal = np.linalg.norm(model.nominal[model.bars[:, 1]] - model.nominal[model.bars[:, 0]], axis=1)
    # coordinates resolve a length to the round-off of the height
    np.testing.assert_allclose(length, nominal, atol=4.0 * np.spacing(model.nodes.max()))


@pytest.mark.parametrize("stages", [3, 6])
def test_towers_have_one_self_stress_and_one_mechanism(stages):
    found = analyse(build_model(tower(stages)))
    assert found.equations == found.members
    assert (found.self_stress.shape[1], len(found.mechanisms), found.rigid_body_motions) == (1, 1, 0)


def test_lowest_stiffness_of_a_large_tower_is_the_lowest_eigenvalue():
    model = build_model(tower(40))
    values = tangent_stiffness(model)
    assert stability(model).lowest == pytest.approx(values[0], rel=1e-6)


def test_tall_towers_bend_as_cantilevers_do():
    """The lowest stiffness of a slender cantilever falls with the fourth power of its length."""
    lowest = [stability(build_model(tower(stages))).lowest for stages in (100, 200, 400)]
    power = np.log2(np.array(lowest[:-1]) / lowest[1:])
    np.testing.assert_allclose(power, 4.0, atol=0.06)
    assert abs(power[1] - 4.0) < abs(power[0] - 4.0)


def test_the_kernel_leaves_a_tower_at_rest():
    model = build_model(tower(4, nsh=True))
    result = simulate(model, held(model, grid(0.2, 0.05)), tolerance=1e-8)
    np.testing.assert_allclose(result.position, np.broadcast_to(model.nodes, result.position.shape), atol=1e-9)
    assert not result.transitions


# --- options -----------------------------------------------------------------------------------------------------


def test_options_reach_the_model():
    model = build_model(tower(4, gravity=1.5, tension=120.0, stiffness=8000.0, damping=7.0, mass=0.5))
    assert model.gravity == 1.5
    assert set(model.stiffness) == {8000.0} and set(model.damping) == {7.0} and set(model.bar_mass) == {0.5}
    assert member_forces(model)[: len(model.strings)].max() == pytest.approx(120.0, abs=5.0)
    assert not tower(3).gravity and tower(2).gravity == tower(1).gravity == 9.81 and tower(2, gravity=0.0).gravity == 0.0


def test_strings_with_nsh():
    kinds = {stages: [m for m in members(stages) if m.kind != "bar"] for stages in (1, 4)}
    for stages, strings in kinds.items():
        carrying = [m for m, s in zip(strings, tower(stages, nsh=True).strings.values()) if s.nsh]
        expected = [m for m in strings if m.kind == "upper diagonal" or (m.kind == "vertical" and (m.stage or stages == 1))]
        assert carrying == expected
        assert not any(s.nsh for s in tower(stages).strings.values())


def test_default_tension_bears_two_stages_and_no_third():
    """Why gravity is 0 by default from three stages on."""
    slack = [int((member_forces(build_model(tower(n, gravity=9.81)))[: 15 * n - 9] == 0.0).sum()) for n in (2, 3)]
    assert slack[0] == 0 and slack[1] > 0


@pytest.mark.parametrize("stages", [0, -1, 1001, 2.0, True, "3"])
def test_stages_out_of_range_are_named(stages):
    with pytest.raises(InputError, match="whole number from 1 to 1000"):
        tower(stages)


@pytest.mark.parametrize(
    "options, key",
    [
        ({"gravity": float("nan")}, "gravity"),
        ({"stiffness": 0.0}, "stiffness"),
        ({"mass": -1.0}, "mass"),
        ({"tension": -1.0}, "tension"),
    ],
)
def test_options_out_of_range_are_named(options, key):
    with pytest.raises(SceneError, match=key):
        tower(3, **options)


def test_a_single_stage_has_no_tension_to_choose():
    with pytest.raises(InputError, match="one stage has no saddle strings"):
        tower(1, tension=40.0)


def test_too_high_a_tension_is_named():
    with pytest.raises(SceneError, match="more than its length"):
        build_model(tower(3, tension=5000.0))


# --- files -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("stages, nsh, options", [(1, True, {}), (2, False, {}), (7, True, {"gravity": 0.3, "tension": 47.3})])
def test_a_file_gives_the_same_model(stages, nsh, options, tmp_path):
    path = tmp_path / "made.toml"
    path.write_text(tower_text(stages, nsh, **options), encoding="utf-8")
    ours, read = build_model(tower(stages, nsh, **options)), build_model(load_scene(path))
    for name in ("nodes", "nominal", "bars", "strings", "fixed", "rest_length", "stiffness", "damping", "bar_mass"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(read, name), err_msg=name)
    for name in ("name", "node_names", "string_names", "nsh", "gravity", "description"):
        assert getattr(ours, name) == getattr(read, name)


# --- cost --------------------------------------------------------------------------------------------------------


def test_three_thousand_bars_in_seconds():
    start = time.perf_counter()
    model = build_model(tower(1000))
    assert time.perf_counter() - start < 30.0  # about 1 s alone on a machine
    force = member_forces(model)[: len(model.strings)]
    assert np.abs(residual(model)).max() <= 1e-10 * force.max()
    assert force.min() > 5.0
    found = stability(model)
    assert found.stable and found.lowest > 0.0


def test_memory_grows_with_the_structure_and_not_with_its_square():
    peaks = []
    for stages in (100, 400):
        scene = tower(stages)
        tracemalloc.start()
        build_model(scene)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 5.0 * peaks[0]
