"""Compile C programs of the benchmarks with the kernel's own sources and flags; above all the peers: a program that times
them, and a library for SciPy.

SUNDIALS 6 (Debian: libsundials-dev) is needed for its rows only.
"""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import NamedTuple

from tensegrity_core.native import build as kernel_build

HERE = Path(__file__).resolve().parent
NATIVE = HERE.parent.parent / "tensegrity_core" / "native"
SUNDIALS_LIBRARIES = ("cvode", "arkode", "nvecserial", "sunmatrixdense", "sunlinsoldense", "sunnonlinsolfixedpoint")
MISSING = "SUNDIALS 6 is missing (Debian: apt-get install libsundials-dev); its rows are left out"


class Tools(NamedTuple):
    """program: see main.c; library: see peer.h; sundials: its version, or None where it is missing."""

    program: Path
    library: Path
    sundials: str | None


def _sundials_version(compiler: list[str]) -> str | None:
    """Version in the headers; None where there are none, or of a release with another interface."""
    probe = "#include <sundials/sundials_config.h>\nversion SUNDIALS_VERSION\n"
    run = subprocess.run([*compiler, "-x", "c", "-E", "-P", "-"], input=probe, capture_output=True, text=True)
    if run.returncode:
        return None
    version = run.stdout.split("version")[-1].strip().strip('"')
    return version if version.startswith("6.") else None


def compiler() -> list[str]:
    """Command of the system's C compiler; SystemExit names the remedy where there is none."""
    found = kernel_build.system_compiler()
    if found is None:
        raise SystemExit("no C compiler found; install one (Debian: apt-get install gcc) or set CC")
    return found


def kernel_sources(without: str = "") -> list[str]:
    """Paths of the kernel's C files, but for one that is replaced."""
    return [str(path) for path in kernel_build.kernel_sources() if path.name != without]


def compile_program(sources: list[str], target: Path, extra: list[str] | None = None) -> Path:
    """An executable with the kernel's flags; extra: further arguments, such as libraries."""
    _compile([*compiler(), *_flags(), *sources, *(extra or []), "-lm", "-o", str(target)])
    return target


def compile_objects(sources: list[str], folder: Path) -> list[str]:
    """Object files of these sources, for libraries as well, with the kernel's flags; no two sources have one name."""
    _compile([*compiler(), *_flags(), "-fPIC", "-c", *sources], folder)
    return [str(folder / Path(source).with_suffix(".o").name) for source in sources]


def _flags() -> list[str]:
    return [*kernel_build.FLAGS, "-DTS_EXPORTED", f"-I{NATIVE}", f"-I{HERE}"]


def _compile(command: list[str], folder: Path | None = None) -> None:
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if run.returncode:
        raise SystemExit(f"compiling failed; command: {' '.join(command)}\n{run.stderr}")


def build(folder: Path) -> Tools:
    """Compile into a folder, with the flags of the kernel.  Says so where SUNDIALS is missing."""
    objects = compile_objects([str(HERE / "peer.c"), *kernel_sources()], folder)  # which both need
    sources = [str(HERE / "main.c"), str(HERE / "kernel.c"), *objects]
    version = _sundials_version(compiler())
    extra = []
    if version:
        extra = ["-DWITH_SUNDIALS", str(HERE / "sundials.c"), *(f"-lsundials_{name}" for name in SUNDIALS_LIBRARIES)]
    else:
        print(MISSING)
    program, library = folder / "peers", folder / "libpeers.so"
    compile_program(sources, program, extra)
    compile_program(objects, library, ["-shared"])
    return Tools(program, library, version)
