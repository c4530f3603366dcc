"""The subcommand `tensegrity path`: steady states under a load that grows slowly, and falls again."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path as FilePath

import numpy as np

from ..equilibria import paths, steady_states
from ..equilibria.loading import Loading
from ..errors import InputError
from ..files import replacing_text
from ..model import Model
from ..output.export import require_writable
from .common import Command, constant_force, finite, force_argument, model_of, scene_argument

MOST_ROWS = 100_000


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.usage = "%(prog)s SCENE --to P [options]"
    scene_argument(parser)
    force_argument(parser, "external forces in N at p = 1, on free nodes, such as n4.z=1 n5.z=1")
    parser.add_argument(
        "--rest-length",
        metavar="STRING=M",
        nargs="+",
        action="extend",
        default=[],
        help="changes of rest lengths in m at p = 1, such as s4=-0.01",
    )
    parser.add_argument("--from", dest="start", metavar="P", type=float, default=0.0, help="first p (default %(default)g)")
    parser.add_argument("--to", dest="goal", metavar="P", type=float, required=True, help="last p")
    parser.add_argument("--step", metavar="P", type=float, help="states at this spacing of p (default: the path's points)")
    parser.add_argument("--back", action="store_true", help="then let the load fall to the first p again")
    parser.add_argument("--unstable", action="store_true", help="trace what lies behind limit and branch points, too")
    parser.add_argument("--show", metavar="NODE.AXIS", help="the coordinate that is shown (default: where most force acts)")
    parser.add_argument("--output", metavar="FILE", help="write the states to this .csv file")
    parser.add_argument("--figure", metavar="FILE", help="draw load over coordinate into this .png or .svg file")


def run(arguments: argparse.Namespace) -> int:
    """Follow the steady states of a scene under a slow load, say where they jump, and write and draw them."""
    output = arguments.output and require_writable(arguments.output, (".csv",))
    figure = arguments.figure and require_writable(arguments.figure, (".png", ".svg"))
    parameters = parameters_of(arguments.start, arguments.goal, arguments.step)
    model, _ = model_of(arguments.scene)
    loading = loading_of(model, arguments.force, arguments.rest_length)
    quantity = quantity_of(model, loading, arguments.show)
    sweeps = _sweeps(loading, parameters, arguments.back)
    behind = [path for sweep in sweeps.values() for path in steady_states.detours(sweep)] if arguments.unstable else []
    if output:
        _write(output, loading, sweeps, behind, by_step=arguments.step is not None)
    if figure:
        _draw(figure, model, loading, sweeps, behind, quantity)
    print(summary(model, sweeps, behind, quantity))
    for path in (output, figure):
        if path:
            print(f"  written: {path}")
    return 0


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


def quantity_of(model: Model, loading: Loading, text: str | None):
    """The coordinate to show: named as n4.z, or where most force acts, or the highest free node's last axis."""
    from ..output.path_figures import Quantity  # Matplotlib takes a second to import

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


def _sweeps(loading: Loading, parameters: np.ndarray, back: bool) -> dict[str, steady_states.Sweep]:
    """Legs by name, in order."""
    nodes = None
    if parameters[0] != 0.0:
        nodes = steady_states.load_sweep(loading, [0.0, parameters[0]]).nodes[-1]
    found = {"there": steady_states.load_sweep(loading, parameters, nodes)}
    if back:
        found["back"] = steady_states.load_sweep(loading, parameters[::-1], found["there"].nodes[-1])
    return found


# --- what it prints and writes -----------------------------------------------------------------------------------------

WHY = {
    "limit": "limit point",
    "branch": "branch point: other paths leave here, --unstable traces them",
    "kink": "a string's force curve has a kink",
    "loose": "strings go slack and leave motions that nothing resists",
}


def summary(model: Model, sweeps: dict[str, steady_states.Sweep], behind: list[paths.Path], quantity) -> str:
    """What `tensegrity path` prints: the jumps of each leg, and what lies behind them."""
    lines = []
    for sweep in sweeps.values():
        first, last = sweep.parameters[[0, -1]]
        start, end = (nodes[quantity.node, quantity.axis] for nodes in sweep.nodes[[0, -1]])
        jumps = "no jump" if not sweep.jumps else f"{len(sweep.jumps)} jumps" if len(sweep.jumps) > 1 else "1 jump"
        lines.append(f"  p = {first:g} to {last:g}: {quantity.name} from {start:z.6f} to {end:z.6f} m, {jumps}")
        for jump in sweep.jumps:
            before, after = (quantity.of(sweep.paths[0], point) for point in (jump.before, jump.after))
            lines.append(f"    p = {jump.parameter:.9g}: {before:z.6f} to {after:z.6f} m, {WHY[jump.kind]}")
    for path in behind:
        kinds = [f"{p.kind} at p = {p.parameter:.9g}" for p in path.points[1:] if p.kind in ("limit", "branch")]
        start, end = path.points[0].parameter, path.points[-1].parameter
        lines.append(f"  behind p = {start:.6g}, to {end:.6g}: {', '.join(kinds) or 'no limit and branch points'}")
    return "\n".join([f"{model.name}: steady states under a slow load", *lines])


def _write(output: FilePath, loading, sweeps, behind, by_step: bool) -> None:
    """One row per state: leg, p, whether it is stable, what is special about it, coordinates (m), string tensions (N)."""
    model = loading.model
    nodes = [f"{model.node_names[i]}.{'xyz'[axis]}" for i in range(len(model.nodes)) for axis in model.axes]
    header = ["leg", "p", "stable", "kind", *nodes, *(f"{name}.elastic_force" for name in model.string_names)]
    legs = [
        (name, sweep.equations, sweep.states if by_step else [p for path in sweep.paths for p in path.points])
        for name, sweep in sweeps.items()
    ]
    legs += [("behind", path.equations, path.points) for path in behind]
    with replacing_text(output) as file:
        file.write(",".join(header) + "\n")
        for leg, equations, points in legs:
            for point in points:
                place = equations.nodes(point.free)[:, list(model.axes)].ravel().tolist()
                numbers = map(repr, [*place, *point.tension.tolist()])
                file.write(",".join([leg, repr(point.parameter), str(int(point.stable)), point.kind, *numbers]) + "\n")


def _draw(figure: FilePath, model: Model, loading, sweeps, behind, quantity) -> None:
    from ..output.path_figures import path_figure
    from ..output.plots import write_figure

    label = "p" if loading.rest_length_direction.any() else "p, load factor"
    ways = {"there": "p from {0:g} to {1:g}", "back": "back to {1:g}"}
    named = {ways[name].format(*sweep.parameters[[0, -1]]): sweep for name, sweep in sweeps.items()}
    write_figure(path_figure(model.name, named, behind, quantity, label), figure)


COMMAND = Command("path", "follow the steady states under a slow load, through snaps and back", _arguments, run)
