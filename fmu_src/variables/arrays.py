"""The variables of FMI 3.0 out of the table: the rows of a vector become one array.

A variable's value reference is that of its first element, so that elements have the same references in both versions.  The
independent variable `time` and the event indicators follow the last one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby

from .interface import Variable, require_unique

#: The name of the independent variable.
TIME = "time"


@dataclass(frozen=True)
class Whole:
    """A variable: a scalar, which is one row, or an array with a row for each element."""

    name: str
    description: str
    rows: tuple[Variable, ...]
    is_array: bool

    @property
    def first(self) -> Variable:
        return self.rows[0]

    @property
    def reference(self) -> int:
        return self.first.reference

    def largest(self, name: str) -> float | int | None:
        """Of an attribute of all elements, None where one has none."""
        values = [getattr(row, name) for row in self.rows]
        return None if None in values else max(values)

    def least(self, name: str) -> float | int | None:
        values = [getattr(row, name) for row in self.rows]
        return None if None in values else min(values)


def wholes(table: Iterable[Variable]) -> tuple[Whole, ...]:
    """The variables that the rows of a table form, in their order.  Raises ValueError where two would get the same name, or the
    elements of one do not follow each other."""
    found = []
    for _, group in groupby(table, key=lambda row: row.array or row.reference):
        rows = tuple(group)
        name, description = rows[0].array or (rows[0].name, rows[0].description)
        found.append(Whole(name, description, rows, rows[0].array is not None))
        if [row.reference for row in rows] != list(range(rows[0].reference, rows[0].reference + len(rows))):
            raise ValueError(f"the elements of {name!r} do not follow each other")
    require_unique(found)
    return tuple(found)


def element_names(table: tuple[Variable, ...]) -> dict[int, str]:
    """What messages call each value: n4.force[1]."""
    names = {}
    for whole in wholes(table):
        for place, row in enumerate(whole.rows, 1):
            names[row.reference] = f"{whole.name}[{place}]" if whole.is_array else whole.name
    return names


def spans(table: tuple[Variable, ...]) -> dict[int, int]:
    """Reference -> how many values the variable has that starts there."""
    return {whole.reference: len(whole.rows) for whole in wholes(table)}


def owners(table: Iterable[Variable]) -> dict[int, int]:
    """Reference of an element -> of its variable."""
    return {row.reference: whole.reference for whole in wholes(table) for row in whole.rows}


def time_variable(reference: int) -> Variable:
    """The independent variable, which every FMU of FMI 3.0 has."""
    return Variable(
        name=TIME,
        reference=reference,
        kind="Real",
        causality="independent",
        variability="continuous",
        initial=None,
        unit="s",
        start=None,
        min=None,
        max=None,
        nominal=None,
        description="time",
        field="",
        known=(),
    )
