"""The command `tensegrity`: its subcommands, and how they are run."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Annotated

import typer

from . import __version__
from .commands.program import Subcommand, group, run
from .interrupts import program

HERE = "tensegrity_core.commands"
#: In the order in which one needs them.
COMMANDS = {
    "new": Subcommand(f"{HERE}.new", "write a scene file with comments, to begin with"),
    "check": Subcommand(f"{HERE}.check", "check a scene file and summarise its structure"),
    "simulate": Subcommand(f"{HERE}.simulate", "simulate a scene under forces and other inputs"),
    "animate": Subcommand(f"{HERE}.simulate", "film a scene under constant forces as a GIF"),
    "view": Subcommand(f"{HERE}.view", "write a web page in which a structure moves, and can be pulled"),
    "build": Subcommand("fmu_src.build", "build FMUs and validate them against the reference"),
    "run": Subcommand("fmu_src.run", "run an FMU over inputs from a file"),
    "path": Subcommand(f"{HERE}.path", "follow steady states under a slow load, through snaps"),
    "modes": Subcommand(f"{HERE}.modes", "frequencies, damping and shapes of small motions"),
    "linearize": Subcommand(f"{HERE}.linearize", "matrices A, B, C, D of small motions, with names and units"),
    "experiment": Subcommand(f"{HERE}.experiment", "run one of the article's experiments"),
    "tower": Subcommand(f"{HERE}.tower", "write the scene file of a tower of any number of stages"),
    "import": Subcommand(f"{HERE}.import_", "another program's structure as a scene file"),
    "export": Subcommand(f"{HERE}.export", "a scene as another program's file"),
    "schema": Subcommand(f"{HERE}.schema", "print the JSON schema of scene files"),
    "doctor": Subcommand("fmu_src.doctor", "say what this installation has, and what is missing"),
}


def _version(asked: bool) -> None:
    if asked:
        print(f"tensegrity {__version__}")
        raise typer.Exit


def _options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")] = False,
) -> None:
    """Tensegrity dynamics with negative stiffness honeycombs, and its FMUs.

    Exit codes: 0 done; 1 done, but what was checked does not hold; 2 a mistake in what was asked, and nothing is written; 130
    ended by Ctrl-C.
    """


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code.  Without words it shows its help."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    return run(group(COMMANDS, _options), "tensegrity", words or ["--help"])


if __name__ == "__main__":
    program(main)
