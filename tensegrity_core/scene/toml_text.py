"""Tables as the text of a scene file."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np


def toml(value: Any) -> str:
    """A value in TOML, in one line; numbers read back to the last bit."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, str):
        return json.dumps(value).replace("\x7f", "\\u007f")  # TOML's escapes are JSON's, and it wants this one
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return f"[{', '.join(map(toml, value))}]"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {toml(part)}" for key, part in value.items()) + " }"
    return repr(value)


def scene_text(tables: Mapping[str, Any], notes: tuple[str, ...] = ()) -> str:
    """A scene's tables as its file, with notes as comments above; names are identifiers."""
    lines = [f"# {line}" for note in notes for line in note.splitlines()]
    lines += [f"{key} = {toml(value)}" for key, value in tables.items() if not isinstance(value, Mapping)]
    return "\n".join([*lines, *_tables(tables, ())]) + "\n"


def _tables(tables: Mapping[str, Any], above: tuple[str, ...]) -> Iterator[str]:
    for key, table in tables.items():
        if not isinstance(table, Mapping):
            continue
        place = (*above, key)
        rows = [f"{name} = {toml(value)}" for name, value in table.items() if len(place) > 1 or not _deep(key, value)]
        if rows:
            yield from ("", f"[{'.'.join(place)}]", *rows)
        if len(place) == 1:
            yield from _tables({name: value for name, value in table.items() if _deep(key, value)}, place)


def _deep(key: str, value: Any) -> bool:
    """Whether a table in a table has a heading of its own: nodes, bars and strings are rows."""
    return isinstance(value, Mapping) and key not in ("bars", "strings")
