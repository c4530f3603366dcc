"""Scene files: what they say, and what each mistake in them is answered with."""

from __future__ import annotations

import copy
import datetime
import json
import math
import random
import tomllib
from xml.etree import ElementTree as XML

import jsonschema
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tensegrity_core.cli import main
from tensegrity_core.errors import SceneError
from tensegrity_core.scene import (
    SCENE_FOLDER,
    Scene,
    builtin_scenes,
    load_scene,
    parse_scene,
    scene_schema,
    schema_text,
)
from tensegrity_core.statics import build_model

GOOD = """\
name = "braced"
plane = "xz"
fixed = ["n1", "n2"]

[nodes]
n1 = [0.0, 0.0]
n2 = [1.0, 0.0]
n3 = [0.826, 0.985]
n4 = [0.174, 0.985]

[materials.cable]
stiffness = 15000.0
damping = 500.0

[nsh.soft]
Q = [6.0, 8.0]
zeta = [3.0, 4.0]
h = [0.01, 0.02]

[bars]
b1 = { nodes = ["n1", "n3"], mass = 1.0 }
b2 = { nodes = ["n2", "n4"], mass = 1.0 }

[strings]
s1 = { nodes = ["n1", "n4"], material = "cable", nsh = "soft" }
s2 = { nodes = ["n2", "n3"], material = "cable" }
s3 = { nodes = ["n3", "n4"], material = "cable" }

[prestress]
tension = { s3 = 10.0 }
"""


def write(folder, text: str, name: str = "scene.toml"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_the_good_scene_is_good(tmp_path, capsys):
    path = write(tmp_path, GOOD)
    model = build_model(load_scene(path))
    assert (model.name, len(model.nodes), len(model.strings)) == ("braced", 4, 3)
    assert main(["check", str(path)]) == 0
    assert "strings: 3 (1 with an NSH)" in capsys.readouterr().out


@pytest.mark.parametrize(
    "name, problem, remedy",
    [
        ("three_ba", "neither a built-in scene nor a .toml file", "Did you mean three_bar?"),
        ("nowhere/at_all.toml", "does not exist", "three_bar_nsh"),
        ("", "neither a built-in scene", "two_bar"),
    ],
)
def test_no_such_scene(name, problem, remedy, capsys):
    assert main(["check", name]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert problem in printed.err and remedy in printed.err


def test_unreadable_files(tmp_path):
    (tmp_path / "folder.toml").mkdir()
    (tmp_path / "latin.toml").write_bytes('name = "sé"'.encode("latin-1"))
    for name, problem in (("folder.toml", "cannot be read"), ("latin.toml", "not UTF-8")):
        with pytest.raises(SceneError, match=problem) as caught:
            load_scene(tmp_path / name)
        assert caught.value.file == str(tmp_path / name)


def test_byte_order_mark_and_windows_line_ends(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert load_scene(path).nodes == load_scene(write(tmp_path, GOOD, "plain.toml")).nodes


# --- what a scene says -------------------------------------------------------------------------------------------


def test_builtin_scenes():
    assert builtin_scenes() == ("two_bar", "two_bar_nsh", "three_bar", "three_bar_nsh", "six_bar", "six_bar_nsh")
    for name in builtin_scenes():
        scene = load_scene(name)
        assert scene.name == name
        assert scene.description and scene.source
        assert load_scene(SCENE_FOLDER / f"{name}.toml") == scene


@pytest.mark.parametrize(
    "plain, stiff, with_nsh",
    [
        ("two_bar", 15000.0, {"s1", "s2"}),
        ("three_bar", 5000.0, {"s1", "s2", "s3"}),
        ("six_bar", 5000.0, {"s10", "s11", "s12", "s16", "s17", "s18"}),
    ],
)
def test_nsh_variants_differ_in_their_nsh_only(plain, stiff, with_nsh):
    scene, variant = load_scene(plain), load_scene(f"{plain}_nsh")
    assert {name for name, string in variant.strings.items() if string.nsh} == with_nsh
    assert {variant.strings[name].nsh for name in with_nsh} == {"article"}
    article = variant.nsh["article"]
    assert article.Q == (6.0, 8.0, 10.0, 12.0)
    assert article.zeta == (3.0, 4.0, 5.0, 6.0)
    assert article.h == (0.01, 0.01, 0.015, 0.01)
    assert not any(string.nsh for string in scene.strings.values())
    for key in ("nodes", "bars", "fixed", "gravity", "plane", "materials", "prestress", "start", "damping_law"):
        assert getattr(scene, key) == getattr(variant, key), key
    for name in scene.strings:
        assert scene.strings[name].nodes == variant.strings[name].nodes
        assert (variant.stiffness(name), variant.damping(name)) == (stiff, 500.0)


@pytest.mark.parametrize(
    "scene, lengths",
    [
        ("three_bar", {"b1": 2.0745, "b2": 2.0745, "b3": 2.0745, "s1": 1.168}),
        (
            "six_bar",
            {**dict.fromkeys(["s1", "s2", "s3", "s4", "s5", "s6"], 0.984)}
            | dict.fromkeys(["s7", "s8", "s9", "s10", "s11", "s12"], 1.168)
            | dict.fromkeys(["s13", "s14", "s15", "s16", "s17", "s18"], 0.617)
            | dict.fromkeys(["s19", "s20", "s21"], 1.646)
            | dict.fromkeys(["b1", "b2", "b3", "b4", "b5", "b6"], 2.0745),
        ),
        ("two_bar", {"b1": 1.2855, "b2": 1.2855}),
    ],
)
def test_lengths_are_those_of_the_structure(scene, lengths):
    """Three-fold symmetry: a wrong node in a string would show in its length."""
    loaded = load_scene(scene)
    for name, length in lengths.items():
        member = loaded.bars.get(name) or loaded.strings[name]
        assert math.isclose(loaded.distance(member.nodes), length, abs_tol=1.2e-3), name


def test_defaults_and_own_values():
    text = GOOD.replace('"soft" }', '"soft", stiffness = 100.0, damping = 1.0 }').replace('name = "braced"\n', "")
    scene = parse_scene({"name": "braced"} | tomllib.loads(text))
    assert (scene.gravity, scene.damping_law, scene.start, scene.description) == (9.81, "literal", "equilibrium", "")
    assert (scene.stiffness("s1"), scene.damping("s1")) == (100.0, 1.0)
    assert (scene.stiffness("s2"), scene.damping("s2")) == (15000.0, 500.0)
    assert scene.axes == (0, 2)
    assert scene.position("n3") == (0.826, 0.0, 0.985)


def test_texts_hold_what_xml_can_hold():
    """A tab, the last character of each range, and one beyond the first 65536."""
    text = "a\tb \ud7ff \ue000 \ufffd \U0001f3d7 größe <&> \x7f"
    scene = parse_scene(tomllib.loads(GOOD) | {"description": text, "source": text})
    assert (scene.description, scene.source) == (text, text)
    XML.fromstring(XML.tostring(XML.Element("model", description=text)))
    for code in (*range(0x09), *range(0x0A, 0x20), 0xFFFE, 0xFFFF):
        with pytest.raises(SceneError, match="form that is not allowed"):
            parse_scene(tomllib.loads(GOOD) | {"description": f"a{chr(code)}b"})


@pytest.mark.parametrize("name", ["con", "PRN", "aux", "nul", "com1", "LPT9"])
def test_names_of_windows_devices_are_refused(name, tmp_path):
    with pytest.raises(SceneError, match="device's name") as caught:
        load_scene(write(tmp_path, GOOD.replace("braced", name)))
    assert (caught.value.key, caught.value.value) == ("name", name)
    assert load_scene(write(tmp_path, GOOD.replace("braced", f"{name}_x"))).name == f"{name}_x"


def test_a_scene_cannot_be_changed():
    scene = load_scene("two_bar")
    with pytest.raises(ValueError, match="frozen"):
        scene.gravity = 0.0


def test_without_a_name_the_file_gives_it(tmp_path):
    text = GOOD.replace('name = "braced"\n', "")
    assert load_scene(write(tmp_path, text, "tower_2.toml")).name == "tower_2"
    with pytest.raises(SceneError) as caught:
        load_scene(write(tmp_path, text, "2 towers.toml"))
    assert (caught.value.key, caught.value.value) == ("name", "2 towers")


def test_names_that_only_look_alike_are_fine():
    text = GOOD.replace("s2 = {", "s1_left = {").replace("b2 = {", "s11 = {")
    scene = parse_scene(tomllib.loads(text))
    assert list(scene.strings) == ["s1", "s1_left", "s3"]


# --- extends -----------------------------------------------------------------------------------------------------


def test_extends_a_builtin_scene(tmp_path):
    path = write(tmp_path, 'extends = "three_bar"\nmaterials.cable.damping = 50.0\n', "three_bar_d50.toml")
    scene, base = load_scene(path), load_scene("three_bar")
    assert (scene.name, scene.description) == ("three_bar_d50", base.description)
    assert (scene.damping("s1"), scene.stiffness("s1")) == (50.0, 5000.0)
    assert scene.nodes == base.nodes


def test_extends_a_file_beside_it_and_keeps_the_order(tmp_path):
    (tmp_path / "parts").mkdir()
    write(tmp_path / "parts", GOOD, "base.toml")
    middle = 'extends = "parts/base.toml"\ngravity = 1.62\n[nodes]\nn9 = [5.0, 0.0]\nn1 = [0.1, 0.0]\n'
    write(tmp_path, middle, "middle.toml")
    path = write(tmp_path, 'extends = ["middle.toml"]\nfixed = ["n1", "n2", "n9"]\n')
    scene = load_scene(path)
    assert list(scene.nodes) == ["n1", "n2", "n3", "n4", "n9"]
    assert scene.nodes["n1"] == (0.1, 0.0)
    assert (scene.gravity, scene.fixed) == (1.62, ("n1", "n2", "n9"))


def test_later_scenes_of_a_list_win(tmp_path):
    write(tmp_path, GOOD, "base.toml")
    write(tmp_path, "gravity = 1.0\n", "one.toml")
    write(tmp_path, "gravity = 2.0\n", "two.toml")
    assert load_scene(write(tmp_path, 'extends = ["base.toml", "one.toml", "two.toml"]\n')).gravity == 2.0


def test_an_error_names_the_file_that_holds_the_key(tmp_path):
    base = write(tmp_path, GOOD.replace("damping = 500.0", "damping = -1.0"), "base.toml")
    path = write(tmp_path, 'extends = "base.toml"\n')
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert (caught.value.file, caught.value.key) == (str(base), "materials.cable.damping")
    path = write(tmp_path, 'extends = "base.toml"\nmaterials.cable.damping = -2.0\n')
    with pytest.raises(SceneError) as caught:
        load_scene(path)
    assert (caught.value.file, caught.value.value) == (str(path), -2.0)


def test_a_circle_of_scenes(tmp_path):
    write(tmp_path, 'extends = "b.toml"\n', "a.toml")
    b = write(tmp_path, 'extends = "a.toml"\n', "b.toml")
    with pytest.raises(SceneError, match="closes a circle") as caught:
        load_scene(tmp_path / "a.toml")
    assert caught.value.file == str(b)


def test_the_same_base_twice_is_no_circle(tmp_path):
    write(tmp_path, GOOD, "base.toml")
    write(tmp_path, 'extends = "base.toml"\ngravity = 1.0\n', "one.toml")
    assert load_scene(write(tmp_path, 'extends = ["base.toml", "one.toml"]\n')).gravity == 1.0


def test_a_string_passes_so_many_nodes_only(tmp_path):
    """Its stiffness ties each of them to each."""
    way = ["n3", *["n4", "n1", "n2"] * 99, "n4", "n1"]
    for nodes in (way, [*way, "n2"]):
        path = write(tmp_path, GOOD.replace('s3 = { nodes = ["n3", "n4"]', f"s3 = {{ nodes = {nodes}"))
        if len(nodes) == 300:
            assert len(load_scene(path).strings["s3"].nodes) == 300
            continue
        with pytest.raises(SceneError, match="passes 301 nodes, more than 300. Divide the string"):
            load_scene(path)


# --- the schema --------------------------------------------------------------------------------------------------


def test_schema_file_is_the_generated_one(capsys):
    published = (SCENE_FOLDER / "scene.schema.json").read_text(encoding="utf-8")
    assert published == schema_text(), "write it anew: tensegrity schema > tensegrity_core/scenes/scene.schema.json"
    assert main(["schema"]) == 0
    assert capsys.readouterr().out == published
    jsonschema.Draft202012Validator.check_schema(json.loads(published))


def schema_errors(raw: dict) -> list:
    return list(jsonschema.Draft202012Validator(scene_schema()).iter_errors(raw))


@pytest.mark.parametrize("name", builtin_scenes())
def test_schema_accepts_the_builtin_scenes(name):
    assert not schema_errors(tomllib.loads((SCENE_FOLDER / f"{name}.toml").read_text(encoding="utf-8")))


def test_schema_asks_for_missing_keys_only_of_complete_scenes():
    good = tomllib.loads(GOOD)
    assert not schema_errors(good)
    del good["bars"]["b1"]["mass"]
    assert schema_errors(good)
    assert not schema_errors(good | {"extends": "base.toml"})
    assert schema_errors({"name": "empty"})


@pytest.mark.parametrize("change", [{"gravity": -1}, {"plane": "zx"}, {"colour": 1}, {"nodes": {"n 1": [0, 0]}}])
def test_schema_refuses(change):
    good = tomllib.loads(GOOD)
    assert schema_errors(good | change)


# --- anything at all ---------------------------------------------------------------------------------------------

VALUES = [
    float("nan"),
    float("inf"),
    -1.0,
    0.0,
    0,
    1,
    2.5,
    1e6,
    1e15,
    1e308,
    -1e308,
    1e-308,
    10**400,
    True,
    None,
    "",
    "n1",
    "s1",
    "settled",
    "xy",
    [],
    [1.0],
    [1.0, 2.0],
    [1.0, 2, 3],
    ["n1", "n4"],
    [3.0, 5.0],
    {},
    {"a": 1},
    datetime.date(2020, 1, 1),
]


def places(table, path=()):
    """Paths of all keys and list entries."""
    inside = table.items() if isinstance(table, dict) else enumerate(table) if isinstance(table, list) else ()
    for key, value in inside:
        yield (*path, key)
        yield from places(value, (*path, key))


@settings(derandomize=True, deadline=None, max_examples=400)
@given(st.integers(0, 2**32))
def test_any_change_gives_a_model_or_a_scene_error(seed):
    choose = random.Random(seed)
    raw = tomllib.loads(GOOD)
    for _ in range(choose.choice([1, 1, 2])):
        *path, last = choose.choice(list(places(raw)))
        table = raw
        for key in path:
            table = table[key]
        what = choose.random()
        if what < 0.7 or isinstance(table, list):
            table[last] = copy.deepcopy(choose.choice(VALUES))
        elif what < 0.85:
            del table[last]
        else:
            table[f"x{last}"] = table[last]
    try:
        model = build_model(parse_scene(raw, "changed.toml"))
    except SceneError as error:
        assert error.file == "changed.toml"
        assert error.key and error.problem and error.remedy
    else:
        assert all(math.isfinite(value) for value in model.rest_length)
        assert isinstance(parse_scene(raw), Scene)
