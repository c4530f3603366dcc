"""`tensegrity experiment`: the article's experiments and force curves as tables, CSV files and figures."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..article.experiments import EXPERIMENTS, STEP, SYSTEMS, Experiment
from ..errors import InputError
from ..output.export import write_columns
from .common import Command, sample_times


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.usage = "%(prog)s NAME [options]"  # NAME first: --systems takes all that follows it
    about = "; ".join(f"{name}: {experiment.about}" for name, experiment in EXPERIMENTS.items())
    parser.add_argument("name", metavar="NAME", choices=EXPERIMENTS, help=about)
    parser.add_argument("--output", metavar="DIR", default=".", help="folder for the files, made if absent (default: this one)")
    parser.add_argument("--duration", type=float, help="simulated time, s (default: in full length)")
    parser.add_argument("--systems", nargs="+", choices=SYSTEMS, help="of I and III: which systems (default: all)")


def run(arguments: argparse.Namespace) -> int:
    """Run an experiment, print its table, and write its figures and data."""
    from ..article.figures import write_figures  # Matplotlib takes a second to import

    name, experiment = arguments.name, EXPERIMENTS[arguments.name]
    systems, duration = _systems(arguments, experiment), _duration(arguments, experiment)
    folder = _folder(arguments.output)
    data = experiment.run(systems, duration)
    stem = folder / f"experiment_{name}"
    table = stem.with_suffix(".csv")
    write_columns(data.columns(), table)
    files = [table, *write_figures(name, data, stem)]
    print(f"{name}: {experiment.about}" + ("" if duration is None else f", {duration:g} s"))
    print(data.summary())
    print(f"  written: {', '.join(str(file) for file in files)}")
    return 0


def _systems(arguments: argparse.Namespace, experiment: Experiment) -> tuple[str, ...]:
    """Without doubles, in the article's order."""
    if arguments.systems and not experiment.many:
        shown = " ".join(arguments.systems)
        raise InputError(f"--systems {shown}: {arguments.name} has one system only; leave the option out")
    return tuple(name for name in SYSTEMS if name in (arguments.systems or SYSTEMS))


def _duration(arguments: argparse.Namespace, experiment: Experiment) -> float | None:
    """s; None where nothing moves in time."""
    if arguments.duration is None:
        return experiment.duration
    if experiment.duration is None:
        problem = f"--duration = {arguments.duration!r}: {arguments.name} is a curve, not a motion"
        raise InputError(f"{problem}; leave the option out")
    return float(sample_times(arguments.duration, STEP)[-1])


def _folder(text: str) -> Path:
    folder = Path(text)
    try:
        folder.mkdir(exist_ok=True)
    except OSError as failure:
        raise InputError(f"--output {text}: no such folder can be made: {failure.strerror}; name another one") from failure
    return folder


COMMAND = Command("experiment", "run an experiment of the article, with its figures and data", _arguments, run)
