"""Fixtures that are made once per session: FMUs of all scenes, and an environment without this project.

With pytest-xdist the workers share what the first of them made.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu
from tensegrity_core.output.page import bundle
from tensegrity_core.output.page.made import folder_of_parts
from tensegrity_core.scene import builtin_scenes
from tests.support import scene

#: Files that take longest, the longest first: a worker that begins one of them last would end alone.
LONG = """native_platforms additions stability assertions python_host native_sources readme notebooks wheel wheels
    native_host benchmarks refused_calls trials hostile_models fmu_validate pictures_fit page_browser experiments
    progress program""".split()


def pytest_collection_modifyitems(items):
    """Long files first, then the others as they stand."""
    places = {f"test_{name}.py": place for place, name in enumerate(LONG)}
    items.sort(key=lambda item: places.get(item.path.name, len(LONG)))


@pytest.fixture(scope="session", autouse=True)
def folder_that_lxml_can_name():
    """fmpy reads descriptions by lxml, which wants a current folder whose name is UTF-8, whatever it opens."""
    try:
        os.getcwd().encode("utf-8")
    except UnicodeEncodeError:
        os.chdir(os.path.abspath(os.sep))


def once(tmp_path_factory, name: str, make) -> Path:
    """The folder `name` of this session, filled by make(folder) in one process while others wait."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if os.environ.get("PYTEST_XDIST_WORKER") else base) / name
    ready, lock = folder.with_suffix(".ready"), folder.with_suffix(".lock")
    try:
        lock.touch(exist_ok=False)
    except FileExistsError:
        deadline = time.monotonic() + 300.0
        while not ready.exists():
            assert time.monotonic() < deadline, f"{folder} was not made by another worker, see its errors"
            time.sleep(0.1)
        return folder
    make(folder)
    ready.touch()
    return folder


@pytest.fixture(scope="session")
def made_page(tmp_path_factory) -> None:
    """What all web pages have in common is built by one process while others wait, where it can be."""

    def make(folder):
        folder.mkdir()
        if not bundle.missing():
            folder_of_parts()

    once(tmp_path_factory, "made_page", make)


def packed(tmp_path_factory, kind: str, pack) -> dict[str, Path]:
    """Scene name -> its FMU, made once."""

    def make(folder):
        for name in builtin_scenes():
            pack(scene(name), folder / f"{name}.fmu")

    folder = once(tmp_path_factory, kind, make)
    return {name: folder / f"{name}.fmu" for name in builtin_scenes()}


@pytest.fixture(scope="session")
def fmus(tmp_path_factory) -> dict[str, Path]:
    """Scene name -> its Python FMU."""
    return packed(tmp_path_factory, "fmus", pack_python_fmu)


@pytest.fixture(scope="session")
def native_fmus(tmp_path_factory) -> dict[str, Path]:
    """Scene name -> its native FMU."""
    return packed(tmp_path_factory, "native_fmus", pack_native_fmu)


def unzipped(fmus: dict[str, Path], tmp_path_factory, what: str) -> dict[str, Path]:
    """Scene name -> folder with the files of its FMU, extracted once for all processes."""

    def make(folder):
        for name, fmu in fmus.items():
            with zipfile.ZipFile(fmu) as archive:
                archive.extractall(folder / name)

    folder = once(tmp_path_factory, what, make)
    return {name: folder / name for name in fmus}


@pytest.fixture(scope="session")
def native_folders(native_fmus, tmp_path_factory) -> dict[str, Path]:
    """Scene name -> folder with the files of its native FMU; nobody writes there."""
    return unzipped(native_fmus, tmp_path_factory, "native_folders")


@pytest.fixture(scope="session")
def python_folders(fmus, tmp_path_factory) -> dict[str, Path]:
    """Scene name -> folder with the files of its Python FMU; nobody writes there but Python its caches."""
    return unzipped(fmus, tmp_path_factory, "python_folders")


@pytest.fixture
def native(native_folders):
    """native(fmu, mode=None, **arguments): an instance of a scene's native FMU or of the one in a folder, see
    native_calls.Calls; brought to a mode where one is named; freed after the test."""
    yield from instances(native_folders, pack_native_fmu)


@pytest.fixture(params=["native", "python"])
def both(request, native_folders, python_folders):
    """both(fmu, ...): the same of both runtimes, one after the other; with that runtime's `folders` and `pack`."""
    if request.param == "native":
        yield from instances(native_folders, pack_native_fmu)
    else:
        yield from instances(python_folders, pack_python_fmu)


def instances(folders, pack):
    from tests.support.native_calls import Calls

    made = []

    def make(fmu, mode=None, **arguments):
        made.append(Calls(folders.get(fmu, fmu), **arguments))
        if mode:
            made[-1].bring_to(mode)
        return made[-1]

    make.folders, make.pack = folders, pack
    yield make
    for one in made:
        one.free()


@pytest.fixture(scope="session")
def tools(tmp_path_factory):
    """The compiled peers of the benchmarks, see benchmarks/peers/toolchain.py; for tests that have benchmarks/ on their
    path."""
    from benchmarks.peers import toolchain

    def make(folder):
        folder.mkdir()
        (folder / "tools.json").write_text(json.dumps(toolchain.build(folder), default=str), encoding="utf-8")

    folder = once(tmp_path_factory, "peers", make)
    program, library, sundials = json.loads((folder / "tools.json").read_text(encoding="utf-8"))
    return toolchain.Tools(Path(program), Path(library), sundials)


@pytest.fixture(scope="session")
def outside_python(tmp_path_factory) -> Path:
    """The interpreter of a fresh environment that has numpy and fmpy and nothing of this project."""

    def make(folder):
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
        python = str(interpreter(folder))
        command = [sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "numpy", "fmpy"]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, f"numpy and fmpy could not be installed:\n{done.stderr[-2000:]}"

    return interpreter(once(tmp_path_factory, "outside", make))


def interpreter(folder: Path) -> Path:
    return folder / "Scripts" / "python.exe" if os.name == "nt" else folder / "bin" / "python"


@pytest.fixture
def extracted(tmp_path):
    """extracted(fmu): fmpy's description of an FMU and a fresh folder with its files."""
    from fmpy import extract, read_model_description

    folders = []

    def unpack(fmu):
        folder = tmp_path / f"fmu{len(folders)}"
        folders.append(folder)
        extract(str(fmu), unzipdir=str(folder))
        return read_model_description(str(fmu)), str(folder)

    yield unpack
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)


@pytest.fixture
def instance(fmus, extracted):
    """instance(scene, **start): a started instance of the scene's FMU, with all messages on; freed after the test."""
    from fmu_src.validation.outside import Instance

    made, unpacked = [], {}

    def make(name, started=True, **start):
        fmu = fmus.get(name, name)
        if fmu not in unpacked:
            unpacked[fmu] = extracted(fmu)
        new = Instance(*unpacked[fmu], logging=True)
        made.append(new)
        if started:
            new.start(**start)
        return new

    yield make
    for one in made:
        one.fmu.freeInstance()
