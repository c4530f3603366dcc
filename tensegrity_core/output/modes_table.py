"""Modes as a text, as data, and as a CSV file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from .. import statics
from ..equilibria.modes import Mode, free_motions
from ..files import replacing_text
from ..model import Model


def summary(model: Model, found: list[Mode], count: int, force: np.ndarray | None = None) -> str:
    """What `tensegrity modes` prints: directions that nothing resists by name, then a line per mode, the longest-lived
    first."""
    freedoms = free_motions(model)
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


def write(output: Path, model: Model, found: list[Mode]) -> None:
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


def data(model: Model, found: list[Mode], force: np.ndarray | None = None) -> dict[str, Any]:
    """All modes, as JSON takes them: Hz, 1/s."""
    off, node, equilibrium = statics.unbalanced(model, force)
    modes = []
    for mode in found:
        node_moved, axis = divmod(int(np.argmax(np.abs(mode.shape))), 3)
        modes.append(
            {
                "eigenvalue": [mode.eigenvalue.real, mode.eigenvalue.imag],
                "frequency": mode.frequency,
                "damping_ratio": mode.damping_ratio,
                "decay_rate": mode.decay_rate,
                "moves_most": f"{model.node_names[node_moved]}.{'xyz'[axis]}",
                "nothing_resists": mode.neutral or None,
            }
        )
    balance = {"equilibrium": bool(equilibrium), "unbalanced_force": float(off), "at": model.node_names[node]}
    return {"scene": model.name, **balance, "modes": modes}
