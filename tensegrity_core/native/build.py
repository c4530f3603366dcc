"""Compile the kernel into a shared library beside this file.  Called by the build of the package; see pyproject.toml.

The system's C compiler is used where there is one, else the one in the ``ziglang`` package, which the build then asks for.
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

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

HERE = Path(__file__).resolve().parent
LIBRARY = {"win32": "tensegrity.dll", "darwin": "libtensegrity.dylib"}.get(sys.platform, "libtensegrity.so")
#: Runs on any processor of the platform's baseline; contraction off, so that platforms agree to the last digits.
FLAGS = ["-std=c99", "-O3", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-fvisibility=hidden", "-shared"]


def system_compiler() -> list[str] | None:
    """Command of a GCC-like compiler: CC if it is set, else the first found; None where there is none."""
    if os.environ.get("CC"):
        return os.environ["CC"].split()
    for name in ("cc", "gcc", "clang"):
        if shutil.which(name):
            return [name]
    return None


def compile_library(directory: Path, command: list[str] | None = None) -> Path:
    """Compile all sources of this folder; the library appears whole or not at all."""
    command = command or system_compiler() or [sys.executable, "-m", "ziglang", "cc"]
    target = directory / LIBRARY
    with tempfile.TemporaryDirectory(dir=directory) as scratch:
        fresh = Path(scratch) / LIBRARY
        extra = [] if sys.platform == "win32" else ["-fPIC", "-lm"]
        sources = sorted(str(path) for path in HERE.glob("*.c"))
        run = subprocess.run([*command, *FLAGS, *sources, *extra, "-o", str(fresh)], capture_output=True, text=True)
        if run.returncode:
            raise RuntimeError(f"compiling the kernel failed; command: {' '.join(run.args)}\n{run.stderr}")
        os.replace(fresh, target)
    return target


class KernelHook(BuildHookInterface):
    """Builds the kernel for wheels and editable installs alike."""

    PLUGIN_NAME = "custom"

    def dependencies(self) -> list[str]:
        return [] if system_compiler() or importlib.util.find_spec("ziglang") else ["ziglang"]

    def initialize(self, version: str, build_data: dict) -> None:
        if self.target_name != "wheel":
            return
        library = compile_library(HERE)
        build_data["pure_python"] = False
        build_data["tag"] = "py3-none-" + sysconfig.get_platform().replace("-", "_").replace(".", "_")
        build_data["artifacts"].append(library.relative_to(Path(self.root)).as_posix())
