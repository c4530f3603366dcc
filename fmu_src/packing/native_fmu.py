"""Packs the native FMU: a library that needs nothing of the target, and the scene's data in resources/.

The library is the same for every scene: kernel and FMI functions, compiled when this package was installed.  Building an FMU
only copies it under the scene's name.  Libraries for other platforms are compiled by ``ziglang`` where it is installed, and
the sources can go along, for targets that have a compiler of their own.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import tensegrity_core
from tensegrity_core.fields import METHODS
from tensegrity_core.kernel import Kernel, fnv1a, to_bytes
from tensegrity_core.kernel.continuous import ContinuousView
from tensegrity_core.model import Model
from tensegrity_core.native import build

from ..variables import terminals
from ..variables.interface import Variable, by_reference, variables
from ..variables.model_description import Runtime, build_description, plain
from ..variables.states import exchange_variables
from .libraries import PackError, cross_compiled, here, host_library, on_arm
from .pack import complete, write_zip

#: Stands above the kernel's public header in sources/, because importers pass no definitions for FMI 2.0.
INTERNAL = b"""#ifndef TS_INTERNAL
#define TS_INTERNAL /* part of an FMU: nothing of the kernel is exported */
#endif

"""

#: Stands above the headers in sources/, but for those that include FMI's, which must come first.
PREFIXED = b'#include "prefix.h"\n\n'

#: An include of one of the kernel's files, by its path below the folder of the kernel's sources.
_INCLUDED = re.compile(rb'^#include "[^"]*/', re.MULTILINE)

#: A function that a header declares.
_DECLARED = re.compile(r"^[A-Za-z][\w ]*[ *](\w+)\([^;{]*\);", re.MULTILINE)

#: A function of FMI's that the runtime defines.
_EXPORTED = re.compile(r"^FMI2_Export .*?\b(fmi2\w+)\(", re.MULTILINE)

_PREFIX = """/* Names of all functions that other files of these sources call: where several FMUs are linked into one program,
 * each has a prefix of its own, FMI2_FUNCTION_PREFIX, before these as before FMI's functions. */
#if defined(FMI2_FUNCTION_PREFIX) && !defined(TENSEGRITY_PREFIX_H)
#define TENSEGRITY_PREFIX_H
#define TS_PASTE_NAMES(a, b) a##b
#define TS_PASTE(a, b) TS_PASTE_NAMES(a, b)
{own}
/* FMI's, too: some of its headers leave the prefix to others. */
{fmi}
#endif
"""

#: In which modes a variable may be set, as the bits of native_runtime/instance.h: instantiated 1, initialization 2, steps 4.
SETTABLE = {"input": 7, "tunable": 7, "fixed": 3, "output": 0, "local": 0}


@dataclass(frozen=True)
class Contents:
    """What may differ between native FMUs of a model.  naming: 'structured' or 'flat'; platforms: keys of build.TARGETS,
    compiled by ziglang, beside the one that runs this (if that is named, it is compiled anew, for old systems too); sources:
    pack them; simple: without types that some tools do not know, see model_description.plain; kind: one of KINDS there;
    page: see pack.complete."""

    naming: str = "structured"
    platforms: tuple[str, ...] = ()
    sources: bool = False
    simple: bool = False
    kind: str = "cs"
    page: bytes | None = None


def pack_native_fmu(model: Model, destination: Path, naming: str = "structured", **contents) -> Path:
    """Write the native FMU of a model; returns its path.

    destination: the .fmu file; naming and contents: see Contents.  Raises PackError.
    """
    chosen = Contents(naming, **contents)
    libraries = {here(): host_library()}
    libraries |= {name: cross_compiled(name) for name in chosen.platforms}
    write_zip(destination, native_fmu_files(model, chosen, on_arm(libraries)))
    return destination


def native_fmu_files(model: Model, contents: Contents, libraries: dict[str, Path]) -> dict[str, bytes]:
    """Everything in the FMU: path inside the archive -> content.  libraries: platform -> file.  Raises PackError."""
    table = (variables if contents.kind == "cs" else exchange_variables)(model, contents.naming)
    packed = to_bytes(model)
    files = {"resources/model.bin": packed, "resources/variables.bin": variables_bin(model, table, "", packed)}
    if (joined := terminals.terminals(model, table)) is not None:
        files[terminals.PATH] = joined
    for name, library in libraries.items():
        files[f"binaries/{name}/{model.name}{library.suffix}"] = library.read_bytes()
    sources = source_files(model.name) if contents.sources else {}
    files |= {f"sources/{name}": content for name, content in sources.items()}
    runtime = Runtime(
        "native",
        f"tensegrity {tensegrity_core.__version__}",
        sources=compiled_of(sources),
        kind=contents.kind,
        indicators=ContinuousView(Kernel(model)).indicators,
    )
    guid = complete(files, model, plain(table) if contents.simple else table, runtime, contents.naming, contents.page)
    files["resources/variables.bin"] = variables_bin(model, table, guid, packed)
    return files


def source_files(identifier: str) -> dict[str, bytes]:
    """What goes into sources/: kernel and FMI functions, and how to compile them.  The FMI headers are the importer's.

    All in one folder, so that a compiler needs no options: the kernel's folders fall away here and in its includes.
    """
    paths = [path for path in build.reads("native") if path.suffix in build.SOURCES]
    files = {path.name: _INCLUDED.sub(b'#include "', path.read_bytes()) for path in paths}
    if len(files) < len(paths):
        raise PackError("two source files have the same name; in sources/ one would hide the other")
    files["prefix.h"] = prefix_header(files)
    files["tensegrity.h"] = INTERNAL + files["tensegrity.h"]
    for name in ("resources.h", *(path.name for path in build.reads("kernel") if path.suffix == ".h")):
        files[name] = PREFIXED + files[name]
    files["buildDescription.xml"] = build_description(identifier, compiled_of(files))
    return files


def prefix_header(files: dict[str, bytes]) -> bytes:
    """Definitions that put FMI2_FUNCTION_PREFIX before the names of what the headers declare."""
    headers = "\n".join(content.decode() for name, content in sorted(files.items()) if name.endswith(".h"))
    names = {name for name in _DECLARED.findall(headers) if name.startswith(("ts_", "fmu_", "variables_"))}
    names |= {f"ts_{method}" for method in METHODS if method != "auto"} | {"fmu_categories"}
    own = [f"#define {name} TS_PASTE(FMI2_FUNCTION_PREFIX, {name})" for name in sorted(names)]
    runtime = "\n".join(content.decode() for name, content in sorted(files.items()) if name.startswith("fmi2"))
    exported = sorted(_EXPORTED.findall(runtime))
    fmi = [f"#undef {name}\n#define {name} TS_PASTE(FMI2_FUNCTION_PREFIX, {name})" for name in exported]
    return _PREFIX.format(own="\n".join(own), fmi="\n".join(fmi)).encode()


def compiled_of(names: Iterable[str]) -> tuple[str, ...]:
    """The files that a compiler is called with."""
    return tuple(sorted(name for name in names if name.endswith(".c")))


def variables_bin(model: Model, table: tuple[Variable, ...], guid: str, packed: bytes) -> bytes:
    """What the runtime must know of the variables, in the layout of native_runtime/variables.c (little-endian).

    packed: model.bin, whose checksum goes along, so that no other one is taken for it.  The span of a reference says how many
    values the variable has that starts there; 0: none starts there.
    """
    largest, table = np.finfo(float).max, by_reference(table)
    reals = sum(row.kind == "Real" and row.causality != "local" for row in table)
    tolerance = next(row.reference for row in table if row.field == "tolerance")
    low = [-largest if row.min is None else row.min for row in table]
    high = [largest if row.max is None else row.max for row in table]
    settable = [SETTABLE[row.causality if row.causality != "parameter" else row.variability] for row in table]
    spans = [1 if row.name else 0 for row in table]
    texts = [guid, *(row.name for row in table), *model.string_names]
    body = (
        b"TSVARS3\0"
        + struct.pack("<4iQ", reals, len(table), len(model.string_names), tolerance, fnv1a(packed))
        + np.array([*low, *high], "<f8").tobytes()
        + np.array([*settable, *spans], "<i4").tobytes()
        + b"".join(text.encode() + b"\0" for text in texts)
    )
    return body + struct.pack("<Q", fnv1a(body))
