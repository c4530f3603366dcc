"""`tensegrity experiment`: the article's experiments and force curves as tables, CSV files and figures."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError
from .options import Debug, Json
from .program import tell

if TYPE_CHECKING:
    from ..article.experiments import Experiment

NAMES = "I: steady heights; II: a square wave; III: top strings move; IV: a mass on an NSH; beam, nsh: force curves"


def experiment(
    name: Annotated[str, typer.Argument(metavar="NAME", help=f"{NAMES}.")],
    output: Annotated[str, typer.Option(metavar="DIR", help="Folder for the files, made if absent.")] = ".",
    duration: Annotated[float | None, typer.Option(metavar="S", help="Simulated time, s (default: in full length).")] = None,
    systems: Annotated[
        list[str] | None,
        typer.Option(metavar="SYSTEM", help="Of I and III: which of two_bar, three_bar, six_bar (default: all)."),
    ] = None,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Run an experiment of the article, print its table, and write its figures and data."""
    from ..article.experiments import EXPERIMENTS
    from ..article.figures import write_figures
    from ..output.export import write_columns
    from ..progress import Bar
    from .words import one_of

    chosen = EXPERIMENTS[one_of("NAME", name, EXPERIMENTS)]
    wanted, seconds = _systems(name, systems, chosen), _duration(name, duration, chosen)
    folder = _folder(output)
    with Bar(f"experiment {name}") as bar:
        data = chosen.run(wanted, seconds, bar)
    table = folder / f"experiment_{name}.csv"
    columns = data.columns()
    write_columns(columns, table)
    files = [table, *write_figures(name, columns, table.with_suffix(""))]
    if json:
        found = {"experiment": name, "about": chosen.about, "duration": seconds, "table": data.records()}
        tell(found, *files)
        return
    print(f"{name}: {chosen.about}" + ("" if seconds is None else f", {seconds:g} s"))
    print(data.summary())
    print(f"  written: {', '.join(str(file) for file in files)}")


def _systems(name: str, asked: list[str] | None, experiment: Experiment) -> tuple[str, ...]:
    """Without doubles, in the article's order."""
    from ..article.experiments import SYSTEMS
    from .words import one_of

    if asked and not experiment.many:
        raise InputError(f"--systems {' '.join(asked)}: {name} has one system only; leave the option out")
    known = [one_of("--systems", system, SYSTEMS) for system in asked or SYSTEMS]
    return tuple(system for system in SYSTEMS if system in known)


def _duration(name: str, asked: float | None, experiment: Experiment) -> float | None:
    """s; None where nothing moves in time."""
    from ..article.experiments import STEP
    from .words import sample_times

    if asked is None:
        return experiment.duration
    if experiment.duration is None:
        raise InputError(f"--duration = {asked!r}: {name} is a curve, not a motion; leave the option out")
    return float(sample_times(asked, STEP)[-1])


def _folder(text: str) -> Path:
    folder = Path(text)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as failure:
        raise InputError(f"--output {text}: no such folder can be made: {failure.strerror}; name another one") from failure
    return folder
