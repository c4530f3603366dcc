"""The subcommands `tensegrity simulate` and `tensegrity animate`: a run under constant forces, as a table or as a film."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError
from ..fields import METHODS
from .options import Debug, Duration, Force, InputFile, Json, Method, SampleStep, Scene, Tolerance
from .program import tell

if TYPE_CHECKING:
    import numpy as np

    from ..model import Inputs, Model, Result
    from ..progress import Told

#: Width and height of a film, pixels.
SMALLEST, LARGEST = 100, 2000


def simulate(
    scene: Scene,
    force: Force = None,
    inputs: InputFile = None,
    duration: Duration = 5.0,
    step: SampleStep = 0.01,
    method: Method = "auto",
    tolerance: Tolerance = 1e-10,
    output: Annotated[
        str | None, typer.Option(metavar="FILE", help="Write the series to this .csv, .nc (NetCDF), .parquet or .npz file.")
    ] = None,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Simulate a scene under forces and other inputs, say how it went, and write the series."""
    from ..output import run_summary
    from ..output.export import require_writable, write_result
    from ..progress import Bar
    from .words import model_of, sample_times

    path = require_writable(output, (".csv", ".nc", ".parquet", ".npz")) if output else None
    times = sample_times(duration, step)
    with Bar(f"reading {scene}") as bar:
        model, _ = model_of(scene, bar)
        result, _ = _run(model, times, force, method, tolerance, inputs, bar.begin(f"simulating {model.name}"))
        bar.begin(f"writing {path}")
        if path and path.suffix.lower() in (".csv", ".npz"):
            write_result(model, result, path, bar)
        elif path:
            from ..output import series

            series.write(series.dataset(model, result, method=method, tolerance=tolerance), path)
    tell(run_summary.data(model, result) if json else run_summary.end_of_run(model, result))
    if path and not json:
        print(f"  series written to {path}")


def animate(
    scene: Scene,
    output: Annotated[str, typer.Option(metavar="FILE", help="The .gif file to write.")],
    force: Force = None,
    duration: Duration = 5.0,
    speed: Annotated[float, typer.Option(metavar="X", help="Simulated s per s of film.")] = 1.0,
    fps: Annotated[int, typer.Option(metavar="N", help="Frames per second of film, up to 50.")] = 20,
    size: Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="Of the film, pixels.")] = "480x480",
    names: Annotated[bool, typer.Option(help="Names of nodes, strings and bars, where there is room.")] = True,
    method: Method = "auto",
    tolerance: Tolerance = 1e-10,
    debug: Debug = False,
) -> None:
    """Simulate a scene under constant forces and film it as a GIF."""
    import numpy as np

    from ..output.export import require_writable
    from ..output.film import animate as write_film
    from ..progress import Bar
    from .words import model_of, positive, sample_times

    path = require_writable(output, (".gif",))
    if not 1 <= fps <= 50:
        raise InputError(f"--fps = {fps} is out of range; give a whole number from 1 to 50")
    pixels = _size(size)
    times = sample_times(duration, positive("--speed", speed) / fps)
    with Bar(f"reading {scene}") as bar:
        model, _ = model_of(scene, bar)
        result, inputs = _run(model, times, force, method, tolerance, told=bar.begin(f"simulating {model.name}"))
        forces = np.concatenate((inputs.force, inputs.force[-1:]))
        write_film(model, result, path, fps, forces, pixels, names, bar.begin(f"drawing {len(times)} frames"))
    print(f"{model.name}: film of {times[-1]:g} s in {len(times)} frames written to {path}")


def _size(text: str) -> tuple[int, int]:
    """Width and height out of "480x360", pixels.  Raises InputError."""
    found = re.fullmatch(r"(\d{1,5})[x×](\d{1,5})", text.strip().lower())
    width, height = (int(part) for part in found.groups()) if found else (0, 0)
    if not (SMALLEST <= width <= LARGEST and SMALLEST <= height <= LARGEST):
        raise InputError(f"--size = {text!r} is no size; give width and height from {SMALLEST} to {LARGEST} pixels, as 640x480")
    return width, height


def _run(
    model: Model,
    times: np.ndarray,
    force: list[str] | None,
    method: str,
    tolerance: float,
    file: str | None = None,
    told: Told | None = None,
) -> tuple[Result, Inputs]:
    """file: of inputs; a constant force that is named on the command line, too, takes the place of the file's."""
    from .. import kernel
    from ..model.signals import driven
    from .words import constant_forces, one_of, positive

    one_of("--method", method, METHODS)
    signals = constant_forces(model, force or [])
    if file:
        from ..api import read_inputs

        signals = read_inputs(file, model) | signals
    inputs = driven(model, times, signals)
    return kernel.simulate(model, inputs, method, positive("--tolerance", tolerance), told=told), inputs
