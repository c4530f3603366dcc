"""The stability studies: what they measure meets the theory that they draw, and the page says what the data say."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.harness import page as common
from benchmarks.stability import all as every
from benchmarks.stability import (
    branch_two,
    drift,
    extremes,
    fixed_cost,
    formulations,
    maps,
    methods,
    one_beam,
    pushed_run,
    spectrum,
)
from tensegrity_core.errors import InputError
from tensegrity_core.laws import beam as law
from tensegrity_core.reference import equations, instant, structure
from tensegrity_core.scene import parse_scene
from tensegrity_core.statics import build_model
from tests.support import changed, push, same_picture, scene
from tests.support.figures import require_told

ROOT = Path(__file__).resolve().parents[2]
STUDIES = {"drift": drift, "maps": maps, "branch_two": branch_two, "fixed_cost": fixed_cost, "extremes": extremes}


# --- drift of the bars' lengths ------------------------------------------------------------------------------------


def moving_state(model, seed=1):
    """Random N, Ndot (3, n) on the bars' constraints, fixed nodes at rest."""
    random = np.random.default_rng(seed)
    s = structure.Structure(model)
    free = ~model.fixed
    N = model.nodes.T + 0.01 * random.normal(size=(3, len(free))) * free
    return instant.on_constraints(s, N, random.normal(size=(3, len(free))) * free)


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("form", formulations.FORMS)
def test_all_formulations_are_the_same_physics_where_the_lengths_are_right(form, exact):
    model = scene("three_bar")
    force = push(model)
    N, Ndot = moving_state(model)
    p = formulations.problem(model, force)
    load = instant.Load(0.0, force.T, model.rest_length, np.zeros(len(model.strings)))
    stretch = equations.string_motion(N, Ndot, p.s.C_s)[1] - model.rest_length
    mode = instant.mode_of(p.s, (stretch > 0.0).astype(int), np.zeros(len(stretch), dtype=bool))
    assert 0 < mode.taut.sum() < len(stretch)  # some are slack
    expected = instant.motion_at(p.s, load, mode, 0.0, N, Ndot).Nddot
    acceleration, _ = formulations.FORMS[form](p, N, Ndot, exact)
    np.testing.assert_allclose(acceleration, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


@pytest.mark.parametrize("exact", [True, False])
@pytest.mark.parametrize("form", formulations.FORMS)
def test_second_derivative_of_the_error_is_the_one_the_theory_states(form, exact):
    """e'' = 2 |b'|^2 + 2 b . b'' is rate^2 e with the nominal length, and 0 with |b|^2; away from the constraint."""
    model = scene("three_bar")
    p = formulations.problem(model, push(model))
    N, Ndot = moving_state(model, 2)
    N = N * np.where(model.fixed, 1.0, 1.003)
    B, Bdot = N @ p.s.C_b.T, Ndot @ p.s.C_b.T
    acceleration, rate2 = formulations.FORMS[form](p, N, Ndot, exact)
    dot = equations.diagonal
    second = 2.0 * dot(Bdot, Bdot) + 2.0 * dot(B, acceleration @ p.s.C_b.T)
    e = dot(B, B) - model.bar_length**2
    assert np.abs(e).min() > 1e-4
    expected = np.zeros_like(e) if exact else rate2 * e
    np.testing.assert_allclose(second, expected, rtol=0, atol=1e-10 * np.abs(rate2).max())
    np.testing.assert_allclose(acceleration[:, model.fixed], 0.0, atol=1e-9 * np.abs(acceleration).max())


@pytest.mark.parametrize("form, factor", [("matrix", 24.0), ("pinned", 6.0)])
def test_drift_grows_at_the_constraint_modes_eigenvalue(form, factor):
    model = changed(scene("three_bar"), damping=50.0)  # not stiff, so that it is quick
    P = -reference_bar_force(model)
    expected = np.sqrt(factor * P / (model.bar_mass * model.bar_length)).max()
    assert expected == pytest.approx({"matrix": 13.4, "pinned": 6.7}[form], rel=2e-3)
    motion = formulations.Motion(formulations.problem(model), form, False)
    history = drift.integrate(motion, motion.start(1e-11), 5.0, "tight")
    assert drift.measured_rate(history) == pytest.approx(expected, rel=0.01)
    assert drift.time_to(history, 1e-3) == pytest.approx(np.arccosh(1e-3 / 1e-11) / expected, rel=0.01)


def reference_bar_force(model):
    """(B,) N from the article's lambda at the start; compression is negative."""
    s = structure.Structure(model)
    N, Ndot = model.nodes.T, np.zeros_like(model.nodes.T)
    load = instant.Load(0.0, np.zeros_like(N), model.rest_length, np.zeros(len(model.strings)))
    taut = instant.mode_of(s, np.ones(len(model.strings), dtype=int), np.zeros(len(model.strings), dtype=bool))
    return -instant.motion_at(s, load, taut, 0.0, N, Ndot).lam * model.bar_length


def test_drift_of_a_compressed_mast_over_two_decades():
    for row in drift.against_compression((4.0, 60.0, 500.0)):
        assert row["rate"] == pytest.approx(row["theory_rate"], rel=0.01)
        assert row["time_to"][0] == pytest.approx(row["theory_time_to"][0], rel=0.01)
    assert row["theory_rate"] > 50.0


def test_in_tension_the_error_oscillates():
    for row in drift.tension(periods=2.0):
        assert row["omega"] == pytest.approx(row["theory_omega"], rel=1e-3)
        factor = {"matrix": 24.0, "pinned": 6.0}[row["form"]]
        assert row["theory_omega"] == pytest.approx(np.sqrt(factor * (20.0 + 9.81 / 2.0)), rel=1e-12)
        assert 0.95 < np.abs(row["error"]).max() < 1.001 and np.min(row["error"]) < -0.8


def test_with_the_exact_projector_the_drift_is_linear():
    found = drift.linear_drift(duration=2.0, error=1e-9, error_rate=1e-8)
    assert found["error"][-1] == pytest.approx(2.1e-8, rel=1e-4)
    assert found["deviation"] < 1e-12


def test_projection_keeps_the_lengths_of_a_run_that_is_lost_without_it():
    model = scene("three_bar")
    projected, _ = drift.run_variant(model, "projected", 0.8, push(model))
    without, _ = drift.run_variant(model, "matrix_ode45", 0.8, push(model))
    assert projected["end_time"] == 0.8 and projected["largest"] <= 1e-14
    assert without["time_to"][0] < 0.7


def test_theory_along_a_motion_predicts_when_the_pushed_run_fails():
    model = scene("three_bar")
    p = formulations.problem(model, push(model))
    along, printed = formulations.Motion(p, "matrix", True, with_theory=True), formulations.Motion(p, "matrix", False)
    exact = drift.integrate(along, along.start(1e-6), 0.6, "tight", project=True)
    lost = drift.integrate(printed, printed.start(1e-6), 0.6, "tight")
    expected = drift.History(exact.times, exact.theory["matrix"], {})
    assert drift.time_to(lost, 1e-3) == pytest.approx(drift.time_to(expected, 1e-3), rel=0.02)
    at_rest = np.arccosh(1e-3 / 1e-6) / drift.rate_of(model, "matrix").real
    assert abs(drift.time_to(lost, 1e-3) / at_rest - 1.0) > 0.05  # the push matters, and the theory has it


def test_formulations_name_what_they_cannot_do():
    with pytest.raises(InputError, match="'s1' has an NSH"):
        formulations.problem(scene("three_bar_nsh"))
    with pytest.raises(InputError, match="not fixed at one end"):
        formulations.Motion(formulations.problem(scene("six_bar")), "pinned", False)


# --- fixed-step methods and the linearised spectrum -----------------------------------------------------------------


@pytest.mark.parametrize("name", [name for name, method in methods.METHODS.items() if method.step])
def test_a_step_has_the_stability_function_that_is_drawn(name):
    method = methods.METHODS[name]
    A = np.array([[-0.7, 2.0], [-1.5, -0.4]])
    h = 0.3
    step = np.array([method.step(lambda y: A @ y, lambda y: A, y, h) for y in np.eye(2)]).T
    expected = method.stability(h * np.linalg.eigvals(A))
    np.testing.assert_allclose(np.sort_complex(np.linalg.eigvals(step)), np.sort_complex(expected), rtol=0, atol=1e-13)


@pytest.mark.parametrize("name, order", [("euler", 1), ("rk4", 4), ("ros2", 2), ("ros2_large", 2)])
def test_stability_functions_have_their_methods_order(name, order):
    def error(z):
        return abs(methods.METHODS[name].stability(z) - np.exp(z))

    z = 0.02 if order == 4 else 1e-3  # above round-off, below the next order
    assert np.log2(error(-2.0 * z) / error(-z)) == pytest.approx(order + 1, abs=0.05)


@pytest.mark.parametrize("name", [name for name, method in methods.METHODS.items() if method.implicit])
def test_implicit_methods_are_l_stable(name):
    R = methods.METHODS[name].stability
    y = 1j * np.geomspace(1e-3, 1e6, 500)
    assert np.abs(R(y)).max() <= 1.0 + 1e-12  # and no pole in the left half plane: A-stable
    assert abs(R(-1e12)) < 1e-11
    assert methods.boundary(R, np.array([-1.0, -1e5, -3 + 400j, -3 - 400j])) == np.inf


def test_boundaries_that_are_known():
    R = {name: method.stability for name, method in methods.METHODS.items()}
    assert methods.boundary(R["rk4"], np.array([-4.0, -1.0])) == pytest.approx(2.785293563405282 / 4.0, rel=1e-12)
    assert methods.boundary(R["rk4"], np.array([-1e-12 + 5j])) == pytest.approx(np.sqrt(8.0) / 5.0, rel=1e-6)
    assert methods.boundary(R["euler"], np.array([-2.0 + 30j, -2.0 - 30j])) == pytest.approx(2 * 2.0 / 904.0, rel=1e-9)
    with pytest.raises(ValueError, match="equilibrium itself is unstable"):
        methods.boundary(R["rk4"], np.array([-1.0, 0.2]))


def test_spectrum_of_an_upright_mast_by_hand():
    """m/3 x'' + 2 d c^2 x' + (2 k c^2 + 2 T s^2/L - (2 T s + m g/2)/l) x = 0; c, s: of the guys' angle to the ground."""
    k, d, T, length = 4000.0, 30.0, 25.0, 1.5
    cable = {"stiffness": k, "damping": d}
    model = build_model(
        parse_scene(
            {
                "name": "mast",
                "plane": "xz",
                "fixed": ["foot", "left", "right"],
                "nodes": {"foot": [0.0, 0.0], "tip": [0.0, length], "left": [-1.1, 0.0], "right": [1.1, 0.0]},
                "bars": {"mast": {"nodes": ["foot", "tip"], "mass": 2.0}},
                "strings": {"guy1": {"nodes": ["left", "tip"], **cable}, "guy2": {"nodes": ["right", "tip"], **cable}},
                "prestress": {"tension": {"guy1": T}},
            }
        )
    )
    L = np.hypot(1.1, length)
    c, s = 1.1 / L, length / L
    stiffness = 2.0 * k * c * c + 2.0 * T * s * s / L - (2.0 * T * s + 9.81) / length
    expected = np.roots([2.0 / 3.0, 2.0 * d * c * c, stiffness])
    np.testing.assert_allclose(np.sort_complex(spectrum.eigenvalues(model)), np.sort_complex(expected), rtol=1e-9)


def test_retuned_models_stand_where_the_scene_does():
    model = scene("two_bar")
    retuned = spectrum.retuned(model, damping=7.0, stiffness=1e3)
    s = structure.Structure(retuned)
    slack = instant.Load(0.0, np.zeros((3, 4)), retuned.rest_length, np.zeros(3))
    taut = instant.mode_of(s, np.ones(3, dtype=int), np.zeros(3, dtype=bool))
    motion = instant.motion_at(s, slack, taut, 0.0, retuned.nodes.T, np.zeros((3, 4)))
    np.testing.assert_allclose(motion.Nddot, 0.0, atol=1e-10)
    assert (retuned.stiffness == 1e3).all() and (retuned.damping == 7.0).all()
    with pytest.raises(InputError, match="stiffness = 1.0"):
        spectrum.retuned(model, stiffness=1.0)
    with pytest.raises(InputError, match="NSH"):
        spectrum.retuned(scene("two_bar_nsh"), damping=1.0)


@pytest.mark.parametrize("name", maps.SCENES)
@pytest.mark.parametrize(
    "parameter, value",
    [
        ("damping", 1.0),
        ("damping", 50.0),
        ("damping", 1e3),
        ("damping", 1e5),
        ("stiffness", 1e2),
        ("stiffness", 1e7),
    ],
)
def test_rk4_loses_the_equilibrium_where_the_spectrum_says(name, parameter, value):
    model = maps.at(scene(name), parameter, value)
    expected = methods.boundary(methods.METHODS["rk4"].stability, spectrum.eigenvalues(model))
    assert maps.largest_stable_step(model, "rk4", (0.5 * expected, 2.0 * expected)) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("parameter, value", [("damping", 1.0), ("damping", 1e5), ("stiffness", 1e2), ("stiffness", 1e7)])
def test_ros2_holds_the_equilibrium_everywhere(parameter, value):
    model = maps.at(scene("three_bar"), parameter, value)
    for h in (1e-4, 1e-3, 1e-1):
        assert maps.is_stable(model, "ros2", h, steps=400)


def test_a_run_is_long_enough_to_show_a_growth_at_every_step_of_the_maps():
    for h in np.geomspace(*maps.STEPS, 21):
        steps = maps.steps_given(h)
        assert steps >= maps.RUN and steps * h >= maps.SPAN
    model = maps.at(scene("three_bar"), "damping", 1e5)
    edge = methods.boundary(methods.METHODS["rk4"].stability, spectrum.eigenvalues(model))
    assert maps.is_stable(model, "rk4", 0.995 * edge) and not maps.is_stable(model, "rk4", 1.005 * edge)


def test_far_beyond_its_boundary_a_step_ends_in_an_answer():
    """Not in a crash, so it runs in a process of its own; the map's corner at d = 1e4, 45 times the stable step."""
    code = (
        "from benchmarks.stability import maps\n"
        "model = maps.at(maps.built_in('three_bar'), 'damping', 1e4)\n"
        "print([maps.is_stable(model, 'rk4', h) for h in (3.1622776601683794e-3, 0.1)])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout.strip()) == (0, "[False, False]"), done.stderr[-2000:]


# --- the fixed-cost method on pushed scenes -------------------------------------------------------------------------


def largest_factor(method: str, kept: float, true: float, damping: float) -> float:
    """Of a step of 1 s on u'' = -true u - damping u', with `kept` as the stiffness in the Jacobian."""
    A, J = np.array([[0.0, 1.0], [-true, -damping]]), np.array([[0.0, 1.0], [-kept, -damping]])
    step = [methods.METHODS[method].step(lambda y: A @ y, lambda y: J, y, 1.0) for y in np.eye(2)]
    return np.abs(np.linalg.eigvals(np.array(step).T)).max()


@pytest.mark.parametrize("method", ["ros2", "ros2_large"])
def test_ros2_is_stable_with_any_jacobian_that_keeps_enough_stiffness(method):
    span = np.geomspace(1e-4, 1e4, 9)  # h^2 k and h d
    for kept in span:
        for part in (1e-6, 0.01, 0.2, 0.5, 0.9, 1.0):
            for damping in (0.0, *span):
                assert largest_factor(method, kept, part * kept, damping) <= 1.0 + 1e-12
    assert largest_factor("ros2", 1.0, 100.0, 0.0) > 2.0  # too little stiffness: lost


def test_an_exact_motion_gains_no_energy_and_an_unstable_one_does():
    model = spectrum.retuned(scene("six_bar"), 50.0, 1e6)
    exact = pushed_run.run(model, "dop853", 0.3, 60, tolerance=1e-10)
    assert exact.status == "finished" and exact.stats["transitions"] > 20
    assert (exact.energy - exact.energy[0]).max() < 1e-9 * exact.kinetic.max()
    lost = pushed_run.run(spectrum.retuned(model, 500.0, 5e3), "rk4", 0.3, 300, max_step=1e-3)
    assert (lost.energy - lost.energy[0]).max() > exact.kinetic.max()


@pytest.mark.parametrize(
    "name, damping, stiffness",
    [
        *((name, d, k) for name in ("three_bar", "two_bar") for d in (0.0, 500.0, 1e5) for k in (1e2, 1e5, 1e7)),
        *(("six_bar", d, k) for d in (0.0, 500.0, 1e5) for k in (1e2, 1e6)),
        ("six_bar", 5e3, 1e7),
    ],
)
def test_ros2_at_1_ms_gains_no_energy_to_speak_of(name, damping, stiffness):
    row = fixed_cost.energies(name, damping, stiffness, duration=1.0)
    assert row["bounded"], row


@pytest.mark.parametrize("damping", [0.0, 50.0, 500.0])
def test_ros2_at_1_ms_is_bounded_in_the_stiffest_corner_too(damping):
    assert fixed_cost.energies("six_bar", damping, 1e7, duration=1.0)["bounded"]


@pytest.mark.parametrize("damping", fixed_cost.ERROR_DAMPING)
def test_ros2_has_order_two_across_transitions(damping):
    k = float(scene("three_bar").stiffness[0])
    reference, known = fixed_cost.references(damping, k)
    steps = [step for step in fixed_cost.ERROR_STEPS if step <= 1e-3]  # single steps scatter with the transitions' phase
    errors = [fixed_cost.error(reference, damping, k, step) for step in steps]
    assert reference.stats["transitions"] >= 8 and known < 1e-3 * min(errors)
    assert 1.85 < fixed_cost.order(steps, errors) < 2.5


# --- extreme parameters ----------------------------------------------------------------------------------------------

#: Cases whose fastest motion rk4's step of 1 ms does not hold.
TOO_FAST_FOR_RK4 = {"d = 1e5", "k x 1000", "k x 1000, rest", "light bars", "six light bars"}


@pytest.mark.parametrize("name", extremes.EXTREMES)
def test_extremes_finish_or_stop_with_a_named_error(name):
    adaptive = ("auto", "rodas5p", "radau9") if "light" in name else ("auto", "dop853", "rodas5p", "radau9")
    found = extremes.outcomes(name, (*adaptive, "rk4", "ros2"), duration=0.25)
    rows = {row["method"]: row for row in found["rows"]}
    assert found["reference"] == ["finished", "finished"] and found["known"] < 1e-7
    for method in adaptive:
        assert rows[method]["status"] == "finished" and rows[method]["error"] < 1e-5, rows[method]
        assert rows[method]["ledger"] < 1e-7, rows[method]
        assert rows[method]["transitions"] == pytest.approx(found["transitions"], abs=2)
    # Strings a thousand times as stiff oscillate within a step of ros2: it stays within the structure's size, no more.
    assert rows["ros2"]["status"] == "finished" and rows["ros2"]["error"] < (1.0 if "k x 1000" in name else 0.2)
    assert rows["rk4"]["status"] == ("unstable" if name in TOO_FAST_FOR_RK4 else "finished")
    assert name in TOO_FAST_FOR_RK4 or rows["rk4"]["error"] < 1e-3


def test_rk4s_energy_outputs_mean_nothing_where_a_transient_is_shorter_than_a_step():
    coarse, fine = (extremes.trial(extremes.EXTREMES["as it is"], "rk4", step=step) for step in (1e-3, 1e-4))
    assert coarse.ledger > 0.1 and fine.ledger < 1e-4
    assert pushed_run.deviation(coarse, fine) < 3e-4


def test_strings_at_their_rest_lengths_carry_nothing_at_the_start():
    kept = {}

    class Watched(pushed_run.Kernel):
        def step(self, h):
            kept.setdefault("gap", self["string_length"] - self["rest_length"])
            kept.setdefault("elastic", self["elastic_force"].copy())
            super().step(h)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pushed_run, "Kernel", Watched)
        extremes.trial(extremes.EXTREMES["all at rest length"], "auto", duration=0.05)
    assert (kept["gap"] == 0.0).all() and (kept["elastic"] == 0.0).all() and len(kept["gap"]) == 6


# --- branch II -------------------------------------------------------------------------------------------------------


def test_growth_under_a_dead_load():
    for row in branch_two.dead_load_growth(masses=(0.3, 30.0), deltas=(0.0, 1.0, 100.0)):
        kappa = 12.0 * (6.0 - 2.0) / 0.01
        d, m = row["damping"], row["mass"]
        expected = (-d + np.sqrt(d * d + 4.0 * m * kappa)) / (2.0 * m) * np.sqrt(m / kappa)
        assert row["rate"] == pytest.approx(expected, rel=1e-3)
        assert row["theory"] == pytest.approx(expected, rel=1e-9)


def test_branch_two_is_stable_only_behind_a_string_stiffer_than_kappa():
    rows = branch_two.winding_growth(ratios=(0.5, 0.95, 1.05, 2.0))
    for row in rows:
        roots = np.roots([1.0, row["delta"], row["ratio"] - 1.0])
        assert row["rate"] == pytest.approx(roots.real.max(), rel=0.01)
    assert [row["rate"] > 0.0 for row in rows] == [True, True, False, False]


def test_snap_times_lie_between_the_limits_of_no_damping_and_no_mass():
    for row in branch_two.snap_times(masses=(3.0,), deltas=(0.0, 1.0, 100.0)):
        assert row["time"] == pytest.approx(row["theory"], rel=1e-4)
    assert row["theory"] == pytest.approx(100.0 * one_beam.snap_time_overdamped(0.05), rel=1e-3)
    assert one_beam.snap_time(0.0, 1e-4) == pytest.approx(one_beam.snap_time_undamped(1e-4), rel=1e-6)
    # next to the fold: half of pi d / sqrt(|f''| (F - f_max) / 2), and the rest does not matter
    tiny = 1e-9 * one_beam.EDGE.f_max
    fold = 0.5 * np.pi * one_beam.KAPPA / np.sqrt(0.5 * -one_beam.BEND * tiny)
    assert one_beam.snap_time_overdamped(1e-9) == pytest.approx(fold, rel=1e-3)


def test_a_slow_winder_traverses_branch_two_or_snaps():
    stiff, soft = branch_two.winding(2.0, duration=20.0, steps=2000), branch_two.winding(0.5, duration=20.0, steps=2000)
    assert stiff["off_curve"] < 0.1 and stiff["fastest"] < 3.0 * stiff["winding_rate"]
    assert soft["off_curve"] > 5.0 and soft["fastest"] > 50.0 * soft["winding_rate"]
    leaves, load, lands, after = soft["jump"]
    slope = law.beam_stiffness(12.0, 6.0, 0.01, leaves)
    assert slope == pytest.approx(-0.5 * one_beam.KAPPA, rel=1e-12)
    assert (after - load) / (lands - leaves) == pytest.approx(slope, rel=1e-9)
    assert float(one_beam.force(lands)) == pytest.approx(after)


@pytest.mark.parametrize("method, order", [("rk4", 4), ("ros2", 2)])
def test_the_snap_converges_at_the_methods_order(method, order):
    snap = branch_two.snap(1.0)
    coarse, fine = (branch_two.step_error(snap, method, step)["landing"] for step in (0.2, 0.05))
    assert np.log(coarse / fine) / np.log(4.0) == pytest.approx(order, abs=0.5)


def test_with_strong_damping_stability_bounds_rk4s_step_before_accuracy_does():
    step, edge = branch_two.resolving_step("rk4", 10.0), branch_two.edge_of_rk4(10.0)
    assert step == pytest.approx(edge, rel=0.1)
    assert branch_two.step_error(branch_two.snap(10.0), "rk4", 0.8 * edge)["error"] < 1e-4
    assert branch_two.resolving_step("rk4", 0.0) > 10.0 * step


def plain_steps(c, method, h, steps):
    """u (m) over the snap of a case by the steps of `methods`, on the scalar equation."""

    def stiffness(u):
        return float(law.beam_stiffness(one_beam.Q, one_beam.ZETA, one_beam.H, u)) if u <= 2.0 * one_beam.H else one_beam.STOP

    def f(y):
        return np.array([y[1], (c.load - float(one_beam.force(y[0])) - c.damping * y[1]) / c.mass])

    def jacobian(y):
        return branch_two.damping_part(stiffness(y[0]) / c.mass, c.damping / c.mass)

    states = [np.array([one_beam.EDGE.u_max, 0.0])]
    for _ in range(steps):
        states.append(methods.METHODS[method].step(f, jacobian, states[-1], h))
    return np.array(states)[:, 0]


@pytest.mark.parametrize("method", branch_two.STEPPED)
def test_the_kernels_fixed_step_is_the_methods(method):
    c = branch_two.snap(1.0).c
    own = branch_two.stepped(c, method, 0.004, 0.12).u
    assert own[-1] > one_beam.H
    np.testing.assert_allclose(own, plain_steps(c, method, 0.004, len(own) - 1), rtol=0, atol=1e-8)


@pytest.mark.parametrize("delta", [0.0, 1.0, 10.0])
def test_the_error_of_rk4s_growth_rate_follows_from_its_stability_function(delta):
    z = 0.02  # the damped root stays within the region of stability, and the step's eigenvalues exact to round-off
    expected = np.log(methods.METHODS["rk4"].stability(z)) / z
    assert 1.0 - expected == pytest.approx(z**4 / 120.0, rel=0.05)
    assert branch_two.stepped_growth("rk4", delta, z) == pytest.approx(expected, rel=1e-12)


def test_errors_of_the_snaps_time_follow_the_error_of_the_growth_rate():
    """Not equal, the snap is more than exponential growth; the same power of the step and the same size."""
    for method in branch_two.STEPPED:
        snap = branch_two.snap(1.0)
        for step in (0.1, 0.4):
            theory = abs(branch_two.stepped_growth(method, 1.0, step) - 1.0)
            assert 0.1 < branch_two.step_error(snap, method, step)["error"] / theory < 3.0


def test_the_scene_is_the_scalar_problem():
    c = one_beam.case(2.0, 0.5, load=30.0)
    kernel = spectrum.kernel_at(one_beam.model_at(c, 0.004))
    u = np.linspace(0.0, 0.021, 15)
    np.testing.assert_allclose([kernel.string_law(0, x)[0] for x in u], one_beam.force(u), rtol=0, atol=1e-12)
    path = one_beam.run(c, 0.004, 1e-3, 1)
    expected = (30.0 - float(one_beam.force(0.004))) / 2.0 * 1e-3
    assert path.rate[-1] == pytest.approx(expected, rel=0.02)


# --- page and figures ------------------------------------------------------------------------------------------------


def stored(name):
    return STUDIES[name].STUDY.stored()


def row_of(rows, **wanted):
    """The row of stored data whose values are nearly the wanted ones."""
    return next(row for row in rows if all(row[key] == pytest.approx(value, rel=1e-5) for key, value in wanted.items()))


def test_one_command_runs_every_study():
    folder = Path(every.__file__).parent
    written = {path.stem for path in folder.glob("*.py") if "def measure(" in path.read_text(encoding="utf-8")}
    assert written == set(every.STUDIES)
    page = (ROOT / "docs" / "stability.md").read_text(encoding="utf-8")
    places = [page.index(f"<!-- {name}: written by") for name in every.STUDIES]
    assert places == sorted(places)


def test_branch_twos_data_can_be_measured_again():
    data = stored("branch_two")
    again, *_ = branch_two.dead_load_growth(masses=(0.3,), deltas=(1.0,))
    assert again["rate"] == pytest.approx(row_of(data["growth"], mass=0.3, delta=1.0)["rate"], rel=1e-5)
    step = branch_two.STEPS[-2]
    kept = row_of([row for row in data["errors"] if row["method"] == "rk4"], delta=1.0, step=step)
    assert branch_two.step_error(branch_two.snap(1.0), "rk4", step)["error"] == pytest.approx(kept["error"], rel=1e-3)


def test_drifts_data_can_be_measured_again():
    kept = stored("drift")["compression"]
    again = drift.against_compression((float(np.geomspace(4.0, 500.0, 10)[5]),))
    for row in again:
        old = row_of([old for old in kept if old["form"] == row["form"]], compression=row["compression"])
        assert row["time_to"] == pytest.approx(old["time_to"], rel=1e-4)


@pytest.mark.parametrize("number", range(4))
def test_the_maps_data_can_be_measured_again(number):
    one = stored("maps")["maps"][number]
    kept = one["methods"]["rk4"]["largest"][4]
    model = maps.at(scene(one["scene"]), one["parameter"], kept["value"])
    edge = methods.boundary(methods.METHODS["rk4"].stability, spectrum.eigenvalues(model))
    assert edge == pytest.approx(kept["theory"], rel=1e-5)
    again = maps.largest_stable_step(model, "rk4", (0.9 * kept["step"], 1.1 * kept["step"]))
    assert again == pytest.approx(kept["step"], rel=2.0 * (maps.RESOLUTION - 1.0))


def test_fixed_costs_data_can_be_measured_again():
    data, k = stored("fixed_cost"), float(scene("three_bar").stiffness[0])
    kept = row_of(data["over_step"], damping=500.0)
    reference, _ = fixed_cost.references(500.0, k)
    errors = [fixed_cost.error(reference, 500.0, k, step) for step in kept["steps"][4:8]]
    assert errors == pytest.approx(kept["errors"][4:8], rel=1e-3)
    again = fixed_cost.energies("two_bar", 500.0, 1e5)
    old = row_of(next(one for one in data["maps"] if one["scene"] == "two_bar")["rows"], damping=500.0, stiffness=1e5)
    assert (again["bounded"], again["transitions"]) == (old["bounded"], old["transitions"])
    assert again["exact"] == pytest.approx(old["exact"], rel=1e-5)


def test_the_extremes_data_can_be_measured_again():
    kept = next(case for case in stored("extremes")["cases"] if case["case"] == "as it is")
    again = {row["method"]: row for row in extremes.outcomes("as it is")["rows"]}
    for old in kept["rows"]:
        new = again[old["method"]]
        assert (new["status"], new["transitions"]) == (old["status"], old["transitions"])
        if old["method"] in extremes.FIXED:
            assert new["error"] == pytest.approx(old["error"], rel=1e-3)
        else:  # a compiler's last bits may change a step that is accepted narrowly
            assert 0.1 * old["error"] < new["error"] < 10.0 * old["error"]
            assert new["steps"] == pytest.approx(old["steps"], rel=0.05)


@pytest.mark.parametrize("name", STUDIES)
def test_the_page_says_what_the_data_say(name, tmp_path):
    page = ROOT / "docs" / "stability.md"
    copy = tmp_path / "stability.md"
    copy.write_text(page.read_text(encoding="utf-8"), encoding="utf-8")
    common.write_section(copy, name, STUDIES[name].STUDY.section(stored(name)))
    assert copy.read_text(encoding="utf-8") == page.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", STUDIES)
def test_figures_are_drawn_from_the_data(name, tmp_path, monkeypatch):
    """And tell nothing by colours alone."""
    require_told(monkeypatch, common)
    STUDIES[name].STUDY.write(stored(name), tmp_path)
    same_picture(tmp_path / "figures" / f"stability_{name}.png", common.DOCS / "figures" / f"stability_{name}.png")


def test_equal_data_give_equal_bytes(tmp_path):
    written = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        extremes.STUDY.write(stored("extremes"), folder)
        written.append((folder / "figures" / "stability_extremes.png").read_bytes())
    assert written[0] == written[1]


def test_a_section_replaces_its_own_and_no_other(tmp_path):
    page = tmp_path / "stability.md"
    common.write_section(page, "one", "## One\n\nfirst")
    common.write_section(page, "two", "## Two")
    common.write_section(page, "one", "## One\n\nsecond")
    text = page.read_text(encoding="utf-8")
    assert text.startswith("# Stability") and text.count("## One") == text.count("## Two") == 1
    assert "second" in text and "first" not in text and text.index("## One") < text.index("## Two")


def test_numbers_for_json():
    value = common.plain({"a": np.array([1.23456789, np.nan]), "b": (np.float64(2.0), np.int64(3), True, None)})
    assert value == {"a": [1.234568, None], "b": [2.0, 3, True, None]}
    assert np.isnan(common.numbers([1.0, None])[1])
