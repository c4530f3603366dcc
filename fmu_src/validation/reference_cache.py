"""Reference runs kept on disk, found by a hash of everything that determines them.

The key covers the source files that the reference imports, the model, the inputs, the method and tolerances, and the
versions of Python, NumPy and SciPy.  Key and checksum stand inside the file and are checked when it is read: a file of
another name or with other bytes is not used.
"""

from __future__ import annotations

import hashlib
import io
import os
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import scipy

import tensegrity_core
from tensegrity_core.errors import TensegrityError
from tensegrity_core.files import write_bytes
from tensegrity_core.model import Inputs, Model, Result, Transition

from ..packing.closure import import_closure

_MAGIC = b"TSREF001"


def reference_key(model: Model, inputs: Inputs, settings: dict, core: Path | None = None) -> str:
    """Hash of all that determines a reference run.  settings: keyword arguments of reference.simulate; core: folder of
    the sources, by default those in use.
    """
    digest = hashlib.sha256(_MAGIC)

    def add(name: str, content: bytes) -> None:
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)

    core = core or Path(tensegrity_core.__file__).parent
    sources, _ = import_closure(core, "reference")
    for path in sources:
        add(path.relative_to(core).as_posix(), path.read_bytes())
    for where in (model, inputs):
        for item in fields(where):
            value = getattr(where, item.name)
            if isinstance(value, np.ndarray):
                add(item.name, f"{value.dtype.str} {value.shape} ".encode() + np.ascontiguousarray(value).tobytes())
            else:
                add(item.name, repr(value).encode())
    add("settings", repr(sorted(settings.items())).encode())
    add("versions", f"{sys.version} {np.__version__} {scipy.__version__}".encode())
    return digest.hexdigest()


def trouble(folder: Path | None) -> str | None:
    """Why runs cannot be kept in a folder, in words; None: they can, or no folder is given.  Makes the folder."""
    if folder is None:
        return None
    look = folder / f"look-{os.getpid()}"
    try:
        write(look, b"")
        look.unlink()
    except (OSError, TensegrityError) as error:
        return _words(folder, error)
    return None


def _words(folder: Path, error: Exception) -> str:
    reason = getattr(error.__cause__ or error, "strerror", None) or error
    return f"reference runs cannot be kept in {folder} ({reason}): they take their time again; see --cache, --no-cache"


def cached(
    folder: Path | None, key: str, compute: Callable[[], Result], say: Callable[[str], None] = lambda text: None
) -> tuple[Result, bool]:
    """The result under this key and whether it came from the folder; None: no cache, always compute.

    A folder that cannot be read or written is no reason to fail: `say` gets one sentence about it.
    """
    path = folder / f"{key}.bin" if folder else None
    if path:
        try:
            found = _unpack(path.read_bytes(), key)
        except OSError:
            found = None
        if found is not None:
            return found, True
    result = compute()
    if path:
        try:
            write(path, _pack(result, key))
        except (OSError, TensegrityError) as error:
            say(_words(path.parent, error))
    return result, False


def _pack(result: Result, key: str) -> bytes:
    events = np.array([(t.time, t.string, t.before, t.after, t.contact) for t in result.transitions]).reshape(-1, 5)
    stats = result.stats
    arrays: dict[str, Any] = {"times": result.times, "transitions": events, **result.outputs}
    buffer = io.BytesIO()
    np.savez(buffer, stat_names=np.array(list(stats), dtype=str), stat_values=np.array(list(stats.values())), **arrays)
    body = key.encode() + buffer.getvalue()
    return _MAGIC + hashlib.sha256(body).digest() + body


def _unpack(data: bytes, key: str) -> Result | None:
    start = len(_MAGIC) + 32
    checksum, body = data[len(_MAGIC) : start], data[start:]
    if data[: len(_MAGIC)] != _MAGIC or hashlib.sha256(body).digest() != checksum or body[:64] != key.encode():
        return None
    with np.load(io.BytesIO(body[64:]), allow_pickle=False) as stored:
        arrays = {name: stored[name] for name in stored.files}
    names, values = arrays.pop("stat_names"), arrays.pop("stat_values")
    transitions = [
        Transition(t, int(s), int(a), int(b), contact=int(c)) for t, s, a, b, c in arrays.pop("transitions").tolist()
    ]
    return Result(transitions=transitions, stats=dict(zip(names.tolist(), values.tolist())), **arrays)


def write(path: Path, data: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path, data)
