"""The subcommand `tensegrity view`: writes the page that is the model."""

from __future__ import annotations

from typing import Annotated

import typer

from .options import Debug, Duration, Force, Scene

#: Time between instants of a run that is made to be played back, s.
STEP = 0.01


def view(
    scene: Scene,
    live: Annotated[bool, typer.Option(help="The model runs in the page, or a run of it is played back.")] = True,
    force: Force = None,
    duration: Duration = 5.0,
    output: Annotated[str | None, typer.Option(metavar="FILE", help="The .html file to write (default: NAME.html).")] = None,
    show: Annotated[bool, typer.Option("--open", help="Show it in the browser, too.")] = False,
    debug: Debug = False,
) -> None:
    """Write a web page in which a scene moves, and can be pulled.  It needs no network."""
    import webbrowser

    from ..kernel import simulate
    from ..model import held
    from ..output.export import require_writable
    from ..output.page import parts, write_page
    from .words import constant_force, model_of, sample_times

    if output:
        require_writable(output, (".html",))
    times = sample_times(duration, STEP)
    model, _ = model_of(scene)
    constant = constant_force(model, force or [])
    result = None if live else simulate(model, held(model, times, force=lambda t: constant))
    parts(print)
    path = require_writable(output or f"{model.name}.html", (".html",))
    size = write_page(path, model, result, constant)
    what = "the model runs in it" if live else f"it plays {times[-1]:g} s"
    print(f"{model.name}: page written to {path} ({size / 1e6:.1f} MB, needs no network); {what}")
    if show:
        webbrowser.open(path.resolve().as_uri())
