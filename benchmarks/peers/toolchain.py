"""Compile the peers with the kernel's own sources: a program that times them, and a library for SciPy.

SUNDIALS 6 (Debian: libsundials-dev) is needed for its rows only.
"""

from __future__ import annotations

import importlib.util
import subprocess
from pathlib import Path
from typing import NamedTuple

HERE = Path(__file__).resolve().parent
NATIVE = HERE.parent.parent / "tensegrity_core" / "native"
SUNDIALS_SOURCES = ("cvode.c", "arkode.c", "sundials_functions.c")
SUNDIALS_LIBRARIES = ("cvode", "arkode", "nvecserial", "sunmatrixdense", "sunlinsoldense", "sunnonlinsolfixedpoint")
MISSING = "SUNDIALS 6 is missing (Debian: apt-get install libsundials-dev); its rows are left out"


class Tools(NamedTuple):
    """program: see main.c; library: see peer.h; sundials: its version, or None where it is missing."""

    program: Path
    library: Path
    sundials: str | None


def _kernel_build():
    """tensegrity_core/native/build.py, which is not part of the package."""
    spec = importlib.util.spec_from_file_location("kernel_build", NATIVE / "build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def _sundials_version(compiler: list[str]) -> str | None:
    """Version in the headers; None where there are none, or of a release with another interface."""
    probe = "#include <sundials/sundials_config.h>\nversion SUNDIALS_VERSION\n"
    run = subprocess.run([*compiler, "-x", "c", "-E", "-P", "-"], input=probe, capture_output=True, text=True)
    if run.returncode:
        return None
    version = run.stdout.split("version")[-1].strip().strip('"')
    return version if version.startswith("6.") else None


def _compile(command: list[str]) -> None:
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode:
        raise SystemExit(f"compiling the peers failed; command: {' '.join(command)}\n{run.stderr}")


def build(folder: Path) -> Tools:
    """Compile into a folder, with the flags of the kernel.  Says so where SUNDIALS is missing."""
    kernel_build = _kernel_build()
    compiler = kernel_build.system_compiler()
    if compiler is None:
        raise SystemExit("no C compiler found; install one (Debian: apt-get install gcc) or set CC")
    flags = [flag for flag in kernel_build.FLAGS if flag != "-shared"] + [f"-I{NATIVE}", f"-I{HERE}"]
    kernel = sorted(str(path) for path in NATIVE.glob("*.c"))
    plain = [str(HERE / name) for name in ("peer.c", "kernel.c")]
    version = _sundials_version(compiler)
    extra = []
    if version:
        extra = ["-DWITH_SUNDIALS", *(str(HERE / name) for name in SUNDIALS_SOURCES)]
        extra += [f"-lsundials_{name}" for name in SUNDIALS_LIBRARIES]
    else:
        print(MISSING)
    program, library = folder / "peers", folder / "libpeers.so"
    _compile([*compiler, *flags, str(HERE / "main.c"), *plain, *kernel, *extra, "-lm", "-o", str(program)])
    _compile([*compiler, *flags, "-shared", "-fPIC", str(HERE / "peer.c"), *kernel, "-lm", "-o", str(library)])
    return Tools(program, library, version)
