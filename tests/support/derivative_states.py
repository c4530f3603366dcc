"""Random states of a kernel's continuous-time view on chosen pieces, and differences there: what analytic derivatives are held
against."""

from __future__ import annotations

import numpy as np

from tensegrity_core.kernel import Kernel
from tensegrity_core.kernel.continuous import DISCRETE_CHANGED, ContinuousView
from tensegrity_core.kernel.derivatives import Derivatives

TUNABLE = ("stiffness", "damping", "gravity", "drag")
#: Spreads of random inputs, and steps of differences by them: small beside the pieces of force curves, large beside round-off.
INPUTS = {
    "force": (20.0, 1.0),
    "rest_length": (0.0, 5e-5),
    "rest_length_rate": (0.3, 1e-3),
    "current": (2.0, 0.1),
    "drum_load": (2.0, 1.0),
    "node_position": (0.05, 5e-5),
    "node_velocity": (2.0, 1e-3),
    "node_acceleration": (2.0, 1.0),
}


class Bench:
    """One model's view with its derivatives.  x: (n,) the state at hand; pieces: how strings were borne in all states so far:
    (string, place in order of the elongation, clipped)."""

    def __init__(self, model, seed: int = 1):
        self.model, self.random = model, np.random.default_rng(seed)
        self.kernel = Kernel(model)
        self.kernel.initialize()
        self.view = ContinuousView(self.kernel)
        self.derivatives = Derivatives(self.view)
        self.start, self.half = self.view.states, (self.view.size - 2) // 2
        self.values = self.kernel.values.copy()
        self.kinked = np.zeros(self.derivatives.unknowns, dtype=bool)  # utilisations, which have a kink where the load ends
        for field in ("bar_utilisation", "string_utilisation"):
            first = self.kernel.layout[field].start - self.kernel.first_output + self.derivatives.outputs.start
            self.kinked[first : first + len(self.kernel[field])] = True
        self.pieces: set[tuple[int, int, bool]] = set()

    def tunable(self, field: str) -> bool:
        return field in TUNABLE and not (field == "stiffness" and self.model.memories)

    def shake(self, trial: int) -> None:
        """Another state, other inputs and tunables; each string comes to its next piece."""
        kernel, view, random = self.kernel, self.view, self.random
        kernel.values[:] = self.values
        self.x = self.start + np.r_[random.normal(size=self.half) * 0.1, random.normal(size=self.half), random.normal(size=2)]
        view.set(0.0, self.x)
        for field, (spread, _) in INPUTS.items():
            kernel[field][:] += spread * random.normal(size=len(kernel[field]))
        view.enter_event()
        for field in filter(self.tunable, TUNABLE):
            kernel[field][:] = (kernel[field] + (field == "damping")) * random.uniform(0.7, 1.3, size=len(kernel[field]))
        view.update_discrete()
        view.outputs()
        lengths, ends = kernel["string_length"].copy(), [kernel.breakpoints(s) for s in range(len(self.model.strings))]
        places = [(trial + s) % (len(e) + 1) for s, e in enumerate(ends)]
        for s, (e, p) in enumerate(zip(ends, places)):
            first, last = (e[0], e[-1]) if len(e) else (0.0, 0.0)  # a string that also pushes has one piece
            low, high = e[p - 1] if p else first - 0.02, e[p] if p < len(e) else last + 0.02
            at = random.uniform(low + 0.2 * (high - low), high - 0.2 * (high - low))
            kernel["rest_length"][s] = max(lengths[s] - at, 0.01)
        view.enter_event()
        view.update_discrete()
        self.x = view.states
        view.outputs()
        clipped = (kernel["string_force"] == 0.0) & (kernel["elastic_force"] > 0.0)
        self.pieces |= set(zip(range(len(places)), places, clipped.tolist()))

    def unknowns(self) -> np.ndarray:
        """What is differentiated, as the view gives it."""
        rates = self.view.derivatives()
        self.view.outputs()
        outputs = self.kernel.values[self.kernel.first_output :]
        return np.concatenate([self.view.states, rates, outputs, self.view.event_indicators()])

    def put(self, j: int, value: float) -> None:
        """Known number j; tunables by way of an event."""
        n = self.view.size
        if j < n:
            x = self.x.copy()
            x[j] = value
            self.view.set(0.0, x)
        elif self.kernel.place(j - n)[0] in TUNABLE:
            self.view.enter_event()
            self.kernel.values[j - n] = value
            self.left |= bool(self.view.update_discrete() & DISCRETE_CHANGED)
            self.view.set(0.0, self.x)
        else:
            self.kernel.values[j - n] = value

    def column(self, j: int) -> tuple[np.ndarray, float]:
        """Derivatives by known number j, from central differences extrapolated twice (their error goes with the sixth power of
        the step), and the step.  `left` says whether a string left its piece meanwhile, so that they mean nothing; of a
        utilisation that ends or begins meanwhile, NaN."""
        self.left = False
        n = self.view.size
        value = self.x[j] if j < n else self.kernel.values[j - n]
        field = "" if j < n else self.kernel.place(j - n)[0]
        h = (5e-5 if j < self.half else 1e-3) if j < n else INPUTS.get(field, (0.0, 1e-2 * max(abs(value), 1.0)))[1]
        h *= 0.02 if self.model.memories and h == 5e-5 else 1.0  # folds are near
        found = []
        for step in (h, h / 2.0, h / 4.0):
            self.put(j, value + step)
            above = self.unknowns()
            self.put(j, value - step)
            below = self.unknowns()
            found.append((above - below) / (2.0 * step))
            found[-1][self.kinked & ((above > 0.0) != (below > 0.0))] = np.nan
        self.put(j, value)
        self.view.set(0.0, self.x)
        first, second = (4.0 * found[1] - found[0]) / 3.0, (4.0 * found[2] - found[1]) / 3.0
        return (16.0 * second - first) / 15.0, h
