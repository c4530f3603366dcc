"""The subcommand `tensegrity view`: writes the page that is the model."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..errors import InputError
from .options import Debug, Duration, Force, suggested

if TYPE_CHECKING:
    import numpy as np

    from ..model import Model, Result
    from ..progress import Bar

#: Time between instants of a run that is made to be played back, s.
STEP = 0.01
HELP = "A scene (file or built-in name), an FMU (.fmu), or a run that simulate or run wrote (.csv, .nc, .parquet, .npz)."


def view(
    what: Annotated[str, typer.Argument(metavar="SCENE|FMU|RESULT", help=HELP, autocompletion=suggested)],
    live: Annotated[
        bool | None,
        typer.Option(help="The model runs in the page, or a run is played back.", show_default="live, but of a RESULT"),
    ] = None,
    scene: Annotated[str | None, typer.Option(metavar="SCENE", help="The scene that a RESULT is a run of.")] = None,
    force: Force = None,
    duration: Duration = 5.0,
    output: Annotated[str | None, typer.Option(metavar="FILE", help="The .html file to write (default: NAME.html).")] = None,
    show: Annotated[bool, typer.Option("--open", help="Show it in the browser, too.")] = False,
    debug: Debug = False,
) -> None:
    """Write a web page in which a structure moves, and can be pulled.  It needs no network."""
    from ..output.export import require_writable
    from ..output.page import parts, write_page
    from ..progress import Bar

    if output:
        require_writable(output, (".html",))
    with Bar(f"reading {what}") as bar:
        model, result, constant = _shown(what, live, scene, force, duration, bar)
        bar.begin("building the page")
        parts(bar.print, bar)
    name = Path(what).stem if result is not None and scene else model.name
    path = require_writable(output or f"{name}.html", (".html",))
    size = write_page(path, model, result, constant)
    happens = "the model runs in it" if result is None else f"it plays {result.times[-1] - result.times[0]:g} s"
    print(f"{model.name}: page written to {path} ({size / 1e6:.1f} MB, needs no network); {happens}")
    if show:
        typer.launch(path.resolve().as_uri())


def _shown(
    what: str, live: bool | None, scene: str | None, force: list[str] | None, duration: float, bar: Bar
) -> tuple[Model, Result | None, np.ndarray | None]:
    """The model, its run where that is played back, and constant forces (N, 3) N.  Raises InputError."""
    from ..kernel import simulate
    from ..model import held
    from ..output.page import model_of_fmu
    from ..output.page.series import SUFFIXES, result_of_file
    from .words import constant_force, model_of, sample_times

    suffix = Path(what).suffix.lower()
    if suffix in (*SUFFIXES, ".fmu") and not os.path.exists(what):
        raise InputError(f"{what} is not there; name a file that is, or a built-in scene")
    if suffix in SUFFIXES:
        if live or force:
            option = "--live" if live else "--force"
            raise InputError(f"{option}: {what} is a run, which is played back as it is; to let the model run, name its scene")
        if scene is None:
            raise InputError(f"{what} does not say of which structure it is; name the scene that it is a run of: --scene SCENE")
        model, _ = model_of(scene, bar)
        return model, result_of_file(Path(what), model), None
    if scene is not None:
        raise InputError(f"--scene = {scene!r}: {what} is no run, which would need one; leave it out")
    times = sample_times(duration, STEP)
    model = model_of_fmu(Path(what)) if suffix == ".fmu" else model_of(what, bar)[0]
    constant = constant_force(model, force or [])
    result = None
    if live is False:
        inputs = held(model, times, force=lambda t: constant)
        result = simulate(model, inputs, told=bar.begin(f"simulating {model.name}"))
    return model, result, constant
