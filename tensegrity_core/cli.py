"""The command `tensegrity`: one function per subcommand, listed in `COMMANDS`.

A subcommand gets the parsed arguments, prints to stdout and returns an exit code.  A mistake of the user ends with its
message on stderr and exit code 2.  A reader of stdout that has gone (`| head`) ends it quietly.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence

import numpy as np

from . import statics
from .command import Command, Parser, constant_force, model_of, no_arguments, positive, sample_times, scene_argument
from .errors import InputError, TensegrityError
from .experiment_command import COMMAND as EXPERIMENT
from .export import require_writable, write_result
from .fields import METHODS
from .files import write_text
from .inputs import Inputs, held
from .interrupts import program
from .kernel import simulate as run_kernel
from .model import Model
from .modes_command import COMMAND as MODES
from .path_command import COMMAND as PATH
from .result import Result
from .scene import schema_text
from .towers import MOST_STAGES, tower_text


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


# --- check -------------------------------------------------------------------------------------------------------


def check(arguments: argparse.Namespace) -> int:
    """Load a scene, build its model, and say what it is."""
    print(summary(*model_of(arguments.scene)))
    return 0


def summary(model: Model, start: str) -> str:
    """What `tensegrity check` prints: counts, statics, and the start."""
    axes = "".join("xyz"[axis] for axis in model.axes)
    lines = [
        f"{model.name}: {model.description}" if model.description else model.name,
        f"  nodes: {len(model.nodes)} ({len(model.fixed_nodes)} fixed), axes {axes}",
        f"  bars: {len(model.bars)}, strings: {len(model.strings)} ({len(model.nsh_strings)} with an NSH)",
        *_analysis(model),
        f"  start: {start}, {_balance(model)}",
        *_moves(model),
        *_forces(model),
    ]
    return "\n".join(lines)


def _balance(model: Model) -> str:
    """Whether the start is an equilibrium, and then whether it is stable."""
    force, node, equilibrium = statics.unbalanced(model)
    if not equilibrium:
        return f"not an equilibrium: up to {force:.3g} N stay unbalanced, at {model.node_names[node]}"
    stable, lowest = statics.stability(model)
    least = f" (lowest stiffness {lowest:z.4g} N/m)" if np.isfinite(lowest) else " (nothing has a stiffness)"
    return f"largest unbalanced force {force:.1e} N, {'stable' if stable else 'unstable'}{least}"


def _analysis(model: Model) -> list[str]:
    """Rank, self-stress and mechanisms, or why there are none."""
    try:
        found = statics.analyse(model)
    except statics.TooLarge as failure:
        return [f"  no self-stress states and mechanisms: {failure}"]
    return [
        f"  equilibrium matrix: {found.equations} x {found.members}, rank {found.rank}",
        f"  self-stress states: {found.self_stress.shape[1]}, mechanisms: {len(found.mechanisms)}, "
        f"rigid-body motions: {found.rigid_body_motions}",
    ]


LISTED = 500  # nodes or members; of more than these, only the range is shown


def _moves(model: Model) -> list[str]:
    """How far each node is from its given coordinates."""
    way = np.linalg.norm(model.nodes - model.nominal, axis=1)
    if not way.any():
        return ["  all nodes at the given coordinates"]
    if len(way) > LISTED:
        return [f"  moved from the given coordinates: up to {1e3 * way.max():.3f} mm"]
    rows = [f"    {name}: {1e3 * d:.3f} mm" for name, d in zip(model.node_names, way) if d > 0.0]
    return ["  moved from the given coordinates:", *rows]


def _forces(model: Model) -> list[str]:
    """Force of each member at the start, and each string's rest length."""
    force, count = statics.member_forces(model), len(model.strings)
    if len(force) > LISTED:
        kinds = [("strings", force[:count]), ("bars", force[count:])]
        rows = [f"    {kind}: {f.min():z.6g} to {f.max():z.6g} N" for kind, f in kinds if len(f)]
        return ["  member forces (tension positive):", *rows]
    strings = zip(model.string_names, force, model.rest_length)
    bars = zip(model.bar_names, force[count:])
    return [
        "  member forces (tension positive):",
        *(f"    {name}: {f:z.6g} N, rest length {xi:.6g} m" for name, f, xi in strings),
        *(f"    {name}: {f:z.6g} N" for name, f in bars),
    ]


# --- tower -------------------------------------------------------------------------------------------------------


def _tower_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("stages", metavar="STAGES", type=int, help=f"number of stages, 1 to {MOST_STAGES}")
    parser.add_argument("--nsh", action="store_true", help="put the article's NSH into vertical and upper diagonal strings")
    parser.add_argument("--gravity", type=float, help="m/s2 (default 9.81 for one or two stages, else 0)")
    parser.add_argument("--tension", type=float, help="of inner saddle strings, N; all others go with it (default 40)")
    parser.add_argument("--stiffness", type=float, default=5000.0, help="of all strings, N/m (default %(default)g)")
    parser.add_argument("--damping", type=float, default=500.0, help="of all strings, N s/m (default %(default)g)")
    parser.add_argument("--mass", type=float, default=1.0, help="of each bar, kg (default %(default)g)")
    parser.add_argument("--output", metavar="FILE", help="the .toml file to write (default: standard output)")


def tower(arguments: argparse.Namespace) -> int:
    """Write the scene file of a tower of so many stages."""
    output = arguments.output and require_writable(arguments.output, (".toml",))
    options = {name: getattr(arguments, name) for name in ("gravity", "tension", "stiffness", "damping", "mass")}
    text = tower_text(arguments.stages, arguments.nsh, **options)
    if not output:
        sys.stdout.write(text)
        return 0
    write_text(output, text)
    print(f"{3 * arguments.stages} bars written to {output}; see its equilibrium with: tensegrity check {output}")
    return 0


# --- schema ------------------------------------------------------------------------------------------------------


def schema(arguments: argparse.Namespace) -> int:
    """Print the JSON schema of scene files."""
    sys.stdout.write(schema_text())
    return 0


# --- simulate, animate -------------------------------------------------------------------------------------------

def _run_arguments(parser: argparse.ArgumentParser) -> None:
    """What every subcommand that simulates takes."""
    parser.usage = "%(prog)s SCENE [options]"  # SCENE first: --force takes all that follows it
    scene_argument(parser)
    parser.add_argument(
        "--force",
        metavar="NODE.AXIS=N",
        nargs="+",
        action="extend",
        default=[],
        help="constant external forces in N on free nodes, each component once, such as n4.z=45 n5.x=-10",
    )
    parser.add_argument("--duration", type=float, default=5.0, help="simulated time, s (default %(default)s)")
    parser.add_argument("--method", choices=METHODS, default="auto", help="integration method (default %(default)s)")
    parser.add_argument("--tolerance", type=float, default=1e-10, help="error per step (default %(default)s)")


def _simulate_arguments(parser: argparse.ArgumentParser) -> None:
    _run_arguments(parser)
    step = "time between samples, s (not the integrator's step; default %(default)s)"
    parser.add_argument("--step", type=float, default=0.01, help=step)
    parser.add_argument("--output", metavar="FILE", help="write the series to this .csv or .npz file")


def _animate_arguments(parser: argparse.ArgumentParser) -> None:
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
    from .plots import animate as write_film  # Matplotlib takes a second to import

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


COMMANDS = (
    Command("check", "check a scene file and summarise its structure", scene_argument, check),
    Command("tower", "write the scene file of a tower of any number of stages", _tower_arguments, tower),
    Command("simulate", "simulate a scene under constant forces", _simulate_arguments, simulate),
    Command("animate", "film a scene under constant forces as a GIF", _animate_arguments, animate),
    EXPERIMENT,
    PATH,
    MODES,
    Command("schema", "print the JSON schema of scene files", no_arguments, schema),
)

if __name__ == "__main__":
    program(main)
