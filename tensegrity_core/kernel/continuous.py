"""The continuous-time view of a kernel's simulation, for a solver outside of the kernel."""

from __future__ import annotations

from ctypes import byref, c_int32

import numpy as np

from ..errors import InputError
from ..quantities import array_of, number
from .binding import Kernel, _pointer

#: What `update_discrete` says that it changed.
STATES_CHANGED, DISCRETE_CHANGED = 1, 2


class ContinuousView:
    """A simulation that `Kernel.initialize` has started, integrated by somebody else instead of by `Kernel.step`.

    Set time, states and inputs (in `kernel.values`) of the same instant, then ask for derivatives, outputs (they come into
    `kernel.values`) or event indicators.  One that becomes negative asks for an event: `enter_event`, inputs that jump and
    tunable parameters then, `update_discrete`.  All calls raise InputError or SimulationError like those of `Kernel`.

    size, indicators: how many states and event indicators there are; nominals: (size,) typical sizes of the states.
    """

    def __init__(self, kernel: Kernel):
        if kernel.counts["K"]:
            raise InputError("a host's own solver (model exchange) does not know the ground yet; step the kernel instead")
        self.kernel, self._library, self._sim = kernel, kernel._library, kernel._sim
        self.size: int = self._library.ts_continuous_count(self._sim)
        self.indicators: int = self._library.ts_indicator_count(self._sim)
        self.nominals = np.empty(self.size)
        self._library.ts_continuous_nominals(self._sim, _pointer(self.nominals))

    def _filled(self, call, size: int) -> np.ndarray:
        out = np.empty(size)
        self.kernel._require(call(self._sim, _pointer(out)))
        return out

    @property
    def states(self) -> np.ndarray:
        """(size,) [q, q', dissipated, input work]: coordinates (m), rates (m/s), energies (J)."""
        return self._filled(self._library.ts_continuous_states, self.size)

    def set(self, time: float, states: np.ndarray) -> None:
        """Put time (s) and states (size,)."""
        x = array_of("the states", states, (self.size,))
        self.kernel._require(self._library.ts_set_time(self._sim, number("time", time)))
        self.kernel._require(self._library.ts_set_continuous_states(self._sim, _pointer(x)))

    def derivatives(self) -> np.ndarray:
        """(size,) of the states by time, unit/s."""
        return self._filled(self._library.ts_continuous_derivatives, self.size)

    def outputs(self) -> None:
        """Fills the outputs in `kernel.values` and `kernel.integers`."""
        self.kernel._require(self._library.ts_continuous_outputs(self._sim))

    def event_indicators(self) -> np.ndarray:
        """(indicators,) per string: to the lower and to the upper end of its piece, m, and under `tension_only` to being
        clipped or released, N."""
        return self._filled(self._library.ts_event_indicators, self.indicators)

    def completed_step(self) -> bool:
        """After a step of the solver: is an event needed, because the bars' lengths have drifted?"""
        return bool(self._library.ts_completed_step(self._sim))

    def enter_event(self) -> None:
        """From here on inputs may jump and tunable parameters change."""
        self.kernel._require(self._library.ts_enter_event(self._sim))

    def update_discrete(self) -> int:
        """Take the jumps and put strings on the pieces and bars on the lengths that follow; returns STATES_CHANGED and
        DISCRETE_CHANGED as bits."""
        changed = c_int32(0)
        self.kernel._require(self._library.ts_update_discrete(self._sim, byref(changed)))
        return changed.value
