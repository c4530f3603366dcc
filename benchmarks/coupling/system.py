"""The coupled system: three winches raise the top nodes of three_bar, by the heights that a controller measures.

``python -m benchmarks.coupling.system`` writes height_control.ssp: see `main`.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import NamedTuple

from fmu_src.packing.native_fmu import pack_native_fmu
from fmu_src.packing.ssp import VERSIONS, System, Wire, write_ssp
from tensegrity_core.errors import TensegrityError, shown
from tensegrity_core.files import scratch
from tensegrity_core.model import Model
from tensegrity_core.scene import load_scene
from tensegrity_core.statics import build_model

from . import blocks

NAME, SCENE = "height_control", "three_bar"
#: Top node -> the top string that lifts it most when it is shortened.
PAIRS = {"n4": "s6", "n5": "s4", "n6": "s5"}


class Loop(NamedTuple):
    """time_constant, s, and rate_limit, m/s, of the winches; gain, integral_gain, 1/s, and filter_time, s, of the controllers;
    raised: by how much the targets lie above the start, m; load: weights that n4, n5 and n6 carry from the start, N (they keep
    all strings taut)."""

    time_constant: float = 0.1
    rate_limit: float = 0.1
    gain: float = 2.0
    integral_gain: float = 10.0
    filter_time: float = 0.01
    raised: float = 0.02
    load: tuple[float, float, float] = (12.0, 10.0, 10.0)


LOOP = Loop()


class Plan(NamedTuple):
    """model: of the structure; start: unit -> variable -> value; wires; units in the order of the flow of data."""

    model: Model
    start: dict[str, dict[str, float]]
    wires: tuple[Wire, ...]

    @property
    def units(self) -> tuple[str, ...]:
        return tuple(self.start)

    @property
    def heights(self) -> tuple[tuple[str, str], ...]:
        """(unit, output): what is controlled."""
        return tuple(("structure", f"{node}.z") for node in PAIRS)


def structure() -> Model:
    return build_model(load_scene(SCENE))


def plan(loop: Loop = LOOP) -> Plan:
    """The system with these numbers."""
    model = structure()
    height = {node: float(model.nodes[model.node_names.index(node), 2]) for node in PAIRS}
    rest = {string: float(model.rest_length[model.string_names.index(string)]) for string in PAIRS.values()}
    start: dict[str, dict[str, float]] = {
        "controller": {
            "gain": loop.gain,
            "integral_gain": loop.integral_gain,
            "filter_time": loop.filter_time,
        }
    }
    wires = []
    for i, (node, string) in enumerate(PAIRS.items(), 1):
        winch = f"winch_{string}"
        start["controller"] |= {
            f"height[{i}]": height[node],
            f"target[{i}]": height[node] + loop.raised,
            f"neutral[{i}]": rest[string],
        }
        start[winch] = {
            "start_rest_length": rest[string],
            "time_constant": loop.time_constant,
            "rate_limit": loop.rate_limit,
            "command": rest[string],
        }
        wires += [
            Wire("structure", f"{node}.z", "controller", f"height[{i}]"),
            Wire("controller", f"command[{i}]", winch, "command"),
            Wire(winch, "rest_length", "structure", f"{string}.rest_length"),
            Wire(winch, "rest_length_rate", "structure", f"{string}.rest_length_rate"),
        ]
    start["structure"] = {f"{node}.force.z": -load for node, load in zip(PAIRS, loop.load)}
    return Plan(model, start, tuple(wires))


def pack(folder: Path) -> dict[str, Path]:
    """The FMU of each unit: three files in a folder.  Raises TensegrityError, or RuntimeError without a C compiler."""
    files = {
        "controller": blocks.pack(blocks.CONTROLLER, folder / "controller.fmu"),
        "structure": pack_native_fmu(structure(), folder / f"{SCENE}.fmu"),
    }
    winch = blocks.pack(blocks.WINCH, folder / "winch.fmu")
    return {name: files.get(name, winch) for name in plan().units}


def as_ssp(fmus: dict[str, Path], stop: float) -> System:
    """The system for an SSP archive; stop: of its default experiment, s."""
    this = plan()
    return System(NAME, fmus, this.wires, this.start, stop)


def main(arguments: list[str] | None = None) -> int:
    """Write the system as an SSP archive."""
    parser = argparse.ArgumentParser(description="Write the height control of three_bar as an SSP archive.")
    parser.add_argument("--output", type=Path, default=Path(f"{NAME}.ssp"), help="the file; %(default)s")
    parser.add_argument("--ssp", choices=VERSIONS, default=VERSIONS[0], help="version of SSP; %(default)s")
    parser.add_argument("--stop-time", type=float, default=2.0, help="of the default experiment, s; %(default)s")
    options = parser.parse_args(arguments)
    try:
        with scratch() as folder:
            path = write_ssp(options.output, as_ssp(pack(folder), options.stop_time), options.ssp)
    except (TensegrityError, OSError, RuntimeError) as error:
        print(f"error: {shown(str(error))}", file=sys.stderr)
        return 2
    print(f"wrote {path}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
