"""Numbers as callers give them: Python's and NumPy's, alone or in sequences, as plain floats.

What is no number is an InputError that says so.  It imports NumPy and the errors only.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .errors import InputError


def number(name: str, value: Any) -> float:
    """A float of anything that is one real number: Python's, NumPy's, or an array with one entry."""
    if type(value) is float:
        return value
    array = _array(name, value, "a number")
    if array.size != 1:
        raise InputError(f"{name} = {value!r} has {array.size} values; give one number")
    return float(array.reshape(())[()])


def floats(name: str, values: Any) -> tuple[float, ...]:
    """Floats of any sequence or array of numbers."""
    array = _array(name, values, "a list of numbers")
    if array.ndim != 1:
        raise InputError(f"{name} = {values!r} is no list of numbers; give a sequence or an array of one dimension")
    return tuple(array.tolist())


def array_of(name: str, values: Any, shape: tuple[int, ...]) -> np.ndarray:
    """A new array of floats of a shape."""
    array = _array(name, values, f"an array of shape {shape}")
    if array.shape != shape:
        raise InputError(f"{name} has the shape {array.shape}; give one of shape {shape}")
    return array


def pairs_of(name: str, values: Any) -> np.ndarray:
    """A new array (n, 2) of indices."""
    pairs = _array(name, values, "a list of pairs of nodes").reshape(-1, 2)
    return pairs.astype(np.int64)


def _array(name: str, values: Any, wanted: str) -> np.ndarray:
    try:
        found = np.asarray(values)
        if found.dtype.kind not in "iufO" or (found.dtype.kind == "O" and any(value is None for value in found.flat)):
            raise ValueError  # a text would be read as a number, a truth value and None are none
        return np.array(found, dtype=float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} = {values!r} is not {wanted}; give real numbers") from None
