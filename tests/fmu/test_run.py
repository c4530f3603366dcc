"""The subcommand `run`: an FMU over inputs from a file gives what `simulate` gives over the same file."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tensegrity_core.cli import main
from tensegrity_core.output import series

INPUTS = "time,n4.force.z,s4.rest_length,n4.z\n0,0,1.0,7\n0.1,0,1.0,7\n0.1,45,1.0,7\n0.3,20,0.95,7\n"
SHORT = ["--duration", "0.3", "--step", "0.02"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """In it in.csv, and both FMUs of three_bar_nsh."""
    folder = tmp_path_factory.mktemp("ü #1")
    (folder / "in.csv").write_text(INPUTS, encoding="utf-8")
    assert main(["build", "three_bar_nsh", "--no-validate", "--output", str(folder)]) == 0
    return folder


@pytest.mark.parametrize("runtime", ["native", "python"])
def test_an_fmu_gives_what_the_scene_gives(runtime, folder, tmp_path):
    fmu, inputs = str(folder / runtime / "three_bar_nsh.fmu"), ["--inputs", str(folder / "in.csv")]
    assert main(["run", fmu, *inputs, *SHORT, "--output", str(tmp_path / "fmu.nc")]) == 0
    assert main(["simulate", "three_bar_nsh", *inputs, *SHORT, "--output", str(tmp_path / "scene.nc")]) == 0
    found, expected = series.read(tmp_path / "fmu.nc"), series.read(tmp_path / "scene.nc")
    assert found.attrs["model"] == "three_bar_nsh" and found["n4.z"].attrs["units"] == "m"
    assert np.ptp(found["n4.z"].values) > 1e-3
    assert {str(name) for name in expected if not str(name).startswith("transition.")} == set(found)
    for name in found:
        np.testing.assert_allclose(found[name].values, expected[name].values, rtol=1e-12, atol=1e-12, err_msg=str(name))


@pytest.mark.parametrize("naming", ["structured", "flat"])
def test_an_fmu_of_fmi_3_gives_what_that_of_fmi_2_gives(naming, folder, tmp_path, capsys):
    """Elements of arrays have numbers; a file may call them by their axes, as FMI 2.0 does, or by numbers."""
    build = ["build", "three_bar_nsh", "--no-validate", "--no-page", "--naming", naming, "--output", str(tmp_path)]
    assert main([*build, "--fmi", "3.0"]) == 0
    numbered = INPUTS.replace("n4.force.z", "n4.force[3]" if naming == "structured" else "n4_force[3]")
    (tmp_path / "numbered.csv").write_text(numbered, encoding="utf-8")
    fmus, ends = [folder / "native" / "three_bar_nsh.fmu", tmp_path / "native-fmi3" / "three_bar_nsh.fmu"], []
    for fmu, file in ((fmus[0], folder / "in.csv"), (fmus[1], folder / "in.csv"), (fmus[1], tmp_path / "numbered.csv")):
        capsys.readouterr()
        words = ["--inputs", str(file), "--set", "s1.nsh.h[2]=0.016", "solver.method=rk4", *SHORT, "--json"]
        assert main(["run", str(fmu), *words]) == 0
        ends.append(list(json.loads(capsys.readouterr().out)["outputs"].items()))
    assert ends[1] == ends[2] and [value for _, value in ends[0]] == [value for _, value in ends[1]]
    assert ("n4.position[3]" if naming == "structured" else "n4_position[3]") in dict(ends[1])


def test_an_fmu_without_a_solver_is_refused_with_a_remedy(tmp_path, capsys):
    assert main(["build", "two_bar", "--kind", "me", "--no-validate", "--no-page", "--output", str(tmp_path)]) == 0
    assert main(["run", str(tmp_path / "me" / "two_bar.fmu"), *SHORT]) == 2
    assert "for model exchange only, and has no solver; build it with --kind cs or both" in capsys.readouterr().err


def test_start_values_reach_the_fmu(folder, capsys):
    ends = []
    for words in ([], ["--set", "gravity=0", "b1.mass=3"], ["--set", "gravity=0", "--set", "b1.mass=3"]):
        assert main(["run", str(folder / "native" / "three_bar_nsh.fmu"), *words, *SHORT, "--json"]) == 0
        ends.append(json.loads(capsys.readouterr().out)["outputs"]["n4.z"])
    assert ends[0] != ends[1] == ends[2]


def test_names_may_be_flat_or_structured(folder, tmp_path):
    """Whichever the FMU has, and whichever the file."""
    assert (
        main(["build", "three_bar_nsh", "--no-validate", "--runtime", "native", "--naming", "flat", "--output", str(tmp_path)])
        == 0
    )
    flat = INPUTS.partition("\n")[0].replace(".", "_") + INPUTS[INPUTS.index("\n") :]
    (tmp_path / "flat.csv").write_text(flat, encoding="utf-8")
    ends = []
    for fmu in (folder, tmp_path):
        for inputs in (folder / "in.csv", tmp_path / "flat.csv"):
            words = ["run", str(fmu / "native" / "three_bar_nsh.fmu"), "--inputs", str(inputs), *SHORT]
            assert main([*words, "--set", "b1.mass=2", "b2_mass=3", "--output", str(tmp_path / "run.csv")]) == 0
            ends.append((tmp_path / "run.csv").read_text(encoding="utf-8").partition("\n")[2])
    assert ends[0] == ends[1] == ends[2] == ends[3] and len(ends[0].splitlines()) == 16


@pytest.mark.parametrize("runtime, options", [("native", ()), ("python", ()), ("native", ("--simple-types",))])
def test_a_method_is_set_by_its_name(runtime, options, tmp_path, capsys):
    build = ["build", "two_bar", "--no-validate", "--runtime", runtime, *options, "--output", str(tmp_path)]
    assert main(build) == 0
    ends = {}
    for method in ("rk4", "4", "radau9"):
        capsys.readouterr()
        fmu = str(tmp_path / runtime / "two_bar.fmu")
        assert main(["run", fmu, "--set", f"solver.method={method}", "s1.rest_length=0.8", *SHORT, "--json"]) == 0
        ends[method] = json.loads(capsys.readouterr().out)["outputs"]["n4.z"]
    assert ends["rk4"] == ends["4"] != ends["radau9"]
    for text, told in {"rk5": "did you mean rk4?", "1.5": "takes whole numbers only", "9": "refused"}.items():
        assert main(["run", fmu, "--set", f"solver.method={text}", *SHORT]) == 2
        assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    "words, told",
    [
        (["in.csv"], "no FMU that can be read"),
        (["nowhere.fmu"], "nowhere.fmu is not there"),
        (["FMU", "--set", "gravty=1"], "did you mean gravity?"),
        (["FMU", "--set", "gravity"], "NAME=X"),
        (["FMU", "--set", "gravity=1", "gravity=2"], "gravity is given twice"),
        (["FMU", "--set", "gravity=much"], "'much' is not a finite number"),
        (["FMU", "--inputs", "typing.csv"], "did you mean n4.force.z?"),
        (["FMU", "--inputs", "other.csv"], "no column is an input of three_bar_nsh"),
        (["FMU", "--inputs", "negative.csv"], "s4.rest_length"),
        (["FMU", "--inputs", "twice.csv"], "column n4_force_z stands twice"),
        (["FMU", "--output", "run.txt"], "does not end in .nc or .parquet or .csv"),
    ],
)
def test_what_is_wrong_is_named_and_nothing_is_written(words, told, folder, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    (folder / "typing.csv").write_text("time,n4.force.zz,n5.force.z\n0,1,1\n", encoding="utf-8")
    (folder / "twice.csv").write_text("time,n4.force.z,n4_force_z\n0,1,1\n", encoding="utf-8")
    (folder / "other.csv").write_text("time,n4.z\n0,1\n", encoding="utf-8")
    (folder / "negative.csv").write_text("time,s4.rest_length\n0,-1\n", encoding="utf-8")
    before = sorted(folder.rglob("*"))
    words = [str(folder / "native" / "three_bar_nsh.fmu") if word == "FMU" else word for word in words]
    assert main(["run", *words, *SHORT]) == 2
    captured = capsys.readouterr()
    assert told in captured.err.splitlines()[-1] and not captured.out
    assert sorted(folder.rglob("*")) == before
