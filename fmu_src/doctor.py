"""The subcommand `tensegrity doctor`: what this installation has, what is missing, and how to get it."""

from __future__ import annotations

import importlib.util
import os
import platform
import sys
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from typing import Any, NamedTuple

from tensegrity_core import __version__
from tensegrity_core.commands.options import Debug, Json
from tensegrity_core.commands.program import DONE, FAILED, tell

REQUIRED = ("numpy", "scipy", "fmpy", "pythonfmu", "pydantic", "matplotlib", "typer")
AGAIN = "install the package anew: pip install --force-reinstall tensegrity-fmu, or in a clone pip install -e ."


class Finding(NamedTuple):
    """subject; state: what was found, in words; remedy: empty where nothing is wrong; needed: whether the package needs it."""

    subject: str
    state: str
    remedy: str = ""
    needed: bool = True


def doctor(json: Json = False, debug: Debug = False) -> int:
    """Say what this installation has, what is missing, and how to get it.  Ends with 1 where it lacks what it needs."""
    found = [*_environment(), *_packages(), *_libraries(), *_tools()]
    tell({"version": __version__, "findings": [f._asdict() for f in found]} if json else _text(found))
    return FAILED if any(f.remedy and f.needed for f in found) else DONE


def _text(found: list[Finding]) -> str:
    width = max(len(f.subject) for f in found)
    marks = {(False, True): "ok", (False, False): "ok", (True, True): "MISSING", (True, False): "absent"}
    lines = [f"{marks[bool(f.remedy), f.needed]:<8}{f.subject:<{width}}  {f.state}" for f in found]
    remedies = [f"        {f.subject}: {f.remedy}" for f in found if f.remedy]
    return "\n".join([*lines, *(["", "Remedies:", *remedies] if remedies else [])])


def _environment() -> Iterator[Finding]:
    yield Finding("tensegrity", f"{__version__} in {Path(__file__).parents[1]}")
    old = "" if sys.version_info >= (3, 11) else "use Python 3.11 or newer"
    yield Finding("Python", f"{platform.python_version()} at {sys.executable}", old)
    yield Finding("platform", f"{platform.platform()}, {os.cpu_count()} processors")


def _packages() -> Iterator[Finding]:
    for name in REQUIRED:
        try:
            yield Finding(name, metadata.version(name))
        except metadata.PackageNotFoundError:
            yield Finding(name, "not installed", f"pip install {name}")


def _libraries() -> Iterator[Finding]:
    """The kernel and the FMUs' libraries for this platform."""
    from .packing.libraries import KINDS, PackError, host_library

    for kind in KINDS:
        name = {"kernel": "kernel", "native": "native FMU's library", "python": "Python FMU's library"}[kind]
        try:
            path = host_library(kind)
        except PackError as failure:
            yield Finding(name, str(failure), AGAIN)
            continue
        yield _kernel(path) if kind == "kernel" else Finding(name, f"{path.name}, {path.stat().st_size:,} bytes")


def _kernel(path: Path) -> Finding:
    """Whether it runs: a pendulum for a hundredth of a second."""
    from tensegrity_core import kernel
    from tensegrity_core.model import grid, held
    from tensegrity_core.scene import load_scene
    from tensegrity_core.statics import build_model

    try:
        model = build_model(load_scene("two_bar"))
        kernel.simulate(model, held(model, grid(0.01, 0.01)), "auto", 1e-8)
    except Exception as failure:  # whatever the system says of a library that it cannot load
        return Finding("kernel", f"{path.name} does not run: {failure}", AGAIN)
    return Finding("kernel", f"{path.name}, {path.stat().st_size:,} bytes, runs")


def _tools() -> Iterator[Finding]:
    """What some options need."""
    from tensegrity_core.native import build

    from .places import kept
    from .validation.reference_cache import trouble
    from .validation.validate import CACHE

    compiler: Any = build.system_compiler()
    text = "not needed: libraries come with the wheel, and a clone fetches ziglang"
    yield Finding("C compiler", " ".join(compiler) if compiler else text, needed=False)
    if importlib.util.find_spec("ziglang"):
        yield Finding("ziglang", f"{metadata.version('ziglang')}: FMUs for other platforms can be built", needed=False)
    else:
        wanted = "pip install ziglang"
        yield Finding("ziglang", "not installed: no FMUs for other platforms (--platforms)", wanted, needed=False)
    yield _page()
    yield Finding("cache", f"{kept()}: {trouble(CACHE) or 'reference runs are kept there'}", needed=False)


def _page() -> Finding:
    """What `tensegrity view` fills its pages with."""
    from tensegrity_core.output.page import bundle, found

    if folder := found():
        return Finding("web page", f"{folder}: tensegrity view works", needed=False)
    if lacking := bundle.missing():
        return Finding(
            "web page", "not built: no tensegrity view, none in FMUs", f"pip install {' '.join(lacking)}", needed=False
        )
    return Finding("web page", "not built yet: the first view or build does, which takes a minute and npm", needed=False)
