"""The subcommand `tensegrity import`: another program's structure as a scene file."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from .options import Debug


def import_(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE", help="A NTRT model (.yaml), a MuJoCo model (.xml), or nodes.csv with members.csv beside it."
        ),
    ],
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="FILE", help="The .toml file to write (default: standard output).")
    ] = None,
    unit: Annotated[
        float | None, typer.Option(metavar="M", help="Metres that a length of 1 means there (default: 0.1 of NTRT, else 1).")
    ] = None,
    debug: Debug = False,
) -> None:
    """Read another program's structure as a scene; comments on top say what of it means something else here, or nothing."""
    from ..files import write_text
    from ..interchange import import_scene
    from ..output.export import require_writable

    path = require_writable(output, (".toml",)) if output else None
    found = import_scene(file, unit)
    if path is None:
        sys.stdout.write(found.text())
        return
    write_text(path, found.text())
    counts = ", ".join(f"{len(found.tables.get(kind, ()))} {kind}" for kind in ("nodes", "bars", "strings"))
    print("\n".join([f"{counts} written to {path}", *(f"  note: {note}" for note in found.notes)]))
