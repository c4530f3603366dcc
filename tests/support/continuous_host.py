"""A host that integrates a kernel's continuous-time view with a solver of SciPy, as importers of model exchange do."""

from __future__ import annotations

import numpy as np
import scipy.integrate as integrators
from scipy.optimize import brentq

from tensegrity_core.fields import FIELDS, INTEGER_FIELDS
from tensegrity_core.kernel import Kernel, input_rows
from tensegrity_core.kernel.continuous import STATES_CHANGED, ContinuousView
from tensegrity_core.model.inputs import INPUTS, carried


class Host:
    """One run.  rows, counts: the kernel's values at each of inputs.times; transitions: all that events carried out;
    corrections: events that bars asked for; lengths: largest relative deviation of a bar's length at the rows."""

    def __init__(self, model, inputs, method="DOP853", tolerance=1e-11):
        self.model, self.inputs = model, inputs.resolved(model)
        self.solver, self.tolerance = getattr(integrators, method), tolerance
        self.kernel = Kernel(model)
        self.view = ContinuousView(self.kernel)
        self.given = input_rows(model, inputs)
        self.block = self.kernel.values[: self.given.shape[1]]
        self.transitions, self.corrections, self.lengths, self.evaluations = [], 0, 0.0, 0
        self.k = 0

    def apply(self, t):
        """Inputs at t of the step under way: each by what the step carries it along with."""
        self.block[:] = self.given[self.k]
        tau = t - self.inputs.times[self.k]
        if self.moves:
            values = {name: self.kernel[name].copy() for name in INPUTS}
            for name, value in carried(values, tau).items():
                self.kernel[name][:] = value

    def right_hand_side(self, t, x):
        self.evaluations += 1
        self.apply(t)
        self.view.set(t, x)
        return self.view.derivatives()

    def indicators(self, t, x):
        self.apply(t)
        self.view.set(t, x)
        return self.view.event_indicators()

    def event(self, t, x):
        """Carry out what is due at a state, jumps of the inputs included; returns the state after it."""
        self.view.enter_event()
        if self.k < len(self.given):
            self.apply(t)
        while self.view.update_discrete():
            self.transitions += self.kernel.transitions
            self.view.enter_event()
        return self.view.states

    def run(self):
        times = self.inputs.times
        self.moves = any(np.any(getattr(self.inputs, f"{name}")) for name in ("rest_length_rate", "node_velocity"))
        self.moves = self.moves or bool(np.any(self.inputs.node_acceleration))
        self.apply(times[0])
        self.kernel.initialize(times[0])
        self.rows, self.counts = [self.kernel.values.copy()], [self.kernel.integers.copy()]
        x = self.view.states
        solver = None
        for k in range(len(times) - 1):
            self.k = k
            if k and (self.moves or not np.array_equal(self.given[k], self.given[k - 1])):
                x, solver = self.event(times[k], x), None
            x, solver = self.reach(times[k], times[k + 1], x, solver)
            self.view.set(times[k + 1], x)
            self.apply(times[k + 1])
            self.view.outputs()
            self.rows.append(self.kernel.values.copy())
            self.counts.append(self.kernel.integers.copy())
            self.lengths = max(self.lengths, self.deviation())
        self.rows, self.counts = np.array(self.rows), np.array(self.counts)
        return self

    def deviation(self):
        if not len(self.model.bars):
            return 0.0
        nodes = self.kernel["position"].reshape(-1, len(self.model.axes))
        lengths = np.linalg.norm(nodes[self.model.bars[:, 1]] - nodes[self.model.bars[:, 0]], axis=1)
        return float(np.abs(lengths / self.model.bar_length - 1.0).max())

    def reach(self, t, end, x, solver):
        """The state at `end`, and the solver if it may go on: steps end there."""
        while t < end:
            scale = self.tolerance * self.view.nominals
            solver = self.solver(self.right_hand_side, t, x, end, rtol=self.tolerance, atol=scale)
            x, t, broke = self.steps(solver)
            if broke:
                x = self.event(t, x)
        return x, None

    def steps(self, solver):
        """Until the solver's end or an event: the state, the time and whether there was an event."""
        before = self.indicators(solver.t, solver.y)
        while solver.status == "running":
            start = solver.t
            message = solver.step()
            assert solver.status != "failed", message
            after = self.indicators(solver.t, solver.y)
            crossed = np.flatnonzero((before > 0.0) & (after <= 0.0))
            if len(crossed):
                dense = solver.dense_output()
                at = min(self.root(dense, start, solver.t, i) for i in crossed)
                self.indicators(at, dense(at))
                return dense(at), at, True
            before = after
            self.view.set(solver.t, solver.y)
            if self.view.completed_step():
                self.corrections += 1
                return solver.y, solver.t, True
        return solver.y, solver.t, False

    def root(self, dense, a, b, i):
        """Just behind where an indicator becomes negative."""
        t = brentq(lambda t: self.indicators(t, dense(t))[i], a, b, xtol=1e-16, rtol=1e-15)
        for _ in range(60):
            if self.indicators(t, dense(t))[i] <= 0.0:
                return t
            t = min(b, np.nextafter(t, np.inf) + 1e-15)
        return b

    def series(self, name):
        """(K+1, ...) of a field."""
        if name in self.kernel.layout:
            return self.rows[:, self.kernel.layout[name]]
        return self.counts[:, self.kernel.integer_layout[name]]


def fields():
    """Names of all outputs."""
    return [field.name for field in (*FIELDS, *INTEGER_FIELDS) if field.role == "output"]


__all__ = ["STATES_CHANGED", "Host", "fields"]
