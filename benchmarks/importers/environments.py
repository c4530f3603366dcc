"""Gives each tool what it needs, in folders of its own under build/importers: nothing of the machine is changed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

from .tools import Tool

#: Wall time after which an installation is given up, s.
LIMIT = 600.0
#: The same of a program that is compiled here.
COMPILING = 3600.0


class Missing(Exception):
    """A tool that cannot be had here; the text says why."""


def python_of(tool: Tool, base: Path) -> Path:
    """The interpreter of an environment with the tool's packages, made at the first call.  Raises Missing."""
    pinned = [package.replace("==", "-") for package in tool.packages if "==" in package]
    name = "+".join(pinned or tool.packages[:1]) or "bare"
    folder = base / "environments" / name
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if (folder / "ready").is_file():
        return python
    shutil.rmtree(folder, ignore_errors=True)
    _run([sys.executable, "-m", "venv", str(folder)])
    if tool.packages:
        # a tool that nobody has run here is not built from source: that takes compilers and libraries of its own
        wheels = [] if tool.driver else ["--only-binary", ":all:"]
        _run([str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *wheels, *tool.packages])
    (folder / "ready").touch()
    return python


def version_of(tool: Tool, python: Path) -> str:
    if tool.maven:
        return tool.maven.split(":")[2]
    if tool.crate:
        return tool.crate.split("==")[1]
    if tool.command:
        return _run([str(_found(tool.command)), "--version"]).split()[-1]
    package = tool.packages[0].split("==")[0]
    code = f"from importlib.metadata import version; print(version({package!r}))"
    return _run([str(python), "-c", code]).strip()


def libraries_of(tool: Tool, base: Path) -> Path | None:
    """Folder of libraries out of Debian's packages, unpacked and not installed; None where none are needed."""
    if not tool.debian:
        return None
    folder = base / "debian"
    if not (folder / "ready").is_file():
        folder.mkdir(parents=True, exist_ok=True)
        if not shutil.which("apt-get"):
            raise Missing(f"needs {tool.debian[0]}, which is fetched from Debian only")
        _run(["apt-get", "download", *tool.debian], folder)
        for package in folder.glob("*.deb"):
            _run(["dpkg-deb", "-x", str(package), str(folder)])
        (folder / "ready").touch()
    return next(path.parent for path in sorted(folder.rglob("libtbb.so.12")))


def program_of(tool: Tool, base: Path) -> Path | None:
    """The .jar of a tool in Java, the program of one in Rust; None where it has none.  Raises Missing."""
    if tool.crate:
        return _compiled(tool, base)
    if tool.command:
        return _found(tool.command)
    if not tool.maven:
        return None
    folder = base / "maven"
    _group, name, version, kind, classifier = tool.maven.split(":")
    jar = folder / f"{name}-{version}-{classifier}.{kind}"
    if not jar.is_file():
        for program in ("java", "mvn"):
            if not shutil.which(program):
                raise Missing(f"needs {program}")
        _run(["mvn", "-q", "-B", "dependency:copy", f"-Dartifact={tool.maven}", f"-DoutputDirectory={folder}"])
    return jar


def _found(command: str) -> Path:
    """A program of the machine's."""
    found = shutil.which(command)
    if found is None:
        raise Missing(f"{command} is not on the path")
    return Path(found)


def _compiled(tool: Tool, base: Path) -> Path:
    """A crate's program.  Its bindings are made with libclang, which the tool's packages bring; the headers are GCC's."""
    name, version = tool.crate.split("==")
    program = base / "cargo" / "bin" / name
    if program.is_file():
        return program
    for needed in ("cargo", "gcc"):
        if not shutil.which(needed):
            raise Missing(f"needs {needed}")
    (clang,) = {path.parent for path in (base / "environments").glob("libclang-*/lib/**/libclang.so")}
    headers = _run(["gcc", "-print-file-name=include"]).strip()
    added = {"LIBCLANG_PATH": str(clang), "BINDGEN_EXTRA_CLANG_ARGS": f"-I{headers}"}
    _run(["cargo", "install", name, "--version", version, "--root", str(base / "cargo"), "--debug"], None, added, COMPILING)
    return program


def _run(command: list[str], folder: Path | None = None, added: dict[str, str] | None = None, limit: float = LIMIT) -> str:
    try:
        surroundings = os.environ | (added or {})
        done = subprocess.run(command, cwd=folder, env=surroundings, capture_output=True, text=True, timeout=limit)
    except subprocess.TimeoutExpired:
        raise Missing(f"{Path(command[0]).name} did not end within {limit:g} s") from None
    if done.returncode:
        raise Missing(last_words(done.stdout + done.stderr))
    return done.stdout


def last_words(text: str) -> str:
    """The line of a program's output that says what went wrong."""
    lines = [line.strip() for line in text.splitlines() if line.strip() and not line.strip().startswith("at ")]  # Java's stack
    named = [line for line in lines if "rror" in line or "xception" in line]
    return (named or lines or ["no message"])[-1][:300]
