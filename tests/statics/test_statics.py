"""Prestress, settling and steady states."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from tensegrity_core.cli import main
from tensegrity_core.errors import SceneError
from tensegrity_core.laws import string_law
from tensegrity_core.scene import builtin_scenes, load_scene, parse_scene
from tensegrity_core.statics import (
    NoEquilibrium,
    TooLarge,
    analyse,
    build_model,
    equilibrium_matrix,
    is_stable,
    loads,
    matrices,
    member_forces,
    residual,
    settle,
    stability,
    string_energy,
    string_tension,
    tangent_stiffness,
)
from tensegrity_core.statics import surface as surfaces
from tensegrity_core.statics.surface import Surface

TOP = {"two_bar": ("n3", "n4"), "three_bar": ("n4", "n5", "n6"), "six_bar": ("n10", "n11", "n12")}


@pytest.fixture(scope="module")
def models():
    return {name: build_model(load_scene(name)) for name in builtin_scenes()}


def lengths(model, ends, nodes=None):
    nodes = model.nodes if nodes is None else nodes
    return np.linalg.norm(nodes[ends[:, 1]] - nodes[ends[:, 0]], axis=1)


def push(model, newtons: float) -> np.ndarray:
    """An upward force on each top node."""
    force = np.zeros((len(model.nodes), 3))
    for node in TOP[model.name.removesuffix("_nsh")]:
        force[model.node_names.index(node), 2] = newtons
    return force


def snapped(model) -> list[int]:
    elongation = lengths(model, model.strings) - model.rest_length
    laws = {i: string_law(model, i) for i in model.nsh_strings}
    return [law.snapped_on_piece(law.piece_of(float(elongation[i]))) for i, law in laws.items()]


# --- the built-in scenes -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", builtin_scenes())
def test_every_scene_starts_in_stable_equilibrium(name, models):
    model = models[name]
    assert np.abs(residual(model)).max() <= 1e-10
    assert is_stable(tangent_stiffness(model))
    assert (model.rest_length > 0.0).all()
    assert (member_forces(model)[: len(model.strings)] > 0.0).all()
    np.testing.assert_allclose(model.bar_length, lengths(model, model.bars, model.nominal), rtol=4e-16)
    np.testing.assert_array_equal(model.nodes[model.fixed], model.nominal[model.fixed])
    assert not model.velocity.any()


@pytest.mark.parametrize("name", ["three_bar", "three_bar_nsh"])
def test_three_bar_forces_are_determined_by_gravity(name, models):
    model = models[name]
    force = member_forces(model)
    np.testing.assert_allclose(force[:3], 1.981, atol=1e-3)
    np.testing.assert_allclose(force[3:6], 7.81, atol=5e-3)
    np.testing.assert_allclose(force[6:], -15.52, atol=5e-3)
    np.testing.assert_array_equal(model.nodes, model.nominal)
    found = analyse(model)
    assert (found.rank, found.self_stress.shape[1], len(found.mechanisms), found.rigid_body_motions) == (9, 0, 0, 0)


@pytest.mark.parametrize("name", ["two_bar", "two_bar_nsh"])
def test_two_bar_keeps_one_free_tension(name, models):
    model = models[name]
    np.testing.assert_allclose(member_forces(model)[:3], [5.888, 5.888, 10.0], atol=5e-4)
    found = analyse(model)
    assert (found.equations, found.members, found.rank, found.self_stress.shape[1]) == (4, 5, 4, 1)


@pytest.mark.parametrize("name, top", [("six_bar", 1.4208), ("six_bar_nsh", 1.4207)])
def test_six_bar_settles_near_the_given_coordinates(name, top, models):
    model = models[name]
    np.testing.assert_allclose(model.nodes[9:, 2], top, atol=6e-5)
    way = np.linalg.norm(model.nodes - model.nominal, axis=1)
    assert not way[:3].any()
    assert way[3:].min() > 0.0205 and way[3:].max() < 0.0385
    if name.endswith("nsh"):
        force = member_forces(model)
        np.testing.assert_allclose(force[9:12], 9.4, atol=0.05)
        np.testing.assert_allclose(force[15:18], 10.0, atol=0.06)
        assert snapped(model) == [0] * 6


def test_six_bar_is_nearly_self_stressed_as_given(models):
    """Members come in nine threes of equal force density; in these the matrix has one small singular value."""
    model = replace(models["six_bar"], nodes=models["six_bar"].nominal)
    ends = np.vstack([model.strings, model.bars])
    threes = np.kron(np.eye(9), np.ones((3, 1)))
    values = np.linalg.svd(equilibrium_matrix(model) * lengths(model, ends) @ threes, compute_uv=False)
    np.testing.assert_allclose(values[:-3:-1], [0.022, 0.61], rtol=0.02)


def test_rest_lengths_of_nsh_strings_go_through_the_inverse(models):
    model = models["six_bar_nsh"]
    for i, name in enumerate(model.string_names):
        elongation = lengths(model, model.strings, model.nominal)[i] - model.rest_length[i]
        tension = string_law(model, i).force(elongation)
        assert tension == pytest.approx(load_scene("six_bar_nsh").prestress.tension[name], rel=1e-10)


def test_two_bar_in_space_falls_over(models):
    """The plane is what keeps it up: the out-of-plane growth rate is 3.9 /s."""
    flat = models["two_bar"]
    model = replace(flat, axes=(0, 1, 2))
    values = tangent_stiffness(model)
    assert not is_stable(values)
    # two pinned bars, mass seen by the tip m/3
    assert math.sqrt(-values[0] / (model.bar_mass[0] / 3.0)) == pytest.approx(3.9, abs=0.1)
    settled = settle(model)
    assert is_stable(tangent_stiffness(settled))
    assert (settled.nodes[2:, 2] < -0.9).all()  # nothing stops it at the ground: it ends hanging


# --- derivatives -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["two_bar_nsh", "six_bar_nsh"])
def test_equilibrium_matrix_is_the_rate_of_the_lengths(name, models):
    """Virtual work: the lengths' derivatives are minus the transposed matrix."""
    model, matrix = models[name], equilibrium_matrix(models[name])
    ends = np.vstack([model.strings, model.bars])
    dofs = [(node, axis) for node in model.free_nodes for axis in model.axes]
    for row, (node, axis) in enumerate(dofs):
        step = np.zeros_like(model.nodes)
        step[node, axis] = 1e-6
        rate = (lengths(model, ends, model.nodes + step) - lengths(model, ends, model.nodes - step)) / 2e-6
        np.testing.assert_allclose(matrix[row], -rate, atol=1e-9)


@pytest.mark.parametrize("name", builtin_scenes())
def test_force_and_tangent_stiffness_are_derivatives_of_the_energy(name, models):
    model = models[name]
    surface = Surface(model, push(model, 3.0))
    rng = np.random.default_rng(7)
    free = surface.moved(surface.start, 2e-3 * rng.standard_normal(surface.size))
    point = surface.at(free)
    h = 1e-5
    for _ in range(5):
        direction = rng.standard_normal(point.basis.shape[1])
        direction /= np.linalg.norm(direction)
        along = [surface.energy(surface.moved(free, s * h * point.basis @ direction)) for s in (-1, 0, 1)]
        slope = (along[2] - along[0]) / (2 * h)
        assert -slope == pytest.approx(point.pull @ direction, abs=1e-6 * max(1.0, np.abs(point.pull).max()))
        curvature = (along[2] - 2 * along[1] + along[0]) / h**2
        exact = np.sum(point.values * (point.tangent.vectors.T @ direction) ** 2)
        # the second difference of the energy is good to round-off / h^2
        assert curvature == pytest.approx(exact, rel=1e-3, abs=1e-2)


def test_string_law():
    model = build_model(load_scene("three_bar_nsh"))
    elongation = np.array([-0.1, 0.0, 0.02, -0.1, 0.0, 0.02])
    tension = string_tension(model, model.rest_length + elongation)
    assert tension[:2].tolist() == [0.0, 0.0] and tension[3:5].tolist() == [0.0, 0.0]
    assert tension[2] == pytest.approx(string_law(model, 2).force(0.02), rel=1e-12)
    assert tension[5] == pytest.approx(100.0)
    assert string_energy(model, model.rest_length + elongation)[5] == pytest.approx(1.0)


# --- steady states under load ------------------------------------------------------------------------------------


@pytest.mark.parametrize("newtons, beams", [(12, 0), (26, 2), (42, 3), (54, 4)])
def test_three_bar_nsh_snaps_one_beam_after_the_other(newtons, beams, models):
    """The trial run's snaps lie at 14-16, 22-24, 30-32 and 42-44 N per top node."""
    model = models["three_bar_nsh"]
    steady = settle(model, push(model, newtons))
    assert snapped(steady) == [beams] * 3
    assert_steady(steady, push(model, newtons))


def assert_steady(model, force):
    assert np.abs(residual(model, force)).max() <= 1e-10
    assert is_stable(tangent_stiffness(model, force))
    np.testing.assert_allclose(model.bar_length, lengths(model, model.bars, model.nominal), rtol=4e-16)


@pytest.mark.parametrize("name", ["two_bar", "three_bar", "six_bar"])
def test_plain_scenes_rise_and_come_back(name, models):
    model = models[name]
    height = [model.nodes[-1, 2]]
    steady = model
    for newtons in (6, 12, 18):
        steady = settle(model, push(model, newtons), steps=20)
        assert_steady(steady, push(model, newtons))
        height.append(steady.nodes[-1, 2])
    assert (np.diff(height) > 0.0).all()
    back = settle(steady)
    np.testing.assert_allclose(back.nodes, model.nodes, atol=1e-9)


def test_steady_state_does_not_depend_on_the_number_of_load_steps(models):
    model = models["three_bar_nsh"]
    few, many = (settle(model, push(model, 26.0), steps=steps) for steps in (25, 60))
    np.testing.assert_allclose(few.nodes, many.nodes, atol=1e-10)


def test_moved_rest_lengths(models):
    model = models["three_bar"]
    shorter = model.rest_length - np.array([0, 0, 0, 0.05, 0.05, 0.05])
    steady = settle(model, rest_length=shorter)
    np.testing.assert_array_equal(steady.rest_length, shorter)
    assert_steady(steady, None)
    assert (lengths(steady, steady.strings)[3:] < lengths(model, model.strings)[3:] - 0.04).all()
    back = settle(steady, rest_length=model.rest_length)
    np.testing.assert_allclose(back.nodes, model.nodes, atol=1e-9)


def test_turning_and_relabelling_change_nothing(models):
    model = models["three_bar_nsh"]
    c, s = math.cos(0.7), math.sin(0.7)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    order = np.array([4, 2, 0, 5, 1, 3])  # new node i was old node order[i]
    place = np.argsort(order)
    other = replace(
        model,
        nodes=(model.nodes @ turn.T)[order],
        nominal=(model.nominal @ turn.T)[order],
        velocity=model.velocity[order],
        fixed=model.fixed[order],
        bars=place[model.bars],
        strings=place[model.strings],
        node_names=tuple(model.node_names[i] for i in order),
    )
    force = push(model, 26.0)
    steady = settle(model, force, steps=26)
    turned = settle(other, (force @ turn.T)[order], steps=26)
    np.testing.assert_allclose(turned.nodes[place] @ turn, steady.nodes, atol=1e-9)


# --- small structures with known answers -------------------------------------------------------------------------


def pendulum(start: str, tip, **more) -> dict:
    return {
        "name": "pendulum",
        "start": start,
        "fixed": ["top"],
        "nodes": {"top": [0.0, 0.0, 0.0], "tip": tip},
        "bars": {"rod": {"nodes": ["top", "tip"], "mass": 2.0}},
    } | more


def test_a_pendulum_is_released_where_it_is():
    model = build_model(parse_scene(pendulum("released", [1.0, 0.0, -1.0])))
    assert model.counts["S"] == 0
    np.testing.assert_array_equal(model.nodes[1], [1.0, 0.0, -1.0])
    assert residual(model).shape == (1, 3)
    # of the tip's weight m g/2 the part across the rod stays unbalanced
    assert np.linalg.norm(residual(model)) == pytest.approx(9.81 * math.sqrt(0.5), rel=1e-12)


@pytest.mark.parametrize("tip", [[1.0, 0.0, -1.0], [0.3, 0.2, 1.0], [0.0, 0.0, 1.5]])
def test_a_settled_pendulum_hangs(tip):
    """Also from upright, where it balances but is not stable."""
    model = build_model(parse_scene(pendulum("settled", tip)))
    length = math.hypot(*tip)
    np.testing.assert_allclose(model.nodes[1], [0.0, 0.0, -length], atol=1e-10 * length)
    assert member_forces(model)[0] == pytest.approx(9.81, rel=1e-12)


def test_an_upright_pendulum_is_an_equilibrium_but_said_to_be_unstable(tmp_path, capsys):
    path = tmp_path / "upright.toml"
    path.write_text(
        'fixed = ["a"]\n[nodes]\na = [0, 0, 0]\nb = [0, 0, 1]\n[bars]\nrod = { nodes = ["a", "b"], mass = 1 }\n',
        encoding="utf-8",
    )
    assert main(["check", str(path)]) == 0
    assert "unstable (lowest stiffness -4.905 N/m)" in capsys.readouterr().out


@pytest.mark.parametrize("honeycomb", [None, {"Q": [6.0, 8.0], "zeta": [3.0, 4.0], "h": [0.01, 0.02]}])
@pytest.mark.parametrize("mass", [0.5, 1.8, 20.0])
def test_a_bar_hung_on_a_string(honeycomb, mass):
    """The string stretches until it carries the bar's weight; past 32 N the honeycomb has bottomed out."""
    string = {"nodes": ["hook", "upper"], "stiffness": 800.0} | ({"nsh": "soft"} if honeycomb else {})
    scene = parse_scene(
        {
            "name": "hung",
            "start": "settled",
            "fixed": ["hook"],
            "nodes": {"hook": [0, 0, 0], "upper": [0.01, 0, -0.5], "lower": [0, 0.02, -1.5]},
            "nsh": {"soft": honeycomb} if honeycomb else {},
            "bars": {"rod": {"nodes": ["upper", "lower"], "mass": mass}},
            "strings": {"s": string},
            "prestress": {"rest_length": {"s": 0.5}},
        }
    )
    model = build_model(scene)
    weight = 9.81 * mass
    elongation = string_law(model, 0).elongation(weight)
    assert model.nodes[1, 2] == pytest.approx(-0.5 - elongation, abs=1e-9)
    assert model.nodes[2, 2] == pytest.approx(model.nodes[1, 2] - math.dist([0.01, 0, 1.0], [0, 0.02, 0]), abs=1e-9)
    assert model.rest_length[0] == 0.5
    assert_steady(model, None)


def test_a_slack_string_carries_nothing():
    raw = pendulum("equilibrium", [0.0, 0.0, -1.0])
    raw["fixed"] = ["top", "hook"]
    raw["nodes"] = raw["nodes"] | {"hook": [0.5, 0.0, -1.0]}
    raw["strings"] = {"s": {"nodes": ["hook", "tip"], "stiffness": 100.0}}
    raw["prestress"] = {"rest_length": {"s": 0.7}}
    model = build_model(parse_scene(raw))
    np.testing.assert_allclose(member_forces(model), [0.0, 9.81], atol=1e-12)
    assert model.rest_length[0] == 0.7


def test_a_tension_of_zero_gives_a_string_at_its_rest_length():
    raw = pendulum("equilibrium", [0.0, 0.0, -1.0])
    raw["fixed"] = ["top", "hook"]
    raw["nodes"] = raw["nodes"] | {"hook": [0.5, 0.0, -1.0]}
    raw["strings"] = {"s": {"nodes": ["hook", "tip"], "stiffness": 100.0}}
    model = build_model(parse_scene(raw))  # equilibrium alone says that the string carries nothing
    assert model.rest_length[0] == pytest.approx(0.5, abs=1e-14)


def test_nothing_holds_a_bar_afloat():
    raw = pendulum("settled", [1.0, 0.0, 0.0], fixed=[])
    with pytest.raises(SceneError) as caught:
        build_model(parse_scene(raw))
    assert (caught.value.key, caught.value.value) == ("start", "settled")
    assert "not 0 but 19.62 N" in caught.value.problem and '"released"' in caught.value.remedy
    model = build_model(parse_scene(raw | {"gravity": 0.0}))
    np.testing.assert_array_equal(model.nodes, model.nominal)
    with pytest.raises(NoEquilibrium, match="no node is fixed"):
        settle(model, force=np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]))


def test_a_bar_beside_the_ground_falls_for_ever():
    raw = pendulum("settled", [1.0, 0.0, 0.0], fixed=["anchor"])
    raw["nodes"] = raw["nodes"] | {"anchor": [0.0, 1.0, 0.0]}
    with pytest.raises(SceneError, match="no stable equilibrium was found") as caught:
        build_model(parse_scene(raw))
    assert caught.value.key == "start"


def test_a_load_path_in_parts_ends_where_the_whole_does(models):
    """Over two snaps; `force_before` keeps the second part from unloading first."""
    model = models["two_bar_nsh"]
    whole = settle(model, push(model, 36.0), steps=36)
    half = settle(model, push(model, 18.0), steps=18)
    rest = settle(half, push(model, 36.0), steps=18, force_before=push(model, 18.0))
    np.testing.assert_allclose(rest.nodes, whole.nodes, atol=1e-10)
    assert snapped(half) == [0, 0] and snapped(rest) == [2, 2]


def test_gravity_acts_half_on_each_end(models):
    model = models["three_bar"]
    np.testing.assert_allclose(loads(model), np.outer(np.full(6, -4.905), [0, 0, 1]))
    assert loads(model, push(model, 5.0))[5, 2] == pytest.approx(0.095)


# --- any prism ---------------------------------------------------------------------------------------------------


def prism(count, radii, height, tension, stiffness) -> dict:
    """The regular prism of `count` bars whose twist, 90 + 180/count degrees from one end of a bar to the other, admits
    a self-stress (Connelly and Terrell, "Globally rigid symmetric tensegrities", 1995)."""
    nodes, twist = {}, math.pi / 2 + math.pi / count
    for i in range(count):
        for level, turn, z in ((0, 0.0, 0.0), (1, twist, height)):
            angle = 2.0 * math.pi * i / count + turn
            nodes[f"n{level}_{i}"] = [radii[level] * math.cos(angle), radii[level] * math.sin(angle), z]
    ends = [(f"n{level}_{i}", f"n{level}_{(i + 1) % count}") for level in (0, 1) for i in range(count)]
    ends += [(f"n0_{i}", f"n1_{(i - 1) % count}") for i in range(count)]
    return {
        "name": "prism",
        "gravity": 0.0,
        "nodes": nodes,
        "materials": {"cable": {"stiffness": stiffness}},
        "bars": {f"b{i}": {"nodes": [f"n0_{i}", f"n1_{i}"], "mass": 1.0} for i in range(count)},
        "strings": {f"s{i}": {"nodes": list(pair), "material": "cable"} for i, pair in enumerate(ends)},
        "prestress": {"tension": {"s0": tension}},
    }


@settings(derandomize=True, deadline=None, max_examples=40)
@given(
    st.sampled_from([3, 4, 5]),
    st.tuples(st.floats(0.3, 2.0), st.floats(0.3, 2.0)),
    st.floats(0.3, 3.0),
    st.floats(1.0, 100.0),
    st.floats(1e3, 1e5),
)
@example(4, (2.0, 0.30078125), 1.0, 64.0, 1000.0)
def test_any_prism_starts_in_equilibrium_or_is_refused(count, radii, height, tension, stiffness):
    """Refused: where a string would be stretched by more than its length."""
    stiff = build_model(parse_scene(prism(count, radii, height, tension, 1e9)))  # the forces are those of any stiffness
    length = np.linalg.norm(np.subtract(*np.moveaxis(stiff.nodes[stiff.strings], 1, 0)), axis=1)
    rest = length - member_forces(stiff)[: 3 * count] / stiffness
    if rest.min() < 1e-6:
        assume(rest.min() < -1e-6)
        with pytest.raises(SceneError, match="more than its length. Lower the tension or raise the stiffness"):
            build_model(parse_scene(prism(count, radii, height, tension, stiffness)))
        return
    model = build_model(parse_scene(prism(count, radii, height, tension, stiffness)))
    found = analyse(model)
    assert (found.self_stress.shape[1], found.rigid_body_motions) == (1, 6)
    assert len(found.mechanisms) == 6 * count - found.rank - 6
    force = member_forces(model)
    assert force[0] == pytest.approx(tension, rel=1e-9)
    assert (force[: 3 * count] > 0.0).all() and (force[3 * count :] < 0.0).all()
    assert np.abs(residual(model)).max() <= 1e-10 * max(1.0, stiffness * 1e-4)
    np.testing.assert_allclose(force[1:count], tension, rtol=1e-8)


@settings(derandomize=True, deadline=None, max_examples=10)
@given(st.integers(0, 1000), st.sampled_from([3, 4]))
def test_a_prism_off_its_shape_settles(seed, count):
    """Coordinates a little off: with one tension given, the others come by least squares, and the shape settles."""
    rng = np.random.default_rng(seed)
    raw = prism(count, (1.0, 0.8), 1.2, 20.0, 2000.0) | {"start": "settled"}
    for point in raw["nodes"].values():
        point[:] = (np.array(point) + 5e-3 * rng.standard_normal(3)).tolist()
    model = build_model(parse_scene(raw))
    assert_steady(model, None)
    way = np.linalg.norm(model.nodes - model.nominal, axis=1)
    assert 0.0 < way.max() < 0.1


# --- large structures --------------------------------------------------------------------------------------------


def both_ways(monkeypatch, find):
    """find() by dense and by sparse matrices."""
    dense = find()
    monkeypatch.setattr(surfaces, "SMALL", 0)
    return dense, find()


@pytest.mark.parametrize(
    "name, newtons", [("three_bar", 12.0), ("three_bar_nsh", 12.0), ("six_bar", 12.0), ("six_bar_nsh", 4.0)]
)
def test_sparse_matrices_settle_where_dense_ones_do(name, newtons, models, monkeypatch):
    model = models[name]
    dense, found = both_ways(monkeypatch, lambda: settle(model, push(model, newtons), steps=10))
    np.testing.assert_allclose(found.nodes, dense.nodes, atol=1e-9)
    assert np.abs(found.nodes - model.nodes).max() > 1e-3
    assert_steady(found, push(model, newtons))


def test_sparse_matrices_follow_the_flow_over_a_snap(models, monkeypatch):
    before, after = (push(models["three_bar_nsh"], newtons) for newtons in (20.0, 26.0))
    model = settle(models["three_bar_nsh"], before, steps=10)
    dense, found = both_ways(monkeypatch, lambda: settle(model, after, steps=4, force_before=before))
    assert snapped(model) == [1] * 3 and snapped(found) == [2] * 3
    np.testing.assert_allclose(found.nodes, dense.nodes, atol=1e-9)


def test_sparse_matrices_give_the_scenes_themselves(monkeypatch):
    dense, found = both_ways(monkeypatch, lambda: build_model(load_scene("six_bar_nsh")))
    np.testing.assert_allclose(found.nodes, dense.nodes, atol=1e-10)


def test_sparse_matrices_see_what_is_unstable(models, monkeypatch):
    model = replace(models["two_bar"], axes=(0, 1, 2))
    dense, found = both_ways(monkeypatch, lambda: stability(model))
    assert not dense.stable and not found.stable
    assert found.lowest == pytest.approx(dense.lowest, rel=1e-9)
    settled = settle(model)
    assert stability(settled).stable
    assert (settled.nodes[2:, 2] < -0.9).all()  # it fell over, as with dense matrices


@pytest.mark.parametrize("seed", range(3))
def test_sparse_matrices_settle_a_structure_afloat(seed, monkeypatch):
    """No node is fixed: six directions are neutral, and settling leaves the structure where it is."""
    data = prism(3, (0.8, 0.6), 1.2, 30.0, 4000.0)
    data |= {"start": "settled", "fixed": [], "gravity": 0.0}
    rng = np.random.default_rng(seed)
    data["nodes"] = {name: (np.array(at) + 0.01 * rng.standard_normal(3)).tolist() for name, at in data["nodes"].items()}
    dense, found = both_ways(monkeypatch, lambda: build_model(parse_scene(data)))
    assert np.abs(residual(found)).max() <= 1e-10
    force = [member_forces(model) for model in (dense, found)]
    np.testing.assert_allclose(force[1], force[0], atol=1e-6)
    gap = np.linalg.norm(found.nodes.mean(axis=0) - dense.nodes.mean(axis=0))
    assert gap < 1e-4 and stability(found).stable
    for one in (dense, found):  # the lowest stiffness is that behind the rigid-body motions, by either kind of matrices
        monkeypatch.setattr(surfaces, "SMALL", 10_000)
        lowest = tangent_stiffness(one)[6]
        assert stability(one).lowest == pytest.approx(lowest, rel=1e-9)
        monkeypatch.setattr(surfaces, "SMALL", 0)
        assert stability(one).lowest == pytest.approx(lowest, rel=1e-6)


def test_stability_is_that_of_the_eigenvalues(models):
    for model in models.values():
        assert stability(model) == (is_stable(tangent_stiffness(model)), tangent_stiffness(model)[0])


def test_a_basis_is_orthonormal_and_keeps_the_lengths(models):
    for model in models.values():
        surface = Surface(model, None)
        basis = surface.at(surface.start).basis
        freedoms = surface.size - len(model.bars)
        np.testing.assert_allclose(basis.T @ basis, np.eye(freedoms), atol=1e-15)
        np.testing.assert_allclose(equilibrium_matrix(model)[:, len(model.strings) :].T @ basis, 0.0, atol=2e-15)


@pytest.mark.parametrize("what", [analyse, tangent_stiffness, equilibrium_matrix])
def test_dense_analyses_refuse_large_structures(what, models, monkeypatch):
    monkeypatch.setattr(matrices, "WHOLE", 20)
    assert what(models["three_bar"]) is not None
    with pytest.raises(TooLarge, match="six_bar: .* up to 20 .* here are 27"):
        what(models["six_bar"])


def test_large_scenes_need_their_tensions(monkeypatch):
    monkeypatch.setattr(matrices, "WHOLE", 8)
    with pytest.raises(SceneError, match="up to 8 .*Give every string's tension .*: 6 are missing, first s1"):
        build_model(load_scene("three_bar"))


def test_check_says_what_is_left_out_of_a_large_structure(monkeypatch, capsys):
    monkeypatch.setattr(matrices, "WHOLE", 20)
    assert main(["check", "six_bar"]) == 0
    shown = capsys.readouterr().out
    assert "no self-stress states and mechanisms: six_bar: rank analysis is for structures of up to 20" in shown
    assert "stable (lowest stiffness" in shown and "unstable" not in shown and "s21: " in shown
