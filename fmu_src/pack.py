"""Packs an FMU: byte-reproducible (the same content gives the same bytes) and atomic (a whole file or none).

The core goes in under a private name with a hash of its content: a process may hold FMUs of several versions of this
project, or the project itself, and each runs its own copy.  pythonfmu's Python half goes in beside it, for the same
reason.
"""

from __future__ import annotations

import hashlib
import json
import platform
import sys
import zipfile
from importlib import metadata
from pathlib import Path

import pythonfmu

import tensegrity_core
from tensegrity_core.errors import TensegrityError
from tensegrity_core.files import replacing
from tensegrity_core.kernel import LIBRARY
from tensegrity_core.model import Model, to_bytes

from .closure import import_closure
from .documentation import index_html
from .drawing import model_png
from .interface import by_reference, Variable, variables
from .model_description import Experiment, Runtime, content_guid, model_description, plain
from .places import clone, DISTRIBUTION

HERE = Path(__file__).parent
CORE = Path(tensegrity_core.__file__).parent
PYTHONFMU = Path(pythonfmu.__file__).parent

#: Modules of pythonfmu that a slave needs.
PYTHONFMU_MODULES = ("_version", "default_experiment", "enums", "fmi2slave", "logmsg", "variables")

#: FMI platforms for which pythonfmu brings a binary, by (sys.platform, machine): (FMI name, suffix of the binary).
PLATFORMS = {
    ("linux", "x86_64"): ("linux64", ".so"),
    ("win32", "amd64"): ("win64", ".dll"),
}

_EPOCH = (1980, 1, 1, 0, 0, 0)

_MAIN = '''"""Imported by pythonfmu's binary, which takes the class below as the FMU."""

import ctypes

from {core}.python_runtime.slave import TensegritySlave

# The binary (pythonfmu 0.7.0, findClass) releases this module's namespace at each instantiation although it has only
# borrowed it.  This module runs at each instantiation, too: lend one reference, or the namespace is freed while in use.
ctypes.pythonapi.Py_IncRef(ctypes.py_object(globals()))
'''


class PackError(TensegrityError):
    """An FMU that cannot be packed here."""


def pack_python_fmu(
    model: Model, destination: Path, naming: str = "structured", library: Path | None = None, simple: bool = False
) -> Path:
    """Write the FMU of a model, over pythonfmu, for the platform that runs this; returns its path.

    destination: the .fmu file; library: the kernel's C library, by default the one that this Python uses; naming: of
    the variables, 'structured' or 'flat'; simple: see model_description.plain.  Raises PackError where pythonfmu has no
    binary for this platform.
    """
    files = python_fmu_files(model, naming, library or CORE / "native" / LIBRARY, simple)
    write_zip(destination, files)
    return destination


def python_fmu_files(model: Model, naming: str, library: Path, simple: bool = False) -> dict[str, bytes]:
    """Everything in the FMU: path inside the archive -> content."""
    binary_platform, suffix = _platform()
    table = variables(model, naming)
    core = _core_files(library)
    private = f"tensegrity_core_{_digest(core)[:16]}"
    main = f"{private}_fmu"
    files = {f"resources/{private}/{name}": content for name, content in core.items()}
    files["resources/slavemodule.txt"] = main.encode()
    files[f"resources/{main}.py"] = _MAIN.format(core=private).encode()
    files["resources/model.bin"] = to_bytes(model)
    files["resources/variables.json"] = variables_json(model, table, f"native/{library.name}", _digest(files))
    files[f"binaries/{binary_platform}/{model.name}{suffix}"] = _binary(binary_platform, suffix)
    runtime = Runtime("python", f"tensegrity {tensegrity_core.__version__} with pythonfmu {metadata.version('pythonfmu')}")
    complete(files, model, plain(table) if simple else table, runtime, naming)
    files["documentation/licenses/pythonfmu.txt"] = licence_of("pythonfmu")
    return files


def complete(files: dict[str, bytes], model: Model, table: tuple[Variable, ...], runtime: Runtime, naming: str) -> str:
    """Add what every FMU has: description, icon, documentation, licence.  Returns the GUID, a hash of `files` as they were
    and of the description."""
    tolerance = next(row.start for row in table if row.field == "tolerance")
    version = tensegrity_core.__version__

    def description(guid: str) -> bytes:
        experiment = Experiment(tolerance=tolerance)
        return model_description(model, table, runtime, model.name, guid, version, naming, experiment)

    guid = content_guid(description(""), files)
    files["modelDescription.xml"] = description(guid)
    files["model.png"] = model_png(model)
    files["documentation/index.html"] = index_html(model, table, version, runtime)
    files["documentation/licenses/license.txt"] = licence_of(DISTRIBUTION)
    return guid


def variables_json(model: Model, table: tuple[Variable, ...], library: str, content: str) -> bytes:
    """What the runtime must know of the variables.  content: hash of the rest, so that identity stands for the FMU."""
    table = by_reference(table)
    roles = {"input": "input", "output": "output"}
    data = {
        "library": library,
        "strings": list(model.string_names),
        "tolerance": next(row.reference for row in table if row.field == "tolerance"),
        "reals": sum(row.kind == "Real" for row in table),
        "names": [row.name for row in table],
        "roles": [roles.get(row.causality, row.variability) for row in table],
        "min": [row.min for row in table],
        "max": [row.max for row in table],
    }
    text = json.dumps(data, indent=1)
    data["identity"] = hashlib.sha256(f"{content}\0{text}".encode()).hexdigest()
    return json.dumps(data, indent=1).encode() + b"\n"


def write_zip(destination: Path, files: dict[str, bytes]) -> None:
    """Write an archive whose bytes depend on its content alone; it appears whole or not at all."""
    destination.parent.mkdir(parents=True, exist_ok=True)
    with replacing(destination) as file, zipfile.ZipFile(file, "w") as archive:
        for name in sorted(files, key=lambda name: (name != "modelDescription.xml", name)):
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.create_system = 3
            entry.external_attr = 0o100644 << 16
            entry.compress_type = zipfile.ZIP_DEFLATED
            archive.writestr(entry, files[name], compresslevel=6)


def fmi_platform() -> str:
    """FMI's name of the platform that runs this, such as linux64.  Raises PackError."""
    return _platform()[0]


def _platform() -> tuple[str, str]:
    here = sys.platform, platform.machine().lower()
    if here not in PLATFORMS:
        known = ", ".join("/".join(key) for key in PLATFORMS)
        raise PackError(f"pythonfmu has no binary for {'/'.join(here)}, only for {known}. Build on one of those")
    return PLATFORMS[here]


def _binary(binary_platform: str, suffix: str) -> bytes:
    folder = PYTHONFMU / "resources" / "binaries" / binary_platform
    found = sorted(folder.glob(f"*{suffix}"))
    if len(found) != 1:
        raise PackError(f"{folder} holds {len(found)} files *{suffix}, not one. Install pythonfmu anew")
    return found[0].read_bytes()


def _core_files(library: Path) -> dict[str, bytes]:
    """The private package: the kernel's Python half and what it imports, the C library, the runtime, pythonfmu."""
    sources, foreign = import_closure(CORE, "kernel", "errors")
    if foreign - {"numpy"}:
        raise PackError(f"the kernel's modules import {sorted(foreign - {'numpy'})}: an FMU may need numpy only")
    files = {path.name: path.read_bytes() for path in sources}
    files[f"native/{library.name}"] = library.read_bytes()
    for path in sorted((HERE / "python_runtime").glob("*.py")):
        files[f"python_runtime/{path.name}"] = path.read_bytes()
    files["pythonfmu/__init__.py"] = b""
    for name in PYTHONFMU_MODULES:
        files[f"pythonfmu/{name}.py"] = (PYTHONFMU / f"{name}.py").read_bytes()
    return files


def _digest(files: dict[str, bytes]) -> str:
    digest = hashlib.sha256()
    for name in sorted(files):
        digest.update(f"{name}\0{len(files[name])}\0".encode())
        digest.update(files[name])
    return digest.hexdigest()


def licence_of(package: str) -> bytes:
    """Licence text of this project or of an installed package.  Raises PackError."""
    text = _licence_of(package)
    if text is None:
        raise PackError(f"no licence text of {package} was found. Install {package} anew")
    return text


def _licence_of(package: str) -> bytes | None:
    if package == DISTRIBUTION and clone() is not None:
        return (clone() / "LICENSE").read_bytes()
    try:
        listed = metadata.files(package) or []
    except metadata.PackageNotFoundError:
        return None
    for path in listed:
        if path.name.upper().startswith(("LICENSE", "LICENCE")):
            return Path(path.locate()).read_bytes()
    return None
