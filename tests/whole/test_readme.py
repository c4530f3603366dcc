"""The documentation: every code block runs, every table agrees with the code, every link leads somewhere.

In README.md and docs/*.md, all blocks of a file run in order in one folder: `python` and `sh` blocks are run, `toml`
blocks are saved under the name in their first line.  Set-up blocks (marked `<!-- setup -->`) are run by .ci/run, those for the
site ({toctree} ...) by test_site.py.
"""

import contextlib
import io
import os
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.coupling import system
from fmu_src import build
from fmu_src.variables.described import LOG_CATEGORIES
from fmu_src.variables.interface import variables
from tensegrity_core import cli
from tensegrity_core.scene import scene_schema
from tests.support import same_picture, scene
from tests.support.driven_scenes import LABORATORY, RATED, built
from tests.support.rigged_scenes import RIGGED

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([ROOT / "README.md", *(ROOT / "docs").glob("*.md")])
BLOCK = re.compile(
    r"^(?P<setup><!-- setup -->\n)?```(?P<language>\w*|\{[\w-]+\}[^\n]*)\n(?P<text>.*?)^```$", re.MULTILINE | re.DOTALL
)

#: Languages of blocks that nothing runs: another system's commands, output and data, formulas.
SHOWN_ONLY = {"bat", "text", "math"}

#: What a user calls; in this process, because each of its own takes a second to import what it needs (as processes the
#: subcommands are run out of a wheel, see test_wheel.py).
PROGRAMS = {
    ("tensegrity",): cli.main,
    ("python", "build_fmu.py"): build.main,
    ("python", "-m", "benchmarks.coupling.system"): system.main,
}

#: Files that a page's blocks promise to write.
WRITTEN = {
    "README.md": (
        "dist/native/three_bar_nsh.fmu",
        "dist/python/three_bar_nsh.fmu",
        "dist/native/mast.fmu",
        "mast.csv",
        "mast.gif",
        "mast.html",
        "path.csv",
        "modes.png",
        "three_bar_nsh.nc",
        "experiment_I.csv",
        "results/experiment_IV_figure_10.svg",
    ),
    "docs/fmu.md": ("dist/native/three_bar_nsh.fmu",),
    "docs/python-api.md": ("lifted.nc", "n4.png", "dist/native/three_bar_nsh.fmu"),
    "docs/command-line.md": ("mast.csv", "scene.schema.json", "dist/native/mast.fmu", "check.json", "path.json"),
    "docs/start-control.md": ("dist/native/three_bar_nsh.fmu", "three_bar_nsh.html"),
    "docs/start-robotics.md": ("prism.toml", "prism.html", "leaning.html", "dist/native/prism.fmu"),
    "docs/start-research.md": ("two_bar_nsh.html", "path.png"),
    "docs/coupling.md": ("height_control.ssp",),
    "docs/view.md": ("three_bar_nsh.html", "lifted.html", "run.html"),
    "docs/linearization.md": ("linear.mat", "linear.json", "height.png", "dist/native/three_bar_nsh.fmu"),
    "docs/equilibrium-paths.md": ("path.svg", "path.csv", "modes.svg", "modes.csv"),
}


#: Page -> what a block of it draws, and the figure that the page shows of that.
DRAWN = {"linearization.md": ("height.png", "linear_height.png")}


def blocks(page):
    return list(BLOCK.finditer(page.read_text(encoding="utf-8")))


def setup_commands():
    (block,) = [b for b in blocks(ROOT / "README.md") if b["setup"]]
    return block["text"].splitlines()


def run_line(line):
    """One command of a shell block; `> FILE` at its end is the only redirection."""
    command, _, output = line.partition(" > ")
    words = shlex.split(command)
    known = [(name, main) for name, main in PROGRAMS.items() if tuple(words[: len(name)]) == name]
    assert known, f"unknown program in: {line}"
    ((name, main),) = known
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert main(words[len(name) :]) == 0, f"{line}\n{printed.getvalue()}"
    if output:
        Path(output.strip()).write_text(printed.getvalue(), encoding="utf-8")


def run_module(command):
    """A script or `-m` and a module with the option --help, as a program."""
    by_module = command[0] == "-m"
    with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(io.StringIO()) as printed:
        patch.setattr(sys, "argv", [command[-1], "--help"])
        with pytest.raises(SystemExit) as end:
            if by_module:
                runpy.run_module(command[-1], run_name="__main__", alter_sys=True)
            else:
                runpy.run_path(str(ROOT / command[-1]), run_name="__main__")
    assert not end.value.code and printed.getvalue().startswith("usage:"), command


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_code_blocks_run(page, tmp_path, request, monkeypatch):
    monkeypatch.chdir(tmp_path)
    if "tensegrity view" in page.read_text(encoding="utf-8"):
        request.getfixturevalue("made_page")
    for block in blocks(page):
        language, text = block["language"], block["text"]
        if block["setup"] or language in SHOWN_ONLY or language.startswith("{"):
            continue
        if language == "toml":
            name = re.match(r"# (\w+\.toml)\n", text)
            assert name, f"a toml block without a file name in its first line:\n{text}"
            (tmp_path / name[1]).write_text(text, encoding="utf-8")
        elif language == "python":
            exec(compile(text, f"{page.name}, a block", "exec"), {"__name__": "__main__"})
        elif language == "sh":
            for line in text.splitlines():
                run_line(line)
        else:
            pytest.fail(f"a block in {language!r}, which nothing runs:\n{text}")
    missing = [name for name in WRITTEN.get(page.relative_to(ROOT).as_posix(), ()) if not (tmp_path / name).is_file()]
    assert not missing
    if page.name in DRAWN:
        same_picture(tmp_path / DRAWN[page.name][0], ROOT / "docs" / "figures" / DRAWN[page.name][1])


def test_setup_commands_are_the_two_that_ci_runs():
    commands = setup_commands()
    assert len(commands) == 2
    for command in commands:
        assert command.startswith("python3 -m venv .venv && .venv/bin/python -m pip install -e ")
    assert commands[0].endswith("&& .venv/bin/python build_fmu.py three_bar_nsh")
    assert commands[1].endswith("&& .venv/bin/python -m pytest")
    (windows,) = [b["text"].splitlines() for b in blocks(ROOT / "README.md") if b["language"] == "bat"]
    as_unix = [c.replace("py -m venv", "python3 -m venv").replace(".venv\\Scripts\\", ".venv/bin/") for c in windows]
    assert as_unix == commands


@pytest.mark.skipif(sys.platform == "win32", reason="CI's script needs bash")
def test_ci_takes_its_commands_out_of_the_readme():
    """The script, run with a shell in place of its last part, prints what it would run."""
    script = (ROOT / ".ci" / "run").read_text(encoding="utf-8")
    assert os.access(ROOT / ".ci" / "run", os.X_OK)
    head, mark, _ = script.partition("\nwork=$(mktemp -d)")
    assert mark, "the script no longer has the place at which this test cuts it"
    head = head.replace('cd "$(dirname "${BASH_SOURCE[0]}")/.."', f"cd {shlex.quote(str(ROOT))}")
    show = head + '\nprintf "%s\\n" "$commands"'
    done = subprocess.run(["bash", "-c", show], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == setup_commands()


@pytest.mark.filterwarnings("ignore:.*found in sys.modules after import")
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_benchmarks_that_a_page_names_start(page):
    """They take minutes; that they exist, find what they import and know their options shows in their help."""
    for command in named_commands(page):
        run_module(command)


def named_commands(page: Path) -> list[list[str]]:
    """Scripts of docs/ and modules of benchmarks/ that a page tells one to run."""
    text = page.read_text(encoding="utf-8")
    scripts = re.findall(r"python ((?:benchmarks|docs)/[\w/]+\.py)", text)
    modules = re.findall(r"python\s+-m\s+(benchmarks\.[\w.]*\w)", text)
    return [*([script] for script in sorted(set(scripts))), *(["-m", module] for module in sorted(set(modules)))]


def test_pages_name_benchmarks():
    """Else the test above would look for them in a form that no page uses."""
    named = {command[-1] for page in PAGES for command in named_commands(page)}
    pages = [page for page in PAGES if page.with_name(page.stem.replace("-", "_") + ".json").exists()]
    measured = [page for page in pages if "python -m tests." not in page.read_text(encoding="utf-8")]  # else a test's command
    assert len(measured) >= 11 and all(named_commands(page) for page in measured), pages
    assert len(named) >= len(pages)


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    found = re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8"))
    local = [link for link in found if not link.startswith("https://")]
    missing = [link for link in local if not (page.parent / link).exists()]
    assert not missing


# --- tables --------------------------------------------------------------------------------------------------------


def table(page, heading):
    """Rows of the first table below a heading, as lists of cells."""
    _, found, rest = page.read_text(encoding="utf-8").partition(f"# {heading}\n")
    assert found, f"{page.name} has no section {heading!r}"
    rows = re.search(r"^\|[^\n]*\n\|[-|]+\n((?:\|[^\n]*\n)+)", rest, re.MULTILINE)[1]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows.splitlines()]


SECTIONS = {
    "Top of the file": None,
    "`[bars]`": "Bar",
    "`[strings]`": "String",
    "`[materials.NAME]`": "Material",
    "`[nsh.NAME]`": "Honeycomb",
    "`[actuators.NAME]`": "Actuator",
    "`[elements.NAME]`": "Element",
    "`[dampers.NAME]`": "Damper",
    "`[prestress]`": "Prestress",
    "`[ground]`": "Ground",
    "`[ground.at.NODE]`": "Contact",
}


def test_every_table_of_a_scene_file_is_documented():
    assert set(scene_schema()["$defs"]) == {name for name in SECTIONS.values() if name}


@pytest.mark.parametrize("heading, definition", SECTIONS.items())
def test_every_key_of_a_scene_file_is_documented(heading, definition):
    schema = scene_schema()
    properties = (schema["$defs"][definition] if definition else schema)["properties"]
    rows = {row[0].strip("`"): row for row in table(ROOT / "docs" / "scene-files.md", heading)}
    assert list(rows) == list(properties)
    for key, entry in properties.items():
        if "default" in entry:
            shown = rows[key][3].strip("`").replace('"', "")
            default = entry["default"]
            expected = {"{}": {}, "[]": [], "false": False}.get(shown, shown)
            assert expected == default or str(default) == shown, f"{key}: {shown} documented, {default!r} in the schema"
        for choice in entry.get("enum", ()):
            assert f'"{choice}"' in rows[key][1], f"{key}: {choice} is not documented"


MODELS_OF = {
    "Variables": "three_bar_nsh",
    "Variables of drives": LABORATORY,
    "Variables of what members bear": RATED,
    "Variables of strings with mass": RIGGED,
}


@pytest.mark.parametrize("heading, model", MODELS_OF.items())
def test_every_variable_of_the_fmu_is_documented(heading, model):
    model = scene(model) if isinstance(model, str) else built(model)
    known = {row.name: row for row in variables(model)}
    common = {row.field for row in variables(scene("three_bar_nsh"))} if heading != "Variables" else set()
    beyond_drives = ("Variables of what members bear", "Variables of strings with mass")
    common |= {row.field for row in variables(built(LABORATORY))} if heading in beyond_drives else set()
    documented = {}
    for name, causality, unit, _ in table(ROOT / "docs" / "fmu.md", heading):
        row = known[name.strip("`")]
        expected = row.variability if row.causality == "parameter" else row.causality
        assert (causality, unit) == (expected, row.unit or ""), name
        documented[row.field] = name
    assert set(documented) - {"gravity"} == {row.field for row in known.values()} - common - {"gravity"}


def test_names_of_variables_in_the_readme_exist():
    known = {row.name for row in variables(scene("three_bar_nsh"))}
    rows = table(ROOT / "README.md", "Use an FMU")
    named = [name for row in rows for name in re.findall(r"`([a-z][^`]*)`", row[0])]
    assert len(named) > 15
    assert not set(named) - known


def test_log_categories_are_documented():
    text = (ROOT / "docs" / "fmu.md").read_text(encoding="utf-8")
    found = re.findall(r"^\| `(log\w+)` \|", text, re.MULTILINE)
    assert found == [*LOG_CATEGORIES]
