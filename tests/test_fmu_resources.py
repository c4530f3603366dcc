"""Damaged, cut, mixed-up and missing resources of an FMU are refused at instantiation, by name and with the remedy.

A thinned-out sweep; every bit of every byte and every cut, of several FMUs: ``python tests/test_fmu_resources.py``.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

sys.path[:0] = [str(Path(__file__).resolve().parent), str(Path(__file__).resolve().parent.parent)]

from native_calls import ERROR, Calls  # noqa: E402
from support import scene  # noqa: E402

from fmu_src.native_fmu import pack_native_fmu  # noqa: E402

#: Scenes whose FMUs the whole sweep damages.
SWEPT = ("two_bar", "two_bar_nsh", "three_bar", "three_bar_nsh", "six_bar")

#: What the native FMU reads.
FILES = ("variables.bin", "model.bin")


@pytest.fixture
def folder(native_folders, tmp_path) -> Path:
    """A copy of a native FMU, to be damaged."""
    return Path(shutil.copytree(native_folders["two_bar_nsh"], tmp_path / "copy"))


def refused(folder: Path, name: str, *words: str) -> None:
    """Instantiation must fail and say which file is to blame, and what to do."""
    one = Calls(folder)
    try:
        assert one.component is None, name
        ((status, category, text),) = one.messages
        assert (status, category) == (ERROR, "logStatusError")
        assert all(word in text for word in (name, "unzip", *words)), text
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


def sweep(folder: Path, name: str, every: int, refuse=refused) -> int:
    """Number of damages tried; each must be refused, and the good file be taken again in the end."""
    path, count = folder / "resources" / name, 0
    good = path.read_bytes()
    for what, bad in damaged(good, every):
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
    path = folder / "resources" / name
    good = path.read_bytes()
    path.unlink()
    refused(folder, name, "cannot be read")
    path.mkdir()
    refused(folder, name)
    path.rmdir()
    path.write_bytes(good)
    if os.name != "nt" and os.geteuid() != 0:  # root reads everything
        path.chmod(0)
        refused(folder, name, "cannot be read")


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


def main() -> None:
    """Every bit and every cut."""
    with tempfile.TemporaryDirectory() as scratch:
        for name in SWEPT:
            with zipfile.ZipFile(pack_native_fmu(scene(name), Path(scratch) / f"{name}.fmu")) as archive:
                archive.extractall(Path(scratch) / name)
        for name in SWEPT:
            for file in FILES:
                print(f"{name} native {file}: {sweep(Path(scratch) / name, file, 1)} damages, all refused", flush=True)


if __name__ == "__main__":
    main()
