"""Steady states that a load reaches when it comes suddenly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .. import statics
from .equilibrium import Equations
from .paths import Path, point_at, scale_of
from .points import PathError, Point
from .steady_states import FIRST_SPAN, LATER, FlowSurface

SAME = 1e-7  # m: states nearer than this are one
STILL = 2e-4  # m: a swing about a stable state that takes no structure out of its basin
RUN_TOLERANCE = 1e-8  # of the kernel's run under a sudden load


def states_at(paths: list[Path], parameter: float) -> list[Point]:
    """The distinct equilibria of several paths at p, stable or not, in order of energy."""
    found: list[Point] = []
    for path in paths:
        for point in path.at(parameter):
            if all(np.abs(point.free - other.free).max() > SAME for other in found):
                found.append(point)
    return sorted(found, key=lambda point: paths[0].equations.energy(point.free, parameter))


class Sudden(NamedTuple):
    """The state that a sudden load reaches: the point; its place among the stable states that were known, -1 if it is none
    of them; the simulated time (s) that decided; why: 'energy' (it was below the lowest saddle), 'swing' (what energy was
    left could hardly move the structure), 'time' (the span ended: the state to which the flow leads from there)."""

    point: Point
    known: int
    time: float
    why: str


class SuddenLoads:
    """A model that stands at its start until a load is there at once; for as many loads as one likes."""

    def __init__(self, equations: Equations):
        from ..kernel import Kernel  # what does not ask for dynamics needs no compiled kernel

        self.equations = equations
        self._kernel = Kernel(equations.model, tolerance=RUN_TOLERANCE)

    def state(self, parameter: float, known: Sequence[Point] = (), longest: float = 50.0) -> Sudden:
        """Where the model comes to rest under the load of p.  known: the equilibria at p, see `states_at`; longest: s."""
        energy, stable = self.equations.energy, [point for point in known if point.stable]
        saddles = [energy(point.free, parameter) for point in known if point.unstable == 1]
        barrier = min(saddles, default=-np.inf) if stable else -np.inf
        run, span, found, why = _Released(self.equations, self._kernel, parameter), FIRST_SPAN, None, "time"
        while why == "time" and run.time < longest:
            run.go_on(min(span, longest - run.time))
            span *= LATER
            if run.energy < barrier:
                why = "energy"
            elif (found := run.nearly_at_rest()) is not None:
                why = "swing"
        point = run.flow() if found is None else found
        place = [i for i, other in enumerate(stable) if np.abs(point.free - other.free).max() <= SAME]
        return Sudden(point, place[0] if place else -1, run.time, why)


class _Released:
    """The kernel's run of a model let go under a load."""

    def __init__(self, equations: Equations, kernel, parameter: float):
        self.equations, self.parameter, self.time, self._kernel = equations, parameter, 0.0, kernel
        self.scale = scale_of(equations.model, 0.0, parameter)
        kernel["force"][:] = equations.free(equations.loading.forces(parameter))
        kernel["rest_length"][:] = equations.loading.rest_lengths(parameter)
        kernel.initialize()

    def go_on(self, span: float) -> None:
        self._kernel.step(span)
        self.time += span
        model = self.equations.model
        self.free = self._kernel["position"].reshape(len(model.nodes), -1)[model.free_nodes].ravel().copy()
        self.kinetic = float(self._kernel["kinetic"][0])
        self.energy = self.kinetic + self.equations.energy(self.free, self.parameter)

    def nearly_at_rest(self) -> Point | None:
        """The stable state beside, if the energy that is left moves the structure by no more than STILL about it."""
        if 2.0 * self.kinetic > self.equations.stiffest * STILL**2:
            return None
        try:
            point = point_at(self.equations, self.scale, self.equations.nodes(self.free), self.parameter, 1.0)
        except PathError:
            return None
        left = max(self.energy - self.equations.energy(point.free, self.parameter), 0.0)
        near = np.abs(self.free - point.free).max() <= STILL
        return point if point.stable and near and 2.0 * left <= point.values[0] * STILL**2 else None

    def flow(self) -> Point:
        """The stable state to which the flow leads from here."""
        surface = FlowSurface(self.equations, self.parameter)
        nodes = self.equations.nodes(statics.descend(surface, self.free, surface.nearly_balanced))
        return point_at(self.equations, self.scale, nodes, self.parameter, 1.0)
