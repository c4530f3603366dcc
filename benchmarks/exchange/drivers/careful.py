"""CVODE as the validation calls it: with inputs at every evaluation, and a Jacobian.  Settings: relative tolerance."""

import importlib.util

import numpy as np
from fmpy import extract, read_model_description
from job import JOB, carry_out

found = importlib.util.spec_from_file_location("exchange", JOB.program)
exchange = importlib.util.module_from_spec(found)
found.loader.exec_module(exchange)
description, folder = read_model_description(JOB.fmu), extract(JOB.fmu)
outputs = [JOB.references[name] for name in JOB.outputs]


def prepared(tolerance):
    one = exchange.Instance(description, folder)
    one.start(JOB.forces)
    inputs = exchange.outside.Inputs(one, [], np.array([0.0, *JOB.times()]), np.zeros((JOB.instants, 0)))
    exchange.TOLERANCE = tolerance
    exchange.event(one.fmu, inputs, 0.0)

    def run():
        solver, rows = exchange.cvode(one, inputs, 0.0), []
        for k, end in enumerate(JOB.times()):
            exchange.advance(one.fmu, solver, inputs, inputs.times[k], end)
            rows.append(one.fmu.getReal(outputs))
        one.close()
        return rows

    return run


carry_out(prepared)
