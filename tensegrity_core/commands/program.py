"""How a command line becomes a call: one subcommand is loaded, errors are one line, and each way to end has its exit code."""

from __future__ import annotations

import importlib
import io
import json
import keyword
import os
import sys
import traceback
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import typer
from typer.core import TyperGroup

from ..errors import InputError, TensegrityError, shown

#: Exit codes: done; done, but what was checked does not hold; a mistake in what was asked, nothing is written.  A program that
#: was asked to end has 128 and the signal's number, see interrupts.py.
DONE, FAILED, MISTAKE = 0, 1, 2
#: Options that take all values that follow them, as in `--force n4.z=45 n5.z=45`; they may be repeated, too.
SEVERAL = ("--force", "--rest-length", "--systems", "--set")
#: Those of one subcommand alone.
SEVERAL_OF = {"linearize": ("--inputs", "--outputs")}
#: Base class of what typer raises for a command line that it cannot read.
_Unreadable: Any = typer.BadParameter.__mro__[2]


class Subcommand(NamedTuple):
    """module: has a function of the subcommand's name (`import_` for `import`), whose parameters are its options; help: in a
    line."""

    module: str
    help: str


class _Reading(TyperGroup):
    """A group that imports the subcommand that runs, and no other: their imports take a second, and `--help` must not."""

    known: dict[str, Subcommand]

    def resolve_command(self, ctx, args):
        if args and args[0] in self.known:
            return args[0], loaded(args[0], self.known[args[0]]), args[1:]
        return super().resolve_command(ctx, args)


def loaded(name: str, subcommand: Subcommand) -> Any:
    """typer's command of a subcommand."""
    function = f"{name}_" if keyword.iskeyword(name) else name
    return single(getattr(importlib.import_module(subcommand.module), function), name)


def single(function: Callable, name: str) -> Any:
    app = typer.Typer(add_completion=False, rich_markup_mode=None)
    app.command(name)(function)
    return typer.main.get_command(app)


def group(known: dict[str, Subcommand], callback: Callable) -> Any:
    """typer's command of all subcommands; callback: takes the options that stand before them."""

    class Group(_Reading):
        pass

    Group.known = known
    app = typer.Typer(cls=Group, rich_markup_mode=None, pretty_exceptions_enable=False)
    app.callback()(callback)
    for name, subcommand in known.items():
        app.command(name, help=subcommand.help)(_stub)
    return typer.main.get_command(app)


def _stub() -> None:
    """Stands for a subcommand where only its name and help are asked for."""


def run(command: Any, name: str, words: Sequence[str] | None) -> int:
    """Run a command of typer with a command line (default: the process's own); returns the exit code.

    `--debug` anywhere on the line shows where an error comes from.
    """
    given = list(sys.argv[1:] if words is None else words)
    debug = "--debug" in given
    sys.stdout, sys.stderr = sys.stdout or io.StringIO(), sys.stderr or io.StringIO()  # a closed stream is None
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="backslashreplace")  # a description may have letters that the terminal's encoding lacks
    try:
        if "--install-completion" in given:
            require_home()
        if f"_{name.upper()}_COMPLETE" in os.environ:
            command.main(prog_name=name)  # the shell asks for completions
        with command.make_context(name, [word for word in spread(given) if word != "--debug"]) as context:
            found = command.invoke(context)
        sys.stdout.flush()  # a reader that has gone shows here, not at the interpreter's exit
        return found if isinstance(found, int) else DONE
    except typer.Exit as end:
        return end.exit_code
    except _Unreadable as error:
        where = error.ctx.command_path if getattr(error, "ctx", None) else name
        return _mistake(f"{where}: error: {_problem(error, given)}; see {where} --help", debug)
    except typer.Abort:
        raise KeyboardInterrupt from None
    except TensegrityError as error:
        return _mistake(str(error), debug)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except OSError as error:  # of a full disk: what files.py writes has errors of its own
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _mistake(f"the output cannot be written: {error.strerror or error}; send it elsewhere", debug)


def require_home() -> None:
    """Raises InputError where there is no folder for a shell's settings."""
    try:
        home = Path.home()
    except RuntimeError:  # no HOME, and a user whom the system does not know
        home = None
    if not (home and home != Path(home.anchor) and home.is_dir() and os.access(home, os.W_OK)):
        what = (
            "there is no home folder" if home is None else f"HOME = {str(home)!r} is no folder of yours that can be written to"
        )
        raise InputError(
            f"{what}, and completion goes there; set HOME, or put what --show-completion prints where the shell reads it"
        )


def tell(found: str | dict[str, Any], *written: object) -> None:
    """Print a subcommand's result, a text or what JSON takes, and the files that it has written (None: none)."""
    files = [str(path) for path in written if path]
    if isinstance(found, str):
        print("\n".join([found, *(f"  written: {path}" for path in files)]))
    else:
        print(json.dumps(found | ({"written": files} if files else {}), indent=2, allow_nan=False))


def _mistake(message: str, debug: bool) -> int:
    if debug:
        traceback.print_exc()
    print(shown(message), file=sys.stderr)
    return MISTAKE


def _problem(error: Any, words: list[str]) -> str:
    """What cannot be read, with the value that typer leaves out."""
    message = error.format_message().rstrip(".")
    for option in getattr(getattr(error, "param", None), "opts", ()):
        if isinstance(error, typer.BadParameter) and option in words[:-1]:
            message = message.replace(f"Invalid value for '{option}'", f"{option} = {words[words.index(option) + 1]!r}")
    return message


def spread(words: Iterable[str]) -> list[str]:
    """The same words, with an option of SEVERAL (or SEVERAL_OF) before each of its values."""
    words = list(words)
    several = SEVERAL + SEVERAL_OF.get(next((word for word in words if not word.startswith("-")), ""), ())
    found: list[str] = []
    option = None
    for word in words:
        if word.startswith("--"):
            option, fresh = (word, True) if word in several else (None, False)
        elif option and not fresh:
            found.append(option)
        elif option:
            fresh = False
        found.append(word)
    return found
