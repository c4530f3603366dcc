"""A mass on a spring and a damper in one dimension, the spring being linear or an NSH: experiment IV of the article (eq. 15).

M x'' + B x' + f(x) = f_ext.  It is no tensegrity: there is no bar, and the spring also pushes (f(-x) = -f(x)); nothing goes
slack.  The spring's law is the exact one of `laws`; integration stops at each end of its pieces and starts anew there.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from ..errors import InputError
from ..laws import law
from ..laws.law import Law
from ..model.elements import Element, Spring
from ..quantities import number

RTOL, ATOL = 1e-12, 1e-14  # of the steps; m and m/s


@dataclass(frozen=True)
class Oscillator:
    """mass: kg; stiffness: N/m, of the spring, or of what carries once its element has bottomed out; damping: N.s/m; element:
    of beams, say, without memory; None: a linear spring."""

    mass: float
    stiffness: float
    damping: float
    element: Element | None = None

    def __post_init__(self):
        for name in ("mass", "stiffness", "damping"):
            object.__setattr__(self, name, number(name, getattr(self, name)))
        for name, least in (("mass", "greater than 0"), ("stiffness", "at least 0"), ("damping", "at least 0")):
            value = getattr(self, name)
            if not (np.isfinite(value) and (value > 0.0 or (value == 0.0 and name != "mass"))):
                raise InputError(f"{name} = {value!r} is not {least}; give a finite number that is")
        _ = self.law  # which refuses what is no spring

    @cached_property
    def law(self) -> Law:
        """Of the spring where it is pulled; pushed, it is the same in the other direction."""
        return law(self.element or Spring(self.stiffness), self.stiffness)

    @cached_property
    def breakpoints(self) -> list[float]:
        """m: ends of the pieces of f, increasing and symmetric to 0, which is one of them."""
        ends = self.law.breakpoints
        return [-x for x in ends[:0:-1]] + list(ends)

    def piece(self, x: float, velocity: float, force: float) -> int:
        """Number of the piece: breakpoints[piece - 1] to breakpoints[piece]; on a breakpoint the one that the motion enters,
        from rest under the external force (N)."""
        at = bisect_left(self.breakpoints, x)
        on = at < len(self.breakpoints) and self.breakpoints[at] == x
        return at + 1 if on and (velocity or force - self.spring_force(at, x)) > 0.0 else at

    def spring_force(self, piece: int, x: float) -> float:
        """f by the formula of one piece, N."""
        zero = len(self.breakpoints) // 2
        if piece > zero:
            return self.law.force_on_piece(piece - zero, x)
        return -self.law.force_on_piece(zero - piece + 1, -x)

    def stored(self, x: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """J: energy in mass and spring at positions and velocities, m and m/s."""
        return 0.5 * self.mass * velocity**2 + np.vectorize(self.law.energy, otypes=[float])(np.abs(x))


@dataclass(frozen=True, eq=False)
class Motion:
    """times: (K+1,) s; position, velocity: (K+1,) m, m/s; force: (K,) N, held over the steps.

    largest_position, largest_power: m and W, over the whole motion, also between the points and on either side of a jump of
    the force.
    """

    times: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    force: np.ndarray
    largest_position: float
    largest_power: float

    @property
    def power(self) -> np.ndarray:
        """(K+1,) W: velocity times external force; at a communication point with the force of the step that led there."""
        return self.velocity * np.concatenate((self.force[:1], self.force))

    @property
    def absorbed(self) -> np.ndarray:
        """(K+1,) J: the integral of the external power; exact, as the force is constant between the points."""
        return np.concatenate(([0.0], np.cumsum(self.force * np.diff(self.position))))


def simulate(oscillator: Oscillator, times: np.ndarray, force: np.ndarray) -> Motion:
    """The motion from rest at x = 0 under held forces.  times: (K+1,) s, increasing; force: (K,) N.

    Raises InputError where the shapes do not fit.
    """
    times, force = np.asarray(times, dtype=float), np.asarray(force, dtype=float)
    if times.ndim != 1 or len(times) < 2 or force.shape != (len(times) - 1,):
        raise InputError(f"times have the shape {times.shape} and force {force.shape}; give (K+1,) and (K,), K at least 1")
    states = np.zeros((len(times), 2))
    switches = [0, *(np.flatnonzero(np.diff(force)) + 1), len(force)]
    position, power = 0.0, 0.0
    for first, last in pairwise(switches):  # the force is constant from times[first] to times[last]
        rows, held = slice(first, last + 1), float(force[first])
        states[rows], extremes = _segment(oscillator, times[rows], held, states[first])
        position, power = max(position, extremes[:, 0].max()), max(power, (held * extremes[:, 1]).max())
    return Motion(times, states[:, 0], states[:, 1], force, float(position), float(power))


def _segment(oscillator: Oscillator, times: np.ndarray, force: float, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(len(times), 2) states under a constant force, from the state at times[0]; and (n, 2) those where position or velocity
    may be largest: at both ends, and where the velocity or the acceleration is zero."""
    from scipy.integrate import solve_ivp  # here, since the command imports this module and it would slow every start

    found, t, row, extremes = np.empty((len(times), 2)), times[0], 0, [state]
    while True:
        piece = oscillator.piece(state[0], state[1], force)

        def rates(t, y, piece=piece):
            return y[1], (force - oscillator.damping * y[1] - oscillator.spring_force(piece, y[0])) / oscillator.mass

        events = [*_ends(oscillator, piece), lambda t, y: y[1], lambda t, y, rates=rates: rates(t, y)[1]]
        run = solve_ivp(rates, (t, times[-1]), state, method="DOP853", rtol=RTOL, atol=ATOL, events=events, dense_output=True)
        t, state = run.t[-1], run.y[:, -1]
        extremes += [state, *(y for turns in run.y_events[2:] for y in turns)]
        stop = np.searchsorted(times, t, side="right")
        if stop > row:
            found[row:stop] = run.sol(times[row:stop]).T
            row = stop
        if run.status == 0:
            return found, np.array(extremes)
        state = np.array([oscillator.breakpoints[piece if len(run.t_events[1]) else piece - 1], state[1]])


def _ends(oscillator: Oscillator, piece: int) -> list:
    """Terminal events where x leaves the piece: below, then above; those that cannot happen never cross."""
    ends = [-np.inf, *oscillator.breakpoints, np.inf]

    def leaving(end: float, direction: float) -> Any:
        def gap(t, y):
            return y[0] - end if np.isfinite(end) else -direction

        event: Any = gap  # what SciPy asks of an event stands on the function
        event.terminal, event.direction = True, direction
        return event

    return [leaving(ends[piece], -1.0), leaving(ends[piece + 1], 1.0)]
