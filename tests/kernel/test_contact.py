"""Contact with the ground in the kernel: closed forms, rest, transitions, energy, saved states, Jacobian."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tensegrity_core.errors import InputError
from tensegrity_core.kernel import Kernel
from tensegrity_core.kernel.run import simulate
from tensegrity_core.model import Inputs, grid, held
from tests.support.touching import GRAVITY, STIFFNESS, ledger, lying, mass, moving, rod, thrown

METHODS = ["auto", "dop853", "dopri5", "rodas5p", "radau9", "rk4", "ros2"]
#: Step of the methods with a fixed one, and what their results err by in these tests then: (position, m; ledger).
FIXED = {"rk4": (1e-4, 1e-7, 1e-8), "ros2": (1e-4, 1e-4, 2e-4)}


def run(model, end, method="dop853", step=1e-2, tolerance=1e-10, inputs=None, max_step=None):
    inputs = inputs if inputs is not None else held(model, grid(end, step))
    return simulate(model, inputs, method, tolerance, max_step or FIXED.get(method, (0.0,))[0])


def kinds(result):
    return [transition.kind for transition in result.transitions]


@pytest.mark.parametrize("method", METHODS)
def test_dropped_mass_rebounds(method):
    """Elastic contact: delta = g/w^2 (1 - cos w t) + v/w sin w t from touch-down, w^2 = k_n/m."""
    height, w = 0.1, math.sqrt(STIFFNESS)
    fall = math.sqrt(2.0 * height / GRAVITY)
    pressed = 2.0 * (math.pi - math.atan2(GRAVITY * fall / w, GRAVITY / w**2)) / w
    result = run(mass((0.0, 0.0, height)), 3.0, method)
    expected = [fall + n * (2.0 * fall + pressed) + lift * pressed for n in range(10) for lift in (0, 1)]
    assert kinds(result)[:4] == ["touch_down", "lift_off"] * 2
    found = [transition.time for transition in result.transitions]
    np.testing.assert_allclose(found, expected[: len(found)], rtol=0.0, atol=max(1e-8, FIXED.get(method, (0, 0))[1]))
    assert len(found) == sum(time < 3.0 for time in expected)
    assert ledger(result) < FIXED.get(method, (0, 0, 1e-8))[2]


def test_energy_over_a_thousand_bounces():
    result = run(mass((0.0, 0.0, 0.1)), 310.0, step=0.5)
    assert Counter(kinds(result))["touch_down"] > 1000
    total = result.kinetic + result.potential + result.elastic
    assert np.abs(total - total[0]).max() < 1e-6 * total[0]
    assert np.abs(result.dissipated).max() < 1e-20


def test_loss_by_the_damper():
    """delta'' = g - k delta (1 + c delta'): by quadrature with SciPy, from the speed of touch-down."""
    c, height = 2.0, 0.3

    def out(t, y):
        return y[0] + (t == 0.0)

    out.terminal, out.direction = True, -1.0
    speed = math.sqrt(2.0 * GRAVITY * height)
    path = solve_ivp(
        lambda t, y: [y[1], GRAVITY - STIFFNESS * y[0] * (1.0 + c * y[1])],
        (0.0, 1.0),
        [0.0, speed],
        "DOP853",
        rtol=1e-12,
        atol=1e-14,
        events=out,
    )
    result = run(mass((0.0, 0.0, height), c=c), 0.3, tolerance=1e-12)
    touch, leave = result.transitions[:2]
    assert kinds(result)[:2] == ["touch_down", "lift_off"]
    assert leave.time - touch.time == pytest.approx(path.t[-1], abs=1e-9)
    after = np.flatnonzero(result.times > leave.time)[0]
    assert result.dissipated[after] == pytest.approx(0.5 * (speed**2 - path.y[1, -1] ** 2), abs=1e-9)
    assert ledger(result) < 1e-10


def test_damper_never_pulls():
    """Torn off the ground faster than 1/c, N would become negative: it is 0 from delta' = -1/c on, and the damper takes what
    the spring of the ground gives back."""
    c, pull, depth = 5.0, 300.0, GRAVITY / STIFFNESS

    def clipped(t, y):
        return 1.0 + c * y[1]

    clipped.terminal = True
    path = solve_ivp(
        lambda t, y: [y[1], GRAVITY - pull - STIFFNESS * y[0] * (1.0 + c * y[1])],
        (0.0, 1.0),
        [depth, 0.0],
        "DOP853",
        rtol=1e-12,
        atol=1e-14,
        events=clipped,
    )
    free, left = pull - GRAVITY, path.y[0, -1]
    gone = path.t[-1] + (math.sqrt(1.0 / c**2 + 2.0 * free * left) - 1.0 / c) / free
    model = mass((0.0, 0.0, -depth), c=c, mu=0.3)
    inputs = Inputs(np.linspace(0.0, 0.01, 11), force=np.full((10, 1, 3), (0.0, 0.0, pull))).resolved(model)
    for method in ("dop853", "radau9", "rodas5p"):
        result = run(model, 0.01, method, inputs=inputs, tolerance=1e-12)
        assert kinds(result) == ["clip", "lift_off"]
        assert [transition.time for transition in result.transitions] == pytest.approx([path.t[-1], gone], abs=1e-9)
        assert ledger(result) < 1e-10 and (result.contact_normal >= 0.0).all()
        assert result.elastic[-1] == 0.0


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_slides_to_a_stop(method, planar):
    """From v it comes to v^2/2 mu g + rho/2, where the bristles, deflected by rho, pull it back elastically."""
    mu, speed = 0.3, 1.0
    reach = mu * GRAVITY / 2.0 / STIFFNESS
    result = run(lying(speed, mu, planar=planar), 0.5, method, step=1e-4)
    assert kinds(result)[:4] == ["slip"] * 2 + ["stick"] * 2
    stop = speed**2 / (2.0 * mu * GRAVITY) + 0.5 * reach
    after = result.position[result.times > result.transitions[3].time + 1e-9, 0, 0]
    assert 0.5 * (after.max() + after.min()) == pytest.approx(stop - reach, abs=max(2e-8, FIXED.get(method, (0, 0))[1]))
    assert ledger(result) < FIXED.get(method, (0, 0, 1e-8))[2]
    assert np.abs(result.position[:, :, 2] - result.position[0, :, 2]).max() < 1e-15


@pytest.mark.parametrize("slope", [0.97, 1.03])
def test_incline_just_below_and_above_the_coefficient(slope):
    """Below, it swings about where the bristles hold it; above, it gains g (sin - mu cos) per second."""
    mu, angle = 0.5, math.atan(0.5 * slope)
    result = run(lying(mu=mu, slope=angle, c=0.2, planar=True), 4.0, step=0.5)
    if slope < 1.0:
        reach = mu * GRAVITY * math.cos(angle) / 2.0 / STIFFNESS
        assert np.abs(result.position[:, 0, 0]).max() < 0.01 and np.ptp(result.position[2:, 0, 0]) < 3.0 * reach
        assert result.contact_sticking[2:].all()
    else:
        gain = GRAVITY * (math.sin(angle) - mu * math.cos(angle))
        np.testing.assert_allclose(np.diff(result.velocity[2:, 0, 0]), 0.5 * gain, rtol=1e-8)
        assert "stick" not in kinds(result)[4:]


@pytest.mark.parametrize("planar", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_rest_on_friction_does_not_creep(method, planar):
    """On an incline, where its bristles hold it, drag having taken what it swung at first: nothing moves for 1000 s."""
    drag = ((0, 50.0), (1, 50.0))
    model = dataclasses.replace(lying(mu=0.5, slope=0.3, c=0.2, planar=planar), drag=drag)
    kernel = Kernel(model, method=method, tolerance=1e-13, max_step=0.01 if method in FIXED else 0.0)
    kernel.initialize(0.0)
    for _ in range(5):
        kernel.step(1.0)
    start, held_by = np.array(kernel["position"]), GRAVITY * math.sin(0.3) / 2.0
    assert start.reshape(2, -1)[0, 0] == pytest.approx(held_by / STIFFNESS, rel=1e-6)
    for _ in range(100):
        kernel.step(10.0)
        assert np.abs(np.array(kernel["position"]) - start).max() < 1e-12
    assert kernel["contact_force"].reshape(2, -1)[:, 0].tolist() == pytest.approx([-held_by] * 2, rel=1e-6)
    assert list(kernel.integers[-2:]) == [1, 1] and kernel.transition_count == 0


def test_methods_agree_on_a_spinning_bar():
    """Directions of slip turn, ends bounce, one sticks while the other slips: some 80 transitions in space."""
    runs = {method: run(thrown(), 1.5, method, tolerance=1e-11) for method in ("dop853", "radau9", "rodas5p", "auto")}
    first = runs["dop853"]
    assert Counter(kinds(first)).keys() >= {"touch_down", "lift_off", "slip", "stick"} and len(first.transitions) > 60
    for result in runs.values():
        assert np.abs(result.position - first.position).max() < 1e-8
        assert kinds(result) == kinds(first)
        assert ledger(result) < 1e-9
    lengths = np.linalg.norm(first.position[:, 1] - first.position[:, 0], axis=1)
    np.testing.assert_allclose(lengths, lengths[0], rtol=1e-12)


def _turned_slip(model, end):
    """The bristle as it is written in the model's description, u' = v_t - g t, integrated by SciPy from the first slip on."""
    contact, gravity = model.contacts[0], np.array(model.gravity)
    k, c, kt, mu = contact.stiffness, contact.damping, contact.tangential_stiffness, contact.friction

    def slopes(t, y, slips):
        velocity, u = y[3:6], y[6:]
        press = -k * y[2] * (1.0 - c * velocity[2])
        along = u / np.linalg.norm(u) if slips else u
        acceleration = gravity + np.append(-mu * press * along if slips else -kt * u, press)
        growth = -k * velocity[2] * (1.0 - c * velocity[2]) + k * y[2] * c * acceleration[2]
        rate = along @ velocity[:2] - mu / kt * growth if slips else 0.0
        return [*velocity, *acceleration, *(velocity[:2] - rate * along)]

    def gives_way(t, y, slips):
        return kt * np.linalg.norm(y[6:]) + mu * k * y[2] * (1.0 - c * y[5])

    gives_way.terminal = True
    start = [*model.nodes[0], *model.velocity[0], 0.0, 0.0]
    numbers = {"rtol": 1e-12, "atol": 1e-14}
    held_first = solve_ivp(slopes, (0.0, end), start, "DOP853", events=gives_way, args=(False,), **numbers)
    return solve_ivp(slopes, (held_first.t[-1], end), held_first.y[:, -1], "Radau", args=(True,), **numbers).y[:, -1]


@pytest.mark.parametrize("method", METHODS)
def test_direction_of_slip_turns(method):
    """A mass slides while gravity, which is aslant, turns its way; the ground has a damper, and friction another stiffness."""
    pull = (0.5, 2.0, -9.81)
    model = mass((0.0, 0.0, -8e-4), (1.0, 0.0, 0.0), c=0.3, mu=0.3, kt=1e4, gravity=pull)
    expected = _turned_slip(model, 0.2)
    result = run(model, 0.2, method)
    room = FIXED.get(method, (0, 1e-10))[1]
    assert np.abs(result.position[-1, 0] - expected[:3]).max() < room
    assert np.abs(result.velocity[-1, 0] - expected[3:6]).max() < 100.0 * room
    t = expected[6:] / np.linalg.norm(expected[6:])
    np.testing.assert_allclose(result.contact_force[-1, 0, :2], -0.3 * result.contact_normal[-1, 0] * t, atol=1e5 * room)


@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("ros2", 2)])
def test_order_through_transitions(method, order):
    """Touch-down, slip, stick and lift-off are located: between them the methods keep their orders."""
    model = thrown()
    exact = run(model, 0.3, step=0.3, tolerance=1e-13)
    assert {"touch_down", "lift_off", "slip", "stick"} <= set(kinds(exact))
    steps = (8e-4, 4e-4, 2e-4)
    errors = [np.abs(run(model, 0.3, method, 0.3, max_step=h).position[-1] - exact.position[-1]).max() for h in steps]
    for coarse, fine in pairwise(errors):
        assert coarse / fine > 0.85 * 2**order


def test_symmetric_ends_go_together():
    """Both ends touch, slip, stick and leave at one time, to the last bit, and none of it chatters."""
    model = rod((0.0, 0.0, 0.1), (1.0, 0.0, 0.1), (0.3, 0.0, 0.0), (0.3, 0.0, 0.0), c=0.2, mu=0.4)
    result = run(model, 2.0)
    pairs = list(zip(result.transitions[::2], result.transitions[1::2]))
    assert len(pairs) > 20
    for one, other in pairs[:20]:
        assert (one.contact, other.contact, one.kind) == (0, 1, other.kind) and one.time == other.time
    assert np.abs(result.position[:, 0, 2] - result.position[:, 1, 2]).max() < 1e-9


@pytest.mark.parametrize("method", ["dop853", "radau9", "rodas5p"])
def test_grazing_touch_down(method):
    """A mass that is pushed back turns a hair above the ground, or below: no method trips over it."""
    push, speed = 30.0, 1.0
    turn = speed**2 / 2.0 / (push - GRAVITY)
    for gap in (1e-8, 1e-13, 1e-16, 0.0, -1e-16, -1e-13, -1e-8):
        model = mass((0.0, 0.0, turn + gap), (0.2, 0.0, -speed), mu=0.3, c=0.2)
        inputs = Inputs(np.array([0.0, 0.1]), force=np.full((1, 1, 3), (0.0, 0.0, push))).resolved(model)
        result = run(model, 0.1, method, inputs=inputs)
        assert len(result.transitions) in {1e-8: (0,), -1e-8: (2, 3)}.get(gap, (0, 2, 3))
        assert result.position[-1, 0, 2] == pytest.approx(turn + gap - 0.1 + 0.005 * (push - GRAVITY), abs=1e-8)
        assert ledger(result) < 1e-9


def test_state_is_saved_with_its_bristles():
    """Going on from a saved state gives the same numbers, to the last bit; so does a step that follows one that was refused."""
    model = thrown()
    one, other = Kernel(model), Kernel(model)
    one.initialize(0.0)
    modes = set()
    for n in range(150):
        one.step(0.01)
        if n % 10 == 5:
            other.restore(one.save())
            for _ in range(3):
                other.step(0.004)
            again = Kernel(model)
            again.restore(one.save())
            with pytest.raises(InputError, match="positive"):
                again.step(-1.0)
            for _ in range(3):
                again.step(0.004)
            assert again.save() == other.save()
        modes |= {(bool(n), bool(s)) for n, s in zip(one["contact_normal"], one.integers[-2:])}
    assert modes == {(False, False), (True, False), (True, True)}


def test_jacobian_is_the_derivative():
    """In every mode, on a ground that moves; directions of slip are changed within the plane only, where they are."""
    kernel = Kernel(moving(thrown()), method="dop853")
    kernel["ground_velocity"][:], kernel["ground_acceleration"][:] = 0.3, 2.0
    kernel.initialize(0.0)
    modes, eps = set(), 1e-7
    for _ in range(60):
        kernel.step(0.01)
        kernel["ground_height"][:] = 0.0
        kernel.take_inputs()
        y = kernel.state
        n = (len(y) - 3) // 2
        Jq, Jv, ft = kernel.jacobian(y)
        shifted = np.eye(2 * n, len(y)) * eps
        found = [(kernel.derivative(y + d)[n : 2 * n] - kernel.derivative(y - d)[n : 2 * n]) / (2 * eps) for d in shifted]
        by_time = (kernel.derivative(y, eps)[n : 2 * n] - kernel.derivative(y, -eps)[n : 2 * n]) / (2 * eps)
        J, found = np.hstack([Jq, Jv]), np.array(found).T
        kept = [j for j in range(2 * n) if j not in (n + n - 1, n + n - 4)]
        scale = max(1.0, np.abs(found[:, kept]).max())
        assert np.abs(J - found)[:, kept].max() < 1e-5 * scale
        assert np.abs(ft - by_time).max() < 1e-5 * max(1.0, np.abs(by_time).max())
        modes |= {(bool(p), bool(s)) for p, s in zip(kernel["contact_normal"], kernel.integers[-2:])}
    assert modes == {(False, False), (True, False), (True, True)}


def test_moving_ground_does_work():
    """A ground that swings, and one that jumps: the ledger closes, and what a jump stores is input work."""
    model, w = moving(rod((-0.5, 0.0, 0.05), (0.5, 0.0, 0.1), c=0.2, mu=0.4)), 7.0
    swings = held(model, grid(1.0, 1e-2), ground=lambda t: (0.02 * math.sin(w * t), 0.02 * w * math.cos(w * t)))
    for method in ("dop853", "radau9"):
        result = run(model, 1.0, method, inputs=swings)
        assert ledger(result) < 1e-8 and abs(result.input_work[-1]) > 1e-2
    flat = moving(lying(mu=0.5))
    depth = GRAVITY / 2.0 / STIFFNESS
    jump = Inputs(np.array([0.0, 0.1, 0.2]), ground_height=np.array([[0.0], [0.01]])).resolved(flat)
    result = run(flat, 0.2, inputs=jump)
    stored = STIFFNESS * ((depth + 0.01) ** 2 - depth**2)
    assert result.input_work[-1] == pytest.approx(stored, rel=1e-12)
    assert ledger(result) < 1e-8


def test_any_plane():
    """Plane, gravity and start turned together: the same motion."""
    axis = np.array([1.0, 2.0, -0.5]) / math.sqrt(5.25)
    cross = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    R = np.eye(3) + math.sin(0.8) * cross + (1.0 - math.cos(0.8)) * cross @ cross
    model, shift = thrown(gravity=(0.0, 0.0, -GRAVITY)), np.array([0.3, -0.2, 0.5])
    nodes = model.nodes @ R.T + shift
    ground = dataclasses.replace(model.ground, point=tuple(shift), normal=tuple(R[:, 2]))
    turned = dataclasses.replace(
        model, nodes=nodes, nominal=nodes, velocity=model.velocity @ R.T, gravity=tuple(R @ (0.0, 0.0, -GRAVITY)), ground=ground
    )
    one, other = run(model, 0.8, tolerance=1e-11), run(turned, 0.8, tolerance=1e-11)
    assert np.abs(other.position - (one.position @ R.T + shift)).max() < 1e-9
    assert kinds(one) == kinds(other) and len(one.transitions) > 20
