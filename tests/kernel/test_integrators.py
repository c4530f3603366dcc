"""How the methods are driven: steps past communication points, the automatic choice, fixed steps of bounded cost."""

import dataclasses

import numpy as np
import pytest

from tensegrity_core.errors import InputError, SimulationError
from tensegrity_core.fields import METHODS
from tensegrity_core.kernel import Kernel
from tensegrity_core.scene.towers import tower
from tensegrity_core.statics import build_model
from tests.support import changed, push, scene


def pushed(model, force=None, **options) -> Kernel:
    """A kernel at the start of the asymmetric push."""
    kernel = Kernel(model, **options)
    force = push(model) if force is None else force
    kernel["force"][:] = force[np.ix_(model.free_nodes, model.axes)].ravel()
    kernel.initialize()
    return kernel


def advance(kernel, count, h) -> np.ndarray:
    rows = []
    for _ in range(count):
        kernel.step(h)
        rows.append(kernel["position"].copy())
    return np.array(rows)


# --- steps past communication points -------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["auto", "dop853", "radau9"])
@pytest.mark.parametrize("name, damping", [("three_bar", 50), ("three_bar_nsh", 500), ("two_bar", 5000)])
def test_communication_points_do_not_disturb_the_integration_while_inputs_stay(method, name, damping):
    model = changed(scene(name), damping)
    one, many = (pushed(model, method=method, tolerance=1e-8) for _ in range(2))
    one.step(1.0)
    advance(many, 500, 0.002)
    assert many.stats["transitions"] == one.stats["transitions"]
    exact = damping < 5000 and method != "auto"
    if exact:
        assert many.stats["steps"] == one.stats["steps"]
    elif method == "auto":  # it looks at communication points before it tries a method whose steps end there
        assert many.stats["steps"] <= 1.5 * one.stats["steps"]
    else:  # where stability limits explicit steps, their control amplifies round-off up to the tolerance
        assert abs(many.stats["steps"] - one.stats["steps"]) <= 0.05 * one.stats["steps"]
    assert method == "dop853" or many.stats["steps"] < 500
    np.testing.assert_allclose(many["position"], one["position"], rtol=0, atol=1e-11 if exact else 1e-8)
    # each of the two runs may err by the tolerance, in each of the two strings that pull at a bar
    np.testing.assert_allclose(many["reaction"], one["reaction"], rtol=0, atol=(2e-8 if exact else 4e-8) * (100 + damping))


@pytest.mark.parametrize("method", ["auto", "dop853", "radau9"])
def test_outputs_between_the_ends_of_steps_are_as_good_as_the_tolerance(method):
    model = changed(scene("three_bar"), 500)
    exact = advance(pushed(model, method="dop853", tolerance=1e-13), 97, 0.01)
    for tolerance in (1e-5, 1e-7, 1e-9):
        found = advance(pushed(model, method=method, tolerance=tolerance), 97, 0.01)
        assert np.abs(found - exact).max() < 10 * tolerance


@pytest.mark.parametrize("method", ["auto", "dop853", "radau9"])
def test_an_input_that_changes_within_an_open_step_takes_effect_at_the_communication_point(method):
    """The same inputs with and without steps that pass communication points (a largest step forbids them)."""
    model = changed(scene("three_bar"), 50)
    rows = []
    for options in ({}, {"max_step": 0.003}):
        kernel = pushed(model, method=method, tolerance=1e-11, **options)
        positions = []
        for n in range(60):
            if n % 7 == 0:
                kernel["force"][2] = 45.0 - n
            kernel.step(0.003)
            positions.append(kernel["position"].copy())
        rows.append(np.array(positions))
    assert np.abs(rows[0] - rows[1]).max() < 1e-9


@pytest.mark.parametrize("method", ["auto", "dop853", "radau9", "rodas5p"])
def test_a_state_saved_within_an_open_step_is_complete(method):
    model = changed(scene("three_bar_nsh"), 500)
    kernel = pushed(model, method=method, tolerance=1e-7)
    advance(kernel, 37, 0.001)
    state, other = kernel.save(), Kernel(model, method=method, tolerance=1e-7)
    first = advance(kernel, 200, 0.001)
    other.restore(state)
    np.testing.assert_array_equal(advance(other, 200, 0.001), first)
    kernel.restore(state)
    np.testing.assert_array_equal(advance(kernel, 200, 0.001), first)


@pytest.mark.parametrize("method", ["auto", "dop853", "radau9"])
def test_a_failed_step_leaves_the_open_step_as_it_was(method):
    model = changed(scene("three_bar"), 50)
    calm, shaken = (pushed(model, method=method, tolerance=1e-8) for _ in range(2))
    advance(calm, 11, 0.001)
    advance(shaken, 11, 0.001)
    force = shaken["force"].copy()
    for bad, error in ((np.nan, InputError), (1e308, SimulationError)):
        shaken["force"][:] = bad
        with pytest.raises(error):
            shaken.step(0.001)
    shaken["force"][:] = force
    np.testing.assert_array_equal(advance(shaken, 300, 0.001), advance(calm, 300, 0.001))


# --- the automatic choice ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10])
def test_auto_stays_explicit_where_nothing_is_stiff(tolerance):
    kernel = pushed(changed(scene("three_bar"), 20), tolerance=tolerance)
    kernel.step(2.0)
    assert kernel.stats["implicit_steps"] <= 0.1 * kernel.stats["steps"]


@pytest.mark.parametrize("name", ["two_bar", "three_bar", "three_bar_nsh", "six_bar"])
def test_auto_takes_few_steps_where_everything_is_stiff(name):
    model = changed(scene(name), 5000)
    auto, explicit = (pushed(model, method=m, tolerance=1e-7) for m in ("auto", "dop853"))
    auto.step(1.0)
    explicit.step(1.0)
    assert auto.stats["implicit_steps"] > 5
    assert auto.stats["rhs"] < 0.1 * explicit.stats["rhs"]
    np.testing.assert_allclose(auto["position"], explicit["position"], rtol=0, atol=1e-6)


def test_auto_returns_when_the_stiffness_is_gone():
    model = changed(scene("three_bar"), 5000)
    kernel = pushed(model, tolerance=1e-8)
    kernel.step(0.1)
    stiff = kernel.stats
    kernel["damping"][:] = 5.0
    kernel.step(0.9)
    calm = {name: kernel.stats[name] - stiff[name] for name in stiff}
    assert stiff["implicit_steps"] > 3
    assert calm["implicit_steps"] < 0.15 * calm["steps"]


# --- fixed steps ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["rk4", "ros2"])
@pytest.mark.parametrize(
    "max_step, h, count", [(1e-3, 0.01, 10), (1e-3, 0.0105, 11), (3e-3, 0.01, 4), (0.0, 0.01, 10), (1.0, 0.01, 1)]
)
def test_fixed_steps_divide_the_communication_step_evenly(method, max_step, h, count):
    model = changed(scene("three_bar"), 10)
    kernel = pushed(model, force=push(model, 1.0, 0.0), method=method, max_step=max_step)
    kernel.step(h)
    assert kernel.stats["transitions"] == 0 and kernel.stats["rejected"] == 0
    assert kernel.stats["steps"] == count


def test_an_unstable_fixed_step_is_named():
    kernel = pushed(changed(scene("six_bar"), 5000), method="rk4", max_step=1e-3)
    with pytest.raises(SimulationError, match="unstable.*shorter"):
        advance(kernel, 1000, 0.01)
    assert np.isfinite(kernel.values).all()


@pytest.mark.parametrize("damping", [0, 50, 1e5])
@pytest.mark.parametrize("stiffness", [5e3, 1e7])
def test_ros2_has_a_bounded_cost_and_stays_stable(damping, stiffness):
    """Every step of 1 ms costs at most five of each part, whatever the strings do, and energy does not grow."""
    model = changed(scene("three_bar"), damping)
    model = dataclasses.replace(model, stiffness=np.full(6, float(stiffness)))
    kernel, rhs = pushed(model, method="ros2", max_step=1e-3), 0
    highest = []
    for _n in range(2000):
        before = kernel.stats
        kernel.step(1e-3)
        spent = {name: kernel.stats[name] - before[name] for name in before}
        assert spent["steps"] <= 5 and spent["factorisations"] == spent["steps"] and spent["rejected"] == 0
        rhs = max(rhs, spent["rhs"])
        highest.append(kernel["kinetic"][0])
    assert rhs <= 24
    assert max(highest) < 100.0 and max(highest[1500:]) < 45.0  # the push can do 3 x 45 N x 0.85 m


@pytest.mark.parametrize("name", ["two_bar", "three_bar_nsh", "six_bar_nsh"])
def test_ros2_converges_to_the_same_motion(name):
    model = changed(scene(name), 500)
    exact = advance(pushed(model, method="dop853", tolerance=1e-11), 20, 0.01)
    errors = [
        np.abs(advance(pushed(model, method="ros2", max_step=h), 20, 0.01) - exact).max() for h in (1e-3, 2.5e-4, 6.25e-5)
    ]
    assert errors[2] < 0.2 * errors[1] < 0.06 * errors[0] < 1e-3


# --- only what the scene needs --------------------------------------------------------------------------------------


def test_memory_grows_with_the_number_of_bars():
    small, large = (Kernel(build_model(tower(n))) for n in (20, 80))
    assert small.memory_size < 2e6
    assert 3.0 < large.memory_size / small.memory_size < 4.4


def test_without_location_the_same_tolerance_gives_a_worse_answer():
    model = changed(scene("three_bar"), 50)
    exact = advance(pushed(model, method="dop853", tolerance=1e-12), 20, 0.05)
    errors = {}
    for located in (True, False):
        kernel = pushed(model, method="rk4", max_step=1e-3)
        kernel.locate_transitions(located)
        errors[located] = np.abs(advance(kernel, 20, 0.05) - exact).max()
        assert (kernel.stats["transitions"] > 0) == located
    assert errors[True] < 1e-6 < 1e-5 < errors[False]


def test_every_method_runs_every_scene():
    for name in ("two_bar", "two_bar_nsh", "three_bar", "three_bar_nsh", "six_bar", "six_bar_nsh"):
        model = scene(name)
        ends = []
        for method in METHODS:
            kernel = pushed(model, method=method, tolerance=1e-8, max_step=1e-4 if method in ("rk4", "ros2") else 0.0)
            kernel.step(0.1)
            ends.append(kernel["position"].copy())
        assert np.ptp(np.array(ends), axis=0).max() < 2e-5, name
