"""Steady states under a slow load as a text, as data, and as a CSV file."""

from __future__ import annotations

from pathlib import Path as FilePath
from typing import Any, NamedTuple

from ..equilibria import paths, steady_states
from ..equilibria.loading import Loading
from ..equilibria.points import Point
from ..files import replacing_text
from ..model import Model


class Quantity(NamedTuple):
    """The coordinate that a picture or a text shows: its name, node and axis."""

    name: str
    node: int
    axis: int

    def of(self, path: paths.Path, point: Point) -> float:
        """m."""
        return float(path.equations.nodes(point.free)[self.node, self.axis])

    def rate(self, path: paths.Path, point: Point) -> float:
        """Its derivative by the arc at a point."""
        place = path.equations.place[self.node, path.equations.model.axes.index(self.axis)]
        return float(point.direction[place]) if place >= 0 else 0.0


WHY = {
    "limit": "limit point",
    "branch": "branch point: other paths leave here, --unstable traces them",
    "kink": "a string's force curve has a kink",
    "loose": "strings go slack and leave motions that nothing resists",
}


def summary(model: Model, sweeps: dict[str, steady_states.Sweep], behind: list[paths.Path], quantity: Quantity) -> str:
    """What `tensegrity path` prints: the jumps of each leg, and what lies behind them."""
    lines = []
    for sweep in sweeps.values():
        first, last = sweep.parameters[[0, -1]]
        start, end = (nodes[quantity.node, quantity.axis] for nodes in sweep.nodes[[0, -1]])
        jumps = "no jump" if not sweep.jumps else f"{len(sweep.jumps)} jumps" if len(sweep.jumps) > 1 else "1 jump"
        lines.append(f"  p = {first:g} to {last:g}: {quantity.name} from {start:z.6f} to {end:z.6f} m, {jumps}")
        for jump in sweep.jumps:
            before, after = (quantity.of(sweep.paths[0], point) for point in (jump.before, jump.after))
            lines.append(f"    p = {jump.parameter:.9g}: {before:z.6f} to {after:z.6f} m, {WHY[jump.kind]}")
    for path in behind:
        kinds = [f"{p.kind} at p = {p.parameter:.9g}" for p in path.points[1:] if p.kind in ("limit", "branch")]
        start, end = path.points[0].parameter, path.points[-1].parameter
        lines.append(f"  behind p = {start:.6g}, to {end:.6g}: {', '.join(kinds) or 'no limit and branch points'}")
    return "\n".join([f"{model.name}: steady states under a slow load", *lines])


def write(
    output: FilePath, loading: Loading, sweeps: dict[str, steady_states.Sweep], behind: list[paths.Path], by_step: bool
) -> None:
    """One row per state: leg, p, whether it is stable, what is special about it, coordinates (m), string tensions (N)."""
    model = loading.model
    nodes = [f"{model.node_names[i]}.{'xyz'[axis]}" for i in range(len(model.nodes)) for axis in model.axes]
    header = ["leg", "p", "stable", "kind", *nodes, *(f"{name}.elastic_force" for name in model.string_names)]
    legs = [
        (name, sweep.equations, sweep.states if by_step else [p for path in sweep.paths for p in path.points])
        for name, sweep in sweeps.items()
    ]
    legs += [("behind", path.equations, path.points) for path in behind]
    with replacing_text(output) as file:
        file.write(",".join(header) + "\n")
        for leg, equations, points in legs:
            for point in points:
                place = equations.nodes(point.free)[:, list(model.axes)].ravel().tolist()
                numbers = map(repr, [*place, *point.tension.tolist()])
                file.write(",".join([leg, repr(point.parameter), str(int(point.stable)), point.kind, *numbers]) + "\n")


def data(model: Model, sweeps: dict[str, steady_states.Sweep], behind: list[paths.Path], quantity: Quantity) -> dict[str, Any]:
    """What `summary` says, as JSON takes it: m, and p without a unit."""

    def leg(sweep: steady_states.Sweep) -> dict[str, Any]:
        path = sweep.paths[0]
        jumps = [
            {
                "p": jump.parameter,
                "from": quantity.of(path, jump.before),
                "to": quantity.of(path, jump.after),
                "kind": jump.kind,
                "why": WHY[jump.kind],
            }
            for jump in sweep.jumps
        ]
        places = sweep.nodes[:, quantity.node, quantity.axis].tolist()
        return {"p": sweep.parameters.tolist(), quantity.name: places, "jumps": jumps}

    special = [
        [{"kind": p.kind, "p": p.parameter} for p in path.points[1:] if p.kind in ("limit", "branch")] for path in behind
    ]
    return {
        "scene": model.name,
        "shown": quantity.name,
        **{name: leg(sweep) for name, sweep in sweeps.items()},
        "behind": special,
    }
