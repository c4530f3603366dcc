"""The Python FMU's library under random calls, with AddressSanitizer and UndefinedBehaviorSanitizer in the process; the same of
the native FMU stands in test_native_host.py.

``python -m tests.fmu.runtimes.test_sanitizers COUNT`` also runs the kernel, with sanitizers, under COUNT of the models of
test_hostile_models.py, and makes COUNT calls for each of ten seeds.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import pytest

from fmu_src.packing.pack import pack_python_fmu
from tensegrity_core.native import build
from tests.conftest import once
from tests.fmu.runtimes.test_native_host import SANITIZERS, arguments
from tests.fmu.runtimes.test_python_host import surroundings
from tests.support import scene
from tests.support.native_calls import library_of
from tests.support.words import words

HERE = Path(__file__).parent
linux = sys.platform.startswith("linux")
pytestmark = pytest.mark.skipif(not linux, reason="Linux's loader puts the sanitizers into the process")

CHILD = """
import sys
sys.path.insert(0, {here!r})
from tests.kernel import test_hostile_models
test_hostile_models.run({first}, {count}, {library!r})
"""


def compiled(folder: Path, kernel: bool = False) -> None:
    """The Python FMU's library and the host of random calls, if asked the kernel; nothing where no sanitizers are."""
    folder.mkdir(parents=True)
    compiler = build.system_compiler()
    if compiler is None:
        return
    line = [*compiler, "-std=c99", *SANITIZERS, f"-I{build.fmi_headers()}", f"-I{build.HERE}", f"-I{build.RUNTIME}"]
    program = "int main(void) { return 0; }"
    probe = subprocess.run([*line, "-x", "c", "-", "-o", os.devnull], input=program, capture_output=True, text=True)
    if probe.returncode or not preloaded():
        return
    shared, libraries = ["-shared", "-fPIC", "-fvisibility=hidden", "-DTS_EXPORTED"], ["-ldl", "-lpthread", "-lm"]
    wanted = [("python.so", build.python_runtime_sources(), shared), ("host", [HERE / "native_host.c"], [])]
    for name, sources, options in wanted + [("kernel.so", build.kernel_sources(), shared)] * kernel:
        whole = [*line, *options, *map(str, sources), *libraries, "-o", str(folder / name)]
        done = subprocess.run(whole, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr


def preloaded() -> list[str]:
    """The sanitizers' libraries, which have to be the first ones of a process; none where the compiler has them elsewhere."""
    asked = [[*build.system_compiler(), f"-print-file-name={name}"] for name in ("libasan.so", "libubsan.so")]
    found = [subprocess.run(line, capture_output=True, text=True).stdout.strip() for line in asked]
    return found if all(Path(path).is_absolute() for path in found) else []


def watched() -> dict[str, str]:
    """Environment of a process that the sanitizers watch.  Python keeps what it does not free."""
    options = {"ASAN_OPTIONS": "detect_leaks=0:allocator_may_return_null=1", "UBSAN_OPTIONS": "print_stacktrace=1"}
    return surroundings(PYTHONMALLOC="malloc", LD_PRELOAD=" ".join(preloaded()), **options)


@pytest.fixture(scope="session")
def libraries(tmp_path_factory) -> Path:
    folder = once(tmp_path_factory, "sanitized", compiled)
    if not (folder / "host").exists():
        pytest.skip("no C compiler with AddressSanitizer and UndefinedBehaviorSanitizer as libraries")
    return folder


def ran(line: list, timeout: float) -> list[str]:
    done = subprocess.run([*map(str, line)], capture_output=True, text=True, timeout=timeout, env=watched())
    assert done.returncode == 0, f"{done.stdout[-500:]}\n{done.stderr[-5000:]}"
    return done.stdout.split()


def models(libraries: Path, first: int, count: int) -> list[str]:
    code = CHILD.format(here=str(HERE.parents[2]), first=first, count=count, library=str(libraries / "kernel.so"))
    return ran([sys.executable, "-c", code], 60 + 60 * count)[1::3]


def with_sanitizers(folder: Path, libraries: Path, target: Path) -> Path:
    """A copy of a Python FMU's files whose library is the one with sanitizers."""
    copy = shutil.copytree(folder, target)
    shutil.copy(libraries / "python.so", library_of(copy))
    return copy


def walk(libraries: Path, folder: Path, seed: int, calls: int) -> list[int]:
    return [int(n) for n in ran([libraries / "host", *arguments(folder), "walk", seed, calls], 300 + calls)]


def test_the_python_fmus_library_is_clean_under_sanitizers(libraries, python_folders, tmp_path):
    """Random calls, most of them wrong, and every function."""
    folder = with_sanitizers(python_folders["two_bar"], libraries, tmp_path / "copy")
    seen = walk(libraries, folder, 3, 2000)
    assert min(seen[0], seen[2], seen[3]) > 20
    ran([libraries / "host", *arguments(folder), "everything"], 300)


def main(count: int) -> None:
    with tempfile.TemporaryDirectory() as scratch:
        base = Path(scratch)
        compiled(base / "libraries", kernel=True)
        for first in range(0, count, 500):
            ended = models(base / "libraries", first, min(500, count - first))
            print(f"models from {first}: {ended.count('works')} work, {ended.count('refused')} are refused", flush=True)
        for name in ("two_bar", "three_bar_nsh"):
            with zipfile.ZipFile(pack_python_fmu(scene(name), base / f"{name}.fmu")) as archive:
                archive.extractall(base / name)
            folder = with_sanitizers(base / name, base / "libraries", base / f"{name} sanitized")
            for seed in range(10):
                seen = walk(base / "libraries", folder, seed, count)
                print(f"calls of the Python FMU of {name}, seed {seed}: {seen}", flush=True)


if __name__ == "__main__":
    main(*words(__doc__, int))
