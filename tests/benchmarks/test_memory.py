"""docs/memory.md: what its script measures, at reduced size, and the page against its data."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.article import measures, memory, memory_loops, memory_runs, variants
from tensegrity_core import laws, statics
from tensegrity_core.article import experiments
from tensegrity_core.model.elements import Beam, Series, Spring
from tensegrity_core.scene import parse_scene
from tensegrity_core.statics import build_model

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"


def stored():
    data = memory.PAGE.read(DOCS / "memory.json")
    return data, data["columns"]


# --- the page ----------------------------------------------------------------------------------------------------


def test_page_comes_from_its_data():
    assert memory.report(stored()[0]) == (DOCS / "memory.md").read_text(encoding="utf-8")


def test_stored_numbers_hold_what_the_page_says():
    data, series = stored()
    cells, loop = data["cells"], data["honeycomb"]
    for sign, expected in ((1, memory_loops.CLOSED["there"]), (-1, memory_loops.CLOSED["back"])):
        assert [snap["x"] for snap in cells["snaps"] if snap["way"] == sign] == pytest.approx(expected, rel=1e-11)
    for one in (cells, loop, *data["partial"]):
        assert one["area"] == pytest.approx(one["loss"], rel=1e-10)
    for one in (cells, loop):  # the kernel's snaps and losses are the exact law's
        run = one["machine"]
        assert [s["x"] for s in run["snaps"]] == pytest.approx([s["x"] for s in one["snaps"]], abs=1e-11)
        assert run["loss"] == pytest.approx(one["loss"], rel=1e-11)
        assert abs(run["dissipated"] - run["dampers"] - run["loss"]) < 1e-8 * run["throughput"] and run["off"] < 1e-10
    for one in data["ledger"].values():
        assert one["gap"] < 1e-8 and one["closure"] < 1e-8 and one["count"] > 0
    assert data["stiffness"]["kernel"]["off"] < 1e-12 and data["stiffness"]["kernel"]["refused"] == []
    scan = series["stiffness"]
    for i, limit in enumerate(data["stiffness"]["beams"], 1):
        loss = scan[f"beam_{i}.loss"]
        assert (loss[scan["stiffness"] > limit] == 0.0).all() and (loss[scan["stiffness"] < limit] > 0.0).all()
    assert scan["snaps_there"].tolist() == [3 + (k < data["stiffness"]["first"]) for k in scan["stiffness"]]
    for found in data["I"].values():
        assert found["differ"] == found["midway"]


def test_structures_lose_what_their_strings_loops_have():
    data, _ = stored()
    for name, strings in (("three_bar", 3), ("six_bar", 6)):
        assert data["I"][name]["memory"]["ramp"]["snaps"] == pytest.approx(strings * data["honeycomb"]["loss"], rel=1e-9)


# --- single strings ----------------------------------------------------------------------------------------------


def test_area_of_a_loop_is_what_it_loses():
    found = memory_loops.loop(memory_loops.cells(), 200.0, (0.055, 0.04, 0.06, 0.0))
    assert found["area"] == pytest.approx(found["loss"], rel=1e-12) and len(found["snaps"]) == 6
    beam = Series((Beam(8.0, 4.0, 0.01),), "hysteretic")
    found = memory_loops.loop(beam, 700.0, (0.1, 0.0))
    assert found["area"] == pytest.approx(found["loss"], rel=1e-9) and found["loss"] > 0.0


def test_kernel_in_the_testing_machine_follows_the_cells():
    numbers, series = memory_loops.tested(memory_loops.cells(), 200.0, 0.08, 2 * 97)
    assert [s["x"] for s in numbers["snaps"]] == pytest.approx([*memory_loops.CLOSED["there"], *memory_loops.CLOSED["back"]])
    assert numbers["loss"] == pytest.approx(memory_loops.CLOSED["cycle"], rel=1e-12)
    assert numbers["dissipated"] == pytest.approx(numbers["loss"] + numbers["dampers"], rel=1e-10)
    assert numbers["work"] == pytest.approx(numbers["dissipated"], rel=1e-9) and numbers["off"] < 1e-12
    assert series["kernel"] == pytest.approx(series["exact"], abs=1e-12)


@pytest.mark.parametrize("beam", [Beam(6.0, 3.0, 0.01), Beam(10.0, 5.0, 0.015)])
def test_a_beam_alone_is_smooth_from_its_steepest_fall_on(beam):
    limit = memory_loops.smooth_beam(beam)
    assert memory_loops.cycle((beam,), 1.001 * limit) == []
    assert [way for way, _ in memory_loops.cycle((beam,), 0.98 * limit)] == [1, -1]


def test_where_the_first_beam_becomes_smooth():
    parts = memory_loops.beams()[:2]
    limit = memory_loops.smooth_first(parts)
    ways = [sum(way > 0 for way, _ in memory_loops.cycle(parts, k)) for k in (0.999 * limit, 1.001 * limit)]
    assert ways[0] == ways[1] + 1


def test_kernel_curves_lose_what_the_exact_law_says():
    parts = memory_loops.beams()[1:3]
    element, k = Series(parts, "hysteretic"), 1500.0
    exact = memory_loops.snaps(memory_loops.way(element, k, (0.12, -1.0)))
    found = memory_loops.walked(memory_loops.machine(element, k), (0.12, -1.0))
    assert len(found) == len(exact) > 2
    assert np.array(found) == pytest.approx(np.array([(s["x"], s["loss"]) for s in exact]), rel=1e-9)


# --- structures --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("law", ["single_valued", "hysteretic"])
@pytest.mark.parametrize("name", experiments.SYSTEMS)
def test_systems_with_k_in_series_start_in_equilibrium(name, law):
    base = experiments.system(f"{name}_nsh")
    model = variants.in_series(law)(base)
    assert np.abs(statics.residual(model)).max() < 1e-9 and statics.stability(model).stable
    tensions = [statics.string_tension(one, variants.lengths(base)) for one in (base, model)]
    assert tensions[1] == pytest.approx(tensions[0], abs=1e-10)
    assert len(measures.honeycombs(model)) == len(base.nsh_strings)


def test_the_scene_with_memory_is_the_variant():
    scene = {"extends": "three_bar_nsh", "name": "three_bar_memory", "nsh": {"article": {"law": "hysteretic"}}}
    model, other = build_model(parse_scene(scene)), variants.HYSTERETIC.model("three_bar_nsh")
    assert model.nsh == other.nsh and model.rest_length == pytest.approx(other.rest_length, abs=1e-13)


def test_snapped_beams_of_an_element_are_counted_by_its_length():
    model = variants.SINGLE_VALUED.model("two_bar_nsh")
    made = laws.law(Series((Spring(float(model.stiffness[0])), *memory_loops.beams())))
    f_max = np.array([13.3333, 20.3546, 28.9443, 39.0849])
    lengths = np.tile(model.rest_length, (4, 1))
    lengths[:, 0] += [made.elongation(force + 0.01) for force in f_max]
    found = measures.snapped(model, np.zeros((4, 0), dtype=int), lengths)
    assert found.tolist() == [[n, 0] for n in (1, 2, 3, 4)]


def test_panels_cover_every_interval():
    ends = memory_runs.panels(np.array([0.0, 1e-9, 0.5, 0.5004]))
    assert (np.diff(ends) > 0.0).all() and ends[[0, -1]].tolist() == [0.0, 0.5004]
    assert np.diff(ends).max() < 2.0 * memory_runs.LONGEST and {1e-9, 0.5} <= set(ends)


def test_energy_is_lost_in_dampers_and_in_snaps(monkeypatch):
    monkeypatch.setattr(memory_runs, "POINTS", 8)
    model = variants.HYSTERETIC.model("two_bar_nsh")
    push = np.zeros((len(model.nodes), 3))
    push[experiments.top_nodes(model), 2] = 60.0
    found = memory_runs.account(model, lambda t: push, np.array([0.0, 2.0]))
    assert found["count"] == 6 and found["snaps"] > 0.1
    assert found["gap"] < 1e-8 and found["closure"] < 1e-9


def test_a_slow_lift_and_back_loses_a_loop_in_each_string():
    model = variants.HYSTERETIC.model("two_bar_nsh")
    found, series = memory_runs.ramp(model, 64.0, 4.0, 3.0)
    loss = sum(loss for _, loss in memory_loops.cycle(memory_loops.beams(), float(model.stiffness[0])))
    assert found["snaps"] == pytest.approx(2.0 * loss, rel=1e-9) and found["count"] == 14
    assert len(found["up"]) == len(found["back"]) == 4 and found["apart"] > 0.02 and found["dampers"] > 0.0
    assert len(series["z"]) == len(series["lift"]) == 33


def test_changes_count_each_beam():
    assert memory_runs.changes(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0, 2, 2, 1])) == [1.0, 1.0, 3.0]


def test_square_wave_splits_its_losses(monkeypatch):
    monkeypatch.setattr(experiments, "DAMPINGS", (5000.0,))
    numbers, series = memory_runs.second_experiment(duration=1.0)
    one, other = numbers["memory"]["5000"], numbers["series"]["5000"]
    assert one["snaps"] > 0 and other["snaps"] == 0 and other["in_snaps"] == [0.0]
    for found in (one, other):
        assert sum(found["in_snaps"]) + sum(found["in_dampers"]) == pytest.approx(found["dissipated"], rel=1e-9)
    assert 0.0 < one["apart"] < 1e-2 and len(series["time"]) == 101


def test_heights_of_a_system_with_memory():
    model = variants.HYSTERETIC.model("two_bar_nsh")
    run = measures.lifted(model, [10.0, 35.0])
    assert run.snapped.tolist() == [[0, 0], [2, 2]]
    plain = replace(model, nsh=(None,) * 3)
    assert measures.lifted(plain, [10.0]).snapped.shape == (1, 0)


@pytest.mark.parametrize("samples", [6400, 5904])
def test_snaps_at_communication_points_are_recorded(samples):
    """With 2.5 ms steps every snap of the trilinear cells falls on a communication point."""
    model = memory_loops.machine(memory_loops.cells(), 200.0, 0.0)
    _, result = memory_loops.pulled(model, 0.08, samples)
    losses = [t.loss for t in result.transitions if t.loss > 0.0]
    assert losses == pytest.approx([1.142857142857143e-3] * 6, rel=1e-9)
    assert result.dissipated[-1] == pytest.approx(sum(losses), abs=1e-10)
