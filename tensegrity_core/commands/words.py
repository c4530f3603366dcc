"""What the words of a command line mean: forces, rest lengths, times, coordinates of a scene."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from .. import statics
from ..equilibria import steady_states
from ..equilibria.loading import Loading
from ..errors import InputError
from ..model import Model, grid
from ..output.export import require_writable
from ..output.path_table import Quantity
from ..progress import Told, expected
from ..scene import builtin_scenes, is_file, load_scene

MOST_STEPS = 1_000_000  # every communication point is kept in memory
MOST_ROWS = 100_000  # states of a path
MOST_NAMES = 24  # that a message lists
SECONDS_A_STRING = 2e-4  # that it takes to assemble a model, about


def model_of(name: str, told: Told | None = None) -> tuple[Model, str]:
    """The model of a scene that was named on the command line, and the scene's kind of start.  told: how far that is, which
    takes seconds where there are thousands of bars."""
    if not name.endswith(".toml") and name not in builtin_scenes() and is_file(Path(f"{name}.toml")):
        raise InputError(f"{name} is neither a built-in scene nor a .toml file; did you mean {name}.toml?")
    scene = load_scene(name)
    with expected(SECONDS_A_STRING * len(scene.strings), told):
        return statics.build_model(scene), scene.start


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


def finite(option: str, text: str, example: str) -> float:
    """A number of an option.  Raises InputError where it is none, or not finite."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InputError(f"{option}: {text!r} is not a finite number; write as in {example}")
    return value


def constant_forces(model: Model, texts: Sequence[str]) -> dict[str, float]:
    """Input -> N from texts such as n4.z=45.  Raises InputError, also where a component is given twice."""
    given: dict[str, str] = {}
    found: dict[str, float] = {}
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
        found[f"{node}.force.{axis}"] = value
    return found


def constant_force(model: Model, texts: Sequence[str]) -> np.ndarray:
    """(N, 3) N, see `constant_forces`."""
    force = np.zeros((len(model.nodes), 3))
    for name, value in constant_forces(model, texts).items():
        node, _, axis = name.split(".")
        force[model.node_names.index(node), "xyz".index(axis)] = value
    return force


def parameters_of(start: float, goal: float, step: float | None) -> np.ndarray:
    """The values of p that are asked for.  Raises InputError."""
    for option, value in (("--from", start), ("--to", goal)):
        if not math.isfinite(value):
            raise InputError(f"{option} = {value!r} is not a finite number; give one")
    if start == goal:
        raise InputError(f"--to = {goal!r} is where --from stands, too; give another value")
    if step is None:
        return np.array([start, goal])
    if not (math.isfinite(step) and step > 0.0):
        raise InputError(f"--step = {step!r} is not a number greater than 0; give one")
    count = abs(goal - start) / step
    if count > MOST_ROWS:
        raise InputError(f"--step = {step!r} takes {count:.3g} states, more than {MOST_ROWS}; space them wider")
    if round(count) < 1 or abs(count - round(count)) > 1e-6:
        raise InputError(f"--step = {step!r} does not lead from {start:g} to {goal:g} in whole steps; give another one")
    return start + (goal - start) * np.arange(round(count) + 1) / round(count)


def loading_of(model: Model, forces: Sequence[str], rest_lengths: Sequence[str]) -> Loading:
    """What changes with p.  Raises InputError, also where nothing does."""
    if not (forces or rest_lengths):
        raise InputError("nothing changes with p; give --force or --rest-length, such as --force n4.z=1")
    return Loading(model, constant_force(model, forces), rest_length_change(model, rest_lengths))


def rest_length_change(model: Model, texts: Sequence[str]) -> np.ndarray:
    """(S,) m from texts such as s4=-0.01.  Raises InputError."""
    change, given = np.zeros(len(model.strings)), set()
    for text in texts:
        name, equals, number = text.partition("=")
        if not equals:
            raise InputError(f"--rest-length {text}: this is not of the form STRING=M; write as in s4=-0.01")
        if name not in model.string_names:
            known = ", ".join(model.string_names[:40])
            raise InputError(f"--rest-length {text}: {name!r} is no string of {model.name}; strings are {known}")
        if name in given:
            raise InputError(f"--rest-length {text}: {name} is given twice; give the sum once")
        given.add(name)
        change[model.string_names.index(name)] = finite(f"--rest-length {text}", number, f"{name}=-0.01")
    return change


def steady(model: Model, texts: list[str], told: Told | None = None) -> tuple[Model, np.ndarray]:
    """The model at the steady state that the forces reach slowly, and the forces (N, 3), N."""
    force = constant_force(model, texts)
    return steady_states.reached(model, force, told) if force.any() else model, force


def quantity_of(model: Model, loading: Loading, text: str | None) -> Quantity:
    """The coordinate to show: named as n4.z, or where most force acts, or the highest free node's last axis."""
    if text is None:
        force = np.abs(loading.force_direction)
        if force.any():
            node, axis = divmod(int(np.argmax(force)), 3)
        else:
            axis = model.axes[-1]
            node = max(model.free_nodes, key=lambda n: model.nodes[n, axis])
        return Quantity(f"{model.node_names[node]}.{'xyz'[axis]}", int(node), int(axis))
    name, _, letter = text.rpartition(".")
    letters = [letter for i, letter in enumerate("xyz") if i in model.axes]
    if name not in model.node_names or letter not in letters:
        example = f"{model.node_names[model.free_nodes[0]]}.{letters[-1]}"
        raise InputError(f"--show {text}: this is no coordinate of {model.name}; write as in {example}")
    return Quantity(text, model.node_names.index(name), "xyz".index(letter))


def one_of(option: str, text: str, known: Iterable[str]) -> str:
    """Raises InputError, with the known one that is closest."""
    known = list(known)
    if text in known:
        return text
    close = difflib.get_close_matches(text, known, n=1)
    if close and len(known) > MOST_NAMES:
        raise InputError(f"{option} = {text!r} is not known; did you mean {close[0]}?")
    guess = f"did you mean {close[0]}? Known are" if close else "use one of"
    listed = ", ".join(known) if len(known) <= MOST_NAMES else ", ".join([*known[:MOST_NAMES], "..."])
    raise InputError(f"{option} = {text!r} is not known; {guess} {listed}")


def files_of(output: str | None, figure: str | None) -> tuple[Path | None, Path | None]:
    """Where a table and a picture go.  Raises InputError where one of them cannot be written."""
    table = require_writable(output, (".csv",)) if output else None
    return table, require_writable(figure, (".png", ".svg"), "figure") if figure else None
