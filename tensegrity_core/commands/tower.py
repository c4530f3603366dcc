"""The subcommand `tensegrity tower`: writes the scene of a tower."""

from __future__ import annotations

import argparse
import sys

from ..files import write_text
from ..output.export import require_writable
from ..scene.towers import MOST_STAGES, tower_text


def tower_arguments(parser: argparse.ArgumentParser) -> None:
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
