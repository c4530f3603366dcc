"""The subcommands `tensegrity simulate` and `tensegrity animate`: a run under a constant force, as a table or as a film."""

from __future__ import annotations

import argparse

import numpy as np

from ..errors import InputError
from ..fields import METHODS
from ..kernel import simulate as run_kernel
from ..model import Inputs, Model, Result, held
from ..output.export import require_writable, write_result
from .common import constant_force, force_argument, model_of, positive, sample_times, scene_argument


def _run_arguments(parser: argparse.ArgumentParser) -> None:
    """What every subcommand that simulates takes."""
    parser.usage = "%(prog)s SCENE [options]"  # SCENE first: --force takes all that follows it
    scene_argument(parser)
    force_argument(parser, "constant external forces in N on free nodes, each component once, such as n4.z=45 n5.x=-10")
    parser.add_argument("--duration", type=float, default=5.0, help="simulated time, s (default %(default)s)")
    parser.add_argument("--method", choices=METHODS, default="auto", help="integration method (default %(default)s)")
    parser.add_argument("--tolerance", type=float, default=1e-10, help="error per step (default %(default)s)")


def simulate_arguments(parser: argparse.ArgumentParser) -> None:
    _run_arguments(parser)
    step = "time between samples, s (not the integrator's step; default %(default)s)"
    parser.add_argument("--step", type=float, default=0.01, help=step)
    parser.add_argument("--output", metavar="FILE", help="write the series to this .csv or .npz file")


def animate_arguments(parser: argparse.ArgumentParser) -> None:
    _run_arguments(parser)
    parser.add_argument("--speed", type=float, default=1.0, help="simulated s per s of film (default %(default)s)")
    parser.add_argument("--fps", type=int, default=20, help="frames per second of film, up to 50 (default %(default)s)")
    parser.add_argument("--output", metavar="FILE", required=True, help="the .gif file to write")


def simulate(arguments: argparse.Namespace) -> int:
    """Simulate a scene under constant forces, say how it went, and write the series."""
    output = arguments.output and require_writable(arguments.output, (".csv", ".npz"))
    times = sample_times(arguments.duration, arguments.step)
    model, _ = model_of(arguments.scene)
    result, _ = _run(model, times, arguments)
    if output:
        write_result(model, result, output)
    print(end_of_run(model, result))
    if output:
        print(f"  series written to {output}")
    return 0


def animate(arguments: argparse.Namespace) -> int:
    """Simulate a scene under constant forces and film it."""
    from ..output.plots import animate as write_film  # Matplotlib takes a second to import

    output = require_writable(arguments.output, (".gif",))
    if not 1 <= arguments.fps <= 50:
        raise InputError(f"--fps = {arguments.fps} is out of range; give a whole number from 1 to 50")
    speed = positive("--speed", arguments.speed)
    times = sample_times(arguments.duration, speed / arguments.fps)
    model, _ = model_of(arguments.scene)
    result, inputs = _run(model, times, arguments)
    force = np.concatenate((inputs.force, inputs.force[-1:]))
    write_film(model, result, output, arguments.fps, force)
    print(f"{model.name}: film of {times[-1]:g} s in {len(times)} frames written to {output}")
    return 0


def _run(model: Model, times: np.ndarray, arguments: argparse.Namespace) -> tuple[Result, Inputs]:
    force = constant_force(model, arguments.force)
    inputs = held(model, times, force=lambda t: force)
    return run_kernel(model, inputs, arguments.method, positive("--tolerance", arguments.tolerance)), inputs


def end_of_run(model: Model, result: Result) -> str:
    """What `tensegrity simulate` prints: the cost of the run, and where it ended."""
    stats, places = result.stats, zip(model.node_names, result.position[-1, :, list(model.axes)].T)
    rows = [f"    {name}: {', '.join(f'{x:z.6f}' for x in place)}" for name, place in places]
    forces = [f"    {name}: {force:z.6g}" for name, force in zip(model.string_names, result.string_force[-1])]
    return "\n".join(
        [
            f"{model.name}: {result.times[-1]:g} s in {stats['steps']} steps, {len(result.transitions)} transitions, "
            f"energy ledger closed to {result.ledger_error():.1e}",
            f"  nodes at the end, {', '.join('xyz'[axis] for axis in model.axes)} in m:",
            *rows,
            "  string forces at the end in N:",
            *forces,
        ]
    )
