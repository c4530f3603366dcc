"""Cross-check bundles: fmpy's own cross-check takes them, simulates the FMU and finds its results within the band."""

from __future__ import annotations

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.cross_check.cross_check import cross_check
from fmpy.cross_check.validate_vendor_repo import validate_test_fmu
from fmpy.util import read_csv as fmpy_csv
from fmpy.util import read_ref_opt_file

from fmu_src.validation.cross_check import CLOSE, KINDS, write_cross_check
from fmu_src.validation.validate import CACHE
from tests.support import scene

SCENE = "three_bar_nsh"


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    (place,) = write_cross_check(scene(SCENE), tmp_path_factory.mktemp("bundle"), cache=CACHE)
    return place


def read(path):
    """A table; fmpy writes the names in quotes."""
    lines = path.read_text(encoding="utf-8").replace('"', "").splitlines()
    return np.genfromtxt(lines, delimiter=",", names=True, deletechars="")


def test_bundle_has_the_files_that_the_rules_name(bundle):
    names = {f"{SCENE}.fmu", f"{SCENE}_in.csv", f"{SCENE}_ref.csv", f"{SCENE}_ref.opt", "ReadMe.txt"}
    assert {path.name for path in bundle.iterdir()} == names
    assert bundle.parts[-7:-4] == ("fmus", "2.0", "cs") and bundle.name == SCENE
    assert all(path.stat().st_size < 1_000_000 for path in bundle.iterdir())


def test_fmpys_rules_find_no_problem(bundle):
    assert validate_test_fmu(str(bundle)) == []


@pytest.mark.parametrize("contents", [{"simple": True}, {"sources": True}, {"naming": "flat"}])
def test_bundles_of_other_contents_keep_the_rules(contents, tmp_path):
    (place,) = write_cross_check(scene("two_bar_nsh"), tmp_path, cache=CACHE, **contents)
    assert validate_test_fmu(str(place)) == []


@pytest.mark.parametrize("naming", ["structured", "flat"])
@pytest.mark.parametrize("standard", ["2.0", "3.0"])
def test_bundles_of_every_version_and_kind_are_replayed(standard, naming, tmp_path):
    """fmpy reads inputs and options, and what it gets for the outputs is within what the ReadMe says.  An FMU of both kinds has
    a bundle for each."""
    model = scene("two_bar_nsh")
    places = write_cross_check(model, tmp_path, naming, CACHE, kind="both", standard=standard)
    assert [place.relative_to(tmp_path).parts[1:3] for place in places] == [(standard, "cs"), (standard, "me")]
    for place, kind in zip(places, ("CoSimulation", "ModelExchange"), strict=True):
        given, expected = (fmpy_csv(place / f"{model.name}_{what}.csv") for what in ("in", "ref"))
        options = read_ref_opt_file(str(place / f"{model.name}_ref.opt"))
        moving = [name for name in given.dtype.names[1:] if np.ptp(given[name], axis=0).any()]
        found = simulate_fmu(
            str(place / f"{model.name}.fmu"),
            fmi_type=kind,
            stop_time=options["StopTime"],
            output_interval=options["StepSize"],
            relative_tolerance=1e-9,
            input=given[["time", *moving]],  # fmpy 0.3.32 takes either scalars or arrays of one size
            output=list(expected.dtype.names[1:]),
        )
        at = np.searchsorted(found["time"], expected["time"] - 1e-9, side="left")
        for name in expected.dtype.names[1:]:
            right, ours = expected[name], np.array(found[name].tolist())[at]
            away = np.abs(expected["time"][:, None] % 0.5).min(axis=1) > 1e-6  # where the wave turns, forces have two values
            bound = CLOSE * (1.0 + np.max(np.abs(right)))
            assert np.max(np.abs(ours - right)[away]) <= bound, (place, name)
        assert KINDS[place.parts[-5]] in (place / "ReadMe.txt").read_text(encoding="utf-8")


def test_options_are_lines_of_a_name_and_a_number(bundle):
    lines = (bundle / f"{SCENE}_ref.opt").read_text(encoding="utf-8").splitlines()
    assert [line.split(",")[0] for line in lines] == ["StartTime", "StopTime", "StepSize", "RelTol"]
    assert [float(line.split(",")[1]) for line in lines] == [0.0, 2.0, 0.01, 1e-6]
    assert read_ref_opt_file(str(bundle / f"{SCENE}_ref.opt"))["StopTime"] == 2.0


def test_tables_name_inputs_and_outputs_of_the_fmu(bundle):
    causality = {v.name: v.causality for v in read_model_description(str(bundle / f"{SCENE}.fmu")).modelVariables}
    given, expected = read(bundle / f"{SCENE}_in.csv"), read(bundle / f"{SCENE}_ref.csv")
    assert {causality[name] for name in given.dtype.names[1:]} == {"input"}
    assert {causality[name] for name in expected.dtype.names[1:]} == {"output"}
    assert len(expected) == 201
    jumps = np.flatnonzero(np.diff(given["time"]) == 0.0)
    np.testing.assert_allclose(given["time"][jumps], [0.5, 1.0, 1.5])


def simulated(options):
    """What `python -m fmpy.cross_check --simulate` does with an FMU."""
    given = fmpy_csv(options["input_filename"])
    return simulate_fmu(
        options["fmu_filename"],
        validate=False,
        step_size=options["step_size"],
        stop_time=options["stop_time"],
        input=given,
        output=options["output_variable_names"],
    )


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_fmpys_cross_check_simulates_the_bundle_and_accepts_the_result(bundle, tmp_path, monkeypatch):
    plotless = "fmpy.cross_check.cross_check.plot_result"  # plotting needs plotly, which is not the point here
    monkeypatch.setattr(plotless, lambda *arguments, **options: None)
    report, results = tmp_path / "report.html", tmp_path / "results"
    cross_check(str(bundle.parents[5]), str(report), str(results), simulated, "this", "1", lambda _: False, lambda: "tried")
    text = report.read_text(encoding="utf-8")
    assert "100 %</span>" in text and "label label-danger" not in text and "label label-warning" not in text, text[-3000:]
    (found,) = results.rglob(f"{SCENE}_out.csv")
    assert {path.name for path in found.parent.iterdir()} & {"passed", "failed", "rejected"} == {"passed"}
    ours, expected = read(found), read(bundle / f"{SCENE}_ref.csv")
    for name in expected.dtype.names[1:]:
        at = np.interp(expected["time"], ours["time"], ours[name])
        # Six digits are stored.  The throughput is the integral of a magnitude, which has kinks inside steps; no error control
        # sees it, and nothing but the scale of the energy balance comes from it.
        digits = 1e-4 if name == "energy.throughput" else 2e-5
        bound = digits * (1.0 + np.max(np.abs(expected[name])))
        assert np.max(np.abs(at - expected[name])) <= bound, name


def test_a_solver_of_the_host_keeps_what_the_bundle_says(tmp_path):
    """fmpy's CVODE at the tolerance of the options file; of the two rows at a jump of the inputs, the first."""
    (place,) = write_cross_check(scene(SCENE), tmp_path, cache=CACHE, kind="me")
    options, expected = read_ref_opt_file(str(place / f"{SCENE}_ref.opt")), fmpy_csv(place / f"{SCENE}_ref.csv")
    names = list(expected.dtype.names[1:])
    given = fmpy_csv(place / f"{SCENE}_in.csv")
    steps = {"stop_time": options["StopTime"], "output_interval": options["StepSize"], "relative_tolerance": options["RelTol"]}
    found = simulate_fmu(str(place / f"{SCENE}.fmu"), input=given, output=names, **steps)
    rows = [np.flatnonzero(np.abs(found["time"] - t) < 1e-9)[0] for t in expected["time"]]
    for name in names:
        assert np.max(np.abs(found[name][rows] - expected[name])) <= CLOSE * (1.0 + np.max(np.abs(expected[name]))), name
    assert "before the jump" in (place / "ReadMe.txt").read_text(encoding="utf-8")
