"""The subcommands `path` and `modes`: what they print, write and draw, and what they refuse."""

from __future__ import annotations

import csv

import numpy as np
import pytest
from PIL import Image

from tensegrity_core import statics
from tensegrity_core.cli import main
from tensegrity_core.equilibria import modes, steady_states
from tensegrity_core.equilibria.loading import Loading
from tests.support import push, scene

LIFT = ["--force", "n3.z=1", "n4.z=1"]


def rows(path):
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_path_writes_states_there_and_back(tmp_path, capsys):
    table, figure = tmp_path / "path.csv", tmp_path / "path.png"
    files = ["--output", str(table), "--figure", str(figure)]
    assert main(["path", "two_bar_nsh", *LIFT, "--to", "72", "--step", "4", "--back", "--unstable", *files]) == 0
    shown = capsys.readouterr().out
    assert "4 jumps" in shown and "1 jump\n" in shown and "p = 55.4895184" in shown and "limit point" in shown
    found, model = rows(table), scene("two_bar_nsh")
    there, back = ([row for row in found if row["leg"] == leg] for leg in ("there", "back"))
    assert [float(row["p"]) for row in there] == list(np.arange(0.0, 73.0, 4.0))
    assert [float(row["p"]) for row in back] == list(np.arange(72.0, -1.0, -4.0))
    sweep = steady_states.load_sweep(Loading(model, push(model, 1.0, 0.0)), np.arange(0.0, 73.0, 4.0))
    assert [float(row["n3.z"]) for row in there] == sweep.nodes[:, 2, 2].tolist()
    assert {row["stable"] for row in found if row["leg"] == "behind"} == {"0", "1"}
    assert Image.open(figure).size == (720, 580)


MAST = """
plane = "xz"
gravity = 0.0
fixed = ["n1", "n3", "n4"]
[nodes]
n1 = [0.0, 0.0]
n2 = [0.0, 1.0]
n3 = [-0.8, 1.0]
n4 = [0.8, 1.0]
[materials.cable]
stiffness = 900.0
damping = 20.0
[bars]
mast = { nodes = ["n1", "n2"], mass = 1.0 }
[strings]
left = { nodes = ["n3", "n2"], material = "cable" }
right = { nodes = ["n4", "n2"], material = "cable" }
[prestress]
tension = { right = 60.0 }
"""


def test_path_of_a_buckling_mast_shows_its_branches(tmp_path, capsys):
    """It buckles at 2 k l = 1800 N and hangs upside down; on the way back that state, too, loses stability to a branch."""
    file, figure = tmp_path / "mast.toml", tmp_path / "mast.svg"
    file.write_text(MAST, encoding="utf-8")
    arguments = ["path", str(file), "--force", "n2.z=-1", "--to", "2000", "--back", "--unstable", "--show", "n2.x"]
    assert main([*arguments, "--figure", str(figure)]) == 0
    shown = capsys.readouterr().out
    assert "p = 1800: 0.000000" in shown and "branch point" in shown and "a string's force curve has a kink" in shown
    assert shown.count("behind p = 1800") == 2  # with the path itself, which is named by its point before
    drawn = figure.read_bytes()
    assert b"other stable states" in drawn and b"unstable states" in drawn
    main([*arguments, "--figure", str(figure)])
    assert figure.read_bytes() == drawn


def test_path_of_a_rest_length_from_elsewhere(tmp_path):
    table = tmp_path / "path.csv"
    arguments = ["--rest-length", "s4=-0.01", "s5=-0.01", "s6=-0.01", "--from", "2", "--to", "4", "--show", "n5.y"]
    assert main(["path", "three_bar", *arguments, "--output", str(table)]) == 0
    model, last = scene("three_bar"), rows(table)[-1]
    change = np.array([0.0, 0.0, 0.0, -0.04, -0.04, -0.04])
    settled = statics.settle(model, rest_length=model.rest_length + change, steps=10)
    assert float(last["p"]) == 4.0
    assert float(last["n5.y"]) == pytest.approx(settled.nodes[4, 1], abs=1e-10)


def test_modes_under_a_load(tmp_path, capsys):
    table, figure = tmp_path / "modes.csv", tmp_path / "modes.svg"
    force = ["--force", "n10.z=10", "n11.z=10", "n12.z=10"]
    assert main(["modes", "six_bar", *force, "--count", "1", "--output", str(table), "--figure", str(figure)]) == 0
    shown = capsys.readouterr().out
    assert "2.10208" in shown and "0.00485941" in shown and "and 40 that die out sooner" in shown
    model, field = scene("six_bar"), push(scene("six_bar"), 10.0, 0.0)
    settled = statics.settle(model, force=field, steps=4)
    expected, found = modes.modes(settled, field), rows(table)
    assert [float(row["decay_rate"]) for row in found] == pytest.approx([m.decay_rate for m in expected], rel=1e-7)
    assert float(found[0]["n7.y.re"]) == pytest.approx(1.0)
    first = figure.read_bytes()
    assert b"2.102 Hz, damping ratio 0.00486" in first
    main(["modes", "six_bar", *force, "--figure", str(figure)])
    assert figure.read_bytes() == first


def test_modes_without_dampers(capsys):
    assert main(["modes", "three_bar", "--undamped"]) == 0
    assert "6.56439" in capsys.readouterr().out


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["path", "two_bar", "--to", "5"], "nothing changes with p; give --force or --rest-length"),
        (["path", "two_bar", *LIFT, "--to", "0"], "--to = 0.0 is where --from stands"),
        (["path", "two_bar", *LIFT, "--to", "nan"], "--to = nan is not a finite number"),
        (["path", "two_bar", *LIFT, "--to", "5", "--step", "2"], "does not lead from 0 to 5 in whole steps"),
        (["path", "two_bar", *LIFT, "--to", "5", "--step", "-1"], "--step = -1.0 is not a number greater than 0"),
        (["path", "two_bar", *LIFT, "--to", "5", "--step", "1e-9"], "more than 100000"),
        (["path", "two_bar", "--force", "n1.z=1", "--to", "5"], "n1 is fixed to the ground"),
        (["path", "two_bar", "--rest-length", "s9=1", "--to", "5"], "'s9' is no string of two_bar; strings are s1, s2, s3"),
        (["path", "two_bar", "--rest-length", "s1", "--to", "5"], "not of the form STRING=M"),
        (["path", "two_bar", "--rest-length", "s1=x", "--to", "5"], "'x' is not a finite number"),
        (["path", "two_bar", "--rest-length", "s1=1", "s1=2", "--to", "5"], "s1 is given twice"),
        (["path", "two_bar", *LIFT, "--to", "5", "--show", "n3.y"], "--show n3.y: this is no coordinate of two_bar"),
        (["path", "two_bar", *LIFT, "--to", "5", "--output", "x.txt"], "does not end in .csv"),
        (["path", "two_bar", *LIFT, "--to", "5", "--figure", "x.pdf"], "does not end in .png or .svg"),
        (["modes", "two_bar", "--count", "0"], "--count = 0 is out of range"),
        (["modes", "two_bar", "--output", "x.npz"], "does not end in .csv"),
    ],
)
def test_mistakes_are_named(arguments, message, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
