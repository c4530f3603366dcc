"""Damaged, cut, mixed-up and missing resources of an FMU are refused at instantiation, by name and with the remedy.

A thinned-out sweep; every bit of every byte and every cut, of several FMUs: ``python -m
tests.fmu.runtimes.test_fmu_resources`` (the Python
FMU's modules and its kernel, 400 kB, a bit here and there; for the Python FMU alone with the argument ``python``).
"""

from __future__ import annotations

import importlib.util
import marshal
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu
from tests.support import scene
from tests.support.native_calls import ERROR, Calls
from tests.support.words import words

HERE = Path(__file__).parent

#: Scenes whose FMUs the whole sweep damages.
SWEPT = ("two_bar", "two_bar_nsh", "three_bar", "three_bar_nsh", "six_bar")

#: What the native FMU reads.
FILES = ("variables.bin", "model.bin")

#: Files of the Python FMU that only others tell to be damaged, which the message then names.
LISTS = ("checksums.txt", "slavemodule.txt")


@pytest.fixture
def folder(native_folders, tmp_path) -> Path:
    """A copy of a native FMU, to be damaged."""
    return Path(shutil.copytree(native_folders["two_bar_nsh"], tmp_path / "copy"))


@pytest.fixture
def python_folder(fmus, tmp_path) -> Path:
    """A Python FMU's files, to be damaged."""
    with zipfile.ZipFile(fmus["two_bar"]) as archive:
        archive.extractall(tmp_path / "python")
    return tmp_path / "python"


def files_in(folder: Path) -> list[str]:
    """Names of the resources' files."""
    resources = folder / "resources"
    return sorted(str(path.relative_to(resources)) for path in resources.rglob("*") if path.is_file())


def refused(folder: Path, name: str, *words: str) -> None:
    """Instantiation must fail and say which file is to blame, and what to do."""
    one = Calls(folder)
    try:
        assert one.component is None, name
        ((status, category, text),) = one.messages
        assert (status, category) == (ERROR, "logStatusError")
        assert all(word in text for word in (name if name not in LISTS else "", "unzip", *words)), text
    finally:
        one.free()


def damaged(good: bytes, every: int) -> Iterator[tuple[str, bytes]]:
    """(what was done, content): a flip in every so many bits, cuts, and what files on broken disks look like."""
    for bit in range(0, 8 * len(good), every):
        bad = bytearray(good)
        bad[bit // 8] ^= 1 << bit % 8
        yield f"bit {bit}", bytes(bad)
    for size in range(0, len(good), every):
        yield f"cut to {size}", good[:size]
        yield f"zeros from {size}", good[:size] + bytes(len(good) - size)
    for rest in (b"\0", b"\n", b"x" * 8, good):
        yield "lengthened", good + rest
    for place in range(1, len(good), 8 * every):
        yield f"turned about at {place}", good[place:] + good[:place]
        yield f"a byte lost at {place}", good[: place - 1] + good[place:]
    yield "line ends of Windows", good.replace(b"\n", b"\r\n")
    yield "line ends of Unix", good.replace(b"\r\n", b"\n")


def sweep(folder: Path, name: str, every: int, refuse=refused) -> int:
    """Number of damages tried; each must be refused, and the good file be taken again in the end."""
    path, count = folder / "resources" / name, 0
    good = path.read_bytes()
    for _what, bad in damaged(good, every):
        if bad == good:
            continue
        path.write_bytes(bad)
        refuse(folder, name)
        count += 1
    path.write_bytes(good)
    return count


@pytest.mark.parametrize("name", FILES)
def test_damaged_files_are_refused(name, folder):
    assert sweep(folder, name, 61) > 100
    runs(folder)


def runs(folder: Path) -> None:
    one = Calls(folder)
    assert one.component and one.start() == 0 and one.step(0.0, 0.01) == 0
    one.free()


@pytest.mark.parametrize("name", FILES)
def test_what_is_no_readable_file_is_refused(name, folder):
    unreadable(folder, name)


def unreadable(folder: Path, name: str) -> None:
    """Missing, a folder, without the right to read it."""
    path = folder / "resources" / name
    good = path.read_bytes()
    path.unlink()
    if name != "checksums.txt":  # which is removed by whoever changes the FMU
        refused(folder, name, "cannot be read")
    path.mkdir()
    refused(folder, name, "cannot be read")
    path.rmdir()
    path.write_bytes(good)
    if os.name != "nt" and os.geteuid() != 0:  # root reads everything
        path.chmod(0)
        refused(folder, name, "cannot be read")
        path.chmod(0o644)


def test_resources_that_are_no_folder_are_refused(folder):
    shutil.rmtree(folder / "resources")
    refused(folder, "variables.bin", "cannot be read")
    (folder / "resources").write_bytes(b"a file")
    refused(folder, "variables.bin", "cannot be read")


def test_files_of_another_fmu_are_refused(folder, native_folders, tmp_path):
    """Also one of the same shape, whose own checksum is right."""
    heavier = replace(scene("two_bar_nsh"), bar_mass=[1.5, 1.5])
    with zipfile.ZipFile(pack_native_fmu(heavier, tmp_path / "heavier.fmu")) as archive:
        archive.extractall(tmp_path / "heavier")
    for other in (native_folders["two_bar"], tmp_path / "heavier"):
        for name in FILES:
            good = (folder / "resources" / name).read_bytes()
            shutil.copy(other / "resources" / name, folder / "resources" / name)
            one = Calls(folder)
            assert one.component is None and one.said("GUID" if name == "variables.bin" else "model.bin")
            (folder / "resources" / name).write_bytes(good)
    runs(folder)


# The Python FMU


def test_damaged_files_of_the_python_fmu_are_refused(python_folder):
    """All of them, the modules and the kernel too."""
    names = files_in(python_folder)
    assert {*LISTS, "model.bin", "variables.json"} < set(names) and len(names) > 20
    for name in names:
        size = (python_folder / "resources" / name).stat().st_size
        assert sweep(python_folder, name, 8 * size // 5 + 3 if size > 100 else 17) > (5 if size else 2), name
    runs(python_folder)


def test_unreadable_files_of_the_python_fmu_are_refused(python_folder):
    for name in files_in(python_folder):
        unreadable(python_folder, name)
    runs(python_folder)
    shutil.rmtree(python_folder / "resources")
    refused(python_folder, "slavemodule.txt", "cannot be read")
    (python_folder / "resources").write_bytes(b"a file")
    refused(python_folder, "slavemodule.txt", "cannot be read")


def test_caches_of_python_are_neither_read_nor_left(fmus, tmp_path):
    """A cache is not among the files that are checked: a damaged one, as Python would take it for a module's, changes
    nothing."""
    with zipfile.ZipFile(fmus["two_bar"]) as archive:
        archive.extractall(tmp_path / "one")
    program = (
        "import sys; sys.path[:0] = sys.argv[2:]; sys.dont_write_bytecode = False\n"
        "from tests.support.native_calls import Calls\n"
        "one = Calls(sys.argv[1]); assert one.component, one.messages\n"
        "assert one.start() == 0 and one.step(0.0, 0.01) == 0 and not sys.dont_write_bytecode and sys.pycache_prefix is None\n"
    )
    line = [sys.executable, "-c", program, str(tmp_path / "one"), str(HERE.parents[2])]
    subprocess.run(line, check=True)
    assert not list((tmp_path / "one" / "resources").rglob("*.pyc"))
    (module,) = (tmp_path / "one" / "resources").glob("*/errors.py")
    cache = Path(importlib.util.cache_from_source(str(module)))
    cache.parent.mkdir()
    when = int(module.stat().st_mtime).to_bytes(4, "little") + module.stat().st_size.to_bytes(4, "little")
    wrong = marshal.dumps(compile("raise SystemExit('the cache was read')", "errors.py", "exec"))
    cache.write_bytes(importlib.util.MAGIC_NUMBER + bytes(4) + when + wrong)
    subprocess.run(line, check=True)


def main(runtime: str = "") -> None:
    """Every bit and every cut."""
    with tempfile.TemporaryDirectory() as scratch:
        for name, pack in [(name, pack_native_fmu) for name in SWEPT] * (runtime != "python") + [("two_bar", pack_python_fmu)]:
            folder = Path(scratch) / f"{name} {pack.__name__}"
            with zipfile.ZipFile(pack(scene(name), Path(scratch) / "one.fmu")) as archive:
                archive.extractall(folder)
            for file in files_in(folder):
                thin = 997 if file.endswith((".so", ".dll", ".dylib")) else 73 if "/" in file else 1
                print(f"{folder.name} {file}: {sweep(folder, file, thin)} damages, all refused", flush=True)


if __name__ == "__main__":
    main(*words(__doc__, runtime=""))
