"""Fixed-step methods: their stability functions, and one step on a linear problem.

On y' = lambda y a step multiplies y by R(h lambda); it is stable where |R| <= 1.  ROS2 is the two-stage Rosenbrock method
of Verwer, Spee, Blom and Hundsdorfer, "A second-order Rosenbrock method applied to photochemical dispersion problems",
SIAM J. Sci. Comput. 20 (1999) 1456-1480, DOI 10.1137/S1064827597326651; with gamma = 1 +- 1/sqrt(2) it is L-stable.
The kernel takes the larger one in a step that spans more than three radians of a string's oscillation.
The others: Hairer and Wanner, "Solving Ordinary Differential Equations II", 1996, section IV.2.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import lu_factor, lu_solve

#: The gamma with the smaller error, and the one that damps more.
GAMMA = 1.0 - 1.0 / math.sqrt(2.0)
GAMMA_LARGE = 1.0 + 1.0 / math.sqrt(2.0)


class Method(NamedTuple):
    """label; stability: R(z), elementwise; step: (f, jacobian, y, h) -> y after the step, f(y) and jacobian(y) being the
    right-hand side and its derivative (which explicit methods ignore, and ROS2 needs only roughly to keep its order), None
    where only R is of use; implicit: whether it solves a linear system."""

    label: str
    stability: Callable
    step: Callable | None
    implicit: bool


def _rk4(f, jacobian, y, h):
    k1 = f(y)
    k2 = f(y + 0.5 * h * k1)
    k3 = f(y + 0.5 * h * k2)
    k4 = f(y + h * k3)
    return y + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


def _ros2(gamma):
    def step(f, jacobian, y, h):
        factors = lu_factor(np.eye(len(y)) - gamma * h * jacobian(y))
        k1 = lu_solve(factors, f(y))
        k2 = lu_solve(factors, f(y + h * k1) - 2.0 * k1)
        return y + h * (1.5 * k1 + 0.5 * k2)

    return step


def _ros2_stability(gamma):
    def R(z):
        return (1.0 + (1.0 - 2.0 * gamma) * z + (0.5 - 2.0 * gamma + gamma**2) * z**2) / (1.0 - gamma * z) ** 2

    return R


METHODS = {
    "euler": Method("explicit Euler", lambda z: 1.0 + z, None, False),
    "rk4": Method("RK4", lambda z: 1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0))), _rk4, False),
    "ros2": Method("ROS2", _ros2_stability(GAMMA), _ros2(GAMMA), True),
    "ros2_large": Method("ROS2, γ = 1 + 1/√2", _ros2_stability(GAMMA_LARGE), _ros2(GAMMA_LARGE), True),
}


def boundary(stability: Callable, eigenvalues: np.ndarray) -> float:
    """Step, s, up to which |R(h lambda)| <= 1 for all eigenvalues (1/s), found from h = 0 upwards; inf if there is no end.

    Raises ValueError unless all eigenvalues lie in the left half plane: else no step reproduces a decaying motion.
    """
    if not eigenvalues.real.max() < 0.0:
        raise ValueError(f"an eigenvalue has the real part {eigenvalues.real.max():.3g}/s: the equilibrium itself is unstable")

    def worst(h):
        return np.abs(stability(np.multiply.outer(h, eigenvalues))).max(axis=-1) - 1.0

    grid = np.geomspace(1e-8 / np.abs(eigenvalues).max(), 1e6 / np.abs(eigenvalues).min(), 4000)
    beyond = worst(grid) > 1e-12
    if not beyond.any():
        return math.inf
    first = int(np.argmax(beyond))
    if first == 0:
        return 0.0
    low, high = grid[first - 1], grid[first]
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if worst(middle) <= 1e-12 else (low, middle)
    return float(low)
