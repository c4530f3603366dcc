"""Tables of nodes and members: scenes come back from them, mistakes are named with file, row and column."""

from __future__ import annotations

import numpy as np
import pytest

import tensegrity_core as tc
from tensegrity_core import kernel, reference
from tensegrity_core.cli import main
from tensegrity_core.errors import InputError, SceneError, TensegrityError
from tensegrity_core.model import grid, held
from tests.reference.test_structures import FOLDER

PLAIN = ("two_bar", "three_bar", "six_bar")
GROUNDED = sorted(path.stem for path in FOLDER.glob("*.toml") if "[ground]" in path.read_text(encoding="utf-8"))
JOINTED = sorted({path.stem for path in FOLDER.glob("*.toml")} - {*GROUNDED})
NODES = (
    "name, x, y, z, fixed, mass, vx\nn1, 0, 0, 0, yes, ,\nn2, 0, 0, 1, x, , \nn3, 1, 0, 1, yes, ,\nn4, 1, 1, 2, , 0.5, 0.1\n"
)
MEMBERS = (
    "name,kind,nodes,mass,stiffness,damping,tension\nb1,bar,n1 n2,1.0,,,\ns1,string,n2 n3,,800,2,5\ns2,string,n4 n3,,100,,1\n"
)
SCENE = "key,value\ngravity,0 0 -1.5\nstart,released\n"


def again(name, folder):
    """The model of a scene that went through its tables."""
    path, notes = tc.export_scene(name, folder / "it_nodes.csv", "csv")
    return tc.import_scene(path).model(), notes


@pytest.mark.parametrize("name", [*PLAIN, *JOINTED])
def test_scenes_come_back(name, tmp_path):
    scene = name if name in PLAIN else str(FOLDER / f"{name}.toml")
    model = tc.load(scene)
    back, notes = again(scene, tmp_path)
    assert not notes and (back.node_names, back.bar_names, back.string_names) == (
        model.node_names,
        model.bar_names,
        model.string_names,
    )
    for field in (
        "nodes",
        "fixed",
        "bars",
        "bar_mass",
        "strings",
        "stiffness",
        "damping",
        "velocity",
        "string_mass",
        "two_way",
    ):
        np.testing.assert_array_equal(getattr(back, field), getattr(model, field))
    np.testing.assert_allclose(back.rest_length, model.rest_length, rtol=1e-13)
    fields = ("point_mass", "drag", "partly_fixed", "routes", "sections", "strength", "gravity", "axes", "damping_law")
    for field in (*fields, "string_mass_matrix"):
        assert getattr(back, field) == getattr(model, field), field
    assert [body.bars for body in back.bodies] == [body.bars for body in model.bodies]
    run = reference.simulate if model.joint else kernel.simulate
    ours, theirs = (run(one, held(one, grid(0.2, 0.1))) for one in (model, back))
    assert np.abs(ours.position - theirs.position).max() < 1e-10


def test_everything_that_tables_can_say_is_a_key_of_the_scene(tmp_path):
    for name, text in {"nodes": NODES, "members": MEMBERS, "scene": SCENE}.items():
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    found = tc.import_scene(tmp_path / "nodes.csv")
    model = found.model()
    assert model.gravity == (0.0, 0.0, -1.5) and model.point_mass == ((3, 0.5),) and model.partly_fixed == ((1, (0,)),)
    assert model.velocity[3].tolist() == [0.1, 0.0, 0.0] and model.fixed.tolist() == [True, False, True, False]
    assert tc.load(found.save(tmp_path / "scene.toml")) == model


@pytest.mark.parametrize(
    "file, before, after, says",
    [
        ("nodes", "n2, 0, 0, 1", "n2, 0, zero, 1", "row 3, y = 'zero': is not a number"),
        ("nodes", "n2, 0, 0, 1", "n1, 0, 0, 1", "row 3, name = 'n1': stands twice"),
        ("nodes", ", yes, ,\nn2", ", maybe, ,\nn2", "row 2, fixed = 'maybe': is neither yes nor axes"),
        ("nodes", "name, x,", "name, X,", "the column 'X' is no column of this table; columns are name, x, y"),
        ("nodes", "n3, 1, 0, 1, yes, ,", "n3, 1, 0", "row 4 has 3 cells, the header 7"),
        ("nodes", NODES, NODES.replace(",", ";"), "separated by semicolons"),
        ("members", "bar,n1", "beam,n1", "row 2, kind = 'beam': is no kind of a member; write bar or string"),
        ("members", "1.0,,,", "1.0,5,,", "row 2, stiffness = '5': does not belong to a bar"),
        ("members", "s2,string", "s1,string", "row 4, name = 's1': stands twice"),
        ("members", "n1 n2", "n1 n9", "bars.b1.nodes[2] = 'n9': is no node"),
        ("members", "800", "nan", "strings.s1.stiffness = nan"),
        ("scene", "0 0 -1.5", "down", "row 2, value = 'down': is neither a number nor three"),
        ("scene", "start", "begin", "row 3, key = 'begin': is no key of this table"),
        ("scene", "released", "at rest", "start = 'at rest'"),
    ],
)
def test_mistakes_are_named(file, before, after, says, tmp_path, capsys):
    for name, text in {"nodes": NODES, "members": MEMBERS, "scene": SCENE}.items():
        assert name != file or text.count(before) == 1
        text = text.replace(before, after) if name == file else text
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    assert main(["import", str(tmp_path / "nodes.csv"), "-o", str(tmp_path / "out.toml")]) == 2
    told = capsys.readouterr().err
    assert says in told and told.count("\n") == 1 and not (tmp_path / "out.toml").exists()


def test_files_that_are_none(tmp_path):
    for name, data, says in (
        ("nodes.csv", b"\xff\xfe\x00", "is not UTF-8 text"),
        ("table.csv", b"name,x\n", "has `nodes` in its name"),
        ("nodes.txt", b"", "none of the files that can be imported"),
        ("nodes.csv", b"", r"members\.csv cannot be read"),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(InputError, match=says):
            tc.import_scene(tmp_path / name)
    with pytest.raises(InputError, match="cannot be read"):
        tc.import_scene(tmp_path / "missing" / "nodes.csv")
    (tmp_path / "members.csv").write_text("name,kind,nodes\n", encoding="utf-8")
    with pytest.raises(SceneError, match="nodes"):
        tc.import_scene(tmp_path / "nodes.csv")


def test_what_tables_cannot_say_is_refused_and_nothing_is_written(tmp_path, capsys):
    with pytest.raises(TensegrityError, match="three_bar_nsh: tables .* cannot say the NSH of s1, s2, s3"):
        tc.export_scene("three_bar_nsh", tmp_path / "a_nodes.csv", "csv")
    for name in GROUNDED:
        with pytest.raises(InputError, match="cannot say its ground"):
            tc.export_scene(FOLDER / f"{name}.toml", tmp_path / "a_nodes.csv", "csv")
    with pytest.raises(InputError, match="`nodes` in its name"):
        tc.export_scene("three_bar", tmp_path / "a.csv", "csv")
    assert main(["export", "three_bar", "--to", "cvs"]) == 2
    assert "did you mean csv?" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
