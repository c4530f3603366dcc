"""The subcommand `tensegrity modes`: frequencies, damping and shapes of small motions."""

from __future__ import annotations

from typing import Annotated

import typer

from ..errors import InputError
from .options import LIFT, Debug, FigureFile, Json, Scene, TableFile
from .program import tell

ABOUT = "Constant external forces in N: modes about the steady state that they reach slowly"


def modes(
    scene: Scene,
    force: Annotated[list[str] | None, typer.Option(metavar="NODE.AXIS=N", help=f"{ABOUT}, {LIFT}.")] = None,
    undamped: Annotated[bool, typer.Option("--undamped", help="Leave the dampers out.")] = False,
    count: Annotated[int, typer.Option(metavar="N", help="Modes to print.")] = 12,
    output: TableFile = None,
    figure: FigureFile = None,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Frequencies, damping and shapes of small motions about a steady state."""
    from ..equilibria import modes as linear
    from ..output import modes_table
    from ..progress import Bar, expected
    from .words import files_of, model_of, steady

    table, picture = files_of(output, figure)
    if count < 1:
        raise InputError(f"--count = {count} is out of range; give a whole number from 1 on")
    with Bar(f"reading {scene}") as bar:
        model, _ = model_of(scene, bar)
        model, forces = steady(model, force or [], bar.begin("loading slowly"))
        with expected(linear.seconds(model, damped=not undamped), bar.begin(f"modes of {model.name}")):
            found = linear.modes(model, forces, damped=not undamped)
    if table:
        modes_table.write(table, model, found)
    if picture:
        from ..output.modes_figures import modes_figure
        from ..output.plots import write_figure

        write_figure(modes_figure(model, [mode for mode in found if not mode.neutral]), picture)
    tell(modes_table.data(model, found, forces) if json else modes_table.summary(model, found, count, forces), table, picture)
