"""The variable table as the runtime needs it: by value reference, and for whole calls at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .state import INITIALIZATION, STEPPING

_LARGEST = float(np.finfo(float).max)
#: A host that asks for ever new lists of references must not fill the memory.
_MAX_GROUPS = 256

#: The last mode in which a variable of a causality and variability can be set; -1: never.
_SETTABLE = {"input": STEPPING, "tunable": STEPPING, "fixed": INITIALIZATION, "output": -1}


class Group(NamedTuple):
    """The references of one call.  index: into the block; low, high: bounds; settable: last mode in which all are."""

    index: np.ndarray | slice
    low: list
    high: list
    settable: int


class Block:
    """One block of values: the references first .. first + size - 1."""

    def __init__(self, kind, first, low, high, settable, names):
        self.kind, self.first, self.size, self._names = kind, first, len(low), names
        self._low, self._high, self._settable = low, high, settable
        self._groups = {}

    def __contains__(self, reference):
        return self.first <= reference < self.first + self.size and self._names[reference - self.first] != ""

    def group(self, references) -> Group | None:
        """The references of a call, looked up once for each list of references; None where one does not exist."""
        key = tuple(references)
        group = self._groups.get(key)
        if group is None and key and all(reference in self for reference in key):
            if len(self._groups) >= _MAX_GROUPS:
                self._groups.clear()
            group = self._groups[key] = self._make(np.array(key) - self.first)
        return group

    def _make(self, index):
        contiguous = bool(np.all(np.diff(index) == 1))
        return Group(
            index=slice(int(index[0]), int(index[-1]) + 1) if contiguous else index,
            low=self._low[index].tolist(),
            high=self._high[index].tolist(),
            settable=int(self._settable[index].min()),
        )


class Table:
    """data: see pack.variables_json.  names, settable: by value reference; reals, integers: the two blocks."""

    def __init__(self, data):
        self.identity = bytes.fromhex(data["identity"])
        self.library = data["library"]
        self.strings = data["strings"]
        self.tolerance = data["tolerance"]
        self.names = data["names"]
        self.settable = [_SETTABLE[role] for role in data["roles"]]
        self._low = np.array([-_LARGEST if low is None else low for low in data["min"]])
        self._high = np.array([_LARGEST if high is None else high for high in data["max"]])
        reals, settable = data["reals"], np.array(self.settable)
        self.reals = Block("Real", 0, self._low[:reals], self._high[:reals], settable[:reals], self.names[:reals])
        self.integers = Block("Integer", reals, self._low[reals:], self._high[reals:], settable[reals:], self.names[reals:])

    def accepts(self, reference, value):
        return bool(self._low[reference] <= value <= self._high[reference])

    def range_of(self, reference):
        """What a value must be, in words."""
        low, high = self._low[reference].item(), self._high[reference].item()
        bounds = [f"at least {low:g}"] * (low > -_LARGEST) + [f"at most {high:g}"] * (high < _LARGEST)
        return " and ".join(["it must be finite", *bounds])
