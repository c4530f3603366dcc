"""The reference: the article's matrix equations (`equations`), integrated by SciPy with tight tolerances.

Between transitions the right-hand side is smooth: each string holds a *piece* of its force curve (0 slack; 1 taut, or
the pieces of an NSH or another element), with memory a *branch*, and, under the law 'tension_only', whether its tension
is *clipped* at zero.  Where a string reaches an end of its piece the step is repeated so that it ends there, the piece
changes, and the integration restarts.  The instant is found on SciPy's dense output and then corrected by Newton steps
until the gap is at round-off.  What a snap of a string with memory loses counts as dissipated at that instant.

So does each contact with the ground (`contact`): apart, sticking, slipping or clipped.

Two things are left to the solver's error control: the kinks of a damper given by points, and the square root in which a
branch's force ends at a fold.

Bar lengths.  l_i = |b_i| of the current state stands in lambda, so that a deviation grows linearly only (with the
nominal lengths it grows exponentially).  On top, `on_constraints` puts N and Ndot back on |b_i| = l_i, b_i . bdot_i = 0
at every restart, at every output row, and as soon as the deviation exceeds `DRIFT`.  It moves the nodes along the bar
only, about the bar's centre (about the pin of a pinned bar): orthogonal in the mass metric, so centres of mass and
their velocities keep all digits.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy

from ..errors import InputError, SimulationError
from ..fields import INTEGER_FIELDS, outputs
from ..laws.hysteresis import NoStableState, follow
from ..model import Inputs, Model, Result, Transition
from ..model.components import full_shape
from ..model.inputs import INPUTS, carried
from ..model.strength import bar_utilisation, string_utilisation
from ..quantities import number
from . import contact_modes, instant
from .contact import SLIPPING, STICKING, Touching
from .equations import diagonal, string_motion
from .instant import Mode, Motion, Strings, gaps, mode_of, motion_at, strings_at
from .joints import Joints, Singular, require_cranks
from .moved import jumped, path
from .structure import Structure


class _Method(NamedTuple):
    """A SciPy solver, by its name in scipy.integrate.

    scale: factor on rtol and atol that makes the methods alike in the error they reach; velocity: factor on atol for
    velocities, whose errors the dampers let die out; dense: whether its dense output is good enough for rows, otherwise
    it stops at every row; implicit: whether it wants a Jacobian.
    """

    solver: str
    scale: float
    velocity: float
    dense: bool
    implicit: bool


#: The methods that `simulate` accepts, besides 'auto'.
METHODS = {"DOP853": _Method("DOP853", 1.0, 10.0, True, False), "Radau": _Method("Radau", 300.0, 1.0, False, True)}
#: Above this bound on the dampers' fastest rate (1/s) 'auto' takes Radau, below DOP853: about equal work there.
STIFF = 2e4
#: Largest deviation of the bars' constraints (see `drift`) that the integration carries along.
DRIFT = 1e-10
#: The same deviation beyond which a step is wrong rather than inaccurate.
BROKEN = 1e-2
#: Gaps (see `gaps`: m, m, N) below which strings that move out of their piece do so together with one that has arrived.
TOGETHER = np.array([1e-13, 1e-13, 1e-9])
#: Gaps no larger than this are zero to round-off (m, m, N).
ROUND_OFF = np.array([1e-15, 1e-15, 1e-11])
#: A string at the end of its piece whose rate (m/s) is below this follows its acceleration.
AT_REST = 1e-15
#: Factor on atol for the deflections of bristles, which are small: their direction must be right, too.
OF_BRISTLES = 1e-3
#: Points per step at which gaps are looked at once a transition is suspected.
SAMPLES = 16
#: Displacement (m) and velocity (m/s) over which derivatives are taken.
DIFFERENCE = 1e-7
#: First trial step of a run, s; SciPy's own choice is not safe against overflow.
FIRST_STEP = 1e-6
#: Absolute tolerance of the energy integrals, J.
LEDGER_ATOL = 1e-10
#: Steps between two rows after which a run gives up.
MAX_STEPS = 200_000
#: Changes of piece without the time moving on, after which a run gives up.
MAX_STALLED = 100


class _Watch(NamedTuple):
    """What decides on transitions at one instant: `gaps` and their rates (both (3, S + K)), of strings and then of contacts."""

    gap: np.ndarray
    rate: np.ndarray


class _Due(NamedTuple):
    """A transition found within a step: when (s), which gap closes (row of `gaps`), for which string, or S + which contact."""

    time: float
    row: int
    column: int


class _Run:
    """One simulation.  State y: [N Ndot] of the free nodes (3, 2F), row by row; the actuators' angles and speeds (2, A); the
    bristles of contacts (d, K); input work, dissipated, throughput."""

    def __init__(self, model: Model, inputs: Inputs, rtol: float, atol: float, method: str, told=None):
        self.s = Structure(model)
        self.method = METHODS[("Radau" if instant.fastest_rate(self.s) > STIFF else "DOP853") if method == "auto" else method]
        self.inputs, self.rtol, self.told = inputs, rtol * self.method.scale, told
        self.free = model.free_nodes
        n, self.of_nodes = len(model.nodes), 6 * len(self.free)
        self.of_motors = self.of_nodes + 2 * len(model.actuated)
        self.touching = len(model.contacts)
        self.moving = self.of_motors + self.touching * (len(model.axes) - 1)  # the integrals follow
        rests = model.fixed & ~self.s.moved.select.any(axis=0)
        self.moved_whole = None if self.s.joints is None else (self.s.moved_axes > 0.0) | model.fixed[self.s.moved.nodes]
        self.X_fixed = np.concatenate((np.where(rests, model.nodes.T, 0.0), np.zeros((3, n))), axis=1)
        self.select = np.eye(2 * n)[np.concatenate((self.free, n + self.free))]
        self.select_free = np.eye(n)[:, self.free]
        # The throughput only scales the ledger; the corners of its absolute values must not govern the step.
        of_node = np.repeat([1.0, self.method.velocity], len(self.free)) * atol * self.method.scale
        of_motor = np.array([[1.0], [self.method.velocity]]) * atol * self.method.scale / self.s.motors.radius
        of_bristle = np.full(self.moving - self.of_motors, OF_BRISTLES * atol * self.method.scale)
        self.atol = np.concatenate((np.tile(of_node, 3), of_motor.ravel(), of_bristle, [LEDGER_ATOL, LEDGER_ATOL, np.inf]))
        columns = [len(model.strings), self.touching]
        self.round_off = np.repeat(np.stack((ROUND_OFF, contact_modes.ROUND_OFF), axis=1), columns, axis=1)
        self.together = np.repeat(np.stack((TOGETHER, contact_modes.TOGETHER), axis=1), columns, axis=1)
        self.rows: list[dict] = []
        self.transitions: list[Transition] = []
        self.stats = {"evaluations": 0, "steps": 0, "restarts": 0}
        self.step_hint = FIRST_STEP
        self.steps_since_row, self.now = 0, float(inputs.times[0])
        self.load = instant.load_of(self.s, inputs, 0)

    # State and right-hand side.

    def unpack(self, t, y) -> tuple[np.ndarray, np.ndarray]:
        """N, Ndot (3, n) from y; the moved nodes are where the load has them at t."""
        X = self.X_fixed + y[: self.of_nodes].reshape(3, -1).dot(self.select)
        n = X.shape[1] // 2
        if len(self.s.moved.nodes):
            self._place_moved(X, n, *self.moved(t))
        return X[:, :n], X[:, n:]

    def _place_moved(self, X, n: int, position, velocity) -> None:
        """Write the moved nodes' coordinates into [N Ndot]; a partly fixed node's free ones stay."""
        nodes, held = self.s.moved.nodes, self.moved_whole
        if held is None:
            X[:, nodes], X[:, n + nodes] = position, velocity
        else:
            X[:, nodes] = np.where(held, position, X[:, nodes])
            X[:, n + nodes] = np.where(held, velocity, X[:, n + nodes])

    def moved(self, t):
        """Position and velocity (3, E) of the moved nodes."""
        load = self.load
        return path(load.node_position, load.node_velocity, load.node_acceleration, t - load.since)

    def winding(self, y):
        """Angles and speeds (2, A) of the actuators."""
        return y[self.of_nodes : self.of_motors].reshape(2, -1)

    def bristle(self, y):
        """Deflections (d, K) of the bristles."""
        return y[self.of_motors : self.moving].reshape(-1, self.touching) if self.touching else None

    def motion(self, t, y, mode: Mode) -> Motion:
        """Everything at y."""
        return motion_at(self.s, self.load, mode, t, *self.unpack(t, y), self.winding(y), bristle=self.bristle(y))

    def pack(self, N, Ndot, others):
        """y from N, Ndot (3, n) and what else stands in it."""
        return np.concatenate((np.concatenate((N[:, self.free], Ndot[:, self.free]), axis=1).ravel(), others))

    def projected(self, t, y):
        """y with N and Ndot on the bars' constraints."""
        N, Ndot = instant.on_constraints(self.s, *self.unpack(t, y))
        if self.s.joints is not None:
            self._require_lengths(t, self.s.joints, N, Ndot)
        return self.pack(N, Ndot, y[self.of_nodes :])

    @staticmethod
    def _require_lengths(t: float, joints: Joints, N, Ndot) -> None:
        """Raises SimulationError where no positions near N keep all lengths."""
        if not joints.drift(N, Ndot) <= DRIFT:
            why = f"bars {joints.named(joints.off(N, Ndot))} cannot all keep their lengths"
            remedy = "look at what holds them, and weld a braced panel in space"
            raise SimulationError("contradictory", f"{why}; {remedy}", float(t))

    def derivative(self, mode: Mode):
        """The right-hand side ydot(t, y) under one mode: eq. 7, eq. 8 and the powers of the energy ledger."""
        load, select, count = self.load, self.select_free, len(self.free)

        def ydot(t, y):
            self.stats["evaluations"] += 1
            (N, Ndot), winding = self.unpack(t, y), self.winding(y)
            motion = motion_at(self.s, load, mode, t, N, Ndot, winding, False, self.bristle(y))
            found = np.empty(len(y))
            Xdot = found[: self.of_nodes].reshape(3, -1)
            Xdot[:, :count], Xdot[:, count:] = y[: self.of_nodes].reshape(3, -1)[:, count:], motion.Nddot.dot(select)
            if len(motion.winding):
                found[self.of_nodes : self.of_motors] = np.concatenate((winding[1], motion.winding))
            if motion.slipping is not None:
                found[self.of_motors : self.moving] = motion.slipping.bristle_rate.ravel()
            found[-3:] = instant.powers(self.s, load, motion, Ndot, winding)
            return found

        return ydot

    def jacobian(self, ydot):
        """d ydot / dy by differences.  SciPy's own, over 1e-16 m/s where a velocity is zero, drown in round-off."""

        def jac(t, y):
            J, at_y = np.zeros((len(y), len(y))), ydot(t, y)
            for i in range(self.moving):  # nothing depends on the integrals
                moved = y.copy()
                moved[i] += DIFFERENCE
                J[:, i] = (ydot(t, moved) - at_y) / DIFFERENCE
            return J

        return jac

    def strings(self, t, y, mode: Mode) -> Strings:
        """The strings at y."""
        return strings_at(self.s, self.load, mode, t, *self.unpack(t, y), self.winding(y))

    def elongation_acceleration(self, t, y, mode: Mode):
        """(S,) m/s2: second derivative of xi - xi0."""
        N, Ndot = self.unpack(t, y)
        S, xi, xi_rate = string_motion(N, Ndot, self.s.C_s)
        Sdot = Ndot @ self.s.C_s.T
        motion = self.motion(t, y, mode)
        Sddot = motion.Nddot.dot(self.s.C_s.T)
        found = (diagonal(Sdot, Sdot) + diagonal(S, Sddot) - xi_rate**2) / xi
        if self.s.route is not None:
            found = self.s.route.dot(found)
        found[self.s.motors.strings] += self.s.motors.radius * motion.winding
        return found

    def energy(self, t, y, mode: Mode) -> float:
        """What inputs can change at once: the energy of strings and contacts and, with moved nodes, that of masses, J."""
        stored = instant.elastic_energy(self.s, self.strings(t, y, mode).elongation, mode.branches)
        if len(self.s.moved.nodes):
            N, Ndot = self.unpack(t, y)
            stored += instant.kinetic_energy(self.s, Ndot, self.winding(y)) + instant.potential_energy(self.s, N)
        if self.s.contacts is not None:
            stored += self.s.contacts.energy(self.contacts(t, y, mode))
        return stored

    def contacts(self, t, y, mode: Mode) -> Touching:
        """The contacts at y."""
        return self.s.contacts.at(self.load, mode.contact, t, *self.unpack(t, y), self.bristle(y))

    # Inputs.

    def _changes(self, k: int) -> bool:
        """Whether step k's inputs are other than those of step k-1 carried on."""
        i = self.inputs
        before = {name: getattr(i, name)[k - 1] for name in INPUTS}
        expected = carried(before, i.times[k] - i.times[k - 1])
        return not all(np.array_equal(getattr(i, name)[k], value) for name, value in expected.items())

    def _change_inputs(self, k: int, y, mode: Mode):
        """Take over the inputs of step k.  A jump of a rest length does work, but gives no impulse; that of a moved node's
        velocity gives one, see `moved`."""
        t = float(self.inputs.times[k])
        before = self.energy(t, y, mode)
        (N, Ndot), (position, velocity) = self.unpack(t, y), self.moved(t)
        self.load = instant.load_of(self.s, self.inputs, k)
        y = self._jumped(N, Ndot, position, velocity, y[self.of_nodes :])
        settled, losses = self._settled(t, y, mode)
        if self.touching:
            settled, losses, y = self._settled_on_ground(t, y, settled, losses)
        jump = self.energy(t, y, settled) - before
        y = self._note(t, y, mode, settled, losses)
        jump += sum(losses.values())  # what snaps on the way lose was put in, too
        return y + np.concatenate((np.zeros(self.moving), [jump, 0.0, abs(jump)])), settled

    def _jumped(self, N, Ndot, position, velocity, others):
        """y after the moved nodes went, at once, from this position and velocity (3, E) to those of the present load."""
        shift, dv = self.load.node_position - position, self.load.node_velocity - velocity
        if self.s.joints is not None:
            select, moved = self.s.moved.select, self.s.moved_axes
            return self.pack(*self.s.joints.jumped(N, Ndot, (shift * moved) @ select, (dv * moved) @ select), others)
        return self.pack(*jumped(self.s.moved, N, Ndot, shift, dv), others)

    # The loop.

    def go(self) -> None:
        """Run through all inputs."""
        times, model = self.inputs.times.tolist(), self.s.model
        N, Ndot, moved = model.nodes.T, model.velocity.T, self.s.moved.nodes
        others, apart = np.zeros(self.moving - self.of_nodes + 3), np.zeros(self.touching, dtype=int)
        y = self.projected(times[0], self._jumped(N, Ndot, N[:, moved], Ndot[:, moved], others))
        slack = np.zeros(len(model.strings), dtype=int)
        mode, losses = self._settled(times[0], y, mode_of(self.s, slack, slack > 0, contact=apart))
        if self.touching:
            mode, _, y = self._settled_on_ground(times[0], y, mode, losses)
        self._record(times[0], y, mode)
        first = 0
        while True:
            last = first + 1
            while self.method.dense and last < len(times) - 1 and not self._changes(last):
                last += 1
            y, mode = self._hold_inputs(y, mode, times[first], times[first + 1 : last + 1])
            if last == len(times) - 1:
                return
            if self._changes(last):
                y, mode = self._change_inputs(last, y, mode)
            first = last

    def _hold_inputs(self, y, mode: Mode, t: float, rows: list[float]):
        """Integrate to rows[-1] under one load and record the rows; returns the state and mode there."""
        end, pending, stalled = rows[-1], rows[::-1], 0
        while t < end:
            t_before = t
            t, y, due = self._smooth_run(mode, t, y, end, pending)
            self.stats["restarts"] += 1
            if due is not None:
                changed, losses = self._after(mode, t, y, due)
                if self.touching:
                    y = self._on_cones(t, y, mode, changed)
                y = self._note(t, y, mode, changed, losses)
                mode = changed
                stalled = stalled + 1 if t == t_before else 0
                if stalled > MAX_STALLED:
                    raise self._chattering(t, due.column)
        while pending:  # a transition fell on the last row
            self._record(pending.pop(), y, mode)
        return y, mode

    def _chattering(self, t: float, column: int) -> SimulationError:
        model, strings = self.s.model, len(self.s.model.strings)
        if column < strings:
            what = f"string {model.string_names[column]!r} changes its piece"
        else:
            node = model.node_names[model.contacts[column - strings].node]
            what = f"node {node!r} touches and leaves the ground, or slips and sticks,"
        return SimulationError("chattering", f"{what} without end; look at the inputs just before", float(t))

    def _smooth_run(self, mode: Mode, t: float, y, end: float, pending: list[float]):
        """Integrate under one mode until the end, a transition, or too much drift.

        Records the rows on the way (popped from pending, which is in falling order).
        Returns time, state on the constraints, and the transition due or None.
        """
        solver = self._solver(mode, t, y, end, self.step_hint)
        watch = self._watch(mode, t, y)
        while solver.status == "running":
            t, y, proposed = solver.t, solver.y, solver.h_abs
            self._step(solver)
            watch_before, watch = watch, self._watch(mode, solver.t, solver.y)
            self.step_hint = max(solver.h_abs, proposed) if solver.t == end else solver.h_abs
            due = self._first_due(mode, t, watch_before, solver, watch)
            if due is not None:
                return self._land(mode, t, y, due, pending)
            self._record_rows(
                pending, [solver.dense_output()] if self._has_row(pending, solver.t) else [], solver.t, solver.y, mode
            )
            self._require_rope(t, solver.t, solver.y)
            deviation = instant.drift(self.s, *self.unpack(solver.t, solver.y))
            if not deviation <= BROKEN:
                raise self._failure(solver.t, f"a bar's length or rate has gone wrong by {deviation!r}")
            if deviation > DRIFT:
                break
        return solver.t, self.projected(solver.t, solver.y), None

    def _land(self, mode: Mode, t: float, y, due: _Due, pending: list[float]):
        """Repeat the step from t, y so that it ends at the transition: Newton steps on its instant."""
        if due.time <= t:
            return t, self.projected(t, y), due
        at = due.time
        for _ in range(8):
            solver, dense = self._solver(mode, t, y, at, at - t), []
            while solver.status == "running":
                self._step(solver)
                if self._has_row(pending, at):
                    dense.append(solver.dense_output())
            landed = self.projected(at, solver.y)
            watch = self._watch(mode, at, landed)
            gap, rate = watch.gap[due.row, due.column], watch.rate[due.row, due.column]
            better = at - gap / rate if rate < 0.0 else at
            if abs(gap) <= self.round_off[due.row, due.column] or better == at or not t < better <= at + 0.1 * (at - t):
                break
            at = better
        self._record_rows(pending, dense, at, solver.y, mode)
        return at, landed, due

    def _solver(self, mode: Mode, t: float, y, end: float, first_step: float):
        ydot = self.derivative(mode)
        if not np.isfinite(ydot(t, y)).all():
            raise self._failure(t, "a force is not finite")
        implicit = {"jac": self.jacobian(ydot)} if self.method.implicit else {}
        solver = getattr(scipy.integrate, self.method.solver)
        return solver(ydot, t, y, end, rtol=self.rtol, atol=self.atol, first_step=min(first_step, end - t), **implicit)

    def _step(self, solver) -> None:
        self.now = t = solver.t
        try:
            message = solver.step()
        except ValueError as failure:  # Radau's linear algebra refuses what is not finite
            raise self._failure(t, str(failure)) from failure
        self.stats["steps"] += 1
        self.steps_since_row += 1
        if self.steps_since_row > MAX_STEPS:
            raise self._failure(t, f"{MAX_STEPS} steps did not reach the next row")
        if solver.status == "failed" or not np.isfinite(solver.y).all():
            raise self._failure(t, message or "a value is not finite")
        if self.told:
            begin, end = self.inputs.times[0], self.inputs.times[-1]
            self.told((solver.t - begin) / (end - begin))

    @staticmethod
    def _failure(t: float, why: str) -> SimulationError:
        return SimulationError(
            "step_failed",
            f"SciPy cannot go on ({why}); look for a string whose ends meet, or for an excessive input or parameter",
            float(t),
        )

    def _require_rope(self, before: float, t: float, y) -> None:
        """Raises SimulationError where an actuator has wound all of its string; before: the last time at which it had not."""
        strings = self.s.motors.strings
        left = instant.rest_lengths(self.s, self.load, t, self.winding(y))[0][strings] if len(strings) else np.ones(1)
        if left.min() <= 0.0:
            name = self.s.model.string_names[strings[int(np.argmin(left))]]
            raise SimulationError(
                "wound_up", f"the actuator of string {name!r} has wound it up completely; lower its current", float(before)
            )

    # Transitions.

    def _watch(self, mode: Mode, t: float, y) -> _Watch:
        """Gaps and their rates; that of a clip by a one-sided difference along the motion."""
        strings = self.strings(t, y, mode)
        rate = np.stack((strings.rate, -strings.rate, np.zeros_like(strings.rate)))
        if self.s.model.damping_law == "tension_only":
            dt = 1e-8
            ahead = self.strings(t + dt, y + dt * self.derivative(mode)(t, y), mode).unclipped
            rate[2] = np.where(mode.clipped, -1.0, 1.0) * (ahead - strings.unclipped) / dt
        gap = gaps(self.s, mode, strings)
        if self.touching:
            of_contacts = self._watch_contacts(mode, t, y)
            return _Watch(np.hstack((gap, of_contacts.gap)), np.hstack((rate, of_contacts.rate)))
        return _Watch(gap, rate)

    def _watch_contacts(self, mode: Mode, t: float, y) -> _Watch:
        """Of contacts; the rate of what slips by a one-sided difference along the motion."""
        contacts, motion = self.s.contacts, self.motion(t, y, mode)
        gap = contacts.gaps(motion.touching, motion.slipping)
        rate = contacts.gap_rates(motion.touching, motion.slipping)
        slips = (mode.contact == SLIPPING) & np.isfinite(gap[2])
        if slips.any():
            dt = 1e-8
            ahead = self.motion(t + dt, y + dt * self.derivative(mode)(t, y), mode).slipping.slip
            rate[2, slips] = (ahead - motion.slipping.slip)[slips] / dt
        return _Watch(gap, rate)

    def _gaps(self, mode: Mode, t: float, y) -> np.ndarray:
        """(3, S + K): those of strings, and of contacts."""
        gap = gaps(self.s, mode, self.strings(t, y, mode))
        if not self.touching:
            return gap
        motion = self.motion(t, y, mode)
        return np.hstack((gap, self.s.contacts.gaps(motion.touching, motion.slipping)))

    def _first_due(self, mode: Mode, t: float, before: _Watch, solver, after: _Watch) -> _Due | None:
        """The first transition within the solver's last step, which began at t; None if there is none."""
        h = solver.t - t
        crossed = after.gap < -self.round_off
        turned = ~crossed & (before.rate < 0.0) & (after.rate > 0.0) & np.isfinite(after.gap)
        if turned.any():
            # The tangents at both ends meet below the lowest point; only if that is negative can the gap have closed.
            before_gap, after_gap = before.gap[turned], after.gap[turned]
            meet = (after_gap - before_gap - after.rate[turned] * h) / (before.rate[turned] - after.rate[turned])
            turned[turned] = before_gap + before.rate[turned] * meet < 0.0
        if not (crossed.any() or turned.any()):
            return None
        dense = solver.dense_output()
        times = np.linspace(t, solver.t, SAMPLES + 1)
        samples = np.array([self._gaps(mode, at, dense(at)) for at in times])
        passed = (samples[1:] < -self.round_off).any(axis=0)  # and back again, as the ends alone do not tell
        found = []
        for row, column in np.argwhere(crossed | turned | passed):

            def gap(at, row=row, column=column):
                return self._gaps(mode, at, dense(at))[row, column]

            at = _first_root(gap, times, samples[:, row, column], -self.round_off[row, column])
            if at is not None:
                found.append(_Due(at, int(row), int(column)))
        return min(found, default=None)

    def _after(self, mode: Mode, t: float, y, due: _Due) -> tuple[Mode, dict[int, float]]:
        """The mode after a transition, and the energy that snaps lose (J, by string); strings that reach the end of their
        piece at the same instant change with it."""
        watch = self._watch(mode, t, y)
        change = (watch.gap <= self.together) & (watch.rate < 0.0)
        change[due.row, due.column] = True
        contact = mode.contact
        if self.touching:
            motion, of_contacts = self.motion(t, y, mode), change[:, len(mode.piece) :]
            contact = contact_modes.changed(self.s.contacts, of_contacts, motion.touching, motion.slipping)
        change = change[:, : len(mode.piece)]
        piece = mode.piece - change[0] + change[1]
        branches, losses = dict(mode.branches), {}
        for j, branch in mode.branches.items():
            if change[0, j] or change[1, j]:
                branches[j], losses[j] = self._snapping(t, branch.above if change[1, j] else branch.below)
        return mode_of(self.s, piece, (mode.clipped ^ change[2]) & (piece > 0), branches, contact), losses

    def _on_cones(self, t: float, y, before: Mode, after: Mode):
        """y with the bristles that belong to the modes after."""
        y, slips = y.copy(), np.where(before.contact == SLIPPING, before.contact, after.contact)
        touching = self.contacts(t, y, after._replace(contact=slips))
        y[self.of_motors : self.moving] = contact_modes.bristles(before.contact, after.contact, touching).ravel()
        return y

    def _settled_on_ground(self, t: float, y, mode: Mode, losses: dict[int, float]):
        """Mode, losses and y at the start, or after a change of inputs; mode: `_settled`, with the contacts as before.

        Beyond the cone of friction u goes back to it and slips; what slips on may stick now.
        """
        contacts, before, motion = self.s.contacts, mode, self.motion(t, y, mode)
        mode = mode._replace(contact=contact_modes.pressed(contacts, motion.touching, motion.slipping))
        y = self._on_cones(t, y, before, mode)
        motion = self.motion(t, y, mode)
        sticks, slips = mode.contact == STICKING, (mode.contact == SLIPPING) & (before.contact == SLIPPING)
        beyond = sticks & (contacts.gaps(motion.touching, motion.slipping)[2] < 0.0)
        holds = slips & (contacts.mu > 0.0) & (motion.slipping.slip <= 0.0)
        contact = np.where(beyond, SLIPPING, np.where(holds, STICKING, mode.contact))
        y = self._on_cones(t, y, mode, mode._replace(contact=contact))
        mode, more = self._settled(t, y, mode._replace(contact=contact))
        return mode, {j: losses.get(j, 0.0) + more.get(j, 0.0) for j in losses | more}, y

    @staticmethod
    def _snapping(t: float, change, *arguments):
        """change(*arguments), a change of branch; without a stable state after it the run ends."""
        try:
            return change(*arguments)
        except NoStableState as failure:
            raise SimulationError("snapping", str(failure), float(t)) from failure

    def _followed(self, t: float, y, mode: Mode) -> tuple[Mode, dict[int, float]]:
        """The mode once every string with memory has followed to its elongation, and what snaps on the way lose, J.

        At the end of a branch a string goes where its rate leads, or its acceleration if it is at rest.
        """
        elongation, branches, losses = self.strings(t, y, mode).elongation, {}, {}
        for j, branch in mode.branches.items():
            branches[j], events = self._snapping(t, follow, branch, elongation.item(j))
            losses[j] = sum(event.loss for event in events)
        mode = mode_of(self.s, mode.piece, mode.clipped, branches, mode.contact)
        rates = self.strings(t, y, mode).rate
        for j, x in enumerate(elongation.tolist()):
            if j not in branches or mode.lower[j] + TOGETHER[0] < x < mode.upper[j] - TOGETHER[0]:
                continue
            leads = rates.item(j)
            if abs(leads) < AT_REST:
                leads = self.elongation_acceleration(t, y, mode).item(j)
            if leads > 0.0 and x >= mode.upper[j] - TOGETHER[0]:
                after, loss = self._snapping(t, branches[j].above)
            elif x <= mode.lower[j] + TOGETHER[0]:
                after, loss = self._snapping(t, branches[j].below)
                if leads >= 0.0 and after.taut:
                    continue
            else:
                continue
            branches[j] = after
            losses[j] += loss
        return mode_of(self.s, mode.piece, mode.clipped, branches, mode.contact), losses

    def _settled(self, t: float, y, mode: Mode) -> tuple[Mode, dict[int, float]]:
        """The mode at the start, or after a change of inputs, and the energy that snaps lose (J, by string).

        A string inside its piece keeps it.  At the end of a piece it goes where its rate leads, or its acceleration
        if it is at rest: at xi = xi0 it is taut only if it lengthens.
        """
        mode, losses = self._followed(t, y, mode) if mode.branches else (mode, {})
        strings = self.strings(t, y, mode)
        near = TOGETHER[0]
        inside = (strings.elongation > mode.lower + near) & (strings.elongation < mode.upper - near)
        if not inside.all():
            down = np.array([np.searchsorted(e, x - near) for e, x in zip(self.s.breakpoints, strings.elongation)])
            up = np.array([np.searchsorted(e, x + near) for e, x in zip(self.s.breakpoints, strings.elongation)])
            leads, unclipped = strings.rate, mode.clipped & inside
            resting = (np.abs(strings.rate) < AT_REST) & (up > down)
            if resting.any():
                lowest = mode_of(self.s, np.where(inside, mode.piece, down), unclipped, mode.branches, mode.contact)
                leads = np.where(resting, self.elongation_acceleration(t, y, lowest), leads)
            piece = np.where(inside, mode.piece, np.where(leads > 0.0, up, down))
            mode = mode_of(self.s, piece, unclipped, mode.branches, mode.contact)
        if self.s.model.damping_law == "tension_only":
            tension = self.strings(t, y, mode).unclipped
            clipped = np.where(np.abs(tension) <= TOGETHER[2], mode.clipped, tension < 0.0)
            mode = mode_of(self.s, mode.piece, clipped & (mode.piece > 0), mode.branches, mode.contact)
        return mode, losses

    def _note(self, t: float, y, before: Mode, after: Mode, losses: dict[int, float]):
        """Record the changes of piece and the snaps; returns y with what they lose among the dissipated energy."""
        lost = np.zeros(len(before.piece))
        lost[list(losses)] = list(losses.values())
        for j in np.flatnonzero((before.piece != after.piece) | (lost > 0.0)):
            pieces = int(before.piece[j]), int(after.piece[j])
            self.transitions.append(Transition(float(t), int(j), *pieces, float(lost[j])))
        for i in np.flatnonzero(before.contact != after.contact):
            modes = int(before.contact[i]), int(after.contact[i])
            self.transitions.append(Transition(float(t), -1, *modes, contact=int(i)))
        total = lost.sum()
        return y + np.concatenate((np.zeros(self.moving), [0.0, total, total])) if total else y

    # Rows of the result.

    @staticmethod
    def _has_row(pending: list[float], t: float) -> bool:
        return bool(pending) and pending[-1] < t

    def _record_rows(self, pending: list[float], dense: list, t: float, y, mode: Mode) -> None:
        """Record the rows up to t, where the state is y; rows before t from the dense outputs that lead there."""
        while pending and pending[-1] <= t:
            row = pending.pop()
            state = y if row == t else next(d for d in dense if row <= d.t)(row)
            self._record(row, self.projected(row, state), mode)

    def _record(self, t: float, y, mode: Mode) -> None:
        s, model = self.s, self.s.model
        self.steps_since_row = 0
        (N, Ndot), winding = self.unpack(t, y), self.winding(y)
        motion = motion_at(s, self.load, mode, t, N, Ndot, winding, bristle=self.bristle(y))
        strings, laws = motion.strings, s.laws | mode.branches
        bar_force = -motion.lam * model.bar_length
        self.rows.append(
            dict(
                position=N.T,
                velocity=np.where(model.held.T, 0.0, Ndot).T,
                string_force=strings.tension,
                elastic_force=strings.elastic,
                string_length=strings.xi,
                bar_force=bar_force,
                bar_utilisation=bar_utilisation(model, bar_force),
                string_utilisation=string_utilisation(model, strings.tension),
                reaction=motion.ground.T,
                wound_rest_length=instant.rest_lengths(s, self.load, t, winding)[0][s.motors.strings],
                wound_rest_length_rate=-s.motors.radius * winding[1],
                motor_speed=winding[1],
                **self._of_contacts(motion),
                kinetic=instant.kinetic_energy(s, Ndot, winding),
                potential=instant.potential_energy(s, N),
                elastic=instant.elastic_energy(s, strings.elongation, mode.branches) + self._pressed(motion),
                input_work=y[-3],
                dissipated=y[-2],
                throughput=y[-1],
                snapped=[laws[j].snapped_on_piece(mode.piece.item(j)) for j in model.nsh_strings],
            )
        )

    def _pressed(self, motion: Motion) -> float:
        """J, in the ground."""
        return self.s.contacts.energy(motion.touching) if motion.touching is not None else 0.0

    def _of_contacts(self, motion: Motion) -> dict[str, np.ndarray]:
        """The outputs of contacts."""
        if motion.touching is None:
            return {"contact_normal": np.zeros(0), "contact_force": np.zeros((0, 3)), "contact_sticking": np.zeros(0)}
        force = self.s.contacts.plane.dot(motion.touching.friction).T
        sticking = (motion.touching.mode == STICKING).astype(float)
        return {"contact_normal": motion.touching.normal, "contact_force": force, "contact_sticking": sticking}


def _first_root(gap, times: np.ndarray, values: np.ndarray, level: float) -> float | None:
    """First instant at which gap(t) falls through zero; None if it stays above `level`.

    values: gap at times.  A start at or below zero counts as zero unless the gap opens first.
    """
    below = np.flatnonzero(values[1:] < level) + 1
    if len(below):
        low, high = times[below[0] - 1], times[below[0]]
    else:
        k = int(np.argmin(values))
        low, high = times[max(k - 1, 0)], times[min(k + 1, len(times) - 1)]
        options = {"xatol": 1e-9 * (high - low)}
        lowest = scipy.optimize.minimize_scalar(gap, bounds=(low, high), method="bounded", options=options)
        if lowest.fun >= level:
            return None
        high = float(lowest.x)
    for _ in range(60):
        if gap(low) > 0.0:
            return float(scipy.optimize.brentq(gap, low, high, xtol=1e-300, rtol=1e-15))
        if low > times[0]:
            return float(low)
        # The gap is closed at the start: has it opened since?
        high_half = 0.5 * (times[0] + high)
        if gap(high_half) > 0.0:
            low = high_half
        else:
            high = high_half
    return float(times[0])


def simulate(
    model: Model,
    inputs: Inputs,
    rtol: float = 1e-10,
    atol: float = 1e-11,
    method: str = "auto",
    told: Callable[[float], object] | None = None,
) -> Result:
    """Simulate a tensegrity under held inputs; see Result for what comes back.

    rtol, atol (m): SciPy's tolerances per step, adapted to the method as METHODS says; method: 'auto' (Radau where the
    dampers make the equations stiff, else DOP853) or a name in METHODS; told: gets the part of the time that is done, 0 to 1,
    after every step.  With the defaults the article's three-bar
    scene under +-400 N, d = 50, 500, 5000 N s/m, is good to 1e-9 m after 5 s.
    throughput adds up |F . v| per node, |R . v| per moved node, |T dxi0/dt| and |(T - f_s) d(xi - xi0)/dt| per string, c v^2
    per node with drag, |N h'|, |(N - k_n delta) delta'| and |mu N gamma'| per contact, |k_a i delta'| and d_a delta'^2 per
    actuator, and the absolute values of jumps of stored energy.
    A start input that gives a moved node another velocity than the model's is a jump, too, but before the ledger begins.
    Raises InputError for a model or inputs outside the equations' range, SimulationError where the run cannot go on, which
    includes a string that its actuator has wound up ('wound_up'), bars that come into a position in which no finite force keeps
    their lengths ('singular'), and those that cannot all keep them ('contradictory').
    """
    if method not in ("auto", *METHODS):
        raise InputError(f"method = {method!r}: use 'auto' or one of {', '.join(METHODS)}")
    rtol, atol = number("rtol", rtol), number("atol", atol)
    _check_inputs(model, inputs)
    require_cranks(model, inputs)
    run = _Run(model, inputs.resolved(model), rtol, atol, method, told)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # every step is checked to be finite
        try:
            run.go()
        except Singular as failure:
            raise _singular(run, failure) from failure
    series = {name: np.array([row[name] for row in run.rows]) for name in run.rows[0]}
    for field in outputs(INTEGER_FIELDS):
        series[field.name] = series[field.name].reshape(len(run.rows), -1).astype(int)
    stats = {name: float(value) for name, value in run.stats.items()}
    return Result(np.array(inputs.times, dtype=float), run.transitions, stats, **series)


def _singular(run: _Run, failure: Singular) -> SimulationError:
    names = run.s.joints.named(failure.parts) if run.s.joints else ""
    why = f"no finite force keeps the lengths of bars {names}, which have come into one line or plane"
    return SimulationError("singular", f"{why}; keep them away from there", float(run.now))


def _check_inputs(model: Model, inputs: Inputs) -> None:
    steps = len(inputs.times) - 1
    if steps < 1 or not (np.diff(inputs.times) > 0.0).all():
        raise InputError(f"times = {inputs.times!r}: give at least two increasing times")
    for name, field in INPUTS.items():
        value, shape = getattr(inputs, name), (steps, *full_shape(field, model))
        if value is None:
            continue
        if value.shape != shape:
            raise InputError(f"{name} has shape {value.shape}; this model and these times need {shape}")
        if not np.isfinite(value).all():
            raise InputError(f"{name} holds a value that is not finite; use finite numbers")
    least = float(inputs.resolved(model).rest_length.min(initial=0.0))
    if least < 0.0:
        raise InputError(f"rest_length = {least!r} m: a rest length cannot be negative; use >= 0")
