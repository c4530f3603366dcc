"""Packs an FMU: byte-reproducible (the same content gives the same bytes) and atomic (a whole file or none).

The core goes in under a private name with a hash of its content: a process may hold FMUs of several versions of this
project, or the project itself, and each runs its own copy.  pythonfmu's Python half goes in beside it, for the same
reason.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from importlib import metadata
from pathlib import Path

import pythonfmu

import tensegrity_core
from tensegrity_core.files import replacing
from tensegrity_core.kernel import LIBRARY, Kernel, fnv1a, to_bytes
from tensegrity_core.model import Model
from tensegrity_core.native import build

from ..places import DISTRIBUTION, clone
from ..variables import fmi3_description, model_description
from ..variables.described import Experiment, Runtime, content_guid, plain
from ..variables.documentation import LIVE, index_html
from ..variables.drawing import ICON, model_png
from ..variables.interface import Variable, by_reference, variables
from .closure import import_closure
from .libraries import PackError, cross_compiled, here, host_library, on_arm

HERE = Path(__file__).parent.parent
#: What the FMU's library runs, above the private package.
MAIN = HERE / "python_runtime" / "main.py"
CORE = Path(tensegrity_core.__file__).parent
PYTHONFMU = Path(pythonfmu.__file__).parent

#: Modules of pythonfmu that a slave needs.
PYTHONFMU_MODULES = ("_version", "default_experiment", "enums", "fmi2slave", "logmsg", "variables")

#: What is proposed to the solver of a host that integrates. fmpy's CVODE was within 1e-6 m of co-simulation then, on the six
#: scenes under loads that jump; at 1e-10 it is slow at rest, and gives up where outputs lie 50 ms apart.
EXCHANGE_TOLERANCE = 1e-8

_EPOCH = (1980, 1, 1, 0, 0, 0)


def pack_python_fmu(
    model: Model,
    destination: Path,
    naming: str = "structured",
    library: Path | None = None,
    simple: bool = False,
    platforms: tuple[str, ...] = (),
    page: bytes | None = None,
) -> Path:
    """Write the Python FMU of a model; returns its path.

    destination: the .fmu file; naming: of the variables, 'structured' or 'flat'; library: the kernel's C library for this
    platform, by default the one that this Python uses; simple: see described.plain; platforms: keys of
    build.TARGETS, compiled by ziglang, beside the one that runs this; page: see complete.  Raises PackError.
    """
    native, kernels = {here(): host_library("python")}, {here(): library or CORE / "native" / LIBRARY}
    native |= {name: cross_compiled(name, kind="python") for name in platforms}
    kernels |= {name: cross_compiled(name, kind="kernel") for name in platforms}
    write_zip(destination, python_fmu_files(model, naming, on_arm(native), kernels, simple, page))
    return destination


def python_fmu_files(
    model: Model,
    naming: str,
    native: dict[str, Path],
    kernels: dict[str, Path],
    simple: bool = False,
    page: bytes | None = None,
) -> dict[str, bytes]:
    """Everything in the FMU: path inside the archive -> content.  native, kernels: platform -> library."""
    table = variables(model, naming)
    core = core_files(kernels)
    private = f"tensegrity_core_{_digest(core)[:16]}"
    main = f"{private}_fmu"
    files = {f"resources/{private}/{name}": content for name, content in core.items()}
    files[f"resources/{main}.py"] = MAIN.read_bytes().replace(b"@PRIVATE@", private.encode())
    files["resources/slavemodule.txt"] = f"{main}\n{fnv1a(files[f'resources/{main}.py']):016x}\n".encode()
    files["resources/model.bin"] = to_bytes(model)
    content = _digest(files)
    files["resources/variables.json"] = variables_json(model, table, kernels, content, "")
    files |= {f"binaries/{name}/{model.name}{path.suffix}": path.read_bytes() for name, path in native.items()}
    runtime = Runtime("python", f"tensegrity {tensegrity_core.__version__} with pythonfmu {metadata.version('pythonfmu')}")
    guid = complete(files, model, plain(table) if simple else table, runtime, naming, page)
    files["resources/variables.json"] = variables_json(model, table, kernels, content, guid)
    files["resources/checksums.txt"] = checksums(files)
    files["documentation/licenses/pythonfmu.txt"] = licence_of("pythonfmu")
    return files


def checksums(files: dict[str, bytes]) -> bytes:
    """What the runtime compares the resources with, as sha256sum writes it, below a line that counts the files."""
    names = sorted(name for name in files if name.startswith("resources/"))
    lines = [f"{hashlib.sha256(files[name]).hexdigest()}  {name.removeprefix('resources/')}" for name in names]
    return "".join(f"{line}\n" for line in [f"# {len(lines)} files", *lines]).encode()


def complete(
    files: dict[str, bytes],
    model: Model,
    table: tuple[Variable, ...],
    runtime: Runtime,
    naming: str,
    page: bytes | None = None,
) -> str:
    """Add what every FMU has: description, icon, documentation, licence.  page: the model's live page, which goes into the
    documentation; None: it has none.  Returns the GUID, a hash of `files` as they were and of the description."""
    tolerance = EXCHANGE_TOLERANCE if runtime.kind == "me" else float(Kernel(model)["tolerance"][0])
    version, fmi3 = tensegrity_core.__version__, runtime.standard == "3.0"

    def description(guid: str) -> bytes:
        experiment = Experiment(tolerance=tolerance)
        module = fmi3_description if fmi3 else model_description
        return module.model_description(model, table, runtime, model.name, guid, version, naming, experiment)

    guid = content_guid(description(""), files)
    files["modelDescription.xml"] = description(guid)
    files[ICON if fmi3 else "model.png"] = model_png(model)
    files["documentation/index.html"] = index_html(model, table, version, runtime, page is not None)
    if page is not None:
        files[f"documentation/{LIVE}"] = page
    files["documentation/licenses/license.txt"] = licence_of(DISTRIBUTION)
    return guid


def variables_json(model: Model, table: tuple[Variable, ...], kernels: dict[str, Path], content: str, guid: str) -> bytes:
    """What the runtime must know of the variables, and of the kernel's libraries (by sys.platform and machine).

    content: hash of the rest, so that identity stands for the FMU.
    """
    table = by_reference(table)
    roles = {"input": "input", "output": "output"}
    data = {
        "libraries": {
            "/".join(machine): f"native/{name}/{kernels[name].name}" for machine, name in build.HOSTS.items() if name in kernels
        },
        "strings": list(model.string_names),
        "contacts": [model.node_names[contact.node] for contact in model.contacts],
        "tolerance": next(row.reference for row in table if row.field == "tolerance"),
        "reals": sum(row.kind == "Real" for row in table),
        "names": [row.name for row in table],
        "roles": [roles.get(row.causality, row.variability) for row in table],
        "min": [row.min for row in table],
        "max": [row.max for row in table],
    }
    text = json.dumps(data, indent=1)
    data["identity"] = hashlib.sha256(f"{content}\0{text}".encode()).hexdigest()
    data["guid"] = guid
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


def core_files(kernels: dict[str, Path]) -> dict[str, bytes]:
    """The private package: the kernel's Python half and what it imports, its C libraries, the runtime, pythonfmu."""
    sources, foreign = import_closure(CORE, "kernel", "errors")
    if foreign - {"numpy"}:
        raise PackError(f"the kernel's modules import {sorted(foreign - {'numpy'})}: an FMU may need numpy only")
    files = {path.relative_to(CORE).as_posix(): path.read_bytes() for path in sources}
    files |= {f"native/{name}/{library.name}": library.read_bytes() for name, library in kernels.items()}
    for path in sorted({*MAIN.parent.glob("*.py")} - {MAIN}):
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
    if package == DISTRIBUTION and (root := clone()) is not None:
        return (root / "LICENSE").read_bytes()
    try:
        listed = metadata.files(package) or []
    except metadata.PackageNotFoundError:
        return None
    for path in listed:
        if path.name.upper().startswith(("LICENSE", "LICENCE")):
            return Path(path.locate()).read_bytes()
    return None
