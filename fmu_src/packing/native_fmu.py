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
from tensegrity_core.fields import METHODS, layout
from tensegrity_core.kernel import Kernel, fnv1a, to_bytes
from tensegrity_core.kernel.continuous import ContinuousView
from tensegrity_core.model import Model
from tensegrity_core.native import build

from ..variables import terminals
from ..variables.arrays import element_names, spans, time_variable
from ..variables.build_description import build_description
from ..variables.described import Runtime, plain
from ..variables.interface import Variable, by_reference, variables
from ..variables.states import event_indicators, exchange_variables, without_solver
from .libraries import PackError, cross_compiled, here, host_library, on_arm, tuples
from .pack import complete, write_zip

#: Stands above the headers in sources/, but for those that include FMI's, which must come first.
PREFIXED = b'#include "prefix.h"\n\n'

#: An include of one of the kernel's files, by its path below the folder of the kernel's sources.
_INCLUDED = re.compile(rb'^#include "[^"]*/', re.MULTILINE)

#: A function that a header declares.
_DECLARED = re.compile(r"^[A-Za-z][\w ]*[ *](\w+)\([^;{]*\);", re.MULTILINE)

#: A function of FMI's that the runtime defines.
_EXPORTED = re.compile(r"^FMI(\d)_Export .*?\b(fmi\1\w+)\(", re.MULTILINE)

#: A file of the runtime that only one version of the standard needs.
_OF_VERSION = re.compile(r"(?:fmi|version)(\d)\w*\.[ch]")

_PREFIX = """/* Names of all functions that other files of these sources call: where several FMUs are linked into one program,
 * each has a prefix of its own, {prefix}, before these as before FMI's functions. */
#if defined({prefix}) && !defined(TENSEGRITY_PREFIX_H)
#define TENSEGRITY_PREFIX_H
#define TS_PASTE_NAMES(a, b) a##b
#define TS_PASTE(a, b) TS_PASTE_NAMES(a, b)
{own}
/* FMI's, too: some of its headers of FMI 2.0 leave the prefix to others, and declare names without it. */
{fmi}
#if defined(fmi{version}Functions_h) && defined(__cplusplus)
extern "C" {{
{declared}
}}
#endif
#endif
"""

#: In which modes a variable may be set, as the bits of native_runtime/instance.h: instantiated 1, initialization 2, steps 4.
SETTABLE = {"input": 7, "tunable": 7, "fixed": 3, "output": 0, "local": 0}


@dataclass(frozen=True)
class Contents:
    """What may differ between native FMUs of a model.  naming: 'structured' or 'flat'; platforms: keys of build.TARGETS,
    compiled by ziglang, beside the one that runs this (if that is named, it is compiled anew, for old systems too); sources:
    pack them; binaries: False: nothing but sources; simple: without types that some tools do not know, see described.plain;
    kind: one of KINDS there; standard: of FMI, one of STANDARDS there; page: see pack.complete."""

    naming: str = "structured"
    platforms: tuple[str, ...] = ()
    sources: bool = False
    simple: bool = False
    kind: str = "cs"
    standard: str = "2.0"
    binaries: bool = True
    page: bytes | None = None


def pack_native_fmu(model: Model, destination: Path, naming: str = "structured", **contents) -> Path:
    """Write the native FMU of a model; returns its path.

    destination: the .fmu file; naming and contents: see Contents.  Raises PackError.
    """
    chosen = Contents(naming, **contents)
    write_zip(destination, native_fmu_files(model, chosen, libraries_of(chosen)))
    return destination


def libraries_of(contents: Contents) -> dict[str, Path]:
    """The libraries that go in, by platform.  Raises PackError."""
    if not contents.binaries:
        return {}
    return {here(): host_library()} | {name: cross_compiled(name) for name in contents.platforms}


def native_fmu_files(model: Model, contents: Contents, libraries: dict[str, Path]) -> dict[str, bytes]:
    """Everything in the FMU: path inside the archive -> content.  libraries: platform, a key of build.TARGETS -> file.  Raises
    PackError."""
    table = variables(model, contents.naming) if contents.kind == "cs" else exchange_variables(model, contents.naming)
    if contents.kind == "me":
        table = without_solver(table)
    packed = to_bytes(model)
    arrays = contents.standard == "3.0"
    files = {"resources/model.bin": packed, "resources/variables.bin": variables_bin(model, table, "", packed, arrays)}
    if (joined := terminals.terminals(model, table, arrays)) is not None:
        files[terminals.PATH] = joined
    for name, library in (tuples(libraries) if arrays else on_arm(libraries)).items():
        files[f"binaries/{name}/{model.name}{library.suffix}"] = library.read_bytes()
    sources = source_files(model.name, 3 if arrays else 2) if contents.sources else {}
    files |= {f"sources/{name}": content for name, content in sources.items()}
    runtime = Runtime(
        "native",
        f"tensegrity {tensegrity_core.__version__}",
        sources=compiled_of(sources),
        kind=contents.kind,
        indicators=0 if model.contacts else ContinuousView(Kernel(model)).indicators,
        standard=contents.standard,
    )
    described = plain(table) if contents.simple else table
    if arrays:
        described += added_variables(model, table, contents)
    guid = complete(files, model, described, runtime, contents.naming, contents.page)
    files["resources/variables.bin"] = variables_bin(model, table, guid, packed, arrays)
    return files


def added_variables(model: Model, table: tuple[Variable, ...], contents: Contents) -> tuple[Variable, ...]:
    """What FMI 3.0 has variables for beside the table's: the time, then the event indicators of model exchange."""
    count = len(by_reference(table))
    more = () if contents.kind == "cs" else event_indicators(model, table, count + 1, contents.naming)
    return time_variable(count), *more


def source_files(identifier: str, version: int = 2) -> dict[str, bytes]:
    """What goes into sources/: kernel and FMI functions, and how to compile them.  The FMI headers are the importer's.
    version: of the standard, 2 or 3.

    All in one folder, so that a compiler needs no options: the kernel's folders fall away here and in its includes.
    """
    paths = [path for path in build.reads("native") if path.suffix in build.SOURCES]
    paths = [path for path in paths if not (of := _OF_VERSION.fullmatch(path.name)) or of[1] == str(version)]
    files = {path.name: _INCLUDED.sub(b'#include "', path.read_bytes()) for path in paths}
    if len(files) < len(paths):
        raise PackError("two source files have the same name; in sources/ one would hide the other")
    files["prefix.h"] = prefix_header(files, version)
    for name in ("resources.h", *(path.name for path in build.reads("kernel") if path.suffix == ".h")):
        files[name] = PREFIXED + files[name]
    files["buildDescription.xml"] = build_description(identifier, compiled_of(files), version)
    return files


def prefix_header(files: dict[str, bytes], version: int) -> bytes:
    """Definitions that put the standard's prefix, FMI2_FUNCTION_PREFIX or that of 3, before the names of what the headers
    declare."""
    prefix = f"FMI{version}_FUNCTION_PREFIX"
    headers = "\n".join(content.decode() for name, content in sorted(files.items()) if name.endswith(".h"))
    names = {name for name in _DECLARED.findall(headers) if name.startswith(("ts_", "fmu_", "variables_"))}
    names |= {f"ts_{method}" for method in METHODS if method != "auto"} | {"fmu_categories", "fmu_version3"}
    own = [f"#define {name} TS_PASTE({prefix}, {name})" for name in sorted(names)]
    runtime = "\n".join(content.decode() for name, content in sorted(files.items()) if name.startswith("fmi"))
    exported = sorted(name for _, name in _EXPORTED.findall(runtime))
    fmi = [f"#undef {name}\n#define {name} TS_PASTE({prefix}, {name})" for name in exported]
    declared = "\n".join(f"{name}TYPE {name};" for name in exported)
    text = _PREFIX.format(prefix=prefix, version=version, own="\n".join(own), fmi="\n".join(fmi), declared=declared)
    return text.encode()


def compiled_of(names: Iterable[str]) -> tuple[str, ...]:
    """The files that a compiler is called with."""
    return tuple(sorted(name for name in names if name.endswith(".c")))


def variables_bin(model: Model, table: tuple[Variable, ...], guid: str, packed: bytes, arrays: bool = False) -> bytes:
    """What the runtime must know of the variables, in the layout of native_runtime/variables.c (little-endian).

    packed: model.bin, whose checksum goes along, so that no other one is taken for it; arrays: those of FMI 3.0.  The span of a
    reference says how many values the variable has that starts there; 0: none starts there.
    """
    names = element_names(table) if arrays else {row.reference: row.name for row in table}
    starting = spans(table) if arrays else dict.fromkeys(names, 1)
    largest, table = np.finfo(float).max, by_reference(table)
    places = layout(model.counts)
    reals, tolerance = max(place.stop for place in places.values()), places["tolerance"].start
    low = [-largest if row.min is None else row.min for row in table]
    high = [largest if row.max is None else row.max for row in table]
    settable = [SETTABLE[row.causality if row.causality != "parameter" else row.variability] for row in table]
    touching = [model.node_names[contact.node] for contact in model.contacts]
    texts = [guid, *(names.get(row.reference, "") for row in table), *model.string_names, *touching]
    body = (
        b"TSVARS4\0"
        + struct.pack("<6iQ", reals, len(table), len(model.string_names), len(touching), tolerance, 0, fnv1a(packed))
        + np.array([*low, *high], "<f8").tobytes()
        + np.array([*settable, *(starting.get(row.reference, 0) for row in table)], "<i4").tobytes()
        + b"".join(text.encode() + b"\0" for text in texts)
    )
    return body + struct.pack("<Q", fnv1a(body))
