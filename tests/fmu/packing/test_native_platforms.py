"""The FMUs for other platforms: compiled by ziglang, run by wine and qemu where they are installed, and the same."""

from __future__ import annotations

import os
import re
import shutil
import struct
import subprocess
import zipfile
from collections import Counter
from pathlib import Path
from xml.etree import ElementTree as XML

import numpy as np
import pytest

from fmu_src import build as build_fmu
from fmu_src.packing import libraries, native_fmu
from fmu_src.packing.libraries import KINDS, PackError, cross_compiled, here
from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.pack import pack_python_fmu
from fmu_src.validation.scenarios import pushed_node
from fmu_src.variables.described import LOG_CATEGORIES
from fmu_src.variables.interface import variables
from tensegrity_core.native import build
from tests.support import scene
from tests.support.native_calls import Calls
from tests.support.tools import CROSS

SCENE, STEPS, STEP, WAVE = "three_bar_nsh", 200, 0.01, 200.0
HOST = Path(__file__).parent / "step_host.c"
LIMIT = 450_000  # bytes of an FMU for one platform: joints, ground and routed strings came, for 0.1 MB
#: Functions of FMI 2.0 for co-simulation; for model exchange, too; of FMI 3.0.
FUNCTIONS = {"python": {"fmi2": 34}, "native": {"fmi2": 34 + 10, "fmi3": 75}}
LINKER = {"_mh_dylib_header", "__dso_handle"}  # what macOS's linkers add by themselves
LC_SYMTAB, LC_ID_DYLIB, LC_CODE_SIGNATURE, LC_BUILD_VERSION = 0x2, 0xD, 0x1D, 0x32
#: Where Debian keeps wine's loader if the wrapper scripts are not installed.
WINE = ("wine64", "wine", "/usr/lib/wine/wine64")
#: First bytes of a library's file, by platform.
ELF, PE, MACHO = b"\x7fELF", b"MZ", b"\xcf\xfa\xed\xfe"
MAGIC = {"linux64": ELF, "aarch64-linux": ELF, "win64": PE, "darwin64": MACHO, "aarch64-darwin": MACHO}


def program(*names: str) -> str:
    """Path of the first program that is installed; skips the test where there is none."""
    for name in names:
        if shutil.which(name):
            return shutil.which(name)
    pytest.skip(f"needs {' or '.join(names)}")


def host(folder: Path, platform: str | None) -> Path:
    """step_host.c as a program for a platform, by zig; None: for this one, by its own compiler.  It is optimised and stripped
    as the libraries are: for each such combination zig compiles a C library's start and a runtime first."""
    target = folder / ("host.exe" if platform == "win64" else "host")
    command, libraries = build.system_compiler() or build.zig(), ["-ldl"]
    if platform:
        command, libraries = build.zig(platform), [] if platform == "win64" else ["-ldl"]
    line = [*command, "-std=c99", "-O3", "-s", f"-I{build.fmi_headers()}", str(HOST), *libraries, "-o", str(target)]
    done = subprocess.run(line, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return target


def steps(fmu: Path, folder: Path, platform: str, runner: list[str], program: Path, surroundings=None, root="") -> np.ndarray:
    """(STEPS, positions) m: the FMU's library of a platform, stepped by the host.  runner: what runs the host; root: of the
    file system as the host sees it, before a path."""
    model = scene(SCENE)
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
        guid = re.search(r'guid="([^"]+)"', archive.read("modelDescription.xml").decode()).group(1)
    library = folder / "binaries" / platform / f"{SCENE}{build.TARGETS[platform].suffix}"
    table = {row.name: row for row in variables(model)}
    places = [row.reference for row in table.values() if row.field == "position"]
    force = table[f"{model.node_names[pushed_node(model)]}.force.z"].reference
    uri = f"file://{'/' if root else ''}{root}{folder}/resources"
    numbers = [str(x) for x in (STEPS, STEP, force, WAVE, places[0], len(places))]
    command = [*runner, str(program), f"{root}{library}", uri, guid, *numbers]
    done = subprocess.run(command, capture_output=True, text=True, env=surroundings, timeout=300)
    assert done.returncode == 0, done.stderr[-2000:]
    return np.array([line.split() for line in done.stdout.splitlines()], dtype=float)


@pytest.fixture(scope="module")
def native(tmp_path_factory) -> np.ndarray:
    """The trajectory of this machine's own library."""
    if here() != "linux64":
        pytest.skip("compares with linux64")
    folder = tmp_path_factory.mktemp("native")
    fmu = pack_native_fmu(scene(SCENE), folder / "one.fmu")
    return steps(fmu, folder / "fmu", "linux64", [], host(folder, None))


@pytest.fixture(scope="module")
def fmu(tmp_path_factory) -> Path:
    """The FMU for all platforms."""
    return pack_native_fmu(scene(SCENE), tmp_path_factory.mktemp("all") / "all.fmu", platforms=tuple(build.TARGETS))


def same(found: np.ndarray, native: np.ndarray) -> None:
    assert found.shape == native.shape
    np.testing.assert_array_equal(found, native)


def test_fmu_of_one_platform_is_small(tmp_path):
    assert pack_native_fmu(scene(SCENE), tmp_path / "one.fmu").stat().st_size <= LIMIT


@pytest.mark.parametrize("arm, plain", [("aarch64-linux", "linux64"), ("aarch64-darwin", "darwin64")])
def test_a_library_for_arm_stands_where_fmpy_looks(arm, plain, tmp_path, monkeypatch):
    """fmpy knows FMI 2.0's names linux64 and darwin64 only; a library for x86-64 that is there keeps its place."""
    other = tmp_path / f"other{build.TARGETS[plain].suffix}"
    other.write_bytes(b"for x86-64")
    monkeypatch.setattr(native_fmu, "here", lambda: arm)
    monkeypatch.setattr(native_fmu, "cross_compiled", lambda name: other)
    alone = pack_native_fmu(scene(SCENE), tmp_path / "alone.fmu")
    both = pack_native_fmu(scene(SCENE), tmp_path / "both.fmu", platforms=(plain,))
    ours = (build.RUNTIME / build.FMU_LIBRARY).read_bytes()
    assert binaries(alone) == {arm: ours, plain: ours}
    assert binaries(both) == {arm: ours, plain: b"for x86-64"}


def binaries(fmu: Path) -> dict[str, bytes]:
    """The libraries in an FMU by platform."""
    with zipfile.ZipFile(fmu) as archive:
        return {name.split("/")[1]: archive.read(name) for name in archive.namelist() if name.startswith("binaries/")}


@pytest.fixture
def tree(tmp_path, monkeypatch) -> Path:
    """A source tree with the files that count for the library: folders of kernel and runtime, and the project's file."""
    for name in ("HERE", "RUNTIME"):
        folder = getattr(build, name)
        copy = tmp_path / folder.parent.name / folder.name
        shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("__pycache__", "tmp*"))
        monkeypatch.setattr(build, name, copy)
    (tmp_path / "pyproject.toml").write_text('name = "tensegrity-fmu"\n', encoding="utf-8")
    monkeypatch.setattr(libraries, "HERE", tmp_path / "fmu_src")
    os.utime(build.RUNTIME / build.FMU_LIBRARY)
    return tmp_path


def age(path: Path, seconds: float) -> None:
    """Make a file as if it had been written so long after the library."""
    moment = (build.RUNTIME / build.FMU_LIBRARY).stat().st_mtime + seconds
    os.utime(path, (moment, moment))


@pytest.mark.parametrize("name", ["fmu_src/native_runtime/fmi2.c", "tensegrity_core/native/tensegrity.h"])
def test_a_library_older_than_its_sources_is_not_packed(name, tree, tmp_path):
    fmu = tmp_path / "one.fmu"
    pack_native_fmu(scene(SCENE), fmu).unlink()
    age(tree / name, 1.0)
    with pytest.raises(PackError, match=r"older than its sources.*pip install -e \."):
        pack_native_fmu(scene(SCENE), fmu)
    assert not fmu.exists()
    (tree / "pyproject.toml").unlink()  # an installed package: unpacking may have given any times
    assert pack_native_fmu(scene(SCENE), fmu).is_file()


def test_a_missing_library_is_told(tree, tmp_path):
    (build.RUNTIME / build.FMU_LIBRARY).unlink()
    with pytest.raises(PackError, match=r"is missing.*pip install -e \."):
        pack_native_fmu(scene(SCENE), tmp_path / "one.fmu")


def test_compiling_for_another_platform_is_told_first(tree, tmp_path, monkeypatch, capsys):
    def compiler(target, name, objects):
        assert capsys.readouterr().out == f"compiling for {name} ...\n"
        target.write_bytes(b"library")
        return target

    monkeypatch.setattr(build, "compile_fmu_library", compiler)
    (tmp_path / "site").mkdir()
    (tmp_path / "site" / "ziglang.py").write_text("", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path / "site")
    words = ["two_bar", "--runtime", "native", "--platforms", "win64", "--no-validate", "--no-page", "--output"]
    words.append(str(tmp_path))
    assert build_fmu.main(words) == 0
    assert build_fmu.main(words) == 0  # nothing to compile: nothing to say
    assert "compiling for" not in capsys.readouterr().out
    assert binaries(tmp_path / "native" / "two_bar.fmu")["win64"] == b"library"
    with (tree / "fmu_src" / "native_runtime" / "fmi2.c").open("a") as source:
        source.write("/* changed */")
    age(tree / "fmu_src" / "native_runtime" / "fmi2.c", -1.0)
    assert build_fmu.main(words) == 0
    assert len(list((tree / "build" / "native" / "win64").glob("*/tensegrity_fmu.dll"))) == 2


@CROSS
def test_zig_compiles_for_any_processor_of_this_platform_and_asks_no_other_compiler(tmp_path, monkeypatch):
    """Without a target it would use all that this processor can do, and look for the C library by `cc`."""
    with monkeypatch.context() as context:
        context.setenv("PATH", str(tmp_path))
        library = build.compile_library(tmp_path, build.zig(), ("-s",))
    assert library.read_bytes()[: len(MAGIC[here()])] == MAGIC[here()]
    (tmp_path / "processor.c").write_text("", encoding="utf-8")
    line = [*build.zig(), "-dM", "-E", str(tmp_path / "processor.c")]
    known = subprocess.run(line, capture_output=True, text=True, check=True).stdout
    assert "__STDC__" in known and not re.findall(r"__(?:AVX|AVX2|FMA|BMI2|SSE4_2|ARM_FEATURE_SVE)__", known)


def test_log_categories_say_what_this_runtime_logs(tmp_path):
    with zipfile.ZipFile(pack_native_fmu(scene(SCENE), tmp_path / "one.fmu")) as archive:
        found = XML.fromstring(archive.read("modelDescription.xml")).iter("Category")
    meanings = {category.get("name"): category.get("description") for category in found}
    assert meanings == LOG_CATEGORIES


@CROSS
@pytest.mark.parametrize("platform", build.TARGETS)
def test_each_library_is_one_of_its_platform_and_small(platform, fmu):
    with zipfile.ZipFile(fmu) as archive:
        content = archive.read(f"binaries/{platform}/{SCENE}{build.TARGETS[platform].suffix}")
        entry = next(item for item in archive.infolist() if item.filename.startswith(f"binaries/{platform}/"))
        rest = sum(item.compress_size for item in archive.infolist() if not item.filename.startswith("binaries/"))
    assert content.startswith(MAGIC[platform])
    assert b"fmi2DoStep" in content
    assert entry.compress_size + rest <= LIMIT


@CROSS
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("platform", ["linux64", "aarch64-linux"])
def test_linux_libraries_need_an_old_c_library_only(platform, kind):
    library = str(cross_compiled(platform, kind=kind))
    done = subprocess.run([program("objdump"), "-T", library], capture_output=True, text=True, check=True)
    found = {tuple(map(int, version.split("."))) for version in re.findall(r"GLIBC_([\d.]+)", done.stdout)}
    assert found and max(found) <= (2, 17)


@CROSS
@pytest.mark.parametrize("kind", ["native", "python"])
@pytest.mark.parametrize("platform", build.TARGETS)
def test_libraries_export_the_functions_of_fmi_and_nothing_else(platform, kind):
    library = cross_compiled(platform, kind=kind)
    names = set(mach_exports(library.read_bytes())) - LINKER if "darwin" in platform else exported(library, platform)
    assert Counter(name[:4] for name in names) == FUNCTIONS[kind]


def exported(library: Path, platform: str) -> set[str]:
    """Names that an ELF or PE library exports, by objdump; skips the test where that cannot read it."""
    option = "-p" if platform == "win64" else "-T"
    done = subprocess.run([program("objdump"), option, str(library)], capture_output=True, text=True)
    if done.returncode:
        pytest.skip("this objdump does not know the format")
    if platform == "win64":
        table = done.stdout.split("[Ordinal/Name Pointer] Table")[1].split("\n\n")[0]
        return set(re.findall(r"(\w+)$", table, re.MULTILINE))
    return set(re.findall(r"^[0-9a-f]+ g .* \.text\s+[0-9a-f]+ .*?(\w+)$", done.stdout, re.MULTILINE))


def mach_commands(content: bytes) -> dict[int, bytes]:
    """Load commands of a Mach-O file of 64 bits by their numbers."""
    found, at = {}, 32
    for _ in range(struct.unpack_from("<I", content, 16)[0]):
        command, size = struct.unpack_from("<2I", content, at)
        found[command] = content[at : at + size]
        at += size
    return found


def mach_exports(content: bytes):
    """Names of functions that a Mach-O file defines for others, without C's underscore."""
    symbols, count, strings, _ = struct.unpack_from("<4I", mach_commands(content)[LC_SYMTAB], 8)
    for i in range(count):
        name, kind, _, _, _ = struct.unpack_from("<IBBHQ", content, symbols + 16 * i)
        if kind & 0x1F == 0x0F and content[strings + name : strings + name + 1] == b"_":  # external, defined in a section
            yield content[strings + name + 1 : content.index(b"\0", strings + name)].decode()


@CROSS
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("platform", ["darwin64", "aarch64-darwin"])
def test_darwin_libraries_load_on_old_systems_and_name_no_folder_of_this_one(platform, kind):
    """None of them can be run here: this looks at what macOS looks at when it loads one."""
    library = cross_compiled(platform, kind=kind)
    commands = mach_commands(library.read_bytes())
    assert commands[LC_ID_DYLIB][24:].rstrip(b"\0") == f"@rpath/{library.name}".encode()
    assert struct.unpack_from("<2I", commands[LC_BUILD_VERSION], 8) == (1, 11 << 16)  # macOS, from version 11 on
    assert (LC_CODE_SIGNATURE in commands) >= (platform == "aarch64-darwin")  # unsigned code is killed there


@CROSS
@pytest.mark.parametrize("kind", ["native", "python"])
@pytest.mark.parametrize("platform", build.TARGETS)
def test_compiling_again_gives_the_same_bytes(platform, kind, tmp_path, monkeypatch):
    """And leaves nothing in the folder of whoever calls."""
    first = cross_compiled(platform, kind=kind)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    again = getattr(build, KINDS[kind].compiler)(tmp_path / first.name, platform)
    assert again.read_bytes() == first.read_bytes() and not list((tmp_path / "here").iterdir())


@CROSS
def test_a_python_fmu_for_all_platforms(tmp_path):
    """A library and a kernel for each; the one for this platform runs."""
    fmu = pack_python_fmu(scene("two_bar"), tmp_path / "two_bar.fmu", platforms=tuple(build.TARGETS))
    assert set(binaries(fmu)) == set(build.TARGETS)
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(tmp_path / "all")
        kernels = {name.split("/")[3] for name in archive.namelist() if name.split("/")[2:3] == ["native"]}
    assert kernels == set(build.TARGETS)
    one = Calls(tmp_path / "all")
    assert one.component and one.start() == 0 and one.step(0.0, 0.01) == 0
    one.free()


@CROSS
def test_linux64_for_old_systems_gives_the_same_trajectory(native, fmu, tmp_path):
    same(steps(fmu, tmp_path / "fmu", "linux64", [], host(tmp_path, None)), native)


@CROSS
def test_win64_gives_the_same_trajectory(native, fmu, tmp_path):
    wine = program(*WINE)
    surroundings = {
        "WINEPREFIX": str(tmp_path / "wine"),
        "WINEDEBUG": "-all",
        "WINEDLLOVERRIDES": "mscoree,mshtml=",
        "HOME": str(tmp_path),
        "PATH": "/usr/bin:/bin",
    }
    same(steps(fmu, tmp_path / "fmu", "win64", [wine], host(tmp_path, "win64"), surroundings, "Z:"), native)


@CROSS
def test_aarch64_linux_gives_the_same_trajectory(native, fmu, tmp_path):
    qemu = program("qemu-aarch64-static", "qemu-aarch64")
    system = Path("/usr/aarch64-linux-gnu")
    if not system.is_dir():
        pytest.skip("needs the C library of aarch64: apt-get install libc6-arm64-cross")
    same(steps(fmu, tmp_path / "fmu", "aarch64-linux", [qemu, "-L", str(system)], host(tmp_path, "aarch64-linux")), native)
