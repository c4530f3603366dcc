"""The recording against which moves of code are compared finds what changes, and nothing else."""

import dataclasses

import numpy as np
import pytest

from tests.support import recorded, scene


@pytest.fixture(autouse=True)
def short(monkeypatch):
    """Runs of a few steps, by two methods, of which FMUs take one."""
    monkeypatch.setattr(recorded, "KERNEL_TIME", 0.3)
    monkeypatch.setattr(recorded, "REFERENCE_TIME", 0.07)
    monkeypatch.setattr(recorded, "FMU_TIME", 0.3)
    monkeypatch.setattr(recorded, "METHODS", ("auto", "ros2"))
    monkeypatch.setattr(recorded, "FMU_METHODS", ("auto",))


def heavier(model):
    """The first bar by one part in 1e12."""
    mass = np.array(model.bar_mass, dtype=float)
    mass[0] *= 1.0 + 1e-12
    return dataclasses.replace(model, bar_mass=mass)


def test_a_second_recording_is_identical_and_a_mass_off_by_1e_12_is_found(tmp_path, capsys):
    file = tmp_path / "before.npz"
    assert recorded.main(["record", str(file), "--scenes", "two_bar"]) == 0
    assert recorded.main(["compare", str(file)]) == 0
    lines = capsys.readouterr().out.splitlines()[1:]
    assert len(lines) == 12
    assert all(line.endswith("identical bits") for line in lines)

    assert not recorded.compare(file, recorded.recorded(["two_bar"], heavier))
    lines = capsys.readouterr().out.splitlines()[1:]
    groups = {line[16:40].strip(): line for line in lines}
    assert [group for group, line in groups.items() if line.endswith("identical bits")] == ["curves"]
    assert {group for group, line in groups.items() if "DIFFERS" not in line} == {"curves", "path"}  # paths: to round-off


def test_nothing_that_is_recorded_was_refused(tmp_path):
    for _, _, group, record in recorded.recorded(["two_bar"]):
        assert "refused" not in record or "FMU" in group
        if group.startswith("kernel"):
            assert record["position"].shape == (28, 4, 3)
            assert np.ptp(record["position"], axis=0).max() > 1e-3


def test_every_scene_of_the_pages_is_recorded(tmp_path):
    assert set(recorded.page_scenes(tmp_path)) == {"shaken", "memory", "in_series"}


def test_the_inputs_move_everything_and_jump():
    given = recorded.history(scene("three_bar"), 2.0)
    assert (np.ptp(given.force[:, scene("three_bar").free_nodes], axis=0) > 1.0).all()
    assert (np.ptp(given.rest_length, axis=0) > 1e-3).all()
    step = np.diff(given.times)
    gaps = given.rest_length[1:] - (given.rest_length + step[:, None] * given.rest_length_rate)[:-1]
    assert np.flatnonzero(np.abs(gaps).max(axis=1) > 1e-4).tolist() == [len(step) // 2 - 1]


X = np.array([[0.1, 0.2], [0.3, 40.0]])


@pytest.mark.parametrize(
    "name, now, nsh, allowed",
    [
        ("position", X + 1e-16, False, False),
        ("position", -0.0 * X, False, False),
        ("position", X + 5e-12, True, True),
        ("position", X + 2e-11, True, False),
        ("nodes", X + 2e-11, True, False),
        ("string_force", X + 1e-8, True, True),
        ("string_force", X + 1e-6, True, False),
        ("jacobian.position", X + 1e-8, True, True),
        ("throughput", X + 1e-5, True, True),
        ("rates", X + 1e-4, True, False),
        ("string_force", X[:1], True, False),
        ("string_force", np.where(X > 30.0, np.nan, X), True, False),
        ("string_force", X.astype(int), True, False),
    ],
)
def test_what_a_difference_may_be(name, now, nsh, allowed):
    before = 0.0 * X if now.tobytes() == (-0.0 * X).tobytes() else X
    (found,) = recorded.differences({name: now}, {name: before}, nsh)
    assert found.allowed == allowed


def test_whole_numbers_texts_and_names_must_agree():
    pieces, text = np.array([[1, 0, 2]]), np.array('start="0.5" unit="m"')
    for one, other in (
        ({"transitions.pieces": pieces}, {"transitions.pieces": pieces + 1}),
        ({"transitions.pieces": pieces}, {"transitions.pieces": pieces[:0]}),
        ({"xml": text}, {"xml": np.array('start="0.5" unit="mm"')}),
        ({"xml": text}, {"xml": np.array('start="0.6" unit="m"')}),
        ({"xml": text}, {}),
        ({}, {"xml": text}),
    ):
        assert [found.allowed for found in recorded.differences(one, other, True)] == [False]
    shifted = {"xml": np.array('start="0.5000000000001" unit="m"')}
    assert [found.allowed for found in recorded.differences({"xml": text}, shifted, True)] == [True]
    assert [found.allowed for found in recorded.differences({"xml": text}, shifted, False)] == [False]


def test_the_solver_s_counters_are_shown_and_not_judged_where_strings_have_an_nsh():
    one, other = {"stats.steps": np.array(10)}, {"stats.steps": np.array(11)}
    assert [found.allowed for found in recorded.differences(one, other, True)] == [True]
    assert [found.allowed for found in recorded.differences(one, other, False)] == [False]


def test_a_group_that_is_not_recorded_again_fails(tmp_path, capsys):
    rows = [("a", False, "statics", {"x": X}), ("a", False, "curves", {"x": X})]
    recorded.save(tmp_path / "before.npz", iter(rows))
    assert recorded.compare(tmp_path / "before.npz", iter(rows))
    assert not recorded.compare(tmp_path / "before.npz", iter(rows[:1]))
    assert "was not recorded again" in capsys.readouterr().out
