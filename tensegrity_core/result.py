"""What a simulation returns, whoever ran it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Transition:
    """A string changed its piece: piece 0 is slack, 1.. the pieces of its force curve in order of elongation.

    A string with memory is on piece 1 plus the number of its snapped parts; loss: energy that a snap of it loses, J.
    """

    time: float
    string: int
    before: int
    after: int
    loss: float = 0.0


@dataclass
class Result:
    """Series at the communication points times (K+1,), s.  Values are those at the end of the step that led there;
    row 0 is the start under the inputs of step 0.

    position, velocity: (K+1, N, 3) m, m/s; string_force (elastic and damping), elastic_force: (K+1, S) N;
    string_length: (K+1, S) m; bar_force: (K+1, B) N, tension positive, -lambda l of eq. 1 (the mean over the bar);
    reaction: (K+1, N, 3) N, zero at free nodes; kinetic, potential, elastic, dissipated, input_work, throughput: (K+1,) J;
    snapped: (K+1, H) int, beams past their force maximum; wound_rest_length, wound_rest_length_rate, motor_speed: (K+1, A) m,
    m/s, rad/s, of the strings with an actuator; velocities are zero at fixed nodes, moved or not; transitions: in order of
    time; stats: counters of the run.
    """

    times: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    string_force: np.ndarray
    elastic_force: np.ndarray
    string_length: np.ndarray
    bar_force: np.ndarray
    reaction: np.ndarray
    kinetic: np.ndarray
    potential: np.ndarray
    elastic: np.ndarray
    dissipated: np.ndarray
    input_work: np.ndarray
    throughput: np.ndarray
    snapped: np.ndarray
    transitions: list[Transition] = field(default_factory=list)
    stats: dict[str, float] = field(default_factory=dict)
    wound_rest_length: np.ndarray = None
    wound_rest_length_rate: np.ndarray = None
    motor_speed: np.ndarray = None

    def __post_init__(self):
        for name in ("wound_rest_length", "wound_rest_length_rate", "motor_speed"):
            if getattr(self, name) is None:
                setattr(self, name, np.zeros((len(self.times), 0)))

    def ledger_error(self) -> float:
        """Largest gap in the energy ledger over the run, relative to max(1 J, integral of the sum of |power|)."""
        balance = self.kinetic + self.potential + self.elastic + self.dissipated - self.input_work
        return float(np.max(np.abs(balance - balance[0])) / max(1.0, float(self.throughput[-1])))
