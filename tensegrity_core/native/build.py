"""Compile the C sources: the kernel into a shared library beside this file, and kernel and FMI functions into the library of
the native FMU.  Called by the build of the package (pyproject.toml), and to build FMUs for other platforms.

The system's C compiler is used where there is one, else the one in the ``ziglang`` package, which the build then asks for.
The FMI headers are those of the installed fmpy.
"""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import NamedTuple

try:
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface
except ModuleNotFoundError:  # outside of a build of the package
    BuildHookInterface = object

HERE = Path(__file__).resolve().parent
RUNTIME = HERE.parent.parent / "fmu_src" / "native_runtime"
LIBRARY = {"win32": "tensegrity.dll", "darwin": "libtensegrity.dylib"}.get(sys.platform, "libtensegrity.so")
FMU_LIBRARY = "tensegrity_fmu" + {"win32": ".dll", "darwin": ".dylib"}.get(sys.platform, ".so")
#: Runs on any processor of the platform's baseline; contraction off, so that platforms agree to the last digits.
FLAGS = ["-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fvisibility=hidden", "-shared"]


class Target(NamedTuple):
    """A platform of FMUs.  suffix: of its libraries; triple: zig's name, with the oldest C library or system that will do."""

    suffix: str
    triple: str


#: By FMI's name of the platform.
TARGETS = {
    "linux64": Target(".so", "x86_64-linux-gnu.2.17"),
    "win64": Target(".dll", "x86_64-windows-gnu"),
    "darwin64": Target(".dylib", "x86_64-macos.11.0"),
    "aarch64-linux": Target(".so", "aarch64-linux-gnu.2.17"),
    "aarch64-darwin": Target(".dylib", "aarch64-macos.11.0"),
}


def system_compiler() -> list[str] | None:
    """Command of a GCC-like compiler: CC if it is set, else the first found; None where there is none."""
    if os.environ.get("CC"):
        return os.environ["CC"].split()
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    return None


def zig() -> list[str]:
    """Command of the compiler in the ``ziglang`` package."""
    return [sys.executable, "-m", "ziglang", "cc"]


def kernel_sources() -> list[Path]:
    return sorted(HERE.glob("*.c"))


def runtime_sources() -> list[Path]:
    return sorted(RUNTIME.glob("*.c"))


def fmi_headers() -> Path:
    """Folder of the FMI headers.  Raises RuntimeError where fmpy is missing."""
    found = importlib.util.find_spec("fmpy")
    if found is None or not found.origin:
        raise RuntimeError("the FMI headers come with fmpy, which is not installed: pip install fmpy")
    return Path(found.origin).parent / "c-code"


def _compile(target: Path, command: list[str], sources: list[Path], options: list[str], windows: bool) -> Path:
    """Compile a library that appears whole or not at all.  Raises RuntimeError with the compiler's words."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as scratch:
        fresh = Path(scratch) / target.name
        extra = [] if windows else ["-fPIC", "-lm"]
        line = [*command, *FLAGS, *options, *map(str, sources), *extra, "-o", str(fresh)]
        run = subprocess.run(line, capture_output=True, text=True)
        if run.returncode:
            raise RuntimeError(f"compiling {target.name} failed; command: {' '.join(line)}\n{run.stderr}")
        os.replace(fresh, target)
    return target


def compile_library(directory: Path, command: list[str] | None = None) -> Path:
    """The kernel for this platform, into a folder."""
    command = command or system_compiler() or zig()
    return _compile(directory / LIBRARY, command, kernel_sources(), [], sys.platform == "win32")


def compile_fmu_library(target: Path, platform: str | None = None) -> Path:
    """The native FMU's library; platform: a key of TARGETS, then zig compiles for it, or None for this platform."""
    command, windows = system_compiler() or zig(), sys.platform == "win32"
    if platform is not None:
        command, windows = [*zig(), "-target", TARGETS[platform].triple], platform.startswith("win")
    options = ["-DTS_INTERNAL", "-s", f"-I{fmi_headers()}", f"-I{HERE}"]
    if platform and "darwin" in platform:  # else the folder of this compilation is written into the library
        options.append(f"-Wl,-install_name,@rpath/{target.name}")
    return _compile(target, command, runtime_sources() + kernel_sources(), options, windows)


class KernelHook(BuildHookInterface):
    """Builds the libraries for wheels and editable installs alike."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        return [] if system_compiler() or importlib.util.find_spec("ziglang") else ["ziglang"]

    def initialize(self, version: str, build_data: dict) -> None:
        if self.target_name != "wheel":
            return
        libraries = [compile_library(HERE), compile_fmu_library(RUNTIME / FMU_LIBRARY)]
        build_data["pure_python"] = False
        build_data["tag"] = "py3-none-" + sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["artifacts"] += [library.relative_to(Path(self.root)).as_posix() for library in libraries]
