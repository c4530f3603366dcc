"""The subcommand `tensegrity modes`: frequencies, damping and shapes of small motions."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from .. import statics
from ..equilibria import steady_states
from ..equilibria.loading import Loading
from ..equilibria.modes import Mode, modes
from ..errors import InputError
from ..files import replacing_text
from ..model import Model
from ..output.export import require_writable
from .common import Command, constant_force, force_argument, model_of, scene_argument

SHOWN = 12  # modes that are printed


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.usage = "%(prog)s SCENE [options]"
    scene_argument(parser)
    force_argument(
        parser, "constant external forces in N: modes about the steady state that they reach slowly, such as n4.z=45"
    )
    parser.add_argument("--undamped", action="store_true", help="leave the dampers out")
    parser.add_argument("--count", type=int, default=SHOWN, help="modes to print (default %(default)s)")
    parser.add_argument("--output", metavar="FILE", help="write all modes with their shapes to this .csv file")
    parser.add_argument("--figure", metavar="FILE", help="draw the longest-lived modes into this .png or .svg file")


def run(arguments: argparse.Namespace) -> int:
    """Say how a scene moves about its steady state, and write and draw it."""
    output = arguments.output and require_writable(arguments.output, (".csv",))
    figure = arguments.figure and require_writable(arguments.figure, (".png", ".svg"))
    if arguments.count < 1:
        raise InputError(f"--count = {arguments.count} is out of range; give a whole number from 1 on")
    model, force = steady(model_of(arguments.scene)[0], arguments.force)
    found = modes(model, force, damped=not arguments.undamped)
    if output:
        _write(output, model, found)
    if figure:
        from ..output.modes_figures import modes_figure  # Matplotlib takes a second to import
        from ..output.plots import write_figure

        write_figure(modes_figure(model, [mode for mode in found if not mode.neutral]), figure)
    print(summary(model, found, arguments.count, force))
    for path in (output, figure):
        if path:
            print(f"  written: {path}")
    return 0


def steady(model: Model, texts: list[str]) -> tuple[Model, np.ndarray]:
    """The model at the steady state that the forces reach slowly, and the forces (N, 3), N."""
    force = constant_force(model, texts)
    if not force.any():
        return model, force
    if model.memories:  # a path would not know where they come from
        return statics.settle(model, force), force
    loading = Loading(model, force)
    sweep = steady_states.load_sweep(loading, [0.0, 1.0])
    return loading.model_at(1.0, sweep.nodes[-1]), force


def summary(model: Model, found: list[Mode], count: int, force: np.ndarray | None = None) -> str:
    """What `tensegrity modes` prints: directions that nothing resists by name, then a line per mode, the longest-lived
    first."""
    freedoms = len(model.free_nodes) * len(model.axes) - len(model.bars)
    neutral, found = [mode.neutral for mode in found if mode.neutral], [mode for mode in found if not mode.neutral]
    lines = [f"{model.name}: {freedoms} degrees of freedom"]
    off, node, equilibrium = statics.unbalanced(model, force)
    if not equilibrium:
        lines.append(
            f"  about a state that is not an equilibrium: up to {off:.3g} N stay unbalanced, at {model.node_names[node]}"
        )
    if neutral:
        lines.append(f"  nothing resists {len(neutral)} of them: {', '.join(_counted(neutral))}")
    oscillating = sum(mode.oscillates for mode in found)
    rest = len(found) - oscillating
    if found:
        aside = f", {rest} that do not (an overdamped direction has two)" if rest else ""
        lines.append(f"  {oscillating} modes that oscillate{aside}; the longest-lived first")
        lines.append("   mode  frequency, Hz  damping ratio  decay rate, 1/s  moves most")
    for i, mode in enumerate(found[:count], 1):
        node, axis = divmod(int(np.argmax(np.abs(mode.shape))), 3)
        frequency = f"{mode.frequency:.6g}" if mode.oscillates else "-"
        ratio = f"{mode.damping_ratio:z.6g}" if mode.oscillates else "-"
        place = f"{model.node_names[node]}.{'xyz'[axis]}"
        lines.append(f"  {i:5d}  {frequency:>13}  {ratio:>13}  {mode.decay_rate:>z15.6g}  {place}")
    if len(found) > count:
        lines.append(f"  and {len(found) - count} that die out sooner")
    return "\n".join(lines)


def _counted(names: list[str]) -> list[str]:
    """Names, those that come more than once with their number."""
    counts = {name: names.count(name) for name in names}
    return [
        name if n == 1 else f"{n} {name.replace('motion', 'motions').replace('mechanism', 'mechanisms')}"
        for name, n in counts.items()
    ]


def _write(output: Path, model: Model, found: list[Mode]) -> None:
    """One row per mode: lambda (1/s), frequencies (Hz), damping ratio, decay rate (1/s), whether nothing resists it (1 or 0),
    shape (real and imaginary part)."""
    places = [f"{model.node_names[i]}.{'xyz'[axis]}" for i in range(len(model.nodes)) for axis in model.axes]
    header = ["mode", "lambda.re", "lambda.im", "frequency", "natural_frequency", "damping_ratio", "decay_rate", "neutral"]
    header += [f"{place}.{part}" for place in places for part in ("re", "im")]
    with replacing_text(output) as file:
        file.write(",".join(header) + "\n")
        for i, mode in enumerate(found, 1):
            shape = mode.shape[:, list(model.axes)].ravel()
            numbers = [mode.eigenvalue.real, mode.eigenvalue.imag, mode.frequency, mode.natural_frequency]
            numbers += [
                mode.damping_ratio,
                mode.decay_rate,
                bool(mode.neutral),
                *np.column_stack([shape.real, shape.imag]).ravel(),
            ]
            file.write(",".join([str(i), *(repr(float(x)) for x in numbers)]) + "\n")


COMMAND = Command("modes", "frequencies, damping and shapes of small motions", _arguments, run)
