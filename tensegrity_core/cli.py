"""The command `tensegrity`: one function per subcommand, listed in `COMMANDS`.

A subcommand gets the parsed arguments, prints to stdout and returns an exit code.  A mistake of the user ends with its
message on stderr and exit code 2.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from typing import Callable, NamedTuple

import numpy as np

from . import statics
from .errors import TensegrityError
from .model import Model
from .scene import builtin_scenes, load_scene, schema_text


class Command(NamedTuple):
    """A subcommand: its name, one line of help, what declares its arguments, and what runs it."""

    name: str
    help: str
    arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code."""
    parser = argparse.ArgumentParser(prog="tensegrity", description="Tensegrity dynamics with NSH.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    for command in COMMANDS:
        subparser = commands.add_parser(command.name, help=command.help, description=command.help)
        command.arguments(subparser)
        subparser.set_defaults(run=command.run)
    chosen = parser.parse_args(arguments)
    try:
        return chosen.run(chosen)
    except TensegrityError as error:
        print(error, file=sys.stderr)
        return 2


def _scene_argument(parser: argparse.ArgumentParser) -> None:
    names = ", ".join(builtin_scenes())
    parser.add_argument("scene", metavar="SCENE", help=f"path of a scene file (.toml), or one of: {names}")


def _no_arguments(parser: argparse.ArgumentParser) -> None:
    pass


# --- check -------------------------------------------------------------------------------------------------------


def check(arguments: argparse.Namespace) -> int:
    """Load a scene, build its model, and say what it is."""
    scene = load_scene(arguments.scene)
    print(summary(statics.build_model(scene), scene.start))
    return 0


def summary(model: Model, start: str) -> str:
    """What `tensegrity check` prints: counts, statics, and the start."""
    analysis = statics.analyse(model)
    stiffness = statics.tangent_stiffness(model)
    unbalanced = np.abs(statics.residual(model)).max(initial=0.0)
    axes = "".join("xyz"[axis] for axis in model.axes)
    lines = [
        f"{model.name}: {model.description}" if model.description else model.name,
        f"  nodes: {len(model.nodes)} ({len(model.fixed_nodes)} fixed), axes {axes}",
        f"  bars: {len(model.bars)}, strings: {len(model.strings)} ({len(model.nsh_strings)} with an NSH)",
        f"  equilibrium matrix: {analysis.equations} x {analysis.members}, rank {analysis.rank}",
        f"  self-stress states: {analysis.self_stress.shape[1]}, mechanisms: {len(analysis.mechanisms)}, "
        f"rigid-body motions: {analysis.rigid_body_motions}",
        f"  start: {start}, largest unbalanced force {unbalanced:.1e} N{_stability(stiffness)}",
        *_moves(model),
        *_forces(model),
    ]
    return "\n".join(lines)


def _stability(stiffness: np.ndarray) -> str:
    if not stiffness.size:
        return ""
    kind = "stable" if statics.is_stable(stiffness) else "unstable"
    return f", {kind} (lowest stiffness {stiffness[0]:.4g} N/m)"


def _moves(model: Model) -> list[str]:
    """How far each node is from its given coordinates."""
    way = np.linalg.norm(model.nodes - model.nominal, axis=1)
    if not way.any():
        return ["  all nodes at the given coordinates"]
    rows = [f"    {name}: {1e3 * d:.3f} mm" for name, d in zip(model.node_names, way) if d > 0.0]
    return ["  moved from the given coordinates:", *rows]


def _forces(model: Model) -> list[str]:
    """Force of each member at the start, and each string's rest length."""
    force = statics.member_forces(model)
    strings = zip(model.string_names, force, model.rest_length)
    bars = zip(model.bar_names, force[len(model.strings) :])
    return [
        "  member forces (tension positive):",
        *(f"    {name}: {f:.6g} N, rest length {xi:.6g} m" for name, f, xi in strings),
        *(f"    {name}: {f:.6g} N" for name, f in bars),
    ]


# --- schema ------------------------------------------------------------------------------------------------------


def schema(arguments: argparse.Namespace) -> int:
    """Print the JSON schema of scene files."""
    sys.stdout.write(schema_text())
    return 0


COMMANDS = (
    Command("check", "check a scene file and summarise its structure", _scene_argument, check),
    Command("schema", "print the JSON schema of scene files", _no_arguments, schema),
)

if __name__ == "__main__":
    sys.exit(main())
