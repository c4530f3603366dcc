"""First derivatives of a kernel's continuous-time view, as products of their Jacobian or of its transpose with a vector."""

from __future__ import annotations

import numpy as np

from ..quantities import array_of
from .binding import _pointer
from .continuous import ContinuousView


class Derivatives:
    """Of states, their derivatives, real outputs and event indicators (the unknowns), by states, inputs and parameters (the
    knowns), analytic: each string stays on the piece that it is on.

    knowns, unknowns: how many there are; states, derivatives, outputs, indicators: their places among the unknowns;
    states are the first knowns, and `values` are the places of inputs and parameters, in the order of `Kernel.values`.
    """

    def __init__(self, view: ContinuousView):
        self.view, self.kernel, self._library, self._sim = view, view.kernel, view._library, view._sim
        self.knowns: int = self._library.ts_known_count(self._sim)
        self.unknowns: int = self._library.ts_unknown_count(self._sim)
        n, first = view.size, view.kernel.first_output
        outputs = len(view.kernel.values) - first
        self.states, self.derivatives = slice(0, n), slice(n, 2 * n)
        self.outputs, self.indicators = slice(2 * n, 2 * n + outputs), slice(2 * n + outputs, self.unknowns)
        self.values = slice(n, n + first)
        size = self._library.ts_derivatives_size(self._sim)
        self._work = np.empty(size // 8 + 1)
        self.kernel._require(self._library.ts_share_derivatives(self._sim, self._work.ctypes.data, size))

    def look(self, start: bool = False) -> None:
        """Differentiate at the present time, states and inputs; start: what `Kernel.initialize` has just computed, by start
        values and fixed parameters, too.  Fills the outputs.  Raises InputError or SimulationError where there is nothing to
        differentiate."""
        self.kernel._require(self._library.ts_differentiate(self._sim, int(start), self._work.ctypes.data))

    def known(self, field: str) -> slice:
        """Places of an input or a parameter among the knowns."""
        at = self.kernel.layout[field]
        return slice(self.view.size + at.start, self.view.size + at.stop)

    def output(self, field: str) -> slice:
        """Places of an output among the unknowns."""
        at, shift = self.kernel.layout[field], self.outputs.start - self.kernel.first_output
        return slice(at.start + shift, at.stop + shift)

    def differentiable(self, known: int) -> bool:
        """False for parameters of which a force curve is compiled, and fields without rows: derivatives by them are not
        provided, and taken as 0."""
        return bool(self._library.ts_differentiable(self._sim, known))

    def differentiated(self, unknown: int) -> bool:
        """False for an output without rows in native/motion: its derivatives are not provided, and taken as 0."""
        return bool(self._library.ts_differentiated(self._sim, unknown))

    def directional(self, seed: np.ndarray) -> np.ndarray:
        """(unknowns,) their derivatives along a direction (knowns,), where `look` has been."""
        return self._product(self._library.ts_directional, seed, self.knowns, self.unknowns)

    def adjoint(self, seed: np.ndarray) -> np.ndarray:
        """(knowns,) derivatives of the sum of the unknowns, weighted by seed (unknowns,)."""
        return self._product(self._library.ts_adjoint, seed, self.unknowns, self.knowns)

    def _product(self, call, seed: np.ndarray, given: int, found: int) -> np.ndarray:
        seed, out = array_of("the seed", seed, (given,)), np.empty(found)
        self.kernel._require(call(self._sim, self._work.ctypes.data, _pointer(seed), _pointer(out)))
        return out

    def matrix(self) -> np.ndarray:
        """(unknowns, knowns) all of them, column by column."""
        return np.stack([self.directional(column) for column in np.eye(self.knowns)], axis=1)
