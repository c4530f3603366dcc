"""Draws a scene at its start: the FMU's icon."""

from __future__ import annotations

import io

from tensegrity_core.model import Model
from tensegrity_core.output.drawing import draw, new_axes
from tensegrity_core.output.plots import new_figure

#: Where an FMU of FMI 3.0 has it.
ICON = "terminalsAndIcons/icon.png"


def model_png(model: Model, pixels: int = 480) -> bytes:
    """A square PNG; the same model gives the same bytes under the same version of Matplotlib."""
    figure = new_figure(pixels, pixels)
    draw(new_axes(figure, model), model, names=True)
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()
