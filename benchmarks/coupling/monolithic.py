"""The whole loop as one system of differential equations: the reference's equations of the structure, the winches' and the
controllers', integrated by SciPy.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.integrate import solve_ivp

from tensegrity_core.model import grid, held
from tensegrity_core.reference import instant
from tensegrity_core.reference.structure import Structure

from .system import PAIRS, Loop, structure


class Monolith:
    """State: N and Ndot of the free nodes (3, F) each, rest lengths of the winches (3,), filtered heights (3,), their integrals
    (3,)."""

    def __init__(self, loop: Loop):
        self.loop, self.model = loop, structure()
        self.s = Structure(self.model)
        self.free = self.model.free_nodes
        self.strings = [self.model.string_names.index(string) for string in PAIRS.values()]
        self.nodes = [self.model.node_names.index(node) for node in PAIRS]
        self.rest = self.model.rest_length[self.strings]
        self.target = self.model.nodes[self.nodes, 2] + loop.raised
        force = np.zeros((len(self.model.nodes), 3))
        force[self.nodes, 2] = [-load for load in loop.load]
        self.load = instant.load_of(self.s, held(self.model, grid(1.0, 1.0), lambda t: force), 0)
        taut = np.ones(len(self.model.strings), dtype=int)
        self.mode = instant.mode_of(self.s, taut, taut == 0)

    def start(self) -> np.ndarray:
        N = self.model.nodes[self.free].T
        return np.concatenate((N.ravel(), np.zeros(N.size), self.rest, self.model.nodes[self.nodes, 2], np.zeros(3)))

    def unpack(self, y):
        """N, Ndot (3, n) of all nodes, and the rest: winches, filtered heights, integrals (3, 3)."""
        N, Ndot = self.model.nodes.T.copy(), np.zeros((3, len(self.model.nodes)))
        count = 3 * len(self.free)
        N[:, self.free], Ndot[:, self.free] = y[:count].reshape(3, -1), y[count : 2 * count].reshape(3, -1)
        return N, Ndot, y[2 * count :].reshape(3, 3)

    def rates(self, wound, filtered, integral) -> np.ndarray:
        """(3,) m/s: of the winches' rest lengths."""
        loop = self.loop
        command = self.rest - loop.gain * (self.target - filtered) - loop.integral_gain * integral
        return np.clip((command - wound) / loop.time_constant, -loop.rate_limit, loop.rate_limit)

    def __call__(self, t, y) -> np.ndarray:
        N, Ndot, (wound, filtered, integral) = self.unpack(y)
        rates = self.rates(wound, filtered, integral)
        length, length_rate = self.model.rest_length.copy(), np.zeros(len(self.model.strings))
        length[self.strings], length_rate[self.strings] = wound, rates
        load = replace(self.load, since=t, rest_length=length, rest_length_rate=length_rate)
        Nddot = instant.motion_at(self.s, load, self.mode, t, N, Ndot, ground=False).Nddot
        heights = N[2, self.nodes]
        others = rates, (heights - filtered) / self.loop.filter_time, self.target - filtered
        return np.concatenate((Ndot[:, self.free].ravel(), Nddot[:, self.free].ravel(), *others))

    def least_elongation(self, y) -> float:
        """m, of any string: the equations hold while all are taut."""
        N, Ndot, (wound, *_) = self.unpack(y)
        length = self.model.rest_length.copy()
        length[self.strings] = wound
        load = replace(self.load, since=0.0, rest_length=length)
        return float(instant.strings_at(self.s, load, self.mode, 0.0, N, Ndot).elongation.min())


def heights(loop: Loop, times: np.ndarray, method: str = "DOP853", rtol: float = 1e-11, atol: float = 1e-12) -> np.ndarray:
    """(K, 3) m at these times.  Raises ValueError where a string would go slack."""
    whole = Monolith(loop)
    found = solve_ivp(whole, (times[0], times[-1]), whole.start(), method, times, rtol=rtol, atol=atol)
    if not found.success:
        raise ValueError(found.message)
    if (least := min(whole.least_elongation(y) for y in found.y.T)) <= 0.0:
        raise ValueError(f"a string goes slack ({least:.3g} m), which this loop is not made for")
    return np.array([whole.unpack(y)[0][2, whole.nodes] for y in found.y.T])
