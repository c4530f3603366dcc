"""Draws docs/scenes.gif, the picture in the README: `python docs/draw_scenes.py [FILE]`.

The three scenes with NSH under forces that pull their top nodes up and let them go again, period after
period.  What is shown is the last period, so that the picture loops.
"""

from __future__ import annotations

import dataclasses
import sys
from pathlib import Path

import numpy as np

from tensegrity_core.kernel import simulate
from tensegrity_core.model import Model, grid, held
from tensegrity_core.output.drawing import BAR, ELEVATION, NAMED_ROOM, NSH, Drawing, frame, new_axes, slack_strings
from tensegrity_core.output.film import write_frames
from tensegrity_core.output.plots import new_figure
from tensegrity_core.scene import load_scene
from tensegrity_core.statics import build_model

LEGEND = "\u25cb beam of a negative stiffness honeycomb    \u25cf the same beam, snapped"
#: Scene, what stands below it, and the azimuth from which it is seen, degrees.
SCENES = (
    ("two_bar_nsh", "two bars, in a plane", 0.0),
    ("three_bar_nsh", "three bars", -46.0),
    ("six_bar_nsh", "six bars", 8.0),
)

#: The load: every top node is pulled up, from nothing to PEAK (N) over RAMP (s), then let go until PERIOD (s) is over.
PEAK, RAMP, PERIOD = 64.0, 2.8, 4.0
#: d of all strings, N s/m: the article's lowest, so that the release is seen to swing.
DAMPING = 50.0
FRAMES_PER_SECOND = 20
WIDTH, HEIGHT = 960, 400


def load(model: Model, t: float) -> np.ndarray:
    """(N, 3) external forces at time t, N."""
    force = np.zeros((len(model.nodes), 3))
    phase = t % PERIOD
    force[model.nodes[:, 2] > model.nodes[:, 2].max() - 0.01, 2] = PEAK * phase / RAMP if phase < RAMP else 0.0
    return force


def last_period(model: Model):
    """The motion over two periods; the first one lets the start die away.

    Returns the result, the forces (K+1, N, 3) N, and the row at which the second period begins.
    """
    times = grid(2.0 * PERIOD, 1.0 / FRAMES_PER_SECOND)
    inputs = held(model, times, force=lambda t: load(model, t))
    return simulate(model, inputs), np.concatenate((inputs.force[:1], inputs.force)), len(times) // 2


def main(path: Path) -> None:
    """Write the picture."""
    figure = new_figure(WIDTH, HEIGHT)
    scenes = []
    for i, (name, label, azimuth) in enumerate(SCENES):
        model = build_model(load_scene(name))
        model = dataclasses.replace(model, damping=np.full(len(model.strings), DAMPING))
        result, force, first = last_period(model)
        axes = new_axes(figure, model, (i / 3.0, 0.08, 1.0 / 3.0, 0.85))
        if len(model.axes) == 3:
            axes.view_init(elev=ELEVATION, azim=azimuth)
        scale = 0.25 * float(np.ptp(model.nodes[:, 2])) / PEAK
        drawing = Drawing(axes, model)
        frame(axes, model, np.vstack([*result.position, *(result.position + scale * force), drawing.floor]), NAMED_ROOM)
        drawing.name(result.position[first], members=False)
        figure.text((i + 0.5) / 3.0, 0.035, label, ha="center", fontsize=10, color=BAR)
        scenes.append((drawing, result, slack_strings(result, model), force, scale, first))
    figure.text(0.015, 0.95, LEGEND, fontsize=10, color=NSH)
    clock = figure.text(0.985, 0.95, "", ha="right", fontsize=10, color=BAR)

    def show(k: int) -> None:
        for drawing, result, slack, force, scale, first in scenes:
            row = first + k
            drawing.move(result.position[row], slack[row], result.snapped[row], force[row], scale)
        pull = force[first + k].max()
        clock.set_text(f"{pull:.0f} N on each top node")

    write_frames(figure, path, round(PERIOD * FRAMES_PER_SECOND), show, FRAMES_PER_SECOND)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("scenes.gif"))
