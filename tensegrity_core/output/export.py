"""A result as a file: columns named as the FMU's outputs, or arrays named as the result's fields."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..fields import outputs
from ..files import replacing, replacing_text
from ..model import Model, Result
from ..model.components import flattened, named


def columns(model: Model, result: Result) -> dict[str, np.ndarray]:
    """Name -> (K+1,) series, in the order and with the names of the FMU's outputs; `time` (s) comes first."""
    found = {"time": result.times}
    for field in outputs():
        values = flattened(field, model, result.outputs[field.name])
        found.update((name, values[:, place]) for name, place in named(field, model).items())
    return found


def write_result(model: Model, result: Result, path: Path, told: Callable[[float], object] | None = None) -> None:
    """Write a result: .csv, one row per communication point (`columns`), or .npz, one array per field of `Result` and
    the components' names.  The file appears whole or not at all.  told: gets the part of the rows that is written, 0 to 1.
    Raises InputError, see `require_writable`.
    """
    path = require_writable(path, (".csv", ".npz"))
    if path.suffix.lower() == ".csv":
        write_columns(columns(model, result), path, told)
        return
    arrays: dict[str, Any] = _arrays(model, result)
    with replacing(path) as file:
        np.savez_compressed(file, **arrays)


def write_columns(series: dict[str, np.ndarray], path: Path, told: Callable[[float], object] | None = None) -> None:
    """Write series of equal length as a .csv file, whole or not at all.  Raises InputError where it cannot be written.

    Numbers are written as their shortest text that reads back to the same value.
    """
    with replacing_text(path) as file:
        file.write(",".join(series) + "\n")
        count = len(next(iter(series.values()), ()))
        for k, row in enumerate(zip(*(values.tolist() for values in series.values())), 1):
            file.write(",".join(map(repr, row)) + "\n")
            if told:
                told(k / count)


def _arrays(model: Model, result: Result) -> dict[str, np.ndarray]:
    arrays = {"times": result.times, **result.outputs}
    events = [(t.time, t.string, t.before, t.after, t.loss, t.contact) for t in result.transitions]
    kinds = [("time", "f8"), ("string", "i4"), ("before", "i4"), ("after", "i4"), ("loss", "f8"), ("contact", "i4")]
    arrays["transitions"] = np.array(events, kinds)
    for kind in ("node", "bar", "string"):
        arrays[f"{kind}_names"] = np.array(getattr(model, f"{kind}_names"), dtype=str)
    return arrays


def require_writable(path: str | Path, suffixes: tuple[str, ...], option: str = "output") -> Path:
    """The path, when a file of one of these kinds can be written there.  option: what names it.  Raises InputError."""
    if not isinstance(path, str | Path):
        raise InputError(f"{option} = {path!r} is no path; name a file that ends in {' or '.join(suffixes)}")
    path = Path(path)
    shown = f"{option} = {str(path)!r}"
    if path.suffix.lower() not in suffixes:
        raise InputError(f"{shown} does not end in {' or '.join(suffixes)}; name such a file")
    try:
        if path.is_dir():
            raise InputError(f"{shown} is a folder; name a file in it")
        if not path.parent.is_dir():
            raise InputError(f"{shown}: the folder {path.parent} does not exist; make it first")
    except (OSError, ValueError) as failure:  # a name that is too long, a folder that cannot be looked into, a null character
        raise InputError(
            f"{shown} cannot be written: {getattr(failure, 'strerror', None) or failure}; name another file"
        ) from None
    return path
