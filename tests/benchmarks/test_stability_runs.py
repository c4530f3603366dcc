"""The stability studies on order, long runs and missed events: what they measure meets theory, and can fail."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.harness import page as common
from benchmarks.harness import problems
from benchmarks.peers import native, scipy_compiled
from benchmarks.stability import long_runs, missed, order
from tensegrity_core.kernel import Kernel
from tests.support import same_picture
from tests.support.figures import require_told

# --- order at transitions ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def jumping():
    return order.Case(50.0, 1.0)


@pytest.fixture(scope="module")
def bending():
    return order.Case(0.0, 0.3)


def measured_order(case, method, located):
    """Slope over the divisions and the range of errors of the study."""
    curve = order.stepped(case, method, located)
    return order.slope(curve["step"], curve["error"], max(30.0 * case.doubt, 1e-12), 3e-3 if located else 0.3)


@pytest.mark.parametrize("method", ["rk4", "ros2", "dop853", "rodas5p"])
def test_located_transitions_leave_a_method_its_order(jumping, bending, method):
    for case in (jumping, bending):
        assert measured_order(case, method, True) == pytest.approx(order.ORDERS[method], abs=0.5)


def test_located_transitions_leave_radau9_the_order_of_its_dense_output(jumping, bending):
    """6 where the reference can see it; at d = 50 errors fall faster over the steps that it can judge, but not with 9."""
    assert measured_order(bending, "radau9", True) == pytest.approx(order.LOCATED["radau9"], abs=0.5)
    assert order.LOCATED["radau9"] < measured_order(jumping, "radau9", True) < 8.5


@pytest.mark.parametrize("method", order.ORDERS)
def test_steps_of_the_order_study_are_held(bending, method):
    """By max_step alone: every interval has its steps, and one more for a transition at most."""
    divisions = order.DIVISIONS[:15]
    curve = order.stepped(bending, method, True, divisions)
    more = np.array(curve["steps"]) - order.INSTANTS * np.array(divisions)
    least = -order.INSTANTS if method in ("dop853", "rodas5p", "radau9") else 0  # steps may pass an instant
    assert (more > least).all() and (more <= bending.transitions + 4).all() and max(curve["rejected"]) == 0


#: Slopes over a jump scatter with the place of each transition in its step, repeatably.
ACROSS_A_JUMP = {"rk4": 1.05, "ros2": 1.08, "dop853": 0.63, "rodas5p": 1.11, "radau9": 0.85}


@pytest.mark.parametrize("method", ACROSS_A_JUMP)
def test_stepping_across_a_jump_leaves_order_one(jumping, method):
    assert measured_order(jumping, method, False) == pytest.approx(ACROSS_A_JUMP[method], abs=0.15)


@pytest.mark.parametrize("method", order.ORDERS)
def test_no_held_step_across_a_jump_is_accurate(jumping, method):
    assert np.nanmin(order.stepped(jumping, method, False)["error"]) > 5e-5


@pytest.mark.parametrize("method", order.ORDERS)
def test_stepping_across_a_kink_leaves_order_two(bending, method):
    assert measured_order(bending, method, False) == pytest.approx(2.0, abs=0.25)


def test_the_two_references_agree_on_the_pushed_scene(jumping):
    assert jumping.doubt < 1e-12
    assert jumping.transitions == 26


# --- long runs -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def motions():
    return {name: long_runs.motion(name) for name in long_runs.MOTIONS}


@pytest.mark.parametrize(
    "method, steps, relative", [("rk4", 20, 1e-3), ("dop853", 6, 1e-3), ("rodas5p", 10, 2e-3), ("ros2", 50, 0.1)]
)
def test_energy_decays_as_the_stability_function_says(motions, method, steps, relative):
    run = long_runs.run(motions["breathing"], long_runs.Setting(method, steps), periods=300, instants=6)
    theory = long_runs.energy_theory(method, steps, run["periods"])
    assert run["failed"] is None and theory[-1] < -1e-5
    np.testing.assert_allclose(run["energy"][-1], theory[-1], rtol=relative)


def test_rk4_loses_the_sixth_power_of_the_step():
    """|R|^2 = 1 - z^6/72 + z^8/576."""
    z = 2.0 * np.pi / 40
    expected = np.expm1(40 * 7 * np.log(1.0 - z**6 / 72.0 + z**8 / 576.0))
    assert long_runs.energy_theory("rk4", 40, 7.0) == pytest.approx(expected, rel=1e-6)


def test_motions_do_what_they_are_called(motions):
    taut = long_runs.run(motions["spinning"], long_runs.Setting("dop853", 0, 1e-10), periods=50, instants=3)
    slack = long_runs.run(motions["slack"], long_runs.Setting("dop853", 0, 1e-10), periods=50, instants=3)
    assert taut["transitions"] == 0 and slack["transitions"] > 100


@pytest.mark.parametrize("name", ["spinning", "slack"])
def test_dop853_keeps_energy_and_momentum_over_1000_periods(motions, name):
    run = long_runs.run(motions[name], long_runs.Setting("dop853", 0, 1e-10), periods=1000, instants=8)
    assert np.abs(run["energy"]).max() < 1e-7
    assert max(run["angular"]) < 1e-8


@pytest.mark.parametrize("method", ["rk4", "dop853", "radau9"])
def test_linear_momentum_is_kept_to_round_off(motions, method):
    setting = long_runs.Setting("rk4", 20) if method == "rk4" else long_runs.Setting(method, 0, 1e-6)
    run = long_runs.run(motions["slack"], setting, periods=300, instants=6)
    assert run["step_count"] > 1000
    assert max(run["linear"]) < 4.0 * np.finfo(float).eps * run["step_count"]
    assert np.abs(run["energy"][-1]) > 1e-9  # the same run's energy is not


# --- missed events -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def grazing():
    problem = missed.scaled(problems.pushed(missed.SCENE, missed.DAMPING), 1.0, missed.DURATION)
    return problem, missed.touching(problem)


@pytest.fixture(scope="module")
def grazes(grazing):
    problem, factor = grazing
    return [missed.graze(problem, factor * (1.0 + excess)) for excess in np.geomspace(1e-8, 1e-1, 22)]


@pytest.mark.parametrize("method", missed.OURS)
def test_a_graze_is_found_once_or_where_the_tolerance_hides_it_not_at_all(grazes, method):
    """Never oftener: positions and velocities that agree within the tolerance only once made it go slack thousands of times."""
    for case in grazes:
        for tolerance in missed.TOLERANCES:
            found = missed.run_ours(case.problem, method, tolerance).transitions
            assert found == 2 or (found == 0 and case.depth <= tolerance), (case.depth, tolerance, found)


def excursion(case):
    """When the string goes slack and taut, s."""
    kernel = Kernel(case.problem.model, method="dop853", tolerance=1e-13)
    kernel["force"][:] = case.problem.kernel_force
    kernel.initialize()
    kernel.step(case.problem.duration)
    return [event.time for event in kernel.transitions]


def test_scipys_events_miss_what_ours_find_where_the_excursion_fits_into_a_step(grazes, tools, tmp_path):
    """RK45 at 1e-8: what is missed lies within one step, h, so it is less deep than a h^2/8; ours finds all of it."""
    tolerance, missing, finding = 1e-8, [], []
    for number, case in enumerate(case for case in grazes if case.depth > 1e-8):
        bench = native.Bench(case.problem, tools, tmp_path / str(number))
        compiled = scipy_compiled.Compiled(bench, native.DIRECTED)
        found = missed.run_scipy(compiled, "RK45", tolerance, case.problem.duration).transitions
        assert all(missed.run_ours(case.problem, method, tolerance).transitions == 2 for method in missed.OURS)
        if found == 2:
            finding.append(case.depth)
            continue
        compiled.begin(missed.LIMIT)
        settings = {"method": "RK45", "rtol": tolerance, "atol": tolerance, "events": compiled.events()}
        run = solve_ivp(compiled.rhs, (0.0, case.problem.duration), compiled.start, **settings)
        out, back = excursion(case)
        step = np.searchsorted(run.t, out)
        assert (found, run.status) == (0, 0) and step == np.searchsorted(run.t, back)
        assert case.depth < case.curvature * (run.t[step] - run.t[step - 1]) ** 2 / 8.0
        missing.append(case.depth)
    assert missing and finding and max(missing) < min(finding)
    assert max(missing) > 3.0 * tolerance  # not for want of accuracy


def test_some_of_those_grazes_are_shorter_than_a_step(grazing):
    problem, factor = grazing
    case = missed.graze(problem, factor * (1.0 + 1e-3))
    found = missed.run_ours(case.problem, "dop853", 1e-7)
    assert case.seconds < 0.5 * missed.DURATION / found.steps
    assert found.transitions == 2


def test_below_the_touching_push_nothing_happens(grazing):
    problem, factor = grazing
    with pytest.raises(ValueError, match="no single graze: 0 transitions"):
        missed.graze(problem, factor * (1.0 - 1e-6))


# --- the data can be measured again ---------------------------------------------------------------------------------


def stored(name):
    return {"order": order, "long_runs": long_runs, "missed": missed}[name].STUDY.stored()


@pytest.mark.parametrize("method", ["rk4", "ros2"])
def test_the_orders_data_can_be_measured_again(jumping, method):
    kept = next(
        curve
        for curve in stored("order")["cases"][0]["curves"]
        if (curve["method"], curve["located"], curve["by"]) == (method, True, "step")
    )
    again = order.stepped(jumping, method, True, order.DIVISIONS[10:14])
    assert again["step"] == pytest.approx(kept["step"][10:14], rel=1e-5)
    assert again["error"] == pytest.approx(kept["error"][10:14], rel=1e-3)


def test_the_long_runs_data_can_be_measured_again(motions):
    kept = stored("long_runs")["motions"]["breathing"]
    assert motions["breathing"].omega == pytest.approx(kept["omega"], rel=1e-5)
    old = next(run for run in kept["runs"] if (run["method"], run["steps"]) == ("rk4", 20))
    k = int(np.searchsorted(old["periods"], 100.0))
    again = long_runs.run(motions["breathing"], long_runs.Setting("rk4", 20), periods=old["periods"][k], instants=2)
    assert again["energy"][-1] == pytest.approx(old["energy"][k], rel=1e-4)


def test_the_missed_events_data_can_be_measured_again(grazing):
    problem, factor = grazing
    kept = stored("missed")["grazes"]
    for number in (12, 30):
        case = missed.graze(problem, factor * (1.0 + missed.EXCESS[number]))
        assert case.depth == pytest.approx(kept["depth"][number], rel=1e-3)
        for method in missed.OURS:
            for k in (6, 12, 18):
                found = missed.run_ours(case.problem, method, missed.TOLERANCES[k]).transitions
                assert found == kept["found"][f"ours {method}"][number][k]


# --- the page ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name, study", [("order", order), ("long_runs", long_runs), ("missed", missed)])
def test_the_section_comes_from_the_stored_data(name, study, tmp_path, monkeypatch):
    data = stored(name)
    require_told(monkeypatch, common)
    study.STUDY.write(data, tmp_path)
    assert study.STUDY.section(data).strip() in (tmp_path / "stability.md").read_text(encoding="utf-8")
    assert study.STUDY.section(data).strip() in (common.DOCS / "stability.md").read_text(encoding="utf-8")
    same_picture(tmp_path / "figures" / f"stability_{name}.png", common.DOCS / "figures" / f"stability_{name}.png")
