"""Inputs with derivatives: forces and rest lengths that move within a step; and the derivatives of outputs."""

import numpy as np
import pytest

from tensegrity_core.errors import InputError
from tensegrity_core.fields import FIELDS
from tensegrity_core.kernel import Kernel
from tests.support import by_hand, changed, push, scene

ADAPTIVE = ("auto", "dop853", "rodas5p", "radau9", "dopri5")
OUTPUTS = [field.name for field in FIELDS if field.role == "output"]


def started(model, method="auto", tolerance=1e-11, **defaults):
    kernel = Kernel(model, method=method, tolerance=tolerance, **defaults)
    kernel.initialize()
    return kernel


def derivatives(kernel, order, **fields):
    """Write derivatives of inputs of an order, 1 or 2, by field."""
    for name, values in fields.items():
        kernel.slopes[order - 1][kernel.layout[name]] = values


def polynomial(value, slope, bend, t):
    return value + slope * t + 0.5 * bend * t**2


def energy(kernel):
    """What stays constant, J."""
    gains = ("kinetic", "potential", "elastic", "dissipated")
    return sum(kernel[name][0] for name in gains) - kernel["input_work"][0]


def ledger_error(kernel, start):
    return abs(energy(kernel) - start) / max(1.0, kernel["throughput"][0])


def free_bar():
    nodes = [[0.0, 0.0, -0.5], [0.0, 0.0, 0.5], [9.0, 0.0, 0.0], [9.0, 0.0, 1.0]]
    return by_hand(nodes, [2, 3], [(0, 1)], [(2, 3)], bar_mass=2.0, stiffness=10.0, rest_length=2.0)


@pytest.mark.parametrize("method", [*ADAPTIVE, "rk4", "ros2"])
def test_a_bar_under_a_force_that_moves_follows_its_polynomial(method):
    """Equal forces F(t) on both ends of a free bar: r'' = 2 F/m, a polynomial of degree 4."""
    kernel, t = started(free_bar(), method, max_step=0.05 if method in ("rk4", "ros2") else 0.0), 0.7
    value, slope, bend = np.array([1.0, -2.0, 0.5]), np.array([3.0, 1.0, -4.0]), np.array([-5.0, 2.0, 6.0])
    kernel["force"][:] = np.tile(value, 2)
    derivatives(kernel, 1, force=np.tile(slope, 2))
    derivatives(kernel, 2, force=np.tile(bend, 2))
    before = energy(kernel)
    kernel.step(t)
    centre = kernel["position"].reshape(-1, 3)[:2].mean(axis=0)
    velocity = kernel["velocity"].reshape(-1, 3)[0]
    order_2 = method == "ros2"  # third derivatives are beyond it: h^2 of them
    exact = value * t**2 / 2 + slope * t**3 / 6 + bend * t**4 / 24
    np.testing.assert_allclose(centre, exact, atol=2e-3 if order_2 else 1e-13)
    np.testing.assert_allclose(velocity, value * t + slope * t**2 / 2 + bend * t**3 / 6, atol=5e-3 if order_2 else 1e-12)
    room = {"ros2": 1e-2, "rk4": 1e-7, "dopri5": 1e-10}  # the power is of degree 5, one more than dopri5 integrates exactly
    assert ledger_error(kernel, before) < room.get(method, 1e-12)


def cubic(value, slope, bend, jerk, t):
    return polynomial(value, slope, bend, t) + jerk * t**3 / 6.0


def rest_length_run(method, pieces, h=0.2, steps=3, by_rate=False):
    """three_bar with top strings whose rest lengths bend: the moving input itself, or `pieces` ramps per step.  by_rate: the
    derivatives are those of the rate, up to the second."""
    model = changed(scene("three_bar_nsh"), damping=50.0)
    kernel, top = started(model, method), slice(3, 6)
    before = energy(kernel)
    slope, bend, jerk = np.array([0.1, -0.2, 0.15]), np.array([-1.5, 2.0, 1.0]), np.array([2.0, -3.0, 1.0]) * by_rate
    start = kernel["rest_length"][top].copy()
    for k in range(steps):
        for n in range(pieces or 1):
            a, b = (h * (k + n / (pieces or 1)), h * (k + (n + 1) / (pieces or 1)))
            kernel["rest_length"][top] = cubic(start, slope, bend, jerk, a)
            rate = polynomial(slope, bend, jerk, a)
            if pieces:
                kernel["rest_length_rate"][top] = (cubic(start, slope, bend, jerk, b) - kernel["rest_length"][top]) / (b - a)
            elif by_rate:
                kernel["rest_length_rate"][top] = rate
                derivatives(kernel, 1, rest_length_rate=np.r_[np.zeros(3), bend + jerk * a])
                derivatives(kernel, 2, rest_length_rate=np.r_[np.zeros(3), jerk])
            else:
                derivatives(kernel, 1, rest_length=np.r_[np.zeros(3), rate])
                derivatives(kernel, 2, rest_length=np.r_[np.zeros(3), bend])
            kernel.step(b - a)
    return kernel, before


@pytest.mark.parametrize("by_rate", [False, True])
@pytest.mark.parametrize("method", ADAPTIVE)
def test_bending_rest_lengths_are_the_limit_of_many_ramps(method, by_rate):
    """Ramps approach the parabola, or the cubic, with the square of their length."""
    smooth, before = rest_length_run(method, 0, by_rate=by_rate)
    gaps = [np.abs(rest_length_run(method, n, by_rate=by_rate)[0]["position"] - smooth["position"]).max() for n in (50, 100)]
    assert gaps[1] < 2e-6 and 3.8 < gaps[0] / gaps[1] < 4.2
    assert ledger_error(smooth, before) < 1e-9
    assert smooth.stats["transitions"] >= 4


@pytest.mark.parametrize("method", ADAPTIVE)
def test_a_derivative_of_a_rest_length_stands_for_its_rate(method):
    model, found = scene("three_bar"), []
    for by_rate in (True, False):
        kernel = started(model, method)
        for _ in range(5):
            if by_rate:
                kernel["rest_length_rate"][:] = -0.02
            else:
                derivatives(kernel, 1, rest_length=-0.02)
            kernel.step(0.05)
            kernel["rest_length"][:] -= 0.02 * 0.05
        found.append(kernel.values[kernel.layout["position"].start :].copy())
    np.testing.assert_allclose(found[1], found[0], rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("method", ADAPTIVE)
def test_a_force_that_moves_is_the_limit_of_many_steps(method):
    model = changed(scene("three_bar"), damping=500.0)
    force = push(model)[model.free_nodes].ravel()

    def run(pieces):
        kernel = started(model, method)
        before = energy(kernel)
        for n in range(pieces):
            t = 0.4 * n / pieces
            if pieces == 1:
                derivatives(kernel, 1, force=force)
                derivatives(kernel, 2, force=3.0 * force)
            else:  # the midpoint's value: second order
                kernel["force"][:] = polynomial(0.0, force, 3.0 * force, t + 0.2 / pieces)
            kernel.step(0.4 / pieces)
        return kernel, before

    smooth, before = run(1)
    gaps = [np.abs(run(n)[0]["position"] - smooth["position"]).max() for n in (100, 200)]
    assert gaps[1] < 1e-5 and 3.8 < gaps[0] / gaps[1] < 4.2
    assert ledger_error(smooth, before) < 1e-9


def test_time_derivative_in_the_jacobian():
    model = changed(scene("three_bar_nsh"), damping=70.0)
    kernel = started(model)
    random = np.random.default_rng(3)
    kernel.slopes[:] = random.normal(size=kernel.slopes.shape)
    tau, shift, y = 0.01, 1e-6, kernel.state
    _, _, ft = kernel.jacobian(y, tau)
    n = len(ft)
    later, earlier = kernel.derivative(y, tau + shift), kernel.derivative(y, tau - shift)
    np.testing.assert_allclose(ft, (later - earlier)[n : 2 * n] / (2 * shift), rtol=1e-6, atol=1e-5)


def test_input_derivatives_belong_to_the_state():
    model = scene("three_bar_nsh")
    kernel, other = started(model), started(model)
    derivatives(kernel, 1, force=10.0)
    kernel.step(0.01)
    state = kernel.save()
    kernel.step(0.01)
    other.restore(state)
    other.step(0.01)
    np.testing.assert_array_equal(other.values, kernel.values)


def test_bad_derivatives_are_refused_and_change_nothing():
    kernel = started(scene("two_bar"))
    before = kernel.values.copy()
    derivatives(kernel, 1, force=np.nan)
    with pytest.raises(InputError, match="derivative"):
        kernel.step(0.01)
    derivatives(kernel, 1, force=0.0)
    derivatives(kernel, 1, rest_length=-300.0)  # negative on the way, positive at the end
    derivatives(kernel, 2, rest_length=60000.0)
    with pytest.raises(InputError, match="negative"):
        kernel.step(0.1)
    np.testing.assert_array_equal(kernel.values, before)
    kernel.slopes[:] = 0.0
    kernel.step(0.01)


# Derivatives of outputs


@pytest.mark.parametrize("law", ["literal", "tension_only"])
@pytest.mark.parametrize("slope", [0.0, -1.0])
@pytest.mark.parametrize("name", ["two_bar_nsh", "three_bar", "six_bar_nsh"])
def test_output_derivatives_are_those_of_the_motion(name, slope, law):
    """Against central differences over a step back and forth in time: two runs that end a little earlier and later."""
    model, shift, t = changed(scene(name), damping_law=law), 1e-5, 0.053
    force = push(model)[np.ix_(model.free_nodes, model.axes)].ravel()
    kernel = started(model, tolerance=1e-13)
    kernel["force"][:] = force
    derivatives(kernel, 1, force=slope * force)
    start = kernel.save()
    ends = {}
    for end in (t - shift, t, t + shift):
        kernel.restore(start)
        kernel.step(end)
        ends[end] = {name: kernel[name].copy() for name in OUTPUTS}
        if end == t:
            found = kernel.output_derivatives()
            for field in OUTPUTS:
                np.testing.assert_array_equal(kernel[field], ends[t][field])
    early, late = ends[t - shift], ends[t + shift]
    for field in OUTPUTS:
        expected = (late[field] - early[field]) / (2.0 * shift)
        scale = max(1.0, np.abs(expected).max(initial=0.0))
        np.testing.assert_allclose(found[field], expected, rtol=1e-4, atol=1e-4 * scale, err_msg=field)


def test_output_derivatives_do_not_disturb_the_run():
    model = scene("three_bar_nsh")
    kernels = started(model), started(model)
    for k in range(30):
        for kernel in kernels:
            kernel["force"][2] = 40.0 if k < 15 else 10.0
            kernel.step(0.01)
        kernels[1].output_derivatives()
    np.testing.assert_array_equal(kernels[0].values, kernels[1].values)


def test_output_derivatives_are_of_the_last_step_whatever_is_set_since():
    kernel = started(scene("three_bar"))
    kernel["force"][2] = 30.0
    kernel.step(0.02)
    before = kernel.output_derivatives()
    kernel["force"][2] = -500.0
    kernel.slopes[:] = 7.0
    after = kernel.output_derivatives()
    for field in OUTPUTS:
        np.testing.assert_array_equal(after[field], before[field])


def test_output_derivatives_need_a_start():
    with pytest.raises(InputError, match="initialize"):
        Kernel(scene("two_bar")).output_derivatives()


def test_output_derivatives_where_a_string_is_clipped():
    """tension_only: what a spring gives while its damper outweighs it is dissipated at once."""
    model = changed(scene("three_bar"), damping_law="tension_only", damping=500.0)
    kernel, shift = started(model, tolerance=1e-12), 1e-5
    kernel["force"][:] = push(model)[model.free_nodes].ravel()
    kernel.step(0.15)
    kernel["force"][:] = -kernel["force"]
    seen = 0
    for _ in range(60):
        kernel.step(0.002)
        state = kernel.save()
        clipped = (kernel["string_force"] == 0.0) & (kernel["string_length"] > model.rest_length + 1e-6)
        found, before = kernel.output_derivatives(), {name: kernel[name].copy() for name in OUTPUTS}
        kernel.step(shift)
        if kernel.transition_count == 0 and clipped.any():
            seen += 1
            for name in ("dissipated", "throughput", "input_work", "elastic"):
                expected = (kernel[name] - before[name]) / shift
                np.testing.assert_allclose(
                    found[name], expected, rtol=2e-2, atol=1e-3 * np.abs(expected).max() + 1e-2, err_msg=name
                )
        kernel.restore(state)
    assert seen > 5
