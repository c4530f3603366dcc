"""CasADi's CVODES over an FMU function.  It knows no event indicators of FMUs: strings stay on the pieces of their start.
Settings: tolerance."""

import time

import casadi
from job import JOB, carry_out

builder = casadi.DaeBuilder("one", JOB.folder + "/fmu")
inputs = [float(casadi.DM(builder.start(name))) for name in builder.u()]
inputs = [JOB.forces.get(name, start) for name, start in zip(builder.u(), inputs)]
start = builder.get(builder.x())
function = builder.create("motion", ["x", "u"], ["ode"])
outputs = builder.create("outputs", ["x", "u"], ["y"])
chosen = [builder.y().index(name) for name in JOB.outputs]
x, u = casadi.MX.sym("x", len(start)), casadi.MX.sym("u", len(inputs))


def prepared(tolerance):
    options = {"abstol": tolerance, "reltol": tolerance, "max_num_steps": 100000}
    problem = {"x": x, "u": u, "ode": function(x, u)}
    integrator = casadi.integrator("one", "cvodes", problem, 0.0, JOB.times(), options)
    held = casadi.repmat(casadi.DM(inputs), 1, JOB.instants)

    def run():
        begin = time.process_time()
        states = integrator(x0=start, u=held)["xf"]
        seconds = time.process_time() - begin
        return [[float(outputs(states[:, k], inputs)[i]) for i in chosen] for k in range(JOB.instants)], seconds

    return run


carry_out(prepared)
