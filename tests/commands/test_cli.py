"""The subcommands `simulate`, `animate` and `tower`: what they write, and what they refuse."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fmu_src.variables.interface import variables
from tensegrity_core.cli import main
from tensegrity_core.kernel import simulate
from tensegrity_core.model import grid, held
from tensegrity_core.output.run_summary import end_of_run
from tensegrity_core.scene import load_scene
from tensegrity_core.scene.towers import tower
from tensegrity_core.statics import build_model
from tests.support import scene

ROOT = Path(__file__).resolve().parents[2]
SHORT = ["--duration", "0.2", "--step", "0.05"]


def lifted(name):
    """The run that `simulate NAME --force n4.z=45 n4.x=-3` with SHORT makes."""
    model = scene(name)
    force = np.zeros((len(model.nodes), 3))
    force[model.node_names.index("n4")] = -3.0, 0.0, 45.0
    return model, simulate(model, held(model, grid(0.2, 0.05), force=lambda t: force))


@pytest.mark.parametrize("name", ["two_bar_nsh", "three_bar_nsh"])
def test_csv_has_the_names_of_the_fmus_outputs_and_every_digit(name, tmp_path, capsys):
    path = tmp_path / "run.csv"
    assert main(["simulate", name, "--force", "n4.z=45", "n4.x=-3", *SHORT, "--output", str(path)]) == 0
    model, expected = lifted(name)
    header, *rows = path.read_text(encoding="utf-8").splitlines()
    outputs = [row.name for row in variables(model) if row.causality == "output"]
    assert header.split(",") == ["time", *outputs]
    values = dict(zip(header.split(","), np.array([row.split(",") for row in rows], dtype=float).T))
    np.testing.assert_array_equal(values["time"], expected.times)
    np.testing.assert_array_equal(values["n4.z"], expected.position[:, 3, 2])
    np.testing.assert_array_equal(values["s2.force"], expected.string_force[:, 1])
    np.testing.assert_array_equal(values["n1.reaction.x"], expected.reaction[:, 0, 0])
    np.testing.assert_array_equal(values["n4.velocity.z"], expected.velocity[:, 3, 2])
    shown = capsys.readouterr().out
    assert f"{expected.position[-1, 3, 2]:.6f}" in shown and str(path) in shown


def test_npz_has_the_fields_of_the_result(tmp_path):
    path = tmp_path / "run.npz"
    assert main(["simulate", "three_bar_nsh", "--force", "n4.z=45", "n4.x=-3", *SHORT, "--output", str(path)]) == 0
    model, expected = lifted("three_bar_nsh")
    with np.load(path, allow_pickle=False) as stored:
        for name in ("times", "position", "velocity", "string_force", "bar_force", "reaction", "snapped", "dissipated"):
            np.testing.assert_array_equal(stored[name], getattr(expected, name), err_msg=name)
        assert stored["string_names"].tolist() == list(model.string_names)
        assert stored["transitions"]["time"].tolist() == [t.time for t in expected.transitions]
        assert len(stored["transitions"])


def test_the_force_option_repeats(tmp_path):
    once, twice = tmp_path / "a.csv", tmp_path / "b.csv"
    assert main(["simulate", "two_bar", "--force", "n4.z=45", "n3.x=5", *SHORT, "--output", str(once)]) == 0
    split = ["--force", "n4.z=45", "--force", "n3.x=5"]
    assert main(["simulate", "two_bar", *split, *SHORT, "--output", str(twice)]) == 0
    assert once.read_bytes() == twice.read_bytes()


def test_without_forces_the_structure_stays(capsys):
    assert main(["simulate", "two_bar", *SHORT]) == 0
    assert "n3: 0.826000, 0.985000" in capsys.readouterr().out


def test_method_and_tolerance_reach_the_kernel(capsys):
    steps = []
    for options in (["--tolerance", "1e-4"], ["--tolerance", "1e-12"], ["--method", "rodas5p", "--tolerance", "1e-12"]):
        assert main(["simulate", "three_bar_nsh", "--force", "n4.z=45", *SHORT, *options]) == 0
        steps.append(int(capsys.readouterr().out.split(" s in ")[1].split(" steps")[0]))
    assert steps[0] < steps[1] < steps[2]


def test_animate_films_at_the_given_speed(tmp_path, capsys):
    path = tmp_path / "film.gif"
    options = ["--duration", "0.4", "--speed", "2", "--fps", "20", "--output", str(path)]
    assert main(["animate", "two_bar_nsh", "--force", "n4.z=45", *options]) == 0
    with Image.open(path) as film:
        assert (film.n_frames, film.info["duration"]) == (5, 50)
    assert "5 frames" in capsys.readouterr().out


BAD = {
    "unknown node": (["--force", "n9.z=1"], ["n9.z=1", "'n9'", "n3, n4"]),
    "fixed node": (["--force", "n1.z=1"], ["n1 is fixed", "n3, n4"]),
    "axis outside the plane": (["--force", "n3.y=1"], ["'y'", "x, z"]),
    "no number": (["--force", "n3.z=much"], ["'much'", "n3.z=45"]),
    "not a finite force": (["--force", "n3.z=nan"], ["'nan'", "n3.z=45"]),
    "infinite force": (["--force", "n3.z=1e400"], ["'1e400'"]),
    "no equals sign": (["--force", "n3.z"], ["n3.z", "NODE.AXIS=N"]),
    "no axis": (["--force", "n3=1"], ["n3=1", "NODE.AXIS=N"]),
    "one component twice": (["--force", "n4.z=40", "n3.x=1", "n4.z=5"], ["n4.z=5", "twice", "n4.z=40"]),
    "negative duration": (["--duration", "-1"], ["--duration = -1.0", "greater than 0"]),
    "duration is no number": (["--duration", "nan"], ["--duration = nan"]),
    "bad tolerance": (["--tolerance", "0"], ["--tolerance = 0.0"]),
    "tolerance out of range": (["--tolerance", "5"], ["tolerance", "5.0", "0.1"]),
}


@pytest.mark.parametrize("command, output", [("simulate", "run.csv"), ("animate", "film.gif")])
@pytest.mark.parametrize("options, words", BAD.values(), ids=BAD)
def test_bad_input_is_named_and_nothing_is_written(command, output, options, words, tmp_path, capsys):
    assert main([command, "two_bar", *options, "--output", str(tmp_path / output)]) == 2
    captured = capsys.readouterr()
    assert not captured.out
    assert len(captured.err.splitlines()) == 1
    for word in words:
        assert word in captured.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "command, options, words",
    [
        ("simulate", ["--step", "0"], ["--step = 0.0"]),
        ("simulate", ["--duration", "1", "--step", "0.3"], ["no multiple", "0.3 s", "give 0.9"]),
        ("simulate", ["--duration", "1", "--step", "1e-9"], ["1e+09 samples", "1000000"]),
        ("animate", ["--fps", "0"], ["--fps = 0"]),
        ("animate", ["--fps", "60"], ["--fps = 60", "50"]),
        ("animate", ["--speed", "inf"], ["--speed = inf"]),
    ],
)
def test_bad_sampling_is_named(command, options, words, tmp_path, capsys):
    output = tmp_path / {"simulate": "run.csv", "animate": "film.gif"}[command]
    assert main([command, "two_bar", *options, "--output", str(output)]) == 2
    shown = capsys.readouterr().err
    for word in words:
        assert word in shown
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "command, output, words",
    [
        ("simulate", "run.txt", [".parquet or .npz"]),
        ("simulate", "none/run.csv", ["does not exist", "none"]),
        ("simulate", "folder.csv", ["is a folder"]),
        ("animate", "film.mp4", [".gif"]),
    ],
)
def test_bad_outputs_are_refused_before_the_run(command, output, words, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("tensegrity_core.kernel.simulate", lambda *_: pytest.fail("it ran"))
    (tmp_path / "folder.csv").mkdir()
    assert main([command, "two_bar", "--output", str(tmp_path / output)]) == 2
    shown = capsys.readouterr().err
    for word in words:
        assert word in shown
    assert [p.name for p in tmp_path.iterdir()] == ["folder.csv"]


def test_unknown_scene_exits_with_2(tmp_path, capsys):
    assert main(["simulate", "three_bars", "--output", str(tmp_path / "run.csv")]) == 2
    assert "Did you mean three_bar?" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command, output", [("check", []), ("simulate", []), ("animate", ["--output", "film.gif"])])
def test_a_scene_without_its_ending_is_guessed(command, output, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mast.toml").write_text("", encoding="utf-8")
    assert main([command, "mast", *output]) == 2
    assert "did you mean mast.toml?" in capsys.readouterr().err


def test_zero_has_no_sign(capsys):
    model = scene("two_bar")
    result = simulate(model, held(model, grid(0.2, 0.05)))
    result.position[-1, 0], result.string_force[-1] = -1e-17, -0.0
    shown = end_of_run(model, result)
    assert "n1: 0.000000, 0.000000" in shown and "s1: 0\n" in shown and "-0" not in shown


def test_a_reader_that_leaves_ends_it_quietly():
    command = [sys.executable, "-m", "tensegrity_core.cli", "schema"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd=ROOT) as process:
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0


# --- tower -------------------------------------------------------------------------------------------------------


def test_tower_writes_the_scene_that_the_generator_makes(tmp_path, capsys):
    path = tmp_path / "made.toml"
    options = ["--gravity", "0.5", "--tension", "60", "--stiffness", "7000", "--damping", "30", "--mass", "0.8"]
    assert main(["tower", "4", "--nsh", *options, "--output", str(path)]) == 0
    assert f"12 bars written to {path}" in capsys.readouterr().out
    assert [p.name for p in tmp_path.iterdir()] == ["made.toml"]
    made = tower(4, nsh=True, gravity=0.5, tension=60.0, stiffness=7000.0, damping=30.0, mass=0.8)
    ours, read = build_model(made), build_model(load_scene(path))
    for name in ("nodes", "bars", "strings", "rest_length", "stiffness", "damping", "bar_mass"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(read, name), err_msg=name)
    assert (ours.nsh, ours.gravity) == (read.nsh, read.gravity)


def test_tower_prints_without_a_file_and_its_scene_can_be_checked_and_run(tmp_path, capsys):
    assert main(["tower", "3"]) == 0
    path = tmp_path / "edited.toml"
    path.write_text(capsys.readouterr().out.replace("mass = 1.0", "mass = 2.0"), encoding="utf-8")
    assert main(["check", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "bars: 9, strings: 36" in shown and "self-stress states: 1, mechanisms: 1" in shown and ", stable (" in shown
    assert main(["simulate", str(path), *SHORT]) == 0
    assert set(build_model(load_scene(path)).bar_mass) == {2.0}


def test_check_says_what_is_no_equilibrium(tmp_path, capsys):
    """A bar released on its side: half of its weight, across it, is balanced by nothing."""
    path = tmp_path / "fall.toml"
    path.write_text(
        'name = "fall"\nplane = "xz"\nstart = "released"\nfixed = ["a"]\n'
        '[nodes]\na = [0.0, 0.0]\nb = [0.6, 0.8]\n[bars]\nrod = { nodes = ["a", "b"], mass = 10.0 }\n',
        encoding="utf-8",
    )
    assert main(["check", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "start: released, not an equilibrium: up to 29.4 N stay unbalanced, at b" in shown  # m g/2 times 0.6
    assert "stable" not in shown and "lowest stiffness" not in shown
    assert main(["modes", str(path)]) == 0
    assert "not an equilibrium: up to 29.4 N stay unbalanced, at b" in capsys.readouterr().out


def test_check_of_a_large_tower_shows_ranges(tmp_path, capsys):
    path = tmp_path / "tall.toml"
    assert main(["tower", "120", "--output", str(path)]) == 0
    assert main(["check", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "no self-stress states and mechanisms: tower120: " in shown and "here are 2151" in shown
    force = shown.split("strings: ")[-1].split()
    assert 5.0 < float(force[0]) < float(force[2]) < 42.0
    assert len(shown.splitlines()) < 12


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["0"], ["stages = 0", "1 to 1000"]),
        (["1", "--tension", "3"], ["tension = 3.0", "one stage"]),
        (["3", "--gravity", "nan"], ["gravity = nan", "not a finite number"]),
        (["3", "--output", "made.txt"], ["made.txt", ".toml"]),
    ],
)
def test_bad_towers_are_named_and_nothing_is_written(arguments, words, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["tower", *arguments]) == 2
    shown = capsys.readouterr()
    for word in words:
        assert word in shown.err
    assert not shown.out and not list(tmp_path.iterdir())
