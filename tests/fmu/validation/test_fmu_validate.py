"""Validation: from outside, against the reference; the cache, the comparison, the command and its exit codes."""

import errno
import os
import re
import shutil
import tempfile
import zipfile
from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import tensegrity_core
from fmu_src import build as build_fmu
from fmu_src import builds
from fmu_src.builds import judgement, packs
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.validation import compare, sensitivity, validate, worst
from fmu_src.validation.compare import series
from fmu_src.validation.reference_cache import cached, reference_key, trouble
from fmu_src.validation.report import write_report
from fmu_src.validation.scenarios import Scenario, scenarios
from fmu_src.validation.sensitivity import OUTPUTS, match, spreads
from fmu_src.validation.speed import measure
from fmu_src.validation.trials import trials
from fmu_src.variables.interface import variables
from tensegrity_core import kernel, reference
from tensegrity_core.errors import SimulationError, TensegrityError
from tensegrity_core.model import Transition, grid, held
from tensegrity_core.native.build import TARGETS
from tensegrity_core.output.page import Parts
from tensegrity_core.scene import load_scene
from tensegrity_core.statics import build_model
from tests.support import scene
from tests.support.browser import CHROMIUM, Browser

#: What `compare` reads of an FMU.
FMU_SERIES = (*OUTPUTS, "snapped", "contact_sticking", "throughput")
SETTINGS = {"method": "DOP853", "rtol": 1e-9, "atol": 1e-10}


def short(model, duration=0.1):
    """A lift with moving rest lengths at a tenth of the damping: a scenario of 0.1 s."""
    damped = replace(model, damping=0.1 * model.damping)
    force = np.zeros((len(model.nodes), 3))
    force[model.free_nodes[0]] = 0.0, 0.0, 60.0
    moving = held(damped, grid(duration, 0.01), lambda t: force, lambda t: model.rest_length * (1.0 - 0.05 * t))
    return Scenario("short", "a short lift", damped, moving, "lift at d/10")


class Here:
    """An executor that runs everything at once in this process."""

    parts = ()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def submit(self, function, *arguments, **options):
        future = Future()
        try:
            future.set_result(function(*arguments, **options))
        except Exception as error:
            future.set_exception(error)
        return future


# From outside


@pytest.mark.parametrize("name", ["two_bar", "three_bar_nsh", "six_bar_nsh"])
def test_strangers_get_the_kernels_results(name, fmus, outside_python):
    """In an environment with numpy and fmpy only, the FMU gives what the kernel gives here, to the last bit."""
    model = scene(name)
    run = short(model, 0.3)
    ((fmu, events, seconds),) = validate.run_outside(fmus[name], model, runs=[run], python=str(outside_python))
    here = kernel.simulate(run.model, run.inputs)
    for field in ("position", "velocity", "string_force", "reaction", "dissipated", "input_work", "snapped"):
        np.testing.assert_array_equal(fmu[field], getattr(here, field), err_msg=field)
    assert events == here.transitions and len(events) > 0 and seconds > 0.0


def test_flat_names_run_too(tmp_path):
    from fmu_src.packing.pack import pack_python_fmu

    model = scene("two_bar_nsh")
    fmu = pack_python_fmu(model, tmp_path / "flat.fmu", naming="flat")
    run = short(model)
    ((found, _, _),) = validate.run_outside(fmu, model, "flat", [run])
    np.testing.assert_array_equal(found["position"], kernel.simulate(run.model, run.inputs).position)


def test_a_broken_fmu_is_told(tmp_path):
    with pytest.raises(validate.ValidationError, match="from outside failed"):
        (tmp_path / "no.fmu").write_bytes(b"nothing")
        validate.run_outside(tmp_path / "no.fmu", scene("two_bar"), runs=[short(scene("two_bar"))])


@pytest.mark.parametrize("kind", ["native", "python"])
def test_a_folder_whose_name_is_no_text_serves_as_any_other(kind, fmus, native_fmus, tmp_path, monkeypatch):
    """Names are bytes to Linux; FMU, temporary files and current folder are there."""
    folder = tmp_path / os.fsdecode(b"gr\xf6\xdfe #1")
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system wants names that are text")
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    monkeypatch.chdir(folder)
    fmu = {"native": native_fmus, "python": fmus}[kind]["two_bar"]
    model = scene("two_bar")
    ((expected, _, _),) = validate.run_outside(fmu, model, runs=[short(model)])
    ((found, _, _),) = validate.run_outside(Path(shutil.copy(fmu, folder)), model, runs=[short(model)])
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, err_msg=name)


# Scenarios


@pytest.mark.parametrize("name", ["two_bar_nsh", "three_bar", "six_bar"])
def test_scenarios_are_the_articles(name):
    model = scene(name)
    assert [run.name for run in scenarios(model)] == [
        "constant_1d",
        "square_wave_0_1d",
        "square_wave_1d",
        "square_wave_10d",
        "rest_lengths_1d",
        "push_1d",
    ]
    found = {run.name: run for run in scenarios(model, thorough=True)}
    assert len(found) == 12 and {run.inputs.times[-1] for run in found.values()} == {5.0}
    assert {float(run.model.damping[0]) for run in found.values()} == {50.0, 500.0, 5000.0}
    n4 = model.node_names.index("n4")
    wave = found["square_wave_1d"].inputs.force[:, n4, 2]
    np.testing.assert_array_equal(wave[[0, 49, 50, 99, 100]], [400.0, 400.0, -400.0, -400.0, 400.0])
    moving = found["rest_lengths_1d"].inputs
    assert not moving.rest_length_rate[:200].any() and moving.rest_length_rate[200:].any()
    swing = np.ptp(moving.rest_length, axis=0)
    furthest = min(0.3, 0.4 * model.rest_length[swing > 0.0].min())
    np.testing.assert_allclose(swing[swing > 0.0], furthest, rtol=0.01)


# The reference's cache


@pytest.fixture
def result():
    run = short(scene("two_bar"), 0.02)
    return run, reference.simulate(run.model, run.inputs, **SETTINGS)


def test_cached_runs_come_back_whole(result, tmp_path):
    run, computed = result
    key = reference_key(run.model, run.inputs, SETTINGS)
    first, was_cached = cached(tmp_path, key, lambda: computed)
    again, is_cached = cached(tmp_path, key, lambda: pytest.fail("computed although cached"))
    assert (was_cached, is_cached) == (False, True) and first is computed
    np.testing.assert_array_equal(again.position, computed.position)
    np.testing.assert_array_equal(again.throughput, computed.throughput)
    assert again.transitions == computed.transitions and again.stats == computed.stats
    assert cached(None, key, lambda: computed) == (computed, False)


def test_damaged_or_misplaced_files_are_not_used(result, tmp_path):
    run, computed = result
    key = reference_key(run.model, run.inputs, SETTINGS)
    cached(tmp_path, key, lambda: computed)
    (path,) = tmp_path.iterdir()
    data = path.read_bytes()
    for bad in (data[:-1], data[:200] + bytes([data[200] ^ 1]) + data[201:], b""):
        path.write_bytes(bad)
        assert cached(tmp_path, key, lambda: computed) == (computed, False)
    other = "0" * 64
    shutil.copy(path, tmp_path / f"{other}.bin")
    assert cached(tmp_path, other, lambda: computed) == (computed, False)


def test_everything_that_determines_a_run_is_in_its_key(tmp_path, monkeypatch):
    run = short(scene("two_bar"), 0.02)
    keys = {reference_key(run.model, run.inputs, SETTINGS)}
    heavier, moved = {"bar_mass": 2 * run.model.bar_mass}, {"nodes": run.model.nodes + 1e-16}
    for change in (heavier, moved, {"damping_law": "tension_only"}):
        keys.add(reference_key(replace(run.model, **change), run.inputs, SETTINGS))
    keys.add(reference_key(run.model, replace(run.inputs, force=run.inputs.force + 1e-9), SETTINGS))
    keys.add(reference_key(run.model, run.inputs, {**SETTINGS, "rtol": 1e-10}))
    monkeypatch.setattr("scipy.__version__", "0.0")
    keys.add(reference_key(run.model, run.inputs, SETTINGS))
    assert len(keys) == 7


@pytest.mark.parametrize("name", ["reference/run.py", "laws/chains.py", "model/model.py", "model/inputs.py"])
def test_a_change_of_the_references_sources_changes_the_key(name, tmp_path):
    run = short(scene("two_bar"), 0.02)
    core = tmp_path / "tensegrity_core"
    source = next(iter(tensegrity_core.__path__))
    shutil.copytree(source, core, ignore=shutil.ignore_patterns("native", "__pycache__"))
    before = reference_key(run.model, run.inputs, SETTINGS, core)
    assert before == reference_key(run.model, run.inputs, SETTINGS)
    (core / "kernel" / "run.py").write_text("# the reference does not use the kernel", encoding="utf-8")
    assert reference_key(run.model, run.inputs, SETTINGS, core) == before
    (core / name).write_text((core / name).read_text(encoding="utf-8") + "\n", encoding="utf-8")
    assert reference_key(run.model, run.inputs, SETTINGS, core) != before


# The comparison


def test_partners_among_transitions():
    ours = [Transition(0.1, 0, 1, 0), Transition(0.2, 0, 0, 1), Transition(0.2, 1, 1, 0), Transition(0.4, 0, 1, 0)]
    assert apart(ours, ours) == (0, 0.0)
    later = [Transition(t.time + 1e-5, t.string, t.before, t.after) for t in ours]
    assert apart(ours, later) == (0, pytest.approx(1e-5))
    assert apart(ours, later[1:]) == (1, pytest.approx(1e-5))
    assert apart(ours, [*ours, Transition(0.15, 0, 1, 0)]) == (1, 0.0)
    assert apart(ours, []) == (4, 0.0)


def apart(ours, theirs):
    """How many have no partner, and how far the partners are apart, s."""
    found = match(ours, theirs)
    return len(found.ours) + len(found.theirs), max((abs(a.time - b.time) for a, b in found.pairs), default=0.0)


@pytest.fixture
def compared():
    """A kernel run as if it were an FMU's, beside itself as the reference; compare(change) after change(series)."""
    run = short(scene("three_bar_nsh"), 0.2)
    result, (allowed, _) = kernel.simulate(run.model, run.inputs), spreads(run.model, run.inputs, validate.START_ERROR)
    columns = {}
    for row in variables(run.model):
        if row.causality == "output":
            columns.setdefault(row.field, []).append(row.name)

    def judge(change=lambda fmu: None, growth=1.0):
        model, flat = run.model, []
        axes = list(model.axes)
        for field in columns:
            values = getattr(result, field)
            if field in ("position", "velocity", "reaction"):
                nodes = {"velocity": model.free_nodes, "reaction": model.fixed_nodes}.get(field, slice(None))
                values = values[:, nodes][:, :, axes]
            flat.append(np.asarray(values, dtype=float).reshape(len(result.times), -1))
        names = [name for field in columns.values() for name in field]
        fmu = series(model, variables(model), names, np.hstack(flat))
        change(fmu)
        grown = replace(allowed, largest={name: growth * values for name, values in allowed.largest.items()})
        return compare.compare(result, fmu, result.transitions, grown, float(model.bar_length.max()))

    return judge


def test_equal_runs_have_no_errors(compared):
    found = compared()
    assert (found.part, found.position, found.force, found.largest("energy"), found.unmatched) == (0.0, 0.0, 0.0, 0.0, 0)
    assert found.failures == [] and found.transitions[0] > 0 and found.until == 0.2


def test_bounds_are_what_a_start_error_makes():
    """A run whose start is off by half of what is allowed passes; one that is off by ten times that does not."""
    run = short(scene("three_bar_nsh"), 0.2)
    result, (allowed, wide) = kernel.simulate(run.model, run.inputs), spreads(run.model, run.inputs, validate.START_ERROR)
    assert wide.size == pytest.approx(500.0 * allowed.size)
    for factor, passes in ((0.5, True), (10.0, False)):
        off = kernel.simulate(*sensitivity.disturbed(run.model, run.inputs, factor * validate.START_ERROR)[2], tolerance=1e-12)
        fmu = {name: getattr(off, name) for name in FMU_SERIES}
        found = compare.compare(result, fmu, off.transitions, allowed, float(run.model.bar_length.max()))
        assert (found.failures == []) == passes and found.part == pytest.approx(0.5 * factor, rel=0.5)


def test_errors_past_their_bounds_fail(compared):
    def shift(field, by, row=-1):
        def change(fmu):
            fmu[field].reshape(len(fmu[field]), -1)[row, 0] += by

        return compared(change).failures

    bounds = {name: compared().deviations[name].bound for name in ("position", "reaction", "bar_force", "elastic_force")}
    assert 1e-9 < bounds["position"] < 1e-7 and 1e-6 < bounds["reaction"] < 1e-3
    for name, bound in bounds.items():
        words = name.replace("_", " ")
        assert shift(name, 0.9 * bound, row=0) == [] and f"{words} error" in shift(name, -1.1 * bound, row=0)[0]
    assert "position error" in shift("position", np.nan)[0]
    assert "energy ledger" in " ".join(shift("dissipated", 1e-3, row=slice(5, None)))


@pytest.mark.parametrize("field", ["velocity", "string_length", "kinetic", "snapped"])
def test_every_output_is_judged(compared, field):
    def change(fmu):
        fmu[field] = fmu[field] + 1 if field == "snapped" else fmu[field] + 1e-3

    failures = compared(change).failures
    assert failures and ("snapped" in failures[0] or "error" in failures[0])


def judged(fmu, model, runs, wrong=None, cache=None, runtime="python", say=lambda text: None):
    """A validation in this process.  wrong: under what the FMU runs instead."""
    outside = validate.run_outside(fmu, model, runs=validate.repeated(wrong or runs))
    started = validate.submit(Here(), runs, cache)
    return validate.finish(model, runtime, runs, outside, started, Here(), cache, say)


@pytest.mark.parametrize("factor", [3.0, 1.0 + 1e-5])
def test_an_fmu_with_wrong_physics_fails(factor, fmus):
    """What the FMU does must not decide how long it is compared, and a tighter reference does not clear it."""
    model = scene("three_bar")
    run = short(model, 0.3)
    wrong = replace(run, model=replace(run.model, damping=factor * run.model.damping))
    found = judged(fmus["three_bar"], model, [run], [wrong])
    assert found.cut == [] and found.runs[0].again
    assert any("position error" in failure and "at a tolerance of" in failure for failure in found.failures)


def test_an_fmu_that_is_loose_by_itself_fails(fmus):
    """Its own tolerance is judged, too: with 1e-4 it is not what it promises, though its equations are right."""
    model = scene("three_bar")
    run, promised = short(model, 0.3), validate.repeated

    def loose(runs):
        return [replace(one, tolerance=1e-4) for one in runs] + promised(runs)[len(runs) :]

    outside = validate.run_outside(fmus["three_bar"], model, runs=loose([run]))
    found = validate.finish(model, "python", [run], outside, validate.submit(Here(), [run], None), Here(), None)
    assert found.failures and not any("a tolerance of" in failure for failure in found.failures)


def test_the_own_tolerance_and_the_tight_one_are_shown_and_the_progress(fmus, tmp_path):
    model, lines = scene("two_bar"), []
    found = judged(fmus["two_bar"], model, [short(model)], say=lines.append)
    assert found.failures == [] and found.runs[0].tight.part < 1.0
    (line,) = lines
    assert line.startswith("  two_bar, python: lift at d/10, 0.1 s: ") and "% of the bounds; reference in " in line
    write_report(found, tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "its own" in page and "1e-12" in page and "rtol 1e-12, atol 1e-13 m" in page


CROSS = """
plane = "xz"
start = "released"
gravity = 0.0
[nodes]
n1 = [-0.5, 0.0]
n2 = [0.5, 0.0]
n3 = [0.0, -0.5]
n4 = [0.0, 0.5]
[bars]
b1 = { nodes = ["n1", "n2"], mass = 1.0 }
b2 = { nodes = ["n3", "n4"], mass = 1.0 }
[strings]
s1 = { nodes = ["n1", "n3"], stiffness = 100.0, damping = 0.0 }
s2 = { nodes = ["n3", "n2"], stiffness = 100.0, damping = 0.0 }
s3 = { nodes = ["n2", "n4"], stiffness = 100.0, damping = 0.0 }
s4 = { nodes = ["n4", "n1"], stiffness = 100.0, damping = 0.0 }
[prestress.rest_length]
s1 = 0.495
s2 = 0.35355
s3 = 0.495
s4 = 0.35355
"""


def test_a_healthy_undamped_cross_bar_passes(tmp_path):
    """Under 5 s of the article's inputs, too, where a start error grows a thousandfold."""
    (tmp_path / "cross.toml").write_text(CROSS, encoding="utf-8")
    model = build_model(load_scene(tmp_path / "cross.toml"))
    runs = trials(model) + [run for run in scenarios(model) if run.name == "rest_lengths_1d"]
    found = judged(pack_native_fmu(model, tmp_path / "cross.fmu"), model, runs)
    assert found.failures == [] and max(run.comparison.growth for run in found.runs) > 100.0


def test_a_failed_comparison_is_repeated_with_a_tighter_reference(tmp_path, monkeypatch):
    """A loose reference passes bounds by itself; the tighter one clears the FMU."""
    monkeypatch.setattr(validate, "SETTINGS", {"rtol": 1e-6, "atol": 1e-7})
    monkeypatch.setattr(validate, "TIGHTER", {"rtol": 1e-12, "atol": 1e-13})
    model = scene("two_bar")
    fmu = pack_native_fmu(model, tmp_path / "two_bar.fmu")
    found = judged(fmu, model, [short(model)], cache=tmp_path / "cache")
    assert found.failures == [] and found.runs[0].again and len(list((tmp_path / "cache").iterdir())) == 2


def test_a_tighter_reference_that_cannot_go_on_clears_nobody(monkeypatch):
    run = short(scene("two_bar"), 0.02)
    result = kernel.simulate(run.model, run.inputs)
    fmu = {name: getattr(result, name) + (name == "position") for name in FMU_SERIES}
    started, calls = validate.submit(Here(), [run], None), []

    def give_up(*arguments, **settings):
        calls.append(settings["rtol"])
        raise SimulationError("stalled", "no progress", 0.01)

    monkeypatch.setattr(reference, "simulate", give_up)
    outside = 3 * [(fmu, result.transitions, 1e-4)]
    found = validate.finish(run.model, "native", [run], outside, started, Here(), None)
    assert "a short lift: position error" in found.failures[0]
    assert calls == [1e-13]


def test_runs_are_compared_as_long_as_their_sensitivity_allows(compared):
    assert compared(growth=1e3).until == 0.2
    assert 0.0 < compared(growth=1e6).until < 0.2
    assert compared(growth=1e8).until == 0.0


def test_speed_is_measured(fmus):
    found = measure(fmus["three_bar_nsh"], h=1e-3, duration=0.02, repeats=1)
    assert found.step > 0.0 and found.step * found.factor == pytest.approx(1e-3)


# The command


@pytest.fixture
def brief(monkeypatch):
    """Validation under one short scenario instead of the long ones, in this process."""
    monkeypatch.setattr(judgement, "trials", lambda model: [short(model)])
    monkeypatch.setattr(judgement, "workers", Here)


def test_build_and_validate(brief, tmp_path, capsys):
    options = ["two_bar_nsh", "--output", str(tmp_path / "out"), "--cache", str(tmp_path / "cache")]
    assert build_fmu.main(options) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("two_bar_nsh")]
    assert [line.split()[1] for line in lines] == ["native", "python"]
    assert all(" m " in line and " N " in line and " us " in line and line.endswith("x") for line in lines)
    for runtime in ("native", "python"):
        folder = tmp_path / "out" / runtime
        assert {path.name for path in folder.iterdir()} == {"two_bar_nsh.fmu", "two_bar_nsh.html"}
        page = (folder / "two_bar_nsh.html").read_text(encoding="utf-8")
        assert f"Validation of two_bar_nsh, {runtime} FMU" in page
        assert "a short lift" in page and "data:image/png;base64," in page and "Every bound holds." in page
        assert "http" not in page.replace("data:image", "").split("</style>")[1].split("Made with")[0]
    assert len(list((tmp_path / "cache").iterdir())) == 1
    assert build_fmu.main([*options, "--runtime", "python"]) == 0
    assert "from the cache" in (tmp_path / "out/python/two_bar_nsh.html").read_text(encoding="utf-8")


def test_an_fmu_of_fmi_3_is_validated_in_both_kinds(brief, tmp_path, capsys):
    """Table and reports say which version it is of; co-simulation is run in Event Mode and with steps that end early, too."""
    words = ["two_bar_nsh", "--fmi", "3.0", "--kind", "both", "--no-page", "--output", str(tmp_path), "--no-cache"]
    assert build_fmu.main(words) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("two_bar_nsh  ")]
    assert [" ".join(line.split()[1:5]) for line in lines] == ["both: cs, FMI 3.0", "both: me, FMI 3.0"]
    reports = sorted(path for path in (tmp_path / "both-fmi3").iterdir() if path.suffix == ".html")
    assert [path.name for path in reports] == ["two_bar_nsh.html", "two_bar_nsh_me.html"]
    for report, kind in zip(reports, ("cs", "me"), strict=True):
        page = report.read_text(encoding="utf-8")
        assert f"Validation of two_bar_nsh, both: {kind}, FMI 3.0 FMU" in page and "Every bound holds." in page


def unmade(say, told):
    """In the place of output.page.parts, where pages cannot be made."""
    raise TensegrityError("the page is built once, which takes: pip install something")


def test_where_no_page_can_be_made_that_is_said_once(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(packs, "parts", unmade)
    assert build_fmu.main(["two_bar", "three_bar", "--no-validate", "--output", str(tmp_path)]) == 0
    told = "note: FMUs and reports come without the page in which the scene moves: "
    assert capsys.readouterr().err == f"{told}the page is built once, which takes: pip install something\n"
    for fmu in tmp_path.rglob("*.fmu"):
        with zipfile.ZipFile(fmu) as archive:
            assert "documentation/live.html" not in archive.namelist()
            assert b"live.html" not in archive.read("documentation/index.html")


@pytest.mark.parametrize("made", [False, True])
def test_a_page_stands_beside_the_reports_where_it_can(made, brief, tmp_path, capsys, monkeypatch):
    parts = (lambda say, told: Parts("@MODEL@", "", "", b"")) if made else unmade
    monkeypatch.setattr(packs, "parts", parts)
    assert build_fmu.main(["two_bar", "--runtime", "native", "--output", str(tmp_path / "ü #1")]) == 0
    report, page = tmp_path / "ü #1" / "native" / "two_bar.html", tmp_path / "ü #1" / "two_bar_live.html"
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == f"such as {(page if made else report).as_uri()}"
    named = [line.split("  ")[-1].strip() for line in lines[lines.index("to be opened in a browser:") + 1 : -1]]
    assert named == [str(report), str(page)][: 1 + made]
    assert page.is_file() == made == ('href="../two_bar_live.html"' in report.read_text(encoding="utf-8"))


def test_a_passed_bound_is_exit_code_1(brief, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(compare, "MARGIN", 0.0)
    monkeypatch.setattr(compare, "FLOOR", 0.0)
    assert build_fmu.main(["two_bar", "--output", str(tmp_path), "--no-cache"]) == 1
    shown = capsys.readouterr().err
    for runtime in ("native", "python"):
        report = tmp_path / runtime / "two_bar.html"
        assert re.search(rf"^FAILED two_bar, {runtime}: a short lift: position error.*; see {report}$", shown, re.MULTILINE)
        assert "Bounds passed" in (tmp_path / runtime / "two_bar.html").read_text(encoding="utf-8")


def test_a_reference_that_cannot_go_on_is_exit_code_1(brief, tmp_path, capsys, monkeypatch):
    def give_up(*_, **__):
        raise SimulationError("stalled", "no progress", 0.01)

    monkeypatch.setattr(reference, "simulate", give_up)
    assert build_fmu.main(["two_bar", "--output", str(tmp_path), "--no-cache"]) == 1
    assert "a short lift: stalled" in capsys.readouterr().err


@pytest.mark.parametrize(
    "words",
    [["no_such_scene"], ["two_bar", "no_such_scene"], [], ["two_bar", "--platforms", "amiga"], ["two_bar", "-x"]],
)
def test_bad_usage_is_exit_code_2_and_nothing_is_written(words, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert build_fmu.main(words) == 2 and list(tmp_path.iterdir()) == []
    (line,) = capsys.readouterr().err.splitlines()
    assert line


@pytest.mark.parametrize(
    "words, told",
    [
        ("--platforms win64,amiga --runtime python", "no platform is called 'amiga'; use linux64, win64"),
        ("--runtime python --sources --cross-check there", "--sources, --cross-check: for native FMUs"),
        ("--no-validate --thorough", "--thorough is a kind of validation"),
        ("--fmi 3.0 --runtime python", "the Python runtime has FMI 2.0 only; give --runtime native"),
        ("--fmi 4.0", "--fmi 4.0: FMUs are not written in that version; use 2.0 or 3.0"),
        ("--fmi 3.0 --detach-actuators --ssp 2.0", "--fmi 3.0 does not go with --ssp; leave --fmi or --ssp out"),
        ("--kind me --simple-types", "--kind me does not go with --simple-types; leave --kind or --simple-types out"),
        ("--cross-check pyproject.toml", "--cross-check pyproject.toml: no such folder can be made"),
        ("--no-binaries --no-validate", "--no-binaries leaves nothing that could run: give --sources, too"),
        ("--no-binaries --sources", "validated: give --no-validate, too"),
        ("--no-binaries --sources --no-validate --platforms win64", "leave --platforms out"),
        ("--no-binaries --sources --no-validate --runtime python", "--sources, --no-binaries: for native FMUs"),
    ],
)
def test_options_that_do_not_go_together_are_refused(words, told, capsys):
    assert build_fmu.main(["two_bar", *words.split()]) == 2
    assert told in capsys.readouterr().err


@pytest.fixture
def asked(monkeypatch):
    """asked(words): the options that a command line comes to."""

    def options(words):
        monkeypatch.setattr(builds, "make", lambda found: kept.append(found) or 0)
        assert build_fmu.main(words) == 0
        return kept.pop()

    kept: list = []
    return options


def test_blanks_between_platforms_do_not_matter(asked):
    assert asked(["two_bar", "--platforms", " linux64, win64 ,"]).platforms == ("linux64", "win64")
    assert asked(["two_bar", "--platforms", "all"]).platforms == tuple(TARGETS)
    assert asked(["two_bar", "--platforms", "x86_64-windows,win64"]).platforms == ("win64",)  # FMI 3.0 calls it so


def test_references_are_kept_unless_asked_otherwise(asked):
    assert asked(["two_bar"]).cache == validate.CACHE
    assert asked(["two_bar", "--cache", "there"]).cache == Path("there")
    assert asked(["two_bar", "--no-cache"]).cache is None


def test_a_scene_that_is_named_twice_is_built_once(asked, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text('extends = "two_bar"\n', encoding="utf-8")
    scenes = ["mine.toml", "two_bar", "two_bar", str(tmp_path / "mine.toml")]
    assert build_fmu.main([*scenes, "--no-validate", "--no-page", "--runtime", "native"]) == 0
    folder = Path("dist/native")
    assert capsys.readouterr().out.splitlines() == [f"wrote {folder / 'mine.fmu'}", f"wrote {folder / 'two_bar.fmu'}"]
    assert asked(["--all", "two_bar"]).scenes.count("two_bar") == 2


def test_two_scenes_of_one_name_are_refused(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text('extends = "two_bar"\nname = "two_bar"\n', encoding="utf-8")
    assert build_fmu.main(["two_bar", "mine.toml", "--no-validate"]) == 2
    assert "two scenes have the name 'two_bar'" in capsys.readouterr().err
    assert not (tmp_path / "dist").exists()


def test_a_remark_names_what_was_compared_for_a_part_only():
    runs = scenarios(scene("two_bar"))
    assert [run.short for run in runs] == [
        "constant at d",
        "square wave at d/10",
        "square wave at d",
        "square wave at 10 d",
        "rest lengths at d",
        "push at d",
    ]

    def validation(**until):
        whole = compare.Comparison(None, 1e-9, {}, 0, 0.0, (0, 0), 0, 0.0, (), 1.0, 5.0, 0)
        deviation = compare.Deviation(0.0, 0.0, 1.0, 0.0)
        whole = replace(whole, deviations=dict.fromkeys(OUTPUTS, deviation))
        made = [validate.Run(run, None, {}, whole, replace(whole, until=until.get(run.name, 5.0)), 1e-4, False) for run in runs]
        return validate.Validation(scene("two_bar"), "native", tuple(made))

    assert judgement.remark(validation()) == ""
    one = validation(square_wave_0_1d=0.24)
    assert judgement.row(one).endswith("x  square wave at d/10 compared until 0.24 s, as far as its sensitivity allows")
    shown = judgement.remark(validation(square_wave_0_1d=0.24, push_1d=1.5))
    assert "d/10 compared until 0.24 s; push at d compared until 1.5 s, as far as their" in shown


def test_a_users_scene(tmp_path, monkeypatch):
    """A scene file in the user's folder, extending a built-in one, is built under its own name."""
    softer = 'extends = "two_bar"\nname = "mine"\ndescription = "softer"\n[materials.cable]\nstiffness = 9e3\n'
    (tmp_path / "mine.toml").write_text(softer, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert build_fmu.main(["mine.toml", "--no-validate", "--naming", "flat"]) == 0
    assert [path.name for path in (tmp_path / "dist" / "python").iterdir()] == ["mine.fmu"]


def test_an_output_that_is_no_folder_is_exit_code_2(tmp_path, capsys):
    (tmp_path / "file").write_text("", encoding="utf-8")
    assert build_fmu.main(["two_bar", "--output", str(tmp_path / "file")]) == 2
    assert "file" in capsys.readouterr().err


def test_a_scene_without_strings_is_validated(tmp_path):
    """A pendulum: one bar pinned to the ground, released at 45 degrees."""
    (tmp_path / "pendulum.toml").write_text(
        'plane = "xz"\nstart = "released"\nfixed = ["n1"]\n[nodes]\nn1 = [0.0, 0.0]\nn2 = [0.7, -0.7]\n'
        '[bars]\nb1 = { nodes = ["n1", "n2"], mass = 1.0 }\n[strings]\n',
        encoding="utf-8",
    )
    model = build_model(load_scene(tmp_path / "pendulum.toml"))
    assert [run.name for run in scenarios(model)] == ["constant_1d", "square_wave_1d", "push_1d"]
    assert [run.name for run in trials(model)] == ["drive_1d", "blows_1d"]
    assert build_fmu.main([str(tmp_path / "pendulum.toml"), "--output", str(tmp_path), "--no-cache"]) == 0


def test_a_bad_users_scene_names_its_key(tmp_path, monkeypatch, capsys):
    (tmp_path / "bad.toml").write_text('extends = "two_bar"\nname = "bad"\n[bars]\nb1.mass = -3.0\n', encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    assert build_fmu.main(["bad.toml"]) == 2
    shown = capsys.readouterr().err
    assert "bad.toml" in shown and "b1.mass" in shown and "-3.0" in shown
    assert [path.name for path in tmp_path.iterdir()] == ["bad.toml"]


def comparison(run, result):
    """Of a run with itself."""
    fmu = {name: getattr(result, name) for name in FMU_SERIES}
    allowed, _ = spreads(run.model, run.inputs, validate.START_ERROR)
    return fmu, compare.compare(result, fmu, result.transitions, allowed, float(run.model.bar_length.max()))


def test_reports_escape_names(tmp_path):
    model = replace(scene("two_bar"), description="<b>& co</b>")
    run = short(model)
    result = kernel.simulate(run.model, run.inputs)
    fmu, found = comparison(run, result)
    odd = replace(run, title="<i>tilted</i>")
    runs = (validate.Run(odd, result, fmu, found, found, 1e-4, False),)
    write_report(validate.Validation(model, "python", runs), tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "<i>" not in page and "<b>" not in page and "&lt;i&gt;tilted" in page


def of_itself(run, name="two_bar"):
    """A validation of one scenario by the kernel's own result."""
    result = kernel.simulate(run.model, run.inputs)
    fmu, found = comparison(run, result)
    return validate.Validation(scene(name), "python", (validate.Run(run, result, fmu, found, found, 1e-4, False),))


def test_the_worst_scenario_is_named_with_its_reason(tmp_path):
    """Of two scenarios, in one of which a tension is off by so much at one instant."""
    right = of_itself(short(scene("two_bar")))
    (good,) = right.runs
    row = 7
    fmu = good.fmu | {"elastic_force": good.fmu["elastic_force"].copy()}
    fmu["elastic_force"][row, 1] += 2.0
    allowed, _ = spreads(good.scenario.model, good.scenario.inputs, validate.START_ERROR)
    bad = compare.compare(good.reference, fmu, good.reference.transitions, allowed, 1.0)
    titled = replace(good.scenario, title="the other lift")
    runs = (good, replace(good, scenario=titled, fmu=fmu, comparison=bad))
    nearest = worst.worst(replace(right, runs=runs))
    assert nearest.run is runs[1] and nearest.output == "elastic_force" and nearest.deviation.time == pytest.approx(0.07)
    first, *others = worst.sentences(nearest)
    assert "\u201cthe other lift\u201d at its own tolerance" in first and "2.0e+00 of" in first and "t = 0.07 s" in first
    assert re.search(r"Its strings make \d+ transitions? in 0.1 s.", others[-1])
    write_report(replace(right, runs=runs), tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    order = [
        "Bounds passed",
        "<h2>The scene",
        "<h2>The worst scenario",
        "<h2>Scenario by scenario",
        "All errors",
    ]
    assert [page.index(part) for part in order] == sorted(page.index(part) for part in order)


@CHROMIUM
def test_a_report_is_read_in_its_folder_alone_and_on_a_phone(tmp_path):
    beside, alone = tmp_path / "ü #1", tmp_path / "alone"
    for folder in (beside / "native", alone):
        folder.mkdir(parents=True)
    live = beside / "two_bar_live.html"
    live.write_text("<!doctype html><title>live</title><p>it moves</p>", encoding="utf-8")
    write_report(of_itself(short(scene("two_bar"))), beside / "native" / "r.html", live)
    shutil.copy(beside / "native" / "r.html", alone)
    shown = "document.querySelector('object p').checkVisibility()"
    with Browser(390, 844, 2.0, touch=True) as phone:
        for folder, falls_back in ((beside / "native", False), (alone, True)):
            phone.open(folder / "r.html", ready="document.readyState === 'complete'")
            phone.wait(f"{shown} === {str(falls_back).lower()}")
            assert phone.run("document.documentElement.scrollWidth") <= 390
            assert "is not there any more" in phone.run("document.querySelector('object').textContent")
        phone.open(beside / "native" / "r.html", ready="document.readyState === 'complete'")
        wide = phone.run("[...document.images].map(i => [i.naturalWidth > 0, i.getBoundingClientRect().width])")
        assert len(wide) == 3 and all(loaded and width <= 390 for loaded, width in wide)


def test_reports_name_every_bound(tmp_path, monkeypatch):
    names = ("MARGIN", "FLOOR", "FLOOR_ENERGY", "LEDGER_BOUND", "SENSITIVE")
    run = short(scene("two_bar"), 0.02)
    result = kernel.simulate(run.model, run.inputs)
    fmu, found = comparison(run, result)
    for i, name in enumerate(names):
        monkeypatch.setattr(compare, name, 0.0101 + i)
    runs = (validate.Run(run, result, fmu, found, found, 1e-4, False),)
    write_report(validate.Validation(run.model, "python", runs), tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    (line,) = re.findall(r"<p>(Each scenario ran at.*?)</p>", page, re.DOTALL)
    for i, name in enumerate(names):
        assert f"{0.0101 + i}" in line, name
    assert [kind for kind in compare.KINDS if f"<th>{kind}," not in page] == ["utilisation"]  # which the scene does not have


# A cache that cannot be used


@pytest.fixture(params=["a file in the way", "below a file", "read-only", "full"])
def useless(request, tmp_path, monkeypatch):
    """A folder in which nothing can be kept."""
    folder = tmp_path / "cache"
    if request.param == "a file in the way":
        folder.write_text("", encoding="utf-8")
    elif request.param == "below a file":
        (tmp_path / "file").write_text("", encoding="utf-8")
        folder = tmp_path / "file" / "cache"
    else:  # whoever runs the tests may be allowed to write everywhere
        code = errno.EROFS if request.param == "read-only" else errno.ENOSPC

        def refuse(*_, **__):
            raise OSError(code, os.strerror(code))

        monkeypatch.setattr("fmu_src.validation.reference_cache.write", refuse)
    return folder


def test_a_useless_cache_is_told_first_and_does_no_harm(useless, result, brief, tmp_path, capsys):
    _run, computed = result
    assert (str(useless) in trouble(useless) and trouble(None) is None and trouble(tmp_path) is None) or useless.name == "cache"
    told = []
    assert cached(useless, "0" * 64, lambda: computed, told.append) == (computed, False)
    assert len(told) == 1 and str(useless) in told[0]
    assert build_fmu.main(["two_bar", "--output", str(tmp_path / "out"), "--cache", str(useless)]) == 0
    shown = capsys.readouterr()
    assert shown.err.count("note: reference runs cannot be kept in") == 1 and "Traceback" not in shown.err
    assert "two_bar         native" in shown.out


def test_a_cache_that_can_only_be_read_is_read(result, tmp_path, monkeypatch):
    _run, computed = result
    cached(tmp_path, "1" * 64, lambda: computed)
    monkeypatch.setattr("fmu_src.validation.reference_cache.write", lambda *_: pytest.fail("written to"))
    assert cached(tmp_path, "1" * 64, lambda: pytest.fail("computed although cached"))[1]


def test_what_a_failed_write_began_is_removed(result, tmp_path, monkeypatch):
    _run, computed = result

    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.replace", refuse)
    told = []
    cached(tmp_path, "2" * 64, lambda: computed, told.append)
    assert "No space left" in told[0] and list(tmp_path.iterdir()) == []
