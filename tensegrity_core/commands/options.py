"""Options and arguments that several subcommands take, under the same names everywhere."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from ..fields import METHODS

LIFT = "such as n4.z=45 n5.x=-10"


def suggested(incomplete: str) -> list[str]:
    """For the shell's completion: built-in scenes, and scene files here."""
    from ..scene import builtin_scenes

    return matching((*builtin_scenes(), *map(str, Path().glob("*.toml"))), incomplete)


def methods(incomplete: str) -> list[str]:
    return matching(METHODS, incomplete)


def matching(names: Iterable[str], begun: str) -> list[str]:
    """Those that a word that has begun may become."""
    return [name for name in names if name.startswith(begun)]


Scene = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="Path of a scene file (.toml), or a built-in scene's name, such as three_bar_nsh.",
        autocompletion=suggested,
    ),
]
Force = Annotated[
    list[str] | None,
    typer.Option(metavar="NODE.AXIS=N", help=f"Constant external forces in N on free nodes, each component once, {LIFT}."),
]
Duration = Annotated[float, typer.Option(metavar="S", help="Simulated time, s.")]
Method = Annotated[
    str,
    typer.Option(metavar="NAME", help=f"Integration method: {', '.join(METHODS)}.", autocompletion=methods),
]
Tolerance = Annotated[float, typer.Option(metavar="X", help="Error per step.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show where an error comes from.")]
InputFile = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="Inputs over time: a .csv, .nc or .parquet file with columns time, n4.force.z, s1.rest_length ...",
    ),
]
SampleStep = Annotated[float, typer.Option(metavar="S", help="Time between samples, s (not the integrator's step).")]
SeriesFile = Annotated[
    str | None, typer.Option(metavar="FILE", help="Write the series to this .csv, .nc (NetCDF) or .parquet file.")
]
TableFile = Annotated[str | None, typer.Option("--output", metavar="FILE", help="Write all of it to this .csv file.")]
FigureFile = Annotated[str | None, typer.Option("--figure", metavar="FILE", help="Draw it into this .png or .svg file.")]
