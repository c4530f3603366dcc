"""The subcommand `tensegrity tower`: writes the scene of a tower."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from .options import Debug

#: That a scene takes to be written, about.
SECONDS_A_STAGE = 5e-4


def tower(
    stages: Annotated[int, typer.Argument(metavar="STAGES", help="Number of stages, 1 to 1000.")],
    nsh: Annotated[bool, typer.Option("--nsh", help="Put the article's NSH into vertical and upper diagonal strings.")] = False,
    gravity: Annotated[float | None, typer.Option(help="m/s2 (default: 9.81 for one or two stages, else 0).")] = None,
    tension: Annotated[
        float | None, typer.Option(help="Of inner saddle strings, N; all others go with it (default: 40).")
    ] = None,
    stiffness: Annotated[float, typer.Option(help="Of all strings, N/m.")] = 5000.0,
    damping: Annotated[float, typer.Option(help="Of all strings, N s/m.")] = 500.0,
    mass: Annotated[float, typer.Option(help="Of each bar, kg.")] = 1.0,
    output: Annotated[
        str | None, typer.Option(metavar="FILE", help="The .toml file to write (default: standard output).")
    ] = None,
    debug: Debug = False,
) -> None:
    """Write the scene file of a tower of any number of stages."""
    from ..files import write_text
    from ..output.export import require_writable
    from ..progress import Bar, expected
    from ..scene.towers import tower_text

    path = require_writable(output, (".toml",)) if output else None
    values = {"gravity": gravity, "tension": tension, "stiffness": stiffness, "damping": damping, "mass": mass}
    with Bar(f"a tower of {stages} stages") as bar, expected(SECONDS_A_STAGE * max(stages, 1), bar):
        text = tower_text(stages, nsh, **values)
    if not path:
        sys.stdout.write(text)
        return
    write_text(path, text)
    print(f"{3 * stages} bars written to {path}; see its equilibrium with: tensegrity check {path}")
