"""The kernel's point masses, drag, moved nodes, actuators and gravity vectors against closed forms and other equations."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tensegrity_core import reference
from tensegrity_core.errors import SimulationError
from tensegrity_core.fields import METHODS
from tensegrity_core.kernel import Kernel, simulate
from tensegrity_core.model import grid, held
from tests.support.driven_scenes import AFLOAT, LABORATORY, MAST, PENDULUM, built

TIMES = grid(2.0, 0.02)


def angle(model, result):
    """Of the pendulum from the vertical, rad."""
    b = result.position[:, 1] - result.position[:, 0]
    return np.arctan2(b[:, 0], -b[:, 2])


def pendulum(times, mass, payload, pivot, start, rate=0.0, g=9.81):
    """theta of a rod of 1 m with a payload at its tip, its pivot accelerated by pivot(t) along x: an equation of its own."""
    inertia, lever = mass / 3.0 + payload, mass / 2.0 + payload

    def equation(t, y):
        return [y[1], -lever / inertia * (g * np.sin(y[0]) + pivot(t) * np.cos(y[0]))]

    solution = solve_ivp(equation, (times[0], times[-1]), [start, rate], "DOP853", times, rtol=1e-13, atol=1e-14)
    return solution.y[0]


def test_pendulum_with_a_payload():
    model = built(PENDULUM, point_masses={"n2": 0.7})
    result = simulate(model, held(model, TIMES), tolerance=1e-12)
    np.testing.assert_allclose(angle(model, result), pendulum(TIMES, 2.0, 0.7, lambda t: 0.0, np.pi / 6.0), atol=1e-10)
    assert result.ledger_error() < 1e-10


def test_reaction_at_rest_bears_bar_and_both_point_masses():
    model = built(PENDULUM, nodes={"n1": [0.0, 0.0], "n2": [0.0, -1.0]}, point_masses={"n2": 0.7, "n1": 0.5})
    kernel = Kernel(model)
    kernel.initialize()
    np.testing.assert_allclose(kernel["reaction"], [0.0, 3.2 * 9.81], atol=1e-12)
    np.testing.assert_allclose(kernel["bar_force"], (0.5 * 2.0 + 0.7) * 9.81, rtol=1e-12)  # the mean over the bar


@pytest.mark.parametrize("masses", [{}, {"n2": 0.5}, {"n1": 0.3, "n2": 1.5}])
def test_free_bar_turns_about_its_centre_of_mass(masses):
    model = built(AFLOAT, point_masses=masses)
    omega, drift, r = np.array([0.8, 0.0, -0.6]) * 3.0, np.array([0.1, -0.2, 0.05]), model.nodes
    omega -= omega @ (r[1] - r[0]) * (r[1] - r[0])  # no spin
    centre = (model.node_mass @ r) / model.node_mass.sum()
    # half of a thin bar's mass at each end has the bar's centre of mass
    model = replace(model, velocity=drift + np.cross(omega, r - centre))
    result = simulate(model, held(model, TIMES), tolerance=1e-12)
    speed = np.linalg.norm(omega)
    axis = omega / speed
    for node in range(2):
        arm = r[node] - centre
        turned = np.cos(speed * TIMES)[:, None] * arm + np.sin(speed * TIMES)[:, None] * np.cross(axis, arm)
        expected = centre + drift * TIMES[:, None] + turned
        np.testing.assert_allclose(result.position[:, node], expected, atol=1e-10)
    assert result.ledger_error() < 1e-11


def test_free_fall_under_a_gravity_vector():
    g = np.array([1.0, -2.0, -9.0])
    model = built(AFLOAT, gravity=g.tolist(), point_masses={"n2": 0.5})
    result = simulate(model, held(model, TIMES))
    expected = model.nodes + 0.5 * g * TIMES[:, None, None] ** 2
    np.testing.assert_allclose(result.position, expected, atol=1e-11)
    assert result.ledger_error() < 1e-12


def test_drag_slows_down_exponentially():
    model = built(AFLOAT, gravity=[0.0, 0.0, -9.81], drag={"n1": 2.0, "n2": 2.0})
    v0, rate = np.array([3.0, 1.0, 0.0]), 4.0  # 2 c/m
    model = replace(model, velocity=np.tile(v0, (2, 1)))
    result = simulate(model, held(model, TIMES), tolerance=1e-12)
    fall = model.g / rate
    decay = (1.0 - np.exp(-rate * TIMES))[:, None] / rate
    expected = model.nodes[1] + fall * TIMES[:, None] + (v0 - fall) * decay
    np.testing.assert_allclose(result.position[:, 1], expected, atol=1e-11)
    assert result.ledger_error() < 1e-11
    assert result.dissipated[-1] > 1.0


def moved(model, times, position, velocity):
    """Inputs of a pivot that moves along x."""
    return held(model, times, motion=lambda t: ([[position(t), 0.0, 0.0]], [[velocity(t), 0.0, 0.0]]))


def test_pivot_with_constant_acceleration():
    model = built(PENDULUM, moving=["n1"], point_masses={"n2": 0.7, "n1": 0.4})
    inputs = moved(model, TIMES, lambda t: 1.5 * t**2, lambda t: 3.0 * t)
    result = simulate(model, inputs, tolerance=1e-12)
    np.testing.assert_allclose(result.position[:, 0, 0], 1.5 * TIMES**2, atol=1e-13)
    np.testing.assert_allclose(angle(model, result), pendulum(TIMES, 2.0, 0.7, lambda t: 3.0, np.pi / 6.0), atol=1e-10)
    assert result.ledger_error() < 1e-10
    assert result.input_work[-1] > 1.0


@pytest.mark.parametrize("accelerated, order", [(True, 2), (False, 1)])
def test_shaken_pivot_converges_however_it_is_held(accelerated, order):
    """With velocities alone, their jumps give the impulses that the accelerations would have given."""
    model = built(PENDULUM, moving=["n1"])
    omega, size = 9.0, 0.05
    start = -1.5 * size * omega * np.cos(np.pi / 6.0)  # the impulse of a pivot that starts with a velocity
    ends = np.array([0.0, 1.0])
    exact = pendulum(ends, 2.0, 0.0, lambda t: -size * omega**2 * np.sin(omega * t), np.pi / 6.0, start)[-1]
    errors = []
    for step in (0.02, 0.01, 0.005):
        times = grid(1.0, step)
        inputs = moved(model, times, lambda t: size * np.sin(omega * t), lambda t: size * omega * np.cos(omega * t))
        if not accelerated:
            middle = np.diff(np.sin(omega * times))[:, None] * size / step
            velocity = inputs.node_velocity.copy()
            velocity[:, 0, :1] = middle
            inputs = replace(inputs, node_velocity=velocity, node_acceleration=0.0 * velocity)
        result = simulate(model, inputs, tolerance=1e-12)
        assert result.ledger_error() < 1e-10
        errors.append(abs(angle(model, result)[-1] - exact))
    measured = np.log2(errors[0] / errors[2]) / 2.0
    assert measured > order - 0.3 and errors[2] < (1e-4 if accelerated else 1e-2), (errors, measured)


def test_jump_of_the_pivots_velocity_is_an_impulse():
    model = built(PENDULUM, moving=["n1"], point_masses={"n2": 0.7})
    kernel = Kernel(model)
    kernel["node_velocity"][:] = [2.0, 0.0]
    kernel.initialize()
    b = model.nodes[1, [0, 2]] - model.nodes[0, [0, 2]]
    across = np.array([2.0, 0.0]) - b * (b @ [2.0, 0.0])
    expected = [2.0, 0.0] - (1.0 + 0.7) / (2.0 / 3.0 + 0.7) * across
    np.testing.assert_allclose(kernel["velocity"], expected, rtol=1e-13)
    assert kernel["input_work"] == 0.0
    before = kernel["kinetic"] + kernel["potential"]
    kernel["node_velocity"][:] = 0.0
    kernel["node_position"][:] = kernel["position"][:2]
    kernel.step(1e-9)
    gained = kernel["kinetic"] + kernel["potential"] - before
    np.testing.assert_allclose(kernel["input_work"], gained, atol=1e-9)


def test_motor_with_a_slack_string_runs_up():
    """J delta'' + d delta' = k i."""
    model = built(MAST)
    actuator = model.actuator[1]
    model = replace(model, rest_length=model.rest_length + [0.0, 1.0], gravity=0.0)
    inputs = held(model, TIMES, current=lambda t: [-0.5])
    result = simulate(model, inputs, tolerance=1e-12)
    rate, final = actuator.damping / actuator.inertia, actuator.torque_constant * -0.5 / actuator.damping
    np.testing.assert_allclose(result.motor_speed[:, 0], final * (1.0 - np.exp(-rate * TIMES)), atol=1e-10)
    turned = final * (TIMES - (1.0 - np.exp(-rate * TIMES)) / rate)
    np.testing.assert_allclose(result.wound_rest_length[:, 0], model.rest_length[1] - actuator.radius * turned, atol=1e-11)


def test_motor_pulls_a_string_between_anchors():
    """J delta'' + (d_a + r^2 d) delta' + r^2 k delta = k_a i - r T0."""
    model = built(MAST)
    k, d, a = model.stiffness[1], model.damping[1], model.actuator[1]
    ends = model.strings.copy()
    ends[1] = [2, 3]
    tension = 25.0
    model = replace(model, strings=ends, rest_length=[model.rest_length[0], 1.2 - tension / k])
    inputs = held(model, TIMES, current=lambda t: [a.radius * tension / a.torque_constant + 1.0])
    result = simulate(model, inputs, tolerance=1e-12)
    damping, stiffness = a.damping + a.radius**2 * d, a.radius**2 * k
    roots = np.roots([a.inertia, damping, stiffness])
    final = a.torque_constant * 1.0 / stiffness
    first = final * roots[1] / (roots[0] - roots[1])
    exact = (final + first * np.exp(roots[0] * TIMES) - (final + first) * np.exp(roots[1] * TIMES)).real
    wound = model.rest_length[1] - result.wound_rest_length[:, 0]
    np.testing.assert_allclose(wound, a.radius * exact, atol=1e-11)
    assert result.ledger_error() < 1e-11


def test_mast_rests_with_its_start_current():
    model = built(MAST)
    assert model.current == pytest.approx([0.05 * 25.0 / 0.4])
    result = simulate(model, held(model, TIMES))
    assert np.ptp(result.position, axis=0).max() < 1e-12


def test_string_wound_up_completely_is_refused_and_nothing_is_lost():
    model = built(MAST)
    model = replace(model, rest_length=[model.rest_length[0], 0.02], strings=[[2, 1], [2, 3]])
    kernel = Kernel(model)
    kernel["current"][:] = 2000.0
    kernel.initialize()
    with pytest.raises(SimulationError, match="wound") as failure:
        for _ in range(200):
            before = kernel.values.copy(), kernel.state, kernel.time
            kernel.step(0.01)
    assert failure.value.status == "wound_up"
    for known, kept in zip(before, (kernel.values, kernel.state, kernel.time)):
        np.testing.assert_array_equal(known, kept)
    kernel["current"][:] = 0.0
    kernel.step(1e-4)  # and it goes on


def drive(model, duration=1.0, step=0.02):
    """Inputs that use everything that the laboratory has."""
    push = np.zeros((len(model.nodes), 3))
    push[model.node_names.index("n4")] = [20.0, -10.0, 30.0]

    def shake(t):
        position = model.nodes[list(model.moving)] + 0.04 * np.sin([[7.0 * t, 11.0 * t, 5.0 * t]])
        return position, np.tile(0.04 * np.array([7.0, 11.0, 5.0]) * np.cos([7.0 * t, 11.0 * t, 5.0 * t]), (2, 1))

    moving = np.array([i in (0, 2) for i in range(len(model.strings))])
    return held(
        model,
        grid(duration, step),
        force=lambda t: push * np.sign(np.sin(9.0 * t + 0.1)),
        rest_length=lambda t: model.rest_length + 0.05 * moving * np.sin(6.0 * t),
        current=lambda t: model.current + [1.5 * np.sin(4.0 * t), -0.8],
        motion=shake,
        drum_load=lambda t: [2.0 * np.sin(8.0 * t), 1.0],
    )


@pytest.mark.parametrize("law", ["literal", "tension_only"])
def test_everything_together_keeps_its_ledger_and_lengths(law):
    model = built(LABORATORY, damping_law=law)
    result = simulate(model, drive(model), tolerance=1e-11)
    assert result.ledger_error() < 1e-9
    lengths = np.linalg.norm(result.position[:, model.bars[:, 1]] - result.position[:, model.bars[:, 0]], axis=2)
    np.testing.assert_allclose(lengths, np.tile(model.bar_length, (len(lengths), 1)), rtol=1e-13)
    assert len(result.transitions) > 3


@pytest.mark.parametrize("method", [name for name in METHODS if name not in ("auto", "dop853")])
def test_methods_agree_on_everything_together(method):
    model = built(LABORATORY)
    inputs = drive(model, 0.4)
    best = simulate(model, inputs, "dop853", 1e-12)
    fixed = method in ("rk4", "ros2")
    other = simulate(model, inputs, method, 1e-10, 2.5e-4 if fixed else 0.0)
    assert np.abs(other.position - best.position).max() < (2e-5 if method == "ros2" else 1e-7 if fixed else 1e-8)


def test_jacobian_is_the_derivative():
    model = built(LABORATORY)
    kernel = Kernel(model)
    inputs = drive(model)
    kernel["force"][:] = inputs.force[3][model.free_nodes].ravel()
    kernel["node_velocity"][:] = 0.3
    kernel["node_acceleration"][:] = -2.0
    kernel["current"][:] = 1.0
    kernel.initialize()
    first = kernel.layout["current"].start
    kernel.slopes[0, first : first + 2] = 5.0
    kernel.slopes[0, kernel.layout["node_acceleration"]] = 7.0
    kernel.step(0.05)
    y, tau, n = kernel.state, 0.013, (len(kernel.state) - 3) // 2
    Jq, Jv, ft = kernel.jacobian(y, tau)
    steps = 1e-6 * np.eye(len(y))

    def slope(step):
        return ((kernel.derivative(y + step, tau) - kernel.derivative(y - step, tau)) / 2e-6)[n : 2 * n]

    np.testing.assert_allclose(Jq, np.transpose([slope(steps[i]) for i in range(n)]), rtol=1e-5, atol=2e-3)
    np.testing.assert_allclose(Jv, np.transpose([slope(steps[n + i]) for i in range(n)]), rtol=1e-6, atol=1e-4)
    change = (kernel.derivative(y, tau + 1e-6) - kernel.derivative(y, tau - 1e-6))[n : 2 * n] / 2e-6
    np.testing.assert_allclose(ft, change, rtol=1e-6, atol=1e-3)


@pytest.mark.parametrize("method", ["dop853", "radau9", "rodas5p", "ros2"])
def test_saved_state_comes_back_to_the_last_bit(method):
    model = built(LABORATORY)
    kernel = Kernel(model, method=method)
    kernel["current"][:] = [2.0, 1.0]
    kernel["node_velocity"][:] = 0.1
    kernel.initialize()
    for _ in range(5):
        kernel.step(0.01)
    saved = kernel.save()
    ends = []
    for _ in range(2):
        kernel.restore(saved)
        for _ in range(5):
            kernel.step(0.01)
        ends.append(kernel.values.copy())
    np.testing.assert_array_equal(*ends)


def test_output_derivatives_follow_the_motion():
    model = built(LABORATORY)
    kernel = Kernel(model, method="dop853", tolerance=1e-13)
    kernel["node_velocity"][:] = 0.2
    kernel["node_acceleration"][:] = 1.0
    kernel["current"][:] = [2.0, 1.0]
    kernel.initialize()
    saved, shift = kernel.save(), 1e-5
    kernel.step(0.05)
    found = kernel.output_derivatives()
    values = []
    for end in (0.05 - shift, 0.05 + shift):
        kernel.restore(saved)
        kernel.step(end)
        values.append({name: kernel[name].copy() for name in found})
    for name in found:
        expected = (values[1][name] - values[0][name]) / (2.0 * shift)
        scale = max(1.0, np.abs(expected).max(initial=0.0))
        np.testing.assert_allclose(found[name], expected, rtol=1e-4, atol=1e-4 * scale, err_msg=name)


def test_long_calls_give_what_short_ones_give():
    """Steps pass communication points where inputs stay, with a motor running and drag."""
    model = built(LABORATORY)
    ends = []
    for count in (1, 40):
        kernel = Kernel(model, method="dop853", tolerance=1e-12)
        kernel["current"][:] = [1.5, 0.5]
        kernel.initialize()
        for _ in range(count):
            kernel.step(0.4 / count)
        ends.append(kernel["position"].copy())
    np.testing.assert_allclose(*ends, atol=1e-9)


@pytest.mark.parametrize("law", ["literal", "tension_only"])
def test_kernel_agrees_with_the_reference(law):
    model = built(LABORATORY, damping_law=law)
    inputs = drive(model, 0.4)
    expected, found = reference.simulate(model, inputs), simulate(model, inputs)
    for name in ("position", "string_length", "wound_rest_length"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-10)
    energies = ("kinetic", "potential", "elastic", "dissipated", "input_work")
    for name in ("velocity", "motor_speed", "wound_rest_length_rate", *energies):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-7, err_msg=name)
    for name in ("string_force", "elastic_force", "bar_force", "reaction"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=1e-4, err_msg=name)
    kinds = [[(t.string, t.before, t.after) for t in run.transitions] for run in (expected, found)]
    assert kinds[0] == kinds[1] and len(kinds[0]) > 3
    times = [[t.time for t in run.transitions] for run in (expected, found)]
    np.testing.assert_allclose(*times, atol=1e-8)
