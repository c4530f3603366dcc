"""The subcommand `tensegrity linearize`: matrices A, B, C, D of small motions."""

from __future__ import annotations

from typing import Annotated

import typer

from .options import LIFT, Debug, Json, Scene
from .program import tell

ABOUT = "Constant external forces in N: about the steady state that they reach slowly"


def linearize(
    scene: Scene,
    force: Annotated[list[str] | None, typer.Option(metavar="NODE.AXIS=N", help=f"{ABOUT}, {LIFT}.")] = None,
    inputs: Annotated[
        list[str] | None, typer.Option(metavar="NAME", help="Inputs, such as n4.force.z s1.rest_length; else all.")
    ] = None,
    outputs: Annotated[list[str] | None, typer.Option(metavar="NAME", help="Outputs, such as n4.z s1.force; else all.")] = None,
    motions: Annotated[
        bool, typer.Option("--motions", help="Inputs whose rates are inputs too become states that the rates move.")
    ] = False,
    side: Annotated[
        str | None, typer.Option(metavar="SIDE", help="Which derivative at an end of a string's piece: longer or shorter.")
    ] = None,
    output: Annotated[
        str | None, typer.Option("--output", metavar="FILE", help="Write it to this .json or .mat (MATLAB) file.")
    ] = None,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """The linear system of small motions about a steady state: A, B, C, D with names and units."""
    from ..equilibria import linearization
    from ..output.export import require_writable
    from ..output.state_space import StateSpace, write
    from .words import model_of, steady

    path = require_writable(output, (".json", ".mat")) if output else None
    model, forces = steady(model_of(scene)[0], force or [])
    linear = linearization.linearize(model, linearization.at_rest(model, forces), side)
    found = StateSpace.of(model.name, linear).only(inputs or None, outputs or None)
    if motions:
        found = found.with_motions()
    if path:
        write(found, path)
    tell(found.data() if json else found.summary(), path)
