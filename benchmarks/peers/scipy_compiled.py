"""SciPy's solvers over the kernel's compiled right-hand side, with events and restarts or without."""

from __future__ import annotations

import ctypes
from ctypes import POINTER, c_char_p, c_double, c_int, c_int32, c_void_p
from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.harness.problems import INSTANTS

from .ladder import Clock, Ladder, Run, timed, tolerances
from .native import Bench

METHODS = ("RK45", "DOP853", "Radau", "BDF", "LSODA")
IMPLICIT = {"Radau", "BDF", "LSODA"}
#: Of interest without events.
ACROSS = ("RK45", "DOP853", "Radau")
#: Right-hand sides between two looks at the clock.
CLOCK_EVERY = 256

_PROTOTYPES = {
    "peer_new": (c_void_p, c_char_p, c_char_p, c_int),
    "peer_delete": (None, c_void_p),
    "peer_sizes": (None, c_void_p, POINTER(c_int32)),
    "peer_start": (POINTER(c_double), c_void_p),
    "peer_begin": (None, c_void_p),
    "peer_rhs": (None, c_void_p, c_void_p, c_void_p),
    "peer_jacobian": (None, c_void_p, c_void_p, c_void_p),
    "peer_distances": (None, c_void_p, c_void_p, c_void_p),
    "peer_switch": (None, c_void_p, c_void_p, c_void_p),
    "peer_outputs": (c_double, c_void_p, c_void_p, c_void_p),
}


class Compiled:
    """The problem of peer.h as functions of NumPy arrays; events: see there."""

    def __init__(self, bench: Bench, events: bool):
        self.library = ctypes.CDLL(str(bench.tools.library))
        for name, (result, *arguments) in _PROTOTYPES.items():
            function = getattr(self.library, name)
            function.restype, function.argtypes = result, arguments
        self.peer = self.library.peer_new(str(bench.model).encode(), str(bench.force).encode(), int(events))
        if not self.peer:
            raise SystemExit(f"the peers' library refuses the model of {bench.problem.name}")
        sizes = (c_int32 * 3)()
        self.library.peer_sizes(self.peer, sizes)
        self.n, self.roots, self.coordinates = sizes
        self.x, self.dx, self.g = np.empty(self.n), np.empty(self.n), np.empty(self.roots)
        self.J = np.empty((self.n, self.n))
        self.at_x, self.at_dx, self.at_g, self.at_J = (a.ctypes.data for a in (self.x, self.dx, self.g, self.J))
        self.watched = None  # the state that g belongs to
        self.clock, self.calls = Clock(np.inf), 0
        self.start = np.ctypeslib.as_array(self.library.peer_start(self.peer), (self.n,)).copy()

    def __del__(self):
        self.library.peer_delete(self.peer)

    def begin(self, limit: float) -> None:
        self.clock = Clock(limit)
        self.watched = None
        self.library.peer_begin(self.peer)

    def rhs(self, t: float, x: np.ndarray) -> np.ndarray:
        self.calls += 1
        if self.calls % CLOCK_EVERY == 0:
            self.clock()
        self.x[:] = x
        self.library.peer_rhs(self.peer, self.at_x, self.at_dx)
        return self.dx.copy()

    def jacobian(self, t: float, x: np.ndarray) -> np.ndarray:
        self.x[:] = x
        self.library.peer_jacobian(self.peer, self.at_x, self.at_J)
        return self.J.T

    def events(self) -> list:
        """A terminal event per end of a piece: the distance inside it falls through zero.  A step's end costs one call."""

        def watch(root):
            def distance(t, x):
                if x is not self.watched:
                    self.watched = x
                    self.x[:] = x
                    self.library.peer_distances(self.peer, self.at_x, self.at_g)
                return self.g[root]

            distance.terminal, distance.direction = True, -1.0
            return distance

        return [watch(root) for root in range(self.roots)]

    def switch(self, x: np.ndarray, found: np.ndarray) -> np.ndarray:
        """x on the bars' lengths, after the transitions that were found: (roots,) int32."""
        self.x[:] = x
        self.watched = None
        self.library.peer_switch(self.peer, self.at_x, found.ctypes.data)
        return self.x.copy()

    def outputs(self, x: np.ndarray) -> tuple[np.ndarray, float]:
        """Coordinates of all nodes, m; energy, J."""
        position = np.empty(self.coordinates)
        self.x[:] = x
        return position, self.library.peer_outputs(self.peer, self.at_x, position.ctypes.data)


def integrate(
    compiled: Compiled, method: str, tolerance: float, events: bool, duration: float, instants: np.ndarray | None = None
) -> tuple[list[np.ndarray], dict[str, int]]:
    """Begin `compiled` before.  States, (n,) each, at the instants (s, the first being 0), or at the ends of all steps; and the
    counts, with "steps" in the latter case.  After an event SciPy starts anew.  RuntimeError where SciPy gives up,
    TimeoutError where the clock does, ValueError where SciPy's linear algebra meets what is not finite."""
    watches = compiled.events() if events else None
    options = {"method": method, "rtol": tolerance, "atol": tolerance, "events": watches}
    if method in IMPLICIT:
        options["jac"] = compiled.jacobian
    t, x, rows = 0.0, compiled.start, []
    counts = {"rhs": 0, "jacobians": 0, "transitions": 0} | ({"steps": 0} if instants is None else {})
    while t < duration:
        left = None if instants is None else instants[len(rows) :]
        sol = solve_ivp(compiled.rhs, (t, duration), x, t_eval=left, **options)
        rows += list(np.transpose(sol.y))  # [] where the event came before the next instant
        counts["rhs"] += int(sol.nfev)
        counts["jacobians"] += int(sol.njev)
        if instants is None:
            counts["steps"] += len(sol.t) - 1
        if sol.status < 0:
            raise RuntimeError(sol.message)
        if sol.status == 0:
            break
        first = max(range(len(watches)), key=lambda r: len(sol.t_events[r]))  # all that fired stopped at the same instant
        t, state = sol.t_events[first][-1], sol.y_events[first][-1]
        found = np.array([len(hits) > 0 and hits[-1] == t for hits in sol.t_events], dtype=np.int32)
        x = compiled.switch(state, found)
        counts["transitions"] += int(found.sum())
    return rows, counts


def _measure(
    bench: Bench, compiled: Compiled, method: str, events: bool, tolerance: float, repetitions: int, limit: float
) -> Run:
    duration = bench.problem.duration
    instants = np.linspace(0.0, duration, INSTANTS + 1)
    run = partial(integrate, compiled, method, tolerance, events, duration, instants)
    found, result = timed(repetitions, partial(compiled.begin, limit), run)
    if result is None:
        return found
    outputs = [compiled.outputs(x) for x in result[0]]
    position = np.array([position for position, _ in outputs]).reshape(INSTANTS + 1, -1, len(bench.problem.model.axes))
    return Run(found.seconds, position, np.array([energy for _, energy in outputs]), result[1])


def _ladder(bench: Bench, compiled: Compiled, method: str, events: bool) -> Ladder:
    measure = partial(_measure, bench, compiled, method, events)
    return Ladder("scipy", method, events, "tolerance", tolerances(1e-3, 1e-12), measure)


def ladders(bench: Bench) -> list[Ladder]:
    """SciPy's methods, with events and without; all without where there is nothing to find."""
    across = Compiled(bench, False)
    if bench.problem.smooth:
        return [_ladder(bench, across, method, False) for method in METHODS]
    located = Compiled(bench, True)
    found = [_ladder(bench, located, method, True) for method in METHODS]
    return found + [_ladder(bench, across, method, False) for method in ACROSS]
