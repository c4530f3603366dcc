"""The subcommand `tensegrity export`: a scene as another program's file."""

from __future__ import annotations

from typing import Annotated

import typer

from .options import Debug, Scene


def export(
    scene: Scene,
    to: Annotated[str, typer.Option(metavar="KIND", help="mjcf (a MuJoCo model, .xml) or csv (nodes, members and scene).")],
    output: Annotated[
        str | None,
        typer.Option("--output", "-o", metavar="FILE", help="The file to write (default: NAME.xml or NAME_nodes.csv)."),
    ] = None,
    debug: Debug = False,
) -> None:
    """Write a scene at its start as another program's file, and say what that cannot say."""
    from ..interchange import WRITERS, export_scene
    from .words import one_of

    path, notes = export_scene(scene, output, one_of("--to", to, WRITERS))
    print("\n".join([f"{path} written", *(f"  note: {note}" for note in notes)]))
