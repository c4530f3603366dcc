"""A scene as another program's file."""

from __future__ import annotations

import importlib
from pathlib import Path

from .. import statics
from ..errors import InputError
from ..output.export import require_writable
from ..scene import load_scene

#: Kind of file -> endings, module that writes it, which has a function `write(path, scene, model)` that returns notes, and
#: how the file is called where nothing is said.
WRITERS = {"mjcf": ((".xml",), "mjcf_writing", "{}.xml"), "csv": ((".csv",), "csv_writing", "{}_nodes.csv")}


def export_scene(scene: str | Path, path: str | Path | None = None, to: str = "mjcf") -> tuple[Path, tuple[str, ...]]:
    """Write a scene as a MuJoCo model (`mjcf`) or as tables of nodes and members (`csv`); returns the file and notes on what it
    does not say, or says otherwise.

    path: None: called as the scene, here.  Raises TensegrityError for what such a file cannot say; nothing is written then.
    """
    if to not in WRITERS:
        raise InputError(f"to = {to!r} is no kind of file that is written; use {' or '.join(WRITERS)}")
    endings, module, usual = WRITERS[to]
    found = load_scene(scene)
    path = require_writable(path or usual.format(found.name), endings)
    return path, tuple(importlib.import_module(f"{__package__}.{module}").write(path, found, statics.build_model(found)))
