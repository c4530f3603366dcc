"""Everything from a wheel: built out of the source archive, installed where no clone is in reach, in a folder called `ü #1`.

The environment has this project as a wheel; what it depends on it takes from the environment of the tests.
"""

from __future__ import annotations

import ast
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import numpy as np
import pytest

from tensegrity_core import cli
from tensegrity_core.native import build
from tensegrity_core.output.page import bundle
from tensegrity_core.output.page.made import BUILT, folder_of_parts
from tensegrity_core.scene import builtin_scenes
from tests.conftest import interpreter, once

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("tensegrity_core", "fmu_src")
PENDULUM = """plane = "xz"
start = "released"
fixed = ["n1"]
[nodes]
n1 = [0.0, 0.0]
n2 = [0.7, -0.7]
[bars]
b1 = { nodes = ["n1", "n2"], mass = 1.0 }
[strings]
"""


def call(command, folder: Path, code: int = 0) -> str:
    """What a program prints, run in a folder in which its user keeps everything; the tests' surroundings do not help it."""
    surroundings = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "COV"))}
    homes = ("HOME", "XDG_CACHE_HOME", "LOCALAPPDATA", "USERPROFILE")
    surroundings |= {name: str(folder / "home") for name in homes}
    done = subprocess.run([*map(str, command)], cwd=folder, env=surroundings, capture_output=True, text=True, encoding="utf-8")
    assert done.returncode == code, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout


def build_wheel(folder: Path) -> Path:
    """The wheel, out of an unpacked source archive."""
    hatch = [sys.executable, "-m", "hatchling", "build"]
    call([*hatch, "--target", "sdist", "--directory", folder], ROOT)
    (archive,) = folder.glob("*.tar.gz")
    with tarfile.open(archive) as files:
        files.extractall(folder / "source", filter="data")
    (source,) = (folder / "source").iterdir()
    if not bundle.missing():  # what is the same for all pages need not be built twice
        made = folder_of_parts()
        shutil.copytree(made, source / made.relative_to(ROOT))
    call([*hatch, "--target", "wheel", "--directory", folder], source)
    (wheel,) = folder.glob("*.whl")
    return wheel


def environment(folder: Path, wheel: Path) -> None:
    """A virtual environment with the wheel; its dependencies are found where the tests find them, after its own packages."""
    call([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], folder)
    python = interpreter(folder / "venv")
    call([sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", "--no-index", wheel], folder)
    site = Path(call([python, "-I", "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], folder).strip())
    borrowed = dict.fromkeys(sysconfig.get_path(kind) for kind in ("purelib", "platlib"))
    (site / "borrowed.pth").write_text("".join(f"{path}\n" for path in borrowed), encoding="utf-8")


@pytest.fixture(scope="module")
def home(made_page, tmp_path_factory) -> Path:
    """The folder of somebody who has the wheel only; in it venv/ and the wheel."""

    def make(folder):
        folder.mkdir()
        environment(folder, build_wheel(folder))

    return once(tmp_path_factory, "ü #1", make)


@pytest.fixture
def installed(home, tmp_path):
    """installed(*words): what the environment's Python prints, isolated, in a fresh folder called `ü #1` as well."""
    folder = tmp_path / "ü #1"
    folder.mkdir()

    def run(*words, code=0):
        return call([interpreter(home / "venv"), "-I", *words], folder, code)

    run.folder = folder
    return run


def test_the_wheel_holds_what_the_clone_holds(home):
    (wheel,) = home.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        found = {name for name in archive.namelist() if name.startswith(PACKAGES) and ".dist-info/" not in name}
    made = {build.HERE / build.LIBRARY, build.RUNTIME / build.FMU_LIBRARY, build.PYTHON_RUNTIME / build.PYTHON_LIBRARY}
    compiled = {".so", ".dll", ".dylib"}
    paths = [path for package in PACKAGES for path in (ROOT / package).rglob("*") if path.is_file()]
    kept = [path for path in paths if path in made or (path.suffix not in compiled and "__pycache__" not in path.parts)]
    pages = [] if bundle.missing() else [BUILT / name for name in bundle.FILES]
    assert found == {path.relative_to(ROOT).as_posix() for path in [*kept, *pages]}


def test_what_is_imported_is_declared():
    """The environment of the tests has more than a user's: every import is one of the project's dependencies, or of theirs."""

    def plain(requirement):
        return re.sub(r"[-_.]+", "-", re.match(r"[\w.-]+", requirement)[0]).lower()

    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = [text for extra in ("parquet", "ntrt", "mjcf") for text in project["optional-dependencies"][extra]]
    declared = {plain(text) for text in [*project["dependencies"], *extras]}
    declared |= {plain(text) for name in list(declared) for text in metadata.requires(name) or [] if "extra ==" not in text}
    declared.add("hatchling")  # which builds the package itself
    distributions = metadata.packages_distributions()
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                if isinstance(node, ast.ImportFrom) and not node.level:
                    names = [node.module]
                for name in {name.split(".")[0] for name in names} - sys.stdlib_module_names - {*PACKAGES}:
                    owners = {plain(owner) for owner in distributions.get(name, [name])}
                    assert owners & declared, f"{path.name} imports {name}, which nothing installs"


def test_it_is_the_wheel_that_runs(installed, home):
    show = "import tensegrity_core, fmu_src, json; print(json.dumps([tensegrity_core.__file__, fmu_src.__file__]))"
    found = [Path(name) for name in json.loads(installed("-c", show))]
    assert all((home / "venv") in path.parents for path in found)


def test_every_scene_loads(installed):
    show = """
from tensegrity_core.scene import builtin_scenes, load_scene
from tensegrity_core.statics import build_model
for name in builtin_scenes():
    print(build_model(load_scene(name)).name)
"""
    assert installed("-c", show).split() == list(builtin_scenes())


def test_fmus_are_built_and_run(installed):
    """Both runtimes: licences and sources inside, and the same motion in fmpy, which gets no other file of the project."""
    installed("-m", "fmu_src.build", "three_bar_nsh", "--no-validate", "--sources")
    for runtime in ("native", "python"):
        with zipfile.ZipFile(installed.folder / "dist" / runtime / "three_bar_nsh.fmu") as archive:
            names = archive.namelist()
            assert archive.read("documentation/licenses/license.txt") == (ROOT / "LICENSE").read_bytes()
        assert ("sources/tensegrity.h" in names) == (runtime == "native")
    run = """
import json, sys
import numpy as np
from fmpy import simulate_fmu
lift = np.array([(0.0, 45.0), (0.2, 45.0)], dtype=[("time", float), ("n4.force.z", float)])
found = simulate_fmu(sys.argv[1], stop_time=0.2, output_interval=0.01, input=lift, output=["n4.z", "s1.force"])
print(json.dumps([found["time"].tolist(), found["n4.z"].tolist(), found["s1.force"].tolist()]))
"""
    fmus = [installed.folder / "dist" / runtime / "three_bar_nsh.fmu" for runtime in ("native", "python")]
    native, python = (np.array(json.loads(installed("-c", run, fmu).splitlines()[-1])) for fmu in fmus)
    assert native[0, -1] == pytest.approx(0.2) and native[1, -1] > native[1, 0] + 1e-3
    np.testing.assert_allclose(native, python, rtol=1e-9, atol=1e-9)


def test_fmus_are_validated(installed):
    """With worker processes, a report, and a cache in the user's folder instead of a clone's."""
    (installed.folder / "pendulum.toml").write_text(PENDULUM, encoding="utf-8")
    shown = installed("-m", "fmu_src.build", "pendulum.toml", "--output", "out")
    assert re.search(r"^pendulum +native .*^pendulum +python ", shown, re.MULTILINE | re.DOTALL)
    for runtime in ("native", "python"):
        page = (installed.folder / "out" / runtime / "pendulum.html").read_text(encoding="utf-8")
        assert "Every bound holds." in page and "not known" in page  # of no commit, whatever repository is around
    assert list((installed.folder / "home").rglob("reference-cache/*.bin"))


#: Words of each command, and the file that it writes ('' stands for standard output).
COMMANDS = [
    ("new mast", "mast.toml"),
    ("check two_bar", ""),
    ("doctor", ""),
    ("schema", ""),
    ("export three_bar --to csv --output bridge_nodes.csv", "bridge_members.csv"),
    ("import bridge_nodes.csv --output bridge.toml", "bridge.toml"),
    ("export six_bar --to mjcf", "six_bar.xml"),
    ("tower 1 --output tower.toml", "tower.toml"),
    ("simulate tower.toml --duration 0.02 --output run.csv", "run.csv"),
    ("simulate two_bar --force n4.z=5 --duration 0.1 --output run.npz", "run.npz"),
    ("animate two_bar --force n4.z=5 --duration 0.1 --output film.gif", "film.gif"),
    ("view two_bar", "two_bar.html"),
    ("path two_bar --force n4.z=1 --to 5 --output path.csv", "path.csv"),
    ("path two_bar --force n4.z=1 --to 5 --figure path.png", "path.png"),
    ("modes two_bar --figure modes.svg", "modes.svg"),
    ("linearize two_bar --inputs n4.force.z --outputs n4.z --output linear.mat", "linear.mat"),
    ("build two_bar --runtime native --no-validate --output built", "built/native/two_bar.fmu"),
    ("run built/native/two_bar.fmu --duration 0.1 --output fmu.nc", "fmu.nc"),
    ("experiment beam", "experiment_beam.csv"),
    ("experiment IV --duration 0.1 --output results", "results/experiment_IV.csv"),
]


def test_every_command_runs(installed):
    assert {words.split()[0] for words, _ in COMMANDS} == set(cli.COMMANDS), "a subcommand that is not tried from a wheel"
    run = """
import json, sys
from tensegrity_core.cli import main
for words in json.loads(sys.argv[1]):
    assert main(words.split()) == 0, words
"""
    shown = installed("-c", run, json.dumps([words for words, _ in COMMANDS]))
    assert "two_bar: " in shown and '"$defs"' in shown
    missing = [file for _, file in COMMANDS if not (installed.folder / file).exists()]
    assert not missing


def test_scripts_begin_with_the_package_alone(installed):
    run = """
import tensegrity_core as tc
run = tc.simulate("two_bar_nsh", {"n4.force.z": 40.0}, duration=0.1)
assert (tc.load("two_bar_nsh", {"gravity": 0.0}).gravity, run["n4.z"].units) == (0.0, "m")
print(run.save("run.nc"), tc.build("two_bar", runtime="native")["native"], len(tc.modes(tc.equilibrium("two_bar"))))
"""
    installed("-c", run)
    assert (installed.folder / "run.nc").is_file() and (installed.folder / "dist" / "native" / "two_bar.fmu").is_file()


def test_the_program_is_installed(installed, home):
    program = interpreter(home / "venv").with_name("tensegrity" + (".exe" if os.name == "nt" else ""))
    assert "self-stress states" in call([program, "check", "two_bar"], installed.folder)
    call([program, "check", "no_such_scene"], installed.folder, code=2)
