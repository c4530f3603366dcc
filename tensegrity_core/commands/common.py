"""What the subcommands of `tensegrity` share: the form of a subcommand, arguments that several take, and how they are read."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from .. import statics
from ..errors import InputError, shown
from ..model import Model, grid
from ..scene import builtin_scenes, is_file, load_scene

MOST_STEPS = 1_000_000  # every communication point is kept in memory


class Command(NamedTuple):
    """A subcommand: its name, one line of help, what declares its arguments, and what runs it."""

    name: str
    help: str
    arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


class Parser(argparse.ArgumentParser):
    """A parser whose messages are those of the project's errors: one line of bounded length."""

    def error(self, message: str):
        super().error(shown(message))


def scene_argument(parser: argparse.ArgumentParser) -> None:
    names = ", ".join(builtin_scenes())
    parser.add_argument("scene", metavar="SCENE", help=f"path of a scene file (.toml), or one of: {names}")


def model_of(name: str) -> tuple[Model, str]:
    """The model of a scene that was named on the command line, and the scene's kind of start."""
    if not name.endswith(".toml") and name not in builtin_scenes() and is_file(Path(f"{name}.toml")):
        raise InputError(f"{name} is neither a built-in scene nor a .toml file; did you mean {name}.toml?")
    scene = load_scene(name)
    return statics.build_model(scene), scene.start


def no_arguments(parser: argparse.ArgumentParser) -> None:
    pass


def positive(option: str, value: float) -> float:
    if not (math.isfinite(value) and value > 0.0):
        raise InputError(f"{option} = {value!r} is not a number greater than 0; give one")
    return value


def sample_times(duration: float, step: float) -> np.ndarray:
    """Communication points, s.  Raises InputError where they do not fit the duration, or where they are too many."""
    count = positive("--duration", duration) / positive("--step", step)
    if count > MOST_STEPS:
        problem = f"--duration = {duration!r} takes {count:.3g} samples, more than {MOST_STEPS}"
        raise InputError(f"{problem}; space them wider")
    if round(count) < 1 or abs(count - round(count)) > 1e-6:
        whole = max(1, round(count)) * step
        problem = f"--duration = {duration!r} is no multiple of the time between samples, {step:g} s"
        raise InputError(f"{problem}; give {whole:g}, or another spacing")
    return grid(duration, step)


def force_argument(parser: argparse.ArgumentParser, meaning: str) -> None:
    """The option --force of constant forces; what they are, in words."""
    parser.add_argument("--force", metavar="NODE.AXIS=N", nargs="+", action="extend", default=[], help=meaning)


def finite(option: str, text: str, example: str) -> float:
    """A number of an option.  Raises InputError where it is none, or not finite."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{option}: {text!r} is not a finite number; write as in {example}")
    return value


def constant_force(model: Model, texts: Sequence[str]) -> np.ndarray:
    """(N, 3) N from texts such as n4.z=45.  Raises InputError, also where a component is given twice."""
    given: dict[str, str] = {}
    force = np.zeros((len(model.nodes), 3))
    for text in texts:
        place, equals, number = text.partition("=")
        node, dot, axis = place.rpartition(".")
        if not (equals and dot):
            raise InputError(f"--force {text}: this is not of the form NODE.AXIS=N; write as in n4.z=45")
        letters = [letter for i, letter in enumerate("xyz") if i in model.axes]
        free = [model.node_names[i] for i in model.free_nodes]
        if node not in model.node_names:
            raise InputError(f"--force {text}: {node!r} is no node of {model.name}; free nodes are {', '.join(free)}")
        if node not in free:
            raise InputError(f"--force {text}: {node} is fixed to the ground; free nodes are {', '.join(free)}")
        if axis not in letters:
            raise InputError(f"--force {text}: {axis!r} is no axis of {model.name}; axes are {', '.join(letters)}")
        value = finite(f"--force {text}", number, f"{place}=45")
        if place in given:
            raise InputError(f"--force {text}: {place} is given twice, before as {given[place]}; give the sum once")
        given[place] = text
        force[model.node_names.index(node), "xyz".index(axis)] = value
    return force
