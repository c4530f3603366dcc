"""What it costs to see events late: hosts of our own over the calls of model exchange.

Two hosts.  One takes steps of SciPy's DOP853 and halves the step in which an indicator changed its sign until the event is
known to a tolerance; it acts at the late end of that.  The other takes classical Runge-Kutta steps of a fixed length, and acts
at the end of the step in which it saw a change of sign, as hosts with fixed steps do.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from pathlib import Path

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from scipy.integrate import DOP853

from benchmarks.harness.problems import INSTANTS, Problem
from fmu_src.validation import exchange
from tensegrity_core.files import scratch

from . import contenders

#: Of the host that has one, s: far below what is looked at.
TOLERANCE = 1e-11
#: Of events, and steps of the other host, s; each step is a part of the time between two instants.
LATE = tuple(10.0**n for n in range(-14, -1, 2))
STEPS = (1e-3, 5e-4, 2.5e-4, 1e-4, 5e-5)


class Fmu:
    """An instance in Continuous-Time Mode, as functions of time and states."""

    def __init__(self, fmu: Path, folder: Path, forces: dict[str, float]):
        described = read_model_description(str(fmu))
        self.one = exchange.Instance(described, extract(str(fmu), str(folder)), logging=True, categories=("logEvents",))
        self.fmu = self.one.fmu
        self.states, self.indicators = described.numberOfContinuousStates, described.numberOfEventIndicators
        self.one.start(forces)
        self.nominals = self._read(self.fmu.getNominalsOfContinuousStates, self.states)
        self.update(False)

    @staticmethod
    def _read(getter, count: int) -> np.ndarray:
        out = np.empty(count)
        getter(out.ctypes.data_as(ctypes.POINTER(ctypes.c_double)), count)
        return out

    def at(self, t: float, x: np.ndarray) -> None:
        self.fmu.setTime(t)
        self.fmu.setContinuousStates(np.ascontiguousarray(x).ctypes.data_as(ctypes.POINTER(ctypes.c_double)), self.states)

    def rates(self, t: float, x: np.ndarray) -> np.ndarray:
        self.at(t, x)
        return self._read(self.fmu.getDerivatives, self.states)

    def signs(self, t: float, x: np.ndarray) -> np.ndarray:
        self.at(t, x)
        return self._read(self.fmu.getEventIndicators, self.indicators) > 0.0

    def x(self) -> np.ndarray:
        return self._read(self.fmu.getContinuousStates, self.states)

    def completed(self, t: float, x: np.ndarray) -> bool:
        self.at(t, x)
        return self.fmu.completedIntegratorStep()[0]

    def update(self, enter: bool = True) -> None:
        if enter:
            self.fmu.enterEventMode()
        while self.fmu.newDiscreteStates()[0]:
            pass
        self.fmu.enterContinuousTimeMode()

    @property
    def transitions(self) -> int:
        return sum(category == "logEvents" for _, category, _ in self.one.messages)


def located(fmu: Fmu, t: float, end: float, late: float) -> None:
    """From t to end; events are known to a tolerance, s."""
    x = fmu.x()
    while t < end:
        solver = DOP853(fmu.rates, t, x, end, rtol=TOLERANCE, atol=TOLERANCE * fmu.nominals)
        before = fmu.signs(t, x)
        while solver.status == "running":
            begin = solver.t
            if solver.step() is not None:
                raise ArithmeticError("the solver's step became too small")
            t, x = solver.t, solver.y
            after = fmu.signs(t, x)
            event = bool(np.any(after != before))
            if event:
                dense, early = solver.dense_output(), begin
                while t - early > late:
                    middle = 0.5 * (early + t)
                    if not early < middle < t:
                        break
                    if np.array_equal(fmu.signs(middle, dense(middle)), before):
                        early = middle
                    else:
                        t = middle
                x = dense(t)
            if fmu.completed(t, x) or event:
                fmu.update()
                x = fmu.x()
                break


def stepped(fmu: Fmu, t: float, end: float, h: float) -> None:
    """From t to end in classical Runge-Kutta steps; events are seen at their ends."""
    count, start, x = round((end - t) / h), t, fmu.x()
    before = fmu.signs(t, x)
    for k in range(count):
        t = start + k * h
        a = fmu.rates(t, x)
        b = fmu.rates(t + 0.5 * h, x + 0.5 * h * a)
        c = fmu.rates(t + 0.5 * h, x + 0.5 * h * b)
        x = x + h / 6.0 * (a + 2.0 * b + 2.0 * c + fmu.rates(t + h, x + h * c))
        if fmu.completed(start + (k + 1) * h, x) or not np.array_equal(fmu.signs(start + (k + 1) * h, x), before):
            fmu.update()
            x = fmu.x()
            before = fmu.signs(start + (k + 1) * h, x)


def curve(problem: Problem, exact: np.ndarray, advance: Callable, settings: tuple[float, ...], shared: Path) -> dict:
    """Errors, m, and transitions by setting."""
    told = contenders.job(problem, contenders.packed(problem, "me", shared), contenders.CONTENDERS[0])
    found: dict = {"settings": settings, "errors": [], "transitions": []}
    outputs = [told["references"][name] for name in told["outputs"]]
    for setting in settings:
        with scratch() as folder:
            fmu, rows, instants = Fmu(Path(told["fmu"]), folder, told["forces"]), [], problem.duration / INSTANTS
            try:
                for k in range(INSTANTS):
                    advance(fmu, k * instants, (k + 1) * instants, setting)
                    rows.append(fmu.fmu.getReal(outputs))
            except (FMICallException, ArithmeticError):
                rows = []  # the motion has become none
            found["errors"].append(contenders.error({"rows": rows or None}, exact))
            found["transitions"].append(fmu.transitions)
            fmu.one.close()
    return found
