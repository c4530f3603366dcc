"""The article's formulation, its matrix equations in NumPy (tensegrity_core/reference/equations.py), integrated by SciPy as the
article does it: an explicit Runge-Kutta method across the transitions.  RK45 is the pair behind MATLAB's ode45."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.integrate import solve_ivp

from benchmarks.harness.problems import INSTANTS, Problem
from tensegrity_core.reference import equations, instant
from tensegrity_core.reference.structure import Structure

from .ladder import Clock, Ladder, Run, timed, tolerances

METHODS = ("RK45", "DOP853")


class Article:
    """X = [N Ndot] (eq. 4) as a vector and its derivative (eq. 7), pieces of the force curves from the elongations."""

    def __init__(self, problem: Problem):
        model = problem.model
        self.s = Structure(model)
        force = problem.force.T * self.s.in_plane
        self.load = instant.Load(0.0, force, model.rest_length, np.zeros(len(model.strings)))
        self.shape = (3, 2 * len(model.nodes))
        self.start = np.concatenate((model.nodes.T, model.velocity.T), axis=1).ravel()
        self.clock = Clock(np.inf)
        self.modes: dict[bytes, instant.Mode] = {}
        self.slack = np.zeros(len(model.strings), dtype=bool)

    def mode(self, N: np.ndarray, Ndot: np.ndarray) -> instant.Mode:
        """The pieces that the elongations lie on."""
        elongation = equations.string_motion(N, Ndot, self.s.C_s)[1] - self.load.rest_length
        piece = (elongation > 0.0).astype(int)
        for j in self.s.laws:
            piece[j] = np.searchsorted(self.s.breakpoints[j], elongation[j])
        key = piece.tobytes()
        if key not in self.modes:
            self.modes[key] = instant.mode_of(self.s, piece, self.slack)
        return self.modes[key]

    def rhs(self, t: float, y: np.ndarray) -> np.ndarray:
        self.clock()
        N, Ndot = np.split(y.reshape(self.shape), 2, axis=1)
        motion = instant.motion_at(self.s, self.load, self.mode(N, Ndot), t, N, Ndot, ground=False)
        return np.concatenate((Ndot, motion.Nddot), axis=1).ravel()

    def energy(self, y: np.ndarray) -> float:
        """Kinetic, potential and elastic, J."""
        N, Ndot = np.split(y.reshape(self.shape), 2, axis=1)
        elongation = equations.string_motion(N, Ndot, self.s.C_s)[1] - self.load.rest_length
        kinetic = 0.5 * np.trace(Ndot @ self.s.M @ Ndot.T)
        return kinetic - np.sum(self.s.weight * N) + instant.elastic_energy(self.s, elongation)


def _measure(problem: Problem, article: Article, method: str, tolerance: float, repetitions: int, limit: float) -> Run:
    span, times = (0.0, problem.duration), np.linspace(0.0, problem.duration, INSTANTS + 1)

    def run():
        article.clock = Clock(limit)
        sol = solve_ivp(article.rhs, span, article.start, method, times, rtol=tolerance, atol=tolerance)
        if sol.status < 0:
            raise RuntimeError(sol.message)
        return sol

    found, sol = timed(repetitions, lambda: None, run)
    if sol is None:
        return found
    position = sol.y.T.reshape(INSTANTS + 1, *article.shape)[:, :, : article.shape[1] // 2].transpose(0, 2, 1)
    energy = np.array([article.energy(y) for y in sol.y.T])
    return Run(found.seconds, position[:, :, list(problem.model.axes)], energy, {"rhs": sol.nfev})


def ladders(problem: Problem) -> list[Ladder]:
    """ode45's pair and SciPy's method of order 8."""
    article, settings = Article(problem), tolerances(1e-3, 1e-10)
    measures = {method: partial(_measure, problem, article, method) for method in METHODS}
    return [Ladder("article", method, False, "tolerance", settings, measure) for method, measure in measures.items()]
