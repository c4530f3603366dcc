"""The subcommand `tensegrity linearize`: matrices A, B, C, D of small motions."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError
from .options import LIFT, Debug, Json, Scene
from .program import tell

if TYPE_CHECKING:
    from ..model import Model
    from ..output.state_space import StateSpace

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
    at: Annotated[
        str | None,
        typer.Option(
            metavar="FILE[@TIME]",
            help="About a row of this run's file instead, at TIME s or its last; --force: what pulled there.",
        ),
    ] = None,
    output: Annotated[
        str | None, typer.Option("--output", metavar="FILE", help="Write it to this .json or .mat (MATLAB) file.")
    ] = None,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """The linear system of small motions about a steady state or a row of a run: A, B, C, D with names and units."""
    from ..equilibria import linearization
    from ..output.export import require_writable
    from ..output.state_space import StateSpace, write
    from .words import model_of, steady

    path = require_writable(output, (".json", ".mat")) if output else None
    model = model_of(scene)[0]
    if at is None:
        model, forces = steady(model, force or [])
        found = StateSpace.of(model.name, linearization.linearize(model, linearization.at_rest(model, forces), side))
    else:
        found = _about_a_row(model, at, force or [], side)
    found = found.only(inputs or None, outputs or None)
    if motions:
        found = found.with_motions()
    if path:
        write(found, path)
    tell(found.data() if json else found.summary(), path)


def _about_a_row(model: Model, at: str, force: list[str], side: str | None) -> StateSpace:
    """The system about FILE[@TIME].  Raises InputError where the run had other rest lengths than the scene."""
    from ..equilibria import linearization
    from ..model.inputs import starts
    from ..output.page.series import result_of_file
    from ..output.state_space import StateSpace, require_tensions, row_at
    from .words import constant_force, finite

    if model.moving:
        raise InputError(f"--at {at}: a run's file does not hold how {model.name}'s moved nodes go on; use tc.linearize(run)")
    file, _, time = at.rpartition("@") if not Path(at).is_file() and "@" in at else (at, "", "")
    result = result_of_file(Path(file), model)
    if not force:
        print("note: no force is taken to act; if one did, name it: --force NODE.AXIS=N", file=sys.stderr)
    row = row_at(result.times, finite("--at", time, f"{file}@2.5") if time else None, file)
    inputs = starts(model) | {"force": constant_force(model, force)}
    inputs["rest_length"] = inputs["rest_length"].copy()
    inputs["rest_length"][list(model.actuated)] = result.wound_rest_length[row]
    state = linearization.State(result.position[row], result.velocity[row], result.motor_speed[row], inputs)
    found = StateSpace.of(model.name, linearization.linearize(model, state, side))
    require_tensions(found, model, result.elastic_force[row], range(len(model.strings)))
    return found
