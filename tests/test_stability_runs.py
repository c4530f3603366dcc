"""The stability studies on order, long runs and missed events: what they measure meets theory, and can fail."""

import json
import sys
import xml.dom.minidom
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "benchmarks" / "stability"))

import common  # noqa: E402
import long_runs  # noqa: E402
import missed  # noqa: E402
import order  # noqa: E402
import problems  # noqa: E402

DIVISIONS = (48, 68, 96, 136, 192, 272)


# --- order at transitions ------------------------------------------------------------------------------------------

@pytest.fixture(scope="module")
def jumping():
    return order.Case(50.0, 1.0)


def measured_order(case, method, located, divisions=DIVISIONS):
    curve = order.stepped(case, method, located, divisions)
    return order.slope(curve["step"], curve["error"], floor=1e-12, roof=1e-1)


@pytest.mark.parametrize("method, least", [("rk4", 3.5), ("ros2", 1.7), ("rodas5p", 4.3)])
def test_located_transitions_leave_a_method_its_order(jumping, method, least):
    assert measured_order(jumping, method, True) > least


@pytest.mark.parametrize("method", ["rk4", "ros2", "rodas5p", "dop853"])
def test_stepping_across_a_jump_leaves_order_one(jumping, method):
    assert 0.3 < measured_order(jumping, method, False, order.DIVISIONS) < 1.5


def test_stepping_across_a_kink_leaves_order_two():
    case = order.Case(0.0, 0.3)
    assert 1.6 < measured_order(case, "rk4", False, order.DIVISIONS) < 2.5
    assert measured_order(case, "rk4", True) > 3.5


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


@pytest.mark.parametrize("method", missed.OURS)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_a_graze_deeper_than_the_tolerance_is_found(grazing, method, tolerance):
    problem, factor = grazing
    for excess in np.geomspace(1e-6, 1e-1, 11):
        case = missed.graze(problem, factor * (1.0 + excess))
        if case.depth > tolerance:
            assert missed.run_ours(case.problem, method, tolerance).transitions == 2, (excess, case.depth)


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


# --- the page ------------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("name, study", [("order", order), ("long_runs", long_runs), ("missed", missed)])
def test_the_section_comes_from_the_stored_data(name, study, tmp_path):
    stored = common.DOCS / "figures" / f"stability_{name}.json"
    data = json.loads(stored.read_text(encoding="utf-8"))
    common.write(name, data, study.draw, study.section, tmp_path)
    assert study.section(data).strip() in (tmp_path / "stability.md").read_text(encoding="utf-8")
    pages = [common.DOCS / "stability.md"]
    assert any(study.section(data).strip() in page.read_text(encoding="utf-8") for page in pages if page.is_file())
    drawn = (tmp_path / "figures" / f"stability_{name}.svg").read_text(encoding="utf-8")
    xml.dom.minidom.parseString(drawn)
    assert drawn == stored.with_suffix(".svg").read_text(encoding="utf-8")
