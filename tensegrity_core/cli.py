"""The command `tensegrity`: its subcommands, and how they end."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from .commands.check import check
from .commands.common import Command, Parser, no_arguments, scene_argument
from .commands.experiment import COMMAND as EXPERIMENT
from .commands.modes import COMMAND as MODES
from .commands.path import COMMAND as PATH
from .commands.schema import schema
from .commands.simulate import animate, animate_arguments, simulate, simulate_arguments
from .commands.tower import tower, tower_arguments
from .errors import TensegrityError
from .interrupts import program


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = Parser(prog="tensegrity", description="Tensegrity dynamics with NSH.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in COMMANDS:
        subparser = commands.add_parser(command.name, help=command.help, description=command.help)
        command.arguments(subparser)
        subparser.set_defaults(run=command.run)
    chosen = parser.parse_args(arguments)
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="backslashreplace")  # a description may have letters that the terminal's encoding lacks
    try:
        code = chosen.run(chosen)
        sys.stdout.flush()  # a reader that has gone shows here, not at the interpreter's exit
        return code
    except TensegrityError as error:
        print(error, file=sys.stderr)
        return 2
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


COMMANDS = (
    Command("check", "check a scene file and summarise its structure", scene_argument, check),
    Command("tower", "write the scene file of a tower of any number of stages", tower_arguments, tower),
    Command("simulate", "simulate a scene under constant forces", simulate_arguments, simulate),
    Command("animate", "film a scene under constant forces as a GIF", animate_arguments, animate),
    EXPERIMENT,
    PATH,
    MODES,
    Command("schema", "print the JSON schema of scene files", no_arguments, schema),
)


if __name__ == "__main__":
    program(main)
