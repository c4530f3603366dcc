"""The subcommand `tensegrity build`, also as build_fmu.py and python -m fmu_src.build: FMUs of scenes, validated."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from tensegrity_core.commands.options import Debug, Json, suggested
from tensegrity_core.commands.program import run, single
from tensegrity_core.interrupts import program

RUNTIMES = ("both", "native", "python")
NAMINGS = ("structured", "flat")


def build(
    scenes: Annotated[
        list[str] | None,
        typer.Argument(metavar="SCENE...", help="Scenes' names, or paths of .toml files.", autocompletion=suggested),
    ] = None,
    all: Annotated[bool, typer.Option("--all", help="All built-in scenes.")] = False,
    runtime: Annotated[str, typer.Option(metavar="NAME", help=f"One of {', '.join(RUNTIMES)}.")] = "both",
    kind: Annotated[
        str, typer.Option(metavar="NAME", help="cs: co-simulation; me: model exchange, native only; both: in one FMU.")
    ] = "cs",
    fmi: Annotated[str, typer.Option(metavar="VERSION", help="2.0, or 3.0: native only, vectors are arrays.")] = "2.0",
    platforms: Annotated[
        str, typer.Option(metavar="NAMES", help="Beside this one: linux64, win64 ... with commas between them, or all.")
    ] = "",
    sources: Annotated[
        bool, typer.Option("--sources", help="Native FMUs that can be compiled from their sources, too.")
    ] = False,
    no_binaries: Annotated[
        bool, typer.Option("--no-binaries", help="With --sources: nothing else, to be compiled where it is to run.")
    ] = False,
    simple_types: Annotated[
        bool,
        typer.Option("--simple-types", help="FMUs with Real outputs and no enumeration, for tools that know no others."),
    ] = False,
    cross_check: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write cross-check bundles of native FMUs, too.")
    ] = None,
    output: Annotated[Path, typer.Option(metavar="DIR", help="Folder of the FMUs and reports.")] = Path("dist"),
    detach_actuators: Annotated[
        bool,
        typer.Option(
            "--detach-actuators", help="Actuators as FMUs of their own, SCENE_STRING_actuator, beside a structure without them."
        ),
    ] = False,
    ssp: Annotated[
        str | None, typer.Option(metavar="VERSION", help="Detached actuators and structure as an SSP archive, too: 2.0 or 1.0.")
    ] = None,
    no_page: Annotated[
        bool, typer.Option("--no-page", help="Without the page in which the scene moves: 0.3 MB less in each FMU.")
    ] = False,
    naming: Annotated[str, typer.Option(metavar="NAME", help="structured: n4.force.x; flat: n4_force_x.")] = "structured",
    no_validate: Annotated[bool, typer.Option("--no-validate", help="Only build.")] = False,
    thorough: Annotated[bool, typer.Option("--thorough", help="Validate every input at every damping.")] = False,
    no_cache: Annotated[bool, typer.Option("--no-cache", help="Run every reference anew.")] = False,
    cache: Annotated[Path | None, typer.Option(metavar="DIR", help="Folder of reference runs (default: the user's).")] = None,
    json: Json = False,
    debug: Debug = False,
) -> int:
    """Build FMUs of scenes and validate them against the reference."""
    from tensegrity_core.commands.words import one_of
    from tensegrity_core.scene import builtin_scenes

    from . import builds

    runtime, naming = one_of("--runtime", runtime, RUNTIMES), one_of("--naming", naming, NAMINGS)
    options = builds.Options(
        scenes=(*(builtin_scenes() if all else ()), *(scenes or ())),
        runtimes=builds.runtimes(runtime, native=kind != "cs" or fmi != "2.0" or no_binaries),
        fmi=fmi,
        kind=kind,
        platforms=builds.platforms(platforms),
        sources=sources,
        binaries=not no_binaries,
        simple=simple_types,
        page=not no_page,
        cross_check=cross_check,
        output=output,
        apart=detach_actuators,
        ssp=ssp,
        naming=naming,
        validate=not no_validate,
        thorough=thorough,
        cache=None if no_cache else cache or builds.CACHE,
        json=json,
    )
    return builds.make(options)


def main(words: Sequence[str] | None = None) -> int:
    """The subcommand as a program of its own; returns the exit code."""
    name = "python -m fmu_src.build" if Path(sys.argv[0]).name == "build.py" else "build_fmu.py"
    return run(single(build, "build"), name, words)


if __name__ == "__main__":
    program(main)
