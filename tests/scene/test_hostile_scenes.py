"""Scenes that ask too much: too large, too deep, too far apart.  Each is refused in one line, or is answered soon."""

import os
import pickle
import subprocess
import sys
from collections import Counter

import pytest

from tensegrity_core import laws
from tensegrity_core.cli import main
from tensegrity_core.errors import InputError, SceneError, SimulationError
from tensegrity_core.model.elements import Beam, Parallel, Series, Spring, simplified
from tensegrity_core.scene import files as scene_files
from tensegrity_core.scene import load_scene, parse_scene
from tensegrity_core.statics import TooLarge, build_model
from tests.scene import fuzz_scenes
from tests.scene.test_scene import GOOD, write

ROOT = fuzz_scenes.ROOT
BEAM = '[elements.e0]\nkind = "beam"\nQ = 6.0\nzeta = 5.0\nh = 0.01\n'


def nested(levels: int, kind: str = "series", again: str = "") -> str:
    """Elements e1 of e0, e2 of e1 ...; `again`: what each has beside it; kind: {} of even and odd levels."""
    kinds = (kind, kind) if kind != "both" else ("parallel", "series")
    rows = (f'[elements.e{i}]\nkind = "{kinds[i % 2]}"\nparts = ["e{i - 1}"{again}]\n' for i in range(1, levels + 1))
    return BEAM + "".join(rows)


def fixed_nodes(count: int) -> str:
    names = ", ".join(f'"q{i}"' for i in range(count))
    nodes = "".join(f"q{i} = [{i}.0, 5.0]\n" for i in range(count))
    return GOOD.replace('["n1", "n2"]', f'["n1", "n2", {names}]', 1).replace("[nodes]\n", f"[nodes]\n{nodes}")


def table(points: int, along: str = "elongation", zigzag: bool = False, fall: bool = False) -> str:
    """An element or a damper of so many points, nearly a line."""
    head = '[elements.t]\nkind = "table"' if along == "elongation" else "[dampers.t]"
    forces = [0.01 * i + (zigzag and i % 2) for i in range(points - 1)] + [-1.0 if fall else 0.01 * points]
    return f"\n{head}\n{along} = {[0.001 * i for i in range(points)]}\nforce = {forces}\n"


#: The scene, and the key and a part of the problem of its error; None: it is a good one.
CASES = {
    "series in series": (GOOD + nested(12), None, ""),
    "parallels in parallels": (GOOD + nested(8, "parallel", ', "e0"'), None, ""),
    "series of parallels of series": (GOOD + nested(7, "both", ', "e0"'), "elements.e7", "too long"),
    "series 900 deep": (GOOD + nested(900), "elements", "parts"),
    "elements in a row, deepest first": (
        GOOD + "".join(reversed(nested(30).split("[ele"))).replace("ments", "[elements"),
        "elements",
        "20 elements deep",
    ),
    "flat NSH": (GOOD.replace("[0.01, 0.02]", "[1e-300, 0.02]"), "nsh.soft.h[1]", "less than 1e-09"),
    "flat beam": (GOOD + BEAM.replace("0.01", "1e-300"), "elements.e0.h", "less than 1e-09"),
    "coefficients far apart": (
        GOOD + '[elements.e0]\nkind = "polynomial"\ncoefficients = [3000.0, 1e15, 1e-300]\n',
        "elements.e0.coefficients[3]",
        "closer to 0 than 1e-15",
    ),
    "5000 digits": (GOOD.replace("15000.0", "1" * 5000), "(file)", "too many digits"),
    "5000 digits and a point": (GOOD.replace("15000.0", "1" * 5000 + ".0"), "materials.cable.stiffness", "finite"),
    "5000 hexadecimal digits": (GOOD.replace("15000.0", "0x" + "f" * 5000), "materials.cable.stiffness", "finite"),
    "a key with a bracket and a superscript": ('"a[²" = [1]\n' + GOOD, "a[²", "not a key"),
    "a node with a bracket and a superscript": (GOOD.replace("n3 = [", '"a[²]" = ['), "nodes.a[²]", "identifier"),
    "a key of two lines": (GOOD + '\n"a\\nb" = 1\n', "prestress.a\nb", "not a key"),
    "extends 300 letters": (f'extends = "{"a" * 300}.toml"\n' + GOOD, "extends", "does not exist"),
    "extends 5000 letters": (f'extends = "{"a" * 5000}.toml"\n' + GOOD, "extends", "does not exist"),
    "extends a scene of 5000 letters": (f'extends = "{"a" * 5000}"\n' + GOOD, "extends", "does not exist"),
    "extends a null character": ('extends = "a\\u0000.toml"\n' + GOOD, "extends", "does not exist"),
    "a key of 3000 parts": (GOOD + "\n[x]\n" + ".".join("a" * 3000) + " = 1\n", "line 33", "20 deep"),
    "a key of 300 000 parts": (GOOD + "\n[x]\n" + ".".join("a" * 300_000) + " = 1\n", "line 33", "20 deep"),
    "a quoted key of 300 000 parts": (GOOD + '\n["' + '"."'.join("a" * 300_000) + '"]\n', "line 32", "20 deep"),
    "lists 3000 deep": ("x = " + "[" * 3000 + "]" * 3000 + "\n" + GOOD, "(file)", "20 deep"),
    "lists 30 deep": ("x = " + "[" * 30 + "]" * 30 + "\n" + GOOD, "(file)", "20 deep"),
    "extends 20 000 scenes": ("extends = [" + '"three_bar", ' * 20_000 + "]\n", "extends", "20000 scenes"),
    "30 000 fixed nodes": (fixed_nodes(30_000), None, ""),
    "a name of 400 000 letters": (GOOD.replace("s2 = {", f"s{'_a' * 200_000} = {{"), None, "more than 128 letters"),
    "many values": (GOOD + "".join(f"k{i} = 1\n" for i in range(301_000)), "(file)", "more than 300000"),
    "two million zeros": (f"x = [{'0,' * 1_900_000}]\n{GOOD}", "(file)", "more than 300000"),
    "a table of 200 000 points": (GOOD + table(200_000), "(file)", "more than 300000"),
    "a table of 60 000 points": (GOOD + table(60_000), "elements.t.elongation", "60000 points"),
    "a damper of 60 000 points": (GOOD + table(60_000, "rate"), "dampers.t.rate", "60000 points"),
    "a damper of 10 000 points that rises and falls": (GOOD + table(10_000, "rate", zigzag=True), None, ""),
    "a table of 10 000 points that ends below 0": (GOOD + table(10_000, fall=True), "elements.t", "beyond the last"),
    "a damper of 10 000 points that ends below 0": (GOOD + table(10_000, "rate", fall=True), "dampers.t", "falls to -"),
    "a large file": (GOOD + "#" * 5_000_000, "(file)", "too large"),
    "a mass of nearly nothing": (GOOD.replace("mass = 1.0", "mass = 5e-324"), "bars.b1.mass", "closer to 0 than 1e-15"),
    "a mass that is too light for its strings": (GOOD.replace("mass = 1.0", "mass = 1e-14"), "bars.b", "beside the stiff"),
    "a payload of nearly nothing": (GOOD + "\n[point_masses]\nn3 = 5e-324\n", "point_masses.n3", "closer to 0"),
    "a beam that is far too strong": (
        GOOD.replace("[6.0, 8.0]", '[6e12, 8.0]\nlaw = "hysteretic"'),
        "nsh.soft.Q[1]",
        "greater",
    ),
    "30 beams with memory": (
        GOOD.replace("[6.0, 8.0]", f'{[6.0] * 30}\nlaw = "hysteretic"')
        .replace("[3.0, 4.0]", f"{[4.0] * 30}")
        .replace("[0.01, 0.02]", f"{[0.01] * 30}"),
        "nsh.soft.Q",
        "30 beams",
    ),
    "an element on a string of no material": (
        GOOD.replace('"cable" }', '"calbe", element = "e0" }', 1) + BEAM,
        "strings.s2.material",
        "[materials]",
    ),
    "bytes": (bytes(range(256)), "(file)", "not UTF-8"),
    "a null character": (GOOD + "\0", "line 31", "not TOML"),
    "nothing": ("", "nodes", "missing"),
}


@pytest.mark.parametrize("case", CASES)
def test_hostile_scene(case, tmp_path, capsys):
    text, key, problem = CASES[case]
    path = tmp_path / "scene.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    code = main(["check", str(path)])
    printed = capsys.readouterr()
    if code == 0:
        assert key is None and not problem and "braced" in printed.out
        return
    assert (code, printed.out) == (2, "")
    assert printed.err.count("\n") == 1 and printed.err.endswith("\n") and len(printed.err) < 2000
    with pytest.raises(SceneError) as caught:
        build_model(load_scene(path))
    assert problem and problem in str(caught.value)
    assert key is None or caught.value.key.startswith(key)


def test_a_description_that_the_terminal_cannot_show(tmp_path):
    path = write(tmp_path, 'extends = "two_bar"\nname = "bridge"\ndescription = "\\u6a4b"\n')
    command = [sys.executable, "-m", "tensegrity_core.cli", "check", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"PYTHONIOENCODING": "ascii"}, cwd=ROOT)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("bridge: \\u6a4b\n")


# --- messages ----------------------------------------------------------------------------------------------------

LONG = "many\n\x07words of it " * 10_000

ERRORS = {
    "scene": SceneError(LONG, LONG, LONG, LONG, LONG + "the remedy"),
    "values": SceneError("scene.toml", "elements.t", {"force": [0.1] * 100_000}, "falls", "Sort it: the remedy"),
    "input": InputError(f"{LONG}; the remedy"),
    "run": SimulationError("unstable", f"{LONG}: the remedy", 0.5),
    "other": TooLarge(f"{LONG}: the remedy"),
}


@pytest.mark.parametrize("kind", ERRORS)
def test_a_message_is_one_line_of_bounded_length_that_keeps_its_ends(kind):
    text = str(ERRORS[kind])
    assert len(text) <= 1500 and text.isprintable()
    assert text.startswith(("many", "scene.toml: elements.t = ", "unstable at t = 0.5 s: ")) and "the remedy" in text[-15:]


@pytest.mark.parametrize("kind", ERRORS)
def test_errors_pass_between_processes(kind):
    """A worker's error that its parent cannot read would end all workers."""
    before = ERRORS[kind]
    after = pickle.loads(pickle.dumps(before))
    assert (type(after), str(after), vars(after)) == (type(before), str(before), vars(before))


WORDS = (
    "check {0}",
    "check {0}.toml",
    "check {0}/a.toml",
    "{0}",
    "simulate two_bar --force {0}.z=1",
    "simulate two_bar --step {0}",
    "simulate two_bar --output {0}.csv",
    "simulate two_bar --output {0}/a.csv",
    "animate two_bar --output {0}.gif",
    "path two_bar --force n4.z=1 --to 2 --output {0}.csv",
    "modes two_bar --figure {0}.png",
    "tower 1 --output {0}.toml",
    "experiment beam --output {0}",
)


@pytest.mark.parametrize("words", WORDS)
@pytest.mark.parametrize("letters", [300, 5000])
def test_a_command_that_is_given_a_long_word_says_so_in_one_line(words, letters, capsys):
    """No file system has such names."""
    try:
        code = main(words.format("x" * letters).split())
    except SystemExit as end:  # from argparse, which prints how the command is used before
        code = end.code
    printed = capsys.readouterr()
    assert (code, printed.out) == (2, "")
    assert len(printed.err) <= 1501 or (printed.err.startswith("usage") and len(printed.err) < 2500)


# --- extends -----------------------------------------------------------------------------------------------------


def test_a_chain_of_600_files_is_refused_by_name(tmp_path):
    for i in range(600):
        write(tmp_path, f'extends = "c{i + 1}.toml"\n', f"c{i}.toml")
    write(tmp_path, GOOD, "c600.toml")
    with pytest.raises(SceneError, match="goes on after 50 scenes") as caught:
        load_scene(tmp_path / "c0.toml")
    assert (caught.value.file, caught.value.key) == (str(tmp_path / "c50.toml"), "extends")
    assert load_scene(tmp_path / "c551.toml").bars.keys() == {"b1", "b2"}  # 49 follow it


def test_files_that_extend_the_next_twice_are_read_once(tmp_path, monkeypatch):
    for i in range(25):
        write(tmp_path, f'extends = ["d{i + 1}.toml", "d{i + 1}.toml"]\ngravity = {i + 1}.0\n', f"d{i}.toml")
    write(tmp_path, GOOD, "d25.toml")
    read = []
    text = scene_files.Reading.text
    monkeypatch.setattr(scene_files.Reading, "text", lambda self, path: read.append(path.name) or text(self, path))
    scene = load_scene(tmp_path / "d0.toml")
    assert (scene.name, scene.gravity, len(scene.nodes)) == ("d0", 1.0, 4)
    assert read == [f"d{i}.toml" for i in range(26)]


def test_merging_is_that_of_reading_each_file_again(tmp_path):
    """A base that stands behind a scene that has changed it takes its own values back, as it did when it was read twice."""
    write(tmp_path, GOOD, "base.toml")
    write(tmp_path, 'extends = "base.toml"\ngravity = 1.0\ndescription = "one"\n', "one.toml")
    write(tmp_path, 'extends = "base.toml"\ngravity = 2.0\n', "two.toml")
    scene = load_scene(write(tmp_path, 'extends = ["one.toml", "two.toml"]\n'))
    assert (scene.gravity, scene.description) == (2.0, "one")


@pytest.mark.skipif(os.name == "nt", reason="links need rights on Windows")
def test_links_that_lead_nowhere_or_without_end(tmp_path):
    (tmp_path / "loop.toml").symlink_to("loop.toml")
    (tmp_path / "zero.toml").symlink_to("/dev/zero")
    for name, problem in (("loop", "cannot be read"), ("zero", "too large")):
        with pytest.raises(SceneError, match=problem):
            load_scene(tmp_path / f"{name}.toml")
        with pytest.raises(SceneError, match="does not exist"):
            load_scene(write(tmp_path, f'extends = "{name}.toml"\n'))


# --- laws --------------------------------------------------------------------------------------------------------


def test_nested_groups_are_opened_and_mean_the_same():
    beam, stiff, soft = Beam(6.0, 5.0, 0.01), Spring(900.0), Spring(300.0)
    inner = Series((Series((beam, stiff)), Series((Series((soft,)),))))
    assert simplified(inner) == Series((beam, stiff, soft))
    assert simplified(Parallel((Parallel((stiff, Series((soft,)))), beam))) == Parallel((stiff, soft, beam))
    assert simplified(Series((Series((beam, stiff)), soft), "hysteretic")) == Series(
        (Series((beam, stiff)), soft), "hysteretic"
    )
    whole, opened = laws.law(inner), laws.law(simplified(inner))
    for x in (0.001, 0.01, 0.02, 0.031, 0.08):
        assert opened.force(x) == pytest.approx(whole.force(x), rel=1e-9)


@pytest.mark.parametrize("beam", [(6.0, 5.0, 1e-300), (1e300, 5.0, 0.01), (6.0, 1e-300, 0.01), (6.0, float("nan"), 0.01)])
def test_beams_beyond_their_ranges_are_input_errors(beam):
    with pytest.raises(InputError, match="beam"):
        laws.law(Beam(*beam))


def test_data_from_python_may_be_anything():
    circle: dict = {}
    circle["a"] = circle
    for data in (circle, {"nodes": [[[]]] * 3}, {"name": 10**5000}, {1: 2}, {("a", "b"): 1}, [1], None, {"bars": {3: 4}}):
        with pytest.raises(SceneError):
            parse_scene(data)


# --- anything at all ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", range(4))
def test_damaged_scenes_are_answered_or_refused(part, tmp_path):
    """200 of the cases of `python -m tests.scene.fuzz_scenes`, which has as many as one likes."""
    fuzz_scenes.prepare(tmp_path)
    ends = Counter()
    for number in range(50 * part, 50 * part + 50):
        end, wrong, _ = fuzz_scenes.judge(number, 0, tmp_path)
        assert not wrong or wrong.startswith("took"), wrong  # time is the command's to judge
        ends[end.split(": ")[1]] += 1
    assert ends["simulated"] > 2 and ends["SceneError of the scene"] > 20
