"""The variable table as the runtime needs it: by value reference, and for whole calls at once."""

from __future__ import annotations

import math
import platform
import sys
from typing import NamedTuple

import numpy as np

from .state import INITIALIZATION, INSTANTIATED, SETTING

_LARGEST = float(np.finfo(float).max)
#: A host that asks for ever new lists of references must not fill the memory.
_MAX_GROUPS = 256

#: Modes in which a variable of a causality and variability can be set, as bits.
_SETTABLE = {"input": SETTING, "tunable": SETTING, "fixed": INSTANTIATED | INITIALIZATION, "output": 0}


class Group(NamedTuple):
    """The references of one call.  index: into the block; bounded: places in the call, and bounds, of those that have any;
    settable: modes in which all are."""

    index: np.ndarray | slice  # type: ignore[assignment]  # not the method of tuples
    bounded: list[tuple[int, float, float]]
    settable: int

    def surely_accepts(self, values) -> bool:
        """Whether all values are finite and in range; of very large ones it is not sure."""
        if not math.isfinite(sum(values)):
            return False
        return all(low <= values[place] <= high for place, low, high in self.bounded)


class Block:
    """One block of values: the references first .. first + size - 1."""

    def __init__(self, kind, first, low, high, settable, names):
        self.kind, self.first, self.size, self._names = kind, first, len(low), names
        self._low, self._high, self._settable = low, high, settable
        self._groups = {}

    def __contains__(self, reference):
        return self.first <= reference < self.first + self.size and self._names[reference - self.first] != ""

    def group(self, references: memoryview) -> Group | None:
        """The references of a call, looked up once for each list of references; None where one does not exist."""
        key = references.tobytes()
        group = self._groups.get(key)
        if group is None and key and all(reference in self for reference in references):
            if len(self._groups) >= _MAX_GROUPS:
                self._groups.clear()
            group = self._groups[key] = self._make(np.array(references, dtype=np.int64) - self.first)
        return group

    def _make(self, index):
        contiguous = bool(np.all(np.diff(index) == 1))
        bounds = zip(range(len(index)), self._low[index].tolist(), self._high[index].tolist())
        return Group(
            index=slice(int(index[0]), int(index[-1]) + 1) if contiguous else index,
            bounded=[row for row in bounds if row[1] > -_LARGEST or row[2] < _LARGEST],
            settable=int(np.bitwise_and.reduce(self._settable[index])),
        )


class Table:
    """data: see pack.variables_json.  names, settable: by value reference; reals, integers: the two blocks."""

    def __init__(self, data):
        self.guid, self.identity = data["guid"], bytes.fromhex(data["identity"])
        self._libraries = data["libraries"]
        self.strings, self.contacts = data["strings"], data["contacts"]
        self.tolerance = data["tolerance"]
        self.names = data["names"]
        self.settable = [_SETTABLE[role] for role in data["roles"]]
        self.low = [-_LARGEST if low is None else low for low in data["min"]]
        self.high = [_LARGEST if high is None else high for high in data["max"]]
        reals = data["reals"]
        low, high, settable = np.array(self.low), np.array(self.high), np.array(self.settable)
        self.reals = Block("Real", 0, low[:reals], high[:reals], settable[:reals], self.names[:reals])
        self.integers = Block("Integer", reals, low[reals:], high[reals:], settable[reals:], self.names[reals:])

    @property
    def library(self) -> str:
        """The kernel's library for the platform that runs this, below the private package."""
        machine = f"{sys.platform}/{platform.machine().lower()}"
        if machine not in self._libraries:
            known = ", ".join(self._libraries)
            raise RuntimeError(f"this FMU has no kernel for {machine}, only for {known}; build it with --platforms")
        return self._libraries[machine]

    def accepts(self, reference, value):
        return self.low[reference] <= value <= self.high[reference]

    def bounds(self, reference):
        """What a value must be, in words."""
        low, high = self.low[reference], self.high[reference]
        limits = [f", at least {number(low)}"] * (low > -_LARGEST) + [f", at most {number(high)}"] * (high < _LARGEST)
        return "it must be finite" + "".join(limits)


def number(x: float) -> str:
    """A number that reads back as itself, as short as can be."""
    return next((text for text in (f"{x:.{digits}g}" for digits in (15, 16)) if float(text) == x), f"{x:.17g}")
