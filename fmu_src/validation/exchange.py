"""Runs a model exchange FMU as a stranger would: `python -I exchange.py job.json result.npz`, with numpy and fmpy only.

Job and result are those of outside.py, which lies beside this script; the host's solver is CVODE as fmpy has it.  Unlike fmpy's
own loop, it gives the FMU its inputs at every evaluation, as the standard has it; where inputs jump there is an event.
"""

import ctypes
import importlib.util
import os
import sys
import time

import numpy as np

if __package__:
    from . import outside
else:  # a script of its own, see outside.beside
    found = importlib.util.spec_from_file_location("outside", os.path.join(os.path.dirname(__file__), "outside.py"))
    outside = importlib.util.module_from_spec(found)  # type: ignore[arg-type]
    found.loader.exec_module(outside)  # type: ignore[union-attr]

#: Relative tolerance of CVODE; absolute: times the nominal values of the states.
TOLERANCE = 1e-10
#: The same where bars share nodes. Their states are more than the motions, and what a solver errs across the bars' lengths
#: takes or gives energy: 8e-7 of it at 1e-10, in 0.2 s.
JOINTED_TOLERANCE = 1e-12
#: Steps of CVODE from one communication point to the next, at most.
STEPS = 200_000


class Instance(outside.Instance):
    """An FMU of model exchange."""

    ACCESS, KIND = "FMU2Model", "modelExchange"

    def partials(self):
        """What fills a vector with the derivatives of all rates by the state of a number; None: the FMU has nothing for it."""
        if not self.description.modelExchange.providesDirectionalDerivative:
            return None
        listed = [unknown.variable for unknown in self.description.derivatives]
        rates = (ctypes.c_uint * len(listed))(*(rate.valueReference for rate in listed))
        states = [ctypes.c_uint(rate.derivative.valueReference) for rate in listed]
        call, component, one = self.fmu.fmi2GetDirectionalDerivative, self.fmu.component, ctypes.c_double(1.0)
        return lambda i, column: call(component, rates, len(rates), states[i], 1, one, column)


class Jacobian:
    """Derivatives of an FMU by its states, for CVODE; by directional derivatives where the FMU has them.

    The differences that CVODE would take are as narrow as the motion is slow: in a structure nearly at rest they drown in
    round-off, its iterations fail, and it takes ten thousand times as many evaluations.  Here their widths are those of the
    states' nominal values."""

    def __init__(self, instance, solver):
        self.fmu, self.solver = instance.fmu, solver
        self.nominals = np.empty(solver.nx)
        self.fmu.getNominalsOfContinuousStates(self.pointer(self.nominals), solver.nx)
        self.partials = instance.partials()
        self.step = self.directions if self.partials else self.differences

    @staticmethod
    def pointer(vector):
        return vector.ctypes.data_as(ctypes.POINTER(ctypes.c_double))

    def give_to_cvode(self):
        from fmpy.sundials.cvode import sundials_cvode
        from fmpy.sundials.sunmatrix_dense import sundials_sunmatrixdense

        self.data = sundials_sunmatrixdense.SUNDenseMatrix_Data
        self.data.argtypes, self.data.restype = [ctypes.c_void_p], ctypes.POINTER(ctypes.c_double)
        kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_double, *[ctypes.c_void_p] * 7)
        self.callback = kind(self.fill)
        setter = sundials_cvode.CVodeSetJacFn
        setter.argtypes = [ctypes.c_void_p, kind]
        if setter(self.solver.cvode_mem, self.callback):
            raise RuntimeError("CVODE refused the Jacobian")

    def fill(self, t, y, fy, matrix, *_):
        """CVODE's call: columns of the dense matrix at time t and states y, where the derivatives are fy."""
        from fmpy.fmi1 import FMICallException
        from fmpy.sundials.nvector_serial import NV_DATA_S

        n = self.solver.nx
        states, rates = (np.ctypeslib.as_array(NV_DATA_S(ctypes.cast(v, type(self.solver.x))), (n,)) for v in (y, fy))
        try:
            self.step(t, states, rates, np.ctypeslib.as_array(self.data(matrix), (n, n)))
        except FMICallException:
            return 1  # CVODE tries a shorter step
        return 0

    def directions(self, t, states, rates, columns):
        self.fmu.setTime(t)
        self.solver.input.apply(t)
        self.fmu.setContinuousStates(self.pointer(states), len(states))
        for i, column in enumerate(columns):
            self.partials(i, self.pointer(column))

    def differences(self, t, states, rates, columns):
        self.fmu.setTime(t)
        self.solver.input.apply(t)
        for i, column in enumerate(columns):
            moved = states.copy()
            moved[i] += np.sqrt(np.finfo(float).eps) * max(abs(states[i]), self.nominals[i])
            self.fmu.setContinuousStates(self.pointer(moved), len(states))
            self.fmu.getDerivatives(self.pointer(column), len(states))
            column -= rates
            column /= moved[i] - states[i]
        self.solver.evaluations += len(states)


def cvode(instance, inputs, start):
    """fmpy's solver, whose right-hand side sees the inputs of the instant, and which is given the Jacobian."""
    from fmpy.fmi1 import FMICallException
    from fmpy.sundials import CVodeSolver

    class Solver(CVodeSolver):
        evaluations = 0

        def f(self, t, y, ydot, user_data):
            self.evaluations += 1
            try:
                self.input.apply(t)
                return super().f(t, y, ydot, user_data)
            except FMICallException:
                return 1  # CVODE tries a shorter step

    fmu, described = instance.fmu, instance.description
    solver = Solver(
        nx=described.numberOfContinuousStates,
        nz=described.numberOfEventIndicators,
        get_x=fmu.getContinuousStates,
        set_x=fmu.setContinuousStates,
        get_dx=fmu.getDerivatives,
        get_z=fmu.getEventIndicators,
        get_nominals=fmu.getNominalsOfContinuousStates,
        set_time=fmu.setTime,
        input=inputs,
        startTime=start,
        relativeTolerance=TOLERANCE if instance.partials() else JOINTED_TOLERANCE,  # no partial derivatives: joints
        maxNumSteps=STEPS,
    )
    solver.jacobian = Jacobian(instance, solver)
    solver.jacobian.give_to_cvode()
    return solver


def event(fmu, inputs, now):
    """Event Mode, with the inputs of the step that begins."""
    fmu.enterEventMode()
    inputs.apply(now)
    while fmu.newDiscreteStates()[0]:
        pass
    fmu.enterContinuousTimeMode()


def advance(fmu, solver, inputs, now, end):
    """From one communication point to the next."""
    while now < end:
        found, _, now = solver.step(now, end)
        fmu.setTime(now)
        inputs.apply(now)
        if fmu.completedIntegratorStep()[0] or found:
            event(fmu, inputs, now)
            solver.reset(now)


def run(instance, times, values, names, parameters, told=None):
    """Integrate under held inputs.  Returns outputs (K+1, n), their names, and the seconds that it took.

    told: gets the part of the steps that is done, 0 to 1.
    """
    fmu = instance.fmu
    fmu.setupExperiment(startTime=times[0])
    instance.set(parameters)
    inputs, ports = outside.Inputs(instance, names, times, values), outside.Ports(instance, [])
    inputs.apply(times[0])
    fmu.enterInitializationMode()
    ports.get()
    out = np.empty((len(times), len(ports.names)))
    out[0] = ports.row()
    fmu.exitInitializationMode()
    while fmu.newDiscreteStates()[0]:
        pass
    fmu.enterContinuousTimeMode()
    solver, begin = cvode(instance, inputs, times[0]), time.perf_counter()
    for k in range(len(values)):
        if k and inputs.jump(k):
            inputs.apply(times[k])
            fmu.enterEventMode()
            inputs.k = k
            inputs.apply(times[k])
            while fmu.newDiscreteStates()[0]:
                pass
            fmu.enterContinuousTimeMode()
            solver.reset(times[k])
        inputs.k = k
        advance(fmu, solver, inputs, times[k], times[k + 1])
        ports.get()
        out[k + 1] = ports.row()
        if told:
            told((k + 1) / len(values))
    return out, ports.names, time.perf_counter() - begin


def main(job_path, result_path, *options):
    outside.main(job_path, result_path, *options, make=Instance, run=run)


if __name__ == "__main__":
    main(*sys.argv[1:])
