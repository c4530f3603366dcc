"""The subcommand `tensegrity path`: steady states under a load that grows slowly, and falls again."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from ..progress import Shares, Told
from .options import Debug, FigureFile, Json, Scene, TableFile
from .program import tell

if TYPE_CHECKING:
    import numpy as np

    from ..equilibria.loading import Loading
    from ..equilibria.steady_states import Sweep


def path(
    scene: Scene,
    to: Annotated[float, typer.Option(metavar="P", help="Last p.")],
    force: Annotated[
        list[str] | None, typer.Option(metavar="NODE.AXIS=N", help="External forces in N at p = 1, such as n4.z=1 n5.z=1.")
    ] = None,
    rest_length: Annotated[
        list[str] | None, typer.Option(metavar="STRING=M", help="Changes of rest lengths in m at p = 1, such as s4=-0.01.")
    ] = None,
    start: Annotated[float, typer.Option("--from", metavar="P", help="First p.")] = 0.0,
    step: Annotated[
        float | None, typer.Option(metavar="P", help="States at this spacing of p (default: the path's points).")
    ] = None,
    back: Annotated[bool, typer.Option("--back", help="Then let the load fall to the first p again.")] = False,
    unstable: Annotated[bool, typer.Option("--unstable", help="Trace what lies behind limit and branch points, too.")] = False,
    show: Annotated[
        str | None, typer.Option(metavar="NODE.AXIS", help="The coordinate that is shown (default: where most force acts).")
    ] = None,
    output: TableFile = None,
    figure: FigureFile = None,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Follow the steady states under a slow load, through snaps and back."""
    from ..equilibria import steady_states
    from ..output import path_table
    from ..progress import Bar, each
    from .words import files_of, loading_of, model_of, parameters_of, quantity_of

    table, picture = files_of(output, figure)
    parameters = parameters_of(start, to, step)
    with Bar(f"reading {scene}") as bar:
        model, _ = model_of(scene, bar)
        loading = loading_of(model, force or [], rest_length or [])
        quantity = quantity_of(model, loading, show)
        sweeps = _sweeps(loading, parameters, back, bar.begin("following steady states"))
        bar.begin("tracing unstable ones")
        ends = (
            [steady_states.detours(sweep, told=told) for sweep, told in each(tuple(sweeps.values()), bar)] if unstable else []
        )
        behind = [path for paths in ends for path in paths]
    if table:
        path_table.write(table, loading, sweeps, behind, by_step=step is not None)
    if picture:
        from ..output.path_figures import load_label, path_figure, way
        from ..output.plots import write_figure

        named = {way(name, sweep): sweep for name, sweep in sweeps.items()}
        write_figure(path_figure(model.name, named, behind, quantity, load_label(loading)), picture)
    tell((path_table.data if json else path_table.summary)(model, sweeps, behind, quantity), table, picture)


def _sweeps(loading: Loading, parameters: np.ndarray, back: bool, told: Told) -> dict[str, Sweep]:
    """Legs by name, in order."""
    from ..equilibria import steady_states

    shares, way = Shares(told), abs(parameters[-1] - parameters[0])
    first, there, again = shares.share(abs(parameters[0])), shares.share(way), shares.share(way * back)
    nodes = None
    if parameters[0] != 0.0:
        nodes = steady_states.load_sweep(loading, [0.0, parameters[0]], told=first).nodes[-1]
    found = {"there": steady_states.load_sweep(loading, parameters, nodes, told=there)}
    if back:
        found["back"] = steady_states.load_sweep(loading, parameters[::-1], found["there"].nodes[-1], told=again)
    return found
