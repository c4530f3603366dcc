"""The article's experiments: what they compute against closed forms, what the command writes against what they compute, and
the pages of docs that come from them."""

from __future__ import annotations

import csv
import functools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm

from benchmarks.article import claims, claims_page, measures, variants
from benchmarks.article import experiments as article_page
from benchmarks.harness.page import rendered
from tensegrity_core import cli, kernel, statics
from tensegrity_core.article import experiments, one_dimensional
from tensegrity_core.article.figures import FIGURES
from tensegrity_core.errors import InputError
from tensegrity_core.kernel import peaks
from tensegrity_core.laws import law
from tensegrity_core.model import grid, held
from tensegrity_core.reference import equations
from tests.support.driven_scenes import LABORATORY, built

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"

# --- closed forms ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [0.0, 50.0, 500.0])
def test_linear_oscillator_follows_its_exponential(damping):
    """x'' = (F - d x' - k x)/m under a square wave, by the matrix exponential of each step."""
    mass, stiffness = 1.0, 5000.0
    times = np.linspace(0.0, 0.4, 81)
    force = np.where(np.arange(80) % 40 < 20, 100.0, -30.0)
    found = one_dimensional.simulate(one_dimensional.Oscillator(mass, stiffness, damping), times, force)
    step = expm(np.array([[0.0, 1.0, 0.0], [-stiffness, -damping, 1.0], [0.0, 0.0, 0.0]]) * 0.005 / mass)
    state, power = np.zeros(3), []
    for k, f in enumerate(force):
        state = step @ [state[0], state[1], f]
        assert found.position[k + 1] == pytest.approx(state[0], abs=1e-11)
        assert found.velocity[k + 1] == pytest.approx(state[1], abs=1e-8)
        power.append(state[1] * f)
    assert found.power[1:] == pytest.approx(power, abs=1e-6)


@pytest.mark.parametrize(("stiffness", "damping"), [(5000.0, 500.0), (15000.0, 500.0), (5000.0, 50.0), (5000.0, 0.0)])
def test_largest_power_is_that_of_the_motion(stiffness, damping):
    """Of a linear oscillator of 1 kg under a step of 100 N: v = F (exp(r t) - exp(s t)) / (r - s), with the roots r and s of
    r^2 + d r + k = 0, is largest where r exp(r t) = s exp(s t); and x there where v is zero, or F/k where it creeps."""
    r, s = np.roots([1.0, damping, stiffness]).astype(complex)
    t = np.log(s / r) / (r - s)
    speed = 100.0 * (np.exp(r * t) - np.exp(s * t)) / (r - s)
    found = experiments.experiment_4(duration=0.4, damping=damping, stiffness=stiffness).runs["plain"]
    assert found.largest_power == pytest.approx(100.0 * speed.real, rel=1e-9)
    assert found.power.max() < found.largest_power
    overshoot = np.exp(-0.5 * np.pi * damping / r.imag) if r.imag else 0.0
    reached = 1.0 + overshoot if r.imag else 1.0
    assert found.largest_position == pytest.approx(100.0 / stiffness * reached, rel=1e-9 if r.imag else 0.02)


def test_largest_power_may_stand_right_behind_a_jump_of_the_force():
    """100 N, then 120 N from when the mass has passed 120 N / k and slows down under either."""
    w = np.sqrt(5000.0)
    times = np.array([0.0, 1.9 / w, 2.4 / w])
    run = one_dimensional.simulate(one_dimensional.Oscillator(1.0, 5000.0, 0.0), times, np.array([100.0, 120.0]))
    assert run.largest_power == pytest.approx(120.0 * 100.0 / w * np.sin(1.9), rel=1e-9)
    assert run.power.max() < 0.95 * run.largest_power


def test_what_is_stored_and_dissipated_was_absorbed():
    data = experiments.experiment_4(duration=2.0)
    for name, run in data.runs.items():
        times = np.linspace(0.0, 2.0, len(run.times))
        lost = np.trapezoid(experiments.DAMPING * run.velocity**2, times)
        assert data.stored(name) + lost == pytest.approx(run.absorbed[-1], rel=2e-3)
        assert sum(data.per_period(name)) == pytest.approx(run.absorbed[-1])


# --- peaks -------------------------------------------------------------------------------------------------------


def test_peaks_are_those_of_a_run_with_many_points():
    model = experiments.system("three_bar")
    model = replace(model, damping=np.full(len(model.strings), 50.0))
    coarse = experiments.wave_inputs(model, duration=0.3)
    many = peaks.refined(coarse, peaks.divided(coarse.times, 1000, np.arange(30)))
    tight = kernel.simulate(model, many).elastic_force
    found = peaks.largest(model, coarse, lambda result: result.elastic_force)
    np.testing.assert_allclose(found, tight.max(axis=0), rtol=1e-6)
    sampled = kernel.simulate(model, coarse).elastic_force.max(axis=0)
    assert np.all(found >= sampled * (1.0 - 1e-9)) and np.any(found > 1.001 * sampled)


def test_refined_inputs_are_the_same_inputs():
    """Rest lengths that move by straight lines between communication points go on doing so."""
    model = experiments.system("two_bar")
    coarse = experiments.sine_inputs(model, duration=2.3)
    fine = peaks.refined(coarse, peaks.divided(coarse.times, 4, np.arange(190, 230)))
    runs = [kernel.simulate(model, inputs) for inputs in (coarse, fine)]
    rows = np.searchsorted(fine.times, coarse.times)
    assert np.array_equal(fine.times[rows], coarse.times) and len(fine.times) == 231 + 3 * 40
    np.testing.assert_allclose(runs[1].position[rows], runs[0].position, atol=1e-9)


def test_refined_inputs_move_nodes_as_the_same_inputs_do():
    model = built(LABORATORY)
    home, count = model.nodes[list(model.moving)], len(model.moving)

    def motion(t):
        shape = np.zeros((count, 3))
        shape[:, model.axes[0]] = 0.01
        return home + shape * np.sin(6.0 * t), 6.0 * shape * np.cos(6.0 * t)

    coarse = held(model, grid(0.5, 0.05), motion=motion)
    fine = peaks.refined(coarse, peaks.divided(coarse.times, 4, np.arange(10)))
    runs = [kernel.simulate(model, inputs) for inputs in (coarse, fine)]
    assert count and np.ptp(runs[0].position[:, model.moving], axis=0).max() > 1e-3
    np.testing.assert_allclose(runs[1].position[::4], runs[0].position, atol=1e-9)


def test_nsh_oscillator_conserves_energy():
    """Without damping the work of the force is in mass and honeycomb, through all pieces and back, pushed as well as pulled."""
    honeycomb, stiffness = experiments.article_nsh(), 5000.0
    times = np.linspace(0.0, 1.2, 121)
    force = np.where(np.arange(120) < 60, 60.0, -60.0)
    run = one_dimensional.simulate(one_dimensional.Oscillator(1.0, stiffness, 0.0, honeycomb.element), times, force)
    made = law(honeycomb.element, stiffness)
    stored = 0.5 * run.velocity**2 + np.array([made.energy(abs(x)) for x in run.position.tolist()])
    assert run.position.max() > 0.09 and run.position.min() < -0.09
    assert stored == pytest.approx(run.absorbed, abs=1e-7)


def test_nsh_oscillator_comes_to_rest_on_its_curve():
    honeycomb = experiments.article_nsh()
    times = np.linspace(0.0, 30.0, 4)
    run = one_dimensional.simulate(one_dimensional.Oscillator(1.0, 5000.0, 500.0, honeycomb.element), times, np.full(3, 16.0))
    assert law(honeycomb.element, 5000.0).force(run.position[-1]) == pytest.approx(16.0, abs=1e-9)


def test_absorbed_energy_is_the_area_under_the_power():
    data = experiments.experiment_4(duration=1.0)
    for run in data.runs.values():
        assert run.absorbed[-1] == pytest.approx(np.trapezoid(run.power, run.times), rel=0.02)
    assert data.runs["plain"].position[199] == pytest.approx(100.0 / 5000.0, rel=0.01)  # at rest before the force ends


def test_figure_3_has_the_extrema_of_equation_14():
    curve = experiments.beam_curve()
    s = np.sqrt(3.0 / 15.0)
    assert curve.marks["f_max"] == pytest.approx((0.015 * (1.0 - s), 12.0 * (1.0 + s)))
    assert curve.marks["f_min"] == pytest.approx((0.015 * (1.0 + s), 12.0 * (1.0 - s)))
    assert curve.marks["f_end"] == pytest.approx((0.03, 24.0))
    rising = np.diff(curve.force) > 0.0
    turns = 0.5 * (curve.elongation[1:] + curve.elongation[:-1])[:-1][rising[1:] != rising[:-1]]
    assert turns == pytest.approx([curve.marks["f_max"][0], curve.marks["f_min"][0]], abs=5e-5)


def test_figure_5_marks_every_beam():
    curve = experiments.honeycomb_curve()
    assert [f for _, f in curve.marks.values()] == pytest.approx([13.3333, 20.3546, 28.9443, 39.0849, 48.0], abs=1e-4)
    assert curve.marks["end"][0] == pytest.approx(0.09)
    assert curve.force.max() == pytest.approx(48.0)


# --- I: heights --------------------------------------------------------------------------------------------------


def test_steady_heights_balance_the_lift():
    """Of the two-bar system: moments about the feet of its mirror halves give the vertical string's force."""
    model = experiments.system("two_bar_nsh")
    run = experiments.steady_heights(model, [10.0, 40.0, 72.0], duration=20.0)
    assert run.height.shape == (3, 2) and run.snapped.shape == (3, 2) and run.elastic_force.shape == (3, 3)
    assert run.speed.max() < 1e-6 and run.nodes == ("n3", "n4")
    assert run.height[:, 0] == pytest.approx(run.height[:, 1], abs=1e-9)
    for lift, (z, _), (vertical, _, top) in zip(run.force, run.height, run.elastic_force):
        reach = np.sqrt(model.bar_length[0] ** 2 - z**2)  # of n3 from n1, along x
        out = 1.0 - reach  # of n4 from n1
        along = np.array([out, -z]) / np.hypot(out, z)  # of the string n3-n2 at n3: to n2
        force = np.array([vertical * along[0] - top, vertical * along[1] + lift])
        moment = reach * force[1] - z * force[0] - 0.5 * reach * 9.81
        assert moment == pytest.approx(0.0, abs=1e-6)


def test_snaps_are_counted_between_lifts():
    run = experiments.steady_heights(experiments.system("two_bar_nsh"), [18.0, 24.0, 26.0, 60.0], duration=10.0)
    assert run.snaps() == [(18.0, 24.0, 1), (26.0, 60.0, 3)]
    plain = experiments.steady_heights(experiments.system("two_bar"), [18.0, 60.0], duration=5.0)
    assert plain.snaps() == [] and plain.start == pytest.approx([0.985, 0.985])


# --- inputs ------------------------------------------------------------------------------------------------------


def test_wave_starts_upwards_unless_its_phase_says_otherwise():
    model = experiments.system("three_bar")
    up = experiments.square_wave(model, duration=0.05)
    down = experiments.square_wave(model, duration=0.05, phase=0.5)
    n4 = model.node_names.index("n4")
    assert up.velocity[1, n4, 2] > 0.0 > down.velocity[1, n4, 2]


def test_top_strings_move_and_no_others():
    for name, strings in (("two_bar", ["s3"]), ("three_bar_nsh", ["s4", "s5", "s6"]), ("six_bar", ["s19", "s20", "s21"])):
        model = experiments.system(name)
        assert [s for s, moves in zip(model.string_names, experiments.top_strings(model)) if moves] == strings


def test_systems_rest_until_the_strings_move():
    data = experiments.experiment_3(["two_bar"], duration=2.1)
    for model, result in data.runs.values():
        still = result.times <= 2.0
        assert np.abs(result.position[still] - model.nodes).max() < 1e-9
        assert np.abs(result.position[-1] - model.nodes).max() > 1e-3
    assert data.times[0] == pytest.approx(2.0)


# --- the command -------------------------------------------------------------------------------------------------

REDUCED = {
    "I": ["--systems", "two_bar", "--duration", "2"],
    "II": ["--duration", "0.2"],
    "III": ["--systems", "two_bar", "--duration", "2.2"],
    "IV": ["--duration", "0.6"],
    "beam": [],
    "nsh": [],
}


def read(path):
    with open(path, encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    return {name: [float(cell) for cell in column] for name, column in zip(head, zip(*rows))}


@functools.cache
def computed(name):
    """What the API gives for the command's reduced run."""
    options = REDUCED[name]
    duration = float(options[options.index("--duration") + 1]) if "--duration" in options else None
    return experiments.EXPERIMENTS[name].run(["two_bar"], duration)


@pytest.mark.parametrize("name", REDUCED)
def test_command_writes_what_the_experiment_gives(name, tmp_path, capsys):
    folder = tmp_path / "results"
    assert cli.main(["experiment", name, "--output", str(folder), *REDUCED[name]]) == 0
    data = computed(name)
    assert read(folder / f"experiment_{name}.csv") == {k: v.tolist() for k, v in data.columns().items()}
    drawn = {f"experiment_{name}_figure_{n}{suffix}" for n in FIGURES[name] for suffix in (".png", ".svg")}
    assert {path.name for path in folder.iterdir()} == {f"experiment_{name}.csv", *drawn}
    assert data.summary() in capsys.readouterr().out


@pytest.mark.parametrize("name", REDUCED)
def test_records_are_the_numbers_of_the_table(name):
    data = computed(name)
    records = json.loads(json.dumps(data.records()))
    firsts = [row.split()[0] for row in data.summary().splitlines()[1:]]
    assert [next(iter(row.values())).split()[0] for row in records] == firsts
    if name == "I":
        run, row = data.runs["two_bar_nsh"], next(row for row in records if row["scene"] == "two_bar_nsh")
        assert row["height"] == run.height.mean(axis=1).tolist() and row["fastest_at_the_end"] == run.speed.max()
    if name == "IV":
        assert records[1]["absorbed"] == data.runs["nsh"].absorbed[-1] and records[1]["stored_at_the_end"] == data.stored("nsh")


def test_the_table_as_json(tmp_path, capsys):
    assert cli.main(["experiment", "nsh", "--output", str(tmp_path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["experiment"], found["duration"]) == ("nsh", None)
    assert found["table"] == computed("nsh").records() and len(found["written"]) == len(list(tmp_path.iterdir())) == 3


def test_figures_are_drawn_alike_each_time(tmp_path):
    for folder in ("a", "b"):
        assert cli.main(["experiment", "IV", "--duration", "0.1", "--output", str(tmp_path / folder)]) == 0
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["II", "--systems", "two_bar"], "--systems two_bar: II has one system only"),
        (["beam", "--duration", "1"], "--duration = 1.0: beam is a curve"),
        (["III", "--duration", "2"], "duration = 2.0 s: the strings move from 2 s on"),
        (["IV", "--duration", "0"], "--duration = 0.0 is not a number greater than 0"),
        (["I", "--duration", "1", "--output", "no/such/folder"], "--output no/such/folder: no such folder can be made"),
    ],
)
def test_mistakes_are_named_and_nothing_is_written(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["experiment", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_oscillators_outside_their_range_are_refused():
    with pytest.raises(InputError, match="mass = 0.0 is not greater than 0"):
        one_dimensional.Oscillator(0.0, 1.0, 1.0)
    with pytest.raises(InputError, match="damping = -1.0 is not at least 0"):
        one_dimensional.Oscillator(1.0, 1.0, -1.0)
    with pytest.raises(InputError, match="spring.k = 0.0"):
        one_dimensional.Oscillator(1.0, 0.0, 1.0)
    with pytest.raises(InputError, match=r"force \(3,\)"):
        one_dimensional.simulate(one_dimensional.Oscillator(1.0, 1.0, 1.0), [0.0, 1.0], [1.0, 2.0, 3.0])


# --- docs/experiments.md and docs/claims.md ----------------------------------------------------------------------


def stored(name):
    return json.loads((DOCS / f"{name}.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize(("name", "report"), [("experiments", article_page.report), ("claims", claims_page.report)])
def test_page_comes_from_its_data(name, report):
    assert report(stored(name)) == (DOCS / f"{name}.md").read_text(encoding="utf-8")


def test_stored_data_are_what_this_code_gives():
    found, kept = measures.heights(experiments.system("two_bar_nsh")), stored("claims")["I"]["base"]["two_bar_nsh"]
    assert found["z"] == pytest.approx(kept["z"], rel=1e-5)
    assert found["snaps"] == kept["snaps"]
    rows = read(DOCS / "data" / "experiment_I.csv")
    assert found["z"] == pytest.approx(rows["two_bar_nsh.n3.z"], abs=1e-8)


def test_stored_peaks_and_periods_are_what_this_code_gives():
    data, page = stored("claims"), stored("experiments")
    kept = data["II"]["base"]["plain/50"]
    found = measures.wave(variants.BASE, "plain", 50.0)
    assert [found["way"], found["force_peak"], *found["swing"]] == pytest.approx(
        [kept["way"], kept["force_peak"], *kept["swing"]], rel=1e-5
    )
    found, kept = measures.measure_4(variants.BASE)["nsh"], data["IV"]["base"]["nsh"]
    assert found.pop("periods") == pytest.approx(kept.pop("periods"), rel=1e-5) and found == pytest.approx(kept, rel=1e-5)
    assert experiments.experiment_4().summary().splitlines() == page["tables"]["IV"]
    found = measures.repeats((5000.0,))
    for where in (data, page):
        assert [where["repeats"][key]["periods"] for key in found] == [each["periods"] for each in found.values()] == [1, 2]


def test_pages_say_after_how_many_periods_the_motion_comes_back():
    for name in ("claims", "experiments"):
        text = " ".join((DOCS / f"{name}.md").read_text(encoding="utf-8").split())
        assert "At d = 5000 with NSH it comes back after 2 periods of the wave" in text
    told = {"repeats": {"plain/5": {"periods": 1, "off": [0.0]}, "nsh/5": {"periods": None, "off": [1.0, 1.0]}}}
    text = rendered("article/repeats", **told, repeated_seconds=measures.REPEATED_SECONDS)
    assert "it does not within 2 periods" in " ".join(text.split())


def test_verdicts_have_signs():
    """Colours alone are alike to many readers."""
    data = stored("claims")
    figure = claims_page.draw(data)
    shown = [text.get_text() for axes in figure.axes for text in axes.texts]
    expected = [
        claims_page.SIGNS[claim.verdict(data, variant.key)][0]
        for experiment, chosen in variants.VARIANTS.items()
        for variant in chosen
        for claim in claims_page.scanned(experiment).values()
    ]
    assert shown == expected and len(set(shown)) == 3
    (legend,) = figure.legends
    signs = [text.get_text().split() for text in legend.get_texts()]
    assert signs == [[claims_page.SIGNS[verdict][0], verdict] for verdict in (claims.YES, claims.PARTLY, claims.NO)]


def test_every_choice_was_measured():
    data = stored("claims")
    for experiment, chosen in variants.VARIANTS.items():
        assert list(data[experiment]) == [variant.key for variant in chosen]
        assert not [key for key, numbers in data[experiment].items() if "failure" in numbers]


def test_a_claim_is_judged_by_its_conditions():
    scores = {claims.YES: [True, True], claims.PARTLY: [True, False], claims.NO: [False, False]}
    for verdict, conditions in scores.items():
        claim = claims.Claim("II", "", lambda numbers: (numbers["conditions"], ""))
        assert claim.verdict({"II": {"base": {"conditions": conditions}}}) == verdict
    assert claim.verdict({"II": {"base": {"failure": "no equilibrium"}}}) is None


def test_printed_inertia_is_a_heavier_bar():
    """Of a bar pinned at one end, M's entry of the other end is what the printed J makes it; its weight stays."""
    model = experiments.system("three_bar")
    changed = variants.printed_inertia(model)
    C_b = equations.connectivity(np.array([[0, 1]]), 2)
    length = float(np.mean(model.bar_length))
    none = np.zeros(2)
    printed = equations.mass_matrix(C_b, 0.5 * np.abs(C_b), np.array([length**2 / 12.0]), np.ones(1), none)
    heavier = equations.mass_matrix(C_b, 0.5 * np.abs(C_b), changed.bar_mass[:1] / 12.0, changed.bar_mass[:1], none)
    assert heavier[1, 1] == pytest.approx(printed[1, 1])
    assert changed.bar_mass * changed.gravity == pytest.approx(model.bar_mass * model.gravity)


@pytest.mark.parametrize("change", [variants.beside, variants.weightless, variants.shortened(0.1, top=False)])
def test_changed_structures_start_in_equilibrium(change):
    changed = change(experiments.system("three_bar_nsh"))
    assert np.abs(statics.residual(changed)).max() < 1e-5


def test_turns_and_harmonics_of_known_series():
    t = np.linspace(0.0, 10.0, 1001)[:-1]
    w = 2.0 * np.pi / experiments.SINE_PERIOD
    pure, rich = np.sin(w * t), np.sin(w * t) + 0.5 * np.sin(5.0 * w * t)
    numbers = measures.motion(t, np.column_stack((pure, rich)))
    assert numbers["turns"] == [2, 10]
    assert numbers["harmonics"] == pytest.approx(0.25 / 2.25)
    assert numbers["away"] == pytest.approx(0.0, abs=1e-12)
