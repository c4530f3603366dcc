"""The libraries that FMUs carry: compiled for this platform when the package was installed, for others by ``ziglang``."""

from __future__ import annotations

import hashlib
import importlib.util
import platform
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from tensegrity_core.errors import TensegrityError
from tensegrity_core.files import replacing_folder
from tensegrity_core.native import build

from ..places import clone, kept

HERE = Path(__file__).parent.parent

#: Where importers such as fmpy look for the library on ARM: they go by the operating system's name alone, as in FMI 2.0.
ON_ARM = {"aarch64-linux": "linux64", "aarch64-darwin": "darwin64"}

#: What FMI 3.0 calls the platforms, where that differs from FMI 2.0.
TUPLES = {"linux64": "x86_64-linux", "win64": "x86_64-windows", "darwin64": "x86_64-darwin"}


class PackError(TensegrityError):
    """An FMU that cannot be packed here."""


class Kind(NamedTuple):
    """One of the libraries.  folder: of the one for this platform, below the project's root; compiler: of build.py."""

    folder: str
    compiler: str


#: native: of the native FMU; python: of the Python FMU; kernel: that the Python FMU's modules load.
KINDS = {
    "native": Kind("fmu_src/native_runtime", "compile_fmu_library"),
    "python": Kind("fmu_src/python_runtime", "compile_python_library"),
    "kernel": Kind("tensegrity_core/native", "compile_kernel"),
}


def here() -> str:
    """FMI's name of the platform that runs this, such as linux64.  Raises PackError."""
    key = sys.platform, platform.machine().lower()
    if key not in build.HOSTS:
        raise PackError(f"FMI 2.0 has no name for the platform {'/'.join(key)}; known: {', '.join(build.HOSTS.values())}")
    return build.HOSTS[key]


def host_library(kind: str = "native") -> Path:
    """The library for this platform.  Raises PackError where it is missing, or in a source tree older than its sources."""
    library = HERE.parent / KINDS[kind].folder / build.file_name(kind)
    if not library.is_file():
        raise PackError(f"{library} is missing; install this package anew: pip install -e .")
    if clone(HERE) and not is_current(library, kind):
        raise PackError(f"{library} is older than its sources; compile it anew: pip install -e .")
    return library


def is_current(library: Path, kind: str = "native") -> bool:
    """Whether a library is there and its sources have not changed since it was compiled."""
    return library.is_file() and library.stat().st_mtime >= max(path.stat().st_mtime for path in build.reads(kind))


def sources_digest(kind: str = "native") -> str:
    """Stands for the content of those files; their times say nothing in an installed package."""
    digest = hashlib.sha256()
    for path in build.reads(kind):
        digest.update(f"{path.name}\0{path.stat().st_size}\0".encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cross_compiled(name: str, say: Callable[[str], object] = lambda text: None, kind: str = "native") -> Path:
    """The library for another platform, compiled once for each state of its sources.  Raises PackError.

    say: told when the compiler starts, which takes up to a minute.
    """
    if name not in build.TARGETS:
        raise PackError(f"platform {name!r}: use one of {', '.join(build.TARGETS)}")
    target = kept(HERE) / kind / name / sources_digest(kind) / build.file_name(kind, name)
    if target.is_file():
        return target
    if importlib.util.find_spec("ziglang") is None:
        raise PackError(f"a library for {name} is compiled by ziglang; install it: pip install ziglang")
    say(f"compiling for {name} ...")
    try:
        with replacing_folder(target.parent) as fresh:
            getattr(build, KINDS[kind].compiler)(fresh / target.name, name, kept(HERE) / "objects")
        return target
    except RuntimeError as error:
        raise PackError(str(error)) from error


def on_arm(libraries: dict[str, Path]) -> dict[str, Path]:
    """The libraries by platform, those for ARM also where importers look for them."""
    return libraries | {ON_ARM[arm]: libraries[arm] for arm in ON_ARM if arm in libraries and ON_ARM[arm] not in libraries}


def tuples(libraries: dict[str, Path]) -> dict[str, Path]:
    """The libraries by what FMI 3.0 calls their platforms."""
    return {TUPLES.get(name, name): path for name, path in libraries.items()}
