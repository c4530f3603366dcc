"""Equilibrium paths: closed forms of one bar (limit points, a pitchfork, kinks), then the article's structures."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize_scalar

from tensegrity_core import statics
from tensegrity_core.equilibria import paths, steady_states, sudden
from tensegrity_core.equilibria.equilibrium import Equations
from tensegrity_core.equilibria.loading import Loading
from tensegrity_core.equilibria.points import PathError
from tensegrity_core.errors import InputError
from tensegrity_core.kernel import Kernel
from tensegrity_core.laws import element_law, string_law
from tensegrity_core.laws.string_laws import string_laws
from tensegrity_core.model import NSH, Model
from tensegrity_core.model.elements import Polynomial, Series, Spring
from tests.support import by_hand, changed, push, scene
from tests.support.driven_scenes import LABORATORY, built
from tests.support.element_scenes import STRINGS, mast

L, B, K = 1.0, 0.6, 900.0  # m, m, N/m
TILT = np.radians(35.0)
UP = np.array([0.0, 0.0, 1.0])


def one_bar(tip, anchors, rest_length, gravity=0.0, nsh=None, stiffness=K, damping=20.0) -> Model:
    """A bar pinned at the origin of the plane x-z with strings from anchors to its tip."""
    count = len(anchors)
    return by_hand(
        [[0.0, 0.0, 0.0], tip, *anchors],
        [0, *range(2, 2 + count)],
        [[0, 1]],
        [[2 + i, 1] for i in range(count)],
        axes=(0, 2),
        stiffness=stiffness,
        damping=damping,
        rest_length=rest_length,
        nsh=(nsh,) * count,
        gravity=gravity,
    )


def at(angle):
    return np.array([L * np.cos(angle), 0.0, L * np.sin(angle)])


def on_tip(model, force):
    field = np.zeros(model.nodes.shape)
    field[1] = force
    return field


# --- the snap of one bar: anchor behind the pin, tip pushed down, P = k b (1 - r/l) tan(a) ----------------------------


def snapping():
    """Unstressed at TILT; pushed flat, the string is longest."""
    anchor = [-B, 0.0, 0.0]
    rest = np.linalg.norm(at(TILT) - anchor)
    model = one_bar(at(TILT), [anchor], [rest - 1e-3])
    return model, Loading(model, on_tip(model, -UP))


def snap_load(angle, rest):
    length = np.sqrt(L**2 + B**2 + 2.0 * L * B * np.cos(angle))
    return K * B * (1.0 - rest / length) * np.tan(angle)


def snap_peak(rest):
    options = {"method": "bounded", "options": {"xatol": 1e-13}}
    return -minimize_scalar(lambda a: -snap_load(a, rest), bounds=(0.01, 0.99 * TILT), **options).fun


def test_limit_point_of_a_snapping_bar_to_round_off():
    model, loading = snapping()
    rest = model.rest_length[0]
    start = brentq(lambda a: snap_load(a, rest) - 1.0, 0.8 * TILT, TILT)
    peak = snap_peak(rest)
    equations, scale = Equations(loading), paths.scale_of(model, 0.0, 200.0)
    first = paths.point_at(equations, scale, np.array([[0, 0, 0], at(start), [-B, 0, 0]]), 1.0, 1.0)
    path = paths.follow_from(equations, scale, first, -200.0, 200.0)
    up, down = path.special("limit")[:2]
    assert up.parameter == pytest.approx(peak, rel=1e-12)
    assert down.parameter == pytest.approx(-peak, rel=1e-12)
    angles = np.arctan2(path.nodes[:, 1, 2], path.nodes[:, 1, 0])
    taut = np.array([p.piece[0] == 1 for p in path.points])
    np.testing.assert_allclose(path.parameters[taut], snap_load(angles[taut], rest), rtol=0, atol=1e-9 * peak)
    first, second = (path.points.index(p) for p in (up, down))
    assert path.stable[:first].all() and not path.stable[first + 1 : second].any()


def test_slow_load_follows_the_closed_form_and_snaps():
    model, loading = snapping()
    rest = model.rest_length[0]
    peak = snap_peak(rest)
    start = brentq(lambda a: snap_load(a, rest) - 1.0, 0.8 * TILT, TILT)
    loads = np.array([1.0, 0.5 * peak, 0.99 * peak, 1.01 * peak])
    sweep = steady_states.load_sweep(loading, loads, nodes=np.array([[0, 0, 0], at(start), [-B, 0, 0]]))
    for load, nodes in zip(loads[:3], sweep.nodes):
        assert snap_load(np.arctan2(nodes[1, 2], nodes[1, 0]), rest) == pytest.approx(load, rel=1e-11)
    (jump,) = sweep.jumps
    assert jump.parameter == pytest.approx(peak, rel=1e-12) and jump.kind == "limit"
    assert 0.0 < jump.after.parameter - jump.parameter < 1e-6 * sweep.parameters.max()
    np.testing.assert_allclose(sweep.nodes[-1, 1], [0.0, 0.0, -L], atol=1e-9)  # it hangs, its string slack


# --- a pitchfork: an upright bar between two guys buckles at P = 2 k L -------------------------------------------------

A, PULL = 0.8, 60.0


def upright(gravity=0.0):
    model = one_bar([0.0, 0.0, L], [[-A, 0.0, L], [A, 0.0, L]], np.full(2, A - PULL / K), gravity)
    return model, Loading(model, on_tip(model, -UP))


def torque(angle, load):
    """dV/da of the upright bar, both guys taut; a from the vertical."""
    tip = np.array([L * np.sin(angle), L * np.cos(angle)])
    total = -load * L * np.sin(angle)
    for side in (-1.0, 1.0):
        along = tip - np.array([side * A, L])
        length = np.hypot(*along)
        total += K * (length - A + PULL / K) * (along @ np.array([L * np.cos(angle), -L * np.sin(angle)])) / length
    return total


@pytest.mark.parametrize("gravity", [0.0, 9.81])
def test_buckling_load_and_branches_of_an_upright_bar(gravity):
    _model, loading = upright(gravity)
    path = paths.follow(loading, 0.0, 3.0 * K * L)
    (branch,) = path.special("branch")
    assert branch.parameter == pytest.approx(2.0 * K * L - 0.5 * gravity, rel=1e-12)
    np.testing.assert_allclose(path.nodes[:, 1, 0], 0.0, atol=1e-12)
    assert all(p.stable == (p.parameter < branch.parameter) for p in path.points if p is not branch)
    ways = paths.branches(path, branch)
    assert len(ways) == 2
    sides = []
    for way in ways:
        traced = paths.follow_from(path.equations, path.scale, way, branch.parameter - 200.0, branch.parameter + 200.0, 40)
        for point, nodes in zip(traced.points, traced.nodes):
            if (point.piece == 1).all():
                angle = np.arctan2(nodes[1, 0], nodes[1, 2])
                assert abs(torque(angle, point.parameter + 0.5 * gravity)) < 1e-7
        sides.append(np.sign(traced.nodes[-1, 1, 0]))
        assert abs(traced.nodes[-1, 1, 0]) > 0.01
    assert sorted(sides) == [-1.0, 1.0]


def test_stability_ends_at_the_buckling_load_of_a_slow_load():
    _model, loading = upright()
    sweep = steady_states.load_sweep(loading, np.linspace(0.0, 2.02 * K * L, 8))
    assert [jump.kind for jump in sweep.jumps][:1] == ["branch"]
    assert sweep.jumps[0].parameter == pytest.approx(2.0 * K * L, rel=1e-12)
    assert all(state.stable for state in sweep.states)
    onward, *sides = steady_states.detours(sweep, 30)
    assert not onward.points[-1].stable and len(sides) == 2
    assert sorted(np.sign(path.nodes[-1, 1, 0]) for path in sides) == [-1.0, 1.0]
    assert sweep.nodes[-1, 1, 2] < 0.0 and sweep.nodes[-2, 1, 2] == pytest.approx(L)  # it falls over


# --- kinks -------------------------------------------------------------------------------------------------------------


def test_a_guy_goes_slack_where_it_should():
    """Pushed aside, the upright bar slackens one guy: there its length is its rest length, and the path has a kink."""
    model, _ = upright()
    loading = Loading(model, on_tip(model, [1.0, 0.0, 0.0]))
    path = paths.follow(loading, 0.0, 200.0)
    (kink,) = path.special("kink")
    tip = path.equations.nodes(kink.free)[1]
    assert np.linalg.norm(tip - [A, 0.0, L]) == pytest.approx(model.rest_length[1], abs=1e-12)
    assert kink.piece.tolist() == [1, 0] and path.end == "to"
    (found,) = path.at(150.0)
    assert found.parameter == 150.0
    settled = statics.settle(model, force=on_tip(model, [150.0, 0.0, 0.0]), steps=1)
    np.testing.assert_allclose(path.equations.nodes(found.free), settled.nodes, rtol=0, atol=1e-12)


def test_a_start_without_any_tension():
    """Level guys at exactly their rest length: one tightens, the other goes slack at once, and f = k dl at the tip."""
    model = one_bar([0.0, 0.0, L], [[-A, 0.0, L], [A, 0.0, L]], [A, A])
    path = paths.follow(Loading(model, on_tip(model, [1.0, 0.0, 0.0])), 0.0, 50.0)
    assert path.points[-1].piece.tolist() == [1, 0] and path.stable.all()
    tip = path.nodes[-1, 1]
    along = tip - [-A, 0.0, L]
    length = np.linalg.norm(along)
    across = np.array([tip[2], 0.0, -tip[0]])  # the tip's way
    assert K * (length - A) * (along @ across) / length == pytest.approx(50.0 * across[0], rel=1e-12)


def test_rest_length_as_the_parameter():
    """Winding in one guy of the upright bar; every point must be what settling finds."""
    model, _ = upright()
    loading = Loading(model, rest_length_direction=[-1.0, 0.0])
    path = paths.follow(loading, 0.0, 0.2)
    assert path.end == "to" and path.stable.all()
    for p in (0.05, 0.2):
        (found,) = path.at(p)
        settled = statics.settle(model, rest_length=loading.rest_lengths(p), steps=4)
        np.testing.assert_allclose(path.equations.nodes(found.free), settled.nodes, rtol=0, atol=1e-11)


def require_exact(laws, exact, x):
    """Two strings' laws, all at once, against the exact one of the first at an elongation, m."""
    elongation = np.array([x, x])
    piece = laws.piece_of(elongation)
    assert piece[0] == exact.piece_of(x)
    force, stiffness, _ = laws.on(piece)(elongation)
    assert force[0] == pytest.approx(exact.force(x), abs=1e-11)
    assert stiffness[0] == pytest.approx(exact.stiffness(x), abs=1e-8)
    assert laws.energy(elongation, piece)[0] == pytest.approx(exact.energy(x), abs=1e-13)


def test_strings_laws_are_the_exact_ones():
    nsh = NSH((6.0, 8.0, 10.0), (3.0, 4.0, 5.0), (0.01, 0.01, 0.015))
    model = one_bar(at(TILT), [[-B, 0.0, 0.0], [B, 0.0, 2.0]], [1.0, 1.0], nsh=nsh)
    laws, exact = string_laws(model), element_law(nsh.element, K)
    for x in np.linspace(-0.01, 0.09, 401):
        require_exact(laws, exact, x)


# --- the article's structures ------------------------------------------------------------------------------------------

LOADS = np.concatenate([[0.0], np.arange(10.0, 73.0, 2.0)])


def lifted(name):
    model = scene(name)
    return model, Loading(model, push(model, 1.0, 0.0))


def test_tangent_stiffness_is_that_of_the_statics():
    for name in ("two_bar_nsh", "three_bar", "six_bar_nsh"):
        model, loading = lifted(name)
        equations = Equations(loading)
        free = equations.free(model.nodes)
        tangent = equations.at(free, 0.0, equations.laws.piece_of(equations.elongation(free, 0.0)))
        expected = statics.tangent_stiffness(model)
        np.testing.assert_allclose(np.linalg.eigvalsh(tangent.stiffness), expected, rtol=0, atol=1e-9 * expected[-1])


def test_four_snaps_and_their_way_back():
    _model, loading = lifted("two_bar_nsh")
    up = steady_states.load_sweep(loading, LOADS)
    down = steady_states.load_sweep(loading, LOADS[::-1], nodes=up.nodes[-1])
    at_loads = [jump.parameter for jump in up.jumps]
    assert [20 < p < 22 or 28 < p < 30 or 40 < p < 42 or 54 < p < 56 for p in at_loads] == [True] * 4
    assert len(down.jumps) == 1 and down.jumps[0].parameter < 18.0
    apart = np.abs(up.nodes - down.nodes[::-1]).max(axis=(1, 2))
    assert (apart[LOADS > 56.0] < 1e-10).all() and (apart[LOADS < 16.0] < 1e-10).all()
    assert (apart[(LOADS > 18.0) & (LOADS < 55.0)] > 1e-3).all()


def test_a_load_that_goes_up_and_down_and_stays():
    """Also to loads within, and just beside, a jump."""
    _model, loading = lifted("two_bar_nsh")
    jump = 20.943741957
    parameters = [0.0, 10.0, 10.0, jump - 1e-6, jump + 1e-6, 30.0, 25.0, 25.0, 0.0, 30.0]
    sweep = steady_states.load_sweep(loading, parameters)
    assert [state.parameter for state in sweep.states] == pytest.approx(parameters, abs=0.0)
    heights = sweep.nodes[:, 2, 2]
    assert heights[3] < 0.9921 and heights[4] > 0.9999
    assert heights[[2, 7]] == pytest.approx(heights[[1, 6]], abs=1e-12)
    assert heights[8] == pytest.approx(heights[0], abs=1e-12) and heights[9] == pytest.approx(heights[5], abs=1e-12)
    (alone,) = steady_states.load_sweep(loading, [0.0]).states
    assert alone.stable and alone.parameter == 0.0


SCENES = ("two_bar", "two_bar_nsh", "three_bar", "three_bar_nsh", "six_bar", "six_bar_nsh")


def up_and_back(name, **how):
    _model, loading = lifted(name)
    up = steady_states.load_sweep(loading, LOADS, **how)
    return up, steady_states.load_sweep(loading, LOADS[::-1], nodes=up.nodes[-1], **how)


@pytest.mark.parametrize("name", SCENES)
def test_load_steps_and_large_steps_of_the_flow_change_nothing(name):
    """Compared with paths followed along their arcs, and the flow after each jump in small steps."""
    quick, careful = up_and_back(name), up_and_back(name, careful=True)
    for one, other in zip(quick, careful):
        np.testing.assert_allclose(one.nodes, other.nodes, rtol=0, atol=1e-10)
        assert [jump.kind for jump in one.jumps] == [jump.kind for jump in other.jumps]
        for jump, expected in zip(one.jumps, other.jumps):
            assert jump.parameter == jump.before.parameter == pytest.approx(expected.parameter, rel=1e-10)
            np.testing.assert_allclose(jump.after.free, expected.after.free, rtol=0, atol=1e-9)
        for path in one.paths:
            assert all(point.stable for point in path.points[:-1]) and path.points[-1].kind == path.end.replace("to", "")
            for point in path.points:
                tangent = path.equations.at(point.free, point.parameter, point.piece)
                assert np.abs(tangent.pull).max() < 1e-7 and paths.inside(path.equations, point)
                if not point.kind:
                    assert np.linalg.eigvalsh(tangent.stiffness)[0] > 0.0


@pytest.mark.parametrize("name", ["two_bar_nsh", "three_bar_nsh", "six_bar_nsh"])
def test_most_of_a_sweep_needs_no_arc_length_steps(name, monkeypatch):
    """What makes it quick is really in use: at most one interval of loads is followed along the arc."""
    followed = []
    monkeypatch.setattr(steady_states, "follow_from", lambda *a, **k: followed.append(a) or paths.follow_from(*a, **k))
    steady_states.load_sweep(lifted(name)[1], LOADS)
    assert len(followed) <= 1


@pytest.mark.parametrize("name, loads", [("two_bar_nsh", (20.0, 40.0, 64.0)), ("three_bar", (10.0, 60.0))])
def test_sudden_load_comes_to_rest_where_the_dynamics_does(name, loads):
    model, loading = lifted(name)
    up = steady_states.load_sweep(loading, LOADS)
    suddenly, kernel = sudden.SuddenLoads(up.equations), Kernel(model)
    for load in loads:
        known = sudden.states_at([*up.paths, *steady_states.detours(up)], load)
        found = suddenly.state(load, known)
        kernel["force"][:] = up.equations.free(loading.forces(load))
        kernel.initialize()
        kernel.step(50.0)
        expected = kernel["position"].reshape(len(model.nodes), -1)
        np.testing.assert_allclose(up.equations.nodes(found.point.free)[:, model.axes], expected, rtol=0, atol=1e-9)
        assert found.point.stable and found.time < 20.0


@settings(derandomize=True, max_examples=12, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4), st.floats(1.0, 12.0))
def test_paths_under_any_force_lead_to_what_settles(direction, load):
    """Through slack and taut: the path's state is where the flow comes to rest."""
    model = scene("two_bar")
    field = np.zeros(model.nodes.shape)
    field[2:, [0, 2]] = np.reshape(direction, (2, 2))
    if np.abs(field).max() < 0.1:
        field[2, 0] = 1.0
    sweep = steady_states.load_sweep(Loading(model, field), [0.0, load])
    settled = statics.settle(model, force=load * field, steps=30)
    np.testing.assert_allclose(sweep.nodes[-1], settled.nodes, rtol=0, atol=1e-10)
    assert np.abs(statics.residual(sweep.equations.loading.model_at(load, sweep.nodes[-1]), load * field)).max() < 1e-9


def test_states_in_the_hysteresis_are_told_apart():
    _model, loading = lifted("two_bar_nsh")
    path = paths.follow(loading, 0.0, 72.0)
    limits = [p.parameter for p in path.special("limit")]
    assert len(limits) == 8 and path.end == "to"
    states = path.at(0.5 * (limits[0] + limits[1]))
    assert [s.stable for s in states[:2]] == [True, False] and states[-1].stable


# --- strings of any kind, payloads, gravity aslant -----------------------------------------------------------------------

LAWS = [name for name in STRINGS if name not in ("cells", "mixed", "memory", "bistable")]


@pytest.mark.parametrize("name", LAWS)
def test_a_sweep_over_any_law_without_memory_is_what_settles(name):
    model = mast(name)
    field = on_tip(model, [1.0, 0.0, 0.0])
    sweep = steady_states.load_sweep(Loading(model, field), [0.0, 20.0, 45.0])
    settled = model
    for before, load, nodes in zip((0.0, 20.0), (20.0, 45.0), sweep.nodes[1:]):
        settled = statics.settle(settled, force=load * field, force_before=before * field, steps=60)
        np.testing.assert_allclose(nodes, settled.nodes, rtol=0, atol=1e-11)


@settings(derandomize=True, max_examples=60, deadline=None)
@given(st.sampled_from(("chain", "pair", "nested", "kinked", "smooth", "hardening")), st.floats(-0.01, 0.15))
def test_elements_laws_are_the_exact_ones(name, x):
    model = mast(name)
    exact, found = string_law(model, 0), string_laws(model)
    require_exact(found, exact, x)


def test_payloads_gravity_aslant_and_actuators_in_a_sweep():
    model = statics.settle(built(LABORATORY), steps=1)
    field = np.zeros(model.nodes.shape)
    field[model.node_names.index("n4")] = [1.0, 0.5, -2.0]
    sweep = steady_states.load_sweep(Loading(model, field), [0.0, 3.0])
    settled = statics.settle(model, force=3.0 * field, steps=20)
    np.testing.assert_allclose(sweep.nodes[-1], settled.nodes, rtol=0, atol=1e-10)


# --- refusals ----------------------------------------------------------------------------------------------------------


def test_bad_loadings_are_refused():
    model, _ = upright()
    with pytest.raises(InputError, match="give a load that changes"):
        paths.follow(Loading(model), 0.0, 1.0)
    with pytest.raises(InputError, match="rest_length_direction.*shape"):
        Loading(model, rest_length_direction=[1.0])
    with pytest.raises(InputError, match="p = 1 makes the rest length of s1 -0.2[0-9]* m"):
        paths.follow(Loading(model, rest_length_direction=[-1.0, 0.0]), 0.0, 1.0)
    with pytest.raises(InputError, match="finite numbers, at least one"):
        steady_states.load_sweep(Loading(model, on_tip(model, -UP)), [0.0, np.inf])
    with pytest.raises(PathError, match="not stable"):
        steady_states.load_sweep(Loading(model, on_tip(model, -UP)), [2.5 * K * L, 3.0 * K * L])


def test_laws_that_no_path_can_follow_are_refused():
    model = mast("memory")
    with pytest.raises(InputError, match="string s1 has memory .*statics.settle"):
        steady_states.load_sweep(Loading(model, on_tip(model, UP)), [0.0, 1.0])
    endless = Series((Spring(900.0), Polynomial((600.0, 0.0, 4.0e5))))
    model, _ = upright()
    model = changed(model, element=(None, endless))
    with pytest.raises(InputError, match="string s2: beyond .*goes on for ever and is no polynomial; .*statics.settle"):
        paths.follow(Loading(model, on_tip(model, UP)), 0.0, 1.0)


def test_a_structure_that_nothing_holds_is_refused():
    model = one_bar([0.0, 0.0, L], [[-A, 0.0, L]], [A + 0.1])  # slack: the bar is free to turn
    with pytest.raises(PathError, match="no isolated equilibrium"):
        paths.follow(Loading(model, on_tip(model, -UP)), 0.0, 1.0)


def test_a_point_between_two_without_a_direction_is_an_error(monkeypatch):
    _, loading = lifted("three_bar")
    path = steady_states.load_sweep(loading, [0.0, 5.0]).paths[0]
    monkeypatch.setattr(paths, "_point", lambda *point: None)
    with pytest.raises(PathError, match=r"no direction at p = 2\.5"):
        path.at(2.5)
