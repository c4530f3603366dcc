"""The subcommand `tensegrity new`: a scene file with comments, to begin with."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated

import typer

from ..errors import InputError
from .options import Debug, matching

TEMPLATES = Path(__file__).parent.parent / "scene" / "templates"


def kinds() -> list[str]:
    return sorted(path.stem for path in TEMPLATES.glob("*.toml"))


def begun(incomplete: str) -> list[str]:
    return matching(kinds(), incomplete)


def new(
    kind: Annotated[
        str, typer.Argument(metavar="KIND", help=f"What it begins as: {', '.join(kinds())}.", autocompletion=begun)
    ],
    output: Annotated[str | None, typer.Option(metavar="FILE", help="The .toml file to write (default: KIND.toml).")] = None,
    debug: Debug = False,
) -> None:
    """Write a scene file with comments, to begin with.  A file that is there stays as it is."""
    from ..files import write_text
    from ..output.export import require_writable
    from .words import one_of

    if kind == "tower":
        raise InputError("KIND = 'tower' has a subcommand of its own: tensegrity tower STAGES --output tower.toml")
    source = TEMPLATES / f"{one_of('KIND', kind, kinds())}.toml"
    path = require_writable(output or source.name, (".toml",))
    if not re.fullmatch(r"[A-Za-z]\w*", path.stem, re.ASCII):
        raise InputError(f"{path}: the file's name is the scene's, and must be an identifier; name it as in {kind}_1.toml")
    if path.exists():
        raise InputError(f"{path} is there; name another file: --output FILE")
    write_text(path, source.read_text(encoding="utf-8"))
    print(f"{path} written; edit it, then: tensegrity check {path}")
