"""Strings over several nodes, strings with mass and springs that also push, in the kernel: against closed forms, the same
structure written otherwise, the reference, and derivatives by differences.

More random structures, and longer: ``python -m tests.kernel.test_rigged 300 0.24``, how many and for how many seconds.
"""

from dataclasses import replace

import numpy as np
import pytest

from tensegrity_core import kernel, reference
from tensegrity_core.errors import InputError
from tensegrity_core.fields import METHODS
from tensegrity_core.kernel import Kernel, to_bytes
from tensegrity_core.kernel.unpacking import from_bytes
from tensegrity_core.model import grid, held
from tensegrity_core.scene import builtin_scenes
from tests.kernel.test_random_scenes import random_model
from tests.support import by_hand, scene
from tests.support.driven_scenes import LABORATORY, PENDULUM, built
from tests.support.element_scenes import STRINGS, mast
from tests.support.ground_scenes import random_drives, random_ground
from tests.support.jointed_scenes import random_forces, random_joints
from tests.support.rigged_scenes import RIGGED
from tests.support.routed_scenes import routed
from tests.support.words import words


def drive(model, duration=1.0, step=0.02):
    """Everything moves: forces, rest lengths, pivots, currents."""
    times = grid(duration, step)
    at, along = model.nodes[list(model.moving)], np.random.default_rng(2).normal(size=(len(model.moving), 3)) * 0.02
    force = np.random.default_rng(1).normal(size=(len(model.nodes), 3)) * 20.0 * ~model.fixed[:, None]
    force[:, [axis for axis in range(3) if axis not in model.axes]] = 0.0
    return held(
        model,
        times,
        force=lambda t: force * np.sin(5.0 * t),
        rest_length=lambda t: model.rest_length * (1.0 - 0.02 * np.sin(6.0 * t)),
        motion=lambda t: (at + along * np.sin(4.0 * t), 4.0 * along * np.cos(4.0 * t)),
        current=lambda t: model.current * (1.0 + 0.3 * np.sin(7.0 * t)),
    )


def rigged(law="literal", **changes):
    return replace(built(RIGGED, damping_law=law), **changes)


@pytest.mark.parametrize("method", METHODS)
def test_weights_over_a_pulley(method):
    """s = x1 + x2 oscillates about its rest under 2 g, and each weight falls by what the tension leaves of it."""
    k, m1, m2, g = 900.0, 2.0, 1.5, 9.81
    model = by_hand(
        [[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, -1.4]],
        [1],
        [],
        [(0, 1, 2)],
        axes=(0, 2),
        point_mass=((0, m1), (2, m2)),
        stiffness=k,
        rest_length=2.4 - 17.0 / k,
        gravity=g,
    )
    times = grid(1.0, 0.05)
    result = kernel.simulate(model, held(model, times), method=method, tolerance=1e-11, max_step=2e-4)
    inverse = 1.0 / m1 + 1.0 / m2
    omega, stretch = np.sqrt(k * inverse), 17.0 / k
    rest = 2.0 * g / (k * inverse)  # elongation about which it oscillates
    wave, area = np.cos(omega * times), (1.0 - np.cos(omega * times)) / omega**2
    tension = k * (rest + (stretch - rest) * wave)
    pulled = k * (rest * 0.5 * times**2 + (stretch - rest) * area)  # twice integrated
    near = {"rk4": 1e-7, "ros2": 2e-4}.get(method, 1e-9)
    np.testing.assert_allclose(result.position[:, 0, 2], -1.0 - 0.5 * g * times**2 + pulled / m1, rtol=0, atol=near)
    np.testing.assert_allclose(result.position[:, 2, 2], -1.4 - 0.5 * g * times**2 + pulled / m2, rtol=0, atol=near)
    np.testing.assert_allclose(result.string_force[:, 0], tension, rtol=0, atol=2e3 * near)
    np.testing.assert_allclose(result.reaction[:, 1, 2], 2.0 * tension, rtol=0, atol=4e3 * near)
    assert np.array_equal(result.position[:, :, 0], np.zeros((len(times), 3)))


def test_a_spring_that_pushes_swings_on_both_sides_of_its_rest_length():
    """No transition at the rest length, and under tension_only nothing is clipped."""
    m, k, d, start = 1.3, 400.0, 3.0, 0.06
    for law in ("literal", "tension_only"):
        model = by_hand(
            [[0.0, 0.0, 0.0], [1.0 + start, 0.0, 0.0]],
            [0],
            [],
            [(0, 1)],
            point_mass=((1, m),),
            stiffness=k,
            damping=d,
            rest_length=1.0,
            two_way=(True,),
            damping_law=law,
        )
        times = grid(2.0, 0.01)
        result = kernel.simulate(model, held(model, times), tolerance=1e-12)
        rate = 0.5 * d / m
        omega = np.sqrt(k / m - rate**2)
        x = start * np.exp(-rate * times) * (np.cos(omega * times) + rate / omega * np.sin(omega * times))
        np.testing.assert_allclose(result.position[:, 1, 0], 1.0 + x, rtol=0, atol=1e-10)
        np.testing.assert_allclose(result.elastic_force[:, 0], k * x, rtol=0, atol=1e-7)
        assert x.min() < -0.02 and result.transitions == [] and result.ledger_error() < 1e-11


@pytest.mark.parametrize("law", ["literal", "tension_only"])
def test_masses_of_strings_are_point_masses(law):
    """To the last bit where the shares are, and no more than round-off in the energies."""
    model = rigged(law)
    shares = dict(model.point_mass)
    for string, node, share in model.string_mass_shares:
        shares[node] = shares.get(node, 0.0) + share * model.string_mass[string]
    bare = replace(model, string_mass=np.zeros(len(model.strings)), point_mass=tuple(sorted(shares.items())))
    assert len(shares) > len(model.point_mass) and len(model.string_mass_shares) > 8
    ours, theirs = (kernel.simulate(one, drive(one), tolerance=1e-9) for one in (model, bare))
    for name in ("position", "velocity", "string_force", "bar_force", "reaction", "potential", "kinetic", "input_work"):
        np.testing.assert_allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-9, atol=1e-9, err_msg=name)


def test_a_string_over_a_node_on_its_way_is_the_string_without_it():
    """A mass that a taut string runs straight through, at rest, feels nothing."""
    nodes = [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [1.0, 0.0, 0.0]]
    options = dict(point_mass=((1, 0.4), (2, 1.0)), stiffness=250.0, damping=4.0, rest_length=0.95)
    routed = by_hand(nodes, [0], [], [(0, 1, 2)], **options)
    straight = by_hand(nodes, [0], [], [(0, 2)], **options)
    ours, theirs = (kernel.simulate(one, held(one, grid(0.5, 0.01)), tolerance=1e-12) for one in (routed, straight))
    np.testing.assert_allclose(ours.position, theirs.position, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours.string_length, theirs.string_length, rtol=0, atol=1e-12)


@pytest.mark.parametrize("law", ["literal", "tension_only"])
def test_kernel_and_reference_agree(law):
    """Everything moving."""
    model = rigged(law)
    assert apart(model, drive(model, 1.0, 0.05)) <= 1e-7


@pytest.mark.parametrize("law", ["literal", "tension_only"])
@pytest.mark.parametrize("method", ["rodas5p", "radau9", "dopri5", "auto"])
def test_methods_agree(method, law):
    model = rigged(law)
    inputs = drive(model)
    a = kernel.simulate(model, inputs, method="dop853", tolerance=1e-11)
    b = kernel.simulate(model, inputs, method=method, tolerance=1e-11)
    np.testing.assert_allclose(a.position, b.position, rtol=0, atol=1e-8)
    assert crossings(a) == crossings(b)
    assert a.ledger_error() < 1e-9 and b.ledger_error() < 1e-9


@pytest.mark.parametrize("method, order", [("rk4", 4), ("ros2", 2)])
def test_methods_of_fixed_step_keep_their_order(method, order):
    model = rigged()
    inputs = drive(model, 0.4, 0.1)
    exact = kernel.simulate(model, inputs, method="dop853", tolerance=1e-12).position[-1]
    errors = [
        np.abs(kernel.simulate(model, inputs, method=method, max_step=step).position[-1] - exact).max()
        for step in (1e-3, 5e-4, 2.5e-4)
    ]
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert rates.min() > order - 0.35, (errors, rates)


@pytest.mark.parametrize("law", ["literal", "tension_only"])
def test_jacobian_is_the_derivative(law):
    """By positions, rates and time, at several states."""
    model = rigged(law)
    k = Kernel(model)
    k.initialize()
    random = np.random.default_rng(5)
    k.slopes[:] = random.normal(size=k.slopes.shape) * 0.1
    y0 = k.state.copy()
    nq = (len(y0) - 3) // 2
    for _ in range(3):
        y = y0.copy()
        y[: 2 * nq] += random.normal(size=2 * nq) * np.repeat([0.005, 0.3], nq)
        Jq, Jv, ft = k.jacobian(y, 0.01)
        h = 1e-6
        columns = np.eye(len(y))[: 2 * nq] * h
        found = np.array([(k.derivative(y + e, 0.01) - k.derivative(y - e, 0.01))[nq : 2 * nq] / (2.0 * h) for e in columns]).T
        by_time = (k.derivative(y, 0.01 + 1e-5) - k.derivative(y, 0.01 - 1e-5))[nq : 2 * nq] / 2e-5
        np.testing.assert_allclose(np.hstack((Jq, Jv)), found, rtol=0, atol=2e-7 * np.abs(found).max())
        np.testing.assert_allclose(ft, by_time, rtol=0, atol=1e-6 * np.abs(by_time).max())
        assert np.abs(by_time).max() > 1.0


def test_a_saved_state_goes_on_with_the_same_bits():
    k = Kernel(rigged())
    k.initialize()
    for _ in range(30):
        k.step(0.004)
    kept = k.save()
    first = [k.step(0.004) or k.values.copy() for _ in range(20)]
    k.restore(kept)
    again = [k.step(0.004) or k.values.copy() for _ in range(20)]
    assert np.array_equal(first, again)


def test_the_packed_model_comes_back():
    model = rigged()
    names = model.node_names, model.bar_names, model.string_names
    back = from_bytes(to_bytes(model), *names, model.axes, model.name, model.description)
    assert to_bytes(back) == to_bytes(model)
    assert back.routes == model.routes and back.string_mass_shares == model.string_mass_shares
    assert np.array_equal(back.string_mass, model.string_mass) and np.array_equal(back.two_way, model.two_way)


def test_a_node_that_only_a_string_gives_mass_cannot_lose_it():
    nodes = [[0.0, 0.0, 0.0], [0.5, 0.1, 0.0], [1.0, 0.0, 0.0]]
    options = dict(stiffness=250.0, rest_length=0.9, string_mass=np.array([0.2]))
    model = by_hand(nodes, [0, 2], [], [(0, 1, 2)], **options)
    k = Kernel(model)
    k.initialize()
    k.step(0.01)
    assert k["velocity"][1] < 0.0
    k.reset()
    k["string_mass"][0] = 0.0
    with pytest.raises(InputError, match="must be positive"):
        k.initialize()


def test_what_a_scene_does_not_have_takes_no_room():
    model = built(PENDULUM)
    sizes = np.frombuffer(to_bytes(model), "<i4", len(model.counts) + 9, 8)[-4:]
    assert not sizes.any() and model.counts["M"] == 0


# --- random structures ----------------------------------------------------------------------------------------------------


def random_case(seed):
    """A structure of any kind with its strings made routed, massive or two-way, lightly damped."""
    random = np.random.default_rng(seed)
    kind = seed % 5
    if kind < 2:
        base = random_model(seed)
    elif kind == 2:
        base = built(LABORATORY)
    elif kind == 3:
        base = mast(sorted(STRINGS)[seed // 5 % len(STRINGS)])
    else:
        base = scene(builtin_scenes()[seed // 5 % 6])
    model = routed(base, seed)
    heavy = model.damping.max() > 100.0
    damping = np.where(
        random.random(len(model.strings)) < 0.3, 0.0, model.damping * (random.uniform(0.02, 0.3) if heavy else 1.0)
    )
    return replace(model, damping=damping, damping_law=("literal", "tension_only")[random.integers(2)])


def apart(model, inputs):
    """The largest distance of kernel and reference, m; forces, reactions, ledgers and transitions are compared besides."""
    ours, theirs = kernel.simulate(model, inputs, tolerance=1e-11), reference.simulate(model, inputs)
    distance = np.abs(ours.position - theirs.position).max()
    if distance > 1e-7:
        return distance
    scale = 1e-3 + 1e-6 * np.abs(theirs.string_force).max()
    np.testing.assert_allclose(ours.string_force, theirs.string_force, rtol=0, atol=scale)
    np.testing.assert_allclose(ours.reaction, theirs.reaction, rtol=0, atol=20 * scale)
    np.testing.assert_allclose(ours.bar_force, theirs.bar_force, rtol=0, atol=20 * scale)
    assert ours.ledger_error() < 1e-8 and theirs.ledger_error() < 1e-8
    assert crossings(ours) == crossings(theirs)
    return distance


def crossings(result):
    return [(t.string, t.before, t.after) for t in result.transitions]


@pytest.mark.parametrize("seed", range(10))
def test_random_structures_agree(seed):
    model = random_case(seed)
    assert apart(model, drive(model, 0.24, 0.04)) <= 1e-7


def test_the_reference_sees_a_release_that_is_over_before_a_piece_ends():
    """A clipped string is released and, on the formula of its piece gone on past its end, clipped again within one step."""
    model, random = routed(random_model(261), 261), np.random.default_rng(261)
    damping = np.where(random.random(len(model.strings)) < 0.3, 0.0, model.damping)
    model = replace(model, damping=damping, damping_law="tension_only")
    random = np.random.default_rng(338)
    times, force = grid(0.24, 0.04), random.normal(size=(len(model.nodes), 3)) * 15.0 * ~model.fixed[:, None]
    omega = random.uniform(2.0, 9.0, 3)
    inputs = held(
        model,
        times,
        force=lambda t: force * np.sin(omega[0] * t),
        rest_length=lambda t: model.rest_length * (1.0 - 0.02 * np.sin(omega[1] * t)),
    )
    assert apart(model, inputs) <= 1e-9


@pytest.mark.parametrize("seed, joints", [(1, False), (4, True)])
def test_random_structures_on_the_ground_agree(seed, joints):
    """With joints and nodes held along an axis, too."""
    model = routed(random_ground(seed, joints), seed)
    inputs = random_drives(model, seed, 3)
    ours, theirs = kernel.simulate(model, inputs, tolerance=1e-11), reference.simulate(model, inputs)
    np.testing.assert_allclose(ours.position, theirs.position, rtol=0, atol=1e-7)
    np.testing.assert_allclose(ours.string_force, theirs.string_force, rtol=0, atol=1e-4)
    assert model.routes and ours.ledger_error() < 1e-8 and len(ours.transitions) > 5


@pytest.mark.parametrize("method", ["dop853", "rodas5p", "radau9"])
@pytest.mark.parametrize("seed", [1, 2])
def test_random_structures_with_joints_agree(seed, method):
    model = routed(random_joints(seed), seed)
    inputs = random_forces(model, seed)
    ours, theirs = kernel.simulate(model, inputs, method, tolerance=1e-11), reference.simulate(model, inputs)
    np.testing.assert_allclose(ours.position, theirs.position, rtol=0, atol=1e-7)
    np.testing.assert_allclose(ours.string_force, theirs.string_force, rtol=0, atol=1e-4)
    assert model.routes and model.joint and ours.ledger_error() < 1e-8


def moved_by_a_push(model, inputs, seed):
    """How far the kernel's own run goes from itself where 1e-9 N push besides, m."""
    size = 1e-9 * np.isin(np.arange(3), model.axes) * ~model.fixed[:, None]
    push = size * np.random.default_rng(seed).normal(size=inputs.force.shape)
    runs = [kernel.simulate(model, one, tolerance=1e-11) for one in (inputs, replace(inputs, force=inputs.force + push))]
    return np.abs(runs[0].position - runs[1].position).max()


def sweep(count, duration):
    """How many agree, and what the others say."""
    agreed, worst = 0, 0.0
    for seed in range(count):
        model = random_case(seed)
        inputs = drive(model, duration, 0.04)
        try:
            distance = apart(model, inputs)
        except AssertionError as failure:
            print(f"{seed} {model.name}: {str(failure).strip()[:200] or 'a ledger or a transition'}", flush=True)
            continue
        if distance > 1e-7:
            moved = moved_by_a_push(model, inputs, seed)
            print(
                f"{seed} {model.name}: {distance:.1e} m apart; pushed, the kernel's own run moves by {moved:.1e} m", flush=True
            )
            continue
        agreed, worst = agreed + 1, max(worst, distance)
    print(f"{agreed} of {count} agree, the farthest to {worst:.1e} m")


if __name__ == "__main__":
    sweep(*words(__doc__, count=300, seconds=0.24))
