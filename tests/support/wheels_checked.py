"""Builds the wheels for all platforms and checks each as far as this machine can: ``python -m tests.support.wheels_checked``

Every wheel: its files are those of the tree, its libraries those of the platform.  linux64: in fresh environments of every
Python that is named, without a compiler, in a folder `ü #1`: check, build and validate.  aarch64-linux: Debian's Python for
aarch64 under qemu, with the dependencies' wheels for aarch64: the same trajectories as here.  win64 and macOS: contents only;
the libraries are to the last bit those that test_native_platforms.py runs under wine or looks into.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import numpy as np

from fmu_src.packing.libraries import KINDS, cross_compiled
from tensegrity_core.native import build, wheels
from tensegrity_core.output.page.bundle import FILES
from tensegrity_core.output.page.made import BUILT

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("tensegrity_core", "fmu_src")
MAGIC = {".so": b"\x7fELF", ".dll": b"MZ", ".dylib": b"\xcf\xfa\xed\xfe"}
PROCESSOR = {"linux64": b"\x3e\x00", "aarch64-linux": b"\xb7\x00"}  # in an ELF file's head
DEBIAN = (
    "python3.11-minimal libpython3.11-minimal libpython3.11-stdlib libc6 libexpat1 zlib1g libssl3 libffi8 libsqlite3-0 liblzma5"
)
DEBIAN += " libbz2-1.0 libgcc-s1 libstdc++6 libuuid1 libcrypt1"
SERIES = """
import json, sys
from tensegrity_core.kernel import simulate
from tensegrity_core.model import grid, held
from tensegrity_core.scene import builtin_scenes, load_scene
from tensegrity_core.statics import build_model
found = {}
for name in builtin_scenes():
    model = build_model(load_scene(name))
    found[name] = simulate(model, held(model, grid(1.0, 0.01)), "dop853", 1e-10).position.tolist()
print(json.dumps(found))
"""


def libraries(platform: str | None) -> set[str]:
    """Names in a wheel."""
    folders = {"kernel": build.HERE, "native": build.RUNTIME, "python": build.PYTHON_RUNTIME}
    return {(folder / build.file_name(kind, platform)).relative_to(ROOT).as_posix() for kind, folder in folders.items()}


def check_contents(wheel: Path, platform: str) -> None:
    """Raises AssertionError."""
    target, compiled = build.TARGETS[platform], set(MAGIC)
    tree = [path for package in PACKAGES for path in (ROOT / package).rglob("*") if path.is_file()]
    kept = {
        path.relative_to(ROOT).as_posix() for path in tree if path.suffix not in compiled and "__pycache__" not in path.parts
    }
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        (label,) = (archive.read(name).decode() for name in archive.namelist() if name.endswith(".dist-info/WHEEL"))
        heads = [archive.read(name)[:20] for name in libraries(platform)]
    assert wheel.name.endswith(f"-py3-none-{target.tag}.whl") and f"Tag: py3-none-{target.tag}\n" in label, label
    assert "Root-Is-Purelib: false" in label
    whole = kept | libraries(platform) | {(BUILT / name).relative_to(ROOT).as_posix() for name in FILES}
    assert names == whole, names ^ whole
    for head in heads:
        assert head.startswith(MAGIC[target.suffix]) and head[18:20] == PROCESSOR.get(platform, head[18:20])


def check_libraries(wheel: Path, platform: str) -> None:
    """They are those that FMUs for the platform carry.  Raises AssertionError."""
    with zipfile.ZipFile(wheel) as archive:
        for kind, place in KINDS.items():
            library = cross_compiled(platform, kind=kind)
            assert archive.read(f"{place.folder}/{library.name}") == library.read_bytes(), library.name


def run(command: list, folder: Path, surroundings: dict[str, str], code: int = 0) -> str:
    done = subprocess.run([*map(str, command)], cwd=folder, env=surroundings, capture_output=True, text=True, encoding="utf-8")
    assert done.returncode == code, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout


def surroundings_of(folder: Path, path: str = "/nowhere") -> dict[str, str]:
    """Of a user who has a home and nothing else: no compiler, no settings."""
    (folder / "home").mkdir(exist_ok=True)
    return {"HOME": str(folder / "home"), "PATH": path, "LANG": "C.UTF-8", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}


def check_here(wheel: Path, python: str, folder: Path) -> str:
    """A fresh environment of a Python.  Returns the rows of the table that `build` prints."""
    home = folder / "ü #1"
    home.mkdir()
    settings = surroundings_of(home)
    pip = {
        name: value
        for name, value in os.environ.items()
        if name.startswith(("PIP_", "SSL_", "REQUESTS_")) or "proxy" in name.lower()
    }
    run([python, "-m", "venv", home / "venv"], home, settings)
    own = home / "venv" / "bin" / "python"
    # pip looks for its own settings where the true home is
    run(
        [own, "-m", "pip", "install", "--quiet", wheel],
        home,
        os.environ | settings | pip | {"HOME": os.environ.get("HOME", "/")},
    )
    run([own, "-I", "-m", "tensegrity_core", "check", "three_bar_nsh"], home, settings)
    shown = run([own, "-I", "-m", "fmu_src.build", "three_bar_nsh"], home, settings)
    return "\n  ".join(line for line in shown.splitlines() if line.startswith("three_bar_nsh "))


def check_aarch64(wheel: Path, folder: Path) -> str:
    """Under qemu.  Returns the largest difference from this machine's trajectories, in words."""
    qemu = shutil.which("qemu-aarch64-static") or shutil.which("qemu-aarch64")
    if not (qemu and shutil.which("apt-get") and shutil.which("dpkg")):
        return "contents only: needs qemu-aarch64, apt-get and dpkg"
    lists = [
        "-o",
        "APT::Architecture=arm64",
        "-o",
        f"Dir::State::Lists={folder / 'lists'}",
        "-o",
        f"Dir::Cache={folder / 'cache'}",
    ]
    lists += ["-o", "APT::Architectures=arm64", "-qq"]
    for name in ("lists", "cache"):
        (folder / name / "partial").mkdir(parents=True)
    run(["apt-get", *lists, "update"], folder, dict(os.environ))
    run(["apt-get", *lists, "download", *DEBIAN.split()], folder, dict(os.environ))
    for package in folder.glob("*.deb"):
        run(["dpkg", "-x", package, folder / "root"], folder, dict(os.environ))
    tags = [word for glibc in (17, 27, 28) for word in ("--platform", f"manylinux_2_{glibc}_aarch64")]
    tags += ["--platform", "manylinux2014_aarch64", "--python-version", "3.11", "--implementation", "cp"]
    tags += ["--abi", "cp311", "--abi", "abi3", "--abi", "none", "--only-binary=:all:", "--target", str(folder / "site")]
    run([sys.executable, "-m", "pip", "install", "--quiet", *tags, wheel], folder, dict(os.environ))
    settings = {"PYTHONPATH": str(folder / "site"), "PYTHONHOME": str(folder / "root" / "usr")}
    there = run([qemu, "-L", folder / "root", folder / "root/usr/bin/python3.11", "-c", SERIES], folder, settings)
    here = run([sys.executable, "-c", SERIES], ROOT, dict(os.environ))
    found, wanted = (json.loads(text.splitlines()[-1]) for text in (there, here))
    error = max(float(np.abs(np.array(found[name]) - np.array(wanted[name])).max()) for name in wanted)
    assert found.keys() == wanted.keys() and error < 1e-9, error
    return f"six scenes under qemu: at most {error:.1e} m off this machine's"


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.support.wheels_checked")
    parser.add_argument(
        "--pythons", nargs="+", default=[sys.executable], metavar="FILE", help="Pythons for linux64 (default: this one)"
    )
    parser.add_argument("--platforms", nargs="+", choices=build.TARGETS, default=list(build.TARGETS), help="default: all")
    options = parser.parse_args(words)
    for platform in options.platforms:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            wheel = wheels.build_wheel(platform, folder)
            check_contents(wheel, platform)
            check_libraries(wheel, platform)
            print(f"{platform}: {wheel.name}, {wheel.stat().st_size:,} bytes: contents as they must be", flush=True)
            if platform == "aarch64-linux":
                print(f"  {check_aarch64(wheel, folder)}", flush=True)
            if platform == "linux64":
                for i, python in enumerate(options.pythons):
                    (folder / str(i)).mkdir()
                    print(f"  {python}:\n  {check_here(wheel, python, folder / str(i))}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
