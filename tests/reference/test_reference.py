"""The reference: its matrix equations against the per-bar equations, its ledger, momentum, bar lengths, transitions."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tensegrity_core import reference
from tensegrity_core.errors import InputError, SimulationError
from tensegrity_core.model import Model, grid, held
from tensegrity_core.reference import instant
from tensegrity_core.reference import run as reference_run
from tensegrity_core.reference import structure as structures
from tests.support import by_hand, changed, scene

UP = np.array([0.0, 0.0, 1.0])


def build(
    nodes,
    fixed,
    bars,
    strings,
    *,
    axes=(0, 1, 2),
    mass=1.0,
    k=1000.0,
    d=0.0,
    slack=0.0,
    gravity=9.81,
    velocity=None,
    law="literal",
    rest=None,
):
    """A model by hand: one mass, stiffness and damping for all; rest lengths = lengths + slack unless given."""
    nodes = np.array(nodes, dtype=float)
    strings = np.array(strings, dtype=int).reshape(-1, 2)
    length = np.linalg.norm(nodes[strings[:, 1]] - nodes[strings[:, 0]], axis=1)
    options = {"axes": axes, "bar_mass": mass, "stiffness": k, "damping": d, "damping_law": law, "gravity": gravity}
    rest = length + slack if rest is None else rest
    return by_hand(nodes, fixed, bars, strings, rest_length=rest, velocity=velocity, **options)


def free_structure(**options) -> Model:
    """Three free bars joined by nine strings, spinning and moving; nothing is fixed."""
    rng = np.random.default_rng(7)
    ring = [(math.cos(a), math.sin(a)) for a in 2.0 * math.pi * np.arange(3) / 3.0]
    nodes = [(x, y, 0.0) for x, y in ring] + [(-0.9 * y, 0.9 * x, 1.1) for x, y in ring]
    bars = [(0, 4), (1, 5), (2, 3)]
    strings = [(0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)]
    model = build(nodes, [], bars, strings, k=300.0, d=20.0, slack=-0.05, gravity=0.0, **options)
    return replace(model, velocity=admissible(model, rng.normal(size=(6, 3))))


def admissible(model: Model, velocity: np.ndarray) -> np.ndarray:
    """The nearest velocities without change of bar lengths; zero at fixed nodes."""
    velocity = np.where(model.fixed[:, None], 0.0, velocity)
    for first, second in model.bars:
        b = model.nodes[second] - model.nodes[first]
        along = b * (b @ (velocity[second] - velocity[first])) / (b @ b)
        free = [node for node in (first, second) if not model.fixed[node]]
        for node in free:
            velocity[node] += (1.0 if node == first else -1.0) * along / len(free)
    return velocity


def mixed_structure() -> Model:
    """A pinned bar each way round, a free bar, an anchor, and strings of every kind of end."""
    nodes = [(0, 0, 0), (0.3, 0.2, 1), (1.1, 0.1, 0.9), (1, 0, 0.1), (0.2, 0.9, 0.6), (0.8, 1.1, 1.2), (0.5, 0.4, 2)]
    return build(
        nodes,
        [0, 3, 6],
        [(0, 1), (2, 3), (4, 5)],
        [(1, 2), (1, 4), (2, 5), (6, 4), (6, 1), (0, 5), (3, 4)],
        k=700.0,
        d=30.0,
        slack=-0.03,
    )


def per_bar_accelerations(model: Model, N, V, end_forces):
    """Accelerations and ground forces (n, 3) by the per-bar equations; end_forces (n, 3): all but weight and ground."""
    acceleration, ground = np.zeros_like(N), np.zeros_like(N)
    on_bar = np.zeros(len(N), dtype=bool)
    for (first, second), m in zip(model.bars, model.bar_mass):
        on_bar[[first, second]] = True
        b, bdot = N[second] - N[first], V[second] - V[first]
        P = np.eye(3) - np.outer(b, b) / (b @ b)
        spin = (bdot @ bdot) / (b @ b) * b
        weight = -m * model.gravity * UP
        f1, f2 = end_forces[first], end_forces[second]
        if model.fixed[first] or model.fixed[second]:
            base, tip, sign = (first, second, 1.0) if model.fixed[first] else (second, first, -1.0)
            arm = sign * b
            acceleration[tip] = 3.0 / m * P @ (end_forces[tip] + 0.5 * weight) - sign * spin
            assert arm @ arm > 0.0
            ground[base] = 0.5 * m * acceleration[tip] - end_forces[base] - end_forces[tip] - weight
        else:
            centre = (f1 + f2 + weight) / m
            turning = 12.0 / m * P @ (f2 - f1) / 2.0 - spin
            acceleration[first], acceleration[second] = centre - 0.5 * turning, centre + 0.5 * turning
    anchors = model.fixed & ~on_bar
    ground[anchors] = -end_forces[anchors]
    return acceleration, ground


def random_state(model: Model, seed: int):
    """Bars turned at random about their pins or centres, with admissible velocities: N, V (n, 3), force (n, 3)."""
    rng = np.random.default_rng(seed)
    N = model.nodes.copy()
    for i, (first, second) in enumerate(model.bars):
        direction = rng.normal(size=3)
        b = model.bar_length[i] * direction / np.linalg.norm(direction)
        if model.fixed[first]:
            N[second] = N[first] + b
        elif model.fixed[second]:
            N[first] = N[second] - b
        else:
            centre = 0.5 * (N[first] + N[second]) + 0.3 * rng.normal(size=3)
            N[first], N[second] = centre - 0.5 * b, centre + 0.5 * b
    velocity = admissible(replace(model, nodes=N), 3.0 * rng.normal(size=N.shape))
    return N, velocity, np.where(model.fixed[:, None], 0.0, rng.normal(size=N.shape))


def taut_mode(s: structures.Structure, elongation):
    return instant.mode_of(s, (elongation > 0.0).astype(int), np.zeros(len(elongation), dtype=bool))


@pytest.mark.parametrize(
    "model",
    [mixed_structure(), free_structure(), build([(0, 0, 0), (1, 0, 1)], [0], [(0, 1)], [])],
    ids=["pinned_free_anchor", "free", "no_strings"],
)
@pytest.mark.parametrize("seed", range(5))
def test_matrix_form_agrees_with_per_bar_equations(model, seed):
    N, V, force = random_state(model, seed)
    rates = np.random.default_rng(seed).normal(size=len(model.strings)) * 0.1
    end_forces = force.copy()
    lengths, tensions = [], []
    for j, (first, second) in enumerate(model.strings):
        s, sdot = N[second] - N[first], V[second] - V[first]
        xi = math.sqrt(s @ s)
        elongation = xi - model.rest_length[j]
        T = model.stiffness[j] * elongation + model.damping[j] * (s @ sdot / xi - rates[j]) if elongation > 0.0 else 0.0
        end_forces[first] += T * s / xi
        end_forces[second] -= T * s / xi
        lengths.append(xi)
        tensions.append(T)
    acceleration, ground = per_bar_accelerations(model, N, V, end_forces)

    structure = structures.Structure(model)
    load = instant.Load(0.0, force.T, model.rest_length, rates)
    mode = taut_mode(structure, np.array(lengths) - model.rest_length)
    motion = instant.motion_at(structure, load, mode, 0.0, N.T, V.T)
    scale = max(1.0, np.abs(acceleration).max(), np.abs(end_forces).max())
    np.testing.assert_allclose(motion.strings.tension, tensions, rtol=1e-12, atol=1e-13 * scale)
    np.testing.assert_allclose(motion.Nddot.T, acceleration, rtol=0.0, atol=1e-13 * scale)
    np.testing.assert_allclose(motion.ground.T, ground, rtol=0.0, atol=1e-13 * scale)


def test_bar_force_is_the_mean_axial_force():
    """-lambda l against statics: a hanging pinned bar pulls m g at its pin and nothing at its tip."""
    model = build([(0, 0, 1), (0, 0, 0)], [0], [(0, 1)], [], mass=2.0)
    result = reference.simulate(model, held(model, grid(0.1, 0.05)))
    np.testing.assert_allclose(result.bar_force, 0.5 * 2.0 * 9.81, rtol=1e-12)
    np.testing.assert_allclose(result.reaction[:, 0], [[0.0, 0.0, 2.0 * 9.81]] * 3, atol=1e-12)


def square_wave(model, node=3, size=400.0):
    force = np.zeros((len(model.nodes), 3))
    force[node, 2] = size
    return lambda t: force if t % 1.0 < 0.5 else -force


def moving_rest_lengths(model, strings, size=0.05, period=0.25):
    def rest(t):
        lengths = model.rest_length.copy()
        lengths[strings] += size * math.sin(2.0 * math.pi * t / period)
        return lengths

    return rest


def runs():
    plain, nsh = scene("three_bar"), scene("three_bar_nsh")
    low = changed(nsh, damping=50.0)
    yield "square_wave", low, held(low, grid(0.3, 0.01), square_wave(low))
    yield "moving_rest_lengths", plain, held(plain, grid(0.1, 0.01), None, moving_rest_lengths(plain, [3, 4, 5]))
    clip = changed(plain, damping=50.0, damping_law="tension_only")
    yield "tension_only", clip, held(clip, grid(0.25, 0.01), square_wave(clip))
    free = free_structure()
    yield "free", free, held(free, grid(1.0, 0.05))


@pytest.mark.parametrize("name, model, inputs", list(runs()), ids=[run[0] for run in runs()])
def test_ledger_closes_and_bars_keep_their_length(name, model, inputs):
    result = reference.simulate(model, inputs)
    assert result.ledger_error() < 1e-9
    assert result.throughput[-1] > 1e-3 and result.dissipated[-1] > 1e-4  # the ledger was exercised
    b = result.position[:, model.bars[:, 1]] - result.position[:, model.bars[:, 0]]
    bdot = result.velocity[:, model.bars[:, 1]] - result.velocity[:, model.bars[:, 0]]
    np.testing.assert_allclose(np.linalg.norm(b, axis=2), np.broadcast_to(model.bar_length, b.shape[:2]), rtol=1e-14)
    assert np.abs(np.einsum("tbi,tbi->tb", b, bdot)).max() < 1e-13
    assert result.transitions or name == "moving_rest_lengths" or name == "free"
    if name == "tension_only":
        assert result.string_force.min() >= 0.0


def test_free_structure_conserves_momentum():
    model = free_structure()
    result = reference.simulate(model, held(model, grid(1.0, 0.05)))
    m = model.bar_mass[:, None]
    ends = [(result.position[:, model.bars[:, i]], result.velocity[:, model.bars[:, i]]) for i in (0, 1)]
    centre, moving = [0.5 * (ends[0][i] + ends[1][i]) for i in (0, 1)]
    half, turning = [0.5 * (ends[1][i] - ends[0][i]) for i in (0, 1)]
    linear = (m * moving).sum(axis=1)
    angular = (m * np.cross(centre, moving) + m / 3.0 * np.cross(half, turning)).sum(axis=1)
    assert np.linalg.norm(linear[0]) > 0.1 and np.linalg.norm(angular[0]) > 0.1
    assert np.abs(linear - linear[0]).max() < 1e-11
    assert np.abs(angular - angular[0]).max() < 1e-9
    assert np.abs(result.position[-1] - result.position[0]).max() > 0.1


def test_result_does_not_depend_on_the_projection(monkeypatch):
    model = changed(scene("three_bar"), damping=50.0)
    inputs = held(model, grid(0.3, 0.1), square_wave(model))
    seldom = reference.simulate(model, inputs)
    monkeypatch.setattr(reference_run, "DRIFT", 0.0)
    often = reference.simulate(model, inputs)
    assert often.stats["restarts"] > 2 * seldom.stats["restarts"]
    np.testing.assert_allclose(seldom.position, often.position, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("damping", [50.0, 500.0])
def test_methods_agree(damping):
    """Explicit and implicit integration, with rows inside steps and at their ends, give one motion."""
    model = changed(scene("three_bar"), damping=damping)
    inputs = held(model, grid(0.06, 0.02), square_wave(model))
    explicit = reference.simulate(model, inputs, method="DOP853")
    implicit = reference.simulate(model, inputs, method="Radau")
    np.testing.assert_allclose(implicit.position, explicit.position, rtol=0.0, atol=2e-9)
    names = [(t.string, t.before, t.after) for t in explicit.transitions]
    assert names and names == [(t.string, t.before, t.after) for t in implicit.transitions]
    np.testing.assert_allclose(
        [t.time for t in implicit.transitions], [t.time for t in explicit.transitions], rtol=0.0, atol=1e-8
    )


def test_stiff_scene_takes_the_implicit_method():
    model = changed(scene("three_bar"), damping=5000.0)
    inputs = held(model, grid(0.03, 0.01), square_wave(model))
    result, implicit, explicit = (reference.simulate(model, inputs, method=m) for m in ("auto", "Radau", "DOP853"))
    assert result.stats == implicit.stats != explicit.stats
    np.testing.assert_array_equal(result.position, implicit.position)
    np.testing.assert_allclose(result.position, explicit.position, rtol=0.0, atol=1e-9)


# Strings at the edge of slackness: a bar along x that slides between two anchors, on strings along its own line.


def slider(velocity, rest, law="literal", d=8.0, k=400.0):
    """A 1 kg bar that moves along x without gravity; string s1 ties its left end to an anchor 1 m away."""
    v = np.zeros((3, 3))
    v[1:, 0] = velocity
    return build(
        [(0, 0, 0), (1, 0, 0), (2, 0, 0)], [0], [(1, 2)], [(0, 1)], k=k, d=d, gravity=0.0, velocity=v, law=law, rest=[rest]
    )


def sliding(rest, v, d, k, t):
    """Elongation of the slider's string from elongation 1 - rest >= 0 at speed v, while taut; m = 1 kg, underdamped."""
    x, decay = 1.0 - rest, 0.5 * d
    omega = math.sqrt(k - decay * decay)
    return math.exp(-decay * t) * (x * np.cos(omega * t) + (v + decay * x) / omega * np.sin(omega * t))


def test_string_starts_exactly_at_its_rest_length():
    inputs = held(slider(0.5, 1.0), grid(0.1, 0.02))
    taut = reference.simulate(slider(0.5, 1.0), inputs, rtol=1e-12, atol=1e-13)
    assert taut.string_force[0, 0] == pytest.approx(8.0 * 0.5)  # lengthening: the damper pulls at once
    expected = [1.0 + sliding(1.0, 0.5, 8.0, 400.0, t) for t in taut.times]
    np.testing.assert_allclose(taut.string_length[:, 0], expected, rtol=0.0, atol=1e-11)
    slack = reference.simulate(slider(-0.5, 1.0), inputs)
    assert not slack.transitions and not slack.string_force.any()
    np.testing.assert_allclose(slack.position[-1, 1, 0], 1.0 - 0.05, rtol=1e-14)
    rest = reference.simulate(slider(0.0, 1.0), inputs)
    assert not rest.transitions and np.array_equal(rest.position[-1], rest.position[0])
    pulled = reference.simulate(slider(0.0, 1.0), held(slider(0.0, 1.0), grid(0.1, 0.02), lambda t: push_x(3, 2, 1.0)))
    assert pulled.position[-1, 1, 0] > 1.0 and pulled.string_force[-1, 0] > 0.0 and not pulled.transitions


def push_x(n, node, size):
    force = np.zeros((n, 3))
    force[node, 0] = size
    return force


def test_transition_times_against_the_closed_form():
    """Slack until it meets its rest length, a damped half swing, slack again: times, pieces, speed, energy."""
    model = slider(0.5, 1.02)
    result = reference.simulate(model, held(model, grid(0.4, 0.05)), rtol=1e-12, atol=1e-13)
    decay, omega = 4.0, math.sqrt(400.0 - 16.0)
    assert [(t.string, t.before, t.after) for t in result.transitions] == [(0, 0, 1), (0, 1, 0)]
    expected = [0.04, 0.04 + math.pi / omega]
    np.testing.assert_allclose([t.time for t in result.transitions], expected, rtol=0.0, atol=1e-12)
    speed = 0.5 * math.exp(-decay * math.pi / omega)
    np.testing.assert_allclose(result.velocity[-1, 1, 0], -speed, rtol=1e-10)
    np.testing.assert_allclose(result.dissipated[-1], 0.5 * (0.25 - speed**2), rtol=1e-9)


def test_tension_only_clips_where_the_damper_exceeds_the_spring():
    model = slider(0.5, 1.0, law="tension_only")
    result = reference.simulate(model, held(model, grid(0.4, 0.005)))
    assert result.string_force.min() == 0.0 and [(t.before, t.after) for t in result.transitions] == [(1, 0)]
    # x = v0/w e^(-at) sin wt, so k x + d v = 0 where (k - a d) sin wt = -d w cos wt; then the bar flies freely.
    decay, omega = 4.0, math.sqrt(400.0 - 16.0)
    clip = (math.pi - math.atan2(8.0 * omega, 400.0 - 8.0 * decay)) / omega
    x = sliding(1.0, 0.5, 8.0, 400.0, clip)
    v = 0.5 * math.exp(-decay * clip) * (math.cos(omega * clip) - decay / omega * math.sin(omega * clip))
    assert result.velocity[-1, 1, 0] == pytest.approx(v, abs=1e-10)
    assert result.transitions[0].time == pytest.approx(clip - x / v, abs=1e-10)
    assert result.ledger_error() < 1e-9


def test_symmetric_strings_change_together():
    """Four equal strings on a bar that falls straight: their transitions share each instant."""
    nodes = [(0, 0, 0.0), (0, 0, 1.0), (1, 0, 1), (-1, 0, 1), (0, 1, 1), (0, -1, 1)]
    model = build(nodes, [2, 3, 4, 5], [(0, 1)], [(1, 2), (1, 3), (1, 4), (1, 5)], k=200.0, d=5.0, slack=0.01)
    result = reference.simulate(model, held(model, grid(1.0, 0.05)))
    times = [t.time for t in result.transitions]
    assert len(times) >= 4 and len(set(times)) * 4 == len(times)
    np.testing.assert_allclose(result.position[:, :2, :2], 0.0, atol=1e-13)


def test_jump_of_rest_length_does_work_but_gives_no_impulse():
    model = slider(0.0, 0.99, d=0.0)
    inputs = held(model, grid(0.02, 0.01))
    inputs.rest_length[1] -= 0.03
    result = reference.simulate(model, inputs)
    x = result.string_length[1, 0] - 0.99
    assert result.input_work[1] == 0.0
    assert result.input_work[2] == pytest.approx(0.5 * 400.0 * ((x + 0.03) ** 2 - x**2), rel=1e-12)
    assert result.ledger_error() < 1e-12
    swing, omega = x + 0.03, 20.0
    v = result.velocity[1, 1, 0]
    expected = swing * math.cos(omega * 0.01) + v / omega * math.sin(omega * 0.01)
    assert result.string_length[2, 0] - 0.96 == pytest.approx(expected, rel=1e-10)


def test_planar_scene_stays_in_its_plane():
    model = scene("two_bar")
    pushed = held(model, grid(0.1, 0.02), lambda t: np.array([[0, 0, 0], [0, 0, 0], [30.0, 9.0, 50.0], [0, 5.0, 0]]))
    result = reference.simulate(model, pushed)
    assert np.abs(result.position[-1] - result.position[0]).max() > 1e-4
    assert not result.position[:, :, 1].any() and not result.reaction[:, :, 1].any()


@pytest.mark.parametrize("name", ["two_bar", "three_bar_nsh"])
def test_scenes_start_in_equilibrium(name):
    model = scene(name)
    result = reference.simulate(model, held(model, grid(0.1, 0.05)), rtol=1e-12, atol=1e-13)
    assert np.abs(result.position - model.nodes).max() < 1e-10
    weight = model.bar_mass.sum() * model.gravity
    np.testing.assert_allclose(result.reaction.sum(axis=1), [[0.0, 0.0, weight]] * 3, atol=1e-6)


def test_rows_do_not_move_the_motion():
    model = changed(scene("three_bar"), damping=50.0)
    coarse = reference.simulate(model, held(model, grid(0.2, 0.1), square_wave(model)))
    fine = reference.simulate(model, held(model, grid(0.2, 0.004), square_wave(model)))
    np.testing.assert_allclose(fine.position[::25], coarse.position, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(fine.elastic_force[::25], coarse.elastic_force, rtol=0.0, atol=1e-5)


def test_bad_input_is_named():
    model = slider(0.0, 0.9)
    good = held(model, grid(0.1, 0.05))
    with pytest.raises(InputError, match="method = 'Euler'"):
        reference.simulate(model, good, method="Euler")
    with pytest.raises(InputError, match=r"force has shape \(2, 4, 3\)"):
        reference.simulate(model, replace(good, force=np.zeros((2, 4, 3))))
    with pytest.raises(InputError, match="rest_length = -0.1 m"):
        reference.simulate(model, replace(good, rest_length=np.full((2, 1), -0.1)))
    with pytest.raises(InputError, match="force holds a value"):
        reference.simulate(model, replace(good, force=np.full((2, 3, 3), np.nan)))
    with pytest.raises(InputError, match="increasing times"):
        reference.simulate(model, replace(good, times=np.array([0.0, 0.0, 0.1])))
    assert structures.Structure(model).joints is None
    assert structures.Structure(replace(model, bars=[(1, 2), (0, 1)], bar_mass=[1.0, 1.0], bar_names=("b1", "b2"))).joints
    with pytest.raises(InputError, match="bar 'b1' has both ends fixed"):
        structures.Structure(replace(model, fixed=[False, True, True]))
    with pytest.raises(InputError, match="free node 'n1' belongs to no bar"):
        structures.Structure(replace(model, fixed=[False, False, False]))
    with pytest.raises(InputError, match="damping_law = 'viscous'"):
        structures.Structure(replace(model, damping_law="viscous"))


def test_hopeless_run_is_a_simulation_error():
    model = slider(0.0, 0.9)
    with pytest.raises(SimulationError) as caught:
        reference.simulate(model, held(model, grid(0.1, 0.05), lambda t: push_x(3, 2, 1e308)))
    assert caught.value.status == "step_failed" and caught.value.time == 0.0
