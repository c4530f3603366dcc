"""Films of a structure's motion, as GIFs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from ..errors import InputError
from ..files import replacing
from ..model import Model, Result
from ..progress import Told, nobody
from .drawing import NAMED_ROOM, ROOM, Drawing, arrow_scale, frame, new_axes, slack_strings
from .plots import new_figure

#: Height of the line below a film that says the time, pixels.
CLOCK = 30.0


def write_frames(figure: Figure, path: Path, count: int, show, frames_per_second: int, told: Told = nobody) -> None:
    """Write a looping GIF of `count` frames; show(i) draws frame i on the figure; told: gets the part that is drawn, 0 to 1.

    The file appears whole or not at all.  All frames share one palette, so that Pillow stores only what changes from
    frame to frame; Matplotlib's PillowWriter gives each frame a palette of its own, which makes larger files.
    """
    pictures = []
    for i in range(count):
        show(i)
        canvas: Any = figure.canvas  # of Agg, see new_figure
        canvas.draw()
        pictures.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
        told((i + 1) / count)
    palette = _palette(pictures)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    with replacing(path) as file:
        frames[0].save(file, "GIF", save_all=True, append_images=frames[1:], duration=round(1000 / frames_per_second), loop=0)


def _palette(pictures: list[Image.Image], samples: int = 8, colours: int = 64) -> Image.Image:
    """A palette for a series of pictures, from some of them side by side."""
    chosen = pictures[:: max(1, len(pictures) // samples)]
    sheet = Image.new("RGB", (chosen[0].width, chosen[0].height * len(chosen)))
    for i, picture in enumerate(chosen):
        sheet.paste(picture, (0, i * picture.height))
    palette = sheet.quantize(colours)
    entries = np.array(palette.getpalette()).reshape(-1, 3)
    entries[entries.min(axis=1) > 244] = 255  # Pillow takes any of them for white
    palette.putpalette(entries.ravel().tolist())
    return palette


def animate(
    model: Model,
    result: Result,
    path: Path,
    frames_per_second: int = 20,
    force: np.ndarray | None = None,
    size: tuple[int, int] = (480, 480),
    names: bool = False,
    told: Told = nobody,
) -> None:
    """Write the motion of a result as a GIF, one frame per communication point.

    force: (K+1, N, 3) N, drawn as arrows; None: none; size: width and height, pixels; names: write those of nodes, strings and
    bars, where there is room; told: see write_frames.  Raises InputError where `path` does not end in .gif.
    """
    path = Path(path)
    if path.suffix.lower() != ".gif":
        raise InputError(f"output = {str(path)!r} does not end in .gif; name a GIF file")
    figure = new_figure(*size)
    foot = min(0.2, CLOCK / size[1])
    axes = new_axes(figure, model, (0.0, foot, 1.0, 1.0 - foot))
    drawing, slack = Drawing(axes, model), slack_strings(result, model)
    scale = 0.0 if force is None else arrow_scale(model, force)
    tips = result.position if force is None else result.position + scale * force
    seen = np.vstack((result.position.reshape(-1, 3), tips.reshape(-1, 3), drawing.floor))
    frame(axes, model, seen, NAMED_ROOM if names else ROOM)
    if names:
        drawing.name(result.position[0])
    clock = figure.text(0.02, 0.5 * foot, "", family="monospace", va="center", fontsize=min(10.0, 0.02 * size[0]))

    def show(k):
        push = None if force is None else force[k]
        drawing.move(result.position[k], slack[k], result.snapped[k], push, scale)
        clock.set_text(f"{model.name}  t = {result.times[k]:.2f} s")

    write_frames(figure, path, len(result.times), show, frames_per_second, told)
