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


def test_start_values_reach_the_fmu(folder, capsys):
    ends = []
    for words in ([], ["--set", "gravity=0", "b1.mass=3"], ["--set", "gravity=0", "--set", "b1.mass=3"]):
        assert main(["run", str(folder / "native" / "three_bar_nsh.fmu"), *words, *SHORT, "--json"]) == 0
        ends.append(json.loads(capsys.readouterr().out)["outputs"]["n4.z"])
    assert ends[0] != ends[1] == ends[2]


@pytest.mark.parametrize(
    "words, told",
    [
        (["in.csv"], "no FMU that can be read"),
        (["nowhere.fmu"], "no FMU that can be read"),
        (["FMU", "--set", "gravty=1"], "did you mean gravity?"),
        (["FMU", "--set", "gravity"], "NAME=X"),
        (["FMU", "--set", "gravity=1", "gravity=2"], "gravity is given twice"),
        (["FMU", "--set", "gravity=much"], "'much' is not a finite number"),
        (["FMU", "--inputs", "typing.csv"], "did you mean n4.force.z?"),
        (["FMU", "--inputs", "other.csv"], "no column is an input of three_bar_nsh"),
        (["FMU", "--inputs", "negative.csv"], "s4.rest_length"),
        (["FMU", "--output", "run.txt"], "does not end in .nc or .parquet or .csv"),
    ],
)
def test_what_is_wrong_is_named_and_nothing_is_written(words, told, folder, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    (folder / "typing.csv").write_text("time,n4.force.zz,n5.force.z\n0,1,1\n", encoding="utf-8")
    (folder / "other.csv").write_text("time,n4.z\n0,1\n", encoding="utf-8")
    (folder / "negative.csv").write_text("time,s4.rest_length\n0,-1\n", encoding="utf-8")
    before = sorted(folder.rglob("*"))
    words = [str(folder / "native" / "three_bar_nsh.fmu") if word == "FMU" else word for word in words]
    assert main(["run", *words, *SHORT]) == 2
    captured = capsys.readouterr()
    assert told in captured.err.splitlines()[-1] and not captured.out
    assert sorted(folder.rglob("*")) == before
